//! Delingette 2008, figure 2, left: one tetrahedron, a vertex moved towards the opposite face.

use super::prelude::*;
use sinew::engine::scalar::dot;
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::element::tetrahedron::{Element, forces};

const RATIOS: [f64; 4] = [0.0, 0.3, 0.45, 0.49];

/// A regular tetrahedron with edges of a metre.
fn regular() -> [[f64; 3]; 4] {
    let (third, height) = (3f64.sqrt() / 2.0, (2.0f64 / 3.0).sqrt());
    [[0.0; 3], [1.0, 0.0, 0.0], [0.5, third, 0.0], [0.5, third / 3.0, height]]
}

/// The force (N) on vertex 3, away from the opposite face, by St Venant-Kirchhoff and by the compression
/// term, when it is at `s` times its rest altitude and the others are held.
fn outward(points: [[f64; 3]; 4], material: YoungPoisson, s: f64) -> Result<[f64; 2]> {
    let rest = RestTetrahedron::new(points)?;
    let lame = material.lame()?;
    let d = rest.gradients[3];
    // the altitude runs along the shape vector and is 1/|D| long
    let length = dot(d, d).sqrt();
    let mut u = [[0.0; 3]; 4];
    u[3] = d.map(|x| (s - 1.0) * x / (length * length));
    let along = |compression| {
        let f = forces(&Element::<f64>::new(&rest, lame, compression), &u);
        dot(f[3], d) / length
    };
    let svk = along(false);
    Ok([svk, along(true) - svk])
}

/// A curve over the altitude ratio.
struct Curve {
    nu: f64,
    /// `(lambda + 2 mu)` times the area of the face (N), to make curves comparable.
    unit: f64,
    /// Altitude ratio, force of St Venant-Kirchhoff, of the term (N).
    points: Vec<[f64; 3]>,
}

fn curve(nu: f64) -> Result<Curve> {
    let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: nu, density: 1.0 };
    let lame = material.lame()?;
    let area = 3f64.sqrt() / 4.0;
    let points = (-20..=150)
        .map(|i| {
            let s = f64::from(i) / 100.0;
            let [svk, term] = outward(regular(), material, s)?;
            Ok([s, svk, term])
        })
        .collect::<Result<_>>()?;
    Ok(Curve { nu, unit: (lame.lambda + 2.0 * lame.mu) * area, points })
}

/// Largest magnitude.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m, x| if x.is_nan() { f64::NAN } else { x.abs().max(m) })
}

/// Steps of the altitude ratio over which derivatives at rest are told apart.
const STEPS: [f64; 2] = [2e-3, 1e-3];

/// Jumps of the first, second and third derivative of the force of St Venant-Kirchhoff and the term by the altitude
/// ratio, from compression to extension at rest, over `(lambda + 2 mu) A`, from one-sided differences over either
/// of [`STEPS`].
fn jumps(nu: f64) -> Result<[[f64; 3]; 2]> {
    let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: nu, density: 1.0 };
    let lame = material.lame()?;
    let unit = (lame.lambda + 2.0 * lame.mu) * 3f64.sqrt() / 4.0;
    let mut jumps = [[0.0; 3]; 2];
    for (jumps, step) in jumps.iter_mut().zip(STEPS) {
        let at =
            |i: f64| outward(regular(), material, 1.0 + i * step).map(|f| (f[0] + f[1]) / unit);
        let mut sides = [[0.0; 3]; 2];
        for (derivatives, to) in sides.iter_mut().zip([-1.0, 1.0]) {
            let [a, b, c, d] = [at(0.0)?, at(to)?, at(2.0 * to)?, at(3.0 * to)?];
            *derivatives = [
                (b - a) / (to * step),
                (c - 2.0 * b + a) / (step * step),
                (d - 3.0 * c + 3.0 * b - a) / (to * step * step * step),
            ];
        }
        *jumps = [0, 1, 2].map(|k| (sides[1][k] - sides[0][k]).abs());
    }
    Ok(jumps)
}

/// How often the force with the term is differentiable: a jump that shrinks with the step is none.
fn smoothness(jumps: &[[f64; 3]; 2]) -> Finding {
    let [coarse, fine] = jumps;
    // derivatives one order up are finite, so jumps that are none halve with the step
    let none = |k: usize| fine[k] < 0.6 * coarse[k];
    Finding::of(none(0) && none(1) && !none(2)).says(format!(
        "the force with the term is continuously differentiable where compression begins, as printed; it is so twice, \
         not only once: over steps of {} and {} of the altitude its first derivatives from either side differ by \
         {:.1e} and {:.1e}, the second by {:.4} and {:.4}, the third by {:.2} and {:.2} (over (lambda + 2 mu) A)",
        STEPS[0], STEPS[1], coarse[0], fine[0], coarse[1], fine[1], coarse[2], fine[2]
    ))
}

/// What a curve says about the resistance of the tetrahedron.
struct Resistance {
    nu: f64,
    /// Altitude ratio, force of St Venant-Kirchhoff, of the term, where the first is largest under compression.
    peak: [f64; 3],
    /// The same in the flat state.
    flat: [f64; 3],
    /// Least slope (N/m) of the sum, past the flat state too, and over `(lambda + 2 mu) A / h`.
    slope: [f64; 2],
    /// Largest fourth difference of the sum over its largest value: a cubic has none.
    fourth: f64,
    /// Second derivative of the energy of St Venant-Kirchhoff by the altitude ratio in the flat state, over
    /// `V (lambda + 2 mu)`: a central difference of the force over two hundredths of the altitude.
    flat_curvature: f64,
}

impl Resistance {
    fn of(c: &Curve) -> Self {
        let missing = [f64::NAN; 3];
        let pressed = c.points.iter().filter(|p| (0.0..=1.0).contains(&p[0]));
        let peak = pressed.max_by(|a, b| a[1].total_cmp(&b[1])).copied().unwrap_or(missing);
        let pressed = c.points.iter().filter(|p| p[0] <= 1.0);
        let sums: Vec<f64> = pressed.map(|p| p[1] + p[2]).collect();
        // the force outward grows as the altitude shrinks
        let height = (2.0f64 / 3.0).sqrt();
        let step = 0.01 * height;
        let slope = sums.windows(2).map(|w| (w[0] - w[1]) / step).fold(f64::INFINITY, f64::min);
        let differences =
            sums.windows(5).map(|w| w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]);
        let at =
            |s: f64| c.points.iter().find(|p| (p[0] - s).abs() < 1e-9).copied().unwrap_or(missing);
        Self {
            nu: c.nu,
            peak,
            flat: at(0.0),
            slope: [slope, slope / (c.unit / height)],
            fourth: largest(differences) / largest(sums.iter().copied()),
            // V = A h / 3, and the force outward is -dW/dz
            flat_curvature: -3.0 * (at(0.01)[1] - at(-0.01)[1]) / 0.02 / c.unit,
        }
    }

    /// Compression (%) of the largest force.
    fn peak_percent(&self) -> f64 {
        100.0 * (1.0 - self.peak[0])
    }
}

fn findings(all: &[Resistance]) -> Vec<Finding> {
    let least = all.iter().map(|r| r.slope[1]).fold(f64::INFINITY, f64::min);
    let peak = all.iter().map(Resistance::peak_percent).sum::<f64>() / all.len() as f64;
    let spread = largest(all.iter().map(|r| r.peak_percent() - peak));
    let flat = largest(all.iter().map(|r| r.flat[1] / r.peak[1]));
    let fourth = largest(all.iter().map(|r| r.fourth));
    let curvature = all.iter().map(|r| r.flat_curvature).fold(0.0, f64::min);
    // the difference is off by the square of its step, 1e-4 of the value
    let maximum = all.iter().all(|r| (r.flat_curvature + 0.5).abs() < 1e-3);
    vec![
        Finding::of(peak > 0.0 && peak < 100.0 && spread < 1.0 && flat < 1e-12).says(format!(
            "St Venant-Kirchhoff gives way under compression: for every nu its force is largest at {peak:.0} % \
             and falls to nothing when the tetrahedron is flat"
        )),
        Finding::of(least > 0.0).says(format!(
            "with the added term the force grows all the way, past the flat state too: the least slope \
             is {least:.3} of (lambda + 2 mu) A / h"
        )),
        Finding::of(fourth < 1e-12).says(format!(
            "the sum is a cubic of the altitude under compression, as the extension side is: fourth \
             differences are {fourth:.0e} of the force"
        )),
        Finding::paper_wrong(
            maximum,
            "W(s) = V (lambda + 2 mu)/8 (s^2 - 1)^2 has W'(0) = 0 and W''(0) = -V (lambda + 2 mu)/2 < 0, whatever the \
             shape and the material",
        )
        .says(format!(
            "the flat state of St Venant-Kirchhoff is a minimum of energy: along the altitude it is a maximum, force \
             pushes away from it on both sides; W''(0) is {curvature:.4} V (lambda + 2 mu) by differences of the \
             force. What is said to follow, that no force resists there, is true"
        )),
    ]
}

pub(crate) fn figure() -> Result<Figure> {
    let curves = RATIOS.map(curve).into_iter().collect::<Result<Vec<Curve>, _>>()?;
    let all: Vec<Resistance> = curves.iter().map(Resistance::of).collect();
    let points = curves.iter().flat_map(|c| c.points.iter().map(|p| (c.nu, *p)));
    let numbers = table_of!("a-force", "Force against altitude ratio"; for (nu, [s, svk, term]) in points;
        "nu" => nu, "altitude ratio" => s, "svk N" => svk, "compression term N" => term,
        "sum N" => svk + term,
    );
    let title = "Resistance of one tetrahedron (regular, edge 1 m, E = 1 Pa)";
    let key = table_of!("a-key", title; for r in &all;
        "nu" => r.nu, "svk peak at compression %" => r.peak_percent(), "peak N" => r.peak[1],
        "svk at 0 N" => r.flat[1], "sum at 0 N" => r.flat[1] + r.flat[2],
        "least slope of the sum N per m" => r.slope[0],
    );
    let series = |name: String, c: &Curve, colour, pick: fn(&[f64; 3]) -> f64| {
        let points = c.points.iter().map(|p| [100.0 * (1.0 - p[0]), pick(p) / c.unit]).collect();
        Series::new(name, points, colour)
    };
    let one = &curves[1];
    let parts = [
        series("St Venant-Kirchhoff".into(), one, 0, |p| p[1]),
        series("compression term".into(), one, 1, |p| p[2]),
        series("sum".into(), one, 2, |p| p[1] + p[2]),
    ];
    let mut sums = vec![series("svk, any nu".into(), one, 7, |p| p[1])];
    for (i, c) in curves.iter().enumerate() {
        sums.push(series(format!("svk_comp, nu {}", c.nu), c, i, |p| p[1] + p[2]));
    }
    let chart = |name: &str, title: &str, series: &[Series]| {
        let axes = ["compression (%), below 0 extension", "force over (lambda + 2 mu) A"];
        lines(name, title, axes, series, Scales::Linear)
    };
    Ok(Figure {
        setting: "A regular tetrahedron, one vertex moved along its altitude, the others held. The paper \
                  does not print shape and material; force over (lambda + 2 mu) A does not depend on the \
                  shape."
            .into(),
        findings: {
            let mut findings = findings(&all);
            findings.push(smoothness(&jumps(0.3)?));
            findings
        },
        tables: vec![key],
        numbers: vec![numbers],
        charts: vec![
            chart("a-parts", "One tetrahedron, nu 0.3: both terms and their sum", &parts)?,
            chart("a-sums", "One tetrahedron: the sum for several nu", &sums)?,
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Against the curves of an independent program, on regular and irregular tetrahedra.
    #[test]
    fn forces_are_those_of_the_reference_curves() {
        let file =
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/tests/data/compression_curve.json");
        let file: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
        let number = |v: &Value| v.as_f64().unwrap();
        let mut compared = 0;
        for case in file["cases"].as_array().unwrap() {
            let points: [[f64; 3]; 4] = serde_json::from_value(case["rest"].clone()).unwrap();
            let (young_modulus, poisson_ratio) = (number(&case["E"]), number(&case["nu"]));
            let material = YoungPoisson { young_modulus, poisson_ratio, density: 1.0 };
            let unit = material.lame().unwrap();
            let unit = (unit.lambda + 2.0 * unit.mu) * number(&case["base_area"]);
            for (i, s) in case["s"].as_array().unwrap().iter().enumerate() {
                let [svk, term] = outward(points, material, number(s)).unwrap();
                for (found, name) in [(svk, "force_svk"), (term, "force_comp")] {
                    let expected = number(&case[name][i]);
                    let error = (found - expected).abs() / unit;
                    assert!(error < 1e-12, "{} {name} at {s}: {error:e}", case["name"]);
                    compared += 1;
                }
            }
        }
        assert!(compared > 300, "{compared} forces compared");
    }

    #[test]
    fn the_peak_is_where_theory_has_it() {
        // s = 1/sqrt(3), for every nu
        for nu in RATIOS {
            let c = curve(nu).unwrap();
            let pressed = c.points.iter().filter(|p| (0.0..=1.0).contains(&p[0]));
            let peak = pressed.max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
            assert!((peak[0] - 1.0 / 3f64.sqrt()).abs() <= 0.006, "{}", peak[0]);
        }
    }
}
