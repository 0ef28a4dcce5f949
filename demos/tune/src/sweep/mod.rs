//! Many runs of one scene with other values: planned, run in parts anywhere, merged into one table.
//!
//! * [`plan`](fn@plan) reads a study file and writes the manifest: every run with its id, a hash of scene, meshes, parameters and
//!   engine version.
//! * [`run_shard`] runs a part of them, each on one thread. It may be killed at any moment: results are lines with
//!   checksums in files that only grow, and what is done is not done again.
//! * [`merge`](fn@merge) writes `table.csv` (and `table.parquet` with the cargo feature `parquet`) and a page. The bytes do not
//!   depend on how the runs were divided.
//! * [`status`], [`slurm`]: how far it is, and a script for Slurm.
//!
//! Who starts the parts is left to tools that do nothing else; `docs/sweep.md` has a line for each.

pub mod claim;
mod error;
mod hash;
mod manifest;
mod merge;
mod page;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod record;
mod run;
pub mod sampling;
mod study;
pub mod table;
mod template;

pub use claim::ClaimOptions;
pub use error::SweepError;
pub use manifest::{Header, Manifest, PlannedRun, SCHEMA, plan};
pub use merge::{Merged, merge};
pub use record::Shard;
pub use run::{ShardReport, ShardRequest, run_shard};
pub use study::Kept;

use error::Result;
use record::SweepResults;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// How far a sweep is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SweepStatus {
    /// Runs in the plan.
    pub runs: usize,
    /// Those with a result.
    pub done: usize,
    /// Those that failed.
    pub failed: usize,
    /// Those without a result.
    pub missing: usize,
    /// Lines of shard files that are not whole: processes that were killed while they wrote.
    pub damaged_lines: usize,
    /// Results of runs that are not in the plan.
    pub strangers: usize,
    /// Shards that processes hold, or held when they died.
    pub held: Vec<String>,
}

/// How far the sweep in a folder is.
///
/// # Errors
/// A folder without a plan, a file that cannot be read, two results of one run that differ.
pub fn status(folder: &Path) -> Result<SweepStatus> {
    let manifest = Manifest::read(folder)?;
    let results = SweepResults::read(folder, &manifest, None)?;
    let (runs, missing) = (manifest.runs.len(), results.missing().count());
    let held = record::held(folder)?;
    let held = held.into_iter().map(|(shard, holder)| format!("{shard}: {}", holder.name()));
    Ok(SweepStatus {
        runs,
        done: runs - missing,
        failed: results.failed(),
        missing,
        damaged_lines: results.damaged,
        strangers: results.strangers,
        held: held.collect(),
    })
}

impl fmt::Display for SweepStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { runs, done, failed, missing, damaged_lines, strangers, held } = self;
        writeln!(
            f,
            "{done} of {runs} runs have results, {failed} of them failed, {missing} are missing"
        )?;
        if *damaged_lines > 0 {
            writeln!(
                f,
                "{damaged_lines} lines are not whole and do not count: a process was killed while it wrote"
            )?;
        }
        if *strangers > 0 {
            writeln!(f, "{strangers} results are of runs that are not in the plan")?;
        }
        held.iter().try_for_each(|shard| {
            writeln!(f, "claimed, by a process that works or has died: {shard}")
        })
    }
}

/// A script for Slurm: an array of tasks that may be stopped and queued again.
///
/// # Errors
/// A folder without a plan, or 0 tasks or jobs.
pub fn slurm(folder: &Path, array: usize, per_task: usize) -> Result<String> {
    let manifest = Manifest::read(folder)?;
    if array == 0 || per_task == 0 {
        return Err(SweepError::Shard { found: format!("{array} tasks of {per_task} jobs") });
    }
    let folder = folder.canonicalize().map_err(error::io(folder))?;
    let quoted = format!("'{}'", folder.display().to_string().replace('\'', "'\\''"));
    Ok(format!(
        "#!/bin/bash\n\
         # {runs} runs in {array} tasks of {per_task} at a time. A task that is stopped, queued again or submitted again\n\
         # does only what is missing. Afterwards: sinew sweep merge {quoted}\n\
         #SBATCH --job-name=sinew-sweep\n\
         #SBATCH --array=0-{last}\n\
         #SBATCH --ntasks=1\n\
         #SBATCH --cpus-per-task={per_task}\n\
         #SBATCH --requeue\n\
         #SBATCH --open-mode=append\n\
         srun sinew sweep run {quoted} --shard \"$SLURM_ARRAY_TASK_ID/{array}\" --jobs {per_task} --wait\n\
         code=$?\n\
         # 3: all was done and some runs failed, which the table tells\n\
         [ $code -eq 3 ] && exit 0\n\
         exit $code\n",
        runs = manifest.runs.len(),
        last = array - 1,
    ))
}
