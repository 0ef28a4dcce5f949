//! Springs pooled over the mesh: twins of the laws of [`sinew_models::laws::pooled`]. Each set turns its own tensions into
//! forces, so that [`SPRING_FORCES`](sinew_models::laws::pooled::SPRING_FORCES), which does that on the processor for the
//! sum, has no elements here.

use bevy_ecs::prelude::*;
use sinew_engine::element::{
    EdgeChange, EdgeVertices, RestEdges, TetrahedronEdges, TetrahedronVertices, TriangleEdges,
};
use sinew_engine::scalar::Scalar;
use sinew_models::laws::pooled::{
    self, AngularStiffnesses, TriangleVertices, VolumetricStiffnesses,
};

use super::mass_spring::edge_columns;
use super::{DeviceElement, DeviceLaw, EDGE, ElementColumns, ElementSearch, push, row, three};

const SPRING: &str = include_str!("spring.wgsl");
const COUPLED_EDGES: &[&str] = &[include_str!("../coupled_edges.wgsl")];

/// Three vertices; for every edge, opposite the vertex of its number, rest vector (m) and the stiffness (N/m^3) of
/// the spring of that number.
const COUPLED_TRIANGLE: DeviceElement =
    DeviceElement { vertices: 3, constants: 12, threads: 1, files: COUPLED_EDGES };

/// Four vertices; for every edge at vertex 0 rest vector (m) and the stiffness (N/m^3) of the spring of its number.
const COUPLED_TETRAHEDRON: DeviceElement = DeviceElement { vertices: 4, ..COUPLED_TRIANGLE };

/// Tensile springs on edges, angular ones in triangles, volumetric ones in tetrahedra. Their projected tangent is
/// that of [`PooledProjection`](sinew_models::laws::svk::PooledProjection).
pub(super) static LAWS: &[DeviceLaw] = &[
    DeviceLaw::new(
        &pooled::TENSILE,
        EDGE,
        [edge_columns::<f64>, edge_columns::<f32>],
        &[SPRING, include_str!("tensile.wgsl")],
    ),
    DeviceLaw::new(
        &pooled::ANGULAR,
        COUPLED_TRIANGLE,
        [angular::<f64>, angular::<f32>],
        &[SPRING, include_str!("angular.wgsl")],
    ),
    DeviceLaw::new(
        &pooled::VOLUMETRIC,
        COUPLED_TETRAHEDRON,
        [volumetric::<f64>, volumetric::<f32>],
        &[SPRING, include_str!("volumetric.wgsl")],
    ),
];

/// Constants of three edges: their rest vectors from the edge table of pooled elements, and stiffnesses.
fn push_edges<S: Scalar>(world: &mut World) -> impl Fn(&mut Vec<f32>, [u32; 3], [f64; 3]) + use<S> {
    let mut query =
        world.query_filtered::<RestEdges<S>, (With<EdgeVertices>, With<EdgeChange<S>>)>();
    let rest: Vec<[f64; 3]> = query.iter(world).map(|rest| three!(rest)).collect();
    move |data, edges, stiffnesses| {
        push::<3>(data, std::array::from_fn(|i| row(rest[edges[i] as usize], stiffnesses[i])));
    }
}

/// Triangles of a body with angular springs.
fn angular<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = (&'static TriangleVertices, &'static TriangleEdges, AngularStiffnesses<S>);
    let push_edges = push_edges::<S>(search.world);
    search.columns::<Data<S>, 3>(|(nodes, edges, stiffnesses), data| {
        push_edges(data, edges.0, three!(stiffnesses));
        nodes.0
    })
}

/// Tetrahedra of a body with volumetric springs.
fn volumetric<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> =
        (&'static TetrahedronVertices, &'static TetrahedronEdges, VolumetricStiffnesses<S>);
    let push_edges = push_edges::<S>(search.world);
    search.columns::<Data<S>, 4>(|(nodes, edges, stiffnesses), data| {
        // vertex 0 is the lowest row, so its edges run as stored
        let [e0, e1, e2, ..] = edges.0;
        push_edges(data, [e0, e1, e2], three!(stiffnesses));
        nodes.0
    })
}
