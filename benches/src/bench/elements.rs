//! Speed against error of kinds of elements: one clamped beam under its own weight, from compressible to nearly
//! incompressible, by linear tetrahedra, clusters of them, hexahedra and ten-node tetrahedra, beside the rivals that
//! can run it.
//!
//! * **Static error**: the equilibrium of the method on its mesh (rivals: the settled state) against the converged
//!   continuum, largest distance of a vertex over the largest displacement.
//! * **Error of the step**: 0.5 s of the swing from the straight shape, in steps of 10 ms, against converged Newton
//!   steps of the same length on the same mesh: what linearisation and loose linear solves cost. A settled state hides
//!   that.
//! * **Error of the swing**: the same motion against a fine one, by ten-node tetrahedra and TR-BDF2 in half the step.

use super::aims::Aim;
use super::error::BenchError;
use super::plot::{self, Panel, Series};
use super::stats::{Rounds, Spread, interleave};
use super::table::{Table, three_digits};
use crate::peers::mujoco::{Freedom, MuJoCo};
#[cfg(feature = "rapier")]
use crate::peers::rapier;
use crate::peers::sinew_rows::{Run, equilibrium};
use crate::peers::{Beam, Case, Rival, say};
use crate::report::Chart;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::models::body::VolumeRule;
use sinew::prelude::*;
use sinew_tune::measures::displacement_error;
use sinew_tune::table_of;
use std::collections::HashMap;
use std::rc::Rc;
use std::time::Instant;

/// Name among the cases of the accuracy part.
pub const NAME: &str = "elements";

/// Size of the beam (m): slender enough to bend, so that elements that are too stiff in shear or volume show it.
const SIZE: DVec3 = DVec3::new(0.10, 0.02, 0.02);
/// Young's modulus (Pa): the first mode is near 2 Hz, so that a step of 10 ms is a fiftieth of it, and the damping of
/// settling rivals ([`crate::peers::DAMPING`]) leaves nothing after their two seconds.
const YOUNG: f64 = 40e3;
/// Density (kg/m^3).
const DENSITY: f64 = 1000.0;
/// Gravity (m/s^2), a twenty-fifth of the earth's: the end sinks by 4 % of the length at strains of at most 1.5 %, where
/// neo-Hookean, St Venant-Kirchhoff and corotational bodies are nearly one ([`ElementTruth::energies_percent`]).
const GRAVITY: f64 = 0.4;
/// Step (s) of all methods.
const H: f64 = 0.01;
/// Steps of the swing.
const STEPS: usize = 50;
/// Steps between comparisons.
const EVERY: usize = 5;
/// Cells of the finest grid: every vertex of every mesh is one of its corners.
const FINEST: [usize; 3] = [80, 16, 16];
/// Energy of Sinew's rows: it has all four kinds at every Poisson's ratio.
const ENERGY: Model = Model::NeoHookean;
/// Longest step (ms) of a rival that is still settled, which takes 200 of them, and of ours beside which converged steps
/// are made.
const PATIENCE_MS: f64 = 60.0;

/// What is measured.
#[derive(Clone, Debug)]
pub struct ElementOptions {
    /// Two Poisson's ratios and coarse meshes, below a minute.
    pub quick: bool,
    /// Python with the package `mujoco`.
    pub python: String,
}

/// One kind of element, or a rival, on one mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ElementRow {
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Kind of element; of a rival with its name.
    pub kind: String,
    /// `"Sinew"` or the rival.
    pub engine: String,
    /// Cells of the box along its edges.
    pub cells: [usize; 3],
    /// Elements.
    pub elements: usize,
    /// Vertices.
    pub vertices: usize,
    /// Time (ms) of an undamped step of 10 ms from half the equilibrium.
    pub ms: Option<Spread>,
    /// Linear iterations per step, where they are told.
    pub iterations: Option<f64>,
    /// Equilibrium against the converged continuum (%).
    pub static_percent: Option<f64>,
    /// Swing against converged Newton steps of the same length on the same mesh (%).
    pub step_percent: Option<f64>,
    /// Swing against the fine one (%).
    pub swing_percent: Option<f64>,
    /// Threads.
    pub threads: usize,
    /// `"f64"` or `"f32"`.
    pub precision: String,
    /// What else there is to know, in words.
    pub note: String,
}

/// The converged continuum for one Poisson's ratio.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ElementTruth {
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Cells of the mesh of ten-node tetrahedra that carries the equilibrium.
    pub cells: [usize; 3],
    /// Its largest displacement (m).
    pub largest: f64,
    /// Distance (%) of the equilibrium on half as many cells along each edge.
    pub coarser_percent: f64,
    /// Order at which these distances fall, from three meshes.
    pub order: f64,
    /// Estimate of its own error (%), by Richardson from both.
    pub own_percent: f64,
    /// The same for the fine swing: a third of the distance of steps of twice the length, and what the mesh leaves by the
    /// order of the equilibria.
    pub swing_own_percent: f64,
    /// Distance (%) of the fine swing from that on half as many cells along each edge.
    pub swing_coarser_percent: f64,
    /// Distance (%) of the equilibria of St Venant-Kirchhoff and corotational bodies from the neo-Hookean one on the same
    /// mesh of ten-node tetrahedra.
    pub energies_percent: [Option<f64>; 2],
    /// What it took (s).
    pub seconds: f64,
}

/// All rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ElementReport {
    /// The converged solutions.
    pub truths: Vec<ElementTruth>,
    /// One row per Poisson's ratio, kind and mesh.
    pub rows: Vec<ElementRow>,
    /// Rivals that did not run, and why.
    pub skipped: Vec<String>,
}

/// Kinds of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Linear,
    Clusters,
    Hexahedra,
    TenNode,
}

impl Kind {
    const ALL: [Self; 4] = [Self::Linear, Self::Clusters, Self::Hexahedra, Self::TenNode];

    fn name(self) -> &'static str {
        KINDS[self as usize]
    }

    fn mesh(self, cells: [usize; 3]) -> Result<Mesh, BenchError> {
        Ok(match self {
            Self::Linear | Self::Clusters => box_tets(SIZE, cells)?,
            Self::Hexahedra => box_hexahedra(SIZE, cells)?,
            Self::TenNode => box_tets(SIZE, cells)?.with_second_order(),
        })
    }

    fn volume(self) -> VolumeRule {
        match self {
            Self::Linear => VolumeRule::Elements,
            _ => VolumeRule::Clusters,
        }
    }

    fn beam(self, cells: [usize; 3], poisson_ratio: f64) -> Result<Beam, BenchError> {
        let material = YoungPoisson { young_modulus: YOUNG, poisson_ratio, density: DENSITY };
        let name = format!("beam of {} {}, nu {poisson_ratio}", grid(cells), self.name());
        Ok(Beam { name, mesh: self.mesh(cells)?, material, gravity: GRAVITY })
    }

    /// Steps of 10 ms.
    fn run(self, integrator: Integrator, h: f64) -> Run {
        let settings = SolverSettings { integrator, ..Default::default() };
        Run::new(self.name(), ENERGY, settings, Some(h)).with_volume(self.volume())
    }

    /// Steps that are converged: the linear systems too.
    fn converged(self, integrator: Integrator, h: f64) -> Run {
        let settings = SolverSettings {
            integrator,
            linear_tolerance: 1e-6,
            max_linear_iterations: 50_000,
            ..Default::default()
        };
        Run::new(self.name(), ENERGY, settings, Some(h)).with_volume(self.volume())
    }
}

/// Colours of [`KINDS`]: a rival's elements have that of ours of the same kind.
const COLOURS: [usize; 8] = [0, 1, 2, 3, 0, 2, 3, 6];

/// Names in the order of the chart: ours, then the rivals with as many iterations as they need.
const KINDS: [&str; 8] = [
    "linear tetrahedra",
    "clusters of tetrahedra",
    "hexahedra",
    "ten-node tetrahedra",
    "MuJoCo tetrahedra",
    "MuJoCo trilinear cells",
    "MuJoCo quadratic cells",
    "Rapier tetrahedra",
];

/// What follows the name of a rival that ends at its own cap of iterations.
const CAPPED: &str = ", its cap of iterations";

/// Cells in words.
fn grid([x, y, z]: [usize; 3]) -> String {
    format!("{x}x{y}x{z}")
}

/// Where the vertices of a mesh lie on the finest grid.
struct Places(HashMap<[i32; 3], usize>);

impl Places {
    fn new(points: &[DVec3]) -> Self {
        Self(points.iter().enumerate().map(|(i, p)| (Self::at(*p), i)).collect())
    }

    fn at(point: DVec3) -> [i32; 3] {
        let cell = SIZE / DVec3::from_array(FINEST.map(|n| n as f64));
        (point / cell).round().as_ivec3().to_array()
    }

    /// Pairs of vertices at one place: of these points, and of the mesh.
    fn pairs(&self, points: &[DVec3]) -> Vec<[usize; 2]> {
        let points = points.iter().enumerate();
        points.filter_map(|(i, p)| self.0.get(&Self::at(*p)).map(|&j| [i, j])).collect()
    }

    /// Error (%) of states of these points against those of the mesh, at the vertices that both have.
    fn error(&self, points: &[DVec3], found: &[Vec<DVec3>], truth: &[Vec<DVec3>]) -> Option<f64> {
        let pairs = self.pairs(points);
        let picked = |states: &[Vec<DVec3>], side: usize| -> Vec<Vec<DVec3>> {
            let pick = |u: &Vec<DVec3>| pairs.iter().map(|pair| u[pair[side]]).collect();
            states.iter().map(pick).collect()
        };
        let error = displacement_error(&picked(found, 0), &picked(truth, 1), pairs.len());
        error.map(|e| 100.0 * e)
    }
}

/// The converged continuum: an equilibrium and a swing, each on a mesh of its own.
struct Truth {
    still: (Places, Vec<Vec<DVec3>>),
    swing: (Places, Vec<Vec<DVec3>>),
    row: ElementTruth,
}

/// Half as many cells along each edge.
fn halved(cells: [usize; 3]) -> [usize; 3] {
    cells.map(|n| n / 2)
}

impl Truth {
    /// The equilibrium on `cells` and, for its order, on half and a quarter; the swing on `moving` and on half.
    fn new(poisson_ratio: f64, cells: [usize; 3], moving: [usize; 3]) -> Result<Self, BenchError> {
        let start = Instant::now();
        let kind = Kind::TenNode;
        let still = |cells| -> Result<(Beam, Vec<Vec<DVec3>>), BenchError> {
            let beam = kind.beam(cells, poisson_ratio)?;
            let u = equilibrium(&beam, ENERGY, kind.volume())?;
            Ok((beam, vec![u]))
        };
        let places = |beam: &Beam| Places::new(&beam.mesh.points);
        let missing = || BenchError::NoTruth {
            case: format!("{NAME}, nu {poisson_ratio}"),
            reason: "the states have no vertex in common or are not finite".into(),
        };
        let (finest, u) = still(cells)?;
        let (middle, v) = still(halved(cells))?;
        let (coarsest, w) = still(halved(halved(cells)))?;
        let at = places(&finest);
        let coarser_percent = at.error(&middle.mesh.points, &v, &u).ok_or_else(missing)?;
        // the distance of both on the vertices of the coarsest, so that the order compares the same ones
        let near = places(&coarsest);
        let common = |beam: &Beam, states: &[Vec<DVec3>]| -> Vec<Vec<DVec3>> {
            let pairs = near.pairs(&beam.mesh.points);
            let mut rows = vec![DVec3::ZERO; coarsest.mesh.points.len()];
            pairs.iter().for_each(|&[i, j]| rows[j] = states[0][i]);
            vec![rows]
        };
        let (u0, v0) = (common(&finest, &u), common(&middle, &v));
        let distance = |a: &[Vec<DVec3>], b: &[Vec<DVec3>]| {
            displacement_error(a, b, coarsest.mesh.points.len()).ok_or_else(missing)
        };
        let order = (distance(&w, &v0)? / distance(&v0, &u0)?).log2();
        // below first order there is nothing to trust: the distance itself is the estimate
        let beyond = 1.0 / (2f64.powf(order.clamp(1.0, 4.0)) - 1.0);

        let swing = |cells, h: f64| -> Result<(Beam, Vec<Vec<DVec3>>), BenchError> {
            let case = Case { beam: kind.beam(cells, poisson_ratio)?, truth: Vec::new() };
            let parts = (H / h).round() as usize;
            let mut run = kind.converged(Integrator::TrBdf2, h);
            let states = run.swing(&case, STEPS * parts, EVERY * parts)?;
            Ok((case.beam, states))
        };
        let (mover, fine) = swing(moving, 0.5 * H)?;
        let (_, long) = swing(moving, H)?;
        let (small, coarse) = swing(halved(moving), H)?;
        let moved = places(&mover);
        let long_percent = moved.error(&mover.mesh.points, &long, &fine).ok_or_else(missing)?;
        let swing_coarser_percent =
            moved.error(&small.mesh.points, &coarse, &long).ok_or_else(missing)?;

        // the same elements for all three: means need an energy in J, which two of them are not
        let small = kind.beam(halved(halved(cells)), poisson_ratio)?;
        let plain = |model| equilibrium(&small, model, VolumeRule::Elements).ok();
        let own = plain(ENERGY);
        let energies_percent = [Model::StVK, Model::Corotational].map(|model| {
            let (other, own) = (plain(model)?, own.clone()?);
            displacement_error(&[other], &[own], small.mesh.points.len()).map(|e| 100.0 * e)
        });
        let row = ElementTruth {
            poisson_ratio,
            cells,
            largest: u[0].iter().map(|x| x.length()).fold(0.0, f64::max),
            coarser_percent,
            order,
            own_percent: coarser_percent * beyond,
            swing_own_percent: long_percent / 3.0 + swing_coarser_percent * beyond,
            swing_coarser_percent,
            energies_percent,
            seconds: start.elapsed().as_secs_f64(),
        };
        Ok(Self { still: (at, u), swing: (moved, fine), row })
    }

    /// The equilibrium (m) at these points.
    fn at(&self, points: &[DVec3]) -> Vec<DVec3> {
        let mut rows = vec![DVec3::ZERO; points.len()];
        let (places, states) = &self.still;
        places.pairs(points).iter().for_each(|&[i, j]| rows[i] = states[0][j]);
        rows
    }
}

/// A method on a mesh, on its way to a row.
struct Entry {
    row: ElementRow,
    case: Rc<Case>,
    rival: Box<dyn Rival>,
    /// Of ours; none of a rival.
    kind: Option<Kind>,
    times: Vec<f64>,
    failed: bool,
}

impl ElementRow {
    fn failed(kind: Kind, poisson_ratio: f64, cells: [usize; 3], error: &BenchError) -> Self {
        Self {
            poisson_ratio,
            kind: kind.name().into(),
            engine: "Sinew".into(),
            cells,
            threads: 1,
            precision: "f64".into(),
            note: format!("failed: {error}"),
            ..Self::default()
        }
    }
}

impl Entry {
    fn new(
        name: &str,
        kind: Option<Kind>,
        cells: [usize; 3],
        case: &Rc<Case>,
        rival: Box<dyn Rival>,
    ) -> Self {
        let mesh = &case.beam.mesh;
        let given = rival.row(case);
        let row = ElementRow {
            poisson_ratio: case.beam.material.poisson_ratio,
            kind: name.into(),
            engine: given.engine,
            cells,
            elements: mesh.tetrahedra.len() + mesh.hexahedra.len(),
            vertices: mesh.points.len(),
            threads: given.threads,
            precision: given.precision,
            note: if kind.is_some() { String::new() } else { given.setting },
            ..ElementRow::default()
        };
        Self { row, case: case.clone(), rival, kind, times: Vec::new(), failed: false }
    }

    /// Whether the steps so far took too long.
    fn slow(&self) -> Option<f64> {
        let least = self.times.iter().copied().min_by(f64::total_cmp);
        least.filter(|ms| *ms > PATIENCE_MS)
    }

    /// Times some steps; returns what they took (s). Of a rival that turns out too slow no more are made than a few.
    fn time(&mut self, steps: usize) -> f64 {
        let steps = if self.kind.is_none() && self.times.is_empty() { 2 } else { steps };
        if self.failed || (self.kind.is_none() && self.slow().is_some()) {
            return f64::INFINITY;
        }
        match self.rival.time(&self.case, steps) {
            Ok(times) => {
                let seconds = times.iter().sum::<f64>() * 1e-3;
                self.times.extend(times);
                seconds
            }
            Err(error) => {
                self.failed = true;
                say(&mut self.row.note, format!("failed: {error}"));
                f64::INFINITY
            }
        }
    }

    /// Its row, with all errors.
    fn finish(mut self, truth: &Truth, newton: bool) -> ElementRow {
        if let Err(error) = self.measure(truth, newton) {
            say(&mut self.row.note, format!("failed: {error}"));
        }
        let remark = self.rival.remark();
        if self.kind.is_none() && !remark.is_empty() {
            say(&mut self.row.note, remark);
        }
        self.row
    }

    fn measure(&mut self, truth: &Truth, newton: bool) -> Result<(), BenchError> {
        let Some(ms) = Spread::of(&self.times).filter(|_| !self.failed) else { return Ok(()) };
        let points = &self.case.beam.mesh.points;
        let still = match self.kind {
            // converged, and not the loose end of many steps
            Some(_) => self.case.truth.clone(),
            None => match self.slow() {
                Some(ms) => {
                    let text = format!("a step takes {} ms: not settled", three_digits(ms));
                    say(&mut self.row.note, text);
                    return Ok(());
                }
                None => self.rival.settle(&self.case)?,
            },
        };
        self.row.static_percent = truth.still.0.error(points, &[still], &truth.still.1);
        // a speed without an error is half a result
        self.row.ms = self.row.static_percent.and(Some(ms));
        self.row.iterations = self.rival.linear_iterations();
        let swing = self.rival.swing(&self.case, STEPS, EVERY)?;
        self.row.swing_percent = truth.swing.0.error(points, &swing, &truth.swing.1);
        let slow = self.slow().is_some();
        if let Some(kind) = self.kind.filter(|_| newton && !slow) {
            let run = kind.converged(Integrator::Newton, H).swing(&self.case, STEPS, EVERY)?;
            let error = displacement_error(&swing, &run, points.len());
            self.row.step_percent = error.map(|e| 100.0 * e);
        }
        Ok(())
    }
}

/// Cells of all levels, coarse to fine.
const LEVELS: [[usize; 3]; 5] = [[5, 1, 1], [10, 2, 2], [20, 4, 4], [40, 8, 8], FINEST];

/// Runs all; `tell` hears what is going on.
///
/// # Errors
/// When a mesh cannot be made or the continuum does not converge. A method that fails keeps its row with the reason.
pub fn run(
    options: &ElementOptions,
    mut tell: impl FnMut(&str),
) -> Result<ElementReport, BenchError> {
    let mut report = ElementReport::default();
    let mut mujoco = match MuJoCo::start(&options.python) {
        Ok(found) => Some(found),
        Err(why) => {
            report.skipped.push(why);
            None
        }
    };
    #[cfg(not(feature = "rapier"))]
    report.skipped.push("Rapier: not built in; build with `--features rapier`".into());
    let ratios: &[f64] = if options.quick { &[0.3, 0.4999] } else { &[0.3, 0.45, 0.49, 0.4999] };
    let levels = if options.quick { 0..2 } else { 0..4 };
    // on finer meshes than any that is measured
    let (truth_level, swing_level) = if options.quick { (2, 1) } else { (3, 2) };
    for &poisson_ratio in ratios {
        tell(&format!("accuracy: {NAME}, nu {poisson_ratio}: the continuum"));
        let truth = Truth::new(poisson_ratio, LEVELS[truth_level], LEVELS[swing_level])?;
        let level = |level: usize| Level { poisson_ratio, level, quick: options.quick };
        for at in levels.clone() {
            tell(&format!("accuracy: {NAME}, nu {poisson_ratio}, {}", grid(LEVELS[at])));
            level(at).run(&truth, mujoco.as_mut(), &mut report)?;
        }
        if !options.quick && [0.3, 0.4999].contains(&poisson_ratio) {
            tell(&format!("accuracy: {NAME}, nu {poisson_ratio}, {}", grid(FINEST)));
            level(LEVELS.len() - 1).run(&truth, None, &mut report)?;
        }
        report.truths.push(truth.row);
    }
    let place = |kind: &str| KINDS.iter().position(|k| *k == kind).unwrap_or(KINDS.len());
    let key = |r: &ElementRow| (place(&r.kind), r.kind.clone(), r.cells);
    report.rows.sort_by(|a, b| {
        a.poisson_ratio.total_cmp(&b.poisson_ratio).then_with(|| key(a).cmp(&key(b)))
    });
    Ok(report)
}

/// One mesh of one Poisson's ratio.
struct Level {
    poisson_ratio: f64,
    /// Place in [`LEVELS`].
    level: usize,
    quick: bool,
}

impl Level {
    /// Kinds that run here: ten-node tetrahedra have the vertices of the next level, and on the finest mesh only those
    /// run that the verdicts compare at equal error.
    fn kinds(&self) -> Vec<Kind> {
        let here = |kind: &Kind| match (self.level, kind) {
            (4, Kind::Linear) => self.poisson_ratio == 0.3,
            (4, Kind::Clusters) => self.poisson_ratio == 0.4999,
            (4, _) => false,
            (3, Kind::TenNode) => false,
            // it locks: the meshes before show that, and a step takes seconds
            (3, Kind::Linear) => self.poisson_ratio < 0.4999,
            _ => true,
        };
        Kind::ALL.into_iter().filter(here).collect()
    }

    fn run(
        &self,
        truth: &Truth,
        mujoco: Option<&mut MuJoCo>,
        report: &mut ElementReport,
    ) -> Result<(), BenchError> {
        let cells = LEVELS[self.level];
        let mut entries: Vec<Entry> = Vec::new();
        for kind in self.kinds() {
            let beam = kind.beam(cells, self.poisson_ratio)?;
            match equilibrium(&beam, ENERGY, kind.volume()) {
                Ok(own) => {
                    let case = Rc::new(Case { beam, truth: own });
                    let run = Box::new(kind.run(Integrator::Safe, H));
                    entries.push(Entry::new(kind.name(), Some(kind), cells, &case, run));
                }
                Err(error) => {
                    report.rows.push(ElementRow::failed(kind, self.poisson_ratio, cells, &error));
                }
            }
        }
        if self.level < 4 {
            self.rivals(truth, mujoco, &mut entries, report)?;
        }
        let rounds = match self.quick {
            true => Rounds { most: 2, least: 1, seconds: 0.3 },
            false => Rounds { most: 6, least: 2, seconds: 1.5 },
        };
        interleave(&mut entries, rounds, |entry| Ok::<f64, BenchError>(entry.time(10)))?;
        // converged steps of the finest mesh would take longer than all the rest
        let newton = self.level < 4;
        report.rows.extend(entries.into_iter().map(|entry| entry.finish(truth, newton)));
        Ok(())
    }

    /// Adds the rivals, which start from half of their kind's equilibrium: tetrahedra from that of ours, cells from that of
    /// the continuum.
    fn rivals(
        &self,
        truth: &Truth,
        mujoco: Option<&mut MuJoCo>,
        entries: &mut Vec<Entry>,
        report: &mut ElementReport,
    ) -> Result<(), BenchError> {
        let cells = LEVELS[self.level];
        let linear = |cells| Kind::Linear.beam(cells, self.poisson_ratio);
        let own = entries.iter().find(|e| e.kind == Some(Kind::Linear)).map(|e| e.case.clone());
        let tetrahedra = match own {
            Some(case) => case,
            None => {
                let beam = linear(cells)?;
                Rc::new(Case { truth: truth.at(&beam.mesh.points), beam })
            }
        };
        let free = |cells| -> Result<Rc<Case>, BenchError> {
            let beam = linear(cells)?;
            Ok(Rc::new(Case { truth: truth.at(&beam.mesh.points), beam }))
        };
        // settings that end before they have converged are compared on small meshes, where they still matter
        let capped = self.level < 3 && !self.quick;
        if let Some(mujoco) = mujoco {
            let mut bodies = vec![
                (4, Freedom::Full, tetrahedra.clone()),
                (5, Freedom::Trilinear(cells), free(cells)?),
            ];
            if self.level < if self.quick { 1 } else { 3 } {
                // nodes in the middle of edges: the vertices of the next level
                let case = free(LEVELS[self.level + 1])?;
                bodies.push((6, Freedom::Quadratic(cells), case));
            }
            for (name, freedom, case) in bodies {
                let found = match mujoco.rivals(&case, &[H], freedom) {
                    Ok(found) => found,
                    Err(error) => {
                        let what = format!("{} on {}: {error}", KINDS[name], case.beam.name);
                        report.skipped.push(what);
                        continue;
                    }
                };
                for (i, rival) in found.into_iter().enumerate() {
                    let kind = match i {
                        0 if capped => format!("{}{CAPPED}", KINDS[name]),
                        0 => continue,
                        _ => KINDS[name].to_owned(),
                    };
                    let mut entry = Entry::new(&kind, None, cells, &case, rival);
                    if freedom != Freedom::Full {
                        // the tetrahedra between the nodes carry nothing
                        entry.row.elements = cells.iter().product();
                    }
                    entries.push(entry);
                }
            }
        }
        #[cfg(feature = "rapier")]
        for (i, rival) in rapier::rivals(&tetrahedra, H).into_iter().enumerate() {
            let kind = match i {
                0 if capped => "Rapier constraints".to_owned(),
                1 if capped => format!("{}{CAPPED}", KINDS[7]),
                2 => KINDS[7].to_owned(),
                _ => continue,
            };
            entries.push(Entry::new(&kind, None, cells, &tetrahedra, rival));
        }
        Ok(())
    }
}

/// Time at which a curve of (time, error) points reaches an error, by straight lines in logarithms, and whether that lies
/// outside of what was measured. None where the errors do not fall towards it.
fn time_at_error(curve: &[[f64; 2]], error: f64) -> Option<(f64, bool)> {
    let mut points: Vec<[f64; 2]> =
        curve.iter().filter(|p| p.iter().all(|x| *x > 0.0 && x.is_finite())).copied().collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let through = |[a, b]: [[f64; 2]; 2]| {
        let share = (error / a[1]).ln() / (b[1] / a[1]).ln();
        let time = a[0] * (share * (b[0] / a[0]).ln()).exp();
        (b[1] < a[1] && time.is_finite()).then_some(time)
    };
    let pairs = || points.windows(2).map(|w| [w[0], w[1]]);
    let inside = pairs().find(|[a, b]| a[1] >= error && b[1] <= error);
    if let Some(pair) = inside {
        return through(pair).map(|t| (t, false));
    }
    let (first, last) = (points.first()?, points.last()?);
    let end = match () {
        () if error > first[1] => pairs().next()?,
        () if error < last[1] => pairs().next_back()?,
        () => return None,
    };
    through(end).map(|t| (t, true))
}

/// Time of the cheapest measured or interpolated point of a curve with at most this error; nothing is extrapolated.
fn time_within(curve: &[[f64; 2]], error: f64) -> Option<f64> {
    let measured = curve.iter().filter(|p| p[1] <= error).map(|p| p[0]).min_by(f64::total_cmp);
    let between = time_at_error(curve, error).filter(|(_, outside)| !outside).map(|(t, _)| t);
    measured.into_iter().chain(between).min_by(f64::total_cmp)
}

/// Errors within this share of the smallest are the same.
const SAME: f64 = 0.02;

/// The cheapest of the rows that are as exact as the best.
fn cheapest_of_best<R>(rows: Vec<(R, [f64; 2])>) -> Option<(R, [f64; 2])> {
    let least = rows.iter().map(|(_, p)| p[1]).min_by(f64::total_cmp)?;
    let best = rows.into_iter().filter(|(_, p)| p[1] <= (1.0 + SAME) * least);
    best.min_by(|a, b| a.1[0].total_cmp(&b.1[0]))
}

/// The same points, cheapest first, no error smaller than that of a dearer one: a coarse mesh may come near by chance, where
/// the error changes its sign.
fn without_luck(mut curve: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    curve.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut worst = 0.0_f64;
    for p in curve.iter_mut().rev() {
        worst = worst.max(p[1]);
        p[1] = worst;
    }
    curve
}

/// Most that a safe step with clusters at 0.4999 may cost over a plain one at 0.45.
const CLUSTER_STEP: f64 = 1.5;
/// Most iterations by which clusters at 0.49 and 0.4999 may differ.
const CLUSTER_ITERATIONS: f64 = 2.0;
/// Largest share of the time of linear tetrahedra that ten-node tetrahedra may take at equal static error.
const TEN_NODE_SHARE: f64 = 0.2;
/// Largest share of the time of a rival that the best kind of ours may take at equal static error.
const RIVAL_SHARE: f64 = 0.2;

impl ElementReport {
    fn of(&self, kind: &str, poisson_ratio: f64) -> impl Iterator<Item = &ElementRow> {
        self.rows.iter().filter(move |r| r.kind == kind && r.poisson_ratio == poisson_ratio)
    }

    /// Points (ms, static error) of a kind.
    fn curve(&self, kind: &str, poisson_ratio: f64) -> Vec<[f64; 2]> {
        self.of(kind, poisson_ratio).filter_map(ElementRow::point).collect()
    }

    /// Points of a kind for the chart: of a rival on each mesh the cheapest setting that is as exact as its best, since fewer
    /// iterations may do.
    fn drawn(&self, kind: &str, poisson_ratio: f64) -> Vec<[f64; 2]> {
        let settings = self.rows.iter().filter(|r| {
            let rest = r.kind.strip_prefix(kind);
            r.poisson_ratio == poisson_ratio && rest.is_some_and(|s| s.is_empty() || s == CAPPED)
        });
        let rows: Vec<(&ElementRow, [f64; 2])> =
            settings.filter_map(|r| r.point().map(|p| (r, p))).collect();
        let mut meshes: Vec<[usize; 3]> = rows.iter().map(|(r, _)| r.cells).collect();
        meshes.sort_unstable();
        meshes.dedup();
        let of = |cells| rows.iter().filter(|(r, _)| r.cells == cells).copied().collect();
        meshes.into_iter().filter_map(|m| cheapest_of_best(of(m)).map(|(_, p)| p)).collect()
    }

    fn ratios(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.rows.iter().map(|r| r.poisson_ratio).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    /// What was aimed at, as far as it was measured. The limits were fixed before.
    pub fn aims(&self) -> Vec<Aim> {
        let mut aims = Vec::new();
        let [linear, clusters, _, ten_node] = Kind::ALL.map(Kind::name);
        let on = |kind, nu, cells| self.of(kind, nu).find(move |r| r.cells == cells);
        for r in self.of(clusters, 0.4999) {
            let plain = on(linear, 0.45, r.cells).and_then(|p| p.ms);
            if let Some((ms, plain)) = r.ms.zip(plain) {
                let what = format!(
                    "safe step with clusters at nu 0.4999 over the plain one at 0.45, {}",
                    grid(r.cells)
                );
                aims.push(Aim::at_most(what, CLUSTER_STEP, "x", ms.median / plain.median));
            }
        }
        let differences = self.of(clusters, 0.4999).filter_map(|r| {
            let other = on(clusters, 0.49, r.cells)?.iterations?;
            Some((r.iterations? - other).abs())
        });
        if let Some(found) = differences.reduce(f64::max) {
            let what = "iterations per step of clusters at nu 0.49 and 0.4999, largest difference";
            aims.push(Aim::at_most(what, CLUSTER_ITERATIONS, "", found));
        }
        for (nu, other) in [(0.3, linear), (0.4999, clusters)] {
            let curve = self.curve(other, nu);
            for r in self.of(ten_node, nu) {
                let Some([ms, error]) = r.point() else { continue };
                let Some((time, outside)) = time_at_error(&curve, error) else { continue };
                let what = format!(
                    "ten-node tetrahedra over {other} at an equal static error of {} %, nu {nu}, {}{}",
                    three_digits(error),
                    grid(r.cells),
                    if outside { " (extrapolated)" } else { "" }
                );
                aims.push(Aim::at_most(what, TEN_NODE_SHARE, "x", ms / time));
            }
        }
        for nu in self.ratios() {
            for engine in ["MuJoCo", "Rapier"] {
                let theirs =
                    self.rows.iter().filter(|r| r.poisson_ratio == nu && r.engine == engine);
                // as exact as no finer mesh of its kind contradicts
                let sure = |r: &ElementRow| {
                    let [ms, _] = r.point()?;
                    let curve = without_luck(self.curve(&r.kind, nu));
                    curve.into_iter().find(|p| p[0] == ms)
                };
                let theirs = theirs.filter_map(|r| sure(r).map(|p| (r, p))).collect();
                let Some((row, [ms, error])) = cheapest_of_best(theirs) else { continue };
                let curves = Kind::ALL.map(|k| without_luck(self.curve(k.name(), nu)));
                let least = |of: &dyn Fn(&Vec<[f64; 2]>) -> Option<f64>| {
                    curves.iter().filter_map(of).min_by(f64::total_cmp)
                };
                let ours = least(&|curve| time_within(curve, error));
                let beyond = least(&|curve| time_at_error(curve, error).map(|(t, _)| t));
                let what = format!(
                    "our best elements over {} {} at its least error of {} %, nu {nu}{}",
                    row.kind,
                    grid(row.cells),
                    three_digits(error),
                    if ours.is_some() { "" } else { " (extrapolated)" }
                );
                // JSON has no infinity: without any elements that get there, the largest number
                let found = ours.or(beyond).map_or(f64::MAX, |t| t / ms);
                aims.push(Aim::at_most(what, RIVAL_SHARE, "x", found));
            }
        }
        aims
    }

    /// Tables: the rows, the converged solutions.
    pub fn tables(&self) -> Vec<Table> {
        let title = "Kinds of elements: a clamped beam under its weight, steps of 10 ms";
        let mut rows = table_of!("elements", title; for r in &self.rows;
            "nu" => r.poisson_ratio.to_string(), "kind" => &r.kind, "cells" => grid(r.cells),
            "elements" => r.elements, "vertices" => r.vertices, "ms/step" => r.ms.map(|m| m.median),
            "least ms" => r.ms.map(|m| m.minimum), "its/step" => r.iterations,
            "static error %" => r.static_percent, "step error %" => r.step_percent,
            "swing error %" => r.swing_percent, "threads" => r.threads, "precision" => &r.precision,
            "note" => &r.note,
        )
        .note(format!(
            "Beam {} x {} x {} m, E {} kPa, density {DENSITY} kg/m^3, gravity {GRAVITY} m/s^2. Sinew: neo-Hookean, safe \
             steps, linear residual 1e-3. ms/step: undamped steps from half the equilibrium, in turns.",
            SIZE.x, SIZE.y, SIZE.z, YOUNG / 1e3
        ))
        .note(
            "static error: largest distance of a vertex of the equilibrium (of a rival: of its settled state) from the \
             converged continuum, over the largest displacement. step error: the same over 0.5 s of swing, against \
             converged Newton steps of the same length on the same mesh. swing error: against the fine motion; most of \
             it is the damping of first-order steps of 10 ms.",
        );
        for reason in &self.skipped {
            rows = rows.note(format!("Not run: {reason}"));
        }
        let truths = table_of!("elements-truth", "The converged continuum"; for t in &self.truths;
            "nu" => t.poisson_ratio.to_string(), "cells" => grid(t.cells), "largest mm" => 1e3 * t.largest,
            "coarser by %" => t.coarser_percent, "order" => t.order, "own error %" => t.own_percent,
            "swing's own %" => t.swing_own_percent, "swing coarser by %" => t.swing_coarser_percent,
            "StVK off %" => t.energies_percent[0], "corotational off %" => t.energies_percent[1],
            "took s" => t.seconds,
        )
        .note(
            "Ten-node tetrahedra with one volume ratio each; own error by Richardson from meshes of half and a quarter of \
             the cells along each edge. The swing: TR-BDF2 in steps of 5 ms on half these cells; coarser: on a quarter; own \
             error: a third of what steps of 10 ms change, and by the same order what the mesh leaves. StVK and corotational: distance of these equilibria from the neo-Hookean \
             one, all on the same ten-node tetrahedra.",
        );
        let equal = table_of!("elements-equal", "What rivals take at equal static error";
            for (r, [ms, error], best) in self.at_equal_error();
            "nu" => r.poisson_ratio.to_string(), "rival" => &r.kind, "cells" => grid(r.cells),
            "static error %" => error, "its ms" => ms, "our ms" => best.map(|(_, t)| t),
            "its over ours" => best.map(|(_, t)| ms / t), "our elements" => best.map(|(kind, _)| kind.name()),
        )
        .note(
            "our ms: the cheapest of our kinds with at most this error, measured or on the line between two meshes; none \
             where no mesh of ours is as exact. A mesh of ours counts as no more exact than the finer ones of its kind: \
             coarse ones may come near by chance. Errors above some 50 % say that the body hardly moves.",
        );
        vec![rows, equal, truths]
    }

    /// Every rival's row with its time and error, and our cheapest elements that are as exact.
    fn at_equal_error(&self) -> impl Iterator<Item = (&ElementRow, [f64; 2], Option<(Kind, f64)>)> {
        let rivals = self.rows.iter().filter(|r| r.engine != "Sinew");
        rivals.filter_map(|r| r.point().map(|p| (r, p))).map(|(r, p)| {
            let ours = Kind::ALL.into_iter().filter_map(|kind| {
                let curve = without_luck(self.curve(kind.name(), r.poisson_ratio));
                time_within(&curve, p[1]).map(|t| (kind, t))
            });
            (r, p, ours.min_by(|a, b| a.1.total_cmp(&b.1)))
        })
    }

    /// The chart: one for each Poisson's ratio, then all in one picture.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub fn charts(&self) -> Result<Vec<Chart>, BenchError> {
        let panel = |nu: f64| Panel {
            name: format!("{NAME}-{nu}"),
            title: format!("Static error against time of a step, nu {nu}"),
            series: (KINDS.iter().enumerate())
                .map(|(i, kind)| {
                    Series::new(*kind, self.drawn(kind, nu), COLOURS[i]).hollow(i >= 4)
                })
                .collect(),
        };
        let panels: Vec<Panel> = self.ratios().into_iter().map(panel).collect();
        let axes = ["ms per step of 10 ms, one thread", "static error (%)"];
        plot::panels(NAME, axes, &panels, true)
    }
}

impl ElementRow {
    /// Time (ms) and static error (%), where both are there.
    fn point(&self) -> Option<[f64; 2]> {
        Some([self.ms?.median, self.static_percent?])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(kind: &str, nu: f64, cells: [usize; 3], ms: f64, error: f64) -> ElementRow {
        let engine = kind.split(' ').next().filter(|e| ["MuJoCo", "Rapier"].contains(e));
        ElementRow {
            poisson_ratio: nu,
            kind: kind.into(),
            engine: engine.unwrap_or("Sinew").into(),
            cells,
            ms: Spread::of(&[ms]),
            iterations: Some(ms),
            static_percent: Some(error),
            ..ElementRow::default()
        }
    }

    #[test]
    fn equal_errors_are_interpolated_in_logarithms() {
        // error = 10 / time
        let curve = [[1.0, 10.0], [100.0, 0.1], [10.0, 1.0]];
        let (time, outside) = time_at_error(&curve, 2.0).unwrap();
        assert!((time - 5.0).abs() < 1e-12 && !outside);
        let (time, outside) = time_at_error(&curve, 0.02).unwrap();
        assert!((time - 500.0).abs() < 1e-9 && outside);
        let (time, outside) = time_at_error(&curve, 20.0).unwrap();
        assert!((time - 0.5).abs() < 1e-12 && outside);
        assert_eq!(time_at_error(&curve, 10.0), Some((1.0, false)));
        // an error that rises leads nowhere
        assert_eq!(time_at_error(&[[1.0, 1.0], [10.0, 2.0]], 0.5), None);
        assert_eq!(time_at_error(&[[1.0, 1.0]], 0.5), None);
        assert_eq!(time_at_error(&[], 0.5), None);
        // a bound is measured or lies between: never beyond
        assert!((time_within(&curve, 2.0).unwrap() - 5.0).abs() < 1e-12);
        assert_eq!(time_within(&curve, 20.0), Some(1.0));
        assert_eq!(time_within(&curve, 0.02), None);
        // a coarse mesh that is near by chance counts as the finer one
        let lucky = without_luck(vec![[10.0, 8.0], [1.0, 2.0], [100.0, 4.0]]);
        assert_eq!(lucky, [[1.0, 8.0], [10.0, 8.0], [100.0, 4.0]]);
        assert_eq!(time_within(&lucky, 2.0), None);
        assert_eq!(time_within(&lucky, 8.0), Some(1.0));
    }

    #[test]
    fn verdicts_compare_what_they_say() {
        let [linear, clusters, _, ten_node] = Kind::ALL.map(Kind::name);
        let (a, b) = ([10, 2, 2], [20, 4, 4]);
        let mut report = ElementReport {
            rows: vec![
                row(linear, 0.3, a, 1.0, 20.0),
                row(linear, 0.3, b, 10.0, 5.0),
                row(linear, 0.45, a, 2.0, 20.0),
                row(clusters, 0.49, a, 5.5, 20.0),
                row(clusters, 0.4999, a, 3.0, 20.0),
                row(ten_node, 0.3, a, 1.0, 5.0),
                row("MuJoCo tetrahedra", 0.3, b, 100.0, 10.0),
                row("Rapier tetrahedra", 0.3, b, 100.0, 1.25),
            ],
            ..ElementReport::default()
        };
        let found = |report: &ElementReport| -> Vec<(f64, bool)> {
            report.aims().iter().map(|a| ((a.found * 1e6).round() / 1e6, a.met)).collect()
        };
        // steps 3 to 2; iterations 3 to 5.5; 1 ms to 10; the ten-node row beats MuJoCo; linear ones reach 1.25 % at 100 ms
        let all = [(1.5, true), (2.5, false), (0.1, true), (0.01, true), (1.0, false)];
        assert_eq!(found(&report), all);
        assert!(report.aims()[2].what.contains("equal static error of 5.00 %"));
        assert!(report.aims()[4].what.ends_with("nu 0.3 (extrapolated)"));
        // an extrapolation says so
        report.rows[5].static_percent = Some(2.5);
        assert!(report.aims()[2].what.ends_with("10x2x2 (extrapolated)"));
        // a cap that gives the same error is what counts, one that does not is not
        let capped = format!("Rapier tetrahedra{CAPPED}");
        report.rows.push(row(&capped, 0.3, b, 40.0, 1.26));
        report.rows.push(row(&capped, 0.3, a, 1.0, 30.0));
        report.rows.push(row("Rapier tetrahedra", 0.3, a, 9.0, 3.0));
        assert_eq!(report.drawn("Rapier tetrahedra", 0.3), [[9.0, 3.0], [40.0, 1.26]]);
        assert!((report.aims()[4].found - 2.5).abs() < 0.05, "{:?}", report.aims()[4]);
        report.rows.truncate(8);
        // a rival's row stands beside what ours take for its error
        let equal: Vec<_> = report.at_equal_error().map(|(_, _, best)| best).collect();
        assert_eq!(equal.len(), 2);
        assert_eq!(equal[0].unwrap().0, Kind::TenNode);
        assert_eq!((equal[0].unwrap().1, equal[1]), (1.0, None));
        // what failed is no figure
        report.rows[6].static_percent = None;
        assert_eq!(report.aims().len(), 4);
        assert!(ElementReport::default().aims().is_empty());
    }

    #[test]
    fn vertices_are_compared_at_their_places() {
        let fine = box_tets(SIZE, [20, 4, 4]).unwrap();
        let field = |points: &[DVec3]| points.iter().map(|p| DVec3::Z * p.x * p.x).collect();
        let places = Places::new(&fine.points);
        let truth: Vec<Vec<DVec3>> = vec![field(&fine.points)];
        for kind in Kind::ALL {
            let mesh = kind.mesh([10, 2, 2]).unwrap();
            assert_eq!(places.pairs(&mesh.points).len(), mesh.points.len(), "{kind:?}");
            let found: Vec<Vec<DVec3>> = vec![field(&mesh.points)];
            assert!(places.error(&mesh.points, &found, &truth).unwrap() < 1e-12, "{kind:?}");
            let off: Vec<Vec<DVec3>> = vec![found[0].iter().map(|u| *u * 1.1).collect()];
            let error = places.error(&mesh.points, &off, &truth).unwrap();
            assert!((error - 10.0).abs() < 1e-9, "{kind:?}: {error}");
        }
    }

    /// The finer the mesh the nearer to the continuum, and ten-node elements before linear ones.
    #[test]
    fn elements_converge_to_the_continuum() {
        let truth = Truth::new(0.4999, [20, 4, 4], [10, 2, 2]).unwrap();
        assert!(truth.row.own_percent > 0.0 && truth.row.own_percent < 1.0, "{:?}", truth.row);
        assert!(truth.row.energies_percent[0].unwrap() < 1.0, "{:?}", truth.row);
        let error = |kind: Kind, cells| {
            let beam = kind.beam(cells, 0.4999).unwrap();
            let own = equilibrium(&beam, ENERGY, kind.volume()).unwrap();
            truth.still.0.error(&beam.mesh.points, &[own], &truth.still.1).unwrap()
        };
        let [plain, clusters, ten] =
            [Kind::Linear, Kind::Clusters, Kind::TenNode].map(|k| error(k, [10, 2, 2]));
        assert!(ten < 0.2 * clusters && clusters < 0.7 * plain, "{plain} {clusters} {ten}");
    }
}
