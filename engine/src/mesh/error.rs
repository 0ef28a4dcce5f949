//! What can go wrong while a mesh is read, written or generated.

use crate::memory::TooLarge;
use std::fmt;

/// Where in a file a reader stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line number, counted from 1 (text files).
    Line(usize),
    /// Byte offset from the start of the file (binary files).
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(offset) => write!(f, "byte offset {offset}"),
        }
    }
}

/// Error of a mesh reader, writer or generator; the message says where, what and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The operating system refused to open, read or write a file.
    #[error("{path}: {source}; check that the path exists and may be accessed")]
    Io {
        /// Path of the file.
        path: String,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A mesh of several files was given as one.
    #[error(
        "{file}: a TetGen mesh is a .node and an .ele file, one alone is no mesh; \
         read both with `Mesh::read_with`"
    )]
    SeveralFiles {
        /// Name of the file.
        file: String,
    },
    /// Neither extension nor content tells the file format.
    #[error(
        "{file}: unknown mesh format by its extension and its first characters; \
         use Gmsh (.msh), VTK (.vtk, .vtu), TetGen (.node and .ele), .obj or .stl"
    )]
    UnknownFormat {
        // nothing of its content, which may be a file that the author of a scene must not see
        /// Name of the file.
        file: String,
    },
    /// A file cannot be read on from some place.
    #[error("{file}, {place}: {problem}")]
    File {
        /// Name of the file.
        file: String,
        /// Where.
        place: Place,
        /// Why.
        problem: FileProblem,
    },
    /// More vertices or cells than 32-bit indices or the memory hold.
    #[error("{file}: {count} {what} are too many (at most {limit}); use a coarser mesh")]
    TooMany {
        /// Name of the file or generator.
        file: String,
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// The largest number that works.
        limit: u64,
    },
    /// It needs more memory than there is.
    #[error(transparent)]
    TooLarge(#[from] TooLarge),
    /// A parameter of a generator lies outside its range.
    #[error("{generator}: {parameter} = {value} is not valid; {remedy}")]
    InvalidParameter {
        /// Name of the generator.
        generator: &'static str,
        /// Name of the parameter.
        parameter: &'static str,
        /// The value given.
        value: String,
        /// Which values are valid.
        remedy: &'static str,
    },
    /// A surface that should enclose a body has holes.
    #[error(
        "{file}: the surface is not closed: {count} edges belong to an odd number of triangles, the first from {:?} to {:?} m; \
         close it where it was modelled, or join its seams with `sinew mesh merge`", .ends[0], .ends[1]
    )]
    Open {
        /// Name of the file or generator.
        file: String,
        /// Such edges.
        count: usize,
        /// Ends (m) of the first.
        ends: [[f64; 3]; 2],
    },
    /// No cell of a lattice is filled.
    #[error(
        "{file}: cells of {cell} m are not filled; give a closed surface, and smaller cells than it is thick"
    )]
    NothingInside {
        /// Name of the file or generator.
        file: String,
        /// Edge of the cells (m).
        cell: f64,
    },
    /// Data handed to a writer do not fit the mesh.
    #[error("{what}: {found} values for {expected} {entities}; give one value for each")]
    LengthMismatch {
        /// Name of the data.
        what: String,
        /// What the values belong to.
        entities: &'static str,
        /// How many values there should be.
        expected: usize,
        /// How many values were given.
        found: usize,
    },
}

/// What is wrong with a file at some place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// The file is sound as far as known, but uses a feature that no reader here understands.
    #[error("{feature} is not supported; {remedy}")]
    Unsupported {
        /// The feature and its value in the file.
        feature: String,
        /// What to do instead.
        remedy: &'static str,
    },
    /// The file stops before its contents are complete.
    #[error(
        "the file ends where {expected} should follow; \
         it was probably cut off, export or copy it again"
    )]
    UnexpectedEnd {
        /// What should have followed.
        expected: String,
    },
    /// A value that cannot stand where it does, such as text in place of a number.
    #[error("found `{found}` where {expected} should stand; correct or export the file again")]
    InvalidValue {
        /// The value as in the file, shortened.
        found: String,
        /// What should have stood there.
        expected: String,
    },
    /// A count in the file disagrees with what is there.
    #[error(
        "{what} should be {expected} but is {found}; correct the count or export the file again"
    )]
    CountMismatch {
        /// What was counted.
        what: String,
        /// The count that the file announces.
        expected: u64,
        /// The count that was found.
        found: u64,
    },
    /// A cell uses a vertex that the file does not define.
    #[error(
        "{cell} uses vertex {vertex}, which the file does not define; \
         check whether the vertex numbers start at 0 or 1, or export the file again"
    )]
    UnknownVertex {
        /// The cell, by kind and number.
        cell: String,
        /// The vertex number in the file.
        vertex: i64,
    },
    /// Two vertices of a file carry the same number.
    #[error("vertex number {number} is used twice; renumber the vertices")]
    RepeatedNumber {
        /// The number.
        number: i64,
    },
    /// A part without which the file is no mesh is absent.
    #[error("the file ends without {section}; it is incomplete, export it again")]
    MissingSection {
        /// The missing part.
        section: &'static str,
    },
    /// Base64 or zlib data that cannot be decoded.
    #[error("{reason}; the file is damaged or was changed as text, export or copy it again")]
    Encoding {
        /// What is wrong with them.
        reason: String,
    },
}

impl FileProblem {
    pub(crate) fn invalid(found: &[u8], expected: &str) -> Self {
        Self::InvalidValue { found: shown(found), expected: expected.to_owned() }
    }

    pub(crate) fn mismatch(what: &str, expected: u64, found: u64) -> Self {
        Self::CountMismatch { what: what.to_owned(), expected, found }
    }
}

/// A piece of a file as text for a message, at most 40 characters.
pub(crate) fn shown(bytes: &[u8]) -> String {
    shown_up_to(40, bytes)
}

/// Likewise, with so many characters.
pub(crate) fn shown_up_to(most: usize, bytes: &[u8]) -> String {
    let cut = &bytes[..bytes.len().min(5 * most)];
    let text: String = String::from_utf8_lossy(cut)
        .chars()
        .take(most + 1)
        .map(|c| if c.is_control() { '.' } else { c })
        .collect();
    if text.chars().count() > most || bytes.len() > 5 * most {
        let mut short: String = text.chars().take(most).collect();
        short.push_str("...");
        short
    } else {
        text
    }
}
