//! Biquadratic springs pooled over the mesh (Delingette 2008, section 3): one tensile spring per
//! edge, three angular springs per triangle, three volumetric springs per tetrahedron, whose
//! constants are sums over the adjacent tetrahedra.
//!
//! Every spring is a law on changes of squared edge length `delta`, so the pipeline works on
//! scalars:
//!
//! 1. `measure_edges` writes `delta` per edge;
//! 2. `evaluate_tensile`, `evaluate_angular`, `evaluate_volumetric` (and the compression term of
//!    [`crate::laws::svk::Compression`]) each read it and write tensions into their own column or the
//!    private arrays of their own ranges. They share nothing they write, so they may run in any order
//!    or side by side;
//! 3. `collect_tension` adds the tensions `s_e = dW/d delta_e` per edge, range by range;
//! 4. `evaluate_spring_forces` turns tension into forces `f_a = -2 sum s_e (x_a - x_b)`.
//!
//! Each law also gives its share of the tangent `K = J^T B J + 2 L(s) (x) I`, where row e of `J` is
//! `2 (x_a - x_b)^T` at a and the negative at b, and `L(s)` is the graph Laplacian with weights `s`.
//!
//! Tensions go to private arrays over a short span of edges, as forces do over rows: adding to them
//! is cheaper than a list per edge of the triangles and tetrahedra round it, and is the same sum for
//! any number of threads.

use bevy_ecs::prelude::*;
use bevy_ecs::system::{ScheduleSystem, SystemParam};
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    EdgeBlock, EdgeChange, EdgeShapes, EdgeTension, EdgeVertices, RestEdge, RestEdges,
    TETRAHEDRON_EDGES, TetrahedronBlocks, TetrahedronEdges, TetrahedronVertices, TriangleEdges,
};
use sinew_engine::lanes::{Batch, Batches, Lanes, MAX_LANES};
use sinew_engine::law::{
    DisabledLaws, EvaluationRequest, LawBuffer, LawBuffers, LawInfo, Partition, RecoveringBodies,
    Span, TangentKind,
};
use sinew_engine::report::SystemTimes;
use sinew_engine::scalar::{Real, Scalar, Single, add, dot, scale, sub};
use sinew_engine::schedule::{
    ForceSystems, Input, activate_law_of_systems, activate_systems, declare_inputs,
};
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::ops::Range;

use crate::element::matrix::{add_identity, add_outer};
use crate::element::precompute::OPPOSITE_EDGES;
use crate::element::spring::{coupling_energy, edge_force, tensile_energy, tensile_tension};
use crate::element::tetrahedron::TetrahedronTangent;
use crate::frame::columns::{
    LawColumns, TangentSum, evaluate_span, load_vertices, scalar_columns, work,
};
use crate::frame::row::{ElementRows, Elements, LawRow, PlacedLaw, mark, partition};
use crate::frame::tetrahedra::add_tangent;

/// Vertex rows of a triangle, ascending.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct TriangleVertices(pub [u32; 3]);

impl ElementRows for TriangleVertices {
    fn vertex_rows(&self) -> &[u32] {
        &self.0
    }
}

scalar_columns! {
    /// Tensile stiffness `k` of an edge (N/m^3).
    TensileStiffness,
    /// Angular stiffness (N/m^3) of a triangle that couples the two edges meeting at its vertex `VERTEX`
    /// (0, 1, 2).
    AngularStiffness<VERTEX>,
    /// Volumetric stiffness `d` (N/m^3) of a tetrahedron for pair `PAIR` of opposite edges, in the order of
    /// [`OPPOSITE_PAIRS`](crate::element::precompute::OPPOSITE_PAIRS).
    VolumetricStiffness<PAIR>,
}

/// Tension (N/m) of the tensile spring of an edge.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct TensileTension<S: Scalar>(pub S);

/// All three columns of [`AngularStiffness`]: query data.
pub type AngularStiffnesses<S> = (
    &'static AngularStiffness<S, 0>,
    &'static AngularStiffness<S, 1>,
    &'static AngularStiffness<S, 2>,
);

/// All three columns of [`VolumetricStiffness`]: query data.
pub type VolumetricStiffnesses<S> = (
    &'static VolumetricStiffness<S, 0>,
    &'static VolumetricStiffness<S, 1>,
    &'static VolumetricStiffness<S, 2>,
);

/// Tensile springs on edges: energy and tangent.
pub static TENSILE: LawRow = LawRow::of_systems(
    LawInfo::elastic("tensile springs"),
    Elements::PooledEdges,
    [mark::<TensileTension<f64>>, mark::<TensileTension<Single>>],
    [activate_tensile::<f64>, activate_tensile::<Single>],
)
.with_tangent(is_spring_tangent);
/// Angular springs in triangles: energy and tangent.
pub static ANGULAR: LawRow = LawRow::of_systems(
    LawInfo::elastic("angular springs"),
    Elements::PooledTriangles,
    [mark::<TriangleVertices>; 2],
    [activate_angular::<f64>, activate_angular::<Single>],
)
.with_tangent(is_spring_tangent);
/// Volumetric springs in tetrahedra: energy and tangent.
pub static VOLUMETRIC: LawRow = LawRow::of_systems(
    LawInfo::elastic("volumetric springs"),
    Elements::PooledTetrahedra,
    [mark::<TetrahedronEdges>; 2],
    [activate_volumetric::<f64>, activate_volumetric::<Single>],
)
.with_tangent(is_spring_tangent);
/// Edge tensions of all springs turned into forces.
pub static SPRING_FORCES: LawRow = LawRow::of_systems(
    LawInfo::elastic("spring forces"),
    Elements::PooledEdges,
    [mark::<TensileTension<f64>>, mark::<TensileTension<Single>>],
    [activate_spring_forces::<f64>, activate_spring_forces::<Single>],
)
.with_tangent(|_| false);

/// Rows of the pooled springs.
pub(crate) static SPRINGS: [&LawRow; 4] = [&TENSILE, &ANGULAR, &VOLUMETRIC, &SPRING_FORCES];

/// Measures the edges, once for all springs.
fn activate_edges<S: Scalar>(world: &mut World) -> [Input; 4] {
    let inputs = [
        Input::column::<EdgeVertices>(world),
        Input::column::<RestEdge<S, 0>>(world),
        Input::column::<RestEdge<S, 1>>(world),
        Input::column::<RestEdge<S, 2>>(world),
    ];
    activate_systems(world, EDGE_CHANGES, |schedule| {
        schedule.add_systems(measure_edges::<S>.in_set(ForceSystems::Measure));
    });
    declare_inputs(world, EDGE_CHANGES, &inputs);
    inputs
}

fn activate_tensile<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_edges::<S>(world);
    let system = evaluate_tensile::<S>.in_set(ForceSystems::Evaluate);
    let stiffness = Input::column::<TensileStiffness<S>>(world);
    activate_springs(world, law, partition::<EdgeVertices, S>, system, &[stiffness]);
}

fn activate_angular<S: Scalar>(world: &mut World, law: PlacedLaw) {
    let stiffness = [
        Input::column::<AngularStiffness<S, 0>>(world),
        Input::column::<AngularStiffness<S, 1>>(world),
        Input::column::<AngularStiffness<S, 2>>(world),
    ];
    let evaluate = evaluate_angular::<S>;
    activate_coupling::<TriangleVertices, TriangleEdges, S, _>(world, law, evaluate, stiffness);
}

fn activate_volumetric<S: Scalar>(world: &mut World, law: PlacedLaw) {
    let stiffness = [
        Input::column::<VolumetricStiffness<S, 0>>(world),
        Input::column::<VolumetricStiffness<S, 1>>(world),
        Input::column::<VolumetricStiffness<S, 2>>(world),
    ];
    let evaluate = evaluate_volumetric::<S>;
    activate_coupling::<TetrahedronVertices, TetrahedronEdges, S, _>(
        world, law, evaluate, stiffness,
    );
}

/// Puts springs that couple edges into the schedule: those of elements with vertices `V` and edges `E`.
fn activate_coupling<V: ElementRows, E: PullsOnEdges, S: Scalar, M>(
    world: &mut World,
    law: PlacedLaw,
    evaluate: impl IntoScheduleConfigs<ScheduleSystem, M>,
    [a, b, c]: [Input; 3],
) {
    let cut: Partition<S> = |world, mark, buffer| {
        partition::<V, S>(world, mark, buffer);
        find_edges::<E, S>(world, buffer);
    };
    let edges = Input::column::<E>(world);
    let system = evaluate.in_set(ForceSystems::Evaluate);
    activate_springs(world, law, cut, system, &[edges, a, b, c]);
}

/// Puts the systems of a law of springs into the schedule, with what they read.
fn activate_springs<S: Scalar, M>(
    world: &mut World,
    PlacedLaw { row, place }: PlacedLaw,
    cut: Partition<S>,
    systems: impl IntoScheduleConfigs<ScheduleSystem, M>,
    inputs: &[Input],
) {
    let elements = (Some(row.mark::<S>(world)), cut);
    activate_law_of_systems(world, (row.info, place), elements, |schedule, _| {
        schedule.add_systems(systems);
    });
    declare_inputs(world, row.info.name, inputs);
}

fn activate_spring_forces<S: Scalar>(world: &mut World, law: PlacedLaw) {
    let inputs = activate_edges::<S>(world);
    let systems = (collect_tension::<S>, evaluate_spring_forces::<S>).chain();
    let systems = systems.in_set(ForceSystems::Collect);
    activate_springs(world, law, partition::<EdgeVertices, S>, systems, &inputs);
}

/// Elements whose springs pull on rows of the edge table.
trait PullsOnEdges: Component {
    fn edges(&self) -> &[u32];
}

impl PullsOnEdges for TriangleEdges {
    fn edges(&self) -> &[u32] {
        &self.0
    }
}

impl PullsOnEdges for TetrahedronEdges {
    fn edges(&self) -> &[u32] {
        &self.0
    }
}

/// Tells the ranges of a law of springs which edge-table rows they pull on.
fn find_edges<C: PullsOnEdges, S: Scalar>(world: &mut World, buffer: &mut LawBuffer<S>) {
    let mut elements = world.query::<&C>();
    if let Some(column) = single_table(elements.contiguous_iter(world)) {
        for span in &mut buffer.spans {
            let own = || column[span.elements.clone()].iter().flat_map(C::edges);
            let (low, high) = (own().min(), own().max());
            span.edges = low.map_or(0, |&e| e as usize)..high.map_or(0, |&e| e as usize + 1);
        }
    }
}

/// Name of the systems that measure edges and collect their tensions.
pub const EDGE_CHANGES: &str = "edge changes";

const ROW_CHUNK: usize = 2048;

/// The projected tangent is formed elsewhere ([`crate::laws::svk::PooledProjection`]).
fn is_spring_tangent(kind: TangentKind) -> bool {
    kind != TangentKind::Projected
}

fn measure_edges<S: Scalar>(
    workers: Res<Workers>,
    vertices: Query<&Displacement<S>>,
    mut edges: Query<(&EdgeVertices, RestEdges<S>, &mut EdgeChange<S>)>,
    mut times: ResMut<SystemTimes>,
) {
    let start = Stopwatch::start();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((nodes, rest, mut change)) = single_table(edges.contiguous_iter_mut()) else { return };
    let shapes = &EdgeShapes::new(u, nodes, rest);
    let change = EdgeChange::peel_slice_mut(change.bypass_change_detection());
    workers.for_chunks(change, ROW_CHUNK, nodes.len() * 2, |first, rows| {
        workers.dispatch(Batches(0..rows.len(), Measure { shapes, row: first, change: rows }));
    });
    times.add(EDGE_CHANGES, start.elapsed());
}

struct Measure<'a, S> {
    shapes: &'a EdgeShapes<'a, S>,
    /// Edge of the first entry of `change`.
    row: usize,
    change: &'a mut [S],
}

impl<S: Scalar> Batch<S> for Measure<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let rest = self.shapes.rest::<L>(self.row + first);
        let u = self.shapes.relative::<L>(self.row + first);
        // the form of `spring::squared_length_change`, on relative displacements
        dot(u, add(add(rest, rest), u)).store(&mut self.change[first..]);
    }
}

/// What every system of springs reads.
#[derive(SystemParam)]
struct Springs<'w, S: Scalar> {
    request: Res<'w, EvaluationRequest>,
    workers: Res<'w, Workers>,
    recovering: Res<'w, RecoveringBodies>,
    buffers: Res<'w, LawBuffers<S>>,
    disabled: Res<'w, DisabledLaws>,
}

impl<S: Scalar> Springs<'_, S> {
    /// Energy and tangent of every range, after `pull` where forces are asked for; `cost` is that of
    /// [`work`].
    fn evaluate<C: LawColumns<S>>(
        &self,
        columns: &C,
        count: usize,
        cost: [usize; 3],
        buffer: &mut LawBuffer<S>,
        pull: impl Fn(&mut Span<S>) + Send + Sync,
    ) {
        let tangent = self.request.tangent.filter(|&kind| is_spring_tangent(kind));
        let own = EvaluationRequest { tangent, ..*self.request };
        let without_force = EvaluationRequest { force: false, ..own };
        buffer.for_each_awake(&self.workers, count * work(&own, cost), |_, span| {
            if own.force {
                pull(span);
            }
            if self.recovering.contains(span.body) {
                span.silence();
            } else {
                evaluate_span(columns, &without_force, &self.workers, span);
            }
        });
    }
}

fn evaluate_tensile<S: Scalar>(
    with: Springs<S>,
    vertices: Query<&Displacement<S>>,
    mut edges: Query<(
        &EdgeVertices,
        &EdgeBlock,
        RestEdges<S>,
        &EdgeChange<S>,
        &TensileStiffness<S>,
        &mut TensileTension<S>,
    )>,
) {
    let start = Stopwatch::start();
    let Some(mut buffer) = with.buffers.get(TENSILE.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((nodes, block, rest, change, stiffness, mut tension)) =
        single_table(edges.contiguous_iter_mut())
    else {
        return;
    };
    let columns = &TensileColumns {
        shapes: EdgeShapes::new(u, nodes, rest),
        block: EdgeBlock::peel_slice(block),
        change: EdgeChange::peel_slice(change),
        stiffness: TensileStiffness::peel_slice(stiffness),
    };
    let tension = TensileTension::peel_slice_mut(tension.bypass_change_detection());
    if with.disabled.contains(TENSILE.info.name) {
        tension.fill(S::ZERO);
        return;
    }
    if with.request.force {
        with.workers.for_chunks(tension, ROW_CHUNK, nodes.len(), |first, rows| {
            let batch = TensilePull { columns, row: first, tension: rows };
            with.workers.dispatch(Batches(0..batch.tension.len(), batch));
        });
    }
    with.evaluate(columns, nodes.len(), [1, 0, 10], &mut buffer, |_| {});
    buffer.time = start.elapsed();
}

struct TensileColumns<'a, S> {
    shapes: EdgeShapes<'a, S>,
    block: &'a [u32],
    change: &'a [S],
    stiffness: &'a [S],
}

struct TensilePull<'a, S> {
    columns: &'a TensileColumns<'a, S>,
    row: usize,
    tension: &'a mut [S],
}

impl<S: Scalar> Batch<S> for TensilePull<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let from = self.row + first;
        let k = L::load(&self.columns.stiffness[from..]);
        let delta = L::load(&self.columns.change[from..]);
        tensile_tension(k, delta).store(&mut self.tension[first..]);
    }
}

impl<S: Scalar> LawColumns<S> for TensileColumns<'_, S> {
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let k = L::load(&self.stiffness[first..]);
        let delta = L::load(&self.change[first..]);
        tensile_energy(k, delta).accumulate(sums);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let k = L::load(&self.stiffness[first..]);
        let d = add(self.shapes.rest::<L>(first), self.shapes.relative::<L>(first));
        let mut m = [L::ZERO; 9];
        add_outer(&mut m, scale(d, k + k), d);
        if to.kind == TangentKind::Exact {
            // twice the tension k/2 delta
            add_identity(&mut m, k * L::load(&self.change[first..]));
        }
        add_edge_tangent(m, to.span, self.shapes.nodes, self.block, first);
    }
}

/// Adds the block `m` of the edges from `first` on: on the diagonal of both ends, and its negative
/// between them.
#[inline(always)]
pub(crate) fn add_edge_tangent<L: Lanes>(
    mut m: [L; 9],
    span: &mut Span<L::Scalar>,
    nodes: &[[u32; 2]],
    block: &[u32],
    first: usize,
) {
    let nodes = &nodes[first..];
    L::add_blocks(&m, &mut span.diagonal, span.rows.start, nodes, 0);
    L::add_blocks(&m, &mut span.diagonal, span.rows.start, nodes, 1);
    for x in &mut m {
        *x = -*x;
    }
    let (block, _) = block[first..].as_chunks::<1>();
    L::add_blocks(&m, &mut span.off_diagonal, span.blocks.start, block, 0);
}

fn evaluate_angular<S: Scalar>(
    with: Springs<S>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(&EdgeBlock, RestEdges<S>, &EdgeChange<S>)>,
    triangles: Query<(&TriangleVertices, &TriangleEdges, AngularStiffnesses<S>)>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((block, rest, change)) = single_table(edges.contiguous_iter()) else { return };
    let Some((nodes, of, (c0, c1, c2))) = single_table(triangles.contiguous_iter()) else { return };
    let columns = CouplingColumns {
        edges: EdgeShapes::new(u, &[], rest),
        change: EdgeChange::peel_slice(change),
        nodes: TriangleVertices::peel_slice(nodes),
        of: TriangleEdges::peel_slice(of),
        stiffness: [
            AngularStiffness::peel_slice(c0),
            AngularStiffness::peel_slice(c1),
            AngularStiffness::peel_slice(c2),
        ],
        coupling: Angular { block: EdgeBlock::peel_slice(block) },
    };
    evaluate_coupling(&with, ANGULAR.info.name, &columns);
}

fn evaluate_volumetric<S: Scalar>(
    with: Springs<S>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(RestEdges<S>, &EdgeChange<S>)>,
    tetrahedra: Query<(
        &TetrahedronVertices,
        &TetrahedronEdges,
        &TetrahedronBlocks,
        VolumetricStiffnesses<S>,
    )>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((rest, change)) = single_table(edges.contiguous_iter()) else { return };
    let Some((nodes, of, blocks, (d0, d1, d2))) = single_table(tetrahedra.contiguous_iter()) else {
        return;
    };
    let columns = CouplingColumns {
        edges: EdgeShapes::new(u, &[], rest),
        change: EdgeChange::peel_slice(change),
        nodes: TetrahedronVertices::peel_slice(nodes),
        of: TetrahedronEdges::peel_slice(of),
        stiffness: [
            VolumetricStiffness::peel_slice(d0),
            VolumetricStiffness::peel_slice(d1),
            VolumetricStiffness::peel_slice(d2),
        ],
        coupling: Volumetric { blocks: TetrahedronBlocks::peel_slice(blocks) },
    };
    evaluate_coupling(&with, VOLUMETRIC.info.name, &columns);
}

/// Tensions, energy and tangent of every range.
fn evaluate_coupling<C: Coupling<V, E>, S: Scalar, const V: usize, const E: usize>(
    with: &Springs<S>,
    name: &str,
    columns: &CouplingColumns<C, S, V, E>,
) {
    let start = Stopwatch::start();
    let Some(mut buffer) = with.buffers.get(name) else { return };
    if with.disabled.contains(name) {
        buffer.spans.iter_mut().for_each(Span::clear_tension);
        return;
    }
    with.evaluate(columns, columns.nodes.len(), [2, 4, 30], &mut buffer, |span| {
        span.clear_tension();
        let (first_edge, tension) = (span.edges.start, &mut span.tension[..]);
        let batch = PullBatch { columns, first_edge, tension };
        with.workers.dispatch(Batches(span.elements.clone(), batch));
    });
    buffer.time = start.elapsed();
}

/// Elements of `V` vertices and `E` edges whose springs couple edges.
struct CouplingColumns<'a, C, S, const V: usize, const E: usize> {
    /// Rest vectors of the edge table, and all displacements.
    edges: EdgeShapes<'a, S>,
    /// Squared-length changes of the edge table.
    change: &'a [S],
    nodes: &'a [[u32; V]],
    /// Edge-table rows.
    of: &'a [[u32; E]],
    stiffness: [&'a [S]; 3],
    coupling: C,
}

impl<C, S: Scalar, const V: usize, const E: usize> CouplingColumns<'_, C, S, V, E> {
    /// Squared-length changes of the edges of the elements from `first` on.
    #[inline(always)]
    fn changes<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; E] {
        L::gather(self.change, &self.of[first..])
    }

    #[inline(always)]
    fn stiffness<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; 3] {
        let [a, b, c] = self.stiffness;
        [L::load(&a[first..]), L::load(&b[first..]), L::load(&c[first..])]
    }

    /// The first deformed edges, lower row minus higher; `ends` are their local vertices in that order.
    #[inline(always)]
    fn first_edges<L: Lanes<Scalar = S>, const N: usize>(
        &self,
        first: usize,
        ends: &[[usize; 2]; N],
    ) -> [[L; 3]; N] {
        let nodes = &self.nodes[first..];
        let [x, y, z] = self.edges.rest;
        let of = &self.of[first..];
        let rest = [L::gather(x, of), L::gather(y, of), L::gather(z, of)];
        let u = load_vertices::<L, V>(self.edges.displacement, nodes);
        let mut d = [[L::ZERO; 3]; N];
        for e in 0..N {
            let [a, b] = ends[e];
            for x in 0..3 {
                d[e][x] = u[a][x] - u[b][x] + rest[x][e];
            }
        }
        d
    }
}

/// How the springs of an element couple its edges.
trait Coupling<const V: usize, const E: usize>: Sync + Sized {
    /// Energy (J) from the changes of squared length.
    fn energy<R: Real>(stiffness: [R; 3], delta: [R; E]) -> R;
    /// Tensions (N/m).
    fn tensions<R: Real>(stiffness: [R; 3], delta: [R; E]) -> [R; E];
    /// Adds the tangents of the elements from `first` on, whose edges have the tensions `s`.
    fn add_tangent<L: Lanes>(
        columns: &CouplingColumns<Self, L::Scalar, V, E>,
        first: usize,
        s: [L; E],
        span: &mut Span<L::Scalar>,
    );
}

impl<C: Coupling<V, E>, S: Scalar, const V: usize, const E: usize> LawColumns<S>
    for CouplingColumns<'_, C, S, V, E>
{
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let delta = self.changes::<L>(first);
        C::energy(self.stiffness::<L>(first), delta).accumulate(sums);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let mut s = [L::ZERO; E];
        if to.kind == TangentKind::Exact {
            s = C::tensions(self.stiffness::<L>(first), self.changes::<L>(first));
        }
        C::add_tangent(self, first, s, to.span);
    }
}

struct PullBatch<'a, 'b, C, S, const V: usize, const E: usize> {
    columns: &'a CouplingColumns<'b, C, S, V, E>,
    first_edge: usize,
    tension: &'a mut [S],
}

impl<C: Coupling<V, E>, S: Scalar, const V: usize, const E: usize> Batch<S>
    for PullBatch<'_, '_, C, S, V, E>
{
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let delta = self.columns.changes::<L>(first);
        let s = C::tensions(self.columns.stiffness::<L>(first), delta);
        L::add_at(s, self.tension, self.first_edge, &self.columns.of[first..]);
    }
}

/// Local vertices of edge `i` of a triangle with ascending rows, lower row first.
const TRIANGLE_ENDS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// Springs between the edges of triangles: stiffness `m` couples the two edges other than `m`.
struct Angular<'a> {
    /// Tangent blocks of the edge table.
    block: &'a [u32],
}

impl Coupling<3, 3> for Angular<'_> {
    #[inline(always)]
    fn energy<R: Real>(c: [R; 3], d: [R; 3]) -> R {
        coupling_energy(c[0], d[1], d[2])
            + coupling_energy(c[1], d[2], d[0])
            + coupling_energy(c[2], d[0], d[1])
    }
    #[inline(always)]
    fn tensions<R: Real>(c: [R; 3], delta: [R; 3]) -> [R; 3] {
        let half = R::from_f64(0.5);
        let c = [half * c[0], half * c[1], half * c[2]];
        [
            c[1].mul_add(delta[2], c[2] * delta[1]),
            c[2].mul_add(delta[0], c[0] * delta[2]),
            c[0].mul_add(delta[1], c[1] * delta[0]),
        ]
    }
    #[inline(always)]
    fn add_tangent<L: Lanes>(
        columns: &CouplingColumns<Self, L::Scalar, 3, 3>,
        first: usize,
        s: [L; 3],
        span: &mut Span<L::Scalar>,
    ) {
        let c = columns.stiffness::<L>(first);
        let d = columns.first_edges::<L, 3>(first, &TRIANGLE_ENDS);
        let nodes = &columns.nodes[first..];
        let mut blocks = [[0; 3]; MAX_LANES];
        for lane in 0..L::COUNT {
            for e in 0..3 {
                blocks[lane][e] = columns.coupling.block[columns.of[first + lane][e] as usize];
            }
        }
        for a in 0..3 {
            for b in a..3 {
                // sum of 2 c d_e d_f^T over the edges e at a and f at b that a spring couples
                let mut m = [L::ZERO; 9];
                for e in 0..3 {
                    for f in 0..3 {
                        if e == a || f == b || e == f {
                            continue;
                        }
                        let same = (TRIANGLE_ENDS[e][0] == a) == (TRIANGLE_ENDS[f][0] == b);
                        let twice = c[3 - e - f] + c[3 - e - f];
                        add_outer(&mut m, scale(d[e], if same { twice } else { -twice }), d[f]);
                    }
                }
                if a == b {
                    let pull = s[(a + 1) % 3] + s[(a + 2) % 3];
                    add_identity(&mut m, pull + pull);
                    L::add_blocks(&m, &mut span.diagonal, span.rows.start, nodes, a);
                } else {
                    let e = 3 - a - b;
                    add_identity(&mut m, -(s[e] + s[e]));
                    L::add_blocks(&m, &mut span.off_diagonal, span.blocks.start, &blocks, e);
                }
            }
        }
    }
}

/// Springs between opposite edges of tetrahedra.
struct Volumetric<'a> {
    /// Tangent blocks of the edges.
    blocks: &'a [[u32; 6]],
}

impl Coupling<4, 6> for Volumetric<'_> {
    #[inline(always)]
    fn energy<R: Real>(d: [R; 3], delta: [R; 6]) -> R {
        let mut energy = R::ZERO;
        for m in 0..3 {
            let [p, q] = OPPOSITE_EDGES[m];
            energy += coupling_energy(d[m], delta[p], delta[q]);
        }
        energy
    }
    #[inline(always)]
    fn tensions<R: Real>(d: [R; 3], delta: [R; 6]) -> [R; 6] {
        let mut s = [R::ZERO; 6];
        for m in 0..3 {
            let [p, q] = OPPOSITE_EDGES[m];
            let half = R::from_f64(0.5) * d[m];
            s[p] = half * delta[q];
            s[q] = half * delta[p];
        }
        s
    }
    #[inline(always)]
    fn add_tangent<L: Lanes>(
        columns: &CouplingColumns<Self, L::Scalar, 4, 6>,
        first: usize,
        s: [L; 6],
        span: &mut Span<L::Scalar>,
    ) {
        let stiffness = columns.stiffness::<L>(first);
        // vertex 0 is the lowest row, so its edges run as stored; the others are differences
        let mut d = [[L::ZERO; 3]; 6];
        d[..3].copy_from_slice(&columns.first_edges::<L, 3>(first, &[[0, 1], [0, 2], [0, 3]]));
        for e in 3..6 {
            let [a, b] = TETRAHEDRON_EDGES[e];
            d[e] = sub(d[b - 1], d[a - 1]);
        }
        let mut t = TetrahedronTangent { diagonal: [[L::ZERO; 9]; 4], off: [[L::ZERO; 9]; 6] };
        for own in 0..6 {
            let [a, b] = TETRAHEDRON_EDGES[own];
            // the two pairs whose edges join a and b through a third vertex each: e at a, f at b
            for e in 0..6 {
                let f = 5 - e;
                let (at_a, at_b) = (TETRAHEDRON_EDGES[e], TETRAHEDRON_EDGES[f]);
                if e == own || !at_a.contains(&a) || !at_b.contains(&b) {
                    continue;
                }
                let same = (at_a[0] == a) == (at_b[0] == b);
                let m = if e < f { e } else { f };
                let twice = stiffness[m] + stiffness[m];
                let c = if same { twice } else { -twice };
                add_outer(&mut t.off[own], scale(d[e], c), d[f]);
            }
            let twice = s[own] + s[own];
            add_identity(&mut t.diagonal[a], twice);
            add_identity(&mut t.diagonal[b], twice);
            add_identity(&mut t.off[own], -twice);
        }
        add_tangent(&mut t, span, &columns.nodes[first..], &columns.coupling.blocks[first..]);
    }
}

fn collect_tension<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    buffers: Res<LawBuffers<S>>,
    mut edges: Query<(&TensileTension<S>, &mut EdgeTension<S>)>,
    mut times: ResMut<SystemTimes>,
) {
    if !request.force {
        return;
    }
    let start = Stopwatch::start();
    let Some((tensile, mut tension)) = single_table(edges.contiguous_iter_mut()) else { return };
    let tensile = TensileTension::peel_slice(tensile);
    let tension = EdgeTension::peel_slice_mut(tension.bypass_change_detection());
    let pulls = [buffers.get(ANGULAR.info.name), buffers.get(VOLUMETRIC.info.name)];
    let spans = || pulls.iter().flatten().flat_map(|buffer| &buffer.spans);
    workers.for_chunks(tension, ROW_CHUNK, tensile.len() * 2, |first, rows| {
        rows.copy_from_slice(&tensile[first..first + rows.len()]);
        for span in spans() {
            let low = span.edges.start.max(first);
            let high = span.edges.end.min(first + rows.len());
            if low < high {
                let from = &span.tension[low - span.edges.start..high - span.edges.start];
                let sum = AddColumn { from, to: &mut rows[low - first..high - first] };
                workers.dispatch(Batches(0..from.len(), sum));
            }
        }
    });
    times.add("edge tensions", start.elapsed());
}

struct AddColumn<'a, S> {
    from: &'a [S],
    to: &'a mut [S],
}

impl<S: Scalar> Batch<S> for AddColumn<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let sum = L::load(&self.to[first..]) + L::load(&self.from[first..]);
        sum.store(&mut self.to[first..]);
    }
}

fn evaluate_spring_forces<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    recovering: Res<RecoveringBodies>,
    buffers: Res<LawBuffers<S>>,
    vertices: Query<&Displacement<S>>,
    edges: Query<(&EdgeVertices, RestEdges<S>, &EdgeTension<S>)>,
) {
    if !request.force {
        return;
    }
    let start = Stopwatch::start();
    let Some(mut buffer) = buffers.get(SPRING_FORCES.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((nodes, rest, tension)) = single_table(edges.contiguous_iter()) else { return };
    let shapes = &EdgeShapes::new(u, nodes, rest);
    let tension = EdgeTension::peel_slice(tension);
    buffer.for_each_awake(&workers, nodes.len() * 3, |_, span: &mut Span<S>| {
        span.clear_force();
        if recovering.contains(span.body) {
            return;
        }
        let elements: Range<usize> = span.elements.clone();
        let (force, row) = (&mut span.force[..], span.rows.start);
        workers.dispatch(Batches(elements, SpringForceBatch { shapes, tension, force, row }));
    });
    buffer.time = start.elapsed();
}

struct SpringForceBatch<'a, S> {
    shapes: &'a EdgeShapes<'a, S>,
    tension: &'a [S],
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
}

impl<S: Scalar> Batch<S> for SpringForceBatch<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let d = add(self.shapes.rest::<L>(first), self.shapes.relative::<L>(first));
        let f = edge_force(L::load(&self.tension[first..]), d);
        let nodes = &self.shapes.nodes[first..];
        L::add_rows(f, self.force, self.row, nodes, 0);
        L::add_rows([-f[0], -f[1], -f[2]], self.force, self.row, nodes, 1);
    }
}
