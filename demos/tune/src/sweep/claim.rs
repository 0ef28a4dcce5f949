//! Who works on a shard.
//!
//! A claim is a file `claims/SHARD.N` that only one process can make (`create_new`); the largest `N` is the one that
//! counts, and none is ever taken away, so that no claim can be mistaken for another. Its owner writes a heartbeat into
//! it every few seconds, and at the end that it was released.
//!
//! A claim is dead when its process was on this host (same start of the system, same space of process numbers) and is gone, or when
//! its file has not changed while the one who asks watched it for [`ClaimOptions::stale`], by the clock of the one who
//! asks: clocks of two hosts are never compared. Whoever finds the last claim released or dead makes the next.
//!
//! Claims save work; the results do not depend on them. Should two processes run the same shard all the same, merging
//! compares what they found.

use super::error::{Result, SweepError, io};
use serde::{Deserialize, Serialize};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// From one heartbeat to the next.
pub const HEARTBEAT: Duration = Duration::from_secs(5);

/// How a shard is claimed.
#[derive(Clone, Copy, Debug)]
pub struct ClaimOptions {
    /// Waits for another process that holds the shard.
    pub wait: bool,
    /// Time without a heartbeat after which a process on another host is taken for dead.
    pub stale: Duration,
    /// Is told, once, that and why the shard has to be waited for.
    pub told: Option<fn(&str)>,
}

impl Default for ClaimOptions {
    fn default() -> Self {
        Self { wait: false, stale: Duration::from_secs(60), told: None }
    }
}

/// What a claim file says.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    /// Name of the host, start of its system and space of process numbers.
    pub host: String,
    /// Process.
    pub pid: u32,
    /// When the process started, in ticks of its host.
    pub start: u64,
    /// Heartbeats so far.
    beat: u64,
    /// Whether it has let go.
    pub released: bool,
}

impl Holder {
    fn this() -> Self {
        let pid = std::process::id();
        Self { host: host(), pid, start: start_of(pid).unwrap_or(0), beat: 0, released: false }
    }

    /// Who it is, for people.
    pub fn name(&self) -> String {
        let host = self.host.split('/').next().unwrap_or_default();
        format!("process {} on {host}", self.pid)
    }

    /// Whether it lives, where this process can tell.
    fn lives(&self) -> Option<bool> {
        let here = self.host == host() && self.start != 0;
        here.then(|| start_of(self.pid) == Some(self.start))
    }
}

/// This host; empty where the system does not tell.
fn host() -> String {
    let read = |path: &str| std::fs::read_to_string(path).map(|text| text.trim().to_string());
    let space = std::fs::read_link("/proc/self/ns/pid").map(|path| path.display().to_string());
    match (read("/proc/sys/kernel/hostname"), read("/proc/sys/kernel/random/boot_id"), space) {
        (Ok(name), Ok(boot), Ok(space)) => format!("{name}/{boot}/{space}"),
        _ => String::new(),
    }
}

/// When a process of this host started; `None` when there is none.
fn start_of(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // the name before may hold anything, also spaces and brackets
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    // a process that ended but was not waited for is no worker
    let gone = matches!(fields.next()?, "Z" | "X");
    fields.nth(18)?.parse().ok().filter(|_| !gone)
}

/// The last claim of a shard and its number.
pub fn last(folder: &Path, shard: &str) -> Result<Option<(u32, PathBuf)>> {
    let claims = folder.join("claims");
    let entries = match std::fs::read_dir(&claims) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(io(&claims))?,
    };
    let mut last = None;
    for entry in entries {
        let path = entry.map_err(io(&claims))?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let number = name.strip_prefix(shard).and_then(|rest| rest.strip_prefix('.'));
        if let Some(number) = number.and_then(|n| n.parse().ok()) {
            last = last.max(Some((number, path)));
        }
    }
    Ok(last)
}

/// Why a shard has to be waited for.
fn waits_for(
    shard: &str,
    holder: Option<&Holder>,
    lives: Option<bool>,
    options: ClaimOptions,
) -> String {
    let shard = shard.replace("-of-", "/");
    let holder = holder.map_or("a process that did not write its name".into(), Holder::name);
    match lives {
        Some(_) => format!("shard {shard} is held by {holder}: waits until that is done"),
        None => format!(
            "shard {shard} is claimed by {holder}, which may have died: waits up to {} s for a sign of life (--stale)",
            options.stale.as_secs_f64()
        ),
    }
}

/// A shard that this process holds.
pub struct Claim {
    folder: PathBuf,
    shard: String,
    path: PathBuf,
    file: File,
    /// What its file says.
    pub holder: Holder,
    /// Number of the claim, which no other claim of the shard has.
    pub number: u32,
}

impl Claim {
    /// Claims a shard; `None` when `stop` was set while waiting.
    ///
    /// # Errors
    /// [`SweepError::Claimed`], or a folder that cannot be written.
    pub fn take(
        folder: &Path,
        shard: &str,
        options: ClaimOptions,
        stop: &AtomicBool,
    ) -> Result<Option<Self>> {
        let claims = folder.join("claims");
        std::fs::create_dir_all(&claims).map_err(io(&claims))?;
        // the last claim as it was when it last changed
        let mut watched: Option<(u32, Vec<u8>, Instant)> = None;
        let mut told = options.told;
        while !stop.load(Ordering::Relaxed) {
            let last = last(folder, shard)?;
            let number = last.as_ref().map_or(0, |(number, _)| *number);
            let bytes = match &last {
                Some((_, path)) => std::fs::read(path).map_err(io(path))?,
                None => Vec::new(),
            };
            let holder: Option<Holder> = serde_json::from_slice(&bytes).ok();
            let lives = holder.as_ref().and_then(Holder::lives);
            let changed = watched.as_ref().is_some_and(|(n, b, _)| (*n, b) != (number, &bytes));
            if watched.is_none() || changed {
                watched = Some((number, bytes, Instant::now()));
            }
            let still = watched.as_ref().map_or(Duration::ZERO, |(_, _, since)| since.elapsed());
            let free = match lives {
                _ if last.is_none() || holder.as_ref().is_some_and(|h| h.released) => true,
                Some(lives) => !lives,
                None => still >= options.stale,
            };
            if free {
                if let Some(claim) = Self::make(folder, shard, number + 1)? {
                    return Ok(Some(claim));
                }
                continue;
            }
            if !options.wait && (lives == Some(true) || changed) {
                let holder = holder.map_or("another process".into(), |h| h.name());
                return Err(SweepError::Claimed { shard: shard.replace("-of-", "/"), holder });
            }
            if let Some(tell) = told.take() {
                tell(&waits_for(shard, holder.as_ref(), lives, options));
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        Ok(None)
    }

    /// The next claim, unless another process was faster.
    fn make(folder: &Path, shard: &str, number: u32) -> Result<Option<Self>> {
        let path = folder.join(format!("claims/{shard}.{number}"));
        let file = match OpenOptions::new().write(true).create_new(true).open(&path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(None),
            file => file.map_err(io(&path))?,
        };
        let (folder, shard) = (folder.to_path_buf(), shard.to_string());
        let mut claim = Self { folder, shard, path, file, holder: Holder::this(), number };
        // an empty claim, as of a full disk, would have to be waited for
        claim.write().inspect_err(|_| drop(std::fs::remove_file(&claim.path)))?;
        Ok(Some(claim))
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what it says into its file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&mut self) -> Result<()> {
        // always of one length, so that nothing of an earlier text is left
        let text = serde_json::to_string(&self.holder).unwrap_or_default();
        let text = format!("{text:<400}\n");
        let written =
            self.file.seek(SeekFrom::Start(0)).and_then(|_| self.file.write_all(text.as_bytes()));
        written.map_err(io(&self.path))
    }

    /// Shows life.
    ///
    /// # Errors
    /// [`SweepError::TakenOver`] when another process has taken the shard, or a file that cannot be written.
    pub fn beat(&mut self) -> Result<()> {
        self.holder.beat += 1;
        self.write()?;
        match last(&self.folder, &self.shard)? {
            Some((number, _)) if number > self.number => {
                Err(SweepError::TakenOver { shard: self.shard.replace("-of-", "/") })
            }
            _ => Ok(()),
        }
    }

    /// Lets go.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn release(mut self) -> Result<()> {
        self.holder.released = true;
        self.write()
    }
}
