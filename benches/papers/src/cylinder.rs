//! Delingette 2008, figure 2, right: a soft cylinder clamped at one end bends under its weight.

use super::frame::{clamp, world};
use super::prelude::*;
use sinew::engine::mesh::generate::cylinder_tets;

const RADIUS: f64 = 0.005;
const LENGTH: f64 = 0.1;
/// From one that bends a little to one that collapses; the paper gives no sizes, so the verdicts are those of
/// the whole range.
const YOUNG_MODULI: [f64; 8] = [2e5, 6e4, 1.5e4, 5e3, 2e3, 1.5e3, 1e3, 5e2];
const MODELS: [Model; 3] = [Model::StVK, Model::CompressibleStVK, Model::Corotational];
/// Steps (s) and damping (1/s) on the way to rest, and when to give up.
const DT: f64 = 0.02;
const DAMPING: f64 = 10.0;
const MOST_STEPS: usize = 1000;

/// A cylinder that has come to rest, or not.
struct Rest {
    model: Model,
    young_modulus: f64,
    /// Fall of the middle of the tip over length.
    drop: f64,
    tetrahedra: usize,
    inverted: usize,
    /// Tetrahedra below a tenth of their volume.
    crushed: usize,
    smallest_ratio: f64,
    steps: usize,
    /// Kinetic over m g L at the end.
    kinetic: f64,
    /// The axis, over length.
    axis: Vec<[f64; 2]>,
}

fn settle(mesh: &Mesh, model: Model, young_modulus: f64) -> Result<Rest> {
    let material = YoungPoisson { young_modulus, poisson_ratio: 0.35, density: 1000.0 };
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
        .filter(|(x, _)| x.y.hypot(x.z) < 1e-6 * RADIUS)
        .map(|(x, u)| (x.x, *x + *u))
        .collect();
    axis.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(Rest {
        model,
        young_modulus,
        drop: axis.last().map_or(f64::NAN, |(_, x)| -x.z / LENGTH),
        tetrahedra: ratios.len(),
        inverted: ratios.iter().filter(|j| **j <= 0.0).count(),
        crushed: ratios.iter().filter(|j| **j < 0.1).count(),
        smallest_ratio: ratios.iter().copied().fold(f64::INFINITY, f64::min),
        steps,
        kinetic,
        axis: axis.iter().map(|(_, x)| [x.x / LENGTH, x.z / LENGTH]).collect(),
    })
}

fn kilopascal(rest: &Rest) -> f64 {
    rest.young_modulus / 1e3
}

/// By what factor the fall of one tip is much more than that of another.
const MUCH: f64 = 1.1;

fn findings(rests: &[Rest]) -> Vec<Finding> {
    let of = |model: Model| rests.iter().filter(move |r| r.model == model);
    let softest = |model: Model| of(model).next_back();
    let mut findings = Vec::new();
    if let (Some(svk), Some(comp)) = (softest(Model::StVK), softest(Model::CompressibleStVK)) {
        let e = svk.young_modulus / 1e3;
        findings.push(Finding::of(svk.crushed > 0).says(format!(
            "with St Venant-Kirchhoff alone tetrahedra collapse: at E = {e} kPa {} of {} end below \
             a tenth of their volume, {} of them inverted",
            svk.crushed, svk.tetrahedra, svk.inverted
        )));
        let comps = || of(Model::CompressibleStVK);
        let worst = comps().map(|r| r.smallest_ratio).fold(f64::INFINITY, f64::min);
        let none = comps().take_while(|r| r.crushed == 0).last().map_or(f64::NAN, kilopascal);
        findings.push(Finding::of(comps().all(|r| r.crushed == 0)).says(format!(
            "with the compression term none does: down to E = {none} kPa all keep a tenth of their volume; over the \
             whole range, down to {e} kPa, the smallest volume ratio is {worst:.3}"
        )));
        findings.push(Finding::of(comp.drop > 0.5).says(format!(
            "the compressible cylinder bends a lot: its tip falls {:.2} of its length",
            comp.drop
        )));
    }
    let pairs = of(Model::CompressibleStVK).zip(of(Model::Corotational));
    let over: Vec<(&Rest, f64)> =
        pairs.map(|(comp, other)| (comp, other.drop / comp.drop)).collect();
    if !over.is_empty() {
        // where the body under comparison is not crushed itself
        let sound = over.iter().filter(|(comp, _)| comp.crushed == 0);
        let most = sound.map(|(_, ratio)| *ratio).fold(0.0, f64::max);
        let list: Vec<String> = over
            .iter()
            .map(|(comp, ratio)| {
                format!("{} kPa {ratio:.3} / {:.3}", kilopascal(comp), comp.smallest_ratio)
            })
            .collect();
        findings.push(Finding::of(most > MUCH).says(format!(
            "a corotational cylinder with the same moduli bends much more ({MUCH} times): its tip falls {most:.3} times \
             as far at most where the compressible one keeps a tenth of its volume everywhere (factor and smallest \
             volume ratio of the compressible one: {})",
            list.join(", ")
        )));
    }
    let stiffest: Vec<f64> =
        rests.iter().filter(|r| r.young_modulus == YOUNG_MODULI[0]).map(|r| r.drop).collect();
    if let [svk, comp, ..] = stiffest[..] {
        findings.push(Finding::of((svk / comp - 1.0).abs() < 0.01).says(format!(
                "where strains are small the term changes little: at E = {} kPa the tip falls {svk:.4} of the \
                 length without it and {comp:.4} with it",
                YOUNG_MODULI[0] / 1e3
            )));
    }
    findings
}

pub(crate) fn figure() -> Result<Figure> {
    let mesh = cylinder_tets(RADIUS, LENGTH, 2, 24)?;
    let mut rests = Vec::new();
    for young_modulus in YOUNG_MODULI {
        for model in MODELS {
            rests.push(settle(&mesh, model, young_modulus)?);
        }
    }
    let table = table_of!("b-cylinder", "Cylinder at rest under its weight"; for r in &rests;
        "E Pa" => r.young_modulus, "model" => r.model.name(), "fall of the tip / L" => r.drop,
        "inverted" => r.inverted, "below a tenth of their volume" => r.crushed,
        "smallest J" => r.smallest_ratio, "steps" => r.steps, "kinetic / m g L" => r.kinetic,
    );
    let of = |model: Model| rests.iter().filter(move |r| r.model == model);
    // thin lines over thick ones: where they lie on each other both are seen
    let mut series = Vec::new();
    for (colour, model) in
        [Model::CompressibleStVK, Model::Corotational, Model::StVK].into_iter().enumerate()
    {
        series.extend(of(model).map(|r| {
            Series::new(r.model.name(), r.axis.clone(), colour)
                .hollow(model != Model::CompressibleStVK)
        }));
    }
    let moduli = YOUNG_MODULI.map(|e| format!("{}", e / 1e3)).join(", ");
    let title = format!("Axis of the cylinder at rest, E from right to left {moduli} kPa");
    let chart = lines("b-cylinder", &title, ["x / L", "z / L"], &series, Scales::Equal)?;
    Ok(Figure {
        setting: format!(
            "Radius {} mm, length {} mm, {} tetrahedra, 1000 kg/m^3, nu = 0.35, clamped at x = 0; steps of \
             {DT} s by the safe step, damped to rest. The paper prints E = 1 and nu = 0.35 but no sizes, so the \
             stiffness is varied.",
            1e3 * RADIUS,
            1e3 * LENGTH,
            mesh.tetrahedra.len()
        ),
        findings: findings(&rests),
        tables: vec![table],
        charts: vec![chart],
        ..Figure::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_follow_from_a_short_cylinder() {
        let mesh = cylinder_tets(RADIUS, LENGTH, 1, 14).unwrap();
        let mut rests = Vec::new();
        for young_modulus in [2e5, 5e3] {
            for model in MODELS {
                rests.push(settle(&mesh, model, young_modulus).unwrap());
            }
        }
        for r in &rests {
            assert!(r.kinetic < 1e-11, "{} at {} does not rest", r.model.name(), r.young_modulus);
            assert_eq!(r.axis.len(), 15);
        }
        let [stiff, soft] = [&rests[..3], &rests[3..]];
        // hardly strained, all laws are one
        for r in stiff {
            assert!((r.drop / stiff[0].drop - 1.0).abs() < 0.02 && r.crushed == 0, "{}", r.drop);
        }
        assert!(soft[0].inverted > 0 && soft[1].crushed == 0, "{}", soft[1].smallest_ratio);
        assert!(soft.iter().all(|r| r.drop > 1.5 * stiff[0].drop));
        let verdict =
            |rests: &[Rest]| findings(rests).iter().map(|f| f.agrees()).collect::<Vec<_>>();
        assert_eq!(verdict(&rests)[..3], [true; 3]);
        // one that bends much more, and one that collapses
        rests[5].drop = 2.0;
        assert_eq!(verdict(&rests)[1..4], [true; 3]);
        rests[4].crushed = 3;
        assert_eq!(verdict(&rests)[1..4], [false, true, false]);
    }
}
