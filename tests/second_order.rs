//! Bodies of ten-node tetrahedra: equilibria, steps, removals, pressure, contact, snapshots.

use crate::common::{Shortcuts, assert_fresh, blow, disturb, guide, hold_end, options, recovers};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::models::body::VolumeRule;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;

const SOFT: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.35, density: 1000.0 };
const STIFF_IN_VOLUME: YoungPoisson = YoungPoisson { poisson_ratio: 0.4999, ..SOFT };
const SIZE: DVec3 = DVec3::new(0.2, 0.05, 0.05);

fn alone(body: &BodyDescription) -> (Simulation, BodyHandle) {
    crate::common::alone(options(Precision::F64, 1), body)
}

fn bar(cells: [usize; 3]) -> Mesh {
    box_tets(SIZE, cells).unwrap().with_second_order()
}

/// How far the free end of a bar sinks (m).
fn tip(description: &BodyDescription, settings: SolverSettings) -> f64 {
    let (mut simulation, body) = alone(description);
    hold_end(&mut simulation, body, description.points);
    simulation.set_gravity(DVec3::new(0.0, 0.0, -0.5));
    simulation.set_dt(1.0);
    simulation.set_solver(SolverSettings { integrator: Integrator::QuasiStatic, ..settings });
    simulation.step().unwrap();
    assert!(!simulation.report().unconverged);
    assert_eq!(simulation.volume_report().inverted, 0);
    simulation.displacements(body).iter().map(|u| u.z).fold(0.0, f64::min)
}

#[test]
fn coarse_bars_bend_like_fine_ones_and_do_not_lock() {
    for (model, volume, material) in [
        (Model::CompressibleStVK, VolumeRule::Elements, SOFT),
        (Model::NeoHookean, VolumeRule::Clusters, SOFT),
        (Model::StVKVolume, VolumeRule::Clusters, STIFF_IN_VOLUME),
        (Model::Corotational, VolumeRule::Clusters, STIFF_IN_VOLUME),
    ] {
        let sink = |mesh: &Mesh| {
            let description =
                BodyDescription { model, volume, ..BodyDescription::new("bar", mesh, material) };
            tip(&description, SolverSettings::default())
        };
        let truth = sink(&bar([10, 3, 3]));
        let error = sink(&bar([6, 2, 2])) / truth - 1.0;
        assert!(error.abs() < 0.025, "{}: {error}", model.name());
        // hexahedra, as many to the thickness as the fine mesh has vertices, say the same
        let hexahedra = sink(&box_hexahedra(SIZE, [20, 6, 6]).unwrap()) / truth - 1.0;
        assert!(hexahedra.abs() < 0.03, "{}: {hexahedra}", model.name());
    }
}

#[test]
fn every_preconditioner_takes_their_matrix() {
    let mesh = bar([4, 1, 1]);
    let model = Model::NeoHookean;
    let description = BodyDescription {
        model,
        volume: VolumeRule::Clusters,
        ..BodyDescription::new("bar", &mesh, STIFF_IN_VOLUME)
    };
    let sinks = [
        Preconditioner::BlockJacobi,
        Preconditioner::IncompleteCholesky,
        Preconditioner::Multigrid,
    ]
    .map(|preconditioner| {
        let settings = SolverSettings {
            preconditioner,
            linear_tolerance: 1e-8,
            max_linear_iterations: 20_000,
            ..SolverSettings::default()
        };
        tip(&description, settings)
    });
    assert!(sinks.iter().all(|sink| (sink / sinks[0] - 1.0).abs() < 1e-5), "{sinks:?}");
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_from_a_snapshot() {
    let mesh = bar([8, 3, 3]);
    for precision in [Precision::F64, Precision::F32] {
        let run = |threads, from_snapshot: bool| {
            let description = BodyDescription::new("bar", &mesh, SOFT);
            let build = || {
                let options = options(precision, threads);
                let (mut simulation, body) = crate::common::alone(options, &description);
                hold_end(&mut simulation, body, &mesh.points);
                simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
                simulation.set_dt(0.01);
                (simulation, body)
            };
            let (mut simulation, body) = build();
            simulation.steps(4);
            let region = Region::Sphere { centre: DVec3::new(0.1, 0.0, 0.05), radius: 0.02 };
            let report = simulation.remove(body, region);
            assert!(!report.tetrahedra.is_empty(), "{report:?}");
            simulation.steps(3);
            if from_snapshot {
                let snapshot = simulation.snapshot().unwrap();
                (simulation, _) = build();
                simulation.restore(&snapshot).unwrap();
            }
            simulation.steps(5);
            simulation.state_hash()
        };
        let expected = run(1, false);
        assert_eq!(run(2, false), expected);
        assert_eq!(run(1, true), expected);
    }
}

#[test]
fn what_is_left_equals_a_fresh_build() {
    let mesh = bar([5, 2, 2]);
    let skin = mesh.surface_triangles();
    for (model, volume) in [
        (Model::CompressibleStVK, VolumeRule::Elements),
        (Model::Corotational, VolumeRule::Elements),
        (Model::NeoHookean, VolumeRule::Clusters),
        (Model::StVKVolume, VolumeRule::Clusters),
        (Model::Corotational, VolumeRule::Clusters),
    ] {
        let membrane = Some(MembraneDescription::new(&skin, 1e-3, SOFT));
        let description =
            BodyDescription { model, volume, membrane, ..BodyDescription::new("bar", &mesh, SOFT) };
        let (mut simulation, body) = alone(&description);
        simulation.prepare_removals(body).unwrap();
        disturb(&mut simulation, body, 1e-3, 3);
        let energy = simulation.evaluate();
        let (mut gone, mut compacted) = (0.0, false);
        for round in 0..6 {
            let left = simulation.remaining(body, ElementKind::Tetrahedron);
            let some: Vec<u32> = left.iter().copied().skip(round).step_by(7).collect();
            let count = some.len();
            let report = simulation.remove(body, Region::Tetrahedra(some));
            assert_eq!((report.tetrahedra.len(), report.remaining), (count, left.len() - count));
            gone += report.elastic_energy;
            compacted |= report.compacted;
            let what = format!("{} round {round}", model.name());
            assert_fresh(&mut simulation, body, 1e-12, &what);
        }
        assert!(compacted);
        let left = simulation.evaluate();
        assert!((left + gone - energy).abs() < 1e-10 * energy, "{}", model.name());
    }
}

#[test]
fn a_pressure_acts_on_four_triangles_of_every_face() {
    let mesh = box_tets(DVec3::splat(0.1), [2, 2, 2]).unwrap().with_second_order();
    let (mut simulation, body) = alone(&BodyDescription::new("cube", &mesh, SOFT));
    let inward: Vec<[u32; 3]> =
        mesh.surface_triangles().into_iter().map(|[a, b, c]| [a, c, b]).collect();
    assert_eq!(inward.len(), 4 * 48);
    for (group, axes) in [("x0", 1), ("y0", 2), ("z0", 4)] {
        guide(&mut simulation, body, &mesh, group, axes);
    }
    blow(&mut simulation, body, &inward, 500.0, Curve::Constant);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(1.0);
    simulation.settle();
    // small-strain compression p (1 - 2 nu)/E along every axis
    let expected = 1.0 - 3.0 * 500.0 * (1.0 - 2.0 * SOFT.poisson_ratio) / SOFT.young_modulus;
    let volume = simulation.volume(body) / 1e-3;
    assert!((volume - expected).abs() < 2e-3, "{volume} {expected}");
    let ratios = simulation.volume_ratios(body);
    assert_eq!(ratios.len(), 48);
    // flat parts give corners and middles other shares than the shape functions do: faces ripple, but all are compressed
    assert!(ratios.iter().all(|&j| j < 1.0), "{ratios:?} {expected}");
    // a tetrahedron that goes takes its faces with it
    let corner = mesh.tetrahedra.iter().position(|t| t.contains(&0)).unwrap() as u32;
    let report = simulation.remove(body, Region::Tetrahedra(vec![corner]));
    assert!(report.pressure_faces > 0 && report.pressure_faces % 4 == 0, "{report:?}");
}

#[test]
fn a_ball_meets_the_vertices_on_edges_too() {
    let size = DVec3::new(0.06, 0.06, 0.03);
    let press = |mesh: &Mesh| {
        let (mut simulation, body) = alone(&BodyDescription::new("slab", mesh, SOFT));
        let rows = simulation.group_rows(body, mesh, "z0").unwrap();
        simulation.add_constraint(Constraint::hold("floor", rows));
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(0.01);
        simulation.integrate_by(Integrator::QuasiStatic);
        let above = DVec3::new(0.03, 0.03, 0.05);
        let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, above);
        let ball = simulation.add_tool(ball).unwrap();
        for step in 1..=10 {
            let to = above - DVec3::Z * 4e-4 * f64::from(step);
            simulation.move_tool(ball, to).unwrap();
            simulation.step().unwrap();
        }
        assert_eq!(simulation.volume_report().inverted, 0);
        simulation.tool_report(ball).unwrap().force.z
    };
    let fine = press(&box_tets(size, [16, 16, 8]).unwrap());
    let coarse = press(&box_tets(size, [6, 6, 3]).unwrap().with_second_order());
    // a patch of 9 mm round, resolved by vertices 5 mm apart
    assert!((coarse / fine - 1.0).abs() < 0.1, "{coarse} beside {fine}");
}

#[test]
fn crushed_bodies_recover() {
    let mesh = box_tets(DVec3::splat(0.1), [2, 2, 2]).unwrap().with_second_order();
    for start in ["flat", "mirrored"] {
        let noise = crate::common::random_field(mesh.points.len(), 5);
        let factor = if start == "flat" { -1.0 } else { -2.0 };
        let u: Vec<DVec3> = mesh
            .points
            .iter()
            .zip(&noise)
            .map(|(p, n)| factor * p.z * DVec3::Z + 1e-6 * *n)
            .collect();
        recovers(&BodyDescription::new("cube", &mesh, SOFT), &u, start);
    }
}
