//! Logs of runs, and repeating them.

use super::RunError;
use crate::assemble::{BuildOptions, build};
use crate::scene::LoadedScene;
use serde::{Deserialize, Serialize};
use sinew::models::body::{Evaluation, Model};
use sinew::replay::{Repeated, Replay};
use sinew::simulation::Simulation;
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::{Path, PathBuf};

/// Where the log of a run goes.
#[derive(Clone, Debug)]
pub struct LogOptions {
    /// The file.
    pub path: PathBuf,
    /// Steps between hashes.
    pub hash_every: u64,
}

/// What a log says of its scene.
#[derive(Serialize, Deserialize)]
struct About {
    /// Path of the scene, beside which its meshes are.
    file: PathBuf,
    /// The scene as it was read.
    text: String,
    /// Energy and evaluation of every body, which options of the command may have replaced; what else they replace is
    /// in the state that the log begins with.
    bodies: Vec<(Model, Evaluation)>,
}

/// Begins the log of a run.
///
/// # Errors
/// When the file cannot be made.
pub(super) fn begin(
    loaded: &LoadedScene,
    simulation: &mut Simulation,
    options: &LogOptions,
) -> Result<(), RunError> {
    let error = |source| RunError::Write { path: options.path.clone(), source };
    let bodies = loaded.scene.bodies.iter().map(|body| (body.model, body.evaluation)).collect();
    let about = About { file: loaded.file.clone(), text: loaded.text.to_string(), bodies };
    let about = serde_json::to_string(&about).map_err(|e| error(e.into()))?;
    let out = BufWriter::new(File::create(&options.path).map_err(error)?);
    simulation.record(Box::new(out), options.hash_every, &about)?;
    Ok(())
}

/// Repeats a log and compares every hash in it. `scene` is where the scene file is now, if it has moved; `threads` as in
/// scenes.
///
/// # Errors
/// When the scene cannot be built or is another one, and at the first difference.
pub fn replay(
    path: &Path,
    scene: Option<&Path>,
    threads: Option<usize>,
) -> Result<Repeated, RunError> {
    let file = File::open(path).map_err(|source| RunError::Read { path: path.into(), source })?;
    let log = |source| RunError::Log { path: path.into(), source: Box::new(source) };
    let replay = Replay::new(BufReader::new(file)).map_err(log)?;
    let about: About = serde_json::from_str(replay.about()).map_err(|_| RunError::Checkpoint {
        path: path.into(),
        message: "it does not say which scene it is of: it was recorded by a program, which alone can \
                  build the simulation again",
    })?;
    let mut loaded = LoadedScene::parse(&about.text, scene.unwrap_or(&about.file))?;
    for (body, (model, evaluation)) in loaded.scene.bodies.iter_mut().zip(about.bodies) {
        (body.model, body.evaluation) = (model, evaluation);
    }
    let header = replay.start().header();
    let options = BuildOptions {
        precision: Some(header.precision),
        instruction_set: Some(header.instruction_set),
        threads,
        ..BuildOptions::default()
    };
    let mut built = build(&loaded, &options)?;
    replay.run(&mut built.simulation).map_err(log)
}
