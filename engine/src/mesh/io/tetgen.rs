//! TetGen meshes: `.node`, `.ele` and optionally `.face` files.

use super::cells::{Builder, CellKind};
use super::scan::{Cursor, Numbering, words};
use crate::mesh::Mesh;
use crate::mesh::error::MeshError;
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
    let mut builder = Builder::new(source);
    let mut groups = HashMap::new();
    let name = format!("{stem}.node");
    let numbering = nodes(&mut Cursor::new(&name, node), &mut builder, &mut groups)?;
    let name = format!("{stem}.ele");
    tetrahedra(&mut Cursor::new(&name, ele), &numbering, &mut builder, &mut groups)?;
    if let Some(face) = face {
        let name = format!("{stem}.face");
        faces(&mut Cursor::new(&name, face), &numbering, &mut builder, &mut groups)?;
    }
    Ok(builder.finish())
}

/// Group positions by dimension and name.
type Groups = HashMap<(u8, String), usize>;

fn group(builder: &mut Builder, groups: &mut Groups, dimension: u8, name: String) -> usize {
    *groups.entry((dimension, name.clone())).or_insert_with(|| builder.group(name, dimension))
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

fn nodes(
    cursor: &mut Cursor<'_>,
    builder: &mut Builder,
    groups: &mut Groups,
) -> Result<Numbering, MeshError> {
    let mut numbering = Numbering::default();
    let head = line(cursor, "the number of nodes")?;
    let count = cursor.count(field(&head, 0), "the number of nodes")?;
    if field(&head, 1) != b"3" {
        return Err(cursor.invalid(field(&head, 1), "dimension 3"));
    }
    let attributes = if head.len() > 2 {
        cursor.count(field(&head, 2), "the number of attributes")?
    } else {
        0
    };
    let markers =
        if head.len() > 3 { cursor.count(field(&head, 3), "the number of markers")? } else { 0 };
    for read in 0..count {
        let fields = line(cursor, &format!("node {} of {count}", read + 1))?;
        let number = cursor.integer(field(&fields, 0), "a node number")?;
        let point = cursor.point(&mut fields.iter().copied().skip(1))?;
        if !numbering.push(number) {
            let (file, place) = (cursor.file.to_owned(), cursor.place());
            return Err(MeshError::RepeatedNumber { file, place, number });
        }
        builder.point(cursor, point, cursor.line)?;
        if markers > 0 {
            let marker = cursor
                .integer(field(&fields, attributes.saturating_add(4)), "a boundary marker")?;
            if marker != 0 {
                let slot = group(builder, groups, 0, format!("marker {marker}"));
                builder.join(None, 0..0, &[(numbering.len() - 1) as u32], &[slot]);
            }
        }
    }
    Ok(numbering)
}

fn vertices(
    cursor: &Cursor<'_>,
    numbering: &Numbering,
    fields: &[&[u8]],
    kind: CellKind,
) -> Result<Vec<u32>, MeshError> {
    let mut vertices = Vec::with_capacity(kind.vertices);
    for i in 0..kind.vertices as u64 {
        let vertex = cursor.integer(field(fields, i + 1), "a node number")?;
        match numbering.index(vertex) {
            Some(index) => vertices.push(index),
            None => {
                return Err(MeshError::UnknownVertex {
                    file: cursor.file.to_owned(),
                    place: cursor.place(),
                    cell: format!("{} {}", kind.name, crate::mesh::error::shown(field(fields, 0))),
                    vertex,
                });
            }
        }
    }
    Ok(vertices)
}

fn tetrahedra(
    cursor: &mut Cursor<'_>,
    numbering: &Numbering,
    builder: &mut Builder,
    groups: &mut Groups,
) -> Result<(), MeshError> {
    let head = line(cursor, "the number of tetrahedra")?;
    let count = cursor.count(field(&head, 0), "the number of tetrahedra")?;
    let kind = match field(&head, 1) {
        b"4" => CellKind::TETRAHEDRON,
        b"10" => CellKind::new("10-node tetrahedron of TetGen", 3, 10),
        other => return Err(cursor.invalid(other, "4 or 10 nodes per tetrahedron")),
    };
    let attributes = if head.len() > 2 {
        cursor.count(field(&head, 2), "the number of attributes")?
    } else {
        0
    };
    for read in 0..count {
        let fields = line(cursor, &format!("tetrahedron {} of {count}", read + 1))?;
        let vertices = vertices(cursor, numbering, &fields, kind)?;
        let mut slot = None;
        if attributes > 0 {
            let region =
                cursor.real(field(&fields, kind.vertices as u64 + 1), "a region attribute")?;
            slot = Some(group(builder, groups, 3, format!("region {region}")));
        }
        builder.cell(kind, &vertices, slot.as_slice(), cursor.line);
    }
    Ok(())
}

fn faces(
    cursor: &mut Cursor<'_>,
    numbering: &Numbering,
    builder: &mut Builder,
    groups: &mut Groups,
) -> Result<(), MeshError> {
    let head = line(cursor, "the number of faces")?;
    let count = cursor.count(field(&head, 0), "the number of faces")?;
    let markers =
        if head.len() > 1 { cursor.count(field(&head, 1), "the number of markers")? } else { 0 };
    for read in 0..count {
        let fields = line(cursor, &format!("face {} of {count}", read + 1))?;
        let vertices = vertices(cursor, numbering, &fields, CellKind::TRIANGLE)?;
        let mut slot = None;
        if markers > 0 {
            let marker = cursor.integer(field(&fields, 4), "a boundary marker")?;
            slot = (marker != 0).then(|| group(builder, groups, 2, format!("marker {marker}")));
        }
        builder.cell(CellKind::TRIANGLE, &vertices, slot.as_slice(), cursor.line);
    }
    Ok(())
}
