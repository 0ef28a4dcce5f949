//! Pictures, films and pages of a run, without a window.
//!
//! Without the feature `draw` there are pages only, which need no graphics driver.
//!
//! Everything is drawn from plain data, a [`scene::Recording`], which the program that steps a simulation fills. Nothing
//! here knows laws, integrators or entities.
//!
//! * [`skin`]: surfaces with smooth normals and sharp edges.
//! * [`rigid`], [`solids`]: shapes of tools; balls, rods and cones.
//! * [`camera`]: a camera that fits the whole run.
//! * [`colour`], [`scale`]: colour maps; marks, units and numbers in words.
//! * [`look`]: what is shown, and where the ground is.
//! * [`overlay`]: text and colour bars.
//! * [`renderer`]: frames to pixels through `wgpu`, several in flight.
//! * [`painter`]: frames with captions.
//! * [`compare`](mod@compare): several runs in one picture.
//! * [`page`]: a page with an interactive player.
//! * [`image`], [`film`]: PNG files and films.

pub mod camera;
pub mod colour;
#[cfg(feature = "draw")]
pub mod compare;
pub mod error;
#[cfg(feature = "draw")]
pub mod film;
#[cfg(feature = "draw")]
pub mod image;
pub mod look;
#[cfg(feature = "draw")]
pub mod overlay;
pub mod page;
#[cfg(feature = "draw")]
pub mod painter;
#[cfg(feature = "draw")]
mod pipelines;
#[cfg(feature = "draw")]
pub mod renderer;
pub mod rigid;
pub mod scale;
pub mod scene;
pub mod skin;
#[cfg(feature = "draw")]
pub mod solids;

pub use error::RenderError;
#[cfg(feature = "draw")]
pub use sinew_adapter as adapter;
