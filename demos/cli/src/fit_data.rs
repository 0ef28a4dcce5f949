//! `sinew fit --data OBSERVED.csv SCENE.toml`.

use clap::Args;
use sinew_cli::{Outcome, print};
use sinew_scene::scene::LoadedScene;
use sinew_tune::fit_data::{self, DataFitRequest};
use std::path::{Path, PathBuf};

/// Options of the form with data.
#[derive(Args, Clone)]
pub struct FitDataOptions {
    /// Observations: displacements (columns vertex or x, y, z; ux, uy, uz; load, weight or sigma) or a
    /// curve (load, force, constraint, axis; weight or sigma). May be given several times.
    #[arg(long, value_name = "CSV", requires = "fit")]
    pub data: Vec<PathBuf>,
    /// What is fitted: young, poisson, young:REGION, poisson:REGION, axis:FAMILY (the modulus of its fibres),
    /// with BODY/ before it in a scene of several bodies. REGION is a group of cells, or an array of cell
    /// data whose values number regions.
    #[arg(long, value_name = "PARAMETER", requires = "data")]
    fit: Vec<String>,
    /// Bounds of a parameter, such as young=1e3..1e5 or poisson=0.3..0.49.
    #[arg(long, value_name = "PARAMETER=LOW..HIGH", requires = "data")]
    bounds: Vec<String>,
    /// Compare the derivatives with central differences at the end.
    #[arg(long, requires = "data")]
    check_gradient: bool,
    /// Threads, 0 for one per core; results do not depend on it.
    #[arg(long, requires = "data")]
    threads: Option<usize>,
}

/// Fits a scene to data.
pub fn fit_data(scene: &Path, options: &FitDataOptions, json: bool) -> Outcome {
    let loaded = LoadedScene::read(scene)?;
    let FitDataOptions { data, fit, bounds, check_gradient, threads } = options.clone();
    let request = DataFitRequest { data, fit, bounds, check_gradient, threads };
    let report = fit_data::fit(&loaded, &request)?;
    if json {
        print(format_args!("{}\n", serde_json::to_string_pretty(&report)?))?;
    } else {
        print(format_args!("{report}"))?;
    }
    if let Some(failure) = &report.failure {
        eprintln!("error: {}: {failure}", scene.display());
    }
    Ok(report.failure.is_none())
}
