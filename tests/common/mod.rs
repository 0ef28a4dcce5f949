//! Reference vectors and small builders shared by the tests.
#![allow(dead_code, reason = "every test binary uses a part")]

use glam::DVec3;
use serde_json::Value;
use sinew::prelude::*;

/// A reference file: from `SINEW_REFERENCE` (a folder with `reference/`, `reference_dynamics/`),
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
            name: "body",
            points,
            tetrahedra,
            material,
            model,
            evaluation,
        })
        .expect("body");
    (simulation, body)
}
