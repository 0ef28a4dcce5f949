//! Running one step, and what can go wrong.

use crate::columns::single_table;
use crate::element::{
    MembraneRest, MembraneShapes, MembraneVertices, ShapeGradients, TetrahedronShapes,
    TetrahedronVertices, area_ratio, displacement_gradient, volume_change,
};
use crate::isoparametric::{
    Derivatives, HexahedronRest, HexahedronVertices, PointsRest, QuadRest, QuadVertices,
    Tetrahedron10Rest, Tetrahedron10Vertices, load_points, point_differences, quad_differences,
    rows_of,
};
use crate::lanes::{Batch, Batches, Kernel, Lanes, MAX_LANES, padded};
use crate::load::{Constraint, Load, LoadTime, Pressure, apply_constraints, apply_loads};
use crate::order::LastOrder;
use crate::precision::Precision;
use crate::report::{AreaReport, StepReport, SystemTimes, VolumeReport};
use crate::row::MeshVertex;
use crate::scalar::{Real, Scalar};
use crate::schedule::{Executor, StepSchedule, StepSystems, install};
pub use crate::time::{Gravity, StepClock, StepDivider, StepPart};
use crate::topology::{ElementTables, Topology};
use crate::vertex::{BodyId, Displacement, Position, RestPosition, Velocity};
use crate::workers::Workers;
use crate::{by_precision, compiled_here};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::common_conditions::{not, resource_exists};
use bytemuck::TransparentWrapper;
use glam::DVec3;
use std::ops::Range;
use std::time::Instant;

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
    #[error("constraint or load `{name}`: {problem}; correct it or despawn its entity")]
    InvalidConstraint {
        /// Its name.
        name: String,
        /// What is wrong.
        problem: &'static str,
    },
    /// A tool, contact or pull cannot be used.
    #[error("tool or contact `{name}`: {problem}; correct it or despawn its entity")]
    InvalidContact {
        /// Its name.
        name: String,
        /// What is wrong.
        problem: String,
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

/// Adds schedules, resources and the systems that every scene needs.
pub fn install_engine<S: Scalar>(world: &mut World, executor: Executor) {
    compiled_here!(S, install_all(world: &mut World, executor: Executor))
}

fn install_all<S: Scalar>(world: &mut World, executor: Executor) {
    install::<S>(world, executor);
    world.init_resource::<LastOrder>();
    world.init_resource::<StepClock>();
    world.init_resource::<Gravity>();
    world.init_resource::<LoadTime>();
    world.init_resource::<StepFailure>();
    world.init_resource::<StepReport>();
    world.init_resource::<VolumeReport>();
    let mut schedules = world.resource_mut::<Schedules>();
    schedules.entry(StepSchedule).add_systems((
        (apply_constraints::<S>, apply_loads::<S>).in_set(StepSystems::Prepare),
        measure_volume_ratios::<S>
            .run_if(not(resource_exists::<VolumesReported>))
            .in_set(StepSystems::Report),
        (write_positions::<S>.run_if(not(resource_exists::<ColumnsBehind>)), advance_clock)
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
    check_state::<S>(world)?;
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

/// One table of the right size, all numbers finite.
fn check_state<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    let expected = world.resource::<Topology>().vertex_count();
    let mut vertices = world.query::<(&Displacement<S>, &Velocity<S>, &RestPosition)>();
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
    for constraint in world.query::<&Constraint>().iter(world) {
        if let Some(problem) = constraint.problem(expected) {
            return Err(StepError::InvalidConstraint { name: constraint.name.clone(), problem });
        }
    }
    for load in world.query::<&Load>().iter(world) {
        if let Some(problem) = load.problem(expected) {
            return Err(StepError::InvalidConstraint { name: load.name.clone(), problem });
        }
    }
    for pressure in world.query::<&Pressure>().iter(world) {
        if let Some(problem) = pressure.problem(expected) {
            return Err(StepError::InvalidConstraint { name: pressure.name.clone(), problem });
        }
    }
    let Some((u, v, rest)) = single_table(vertices.contiguous_iter(world)) else { return Ok(()) };
    let bad = |row: usize| {
        if !u[row].0.iter().all(|x| x.is_finite()) {
            Some("displacement")
        } else if !v[row].0.iter().all(|x| x.is_finite()) {
            Some("velocity")
        } else if !rest[row].0.is_finite() {
            Some("rest position")
        } else {
            None
        }
    };
    if let Some((row, quantity)) = (0..expected).find_map(|row| bad(row).map(|q| (row, q))) {
        return Err(not_finite(
            world,
            row,
            quantity,
            "it was set so from outside; the step was not carried out",
        ));
    }
    Ok(())
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

/// Smallest `J` and inverted elements of the current state into [`VolumeReport`].
pub fn measure_volume_ratios<S: Scalar>(
    (workers, failure, topology): (Res<Workers>, Res<StepFailure>, Res<Topology>),
    (mut report, mut times): (ResMut<VolumeReport>, ResMut<SystemTimes>),
    vertices: Query<&Displacement<S>>,
    tetrahedra: Query<(&TetrahedronVertices, ShapeGradients<S>, &BodyId)>,
    hexahedra: Query<(&HexahedronVertices, &HexahedronRest<S>, &BodyId)>,
    tens: Query<(&Tetrahedron10Vertices, &Tetrahedron10Rest<S>, &BodyId)>,
    mut partial: Local<Vec<Vec<(BodyId, f64, u64, u64)>>>,
) {
    const CHUNK: usize = 4096;
    let start = Instant::now();
    if failure.0.is_some() {
        return;
    }
    report.clear(topology.bodies.len());
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    // pooled and fused bodies keep their tetrahedra in a table each
    for (nodes, gradients, bodies) in
        tetrahedra.contiguous_iter().expect("element components are stored in tables")
    {
        let shapes = TetrahedronShapes::new(u, nodes, gradients);
        partial.resize(nodes.len().div_ceil(CHUNK), Vec::new());
        workers.for_each(&mut partial, nodes.len() * 3, |i, runs| {
            runs.clear();
            let end = ((i + 1) * CHUNK).min(nodes.len());
            let mut first = i * CHUNK;
            while first < end {
                let body = bodies[first];
                let length = bodies[first..end].iter().take_while(|b| **b == body).count();
                let elements = first..first + length;
                let (smallest, inverted) = workers.dispatch(VolumeRatios { shapes, elements });
                runs.push((body, smallest, inverted, length as u64));
                first += length;
            }
        });
        for &(body, smallest, inverted, count) in partial.iter().flatten() {
            report.add(body, smallest, inverted, count);
        }
    }
    macro_rules! at_points {
        ($elements:expr, $derivatives:expr) => {
            for (nodes, rest, bodies) in
                $elements.contiguous_iter().expect("element components are stored in tables")
            {
                let mut ratios = vec![f64::INFINITY; nodes.len()];
                let derivatives = &$derivatives;
                workers.for_chunks(&mut ratios, CHUNK, nodes.len() * 200, |first, ratios| {
                    for (i, ratio) in (first..).zip(ratios) {
                        let all = point_ratios(derivatives, u, &nodes[i].0, &rest[i]);
                        *ratio = all.into_iter().fold(f64::INFINITY, f64::min);
                    }
                });
                for (&smallest, body) in ratios.iter().zip(bodies) {
                    report.add(*body, smallest, u64::from(smallest <= 0.0), 1);
                }
            }
        };
    }
    at_points!(hexahedra, Derivatives::hexahedron());
    at_points!(tens, Derivatives::tetrahedron10());
    times.add("volume ratios", start.elapsed());
}

/// Ratio `J` of deformed to rest volume at the Gauss points of a solid element; 1 for a removed one.
pub fn point_ratios<S: Scalar, const N: usize, const Q: usize>(
    derivatives: &Derivatives<S, N, 3, Q>,
    displacement: &[Displacement<S>],
    nodes: &[u32; N],
    rest: &PointsRest<S, Q>,
) -> [f64; Q] {
    let u = rows_of(Displacement::peel_slice(displacement), nodes);
    std::array::from_fn(|q| {
        let at = point_differences::<S::One, N, Q>(derivatives, &u, q);
        let d = rest.gradients::<S::One>(q);
        let mut ratio = [S::ZERO];
        (<S::One as Real>::ONE + volume_change(&displacement_gradient(&d, &at))).store(&mut ratio);
        ratio[0].to_f64()
    })
}

/// Smallest `J` of some tetrahedra and how many of them have `J <= 0`.
struct VolumeRatios<'a, S> {
    shapes: TetrahedronShapes<'a, S>,
    elements: Range<usize>,
}

impl<S: Scalar> Kernel<S> for VolumeRatios<'_, S> {
    type Output = (f64, u64);
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> (f64, u64) {
        let Self { shapes, elements: Range { start, end } } = self;
        let mut smallest = L::from_f64(f64::INFINITY);
        // counts stay far below the range of whole numbers of f32
        let mut inverted = L::ZERO;
        let whole = end - (end - start) % L::COUNT;
        for first in (start..whole).step_by(L::COUNT) {
            let ratio = volume_ratios::<L>(&shapes, first);
            smallest = ratio.min(smallest);
            inverted += L::select(L::less(L::ZERO, ratio), L::ZERO, L::ONE);
        }
        let (mut ratios, mut counts) = ([S::ZERO; MAX_LANES], [S::ZERO; MAX_LANES]);
        smallest.store(&mut ratios);
        inverted.store(&mut counts);
        let lanes = 0..L::COUNT;
        let mut least = lanes.clone().fold(f64::INFINITY, |m, i| m.min(ratios[i].to_f64()));
        let mut count = lanes.map(|i| counts[i].to_f64()).sum::<f64>() as u64;
        if whole < end {
            let nodes = padded(shapes.nodes, whole, end);
            let gradients = shapes.gradients.map(|column| padded(column, whole, end));
            let shapes = TetrahedronShapes {
                displacement: shapes.displacement,
                nodes: &nodes,
                gradients: std::array::from_fn(|i| &gradients[i][..]),
            };
            volume_ratios::<L>(&shapes, 0).store(&mut ratios);
            for ratio in &ratios[..end - whole] {
                least = least.min(ratio.to_f64());
                count += u64::from(ratio.to_f64() <= 0.0);
            }
        }
        (least, count)
    }
}

#[inline(always)]
fn volume_ratios<L: Lanes>(shapes: &TetrahedronShapes<L::Scalar>, first: usize) -> L {
    let u = shapes.displacements(first);
    L::ONE + volume_change(&displacement_gradient(&shapes.gradients(first), &u))
}

/// Puts [`AreaReport`] and the system that fills it into a world, once; bodies with a membrane call it.
pub fn report_areas<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<AreaReport>() {
        world.init_resource::<AreaReport>();
        let mut schedules = world.resource_mut::<Schedules>();
        schedules
            .entry(StepSchedule)
            .add_systems(measure_area_ratios::<S>.in_set(StepSystems::Report));
    }
}

/// Smallest area ratio of the current state into [`AreaReport`].
pub fn measure_area_ratios<S: Scalar>(
    workers: Res<Workers>,
    failure: Res<StepFailure>,
    mut report: ResMut<AreaReport>,
    vertices: Query<&Displacement<S>>,
    triangles: Query<(&MembraneVertices, MembraneRest<S>)>,
    quads: Query<(&QuadVertices, &QuadRest<S>)>,
) {
    const CHUNK: usize = 4096;
    if failure.0.is_some() {
        return;
    }
    report.smallest_ratio = f64::INFINITY;
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    // every formulation keeps its triangles in a table of its own
    for (nodes, rest) in triangles.contiguous_iter().expect("elements are stored in tables") {
        let shapes = &MembraneShapes::new(u, nodes, rest);
        let mut partial = vec![f64::INFINITY; nodes.len().div_ceil(CHUNK)];
        workers.for_each(&mut partial, nodes.len() * 3, |i, least| {
            let elements = i * CHUNK..((i + 1) * CHUNK).min(nodes.len());
            let batch = AreaRatios { shapes, least: [f64::INFINITY; MAX_LANES] };
            let found = workers.dispatch(Batches(elements, batch)).least;
            *least = found.into_iter().fold(f64::INFINITY, f64::min);
        });
        report.smallest_ratio = partial.into_iter().fold(report.smallest_ratio, f64::min);
    }
    for (nodes, rest) in quads.contiguous_iter().expect("elements are stored in tables") {
        let derivatives = &Derivatives::quad();
        let ratios = nodes.iter().zip(rest).flat_map(|(n, r)| quad_ratios(derivatives, u, *n, r));
        report.smallest_ratio = ratios.fold(report.smallest_ratio, f64::min);
    }
}

/// Deformed over rest area at the Gauss points of a membrane quadrilateral.
pub fn quad_ratios<S: Scalar>(
    derivatives: &Derivatives<S, 4, 2, 4>,
    displacement: &[Displacement<S>],
    nodes: QuadVertices,
    rest: &QuadRest<S>,
) -> [f64; 4] {
    let u = rows_of(Displacement::peel_slice(displacement), &nodes.0);
    std::array::from_fn(|q| {
        let at = quad_differences::<S::One>(derivatives, &u, q);
        let area = load_points::<S::One, 4>(&rest.half_area, q);
        let mut ratio = [S::ZERO];
        area_ratio(&rest.edges(q), area, &at).store(&mut ratio);
        ratio[0].to_f64()
    })
}

struct AreaRatios<'a, S> {
    shapes: &'a MembraneShapes<'a, S>,
    least: [f64; MAX_LANES],
}

impl<S: Scalar> Batch<S> for AreaRatios<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let shapes = self.shapes;
        let u = shapes.displacements(first);
        let ratio = area_ratio(&shapes.edges(first), L::load(&shapes.area[first..]), &u);
        let mut lanes = [S::ZERO; MAX_LANES];
        ratio.store(&mut lanes);
        for lane in 0..L::COUNT {
            self.least[lane] = self.least[lane].min(lanes[lane].to_f64());
        }
    }
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
