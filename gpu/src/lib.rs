//! Forces and steps of Sinew on any graphics processor that `wgpu` reaches.
pub mod backend;
mod body;
mod context;
mod elements;
mod error;
pub mod laws;
mod matrix;
pub mod report;
mod safe;
pub mod sources;

pub use backend::{GpuBackend, GpuOptions, check, install_gpu};
pub use error::GpuError;
pub use report::GpuReport;
