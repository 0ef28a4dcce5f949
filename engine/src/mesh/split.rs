//! Hexahedra as tetrahedra and quadrilaterals as triangles.

use super::Mesh;
use super::cell::quad_triangles;
use crate::element_kind::ByKind;
use crate::isoparametric::HEXAHEDRON_FACES;

/// A hexahedron as six tetrahedra: its faces are cut along the diagonals from their first vertices in
/// `priority` (smaller first), and the triangles of the three faces that lack the very first vertex
/// are joined with it. Cells that share a face cut it alike.
pub(crate) fn pulled_tetrahedra<K: Ord>(
    hexahedron: [u32; 8],
    priority: impl Fn(u32) -> K,
) -> [[u32; 4]; 6] {
    let first_of = |corners: &[usize]| {
        let key = |&i: &usize| (priority(hexahedron[corners[i]]), hexahedron[corners[i]]);
        (0..corners.len()).min_by_key(key).unwrap_or(0)
    };
    let apex = first_of(&[0, 1, 2, 3, 4, 5, 6, 7]);
    let mut tetrahedra = [[0; 4]; 6];
    let mut next = tetrahedra.iter_mut();
    for face in HEXAHEDRON_FACES.iter().filter(|face| !face.contains(&apex)) {
        let first = first_of(face);
        let [a, b, c, d] = std::array::from_fn(|i| hexahedron[face[(first + i) % 4]]);
        // Faces turn outward, so that the apex lies behind them.
        for triangle in [[a, b, c], [a, c, d]] {
            if let Some(tetrahedron) = next.next() {
                *tetrahedron = [hexahedron[apex], triangle[0], triangle[1], triangle[2]];
            }
        }
    }
    tetrahedra
}

/// Gives what hexahedra and quadrilaterals have to their parts, where these are to have it.
fn pass_on<T: Copy>(values: &mut ByKind<Vec<T>>, wanted: [bool; 2]) {
    let ByKind { tetrahedra, hexahedra, triangles, quads } = values;
    let (hexahedra, quads) = (std::mem::take(hexahedra), std::mem::take(quads));
    if wanted[0] {
        tetrahedra.extend(hexahedra.into_iter().flat_map(|value| [value; 6]));
    }
    if wanted[1] {
        triangles.extend(quads.into_iter().flat_map(|value| [value; 2]));
    }
}

impl Mesh {
    /// The mesh with six tetrahedra for each hexahedron and two triangles for each quadrilateral,
    /// behind those that it has.
    ///
    /// Faces are cut along the diagonal from their lowest vertex index, so that neighbours and
    /// surfaces fit. Groups and cell data go to the parts. A hexahedron with strongly warped faces may
    /// give flat or inverted tetrahedra; [`check()`](super::check::check) finds them.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_hexahedra;
    ///
    /// let mesh = box_hexahedra(DVec3::new(0.3, 0.1, 0.1), [3, 1, 1])?.split_into_simplices();
    /// assert_eq!((mesh.tetrahedra.len(), mesh.triangles.len()), (18, 28));
    /// assert!((mesh.total_volume() - 0.003).abs() < 1e-17);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn split_into_simplices(&self) -> Mesh {
        let mut mesh = self.clone();
        let hexahedra = std::mem::take(&mut mesh.hexahedra);
        let quads = std::mem::take(&mut mesh.quads);
        let (n_tets, n_triangles) = (mesh.tetrahedra.len(), mesh.triangles.len());
        for hexahedron in hexahedra {
            mesh.tetrahedra.extend(pulled_tetrahedra(hexahedron, |_| ()));
        }
        mesh.triangles.extend(quads.into_iter().flat_map(quad_triangles));
        for group in &mut mesh.groups {
            let parts =
                |cell: u32, n: u32, first: usize| (0..n).map(move |i| first as u32 + n * cell + i);
            let ByKind { tetrahedra, hexahedra, triangles, quads } = &mut group.cells;
            tetrahedra.extend(hexahedra.drain(..).flat_map(|cell| parts(cell, 6, n_tets)));
            triangles.extend(quads.drain(..).flat_map(|cell| parts(cell, 2, n_triangles)));
        }
        for data in &mut mesh.cell_data {
            pass_on(&mut data.values, [true; 2]);
        }
        // Lists that do not know every line would name wrong ones.
        let lines = &mut mesh.lines.cells;
        let known = [lines.tetrahedra.len() == n_tets, lines.triangles.len() == n_triangles];
        pass_on(lines, known);
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::CellData;
    use crate::mesh::generate::box_hexahedra;
    use glam::DVec3;

    #[test]
    fn every_order_of_priorities_fills_the_cube() {
        let mesh = box_hexahedra(DVec3::ONE, [1, 1, 1]).unwrap();
        for turn in 0..64u32 {
            let tets = pulled_tetrahedra(mesh.hexahedra[0], |v| v.wrapping_mul(2 * turn + 1) % 13);
            for tet in tets {
                let volume = mesh.signed_volume(tet).unwrap();
                assert!((volume - 1.0 / 6.0).abs() < 1e-15, "{turn} {tet:?} {volume}");
            }
        }
    }

    #[test]
    fn groups_and_data_go_to_the_parts() {
        let mut mesh = box_hexahedra(DVec3::new(2.0, 1.0, 1.0), [2, 1, 1]).unwrap();
        mesh.cell_data.push(CellData {
            name: "label".to_owned(),
            values: ByKind {
                hexahedra: vec![3.0, 4.0],
                quads: (0..10).map(f64::from).collect(),
                ..ByKind::default()
            },
            ..CellData::default()
        });
        let split = mesh.split_into_simplices();
        assert!(split.hexahedra.is_empty() && split.quads.is_empty());
        assert_eq!(split.triangles.len(), 20);
        assert_eq!(split.surface_triangles().len(), 20);
        let x1 = |mesh: &Mesh| mesh.group("x1").unwrap().clone();
        let parts =
            x1(&mesh).cells.quads.iter().flat_map(|&q| [2 * q, 2 * q + 1]).collect::<Vec<_>>();
        assert_eq!(x1(&split).cells.triangles, parts);
        assert_eq!(x1(&split).vertices, x1(&mesh).vertices);
        assert_eq!(split.group("body").unwrap().cells.tetrahedra, (0..12).collect::<Vec<u32>>());
        let data = &split.cell_data[0].values;
        assert_eq!((data.tetrahedra[5], data.tetrahedra[6], data.triangles[19]), (3.0, 4.0, 9.0));
        assert!(data.hexahedra.is_empty() && data.quads.is_empty());
    }
}
