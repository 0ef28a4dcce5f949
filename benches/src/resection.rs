//! Frame times while tetrahedra are removed: one per frame of 1/60 s, safe step, organs that hang
//! under their weight.

use serde::Serialize;
use sinew::engine::mesh::generate::sphere_tets;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use std::error::Error;
use std::fmt;
use std::time::Instant;

/// What is measured.
#[derive(Clone, Debug)]
pub struct ResectionOptions {
    /// Sizes of the ball (tetrahedra, about).
    pub sizes: Vec<usize>,
    /// Frames per run.
    pub frames: usize,
    /// Threads.
    pub threads: usize,
}

/// Distribution of times (ms).
#[derive(Clone, Debug, Serialize)]
pub struct Times {
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

impl Times {
    fn of(mut ms: Vec<f64>) -> Self {
        ms.sort_by(f64::total_cmp);
        let at = |q: f64| ms[((ms.len() as f64 * q).ceil() as usize).clamp(1, ms.len()) - 1];
        let late = ms.iter().filter(|&&t| t > FRAME * 1e3).count() as f64 / ms.len() as f64;
        Self { min: ms[0], median: at(0.5), p95: at(0.95), p99: at(0.99), max: at(1.0), late }
    }
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// Tetrahedra at the start.
    pub tetrahedra: usize,
    /// Time of preparing the body for removals (ms), before the first frame.
    pub prepare_ms: f64,
    /// Removal and step.
    pub frame: Times,
    /// Removal alone.
    pub removal: Times,
    /// Step alone.
    pub step: Times,
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
    #[serde(skip)]
    pub frames: Vec<Frame>,
}

/// One frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
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
}

/// All runs.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Frames per run.
    pub frames: usize,
    /// Threads.
    pub threads: usize,
    /// One per size.
    pub runs: Vec<Run>,
}

/// Length of a frame and of its step (s).
pub const FRAME: f64 = 1.0 / 60.0;
/// Radius of the ball (m): about a litre.
const RADIUS: f64 = 0.065;

/// Measures frame times.
///
/// # Errors
/// When a body cannot be made or a step fails.
pub fn run(options: &ResectionOptions) -> Result<Report, Box<dyn Error>> {
    let runs = options.sizes.iter().map(|&size| run_one(size, options));
    let runs = runs.collect::<Result<_, _>>()?;
    Ok(Report { frames: options.frames, threads: options.threads, runs })
}

fn run_one(size: usize, options: &ResectionOptions) -> Result<Run, Box<dyn Error>> {
    let shells = (size as f64 / 20.0).cbrt().round().max(2.0) as usize;
    let mesh = sphere_tets(RADIUS, shells)?;
    let held: Vec<u32> =
        (0..).zip(&mesh.points).filter(|(_, p)| p.z > 0.7 * RADIUS).map(|(i, _)| i).collect();
    let organ = Organ { mesh: &mesh, held: &held, material: preset("liver")?.material };
    let frames = options.frames.min(mesh.tetrahedra.len());
    cut(&organ, frames, options.threads, at_random(mesh.tetrahedra.len()))
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
/// # Errors
/// When the body cannot be made, or a removal or a step fails.
///
/// # Panics
/// When there are no frames.
pub fn cut(
    organ: &Organ<'_>,
    frames: usize,
    threads: usize,
    mut next: impl FnMut(usize) -> Region,
) -> Result<Run, Box<dyn Error>> {
    let Organ { mesh, held, material } = *organ;
    let mut simulation = Simulation::new(SimulationOptions { threads, ..Default::default() })?;
    let body = simulation.add_body(&BodyDescription::new("organ", mesh, material))?;
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
    let mut all: Vec<Frame> = Vec::new();
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
        all.push(Frame { removed: removed.tetrahedra.len(), removal_ms, step_ms, residual });
        iterations += report.cg_iterations;
        projections += report.projections;
    }
    let batch: Vec<u32> = (0..).zip(&present).filter(|p| *p.1).map(|p| p.0).step_by(3).collect();
    let batch = simulation.remove_elements(body, &Removal::new(Region::Tetrahedra(batch)))?;
    compactions += usize::from(batch.compacted);
    let difference = simulation.verify_against_fresh(body)?;
    let total = |f: &Frame| f.removal_ms + f.step_ms;
    let mut histogram: Vec<(f64, usize)> = Vec::new();
    for exponent in -3..12 {
        let limit = 2.0_f64.powi(exponent);
        let within = |t: f64| t <= limit && t > limit / 2.0;
        let count = all.iter().filter(|f| within(total(f))).count();
        if count > 0 {
            histogram.push((limit, count));
        }
    }
    let times = |pick: fn(&Frame) -> f64| Times::of(all.iter().map(pick).collect());
    Ok(Run {
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

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "One tetrahedron removed per frame of 16.7 ms, {} frames, {} thread(s), safe step",
            self.frames, self.threads
        )?;
        for r in &self.runs {
            writeln!(f, "\n{} tetrahedra, prepared in {:.1} ms", r.tetrahedra, r.prepare_ms)?;
            writeln!(f, "  ms          min  median    95 %    99 %     max   above 16.7 ms")?;
            for (name, t) in [("frame", &r.frame), ("removal", &r.removal), ("step", &r.step)] {
                let Times { min, median, p95, p99, max, late } = t;
                writeln!(
                    f,
                    "  {name:<7} {min:7.3} {median:7.3} {p95:7.3} {p99:7.3} {max:7.3} {:9.1} %",
                    100.0 * late
                )?;
            }
            for (limit, count) in &r.histogram {
                let bar = "#".repeat((count * 50).div_ceil(self.frames.max(1)));
                writeln!(f, "  up to {limit:7.3} ms {count:6} {bar}")?;
            }
            writeln!(
                f,
                "  worst linear residual {:.1e}, {:.1} iterations per frame, {} projections, {} \
                 compactions",
                r.residual, r.iterations, r.projections, r.compactions
            )?;
            writeln!(
                f,
                "  {} piece(s) and {} vertices without elements after the frames; then a third at once in \
                 {:.2} ms; off a fresh build by {:.1e}",
                r.pieces, r.orphans, r.batch_ms, r.difference
            )?;
        }
        Ok(())
    }
}
