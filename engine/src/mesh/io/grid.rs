//! What legacy VTK and VTU files share: cell types, typed arrays and the way groups are stored.
//!
//! A group is kept as a pair of 0/1 arrays named `group:<dimension>:<name>`, one on the points and one
//! on the cells. An array of any other name that holds nothing but zeros and ones, and both, gives the group of its ones under
//! its own name: a node set if it is on the points. An integer cell array of any other name with few distinct values gives
//! one group for each value too, named `<array> <value>`. Every array of one number for each cell is kept as it is as well,
//! and one of three as three arrays of reals.

use super::cells::{Builder, CellKind, component_names};
use super::scan::Cursor;
use crate::element_kind::{ByKind, ElementKind};
use crate::mesh::error::{FileProblem, MeshError, Place};
use crate::mesh::{Group, Mesh};
use glam::DVec3;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

/// Integer arrays with more distinct values than this are numberings, not regions.
const MOST_REGIONS: usize = 256;

const GROUP_PREFIX: &str = "group:";

/// Cells of the VTK formats by type number.
fn cell_kind(number: i64) -> CellKind {
    let kind = CellKind::new;
    match number {
        1 => kind("point", 0, 1),
        2 => kind("set of points", 0, 0),
        3 => kind("2-node line", 1, 2),
        4 => kind("line strip", 1, 0),
        5 => CellKind::TRIANGLE,
        6 => kind("triangle strip", 2, 0),
        7 => kind("polygon", 2, 0),
        8 => kind("pixel", 2, 4),
        9 => CellKind::QUAD,
        10 => CellKind::TETRAHEDRON,
        11 => kind("voxel", 3, 8),
        12 => CellKind::HEXAHEDRON,
        13 => kind("6-node prism", 3, 6),
        14 => kind("5-node pyramid", 3, 5),
        15 => kind("pentagonal prism", 3, 10),
        16 => kind("hexagonal prism", 3, 12),
        21 => kind("3-node line", 1, 3),
        22 => CellKind::TRIANGLE6,
        23 => kind("8-node quadrilateral", 2, 8),
        24 => CellKind::TETRAHEDRON10,
        25 => kind("20-node hexahedron", 3, 20),
        26 => kind("15-node prism", 3, 15),
        27 => kind("13-node pyramid", 3, 13),
        28 => kind("9-node quadrilateral", 2, 9),
        29 => kind("27-node hexahedron", 3, 27),
        42 => kind("polyhedron", 3, 0),
        68 => kind("higher-order line", 1, 0),
        69 => kind("higher-order triangle", 2, 0),
        70 => kind("higher-order quadrilateral", 2, 0),
        71 => kind("higher-order tetrahedron", 3, 0),
        72 => kind("higher-order hexahedron", 3, 0),
        _ => kind("cell of a type unknown to this reader", 4, 0),
    }
}

/// Pixels and voxels list their vertices row by row.
const PIXEL: i64 = 8;
const VOXEL: i64 = 11;

/// Type of the numbers in an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Number {
    Signed(usize),
    Unsigned(usize),
    Real(usize),
}

impl Number {
    /// Width in bytes.
    pub fn width(self) -> usize {
        match self {
            Number::Signed(width) | Number::Unsigned(width) | Number::Real(width) => width,
        }
    }

    fn wide(self, bytes: &[u8], big_endian: bool) -> u64 {
        let mut wide = [0; 8];
        let n = bytes.len().min(8);
        if big_endian {
            wide[8 - n..].copy_from_slice(&bytes[..n]);
            u64::from_be_bytes(wide)
        } else {
            wide[..n].copy_from_slice(&bytes[..n]);
            u64::from_le_bytes(wide)
        }
    }

    /// Integers from bytes; values above the range of `i64` become its largest.
    pub fn integers(self, data: &[u8], big_endian: bool) -> Vec<i64> {
        let value = |bytes: &[u8]| {
            let wide = self.wide(bytes, big_endian);
            match self {
                Number::Signed(width) => {
                    let shift = 64 - 8 * width.min(8) as u32;
                    ((wide << shift) as i64) >> shift
                }
                Number::Unsigned(_) => i64::try_from(wide).unwrap_or(i64::MAX),
                Number::Real(4) => f32::from_bits(wide as u32) as i64,
                Number::Real(_) => f64::from_bits(wide) as i64,
            }
        };
        data.chunks_exact(self.width()).map(value).collect()
    }

    /// Reals from bytes.
    pub fn reals(self, data: &[u8], big_endian: bool) -> Vec<f64> {
        let value = |bytes: &[u8]| {
            let wide = self.wide(bytes, big_endian);
            match self {
                Number::Real(4) => f64::from(f32::from_bits(wide as u32)),
                Number::Real(_) => f64::from_bits(wide),
                Number::Unsigned(_) => wide as f64,
                Number::Signed(width) => {
                    let shift = 64 - 8 * width.min(8) as u32;
                    (((wide << shift) as i64) >> shift) as f64
                }
            }
        };
        data.chunks_exact(self.width()).map(value).collect()
    }

    pub fn is_integer(self) -> bool {
        !matches!(self, Number::Real(_))
    }
}

/// An array and where it stands.
pub(crate) struct Located<T> {
    pub values: Vec<T>,
    pub place: Place,
}

/// An array of one number for each point or cell.
pub(crate) enum Array {
    Integers(Located<i64>),
    Reals(Located<f64>),
}

impl Array {
    fn len(&self) -> usize {
        match self {
            Array::Integers(array) => array.values.len(),
            Array::Reals(array) => array.values.len(),
        }
    }

    fn place(&self) -> Place {
        match self {
            Array::Integers(array) => array.place,
            Array::Reals(array) => array.place,
        }
    }

    fn integers(&self) -> Option<&[i64]> {
        match self {
            Array::Integers(array) => Some(&array.values),
            Array::Reals(_) => None,
        }
    }

    /// The array as a mask; `None` where it holds anything but zeros and ones.
    fn mask(&self) -> Option<Cow<'_, [i64]>> {
        let whole: Cow<[i64]> = match self {
            Array::Integers(array) => Cow::Borrowed(&array.values),
            Array::Reals(array) if array.values.iter().all(|x| *x == 0.0 || *x == 1.0) => {
                Cow::Owned(array.values.iter().map(|&x| x as i64).collect())
            }
            Array::Reals(_) => return None,
        };
        whole.iter().all(|x| matches!(x, 0 | 1)).then_some(whole)
    }

    fn value(&self, index: usize) -> f64 {
        match self {
            Array::Integers(array) => array.values[index] as f64,
            Array::Reals(array) => array.values[index],
        }
    }
}

/// One grid as both formats store it.
pub(crate) struct Piece {
    /// Three values per point.
    pub points: Located<f64>,
    /// Vertices of all cells one after another.
    pub connectivity: Located<i64>,
    /// For each cell, where its vertices end in `connectivity`.
    pub ends: Located<i64>,
    pub types: Located<i64>,
    /// Arrays with one value per point.
    pub point_arrays: Vec<(String, Array)>,
    /// Arrays with one value per cell.
    pub cell_arrays: Vec<(String, Array)>,
}

/// Groups in the making, by dimension and name, over all pieces.
type Slots = BTreeMap<(u8, String), usize>;

/// What the pieces so far hold of an array that may be a mask.
#[derive(Default)]
struct Mask {
    zeros: bool,
    ones: bool,
    others: bool,
}

/// Collects the pieces of a file into one mesh.
pub(crate) struct Assembly {
    builder: Builder,
    slots: Slots,
    /// Arrays of zeros and ones, by whether they are on the cells, and by name.
    masks: BTreeMap<(bool, String), Mask>,
    /// Groups that masks make, if they turn out to be such.
    of_masks: BTreeMap<usize, (bool, String)>,
}

/// A count of an array that does not fit: expected and found.
fn mismatch(file: &str, place: Place, what: &str, [expected, found]: [usize; 2]) -> MeshError {
    let problem = FileProblem::mismatch(what, expected as u64, found as u64);
    MeshError::File { file: file.to_owned(), place, problem }
}

impl Piece {
    /// Number of its points; the arrays of points and cells must have fitting lengths.
    fn count_points(&self, file: &str) -> Result<usize, MeshError> {
        let (n_cells, found) = (self.types.values.len(), self.ends.values.len());
        if found != n_cells {
            let what = "the number of cell offsets";
            return Err(mismatch(file, self.ends.place, what, [n_cells, found]));
        }
        let found = self.points.values.len();
        if !found.is_multiple_of(3) {
            let what = "the number of point coordinates";
            return Err(mismatch(file, self.points.place, what, [found / 3 * 3, found]));
        }
        Ok(found / 3)
    }

    /// Kind of a cell that begins at `start` of the connectivity, which moves to its end, and its vertices:
    /// of `n_points` points, the first of which has number `base` in the mesh.
    fn cell(
        &self,
        file: &str,
        number: usize,
        start: &mut usize,
        [base, n_points]: [usize; 2],
        vertices: &mut Vec<u32>,
    ) -> Result<CellKind, MeshError> {
        let end = self.ends.values[number];
        let connectivity = &self.connectivity.values;
        let cell = usize::try_from(end).ok().and_then(|end| connectivity.get(*start..end));
        let Some(cell) = cell else {
            let most = connectivity.len();
            let expected = format!("the end of cell {number}, from {start} to {most}");
            let problem = FileProblem::InvalidValue { found: end.to_string(), expected };
            return Err(MeshError::File { file: file.to_owned(), place: self.ends.place, problem });
        };
        *start += cell.len();
        let by_rows = matches!(self.types.values[number], PIXEL | VOXEL);
        let mut kind = cell_kind(self.types.values[number]);
        if kind.name == "polygon" {
            match cell.len() {
                3 => kind = CellKind::TRIANGLE,
                4 => kind = CellKind::QUAD,
                _ => {}
            }
        }
        let place = self.connectivity.place;
        if kind.used_as().is_some() && cell.len() != kind.vertices {
            let what = format!("the number of vertices of cell {number} ({})", kind.name);
            return Err(mismatch(file, place, &what, [kind.vertices, cell.len()]));
        }
        vertices.clear();
        for &vertex in cell {
            match usize::try_from(vertex) {
                Ok(index) if index < n_points => vertices.push((base + index) as u32),
                _ => {
                    let cell = format!("cell {number} ({})", kind.name);
                    let problem = FileProblem::UnknownVertex { cell, vertex };
                    return Err(MeshError::File { file: file.to_owned(), place, problem });
                }
            }
        }
        if by_rows {
            vertices.chunks_exact_mut(4).for_each(|square| square.swap(2, 3));
        }
        Ok(kind)
    }
}

impl Assembly {
    pub fn new(source: &str) -> Self {
        Assembly {
            builder: Builder::new(source),
            slots: Slots::new(),
            masks: BTreeMap::new(),
            of_masks: BTreeMap::new(),
        }
    }

    fn slot(&mut self, dimension: u8, name: &str) -> usize {
        let builder = &mut self.builder;
        *self
            .slots
            .entry((dimension, name.to_owned()))
            .or_insert_with(|| builder.group(name.to_owned(), dimension))
    }

    pub fn add(&mut self, cursor: &Cursor<'_>, piece: &Piece) -> Result<(), MeshError> {
        let file = cursor.file;
        let n_cells = piece.types.values.len();
        let base = self.builder.mesh.points.len();
        let n_points = piece.count_points(file)?;
        for point in piece.points.values.chunks_exact(3) {
            self.builder.point(cursor, DVec3::from_slice(point), 0)?;
        }
        for (arrays, n) in [(&piece.point_arrays, n_points), (&piece.cell_arrays, n_cells)] {
            for (name, array) in arrays {
                if array.len() != n {
                    let what = format!("the number of values of the array `{name}`");
                    return Err(mismatch(file, array.place(), &what, [n, array.len()]));
                }
            }
        }

        // Groups of every cell, one array at a time, then the cells.
        let mut memberships: Vec<(Cow<[i64]>, HashMap<i64, Membership>)> = Vec::new();
        for (name, array) in &piece.cell_arrays {
            if let Some(integers) = array.integers()
                && let Some(values) = self.membership(name, integers)
            {
                memberships.push((integers.into(), values));
            }
            if !is_component(name, &piece.cell_arrays)
                && let Some(mask) = self.mask(true, name, array)
            {
                memberships.push((mask, HashMap::from([(1, Membership::Mask(name.clone()))])));
            }
        }
        // Data of earlier pieces end where this one begins, whether it has such data or not.
        for (name, array) in self.data_arrays(piece) {
            self.builder.data(name, array.integers().is_some());
        }
        // Where the cells that are kept stand in the file, by kind.
        let mut numbers = ByKind::<Vec<usize>>::default();
        let mut start = 0usize;
        let mut vertices = Vec::new();
        let mut groups = Vec::new();
        for number in 0..n_cells {
            let kind = piece.cell(file, number, &mut start, [base, n_points], &mut vertices)?;
            groups.clear();
            let mut exact = Vec::new();
            for (values, slots) in &memberships {
                match slots.get(&values[number]) {
                    Some(Membership::Region(name)) => {
                        groups.push(self.slot(kind.dimension.min(3), name));
                    }
                    Some(Membership::Mask(name)) => {
                        groups.push(self.mask_slot(true, kind.dimension.min(3), name));
                    }
                    Some(&Membership::Group(slot)) => exact.push(slot),
                    None => {}
                }
            }
            let cell = kind.used_as();
            let index = cell.map_or(0, |cell| self.builder.mesh.count(cell));
            self.builder.cell(kind, &vertices, &groups, 0);
            if let Some(cell) = cell {
                numbers[cell].extend(std::iter::repeat_n(number, kind.parts()));
            }
            // The vertices of a written group come from its point array.
            self.builder.join(cell, index..index + kind.parts(), &[], &exact);
        }
        for (name, array) in self.data_arrays(piece) {
            let found = self.builder.mesh.cell_data.iter_mut().find(|data| data.name == *name);
            let Some(data) = found else { continue };
            for (values, list) in data.values.iter_mut().zip(numbers.iter()) {
                values.extend(list.iter().map(|&number| array.value(number)));
            }
        }
        self.add_point_groups(piece, base);
        Ok(())
    }

    /// Takes note of what an array holds that may be a mask; it, if it is one so far.
    fn mask<'p>(&mut self, of_cells: bool, name: &str, array: &'p Array) -> Option<Cow<'p, [i64]>> {
        if group_name(name).is_some() || array.len() == 0 {
            return None;
        }
        let own = self.masks.entry((of_cells, name.to_owned())).or_default();
        let Some(mask) = array.mask() else {
            own.others = true;
            return None;
        };
        own.zeros |= mask.contains(&0);
        own.ones |= mask.contains(&1);
        (!own.others).then_some(mask)
    }

    /// The group of a mask, which goes again if that turns out to be none.
    fn mask_slot(&mut self, of_cells: bool, dimension: u8, name: &str) -> usize {
        let known = self.slots.contains_key(&(dimension, name.to_owned()));
        let slot = self.slot(dimension, name);
        if !known {
            self.of_masks.insert(slot, (of_cells, name.to_owned()));
        }
        slot
    }

    /// Vertices of the groups that point arrays hold.
    fn add_point_groups(&mut self, piece: &Piece, base: usize) {
        for (name, array) in &piece.point_arrays {
            let (slot, values) = match (group_name(name), array.integers()) {
                (Some((dimension, name)), Some(values)) => {
                    (self.slot(dimension, name), Cow::Borrowed(values))
                }
                (Some(_), None) => continue,
                (None, _) => match self.mask(false, name, array) {
                    Some(mask) => (self.mask_slot(false, 0, name), mask),
                    None => continue,
                },
            };
            let members = values.iter().enumerate().filter(|&(_, &value)| value != 0);
            let group: &mut Group = &mut self.builder.mesh.groups[slot];
            group.vertices.extend(members.map(|(i, _)| (base + i) as u32));
        }
    }

    /// Cell arrays that are data and not groups; of several with one name the first.
    fn data_arrays<'p>(&self, piece: &'p Piece) -> Vec<(&'p str, &'p Array)> {
        let mut arrays: Vec<(&str, &Array)> = Vec::new();
        for (name, array) in &piece.cell_arrays {
            if group_name(name).is_none() && arrays.iter().all(|(known, _)| known != name) {
                arrays.push((name, array));
            }
        }
        arrays
    }

    /// Which group each value of a cell array stands for; `None` for arrays that are no regions.
    fn membership(&mut self, name: &str, values: &[i64]) -> Option<HashMap<i64, Membership>> {
        if let Some((dimension, name)) = group_name(name) {
            let slot = self.slot(dimension, name);
            let ones = values.iter().filter(|&&value| value != 0);
            return Some(ones.map(|&value| (value, Membership::Group(slot))).collect());
        }
        let mut regions = HashMap::new();
        for &value in values {
            if !regions.contains_key(&value) {
                if regions.len() == MOST_REGIONS {
                    return None;
                }
                regions.insert(value, Membership::Region(format!("{name} {value}")));
            }
        }
        Some(regions)
    }

    pub fn finish(self) -> Mesh {
        let Self { mut builder, masks, of_masks, .. } = self;
        let mut number = 0..;
        builder.mesh.groups.retain(|_| {
            let slot = number.next().unwrap_or_default();
            let mask = of_masks.get(&slot).and_then(|key| masks.get(key));
            mask.is_none_or(|own| own.zeros && own.ones && !own.others)
        });
        builder.finish()
    }
}

/// Whether an array is one of the three that a vector is kept as.
fn is_component(name: &str, arrays: &[(String, Array)]) -> bool {
    let of = ["_x", "_y", "_z"].into_iter().find_map(|end| name.strip_suffix(end));
    let known = |name: &String| arrays.iter().any(|(own, _)| own == name);
    of.is_some_and(|of| component_names(of).iter().all(known))
}

/// What a value of a cell array means.
enum Membership {
    /// Member of the region of that name, in the dimension of the cell.
    Region(String),
    /// Member of the mask of that name, likewise.
    Mask(String),
    /// Member of the group at that position.
    Group(usize),
}

/// Dimension and name of a group from the name of its array.
pub(crate) fn group_name(array: &str) -> Option<(u8, &str)> {
    let (dimension, name) = array.strip_prefix(GROUP_PREFIX)?.split_once(':')?;
    Some((dimension.parse().ok().filter(|&d| d <= 3)?, name))
}

/// Name of the arrays that hold a group.
pub(crate) fn array_name(group: &Group) -> String {
    format!("{GROUP_PREFIX}{}:{}", group.dimension, group.name)
}

/// Members as ones in an array of zeros.
pub(crate) fn mask(n: usize, members: impl Iterator<Item = usize>) -> Vec<u8> {
    let mut mask = vec![0; n];
    for member in members {
        if let Some(value) = mask.get_mut(member) {
            *value = 1;
        }
    }
    mask
}

/// The cells of a group as a mask over all cells in the order of the writers.
pub(crate) fn cell_mask(group: &Group, mesh: &Mesh) -> Vec<u8> {
    let of = |kind| mask(mesh.count(kind), group.cells[kind].iter().map(|&i| i as usize));
    ElementKind::IN_FILES.into_iter().flat_map(of).collect()
}

/// Adds an array of `components` numbers for each entity: one as it is, three under three names,
/// others not at all.
pub(crate) fn push_array(
    arrays: &mut Vec<(String, Array)>,
    name: String,
    components: u64,
    array: Array,
) {
    match (components, array) {
        (1, array) => arrays.push((name, array)),
        (3, Array::Reals(Located { values, place })) => {
            for (k, name) in component_names(&name).into_iter().enumerate() {
                let values = values.iter().skip(k).step_by(3).copied().collect();
                arrays.push((name, Array::Reals(Located { values, place })));
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_width_and_order() {
        assert_eq!(Number::Signed(1).integers(&[0xff], false), [-1]);
        assert_eq!(Number::Unsigned(1).integers(&[0xff], true), [255]);
        assert_eq!(Number::Signed(2).integers(&[0xff, 0xfe], true), [-2]);
        assert_eq!(Number::Signed(4).integers(&[1, 0, 0, 0], false), [1]);
        assert_eq!(Number::Unsigned(8).integers(&[0xff; 8], false), [i64::MAX]);
        assert_eq!(Number::Real(4).reals(&1.5f32.to_be_bytes(), true), [1.5]);
        assert_eq!(Number::Real(8).reals(&1e300f64.to_le_bytes(), false), [1e300]);
        assert_eq!(Number::Signed(8).reals(&(-3i64).to_le_bytes(), false), [-3.0]);
    }

    #[test]
    fn group_arrays_have_two_part_names() {
        assert_eq!(group_name("group:2:left:top"), Some((2, "left:top")));
        assert_eq!(group_name("group:9:x"), None);
        assert_eq!(group_name("region"), None);
    }
}
