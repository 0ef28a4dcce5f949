//! Collects the cells and groups that a reader finds.

use super::scan::Cursor;
use crate::mesh::cell::second_order_triangles;
use crate::mesh::error::MeshError;
use crate::mesh::{CellData, Group, LINEAR, Mesh, SkippedCells};
use std::ops::{Deref, Range};

/// What a cell of a file becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CellUse {
    Tetrahedron,
    Hexahedron,
    Triangle,
    Quad,
    Skipped,
}

impl CellUse {
    /// The kinds that are kept, in the order in which writers list them.
    pub const KEPT: [CellUse; 4] =
        [CellUse::Tetrahedron, CellUse::Hexahedron, CellUse::Triangle, CellUse::Quad];

    /// How many cells of this kind the mesh has.
    pub fn count(self, mesh: &Mesh) -> usize {
        match self {
            CellUse::Tetrahedron => mesh.tetrahedra.len(),
            CellUse::Hexahedron => mesh.hexahedra.len(),
            CellUse::Triangle => mesh.triangles.len(),
            CellUse::Quad => mesh.quads.len(),
            CellUse::Skipped => 0,
        }
    }

    /// The list of a group that holds cells of this kind.
    pub fn members(self, group: &Group) -> &[u32] {
        match self {
            CellUse::Tetrahedron => &group.tetrahedra,
            CellUse::Hexahedron => &group.hexahedra,
            CellUse::Triangle => &group.triangles,
            CellUse::Quad => &group.quads,
            CellUse::Skipped => &[],
        }
    }

    fn members_mut(self, group: &mut Group) -> Option<&mut Vec<u32>> {
        match self {
            CellUse::Tetrahedron => Some(&mut group.tetrahedra),
            CellUse::Hexahedron => Some(&mut group.hexahedra),
            CellUse::Triangle => Some(&mut group.triangles),
            CellUse::Quad => Some(&mut group.quads),
            CellUse::Skipped => None,
        }
    }

    /// The values for cells of this kind.
    pub fn values(self, data: &CellData) -> &[f64] {
        match self {
            CellUse::Tetrahedron => &data.tetrahedra,
            CellUse::Hexahedron => &data.hexahedra,
            CellUse::Triangle => &data.triangles,
            CellUse::Quad => &data.quads,
            CellUse::Skipped => &[],
        }
    }

    pub fn values_mut(self, data: &mut CellData) -> Option<&mut Vec<f64>> {
        match self {
            CellUse::Tetrahedron => Some(&mut data.tetrahedra),
            CellUse::Hexahedron => Some(&mut data.hexahedra),
            CellUse::Triangle => Some(&mut data.triangles),
            CellUse::Quad => Some(&mut data.quads),
            CellUse::Skipped => None,
        }
    }
}

/// The values of all cells in the order of the writers.
pub(crate) fn all_values(data: &CellData) -> impl Iterator<Item = f64> {
    CellUse::KEPT.into_iter().flat_map(|cell| cell.values(data).iter().copied())
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

    pub fn used_as(self) -> CellUse {
        match (self.dimension, self.vertices) {
            _ if self == Self::TETRAHEDRON10 => CellUse::Tetrahedron,
            (2, 6) => CellUse::Triangle,
            (3, 4) => CellUse::Tetrahedron,
            (3, 8) => CellUse::Hexahedron,
            (2, 3) => CellUse::Triangle,
            (2, 4) => CellUse::Quad,
            _ => CellUse::Skipped,
        }
    }

    /// Number of cells that one of the file becomes.
    pub fn parts(self) -> usize {
        if self == Self::TRIANGLE6 { 4 } else { 1 }
    }
}

/// Vertices of a cell that a writer lists.
pub(crate) struct CellVertices {
    list: [u32; 10],
    count: usize,
}

impl CellVertices {
    pub fn of(vertices: &[u32]) -> Self {
        let mut list = [0; 10];
        let count = vertices.len().min(10);
        list[..count].copy_from_slice(&vertices[..count]);
        Self { list, count }
    }

    /// Of a tetrahedron, with the vertices on its edges if it has them.
    pub fn of_tetrahedron(corners: &[u32; 4], middles: Option<&[u32; 6]>) -> Self {
        let mut own = Self::of(corners);
        if let Some(middles) = middles.filter(|middles| **middles != LINEAR) {
            own.list[4..].copy_from_slice(middles);
            own.count = 10;
        }
        own
    }
}

impl Deref for CellVertices {
    type Target = [u32];
    fn deref(&self) -> &[u32] {
        &self.list[..self.count]
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
        fn push<const N: usize>(
            cells: &mut Vec<[u32; N]>,
            lines: &mut Vec<u32>,
            vertices: &[u32],
            line: usize,
        ) -> bool {
            let Ok(cell) = vertices.try_into() else { return false };
            cells.push(cell);
            push_line(lines, line);
            true
        }
        let mesh = &mut self.mesh;
        let mut cell = kind.used_as();
        let index = cell.count(mesh);
        let lines = &mut mesh.lines;
        let kept = match cell {
            CellUse::Tetrahedron => {
                let (corners, middles) = vertices.split_at(vertices.len().min(4));
                if let Ok(middles) = middles.try_into() {
                    mesh.middles.resize(mesh.tetrahedra.len(), LINEAR);
                    mesh.middles.push(middles);
                }
                push(&mut mesh.tetrahedra, &mut lines.tetrahedra, corners, line)
            }
            CellUse::Triangle if kind == CellKind::TRIANGLE6 => {
                let parts = vertices.try_into().map_or([[0; 3]; 4], second_order_triangles);
                parts.iter().all(|t| push(&mut mesh.triangles, &mut lines.triangles, t, line))
            }
            CellUse::Hexahedron => push(&mut mesh.hexahedra, &mut lines.hexahedra, vertices, line),
            CellUse::Triangle => push(&mut mesh.triangles, &mut lines.triangles, vertices, line),
            CellUse::Quad => push(&mut mesh.quads, &mut lines.quads, vertices, line),
            CellUse::Skipped => false,
        };
        if !kept {
            cell = CellUse::Skipped;
            match mesh.skipped.iter_mut().find(|s| s.kind == kind.name) {
                Some(skipped) => skipped.count += 1,
                None => {
                    mesh.skipped.push(SkippedCells { kind: kind.name.to_owned(), count: 1 });
                }
            }
        }
        self.join(cell, index..index + kind.parts(), vertices, groups);
    }

    /// Makes existing cells members of more groups.
    pub fn join(&mut self, cell: CellUse, cells: Range<usize>, vertices: &[u32], groups: &[usize]) {
        for &slot in groups {
            let group = &mut self.mesh.groups[slot];
            group.vertices.extend_from_slice(vertices);
            if let Some(members) = cell.members_mut(group) {
                members.extend(cells.clone().map(|index| index as u32));
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
        let counts = CellUse::KEPT.map(|cell| cell.count(mesh));
        let data = &mut mesh.cell_data[at];
        fill(data, counts);
        data.integer &= integer;
        data
    }

    pub fn finish(mut self) -> Mesh {
        if !self.mesh.middles.is_empty() {
            self.mesh.middles.resize(self.mesh.tetrahedra.len(), LINEAR);
        }
        let counts = CellUse::KEPT.map(|cell| cell.count(&self.mesh));
        for data in &mut self.mesh.cell_data {
            fill(data, counts);
        }
        for group in &mut self.mesh.groups {
            group.vertices.sort_unstable();
            group.vertices.dedup();
            for members in CellUse::KEPT {
                if let Some(list) = members.members_mut(group) {
                    list.sort_unstable();
                    list.dedup();
                }
            }
        }
        self.mesh
    }
}

/// A number that is missing is no whole number.
fn fill(data: &mut CellData, counts: [usize; 4]) {
    for (cell, count) in CellUse::KEPT.into_iter().zip(counts) {
        data.integer &= cell.values(data).len() == count;
        if let Some(values) = cell.values_mut(data) {
            values.resize(count, f64::NAN);
        }
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
