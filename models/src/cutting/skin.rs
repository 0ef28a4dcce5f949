//! The surface of the material of a body, for drawing and measuring: what is left of the faces of its mesh, and its wounds.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::resource::put;
use sinew_engine::scalar::Scalar;
use sinew_engine::surface::closest_point;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::Velocity;
use std::collections::{BTreeMap, BTreeSet};

use super::fine::{FineSurface, FineSurfaces, Grip, vertices_at_rest};
use super::hexahedra::tetrahedra;
use super::material::{Element, Material, Order};
use super::{CutError, material_of, places, prepared, row_of};
use crate::body::present::Resection;

/// The surface of the material of a body in its present shape.
///
/// Every point is a mean of *nodes*: the vertices of the mesh, and behind them those that cuts made, in the order in which they
/// came. Whatever is known at nodes is known at the points by the same weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialSkin {
    /// Places (m): first of all vertices of the mesh, then of all points of a [surface](super::carry_surface) that the body
    /// carries, then of points that cuts made. Both sides of a wound have points of their
    /// own, and so has a wound beside the surface round it. Triangles round a point are one smooth surface but for two things:
    /// edges of the body, and the end of a cut, where both sides meet in the same points.
    pub points: Vec<DVec3>,
    /// Places (m) at rest: coordinates of what is drawn inside of the body.
    pub rest: Vec<DVec3>,
    /// Depth (m, at rest) of the points of wounds below the surface of the mesh; 0 at all others.
    pub depth: Vec<f64>,
    /// Triangles of points, outward.
    pub triangles: Vec<[u32; 3]>,
    /// Whether each was laid open by a cut.
    pub wound: Vec<bool>,
    /// Number of the solid element or copy behind each, of a membrane alone of the triangle that it is of.
    pub elements: Vec<u32>,
    /// Tetrahedra of points that fill what is left of elements that cuts parted, with the number of each or of its copy. Their edges are
    /// straight.
    pub cells: Vec<([u32; 4], u32)>,
    /// Nodes of every point.
    pub nodes: Vec<[u32; 4]>,
    /// Their weights, which add up to 1 with those of `further`; those of no weight come last, but for points of a surface, which also have
    /// some below 0 where they lie outside of the mesh.
    pub weights: Vec<[f64; 4]>,
    /// The fifth and further nodes of every point with their weights, where elements are ten-node tetrahedra or hexahedra; none elsewhere.
    pub further: Vec<([u32; 6], [f64; 6])>,
    /// Where a surface is carried, by points: points of that surface between which each lies at rest, and their shares; shares of 0 for all that is
    /// not on it. What an artist gave its points, such as texture coordinates, is known by them at those that cuts made.
    pub carried: Vec<([u32; 3], [f64; 3])>,
    /// The body, the count of its changes, and that of the surfaces given, that it is of.
    of: Option<(usize, u64, u64)>,
    /// Points have further nodes.
    is_curved: bool,
}

/// Nodes that move a point, and their weights.
pub(super) type Moved = ([u32; 10], [f64; 10]);

impl MaterialSkin {
    /// Numbers at the points from numbers at the nodes.
    pub fn mean<T>(&self, at: impl Fn(u32) -> T) -> impl Iterator<Item = T>
    where
        T: std::ops::Mul<f64, Output = T> + std::iter::Sum,
    {
        self.nodes.iter().zip(&self.weights).enumerate().map(move |(point, (nodes, weights))| {
            let further = self.further.get(point).into_iter();
            let further = further.flat_map(|(nodes, weights)| nodes.iter().zip(weights));
            let used = nodes.iter().zip(weights).chain(further).filter(|(_, w)| **w != 0.0);
            used.map(|(&node, &w)| at(node) * w).sum()
        })
    }

    pub(super) fn add(&mut self, (nodes, weights): Moved) -> u32 {
        self.nodes.push([0, 1, 2, 3].map(|i| nodes[i]));
        self.weights.push([0, 1, 2, 3].map(|i| weights[i]));
        if self.is_curved {
            let more = [4, 5, 6, 7, 8, 9];
            self.further.push((more.map(|i| nodes[i]), more.map(|i| weights[i])));
        }
        self.nodes.len() as u32 - 1
    }

    /// Adds a point that a node moves alone.
    pub(super) fn add_node(&mut self, node: u32) -> u32 {
        let mut weights = [0.0; 10];
        weights[0] = 1.0;
        self.add(([node; 10], weights))
    }
}

/// Whether a body was cut: its material is no longer that of its elements, and is drawn.
pub fn is_cut(world: &World, body: usize) -> bool {
    cut_material(world, body).is_some()
}

/// The material of a body that was cut, with that of elements that were removed since.
pub fn cut_material(world: &World, body: usize) -> Option<&Material> {
    world.get_resource::<Resection>()?.bodies.get(body)?.as_ref()?.material.as_deref()
}

/// Places (m) of the nodes of a body: the vertices of its mesh, then those that cuts made.
pub fn node_places<S: Scalar>(world: &mut World, body: usize) -> Vec<DVec3> {
    places::<S>(world, body)
}

/// Velocities (m/s) of the nodes of a body.
pub fn node_velocities<S: Scalar>(world: &mut World, body: usize) -> Vec<DVec3> {
    let mut query = world.query::<&Velocity<S>>();
    let rows = &world.resource::<Topology>().bodies[body];
    let Some(v) = single_table(query.contiguous_iter(world)) else { return Vec::new() };
    let nodes = 0..(rows.mesh_vertices() + rows.copies.ghosts.len()) as u32;
    nodes.map(|node| v[(rows.vertices.start + row_of(rows, node)) as usize].get()).collect()
}

/// Makes a skin that of a body in its present shape. While nothing was cut or removed since it was, only its points move, and
/// `false` is returned.
///
/// # Errors
/// When there is no such body, or it is one that cannot be cut.
pub fn update_skin<S: Scalar>(
    world: &mut World,
    body: usize,
    skin: &mut MaterialSkin,
) -> Result<bool, CutError> {
    let surface = FineSurfaces::of(world, body);
    let given = surface.as_ref().map_or(0, |(_, given)| *given);
    let of = world.resource::<Topology>().bodies.get(body).map(|rows| (body, rows.changes, given));
    let is_new = of.is_none() || skin.of != of;
    if is_new {
        build(world, body, skin, surface.as_ref().map(|(surface, _)| &**surface))?;
        skin.of = of;
    }
    let at = places::<S>(world, body);
    skin.points = skin.mean(|node| at[node as usize]).collect();
    Ok(is_new)
}

fn build(
    world: &mut World,
    body: usize,
    skin: &mut MaterialSkin,
    surface: Option<&FineSurface>,
) -> Result<(), CutError> {
    let resection = prepared(world, body)?;
    let own = resection.bodies[body].as_ref().expect("it was prepared");
    let material = material_of(world, body, own);
    put(world, resection);
    let rest = vertices_at_rest(world, body, material.vertices);
    *skin = MaterialSkin { is_curved: !material.order.is_linear(), ..MaterialSkin::default() };
    for vertex in 0..material.vertices {
        skin.add_node(vertex);
    }
    skin.rest.clone_from(&rest);
    let grip = surface.map(|surface| (surface, Grip::new(&material, &rest)));
    let holds = grip.as_ref().map(|(surface, grip)| surface.hang(grip, skin));
    skin.rest.extend(surface.iter().flat_map(|surface| surface.points()));
    let mut known = BTreeMap::new();
    let mut of_wounds = Vec::new();
    let mut place = |skin: &mut MaterialSkin, element: u32, wound: bool, point: u32| {
        let moved = moved_by(&material, &material.elements[element as usize], point);
        if moved.0 == [point; 10] {
            return point;
        }
        *known.entry((point, wound, moved.0)).or_insert_with(|| {
            let at = at_rest(&material, element, point, &rest);
            skin.rest.push(at);
            let own = skin.add(moved);
            of_wounds.extend(wound.then_some(own));
            own
        })
    };
    let outside = surface.map(|_| outer_faces(&material).collect::<BTreeSet<[u32; 3]>>());
    for (face, cell, wound) in material.skin() {
        let element = material.cells[cell as usize].element;
        if !wound && outside.as_ref().is_some_and(|outside| lies_on(&material, face, outside)) {
            continue;
        }
        for face in material.with_middles(face, element) {
            let triangle = face.map(|point| place(skin, element, wound, point));
            skin.triangles.push(triangle);
            skin.wound.push(wound);
            skin.elements.push(element);
        }
    }
    let solid = material.cells.iter().filter(|_| material.order != Order::Triangles);
    for cell in solid {
        if material.is_parted(cell.element) {
            let corners = cell.corners.map(|point| place(skin, cell.element, true, point));
            skin.cells.push((corners, cell.element));
        }
    }
    skin.depth = vec![0.0; skin.rest.len()];
    if skin.wound.contains(&true) {
        let surface = Surface::new(&material, &rest);
        for point in of_wounds {
            skin.depth[point as usize] = surface.distance(skin.rest[point as usize]);
        }
    }
    if let (Some((surface, grip)), Some(holds)) = (&grip, &holds) {
        surface.weave(grip, (holds, material.vertices), skin);
    }
    Ok(())
}

/// Place (m) at rest of a point as one of an element. Of linear elements it is the same of all that have the point, to the last bit.
fn at_rest(material: &Material, element: u32, point: u32, rest: &[DVec3]) -> DVec3 {
    let point = &material.points[point as usize];
    if material.order.is_linear() {
        let used = point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
        return used.map(|(&v, w)| w * rest[v as usize]).sum();
    }
    let element = &material.elements[element as usize];
    let weights = material.weights(element, point);
    let used = (0..material.order.size()).zip(weights).filter(|(_, w)| *w != 0.0);
    used.map(|(i, w)| w * rest[element.vertex(i) as usize]).sum()
}

/// The nodes that move a point as one of an element, in an order in which all elements have them, with their weights.
fn moved_by(material: &Material, element: &Element, point: u32) -> Moved {
    let point = &material.points[point as usize];
    let mut used: Vec<(u32, u32, f64)> = Vec::new();
    if material.order.is_linear() {
        let node =
            |v: u32| element.nodes[element.vertices.iter().position(|&w| w == v).unwrap_or(0)];
        let own = point.vertices.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
        used.extend(own.map(|(&v, w)| (v, node(v), w)));
    } else {
        let weights = material.weights(element, point);
        let own = (0..material.order.size()).zip(weights).filter(|(_, w)| *w != 0.0);
        used.extend(own.map(|(i, w)| (element.vertex(i), element.node(i), w)));
        used.sort_unstable_by_key(|(vertex, ..)| *vertex);
    }
    let mut moved = ([used.first().map_or(0, |own| own.1); 10], [0.0; 10]);
    for (i, (_, node, w)) in used.into_iter().enumerate() {
        (moved.0[i], moved.1[i]) = (node, w);
    }
    moved
}

/// The surface of the whole mesh at rest: corners (m) of its triangles, each with a ball round it.
struct Surface(Vec<([DVec3; 3], DVec3, f64)>);

impl Surface {
    fn new(material: &Material, rest: &[DVec3]) -> Self {
        let triangles = outer_faces(material).map(|face| {
            let corners = face.map(|v| rest[v as usize]);
            let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
            let radius = corners.iter().map(|x| x.distance(centre)).fold(0.0, f64::max);
            (corners, centre, radius)
        });
        Self(triangles.collect())
    }

    /// Distance (m) of a place.
    fn distance(&self, from: DVec3) -> f64 {
        let mut least = f64::INFINITY;
        for (corners, centre, radius) in &self.0 {
            if from.distance(*centre) - radius < least {
                let shares = closest_point(from, *corners);
                let closest: DVec3 = corners.iter().zip(shares).map(|(x, share)| *x * share).sum();
                least = least.min(from.distance(closest));
            }
        }
        least
    }
}

/// Faces of the whole mesh that only one element has, by their vertices, ascending.
fn outer_faces(material: &Material) -> impl Iterator<Item = [u32; 3]> {
    let whole = elements(material).flat_map(|element| match material.order {
        Order::Hexahedra => tetrahedra(&element.all_vertices()).to_vec(),
        _ => vec![element.vertices],
    });
    let mut faces: Vec<[u32; 3]> = whole
        .flat_map(|[a, b, c, d]| [[b, c, d], [a, d, c], [a, b, d], [a, c, b]])
        .map(|mut face| {
            face.sort_unstable();
            face
        })
        .collect();
    faces.sort_unstable();
    let once = faces.chunk_by(|a, b| a == b).filter(|same| same.len() == 1);
    once.map(|same| same[0]).collect::<Vec<_>>().into_iter()
}

/// Whether a face of the material lies on one of these.
fn lies_on(material: &Material, face: [u32; 3], faces: &BTreeSet<[u32; 3]>) -> bool {
    let points = face.map(|p| &material.points[p as usize]);
    let used = points.iter().flat_map(|own| own.vertices.iter().zip(own.weights));
    let mut vertices: Vec<u32> = used.filter(|(_, w)| *w != 0.0).map(|(v, _)| *v).collect();
    vertices.sort_unstable();
    vertices.dedup();
    <[u32; 3]>::try_from(vertices).is_ok_and(|own| faces.contains(&own))
}

/// The elements of the mesh.
pub(super) fn elements(material: &Material) -> impl Iterator<Item = &Element> {
    let own = (0..).zip(&material.elements).filter(|(e, element)| element.source == *e);
    own.map(|(_, element): (u32, &Element)| element)
}
