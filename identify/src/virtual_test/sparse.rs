//! A sparse symmetric system with held unknowns, factorised directly.

use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};

/// Residual of a right-hand side of order 1 above which a matrix counts as singular. Rounding leaves
/// about 1e-16 times the condition.
const SINGULAR: f64 = 1e-4;

/// Entries of a symmetric matrix over all unknowns; those that are held are eliminated when it is solved.
pub(super) struct System {
    /// place among the free unknowns
    place: Vec<Option<usize>>,
    free: Vec<usize>,
    entries: Vec<(usize, usize, f64)>,
}

impl System {
    pub(super) fn new(held: &[Option<f64>]) -> Self {
        let free: Vec<usize> = (0..held.len()).filter(|&i| held[i].is_none()).collect();
        let mut place = vec![None; held.len()];
        for (p, &i) in free.iter().enumerate() {
            place[i] = Some(p);
        }
        Self { place, free, entries: Vec::new() }
    }

    /// Adds to an entry of the full matrix; both halves are to be added.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        self.entries.push((row, column, value));
    }

    /// Solves `A x = b` with the held unknowns at their values in `held`; says whether the matrix is
    /// positive definite. `None` if it is singular.
    pub(super) fn solve(&self, b: &[f64], held: &[f64]) -> Option<(Vec<f64>, bool)> {
        let n = self.free.len();
        let mut right: Vec<f64> = self.free.iter().map(|&i| b[i]).collect();
        let mut triplets = Vec::with_capacity(self.entries.len());
        for &(row, column, value) in &self.entries {
            match (self.place[row], self.place[column]) {
                (Some(r), Some(c)) => triplets.push(Triplet::new(r, c, value)),
                (Some(r), None) => right[r] -= value * held[column],
                _ => {}
            }
        }
        let mut x = held.to_vec();
        if n == 0 {
            return Some((x, true));
        }
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(n, n, &triplets).ok()?;
        // The second column is in no equilibrium with anything: if the matrix is singular and passed
        // the factorisation by rounding, the solution for it does not solve its system.
        let right = Mat::from_fn(n, 2, |i, column| if column == 0 { right[i] } else { probe(i) });
        let (solution, definite) = match matrix.sp_cholesky(Side::Lower) {
            Ok(factor) => (factor.solve(&right), true),
            Err(_) => (matrix.sp_lu().ok()?.solve(&right), false),
        };
        let residual = &matrix * &solution - &right;
        let good = (0..n).all(|i| residual[(i, 1)].abs() <= SINGULAR);
        for (&i, p) in self.free.iter().zip(0..) {
            x[i] = solution[(p, 0)];
        }
        (good && x.iter().all(|x| x.is_finite())).then_some((x, definite))
    }
}

/// Numbers between 1/2 and 1 of either sign without a pattern.
fn probe(i: usize) -> f64 {
    let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
    let number = 0.5 + hash as f64 / (1u64 << 54) as f64;
    if hash & 1 == 0 { number } else { -number }
}
