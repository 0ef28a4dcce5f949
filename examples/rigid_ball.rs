//! A rigid ball of 50 g falls on soft tissue. Tissue and ball are two programs: tissue takes the ball's place and gives a
//! force back. With that force alone the exchange is explicit, and unstable for light bodies on stiff tissue; with the
//! local stiffness the ball's own step is implicit. `cargo run --release --example rigid_ball`

use glam::{DMat3, DVec3};
use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (dt, mass, radius) = (0.01, 0.05, 0.02);
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.04), [8, 8, 4])?;
    let mut tissue = Simulation::new(SimulationOptions::default())?;
    tissue.set_dt(dt);
    tissue.set_solver(SolverSettings { mass_damping: 5.0, ..SolverSettings::default() });
    let material = YoungPoisson { young_modulus: 2e4, poisson_ratio: 0.4, density: 1000.0 };
    let block = tissue.add_body(&BodyDescription::new("block", &mesh, material))?;
    let floor = tissue.group_rows(block, &mesh, "z0")?;
    tissue.add_constraint(Constraint::hold("floor", floor));

    let mut place = DVec3::new(0.05, 0.05, 0.04 + radius + 0.02);
    let mut velocity = DVec3::ZERO;
    let mut tool = Tool::new("ball", Shape::Sphere { radius }, place);
    tool.local_stiffness = true;
    let tool = tissue.add_tool(tool)?;
    let (mut force, mut stiffness) = (DVec3::ZERO, DMat3::ZERO);
    for _ in 0..400 {
        // m (v' - v) = h (m g + F + K h v'): the force at the end of the ball's step, by the last stiffness
        let impulse = dt * (mass * 9.81 * DVec3::NEG_Z + force);
        let inertia = DMat3::from_diagonal(DVec3::splat(mass)) - dt * dt * stiffness;
        velocity = inertia.inverse() * (mass * velocity + impulse);
        place += dt * velocity;
        tissue.move_tool(tool, place)?;
        tissue.step()?;
        if let Some(report) = tissue.tool_report(tool) {
            (force, stiffness) = (report.force, report.local_stiffness.unwrap_or_default());
        }
    }
    let weight = mass * 9.81;
    println!(
        "at rest: {:.4} N of {weight:.4} N, at {:.2} mm, {:.1e} m/s",
        force.z,
        1e3 * place.z,
        velocity.length()
    );
    assert!((force.z / weight - 1.0).abs() < 1e-3, "the ball does not come to rest");
    Ok(())
}
