//! Delingette 2008, figure 2, left: one tetrahedron, a vertex moved towards the opposite face.

use super::{Figure, Finding};
use crate::bench::error::BenchError;
use crate::bench::plot::{Scales, Series, lines};
use crate::bench::report::Chart;
use crate::bench::table::Table;
use sinew::engine::scalar::dot;
use sinew::models::element::precompute::RestTetrahedron;
use sinew::models::element::tetrahedron::{Element, forces};
use sinew::prelude::YoungPoisson;

const RATIOS: [f64; 4] = [0.0, 0.3, 0.45, 0.49];

/// A regular tetrahedron with edges of a metre.
fn regular() -> [[f64; 3]; 4] {
    let (third, height) = (3f64.sqrt() / 2.0, (2.0f64 / 3.0).sqrt());
    [[0.0; 3], [1.0, 0.0, 0.0], [0.5, third, 0.0], [0.5, third / 3.0, height]]
}

/// The force (N) on vertex 3, away from the opposite face, by St Venant-Kirchhoff and by the compression
/// term, when it is at `s` times its rest altitude and the others are held.
fn outward(points: [[f64; 3]; 4], material: YoungPoisson, s: f64) -> Result<[f64; 2], BenchError> {
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

fn curve(nu: f64) -> Result<Curve, BenchError> {
    let material = YoungPoisson { young_modulus: 1.0, poisson_ratio: nu, density: 1.0 };
    let lame = material.lame()?;
    let area = 3f64.sqrt() / 4.0;
    let points = (-20..=150)
        .map(|i| {
            let s = f64::from(i) / 100.0;
            let [svk, term] = outward(regular(), material, s)?;
            Ok([s, svk, term])
        })
        .collect::<Result<_, BenchError>>()?;
    Ok(Curve { nu, unit: (lame.lambda + 2.0 * lame.mu) * area, points })
}

/// Largest magnitude.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m, x| if x.is_nan() { f64::NAN } else { x.abs().max(m) })
}

pub(super) fn figure() -> Result<Figure, BenchError> {
    let curves = RATIOS.map(curve).into_iter().collect::<Result<Vec<Curve>, _>>()?;
    let mut numbers = Table::new(
        "a-force",
        "Force against altitude ratio",
        &["nu", "altitude ratio", "svk N", "compression term N", "sum N"],
    );
    let mut key = Table::new(
        "a-key",
        "Resistance of one tetrahedron (regular, edge 1 m, E = 1 Pa)",
        &[
            "nu",
            "svk peak at compression %",
            "peak N",
            "svk at 0 N",
            "sum at 0 N",
            "least slope of the sum N per m",
        ],
    );
    let height = (2.0f64 / 3.0).sqrt();
    let (mut peaks, mut flats, mut slopes) = (Vec::new(), Vec::new(), Vec::new());
    let (mut fourths, mut backs) = (Vec::new(), Vec::new());
    for c in &curves {
        for &[s, svk, term] in &c.points {
            numbers.row(vec![c.nu.into(), s.into(), svk.into(), term.into(), (svk + term).into()]);
        }
        let pressed = c.points.iter().filter(|p| (0.0..=1.0).contains(&p[0]));
        let peak = pressed.max_by(|a, b| a[1].total_cmp(&b[1])).copied().unwrap_or([f64::NAN; 3]);
        let sum: Vec<f64> = c.points.iter().map(|p| p[1] + p[2]).collect();
        let pressed: Vec<f64> =
            c.points.iter().zip(&sum).filter(|(p, _)| p[0] <= 1.0).map(|(_, f)| *f).collect();
        // the force outward grows as the altitude shrinks
        let step = 0.01 * height;
        let slope = pressed.windows(2).map(|w| (w[0] - w[1]) / step).fold(f64::INFINITY, f64::min);
        // a cubic has no fourth differences
        let differences =
            pressed.windows(5).map(|w| w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]);
        fourths.push(largest(differences) / largest(pressed.iter().copied()));
        let at = |s: f64| {
            c.points.iter().find(|p| (p[0] - s).abs() < 1e-9).copied().unwrap_or([f64::NAN; 3])
        };
        let flat = at(0.0);
        // what points back to the flat state from either side
        backs.push(at(-0.05)[1].max(-at(0.05)[1]) / c.unit);
        peaks.push(100.0 * (1.0 - peak[0]));
        flats.push(flat[1] / peak[1]);
        slopes.push(slope / (c.unit / height));
        key.row(vec![
            c.nu.into(),
            (100.0 * (1.0 - peak[0])).into(),
            peak[1].into(),
            flat[1].into(),
            (flat[1] + flat[2]).into(),
            slope.into(),
        ]);
    }
    let least = slopes.iter().copied().fold(f64::INFINITY, f64::min);
    let peak = peaks.iter().sum::<f64>() / peaks.len() as f64;
    let spread = largest(peaks.iter().map(|p| p - peak));
    let minimum = backs.iter().all(|b| *b > 0.0);
    let fourth = largest(fourths.into_iter());
    let findings = vec![
        Finding {
            agrees: peak > 0.0
                && peak < 100.0
                && spread < 1.0
                && largest(flats.into_iter()) < 1e-12,
            text: format!(
                "St Venant-Kirchhoff gives way under compression: for every nu its force is largest at {peak:.0} % \
                 and falls to nothing when the tetrahedron is flat"
            ),
        },
        Finding {
            agrees: least > 0.0,
            text: format!(
                "with the added term the force grows all the way, past the flat state too: the least slope \
                 is {least:.3} of (lambda + 2 mu) A / h"
            ),
        },
        Finding {
            agrees: fourth < 1e-12,
            text: format!(
                "the sum is a cubic of the altitude under compression, as the extension side is: fourth \
                 differences are {fourth:.0e} of the force"
            ),
        },
        Finding {
            agrees: minimum,
            text: if minimum {
                "the flat state of St Venant-Kirchhoff is a minimum of energy along the altitude"
                    .into()
            } else {
                "the paper calls the flat state of St Venant-Kirchhoff a minimum of energy; along the \
                 altitude it is a maximum here, force pushes away from it on both sides"
                    .into()
            },
        },
    ];
    let series = |name: String, c: &Curve, colour, pick: fn(&[f64; 3]) -> f64| Series {
        name,
        points: c.points.iter().map(|p| [100.0 * (1.0 - p[0]), pick(p) / c.unit]).collect(),
        hollow: false,
        colour,
    };
    let axes = ["compression (%), below 0 extension", "force over (lambda + 2 mu) A"];
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
    let chart = |name: &str, title: &str, series: &[Series]| -> Result<Chart, BenchError> {
        Ok(Chart { name: name.into(), svg: lines(title, axes, series, Scales::Linear)? })
    };
    Ok(Figure {
        letter: 'a',
        title: "One tetrahedron under compression (Fig. 2, left)",
        setting: "A regular tetrahedron, one vertex moved along its altitude, the others held. The paper \
                  does not print shape and material; force over (lambda + 2 mu) A does not depend on the \
                  shape."
            .into(),
        findings,
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
            concat!(env!("CARGO_MANIFEST_DIR"), "/../models/tests/data/compression_curve.json");
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
