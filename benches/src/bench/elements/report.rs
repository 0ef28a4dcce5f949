//! What the rows of the kinds of elements say: verdicts, tables, charts.

use super::ElementTruth;
use super::{CAPPED, DENSITY, Discretisation, ElementBody, ElementReport, ElementRow, KINDS, SIZE};
use crate::toolbox::aim::BenchAim;
use crate::toolbox::plot::{self, ChartPanel, Series};
use crate::toolbox::prelude::*;
use sinew_tune::table::three_digits;
use std::collections::BTreeSet;

/// Colours of [`KINDS`]: a rival's elements have that of ours of the same kind.
const COLOURS: [usize; 9] = [0, 1, 2, 3, 4, 0, 2, 3, 6];

/// Time at which a curve of (time, error) points reaches an error, by straight lines in logarithms, and whether that lies
/// outside of what was measured. None where the errors do not fall towards it.
pub fn time_at_error(curve: &[[f64; 2]], error: f64) -> Option<(f64, bool)> {
    let mut points: Vec<[f64; 2]> =
        curve.iter().filter(|p| p.iter().all(|x| *x > 0.0 && x.is_finite())).copied().collect();
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let through = |[a, b]: [[f64; 2]; 2]| {
        let share = (error / a[1]).ln() / (b[1] / a[1]).ln();
        let time = a[0] * (share * (b[0] / a[0]).ln()).exp();
        (b[1] < a[1] && time.is_finite()).then_some(time)
    };
    let pairs = || points.windows(2).map(|w| [w[0], w[1]]);
    let inside = pairs().find(|[a, b]| a[1] >= error && b[1] <= error);
    if let Some(pair) = inside {
        return through(pair).map(|t| (t, false));
    }
    let (first, last) = (points.first()?, points.last()?);
    let end = match () {
        () if error > first[1] => pairs().next()?,
        () if error < last[1] => pairs().next_back()?,
        () => return None,
    };
    through(end).map(|t| (t, true))
}

/// Time of the cheapest measured or interpolated point of a curve with at most this error; nothing is extrapolated.
pub fn time_within(curve: &[[f64; 2]], error: f64) -> Option<f64> {
    let measured = curve.iter().filter(|p| p[1] <= error).map(|p| p[0]).min_by(f64::total_cmp);
    let between = time_at_error(curve, error).filter(|(_, outside)| !outside).map(|(t, _)| t);
    measured.into_iter().chain(between).min_by(f64::total_cmp)
}

/// Errors within this share of the smallest are the same.
const SAME: f64 = 0.02;

/// The cheapest of the rows that are as exact as the best.
fn cheapest_of_best<R>(rows: Vec<(R, [f64; 2])>) -> Option<(R, [f64; 2])> {
    let least = rows.iter().map(|(_, p)| p[1]).min_by(f64::total_cmp)?;
    let best = rows.into_iter().filter(|(_, p)| p[1] <= (1.0 + SAME) * least);
    best.min_by(|a, b| a.1[0].total_cmp(&b.1[0]))
}

/// The same points, cheapest first, no error smaller than that of a dearer one: a coarse mesh may come near by chance, where
/// the error changes its sign.
pub fn without_luck(mut curve: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    curve.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut worst = 0.0_f64;
    for p in curve.iter_mut().rev() {
        worst = worst.max(p[1]);
        p[1] = worst;
    }
    curve
}

/// Most that a safe step with clusters at 0.4999 may cost over a plain one at 0.45.
const CLUSTER_STEP: f64 = 1.5;
/// Most iterations by which clusters at 0.49 and 0.4999 may differ.
const CLUSTER_ITERATIONS: f64 = 2.0;
/// Largest share of the time of linear tetrahedra that ten-node tetrahedra may take at equal static error.
const TEN_NODE_SHARE: f64 = 0.2;
/// Errors are compared that are so many times what the continuum is known to.
const SURE: f64 = 2.0;
/// Largest share of the time of a rival that the best kind of ours may take at equal static error.
const RIVAL_SHARE: f64 = 0.2;

impl ElementReport {
    fn of(&self, kind: &str, poisson_ratio: f64) -> impl Iterator<Item = &ElementRow> {
        self.rows.iter().filter(move |r| r.kind == kind && r.poisson_ratio == poisson_ratio)
    }

    /// Points (ms, static error) of a kind.
    fn curve(&self, kind: &str, poisson_ratio: f64) -> Vec<[f64; 2]> {
        self.of(kind, poisson_ratio).filter_map(ElementRow::point).collect()
    }

    /// Points of a kind for the chart: of a rival on each mesh the cheapest setting that is as exact as its best, since fewer
    /// iterations may do.
    pub fn drawn(&self, kind: &str, poisson_ratio: f64) -> Vec<[f64; 2]> {
        let settings = self.rows.iter().filter(|r| {
            let rest = r.kind.strip_prefix(kind);
            r.poisson_ratio == poisson_ratio && rest.is_some_and(|s| s.is_empty() || s == CAPPED)
        });
        let rows: Vec<(&ElementRow, [f64; 2])> =
            settings.filter_map(|r| r.point().map(|p| (r, p))).collect();
        let levels: BTreeSet<usize> = rows.iter().map(|(r, _)| r.level).collect();
        let of = |level| rows.iter().filter(|(r, _)| r.level == level).copied().collect();
        levels.into_iter().filter_map(|l| cheapest_of_best(of(l)).map(|(_, p)| p)).collect()
    }

    /// What follows the name of a mesh, where it is not that of the beam.
    fn of_body(&self) -> &'static str {
        ["", " of the liver"][self.body as usize]
    }

    /// How well (%) the converged continuum is known.
    fn own_percent(&self, poisson_ratio: f64) -> Option<f64> {
        let of = |t: &&ElementTruth| t.poisson_ratio == poisson_ratio;
        self.truths.iter().find(of).map(|t| t.own_percent)
    }

    fn ratios(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.rows.iter().map(|r| r.poisson_ratio).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    /// What was aimed at, as far as it was measured. The limits were fixed before.
    pub fn aims(&self) -> Vec<BenchAim> {
        let mut aims = Vec::new();
        let [linear, clusters, _, ten_node, _] = Discretisation::ALL.map(Discretisation::name);
        let on = |kind, nu, level| self.of(kind, nu).find(move |r| r.level == level);
        let body = self.of_body();
        for r in self.of(clusters, 0.4999) {
            let plain = on(linear, 0.45, r.level).and_then(|p| p.ms);
            if let Some((ms, plain)) = r.ms.zip(plain) {
                let what = format!(
                    "safe step with clusters at nu 0.4999 over the plain one at 0.45, {}{body}",
                    r.mesh
                );
                aims.push(BenchAim::at_most(what, CLUSTER_STEP, "x", ms.median / plain.median));
            }
        }
        let differences = self.of(clusters, 0.4999).filter_map(|r| {
            let other = on(clusters, 0.49, r.level)?.iterations?;
            Some((r.iterations? - other).abs())
        });
        if let Some(found) = differences.reduce(f64::max) {
            let what = "iterations per step of clusters at nu 0.49 and 0.4999, largest difference";
            aims.push(BenchAim::at_most(what, CLUSTER_ITERATIONS, "", found));
        }
        for (nu, other) in [(0.3, linear), (0.4999, clusters)] {
            let curve = self.curve(other, nu);
            for r in self.of(ten_node, nu) {
                let Some([ms, error]) = r.point() else { continue };
                // the continuum is known no better
                if self.own_percent(nu).is_some_and(|own| error < SURE * own) {
                    continue;
                }
                let Some((time, outside)) = time_at_error(&curve, error) else { continue };
                let what = format!(
                    "ten-node tetrahedra over {other} at an equal static error of {} %, nu {nu}, {}{body}{}",
                    three_digits(error),
                    r.mesh,
                    if outside { " (extrapolated)" } else { "" }
                );
                aims.push(BenchAim::at_most(what, TEN_NODE_SHARE, "x", ms / time));
            }
        }
        for nu in self.ratios() {
            for engine in ["MuJoCo", "Rapier"] {
                let theirs =
                    self.rows.iter().filter(|r| r.poisson_ratio == nu && r.engine == engine);
                // as exact as no finer mesh of its kind contradicts
                let sure = |r: &ElementRow| {
                    let [ms, _] = r.point()?;
                    let curve = without_luck(self.curve(&r.kind, nu));
                    curve.into_iter().find(|p| p[0] == ms)
                };
                let theirs = theirs.filter_map(|r| sure(r).map(|p| (r, p))).collect();
                let Some((row, [ms, error])) = cheapest_of_best(theirs) else { continue };
                let curves = Discretisation::ALL.map(|k| without_luck(self.curve(k.name(), nu)));
                let least = |of: &dyn Fn(&Vec<[f64; 2]>) -> Option<f64>| {
                    curves.iter().filter_map(of).min_by(f64::total_cmp)
                };
                let ours = least(&|curve| time_within(curve, error));
                let beyond = least(&|curve| time_at_error(curve, error).map(|(t, _)| t));
                let what = format!(
                    "our best elements over {} {}{body} at its least static error of {} %{}, nu {nu}{}",
                    row.kind,
                    row.mesh,
                    three_digits(error),
                    // there is no other Rapier
                    if engine == "Rapier" { " (ours f64, theirs f32)" } else { "" },
                    if ours.is_some() { "" } else { " (extrapolated)" }
                );
                // JSON has no infinity: without any elements that get there, the largest number
                let found = ours.or(beyond).map_or(f64::MAX, |t| t / ms);
                aims.push(BenchAim::at_most(what, RIVAL_SHARE, "x", found));
            }
        }
        aims
    }

    /// Tables: the rows, the converged solutions.
    pub fn tables(&self) -> Vec<Table> {
        let ([name, name_equal, name_truth], shape) = (self.body.tables(), self.body.words());
        let [young, gravity] = self.body.load();
        let title = format!("Kinds of elements: {shape}, steps of 10 ms");
        let size = match self.body {
            ElementBody::Beam => format!("Beam {} x {} x {} m", SIZE.x, SIZE.y, SIZE.z),
            ElementBody::Liver => {
                "Liver of 0.20 m, coarse mesh of the demos, edges in parts".into()
            }
        };
        let mut rows = table_of!(name, title; for r in &self.rows;
            "nu" => r.poisson_ratio.to_string(), "kind" => &r.kind, "mesh" => &r.mesh,
            "elements" => r.elements, "vertices" => r.vertices, "ms/step" => r.ms.map(|m| m.median),
            "least ms" => r.ms.map(|m| m.minimum), "its/step" => r.iterations,
            "static error %" => r.static_percent, "step error %" => r.step_percent,
            "swing error %" => r.swing_percent, "threads" => r.threads, "precision" => &r.precision,
            "note" => &r.note,
        )
        .note(format!(
            "{size}, E {} kPa, density {DENSITY} kg/m^3, gravity {gravity} m/s^2. Sinew: neo-Hookean, safe \
             steps, linear residual 1e-3. ms/step: undamped steps from half the equilibrium, in turns.",
            young / 1e3
        ))
        .note(
            "static error: largest distance of a vertex of the equilibrium (of a rival: of its settled state) from the \
             converged continuum, over the largest displacement. step error: the same over 0.5 s of swing, against \
             converged Newton steps of the same length on the same mesh. swing error: against the fine motion; most of \
             it is the damping of first-order steps of 10 ms.",
        );
        for reason in &self.skipped {
            rows = rows.note(format!("Not run: {reason}"));
        }
        let truths = table_of!(name_truth, format!("The converged continuum: {shape}"); for t in &self.truths;
            "nu" => t.poisson_ratio.to_string(), "mesh" => &t.mesh, "largest mm" => 1e3 * t.largest,
            "coarser by %" => t.coarser_percent, "order" => t.order, "own error %" => t.own_percent,
            "swing's own %" => t.swing_own_percent, "swing coarser by %" => t.swing_coarser_percent,
            "StVK off %" => t.energies_percent[0], "corotational off %" => t.energies_percent[1],
            "took s" => t.seconds,
        )
        .note(
            "Ten-node tetrahedra with one volume ratio each; own error by Richardson from meshes of half and a quarter of \
             the cells along each edge. The swing: TR-BDF2 in steps of 5 ms on half these cells; coarser: on a quarter; own \
             error: a third of what steps of 10 ms change, and by the same order what the mesh leaves. StVK and corotational: distance of these equilibria from the neo-Hookean \
             one, all on the same ten-node tetrahedra.",
        );
        let equal = table_of!(name_equal, format!("What rivals take at equal static error: {shape}");
            for (r, [ms, error], best) in self.at_equal_error();
            "nu" => r.poisson_ratio.to_string(), "rival" => &r.kind, "mesh" => &r.mesh,
            "static error %" => error, "its ms" => ms, "our ms" => best.map(|(_, t)| t),
            "its over ours" => best.map(|(_, t)| ms / t), "our elements" => best.map(|(kind, _)| kind.name()),
        )
        .note(
            "our ms: the cheapest of our kinds with at most this error, measured or on the line between two meshes; none \
             where no mesh of ours is as exact. A mesh of ours counts as no more exact than the finer ones of its kind: \
             coarse ones may come near by chance. Errors above some 50 % say that the body hardly moves.",
        );
        vec![rows, equal, truths]
    }

    /// Every rival's row with its time and error, and our cheapest elements that are as exact.
    pub fn at_equal_error(
        &self,
    ) -> impl Iterator<Item = (&ElementRow, [f64; 2], Option<(Discretisation, f64)>)> {
        let rivals = self.rows.iter().filter(|r| r.engine != "Sinew");
        rivals.filter_map(|r| r.point().map(|p| (r, p))).map(|(r, p)| {
            let ours = Discretisation::ALL.into_iter().filter_map(|kind| {
                let curve = without_luck(self.curve(kind.name(), r.poisson_ratio));
                time_within(&curve, p[1]).map(|t| (kind, t))
            });
            (r, p, ours.min_by(|a, b| a.1.total_cmp(&b.1)))
        })
    }

    /// The chart: one for each Poisson's ratio, then all in one picture.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub fn charts(&self) -> Result<Vec<Chart>> {
        let panel = |nu: f64| ChartPanel {
            name: format!("{}-{nu}", self.body.name()),
            title: format!("Static error against time of a step{}, nu {nu}", self.of_body()),
            series: (KINDS.iter().enumerate())
                .map(|(i, kind)| {
                    Series::new(*kind, self.drawn(kind, nu), COLOURS[i])
                        .hollow(i >= Discretisation::ALL.len())
                })
                .collect(),
        };
        let panels: Vec<ChartPanel> = self.ratios().into_iter().map(panel).collect();
        let axes = ["ms per step of 10 ms, one thread", "static error (%)"];
        plot::panels(self.body.name(), axes, &panels, true)
    }
}

impl ElementRow {
    /// Time (ms) and static error (%), where both are there.
    fn point(&self) -> Option<[f64; 2]> {
        Some([self.ms?.median, self.static_percent?])
    }
}
