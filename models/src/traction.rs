//! Tractions that keep their direction (dead loads): what the vertices of a face get of them, `t int N_a dA` at rest, with the
//! shape functions `N_a` of the face. These are a third each on a triangle, the bilinear ones on a quadrilateral, and those of
//! second degree on the face of a ten-node tetrahedron, where corners get nothing and middles a third each if it is flat. So a
//! uniform stress is in equilibrium with its tractions, whatever the mesh.

use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::isoparametric::{gauss_point, quad_derivatives, quad_shape};
use sinew_engine::load::LoadedFace;
use sinew_engine::row::VertexRow;
use sinew_engine::vertex::RestPosition;

use crate::element::face::{POINTS, areas};
use crate::laws::pressure::{curved_faces, sorted};

/// Faces of elements, by vertex rows, under the traction `traction` (N/m^2). Triangles that lie in the face of a ten-node
/// tetrahedron, between three of its vertices, stand for what they cover of it: three corners for all of it.
pub fn loaded_faces(
    world: &mut World,
    triangles: &[[VertexRow; 3]],
    quads: &[[VertexRow; 4]],
    traction: DVec3,
) -> Vec<LoadedFace> {
    let rows = |face: &[VertexRow; 3]| face.map(|row| row.0);
    let curved = curved_faces(world, triangles.iter().map(rows));
    let mut rests = world.query::<&RestPosition>();
    let rest = single_table(rests.contiguous_iter(world)).unwrap_or(&[]);
    let at = |row: VertexRow| rest[row.index()].0;
    let triangle = |face: &[VertexRow; 3]| {
        let forces = match curved.get(&sorted(rows(face))) {
            Some(cover) => {
                let nodes = cover.nodes.map(VertexRow);
                let arm = |i: usize| (at(nodes[i]) - at(nodes[0])).to_array();
                let areas = areas(&POINTS[usize::from(cover.part)], &[1, 2, 3, 4, 5].map(arm));
                nodes.into_iter().zip(areas).map(|(row, area)| (row, area * traction)).collect()
            }
            None => {
                let [a, b, c] = face.map(at);
                let third = (b - a).cross(c - a).length() / 6.0;
                face.iter().map(|&row| (row, third * traction)).collect()
            }
        };
        LoadedFace { corners: *face, forces }
    };
    let quad = |face: &[VertexRow; 4]| {
        let x = face.map(at);
        let mut areas = [0.0; 4];
        for q in 0..4 {
            let [xi, eta, _] = gauss_point(q);
            let mut tangents = [DVec3::ZERO; 2];
            for (x, by) in x.iter().zip(quad_derivatives([xi, eta])) {
                tangents[0] += by[0] * *x;
                tangents[1] += by[1] * *x;
            }
            let area = tangents[0].cross(tangents[1]).length();
            areas.iter_mut().zip(quad_shape([xi, eta])).for_each(|(own, n)| *own += area * n);
        }
        let forces = face.iter().zip(areas).map(|(&row, area)| (row, area * traction)).collect();
        LoadedFace { corners: [face[0], face[1], face[2]], forces }
    };
    triangles.iter().map(triangle).chain(quads.iter().map(quad)).collect()
}
