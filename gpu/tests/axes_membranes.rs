//! Axes, membranes and follower pressure on the device against the processor in `f64`.

use crate::common::compare::{Comparison, compare, compare_in, compare_on};
use crate::common::shared::rich_axes::rich;
use crate::common::shared::{Shortcuts, blow, sheet, vertices};
use crate::common::*;
use glam::{DVec2, DVec3};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{quad_grid, triangle_grid};
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::axes::muscle::{MuscleSettings, activate_at};
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew_gpu::{GpuOptions, GpuReport};

fn with_axes<'a>(
    mesh: &'a Mesh,
    model: Model,
    axes: AxesDescription<'static>,
) -> BodyDescription<'a> {
    BodyDescription { axes: Some(axes), ..of(mesh, model) }
}

#[test]
fn isotropic_axes_alone() {
    let axes = AxesDescription::isotropic(MATERIAL.lame().unwrap());
    compare(|mesh| with_axes(mesh, Model::Axes, axes.clone()), "axes");
    compare_on(
        &bricks(CELLS),
        |mesh| with_axes(mesh, Model::Axes, axes.clone()),
        "axes in hexahedra",
    );
}

#[test]
fn volume_preservation_beside_a_material() {
    let axes = AxesDescription { volume_modulus: 2e4, ..AxesDescription::default() };
    for (law, mesh) in [("volume", beam([10, 4, 5])), ("volume, mixed", half_bricks(CELLS))] {
        compare_on(&mesh, |mesh| with_axes(mesh, Model::Corotational, axes.clone()), law);
    }
}

#[test]
fn passive_and_active_fibres_beside_a_material() {
    let meshes = [
        ("", beam([10, 4, 5]), Evaluation::Fused),
        ("pooled ", beam([10, 4, 5]), Evaluation::Pooled),
        ("mixed ", half_bricks(CELLS), Evaluation::Fused),
    ];
    for ((name, mesh, evaluation), activation) in meshes.iter().flat_map(|m| [(m, 0.0), (m, 0.7)]) {
        let description = BodyDescription {
            evaluation: *evaluation,
            ..with_axes(mesh, Model::CompressibleStVK, rich(mesh))
        };
        compare_in(Comparison {
            law: &format!("{name}axes {activation}"),
            description: &description,
            mesh,
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

const CELLS: [usize; 3] = [8, 4, 3];

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

/// A membrane alone, in the states of sheets.
fn compare_sheet(law: &str, mesh: &Mesh, membrane: MembraneDescription<'_>) {
    compare_in(Comparison {
        law,
        description: &sheet(&mesh.points, membrane),
        mesh,
        states: &SHEET_STATES,
        set_up: &|_, _| {},
    });
}

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
            compare_sheet(&format!("{} {evaluation:?}", model.name()), &mesh, membrane);
        }
    }
}

#[test]
fn sheets_of_quadrilaterals() {
    let mesh = quad_grid(DVec2::new(0.2, 0.05), [16, 5]).unwrap();
    for model in SHEET_MODELS.into_iter().filter(|model| *model != MembraneModel::Quadratic) {
        let membrane = MembraneDescription {
            model,
            quads: &mesh.quads,
            ..MembraneDescription::new(&[], 1e-3, MATERIAL)
        };
        compare_sheet(&format!("{} quads", model.name()), &mesh, membrane);
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

/// Two pressures on the skin of a solid, which share rims; and one on a sheet whose rim is free.
#[test]
fn follower_pressure() {
    let mesh = beam([10, 4, 5]);
    let skin = mesh.surface_triangles();
    let inflate = |simulation: &mut Simulation, body, triangles: &[[u32; 3]], pressure| {
        blow(simulation, body, triangles, pressure, Curve::Points(vec![[0.0, 0.5]]));
    };
    compare_in(Comparison {
        law: "pressure on a solid",
        description: &BodyDescription::new("beam", &mesh, MATERIAL),
        mesh: &mesh,
        states: &STATES,
        set_up: &|simulation, body| {
            inflate(simulation, body, &skin[..skin.len() / 2], 2e3);
            inflate(simulation, body, &skin[skin.len() / 3..], -5e3);
        },
    });
    let mesh = triangle_grid(DVec2::new(0.2, 0.05), [16, 5]).unwrap();
    let membrane = MembraneDescription::new(&mesh.triangles, 1e-3, MATERIAL);
    compare_in(Comparison {
        law: "pressure on a sheet",
        description: &sheet(&mesh.points, membrane),
        mesh: &mesh,
        states: &SHEET_STATES,
        set_up: &|simulation, body| inflate(simulation, body, &mesh.triangles, 200.0),
    });
}

/// The runs end alike, and books agree all along.
fn agree(runs: &[Run; 2], bound: f64, what: &str) {
    let [cpu, gpu] = runs;
    let u = relative(&gpu.u, &cpu.u);
    say(&format!("{what}: displacement {u:.1e}"));
    assert!(u < bound, "{what}: {u:.1e}");
    books_agree(runs);
}

#[test]
fn a_muscle_pulls_and_only_its_constants_go_up() {
    let mesh = beam([10, 3, 3]);
    let along = [DVec3::X];
    let muscle = MuscleSettings {
        peak_stress: 4e3,
        stiffening: 0.5,
        shortening: 0.1,
        curve: Some(Curve::ramp(0.0, 1.0)),
        ..MuscleSettings::default()
    };
    let family = AxisFamily { muscle: Some(muscle), ..AxisFamily::new("m", &along, 3e3) };
    let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
    let description = with_axes(&mesh, Model::CompressibleStVK, axes.into_owned());
    let scene = |s: &mut Simulation, body: BodyHandle| hold(s, body, &mesh, "x0");
    let Some(runs) = run_both(&description, 20, &settings(), scene) else { return };
    agree(&runs, 1e-4, "muscle");
    let [_, mut gpu] = runs;
    // the activation still rises: three rows of 16 bytes for every fibre, and what every step brings
    let fibres = 48 * mesh.tetrahedra.len() as u64;
    let sent = |run: &Run| {
        let report = run.simulation.world().resource::<GpuReport>();
        assert_eq!(report.uploads, 0);
        report.bytes_up
    };
    let rising = sent(&gpu);
    assert!(rising > fibres && rising < fibres + 4096, "{rising}");
    gpu.simulation.set_dt(1.0);
    gpu.simulation.steps(2);
    assert!(sent(&gpu) < 4096, "{} at full activation", sent(&gpu));
}

#[test]
fn pressure_inflates_and_is_booked_as_work_of_loads() {
    let mesh = beam([8, 4, 4]);
    let mut top = mesh.surface_triangles();
    top.retain(|t| t.iter().all(|&v| mesh.points[v as usize].z > 0.0499));
    let scene = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        blow(s, body, &top, -60.0, Curve::ramp(0.0, 0.1));
    };
    let description = BodyDescription::new("beam", &mesh, MATERIAL);
    let Some(runs) = run_both(&description, 20, &settings(), scene) else { return };
    agree(&runs, 1e-4, "pressure");
    assert!(runs[1].sum(|r| r.load_work) > 0.0);
}

#[test]
fn a_drum_swings_on_its_rim() {
    let mesh = triangle_grid(DVec2::new(0.2, 0.05), [16, 5]).unwrap();
    let description =
        sheet(&mesh.points, MembraneDescription::new(&mesh.triangles, 1e-3, MATERIAL));
    let scene = |s: &mut Simulation, body: BodyHandle| {
        let at_rim = |x: DVec3| x.x == 0.0 || x.y == 0.0 || x.x > 0.1999 || x.y > 0.0499;
        let rim = vertices(&mesh.points, at_rim);
        let rows = s.rows(body, "rim", &rim).unwrap();
        s.add_constraint(Constraint::hold("rim", rows));
        blow(s, body, &mesh.triangles, 50.0, Curve::Constant);
    };
    let Some(runs) = run_both(&description, 20, &settings(), scene) else { return };
    agree(&runs, 1e-4, "drum");
}

#[test]
fn dampers_along_fibres_beside_stiffness_damping() {
    let along = [DVec3::new(1.0, 0.0, 1.0)];
    for (name, mesh) in [("tetrahedra", beam([8, 3, 3])), ("hexahedra", bricks([8, 3, 3]))] {
        let family = AxisFamily { viscosity: 200.0, ..AxisFamily::new("f", &along, 2e4) };
        let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
        let description = with_axes(&mesh, Model::CompressibleStVK, axes.into_owned());
        for stiffness_damping in [0.0, 0.003] {
            let settings = SolverSettings { stiffness_damping, ..settings() };
            let scene = |s: &mut Simulation, body: BodyHandle| hold(s, body, &mesh, "x0");
            let Some(runs) = run_both(&description, 20, &settings, scene) else { return };
            agree(&runs, 1e-4, &format!("dampers in {name} beside {stiffness_damping}"));
            assert!(runs[1].reports.last().unwrap().damping_dissipation > 0.0);
        }
    }
}

/// A notch through fibres, dampers, skin and loaded faces.
#[test]
fn removed_elements_take_their_axes_and_faces_along() {
    let mesh = beam([8, 3, 3]);
    let skin = mesh.surface_triangles();
    let along = [DVec3::new(1.0, 0.0, 1.0)];
    let family = AxisFamily { viscosity: 100.0, ..AxisFamily::new("f", &along, 2e4) };
    let axes = AxesDescription { families: vec![family], ..AxesDescription::default() };
    let description = BodyDescription {
        membrane: Some(MembraneDescription::new(&skin, 1e-3, MATERIAL)),
        ..with_axes(&mesh, Model::CompressibleStVK, axes.into_owned())
    };
    let scene = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        blow(s, body, &skin, 100.0, Curve::ramp(0.0, 0.2));
        s.steps(3);
        cut_notch(s, body, &mesh);
        let torn = Region::Triangles(in_notch(&mesh, &skin));
        s.remove(body, torn);
    };
    let Some(runs) = run_both(&description, 10, &settings(), scene) else { return };
    agree(&runs, 1e-4, "notched");
}

#[test]
fn explicit_substeps_refuse_pressures_and_dampers_by_name() {
    let mesh = beam([3, 2, 2]);
    let skin = mesh.surface_triangles();
    let Some(mut simulation) = on_device(&GpuOptions::default()) else { return };
    let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
    simulation.set_solver(SolverSettings { integrator: Integrator::StormerVerlet, ..settings() });
    simulation.step().unwrap();
    blow(&mut simulation, body, &skin, 1.0, Curve::Constant);
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("follower pressure in explicit"), "{error}");
    simulation.set_solver(settings());
    simulation.step().unwrap();
}

/// Axes say nothing while their body recovers.
#[test]
fn a_crushed_body_with_axes_recovers() {
    let mesh = beam([6, 3, 3]);
    let description = with_axes(&mesh, Model::CompressibleStVK, rich(&mesh));
    let crush = |s: &mut Simulation, body: BodyHandle| scramble(s, body, &mesh);
    let settings = SolverSettings { mass_damping: 5.0, linear_tolerance: 1e-4, ..settings() };
    let Some([cpu, gpu]) = run_both(&description, 120, &settings, crush) else { return };
    for run in [&cpu, &gpu] {
        assert!(run.reports[0].recovering > 0);
        let last = run.reports.last().unwrap();
        assert_eq!(last.recovering, 0, "{last:?}");
        let start = run.reports[0].elastic_energy;
        assert!(last.elastic_energy < 1e-3 * start, "{} of {start}", last.elastic_energy);
    }
}
