//! VTK XML unstructured grids (`.vtu`) and their time series (`.pvd`).
//!
//! Reads text arrays, inline base64, and appended raw or base64 data, plain or zlib-compressed; writes
//! appended raw data.

use super::grid::{
    self, Assembly, Located, Number, Piece, array_name, cell_mask, group_name, mask,
};
use super::scan::{Cursor, line_at, parse, words};
use crate::mesh::error::{MeshError, Place, shown};
use crate::mesh::{CellData, Group, Mesh};
use glam::DVec3;
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use std::cell::Cell;
use std::fmt::Write as _;
use std::io::Read as _;
use std::path::Path;

/// Reads a VTU file from its bytes; `source` names it in messages.
///
/// # Errors
///
/// Every [`MeshError`] about a file.
pub fn read_vtu(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    let head_end = find(data, b"<AppendedData").unwrap_or(data.len());
    let mut reader = Reader {
        source,
        data,
        head: &data[..head_end],
        big_endian: false,
        wide: false,
        zlib: false,
        appended: None,
        budget: Cell::new(0),
    };
    reader.find_appended(head_end)?;
    reader.read()
}

fn find(data: &[u8], pattern: &[u8]) -> Option<usize> {
    data.windows(pattern.len()).position(|window| window == pattern)
}

struct Reader<'a> {
    source: &'a str,
    data: &'a [u8],
    /// The part before the appended data, which alone is XML throughout.
    head: &'a [u8],
    big_endian: bool,
    /// Headers of binary arrays are 64-bit integers.
    wide: bool,
    zlib: bool,
    /// Start of the appended data, and whether they are base64.
    appended: Option<(usize, bool)>,
    /// Bytes that arrays may still unpack to; arrays that share stored data would otherwise multiply it.
    budget: Cell<u64>,
}

/// A `DataArray` element.
struct Array<'a> {
    name: String,
    /// Holds three numbers per entity.
    vector: bool,
    number: Number,
    format: String,
    offset: Option<usize>,
    /// Text between the tags, and where it starts in the file.
    text: &'a [u8],
    start: usize,
    place: Place,
}

/// Part of the file in which an array stands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    None,
    Points,
    Cells,
    PointData,
    CellData,
}

/// A `Piece` in the making.
struct Draft {
    place: Place,
    counts: [u64; 2],
    points: Option<Located<f64>>,
    connectivity: Option<Located<i64>>,
    ends: Option<Located<i64>>,
    types: Option<Located<i64>>,
    point_arrays: Vec<(String, grid::Array)>,
    cell_arrays: Vec<(String, grid::Array)>,
}

impl<'a> Reader<'a> {
    fn line(&self, position: usize) -> Place {
        Place::Line(line_at(self.data, position))
    }

    fn invalid(&self, place: Place, found: &[u8], expected: &str) -> MeshError {
        let (file, found) = (self.source.to_owned(), shown(found));
        MeshError::InvalidValue { file, place, found, expected: expected.to_owned() }
    }

    fn end(&self, place: Place, expected: &str) -> MeshError {
        let file = self.source.to_owned();
        MeshError::UnexpectedEnd { file, place, expected: expected.to_owned() }
    }

    fn encoding(&self, place: Place, reason: String) -> MeshError {
        MeshError::Encoding { file: self.source.to_owned(), place, reason }
    }

    fn unsupported(&self, place: Place, feature: String, remedy: &'static str) -> MeshError {
        MeshError::Unsupported { file: self.source.to_owned(), place, feature, remedy }
    }

    fn missing(&self, section: &'static str) -> MeshError {
        let place = self.line(self.head.len());
        MeshError::MissingSection { file: self.source.to_owned(), place, section }
    }

    fn find_appended(&mut self, at: usize) -> Result<(), MeshError> {
        let rest = self.data.get(at..).unwrap_or(&[]);
        if rest.is_empty() {
            return Ok(());
        }
        let tag_end =
            find(rest, b">").ok_or_else(|| self.end(self.line(at), "the end of <AppendedData"))?;
        let underscore = rest[tag_end..].iter().position(|&b| b == b'_');
        let underscore =
            underscore.ok_or_else(|| self.end(self.line(at), "`_` before the appended data"))?;
        let base64 = find(&rest[..tag_end], b"base64").is_some();
        self.appended = Some((at + tag_end + underscore + 1, base64));
        Ok(())
    }

    fn attribute(
        &self,
        tag: &BytesStart<'_>,
        name: &str,
        place: Place,
    ) -> Result<Option<String>, MeshError> {
        for attribute in tag.attributes() {
            let attribute = attribute.map_err(|error| {
                self.invalid(place, tag.as_ref().as_bytes(), &format!("an XML attribute ({error})"))
            })?;
            if attribute.key.as_ref() == name {
                let value = attribute.normalized_value(XmlVersion::Implicit1_0);
                let value = value.map_err(|error| {
                    self.invalid(
                        place,
                        tag.as_ref().as_bytes(),
                        &format!("an XML attribute ({error})"),
                    )
                })?;
                return Ok(Some(value.into_owned()));
            }
        }
        Ok(None)
    }

    fn read(&mut self) -> Result<Mesh, MeshError> {
        let text = std::str::from_utf8(self.head).map_err(|error| {
            self.encoding(self.line(error.valid_up_to()), "not UTF-8 text".to_owned())
        })?;
        let mut xml = quick_xml::Reader::from_str(text);
        let mut assembly = Assembly::new(self.source);
        let cursor = Cursor::new(self.source, self.data);
        let mut part = Part::None;
        let mut line = 1;
        let mut draft: Option<Draft> = None;
        let (mut has_file, mut has_grid) = (false, false);
        loop {
            let before = xml.buffer_position() as usize;
            let event = xml.read_event();
            let after = xml.buffer_position() as usize;
            // Counted onwards from the last event: once over the file in total.
            let passed = self.head.get(before..after).unwrap_or(&[]);
            line += passed.iter().filter(|&&b| b == b'\n').count();
            let place = Place::Line(line);
            match event {
                Err(error) => {
                    let place = self.line(before);
                    return Err(self.invalid(
                        place,
                        &self.head[before.min(self.head.len())..],
                        &format!("XML ({error})"),
                    ));
                }
                Ok(Event::Eof) => break,
                Ok(Event::Start(tag)) => match tag.name().as_ref() {
                    "VTKFile" => {
                        self.file_tag(&tag, place)?;
                        has_file = true;
                    }
                    "UnstructuredGrid" => has_grid = true,
                    "Piece" => draft = Some(self.piece_tag(&tag, place)?),
                    "Points" => part = Part::Points,
                    "Cells" => part = Part::Cells,
                    "PointData" => part = Part::PointData,
                    "CellData" => part = Part::CellData,
                    "DataArray" => {
                        let array = self.array_tag(&tag, place, after)?;
                        if let Some(draft) = &mut draft {
                            self.array(draft, part, &array)?;
                        }
                    }
                    _ => {}
                },
                Ok(Event::Empty(tag)) => match tag.name().as_ref() {
                    "DataArray" => {
                        let mut array = self.array_tag(&tag, place, after)?;
                        array.text = &[];
                        if let Some(draft) = &mut draft {
                            self.array(draft, part, &array)?;
                        }
                    }
                    "UnstructuredGrid" => has_grid = true,
                    _ => {}
                },
                Ok(Event::End(tag)) => match tag.name().as_ref() {
                    "Points" | "Cells" | "PointData" | "CellData" => part = Part::None,
                    "Piece" => {
                        if let Some(draft) = draft.take() {
                            assembly.add(&cursor, &self.piece(draft)?)?;
                        }
                    }
                    _ => {}
                },
                Ok(_) => {}
            }
        }
        if !has_file {
            return Err(self.missing("a VTKFile element"));
        }
        if !has_grid {
            return Err(self.missing("an UnstructuredGrid element"));
        }
        if draft.is_some() {
            return Err(self.missing("the end of a Piece"));
        }
        Ok(assembly.finish())
    }

    fn file_tag(&mut self, tag: &BytesStart<'_>, place: Place) -> Result<(), MeshError> {
        let attribute = |name| self.attribute(tag, name, place);
        let kind = attribute("type")?.unwrap_or_default();
        if kind != "UnstructuredGrid" {
            let feature = format!("the VTK file type `{}`", shown(kind.as_bytes()));
            return Err(self.unsupported(place, feature, "save it as UnstructuredGrid (.vtu)"));
        }
        let big_endian = attribute("byte_order")?.as_deref() == Some("BigEndian");
        let wide = attribute("header_type")?.as_deref() == Some("UInt64");
        let zlib = match attribute("compressor")?.as_deref() {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let feature = format!("the compressor {}", shown(other.as_bytes()));
                return Err(self.unsupported(place, feature, "save it uncompressed or with zlib"));
            }
        };
        (self.big_endian, self.wide, self.zlib) = (big_endian, wide, zlib);
        // The format stores each byte once; zlib shrinks at most by about 1032.
        let ratio = if zlib { 1100 } else { 2 };
        self.budget.set((self.data.len() as u64).saturating_mul(ratio));
        Ok(())
    }

    fn piece_tag(&self, tag: &BytesStart<'_>, place: Place) -> Result<Draft, MeshError> {
        let mut counts = [0; 2];
        for (count, name) in counts.iter_mut().zip(["NumberOfPoints", "NumberOfCells"]) {
            let text = self.attribute(tag, name, place)?.unwrap_or_default();
            let value = parse(text.trim().as_bytes());
            *count = value.ok_or_else(|| self.invalid(place, text.as_bytes(), name))?;
        }
        Ok(Draft {
            place,
            counts,
            points: None,
            connectivity: None,
            ends: None,
            types: None,
            point_arrays: Vec::new(),
            cell_arrays: Vec::new(),
        })
    }

    fn array_tag(
        &self,
        tag: &BytesStart<'_>,
        place: Place,
        start: usize,
    ) -> Result<Array<'a>, MeshError> {
        let attribute = |name| self.attribute(tag, name, place);
        let kind = attribute("type")?.unwrap_or_default();
        let number = match kind.as_str() {
            "Int8" => Number::Signed(1),
            "UInt8" => Number::Unsigned(1),
            "Int16" => Number::Signed(2),
            "UInt16" => Number::Unsigned(2),
            "Int32" => Number::Signed(4),
            "UInt32" => Number::Unsigned(4),
            "Int64" => Number::Signed(8),
            "UInt64" => Number::Unsigned(8),
            "Float32" => Number::Real(4),
            "Float64" => Number::Real(8),
            // Not used for anything; only the width has to be right.
            "String" => Number::Real(8),
            _ => {
                return Err(self.invalid(
                    place,
                    kind.as_bytes(),
                    "a type such as Float64 or Int32",
                ));
            }
        };
        let offset =
            match attribute("offset")? {
                None => None,
                Some(text) => {
                    let offset = parse(text.trim().as_bytes());
                    Some(offset.ok_or_else(|| {
                        self.invalid(place, text.as_bytes(), "an offset in bytes")
                    })?)
                }
            };
        let components = attribute("NumberOfComponents")?.unwrap_or_else(|| "1".to_owned());
        let mut name = attribute("Name")?.unwrap_or_default();
        let vector = kind != "String" && components.trim() == "3";
        if kind == "String" || components.trim() != "1" && components.trim() != "0" {
            // Marks arrays that cannot hold one number per entity.
            name.push('\0');
        }
        let text = self.head.get(start..).unwrap_or(&[]);
        let length = text.iter().position(|&b| b == b'<').unwrap_or(text.len());
        let format = attribute("format")?.unwrap_or_else(|| "ascii".to_owned());
        Ok(Array { place, name, vector, number, format, offset, text: &text[..length], start })
    }

    fn array(&self, draft: &mut Draft, part: Part, array: &Array<'_>) -> Result<(), MeshError> {
        match (part, array.name.as_str()) {
            (Part::Points, _) => draft.points = Some(self.reals(array)?),
            (Part::Cells, "connectivity") => draft.connectivity = Some(self.integers(array)?),
            (Part::Cells, "offsets") => draft.ends = Some(self.integers(array)?),
            (Part::Cells, "types") => draft.types = Some(self.integers(array)?),
            (Part::PointData, name) if group_name(name).is_some() => {
                let values = grid::Array::Integers(self.integers(array)?);
                draft.point_arrays.push((name.to_owned(), values));
            }
            (Part::CellData, name) if !name.ends_with('\0') => {
                let values = if array.number.is_integer() {
                    grid::Array::Integers(self.integers(array)?)
                } else {
                    grid::Array::Reals(self.reals(array)?)
                };
                draft.cell_arrays.push((name.to_owned(), values));
            }
            (Part::CellData, name) if array.vector => {
                let values = self.reals(array)?;
                draft.cell_arrays.extend(grid::components(name.trim_end_matches('\0'), values));
            }
            _ => {}
        }
        Ok(())
    }

    fn piece(&self, draft: Draft) -> Result<Piece, MeshError> {
        let [n_points, n_cells] = draft.counts;
        let empty = |place| Located { values: Vec::new(), place };
        let reals = || Located { values: Vec::new(), place: draft.place };
        let points = match draft.points {
            Some(points) => points,
            None if n_points == 0 => reals(),
            None => return Err(self.missing("an array of points")),
        };
        let of = |array: Option<Located<i64>>, name| match array {
            Some(array) => Ok(array),
            None if n_cells == 0 => Ok(empty(draft.place)),
            None => Err(self.missing(name)),
        };
        let connectivity = of(draft.connectivity, "the array `connectivity`")?;
        let ends = of(draft.ends, "the array `offsets`")?;
        let types = of(draft.types, "the array `types`")?;
        let counts = [
            (
                "the number of point coordinates",
                n_points.saturating_mul(3),
                points.values.len(),
                points.place,
            ),
            ("the number of cell types", n_cells, types.values.len(), types.place),
        ];
        for (what, expected, found, place) in counts {
            if expected != found as u64 {
                return Err(MeshError::CountMismatch {
                    file: self.source.to_owned(),
                    place,
                    what: what.to_owned(),
                    expected,
                    found: found as u64,
                });
            }
        }
        let (point_arrays, cell_arrays) = (draft.point_arrays, draft.cell_arrays);
        Ok(Piece { points, connectivity, ends, types, point_arrays, cell_arrays })
    }

    fn integers(&self, array: &Array<'_>) -> Result<Located<i64>, MeshError> {
        if array.format == "ascii" {
            return self.ascii(array, "an integer");
        }
        let (bytes, place) = self.bytes(array)?;
        Ok(Located { values: array.number.integers(&bytes, self.big_endian), place })
    }

    fn reals(&self, array: &Array<'_>) -> Result<Located<f64>, MeshError> {
        if array.format == "ascii" {
            return self.ascii(array, "a number");
        }
        let (bytes, place) = self.bytes(array)?;
        Ok(Located { values: array.number.reals(&bytes, self.big_endian), place })
    }

    fn ascii<T: std::str::FromStr>(
        &self,
        array: &Array<'_>,
        expected: &str,
    ) -> Result<Located<T>, MeshError> {
        let mut values = Vec::new();
        for word in words(array.text) {
            let Some(value) = parse(word) else {
                // The word is a part of the text: its distance from the start gives the line.
                let at = array.start + (word.as_ptr() as usize - array.text.as_ptr() as usize);
                return Err(self.invalid(self.line(at), word, expected));
            };
            values.push(value);
        }
        Ok(Located { values, place: array.place })
    }

    /// The decoded bytes of a binary array.
    fn bytes(&self, array: &Array<'_>) -> Result<(Vec<u8>, Place), MeshError> {
        let (bytes, place) = self.decoded(array)?;
        match self.budget.get().checked_sub(bytes.len() as u64) {
            Some(left) => self.budget.set(left),
            None => {
                let reason = "the arrays hold more than the file can store".to_owned();
                return Err(self.encoding(place, reason));
            }
        }
        Ok((bytes, place))
    }

    fn decoded(&self, array: &Array<'_>) -> Result<(Vec<u8>, Place), MeshError> {
        let (stored, base64, place) = match array.format.as_str() {
            "binary" => (array.text, true, array.place),
            "appended" => {
                let at = array.place;
                let Some((start, base64)) = self.appended else {
                    return Err(self.missing("an AppendedData element"));
                };
                let offset = array.offset.unwrap_or(0);
                let stored = start.checked_add(offset).and_then(|from| self.data.get(from..));
                let Some(stored) = stored else {
                    return Err(self.invalid(
                        at,
                        offset.to_string().as_bytes(),
                        "an offset inside the appended data",
                    ));
                };
                (stored, base64, Place::Byte(start + offset))
            }
            other => {
                return Err(self.invalid(
                    array.place,
                    other.as_bytes(),
                    "format ascii, binary or appended",
                ));
            }
        };
        let stored = Stored { bytes: stored, base64 };
        let width = if self.wide { 8 } else { 4 };
        let header = |count: usize| -> Result<Vec<usize>, MeshError> {
            let bytes = stored.prefix(count.saturating_mul(width));
            let bytes = bytes.map_err(|reason| self.encoding(place, reason))?;
            if bytes.len() < count.saturating_mul(width) {
                return Err(self.end(place, "the size of an array"));
            }
            let sizes = Number::Unsigned(width).integers(&bytes, self.big_endian);
            Ok(sizes.into_iter().map(|size| usize::try_from(size).unwrap_or(usize::MAX)).collect())
        };
        // An empty array may be stored as nothing at all.
        if array.format == "binary" && array.text.trim_ascii().is_empty() {
            return Ok((Vec::new(), place));
        }
        let first = header(1)?.first().copied().unwrap_or(0);
        if !self.zlib {
            let end = width.saturating_add(first);
            let mut bytes = stored.prefix(end).map_err(|reason| self.encoding(place, reason))?;
            if bytes.len() < end {
                return Err(
                    self.end(place, &format!("{first} bytes of the array `{}`", array.name))
                );
            }
            bytes.drain(..width);
            return Ok((bytes, place));
        }
        if first == 0 {
            return Ok((Vec::new(), place));
        }
        // Blocks, full size, last size, then the stored size of each block.
        let sizes = header(first.saturating_add(3))?;
        let stored_sizes = sizes.get(3..).unwrap_or(&[]);
        let head = sizes.len() * width;
        let total = stored_sizes.iter().fold(head, |sum, &size| sum.saturating_add(size));
        let bytes = stored.prefix(total).map_err(|reason| self.encoding(place, reason))?;
        if bytes.len() < total {
            return Err(self.end(place, &format!("{total} bytes of the array `{}`", array.name)));
        }
        let mut out = Vec::new();
        let mut rest = &bytes[head..];
        for (i, &size) in stored_sizes.iter().enumerate() {
            let (block, after) = rest.split_at(size.min(rest.len()));
            rest = after;
            let last = i + 1 == stored_sizes.len() && sizes[2] > 0;
            let expected = if last { sizes[2] } else { sizes[1] };
            let before = out.len();
            // One byte more than announced shows a block that is too long without unpacking it all.
            let limit = (expected as u64).saturating_add(1);
            flate2::read::ZlibDecoder::new(block)
                .take(limit)
                .read_to_end(&mut out)
                .map_err(|error| self.encoding(place, format!("zlib block {i}: {error}")))?;
            let found = out.len() - before;
            if found != expected {
                let reason = format!("zlib block {i} holds {found} bytes instead of {expected}");
                return Err(self.encoding(place, reason));
            }
        }
        Ok((out, place))
    }
}

/// Bytes of an array as they stand in the file.
struct Stored<'a> {
    bytes: &'a [u8],
    base64: bool,
}

impl Stored<'_> {
    /// The first `length` bytes, or fewer when there are no more.
    fn prefix(&self, length: usize) -> Result<Vec<u8>, String> {
        if self.base64 {
            decode_base64(self.bytes, length)
        } else {
            Ok(self.bytes[..length.min(self.bytes.len())].to_vec())
        }
    }
}

/// Decodes at most `length` bytes.
///
/// VTK encodes the header of an array and its data one after the other, each with padding of its own,
/// which general decoders refuse; here padding ends a group of four and the next group follows.
fn decode_base64(text: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let (mut group, mut n, mut padding) = (0u32, 0, 0);
    for &byte in text {
        if out.len() >= length {
            break;
        }
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' if n >= 2 => {
                padding += 1;
                0
            }
            b'<' => break,
            _ if byte.is_ascii_whitespace() => continue,
            _ => return Err(format!("the character `{}` is not base64", shown(&[byte]))),
        };
        group = group << 6 | u32::from(value);
        n += 1;
        if n == 4 {
            let bytes = group.to_be_bytes();
            out.extend_from_slice(&bytes[1..4 - padding]);
            (group, n, padding) = (0, 0, 0);
        }
    }
    out.truncate(length);
    Ok(out)
}

/// What the VTU and VTK writers write; lengths must match the points or cells.
#[derive(Clone, Copy, Debug, Default)]
pub struct VtuData<'a> {
    /// Positions in metres.
    pub points: &'a [DVec3],
    /// Tetrahedra, the first cells of the file.
    pub tetrahedra: &'a [[u32; 4]],
    /// Triangles, the cells after the tetrahedra.
    pub triangles: &'a [[u32; 3]],
    /// Named vectors, one for each point, in any unit.
    pub point_vectors: &'a [(&'a str, &'a [DVec3])],
    /// Named numbers, one for each point, in any unit.
    pub point_scalars: &'a [(&'a str, &'a [f64])],
    /// Named numbers, one for each tetrahedron and then each triangle, in any unit.
    pub cell_scalars: &'a [(&'a str, &'a [f64])],
    /// Numbers kept with the mesh, written as they were read.
    pub cell_data: &'a [CellData],
    /// Groups, written as 0/1 arrays named `group:<dimension>:<name>` on points and cells.
    pub groups: &'a [Group],
    /// Writes real numbers with 32 instead of 64 bits.
    pub single_precision: bool,
}

impl<'a> VtuData<'a> {
    /// Points, cells and groups of a mesh.
    pub fn of_mesh(mesh: &'a Mesh) -> Self {
        VtuData {
            points: &mesh.points,
            tetrahedra: &mesh.tetrahedra,
            triangles: &mesh.triangles,
            groups: &mesh.groups,
            cell_data: &mesh.cell_data,
            ..VtuData::default()
        }
    }

    pub(super) fn check_lengths(&self) -> Result<(), MeshError> {
        let n_points = self.points.len();
        let n_cells = self.tetrahedra.len() + self.triangles.len();
        let vectors =
            self.point_vectors.iter().map(|(name, v)| (name, v.len(), n_points, "points"));
        let scalars =
            self.point_scalars.iter().map(|(name, v)| (name, v.len(), n_points, "points"));
        let cells = self.cell_scalars.iter().map(|(name, v)| (name, v.len(), n_cells, "cells"));
        let data = self.cell_data.iter().flat_map(|data| {
            let (n_tets, n_triangles) = (self.tetrahedra.len(), self.triangles.len());
            [(&data.tetrahedra, n_tets, "tetrahedra"), (&data.triangles, n_triangles, "triangles")]
                .map(|(values, expected, cells)| (&data.name, values.len(), expected, cells))
        });
        for (name, found, expected, entities) in data {
            if found != expected {
                let what = name.clone();
                return Err(MeshError::LengthMismatch { what, entities, expected, found });
            }
        }
        for (name, found, expected, entities) in vectors.chain(scalars).chain(cells) {
            if found != expected {
                let what = (*name).to_owned();
                return Err(MeshError::LengthMismatch { what, entities, expected, found });
            }
        }
        Ok(())
    }
}

/// Writes points, cells, data and groups as a VTU file.
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit, [`MeshError::Io`] when the file cannot be
/// written.
pub fn write_vtu(path: &Path, data: &VtuData<'_>) -> Result<(), MeshError> {
    super::write_file(path, &encode_vtu(data)?)
}

/// The bytes of a VTU file: arrays appended raw, least significant byte first.
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit.
pub fn encode_vtu(data: &VtuData<'_>) -> Result<Vec<u8>, MeshError> {
    data.check_lengths()?;
    let (n_tets, n_triangles) = (data.tetrahedra.len(), data.triangles.len());
    let n_cells = n_tets + n_triangles;
    let mut out = Output { xml: String::new(), raw: Vec::new(), single: data.single_precision };
    out.xml.push_str(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
         byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<UnstructuredGrid>\n",
    );
    // Writing to a string cannot fail.
    let _ = writeln!(
        out.xml,
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{n_cells}\">\n<PointData>",
        data.points.len()
    );
    for (name, values) in data.point_vectors {
        out.reals(name, 3, values.iter().flat_map(|v| v.to_array()));
    }
    for (name, values) in data.point_scalars {
        out.reals(name, 1, values.iter().copied());
    }
    for group in data.groups {
        let members = group.vertices.iter().map(|&v| v as usize);
        out.array("UInt8", &array_name(group), 1, &mask(data.points.len(), members));
    }
    out.xml.push_str("</PointData>\n<CellData>\n");
    for (name, values) in data.cell_scalars {
        out.reals(name, 1, values.iter().copied());
    }
    for array in data.cell_data {
        let values = array.tetrahedra.iter().chain(&array.triangles);
        if array.integer {
            let bytes: Vec<u8> = values.flat_map(|&v| (v as i64).to_le_bytes()).collect();
            out.array("Int64", &array.name, 1, &bytes);
        } else {
            out.reals(&array.name, 1, values.copied());
        }
    }
    for group in data.groups {
        out.array("UInt8", &array_name(group), 1, &cell_mask(group, n_tets, n_triangles));
    }
    out.xml.push_str("</CellData>\n<Points>\n");
    out.reals("Points", 3, data.points.iter().flat_map(|p| p.to_array()));
    out.xml.push_str("</Points>\n<Cells>\n");
    let vertices = data.tetrahedra.iter().flatten().chain(data.triangles.iter().flatten());
    let bytes: Vec<u8> = vertices.flat_map(|&v| i64::from(v).to_le_bytes()).collect();
    out.array("Int64", "connectivity", 1, &bytes);
    let end = |i: usize| if i <= n_tets { 4 * i } else { 4 * n_tets + 3 * (i - n_tets) };
    let bytes: Vec<u8> = (1..=n_cells).flat_map(|i| (end(i) as i64).to_le_bytes()).collect();
    out.array("Int64", "offsets", 1, &bytes);
    let bytes: Vec<u8> = (0..n_cells).map(|i| if i < n_tets { 10 } else { 5 }).collect();
    out.array("UInt8", "types", 1, &bytes);
    out.xml.push_str("</Cells>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_");
    let mut bytes = out.xml.into_bytes();
    bytes.extend_from_slice(&out.raw);
    bytes.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
    Ok(bytes)
}

struct Output {
    xml: String,
    raw: Vec<u8>,
    single: bool,
}

impl Output {
    fn array(&mut self, kind: &str, name: &str, components: usize, bytes: &[u8]) {
        let name = escape(name);
        let offset = self.raw.len();
        let _ = writeln!(
            self.xml,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>"
        );
        self.raw.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        self.raw.extend_from_slice(bytes);
    }

    fn reals(&mut self, name: &str, components: usize, values: impl Iterator<Item = f64>) {
        if self.single {
            let bytes: Vec<u8> = values.flat_map(|v| (v as f32).to_le_bytes()).collect();
            self.array("Float32", name, components, &bytes);
        } else {
            let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
            self.array("Float64", name, components, &bytes);
        }
    }
}

/// Text for an attribute; control characters, which XML forbids, become spaces.
fn escape(text: &str) -> String {
    let text: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    quick_xml::escape::escape(text).into_owned()
}

/// Writes the index of a time series: for each step its time (s) and its file, relative to the index.
///
/// # Errors
///
/// [`MeshError::Io`] when the file cannot be written.
pub fn write_pvd(path: &Path, steps: &[(f64, String)]) -> Result<(), MeshError> {
    let mut xml = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n<Collection>\n",
    );
    for (time, file) in steps {
        let _ =
            writeln!(xml, "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>", escape(file));
    }
    xml.push_str("</Collection>\n</VTKFile>\n");
    super::write_file(path, xml.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_with_padding_inside() {
        assert_eq!(decode_base64(b"AQI=AwQF", 99), Ok(vec![1, 2, 3, 4, 5]));
        assert_eq!(decode_base64(b" AQ\n== AwQF", 3), Ok(vec![1, 3, 4]));
        assert!(decode_base64(b"A*AA", 9).is_err());
        assert!(decode_base64(b"=AAA", 9).is_err());
        assert_eq!(decode_base64(b"", 9), Ok(vec![]));
    }
}
