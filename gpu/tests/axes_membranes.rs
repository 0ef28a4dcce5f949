//! Axes, membranes and follower pressure on the device against the processor in `f64`.
mod common;

use common::compare::{Comparison, compare, compare_in};
use common::{MATERIAL, STATES, State, beam};
use glam::{DVec2, DVec3};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::triangle_grid;
use sinew::models::axes::field;
use sinew::models::axes::muscle::activate_at;
use sinew::models::sheet::{MembraneDescription, MembraneModel};
use sinew::prelude::*;

/// Four families that are not orthogonal, two of them active, five angles: triads, fibres and a term of volume,
/// some elements without a share.
fn rich(mesh: &Mesh) -> AxesDescription<'static> {
    let n = mesh.tetrahedra.len();
    let fields: Vec<_> = (0..4).map(|i| field::random(mesh, i).directions).collect();
    let family = |name, i: usize, modulus| AxisFamily::new(name, &fields[i], modulus);
    let muscle = MuscleSettings {
        peak_stress: 4e3,
        optimal_stretch: 1.05,
        stiffening: 0.5,
        shortening: 0.1,
        ..MuscleSettings::default()
    };
    let share: Vec<f64> = (0..n).map(|i| (i % 3) as f64 * 0.5).collect();
    let angle = |families, modulus| AxisAngle { families, modulus };
    AxesDescription {
        families: vec![
            family("a", 0, 3e3),
            family("b", 1, 8e3),
            AxisFamily { muscle: Some(muscle.clone()), ..family("c", 2, 2e3) },
            AxisFamily { muscle: Some(muscle), share: Some(share.into()), ..family("d", 3, 1e3) },
        ],
        angles: vec![
            angle([0, 1], 1e3),
            angle([2, 0], 2e3),
            angle([1, 2], 5e2),
            angle([1, 3], 7e2),
            angle([3, 0], 9e2),
        ],
        volume_modulus: 6e3,
        form: AxisForm::EnergyConsistent,
    }
    .into_owned()
}

fn with_axes<'a>(
    mesh: &'a Mesh,
    model: Model,
    axes: AxesDescription<'static>,
) -> BodyDescription<'a> {
    BodyDescription { model, axes: Some(axes), ..BodyDescription::new("beam", mesh, MATERIAL) }
}

#[test]
fn isotropic_axes_alone() {
    let axes = AxesDescription::isotropic(MATERIAL.lame().unwrap());
    compare(|mesh| with_axes(mesh, Model::Axes, axes.clone()), "axes");
}

#[test]
fn volume_preservation_beside_a_material() {
    let axes = AxesDescription { volume_modulus: 2e4, ..AxesDescription::default() };
    compare(|mesh| with_axes(mesh, Model::Corotational, axes.clone()), "volume");
}

#[test]
fn passive_and_active_fibres_beside_a_material() {
    let mesh = beam([10, 4, 5]);
    let description = with_axes(&mesh, Model::CompressibleStVK, rich(&mesh));
    for activation in [0.0, 0.7] {
        compare_in(Comparison {
            law: &format!("axes, active {activation}"),
            description: &description,
            mesh: &mesh,
            states: &STATES,
            set_up: &|simulation, body| {
                simulation.set_activation(body, "c", activation).unwrap();
                simulation.set_activation(body, "d", 0.3 * activation).unwrap();
                let precision = simulation.precision();
                let world = simulation.world_mut();
                match precision {
                    Precision::F64 => activate_at::<f64>(world, 0.0),
                    Precision::F32 => activate_at::<f32>(world, 0.0),
                }
            },
        });
    }
}

/// A sheet stretched and sheared, hardly deformed, rolled up, wrinkled, drawn together to a strip.
const SHEET_STATES: [State; 5] = [
    STATES[0],
    STATES[1],
    ("rolled and stretched", |x, _| {
        let (sin, cos) = (1.1 * x.x / 0.04).sin_cos();
        DVec3::new(0.04 * sin, x.y, 0.04 - 0.04 * cos) - x
    }),
    ("wrinkled", |x, noise| DVec3::new(-0.3 * x.x, 0.1 * x.y, 0.0) + 4e-3 * noise),
    ("a strip", |x, noise| DVec3::new(0.1 * x.x, -0.98 * x.y, 0.0) + 1e-3 * noise),
];

const SHEET_MODELS: [MembraneModel; 6] = [
    MembraneModel::Biquadratic,
    MembraneModel::CompressibleBiquadratic,
    MembraneModel::Quadratic,
    MembraneModel::Linear,
    MembraneModel::Corotational,
    MembraneModel::MassSpring,
];

#[test]
fn sheets() {
    let mesh = triangle_grid(DVec2::new(0.2, 0.05), [16, 5]).unwrap();
    for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
        for model in SHEET_MODELS.into_iter().filter(|model| model.supports(evaluation)) {
            let membrane = MembraneDescription {
                model,
                evaluation,
                ..MembraneDescription::new(&mesh.triangles, 1e-3, MATERIAL)
            };
            compare_in(Comparison {
                law: &format!("{} {evaluation:?}", model.name()),
                description: &BodyDescription {
                    membrane: Some(membrane),
                    ..BodyDescription::from_parts("sheet", &mesh.points, &[], MATERIAL)
                },
                mesh: &mesh,
                states: &SHEET_STATES,
                set_up: &|_, _| {},
            });
        }
    }
}

#[test]
fn skins_of_solids() {
    let mesh = beam([10, 4, 5]);
    let skin = mesh.surface_triangles();
    let models = [
        (Evaluation::Fused, MembraneModel::CompressibleBiquadratic),
        (Evaluation::Fused, MembraneModel::Corotational),
        (Evaluation::Fused, MembraneModel::MassSpring),
        (Evaluation::Pooled, MembraneModel::CompressibleBiquadratic),
    ];
    for (evaluation, model) in models {
        let membrane = MembraneDescription {
            model,
            evaluation,
            ..MembraneDescription::new(&skin, 1e-3, MATERIAL)
        };
        let description = BodyDescription {
            membrane: Some(membrane),
            evaluation,
            ..BodyDescription::new("beam", &mesh, MATERIAL)
        };
        compare_in(Comparison {
            law: &format!("skin {} {evaluation:?}", model.name()),
            description: &description,
            mesh: &mesh,
            states: &STATES,
            set_up: &|_, _| {},
        });
    }
}
