//! A surface that is finer than the mesh of a body and carried along by it, through cuts: in its [skin](super::MaterialSkin) it takes
//! the place of what is left of the outside of the mesh. Wounds and what removals laid open stay.
//!
//! Every point hangs on the element in which it lies, or the nearest. Where a cut parted that one, it hangs on the copy that has the
//! material nearest to it. Two points are apart when the elements that move them have vertices of the mesh in common and none
//! that moves both, or are parts of one element. An edge between such points is cut where its one side ends, found by bisection, and its triangles with it; each
//! side of the wound has points of its own there, which are at one place at rest. The edges of the wound are brought to these points.

use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use sinew_engine::connectivity::{ElementKind, Incidence, PerElement};
use sinew_engine::isoparametric::{CORNERS, hexahedron_shape, tetrahedron10_shape};
use sinew_engine::mesh::{EmbeddedPoints, Mesh, place_in_hexahedron};
use sinew_engine::resource::ensure;
use sinew_engine::surface::closest_point;
use sinew_engine::topology::{BodyRows, Topology};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use super::hexahedra::local;
use super::material::{Cell, Element, Material, Order, padded};
use super::skin::{Moved, cut_material, elements};
use super::{CutError, MaterialSkin, check_cut, in_mesh, kind_of, order_of, rest_of, row_of};

/// Halvings of an edge that look for the place where one side of a wound ends: to 1/4096 of its length.
const HALVINGS: u32 = 12;
/// Halvings of an edge of whose ends it is not plain whether they are apart.
const STEPS: u32 = 6;
/// Part of the size of an element by which a point may lie away from material that is left, beyond what it lies outside of the mesh.
const SLACK: f64 = 1e-6;
/// Edges of the mesh up to which an edge of a wound is brought to the surface.
const NEAR: f64 = 2.0;

/// Surfaces that bodies carry, by body.
#[derive(Resource, Clone, Debug, Default)]
pub struct FineSurfaces {
    own: BTreeMap<usize, Arc<FineSurface>>,
    /// Surfaces given so far.
    count: u64,
}

impl FineSurfaces {
    /// That of a body, with a number that is another after each change.
    pub(super) fn of(world: &World, body: usize) -> Option<(Arc<FineSurface>, u64)> {
        let all = world.get_resource::<Self>()?;
        Some((all.own.get(&body)?.clone(), all.count))
    }
}

/// A surface in a body that carries it.
#[derive(Clone, Debug)]
pub struct FineSurface {
    points: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Element of the mesh that each point hangs on.
    elements: Vec<u32>,
    /// Edges that are longer than the smaller of the elements that their ends hang on, which have no vertex in common: where a cut goes through
    /// them is found roughly.
    pub long: usize,
    /// Points that lie in none.
    pub outside: usize,
    /// Largest distance (m) of such a point from the element that it hangs on.
    pub farthest: f64,
}

/// Lets a body that can be cut carry a surface along: points (m) in the frame of its mesh, and triangles of them, outward. From then on
/// it takes the place of the outside of the mesh in its skin; a second one takes the place of the first.
///
/// # Errors
/// When the body cannot be cut or is a membrane alone, and when a triangle has a point that there is not; nothing is changed then.
pub fn carry_surface(
    world: &mut World,
    body: usize,
    points: &[DVec3],
    triangles: &[[u32; 3]],
) -> Result<Arc<FineSurface>, CutError> {
    check_cut(world, body)?;
    let rows = world.resource::<Topology>().bodies[body].clone();
    let wrong = |problem: &str| {
        let problem = problem.into();
        CutError::Body { body: rows.name.clone(), problem }
    };
    if order_of(&rows) == Order::Triangles {
        return Err(wrong(
            "a membrane alone carries no surface through cuts; take a body of tetrahedra or hexahedra, or no surface",
        ));
    }
    let known = triangles.iter().flatten().all(|&p| (p as usize) < points.len());
    if !known || triangles.is_empty() || !points.iter().all(|p| p.is_finite()) {
        return Err(wrong(
            "the surface it is to carry has no triangles, points that are not finite, or triangles of points that there are not",
        ));
    }
    let kind = kind_of(&rows);
    let mesh = corners_at_rest(world, body, &rows);
    let embedding =
        EmbeddedPoints::new(&mesh, points).ok_or_else(|| wrong("it has no elements"))?;
    let on: Vec<u32> = embedding.cells().map(|(_, cell)| cell).collect();
    let vertices = |p: u32| mesh.cell(kind, on[p as usize] as usize);
    let size = |p: u32| {
        let own = vertices(p);
        let corner = |i: usize| own.map_or(DVec3::ZERO, |own| mesh.points[own[i] as usize]);
        edges_of(kind).map(|[i, j]| corner(i).distance(corner(j))).fold(0.0, f64::max)
    };
    let are_near = |a: u32, b: u32| match (vertices(a), vertices(b)) {
        (Some(a), Some(b)) => a.iter().any(|v| b.contains(v)),
        _ => true,
    };
    let is_long = |&[a, b]: &[u32; 2]| {
        let way = points[a as usize].distance(points[b as usize]);
        way > size(a).min(size(b)) && !are_near(a, b)
    };
    let edges = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let edges: BTreeSet<[u32; 2]> = edges.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    let surface = Arc::new(FineSurface {
        points: points.to_vec(),
        triangles: triangles.to_vec(),
        long: edges.iter().filter(|edge| is_long(edge)).count(),
        elements: on,
        outside: embedding.outside,
        farthest: embedding.farthest,
    });
    let mut all = ensure::<FineSurfaces>(world);
    all.own.insert(body, surface.clone());
    all.count += 1;
    Ok(surface)
}

/// The whole mesh of a body at rest, of ten-node tetrahedra their corners alone.
fn corners_at_rest(world: &mut World, body: usize, rows: &BodyRows) -> Mesh {
    fn of<const N: usize>(world: &World, body: usize, rows: &BodyRows) -> Vec<[u32; N]> {
        match cut_material(world, body) {
            None => in_mesh(rows, kind_of(rows)),
            Some(material) => elements(material).map(Element::all_vertices).collect(),
        }
    }
    let mut mesh = Mesh::default();
    match order_of(rows) {
        Order::Hexahedra => mesh.hexahedra = of::<8>(world, body, rows),
        Order::TenNodes => {
            let all = of::<10>(world, body, rows).into_iter();
            mesh.tetrahedra = all.map(|[a, b, c, d, ..]| [a, b, c, d]).collect();
        }
        Order::Linear | Order::Triangles => mesh.tetrahedra = of::<4>(world, body, rows),
    }
    mesh.points = vertices_at_rest(world, body, rows.mesh_vertices() as u32);
    mesh
}

/// Corners of the edges of a tetrahedron or hexahedron.
fn edges_of(kind: ElementKind) -> impl Iterator<Item = [usize; 2]> {
    let is_edge = move |&[i, j]: &[usize; 2]| {
        let differ = |k: &usize| CORNERS[i][*k] != CORNERS[j][*k];
        kind != ElementKind::Hexahedron || (0..3).filter(differ).count() == 1
    };
    let corners = if kind == ElementKind::Hexahedron { 8 } else { 4 };
    (0..corners).flat_map(|i| (0..i).map(move |j| [j, i])).filter(is_edge)
}

/// Lets a body carry no surface any more: its skin is that of its mesh again.
pub fn drop_surface(world: &mut World, body: usize) {
    if let Some(mut all) = world.get_resource_mut::<FineSurfaces>() {
        all.own.remove(&body);
    }
}

/// Whether a body carries a surface along.
pub fn carries_surface(world: &World, body: usize) -> bool {
    world.get_resource::<FineSurfaces>().is_some_and(|all| all.own.contains_key(&body))
}

/// Places (m) of the vertices of the mesh at rest.
pub(super) fn vertices_at_rest(world: &mut World, body: usize, count: u32) -> Vec<DVec3> {
    let rest = rest_of(world, body);
    let rows = &world.resource::<Topology>().bodies[body];
    (0..count).map(|v| rest[row_of(rows, v) as usize]).collect()
}

/// Element, of the mesh or a copy, that moves a point.
pub(super) type Hold = u32;

/// Material that points of a surface hang on.
pub(super) struct Grip<'a> {
    material: &'a Material,
    rest: &'a [DVec3],
    /// Places (m) at rest of the points of the material of tetrahedra.
    places: Vec<DVec3>,
    /// Boxes (m) round hexahedra of the mesh; none of tetrahedra.
    boxes: Vec<[DVec3; 2]>,
    /// Cells of every element of the mesh that are left.
    cells: Vec<Vec<u32>>,
    /// Elements of the mesh round every vertex.
    round: Incidence,
}

impl<'a> Grip<'a> {
    pub fn new(material: &'a Material, rest: &'a [DVec3]) -> Self {
        let place = |point: &super::material::Point| -> DVec3 {
            let used = point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
            used.map(|(&v, w)| w * rest[v as usize]).sum()
        };
        let (mut places, mut boxes) = (Vec::new(), Vec::new());
        let round = if material.order == Order::Hexahedra {
            let whole: Vec<[u32; 8]> = elements(material).map(Element::all_vertices).collect();
            boxes.extend(whole.iter().map(|own| {
                let [low, high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                let corners = || own.iter().map(|&v| rest[v as usize]);
                [corners().fold(low, DVec3::min), corners().fold(high, DVec3::max)]
            }));
            PerElement::from(whole)
        } else {
            places.extend(material.points.iter().map(place));
            PerElement::from(elements(material).map(|own| own.vertices).collect::<Vec<_>>())
        };
        let mut cells = vec![Vec::new(); elements(material).count()];
        for (number, cell) in (0..).zip(&material.cells) {
            cells[material.elements[cell.element as usize].source as usize].push(number);
        }
        let round = Incidence::new(rest.len(), &round);
        Self { material, rest, places, boxes, cells, round }
    }

    /// Corners of an element of the mesh.
    fn vertices(&self, element: u32) -> impl Iterator<Item = u32> + '_ {
        let corners = if self.material.order == Order::Hexahedra { 8 } else { 4 };
        (0..corners).map(move |i| self.material.elements[element as usize].vertex(i))
    }

    /// Places (m) at rest of the first `N` vertices of an element.
    fn corners<const N: usize>(&self, element: u32) -> [DVec3; N] {
        let own = &self.material.elements[element as usize];
        own.all_vertices().map(|v| self.rest[v as usize])
    }

    /// Length (m) of an edge of an element of the mesh.
    fn size(&self, element: u32) -> f64 {
        let [a, b] = self.corners(element);
        a.distance(b)
    }

    /// Distance (m) of a place from a box round an element: none of tetrahedra.
    fn away_from_box(&self, place: DVec3, element: u32) -> f64 {
        let own = self.boxes.get(element as usize);
        own.map_or(0.0, |[low, high]| place.distance(place.clamp(*low, *high)))
    }

    /// Where a place is in an element of the mesh, and its distance (m) from it. Cells of tetrahedra are tetrahedra in space, those of a
    /// hexahedron in the cube of its shape functions.
    fn place_in(&self, place: DVec3, element: u32) -> (DVec3, f64) {
        if self.material.order != Order::Hexahedra {
            return (place, distance(place, self.corners(element)));
        }
        let (at, away) = place_in_hexahedron(&self.corners(element), place);
        (2.0 * at - DVec3::ONE, away)
    }

    /// Distance (m) of a place from a cell, when it is [known](Self::place_in) where that is in its element.
    fn away(&self, place: DVec3, (at, away): (DVec3, f64), cell: &Cell) -> f64 {
        if self.material.order != Order::Hexahedra {
            return distance(place, cell.corners.map(|p| self.places[p as usize]));
        }
        let vertices = self.material.elements[cell.element as usize].all_vertices();
        let corners = cell.corners.map(|p| local(&vertices, &self.material.points[p as usize]));
        match nearest(at, corners) {
            None if away == 0.0 => 0.0,
            near => {
                let weights = hexahedron_shape(near.unwrap_or(at).to_array());
                let corners = vertices.iter().map(|&v| self.rest[v as usize]);
                place.distance(corners.zip(weights).map(|(x, w)| w * x).sum())
            }
        }
    }

    /// What moves a place near some elements of the mesh; `None` where the material there is gone.
    fn at(&self, place: DVec3, among: impl Iterator<Item = u32>) -> Option<Hold> {
        let mut best: Option<(f64, u32, u32)> = None;
        let mut least_away = f64::INFINITY;
        let mut among: Vec<(f64, u32)> =
            among.map(|element| (self.away_from_box(place, element), element)).collect();
        among.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (at_least, element) in among {
            let least = best.map_or(f64::INFINITY, |(least, ..)| least);
            if at_least >= least {
                break;
            }
            let inside = self.place_in(place, element);
            least_away = least_away.min(inside.1);
            if inside.1 >= least {
                continue;
            }
            for &cell in &self.cells[element as usize] {
                let own = &self.material.cells[cell as usize];
                let away = self.away(place, inside, own);
                if best.is_none_or(|(least, ..)| away < least) {
                    best = Some((away, own.element, element));
                }
            }
        }
        let (away, hold, element) = best?;
        (away <= least_away + SLACK * self.size(element)).then_some(hold)
    }

    /// The elements round two: those that have vertices in common with one of them, and further ones where these have none themselves.
    fn round(&self, both: [u32; 2]) -> BTreeSet<u32> {
        let of = |element| self.vertices(element);
        let grown = |own: BTreeSet<u32>| -> BTreeSet<u32> {
            own.into_iter().flat_map(of).flat_map(|v| self.round.of(v).iter().copied()).collect()
        };
        let near = grown(both.into());
        if of(both[0]).any(|v| of(both[1]).any(|w| v == w)) { near } else { grown(near) }
    }

    /// Element of the mesh behind a hold.
    fn source(&self, hold: Hold) -> u32 {
        self.material.elements[hold as usize].source
    }

    /// Number of the vertices of the mesh that two elements have in common, whose node is the same and another one.
    fn common(&self, a: Hold, b: Hold) -> (u32, u32) {
        let [a, b] = [a, b].map(|hold| &self.material.elements[hold as usize]);
        let size = self.material.order.size();
        let both = (0..size).flat_map(|i| (0..size).map(move |j| (i, j)));
        let (mut same, mut other) = (0, 0);
        for (i, j) in both.filter(|&(i, j)| a.vertex(i) == b.vertex(j)) {
            *if a.node(i) == b.node(j) { &mut same } else { &mut other } += 1;
        }
        (same, other)
    }

    /// Whether nothing moves two points both; `None` where that is not plain: where nothing could, and where something does of what could.
    fn are_apart(&self, a: Hold, b: Hold) -> Option<bool> {
        match self.common(a, b) {
            // parts of one element are apart, also where a vertex moves both
            _ if self.source(a) == self.source(b) => Some(a != b),
            (0, 0) => None,
            (_, 0) => Some(false),
            (0, _) => Some(true),
            _ => None,
        }
    }

    /// Whether a wound goes through an edge between two places.
    fn is_cut(&self, [(p, a), (q, b)]: [(DVec3, Hold); 2], steps: u32) -> bool {
        if let Some(apart) = self.are_apart(a, b) {
            return apart;
        }
        let middle = 0.5 * (p + q);
        let near = self.round([self.source(a), self.source(b)]);
        let found = (steps > 0).then(|| self.at(middle, near.into_iter())).flatten();
        // a wound ends between neighbours, or what is looked for is too small
        let Some(hold) = found else { return self.common(a, b) != (0, 0) };
        self.is_cut([(p, a), (middle, hold)], steps - 1)
            || self.is_cut([(middle, hold), (q, b)], steps - 1)
    }

    /// Share of the way from the first of two places to the other at which a wound goes through the edge between them.
    fn crossing(&self, [(p, a), (q, b)]: [(DVec3, Hold); 2]) -> f64 {
        let near = self.round([self.source(a), self.source(b)]);
        let [mut low, mut high] = [0.0, 1.0];
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let place = p.lerp(q, middle);
            let own = self.at(place, near.iter().copied());
            match own.is_some_and(|own| self.is_cut([(p, a), (place, own)], STEPS)) {
                true => high = middle,
                false => low = middle,
            }
        }
        0.5 * (low + high)
    }

    /// What moves a point at a place that an element moves: its shape functions there.
    fn moved(&self, hold: Hold, place: DVec3) -> Moved {
        let element = &self.material.elements[hold as usize];
        let shares = || shares(place, self.corners(hold));
        let weights = match self.material.order {
            Order::Linear | Order::Triangles => padded(shares()),
            Order::TenNodes => tetrahedron10_shape(shares()),
            Order::Hexahedra => padded(hexahedron_shape(self.place_in(place, hold).0.to_array())),
        };
        let size = self.material.order.size();
        (std::array::from_fn(|i| element.node(if i < size { i } else { 0 })), weights)
    }
}

/// Weights of the corners of a tetrahedron at a place, which may lie outside.
fn shares(place: DVec3, [a, b, c, d]: [DVec3; 4]) -> [f64; 4] {
    let part = DMat3::from_cols(b - a, c - a, d - a).inverse() * (place - a);
    [1.0 - part.element_sum(), part.x, part.y, part.z]
}

/// Distance (m) of a place from a tetrahedron: 0 inside.
fn distance(place: DVec3, corners: [DVec3; 4]) -> f64 {
    nearest(place, corners).map_or(0.0, |near| place.distance(near).min(f64::INFINITY))
}

/// Point of a tetrahedron that is nearest to a place; `None` inside.
fn nearest(place: DVec3, corners: [DVec3; 4]) -> Option<DVec3> {
    // of a flat one that of its faces
    if shares(place, corners).iter().all(|share| *share >= 0.0) {
        return None;
    }
    let faces = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
    let of = |face: [usize; 3]| -> DVec3 {
        let corners = face.map(|i| corners[i]);
        closest_point(place, corners).iter().zip(corners).map(|(share, x)| *share * x).sum()
    };
    let away = |a: &DVec3| place.distance(*a).min(f64::INFINITY);
    faces.map(of).into_iter().min_by(|a, b| away(a).total_cmp(&away(b)))
}

/// A skin whose surface is replaced.
struct Weave<'a> {
    surface: &'a FineSurface,
    grip: &'a Grip<'a>,
    skin: &'a mut MaterialSkin,
    /// What moves every point of the surface, and the number of the first of them in the skin.
    holds: &'a [Option<Hold>],
    first: u32,
    /// Points in the skin where a wound goes through an edge, that of its lower end first.
    crossings: HashMap<[u32; 2], Option<[u32; 2]>>,
    /// Points of the skin at the edges of wounds, with what moves them.
    lips: Vec<(u32, Hold)>,
}

/// Points of a surface, and their shares.
type Between = ([u32; 3], [f64; 3]);

impl Weave<'_> {
    fn add(&mut self, hold: Hold, place: DVec3, between: Between) -> u32 {
        let moved = self.grip.moved(hold, place);
        self.skin.rest.push(place);
        self.skin.depth.push(0.0);
        self.skin.carried.push(between);
        self.skin.add(moved)
    }

    fn push(&mut self, triangle: [u32; 3], hold: Hold) {
        self.skin.triangles.push(triangle);
        self.skin.wound.push(false);
        self.skin.elements.push(hold);
    }

    /// The point of an end of an edge and of its other end where a wound goes through; `None` where none does.
    fn cut(&mut self, [a, b]: [u32; 2]) -> Option<[u32; 2]> {
        let edge = [a.min(b), a.max(b)];
        let found = self.crossings.get(&edge).copied().unwrap_or_else(|| {
            let of = |this: &Self, p: u32| {
                Some((this.surface.points[p as usize], this.holds[p as usize]?))
            };
            let ends = edge.map(|p| of(self, p));
            let [Some((p, a)), Some((q, b))] = ends else { return None };
            let made = self.grip.is_cut([(p, a), (q, b)], STEPS).then(|| {
                // where points of two edges are at the same places, as on a seam of textures, their crossings are
                let turned = p.to_array() > q.to_array();
                let (ends, [low, high]) = match turned {
                    true => ([(q, b), (p, a)], [edge[1], edge[0]]),
                    false => ([(p, a), (q, b)], edge),
                };
                let share = self.grip.crossing(ends);
                let place = ends[0].0.lerp(ends[1].0, share);
                let between = ([low, high, high], [1.0 - share, share, 0.0]);
                [a, b].map(|hold| {
                    let point = self.add(hold, place, between);
                    self.lips.push((point, hold));
                    point
                })
            });
            self.crossings.insert(edge, made);
            made
        });
        found.map(|[low, high]| if a < b { [low, high] } else { [high, low] })
    }

    /// Adds what is left of a triangle.
    fn triangle(&mut self, [a, b, c]: [u32; 3]) {
        let holds = [a, b, c].map(|p| self.holds[p as usize]);
        let [Some(of_a), Some(of_b), Some(of_c)] = holds else { return };
        let own = [a, b, c].map(|p| self.first + p);
        let cuts = [[a, b], [b, c], [c, a]].map(|edge| self.cut(edge));
        let holds = [of_a, of_b, of_c];
        let count = cuts.iter().flatten().count();
        match count {
            0 => self.push(own, of_a),
            3 => {
                let middle =
                    [a, b, c].map(|p| self.surface.points[p as usize]).iter().sum::<DVec3>() / 3.0;
                for i in 0..3 {
                    let (Some([next, _]), Some([_, last])) = (cuts[i], cuts[(i + 2) % 3]) else {
                        continue;
                    };
                    let centre = self.add(holds[i], middle, ([a, b, c], [1.0 / 3.0; 3]));
                    self.push([own[i], next, centre], holds[i]);
                    self.push([own[i], centre, last], holds[i]);
                }
            }
            _ => {
                // the corner between the edges that are cut, or the first of the one that is
                let first = match count {
                    1 => cuts.iter().position(Option::is_some),
                    _ => cuts.iter().position(Option::is_none).map(|whole| (whole + 2) % 3),
                };
                let Some(i) = first else { return };
                let [j, k] = [(i + 1) % 3, (i + 2) % 3];
                let Some([near, far]) = cuts[i] else { return };
                match cuts[k] {
                    // the wound ends in it
                    None => {
                        self.push([own[i], near, own[k]], holds[i]);
                        self.push([far, own[j], own[k]], holds[j]);
                    }
                    Some([beyond, here]) => {
                        self.push([own[i], near, here], holds[i]);
                        self.push([far, own[j], own[k]], holds[j]);
                        self.push([far, own[k], beyond], holds[j]);
                    }
                }
            }
        }
    }

    /// Brings the edges of wounds at the surface of the mesh to those of this one.
    fn join_lips(&mut self) {
        let wound = |(_, wound): &(&[u32; 3], &bool)| **wound;
        let mut edges = BTreeSet::new();
        // what moves the points of wounds; where both sides meet it is not the same
        let mut behind = BTreeMap::<u32, BTreeSet<Hold>>::new();
        let MaterialSkin { triangles, elements, wound: is_wound, .. } = &*self.skin;
        let all = triangles.iter().zip(is_wound).zip(elements);
        for ((t, _), &element) in all.filter(|(own, _)| wound(own)) {
            edges.extend([[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
            t.iter().for_each(|&p| _ = behind.entry(p).or_default().insert(element));
        }
        let open = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).flatten();
        let rim: BTreeSet<u32> = open.copied().collect();
        let (mut to, mut copies) = (BTreeMap::<u32, u32>::new(), BTreeMap::<u32, u32>::new());
        for p in rim {
            let own: Vec<Hold> = behind.get(&p).into_iter().flatten().copied().collect();
            let apart = |a: &Hold| own.iter().any(|b| self.grip.are_apart(*a, *b) == Some(true));
            let Some(&element) = own.first().filter(|_| !own.iter().any(apart)) else { continue };
            let place = self.skin.rest[p as usize];
            let most = NEAR * self.grip.size(self.grip.source(element));
            let away = |point: u32| self.skin.rest[point as usize].distance(place);
            let common = |hold: Hold| std::cmp::Reverse(self.grip.common(element, hold).0);
            let near = self.lips.iter().filter(|(point, _)| away(*point) < most);
            let same = near.filter(|(_, hold)| self.grip.common(element, *hold).0 > 0);
            // both sides of the surface are at one place
            let nearest = same.min_by(|(a, of_a), (b, of_b)| {
                away(*a).total_cmp(&away(*b)).then(common(*of_a).cmp(&common(*of_b)))
            });
            let Some(&(lip, hold)) = nearest else { continue };
            // wounds share no points with what is round them
            let made = copies.get(&lip).copied();
            let made = made.unwrap_or_else(|| {
                self.add(hold, self.skin.rest[lip as usize], Between::default())
            });
            copies.insert(lip, made);
            to.insert(p, made);
        }
        let MaterialSkin { triangles, wound, elements, .. } = &mut *self.skin;
        for (triangle, _) in triangles.iter_mut().zip(&*wound).filter(|(_, wound)| **wound) {
            *triangle = triangle.map(|p| to.get(&p).copied().unwrap_or(p));
        }
        // of narrow ones nothing is left
        let keep = triangles.iter().map(|[a, b, c]| a != b && b != c && c != a);
        let keep: Vec<bool> = keep.collect();
        retain(triangles, &keep);
        retain(wound, &keep);
        retain(elements, &keep);
    }
}

fn retain<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut at = keep.iter();
    list.retain(|_| at.next().is_some_and(|keep| *keep));
}

impl FineSurface {
    /// Adds the points of a surface to a skin; what moves each, if anything is left there. They come before all that cuts made, so that
    /// each has the same number for ever.
    pub(super) fn hang(&self, grip: &Grip, skin: &mut MaterialSkin) -> Vec<Option<Hold>> {
        let of = |(&place, &element)| {
            let hold = grip.at(place, std::iter::once(element));
            match hold {
                Some(hold) => skin.add(grip.moved(hold, place)),
                None => skin.add_node(0),
            };
            hold
        };
        self.points.iter().zip(&self.elements).map(of).collect()
    }

    /// Places (m) at rest.
    pub(super) fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Adds the triangles of a surface to what a skin at rest has beside it. `first` is the number of its first point.
    pub(super) fn weave(
        &self,
        grip: &Grip,
        (holds, first): (&[Option<Hold>], u32),
        skin: &mut MaterialSkin,
    ) {
        let (crossings, lips) = (HashMap::new(), Vec::new());
        skin.carried = vec![Between::default(); skin.nodes.len()];
        for (point, own) in (0..self.points.len() as u32).zip(&mut skin.carried[first as usize..]) {
            *own = ([point; 3], [1.0, 0.0, 0.0]);
        }
        let mut weave = Weave { surface: self, grip, skin, holds, first, crossings, lips };
        self.triangles.iter().for_each(|triangle| weave.triangle(*triangle));
        weave.join_lips();
    }
}
