//! Plain mesh data: readers and writers, generators and the check before the first step.
//!
//! A [`Mesh`] is what a file or a generator gives: points, cells and named groups, nothing derived.
//! [`check()`](check::check) looks for everything that would spoil a simulation, repairs the winding
//! and reports the rest.
//!
//! Vertices of a tetrahedron are ordered so that its signed volume
//! `(b - a) . ((c - a) x (d - a)) / 6` is positive; faces turn outward when listed as
//! `bcd`, `adc`, `abd`, `acb`.

pub mod check;
pub mod error;
pub mod generate;
pub mod io;

use glam::{DQuat, DVec3};
use std::path::Path;

pub use check::{
    CheckError, CheckOptions, CheckReport, CheckedMesh, Finding, FindingCode, MeshStatistics,
    Severity, check,
};
pub use error::{MeshError, Place};

/// Vertices, cells and named groups of a body, as found in a file or made by a generator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// File name or generator description.
    pub source: String,
    /// Rest positions in metres, in file order.
    pub points: Vec<DVec3>,
    /// Four vertex indices per tetrahedron, in file order.
    pub tetrahedra: Vec<[u32; 4]>,
    /// Three vertex indices per triangle: surface triangles or membranes as found in the file.
    pub triangles: Vec<[u32; 3]>,
    /// Physical groups, regions and node sets under their names.
    pub groups: Vec<Group>,
    /// Numbers that the file keeps with its cells, such as a stiffness or a label.
    pub cell_data: Vec<CellData>,
    /// Cells of kinds that the engine cannot use, counted by kind.
    pub skipped: Vec<SkippedCells>,
    /// Lines of the file on which vertices and cells stand, where a reader knows them.
    pub lines: FileLines,
}

/// A named set of vertices and cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Group {
    /// Name in the file, or the tag number if it has none.
    pub name: String,
    /// Dimension of the cells: 0 node set, 1 lines, 2 faces, 3 volumes.
    pub dimension: u8,
    /// Indices of the vertices of all cells, also of skipped ones; sorted, each once.
    pub vertices: Vec<u32>,
    /// Indices of the tetrahedra.
    pub tetrahedra: Vec<u32>,
    /// Indices of the triangles.
    pub triangles: Vec<u32>,
}

/// A named number for every tetrahedron and triangle; NaN where the file has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellData {
    /// Name in the file.
    pub name: String,
    /// Whether the file holds whole numbers; writers keep them so.
    pub integer: bool,
    /// One value for each tetrahedron.
    pub tetrahedra: Vec<f64>,
    /// One value for each triangle.
    pub triangles: Vec<f64>,
}

/// How many cells of one kind were left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedCells {
    /// Kind of the cells, such as "8-node hexahedron".
    pub kind: String,
    /// Number of cells.
    pub count: usize,
}

/// Line numbers in a text file, counted from 1; each list is empty where they are not known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileLines {
    /// Line of each point.
    pub points: Vec<u32>,
    /// Line of each tetrahedron.
    pub tetrahedra: Vec<u32>,
    /// Line of each triangle.
    pub triangles: Vec<u32>,
}

impl Mesh {
    /// Reads a mesh file; its first bytes tell the format, or else its extension does.
    ///
    /// TetGen meshes are named by their `.node` or `.ele` file; both are read, and a `.face` file
    /// beside them.
    ///
    /// # Errors
    ///
    /// Every [`MeshError`] that has a file: absent, of unknown format, incomplete or wrong.
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        io::read(path)
    }

    /// The first group of that name, in order of dimension.
    pub fn group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|group| group.name == name)
    }

    /// The group of that name whose cells have `dimension` dimensions (0 to 3).
    pub fn group_of_dimension(&self, name: &str, dimension: u8) -> Option<&Group> {
        self.groups.iter().find(|group| group.name == name && group.dimension == dimension)
    }

    /// The cell data of that name.
    pub fn data(&self, name: &str) -> Option<&CellData> {
        self.cell_data.iter().find(|data| data.name == name)
    }

    /// Smallest and largest corner (m) of the box around all points, `None` without points.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let first = *self.points.first()?;
        Some(self.points.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p))))
    }

    /// Sum of the signed volumes of all tetrahedra (m^3).
    pub fn total_volume(&self) -> f64 {
        self.tetrahedra.iter().filter_map(|&tet| self.signed_volume(tet)).sum()
    }

    /// Signed volume of a tetrahedron (m^3), `None` when an index is out of range.
    pub fn signed_volume(&self, [a, b, c, d]: [u32; 4]) -> Option<f64> {
        let point = |index: u32| self.points.get(index as usize).copied();
        let a = point(a)?;
        Some((point(b)? - a).dot((point(c)? - a).cross(point(d)? - a)) / 6.0)
    }

    /// The mesh with every point scaled, then rotated, then moved by `translation` (m).
    ///
    /// A negative `scale` mirrors the body and thereby turns the winding of every cell round.
    pub fn transformed(&self, scale: f64, rotation: DQuat, translation: DVec3) -> Mesh {
        let mut mesh = self.clone();
        for point in &mut mesh.points {
            *point = rotation * (*point * scale) + translation;
        }
        mesh
    }

    /// Triangles that bound the tetrahedra, turned outward, in the order of the tetrahedra.
    ///
    /// A face belongs to the boundary when exactly one tetrahedron has it. Tetrahedra with an index
    /// out of range are left out.
    pub fn surface_triangles(&self) -> Vec<[u32; 3]> {
        let n_points = self.points.len();
        let mut faces = Vec::with_capacity(self.tetrahedra.len().saturating_mul(4));
        for &tet in &self.tetrahedra {
            if tet.iter().all(|&v| (v as usize) < n_points) {
                let inverted = self.signed_volume(tet).is_some_and(|volume| volume < 0.0);
                for [a, b, c] in tetrahedron_faces(tet) {
                    faces.push(if inverted { [a, c, b] } else { [a, b, c] });
                }
            }
        }
        boundary_faces(&faces, n_points)
    }
}

/// Faces of a tetrahedron, outward when its signed volume is positive.
pub(crate) fn tetrahedron_faces([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 4] {
    [[b, c, d], [a, d, c], [a, b, d], [a, c, b]]
}

/// The vertex indices of a cell in ascending order.
pub(crate) fn sorted<const N: usize>(mut cell: [u32; N]) -> [u32; N] {
    cell.sort_unstable();
    cell
}

/// Faces that occur once in the list, in the order of the list.
pub(crate) fn boundary_faces(faces: &[[u32; 3]], n_points: usize) -> Vec<[u32; 3]> {
    let mut single = vec![false; faces.len()];
    for_equal_cells(faces, n_points, |equal| {
        if let &[(_, only)] = equal {
            single[only as usize] = true;
        }
    });
    faces.iter().zip(single).filter_map(|(&face, single)| single.then_some(face)).collect()
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

    fn unit_tet() -> Mesh {
        Mesh {
            points: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
            tetrahedra: vec![[0, 1, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn volume_and_bounds_of_the_unit_tetrahedron() {
        let mesh = unit_tet();
        assert_eq!(mesh.total_volume(), 1.0 / 6.0);
        assert_eq!(mesh.bounds(), Some((DVec3::ZERO, DVec3::ONE)));
        assert_eq!(Mesh::default().bounds(), None);
    }

    #[test]
    fn transformation_scales_rotates_and_moves() {
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let mesh = unit_tet().transformed(2.0, turn, DVec3::new(10.0, 0.0, 0.0));
        assert!((mesh.points[1] - DVec3::new(10.0, 2.0, 0.0)).length() < 1e-15);
        assert!((mesh.total_volume() - 8.0 / 6.0).abs() < 1e-14);
    }

    /// Divergence theorem: the enclosed volume has the right sign only if all faces turn outward.
    fn enclosed_volume(mesh: &Mesh) -> f64 {
        let p = |i: u32| mesh.points[i as usize];
        mesh.surface_triangles().iter().map(|&[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0).sum()
    }

    #[test]
    fn surface_turns_outward_for_either_winding() {
        let mut mesh = unit_tet();
        assert!((enclosed_volume(&mesh) - 1.0 / 6.0).abs() < 1e-15);
        mesh.tetrahedra[0] = [0, 1, 3, 2];
        assert!((enclosed_volume(&mesh) - 1.0 / 6.0).abs() < 1e-15);
        mesh.tetrahedra.push([0, 1, 2, 99]);
        assert_eq!(mesh.surface_triangles().len(), 4);
    }

    #[test]
    fn shared_faces_are_inside() {
        let mut mesh = unit_tet();
        mesh.points.push(DVec3::ONE);
        mesh.tetrahedra.push([1, 2, 3, 4]);
        assert_eq!(mesh.surface_triangles().len(), 6);
        assert!((enclosed_volume(&mesh) - mesh.total_volume()).abs() < 1e-15);
    }
}
