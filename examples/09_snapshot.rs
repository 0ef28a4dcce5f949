//! A state is kept, the simulation goes on, and takes the state up again: the same future, bit for bit.
//!
//! `cargo run --release --example 09_snapshot`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use sinew::snapshot::Snapshot;

/// The same calls give the same simulation, here or in another process.
fn build() -> Result<Simulation, Box<dyn std::error::Error>> {
    let mesh = box_tets(DVec3::new(0.1, 0.02, 0.02), [10, 2, 2])?;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let material = preset("liver")?.material;
    let beam = simulation.add_body(&BodyDescription::new("beam", &mesh, material))?;
    let wall = simulation.group_rows(beam, &mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("wall", wall));
    Ok(simulation)
}

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut simulation = build()?;
    let run =
        |simulation: &mut Simulation, steps: u32| -> Result<u64, Box<dyn std::error::Error>> {
            for _ in 0..steps {
                simulation.step()?;
            }
            // of all displacements and velocities: equal hashes are equal bits
            Ok(simulation.state_hash())
        };
    run(&mut simulation, 20)?;
    let kept = simulation.snapshot()?;
    let future = run(&mut simulation, 30)?;
    println!("at {:.2} s: {future:016x}", simulation.time());

    // back, also over cuts, new materials and tools that came or went
    simulation.restore(&kept)?;
    assert_eq!(run(&mut simulation, 30)?, future);

    // through a file into a simulation built anew
    let bytes = kept.to_bytes();
    let mut other = build()?;
    other.restore(&Snapshot::from_bytes(&bytes)?)?;
    assert_eq!(run(&mut other, 30)?, future);
    println!("the same from {} kB in another simulation", bytes.len() / 1000);

    // an undo of the last steps keeps one state a step
    other.keep_history(10)?;
    run(&mut other, 10)?;
    other.rollback(10)?;
    assert_eq!(other.state_hash(), future);
    Ok(())
}
