//! Pictures, films and pages of a run, without a window.
//!
//! Everything is drawn from plain data, a [`scene::Recording`], which the program that steps a simulation fills. Nothing
//! here knows laws, integrators or entities.
//!
//! * [`skin`]: surfaces with smooth normals and sharp edges.
//! * [`rigid`], [`solids`]: shapes of tools; balls, rods and cones.
//! * [`camera`]: a camera that fits the whole run.
//! * [`colour`], [`overlay`]: colour maps, text and colour bars.
//! * [`renderer`]: frames to pixels through `wgpu`, several in flight.
//! * [`painter`]: frames with captions.
//! * [`compare`](mod@compare): several runs in one picture.
//! * [`page`]: a page with an interactive player.
//! * [`image`], [`film`]: PNG files and films.

pub mod camera;
pub mod colour;
pub mod compare;
pub mod error;
pub mod film;
pub mod image;
pub mod overlay;
pub mod page;
pub mod painter;
mod pipelines;
pub mod renderer;
pub mod rigid;
pub mod scene;
pub mod skin;
pub mod solids;

pub use error::RenderError;
pub use sinew_adapter as adapter;
