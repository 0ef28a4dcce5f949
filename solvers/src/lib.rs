//! Time integrators and linear solvers of Sinew. They know columns of vertices, sums of forces and tangents, and no
//! law.

mod burst;
pub mod cg;
pub mod cholesky;
pub mod coarse;
pub mod compliance;
#[cfg(feature = "direct")]
pub mod direct;
pub mod explicit;
mod history;
pub mod implicit;
pub mod integrator;
pub mod linear_solver;
pub mod low_rank;
pub mod memory;
mod orphan;
pub mod recovery;
pub mod settings;
pub mod sleep;
pub mod stability;
pub mod state;
pub mod support;
pub mod system;

use bevy_ecs::prelude::*;
use settings::SolverSettings;
use sinew_contact::set::ContactSet;
use sinew_engine::compiled_here;
use sinew_engine::report::{StepReport, SystemTimes};
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::step::{IntegratorInstalled, StepDivider, StepFailure, check_watched};
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, RestPosition};
use sinew_engine::workers::Workers;

/// Installs the integrator; [`SolverSettings`] chooses which.
pub fn install_solver<S: Scalar>(world: &mut World) {
    compiled_here!(S, install(world: &mut World))
}

fn install<S: Scalar>(world: &mut World) {
    ensure::<SolverSettings>(world);
    ensure::<IntegratorInstalled>(world);
    world.insert_resource(StepDivider(divide::<S>));
    sinew_contact::install(world);
    world
        .resource_mut::<Schedules>()
        .entry(StepSchedule)
        .add_systems(integrate::<S>.in_set(StepSystems::Integrate));
}

/// The set of contacts, taken out of a world that has one.
fn contact_of(world: &mut World) -> Option<ContactSet> {
    world.contains_resource::<ContactSet>().then(|| take(world))
}

/// Parts in which the next step is to be made, so that no tool passes through what it meets.
fn divide<S: Scalar>(world: &mut World) -> u32 {
    let explicit =
        world.get_resource::<SolverSettings>().is_some_and(|s| s.integrator.is_explicit());
    if explicit || !world.contains_resource::<ContactSet>() {
        return 1;
    }
    let mut contact = take::<ContactSet>(world);
    let parts = contact.substeps(world, |world| {
        let mut query = world.query::<(&RestPosition, &Displacement<S>)>();
        query.iter(world).map(|(x, u)| x.0 + u.get()).collect()
    });
    put(world, contact);
    parts
}

/// Vertices below which no region is worth two threads.
const SMALL: usize = 500;

/// The one system of [`StepSystems::Integrate`].
fn integrate<S: Scalar>(world: &mut World) {
    if world.resource::<StepFailure>().0.is_some() {
        // an edit before it could not be done
        return;
    }
    let start = Stopwatch::start();
    let mut settings = world.resource::<SolverSettings>().clone();
    settings.recovery &= settings.integrator.recovers();
    let workers = world.resource::<Workers>().clone();
    let vertices = world.resource::<Topology>().vertex_count();
    let mut report = StepReport::default();
    let mut step = || {
        settings.validate().and_then(|()| {
            if settings.integrator.is_explicit() {
                check_watched::<S>(world)?;
                explicit::explicit_step::<S>(world, &settings, &mut report)
            } else {
                implicit::implicit_step::<S>(world, &settings, &mut report)
            }
        })
    };
    // On a thread of the pool the many small regions of a step follow each other without a hand-over;
    // a small body has none, and is spared the one to get there.
    let result = if vertices < SMALL { step() } else { workers.enter(step) };
    world.resource_mut::<StepFailure>().0 = result.err();
    world.insert_resource(report);
    world.resource_mut::<SystemTimes>().add("integrator in all", start.elapsed());
}
