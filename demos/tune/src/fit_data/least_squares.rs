//! The least-squares problem as the crate `levenberg-marquardt` sees it.

use super::error::{DataFitError, Result};
use super::forward::Forward;
use super::observe::Observation;
use super::parameter::Parameter;
use super::residuals;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use std::cell::RefCell;

/// Relative change of unknowns at which the method has converged.
const STEP_TOLERANCE: f64 = 1e-8;
/// Relative change of the sum of squares, and cosine between residual and derivatives, likewise.
const TOLERANCE: f64 = 1e-10;
/// Evaluations per parameter, plus as many.
const PATIENCE: usize = 50;
/// Residual of parameters without equilibrium, over the last one: makes the method take a shorter step.
const REFUSED: f64 = 1e3;

/// Where the method ended.
pub(super) struct FitOutcome {
    pub forward: Forward,
    pub values: Vec<f64>,
    pub iterations: u64,
    pub converged: bool,
    pub termination: String,
}

/// Parameters at which residuals and Jacobian are asked for.
struct FitProblem<'a> {
    parameters: &'a [Parameter],
    observed: &'a [Observation],
    unknowns: DVector<f64>,
    residual: DVector<f64>,
    /// The last residual that belongs to equilibria.
    found: DVector<f64>,
    forward: RefCell<Forward>,
    jacobians: RefCell<u64>,
    /// What stopped the method.
    error: RefCell<Option<DataFitError>>,
}

impl FitProblem<'_> {
    fn values(&self) -> Vec<f64> {
        let all = self.parameters.iter().zip(self.unknowns.iter());
        all.map(|(p, &x)| p.value(x)).collect()
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for FitProblem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.unknowns.copy_from(x);
        let values = self.values();
        let forward = self.forward.get_mut();
        match forward.solve(self.parameters, &values) {
            Ok(()) => {
                let predictions = forward.predictions(self.observed);
                self.found = DVector::from_vec(residuals(self.observed, &predictions));
                self.residual.copy_from(&self.found);
            }
            Err(_) => {
                // all observations far off, whatever was found before
                let size = REFUSED * self.found.amax().max(1.0);
                self.residual.fill(size);
            }
        }
    }

    fn params(&self) -> DVector<f64> {
        self.unknowns.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.residual.clone())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        *self.jacobians.borrow_mut() += 1;
        let mut forward = self.forward.borrow_mut();
        match forward.jacobian(self.parameters, &self.values(), self.observed) {
            Ok((mut jacobian, _)) => {
                for (j, mut column) in jacobian.column_iter_mut().enumerate() {
                    let slope = self.parameters[j].slope(self.unknowns[j]);
                    for (entry, o) in column.iter_mut().zip(self.observed) {
                        *entry *= slope / o.scale;
                    }
                }
                Some(jacobian)
            }
            Err(error) => {
                *self.error.borrow_mut() = Some(error);
                None
            }
        }
    }
}

/// Minimises over the parameters from their starts. The equilibria of `forward` are those of the result
/// afterwards.
pub(super) fn minimise(
    mut forward: Forward,
    parameters: &[Parameter],
    observed: &[Observation],
) -> Result<FitOutcome> {
    let start: Vec<f64> = parameters.iter().map(|p| p.start).collect();
    forward.solve(parameters, &start)?;
    let residual = DVector::from_vec(residuals(observed, &forward.predictions(observed)));
    let problem = FitProblem {
        parameters,
        observed,
        unknowns: DVector::from_element(parameters.len(), 1.0),
        found: residual.clone(),
        residual,
        forward: RefCell::new(forward),
        jacobians: RefCell::new(0),
        error: RefCell::new(None),
    };
    // unknowns are of the same size by design, and a step of 1 is a factor e on a modulus
    let method = LevenbergMarquardt::new()
        .with_xtol(STEP_TOLERANCE)
        .with_ftol(TOLERANCE)
        .with_gtol(TOLERANCE)
        .with_stepbound(1.0)
        .with_scale_diag(false)
        .with_patience(PATIENCE);
    let (problem, report) = method.minimize(problem);
    if let Some(error) = problem.error.into_inner() {
        return Err(error);
    }
    let all = parameters.iter().zip(problem.unknowns.iter());
    let values: Vec<f64> = all.map(|(p, &x)| p.value(x)).collect();
    let mut forward = problem.forward.into_inner();
    forward.solve(parameters, &values)?;
    let (converged, termination) = match report.termination {
        TerminationReason::ResidualsZero => (true, "the residual is zero".into()),
        TerminationReason::Orthogonal => {
            (true, "converged: no change of parameters lowers the residual".into())
        }
        TerminationReason::Converged { ftol: true, .. } => {
            (true, "converged: the sum of squares no longer changes".into())
        }
        TerminationReason::Converged { .. } => {
            (true, "converged: the parameters no longer change".into())
        }
        TerminationReason::NoImprovementPossible(_) => {
            (true, "converged to rounding: nothing changes any more".into())
        }
        TerminationReason::LostPatience => {
            (false, format!("{} evaluations did not suffice", report.number_of_evaluations))
        }
        other => (false, format!("{other:?}")),
    };
    let iterations = problem.jacobians.into_inner();
    Ok(FitOutcome { forward, values, iterations, converged, termination })
}
