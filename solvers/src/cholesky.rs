//! Incomplete Cholesky factorisation by 3x3 blocks without fill, piece by piece: blocks that lead
//! from one piece of rows to another are left out, so that pieces are factorised and applied in
//! parallel and the result does not depend on the number of threads.
//!
//! `M = (I + U^T) D (I + U)` with strictly upper `U`; applying the inverse takes one sweep forwards,
//! which adds multiples of whole rows, and one backwards, which gathers. A piece whose factorisation
//! breaks down is factorised again with its off-diagonal blocks made smaller against the diagonal
//! (the same as a shift of the diagonal), and at last without them: block Jacobi.

use crate::system::{
    Block, Pattern, Piece, SystemMatrix, definite_inverse, inverse, packed, padded, scale4, sub4,
    transpose_product,
};
use serde::{Deserialize, Serialize};
use sinew_engine::matrix::{in_pairs, rows_of, weighted};
use sinew_engine::scalar::{Row, Scalar};
use sinew_engine::simd::{VectorKernel, vectorised};
use sinew_engine::workers::Workers;

/// Off-diagonal factors tried one after the other; 0 is block Jacobi.
const DAMPING: [f64; 5] = [1.0, 0.99, 0.9, 0.5, 0.0];
const NONE: u32 = u32::MAX;

/// The factors of all pieces.
#[derive(Clone, Debug, Default)]
pub struct IncompleteCholesky<T> {
    /// In the order of [`Pattern::pieces`].
    pub pieces: Vec<FactorPiece<T>>,
}

/// The factor of one piece.
#[derive(Clone, Debug)]
pub struct FactorPiece<T> {
    /// First block of each row, counted within the piece; empty rows for block Jacobi.
    start: Vec<u32>,
    /// Column of each block relative to the piece's first row.
    column: Vec<u32>,
    /// For every row the pairs `a < b` of its blocks, in order: block that couples their columns.
    target: Vec<u32>,
    /// Inverse diagonal blocks.
    inverse: Vec<Block<T>>,
    /// Blocks without padding, and one of zeros after them.
    upper: Vec<[T; 9]>,
    /// Restarts of the last factorisation.
    pub breakdowns: u32,
}

/// The numbers of the factor of one piece.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct FactorValues<T> {
    inverse: Vec<Block<T>>,
    upper: Vec<[T; 9]>,
}

impl<T: Scalar> IncompleteCholesky<T> {
    /// The numbers of all factors.
    pub fn values(&self) -> Vec<FactorValues<T>> {
        let of = |p: &FactorPiece<T>| FactorValues {
            inverse: p.inverse.clone(),
            upper: p.upper.clone(),
        };
        self.pieces.iter().map(of).collect()
    }

    /// Takes the numbers of factors over; false, where these have another symbolic part.
    pub fn recall(&mut self, values: &[FactorValues<T>]) -> bool {
        let fits = |(p, v): (&FactorPiece<T>, &FactorValues<T>)| {
            v.inverse.len() + 1 == p.start.len() && v.upper.len() == p.column.len() + 1
        };
        if self.pieces.len() != values.len() || !self.pieces.iter().zip(values).all(fits) {
            return false;
        }
        for (piece, values) in self.pieces.iter_mut().zip(values) {
            piece.inverse.clone_from(&values.inverse);
            piece.upper.clone_from(&values.upper);
        }
        true
    }

    /// Symbolic part; without `couplings` it is block Jacobi.
    pub fn new(pattern: &Pattern, couplings: bool) -> Self {
        let pieces = &pattern.pieces;
        Self { pieces: pieces.iter().map(|p| FactorPiece::new(pattern, p, couplings)).collect() }
    }

    /// Factorises; returns the number of restarts after breakdowns.
    pub fn factorise(
        &mut self,
        workers: &Workers,
        pattern: &Pattern,
        matrix: &SystemMatrix<T>,
    ) -> u32 {
        workers.for_each(&mut self.pieces, usize::MAX, |i, piece| {
            vectorised(FactorisePiece {
                factor: piece,
                pattern,
                piece: &pattern.pieces[i],
                matrix,
            });
        });
        self.pieces.iter().map(|p| p.breakdowns).sum()
    }

    /// Multiplications of blocks in one factorisation, about.
    pub fn work(&self) -> f64 {
        self.pieces
            .iter()
            .map(|p| {
                let pairs = p.target.iter().filter(|&&t| t != NONE).count();
                pairs + 2 * p.column.len() + p.start.len()
            })
            .sum::<usize>() as f64
    }
}

impl<T: Scalar> FactorPiece<T> {
    fn new(pattern: &Pattern, piece: &Piece, couplings: bool) -> Self {
        let base = piece.rows.start;
        let mut start = vec![0];
        let mut column: Vec<u32> = Vec::new();
        for row in piece.rows.clone() {
            if couplings {
                // columns ascend, so the blocks inside are the first ones
                let own = &pattern.column[pattern.blocks(row)];
                let inside = own.iter().take_while(|&&c| (c as usize) < piece.rows.end);
                column.extend(inside.map(|c| c - base as u32));
            }
            start.push(column.len() as u32);
        }
        let mut target = Vec::new();
        for row in 0..piece.rows.len() {
            let own = &column[start[row] as usize..start[row + 1] as usize];
            for (i, &a) in own.iter().enumerate() {
                let of_a = start[a as usize] as usize..start[a as usize + 1] as usize;
                for b in &own[i + 1..] {
                    let found = column[of_a.clone()].binary_search(b);
                    target.push(found.map_or(NONE, |at| (of_a.start + at) as u32));
                }
            }
        }
        Self { start, column, target, inverse: Vec::new(), upper: Vec::new(), breakdowns: 0 }
    }

    /// Gives a row that nothing couples the inverse of its diagonal block, times `scale`; false where that block is not positive
    /// definite.
    pub fn set_alone(&mut self, row: usize, block: &Block<T>, scale: T) -> bool {
        let inverse = definite_inverse(block);
        if let Some(inverse) = inverse {
            self.inverse[row] = inverse.map(|row| scale4(row, scale));
        }
        inverse.is_some()
    }

    #[inline(always)]
    fn factorise(&mut self, pattern: &Pattern, piece: &Piece, matrix: &SystemMatrix<T>) {
        for (tried, &damping) in DAMPING.iter().enumerate() {
            self.breakdowns = tried as u32;
            if self.try_factorise(pattern, piece, matrix, T::from_f64(damping)) {
                return;
            }
        }
    }

    /// False when a pivot is not positive definite.
    #[inline(always)]
    fn try_factorise(
        &mut self,
        pattern: &Pattern,
        piece: &Piece,
        matrix: &SystemMatrix<T>,
        damping: T,
    ) -> bool {
        let n = piece.rows.len();
        let jacobi = damping == T::ZERO || self.column.is_empty();
        self.inverse.clear();
        self.inverse.extend_from_slice(&matrix.diagonal[piece.rows.clone()]);
        self.upper.clear();
        if jacobi {
            self.upper.resize(self.column.len() + 1, [T::ZERO; 9]);
            for m in &mut self.inverse {
                *m = inverse(m);
            }
            return true;
        }
        let mut upper: Vec<Block<T>> = Vec::with_capacity(self.column.len());
        for row in 0..n {
            let first = pattern.start[piece.rows.start + row] as usize;
            let inside = (self.start[row + 1] - self.start[row]) as usize;
            let own = &matrix.upper[first..first + inside];
            upper.extend(own.iter().map(|m| padded(&m.map(|x| x * damping))));
        }
        let mut scaled: Vec<Block<T>> = Vec::new();
        let mut pair = 0;
        for row in 0..n {
            let Some(inverse) = definite_inverse(&self.inverse[row]) else { return false };
            self.inverse[row] = inverse;
            let range = self.start[row] as usize..self.start[row + 1] as usize;
            let (own, rest) = upper[range.start..].split_at_mut(range.len());
            scaled.clear();
            // the inverse is symmetric: its columns are its rows
            scaled.extend(own.iter().map(|m| inverse.map(|r| transpose_product(m, r))));
            let columns = &self.column[range.clone()];
            for (i, (a, &column)) in own.iter().zip(columns).enumerate() {
                subtract(&mut self.inverse[column as usize], a, &scaled[i]);
                for b in &scaled[i + 1..] {
                    let target = self.target[pair];
                    pair += 1;
                    if target != NONE {
                        subtract(&mut rest[target as usize - range.end], a, b);
                    }
                }
            }
            self.upper.extend(scaled.iter().map(packed));
        }
        self.upper.push([T::ZERO; 9]);
        true
    }

    /// `z = M^-1 r` for the rows of the piece.
    #[inline(always)]
    pub fn apply(&self, r: &[[T; 4]], z: &mut [[T; 4]]) {
        let n = self.inverse.len();
        let (r, z) = (&r[..n], &mut z[..n]);
        if self.column.is_empty() {
            for (row, z) in z.iter_mut().enumerate() {
                *z = transpose_product(&self.inverse[row], r[row]);
            }
            return;
        }
        z.copy_from_slice(r);
        for row in 0..n {
            let x = z[row];
            let range = self.start[row] as usize..self.start[row + 1] as usize;
            let upper = in_pairs(&self.upper, range.clone());
            for (m, &column) in upper.zip(&self.column[range]) {
                let t = &mut z[column as usize];
                *t = (T::Row::new(*t) - weighted(rows_of(m), &x)).to_array();
            }
        }
        for row in (0..n).rev() {
            let range = self.start[row] as usize..self.start[row + 1] as usize;
            let upper = in_pairs(&self.upper, range.clone());
            let mut sum = [T::Row::splat(T::ZERO); 3];
            // the nearest rows are the last to be known
            for (m, &column) in upper.zip(&self.column[range]).rev() {
                let (m, y) = (rows_of(m), T::Row::new(z[column as usize]));
                for k in 0..3 {
                    sum[k] = sum[k] + m[k] * y;
                }
            }
            let own = weighted(self.inverse[row].map(T::Row::new), &z[row]);
            z[row] = (own - T::Row::sums(sum)).to_array();
        }
    }
}

struct FactorisePiece<'a, T> {
    factor: &'a mut FactorPiece<T>,
    pattern: &'a Pattern,
    piece: &'a Piece,
    matrix: &'a SystemMatrix<T>,
}

impl<T: Scalar> VectorKernel for FactorisePiece<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.factor.factorise(self.pattern, self.piece, self.matrix);
    }
}

/// `t -= a^T b`.
#[inline(always)]
fn subtract<T: Scalar>(t: &mut Block<T>, a: &Block<T>, b: &Block<T>) {
    for r in 0..3 {
        t[r] = sub4(t[r], transpose_product(b, [a[0][r], a[1][r], a[2][r], T::ZERO]));
    }
}
