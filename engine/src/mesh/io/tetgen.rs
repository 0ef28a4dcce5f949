//! TetGen meshes: `.node`, `.ele` and optionally `.face` files.

use super::cells::{Builder, CellKind};
use super::scan::{Cursor, Numbering, words};
use crate::mesh::Mesh;
use crate::mesh::error::{FileProblem, MeshError, shown};
use std::collections::HashMap;

/// Reads a TetGen mesh from the bytes of its files; `source` names it in messages.
///
/// Vertices may be numbered from 0 or 1 or anything else. Boundary markers other than 0 become groups
/// `marker 3` of vertices and of faces, the first attribute of a tetrahedron a group `region 3`.
/// Ten-node tetrahedra are skipped and counted.
///
/// # Errors
///
/// Every [`MeshError`] about a file; the file is named by `source` and its extension.
pub fn read_tetgen(
    node: &[u8],
    ele: &[u8],
    face: Option<&[u8]>,
    source: &str,
) -> Result<Mesh, MeshError> {
    let stem = source.strip_suffix(".node").or(source.strip_suffix(".ele")).unwrap_or(source);
    let mut reader = Reader {
        builder: Builder::new(source),
        groups: HashMap::new(),
        numbering: Numbering::default(),
    };
    reader.nodes(&mut Cursor::new(&format!("{stem}.node"), node))?;
    reader.tetrahedra(&mut Cursor::new(&format!("{stem}.ele"), ele))?;
    if let Some(face) = face {
        reader.faces(&mut Cursor::new(&format!("{stem}.face"), face))?;
    }
    Ok(reader.builder.finish())
}

/// The next line that holds more than a comment, without the comment.
fn line<'a>(cursor: &mut Cursor<'a>, expected: &str) -> Result<Vec<&'a [u8]>, MeshError> {
    loop {
        let line = cursor.expect_line(expected)?;
        let content = line.split(|&b| b == b'#').next().unwrap_or(b"");
        let fields: Vec<&[u8]> = words(content).collect();
        if !fields.is_empty() {
            return Ok(fields);
        }
    }
}

fn field<'a>(fields: &[&'a [u8]], index: u64) -> &'a [u8] {
    usize::try_from(index).ok().and_then(|i| fields.get(i)).copied().unwrap_or(b"")
}

/// A count in the head of a file, 0 where it is left out.
fn count(cursor: &Cursor<'_>, head: &[&[u8]], index: u64, what: &str) -> Result<u64, MeshError> {
    match field(head, index) {
        b"" => Ok(0),
        word => cursor.count(word, what),
    }
}

struct Reader {
    builder: Builder,
    /// Group positions by dimension and name.
    groups: HashMap<(u8, String), usize>,
    numbering: Numbering,
}

impl Reader {
    fn group(&mut self, dimension: u8, name: String) -> usize {
        let builder = &mut self.builder;
        let new = || builder.group(name.clone(), dimension);
        *self.groups.entry((dimension, name.clone())).or_insert_with(new)
    }

    fn nodes(&mut self, cursor: &mut Cursor<'_>) -> Result<(), MeshError> {
        let head = line(cursor, "the number of nodes")?;
        let nodes = cursor.count(field(&head, 0), "the number of nodes")?;
        if field(&head, 1) != b"3" {
            return Err(cursor.invalid(field(&head, 1), "dimension 3"));
        }
        let attributes = count(cursor, &head, 2, "the number of attributes")?;
        let markers = count(cursor, &head, 3, "the number of markers")?;
        for read in 0..nodes {
            let fields = line(cursor, &format!("node {} of {nodes}", read + 1))?;
            let number = cursor.integer(field(&fields, 0), "a node number")?;
            let point = cursor.point(&mut fields.iter().copied().skip(1))?;
            if !self.numbering.push(number) {
                return Err(cursor.error(FileProblem::RepeatedNumber { number }));
            }
            self.builder.point(cursor, point, cursor.line)?;
            if markers > 0 {
                let marker = field(&fields, attributes.saturating_add(4));
                let marker = cursor.integer(marker, "a boundary marker")?;
                if marker != 0 {
                    let slot = self.group(0, format!("marker {marker}"));
                    let vertex = (self.numbering.len() - 1) as u32;
                    self.builder.join(None, 0..0, &[vertex], &[slot]);
                }
            }
        }
        Ok(())
    }

    fn vertices(
        &self,
        cursor: &Cursor<'_>,
        fields: &[&[u8]],
        kind: CellKind,
    ) -> Result<Vec<u32>, MeshError> {
        let vertex = |i| {
            let vertex = cursor.integer(field(fields, i + 1), "a node number")?;
            self.numbering.index(vertex).ok_or_else(|| {
                let cell = format!("{} {}", kind.name, shown(field(fields, 0)));
                cursor.error(FileProblem::UnknownVertex { cell, vertex })
            })
        };
        (0..kind.vertices as u64).map(vertex).collect()
    }

    fn tetrahedra(&mut self, cursor: &mut Cursor<'_>) -> Result<(), MeshError> {
        let head = line(cursor, "the number of tetrahedra")?;
        let tetrahedra = cursor.count(field(&head, 0), "the number of tetrahedra")?;
        let kind = match field(&head, 1) {
            b"4" => CellKind::TETRAHEDRON,
            b"10" => CellKind::new("10-node tetrahedron of TetGen", 3, 10),
            other => return Err(cursor.invalid(other, "4 or 10 nodes per tetrahedron")),
        };
        let attributes = count(cursor, &head, 2, "the number of attributes")?;
        for read in 0..tetrahedra {
            let fields = line(cursor, &format!("tetrahedron {} of {tetrahedra}", read + 1))?;
            let vertices = self.vertices(cursor, &fields, kind)?;
            let mut slot = None;
            if attributes > 0 {
                let region = field(&fields, kind.vertices as u64 + 1);
                let region = cursor.real(region, "a region attribute")?;
                slot = Some(self.group(3, format!("region {region}")));
            }
            self.builder.cell(kind, &vertices, slot.as_slice(), cursor.line);
        }
        Ok(())
    }

    fn faces(&mut self, cursor: &mut Cursor<'_>) -> Result<(), MeshError> {
        let head = line(cursor, "the number of faces")?;
        let faces = cursor.count(field(&head, 0), "the number of faces")?;
        let markers = count(cursor, &head, 1, "the number of markers")?;
        for read in 0..faces {
            let fields = line(cursor, &format!("face {} of {faces}", read + 1))?;
            let vertices = self.vertices(cursor, &fields, CellKind::TRIANGLE)?;
            let mut slot = None;
            if markers > 0 {
                let marker = cursor.integer(field(&fields, 4), "a boundary marker")?;
                slot = (marker != 0).then(|| self.group(2, format!("marker {marker}")));
            }
            self.builder.cell(CellKind::TRIANGLE, &vertices, slot.as_slice(), cursor.line);
        }
        Ok(())
    }
}
