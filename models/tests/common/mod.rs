//! Shared by the integration tests: small dense linear algebra and the worst-error bookkeeping.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::io::Write;

/// Largest error seen per quantity, in units of its tolerance.
#[derive(Default)]
pub struct Worst(Vec<(&'static str, f64, String)>);

impl Worst {
    /// Notes `error` of `quantity`, measured in units of `unit`, for the case called `name`.
    pub fn note(&mut self, quantity: &'static str, error: f64, unit: f64, name: &str) {
        // NaN must not pass: it counts as infinite.
        let ratio = if error == 0.0 { 0.0 } else { error / unit };
        let ratio = if ratio.is_nan() { f64::INFINITY } else { ratio };
        match self.0.iter_mut().find(|w| w.0 == quantity) {
            Some(w) if w.1 >= ratio => {}
            Some(w) => (w.1, w.2) = (ratio, name.to_owned()),
            None => self.0.push((quantity, ratio, name.to_owned())),
        }
    }

    /// Fails if any quantity is off by more than `tolerance` of its units. Lists all of them when
    /// the variable `SINEW_REPORT` is set.
    pub fn check(self, tolerance: f64) {
        if std::env::var_os("SINEW_REPORT").is_some() {
            for (quantity, ratio, name) in &self.0 {
                let _ = writeln!(std::io::stderr(), "{quantity:32} {ratio:9.2e}  {name}");
            }
        }
        assert!(!self.0.is_empty(), "nothing was checked");
        for (quantity, ratio, name) in &self.0 {
            assert!(*ratio <= tolerance, "{quantity} is off by {ratio:e} at {name}");
        }
    }
}

pub fn max_abs<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    values.into_iter().fold(0.0, |m, x| if x.is_nan() { f64::NAN } else { x.abs().max(m) })
}

pub fn max_difference<'a>(
    a: impl IntoIterator<Item = &'a f64>,
    b: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    let differences: Vec<f64> = a.iter().zip(&b).map(|(x, y)| **x - **y).collect();
    if differences.iter().any(|x| x.is_nan()) { f64::NAN } else { max_abs(&differences) }
}

/// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations.
pub fn symmetric_eigen<const N: usize>(mut a: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut v = [[0.0; N]; N];
    for i in 0..N {
        v[i][i] = 1.0;
    }
    for _sweep in 0..60 {
        let size = max_abs(a.as_flattened());
        let mut off = 0.0_f64;
        for p in 0..N {
            for q in p + 1..N {
                off = off.max(a[p][q].abs());
                if a[p][q] == 0.0 {
                    continue;
                }
                let zeta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..N {
                    (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                }
                for k in 0..N {
                    (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
                    (v[k][p], v[k][q]) = (c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]);
                }
            }
        }
        if off <= 1e-17 * size {
            break;
        }
    }
    let mut values = [0.0; N];
    for i in 0..N {
        values[i] = a[i][i];
    }
    (values, v)
}
