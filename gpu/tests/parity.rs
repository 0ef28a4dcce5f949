//! Every law on the device against the same law on the processor in `f64`, in several states: forces,
//! energy, products with the three tangents.
mod common;

use common::{MATERIAL, STATES, State, beam, device, displacements, noise, relative, say};
use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
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
fn cpu_product(
    simulation: &mut Simulation,
    kind: TangentKind,
    direction: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let world = simulation.world_mut();
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    let x: Vec<_> = direction.iter().map(|x| x.map(f64::from)).collect();
    let mut y = vec![[0.0; 4]; x.len()];
    let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
    let matrix = &world.resource::<Tangent<f64>>().matrix;
    matrix.multiply(topology, workers, &mut ProductSpans::default(), &x, &mut y);
    y.iter().map(|y| y.map(|y| y as f32)).collect()
}

struct Errors {
    force: f64,
    energy: f64,
    tangents: [f64; 3],
}

fn errors(
    backend: &mut GpuBackend,
    mesh: &Mesh,
    description: &BodyDescription,
    state: &State,
) -> Errors {
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let body = simulation.add_body(description).unwrap();
    let u = displacements(mesh, state);
    simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()]).unwrap();
    let energy = simulation.evaluate();
    let force = simulation.elastic_forces(body);
    let device = backend.evaluate::<f64>(simulation.world_mut()).unwrap();
    let direction: Vec<[f32; 4]> = (0..simulation.topology().vertex_count())
        .map(|row| {
            let d = noise(row + 77).as_vec3();
            [d.x, d.y, d.z, 0.0]
        })
        .collect();
    let tangents =
        [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected].map(|kind| {
            let cpu = cpu_product(&mut simulation, kind, &direction);
            let gpu = backend.multiply::<f64>(simulation.world_mut(), kind, &direction).unwrap();
            relative(&rows_of(&simulation, &gpu), &rows_of(&simulation, &cpu))
        });
    Errors {
        force: relative(&rows_of(&simulation, &device.forces), &force),
        energy: (device.energies[0] - energy).abs() / energy.abs(),
        tangents,
    }
}

fn compare(description: impl Fn(&Mesh) -> BodyDescription<'_>, law: &str) {
    let Some(mut backend) = device(&GpuOptions::default()) else { return };
    let mesh = beam([10, 4, 5]);
    for state in &STATES {
        let e = errors(&mut backend, &mesh, &description(&mesh), state);
        let [exact, gauss, projected] = e.tangents;
        say(&format!(
            "{law:22} {:24} force {:.1e} energy {:.1e} tangents {exact:.1e} {gauss:.1e} {projected:.1e}",
            state.0, e.force, e.energy
        ));
        assert!(e.force < BOUND, "{law}, {}: force {:.1e}", state.0, e.force);
        assert!(e.energy < BOUND, "{law}, {}: energy {:.1e}", state.0, e.energy);
        for (kind, error) in ["exact", "Gauss-Newton", "projected"].iter().zip(e.tangents) {
            assert!(error < BOUND, "{law}, {}: {kind} tangent {error:.1e}", state.0);
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
fn repeats_bit_for_bit_and_does_not_depend_on_how_buffers_are_cut() {
    let Some(mut whole) = device(&GpuOptions::default()) else { return };
    // 128 KiB: 6 chunks of elements and 8 parts of the matrix
    let limit = Some(128 << 10);
    let mut cut = device(&GpuOptions { binding_limit: limit, ..GpuOptions::default() }).unwrap();
    let mesh = beam([10, 4, 5]);
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    let body = simulation.add_body(&of(&mesh, Model::CompressibleStVK)).unwrap();
    let u = displacements(&mesh, &STATES[3]);
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
