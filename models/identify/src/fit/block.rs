//! Off-diagonal-block fit, paper B's closed form.
//!
//! Each off-diagonal block `R_ab` is met by itself in least squares by `-k u u^T`: `k = -u^T R_ab u`.
//! For the square this gives `lambda/3 + mu/2` on the sides and `5 lambda/12 + 3 mu/4` on the
//! diagonals, which is what paper B prints in (27) and (29) as the Frobenius minimiser; the minimiser
//! of the full norm is `5 lambda/21 + 4 mu/7` and `8 lambda/21 + 5 mu/7`.

use super::FitProblem;
use crate::springs::pairs;

/// Constants (N/m) `-u^T R_ab u`.
pub fn block(problem: &FitProblem) -> Vec<f64> {
    let dimension = problem.dimension;
    let nodes = problem.springs.nrows() / dimension;
    pairs(nodes)
        .enumerate()
        .map(|(s, (a, b))| {
            let w = problem.springs.column(s);
            let (a, b) = (a * dimension, b * dimension);
            let mut k = 0.0;
            for i in 0..dimension {
                for j in 0..dimension {
                    // w at `b` is -u
                    k += w[a + i] * problem.stiffness[(a + i, b + j)] * w[b + j];
                }
            }
            k
        })
        .collect()
}
