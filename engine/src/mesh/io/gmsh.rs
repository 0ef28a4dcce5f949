//! Gmsh MSH files: versions 1, 2 and 4.1, text or binary of either byte order.
//!
//! The published readers of this format know one version each, give no line numbers, or make room for
//! counts before they have seen the data, so the format is read here.

mod blocks;
mod write;

pub use write::{encode_gmsh, write_gmsh};

use super::cells::{Builder, CellKind, component_names, too_many};
use super::scan::{Cursor, Numbering, parse, words};
use crate::element_kind::ElementKind;
use crate::mesh::Mesh;
use crate::mesh::error::{FileProblem, MeshError, shown};
use glam::DVec3;
use std::collections::HashMap;
use std::ops::Range;

/// Gmsh lists the last two edges of a ten-node tetrahedron the other way round.
fn in_order_of_vtk(kind: CellKind, vertices: &mut [u32]) {
    if kind == CellKind::TETRAHEDRON10
        && let [.., y, z] = vertices
    {
        std::mem::swap(y, z);
    }
}

/// Cells of the format by type number.
fn cell_kind(number: i64) -> Option<CellKind> {
    let kind = CellKind::new;
    Some(match number {
        1 => kind("2-node line", 1, 2),
        2 => CellKind::TRIANGLE,
        3 => CellKind::QUAD,
        4 => CellKind::TETRAHEDRON,
        5 => CellKind::HEXAHEDRON,
        6 => kind("6-node prism", 3, 6),
        7 => kind("5-node pyramid", 3, 5),
        8 => kind("3-node line", 1, 3),
        9 => CellKind::TRIANGLE6,
        10 => kind("9-node quadrilateral", 2, 9),
        11 => CellKind::TETRAHEDRON10,
        12 => kind("27-node hexahedron", 3, 27),
        13 => kind("18-node prism", 3, 18),
        14 => kind("14-node pyramid", 3, 14),
        15 => kind("point", 0, 1),
        16 => kind("8-node quadrilateral", 2, 8),
        17 => kind("20-node hexahedron", 3, 20),
        18 => kind("15-node prism", 3, 15),
        19 => kind("13-node pyramid", 3, 13),
        20 => kind("9-node triangle", 2, 9),
        21 => kind("10-node triangle", 2, 10),
        22 => kind("12-node triangle", 2, 12),
        23 | 24 => kind("15-node triangle", 2, 15),
        25 => kind("21-node triangle", 2, 21),
        26 => kind("4-node line", 1, 4),
        27 => kind("5-node line", 1, 5),
        28 => kind("6-node line", 1, 6),
        29 => kind("20-node tetrahedron", 3, 20),
        30 => kind("35-node tetrahedron", 3, 35),
        31 => kind("56-node tetrahedron", 3, 56),
        92 => kind("64-node hexahedron", 3, 64),
        93 => kind("125-node hexahedron", 3, 125),
        _ => return None,
    })
}

/// A cell of a type outside the table; its line is read past.
const UNKNOWN_KIND: CellKind = CellKind::new("cell of a type unknown to this reader", 4, 0);

const SAVE_AGAIN: &str = "save the mesh from Gmsh as version 2.2 or 4.1 (Mesh.MshFileVersion)";

#[derive(Clone, Copy, PartialEq, Eq)]
enum Version {
    One,
    Two,
    FourOne,
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    version: Version,
    /// Integers and reals of a binary file are most significant byte first.
    big_endian: bool,
    /// Width in bytes of a binary count.
    size_width: usize,
    numbering: Numbering,
    builder: Builder,
    names: HashMap<(u8, i64), String>,
    /// Physical tags of each geometric entity (4.1).
    entities: HashMap<(u8, i64), Vec<i64>>,
    /// Group positions by dimension and physical tag.
    groups: HashMap<(u8, i64), usize>,
    /// Used cells of version 2 by vertices and geometric entity: position and first physical tag.
    seen: HashMap<([u32; 10], i64), (usize, i64)>,
    vertices: Vec<u32>,
    /// Used cells by element number.
    elements: HashMap<i64, (ElementKind, Range<usize>)>,
    has_nodes: bool,
    has_elements: bool,
}

/// Reads a Gmsh file from its bytes; `source` names it in messages.
///
/// Physical groups keep their names, unnamed ones get their tag number. An element that version 2
/// lists once per group becomes one cell in several groups.
///
/// # Errors
///
/// Every [`MeshError`] about a file.
pub fn read_gmsh(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    let mut reader = Reader {
        cursor: Cursor::new(source, data),
        version: Version::One,
        big_endian: false,
        size_width: 8,
        numbering: Numbering::default(),
        builder: Builder::new(source),
        names: HashMap::new(),
        entities: HashMap::new(),
        groups: HashMap::new(),
        seen: HashMap::new(),
        vertices: Vec::new(),
        elements: HashMap::new(),
        has_nodes: false,
        has_elements: false,
    };
    reader.sections()?;
    if !reader.has_nodes {
        return Err(reader.cursor.missing("a $Nodes section"));
    }
    if !reader.has_elements {
        return Err(reader.cursor.missing("an $Elements section"));
    }
    Ok(reader.finish())
}

impl<'a> Reader<'a> {
    fn sections(&mut self) -> Result<(), MeshError> {
        let mut first = true;
        while let Some(line) = self.cursor.filled_line() {
            match line {
                b"$MeshFormat" => self.format()?,
                b"$Comments" => self.skip(line)?,
                b"$NOD" if first => {
                    self.nodes_by_line(b"$ENDNOD")?;
                    first = false;
                    continue;
                }
                _ if first => {
                    return Err(self
                        .cursor
                        .invalid(line, "$MeshFormat or $NOD, the start of a Gmsh file"));
                }
                b"$PhysicalNames" => self.physical_names()?,
                b"$ELM" if self.version == Version::One => self.elements_by_line(b"$ENDELM")?,
                b"$Entities" if self.version == Version::FourOne => self.entities()?,
                b"$PartitionedEntities" => {
                    let feature = "a partitioned mesh".to_owned();
                    return Err(self.cursor.unsupported(feature, "save it without partitions"));
                }
                b"$ParametricNodes" => {
                    let feature = "$ParametricNodes".to_owned();
                    return Err(self
                        .cursor
                        .unsupported(feature, "save it without parametric coordinates"));
                }
                b"$Nodes" => match (self.version, self.cursor.binary) {
                    (Version::FourOne, _) => self.nodes_by_block()?,
                    (_, true) => self.nodes_binary()?,
                    (_, false) => self.nodes_by_line(b"$EndNodes")?,
                },
                b"$Elements" => match (self.version, self.cursor.binary) {
                    (Version::FourOne, _) => self.elements_by_block()?,
                    (_, true) => self.elements_binary()?,
                    (_, false) => self.elements_by_line(b"$EndElements")?,
                },
                b"$ElementData" => self.element_data()?,
                [b'$', ..] => self.skip(line)?,
                _ => {
                    return Err(self.cursor.invalid(line, "the start of a section such as $Nodes"));
                }
            }
            first &= line == b"$Comments";
        }
        Ok(())
    }

    fn format(&mut self) -> Result<(), MeshError> {
        let line = self.cursor.expect_line("the format line after $MeshFormat")?;
        let mut fields = words(line);
        let version = fields.next().unwrap_or(b"");
        self.version = match version {
            b"2" | b"2.0" | b"2.1" | b"2.2" => Version::Two,
            b"4.1" => Version::FourOne,
            _ if parse::<f64>(version).is_some() => {
                let feature = format!("Gmsh format version {}", shown(version));
                return Err(self.cursor.unsupported(feature, SAVE_AGAIN));
            }
            _ => return Err(self.cursor.invalid(version, "the version of the Gmsh format")),
        };
        let mode = fields.next().unwrap_or(b"");
        let binary = match mode {
            b"0" => false,
            b"1" => true,
            _ => return Err(self.cursor.invalid(mode, "file type 0 (text) or 1 (binary)")),
        };
        let width = fields.next().unwrap_or(b"");
        self.size_width = match (width, self.version) {
            (b"8", _) => 8,
            (b"4", Version::FourOne) => 4,
            _ => return Err(self.cursor.invalid(width, "data size 8")),
        };
        if binary {
            self.cursor.binary = true;
            let one = self.cursor.take(4, "the number 1 that tells the byte order")?;
            self.big_endian = match one {
                [1, 0, 0, 0] => false,
                [0, 0, 0, 1] => true,
                _ => {
                    return Err(self.cursor.invalid(one, "the number 1 that tells the byte order"));
                }
            };
        }
        self.expect_end(b"$EndMeshFormat", "the format line", 1)
    }

    /// The next line must close the section; otherwise the announced count was too small.
    fn expect_end(&mut self, end: &[u8], what: &str, count: u64) -> Result<(), MeshError> {
        let expected = format!("{} after {count} {what}", shown(end));
        let line = self.cursor.expect_line(&expected)?;
        if line == end { Ok(()) } else { Err(self.cursor.invalid(line, &expected)) }
    }

    /// The line after `read` of `count` that a section lists, one for each of `what`.
    fn listed(&mut self, what: &str, count: u64, read: u64) -> Result<&'a [u8], MeshError> {
        match self.cursor.filled_line() {
            None => Err(self.cursor.end(&format!("{what} {} of {count}", read + 1))),
            Some(line) if line.starts_with(b"$") => {
                Err(self.cursor.mismatch(&format!("the number of {what}s"), count, read))
            }
            Some(line) => Ok(line),
        }
    }

    /// The count that a section begins with.
    fn announced(&mut self, what: &str) -> Result<u64, MeshError> {
        let line = self.cursor.expect_line(what)?;
        self.cursor.count(line, what)
    }

    /// Moves behind the end of a section that is of no use here.
    fn skip(&mut self, start: &[u8]) -> Result<(), MeshError> {
        let name = start.strip_prefix(b"$").unwrap_or(start);
        let mut end = b"$End".to_vec();
        end.extend_from_slice(name);
        let rest = self.cursor.remaining();
        // Only a `$` can start the end mark, which keeps the search linear in practice.
        let found = memchr_positions(rest, b'$').find(|&at| rest[at..].starts_with(&end));
        let Some(at) = found else {
            return Err(self.cursor.end(&shown(&end)));
        };
        self.cursor.skip_counting(at);
        self.cursor.next_line();
        Ok(())
    }

    fn physical_names(&mut self) -> Result<(), MeshError> {
        let count = self.announced("the number of physical names")?;
        for read in 0..count {
            let expected = format!("physical name {} of {count}", read + 1);
            let line = self.cursor.expect_line(&expected)?;
            if line.starts_with(b"$End") {
                return Err(self.cursor.mismatch("the number of physical names", count, read));
            }
            let mut fields = line.splitn(3, u8::is_ascii_whitespace);
            let dimension = fields.next().unwrap_or(b"");
            let Some(dimension) = parse::<u8>(dimension).filter(|&d| d <= 3) else {
                return Err(self
                    .cursor
                    .invalid(line, "a physical name: dimension 0 to 3, tag, name"));
            };
            let tag =
                self.cursor.integer(fields.next().unwrap_or(b""), "the tag of a physical name")?;
            let name = fields.next().unwrap_or(b"").trim_ascii();
            let name = name.strip_prefix(b"\"").unwrap_or(name);
            let name = name.strip_suffix(b"\"").unwrap_or(name);
            self.names.insert((dimension, tag), super::scan::name(name));
            // A name without cells is a group too, an empty one.
            self.group(dimension, tag);
        }
        self.expect_end(b"$EndPhysicalNames", "physical names", count)
    }

    fn group(&mut self, dimension: u8, tag: i64) -> usize {
        let builder = &mut self.builder;
        *self
            .groups
            .entry((dimension, tag))
            .or_insert_with(|| builder.group(tag.to_string(), dimension))
    }

    fn add_node(&mut self, number: i64, point: DVec3, line: usize) -> Result<(), MeshError> {
        if !self.numbering.push(number) {
            return Err(self.cursor.error(FileProblem::RepeatedNumber { number }));
        }
        self.builder.point(&self.cursor, point, line)
    }

    fn nodes_by_line(&mut self, end: &[u8]) -> Result<(), MeshError> {
        self.has_nodes = true;
        let count = self.announced("the number of nodes")?;
        for read in 0..count {
            let line = self.listed("node", count, read)?;
            let mut fields = words(line);
            let number = self.cursor.integer(fields.next().unwrap_or(b""), "a node number")?;
            let point = self.cursor.point(&mut fields)?;
            self.add_node(number, point, self.cursor.line)?;
        }
        self.expect_end(end, "nodes", count)
    }

    /// Elements of version 1 (`number type physical elementary n nodes`) and 2
    /// (`number type n tags nodes`).
    fn elements_by_line(&mut self, end: &[u8]) -> Result<(), MeshError> {
        self.has_elements = true;
        let count = self.announced("the number of elements")?;
        let mut fields: Vec<&[u8]> = Vec::new();
        for read in 0..count {
            let line = self.listed("element", count, read)?;
            fields.clear();
            fields.extend(words(line));
            let field = |i: usize| fields.get(i).copied().unwrap_or(b"");
            let number = self.cursor.integer(field(0), "an element number")?;
            let kind = self.cursor.integer(field(1), "an element type")?;
            let (physical, elementary, nodes) = if self.version == Version::One {
                (
                    self.cursor.integer(field(2), "a physical tag")?,
                    self.cursor.integer(field(3), "a geometric tag")?,
                    fields.get(5..).unwrap_or(&[]),
                )
            } else {
                let tags = self.cursor.count(field(2), "the number of tags")?;
                let integer = |i: u64| match i {
                    i if i <= tags => self.cursor.integer(field(2 + i as usize), "a tag"),
                    _ => Ok(0),
                };
                let nodes =
                    usize::try_from(tags).ok().and_then(|tags| fields.get(tags.checked_add(3)?..));
                (integer(1)?, integer(2)?, nodes.unwrap_or(&[]))
            };
            let kind = cell_kind(kind).unwrap_or(UNKNOWN_KIND);
            let expected = kind.vertices as u64;
            if expected > 0 && nodes.len() as u64 != expected {
                let what = format!("the number of nodes of element {number} ({})", kind.name);
                return Err(self.cursor.mismatch(&what, expected, nodes.len() as u64));
            }
            self.vertices.clear();
            if expected > 0 {
                for &node in nodes {
                    let node = self.cursor.integer(node, "a node number")?;
                    self.push_vertex(node, kind, number)?;
                }
            }
            self.add_cell(kind, number, [physical, elementary], self.cursor.line)?;
        }
        self.expect_end(end, "elements", count)
    }

    fn push_vertex(&mut self, node: i64, kind: CellKind, element: i64) -> Result<(), MeshError> {
        let Some(index) = self.numbering.index(node) else {
            let cell = format!("element {element} ({})", kind.name);
            return Err(self.cursor.error(FileProblem::UnknownVertex { cell, vertex: node }));
        };
        self.vertices.push(index);
        Ok(())
    }

    /// Adds the cell whose vertices were collected, as version 1 and 2 describe it.
    fn add_cell(
        &mut self,
        kind: CellKind,
        number: i64,
        [physical, elementary]: [i64; 2],
        line: usize,
    ) -> Result<(), MeshError> {
        let mut vertices = std::mem::take(&mut self.vertices);
        in_order_of_vtk(kind, &mut vertices);
        let slot = match physical {
            0 => None,
            tag => Some(self.group(kind.dimension.min(3), tag.saturating_abs())),
        };
        let groups = slot.as_slice();
        let cell = kind.used_as();
        let next = cell.map_or(0, |cell| self.builder.mesh.count(cell));
        if next >= u32::MAX as usize {
            return Err(too_many(self.cursor.file, "cells", next as u64 + 1));
        }
        // An element in several groups stands in the file once for each of them.
        let mut known = None;
        if cell.is_some() && physical != 0 && self.version == Version::Two {
            let mut key = [u32::MAX; 10];
            key[..vertices.len()].copy_from_slice(&vertices);
            let &mut (index, first) =
                self.seen.entry((key, elementary)).or_insert((next, physical));
            known = (first != physical).then_some(index);
        }
        if let Some(cell) = cell {
            let first = known.unwrap_or(next);
            self.elements.insert(number, (cell, first..first + kind.parts()));
        }
        match known {
            Some(index) => {
                self.builder.join(cell, index..index + kind.parts(), &vertices, groups);
            }
            None if kind == UNKNOWN_KIND => self.builder.cell(kind, &[], groups, 0),
            None => self.builder.cell(kind, &vertices, groups, line),
        }
        self.vertices = vertices;
        Ok(())
    }

    fn int(&mut self, expected: &str) -> Result<i64, MeshError> {
        let bytes = self.cursor.take(4, expected)?;
        let bytes = <[u8; 4]>::try_from(bytes).unwrap_or_default();
        let value =
            if self.big_endian { i32::from_be_bytes(bytes) } else { i32::from_le_bytes(bytes) };
        Ok(i64::from(value))
    }

    fn size(&mut self, expected: &str) -> Result<u64, MeshError> {
        let mut wide = [0; 8];
        let bytes = self.cursor.take(self.size_width, expected)?;
        if self.big_endian {
            wide[8 - bytes.len()..].copy_from_slice(bytes);
            Ok(u64::from_be_bytes(wide))
        } else {
            wide[..bytes.len()].copy_from_slice(bytes);
            Ok(u64::from_le_bytes(wide))
        }
    }

    fn tag(&mut self, expected: &str) -> Result<i64, MeshError> {
        let value = self.size(expected)?;
        i64::try_from(value)
            .map_err(|_| self.cursor.invalid(value.to_string().as_bytes(), expected))
    }

    fn double(&mut self) -> Result<f64, MeshError> {
        let bytes = self.cursor.take(8, "a coordinate")?;
        let bytes = <[u8; 8]>::try_from(bytes).unwrap_or_default();
        Ok(if self.big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
    }

    fn binary_point(&mut self) -> Result<DVec3, MeshError> {
        Ok(DVec3::new(self.double()?, self.double()?, self.double()?))
    }

    fn nodes_binary(&mut self) -> Result<(), MeshError> {
        self.has_nodes = true;
        let count = self.announced("the number of nodes")?;
        self.cursor.room_for(count, 28, "nodes")?;
        for _ in 0..count {
            let number = self.int("a node number")?;
            let point = self.binary_point()?;
            self.add_node(number, point, 0)?;
        }
        self.expect_end(b"$EndNodes", "nodes", count)
    }

    fn elements_binary(&mut self) -> Result<(), MeshError> {
        self.has_elements = true;
        let count = self.announced("the number of elements")?;
        let mut read = 0;
        while read < count {
            let kind = self.int("an element type")?;
            let here = self.int("the number of elements in a block")?;
            let tags = self.int("the number of tags")?;
            let Some(kind) = cell_kind(kind) else {
                let feature = format!("element type {kind}");
                return Err(self.cursor.unsupported(feature, SAVE_AGAIN));
            };
            let here = match u64::try_from(here) {
                Ok(here) if here > 0 && here <= count - read => here,
                _ => {
                    let found = here.to_string();
                    return Err(self
                        .cursor
                        .invalid(found.as_bytes(), "the number of elements in a block"));
                }
            };
            let Ok(tags) = u64::try_from(tags) else {
                return Err(self.cursor.invalid(tags.to_string().as_bytes(), "the number of tags"));
            };
            let width = 4 * (1 + tags + kind.vertices as u64);
            self.cursor.room_for(here, width, "elements")?;
            for _ in 0..here {
                let number = self.int("an element number")?;
                let mut group = [0; 2];
                for i in 0..tags as usize {
                    let tag = self.int("a tag")?;
                    if let Some(slot) = group.get_mut(i) {
                        *slot = tag;
                    }
                }
                self.vertices.clear();
                for _ in 0..kind.vertices {
                    let node = self.int("a node number")?;
                    self.push_vertex(node, kind, number)?;
                }
                self.add_cell(kind, number, group, 0)?;
            }
            read += here;
        }
        self.expect_end(b"$EndElements", "elements", count)
    }

    /// One number or three for each element of a list; other numbers of components are read past.
    fn element_data(&mut self) -> Result<(), MeshError> {
        let mut tags: [Vec<&[u8]>; 3] = Default::default();
        for (of_kind, what) in tags.iter_mut().zip(["names", "real tags", "integer tags"]) {
            let expected = format!("the number of {what} of $ElementData");
            let count = self.announced(&expected)?;
            for _ in 0..count {
                of_kind.push(self.cursor.expect_line(what)?);
            }
        }
        let integer = |i: usize| tags[2].get(i).copied().unwrap_or(b"");
        let components = self.cursor.count(integer(1), "the number of components")?;
        let count = self.cursor.count(integer(2), "the number of values")?;
        let name = super::scan::name(tags[0].first().copied().unwrap_or(b""));
        let name = name.trim().trim_matches('"').to_owned();
        let names = match components {
            1 => vec![name],
            3 => component_names(&name).to_vec(),
            _ => return self.skip(b"$ElementData"),
        };
        if self.cursor.binary {
            self.cursor.room_for(count, 4 + 8 * components, "values of elements")?;
        }
        let mut places = Vec::with_capacity(names.len());
        for name in &names {
            self.builder.data(name, false);
            places.push(self.builder.mesh.cell_data.iter().position(|data| data.name == *name));
        }
        let mut values = Vec::with_capacity(names.len());
        for read in 0..count {
            values.clear();
            let number;
            if self.cursor.binary {
                number = self.int("an element number")?;
                for _ in &names {
                    values.push(self.double()?);
                }
            } else {
                let mut fields = words(self.listed("value", count, read)?);
                number = self.cursor.integer(fields.next().unwrap_or(b""), "an element number")?;
                for _ in &names {
                    values.push(self.cursor.real(fields.next().unwrap_or(b""), "a value")?);
                }
            }
            let Some((cell, cells)) = self.elements.get(&number).cloned() else { continue };
            for (place, &value) in places.iter().zip(&values) {
                let data = place.and_then(|place| self.builder.mesh.cell_data.get_mut(place));
                let slots = data.and_then(|data| data.values[cell].get_mut(cells.clone()));
                if let Some(slots) = slots {
                    slots.fill(value);
                }
            }
        }
        self.expect_end(b"$EndElementData", "values", count)
    }

    /// Names the groups and puts them in order of dimension and tag.
    fn finish(mut self) -> Mesh {
        let mut order: Vec<((u8, i64), usize)> = self.groups.into_iter().collect();
        order.sort_unstable();
        let groups = order
            .into_iter()
            .map(|(key, slot)| {
                let mut group = std::mem::take(&mut self.builder.mesh.groups[slot]);
                if let Some(name) = self.names.remove(&key).filter(|name| !name.is_empty()) {
                    group.name = name;
                }
                group
            })
            .collect();
        self.builder.mesh.groups = groups;
        self.builder.finish()
    }
}

/// Positions of a byte in a slice.
fn memchr_positions(data: &[u8], byte: u8) -> impl Iterator<Item = usize> {
    data.iter().enumerate().filter_map(move |(i, &b)| (b == byte).then_some(i))
}
