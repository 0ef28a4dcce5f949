//! What came out, as data and as a table.

use super::CaseError;
use super::compare::{difference, largest, worst};
use glam::DVec3;
use serde::Serialize;
use sinew::models::body::Evaluation;
use std::fmt;
use std::path::PathBuf;

/// How a case ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Within the tolerance.
    Pass,
    /// Not within the tolerance, not converged, or a file that cannot be used; the note tells.
    Fail,
    /// A figure is not within its bound, which is known, with the reason.
    Missed(String),
    /// Not run, with the reason.
    Unsupported(String),
}

/// A figure of a row and what it must be within.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValidationCheck {
    /// What it is.
    pub what: String,
    /// The figure.
    pub value: f64,
    /// Least one that passes, if there is one.
    pub least: Option<f64>,
    /// Largest one that passes.
    pub most: f64,
}

impl ValidationCheck {
    /// Whether the figure is within its bounds; a NaN is not.
    pub fn passed(&self) -> bool {
        self.value <= self.most && self.least.is_none_or(|least| self.value >= least)
    }
}

impl fmt::Display for ValidationCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |x: f64| match x.abs() {
            0.001..1e5 => format!("{x:.4}"),
            0.0 => "0".into(),
            _ => format!("{x:.1e}"),
        };
        let missed = if self.passed() { "" } else { "MISSED: " };
        let least = self.least.map_or_else(String::new, |least| format!("{} <= ", number(least)));
        write!(f, "{missed}{} {least}{} <= {}", self.what, number(self.value), number(self.most))
    }
}

/// One row of the table: a case and a law.
#[derive(Clone, Debug, Serialize)]
pub struct ValidationRow {
    /// Case name.
    pub case: String,
    /// Law, or quantity for trajectories.
    pub law: String,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Cells of the mesh.
    pub cells: usize,
    /// How it ended.
    pub status: Status,
    /// Largest node difference over largest displacement (over body size for trajectories).
    pub max_difference: f64,
    /// Root mean square node difference over the same.
    pub rms_difference: f64,
    /// Relative difference of energy.
    pub energy_difference: f64,
    /// Largest difference of a group's reaction over the largest reaction.
    pub reaction_difference: f64,
    /// Difference to the continuum (or to the time-converged trajectory), rms in percent of the
    /// largest displacement.
    pub continuum_rms_percent: f64,
    /// The same, largest node.
    pub continuum_max_percent: f64,
    /// Newton iterations.
    pub newton_iterations: u64,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u64,
    /// Wall time (s).
    pub seconds: f64,
    /// Figures with bounds of their own, where a row has any.
    pub checks: Vec<ValidationCheck>,
    /// Remarks: load steps, follower loads, caps, errors.
    pub note: String,
}

impl ValidationRow {
    pub(super) fn new(case: &str, law: &str, nodes: usize, cells: usize) -> Self {
        Self {
            case: case.into(),
            law: law.into(),
            nodes,
            cells,
            status: Status::Fail,
            max_difference: f64::NAN,
            rms_difference: f64::NAN,
            energy_difference: f64::NAN,
            reaction_difference: f64::NAN,
            continuum_rms_percent: f64::NAN,
            continuum_max_percent: f64::NAN,
            newton_iterations: 0,
            cg_iterations: 0,
            seconds: 0.0,
            checks: Vec::new(),
            note: String::new(),
        }
    }

    /// The row when its case has ended, possibly with an error.
    pub(super) fn ended(mut self, outcome: Result<(), CaseError>) -> Self {
        match outcome {
            Ok(()) => {}
            Err(CaseError::NotRun(why)) => self.status = Status::Unsupported(why),
            Err(error) => {
                self.status = Status::Fail;
                self.remark(error.to_string());
            }
        }
        self
    }

    /// Notes a figure that must be at most so large.
    pub(super) fn at_most(&mut self, what: &str, value: f64, most: f64) {
        self.checks.push(ValidationCheck { what: what.into(), value, least: None, most });
    }

    /// Notes a figure that must be within bounds.
    pub(super) fn within(&mut self, what: &str, value: f64, [least, most]: [f64; 2]) {
        self.checks.push(ValidationCheck { what: what.into(), value, least: Some(least), most });
    }

    /// Passes when every figure is within its bounds. A miss may be known for a reason; one that is none any more fails, too.
    pub(super) fn judge(&mut self, known_miss: Option<&str>) {
        let passed = self.checks.iter().all(ValidationCheck::passed);
        self.status = match known_miss {
            Some(why) if !passed => Status::Missed(why.into()),
            None if passed => Status::Pass,
            _ => Status::Fail,
        };
        if passed && known_miss.is_some() {
            self.remark("`known_miss` is missed no longer: take it out".into());
        }
        self.checks
            .iter()
            .rev()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .into_iter()
            .for_each(|c| self.remark(c));
    }

    /// Notes a field, unless one that differed more from its truth was noted before.
    pub(super) fn worst_fields(&mut self, own: &[DVec3], truth: &[DVec3]) {
        self.worst_over(own, truth, largest(truth));
    }

    /// The same, over another size than that of the truth.
    pub(super) fn worst_over(&mut self, own: &[DVec3], truth: &[DVec3], size: f64) {
        let (max, rms) = difference(own, truth, size);
        self.max_difference = worst(self.max_difference, max);
        self.rms_difference = worst(self.rms_difference, rms);
    }

    /// The same of an energy.
    pub(super) fn worst_energy(&mut self, own: f64, truth: f64) {
        self.energy_difference = worst(self.energy_difference, (own / truth - 1.0).abs());
    }

    /// Notes how far a field is from that of the continuum, over `size`.
    pub(super) fn beside_continuum(&mut self, own: &[DVec3], continuum: &[DVec3], size: f64) {
        let (max, rms) = difference(own, continuum, size);
        (self.continuum_max_percent, self.continuum_rms_percent) = (100.0 * max, 100.0 * rms);
    }

    /// Puts a remark before those that are there.
    pub(super) fn remark(&mut self, remark: String) {
        let separator = if self.note.is_empty() { "" } else { "; " };
        self.note = format!("{remark}{separator}{}", self.note);
    }
}

/// All rows.
#[derive(Clone, Debug, Serialize)]
pub struct ValidationReport {
    /// Schema of the JSON form.
    pub schema: &'static str,
    /// Files and folders of the cases; the folder that comes with Sinew when none was named.
    pub cases: Vec<PathBuf>,
    /// Evaluation used.
    pub evaluation: Evaluation,
    /// One row per case and law.
    pub rows: Vec<ValidationRow>,
}

impl ValidationReport {
    /// Whether cases were run and every one of them passed.
    pub fn passed(&self) -> bool {
        let [passed, failed, _] = self.counts();
        passed > 0 && failed == 0
    }

    /// How many rows passed, failed and were not run. A known miss is none of them.
    pub fn counts(&self) -> [usize; 3] {
        let mut counts = [0; 3];
        for row in &self.rows {
            let i = match row.status {
                Status::Pass => 0,
                Status::Fail => 1,
                Status::Unsupported(_) => 2,
                Status::Missed(_) => continue,
            };
            counts[i] += 1;
        }
        counts
    }

    /// The reasons of rows that were not run, each with their number, in the order of the table.
    fn reasons(&self) -> Vec<(&str, usize)> {
        let mut reasons: Vec<(&str, usize)> = Vec::new();
        for row in &self.rows {
            let Status::Unsupported(why) = &row.status else { continue };
            match reasons.iter_mut().find(|(known, _)| known == why) {
                Some((_, count)) => *count += 1,
                None => reasons.push((why, 1)),
            }
        }
        reasons
    }
}

impl fmt::Display for ValidationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<26} {:<20} {:>5} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8} {:>13} {:>7} {:>8} {:>7}  note",
            "case",
            "law",
            "nodes",
            "cells",
            "result",
            "max rel",
            "rms rel",
            "energy",
            "reaction",
            "continuum %",
            "newton",
            "cg",
            "s"
        )?;
        for row in &self.rows {
            writeln!(f, "{row}")?;
        }
        let [passed, failed, not_run] = self.counts();
        let missed = self.rows.len() - passed - failed - not_run;
        writeln!(
            f,
            "\n{passed} passed, {failed} failed, {missed} known misses, {not_run} not run"
        )?;
        for (why, count) in self.reasons() {
            writeln!(f, "  {count} not run: {why}")?;
        }
        if passed + failed == 0 {
            writeln!(f, "nothing was run, which counts as a failure")?;
        }
        let cases: Vec<_> = self.cases.iter().map(|path| path.display().to_string()).collect();
        writeln!(f, "cases: {}", cases.join(", "))
    }
}

impl fmt::Display for ValidationRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scientific = |x: f64| {
            if x.is_nan() { "-".to_string() } else { format!("{x:.1e}") }
        };
        let (result, note) = match &self.status {
            Status::Pass => ("ok", &self.note),
            Status::Fail => ("FAIL", &self.note),
            Status::Missed(why) => ("missed", &format!("{}; known: {why}", self.note)),
            Status::Unsupported(why) => ("-", why),
        };
        let continuum = if self.continuum_rms_percent.is_nan() {
            "-".into()
        } else {
            format!("{:.2} / {:.2}", self.continuum_rms_percent, self.continuum_max_percent)
        };
        write!(
            f,
            "{:<26} {:<20} {:>5} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8} {:>13} {:>7} {:>8} {:>7.2}  {}",
            self.case,
            self.law,
            self.nodes,
            self.cells,
            result,
            scientific(self.max_difference),
            scientific(self.rms_difference),
            scientific(self.energy_difference),
            scientific(self.reaction_difference),
            continuum,
            self.newton_iterations,
            self.cg_iterations,
            self.seconds,
            note,
        )
    }
}
