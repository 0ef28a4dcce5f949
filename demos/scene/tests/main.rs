//! Scene files and what runs them. In one binary: each would link, and in part compile, everything below for itself.

mod bad_scenes;
mod checkpoints;
mod common;
mod fuzz;
#[cfg(feature = "gpu")]
mod gpu_scenes;
mod material_fields;
#[cfg(feature = "render")]
mod pictures;
mod scenes;
mod tools;
mod touch;
mod truth;
