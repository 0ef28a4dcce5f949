//! Runs a scene: steps, probes, frames, and the figures of the summary.

mod checkpoint;
mod facts;
mod log;
mod totals;

use crate::assemble::{BuildOptions, BuiltScene, build};
use crate::error::RunError;
use crate::output::Writer;
use crate::probe::{self, Recorded, Sampler};
use crate::scene::LoadedScene;
use crate::summary::{EnergySummary, RunSummary};
use checkpoint::Checkpoints;
use facts::RunFacts;
pub use log::{LogOptions, replay};
use sinew::engine::report::SystemTimes;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use totals::Totals;

/// How a scene is run.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// What replaces values of the scene.
    pub build: BuildOptions,
    /// Folder for frames, probes and summary; nothing is written without it.
    pub out: Option<PathBuf>,
    /// File for the JSON summary.
    pub json: Option<PathBuf>,
    /// Ends the run after the step at hand once it is set, with all files complete.
    pub interrupt: Option<Arc<AtomicBool>>,
    /// Simulated time (s) between checkpoints in the folder.
    pub checkpoint: Option<f64>,
    /// Goes on from the last checkpoint in the folder, if there is one.
    pub resume: bool,
    /// Writes every input and hashes of states.
    pub record: Option<LogOptions>,
}

/// Is told how a run gets on.
#[allow(unused_variables, reason = "one that does nothing keeps the names for its document")]
pub trait Observer {
    /// The scene is built and at rest.
    fn built(&mut self, scene: &mut BuiltScene) {}
    /// It goes on from a checkpoint after so many steps, or from the beginning, since there is none; damaged checkpoints
    /// were passed over.
    fn resumed(&mut self, done: Option<u64>, damaged: &[PathBuf]) {}
    /// The scene is built; `steps` follow.
    fn start(&mut self, name: &str, steps: u64) {}
    /// `done` steps are done, the clock stands at `time` (s).
    fn step(&mut self, done: u64, time: f64, scene: &mut BuiltScene) {}
    /// The probes were read after `step` steps at `time` (s); [`columns`](crate::probe::columns) names the values.
    fn row(&mut self, step: u64, time: f64, probes: &[f64]) {}
    /// The last step is done or has failed.
    fn finish(&mut self) {}
}

/// Two observers: the second is told after the first.
pub struct Both<'a>(pub &'a mut dyn Observer, pub &'a mut dyn Observer);

impl Observer for Both<'_> {
    fn built(&mut self, scene: &mut BuiltScene) {
        self.0.built(scene);
        self.1.built(scene);
    }

    fn resumed(&mut self, done: Option<u64>, damaged: &[PathBuf]) {
        self.0.resumed(done, damaged);
        self.1.resumed(done, damaged);
    }

    fn start(&mut self, name: &str, steps: u64) {
        self.0.start(name, steps);
        self.1.start(name, steps);
    }

    fn step(&mut self, done: u64, time: f64, scene: &mut BuiltScene) {
        self.0.step(done, time, scene);
        self.1.step(done, time, scene);
    }

    fn row(&mut self, step: u64, time: f64, probes: &[f64]) {
        self.0.row(step, time, probes);
        self.1.row(step, time, probes);
    }

    fn finish(&mut self) {
        self.0.finish();
        self.1.finish();
    }
}

/// An observer that does nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {}

/// A run on its way.
struct SceneRun<'a> {
    built: BuiltScene,
    totals: Totals,
    writer: Option<Writer>,
    observer: &'a mut dyn Observer,
    /// Last values of the probes.
    probes: Vec<f64>,
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
    let folder = options.out.as_deref();
    let checkpoints = match options.checkpoint {
        Some(interval) => Some(Checkpoints::new(interval, folder, loaded, &mut built)?),
        None => None,
    };
    let (mut run, first) = begin(loaded, options, built, observer)?;
    if let Some(options) = &options.record {
        log::begin(loaded, &mut run.built.simulation, options)?;
    }
    run.built.simulation.world_mut().insert_resource(SystemTimes::default());
    let setup = start.elapsed().as_secs_f64();
    run.observer.built(&mut run.built);
    let steps = run.built.plan.steps;
    run.observer.start(&loaded.scene.name, steps);
    let mut failure = None;
    for done in first..=steps {
        let interrupted = options.interrupt.as_ref().is_some_and(|i| i.load(Ordering::Relaxed));
        failure = match run.step(done, done == steps) {
            Ok(failure) => failure,
            // no room, or the folder is gone: what is there is kept whole
            Err(error) => Some(format!("interrupted in step {done} of {steps}: {error}")),
        };
        if failure.is_none()
            && let Some(checkpoints) = &checkpoints
        {
            let written = checkpoints.after_step(&mut run, done);
            failure =
                written.err().map(|e| format!("interrupted after step {done} of {steps}: {e}"));
        }
        if interrupted && done < steps && failure.is_none() {
            let message = format!("interrupted after step {done} of {steps}");
            // after the checkpoint, which knows nothing of them: a run that goes on writes what one would that never stopped
            let written = run.out_of_turn(done);
            failure = Some(written.err().map_or(message.clone(), |e| format!("{message}: {e}")));
        }
        if failure.is_some() {
            break;
        }
    }
    run.observer.finish();
    if let Err(error) = run.built.simulation.stop_recording() {
        failure = failure.or_else(|| Some(format!("the log could not be written: {error}")));
    }
    if failure.is_none() {
        checkpoints.iter().for_each(Checkpoints::remove);
    }
    let untrue = match &failure {
        None => run.built.simulation.verdict().err().map(|e| e.to_string()),
        Some(_) => None,
    };
    let untrusted = untrue.is_some();
    failure = failure.or(untrue);

    let SceneRun { built, mut totals, writer, probes, .. } = run;
    let clock = Instant::now();
    let mut files = match writer.map(Writer::finish) {
        Some(Err(error)) if failure.is_none() => return Err(error),
        Some(written) => written.unwrap_or_default(),
        None => Vec::new(),
    };
    totals.frames += clock.elapsed().as_secs_f64();
    let targets: Vec<PathBuf> = options
        .out
        .iter()
        .map(|folder| folder.join("summary.json"))
        .chain(options.json.clone())
        .collect();
    files.extend(options.record.iter().map(|log| format!("{} (log)", log.path.display())));
    files.extend(targets.iter().map(|path| path.display().to_string()));
    let final_probes = probe::columns(&built.probes).into_iter().zip(probes).collect();
    let facts =
        RunFacts { loaded, built, totals, start, setup, failure, untrusted, final_probes, files };
    let summary = facts.summary();
    for path in &targets {
        let error = |source| RunError::Write { path: path.clone(), source };
        let text = serde_json::to_string_pretty(&summary).map_err(|e| error(e.into()))?;
        std::fs::write(path, text + "\n").map_err(|source| {
            // half a summary would be worse than none
            let _ = std::fs::remove_file(path);
            error(source)
        })?;
    }
    Ok(summary)
}

/// A run before its first step, whose number is returned too: at the start of the scene or at its last checkpoint.
fn begin<'a>(
    loaded: &LoadedScene,
    options: &RunOptions,
    mut built: BuiltScene,
    observer: &'a mut dyn Observer,
) -> Result<(SceneRun<'a>, u64), RunError> {
    let name = &loaded.scene.name;
    if options.resume {
        let Some(folder) = &options.out else {
            let (option, found) = ("--resume", "no folder to go on in".into());
            return Err(RunError::Option { option, found, remedy: "give --out DIR as well" });
        };
        let (state, damaged) = checkpoint::last(folder, loaded, &built)?;
        if let Some(state) = state {
            let (done, of_writer) = (state.done, state.writer.clone());
            // what is told, and what is taken off the files, comes after all that may be refused
            let (totals, probes) = state.resume(&mut built)?;
            let writer = Some(Writer::resume(folder, name, &mut built, of_writer)?);
            observer.resumed(Some(done), &damaged);
            return Ok((SceneRun { built, totals, writer, observer, probes }, done + 1));
        }
        observer.resumed(None, &damaged);
    }
    let writer = match &options.out {
        // a run that was to go on has told already that it begins at its start
        Some(folder) => Some(Writer::new(folder, name, &mut built, !options.resume)?),
        None => None,
    };
    let totals = Totals::new(&mut built);
    let mut run = SceneRun { built, totals, writer, observer, probes: Vec::new() };
    run.record(0)?;
    run.frame()?;
    Ok((run, 1))
}

impl SceneRun<'_> {
    /// Carries out step `done` (counted from 1) with its removals, probes and frame, whether it is the `last`;
    /// why it failed, if it did.
    fn step(&mut self, done: u64, last: bool) -> Result<Option<String>, RunError> {
        let prepared = self.built.prepare_step(done);
        if let Err(error) = prepared {
            return Ok(Some(error.to_string()));
        }
        let clock = Instant::now();
        if let Err(error) = self.built.simulation.step() {
            self.totals.failed = Some(clock.elapsed().as_secs_f64());
            return Ok(Some(error.to_string()));
        }
        self.totals.add_step(&self.built, clock.elapsed().as_secs_f64());
        let BuiltScene { simulation, plan, .. } = &mut self.built;
        let report = simulation.report();
        let equilibrium = !plan.settings.integrator.facts().dynamic;
        let failure = (equilibrium && report.unconverged).then(|| {
            format!(
                "no equilibrium found in {} Newton iterations (last step {:.1e} of the body size); \
                 apply the loads in more parts (load_steps), or raise \
                 solver.max_newton_iterations",
                report.newton_iterations, report.newton_step
            )
        });
        let time = simulation.time();
        let last = last || failure.is_some();
        let (probe_every, frame_every) = (plan.probe_every, plan.frame_every);
        if last || done.is_multiple_of(probe_every) {
            self.record(done)?;
        }
        if last || done.is_multiple_of(frame_every) {
            self.frame()?;
        }
        self.observer.step(done, time, &mut self.built);
        Ok(failure)
    }

    /// Writes the row and the frame of a step at which none is due.
    fn out_of_turn(&mut self, done: u64) -> Result<(), RunError> {
        if !done.is_multiple_of(self.built.plan.probe_every) {
            self.record(done)?;
        }
        if !done.is_multiple_of(self.built.plan.frame_every) {
            self.frame()?;
        }
        Ok(())
    }

    /// Writes a frame, if files are asked for.
    fn frame(&mut self) -> Result<(), RunError> {
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let clock = Instant::now();
        writer.frame(&mut self.built)?;
        self.totals.frames += clock.elapsed().as_secs_f64();
        Ok(())
    }

    /// Reads the probes and writes their row.
    fn record(&mut self, step: u64) -> Result<(), RunError> {
        let clock = Instant::now();
        let totals = &mut self.totals;
        let touches = self.built.touches();
        let own = &mut self.built;
        let BuiltScene { simulation, bodies, probes, constraints, tools, .. } = own;
        let (pulls, contacts, threads, clips) =
            (&own.pulls, &own.contacts, &own.strands, &own.clips);
        let parts = Recorded { bodies, constraints, tools, pulls, contacts, threads, clips };
        // evaluations for probes do not count as time of the steps
        let times = simulation.world().resource::<SystemTimes>().clone();
        let reactions = &mut totals.reactions;
        let e = simulation.totals().map_or_else(
            || EnergySummary { elastic: totals.initial, ..EnergySummary::default() },
            |sums| sums.energy,
        );
        let mut now = Sampler::new(simulation, e.kinetic);
        self.probes = probe::values(&mut now, &parts, probes, |c, force| {
            reactions[c] = Some(reactions[c].unwrap_or(0.0).max(force.length()));
        });
        for (body, ratios) in parts.bodies.iter().zip(&mut totals.volume_ratios) {
            if body.axes.is_some() {
                let ratio = body.volume(simulation) / body.report.statistics.total_volume;
                *ratios = [ratios[0].min(ratio), ratios[1].max(ratio), ratio];
            }
        }
        simulation.world_mut().insert_resource(times);
        self.observer.row(step, simulation.time(), &self.probes);
        if let Some(writer) = &mut self.writer {
            let (report, volume) = (simulation.report(), simulation.volume_report());
            let mut row = vec![
                simulation.time(),
                e.elastic,
                e.kinetic,
                e.load_work,
                e.constraint_work,
                e.recovery,
                e.dissipated.unwrap_or(0.0),
                if step == 0 { 1.0 } else { volume.smallest_ratio },
                volume.inverted as f64,
                f64::from(report.newton_iterations),
                f64::from(report.cg_iterations),
                1e3 * totals.step_times.last(),
            ];
            if touches {
                let (now, e) = (report.contact, e.contact.unwrap_or_default());
                row.extend([e.work, e.stored, e.friction, f64::from(now.points), now.depth]);
                row.extend([f64::from(now.inner_iterations), f64::from(u8::from(now.missed))]);
            }
            row.extend_from_slice(&self.probes);
            writer.row(step, &row)?;
        }
        self.totals.probes += clock.elapsed().as_secs_f64();
        Ok(())
    }
}
