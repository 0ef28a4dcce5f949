//! Haptic devices at a kilohertz beside a simulation at its own rate.
//!
//! The hand holds a patch of a body by a spring that is part of the implicit step ([`Pull`]), so that the point that is held
//! stays free: prescribing it and feeding its reaction back a step later is unstable with light devices. After every step the
//! simulation gives away where the patch is and how it follows the hand at rest, `p = p_n + G (x - x_n)`
//! ([`sinew_solvers::compliance`]). The device feels `f = -K (x - p) - B v` at its own rate with that model, which it
//! moves over to evenly when the next one comes. Steps are taken for where the device will be at their end.
//!
//! A tool in the hand ([`HapticOptions::of_tool`]) hangs on the same spring ([`Tool::spring`]): it is where that and all that it touches
//! are in balance, within the step. The device feels nothing while it touches nothing, and is pushed away by what it touches, never
//! drawn to it.
//!
//! A device that turns, too, has the patch turn with it about its middle ([`HapticOptions::turns`],
//! [`HapticDevice::exchange_pose`]): as if jaws held it. `G` has six directions then, and the device feels a torque.
//!
//! What may go wrong at the hand is met there: an observer adds up the energy that the device has got, and damps when it is
//! more than it has given (Hannaford & Ryu 2002, IEEE Trans. Robotics and Automation 18); force and its first rise are
//! limited; and a simulation that no longer answers lets the force fall to zero.
//!
//! ```
//! use sinew::engine::mesh::generate::box_tets;
//! use sinew::haptics::HapticOptions;
//! use sinew::prelude::*;
//!
//! let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2])?;
//! let mut simulation = Simulation::new(SimulationOptions::default())?;
//! let body = simulation.add_body(&BodyDescription::new("box", &mesh, preset("liver")?.material))?;
//! let floor = simulation.group_rows(body, &mesh, "z0")?;
//! simulation.add_constraint(Constraint::hold("floor", floor));
//! simulation.set_gravity(DVec3::ZERO);
//! // the corners of the upper face are held
//! let top = &mesh.group("z1").unwrap().vertices;
//! let (mut tissue, mut device) = simulation.haptic_handle(HapticOptions::new(body, top.clone()))?;
//! // the device belongs to a thread of its own; here both take turns
//! let mut felt = device.exchange(DVec3::ZERO, DVec3::ZERO, 0.001);
//! for step in 1..=10 {
//!     tissue.step(&mut simulation)?;
//!     for tick in 0..10 {
//!         let lift = 1e-5 * f64::from(10 * (step - 1) + tick);
//!         felt = device.exchange(DVec3::Z * lift, DVec3::Z * 0.01, 0.001);
//!     }
//! }
//! assert!(felt.force.z < -0.01 && felt.energy > 0.0, "{felt:?}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod simulated;

use crate::simulation::{Backend, BodyHandle, Simulation, SimulationError};
use crate::slots::{WordReader, WordWriter, word_slots};
use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec3};
use sinew_contact::pull::{Pull, PullReport};
use sinew_contact::set::ContactSet;
use sinew_contact::tool::{Tool, ToolError, ToolPose, ToolReport};
use sinew_engine::columns::single_table;
use sinew_engine::load::Pose;
use sinew_engine::order::Order;
use sinew_engine::precision::Precision;
use sinew_engine::row::VertexRow;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::Position;
use sinew_solvers::compliance::{self as solvers, PatchCompliance, PatchSolver};
use std::ops::Range;

/// Time (s) in which the force of a model that is too old falls to zero.
const FALL: f64 = 0.05;
/// Rate (N/s) at which the force may rise at the first contact, and when a simulation answers again.
const FIRST_RISE: f64 = 50.0;
/// Part of the push of a model below which what a tool feels along a surface goes down with it.
const FADES: f64 = 0.5;
/// Way (m) of the spring from which a tool that touches is damped in full: below, damping would set in at once.
const FIRM: f64 = 1e-3;

/// How a device holds a patch or tool. The defaults are for soft organs, some 20 to 200 N/m at a tool, and light devices.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticOptions {
    /// Name for errors, and of the [`Pull`] for reports.
    pub name: String,
    /// Body of the patch.
    pub body: BodyHandle,
    /// Vertices of the patch in the user's order. They share the stiffness evenly, each by a spring of its own.
    pub vertices: Vec<u32>,
    /// The tool that it holds in place of a patch: one that follows its targets, which are the device's from then on. The handle
    /// gives it its [spring](Tool::spring). It opens as its target says, and turns with a device that
    /// [turns](Self::turns), whose torque it is not given.
    pub tool: Option<Entity>,
    /// Stiffness `K` (N/m) of the coupling; 300 by default, and at most 1000 for what light devices render stably.
    pub stiffness: f64,
    /// Damping `B` (N s/m) of the motion of the device; 2 by default. Turns are damped as if it were shared out over the patch.
    pub damping: f64,
    /// Largest force (N); 3.3 by default.
    pub limit: f64,
    /// Age (s) of the last step from which the force falls, to zero within another 50 ms; 0.05 by default. It has to be
    /// longer than a step takes.
    pub stale: f64,
    /// Time (s) in which the force goes over from one step's model to the next one's; 0.008 by default.
    pub fade: f64,
    /// Moving mass (kg) of the device, which limits what damping may be added in a cycle; 0.05 by default.
    pub device_mass: f64,
    /// The device turns the patch, too, about the mean of its vertices; not by default. The springs of the vertices then resist turns by
    /// how far they lie from there.
    pub turns: bool,
    /// Largest torque (N m) on a hand that turns; 0.1 by default.
    pub torque_limit: f64,
    /// Moving moment of inertia (kg m^2) of a device that turns, which limits what damping of turns may be added in a cycle; 1e-5 by
    /// default.
    pub device_inertia: f64,
    /// Relative residual of the linear systems of the model; 0.1 by default. The error of `G` goes by its square, and was
    /// below 1 % in all tests.
    pub tolerance: f64,
}

impl HapticOptions {
    /// Defaults for vertices of a body.
    pub fn new(body: BodyHandle, vertices: Vec<u32>) -> Self {
        Self {
            name: "haptic device".into(),
            body,
            vertices,
            tool: None,
            stiffness: 300.0,
            damping: 2.0,
            limit: 3.3,
            stale: 0.05,
            fade: 0.008,
            device_mass: 0.05,
            turns: false,
            torque_limit: 0.1,
            device_inertia: 1e-5,
            tolerance: 0.1,
        }
    }

    /// Defaults for a tool, by what `add_tool` returned.
    pub fn of_tool(tool: Entity) -> Self {
        Self { tool: Some(tool), ..Self::new(BodyHandle(0), Vec::new()) }
    }

    /// What of it cannot be used, if anything; whether there are such a body and such vertices is not looked at.
    pub fn problem(&self) -> Option<String> {
        let positive = [
            ("stiffness", self.stiffness, "N/m"),
            ("limit", self.limit, "N"),
            ("stale", self.stale, "s"),
            ("device_mass", self.device_mass, "kg"),
            ("torque_limit", self.torque_limit, "N m"),
            ("device_inertia", self.device_inertia, "kg m^2"),
        ];
        let not_negative = [("damping", self.damping, "N s/m"), ("fade", self.fade, "s")];
        let wrong = |own: &(&str, f64, &str), zero: bool| {
            let (_, x, _) = own;
            !(x.is_finite() && (*x > 0.0 || zero && *x == 0.0))
        };
        if let Some((name, x, unit)) = positive.iter().find(|own| wrong(own, false)) {
            return Some(format!("{name} is {x} {unit}: it must be positive"));
        }
        if let Some((name, x, unit)) = not_negative.iter().find(|own| wrong(own, true)) {
            return Some(format!("{name} is {x} {unit}: it must be zero or positive"));
        }
        if !(self.tolerance > 0.0 && self.tolerance < 1.0) {
            return Some(format!("tolerance is {}: it must be between 0 and 1", self.tolerance));
        }
        match (self.tool, self.vertices.is_empty()) {
            (None, true) => Some("it holds no vertex: name those of the patch, or a tool".into()),
            (Some(_), false) => Some("it holds vertices and a tool: make it two handles".into()),
            _ => None,
        }
    }
}

/// A handle that cannot be, or a step with one that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HapticError {
    /// An option is unusable.
    #[error("haptic handle `{name}`: {problem}")]
    Invalid {
        /// Handle.
        name: String,
        /// The error, with the value at fault.
        problem: String,
    },
    /// The world has no such body.
    #[error("haptic handle `{name}`: there is no body {body}; use what `add_body` returned")]
    NoBody {
        /// Handle.
        name: String,
        /// Number of the body.
        body: usize,
    },
    /// Pulls are on the processor alone.
    #[error(
        "haptic handle `{0}` on backend = \"gpu\": pulls are computed on the processor; use backend = \"cpu\""
    )]
    Gpu(String),
    /// The pull or tool was taken away, or holds nothing any more.
    #[error("haptic handle `{0}`: what it held by is gone, or acted in no step; make a new handle")]
    Released(String),
    /// A tool that no device can hold.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A vertex of the patch.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The step.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// What is not as it should be with a force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HapticFlags {
    /// No step has answered yet: no force.
    pub waiting: bool,
    /// The last step is too old: the force falls, or is zero.
    pub stale: bool,
    /// Force or torque was cut to its limit.
    pub limited: bool,
    /// The force rises no faster than 50 N/s, a torque by as much of its limit: first contact, or the simulation answers again.
    pub rising: bool,
    /// The device has got more energy than it gave; damping was added.
    pub damped: bool,
    /// A number was not finite, a rotation not of length 1, or time ran backwards: no force.
    pub bad_input: bool,
    /// Nothing supports the body: the model is that of one step from rest, not of rest.
    pub with_inertia: bool,
    /// The tangent was indefinite; the model is that of the projected one.
    pub projected: bool,
    /// The model was not found in this step; `G` is that of an earlier one, or zero.
    pub unsolved: bool,
    /// The step itself did not converge.
    pub unconverged: bool,
}

const WITH_INERTIA: u64 = 1;
const PROJECTED: u64 = 2;
const UNSOLVED: u64 = 4;
const UNCONVERGED: u64 = 8;

/// What a device is to render until the next exchange.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Feedback {
    /// Force (N) on the hand.
    pub force: DVec3,
    /// Torque (N m) on it about where the device is; zero where it does not [turn](HapticOptions::turns) the patch.
    pub torque: DVec3,
    /// Time (s) since the model of the last step arrived.
    pub age: f64,
    /// Steps that had been taken when that model was made, and its simulated time (s).
    pub step: u64,
    /// Simulated time (s) at the end of that step.
    pub time: f64,
    /// Energy (J) that the hand has given so far, by forces and torques held between exchanges; below zero it has got some.
    pub energy: f64,
    /// Exchanges in which damping was added so far.
    pub dampings: u64,
    /// What is not as it should be.
    pub flags: HapticFlags,
}

/// Where a device is, and how it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeviceMotion {
    /// Place (m).
    pub position: DVec3,
    /// Velocity (m/s).
    pub velocity: DVec3,
    /// Orientation, of length 1.
    pub rotation: DQuat,
    /// Angular velocity (rad/s).
    pub angular_velocity: DVec3,
}

impl DeviceMotion {
    /// Every number in a row: place, velocity, orientation (x, y, z, w) and angular velocity.
    fn numbers(&self) -> [f64; POSE_WORDS] {
        let Self { position: x, velocity: v, rotation: q, angular_velocity: w } = *self;
        [x.x, x.y, x.z, v.x, v.y, v.z, q.x, q.y, q.z, q.w, w.x, w.y, w.z]
    }

    fn of(numbers: &mut impl Iterator<Item = f64>) -> Self {
        let [position, velocity] = [(); 2].map(|()| take_vector(numbers));
        let rotation = take_rotation(numbers);
        Self { position, velocity, rotation, angular_velocity: take_vector(numbers) }
    }

    fn is_usable(&self) -> bool {
        self.numbers().iter().all(|x| x.is_finite()) && (self.rotation.length() - 1.0).abs() < 1e-6
    }
}

/// What the simulation found for the device after a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HapticReport {
    /// Way (m) of the hand since it took hold that the step was taken with, and that of the patch or tool at its end.
    pub hand: DVec3,
    /// Turn of the hand since then.
    pub rotation: DQuat,
    /// Way (m) of the weighted mean of the patch.
    pub patch: DVec3,
    /// Force (N) of the coupling on the hand there.
    pub force: DVec3,
    /// Torque (N m) of the coupling on it about where it is; zero where it does not turn the patch.
    pub torque: DVec3,
    /// How the patch follows the hand.
    pub compliance: PatchCompliance,
    /// Unit vector in which tissue pushes a tool away that it does not hold; else zero.
    pub push: DVec3,
    /// The step did not converge.
    pub unconverged: bool,
}

/// What a device holds by.
#[derive(Clone, Copy, Debug)]
enum Held {
    Pull(Entity),
    /// A tool, its pose when it was taken, and the stiffness (N/m) of its spring.
    Tool(Entity, ToolPose, f64),
}

impl Held {
    fn entity(self) -> Entity {
        match self {
            Self::Pull(entity) | Self::Tool(entity, ..) => entity,
        }
    }

    /// Whether a tool hangs on its spring: going back to a state before it was held takes that away.
    fn is_by(self, tool: &Tool) -> bool {
        matches!(self, Self::Tool(_, _, stiffness) if tool.spring == Some(stiffness))
    }
}

#[derive(Debug)]
enum Solver {
    F64(Box<PatchSolver<f64>>),
    F32(Box<PatchSolver<f32>>),
}

/// The end of a handle beside the simulation; see [`Simulation::haptic_handle`].
#[derive(Debug)]
pub struct HapticTissue {
    name: String,
    held: Held,
    tolerance: f64,
    solver: Solver,
    poses: WordReader,
    models: WordWriter,
    turns: bool,
    /// Where the hand is at the end of the coming step; its centre is the middle of the patch when it was taken hold of.
    hand: Pose,
    /// Whether that centre is known.
    has_centre: bool,
    /// The last model.
    last: PatchCompliance,
}

/// Words of a [`DeviceMotion`]. Of a model: step, time, notes, way and turn of the hand, force and torque, stiffness, arms, the
/// direction in which tissue pushes.
const POSE_WORDS: usize = 13;
const MODEL_WORDS: usize = 64;

/// # Haptic devices
impl Simulation {
    /// Lets a haptic device hold a patch of a body, from the next step on, where both are then: the place of the device at its
    /// first exchange is where the patch is when it is taken hold of. The first value stays beside the simulation, the
    /// second one goes to the thread of the device.
    ///
    /// # Errors
    /// When an option, the body, a vertex or the tool cannot be used, or the backend has no pulls.
    pub fn haptic_handle(
        &mut self,
        options: HapticOptions,
    ) -> Result<(HapticTissue, HapticDevice), HapticError> {
        let name = options.name.clone();
        if let Some(problem) = options.problem() {
            return Err(HapticError::Invalid { name, problem });
        }
        if self.backend() == Backend::Gpu {
            return Err(HapticError::Gpu(name));
        }
        if let Some(tool) = options.tool {
            let tool = self.current(tool);
            let with = (self.precision(), self.topology().vertex_count());
            let at = stands(self.world(), tool);
            let missing = || HapticError::Tool(ToolError::NoTool(tool));
            let mut own = self.world_mut().get_mut::<Tool>(tool).ok_or_else(missing)?;
            let at = at.unwrap_or(own.start);
            return Ok(HapticTissue::holding_tool((tool, &mut own), at, options, with)?);
        }
        if options.body.0 >= self.topology().bodies.len() {
            return Err(HapticError::NoBody { name, body: options.body.0 });
        }
        let rows = self.rows(options.body, &name, &options.vertices)?;
        let pull = self.add_pull(Pull::new(&name, rows, options.stiffness, 0.0));
        Ok(HapticTissue::holding(pull, options, self.precision()))
    }
}

impl HapticTissue {
    /// Both ends of a handle in a world of a host, such as a Bevy app: `pull` has a [`Pull`] without damping there, of the name and the
    /// stiffness of the options, whose [`HapticOptions::problem`] is none. [`before_step_in`](Self::before_step_in) and
    /// [`after_step_in`](Self::after_step_in) are for the host to call.
    pub fn holding(
        pull: Entity,
        options: HapticOptions,
        precision: Precision,
    ) -> (Self, HapticDevice) {
        Self::with(Held::Pull(pull), options, precision)
    }

    /// Both ends of a handle of a tool, which gets its [spring](Tool::spring) and is held from where it stands, `at`, in a world of so
    /// many vertex `rows`.
    ///
    /// # Errors
    /// When it cannot be held so; it is unchanged then.
    pub fn holding_tool(
        (entity, tool): (Entity, &mut Tool),
        at: ToolPose,
        options: HapticOptions,
        (precision, rows): (Precision, usize),
    ) -> Result<(Self, HapticDevice), ToolError> {
        if tool.spring.is_some() {
            let problem = "a hand holds it by a spring already: let go of it, or take another tool";
            return Err(ToolError::Invalid { name: tool.name.clone(), problem: problem.into() });
        }
        let mut held = tool.clone();
        held.spring = Some(options.stiffness);
        if let Some(problem) = held.problem(rows) {
            return Err(ToolError::Invalid { name: held.name, problem });
        }
        held.set_target(at)?;
        *tool = held;
        Ok(Self::with(Held::Tool(entity, at, options.stiffness), options, precision))
    }

    fn with(held: Held, options: HapticOptions, precision: Precision) -> (Self, HapticDevice) {
        let solver = match precision {
            Precision::F64 => Solver::F64(Box::default()),
            Precision::F32 => Solver::F32(Box::default()),
        };
        let (to_tissue, poses) = word_slots(POSE_WORDS);
        let (models, to_device) = word_slots(MODEL_WORDS);
        let (name, tolerance) = (options.name.clone(), options.tolerance);
        let (hand, last) = (Pose::IDENTITY, PatchCompliance::default());
        let (turns, is_tool) = (options.turns, options.tool.is_some());
        let has_centre = is_tool || !turns;
        let tissue =
            Self { name, held, tolerance, solver, poses, models, turns, hand, has_centre, last };
        (tissue, HapticDevice::new(options, to_tissue, to_device))
    }

    /// Takes a step for the device: [`before_step`](Self::before_step), the step, [`after_step`](Self::after_step).
    ///
    /// # Errors
    /// When the step fails, or the handle was taken away. The device then hears nothing, and its force falls.
    pub fn step(&mut self, simulation: &mut Simulation) -> Result<HapticReport, HapticError> {
        self.before_step(simulation)?;
        simulation.step()?;
        self.after_step(simulation)
    }

    /// Moves the hand to where the device will be at the end of the step, by its last place and velocity.
    ///
    /// # Errors
    /// When the handle was taken away.
    pub fn before_step(&mut self, simulation: &mut Simulation) -> Result<(), HapticError> {
        self.before_step_in(simulation.world_mut())
    }

    /// The same in a world of a host.
    ///
    /// # Errors
    /// When the handle was taken away.
    pub fn before_step_in(&mut self, world: &mut World) -> Result<(), HapticError> {
        let dt = world.resource::<StepClock>().dt;
        if self.poses.update() {
            let own = DeviceMotion::of(&mut self.poses.words().map(f64::from_bits));
            self.hand.translation = own.position + own.velocity * dt;
            if self.turns {
                let turn = DQuat::from_scaled_axis(own.angular_velocity * dt);
                let turn = if turn.is_finite() { turn } else { DQuat::IDENTITY };
                self.hand.rotation = (turn * own.rotation).normalize();
            }
        }
        let entity = crate::snapshot::current(world, self.held.entity());
        let released = || HapticError::Released(self.name.clone());
        if let Held::Tool(_, start, _) = self.held {
            let tool = world.get_mut::<Tool>(entity).filter(|own| self.held.is_by(own));
            let mut tool = tool.ok_or_else(released)?;
            let opening = tool.target().0.map_or(start.opening, |target| target.opening);
            let position = start.position + self.hand.translation;
            let rotation = (self.hand.rotation * start.rotation).normalize();
            tool.set_target(ToolPose { position, rotation, opening })?;
            let (target, _) = tool.target();
            tool.aim(target, false);
            return Ok(());
        }
        if !self.has_centre {
            self.hand.centre = middle(world, entity).ok_or_else(released)?;
            self.has_centre = true;
        }
        world.get_mut::<Pull>(entity).ok_or_else(released)?.target = self.hand;
        Ok(())
    }

    /// Gives the device the end of the step with the last local model, then with that of this step as soon as it is found.
    ///
    /// # Errors
    /// When the handle was taken away, or acted in no step yet.
    pub fn after_step(&mut self, simulation: &mut Simulation) -> Result<HapticReport, HapticError> {
        self.after_step_in(simulation.columns())
    }

    /// The same in a world of a host.
    ///
    /// # Errors
    /// When the handle was taken away, or acted in no step yet.
    pub fn after_step_in(&mut self, world: &mut World) -> Result<HapticReport, HapticError> {
        let released = || HapticError::Released(self.name.clone());
        let entity = crate::snapshot::current(world, self.held.entity());
        let hand = self.hand.translation;
        let mut report = HapticReport {
            hand,
            rotation: self.hand.rotation,
            compliance: self.last,
            ..HapticReport::default()
        };
        // what is held, and the bodies that the model is of
        let pull = world.get::<Pull>(entity).cloned();
        let (held, group) = match self.held {
            Held::Pull(_) => {
                let own = world.get::<PullReport>(entity).copied().ok_or_else(released)?;
                let pull = pull.as_ref().ok_or_else(released)?;
                report.force = own.force;
                report.torque = if self.turns { own.torque } else { DVec3::ZERO };
                report.unconverged = own.unconverged;
                report.patch = hand + own.force / pull.stiffness;
                let group = acts_on(world, pull).ok_or_else(released)?;
                (solvers::Held::Patch(pull, self.turns), Some(group))
            }
            Held::Tool(_, _, stiffness) => {
                world
                    .get::<Tool>(entity)
                    .filter(|own| self.held.is_by(own))
                    .ok_or_else(released)?;
                let own = world.get::<ToolReport>(entity).ok_or_else(released)?;
                report.force = stiffness * own.yields;
                report.unconverged = own.unconverged;
                report.patch = hand + own.yields;
                let bodies = world.resource::<Topology>().bodies.len();
                let contact = world.get_resource::<ContactSet>().ok_or_else(released)?;
                report.push = contact.push_on(entity).unwrap_or_default();
                (solvers::Held::Tool(entity, stiffness), contact.group_at(entity, bodies))
            }
        };
        let clock = *world.resource::<StepClock>();
        let Some(group) = group else {
            // nothing touches it
            match &mut self.solver {
                Solver::F64(solver) => solver.forget(),
                Solver::F32(solver) => solver.forget(),
            }
            self.last = PatchCompliance::free();
            report.compliance = self.last;
            tell(&mut self.models, &clock, &report);
            return Ok(report);
        };
        if self.last.solved {
            // where the patch is comes in time even beside a body whose model does not
            tell(&mut self.models, &clock, &report);
        }
        self.last = match &mut self.solver {
            Solver::F64(solver) => solver.find(world, held, &group, self.tolerance),
            Solver::F32(solver) => solver.find(world, held, &group, self.tolerance),
        };
        report.compliance = self.last;
        tell(&mut self.models, &clock, &report);
        Ok(report)
    }

    /// The pull by which the device holds the patch, or the tool that it holds.
    pub fn held(&self) -> Entity {
        self.held.entity()
    }

    /// Lets go. The force of the device falls as if the simulation had stopped. A tool stays where it is.
    pub fn release(self, simulation: &mut Simulation) {
        let entity = simulation.current(self.held.entity());
        if let Held::Pull(_) = self.held {
            simulation.remove_contact(entity);
            return;
        }
        // going back may have taken it out of the hand
        if simulation.world().get::<Tool>(entity).is_some_and(|tool| self.held.is_by(tool)) {
            Self::take_off(simulation, entity);
        }
    }

    /// Takes a tool off the [spring](Tool::spring) by which a hand holds it, as [`HapticTissue::let_go`] does; whether it hung on one.
    pub fn take_off(simulation: &mut Simulation, tool: Entity) -> bool {
        let pose = stands(simulation.world(), tool);
        match simulation.world_mut().get_mut::<Tool>(tool) {
            Some(mut tool) if tool.spring.is_some() => {
                Self::let_go(&mut tool, pose);
                true
            }
            _ => false,
        }
    }

    /// A tool that no device holds any more stays where it stands, or has its first place where it acted in no step.
    pub fn let_go(tool: &mut Tool, at: Option<ToolPose>) {
        tool.spring = None;
        let opening = tool.target().0.map(|target| target.opening);
        let at = at.map(|own| ToolPose { opening: opening.unwrap_or(own.opening), ..own });
        tool.aim(at, false);
    }
}

/// Where a tool stands that acted in a step.
fn stands(world: &World, tool: Entity) -> Option<ToolPose> {
    let order = world.get::<Order>(tool).copied()?;
    world.get_resource::<ContactSet>()?.pose_of_tool(order)
}

/// Gives a model to the device.
fn tell(models: &mut WordWriter, clock: &StepClock, report: &HapticReport) {
    let HapticReport { hand, rotation, force, torque, compliance, unconverged, push, .. } = report;
    let note = |on: bool, word: u64| if on { word } else { 0 };
    let notes = note(compliance.with_inertia, WITH_INERTIA)
        | note(compliance.projected, PROJECTED)
        | note(!compliance.solved, UNSOLVED)
        | note(*unconverged, UNCONVERGED);
    models.write(|put| {
        put(clock.step);
        put(clock.time.to_bits());
        put(notes);
        let blocks = compliance.stiffness.as_flattened().iter().chain([&compliance.arms]);
        let numbers = hand.to_array().into_iter().chain(rotation.to_array());
        let numbers = numbers.chain(force.to_array()).chain(torque.to_array());
        let numbers = numbers.chain(blocks.flat_map(DMat3::to_cols_array));
        numbers.chain(push.to_array()).for_each(|x| put(x.to_bits()));
    });
}

/// Weighted mean (m) of the rows of a pull when it took hold, or now where it did not yet.
fn middle(world: &mut World, pull: Entity) -> Option<DVec3> {
    let mut query = world.query::<&Position>();
    let at = single_table(query.contiguous_iter(world))?;
    let pull = world.get::<Pull>(pull)?;
    let all: f64 = pull.weights.iter().sum();
    let place = |(i, row): (usize, &VertexRow)| {
        let now = || at.get(row.index()).map_or(DVec3::ZERO, |x| x.0);
        pull.anchors().get(i).copied().unwrap_or_else(now)
    };
    let places = pull.rows.iter().enumerate().map(place);
    Some(places.zip(&pull.weights).map(|(x, weight)| weight / all * x).sum())
}

/// The bodies that are solved for together with that of a pull; none where it acted in no step.
fn acts_on(world: &World, pull: &Pull) -> Option<Range<usize>> {
    let bodies = &world.resource::<Topology>().bodies;
    let row = pull.rows.first()?.0;
    if pull.anchors().len() != pull.rows.len() {
        return None;
    }
    let body = bodies.iter().position(|body| body.vertices.contains(&row))?;
    let contact = world.get_resource::<ContactSet>()?;
    let group = contact.groups(bodies.len()).into_iter().find(|group| group.contains(&body))?;
    contact.touches(&group).then_some(group)
}

/// Force and torque near a pose of the hand: those there, less stiffness times how far it has moved and turned since.
#[derive(Clone, Copy, Debug, Default)]
struct LocalModel {
    /// Way (m) and turn of the hand.
    hand: DVec3,
    rotation: DQuat,
    /// Force (N) and torque (N m) there.
    wrench: [DVec3; 2],
    stiffness: [[DMat3; 2]; 2],
    /// See [`PatchCompliance::arms`].
    arms: DMat3,
    /// See [`HapticReport::push`].
    push: DVec3,
}

impl LocalModel {
    /// Nothing acts.
    fn is_silent(&self) -> bool {
        self.wrench == [DVec3::ZERO; 2] && self.stiffness == [[DMat3::ZERO; 2]; 2]
    }

    /// Force and torque where the hand is elsewhere. What pushes does not draw: there the tool has left.
    fn at(&self, hand: DVec3, rotation: DQuat) -> [DVec3; 2] {
        let (way, turn) = (hand - self.hand, turned(self.rotation, rotation));
        let [of_force, of_torque] = self.stiffness;
        let [force, torque] = self.wrench;
        let mut force = force - of_force[0] * way - of_force[1] * turn;
        let (pushed, before) = (force.dot(self.push), self.wrench[0].dot(self.push));
        if pushed < 0.0 {
            return [DVec3::ZERO; 2];
        }
        if pushed < FADES * before {
            // what it feels along the surface ends with the pressure
            let along = force - pushed * self.push;
            force -= (1.0 - pushed / (FADES * before)) * along;
        }
        [force, torque - of_torque[0] * way - of_torque[1] * turn]
    }

    /// What lies a part of the way from this to another one, about the pose of that.
    fn towards(&self, to: &Self, part: f64) -> Self {
        let here = self.at(to.hand, to.rotation);
        let left = self.push != DVec3::ZERO && here[0] == DVec3::ZERO;
        let before = if left { [[DMat3::ZERO; 2]; 2] } else { self.stiffness };
        let mix = |a: DMat3, b: DMat3| a * (1.0 - part) + b * part;
        let row = |i: usize| [0, 1].map(|j| mix(before[i][j], to.stiffness[i][j]));
        Self {
            wrench: [0, 1].map(|i| here[i].lerp(to.wrench[i], part)),
            stiffness: [row(0), row(1)],
            arms: mix(self.arms, to.arms),
            // one that touched until now falls off in the old direction
            push: if to.is_silent() { self.push } else { to.push },
            ..*to
        }
    }
}

/// The turn (rad) from one orientation to another, the short way round.
fn turned(from: DQuat, to: DQuat) -> DVec3 {
    let turn = to * from.inverse();
    (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis()
}

/// The end of a handle at the device, for a thread of its own; see [`Simulation::haptic_handle`].
#[derive(Debug)]
pub struct HapticDevice {
    options: HapticOptions,
    poses: WordWriter,
    models: WordReader,
    /// Place (m) and orientation of the device at the first exchange.
    origin: Option<(DVec3, DQuat)>,
    /// Way (m) and turn since then at the last exchange.
    x: DVec3,
    rotation: DQuat,
    /// Models between which the force goes over.
    models_of: [LocalModel; 2],
    rising: bool,
    /// Time (s) for which it still does because a tool came into touch.
    rises: f64,
    /// Notes of the tissue.
    notes: u64,
    /// What was given back last.
    felt: Feedback,
}

impl HapticDevice {
    fn new(options: HapticOptions, poses: WordWriter, models: WordReader) -> Self {
        let felt = Feedback {
            flags: HapticFlags { waiting: true, ..HapticFlags::default() },
            ..Feedback::default()
        };
        Self {
            options,
            poses,
            models,
            origin: None,
            x: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            models_of: [LocalModel::default(); 2],
            rising: true,
            rises: 0.0,
            notes: 0,
            felt,
        }
    }

    /// Tells where the device is (m) and how fast it moves (m/s), and what it is to render until the next exchange. `seconds` is the
    /// time since the last one, during which the last force was held.
    ///
    /// It never waits, takes no lock and asks for no memory. Call it at a kilohertz or so; it costs well below a microsecond. A
    /// device that [turns](HapticOptions::turns) the patch stays as it is turned.
    pub fn exchange(&mut self, position: DVec3, velocity: DVec3, seconds: f64) -> Feedback {
        let rotation =
            self.origin.map_or(DQuat::IDENTITY, |(_, rotation)| self.rotation * rotation);
        let motion = DeviceMotion { position, velocity, rotation, angular_velocity: DVec3::ZERO };
        self.exchange_pose(&motion, seconds)
    }

    /// The same of a device that [turns](HapticOptions::turns) the patch, too: its orientation at the first exchange is where the
    /// patch is not turned.
    pub fn exchange_pose(&mut self, motion: &DeviceMotion, seconds: f64) -> Feedback {
        let mut flags = HapticFlags::default();
        if !(motion.is_usable() && seconds.is_finite() && seconds >= 0.0) {
            flags.bad_input = true;
            self.rising = true;
            (self.felt.force, self.felt.torque) = (DVec3::ZERO, DVec3::ZERO);
            self.felt.flags = flags;
            return self.felt;
        }
        // a driver's numbers are as exact as it has them
        let motion = DeviceMotion { rotation: motion.rotation.normalize(), ..*motion };
        let turns = self.options.turns;
        let (place, turn) = *self.origin.get_or_insert((motion.position, motion.rotation));
        let x = motion.position - place;
        let (rotation, spin) = match turns {
            true => (motion.rotation * turn.inverse(), motion.angular_velocity),
            false => (DQuat::IDENTITY, DVec3::ZERO),
        };
        // what the hand did against the force that was held
        self.felt.energy -= self.felt.force.dot(x - self.x);
        self.felt.energy -= self.felt.torque.dot(turned(self.rotation, rotation));
        (self.x, self.rotation) = (x, rotation);
        let told = DeviceMotion { position: x, rotation, angular_velocity: spin, ..motion };
        self.poses.write(|put| told.numbers().iter().for_each(|x| put(x.to_bits())));
        self.felt.age += seconds;
        self.rises -= seconds;
        let is_new = self.models.update();
        if is_new {
            self.take_model();
        }
        flags.waiting = self.felt.step == 0;
        let none = [DVec3::ZERO; 2];
        let v = motion.velocity;
        let mut wrench = if flags.waiting { none } else { self.coupling(v, spin, seconds) };
        let HapticOptions { device_mass: mass, device_inertia: inertia, .. } = self.options;
        // twice the kinetic energy (J) of the device
        let moving = mass * v.length_squared() + inertia * spin.length_squared();
        if self.felt.energy < 0.0 && moving > 0.0 && seconds > 0.0 && !flags.waiting {
            let rate = (-self.felt.energy / (seconds * moving)).min(1.0 / (4.0 * seconds));
            wrench[0] -= rate * mass * v;
            wrench[1] -= rate * inertia * spin;
            flags.damped = true;
            self.felt.dampings += 1;
        }
        if self.felt.age > self.options.stale && !flags.waiting {
            let left = (1.0 - (self.felt.age - self.options.stale) / FALL).max(0.0);
            wrench = wrench.map(|own| left * own);
            flags.stale = true;
        }
        let limits = [self.options.limit, self.options.torque_limit];
        for (own, limit) in wrench.iter_mut().zip(limits) {
            let length = own.length();
            if length > limit {
                *own *= limit / length;
                flags.limited = true;
            }
        }
        // torque rises by as much of its limit as force does
        let before = [self.felt.force, self.felt.torque];
        let changes = [0, 1].map(|i| wrench[i] - before[i]);
        let rise = |i: usize| changes[i].length() * (limits[0] / limits[i]);
        let (change, most) = (rise(0).max(rise(1)), FIRST_RISE * seconds);
        if flags.stale {
            self.rising = true;
        } else if self.rising && change > most {
            wrench = [0, 1].map(|i| before[i] + changes[i] * (most / change));
            flags.rising = true;
        } else {
            // what a tool has come into touch with is not all felt yet
            self.rising = flags.waiting || self.rises > 0.0;
        }
        if !wrench.iter().all(|own| own.is_finite()) {
            (wrench, self.rising, flags.bad_input) = (none, true, true);
        }
        flags.with_inertia = self.notes & WITH_INERTIA != 0;
        flags.projected = self.notes & PROJECTED != 0;
        flags.unsolved = self.notes & UNSOLVED != 0;
        flags.unconverged = self.notes & UNCONVERGED != 0;
        [self.felt.force, self.felt.torque] = wrench;
        self.felt.flags = flags;
        self.felt
    }

    /// The part of the way (0 to 1) from the last model to the present one.
    fn part(&self) -> f64 {
        let fade = self.options.fade;
        if fade > 0.0 { (self.felt.age / fade).min(1.0) } else { 1.0 }
    }

    /// The model that holds now.
    fn now(&self) -> LocalModel {
        let [before, new] = &self.models_of;
        before.towards(new, self.part())
    }

    /// Reads the model that came, and begins to go over to it.
    fn take_model(&mut self) {
        let before = self.now();
        let is_first = self.felt.step == 0;
        let mut words = self.models.words();
        let mut next = || words.next().unwrap_or(0);
        let (step, time, notes) = (next(), f64::from_bits(next()), next());
        let mut numbers = words.map(f64::from_bits);
        let (hand, rotation) = (take_vector(&mut numbers), take_rotation(&mut numbers));
        let wrench = [(); 2].map(|()| take_vector(&mut numbers));
        let stiffness = [(); 2].map(|()| [(); 2].map(|()| take_matrix(&mut numbers)));
        let arms = take_matrix(&mut numbers);
        let push = take_vector(&mut numbers);
        let new = LocalModel { hand, rotation, wrench, stiffness, arms, push };
        if self.options.tool.is_some() && self.models_of[1].is_silent() && !new.is_silent() {
            (self.rising, self.rises) = (true, self.options.fade);
        }
        self.models_of = [if is_first { new } else { before }, new];
        (self.notes, self.felt.age) = (notes, 0.0);
        (self.felt.step, self.felt.time) = (step, time);
    }

    /// Force (N) and torque (N m) of springs and dampers. Turns are damped by no more than what a cycle of so many `seconds` bears.
    fn coupling(&self, velocity: DVec3, spin: DVec3, seconds: f64) -> [DVec3; 2] {
        let now = self.now();
        let [force, torque] = now.at(self.x, self.rotation);
        let HapticOptions { damping, device_inertia, .. } = self.options;
        // no direction has more
        let most = damping * (now.arms.x_axis.x + now.arms.y_axis.y + now.arms.z_axis.z);
        let part = (device_inertia / (4.0 * seconds * most)).min(1.0);
        let resists = if most > 0.0 { part * damping * (now.arms * spin) } else { DVec3::ZERO };
        if self.options.tool.is_none() {
            return [force - damping * velocity, torque - resists];
        }
        // a tool is damped by what it touches, and sets in with it
        let firm = (force.length() / (self.options.stiffness * FIRM)).min(1.0);
        let damped = force - firm * damping * velocity;
        let drawn = damped.dot(now.push).min(0.0);
        [damped - drawn * now.push, torque]
    }

    /// What was given back last.
    pub fn felt(&self) -> Feedback {
        self.felt
    }
}

fn take_vector(words: &mut impl Iterator<Item = f64>) -> DVec3 {
    DVec3::from_array([(); 3].map(|()| words.next().unwrap_or(0.0)))
}

fn take_rotation(words: &mut impl Iterator<Item = f64>) -> DQuat {
    let [x, y, z, w] = [(); 4].map(|()| words.next().unwrap_or(0.0));
    DQuat::from_xyzw(x, y, z, w)
}

fn take_matrix(words: &mut impl Iterator<Item = f64>) -> DMat3 {
    let [a, b, c] = [(); 3].map(|()| take_vector(words));
    DMat3::from_cols(a, b, c)
}
