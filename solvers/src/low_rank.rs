//! The part of a system matrix that couples many vertices at once: `sum b b^T`, never added up, and a preconditioner of
//! the whole. The vectors are gradients of the volumes of clusters or, in bodies without, of the depths of points that touch
//! another body.
//!
//! With such a part condition numbers grow as `lambda/mu`. A preconditioner `M` of the rest, with the rigid motions `R`
//! of aggregates or without, and the diagonal blocks `D` of the rest make a preconditioner of the whole, with which the
//! number of iterations does not depend on `lambda`:
//!
//! ```text
//! S = I + B D^-1 B^T          Q = I - D^-1 B^T S^-1 B
//! P = D^-1 B^T S^-2 B D^-1 + Q (M^-1 + R A_c^-1 R^T) Q^T
//! ```
//!
//! `Q` removes from a motion the part that changes the volume of clusters (the smallest such part, measured by `D`);
//! the first term of `P` solves for that part. With `M = D` and without `R` this is `(D + B^T B)^-1`. `P` is positive
//! definite whatever `M` and `A_c` are, and needs two solves with `S`, which is sparse: clusters that share a vertex.
//! `M` and `A_c` may be those of an earlier state. `B` must be that of the matrix: along `b` the preconditioner has to
//! hold to a part `mu/lambda`. So `S` is formed for every matrix.

use crate::system::{
    Pattern, RankOnes, SystemMatrix, accumulate, add4, inverse, scale4, transpose_product,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::simd::{VectorKernel, vectorised};

/// One number per vector: the product of its entries, at these places, with `x`.
struct Dots<'a, T>(&'a RankOnes<T>, &'a [u32], &'a [[T; 4]], &'a [[T; 4]], &'a mut Vec<T>);

impl<T: Scalar> VectorKernel for Dots<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self(ones, places, entries, x, to) = self;
        to.clear();
        for vector in 0..ones.len() {
            let range = ones.range(vector);
            let mut sum = [0.0; 4];
            for (&place, b) in places[range.clone()].iter().zip(&entries[range]) {
                accumulate(&mut sum, x[place as usize], *b);
            }
            to.push(T::from_f64(sum.iter().sum()));
        }
    }
}

/// Adds the entries of every vector, times its number, to `x` at these places.
struct SpreadVectors<'a, T>(&'a RankOnes<T>, &'a [u32], &'a [[T; 4]], &'a [T], &'a mut [[T; 4]]);

impl<T: Scalar> VectorKernel for SpreadVectors<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self(ones, places, entries, numbers, x) = self;
        for (vector, &number) in numbers.iter().enumerate() {
            let range = ones.range(vector);
            for (&place, b) in places[range.clone()].iter().zip(&entries[range]) {
                let x = &mut x[place as usize];
                *x = add4(*x, scale4(*b, number));
            }
        }
    }
}

/// The correction that turns a preconditioner of the matrix without the vectors into one of the whole. It works on the rows
/// that the vectors have entries at, and leaves the others alone.
#[derive(Clone, Debug, Default)]
pub struct Correction<T> {
    /// `D^-1 b`, entry by entry.
    scaled: Vec<[T; 4]>,
    factor: Profile<T>,
    /// Rows of the vectors that all below is of, and where each vector starts.
    laid_out: [Vec<u32>; 2],
    /// Row, vector and entry, by rows.
    by_row: Vec<[u32; 3]>,
    /// Rows with entries, ascending: piece of the pattern, and row in it.
    rows: Vec<[u32; 2]>,
    /// Which of these each entry is at.
    places: Vec<u32>,
    /// Numbers of `S` while it is formed.
    values: Vec<f64>,
    /// One number per vector: `S^-1 B D^-1 r`, and another.
    s: Vec<T>,
    u: Vec<T>,
    /// One 3-vector per row with entries: the argument and the result of the products below.
    x: Vec<[T; 4]>,
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
    /// Forms `S` for the vectors and diagonal blocks of a matrix, and its factor.
    pub fn form(&mut self, pattern: &Pattern, matrix: &SystemMatrix<T>) {
        let ones = &matrix.low_rank;
        // new ones know not even that there are no vectors
        if self.factor.start.is_empty() || self.laid_out != [&ones.rows[..], &ones.start[..]] {
            self.lay_out(pattern, ones);
        }
        let Self { scaled, factor, by_row, values: s, .. } = self;
        let Profile { first, start, values } = factor;
        let g = ones.len();
        let at = |i: usize, j: usize| (start[i] + j as u32 - first[i]) as usize;
        s.clear();
        s.resize(start[g] as usize, 0.0);
        for i in 0..g {
            s[at(i, i)] = 1.0;
        }
        scaled.clear();
        scaled.resize(ones.rows.len(), [T::ZERO; 4]);
        for own in by_row.chunk_by(|a, b| a[0] == b[0]) {
            let inverse = inverse(&matrix.diagonal[own[0][0] as usize]);
            for (a, of_a) in own.iter().enumerate() {
                let b = ones.entries[of_a[2] as usize];
                scaled[of_a[2] as usize] = transpose_product(&inverse, b);
                for of_b in &own[..=a] {
                    let other = &scaled[of_b[2] as usize];
                    let dot: f64 = (0..3).map(|k| b[k].to_f64() * other[k].to_f64()).sum();
                    s[at(of_a[1] as usize, of_b[1] as usize)] += dot;
                }
            }
        }
        // along volumes the preconditioner has to hold to a part `mu/lambda`, along contact to some hundredths
        let of_contact = matrix.own_vectors == 0;
        if !of_contact && !vectorised(FactoriseProfile(s, first, start)) {
            // only numbers that are not finite get here: the solve has to tell so
            s.fill(f64::NAN);
        }
        values.clear();
        values.extend(s.iter().map(|&x| T::from_f64(x)));
        if of_contact && !vectorised(FactoriseProfile(values, first, start)) {
            values.fill(T::from_f64(f64::NAN));
        }
    }

    /// Finds which vectors share a row.
    fn lay_out(&mut self, pattern: &Pattern, ones: &RankOnes<T>) {
        self.laid_out = [ones.rows.clone(), ones.start.clone()];
        self.by_row.clear();
        for vector in 0..ones.len() {
            let own = ones.range(vector).map(|e| [ones.rows[e], vector as u32, e as u32]);
            self.by_row.extend(own);
        }
        self.by_row.sort_unstable();
        self.rows.clear();
        self.places.resize(ones.rows.len(), 0);
        for own in self.by_row.chunk_by(|a, b| a[0] == b[0]) {
            own.iter().for_each(|of| self.places[of[2] as usize] = self.rows.len() as u32);
            self.rows.push(pattern.place(own[0][0]));
        }
        let Profile { first, start, .. } = &mut self.factor;
        first.clear();
        first.extend(0..ones.len() as u32);
        for own in self.by_row.chunk_by(|a, b| a[0] == b[0]) {
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
    }

    /// `D^-1 B^T S^-1 x` at so many rows.
    pub fn restore(&self, ones: &RankOnes<T>, x: &mut [T], rows: usize) -> Vec<[T; 4]> {
        let mut way = vec![[T::ZERO; 4]; rows];
        vectorised(SolveProfile(&self.factor, x));
        vectorised(SpreadVectors(ones, &ones.rows, &self.scaled, x, &mut way));
        way
    }

    /// Multiplications of 3x3 blocks, about, of one use.
    pub fn work(&self) -> f64 {
        (4 * self.factor.values.len() + 12 * self.scaled.len()) as f64 / 9.0
    }

    /// Reads the rows with entries, by piece and row in it.
    pub fn read(&mut self, of: impl Fn(usize, usize) -> [T; 4]) {
        self.x.clear();
        self.x.extend(self.rows.iter().map(|&[piece, row]| of(piece as usize, row as usize)));
    }

    /// Calls `f` with the piece of each row with entries, the row in it, and what stands for it here.
    pub fn for_rows(&mut self, mut f: impl FnMut(usize, usize, &mut [T; 4])) {
        for (&[piece, row], x) in self.rows.iter().zip(&mut self.x) {
            f(piece as usize, row as usize, x);
        }
    }

    /// Puts `B^T B p` in place of `p`; returns `p . B^T B p`.
    pub fn multiply(&mut self, ones: &RankOnes<T>) -> f64 {
        let Self { places, x, u, .. } = self;
        vectorised(Dots(ones, places, &ones.entries, x, u));
        x.fill([T::ZERO; 4]);
        vectorised(SpreadVectors(ones, places, &ones.entries, u, x));
        u.iter().map(|u| u.to_f64() * u.to_f64()).sum()
    }

    /// Puts `Q^T r` in place of `r`; call it before [`complete`](Self::complete).
    pub fn project(&mut self, ones: &RankOnes<T>) {
        let Self { places, scaled, factor, x, s, u, .. } = self;
        vectorised(Dots(ones, places, scaled, x, s));
        vectorised(SolveProfile(factor, s));
        u.clear();
        u.extend(s.iter().map(|&s| -s));
        vectorised(SpreadVectors(ones, places, &ones.entries, u, x));
    }

    /// Puts `P r - M' Q^T r` in place of `M' Q^T r`, with `M' = M^-1 + R A_c^-1 R^T`; returns `r . P r - Q^T r . M' Q^T r`.
    pub fn complete(&mut self, ones: &RankOnes<T>) -> f64 {
        let Self { places, scaled, factor, x, s, u, .. } = self;
        vectorised(Dots(ones, places, &ones.entries, x, u));
        u.iter_mut().zip(&*s).for_each(|(u, s)| *u = *s - *u);
        vectorised(SolveProfile(factor, u));
        x.fill([T::ZERO; 4]);
        vectorised(SpreadVectors(ones, places, scaled, u, x));
        s.iter().map(|s| s.to_f64() * s.to_f64()).sum()
    }
}

/// Cholesky factor of a symmetric matrix in place, inverses on the diagonal: its rows from their first columns on, and
/// where they start. False, where a pivot is not positive.
struct FactoriseProfile<'a, T>(&'a mut [T], &'a [u32], &'a [u32]);

impl<T: Scalar> VectorKernel for FactoriseProfile<'_, T> {
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
            if !(pivot > T::ZERO && pivot.to_f64().is_finite()) {
                return false;
            }
            own[i - f] = T::ONE / pivot.sqrt();
        }
        true
    }
}

/// Solves in place.
struct SolveProfile<'a, T>(&'a Profile<T>, &'a mut [T]);

impl<T: Scalar> VectorKernel for SolveProfile<'_, T> {
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

/// Scalar product in sixteen partial sums, so that registers are filled whatever their width; what is left over fills
/// registers of four as long as it can.
#[inline(always)]
fn dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::ZERO; 16];
    let (a, b) = (a.chunks_exact(16), b.chunks_exact(16));
    let (few, of_few) = (a.remainder().chunks_exact(4), b.remainder().chunks_exact(4));
    let mut rest = T::ZERO;
    for (x, y) in few.remainder().iter().zip(of_few.remainder()) {
        rest += *x * *y;
    }
    for (x, y) in a.zip(b) {
        for k in 0..16 {
            sums[k] += x[k] * y[k];
        }
    }
    for (x, y) in few.zip(of_few) {
        for k in 0..4 {
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
