//! Physics at 100 Hz on a thread of its own, a hand at 1 kHz that reads what lies between two steps.
//!
//! `cargo run --release --example 08_threads_and_rates`

use bevy_ecs::entity::Entity;
use sinew::engine::mesh::generate::box_tets;
use sinew::live::share;
use sinew::prelude::*;
use std::sync::mpsc::channel;
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Length of a step (s).
const STEP: f64 = 0.01;

/// 100 steps in which a ball is pressed in; `after` gets the simulation and the ball after each. The hash of the last
/// state.
fn press(threads: usize, mut after: impl FnMut(&mut Simulation, Entity)) -> Outcome<u64> {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [8, 8, 4])?;
    let options = SimulationOptions { threads, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options)?;
    simulation.set_dt(STEP);
    let block =
        simulation.add_body(&BodyDescription::new("block", &mesh, preset("liver")?.material))?;
    let bottom = simulation.group_rows(block, &mesh, "z0")?;
    simulation.add_constraint(Constraint::hold("table", bottom));
    let above = DVec3::new(0.05, 0.05, 0.08);
    let ball = simulation.add_tool(Tool::new("ball", Shape::Sphere { radius: 0.03 }, above))?;
    for step in 1..=100 {
        simulation.move_tool(ball, above - DVec3::Z * 1e-4 * f64::from(step))?;
        simulation.step()?;
        after(&mut simulation, ball);
    }
    Ok(simulation.state_hash())
}

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Outcome<()> {
    // what the hand needs of a state goes to its thread, and nobody waits for a step
    let begin = Instant::now();
    let (give, take) = channel();
    // one thread beside others that draw and feel
    let physics = spawn(move || {
        let mut writer = None;
        press(1, |simulation, ball| {
            let writer = writer.get_or_insert_with(|| {
                let (writer, reader) = share(simulation, &[], &[ball]);
                // a hand that is gone reads nothing
                let _ = give.send(reader);
                writer
            });
            writer.write(simulation);
            let time = Duration::from_secs_f64(simulation.time());
            sleep(time.saturating_sub(begin.elapsed()));
        })
    });
    let mut reader = take.recv()?;
    let (mut readings, mut strongest) = (0, 0.0_f64);
    while !physics.is_finished() {
        reader.update();
        // a step behind, the hand is between two forces that are known
        let [force, _] = reader.wrench_at(0, begin.elapsed().as_secs_f64() - STEP);
        strongest = strongest.max(force.z);
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
    let feel = |simulation: &mut Simulation, ball| {
        forces.extend(simulation.tool_report(ball).map(|report| report.force.z));
    };
    assert_eq!(press(2, feel)?, hash);
    assert!(strongest > 0.0 && strongest <= forces.into_iter().fold(0.0, f64::max));
    Ok(())
}
