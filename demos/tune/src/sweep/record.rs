//! Results of runs: append-only files with one line a run.

use super::claim;
use super::error::{Result, SweepError, io};
use super::hash::Hash;
use super::manifest::Manifest;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

/// Part of the runs: those whose index is `index` modulo `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0 to `count - 1`.
    pub index: usize,
    /// Number of shards.
    pub count: usize,
}

impl std::str::FromStr for Shard {
    type Err = SweepError;

    /// Reads `3/40`.
    fn from_str(text: &str) -> Result<Self> {
        let parts =
            text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if index < count => Ok(Self { index, count }),
            _ => Err(SweepError::Shard { found: format!("`{text}`") }),
        }
    }
}

impl Shard {
    /// Name of its files.
    pub(super) fn name(self) -> String {
        format!("{}-of-{}", self.index, self.count)
    }

    /// Whether it holds a run.
    pub fn holds(self, index: usize) -> bool {
        index % self.count == self.index
    }
}

/// Result of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepRow {
    /// Id of the run.
    pub id: String,
    /// How often a failure was tried again before; the last counts.
    pub attempt: u32,
    /// Why it failed, if it did.
    pub error: Option<String>,
    /// Codes of warnings.
    pub warnings: String,
    /// Steps carried out.
    pub steps: u64,
    /// Hash of the state at the end; empty where there was none.
    pub state: String,
    /// Values of the probes; `null` for what is not finite.
    pub values: Vec<Option<f64>>,
    /// Length (bytes) of the file with all rows.
    pub file: Option<u64>,
}

#[derive(Serialize, Deserialize)]
struct Begun {
    begun: String,
}

/// A line with its checksum as the last entry.
pub fn line(value: &impl Serialize) -> String {
    let mut text = serde_json::to_string(value).unwrap_or_default();
    text.pop();
    let check = Hash::of(&text).short();
    text + ",\"check\":\"" + &check + "\"}\n"
}

/// What a line holds without its checksum; `None` when it is not as it was written.
pub fn checked(line: &[u8]) -> Option<String> {
    let line = std::str::from_utf8(line).ok()?.strip_suffix("\"}\n")?;
    let (text, check) = line.rsplit_once(",\"check\":\"")?;
    (Hash::of(text).short() == check).then(|| format!("{text}}}"))
}

/// File of all rows of a run.
pub(super) fn rows_path(folder: &Path, id: &str) -> PathBuf {
    folder.join(format!("runs/{id}.csv"))
}

/// The file of one process.
pub(super) struct ShardFile {
    path: PathBuf,
    file: File,
    /// Length of its whole lines (bytes).
    length: u64,
    /// Whether lines may not be on the disk yet.
    pub unsynced: bool,
}

impl ShardFile {
    /// Makes the file of a claim, which no other process has.
    pub fn new(folder: &Path, shard: Shard, claim: u32) -> Result<Self> {
        let shards = folder.join("shards");
        std::fs::create_dir_all(&shards).map_err(io(&shards))?;
        let path = shards.join(format!("{}.{claim}.jsonl", shard.name()));
        let file = File::options().append(true).create(true).open(&path).map_err(io(&path))?;
        Ok(Self { path, file, length: 0, unsynced: false })
    }

    fn append(&mut self, text: &str) -> Result<()> {
        self.file.write_all(text.as_bytes()).map_err(|source| {
            // half a line would spoil the next; the disk may be full, and the error is told anyway
            let _ = self.file.set_len(self.length);
            io(&self.path)(source)
        })?;
        self.length += text.len() as u64;
        self.unsynced = true;
        Ok(())
    }

    /// Notes that a run begins: should the process die in it, the next one does others first.
    pub fn begin(&mut self, id: &str) -> Result<()> {
        self.append(&line(&Begun { begun: id.into() }))
    }

    /// Adds a result.
    pub fn end(&mut self, row: &SweepRow) -> Result<()> {
        self.append(&line(row))
    }

    /// Brings what was added onto the disk.
    pub fn sync(&mut self) -> Result<()> {
        self.unsynced = false;
        self.file.sync_data().map_err(io(&self.path))
    }
}

/// What the files of a sweep hold.
pub struct SweepResults {
    /// A place for every run.
    pub rows: Vec<Option<SweepRow>>,
    /// How often each run was begun.
    pub begun: Vec<u32>,
    /// Lines that are not whole.
    pub damaged: usize,
    /// Results of runs that are not in the plan.
    pub strangers: usize,
}

impl SweepResults {
    /// Reads all results; with a shard, those that may hold runs of it.
    ///
    /// # Errors
    /// [`SweepError::Conflict`], or a file that cannot be read.
    pub fn read(folder: &Path, manifest: &Manifest, only: Option<Shard>) -> Result<Self> {
        let ids = manifest.by_id();
        let runs = manifest.runs.len();
        let mut results =
            Self { rows: vec![None; runs], begun: vec![0; runs], damaged: 0, strangers: 0 };
        for path in files(&folder.join("shards"))? {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            let foreign = |shard: Shard| {
                name.split_once('.').is_some_and(|(own, _)| {
                    own != shard.name() && own.ends_with(&format!("-of-{}", shard.count))
                })
            };
            if !name.ends_with(".jsonl") || only.is_some_and(foreign) {
                continue;
            }
            let mut reader = BufReader::new(File::open(&path).map_err(io(&path))?);
            let mut bytes = Vec::new();
            while reader.read_until(b'\n', &mut bytes).map_err(io(&path))? > 0 {
                results.add(folder, &bytes, &ids)?;
                bytes.clear();
            }
        }
        Ok(results)
    }

    fn add(
        &mut self,
        folder: &Path,
        bytes: &[u8],
        ids: &std::collections::HashMap<&str, usize>,
    ) -> Result<()> {
        let Some(text) = checked(bytes) else {
            self.damaged += 1;
            return Ok(());
        };
        if let Ok(Begun { begun }) = serde_json::from_str(&text) {
            if let Some(&index) = ids.get(begun.as_str()) {
                self.begun[index] += 1;
            }
            return Ok(());
        }
        let Ok(row) = serde_json::from_str::<SweepRow>(&text) else {
            self.damaged += 1;
            return Ok(());
        };
        let Some(&index) = ids.get(row.id.as_str()) else {
            self.strangers += 1;
            return Ok(());
        };
        // its file may have been lost with the power
        let length =
            || std::fs::metadata(rows_path(folder, &row.id)).map_or(0, |about| about.len());
        if row.file.is_some_and(|expected| expected != length()) {
            return Ok(());
        }
        match &mut self.rows[index] {
            Some(known) if known.attempt > row.attempt => {}
            Some(known) if known.attempt == row.attempt => {
                if let Some(difference) = difference(known, &row) {
                    return Err(SweepError::Conflict { index, id: row.id, difference });
                }
            }
            place => *place = Some(row),
        }
        Ok(())
    }

    /// Runs without a result.
    pub fn missing(&self) -> impl Iterator<Item = usize> {
        self.rows.iter().enumerate().filter(|(_, row)| row.is_none()).map(|(i, _)| i)
    }

    /// Runs that failed.
    pub fn failed(&self) -> usize {
        self.rows.iter().flatten().filter(|row| row.error.is_some()).count()
    }
}

/// Files of a folder in the order of their names; none where there is no folder.
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
        entries => {
            let entries = entries.map_err(io(folder))?.map(|entry| entry.map(|e| e.path()));
            let mut paths = entries.collect::<Result<Vec<_>, _>>().map_err(io(folder))?;
            paths.sort();
            Ok(paths)
        }
    }
}

/// The first difference between two results of one run.
fn difference(a: &SweepRow, b: &SweepRow) -> Option<String> {
    let values = || {
        let mut pairs = a.values.iter().zip(&b.values).enumerate();
        pairs.find(|(_, (a, b))| a != b).map(|(i, (a, b))| format!("value {i}: {a:?} and {b:?}"))
    };
    match a == b {
        true => None,
        false if a.error != b.error => Some(format!("error: {:?} and {:?}", a.error, b.error)),
        false => values().or_else(|| Some(format!("state: {} and {}", a.state, b.state))),
    }
}

/// Shards that processes hold or held when they died: name and holder.
pub(super) fn held(folder: &Path) -> Result<Vec<(String, claim::Holder)>> {
    let names = files(&folder.join("claims"))?.into_iter().filter_map(|path| {
        let name = path.file_name()?.to_str()?.rsplit_once('.')?.0;
        Some(name.to_string())
    });
    let names: std::collections::BTreeSet<String> = names.collect();
    let mut held = Vec::new();
    for name in names {
        let Some((_, path)) = claim::last(folder, &name)? else { continue };
        let bytes = std::fs::read(&path).map_err(io(&path))?;
        if let Ok(holder) = serde_json::from_slice::<claim::Holder>(&bytes)
            && !holder.released
        {
            held.push((name.replace("-of-", "/"), holder));
        }
    }
    Ok(held)
}
