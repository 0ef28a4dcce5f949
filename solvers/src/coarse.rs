//! Coarse space of rigid motions: vertices are gathered into compact aggregates, each of which may
//! move rigidly (six unknowns), the Galerkin matrix of these motions is factorised exactly, and the
//! correction is added to that of the fine preconditioner. Conjugate gradients then no longer have to
//! carry forces from one end of a body to the other vertex by vertex.
//!
//! Aggregates come from recursive bisection of the rest positions across the longest side, connected
//! piece by connected piece. They are numbered along the body, so that the Galerkin matrix has a
//! narrow envelope, in which its Cholesky factor stays. Motions that held vertices or a degenerate
//! aggregate leave without stiffness have no pivot and are left out.

use crate::system::{Pattern, SystemMatrix};
use glam::DVec3;
use sinew_engine::scalar::Scalar;
use sinew_engine::workers::Workers;

/// Rigid motions of aggregates.
#[derive(Clone, Debug, Default)]
pub struct CoarseSpace<T> {
    /// Aggregate of each row.
    aggregate: Vec<u32>,
    /// Position of each row relative to the centre of its aggregate, over the aggregate's radius.
    arm: Vec<[T; 4]>,
    /// Pairs of coupled aggregates `a <= b` and what they are summed from.
    blocks: Vec<CoarseBlock>,
    terms: Vec<Term>,
    values: Vec<[f64; 36]>,
    factor: Envelope<T>,
}

#[derive(Clone, Debug)]
struct CoarseBlock {
    pair: [u32; 2],
    /// Last entry of `terms` plus one.
    end: u32,
}

/// One block of the fine matrix; a diagonal one has equal rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Term {
    pair: [u32; 2],
    row: u32,
    column: u32,
    block: u32,
}

/// Unknowns of an aggregate.
const MODES: usize = 6;

impl<T: Scalar> CoarseSpace<T> {
    /// Aggregates of about `size` vertices. `rest` and `piece` give the rest position and the
    /// connected piece of every row.
    pub fn new(pattern: &Pattern, rest: &[DVec3], piece: &[u32], size: usize) -> Self {
        let n = pattern.len();
        let mut groups = Vec::new();
        let mut order: Vec<u32> = (0..n as u32).collect();
        order.sort_by_key(|&row| (piece[row as usize], row));
        for rows in order.chunk_by_mut(|a, b| piece[*a as usize] == piece[*b as usize]) {
            let count = ((rows.len() + size / 2) / size).max(1);
            bisect(rest, rows, count, &mut groups);
        }
        // along the body
        groups.sort_by_cached_key(|rows| {
            let sum: u64 = rows.iter().map(|&r| u64::from(r)).sum();
            (sum * 16 / rows.len() as u64, rows.iter().min().copied())
        });
        let mut aggregate = vec![0; n];
        let mut arm = vec![[T::ZERO; 4]; n];
        for (i, rows) in groups.iter().enumerate() {
            let centre = rows.iter().map(|&r| rest[r as usize]).sum::<DVec3>() / rows.len() as f64;
            let from = |r: u32| rest[r as usize] - centre;
            let radius = rows.iter().map(|&r| from(r).length()).fold(0.0, f64::max);
            for &r in rows {
                let a = if radius > 0.0 { from(r) / radius } else { DVec3::ZERO };
                aggregate[r as usize] = i as u32;
                arm[r as usize] = [T::from_f64(a.x), T::from_f64(a.y), T::from_f64(a.z), T::ZERO];
            }
        }
        let mut terms = Vec::with_capacity(n + pattern.column.len());
        for row in 0..n {
            let own = aggregate[row];
            terms.push(Term { pair: [own; 2], row: row as u32, column: row as u32, block: 0 });
            for block in pattern.blocks(row) {
                let column = pattern.column[block];
                let other = aggregate[column as usize];
                terms.push(Term {
                    pair: [own.min(other), own.max(other)],
                    row: row as u32,
                    column,
                    block: block as u32,
                });
            }
        }
        terms.sort_unstable();
        let mut blocks: Vec<CoarseBlock> = Vec::new();
        for (i, term) in terms.iter().enumerate() {
            match blocks.last_mut() {
                Some(last) if last.pair == term.pair => last.end = i as u32 + 1,
                _ => blocks.push(CoarseBlock { pair: term.pair, end: i as u32 + 1 }),
            }
        }
        let factor = Envelope::new(groups.len(), blocks.iter().map(|b| b.pair));
        let values = vec![[0.0; 36]; blocks.len()];
        Self { aggregate, arm, blocks, terms, values, factor }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.factor.len()
    }

    /// Multiplications of 3x3 blocks, about, that [`Self::factorise`] takes.
    pub fn work(&self) -> f64 {
        let dots: f64 = self
            .factor
            .first
            .iter()
            .enumerate()
            .map(|(i, &f)| {
                let length = (i - f as usize) as f64;
                0.5 * length * length
            })
            .sum();
        3.0 * self.terms.len() as f64 + dots / 27.0
    }

    /// Multiplications of 3x3 blocks, about, of one [`Self::solve`].
    pub fn solve_work(&self) -> f64 {
        self.factor.lower.len() as f64 * 2.0 / 9.0
    }

    /// Galerkin matrix of `matrix` and its factor.
    pub fn factorise(&mut self, workers: &Workers, matrix: &SystemMatrix<T>) {
        let Self { arm, blocks, terms, values, .. } = self;
        let work = terms.len() * 40;
        workers.for_chunks(values, 16, work, |first, values| {
            for (i, value) in values.iter_mut().enumerate() {
                let block = first + i;
                let begin = if block == 0 { 0 } else { blocks[block - 1].end as usize };
                *value = galerkin(
                    &terms[begin..blocks[block].end as usize],
                    arm,
                    matrix,
                    &self.aggregate,
                );
            }
        });
        self.factor.clear();
        for (block, value) in self.blocks.iter().zip(&self.values) {
            self.factor.set(block.pair, value);
        }
        self.factor.factorise();
    }

    /// Adds the forces `r` on the rows `first..` to the forces on the motions of the aggregates
    /// `aggregate..`.
    pub fn restrict(&self, first: usize, r: &[[T; 4]], aggregate: usize, coarse: &mut [[T; 8]]) {
        let last = first + r.len();
        let rows = self.aggregate[first..last].iter().zip(&self.arm[first..last]);
        for ((&a, arm), f) in rows.zip(r) {
            let c = &mut coarse[a as usize - aggregate];
            for k in 0..3 {
                c[k] += f[k];
            }
            c[3] += arm[1] * f[2] - arm[2] * f[1];
            c[4] += arm[2] * f[0] - arm[0] * f[2];
            c[5] += arm[0] * f[1] - arm[1] * f[0];
        }
    }

    /// Motion of a row, held unknowns included.
    #[inline(always)]
    pub fn prolong(&self, row: usize, coarse: &[[T; 8]]) -> [T; 4] {
        let c = &coarse[self.aggregate[row] as usize];
        let arm = &self.arm[row];
        [
            c[0] + (c[4] * arm[2] - c[5] * arm[1]),
            c[1] + (c[5] * arm[0] - c[3] * arm[2]),
            c[2] + (c[3] * arm[1] - c[4] * arm[0]),
            T::ZERO,
        ]
    }

    /// Number of aggregates.
    pub fn aggregates(&self) -> usize {
        self.unknowns() / MODES
    }

    /// Aggregates of the rows of a range, lowest to highest.
    pub fn aggregates_of(&self, rows: std::ops::Range<usize>) -> std::ops::Range<usize> {
        let own = &self.aggregate[rows];
        let low = own.iter().min().map_or(0, |&a| a as usize);
        low..own.iter().max().map_or(0, |&a| a as usize + 1)
    }

    /// Solves for the motions in place and returns the scalar product of forces and motions.
    pub fn solve(&mut self, coarse: &mut [[T; 8]]) -> f64 {
        let factor = &mut self.factor;
        for (x, c) in factor.x.chunks_exact_mut(MODES).zip(&*coarse) {
            x.copy_from_slice(&c[..MODES]);
        }
        factor.solve();
        let mut dot = 0.0;
        for (x, c) in factor.x.chunks_exact(MODES).zip(coarse) {
            for k in 0..MODES {
                dot += x[k].to_f64() * c[k].to_f64();
                c[k] = x[k];
            }
        }
        dot
    }
}

/// Halves `rows` across the longest side until `count` groups are left of them.
fn bisect(rest: &[DVec3], rows: &mut [u32], count: usize, groups: &mut Vec<Vec<u32>>) {
    if count <= 1 {
        groups.push(rows.to_vec());
        return;
    }
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &r in rows.iter() {
        (low, high) = (low.min(rest[r as usize]), high.max(rest[r as usize]));
    }
    let side = high - low;
    let axis = (0..3).max_by(|&a, &b| side[a].total_cmp(&side[b]).then(b.cmp(&a))).unwrap_or(0);
    let left = count / 2;
    let middle = rows.len() * left / count;
    rows.select_nth_unstable_by(middle, |&a, &b| {
        rest[a as usize][axis].total_cmp(&rest[b as usize][axis]).then(a.cmp(&b))
    });
    let (a, b) = rows.split_at_mut(middle);
    bisect(rest, a, left, groups);
    bisect(rest, b, count - left, groups);
}

/// Sum of `B_i^T A_ij B_j` with `B = [I, -arm x]` over the fine blocks of one coarse block, row-major.
fn galerkin<T: Scalar>(
    terms: &[Term],
    arm: &[[T; 4]],
    matrix: &SystemMatrix<T>,
    aggregate: &[u32],
) -> [f64; 36] {
    let mut sum = [0.0; 36];
    for term in terms {
        let (row, column) = (term.row as usize, term.column as usize);
        let diagonal = row == column;
        let m = if diagonal {
            let mut m = matrix.diagonal[row];
            for k in (0..3).filter(|&k| matrix.held[row].holds(k)) {
                m[k][k] = T::ZERO;
            }
            m
        } else {
            matrix.upper[term.block as usize]
        };
        let inside = term.pair[0] == term.pair[1];
        // the half that is stored may lead from the higher aggregate to the lower
        let turned = aggregate[row] != term.pair[0];
        let product = congruence(&m, &arm[row], &arm[column]);
        for i in 0..MODES {
            for j in 0..MODES {
                let x = product[i][j].to_f64();
                if turned || (inside && !diagonal) {
                    sum[MODES * j + i] += x;
                }
                if !turned {
                    sum[MODES * i + j] += x;
                }
            }
        }
    }
    sum
}

/// `B_i^T m B_j`.
#[inline(always)]
fn congruence<T: Scalar>(m: &[[T; 4]; 3], a: &[T; 4], b: &[T; 4]) -> [[T; 6]; 6] {
    // m B_j: a turn w moves by w x b, so column k of the turning part is m (e_k x b)
    let mut t = [[T::ZERO; 6]; 3];
    for r in 0..3 {
        let x = &m[r];
        t[r] = [
            x[0],
            x[1],
            x[2],
            x[2] * b[1] - x[1] * b[2],
            x[0] * b[2] - x[2] * b[0],
            x[1] * b[0] - x[0] * b[1],
        ];
    }
    let mut out = [[T::ZERO; 6]; 6];
    for c in 0..6 {
        let f = [t[0][c], t[1][c], t[2][c]];
        out[0][c] = f[0];
        out[1][c] = f[1];
        out[2][c] = f[2];
        out[3][c] = a[1] * f[2] - a[2] * f[1];
        out[4][c] = a[2] * f[0] - a[0] * f[2];
        out[5][c] = a[0] * f[1] - a[1] * f[0];
    }
    out
}

/// Cholesky factor of a symmetric matrix within its envelope: every row is stored from its first
/// entry to the one before the diagonal.
#[derive(Clone, Debug, Default)]
struct Envelope<T> {
    /// Column of the first entry of each row.
    first: Vec<u32>,
    /// Where each row starts.
    start: Vec<usize>,
    work: Vec<f64>,
    diagonal: Vec<f64>,
    lower: Vec<T>,
    /// Inverse diagonal of the factor; zero for unknowns without a pivot.
    inverse: Vec<T>,
    x: Vec<T>,
}

/// Pivots below this share of the diagonal entry are rounding of the sums behind them.
const PIVOT: f64 = 1e-6;

impl<T: Scalar> Envelope<T> {
    fn new(nodes: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let mut lowest: Vec<u32> = (0..nodes as u32).collect();
        for [a, b] in pairs {
            lowest[b as usize] = lowest[b as usize].min(a);
        }
        let n = nodes * MODES;
        let mut start = vec![0];
        let mut first = Vec::with_capacity(n);
        for i in 0..n {
            let f = lowest[i / MODES] * MODES as u32;
            first.push(f);
            start.push(start[i] + i - f as usize);
        }
        let size = start[n];
        Self {
            first,
            start,
            work: vec![0.0; size],
            diagonal: vec![0.0; n],
            lower: vec![T::ZERO; size],
            inverse: vec![T::ZERO; n],
            x: vec![T::ZERO; n],
        }
    }

    fn len(&self) -> usize {
        self.diagonal.len()
    }

    fn clear(&mut self) {
        self.work.fill(0.0);
        self.diagonal.fill(0.0);
    }

    /// Enters the block that couples the nodes `a <= b`.
    fn set(&mut self, [a, b]: [u32; 2], value: &[f64; 36]) {
        for k in 0..MODES {
            let row = b as usize * MODES + k;
            for l in 0..MODES {
                let column = a as usize * MODES + l;
                if column < row {
                    let at = self.start[row] + column - self.first[row] as usize;
                    self.work[at] = value[MODES * l + k];
                } else if column == row {
                    self.diagonal[row] = value[MODES * k + k];
                }
            }
        }
    }

    /// Row by row; a row is the solution of a triangular system with the rows above it.
    fn factorise(&mut self) {
        for row in 0..self.len() {
            let f = self.first[row] as usize;
            let (above, own) = self.work.split_at_mut(self.start[row]);
            let own = &mut own[..row - f];
            for column in f..row {
                let of_column = self.first[column] as usize;
                let from = f.max(of_column);
                let begin = self.start[column] + from - of_column;
                let other = &above[begin..begin + column - from];
                let dot = dot_lanes(other, &own[from - f..column - f]);
                // without a pivot the unknown stays out of the factor
                own[column - f] = (own[column - f] - dot) * self.diagonal[column];
            }
            let pivot = self.diagonal[row] - dot_lanes(own, own);
            let good = pivot > PIVOT * self.diagonal[row] && pivot.is_finite();
            if !good {
                own.fill(0.0);
            }
            self.diagonal[row] = if good { 1.0 / pivot.sqrt() } else { 0.0 };
        }
        for (t, x) in self.lower.iter_mut().zip(&self.work) {
            *t = T::from_f64(*x);
        }
        for (t, x) in self.inverse.iter_mut().zip(&self.diagonal) {
            *t = T::from_f64(*x);
        }
    }

    /// Solves in place for `self.x`.
    fn solve(&mut self) {
        for row in 0..self.len() {
            let f = self.first[row] as usize;
            let own = &self.lower[self.start[row]..self.start[row + 1]];
            let dot = dot_lanes(own, &self.x[f..row]);
            self.x[row] = (self.x[row] - dot) * self.inverse[row];
        }
        for row in (0..self.len()).rev() {
            let f = self.first[row] as usize;
            let own = &self.lower[self.start[row]..self.start[row + 1]];
            let x = self.x[row] * self.inverse[row];
            self.x[row] = x;
            for (t, l) in self.x[f..row].iter_mut().zip(own) {
                *t -= *l * x;
            }
        }
    }
}

/// Scalar product with sixteen partial sums, always added up in the same order.
#[inline(always)]
fn dot_lanes<T: Scalar>(a: &[T], b: &[T]) -> T {
    const LANES: usize = 16;
    let mut sum = [T::ZERO; LANES];
    let (mut x, mut y) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    for (x, y) in x.by_ref().zip(y.by_ref()) {
        for k in 0..LANES {
            sum[k] += x[k] * y[k];
        }
    }
    let mut total = T::ZERO;
    for k in 0..LANES {
        total += sum[k];
    }
    for (x, y) in x.remainder().iter().zip(y.remainder()) {
        total += *x * *y;
    }
    total
}
