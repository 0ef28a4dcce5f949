//! `sinew sweep`.

use crate::interrupt;
use clap::Subcommand;
use sinew_cli::print;
use sinew_tune::sweep::{ClaimOptions, Shard, ShardRequest, merge, plan, run_shard, slurm, status};
use std::error::Error;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

#[derive(Subcommand)]
pub enum SweepCommand {
    /// Read a study file and write the list of runs.
    Plan {
        /// Study file (TOML): scene, parameters, values.
        study: PathBuf,
        /// Folder of the sweep.
        #[arg(long, value_name = "S")]
        out: PathBuf,
    },
    /// Run a part of the runs; what is done is not done again.
    Run {
        /// Folder of the sweep.
        folder: PathBuf,
        /// Which part, counted from 0: i/n runs those whose index is i modulo n.
        #[arg(long, value_name = "I/N", default_value = "0/1")]
        shard: Shard,
        /// Runs at a time, each on one thread; 0 for one per core.
        #[arg(long, value_name = "K", default_value_t = 1)]
        jobs: usize,
        /// Wait for another process that holds the shard, then do what it left.
        #[arg(long)]
        wait: bool,
        /// Run failures again.
        #[arg(long)]
        retry: bool,
        /// Seconds without a heartbeat after which a process on another host is taken for dead.
        #[arg(long, value_name = "S", default_value_t = 60.0)]
        stale: f64,
        /// No progress.
        #[arg(long, short)]
        quiet: bool,
    },
    /// Write table.csv and the page of the sweep, and table.parquet in a build with that feature.
    Merge {
        /// Folder of the sweep.
        folder: PathBuf,
        /// Also when runs are missing.
        #[arg(long)]
        partial: bool,
    },
    /// How far the sweep is.
    Status {
        /// Folder of the sweep.
        folder: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Print a script for Slurm.
    Slurm {
        /// Folder of the sweep.
        folder: PathBuf,
        /// Tasks of the array; each runs one shard.
        #[arg(long, value_name = "N")]
        array: usize,
        /// Runs at a time in a task.
        #[arg(long, value_name = "K", default_value_t = 1)]
        per_task: usize,
    },
}

/// 0 when all is well, 1 for bad input or work left undone, 3 when a run failed.
pub fn sweep(command: SweepCommand) -> ExitCode {
    carry_out(command).unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ExitCode::FAILURE
    })
}

/// The code of a sweep in which so many runs failed.
fn code(failed: usize) -> ExitCode {
    if failed > 0 { ExitCode::from(3) } else { ExitCode::SUCCESS }
}

fn carry_out(command: SweepCommand) -> Result<ExitCode, Box<dyn Error>> {
    match command {
        SweepCommand::Plan { study, out } => {
            let manifest = plan(&study, &out)?;
            let header = &manifest.header;
            print(format_args!("{} runs planned in {}\n", header.runs, out.display()))?;
            if header.columns.is_empty() {
                eprintln!(
                    "warning: the scene has no [[probe]]: the table will hold hashes and failures only"
                );
            }
            Ok(ExitCode::SUCCESS)
        }
        SweepCommand::Run { folder, shard, jobs, wait, retry, stale, quiet } => {
            let stale = Duration::try_from_secs_f64(stale).map_err(|e| format!("--stale: {e}"))?;
            // also where nothing else is told
            let told: Option<fn(&str)> = Some(|why| eprintln!("{why}"));
            let claim = ClaimOptions { wait, stale, told };
            let interrupt = interrupt()?;
            let request = ShardRequest { folder, shard, jobs, claim, retry, interrupt };
            let last = std::sync::Mutex::new(Instant::now());
            let report = run_shard(&request, &|done, runs| {
                let Ok(mut last) = last.lock() else { return };
                if !quiet && last.elapsed() >= Duration::from_secs(10) {
                    eprintln!("{done} of {runs} runs");
                    *last = Instant::now();
                }
            })?;
            if report.done < report.runs {
                let left = report.runs - report.done;
                eprintln!(
                    "error: stopped, {left} of {} runs are left; the same command does them",
                    report.runs
                );
                return Ok(ExitCode::FAILURE);
            }
            if !quiet {
                let (done, before) = (report.done, report.before);
                print(format_args!(
                    "{done} runs, {before} of them before, {} failed\n",
                    report.failed
                ))?;
            }
            Ok(code(report.failed))
        }
        SweepCommand::Merge { folder, partial } => {
            let merged = merge(&folder, partial)?;
            for file in &merged.files {
                print(format_args!("written to {}\n", file.display()))?;
            }
            let (failed, missing) = (merged.failed, merged.missing);
            print(format_args!("{} runs, {failed} failed, {missing} missing\n", merged.runs))?;
            Ok(code(failed))
        }
        SweepCommand::Status { folder, json } => {
            let status = status(&folder)?;
            match json {
                true => print(format_args!("{}\n", serde_json::to_string_pretty(&status)?))?,
                false => print(format_args!("{status}"))?,
            }
            Ok(code(status.failed))
        }
        SweepCommand::Slurm { folder, array, per_task } => {
            print(format_args!("{}", slurm(&folder, array, per_task)?))?;
            Ok(ExitCode::SUCCESS)
        }
    }
}
