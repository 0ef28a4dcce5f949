//! The beams of the library, in the form the criterion benches want.
#![allow(dead_code, unused_imports, reason = "every bench uses a part")]

pub use sinew_benches::beam::{SIZES, evaluate, request};

use sinew::engine::mesh::Mesh;
use sinew::models::body::Evaluation;
use sinew::prelude::*;

pub fn beam(cells: [usize; 3]) -> Mesh {
    sinew_benches::beam::beam(cells).expect("valid sizes")
}

/// Soft tissue with the compression term, clamped at x = 0 and bent.
pub fn bent(
    mesh: &Mesh,
    precision: Precision,
    threads: usize,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    bent_model(mesh, precision, threads, Model::CompressibleStVK, evaluation)
}

/// The same beam with any model.
pub fn bent_model(
    mesh: &Mesh,
    precision: Precision,
    threads: usize,
    model: Model,
    evaluation: Evaluation,
) -> (Simulation, BodyHandle) {
    sinew_benches::beam::bent(mesh, precision, threads, evaluation, model).expect("a beam")
}
