//! A ball in a hand presses into tissue, and the hand feels a force.
//!
//! `cargo run --release --example 04_touch_and_force`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [10, 10, 5])?;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    // `neo_hookean` gets stiffer when it is pressed; the default, St Venant-Kirchhoff, gets softer
    let body = BodyDescription::new("tissue", &mesh, preset("liver")?.material);
    let body = BodyDescription { model: Model::NeoHookean, ..body };
    let tissue = simulation.add_body(&body)?;
    let bottom = simulation.group_rows(tissue, &mesh, "z0")?;
    let table = simulation.add_constraint(Constraint::hold("table", bottom));
    simulation.set_solver(SolverSettings { mass_damping: 10.0, ..SolverSettings::default() });
    let weight = 9.81 * simulation.masses(tissue).iter().sum::<f64>();

    let above = DVec3::new(0.05, 0.05, 0.07);
    let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, above).with_friction(0.3);
    let ball = simulation.add_tool(ball)?;
    for frame in 1..=300_u32 {
        // read your device here: 10 mm down in 1 s, then still; the ball is there when the step ends
        let down = 1e-4 * f64::from(frame.min(100));
        simulation.move_tool(ball, above - DVec3::Z * down)?;
        simulation.step()?;
        if frame % 25 == 0 && frame <= 100 {
            let felt = simulation.tool_report(ball).ok_or("no such tool")?;
            println!(
                "{:4.1} mm down: {:.3} N, {:.0} mm^2",
                1e3 * down,
                felt.force.z,
                1e6 * felt.area
            );
        }
    }

    // the table bears the tissue and the hand: no force gets lost between tool and table
    let felt = simulation.tool_report(ball).ok_or("no such tool")?.force;
    let carried = simulation.reaction(table).ok_or("no such constraint")?;
    println!("hand {:.4} N + weight {weight:.4} N = table {:.4} N", felt.z, carried.z);
    assert!(felt.z > 0.1 && (felt + DVec3::Z * weight - carried).length() < 1e-3 * carried.z);
    Ok(())
}
