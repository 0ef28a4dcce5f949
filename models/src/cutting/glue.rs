//! Glue: what of a wound a blade has not come to yet is held closed.
//!
//! An element comes apart as a whole as soon as a blade crosses one of its edges, up to an element ahead of it. Where a body has
//! glue ([`BodyDescription::glue`]), its two copies are joined by springs
//!
//! ```text
//! E = 1/2 k |y+ - y-|^2     k = g E A / (9 h)
//! ```
//!
//! between the same point `y` of the material in either copy, nine in every triangle of the wound in it, of area `A`, with `g` the glue of
//! the body, `E` Young's modulus of the element and `h` the mean side of the elements. Copies are created in place, so that it comes without
//! energy; it is convex, knows displacements alone, and a rigid motion of both copies does nothing to it.
//!
//! - It goes when a blade passes its place. The energy that is in it then is released ([`GlueReport`]).
//! - What a stroke leaves of it at its end, ahead of the blade and below its tip, goes on holding, until another one passes it or an element
//!   that it is at is removed.
//! - In a membrane alone the wound is a line: `k = g E t L / (3 h)` at three points of every part of it, of length `L`, with its thickness
//!   `t`. Membranes on faces of tetrahedra are held by the glue of these. Parts of a body that glue joins count as one piece.
//! - Bodies with glue do not tear: a tear is brittle.
//!
//! Pairs of vertices that glue couples are in no element. The edge graph holds them from the cut on, marked as edges that no element uses,
//! whatever was swept since: it follows from the edits of the body alone. What was swept is [`GlueMemory`].
//!
//! [`BodyDescription::glue`]: crate::body::BodyDescription::glue

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::connectivity::{Connectivity, ElementKind};
use sinew_engine::isoparametric::{CORNERS, HEXAHEDRON_PAIRS, TETRAHEDRON10_PAIRS};
use sinew_engine::law::{
    DisabledLaws, EvaluationRequest, LawBuffer, LawBuffers, LawInfo, Span, TangentKind,
};
use sinew_engine::layout::Cells;
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ForceSystems, Input, activate_law_of_systems, declare_inputs};
use sinew_engine::sets::DisjointSets;
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;
use std::collections::{BTreeMap, BTreeSet};

use super::material::{Element, Material, Point};
use super::stroke::crossing;
use super::{kind_of, row_of};
use crate::body::description::SoftBody;
use crate::body::present::{BodyResection, Resection};
use crate::frame::row::{self, Elements, InRecovery, LawRow, PlacedLaw, mark};

/// Glue of wounds.
pub static ROW: LawRow = LawRow::of_systems(
    LawInfo::elastic("glue of wounds"),
    Elements::Bonds,
    [mark::<SoftBody>; 2],
    [activate_law::<f64>, activate_law::<f32>],
)
.in_recovery(InRecovery::Unchanged);

/// Glue at a point of a wound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bond {
    /// Where, in the element of the mesh.
    pub place: Point,
    /// The elements on either side.
    pub sides: [u32; 2],
    /// Stiffness (N/m).
    pub stiffness: f64,
}

/// The glue of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Glue {
    /// Its stiffness, in Young's moduli over mean edges.
    pub factor: f64,
    /// Mean edge (m) of the mesh.
    pub edge: f64,
}

/// What glue of bodies blades have come to.
#[derive(Resource, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GlueMemory {
    bodies: BTreeMap<usize, BodyGlue>,
}

impl GlueMemory {
    /// Whether it can belong to a world of so many bodies.
    pub fn fits(&self, bodies: usize) -> bool {
        self.bodies.iter().all(|(body, own)| *body < bodies && own.released >= 0.0)
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct BodyGlue {
    /// By the numbers of bonds, as far as it is long.
    swept: Vec<bool>,
    /// Energy (J) that was in them.
    released: f64,
}

impl BodyGlue {
    fn is_swept(&self, bond: usize) -> bool {
        self.swept.get(bond).is_some_and(|swept| *swept)
    }
}

/// What holds the wounds of a body closed ahead of blades.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GlueReport {
    /// Springs that hold.
    pub springs: usize,
    /// Energy (J) in them.
    pub energy: f64,
    /// Energy (J) that was in those that blades have passed, as they did.
    pub released: f64,
}

/// A point that two copies of an element hold together.
#[derive(Clone, Debug, Default)]
struct Spring<S> {
    /// Number of its bond.
    bond: usize,
    /// Rows of the vertices of one copy, and of the same of the other; those that both have are left out.
    nodes: Vec<u32>,
    /// Weight of every pair of them.
    weights: Vec<S>,
    stiffness: S,
    /// Tangent blocks of all pairs of rows, the first one's first.
    blocks: Vec<u32>,
}

impl<S: Scalar> Spring<S> {
    /// `y+ - y-` (m).
    fn gap(&self, u: &[[S; 4]]) -> [S; 3] {
        let mut gap = [S::ZERO; 3];
        for (pair, &weight) in self.nodes.chunks_exact(2).zip(&self.weights) {
            let [a, b] = [pair[0], pair[1]].map(|row| u[row as usize]);
            (0..3).for_each(|x| gap[x] += weight * (a[x] - b[x]));
        }
        gap
    }

    /// Energy (J).
    fn energy(&self, u: &[[S; 4]]) -> f64 {
        let squares = self.gap(u).iter().map(|x| x.to_f64() * x.to_f64()).sum::<f64>();
        0.5 * self.stiffness.to_f64() * squares
    }

    /// The derivative of the gap by the displacement of a row.
    fn part(&self, i: usize) -> S {
        let weight = self.weights[i / 2];
        if i.is_multiple_of(2) { weight } else { -weight }
    }

    fn add_force(&self, u: &[[S; 4]], span: &mut Span<S>) {
        let gap = self.gap(u);
        for (i, &row) in self.nodes.iter().enumerate() {
            let c = -self.stiffness * self.part(i);
            span.add_force(row, gap.map(|x| c * x));
        }
    }

    fn add_tangent(&self, span: &mut Span<S>) {
        let diagonal = |c: S| {
            let mut m = [S::ZERO; 9];
            [0, 4, 8].into_iter().for_each(|i| m[i] = c);
            m
        };
        let mut blocks = self.blocks.iter();
        for (i, &row) in self.nodes.iter().enumerate() {
            let c = self.stiffness * self.part(i);
            span.add_diagonal(row, &diagonal(c * self.part(i)));
            for (j, &block) in (i + 1..self.nodes.len()).zip(&mut blocks) {
                span.add_off_diagonal(block, 0, 1, &diagonal(c * self.part(j)));
            }
        }
    }
}

/// The springs of all bodies, body by body.
#[derive(Resource, Debug, Default)]
pub(crate) struct Springs<S>(Vec<Spring<S>>);

fn activate_law<S: Scalar>(world: &mut World, law: PlacedLaw) {
    // cut when springs are collected
    let elements = (None, (|_, _, _| {}) as sinew_engine::law::Partition<S>);
    activate_law_of_systems(world, (law.row.info, law.place), elements, |schedule, _| {
        schedule.add_systems(evaluate::<S>.in_set(ForceSystems::Evaluate));
    });
    let changed: fn(&mut World) -> bool = |world| world.is_resource_changed::<Springs<S>>();
    declare_inputs(world, law.row.info.name, &[Input::Watch(changed)]);
}

/// The glue of a body of these cells, by the places (m) of its rows, none for a stiffness of 0; puts the law into the schedule,
/// [`refresh`] finds its springs.
pub(crate) fn spawn<S: Scalar>(
    world: &mut World,
    factor: f64,
    cells: &Cells,
    rest: impl Fn(u32) -> DVec3,
) -> Option<Glue> {
    let glue = (factor > 0.0).then(|| {
        let edges = sides(cells);
        let length = |e: &u32| {
            let [a, b] = cells.edges[*e as usize];
            rest(a).distance(rest(b))
        };
        Glue { factor, edge: edges.iter().map(length).sum::<f64>() / edges.len() as f64 }
    })?;
    if !world.contains_resource::<Springs<S>>() {
        world.insert_resource(Springs::<S>::default());
        row::activate::<S>(world, &ROW);
    }
    Some(glue)
}

/// Edges of the elements of a body: of the pairs of their vertices those along their sides, from corner to corner.
fn sides(cells: &Cells) -> BTreeSet<u32> {
    let is_side =
        |&[a, b]: &[usize; 2]| (0..3).filter(|&k| CORNERS[a][k] != CORNERS[b][k]).count() == 1;
    let mut sides = BTreeSet::new();
    for kind in ElementKind::ALL {
        let all = &cells.edges_of[kind];
        for own in (0..all.len() as u32).map(|e| all.of(e)) {
            sides.extend(own.iter().enumerate().filter_map(|(i, &edge)| {
                let is_own = match own.len() {
                    45 => TETRAHEDRON10_PAIRS[i].iter().all(|v| *v < 4),
                    28 => is_side(&HEXAHEDRON_PAIRS[i]),
                    _ => true,
                };
                is_own.then_some(edge)
            }));
        }
    }
    sides
}

/// Rows of a body whose vertices are in elements that are left, in pairs, with their weights.
type Pairs = Vec<(u32, u32, f64)>;

impl Bond {
    /// The rows that it holds together; none where an element is gone.
    fn pairs(&self, material: &Material, rows: &BodyRows, own: &Present) -> Pairs {
        if !self.sides.iter().all(|&e| own.has(e)) {
            return Vec::new();
        }
        let [a, b] = self.sides.map(|e| &material.elements[e as usize]);
        let row = |element: &Element, i| row_of(rows, element.node(i));
        let all = material.held_by(a, &self.place);
        let both = all.map(|(i, w)| (row(a, i), row(b, i), w));
        both.filter(|(a, b, _)| a != b).collect()
    }
}

/// Which elements of a body are left.
pub(super) struct Present<'a> {
    pub connectivity: &'a Connectivity,
    /// Row of every element.
    pub rows: &'a [u32],
    pub kind: ElementKind,
}

impl Present<'_> {
    fn has(&self, element: u32) -> bool {
        let row = self.rows.get(element as usize);
        row.is_some_and(|&row| self.connectivity.is_present(self.kind, row))
    }
}

impl BodyResection {
    fn present(&self, rows: &BodyRows) -> Present<'_> {
        let kind = kind_of(rows);
        Present { connectivity: &self.connectivity, rows: &self.element_of[kind], kind }
    }

    /// Pairs of rows of the world that glue couples, swept or not.
    pub(super) fn glued_pairs(&self, material: &Material, rows: &BodyRows) -> Vec<[u32; 2]> {
        let (own, first) = (self.present(rows), rows.vertices.start);
        let mut all = Vec::new();
        for bond in &material.bonds {
            let pairs = bond.pairs(material, rows, &own);
            let nodes: Vec<u32> = pairs.iter().flat_map(|&(a, b, _)| [a, b]).collect();
            for (i, &a) in nodes.iter().enumerate() {
                all.extend(nodes[i + 1..].iter().map(|&b| [first + a.min(b), first + a.max(b)]));
            }
        }
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Bonds of a body that hold, with what they hold together.
fn holding(
    memory: Option<&GlueMemory>,
    (body, rows): (usize, &BodyRows),
    own: &BodyResection,
    material: &Material,
) -> Vec<(usize, Pairs)> {
    let swept = memory.and_then(|memory| memory.bodies.get(&body));
    let present = own.present(rows);
    let holds = |i: &usize| swept.is_none_or(|own| !own.is_swept(*i));
    let all = (0..material.bonds.len()).filter(holds);
    let pairs = all.map(|i| (i, material.bonds[i].pairs(material, rows, &present)));
    pairs.filter(|(_, pairs)| !pairs.is_empty()).collect()
}

/// Numbers of the connected pieces of a body, with what glue holds together.
pub(super) fn pieces(
    world: &World,
    (body, rows): (usize, &BodyRows),
    own: &BodyResection,
    material: &Material,
) -> Vec<u32> {
    let mut pieces = own.connectivity.pieces();
    let count = pieces.iter().filter(|piece| **piece != u32::MAX).max().map_or(0, |last| last + 1);
    let mut sets = DisjointSets::new(count as usize);
    for (_, pairs) in holding(world.get_resource(), (body, rows), own, material) {
        let nodes: Vec<u32> = pairs.iter().flat_map(|&(a, b, _)| [a, b]).collect();
        for two in nodes.windows(2) {
            sets.join(pieces[two[0] as usize], pieces[two[1] as usize]);
        }
    }
    let number = sets.count();
    for piece in pieces.iter_mut().filter(|piece| **piece != u32::MAX) {
        *piece = number[*piece as usize];
    }
    pieces
}

/// Finds the springs of all bodies, if there is a body with glue, and what hangs together. `resection`: what knows it, in place of that
/// of the world.
pub(crate) fn refresh<S: Scalar>(world: &mut World, resection: Option<&mut Resection>) {
    if !world.contains_resource::<Springs<S>>() {
        return;
    }
    let mut of_world = None;
    let resection = match resection {
        Some(resection) => resection,
        None => of_world.insert(take::<Resection>(world)),
    };
    let mut springs = Vec::new();
    for (body, own) in resection.bodies.iter_mut().enumerate() {
        let Some(own) = own else { continue };
        let Some(material) = own.material.take() else { continue };
        if !material.bonds.is_empty() {
            let rows = &world.resource::<Topology>().bodies[body];
            let piece = pieces(world, (body, rows), own, &material);
            let topology = world.resource::<Topology>();
            let held = holding(world.get_resource(), (body, rows), own, &material);
            let first = rows.vertices.start;
            springs.extend(held.into_iter().map(|(i, pairs)| {
                let nodes: Vec<u32> =
                    pairs.iter().flat_map(|&(a, b, _)| [first + a, first + b]).collect();
                let later = |i: usize| nodes[i + 1..].iter().map(move |&b| (i, b));
                let all = (0..nodes.len()).flat_map(later);
                let block = |(i, b): (usize, u32)| topology.block(nodes[i], b);
                let blocks = all.map(|pair| block(pair).expect("cuts add all pairs to the graph"));
                let blocks = blocks.collect();
                Spring {
                    bond: i,
                    weights: pairs.iter().map(|&(.., w)| S::from_f64(w)).collect(),
                    stiffness: S::from_f64(material.bonds[i].stiffness),
                    blocks,
                    nodes,
                }
            }));
            let rows = &mut world.resource_mut::<Topology>().bodies[body];
            rows.set_pieces(piece);
            own.pieces = rows.piece_count();
        }
        own.material = Some(material);
    }
    if let Some(own) = of_world {
        put(world, own);
    }
    let mut buffer = LawBuffer::<S>::default();
    let topology = world.resource::<Topology>();
    buffer.spans = Span::cut(0..springs.len(), topology, |i| &springs[i].nodes);
    if let Some(mut own) = world.resource::<LawBuffers<S>>().get(ROW.info.name) {
        *own = buffer;
    }
    world.insert_resource(Springs(springs));
}

/// Marks the edges that glue couples.
pub(crate) fn mark_edges(topology: &Topology, resection: &Resection, marks: &mut [bool]) {
    for (own, rows) in resection.bodies.iter().zip(&topology.bodies) {
        let own = own.as_ref().and_then(|own| Some((own, own.material.as_deref()?)));
        let pairs = own.map_or_else(Vec::new, |(own, material)| own.glued_pairs(material, rows));
        for [a, b] in pairs {
            if let Some(block) = topology.block(a, b) {
                marks[block as usize] = true;
            }
        }
    }
}

/// What the glue of a body does; `None` where it has none.
pub fn glue_report<S: Scalar>(world: &World, body: usize) -> Option<GlueReport> {
    let mut query = world.try_query::<&SoftBody>()?;
    query.iter(world).find(|soft| soft.index == body)?.glue?;
    let mut vertices = world.try_query::<&Displacement<S>>()?;
    let springs = world.get_resource::<Springs<S>>()?;
    let u = Displacement::peel_slice(single_table(vertices.contiguous_iter(world))?);
    let rows = &world.resource::<Topology>().bodies[body].vertices;
    let own = springs.0.iter().filter(|spring| rows.contains(&spring.nodes[0]));
    let energies: Vec<f64> = own.map(|spring| spring.energy(u)).collect();
    let memory = world.get_resource::<GlueMemory>().and_then(|memory| memory.bodies.get(&body));
    Some(GlueReport {
        springs: energies.len(),
        energy: energies.iter().sum(),
        released: memory.map_or(0.0, |own| own.released),
    })
}

/// Energy (J) in the glue of a body.
pub(crate) fn energy<S: Scalar>(world: &mut World, body: usize) -> f64 {
    if !world.contains_resource::<Springs<S>>() {
        return 0.0;
    }
    glue_report::<S>(world, body).map_or(0.0, |report| report.energy)
}

/// Numbers of the bonds of a body that no blade has passed, where elements are left on both sides; those hold nothing yet where both copies
/// still have all vertices in common.
pub(super) fn unswept(world: &World, body: usize, material: &Material) -> Vec<usize> {
    let resection = world.get_resource::<Resection>();
    let Some(own) = resection.and_then(|all| all.bodies.get(body)?.as_ref()) else {
        return Vec::new();
    };
    let present = own.present(&world.resource::<Topology>().bodies[body]);
    let memory = world.get_resource::<GlueMemory>().and_then(|memory| memory.bodies.get(&body));
    let holds = |(i, bond): &(usize, &Bond)| {
        memory.is_none_or(|own| !own.is_swept(*i)) && bond.sides.iter().all(|&e| present.has(e))
    };
    material.bonds.iter().enumerate().filter(holds).map(|(i, _)| i).collect()
}

/// Lets bonds of a body go, ascending, that a blade passed.
pub(super) fn release<S: Scalar>(world: &mut World, body: usize, bonds: &[usize]) {
    if bonds.is_empty() {
        return;
    }
    let mut vertices = world.query::<&Displacement<S>>();
    let rows = world.resource::<Topology>().bodies[body].vertices.clone();
    let mut released = 0.0;
    if let (Some(springs), Some(u)) =
        (world.get_resource::<Springs<S>>(), single_table(vertices.contiguous_iter(world)))
    {
        let own = springs.0.iter().filter(|spring| rows.contains(&spring.nodes[0]));
        let own = own.filter(|spring| bonds.binary_search(&spring.bond).is_ok());
        released = own.map(|spring| spring.energy(Displacement::peel_slice(u))).sum();
    }
    let mut memory = ensure::<GlueMemory>(world);
    let own = memory.bodies.entry(body).or_default();
    let last = bonds.iter().max().map_or(0, |last| last + 1);
    own.swept.resize(own.swept.len().max(last), false);
    bonds.iter().for_each(|&bond| own.swept[bond] = true);
    own.released += released;
    refresh::<S>(world, None);
}

/// How far (mean edges) beside a blade glue is that it passes.
pub(super) const BY: f64 = 0.5;

/// Lets glue go that a blade passes at once, by its positions (m).
pub(super) fn cross<S: Scalar>(world: &mut World, body: usize, strip: &[[DVec3; 2]]) {
    let glue = super::soft_of(world, body).and_then(|soft| soft.glue);
    let at = super::places::<S>(world, body);
    let (Some(glue), Some(material)) = (glue, super::cut_material(world, body)) else { return };
    let unswept = unswept(world, body, material);
    let node = |node: u32| at[node as usize];
    let passed = |i: &usize| {
        let bond = &material.bonds[*i];
        let of = |e: u32| material.held_at(&material.elements[e as usize], &bond.place, node);
        let [a, b] = bond.sides.map(of);
        let x = 0.5 * (a + b);
        strip.windows(2).any(|two| {
            let ([p0, q0], [p1, q1]) = (two[0], two[1]);
            [[p0, q0, p1], [q0, q1, p1]].iter().any(|part| {
                let normal = (part[1] - part[0]).cross(part[2] - part[0]).normalize_or_zero();
                let away = BY * glue.edge * normal;
                crossing([x - away, x + away], part).is_some()
            })
        })
    };
    let passed: Vec<usize> = unswept.into_iter().filter(passed).collect();
    release::<S>(world, body, &passed);
}

/// Makes what was swept what a memory says.
pub fn recall<S: Scalar>(world: &mut World, memory: Option<&GlueMemory>) {
    match memory {
        Some(memory) => world.insert_resource(memory.clone()),
        None => drop(world.remove_resource::<GlueMemory>()),
    }
    refresh::<S>(world, None);
}

/// Takes over from another world what was swept of a body.
pub(crate) fn sweep_alike(from: &World, body: usize, to: &mut World) {
    if let Some(own) = from.get_resource::<GlueMemory>().and_then(|memory| memory.bodies.get(&body))
    {
        ensure::<GlueMemory>(to).bodies.insert(0, own.clone());
    }
}

/// The stiffness (N/m) of all the glue in a triangle of the wound, or in a line of that of a membrane, by its element of the mesh and its corners.
pub(super) fn gluing(
    soft: &SoftBody,
    rest: impl Fn(u32) -> DVec3,
) -> Option<impl Fn(u32, &[Point]) -> f64> {
    let Glue { factor, edge } = soft.glue?;
    Some(move |element: u32, corners: &[Point]| {
        let place = |point: &Point| -> DVec3 {
            let all = point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
            all.map(|(&v, w)| w * rest(v)).sum()
        };
        match *corners {
            [a, b] => {
                let film = soft.membrane.map_or(0.0, |m| m.material.young_modulus * m.thickness);
                factor * film / edge * place(&a).distance(place(&b))
            }
            _ => {
                let [a, b, c] = [0, 1, 2].map(|i| place(&corners[i]));
                let area = 0.5 * (b - a).cross(c - a).length();
                factor * soft.field().at(element as usize).young_modulus / edge * area
            }
        }
    })
}

fn evaluate<S: Scalar>(
    (request, workers): (Res<EvaluationRequest>, Res<Workers>),
    springs: Res<Springs<S>>,
    (buffers, disabled): (Res<LawBuffers<S>>, Res<DisabledLaws>),
    vertices: Query<&Displacement<S>>,
) {
    let start = Stopwatch::start();
    if disabled.contains(ROW.info.name) {
        return;
    }
    let Some(mut buffer) = buffers.get(ROW.info.name) else { return };
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let u: &[[S; 4]] = Displacement::peel_slice(u);
    buffer.for_each_awake(&workers, 60 * springs.0.len(), |_, span| {
        let own = &springs.0[span.elements.clone()];
        if request.energy {
            span.energy = own.iter().map(|spring| spring.energy(u)).sum();
        }
        if request.force {
            span.clear_force();
            own.iter().for_each(|spring| spring.add_force(u, span));
        }
        match request.tangent {
            // the same of any kind
            Some(TangentKind::Exact | TangentKind::GaussNewton | TangentKind::Projected) => {
                span.clear_tangent();
                own.iter().for_each(|spring| spring.add_tangent(span));
            }
            None => span.drop_tangent(),
        }
    });
    buffer.time = start.elapsed();
}
