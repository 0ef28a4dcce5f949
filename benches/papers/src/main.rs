//! The `sinew-papers` command. Results go to stdout, progress and errors to stderr; exit codes are those of `sinew`.
#![allow(clippy::print_stderr, reason = "a command speaks to its terminal")]

use clap::{Args, Parser};
use sinew_cli::{Outcome, print};
use sinew_papers::{Options, PAPER_A, PAPER_B, PAPER_C};
use std::path::PathBuf;
use std::process::ExitCode;

/// Makes the figures and tables of a paper again, with a verdict on each of its statements.
#[derive(Parser)]
#[command(name = "sinew-papers", version, about)]
enum Cli {
    /// Delingette 2008, Biquadratic and Quadratic Springs for Modeling St Venant Kirchhoff Materials.
    A(PaperArguments),
    /// Natsupakpong & Cavusoglu 2010, Determination of elasticity parameters in lumped element
    /// (mass-spring) models of deformable objects.
    B(PaperBArguments),
    /// Bourguignon & Cani 2000, Controlling Anisotropy in Mass-Spring Systems.
    C(PaperArguments),
}

#[derive(Args)]
struct PaperArguments {
    /// Only these figures, by letter: a, b, ... [default: all].
    #[arg(long, value_name = "LETTERS", value_delimiter = ',')]
    only: Vec<char>,
    /// Folder for the page, Markdown, JSON, one CSV per table and one SVG per chart.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
struct PaperBArguments {
    #[command(flatten)]
    common: PaperArguments,
    /// Folder with meshes b_*.msh of your own, with the groups `fixed` and `loaded` [default: meshes generated to the
    /// printed counts].
    #[arg(long, value_name = "DIR")]
    meshes: Option<PathBuf>,
}

/// Figures that differ from the paper are a result, not a failure.
fn run(command: Cli) -> Outcome {
    let (source, common, meshes) = match command {
        Cli::A(common) => (&PAPER_A, common, None),
        Cli::B(PaperBArguments { common, meshes }) => (&PAPER_B, common, meshes),
        Cli::C(common) => (&PAPER_C, common, None),
    };
    let options = Options { meshes, quick: false };
    let paper = source.make(&common.only, &options, |what| eprintln!("{what}"))?;
    print(format_args!("{}", paper.text()))?;
    if let Some(folder) = &common.out {
        let files = paper.write(folder)?;
        eprintln!("{} files written to {}", files.len(), folder.display());
    }
    Ok(true)
}

fn main() -> ExitCode {
    sinew_cli::exit_code(run(Cli::parse()))
}
