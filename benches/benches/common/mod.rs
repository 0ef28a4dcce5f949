//! The beams that all benches use: 0.2 x 0.05 x 0.05 m, bent by half a radian.
#![allow(dead_code, reason = "every bench uses a part")]

use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::schedule::ForceSchedule;
use sinew::prelude::*;

/// Name and cells of 5 040 and 49 392 tetrahedra.
pub const SIZES: [(&str, [usize; 3]); 2] = [("5k", [20, 6, 7]), ("50k", [42, 14, 14])];

pub fn beam(cells: [usize; 3]) -> Mesh {
    box_tets(DVec3::new(0.2, 0.05, 0.05), cells).expect("valid sizes")
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
    let options = SimulationOptions { precision, threads, ..Default::default() };
    let mut simulation = Simulation::new(options).expect("threads");
    let body = simulation
        .add_body(&BodyDescription {
            name: "beam",
            points: &mesh.points,
            tetrahedra: &mesh.tetrahedra,
            material: YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.45, density: 1000.0 },
            model,
            evaluation,
        })
        .expect("body");
    let side = &mesh.group("x0").expect("named side").vertices;
    let rows = simulation.rows(body, "clamp", side).expect("vertices");
    simulation.add_constraint(Constraint::hold("clamp", rows));
    let u: Vec<DVec3> = mesh.points.iter().map(|x| bend(*x)).collect();
    simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()]).expect("lengths");
    (simulation, body)
}

/// Displacement of a bar bent into an arc of 0.5 rad.
fn bend(x: DVec3) -> DVec3 {
    let radius = 0.2 / 0.5;
    let (sin, cos) = (x.x / radius).sin_cos();
    let r = radius + x.z;
    DVec3::new(r * sin, x.y, r * cos - radius) - x
}

pub fn request(
    simulation: &mut Simulation,
    energy: bool,
    force: bool,
    tangent: Option<TangentKind>,
) {
    simulation.world_mut().insert_resource(EvaluationRequest { energy, force, tangent });
}

/// One run of the force schedule.
pub fn evaluate(simulation: &mut Simulation) {
    simulation.world_mut().run_schedule(ForceSchedule);
}
