//! Forceps close on a piece of tissue that lies on a table, lift it and hold it in the air.
//!
//! `cargo run --release --example 05_grasp`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use sinew::touch::tool::{Hinge, Part};

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = box_tets(DVec3::new(0.04, 0.02, 0.02), [8, 4, 4])?;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let material = YoungPoisson { young_modulus: 2e4, ..preset("liver")?.material };
    let piece = simulation.add_body(&BodyDescription::new("piece", &mesh, material))?;
    simulation.set_solver(SolverSettings { mass_damping: 10.0, ..SolverSettings::default() });
    let table = Tool::ground("table", DVec3::ZERO, DVec3::Z).with_friction(0.5);
    let table = simulation.add_tool(table)?;

    // two jaws side by side, and the hinge 8 cm behind; `jaw` is the share of the angle that each turns by
    let shape = Shape::Box { half: DVec3::new(0.01, 0.004, 0.006), rounding: 0.003 };
    let jaw = |y: f64, jaw: f64| Part { at: DVec3::Y * y, jaw, ..Part::from(shape.clone()) };
    let place = DVec3::new(0.02, 0.01, 0.01);
    let pose = |lift: f64, opening: f64| ToolPose {
        position: place + DVec3::Z * lift,
        opening,
        ..ToolPose::default()
    };
    let mut forceps =
        Tool::of_parts("forceps", vec![jaw(0.004, -0.5), jaw(-0.004, 0.5)], pose(0.0, 0.4))
            .with_friction(0.8);
    forceps.hinge = Hinge { point: DVec3::X * 0.08, axis: DVec3::Z };
    let forceps = simulation.add_tool(forceps)?;

    for frame in 0..300_u32 {
        // closes in 0.5 s to less than the width of the piece, then lifts by 3 cm in 1 s, then stays
        let (close, lift) = (frame.min(50), frame.clamp(50, 150) - 50);
        let pose = pose(3e-4 * f64::from(lift), 0.4 - 0.0038 * f64::from(close));
        simulation.move_tool(forceps, pose)?;
        simulation.step()?;
        if frame % 50 == 49 {
            let [jaws, below] =
                [forceps, table].map(|t| simulation.tool_report(t).unwrap().force.z);
            println!("{:.1} s: forceps {jaws:+.4} N, table {below:+.4} N", simulation.time());
        }
    }

    // in the air friction alone carries the piece
    let weight = 9.81 * simulation.masses(piece).iter().sum::<f64>();
    let felt = simulation.tool_report(forceps).ok_or("no forceps")?;
    assert!((felt.force.z / -weight - 1.0).abs() < 1e-2, "{} N of {weight} N", felt.force.z);
    assert_eq!(simulation.tool_report(table).ok_or("no table")?.force, DVec3::ZERO);
    Ok(())
}
