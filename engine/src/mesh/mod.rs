//! Plain mesh data: readers and writers, generators and the check before the first step.
//!
//! A [`Mesh`] is what a file or a generator gives: points, cells and named groups, nothing derived.
//! [`check()`](check::check) looks for everything that would spoil a simulation, repairs the winding
//! and reports the rest.
//!
//! # Order of the vertices
//!
//! That of Gmsh and VTK. Vertices of a tetrahedron `abcd` are ordered so that its signed volume
//! `(b - a) . ((c - a) x (d - a)) / 6` is positive; faces turn outward when listed as
//! `bcd`, `adc`, `abd`, `acb`. A quadrilateral goes round once, counter-clockwise seen from where its
//! normal points. A hexahedron has its bottom `0123`, counter-clockwise seen from the top, and its top
//! `4567` above it:
//!
//! ```text
//!       7---------6
//!      /|        /|
//!     / |       / |          z
//!    4---------5  |          |  y
//!    |  3------|--2          | /
//!    | /       | /           |/
//!    |/        |/            +----x
//!    0---------1
//! ```
//!
//! Its faces turn outward as `0321`, `4567`, `0154`, `1265`, `2376`, `3047`; its volume is that of the
//! trilinear map of a cube, which bends warped faces into hyperbolic paraboloids.
//!
//! A mesh of second order has six more vertices for each tetrahedron, on its edges `ab`, `bc`, `ac`, `ad`, `bd`, `cd` (the
//! order of VTK; readers and writers of Gmsh exchange the last two), so that edges and faces may be curved. Their faces are
//! handed on as four flat triangles each.

pub(crate) mod cell;
pub mod check;
mod embed;
pub mod error;
pub mod generate;
pub mod io;
mod lattice;
pub mod merge;
pub use embed::{EmbeddedPoints, place_in_hexahedron};
pub use lattice::{FILLED, Filled, LEAST_FILLED, LatticeReport};
mod second_order;
mod select;
pub use second_order::PutOnSurface;
pub use select::{Patch, Zone};
mod split;
mod surface;

use crate::element_kind::{ByKind, ElementKind};
use crate::memory;
use glam::{DQuat, DVec3};
use std::path::Path;

pub use check::{
    CheckError, CheckOptions, CheckReport, CheckedMesh, Finding, FindingCode, MeshStatistics,
    Severity, check,
};
pub use error::{FileProblem, MeshError, Place};
pub use surface::{Surface, enclosed_volume};

pub use cell::CellVertices;
pub(crate) use cell::{for_equal_cells, sorted};

/// Vertices, cells and named groups of a body, as found in a file or made by a generator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// File name or generator description.
    pub source: String,
    /// Rest positions in metres, in file order.
    pub points: Vec<DVec3>,
    /// Four vertex indices per tetrahedron, in file order.
    pub tetrahedra: Vec<[u32; 4]>,
    /// The vertices on the edges of each tetrahedron in a mesh of second order, none in one of first order; see the
    /// [order of the vertices](self). [`LINEAR`] stands for a tetrahedron without them, which the check refuses.
    pub middles: Vec<[u32; 6]>,
    /// Eight vertex indices per hexahedron, in file order; see the [order of the vertices](self).
    pub hexahedra: Vec<[u32; 8]>,
    /// Three vertex indices per triangle: surface triangles or membranes as found in the file.
    pub triangles: Vec<[u32; 3]>,
    /// Four vertex indices per quadrilateral, once round: surfaces or membranes as found in the file.
    pub quads: Vec<[u32; 4]>,
    /// Physical groups, regions and node sets under their names.
    pub groups: Vec<Group>,
    /// Numbers that the file keeps with its cells, such as a stiffness or a label.
    pub cell_data: Vec<CellData>,
    /// Cells of kinds that the engine cannot use, counted by kind.
    pub skipped: Vec<SkippedCells>,
    /// Lines of the file on which vertices and cells stand, where a reader knows them.
    pub lines: FileLines,
}

/// Stands for the vertices on the edges of a linear tetrahedron beside others of second order.
pub const LINEAR: [u32; 6] = [u32::MAX; 6];

/// A named set of vertices and cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Group {
    /// Name in the file, or the tag number if it has none.
    pub name: String,
    /// Dimension of the cells: 0 node set, 1 lines, 2 faces, 3 volumes.
    pub dimension: u8,
    /// Indices of the vertices of all cells, also of skipped ones; sorted, each once.
    pub vertices: Vec<u32>,
    /// Indices of the cells.
    pub cells: ByKind<Vec<u32>>,
}

/// A named number for every cell; NaN where the file has none.
///
/// Readers keep a vector `NAME` of three components as the numbers `NAME_x`, `NAME_y` and `NAME_z`;
/// writers join three such neighbours again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellData {
    /// Name in the file.
    pub name: String,
    /// Whether the file holds whole numbers; writers keep them so.
    pub integer: bool,
    /// One value for each cell.
    pub values: ByKind<Vec<f64>>,
}

/// How many cells of one kind were left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkippedCells {
    /// Kind of the cells, such as "6-node prism".
    pub kind: String,
    /// Number of cells.
    pub count: usize,
}

/// Line numbers in a text file, counted from 1; each list is empty where they are not known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FileLines {
    /// Line of each point.
    pub points: Vec<u32>,
    /// Line of each cell.
    pub cells: ByKind<Vec<u32>>,
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
        io::read_with(path, &memory::read_file)
    }

    /// Refuses a mesh whose body would need more memory than there is.
    ///
    /// # Errors
    ///
    /// [`MeshError::TooLarge`] with the estimate.
    pub fn fits_into_memory(&self) -> Result<(), MeshError> {
        let mut counts = ByKind::default();
        self.matter().into_iter().for_each(|kind| counts[kind] = self.count(kind));
        let what = format!("{} ({} cells)", self.source, counts.iter().sum::<usize>());
        Ok(memory::fits(&what, || memory::of_body(&counts, self.middles.len()))?)
    }

    /// Reads a mesh as [`Mesh::read`] does, from files that `open` gives in place of the file system: an
    /// archive, a network, memory. It is asked for `path`, and for TetGen meshes for the files beside it;
    /// an optional one may be answered by [`NotFound`](std::io::ErrorKind::NotFound).
    ///
    /// # Errors
    ///
    /// As [`Mesh::read`]; what `open` answers becomes [`MeshError::Io`].
    pub fn read_with(
        path: &Path,
        open: &dyn Fn(&Path) -> std::io::Result<Vec<u8>>,
    ) -> Result<Mesh, MeshError> {
        io::read_with(path, open)
    }

    /// Reads a mesh from the bytes of a file. As in [`Mesh::read`] the first bytes tell the format, or else
    /// the extension of `name` does, which messages give too.
    ///
    /// # Errors
    ///
    /// As [`Mesh::read`]; [`MeshError::SeveralFiles`] for TetGen meshes, which [`Mesh::read_with`] and
    /// [`io::read_tetgen`] read.
    ///
    /// ```
    /// use sinew_engine::mesh::Mesh;
    ///
    /// let triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    /// let mesh = Mesh::from_bytes("skin.obj", triangle)?;
    /// assert_eq!((mesh.points.len(), &mesh.triangles[..]), (3, &[[0, 1, 2]][..]));
    /// let error = Mesh::from_bytes("skin.obj", b"v 0 zero 0\n").unwrap_err();
    /// assert!(error.to_string().starts_with("skin.obj, line 1: found `zero`"));
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
        io::from_bytes(Path::new(name), bytes)
    }

    /// Number of cells of a kind.
    pub fn count(&self, kind: ElementKind) -> usize {
        match kind {
            ElementKind::Tetrahedron => self.tetrahedra.len(),
            ElementKind::Triangle => self.triangles.len(),
            ElementKind::Hexahedron => self.hexahedra.len(),
            ElementKind::Quad => self.quads.len(),
        }
    }

    /// Vertices of a cell, of a tetrahedron of second order all ten; `None` when there is no such cell.
    pub fn cell(&self, kind: ElementKind, index: usize) -> Option<CellVertices> {
        Some(match kind {
            ElementKind::Tetrahedron => match self.second_order(index) {
                Some(ten) => CellVertices::of(&ten),
                None => CellVertices::of(self.tetrahedra.get(index)?),
            },
            ElementKind::Triangle => CellVertices::of(self.triangles.get(index)?),
            ElementKind::Hexahedron => CellVertices::of(self.hexahedra.get(index)?),
            ElementKind::Quad => CellVertices::of(self.quads.get(index)?),
        })
    }

    /// Vertices of every cell of a kind, as [`Mesh::cell`] gives them.
    pub fn cells(&self, kind: ElementKind) -> impl Iterator<Item = CellVertices> {
        (0..self.count(kind)).filter_map(move |index| self.cell(kind, index))
    }

    /// The kinds of cells that make a body: those with a volume, or the faces of a mesh without.
    pub fn matter(&self) -> [ElementKind; 2] {
        match self.is_solid() {
            true => [ElementKind::Tetrahedron, ElementKind::Hexahedron],
            false => [ElementKind::Triangle, ElementKind::Quad],
        }
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

    /// Sum of the signed volumes of all tetrahedra and hexahedra (m^3).
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_hexahedra;
    ///
    /// let mesh = box_hexahedra(DVec3::new(0.4, 0.2, 0.1), [4, 2, 1])?;
    /// assert!((mesh.total_volume() - 0.008).abs() < 1e-16);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn total_volume(&self) -> f64 {
        let tets = (0..self.tetrahedra.len()).filter_map(|i| self.tetrahedron_volume(i));
        let hexes = self.hexahedra.iter().filter_map(|&hex| self.hexahedron_volume(hex));
        // From 0: the sum of nothing is -0.
        tets.chain(hexes).fold(0.0, |sum, volume| sum + volume)
    }

    /// Whether there are cells with a volume: tetrahedra or hexahedra.
    pub fn is_solid(&self) -> bool {
        !self.tetrahedra.is_empty() || !self.hexahedra.is_empty()
    }

    /// Signed volume of a tetrahedron (m^3), `None` when an index is out of range.
    pub fn signed_volume(&self, [a, b, c, d]: [u32; 4]) -> Option<f64> {
        let point = |index: u32| self.points.get(index as usize).copied();
        let a = point(a)?;
        Some((point(b)? - a).dot((point(c)? - a).cross(point(d)? - a)) / 6.0)
    }

    /// Signed volume of a trilinear hexahedron (m^3), exact but for rounding (2 x 2 x 2 Gauss points);
    /// `None` when an index is out of range.
    pub fn hexahedron_volume(&self, hexahedron: [u32; 8]) -> Option<f64> {
        let mut corners = [DVec3::ZERO; 8];
        for (corner, index) in corners.iter_mut().zip(hexahedron) {
            *corner = *self.points.get(index as usize)?;
        }
        Some(cell::hexahedron_volume(&corners))
    }

    /// Edges of the volume cells, or of the faces in a mesh without them: smaller index first, in the
    /// order of the cells, once for each cell that has them. Edges of second order come as two halves.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges = Vec::new();
        let mut push = |i: u32, j: u32| edges.push([i.min(j), i.max(j)]);
        for kind in self.matter() {
            self.cells(kind).for_each(|own| cell::edges(kind, &own, &mut push));
        }
        edges
    }

    /// The points with some of the cells and their data; groups and lines are left out.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn only(&self, kept: &ByKind<Vec<usize>>) -> Mesh {
        fn picked<T: Copy>(from: &[T], which: &[usize]) -> Vec<T> {
            which.iter().map(|&i| from[i]).collect()
        }
        let middles = if self.is_second_order() { &kept.tetrahedra[..] } else { &[] };
        let data = |data: &CellData| CellData {
            name: data.name.clone(),
            integer: data.integer,
            values: ByKind::of(|kind| picked(&data.values[kind], &kept[kind])),
        };
        Mesh {
            source: self.source.clone(),
            points: self.points.clone(),
            tetrahedra: picked(&self.tetrahedra, &kept.tetrahedra),
            middles: picked(&self.middles, middles),
            hexahedra: picked(&self.hexahedra, &kept.hexahedra),
            triangles: picked(&self.triangles, &kept.triangles),
            quads: picked(&self.quads, &kept.quads),
            cell_data: self.cell_data.iter().map(data).collect(),
            ..Mesh::default()
        }
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
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn unit_tet() -> Mesh {
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
    fn edges_of_every_kind_of_cell() {
        let count = |mesh: &Mesh| {
            let mut edges = mesh.edges();
            assert!(edges.iter().all(|[a, b]| a < b));
            let listed = edges.len();
            edges.sort_unstable();
            edges.dedup();
            (listed, edges.len())
        };
        let mut mesh = unit_tet();
        assert!(mesh.is_solid());
        assert_eq!(count(&mesh), (6, 6));
        // the faces of a volume have its edges
        mesh.triangles.push([0, 2, 1]);
        assert_eq!(count(&mesh), (6, 6));
        let cells = [2, 3, 4];
        let mut mesh = generate::box_hexahedra(DVec3::ONE, cells).unwrap();
        let along = |i: usize| cells[i] * (cells[(i + 1) % 3] + 1) * (cells[(i + 2) % 3] + 1);
        assert_eq!(count(&mesh), (12 * 24, along(0) + along(1) + along(2)));
        mesh.hexahedra.clear();
        assert!(!mesh.is_solid());
        // n quads on a closed surface have 2 n edges
        assert_eq!(count(&mesh), (4 * 52, 2 * 52));
        mesh.quads.clear();
        mesh.triangles = vec![[0, 1, 2], [2, 1, 3]];
        assert_eq!(count(&mesh), (6, 5));
        assert_eq!(mesh.total_volume().to_bits(), 0f64.to_bits());
    }

    #[test]
    fn transformation_scales_rotates_and_moves() {
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let mesh = unit_tet().transformed(2.0, turn, DVec3::new(10.0, 0.0, 0.0));
        assert!((mesh.points[1] - DVec3::new(10.0, 2.0, 0.0)).length() < 1e-15);
        assert!((mesh.total_volume() - 8.0 / 6.0).abs() < 1e-14);
    }
}
