//! Vertices, edges, faces and volumes of single cells, and cells that share all their vertices.

use crate::element_kind::ElementKind;
use crate::isoparametric::{HEXAHEDRON_FACES, MIDDLES};
use glam::DVec3;
use std::ops::{Deref, DerefMut};

/// Vertices of a cell of any kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellVertices {
    list: [u32; 10],
    count: usize,
}

impl CellVertices {
    /// The first ten of some vertices.
    pub(crate) fn of(vertices: &[u32]) -> Self {
        let mut list = [0; 10];
        let count = vertices.len().min(10);
        list[..count].copy_from_slice(&vertices[..count]);
        Self { list, count }
    }
}

impl Deref for CellVertices {
    type Target = [u32];
    fn deref(&self) -> &[u32] {
        &self.list[..self.count]
    }
}

impl DerefMut for CellVertices {
    fn deref_mut(&mut self) -> &mut [u32] {
        &mut self.list[..self.count]
    }
}

/// Edges of a hexahedron along the three axes of its cube, four for each; the first end of each lies
/// at the smaller coordinate. Edge `[0]` to `[3]` of an axis have the other two coordinates (in the
/// order x, y, z) at 00, 10, 01 and 11.
pub(crate) const HEXAHEDRON_EDGES: [[[usize; 2]; 4]; 3] = [
    [[0, 1], [3, 2], [4, 5], [7, 6]],
    [[0, 3], [1, 2], [4, 7], [5, 6]],
    [[0, 4], [1, 5], [3, 7], [2, 6]],
];

/// Corners of the cube that a hexahedron is mapped from.
pub(crate) const CUBE: [[usize; 3]; 8] =
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];

/// Faces of a hexahedron, outward when its signed volume is positive.
pub(crate) fn hexahedron_faces(hexahedron: [u32; 8]) -> [[u32; 4]; 6] {
    HEXAHEDRON_FACES.map(|face| face.map(|corner| hexahedron[corner]))
}

/// Calls `visit` with both ends of every edge of a cell, of both halves of an edge that has a vertex in its middle;
/// edges of faces in their direction.
pub(crate) fn edges(kind: ElementKind, cell: &[u32], mut visit: impl FnMut(u32, u32)) {
    match kind {
        ElementKind::Tetrahedron => {
            for (k, [i, j]) in MIDDLES.into_iter().enumerate() {
                match cell.get(4 + k) {
                    None => visit(cell[i], cell[j]),
                    Some(&middle) => {
                        visit(cell[i], middle);
                        visit(middle, cell[j]);
                    }
                }
            }
        }
        ElementKind::Hexahedron => {
            let edges = HEXAHEDRON_EDGES.as_flattened();
            edges.iter().for_each(|&[i, j]| visit(cell[i], cell[j]));
        }
        ElementKind::Triangle | ElementKind::Quad => {
            for (k, &vertex) in cell.iter().enumerate() {
                visit(vertex, cell[(k + 1) % cell.len()]);
            }
        }
    }
}

/// Vertices of a tetrahedron of second order.
pub(crate) fn ten([a, b, c, d]: [u32; 4], [e, f, g, h, i, j]: [u32; 6]) -> [u32; 10] {
    [a, b, c, d, e, f, g, h, i, j]
}

/// A triangle of second order in four parts: vertices are its corners, then those on the edges 01, 12 and 20.
pub(crate) fn second_order_triangles([a, b, c, ab, bc, ca]: [u32; 6]) -> [[u32; 3]; 4] {
    [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
}

/// Vertices on the edges of a tetrahedron whose last two corners change places.
pub(crate) fn mirrored_middles([ab, bc, ac, ad, bd, cd]: [u32; 6]) -> [u32; 6] {
    [ab, bd, ad, ac, bc, cd]
}

/// A hexahedron and its mirror image have the same faces; bottom and top change places.
pub(crate) fn mirrored_hexahedron([a, b, c, d, e, f, g, h]: [u32; 8]) -> [u32; 8] {
    [e, f, g, h, a, b, c, d]
}

/// A quadrilateral as two triangles that turn as it does, cut along the diagonal from its lowest
/// index, so that two cells with this face cut it alike.
pub(crate) fn quad_triangles(quad: [u32; 4]) -> [[u32; 3]; 2] {
    let first = (0..4).min_by_key(|&i| quad[i]).unwrap_or(0);
    let [a, b, c, d] = std::array::from_fn(|i| quad[(first + i) % 4]);
    [[a, b, c], [a, c, d]]
}

/// Derivatives of the trilinear map along the three axes of the unit cube, at `place` in it (m).
pub(crate) fn hexahedron_jacobian(corners: &[DVec3; 8], place: [f64; 3]) -> [DVec3; 3] {
    std::array::from_fn(|axis| {
        let others = match axis {
            0 => [place[1], place[2]],
            1 => [place[0], place[2]],
            _ => [place[0], place[1]],
        };
        let [u, v] = others;
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        HEXAHEDRON_EDGES[axis]
            .iter()
            .zip(weights)
            .map(|([from, to], weight)| (corners[*to] - corners[*from]) * weight)
            .sum()
    })
}

/// The three edges at a corner, along the axes of the cube: the Jacobian matrix there (m).
pub(crate) fn corner_jacobian(corners: &[DVec3; 8], corner: usize) -> [DVec3; 3] {
    hexahedron_jacobian(corners, CUBE[corner].map(|x| x as f64))
}

/// Determinant of three columns.
pub(crate) fn determinant([a, b, c]: [DVec3; 3]) -> f64 {
    a.dot(b.cross(c))
}

/// Jacobian determinants of a hexahedron at the 2 x 2 x 2 Gauss points (m^3); their mean is its volume.
pub(crate) fn gauss_determinants(corners: &[DVec3; 8]) -> [f64; 8] {
    let offset = 0.5 / 3f64.sqrt();
    let place =
        |corner: usize| CUBE[corner].map(|x| if x == 0 { 0.5 - offset } else { 0.5 + offset });
    std::array::from_fn(|corner| determinant(hexahedron_jacobian(corners, place(corner))))
}

/// Signed volume of a trilinear hexahedron (m^3). The determinant is of second degree in each
/// coordinate, which two Gauss points along each axis integrate exactly.
pub(crate) fn hexahedron_volume(corners: &[DVec3; 8]) -> f64 {
    gauss_determinants(corners).iter().sum::<f64>() / 8.0
}

/// The vertex indices of a cell in ascending order.
pub(crate) fn sorted<const N: usize>(mut cell: [u32; N]) -> [u32; N] {
    cell.sort_unstable();
    cell
}

/// Calls `visit` once for every set of cells with the same vertices: their sorted vertices and their
/// positions in the list, ascending. All indices must be below `n_points`.
///
/// Cells are dealt into one bucket per smallest vertex, so that the sorts stay short and the whole
/// takes linear time on a mesh.
pub(crate) fn for_equal_cells<const N: usize>(
    cells: &[[u32; N]],
    n_points: usize,
    mut visit: impl FnMut(&[([u32; N], u32)]),
) {
    let mut start = vec![0u32; n_points + 1];
    let smallest = |cell: &[u32; N]| cell.iter().copied().min().unwrap_or(0) as usize;
    for cell in cells {
        start[smallest(cell) + 1] += 1;
    }
    for i in 0..n_points {
        start[i + 1] += start[i];
    }
    let mut dealt = vec![([0u32; N], 0u32); cells.len()];
    let mut next = start.clone();
    for (index, cell) in cells.iter().enumerate() {
        let slot = &mut next[smallest(cell)];
        dealt[*slot as usize] = (sorted(*cell), index as u32);
        *slot += 1;
    }
    for i in 0..n_points {
        let bucket = &mut dealt[start[i] as usize..start[i + 1] as usize];
        bucket.sort_unstable();
        for equal in bucket.chunk_by(|a, b| a.0 == b.0) {
            visit(equal);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> [DVec3; 8] {
        CUBE.map(|corner| DVec3::from_array(corner.map(|x| x as f64)))
    }

    #[test]
    fn jacobian_at_a_corner_is_made_of_its_edges() {
        for corner in 0..8 {
            for (axis, edge) in corner_jacobian(&cube(), corner).into_iter().enumerate() {
                assert_eq!(edge, DVec3::AXES[axis]);
            }
            let mut moved = cube();
            moved[corner] += DVec3::new(0.25, 0.5, 0.125);
            let sign = CUBE[corner].map(|x| if x == 1 { 1.0 } else { -1.0 });
            for (axis, edge) in corner_jacobian(&moved, corner).into_iter().enumerate() {
                let change = DVec3::new(0.25, 0.5, 0.125) * sign[axis];
                assert_eq!(edge, DVec3::AXES[axis] + change);
            }
        }
    }

    /// Volume from the divergence theorem over the bilinear faces, each integrated exactly: the
    /// vector area seen from the origin is a polynomial of second degree.
    fn volume_of_faces(corners: &[DVec3; 8]) -> f64 {
        let offset = 0.5 / 3f64.sqrt();
        let mut volume = 0.0;
        for [a, b, c, d] in HEXAHEDRON_FACES.map(|face| face.map(|corner| corners[corner])) {
            for u in [0.5 - offset, 0.5 + offset] {
                for v in [0.5 - offset, 0.5 + offset] {
                    let place = a * (1.0 - u) * (1.0 - v)
                        + b * u * (1.0 - v)
                        + c * u * v
                        + d * (1.0 - u) * v;
                    let along_u = (b - a) * (1.0 - v) + (c - d) * v;
                    let along_v = (d - a) * (1.0 - u) + (c - b) * u;
                    volume += place.dot(along_u.cross(along_v)) / 12.0;
                }
            }
        }
        volume
    }

    #[test]
    fn volume_of_warped_hexahedra() {
        assert!((hexahedron_volume(&cube()) - 1.0).abs() < 1e-15);
        let mut corners = cube();
        // any numbers that warp all faces
        for (i, corner) in corners.iter_mut().enumerate() {
            let t = i as f64;
            *corner += 0.2 * DVec3::new((3.0 * t).sin(), (5.0 * t).cos(), (7.0 * t).sin());
        }
        let volume = hexahedron_volume(&corners);
        assert!((volume - volume_of_faces(&corners)).abs() < 1e-14, "{volume}");
        assert!((volume - 1.0).abs() > 1e-3);
        let indices = mirrored_hexahedron([0, 1, 2, 3, 4, 5, 6, 7]);
        let mirrored = indices.map(|i| corners[i as usize]);
        assert!((hexahedron_volume(&mirrored) + volume).abs() < 1e-14);
    }

    #[test]
    fn quads_are_cut_from_their_lowest_vertex() {
        assert_eq!(quad_triangles([7, 3, 9, 5]), [[3, 9, 5], [3, 5, 7]]);
        // the neighbour sees it from the other side
        assert_eq!(quad_triangles([5, 9, 3, 7]), [[3, 7, 5], [3, 5, 9]]);
    }
}
