//! A simulation beside a clock and beside other threads: how many steps are due, and the last states for whoever draws or
//! feels at another rate.
//!
//! ```
//! use sinew::engine::mesh::generate::box_tets;
//! use sinew::live::{SimulationLoop, share};
//! use sinew::prelude::*;
//! use std::time::Duration;
//!
//! let mesh = box_tets(DVec3::splat(0.1), [2, 2, 2])?;
//! let mut simulation = Simulation::new(SimulationOptions::default())?;
//! let cube = simulation.add_body(&BodyDescription::new("cube", &mesh, preset("liver")?.material))?;
//! // 100 steps a second, at most 4 of them at once
//! let mut pace = SimulationLoop::new(Duration::from_millis(10), 4)?;
//! simulation.set_dt(pace.step().as_secs_f64());
//! let (mut writer, mut reader) = share(&mut simulation, &[cube], &[]);
//! // 25 ms have passed since the last picture
//! for _ in 0..pace.due(Duration::from_millis(25)) {
//!     simulation.step()?;
//!     writer.write(&mut simulation);
//!     // on any thread, at any rate
//!     assert!(reader.update());
//! }
//! // half a step is owed, so what is drawn lies halfway between the last two states
//! let halfway = reader.positions_at(0, reader.time() - 0.005);
//! let [before, last] = reader.frames();
//! let middle = before.positions[0][0].midpoint(last.positions[0][0]);
//! assert!(halfway[0].distance(middle) < 1e-12 && before.step == 1);
//! assert_eq!((pace.part(), pace.figures().steps, last.step), (0.5, 2, 2));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::simulation::{BodyHandle, Simulation};
use crate::slots::{WordReader, WordWriter, word_slots};
use bevy_ecs::entity::Entity;
use glam::DVec3;
use sinew_engine::step::StepClock;
use std::time::Duration;

/// A loop that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LoopError {
    /// It would take no step, or steps without end.
    #[error(
        "a loop needs a step longer than nothing and one step at least at once, not steps of {step:?} and {most} of them"
    )]
    NoStep {
        /// Length of a step.
        step: Duration,
        /// Most steps at once.
        most: u32,
    },
}

/// Over the life of a loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoopFigures {
    /// Steps that were due.
    pub steps: u64,
    /// Times that more steps were due than are taken at once.
    pub overruns: u64,
    /// Time that was dropped for that: so much the simulation is behind the clock.
    pub dropped: Duration,
}

/// Keeps a simulation at a fixed rate beside a clock that is read at another one. It steps through no more than some steps at
/// once and drops the time beyond, since a simulation that cannot keep up would never catch up.
#[derive(Clone, Debug)]
pub struct SimulationLoop {
    step: Duration,
    most: u32,
    owed: Duration,
    figures: LoopFigures,
}

impl SimulationLoop {
    /// Steps of this length, at most `most` at once.
    ///
    /// # Errors
    /// When either is zero.
    pub fn new(step: Duration, most: u32) -> Result<Self, LoopError> {
        if step.is_zero() || most == 0 {
            return Err(LoopError::NoStep { step, most });
        }
        Ok(Self { step, most, owed: Duration::ZERO, figures: LoopFigures::default() })
    }

    /// Steps to take now that so much time has passed since the last call.
    pub fn due(&mut self, passed: Duration) -> u32 {
        self.owed += passed;
        let mut due = 0;
        while due < self.most && self.owed >= self.step {
            self.owed -= self.step;
            due += 1;
        }
        if self.owed >= self.step {
            let rest = self.owed.as_nanos() % self.step.as_nanos();
            let rest = Duration::from_nanos_u128(rest);
            self.figures.dropped += self.owed - rest;
            self.figures.overruns += 1;
            self.owed = rest;
        }
        self.figures.steps += u64::from(due);
        due
    }

    /// Length of a step.
    pub fn step(&self) -> Duration {
        self.step
    }

    /// Part of the next step that has passed, below 1.
    pub fn part(&self) -> f64 {
        self.owed.as_secs_f64() / self.step.as_secs_f64()
    }

    /// What has been so far.
    pub fn figures(&self) -> LoopFigures {
        self.figures
    }
}

/// What is shared of one state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Steps that were taken before it.
    pub step: u64,
    /// Simulated time (s).
    pub time: f64,
    /// Positions (m) of the vertices of every shared body, in the order of its mesh.
    pub positions: Vec<Vec<DVec3>>,
    /// Force (N) and torque (N m) on every shared tool, of the step that led here; zero while it is not there.
    pub wrenches: Vec<[DVec3; 2]>,
}

/// Gives states away; see [`share`].
#[derive(Debug)]
pub struct StateWriter {
    words: WordWriter,
    bodies: Vec<BodyHandle>,
    tools: Vec<Entity>,
}

/// Reads the last states on a thread of its own; see [`share`].
#[derive(Debug)]
pub struct StateReader {
    words: WordReader,
    frames: [Frame; 2],
}

/// Shares the state of some bodies and tools with another thread: what the writer wrote last is what the reader reads next,
/// whole, and neither waits for the other or takes a lock. The reader begins with the state as it is.
pub fn share(
    simulation: &mut Simulation,
    bodies: &[BodyHandle],
    tools: &[Entity],
) -> (StateWriter, StateReader) {
    let positions: Vec<_> = bodies.iter().map(|&body| simulation.positions(body)).collect();
    let words = 2 + 3 * positions.iter().map(Vec::len).sum::<usize>() + 6 * tools.len();
    let (writer, reader) = word_slots(words);
    let wrenches = vec![[DVec3::ZERO; 2]; tools.len()];
    let frame = Frame { positions, wrenches, ..Frame::default() };
    let mut writer = StateWriter { words: writer, bodies: bodies.to_vec(), tools: tools.to_vec() };
    let mut reader = StateReader { words: reader, frames: [frame.clone(), frame] };
    writer.write(simulation);
    reader.update();
    reader.frames[0] = reader.frames[1].clone();
    (writer, reader)
}

impl StateWriter {
    /// Writes the state as it is now.
    pub fn write(&mut self, simulation: &mut Simulation) {
        let Self { words, bodies, tools } = self;
        words.write(|put| {
            put(simulation.world().resource::<StepClock>().step);
            put(simulation.time().to_bits());
            for &body in &*bodies {
                let positions = simulation.positions(body);
                positions.iter().flat_map(DVec3::to_array).for_each(|x| put(x.to_bits()));
            }
            for &tool in &*tools {
                let report = simulation.tool_report(tool);
                let wrench = report.map_or([DVec3::ZERO; 2], |own| [own.force, own.torque]);
                wrench.iter().flat_map(DVec3::to_array).for_each(|x| put(x.to_bits()));
            }
        });
    }
}

impl StateReader {
    /// Takes the last state that was written; false where there is no new one.
    pub fn update(&mut self) -> bool {
        if !self.words.update() {
            return false;
        }
        let mut words = self.words.words();
        let mut get = || words.next().unwrap_or(0);
        self.frames.swap(0, 1);
        let frame = &mut self.frames[1];
        (frame.step, frame.time) = (get(), f64::from_bits(get()));
        let all = frame.positions.iter_mut().flatten().chain(frame.wrenches.iter_mut().flatten());
        for x in all {
            *x = DVec3::from_array([(); 3].map(|()| f64::from_bits(get())));
        }
        true
    }

    /// Simulated time (s) of the last state that was taken.
    pub fn time(&self) -> f64 {
        self.frames[1].time
    }

    /// The last two states that were taken, the older first.
    pub fn frames(&self) -> &[Frame; 2] {
        &self.frames
    }

    /// Part of the way from the older to the newer state at a time (s), 0 before and 1 after them.
    fn part(&self, time: f64) -> f64 {
        let [a, b] = &self.frames;
        if b.time > a.time { ((time - a.time) / (b.time - a.time)).clamp(0.0, 1.0) } else { 1.0 }
    }

    /// Positions (m) of a shared body, by its place among these, at a time (s) between the last two states: for a picture a
    /// step late that moves evenly. Empty where there is no such body.
    pub fn positions_at(&self, body: usize, time: f64) -> Vec<DVec3> {
        let part = self.part(time);
        let [a, b] = self.frames.each_ref().map(|own| own.positions.get(body));
        a.into_iter()
            .flatten()
            .zip(b.into_iter().flatten())
            .map(|(a, b)| a.lerp(*b, part))
            .collect()
    }

    /// Force (N) and torque (N m) on a shared tool, by its place among these, at a time (s) between the last two states; zero
    /// where there is no such tool.
    pub fn wrench_at(&self, tool: usize, time: f64) -> [DVec3; 2] {
        let part = self.part(time);
        let [a, b] = self.frames.each_ref().map(|own| own.wrenches.get(tool).copied());
        let (a, b) = (a.unwrap_or_default(), b.unwrap_or_default());
        [a[0].lerp(b[0], part), a[1].lerp(b[1], part)]
    }
}
