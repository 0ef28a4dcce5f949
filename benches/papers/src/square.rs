//! Natsupakpong & Cavusoglu 2010, figure 9: moduli that one square of springs has against those that
//! went in.

use super::lumped::{SECTION, printed_name};
use super::prelude::*;
use glam::DVec2;
use sinew::engine::mesh::generate::quad_grid;
use sinew_identify::ElementMethod::{self, Baudet, Block, Frobenius, TwoNorm};
use sinew_identify::LinearMaterial;
use sinew_identify::mesh::fit_elements;
use sinew_tune::fit::FitError;
use sinew_tune::fit::assess::{against, reference};
use sinew_tune::fit::rig::{Grips, Rig};

const SIDE: f64 = 0.02;
const METHODS: [ElementMethod; 4] = [Frobenius, TwoNorm, Block, Baudet];
const MODULI: [f64; 5] = [1.0, 10.0, 100.0, 1e3, 1e4];
const RATIOS: usize = 20;

/// What one square does.
#[derive(Clone, Copy)]
struct Point {
    method: ElementMethod,
    put_in: [f64; 2],
    /// Measured modulus (Pa) and ratio.
    out: Option<[f64; 2]>,
}

fn measure() -> Result<Vec<Point>> {
    let mesh = quad_grid(DVec2::splat(SIDE), [1, 1])?;
    let grips = Grips { axis: Some(0), ..Grips::default() };
    let rig = Rig::new(&mesh, SECTION, &grips)?;
    let mut points = Vec::new();
    for method in METHODS {
        for e in MODULI {
            for i in 0..=RATIOS {
                let nu = 0.5 * i as f64 / RATIOS as f64;
                let material = LinearMaterial::new(e, nu).map_err(FitError::from)?;
                let stress = Rig::stress(&material);
                let cells = rig.cells();
                let springs = fit_elements(&rig.points, &cells, &[material], &SECTION, method)?;
                let loading = rig.free_tension(stress);
                let fem = reference(&rig, &material, &loading)?;
                let own = against(&rig, &springs, &loading, &fem, None).ok();
                let out = own.and_then(|own| rig.moduli(&own.displacements, stress));
                points.push(Point {
                    method,
                    put_in: [e, nu],
                    out: out.map(|m| [m.youngs_modulus, m.poissons_ratio]),
                });
            }
        }
    }
    Ok(points)
}

fn of(points: &[Point], method: ElementMethod, e: f64) -> Vec<&Point> {
    points.iter().filter(|p| p.method == method && p.put_in[0] == e).collect()
}

/// Smallest and largest measured ratio while that put in runs from 0 to 0.5.
fn range(points: &[Point], method: ElementMethod) -> Option<[f64; 2]> {
    let ratios = points.iter().filter(|p| p.method == method).filter_map(|p| Some(p.out?[1]));
    ratios.fold(None, |range: Option<[f64; 2]>, nu| {
        let [low, high] = range.unwrap_or([nu, nu]);
        Some([low.min(nu), high.max(nu)])
    })
}

/// Relative error at which a modulus counts as set accurately, and the part of the way of nu_in below which
/// nu_out counts as standing still.
const ACCURATE: f64 = 0.1;
const FLAT: f64 = 0.25;

fn findings(points: &[Point]) -> Vec<Finding> {
    let mut worst = 0.0_f64;
    for method in METHODS {
        let unit = of(points, method, MODULI[0]);
        for e in MODULI {
            for (p, q) in of(points, method, e).iter().zip(&unit) {
                match (p.out, q.out) {
                    (Some(p), Some(q)) => worst = worst.max((p[0] / (e * q[0]) - 1.0).abs()),
                    (None, None) => {}
                    _ => worst = f64::INFINITY,
                }
            }
        }
    }
    // that one is proportional to the other is linearity; how near they are is what the paper claims
    let mut findings = Vec::new();
    for method in METHODS {
        let own = of(points, method, MODULI[0]);
        let ratios: Vec<f64> =
            own.iter().filter_map(|p| p.out.map(|out| out[0] / MODULI[0])).collect();
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        let most = ratios.iter().copied().fold(0.0, f64::max);
        findings.push(Finding::of(ratios.iter().all(|r| (r - 1.0).abs() < ACCURATE)).says(format!(
            "E can be set accurately with {}: E_out / E_in is {least:.3} to {most:.3} over nu_in from 0 to 0.5 ({:.0} % \
             allowed), at every E_in from 1 Pa to 10 kPa (the ratio changes by {worst:.1e} at most)",
            printed_name(method),
            100.0 * ACCURATE
        )));
    }
    for method in METHODS {
        let Some([low, high]) = range(points, method) else { continue };
        let slope = (high - low) / 0.5;
        findings.push(Finding::of(slope < FLAT).says(format!(
            "nu_out does not follow nu_in with {}: while nu_in goes from 0 to 0.5 it goes from {low:.3} to {high:.3}, \
             {slope:.2} of its way ({FLAT} allowed)",
            printed_name(method)
        )));
    }
    findings
}

fn number(x: Option<f64>) -> Cell {
    x.map(|x| format!("{x:.3}")).into()
}

pub(crate) fn figure() -> Result<Figure> {
    let points = measure()?;
    let mut table = Table::new(
        "d-square",
        "One square: E_out / E_in and nu_out by nu_in",
        &["nu_in", "F: E", "nu", "2-norm: E", "nu", "(27), (29): E", "nu", "Baudet: E", "nu"],
    )
    .note("the same for every E_in from 1 Pa to 10 kPa");
    for i in (0..=RATIOS).step_by(2) {
        let nu = 0.5 * i as f64 / RATIOS as f64;
        let mut row: Vec<Cell> = vec![format!("{nu:.2}").into()];
        for method in METHODS {
            let p = of(&points, method, 1.0)[i];
            row.push(number(p.out.map(|o| o[0])));
            row.push(number(p.out.map(|o| o[1])));
        }
        table.row(row);
    }
    let numbers = table_of!("d-square-numbers", "One square"; for p in &points;
        "method" => p.method.name(), "E_in Pa" => p.put_in[0], "nu_in" => p.put_in[1],
        "E_out Pa" => p.out.map(|o| o[0]), "nu_out" => p.out.map(|o| o[1]),
    );
    let chart = |name: &str, title: &str, axis: &str, which: usize| -> Result<Chart> {
        let own = |(colour, method): (usize, ElementMethod)| {
            let own = of(&points, method, 1.0).into_iter();
            let places = own.filter_map(|p| Some([p.put_in[1], p.out?[which]])).collect();
            Series::new(printed_name(method), places, colour)
        };
        let mut series: Vec<Series> = METHODS.into_iter().enumerate().map(own).collect();
        let asked = (0..=RATIOS)
            .map(|i| 0.5 * i as f64 / RATIOS as f64)
            .map(|nu| [nu, if which == 0 { 1.0 } else { nu }])
            .collect();
        series.push(Series::new("put in", asked, METHODS.len()).hollow(true));
        lines(name, title, ["nu_in", axis], &series, Scales::Linear)
    };
    Ok(Figure {
        setting: "A quadrilateral of 2 x 2 cm in plane stress, one side on rollers, traction on the other; linear \
                  springs."
            .into(),
        findings: findings(&points),
        tables: vec![table],
        numbers: vec![numbers],
        charts: vec![
            chart("d-young", "Young's modulus of one square", "E_out / E_in", 0)?,
            chart("d-poisson", "Poisson's ratio of one square", "nu_out", 1)?,
        ],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moduli of a lattice of squares, worked out by another program for a ratio of 0.3 (three digits).
    #[test]
    fn moduli_are_those_of_the_lattice() {
        let points = measure().unwrap();
        let at = |method| of(&points, method, 1.0)[12].out.unwrap();
        for (method, e, nu) in
            [(Frobenius, 0.836, 0.402), (Block, 0.854, 0.413), (TwoNorm, 0.874, 0.383)]
        {
            let [young, ratio] = at(method);
            assert!(
                (young - e).abs() < 6e-4 && (ratio - nu).abs() < 6e-4,
                "{method} {young} {ratio}"
            );
        }
        let found = findings(&points);
        // a square of springs is softer than its material; its ratio stands still, but for Baudet's springs
        let verdicts: Vec<bool> = found.iter().map(|f| f.agrees()).collect();
        assert!(!verdicts[0] && verdicts[4] && !verdicts[7], "{found:?}");
        // a modulus that does not follow is seen
        let mut wrong = points;
        wrong.iter_mut().filter(|p| p.put_in[0] == 1e4).for_each(|p| {
            p.out.as_mut().unwrap()[0] *= 1.1;
        });
        assert!(findings(&wrong)[0].text.contains("by 1.0e-1 at most"));
    }
}
