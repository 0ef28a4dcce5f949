//! Physics at 100 Hz on a thread of its own, a hand at 1 kHz that reads what lies between two steps.
//!
//! `cargo run --release --example 08_threads_and_rates`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// 100 steps of 10 ms in which a ball is pressed in; `after` gets the time (s) and the force (N) of each. The hash
/// of the last state.
fn press(threads: usize, mut after: impl FnMut(f64, f64)) -> Outcome<u64> {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [8, 8, 4])?;
    let options = SimulationOptions { threads, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options)?;
    let block =
        simulation.add_body(&BodyDescription::new("block", &mesh, preset("liver")?.material))?;
    let bottom = simulation.group_rows(block, &mesh, "z0")?;
    simulation.add_constraint(Constraint::hold("table", bottom));
    let above = DVec3::new(0.05, 0.05, 0.08);
    let ball = simulation.add_tool(Tool::new("ball", Shape::Sphere { radius: 0.03 }, above))?;
    for step in 1..=100 {
        simulation.move_tool(ball, above - DVec3::Z * 1e-4 * f64::from(step))?;
        simulation.step()?;
        after(simulation.time(), simulation.tool_report(ball).ok_or("no ball")?.force.z);
    }
    Ok(simulation.state_hash())
}

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Outcome<()> {
    // time and force of the last two steps: all that the hand needs, so nobody waits for a step
    let last = Arc::new(Mutex::new([(0.0, 0.0); 2]));
    let (shared, begin) = (Arc::clone(&last), Instant::now());
    // one thread beside others that draw and feel
    let physics = spawn(move || {
        press(1, |time, force| {
            let mut last = shared.lock().unwrap_or_else(PoisonError::into_inner);
            *last = [last[1], (time, force)];
            drop(last);
            sleep(Duration::from_secs_f64(time).saturating_sub(begin.elapsed()));
        })
    });
    let (mut readings, mut strongest) = (0, 0.0_f64);
    while !physics.is_finished() {
        let [a, b] = *last.lock().unwrap_or_else(PoisonError::into_inner);
        // a step behind, the hand is between two forces that are known
        let part = (begin.elapsed().as_secs_f64() - b.0) / (b.0 - a.0).max(1e-9);
        strongest = strongest.max(a.1 + part.clamp(0.0, 1.0) * (b.1 - a.1));
        readings += 1;
        sleep(Duration::from_millis(1));
    }
    let hash = physics.join().map_err(|_| "the thread of physics panicked")??;
    println!(
        "{readings} readings in {:.2} s, up to {strongest:.3} N",
        begin.elapsed().as_secs_f64()
    );

    // on two threads and without a clock: the same bits, and the hand never felt more than there was
    let mut forces = Vec::new();
    assert_eq!(press(2, |_, force| forces.push(force))?, hash);
    assert!(strongest > 0.0 && strongest <= forces.into_iter().fold(0.0, f64::max));
    Ok(())
}
