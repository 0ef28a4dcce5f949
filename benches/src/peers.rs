//! Rivals in the same run: the same beam, mesh, lumped masses and load in Sinew and in other engines,
//! each row of speed with its static error.
//!
//! * **Error**: root mean square of the displacement error of the settled beam over that of the truth,
//!   the equilibrium of the St Venant-Kirchhoff body *on the same mesh* by converged Newton. The tip's
//!   own error stands in the note.
//! * **Settling**: from the rest shape, with mass-proportional damping ([`DAMPING`]), at the row's own
//!   step, for [`SETTLE_SECONDS`]. Where that takes too many steps ([`MAX_SETTLE_STEPS`]) the run starts
//!   from the truth instead and the note says so: it then shows drift, not convergence.
//! * **Errors of the motion**: from the shape at rest, undamped, for 0.3 s: against converged steps of implicit Euler of the
//!   same length, and against a fine motion (converged TR-BDF2 in steps of 5 ms), both on the same mesh and with the
//!   row's energy; largest distance of a vertex over the largest displacement. A settled state hides what steps leave
//!   unconverged.
//! * **Speed**: undamped steps of the beam let go from half of its equilibrium displacement; median
//!   over rounds in which the engines take turns.
//!
//! A ball pressed into a block, and a block pressed on another, compare contact ([`TouchRow`]), and a beam that is cut
//! compares cuts ([`CutRow`]).

pub mod beam;
pub mod bodies;
mod charts;
pub mod cut;
pub mod equilibrium;
pub mod mujoco;
#[cfg(feature = "rapier")]
pub mod rapier;
pub mod rival;
pub mod sinew_rows;
pub mod touch;

use crate::toolbox::aim::BenchAim;
use crate::toolbox::options::BenchOptions;
use crate::toolbox::prelude::*;
use sinew_tune::table::three_digits;

pub use beam::{Beam, at_zero};
pub use cut::CutRow;
use mujoco::Freedom;
use rival::compete;
pub use rival::{BeamCase, DAMPING, LARGE, MAX_SETTLE_STEPS, PeerRow, Rival, SETTLE_SECONDS, say};
pub use touch::TouchRow;

/// All rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PeerReport {
    /// One row per engine, scene and setting.
    pub rows: Vec<PeerRow>,
    /// Rivals that did not run, why, and what to do about it.
    pub skipped: Vec<String>,
    /// Contact: equilibria, then one row per engine and setting.
    pub touch: Vec<TouchRow>,
    /// The same with two blocks, where they are asked for.
    pub bodies: Vec<TouchRow>,
    /// A beam that is cut, where it is asked for.
    pub cut: Vec<CutRow>,
}

/// Runs every rival that is there. What is missing is listed with the remedy; nothing is guessed.
///
/// # Errors
/// When a mesh cannot be made or Sinew's own truth does not converge.
pub fn run(options: &BenchOptions) -> Result<PeerReport> {
    let mut report = PeerReport::default();
    let named = |name: &str| options.cases.iter().any(|n| n == name);
    let [beam, touch, bodies, cuts] = ["beam", "touch", "bodies", "cut"].map(named);
    // two blocks and a cut take longer than all the rest: they are asked for by name
    let (beam, touch) = (beam || !(touch || bodies || cuts), touch || !(beam || bodies || cuts));
    if cuts {
        report.cut = cut::run(options.quick)?;
        report.skipped.push("MuJoCo flex, cut: it cannot be cut".into());
    }
    let mut mujoco = match (beam || touch || bodies).then(|| mujoco::MuJoCo::start(&options.python))
    {
        Some(Err(why)) => {
            report.skipped.push(why);
            None
        }
        found => found.and_then(std::result::Result::ok),
    };
    if beam {
        run_beams(options, mujoco.as_mut(), &mut report)?;
    }
    if touch {
        // edges of 8, and of 5 to 6 mm: 1 920 and 5 760 tetrahedra, both fine enough for vertices as points
        let cells = if options.quick { [10, 8, 4] } else { [16, 12, 5] };
        let block = touch::TouchBlock::new(cells)?;
        let (mujoco, skipped) = (mujoco.as_mut(), &mut report.skipped);
        report.touch = run_touch(&block, touch::ours, options, mujoco, skipped)?;
    }
    if bodies {
        let block = touch::TouchBlock::pair(bodies::cells(options.quick))?;
        let (mujoco, skipped) = (mujoco.as_mut(), &mut report.skipped);
        report.bodies = run_touch(&block, touch::ours_with_blocks, options, mujoco, skipped)?;
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
    Ok(report)
}

/// Whether a beam of so many cells is nearly as large as one of the sizes asked for, if any were.
fn wanted(options: &BenchOptions, cells: &[usize; 3]) -> bool {
    let tetrahedra = 6 * cells.iter().product::<usize>();
    let near = |&size: &usize| tetrahedra.abs_diff(size) * 10 <= size;
    options.sizes.is_empty() || options.sizes.iter().any(near)
}

/// The beams of the MuJoCo rows.
fn run_beams(
    options: &BenchOptions,
    mut mujoco: Option<&mut mujoco::MuJoCo>,
    report: &mut PeerReport,
) -> Result<()> {
    let mujoco_cells: &[[usize; 3]] =
        if options.quick { &[[16, 4, 4]] } else { &[[16, 4, 4], [24, 6, 6], [52, 13, 13]] };
    for &cells in mujoco_cells.iter().filter(|cells| wanted(options, cells)) {
        let poisson: &[f64] = if options.quick || cells[0] > 24 { &[0.3] } else { &[0.3, 0.45] };
        for &poisson_ratio in poisson {
            let case = BeamCase::new(Beam::mujoco(cells, poisson_ratio)?)?;
            let mut rivals = sinew_rows::rivals(&[1e-3, 1e-2, 1.0 / 30.0], true);
            if let Some(mujoco) = mujoco.as_deref_mut() {
                match mujoco.rivals(&case, &[1e-3, 1e-2, 1.0 / 30.0], Freedom::Full) {
                    Ok(more) => rivals.extend(more),
                    Err(error) => {
                        report.skipped.push(format!("MuJoCo flex on {}: {error}", case.beam.name));
                    }
                }
            }
            report.rows.extend(compete(&case, &mut rivals, options.quick));
        }
    }
    Ok(())
}

/// A ball or another block on a block, our settings and the other engines in turns.
fn run_touch(
    block: &touch::TouchBlock,
    ours: fn(bool) -> Vec<Box<dyn touch::Finger>>,
    options: &BenchOptions,
    mujoco: Option<&mut mujoco::MuJoCo>,
    skipped: &mut Vec<String>,
) -> Result<Vec<TouchRow>> {
    let mut fingers = ours(options.quick);
    if let Some(mujoco) = mujoco {
        match mujoco.fingers(block) {
            Ok(more) => fingers.extend(more),
            Err(error) => skipped.push(format!("MuJoCo flex, contact: {error}")),
        }
    }
    #[cfg(feature = "rapier")]
    fingers.extend(rapier::fingers(block, options.quick)?);
    touch::compete(block, &mut fingers)
}

/// Engines looked at and left out.
const NOT_COMPARED: [&str; 2] = [
    "SOFA: no wheel of its Python bindings on PyPI (the package `sofa` there is another project); \
     install a release from sofa-framework.org and compare by hand",
    "PositionBasedDynamics: constraints with stiffness in iterations, no converged equilibrium for a \
     given Young's modulus to measure an error against",
];

#[cfg(feature = "rapier")]
fn run_rapier(options: &BenchOptions, report: &mut PeerReport) -> Result<()> {
    let cells: &[[usize; 3]] =
        if options.quick { &[[8, 2, 2]] } else { &[[8, 2, 2], [16, 4, 4], [24, 6, 6]] };
    for &cells in cells.iter().filter(|cells| wanted(options, cells)) {
        for poisson_ratio in [0.3, 0.45] {
            // a tenth of the weight: strains below 1 %, where the corotational energy and StVK meet
            for gravity in [9.81, 0.981] {
                let case = BeamCase::new(Beam::rapier(cells, poisson_ratio, gravity)?)?;
                let steps = [1.0 / 60.0, 1.0 / 60.0 / RAPIER_PARTS];
                let mut rivals = sinew_rows::rivals(&steps, gravity > 1.0);
                rivals.extend(rapier::rivals(&case, rapier::STEP));
                report.rows.extend(compete(&case, &mut rivals, options.quick));
            }
        }
    }
    Ok(())
}

/// Parts into which Rapier cuts a step by default.
const RAPIER_PARTS: f64 = 4.0;

/// Errors that differ by less than this share of themselves are the same: the fine motion is not known better.
const SAME_ERROR: f64 = 0.01;

/// Step (s) of a row that has steps.
fn step(row: &PeerRow) -> Option<f64> {
    Some(1e-3 * row.ms_per_step? / row.cost_per_simulated_second?)
}

/// Whether one of our rows has steps as long as those of a rival, each of which is cut into `parts`, and numbers of the same
/// precision: what else is told of their speed would compare two things.
fn alike(ours: &PeerRow, rival: &PeerRow, parts: f64) -> bool {
    let same = |(a, b): (f64, f64)| (a * parts / b - 1.0).abs() < 1e-3;
    ours.precision == rival.precision && step(ours).zip(step(rival)).is_some_and(same)
}

/// The aim against a row of a rival that cuts its steps into `parts`, by rows of ours with such steps and the same precision
/// whose motion is no farther from the fine one.
fn faster_steps(ours: &[&PeerRow], rival: &PeerRow, parts: f64, factor: f64) -> Option<BenchAim> {
    let (theirs, error) = (rival.ms_per_step?, rival.swing_percent?);
    let setting = rival.setting.split(", ").find(|part| part.starts_with("at most"));
    let aim = format!(
        "steps of {} ms at least {factor} times as fast as {} ({}), {}, motion no less exact: {}",
        three_digits(1e3 * step(rival)? / parts),
        rival.engine,
        setting.unwrap_or(&rival.setting),
        rival.precision,
        rival.scene
    );
    let comparable: Vec<&&PeerRow> = ours.iter().filter(|r| alike(r, rival, parts)).collect();
    if comparable.is_empty() {
        let aim = BenchAim::at_least(aim, factor, "times", 0.0);
        let why = "none of our rows has this step and precision";
        return Some(BenchAim { not_judged: Some(why.into()), ..aim });
    }
    let limit = error * (1.0 + SAME_ERROR);
    let as_good = comparable.iter().filter(|r| r.swing_percent.is_some_and(|e| e <= limit));
    let best = as_good.filter_map(|r| r.ms_per_step).min_by(f64::total_cmp);
    Some(match best {
        Some(ours) => at_least(&aim, ours, theirs / parts, factor),
        None => BenchAim::at_least(format!("{aim} (no setting as exact)"), factor, "times", 0.0),
    })
}

/// An aim of a time of ours below one of theirs.
fn at_least(aim: &str, ours: f64, theirs: f64, factor: f64) -> BenchAim {
    let what = format!("{aim} ({} against {})", three_digits(ours), three_digits(theirs));
    BenchAim::at_least(what, factor, "times", theirs / ours)
}

/// Judges the goals that the rows cover.
pub fn aims(rows: &[PeerRow]) -> Vec<BenchAim> {
    let mut aims = Vec::new();
    let mut scenes: Vec<&str> = rows.iter().map(|r| r.scene.as_str()).collect();
    scenes.dedup();
    for scene in scenes {
        let of = |engine: &'static str| {
            rows.iter().filter(move |r| r.scene == scene && r.engine == engine)
        };
        for precision in ["f64", "f32"] {
            let force = |engine| {
                let own = of(engine).filter(|r| r.precision == precision);
                own.filter_map(|r| r.force_ns_per_element).min_by(f64::total_cmp)
            };
            if let (Some(ours), Some(theirs)) = (force("Sinew"), force("MuJoCo")) {
                let aim = format!(
                    "elastic forces at least 6 times as fast as MuJoCo's, {precision}: {scene}"
                );
                aims.push(at_least(&aim, ours, theirs, 6.0));
            }
        }
        let ours: Vec<&PeerRow> = of("Sinew").collect();
        for (engine, factor, setting, parts) in
            [("MuJoCo", None, "h = 10 ms", 1.0), ("Rapier", Some(5.0), "300", RAPIER_PARTS)]
        {
            for rival in of(engine).filter(|r| r.setting.contains(setting)) {
                let capped = rival.setting.contains("its default");
                let factor = factor.or(match rival.elements {
                    4000.. if capped => Some(10.0),
                    LARGE.. => Some(40.0),
                    4000.. => Some(20.0),
                    _ => None,
                });
                aims.extend(factor.and_then(|factor| faster_steps(&ours, rival, parts, factor)));
            }
        }
    }
    let worst = rows
        .iter()
        .filter(|r| r.engine == "Sinew" && r.setting.contains("default"))
        .filter_map(|r| r.error_percent)
        .max_by(f64::total_cmp);
    if let Some(worst) = worst {
        let what = "worst static error of our default settings";
        aims.push(BenchAim::at_most(what, 1.0, "%", worst));
    }
    aims
}
