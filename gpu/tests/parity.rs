//! Every law on the device against the same law on the processor in `f64`, in several states: forces,
//! energy, products with the three tangents.

use crate::common::compare::{compare, compare_on, posed};
use crate::common::{
    MATERIAL, STATES, beam, bricks, device, displacements, displacements_of, half_bricks,
};
use glam::DVec3;
use sinew::engine::law::TangentKind;
use sinew::engine::mesh::Mesh;
use sinew::engine::report::VolumeReport;
use sinew::engine::step::measure_volume_ratios;
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew_gpu::GpuOptions;

fn of(mesh: &Mesh, model: Model) -> BodyDescription<'_> {
    BodyDescription { model, ..BodyDescription::new("beam", mesh, MATERIAL) }
}

#[test]
fn fused_stvk() {
    compare(|mesh| of(mesh, Model::StVK), "svk");
}

#[test]
fn fused_stvk_with_compression() {
    compare(|mesh| of(mesh, Model::CompressibleStVK), "svk_comp");
}

#[test]
fn svk_of_textbooks() {
    compare(|mesh| of(mesh, Model::StVKFem), "svk_fem");
}

#[test]
fn quadratic_springs() {
    compare(|mesh| of(mesh, Model::QuadraticSprings), "tqs");
}

#[test]
fn mass_spring() {
    compare(|mesh| of(mesh, Model::MassSpring), "mass_spring");
}

#[test]
fn linear() {
    compare(|mesh| of(mesh, Model::Linear), "linear");
}

#[test]
fn warped_stiffness() {
    compare(|mesh| of(mesh, Model::WarpedStiffness), "corotational_warped");
}

#[test]
fn corotational() {
    compare(|mesh| of(mesh, Model::Corotational), "corotational");
}

#[test]
fn neo_hookean() {
    compare(|mesh| of(mesh, Model::NeoHookean), "neo_hookean");
}

#[test]
fn svk_volume() {
    compare(|mesh| of(mesh, Model::StVKVolume), "svk_volume");
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::StVKVolume), "hexahedra svk_volume");
}

/// Every law has a twin but those named here, with their reason.
#[test]
fn every_row_of_the_table_has_a_twin() {
    // formed from the tensions of edges by the twins of the springs; for comparison on the processor alone
    let without = ["spring forces", "axes, printed form", "axes in hexahedra, printed form"];
    for row in sinew::models::laws::LAWS {
        let twins = sinew_gpu::laws::all().filter(|law| law.row == *row).count();
        assert_eq!(twins, usize::from(!without.contains(&row.info.name)), "{}", row.info.name);
    }
}

fn pooled(mesh: &Mesh, model: Model) -> BodyDescription<'_> {
    BodyDescription { evaluation: Evaluation::Pooled, ..of(mesh, model) }
}

#[test]
fn pooled_springs() {
    compare(|mesh| pooled(mesh, Model::StVK), "pooled svk");
}

#[test]
fn pooled_springs_with_compression() {
    compare(|mesh| pooled(mesh, Model::CompressibleStVK), "pooled svk_comp");
}

const CELLS: [usize; 3] = [8, 4, 3];

#[test]
fn hexahedra_stvk() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::StVK), "hexahedra svk");
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::StVKFem), "hexahedra svk_fem");
}

#[test]
fn hexahedra_stvk_with_compression() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::CompressibleStVK), "hexahedra svk_comp");
}

#[test]
fn hexahedra_linear() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::Linear), "hexahedra linear");
}

#[test]
fn hexahedra_corotational() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::Corotational), "hexahedra corotational");
}

#[test]
fn hexahedra_neo_hookean() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::NeoHookean), "hexahedra neo_hookean");
}

#[test]
fn hexahedra_beside_tetrahedra() {
    compare_on(&half_bricks(CELLS), |mesh| of(mesh, Model::CompressibleStVK), "mixed svk_comp");
    // hexahedra have no pooled form: theirs is the fused one
    compare_on(&half_bricks(CELLS), |mesh| pooled(mesh, Model::CompressibleStVK), "mixed pooled");
}

#[test]
fn volume_ratios_of_all_elements() {
    let (tets, hexes, mixed) = (beam([10, 4, 5]), bricks(CELLS), half_bricks(CELLS));
    let cases = [
        of(&tets, Model::CompressibleStVK),
        pooled(&tets, Model::CompressibleStVK),
        pooled(&tets, Model::StVK),
        of(&hexes, Model::Corotational),
        pooled(&mixed, Model::CompressibleStVK),
        // nothing but springs: the processor measures
        of(&tets, Model::MassSpring),
    ];
    for description in cases {
        let Some(mut backend) = device(&GpuOptions::default()) else { return };
        let mut inverted = 0;
        for state in &STATES {
            let u = displacements_of(description.points, state);
            let (mut double, ..) = posed(&description, &u, Precision::F64);
            let world = double.world_mut();
            world.run_system_cached(measure_volume_ratios::<f64>).unwrap();
            let cpu = world.resource::<VolumeReport>().clone();
            let [gpu] = backend.volumes::<f64>(world).unwrap()[..] else { panic!("one body") };
            if description.model == Model::MassSpring {
                assert_eq!((gpu.elements, gpu.inverted), (0, 0));
                assert_eq!(gpu.smallest, f64::INFINITY);
                continue;
            }
            assert_eq!([gpu.elements, gpu.inverted], [cpu.elements_by_body[0], cpu.inverted]);
            let error = (gpu.smallest - cpu.smallest_ratio).abs();
            assert!(error < 1e-5, "{}: {error:.1e} of {}", state.0, cpu.smallest_ratio);
            inverted = inverted.max(gpu.inverted);
        }
        assert!(description.model == Model::MassSpring || inverted > 20, "{inverted}");
    }
}

#[test]
fn springs_on_edges_of_hexahedra() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::MassSpring), "hexahedra mass_spring");
}

#[test]
fn worlds_are_not_taken_for_each_other() {
    let Some(mut backend) = device(&GpuOptions::default()) else { return };
    let mesh = beam([4, 2, 2]);
    let u = displacements(&mesh, &STATES[0]);
    for model in [Model::StVK, Model::Linear] {
        let (mut simulation, energy, _) = posed(&of(&mesh, model), &u, Precision::F64);
        let found = backend.evaluate::<f64>(simulation.world_mut()).unwrap().energies[0];
        assert!((found - energy).abs() < 1e-5 * energy, "{model:?}: {found} of {energy}");
    }
}

#[test]
fn repeats_bit_for_bit_and_does_not_depend_on_how_buffers_are_cut() {
    let mesh = beam([10, 4, 5]);
    // of 1200 tetrahedra 6 chunks, and 8 parts of the matrix
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 128 << 10);
    repeats(&mesh, &pooled(&mesh, Model::CompressibleStVK), 128 << 10);
    let mesh = half_bricks(CELLS);
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 64 << 10);
    // 50 hexahedra, then 46
    let mesh = bricks(CELLS);
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK), 64 << 10);
}

fn repeats(mesh: &Mesh, description: &BodyDescription<'_>, limit: u64) {
    let Some(mut whole) = device(&GpuOptions::default()) else { return };
    let limit = Some(limit);
    let mut cut = device(&GpuOptions { binding_limit: limit, ..GpuOptions::default() }).unwrap();
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let body = simulation.add_body(description).unwrap();
    let u = displacements(mesh, &STATES[3]);
    simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()]).unwrap();
    let world = simulation.world_mut();
    let first = whole.evaluate::<f64>(world).unwrap();
    assert!(first == whole.evaluate::<f64>(world).unwrap());
    let parts = cut.evaluate::<f64>(world).unwrap();
    // chunks follow each other in the order of the elements, so even the rounding is the same
    assert!(first.forces == parts.forces);
    assert!((first.energies[0] - parts.energies[0]).abs() < 1e-6 * first.energies[0]);
    let direction = vec![[1.0, -2.0, 0.5, 0.0]; first.forces.len()];
    for kind in [TangentKind::Exact, TangentKind::Projected] {
        let a = whole.multiply::<f64>(world, kind, &direction).unwrap();
        assert!(a == whole.multiply::<f64>(world, kind, &direction).unwrap(), "{kind:?}");
        let b = cut.multiply::<f64>(world, kind, &direction).unwrap();
        assert!(a == b, "{kind:?}");
    }
}
