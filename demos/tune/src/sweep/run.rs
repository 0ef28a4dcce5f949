//! Runs of a shard.

use super::claim::{Claim, ClaimOptions, HEARTBEAT};
use super::error::{Result, SweepError, io};
use super::manifest::{Manifest, Opened};
use super::record::{Shard, ShardFile, SweepResults, SweepRow, rows_path};
use super::study::Kept;
use super::template::KeyPath;
use sinew::engine::schedule::Executor;
use sinew_scene::assemble::{BuildOptions, BuiltScene};
use sinew_scene::output::csv_heading;
use sinew_scene::run::{Observer, RunOptions, run};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What to run.
#[derive(Clone, Debug)]
pub struct ShardRequest {
    /// Folder of the sweep.
    pub folder: PathBuf,
    /// Which runs.
    pub shard: Shard,
    /// Runs at the same time, each on one thread; 0 for one per core.
    pub jobs: usize,
    /// How the shard is claimed.
    pub claim: ClaimOptions,
    /// Runs failures again.
    pub retry: bool,
    /// Ends the work once it is set; runs under way are given up and done again by the next process.
    pub interrupt: Arc<AtomicBool>,
}

/// What became of a shard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShardReport {
    /// Runs of the shard.
    pub runs: usize,
    /// Those that had results before.
    pub before: usize,
    /// Those with results now.
    pub done: usize,
    /// Those that failed.
    pub failed: usize,
}

/// Runs what a shard still lacks. `told` learns how many of how many runs have results.
///
/// # Errors
/// A folder without a plan, a scene or mesh that has changed since, a shard that another process holds, a file that
/// cannot be written. A run that fails is a row, not an error.
pub fn run_shard(
    request: &ShardRequest,
    told: &(dyn Fn(usize, usize) + Sync),
) -> Result<ShardReport> {
    let ShardRequest { folder, shard, interrupt, .. } = request;
    let manifest = Manifest::read(folder)?;
    let opened = manifest.open(folder)?;
    let runs = manifest.runs.iter().filter(|run| shard.holds(run.index)).count();
    let mut report = ShardReport { runs, ..ShardReport::default() };
    let Some(claim) = Claim::take(folder, &shard.name(), request.claim, interrupt)? else {
        return Ok(report);
    };
    let results = SweepResults::read(folder, &manifest, Some(*shard))?;
    let wanted = |row: &Option<SweepRow>| match row {
        None => true,
        Some(row) => request.retry && row.error.is_some(),
    };
    let own = || (0..manifest.runs.len()).filter(|&index| shard.holds(index));
    let mut pending: Vec<usize> = own().filter(|&i| wanted(&results.rows[i])).collect();
    // a run in which processes died comes after all others
    pending.sort_by_key(|&i| (results.begun[i], i));
    report.before = runs - pending.len();
    report.failed = own()
        .filter(|i| !pending.contains(i) || !request.retry)
        .filter(|&i| failed(&results, i))
        .count();
    report.done = report.before;
    if pending.is_empty() {
        claim.release()?;
        return Ok(report);
    }
    let paths = found_again(&manifest, &opened)?;
    let file = Mutex::new(ShardFile::new(folder, *shard, claim.number)?);
    let work = ShardWork {
        request,
        manifest: &manifest,
        opened: &opened,
        paths: &paths,
        results: &results,
        pending: &pending,
        next: AtomicUsize::new(0),
        file: &file,
        claim: Mutex::new(claim),
        state: Mutex::new(report),
        error: Mutex::new(None),
        stop: Arc::new(AtomicBool::new(false)),
        told,
    };
    told(report.done, runs);
    work.all();
    let claim = work.claim.into_inner().unwrap_or_else(PoisonError::into_inner);
    lock(&file).sync()?;
    let error = work.error.into_inner().unwrap_or_else(PoisonError::into_inner);
    if !matches!(error, Some(SweepError::TakenOver { .. })) {
        claim.release()?;
    }
    match error {
        Some(error) => Err(error),
        None => Ok(work.state.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

fn failed(results: &SweepResults, index: usize) -> bool {
    results.rows[index].as_ref().is_some_and(|row| row.error.is_some())
}

/// Parameters of a plan in its scene.
fn found_again(manifest: &Manifest, opened: &Opened) -> Result<Vec<KeyPath>> {
    let find = |key: &String| {
        let file = &manifest.header.scene;
        let fault = |(found, remedy)| SweepError::entry(file, None, key, found, remedy);
        opened.template.find(key).map_err(fault)
    };
    manifest.header.parameters.iter().map(find).collect()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Work on a shard, shared by its threads.
struct ShardWork<'a> {
    request: &'a ShardRequest,
    manifest: &'a Manifest,
    opened: &'a Opened,
    paths: &'a [KeyPath],
    results: &'a SweepResults,
    pending: &'a [usize],
    next: AtomicUsize,
    file: &'a Mutex<ShardFile>,
    claim: Mutex<Claim>,
    state: Mutex<ShardReport>,
    error: Mutex<Option<SweepError>>,
    /// Set when all threads are to end.
    stop: Arc<AtomicBool>,
    told: &'a (dyn Fn(usize, usize) + Sync),
}

impl ShardWork<'_> {
    /// Runs all of it.
    fn all(&self) {
        let cores = || std::thread::available_parallelism().map_or(1, usize::from);
        let jobs = if self.request.jobs == 0 { cores() } else { self.request.jobs };
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let heart = scope.spawn(|| self.beat(&ended));
            let spawn = |_| {
                // as much room as a program's first thread has
                let builder = std::thread::Builder::new().stack_size(8 << 20);
                builder.spawn_scoped(scope, || self.noted(self.runs()))
            };
            let threads: Vec<_> = (0..jobs.min(self.pending.len())).map(spawn).collect();
            for thread in threads {
                match thread {
                    Ok(thread) => drop(thread.join()),
                    Err(error) => self.noted(Err(io(&self.request.folder)(error))),
                }
            }
            ended.store(true, Ordering::Relaxed);
            heart.thread().unpark();
        });
    }

    /// Keeps the first error and ends all threads.
    fn noted(&self, result: Result<()>) {
        if let Err(error) = result {
            lock(&self.error).get_or_insert(error);
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    /// Shows life every few seconds and brings lines onto the disk every second.
    fn beat(&self, ended: &AtomicBool) {
        let mut last = Instant::now();
        while !ended.load(Ordering::Relaxed) {
            std::thread::park_timeout(Duration::from_secs(1));
            if self.request.interrupt.load(Ordering::Relaxed) {
                self.stop.store(true, Ordering::Relaxed);
            }
            let mut file = lock(self.file);
            if file.unsynced {
                self.noted(file.sync());
            }
            drop(file);
            if last.elapsed() >= HEARTBEAT {
                self.noted(lock(&self.claim).beat());
                last = Instant::now();
            }
        }
    }

    /// Takes one run after another.
    fn runs(&self) -> Result<()> {
        loop {
            let Some(&index) = self.pending.get(self.next.fetch_add(1, Ordering::Relaxed)) else {
                return Ok(());
            };
            if self.stopped() {
                return Ok(());
            }
            lock(self.file).begin(&self.manifest.runs[index].id)?;
            let row = self.row(index)?;
            self.opened.unchanged()?;
            // a run that was cut short is none
            if self.stopped() {
                return Ok(());
            }
            lock(self.file).end(&row)?;
            let mut state = lock(&self.state);
            state.done += 1;
            state.failed += usize::from(row.error.is_some());
            (self.told)(state.done, state.runs);
        }
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.request.interrupt.load(Ordering::Relaxed)
    }

    /// Carries out a run.
    fn row(&self, index: usize) -> Result<SweepRow> {
        let planned = &self.manifest.runs[index];
        let kept = self.manifest.header.probes;
        let columns = &self.manifest.header.columns;
        let mut row = SweepRow {
            id: planned.id.clone(),
            attempt: self.results.rows[index].as_ref().map_or(0, |row| row.attempt + 1),
            error: None,
            warnings: String::new(),
            steps: 0,
            state: String::new(),
            values: Vec::new(),
            file: None,
        };
        let options = RunOptions {
            build: BuildOptions {
                threads: Some(1),
                executor: Some(Executor::SingleThreaded),
                ..BuildOptions::default()
            },
            interrupt: Some(Arc::clone(&self.stop)),
            ..RunOptions::default()
        };
        let mut seen = SeenRows { kept, ..SeenRows::default() };
        let error = match self.opened.template.scene(self.paths, &planned.values) {
            Err((_, message)) => Some(message),
            Ok(scene) => match run(&scene, &options, &mut seen) {
                Err(error) => Some(error.to_string()),
                Ok(summary) => {
                    (row.steps, row.state) = (seen.steps, summary.final_state_hash);
                    let mut codes: Vec<String> =
                        summary.warnings.into_iter().map(|warning| warning.code).collect();
                    codes.sort();
                    codes.dedup();
                    row.warnings = codes.join(" ");
                    summary.failure
                }
            },
        };
        // messages name files as the scene does, whatever way led to its folder
        let prefix = self.opened.folder.display().to_string();
        row.error =
            error.map(|text| if prefix.is_empty() { text } else { text.replace(&prefix, "") });
        if row.error.is_none() {
            let finite = |x: &f64| x.is_finite().then_some(*x);
            row.values = seen.values().iter().map(finite).collect();
            if kept == Kept::All {
                let head = std::iter::once("step,time_s".to_string());
                let head: Vec<String> =
                    head.chain(columns.iter().map(|c| csv_heading(c))).collect();
                let text = head.join(",") + "\n" + &seen.rows;
                let path = rows_path(&self.request.folder, &row.id);
                write_rows(&path, &text)?;
                row.file = Some(text.len() as u64);
            }
        }
        Ok(row)
    }
}

/// Writes the rows of a run; whole or not at all.
fn write_rows(path: &Path, text: &str) -> Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(io(folder))?;
    }
    super::manifest::write_whole(path, text.as_bytes())
}

/// What probes showed during a run.
#[derive(Default)]
struct SeenRows {
    kept: Kept,
    steps: u64,
    last: Vec<f64>,
    smallest: Vec<f64>,
    largest: Vec<f64>,
    /// All rows as CSV.
    rows: String,
}

impl SeenRows {
    /// What the table holds.
    fn values(&self) -> Vec<f64> {
        match self.kept {
            Kept::Last | Kept::All => self.last.clone(),
            Kept::Max => {
                self.smallest.iter().zip(&self.largest).flat_map(|(a, b)| [*a, *b]).collect()
            }
        }
    }
}

impl Observer for SeenRows {
    fn step(&mut self, done: u64, _: f64, _: &mut BuiltScene) {
        self.steps = done;
    }

    fn row(&mut self, step: u64, time: f64, probes: &[f64]) {
        self.last = probes.to_vec();
        match self.kept {
            Kept::Last => {}
            Kept::Max if self.smallest.is_empty() => {
                (self.smallest, self.largest) = (probes.to_vec(), probes.to_vec());
            }
            Kept::Max => {
                for (i, x) in probes.iter().enumerate() {
                    self.smallest[i] = self.smallest[i].min(*x);
                    self.largest[i] = self.largest[i].max(*x);
                }
            }
            Kept::All => {
                let _ = write!(self.rows, "{step},{time:?}");
                for x in probes {
                    let _ = if x.is_finite() {
                        write!(self.rows, ",{x:?}")
                    } else {
                        write!(self.rows, ",")
                    };
                }
                self.rows.push('\n');
            }
        }
    }
}
