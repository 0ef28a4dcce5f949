//! Which settings a scene should run with on this machine: a small search over integrator, step,
//! tolerance, precision, evaluation and threads, held against a budget of wall time and an
//! error. The material stays what it is, models among it.
//!
//! The budget is the mean wall time per displayed frame, a frame being the `dt` of the scene file (two
//! half steps make one frame); of a static scene it is the wall time to the equilibrium. The error is
//! the largest distance of a vertex from where a converged run of the same scene has it, at any time
//! of comparison, over the largest displacement of that run. That is the error of the solver; what the mesh adds is searched
//! apart, over other elements ([`cuts`]), where a largest one is asked for.

use crate::machine::{Load, MachineNotes, Watch};
use crate::measures::{displacement_error, front, quantile};
use crate::table::{Table, three_digits};
use crate::table_of;
use serde::Serialize;
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::prelude::*;
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::error::SceneError;
use sinew_scene::scene::{BodyEntry, LoadedScene, Mode, PrecisionName};
use sinew_scene::summary::{evaluation_name, model_name};
use std::time::Instant;

pub mod cuts;
use cuts::Cuts;

/// Name and version of the JSON.
pub const SCHEMA: &str = "sinew-advise/1";

/// What may fail on the way to advice.
pub type Result<T, E = AdviseError> = std::result::Result<T, E>;

/// Advice that cannot be given.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AdviseError {
    /// The scene cannot be read or built.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The solution that errors are measured against does not exist, or no run came to its end.
    #[error("{scene}: no converged solution to measure errors against: {reason}")]
    NoTruth {
        /// Name of the scene.
        scene: String,
        /// What happened.
        reason: String,
    },
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Request {
    /// Wall time (s) per frame, or to the equilibrium.
    pub budget_s: f64,
    /// Error of the solver (a share, not percent).
    pub error: f64,
    /// Error of the mesh (a share); the scene keeps its elements without.
    pub mesh_error: Option<f64>,
}

/// Reads a time such as `16ms`, `0.5 s`, `800us` or a rate such as `60fps`; in seconds.
///
/// # Errors
/// When it is no positive time.
pub fn parse_budget(text: &str) -> Result<f64, String> {
    let fail = || format!("`{text}` is no time per frame: write 16ms, 800us, 0.5s or 60fps");
    let text = text.trim();
    let split = text.find(|c: char| c.is_alphabetic() || c == 'µ').ok_or_else(fail)?;
    let (number, unit) = text.split_at(split);
    let number: f64 = number.trim().parse().map_err(|_| fail())?;
    let seconds = match unit {
        "s" => number,
        "ms" => number * 1e-3,
        "us" | "µs" => number * 1e-6,
        "fps" | "Hz" => 1.0 / number,
        _ => return Err(fail()),
    };
    if seconds > 0.0 && seconds.is_finite() { Ok(seconds) } else { Err(fail()) }
}

/// Reads a share such as `2%`.
///
/// # Errors
/// When it is no percentage above 0.
pub fn parse_error(text: &str) -> Result<f64, String> {
    let fail = || format!("`{text}` is no error: write a percentage such as 2% or 0.5%");
    let number = text.trim().strip_suffix('%').ok_or_else(fail)?;
    let percent: f64 = number.trim().parse().map_err(|_| fail())?;
    if percent > 0.0 && percent.is_finite() { Ok(percent / 100.0) } else { Err(fail()) }
}

/// What replaces values of a scene; `None` leaves them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// Integrator.
    pub integrator: Option<Integrator>,
    /// Step (s); dynamic scenes.
    pub dt: Option<f64>,
    /// Load steps; static scenes.
    pub load_steps: Option<u32>,
    /// Relative residual of linear systems.
    pub linear_tolerance: Option<f64>,
    /// Last Newton step over body size.
    pub newton_tolerance: Option<f64>,
    /// Number type.
    pub precision: Option<Precision>,
    /// Evaluation of all bodies.
    pub evaluation: Option<Evaluation>,
    /// Energy of all bodies.
    pub model: Option<Model>,
    /// Threads.
    pub threads: Option<usize>,
}

impl Choice {
    /// Writes what was chosen into a scene.
    pub fn apply(&self, loaded: &mut LoadedScene) {
        let scene = &mut loaded.scene;
        let solver = &mut scene.solver;
        solver.integrator = self.integrator.unwrap_or(solver.integrator);
        solver.linear_tolerance = self.linear_tolerance.unwrap_or(solver.linear_tolerance);
        solver.newton_tolerance = self.newton_tolerance.unwrap_or(solver.newton_tolerance);
        scene.dt = self.dt.or(scene.dt);
        scene.load_steps = self.load_steps.or(scene.load_steps);
        scene.threads = self.threads.unwrap_or(scene.threads);
        if let Some(precision) = self.precision {
            scene.precision = match precision {
                Precision::F64 => PrecisionName::F64,
                Precision::F32 => PrecisionName::F32,
            };
        }
        for body in &mut scene.bodies {
            body.evaluation = self.evaluation.unwrap_or(body.evaluation);
            body.model = self.model.unwrap_or(body.model);
        }
    }

    /// Options of `sinew run` that make the same choice.
    pub fn options(&self) -> String {
        let mut words = Vec::new();
        let mut add = |name: &str, value: Option<String>| {
            words.extend(value.map(|value| format!("--{name} {value}")));
        };
        add("integrator", self.integrator.map(|i| i.name().to_string()));
        add("dt", self.dt.map(|x| x.to_string()));
        add("load-steps", self.load_steps.map(|n| n.to_string()));
        add("linear-tolerance", self.linear_tolerance.map(|x| format!("{x:e}")));
        add("newton-tolerance", self.newton_tolerance.map(|x| format!("{x:e}")));
        add("precision", self.precision.map(|p| p.name().to_string()));
        add("evaluation", self.evaluation.map(|e| evaluation_name(e).to_string()));
        add("model", self.model.map(|m| model_name(m).to_string()));
        add("threads", self.threads.map(|n| n.to_string()));
        words.join(" ")
    }
}

/// One run of the search.
#[derive(Clone, Debug, Serialize)]
pub struct AdviceRow {
    /// Integrator.
    pub integrator: String,
    /// Step (s), or load steps of a static scene.
    pub step: String,
    /// Relative residual of linear systems; `None` for explicit integrators.
    pub linear_tolerance: Option<f64>,
    /// Last Newton step over body size; `None` for integrators without.
    pub newton_tolerance: Option<f64>,
    /// `f64` or `f32`.
    pub precision: String,
    /// Evaluation.
    pub evaluation: String,
    /// Energy.
    pub model: String,
    /// Threads.
    pub threads: usize,
    /// Mean wall time per frame, or to the equilibrium (ms).
    pub frame_ms: f64,
    /// 95th percentile of the frames (ms).
    pub frame_p95_ms: f64,
    /// Wall time per simulated second (s); `None` for static scenes.
    pub cost: Option<f64>,
    /// Error (%); `None` when the run failed or was stopped.
    pub error_percent: Option<f64>,
    /// No other row is both faster and nearer.
    pub pareto: bool,
    /// What the reader must know.
    pub note: String,
    /// Options of `sinew run`.
    pub options: String,
    /// The settings.
    #[serde(skip)]
    pub choice: Choice,
}

/// What the search found.
#[derive(Clone, Debug, Serialize)]
pub struct Advice {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Scene file.
    pub scene: String,
    /// Where it ran.
    pub machine: MachineNotes,
    /// Load during the search.
    pub load: Load,
    /// What was asked for.
    pub request: Request,
    /// Simulated time over which errors are measured (s); 0 for a static scene.
    pub horizon_s: f64,
    /// Whether the scene goes on after that.
    pub shortened: bool,
    /// Other elements that were tried, where an error of the mesh was asked for; everything below is of the one chosen.
    pub cuts: Option<Cuts>,
    /// How the converged run was made.
    pub truth: String,
    /// Estimate of its own error (%).
    pub truth_error_percent: f64,
    /// All runs.
    pub rows: Vec<AdviceRow>,
    /// Index of the recommended row, or of the best trade-off when the request cannot be met.
    pub best: usize,
    /// Mean wall time per frame when it was measured again (ms).
    pub again_ms: f64,
    /// Whether the recommended row meets the request, also when measured again.
    pub met: bool,
}

/// A scene being searched.
#[derive(Clone, Copy)]
struct AdviceSearch<'a> {
    loaded: &'a LoadedScene,
    request: Request,
    /// Frames of the horizon; load steps do not count.
    frames: u64,
    /// Frames between comparisons.
    every: u64,
    dt: f64,
    fixed: bool,
}

/// A finished or given up run.
struct TimedRun {
    states: Vec<Vec<DVec3>>,
    frames: Vec<f64>,
    note: String,
    finished: bool,
}

/// States of a converged run, how it was made, estimate of its own error.
type Converged = (Vec<Vec<DVec3>>, String, f64);

/// Wall time (s) that a candidate may take.
const CANDIDATE_SECONDS: f64 = 20.0;
/// Wall time (s) that every candidate gets.
const PATIENCE_SECONDS: f64 = 2.0;
/// Wall time (s) that the horizon should take with the settings of the scene.
const HORIZON_SECONDS: f64 = 2.0;
/// Candidates above so many budgets are given up.
const HOPELESS: f64 = 5.0;

/// Searches; `tell` hears what is going on.
///
/// # Errors
/// When the scene cannot be read or built, or no converged run can be had.
pub fn advise(
    loaded: &LoadedScene,
    request: Request,
    mut tell: impl FnMut(&str),
) -> Result<Advice> {
    let watch = Watch::start();
    let (mut cuts, mut own) = (None, loaded.clone());
    if let Some(largest) = request.mesh_error {
        // converged steps on finer meshes take many times as long
        let (search, _) = AdviceSearch::of(loaded, request, HORIZON_SECONDS / 8.0)?;
        let found = search.cuts(largest, &mut tell)?;
        own = found.chosen(loaded);
        cuts = Some(found);
    }
    let loaded = &own;
    let (search, all_frames) = AdviceSearch::of(loaded, request, HORIZON_SECONDS)?;
    let fixed = search.fixed;
    tell("converged run");
    let (truth, how, own) = search.truth(&mut tell)?;

    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut rows: Vec<AdviceRow> = Vec::new();
    let mut tried: Vec<Choice> = Vec::new();
    let mut attempt = |choice: Choice, rows: &mut Vec<AdviceRow>| -> Result<()> {
        if !tried.contains(&choice) {
            tell(&format!("trying {}", choice.options()));
            rows.push(search.row(&choice, &truth)?);
            tried.push(choice);
        }
        Ok(())
    };
    for choice in search.first_choices() {
        attempt(choice, &mut rows)?;
    }
    // one thing at a time from everything on the front, twice, so that two changes can meet
    for _ in 0..2 {
        mark(&mut rows);
        let good: Vec<Choice> =
            rows.iter().filter(|r| r.pareto).map(|r| r.choice.clone()).collect();
        for choice in good.iter().flat_map(|c| search.neighbours(c, cores)) {
            attempt(choice, &mut rows)?;
        }
    }
    mark(&mut rows);

    let (mut best, mut met) = choose(&rows, request).ok_or_else(|| AdviseError::NoTruth {
        scene: loaded.scene.name.clone(),
        reason: "no run of the search came to its end".into(),
    })?;
    // a figure that was lucky once does not count
    let mut again_ms;
    let mut candidates = rows.clone();
    loop {
        tell("measuring the recommendation again");
        again_ms = search.row(&rows[best].choice, &truth)?.frame_ms;
        if !met || again_ms <= 1e3 * request.budget_s {
            break;
        }
        candidates[best].frame_ms = again_ms;
        rows[best].note = format!("{} ms when measured again", three_digits(again_ms));
        (best, met) = choose(&candidates, request).unwrap_or((best, false));
    }
    Ok(Advice {
        schema: SCHEMA,
        scene: loaded.file.display().to_string(),
        machine: MachineNotes::now(),
        load: watch.finish(),
        request,
        horizon_s: if fixed { 0.0 } else { search.frames as f64 * search.dt },
        shortened: !fixed && search.frames + search.every <= all_frames,
        cuts,
        truth: how,
        truth_error_percent: 100.0 * own,
        rows,
        best,
        again_ms,
        met,
    })
}

/// The fastest row that meets the request, or the one that misses it least; and which it is.
fn choose(rows: &[AdviceRow], request: Request) -> Option<(usize, bool)> {
    let excess = |row: &AdviceRow| {
        let error = row.error_percent.map_or(f64::INFINITY, |e| e / 100.0 / request.error);
        (row.frame_ms * 1e-3 / request.budget_s).max(error)
    };
    let least = |picked: &mut dyn Iterator<Item = (usize, f64)>| {
        picked.filter(|(_, x)| x.is_finite()).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    };
    let meeting = rows.iter().enumerate().filter(|(_, row)| excess(row) <= 1.0);
    match least(&mut meeting.map(|(i, row)| (i, row.frame_ms))) {
        Some(i) => Some((i, true)),
        None => {
            least(&mut rows.iter().enumerate().map(|(i, r)| (i, excess(r)))).map(|i| (i, false))
        }
    }
}

fn mark(rows: &mut [AdviceRow]) {
    let pair = |r: &AdviceRow| [r.frame_ms, r.error_percent.unwrap_or(f64::NAN)];
    let pairs: Vec<[f64; 2]> = rows.iter().map(pair).collect();
    let on_front = front(&pairs, 0.01);
    for (i, row) in rows.iter_mut().enumerate() {
        row.pareto = on_front.contains(&i);
    }
}

impl<'a> AdviceSearch<'a> {
    /// The part of a scene that takes about so long (s of wall time) with the settings of the scene, and the frames of all
    /// of it.
    fn of(loaded: &'a LoadedScene, request: Request, seconds: f64) -> Result<(Self, u64)> {
        let plan = build(loaded, &BuildOptions::default())?.plan;
        let fixed = plan.mode == Mode::Static;
        let mut search =
            AdviceSearch { loaded, request, frames: plan.steps, every: 1, dt: plan.dt, fixed };
        if !fixed {
            // how much of the scene can be afforded
            let probe = AdviceSearch { frames: plan.steps.min(10), ..search };
            let trial = probe.run(&Choice::default(), None)?;
            let frame = trial.frames.iter().sum::<f64>() / trial.frames.len().max(1) as f64;
            let affordable = (seconds / frame.max(1e-6)) as u64;
            search.frames = plan.steps.min(affordable.max(20));
            search.every = (search.frames / 50).max(1);
            search.frames -= search.frames % search.every;
        }
        Ok((search, plan.steps))
    }
}

impl AdviceSearch<'_> {
    fn first_choices(&self) -> Vec<Choice> {
        let base =
            Choice { threads: Some(1), precision: Some(Precision::F64), ..Choice::default() };
        let mut all = Vec::new();
        if self.fixed {
            for parts in [1, 2, 4, 8] {
                for tolerance in [1e-2, 1e-3] {
                    all.push(Choice {
                        load_steps: Some(parts),
                        linear_tolerance: Some(tolerance),
                        ..base.clone()
                    });
                }
            }
            return all;
        }
        for part in [1.0, 2.0, 4.0, 8.0] {
            for integrator in [Integrator::LinearisedBdf2, Integrator::Safe, Integrator::Newton] {
                all.push(Choice {
                    integrator: Some(integrator),
                    dt: Some(self.dt / part),
                    linear_tolerance: Some(1e-3),
                    ..base.clone()
                });
            }
        }
        if self.loaded.scene.solver.stiffness_damping == 0.0 {
            for &integrator in Integrator::ALL.iter().filter(|i| i.is_explicit()) {
                for part in [1.0, 2.0] {
                    all.push(Choice {
                        integrator: Some(integrator),
                        dt: Some(self.dt / part),
                        ..base.clone()
                    });
                }
            }
        }
        all
    }

    fn neighbours(&self, choice: &Choice, cores: usize) -> Vec<Choice> {
        let mut all = vec![Choice { precision: Some(Precision::F32), ..choice.clone() }];
        let bodies = &self.loaded.scene.bodies;
        let pooled = |body: &BodyEntry| {
            let plain = body.volume == VolumeRule::Elements && !body.second_order;
            plain && choice.model.unwrap_or(body.model).supports(Evaluation::Pooled)
        };
        if bodies.iter().all(pooled) {
            all.push(Choice { evaluation: Some(Evaluation::Pooled), ..choice.clone() });
        }
        if cores > 1 {
            all.push(Choice { threads: Some(cores), ..choice.clone() });
        }
        if let Some(tolerance) = choice.linear_tolerance {
            for factor in [10.0, 0.01] {
                let tolerance = tolerance * factor;
                if (1e-7..=0.05).contains(&tolerance) {
                    all.push(Choice { linear_tolerance: Some(tolerance), ..choice.clone() });
                }
            }
        }
        if self.fixed && choice.newton_tolerance.is_none() {
            for tolerance in [1e-3, 1e-5] {
                all.push(Choice { newton_tolerance: Some(tolerance), ..choice.clone() });
            }
        }
        all
    }

    /// Runs the horizon; stops when `limit` (s of wall time per frame) is exceeded by far.
    fn run(&self, choice: &Choice, limit: Option<f64>) -> Result<TimedRun> {
        let mut loaded = self.loaded.clone();
        choice.apply(&mut loaded);
        let mut scene = build(&loaded, &BuildOptions::default())?;
        let per_frame = if self.fixed { 1 } else { (self.dt / scene.plan.dt).round() as u64 };
        let frames = if self.fixed { scene.plan.steps } else { self.frames };
        let mut run = TimedRun {
            states: Vec::new(),
            frames: Vec::new(),
            note: String::new(),
            finished: false,
        };
        let mut total = 0.0;
        for frame in 1..=frames {
            if self.fixed {
                let share = frame as f64 / frames as f64;
                scene.simulation.set_gravity(scene.plan.gravity * share);
            }
            let start = Instant::now();
            for _ in 0..per_frame {
                scene.drive();
                if let Err(error) = scene.simulation.step() {
                    run.note = format!("failed: {error}");
                    return Ok(run);
                }
            }
            let seconds = start.elapsed().as_secs_f64();
            total += seconds;
            run.frames.push(seconds);
            if self.fixed && scene.simulation.report().unconverged {
                run.note = "Newton did not converge".into();
            }
            let compare = if self.fixed { frame == frames } else { frame % self.every == 0 };
            if compare {
                let handles: Vec<BodyHandle> = scene.bodies.iter().map(|b| b.handle).collect();
                let states = handles.into_iter().flat_map(|b| scene.simulation.displacements(b));
                run.states.push(states.collect());
            }
            if let Some(limit) = limit {
                let hopeless = total > PATIENCE_SECONDS && total > limit * frame as f64;
                if frame < frames && !self.fixed && (hopeless || total > CANDIDATE_SECONDS) {
                    run.note = format!("stopped after {frame} of {frames} frames, too slow");
                    return Ok(run);
                }
            }
        }
        run.finished = true;
        Ok(run)
    }

    fn row(&self, choice: &Choice, truth: &[Vec<DVec3>]) -> Result<AdviceRow> {
        let run = self.run(choice, Some(HOPELESS * self.request.budget_s))?;
        let mut loaded = self.loaded.clone();
        choice.apply(&mut loaded);
        let scene = &loaded.scene;
        let total: f64 = run.frames.iter().sum();
        let mut sorted = run.frames.clone();
        sorted.sort_by(f64::total_cmp);
        let (mean, p95) = match (sorted.is_empty(), self.fixed) {
            (true, _) => (f64::INFINITY, f64::INFINITY),
            (false, true) => (total, total),
            (false, false) => (total / sorted.len() as f64, quantile(&sorted, 0.95)),
        };
        let vertices = truth.first().map_or(0, Vec::len);
        let error =
            if run.finished { displacement_error(&run.states, truth, vertices) } else { None };
        let integrator = if self.fixed { Integrator::QuasiStatic } else { scene.solver.integrator };
        let explicit = integrator.is_explicit();
        let names = |name: &dyn Fn(usize) -> &'static str| {
            let mut all: Vec<&str> = (0..scene.bodies.len()).map(name).collect();
            all.dedup();
            all.join("+")
        };
        Ok(AdviceRow {
            integrator: integrator.name().into(),
            step: match (self.fixed, scene.dt) {
                (false, Some(dt)) => format!("{} ms", three_digits(1e3 * dt)),
                _ => format!("{} load steps", scene.load_steps.unwrap_or(1)),
            },
            linear_tolerance: (!explicit).then_some(scene.solver.linear_tolerance),
            newton_tolerance: integrator.converges().then_some(scene.solver.newton_tolerance),
            precision: Precision::from(scene.precision).name().into(),
            evaluation: names(&|i| evaluation_name(scene.bodies[i].evaluation)),
            model: names(&|i| model_name(scene.bodies[i].model)),
            threads: scene.threads,
            frame_ms: 1e3 * mean,
            frame_p95_ms: 1e3 * p95,
            cost: (!self.fixed).then(|| mean / self.dt),
            error_percent: error.map(|e| 100.0 * e),
            pareto: false,
            note: run.note,
            options: choice.options(),
            choice: choice.clone(),
        })
    }

    /// A converged run, how it was made, and an estimate of its own error (a share): the distance from
    /// the run with twice the step.
    fn truth(&self, tell: &mut impl FnMut(&str)) -> Result<Converged> {
        let base = Choice {
            threads: Some(0),
            precision: Some(Precision::F64),
            evaluation: Some(Evaluation::Fused),
            ..Choice::default()
        };
        let states = |choice: &Choice| -> Result<Vec<Vec<DVec3>>> {
            let run = self.run(choice, None)?;
            if run.finished && run.note.is_empty() {
                Ok(run.states)
            } else {
                Err(AdviseError::NoTruth {
                    scene: self.loaded.scene.name.clone(),
                    reason: run.note,
                })
            }
        };
        let distance = |a: &[Vec<DVec3>], b: &[Vec<DVec3>]| {
            displacement_error(a, b, b.first().map_or(0, Vec::len)).unwrap_or(f64::INFINITY)
        };
        if self.fixed {
            let tight = |parts, tolerance| Choice {
                load_steps: Some(parts),
                linear_tolerance: Some(tolerance),
                newton_tolerance: Some(1e-10),
                ..base.clone()
            };
            let parts = self.loaded.scene.load_steps.unwrap_or(1).max(2);
            let (first, second) = (states(&tight(parts, 1e-4))?, states(&tight(2 * parts, 1e-6))?);
            let own = distance(&first, &second);
            return Ok((second, format!("Newton to 1e-10, {} load steps", 2 * parts), own));
        }
        let enough = 0.1 * self.request.error;
        // the finest run of each scheme; a lucky agreement of coarser ones does not count
        let mut explicit: Option<Converged> = None;
        let mut implicit: Option<Converged> = None;
        let mut report = |how: &str, own: f64| {
            tell(&format!("converged run: {how}, own error {} %", three_digits(100.0 * own)));
        };
        let mut done = false;
        if self.loaded.scene.solver.stiffness_damping == 0.0 {
            // explicit runs damp nothing and cost less where they work
            let mut before: Option<Vec<Vec<DVec3>>> = None;
            for part in [2.0, 4.0, 8.0, 16.0] {
                let choice = Choice {
                    integrator: Some(Integrator::StormerVerlet),
                    dt: Some(self.dt / part),
                    ..base.clone()
                };
                let Ok(now) = states(&choice) else { break };
                if let Some(before) = before {
                    let own = distance(&before, &now);
                    let how = format!("Störmer-Verlet, dt/{part}");
                    report(&how, own);
                    let diverges = explicit.as_ref().is_some_and(|(_, _, last)| own > *last);
                    explicit = Some((now.clone(), how, own));
                    done = own < enough;
                    if done || diverges {
                        break;
                    }
                }
                before = Some(now);
            }
        }
        let mut before: Option<Vec<Vec<DVec3>>> = None;
        let mut coarse: Option<Vec<Vec<DVec3>>> = None;
        for part in [4.0, 8.0, 16.0, 32.0] {
            if done {
                break;
            }
            let fine = states(&Choice {
                integrator: Some(Integrator::Newton),
                dt: Some(self.dt / part),
                linear_tolerance: Some(1e-4),
                newton_tolerance: Some(1e-8),
                ..base.clone()
            })?;
            if let Some(coarse) = &coarse {
                // first order: twice the fine run less the coarse one
                let extrapolated: Vec<Vec<DVec3>> = fine
                    .iter()
                    .zip(coarse)
                    .map(|(f, c)| f.iter().zip(c).map(|(f, c)| 2.0 * *f - *c).collect())
                    .collect();
                if let Some(before) = &before {
                    let own = distance(before, &extrapolated);
                    let how = format!("Newton, dt/{part}, extrapolated");
                    report(&how, own);
                    implicit = Some((extrapolated.clone(), how, own));
                    done = own < enough;
                }
                before = Some(extrapolated);
            }
            coarse = Some(fine);
        }
        let best = explicit.into_iter().chain(implicit).min_by(|a, b| a.2.total_cmp(&b.2));
        match best {
            Some(truth) if truth.2 < 0.5 * self.request.error => Ok(truth),
            found => Err(AdviseError::NoTruth {
                scene: self.loaded.scene.name.clone(),
                reason: format!(
                    "ever smaller steps still differ by {:.2} %, more than half the error asked for; the \
                     motion is too violent to be predicted that well: ask for a larger error, or \
                     shorten or damp the scene",
                    100.0 * found.map_or(f64::INFINITY, |t| t.2)
                ),
            }),
        }
    }
}

impl Advice {
    /// All runs, fastest first; the recommended one is marked.
    pub fn table(&self) -> Table {
        let frame = if self.horizon_s > 0.0 { "frame ms" } else { "total ms" };
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        order.sort_by(|&a, &b| self.rows[a].frame_ms.total_cmp(&self.rows[b].frame_ms));
        let title = format!("Settings tried on {}", self.scene);
        let rows = order.iter().map(|&i| &self.rows[i]);
        let mut table = table_of!("advice", title; for r in rows;
            "integrator" => &r.integrator, "step" => &r.step, "tol" => r.linear_tolerance,
            "newton tol" => r.newton_tolerance, "precision" => &r.precision,
            "evaluation" => &r.evaluation, "model" => &r.model, "threads" => r.threads,
            frame => r.frame_ms, "p95 ms" => r.frame_p95_ms, "s per s" => r.cost,
            "error %" => r.error_percent, "front" => r.pareto, "note" => &r.note,
        );
        table.marked.extend(order.iter().position(|&i| i == self.best));
        table
    }

    /// For people: the front, the recommendation, the command.
    pub fn text(&self, all: bool) -> String {
        let mut table = self.table();
        if !all {
            let marked = table.marked.clone();
            let front = table.columns.iter().position(|c| *c == "front").unwrap_or(0);
            let kept: Vec<usize> = (0..table.rows.len())
                .filter(|i| marked.contains(i) || table.rows[*i][front].shown() == "yes")
                .collect();
            table.marked = (0..kept.len()).filter(|i| marked.contains(&kept[*i])).collect();
            table.rows = kept.iter().map(|&i| table.rows[i].clone()).collect();
            table.title = format!("Pareto front of {} settings on {}", self.rows.len(), self.scene);
        }
        let best = &self.rows[self.best];
        let frame = if self.horizon_s > 0.0 { "per frame" } else { "to the equilibrium" };
        let mut text = format!("{}\n\n", self.machine.line());
        if let Some(cuts) = &self.cuts {
            text += &format!(
                "{}\nErrors of meshes are against {} elements ({}), both with converged steps of the scene.\n\n",
                cuts.table(&self.scene, if self.horizon_s > 0.0 { "frame ms" } else { "total ms" })
                    .text(),
                cuts.finest_elements,
                cuts.finest,
            );
        }
        text += &format!("{}\n", table.text());
        text += &format!(
            "Errors are against {}, whose own error is about {} %",
            self.truth,
            three_digits(self.truth_error_percent)
        );
        text += &match (self.horizon_s > 0.0, self.shortened) {
            (false, _) => ".\n".to_string(),
            (true, false) => format!(", over {} s.\n", three_digits(self.horizon_s)),
            (true, true) => {
                format!(", over the first {} s of the scene.\n", three_digits(self.horizon_s))
            }
        };
        text += &format!(
            "Asked: {} ms {frame}, {} %. {}: {} ms {frame} ({} ms measured again), {} %.\n",
            three_digits(1e3 * self.request.budget_s),
            three_digits(100.0 * self.request.error),
            if self.met { "Recommended (*)" } else { "CANNOT be met; best trade-off (*)" },
            three_digits(best.frame_ms),
            three_digits(self.again_ms),
            best.error_percent.map_or("unknown".into(), three_digits),
        );
        text += &match &self.cuts {
            None => "The error of the mesh is not in these figures: --mesh-error 5% searches other elements too.\n".into(),
            Some(cuts) => {
                let chosen = &cuts.rows[cuts.best];
                let words = match &chosen.keys[..] {
                    "" => "the scene as it is".to_string(),
                    keys => format!("in the scene file, for its bodies: {keys}"),
                };
                format!(
                    "Mesh (*): {words}; error {} %{}.\n",
                    chosen.error_percent.map_or("unknown".into(), three_digits),
                    if cuts.met { "" } else { ", which is MORE than asked for; no other was nearer" },
                )
            }
        };
        text += &format!("\n  sinew run {} {}\n", self.scene, best.options);
        if let Some(warning) = self.load.warning(self.machine.cores) {
            text += &format!("\nWARNING: {warning}\n");
        }
        text
    }
}
