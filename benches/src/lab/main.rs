//! The `sinew-lab` command: benches, hard cases and rivals. Results go to stdout, progress and
//! errors to stderr; exit codes are those of `sinew`.
#![allow(clippy::print_stderr, reason = "a command speaks to its terminal")]

mod bench;

use bench::{BenchCommand, bench};
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// The laboratory of Sinew: speed, error and hard cases on this machine, other engines.
#[derive(Parser)]
#[command(
    name = "sinew-lab",
    version,
    about,
    after_help = "Scenes, meshes, validation, fits and advice are another command: `sinew`, that is `cargo run --release`. So \
                  are the figures of papers: `sinew-papers`, that is `cargo run --release -p \
                  sinew-papers`."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Measure speed and error on this machine, or run the hard cases.
    #[command(subcommand)]
    Bench(BenchCommand),
}

fn main() -> ExitCode {
    sinew_cli::quiet_driver();
    sinew_cli::exit_code(match Cli::parse().command {
        Command::Bench(command) => bench(&command),
    })
}
