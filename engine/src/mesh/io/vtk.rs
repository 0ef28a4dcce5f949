//! Legacy VTK unstructured grids (`.vtk`), text or binary, versions 1 to 5.
//!
//! The known crate for these files reports errors without a line and takes counts on trust, so the
//! format is read here.

use super::cells::{Column, all_values, columns};
use super::grid::{
    Array, Assembly, Located, Number, Piece, array_name, cell_mask, mask, push_array,
};
use super::scan::{Cursor, words};
use super::vtu::VtuData;
use crate::mesh::Mesh;
use crate::mesh::error::{MeshError, shown};
use std::path::Path;

const ASK_FOR_GRID: &str = "save it as an unstructured grid";

/// Reads a legacy VTK file from its bytes; `source` names it in messages.
///
/// # Errors
///
/// Every [`MeshError`] about a file.
pub fn read_vtk(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    let mut reader = Reader { cursor: Cursor::new(source, data), binary: false };
    reader.read()
}

struct Reader<'a> {
    cursor: Cursor<'a>,
    /// Arrays are binary; keywords are text all the same.
    binary: bool,
}

impl<'a> Reader<'a> {
    fn read(&mut self) -> Result<Mesh, MeshError> {
        let head = self.cursor.next_line().unwrap_or(b"");
        if !head.trim_ascii().starts_with(b"# vtk DataFile Version") {
            return Err(self
                .cursor
                .invalid(head, "# vtk DataFile Version, the start of a VTK file"));
        }
        // The title, which may be empty.
        if self.cursor.next_line().is_none() {
            return Err(self.cursor.end("a title line"));
        }
        let mode = self.cursor.expect_word("ASCII or BINARY")?;
        self.binary = match mode.to_ascii_uppercase().as_slice() {
            b"ASCII" => false,
            b"BINARY" => true,
            _ => return Err(self.cursor.invalid(mode, "ASCII or BINARY")),
        };
        self.cursor.next_line();
        self.cursor.binary = self.binary;
        let keyword = self.cursor.expect_word("DATASET")?;
        if !keyword.eq_ignore_ascii_case(b"DATASET") {
            return Err(self.cursor.invalid(keyword, "DATASET"));
        }
        let kind = self.cursor.expect_word("UNSTRUCTURED_GRID")?;
        if !kind.eq_ignore_ascii_case(b"UNSTRUCTURED_GRID") {
            let feature = format!("the data set {}", shown(kind));
            return Err(self.cursor.unsupported(feature, ASK_FOR_GRID));
        }
        self.grid()
    }

    fn grid(&mut self) -> Result<Mesh, MeshError> {
        let (mut points, mut cells, mut types) = (None, None, None);
        let mut point_arrays = Vec::new();
        let mut cell_arrays = Vec::new();
        // Number of values per array, and whether they belong to cells.
        let mut owner = (0u64, false);
        while let Some(keyword) = self.cursor.word() {
            match keyword.to_ascii_uppercase().as_slice() {
                b"POINTS" => {
                    let count = self.count("the number of points")?;
                    let number = self.number_type()?;
                    let total = count.saturating_mul(3);
                    points = Some(self.reals(total, number, "point coordinates")?);
                }
                b"CELLS" => cells = Some(self.cells()?),
                b"CELL_TYPES" => {
                    let count = self.count("the number of cell types")?;
                    self.cursor.next_line();
                    types = Some(self.integers(count, Number::Signed(4), "cell types")?);
                }
                b"POINT_DATA" => owner = (self.count("the number of points")?, false),
                b"CELL_DATA" => owner = (self.count("the number of cells")?, true),
                b"METADATA" => self.skip_metadata(),
                other => {
                    let arrays = if owner.1 { &mut cell_arrays } else { &mut point_arrays };
                    self.attribute(keyword, other, owner.0, arrays)?;
                }
            }
        }
        let Some(points) = points else { return Err(self.cursor.missing("POINTS")) };
        let Some((connectivity, ends)) = cells else { return Err(self.cursor.missing("CELLS")) };
        let Some(types) = types else { return Err(self.cursor.missing("CELL_TYPES")) };
        let piece = Piece { points, connectivity, ends, types, point_arrays, cell_arrays };
        let mut assembly = Assembly::new(self.cursor.file);
        assembly.add(&self.cursor, &piece)?;
        Ok(assembly.finish())
    }

    /// Cells as `n v1 .. vn` each (up to version 4), or as offsets and connectivity (version 5).
    fn cells(&mut self) -> Result<(Located<i64>, Located<i64>), MeshError> {
        let count = self.count("the number of cells")?;
        let size = self.count("the size of the cell list")?;
        self.cursor.next_line();
        let here = self.cursor.position;
        let rest = self.cursor.remaining();
        if rest.trim_ascii_start().starts_with(b"OFFSETS") {
            self.cursor.word();
            let number = self.number_type()?;
            let mut ends = self.integers(count, number, "cell offsets")?;
            if !ends.values.is_empty() {
                ends.values.remove(0);
            }
            let keyword = self.cursor.expect_word("CONNECTIVITY")?;
            if !keyword.eq_ignore_ascii_case(b"CONNECTIVITY") {
                return Err(self.cursor.invalid(keyword, "CONNECTIVITY"));
            }
            let number = self.number_type()?;
            let connectivity = self.integers(size, number, "vertices of cells")?;
            return Ok((connectivity, ends));
        }
        debug_assert_eq!(here, self.cursor.position);
        let list = self.integers(size, Number::Signed(4), "vertices of cells")?;
        let mut connectivity = Vec::with_capacity(list.values.len());
        let mut ends = Vec::new();
        let mut rest = list.values.as_slice();
        for read in 0..count {
            let cell = rest.split_first().and_then(|(&n, after)| {
                let n = usize::try_from(n).ok()?;
                Some((after.get(..n)?, after.get(n..)?))
            });
            let Some((cell, after)) = cell else {
                let what = "the number of cells in the cell list";
                return Err(self.cursor.mismatch(what, count, read));
            };
            connectivity.extend_from_slice(cell);
            ends.push(connectivity.len() as i64);
            rest = after;
        }
        if !rest.is_empty() {
            let used = list.values.len() - rest.len();
            return Err(self.cursor.mismatch("the size of the cell list", size, used as u64));
        }
        let place = list.place;
        Ok((Located { values: connectivity, place }, Located { values: ends, place }))
    }

    /// An array of point or cell data; those of one or three numbers each are kept, others read past.
    fn attribute(
        &mut self,
        keyword: &[u8],
        upper: &[u8],
        count: u64,
        arrays: &mut Vec<(String, Array)>,
    ) -> Result<(), MeshError> {
        match upper {
            b"SCALARS" => {
                let name = self.name()?;
                let kind = self.cursor.expect_word("the type of an array")?;
                let number = self.named_type(kind)?;
                let line = self.cursor.next_line().unwrap_or(b"");
                let components = match words(line).next() {
                    Some(word) => self.cursor.count(word, "the number of components")?,
                    None => 1,
                };
                let position = self.cursor.position;
                // The table's name may be left out.
                if self.cursor.remaining().trim_ascii_start().starts_with(b"LOOKUP_TABLE") {
                    self.cursor.word();
                    self.cursor.next_line();
                } else {
                    self.cursor.position = position;
                }
                self.array(name, count, components, number, arrays)
            }
            b"VECTORS" | b"NORMALS" => self.plain_array(count, 3, arrays),
            b"TENSORS" => self.plain_array(count, 9, arrays),
            b"TENSORS6" => self.plain_array(count, 6, arrays),
            b"GLOBAL_IDS" | b"PEDIGREE_IDS" => {
                self.name()?;
                let number = self.number_type()?;
                self.integers(count, number, "global numbers").map(drop)
            }
            b"TEXTURE_COORDINATES" => {
                self.name()?;
                let components = self.count("the number of components")?;
                let number = self.number_type()?;
                self.reals(count.saturating_mul(components), number, "texture coordinates")
                    .map(drop)
            }
            b"COLOR_SCALARS" => self.skip_colours(count, "the number of components"),
            b"LOOKUP_TABLE" => self.skip_colours(4, "the size of the table"),
            b"FIELD" => {
                self.name()?;
                let fields = self.count("the number of arrays")?;
                for _ in 0..fields {
                    let mut name = self.cursor.expect_word("the name of an array")?;
                    if name == b"METADATA" {
                        self.skip_metadata();
                        name = self.cursor.expect_word("the name of an array")?;
                    }
                    let name = decode_name(name);
                    let components = self.count("the number of components")?;
                    let tuples = self.count("the number of values")?;
                    let kind = self.cursor.expect_word("the type of an array")?;
                    let number = self.named_type(kind)?;
                    self.cursor.next_line();
                    if tuples == count {
                        self.array(name, count, components, number, arrays)?;
                    } else {
                        let total = tuples.saturating_mul(components);
                        self.reals(total, number, "values of a field").map(drop)?;
                    }
                }
                Ok(())
            }
            _ => Err(self.cursor.invalid(keyword, "a keyword such as POINTS, CELLS or CELL_DATA")),
        }
    }

    /// Moves behind the blank line that ends them.
    fn skip_metadata(&mut self) {
        self.cursor.next_line();
        while self.cursor.next_line().is_some_and(|line| !line.trim_ascii().is_empty()) {}
    }

    /// Reads past colours, so many times the number that `what` says.
    fn skip_colours(&mut self, times: u64, what: &str) -> Result<(), MeshError> {
        self.name()?;
        let total = self.count(what)?.saturating_mul(times);
        self.cursor.next_line();
        let number = if self.binary { Number::Unsigned(1) } else { Number::Real(4) };
        self.reals(total, number, "colours").map(drop)
    }

    fn plain_array(
        &mut self,
        count: u64,
        components: u64,
        arrays: &mut Vec<(String, Array)>,
    ) -> Result<(), MeshError> {
        let name = self.name()?;
        let number = self.number_type()?;
        self.array(name, count, components, number, arrays)
    }

    fn array(
        &mut self,
        name: String,
        count: u64,
        components: u64,
        number: Number,
        arrays: &mut Vec<(String, Array)>,
    ) -> Result<(), MeshError> {
        let total = count.saturating_mul(components);
        let what = format!("values of the array `{name}`");
        if number.is_integer() && components == 1 {
            let values = self.integers(total, number, &what)?;
            arrays.push((name, Array::Integers(values)));
        } else {
            let values = self.reals(total, number, &what)?;
            push_array(arrays, name, components, Array::Reals(values));
        }
        Ok(())
    }

    fn name(&mut self) -> Result<String, MeshError> {
        Ok(decode_name(self.cursor.expect_word("the name of an array")?))
    }

    fn count(&mut self, expected: &str) -> Result<u64, MeshError> {
        let word = self.cursor.expect_word(expected)?;
        self.cursor.count(word, expected)
    }

    /// A type at the end of a line.
    fn number_type(&mut self) -> Result<Number, MeshError> {
        let word = self.cursor.expect_word("the type of an array")?;
        let number = self.named_type(word)?;
        self.cursor.next_line();
        Ok(number)
    }

    fn named_type(&mut self, word: &[u8]) -> Result<Number, MeshError> {
        Ok(match word.to_ascii_lowercase().as_slice() {
            b"char" | b"vtktypeint8" => Number::Signed(1),
            b"unsigned_char" | b"vtktypeuint8" => Number::Unsigned(1),
            b"short" | b"vtktypeint16" => Number::Signed(2),
            b"unsigned_short" | b"vtktypeuint16" => Number::Unsigned(2),
            b"int" | b"vtkidtype" | b"vtktypeint32" => Number::Signed(4),
            b"unsigned_int" | b"vtktypeuint32" => Number::Unsigned(4),
            b"long" | b"long_long" | b"vtktypeint64" => Number::Signed(8),
            b"unsigned_long" | b"unsigned_long_long" | b"vtktypeuint64" => Number::Unsigned(8),
            b"float" | b"vtktypefloat32" => Number::Real(4),
            b"double" | b"vtktypefloat64" => Number::Real(8),
            b"bit" | b"string" | b"variant" | b"utf8_string" => {
                let feature = format!("an array of type {}", shown(word));
                return Err(self.cursor.unsupported(feature, "remove that array before saving"));
            }
            _ => {
                return Err(self
                    .cursor
                    .invalid(word, "the type of an array, such as int or double"));
            }
        })
    }

    fn integers(
        &mut self,
        count: u64,
        number: Number,
        what: &str,
    ) -> Result<Located<i64>, MeshError> {
        let place = self.cursor.place();
        if self.binary {
            let values = number.integers(self.bytes(count, number, what)?, true);
            return Ok(Located { values, place });
        }
        let values = self.ascii(count, what, |cursor, word| cursor.integer(word, what))?;
        Ok(Located { values, place })
    }

    fn reals(&mut self, count: u64, number: Number, what: &str) -> Result<Located<f64>, MeshError> {
        let place = self.cursor.place();
        if self.binary {
            let values = number.reals(self.bytes(count, number, what)?, true);
            return Ok(Located { values, place });
        }
        let values = self.ascii(count, what, |cursor, word| cursor.real(word, what))?;
        Ok(Located { values, place })
    }

    fn bytes(&mut self, count: u64, number: Number, what: &str) -> Result<&'a [u8], MeshError> {
        let count = self.cursor.room_for(count, number.width() as u64, what)?;
        self.cursor.take(count * number.width(), what)
    }

    fn ascii<T>(
        &mut self,
        count: u64,
        what: &str,
        value: impl Fn(&Cursor<'_>, &[u8]) -> Result<T, MeshError>,
    ) -> Result<Vec<T>, MeshError> {
        // Two bytes per value: one digit and one separator.
        let room = count.min(self.cursor.remaining().len() as u64 / 2 + 1) as usize;
        let mut values = Vec::with_capacity(room);
        for _ in 0..count {
            let Some(word) = self.cursor.word() else {
                return Err(self.cursor.end(&format!("{count} {what} ({} found)", values.len())));
            };
            values.push(value(&self.cursor, word)?);
        }
        Ok(values)
    }
}

/// Array names may hold spaces and other characters as `%20`.
fn decode_name(word: &[u8]) -> String {
    let mut bytes = Vec::with_capacity(word.len());
    let mut rest = word;
    while let Some((&byte, after)) = rest.split_first() {
        let code = match (byte, after) {
            (b'%', [a, b, ..]) => hex(*a).zip(hex(*b)).map(|(a, b)| 16 * a + b),
            _ => None,
        };
        bytes.push(code.unwrap_or(byte));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    super::scan::name(&bytes)
}

fn hex(digit: u8) -> Option<u8> {
    (digit as char).to_digit(16).map(|d| d as u8)
}

fn encode_name(name: &str) -> String {
    let mut encoded = String::with_capacity(name.len());
    for byte in name.bytes() {
        if byte.is_ascii_graphic() && byte != b'%' && byte != b'"' {
            encoded.push(byte as char);
        } else {
            encoded.push_str(&format!("%{byte:02X}"));
        }
    }
    encoded
}

/// Writes points, cells, data and groups as a binary legacy VTK file (version 3.0).
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit, [`MeshError::Io`] when the file cannot be
/// written.
pub fn write_vtk(path: &Path, data: &VtuData<'_>) -> Result<(), MeshError> {
    super::write_file(path, &encode_vtk(data, true)?)
}

/// The bytes of a legacy VTK file, binary or as text.
///
/// # Errors
///
/// [`MeshError::LengthMismatch`] when data do not fit.
pub fn encode_vtk(data: &VtuData<'_>, binary: bool) -> Result<Vec<u8>, MeshError> {
    data.check_lengths()?;
    let mut out = Output { bytes: Vec::new(), binary, single: data.single_precision };
    let mode = if binary { "BINARY" } else { "ASCII" };
    out.text(&format!("# vtk DataFile Version 3.0\nSinew\n{mode}\nDATASET UNSTRUCTURED_GRID\n"));
    let real = if data.single_precision { "float" } else { "double" };
    out.text(&format!("POINTS {} {real}\n", data.points.len()));
    out.reals(data.points.iter().flat_map(|p| p.to_array()));
    let n_cells = data.n_cells();
    let size = n_cells + data.n_corners();
    out.text(&format!("CELLS {n_cells} {size}\n"));
    for cell in data.cells() {
        out.integers(std::iter::once(cell.len() as i32).chain(cell.iter().map(|&v| v as i32)));
    }
    out.end_binary();
    out.text(&format!("CELL_TYPES {n_cells}\n"));
    out.integers(data.cell_types().map(i32::from));
    out.end_binary();

    let n_groups = data.groups.len();
    let n_arrays = n_groups + data.point_scalars.len();
    if n_arrays + data.point_vectors.len() > 0 {
        out.text(&format!("POINT_DATA {}\n", data.points.len()));
        for (name, values) in data.point_vectors {
            out.text(&format!("VECTORS {} {real}\n", encode_name(name)));
            out.reals(values.iter().flat_map(|v| v.to_array()));
        }
        if n_arrays > 0 {
            out.text(&format!("FIELD data {n_arrays}\n"));
        }
        for (name, values) in data.point_scalars {
            out.text(&format!("{} 1 {} {real}\n", encode_name(name), values.len()));
            out.reals(values.iter().copied());
        }
        for group in data.groups {
            let members = group.vertices.iter().map(|&v| v as usize);
            out.mask(&array_name(group), &mask(data.points.len(), members));
        }
    }
    let columns = columns(data.cell_data);
    let n_arrays = n_groups + data.cell_scalars.len() + columns.len();
    if n_arrays > 0 {
        out.text(&format!("CELL_DATA {n_cells}\nFIELD data {n_arrays}\n"));
        for (name, values) in data.cell_scalars {
            out.text(&format!("{} 1 {} {real}\n", encode_name(name), values.len()));
            out.reals(values.iter().copied());
        }
        for column in columns {
            match column {
                Column::Scalar(array) => {
                    // the format knows no portable name for wider integers
                    let fits = array.integer && all_values(array).all(|v| f64::from(v as i32) == v);
                    let kind = if fits { "int" } else { real };
                    out.text(&format!("{} 1 {n_cells} {kind}\n", encode_name(&array.name)));
                    if fits {
                        out.integers(all_values(array).map(|v| v as i32));
                        out.end_binary();
                    } else {
                        out.reals(all_values(array));
                    }
                }
                Column::Vector(name, [x, y, z]) => {
                    out.text(&format!("{} 3 {n_cells} {real}\n", encode_name(name)));
                    let yz = all_values(y).zip(all_values(z));
                    out.reals(all_values(x).zip(yz).flat_map(|(x, (y, z))| [x, y, z]));
                }
            }
        }
        for group in data.groups {
            out.mask(&array_name(group), &cell_mask(group, data.mesh));
        }
    }
    Ok(out.bytes)
}

struct Output {
    bytes: Vec<u8>,
    binary: bool,
    single: bool,
}

impl Output {
    fn text(&mut self, text: &str) {
        self.bytes.extend_from_slice(text.as_bytes());
    }

    fn reals(&mut self, values: impl Iterator<Item = f64>) {
        for value in values {
            match (self.binary, self.single) {
                (true, true) => self.bytes.extend_from_slice(&(value as f32).to_be_bytes()),
                (true, false) => self.bytes.extend_from_slice(&value.to_be_bytes()),
                (false, true) => self.text(&format!("{:?} ", value as f32)),
                (false, false) => self.text(&format!("{value:?} ")),
            }
        }
        self.text("\n");
    }

    /// A line end after binary integers, which some readers insist on.
    fn end_binary(&mut self) {
        if self.binary {
            self.text("\n");
        }
    }

    fn integers(&mut self, values: impl Iterator<Item = i32>) {
        for value in values {
            if self.binary {
                self.bytes.extend_from_slice(&value.to_be_bytes());
            } else {
                self.text(&format!("{value} "));
            }
        }
        if !self.binary {
            self.text("\n");
        }
    }

    fn mask(&mut self, name: &str, values: &[u8]) {
        self.text(&format!("{} 1 {} unsigned_char\n", encode_name(name), values.len()));
        if self.binary {
            self.bytes.extend_from_slice(values);
        } else {
            for value in values {
                self.text(&format!("{value} "));
            }
        }
        self.text("\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_encoding() {
        for name in ["plain", "two words", "100 %", "é\"", ""] {
            assert_eq!(decode_name(encode_name(name).as_bytes()), name);
        }
        assert_eq!(decode_name(b"50%"), "50%");
        assert_eq!(decode_name(b"%zz"), "%zz");
    }
}
