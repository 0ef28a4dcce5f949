//! Checkpoints: all that a run needs to go on after its process has died, so that what it writes is what it would have
//! written otherwise, host times aside.

use super::SceneRun;
use super::totals::Totals;
use crate::assemble::{BuiltScene, SceneSnapshot};
use crate::error::RunError;
use crate::output::{WriterState, checkpoints};
use crate::scene::LoadedScene;
use crate::summary::ForceSummary;
use serde::{Deserialize, Serialize};
use sinew::snapshot::checksum;
use std::path::{Path, PathBuf};

/// What is in a checkpoint.
#[derive(Serialize, Deserialize)]
pub(super) struct RunState {
    /// Of the scene, as far as results depend on it.
    scene: u64,
    /// Steps done.
    pub done: u64,
    totals: Totals,
    /// What summaries leave out where there is none of it.
    parts: Vec<Vec<ForceSummary>>,
    probes: Vec<f64>,
    pub writer: WriterState,
    snapshot: Vec<u8>,
}

/// Checkpoints that a run leaves lie.
const KEPT: usize = 2;

/// Where checkpoints go, and when.
pub(super) struct Checkpoints {
    folder: PathBuf,
    every: u64,
    scene: u64,
}

impl Checkpoints {
    /// One every `interval` of simulated time (s), rounded to whole steps.
    ///
    /// # Errors
    /// When there is no folder, or the interval is no time.
    pub fn new(
        interval: f64,
        folder: Option<&Path>,
        loaded: &LoadedScene,
        built: &mut BuiltScene,
    ) -> Result<Self, RunError> {
        let option = "--checkpoint";
        let Some(folder) = folder else {
            let (found, remedy) = ("no folder for them".into(), "give --out DIR as well");
            return Err(RunError::Option { option, found, remedy });
        };
        if !(interval > 0.0 && interval.is_finite()) {
            let found = format!("{interval} s between checkpoints");
            return Err(RunError::Option { option, found, remedy: "give a positive time" });
        }
        // refused now rather than at the first checkpoint
        built.snapshot()?;
        let every = (interval / built.plan.dt).round().clamp(1.0, 1e15) as u64;
        Ok(Self { folder: folder.to_path_buf(), every, scene: scene_number(loaded, built) })
    }

    /// Writes a checkpoint after step `done` if one is due, whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn after_step(&self, run: &mut SceneRun, done: u64) -> Result<(), RunError> {
        if !done.is_multiple_of(self.every) {
            return Ok(());
        }
        let state = run.state(self.scene, done)?;
        let mut bytes = postcard::to_stdvec(&state).map_err(|_| RunError::Checkpoint {
            path: self.folder.clone(),
            message: "the state of the run cannot be stored",
        })?;
        bytes.extend(checksum(&bytes).to_le_bytes());
        let partial = self.folder.join("checkpoint.unfinished");
        let path = self.folder.join(format!("checkpoint-{done:010}.sinew"));
        let written = std::fs::File::create(&partial).and_then(|mut file| {
            std::io::Write::write_all(&mut file, &bytes)?;
            file.sync_all()
        });
        let written = written.and_then(|()| std::fs::rename(&partial, &path));
        written.map_err(|source| RunError::Write { path: path.clone(), source })?;
        let all = checkpoints(&self.folder);
        for (_, old) in all.iter().take(all.len().saturating_sub(KEPT)) {
            // one that stays does no harm
            let _ = std::fs::remove_file(old);
        }
        Ok(())
    }

    /// Takes the checkpoints of a run away that came to its end.
    pub fn remove(&self) {
        for (_, path) in checkpoints(&self.folder) {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A number of the scene as it was written, with what options of the command replace of it, but for what results do not
/// depend on.
fn scene_number(loaded: &LoadedScene, built: &BuiltScene) -> u64 {
    let bodies: Vec<_> =
        loaded.scene.bodies.iter().map(|b| (b.model, b.evaluation, b.volume)).collect();
    let plan = (built.plan.dt, &built.plan.settings, built.simulation.precision());
    checksum(format!("{} {bodies:?} {plan:?}", loaded.text).as_bytes())
}

/// The last checkpoint of a run in a folder; `None` where there is none. Damaged ones are passed over, and their paths
/// told.
///
/// # Errors
/// When it belongs to another scene.
pub(super) fn last(
    folder: &Path,
    loaded: &LoadedScene,
    built: &BuiltScene,
) -> Result<(Option<RunState>, Vec<PathBuf>), RunError> {
    let mut damaged = Vec::new();
    for (_, path) in checkpoints(folder).into_iter().rev() {
        let bytes =
            std::fs::read(&path).map_err(|source| RunError::Read { path: path.clone(), source })?;
        let state = bytes.split_last_chunk().and_then(|(state, sum)| {
            let whole = checksum(state) == u64::from_le_bytes(*sum);
            postcard::from_bytes::<RunState>(state).ok().filter(|_| whole)
        });
        match state {
            Some(state) if state.scene != scene_number(loaded, built) => {
                let message = "it belongs to another scene, or to other options of the command: give \
                               those that the run was begun with, or another folder";
                return Err(RunError::Checkpoint { path, message });
            }
            Some(state) => return Ok((Some(state), damaged)),
            None => damaged.push(path),
        }
    }
    Ok((None, damaged))
}

impl RunState {
    /// Brings a scene to where the run was; returns its sums and the last values of its probes.
    ///
    /// # Errors
    /// When the snapshot does not fit.
    pub fn resume(self, built: &mut BuiltScene) -> Result<(Totals, Vec<f64>), RunError> {
        built.restore(&SceneSnapshot::from_bytes(&self.snapshot)?)?;
        let mut totals = self.totals;
        for (tool, parts) in totals.touched.iter_mut().flat_map(|t| &mut t.tools).zip(self.parts) {
            tool.parts = parts;
        }
        Ok((totals, self.probes))
    }
}

impl SceneRun<'_> {
    fn state(&mut self, scene: u64, done: u64) -> Result<RunState, RunError> {
        let mut totals = self.totals.clone();
        let tools = totals.touched.iter_mut().flat_map(|touched| &mut touched.tools);
        let parts = tools.map(|tool| std::mem::take(&mut tool.parts)).collect();
        Ok(RunState {
            scene,
            done,
            totals,
            parts,
            probes: self.probes.clone(),
            writer: self.writer.as_ref().map(|writer| writer.state()).unwrap_or_default(),
            snapshot: self.built.snapshot()?.to_bytes(),
        })
    }
}
