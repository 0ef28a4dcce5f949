//! 2-norm fit: the largest error of the stiffness in any direction is made as small as it can be.
//!
//! ```text
//! minimise t  subject to  -t I <= R - K(k) <= t I            (and k >= 0, if asked for)
//! ```
//!
//! is a small semidefinite program (paper B, equation 24). With `M = R - K(k)`, and rigid motions
//! projected out (both stiffnesses vanish on them), the constraints are smoothed by a barrier and
//!
//! ```text
//! t / tau - log det (t I - M) - log det (t I + M)  [ - sum_s log k_s ]
//! ```
//!
//! is minimised by Newton's method while `tau` falls. Springs have rank one, so with `A = (t I -
//! M)^-1`, `B = (t I + M)^-1`, `a = W^T A W`, `b = W^T B W` the gradient is `b_ss - a_ss` and the
//! Hessian `a_st^2 + b_st^2`: no eigenvalues are needed until the end.
//!
//! **Certificate.** Let `G` be symmetric with `<G, K_s> = 0` for all springs (`<= 0` for non-negative
//! constants) and eigenvalues whose magnitudes sum to at most 1. Then
//! `|R - K(k)|_2 >= <G, R - K(k)> >= <G, R>` for all allowed constants. `tau (A - B)` tends to such a matrix;
//! restricted to the eigenvectors that matter, made feasible and scaled, it gives the lower bound that is
//! returned. The bound holds wherever it is formed; only its tightness depends on the iteration.
//!
//! The minimiser is flat: constants may move by 1e-3 where the norm moves by 1e-7, so compare norms, not
//! constants.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{FitProblem, frobenius, nonnegative, spectral_norm};
use crate::error::ElementError;

/// Relative gap between norm and lower bound at which the fit is done.
const GAP: f64 = 1e-8;
/// Relative gap above which the fit is refused.
const WORST_GAP: f64 = 1e-6;
/// Factor by which the barrier is weakened.
const WEAKEN: f64 = 0.15;
/// Parts of the dual matrix above which a direction counts as one in which the norm is taken; the first
/// that gives a tight bound is enough, and all bounds hold. Badly shaped elements need the later ones.
const ACTIVE: [f64; 4] = [1e-4, 1e-6, 1e-2, 0.0];
/// Barrier below which rounding (`1e-16 / tau`) blurs more than the barrier does.
const LEAST_TAU: f64 = 1e-12;
/// Square of the Newton decrement at which a point is on the central path. The minimum is so flat that a loose
/// one leaves constants, and with them the directions of the certificate, worse than the barrier would.
const CENTRED: f64 = 1e-6;
/// Newton steps to one barrier; 4 to 6 are usual.
const NEWTON_STEPS: usize = 30;
/// A residual of this size, relative to the stiffness, is rounding: the springs are exact.
const EXACT: f64 = 1e-13;

/// Which constants are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// Any.
    Free,
    /// None below 0.
    Nonnegative,
}

/// Constants (N/m) of least `|R - K(k)|_2`, and a lower bound of that norm (N/m) over all allowed
/// constants.
///
/// # Errors
/// [`ElementError::DependentSprings`]; [`ElementError::NotConverged`] if norm and bound differ by more
/// than 1e-6.
pub fn two_norm(problem: &FitProblem, sign: Sign) -> Result<(Vec<f64>, f64), ElementError> {
    let start = match sign {
        Sign::Free => frobenius(problem)?,
        Sign::Nonnegative => nonnegative(problem)?,
    };
    let scaled = Scaled::new(problem);
    let start: Vec<f64> = start.iter().map(|k| k / scaled.scale).collect();
    let residual = spectral_norm(scaled.residual(&start));
    if residual < EXACT {
        return Ok((start.iter().map(|k| k * scaled.scale).collect(), 0.0));
    }
    let mut barrier = Barrier::new(&scaled, sign, start, residual);
    let mut tau = barrier.first_tau()?;
    let (mut best, mut norm, mut bound) = (Vec::new(), f64::INFINITY, 0f64);
    loop {
        let going_on = barrier.centre(tau);
        // On the central path the gap is the number of constraints times tau.
        let near = barrier.constraints() * tau <= 1e3 * GAP * barrier.t;
        if near || !going_on {
            let reached = spectral_norm(scaled.residual(&barrier.k));
            if reached < norm {
                (norm, best) = (reached, barrier.k.clone());
            }
            for part in ACTIVE {
                if norm - bound > GAP * norm {
                    bound = bound.max(barrier.lower_bound(part));
                }
            }
            if norm - bound <= GAP * norm || !going_on || tau < LEAST_TAU * norm {
                break;
            }
        }
        tau *= WEAKEN;
    }
    let gap = (norm - bound) / norm;
    if gap > WORST_GAP {
        return Err(ElementError::NotConverged { gap });
    }
    Ok((best.iter().map(|k| k * scaled.scale).collect(), bound * scaled.scale))
}

/// The problem without rigid motions and in units of `|R|_2`.
struct Scaled {
    /// `U^T R U / |R|_2`
    stiffness: DMatrix<f64>,
    /// `U^T W`
    springs: DMatrix<f64>,
    /// `|R|_2`, N/m
    scale: f64,
}

impl Scaled {
    fn new(problem: &FitProblem) -> Self {
        let basis = deformations(problem);
        let springs = basis.tr_mul(&problem.springs);
        let mut stiffness = basis.tr_mul(&(&problem.stiffness * &basis));
        symmetrise(&mut stiffness);
        let scale = spectral_norm(stiffness.clone());
        Self { stiffness: stiffness / scale, springs, scale }
    }

    fn residual(&self, k: &[f64]) -> DMatrix<f64> {
        let mut weighted = self.springs.clone();
        for (mut column, &k) in weighted.column_iter_mut().zip(k) {
            column *= k;
        }
        let mut m = self.stiffness.clone();
        m.gemm(-1.0, &weighted, &self.springs.transpose(), 1.0);
        symmetrise(&mut m);
        m
    }
}

/// Orthonormal basis of the displacements that are no rigid motions. They are what the springs can
/// feel: the span of the columns of `W`.
fn deformations(problem: &FitProblem) -> DMatrix<f64> {
    let w = &problem.springs;
    let dimension = problem.dimension;
    let rigid = dimension * (dimension + 1) / 2;
    let wanted = w.nrows() - rigid;
    // Gram-Schmidt, twice, always taking the column with the largest rest: stable, and no eigenvalues
    // needed
    let mut rest = w.clone();
    let mut basis = DMatrix::zeros(w.nrows(), wanted);
    for j in 0..wanted {
        let mut pivot = 0;
        for s in 1..rest.ncols() {
            if rest.column(s).norm_squared() > rest.column(pivot).norm_squared() {
                pivot = s;
            }
        }
        let mut column = rest.column(pivot).into_owned();
        for _ in 0..2 {
            for i in 0..j {
                let along = basis.column(i).dot(&column);
                column.axpy(-along, &basis.column(i), 1.0);
            }
        }
        column.normalize_mut();
        basis.set_column(j, &column);
        for mut other in rest.column_iter_mut() {
            let along = column.dot(&other);
            other.axpy(-along, &column, 1.0);
        }
    }
    basis
}

fn symmetrise(m: &mut DMatrix<f64>) {
    for i in 0..m.nrows() {
        for j in 0..i {
            let mean = 0.5 * (m[(i, j)] + m[(j, i)]);
            (m[(i, j)], m[(j, i)]) = (mean, mean);
        }
    }
}

/// A point inside of the constraints, and the Newton iteration towards the central path.
struct Barrier<'a> {
    problem: &'a Scaled,
    sign: Sign,
    k: Vec<f64>,
    t: f64,
}

/// Factors of `t I - M` and `t I + M`.
struct Factors {
    below: Cholesky<f64, Dyn>,
    above: Cholesky<f64, Dyn>,
}

impl<'a> Barrier<'a> {
    /// Starts at `k`, moved off 0 if constants must be positive, whose residual is `residual`.
    fn new(problem: &'a Scaled, sign: Sign, mut k: Vec<f64>, mut residual: f64) -> Self {
        if sign == Sign::Nonnegative {
            let mean = k.iter().sum::<f64>() / k.len() as f64;
            for k in &mut k {
                *k = k.max(0.05 * mean);
            }
            residual = spectral_norm(problem.residual(&k));
        }
        Self { problem, sign, k, t: 1.5 * residual }
    }

    /// Terms of the barrier: the gap on the central path is this times `tau`.
    fn constraints(&self) -> f64 {
        let signs = if self.sign == Sign::Nonnegative { self.k.len() } else { 0 };
        (2 * self.problem.stiffness.nrows() + signs) as f64
    }

    fn factors(&self, k: &[f64], t: f64) -> Option<Factors> {
        if self.sign == Sign::Nonnegative && k.iter().any(|&k| k <= 0.0) {
            return None;
        }
        let m = self.problem.residual(k);
        let (mut below, mut above) = (-&m, m);
        for i in 0..below.nrows() {
            below[(i, i)] += t;
            above[(i, i)] += t;
        }
        Some(Factors { below: below.cholesky()?, above: above.cholesky()? })
    }

    /// The `tau` at which the starting point balances in `t`.
    fn first_tau(&self) -> Result<f64, ElementError> {
        let factors =
            self.factors(&self.k, self.t).ok_or(ElementError::NotConverged { gap: 1.0 })?;
        Ok(1.0 / (factors.below.inverse().trace() + factors.above.inverse().trace()))
    }

    /// The barrier function, less its value of `t / tau` at this point, which would swallow the rest.
    fn value(&self, factors: &Factors, k: &[f64], rise: f64, tau: f64) -> f64 {
        let log_determinant = |factor: &Cholesky<f64, Dyn>| {
            factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>() * 2.0
        };
        let mut value =
            rise / tau - log_determinant(&factors.below) - log_determinant(&factors.above);
        if self.sign == Sign::Nonnegative {
            value -= k.iter().map(|k| k.ln()).sum::<f64>();
        }
        value
    }

    /// Newton's method for one `tau`; false if rounding ends it before the point is near the central path.
    fn centre(&mut self, tau: f64) -> bool {
        let count = self.k.len();
        let w = &self.problem.springs;
        let Some(mut factors) = self.factors(&self.k, self.t) else { return false };
        for _ in 0..NEWTON_STEPS {
            let inverse = [factors.below.inverse(), factors.above.inverse()];
            let products = [&inverse[0] * w, &inverse[1] * w];
            let [a, b] = [w.tr_mul(&products[0]), w.tr_mul(&products[1])];
            // Unknowns: constants, then t. `t I - M` rises with the constants, `t I + M` falls.
            let mut hessian = DMatrix::zeros(count + 1, count + 1);
            let mut gradient = DVector::zeros(count + 1);
            for s in 0..count {
                for u in 0..count {
                    hessian[(s, u)] = a[(s, u)] * a[(s, u)] + b[(s, u)] * b[(s, u)];
                }
                gradient[s] = b[(s, s)] - a[(s, s)];
                if self.sign == Sign::Nonnegative {
                    gradient[s] -= 1.0 / self.k[s];
                    hessian[(s, s)] += 1.0 / (self.k[s] * self.k[s]);
                }
                let mixed =
                    products[0].column(s).norm_squared() - products[1].column(s).norm_squared();
                (hessian[(s, count)], hessian[(count, s)]) = (mixed, mixed);
            }
            gradient[count] = 1.0 / tau - inverse[0].trace() - inverse[1].trace();
            hessian[(count, count)] = inverse[0].norm_squared() + inverse[1].norm_squared();
            let Some(step) = newton_step(hessian, &gradient) else { return false };
            let decrement = -gradient.dot(&step);
            if decrement < CENTRED {
                return true;
            }
            let value = self.value(&factors, &self.k, 0.0, tau);
            let mut length = f64::min(1.0, 2.0 / (1.0 + decrement.sqrt()));
            let accepted = loop {
                let k: Vec<f64> =
                    self.k.iter().zip(step.iter()).map(|(k, d)| k + length * d).collect();
                let t = self.t + length * step[count];
                if let Some(trial) = self.factors(&k, t)
                    && self.value(&trial, &k, length * step[count], tau)
                        <= value - 1e-4 * length * decrement
                {
                    (self.k, self.t, factors) = (k, t, trial);
                    break true;
                }
                length *= 0.5;
                if length < 1e-10 {
                    break false;
                }
            };
            if !accepted {
                return false;
            }
        }
        true
    }

    /// Lower bound of the norm (in units of `|R|_2`) from a dual matrix at this point.
    ///
    /// Directions and springs count as active if they have more than `part` of it.
    fn lower_bound(&self, part: f64) -> f64 {
        let eigen = self.problem.residual(&self.k).symmetric_eigen();
        let weights = eigen.eigenvalues.map(|e| 1.0 / (self.t - e) - 1.0 / (self.t + e));
        let sum: f64 = weights.iter().map(|w| w.abs()).sum();
        // The optimal dual matrix lives where |M| is near t; the rest of the barrier's would only
        // loosen the bound.
        let active = |positive: bool| {
            let columns: Vec<usize> = (0..weights.len())
                .filter(|&i| (weights[i] > 0.0) == positive && weights[i].abs() > part * sum)
                .collect();
            let basis = eigen.eigenvectors.select_columns(&columns);
            let diagonal =
                DVector::from_iterator(columns.len(), columns.iter().map(|&i| weights[i] / sum));
            (basis, DMatrix::from_diagonal(&diagonal))
        };
        let mut faces = [active(true), active(false)];
        let w = &self.problem.springs;
        let count = w.ncols();
        // Springs at rest on the limit k >= 0 may pull the bound down, the others must not take part in it.
        let slack: Vec<bool> = (0..count)
            .map(|s| self.sign == Sign::Nonnegative && 1.0 / self.k[s] > part * sum)
            .collect();
        let excess = |along: DVector<f64>| {
            DVector::from_fn(count, |s, _| if slack[s] { along[s].max(0.0) } else { along[s] })
        };
        // Least change within the faces that frees the springs of the dual matrix.
        for _ in 0..2 {
            let parts = faces.each_ref().map(|(basis, _)| basis.tr_mul(w));
            let mut along = DVector::zeros(count);
            let mut gram = DMatrix::<f64>::zeros(count, count);
            for (p, (_, x)) in parts.iter().zip(&faces) {
                let product = x * p;
                for s in 0..count {
                    along[s] += product.column(s).dot(&p.column(s));
                }
                gram += p.tr_mul(p).map(|g| g * g);
            }
            let eigen = gram.symmetric_eigen();
            let largest = eigen.eigenvalues.max();
            let mut y = eigen.eigenvectors.tr_mul(&excess(along));
            for (y, &e) in y.iter_mut().zip(eigen.eigenvalues.iter()) {
                *y = if e > 1e-8 * largest { *y / e } else { 0.0 };
            }
            let y = &eigen.eigenvectors * y;
            for (p, (_, x)) in parts.iter().zip(&mut faces) {
                for s in 0..count {
                    x.ger(-y[s], &p.column(s), &p.column(s), 1.0);
                }
            }
        }
        let mut dual = DMatrix::zeros(w.nrows(), w.nrows());
        for (basis, x) in &faces {
            dual += basis * x * basis.transpose();
        }
        // What is left of them goes in all directions, so that the bound holds.
        let product = &dual * w;
        let along = DVector::from_fn(count, |s, _| product.column(s).dot(&w.column(s)));
        let Some(factor) = w.tr_mul(w).map(|g| g * g).cholesky() else { return 0.0 };
        let y = factor.solve(&excess(along));
        for s in 0..count {
            dual.ger(-y[s], &w.column(s), &w.column(s), 1.0);
        }
        symmetrise(&mut dual);
        let bound = dual.dot(&self.problem.stiffness);
        let sum: f64 = dual.symmetric_eigenvalues().iter().map(|e| e.abs()).sum();
        if bound > 0.0 { bound / sum } else { 0.0 }
    }
}

/// `-hessian^-1 gradient`; the diagonal is scaled to 1, and raised a little if rounding made it indefinite.
fn newton_step(mut hessian: DMatrix<f64>, gradient: &DVector<f64>) -> Option<DVector<f64>> {
    let count = gradient.len();
    let scale: Vec<f64> = (0..count).map(|i| 1.0 / hessian[(i, i)].sqrt()).collect();
    for i in 0..count {
        for j in 0..count {
            hessian[(i, j)] *= scale[i] * scale[j];
        }
    }
    let right = DVector::from_fn(count, |i, _| -gradient[i] * scale[i]);
    let mut raise = 0.0;
    for _ in 0..6 {
        let mut trial = hessian.clone();
        for i in 0..count {
            trial[(i, i)] += raise;
        }
        if let Some(factor) = trial.cholesky() {
            let mut x = factor.solve(&right);
            for i in 0..count {
                x[i] *= scale[i];
            }
            if x.iter().all(|x| x.is_finite()) {
                return Some(x);
            }
        }
        raise = if raise == 0.0 { 1e-15 } else { raise * 30.0 };
    }
    None
}
