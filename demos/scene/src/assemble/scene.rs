//! A scene, built.

use super::body::BuiltBody;
use super::conditions::{BuiltConstraint, BuiltLoad, BuiltPressure};
use super::cuts::BuiltCut;
use super::removal::BuiltResection;
use super::threads::BuiltThread;
use super::touch::{self, BuiltContact, BuiltPull, BuiltTool};
use crate::probe::BuiltProbe;
use crate::scene::Mode;
use crate::warning::Warning;
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::schedule::Executor;
use sinew::models::cutting::CutError;
use sinew::simulation::{Backend, Precision, Simulation};
use sinew::solvers::settings::SolverSettings;
use sinew::warning::{body_warnings, run_warnings};

/// What a caller may set in place of the scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct BuildOptions {
    /// Number type.
    pub precision: Option<Precision>,
    /// Where steps are computed.
    pub backend: Option<Backend>,
    /// Threads; 0 means one per core.
    pub threads: Option<usize>,
    /// Leaves cores to a host that has threads of its own: 0 threads are then one less than there are cores, and none is
    /// pinned or kept awake.
    pub beside_host: bool,
    /// Executor of the schedules.
    pub executor: Option<Executor>,
    /// Instruction set of the kernels.
    pub instruction_set: Option<InstructionSet>,
    /// Steps (load steps of a static scene).
    pub steps: Option<u64>,
}

/// A scene, ready for its first step.
pub struct BuiltScene {
    /// The simulation.
    pub simulation: Simulation,
    /// Bodies in the order of the file.
    pub bodies: Vec<BuiltBody>,
    /// Constraints in the order of the file.
    pub constraints: Vec<BuiltConstraint>,
    /// Loads in the order of the file.
    pub loads: Vec<BuiltLoad>,
    /// Resections in the order of the file.
    pub resections: Vec<BuiltResection>,
    /// Cuts in the order of the file.
    pub cuts: Vec<BuiltCut>,
    /// Pressures in the order of the file.
    pub pressures: Vec<BuiltPressure>,
    /// Tools in the order of the file.
    pub tools: Vec<BuiltTool>,
    /// Pulls in the order of the file.
    pub pulls: Vec<BuiltPull>,
    /// Contacts between bodies in the order of the file.
    pub contacts: Vec<BuiltContact>,
    /// Threads in the order of the file.
    pub strands: Vec<BuiltThread>,
    /// Clips in the order of the file.
    pub clips: Vec<BuiltThread>,
    /// Probes in the order of the file.
    pub probes: Vec<BuiltProbe>,
    /// Steps and intervals.
    pub plan: RunPlan,
    /// What looks unintended in the scene, beside what the simulation has to tell of bodies and steps.
    pub warnings: Vec<Warning>,
}

impl BuiltScene {
    /// What was found and repaired, or looks unintended: in meshes and materials, in the scene, in the steps so far.
    pub fn all_warnings(&self) -> Vec<Warning> {
        let world = self.simulation.world();
        let mut all = body_warnings(world);
        all.extend_from_slice(&self.warnings);
        all.extend(run_warnings(world));
        all
    }

    /// A scene without bodies.
    pub fn empty(simulation: Simulation, plan: RunPlan) -> Self {
        Self {
            simulation,
            bodies: Vec::new(),
            constraints: Vec::new(),
            loads: Vec::new(),
            resections: Vec::new(),
            cuts: Vec::new(),
            pressures: Vec::new(),
            tools: Vec::new(),
            pulls: Vec::new(),
            contacts: Vec::new(),
            strands: Vec::new(),
            clips: Vec::new(),
            probes: Vec::new(),
            plan,
            warnings: Vec::new(),
        }
    }

    /// Elements of all bodies.
    pub fn element_count(&self) -> usize {
        let counts = |body: &BuiltBody| ElementKind::ALL.map(|kind| body.element_count(kind));
        self.bodies.iter().flat_map(counts).sum()
    }

    /// Whether something can touch or pull a body.
    pub fn touches(&self) -> bool {
        let lines = self.strands.len() + self.clips.len();
        lines > 0 || !(self.tools.is_empty() && self.pulls.is_empty() && self.contacts.is_empty())
    }

    /// Moves the hands of pulls and threads, lays and takes out clips and threads, and opens and closes grips, for the step
    /// to come. Whoever steps the simulation of a
    /// scene calls it before every step; tools and constraints move by themselves.
    pub fn drive(&mut self) {
        let lines = self.strands.iter_mut().chain(&mut self.clips);
        touch::drive(&self.tools, &mut self.pulls, lines, &mut self.simulation);
    }

    /// Everything that the scene does before its step number `done` (counted from 1): [`BuiltScene::drive`], the part
    /// of gravity that belongs to a load step, removals and cuts that are due.
    ///
    /// # Errors
    /// When a removal or cut cannot be carried out; earlier ones stay done.
    pub fn prepare_step(&mut self, done: u64) -> Result<(), CutError> {
        self.drive();
        let Self { simulation, plan, resections, cuts, .. } = self;
        if plan.mode == Mode::Static {
            let part = (done as f64 / plan.steps as f64).min(1.0);
            simulation.set_gravity(plan.gravity * part);
        }
        let time = simulation.time();
        resections.iter_mut().try_for_each(|r| r.apply(simulation, time, plan.dt))?;
        cuts.iter_mut().try_for_each(|cut| cut.apply(simulation, time, plan.dt))
    }
}

/// Steps and intervals of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunPlan {
    /// Kind of the scene.
    pub mode: Mode,
    /// Step length (s); of a static scene the fraction of the loads per step.
    pub dt: f64,
    /// Number of steps.
    pub steps: u64,
    /// Steps between frames.
    pub frame_every: u64,
    /// Steps between rows of the probes.
    pub probe_every: u64,
    /// Full gravity (m/s^2).
    pub gravity: DVec3,
    /// Settings of the solver.
    pub settings: SolverSettings,
    /// Threads asked for; 0 means one per core.
    pub threads: usize,
}
