//! What can go wrong on the way to a picture.

#[cfg(feature = "draw")]
use sinew_adapter::AdapterError;
use std::path::PathBuf;

/// A picture, film or page that could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// No adapter could be opened.
    #[cfg(feature = "draw")]
    #[error(transparent)]
    Adapter(#[from] AdapterError),
    /// Pictures were asked of a build that makes pages only.
    #[error(
        "{0}: this build makes pages (--html), no pictures; build it with `--features sinew-cli/render` for these"
    )]
    NoPictures(&'static str),
    /// The size of a picture is out of range.
    #[error("a picture of {width} x {height} pixels; {remedy}")]
    Size {
        /// Width (pixels).
        width: u32,
        /// Height (pixels).
        height: u32,
        /// What is possible.
        remedy: String,
    },
    /// The device lost its memory or stopped answering.
    #[error("the graphics device failed: {0}; try a smaller --size or another --adapter")]
    Device(String),
    /// An index beyond the points of a frame.
    #[error("frame {frame}: {what} {index} does not exist, there are {count}")]
    Index {
        /// The frame, counted from 0.
        frame: usize,
        /// What was referred to.
        what: &'static str,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// Nothing to draw.
    #[error("there is nothing to draw: {0}")]
    Empty(String),
    /// A word that is not understood.
    #[error("{option}: `{found}` is not understood; {remedy}")]
    Option {
        /// What was set.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is possible.
        remedy: String,
    },
    /// A file that could not be written.
    #[error("{path}: {reason}; check that the folder exists and may be written to")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// The encoder of films stopped.
    #[error(
        "ffmpeg could not encode {path}: {reason}; check that the folder exists and that ffmpeg knows the ending of the file"
    )]
    Film {
        /// The film.
        path: PathBuf,
        /// What it said.
        reason: String,
    },
}
