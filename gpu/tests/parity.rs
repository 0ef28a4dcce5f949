//! Every law on the device against the same law on the processor in `f64`, in several states: forces,
//! energy, products with the three tangents.
mod common;

use common::{
    MATERIAL, STATES, State, beam, bricks, device, displacements, half_bricks, noise, relative, say,
};
use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::prelude::*;
use sinew_gpu::{GpuBackend, GpuOptions};

/// Largest error allowed, of the largest force.
const BOUND: f64 = 1e-4;

fn rows_of(simulation: &Simulation, values: &[[f32; 4]]) -> Vec<DVec3> {
    let rows = &simulation.topology().bodies[0];
    let mut result = vec![DVec3::ZERO; rows.row_of_vertex.len()];
    for (row, &vertex) in values.iter().zip(&rows.vertex_order) {
        let [x, y, z, _] = row.map(f64::from);
        result[vertex as usize] = DVec3::new(x, y, z);
    }
    result
}

/// Product of the CPU's tangent with a direction by rows.
fn cpu_product<S: Scalar>(
    simulation: &mut Simulation,
    kind: TangentKind,
    direction: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let world = simulation.world_mut();
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    let x: Vec<_> = direction.iter().map(|x| x.map(|x| S::from_f64(x.into()))).collect();
    let mut y = vec![[S::ZERO; 4]; x.len()];
    let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
    let matrix = &world.resource::<Tangent<S>>().matrix;
    matrix.multiply(topology, workers, &mut ProductSpans::default(), &x, &mut y);
    y.iter().map(|y| y.map(|y| y.to_f64() as f32)).collect()
}

/// Errors against the processor in `f64`.
struct Errors {
    force: f64,
    energy: f64,
    tangents: [f64; 3],
}

const KINDS: [TangentKind; 3] =
    [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected];

/// A body in a state, with its energy and forces.
fn posed(
    description: &BodyDescription,
    u: &[DVec3],
    precision: Precision,
) -> (Simulation, f64, Vec<DVec3>) {
    let options = SimulationOptions { precision, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options).unwrap();
    let body = simulation.add_body(description).unwrap();
    simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()]).unwrap();
    let energy = simulation.evaluate();
    let force = simulation.elastic_forces(body);
    (simulation, energy, force)
}

/// Of the device, and of the processor in `f32`.
fn errors(
    backend: &mut GpuBackend,
    mesh: &Mesh,
    description: &BodyDescription,
    state: &State,
) -> [Errors; 2] {
    let u = displacements(mesh, state);
    let (mut double, energy, force) = posed(description, &u, Precision::F64);
    let (mut single, single_energy, single_force) = posed(description, &u, Precision::F32);
    let device = backend.evaluate::<f64>(double.world_mut()).unwrap();
    let direction: Vec<[f32; 4]> = (0..double.topology().vertex_count())
        .map(|row| {
            let d = noise(row + 77).as_vec3();
            [d.x, d.y, d.z, 0.0]
        })
        .collect();
    let products = KINDS.map(|kind| cpu_product::<f64>(&mut double, kind, &direction));
    let of_device =
        KINDS.map(|kind| backend.multiply::<f64>(double.world_mut(), kind, &direction).unwrap());
    let of_single = KINDS.map(|kind| cpu_product::<f32>(&mut single, kind, &direction));
    let relative_rows =
        |a: &[[f32; 4]], b: &[[f32; 4]]| relative(&rows_of(&double, a), &rows_of(&double, b));
    let against =
        |own: [Vec<[f32; 4]>; 3]| std::array::from_fn(|k| relative_rows(&own[k], &products[k]));
    [
        Errors {
            force: relative(&rows_of(&double, &device.forces), &force),
            energy: (device.energies[0] - energy).abs() / energy.abs(),
            tangents: against(of_device),
        },
        Errors {
            force: relative(&single_force, &force),
            energy: (single_energy - energy).abs() / energy.abs(),
            tangents: against(of_single),
        },
    ]
}

fn compare(description: impl Fn(&Mesh) -> BodyDescription<'_>, law: &str) {
    compare_on(&beam([10, 4, 5]), description, law);
}

fn compare_on(mesh: &Mesh, description: impl Fn(&Mesh) -> BodyDescription<'_>, law: &str) {
    let Some(mut backend) = device(&GpuOptions::default()) else { return };
    for state in &STATES {
        let [gpu, cpu] = errors(&mut backend, mesh, &description(mesh), state);
        for (name, e) in [("GPU", &gpu), ("CPU f32", &cpu)] {
            let [exact, gauss, projected] = e.tangents;
            say(&format!(
                "{law:20} {:22} {name:8} force {:.1e} energy {:.1e} tangents {exact:.1e} {gauss:.1e} \
                 {projected:.1e}",
                state.0, e.force, e.energy
            ));
        }
        assert!(gpu.force < BOUND, "{law}, {}: force {:.1e}", state.0, gpu.force);
        assert!(gpu.energy < BOUND, "{law}, {}: energy {:.1e}", state.0, gpu.energy);
        // springs that are crushed to nothing lose digits of their direction in f32 anywhere
        for ((kind, own), single) in KINDS.iter().zip(gpu.tangents).zip(cpu.tangents) {
            let bound = BOUND.max(2.0 * single);
            assert!(own < bound, "{law}, {}: {kind:?} tangent {own:.1e}", state.0);
        }
    }
}

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
