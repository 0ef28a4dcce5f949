//! Fits of spring constants to a stiffness matrix.
//!
//! | fit | minimises |
//! |---|---|
//! | [`frobenius`](mod@frobenius) | `\|R - K(k)\|_F` over all `k` (paper B, equation 23) |
//! | [`block`](mod@block) | every off-diagonal block by itself, the closed form printed in paper B (27), (29) |
//! | [`two_norm`](mod@two_norm) | `\|R - K(k)\|_2` (paper B, equation 24), also with `k >= 0` |
//! | [`nonnegative`](mod@nonnegative) | `\|R - K(k)\|_F` over `k >= 0` |

pub mod block;
pub mod freedom;
pub mod frobenius;
pub mod nonnegative;
pub mod two_norm;

use nalgebra::DMatrix;

use crate::error::ElementError;
use crate::springs::spring_stiffness;

pub use block::block;
pub use freedom::ConstantRange;
pub use frobenius::frobenius;
pub use nonnegative::nonnegative;
pub use two_norm::{Sign, two_norm};

/// A constant counts as negative below this part of the largest one; above it is rounding.
const NEGATIVE: f64 = 1e-9;

/// A stiffness to be met by springs: what every fit starts from.
#[derive(Clone, Debug)]
pub struct FitProblem {
    /// Finite element stiffness `R`, N/m.
    pub stiffness: DMatrix<f64>,
    /// Vectors `w_s` of the springs ([`spring_vectors`](crate::springs::spring_vectors)), one column each.
    pub springs: DMatrix<f64>,
    /// Components to a node, 2 or 3.
    pub dimension: usize,
}

impl FitProblem {
    /// `G_st = (w_s . w_t)^2`, the scalar products of the stiffnesses of unit springs.
    pub(crate) fn gram(&self) -> DMatrix<f64> {
        let mut gram = self.springs.tr_mul(&self.springs);
        gram.apply(|g| *g *= *g);
        gram
    }

    /// `w_s^T R w_s`, the scalar product of `R` with the stiffness of a unit spring.
    pub(crate) fn right_hand_side(&self) -> Vec<f64> {
        let product = &self.stiffness * &self.springs;
        (0..self.springs.ncols()).map(|s| product.column(s).dot(&self.springs.column(s))).collect()
    }
}

/// Spring constants of one element and how well they meet its stiffness.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementFit {
    /// Constants (N/m), pairs of nodes in lexicographic order.
    pub constants: Vec<f64>,
    /// `|R - K|_F / |R|_F`.
    pub frobenius_residual: f64,
    /// `|R - K|_2 / |R|_2`.
    pub two_norm_residual: f64,
    /// 2-norm fits: a lower bound of `|R - K|_2 / |R|_2` over all constants (over all non-negative
    /// ones), proved by a dual matrix; how far the residual lies above it is how far at most it is from
    /// the optimum.
    pub two_norm_bound: Option<f64>,
    /// 2-norm fits: dimension of the set of all constants that have the least norm, 0 where the fit is unique
    /// ([`freedom`]).
    pub two_norm_freedom: Option<usize>,
    /// Constants below 0 (by more than 1e-9 of the largest).
    pub negative: usize,
}

impl ElementFit {
    /// Measures `constants` against `problem`.
    pub fn measure(problem: &FitProblem, constants: Vec<f64>) -> Self {
        let residual = &problem.stiffness - spring_stiffness(&problem.springs, &constants);
        let largest = constants.iter().fold(0f64, |m, k| m.max(k.abs()));
        Self {
            frobenius_residual: residual.norm() / problem.stiffness.norm(),
            two_norm_residual: spectral_norm(residual) / spectral_norm(problem.stiffness.clone()),
            two_norm_bound: None,
            two_norm_freedom: None,
            negative: constants.iter().filter(|&&k| k < -NEGATIVE * largest).count(),
            constants,
        }
    }
}

/// Largest magnitude of an eigenvalue of a symmetric matrix.
pub(crate) fn spectral_norm(matrix: DMatrix<f64>) -> f64 {
    matrix.symmetric_eigenvalues().iter().fold(0f64, |m, e| m.max(e.abs()))
}

/// Solves the symmetric positive definite system `gram x = rhs`.
pub(crate) fn solve_definite(gram: DMatrix<f64>, rhs: &[f64]) -> Result<Vec<f64>, ElementError> {
    let factor = gram.cholesky().ok_or(ElementError::DependentSprings)?;
    let mut x = nalgebra::DVector::from_column_slice(rhs);
    factor.solve_mut(&mut x);
    if x.iter().all(|x| x.is_finite()) {
        Ok(x.iter().copied().collect())
    } else {
        Err(ElementError::DependentSprings)
    }
}
