//! Sinew inside a Bevy app.

use crate::simulation::Precision;
use bevy_app::{App, FixedUpdate, Plugin, PluginGroup, PluginGroupBuilder};
use bevy_ecs::intern::Interned;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use sinew_engine::schedule::{Executor, SimulationSystems};
use sinew_engine::step::{StepError, install_engine, run_step};
use sinew_engine::workers::{Workers, WorkersError};
use sinew_solvers::install_solver;

/// Everything that a soft-tissue scene needs, one step per run of the host schedule.
///
/// Bodies are added with [`sinew_models::body::spawn_body`]; each brings the laws it uses into the
/// force schedule. The step length is [`sinew_engine::step::StepClock::dt`] and should equal the
/// period of the host schedule.
///
/// ```
/// use bevy_app::{App, Update};
/// use sinew::SinewPlugins;
/// use sinew::engine::step::StepClock;
///
/// let mut app = App::new();
/// app.add_plugins(SinewPlugins::default().in_schedule(Update));
/// app.update();
/// assert_eq!(app.world().resource::<StepClock>().step, 1);
/// ```
pub struct SinewPlugins {
    /// Number type of the state.
    pub precision: Precision,
    /// Threads; 0 means one per core.
    pub threads: usize,
    /// Executor of Sinew's own schedules.
    pub executor: Executor,
    /// Host schedule.
    pub schedule: Interned<dyn ScheduleLabel>,
}

impl Default for SinewPlugins {
    fn default() -> Self {
        Self {
            precision: Precision::default(),
            threads: 0,
            executor: Executor::default(),
            schedule: FixedUpdate.intern(),
        }
    }
}

impl SinewPlugins {
    /// Steps in another schedule than `FixedUpdate`.
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
            .add(SolverPlugin { precision })
            .add(HostPlugin { precision, schedule })
    }
}

/// Schedules, state, constraints, loads and reports.
pub struct EnginePlugin {
    /// Number type of the state.
    pub precision: Precision,
    /// Threads; 0 means one per core.
    pub threads: usize,
    /// Executor of Sinew's own schedules.
    pub executor: Executor,
}

impl Plugin for EnginePlugin {
    fn build(&self, app: &mut App) {
        let world = app.world_mut();
        match self.precision {
            Precision::F64 => install_engine::<f64>(world, self.executor),
            Precision::F32 => install_engine::<f32>(world, self.executor),
        }
        world.insert_resource(self.precision);
        world.init_resource::<SetupError>();
        match Workers::new(self.threads) {
            Ok(workers) => world.insert_resource(workers),
            Err(error) => world.resource_mut::<SetupError>().0 = Some(error),
        }
    }
}

/// Threads that could not be started: the engine then works on the calling thread.
#[derive(Resource, Debug, Default)]
pub struct SetupError(pub Option<WorkersError>);

/// The integrators; [`sinew_solvers::settings::SolverSettings`] chooses among them.
pub struct SolverPlugin {
    /// Number type of the state.
    pub precision: Precision,
}

impl Plugin for SolverPlugin {
    fn build(&self, app: &mut App) {
        match self.precision {
            Precision::F64 => install_solver::<f64>(app.world_mut()),
            Precision::F32 => install_solver::<f32>(app.world_mut()),
        }
    }
}

/// Result of the last step in a host app. After an error no further step is carried out until the
/// host has dealt with it and set this back to `None`.
#[derive(Resource, Clone, Debug, Default)]
pub struct StepOutcome(pub Option<StepError>);

/// Runs one step per run of the host schedule, in [`SimulationSystems::Step`].
pub struct HostPlugin {
    /// Number type of the state.
    pub precision: Precision,
    /// Host schedule.
    pub schedule: Interned<dyn ScheduleLabel>,
}

impl Plugin for HostPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<StepOutcome>();
        app.configure_sets(
            self.schedule,
            (SimulationSystems::Prepare, SimulationSystems::Step, SimulationSystems::Writeback)
                .chain(),
        );
        match self.precision {
            Precision::F64 => {
                app.add_systems(self.schedule, host_step::<f64>.in_set(SimulationSystems::Step))
            }
            Precision::F32 => {
                app.add_systems(self.schedule, host_step::<f32>.in_set(SimulationSystems::Step))
            }
        };
    }
}

fn host_step<S: sinew_engine::scalar::Scalar>(world: &mut World) {
    if world.resource::<StepOutcome>().0.is_none() {
        let result = run_step::<S>(world);
        world.resource_mut::<StepOutcome>().0 = result.err();
    }
}
