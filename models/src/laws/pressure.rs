//! Follower pressure: on every triangle of a surface, pressure times deformed area along the normal,
//! a third to each vertex. The faces of ten-node tetrahedra are curved; what acts there is in [`crate::element::face`].
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
//!
//! A [`Pressure`] names flat triangles. Those that lie in the face of a ten-node tetrahedron, between three of its vertices, are
//! taken for what they cover of that face: three corners for all of it, others for a quarter.
//!
//! A face that a blade parted is loaded in parts, each by the vertices that move it ([`crate::cutting`]). They are moved linearly, so that
//! with `n_i` three times the first moments of a part over the area of the face, 1 where it is whole,
//!
//! ```text
//! f_i = n_i p/3 a     m = sum n_i u_i / 3     K_12 = -p/12 skew(n_1 (x_1 - x_0) + n_2 (x_2 - x_0)), cyclic
//! ```
//!
//! Where a wound meets the surface the rim is free to move.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::compiled_here;
use sinew_engine::element::TETRAHEDRON_FACES;
use sinew_engine::isoparametric::{Tetrahedron10Vertices, middle_of};
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{
    DisabledLaws, EvaluationRequest, LawBuffer, LawBuffers, LawInfo, RecoveringBodies, Span,
    TangentKind,
};
use sinew_engine::load::{LoadTime, Pressure, PressureReach, SweptVolumes};
use sinew_engine::order::Order;
use sinew_engine::resource::ensure;
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::{Real, Scalar, Single, add, cross, scale, sub};
use sinew_engine::schedule::{
    ForceSystems, Input, StepSchedule, StepSystems, activate_law_of_systems, declare_inputs,
};
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{Displacement, RestPosition};
use sinew_engine::workers::Workers;

use std::collections::{BTreeMap, BTreeSet};

use crate::body::present::Resection;
use crate::cutting::faces::face_parts;
use crate::element::face::{self, PAIRS, PARTS, POINTS, Points, skew};
use crate::element::membrane::TriangleTangent;
use crate::frame::columns::{LawColumns, TangentSum, add_vertices, evaluate_span, load_vertices};
use crate::frame::row::{self, Elements, InRecovery, LawRow, PlacedLaw, mark};
use crate::frame::triangles::add_tangent;

/// Volume (m^3) that the part `n` of a triangle of rest edges `X_1 - X_0`, `X_2 - X_0` sweeps from rest to displacements
/// `u`, positive along its normal.
///
/// ```
/// use sinew_models::laws::pressure::swept_volume;
/// // A right triangle lifted by 2, then another whose one corner is lifted by 3.
/// let edges = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let whole = [1.0; 3];
/// assert_eq!(swept_volume(&edges, &[[0.0, 0.0, 2.0]; 3], whole), 1.0);
/// assert_eq!(swept_volume(&edges, &[[0.0, 0.0, 3.0], [0.0; 3], [0.0; 3]], whole), 0.5);
/// ```
#[inline(always)]
pub fn swept_volume<R: Real>(edges: &[[R; 3]; 2], u: &[[R; 3]; 3], n: [R; 3]) -> R {
    let w = [sub(u[1], u[0]), sub(u[2], u[0])];
    // a point in the middle, of half the area of the edges
    let [a, b, c] = [scale(u[0], n[0]), scale(u[1], n[1]), scale(u[2], n[2])];
    R::from_f64(1.0 / 6.0) * face::swept(add(a, add(b, c)), edges, &w)
}

/// Forces (N) of `pressure` (Pa) on the part `n` at the three vertices.
#[inline(always)]
pub fn forces<R: Real>(
    edges: &[[R; 3]; 2],
    u: &[[R; 3]; 3],
    pressure: R,
    n: [R; 3],
) -> [[R; 3]; 3] {
    let d = deformed(edges, u);
    let third = scale(cross(d[0], d[1]), R::from_f64(1.0 / 6.0) * pressure);
    [scale(third, n[0]), scale(third, n[1]), scale(third, n[2])]
}

/// Symmetric tangent of `pressure` (Pa) on the part `n`, N/m.
#[inline(always)]
pub fn tangent<R: Real>(
    edges: &[[R; 3]; 2],
    u: &[[R; 3]; 3],
    pressure: R,
    [l, m, n]: [R; 3],
) -> TriangleTangent<R> {
    let [a, b] = deformed(edges, u);
    let c = R::from_f64(-1.0 / 12.0) * pressure;
    let arms = [
        add(scale(a, m), scale(b, n)),
        sub(scale(a, l + n), scale(b, n)),
        sub(scale(a, m), scale(b, l + m)),
    ];
    let mut off = [[R::ZERO; 9]; 3];
    for i in 0..3 {
        off[i] = skew(scale(arms[i], c));
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
    [activate_law::<f64>, activate_law::<Single>],
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

/// The faces of all [`Pressure`] entities in the order of evaluation.
#[derive(Resource, Debug, Default)]
struct PressureFaces<S> {
    /// What they were made of.
    sources: Vec<(Order, Pressure)>,
    /// Revision of the topology, and the changes of bodies that were cut.
    revision: [u64; 2],
    /// Flat ones and parts of them, vertex rows ascending within a triangle, block `i` opposite vertex `i`.
    flat: FaceColumns<S, 3, 3, 2>,
    /// Three times the moments of each over the area of its face.
    parts: [Vec<S>; 3],
    /// Those of ten-node tetrahedra, rows of corners ascending, blocks of [`PAIRS`].
    curved: FaceColumns<S, 6, 15, 5>,
    /// What the ranges of the law's buffer are.
    spans: Vec<PressureSpan>,
}

/// A range of the law's buffer.
#[derive(Clone, Copy, Debug)]
struct PressureSpan {
    /// Its pressure.
    source: u32,
    /// One of the [`PARTS`] of curved faces; none for flat ones.
    part: Option<u8>,
}

/// Faces of `V` vertices with `P` pairs of them and `E` vectors between them.
#[derive(Debug)]
struct FaceColumns<S, const V: usize, const P: usize, const E: usize> {
    nodes: Vec<[u32; V]>,
    /// Tangent blocks.
    blocks: Vec<[u32; P]>,
    /// Components of the vectors from the first vertex to the others at rest (m).
    edges: [[Vec<S>; 3]; E],
    /// 1, or -1 where the order of rows turned a face over.
    sign: Vec<S>,
}

impl<S, const V: usize, const P: usize, const E: usize> Default for FaceColumns<S, V, P, E> {
    fn default() -> Self {
        let edges = std::array::from_fn(|_| std::array::from_fn(|_| Vec::new()));
        Self { nodes: Vec::new(), blocks: Vec::new(), edges, sign: Vec::new() }
    }
}

impl<S: Scalar, const V: usize, const P: usize, const E: usize> FaceColumns<S, V, P, E> {
    fn push(&mut self, face: &Face<V, P>, rest: &[RestPosition]) {
        let x = face.nodes.map(|v| rest[v as usize].0);
        for (columns, end) in self.edges.iter_mut().zip(&x[1..]) {
            for (column, value) in columns.iter_mut().zip((*end - x[0]).to_array()) {
                column.push(S::from_f64(value));
            }
        }
        self.nodes.push(face.nodes);
        self.blocks.push(face.blocks);
        self.sign.push(if face.flipped { -S::ONE } else { S::ONE });
    }

    /// Rest vectors, displacements and signs of the faces from `first` on.
    #[inline(always)]
    fn shape<L: Lanes<Scalar = S>>(
        &self,
        displacement: &[[S; 4]],
        first: usize,
    ) -> ([[L; 3]; E], [[L; 3]; V], L) {
        let mut edges = [[L::ZERO; 3]; E];
        for a in 0..E {
            for x in 0..3 {
                edges[a][x] = L::load(&self.edges[a][x][first..]);
            }
        }
        let u = load_vertices(displacement, &self.nodes[first..]);
        (edges, u, L::load(&self.sign[first..]))
    }
}

/// A face by its vertex rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Face<const V: usize, const P: usize> {
    /// One of the [`PARTS`] of a curved face, 0 for a flat one.
    part: u8,
    nodes: [u32; V],
    blocks: [u32; P],
    /// Whether it looks the other way than the triangle that was named.
    flipped: bool,
}

/// Puts the law into the force schedule of a world; call it when a [`Pressure`] is added. Changes of
/// such entities later on are seen by themselves, at the next step.
pub fn activate<S: Scalar>(world: &mut World) {
    compiled_here!(S, activate_law_of_pressure(world: &mut World))
}

fn activate_law_of_pressure<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<PressureFaces<S>>() {
        world.insert_resource(PressureFaces::<S>::default());
        ensure::<SweptVolumes>(world);
        ensure::<PressureReach>(world);
        ensure::<LoadTime>(world);
        // alone between the two stages, so that it is ordered against whatever Prepare holds
        let mut schedules = world.resource_mut::<Schedules>();
        schedules.entry(StepSchedule).add_systems(
            collect_faces::<S>.after(StepSystems::Prepare).before(StepSystems::Integrate),
        );
        row::activate::<S>(world, &ROW);
    }
    collect_faces::<S>(world);
}

/// Makes the faces fit at once what bodies lost and how they were cut. `resection`: what knows it, in place of that of the world.
pub(crate) fn refresh<S: Scalar>(world: &mut World, resection: Option<&Resection>) {
    if world.contains_resource::<PressureFaces<S>>() {
        collect::<S>(world, resection);
    }
}

fn pressures_changed<S: Scalar>(world: &mut World) -> bool {
    world.is_resource_changed::<PressureFaces<S>>()
}

fn collect_faces<S: Scalar>(world: &mut World) {
    collect::<S>(world, None);
}

/// Makes the faces fit the entities and the rows of bodies, if they do not.
fn collect<S: Scalar>(world: &mut World, resection: Option<&Resection>) {
    let mut entities = world.query::<(&Order, &Pressure)>();
    let mut sources: Vec<(Order, &Pressure)> = entities.iter(world).map(|(o, p)| (*o, p)).collect();
    sources.sort_by_key(|(order, _)| *order);
    let topology = world.resource::<Topology>();
    let cut = topology.bodies.iter().filter(|rows| !rows.copies.portions.is_empty());
    let revision = [topology.revision, cut.map(|rows| rows.changes).sum()];
    let known = world.resource::<PressureFaces<S>>();
    let same = known.sources.iter().map(|(order, p)| (*order, p)).eq(sources.iter().copied());
    if same && known.revision == revision {
        return;
    }
    let sources: Vec<(Order, Pressure)> =
        sources.into_iter().map(|(order, p)| (order, p.clone())).collect();
    let mut faces = PressureFaces::<S> { revision, ..Default::default() };
    let mut buffer = LawBuffer::default();
    let named = sources.iter().flat_map(|(_, pressure)| &pressure.faces);
    let curved = curved_faces(world, named.map(|t| t.map(|row| row.0)));
    let mut rests = world.query::<&RestPosition>();
    let rest = single_table(rests.contiguous_iter(world)).unwrap_or(&[]);
    let topology = world.resource::<Topology>();
    let resection = resection.or_else(|| world.get_resource::<Resection>());
    let mut reach = PressureReach::default();
    for (source, (_, pressure)) in (0..).zip(&sources) {
        reach.0.push(reach_of(pressure, topology, rest));
        let (mut flat, mut bent) = (Vec::new(), Vec::new());
        let parts = face_parts(topology, resection, &pressure.faces);
        for (face, parts) in pressure.faces.iter().zip(parts) {
            let t = face.map(|row| row.0);
            // an edge that no element has any more carries nothing
            match (curved.get(&sorted(t)), parts) {
                (Some(face), _) => bent.extend(face.seen_from(t, topology)),
                (None, None) => flat.extend(ascending(t, [1.0; 3], topology)),
                (None, Some(parts)) => flat.extend(parts.iter().filter_map(|part| {
                    ascending(part.nodes, part.moments.map(|m| 3.0 * m), topology)
                })),
            }
        }
        // parts of the same vertices come as they were found
        flat.sort_by_key(|(face, _)| *face);
        bent.sort_unstable();
        let (first, first_curved) = (faces.flat.nodes.len(), faces.curved.nodes.len());
        for (face, moments) in &flat {
            faces.flat.push(face, rest);
            let of = faces.parts.iter_mut().zip(moments);
            of.for_each(|(column, moment)| column.push(S::from_f64(*moment)));
        }
        bent.iter().for_each(|face| faces.curved.push(face, rest));
        let nodes = &faces.flat.nodes;
        let spans = Span::cut(first..nodes.len(), topology, |i| &nodes[i]);
        faces.spans.extend(spans.iter().map(|_| PressureSpan { source, part: None }));
        buffer.spans.extend(spans);
        let (nodes, mut end) = (&faces.curved.nodes, first_curved);
        for same in bent.chunk_by(|a, b| a.part == b.part) {
            let own = end..end + same.len();
            end = own.end;
            let spans = Span::cut(own, topology, |i| &nodes[i]);
            let part = Some(same[0].part);
            faces.spans.extend(spans.iter().map(|_| PressureSpan { source, part }));
            buffer.spans.extend(spans);
        }
    }
    faces.sources = sources;
    world.insert_resource(reach);
    if let Some(mut own) = world.resource::<LawBuffers<S>>().get(ROW.info.name) {
        *own = buffer;
    }
    world.insert_resource(faces);
}

/// A triangle with its rows in ascending order, their moments, the blocks of its edges, and whether that turned it
/// over; `None` when an edge is in no element.
fn ascending(
    t: [u32; 3],
    moments: [f64; 3],
    topology: &Topology,
) -> Option<(Face<3, 3>, [f64; 3])> {
    let nodes = sorted(t);
    let [a, b, c] = nodes;
    let blocks = [topology.block(b, c)?, topology.block(a, c)?, topology.block(a, b)?];
    let moments = nodes.map(|v| moments[t.iter().position(|own| *own == v).unwrap_or(0)]);
    Some((Face { part: 0, nodes, blocks, flipped: !is_turned(t, nodes) }, moments))
}

/// Rest area of the faces times the extents of their bodies (m^3).
fn reach_of(pressure: &Pressure, topology: &Topology, rest: &[RestPosition]) -> f64 {
    let areas = |face: &[VertexRow; 3]| {
        let [a, b, c] = face.map(|row| rest[row.index()].0);
        (face[0].0, 0.5 * (b - a).cross(c - a).length())
    };
    let areas: Vec<(u32, f64)> = pressure.faces.iter().map(areas).collect();
    let of_body = |rows: &BodyRows| {
        let own = areas.iter().filter(|(row, _)| rows.vertices.contains(row));
        let area: f64 = own.map(|(_, area)| area).sum();
        if area == 0.0 {
            return 0.0;
        }
        let rows = rows.vertices.start as usize..rows.vertices.end as usize;
        let corners =
            rest[rows].iter().map(|x| (x.0, x.0)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        area * corners.map_or(0.0, |(low, high)| low.distance(high))
    };
    topology.bodies.iter().map(of_body).sum()
}

pub(crate) fn sorted(mut t: [u32; 3]) -> [u32; 3] {
    t.sort_unstable();
    t
}

/// Whether two triangles of the same vertices have the same orientation.
fn is_turned(a: [u32; 3], b: [u32; 3]) -> bool {
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]].iter().any(|turn| turn.map(|i| b[i]) == a)
}

/// What a triangle covers of the face of a ten-node tetrahedron.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cover {
    /// The face, rows of its corners ascending.
    pub nodes: [u32; 6],
    /// One of its [`PARTS`].
    pub part: u8,
}

impl Cover {
    /// The part of the face as it looks from where the rows of the triangle turn to the left; `None` when an edge is in no
    /// element.
    fn seen_from(&self, triangle: [u32; 3], topology: &Topology) -> Option<Face<6, 15>> {
        let Self { nodes, part } = *self;
        let mut blocks = [0; 15];
        for (block, [a, b]) in blocks.iter_mut().zip(PAIRS) {
            *block = topology.block(nodes[a], nodes[b])?;
        }
        let own = PARTS[usize::from(part)].map(|i| nodes[i]);
        Some(Face { part, nodes, blocks, flipped: !is_turned(triangle, own) })
    }
}

/// Those of some triangles that lie in faces of ten-node tetrahedra, by their sorted rows.
pub(crate) fn curved_faces(
    world: &mut World,
    triangles: impl Iterator<Item = [u32; 3]>,
) -> BTreeMap<[u32; 3], Cover> {
    let mut elements = world.query::<&Tetrahedron10Vertices>();
    let mut elements = elements.iter(world).peekable();
    let mut covers = BTreeMap::new();
    if elements.peek().is_none() {
        return covers;
    }
    let asked: BTreeSet<[u32; 3]> = triangles.map(sorted).collect();
    for Tetrahedron10Vertices(own) in elements {
        for mut corners in TETRAHEDRON_FACES {
            corners.sort_unstable_by_key(|&v| own[v]);
            let [a, b, c] = corners;
            let local = [a, b, c, middle_of(a, b), middle_of(b, c), middle_of(c, a)];
            let nodes = local.map(|v| own[v]);
            for (part, triangle) in (0..).zip(PARTS) {
                let key = sorted(triangle.map(|i| nodes[i]));
                if asked.contains(&key) {
                    covers.insert(key, Cover { nodes, part });
                }
            }
        }
    }
    covers
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
    let start = Stopwatch::start();
    if disabled.contains(ROW.info.name) {
        return;
    }
    let Some(mut buffer) = buffers.get(ROW.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let displacement = bytemuck::TransparentWrapper::peel_slice(u);
    let pressures: Vec<f64> =
        faces.sources.iter().map(|(_, p)| p.pressure * p.curve.value(time.0)).collect();
    let exact = request.tangent.filter(|&kind| kind == TangentKind::Exact);
    // forces need the volumes too
    let energy = request.force || request.energy;
    let own = EvaluationRequest { energy, force: request.force, tangent: exact };
    // the energy is the volume, for now
    let volume = EvaluationRequest { energy, force: false, tangent: None };
    let count = faces.flat.nodes.len() + 10 * faces.curved.nodes.len();
    workers.for_each(
        &mut buffer.spans,
        count * (6 + 20 * usize::from(exact.is_some())),
        |i, span| {
            let PressureSpan { source, part } = faces.spans[i];
            let pressure = S::from_f64(pressures[source as usize]);
            let recovers = recovering.contains(span.body);
            let request = if recovers { &volume } else { &own };
            match part {
                None => {
                    let parts = faces.parts.each_ref().map(|part| &part[..]);
                    let loaded = FlatFaces { faces: &faces.flat, parts, displacement, pressure };
                    evaluate_span(&loaded, request, &workers, span);
                }
                Some(part) => {
                    let points = &POINTS[usize::from(part)];
                    let loaded =
                        CurvedFaces { faces: &faces.curved, displacement, pressure, points };
                    evaluate_span(&loaded, request, &workers, span);
                }
            }
            if recovers {
                span.force.clear();
            }
        },
    );
    if energy {
        swept.0.clear();
        swept.0.extend(pressures.iter().map(|&p| [p, 0.0]));
        for (span, PressureSpan { source, .. }) in buffer.spans.iter_mut().zip(&faces.spans) {
            let [pressure, volume] = &mut swept.0[*source as usize];
            *volume += span.energy;
            span.energy *= if recovering.contains(span.body) { 0.0 } else { -*pressure };
        }
    }
    buffer.time = start.elapsed();
}

/// Flat faces under one pressure (Pa).
struct FlatFaces<'a, S> {
    faces: &'a FaceColumns<S, 3, 3, 2>,
    parts: [&'a [S]; 3],
    displacement: &'a [[S; 4]],
    pressure: S,
}

impl<S: Scalar> FlatFaces<'_, S> {
    #[inline(always)]
    fn part<L: Lanes<Scalar = S>>(&self, first: usize) -> [L; 3] {
        let [l, m, n] = self.parts;
        [L::load(&l[first..]), L::load(&m[first..]), L::load(&n[first..])]
    }
}

impl<S: Scalar> LawColumns<S> for FlatFaces<'_, S> {
    /// Adds the volumes.
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let (edges, u, sign) = self.faces.shape::<L>(self.displacement, first);
        (sign * swept_volume(&edges, &u, self.part(first))).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut [[S; 4]], row: usize) {
        let (edges, u, sign) = self.faces.shape::<L>(self.displacement, first);
        let f = forces(&edges, &u, sign * L::splat(self.pressure), self.part(first));
        add_vertices(f, to, row, &self.faces.nodes[first..]);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let (edges, u, sign) = self.faces.shape::<L>(self.displacement, first);
        let t = tangent(&edges, &u, sign * L::splat(self.pressure), self.part(first));
        add_tangent(&t, to.span, &self.faces.nodes, &self.faces.blocks, first);
    }
}

/// One part each of curved faces under one pressure (Pa).
struct CurvedFaces<'a, S> {
    faces: &'a FaceColumns<S, 6, 15, 5>,
    displacement: &'a [[S; 4]],
    pressure: S,
    points: &'a Points,
}

impl<S: Scalar> LawColumns<S> for CurvedFaces<'_, S> {
    const WIDE: bool = false;
    /// Adds the volumes.
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let (rest, u, sign) = self.faces.shape::<L>(self.displacement, first);
        (sign * face::swept_volume(self.points, &rest, &u)).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut [[S; 4]], row: usize) {
        let (rest, u, sign) = self.faces.shape::<L>(self.displacement, first);
        let f = face::forces(self.points, &rest, &u, sign * L::splat(self.pressure));
        add_vertices(f, to, row, &self.faces.nodes[first..]);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let (rest, u, sign) = self.faces.shape::<L>(self.displacement, first);
        let arms = face::tangent(self.points, &rest, &u, sign * L::splat(self.pressure));
        let (nodes, blocks) = (&self.faces.nodes[first..], &self.faces.blocks[first..]);
        let (start, span) = (to.span.blocks.start, &mut *to.span);
        for (i, [a, b]) in PAIRS.into_iter().enumerate() {
            // the block of a pair belongs to its lower row; the other one is its transpose
            let mut turn = [S::ONE; MAX_LANES];
            for (turn, nodes) in turn.iter_mut().zip(&nodes[..L::COUNT]) {
                if nodes[a] > nodes[b] {
                    *turn = -S::ONE;
                }
            }
            let block = skew(scale(arms[i], L::load(&turn)));
            L::add_blocks(&block, &mut span.off_diagonal, start, blocks, i);
        }
    }
}
