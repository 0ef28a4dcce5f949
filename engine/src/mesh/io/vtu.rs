//! VTK XML unstructured grids (`.vtu`) and their time series (`.pvd`).
//!
//! Reads text arrays, inline base64, and appended raw or base64 data, plain or zlib-compressed; writes
//! appended raw data.

mod write;

pub use write::{VtuData, encode_vtu, write_pvd, write_vtu};

use super::grid::{self, Assembly, Located, Number, Piece, push_array};
use super::scan::{Cursor, line_at, parse, words};
use crate::mesh::Mesh;
use crate::mesh::error::{FileProblem, MeshError, Place, shown, shown_up_to};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use std::cell::Cell;
use std::io::Read as _;

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
    number: Number,
    components: u64,
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

    fn error(&self, place: Place, problem: FileProblem) -> MeshError {
        MeshError::File { file: self.source.to_owned(), place, problem }
    }

    fn invalid(&self, place: Place, found: &[u8], expected: &str) -> MeshError {
        self.error(place, FileProblem::invalid(found, expected))
    }

    fn end(&self, place: Place, expected: &str) -> MeshError {
        self.error(place, FileProblem::UnexpectedEnd { expected: expected.to_owned() })
    }

    fn encoding(&self, place: Place, reason: String) -> MeshError {
        self.error(place, FileProblem::Encoding { reason })
    }

    fn unsupported(&self, place: Place, feature: String, remedy: &'static str) -> MeshError {
        self.error(place, FileProblem::Unsupported { feature, remedy })
    }

    fn missing(&self, section: &'static str) -> MeshError {
        self.error(self.line(self.head.len()), FileProblem::MissingSection { section })
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
                return Ok(Some(value.replace(char::is_control, " ")));
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
                    // it may repeat a tag without an end, that is the rest of the file
                    let error = shown_up_to(120, error.to_string().as_bytes());
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
        let components = attribute("NumberOfComponents")?.unwrap_or_default();
        let components = match (kind.as_str(), components.trim()) {
            // Text cannot be a number for each entity.
            ("String", _) => 0,
            (_, "" | "0") => 1,
            (_, text) => parse(text.as_bytes()).unwrap_or(0),
        };
        let name = attribute("Name")?.unwrap_or_default();
        let text = self.head.get(start..).unwrap_or(&[]);
        let length = text.iter().position(|&b| b == b'<').unwrap_or(text.len());
        let format = attribute("format")?.unwrap_or_else(|| "ascii".to_owned());
        Ok(Array { place, name, number, components, format, offset, text: &text[..length], start })
    }

    fn array(&self, draft: &mut Draft, part: Part, array: &Array<'_>) -> Result<(), MeshError> {
        match (part, array.name.as_str()) {
            (Part::Points, _) => draft.points = Some(self.reals(array)?),
            (Part::Cells, "connectivity") => draft.connectivity = Some(self.integers(array)?),
            (Part::Cells, "offsets") => draft.ends = Some(self.integers(array)?),
            (Part::Cells, "types") => draft.types = Some(self.integers(array)?),
            (Part::PointData, name) if array.components == 1 => {
                draft.point_arrays.push((name.to_owned(), self.numbers(array)?));
            }
            (Part::CellData, name) if matches!(array.components, 1 | 3) => {
                let values = self.numbers(array)?;
                push_array(&mut draft.cell_arrays, name.to_owned(), array.components, values);
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
                let problem = FileProblem::mismatch(what, expected, found as u64);
                return Err(self.error(place, problem));
            }
        }
        let (point_arrays, cell_arrays) = (draft.point_arrays, draft.cell_arrays);
        Ok(Piece { points, connectivity, ends, types, point_arrays, cell_arrays })
    }

    /// One number each as whole numbers where they are such.
    fn numbers(&self, array: &Array<'_>) -> Result<grid::Array, MeshError> {
        Ok(match array.number.is_integer() && array.components == 1 {
            true => grid::Array::Integers(self.integers(array)?),
            false => grid::Array::Reals(self.reals(array)?),
        })
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
