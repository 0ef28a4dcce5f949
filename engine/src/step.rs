//! Running one step, and what can go wrong.

use crate::columns::single_table;
use crate::kept::with_query;
use crate::law::SleepingBodies;
use crate::load::{Constraint, Load, LoadTime, Pressure, apply_constraints, apply_loads};
use crate::order::LastOrder;
use crate::precision::Precision;
use crate::ratios::measure_volume_ratios;
use crate::report::{StepReport, VolumeReport};
use crate::resource::{ensure, take};
use crate::row::MeshVertex;
use crate::scalar::Scalar;
use crate::schedule::{Executor, StepSchedule, StepSystems, install};
pub use crate::time::{Gravity, StepClock, StepDivider, StepPart};
use crate::topology::{ElementTables, Topology};
use crate::vertex::{BodyId, Displacement, Position, RestPosition, Velocity};
use crate::{by_precision, compiled_here};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::common_conditions::{not, resource_exists};
use bytemuck::TransparentWrapper;
use glam::DVec3;

/// Why a step was not carried out. The state is what it was before the step.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// The step length is not a positive finite number.
    #[error("step length dt = {dt} s: it must be positive and finite")]
    InvalidStep {
        /// Offending value (s).
        dt: f64,
    },
    /// Gravity is not finite.
    #[error("gravity {gravity} m/s^2 is not finite")]
    InvalidGravity {
        /// Offending value (m/s^2).
        gravity: DVec3,
    },
    /// A vertex or element entity is, or was, in another table than its fellows.
    #[error(
        "the tables of the bodies changed ({expected} rows expected, {found} found): a component was \
         added to or removed from a vertex or element entity (or one was despawned) after its body \
         was spawned; keep such data on entities of your own and refer to vertices by row"
    )]
    LayoutChanged {
        /// Rows that the bodies have: vertices, or vertices and elements when these are the matter.
        expected: usize,
        /// Rows found.
        found: usize,
    },
    /// The state holds a number that is not finite.
    #[error(
        "{quantity} of vertex {vertex} of body `{body}` is not finite at t = {time} s: {remedy}"
    )]
    NotFinite {
        /// Which quantity.
        quantity: &'static str,
        /// Vertex of the user's mesh.
        vertex: MeshVertex,
        /// Name of the body.
        body: String,
        /// Simulated time (s).
        time: f64,
        /// What to do.
        remedy: &'static str,
    },
    /// A constraint or load cannot be applied.
    #[error("constraint or load `{name}`: {problem}; correct it or take it away")]
    InvalidConstraint {
        /// Its name.
        name: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// A tool, contact or pull cannot be used.
    #[error("tool or contact `{name}`: {problem}; correct it or take it away")]
    InvalidContact {
        /// Its name.
        name: String,
        /// What is wrong.
        problem: String,
    },
    /// A body that tears cannot go on.
    #[error("{problem}; the step was not made")]
    Tear {
        /// What cannot tear, why, and what helps.
        problem: String,
    },
    /// A pressure blew a body up: nothing holds it any more.
    #[error(
        "pressure `{name}` burst body `{body}` in the step after t = {time} s: its elements would have {growth:.1e} times their rest \
         size; the step was undone. A pressure of about Young's modulus or more has no equilibrium with models whose energy grows no \
         faster than the volume: make it smaller, or use model = \"neo_hookean\" or \"svk_volume\""
    )]
    Burst {
        /// Name of the pressure.
        name: String,
        /// Name of the body.
        body: String,
        /// Simulated time (s) at the start of the step.
        time: f64,
        /// Mean magnitude of deformed over rest volume of its solid elements, or over rest area of its membrane.
        growth: f64,
    },
    /// The integrator gave up.
    #[error("step {step} at t = {time} s failed: {reason}")]
    Diverged {
        /// Number of the step.
        step: u64,
        /// Simulated time (s).
        time: f64,
        /// What happened and what to do.
        reason: String,
    },
    /// A setting cannot be used.
    #[error("{0}")]
    InvalidSetting(String),
    /// The backend cannot carry the step out.
    #[error("backend \"{backend}\": {reason}")]
    Backend {
        /// Name as in a scene file.
        backend: &'static str,
        /// What is missing, and the remedy.
        reason: String,
    },
    /// The world was not set up for steps.
    #[error(
        "the world has no `Precision`, so no engine: add `SinewPlugins` to the app, or call \
         `install_engine`, before the first step"
    )]
    NoEngine,
    /// No integrator was installed.
    #[error("no integrator is installed: add one of the solver plugins")]
    NoIntegrator,
}

/// Set by the integrator when the step could not be carried out.
#[derive(Resource, Clone, Debug, Default)]
pub struct StepFailure(pub Option<StepError>);

/// Marks that the integrator fills [`VolumeReport`] itself, in place of [`measure_volume_ratios`].
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct VolumesReported;

/// Marks that [`Displacement`], [`Velocity`] and [`Position`] are older than the last step: an integrator that works
/// elsewhere brings them up to date when somebody asks for them.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct ColumnsBehind;

/// Marks that an integrator is installed.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct IntegratorInstalled;

/// The integrator knows displacements and velocities to the bit, and has [`check_watched`] look at them where they are others: a step of
/// a world at rest does not look twice at its numbers. Systems of [`StepSystems::Edit`] that read them ask for it first, too.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct StateWatched(pub bool);

/// Adds schedules, resources and the systems that every scene needs.
pub fn install_engine<S: Scalar>(world: &mut World, executor: Executor) {
    compiled_here!(S, install_all(world: &mut World, executor: Executor))
}

fn install_all<S: Scalar>(world: &mut World, executor: Executor) {
    install::<S>(world, executor);
    ensure::<LastOrder>(world);
    ensure::<StepClock>(world);
    ensure::<Gravity>(world);
    ensure::<LoadTime>(world);
    ensure::<StepFailure>(world);
    ensure::<StepReport>(world);
    ensure::<VolumeReport>(world);
    let mut schedules = world.resource_mut::<Schedules>();
    schedules.entry(StepSchedule).add_systems((
        (apply_constraints::<S>, apply_loads::<S>).in_set(StepSystems::Prepare),
        measure_volume_ratios::<S>
            .run_if(not(resource_exists::<VolumesReported>))
            .in_set(StepSystems::Report),
        (
            write_positions::<S>.run_if(not(resource_exists::<ColumnsBehind>)),
            advance_clock,
            wake_all,
        )
            .in_set(StepSystems::Writeback),
    ));
}

/// Runs one step of `clock.dt`.
///
/// # Errors
/// When settings or state are invalid, or when the integrator gives up; the state is then what it
/// was before.
pub fn run_step(world: &mut World) -> Result<(), StepError> {
    let precision = *world.get_resource::<Precision>().ok_or(StepError::NoEngine)?;
    by_precision!(precision, step(world))
}

fn step<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    let clock = *world.resource::<StepClock>();
    if !(clock.dt > 0.0 && clock.dt.is_finite()) {
        return Err(StepError::InvalidStep { dt: clock.dt });
    }
    let gravity = world.resource::<Gravity>().0;
    if !gravity.is_finite() {
        return Err(StepError::InvalidGravity { gravity });
    }
    if !world.contains_resource::<IntegratorInstalled>() {
        return Err(StepError::NoIntegrator);
    }
    with_query(world, check_tables::<S>)?;
    let watched = world.get_resource::<StateWatched>().is_some_and(|own| own.0);
    check_finite::<S>(world, watched)?;
    let parts = match world.get_resource::<StepDivider>().copied() {
        Some(StepDivider(divide)) => divide(world),
        None => 1,
    };
    if parts > 1 { step_in_parts::<S>(world, clock, parts) } else { run_schedule(world) }
}

fn run_schedule(world: &mut World) -> Result<(), StepError> {
    world.resource_mut::<StepFailure>().0 = None;
    world.run_schedule(StepSchedule);
    match world.resource_mut::<StepFailure>().0.take() {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// A step in equal parts, whose reports are added up; when one fails, the state is what it was before the first.
fn step_in_parts<S: Scalar>(
    world: &mut World,
    clock: StepClock,
    parts: u32,
) -> Result<(), StepError> {
    let mut query = world.query::<(&Displacement<S>, &Velocity<S>)>();
    let before = single_table(query.contiguous_iter(world)).map(|(u, v)| (u.to_vec(), v.to_vec()));
    let mut total = StepReport::default();
    let mut result = Ok(());
    for index in 0..parts {
        world.insert_resource(StepPart { index, count: parts });
        world.resource_mut::<StepClock>().dt = clock.dt / f64::from(parts);
        result = run_schedule(world);
        if result.is_err() {
            break;
        }
        total = world.resource::<StepReport>().after(&total);
        world.insert_resource(total.clone());
    }
    world.remove_resource::<StepPart>();
    if result.is_ok() {
        let end = StepClock { time: clock.time + clock.dt, step: clock.step + 1, ..clock };
        world.insert_resource(end);
        return result;
    }
    world.insert_resource(clock);
    let mut query = world.query::<(&mut Displacement<S>, &mut Velocity<S>)>();
    if let (Some((u0, v0)), Some((mut u, mut v))) =
        (before, single_table(query.contiguous_iter_mut(world)))
    {
        u.bypass_change_detection().copy_from_slice(&u0);
        v.bypass_change_detection().copy_from_slice(&v0);
    }
    result
}

/// The state of vertices.
type VertexState<S> = (&'static Displacement<S>, &'static Velocity<S>, &'static RestPosition);

/// One table of the right size, and constraints and loads that can be applied.
fn check_tables<S: Scalar>(
    world: &mut World,
    vertices: &mut QueryState<VertexState<S>>,
) -> Result<(), StepError> {
    let expected = world.resource::<Topology>().vertex_count();
    let columns = vertices.contiguous_iter(world).expect("vertex components are table-stored");
    let tables: Vec<usize> = columns.map(|(u, _, _)| u.len()).collect();
    let found = tables.first().copied().unwrap_or(0);
    if found != expected || tables.len() > 1 {
        return Err(StepError::LayoutChanged { expected, found });
    }
    if let Some(spawned) = world.get_resource::<ElementTables>() {
        let now = ElementTables::of(world);
        if now != *spawned {
            let (expected, found) = (spawned.entities(), now.entities());
            return Err(StepError::LayoutChanged { expected, found });
        }
    }
    each_usable(world, |own: &Constraint| (&own.name, own.problem(expected)))?;
    each_usable(world, |own: &Load| (&own.name, own.problem(expected)))?;
    each_usable(world, |own: &Pressure| (&own.name, own.problem(expected)))
}

/// Looks at the numbers of a state that [`StateWatched`] kept the step from looking at.
///
/// # Errors
/// The first vertex of which one is not finite.
pub fn check_watched<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    match take::<StateWatched>(world).0 {
        true => check_finite::<S>(world, false),
        false => Ok(()),
    }
}

/// The same for systems of [`StepSystems::Edit`]: whether they may go on. The step fails where they may not.
pub fn may_edit<S: Scalar>(world: &mut World) -> bool {
    let failure = check_watched::<S>(world).err();
    let is_sound = failure.is_none();
    if !is_sound {
        world.resource_mut::<StepFailure>().0 = failure;
    }
    is_sound
}

/// Whether all numbers of the state are finite; where somebody watches over the others, places at rest.
fn check_finite<S: Scalar>(world: &mut World, watched: bool) -> Result<(), StepError> {
    let bad = with_query::<VertexState<S>, (), _>(world, |world, vertices| {
        let (u, v, rest) = single_table(vertices.contiguous_iter(world))?;
        let all = |rows: &[[S; 4]]| watched || all_finite(rows);
        if all_rest_finite(rest) && all(Displacement::peel_slice(u)) && all(Velocity::peel_slice(v))
        {
            return None;
        }
        let quantity = |row: usize| match () {
            () if !u[row].0.iter().all(|x| x.is_finite()) => Some("displacement"),
            () if !v[row].0.iter().all(|x| x.is_finite()) => Some("velocity"),
            () if !rest[row].0.is_finite() => Some("rest position"),
            () => None,
        };
        (0..u.len()).find_map(|row| quantity(row).map(|quantity| (row, quantity)))
    });
    let remedy = "it was set so from outside; the step was not carried out";
    bad.map_or(Ok(()), |(row, quantity)| Err(not_finite(world, row, quantity, remedy)))
}

/// Whether all places at rest are finite, as [`all_finite`] looks.
fn all_rest_finite(rest: &[RestPosition]) -> bool {
    let add =
        |sum: [DVec3; 4], x: &[RestPosition; 4]| std::array::from_fn(|k| sum[k] + 0.0 * x[k].0);
    let (fours, last) = rest.as_chunks::<4>();
    fours.iter().fold([DVec3::ZERO; 4], add) == [DVec3::ZERO; 4]
        && last.iter().all(|x| x.0.is_finite())
}

/// Whether all constraints or loads of a kind can be applied; `problem` gives the name of each and what is wrong.
fn each_usable<T: Component>(
    world: &mut World,
    problem: impl Fn(&T) -> (&String, Option<&'static str>),
) -> Result<(), StepError> {
    with_query::<&T, (), _>(world, |world, all| {
        match all.iter(world).map(problem).find_map(|(name, problem)| Some((name, problem?))) {
            Some((name, problem)) => {
                Err(StepError::InvalidConstraint { name: name.clone(), problem })
            }
            None => Ok(()),
        }
    })
}

/// Whether all numbers are finite: 0 times any other is not a number. Without a branch for each, and in sums of which
/// few wait for each other.
fn all_finite<S: Scalar>(rows: &[[S; 4]]) -> bool {
    let add = |sum: [S; 8], x: &[S; 8]| std::array::from_fn(|k| sum[k] + S::ZERO * x[k]);
    let (pairs, last) = rows.as_flattened().as_chunks::<8>();
    pairs.iter().fold([S::ZERO; 8], add) == [S::ZERO; 8] && last.iter().all(|x| x.is_finite())
}

/// The error that names the vertex of a row.
pub fn not_finite(
    world: &mut World,
    row: usize,
    quantity: &'static str,
    remedy: &'static str,
) -> StepError {
    let time = world.resource::<StepClock>().time;
    let mut names = world.query::<(&MeshVertex, &BodyId)>();
    let (vertex, body) = match single_table(names.contiguous_iter(world)) {
        Some((vertex, body)) => (vertex[row], body[row].0),
        None => (MeshVertex(row as u32), 0),
    };
    let body = world
        .resource::<Topology>()
        .bodies
        .get(body as usize)
        .map_or_else(String::new, |b| b.name.clone());
    StepError::NotFinite { quantity, vertex, body, time, remedy }
}

/// Positions from the displacements in the columns.
pub fn write_positions<S: Scalar>(
    mut vertices: Query<(&RestPosition, &Displacement<S>, &mut Position)>,
) {
    let Some((rest, displacement, mut position)) = single_table(vertices.contiguous_iter_mut())
    else {
        return;
    };
    for ((p, x), u) in position.iter_mut().zip(rest).zip(displacement) {
        p.0 = x.0 + u.get();
    }
}

/// Nobody counts as asleep between two steps: who looks at elements there looks at all of them.
fn wake_all(mut sleeping: ResMut<SleepingBodies>) {
    sleeping.bypass_change_detection().0.clear();
}

fn advance_clock(
    failure: Res<StepFailure>,
    part: Option<Res<StepPart>>,
    mut clock: ResMut<StepClock>,
) {
    if failure.0.is_none() {
        clock.step += u64::from(part.is_none());
        clock.time += clock.dt;
    }
}
