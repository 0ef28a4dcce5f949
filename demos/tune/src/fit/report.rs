//! The report of `sinew fit` on a terminal.

use super::assess::Assessment;
use super::whole::WholeReport;
use super::{FittedBody, Freedom};
use crate::table::three_digits;
use crate::table_of;
use sinew_identify::fit::ConstantRange;
use sinew_identify::{Plane, mesh::Residuals};
use std::fmt;

impl fmt::Display for FittedBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let r = &self.report;
        writeln!(f, "{}", self.mesh)?;
        let section = match (self.plane, self.thickness) {
            (Some(plane), Some(thickness)) => {
                let plane = if plane == Plane::Stress { "stress" } else { "strain" };
                format!(", plane {plane}, {thickness} m thick")
            }
            _ => String::new(),
        };
        let (e, nu) = (self.young_modulus, self.poisson_ratio);
        writeln!(f, "  material     E {e} Pa, nu {nu}, {} kg/m^3{section}", self.density)?;
        let kinds = self.element_constants.kinds();
        let kinds = kinds.iter().filter(|k| !k.1.is_empty());
        let kinds: Vec<String> = kinds.map(|(name, l)| format!("{} x {name}", l.len())).collect();
        writeln!(
            f,
            "  elements     {}, {} of them different in shape",
            kinds.join(", "),
            r.distinct_fits
        )?;
        let recalled = if r.recalled {
            " (formula recalled from the literature, original not read)"
        } else {
            ""
        };
        writeln!(f, "  method       {}{recalled}", self.method)?;
        let total: f64 = self.masses.iter().sum();
        writeln!(
            f,
            "  springs      {}, masses ({}) sum to {} kg",
            self.springs.len(),
            self.mass_lumping,
            three_digits(total)
        )?;
        let residual = |r: &Residuals| {
            format!(
                "mean {}, worst {} (element {})",
                three_digits(r.mean),
                three_digits(r.worst),
                r.worst_element
            )
        };
        if let Some(whole) = &self.whole {
            return self.of_whole(whole, f);
        }
        writeln!(f, "  residual     |R - K|_F / |R|_F  {}", residual(&r.frobenius_residual))?;
        writeln!(f, "               |R - K|_2 / |R|_2  {}", residual(&r.two_norm_residual))?;
        if let Some(gap) = r.worst_certificate_gap {
            writeln!(f, "               2-norm within {gap:.1e} of its proven optimum")?;
        }
        if let Some(freedom) = &self.freedom {
            self.determined(freedom, f)?;
        }
        writeln!(
            f,
            "  negative     {} of {} constants of elements, {} of {} springs (least {} N/m)",
            r.negative_element_constants,
            r.element_constants,
            r.negative_edges,
            self.springs.len(),
            three_digits(r.least_constant)
        )?;
        self.all_tests(f)?;
        writeln!(f, "In a scene: model = \"mass_spring\", element_method = \"{}\"", self.method)
    }
}

impl FittedBody {
    /// How well the least 2-norm determines the constants.
    fn determined(&self, freedom: &Freedom, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let element = freedom.element;
        match freedom.rise {
            None => {
                let (count, all) = (self.report.not_unique.unwrap_or(0), self.report.elements);
                writeln!(
                    f,
                    "               NOT UNIQUE in {count} of {all} elements: other constants have the same 2-norm"
                )?;
                for range in &freedom.ranges {
                    let [low, high] = range.range.map(three_digits);
                    let (count, own) = (range.springs.len(), three_digits(range.constant));
                    writeln!(
                        f,
                        "               element {element}: {count} springs of one length at {own} N/m, any of {low} \
                         to {high} N/m would do"
                    )?;
                }
            }
            Some(rise) => {
                let part = |r: &ConstantRange| r.range.map(|k| 100.0 * (k / r.constant - 1.0));
                let width = |r: &ConstantRange| (r.range[1] - r.range[0]) / r.constant.abs();
                let widest = freedom.ranges.iter().max_by(|a, b| width(a).total_cmp(&width(b)));
                if let Some([low, high]) = widest.map(part) {
                    writeln!(
                        f,
                        "               unique; with a 2-norm up by {} %, constants of element {element} move by {low:+.1} \
                         to {high:+.1} %",
                        100.0 * rise
                    )?;
                }
            }
        }
        Ok(())
    }

    /// What was found for the body as a whole.
    fn of_whole(&self, whole: &WholeReport, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let r = &self.report;
        writeln!(f, "  whole body   {}", whole.words())?;
        for (kind, modulus) in &whole.moduli {
            writeln!(f, "  modulus      {} Pa, {kind}", three_digits(*modulus))?;
        }
        if !whole.states.is_empty() {
            let states = whole.states.iter().map(|(test, size)| format!("{test} {size}"));
            writeln!(f, "  states       {}", states.collect::<Vec<_>>().join(", "))?;
        }
        writeln!(
            f,
            "  residual     {} (springs found element by element: {})",
            three_digits(whole.residual),
            three_digits(whole.residual_of_elements)
        )?;
        if whole.is_open() {
            writeln!(
                f,
                "  open         after {} iterations a gradient of {:.1e} is left: the states hardly tell some constants",
                whole.iterations, whole.gradient
            )?;
        }
        writeln!(
            f,
            "  negative     {} of {} springs (least {} N/m)",
            r.negative_edges,
            self.springs.len(),
            three_digits(r.least_constant)
        )?;
        self.all_tests(f)?;
        writeln!(
            f,
            "In a scene: model = \"mass_spring\", springs = \"FILE.json\", as --out FILE.json writes it"
        )
    }

    fn all_tests(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.assessment, &self.untested) {
            (Some(assessment), _) => self.tests(assessment, f),
            (None, Some(reason)) => writeln!(f, "  tests        not possible: {reason}"),
            (None, None) => Ok(()),
        }
    }

    /// What the virtual tests found.
    fn tests(&self, a: &Assessment, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (e, nu) = (self.young_modulus, self.poisson_ratio);
        if let Some(m) = &a.moduli {
            let e_off = 100.0 * (m.young_modulus / e - 1.0);
            let g = e / (2.0 * (1.0 + nu));
            writeln!(
                f,
                "  measured     E {} Pa ({e_off:+.1} %){}",
                three_digits(m.young_modulus),
                if m.clamped { ", held end clamped" } else { "" }
            )?;
            writeln!(
                f,
                "               nu {:.3} (finite elements {:.3})",
                m.poisson_ratio, m.poisson_ratio_of_fem
            )?;
            if let Some(shear) = m.shear_modulus {
                let off = 100.0 * (shear / g - 1.0);
                writeln!(f, "               G {} Pa ({off:+.1} %)", three_digits(shear))?;
            }
        }
        let title = "Springs against finite elements of the same mesh";
        let table = table_of!("fit-tests", title; for t in &a.tests;
            "test" => &t.test, "e_rms %" => t.rms_percent, "e_max %" => t.max_percent,
            "positive" => if t.definite { "yes" } else { "no" },
            "fit for use" => if t.fit { "yes" } else { "NO" },
        )
        .note(format!(
            "along {}, {} nodes held, {} loaded{}; in percent of the largest displacement of finite elements",
            a.axis,
            a.gripped[0],
            a.gripped[1],
            if a.equal_forces { " with equal forces (no flat end)" } else { "" }
        ));
        writeln!(f, "\n{}", table.text())?;
        let mut lines = a.verdict.iter();
        if let Some(first) = lines.next() {
            writeln!(f, "{first}")?;
        }
        lines.try_for_each(|line| writeln!(f, "  {line}"))
    }
}
