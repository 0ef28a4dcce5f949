//! A simulation behind plain doors: set-up, steps, reports.

use crate::body::Buffers;
use crate::error::{Code, EmbedError, InputError, Result};
use crate::files::Files;
use crate::handle::{Handle, Handles, Kind, Target};
use crate::haptic::{Moment, Serve};
use crate::mesh::vector;
use bevy_ecs::entity::Entity;
use serde::Serialize;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::memory::read_file;
use sinew::engine::precision::Precision;
use sinew::engine::report::{StepReport, VolumeReport};
use sinew::engine::step::StepClock;
use sinew::engine::time::Gravity;
use sinew::engine::workers::Workers;
use sinew::live::StateWriter;
use sinew::simulation::{Backend, BodyHandle, Readback, Simulation, SimulationOptions};
use sinew::solvers::settings::SolverSettings;
pub use sinew_scene::assemble::BuildOptions as Overrides;
use sinew_scene::assemble::{BuiltScene, RunPlan, build};
use sinew_scene::error::{SceneError, hint};
use sinew_scene::picture::Recorder;
use sinew_scene::scene::{LoadedScene, Mode};
use sinew_scene::warning::Warning;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// How a simulation is carried out.
#[derive(Clone, Debug)]
pub struct Options {
    /// Number type of the state.
    pub precision: Precision,
    /// Where steps are computed.
    pub backend: Backend,
    /// Threads; 0 means one less than there are cores. None is pinned to a core or kept awake. Results do not depend on it.
    pub threads: usize,
    /// Instruction set of the kernels; the best of the machine without.
    pub instruction_set: Option<InstructionSet>,
    /// Length of a step (s).
    pub dt: f64,
    /// Gravity (m/s^2).
    pub gravity: [f64; 3],
    /// Solver.
    pub solver: SolverSettings,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            precision: Precision::default(),
            backend: Backend::default(),
            threads: 0,
            instruction_set: None,
            dt: 0.01,
            gravity: [0.0, 0.0, -9.81],
            solver: SolverSettings::default(),
        }
    }
}

/// What the last step did.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Steps done.
    pub step: u64,
    /// Simulated time (s).
    pub time: f64,
    /// Length of the next step (s).
    pub dt: f64,
    /// Figures of the solver; in JSON beside the others.
    #[serde(flatten)]
    pub figures: StepReport,
    /// Volume ratios.
    pub volume: VolumeReport,
    /// Smallest area ratio of membranes, if there are any.
    pub smallest_area_ratio: Option<f64>,
}

/// Energies (J) of the state as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Energy {
    /// Elastic energy.
    pub elastic: f64,
    /// Kinetic energy.
    pub kinetic: f64,
}

/// A simulation, its handles and its buffers. It may be moved to another thread.
///
/// Every function that takes a handle fails when there is no such thing; its document says what else may be wrong.
pub struct Embedding {
    pub(crate) built: BuiltScene,
    scene: Option<String>,
    pub(crate) handles: Handles,
    pub(crate) buffers: Vec<Buffers>,
    /// Counts changes of the state, from 1.
    pub(crate) epoch: u64,
    poisoned: Option<String>,
    /// A recording on its way, and its steps from frame to frame.
    pub(crate) recorder: Option<(Recorder, u64)>,
    /// Haptic handles, each with the handle of its pull.
    pub(crate) haptics: Vec<(Handle, Box<dyn Serve>)>,
    /// For readers on other threads.
    pub(crate) writers: Vec<StateWriter>,
    /// Its own in this process.
    number: u64,
}

/// Numbers of simulations given out by this process.
static NUMBER: AtomicU64 = AtomicU64::new(0);

impl Embedding {
    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    /// A simulation without bodies.
    ///
    /// # Errors
    /// When the machine or the build does not have what is asked for, or a number is out of range.
    pub fn new(options: &Options) -> Result<Self> {
        positive_step(options.dt)?;
        let gravity = vector("gravity", options.gravity)?;
        options.solver.validate()?;
        let mut simulation = Simulation::new(SimulationOptions {
            precision: options.precision,
            threads: options.threads,
            instruction_set: options.instruction_set,
            backend: options.backend,
            readback: Readback::OnDemand,
            ..SimulationOptions::default()
        })?;
        simulation.set_dt(options.dt);
        simulation.set_gravity(gravity);
        simulation.set_solver(options.solver.clone());
        let plan = RunPlan {
            mode: Mode::Dynamic,
            dt: options.dt,
            steps: 0,
            frame_every: 1,
            probe_every: 1,
            gravity,
            settings: options.solver.clone(),
            threads: options.threads,
        };
        Ok(Self::of(BuiltScene::empty(simulation, plan), None))
    }

    /// The simulation of a scene, from its text; `name` stands for its file in messages. Files that it names are asked of
    /// `files`.
    ///
    /// # Errors
    /// [`Code::Scene`] with line, key and remedy.
    pub fn from_scene(
        toml: &str,
        name: &str,
        files: impl Files + 'static,
        overrides: &Overrides,
    ) -> Result<Self> {
        // without a folder, so that `files` is asked for what the scene says
        let file = Path::new(name).file_name().unwrap_or(name.as_ref());
        let loaded = LoadedScene::parse(toml, file.as_ref())?
            .with_files(move |path| files.read(&path.to_string_lossy()));
        Self::of_scene(&loaded, overrides)
    }

    /// The simulation of a scene file; files that it names are looked for beside it.
    ///
    /// # Errors
    /// As [`Embedding::from_scene`]; [`Code::Io`] when it cannot be read.
    pub fn from_scene_file(path: &str, overrides: &Overrides) -> Result<Self> {
        let path = Path::new(path);
        let io = |source| SceneError::Io { path: path.into(), source };
        let bytes = read_file(path).map_err(io)?;
        let text = String::from_utf8(bytes)
            .map_err(|error| io(std::io::Error::new(std::io::ErrorKind::InvalidData, error)))?;
        Self::of_scene(&LoadedScene::parse(&text, path)?, overrides)
    }

    fn of_scene(loaded: &LoadedScene, overrides: &Overrides) -> Result<Self> {
        let beside = Overrides { beside_host: true, ..*overrides };
        Ok(Self::of(build(loaded, &beside)?, Some(loaded.scene.name.clone())))
    }

    fn of(built: BuiltScene, scene: Option<String>) -> Self {
        let mut handles = Handles::default();
        let mut buffers = Vec::new();
        for body in &built.bodies {
            handles.add(Kind::Body, &body.name, Target::Body(body.handle.0));
            buffers.push(Buffers::default());
        }
        let mut entities = |kind: Kind, of: Vec<(&String, Entity)>| {
            for (name, entity) in of {
                handles.add(kind, name, Target::Entity(entity));
            }
        };
        let named = |kind: Kind| -> Vec<(&String, Entity)> {
            match kind {
                Kind::Constraint => built.constraints.iter().map(|c| (&c.name, c.entity)).collect(),
                Kind::Load => built.loads.iter().map(|l| (&l.summary.name, l.entity)).collect(),
                Kind::Pressure => {
                    built.pressures.iter().map(|p| (&p.summary.name, p.entity)).collect()
                }
                Kind::Tool => built.tools.iter().map(|t| (&t.name, t.entity)).collect(),
                Kind::Contact => built.contacts.iter().map(|c| (&c.name, c.entity)).collect(),
                Kind::Body | Kind::Pull | Kind::Thread | Kind::Clip => Vec::new(),
            }
        };
        Kind::ALL.into_iter().for_each(|kind| entities(kind, named(kind)));
        let mut of_scene = |kind: Kind, names: Vec<&String>| {
            for (i, name) in names.into_iter().enumerate() {
                handles.add(kind, name, Target::Scene(i));
            }
        };
        of_scene(Kind::Pull, built.pulls.iter().map(|own| &own.name).collect());
        of_scene(Kind::Thread, built.strands.iter().map(|own| &own.name).collect());
        of_scene(Kind::Clip, built.clips.iter().map(|own| &own.name).collect());
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        Self {
            built,
            scene,
            handles,
            buffers,
            epoch: 1,
            poisoned: None,
            recorder: None,
            haptics: Vec::new(),
            writers: Vec::new(),
            number,
        }
    }

    /// Says that the simulation cannot be used any more, because something panicked in it; every later [`Embedding::check`]
    /// tells so. The skin calls it that catches the panic.
    pub fn poison(&mut self, text: impl Into<String>) {
        self.poisoned = Some(text.into());
    }

    /// Whether it can be used.
    pub fn is_poisoned(&self) -> bool {
        self.poisoned.is_some()
    }

    /// What a skin asks before every call.
    ///
    /// # Errors
    /// [`Code::Panic`] after [`Embedding::poison`].
    pub fn check(&self) -> Result<()> {
        match &self.poisoned {
            None => Ok(()),
            Some(text) => Err(EmbedError::new(
                Code::Panic,
                format!("the simulation cannot be used any more after a panic: {text}"),
            )),
        }
    }

    /// Carries out `n` steps with everything that the scene does between them, up to the first that fails. After each, haptic
    /// devices and readers on other threads get what is new.
    ///
    /// # Errors
    /// [`Code::Step`] when a step cannot be carried out; the state is then that before it.
    pub fn step(&mut self, n: u32) -> Result<()> {
        for _ in 0..n {
            self.epoch += 1;
            if self.scene.is_some() {
                let done = self.clock().step + 1;
                let prepared = self.built.prepare_step(done);
                prepared.map_err(|e| EmbedError::new(Code::Step, e.to_string()))?;
            }
            self.serve_haptics(Moment::Before)?;
            self.built.simulation.step()?;
            self.serve_haptics(Moment::After)?;
            self.publish();
            self.recorded();
        }
        Ok(())
    }

    fn clock(&self) -> &StepClock {
        self.built.simulation.world().resource()
    }

    /// Simulated time (s).
    pub fn time(&self) -> f64 {
        self.clock().time
    }

    /// Length of the next step (s).
    pub fn dt(&self) -> f64 {
        self.clock().dt
    }

    /// Steps done.
    pub fn steps_done(&self) -> u64 {
        self.clock().step
    }

    /// A number that changes with every change of the state: what skins keep copies by.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Steps that the scene asks for; `None` without a scene.
    pub fn steps_planned(&self) -> Option<u64> {
        self.scene.as_ref().map(|_| self.built.plan.steps)
    }

    /// Whether the scene asks for equilibria, load step by load step, in place of motion.
    pub fn is_static(&self) -> bool {
        self.built.plan.mode == Mode::Static
    }

    /// Name of the scene, if it comes from one.
    pub fn scene_name(&self) -> Option<&str> {
        self.scene.as_deref()
    }

    /// What was found in meshes, materials and the scene, and looks unintended or was repaired; then what was not as it
    /// should be in the steps that led to the present state.
    pub fn warnings(&self) -> Vec<Warning> {
        self.built.all_warnings()
    }

    /// The same as JSON.
    pub fn warnings_json(&self) -> String {
        serde_json::to_string(&self.warnings()).unwrap_or_default()
    }

    /// Why the present state cannot be trusted, if so, as far as the steps that led to it tell: the reason for which the
    /// command fails.
    pub fn verdict(&self) -> Option<String> {
        self.built.simulation.verdict().err().map(|untrusted| untrusted.to_string())
    }

    /// Sets the length (s) of the steps to come.
    ///
    /// # Errors
    /// When it is not positive and finite.
    pub fn set_dt(&mut self, dt: f64) -> Result<()> {
        positive_step(dt)?;
        self.built.plan.dt = dt;
        self.built.simulation.set_dt(dt);
        Ok(())
    }

    /// Gravity (m/s^2); of a static scene the whole, whatever part has been applied.
    pub fn gravity(&self) -> [f64; 3] {
        match self.is_static() {
            true => self.built.plan.gravity.to_array(),
            false => self.built.simulation.world().resource::<Gravity>().0.to_array(),
        }
    }

    /// Sets gravity (m/s^2) from the next step on.
    ///
    /// # Errors
    /// When it is not finite.
    pub fn set_gravity(&mut self, gravity: [f64; 3]) -> Result<()> {
        let gravity = vector("gravity", gravity)?;
        self.built.plan.gravity = gravity;
        self.built.simulation.set_gravity(gravity);
        Ok(())
    }

    /// Settings of the solver.
    pub fn solver(&self) -> &SolverSettings {
        &self.built.plan.settings
    }

    /// Sets them from the next step on.
    ///
    /// # Errors
    /// When one is out of range.
    pub fn set_solver(&mut self, settings: SolverSettings) -> Result<()> {
        settings.validate()?;
        self.built.plan.settings = settings.clone();
        self.built.simulation.set_solver(settings);
        Ok(())
    }

    /// Number type of the state.
    pub fn precision(&self) -> Precision {
        self.built.simulation.precision()
    }

    /// Where steps are computed.
    pub fn backend(&self) -> Backend {
        self.built.simulation.backend()
    }

    fn workers(&self) -> &Workers {
        self.built.simulation.world().resource()
    }

    /// Runs something on a thread of the pool.
    pub fn on_pool<R: Send>(&self, f: impl FnOnce() -> R + Send) -> R {
        self.workers().enter(f)
    }

    /// Threads.
    pub fn threads(&self) -> usize {
        self.workers().threads()
    }

    /// Instruction set of the kernels.
    pub fn instruction_set(&self) -> InstructionSet {
        self.workers().instruction_set()
    }

    /// Hash of the state: that of the command and of [`Simulation::state_hash`].
    pub fn hash(&mut self) -> u64 {
        self.built.simulation.state_hash()
    }

    /// What the last step did.
    pub fn report(&self) -> Report {
        let (simulation, StepClock { step, time, dt }) = (&self.built.simulation, *self.clock());
        let area = simulation.area_report().smallest_ratio;
        Report {
            step,
            time,
            dt,
            figures: simulation.report().clone(),
            volume: simulation.volume_report().clone(),
            smallest_area_ratio: area.is_finite().then_some(area),
        }
    }

    /// The same as JSON; numbers that are not finite are `null`.
    pub fn report_json(&self) -> String {
        serde_json::to_string(&self.report()).unwrap_or_default()
    }

    /// Energies (J) of the state as it is.
    pub fn energy(&mut self) -> Energy {
        let elastic = self.built.simulation.evaluate();
        let simulation = &mut self.built.simulation;
        let mut kinetic = 0.0;
        for body in self.built.bodies.iter().map(|body| body.handle) {
            let masses = simulation.masses(body);
            simulation.each_velocity(body, |vertex, v| {
                kinetic += 0.5 * masses[vertex] * v.length_squared();
            });
        }
        Energy { elastic, kinetic }
    }

    /// The simulation, for what has no door here.
    pub fn simulation(&self) -> &Simulation {
        &self.built.simulation
    }

    /// The simulation, writable; buffers are read anew afterwards.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        self.epoch += 1;
        &mut self.built.simulation
    }

    /// What has this name.
    ///
    /// # Errors
    /// When nothing of this kind has it.
    pub fn find(&self, kind: Kind, name: &str) -> Result<Handle> {
        let list = self.handles.list(kind);
        if let Some((handle, _)) = list.iter().find(|(_, own)| *own == name) {
            return Ok(*handle);
        }
        let hint = hint(kind.name(), name, list.iter().map(|(_, name)| *name));
        Err(InputError::Unknown { kind: kind.name(), name: name.into(), hint }.into())
    }

    /// All of a kind in the order in which they were made, with their names.
    pub fn list(&self, kind: Kind) -> Vec<(Handle, String)> {
        let own = self.handles.list(kind).into_iter();
        own.map(|(handle, name)| (handle, name.to_string())).collect()
    }

    /// Name of what a handle stands for.
    ///
    /// # Errors
    /// When it stands for nothing.
    pub fn name(&self, handle: Handle) -> Result<String> {
        Ok(self.handles.any(handle)?.1.to_string())
    }

    /// Takes a body, constraint, load, pressure, tool, pull, contact, thread or clip away; its handle stands for nothing afterwards. With a
    /// body goes what acts on nothing else ([`Simulation::remove_body`]).
    ///
    /// # Errors
    /// When there is no such thing.
    pub fn remove(&mut self, handle: Handle) -> Result<()> {
        let (kind, _, target) = self.handles.any(handle)?;
        let BuiltScene { simulation, tools, pulls, strands, clips, .. } = &mut self.built;
        match (kind, target) {
            (
                Kind::Tool | Kind::Pull | Kind::Contact | Kind::Thread | Kind::Clip,
                Target::Entity(entity),
            ) => {
                tools.retain(|tool| tool.entity != entity);
                simulation.remove_contact(entity);
            }
            (_, Target::Entity(entity)) => {
                simulation.remove_load_or_constraint(entity);
            }
            (_, Target::Scene(index)) => {
                // it stays in its place, where it does nothing any more
                let (entity, until) = match kind {
                    Kind::Thread => (strands[index].entity(), &mut strands[index].until),
                    Kind::Clip => (clips[index].entity(), &mut clips[index].until),
                    _ => (pulls[index].entity(), &mut pulls[index].until),
                };
                *until = f64::NEG_INFINITY;
                if let Some(entity) = entity {
                    simulation.remove_contact(entity);
                }
            }
            (_, Target::Body(body)) => {
                simulation.remove_body(BodyHandle(body))?;
                let world = simulation.world();
                self.handles.retain(|entity| {
                    world.get_entity(sinew::snapshot::current(world, entity)).is_ok()
                });
            }
        }
        self.handles.remove(handle)?;
        self.haptics.retain(|(own, _)| *own != handle);
        self.epoch += 1;
        Ok(())
    }

    /// Adds a handle under a name that nothing of its kind has.
    pub(crate) fn name_is_free(&self, kind: Kind, name: &str) -> Result<()> {
        let kind_name = kind.name();
        if name.trim().is_empty() {
            return Err(InputError::invalid(kind_name, "the name is empty; give it a name").into());
        }
        match self.handles.list(kind).iter().any(|(_, own)| *own == name) {
            true => Err(InputError::Duplicate { kind: kind_name, name: name.into() }.into()),
            false => Ok(()),
        }
    }

    /// Entity of a handle of a kind.
    pub(crate) fn entity(&self, handle: Handle, kind: Kind) -> Result<Option<Entity>> {
        Ok(match self.handles.get(handle, kind)? {
            Target::Entity(entity) => Some(entity),
            Target::Scene(index) => match kind {
                Kind::Thread => self.built.strands[index].entity(),
                Kind::Clip => self.built.clips[index].entity(),
                _ => self.built.pulls[index].entity(),
            },
            Target::Body(_) => None,
        })
    }
}

/// Refuses step lengths that no step can have.
fn positive_step(dt: f64) -> Result<()> {
    match dt > 0.0 && dt.is_finite() {
        true => Ok(()),
        false => Err(sinew::engine::step::StepError::InvalidStep { dt })
            .map_err(|error| EmbedError { code: Code::Argument, ..error.into() }),
    }
}
