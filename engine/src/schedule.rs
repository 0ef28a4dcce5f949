//! Sets and schedules. A step is [`StepSchedule`]; the force evaluation is a schedule of its own,
//! [`ForceSchedule`], so that a solver can run it again at trial states.

use crate::columns::single_table;
use crate::law::{
    BodiesWithoutRecovery, ElasticEnergy, EvaluationRequest, Law, LawBuffer, RecoveringBodies,
};
use crate::matrix::Tangent;
use crate::precision::Precision;
use crate::report::SystemTimes;
use crate::scalar::Scalar;
use crate::topology::Topology;
use crate::vertex::ElasticForce;
use crate::workers::Workers;
use bevy_ecs::change_detection::{ContiguousRef, Tick};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{
    LogLevel, MultiThreadedExecutor, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor,
};
use bytemuck::TransparentWrapper;
use std::time::Instant;

/// Where Sinew runs inside a host schedule (a Bevy app's `FixedUpdate`, for example).
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum SimulationSystems {
    /// The host's systems that change loads, constraints or settings go here.
    Prepare,
    /// One run of [`StepSchedule`].
    Step,
    /// The host's systems that read [`crate::vertex::Position`] go here.
    Writeback,
}

/// One time step.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct StepSchedule;

/// Stages of [`StepSchedule`], in this order.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum StepSystems {
    /// Changes of the bodies themselves, such as the removal of elements.
    Edit,
    /// Loads and prescribed motion at the end of the step.
    Prepare,
    /// The integrator; it runs [`ForceSchedule`] (evaluate, gather) as often as it needs.
    Integrate,
    /// Corrections of the new state by user systems.
    Constrain,
    /// Energies, smallest volume ratio, reactions.
    Report,
    /// State to [`crate::vertex::Position`].
    Writeback,
}

/// One evaluation of the elastic energy, force and tangent at the current displacement, as far as
/// [`EvaluationRequest`] asks for them.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct ForceSchedule;

/// One evaluation of the viscous matrix (N s/m) of all dampers at the current displacement, into
/// [`Tangent`]; see [`evaluate_dampers`]. There is none in a world without dampers.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct DampingSchedule;

/// Stages of [`ForceSchedule`], in this order.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum ForceSystems {
    /// Quantities that several laws share (edge changes).
    Measure,
    /// The laws: each reads the state and writes only its own columns or buffer.
    Evaluate,
    /// Own columns to buffers where a law needs it (edge tensions).
    Collect,
    /// Buffers to totals, law by law in the order of [`Law::ORDER`].
    Gather,
}

/// Place of a law in the gather.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
struct GatherSlot(u8);

/// Highest value of [`Law::ORDER`].
pub const MAX_LAW_ORDER: u8 = 47;

/// Which executor runs the schedules.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Executor {
    /// Systems one after another, parallel inside (an empty schedule costs about 0.2 us).
    #[default]
    SingleThreaded,
    /// Independent systems side by side on bevy's task pool (about 10 us per run).
    MultiThreaded,
}

/// Adds both schedules, empty but for the gather frame, to `world`, with ambiguity as an error.
pub fn install<S: Scalar>(world: &mut World, executor: Executor) {
    world.init_resource::<Topology>();
    world.init_resource::<EvaluationRequest>();
    world.init_resource::<RecoveringBodies>();
    world.init_resource::<BodiesWithoutRecovery>();
    world.init_resource::<ElasticEnergy>();
    world.init_resource::<Tangent<S>>();
    world.init_resource::<Workers>();
    world.init_resource::<SystemTimes>();
    world.insert_resource(executor);
    world.insert_resource(Precision::of::<S>());

    let mut step = Schedule::new(StepSchedule);
    configure(&mut step, executor);
    step.configure_sets(
        (
            StepSystems::Edit,
            StepSystems::Prepare,
            StepSystems::Integrate,
            StepSystems::Constrain,
            StepSystems::Report,
            StepSystems::Writeback,
        )
            .chain(),
    );
    world.add_schedule(step);

    let mut force = Schedule::new(ForceSchedule);
    configure(&mut force, executor);
    force.configure_sets(
        (
            ForceSystems::Measure,
            ForceSystems::Evaluate,
            ForceSystems::Collect,
            ForceSystems::Gather,
        )
            .chain(),
    );
    for order in 0..=MAX_LAW_ORDER {
        force.configure_sets(GatherSlot(order).in_set(ForceSystems::Gather));
        if order > 0 {
            force.configure_sets(GatherSlot(order).after(GatherSlot(order - 1)));
        }
    }
    force.add_systems(clear_totals::<S>.in_set(ForceSystems::Gather).before(GatherSlot(0)));
    world.add_schedule(force);
}

fn configure(schedule: &mut Schedule, executor: Executor) {
    schedule.set_build_settings(ScheduleBuildSettings {
        ambiguity_detection: LogLevel::Error,
        ..Default::default()
    });
    match executor {
        Executor::SingleThreaded => schedule.set_executor(SingleThreadedExecutor::new()),
        Executor::MultiThreaded => schedule.set_executor(MultiThreadedExecutor::new()),
    };
}

/// Laws already in the force schedule.
#[derive(Resource, Default, Debug, Clone)]
pub struct ActiveLaws(pub Vec<&'static str>);

/// Puts a law's systems and its gather into [`ForceSchedule`], once. Bodies call this for the laws
/// they use, so a scene has no system for a law it does not use.
pub fn activate_law<L: Law, S: Scalar>(world: &mut World, add: impl FnOnce(&mut Schedule)) {
    if !activate_systems(world, L::NAME, add) {
        return;
    }
    world.init_resource::<LawBuffer<L, S>>();
    world
        .resource_mut::<Schedules>()
        .entry(ForceSchedule)
        .add_systems(gather_law::<L, S>.in_set(GatherSlot(L::ORDER)));
}

/// Puts systems without a buffer of their own into [`ForceSchedule`], once per `name`; says whether
/// they are new.
pub fn activate_systems(
    world: &mut World,
    name: &'static str,
    add: impl FnOnce(&mut Schedule),
) -> bool {
    let mut active = world.get_resource_or_init::<ActiveLaws>();
    if active.0.contains(&name) {
        return false;
    }
    active.0.push(name);
    add(world.resource_mut::<Schedules>().entry(ForceSchedule));
    true
}

/// Puts a law of dampers into [`DampingSchedule`], once. `add` gives the system that leaves its viscous
/// matrix (N s/m, symmetric and positive semidefinite) as the tangent in the law's buffer.
pub fn activate_dampers<L: Law, S: Scalar>(world: &mut World, add: impl FnOnce(&mut Schedule)) {
    if world.contains_resource::<LawBuffer<L, S>>() {
        return;
    }
    world.init_resource::<LawBuffer<L, S>>();
    let mut schedules = world.resource_mut::<Schedules>();
    if !schedules.contains(DampingSchedule) {
        let mut schedule = Schedule::new(DampingSchedule);
        // a handful of systems once a step: not worth another executor
        configure(&mut schedule, Executor::SingleThreaded);
        schedule.configure_sets((ForceSystems::Evaluate, ForceSystems::Gather).chain());
        for order in 0..=MAX_LAW_ORDER {
            schedule.configure_sets(GatherSlot(order).in_set(ForceSystems::Gather));
            if order > 0 {
                schedule.configure_sets(GatherSlot(order).after(GatherSlot(order - 1)));
            }
        }
        schedules.insert(schedule);
    }
    let schedule = schedules.entry(DampingSchedule);
    add(schedule);
    schedule.add_systems(gather_dampers::<L, S>.in_set(GatherSlot(L::ORDER)));
}

/// Whether any body has dampers.
pub fn has_dampers(world: &World) -> bool {
    world.get_resource::<Schedules>().is_some_and(|schedules| schedules.contains(DampingSchedule))
}

/// Replaces [`Tangent`] by the viscous matrix (N s/m) of all dampers at the current displacement, in a
/// world that [has](has_dampers) some.
pub fn evaluate_dampers<S: Scalar>(world: &mut World) {
    world.resource_scope(|world, mut tangent: Mut<Tangent<S>>| {
        tangent.matrix.clear(world.resource::<Topology>());
        tangent.clamped = 0;
    });
    world.run_schedule(DampingSchedule);
}

/// Says whether a column changed since [`World::last_change_tick`].
pub type ColumnWatch = fn(&mut World) -> bool;

/// What the active laws read beside the displacements. A law that is missing here may depend on
/// anything, and is evaluated anew whenever its force is needed.
#[derive(Resource, Default, Debug, Clone)]
struct LawInputs(Vec<(&'static str, Vec<ColumnWatch>)>);

/// Declares that the law or system `name` of [`activate_law`] or [`activate_systems`] reads nothing
/// but displacements, the order of rows and these columns, so that its force at unchanged
/// displacements may be used again. Systems put into [`ForceSchedule`] in any other way are not seen.
pub fn declare_inputs(world: &mut World, name: &'static str, columns: &[ColumnWatch]) {
    let mut inputs = world.get_resource_or_init::<LawInputs>();
    if inputs.0.iter().all(|(known, _)| *known != name) {
        inputs.0.push((name, columns.to_vec()));
    }
}

/// Whether a component of type `C` changed since [`World::last_change_tick`]: a [`ColumnWatch`].
/// Constant time for components with `#[component(summary_tick)]`, else a pass over the ticks.
pub fn column_changed<C: Component>(world: &mut World) -> bool {
    let mut query = world.query::<Ref<C>>();
    let tables = query.contiguous_iter(world).expect("element components are stored in tables");
    tables.map(ContiguousRef::split).any(|(_, ticks)| {
        ticks.summary_tick_is_changed() != Some(false) && ticks.is_changed_iter().any(|c| c)
    })
}

/// Whether the elastic force at the same displacements is still what it was at tick `since`: every
/// active law has declared what it reads, and none of it was changed. The order of rows is up to
/// the caller ([`Topology::revision`]).
pub fn law_inputs_unchanged(world: &mut World, since: Tick) -> bool {
    changed_laws(world, since).is_some_and(|changed| changed.is_empty())
}

/// Names of the active laws and systems that read something that was changed since tick `since`; `None` where
/// one has not declared what it reads.
pub fn changed_laws(world: &mut World, since: Tick) -> Option<Vec<&'static str>> {
    let active = world.get_resource::<ActiveLaws>()?.0.clone();
    let inputs = world.get_resource::<LawInputs>()?.clone();
    // laws share columns; each is looked at once
    let mut known: Vec<(ColumnWatch, bool)> = Vec::new();
    let mut changed = Vec::new();
    for law in active {
        let (_, columns) = inputs.0.iter().find(|(name, _)| *name == law)?;
        let own = columns.iter().any(|&column| {
            let found = known.iter().find(|(other, _)| std::ptr::fn_addr_eq(*other, column));
            if let Some(&(_, now)) = found {
                return now;
            }
            let now = world.last_change_tick_scope(since, column);
            known.push((column, now));
            now
        });
        if own {
            changed.push(law);
        }
    }
    Some(changed)
}

fn clear_totals<S: Scalar>(
    request: Res<EvaluationRequest>,
    topology: Res<Topology>,
    mut energy: ResMut<ElasticEnergy>,
    mut tangent: ResMut<Tangent<S>>,
    mut forces: Query<&mut ElasticForce<S>>,
) {
    if request.energy {
        energy.total = 0.0;
        energy.load = 0.0;
        energy.by_law.clear();
        energy.by_body.clear();
        energy.by_body.resize(topology.bodies.len(), 0.0);
    }
    if request.force
        && let Some(mut forces) = single_table(forces.contiguous_iter_mut())
    {
        forces.bypass_change_detection().fill(ElasticForce::default());
    }
    if request.tangent.is_some() {
        tangent.matrix.clear(&topology);
        tangent.clamped = 0;
    }
}

fn gather_law<L: Law, S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<L, S>>,
    mut energy: ResMut<ElasticEnergy>,
    mut tangent: ResMut<Tangent<S>>,
    mut times: ResMut<SystemTimes>,
    mut forces: Query<&mut ElasticForce<S>>,
) {
    let start = Instant::now();
    times.add(L::NAME, std::mem::take(&mut buffer.time));
    if request.energy {
        let own = buffer.energy();
        energy.total += own;
        energy.load += if L::IS_LOAD { own } else { 0.0 };
        energy.by_law.push((L::NAME, own));
        for span in &buffer.spans {
            energy.by_body[span.body] += span.energy;
        }
    }
    if request.force
        && let Some(mut forces) = single_table(forces.contiguous_iter_mut())
    {
        let total = ElasticForce::peel_slice_mut(forces.bypass_change_detection());
        buffer.add_forces_to(&workers, total);
    }
    if request.tangent.is_some() {
        buffer.add_tangent_to(&workers, &mut tangent.matrix);
        tangent.clamped += buffer.spans.iter().map(|s| s.clamped).sum::<u64>();
    }
    times.add("gather", start.elapsed());
}

fn gather_dampers<L: Law, S: Scalar>(
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<L, S>>,
    mut tangent: ResMut<Tangent<S>>,
    mut times: ResMut<SystemTimes>,
) {
    let start = Instant::now();
    times.add(L::NAME, std::mem::take(&mut buffer.time));
    buffer.add_tangent_to(&workers, &mut tangent.matrix);
    times.add("gather", start.elapsed());
}
