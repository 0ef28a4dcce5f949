//! Every law on the device against the same law on the processor in `f64`, in several states: forces,
//! energy, products with the three tangents.
mod common;

use common::compare::{compare, compare_on};
use common::{MATERIAL, STATES, beam, bricks, device, displacements, half_bricks};
use glam::DVec3;
use sinew::engine::law::TangentKind;
use sinew::engine::mesh::Mesh;
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
fn springs_on_edges_of_hexahedra() {
    compare_on(&bricks(CELLS), |mesh| of(mesh, Model::MassSpring), "hexahedra mass_spring");
}

#[test]
fn repeats_bit_for_bit_and_does_not_depend_on_how_buffers_are_cut() {
    let mesh = beam([10, 4, 5]);
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK));
    repeats(&mesh, &pooled(&mesh, Model::CompressibleStVK));
    let mesh = half_bricks(CELLS);
    repeats(&mesh, &of(&mesh, Model::CompressibleStVK));
}

fn repeats(mesh: &Mesh, description: &BodyDescription<'_>) {
    let Some(mut whole) = device(&GpuOptions::default()) else { return };
    // of 1200 tetrahedra 6 chunks, and 8 parts of the matrix
    let limit = Some(128 << 10);
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
