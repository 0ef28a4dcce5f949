//! Pages of scenes; with the feature `render` pictures and films as well.

mod boundary;
mod capture;
#[cfg(feature = "render")]
mod draw;
mod figures;
mod gallery;
mod job;
#[cfg(feature = "render")]
mod live;
mod measure;
mod quantity;
mod tools;
mod wound;

pub use boundary::{Face, boundary};
pub use capture::{CaptureOptions, Recorder};
pub use figures::{FIGURES, GalleryFigures, SceneFigures, checksum, scenes_table, with_block};
#[cfg(feature = "render")]
pub use gallery::gallery;
pub use gallery::{GalleryEntry, gallery_page};
pub use job::{
    RenderJob, RenderJobError, RenderReport, Variant, nearest, page_beside, record, render,
    run_to_page,
};
#[cfg(feature = "render")]
pub use live::{LiveOptions, LiveView};
pub use measure::{Measures, measures, sheet_measures};
pub use quantity::Quantity;
