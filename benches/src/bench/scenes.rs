//! The scenes that come with Sinew, as they are.

use super::error::BenchError;
use super::table::Table;
use serde::{Deserialize, Serialize};
use sinew_scene::assemble::BuildOptions;
use sinew_scene::run::{RunOptions, Silent, run as run_scene};
use sinew_scene::scene::LoadedScene;
use sinew_scene::scene_folder;
use sinew_tune::table_of;

/// One scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneRow {
    /// Name.
    pub scene: String,
    /// Tetrahedra, all bodies.
    pub tetrahedra: usize,
    /// Integrator.
    pub integrator: String,
    /// Step (s); of a static scene the share of the loads.
    pub dt: f64,
    /// Steps carried out.
    pub steps: u64,
    /// `f64` or `f32`.
    pub precision: String,
    /// Threads.
    pub threads: usize,
    /// Median wall time of a step (ms).
    pub median_ms: f64,
    /// 99th percentile (ms).
    pub p99_ms: f64,
    /// Simulated over wall time of the steps.
    pub real_time_factor: Option<f64>,
    /// Conjugate-gradient iterations per step.
    pub cg_iterations: f64,
    /// Worst relative residual.
    pub residual: f64,
    /// Mean distance of the energy decrease from what the linearisation predicted (%).
    pub linearisation_percent: f64,
    /// Times something else than the plain step was needed: projected tangents, gradient steps,
    /// shortened, halted or capped steps, unconverged Newton iterations.
    pub fallbacks: u64,
    /// Most elements turned inside out at once.
    pub inverted: u64,
    /// Why it ended early, if it did.
    pub failure: Option<String>,
}

/// Runs every scene; quick runs stop after `quick_steps` steps.
///
/// # Errors
/// When a scene cannot be read, built or run.
pub fn run(
    quick_steps: Option<u64>,
    mut tell: impl FnMut(&str),
) -> Result<Vec<SceneRow>, BenchError> {
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
        let s = run_scene(&scene, &options, &mut Silent)?;
        rows.push(SceneRow {
            scene: s.scene.name.clone(),
            tetrahedra: s.scene.tetrahedra,
            integrator: s.settings.solver.integrator.name().into(),
            dt: s.settings.dt,
            steps: s.timing.step.count,
            precision: s.settings.precision.into(),
            threads: s.settings.threads,
            median_ms: s.timing.step.median_ms,
            p99_ms: s.timing.step.p99_ms,
            real_time_factor: s.timing.real_time_factor,
            cg_iterations: s.solver.totals.cg_iterations as f64 / s.timing.step.count.max(1) as f64,
            residual: s.solver.figures.worst_residual,
            linearisation_percent: 100.0 * s.solver.figures.linearisation_error_mean,
            fallbacks: s.solver.totals.projections
                + s.solver.totals.gradient_fallbacks
                + s.solver.totals.backtracks
                + s.solver.totals.line_search_failures
                + s.solver.totals.energy_caps
                + s.solver.figures.unconverged_steps,
            inverted: s.volume.inverted_max,
            failure: s.failure,
        });
    }
    Ok(rows)
}

/// For people.
pub fn table(rows: &[SceneRow]) -> Table {
    table_of!("scenes", "Demo scenes as they are"; for r in rows;
        "scene" => &r.scene, "tets" => r.tetrahedra, "integrator" => &r.integrator, "dt s" => r.dt,
        "steps" => r.steps, "precision" => &r.precision, "threads" => r.threads, "ms/step" => r.median_ms,
        "p99 ms" => r.p99_ms, "real time x" => r.real_time_factor, "CG its/step" => r.cg_iterations,
        "residual" => r.residual, "linearisation %" => r.linearisation_percent,
        "fallbacks" => r.fallbacks, "inverted" => r.inverted, "failure" => r.failure.clone(),
    )
    .note(
        "real time x: simulated over wall time of the steps. residual: worst relative residual of a \
         linear system. linearisation: mean distance of the energy decrease from what the linearised \
         step predicted. fallbacks: projected tangents, gradient steps, shortened, halted or capped \
         steps, unconverged Newton iterations.",
    )
}
