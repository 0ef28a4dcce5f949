//! `sinew-lab reproduce`.

use clap::{Args, Subcommand};
use sinew_benches::reproduce::{Options, PAPER_A, PAPER_B, PAPER_C};
use sinew_cli::{Outcome, print};
use std::path::PathBuf;

#[derive(Subcommand)]
pub enum ReproduceCommand {
    /// Delingette 2008, Biquadratic and Quadratic Springs for Modeling St Venant Kirchhoff Materials.
    PaperA(ReproduceArguments),
    /// Natsupakpong & Cavusoglu 2010, Determination of elasticity parameters in lumped element
    /// (mass-spring) models of deformable objects.
    PaperB(PaperBArguments),
    /// Bourguignon & Cani 2000, Controlling Anisotropy in Mass-Spring Systems.
    PaperC(ReproduceArguments),
}

#[derive(Args)]
pub struct ReproduceArguments {
    /// Only these figures, by letter: a, b, ... [default: all].
    #[arg(long, value_name = "LETTERS", value_delimiter = ',')]
    only: Vec<char>,
    /// Folder for the page, Markdown, JSON, one CSV per table and one SVG per chart.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Args)]
pub struct PaperBArguments {
    #[command(flatten)]
    common: ReproduceArguments,
    /// Folder with meshes b_*.msh of your own, with the groups `fixed` and `loaded` [default: meshes generated to the
    /// printed counts].
    #[arg(long, value_name = "DIR")]
    meshes: Option<PathBuf>,
}

/// Figures that differ from the paper are a result, not a failure.
pub fn reproduce(command: &ReproduceCommand) -> Outcome {
    let (source, common, meshes) = match command {
        ReproduceCommand::PaperA(common) => (&PAPER_A, common, &None),
        ReproduceCommand::PaperB(PaperBArguments { common, meshes }) => (&PAPER_B, common, meshes),
        ReproduceCommand::PaperC(common) => (&PAPER_C, common, &None),
    };
    let options = Options { meshes: meshes.clone(), quick: false };
    let paper = source.make(&common.only, &options, |what| eprintln!("{what}"))?;
    print(format_args!("{}", paper.text()))?;
    if let Some(folder) = &common.out {
        let files = paper.write(folder)?;
        eprintln!("{} files written to {}", files.len(), folder.display());
    }
    Ok(true)
}
