//! Sparse direct factorisation, for equilibria, constant matrices and as a reference. The factor is
//! kept while the matrix stays the same, number by number.

use crate::system::{Block, Pattern, RankOnes, SystemMatrix, padded};
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{MatMut, Side};
use sinew_engine::scalar::Scalar;

/// Pattern of a matrix with all that it couples, and that of its factor.
#[derive(Clone, Debug)]
struct Symbolic {
    /// First off-diagonal block of each row, and the column of each block: those of the pattern and those of vectors that
    /// iterations do not add up.
    start: Vec<usize>,
    column: Vec<u32>,
    columns: SymbolicSparseColMat<usize>,
    factor: SymbolicLlt<usize>,
}

/// Cholesky factor of a [`SystemMatrix`] in `f64`.
#[derive(Clone, Debug, Default)]
pub struct DirectFactor<S> {
    symbolic: Option<Symbolic>,
    factor: Option<Llt<usize, f64>>,
    /// The matrix of `factor`.
    matrix: SystemMatrix<S>,
    /// There was a factor of that matrix before it was recalled.
    recalled: bool,
    x: Vec<f64>,
}

impl<S: Scalar> DirectFactor<S> {
    /// The matrix of the factor.
    pub fn memory(&self) -> Option<SystemMatrix<S>> {
        (self.factor.is_some() || self.recalled).then(|| self.matrix.clone())
    }

    /// Remembers that a factor of this matrix existed: its next factorisation is not reported.
    pub fn recall(&mut self, matrix: Option<&SystemMatrix<S>>) {
        if self.factor.is_some() && matrix == Some(&self.matrix) {
            return;
        }
        (self.factor, self.recalled) = (None, matrix.is_some());
        if !matrix.is_some_and(|matrix| matrix.low_rank.fits(&self.matrix.low_rank)) {
            self.symbolic = None;
        }
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
        if !self.matrix.low_rank.fits(&matrix.low_rank) {
            self.symbolic = None;
        }
        let symbolic = match &mut self.symbolic {
            Some(symbolic) => symbolic,
            none => none.insert(Symbolic::new(pattern, &matrix.low_rank)?),
        };
        let (diagonal, upper) = symbolic.add_up(pattern, matrix);
        // the lower half by columns is the upper half by rows
        let mut values = Vec::with_capacity(symbolic.columns.row_idx().len());
        for (row, diagonal) in diagonal.iter().enumerate() {
            for k in 0..3 {
                values.extend_from_slice(&diagonal[k][k..]);
                for block in &upper[symbolic.start[row]..symbolic.start[row + 1]] {
                    values.extend_from_slice(&block[k]);
                }
            }
        }
        let lower = SparseColMatRef::new(symbolic.columns.as_ref(), &values);
        self.factor = Llt::try_new_with_symbolic(symbolic.factor.clone(), lower, Side::Lower).ok();
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

type Dense = [[f64; 3]; 3];

impl Symbolic {
    /// `None` when there is no memory.
    fn new<S: Scalar>(pattern: &Pattern, ones: &RankOnes<S>) -> Option<Self> {
        let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(pattern.column.len());
        for row in 0..pattern.len() {
            pairs.extend(pattern.column[pattern.blocks(row)].iter().map(|&c| [row as u32, c]));
        }
        for vector in 0..ones.len() {
            let own = &ones.rows[ones.range(vector)];
            for (i, &a) in own.iter().enumerate() {
                pairs.extend(own[i + 1..].iter().map(|&b| [a.min(b), a.max(b)]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let (n, mut start) = (pattern.len(), vec![0]);
        start.extend((0..n).map(|row| pairs.partition_point(|pair| pair[0] as usize <= row)));
        let column: Vec<u32> = pairs.iter().map(|pair| pair[1]).collect();
        let mut first = vec![0];
        let mut row_of = Vec::with_capacity(6 * n + 9 * column.len());
        for row in 0..n {
            for k in 0..3 {
                row_of.extend((k..3).map(|l| 3 * row + l));
                for &column in &column[start[row]..start[row + 1]] {
                    row_of.extend((0..3).map(|l| 3 * column as usize + l));
                }
                first.push(row_of.len());
            }
        }
        let columns = SymbolicSparseColMat::new_checked(3 * n, 3 * n, first, None, row_of);
        let factor = SymbolicLlt::try_new(columns.as_ref(), Side::Lower).ok()?;
        Some(Self { start, column, columns, factor })
    }

    /// Diagonal and upper blocks with everything added up.
    fn add_up<S: Scalar>(
        &self,
        pattern: &Pattern,
        matrix: &SystemMatrix<S>,
    ) -> (Vec<Dense>, Vec<Dense>) {
        let dense = |block: &Block<S>| block.map(|row| [0, 1, 2].map(|k| row[k].to_f64()));
        let mut diagonal: Vec<Dense> = matrix.diagonal.iter().map(dense).collect();
        let mut upper = vec![[[0.0; 3]; 3]; self.column.len()];
        let place = |row: usize, column: u32| {
            let own = self.start[row]..self.start[row + 1];
            let at = self.column[own.clone()].binary_search(&column);
            own.start + at.expect("every pair was entered into the pattern")
        };
        for row in 0..pattern.len() {
            for block in pattern.blocks(row) {
                upper[place(row, pattern.column[block])] = dense(&padded(&matrix.upper[block]));
            }
        }
        let ones = &matrix.low_rank;
        for vector in 0..ones.len() {
            let range = ones.range(vector);
            let own: Vec<_> = ones.rows[range.clone()].iter().zip(&ones.entries[range]).collect();
            for (i, &(&a, x)) in own.iter().enumerate() {
                for &(&b, y) in &own[i..] {
                    let (to, x, y) = if a == b {
                        (&mut diagonal[a as usize], x, y)
                    } else if a < b {
                        (&mut upper[place(a as usize, b)], x, y)
                    } else {
                        (&mut upper[place(b as usize, a)], y, x)
                    };
                    for k in 0..3 {
                        for l in 0..3 {
                            to[k][l] += x[k].to_f64() * y[l].to_f64();
                        }
                    }
                }
            }
        }
        (diagonal, upper)
    }
}
