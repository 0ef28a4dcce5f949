//! Two blocks of tissue: one lies on a table, the other is dropped on it and comes to rest.
//!
//! `cargo run --release --example 07_two_bodies`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let lower = box_tets(DVec3::new(0.08, 0.08, 0.04), [6, 6, 3])?;
    let upper = box_tets(DVec3::new(0.04, 0.04, 0.03), [4, 4, 3])?;
    // a gap of 2 mm
    let upper = upper.transformed(1.0, DQuat::IDENTITY, DVec3::new(0.02, 0.02, 0.042));
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.4, density: 1050.0 };
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    simulation.set_solver(SolverSettings { mass_damping: 5.0, ..SolverSettings::default() });
    let below = simulation.add_body(&BodyDescription::new("below", &lower, material))?;
    let above = simulation.add_body(&BodyDescription::new("above", &upper, material))?;
    let table = Tool::ground("table", DVec3::ZERO, DVec3::Z).with_friction(0.5);
    let table = simulation.add_tool(table)?;
    // bodies pass through each other until a contact names the pair
    let contact = BodyContact::new("blocks", [below, above]).with_friction(0.3);
    let contact = simulation.add_body_contact(contact);

    for step in 1..=300 {
        simulation.step()?;
        if step % 60 == 0 {
            let report = simulation.body_contact_report(contact).ok_or("no such contact")?;
            let (force, depth) = (-report.force.z, 1e3 * report.depth);
            println!("{:.1} s: {force:.4} N between them, {depth:.3} mm deep", simulation.time());
        }
    }

    let mut weight = |body| 9.81 * simulation.masses(body).iter().sum::<f64>();
    let (light, both) = (weight(above), weight(above) + weight(below));
    let between = -simulation.body_contact_report(contact).ok_or("no such contact")?.force.z;
    let carried = simulation.tool_report(table).ok_or("no table")?.force.z;
    println!("weights: {light:.4} N, {both:.4} N together; the table feels {:.4} N", -carried);
    // at rest the lower block bears the upper one, and the table bears both
    assert!((between / light - 1.0).abs() < 1e-2);
    assert!((-carried / both - 1.0).abs() < 1e-2);
    Ok(())
}
