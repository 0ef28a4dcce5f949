//! Bourguignon & Cani 2000, figures 1, 5 and 6: a block hangs from its top and is pulled down; fibres decide
//! where it goes. And what the authors left open: how stiff it is in directions between the axes.

use super::frame::{clamp, equilibrium, settle, world};
use crate::bench::error::BenchError;
use crate::bench::plot::{Scales, Series, lines};
use crate::report::{Figure, Finding};
use sinew::engine::mesh::generate::{box_hexahedra, irregular_box_tets};
use sinew::engine::vertex::FixedAxes;
use sinew::models::axes::description::{AxesDescription, AxisFamily};
use sinew::models::axes::field::{FibreError, helicoidal, hemicircular, random};
use sinew::prelude::*;
use sinew_tune::table_of;
use std::borrow::Cow;
use std::f64::consts::FRAC_PI_4;

/// Block (m) and its cells.
const SIZE: DVec3 = DVec3::new(0.08, 0.08, 0.16);
const CELLS: [usize; 3] = [4, 4, 8];
/// The same with cells of half the size.
const FINE: [usize; 3] = [8, 8, 16];
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
/// Modulus (Pa) of the fibres, five times that of the rest.
const FIBRE: f64 = 5e4;
/// Traction (Pa) on the bottom, and in how many parts it is applied.
const TRACTION: f64 = 1e3;
const PARTS: u32 = 2;
/// Jitter of the irregular meshes, of which these are taken.
const JITTER: f64 = 0.15;
const SEEDS: [u64; 3] = [0, 1, 2];

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

    fn directions(self, mesh: &Mesh) -> Result<Option<Vec<DVec3>>, FibreError> {
        let middle = 0.5 * SIZE;
        Ok(Some(match self {
            Self::None => return Ok(None),
            Self::Horizontal => vec![DVec3::X],
            Self::Diagonal => vec![(DVec3::X + DVec3::Z).normalize()],
            Self::Hemicircular => hemicircular(mesh, DVec3::Y, DVec3::X)?.directions,
            Self::Helicoidal => helicoidal(mesh, middle, DVec3::Z, FRAC_PI_4)?.directions,
            Self::Random => random(mesh, 1).directions,
        }))
    }
}

/// Meshes of the block: one of hexahedra, then irregular ones of tetrahedra.
fn meshes(cells: [usize; 3]) -> Result<Vec<(String, Mesh)>, BenchError> {
    let fine = if cells == FINE { ", fine" } else { "" };
    let mut meshes = vec![(format!("hexahedra{fine}"), box_hexahedra(SIZE, cells)?)];
    for seed in SEEDS {
        let mesh = irregular_box_tets(SIZE, cells, JITTER, seed)?;
        meshes.push((format!("tetrahedra {}{fine}", seed + 1), mesh));
    }
    Ok(meshes)
}

/// Isotropic axes with one family of fibres more.
fn axes(mesh: &Mesh, field: Field) -> Result<AxesDescription<'static>, BenchError> {
    let mut axes = AxesDescription::isotropic(MATERIAL.lame()?);
    let directions = field.directions(mesh).map_err(|e| BenchError::Request {
        what: format!("{} fibres: {e}", field.name()),
        remedy: "this is a defect of the engine, report it".into(),
    })?;
    if let Some(directions) = directions {
        let directions = Cow::Owned(directions);
        axes.families.push(AxisFamily { directions, ..AxisFamily::new("fibre", &[], FIBRE) });
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
    /// Elongation (m).
    fn stretch(&self) -> f64 {
        -self.bottom.z
    }

    /// Sideways motion over elongation.
    fn drift(&self) -> f64 {
        self.bottom.truncate().length() / self.stretch()
    }
}

fn pulled(
    (mesh, cells): (&Mesh, [usize; 3]),
    model: Model,
    axes: Option<AxesDescription>,
    case: &str,
) -> Result<Shape, BenchError> {
    let description = BodyDescription::new("block", mesh, MATERIAL);
    let description = BodyDescription { model, axes, ..description };
    let (mut simulation, body) = world(&description, equilibrium())?;
    clamp(&mut simulation, body, mesh, "z1")?;
    // the bottom is a regular grid on every mesh: traction goes to its vertices by their share of the area
    let (mut forces, cell) = (Vec::new(), SIZE / DVec3::from(cells.map(|n| n as f64)));
    let bottom: Vec<u32> =
        (0..mesh.points.len() as u32).filter(|&v| mesh.points[v as usize].z == 0.0).collect();
    for (&v, row) in bottom.iter().zip(simulation.rows(body, "bottom", &bottom)?) {
        let x = mesh.points[v as usize];
        let edge = |x: f64, size: f64| if x == 0.0 || x == size { 0.5 } else { 1.0 };
        let area = cell.x * cell.y * edge(x.x, SIZE.x) * edge(x.y, SIZE.y);
        forces.push((row, DVec3::new(0.0, 0.0, -TRACTION * area)));
    }
    let curve = Curve::ramp(0.0, f64::from(PARTS));
    simulation.add_load(Load { name: "pull".into(), forces, curve });
    settle(&mut simulation, PARTS, case)?;
    let u = simulation.displacements(body);
    let mean = bottom.iter().map(|&v| u[v as usize]).sum::<DVec3>() / bottom.len() as f64;
    // the rotation about the vertical that fits best
    let (mut sin, mut cos) = (0.0, 0.0);
    for &v in &bottom {
        let x = mesh.points[v as usize] - 0.5 * SIZE;
        let y = x + u[v as usize] - mean;
        sin += x.x * y.y - x.y * y.x;
        cos += x.x * y.x + x.y * y.y;
    }
    let width = [0, 1].map(|k| {
        let at = |side: f64| {
            let on = |v: &usize| {
                let x = mesh.points[*v];
                x[k] == side && (x.z - 0.5 * SIZE.z).abs() < 0.26 * cell.z
            };
            let (sum, count) = (0..mesh.points.len())
                .filter(on)
                .fold((0.0, 0.0), |(sum, n), v| (sum + mesh.points[v][k] + u[v][k], n + 1.0));
            sum / count
        };
        (at(SIZE[k]) - at(0.0)) / SIZE[k]
    });
    Ok(Shape { bottom: mean, twist: sin.atan2(cos).to_degrees(), width })
}

/// All fields on all meshes, then plain springs on all meshes.
struct Measured {
    names: Vec<String>,
    fields: Vec<(Field, Vec<Shape>)>,
    springs: Vec<Shape>,
    /// Names of the fine meshes, and the fields on them that are the same on every mesh.
    fine_names: Vec<String>,
    fine: Vec<(Field, Vec<Shape>)>,
}

fn measure() -> Result<Measured, BenchError> {
    let on = |cells: [usize; 3], meshes: &[(String, Mesh)], field: Field| {
        let shape = |(name, mesh): &(String, Mesh)| {
            let case = format!("{} fibres, {name}", field.name());
            pulled((mesh, cells), Model::Axes, Some(axes(mesh, field)?), &case)
        };
        let shapes: Result<Vec<Shape>, BenchError> = meshes.iter().map(shape).collect();
        Ok::<_, BenchError>((field, shapes?))
    };
    let coarse = meshes(CELLS)?;
    let fields: Result<_, BenchError> =
        Field::ALL.into_iter().map(|field| on(CELLS, &coarse, field)).collect();
    let mut springs = Vec::new();
    for (name, mesh) in &coarse {
        springs.push(pulled((mesh, CELLS), Model::MassSpring, None, &format!("springs, {name}"))?);
    }
    let fine_meshes = meshes(FINE)?;
    let same = Field::ALL.into_iter().filter(|f| *f != Field::Random);
    let fine: Result<_, BenchError> = same.map(|field| on(FINE, &fine_meshes, field)).collect();
    let names = |meshes: Vec<(String, Mesh)>| meshes.into_iter().map(|(name, _)| name).collect();
    Ok(Measured {
        names: names(coarse),
        fields: fields?,
        springs,
        fine_names: names(fine_meshes),
        fine: fine?,
    })
}

/// Largest difference of the place of the bottom between meshes, over the elongation.
fn parting(shapes: &[Shape]) -> f64 {
    let mut worst: f64 = 0.0;
    for a in shapes {
        for b in shapes {
            worst = worst.max(a.bottom.distance(b.bottom) / a.stretch());
        }
    }
    worst
}

/// Share by which meshes may differ.
const SAME: f64 = 0.03;

impl Measured {
    fn of(&self, field: Field) -> &[Shape] {
        self.fields.iter().find(|(f, _)| *f == field).map_or(&[], |(_, shapes)| shapes)
    }

    fn findings(&self) -> Vec<Finding> {
        let mean = |field: Field, of: fn(&Shape) -> f64| {
            let shapes = self.of(field);
            shapes.iter().map(of).sum::<f64>() / shapes.len() as f64
        };
        let most = |shapes: &[Shape]| shapes.iter().map(Shape::drift).fold(0.0, f64::max);
        let (axes, springs) = (most(self.of(Field::None)), most(&self.springs[1..]));
        let mut findings = vec![Finding::of(axes < 0.01 && springs > 2.0 * axes).says(format!(
                "axes without fibres hardly leave the vertical on irregular meshes: sideways motion is at most \
                 {:.2} % of the elongation; that of plain springs on the same meshes {:.2} %",
                100.0 * axes,
                100.0 * springs
            ))];
        let plain = Field::None;
        let [level, others] = [
            mean(Field::Horizontal, Shape::stretch),
            mean(Field::Diagonal, Shape::stretch).max(mean(Field::Helicoidal, Shape::stretch)),
        ];
        let across = mean(Field::Horizontal, |s| s.width[1]);
        findings.push(Finding::of(level > others && across < 1.0).says(format!(
                "horizontal fibres leave the block to become thinner and longer: its elongation is {:.1} mm, beside \
                 {:.1} mm at most with diagonal and helicoidal ones and {:.1} mm without; its width across them is \
                 {:.1} % of that at rest, along them {:.1} %",
                1e3 * level,
                1e3 * others,
                1e3 * mean(plain, Shape::stretch),
                100.0 * across,
                100.0 * mean(Field::Horizontal, |s| s.width[0]),
            )));
        let diagonal = mean(Field::Diagonal, Shape::drift);
        findings.push(Finding::of(diagonal > 0.2).says(format!(
                "diagonal fibres bend the block to one side: sideways motion of {:.0} % of the elongation",
                100.0 * diagonal
            )));
        let hemi = mean(Field::Hemicircular, |s| s.bottom.x / s.stretch());
        findings.push(Finding::of(hemi.abs() > 0.02).says(format!(
                "hemicircular fibres bend it to and fro: what is left of it at the bottom is {:.1} % of the \
                 elongation",
                100.0 * hemi
            )));
        let (twist, plain_twist) =
            (mean(Field::Helicoidal, |s| s.twist.abs()), mean(plain, |s| s.twist.abs()));
        findings.push(Finding::of(twist > 1.0 && plain_twist < 0.1 * twist).says(format!(
                "helicoidal fibres twist it: the bottom turns by {twist:.1} degrees ({plain_twist:.2} without fibres)"
            )));
        let chance = most(self.of(Field::Random));
        findings.push(Finding::of(chance < 0.1).says(format!(
                "random fibres leave it isotropic: sideways motion of {:.1} % of the elongation at most; every element \
                 has one direction, and chance does not cancel out over {} cells",
                100.0 * chance,
                CELLS.iter().product::<usize>()
            )));
        for (field, fine) in &self.fine {
            let [coarse, fine] = [parting(self.of(*field)), parting(fine)];
            findings.push(Finding::of(fine < SAME && fine < coarse).says(format!(
                    "{}: the bottom goes to the same place on meshes of tetrahedra and hexahedra, within {:.1} % of \
                     the elongation with {} cells and {:.1} % with {} ({:.0} % allowed for these)",
                    if *field == Field::None {
                        "without fibres".to_string()
                    } else {
                        format!("{} fibres", field.name())
                    },
                    100.0 * coarse,
                    CELLS.iter().product::<usize>(),
                    100.0 * fine,
                    FINE.iter().product::<usize>(),
                    100.0 * SAME
                )));
        }
        findings
    }
}

pub(super) fn figure() -> Result<Figure, BenchError> {
    let measured = measure()?;
    let rows = |fields: &[(Field, Vec<Shape>)], names: &[String]| -> Vec<_> {
        let on = |(field, shapes): &(Field, Vec<Shape>)| {
            let row = |(name, s): (&String, &Shape)| ("axes", field.name(), name.clone(), *s);
            names.iter().zip(shapes).map(row).collect::<Vec<_>>()
        };
        fields.iter().flat_map(on).collect()
    };
    let mut all = rows(&measured.fields, &measured.names);
    all.extend(rows(&measured.fine, &measured.fine_names));
    let springs = measured.names.iter().zip(&measured.springs);
    all.extend(springs.map(|(name, s)| ("springs", "", name.clone(), *s)));
    let table = table_of!("a-pulled", "The block pulled down"; for (body, fibres, mesh, s) in all;
        "body" => body, "fibres" => fibres, "mesh" => mesh, "elongation mm" => 1e3 * s.stretch(),
        "sideways x mm" => 1e3 * s.bottom.x, "sideways y mm" => 1e3 * s.bottom.y,
        "twist degrees" => s.twist, "width x %" => 100.0 * s.width[0], "width y %" => 100.0 * s.width[1],
    )
    .note("sideways: mean of the bottom; width: of the middle, over that at rest.");
    let mut series: Vec<Series> = measured
        .fields
        .iter()
        .enumerate()
        .map(|(colour, (field, shapes))| {
            Series::new(
                field.name(),
                shapes.iter().map(|s| [1e3 * s.bottom.x, 1e3 * s.bottom.z]).collect(),
                colour,
            )
        })
        .collect();
    series.push(
        Series::new(
            "plain springs",
            measured.springs.iter().map(|s| [1e3 * s.bottom.x, 1e3 * s.bottom.z]).collect(),
            Field::ALL.len(),
        )
        .hollow(true),
    );
    let title = "Where the bottom goes, on four meshes";
    let chart =
        lines("a-pulled", title, ["sideways (mm)", "down (mm)"], &series, Scales::Scattered)?;
    Ok(Figure {
        setting: format!(
            "A block of {} x {} x {} m hangs from its top; a traction of {TRACTION} Pa pulls at its bottom; converged \
             equilibria without gravity. Axes alone: those of an isotropic material (E = {} Pa, nu = {}) along x, y, z \
             and fibres of {FIBRE} Pa. Four meshes: {} hexahedra, and three of irregular tetrahedra (six per cell, \
             cut at random, vertices moved by {JITTER}), and the same with cells of half the size. Plain springs: on the edges, with the constants of \
             Delingette 2008 for tetrahedra and of the Frobenius fit for hexahedra. The paper prints no sizes, moduli or loads.",
            SIZE.x,
            SIZE.y,
            SIZE.z,
            MATERIAL.young_modulus,
            MATERIAL.poisson_ratio,
            CELLS.iter().product::<usize>(),
        ),
        findings: measured.findings(),
        tables: vec![table],
        charts: vec![chart],
        ..Figure::default()
    })
}

/// Angles (degrees) between fibres and pull.
const ANGLES: [f64; 7] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0];

/// Young's modulus (Pa) of an isotropic material with fibres in a direction at `angle` (rad) to them, in
/// closed form: `1/E = s11 sin^4 + s33 cos^4 + (2 s13 + 1/mu) sin^2 cos^2` with the compliances of the
/// stiffness whose component along the fibres is larger by their modulus.
fn closed_form(angle: f64) -> Result<f64, BenchError> {
    let lame = MATERIAL.lame()?;
    let (a, b) = (lame.lambda + 2.0 * lame.mu, lame.lambda);
    let c33 = a + FIBRE;
    // the part with equal strains across is 2 x 2
    let determinant = c33 * (a + b) - 2.0 * b * b;
    let (s33, s13) = ((a + b) / determinant, -b / determinant);
    // strains of a unit stress across: across, across the other way, along
    let sum = c33 / determinant;
    let s11 = 0.5 * (sum + 1.0 / (a - b));
    let (sin, cos) = (angle.sin().powi(2), angle.cos().powi(2));
    Ok(1.0 / (s11 * sin * sin + s33 * cos * cos + (2.0 * s13 + 1.0 / lame.mu) * sin * cos))
}

/// The same by a small pull on one hexahedron.
fn pulled_cube(angle: f64) -> Result<f64, BenchError> {
    const SIDE: f64 = 0.01;
    const STRAIN: f64 = 1e-5;
    let mesh = box_hexahedra(DVec3::splat(SIDE), [1, 1, 1])?;
    let mut axes = AxesDescription::isotropic(MATERIAL.lame()?);
    let directions = Cow::Owned(vec![DVec3::new(angle.sin(), 0.0, angle.cos())]);
    axes.families.push(AxisFamily { directions, ..AxisFamily::new("fibre", &[], FIBRE) });
    let (axes, description) = (Some(axes), BodyDescription::new("block", &mesh, MATERIAL));
    let description = BodyDescription { model: Model::Axes, axes, ..description };
    let (mut simulation, body) = world(&description, equilibrium())?;
    let mut hold = |vertices: &[u32], axes: u8| -> Result<(), BenchError> {
        let rows = simulation.rows(body, "held", vertices)?;
        let mut constraint = Constraint::hold("held", rows);
        constraint.axes = FixedAxes(axes);
        simulation.add_constraint(constraint);
        Ok(())
    };
    // the bottom stays level; one corner stays, another along x
    let on = |test: &dyn Fn(DVec3) -> bool| -> Vec<u32> {
        (0..8).filter(|&v| test(mesh.points[v as usize])).collect()
    };
    hold(&on(&|p| p.z == 0.0), 4)?;
    hold(&on(&|p| p == DVec3::ZERO), 7)?;
    hold(&on(&|p| p == DVec3::X * SIDE), 6)?;
    let top = on(&|p| p.z == SIDE);
    let force = MATERIAL.young_modulus * STRAIN * SIDE * SIDE;
    let rows = simulation.rows(body, "top", &top)?;
    let forces = rows.iter().map(|&row| (row, DVec3::Z * (force / 4.0))).collect();
    simulation.add_load(Load { name: "pull".into(), forces, curve: Curve::Constant });
    settle(&mut simulation, 1, &format!("cube, {:.0} degrees", angle.to_degrees()))?;
    let u = simulation.displacements(body);
    let rise = top.iter().map(|&v| u[v as usize].z).sum::<f64>() / 4.0;
    Ok(force / (SIDE * SIDE) / (rise / SIDE))
}

/// Stiffness between the axes.
pub(super) fn between() -> Result<Figure, BenchError> {
    let mut rows = Vec::new();
    for angle in ANGLES {
        let (found, exact) = (pulled_cube(angle.to_radians())?, closed_form(angle.to_radians())?);
        rows.push((angle, found, exact, 100.0 * (found / exact - 1.0)));
    }
    let title = "Young's modulus in a direction at an angle to the fibres";
    let table = table_of!("b-between", title; for &(angle, found, exact, off) in &rows;
        "angle degrees" => angle, "engine Pa" => found, "closed form Pa" => exact, "off by %" => off,
    );
    let worst = rows.iter().fold(0.0, |worst: f64, r| worst.max(r.3.abs()));
    let found = rows.iter().map(|r| [r.0, r.1]).collect();
    let exact: Vec<[f64; 2]> = rows.iter().map(|r| [r.0, r.2]).collect();
    let modulus = |i: usize| exact.get(i).map_or(f64::NAN, |p| p[1]);
    let text = format!(
        "what the paper leaves open, stiffness in directions between the axes, follows from the moduli: the \
         pull of one element is within {worst:.2} % of the closed form at every angle; it falls from {:.1} kPa \
         along the fibres to {:.1} kPa at 45 degrees and is {:.1} kPa across them",
        modulus(0) / 1e3,
        modulus(3) / 1e3,
        modulus(6) / 1e3
    );
    let findings = vec![Finding::of(worst < 0.1).says(text)];
    let series = [("engine", found, false, 0), ("closed form", exact, true, 1)]
        .map(|(name, points, hollow, colour)| Series::new(name, points, colour).hollow(hollow));
    let title = "Young's modulus between the axes";
    let names = ["angle to the fibres (degrees)", "Young's modulus (Pa)"];
    let chart = lines("b-between", title, names, &series, Scales::Linear)?;
    Ok(Figure {
        setting: format!(
            "One hexahedron of isotropic axes (E = {} Pa, nu = {}) and fibres of {FIBRE} Pa, pulled by a strain of \
             about 1e-5 at an angle to the fibres, its sides free.",
            MATERIAL.young_modulus, MATERIAL.poisson_ratio
        ),
        findings,
        tables: vec![table],
        charts: vec![chart],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffness_between_the_axes_is_that_of_the_closed_form() {
        for angle in [0.0, 0.3, 0.9, 1.5] {
            let (found, exact) = (pulled_cube(angle).unwrap(), closed_form(angle).unwrap());
            assert!((found / exact - 1.0).abs() < 1e-3, "{angle}: {found} beside {exact}");
        }
        let along = closed_form(0.0).unwrap();
        // all that fibres along the pull do is to bear their share
        assert!((along / (MATERIAL.young_modulus + FIBRE) - 1.0).abs() < 1e-12, "{along}");
    }

    #[test]
    fn fibres_move_the_block_as_they_should() {
        let (_, mesh) = meshes(CELLS).unwrap().swap_remove(1);
        let pull = |field| {
            pulled((&mesh, CELLS), Model::Axes, Some(axes(&mesh, field).unwrap()), "test").unwrap()
        };
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
}
