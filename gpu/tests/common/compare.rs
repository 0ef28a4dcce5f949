//! Laws on the device against the same laws on the processor in `f64`.
use glam::DVec3;
use sinew::engine::law::{ElasticEnergy, EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::scalar::Scalar;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::prelude::*;
use sinew_gpu::{GpuBackend, GpuOptions};

use super::{STATES, State, beam, device, displacements, noise, relative, say};

/// Largest error allowed, of the largest force.
const BOUND: f64 = 1e-4;

fn rows_of(simulation: &Simulation, values: &[[f32; 4]]) -> Vec<DVec3> {
    let rows = &simulation.topology().bodies[0];
    let mut result = vec![DVec3::ZERO; rows.mesh_vertices()];
    for (row, vertex) in values.iter().zip(&rows.vertex_order) {
        let [x, y, z, _] = row.map(f64::from);
        result[vertex.index()] = DVec3::new(x, y, z);
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

/// What is compared.
#[derive(Clone, Copy)]
pub struct Comparison<'a> {
    /// For the log.
    pub law: &'a str,
    /// With its mesh.
    pub description: &'a BodyDescription<'a>,
    pub mesh: &'a Mesh,
    pub states: &'a [State],
    /// What else there is beside the body.
    pub set_up: &'a dyn Fn(&mut Simulation, BodyHandle),
}

/// A body in a state, with its energy and forces.
pub fn posed(
    description: &BodyDescription,
    u: &[DVec3],
    precision: Precision,
) -> (Simulation, f64, Vec<DVec3>) {
    posed_in(description, &|_, _| {}, u, precision)
}

/// The same with what is beside the body; the energy is with that of loads.
fn posed_in(
    description: &BodyDescription,
    set_up: &dyn Fn(&mut Simulation, BodyHandle),
    u: &[DVec3],
    precision: Precision,
) -> (Simulation, f64, Vec<DVec3>) {
    let options = SimulationOptions { precision, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options).unwrap();
    let body = simulation.add_body(description).unwrap();
    set_up(&mut simulation, body);
    simulation.set_state(body, u, &vec![DVec3::ZERO; u.len()]).unwrap();
    simulation.evaluate();
    let energy = simulation.world().resource::<ElasticEnergy>().total;
    let force = simulation.elastic_forces(body);
    (simulation, energy, force)
}

/// Of the device, and of the processor in `f32`.
fn errors(backend: &mut GpuBackend, comparison: &Comparison<'_>, state: &State) -> [Errors; 2] {
    let u = displacements(comparison.mesh, state);
    let pose = |precision| posed_in(comparison.description, comparison.set_up, &u, precision);
    let (mut double, energy, force) = pose(Precision::F64);
    let (mut single, single_energy, single_force) = pose(Precision::F32);
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

/// A law in a beam of tetrahedra.
pub fn compare(description: impl Fn(&Mesh) -> BodyDescription<'_>, law: &str) {
    compare_on(&beam([10, 4, 5]), description, law);
}

/// A law in a mesh.
pub fn compare_on(mesh: &Mesh, description: impl Fn(&Mesh) -> BodyDescription<'_>, law: &str) {
    let (description, set_up) = (&description(mesh), &|_: &mut Simulation, _| {});
    compare_in(Comparison { law, description, mesh, states: &STATES, set_up });
}

/// A body and what goes with it, in all states.
pub fn compare_in(comparison: Comparison<'_>) {
    let Some(mut backend) = device(&GpuOptions::default()) else { return };
    let law = comparison.law;
    for state in comparison.states {
        let [gpu, cpu] = errors(&mut backend, &comparison, state);
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
