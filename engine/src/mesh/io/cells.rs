//! Collects the cells and groups that a reader finds.

use super::scan::Cursor;
use crate::mesh::error::MeshError;
use crate::mesh::{CellData, Group, Mesh, SkippedCells};

/// What a cell of a file becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CellUse {
    Tetrahedron,
    Triangle,
    Skipped,
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
    pub const TRIANGLE: CellKind = CellKind::new("triangle", 2, 3);

    pub fn used_as(self) -> CellUse {
        match (self.dimension, self.vertices) {
            (3, 4) => CellUse::Tetrahedron,
            (2, 3) => CellUse::Triangle,
            _ => CellUse::Skipped,
        }
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
        let mesh = &mut self.mesh;
        match (kind.used_as(), vertices) {
            (CellUse::Tetrahedron, &[a, b, c, d]) => {
                mesh.tetrahedra.push([a, b, c, d]);
                push_line(&mut mesh.lines.tetrahedra, line);
                self.join(CellUse::Tetrahedron, self.mesh.tetrahedra.len() - 1, vertices, groups);
            }
            (CellUse::Triangle, &[a, b, c]) => {
                mesh.triangles.push([a, b, c]);
                push_line(&mut mesh.lines.triangles, line);
                self.join(CellUse::Triangle, self.mesh.triangles.len() - 1, vertices, groups);
            }
            _ => {
                match mesh.skipped.iter_mut().find(|s| s.kind == kind.name) {
                    Some(skipped) => skipped.count += 1,
                    None => {
                        mesh.skipped.push(SkippedCells { kind: kind.name.to_owned(), count: 1 });
                    }
                }
                self.join(CellUse::Skipped, 0, vertices, groups);
            }
        }
    }

    /// Makes an existing cell a member of more groups.
    pub fn join(&mut self, cell: CellUse, index: usize, vertices: &[u32], groups: &[usize]) {
        for &slot in groups {
            let group = &mut self.mesh.groups[slot];
            group.vertices.extend_from_slice(vertices);
            match cell {
                CellUse::Tetrahedron => group.tetrahedra.push(index as u32),
                CellUse::Triangle => group.triangles.push(index as u32),
                CellUse::Skipped => {}
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
        let data = &mut mesh.cell_data[at];
        fill(data, mesh.tetrahedra.len(), mesh.triangles.len());
        data.integer &= integer;
        data
    }

    pub fn finish(mut self) -> Mesh {
        for data in &mut self.mesh.cell_data {
            fill(data, self.mesh.tetrahedra.len(), self.mesh.triangles.len());
        }
        for group in &mut self.mesh.groups {
            for list in [&mut group.vertices, &mut group.tetrahedra, &mut group.triangles] {
                list.sort_unstable();
                list.dedup();
            }
        }
        self.mesh
    }
}

/// A number that is missing is no whole number.
fn fill(data: &mut CellData, n_tetrahedra: usize, n_triangles: usize) {
    data.integer &= data.tetrahedra.len() == n_tetrahedra && data.triangles.len() == n_triangles;
    data.tetrahedra.resize(n_tetrahedra, f64::NAN);
    data.triangles.resize(n_triangles, f64::NAN);
}

fn push_line(lines: &mut Vec<u32>, line: usize) {
    if line > 0 {
        lines.push(u32::try_from(line).unwrap_or(u32::MAX));
    }
}

pub(crate) fn too_many(file: &str, what: &'static str, count: u64) -> MeshError {
    MeshError::TooMany { file: file.to_owned(), what, count, limit: u64::from(u32::MAX) }
}
