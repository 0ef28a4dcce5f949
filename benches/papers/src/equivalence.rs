//! Delingette 2008, its title result and what section 2.3 says of the constants: the springs are St Venant-Kirchhoff
//! elasticity, stiffer in extension and softer in compression than quadratic ones, and on equilateral
//! triangles nothing but edges at a Poisson's ratio of 1/3. And what it leaves to future work (section 5): that
//! anisotropic elasticity fits the same springs.

use super::frame::world;
use super::prelude::*;
use glam::{DMat2, DMat3, DVec2};
use sinew::engine::law::ElasticEnergy;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::models::axes::description::{AxesDescription, AxisFamily, FibreForm};
use sinew::models::body::Evaluation;
use sinew::models::body::sheet::{MembraneDescription, MembraneModel};
use sinew::models::element::membrane::{RestTriangle, SpringConstants, plane_stress};
use sinew::models::laws::LAWS;
use sinew::models::material::LameParameters;
use sinew_benches::bench::membranes::sheet;

/// Ordinary constants: the paper prints none for these statements.
const MATERIAL: YoungPoisson =
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
const THICKNESS: f64 = 1e-3;
/// Modulus (Pa) of the fibres of an anisotropic body, five times the material's, and their direction, in the plane of sheets.
const FIBRE: f64 = 5e4;
const ALONG: DVec3 = DVec3::new(0.8, 0.6, 0.0);
/// Rounding of sums over some thousand springs in `f64`.
const EQUAL: f64 = 1e-10;
/// Stretches at which the laws are compared.
const STRETCHES: [f64; 8] = [0.7, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.3];

/// Which elements.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Tetrahedra,
    Triangles,
}

/// The springs of the paper or, for comparison, quadratic ones.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    Pooled,
    Fused,
    Quadratic,
    /// Pooled, with the springs of fibres added.
    PooledFibres,
    /// Fused, with the fibres as a law of their own.
    FusedFibres,
}

impl Law {
    const ALL: [Self; 5] =
        [Self::Pooled, Self::Fused, Self::Quadratic, Self::PooledFibres, Self::FusedFibres];

    /// Modulus (Pa) of its fibres.
    fn fibre(self) -> f64 {
        if matches!(self, Self::PooledFibres | Self::FusedFibres) { FIBRE } else { 0.0 }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Pooled => "pooled",
            Self::Fused => "fused",
            Self::Quadratic => "quadratic",
            Self::PooledFibres => "pooled, with fibres",
            Self::FusedFibres => "fused, with fibres",
        }
    }
}

impl Kind {
    const ALL: [Self; 2] = [Self::Tetrahedra, Self::Triangles];

    fn name(self) -> &'static str {
        if self == Self::Tetrahedra { "tetrahedra" } else { "triangles" }
    }

    /// An irregular block or sheet.
    fn mesh(self) -> Result<Mesh> {
        match self {
            Self::Tetrahedra => {
                Ok(jitter_interior(&box_tets(DVec3::splat(0.1), [5, 5, 5])?, 0.2, 1)?)
            }
            Self::Triangles => sheet(700),
        }
    }

    fn simulate(self, mesh: &Mesh, law: Law) -> Result<(Simulation, BodyHandle)> {
        let pooled = matches!(law, Law::Pooled | Law::PooledFibres);
        let evaluation = if pooled { Evaluation::Pooled } else { Evaluation::Fused };
        let springs = law == Law::Quadratic;
        let body = BodyDescription::new("body", mesh, MATERIAL);
        let family = AxisFamily::new("fibres", &[ALONG], law.fibre());
        let families = vec![AxisFamily { form: FibreForm::Biquadratic, ..family }];
        let families = if law.fibre() > 0.0 { families } else { Vec::new() };
        let body = match self {
            Self::Tetrahedra => BodyDescription {
                evaluation,
                model: if springs { Model::QuadraticSprings } else { Model::StVK },
                axes: (!families.is_empty())
                    .then(|| AxesDescription { families, ..AxesDescription::default() }),
                ..body
            },
            Self::Triangles => {
                let model = match springs {
                    true => MembraneModel::Quadratic,
                    false => MembraneModel::Biquadratic,
                };
                let own = MembraneDescription::new(&mesh.triangles, THICKNESS, MATERIAL);
                let fibres = &families[..];
                let membrane = Some(MembraneDescription { evaluation, model, fibres, ..own });
                return world(&BodyDescription { membrane, ..body }, SolverSettings::default());
            }
        };
        world(&body, SolverSettings::default())
    }

    /// Energy (J) and forces (N) of the continuum with fibres of modulus `fibre` (Pa), from the gradient of the deformation
    /// and without edges.
    fn continuum(self, mesh: &Mesh, u: &[DVec3], fibre: f64) -> Result<(f64, Vec<DVec3>)> {
        let mut forces = vec![DVec3::ZERO; u.len()];
        let mut energy = 0.0;
        let lame = match self {
            Self::Tetrahedra => MATERIAL.lame()?,
            Self::Triangles => {
                plane_stress(MATERIAL.young_modulus * THICKNESS, MATERIAL.poisson_ratio)
            }
        };
        let at = |v: u32| (mesh.points[v as usize], mesh.points[v as usize] + u[v as usize]);
        let mut add = |cell: &[u32], (own, on): (f64, &[DVec3])| {
            energy += own;
            cell.iter().zip(on).for_each(|(&v, f)| forces[v as usize] += *f);
        };
        match self {
            Self::Tetrahedra => mesh.tetrahedra.iter().for_each(|cell| {
                let (own, on) = solid(cell.map(at), lame, fibre);
                add(cell, (own, &on));
            }),
            Self::Triangles => mesh.triangles.iter().for_each(|cell| {
                let (own, on) = flat(cell.map(at), lame, fibre * THICKNESS);
                add(cell, (own, &on));
            }),
        }
        Ok((energy, forces))
    }
}

/// `W = V (lambda/2 (tr E)^2 + mu tr E^2 + Y/2 (a.E a)^2)` of a tetrahedron from rest and present points, and its forces.
fn solid(points: [(DVec3, DVec3); 4], lame: LameParameters, fibre: f64) -> (f64, [DVec3; 4]) {
    let [o, a, b, c] = points;
    let columns = |at: fn((DVec3, DVec3)) -> DVec3| {
        DMat3::from_cols(at(a) - at(o), at(b) - at(o), at(c) - at(o))
    };
    let (rest, now) = (columns(|p| p.0), columns(|p| p.1));
    let (volume, inverse) = (rest.determinant() / 6.0, rest.inverse());
    let f = now * inverse;
    let strain = (f.transpose() * f - DMat3::IDENTITY) * 0.5;
    let trace = strain.x_axis.x + strain.y_axis.y + strain.z_axis.z;
    let square: f64 = strain.to_cols_array().iter().map(|x| x * x).sum();
    let along = ALONG.dot(strain * ALONG);
    let energy = volume
        * (0.5 * lame.lambda * trace * trace + lame.mu * square + 0.5 * fibre * along * along);
    let outer = DMat3::from_cols(ALONG * ALONG.x, ALONG * ALONG.y, ALONG * ALONG.z);
    let stress = f
        * (DMat3::IDENTITY * (lame.lambda * trace)
            + strain * (2.0 * lame.mu)
            + outer * (fibre * along));
    let h = stress * inverse.transpose() * -volume;
    (energy, [-(h.x_axis + h.y_axis + h.z_axis), h.x_axis, h.y_axis, h.z_axis])
}

/// The same of a triangle at `z = 0` at rest, which may leave its plane; moduli in N/m.
fn flat(points: [(DVec3, DVec3); 3], lame: LameParameters, fibre: f64) -> (f64, [DVec3; 3]) {
    let [o, a, b] = points;
    let rest = DMat2::from_cols((a.0 - o.0).truncate(), (b.0 - o.0).truncate());
    let (area, inverse) = (0.5 * rest.determinant().abs(), rest.inverse());
    let now = [a.1 - o.1, b.1 - o.1];
    let combined = |c: DVec2| now[0] * c.x + now[1] * c.y;
    let f = [combined(inverse.x_axis), combined(inverse.y_axis)];
    let strain = |i: usize, j: usize| 0.5 * (f[i].dot(f[j]) - if i == j { 1.0 } else { 0.0 });
    let (xx, yy, xy) = (strain(0, 0), strain(1, 1), strain(0, 1));
    let [a, b] = [ALONG.x, ALONG.y];
    let along = xx * a * a + yy * b * b + 2.0 * xy * a * b;
    let energy = area
        * (0.5 * lame.lambda * (xx + yy).powi(2)
            + lame.mu * (xx * xx + yy * yy + 2.0 * xy * xy)
            + 0.5 * fibre * along * along);
    let pull = (f[0] * a + f[1] * b) * (fibre * along);
    let p = lame.lambda * (xx + yy);
    let stress = [
        f[0] * (p + 2.0 * lame.mu * xx) + f[1] * (2.0 * lame.mu * xy) + pull * a,
        f[0] * (2.0 * lame.mu * xy) + f[1] * (p + 2.0 * lame.mu * yy) + pull * b,
    ];
    // rows of the inverse are the gradients of the two barycentric coordinates
    let force = |row: DVec2| (stress[0] * row.x + stress[1] * row.y) * -area;
    let (g, h) = (force(inverse.row(0)), force(inverse.row(1)));
    (energy, [-(g + h), g, h])
}

/// A state far from rest: turned, stretched and uneven; sheets leave their plane.
fn uneven(mesh: &Mesh) -> Vec<DVec3> {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.8);
    let wave = |x: f64| 0.008 * x.sin();
    let place = |p: &DVec3| {
        let bent = DVec3::new(1.2 * p.x + wave(90.0 * p.y), 0.9 * p.y, p.z + wave(80.0 * p.x));
        turn * bent - *p
    };
    mesh.points.iter().map(place).collect()
}

/// Differences of a law from the continuum at the same state: energy, and largest force over the largest.
#[derive(Clone, Copy, Debug)]
struct Difference {
    kind: Kind,
    law: Law,
    elements: usize,
    energy: f64,
    force: f64,
    /// Laws with forces that the body has, and systems that its springs are.
    laws: usize,
}

fn differences() -> Result<Vec<Difference>> {
    let mut rows = Vec::new();
    for kind in Kind::ALL {
        let mesh = kind.mesh()?;
        let u = uneven(&mesh);
        for law in Law::ALL {
            let (energy, forces) = kind.continuum(&mesh, &u, law.fibre())?;
            let largest = forces.iter().map(|f| f.length()).fold(0.0, f64::max);
            let (mut simulation, body) = kind.simulate(&mesh, law)?;
            simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()])?;
            let own = simulation.evaluate();
            let pairs = simulation.elastic_forces(body).into_iter().zip(&forces);
            let off = pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            rows.push(Difference {
                kind,
                law,
                elements: mesh.tetrahedra.len().max(mesh.triangles.len()),
                energy: (own / energy - 1.0).abs(),
                force: off / largest,
                laws: laws_with_forces(&simulation),
            });
        }
    }
    Ok(rows)
}

/// Laws with forces that are evaluated.
fn laws_with_forces(simulation: &Simulation) -> usize {
    let energy = simulation.world().resource::<ElasticEnergy>();
    let has = |name: &str| LAWS.iter().any(|row| row.info.name == name && row.forces);
    energy.by_law.iter().filter(|(name, _)| has(name)).count()
}

/// Stress (Pa, of sheets N/m) along x at a uniform stretch along it: the work of the forces over that of the stretch.
#[derive(Clone, Copy, Debug)]
struct Pull {
    kind: Kind,
    stretch: f64,
    biquadratic: f64,
    quadratic: f64,
}

fn pulls() -> Result<Vec<Pull>> {
    let mut rows = Vec::new();
    for kind in Kind::ALL {
        let mesh = kind.mesh()?;
        let size = if kind == Kind::Tetrahedra { 1e-3 } else { 1e-2 };
        let mut laws = [kind.simulate(&mesh, Law::Fused)?, kind.simulate(&mesh, Law::Quadratic)?];
        for stretch in STRETCHES {
            let u: Vec<DVec3> =
                mesh.points.iter().map(|p| DVec3::X * (stretch - 1.0) * p.x).collect();
            let mut stresses = [0.0; 2];
            for (stress, (simulation, body)) in stresses.iter_mut().zip(&mut laws) {
                simulation.set_state(*body, &u, &vec![DVec3::ZERO; u.len()])?;
                simulation.evaluate();
                let forces = simulation.elastic_forces(*body);
                *stress = -forces.iter().zip(&mesh.points).map(|(f, p)| f.x * p.x).sum::<f64>();
                *stress /= size;
            }
            let [biquadratic, quadratic] = stresses;
            rows.push(Pull { kind, stretch, biquadratic, quadratic });
        }
    }
    Ok(rows)
}

/// Tensile and angular constants of an equilateral triangle over the stretch modulus and the area, by
/// Poisson's ratio.
fn equilateral(nu: f64) -> Result<[f64; 2]> {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75_f64.sqrt(), 0.0]];
    let rest = RestTriangle::new(points).map_err(|e| BenchError::NoTruth {
        case: "equilateral triangle".into(),
        reason: e.to_string(),
    })?;
    let constants = SpringConstants::new(&rest, plane_stress(1.0, nu));
    Ok([constants.tensile[0], constants.angular[0]])
}

/// Poisson's ratios of the scan, in steps of 0.001.
fn ratios() -> impl Iterator<Item = f64> {
    (-900..1000).map(|i| 1e-3 * f64::from(i))
}

pub(crate) fn figure() -> Result<Figure> {
    let (differences, pulls) = (differences()?, pulls()?);
    let mut scan = Vec::new();
    for nu in ratios() {
        scan.push((nu, equilateral(nu)?));
    }
    let third = equilateral(1.0 / 3.0)?;
    let states = table_of!("g-equivalence", "Differences from St Venant-Kirchhoff elasticity at a state far from rest"; for d in &differences;
        "elements" => d.kind.name(), "number" => d.elements, "law" => d.law.name(),
        "energy" => d.energy, "largest force" => d.force, "laws with forces" => d.laws,
    );
    let stresses = table_of!("g-pull", "Stress at a uniform stretch (Pa, of sheets N/m)"; for p in &pulls;
        "elements" => p.kind.name(), "stretch" => p.stretch, "biquadratic" => p.biquadratic,
        "quadratic" => p.quadratic, "ratio" => p.biquadratic / p.quadratic,
    );
    let constants = table_of!("g-constants", "Constants of an equilateral triangle"; for (nu, [k, c]) in &scan;
        "nu" => *nu, "k" => *k, "c" => *c,
    );
    Ok(Figure {
        setting: format!(
            "A block of {} irregular tetrahedra and a sheet of {} irregular triangles (10 kPa, nu 0.3), turned, \
             stretched by 20 %, compressed by 10 % and uneven. The truth is the strain energy of the gradient of \
             the deformation, computed here without edges or springs. Stretches: uniform, along one axis, sides \
             held. Fibres of {} kPa in the plane, at 37 degrees, with the energy Y/2 (a.E a)^2. The paper prints no \
             numbers for these statements; equal means to within {EQUAL:e}.",
            differences[0].elements,
            differences[Law::ALL.len()].elements,
            FIBRE / 1e3,
        ),
        findings: findings(&differences, &pulls, &scan, third),
        tables: vec![states, stresses],
        numbers: vec![constants],
        charts: charts(&pulls, &scan)?,
    })
}

fn findings(
    differences: &[Difference],
    pulls: &[Pull],
    scan: &[(f64, [f64; 2])],
    third: [f64; 2],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    for kind in Kind::ALL {
        let own = |law| differences.iter().find(|d| (d.kind, d.law) == (kind, law));
        let worst = |law| own(law).map_or(f64::INFINITY, |d| d.energy.max(d.force));
        let [pooled, fused, quadratic] = [Law::Pooled, Law::Fused, Law::Quadratic].map(worst);
        findings.push(Finding::of(pooled < EQUAL && fused < EQUAL).says(format!(
            "biquadratic springs on {} are St Venant-Kirchhoff elasticity: energy and forces differ by {pooled:.0e} \
             summed spring by spring and {fused:.0e} element by element (quadratic springs at that state: \
             {quadratic:.2})",
            kind.name()
        )));
    }
    for kind in Kind::ALL {
        let own = |law| differences.iter().find(|d| (d.kind, d.law) == (kind, law));
        let worst = |law| own(law).map_or(f64::INFINITY, |d| d.energy.max(d.force));
        let laws = |law| own(law).map_or(0, |d| d.laws);
        let [pooled, fused] = [Law::PooledFibres, Law::FusedFibres].map(worst);
        let same = laws(Law::PooledFibres) == laws(Law::Pooled);
        findings.push(Finding::of(pooled < EQUAL && fused < EQUAL && same).says(format!(
            "the springs on {} take an anisotropic material (left to future work): with fibres of Y/2 (a.E a)^2, quadratic in \
             the same changes and so added to the same constants, energy and forces differ from transversely isotropic \
             elasticity by {pooled:.0e}, in the {} laws that springs have without fibres; beside the law of one element at a \
             time they are one more and differ by {fused:.0e}",
            kind.name(),
            laws(Law::PooledFibres)
        )));
    }
    for kind in Kind::ALL {
        let own = || pulls.iter().filter(|p| p.kind == kind);
        let ratio = |p: &Pull| p.biquadratic / p.quadratic;
        let stiffer = own().filter(|p| p.stretch > 1.0).all(|p| ratio(p) > 1.0);
        let softer = own().filter(|p| p.stretch < 1.0).all(|p| ratio(p) < 1.0);
        let at = |s: f64| own().find(|p| p.stretch == s).map_or(f64::NAN, ratio);
        findings.push(Finding::of(stiffer && softer).says(format!(
            "biquadratic springs are stiffer than quadratic ones in extension and softer in compression ({}): at \
             30, 10, -10 and -30 % they take {:.2}, {:.2}, {:.2} and {:.2} of the stress",
            kind.name(),
            at(1.3),
            at(1.1),
            at(0.9),
            at(0.7),
        )));
    }
    let least = scan.iter().min_by(|a, b| a.1[0].total_cmp(&b.1[0])).map_or(f64::NAN, |s| s.0);
    findings.push(Finding::of((least - 1.0 / 3.0).abs() < 1e-3).says(format!(
        "tensile stiffness of an equilateral triangle is least at a Poisson's ratio of 1/3: least at {least:.3}, \
         in steps of 0.001"
    )));
    let zero = third[1].abs() / third[0];
    let elsewhere = scan
        .iter()
        .filter(|s| (s.0 - 1.0 / 3.0).abs() > 0.01)
        .map(|s| s.1[1].abs() / s.1[0])
        .fold(f64::INFINITY, f64::min);
    findings.push(Finding::of(zero < 1e-12 && elsewhere > 1e-3).says(format!(
        "its angular stiffness vanishes there and nowhere else: {zero:.0e} of the tensile one, more than \
         {elsewhere:.3} further than 0.01 from 1/3"
    )));
    let near = scan.last().map_or([f64::NAN; 2], |s| s.1);
    let growth = [near[0] / third[0], near[1] / third[0]];
    findings.push(Finding::of(growth.iter().all(|g| *g > 50.0)).says(format!(
        "both grow without bound towards 1: {:.0} and {:.0} times the least tensile one at 0.999",
        growth[0], growth[1]
    )));
    findings
}

fn charts(pulls: &[Pull], scan: &[(f64, [f64; 2])]) -> Result<Vec<Chart>> {
    let mut series = Vec::new();
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let unit = pulls.iter().find(|p| p.kind == kind && p.stretch == 1.05);
        let unit = unit.map_or(1.0, |p| p.quadratic / 0.05);
        for (j, name) in ["biquadratic", "quadratic"].into_iter().enumerate() {
            let own = pulls.iter().filter(|p| p.kind == kind);
            let points = own.map(|p| {
                let stress = if j == 0 { p.biquadratic } else { p.quadratic };
                [100.0 * (p.stretch - 1.0), stress / unit]
            });
            let series_name = format!("{name}, {}", kind.name());
            series.push(
                Series::new(series_name, points.collect(), 2 * i + j)
                    .hollow(kind == Kind::Triangles),
            );
        }
    }
    let stress = lines(
        "g-pull",
        "Stiffer in extension, softer in compression",
        ["stretch (%)", "stress over modulus"],
        &series,
        Scales::Linear,
    )?;
    let of = |k: usize| scan.iter().filter(|s| s.0 > -0.5 && s.0 < 0.9).map(move |s| [s.0, s.1[k]]);
    let series = [
        Series::new("tensile, k", of(0).collect(), 0),
        Series::new("angular, c", of(1).collect(), 1),
    ];
    let constants = lines(
        "g-constants",
        "Springs of an equilateral triangle",
        ["Poisson's ratio", "constant over stretch modulus (1/m^2 per unit area)"],
        &series,
        Scales::Linear,
    )?;
    Ok(vec![stress, constants])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_truth_is_the_gradient_of_its_energy() {
        for kind in Kind::ALL {
            let mesh = kind.mesh().unwrap();
            let mut u = uneven(&mesh);
            let (_, forces) = kind.continuum(&mesh, &u, FIBRE).unwrap();
            let (vertex, h) = (17, 1e-6);
            let mut energy = |shift: f64| {
                u[vertex].y += shift;
                kind.continuum(&mesh, &u, FIBRE).unwrap().0
            };
            let slope = (energy(h) - energy(-2.0 * h)) / (2.0 * h);
            assert!((slope + forces[vertex].y).abs() < 1e-6 * forces[vertex].length(), "{kind:?}");
        }
    }

    #[test]
    fn findings_follow_from_the_numbers() {
        let (mut differences, mut pulls) = (differences().unwrap(), pulls().unwrap());
        let scan: Vec<_> = ratios().map(|nu| (nu, equilateral(nu).unwrap())).collect();
        let third = equilateral(1.0 / 3.0).unwrap();
        let verdicts = |d: &[Difference], p: &[Pull], third| -> Vec<bool> {
            findings(d, p, &scan, third).iter().map(|f| f.agrees()).collect()
        };
        assert_eq!(verdicts(&differences, &pulls, third), [true; 9]);
        // uniaxial strain: (lambda + 2 mu) (s^2 - 1)/2 s
        let lame = MATERIAL.lame().unwrap();
        let p = pulls.iter().find(|p| p.kind == Kind::Tetrahedra && p.stretch == 1.2).unwrap();
        let expected = (lame.lambda + 2.0 * lame.mu) * 0.22 * 1.2;
        assert!((p.biquadratic / expected - 1.0).abs() < 1e-12, "{} {expected}", p.biquadratic);
        // each of them can fail
        differences[0].force = 1e-9;
        differences[3].laws += 1;
        differences[9].energy = 1e-9;
        pulls[0].biquadratic = 2.0 * pulls[0].quadratic;
        let changed = verdicts(&differences, &pulls, [third[0], 1e-3 * third[0]]);
        assert_eq!(changed, [false, true, false, false, false, true, true, false, true]);
    }
}
