//! Blades that move through bodies that move: what they cross from step to step.

use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::resource::{ensure, put, take};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::{Displacement, RestPosition};
use std::collections::BTreeMap;
use std::sync::Arc;

use super::glue::{self, BY};
use super::material::{Cell, Element, Material, Order, Point, real};
use super::stroke::{BladeMove, Progress, Uncut, share};
use super::tear::TearView;
use super::{CutError, CutReport, cut_material, material_of, open_now, prepared, rest_of, row_of};

/// How far (mean edges) from the plane of a blade a point counts as on the side on which it was first: its lips move while it passes.
const NEAR: f64 = 0.02;
/// How far (mean edges) it is moved to that side to find what crosses.
const ASIDE: f64 = 0.05;

/// What strokes of blades through bodies have decided, and where bodies were when blades were last looked at.
#[derive(Resource, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StrokeMemory {
    bodies: BTreeMap<usize, BodyStroke>,
}

impl StrokeMemory {
    /// Whether it can belong to a world of so many bodies.
    pub fn fits(&self, bodies: usize) -> bool {
        self.bodies.keys().all(|body| *body < bodies)
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct BodyStroke {
    /// None before a blade crosses an edge.
    progress: Option<Progress>,
    /// Places (m) of its rows at the last look.
    places: Vec<DVec3>,
}

/// A straight part of the edge of a blade, from the last look to now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeMove {
    /// Its ends (m) then.
    pub before: [DVec3; 2],
    /// Its ends (m) now.
    pub after: [DVec3; 2],
    /// Direction in which it cuts now.
    pub into: DVec3,
}

/// The material of a body, looked at.
#[derive(Clone, Debug, Default)]
pub struct BladeView {
    /// Of what changes of the body it was made, and whether a stroke was going on that had opened something.
    of: Option<(u64, bool)>,
    material: Arc<Material>,
    uncut: Arc<Uncut>,
    /// A cell that has each point that no vertex is, of the uncut material.
    holders: Vec<u32>,
    /// Mean edge (m) at rest.
    pub edge: f64,
    /// Places (m) of the rows of the body.
    places: Vec<DVec3>,
    /// First row of the body, and rows from that on of its vertices and ghosts.
    first: u32,
    rows: Vec<u32>,
    /// Cells in focus, with the places (m) of their corners.
    focus: Vec<(u32, [DVec3; 4])>,
}

/// Views of bodies by their index: they follow from the bodies, and are kept since they are costly.
#[derive(Resource, Clone, Debug, Default)]
pub struct BladeViews {
    blades: BTreeMap<usize, BladeView>,
    pub(super) tears: BTreeMap<usize, TearView>,
}

/// Looks at a body that can be cut, as it is now.
///
/// # Errors
/// When it cannot be cut.
pub fn view<S: Scalar>(world: &mut World, body: usize) -> Result<BladeView, CutError> {
    let of = version(world, body);
    let mut views = take::<BladeViews>(world);
    let known = views.blades.remove(&body).filter(|view| view.of == of);
    put(world, views);
    let mut view = match known {
        Some(view) => view,
        None => BladeView::new(world, body)?,
    };
    view.places = places::<S>(world, body);
    Ok(view)
}

/// What a view must be of. A stroke that begins decides on the material as it is then, not on that of the one before.
fn version(world: &World, body: usize) -> Option<(u64, bool)> {
    let changes = world.resource::<Topology>().bodies.get(body)?.changes;
    let memory = world.get_resource::<StrokeMemory>();
    let progress = memory.and_then(|memory| memory.bodies.get(&body)?.progress.as_ref());
    Some((changes, progress.is_some_and(Progress::has_opened)))
}

/// Keeps a view for the next look.
pub fn keep_view(world: &mut World, body: usize, view: BladeView) {
    ensure::<BladeViews>(world).blades.insert(body, view);
}

/// Forgets what strokes through a body have decided: no blade is near.
pub fn end_stroke(world: &mut World, body: usize) {
    if let Some(mut memory) = world.get_resource_mut::<StrokeMemory>() {
        memory.bodies.remove(&body);
    }
}

/// What a stroke of a blade through this material that goes on has decided.
pub(super) fn going_on(world: &World, body: usize, uncut: &Uncut) -> Option<Progress> {
    let own = world.get_resource::<StrokeMemory>()?.bodies.get(&body)?.progress.as_ref()?;
    (own.has_opened() && uncut.fits(own)).then(|| own.clone())
}

/// Lets such a stroke go on from what else was decided since.
pub(super) fn go_on(world: &mut World, body: usize, progress: Progress) {
    let memory = world.get_resource_mut::<StrokeMemory>();
    let own =
        memory.and_then(|memory| memory.into_inner().bodies.get_mut(&body)?.progress.as_mut());
    if let Some(own) = own.filter(|own| own.has_opened()) {
        *own = progress;
    }
}

/// Places (m) of all rows of a body, spare ones included.
pub(super) fn places<S: Scalar>(world: &mut World, body: usize) -> Vec<DVec3> {
    let mut query = world.query::<(&RestPosition, &Displacement<S>)>();
    let rows = world.resource::<Topology>().bodies[body].vertices.clone();
    let Some((rest, u)) = single_table(query.contiguous_iter(world)) else { return Vec::new() };
    (rows.start as usize..rows.end as usize).map(|row| rest[row].0 + u[row].get()).collect()
}

/// Box (m) round the vertices of a body now.
pub fn hull<S: Scalar>(world: &mut World, body: usize) -> [DVec3; 2] {
    let at = places::<S>(world, body);
    let used = world.resource::<Topology>().bodies[body].vertex_order.len();
    let own = at.iter().take(used).copied();
    let low = own.clone().fold(DVec3::INFINITY, DVec3::min);
    [low, own.fold(DVec3::NEG_INFINITY, DVec3::max)]
}

impl BladeView {
    fn new(world: &mut World, body: usize) -> Result<Self, CutError> {
        let resection = prepared(world, body)?;
        let own = resection.bodies[body].as_ref().expect("it was prepared");
        let material = material_of(world, body, own);
        put(world, resection);
        let rows = &world.resource::<Topology>().bodies[body];
        let nodes = 0..(rows.mesh_vertices() + material.ghosts.len()) as u32;
        let (first, rows) = (rows.vertices.start, nodes.map(|node| row_of(rows, node)).collect());
        let of = version(world, body);
        let uncut = match (&material.uncut, of) {
            (Some(uncut), Some((_, true))) => uncut.clone(),
            _ => Arc::new(Uncut::new(&material)),
        };
        let mut holders = vec![0; (uncut.points - material.vertices) as usize];
        for (number, cell) in (0..).zip(&material.cells) {
            for &p in cell.points().iter().filter(|&&p| p >= material.vertices && p < uncut.points)
            {
                holders[(p - material.vertices) as usize] = number;
            }
        }
        let (edge, places) = (0.0, Vec::new());
        let focus = Vec::new();
        let mut view = Self { of, material, uncut, holders, edge, places, first, rows, focus };
        let rest = rest_of(world, body);
        let at_rest = |vertex: u32| rest[view.rows[vertex as usize] as usize];
        view.edge = view.uncut.mean_edge(view.material.vertices, &at_rest);
        Ok(view)
    }

    fn node(&self, node: u32, at: &[DVec3]) -> DVec3 {
        at[self.rows[node as usize] as usize]
    }

    /// Place (m) of a point of the uncut material.
    fn place(&self, point: u32, at: &[DVec3]) -> DVec3 {
        // whoever holds a vertex is moved by it
        match point.checked_sub(self.material.vertices) {
            None => self.node(point, at),
            Some(made) => {
                let cell = self.material.cells.get(self.holders[made as usize] as usize);
                // where all is gone there is nothing
                cell.map_or(DVec3::NAN, |cell| {
                    self.material.place(cell, point, &|node| self.node(node, at))
                })
            }
        }
    }

    /// Place (m) of a point of the material that elements on either side of a wound have: the middle between them.
    fn middle(&self, place: &Point, sides: [u32; 2], at: &[DVec3]) -> DVec3 {
        let own = |e: u32| &self.material.elements[e as usize];
        let of = |e| self.material.held_at(own(e), place, |node| self.node(node, at));
        0.5 * (of(sides[0]) + of(sides[1]))
    }

    /// Looks at what is in a box (m); a membrane alone has no volume in which something could be.
    pub fn focus(&mut self, [low, high]: [DVec3; 2]) {
        let size = self.material.order.size();
        if self.material.order == Order::Triangles {
            return;
        }
        let inside = |x: [DVec3; 4]| {
            let [least, most] = bounds(x);
            least.cmple(high).all() && low.cmple(most).all()
        };
        // material lies in the element that moves it; sides of ten-node tetrahedra bulge by less than half an edge
        let more = if self.material.order == Order::TenNodes { 0.5 * self.edge } else { 0.0 };
        let (least, most) = (low - more, high + more);
        let places = self.rows.iter().map(|row| self.places[*row as usize]);
        let beyond: Vec<u32> = places.map(|x| beyond([x; 2], [least, most])).collect();
        let common =
            |own: &Element| (0..size).fold(!0, |all, i| all & beyond[own.node(i) as usize]);
        let near: Vec<bool> = self.material.elements.iter().map(|own| common(own) == 0).collect();
        let place = |cell: &Cell, p| self.material.place(cell, p, &|n| self.node(n, &self.places));
        let cells = (0..).zip(&self.material.cells).filter(|(_, c)| near[c.element as usize]);
        let cells = cells.map(|(number, cell)| (number, cell.corners.map(|p| place(cell, p))));
        self.focus = cells.filter(|(_, x)| inside(*x)).collect();
    }

    /// The element in focus whose material has a place (m), the shares of four of its vertices round it, which add up to 1 and give that
    /// place now, and its part of the volume of the whole element. `hint` is a place beside it that tells the side of a wound. In elements
    /// of more than four vertices it moves on as a linear one between those four would.
    pub fn locate(&self, at: DVec3, hint: DVec3) -> Option<([VertexRow; 4], [f64; 4], f64)> {
        let (found, _) = self.focus.iter().find(|(_, x)| {
            let [low, high] = bounds(*x);
            hint.cmpge(low).all()
                && hint.cmple(high).all()
                && shares(*x, hint).is_some_and(|own| own.iter().all(|share| *share >= -1e-9))
        })?;
        let cell = &self.material.cells[*found as usize];
        let element = &self.material.elements[cell.element as usize];
        let nodes = self.material.round(cell).map(|i| element.node(i));
        let rows = nodes.map(|node| VertexRow(self.first + self.rows[node as usize]));
        let own = shares(nodes.map(|node| self.node(node, &self.places)), at)?;
        Some((rows, own, element.share()))
    }

    /// Place (m) of a mean of rows of the body.
    pub fn at(&self, rows: [VertexRow; 4], weights: [f64; 4]) -> DVec3 {
        let place = |row: VertexRow| self.places[(row.0 - self.first) as usize];
        rows.into_iter().zip(weights).map(|(row, w)| w * place(row)).sum()
    }
}

/// The sides of a box, as bits, beyond which a point was all the way between two places. What has points with one in common was not in it.
fn beyond([before, after]: [DVec3; 2], [low, high]: [DVec3; 2]) -> u32 {
    let above = before.min(after).cmpgt(high).bitmask();
    above | before.max(after).cmplt(low).bitmask() << 3
}

fn bounds([a, b, c, d]: [DVec3; 4]) -> [DVec3; 2] {
    [a.min(b).min(c).min(d), a.max(b).max(c).max(d)]
}

/// Barycentric coordinates of a place in a tetrahedron.
pub(super) fn shares([a, b, c, d]: [DVec3; 4], x: DVec3) -> Option<[f64; 4]> {
    let edges = glam::DMat3::from_cols(b - a, c - a, d - a);
    let own = edges.inverse() * (x - a);
    own.is_finite().then_some([1.0 - own.x - own.y - own.z, own.x, own.y, own.z])
}

/// Cuts a body by what parts of edges crossed since the last look, while the body moved, too. `None` where nothing fell apart. No
/// edge of a body that blades have not been near is crossed at the first look.
///
/// # Errors
/// When the body cannot be cut, or has too few spare vertices; nothing is changed then.
pub fn sweep<S: Scalar>(
    world: &mut World,
    body: usize,
    view: &BladeView,
    moves: &[EdgeMove],
) -> Result<Option<CutReport>, CutError> {
    let mut memory = take::<StrokeMemory>(world);
    let own = memory.bodies.entry(body).or_default();
    let cut = own.advance::<S>(world, body, view, moves);
    if cut.is_ok() {
        own.places = places::<S>(world, body);
    }
    put(world, memory);
    cut
}

impl BodyStroke {
    fn advance<S: Scalar>(
        &mut self,
        world: &mut World,
        body: usize,
        view: &BladeView,
        moves: &[EdgeMove],
    ) -> Result<Option<CutReport>, CutError> {
        // an edge that the tissue holds goes on later
        if self.places.len() != view.places.len() || moves.is_empty() {
            return Ok(None);
        }
        let both = |p| [view.place(p, &self.places), view.place(p, &view.places)];
        let points: Vec<[DVec3; 2]> = (0..view.uncut.points).map(both).collect();
        let point = |p: u32| points[p as usize];
        let all = moves.iter().flat_map(|own| own.before.into_iter().chain(own.after));
        let margin = ASIDE * view.edge;
        let low = all.clone().fold(DVec3::INFINITY, DVec3::min) - margin;
        let high = all.fold(DVec3::NEG_INFINITY, DVec3::max) + margin;
        let beyond: Vec<u32> = points.iter().map(|own| beyond(*own, [low, high])).collect();
        let edges = (0..).zip(view.uncut.edges.iter().copied());
        let is_near =
            |(_, [a, b]): &(u32, [u32; 2])| beyond[*a as usize] & beyond[*b as usize] == 0;
        let near: Vec<(u32, [u32; 2])> = edges.filter(is_near).collect();
        if near.is_empty() {
            let is_in = |corners: &[u32; 4]| {
                let own = real(corners).iter().map(|p| point(*p)[1]);
                let least = own.clone().fold(DVec3::INFINITY, DVec3::min);
                let most = own.fold(DVec3::NEG_INFINITY, DVec3::max);
                least.cmple(high).all() && low.cmple(most).all()
            };
            if !view.uncut.cells.iter().any(is_in) {
                self.progress = None;
            }
            return Ok(None);
        }
        let mut progress = match &self.progress {
            Some(progress) if view.uncut.fits(progress) => progress.clone(),
            _ => view.uncut.begin(),
        };
        let goes_on = progress.has_opened();
        let mut separated = Vec::new();
        for own in moves.iter().filter(|own| own.after[0] != own.after[1]) {
            let on = own.after[0];
            let along = own.after[1] - on;
            let across = along.cross(own.into).normalize_or_zero();
            for p in near.iter().flat_map(|(_, edge)| *edge) {
                let (at, side) = (point(p)[1] - on, &mut progress.sides[p as usize]);
                let (away, part) = (across.dot(at), along.dot(at) / along.length_squared());
                // parts of an edge are somewhat turned against each other
                let is_beside = (-1.0..=2.0).contains(&part);
                if *side == 0 && is_beside && away.abs() < NEAR * view.edge {
                    *side = if away < 0.0 { -1 } else { 1 };
                }
            }
            let sides = &progress.sides;
            let aside = |p: u32| f64::from(sides[p as usize]) * margin * across;
            let cross = |(e, ends): &(u32, [u32; 2])| {
                Some((*e, crossing(ends.map(point), ends.map(aside), own)?))
            };
            let crossed: Vec<(u32, f64)> = near.iter().filter_map(cross).collect();
            let mean = |ends: [DVec3; 2]| 0.5 * (ends[0] + ends[1]);
            let blade = mean(own.after) - mean(own.before);
            let way = |corners: [u32; 4]| {
                let ways =
                    real(&corners).iter().map(|p| point(*p)).map(|[before, after]| after - before);
                let count = ways.len() as f64;
                let way = blade - ways.sum::<DVec3>() / count;
                // lips that spring apart move by as much as the edge does: what is not cut yet is cut in the plane of the blade, but where
                // this goes through tissue sideways
                let aside = way.dot(across).abs() > way.reject_from_normalized(across).length();
                if aside { way } else { own.into }
            };
            let sides = progress.sides.clone();
            let aside = |p: u32| f64::from(sides[p as usize]) * margin * across;
            let place = |p: u32| [point(p)[1], point(p)[1] + aside(p)];
            let (way, again) = (&way, false);
            let to = BladeMove { crossed, place: &place, on, along, way, again };
            separated.extend(view.uncut.advance(&mut progress, &to));
        }
        separated.sort_unstable();
        let mut report = None;
        if !separated.is_empty() {
            let stroke = view.uncut.stroke(&mut progress, separated, goes_on);
            report = Some(open_now::<S>(world, body, &stroke)?);
        }
        self.unglue::<S>(world, body, view, moves);
        self.progress = Some(progress);
        Ok(report)
    }

    /// Lets glue go that edges passed since the last look. What just came apart is looked at as its elements moved before, and what of it is
    /// behind an edge was passed earlier.
    fn unglue<S: Scalar>(
        &self,
        world: &mut World,
        body: usize,
        view: &BladeView,
        moves: &[EdgeMove],
    ) {
        let Some(material) = cut_material(world, body) else { return };
        let unswept = glue::unswept(world, body, material);
        let known = view.material.elements.len() as u32;
        let before = |e: u32| if e < known { e } else { material.elements[e as usize].parent };
        let is_passed = |bond: &usize| {
            let own = &material.bonds[*bond];
            let sides = own.sides.map(before);
            let place = [&self.places, &view.places].map(|at| view.middle(&own.place, sides, at));
            let is_new = *bond >= view.material.bonds.len();
            moves.iter().any(|own| {
                own.passes(place, view.edge) || is_new && own.is_past(place[1], view.edge)
            })
        };
        let passed: Vec<usize> = unswept.into_iter().filter(is_passed).collect();
        glue::release::<S>(world, body, &passed);
    }
}

impl EdgeMove {
    /// Whether it went by a place (m), before and now, near to it beside tissue of such edges (m).
    fn passes(&self, place: [DVec3; 2], edge: f64) -> bool {
        let along = self.after[1] - self.after[0];
        let beside = BY * edge * along.cross(self.into).normalize_or_zero();
        let ends = [-beside, beside].map(|away| place.map(|x| x + away));
        beside != DVec3::ZERO && crossing(ends, [DVec3::ZERO; 2], self).is_some()
    }

    /// Whether a place (m) is behind it now, and so near to it beside.
    fn is_past(&self, place: DVec3, edge: f64) -> bool {
        let (at, along) = (place - self.after[0], self.after[1] - self.after[0]);
        let part = at.dot(along) / along.length_squared();
        let beside = at.dot(along.cross(self.into).normalize_or_zero()).abs();
        let is_behind = (at - part * along).dot(self.into) < 0.0;
        (0.0..=1.0).contains(&part) && is_behind && beside < BY * edge
    }
}

/// Where on an edge of the material (0 to 1), by its ends (m) before and after, a part of a blade crosses it first. Its ends count as moved (m).
pub fn crossing([a, b]: [[DVec3; 2]; 2], aside: [DVec3; 2], blade: &EdgeMove) -> Option<f64> {
    let ([p0, q0], [p1, q1]) = (blade.before, blade.after);
    // everything relative to the first end of the blade, and linear in time
    let between = aside[1] - aside[0];
    let u = [a[0] + aside[0] - p0, (a[1] - p1) - (a[0] - p0)];
    let v = [b[0] - a[0] + between, (b[1] - a[1]) - (b[0] - a[0])];
    let w = [q0 - p0, (q1 - p1) - (q0 - p0)];
    // u . (v x w), a cubic
    let cross = [v[0].cross(w[0]), v[0].cross(w[1]) + v[1].cross(w[0]), v[1].cross(w[1])];
    let coefficients = [
        u[0].dot(cross[0]),
        u[0].dot(cross[1]) + u[1].dot(cross[0]),
        u[0].dot(cross[2]) + u[1].dot(cross[1]),
        u[1].dot(cross[2]),
    ];
    roots(coefficients).into_iter().flatten().find_map(|time| {
        let at = |x: [DVec3; 2]| x[0] + time * x[1];
        let (u, v, w) = (at(u), at(v), at(w));
        // u + s v = r w
        let normal = v.cross(w);
        let square = normal.length_squared();
        let s = w.cross(u).dot(normal) / square;
        let r = v.cross(u).dot(normal) / square;
        let inside = |x: f64| (0.0..=1.0).contains(&x);
        if !(inside(s) && inside(r)) {
            return None;
        }
        if aside == [DVec3::ZERO; 2] {
            return Some(s);
        }
        let across = w.cross(blade.into);
        let away = [u, u + v].map(|x| across.dot(x));
        let [a, b] = [0, 1].map(|i| [away[i] - across.dot(aside[i]), away[i]]);
        // what crosses backwards is on one side of the plane
        Some(if (a[1] >= 0.0) == (b[1] >= 0.0) { s } else { share(a, b) })
    })
}

/// Roots of a cubic in the unit interval, ascending: one in each part in which it goes up or down alone.
pub fn roots([a, b, c, d]: [f64; 4]) -> [Option<f64>; 3] {
    let value = |t: f64| a + t * (b + t * (c + t * d));
    // where it turns
    let half = c * c - 3.0 * d * b;
    let mut turns = [0.0, 1.0, 1.0, 1.0];
    if half > 0.0 {
        let q = -(c + half.sqrt().copysign(c));
        let mut own = [q / (3.0 * d), b / q].map(|t| if t > 0.0 && t < 1.0 { t } else { 1.0 });
        own.sort_by(f64::total_cmp);
        turns = [0.0, own[0], own[1], 1.0];
    }
    let mut found = [None; 3];
    for (i, found) in found.iter_mut().enumerate() {
        let (mut low, mut high) = (turns[i], turns[i + 1]);
        let (first, last) = (value(low), value(high));
        if low >= high || first == 0.0 || last == 0.0 || (first > 0.0) == (last > 0.0) {
            let ends = [(low, first), (high, last)].into_iter().find(|(_, f)| *f == 0.0);
            // all of it lies in one plane: no crossing
            *found = ends.filter(|_| low < high && first != last).map(|(t, _)| t);
            continue;
        }
        // 60 halvings leave nothing of the interval
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (value(middle) > 0.0) == (last > 0.0) {
                high = middle;
            } else {
                low = middle;
            }
        }
        *found = Some(high);
    }
    found
}
