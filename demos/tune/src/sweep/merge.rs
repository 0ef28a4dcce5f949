//! One table of all results.

use super::error::{Result, SweepError};
use super::manifest::{Manifest, write_whole};
use super::page::page;
use super::record::SweepResults;
use super::table::SweepTable;
use std::path::{Path, PathBuf};

/// What merging made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Merged {
    /// Runs.
    pub runs: usize,
    /// Those that failed.
    pub failed: usize,
    /// Those without a result.
    pub missing: usize,
    /// Files written.
    pub files: Vec<PathBuf>,
}

/// Writes `table.csv` and `sweep.html`, and `table.parquet` in a build with that feature, into the folder of a sweep.
///
/// The bytes do not depend on how the runs were divided.
///
/// # Errors
/// [`SweepError::Incomplete`] unless `partial`, [`SweepError::Conflict`], or a file that cannot be read or written.
pub fn merge(folder: &Path, partial: bool) -> Result<Merged> {
    let manifest = Manifest::read(folder)?;
    let results = SweepResults::read(folder, &manifest, None)?;
    let (runs, missing) = (manifest.runs.len(), results.missing().count());
    if let Some(first) = results.missing().next().filter(|_| !partial) {
        return Err(SweepError::Incomplete { missing, runs, first });
    }
    let failed = results.failed();
    let table = SweepTable::new(&manifest, &results.rows);
    drop(results);
    let mut files = vec![folder.join("table.csv")];
    let csv = table.cells.csv().map_err(|error| SweepError::Table {
        path: files[0].clone(),
        message: error.to_string(),
    })?;
    write_whole(&files[0], &csv)?;
    #[cfg(feature = "parquet")]
    {
        let path = folder.join("table.parquet");
        write_whole(&path, &super::parquet::bytes(&table, &path)?)?;
        files.push(path);
    }
    let path = folder.join("sweep.html");
    write_whole(&path, page(&manifest, &table, [failed, missing]).as_bytes())?;
    files.push(path);
    Ok(Merged { runs, failed, missing, files })
}
