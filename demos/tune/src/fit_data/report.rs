//! What a fit found, as data and as text.

use super::forward::FitWork;
use super::gradient::Gradient;
use super::observe::{DataFile, DataKind};
use super::parameter::Constant;
use serde::Serialize;
use sinew_scene::summary::Warning;
use std::fmt;

/// Schema of [`DataFitReport`].
pub const SCHEMA: &str = "sinew-fit-data/1";

/// A fitted parameter.
#[derive(Clone, Debug, Serialize)]
pub struct ParameterFit {
    /// `young`, `poisson:REGION` ...
    pub name: String,
    /// What it is.
    pub constant: Constant,
    /// Name of the body.
    pub body: String,
    /// Number of elements that have it.
    pub elements: usize,
    /// Pa, or - for a ratio.
    pub unit: &'static str,
    /// Value in the scene.
    pub start: f64,
    /// Value found.
    pub value: f64,
    /// Whether it was fitted; otherwise the data say nothing about it and it stays at its start.
    pub fitted: bool,
    /// Standard error; none without degrees of freedom, or where the data do not determine it.
    pub standard_error: Option<f64>,
    /// 95 % confidence interval; of a modulus symmetric in its logarithm.
    pub confidence_95: Option<[f64; 2]>,
}

/// How well observations of one file are met.
#[derive(Clone, Debug, Serialize)]
pub struct DataMisfit {
    /// The file.
    #[serde(flatten)]
    pub file: DataFile,
    /// Root mean square of model less observation (m or N).
    pub rms: f64,
    /// The same in percent of the largest observed displacement or force; none when that is zero.
    pub rms_percent: Option<f64>,
    /// Largest difference (m or N).
    pub worst: f64,
}

/// Comparison of the Jacobian with central differences of equilibria.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct GradientCheck {
    /// Largest difference in a column over the largest entry of the column.
    pub worst: f64,
    /// Equilibria that it took.
    pub forward_solves: u64,
}

/// A fit.
#[derive(Clone, Debug, Serialize)]
pub struct DataFitReport {
    /// [`SCHEMA`].
    pub schema: &'static str,
    /// Scene file.
    pub scene: String,
    /// Number of solid elements.
    pub elements: usize,
    /// Parameters in the order in which they were asked for.
    pub parameters: Vec<ParameterFit>,
    /// Correlations of those that were fitted, in their order; none where the data do not determine them.
    pub correlation: Option<Vec<Vec<f64>>>,
    /// Residuals by file.
    pub data: Vec<DataMisfit>,
    /// Whether standard deviations were given with the data; otherwise errors follow from the residual.
    pub given_sigma: bool,
    /// Observed numbers.
    pub observations: usize,
    /// Observed numbers less fitted parameters.
    pub degrees_of_freedom: usize,
    /// Sum of squared residuals over their scales, at the start and at the end.
    pub objective: [f64; 2],
    /// Singular values of the Jacobian of scaled observations by scaled parameters (a modulus by itself, a
    /// ratio by 1/2).
    pub singular_values: Vec<f64>,
    /// Largest over smallest of them; none when it is infinite.
    pub condition: Option<f64>,
    /// How derivatives were found.
    pub gradient: Gradient,
    /// Why not by the implicit function theorem.
    pub gradient_reason: Option<&'static str>,
    /// Comparison with differences, if it was asked for.
    pub gradient_check: Option<GradientCheck>,
    /// Steps of the least-squares method (Jacobians that it asked for).
    pub iterations: u64,
    /// Work.
    pub work: FitWork,
    /// Wall time (s).
    pub seconds: f64,
    /// Whether the least-squares method has converged.
    pub converged: bool,
    /// How it ended.
    pub termination: String,
    /// What went wrong.
    pub failure: Option<String>,
    /// What was found in the scene and in the fit.
    pub warnings: Vec<Warning>,
}

/// A value with its unit.
fn with_unit(value: f64, unit: &str) -> String {
    if unit == "-" { format!("{value:.6}") } else { format!("{value:.6e} {unit}") }
}

impl fmt::Display for DataFitReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "Fit of {} ({} solid elements)", self.scene, self.elements)?;
        writeln!(f, "\nParameters")?;
        for p in &self.parameters {
            write!(f, "  {:<20} {}", p.name, with_unit(p.value, p.unit))?;
            match (p.standard_error, p.confidence_95) {
                (Some(error), Some([low, high])) => writeln!(
                    f,
                    "  standard error {error:.2e}, 95 % within {} .. {}",
                    with_unit(low, p.unit),
                    with_unit(high, p.unit)
                )?,
                _ if !p.fitted => writeln!(f, "  NOT FITTED, as in the scene")?,
                _ => writeln!(f, "  no standard error")?,
            }
            if p.fitted {
                writeln!(f, "  {:<20} from {}", "", with_unit(p.start, p.unit))?;
            }
        }
        let fitted: Vec<&ParameterFit> = self.parameters.iter().filter(|p| p.fitted).collect();
        if let Some(correlation) = self.correlation.as_ref().filter(|c| c.len() > 1) {
            writeln!(f, "\nCorrelations")?;
            for (p, row) in fitted.iter().zip(correlation) {
                let row: Vec<String> = row.iter().map(|x| format!("{x:7.3}")).collect();
                writeln!(f, "  {:<20} {}", p.name, row.join(" "))?;
            }
        }
        writeln!(f, "\nResiduals")?;
        for m in &self.data {
            let what = match m.file.kind {
                DataKind::Displacements => "displacement",
                DataKind::Forces => "force",
            };
            let unit = m.file.kind.unit();
            let (path, file) = (m.file.path.display(), &m.file);
            write!(f, "  {path}: {} numbers in {} rows, ", file.observations, file.rows)?;
            write!(f, "rms {:.3e} {unit}", m.rms)?;
            if let Some(percent) = m.rms_percent {
                write!(f, " ({percent:.3e} % of the largest {what})")?;
            }
            writeln!(f, ", largest {:.3e} {unit}", m.worst)?;
            if m.file.farthest_vertex > 0.0 {
                let far = m.file.farthest_vertex;
                writeln!(f, "    positions up to {far:.3e} m from the nearest vertex")?;
            }
        }
        let spread = if self.given_sigma { "given" } else { "from the residual" };
        writeln!(
            f,
            "  sum of squares {:.4e} -> {:.4e}, {} degrees of freedom, standard deviation {spread}",
            self.objective[0], self.objective[1], self.degrees_of_freedom
        )?;
        writeln!(f, "\nHow it went")?;
        let w = &self.work;
        writeln!(
            f,
            "  {} iterations, {} evaluations ({} refused), {} equilibria ({} cold), {} Newton \
             iterations, {:.2} s",
            self.iterations,
            w.evaluations,
            w.refused,
            w.forward_solves,
            w.cold_starts,
            w.newton_iterations,
            self.seconds
        )?;
        match self.gradient {
            Gradient::Differences => writeln!(
                f,
                "  {} Jacobians from differences of equilibria ({})",
                w.jacobians,
                self.gradient_reason.unwrap_or_default()
            )?,
            by => writeln!(
                f,
                "  {} Jacobians by the implicit function theorem ({}), {} linear solves",
                w.jacobians,
                match by {
                    Gradient::Adjoint => "adjoint",
                    Gradient::Mixed => "direct and adjoint",
                    _ => "direct",
                },
                w.linear_solves
            )?,
        }
        if let Some(check) = &self.gradient_check {
            writeln!(
                f,
                "  Jacobian against central differences: {:.1e} ({} equilibria)",
                check.worst, check.forward_solves
            )?;
        }
        match self.condition {
            Some(condition) => writeln!(f, "  condition of the scaled Jacobian {condition:.2e}")?,
            None => writeln!(f, "  the scaled Jacobian is singular")?,
        }
        writeln!(f, "  {}", self.termination)?;
        if !self.warnings.is_empty() {
            writeln!(f)?;
            for warning in &self.warnings {
                writeln!(f, "{warning}")?;
            }
        }
        if let Some(failure) = &self.failure {
            writeln!(f, "\nNOT FOUND: {failure}")?;
        }
        Ok(())
    }
}
