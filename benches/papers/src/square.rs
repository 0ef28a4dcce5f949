//! Natsupakpong & Cavusoglu 2010, figure 9: moduli that one square of springs has against those that
//! went in.

use super::lumped::{MATERIAL, SECTION, printed_name};
use super::prelude::*;
use glam::DVec2;
use sinew::engine::mesh::generate::quad_grid;
use sinew_identify::ElementMethod::{self, Baudet, Block, Frobenius, TwoNorm};
use sinew_identify::fit::{ElementFit, FitProblem};
use sinew_identify::mesh::{FittedSprings, fit_elements};
use sinew_identify::method::constant_ranges;
use sinew_identify::springs::spring_vectors;
use sinew_identify::stiffness::element_stiffness;
use sinew_identify::{ElementGeometry, ElementKind, LinearMaterial, Plane, Section, fit_element};
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

/// Relative error at which a modulus counts as set accurately, and the part of the way of nu_in below which
/// nu_out counts as standing still.
const ACCURATE: f64 = 0.1;
const FLAT: f64 = 0.25;
/// What a closed form and the run may part by.
const ROUNDING: f64 = 1e-6;

/// `E_out / E_in` of a square whose sides and diagonals have these constants, over `E t`: sides in parallel with what the
/// diagonals, held apart by the sides across, bear.
fn modulus_of(side: f64, diagonal: f64) -> f64 {
    2.0 * side * (2.0 * side + 2.0 * diagonal) / (2.0 * side + diagonal)
}

/// The constants of least 2-norm of one square, over `E t`, and what proves that they are many.
pub(crate) struct Minimisers {
    /// Of the sides.
    pub side: f64,
    /// Smallest and largest of the diagonals.
    pub diagonal: [f64; 2],
    /// The same by closed forms.
    closed: [f64; 2],
    /// `|R - K|_2 / |R|_2` at both ends and in the middle, and a hundredth of the interval beyond its ends.
    norms: [f64; 3],
    beyond: [f64; 2],
}

fn square() -> Result<ElementGeometry> {
    let corners = [[0.0; 2], [SIDE, 0.0], [SIDE, SIDE], [0.0, SIDE]];
    Ok(ElementGeometry::planar(ElementKind::Quad, &corners).map_err(FitError::from)?)
}

impl Minimisers {
    pub fn find() -> Result<Self> {
        let square = square()?;
        let scale = MATERIAL.youngs_modulus * SECTION.thickness;
        let fit = fit_element(&square, &MATERIAL, &SECTION, TwoNorm).map_err(FitError::from)?;
        let ranges = constant_ranges(&square, &MATERIAL, &SECTION, &fit.constants, None);
        let ranges = ranges.map_err(FitError::from)?;
        // pairs 01 02 03 12 13 23: the diagonals are 02 and 13
        let free = ranges.iter().find(|r| r.springs == [1, 4]);
        let diagonal = free.map_or([fit.constants[1]; 2], |r| r.range).map(|k| k / scale);
        let side = fit.constants[0] / scale;
        let problem = FitProblem {
            stiffness: element_stiffness(&square, &MATERIAL, &SECTION).map_err(FitError::from)?,
            springs: spring_vectors(&square),
            dimension: 2,
        };
        let norm = |k: f64| -> Result<f64> {
            let [s, d] = [side * scale, k * scale];
            Ok(ElementFit::measure(&problem, vec![s, d, s, s, d, s]).two_norm_residual)
        };
        let [low, high] = diagonal;
        let over = 0.01 * (high - low);
        // the norm is that of stretch and of the hourglass, which balance; dilation and shear may have as much
        let nu = MATERIAL.poissons_ratio;
        let stretch = 1.0 / (1.0 + nu);
        let hourglass = (1.0 / (1.0 - nu * nu) + 0.5 / (1.0 + nu)) / 3.0;
        let (least, sides) = (0.5 * (stretch - hourglass), 0.5 * (stretch + hourglass));
        let dilation = 1.0 / (1.0 - nu) - sides;
        let closed =
            [(dilation - least).max(stretch - least), (dilation + least).min(stretch + least)];
        Ok(Self {
            side,
            diagonal,
            closed: closed.map(|k| 0.5 * k),
            norms: [norm(low)?, norm(0.5 * (low + high))?, norm(high)?],
            beyond: [norm(low - over)?, norm(high + over)?],
        })
    }

    /// Whether the run's interval is that of the closed forms, with one norm inside and a larger one outside.
    fn shown(&self) -> bool {
        let near = |a: f64, b: f64| (a / b - 1.0).abs() < ROUNDING;
        let same = self.norms.iter().all(|n| near(*n, self.norms[0]));
        let worse = self.beyond.iter().all(|n| *n > self.norms[0] * (1.0 + 10.0 * ROUNDING));
        (0..2).all(|k| near(self.diagonal[k], self.closed[k])) && same && worse
    }

    /// The moduli at both ends of the interval, over that put in.
    fn moduli(&self) -> [f64; 2] {
        self.diagonal.map(|diagonal| modulus_of(self.side, diagonal))
    }

    /// Springs of a mesh of equal squares with this constant (over `E t`) on all diagonals.
    pub fn with_diagonal(
        &self,
        springs: &FittedSprings,
        points: &[[f64; 3]],
        k: f64,
    ) -> FittedSprings {
        let mut springs = springs.clone();
        let scale = MATERIAL.youngs_modulus * SECTION.thickness;
        for (edge, constant) in springs.edges.iter().zip(&mut springs.constants) {
            let [a, b] = edge.map(|v| DVec3::from_array(points[v as usize]));
            let along = (b - a).abs();
            if along.x.min(along.y) > 0.5 * along.max_element() {
                *constant = k * scale;
            }
        }
        springs
    }
}

/// Equations (27) and (29) as printed, sides and diagonals (N/m), in plane strain as the paper's matrix (19).
fn printed_forms(material: &LinearMaterial, plane: Plane) -> Result<[f64; 2]> {
    let moduli = material.moduli(Some(plane)).map_err(FitError::from)?;
    let (lambda, mu) = (moduli.lambda, moduli.mu);
    Ok([lambda / 3.0 + 0.5 * mu, 5.0 * lambda / 12.0 + 0.75 * mu])
}

/// The closed forms, said to minimise the F-norm, beside its minimiser.
fn closed_forms() -> Result<Finding> {
    let square = square()?;
    let mut words = Vec::new();
    let mut shown = true;
    for (plane, name) in [(Plane::Stress, "stress"), (Plane::Strain, "strain")] {
        let section = Section { plane, ..SECTION };
        let fit =
            |method| fit_element(&square, &MATERIAL, &section, method).map_err(FitError::from);
        let (printed, best): (ElementFit, ElementFit) = (fit(Block)?, fit(Frobenius)?);
        let own = printed_forms(&MATERIAL, plane)?;
        shown &= (printed.constants[0] / own[0] - 1.0).abs() < ROUNDING
            && (printed.constants[1] / own[1] - 1.0).abs() < ROUNDING
            && printed.frobenius_residual > best.frobenius_residual * 1.01;
        words.push(format!(
            "{:.4} and {:.4} in plane {name}",
            printed.frobenius_residual, best.frobenius_residual
        ));
    }
    Ok(Finding::paper_wrong(
        shown,
        "they set the derivative of each off-diagonal block alone to zero; with all entries of (23) it vanishes at 5 \
         lambda/21 + 4 mu/7 and 8 lambda/21 + 5 mu/7",
    )
    .says(format!(
        "(27) and (29), lambda/3 + mu/2 on the sides and 5 lambda/12 + 3 mu/4 on the diagonals, minimise the Frobenius \
         norm: |R - K| / |R| with them and at the minimum is {}",
        words.join(", ")
    )))
}

fn findings(points: &[Point], many: &Minimisers) -> Vec<Finding> {
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
    let proportional = worst < ROUNDING;
    let at_zero = |method| of(points, method, MODULI[0]).first().and_then(|p| Some(p.out?[0]));
    let is =
        |method, closed: f64| at_zero(method).is_some_and(|e| (e / closed - 1.0).abs() < ROUNDING);
    let off = many.moduli().iter().all(|e| (e - 1.0).abs() > ACCURATE);
    let [low, high] = many.moduli();
    let proofs = [
        (
            Frobenius,
            is(Frobenius, 72.0 / 91.0),
            "at nu 0 its constants are 2/7 and 5/14 of E t, and the square then has 72/91 = 0.791 of E".to_string(),
        ),
        (
            TwoNorm,
            many.shown() && off,
            format!(
                "at nu 0.3 the sides have {:.4} E t whatever the diagonals, and over all minimisers the square has \
                 {low:.3} to {high:.3} of E",
                many.side
            ),
        ),
        (
            Block,
            is(Block, 5.0 / 7.0),
            "at nu 0 their constants are 1/4 and 3/8 of E t, and the square then has 5/7 = 0.714 of E".to_string(),
        ),
    ];
    let mut findings = Vec::new();
    for (method, shown, proof) in proofs {
        let own = of(points, method, MODULI[0]);
        let ratios: Vec<f64> =
            own.iter().filter_map(|p| p.out.map(|out| out[0] / MODULI[0])).collect();
        let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
        let most = ratios.iter().copied().fold(0.0, f64::max);
        let claim = format!(
            "E can be set accurately with {}: E_out / E_in is {least:.3} to {most:.3} over nu_in from 0 to 0.5 ({:.0} % \
             allowed), at every E_in from 1 Pa to 10 kPa (the ratio changes by {worst:.1e} at most)",
            printed_name(method),
            100.0 * ACCURATE
        );
        let within = ratios.iter().all(|r| (r - 1.0).abs() < ACCURATE);
        let finding = if within {
            Finding::of(proportional)
        } else {
            Finding::paper_wrong(shown && proportional, proof)
        };
        findings.push(finding.says(claim));
    }
    // the paper's figure shows its own method only
    for method in METHODS.into_iter().filter(|m| *m != Baudet) {
        let own = of(points, method, MODULI[0]);
        let ends = [own.first(), own.last()].map(|p| p.and_then(|p| Some(p.out?[1])));
        let [Some(first), Some(last)] = ends else { continue };
        let slope = (last - first) / 0.5;
        findings.push(Finding::of(slope < FLAT).says(format!(
            "nu_out does not follow nu_in with {}: while nu_in goes from 0 to 0.5 it goes from {first:.3} to {last:.3}, \
             {slope:.2} of its way ({FLAT} allowed)",
            printed_name(method)
        )));
    }
    let [low, high] = many.diagonal;
    findings.push(
        Finding::paper_wrong(
            many.shown(),
            format!(
                "the norm is that of stretch along the sides and of the hourglass, which diagonals do not feel, and which \
                 balance at {:.6} E t on the sides; dilation and shear may have as much, so diagonals of {low:.5} to \
                 {high:.5} E t (closed forms: {:.5} to {:.5}) all have |R - K| / |R| = {:.5}, and {:.5}, {:.5} a hundredth \
                 beyond",
                many.side, many.closed[0], many.closed[1], many.norms[1], many.beyond[0], many.beyond[1]
            ),
        )
        .says("the least 2-norm (24) determines the springs of a square (plane stress, nu 0.3)"),
    );
    findings
}

fn number(x: Option<f64>) -> Cell {
    x.map(|x| format!("{x:.3}")).into()
}

pub(crate) fn figure() -> Result<Figure> {
    let points = measure()?;
    let many = Minimisers::find()?;
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
        findings: {
            let mut all = findings(&points, &many);
            all.push(closed_forms()?);
            all
        },
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
    use super::super::figure::Verdict;
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
        let many = Minimisers::find().unwrap();
        let found = findings(&points, &many);
        let verdicts = |found: &[Finding]| found.iter().map(|f| f.verdict).collect::<Vec<_>>();
        use Verdict::{Agrees, Differs, PaperWrong};
        let expected = [PaperWrong, PaperWrong, PaperWrong, Agrees, Agrees, Agrees, PaperWrong];
        assert_eq!(verdicts(&found), expected, "{found:?}");
        assert_eq!(closed_forms().unwrap().verdict, PaperWrong);
        // the modulus of a square by springs and by its closed form
        assert!((modulus_of(2.0 / 7.0, 5.0 / 14.0) - 72.0 / 91.0).abs() < 1e-12);
        // a proof that the run does not bear out, a modulus that does not follow and a ratio that does
        let mut wrong = points;
        wrong.iter_mut().filter(|p| p.put_in[0] == 1e4).for_each(|p| {
            p.out.as_mut().unwrap()[0] *= 1.1;
        });
        wrong.iter_mut().filter(|p| p.method == Block).for_each(|p| {
            p.out.as_mut().unwrap()[1] = p.put_in[1];
        });
        let many = Minimisers { norms: [0.1, 0.11, 0.1], ..many };
        let found = findings(&wrong, &many);
        assert!(found[0].text.contains("by 1.0e-1 at most"));
        let expected = [Differs, Differs, Differs, Agrees, Agrees, Differs, Differs];
        assert_eq!(verdicts(&found), expected, "{found:?}");
    }
}
