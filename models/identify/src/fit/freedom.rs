//! How far constants may move before a 2-norm fit gets worse: where it is not unique, and how flat it is elsewhere.
//!
//! The norm `t` of `M = R - K(k)` is taken in the eigenvectors `P` of `M` whose eigenvalue is `t` or `-t`. A change `d` of
//! constants with `K(d) P = 0` leaves `M` as it is on them, so the norm stays until another eigenvalue reaches `t`. The
//! barrier of [`two_norm`](mod@super::two_norm) ends in the middle of all constants that have the least norm, so the number
//! of such directions `d` is the dimension of that set: 0 where the fit is unique. On a square, paper B's own element, it
//! is 2: the norm is taken in stretch along the sides and in the hourglass modes, and diagonals feel neither.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::{FitProblem, spectral_norm};
use crate::springs::spring_stiffness;

/// Part of the norm within which an eigenvalue has it; norm and lower bound of a fit differ by 1e-6 at most.
const ACTIVE: f64 = 1e-4;
/// Eigenvalue, relative to the largest, below which a direction changes nothing in the active eigenvectors.
const FREE: f64 = 1e-10;
/// Part of a group of springs that must be free for the group to count as free.
const OWN: f64 = 0.5;
/// Relative rise of the norm that is rounding.
const SAME: f64 = 1e-9;
/// A residual of this size, relative to the stiffness, is rounding: the springs are exact.
const EXACT: f64 = 1e-12;

/// Constants that springs of one rest length may have, all of them together, and the other springs stay as they are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConstantRange {
    /// The springs, by their place in the lexicographic order of pairs.
    pub springs: Vec<usize>,
    /// Their mean constant (N/m) in the fit.
    pub constant: f64,
    /// Least and largest mean constant (N/m).
    pub range: [f64; 2],
}

/// Directions of constants in which the 2-norm of a fit does not change, as orthonormal columns; none where the fit is
/// unique or the springs are exact.
pub(crate) fn free_directions(problem: &FitProblem, constants: &[f64]) -> DMatrix<f64> {
    let w = &problem.springs;
    let eigen = residual(problem, constants).symmetric_eigen();
    let norm = eigen.eigenvalues.iter().fold(0f64, |m, e| m.max(e.abs()));
    if norm <= EXACT * spectral_norm(problem.stiffness.clone()) {
        return DMatrix::zeros(w.ncols(), 0);
    }
    let active = (0..w.nrows()).filter(|&i| eigen.eigenvalues[i].abs() > (1.0 - ACTIVE) * norm);
    let active: Vec<usize> = active.collect();
    let felt = eigen.eigenvectors.select_columns(&active).tr_mul(w);
    // |K(d) P|^2 = d^T G d
    let gram = w.tr_mul(w).component_mul(&felt.tr_mul(&felt)).symmetric_eigen();
    let largest = gram.eigenvalues.max();
    let free = (0..w.ncols()).filter(|&i| gram.eigenvalues[i] < FREE * largest);
    gram.eigenvectors.select_columns(&free.collect::<Vec<_>>())
}

fn residual(problem: &FitProblem, constants: &[f64]) -> DMatrix<f64> {
    &problem.stiffness - spring_stiffness(&problem.springs, constants)
}

/// Groups of springs, given by their places, that may move while the norm rises by the part `rise` of itself at most.
/// Without `rise` these are only groups that are free ([`free_directions`]), and the ranges are those of the least norm.
pub(crate) fn ranges(
    problem: &FitProblem,
    constants: &[f64],
    groups: &[Vec<usize>],
    rise: Option<f64>,
) -> Vec<ConstantRange> {
    let free = free_directions(problem, constants);
    let norm = spectral_norm(residual(problem, constants));
    let allowed = norm * (1.0 + rise.unwrap_or(SAME));
    let scale = constants.iter().fold(0f64, |m, k| m.max(k.abs()));
    let along = |group: &Vec<usize>| {
        let mut unit = DVector::zeros(constants.len());
        group.iter().for_each(|&s| unit[s] = 1.0);
        if rise.is_some() {
            return Some(unit);
        }
        let own = &free * free.tr_mul(&unit);
        (own.norm() > OWN * unit.norm()).then_some(own)
    };
    let one = |group: &Vec<usize>| {
        let direction = along(group)?;
        let place = |step: f64| -> Vec<f64> {
            constants.iter().zip(direction.iter()).map(|(k, d)| k + step * d).collect()
        };
        let within = |step: f64| spectral_norm(residual(problem, &place(step))) <= allowed;
        let mean = |k: &[f64]| group.iter().map(|&s| k[s]).sum::<f64>() / group.len() as f64;
        // the norm is convex, so what is within is one interval round 0
        let end = |sign: f64| {
            let [mut inside, mut outside] = [0.0, 1e-3 * scale * sign];
            while within(outside) && outside.abs() < 1e6 * scale {
                (inside, outside) = (outside, 2.0 * outside);
            }
            for _ in 0..40 {
                let middle = 0.5 * (inside + outside);
                *(if within(middle) { &mut inside } else { &mut outside }) = middle;
            }
            mean(&place(inside))
        };
        let range = [end(-1.0), end(1.0)];
        Some(ConstantRange { springs: group.clone(), constant: mean(constants), range })
    };
    groups.iter().filter_map(one).collect()
}
