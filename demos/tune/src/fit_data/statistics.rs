//! What a Jacobian says about the parameters: errors, correlations, and what cannot be found.

use nalgebra::DMatrix;

/// Condition of the scaled Jacobian above which a combination of parameters counts as not
/// identifiable.
pub const WORST_CONDITION: f64 = 1e6;

/// Singular values of a Jacobian, and its right singular vectors.
#[derive(Clone, Debug)]
pub struct Directions {
    /// Singular values, descending.
    pub singular_values: Vec<f64>,
    /// Right singular vectors in the same order.
    pub vectors: Vec<Vec<f64>>,
}

impl Directions {
    /// Those of a Jacobian by scaled parameters.
    pub fn of(jacobian: &DMatrix<f64>) -> Self {
        let n = jacobian.ncols();
        // with fewer rows than columns the decomposition leaves out null directions
        let mut square = DMatrix::zeros(jacobian.nrows().max(n), n);
        square.rows_mut(0, jacobian.nrows()).copy_from(jacobian);
        let svd = square.svd(false, true);
        let Some(v) = svd.v_t else {
            return Self { singular_values: Vec::new(), vectors: Vec::new() };
        };
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
        Self {
            singular_values: order.iter().map(|&i| svd.singular_values[i]).collect(),
            vectors: order.iter().map(|&i| v.row(i).iter().copied().collect()).collect(),
        }
    }

    /// Largest over smallest singular value; infinite when the smallest is zero.
    pub fn condition(&self) -> f64 {
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(largest), Some(smallest)) if *smallest > 0.0 => largest / smallest,
            _ => f64::INFINITY,
        }
    }

    /// Directions along which the observations hardly change.
    pub fn unidentifiable(&self) -> impl Iterator<Item = &[f64]> {
        let all = self.singular_values.iter().zip(&self.vectors);
        all.filter(|(s, _)| **s <= self.least()).map(|(_, v)| v.as_slice())
    }

    /// Whether each parameter is determined: it has no part in a direction that is not identifiable.
    pub fn determined(&self) -> Vec<bool> {
        let part = |i: usize| self.unidentifiable().any(|v| v[i].abs() > NO_PART);
        (0..self.vectors.len()).map(|i| !part(i)).collect()
    }

    /// `(J^T J)^-1` along the identifiable directions: entries of determined parameters are those of the
    /// whole inverse.
    pub fn covariance(&self) -> DMatrix<f64> {
        let n = self.vectors.len();
        let good = || {
            let all = self.singular_values.iter().zip(&self.vectors);
            all.filter(|(s, _)| **s > self.least())
        };
        let entry = |i: usize, j: usize| good().map(|(s, v)| v[i] * v[j] / (s * s)).sum::<f64>();
        DMatrix::from_fn(n, n, entry)
    }

    /// Singular value up to which a direction is not identifiable.
    fn least(&self) -> f64 {
        self.singular_values.first().map_or(0.0, |s| s / WORST_CONDITION)
    }
}

/// Entry of a singular vector up to which a parameter has no part in it.
const NO_PART: f64 = 1e-3;

/// Half width of the central 95 % interval of Student's distribution with `freedom` degrees of freedom,
/// in standard errors; `None` stands for a known standard deviation (normal distribution).
///
/// ```
/// use sinew_tune::fit_data::statistics::half_width;
/// assert!((half_width(None) - 1.959963985).abs() < 1e-8);
/// assert!((half_width(Some(1)) - 12.7062047).abs() < 1e-6);
/// assert!((half_width(Some(10)) - 2.2281389).abs() < 1e-6);
/// assert!((half_width(Some(120)) - 1.9799304).abs() < 1e-6);
/// ```
pub fn half_width(freedom: Option<usize>) -> f64 {
    const NORMAL: f64 = 1.959_963_984_540_054;
    let Some(n) = freedom else { return NORMAL };
    if n > 200 {
        // Cornish-Fisher expansion (Abramowitz & Stegun 26.7.5)
        let (x, n) = (NORMAL, n as f64);
        let first = (x.powi(3) + x) / 4.0;
        let second = (5.0 * x.powi(5) + 16.0 * x.powi(3) + 3.0 * x) / 96.0;
        return x + first / n + second / (n * n);
    }
    let (mut low, mut high) = (0.0, 20.0);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if central_probability(middle, n) < 0.95 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that a value of Student's distribution lies within `-t..t` (Abramowitz & Stegun 26.7.3 and
/// 26.7.4).
fn central_probability(t: f64, freedom: usize) -> f64 {
    let angle = (t / (freedom as f64).sqrt()).atan();
    let (sin, cos) = angle.sin_cos();
    let odd = freedom % 2 == 1;
    let (mut term, mut sum) = if odd { (cos, 0.0) } else { (1.0, 0.0) };
    let mut k = if odd { 1 } else { 0 };
    while k + 2 <= freedom {
        sum += term;
        term *= cos * cos * (k as f64 + 1.0) / (k as f64 + 2.0);
        k += 2;
    }
    if odd { std::f64::consts::FRAC_2_PI * (angle + sin * sum) } else { sin * sum }
}
