//! Frame times while tetrahedra are removed: one per frame of 1/60 s, safe step, organs that hang
//! under their weight.

use crate::toolbox::prelude::*;
use sinew::engine::mesh::generate::sphere_tets;
use sinew::models::body::Evaluation;
use sinew::models::resection::{Region, Removal};
use sinew_tune::measures::quantile;

/// Distribution of times (ms).
#[derive(Clone, Debug)]
pub struct FrameTimes {
    /// Shortest.
    pub min: f64,
    /// Half are shorter.
    pub median: f64,
    /// 95 % are shorter.
    pub p95: f64,
    /// 99 % are shorter.
    pub p99: f64,
    /// Longest.
    pub max: f64,
    /// Share above a frame of 1/60 s.
    pub late: f64,
}

impl FrameTimes {
    /// That of some times, one at least.
    pub(super) fn of(mut ms: Vec<f64>) -> Self {
        ms.sort_by(f64::total_cmp);
        let [min, median, p95, p99, max] = [0.0, 0.5, 0.95, 0.99, 1.0].map(|q| quantile(&ms, q));
        let late = ms.iter().filter(|&&t| t > FRAME * 1e3).count() as f64 / ms.len() as f64;
        Self { min, median, p95, p99, max, late }
    }
}

/// One run.
#[derive(Clone, Debug)]
pub struct ResectionRun {
    /// Tetrahedra at the start.
    pub tetrahedra: usize,
    /// Time of preparing the body for removals (ms), before the first frame.
    pub prepare_ms: f64,
    /// Removal and step.
    pub frame: FrameTimes,
    /// Removal alone.
    pub removal: FrameTimes,
    /// Step alone.
    pub step: FrameTimes,
    /// Frames by their time: up to 1, 2, 4, ... ms.
    pub histogram: Vec<(f64, usize)>,
    /// Worst relative residual of a linear system.
    pub residual: f64,
    /// Conjugate-gradient iterations per frame.
    pub iterations: f64,
    /// Linear solves that fell back on a projected tangent.
    pub projections: u32,
    /// Compactions of the tables.
    pub compactions: usize,
    /// Pieces after the frames.
    pub pieces: usize,
    /// Vertices without elements after the frames.
    pub orphans: usize,
    /// Time (ms) of removing a third of what is left at once, afterwards, compaction included.
    pub batch_ms: f64,
    /// Largest difference from a fresh build at the end, masses included.
    pub difference: f64,
    /// Every frame.
    pub frames: Vec<ResectionFrame>,
}

/// One frame.
#[derive(Clone, Copy, Debug)]
pub struct ResectionFrame {
    /// Tetrahedra removed.
    pub removed: usize,
    /// Time of the removal (ms).
    pub removal_ms: f64,
    /// Time of the step (ms).
    pub step_ms: f64,
    /// Relative residual of the linear system.
    pub residual: f64,
}

/// What is cut.
#[derive(Clone, Debug)]
pub struct Organ<'a> {
    /// Its mesh.
    pub mesh: &'a Mesh,
    /// Vertices it hangs from.
    pub held: &'a [u32],
    /// Its material.
    pub material: YoungPoisson,
    /// How its energy is summed.
    pub evaluation: Evaluation,
}

/// Length of a frame and of its step (s).
pub const FRAME: f64 = 1.0 / 60.0;
/// Radius of the ball (m): about a litre.
const RADIUS: f64 = 0.065;

/// Frame times of balls of about these sizes (tetrahedra): so many frames each, at most one per tetrahedron.
///
/// # Errors
/// When a body cannot be made or a step fails.
pub fn run(
    sizes: &[usize],
    frames: usize,
    threads: usize,
    mut tell: impl FnMut(&str),
) -> Result<Vec<Table>> {
    let mut runs = Vec::new();
    for &size in sizes {
        tell(&format!("resection: about {size} tetrahedra"));
        let shells = (size as f64 / 20.0).cbrt().round().max(2.0) as usize;
        let mesh = sphere_tets(RADIUS, shells)?;
        let held: Vec<u32> =
            (0..).zip(&mesh.points).filter(|(_, p)| p.z > 0.7 * RADIUS).map(|(i, _)| i).collect();
        let (material, evaluation) = (preset("liver")?.material, Evaluation::Fused);
        let organ = Organ { mesh: &mesh, held: &held, material, evaluation };
        let count = mesh.tetrahedra.len();
        runs.push(cut(&organ, frames.min(count), threads, at_random(count))?);
    }
    Ok(tables(&runs, threads))
}

/// One of so many tetrahedra a frame, at random, none twice.
pub fn at_random(tetrahedra: usize) -> impl FnMut(usize) -> Region {
    let mut left: Vec<u32> = (0..tetrahedra as u32).collect();
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    move |_| {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        Region::Tetrahedra(vec![left.swap_remove((seed >> 11) as usize % left.len())])
    }
}

/// Lets the organ sag for half a second, then removes what `next` says for a frame and steps, frame by
/// frame; in the end a third of what is left.
///
/// # Panics
/// When there are no frames.
///
/// # Errors
/// When the body cannot be made, or a removal or a step fails.
pub fn cut(
    organ: &Organ<'_>,
    frames: usize,
    threads: usize,
    mut next: impl FnMut(usize) -> Region,
) -> Result<ResectionRun> {
    let Organ { mesh, held, material, evaluation } = *organ;
    let mut simulation =
        Simulation::new(SimulationOptions { threads, exclusive: true, ..Default::default() })?;
    let organ = BodyDescription { evaluation, ..BodyDescription::new("organ", mesh, material) };
    let body = simulation.add_body(&organ)?;
    let rows = simulation.rows(body, "ligament", held)?;
    simulation.add_constraint(Constraint::hold("ligament", rows));
    simulation.set_dt(FRAME);
    simulation.set_solver(SolverSettings {
        integrator: Integrator::Safe,
        mass_damping: 2.0,
        ..Default::default()
    });
    // sagged before the first cut
    for _ in 0..30 {
        simulation.step()?;
    }
    let clock = Instant::now();
    simulation.prepare_removals(body)?;
    let prepare_ms = clock.elapsed().as_secs_f64() * 1e3;

    let mut present = vec![true; mesh.tetrahedra.len()];
    let mut all: Vec<ResectionFrame> = Vec::new();
    let (mut iterations, mut projections) = (0, 0);
    let (mut compactions, mut pieces, mut orphans) = (0, 1, 0);
    for frame in 0..frames {
        let region = next(frame);
        let clock = Instant::now();
        let removed = simulation.remove_elements(body, &Removal::new(region))?;
        let removal_ms = clock.elapsed().as_secs_f64() * 1e3;
        simulation.step()?;
        let step_ms = clock.elapsed().as_secs_f64() * 1e3 - removal_ms;
        removed.tetrahedra.iter().for_each(|&t| present[t as usize] = false);
        compactions += usize::from(removed.compacted);
        pieces = removed.pieces;
        orphans += removed.orphans.len();
        let report = simulation.report();
        let residual = report.cg_residual;
        all.push(ResectionFrame {
            removed: removed.tetrahedra.len(),
            removal_ms,
            step_ms,
            residual,
        });
        iterations += report.cg_iterations;
        projections += report.projections;
    }
    let batch: Vec<u32> = (0..).zip(&present).filter(|p| *p.1).map(|p| p.0).step_by(3).collect();
    let batch = simulation.remove_elements(body, &Removal::new(Region::Tetrahedra(batch)))?;
    compactions += usize::from(batch.compacted);
    let difference = simulation.verify_against_fresh(body)?;
    let total = |f: &ResectionFrame| f.removal_ms + f.step_ms;
    let mut histogram: Vec<(f64, usize)> = Vec::new();
    for exponent in -3..12 {
        let limit = 2.0_f64.powi(exponent);
        let within = |t: f64| t <= limit && t > limit / 2.0;
        let count = all.iter().filter(|f| within(total(f))).count();
        if count > 0 {
            histogram.push((limit, count));
        }
    }
    let times = |pick: fn(&ResectionFrame) -> f64| FrameTimes::of(all.iter().map(pick).collect());
    Ok(ResectionRun {
        tetrahedra: mesh.tetrahedra.len(),
        prepare_ms,
        frame: times(total),
        removal: times(|f| f.removal_ms),
        step: times(|f| f.step_ms),
        histogram,
        residual: all.iter().map(|f| f.residual).fold(0.0, f64::max),
        iterations: f64::from(iterations) / all.len() as f64,
        projections,
        compactions,
        pieces,
        orphans,
        batch_ms: batch.time.as_secs_f64() * 1e3,
        difference: difference.largest().max(difference.mass),
        frames: all,
    })
}

/// What frames take, how many take how long, and what was cut and solved.
fn tables(runs: &[ResectionRun], threads: usize) -> Vec<Table> {
    let parts = runs.iter().flat_map(|r| {
        let parts = [("frame", &r.frame), ("removal", &r.removal), ("step", &r.step)];
        parts.map(|(name, times)| (r, name, times))
    });
    let title = "One tetrahedron removed per frame of 16.7 ms, safe step (ms)";
    let times = table_of!("resection", title; for (r, name, t) in parts;
        "what" => name, "tets" => r.tetrahedra, "frames" => r.frames.len(), "threads" => threads,
        "least" => t.min, "median" => t.median, "95 %" => t.p95, "99 %" => t.p99, "longest" => t.max,
        "above 16.7 ms %" => 100.0 * t.late,
    );
    let counts = runs.iter().flat_map(|r| r.histogram.iter().map(move |count| (r, count)));
    let histogram = table_of!("resection-frames", "Frames by their time"; for (r, (limit, count)) in counts;
        "tets" => r.tetrahedra, "up to ms" => *limit, "frames" => *count,
        "" => "#".repeat((count * 50).div_ceil(r.frames.len().max(1))),
    );
    let solved = table_of!("resection-solved", "What was cut and solved"; for r in runs;
        "tets" => r.tetrahedra, "prepared ms" => r.prepare_ms, "worst residual" => r.residual,
        "CG its" => r.iterations, "projections" => r.projections, "compactions" => r.compactions,
        "pieces" => r.pieces, "loose vertices" => r.orphans, "a third ms" => r.batch_ms,
        "off a fresh build" => r.difference,
    )
    .note("loose vertices: without elements after the frames; a third: of what is left, then removed at once.");
    vec![times, histogram, solved]
}
