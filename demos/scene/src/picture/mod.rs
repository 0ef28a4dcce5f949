//! Pictures, films and pages of a scene (feature `render`).

mod boundary;
mod capture;
mod gallery;
mod job;
mod measure;
mod quantity;
mod tools;

pub use boundary::{Face, boundary};
pub use capture::{CaptureOptions, Recorder};
pub use gallery::gallery;
pub use job::{RenderJob, RenderJobError, RenderReport, Variant, nearest, record, render};
pub use measure::{Measures, measures, sheet_measures};
pub use quantity::Quantity;
