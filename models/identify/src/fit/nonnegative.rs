//! Non-negative Frobenius fit: the active set method of Lawson & Hanson (1974) on the normal equations.
//!
//! Springs are either free or held at 0. The free one with the steepest descent is let go, the free
//! system is solved, and if a constant would become negative the step stops where the first one reaches
//! 0, which is then held. The objective falls with every change of the set, so no set comes back and
//! the search ends.

use nalgebra::DMatrix;

use super::{FitProblem, solve_definite};
use crate::error::ElementError;

/// Descent below this part of the right-hand side is rounding.
const DESCENT: f64 = 1e-12;

/// Constants (N/m), none negative, that minimise `|R - K(k)|_F` among such.
///
/// # Errors
/// [`ElementError::DependentSprings`].
pub fn nonnegative(problem: &FitProblem) -> Result<Vec<f64>, ElementError> {
    let gram = problem.gram();
    let rhs = problem.right_hand_side();
    let count = rhs.len();
    let least = DESCENT * rhs.iter().fold(0f64, |m, r| m.max(r.abs()));
    let mut k = vec![0.0; count];
    let mut free: Vec<usize> = Vec::with_capacity(count);
    // A set never comes back in exact arithmetic; the cap guards against rounding.
    for _ in 0..10 * count {
        let descent = |s: usize| rhs[s] - (0..count).map(|t| gram[(s, t)] * k[t]).sum::<f64>();
        let held = (0..count).filter(|s| !free.contains(s));
        let Some((steepest, _)) = held
            .map(|s| (s, descent(s)))
            .filter(|&(_, d)| d > least)
            .max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        free.push(steepest);
        loop {
            let part = DMatrix::from_fn(free.len(), free.len(), |i, j| gram[(free[i], free[j])]);
            let target: Vec<f64> = free.iter().map(|&s| rhs[s]).collect();
            let target = solve_definite(part, &target)?;
            if target.iter().all(|&t| t > 0.0) {
                for (&s, &t) in free.iter().zip(&target) {
                    k[s] = t;
                }
                break;
            }
            let step = free
                .iter()
                .zip(&target)
                .filter(|&(_, &t)| t <= 0.0)
                .map(|(&s, &t)| k[s] / (k[s] - t))
                .fold(1.0, f64::min);
            // 0/0 when the spring just let go is to go back at once
            let step = if step.is_finite() { step } else { 0.0 };
            let mut blocking = None;
            for (&s, &t) in free.iter().zip(&target) {
                if t <= 0.0 && (k[s] == 0.0 || k[s] / (k[s] - t) <= step) {
                    blocking = Some(s);
                }
                k[s] += step * (t - k[s]);
            }
            let Some(blocking) = blocking else { break };
            k[blocking] = 0.0;
            free.retain(|&s| s != blocking && k[s] > 0.0);
            for s in 0..count {
                if !free.contains(&s) {
                    k[s] = 0.0;
                }
            }
        }
    }
    Ok(k)
}
