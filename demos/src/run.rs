//! Runs a scene: steps, probes, frames, and the figures of the summary.

use crate::axes::AxesSummary;
use crate::build::{BuildOptions, BuiltScene, build};
use crate::error::RunError;
use crate::output::{Writer, probe_columns, probe_values, volume};
use crate::resection;
use crate::scene::{LoadedScene, Mode, Quantity};
use crate::summary::{
    BodySummary, ConstraintSummary, EnergySummary, GpuSummary, Level, LoadSummary, Machine,
    MembraneSummary, PressureSummary, RunSummary, SCHEMA, SceneSummary, Settings, SolverSummary,
    Stage, StepTiming, SystemSummary, Timing, Versions, VolumeSummary, Warning,
};
use glam::DVec3;
use sinew::engine::report::{StepReport, SystemTimes};
use sinew::engine::workers::Workers;
use sinew::models::axes::muscle::Muscles;
use sinew::simulation::{Backend, Precision, Simulation};
use sinew::solvers::settings::Integrator;
use std::path::PathBuf;
use std::time::Instant;

/// How a scene is run.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// What replaces values of the scene.
    pub build: BuildOptions,
    /// Folder for frames, probes and summary; nothing is written without it.
    pub out: Option<PathBuf>,
    /// File for the JSON summary.
    pub json: Option<PathBuf>,
}

/// Is told how a run gets on.
pub trait Observer {
    /// The scene is built and at rest.
    fn built(&mut self, scene: &mut BuiltScene) {
        let _ = scene;
    }
    /// The scene is built; `steps` follow.
    fn start(&mut self, name: &str, steps: u64) {
        let _ = (name, steps);
    }
    /// `done` steps are done, the clock stands at `time` (s).
    fn step(&mut self, done: u64, time: f64, scene: &mut BuiltScene) {
        let _ = (done, time, scene);
    }
    /// The last step is done or has failed.
    fn finish(&mut self) {}
}

/// An observer that does nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Sums over the steps.
#[derive(Default)]
struct Totals {
    step_times: Vec<f64>,
    solver: SolverSummary,
    energy: EnergySummary,
    volume: VolumeSummary,
    reactions: Vec<Option<f64>>,
    /// Volume over that at rest of every body with axes: smallest, largest and last.
    volume_ratios: Vec<[f64; 3]>,
    probes: f64,
    frames: f64,
    gpu: Option<GpuSummary>,
}

impl Totals {
    fn add(&mut self, report: &StepReport) {
        let s = &mut self.solver;
        s.cg_iterations += u64::from(report.cg_iterations);
        s.cg_iterations_max = s.cg_iterations_max.max(report.cg_iterations);
        s.newton_iterations += u64::from(report.newton_iterations);
        s.newton_iterations_max = s.newton_iterations_max.max(report.newton_iterations);
        s.evaluations += u64::from(report.evaluations);
        s.worst_residual = s.worst_residual.max(report.cg_residual);
        s.worst_newton_step = s.worst_newton_step.max(report.newton_step);
        // a running mean: the time of this step is booked already
        let done = self.step_times.len().max(1) as f64;
        let error = report.linearisation_error;
        s.linearisation_error_mean += (error - s.linearisation_error_mean) / done;
        s.linearisation_error_max = s.linearisation_error_max.max(error);
        s.cg_caps += u64::from(report.cg_caps);
        if s.preconditioner != report.preconditioner && !report.preconditioner.is_empty() {
            report.preconditioner.clone_into(&mut s.preconditioner);
        }
        s.preconditioner_refreshes += u64::from(report.preconditioner_refreshes);
        s.preconditioner_breakdowns += u64::from(report.preconditioner_breakdowns);
        s.precision_fallbacks += u64::from(report.precision_fallbacks);
        s.gradient_fallbacks += u64::from(report.gradient_fallbacks);
        s.projections += u64::from(report.projections);
        s.clamped_elements += report.clamped_elements;
        s.backtracks += u64::from(report.backtracks);
        s.line_search_failures += u64::from(report.line_search_failures);
        s.energy_caps += u64::from(report.energy_caps);
        s.unconverged_steps += u64::from(report.unconverged);
        s.recovering += u64::from(report.recovering);
        s.load_partings += u64::from(report.load_partings);
        s.second_order_steps += u64::from(report.second_order_steps);
        let f = &report.fallbacks;
        let reasons = [f.start, f.indefinite, f.shortened, f.energy, f.inverted, f.waiting];
        for (sum, count) in s.fallbacks.iter_mut().zip(reasons) {
            *sum += u64::from(count);
        }
        s.substeps += u64::from(report.substeps);
        s.refinements += u64::from(report.refinements);
        if report.stable_step > 0.0 {
            let smallest = s.stable_step.unwrap_or(f64::INFINITY).min(report.stable_step);
            s.stable_step = Some(smallest);
        }
        let e = &mut self.energy;
        e.load_work += report.load_work;
        e.initial += report.recovery_energy;
        e.constraint_work += report.constraint_work;
        e.damping += report.damping_dissipation;
        e.elastic = report.elastic_energy;
        e.kinetic = report.kinetic_energy;
        e.elastic_max = e.elastic_max.max(e.elastic);
        e.kinetic_max = e.kinetic_max.max(e.kinetic);
    }

    #[cfg(not(feature = "gpu"))]
    fn add_gpu(&mut self, _: &Simulation) {}

    #[cfg(feature = "gpu")]
    fn add_gpu(&mut self, simulation: &Simulation) {
        let Some(own) = simulation.world().get_resource::<sinew::gpu::GpuReport>() else { return };
        let sum = self.gpu.get_or_insert_default();
        sum.adapter.clone_from(&own.adapter);
        sum.software = own.software;
        sum.host_s += own.host_seconds;
        sum.submissions += u64::from(own.submissions);
        sum.bytes_up += own.bytes_up;
        sum.bytes_down += own.bytes_down;
        sum.stalled += u64::from(own.stalled);
        if sum.device_s.is_empty() {
            sum.device_s.clone_from(&own.device_seconds);
        } else {
            for ((_, sum), (_, own)) in sum.device_s.iter_mut().zip(&own.device_seconds) {
                *sum += own;
            }
        }
    }

    fn dissipated(&self) -> f64 {
        let e = &self.energy;
        e.initial + e.load_work + e.constraint_work + e.activation_work
            - e.removed
            - e.elastic
            - e.kinetic
    }
}

/// Runs a scene to its end, or to the step that fails.
///
/// A step that fails is no error here: the summary then has [`RunSummary::failure`], and the files up
/// to that step are written.
///
/// # Errors
/// When the scene cannot be built or a file cannot be written.
pub fn run(
    loaded: &LoadedScene,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<RunSummary, RunError> {
    let start = Instant::now();
    if options.build.steps == Some(0) {
        let (option, remedy) = ("--steps", "give at least 1");
        return Err(RunError::Option { option, found: "0 steps".into(), remedy });
    }
    let mut built = build(loaded, &options.build)?;
    let mut writer = match &options.out {
        Some(folder) => Some(Writer::new(folder, &loaded.scene.name, &built)?),
        None => None,
    };
    let columns = probe_columns(&built.probes);
    let mut totals = Totals::default();
    totals.volume.smallest_j = 1.0;
    totals.volume.final_smallest_j = 1.0;
    totals.reactions = vec![None; built.constraints.len()];
    totals.volume_ratios = vec![[f64::INFINITY, f64::NEG_INFINITY, 1.0]; built.bodies.len()];
    totals.energy.initial = built.simulation.evaluate();
    built.simulation.world_mut().insert_resource(SystemTimes::default());
    totals.energy.elastic = totals.energy.initial;
    let setup = start.elapsed().as_secs_f64();

    let mut failure = None;
    let mut final_probes = record(&mut built, &mut totals, &mut writer, 0)?;
    if let Some(writer) = &mut writer {
        let clock = Instant::now();
        writer.frame(&mut built)?;
        totals.frames += clock.elapsed().as_secs_f64();
    }
    let plan = built.plan.clone();
    observer.built(&mut built);
    observer.start(&loaded.scene.name, plan.steps);
    for done in 1..=plan.steps {
        if plan.mode == Mode::Static {
            let share = done as f64 / plan.steps as f64;
            built.simulation.set_gravity(plan.gravity * share);
        }
        let time = built.simulation.time();
        let removed = resection::apply(&mut built.resections, &mut built.simulation, time, plan.dt);
        totals.energy.removed = built.resections.iter().map(|r| r.summary.energy).sum();
        if let Err(error) = removed {
            failure = Some(error.to_string());
            break;
        }
        let clock = Instant::now();
        let result = built.simulation.step();
        let seconds = clock.elapsed().as_secs_f64();
        if let Err(error) = result {
            failure = Some(error.to_string());
            break;
        }
        totals.step_times.push(seconds);
        let report = built.simulation.report().clone();
        let volume = built.simulation.volume_report().clone();
        totals.add(&report);
        totals.add_gpu(&built.simulation);
        totals.energy.activation_work = built.simulation.activation_work().total;
        let v = &mut totals.volume;
        if volume.smallest_ratio < v.smallest_j {
            v.smallest_j = volume.smallest_ratio;
            v.smallest_j_time = built.simulation.time();
        }
        v.final_smallest_j = volume.smallest_ratio;
        v.inverted_max = v.inverted_max.max(volume.inverted);
        v.inverted_final = volume.inverted;
        let equilibrium = !plan.settings.integrator.facts().dynamic;
        if equilibrium && report.unconverged {
            failure = Some(format!(
                "no equilibrium found in {} Newton iterations (last step {:.1e} of the body size); \
                 apply the loads in more parts (load_steps), or raise \
                 solver.max_newton_iterations",
                report.newton_iterations, report.newton_step
            ));
        }
        let last = done == plan.steps || failure.is_some();
        if last || done % plan.probe_every == 0 {
            final_probes = record(&mut built, &mut totals, &mut writer, done)?;
        }
        if let Some(writer) = &mut writer
            && (last || done % plan.frame_every == 0)
        {
            let clock = Instant::now();
            writer.frame(&mut built)?;
            totals.frames += clock.elapsed().as_secs_f64();
        }
        let time = built.simulation.time();
        observer.step(done, time, &mut built);
        if failure.is_some() {
            break;
        }
    }
    observer.finish();

    let clock = Instant::now();
    let mut files = match writer {
        Some(writer) => writer.finish()?,
        None => Vec::new(),
    };
    totals.frames += clock.elapsed().as_secs_f64();
    let targets: Vec<PathBuf> = options
        .out
        .iter()
        .map(|folder| folder.join("summary.json"))
        .chain(options.json.clone())
        .collect();
    files.extend(targets.iter().map(|path| path.display().to_string()));
    let final_probes = columns.into_iter().zip(final_probes).collect();
    let summary = summarise(loaded, &mut built, totals, setup, start, failure, final_probes, files);
    for path in &targets {
        let error = |source| RunError::Write { path: path.clone(), source };
        let text = serde_json::to_string_pretty(&summary).map_err(|e| error(e.into()))?;
        std::fs::write(path, text + "\n").map_err(error)?;
    }
    Ok(summary)
}

/// Reads the probes and writes their row.
fn record(
    built: &mut BuiltScene,
    totals: &mut Totals,
    writer: &mut Option<Writer>,
    step: u64,
) -> Result<Vec<f64>, RunError> {
    let clock = Instant::now();
    let kinetic = totals.energy.kinetic;
    // evaluations for probes do not count as time of the steps
    let times = built.simulation.world().resource::<SystemTimes>().clone();
    let BuiltScene { simulation, bodies, constraints, probes, .. } = built;
    let values = probe_values(simulation, bodies, constraints, probes, kinetic);
    for (body, ratios) in bodies.iter().zip(&mut totals.volume_ratios) {
        if body.axes.is_some() {
            let ratio = volume(simulation, body) / body.report.statistics.total_volume;
            *ratios = [ratios[0].min(ratio), ratios[1].max(ratio), ratio];
        }
    }
    simulation.world_mut().insert_resource(times);
    let mut at = 0;
    for probe in probes.iter() {
        for quantity in &probe.record {
            if let (Quantity::Reaction, Some(c)) = (quantity, probe.constraint) {
                let size = DVec3::from_slice(&values[at..at + 3]).length();
                let largest = &mut totals.reactions[c];
                *largest = Some(largest.unwrap_or(0.0).max(size));
            }
            at += if quantity.column().2 { 3 } else { 1 };
        }
    }
    if let Some(writer) = writer {
        let report = simulation.report();
        let first = step == 0;
        let volume = simulation.volume_report();
        let e = &totals.energy;
        let mut row = vec![
            simulation.time(),
            e.elastic,
            e.kinetic,
            e.load_work,
            e.constraint_work,
            totals.dissipated(),
            if first { 1.0 } else { volume.smallest_ratio },
            volume.inverted as f64,
            f64::from(report.newton_iterations),
            f64::from(report.cg_iterations),
            totals.step_times.last().map_or(0.0, |s| s * 1e3),
        ];
        row.extend_from_slice(&values);
        writer.row(step, &row)?;
    }
    totals.probes += clock.elapsed().as_secs_f64();
    Ok(values)
}

/// What happened during the run and deserves a word.
fn run_warnings(
    totals: &Totals,
    steps: u64,
    mode: Mode,
    integrator: Integrator,
    precision: Precision,
) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut add = |code: &str, level, subject: &str, message: String, remedy: &str| {
        let (code, subject, remedy) = (code.into(), subject.into(), remedy.into());
        found.push(Warning { code, level, subject, message, remedy });
    };
    let (s, v) = (&totals.solver, &totals.volume);
    if v.inverted_max > 0 {
        add(
            "run.inverted",
            Level::Warning,
            "elements",
            format!(
                "up to {} elements were turned inside out, {} at the end",
                v.inverted_max, v.inverted_final
            ),
            "use model = \"svk_comp\", smaller steps or a finer mesh where it happens",
        );
    }
    if s.cg_caps > 0 {
        add(
            "run.cg.cap",
            Level::Warning,
            "solver",
            format!("{} linear solves stopped at the iteration cap", s.cg_caps),
            "raise solver.max_linear_iterations or linear_tolerance",
        );
    }
    if let Some(gpu) = totals.gpu.as_ref().filter(|gpu| gpu.stalled > 0) {
        add(
            "run.gpu.stalled",
            Level::Warning,
            "gpu",
            format!(
                "{} linear solves could not be brought to the tolerance in f32; worst residual {:.1e}",
                gpu.stalled, s.worst_residual
            ),
            "raise solver.linear_tolerance, or use backend = \"cpu\"",
        );
    }
    if s.unconverged_steps > 0 && mode == Mode::Dynamic {
        add(
            "run.newton.unconverged",
            Level::Warning,
            "solver",
            format!("Newton did not converge in {} of {steps} steps", s.unconverged_steps),
            "use a smaller dt, a smaller linear_tolerance or more max_newton_iterations",
        );
    }
    if s.gradient_fallbacks > 0 {
        add(
            "run.gradient",
            Level::Warning,
            "solver",
            format!("{} linear solves fell back to a gradient step", s.gradient_fallbacks),
            "use a smaller dt; elements are far out of shape",
        );
    }
    if s.line_search_failures > 0 {
        add(
            "run.line-search",
            Level::Warning,
            "solver",
            format!(
                "in {} steps a body was halted where it was, no lower energy was found",
                s.line_search_failures
            ),
            "use a smaller dt or a smaller linear_tolerance",
        );
    }
    if s.energy_caps > 0 {
        add(
            "run.energy.cap",
            Level::Warning,
            "solver",
            format!("in {} steps a body was slowed down to keep its energy bounded", s.energy_caps),
            "the motion is damped there; use a smaller dt where it matters",
        );
    }
    if s.backtracks > 0 && !integrator.converges() {
        add(
            "run.backtrack",
            Level::Note,
            "solver",
            format!("{} steps were shortened by the line search", s.backtracks),
            "the motion is damped there; use a smaller dt where it matters",
        );
    }
    if let Some(caution) = integrator.facts().caution {
        add(
            "run.not-robust",
            Level::Note,
            "solver",
            caution.into(),
            "compare with integrator = \"tr-bdf2\", or leave the integrator out",
        );
    }
    if s.recovering > 0 {
        add(
            "run.recovery",
            Level::Note,
            "solver",
            format!("in {} steps a body moved by the corotational energy", s.recovering),
            "nothing to do; its own law is back when it is in shape again",
        );
    }
    if s.load_partings > 0 {
        add(
            "run.load-parts",
            Level::Note,
            "solver",
            format!("loads were applied in parts, {} halvings", s.load_partings),
            "nothing to do; a larger load_steps may save the failed attempts",
        );
    }
    if s.refinements > 0 {
        add(
            "run.refinement",
            Level::Note,
            "solver",
            format!("substeps were halved {} times because the energy grew", s.refinements),
            "nothing to do; a smaller explicit_safety avoids the repetition",
        );
    }
    if s.projections > 0 {
        add(
            "run.projection",
            Level::Note,
            "solver",
            format!("{} steps or iterations used the projected tangent", s.projections),
            "nothing to do; a sign of strong compression, inverted elements or large steps",
        );
    }
    if integrator.facts().dynamic {
        let e = &totals.energy;
        let work = e.load_work.abs() + e.constraint_work.abs() + e.activation_work.abs();
        let scale = e.initial + work + e.elastic_max;
        // what runs on the device is f32 whatever the columns hold
        let share = match precision {
            _ if integrator.facts().energy_swings => 1e-2,
            Precision::F64 => 1e-6,
            Precision::F32 => 1e-3,
        };
        let dissipated = totals.dissipated();
        if dissipated < -share * scale {
            add(
                "run.energy.gain",
                Level::Warning,
                "energy",
                format!("{:.2e} J more at the end than was put in", -dissipated),
                "use a smaller dt or integrator = \"safe\"",
            );
        }
    }
    found
}

fn summarise(
    loaded: &LoadedScene,
    built: &mut BuiltScene,
    mut totals: Totals,
    setup: f64,
    start: Instant,
    failure: Option<String>,
    final_probes: Vec<(String, f64)>,
    files: Vec<String>,
) -> RunSummary {
    let scene = &loaded.scene;
    let dynamic = built.plan.mode == Mode::Dynamic;
    let precision = built.simulation.precision();
    let settings = &built.plan.settings;
    let steps = totals.step_times.len() as u64;
    let equilibrium = !settings.integrator.facts().dynamic;
    totals.energy.dissipated = (!equilibrium).then(|| totals.dissipated());
    let mut warnings = std::mem::take(&mut built.warnings);
    let on_gpu = built.simulation.backend() == Backend::Gpu;
    let arithmetic = if on_gpu { Precision::F32 } else { precision };
    let integrator = settings.integrator;
    warnings.extend(run_warnings(&totals, steps, built.plan.mode, integrator, arithmetic));

    let stepping: f64 = totals.step_times.iter().sum();
    let total = start.elapsed().as_secs_f64();
    let simulated = if dynamic { built.simulation.time() } else { 0.0 };
    let stage = |name, seconds: f64, every_step: bool| Stage {
        name,
        total_s: seconds,
        per_step_ms: every_step.then(|| 1e3 * seconds / steps.max(1) as f64),
        share: seconds / total,
    };
    let mut stages = vec![
        stage("set-up", setup, false),
        stage("steps", stepping, true),
        stage("probes", totals.probes, true),
    ];
    if totals.frames > 1e-3 * total {
        stages.push(stage("frames", totals.frames, true));
    }
    let timing = Timing {
        total_s: total,
        simulated_s: simulated,
        real_time_factor: (dynamic && stepping > 0.0).then(|| simulated / stepping),
        step: StepTiming::of(totals.step_times),
        stages,
        systems: built
            .simulation
            .world()
            .resource::<SystemTimes>()
            .entries
            .iter()
            .map(|entry| SystemSummary {
                name: entry.name,
                total_s: entry.seconds,
                runs: entry.runs,
                per_step_ms: 1e3 * entry.seconds / steps.max(1) as f64,
                share: if stepping > 0.0 { entry.seconds / stepping } else { 0.0 },
            })
            .collect(),
    };

    let bodies: Vec<BodySummary> = built
        .bodies
        .iter()
        .zip(&totals.volume_ratios)
        .map(|(body, &ratios)| {
            let muscles = built.simulation.world().get_resource::<Muscles>();
            let activation = |family: &str| {
                let mut own = muscles?.iter().filter(|m| m.body == body.handle.0);
                own.find(|m| m.family == family).map(|m| m.activation())
            };
            let statistics = &body.report.statistics;
            let blocks = &built.simulation.topology().bodies[body.handle.0].blocks;
            let extent = statistics
                .bounds
                .map_or([0.0; 3], |[low, high]| std::array::from_fn(|k| high[k] - low[k]));
            BodySummary {
                name: body.name.clone(),
                source: body.mesh.source.clone(),
                vertices: body.used_vertices.len(),
                unused_vertices: body.mesh.points.len() - body.used_vertices.len(),
                tetrahedra: body.mesh.tetrahedra.len(),
                hexahedra: body.mesh.hexahedra.len(),
                edges: blocks.len(),
                volume: statistics.total_volume,
                mass: body.mass,
                extent,
                worst_quality: statistics.worst_quality,
                preset: body.preset.clone(),
                material: body.material,
                model: body.model,
                evaluation: body.evaluation,
                element_method: body.element_method,
                membrane: body.membrane.as_ref().map(|m| MembraneSummary {
                    triangles: m.triangles.len(),
                    quads: m.quads.len(),
                    area: m.area,
                    thickness: m.settings.thickness,
                    material: m.settings.material,
                    model: m.settings.model,
                    evaluation: m.settings.evaluation,
                    element_method: m.settings.springs,
                }),
                axes: body.axes.as_ref().map(|axes| AxesSummary::new(axes, activation, ratios)),
            }
        })
        .collect();
    let constraints = built
        .constraints
        .iter()
        .zip(&totals.reactions)
        .map(|(c, &largest_reaction)| ConstraintSummary {
            name: c.name.clone(),
            body: built.bodies[c.body].name.clone(),
            vertices: c.vertices.len(),
            axes: (0..3).filter(|&k| c.axes.holds(k)).map(|k| ['x', 'y', 'z'][k]).collect(),
            motion: c.motion.clone(),
            from: c.from.is_finite().then_some(c.from),
            until: c.until.is_finite().then_some(c.until),
            largest_reaction,
        })
        .collect();
    let pressures = built.pressures.iter().map(|p| PressureSummary {
        name: p.name.clone(),
        body: built.bodies[p.body].name.clone(),
        triangles: p.triangles,
        pressure: p.pressure,
    });
    let loads = built
        .loads
        .iter()
        .map(|load| LoadSummary {
            name: load.name.clone(),
            body: built.bodies[load.body].name.clone(),
            vertices: load.vertices,
            force: load.force.to_array(),
        })
        .collect();
    let threads = built.simulation.world().resource::<Workers>().threads();
    RunSummary {
        schema: SCHEMA,
        completed: failure.is_none(),
        failure,
        scene: SceneSummary {
            name: scene.name.clone(),
            description: scene.description.trim().to_string(),
            file: loaded.file.display().to_string(),
            mode: if dynamic { "dynamic" } else { "static" },
            gravity: scene.gravity,
            bodies: bodies.len(),
            vertices: bodies.iter().map(|b| b.vertices).sum(),
            tetrahedra: bodies.iter().map(|b| b.tetrahedra).sum(),
            hexahedra: bodies.iter().map(|b| b.hexahedra).sum(),
            edges: bodies.iter().map(|b| b.edges).sum(),
        },
        machine: Machine::this(),
        versions: Versions::this(),
        settings: Settings {
            dt: built.plan.dt,
            steps: built.plan.steps,
            precision: precision.name(),
            backend: built.simulation.backend().name(),
            threads,
            solver: settings.clone(),
        },
        bodies,
        constraints,
        loads,
        resections: built.resections.iter().map(|r| r.summary.clone()).collect(),
        pressures: pressures.collect(),
        final_probes,
        timing,
        gpu: totals.gpu,
        solver: totals.solver,
        energy: totals.energy,
        volume: totals.volume,
        warnings,
        files,
        final_state_hash: format!("{:016x}", built.simulation.state_hash()),
    }
}
