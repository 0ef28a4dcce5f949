//! Points of the material of a body of linear tetrahedra: which vertices move them, and what is at a place.

use bevy_ecs::prelude::*;
use glam::{DMat4, DVec3, DVec4};
use sinew_engine::compiled_here;
use sinew_engine::connectivity::ElementKind;
use sinew_engine::row::{LocalRow, MeshVertex, VertexRow};
use sinew_engine::scalar::Scalar;
use sinew_engine::surface::TissuePoint;
use sinew_engine::topology::{BodyRows, Topology};

use super::material::{Material, Order};
use super::{places, rest_of, row_of};
use crate::body::present::Resection;

/// Least barycentric coordinate with which a place counts as in an element: faces belong to both sides, whatever rounding says.
const INSIDE: f64 = -1e-9;

/// A point of the material: the tetrahedron of the mesh that it lies in, its vertices, and their weights.
pub type MaterialPoint = (u32, [MeshVertex; 4], [f64; 4]);

/// The element that has a point of the material of a whole element, by its number.
fn holder(material: &Material, source: u32, vertices: [u32; 4], weights: [f64; 4]) -> Option<u32> {
    let mut best: Option<(f64, u32)> = None;
    for cell in &material.cells {
        if material.elements[cell.element as usize].source != source {
            continue;
        }
        let corner = |i: usize| {
            let point = &material.points[cell.corners[i] as usize];
            DVec4::from(point.weights_in(vertices))
        };
        let corners = DMat4::from_cols(corner(0), corner(1), corner(2), corner(3));
        let least = (corners.inverse() * DVec4::from(weights)).min_element();
        // the first of equals; cells without volume have no coordinates
        if least.is_finite() && best.is_none_or(|(most, _)| least > most) {
            best = Some((least, cell.element));
        }
    }
    best.map(|(_, element)| element)
}

/// Row of the table of a tetrahedron that is left.
fn row_of_element(world: &World, body: usize, element: u32) -> Option<usize> {
    let rows = &world.resource::<Topology>().bodies[body];
    let own = world.get_resource::<Resection>().and_then(|own| own.bodies.get(body)?.as_ref());
    match own {
        Some(own) => {
            let row = *own.element_of.tetrahedra.get(element as usize)?;
            own.connectivity.is_present(ElementKind::Tetrahedron, row).then_some(row as usize)
        }
        None => rows.order.tetrahedra.iter().position(|&own| own == element),
    }
}

/// Rows of the vertices of a tetrahedron.
fn nodes(rows: &BodyRows, row: usize) -> Option<[LocalRow; 4]> {
    rows.tetrahedra().get(row).map(|nodes| nodes.map(LocalRow))
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
    let material = own.and_then(|own| own.material.as_deref());
    let element = match material {
        Some(material) if material.order != Order::Linear => return None,
        Some(material) => holder(material, element, vertices.map(|v| v.0), weights)?,
        None => element,
    };
    let nodes = nodes(rows, row_of_element(world, body, element)?)?;
    let weight = |node: LocalRow| {
        let at = vertices.iter().position(|&vertex| vertex == rows.vertex_of(node))?;
        Some(weights[at])
    };
    let [a, b, c, d] = nodes.map(weight);
    Some((nodes.map(|node| rows.in_table(node)), [a?, b?, c?, d?]))
}

/// The point of the material of a body that is at a place (m) in its present shape; none where there is none, or the body has
/// no linear tetrahedra.
pub fn material_point<S: Scalar>(
    world: &mut World,
    body: usize,
    at: DVec3,
) -> Option<MaterialPoint> {
    tissue::<S>(world, body, [at; 2])?.point(world, at)
}

/// Linear tetrahedra of a body in its present shape, those near a place.
#[derive(Clone, Debug)]
pub struct Tissue {
    body: usize,
    /// Places (m) of its rows.
    places: Vec<DVec3>,
    /// Rows of the table of tetrahedra, their elements, and the vertices of these.
    cells: Vec<(usize, u32, [LocalRow; 4])>,
    /// Mean edge (m) at rest, of the body.
    pub edge: f64,
}

/// What of a body may be in a box (m); none of one without linear tetrahedra.
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
    let (mut cells, mut length) = (Vec::new(), 0.0);
    for (row, &element) in rows.order.tetrahedra.iter().enumerate() {
        let nodes = nodes(rows, row)?;
        let [a, b, c, d] = nodes.map(|node| rest[node.0 as usize]);
        let edges = [a - b, a - c, a - d, b - c, b - d, c - d].map(DVec3::length);
        length += edges.into_iter().sum::<f64>() / 6.0;
        let [a, b, c, d] = nodes.map(|node| of_row[node.0 as usize]);
        let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        // what is on a face counts as inside
        let margin = 1e-6 * (high - low);
        if (low - margin).cmple(within[1]).all() && within[0].cmple(high + margin).all() {
            cells.push((row, element, nodes));
        }
    }
    let edge = length / rows.order.tetrahedra.len() as f64;
    edge.is_finite().then_some(Tissue { body, places: of_row, cells, edge })
}

impl Tissue {
    /// The point of the material at a place (m) among those near.
    pub fn point(&self, world: &World, at: DVec3) -> Option<MaterialPoint> {
        let rows = &world.resource::<Topology>().bodies[self.body];
        let resection = world.get_resource::<Resection>();
        let own = resection.and_then(|own| own.bodies.get(self.body)?.as_ref());
        let material = own.and_then(|own| own.material.as_deref());
        let mut best: Option<(f64, MaterialPoint)> = None;
        for &(row, element, nodes) in &self.cells {
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
            if is_own && row_of_element(world, self.body, element) == Some(row) {
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
