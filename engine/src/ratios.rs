//! Deformed over rest volume or area of the elements: reports after a step, and what a reader asks for.

use crate::columns::single_table;
use crate::element::{
    MembraneIndex, MembraneRest, MembraneShapes, MembraneVertices, RestVolume, ShapeGradients,
    TetrahedronIndex, TetrahedronShapes, TetrahedronVertices, area_ratio, displacement_gradient,
    volume_change,
};
use crate::element_kind::ElementKind;
use crate::isoparametric::{
    CornerPoints, Derivatives, HexahedronIndex, HexahedronRest, HexahedronVertices, NO_OWN_POINTS,
    OwnPoints, PointsRest, QuadIndex, QuadRest, QuadVertices, Tetrahedron10Rest,
    Tetrahedron10Vertices, derivatives_of, load_points, point_differences, rows_of,
};
use crate::lanes::{Batch, Batches, Kernel, Lanes, MAX_LANES, padded};
use crate::law::SleepingBodies;
use crate::report::{AreaReport, SystemTimes, VolumeReport};
use crate::resource::ensure;
use crate::scalar::{Real, Scalar, xyz};
use crate::schedule::{StepSchedule, StepSystems};
use crate::step::StepFailure;
use crate::stopwatch::Stopwatch;
use crate::topology::Topology;
use crate::vertex::{BodyId, Displacement};
use crate::workers::Workers;
use bevy_ecs::prelude::*;
use bevy_ecs::system::SystemParam;
use bytemuck::TransparentWrapper;
use std::ops::Range;

/// Query data of hexahedra.
type HexahedraAtPoints<S> =
    (&'static HexahedronVertices, &'static HexahedronRest<S>, &'static BodyId);

/// What [`measure_volume_ratios`] reads and writes.
#[derive(SystemParam)]
pub struct VolumeMeasure<'w, 's, S: Scalar> {
    workers: Res<'w, Workers>,
    failure: Res<'w, StepFailure>,
    sleeping: Res<'w, SleepingBodies>,
    topology: Res<'w, Topology>,
    points: Res<'w, OwnPoints>,
    report: ResMut<'w, VolumeReport>,
    times: ResMut<'w, SystemTimes>,
    vertices: Query<'w, 's, &'static Displacement<S>>,
    tetrahedra: Query<'w, 's, (&'static TetrahedronVertices, ShapeGradients<S>, &'static BodyId)>,
    hexahedra: Query<'w, 's, HexahedraAtPoints<S>, Without<CornerPoints>>,
    hexahedra_at_corners: Query<'w, 's, HexahedraAtPoints<S>, With<CornerPoints>>,
    tens: Query<
        'w,
        's,
        (&'static Tetrahedron10Vertices, &'static Tetrahedron10Rest<S>, &'static BodyId),
    >,
}

/// Smallest `J` and inverted elements of the current state into [`VolumeReport`].
pub fn measure_volume_ratios<S: Scalar>(
    measure: VolumeMeasure<S>,
    mut partial: Local<Vec<Vec<(BodyId, f64, u64, u64)>>>,
) {
    const CHUNK: usize = 4096;
    let start = Stopwatch::start();
    let VolumeMeasure {
        workers, failure, sleeping, topology, points, mut report, mut times, ..
    } = measure;
    if failure.0.is_some() || sleeping.everyone() {
        return;
    }
    report.clear(topology.bodies.len(), |body| sleeping.contains(body));
    let asleep = |body: &BodyId| sleeping.contains(body.0 as usize);
    let Some(u) = single_table(measure.vertices.contiguous_iter()) else { return };
    // pooled and fused bodies keep their tetrahedra in a table each
    for (nodes, gradients, bodies) in
        measure.tetrahedra.contiguous_iter().expect("element components are stored in tables")
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
                first += length;
                if !asleep(&body) {
                    let (smallest, inverted) = workers.dispatch(VolumeRatios { shapes, elements });
                    runs.push((body, smallest, inverted, length as u64));
                }
            }
        });
        for &(body, smallest, inverted, count) in partial.iter().flatten() {
            report.add(body, smallest, inverted, count);
        }
    }
    macro_rules! at_points {
        ($elements:expr, $derivatives:expr, $own:expr) => {
            for (nodes, rest, bodies) in
                $elements.contiguous_iter().expect("element components are stored in tables")
            {
                let mut ratios = vec![f64::INFINITY; nodes.len()];
                let derivatives = (&$derivatives, &$own[..]);
                workers.for_chunks(&mut ratios, CHUNK, nodes.len() * 200, |first, ratios| {
                    for (i, ratio) in (first..).zip(ratios).filter(|(i, _)| !asleep(&bodies[*i])) {
                        let all = point_ratios(derivatives, u, &nodes[i].0, &rest[i]);
                        *ratio = all.into_iter().fold(f64::INFINITY, f64::min);
                    }
                });
                for (&smallest, body) in ratios.iter().zip(bodies).filter(|(_, of)| !asleep(of)) {
                    report.add(*body, smallest, u64::from(smallest <= 0.0), 1);
                }
            }
        };
    }
    at_points!(measure.hexahedra, Derivatives::hexahedron(), points.bricks);
    at_points!(measure.hexahedra_at_corners, Derivatives::hexahedron_corners(), points.bricks);
    at_points!(measure.tens, Derivatives::tetrahedron10(), points.tens);
    times.add("volume ratios", start.elapsed());
}

/// Derivatives at the points of elements, and those of elements that have points of their own.
pub type DerivativesAt<'a, S, const N: usize, const Q: usize> =
    (&'a Derivatives<S, N, 3, Q>, &'a [Derivatives<f64, N, 3, Q>]);

/// Ratio `J` of deformed to rest volume at the points of a solid element; 1 for a removed one.
pub fn point_ratios<S: Scalar, const N: usize, const Q: usize>(
    derivatives: DerivativesAt<S, N, Q>,
    displacement: &[Displacement<S>],
    nodes: &[u32; N],
    rest: &PointsRest<S, Q>,
) -> [f64; Q] {
    point_gradients(derivatives, displacement, nodes, rest).map(|g| {
        let mut ratio = [S::ZERO];
        (<S::One as Real>::ONE + volume_change(&g)).store(&mut ratio);
        ratio[0].to_f64()
    })
}

/// Displacement gradients at the Gauss points of a solid element.
pub(crate) fn point_gradients<S: Scalar, const N: usize, const Q: usize>(
    derivatives: DerivativesAt<S, N, Q>,
    displacement: &[Displacement<S>],
    nodes: &[u32; N],
    rest: &PointsRest<S, Q>,
) -> [[S::One; 9]; Q] {
    let u = rows_of(Displacement::peel_slice(displacement), nodes);
    let mut slot = None;
    let derivatives = derivatives_of(derivatives.0, derivatives.1, rest.own, &mut slot);
    std::array::from_fn(|q| {
        let at = point_differences::<S::One, 4, _, _, _>(derivatives, &u, q);
        displacement_gradient(&rest.gradients::<S::One>(q), &at)
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
        ensure::<AreaReport>(world);
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
        let at = point_differences::<S::One, 3, _, _, _>(derivatives, &u, q);
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

/// An element as it is now.
pub struct ElementNow<'a> {
    /// Its kind.
    pub kind: ElementKind,
    /// Its index in the user's mesh or list.
    pub index: u32,
    /// Deformed over rest volume or area at its points.
    pub ratios: &'a [f64],
    /// Rest volume (m^3) or area (m^2) that each of these stands for.
    pub sizes: &'a [f64],
}

impl ElementNow<'_> {
    /// Smallest of its ratios.
    pub fn smallest(&self) -> f64 {
        self.ratios.iter().copied().fold(f64::INFINITY, f64::min)
    }
}

/// Calls `with` with every element of a body, table by table.
pub fn each_element<S: Scalar>(world: &mut World, body: usize, mut with: impl FnMut(ElementNow)) {
    let mut vertices = world.query::<&Displacement<S>>();
    macro_rules! each {
        ($kind:ident: $data:ty, |$u:ident, $points:ident, ($($part:ident),+)| $ratios:expr) => {
            let mut elements = world.query::<(&BodyId, $data)>();
            let $points = world.get_resource::<OwnPoints>().unwrap_or(&NO_OWN_POINTS);
            if let Some($u) = single_table(vertices.contiguous_iter(world)) {
                let own = elements.iter(world).filter(|(of, _)| of.0 as usize == body);
                for (_, (index, $($part),+)) in own {
                    let (ratios, sizes) = $ratios;
                    let (kind, index) = (ElementKind::$kind, index.0);
                    with(ElementNow { kind, index, ratios: &ratios, sizes: &sizes });
                }
            }
        };
    }
    let bricks = [Derivatives::hexahedron(), Derivatives::hexahedron_corners()];
    let (ten, quad) = (Derivatives::tetrahedron10(), Derivatives::quad());
    each!(
        Tetrahedron: (&TetrahedronIndex, &TetrahedronVertices, ShapeGradients<S>, &RestVolume<S>),
        |u, _points, (nodes, gradients, volume)| {
            let (d1, d2, d3) = gradients;
            let gradients =
                [[d1.0.0, d1.1.0, d1.2.0], [d2.0.0, d2.1.0, d2.2.0], [d3.0.0, d3.1.0, d3.2.0]];
            let local = nodes.0.map(|v| xyz(u[v as usize].0));
            let change = volume_change(&displacement_gradient(&gradients, &local)).to_f64();
            ([1.0 + change], [volume.0.to_f64()])
        }
    );
    each!(
        Hexahedron: (&HexahedronIndex, &HexahedronVertices, &HexahedronRest<S>, Has<CornerPoints>),
        |u, points, (nodes, rest, at_corners)| {
            let derivatives = (&bricks[usize::from(at_corners)], &points.bricks[..]);
            (point_ratios(derivatives, u, &nodes.0, rest), rest.volume.map(S::to_f64))
        }
    );
    each!(
        Tetrahedron: (&TetrahedronIndex, &Tetrahedron10Vertices, &Tetrahedron10Rest<S>),
        |u, points, (nodes, rest)| {
            (point_ratios((&ten, &points.tens), u, &nodes.0, rest), rest.volume.map(S::to_f64))
        }
    );
    each!(
        Triangle: (&MembraneIndex, &MembraneVertices, MembraneRest<S>),
        |u, _points, (nodes, rest)| {
            let (a, b, area) = rest;
            let edges = [[a.0.0, a.1.0, a.2.0], [b.0.0, b.1.0, b.2.0]];
            let local = nodes.0.map(|v| xyz(u[v as usize].0));
            ([area_ratio(&edges, area.0, &local).to_f64()], [area.0.to_f64()])
        }
    );
    each!(
        Quad: (&QuadIndex, &QuadVertices, &QuadRest<S>),
        |u, _points, (nodes, rest)| {
            (quad_ratios(&quad, u, *nodes, rest), rest.half_area.map(|half| 2.0 * half.to_f64()))
        }
    );
}
