//! Scene files, the runner behind `sinew run`, and the reports it prints.
//!
//! ```no_run
//! use sinew_scene::{run::{RunOptions, Silent, run}, scene::LoadedScene};
//!
//! let scene = LoadedScene::read("demos/scenes/cantilever.toml".as_ref())?;
//! let summary = run(&scene, &RunOptions::default(), &mut Silent)?;
//! println!("{summary}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! * [`scene`]: what a scene file may hold, and reading it with file, line and hint in every error.
//! * [`assemble`]: from a scene to a [`sinew::simulation::Simulation`], with everything that
//!   was found on the way.
//! * [`probe`]: what probes can record, as a table.
//! * [`run`](mod@run): the loop over steps, with an observer for progress.
//! * [`output`]: VTU frames, their PVD index and the CSV of probes.
//! * [`summary`]: what a run reports, as data and as text.
//! * [`text`]: numbers and hints in words.
//! * [`picture`]: pages of runs; pictures and films with the feature `render`.
//! * [`schema`](mod@schema): the JSON schema of scene files, as the reader knows it.
//! * [`new_scene`]: a first scene for a mesh of one's own.
//! * [`check`], [`mesh_tool`], [`fill`](mod@fill), [`validate`](mod@validate): the other subcommands.
//! * [`modes`](mod@modes): modes of free vibration.

pub mod assemble;
pub mod cell_springs;
pub mod check;
pub mod error;
pub mod fill;
pub mod mesh_tool;
pub mod modes;
pub mod new_scene;
pub mod output;
pub mod picture;
pub mod probe;
pub mod run;
pub mod scene;
pub mod schema;
pub mod springs;
pub mod summary;
pub mod text;
pub mod validate;

pub use sinew::warning;

use std::path::PathBuf;

/// Folder of the scenes that come with Sinew.
pub fn scene_folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../scenes")
}

/// Path of a scene that comes with Sinew, such as `"cantilever"`.
pub fn shipped_scene(name: &str) -> PathBuf {
    scene_folder().join(format!("{name}.toml"))
}
