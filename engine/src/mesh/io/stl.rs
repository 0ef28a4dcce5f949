//! STL surfaces, text or binary; corners at equal positions become one vertex.

use super::cells::{Builder, CellKind};
use super::grid::Number;
use super::scan::{Cursor, words};
use crate::mesh::Mesh;
use crate::mesh::error::MeshError;
use glam::DVec3;
use std::collections::HashMap;

/// Bytes of a facet in a binary file: normal, three corners, attribute.
const FACET: usize = 50;

/// Whether the length is that of a binary STL file with the announced number of facets.
pub(super) fn is_binary(data: &[u8]) -> bool {
    announced(data).is_some_and(|count| data.len() as u64 == 84 + count * FACET as u64)
}

fn announced(data: &[u8]) -> Option<u64> {
    let bytes = data.get(80..84)?;
    Some(u64::from(u32::from_le_bytes(bytes.try_into().ok()?)))
}

/// Reads an STL file from its bytes; `source` names it in messages.
///
/// # Errors
///
/// Every [`MeshError`] about a file.
pub fn read_stl(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    let mut reader = Reader {
        cursor: Cursor::new(source, data),
        builder: Builder::new(source),
        vertices: HashMap::new(),
    };
    // Some binary files start with `solid` too: the length decides.
    if is_binary(data) || !data.trim_ascii_start().starts_with(b"solid") {
        reader.binary()?;
    } else {
        reader.text()?;
    }
    Ok(reader.builder.finish())
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    builder: Builder,
    vertices: HashMap<[u64; 3], u32>,
}

impl Reader<'_> {
    fn vertex(&mut self, point: DVec3) -> Result<u32, MeshError> {
        // Adding zero turns -0 into 0, so that both are one position.
        let key = (point + DVec3::ZERO).to_array().map(f64::to_bits);
        if let Some(&index) = self.vertices.get(&key) {
            return Ok(index);
        }
        let index = self.builder.mesh.points.len() as u32;
        self.builder.point(&self.cursor, point, 0)?;
        self.vertices.insert(key, index);
        Ok(index)
    }

    fn binary(&mut self) -> Result<(), MeshError> {
        self.cursor.binary = true;
        self.cursor.take(80, "the head of an STL file")?;
        let bytes = self.cursor.take(4, "the number of facets")?;
        let count = bytes.iter().rev().fold(0u64, |n, &b| n << 8 | u64::from(b));
        let needed = count * FACET as u64;
        if needed > self.cursor.remaining().len() as u64 {
            return Err(self.cursor.end(&format!("{count} facets")));
        }
        for _ in 0..count {
            let facet = self.cursor.take(FACET, "a facet")?;
            let values = Number::Real(4).reals(&facet[12..48], false);
            let mut corners = [0; 3];
            for (corner, point) in corners.iter_mut().zip(values.chunks_exact(3)) {
                *corner = self.vertex(DVec3::from_slice(point))?;
            }
            self.builder.cell(CellKind::TRIANGLE, &corners, &[], 0);
        }
        Ok(())
    }

    fn text(&mut self) -> Result<(), MeshError> {
        let mut group: Option<usize> = None;
        let mut names: HashMap<String, usize> = HashMap::new();
        let mut corners = Vec::new();
        let mut open = false;
        while let Some(line) = self.cursor.filled_line() {
            let mut fields = words(line);
            match fields.next().unwrap_or(b"") {
                b"solid" => {
                    open = true;
                    let name = line.strip_prefix(b"solid").unwrap_or(b"").trim_ascii();
                    let name = super::scan::name(name);
                    let builder = &mut self.builder;
                    group = (!name.is_empty()).then(|| {
                        *names.entry(name.clone()).or_insert_with(|| builder.group(name, 2))
                    });
                }
                b"facet" | b"outer" | b"endloop" => {}
                b"vertex" => {
                    let point = self.cursor.point(&mut fields)?;
                    corners.push(self.vertex(point)?);
                }
                b"endfacet" => {
                    if corners.len() != 3 {
                        let found = corners.len() as u64;
                        return Err(self.cursor.mismatch(
                            "the number of corners of a facet",
                            3,
                            found,
                        ));
                    }
                    let line = self.cursor.line;
                    self.builder.cell(CellKind::TRIANGLE, &corners, group.as_slice(), line);
                    corners.clear();
                }
                b"endsolid" => open = false,
                other => {
                    return Err(self.cursor.invalid(other, "facet, vertex or another STL keyword"));
                }
            }
        }
        if open { Err(self.cursor.end("endsolid")) } else { Ok(()) }
    }
}
