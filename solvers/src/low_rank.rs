//! The part of a system matrix that couples many vertices at once: `sum b b^T`, never added up, and a preconditioner of
//! the whole.
//!
//! With such a part condition numbers grow as `lambda/mu`. Block Jacobi `D^-1` of the rest and the rigid motions `R` of
//! aggregates, with their Galerkin matrix `A_c` of the rest, make one that does not know `lambda`:
//!
//! ```text
//! S   = I + B D^-1 B^T
//! P_D = D^-1 - D^-1 B^T S^-1 B D^-1 = (D + B^T B)^-1
//! P   = P_D + Q R A_c^-1 R^T Q^T           Q = I - D^-1 B^T S^-1 B
//! ```
//!
//! `Q` takes from a motion what changes the volume of clusters, as `D` measures it, so that `P` is positive definite
//! whatever `A_c` is, and needs no more than two solves with `S`, which is sparse: clusters that share a vertex. `D` and `A_c` may
//! be those of an earlier state. `B` must be that of the matrix: along `b` the preconditioner has to hold to a part
//! `mu/lambda`. So `S` is formed for every matrix.

use crate::cholesky::IncompleteCholesky;
use crate::coarse::CoarseSpace;
use crate::simd::{Kernel, vectorised};
use crate::system::{Pattern, accumulate, add4, scale4, sub4};
use serde::{Deserialize, Serialize};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::FixedAxes;
use std::ops::Range;

/// Vectors `b` of a matrix `sum b b^T` on the rows of some bodies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct RankOnes<T> {
    /// First entry of each vector (one more than vectors; empty without any).
    pub start: Vec<u32>,
    /// Row of each entry.
    pub rows: Vec<u32>,
    /// The 3-vectors at those rows.
    pub entries: Vec<[T; 4]>,
}

impl<T: Scalar> RankOnes<T> {
    /// Number of vectors.
    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Forgets all vectors.
    pub fn clear(&mut self) {
        self.start.clear();
        self.rows.clear();
        self.entries.clear();
    }

    /// Adds a vector; entries of held unknowns become zero.
    pub fn push(&mut self, held: &[FixedAxes], entries: impl Iterator<Item = (u32, [f64; 3])>) {
        if self.start.is_empty() {
            self.start.push(0);
        }
        for (row, b) in entries {
            let held = held[row as usize];
            let free = |k: usize| if held.holds(k) { 0.0 } else { b[k] };
            self.rows.push(row);
            self.entries.push([
                T::from_f64(free(0)),
                T::from_f64(free(1)),
                T::from_f64(free(2)),
                T::ZERO,
            ]);
        }
        self.start.push(self.rows.len() as u32);
    }

    /// Entries of a vector.
    pub fn range(&self, vector: usize) -> Range<usize> {
        self.start[vector] as usize..self.start[vector + 1] as usize
    }

    /// Whether the vectors stand at the same rows.
    #[cfg(feature = "direct")]
    pub fn fits(&self, other: &Self) -> bool {
        self.start == other.start && self.rows == other.rows
    }
}

/// Piece of each row of a vector of pieces, and its place there.
pub type Places = Vec<[u32; 2]>;

/// Where the entries of `ones` stand in vectors that are cut into the pieces of a pattern.
pub fn places<T: Scalar>(ones: &RankOnes<T>, pattern: &Pattern, to: &mut Places) {
    to.clear();
    to.extend(ones.rows.iter().map(|&row| {
        let row = row as usize;
        let piece = pattern.pieces.partition_point(|piece| piece.rows.end <= row);
        [piece as u32, (row - pattern.pieces[piece].rows.start) as u32]
    }));
}

/// Product of every vector with one that is cut into pieces, and what it adds: `q += B^T B p`; returns `p . B^T B p`.
pub fn add_product<T: Scalar>(
    ones: &RankOnes<T>,
    places: &Places,
    product: &mut [(&[[T; 4]], &mut [[T; 4]])],
) -> f64 {
    let mut dot = 0.0;
    for vector in 0..ones.len() {
        let range = ones.range(vector);
        let own = places[range.clone()].iter().zip(&ones.entries[range]);
        let mut sum = [0.0; 4];
        for (&[piece, row], b) in own.clone() {
            accumulate(&mut sum, product[piece as usize].0[row as usize], *b);
        }
        let sum: f64 = sum.iter().sum();
        dot += sum * sum;
        let sum = T::from_f64(sum);
        for (&[piece, row], b) in own {
            let q = &mut product[piece as usize].1[row as usize];
            *q = add4(*q, scale4(*b, sum));
        }
    }
    dot
}

/// What makes a preconditioner of the matrix without the vectors one of the whole.
#[derive(Clone, Debug, Default)]
pub struct Correction<T> {
    /// Forces of the vectors on the motions of aggregates: first entry of each vector, aggregates, forces.
    coarse_start: Vec<u32>,
    coarse: Vec<(u32, [T; 8])>,
    factor: Profile<T>,
    /// Numbers of `S` while it is formed.
    values: Vec<f64>,
    /// One number per vector.
    u: Vec<T>,
    s: Vec<T>,
    /// One 3-vector per row, and what the diagonal blocks make of a piece of it.
    w: Vec<[T; 4]>,
    z: Vec<[T; 4]>,
}

/// A symmetric matrix by rows, each from its first column to its diagonal.
#[derive(Clone, Debug, Default)]
struct Profile<T> {
    /// First column of each row, and where the row starts.
    first: Vec<u32>,
    start: Vec<u32>,
    /// Cholesky factor, inverses on the diagonal.
    values: Vec<T>,
}

impl<T: Scalar> Correction<T> {
    /// Forms `S` for the vectors, with the diagonal blocks as they are, and its factor.
    pub fn form(
        &mut self,
        ones: &RankOnes<T>,
        pattern: &Pattern,
        jacobi: &IncompleteCholesky<T>,
        coarse: Option<&CoarseSpace<T>>,
    ) {
        let g = ones.len();
        let mut by_row: Vec<[u32; 3]> = Vec::with_capacity(ones.rows.len());
        for vector in 0..g {
            by_row.extend(ones.range(vector).map(|e| [ones.rows[e], vector as u32, e as u32]));
        }
        by_row.sort_unstable();
        let Profile { first, start, .. } = &mut self.factor;
        first.clear();
        first.extend(0..g as u32);
        for own in by_row.chunk_by(|a, b| a[0] == b[0]) {
            for of in own {
                let to = &mut first[of[1] as usize];
                *to = own[0][1].min(*to);
            }
        }
        start.clear();
        start.push(0);
        for (row, first) in first.iter().enumerate() {
            start.push(start[row] + row as u32 + 1 - first);
        }
        let at = |i: usize, j: usize| (start[i] + j as u32 - first[i]) as usize;
        let s = &mut self.values;
        s.clear();
        s.resize(start[g] as usize, 0.0);
        for i in 0..g {
            s[at(i, i)] = 1.0;
        }
        let mut scaled = Vec::new();
        let mut piece = 0;
        for own in by_row.chunk_by(|a, b| a[0] == b[0]) {
            let row = own[0][0] as usize;
            while pattern.pieces[piece].rows.end <= row {
                piece += 1;
            }
            let local = row - pattern.pieces[piece].rows.start;
            let factor = &jacobi.pieces[piece];
            scaled.clear();
            scaled.extend(own.iter().map(|e| factor.apply_row(local, ones.entries[e[2] as usize])));
            for (a, of_a) in own.iter().enumerate() {
                let b = ones.entries[of_a[2] as usize];
                for (of_b, scaled) in own[..=a].iter().zip(&scaled) {
                    let dot: f64 = (0..3).map(|k| b[k].to_f64() * scaled[k].to_f64()).sum();
                    s[at(of_a[1] as usize, of_b[1] as usize)] += dot;
                }
            }
        }
        if !vectorised(Factorise(s, first, start)) {
            // only numbers that are not finite get here: the solve has to tell so
            s.fill(f64::NAN);
        }
        self.factor.values.clear();
        self.factor.values.extend(s.iter().map(|&x| T::from_f64(x)));
        self.coarse.clear();
        self.coarse_start.clear();
        if let Some(coarse) = coarse {
            self.restrict(ones, coarse);
        }
    }

    /// Forces of all vectors on the motions of aggregates.
    fn restrict(&mut self, ones: &RankOnes<T>, coarse: &CoarseSpace<T>) {
        let Self { coarse: to, coarse_start, .. } = self;
        coarse_start.push(0);
        let mut own: Vec<(u32, [T; 8])> = Vec::new();
        for vector in 0..ones.len() {
            own.clear();
            for entry in ones.range(vector) {
                let row = ones.rows[entry] as usize;
                let aggregate = coarse.aggregates_of(row..row + 1).start as u32;
                let at = own.iter().position(|(a, _)| *a == aggregate).unwrap_or_else(|| {
                    own.push((aggregate, [T::ZERO; 8]));
                    own.len() - 1
                });
                let force = std::slice::from_mut(&mut own[at].1);
                coarse.restrict(row, &ones.entries[entry..=entry], aggregate as usize, force);
            }
            to.extend_from_slice(&own);
            coarse_start.push(to.len() as u32);
        }
    }

    /// `D^-1 B^T S^-1 x`, piece by piece.
    pub fn restore(
        &mut self,
        ones: &RankOnes<T>,
        pattern: &Pattern,
        jacobi: &IncompleteCholesky<T>,
        x: &mut [T],
        mut to: impl FnMut(usize, [T; 4]),
    ) {
        vectorised(Solve(&self.factor, x));
        self.spread(ones, pattern, x);
        for (piece, own) in pattern.pieces.iter().zip(&jacobi.pieces) {
            for (local, row) in piece.rows.clone().enumerate() {
                to(row, own.apply_row(local, self.w[row]));
            }
        }
    }

    /// `B^T x` into `w`.
    fn spread(&mut self, ones: &RankOnes<T>, pattern: &Pattern, x: &[T]) {
        self.w.clear();
        self.w.resize(pattern.len(), [T::ZERO; 4]);
        for (vector, &x) in x.iter().enumerate() {
            let range = ones.range(vector);
            for (&row, b) in ones.rows[range.clone()].iter().zip(&ones.entries[range]) {
                let w = &mut self.w[row as usize];
                *w = add4(*w, scale4(*b, x));
            }
        }
    }

    fn coarse_of(&self, vector: usize) -> &[(u32, [T; 8])] {
        match self.coarse_start.get(vector + 1) {
            Some(&end) => &self.coarse[self.coarse_start[vector] as usize..end as usize],
            None => &[],
        }
    }

    /// Multiplications of 3x3 blocks, about, of one use.
    pub fn work(&self) -> f64 {
        4.0 * self.factor.values.len() as f64 / 9.0
    }

    /// Turns `D^-1 r` into `P r`: `z` holds it, piece by piece, `motions` the forces `R^T r` and then the
    /// motions of aggregates. Returns what `r . P r` has more than `r . D^-1 r`.
    pub fn apply(
        &mut self,
        (ones, places): (&RankOnes<T>, &Places),
        pattern: &Pattern,
        jacobi: &IncompleteCholesky<T>,
        coarse: Option<&mut CoarseSpace<T>>,
        z: &mut [&mut [[T; 4]]],
        motions: &mut [[T; 8]],
    ) -> f64 {
        let g = ones.len();
        let (mut u, mut s) = (std::mem::take(&mut self.u), std::mem::take(&mut self.s));
        u.clear();
        for vector in 0..g {
            let range = ones.range(vector);
            let own = places[range.clone()].iter().zip(&ones.entries[range]);
            let mut sum = [0.0; 4];
            for (&[piece, row], b) in own {
                accumulate(&mut sum, z[piece as usize][row as usize], *b);
            }
            u.push(T::from_f64(sum.iter().sum()));
        }
        s.clone_from(&u);
        vectorised(Solve(&self.factor, &mut s));
        let lost: f64 = u.iter().zip(&s).map(|(u, s)| u.to_f64() * s.to_f64()).sum();
        let mut more = -lost;
        if let Some(coarse) = coarse {
            for (vector, &s) in s.iter().enumerate() {
                for (aggregate, force) in self.coarse_of(vector) {
                    let to = &mut motions[*aggregate as usize];
                    for k in 0..6 {
                        to[k] -= s * force[k];
                    }
                }
            }
            more += coarse.solve(motions);
            for (vector, u) in u.iter_mut().enumerate() {
                let change = |(aggregate, force): &(u32, [T; 8])| -> f64 {
                    let x = &motions[*aggregate as usize];
                    (0..6).map(|k| force[k].to_f64() * x[k].to_f64()).sum()
                };
                *u = T::from_f64(self.coarse_of(vector).iter().map(change).sum());
            }
            vectorised(Solve(&self.factor, &mut u));
            s.iter_mut().zip(&u).for_each(|(s, more)| *s += *more);
        }
        self.spread(ones, pattern, &s);
        for ((piece, own), z) in pattern.pieces.iter().zip(&jacobi.pieces).zip(z) {
            self.z.resize(piece.rows.len(), [T::ZERO; 4]);
            own.apply(&self.w[piece.rows.clone()], &mut self.z);
            for (z, less) in z.iter_mut().zip(&self.z) {
                *z = sub4(*z, *less);
            }
        }
        (self.u, self.s) = (u, s);
        more
    }
}

/// Cholesky factor of a symmetric matrix in place, inverses on the diagonal: its rows from their first columns on, and
/// where they start. False, where a pivot is not positive.
struct Factorise<'a>(&'a mut [f64], &'a [u32], &'a [u32]);

impl Kernel for Factorise<'_> {
    type Output = bool;
    #[inline(always)]
    fn run(self) -> bool {
        let Self(values, first, start) = self;
        for (i, &f) in first.iter().enumerate() {
            let (above, own) = values.split_at_mut(start[i] as usize);
            let f = f as usize;
            let own = &mut own[..i + 1 - f];
            for j in f..i {
                let of_j = first[j] as usize;
                let from = f.max(of_j);
                let row = &above[start[j] as usize..start[j] as usize + j + 1 - of_j];
                let (known, inverse) = (&row[from - of_j..j - of_j], row[j - of_j]);
                own[j - f] = (own[j - f] - dot(known, &own[from - f..j - f])) * inverse;
            }
            let pivot = own[i - f] - dot(&own[..i - f], &own[..i - f]);
            // written so that a pivot that is not a number fails too
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            own[i - f] = pivot.sqrt().recip();
        }
        true
    }
}

/// Solves in place.
struct Solve<'a, T>(&'a Profile<T>, &'a mut [T]);

impl<T: Scalar> Kernel for Solve<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self(Profile { first, start, values }, x) = self;
        let row = |i: usize| &values[start[i] as usize..start[i + 1] as usize];
        for (i, &f) in first.iter().enumerate() {
            let (known, diagonal) = row(i).split_at(i - f as usize);
            x[i] = (x[i] - dot(known, &x[f as usize..i])) * diagonal[0];
        }
        for (i, &f) in first.iter().enumerate().rev() {
            let (known, diagonal) = row(i).split_at(i - f as usize);
            let own = x[i] * diagonal[0];
            x[i] = own;
            for (x, l) in x[f as usize..i].iter_mut().zip(known) {
                *x -= *l * own;
            }
        }
    }
}

/// Scalar product in sixteen partial sums, so that registers are filled whatever their width.
#[inline(always)]
fn dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::ZERO; 16];
    let (a, b) = (a.chunks_exact(16), b.chunks_exact(16));
    let mut rest = T::ZERO;
    for (x, y) in a.remainder().iter().zip(b.remainder()) {
        rest += *x * *y;
    }
    for (x, y) in a.zip(b) {
        for k in 0..16 {
            sums[k] += x[k] * y[k];
        }
    }
    for k in 0..8 {
        sums[k] += sums[k + 8];
    }
    for k in 0..4 {
        sums[k] += sums[k + 4];
    }
    rest + ((sums[0] + sums[2]) + (sums[1] + sums[3]))
}
