//! Points of the material of a body of solid elements: which vertices move them, and what is at a place.
//!
//! Four vertices hold a point, by weights that add up to 1, so that forces on it go to these alone: it is moved linearly in a
//! tetrahedron, which is the element or a part of it. So in hexahedra and ten-node tetrahedra it is where shape functions have it
//! at all vertices, and as long as the element is deformed uniformly; beyond, as near as flat pieces are.

use bevy_ecs::prelude::*;
use glam::{DMat4, DVec3};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::isoparametric::HEXAHEDRON_FACES;
use sinew_engine::row::{LocalRow, MeshVertex, VertexRow};
use sinew_engine::scalar::Scalar;
use sinew_engine::surface::TissuePoint;
use sinew_engine::topology::Topology;

use super::material::{EDGES, Material, Point};
use super::{hexahedra, places, rest_of, row_of};
use crate::body::present::Resection;

/// Least barycentric coordinate with which a place counts as in an element: faces belong to both sides, whatever rounding says.
const INSIDE: f64 = -1e-9;

/// Sides of a hexahedron by its places, each twice: those of its faces.
const SIDES: [[usize; 2]; 24] = {
    let mut all = [[0; 2]; 24];
    let mut i = 0;
    while i < 24 {
        let face = HEXAHEDRON_FACES[i / 4];
        all[i] = [face[i % 4], face[(i + 1) % 4]];
        i += 1;
    }
    all
};

/// A point of the material: the element of the mesh that it lies in, four vertices of that, and their weights.
pub type MaterialPoint = (u32, [MeshVertex; 4], [f64; 4]);

/// Kinds of elements in which points lie.
fn solids() -> impl Iterator<Item = ElementKind> {
    ElementKind::ALL.into_iter().filter(|kind| kind.is_solid())
}

/// Tetrahedra in which an element of these vertices of the mesh holds points, by its places. Which diagonals divide it is decided by the
/// numbers of vertices, so that neighbours agree, and copies: those of the faces of a hexahedron, where six tetrahedra are those
/// of its material, and of ten-node tetrahedra the one between four corners and four quarters of the octahedron in the middle.
fn parts(vertices: &[u32]) -> Vec<[usize; 4]> {
    if let Ok(own) = <&[u32; 8]>::try_from(vertices) {
        let place = |v: u32| own.iter().position(|&other| other == v).unwrap_or(0);
        return hexahedra::tetrahedra(own).map(|part| part.map(place)).to_vec();
    }
    if vertices.len() != 10 {
        return vec![[0, 1, 2, 3]];
    }
    let mut all = vec![[0, 4, 6, 7], [1, 4, 5, 8], [2, 5, 6, 9], [3, 7, 8, 9]];
    // middles of edges that do not touch
    let mut pairs = [[4, 9], [5, 7], [6, 8]];
    pairs.sort_by_key(|&[a, b]| vertices[a].min(vertices[b]));
    let [[a, b], c, d] = pairs;
    all.extend(c.iter().flat_map(|&c| d.map(|d| [a, b, c, d])));
    all
}

/// The element that has a point of the material of a whole element, by its number.
fn holder(material: &Material, source: u32, vertices: [u32; 4], weights: [f64; 4]) -> Option<u32> {
    let element = material.elements.get(source as usize)?;
    if !material.is_parted(source) {
        return Some(source);
    }
    let place = material.point_of(element, Point { vertices, weights });
    let mut best: Option<(f64, u32)> = None;
    for cell in &material.cells {
        if material.elements[cell.element as usize].source != source {
            continue;
        }
        let least = material.inside(&place, cell);
        // the first of equals; cells without volume have no coordinates
        if least.is_finite() && best.is_none_or(|(most, _)| least > most) {
            best = Some((least, cell.element));
        }
    }
    best.map(|(_, element)| element)
}

/// Row of the table of an element that is left.
fn row_of_element(world: &World, body: usize, kind: ElementKind, element: u32) -> Option<u32> {
    let rows = &world.resource::<Topology>().bodies[body];
    let own = world.get_resource::<Resection>().and_then(|own| own.bodies.get(body)?.as_ref());
    match own {
        Some(own) => {
            let row = *own.element_of[kind].get(element as usize)?;
            own.connectivity.is_present(kind, row).then_some(row)
        }
        None => rows.order[kind].iter().position(|&own| own == element).map(|row| row as u32),
    }
}

/// See [`PointReader`](sinew_engine::surface::PointReader).
pub(crate) fn read_point(
    world: &World,
    body: usize,
    element: u32,
    (vertices, weights): ([MeshVertex; 4], [f64; 4]),
) -> Option<TissuePoint> {
    let rows = world.resource::<Topology>().bodies.get(body)?;
    let own = world.get_resource::<Resection>().and_then(|own| own.bodies.get(body)?.as_ref());
    let element = match own.and_then(|own| own.material.as_deref()) {
        Some(material) => holder(material, element, vertices.map(|v| v.0), weights)?,
        None => element,
    };
    // where elements of two kinds have the same number, that which has the vertices
    solids().find_map(|kind| {
        let nodes = rows.nodes[kind].of(row_of_element(world, body, kind, element)?);
        let held = |&node: &u32| {
            let vertex = rows.vertex_of(LocalRow(node));
            let at = vertices.iter().position(|&own| own == vertex)?;
            Some((rows.in_table(LocalRow(node)), weights[at]))
        };
        let mut own = nodes.iter().filter_map(held);
        let [a, b, c, d] = [own.next()?, own.next()?, own.next()?, own.next()?];
        Some(([a.0, b.0, c.0, d.0], [a.1, b.1, c.1, d.1]))
    })
}

/// The point of the material of a body that is at a place (m) in its present shape; none where there is none, or the body has
/// no solid elements.
pub fn material_point<S: Scalar>(
    world: &mut World,
    body: usize,
    at: DVec3,
) -> Option<MaterialPoint> {
    tissue::<S>(world, body, [at; 2])?.point(world, at)
}

/// Where the elements of a body hold points in its present shape, those near a place.
#[derive(Clone, Debug)]
pub struct Tissue {
    body: usize,
    /// Places (m) of its rows.
    places: Vec<DVec3>,
    /// Tetrahedra in which points are.
    parts: Vec<Part>,
    /// Mean edge (m) at rest, of the body, from corner to corner: needles have points half of it apart, which is how far apart the vertices of
    /// ten-node tetrahedra are.
    pub edge: f64,
}

/// A tetrahedron in which an element holds points.
#[derive(Clone, Copy, Debug)]
struct Part {
    kind: ElementKind,
    /// Row of the element in its table.
    row: u32,
    element: u32,
    nodes: [LocalRow; 4],
}

/// What of a body may be in a box (m); none of one without solid elements.
pub fn tissue<S: Scalar>(world: &mut World, body: usize, within: [DVec3; 2]) -> Option<Tissue> {
    compiled_here!(S, near(world: &mut World, body: usize, within: [DVec3; 2]) -> Option<Tissue>)
}

fn near<S: Scalar>(world: &mut World, body: usize, within: [DVec3; 2]) -> Option<Tissue> {
    if body >= world.resource::<Topology>().bodies.len() {
        return None;
    }
    let x = places::<S>(world, body);
    let rest = rest_of(world, body);
    let rows = &world.resource::<Topology>().bodies[body];
    let first = rows.mesh_vertices() as u32;
    let mut of_row = vec![DVec3::ZERO; rows.row_count()];
    for node in 0..x.len() as u32 {
        // vertices without elements have no row of their own
        if node >= first || rows.row_of_vertex[MeshVertex(node)].is_some() {
            of_row[row_of(rows, node) as usize] = x[node as usize];
        }
    }
    let (mut near, mut length, mut count) = (Vec::new(), 0.0, 0);
    for (kind, row) in solids().flat_map(|kind| (0..rows.order[kind].len()).map(move |e| (kind, e)))
    {
        let (element, nodes) = (rows.order[kind][row], rows.nodes[kind].of(row as u32));
        let edges: &[[usize; 2]] = if kind == ElementKind::Hexahedron { &SIDES } else { &EDGES };
        let edge = |&ends: &[usize; 2]| {
            let [a, b] = ends.map(|i| rest[nodes[i] as usize]);
            (a - b).length()
        };
        length += edges.iter().map(edge).sum::<f64>() / edges.len() as f64;
        count += 1;
        let at = || nodes.iter().map(|&node| of_row[node as usize]);
        let low = at().fold(DVec3::INFINITY, DVec3::min);
        let high = at().fold(DVec3::NEG_INFINITY, DVec3::max);
        // what is on a face counts as inside
        let margin = 1e-6 * (high - low);
        if (low - margin).cmple(within[1]).all() && within[0].cmple(high + margin).all() {
            let vertices: Vec<u32> = nodes.iter().map(|&v| rows.vertex_of(LocalRow(v)).0).collect();
            let part = |part: [usize; 4]| Part {
                kind,
                row: row as u32,
                element,
                nodes: part.map(|i| LocalRow(nodes[i])),
            };
            near.extend(parts(&vertices).into_iter().map(part));
        }
    }
    let edge = length / f64::from(count);
    edge.is_finite().then_some(Tissue { body, places: of_row, parts: near, edge })
}

impl Tissue {
    /// The point of the material at a place (m) among those near.
    pub fn point(&self, world: &World, at: DVec3) -> Option<MaterialPoint> {
        let rows = &world.resource::<Topology>().bodies[self.body];
        let resection = world.get_resource::<Resection>();
        let own = resection.and_then(|own| own.bodies.get(self.body)?.as_ref());
        let material = own.and_then(|own| own.material.as_deref());
        let mut best: Option<(f64, MaterialPoint)> = None;
        for &Part { kind, row, element, nodes } in &self.parts {
            let [a, b, c, d] = nodes.map(|node| self.places[node.0 as usize].extend(1.0));
            let weights = DMat4::from_cols(a, b, c, d).inverse() * at.extend(1.0);
            let least = weights.min_element();
            // an element drawn flat has no coordinates
            let better = best.as_ref().is_none_or(|(most, _)| least > *most);
            if least.is_nan() || least < INSIDE || !better {
                continue;
            }
            let point = (nodes.map(|node| rows.vertex_of(node)), weights.to_array());
            let (source, is_own) = match material {
                Some(material) => {
                    let source = material.elements[element as usize].source;
                    let vertices = point.0.map(|v| v.0);
                    (source, holder(material, source, vertices, point.1) == Some(element))
                }
                None => (element, true),
            };
            if is_own && row_of_element(world, self.body, kind, element) == Some(row) {
                best = Some((least, (source, point.0, point.1)));
            }
        }
        best.map(|(_, point)| point)
    }

    /// Place (m) of a point of the material; none of one that was removed.
    pub fn place(
        &self,
        world: &World,
        (element, vertices, weights): MaterialPoint,
    ) -> Option<DVec3> {
        let (rows, weights) = read_point(world, self.body, element, (vertices, weights))?;
        let first = world.resource::<Topology>().bodies[self.body].vertices.start;
        let place = |row: VertexRow| self.places[(row.0 - first) as usize];
        Some(rows.into_iter().zip(weights).map(|(row, w)| w * place(row)).sum())
    }
}
