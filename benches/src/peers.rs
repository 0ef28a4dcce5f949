//! Rivals in the same run: the same beam, mesh, lumped masses and load in Sinew and in other engines,
//! each row of speed with its static error.
//!
//! * **Error**: root mean square of the displacement error of the settled beam over that of the truth,
//!   the equilibrium of the St Venant-Kirchhoff body *on the same mesh* by converged Newton. The tip's
//!   own error stands in the note.
//! * **Settling**: from the rest shape, with mass-proportional damping ([`DAMPING`]), at the row's own
//!   step, for [`SETTLE_SECONDS`]. Where that takes too many steps ([`MAX_SETTLE_STEPS`]) the run starts
//!   from the truth instead and the note says so: it then shows drift, not convergence.
//! * **Speed**: undamped steps of the beam let go from half of its equilibrium displacement; median
//!   over rounds in which the engines take turns.
//!
//! A ball pressed into a block compares contact ([`TouchRow`]).

mod beam;
mod charts;
pub(crate) mod mujoco;
#[cfg(feature = "rapier")]
pub(crate) mod rapier;
pub(crate) mod sinew_rows;
mod touch;

use crate::bench::error::BenchError;
use crate::bench::table::three_digits;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::models::body::VolumeRule;
use sinew::prelude::*;

pub use beam::Beam;
pub(crate) use beam::at_zero;
use mujoco::Freedom;
pub use touch::TouchRow;

/// Mass-proportional damping (1/s) while a beam settles.
pub const DAMPING: f64 = 20.0;
/// Simulated time (s) in which a beam settles: rests of its first modes fade by more than 1e-8.
pub const SETTLE_SECONDS: f64 = 2.0;
/// Most steps spent on settling a body of [`LARGE`] elements or more.
pub const MAX_SETTLE_STEPS: usize = 60;
/// Elements from which on a body counts as large.
pub const LARGE: usize = 20_000;

/// What to run.
#[derive(Clone, Debug)]
pub struct PeerOptions {
    /// Smallest meshes and few repeats, below a minute.
    pub quick: bool,
    /// Threads of Sinew (0: one per core). The rivals run on one thread.
    pub threads: usize,
    /// Python with the package `mujoco`.
    pub python: String,
    /// Only these of `beam` and `touch`; both when it names neither.
    pub only: Vec<String>,
}

impl Default for PeerOptions {
    fn default() -> Self {
        Self { quick: false, threads: 1, python: "python3".into(), only: Vec::new() }
    }
}

/// One engine in one setting on one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PeerRow {
    /// Engine.
    pub engine: String,
    /// Its version.
    pub version: String,
    /// Scene: size of the beam, load, energy.
    pub scene: String,
    /// Vertices.
    pub nodes: usize,
    /// Tetrahedra.
    pub elements: usize,
    /// Young's modulus (Pa).
    pub young_modulus: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Step, solver, iterations in words.
    pub setting: String,
    /// Threads.
    pub threads: usize,
    /// `"f64"` or `"f32"`.
    pub precision: String,
    /// Median time (ms) of a step.
    pub ms_per_step: Option<f64>,
    /// Seconds of computation per simulated second.
    pub cost_per_simulated_second: Option<f64>,
    /// Time (ns) of the elastic forces per tetrahedron.
    pub force_ns_per_element: Option<f64>,
    /// Static error (%): root mean square of the displacement error over that of the truth.
    pub error_percent: Option<f64>,
    /// What else there is to know, in words.
    pub note: String,
}

/// A goal and whether it was met.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeerAim {
    /// The goal in words.
    pub aim: String,
    /// What was measured.
    pub measured: String,
    /// Reached.
    pub met: bool,
}

/// All rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PeerReport {
    /// One row per engine, scene and setting.
    pub rows: Vec<PeerRow>,
    /// Rivals that did not run, why, and what to do about it.
    pub skipped: Vec<String>,
    /// Goals that the rows allow to judge.
    pub aims: Vec<PeerAim>,
    /// Contact: equilibria, then one row per engine and setting.
    #[serde(default)]
    pub touch: Vec<TouchRow>,
}

/// A beam with its truth.
pub(crate) struct Case {
    /// The beam.
    pub(crate) beam: Beam,
    /// Equilibrium displacements (m).
    pub(crate) truth: Vec<DVec3>,
}

impl Case {
    fn new(beam: Beam) -> Result<Self, BenchError> {
        let truth = sinew_rows::equilibrium(&beam, Model::StVK, VolumeRule::Elements)?;
        Ok(Self { beam, truth })
    }

    /// Where timed runs begin: half of the equilibrium displacement.
    fn start(&self) -> Vec<DVec3> {
        self.truth.iter().map(|u| *u * 0.5).collect()
    }

    /// Steps of settling at `h`, and whether they start from the truth.
    fn settling(&self, h: f64) -> (usize, bool) {
        let steps = (SETTLE_SECONDS / h).ceil() as usize;
        let warm = self.beam.mesh.tetrahedra.len() >= LARGE && steps > MAX_SETTLE_STEPS;
        (if warm { MAX_SETTLE_STEPS / 2 } else { steps }, warm)
    }

    /// A row without figures.
    fn row(&self, engine: &str, version: &str, setting: String) -> PeerRow {
        let b = &self.beam;
        PeerRow {
            engine: engine.into(),
            version: version.into(),
            scene: b.name.clone(),
            nodes: b.mesh.points.len(),
            elements: b.mesh.tetrahedra.len(),
            young_modulus: b.material.young_modulus,
            poisson_ratio: b.material.poisson_ratio,
            setting,
            threads: 1,
            precision: "f64".into(),
            ms_per_step: None,
            cost_per_simulated_second: None,
            force_ns_per_element: None,
            error_percent: None,
            note: String::new(),
        }
    }
}

/// Static error (%) of displacements against the truth: (field, tip).
fn static_error(beam: &Beam, u: &[DVec3], truth: &[DVec3]) -> (f64, f64) {
    let sum =
        |values: &mut dyn Iterator<Item = DVec3>| values.map(|x| x.length_squared()).sum::<f64>();
    let difference = sum(&mut u.iter().zip(truth).map(|(a, b)| *a - *b));
    let field = (difference / sum(&mut truth.iter().copied())).sqrt();
    let tip = beam.tip(u) / beam.tip(truth) - 1.0;
    (100.0 * field, 100.0 * tip)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
    }
}

/// A time in words.
fn milliseconds(seconds: f64) -> String {
    format!("{} ms", (seconds * 1e5).round() / 100.0)
}

/// Adds a sentence to a note.
pub(crate) fn say(note: &mut String, text: impl AsRef<str>) {
    if !note.is_empty() {
        note.push_str("; ");
    }
    note.push_str(text.as_ref());
}

/// One engine in one setting: timed in turns with the others, then settled.
pub(crate) trait Rival {
    /// Times undamped steps (ms each) from the case's start.
    fn time(&mut self, case: &Case, steps: usize) -> Result<Vec<f64>, BenchError>;
    /// Displacements (m) after every `every` of undamped steps from the shape at rest.
    fn swing(
        &mut self,
        case: &Case,
        steps: usize,
        every: usize,
    ) -> Result<Vec<Vec<DVec3>>, BenchError>;
    /// Linear iterations per timed step, where the engine tells them.
    fn linear_iterations(&self) -> Option<f64> {
        None
    }
    /// Seconds of one evaluation of the elastic forces, where it can be told.
    fn force(&mut self, case: &Case) -> Result<Option<f64>, BenchError>;
    /// Settles and returns the displacements (m).
    fn settle(&mut self, case: &Case) -> Result<Vec<DVec3>, BenchError>;
    /// What its settled state should be, where that is not the case's truth.
    fn truth(&self, _: &Case) -> Result<Option<Vec<DVec3>>, BenchError> {
        Ok(None)
    }
    /// Row without figures.
    fn row(&self, case: &Case) -> PeerRow;
    /// Step (s); none for an equilibrium in one go.
    fn step(&self) -> Option<f64>;
    /// What the runs said.
    fn remark(&self) -> String {
        String::new()
    }
}

/// Runs the rivals in turns and fills their rows; a rival that fails keeps its row with the reason.
fn compete(case: &Case, rivals: &mut [Box<dyn Rival + '_>], quick: bool, report: &mut PeerReport) {
    let (rounds, steps) = match (quick, case.beam.mesh.tetrahedra.len() >= LARGE) {
        (true, _) => (3, 5),
        (false, false) => (5, 10),
        (false, true) => (3, 3),
    };
    let mut rows: Vec<PeerRow> = rivals.iter().map(|r| r.row(case)).collect();
    let mut times = vec![Vec::new(); rivals.len()];
    let mut forces = vec![Vec::new(); rivals.len()];
    let mut failed = vec![false; rivals.len()];
    let n = case.beam.mesh.tetrahedra.len() as f64;
    for _ in 0..rounds {
        for (i, rival) in rivals.iter_mut().enumerate() {
            if failed[i] {
                continue;
            }
            // an equilibrium starts from rest whatever came before: one is enough per round
            let steps = if rival.step().is_some() { steps } else { 1 };
            match rival.time(case, steps).and_then(|t| Ok((t, rival.force(case)?))) {
                Ok((time, force)) => {
                    times[i].extend(time);
                    forces[i].extend(force.map(|seconds| seconds * 1e9 / n));
                }
                Err(error) => {
                    failed[i] = true;
                    say(&mut rows[i].note, format!("failed: {error}"));
                }
            }
        }
    }
    for (i, rival) in rivals.iter_mut().enumerate() {
        let row = &mut rows[i];
        // a speed without an error is half a result: none is given for a run that failed
        if failed[i] {
            continue;
        }
        match rival.settle(case).and_then(|u| Ok((u, rival.truth(case)?))) {
            Ok((u, truth)) => {
                let truth = truth.as_deref().unwrap_or(&case.truth);
                let (field, tip) = static_error(&case.beam, &u, truth);
                row.ms_per_step = median(std::mem::take(&mut times[i]));
                row.cost_per_simulated_second =
                    rival.step().zip(row.ms_per_step).map(|(h, ms)| ms * 1e-3 / h);
                row.force_ns_per_element = median(std::mem::take(&mut forces[i]));
                row.error_percent = Some(field);
                say(&mut row.note, format!("tip {tip:+.3e} %"));
                if rival.step().is_some_and(|h| case.settling(h).1) {
                    say(&mut row.note, "settled from the truth: drift only");
                }
            }
            Err(error) => say(&mut row.note, format!("failed to settle: {error}")),
        }
        let remark = rival.remark();
        if !remark.is_empty() {
            say(&mut row.note, remark);
        }
    }
    report.rows.extend(rows);
}

/// Runs every rival that is there. What is missing is listed with the remedy; nothing is guessed.
///
/// # Errors
/// When a mesh cannot be made or Sinew's own truth does not converge.
pub fn run(options: &PeerOptions) -> Result<PeerReport, BenchError> {
    let mut report = PeerReport::default();
    let named = |name: &str| options.only.iter().any(|n| n == name);
    let [beam, touch] = ["beam", "touch"].map(named);
    let (beam, touch) = (beam || !touch, touch || !beam);
    let mut mujoco = match mujoco::MuJoCo::start(&options.python) {
        Ok(found) => Some(found),
        Err(why) => {
            report.skipped.push(why);
            None
        }
    };
    if beam {
        run_beams(options, mujoco.as_mut(), &mut report)?;
    }
    if touch {
        run_touch(options, mujoco.as_mut(), &mut report)?;
    }
    drop(mujoco);
    #[cfg(feature = "rapier")]
    if beam {
        run_rapier(options, &mut report)?;
    }
    #[cfg(not(feature = "rapier"))]
    report.skipped.push(
        "Rapier soft bodies: not built in; run with `cargo run --release -p sinew-benches --features \
         rapier -- bench peers`"
            .into(),
    );
    report.skipped.extend(NOT_COMPARED.iter().map(|s| s.to_string()));
    report.aims = aims(&report.rows);
    Ok(report)
}

/// The beams of the MuJoCo rows.
fn run_beams(
    options: &PeerOptions,
    mut mujoco: Option<&mut mujoco::MuJoCo>,
    report: &mut PeerReport,
) -> Result<(), BenchError> {
    let mujoco_cells: &[[usize; 3]] =
        if options.quick { &[[16, 4, 4]] } else { &[[16, 4, 4], [24, 6, 6], [52, 13, 13]] };
    for &cells in mujoco_cells {
        let poisson: &[f64] = if options.quick || cells[0] > 24 { &[0.3] } else { &[0.3, 0.45] };
        for &poisson_ratio in poisson {
            let case = Case::new(Beam::mujoco(cells, poisson_ratio)?)?;
            let mut rivals = sinew_rows::rivals(options.threads, &[1e-3, 1e-2, 1.0 / 30.0], true);
            if let Some(mujoco) = mujoco.as_deref_mut() {
                match mujoco.rivals(&case, &[1e-3, 1e-2, 1.0 / 30.0], Freedom::Full) {
                    Ok(more) => rivals.extend(more),
                    Err(error) => {
                        report.skipped.push(format!("MuJoCo flex on {}: {error}", case.beam.name));
                    }
                }
            }
            compete(&case, &mut rivals, options.quick, report);
        }
    }
    Ok(())
}

/// A ball on a block, all engines in turns.
fn run_touch(
    options: &PeerOptions,
    mujoco: Option<&mut mujoco::MuJoCo>,
    report: &mut PeerReport,
) -> Result<(), BenchError> {
    // edges of 8, and of 5 to 6 mm: 1 920 and 5 760 tetrahedra, both fine enough for vertices as points
    let cells = if options.quick { [10, 8, 4] } else { [16, 12, 5] };
    let block = touch::Block::new(cells)?;
    let mut fingers = touch::ours(options.threads, options.quick);
    if let Some(mujoco) = mujoco {
        match mujoco.fingers(&block) {
            Ok(more) => fingers.extend(more),
            Err(error) => report.skipped.push(format!("MuJoCo flex under a ball: {error}")),
        }
    }
    #[cfg(feature = "rapier")]
    fingers.extend(rapier::fingers(&block, options.quick)?);
    touch::compete(&block, &mut fingers, report)
}

/// Engines looked at and left out.
const NOT_COMPARED: [&str; 2] = [
    "SOFA: no wheel of its Python bindings on PyPI (the package `sofa` there is another project); \
     install a release from sofa-framework.org and compare by hand",
    "PositionBasedDynamics: constraints with stiffness in iterations, no converged equilibrium for a \
     given Young's modulus to measure an error against",
];

#[cfg(feature = "rapier")]
fn run_rapier(options: &PeerOptions, report: &mut PeerReport) -> Result<(), BenchError> {
    let cells: &[[usize; 3]] =
        if options.quick { &[[8, 2, 2]] } else { &[[8, 2, 2], [16, 4, 4], [24, 6, 6]] };
    for &cells in cells {
        for poisson_ratio in [0.3, 0.45] {
            // a tenth of the weight: strains below 1 %, where the corotational energy and StVK meet
            for gravity in [9.81, 0.981] {
                let case = Case::new(Beam::rapier(cells, poisson_ratio, gravity)?)?;
                let mut rivals = sinew_rows::rivals(options.threads, &[1.0 / 60.0], gravity > 1.0);
                rivals.extend(rapier::rivals(&case, rapier::STEP));
                compete(&case, &mut rivals, options.quick, report);
            }
        }
    }
    Ok(())
}

/// Fastest row that `pick` accepts, with its figure.
fn best(rows: &[PeerRow], pick: impl Fn(&PeerRow) -> Option<f64>) -> Option<(&PeerRow, f64)> {
    rows.iter().filter_map(|row| pick(row).map(|x| (row, x))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Errors (%) below this are the same: neither engine asks its solver for more digits.
const SAME_ERROR: f64 = 1e-3;

/// Judges the goals that the rows cover.
fn aims(rows: &[PeerRow]) -> Vec<PeerAim> {
    let mut aims = Vec::new();
    let at_least = |aim: String, ours: f64, theirs: f64, factor: f64| PeerAim {
        aim,
        measured: format!(
            "{} times ({} against {})",
            three_digits(theirs / ours),
            three_digits(ours),
            three_digits(theirs)
        ),
        met: theirs / ours >= factor,
    };
    let mut scenes: Vec<&str> = rows.iter().map(|r| r.scene.as_str()).collect();
    scenes.dedup();
    for scene in scenes {
        let of = |engine: &'static str| {
            rows.iter().filter(move |r| r.scene == scene && r.engine == engine)
        };
        let force =
            |engine| of(engine).filter_map(|r| r.force_ns_per_element).min_by(f64::total_cmp);
        if let (Some(ours), Some(theirs)) = (force("Sinew"), force("MuJoCo")) {
            let aim = format!("elastic forces at least 6 times as fast as MuJoCo's: {scene}");
            aims.push(at_least(aim, ours, theirs, 6.0));
        }
        for (engine, factor, setting) in
            [("MuJoCo", None, "h = 10 ms"), ("Rapier", Some(5.0), "300")]
        {
            for rival in of(engine).filter(|r| r.setting.contains(setting)) {
                let (Some(theirs), Some(error)) =
                    (rival.cost_per_simulated_second, rival.error_percent)
                else {
                    continue;
                };
                let factor = factor.or(match rival.elements {
                    LARGE.. => Some(40.0),
                    4000.. => Some(10.0),
                    _ => None,
                });
                let Some(factor) = factor else { continue };
                let ours = best(rows, |r| {
                    let as_good = r.error_percent? <= error.max(SAME_ERROR);
                    (r.engine == "Sinew" && r.scene == scene && as_good)
                        .then_some(r.cost_per_simulated_second)?
                });
                let cap = rival.setting.split(", ").find(|part| part.starts_with("at most"));
                let aim = format!(
                    "at least {factor} times as fast as {engine} ({}) at no larger error: {scene}",
                    cap.unwrap_or(&rival.setting)
                );
                aims.push(match ours {
                    Some((_, ours)) => at_least(aim, ours, theirs, factor),
                    None => PeerAim { aim, measured: "no setting as exact".into(), met: false },
                });
            }
        }
    }
    let worst = rows
        .iter()
        .filter(|r| r.engine == "Sinew" && r.setting.contains("default"))
        .filter_map(|r| r.error_percent)
        .max_by(f64::total_cmp);
    if let Some(worst) = worst {
        aims.push(PeerAim {
            aim: "every default setting of ours below 1 % static error".into(),
            measured: format!("worst {worst:.2e} %"),
            met: worst < 1.0,
        });
    }
    aims
}

#[cfg(test)]
mod tests;
