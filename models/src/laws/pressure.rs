//! Follower pressure: on every triangle of a surface, pressure times deformed area along the normal,
//! a third to each vertex.
//!
//! With deformed edges `d_1 = x_1 - x_0`, `d_2 = x_2 - x_0`, rest edges `E_a`, displacements `u` relative to
//! rest, `w_a = d_a - E_a` and mean displacement `m`:
//!
//! ```text
//! f_0 = f_1 = f_2 = p/3 a,   a = d_1 x d_2 / 2                                    (N)
//! V   = m . (a_0 + a_1/2 + a_2/3)                                                 (m^3)
//!       a_0 = E_1 x E_2 / 2,  a_1 = (E_1 x w_2 + w_1 x E_2)/2,  a_2 = w_1 x w_2 / 2
//! K   = symmetric part of -df/dx:  K_12 = -p/12 skew(x_1 + x_2 - 2 x_0), cyclic;  K_aa = 0
//! ```
//!
//! `V` is the volume that the triangle sweeps on the straight way from rest, so that of a surface is the
//! change of the volume behind it; displacements alone enter, so nothing cancels. Where the surface is
//! closed, or its rim is held (at least within planes that the volume ends at), `-p V` is a potential of
//! the forces, and the antisymmetric parts of `-df/dx` of neighbouring triangles cancel: the tangent is
//! exact. On a rim that is free to move the pressure is no conservative force; its work still is `p`
//! times the swept volume along the way, but `-p V` and the symmetric tangent are approximations there: the
//! line search of Newton may then end without converging (which is reported), and the energy bound of the
//! safe step holds for the approximate potential only.
//!
//! The tangent is indefinite by itself, and left out of the semidefinite stand-ins.
//!
//! The potential is booked apart from elastic energy ([`LawInfo::is_load`]).

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{
    DisabledLaws, EvaluationRequest, LawBuffer, LawBuffers, LawInfo, RecoveringBodies, Span,
    TangentKind,
};
use sinew_engine::load::{LoadTime, Pressure, SweptVolumes};
use sinew_engine::order::Order;
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::{Real, Scalar, add, cross, dot, scale, sub};
use sinew_engine::schedule::{
    ForceSystems, Input, StepSchedule, StepSystems, activate_law_of_systems, declare_inputs,
};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, RestPosition};
use sinew_engine::workers::Workers;

use std::time::Instant;

use crate::element::membrane::TriangleTangent;
use crate::frame::columns::{LawColumns, TangentSum, add_vertices, evaluate_span, load_vertices};
use crate::frame::row::{self, Elements, InRecovery, LawRow, PlacedLaw, mark};
use crate::frame::triangles::add_tangent;

/// Volume (m^3) that a triangle of rest edges `X_1 - X_0`, `X_2 - X_0` sweeps from rest to displacements
/// `u`, positive along its normal.
///
/// ```
/// use sinew_models::laws::pressure::swept_volume;
/// // A right triangle lifted by 2, then another whose one corner is lifted by 3.
/// let edges = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// assert_eq!(swept_volume(&edges, &[[0.0, 0.0, 2.0]; 3]), 1.0);
/// assert_eq!(swept_volume(&edges, &[[0.0, 0.0, 3.0], [0.0; 3], [0.0; 3]]), 0.5);
/// ```
#[inline(always)]
pub fn swept_volume<R: Real>(edges: &[[R; 3]; 2], u: &[[R; 3]; 3]) -> R {
    let [a, b] = *edges;
    let w = [sub(u[1], u[0]), sub(u[2], u[0])];
    let mean = add(u[0], add(u[1], u[2]));
    let rest = dot(mean, cross(a, b));
    let first = dot(mean, add(cross(a, w[1]), cross(w[0], b)));
    let second = dot(mean, cross(w[0], w[1]));
    let sum = (R::from_f64(1.0 / 3.0)).mul_add(second, R::from_f64(0.5).mul_add(first, rest));
    R::from_f64(1.0 / 6.0) * sum
}

/// Force (N) of `pressure` (Pa) on each of the three vertices.
#[inline(always)]
pub fn force<R: Real>(edges: &[[R; 3]; 2], u: &[[R; 3]; 3], pressure: R) -> [R; 3] {
    let d = deformed(edges, u);
    scale(cross(d[0], d[1]), R::from_f64(1.0 / 6.0) * pressure)
}

/// Symmetric tangent of `pressure` (Pa), N/m.
#[inline(always)]
pub fn tangent<R: Real>(edges: &[[R; 3]; 2], u: &[[R; 3]; 3], pressure: R) -> TriangleTangent<R> {
    let [a, b] = deformed(edges, u);
    let c = R::from_f64(-1.0 / 12.0) * pressure;
    let arms = [add(a, b), sub(add(a, a), b), sub(a, add(b, b))];
    let mut off = [[R::ZERO; 9]; 3];
    for i in 0..3 {
        let [x, y, z] = scale(arms[i], c);
        off[i] = [R::ZERO, -z, y, z, R::ZERO, -x, -y, x, R::ZERO];
    }
    TriangleTangent { diagonal: [[R::ZERO; 9]; 3], off }
}

#[inline(always)]
fn deformed<R: Real>(edges: &[[R; 3]; 2], u: &[[R; 3]; 3]) -> [[R; 3]; 2] {
    [add(edges[0], sub(u[1], u[0])), add(edges[1], sub(u[2], u[0]))]
}

/// Follower pressure of all [`Pressure`] entities.
pub static ROW: LawRow = LawRow::of_systems(
    LawInfo { name: "follower pressure", is_load: true },
    Elements::Faces,
    [mark::<Pressure>; 2],
    [activate_law::<f64>, activate_law::<f32>],
)
// indefinite by itself, so no part of the stand-ins
.with_tangent(|kind| matches!(kind, TangentKind::Exact))
// its potential falls with the third power of displacements, against a quadratic energy that stands in
.in_recovery(InRecovery::Silent);

fn activate_law<S: Scalar>(world: &mut World, law: PlacedLaw) {
    // cut when faces are collected
    let elements = (None, (|_, _, _| {}) as sinew_engine::law::Partition<S>);
    activate_law_of_systems(world, (law.row.info, law.place), elements, |schedule, _| {
        schedule.add_systems(evaluate::<S>.in_set(ForceSystems::Evaluate));
    });
    declare_inputs(world, law.row.info.name, &[Input::Watch(pressures_changed::<S>)]);
}

/// The triangles of all [`Pressure`] entities in the order of evaluation.
#[derive(Resource, Debug, Default)]
struct PressureFaces<S> {
    /// What they were made of.
    sources: Vec<(Order, Pressure)>,
    revision: u64,
    /// Vertex rows, ascending within a triangle.
    nodes: Vec<[u32; 3]>,
    /// Tangent blocks, block `i` opposite vertex `i`.
    blocks: Vec<[u32; 3]>,
    /// Components of the rest edges (m).
    edges: [Vec<S>; 6],
    /// 1, or -1 where ascending rows turned a triangle over.
    sign: Vec<S>,
    /// Source of every range of the law's buffer.
    source_of_span: Vec<u32>,
}

/// Puts the law into the force schedule of a world; call it when a [`Pressure`] is added. Changes of
/// such entities later on are seen by themselves, at the next step.
pub fn activate<S: Scalar>(world: &mut World) {
    compiled_here!(S, activate_law_of_pressure(world: &mut World))
}

fn activate_law_of_pressure<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<PressureFaces<S>>() {
        world.insert_resource(PressureFaces::<S>::default());
        world.init_resource::<SweptVolumes>();
        world.init_resource::<LoadTime>();
        // alone between the two stages, so that it is ordered against whatever Prepare holds
        let mut schedules = world.resource_mut::<Schedules>();
        schedules.entry(StepSchedule).add_systems(
            collect_faces::<S>.after(StepSystems::Prepare).before(StepSystems::Integrate),
        );
        row::activate::<S>(world, &ROW);
    }
    collect_faces::<S>(world);
}

/// Makes the faces fit at once what bodies lost.
pub(crate) fn refresh<S: Scalar>(world: &mut World) {
    if world.contains_resource::<PressureFaces<S>>() {
        collect_faces::<S>(world);
    }
}

fn pressures_changed<S: Scalar>(world: &mut World) -> bool {
    world.is_resource_changed::<PressureFaces<S>>()
}

/// Makes the faces fit the entities and the rows of bodies, if they do not.
fn collect_faces<S: Scalar>(world: &mut World) {
    let mut entities = world.query::<(&Order, &Pressure)>();
    let mut sources: Vec<(Order, &Pressure)> = entities.iter(world).map(|(o, p)| (*o, p)).collect();
    sources.sort_by_key(|(order, _)| *order);
    let revision = world.resource::<Topology>().revision;
    let known = world.resource::<PressureFaces<S>>();
    let same = known.sources.iter().map(|(order, p)| (*order, p)).eq(sources.iter().copied());
    if same && known.revision == revision {
        return;
    }
    let sources: Vec<(Order, Pressure)> =
        sources.into_iter().map(|(order, p)| (order, p.clone())).collect();
    let mut faces = PressureFaces::<S> { revision, ..Default::default() };
    let mut buffer = LawBuffer::default();
    let mut rests = world.query::<&RestPosition>();
    let rest = single_table(rests.contiguous_iter(world)).unwrap_or(&[]);
    let topology = world.resource::<Topology>();
    for (source, (_, pressure)) in sources.iter().enumerate() {
        let first = faces.nodes.len();
        // an edge that no element has any more carries nothing
        let mut own: Vec<_> =
            pressure.faces.iter().filter_map(|&t| ascending(t, topology)).collect();
        own.sort_unstable_by_key(|(nodes, _, _)| *nodes);
        for (nodes, blocks, flipped) in own {
            let x = nodes.map(|v| rest[v as usize].0);
            let edges = [x[1] - x[0], x[2] - x[0]];
            for (column, value) in
                faces.edges.iter_mut().zip(edges.iter().flat_map(|e| e.to_array()))
            {
                column.push(S::from_f64(value));
            }
            faces.nodes.push(nodes);
            faces.blocks.push(blocks);
            faces.sign.push(if flipped { -S::ONE } else { S::ONE });
        }
        let nodes = &faces.nodes;
        let spans = Span::cut(first..nodes.len(), topology, |i| &nodes[i]);
        faces.source_of_span.resize(buffer.spans.len() + spans.len(), source as u32);
        buffer.spans.extend(spans);
    }
    faces.sources = sources;
    if let Some(mut own) = world.resource::<LawBuffers<S>>().get(ROW.info.name) {
        *own = buffer;
    }
    world.insert_resource(faces);
}

/// A triangle with its rows in ascending order, the blocks of its edges, and whether that turned it
/// over; `None` when an edge is in no element.
fn ascending(t: [VertexRow; 3], topology: &Topology) -> Option<([u32; 3], [u32; 3], bool)> {
    let t = t.map(|row| row.0);
    let mut nodes = t;
    nodes.sort_unstable();
    let flipped = ![[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|p| p.map(|i| nodes[i])).contains(&t);
    let [a, b, c] = nodes;
    Some((nodes, [topology.block(b, c)?, topology.block(a, c)?, topology.block(a, b)?], flipped))
}

fn evaluate<S: Scalar>(
    (request, workers): (Res<EvaluationRequest>, Res<Workers>),
    time: Res<LoadTime>,
    faces: Res<PressureFaces<S>>,
    mut swept: ResMut<SweptVolumes>,
    (buffers, disabled): (Res<LawBuffers<S>>, Res<DisabledLaws>),
    recovering: Res<RecoveringBodies>,
    vertices: Query<&Displacement<S>>,
) {
    let start = Instant::now();
    if disabled.contains(ROW.info.name) {
        return;
    }
    let Some(mut buffer) = buffers.get(ROW.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let displacement = bytemuck::TransparentWrapper::peel_slice(u);
    let pressures: Vec<f64> =
        faces.sources.iter().map(|(_, p)| p.pressure * p.curve.value(time.0)).collect();
    let of_span = |i: usize| pressures[faces.source_of_span[i] as usize];
    let exact = request.tangent.filter(|&kind| kind == TangentKind::Exact);
    // forces need the volumes too
    let energy = request.force || request.energy;
    let own = EvaluationRequest { energy, force: request.force, tangent: exact };
    let work = 6 + 20 * usize::from(exact.is_some());
    workers.for_each(&mut buffer.spans, faces.nodes.len() * work, |i, span| {
        let loaded = LoadedFaces { faces: &faces, displacement, pressure: S::from_f64(of_span(i)) };
        // the energy is the volume, for now
        if recovering.contains(span.body) {
            let volume = EvaluationRequest { energy, force: false, tangent: None };
            evaluate_span(&loaded, &volume, &workers, span);
            span.force.clear();
        } else {
            evaluate_span(&loaded, &own, &workers, span);
        }
    });
    if energy {
        swept.0.clear();
        swept.0.extend(pressures.iter().map(|&p| [p, 0.0]));
        for (span, &source) in buffer.spans.iter_mut().zip(&faces.source_of_span) {
            let [pressure, volume] = &mut swept.0[source as usize];
            *volume += span.energy;
            span.energy *= if recovering.contains(span.body) { 0.0 } else { -*pressure };
        }
    }
    buffer.time = start.elapsed();
}

/// Faces under one pressure (Pa).
struct LoadedFaces<'a, S> {
    faces: &'a PressureFaces<S>,
    displacement: &'a [[S; 4]],
    pressure: S,
}

impl<S: Scalar> LoadedFaces<'_, S> {
    /// Rest edges, displacements and signs of the triangles from `first` on.
    #[inline(always)]
    fn shape<L: Lanes<Scalar = S>>(&self, first: usize) -> ([[L; 3]; 2], [[L; 3]; 3], L) {
        let mut edges = [[L::ZERO; 3]; 2];
        for a in 0..2 {
            for x in 0..3 {
                edges[a][x] = L::load(&self.faces.edges[3 * a + x][first..]);
            }
        }
        let u = load_vertices(self.displacement, &self.faces.nodes[first..]);
        (edges, u, L::load(&self.faces.sign[first..]))
    }
}

impl<S: Scalar> LawColumns<S> for LoadedFaces<'_, S> {
    /// Adds the volumes.
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let (edges, u, sign) = self.shape::<L>(first);
        (sign * swept_volume(&edges, &u)).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut [[S; 4]], row: usize) {
        let (edges, u, sign) = self.shape::<L>(first);
        let f = force(&edges, &u, sign * L::splat(self.pressure));
        add_vertices([f; 3], to, row, &self.faces.nodes[first..]);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let (edges, u, sign) = self.shape::<L>(first);
        let t = tangent(&edges, &u, sign * L::splat(self.pressure));
        add_tangent(&t, to.span, &self.faces.nodes, &self.faces.blocks, first);
    }
}
