//! `sinew advise`.

use clap::Args;
use sinew_cli::{Outcome, print};
use sinew_scene::scene::LoadedScene;
use sinew_tune::advise::{Request, advise, parse_budget, parse_error};
use std::path::PathBuf;

#[derive(Args)]
pub struct AdviseArguments {
    /// Scene file (TOML).
    scene: PathBuf,
    /// Wall time per frame (the `dt` of the scene file), or to the equilibrium of a static scene:
    /// 16ms, 800us, 0.5s, 60fps.
    #[arg(long, value_name = "TIME", value_parser = parse_budget)]
    budget: f64,
    /// Largest distance from a converged run, over the largest displacement: 2%.
    #[arg(long, value_name = "PERCENT", value_parser = parse_error)]
    error: f64,
    /// Largest error that the mesh may add, against the finest that the bodies can be cut into: searches ten-node
    /// tetrahedra, hexahedra, volume by clusters, and coarser and finer boxes too.
    #[arg(long, value_name = "PERCENT", value_parser = parse_error)]
    mesh_error: Option<f64>,
    /// Show everything that was tried, not only the Pareto front.
    #[arg(long)]
    all: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn advise_scene(arguments: &AdviseArguments) -> Outcome {
    let scene = LoadedScene::read(&arguments.scene)?;
    let request = Request {
        budget_s: arguments.budget,
        error: arguments.error,
        mesh_error: arguments.mesh_error,
    };
    let advice = advise(&scene, request, |what| eprintln!("{what}"))?;
    if arguments.json {
        print(format_args!("{}\n", serde_json::to_string_pretty(&advice)?))?;
    } else {
        print(format_args!("{}", advice.text(arguments.all)))?;
    }
    Ok(advice.met && advice.cuts.is_none_or(|cuts| cuts.met))
}
