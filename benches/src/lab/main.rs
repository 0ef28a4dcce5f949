//! The `sinew-lab` command: benches, hard cases, papers and rivals. Results go to stdout, progress and
//! errors to stderr; exit codes are those of `sinew`.
#![allow(clippy::print_stderr, reason = "a command speaks to its terminal")]

mod bench;
mod reproduce;

use bench::{BenchCommand, bench};
use clap::{Parser, Subcommand};
use reproduce::{ReproduceCommand, reproduce};
use std::process::ExitCode;

/// The laboratory of Sinew: speed, error and hard cases on this machine, other engines, papers.
#[derive(Parser)]
#[command(
    name = "sinew-lab",
    version,
    about,
    after_help = "Scenes, meshes, validation, fits and advice are the other command: `sinew`, that is `cargo run --release`."
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
    /// Make the figures of a paper again and say what agrees.
    #[command(subcommand)]
    Reproduce(ReproduceCommand),
}

fn main() -> ExitCode {
    sinew_cli::exit_code(match Cli::parse().command {
        Command::Bench(command) => bench(&command),
        Command::Reproduce(command) => reproduce(&command),
    })
}
