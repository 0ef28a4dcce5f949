//! Springs pooled over the mesh: twins of the laws of [`sinew_models::laws::pooled`]. Each set turns its own tensions into
//! forces, so that [`SPRING_FORCES`](sinew_models::laws::pooled::SPRING_FORCES), which does that on the processor for the
//! sum, has no elements here.

use bevy_ecs::prelude::*;
use sinew_engine::element::{
    EdgeChange, EdgeVertices, RestEdges, TetrahedronEdges, TetrahedronVertices, TriangleEdges,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::laws::LawRow;
use sinew_models::laws::pooled::{
    self, AngularStiffnesses, TriangleVertices, VolumetricStiffnesses,
};

use super::mass_spring::edge_columns;
use super::{DeviceLaw, EDGE, ElementColumns, ElementKind};

const SPRING: &str = include_str!("spring.wgsl");
const COUPLED_EDGES: &[&str] = &[include_str!("../coupled_edges.wgsl")];

/// Three vertices; for every edge, opposite the vertex of its number, rest vector (m) and the stiffness (N/m^3) of
/// the spring of that number.
const COUPLED_TRIANGLE: ElementKind =
    ElementKind { vertices: 3, constants: 12, threads: 1, files: COUPLED_EDGES };

/// Four vertices; for every edge at vertex 0 rest vector (m) and the stiffness (N/m^3) of the spring of its number.
const COUPLED_TETRAHEDRON: ElementKind = ElementKind { vertices: 4, ..COUPLED_TRIANGLE };

/// Tensile springs on edges, angular ones in triangles, volumetric ones in tetrahedra. Their projected tangent is
/// that of [`PooledProjection`](sinew_models::laws::svk::PooledProjection).
pub(super) static LAWS: &[DeviceLaw] = &[
    DeviceLaw {
        row: &pooled::TENSILE,
        kind: EDGE,
        volumes: false,
        find: [edge_columns::<f64>, edge_columns::<f32>],
        files: &[SPRING, include_str!("tensile.wgsl")],
    },
    DeviceLaw {
        row: &pooled::ANGULAR,
        kind: COUPLED_TRIANGLE,
        volumes: false,
        find: [angular::<f64>, angular::<f32>],
        files: &[SPRING, include_str!("angular.wgsl")],
    },
    DeviceLaw {
        row: &pooled::VOLUMETRIC,
        kind: COUPLED_TETRAHEDRON,
        volumes: false,
        find: [volumetric::<f64>, volumetric::<f32>],
        files: &[SPRING, include_str!("volumetric.wgsl")],
    },
];

/// Rest vectors of the edge table of pooled elements.
fn rest_edges<S: Scalar>(world: &mut World) -> Vec<[f32; 3]> {
    let mut query =
        world.query_filtered::<RestEdges<S>, (With<EdgeVertices>, With<EdgeChange<S>>)>();
    query.iter(world).map(|(x, y, z)| [x.0, y.0, z.0].map(|x| x.to_f64() as f32)).collect()
}

/// Appends an element to columns of these kinds.
fn push<S: Scalar>(
    columns: &mut ElementColumns,
    nodes: &[u32],
    first_row: u32,
    edges: impl Iterator<Item = ([f32; 3], S)>,
) {
    columns.nodes.extend(nodes.iter().map(|row| row - first_row));
    for ([x, y, z], stiffness) in edges {
        columns.data.extend([x, y, z, stiffness.to_f64() as f32]);
    }
}

/// Triangles of a body with angular springs.
fn angular<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let rest = rest_edges::<S>(world);
    let mut query =
        world.query::<(&TriangleVertices, &TriangleEdges, AngularStiffnesses<S>, &BodyId)>();
    for (nodes, edges, (c0, c1, c2), of) in query.iter(world) {
        if of.0 as usize == body {
            let rest = edges.0.map(|edge| rest[edge as usize]);
            push(&mut columns, &nodes.0, first_row, rest.into_iter().zip([c0.0, c1.0, c2.0]));
        }
    }
    columns
}

/// Tetrahedra of a body with volumetric springs.
fn volumetric<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let rest = rest_edges::<S>(world);
    let mut query =
        world
            .query::<(&TetrahedronVertices, &TetrahedronEdges, VolumetricStiffnesses<S>, &BodyId)>(
            );
    for (nodes, edges, (d0, d1, d2), of) in query.iter(world) {
        if of.0 as usize == body {
            // vertex 0 is the lowest row, so its edges run as stored
            let [e0, e1, e2, ..] = edges.0;
            let rest = [e0, e1, e2].map(|edge| rest[edge as usize]);
            push(&mut columns, &nodes.0, first_row, rest.into_iter().zip([d0.0, d1.0, d2.0]));
        }
    }
    columns
}
