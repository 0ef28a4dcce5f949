//! Sparse direct factorisation, for equilibria, constant matrices and as a reference. The factor is
//! kept while the matrix stays the same, number by number.

use crate::system::{Pattern, SystemMatrix};
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{MatMut, Side};
use sinew_engine::scalar::Scalar;

/// Cholesky factor of a [`SystemMatrix`] in `f64`.
#[derive(Clone, Debug, Default)]
pub struct DirectFactor<S> {
    symbolic: Option<(SymbolicSparseColMat<usize>, SymbolicLlt<usize>)>,
    factor: Option<Llt<usize, f64>>,
    /// What `factor` is the factor of.
    matrix: SystemMatrix<S>,
    /// There was a factor of that matrix before it was recalled.
    recalled: bool,
    x: Vec<f64>,
}

impl<S: Scalar> DirectFactor<S> {
    /// What the factor is the factor of.
    pub fn memory(&self) -> Option<SystemMatrix<S>> {
        (self.factor.is_some() || self.recalled).then(|| self.matrix.clone())
    }

    /// Makes the next use of this matrix count as that of a factor that was there.
    pub fn recall(&mut self, matrix: Option<&SystemMatrix<S>>) {
        if self.factor.is_some() && matrix == Some(&self.matrix) {
            return;
        }
        (self.factor, self.recalled) = (None, matrix.is_some());
        self.matrix = matrix.cloned().unwrap_or_default();
    }

    /// Factorises `matrix` unless that was done already; says whether it was now, `None` when the
    /// matrix is not positive definite.
    pub fn prepare(&mut self, pattern: &Pattern, matrix: &SystemMatrix<S>) -> Option<bool> {
        if self.factor.is_some() && self.matrix == *matrix {
            return Some(false);
        }
        let known = std::mem::take(&mut self.recalled) && self.matrix == *matrix;
        self.factor = None;
        let (columns, symbolic) = match &mut self.symbolic {
            Some(symbolic) => symbolic,
            none => none.insert(analyse(pattern)?),
        };
        // the lower half by columns is the upper half by rows
        let mut values = Vec::with_capacity(columns.row_idx().len());
        for (row, diagonal) in matrix.diagonal.iter().enumerate() {
            for k in 0..3 {
                values.extend((k..3).map(|l| diagonal[k][l].to_f64()));
                for block in &matrix.upper[pattern.blocks(row)] {
                    values.extend(block[k][..3].iter().map(|x| x.to_f64()));
                }
            }
        }
        let lower = SparseColMatRef::new(columns.as_ref(), &values);
        self.factor = Llt::try_new_with_symbolic(symbolic.clone(), lower, Side::Lower).ok();
        self.matrix.clone_from(matrix);
        self.factor.as_ref().map(|_| !known)
    }

    /// `x = A^-1 r` with the matrix last prepared, its scaling undone.
    pub fn solve(&mut self, r: &[[S; 4]], x: &mut [[S; 4]]) {
        let Some(factor) = &self.factor else { return };
        self.x.clear();
        self.x.extend(r.iter().flat_map(|r| [r[0].to_f64(), r[1].to_f64(), r[2].to_f64()]));
        let n = self.x.len();
        factor.solve_in_place(MatMut::from_column_major_slice_mut(&mut self.x, n, 1));
        for (x, solved) in x.iter_mut().zip(self.x.chunks_exact(3)) {
            for k in 0..3 {
                x[k] = S::from_f64(solved[k] * self.matrix.factor);
            }
        }
    }
}

/// Pattern of the lower half by columns, and its symbolic factor; `None` when there is no memory.
fn analyse(pattern: &Pattern) -> Option<(SymbolicSparseColMat<usize>, SymbolicLlt<usize>)> {
    let n = 3 * pattern.len();
    let mut start = vec![0];
    let mut row_of = Vec::with_capacity(6 * pattern.len() + 9 * pattern.column.len());
    for row in 0..pattern.len() {
        for k in 0..3 {
            row_of.extend((k..3).map(|l| 3 * row + l));
            for &column in &pattern.column[pattern.blocks(row)] {
                row_of.extend((0..3).map(|l| 3 * column as usize + l));
            }
            start.push(row_of.len());
        }
    }
    let columns = SymbolicSparseColMat::new_checked(n, n, start, None, row_of);
    let symbolic = SymbolicLlt::try_new(columns.as_ref(), Side::Lower).ok()?;
    Some((columns, symbolic))
}
