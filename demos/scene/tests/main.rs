//! Scene files and what runs them. In one binary: each would link, and in part compile, everything below for itself.

mod bad_scenes;
mod boundary;
mod cell_springs;
mod checkpoints;
mod common;
mod figures;
mod fuzz;
#[cfg(feature = "gpu")]
mod gpu_scenes;
mod keys;
mod lattice;
#[cfg(feature = "render")]
mod live;
mod material_fields;
mod measure;
mod modes;
mod new_scene;
#[cfg(feature = "render")]
mod pictures;
mod read;
mod removal;
mod scenes;
mod summary;
mod text;
mod tools;
mod touch;
mod truth;
mod what_acts;
