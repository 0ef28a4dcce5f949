//! Wavefront OBJ surfaces.

use super::cells::{Builder, CellKind};
use super::scan::{Cursor, parse, words};
use crate::mesh::Mesh;
use crate::mesh::error::{FileProblem, MeshError};
use std::collections::HashMap;

/// Reads an OBJ file from its bytes; `source` names it in messages.
///
/// Triangles and quadrilaterals are kept, larger polygons and lines skipped and counted; `g` and `o` names become groups.
///
/// # Errors
///
/// Every [`MeshError`] about a file.
pub fn read_obj(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    let mut cursor = Cursor::new(source, data);
    let mut builder = Builder::new(source);
    let mut names: HashMap<String, usize> = HashMap::new();
    let mut groups: Vec<usize> = Vec::new();
    let mut vertices = Vec::new();
    while let Some(line) = cursor.filled_line() {
        let mut fields = words(line);
        match fields.next().unwrap_or(b"") {
            b"v" => {
                let point = cursor.point(&mut fields)?;
                builder.point(&cursor, point, cursor.line)?;
            }
            keyword @ (b"f" | b"l" | b"p") => {
                vertices.clear();
                for field in fields {
                    vertices.push(vertex(&cursor, field, builder.mesh.points.len())?);
                }
                let kind = match (keyword, vertices.len()) {
                    (b"f", 3) => CellKind::TRIANGLE,
                    (b"f", 0..3) => {
                        let found = vertices.len() as u64;
                        return Err(cursor.mismatch(
                            "the number of corners of a face, at least",
                            3,
                            found,
                        ));
                    }
                    (b"f", 4) => CellKind::QUAD,
                    (b"f", _) => CellKind::new("polygon", 2, 0),
                    (b"l", _) => CellKind::new("line strip", 1, 0),
                    _ => CellKind::new("point", 0, 1),
                };
                builder.cell(kind, &vertices, &groups, cursor.line);
            }
            b"g" | b"o" => {
                groups.clear();
                // More names at once than any program writes would let memory grow with their product.
                for name in fields.take(16) {
                    let name = super::scan::name(name);
                    let slot = *names.entry(name.clone()).or_insert_with(|| builder.group(name, 2));
                    if !groups.contains(&slot) {
                        groups.push(slot);
                    }
                }
            }
            [b'#', ..]
            | b"vn"
            | b"vt"
            | b"vp"
            | b"s"
            | b"mtllib"
            | b"usemtl"
            | b"mg"
            | b"usemap"
            | b"lod"
            | b"maplib"
            | b"bevel"
            | b"c_interp"
            | b"d_interp"
            | b"shadow_obj"
            | b"trace_obj" => {}
            other => return Err(cursor.invalid(other, "an OBJ keyword such as v or f")),
        }
    }
    if builder.mesh.points.is_empty() {
        return Err(cursor.missing("a vertex (`v x y z`)"));
    }
    Ok(builder.finish())
}

/// The vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, counted from 1 or from the end.
fn vertex(cursor: &Cursor<'_>, corner: &[u8], n_points: usize) -> Result<u32, MeshError> {
    let first = corner.split(|&b| b == b'/').next().unwrap_or(b"");
    let number: i64 = parse(first).ok_or_else(|| cursor.invalid(corner, "a vertex number"))?;
    let index = if number > 0 { number - 1 } else { number.saturating_add(n_points as i64) };
    match u32::try_from(index) {
        Ok(index) if number != 0 && (index as usize) < n_points => Ok(index),
        _ => {
            let cell = "a face, line or point".to_owned();
            Err(cursor.error(FileProblem::UnknownVertex { cell, vertex: number }))
        }
    }
}
