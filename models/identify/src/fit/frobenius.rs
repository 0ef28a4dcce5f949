//! Full Frobenius fit: least squares over all entries of the stiffness.
//!
//! `sum_t (w_s . w_t)^2 k_t = w_s^T R w_s`, a small positive definite system. This is what paper B's
//! equation (23) asks for; the closed forms printed with it, (27) and (29), minimise something else,
//! see [`block`](mod@super::block).

use super::{FitProblem, solve_definite};
use crate::error::ElementError;

/// Constants (N/m) that minimise `|R - K(k)|_F`.
///
/// # Errors
/// [`ElementError::DependentSprings`].
pub fn frobenius(problem: &FitProblem) -> Result<Vec<f64>, ElementError> {
    solve_definite(problem.gram(), &problem.right_hand_side())
}
