//! The scenes that come with Sinew, as they are.

use crate::toolbox::prelude::*;
use sinew_scene::assemble::BuildOptions;
use sinew_scene::run::{RunOptions, Silent, run as run_scene};
use sinew_scene::scene::LoadedScene;
use sinew_scene::scene_folder;

/// Runs every scene; quick runs stop after `quick_steps` steps.
///
/// # Errors
/// When a scene cannot be read, built or run.
pub fn run(quick_steps: Option<u64>, mut tell: impl FnMut(&str)) -> Result<Table> {
    let folder = scene_folder();
    let listing = std::fs::read_dir(&folder).map_err(|error| BenchError::Request {
        what: format!("{}: {error}", folder.display()),
        remedy: "run from a checkout of Sinew".into(),
    })?;
    let mut files: Vec<_> = listing
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    files.sort();
    let mut rows = Vec::new();
    for file in files {
        let scene = LoadedScene::read(&file)?;
        tell(&format!("scene: {}", scene.scene.name));
        // the plan says how many steps there are
        let planned = sinew_scene::assemble::build(&scene, &BuildOptions::default())?.plan.steps;
        let steps = quick_steps.map(|n| n.min(planned));
        let options = RunOptions {
            build: BuildOptions { steps, ..BuildOptions::default() },
            ..RunOptions::default()
        };
        rows.push(run_scene(&scene, &options, &mut Silent)?);
    }
    Ok(table_of!("scenes", "Demo scenes as they are"; for s in &rows;
        where {
            let (totals, figures) = (&s.solver.totals, &s.solver.figures);
            let step = &s.timing.step;
            let fallbacks = totals.projections
                + totals.gradient_fallbacks
                + totals.backtracks
                + totals.line_search_failures
                + totals.energy_caps
                + figures.unconverged_steps;
        }
        "scene" => &s.scene.name, "tets" => s.scene.tetrahedra,
        "integrator" => s.settings.solver.integrator.name(), "dt s" => s.settings.dt,
        "steps" => step.count, "precision" => s.settings.precision, "threads" => s.settings.threads,
        "ms/step" => step.median_ms, "p99 ms" => step.p99_ms, "real time x" => s.timing.real_time_factor,
        "CG its/step" => totals.cg_iterations as f64 / step.count.max(1) as f64,
        "residual" => figures.worst_residual,
        "linearisation %" => 100.0 * figures.linearisation_error_mean, "fallbacks" => fallbacks,
        "inverted" => s.volume.inverted_max, "failure" => s.failure.clone(),
    )
    .note(
        "real time x: simulated over wall time of the steps. residual: worst relative residual of a \
         linear system. linearisation: mean distance of the energy decrease from what the linearised \
         step predicted. fallbacks: projected tangents, gradient steps, shortened, halted or capped \
         steps, unconverged Newton iterations.",
    ))
}
