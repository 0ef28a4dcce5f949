//! Sets and schedules. A step is [`StepSchedule`]; the force evaluation is a schedule of its own,
//! [`ForceSchedule`], so that a solver can run it again at trial states.

use crate::columns::single_table;
use crate::isoparametric::OwnPoints;
use crate::law::{
    BodiesWithoutRecovery, DisabledLaws, ElasticEnergy, EvaluationRequest, LawBuffer, LawBuffers,
    LawId, LawInfo, Partition, RecoveringBodies, SleepingBodies, ViscousRequest,
};
use crate::matrix::{PredictedValues, Tangent};
use crate::precision::Precision;
use crate::report::SystemTimes;
use crate::resource::{ensure, put, take};
use crate::scalar::Scalar;
use crate::stopwatch::Stopwatch;
use crate::topology::Topology;
use crate::vertex::{Displacement, ElasticForce};
use crate::workers::Workers;
use bevy_ecs::change_detection::Tick;
use bevy_ecs::component::ComponentId;
use bevy_ecs::prelude::*;
use bevy_ecs::query::{ContiguousQueryData, QueryBuilder, ReadOnlyQueryData};
use bevy_ecs::schedule::{
    LogLevel, MultiThreadedExecutor, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor,
};
use bevy_ecs::system::{ParamBuilder, QueryParamBuilder, SystemParamBuilder};
use bytemuck::TransparentWrapper;
use std::sync::{Arc, PoisonError};

/// Where Sinew runs inside a host schedule (a Bevy app's `FixedPostUpdate`, for example), in this order.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum SimulationSystems {
    /// Before everything else: bodies that are new are built, clocks are read.
    First,
    /// The host's systems that change loads, constraints or settings go here.
    Prepare,
    /// One run of [`StepSchedule`].
    Step,
    /// The host's systems that read [`crate::vertex::Position`] go here.
    Writeback,
    /// After everything else: the host's systems that need what those of Writeback wrote.
    Last,
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
    /// Buffers to totals, law by law in the order of their places.
    Gather,
}

/// Which executor runs the schedules.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Executor {
    /// Systems one after another, parallel inside (an empty schedule costs about 0.2 us).
    #[default]
    SingleThreaded,
    /// Independent systems side by side on bevy's task pool (about 10 us per run).
    MultiThreaded,
}

impl Executor {
    /// Name in scene files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::SingleThreaded => "single",
            Self::MultiThreaded => "multi",
        }
    }
}

/// Adds both schedules, empty but for the gather frame, to `world`, with ambiguity as an error.
pub fn install<S: Scalar>(world: &mut World, executor: Executor) {
    ensure::<Topology>(world);
    ensure::<EvaluationRequest>(world);
    ensure::<RecoveringBodies>(world);
    ensure::<SleepingBodies>(world);
    ensure::<OwnPoints>(world);
    ensure::<BodiesWithoutRecovery>(world);
    ensure::<DisabledLaws>(world);
    ensure::<ElasticEnergy>(world);
    ensure::<LawBuffers<S>>(world);
    ensure::<Tangent<S>>(world);
    ensure::<PredictedValues>(world);
    ensure::<Workers>(world);
    ensure::<SystemTimes>(world);
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
    force.add_systems(gather::<S>.in_set(ForceSystems::Gather));
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

/// What the system of a law is given beside the columns of its elements.
#[derive(Clone, Copy)]
pub struct Evaluation<'a> {
    /// What is wanted.
    pub request: &'a EvaluationRequest,
    /// Threads and instruction set.
    pub workers: &'a Workers,
    /// Bodies whose laws give way to the corotational energy.
    pub recovering: &'a RecoveringBodies,
    /// Derivatives in elements with points of their own.
    pub points: &'a OwnPoints,
}

/// What a law does with the displacements of all vertices and the columns `D` of its elements: energy, force
/// and tangent of every range into its private arrays, as far as they are asked for.
pub type Evaluate<S, D> = for<'w, 's> fn(
    Evaluation,
    &'w [Displacement<S>],
    <D as ContiguousQueryData>::Contiguous<'w, 's>,
    &mut LawBuffer<S>,
);

/// A law of elements as it goes into a schedule.
pub struct ElementLaw<S: Scalar, D: ContiguousQueryData> {
    /// Name and nature.
    pub info: LawInfo,
    /// Place in the sum, lower first.
    pub place: usize,
    /// Component that its elements have, and no others.
    pub mark: Option<ComponentId>,
    /// Cuts its elements into ranges.
    pub partition: Partition<S>,
    /// Evaluates them.
    pub evaluate: Evaluate<S, D>,
}

/// Puts a law of elements into [`ForceSchedule`], once. All laws of one kind of columns are instances of one
/// system type; each has a buffer of its own and declares the columns it reads by its query, so that
/// independent laws may run side by side. Changes of those columns are seen by themselves ([`changed_laws`]).
pub fn activate_law<S: Scalar, D>(world: &mut World, law: ElementLaw<S, D>)
where
    D: ReadOnlyQueryData + ContiguousQueryData + 'static,
{
    add_element_law(world, law, false);
}

fn add_element_law<S: Scalar, D>(world: &mut World, law: ElementLaw<S, D>, is_damper: bool)
where
    D: ReadOnlyQueryData + ContiguousQueryData + 'static,
{
    let ElementLaw { info, place, mark, partition, evaluate } = law;
    let mut buffers = ensure::<LawBuffers<S>>(world);
    let Some(id) = buffers.insert(info, place, is_damper, mark, partition) else { return };
    let query = QueryBuilder::<D>::new(world);
    let reads = query.access().access().reads().as_finite_set();
    let inputs: Option<Vec<Input>> = reads.map(|set| set.iter().map(Input::Column).collect());
    let builders = (
        QueryParamBuilder::new(move |query: &mut QueryBuilder<D>| {
            if let Some(mark) = mark {
                query.with_id(mark);
            }
        }),
        ParamBuilder,
        ParamBuilder,
        ParamBuilder,
        ParamBuilder,
        ParamBuilder,
        ParamBuilder,
    );
    let system = builders.build_state(world).build_any_system(
        move |elements: Query<D>,
              vertices: Query<&Displacement<S>>,
              buffers: Res<LawBuffers<S>>,
              disabled: Res<DisabledLaws>,
              request: Res<EvaluationRequest>,
              workers: Res<Workers>,
              (recovering, points): (Res<RecoveringBodies>, Res<OwnPoints>)| {
            let start = Stopwatch::start();
            if disabled.contains(info.name) {
                return;
            }
            let Some(u) = single_table(vertices.contiguous_iter()) else { return };
            let Some(data) = single_table(elements.contiguous_iter()) else { return };
            let mut buffer = buffers.lock(id);
            let with = Evaluation {
                request: &request,
                workers: &workers,
                recovering: &recovering,
                points: &points,
            };
            evaluate(with, u, data, &mut buffer);
            buffer.time = start.elapsed();
        },
    );
    let system = system.in_set(ForceSystems::Evaluate);
    if is_damper {
        damping_schedule::<S>(world).add_systems(system);
    } else {
        activate_systems(world, info.name, |schedule| {
            schedule.add_systems(system);
        });
        if let Some(inputs) = inputs {
            declare_inputs(world, info.name, &inputs);
        }
    }
}

/// Puts a law with systems of its own into [`ForceSchedule`], once: `add` is given its place in
/// [`LawBuffers`]. What it reads is to be told by [`declare_inputs`].
pub fn activate_law_of_systems<S: Scalar>(
    world: &mut World,
    (info, place): (LawInfo, usize),
    (mark, partition): (Option<ComponentId>, Partition<S>),
    add: impl FnOnce(&mut Schedule, LawId),
) {
    let mut buffers = ensure::<LawBuffers<S>>(world);
    if let Some(id) = buffers.insert(info, place, false, mark, partition) {
        activate_systems(world, info.name, |schedule| add(schedule, id));
    }
}

/// Puts systems without a buffer of their own into [`ForceSchedule`], once per `name`; says whether
/// they are new.
pub fn activate_systems(
    world: &mut World,
    name: &'static str,
    add: impl FnOnce(&mut Schedule),
) -> bool {
    let mut active = ensure::<ActiveLaws>(world);
    if active.0.contains(&name) {
        return false;
    }
    active.0.push(name);
    add(world.resource_mut::<Schedules>().entry(ForceSchedule));
    true
}

/// Puts a law of dampers into [`DampingSchedule`], once. It leaves in its buffer what [`LawBuffer::viscous`] asks
/// for.
pub fn activate_dampers<S: Scalar, D>(world: &mut World, law: ElementLaw<S, D>)
where
    D: ReadOnlyQueryData + ContiguousQueryData + 'static,
{
    add_element_law(world, law, true);
}

fn damping_schedule<S: Scalar>(world: &mut World) -> &mut Schedule {
    let schedules = world.resource_mut::<Schedules>().into_inner();
    if !schedules.contains(DampingSchedule) {
        let mut schedule = Schedule::new(DampingSchedule);
        // a handful of systems once a step: not worth another executor
        configure(&mut schedule, Executor::SingleThreaded);
        schedule.configure_sets((ForceSystems::Evaluate, ForceSystems::Gather).chain());
        schedule.add_systems(gather_dampers::<S>.in_set(ForceSystems::Gather));
        schedules.insert(schedule);
    }
    schedules.entry(DampingSchedule)
}

/// Whether any body has dampers.
pub fn has_dampers(world: &World) -> bool {
    world.get_resource::<Schedules>().is_some_and(|schedules| schedules.contains(DampingSchedule))
}

/// Replaces [`Tangent`] by the viscous matrix (N s/m) of all dampers at the current displacement, in a
/// world that [has](has_dampers) some.
pub fn evaluate_dampers<S: Scalar>(world: &mut World) {
    let mut tangent = take::<Tangent<S>>(world);
    tangent.matrix.clear(world.resource::<Topology>());
    tangent.low_rank.clear();
    tangent.clamped = 0;
    put(world, tangent);
    world.run_schedule(DampingSchedule);
}

/// Forces or bounds of all dampers, row by row, as `request` asks, at the current displacement into `sum`, in a
/// world that [has](has_dampers) some.
pub fn evaluate_viscous<S: Scalar>(
    world: &mut World,
    request: &ViscousRequest<S>,
    sum: &mut Vec<[S; 4]>,
) {
    sum.clear();
    sum.resize(world.resource::<Topology>().vertex_count(), [S::ZERO; 4]);
    let ask = |world: &mut World, request: &ViscousRequest<S>| {
        for slot in world.resource_mut::<LawBuffers<S>>().slots.iter_mut().filter(|s| s.is_damper) {
            let buffer = slot.buffer.get_mut().unwrap_or_else(PoisonError::into_inner);
            buffer.viscous.clone_from(request);
        }
    };
    ask(world, request);
    world.run_schedule(DampingSchedule);
    let (buffers, workers) = (world.resource::<LawBuffers<S>>(), world.resource::<Workers>());
    let disabled = world.resource::<DisabledLaws>();
    for &slot in &buffers.order {
        let LawInfo { name, .. } = buffers.slots[slot].info;
        if buffers.slots[slot].is_damper && !disabled.contains(name) {
            buffers.lock(LawId(slot)).add_forces_to(workers, sum);
        }
    }
    ask(world, &ViscousRequest::Matrix);
}

/// Something that the force of a law depends on beside the displacements.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    /// A column of elements. Without `#[component(summary_tick)]` it counts as changed at any time.
    Column(ComponentId),
    /// Whatever this finds changed since [`World::last_change_tick`].
    Watch(fn(&mut World) -> bool),
}

impl Input {
    /// The column of a component.
    pub fn column<C: Component>(world: &mut World) -> Self {
        Self::Column(world.register_component::<C>())
    }

    fn changed(self, world: &mut World) -> bool {
        match self {
            Self::Watch(watch) => watch(world),
            Self::Column(id) => {
                let (last, now) = (world.last_change_tick(), world.read_change_tick());
                let (archetypes, tables) = (world.archetypes(), &world.storages().tables);
                let with = archetypes.component_index().get(&id);
                with.into_iter().flat_map(|with| with.keys()).any(|&with| {
                    let table = &tables[archetypes[with].table_id()];
                    let tick = table.get_summary_tick(id);
                    !table.is_empty() && tick.is_none_or(|t| t.get().is_newer_than(last, now))
                })
            }
        }
    }
}

/// What the active laws read beside the displacements. A law that is missing here may depend on
/// anything, and is evaluated again whenever its force is needed.
#[derive(Resource, Default, Debug, Clone)]
struct LawInputs(Vec<(&'static str, Arc<[Input]>)>);

/// Declares that the law or system `name` of [`activate_law_of_systems`] or [`activate_systems`] reads nothing
/// but displacements, the order of rows and these, so that its force at unchanged displacements may be used
/// again. Systems put into [`ForceSchedule`] in any other way are not seen.
pub fn declare_inputs(world: &mut World, name: &'static str, inputs: &[Input]) {
    let mut known = ensure::<LawInputs>(world);
    if known.0.iter().all(|(other, _)| *other != name) {
        known.0.push((name, inputs.into()));
    }
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
    world.last_change_tick_scope(since, |world| {
        let switched = world.is_resource_changed::<DisabledLaws>();
        let mut changed = Vec::new();
        for law in active {
            let (_, own) = inputs.0.iter().find(|(name, _)| *name == law)?;
            if switched || own.iter().any(|input| input.changed(world)) {
                changed.push(law);
            }
        }
        Some(changed)
    })
}

/// Clears the totals and adds up the buffers of all laws in the order of their places.
fn gather<S: Scalar>(
    (request, disabled): (Res<EvaluationRequest>, Res<DisabledLaws>),
    (topology, workers): (Res<Topology>, Res<Workers>),
    mut buffers: ResMut<LawBuffers<S>>,
    (mut energy, mut tangent): (ResMut<ElasticEnergy>, ResMut<Tangent<S>>),
    mut times: ResMut<SystemTimes>,
    mut forces: Query<&mut ElasticForce<S>>,
) {
    let start = Stopwatch::start();
    energy.values.clear();
    if request.energy {
        energy.total = 0.0;
        energy.load = 0.0;
        energy.by_law.clear();
        energy.by_body.clear();
        energy.by_body.resize(topology.bodies.len(), 0.0);
    }
    let mut rows = single_table(forces.contiguous_iter_mut()).filter(|_| request.force);
    let mut total =
        rows.as_mut().map(|forces| ElasticForce::peel_slice_mut(forces.bypass_change_detection()));
    if let Some(total) = &mut total {
        total.fill([S::ZERO; 4]);
    }
    // the first law to add something makes it zero
    let mut stale = request.tangent.is_some();
    if stale {
        tangent.matrix.resize(&topology);
        tangent.low_rank.clear();
        tangent.clamped = 0;
    }
    buffers.evaluations += 1;
    let LawBuffers { slots, order, asleep, .. } = &mut *buffers;
    if stale && !asleep.0.is_empty() {
        // nobody reads what is left of others
        let awake = topology.bodies.iter().enumerate().filter(|(body, _)| !asleep.contains(*body));
        awake.for_each(|(_, body)| tangent.matrix.clear_body(body));
        stale = false;
    }
    for &slot in order.iter() {
        let slot = &mut slots[slot];
        let LawInfo { name, is_load } = slot.info;
        if slot.is_damper || disabled.contains(name) {
            continue;
        }
        let buffer = slot.buffer.get_mut().unwrap_or_else(PoisonError::into_inner);
        times.add(name, std::mem::take(&mut buffer.time));
        if request.energy {
            let own = buffer.energy();
            energy.total += own;
            energy.load += if is_load { own } else { 0.0 };
            energy.by_law.push((name, own));
            for span in &buffer.spans {
                energy.by_body[span.body] += span.energy;
            }
        }
        if !buffer.values.is_empty() {
            energy.values.push(buffer.values.clone());
        }
        if let Some(total) = &mut total {
            buffer.add_forces_to(&workers, total);
        }
        if request.tangent.is_some() {
            buffer.add_tangent_to(&workers, &mut tangent.matrix, std::mem::take(&mut stale));
            tangent.low_rank.extend(buffer.low_rank.clone());
            tangent.clamped += buffer.spans.iter().map(|s| s.clamped).sum::<u64>();
        }
    }
    if stale {
        tangent.matrix.clear(&topology);
    }
    times.add("gather", start.elapsed());
}

/// Adds up the buffers of all laws of dampers, likewise.
fn gather_dampers<S: Scalar>(
    workers: Res<Workers>,
    disabled: Res<DisabledLaws>,
    mut buffers: ResMut<LawBuffers<S>>,
    mut tangent: ResMut<Tangent<S>>,
    mut times: ResMut<SystemTimes>,
) {
    let start = Stopwatch::start();
    let LawBuffers { slots, order, .. } = &mut *buffers;
    for &slot in order.iter() {
        let slot = &mut slots[slot];
        if !slot.is_damper || disabled.contains(slot.info.name) {
            continue;
        }
        let buffer = slot.buffer.get_mut().unwrap_or_else(PoisonError::into_inner);
        times.add(slot.info.name, std::mem::take(&mut buffer.time));
        buffer.add_tangent_to(&workers, &mut tangent.matrix, false);
    }
    times.add("gather", start.elapsed());
}
