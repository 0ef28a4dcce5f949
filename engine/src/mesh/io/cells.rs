//! Collects the cells and groups that a reader finds.

use super::scan::Cursor;
use crate::element_kind::{ByKind, ElementKind};
use crate::mesh::cell::second_order_triangles;
use crate::mesh::error::MeshError;
use crate::mesh::{CellData, Group, LINEAR, Mesh, SkippedCells};
use std::ops::Range;

/// The values of all cells in the order of the writers.
pub(crate) fn all_values(data: &CellData) -> impl Iterator<Item = f64> {
    data.values.in_files().into_iter().flatten().copied()
}

/// Names of the three numbers that a vector is kept as.
pub(crate) fn component_names(name: &str) -> [String; 3] {
    ["x", "y", "z"].map(|axis| format!("{name}_{axis}"))
}

/// Cell data as writers store them.
pub(crate) enum Column<'a> {
    Scalar(&'a CellData),
    /// Three neighbours whose names end in `_x`, `_y` and `_z`, under their common name.
    Vector(&'a str, [&'a CellData; 3]),
}

/// Joins the components of vectors. Whole numbers stay apart: readers keep vectors as reals.
pub(crate) fn columns(data: &[CellData]) -> Vec<Column<'_>> {
    let mut columns = Vec::with_capacity(data.len());
    let mut rest = data;
    while let Some((first, after)) = rest.split_first() {
        let joined = match rest {
            [x, y, z, ..] if [x, y, z].iter().all(|d| !d.integer) => {
                x.name.strip_suffix("_x").filter(|name| {
                    [&x.name, &y.name, &z.name].into_iter().eq(&component_names(name))
                        && data.iter().all(|other| other.name != *name)
                })
            }
            _ => None,
        };
        match (joined, rest) {
            (Some(name), [x, y, z, after @ ..]) => {
                columns.push(Column::Vector(name, [x, y, z]));
                rest = after;
            }
            _ => {
                columns.push(Column::Scalar(first));
                rest = after;
            }
        }
    }
    columns
}

/// A kind of cell in a file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct CellKind {
    pub name: &'static str,
    pub dimension: u8,
    /// Number of vertices, 0 when it varies.
    pub vertices: usize,
}

impl CellKind {
    pub const fn new(name: &'static str, dimension: u8, vertices: usize) -> Self {
        CellKind { name, dimension, vertices }
    }

    pub const TETRAHEDRON: CellKind = CellKind::new("tetrahedron", 3, 4);
    pub const HEXAHEDRON: CellKind = CellKind::new("8-node hexahedron", 3, 8);
    pub const TRIANGLE: CellKind = CellKind::new("triangle", 2, 3);
    pub const QUAD: CellKind = CellKind::new("4-node quadrilateral", 2, 4);
    /// Its vertices in the order of VTK.
    pub const TETRAHEDRON10: CellKind = CellKind::new("10-node tetrahedron", 3, 10);
    /// Kept as four triangles.
    pub const TRIANGLE6: CellKind = CellKind::new("6-node triangle", 2, 6);

    /// What a cell of the file becomes; nothing when it is skipped.
    pub fn used_as(self) -> Option<ElementKind> {
        match (self.dimension, self.vertices) {
            _ if self == Self::TETRAHEDRON10 => Some(ElementKind::Tetrahedron),
            (3, 4) => Some(ElementKind::Tetrahedron),
            (3, 8) => Some(ElementKind::Hexahedron),
            (2, 3 | 6) => Some(ElementKind::Triangle),
            (2, 4) => Some(ElementKind::Quad),
            _ => None,
        }
    }

    /// Number of cells that one of the file becomes.
    pub fn parts(self) -> usize {
        if self == Self::TRIANGLE6 { 4 } else { 1 }
    }
}

/// A mesh in the making.
#[derive(Default)]
pub(crate) struct Builder {
    pub mesh: Mesh,
}

impl Builder {
    pub fn new(source: &str) -> Self {
        Builder { mesh: Mesh { source: source.to_owned(), ..Mesh::default() } }
    }

    /// Adds a vertex; `line` is 0 when unknown.
    pub fn point(
        &mut self,
        cursor: &Cursor<'_>,
        point: glam::DVec3,
        line: usize,
    ) -> Result<(), MeshError> {
        if self.mesh.points.len() >= u32::MAX as usize {
            return Err(too_many(cursor.file, "vertices", self.mesh.points.len() as u64 + 1));
        }
        self.mesh.points.push(point);
        push_line(&mut self.mesh.lines.points, line);
        Ok(())
    }

    /// Adds an empty group and returns its position.
    pub fn group(&mut self, name: String, dimension: u8) -> usize {
        self.mesh.groups.push(Group { name, dimension, ..Group::default() });
        self.mesh.groups.len() - 1
    }

    /// Adds a cell to the mesh and to the groups; `line` is 0 when unknown.
    pub fn cell(&mut self, kind: CellKind, vertices: &[u32], groups: &[usize], line: usize) {
        fn push<const N: usize>(cells: &mut Vec<[u32; N]>, vertices: &[u32]) -> bool {
            let Ok(cell) = vertices.try_into() else { return false };
            cells.push(cell);
            true
        }
        let mesh = &mut self.mesh;
        let used_as = kind.used_as();
        let index = used_as.map_or(0, |cell| mesh.count(cell));
        let kept = used_as.filter(|cell| match cell {
            ElementKind::Tetrahedron => {
                let (corners, middles) = vertices.split_at(vertices.len().min(4));
                if let Ok(middles) = middles.try_into() {
                    mesh.middles.resize(mesh.tetrahedra.len(), LINEAR);
                    mesh.middles.push(middles);
                }
                push(&mut mesh.tetrahedra, corners)
            }
            ElementKind::Triangle if kind == CellKind::TRIANGLE6 => {
                let parts = vertices.try_into().map_or([[0; 3]; 4], second_order_triangles);
                parts.iter().all(|t| push(&mut mesh.triangles, t))
            }
            ElementKind::Triangle => push(&mut mesh.triangles, vertices),
            ElementKind::Hexahedron => push(&mut mesh.hexahedra, vertices),
            ElementKind::Quad => push(&mut mesh.quads, vertices),
        });
        if let Some(cell) = kept {
            (0..kind.parts()).for_each(|_| push_line(&mut mesh.lines.cells[cell], line));
        } else {
            match mesh.skipped.iter_mut().find(|s| s.kind == kind.name) {
                Some(skipped) => skipped.count += 1,
                None => {
                    mesh.skipped.push(SkippedCells { kind: kind.name.to_owned(), count: 1 });
                }
            }
        }
        self.join(kept, index..index + kind.parts(), vertices, groups);
    }

    /// Makes existing cells members of more groups.
    pub fn join(
        &mut self,
        kind: Option<ElementKind>,
        cells: Range<usize>,
        vertices: &[u32],
        groups: &[usize],
    ) {
        for &slot in groups {
            let group = &mut self.mesh.groups[slot];
            group.vertices.extend_from_slice(vertices);
            if let Some(kind) = kind {
                group.cells[kind].extend(cells.clone().map(|index| index as u32));
            }
        }
    }

    /// The data of that name, filled up with NaN to all cells so far.
    pub fn data(&mut self, name: &str, integer: bool) -> &mut CellData {
        let mesh = &mut self.mesh;
        let at = mesh.cell_data.iter().position(|data| data.name == name).unwrap_or_else(|| {
            mesh.cell_data.push(CellData { name: name.to_owned(), integer, ..CellData::default() });
            mesh.cell_data.len() - 1
        });
        let counts = ByKind::of(|kind| mesh.count(kind));
        let data = &mut mesh.cell_data[at];
        fill(data, &counts);
        data.integer &= integer;
        data
    }

    pub fn finish(mut self) -> Mesh {
        if !self.mesh.middles.is_empty() {
            self.mesh.middles.resize(self.mesh.tetrahedra.len(), LINEAR);
        }
        let counts = ByKind::of(|kind| self.mesh.count(kind));
        for data in &mut self.mesh.cell_data {
            fill(data, &counts);
        }
        for group in &mut self.mesh.groups {
            for list in group.cells.iter_mut().chain([&mut group.vertices]) {
                list.sort_unstable();
                list.dedup();
            }
        }
        self.mesh
    }
}

/// A number that is missing is no whole number.
fn fill(data: &mut CellData, counts: &ByKind<usize>) {
    for (values, &count) in data.values.iter_mut().zip(counts.iter()) {
        data.integer &= values.len() == count;
        values.resize(count, f64::NAN);
    }
}

fn push_line(lines: &mut Vec<u32>, line: usize) {
    if line > 0 {
        lines.push(u32::try_from(line).unwrap_or(u32::MAX));
    }
}

pub(crate) fn too_many(file: &str, what: &'static str, count: u64) -> MeshError {
    MeshError::TooMany { file: file.to_owned(), what, count, limit: u64::from(u32::MAX) }
}
