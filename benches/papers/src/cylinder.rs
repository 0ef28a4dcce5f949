//! Delingette 2008, figure 2, right: a soft cylinder clamped at one end bends under its weight.

use super::drawing::{Panel, bodies};
use super::frame::{clamp, world};
use super::prelude::*;
use rayon::prelude::*;
use sinew::engine::mesh::generate::{box_tets, cylinder_tets};

const LENGTH: f64 = 0.1;
/// Radii over length: the paper prints no sizes, and its cylinder is called slender.
const RADII: [f64; 3] = [0.05, 0.1, 0.2];
/// Rings of the mesh, and layers times radius over length, which keeps the shape of elements.
const RINGS: usize = 2;
const LAYERS: f64 = 1.2;
/// From one that bends a little to one that collapses.
const YOUNG_MODULI: [f64; 8] = [2e5, 6e4, 1.5e4, 5e3, 2e3, 1.5e3, 1e3, 5e2];
const MODELS: [Model; 3] = [Model::StVK, Model::CompressibleStVK, Model::Corotational];
const POISSON_RATIO: f64 = 0.35;
/// Steps (s) and damping (1/s) on the way to rest, and when to give up.
const DT: f64 = 0.02;
const DAMPING: f64 = 10.0;
const MOST_STEPS: usize = 1000;

/// A cylinder that has come to rest, or not.
struct Rest {
    model: Model,
    young_modulus: f64,
    /// Radius over length.
    radius: f64,
    /// Fall of the middle of the tip over length.
    drop: f64,
    tetrahedra: usize,
    inverted: usize,
    smallest_ratio: f64,
    steps: usize,
    /// Kinetic over m g L at the end.
    kinetic: f64,
    /// The axis, over length.
    axis: Vec<[f64; 2]>,
    /// Where all vertices are (m).
    points: Vec<DVec3>,
}

impl Rest {
    /// The one criterion of collapse, that of the demo scene too: an element without volume or turned inside out.
    fn collapsed(&self) -> bool {
        self.inverted > 0
    }

    /// Angle (degrees) by which the axis points down at the tip. A cylinder that is only stretched has none.
    fn turn(&self) -> f64 {
        match self.axis[..] {
            [.., a, b] => (a[1] - b[1]).atan2(b[0] - a[0]).to_degrees(),
            _ => f64::NAN,
        }
    }
}

/// Bodies in words: of every slenderness the stiffnesses.
fn listed<'a>(bodies: impl Iterator<Item = &'a Rest> + Clone) -> String {
    let of = |radius: &f64| {
        let own: Vec<String> = bodies
            .clone()
            .filter(|r| r.radius == *radius)
            .map(|r| format!("{}", kilopascal(r)))
            .collect();
        (!own.is_empty()).then(|| format!("R/L {radius}: {} kPa", own.join(", ")))
    };
    let all: Vec<String> = RADII.iter().filter_map(of).collect();
    if all.is_empty() { "none".into() } else { all.join("; ") }
}

fn settle(mesh: &Mesh, radius: f64, model: Model, young_modulus: f64) -> Result<Rest> {
    let material = YoungPoisson { young_modulus, poisson_ratio: POISSON_RATIO, density: 1000.0 };
    let description = BodyDescription::new("cylinder", mesh, material);
    let integrator = Integrator::Safe;
    let solver = SolverSettings { integrator, mass_damping: DAMPING, ..Default::default() };
    let (mut simulation, body) = world(&BodyDescription { model, ..description }, solver)?;
    clamp(&mut simulation, body, mesh, "x0")?;
    simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    simulation.set_dt(DT);
    let scale = simulation.masses(body).iter().sum::<f64>() * 9.81 * LENGTH;
    let mut steps = 0;
    let mut kinetic = f64::INFINITY;
    while steps < MOST_STEPS && (kinetic > 1e-12 || steps < 50) {
        simulation.step()?;
        kinetic = simulation.report().kinetic_energy / scale;
        steps += 1;
    }
    let u = simulation.displacements(body);
    let ratios = simulation.volume_ratios(body);
    let mut axis: Vec<(f64, DVec3)> = mesh
        .points
        .iter()
        .zip(&u)
        .filter(|(x, _)| x.y.hypot(x.z) < 1e-6 * radius * LENGTH)
        .map(|(x, u)| (x.x, *x + *u))
        .collect();
    axis.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(Rest {
        model,
        young_modulus,
        radius,
        drop: axis.last().map_or(f64::NAN, |(_, x)| -x.z / LENGTH),
        tetrahedra: ratios.len(),
        inverted: ratios.iter().filter(|j| **j <= 0.0).count(),
        smallest_ratio: ratios.iter().copied().fold(f64::INFINITY, f64::min),
        steps,
        kinetic,
        axis: axis.iter().map(|(_, x)| [x.x / LENGTH, x.z / LENGTH]).collect(),
        points: mesh.points.iter().zip(&u).map(|(x, u)| *x + *u).collect(),
    })
}

fn kilopascal(rest: &Rest) -> f64 {
    rest.young_modulus / 1e3
}

/// By what factor the fall of one tip is much more than that of another.
const MUCH: f64 = 1.1;
/// Turn (degrees) of the tip that is a lot: half of what a cylinder that hangs down has.
const TURN: f64 = 45.0;

/// The three energies in one body.
struct Compared<'a> {
    svk: &'a Rest,
    comp: &'a Rest,
    corotational: &'a Rest,
}

impl Compared<'_> {
    /// How much further the corotational tip falls.
    fn further(&self) -> f64 {
        self.corotational.drop / self.comp.drop
    }

    /// The statements on figure 2: with the term none collapses, it bends a lot, a corotational one bends much more.
    fn holds(&self) -> [bool; 3] {
        [!self.comp.collapsed(), self.comp.turn() > TURN, self.further() > MUCH]
    }
}

/// A statement on one body that the paper does not determine, judged on all bodies that could be it.
fn on_bodies(bodies: &[&Compared], holds: fn(&Compared) -> bool, text: String) -> Finding {
    let named = |wanted: bool| listed(bodies.iter().filter(|b| holds(b) == wanted).map(|b| b.svk));
    let finding = if bodies.iter().all(|b| holds(b)) && !bodies.is_empty() {
        Finding::of(true)
    } else {
        let choices = format!(
            "stiffness and slenderness, which are not printed: it holds at {}, not at {}",
            named(true),
            named(false)
        );
        Finding::not_determined(bodies.iter().any(|b| holds(b)), choices)
    };
    finding.says(text)
}

fn findings(rests: &[Rest]) -> Vec<Finding> {
    let compared: Vec<Compared> = rests
        .chunks_exact(MODELS.len())
        .map(|r| Compared { svk: &r[0], comp: &r[1], corotational: &r[2] })
        .collect();
    // the paper shows a cylinder that collapses without the term
    let like: Vec<&Compared> = compared.iter().filter(|c| c.svk.collapsed()).collect();
    let radii: Vec<f64> =
        RADII.into_iter().filter(|r| rests.iter().any(|rest| rest.radius == *r)).collect();
    let everywhere = radii.iter().all(|r| like.iter().any(|c| c.svk.radius == *r));
    let names = |compared: &[&Compared]| listed(compared.iter().map(|c| c.svk));
    let list = |of: &dyn Fn(&Compared) -> String| {
        like.iter().map(|c| of(c)).collect::<Vec<_>>().join(", ")
    };
    let ends = |of: &dyn Fn(&Compared) -> f64| {
        let least = like.iter().map(|c| of(c)).fold(f64::INFINITY, f64::min);
        [least, like.iter().map(|c| of(c)).fold(f64::NEG_INFINITY, f64::max)]
    };
    let all: Vec<&Compared> =
        like.iter().copied().filter(|c| c.holds().iter().all(|h| *h)).collect();
    let mut findings = vec![
        Finding::of(everywhere).says(format!(
            "with St Venant-Kirchhoff alone tetrahedra collapse (J <= 0), at every slenderness if the body is soft enough: \
             {}",
            names(&like)
        )),
        on_bodies(
            &like,
            |c| c.holds()[0],
            format!(
                "with the compression term none does: the smallest J of these bodies are {}",
                list(&|c| format!("{:.3}", c.comp.smallest_ratio))
            ),
        ),
        on_bodies(
            &like,
            |c| c.holds()[1],
            {
                let [least, most] = ends(&|c| c.comp.turn());
                format!(
                    "the compressible cylinder bends a lot: its axis points down at the tip by {least:.0} to {most:.0} degrees \
                     (at least {TURN})"
                )
            },
        ),
        on_bodies(
            &like,
            |c| c.holds()[2],
            format!(
                "a corotational cylinder with the same moduli bends much more: its tip falls {} times as far (at least \
                 {MUCH})",
                list(&|c| format!("{:.3}", c.further()))
            ),
        ),
        Finding::of(!all.is_empty()).says(format!(
            "there is a cylinder that does all of what the figure shows: {}",
            names(&all)
        )),
    ];
    let stiffest = compared.iter().filter(|c| c.svk.young_modulus == YOUNG_MODULI[0]);
    let changes = stiffest.map(|c| (c.comp.drop / c.svk.drop - 1.0).abs());
    let change = changes.fold(0.0, |m: f64, x| if x.is_nan() { x } else { m.max(x) });
    findings.push(Finding::of(change < 0.01).says(format!(
        "where strains are small the term changes little: at E = {} kPa it changes the fall of the tip by {:.2} % at \
         most (1 % allowed)",
        YOUNG_MODULI[0] / 1e3,
        100.0 * change
    )));
    findings
}

/// Shears (tangent of the angle) at which materials are compared.
const SHEARS: [f64; 4] = [0.1, 0.2, 0.5, 1.0];

/// Shear stress over mu in simple shear, of St Venant-Kirchhoff and corotational, by the forces of a block.
fn sheared() -> Result<Vec<[f64; 3]>> {
    let side = 0.1;
    let mesh = box_tets(DVec3::splat(side), [2, 2, 2])?;
    let material =
        YoungPoisson { young_modulus: 1e4, poisson_ratio: POISSON_RATIO, density: 1000.0 };
    let mu = material.lame()?.mu;
    let stress = |model, shear: f64| -> Result<f64> {
        let body = BodyDescription { model, ..BodyDescription::new("block", &mesh, material) };
        let (mut simulation, body) = world(&body, SolverSettings::default())?;
        let u: Vec<DVec3> = mesh.points.iter().map(|x| DVec3::X * (shear * x.y)).collect();
        simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
        simulation.evaluate();
        // of a uniform state: the work of the forces in the shear over the volume
        let forces = simulation.elastic_forces(body);
        let work: f64 = forces.iter().zip(&mesh.points).map(|(f, x)| -f.x * x.y).sum();
        Ok(work / (side * side * side) / mu)
    };
    SHEARS
        .map(|g| Ok([g, stress(Model::StVK, g)?, stress(Model::Corotational, g)?]))
        .into_iter()
        .collect()
}

/// What the paper concludes from the bending of both: that one resists shear more.
fn shear_finding(rows: &[[f64; 3]]) -> Finding {
    let over_mu = 2.0 * POISSON_RATIO / (1.0 - 2.0 * POISSON_RATIO);
    let shown = rows.iter().all(|&[g, svk, corotational]| {
        let r = (1.0 + 0.25 * g * g).sqrt();
        let closed = [
            g + (0.5 * over_mu + 1.0) * g.powi(3),
            g * (2.0 - 1.0 / r) + over_mu * g * (1.0 - 1.0 / r),
        ];
        let off = (svk / closed[0] - 1.0).abs().max((corotational / closed[1] - 1.0).abs());
        off < 1e-9 && corotational < svk
    });
    let list: Vec<String> =
        rows.iter().map(|[g, svk, other]| format!("{:.3} at {g}", other / svk)).collect();
    Finding::paper_wrong(
        shown,
        "in simple shear g the stress of St Venant-Kirchhoff is mu g + (lambda/2 + mu) g^3, the corotational one mu g \
         (2 - 1/r) + lambda g (1 - 1/r) with r^2 = 1 + g^2/4; as 1 - 1/r < g^2/8, the latter is less at every g",
    )
    .says(format!(
        "corotational elasticity resists shear far more: in simple shear at nu = {POISSON_RATIO} its stress is {} of that \
         of St Venant-Kirchhoff, less, not more",
        list.join(", ")
    ))
}

fn mesh_of(radius: f64) -> Result<Mesh> {
    let layers = (LAYERS / radius).round() as usize;
    Ok(cylinder_tets(radius * LENGTH, LENGTH, RINGS, layers)?)
}

/// Stiffness (Pa) at which bodies are drawn.
const DRAWN: f64 = 1.5e3;

pub(crate) fn figure() -> Result<Figure> {
    let meshes = RADII.map(mesh_of).into_iter().collect::<Result<Vec<Mesh>, _>>()?;
    let mut runs = Vec::new();
    for (mesh, radius) in meshes.iter().zip(RADII) {
        for young_modulus in YOUNG_MODULI {
            runs.extend(MODELS.map(|model| (mesh, radius, model, young_modulus)));
        }
    }
    let rests: Vec<Rest> = runs
        .par_iter()
        .map(|&(mesh, radius, model, young_modulus)| settle(mesh, radius, model, young_modulus))
        .collect::<Result<_>>()?;
    let table = table_of!("b-cylinder", "Cylinder at rest under its weight"; for r in &rests;
        "R / L" => r.radius, "E Pa" => r.young_modulus, "model" => r.model.name(),
        "fall of the tip / L" => r.drop, "turn of the tip degrees" => r.turn(), "tetrahedra" => r.tetrahedra,
        "J <= 0" => r.inverted, "smallest J" => r.smallest_ratio, "steps" => r.steps,
        "kinetic / m g L" => r.kinetic,
    );
    let shears = sheared()?;
    let sheared = table_of!("b-shear", "Stress in simple shear over mu"; for [g, svk, corotational] in &shears;
        "shear" => *g, "StVK" => *svk, "corotational" => *corotational, "ratio" => corotational / svk,
    );
    // one slenderness, three stiffnesses: more curves cannot be told apart
    let drawn = |r: &&Rest| r.radius == RADII[1] && [6e4, 5e3, DRAWN].contains(&r.young_modulus);
    let mut series = Vec::new();
    for (colour, model) in MODELS.into_iter().enumerate() {
        series.extend(rests.iter().filter(|r| r.model == model).filter(drawn).map(|r| {
            let name = format!("{}, {} kPa", r.model.name(), kilopascal(r));
            Series::new(name, r.axis.clone(), colour).hollow(model == Model::StVK)
        }));
    }
    let title = format!("Axis of the cylinder at rest, R/L = {}", RADII[1]);
    let chart = lines("b-cylinder", &title, ["x / L", "z / L"], &series, Scales::Equal)?;
    let panels: Vec<Panel> = rests
        .iter()
        .filter(|r| r.young_modulus == DRAWN)
        .filter_map(|r| {
            let (mesh, _) = meshes.iter().zip(RADII).find(|m| m.1 == r.radius)?;
            let title = format!("{}, R/L {}", r.model.name(), r.radius);
            Some(Panel { title, mesh, points: r.points.clone(), fibres: Vec::new() })
        })
        .collect();
    let title = format!("Cylinders of {} kPa at rest under their weight", DRAWN / 1e3);
    let shapes = bodies("b-shapes", &title, &panels, MODELS.len());
    let mut findings = findings(&rests);
    findings.push(shear_finding(&shears));
    Ok(Figure {
        setting: format!(
            "Length {} mm, radius {} of it, meshes of {RINGS} rings with layers as thick as elements are wide, 1000 \
             kg/m^3, nu = {POISSON_RATIO}, clamped at x = 0; steps of {DT} s by the safe step, damped to rest. The paper \
             prints E = 1 and nu = 0.35 but no sizes, so stiffness and slenderness are varied; its statements are judged \
             on the bodies that collapse without the term, as its own does. Collapse: an element with J <= 0.",
            1e3 * LENGTH,
            RADII.map(|r| r.to_string()).join(", "),
        ),
        findings,
        tables: vec![table, sheared],
        charts: vec![chart, shapes],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::Verdict;

    #[test]
    fn findings_follow_from_a_short_cylinder() {
        let radius = RADII[0];
        let mesh = cylinder_tets(radius * LENGTH, LENGTH, 1, 14).unwrap();
        let mut rests = Vec::new();
        for young_modulus in [YOUNG_MODULI[0], 5e3] {
            for model in MODELS {
                rests.push(settle(&mesh, radius, model, young_modulus).unwrap());
            }
        }
        for r in &rests {
            assert!(r.kinetic < 1e-11, "{} at {} does not rest", r.model.name(), r.young_modulus);
            assert_eq!(r.axis.len(), 15);
        }
        let [stiff, soft] = [&rests[..3], &rests[3..]];
        // hardly strained, all laws are one
        for r in stiff {
            assert!((r.drop / stiff[0].drop - 1.0).abs() < 0.02 && !r.collapsed(), "{}", r.drop);
        }
        assert!(soft[0].collapsed() && !soft[1].collapsed(), "{}", soft[1].smallest_ratio);
        assert!(soft.iter().all(|r| r.drop > 1.5 * stiff[0].drop && r.turn() > stiff[0].turn()));
        let verdict =
            |rests: &[Rest]| findings(rests).iter().map(|f| f.verdict).collect::<Vec<_>>();
        use Verdict::{Agrees, Differs, NotDetermined};
        assert_eq!(verdict(&rests)[..2], [Agrees; 2]);
        // one that bends much more
        rests[5].drop = 2.0 * rests[4].drop;
        assert_eq!(verdict(&rests)[3], Agrees);
        // the only one like the paper's collapses
        rests[4].inverted = 3;
        assert_eq!((verdict(&rests)[1], verdict(&rests)[4]), (Differs, Differs));
        // the other one does collapse without the term, and not with it
        rests[0].inverted = 1;
        assert_eq!(verdict(&rests)[1], NotDetermined);
    }

    #[test]
    fn shear_is_resisted_as_the_closed_forms_say() {
        let mut rows = sheared().unwrap();
        let last = rows[rows.len() - 1];
        assert!((last[2] / last[1] - 0.427).abs() < 1e-3, "{last:?}");
        assert_eq!(shear_finding(&rows).verdict, Verdict::PaperWrong);
        rows[0][2] = 2.0 * rows[0][1];
        assert_eq!(shear_finding(&rows).verdict, Verdict::Differs);
    }
}
