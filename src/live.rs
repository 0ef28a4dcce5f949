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
use sinew_engine::row::LocalRow;
use sinew_engine::step::StepClock;
use sinew_engine::surface::SurfaceReader;
use std::collections::HashSet;
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
    ///
    /// Whoever has no time for several takes one of their length ([`Simulation::set_dt`]): implicit steps are stable at any, and tissue
    /// keeps up with the clock.
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
    /// Unit normals of its outside at these vertices: means over the triangles of [`Simulation::outside`], weighted by area. Zero
    /// at vertices that are in none of them.
    pub normals: Vec<Vec<DVec3>>,
    /// Force (N) and torque (N m) on every shared tool, of the step that led here; zero while it is not there.
    pub wrenches: Vec<[DVec3; 2]>,
}

/// What is known of a shared body from one state to the next.
#[derive(Debug)]
struct SharedBody {
    body: BodyHandle,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Revision of the topology and changes of the body that the triangles are of.
    of: Option<(u64, u64)>,
}

/// Gives states away; see [`share`].
#[derive(Debug)]
pub struct StateWriter {
    words: WordWriter,
    bodies: Vec<SharedBody>,
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
///
/// Normals follow removals and cuts. Of a body that was cut they are those of elements that are whole: sides of wounds have
/// points of their own, which are not shared.
pub fn share(
    simulation: &mut Simulation,
    bodies: &[BodyHandle],
    tools: &[Entity],
) -> (StateWriter, StateReader) {
    let shared = |&body: &BodyHandle| {
        let positions = simulation.positions(body);
        let (normals, triangles) = (vec![DVec3::ZERO; positions.len()], Vec::new());
        SharedBody { body, positions, normals, triangles, of: None }
    };
    let bodies: Vec<_> = bodies.iter().map(shared).collect();
    let words = 2 + bodies.iter().map(|own| 6 * own.positions.len()).sum::<usize>();
    let (writer, reader) = word_slots(words + 6 * tools.len());
    let frame = Frame {
        positions: bodies.iter().map(|own| own.positions.clone()).collect(),
        normals: bodies.iter().map(|own| own.normals.clone()).collect(),
        wrenches: vec![[DVec3::ZERO; 2]; tools.len()],
        ..Frame::default()
    };
    let mut writer = StateWriter { words: writer, bodies, tools: tools.to_vec() };
    let mut reader = StateReader { words: reader, frames: [frame.clone(), frame] };
    writer.write(simulation);
    reader.begin();
    (writer, reader)
}

impl SharedBody {
    /// The state as it is now. A mesh that has got more vertices is shared as far as it went.
    fn update(&mut self, simulation: &mut Simulation) {
        let Self { body, positions, normals, triangles, of } = self;
        simulation.each_position(*body, |vertex, x| {
            if let Some(place) = positions.get_mut(vertex) {
                *place = x;
            }
        });
        let topology = simulation.topology();
        let now = Some((topology.revision, topology.bodies[body.0].changes));
        if *of != now {
            (*triangles, *of) = (simulation.outside(*body), now);
            triangles.retain(|t| t.iter().all(|&v| (v as usize) < positions.len()));
        }
        normals.fill(DVec3::ZERO);
        for triangle in &*triangles {
            let corners = triangle.map(|v| v as usize);
            let [a, b, c] = corners.map(|v| positions[v]);
            let area = (b - a).cross(c - a);
            corners.iter().for_each(|&v| normals[v] += area);
        }
        normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
    }
}

impl StateWriter {
    /// Writes the state as it is now.
    pub fn write(&mut self, simulation: &mut Simulation) {
        let Self { words, bodies, tools } = self;
        bodies.iter_mut().for_each(|own| own.update(simulation));
        words.write(|put| {
            put(simulation.world().resource::<StepClock>().step);
            put(simulation.time().to_bits());
            let wrench = |&tool: &Entity| {
                let report = simulation.tool_report(tool);
                report.map_or([DVec3::ZERO; 2], |own| [own.force, own.torque])
            };
            let vectors = bodies.iter().flat_map(|own| own.positions.iter().chain(&own.normals));
            let vectors = vectors.copied().chain(tools.iter().flat_map(wrench));
            vectors.flat_map(|x| x.to_array()).for_each(|x| put(x.to_bits()));
        });
    }

    /// Has vertices of a shared body, by its place among these, that no element ever used be where `points` (m) says. Without
    /// they are at 0.
    pub fn place_unused(&mut self, body: usize, points: &[DVec3]) {
        if let Some(own) = self.bodies.get_mut(body) {
            own.positions.iter_mut().zip(points).for_each(|(to, from)| *to = *from);
        }
    }

    /// Whether the reader is still there.
    pub fn is_read(&self) -> bool {
        self.words.is_read()
    }
}

impl Simulation {
    /// Triangles of the outside of what is left of a body, outward, by vertices of the user's mesh: of its solid elements that
    /// are whole after cuts, then of membranes that do not lie on these, as far as they are whole. Faces of four corners are cut in two.
    pub fn outside(&mut self, body: BodyHandle) -> Vec<[u32; 3]> {
        let world = self.columns();
        let Some(read) = world.get_resource::<SurfaceReader>().copied() else { return Vec::new() };
        let surface = (read.0)(world, body.0);
        let rows = &self.topology().bodies[body.0];
        let user = |t: &[u32; 3]| t.map(|v| rows.vertex_of(LocalRow(v)).0);
        let of_vertices = |t: &&[u32; 3]| t.iter().all(|v| (*v as usize) < rows.row_count());
        let mut triangles: Vec<[u32; 3]> =
            surface.triangles.iter().filter(of_vertices).map(user).collect();
        let sorted = |mut t: [u32; 3]| {
            t.sort_unstable();
            t
        };
        let known: HashSet<[u32; 3]> = triangles.iter().map(|&t| sorted(t)).collect();
        let sheets = surface.sheets.iter().filter(of_vertices).map(user);
        triangles.extend(sheets.filter(|&t| !known.contains(&sorted(t))));
        triangles
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
        let bodies = frame.positions.iter_mut().zip(&mut frame.normals);
        let bodies = bodies.flat_map(|(positions, normals)| positions.iter_mut().chain(normals));
        for x in bodies.chain(frame.wrenches.iter_mut().flatten()) {
            *x = DVec3::from_array([(); 3].map(|()| f64::from_bits(get())));
        }
        true
    }

    /// Takes the state that was written last as both, the older and the newer one: what came before is forgotten.
    pub fn begin(&mut self) {
        self.update();
        let [before, last] = &mut self.frames;
        before.clone_from(last);
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

    /// What `of` finds in the last two states, and what is between it at a time (s).
    fn between<'a>(
        &'a self,
        of: impl Fn(&'a Frame) -> Option<&'a Vec<DVec3>>,
        time: f64,
    ) -> impl Iterator<Item = DVec3> {
        let part = self.part(time);
        let [a, b] = self.frames.each_ref().map(|own| of(own).into_iter().flatten());
        // at the end to the bit, signs of zeros included
        a.zip(b).map(move |(a, b)| if part < 1.0 { a.lerp(*b, part) } else { *b })
    }

    /// Positions (m) of a shared body, by its place among these, at a time (s) between the last two states: for a picture a
    /// step late that moves evenly. From the time of the last one on they are those of it. None where there is no such body.
    pub fn each_position_at(&self, body: usize, time: f64) -> impl Iterator<Item = DVec3> {
        self.between(move |own| own.positions.get(body), time)
    }

    /// [`each_position_at`](Self::each_position_at), in a list.
    pub fn positions_at(&self, body: usize, time: f64) -> Vec<DVec3> {
        self.each_position_at(body, time).collect()
    }

    /// Unit normals likewise; see [`Frame::normals`].
    pub fn each_normal_at(&self, body: usize, time: f64) -> impl Iterator<Item = DVec3> {
        let exact = self.part(time) >= 1.0;
        let normals = self.between(move |own| own.normals.get(body), time);
        normals.map(move |x| if exact { x } else { x.normalize_or_zero() })
    }

    /// [`each_normal_at`](Self::each_normal_at), in a list.
    pub fn normals_at(&self, body: usize, time: f64) -> Vec<DVec3> {
        self.each_normal_at(body, time).collect()
    }

    /// Force (N) and torque (N m) on a shared tool, by its place among these, at a time (s) between the last two states; zero
    /// where there is no such tool.
    pub fn wrench_at(&self, tool: usize, time: f64) -> [DVec3; 2] {
        let part = self.part(time);
        let [a, b] = self.frames.each_ref().map(|own| own.wrenches.get(tool).copied());
        let (a, b) = (a.unwrap_or_default(), b.unwrap_or_default());
        if part < 1.0 { [a[0].lerp(b[0], part), a[1].lerp(b[1], part)] } else { b }
    }
}
