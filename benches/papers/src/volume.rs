//! Bourguignon & Cani 2000, figures 3 and 5: what keeps the volume of a body on a table, and what a
//! cantilever needs; springs, masses and integrator are those of the paper.

use super::drawing::{Panel, bodies};
use super::frame::{
    as_stiff, clamp, damped_axes, equilibrium, settle, stormer, uniform, world, world_of_axes,
};
use super::prelude::*;
use crate::axes::springs::VolumeForm;
use rayon::prelude::*;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets, irregular_box_tets};
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::MassRule;

/// Side of the cube (m) and cells along it: the numbers of masses and tetrahedra of the paper's table 1.
const SIDE: f64 = 0.1;
const CELLS: [usize; 3] = [5, 5, 5];
/// Poisson's ratio and density (kg/m^3) of soft tissue; the paper prints no constants.
const POISSON_RATIO: f64 = 0.45;
const DENSITY: f64 = 1000.0;
/// Young's moduli (Pa) over which statements are judged: the body loses 20 % to 2 % of its height under its weight, from
/// what is about to collapse to what is hardly seen to yield.
const YOUNG_MODULI: [f64; 4] = [5e3, 1e4, 2e4, 5e4];
/// Factors on the constant of volume springs, at the softest of these.
const FACTORS: [f64; 3] = [1.0, 3.0, 10.0];
/// Place in [`YOUNG_MODULI`] of the body that is drawn, the one in the middle of the paper's.
const DRAWN: usize = 2;

/// The material of the cube.
fn material(young_modulus: f64) -> YoungPoisson {
    YoungPoisson { young_modulus, poisson_ratio: POISSON_RATIO, density: DENSITY }
}

/// Load of its own weight over its stiffness, the number that decides how far a body yields.
fn softness(young_modulus: f64) -> f64 {
    DENSITY * -GRAVITY.z * SIDE / young_modulus
}

/// Gravity (m/s^2), step (s), duration (s), viscosity (Pa s) of the dampers and mass damping (1/s, for plain springs
/// have no dampers) of the body that drops onto its table.
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, -9.81);
const STEP: f64 = 0.01;
const SECONDS: f64 = 1.5;
const VISCOSITY: f64 = 30.0;
const DAMPING: f64 = 4.0;

/// What the body is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Body {
    /// Axes and angles, no springs of volume.
    Without,
    /// Springs of one constant on edges.
    Springs,
    /// Springs of volume as printed.
    Printed,
    /// The same with the mean force taken out, so that they have an energy and no resultant.
    Balanced,
    /// The term `Lambda/2 (J-1)^2`.
    True,
}

impl Body {
    const ALL: [Self; 5] =
        [Self::Without, Self::Springs, Self::Printed, Self::Balanced, Self::True];

    fn name(self) -> &'static str {
        match self {
            Self::Without => "axes without volume",
            Self::Springs => "mass-spring",
            Self::Printed => "axes, printed volume springs",
            Self::Balanced => "axes, balanced volume springs",
            Self::True => "axes, (J-1)^2",
        }
    }

    /// In a world of its own: plain springs of a constant (N/m), volume springs with a factor on their constant.
    fn world(
        self,
        material: YoungPoisson,
        mesh: &Mesh,
        (constant, factor): (f64, f64),
        damping: f64,
    ) -> Result<(Simulation, BodyHandle)> {
        let (solver, masses) = (stormer(damping), MassRule::Equal);
        let body = BodyDescription { masses, ..BodyDescription::new("block", mesh, material) };
        let form = match self {
            Self::Springs => {
                let (model, springs) = (Model::MassSpring, uniform(constant));
                return world(&BodyDescription { model, springs, ..body }, solver);
            }
            Self::True => None,
            Self::Without | Self::Printed => Some(VolumeForm::Printed),
            Self::Balanced => Some(VolumeForm::Balanced),
        };
        let mut axes = damped_axes(material, VISCOSITY)?;
        axes.volume_modulus *= if self == Self::Without { 0.0 } else { factor };
        world_of_axes(body, axes, form, solver)
    }
}

fn tetrahedra() -> Result<Mesh> {
    Ok(irregular_box_tets(DVec3::splat(SIDE), CELLS, 0.15, 0)?)
}

/// What stands on the table.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Case {
    body: Body,
    hexahedra: bool,
    young_modulus: f64,
    /// On the constant of its volume springs.
    factor: f64,
}

/// Volume over that at rest, step by step, of a body let go on a table without friction; not a number from where a
/// step cannot be carried out. `constant` (N/m) is that of plain springs in a material of 1 Pa.
fn on_table(case: Case, mesh: &Mesh, constant: f64, steps: usize) -> Result<Vec<f64>> {
    let Case { body, young_modulus, factor, .. } = case;
    let constants = (constant * young_modulus, factor);
    let (mut simulation, handle) = body.world(material(young_modulus), mesh, constants, DAMPING)?;
    simulation.set_gravity(GRAVITY);
    simulation.set_dt(STEP);
    let floor = simulation.group_rows(handle, mesh, "z0")?;
    let mut floor = Constraint::hold("table", floor);
    floor.axes = FixedAxes(4);
    simulation.add_constraint(floor);
    let mut ratios = vec![1.0];
    for _ in 0..steps {
        let done = simulation.step().is_ok();
        let ratio = simulation.volume(handle) / (SIDE * SIDE * SIDE);
        ratios.push(if done { ratio } else { f64::NAN });
        if !done {
            break;
        }
    }
    Ok(ratios)
}

/// Length, thickness (m) and modulus (Pa) of the cantilever.
const LENGTH: f64 = 0.2;
const THICKNESS: f64 = 0.05;
const STIFF: YoungPoisson =
    YoungPoisson { young_modulus: 5e4, poisson_ratio: 0.3, density: 1000.0 };

/// Cells of the cantilever, and steps in which mass damping (1/s), critical for its bending, brings it to rest.
const BEAM: [usize; 3] = [12, 3, 3];
const SETTLING: usize = 200;
const BRAKE: f64 = 18.0;
/// A tip is at rest when it moves by less than this, over the sag, in the last 0.1 s.
const REST: f64 = 0.002;

/// A cantilever that has come to rest, or not.
struct Hung {
    /// Displacements (m).
    u: Vec<DVec3>,
    /// Sag (m) of the tip.
    sag: f64,
    smallest_ratio: f64,
    /// Whether its tip moves no more.
    still: bool,
}

impl Hung {
    /// At rest with no element turned inside out, the criterion of figure 2 of Delingette 2008 too.
    fn bears(&self) -> bool {
        self.still && self.smallest_ratio > 0.0
    }

    fn words(&self) -> String {
        let still = if self.still { "" } else { ", not at rest" };
        format!("{:.0} mm, smallest J {:.2}{still}", 1e3 * self.sag, self.smallest_ratio)
    }
}

/// Meshes of the cantilever: irregular ones, and cut alike, so that all diagonals are parallel.
const BEAMS: [&str; 2] = ["irregular", "parallel"];

fn beams() -> Result<[Mesh; 2]> {
    let size = DVec3::new(LENGTH, THICKNESS, THICKNESS);
    Ok([irregular_box_tets(size, BEAM, 0.15, 0)?, box_tets(size, BEAM)?])
}

/// A cantilever under a part of its weight: of the material in equilibrium, or of a body with plain springs of a constant
/// (N/m), let go and braked.
fn cantilever(mesh: &Mesh, body: Option<Body>, constant: f64, part: f64) -> Result<Hung> {
    let tip: Vec<usize> = (0..mesh.points.len()).filter(|&v| mesh.points[v].x == LENGTH).collect();
    let sag = |u: &[DVec3]| -tip.iter().map(|&v| u[v].z).sum::<f64>() / tip.len() as f64;
    let hung = |simulation: &mut Simulation, body, still| {
        let u = simulation.displacements(body);
        let ratios = simulation.volume_ratios(body);
        let smallest_ratio = ratios.into_iter().fold(f64::INFINITY, f64::min);
        Hung { sag: sag(&u), u, smallest_ratio, still }
    };
    let Some(made) = body else {
        // masses are part of the load, which is to be the same
        let (model, masses) = (Model::StVK, MassRule::Equal);
        let description = BodyDescription::new("block", mesh, STIFF);
        let description = BodyDescription { model, masses, ..description };
        let (mut simulation, body) = world(&description, equilibrium())?;
        clamp(&mut simulation, body, mesh, "x0")?;
        for step in 1..=4 {
            simulation.set_gravity(GRAVITY * (part * f64::from(step) / 4.0));
            settle(&mut simulation, 1, "cantilever")?;
        }
        return Ok(hung(&mut simulation, body, true));
    };
    let (mut simulation, body) = made.world(STIFF, mesh, (constant, 1.0), BRAKE)?;
    clamp(&mut simulation, body, mesh, "x0")?;
    simulation.set_gravity(GRAVITY * part);
    simulation.set_dt(STEP);
    let mut before = f64::NAN;
    for step in 0..SETTLING {
        if simulation.step().is_err() {
            return Ok(hung(&mut simulation, body, false));
        }
        // a tenth of a second before the end
        if step + 11 == SETTLING {
            before = sag(&simulation.displacements(body));
        }
    }
    let after = sag(&simulation.displacements(body));
    Ok(hung(&mut simulation, body, (after - before).abs() < REST * after.abs()))
}

/// Largest change of volume that the paper prints for bodies with volume springs.
const PRINTED: f64 = 0.015;

/// Not a number where the run failed.
fn largest(ratios: &[f64]) -> f64 {
    let changes = ratios.iter().map(|r| (r - 1.0).abs());
    changes.fold(0.0, |m: f64, x| if x.is_nan() || m.is_nan() { f64::NAN } else { m.max(x) })
}

/// All that stood on the table.
struct OnTable {
    runs: Vec<(Case, Vec<f64>)>,
    steps: usize,
}

impl OnTable {
    fn measure(steps: usize) -> Result<Self> {
        let meshes = [tetrahedra()?, box_hexahedra(DVec3::splat(SIDE), CELLS)?];
        // a constant is proportional to the modulus
        let unit = material(1.0);
        let constants =
            [as_stiff(&meshes[0], scaled(unit), "z0")?, as_stiff(&meshes[1], scaled(unit), "z0")?]
                .map(|k| k / SCALE);
        let mut cases = Vec::new();
        for young_modulus in YOUNG_MODULI {
            for hexahedra in [false, true] {
                let one = |body| Case { body, hexahedra, young_modulus, factor: 1.0 };
                cases.extend(Body::ALL.map(one));
            }
        }
        for factor in FACTORS.into_iter().skip(1) {
            let (body, young_modulus) = (Body::Printed, YOUNG_MODULI[0]);
            cases.push(Case { body, hexahedra: false, young_modulus, factor });
        }
        let run = |case: &Case| {
            let kind = usize::from(case.hexahedra);
            Ok((*case, on_table(*case, &meshes[kind], constants[kind], steps)?))
        };
        let runs: Result<_> = cases.par_iter().map(run).collect();
        Ok(Self { runs: runs?, steps })
    }

    fn ratios(&self, case: Case) -> &[f64] {
        self.runs.iter().find(|r| r.0 == case).map_or(&[], |r| &r.1)
    }

    /// Largest change of volume (%) over the moduli; not a number where a run failed.
    fn changes(&self, body: Body, hexahedra: bool) -> [f64; 4] {
        YOUNG_MODULI.map(|young_modulus| {
            let case = Case { body, hexahedra, young_modulus, factor: 1.0 };
            100.0 * largest(self.ratios(case))
        })
    }

    fn findings(&self) -> Vec<Finding> {
        let tetrahedra = |body| self.changes(body, false);
        let [without, springs, printed] =
            [Body::Without, Body::Springs, Body::Printed].map(tetrahedra);
        let order = [0, 1, 2, 3].map(|i| without[i] > springs[i] && springs[i] > printed[i]);
        let mut findings = vec![over_softness(
            order,
            format!(
                "without springs of volume axes lose most, plain springs as stiff under a small load less, with printed \
                 springs of volume least: {} beside {} beside {} % at rho g L/E of {}",
                listed(&without),
                listed(&springs),
                listed(&printed),
                softnesses()
            ),
        )];
        for body in [Body::Printed, Body::True] {
            for (hexahedra, mesh) in [(false, "tetrahedra"), (true, "hexahedra")] {
                let changes = self.changes(body, hexahedra);
                findings.push(over_softness(
                    changes.map(|c| c < 100.0 * PRINTED),
                    format!(
                        "{} in {mesh} change their volume by less than {:.1} %: by {} % at rho g L/E of {}",
                        body.name(),
                        100.0 * PRINTED,
                        listed(&changes),
                        softnesses()
                    ),
                ));
            }
        }
        let stiffer = FACTORS.map(|factor| {
            let (body, young_modulus) = (Body::Printed, YOUNG_MODULI[0]);
            let case = Case { body, hexahedra: false, young_modulus, factor };
            100.0 * largest(self.ratios(case))
        });
        let grows = stiffer.windows(2).all(|w| w[1] < w[0]);
        findings.push(Finding::of(grows && stiffer[2] < 100.0 * PRINTED).says(format!(
            "results depend on the parameters: with volume springs {} times as stiff as the moduli ask for the softest \
             body changes its volume by {} %, so that their constant alone decides",
            FACTORS.map(|f| f.to_string()).join(", "),
            listed(&stiffer)
        )));
        let done = YOUNG_MODULI.map(|young_modulus| {
            let case = Case { body: Body::Printed, hexahedra: true, young_modulus, factor: 1.0 };
            self.ratios(case).iter().skip(1).filter(|ratio| ratio.is_finite()).count()
        });
        findings.push(over_softness(
            done.map(|done| done == self.steps),
            format!(
                "hexahedra with the springs and dampers of volume as printed, which have a resultant and no energy, can be \
                 run: {} of {} steps were carried out at rho g L/E of {}, with dampers of {VISCOSITY} Pa s",
                done.map(|d| d.to_string()).join(", "),
                self.steps,
                softnesses()
            ),
        ));
        let balanced = tetrahedra(Body::Balanced);
        let alike = [0, 1, 2, 3].map(|i| (balanced[i] / printed[i] - 1.0).abs() < 0.5);
        findings.push(over_softness(
            alike,
            format!(
                "taking the mean force out of the printed springs of tetrahedra, which then have an energy, changes little: \
                 {} beside {} %",
                listed(&balanced),
                listed(&printed)
            ),
        ));
        findings
    }
}

/// Modulus (Pa) at which the constant of plain springs is found.
const SCALE: f64 = 1e4;

fn scaled(unit: YoungPoisson) -> YoungPoisson {
    YoungPoisson { young_modulus: SCALE * unit.young_modulus, ..unit }
}

fn listed(values: &[f64]) -> String {
    let all: Vec<String> =
        values.iter().map(|x| format!("{x:.2}").replace("NaN", "failed")).collect();
    all.join(", ")
}

fn softnesses() -> String {
    YOUNG_MODULI.map(|e| format!("{:.3}", softness(e))).join(", ")
}

/// A statement that hangs on how far the body yields, which is not printed: a verdict over the whole range.
fn over_softness(holds: [bool; 4], text: String) -> Finding {
    let all = holds.iter().all(|h| *h);
    let met: Vec<String> = YOUNG_MODULI
        .into_iter()
        .zip(holds)
        .filter(|(_, holds)| *holds)
        .map(|(e, _)| format!("{:.3}", softness(e)))
        .collect();
    let finding = if all {
        Finding::of(true)
    } else {
        let choices = match met.is_empty() {
            true => "rho g L/E from 0.02 to 0.2; none meets it".to_string(),
            false => format!("rho g L/E, which is not printed: it holds at {}", met.join(", ")),
        };
        Finding::not_determined(!met.is_empty(), choices)
    };
    finding.says(text)
}

/// A cantilever by four bodies on both meshes, and the constants of its plain springs.
struct Cantilevers {
    meshes: [Mesh; 2],
    /// The material, printed axes, plain springs, axes with an energy.
    all: [Vec<Hung>; 2],
    /// Printed axes under a hundredth of the weight, over the material.
    small: [f64; 2],
    constants: [f64; 2],
}

const NAMES: [&str; 4] = ["material", "printed axes", "plain springs", "axes with energy"];

impl Cantilevers {
    fn measure() -> Result<Self> {
        let meshes = beams()?;
        let constants = [as_stiff(&meshes[0], STIFF, "x0")?, as_stiff(&meshes[1], STIFF, "x0")?];
        let made = [None, Some(Body::Printed), Some(Body::Springs), Some(Body::True)];
        let hang = |i: usize| -> Result<Vec<Hung>> {
            made.par_iter().map(|b| cantilever(&meshes[i], *b, constants[i], 1.0)).collect()
        };
        let all = [hang(0)?, hang(1)?];
        let light = |i: usize| -> Result<f64> {
            let [own, material] = [Some(Body::Printed), None]
                .map(|body| cantilever(&meshes[i], body, constants[i], 0.01));
            Ok(own?.sag / material?.sag)
        };
        let small = [light(0)?, light(1)?];
        Ok(Self { meshes, all, small, constants })
    }

    fn findings(&self) -> Vec<Finding> {
        let of = |k: usize| [&self.all[0][k], &self.all[1][k]];
        let words = |k: usize| {
            let both = of(k).into_iter().zip(BEAMS);
            both.map(|(h, mesh)| format!("{} ({mesh})", h.words())).collect::<Vec<_>>().join(", ")
        };
        vec![
            Finding::of(of(1).iter().all(|h| h.bears())).says(format!(
                "axes as printed bear a cantilever: it comes to rest and no element is turned inside out; their tip sags by \
                 {}, that of the material by {}, of axes with an energy by {} (under a hundredth of the weight printed axes \
                 sag {:.2} and {:.2} times as far as the material)",
                words(1),
                words(0),
                words(3),
                self.small[0],
                self.small[1]
            )),
            Finding::of(of(2).iter().all(|h| !h.bears())).says(format!(
                "plain springs, as stiff as the material under a small load ({:.0} and {:.0} N/m), cannot sustain it: {}",
                self.constants[0],
                self.constants[1],
                words(2)
            )),
        ]
    }

    fn table(&self) -> Table {
        let rows = self.all.iter().zip(BEAMS).flat_map(|(all, mesh)| {
            all.iter().zip(NAMES).map(move |(hung, name)| (mesh, name, hung, all[0].sag))
        });
        table_of!("c-cantilever", "A cantilever under its weight"; for (mesh, name, hung, material) in rows;
            "mesh" => mesh, "body" => name, "sag mm" => 1e3 * hung.sag, "over StVK" => hung.sag / material,
            "smallest J" => hung.smallest_ratio, "at rest" => if hung.still { "yes" } else { "no" },
        )
    }

    /// Figure 1 c beside figure 5.
    fn chart(&self) -> Chart {
        let mut panels = Vec::new();
        for ((all, mesh), kind) in self.all.iter().zip(&self.meshes).zip(BEAMS) {
            for (hung, name) in all.iter().zip(NAMES) {
                let points = mesh.points.iter().zip(&hung.u).map(|(x, u)| *x + *u).collect();
                let title = format!("{name}, {kind}");
                panels.push(Panel { title, mesh, points, fibres: Vec::new() });
            }
        }
        bodies("c-cantilever", "A cantilever under its weight", &panels, NAMES.len())
    }
}

pub(crate) fn figure() -> Result<Figure> {
    let steps = (SECONDS / STEP).round() as usize;
    let table = OnTable::measure(steps)?;
    let volumes = table_of!("c-volume", "Volume on a table under gravity"; for (case, ratios) in &table.runs;
        "body" => case.body.name(), "mesh" => if case.hexahedra { "hexahedra" } else { "tetrahedra" },
        "E Pa" => case.young_modulus, "rho g L/E" => softness(case.young_modulus),
        "volume springs times" => case.factor, "largest change %" => 100.0 * largest(ratios),
        "at the end %" => ratios.last().map(|r| 100.0 * (r - 1.0)),
    );
    let series: Vec<Series> = Body::ALL
        .into_iter()
        .enumerate()
        .map(|(colour, body)| {
            let young_modulus = YOUNG_MODULI[DRAWN];
            let ratios = table.ratios(Case { body, hexahedra: false, young_modulus, factor: 1.0 });
            let points = ratios.iter().enumerate().map(|(i, r)| [STEP * i as f64, 100.0 * r]);
            Series::new(body.name(), points.collect(), colour)
        })
        .collect();
    let cantilevers = Cantilevers::measure()?;
    let mut findings = table.findings();
    findings.extend(cantilevers.findings());
    let axes = ["time (s)", "volume (% of that at rest)"];
    let title = format!("Volume on a table, rho g L/E = {:.3}", softness(YOUNG_MODULI[DRAWN]));
    let chart = lines("c-volume", &title, axes, &series, Scales::Linear)?;
    Ok(Figure {
        setting: format!(
            "A cube of {SIDE} m in 750 irregular tetrahedra (804 in the paper) or 125 hexahedra (as there) is let go \
             under gravity on a table without friction; nu = {POISSON_RATIO}, E = {} kPa, step {STEP} s cut where stability \
             asks for it, Störmer's method, equal masses, mass damping {DAMPING} 1/s. Axes along x, y, z with the moduli of \
             that material and dampers of {VISCOSITY} Pa s, in the printed form but for (J-1)^2; springs of volume with \
             constants that agree with its first Lamé parameter. Plain springs: one constant, found by a run in which the \
             body is as stiff as its material under a thousandth of its weight. The cantilever, after {SETTLING} steps with \
             mass damping of {BRAKE} 1/s, {LENGTH} x {THICKNESS} x {THICKNESS} m, has E = {} Pa and nu = {}; at rest: its tip \
             moves by less than {} % of its sag in the last 0.1 s. The paper prints neither constants nor sizes.",
            YOUNG_MODULI.map(|e| (e / 1e3).to_string()).join(", "),
            STIFF.young_modulus,
            STIFF.poisson_ratio,
            100.0 * REST
        ),
        findings,
        tables: vec![volumes, cantilevers.table()],
        charts: vec![chart, cantilevers.chart()],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::Verdict;

    #[test]
    fn volume_is_kept_by_the_true_term_and_lost_without() {
        let mesh = tetrahedra().unwrap();
        let change = |body| {
            let case = Case { body, hexahedra: false, young_modulus: 5e3, factor: 1.0 };
            largest(&on_table(case, &mesh, 0.0, 30).unwrap())
        };
        let (without, kept) = (change(Body::Without), change(Body::True));
        assert!(kept < PRINTED, "{kept}");
        assert!(without > 2.0 * kept, "{without} beside {kept}");
    }

    #[test]
    fn verdicts_over_softness_and_of_cantilevers() {
        let verdict = |holds| over_softness(holds, String::new()).verdict;
        assert_eq!(verdict([true; 4]), Verdict::Agrees);
        assert_eq!(verdict([false, false, true, true]), Verdict::NotDetermined);
        assert_eq!(verdict([false; 4]), Verdict::Differs);
        let hung = |smallest_ratio, still| Hung { u: Vec::new(), sag: 0.1, smallest_ratio, still };
        assert!(hung(0.1, true).bears());
        assert!(!hung(0.1, false).bears() && !hung(-0.1, true).bears() && !hung(0.0, true).bears());
    }
}
