//! What can be wrong with a sweep.

use sinew_scene::error::SceneError;
use std::path::{Path, PathBuf};

/// What may fail in a sweep.
pub type Result<T, E = SweepError> = std::result::Result<T, E>;

/// A sweep that cannot be planned, run or merged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// A file cannot be read or written.
    #[error("{path}: {source}; check that the path exists, may be read and written, and has room")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A study file that is not TOML, has an unknown key, or a value of the wrong type.
    #[error("{file}, line {line}: {message}; docs/sweep.md lists every key of a study")]
    Syntax {
        /// The study file.
        file: PathBuf,
        /// Line, counted from 1.
        line: usize,
        /// What the parser said.
        message: String,
    },
    /// A parameter, or another entry of a study or of its list.
    #[error("{file}{}, `{key}`: {found}; {remedy}", line.map_or(String::new(), |n| format!(", line {n}")))]
    Entry {
        /// The study file or its list.
        file: PathBuf,
        /// Line, counted from 1.
        line: Option<usize>,
        /// The key.
        key: String,
        /// What was given.
        found: String,
        /// What is valid.
        remedy: String,
    },
    /// The scene as it stands cannot be simulated.
    #[error("the scene of the sweep cannot be run as it stands: {0}")]
    Scene(#[from] SceneError),
    /// A scene or mesh that is not the one that was planned.
    #[error(
        "{path}: changed since the sweep was planned; take the old file back, or plan again (results of runs \
         that the change does not touch are kept)"
    )]
    Changed {
        /// The file.
        path: PathBuf,
    },
    /// Another version of the engine.
    #[error(
        "{folder}: planned with {planned}, this is {own}; run all shards with one version, or plan again with this one"
    )]
    Engine {
        /// Folder of the sweep.
        folder: PathBuf,
        /// Version that planned.
        planned: String,
        /// Version of this program.
        own: String,
    },
    /// Instructions that this machine lacks.
    #[error(
        "planned for the instruction set `{set}`, which this machine does not have; plan on the least of the machines, \
         or set instruction_set = \"portable\" in the scene, which gives the same bits everywhere"
    )]
    InstructionSet {
        /// The set.
        set: String,
    },
    /// A folder without a usable plan.
    #[error("{folder}: {found}; make it with `sinew sweep plan STUDY.toml --out {folder}`")]
    NoPlan {
        /// Folder of the sweep.
        folder: PathBuf,
        /// What is wrong with its manifest.
        found: String,
    },
    /// A shard that does not exist.
    #[error("shard {found}; give index/count with an index from 0 to count - 1, for example 3/40")]
    Shard {
        /// What was given.
        found: String,
    },
    /// Another process works on the shard.
    #[error(
        "shard {shard} is being run by {holder}; let it finish, wait for it with --wait, or choose another shard"
    )]
    Claimed {
        /// The shard.
        shard: String,
        /// Who holds it.
        holder: String,
    },
    /// Another process took the shard over because this one showed no life.
    #[error(
        "shard {shard} was taken over by another process while this one stood still; nothing is lost, that one goes on"
    )]
    TakenOver {
        /// The shard.
        shard: String,
    },
    /// Runs without a result.
    #[error(
        "{missing} of {runs} runs have no result yet, the first is run {first}; run their shards, or merge with --partial"
    )]
    Incomplete {
        /// Runs without a result.
        missing: usize,
        /// All runs.
        runs: usize,
        /// Index of the first without.
        first: usize,
    },
    /// Two results of one run that differ.
    #[error(
        "run {index} ({id}) has two results that differ, {difference}; machines or builds differ: set \
         instruction_set = \"portable\" in the scene, use one build, and delete the shard files of the wrong one"
    )]
    Conflict {
        /// Index of the run.
        index: usize,
        /// Its id.
        id: String,
        /// The first difference.
        difference: String,
    },
    /// A table that cannot be written.
    #[error("{path}: {message}")]
    Table {
        /// The file.
        path: PathBuf,
        /// What the writer said.
        message: String,
    },
}

impl SweepError {
    /// An entry of a file that cannot be used.
    pub(super) fn entry(
        file: &Path,
        line: Option<usize>,
        key: &str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (file, key, found, remedy) = (file.into(), key.into(), found.into(), remedy.into());
        Self::Entry { file, line, key, found, remedy }
    }
}

/// An error about a file.
pub(super) fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> SweepError {
    let path = path.into();
    |source| SweepError::Io { path, source }
}
