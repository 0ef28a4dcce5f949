//! Sinew inside a Bevy app.

use crate::blade::install_blades;
use crate::tear::install_tears;
use crate::warning::totals;
use bevy_app::{App, FixedPostUpdate, Plugin, PluginGroup, PluginGroupBuilder};
use bevy_ecs::intern::Interned;
use bevy_ecs::message::signal_message_update_system;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use sinew_engine::by_precision;
use sinew_engine::precision::Precision;
use sinew_engine::schedule::{Executor, SimulationSystems};
use sinew_engine::step::{StepError, install_engine};
use sinew_engine::workers::{Threads, Workers, WorkersError};
use sinew_solvers::install_solver;
use std::sync::Arc;

/// Everything that a soft-tissue scene needs, one step per run of the host schedule.
///
/// Bodies are added with [`sinew_models::body::spawn_body`]; each brings the laws it uses into the
/// force schedule. The step length is [`sinew_engine::step::StepClock::dt`] and should equal the
/// period of the host schedule. A step that fails is an error in the log, a [`StepFailed`] message and
/// the resource [`StepOutcome`].
///
/// A tool that a system moves from frame to frame, and positions to draw:
///
/// ```
/// use bevy_app::{App, Update};
/// use bevy_ecs::prelude::*;
/// use sinew::engine::mesh::generate::box_tets;
/// use sinew::engine::schedule::SimulationSystems;
/// use sinew::engine::topology::Topology;
/// use sinew::engine::vertex::Position;
/// use sinew::prelude::*;
///
/// #[derive(Component)]
/// struct Tool;
///
/// fn move_tool(clock: Res<StepClock>, mut tools: Query<&mut Constraint, With<Tool>>) -> Result {
///     for mut tool in &mut tools {
///         let hand = DVec3::new(0.1 * (clock.time + clock.dt), 0.0, 0.0); // from the device
///         tool.set_target(hand)?;
///     }
///     Ok(())
/// }
///
/// let mut app = App::new();
/// app.add_plugins(SinewPlugins::default().in_schedule(Update));
/// app.add_systems(Update, move_tool.in_set(SimulationSystems::Prepare));
///
/// let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2])?;
/// let world = app.world_mut();
/// spawn_body(world, &BodyDescription::new("box", &mesh, preset("liver")?.material))?;
/// let topology = world.resource::<Topology>();
/// let rows = |name: &str| topology.body("box")?.rows(&mesh.group(name)?.vertices);
/// let (wall, held) = (rows("x0").unwrap(), rows("x1").unwrap());
/// world.spawn(Constraint::hold("wall", wall));
/// world.spawn((Constraint::hold("tool", held), Tool));
/// for _ in 0..10 {
///     app.update();
/// }
/// let mut positions = app.world_mut().query::<&Position>();
/// let drawn = positions.iter(app.world()).map(|p| p.0.x);
/// assert!((drawn.fold(0.0, f64::max) - 0.21).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SinewPlugins {
    /// Number type of the state.
    pub precision: Precision,
    /// Threads, and whether they leave cores to the host.
    pub threads: Threads,
    /// Executor of Sinew's own schedules.
    pub executor: Executor,
    /// Host schedule.
    pub schedule: Interned<dyn ScheduleLabel>,
}

impl Default for SinewPlugins {
    fn default() -> Self {
        Self {
            precision: Precision::default(),
            threads: threads_beside_host(),
            executor: Executor::default(),
            schedule: FixedPostUpdate.intern(),
        }
    }
}

/// What leaves a host with threads of its own its share, and the default of [`SinewPlugins`] and of
/// [`SimulationOptions`](crate::simulation::SimulationOptions): one thread less than there are cores, on any of them, asleep when there is nothing to do. Measured in `docs/bevy.md`.
pub fn threads_beside_host() -> Threads {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    Threads { count: cores.saturating_sub(1).max(1), pinned: false, awake: false }
}

impl SinewPlugins {
    /// Steps in another schedule than `FixedPostUpdate`.
    #[must_use]
    pub fn in_schedule(mut self, schedule: impl ScheduleLabel) -> Self {
        self.schedule = schedule.intern();
        self
    }
}

impl PluginGroup for SinewPlugins {
    fn build(self) -> PluginGroupBuilder {
        let Self { precision, threads, executor, schedule } = self;
        PluginGroupBuilder::start::<Self>()
            .add(EnginePlugin { precision, threads, executor })
            .add(SolverPlugin)
            .add(HostPlugin { schedule })
    }
}

/// Schedules, state, constraints, loads and reports.
pub struct EnginePlugin {
    /// Number type of the state.
    pub precision: Precision,
    /// Threads, and whether they leave cores to the host.
    pub threads: Threads,
    /// Executor of Sinew's own schedules.
    pub executor: Executor,
}

impl Plugin for EnginePlugin {
    fn build(&self, app: &mut App) {
        let world = app.world_mut();
        by_precision!(self.precision, install_engine(world, self.executor));
        by_precision!(self.precision, install_blades(world));
        by_precision!(self.precision, install_tears(world));
        match Workers::new(self.threads) {
            Ok(workers) => world.insert_resource(workers),
            Err(error) => world.insert_resource(SetupError(Some(Arc::new(error)))),
        }
    }
}

/// Threads that could not be started: the engine then works on the calling thread. The first step writes it
/// to the log and sends [`ThreadsNotStarted`].
#[derive(Resource, Clone, Debug, Default)]
pub struct SetupError(pub Option<Arc<WorkersError>>);

/// The threads asked for could not be started.
#[derive(Message, Clone, Debug)]
pub struct ThreadsNotStarted(pub Arc<WorkersError>);

/// The integrators; [`sinew_solvers::settings::SolverSettings`] chooses among them. It comes after
/// [`EnginePlugin`], whose [`Precision`] it takes.
pub struct SolverPlugin;

impl Plugin for SolverPlugin {
    fn build(&self, app: &mut App) {
        // without an engine the first step says so
        if let Some(&precision) = app.world().get_resource::<Precision>() {
            by_precision!(precision, install_solver(app.world_mut()));
        }
    }
}

/// Result of the last step in a host app. After an error no further step is carried out until the
/// host has dealt with it and set this back to `None`.
#[derive(Resource, Clone, Debug, Default)]
pub struct StepOutcome(pub Option<StepError>);

/// A step was not carried out; see [`StepOutcome`].
#[derive(Message, Clone, Debug, PartialEq)]
pub struct StepFailed(pub StepError);

/// Runs one step per run of the host schedule, in [`SimulationSystems::Step`].
pub struct HostPlugin {
    /// Host schedule.
    pub schedule: Interned<dyn ScheduleLabel>,
}

impl Plugin for HostPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<StepOutcome>().init_resource::<SetupError>();
        app.add_message::<StepFailed>().add_message::<ThreadsNotStarted>();
        app.configure_sets(
            self.schedule,
            (
                SimulationSystems::First,
                SimulationSystems::Prepare,
                SimulationSystems::Step,
                SimulationSystems::Writeback,
                SimulationSystems::Last,
            )
                .chain()
                // the one system of Bevy's in the fixed schedules
                .ambiguous_with(signal_message_update_system),
        );
        app.add_systems(self.schedule, host_step.in_set(SimulationSystems::Step));
    }
}

/// What the log was told: whether there are threads, and the last failure.
type Told = (bool, Option<String>);

/// One step, unless the last one failed. A failure that repeats is written to the log once.
fn host_step(world: &mut World, mut told: Local<Told>) {
    let (threads, last) = &mut *told;
    // not while plugins are built: the host's logger may be one of those to come
    if !std::mem::replace(threads, true)
        && let Some(error) = world.resource::<SetupError>().0.clone()
    {
        log::error!("{error}; until then steps are made on one thread");
        world.write_message(ThreadsNotStarted(error));
    }
    if world.resource::<StepOutcome>().0.is_some() {
        return;
    }
    let failure = totals::step(world).err();
    let text = failure.as_ref().map(ToString::to_string);
    if let (Some(error), Some(text)) = (&failure, &text) {
        if last.as_ref() != Some(text) {
            log::error!("{text}; no further step is made until `StepOutcome` is `None` again");
        }
        world.write_message(StepFailed(error.clone()));
    }
    *last = text;
    world.resource_mut::<StepOutcome>().0 = failure;
}
