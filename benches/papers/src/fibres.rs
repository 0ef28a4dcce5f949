//! Bourguignon & Cani 2000, figures 1, 5 and 6: a block hangs from its top and is pulled down; fibres decide
//! where it goes. All as the paper has it: springs in their printed form, fibres that are the stiffest of three axes,
//! equal masses, Störmer's method with damped springs, and plain springs of one stiffness. The form of the axes with
//! an energy stands beside it, as equilibria.

use super::drawing::{Panel, bodies};
use super::frame::{
    clamp, damped_axes, equilibrium, settle, stormer, uniform, world, world_of_axes,
};
use super::prelude::*;
use crate::axes::springs::VolumeForm;
use rayon::prelude::*;
use sinew::engine::mesh::generate::{box_hexahedra, irregular_box_tets};
use sinew::models::axes::description::AxesDescription;
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
/// Traction (Pa) on the bottom.
const TRACTION: f64 = 1e3;
/// Jitter of the irregular meshes, of which these are taken.
const JITTER: f64 = 0.15;
const SEEDS: [u64; 3] = [0, 1, 2];
/// Step (s) of the paper; steps of free motion, and steps after these in which mass damping (1/s), critical for the
/// slowest bending, brings the block to rest.
const STEP: f64 = 0.01;
const SWING: usize = 150;
const SETTLING: usize = 150;
const BRAKE: f64 = 20.0;
/// A block is at rest when its bottom moves by less than this, over the elongation, in the last 0.1 s.
const REST: f64 = 0.002;

/// Where fibres run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Field {
    None,
    Horizontal,
    Diagonal,
    Hemicircular,
    Helicoidal,
    Random,
}

impl Field {
    const ALL: [Self; 6] = [
        Self::None,
        Self::Horizontal,
        Self::Diagonal,
        Self::Hemicircular,
        Self::Helicoidal,
        Self::Random,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Horizontal => "horizontal",
            Self::Diagonal => "diagonal",
            Self::Hemicircular => "hemicircular",
            Self::Helicoidal => "helicoidal",
            Self::Random => "random",
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
            Self::Random => random(mesh, 1).directions,
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

/// One of hexahedra, then irregular ones of tetrahedra.
fn blocks(cells: [usize; 3]) -> Result<Vec<Block>> {
    let fine = if cells == FINE { ", fine" } else { "" };
    let mesh = box_hexahedra(SIZE, cells)?;
    let mut blocks = vec![Block::new(format!("hexahedra{fine}"), mesh, cells)?];
    for seed in SEEDS {
        let mesh = irregular_box_tets(SIZE, cells, JITTER, seed)?;
        blocks.push(Block::new(format!("tetrahedra {}{fine}", seed + 1), mesh, cells)?);
    }
    Ok(blocks)
}

/// Three axes, the first along the fibres and stiffer; the axes of an isotropic material without.
fn axes(mesh: &Mesh, field: Field) -> Result<AxesDescription<'static>> {
    let mut axes = damped_axes(MATERIAL, VISCOSITY)?;
    let along = field.directions(mesh)?;
    if !along.is_empty() {
        let triads = along.into_iter().map(DVec3::normalize).map(|a| {
            let (b, c) = a.any_orthonormal_pair();
            [a, b, c]
        });
        let triads: Vec<[DVec3; 3]> = triads.collect();
        for (i, family) in axes.families.iter_mut().enumerate() {
            family.directions = Cow::Owned(triads.iter().map(|t| t[i]).collect());
        }
        axes.families[0].modulus = FIBRE;
    }
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

/// The block hung up, with the traction on its bottom.
fn hung(
    block: &Block,
    (mut simulation, body): (Simulation, BodyHandle),
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
        forces.push((row, DVec3::new(0.0, 0.0, -TRACTION * area)));
    }
    simulation.add_load(Load { name: "pull".into(), forces, curve });
    Ok((simulation, body))
}

/// Equilibrium of axes with an energy.
fn pulled(block: &Block, field: Field) -> Result<Shape> {
    let mut axes = axes(&block.mesh, field)?;
    axes.families.iter_mut().for_each(|family| family.viscosity = 0.0);
    let description = BodyDescription::new("block", &block.mesh, MATERIAL);
    let world = world_of_axes(description, axes, None, equilibrium())?;
    let (mut simulation, body) = hung(block, world, Curve::ramp(0.0, 2.0))?;
    settle(&mut simulation, 2, &format!("{} fibres, {}", field.name(), block.name))?;
    Ok(Shape::of(block, &simulation.displacements(body)))
}

/// What hangs there.
#[derive(Clone, Copy)]
enum What {
    Fibres(Field),
    Springs,
}

/// A block let go under its traction, then braked.
#[derive(Default)]
struct Swing {
    /// Shapes step by step of the free motion.
    shapes: Vec<Shape>,
    /// Mean sideways displacement along x (m) of every layer from the bottom, likewise.
    axis: Vec<Vec<f64>>,
    /// Where it comes to rest, and its displacements (m) there.
    end: Option<Shape>,
    u: Vec<DVec3>,
    /// What stopped it.
    failed: Option<String>,
}

fn swing(block: &Block, what: What, free: usize) -> Result<Swing> {
    let description = BodyDescription::new("block", &block.mesh, MATERIAL);
    let description = BodyDescription { masses: MassRule::Equal, ..description };
    let world = match what {
        What::Fibres(field) => {
            let axes = axes(&block.mesh, field)?;
            world_of_axes(description, axes, Some(VolumeForm::Printed), stormer(0.0))?
        }
        What::Springs => {
            let springs = uniform(MATERIAL.young_modulus * SIZE.x / block.cells[0] as f64);
            let model = Model::MassSpring;
            world(&BodyDescription { model, springs, ..description }, stormer(0.0))?
        }
    };
    let (mut simulation, body) = hung(block, world, Curve::Constant)?;
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

    /// How far the axis of the block bends to both sides at one time (of the curvature of either sign the smaller, over
    /// the largest of all times), and how far its middle goes to both sides over time.
    fn undulation(&self) -> [f64; 2] {
        let bends: Vec<Vec<f64>> = self
            .axis
            .iter()
            .map(|x| x.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect())
            .collect();
        let size = |values: &[f64]| values.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let largest = bends.iter().map(|b| size(b)).fold(0.0, f64::max);
        let inflection = bends.iter().map(|b| both_ways(b, largest)).fold(0.0, f64::max);
        let middle: Vec<f64> = self.axis.iter().map(|x| x[x.len() / 2]).collect();
        [inflection, both_ways(&middle, size(&middle))]
    }
}

/// All fields on all meshes, then plain springs on the coarse ones.
struct Measured {
    blocks: [Vec<Block>; 2],
    fields: [Vec<(Field, Vec<Swing>)>; 2],
    energy: Vec<(Field, Vec<Shape>)>,
    springs: Vec<Swing>,
}

fn measure() -> Result<Measured> {
    let blocks = [blocks(CELLS)?, blocks(FINE)?];
    let on = |blocks: &[Block], fields: &[Field], free: usize| {
        let jobs: Vec<(Field, &Block)> =
            fields.iter().flat_map(|f| blocks.iter().map(|b| (*f, b))).collect();
        let run = |(field, block): &(Field, &Block)| swing(block, What::Fibres(*field), free);
        let swings: Result<Vec<Swing>> = jobs.par_iter().map(run).collect();
        let mut swings = swings?.into_iter();
        let of = |f: &Field| (*f, swings.by_ref().take(blocks.len()).collect());
        Ok::<_, BenchError>(fields.iter().map(of).collect())
    };
    let same: Vec<Field> = Field::ALL.into_iter().filter(|f| *f != Field::Random).collect();
    let fields = [on(&blocks[0], &Field::ALL, SWING)?, on(&blocks[1], &same, 0)?];
    let energy = |field: &Field| {
        let shapes: Result<Vec<Shape>> =
            blocks[0].par_iter().map(|block| pulled(block, *field)).collect();
        Ok::<_, BenchError>((*field, shapes?))
    };
    let energy: Result<_> = Field::ALL.iter().map(energy).collect();
    let springs = blocks[0]
        .par_iter()
        .map(|block| swing(block, What::Springs, SWING))
        .collect::<Result<_, _>>()?;
    Ok(Measured { energy: energy?, springs, fields, blocks })
}

/// Largest difference of the place of the bottom between meshes, over the elongation; not a number where a mesh
/// did not come to rest.
fn parting(shapes: &[Option<Shape>]) -> f64 {
    let mut worst: f64 = 0.0;
    for a in shapes {
        for b in shapes {
            let (Some(a), Some(b)) = (a, b) else { return f64::NAN };
            worst = worst.max(a.bottom.distance(b.bottom) / a.stretch());
        }
    }
    worst
}

fn ends(swings: &[Swing]) -> Vec<Option<Shape>> {
    swings.iter().map(|s| s.end).collect()
}

/// Mean over meshes; not a number where one did not come to rest.
fn mean(swings: &[Swing], of: fn(&Shape) -> f64) -> f64 {
    let sum: f64 = swings.iter().map(|s| s.end.as_ref().map_or(f64::NAN, of)).sum();
    sum / swings.len() as f64
}

fn most(swings: &[Swing], of: fn(&Shape) -> f64) -> f64 {
    let each = swings.iter().map(|s| s.end.as_ref().map_or(f64::NAN, of));
    each.fold(0.0, |m: f64, x| if x.is_nan() { x } else { m.max(x) })
}

/// Share by which meshes may differ.
const SAME: f64 = 0.03;

impl Measured {
    /// Runs on irregular tetrahedra, on which the paper judges figures 1 and 6.
    fn of(&self, field: Field) -> &[Swing] {
        self.fields[0].iter().find(|(f, _)| *f == field).map_or(&[], |(_, swings)| &swings[1..])
    }

    fn findings(&self) -> Vec<Finding> {
        let (axes, springs) =
            (most(self.of(Field::None), Shape::drift), most(&self.springs[1..], Shape::drift));
        let energy = self.energy.iter().find(|(f, _)| *f == Field::None);
        let energy = energy.map_or(&[][..], |(_, shapes)| &shapes[1..]);
        let energy = energy.iter().map(Shape::drift).fold(0.0, f64::max);
        let mut findings = vec![Finding::of(axes < 0.01 && springs > 2.0 * axes).says(format!(
            "axes without fibres hardly leave the vertical on irregular meshes: sideways motion is at most \
             {:.2} % of the elongation (1 % allowed); that of plain springs of one stiffness on the same meshes \
             {:.2} % (at least twice as much), that of axes with an energy {:.2} %; as printed, \
             springs of angles have moments and those of volume resultants on irregular elements",
            100.0 * axes,
            100.0 * springs,
            100.0 * energy
        ))];
        findings.extend(self.of_courses());
        findings.extend(self.of_motion());
        findings.push(self.of_hexahedra());
        findings.extend(self.fields[1].iter().map(|(field, fine)| self.of_meshes(*field, fine)));
        findings
    }

    /// Figure 6 at rest.
    fn of_courses(&self) -> [Finding; 3] {
        let [level, chance] = [Field::Horizontal, Field::Random].map(|f| self.of(f));
        let [stretches, sections] =
            [Shape::stretch, Shape::section].map(|of| [mean(level, of), mean(chance, of)]);
        let thinner = stretches[0] > stretches[1] && sections[0] < sections[1];
        let horizontal = Finding::of(thinner).says(format!(
            "horizontal fibres make the block thinner and longer than random ones, the paper's isotropic body: \
             elongation {:.1} mm beside {:.1} mm, cross-section of the middle {:.1} % of that at rest beside {:.1} % \
             (along the fibres {:.1} % of the width, across them {:.1} %)",
            1e3 * stretches[0],
            1e3 * stretches[1],
            100.0 * sections[0],
            100.0 * sections[1],
            100.0 * mean(level, |s| s.width[0]),
            100.0 * mean(level, |s| s.width[1]),
        ));
        let diagonal = mean(self.of(Field::Diagonal), Shape::drift);
        let bend = Finding::of(diagonal > 0.2).says(format!(
            "diagonal fibres bend the block to one side: sideways motion of {:.0} % of the elongation (at least 20 %)",
            100.0 * diagonal
        ));
        let drift = most(chance, Shape::drift);
        let random = Finding::of(drift < 0.1).says(format!(
            "random fibres leave it isotropic: sideways motion of {:.1} % of the elongation at most (10 % allowed); \
             every element has one direction, and chance does not cancel out over {} cells",
            100.0 * drift,
            CELLS.iter().product::<usize>()
        ));
        [horizontal, bend, random]
    }

    /// Figure 6 in motion, on the first mesh of tetrahedra.
    fn of_motion(&self) -> [Finding; 2] {
        let first = |field: Field| self.of(field).first();
        let twists = first(Field::Helicoidal).map(Swing::twists).unwrap_or_default();
        let largest = |field| {
            let twist = |s: &Swing| s.shapes.iter().fold(0.0f64, |m, s| m.max(s.twist.abs()));
            first(field).map_or(f64::NAN, twist)
        };
        let (own, without) = (largest(Field::Helicoidal), largest(Field::None));
        let list: Vec<String> = twists.iter().map(|t| format!("{t:.1}")).collect();
        // from 0 out, back and out again
        let successively = twists.len() >= 4 && without < CLEAR * own;
        let helix = Finding::of(successively).says(format!(
            "helicoidal fibres twist and untwist it successively: its bottom turns to {} degrees within {:.1} s; \
             without fibres it turns by {without:.2} degrees at most",
            list.join(", "),
            STEP * SWING as f64
        ));
        let undulation =
            |field| first(field).map_or([f64::NAN; 2], Swing::undulation).map(|x| 100.0 * x);
        let ([bends, sides], other) =
            (undulation(Field::Hemicircular), undulation(Field::Diagonal));
        let snake = Finding::of(bends.max(sides) > 100.0 * CLEAR).says(format!(
            "hemicircular fibres make it undulate like a snake: its axis bends to both sides at once, to the lesser \
             side {bends:.0} % of the largest curvature, or its middle goes to both sides in turn, to the lesser one \
             {sides:.0} % of the way (10 % of either counts; {:.0} and {:.0} % with diagonal fibres)",
            other[0], other[1]
        ));
        [helix, snake]
    }

    /// Whether hexahedra can be run as printed.
    fn of_hexahedra(&self) -> Finding {
        let runs =
            self.fields.iter().flatten().filter_map(|(f, swings)| Some((f, swings.first()?)));
        let failed: Vec<_> = runs
            .filter_map(|(f, s)| s.failed.as_ref().map(|why| format!("{}: {why}", f.name())))
            .collect();
        Finding::of(failed.is_empty()).says(format!(
            "hexahedra with printed, damped springs come to rest: {}",
            match failed.first() {
                None => "all fields on both sizes".to_string(),
                Some(first) => format!("{} runs do not, the first of them {first}", failed.len()),
            }
        ))
    }

    /// Whether a field does the same on all meshes of either size.
    fn of_meshes(&self, field: Field, fine: &[Swing]) -> Finding {
        let all = self.fields[0].iter().find(|(f, _)| *f == field).map_or(&[][..], |(_, s)| s);
        let [coarse, finer] = [all, fine].map(|swings| {
            let shapes = ends(swings);
            (100.0 * parting(&shapes), 100.0 * parting(&shapes[1..]))
        });
        let energy = self.energy.iter().find(|(f, _)| *f == field);
        let energy = energy.map_or(f64::NAN, |(_, shapes)| {
            100.0 * parting(&shapes.iter().copied().map(Some).collect::<Vec<_>>())
        });
        let cells = [CELLS, FINE].map(|n| n.iter().product::<usize>());
        let what = match field {
            Field::None => "without fibres".to_string(),
            _ => format!("{} fibres", field.name()),
        };
        Finding::of(coarse.0.max(finer.0) < 100.0 * SAME && !finer.0.is_nan() && !coarse.0.is_nan())
            .says(format!(
                "{what}: the bottom goes to the same place on meshes of tetrahedra and hexahedra of either size, within \
                 {:.1} % of the elongation with {} cells and {:.1} % with {} ({:.0} % allowed on both); on the three of \
                 tetrahedra alone {:.1} and {:.1} %; the form with an energy, {} cells: {energy:.1} %",
                coarse.0, cells[0], finer.0, cells[1], 100.0 * SAME, coarse.1, finer.1, cells[0]
            ))
    }

    /// Places of the bottom, shapes at rest, and the motion.
    fn charts(&self) -> Result<Vec<Chart>> {
        let place = |s: &Shape| [1e3 * s.bottom.x, 1e3 * s.bottom.z];
        let places =
            |swings: &[Swing]| swings.iter().filter_map(|s| s.end.as_ref().map(place)).collect();
        let named = |(colour, (field, swings)): (usize, &(Field, Vec<Swing>))| {
            Series::new(field.name(), places(swings), colour)
        };
        let mut series: Vec<Series> = self.fields[0].iter().enumerate().map(named).collect();
        let springs = places(&self.springs);
        series.push(Series::new("plain springs", springs, Field::ALL.len()).hollow(true));
        let title = "Where the bottom comes to rest: hexahedra and three meshes of tetrahedra";
        let names = ["sideways (mm)", "down (mm)"];
        let mut charts = vec![lines("a-pulled", title, names, &series, Scales::Scattered)?];
        let over_time = |of: fn(&Shape) -> f64| -> Vec<Series> {
            let series = |(colour, field): (usize, Field)| {
                let shapes = self.of(field).first().map_or(&[][..], |s| &s.shapes);
                let points = (1..).zip(shapes).map(|(i, s)| [STEP * f64::from(i), of(s)]);
                Series::new(field.name(), points.collect(), colour)
            };
            Field::ALL.into_iter().enumerate().map(series).collect()
        };
        let twist = over_time(|s| s.twist);
        let names = ["time (s)", "turn of the bottom (degrees)"];
        charts.push(lines("a-twist", "Twisting and untwisting", names, &twist, Scales::Linear)?);
        let sideways = over_time(|s| 1e3 * s.bottom.x);
        let names = ["time (s)", "bottom sideways (mm)"];
        charts.push(lines("a-sideways", "Sideways motion", names, &sideways, Scales::Linear)?);
        charts.push(self.snake()?);
        charts.push(self.shapes()?);
        Ok(charts)
    }

    /// The axis of the block with hemicircular fibres at some times.
    fn snake(&self) -> Result<Chart> {
        let swing = self.of(Field::Hemicircular).first();
        let axis = swing.map_or(&[][..], |s| &s.axis);
        let series: Vec<Series> = (0..7)
            .filter_map(|i| Some((i, axis.get(5 * i + 4)?)))
            .map(|(i, x)| {
                let cell = 1e3 * SIZE.z / CELLS[2] as f64;
                let points = x.iter().enumerate().map(|(k, x)| [1e3 * x, cell * k as f64]);
                let name = format!("{:.2} s", STEP * (5 * i + 5) as f64);
                Series::new(name, points.collect(), i)
            })
            .collect();
        let names = ["sideways (mm)", "height at rest (mm)"];
        lines("a-snake", "The axis with hemicircular fibres", names, &series, Scales::Linear)
    }

    /// The first mesh of tetrahedra at rest.
    fn shapes(&self) -> Result<Chart> {
        let block = &self.blocks[0][1];
        let moved = |u: &[DVec3]| -> Vec<DVec3> {
            block.mesh.points.iter().zip(u).map(|(x, u)| *x + *u).collect()
        };
        let mut panels = Vec::new();
        let springs = (self.springs.get(1), "plain springs".to_string(), Field::None);
        let fields = Field::ALL.map(|f| (self.of(f).first(), format!("axes, {}", f.name()), f));
        for (swing, title, field) in std::iter::once(springs).chain(fields) {
            let Some(swing) = swing.filter(|s| !s.u.is_empty()) else { continue };
            let (points, fibres) = (moved(&swing.u), field.directions(&block.mesh)?);
            panels.push(Panel { title, mesh: &block.mesh, points, fibres });
        }
        let title = "The block at rest, pulled down, by the course of its fibres";
        Ok(bodies("a-shapes", title, &panels, 4))
    }
}

pub(crate) fn figure() -> Result<Figure> {
    let measured = measure()?;
    let mut rows = Vec::new();
    for (blocks, fields) in measured.blocks.iter().zip(&measured.fields) {
        for (field, swings) in fields {
            let swings = blocks.iter().zip(swings);
            rows.extend(swings.map(|(b, s)| ("axes, printed", field.name(), b, s.end)));
        }
    }
    for (field, shapes) in &measured.energy {
        let shapes = measured.blocks[0].iter().zip(shapes);
        rows.extend(shapes.map(|(b, s)| ("axes, with energy", field.name(), b, Some(*s))));
    }
    let springs = measured.blocks[0].iter().zip(&measured.springs);
    rows.extend(springs.map(|(b, s)| ("plain springs", "", b, s.end)));
    let table = table_of!("a-pulled", "The block pulled down, at rest"; for (body, fibres, block, s) in rows;
        "body" => body, "fibres" => fibres, "mesh" => block.name.clone(),
        "elongation mm" => s.map(|s| 1e3 * s.stretch()), "sideways x mm" => s.map(|s| 1e3 * s.bottom.x),
        "sideways y mm" => s.map(|s| 1e3 * s.bottom.y), "twist degrees" => s.map(|s| s.twist),
        "width x %" => s.map(|s| 100.0 * s.width[0]), "width y %" => s.map(|s| 100.0 * s.width[1]),
    )
    .note("sideways: mean of the bottom; width: of the middle, over that at rest; empty: did not come to rest.");
    let [coarse, fine] = [CELLS, FINE].map(|n| n.iter().product::<usize>());
    Ok(Figure {
        setting: format!(
            "A block of {} x {} x {} m hangs from its top; a traction of {TRACTION} Pa pulls at its bottom from the \
             start, without gravity. Axes alone, in the printed form: three in every element with the moduli of an isotropic \
             material (E = {} Pa, nu = {}), the one along the fibres of {FIBRE} Pa. Equal masses, Störmer's method, \
             steps of {STEP} s cut where stability asks for it, dampers of {VISCOSITY} Pa s along all axes (and beside \
             the radial springs of hexahedra); after {:.1} s mass damping of {BRAKE} 1/s brings the block to rest. Four \
             meshes: {coarse} hexahedra, and three of irregular tetrahedra (six per cell, cut at random, vertices moved \
             by {JITTER}); the same with {fine} cells, braked from the start. Plain springs: one per edge, in hexahedra \
             the 12 edges and 4 diagonals of the paper, of one constant, E times the size of a cell ({} N/m), at which \
             the edges of a regular grid of cubes have the modulus E along themselves. The form with an energy: \
             equilibria, for comparison. The paper prints no sizes, moduli or loads.",
            SIZE.x,
            SIZE.y,
            SIZE.z,
            MATERIAL.young_modulus,
            MATERIAL.poisson_ratio,
            STEP * SWING as f64,
            MATERIAL.young_modulus * SIZE.x / CELLS[0] as f64,
        ),
        findings: measured.findings(),
        tables: vec![table],
        charts: measured.charts()?,
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_points_and_sides() {
        let values = [0.0, 3.0, 10.0, 9.5, 10.0, 4.0, 4.2, 8.0, 7.9];
        assert_eq!(turns(&values, 1.0), [0.0, 10.0, 4.0, 8.0]);
        assert_eq!(turns(&values, 5.0), [0.0, 10.0, 4.0]);
        assert_eq!(turns(&[1.0, 1.1, 0.95], 1.0), [1.0]);
        assert_eq!(both_ways(&[-1.0, 0.5, 4.0], 4.0), 0.25);
        let bent = |x: &[f64]| Swing { axis: vec![x.to_vec()], ..Swing::default() };
        // an arc, and an S
        assert_eq!(bent(&[0.0, 1.0, 4.0, 9.0, 16.0]).undulation()[0], 0.0);
        assert_eq!(bent(&[0.0, 1.0, 0.0, -1.0, 0.0]).undulation()[0], 1.0);
    }

    #[test]
    fn fibres_move_the_block_as_they_should() {
        let block = blocks(CELLS).unwrap().swap_remove(1);
        let pull = |field| pulled(&block, field).unwrap();
        let plain = pull(Field::None);
        assert!(plain.drift() < 0.01 && plain.twist.abs() < 0.1, "{plain:?}");
        let diagonal = pull(Field::Diagonal);
        assert!(diagonal.bottom.x.abs() > 0.2 * diagonal.stretch(), "{diagonal:?}");
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
        let run = swing(&block, What::Fibres(Field::Helicoidal), 40).unwrap();
        assert_eq!(run.failed, None);
        assert!(run.shapes.len() == 40 && run.axis[0].len() == 5);
        let end = run.end.unwrap();
        assert!(end.twist.abs() > 1.0 && end.stretch() > 0.0, "{end:?}");
        let overshoot = run.shapes.iter().map(Shape::stretch).fold(0.0, f64::max);
        assert!(overshoot > 1.2 * end.stretch(), "{overshoot} beside {}", end.stretch());
    }
}
