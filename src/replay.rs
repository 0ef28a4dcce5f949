//! Logs of what a program did to a simulation, and doing it again.
//!
//! A log is a text file of JSON lines: the state in which it begins, every input with the number of steps done before it,
//! and hashes of states. Inputs are found by comparing a simulation before a step with what the last step left, so that
//! whatever was done is in the log, by whichever door it came.

use crate::simulation::{BodyHandle, Simulation};
use crate::snapshot::{
    Acting, Snapshot, SnapshotError, acting, apply_acting, restore_snapshot, switch_off,
    take_snapshot,
};
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_contact::pull::Pull;
use sinew_contact::tool::{Tool, ToolPose};
use sinew_engine::by_precision;
use sinew_engine::columns::single_table;
use sinew_engine::law::DisabledLaws;
use sinew_engine::load::{Constraint, Motion, Pose};
use sinew_engine::order::Order;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{Gravity, StepClock, StepError};
use sinew_engine::vertex::{Displacement, Velocity};
use sinew_models::axes::muscle::Muscles;
use sinew_models::body::edit_log::Edit;
use sinew_models::edits::EditState;
use sinew_solvers::explicit::ExplicitScratch;
use sinew_solvers::implicit::ImplicitScratch;
use sinew_solvers::settings::SolverSettings;
use std::fmt::Write as _;
use std::io::{BufRead, Write};
use std::sync::Arc;

/// Number of the format of logs.
const FORMAT: u32 = 1;

/// A log that cannot be read, or that this simulation does not repeat.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// It cannot be read.
    #[error("line {line}: {source}")]
    Io {
        /// Line, counted from 1.
        line: usize,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A line is no line of a log.
    #[error("line {line}: {what}; logs are written by `--record` and not meant to be edited")]
    Line {
        /// Line, counted from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// It begins with a state that does not fit.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// A step failed that was made when the log was written.
    #[error("step {step} was made when the log was written, and now fails: {source}")]
    Step {
        /// Number of the step.
        step: u64,
        /// Why.
        source: Box<StepError>,
    },
    /// The state is another one.
    #[error(
        "after step {step} the state differs from that in the log: body `{body}`{}; the versions, builds or machines \
         are not alike, or somebody changed the scene",
        .vertex.map_or_else(String::new, |v| format!(", first at vertex {v}"))
    )]
    Differs {
        /// Steps done.
        step: u64,
        /// First body that differs.
        body: String,
        /// Its first vertex that differs, in the user's mesh.
        vertex: Option<u32>,
    },
}

/// The first line.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Head {
    sinew_log: u32,
    version: String,
    /// What the program that records wants to know again.
    about: String,
    /// Snapshot, in hexadecimal digits.
    start: String,
}

/// Any other line.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Line {
    /// Steps done.
    step: u64,
    /// An input, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    input: Option<String>,
    /// The input, in hexadecimal digits.
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<String>,
    /// Hash of the state.
    #[serde(skip_serializing_if = "Option::is_none")]
    hash: Option<String>,
    /// Hashes of the vertices of every body, four digits each, in the user's order.
    #[serde(skip_serializing_if = "Option::is_none")]
    vertices: Option<Vec<String>>,
    /// It is the last line.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    end: bool,
}

/// Something done to a simulation between steps.
#[derive(Clone, Debug, Serialize, Deserialize)]
enum Input {
    /// Constraints, tools and the like are others; what is taken away is empty.
    Acting(Box<Acting>),
    /// One of them was only given another target.
    Aim(Order, Aim),
    Settings(Box<SolverSettings>),
    Gravity(Gravity),
    StepLength(f64),
    Disabled(Vec<String>),
    /// Activations asked for.
    Activations(Vec<f64>),
    Edits(Vec<Edit>),
    /// Displacements and velocities of all rows.
    State(Vec<[f64; 3]>, Vec<[f64; 3]>),
    /// Implicit and explicit solvers forgot what they kept.
    Forget([bool; 2]),
    /// The simulation was taken to another state.
    Restore(Vec<u8>),
}

/// Where something is to go.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Aim {
    Tool(Option<ToolPose>, bool),
    Constraint(Pose),
    Pull(Pose),
}

/// What inputs are told from.
#[derive(Clone, Debug, Default)]
struct Known {
    acting: Vec<Acting>,
    settings: Option<SolverSettings>,
    gravity: Gravity,
    clock: StepClock,
    disabled: Vec<&'static str>,
    activations: Vec<f64>,
    edits: Vec<Arc<Edit>>,
    u: Vec<[f64; 3]>,
    v: Vec<[f64; 3]>,
    kept: [bool; 2],
}

/// Writes the log of a simulation.
pub(crate) struct Recorder {
    out: Box<dyn Write + Send>,
    hash_every: u64,
    known: Known,
    failed: Option<std::io::Error>,
}

impl Known {
    fn of<S: Scalar>(world: &mut World) -> Self {
        let mut query = world.query::<(&Displacement<S>, &Velocity<S>)>();
        let columns = single_table(query.contiguous_iter(world));
        let wide = |x: &[S; 4]| [x[0].to_f64(), x[1].to_f64(), x[2].to_f64()];
        let (u, v) = columns.map_or_else(Default::default, |(u, v)| {
            (u.iter().map(|u| wide(&u.0)).collect(), v.iter().map(|v| wide(&v.0)).collect())
        });
        let kept = [
            world.contains_resource::<ImplicitScratch<S>>(),
            world.contains_resource::<ExplicitScratch<S>>(),
        ];
        let muscles = world.get_resource::<Muscles>();
        let activations = muscles.map_or_else(Vec::new, |muscles| {
            muscles.memory().iter().map(|[wanted, _]| *wanted).collect()
        });
        Self {
            u,
            v,
            kept,
            activations,
            acting: acting(world).into_iter().map(|(_, acting)| acting).collect(),
            settings: world.get_resource().cloned(),
            gravity: *world.resource(),
            clock: *world.resource(),
            disabled: world.get_resource::<DisabledLaws>().map_or_else(Vec::new, |d| d.0.clone()),
            edits: EditState::of(world).edits,
        }
    }

    /// What was done since another one, with words for it.
    fn since(&self, before: &Self, world: &mut World) -> Vec<(String, Input)> {
        let mut inputs = Vec::new();
        let mut add = |words: &str, input| inputs.push((words.to_string(), input));
        let clock = StepClock { dt: before.clock.dt, ..self.clock };
        if clock != before.clock {
            let snapshot = take_snapshot(world).map(|snapshot| snapshot.to_bytes());
            add("another state", Input::Restore(snapshot.unwrap_or_default()));
            return inputs;
        }
        if self.edits != before.edits {
            // one that takes the place of the last one before it comes again
            let pairs = self.edits.iter().zip(&before.edits);
            let same = pairs.take_while(|(now, before)| now == before).count();
            let new = self.edits[same..].iter().map(|edit| (**edit).clone()).collect();
            add("bodies are cut or changed", Input::Edits(new));
        }
        if self.settings != before.settings
            && let Some(settings) = &self.settings
        {
            add("settings of the solver", Input::Settings(Box::new(settings.clone())));
        }
        if self.gravity != before.gravity {
            add("gravity", Input::Gravity(self.gravity));
        }
        if self.clock.dt != before.clock.dt {
            add("length of steps", Input::StepLength(self.clock.dt));
        }
        if self.disabled != before.disabled {
            let names = self.disabled.iter().map(|name| (*name).into()).collect();
            add("laws switched off", Input::Disabled(names));
        }
        if self.activations != before.activations {
            add("activations", Input::Activations(self.activations.clone()));
        }
        if self.u != before.u || self.v != before.v {
            add("displacements and velocities", Input::State(self.u.clone(), self.v.clone()));
        }
        let forgot = [0, 1].map(|i| before.kept[i] && !self.kept[i]);
        if forgot != [false; 2] {
            add("solvers forget", Input::Forget(forgot));
        }
        let find = |all: &[Acting], order| all.binary_search_by_key(&order, |own| own.order).ok();
        for old in before.acting.iter().filter(|own| find(&self.acting, own.order).is_none()) {
            let gone = Acting { order: old.order, ..Acting::default() };
            add(&format!("{} is taken away", old.words()), Input::Acting(Box::new(gone)));
        }
        for own in &self.acting {
            let old = find(&before.acting, own.order).map(|at| &before.acting[at]);
            if old == Some(own) {
                continue;
            }
            match old.and_then(|old| own.only_aim(old)) {
                Some(aim) => add(&format!("{} is moved", own.words()), Input::Aim(own.order, aim)),
                None => {
                    add(&format!("{} is set", own.words()), Input::Acting(Box::new(own.clone())))
                }
            }
        }
        inputs
    }
}

impl Acting {
    /// What it is, in words.
    fn words(&self) -> String {
        let names = [
            self.constraint.as_ref().map(|c| ("constraint", &c.name)),
            self.load.as_ref().map(|l| ("load", &l.name)),
            self.pressure.as_ref().map(|p| ("pressure", &p.name)),
            self.tool.as_ref().map(|(t, _)| ("tool", &t.name)),
            self.contact.as_ref().map(|(c, _)| ("contact", &c.name)),
            self.pull.as_ref().map(|(p, _)| ("pull", &p.name)),
            self.thread.as_ref().map(|(t, _)| ("thread", &t.name)),
            self.clip.as_ref().map(|(c, _)| ("clip", &c.name)),
        ];
        let named =
            names.into_iter().flatten().map(|(kind, name)| format!("{kind} `{name}`")).next();
        named.unwrap_or_else(|| match &self.tear {
            Some((tear, _)) => format!("the tear of body {}", tear.body),
            None => format!("entity {}", self.order.0),
        })
    }

    /// The new target, if nothing else is new.
    fn only_aim(&self, old: &Self) -> Option<Aim> {
        let aim = match self {
            Self { tool: Some((tool, _)), .. } => {
                let (target, placed) = tool.target();
                Aim::Tool(target, placed)
            }
            Self { pull: Some((pull, _)), .. } => Aim::Pull(pull.target),
            Self { constraint: Some(constraint), .. } => match &constraint.motion {
                Motion::Follow(path) => Aim::Constraint(path.target()),
                _ => return None,
            },
            _ => return None,
        };
        let mut aimed = old.clone();
        match (&mut aimed, aim) {
            (Self { tool: Some((tool, _)), .. }, Aim::Tool(target, placed)) => {
                tool.aim(target, placed);
            }
            (Self { pull: Some((pull, _)), .. }, Aim::Pull(pose)) => pull.target = pose,
            (Self { constraint: Some(constraint), .. }, Aim::Constraint(pose)) => {
                constraint.set_target(pose).ok()?;
            }
            _ => return None,
        }
        (aimed == *self).then_some(aim)
    }
}

impl Aim {
    fn give(self, world: &mut World, order: Order) -> bool {
        let mut query =
            world
                .query::<(&Order, Option<&mut Tool>, Option<&mut Pull>, Option<&mut Constraint>)>();
        let found = query.iter_mut(world).find(|(of, ..)| **of == order);
        match (self, found) {
            (Self::Tool(target, placed), Some((_, Some(mut tool), ..))) => tool.aim(target, placed),
            (Self::Pull(pose), Some((_, _, Some(mut pull), _))) => pull.target = pose,
            (Self::Constraint(pose), Some((.., Some(mut constraint)))) => {
                return constraint.set_target(pose).is_ok();
            }
            _ => return false,
        }
        true
    }
}

impl Input {
    /// Does it again; why it cannot be done, if so.
    fn apply<S: Scalar>(self, world: &mut World) -> Result<(), String> {
        match self {
            Self::Acting(acting) => apply_acting(world, &acting),
            Self::Aim(order, aim) => {
                if !aim.give(world, order) {
                    return Err("there is nothing that could be moved so".into());
                }
            }
            Self::Settings(settings) => world.insert_resource(*settings),
            Self::Gravity(gravity) => world.insert_resource(gravity),
            Self::StepLength(dt) => world.resource_mut::<StepClock>().dt = dt,
            Self::Disabled(names) => switch_off(world, &names),
            Self::Activations(wanted) => {
                if let Some(mut muscles) = world.get_resource_mut::<Muscles>() {
                    muscles.want(&wanted);
                }
            }
            Self::Edits(edits) => {
                for edit in edits {
                    edit.apply::<S>(world)?;
                }
            }
            Self::State(u, v) => {
                let mut query = world.query::<(&mut Displacement<S>, &mut Velocity<S>)>();
                let columns = single_table(query.contiguous_iter_mut(world));
                let Some((mut to_u, mut to_v)) = columns else { return Ok(()) };
                if (to_u.len(), to_v.len()) != (u.len(), v.len()) {
                    return Err("it has another number of vertices".into());
                }
                let (to_u, to_v) = (&mut *to_u, &mut *to_v);
                let narrow = |x: [f64; 3]| {
                    let [x, y, z] = x.map(S::from_f64);
                    [x, y, z, S::ZERO]
                };
                for row in 0..u.len() {
                    (to_u[row].0, to_v[row].0) = (narrow(u[row]), narrow(v[row]));
                }
            }
            Self::Forget([implicit, explicit]) => {
                if implicit {
                    world.remove_resource::<ImplicitScratch<S>>();
                }
                if explicit {
                    world.remove_resource::<ExplicitScratch<S>>();
                }
            }
            Self::Restore(bytes) => {
                let snapshot = Snapshot::from_bytes(&bytes).map_err(|e| e.to_string())?;
                restore_snapshot(world, &snapshot).map_err(|e| e.to_string())?;
            }
        }
        Ok(())
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

fn from_hexadecimal(text: &str) -> Option<Vec<u8>> {
    let digit = |d: u8| (d as char).to_digit(16).map(|d| d as u8);
    let pairs = text.as_bytes().chunks(2);
    pairs.map(|pair| Some(digit(pair[0])? << 4 | digit(*pair.get(1)?)?)).collect()
}

/// Four digits for every vertex of every body, in the user's order.
fn vertex_marks(simulation: &mut Simulation) -> Vec<String> {
    let bodies = 0..simulation.topology().bodies.len();
    let marks = |body| {
        let body = BodyHandle(body);
        let (u, v) = (simulation.displacements(body), simulation.velocities(body));
        let mut text = String::with_capacity(4 * u.len());
        for (u, v) in u.iter().zip(&v) {
            let numbers = u.to_array().into_iter().chain(v.to_array());
            let mark = numbers.fold(0_u64, |mark, x| {
                let mixed = (mark ^ x.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                mixed ^ (mixed >> 32)
            });
            let _ = write!(text, "{:04x}", mark & 0xffff);
        }
        text
    };
    bodies.map(marks).collect()
}

impl Recorder {
    /// Writes the first line.
    fn begin(
        simulation: &mut Simulation,
        mut out: Box<dyn Write + Send>,
        hash_every: u64,
        about: &str,
    ) -> Result<Self, SnapshotError> {
        let head = Head {
            sinew_log: FORMAT,
            version: env!("CARGO_PKG_VERSION").into(),
            about: about.into(),
            start: hexadecimal(&simulation.snapshot()?.to_bytes()),
        };
        let failed = write_line(&mut out, &head).err();
        let known = by_precision!(simulation.precision(), known(simulation.world_mut()));
        Ok(Self { out, hash_every: hash_every.max(1), known, failed })
    }

    fn line(&mut self, line: &Line) {
        if self.failed.is_none() {
            self.failed = write_line(&mut self.out, line).err();
        }
    }

    /// Writes what was done since the last step.
    pub(crate) fn before_step(&mut self, simulation: &mut Simulation) {
        let precision = simulation.precision();
        let world = simulation.world_mut();
        let now = by_precision!(precision, known(world));
        let step = self.known.clock.step;
        for (words, input) in now.since(&self.known, world) {
            let data = postcard::to_stdvec(&input).ok().map(|bytes| hexadecimal(&bytes));
            self.line(&Line { step, input: Some(words), data, ..Line::default() });
        }
        self.known = now;
    }

    /// Notes what the step left, and writes a hash if one is due.
    pub(crate) fn after_step(&mut self, simulation: &mut Simulation) {
        self.known = by_precision!(simulation.precision(), known(simulation.world_mut()));
        if self.known.clock.step.is_multiple_of(self.hash_every) {
            self.hash(simulation, false);
        }
    }

    fn hash(&mut self, simulation: &mut Simulation, end: bool) {
        let line = Line {
            step: self.known.clock.step,
            hash: Some(format!("{:016x}", simulation.state_hash())),
            vertices: Some(vertex_marks(simulation)),
            end,
            ..Line::default()
        };
        self.line(&line);
    }

    fn finish(mut self, simulation: &mut Simulation) -> std::io::Result<()> {
        self.before_step(simulation);
        self.hash(simulation, true);
        match self.failed.take() {
            Some(error) => Err(error),
            None => self.out.flush(),
        }
    }
}

fn known<S: Scalar>(world: &mut World) -> Known {
    Known::of::<S>(world)
}

fn write_line(out: &mut impl Write, line: &impl Serialize) -> std::io::Result<()> {
    let mut text = serde_json::to_string(line)?;
    text.push('\n');
    out.write_all(text.as_bytes())
}

/// A log, read line by line.
pub struct Replay<R> {
    lines: std::io::Lines<R>,
    number: usize,
    about: String,
    start: Snapshot,
}

/// What a log was found to repeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repeated {
    /// Steps that were made.
    pub steps: u64,
    /// Inputs that were given.
    pub inputs: u64,
    /// Hashes that were compared.
    pub hashes: u64,
    /// Hash of the last state.
    pub hash: u64,
    /// The log has its last line: it was not cut off.
    pub whole: bool,
}

impl<R: BufRead> Replay<R> {
    /// Reads the first line.
    ///
    /// # Errors
    /// When it is not that of a log, or of a newer version.
    pub fn new(input: R) -> Result<Self, ReplayError> {
        let mut lines = input.lines();
        let line = |what: &str| ReplayError::Line { line: 1, what: what.into() };
        let text = match lines.next() {
            None => return Err(line("it is empty")),
            Some(text) => text.map_err(|source| ReplayError::Io { line: 1, source })?,
        };
        let head: Head = serde_json::from_str(&text).map_err(|error| line(&error.to_string()))?;
        if head.sinew_log != FORMAT {
            let Head { sinew_log, version, .. } = head;
            let what = format!("it has format {sinew_log}, written by Sinew {version}");
            return Err(line(&what));
        }
        let start = from_hexadecimal(&head.start).ok_or_else(|| line("its start is damaged"))?;
        let start = Snapshot::from_bytes(&start)?;
        Ok(Self { lines, number: 1, about: head.about, start })
    }

    /// What the program that recorded left for the one that repeats.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// The state in which it begins.
    pub fn start(&self) -> &Snapshot {
        &self.start
    }

    /// Brings a simulation that was built in the same way to the start of the log, does what is in it, and compares
    /// hashes.
    ///
    /// # Errors
    /// At the first line that cannot be done again, and the first hash that differs.
    pub fn run(mut self, simulation: &mut Simulation) -> Result<Repeated, ReplayError> {
        simulation.restore(&self.start)?;
        let mut done = Repeated::default();
        while let Some(text) = self.lines.next() {
            self.number += 1;
            let line = self.number;
            let text = text.map_err(|source| ReplayError::Io { line, source })?;
            let read: Line = match serde_json::from_str(&text) {
                Ok(read) => read,
                // the program that wrote it died
                Err(_) if self.lines.next().is_none() => break,
                Err(error) => return Err(ReplayError::Line { line, what: error.to_string() }),
            };
            while simulation.world().resource::<StepClock>().step < read.step {
                let step = simulation.world().resource::<StepClock>().step;
                simulation
                    .step()
                    .map_err(|source| ReplayError::Step { step, source: Box::new(source) })?;
                done.steps += 1;
            }
            if let Some(data) = &read.data {
                let what = |what: String| ReplayError::Line { line, what };
                let bytes = from_hexadecimal(data);
                let input = bytes.and_then(|bytes| postcard::from_bytes::<Input>(&bytes).ok());
                let input = input.ok_or_else(|| what("its data are damaged".into()))?;
                let precision = simulation.precision();
                let world = simulation.world_mut();
                by_precision!(precision, apply(input, world)).map_err(what)?;
                done.inputs += 1;
            }
            if let Some(hash) = &read.hash {
                done.hash = simulation.state_hash();
                if format!("{:016x}", done.hash) != *hash {
                    return Err(differs(simulation, &read));
                }
                if read.vertices.is_some_and(|marks| marks != vertex_marks(simulation)) {
                    let what = "its hash is that of the state, the marks of its vertices are not: it is damaged";
                    return Err(ReplayError::Line { line, what: what.into() });
                }
                done.hashes += 1;
            }
            done.whole |= read.end;
        }
        Ok(done)
    }
}

fn apply<S: Scalar>(input: Input, world: &mut World) -> Result<(), String> {
    input.apply::<S>(world)
}

/// Where the state differs from that of a line.
fn differs(simulation: &mut Simulation, line: &Line) -> ReplayError {
    let now = vertex_marks(simulation);
    let then = line.vertices.as_deref().unwrap_or_default();
    let body = now.iter().zip(then).position(|(now, then)| now != then);
    let vertex = body.and_then(|body| {
        let pairs = now[body].as_bytes().chunks(4).zip(then[body].as_bytes().chunks(4));
        (0..).zip(pairs).find(|(_, (now, then))| now != then).map(|(vertex, _)| vertex)
    });
    let bodies = &simulation.topology().bodies;
    let body = bodies.get(body.unwrap_or(0)).map_or_else(String::new, |body| body.name.clone());
    ReplayError::Differs { step: line.step, body, vertex }
}

/// # Recording
impl Simulation {
    /// Writes a log of this simulation from now on, with a hash every so many steps; `about` is for the program that
    /// will replay it, such as the path of a scene. Bodies must not be added while it is written.
    ///
    /// ```
    /// use sinew::prelude::*;
    /// use sinew::engine::mesh::generate::box_tets;
    /// use sinew::replay::Replay;
    ///
    /// let build = || -> Result<(Simulation, _), Box<dyn std::error::Error>> {
    ///     let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2])?;
    ///     let mut simulation = Simulation::new(SimulationOptions::default())?;
    ///     let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
    ///     let hand = simulation.group_rows(body, &mesh, "x0")?;
    ///     let hand = simulation.add_constraint(Constraint::hold("hand", hand));
    ///     Ok((simulation, hand))
    /// };
    /// let path = std::env::temp_dir().join(format!("sinew-log-{}.jsonl", std::process::id()));
    /// let (mut simulation, hand) = build()?;
    /// simulation.record(Box::new(std::fs::File::create(&path)?), 5, "the box")?;
    /// for step in 0..10 {
    ///     simulation.set_target(hand, DVec3::Z * 0.001 * f64::from(step))?;
    ///     simulation.step()?;
    /// }
    /// simulation.stop_recording()?;
    /// let replay = Replay::new(std::io::BufReader::new(std::fs::File::open(&path)?))?;
    /// assert_eq!(replay.about(), "the box");
    /// let repeated = replay.run(&mut build()?.0)?;
    /// assert_eq!((repeated.steps, repeated.hashes, repeated.whole), (10, 3, true));
    /// assert_eq!(repeated.hash, simulation.state_hash());
    /// # std::fs::remove_file(&path)?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// With [`Backend::Gpu`](crate::simulation::Backend::Gpu). What goes wrong with writing is told by
    /// [`Simulation::stop_recording`].
    pub fn record(
        &mut self,
        out: Box<dyn Write + Send>,
        hash_every: u64,
        about: &str,
    ) -> Result<(), SnapshotError> {
        let recorder = Recorder::begin(self, out, hash_every, about)?;
        *self.recorder_mut() = Some(recorder);
        Ok(())
    }

    /// Ends the log that is being written, if one is.
    ///
    /// # Errors
    /// When a line could not be written; the log ends before it.
    pub fn stop_recording(&mut self) -> std::io::Result<()> {
        match self.recorder_mut().take() {
            Some(recorder) => recorder.finish(self),
            None => Ok(()),
        }
    }
}
