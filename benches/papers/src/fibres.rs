//! Bourguignon & Cani 2000, figures 1, 5 and 6: a block hangs from its top and is pulled down; the way its elements are
//! cut, or its fibres, decide where it goes. All as the paper has it: springs in their printed form, fibres that are the
//! stiffest of three axes, equal masses, Störmer's method with damped springs, and plain springs of one stiffness. The
//! form of the axes with an energy stands beside it, as equilibria.

mod charts;
mod findings;

use super::frame::{
    as_stiff, clamp, damped_axes, equilibrium, settle, stormer, uniform, world, world_of_axes,
};
use super::prelude::*;
use crate::axes::law::{Printed, PrintedAxes, PrintedElement, PrintedModuli};
use crate::axes::springs::{AngularForm, AngularSprings, VolumeForm};
use rayon::prelude::*;
use sinew::engine::law::TangentKind;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, irregular_box_tets};
use sinew::models::axes::description::AxesDescription;
use sinew::models::axes::element::AXIS_PAIRS;
use sinew::models::axes::field::{FibreError, helicoidal, hemicircular, random};
use sinew::models::body::MassRule;
use std::borrow::Cow;
use std::f64::consts::FRAC_PI_4;

/// Block (m) and its cells.
const SIZE: DVec3 = DVec3::new(0.08, 0.08, 0.16);
const CELLS: [usize; 3] = [4, 4, 8];
/// The same with cells of half the size.
const FINE: [usize; 3] = [8, 8, 16];
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
/// Modulus (Pa) of the stiffest axis, five times Young's modulus; the paper prints none.
const FIBRE: f64 = 5e4;
/// Viscosity (Pa s) of all dampers: a twentieth of critical damping for the swing along the block, so that motion is
/// seen to go to and fro.
const VISCOSITY: f64 = 30.0;
/// Traction (Pa) on the bottom: about a third of Young's modulus, with which the block changes its shape as visibly as
/// in the figures.
const TRACTION: f64 = 3e3;
/// Tractions (Pa) over which the motion is judged, which hangs on how far the block is pulled.
const TRACTIONS: [f64; 4] = [500.0, 1e3, 2e3, TRACTION];
/// Constants of volume springs over those that the moduli ask for, over which figure 6 a is judged: the paper prints none.
const FACTORS: [u32; 3] = [1, 3, 10];
/// Jitter of the irregular meshes, of which these are taken.
const JITTER: f64 = 0.15;
const SEEDS: [u64; 4] = [0, 1, 2, 3];
/// Draws of random fibres on coarse and on fine meshes; every draw has the next irregular mesh.
const DRAWS: [u64; 2] = [16, 8];
/// Step (s) of the paper; steps of free motion, and steps after these in which mass damping (1/s), critical for the
/// slowest bending, brings the block to rest.
const STEP: f64 = 0.01;
const SWING: usize = 150;
const SETTLING: usize = 150;
const BRAKE: f64 = 20.0;
/// A block is at rest when its bottom moves by less than this, over the elongation, in the last 0.1 s.
const REST: f64 = 0.002;
/// Steps of the free motion at which it is drawn.
const FRAMES: [usize; 6] = [5, 10, 15, 20, 25, 30];

/// Where fibres run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Field {
    None,
    Horizontal,
    Diagonal,
    Hemicircular,
    Helicoidal,
    /// By the number of the draw.
    Random(u64),
}

/// The courses of fibres that do not hang on chance.
const COURSES: [Field; 5] =
    [Field::None, Field::Horizontal, Field::Diagonal, Field::Hemicircular, Field::Helicoidal];
/// Those that bend or twist the block.
const CURVED: [Field; 3] = [Field::Diagonal, Field::Hemicircular, Field::Helicoidal];

impl Field {
    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Horizontal => "horizontal",
            Self::Diagonal => "diagonal",
            Self::Hemicircular => "hemicircular",
            Self::Helicoidal => "helicoidal",
            Self::Random(_) => "random",
        }
    }

    /// Of every element, or one for all; empty without fibres.
    fn directions(self, mesh: &Mesh) -> Result<Vec<DVec3>> {
        let middle = 0.5 * SIZE;
        let defect = |e: FibreError| BenchError::Request {
            what: format!("{} fibres: {e}", self.name()),
            remedy: "this is a defect of the engine, report it".into(),
        };
        Ok(match self {
            Self::None => Vec::new(),
            Self::Horizontal => vec![DVec3::X],
            Self::Diagonal => vec![(DVec3::X + DVec3::Z).normalize()],
            Self::Hemicircular => {
                hemicircular(mesh, DVec3::Y, DVec3::X).map_err(defect)?.directions
            }
            Self::Helicoidal => {
                helicoidal(mesh, middle, DVec3::Z, FRAC_PI_4).map_err(defect)?.directions
            }
            Self::Random(draw) => random(mesh, draw).directions,
        })
    }
}

/// A mesh of the block.
struct Block {
    name: String,
    mesh: Mesh,
    cells: [usize; 3],
    /// Vertices of every layer of the grid, counted from the bottom.
    layers: Vec<Vec<usize>>,
}

impl Block {
    /// Of a mesh whose vertices are those of the regular grid, inner ones moved.
    fn new(name: String, mesh: Mesh, cells: [usize; 3]) -> Result<Self> {
        let mut layers = vec![Vec::new(); cells[2] + 1];
        for (v, x) in box_hexahedra(SIZE, cells)?.points.iter().enumerate() {
            layers[(x.z / SIZE.z * cells[2] as f64).round() as usize].push(v);
        }
        Ok(Self { name, mesh, cells, layers })
    }
}

/// Places of the meshes of tetrahedra among all.
const PARALLEL: usize = 0;
const IRREGULAR: [usize; SEEDS.len()] = [1, 2, 3, 4];
/// That of the hexahedra.
const HEXAHEDRA: usize = 5;
/// Meshes on which straight courses and the form with an energy are tried, which hang little on the mesh.
const FEW: [usize; 3] = [PARALLEL, IRREGULAR[0], IRREGULAR[1]];

/// The irregular mesh of a draw of random fibres.
fn mesh_of(draw: u64) -> usize {
    IRREGULAR[draw as usize % IRREGULAR.len()]
}

/// Tetrahedra cut alike, so that all diagonals are parallel; irregular ones; hexahedra.
fn blocks(cells: [usize; 3]) -> Result<Vec<Block>> {
    let fine = if cells == FINE { ", fine" } else { "" };
    let mut blocks =
        vec![Block::new(format!("parallel cuts{fine}"), box_tets(SIZE, cells)?, cells)?];
    for seed in SEEDS {
        let mesh = irregular_box_tets(SIZE, cells, JITTER, seed)?;
        blocks.push(Block::new(format!("irregular {}{fine}", seed + 1), mesh, cells)?);
    }
    blocks.push(Block::new(format!("hexahedra{fine}"), box_hexahedra(SIZE, cells)?, cells)?);
    Ok(blocks)
}

/// Three orthogonal axes of an element, the first along its fibre.
fn triad(along: DVec3) -> [DVec3; 3] {
    let a = along.normalize();
    let (b, c) = a.any_orthonormal_pair();
    [a, b, c]
}

/// Three axes, the first along the fibres and stiffer; the axes of an isotropic material without. Springs of volume are so
/// many times as stiff as its first Lamé parameter asks for.
fn axes(mesh: &Mesh, field: Field, volume: u32) -> Result<AxesDescription<'static>> {
    let mut axes = damped_axes(MATERIAL, VISCOSITY)?;
    let along = field.directions(mesh)?;
    if !along.is_empty() {
        let triads: Vec<[DVec3; 3]> = along.into_iter().map(triad).collect();
        for (i, family) in axes.families.iter_mut().enumerate() {
            family.directions = Cow::Owned(triads.iter().map(|t| t[i]).collect());
        }
        axes.families[0].modulus = FIBRE;
    }
    axes.volume_modulus *= f64::from(volume);
    Ok(axes)
}

/// What is made of the block.
#[derive(Clone, Copy, Debug)]
struct Shape {
    /// Mean displacement of the bottom (m).
    bottom: DVec3,
    /// Turn of the bottom about the vertical (degrees).
    twist: f64,
    /// Width of the middle over that at rest, along x and y.
    width: [f64; 2],
}

impl Shape {
    fn of(block: &Block, u: &[DVec3]) -> Self {
        let mesh = &block.mesh;
        let bottom = || block.layers[0].iter().copied();
        let mean = bottom().map(|v| u[v]).sum::<DVec3>() / bottom().count() as f64;
        // the rotation about the vertical that fits best
        let (mut sin, mut cos) = (0.0, 0.0);
        for v in bottom() {
            let x = mesh.points[v] - 0.5 * SIZE;
            let y = x + u[v] - mean;
            sin += x.x * y.y - x.y * y.x;
            cos += x.x * y.x + x.y * y.y;
        }
        let width = [0, 1].map(|k| {
            let at = |side: f64| {
                let middle = block.layers[block.cells[2] / 2].iter().copied();
                let on: Vec<usize> = middle.filter(|&v| mesh.points[v][k] == side).collect();
                on.iter().map(|&v| side + u[v][k]).sum::<f64>() / on.len() as f64
            };
            (at(SIZE[k]) - at(0.0)) / SIZE[k]
        });
        Self { bottom: mean, twist: sin.atan2(cos).to_degrees(), width }
    }

    /// Elongation (m).
    fn stretch(&self) -> f64 {
        -self.bottom.z
    }

    /// Sideways motion over elongation.
    fn drift(&self) -> f64 {
        self.bottom.truncate().length() / self.stretch()
    }

    /// Cross-section of the middle over that at rest.
    fn section(&self) -> f64 {
        self.width[0] * self.width[1]
    }
}

/// The block hung up, with a traction (Pa) on its bottom.
fn hung(
    block: &Block,
    (mut simulation, body): (Simulation, BodyHandle),
    traction: f64,
    curve: Curve,
) -> Result<(Simulation, BodyHandle)> {
    let (mesh, cells) = (&block.mesh, block.cells);
    clamp(&mut simulation, body, mesh, "z1")?;
    // the bottom is a regular grid on every mesh: traction goes to its vertices by their share of the area
    let (mut forces, cell) = (Vec::new(), SIZE / DVec3::from(cells.map(|n| n as f64)));
    let bottom: Vec<u32> = block.layers[0].iter().map(|&v| v as u32).collect();
    for (&v, row) in bottom.iter().zip(simulation.rows(body, "bottom", &bottom)?) {
        let x = mesh.points[v as usize];
        let edge = |x: f64, size: f64| if x == 0.0 || x == size { 0.5 } else { 1.0 };
        let area = cell.x * cell.y * edge(x.x, SIZE.x) * edge(x.y, SIZE.y);
        forces.push((row, DVec3::new(0.0, 0.0, -traction * area)));
    }
    simulation.add_load(Load { name: "pull".into(), forces, curve });
    Ok((simulation, body))
}

/// What hangs there.
#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// Axes as printed, with springs of volume so many times as stiff as the moduli ask for, or without, for the paper names
    /// them with its figure 3 only.
    Printed { field: Field, volume: u32 },
    /// Axes with an energy, at their equilibrium.
    Energy { field: Field, volume: u32 },
    /// Plain springs of one constant, with which the block is as stiff as its material under a small load; at their
    /// equilibrium.
    Springs,
}

impl What {
    fn field(self) -> Field {
        match self {
            Self::Printed { field, .. } | Self::Energy { field, .. } => field,
            Self::Springs => Field::None,
        }
    }

    /// Body, fibres, volume springs.
    fn words(self) -> (&'static str, &'static str, Option<f64>) {
        match self {
            Self::Printed { field, volume } => ("axes, printed", field.name(), Some(volume.into())),
            Self::Energy { field, volume } => {
                ("axes, with energy", field.name(), Some(volume.into()))
            }
            Self::Springs => ("plain springs", "", None),
        }
    }
}

/// Equilibrium under the traction, which is applied in parts.
fn pulled(block: &Block, what: What) -> Result<Swing> {
    let body = BodyDescription::new("block", &block.mesh, MATERIAL);
    let body = BodyDescription { masses: MassRule::Equal, ..body };
    let world = match what {
        What::Springs => {
            let springs = uniform(as_stiff(&block.mesh, MATERIAL, "z1")?);
            let model = Model::MassSpring;
            world(&BodyDescription { model, springs, ..body }, equilibrium())?
        }
        What::Printed { field, volume } | What::Energy { field, volume } => {
            let mut axes = axes(&block.mesh, field, volume)?;
            axes.families.iter_mut().for_each(|family| family.viscosity = 0.0);
            world_of_axes(body, axes, None, equilibrium())?
        }
    };
    let parts = 6;
    let curve = Curve::ramp(0.0, f64::from(parts));
    let (mut simulation, body) = hung(block, world, TRACTION, curve)?;
    let found = settle(&mut simulation, parts, &format!("{what:?}, {}", block.name));
    let u = simulation.displacements(body);
    Ok(match found {
        Ok(()) => Swing { end: Some(Shape::of(block, &u)), u, ..Swing::default() },
        Err(e) => Swing { failed: Some(e.to_string()), ..Swing::default() },
    })
}

/// A block let go under its traction, then braked.
#[derive(Default)]
struct Swing {
    /// Shapes step by step of the free motion.
    shapes: Vec<Shape>,
    /// Mean sideways displacement along x (m) of every layer from the bottom, likewise.
    axis: Vec<Vec<f64>>,
    /// Displacements (m) at [`FRAMES`].
    frames: Vec<Vec<DVec3>>,
    /// Where it comes to rest, and its displacements (m) there.
    end: Option<Shape>,
    u: Vec<DVec3>,
    /// What stopped it.
    failed: Option<String>,
}

/// Axes as printed under a traction (Pa), `free` steps without the brake.
fn swing(
    block: &Block,
    (field, volume): (Field, u32),
    traction: f64,
    free: usize,
) -> Result<Swing> {
    let description = BodyDescription::new("block", &block.mesh, MATERIAL);
    let description = BodyDescription { masses: MassRule::Equal, ..description };
    let axes = axes(&block.mesh, field, volume)?;
    let world = world_of_axes(description, axes, Some(VolumeForm::Printed), stormer(0.0))?;
    let (mut simulation, body) = hung(block, world, traction, Curve::Constant)?;
    simulation.set_dt(STEP);
    let mut swing = Swing::default();
    let mut before = DVec3::ZERO;
    for step in 0..free + SETTLING {
        if step == free {
            simulation.set_solver(stormer(BRAKE));
        }
        if let Err(e) = simulation.step() {
            swing.failed = Some(e.to_string());
            return Ok(swing);
        }
        let u = simulation.displacements(body);
        let shape = Shape::of(block, &u);
        if step < free {
            swing.shapes.push(shape);
            let mean = |k: usize| {
                let vertices = &block.layers[k];
                vertices.iter().map(|&v| u[v].x).sum::<f64>() / vertices.len() as f64
            };
            swing.axis.push((0..=block.cells[2]).map(mean).collect());
            if FRAMES.contains(&(step + 1)) {
                swing.frames.push(u.clone());
            }
        }
        if step + 11 == free + SETTLING {
            before = shape.bottom;
        }
        if step + 1 == free + SETTLING {
            let still = shape.bottom.distance(before) < REST * shape.stretch().abs();
            swing.end = Some(shape).filter(|_| still);
            swing.failed = (!still).then(|| "it did not come to rest".to_string());
            swing.u = u;
        }
    }
    Ok(swing)
}

/// Turning points of a series that differ by `least` at least from one to the next, its start first.
fn turns(values: &[f64], least: f64) -> Vec<f64> {
    let Some(&start) = values.first() else { return Vec::new() };
    let (mut turns, mut extreme, mut rising) = (vec![start], start, None);
    for &x in values {
        match rising {
            None if (x - start).abs() >= least => (rising, extreme) = (Some(x > start), x),
            Some(up) if (x > extreme) == up => extreme = x,
            Some(up) if (x - extreme).abs() >= least => {
                turns.push(extreme);
                (rising, extreme) = (Some(!up), x);
            }
            _ => {}
        }
    }
    if rising.is_some() {
        turns.push(extreme);
    }
    turns
}

/// The smaller of what values reach to either side of 0, over the larger of all.
fn both_ways(values: &[f64], largest: f64) -> f64 {
    let high = values.iter().fold(0.0f64, |m, x| m.max(*x));
    let low = values.iter().fold(0.0f64, |m, x| m.max(-x));
    high.min(low) / largest.max(f64::MIN_POSITIVE)
}

/// Share of the largest value that a turn of a series, or a bend to the other side, must have to count.
const CLEAR: f64 = 0.1;

impl Swing {
    /// Twists (degrees) in turn, of a tenth of the largest at least: out, back, out again.
    fn twists(&self) -> Vec<f64> {
        let mut values = vec![0.0];
        values.extend(self.shapes.iter().map(|s| s.twist));
        let largest = values.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        turns(&values, (CLEAR * largest).max(f64::MIN_POSITIVE))
    }

    /// How far the middle of the block goes to both sides over time: of the ways to either the smaller, over the larger.
    fn undulation(&self) -> f64 {
        let middle: Vec<f64> = self.axis.iter().map(|x| x[x.len() / 2]).collect();
        both_ways(&middle, middle.iter().fold(0.0f64, |m, x| m.max(x.abs())))
    }
}

/// Modes without resistance of a hexahedron of the block, with or without its springs of volume, rigid motions counted.
fn free_modes(volume: bool) -> Result<usize> {
    let mesh = box_hexahedra(SIZE, CELLS)?;
    let points = mesh.hexahedra[0].map(|v| mesh.points[v as usize]);
    let lame = MATERIAL.lame()?;
    let along = triad(DVec3::X);
    let none = || BenchError::NoTruth {
        case: "hexahedron".into(),
        reason: "an axis meets no two faces".into(),
    };
    let ends = along.map(|a| <Printed as PrintedElement<8>>::ends(points, a));
    let [Some(a), Some(b), Some(c)] = ends else { return Err(none()) };
    let moduli = PrintedModuli {
        axial: [2.0 * lame.mu; 3],
        share: [1.0; 3],
        angular: [lame.mu; 3],
        volume: if volume { lame.lambda } else { 0.0 },
    };
    let size = SIZE.x * SIZE.y * SIZE.z / CELLS.iter().product::<usize>() as f64;
    let made = PrintedAxes::new(points, size, (along, [a, b, c]), moduli, VolumeForm::Balanced);
    let blocks = made.tangent(&[[0.0; 3]; 8], TangentKind::Exact);
    let entry = |i: usize, j: usize| blocks[i / 3][j / 3][3 * (i % 3) + j % 3];
    let mut rows: Vec<Vec<f64>> = (0..24).map(|i| (0..24).map(|j| entry(i, j)).collect()).collect();
    // rank by elimination, the largest entry left being the pivot
    let largest = rows.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    let mut rank = 0;
    while rank < 24 {
        let all = (rank..24).flat_map(|i| (rank..24).map(move |j| (i, j)));
        let at = |p: &(usize, usize)| rows[p.0][p.1].abs();
        let Some((i, j)) = all.max_by(|p, q| at(p).total_cmp(&at(q))) else { break };
        if rows[i][j].abs() < 1e-9 * largest {
            break;
        }
        rows.swap(rank, i);
        rows.iter_mut().for_each(|row| row.swap(rank, j));
        let pivot = rows[rank].clone();
        for row in &mut rows[rank + 1..] {
            let factor = row[rank] / pivot[rank];
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
        }
        rank += 1;
    }
    Ok(24 - rank)
}

/// What printed springs of angles do to a mesh.
struct Moments {
    /// Net moment of such springs in a tetrahedron over the printed forces times its size, and how far it is from
    /// `-k m (|l1| - |l2|) u1 x u2`, over itself.
    own: f64,
    off: f64,
    /// Mean of (L1 - L2)/sqrt(L1 L2) over the tetrahedra, weighted by volume, for the pair of axes with the
    /// largest: the moment per volume for equal angles, over the modulus.
    mean: Vec<f64>,
}

/// Of diagonal fibres on some meshes; the tetrahedron is the first of the first mesh, sheared.
fn moments(blocks: &[&Block]) -> Result<Moments> {
    let axes = triad(DVec3::X + DVec3::Z);
    let ends = |block: &Block, e: usize| {
        let points = block.mesh.tetrahedra[e].map(|v| block.mesh.points[v as usize]);
        let ends = axes.map(|a| <Printed as PrintedElement<4>>::ends(points, a));
        (points, ends)
    };
    let mut mean = Vec::new();
    for block in blocks {
        let (mut sums, mut whole) = ([0.0; 3], 0.0);
        for e in 0..block.mesh.tetrahedra.len() {
            let ([o, a, b, c], ends) = ends(block, e);
            let volume = (a - o).cross(b - o).dot(c - o) / 6.0;
            whole += volume;
            for (sum, [i, j]) in sums.iter_mut().zip(AXIS_PAIRS) {
                if let (Some(p), Some(q)) = (&ends[i], &ends[j]) {
                    *sum += volume * (p.length - q.length) / (p.length * q.length).sqrt();
                }
            }
        }
        mean.push(sums.into_iter().fold(0.0f64, |m, x| m.max((x / whole).abs())));
    }
    let (points, of_one) = ends(blocks[0], 0);
    let [Some(a), Some(b), Some(c)] = of_one else {
        return Err(BenchError::NoTruth {
            case: "tetrahedron".into(),
            reason: "an axis meets no two faces".into(),
        });
    };
    let spread = [a, b, c].map(|e| e.spread());
    let springs =
        AngularSprings { spread, cosine: [0.0; 3], printed: [1.0, 0.0, 0.0], stiffness: [0.0; 3] };
    let sheared = points.map(|x| x + DVec3::new(0.3 * x.z + 0.1 * x.y, 0.0, 0.1 * x.x));
    let forces = springs.forces(&sheared.map(|x| x.to_array()), AngularForm::Printed);
    let moment: DVec3 =
        sheared.iter().zip(forces).map(|(x, f)| x.cross(DVec3::from_array(f))).sum();
    let chord = |i: usize| -> DVec3 { spread[i].iter().zip(&sheared).map(|(w, x)| *w * *x).sum() };
    let [i, j] = AXIS_PAIRS[0];
    let (p, q) = (chord(i), chord(j));
    let m = p.normalize().dot(q.normalize());
    let printed = -m * (p.length() - q.length()) * p.normalize().cross(q.normalize());
    let size = m.abs() * (p.length() + q.length());
    Ok(Moments {
        own: moment.length() / size,
        off: moment.distance(printed) / printed.length(),
        mean,
    })
}

/// A run: which size and mesh, and what hangs there.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    size: usize,
    mesh: usize,
    what: What,
    /// Pull (Pa) at the bottom.
    traction: f64,
}

impl Key {
    fn of(size: usize, mesh: usize, what: What) -> Self {
        Self { size, mesh, what, traction: TRACTION }
    }
}

/// All runs.
struct Measured {
    blocks: [Vec<Block>; 2],
    runs: Vec<(Key, Swing)>,
    /// Of a hexahedron without springs of volume, and with them.
    modes: [usize; 2],
    /// On parallel cuts, then on irregular meshes, coarse and fine each.
    moments: Moments,
}

/// Runs, and the steps that they are free for.
fn jobs() -> Vec<(Key, usize)> {
    let mut jobs = Vec::new();
    let printed = |field, volume| What::Printed { field, volume };
    let tetrahedra = || std::iter::once(PARALLEL).chain(IRREGULAR);
    // the slow ones first
    let draw = |size, draw, volume| {
        (Key::of(size, mesh_of(draw), printed(Field::Random(draw), volume)), 0)
    };
    let meshes = |field| -> Vec<usize> {
        if CURVED.contains(&field) { tetrahedra().collect() } else { FEW.to_vec() }
    };
    for size in [1, 0] {
        for field in COURSES {
            let own = meshes(field).into_iter();
            jobs.extend(own.map(|mesh| (Key::of(size, mesh, printed(field, 0)), 0)));
        }
    }
    jobs.extend((1..=DRAWS[1]).map(|d| draw(1, d, 1)));
    for volume in FACTORS {
        jobs.extend((1..=DRAWS[0]).map(|d| draw(0, d, volume)));
    }
    let first = IRREGULAR[0];
    for field in COURSES {
        jobs.push((Key::of(0, first, printed(field, 1)), SWING));
        jobs.push((Key::of(0, HEXAHEDRA, printed(field, 1)), 0));
        let energy = What::Energy { field, volume: 0 };
        for size in [0, 1] {
            jobs.extend(FEW.map(|mesh| (Key::of(size, mesh, energy), 0)));
        }
    }
    for volume in &FACTORS[1..] {
        jobs.push((Key::of(0, first, printed(Field::Horizontal, *volume)), 0));
    }
    for field in [Field::Hemicircular, Field::Diagonal] {
        let at = |traction| Key { traction, ..Key::of(0, first, printed(field, 1)) };
        let others = TRACTIONS.into_iter().filter(|t| *t != TRACTION);
        jobs.extend(others.map(|traction| (at(traction), SWING)));
    }
    jobs.push((Key::of(0, PARALLEL, printed(Field::None, 1)), 0));
    for size in [0, 1] {
        jobs.extend(tetrahedra().map(|mesh| (Key::of(size, mesh, What::Springs), 0)));
    }
    jobs
}

fn run(blocks: &[Vec<Block>; 2], key: Key, free: usize) -> Result<Swing> {
    let block = &blocks[key.size][key.mesh];
    match key.what {
        What::Printed { field, volume } => swing(block, (field, volume), key.traction, free),
        What::Energy { .. } | What::Springs => pulled(block, key.what),
    }
}

fn measure() -> Result<Measured> {
    let blocks = [blocks(CELLS)?, blocks(FINE)?];
    let runs: Result<Vec<(Key, Swing)>> = jobs()
        .into_par_iter()
        .with_max_len(1)
        .map(|(key, free)| Ok((key, run(&blocks, key, free)?)))
        .collect();
    let meshes = [PARALLEL, IRREGULAR[0]];
    let of: Vec<&Block> =
        meshes.iter().flat_map(|m| blocks.iter().map(move |size| &size[*m])).collect();
    let (modes, moments) = ([free_modes(false)?, free_modes(true)?], moments(&of)?);
    Ok(Measured { runs: runs?, modes, moments, blocks })
}

/// Constants (N/m) of plain springs as stiff as the material, on parallel cuts and on the first irregular mesh.
pub(crate) fn spring_constants() -> Result<[f64; 2]> {
    let blocks = blocks(CELLS)?;
    let of = |mesh: usize| as_stiff(&blocks[mesh].mesh, MATERIAL, "z1");
    Ok([of(PARALLEL)?, of(IRREGULAR[0])?])
}

pub(crate) fn figure() -> Result<Figure> {
    let measured = measure()?;
    let rows = measured.runs.iter().map(|(key, swing)| {
        (key, &measured.blocks[key.size][key.mesh].name, key.what.words(), swing.end)
    });
    let table = table_of!("a-pulled", "The block pulled down, at rest"; for (key, mesh, (body, fibres, volume), s) in rows;
        "body" => body, "fibres" => fibres, "volume springs times" => volume, "mesh" => mesh.clone(),
        "pull Pa" => key.traction,
        "elongation mm" => s.map(|s| 1e3 * s.stretch()), "sideways x mm" => s.map(|s| 1e3 * s.bottom.x),
        "sideways y mm" => s.map(|s| 1e3 * s.bottom.y), "twist degrees" => s.map(|s| s.twist),
        "width x %" => s.map(|s| 100.0 * s.width[0]), "width y %" => s.map(|s| 100.0 * s.width[1]),
    )
    .note("sideways: mean of the bottom; width: of the middle, over that at rest; empty: did not come to rest.");
    let [coarse, fine] = [CELLS, FINE].map(|n| n.iter().product::<usize>());
    let [constant, irregular] = spring_constants()?;
    Ok(Figure {
        setting: format!(
            "A block of {} x {} x {} m hangs from its top; a traction of {TRACTION} Pa pulls at its bottom from the \
             start, without gravity. Axes alone, in the printed form: three in every element with the moduli of an isotropic \
             material (E = {} Pa, nu = {}), the one along the fibres of {FIBRE} Pa. Equal masses, Störmer's method, \
             steps of {STEP} s cut where stability asks for it, dampers of {VISCOSITY} Pa s along all axes (and beside \
             the radial springs of hexahedra); figure 6 after {:.1} s of free motion, the others from the start, braked by \
             mass damping of {BRAKE} 1/s until they rest. Meshes of {coarse} and {fine} cells of six tetrahedra: cut alike, \
             so that all diagonals are parallel, and {} that are irregular (cut at random, vertices moved by {JITTER}). \
             Plain springs: one constant on all edges, so chosen by a run that the block is as stiff as its material under a \
             thousandth of its weight ({constant:.0} N/m on parallel cuts, {irregular:.0} N/m on an irregular mesh), and the \
             form with an energy: equilibria. The paper prints no sizes, moduli or loads.",
            SIZE.x,
            SIZE.y,
            SIZE.z,
            MATERIAL.young_modulus,
            MATERIAL.poisson_ratio,
            STEP * SWING as f64,
            SEEDS.len(),
        ),
        findings: measured.findings(),
        tables: vec![table],
        charts: measured.charts()?,
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::findings::{scatter, statistics};
    use super::*;
    use crate::figure::Verdict;

    #[test]
    fn turning_points_and_sides() {
        let values = [0.0, 3.0, 10.0, 9.5, 10.0, 4.0, 4.2, 8.0, 7.9];
        assert_eq!(turns(&values, 1.0), [0.0, 10.0, 4.0, 8.0]);
        assert_eq!(turns(&values, 5.0), [0.0, 10.0, 4.0]);
        assert_eq!(turns(&[1.0, 1.1, 0.95], 1.0), [1.0]);
        assert_eq!(both_ways(&[-1.0, 0.5, 4.0], 4.0), 0.25);
        let axis = [1.0, 4.0, -2.0].map(|middle| vec![0.0, middle, 9.0]).to_vec();
        assert_eq!(Swing { axis, ..Swing::default() }.undulation(), 0.5);
        assert_eq!(statistics(&[1.0, 3.0]), [2.0, 2f64.sqrt()]);
        let at = |x| {
            let bottom = DVec3::new(x, 0.0, -2.0);
            Some(Shape { bottom, twist: 0.0, width: [1.0; 2] })
        };
        assert_eq!(scatter(&[at(1.0), at(3.0)]), 2f64.sqrt() / 2.0);
        assert!(scatter(&[at(1.0), None]).is_nan());
    }

    #[test]
    fn fibres_move_the_block_as_they_should() {
        let block = blocks(CELLS).unwrap().swap_remove(IRREGULAR[0]);
        let pull = |field| pulled(&block, What::Energy { field, volume: 1 }).unwrap().end.unwrap();
        let plain = pull(Field::None);
        assert!(plain.drift() < 0.01 && plain.twist.abs() < 0.3, "{plain:?}");
        let diagonal = pull(Field::Diagonal);
        // ten times what is left to the plain block
        assert!(diagonal.drift() > 0.1, "{diagonal:?}");
        let helix = pull(Field::Helicoidal);
        assert!(helix.twist.abs() > 1.0, "{helix:?}");
        let level = pull(Field::Horizontal);
        assert!(
            level.width[0] > plain.width[0],
            "fibres resist the pull inwards: {level:?} {plain:?}"
        );
        assert!(level.width[1] < level.width[0], "{level:?}");
    }

    #[test]
    fn printed_axes_swing_in_explicit_steps() {
        let mesh = irregular_box_tets(SIZE, [2, 2, 4], JITTER, 0).unwrap();
        let block = Block::new("small".into(), mesh, [2, 2, 4]).unwrap();
        let run = swing(&block, (Field::Helicoidal, 1), TRACTION, 40).unwrap();
        assert_eq!(run.failed, None);
        assert!(run.shapes.len() == 40 && run.axis[0].len() == 5);
        assert_eq!(run.frames.len(), FRAMES.len());
        let end = run.end.unwrap();
        assert!(end.twist.abs() > 1.0 && end.stretch() > 0.0, "{end:?}");
        let overshoot = run.shapes.iter().map(Shape::stretch).fold(0.0, f64::max);
        assert!(overshoot > 1.2 * end.stretch(), "{overshoot} beside {}", end.stretch());
    }

    #[test]
    fn hexahedra_of_axes_alone_have_free_modes_and_printed_angles_a_moment() {
        // six springs have rank six at most, and the rigid motions are always free
        assert_eq!(free_modes(false).unwrap(), 18);
        let with = free_modes(true).unwrap();
        assert!((6..18).contains(&with), "{with}");
        let all = [blocks(CELLS).unwrap(), blocks([2, 2, 4]).unwrap()];
        let own = |mesh: usize| [&all[0][mesh], &all[1][mesh]];
        let found = moments(&[own(PARALLEL), own(IRREGULAR[0])].concat()).unwrap();
        assert!(found.off < 1e-9 && found.own > 0.01, "{} {}", found.own, found.off);
        // the same for cells of any size, and smaller where signs differ
        assert!((found.mean[0] / found.mean[1] - 1.0).abs() < 1e-9, "{:?}", found.mean);
        assert!(found.mean[2] < 0.5 * found.mean[0], "{:?}", found.mean);
    }

    /// Verdicts follow from the numbers: from runs that are written down here.
    #[test]
    fn verdicts_follow_from_the_places_of_the_bottom() {
        let shape =
            |x: f64| Shape { bottom: DVec3::new(x, 0.0, -1.0), twist: 0.0, width: [1.0; 2] };
        let blocks = || [blocks([1, 1, 2]).unwrap(), self::blocks([1, 1, 2]).unwrap()];
        let runs: Vec<(Key, Swing)> = jobs()
            .into_iter()
            .map(|(key, _)| {
                let parallel = key.mesh == PARALLEL;
                let x =
                    match key.what {
                        What::Springs if parallel => 0.7,
                        What::Springs => [0.05, 0.02][key.size],
                        What::Printed { field, volume: 0 } if CURVED.contains(&field) => {
                            if parallel { 0.5 } else { [0.01, 0.0][key.size] * key.mesh as f64 }
                        }
                        What::Printed { field: Field::None, volume: 1 } if parallel => 0.1,
                        What::Printed { field: Field::Random(draw), .. } => {
                            [0.05, 0.02][key.size] * draw as f64 / DRAWS[key.size] as f64
                        }
                        What::Printed { field: Field::Diagonal, volume: 1 } => 0.4,
                        _ => 0.0,
                    };
                (key, Swing { end: Some(shape(x)), ..Swing::default() })
            })
            .collect();
        let moments = Moments { own: 0.1, off: 1e-16, mean: vec![0.3, 0.3, 0.0, 0.0] };
        let mut measured = Measured { blocks: blocks(), runs, modes: [18, 10], moments };
        let verdicts =
            |m: &Measured| m.findings().iter().map(|f| f.verdict).collect::<Vec<Verdict>>();
        use Verdict::{Agrees, Differs, NotDetermined, PaperWrong};
        let expected = [
            NotDetermined,
            Agrees,
            Differs,
            Agrees,
            Agrees,
            Agrees,
            Differs,
            Differs,
            Agrees,
            Agrees,
            Agrees,
            PaperWrong,
            Agrees,
            Agrees,
        ];
        assert_eq!(verdicts(&measured), expected);
        // one load with which it undulates, one constant with which it thins: both hang on what is not printed
        for (key, swing) in &mut measured.runs {
            match key.what {
                What::Printed { field: Field::Hemicircular, .. } if key.traction == 1e3 => {
                    swing.axis = vec![vec![0.0, 1.0, 0.0], vec![0.0, -0.5, 0.0]];
                }
                What::Printed { field: Field::Horizontal, volume: 10 } => {
                    let thin = Shape { bottom: DVec3::new(0.0, 0.0, -1.1), ..shape(0.0) };
                    swing.end = Some(Shape { width: [0.9, 0.9], ..thin });
                }
                _ => {}
            }
        }
        let found = verdicts(&measured);
        assert_eq!([found[2], found[7]], [NotDetermined; 2]);
        // a moment that is not the one of the proof, and axes that drift as springs do
        measured.moments.off = 0.1;
        for (key, swing) in &mut measured.runs {
            if key.mesh == PARALLEL && key.what.field() == Field::None {
                swing.end = Some(shape(0.7));
            }
        }
        let found = verdicts(&measured);
        assert_eq!([found[0], found[8], found[11]], [Differs; 3]);
    }
}
