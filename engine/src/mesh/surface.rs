//! Faces that bound the volume cells of a mesh.

use super::Mesh;
use super::cell::{for_equal_cells, hexahedron_faces, quad_triangles, sorted};
use crate::element_kind::{ElementKind, local_triangles};
use glam::DVec3;

/// Faces that bound the volume cells, turned outward.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Surface {
    /// Faces of tetrahedra, in their order; of those of second order in four parts.
    pub triangles: Vec<[u32; 3]>,
    /// Faces of hexahedra, in their order.
    pub quads: Vec<[u32; 4]>,
}

/// The boundary and what is odd about the faces of a mesh; vertices of odd faces are sorted.
#[derive(Debug, Default)]
pub(crate) struct Faces {
    pub boundary: Surface,
    /// Triangular faces of more than two tetrahedra.
    pub crowded_triangles: Vec<[u32; 3]>,
    /// Quadrilateral faces of more than two hexahedra.
    pub crowded_quads: Vec<[u32; 4]>,
    /// Quadrilateral faces of one hexahedron that share three vertices with a face of one tetrahedron.
    pub mixed: Vec<[u32; 4]>,
}

impl Mesh {
    /// Faces that bound the tetrahedra and hexahedra, turned outward.
    ///
    /// A face belongs to the boundary when exactly one cell has it. Where a quadrilateral face of a
    /// hexahedron meets two triangular faces of tetrahedra that cover it, none of them does. Cells
    /// with an index out of range are left out.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_hexahedra;
    ///
    /// let mesh = box_hexahedra(DVec3::ONE, [3, 2, 1])?;
    /// assert_eq!(mesh.surface().quads.len(), 22);
    /// assert_eq!(mesh.surface_triangles().len(), 44);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn surface(&self) -> Surface {
        let n = self.points.len() as u64;
        let inside = |cell: &[u32]| cell.iter().all(|&v| u64::from(v) < n);
        let tets: Vec<usize> = (0..self.tetrahedra.len())
            .filter(|&i| self.cell(ElementKind::Tetrahedron, i).is_some_and(|cell| inside(&cell)))
            .collect();
        let hexes: Vec<[u32; 8]> =
            self.hexahedra.iter().copied().filter(|cell| inside(cell)).collect();
        self.faces(&tets, &hexes).boundary
    }

    /// The surface as triangles, turned outward: those of the tetrahedra, then two for each
    /// quadrilateral of [`Mesh::surface`], cut along the diagonal from its lowest vertex index.
    pub fn surface_triangles(&self) -> Vec<[u32; 3]> {
        let Surface { mut triangles, quads } = self.surface();
        triangles.extend(quads.into_iter().flat_map(quad_triangles));
        triangles
    }

    /// The quadrilaterals of [`Mesh::surface`].
    pub fn surface_quads(&self) -> Vec<[u32; 4]> {
        self.surface().quads
    }

    /// Sorts the faces of some cells of this mesh, tetrahedra by their numbers; indices must be in range.
    pub(crate) fn faces(&self, tets: &[usize], hexes: &[[u32; 8]]) -> Faces {
        let n_points = self.points.len();
        let mut triangles = Vec::with_capacity(tets.len().saturating_mul(4));
        for &i in tets {
            let inverted = self.signed_volume(self.tetrahedra[i]).is_some_and(|v| v < 0.0);
            let Some(cell) = self.cell(ElementKind::Tetrahedron, i) else { continue };
            for face in local_triangles(ElementKind::Tetrahedron, cell.len()) {
                let [a, b, c] = face.map(|corner| cell[corner]);
                triangles.push(if inverted { [a, c, b] } else { [a, b, c] });
            }
        }
        let mut quads = Vec::with_capacity(hexes.len().saturating_mul(6));
        for &hex in hexes {
            let inverted = self.hexahedron_volume(hex).is_some_and(|volume| volume < 0.0);
            for [a, b, c, d] in hexahedron_faces(hex) {
                quads.push(if inverted { [a, d, c, b] } else { [a, b, c, d] });
            }
        }
        let mut faces = Faces::default();
        let single;
        (single, faces.crowded_triangles) = sort_faces(&triangles, n_points);
        faces.boundary.triangles = single;
        let single;
        (single, faces.crowded_quads) = sort_faces(&quads, n_points);
        faces.boundary.quads = single;
        if !tets.is_empty() && !hexes.is_empty() {
            join_mixed(&mut faces, n_points);
        }
        faces
    }
}

/// Volume (m^3) between a surface and the cone from its rim to the rim's middle: of a cavity, how much it
/// holds. Positive where triangles turn outward; 0 without triangles; a closed surface has no rim.
pub fn enclosed_volume(points: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let point = |v: u32| points[v as usize];
    let mut edges: Vec<[u32; 2]> =
        triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.sort_unstable();
    let rim = edges.iter().filter(|[a, b]| edges.binary_search(&[*b, *a]).is_err());
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for [a, b] in rim {
        sum += point(*a) + point(*b);
        count += 2.0;
    }
    let middle =
        if count > 0.0 { sum / count } else { points.first().copied().unwrap_or_default() };
    let cones = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|v| point(v) - middle);
        a.dot(b.cross(c)) / 6.0
    });
    cones.sum()
}

/// Faces that occur once, in the order of the list, and those that occur more than twice.
fn sort_faces<const N: usize>(
    faces: &[[u32; N]],
    n_points: usize,
) -> (Vec<[u32; N]>, Vec<[u32; N]>) {
    let mut single = vec![false; faces.len()];
    let mut crowded = Vec::new();
    for_equal_cells(faces, n_points, |equal| match equal {
        &[(_, only)] => single[only as usize] = true,
        [(face, _), _, _, ..] => crowded.push(*face),
        _ => {}
    });
    let single = faces.iter().zip(single).filter_map(|(&face, single)| single.then_some(face));
    (single.collect(), crowded)
}

/// Finds the boundary quads that share three vertices with boundary triangles, and takes those that
/// two triangles cover, with these triangles, out of the boundary.
fn join_mixed(faces: &mut Faces, n_points: usize) {
    let Surface { triangles, quads } = &mut faces.boundary;
    let n_triangles = triangles.len();
    let mut list = triangles.clone();
    // The triangle at position `k` of a quad lacks its corner `k`.
    for &[a, b, c, d] in quads.iter() {
        list.extend([[b, c, d], [a, c, d], [a, b, d], [a, b, c]]);
    }
    let mut partners = vec![[u32::MAX; 4]; quads.len()];
    for_equal_cells(&list, n_points, |equal| {
        let Some(&(_, triangle)) = equal.first().filter(|(_, i)| (*i as usize) < n_triangles)
        else {
            return;
        };
        for &(_, i) in &equal[1..] {
            if let Some(part) = (i as usize).checked_sub(n_triangles) {
                partners[part / 4][part % 4] = triangle;
            }
        }
    });
    let mut inner_triangle = vec![false; n_triangles];
    let mut inner_quad = vec![false; quads.len()];
    for (i, partner) in partners.iter().enumerate() {
        if partner.iter().any(|&triangle| triangle != u32::MAX) {
            faces.mixed.push(sorted(quads[i]));
        }
        // Opposite corners lack each other: these two triangles cover the quad.
        for pair in [[partner[0], partner[2]], [partner[1], partner[3]]] {
            if pair.iter().all(|&triangle| triangle != u32::MAX) {
                inner_quad[i] = true;
                pair.iter().for_each(|&triangle| inner_triangle[triangle as usize] = true);
            }
        }
    }
    let mut inner = inner_triangle.into_iter();
    triangles.retain(|_| !inner.next().unwrap_or(false));
    let mut inner = inner_quad.into_iter();
    quads.retain(|_| !inner.next().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cell::mirrored_hexahedron;
    use crate::mesh::generate::{box_hexahedra, box_tets, cup_hexahedra};
    use crate::mesh::tests::unit_tet;

    /// Has the right sign only if all faces turn outward.
    fn surface_volume(mesh: &Mesh) -> f64 {
        enclosed_volume(&mesh.points, &mesh.surface_triangles())
    }

    #[test]
    fn surface_turns_outward_for_either_winding() {
        let mut mesh = unit_tet();
        assert!((surface_volume(&mesh) - 1.0 / 6.0).abs() < 1e-15);
        mesh.tetrahedra[0] = [0, 1, 3, 2];
        assert!((surface_volume(&mesh) - 1.0 / 6.0).abs() < 1e-15);
        mesh.tetrahedra.push([0, 1, 2, 99]);
        assert_eq!(mesh.surface_triangles().len(), 4);

        let mut mesh = box_hexahedra(DVec3::new(2.0, 1.0, 1.0), [2, 1, 3]).unwrap();
        assert!((surface_volume(&mesh) - 2.0).abs() < 1e-14);
        assert_eq!(mesh.surface_quads().len(), 2 * (2 + 6 + 3));
        for i in [0, 3] {
            mesh.hexahedra[i] = mirrored_hexahedron(mesh.hexahedra[i]);
        }
        assert!((surface_volume(&mesh) - 2.0).abs() < 1e-14);
        mesh.hexahedra.push([0, 1, 2, 3, 4, 5, 6, 99]);
        assert_eq!(mesh.surface_triangles().len(), 44);
    }

    #[test]
    fn shared_faces_are_inside() {
        let mut mesh = unit_tet();
        mesh.points.push(DVec3::ONE);
        mesh.tetrahedra.push([1, 2, 3, 4]);
        assert_eq!(mesh.surface_triangles().len(), 6);
        assert!((surface_volume(&mesh) - mesh.total_volume()).abs() < 1e-15);
    }

    #[test]
    fn a_quad_covered_by_two_triangles_is_inside() {
        let mut mesh = box_hexahedra(DVec3::ONE, [1, 1, 1]).unwrap();
        let [_, top, ..] = hexahedron_faces(mesh.hexahedra[0]);
        mesh.points.push(DVec3::new(0.5, 0.5, 2.0));
        let [a, b, c, d] = top;
        mesh.tetrahedra = vec![[a, b, c, 8], [a, c, d, 8]];
        assert!((mesh.total_volume() - 4.0 / 3.0).abs() < 1e-15);
        let surface = mesh.surface();
        assert_eq!((surface.triangles.len(), surface.quads.len()), (4, 5));
        assert!((surface_volume(&mesh) - mesh.total_volume()).abs() < 1e-15);
        // one tetrahedron alone leaves a gap, and all faces are kept
        mesh.tetrahedra.pop();
        let surface = mesh.surface();
        assert_eq!((surface.triangles.len(), surface.quads.len()), (4, 6));
        let faces = mesh.faces(&[0], &mesh.hexahedra);
        assert_eq!(faces.mixed, [sorted(top)]);
    }

    #[test]
    fn volumes_of_a_box_and_of_a_cup() {
        let size = DVec3::new(0.3, 0.2, 0.1);
        let mesh = box_tets(size, [2, 3, 2]).unwrap();
        let moved: Vec<DVec3> = mesh.points.iter().map(|p| *p + DVec3::splat(5.0)).collect();
        let all = enclosed_volume(&moved, &mesh.surface_triangles());
        assert!((all / 0.006 - 1.0).abs() < 1e-12, "{all}");
        // without its top, which is flat, the same
        let top = mesh.group("z1").unwrap();
        let open: Vec<[u32; 3]> = (0..mesh.triangles.len())
            .filter(|i| !top.cells.triangles.contains(&(*i as u32)))
            .map(|i| mesh.triangles[i])
            .collect();
        let open = enclosed_volume(&moved, &open);
        assert!((open.abs() / 0.006 - 1.0).abs() < 1e-12, "{open}");

        let cup = cup_hexahedra([0.02, 0.04], 0.01, 8, 12, 1).unwrap().split_into_simplices();
        let inner: Vec<[u32; 3]> = cup
            .group("inner")
            .unwrap()
            .cells
            .triangles
            .iter()
            .map(|&t| cup.triangles[t as usize])
            .collect();
        let exact = 2.0 / 3.0 * std::f64::consts::PI * 0.02 * 0.02 * 0.04;
        let cavity = enclosed_volume(&cup.points, &inner).abs();
        assert!((cavity / exact - 1.0).abs() < 0.02, "{cavity} beside {exact}");
        assert_eq!(enclosed_volume(&[], &[]), 0.0);
    }
}
