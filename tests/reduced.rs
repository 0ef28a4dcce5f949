//! Bodies of hexahedra with reduced integration: bending beside the continuum, folded corners, removals, snapshots.

use crate::common::{Shortcuts, assert_fresh, disturb, hold_end, options, pick, region};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, jitter_interior};
use sinew::models::body::{Integration, VolumeRule};
use sinew::models::resection::Region;
use sinew::prelude::*;

/// Poisson's ratio, where the middle of the end of the continuum goes along x and z (m), and bounds (%) for 10x2x2 and 20x4x4 cells,
/// fixed before. The continuum is that of fully integrated hexahedra, by Richardson from 10x2x2, 20x4x4 and 40x8x8 cells; ten-node
/// tetrahedra of 20x4x4 cells are within 0.3 % of it.
const CONTINUUM: [(f64, [f64; 2], [f64; 2]); 4] = [
    (0.3, [-7.978_271e-5, -3.837_878e-3], [1.1, 0.7]),
    (0.45, [-7.639_184e-5, -3.768_035e-3], [1.4, 1.2]),
    (0.49, [-7.513_024e-5, -3.739_291e-3], [1.9, 1.6]),
    (0.4999, [-7.477_821e-5, -3.731_047e-3], [2.1, 1.7]),
];

fn alone(body: &BodyDescription) -> (Simulation, BodyHandle) {
    crate::common::alone(options(Precision::F64, 1), body)
}

/// A neo-Hookean body with reduced integration that keeps mean volumes.
fn reduced(mesh: &Mesh, material: YoungPoisson) -> BodyDescription<'_> {
    BodyDescription {
        model: Model::NeoHookean,
        volume: VolumeRule::Clusters,
        integration: Integration::Reduced,
        ..BodyDescription::new("body", mesh, material)
    }
}

/// A cantilever of 10 x 2 x 2 cm under its weight, whose end sinks by 4 % of its length: fully integrated hexahedra of 10x2x2 cells
/// are 6 to 8 % too stiff there.
#[test]
fn two_cells_across_bend_like_the_continuum() {
    for (poisson_ratio, continuum, bounds) in CONTINUUM {
        for (cells, bound) in [[10, 2, 2], [20, 4, 4]].into_iter().zip(bounds) {
            let mesh = box_hexahedra(DVec3::new(0.1, 0.02, 0.02), cells).unwrap();
            let material = YoungPoisson { young_modulus: 40e3, poisson_ratio, density: 1000.0 };
            let (mut simulation, body) = alone(&reduced(&mesh, material));
            hold_end(&mut simulation, body, &mesh.points);
            simulation.set_gravity(DVec3::new(0.0, 0.0, -0.4));
            simulation.set_dt(1.0);
            simulation.settle();
            let end = DVec3::new(0.1, 0.01, 0.01);
            let end = mesh.points.iter().position(|x| x.distance(end) < 1e-9).unwrap();
            let u = simulation.displacements(body)[end];
            let continuum = DVec3::new(continuum[0], 0.0, continuum[1]);
            let error = 100.0 * u.distance(continuum) / continuum.length();
            assert!(error < bound, "nu {poisson_ratio}, {cells:?}: {error} % ({u})");
        }
    }
}

/// A corner pushed in, which Gauss points do not see.
#[test]
fn folded_corners_are_counted() {
    let mesh = box_hexahedra(DVec3::ONE, [1; 3]).unwrap();
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
    for (integration, folded) in [(Integration::Full, false), (Integration::Reduced, true)] {
        let body = BodyDescription { integration, ..reduced(&mesh, material) };
        let (mut simulation, body) = alone(&body);
        let pushed = |x: &DVec3| if *x == DVec3::ONE { DVec3::splat(-0.4) } else { DVec3::ZERO };
        let u: Vec<DVec3> = mesh.points.iter().map(pushed).collect();
        simulation.displace(body, &u);
        let smallest = simulation.volume_ratios(body)[0];
        assert_eq!(smallest < 0.0, folded, "{integration:?}: {smallest}");
    }
}

#[test]
fn what_is_left_equals_a_fresh_build() {
    let mesh = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), [6, 2, 2]).unwrap();
    let mesh = jitter_interior(&mesh, 0.15, 7).unwrap();
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.49, density: 1000.0 };
    for (model, volume) in [
        (Model::CompressibleStVK, VolumeRule::Elements),
        (Model::NeoHookean, VolumeRule::Clusters),
        (Model::StVKVolume, VolumeRule::Clusters),
        (Model::Corotational, VolumeRule::Clusters),
        (Model::Linear, VolumeRule::Clusters),
    ] {
        let description = BodyDescription { model, volume, ..reduced(&mesh, material) };
        let (mut simulation, body) = alone(&description);
        simulation.prepare_removals(body).unwrap();
        disturb(&mut simulation, body, 1e-3, 3);
        let energy = simulation.evaluate();
        let (mut gone, mut compacted) = (0.0, 0);
        for round in 0..6 {
            let left = simulation.remaining(body, ElementKind::Hexahedron);
            let count = left.len().div_ceil(5);
            let some = region(ElementKind::Hexahedron, pick(left, count, round));
            let report = simulation.remove(body, some);
            gone += report.elastic_energy;
            compacted += u32::from(report.compacted);
            assert_fresh(&mut simulation, body, 1e-12, &format!("{model:?} round {round}"));
        }
        assert!(compacted > 0);
        let lost = (simulation.evaluate() + gone - energy).abs();
        assert!(lost < 1e-10 * energy, "{model:?}: {lost:e} of {energy}");
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_from_a_snapshot() {
    let mesh = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), [24, 6, 6]).unwrap();
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4999, density: 1000.0 };
    for precision in [Precision::F64, Precision::F32] {
        let run = |threads, from_snapshot: bool| {
            let build = || {
                let options = options(precision, threads);
                let (mut simulation, body) =
                    crate::common::alone(options, &reduced(&mesh, material));
                hold_end(&mut simulation, body, &mesh.points);
                simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
                simulation.set_dt(0.01);
                (simulation, body)
            };
            let (mut simulation, body) = build();
            simulation.steps(3);
            let region = Region::Sphere { centre: DVec3::new(0.1, 0.0, 0.05), radius: 0.02 };
            let report = simulation.remove(body, region);
            assert!(!report.hexahedra.is_empty(), "{report:?}");
            simulation.steps(2);
            if from_snapshot {
                let snapshot = simulation.snapshot().unwrap();
                (simulation, _) = build();
                simulation.restore(&snapshot).unwrap();
            }
            simulation.steps(4);
            simulation.state_hash()
        };
        let expected = run(1, false);
        assert_eq!(run(2, false), expected);
        assert_eq!(run(1, true), expected);
    }
}
