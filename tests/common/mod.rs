//! Reference vectors and small builders shared by the tests.

use bevy_ecs::entity::Entity;
use glam::DVec3;
use serde_json::Value;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::models::body::Evaluation;
use sinew::prelude::*;

/// A reference file: from `SINEW_REFERENCE` (a folder with `reference/`),
/// else from the project's own copy.
pub fn reference(path: &str) -> Value {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
    let folder = std::env::var("SINEW_REFERENCE").unwrap_or_else(|_| own.into());
    let file = format!("{folder}/{path}");
    let text = std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{file}: {e}"));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{file}: {e}"))
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("number expected, found {v}"))
}

pub fn vectors(v: &Value) -> Vec<DVec3> {
    v.as_array()
        .expect("list of vectors")
        .iter()
        .map(|x| DVec3::new(number(&x[0]), number(&x[1]), number(&x[2])))
        .collect()
}

pub fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().expect("list of numbers").iter().map(number).collect()
}

pub fn indices<const N: usize>(v: &Value) -> Vec<[u32; N]> {
    v.as_array()
        .expect("list of cells")
        .iter()
        .map(|c| std::array::from_fn(|i| c[i].as_u64().expect("index") as u32))
        .collect()
}

pub fn list(v: &Value) -> Vec<u32> {
    v.as_array().expect("list").iter().map(|i| i.as_u64().expect("index") as u32).collect()
}

/// Largest distance between two fields.
pub fn max_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

pub fn max_length(a: &[DVec3]) -> f64 {
    a.iter().map(|a| a.length()).fold(0.0, f64::max)
}

/// A simulation with one body.
pub fn simulation(
    options: SimulationOptions,
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    material: YoungPoisson,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    let mut simulation = Simulation::new(options).expect("threads");
    let body = simulation
        .add_body(&BodyDescription {
            model,
            evaluation,
            ..BodyDescription::from_parts("body", points, tetrahedra, material)
        })
        .expect("body");
    (simulation, body)
}

/// A box of tetrahedra with one corner at the origin, its interior vertices moved at random.
pub fn jittered_box(size: [f64; 3], cells: [usize; 3]) -> Mesh {
    let mesh = box_tets(DVec3::from_array(size), cells).expect("sizes are positive");
    jitter_interior(&mesh, 0.2, 7).expect("fraction below 1")
}

/// A material of water's density.
pub fn soft(young_modulus: f64, poisson_ratio: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 }
}

/// A simulation with one body made of a mesh.
pub fn simulate(
    options: SimulationOptions,
    mesh: &Mesh,
    material: YoungPoisson,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    simulation(options, &mesh.points, &mesh.tetrahedra, material, model, evaluation)
}

/// Vertices of a named group.
pub fn group(mesh: &Mesh, name: &str) -> Vec<u32> {
    mesh.group(name).expect("the generators name their sides").vertices.clone()
}

/// Holds a named side of a body for good.
pub fn clamp(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh, side: &str) -> Entity {
    let rows = simulation.rows(body, side, &group(mesh, side)).expect("vertices exist");
    simulation.add_constraint(Constraint::hold(side, rows))
}

/// The same field of numbers between -1 and 1 every time (splitmix64).
pub fn random_field(n: usize, mut seed: u64) -> Vec<DVec3> {
    let mut next = || {
        seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n).map(|_| DVec3::new(next(), next(), next())).collect()
}
