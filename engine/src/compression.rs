//! How many elements are pressed together far: told of bodies whose law resists that too little.

use crate::columns::single_table;
use crate::element::{
    ShapeGradients, TetrahedronShapes, TetrahedronVertices, displacement_gradient, minor,
};
use crate::isoparametric::{
    CornerPoints, Derivatives, HexahedronRest, HexahedronVertices, OwnPoints, PointsRest,
    Tetrahedron10Rest, Tetrahedron10Vertices,
};
use crate::lanes::{Batch, Batches, Lanes, MAX_LANES};
use crate::law::SleepingBodies;
use crate::ratios::{DerivativesAt, point_gradients};
use crate::resource::ensure;
use crate::scalar::{Real, Scalar};
use crate::schedule::{StepSchedule, StepSystems};
use crate::step::{ColumnsBehind, StepFailure};
use crate::topology::Topology;
use crate::vertex::{BodyId, Displacement};
use crate::workers::Workers;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::common_conditions::{not, resource_exists};
use bevy_ecs::system::ScheduleSystem;
use std::ops::Range;

/// Principal stretch below which an element counts as compressed far: St Venant-Kirchhoff resists with less than half of what
/// tissue does there.
pub const COMPRESSED: f64 = 0.7;

/// Elements compressed far at the end of the last step; a world without bodies that are looked at does not have it.
#[derive(Resource, Clone, Debug, Default, PartialEq, Eq)]
pub struct CompressionReport {
    /// Bodies that are looked at.
    watched: Vec<u32>,
    /// Solid elements of every body that have a principal stretch below [`COMPRESSED`]; of a body that is not looked at,
    /// fibres that soften likewise.
    pub compressed_by_body: Vec<u64>,
}

impl CompressionReport {
    /// Elements of all bodies.
    pub fn compressed(&self) -> u64 {
        self.compressed_by_body.iter().sum()
    }

    /// Whether all elements of a body are looked at.
    pub fn is_watched(&self, body: u32) -> bool {
        self.watched.contains(&body)
    }

    /// Adds to the count of a body.
    pub fn add(&mut self, body: u32, count: u64) {
        if let Some(own) = self.compressed_by_body.get_mut(body as usize) {
            *own += count;
        }
    }
}

/// Has the elements of a body counted at the end of every step.
pub fn report_compression<S: Scalar>(world: &mut World, body: u32) {
    prepare::<S>(world);
    world.resource_mut::<CompressionReport>().watched.push(body);
}

/// Has a system [add](CompressionReport::add) to the counts at the end of every step.
pub fn report_compression_by<S: Scalar, M>(
    world: &mut World,
    count: impl IntoScheduleConfigs<ScheduleSystem, M>,
) {
    prepare::<S>(world);
    let mut schedules = world.resource_mut::<Schedules>();
    schedules.entry(StepSchedule).add_systems(
        count
            .after(measure_compression::<S>)
            .run_if(not(resource_exists::<ColumnsBehind>))
            .run_if(|failure: Res<StepFailure>| failure.0.is_none())
            .in_set(StepSystems::Report),
    );
}

fn prepare<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<CompressionReport>() {
        ensure::<CompressionReport>(world);
        let mut schedules = world.resource_mut::<Schedules>();
        schedules.entry(StepSchedule).add_systems(
            measure_compression::<S>
                .run_if(not(resource_exists::<ColumnsBehind>))
                .in_set(StepSystems::Report),
        );
    }
}

/// Whether no principal stretch of a displacement gradient is below [`COMPRESSED`]: the right Cauchy-Green tensor less the
/// square of that is positive definite, by its leading minors.
#[inline(always)]
fn is_intact<R: Real>(g: &[R; 9]) -> R::Mask {
    let left = R::from_f64(1.0 - COMPRESSED * COMPRESSED);
    let mut h = [R::ZERO; 6];
    for (i, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
        let mut sum = g[3 * a + b] + g[3 * b + a];
        for k in 0..3 {
            sum = g[3 * k + a].mul_add(g[3 * k + b], sum);
        }
        h[i] = if a == b { sum + left } else { sum };
    }
    let [xx, yy, zz, xy, xz, yz] = h;
    let second = minor(xx, yy, xy, xy);
    let third =
        xx * minor(yy, zz, yz, yz) - xy * minor(xy, zz, yz, xz) + xz * minor(xy, yz, yy, xz);
    let positive = R::both(R::less(R::ZERO, second), R::less(R::ZERO, third));
    R::both(R::less(R::ZERO, xx), positive)
}

struct Compressed<'a, S> {
    shapes: &'a TetrahedronShapes<'a, S>,
    counts: [f64; MAX_LANES],
}

impl<S: Scalar> Batch<S> for Compressed<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.shapes.displacements(first);
        let g = displacement_gradient(&self.shapes.gradients::<L>(first), &u);
        L::select(is_intact(&g), L::ZERO, L::ONE).accumulate(&mut self.counts);
    }
}

type OfPoints<'w, 's, N, R, F = ()> = Query<'w, 's, (&'static N, &'static R, &'static BodyId), F>;

/// Counts into [`CompressionReport`].
fn measure_compression<S: Scalar>(
    (workers, failure, topology, sleeping): (
        Res<Workers>,
        Res<StepFailure>,
        Res<Topology>,
        Res<SleepingBodies>,
    ),
    (mut report, points): (ResMut<CompressionReport>, Res<OwnPoints>),
    vertices: Query<&Displacement<S>>,
    tetrahedra: Query<(&TetrahedronVertices, ShapeGradients<S>, &BodyId)>,
    hexahedra: OfPoints<HexahedronVertices, HexahedronRest<S>, Without<CornerPoints>>,
    at_corners: OfPoints<HexahedronVertices, HexahedronRest<S>, With<CornerPoints>>,
    tens: OfPoints<Tetrahedron10Vertices, Tetrahedron10Rest<S>>,
) {
    if failure.0.is_some() || sleeping.everyone() {
        return;
    }
    let CompressionReport { watched, compressed_by_body } = &mut *report;
    compressed_by_body.resize(topology.bodies.len(), 0);
    let awake = compressed_by_body.iter_mut().enumerate().filter(|(i, _)| !sleeping.contains(*i));
    awake.for_each(|(_, count)| *count = 0);
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let mut add = |bodies: &[BodyId], work: usize, count: &(dyn Fn(Range<usize>) -> u64 + Sync)| {
        let mut first = 0;
        for own in bodies.chunk_by(|a, b| a == b) {
            let elements = first..first + own.len();
            first = elements.end;
            if watched.contains(&own[0].0) && !sleeping.contains(own[0].0 as usize) {
                compressed_by_body[own[0].0 as usize] += in_chunks(&workers, elements, work, count);
            }
        }
    };
    let tables = "element components are stored in tables";
    for (nodes, gradients, bodies) in tetrahedra.contiguous_iter().expect(tables) {
        let shapes = &TetrahedronShapes::new(u, nodes, gradients);
        add(bodies, 4, &|elements| {
            let batch = Compressed { shapes, counts: [0.0; MAX_LANES] };
            workers.dispatch(Batches(elements, batch)).counts.iter().sum::<f64>() as u64
        });
    }
    macro_rules! at_points {
        ($elements:expr, $derivatives:expr, $own:expr) => {
            let derivatives = (&$derivatives, &$own[..]);
            for (nodes, rest, bodies) in $elements.contiguous_iter().expect(tables) {
                add(bodies, 300, &|elements| {
                    let far = |&i: &usize| at_some_point(derivatives, u, &nodes[i].0, &rest[i]);
                    elements.filter(far).count() as u64
                });
            }
        };
    }
    at_points!(hexahedra, Derivatives::hexahedron(), points.bricks);
    at_points!(at_corners, Derivatives::hexahedron_corners(), points.bricks);
    at_points!(tens, Derivatives::tetrahedron10(), points.tens);
}

/// Sum over some elements, each of so much work (ns), chunk by chunk.
pub fn in_chunks(
    workers: &Workers,
    elements: Range<usize>,
    work: usize,
    count: &(dyn Fn(Range<usize>) -> u64 + Sync),
) -> u64 {
    const CHUNK: usize = 4096;
    let mut partial = vec![0; elements.len().div_ceil(CHUNK)];
    workers.for_each(&mut partial, elements.len() * work, |i, own| {
        let first = elements.start + i * CHUNK;
        *own = count(first..(first + CHUNK).min(elements.end));
    });
    partial.iter().sum()
}

/// Whether a solid element is compressed far at one of its Gauss points.
fn at_some_point<S: Scalar, const N: usize, const Q: usize>(
    derivatives: DerivativesAt<S, N, Q>,
    displacement: &[Displacement<S>],
    nodes: &[u32; N],
    rest: &PointsRest<S, Q>,
) -> bool {
    point_gradients(derivatives, displacement, nodes, rest).into_iter().any(|g| {
        let mut compressed = [S::ZERO];
        let zero = <S::One as Real>::ZERO;
        S::One::select(is_intact(&g), zero, <S::One as Real>::ONE).store(&mut compressed);
        compressed[0] > S::ZERO
    })
}
