//! Speed against error of kinds of elements: a clamped body under its own weight, from compressible to nearly
//! incompressible, by linear tetrahedra, clusters of them, ten-node tetrahedra and hexahedra, fully integrated and reduced, beside
//! the rivals that can run it. The bodies are a beam and a liver that is held at its top ([`ElementBody`]).
//!
//! * **Static error**: the equilibrium of the method on its mesh (rivals: the settled state) against the converged
//!   continuum, largest distance of a vertex over the largest displacement.
//! * **Error of the step**: 0.5 s of the swing from the straight shape, in steps of 10 ms, against converged Newton
//!   steps of the same length on the same mesh: what linearisation and loose linear solves cost. A settled state hides
//!   that.
//! * **Error of the swing**: the same motion against a fine one, by ten-node tetrahedra and TR-BDF2 in half the step.
//!
//! Swings are those of the beam.

pub mod report;

use crate::peers::equilibrium::equilibrium;
use crate::peers::mujoco::{Freedom, MuJoCo};
#[cfg(feature = "rapier")]
use crate::peers::rapier;
use crate::peers::sinew_rows::SinewRun;
use crate::peers::{Beam, BeamCase, Rival, at_zero, say};
use crate::toolbox::meshes::demo_mesh;
use crate::toolbox::meshes::refined;
use crate::toolbox::options::BenchOptions;
use crate::toolbox::prelude::*;
use crate::toolbox::stats::{Rounds, Spread, interleave};
use sinew::engine::mesh::Group;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::models::body::{Integration, VolumeRule};
use sinew_tune::measures::displacement_error;
use sinew_tune::table::three_digits;
use std::collections::{HashMap, HashSet};
use std::rc::Rc;

/// What is bent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum ElementBody {
    /// A box, clamped at one end.
    #[default]
    Beam,
    /// The coarse liver of the demos in its flat facets, whose meshes are refinements of that one: the same body on all.
    /// Held is the part above a plane, not the small ligament, about which a body turns as about a hinge.
    Liver,
}

impl ElementBody {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Beam, Self::Liver];

    /// Names of its tables: the rows, what rivals take at equal error, the continuum.
    fn tables(self) -> [&'static str; 3] {
        match self {
            Self::Beam => ["elements", "elements-equal", "elements-truth"],
            Self::Liver => ["elements-liver", "elements-liver-equal", "elements-liver-truth"],
        }
    }

    /// Name among the cases of the accuracy part.
    pub fn name(self) -> &'static str {
        self.tables()[0]
    }

    /// In words.
    fn words(self) -> &'static str {
        ["a clamped beam under its weight", "a liver held at its top, under its weight"]
            [self as usize]
    }

    /// Young's modulus (Pa), and gravity (m/s^2).
    fn load(self) -> [f64; 2] {
        [[YOUNG, GRAVITY], [LIVER_YOUNG, LIVER_GRAVITY]][self as usize]
    }

    /// Places that are nearer than this (m) are one.
    fn spacing(self) -> DVec3 {
        match self {
            Self::Beam => SIZE / DVec3::from_array(FINEST.map(|n| n as f64)),
            Self::Liver => DVec3::splat(1e-7),
        }
    }

    /// A mesh in words.
    fn grid(self, level: usize) -> String {
        match self {
            Self::Beam => grid(LEVELS[level]),
            Self::Liver => format!("edges/{}", 1 << level),
        }
    }

    /// The mesh of a level, and its clamped vertices.
    ///
    /// # Errors
    /// When it cannot be made or read.
    pub fn mesh(self, kind: Discretisation, level: usize) -> Result<(Mesh, Vec<u32>)> {
        let linear = match self {
            Self::Beam if kind.of_hexahedra() => box_hexahedra(SIZE, LEVELS[level])?,
            Self::Beam => box_tets(SIZE, LEVELS[level])?,
            Self::Liver => {
                let mut first = demo_mesh("liver_coarse.msh")?;
                let above = |&v: &u32| first.points[v as usize].z > LIVER_HELD;
                let vertices = (0..first.points.len() as u32).filter(above).collect();
                first.groups = vec![Group { name: HELD.into(), vertices, ..Group::default() }];
                (0..level).fold(first, |mesh, _| refined(&mesh))
            }
        };
        let ten = kind == Discretisation::TenNode;
        let mesh = if ten { linear.with_second_order() } else { linear.clone() };
        let fixed = match self {
            Self::Beam => at_zero(&mesh),
            Self::Liver => {
                // ten-node tetrahedra have the vertices of the next level
                let all = if ten { refined(&linear) } else { linear };
                let held = all.group(HELD).map_or(&[][..], |group| &group.vertices);
                let held: HashSet<[i32; 3]> =
                    held.iter().map(|&v| ElementPlaces::at(self, all.points[v as usize])).collect();
                let is_held =
                    |&v: &u32| held.contains(&ElementPlaces::at(self, mesh.points[v as usize]));
                (0..mesh.points.len() as u32).filter(is_held).collect()
            }
        };
        Ok((mesh, fixed))
    }

    /// Kinds that run on a level: ten-node tetrahedra have the vertices of the next one, and on the finest mesh only those
    /// run that the verdicts compare at equal error.
    fn kinds(self, level: usize, poisson_ratio: f64) -> Vec<Discretisation> {
        // levels of the liver count from that of the beam with as many tetrahedra
        let level = if self == Self::Liver { level + 1 } else { level };
        let here = |kind: &Discretisation| match (level, kind) {
            (_, kind) if self == Self::Liver && kind.of_hexahedra() => false,
            (4, Discretisation::Linear) => poisson_ratio == 0.3,
            (4, Discretisation::Clusters) => poisson_ratio == 0.4999,
            (4, _) => false,
            (3, Discretisation::TenNode) => false,
            // it locks: the meshes before show that, and a step takes seconds
            (3, Discretisation::Linear) => poisson_ratio < 0.4999,
            _ => true,
        };
        Discretisation::ALL.into_iter().filter(here).collect()
    }
}

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
/// Young's modulus (Pa) of the liver: that of the organ, within its spread.
const LIVER_YOUNG: f64 = 3e3;
/// Gravity (m/s^2) on the liver: it sinks by some 4 % of its length, as the beam.
const LIVER_GRAVITY: f64 = 5.5;
/// Height (m) above which vertices of the coarse liver are held; of finer ones, those between held ones.
const LIVER_HELD: f64 = 0.02;
/// Group of these.
const HELD: &str = "held";
/// Step (s) of all methods.
const H: f64 = 0.01;
/// Steps of the swing.
const STEPS: usize = 50;
/// Steps between comparisons.
const EVERY: usize = 5;
/// Cells of the finest grid: every vertex of every mesh is one of its corners.
const FINEST: [usize; 3] = [80, 16, 16];
/// Energy of Sinew's rows: it has all four kinds at every Poisson's ratio.
pub const ENERGY: Model = Model::NeoHookean;
/// Longest step (ms) of a rival that is still settled, which takes 200 of them, and of ours beside which converged steps
/// are made.
const PATIENCE_MS: f64 = 60.0;

/// One kind of element, or a rival, on one mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ElementRow {
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Kind of element; of a rival with its name.
    pub kind: String,
    /// `"Sinew"` or the rival.
    pub engine: String,
    /// Level of the mesh, coarse to fine.
    pub level: usize,
    /// The mesh in words.
    pub mesh: String,
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
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ElementTruth {
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// The mesh of ten-node tetrahedra that carries the equilibrium.
    pub mesh: String,
    /// Its largest displacement (m).
    pub largest: f64,
    /// Distance (%) of the equilibrium on half as many cells along each edge.
    pub coarser_percent: f64,
    /// Order at which these distances fall, from three meshes; 1 where there are only two.
    pub order: f64,
    /// Estimate of its own error (%), by Richardson from both.
    pub own_percent: f64,
    /// The same for the fine swing: a third of the distance of steps of twice the length, and what the mesh leaves by the
    /// order of the equilibria.
    pub swing_own_percent: Option<f64>,
    /// Distance (%) of the fine swing from that on half as many cells along each edge.
    pub swing_coarser_percent: Option<f64>,
    /// Distance (%) of the equilibria of St Venant-Kirchhoff and corotational bodies from the neo-Hookean one on the same
    /// mesh of ten-node tetrahedra.
    pub energies_percent: [Option<f64>; 2],
    /// What it took (s).
    pub seconds: f64,
}

/// All rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ElementReport {
    /// What is bent.
    pub body: ElementBody,
    /// The converged solutions.
    pub truths: Vec<ElementTruth>,
    /// One row per Poisson's ratio, kind and mesh.
    pub rows: Vec<ElementRow>,
    /// Rivals that did not run, and why.
    pub skipped: Vec<String>,
}

/// Kinds of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Discretisation {
    /// Linear tetrahedra, each keeping its own volume.
    Linear,
    /// Clusters of them.
    Clusters,
    /// Hexahedra that keep their mean volume.
    Hexahedra,
    /// Ten-node tetrahedra that do.
    TenNode,
    /// Hexahedra with reduced integration.
    ReducedHexahedra,
}

impl Discretisation {
    /// All, in the order of [`KINDS`].
    pub const ALL: [Self; 5] =
        [Self::Linear, Self::Clusters, Self::Hexahedra, Self::TenNode, Self::ReducedHexahedra];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        KINDS[self as usize]
    }

    fn of_hexahedra(self) -> bool {
        matches!(self, Self::Hexahedra | Self::ReducedHexahedra)
    }

    /// How its hexahedra are integrated.
    fn integration(self) -> Integration {
        match self {
            Self::ReducedHexahedra => Integration::Reduced,
            _ => Integration::Full,
        }
    }

    /// What keeps its volume.
    pub fn volume(self) -> VolumeRule {
        match self {
            Self::Linear => VolumeRule::Elements,
            _ => VolumeRule::Clusters,
        }
    }

    /// A body cut into these, on a level of its meshes.
    ///
    /// # Errors
    /// When the mesh cannot be made.
    pub fn beam(self, body: ElementBody, level: usize, poisson_ratio: f64) -> Result<Beam> {
        let [young_modulus, gravity] = body.load();
        let material = YoungPoisson { young_modulus, poisson_ratio, density: DENSITY };
        let name =
            format!("{} of {} {}, nu {poisson_ratio}", body.name(), body.grid(level), self.name());
        let (mesh, fixed) = body.mesh(self, level)?;
        let integration = self.integration();
        Ok(Beam { name, mesh, fixed, material, gravity, integration })
    }

    /// Steps by an integrator.
    fn run(self, integrator: Integrator, h: f64) -> SinewRun {
        self.solved(SolverSettings { integrator, ..Default::default() }, h)
    }

    /// Steps that are converged: the linear systems too.
    fn converged(self, integrator: Integrator, h: f64) -> SinewRun {
        SinewRun::converged(self.name(), ENERGY, integrator, h).with_volume(self.volume())
    }

    fn solved(self, settings: SolverSettings, h: f64) -> SinewRun {
        SinewRun::new(self.name(), ENERGY, settings, Some(h)).with_volume(self.volume())
    }
}

/// Names in the order of the chart: ours, then the rivals with as many iterations as they need.
pub const KINDS: [&str; 9] = [
    "linear tetrahedra",
    "clusters of tetrahedra",
    "hexahedra",
    "ten-node tetrahedra",
    "hexahedra, reduced integration",
    "MuJoCo tetrahedra",
    "MuJoCo trilinear cells",
    "MuJoCo quadratic cells",
    "Rapier tetrahedra",
];

/// What follows the name of a rival that ends at its own cap of iterations.
pub const CAPPED: &str = ", its cap of iterations";

/// Cells in words.
fn grid([x, y, z]: [usize; 3]) -> String {
    format!("{x}x{y}x{z}")
}

/// Where the vertices of a mesh of a body lie.
pub struct ElementPlaces(ElementBody, HashMap<[i32; 3], usize>);

impl ElementPlaces {
    /// Of these vertices.
    pub fn new(body: ElementBody, points: &[DVec3]) -> Self {
        Self(body, points.iter().enumerate().map(|(i, p)| (Self::at(body, *p), i)).collect())
    }

    fn at(body: ElementBody, point: DVec3) -> [i32; 3] {
        (point / body.spacing()).round().as_ivec3().to_array()
    }

    /// Pairs of vertices at one place: of these points, and of the mesh.
    pub fn pairs(&self, points: &[DVec3]) -> Vec<[usize; 2]> {
        let points = points.iter().enumerate();
        points.filter_map(|(i, p)| self.1.get(&Self::at(self.0, *p)).map(|&j| [i, j])).collect()
    }

    /// Error (%) of states of these points against those of the mesh, at the vertices that both have.
    pub fn error(
        &self,
        points: &[DVec3],
        found: &[Vec<DVec3>],
        truth: &[Vec<DVec3>],
    ) -> Option<f64> {
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
pub struct ContinuumTruth {
    /// Where its vertices are, and the equilibrium.
    pub still: (ElementPlaces, Vec<Vec<DVec3>>),
    swing: Option<(ElementPlaces, Vec<Vec<DVec3>>)>,
    /// How well it is known.
    pub row: ElementTruth,
}

impl ContinuumTruth {
    /// The equilibrium on level `finest` and, for its order, on the two before; the swing, where it is asked for, on `moving`
    /// and the one before.
    pub fn new(
        body: ElementBody,
        poisson_ratio: f64,
        finest: usize,
        moving: Option<usize>,
    ) -> Result<Self> {
        let start = Instant::now();
        let kind = Discretisation::TenNode;
        let still = |level| -> Result<(Beam, Vec<Vec<DVec3>>)> {
            let beam = kind.beam(body, level, poisson_ratio)?;
            let u = equilibrium(&beam, ENERGY, kind.volume())?;
            Ok((beam, vec![u]))
        };
        let places = |beam: &Beam| ElementPlaces::new(body, &beam.mesh.points);
        let missing = || BenchError::NoTruth {
            case: format!("{}, nu {poisson_ratio}", body.name()),
            reason: "the states have no vertex in common or are not finite".into(),
        };
        let (beam, u) = still(finest)?;
        let (middle, v) = still(finest - 1)?;
        let at = places(&beam);
        let coarser_percent = at.error(&middle.mesh.points, &v, &u).ok_or_else(missing)?;
        let mut order = 1.0;
        if finest > 1 {
            let (coarsest, w) = still(finest - 2)?;
            // the distance of both on the vertices of the coarsest, so that the order compares the same ones
            let near = places(&coarsest);
            let common = |beam: &Beam, states: &[Vec<DVec3>]| -> Vec<Vec<DVec3>> {
                let pairs = near.pairs(&beam.mesh.points);
                let mut rows = vec![DVec3::ZERO; coarsest.mesh.points.len()];
                pairs.iter().for_each(|&[i, j]| rows[j] = states[0][i]);
                vec![rows]
            };
            let (u0, v0) = (common(&beam, &u), common(&middle, &v));
            let distance = |a: &[Vec<DVec3>], b: &[Vec<DVec3>]| {
                displacement_error(a, b, coarsest.mesh.points.len()).ok_or_else(missing)
            };
            order = (distance(&w, &v0)? / distance(&v0, &u0)?).log2();
        }
        // below first order there is nothing to trust: the distance itself is the estimate
        let beyond = 1.0 / (2f64.powf(order.clamp(1.0, 4.0)) - 1.0);

        let swing = |level, h: f64| -> Result<(Beam, Vec<Vec<DVec3>>)> {
            let case = BeamCase { beam: kind.beam(body, level, poisson_ratio)?, truth: Vec::new() };
            let parts = (H / h).round() as usize;
            let mut run = kind.converged(Integrator::TrBdf2, h);
            let states = run.swing(&case, STEPS * parts, EVERY * parts)?;
            Ok((case.beam, states))
        };
        let (mut moved, mut swing_own_percent, mut swing_coarser_percent) = (None, None, None);
        if let Some(moving) = moving {
            let (mover, fine) = swing(moving, 0.5 * H)?;
            let (_, long) = swing(moving, H)?;
            let (small, coarse) = swing(moving - 1, H)?;
            let at = places(&mover);
            let long_percent = at.error(&mover.mesh.points, &long, &fine).ok_or_else(missing)?;
            let coarser = at.error(&small.mesh.points, &coarse, &long).ok_or_else(missing)?;
            swing_own_percent = Some(long_percent / 3.0 + coarser * beyond);
            swing_coarser_percent = Some(coarser);
            moved = Some((at, fine));
        }

        // the same elements for all three: means need an energy in J, which two of them are not
        let small = kind.beam(body, finest.saturating_sub(2), poisson_ratio)?;
        let plain = |model| equilibrium(&small, model, VolumeRule::Elements).ok();
        let own = plain(ENERGY);
        let energies_percent = [Model::StVK, Model::Corotational].map(|model| {
            let (other, own) = (plain(model)?, own.clone()?);
            displacement_error(&[other], &[own], small.mesh.points.len()).map(|e| 100.0 * e)
        });
        let row = ElementTruth {
            poisson_ratio,
            mesh: body.grid(finest),
            largest: u[0].iter().map(|x| x.length()).fold(0.0, f64::max),
            coarser_percent,
            order,
            own_percent: coarser_percent * beyond,
            swing_own_percent,
            swing_coarser_percent,
            energies_percent,
            seconds: start.elapsed().as_secs_f64(),
        };
        Ok(Self { still: (at, u), swing: moved, row })
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
struct ElementEntry {
    row: ElementRow,
    case: Rc<BeamCase>,
    rival: Box<dyn Rival>,
    /// Of ours; none of a rival.
    kind: Option<Discretisation>,
    times: Vec<f64>,
    failed: bool,
}

impl ElementRow {
    fn failed(kind: Discretisation, at: &ElementLevel, error: &BenchError) -> Self {
        Self {
            poisson_ratio: at.poisson_ratio,
            kind: kind.name().into(),
            engine: "Sinew".into(),
            level: at.level,
            mesh: at.body.grid(at.level),
            threads: 1,
            precision: "f64".into(),
            note: format!("failed: {error}"),
            ..Self::default()
        }
    }
}

impl ElementEntry {
    fn new(
        name: &str,
        kind: Option<Discretisation>,
        at: &ElementLevel,
        case: &Rc<BeamCase>,
        rival: Box<dyn Rival>,
    ) -> Self {
        let mesh = &case.beam.mesh;
        let given = rival.row(case);
        let row = ElementRow {
            poisson_ratio: case.beam.material.poisson_ratio,
            kind: name.into(),
            engine: given.engine,
            level: at.level,
            mesh: at.body.grid(at.level),
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
    fn finish(mut self, truth: &ContinuumTruth, newton: bool) -> ElementRow {
        if let Err(error) = self.measure(truth, newton) {
            say(&mut self.row.note, format!("failed: {error}"));
        }
        if self.kind.is_none() {
            say(&mut self.row.note, self.rival.remark());
        }
        self.row
    }

    fn measure(&mut self, truth: &ContinuumTruth, newton: bool) -> Result<()> {
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
        let Some((places, fine)) = &truth.swing else { return Ok(()) };
        let swing = self.rival.swing(&self.case, STEPS, EVERY)?;
        self.row.swing_percent = places.error(points, &swing, fine);
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
    body: ElementBody,
    options: &BenchOptions,
    mut tell: impl FnMut(&str),
) -> Result<ElementReport> {
    let mut report = ElementReport { body, ..ElementReport::default() };
    // rivals run on the beam only ([`ElementLevel::is_full`])
    let mut mujoco = None;
    if body == ElementBody::Beam {
        match MuJoCo::start(&options.python) {
            Ok(found) => mujoco = Some(found),
            Err(why) => report.skipped.push(why),
        }
        #[cfg(not(feature = "rapier"))]
        report.skipped.push("Rapier: not built in; build with `--features rapier`".into());
    }
    let all: &[f64] = match (body, options.quick) {
        (ElementBody::Beam, false) => &[0.3, 0.45, 0.49, 0.4999],
        _ => &[0.3, 0.4999],
    };
    // ten-node tetrahedra on finer meshes than any that is measured
    let (levels, truth_level, swing_level) = match (body, options.quick) {
        (ElementBody::Beam, false) => (5, 3, Some(2)),
        (ElementBody::Beam, true) => (2, 2, Some(1)),
        // its swings would take longer than all the rest
        (ElementBody::Liver, false) => (4, 2, None),
        (ElementBody::Liver, true) => (1, 1, None),
    };
    let name = body.name();
    for &poisson_ratio in all {
        tell(&format!("accuracy: {name}, nu {poisson_ratio}: the continuum"));
        let truth = ContinuumTruth::new(body, poisson_ratio, truth_level, swing_level)?;
        for level in 0..levels {
            let at = ElementLevel { body, poisson_ratio, level, quick: options.quick };
            if !body.kinds(level, poisson_ratio).is_empty() {
                tell(&format!("accuracy: {name}, nu {poisson_ratio}, {}", body.grid(level)));
                at.run(&truth, mujoco.as_mut(), &mut report)?;
            }
        }
        report.truths.push(truth.row);
    }
    let place = |kind: &str| KINDS.iter().position(|k| *k == kind).unwrap_or(KINDS.len());
    let key = |r: &ElementRow| (place(&r.kind), r.kind.clone(), r.level);
    report.rows.sort_by(|a, b| {
        a.poisson_ratio.total_cmp(&b.poisson_ratio).then_with(|| key(a).cmp(&key(b)))
    });
    Ok(report)
}

/// One mesh of one Poisson's ratio.
struct ElementLevel {
    body: ElementBody,
    poisson_ratio: f64,
    level: usize,
    quick: bool,
}

impl ElementLevel {
    /// Whether rivals run and swings are compared: on the beam, where their energies are nearly ours, and not on its finest
    /// mesh, where steps of rivals take seconds and converged ones longer than all the rest.
    fn is_full(&self) -> bool {
        self.body == ElementBody::Beam && self.level < 4
    }

    fn run(
        &self,
        truth: &ContinuumTruth,
        mujoco: Option<&mut MuJoCo>,
        report: &mut ElementReport,
    ) -> Result<()> {
        let mut entries: Vec<ElementEntry> = Vec::new();
        for kind in self.body.kinds(self.level, self.poisson_ratio) {
            let beam = kind.beam(self.body, self.level, self.poisson_ratio)?;
            match equilibrium(&beam, ENERGY, kind.volume()) {
                Ok(own) => {
                    let case = Rc::new(BeamCase { beam, truth: own });
                    let run = Box::new(kind.run(Integrator::Safe, H));
                    entries.push(ElementEntry::new(kind.name(), Some(kind), self, &case, run));
                }
                Err(error) => {
                    report.rows.push(ElementRow::failed(kind, self, &error));
                }
            }
        }
        if self.is_full() {
            self.rivals(truth, mujoco, &mut entries, report)?;
        }
        let rounds = match self.quick {
            true => Rounds { most: 2, least: 1, seconds: 0.3 },
            false => Rounds { most: 6, least: 2, seconds: 1.5 },
        };
        interleave(&mut entries, rounds, |entry| Ok::<f64, BenchError>(entry.time(10)))?;
        let newton = self.is_full();
        report.rows.extend(entries.into_iter().map(|entry| entry.finish(truth, newton)));
        Ok(())
    }

    /// Adds the rivals, which start from half of their kind's equilibrium: tetrahedra from that of ours, cells from that of
    /// the continuum.
    fn rivals(
        &self,
        truth: &ContinuumTruth,
        mujoco: Option<&mut MuJoCo>,
        entries: &mut Vec<ElementEntry>,
        report: &mut ElementReport,
    ) -> Result<()> {
        let cells = LEVELS[self.level];
        let linear = |level| Discretisation::Linear.beam(self.body, level, self.poisson_ratio);
        let own =
            entries.iter().find(|e| e.kind == Some(Discretisation::Linear)).map(|e| e.case.clone());
        let tetrahedra = match own {
            Some(case) => case,
            None => {
                let beam = linear(self.level)?;
                Rc::new(BeamCase { truth: truth.at(&beam.mesh.points), beam })
            }
        };
        let free = |level| -> Result<Rc<BeamCase>> {
            let beam = linear(level)?;
            Ok(Rc::new(BeamCase { truth: truth.at(&beam.mesh.points), beam }))
        };
        // settings that end before they have converged are compared on small meshes, where they still matter
        let capped = self.level < 3 && !self.quick;
        if let Some(mujoco) = mujoco {
            let mut bodies = vec![
                (5, Freedom::Full, tetrahedra.clone()),
                (6, Freedom::Trilinear(cells), free(self.level)?),
            ];
            if self.level < if self.quick { 1 } else { 3 } {
                // nodes in the middle of edges: the vertices of the next level
                bodies.push((7, Freedom::Quadratic(cells), free(self.level + 1)?));
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
                    let mut entry = ElementEntry::new(&kind, None, self, &case, rival);
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
                1 if capped => format!("{}{CAPPED}", KINDS[8]),
                2 => KINDS[8].to_owned(),
                _ => continue,
            };
            entries.push(ElementEntry::new(&kind, None, self, &tetrahedra, rival));
        }
        Ok(())
    }
}
