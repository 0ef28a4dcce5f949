//! A block of liver tissue sticks to a table and sags under its own weight.
//!
//! `cargo run --release --example 01_hello_tissue`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    // build: a mesh and a material make a body; all units are SI, so lengths are metres
    let (size, cells) = (DVec3::new(0.1, 0.1, 0.05), [8, 8, 4]);
    let mesh = box_tets(size, cells)?;
    let material = preset("liver")?.material;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let block = simulation.add_body(&BodyDescription::new("block", &mesh, material))?;
    // boxes have a group of vertices on every side; `z0` is the lower one
    let bottom = simulation.group_rows(block, &mesh, "z0")?;
    let table = simulation.add_constraint(Constraint::hold("table", bottom));
    // without damping it would go on swinging
    simulation.set_solver(SolverSettings { mass_damping: 10.0, ..SolverSettings::default() });

    // step: 0.01 s each, unless `set_dt` says otherwise
    for step in 1..=200 {
        simulation.step()?;
        if step % 40 == 0 {
            let top = simulation.positions(block).iter().fold(0.0_f64, |top, x| top.max(x.z));
            println!("{:.1} s: {:.2} mm high", simulation.time(), 1e3 * top);
        }
    }

    // read: forces are those of the last evaluation, so evaluate the state first
    let carried = simulation.reaction(table).ok_or("no such constraint")?.z;
    let weight = 9.81 * material.density * size.x * size.y * size.z;
    println!("the table carries {carried:.4} N of {weight:.4} N");
    // what is at rest is carried; how much is left depends on how long one waits
    assert!((carried / weight - 1.0).abs() < 1e-3);
    assert_eq!(simulation.volume_report().inverted, 0);
    Ok(())
}
