//! Coarse space of rigid motions: vertices are gathered into compact aggregates, each of which may
//! move rigidly (six unknowns), the Galerkin matrix of these motions is factorised exactly, and the
//! correction is added to that of the fine preconditioner. Conjugate gradients then no longer have to
//! carry forces from one end of a body to the other vertex by vertex.
//!
//! Aggregates come from recursive bisection of the rest positions across the longest side, connected
//! piece by connected piece. They are numbered along the body, so that the Galerkin matrix has a
//! narrow envelope, in which its Cholesky factor stays. Motions that held vertices or a degenerate
//! aggregate leave without stiffness have no pivot and are left out.

use crate::simd::{VectorKernel, vectorised};
use crate::system::{Pattern, SystemMatrix, add4, mul4, sub4};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;

/// Rigid motions of aggregates.
#[derive(Clone, Debug, Default)]
pub struct CoarseSpace<T> {
    /// Aggregate of each row.
    aggregate: Vec<u32>,
    /// Position of each row relative to the centre of its aggregate, over the aggregate's radius, in
    /// the orders yzx and zxy.
    arm: Vec<[[T; 4]; 2]>,
    /// Pairs of coupled aggregates `a <= b` and the blocks of the matrix that they are summed from.
    blocks: Vec<CoarseBlock>,
    terms: Vec<Term>,
    values: Vec<[f64; 36]>,
    factor: Envelope<T>,
    forces: Vec<[T; 8]>,
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

/// Translation of an aggregate, and its turn in the orders yzx and zxy.
pub type Motion<T> = [[T; 4]; 3];

/// Unknowns of an aggregate.
const MODES: usize = 6;

/// The numbers of its factor.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct CoarseValues<T> {
    lower: Vec<Columns<T>>,
    inverse: Vec<Columns<T>>,
}

impl<T: Scalar> CoarseSpace<T> {
    /// The numbers of the factor.
    pub fn values(&self) -> CoarseValues<T> {
        CoarseValues { lower: self.factor.lower.clone(), inverse: self.factor.inverse.clone() }
    }

    /// Takes the numbers of a factor over; false, where that factor has another shape.
    pub fn recall(&mut self, values: &CoarseValues<T>) -> bool {
        let fits = self.factor.lower.len() == values.lower.len()
            && self.factor.inverse.len() == values.inverse.len();
        if fits {
            self.factor.lower.clone_from(&values.lower);
            self.factor.inverse.clone_from(&values.inverse);
        }
        fits
    }

    /// Aggregates of about `size` vertices. `rest` and `piece` give the rest position and the
    /// connected piece of every row.
    pub fn new(pattern: &Pattern, rest: &[DVec3], piece: &[u32], size: usize) -> Self {
        let n = pattern.len();
        let Aggregates { of: aggregate, arm, count } = Aggregates::new(rest, piece, size);
        let orders = |arm: &DVec3| {
            let [x, y, z] = arm.to_array().map(T::from_f64);
            [[y, z, x, T::ZERO], [z, x, y, T::ZERO]]
        };
        let arm = arm.iter().map(orders).collect();
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
        let factor = Envelope::new(count, blocks.iter().map(|b| b.pair));
        let values = vec![[0.0; 36]; blocks.len()];
        Self { aggregate, arm, blocks, terms, values, factor, forces: Vec::new() }
    }

    /// Multiplications of 3x3 blocks, about, that [`Self::factorise`] takes.
    pub fn work(&self) -> f64 {
        let rows = self.factor.first.iter().enumerate();
        let products: f64 = rows.map(|(i, &f)| 0.5 * ((i - f as usize) as f64).powi(2)).sum();
        3.0 * self.terms.len() as f64 + 8.0 * products
    }

    /// Multiplications of 3x3 blocks, about, of one [`Self::solve`].
    pub fn solve_work(&self) -> f64 {
        8.0 * self.factor.lower.len() as f64
    }

    /// Galerkin matrix of `matrix` and its factor.
    pub fn factorise(&mut self, workers: &Workers, matrix: &SystemMatrix<T>) {
        let Self { arm, blocks, terms, values, .. } = self;
        let work = terms.len() * 40;
        workers.for_chunks(values, 16, work, |first, values| {
            let aggregate = &self.aggregate;
            vectorised(Galerkin { first, values, blocks, terms, arm, matrix, aggregate });
        });
        self.factor.clear();
        for (block, value) in self.blocks.iter().zip(&self.values) {
            self.factor.set(block.pair, value);
        }
        vectorised(FactoriseEnvelope(&mut self.factor));
    }

    /// Adds the forces `r` on the rows `first..` to the forces on the motions of the aggregates
    /// `aggregate..`.
    #[inline(always)]
    pub fn restrict(&self, first: usize, r: &[[T; 4]], aggregate: usize, coarse: &mut [[T; 8]]) {
        let last = first + r.len();
        let rows = self.aggregate[first..last].iter().zip(&self.arm[first..last]);
        for ((&a, arm), f) in rows.zip(r) {
            let c = &mut coarse[a as usize - aggregate];
            // turning part: arm x f
            let [x, y, z, _] = *f;
            let turn = sub4(mul4(arm[0], [z, x, y, T::ZERO]), mul4(arm[1], [y, z, x, T::ZERO]));
            *c = [
                c[0] + x,
                c[1] + y,
                c[2] + z,
                c[3] + turn[0],
                c[4] + turn[1],
                c[5] + turn[2],
                T::ZERO,
                T::ZERO,
            ];
        }
    }

    /// Translation of every aggregate, and its turn with axes moved up by one and by two.
    #[inline(always)]
    pub fn motions(coarse: &[[T; 8]], motions: &mut Vec<Motion<T>>) {
        motions.clear();
        motions.extend(coarse.iter().map(|c| {
            let [x, y, z] = [c[3], c[4], c[5]];
            [[c[0], c[1], c[2], T::ZERO], [y, z, x, T::ZERO], [z, x, y, T::ZERO]]
        }));
    }

    /// Motion of a row, of which some unknowns are held.
    #[inline(always)]
    pub fn moved(&self, row: usize, motions: &[Motion<T>], held: FixedAxes) -> [T; 4] {
        let mut motion = self.prolong(row, motions);
        if held.0 != 0 {
            for k in (0..3).filter(|&k| held.holds(k)) {
                motion[k] = T::ZERO;
            }
        }
        motion
    }

    /// Motion of a row, held unknowns included.
    #[inline(always)]
    fn prolong(&self, row: usize, motions: &[Motion<T>]) -> [T; 4] {
        let [translation, yzx, zxy] = motions[self.aggregate[row] as usize];
        let [arm_yzx, arm_zxy] = self.arm[row];
        add4(translation, sub4(mul4(yzx, arm_zxy), mul4(zxy, arm_yzx)))
    }

    /// Number of aggregates.
    pub fn aggregates(&self) -> usize {
        self.factor.len()
    }

    /// Aggregates of the rows of a range, lowest to highest.
    pub fn aggregates_of(&self, rows: std::ops::Range<usize>) -> std::ops::Range<usize> {
        let own = &self.aggregate[rows];
        let low = own.iter().min().map_or(0, |&a| a as usize);
        low..own.iter().max().map_or(0, |&a| a as usize + 1)
    }

    /// Solves for the motions in place and returns the scalar product of forces and motions.
    pub fn solve(&mut self, coarse: &mut [[T; 8]]) -> f64 {
        self.forces.clear();
        self.forces.extend_from_slice(coarse);
        vectorised(SolveEnvelope(&mut self.factor, coarse));
        let rows = self.forces.iter().zip(coarse);
        rows.map(|(f, x)| (0..MODES).map(|k| f[k].to_f64() * x[k].to_f64()).sum::<f64>()).sum()
    }
}

/// Vertices gathered into compact aggregates, numbered along the body.
#[derive(Clone, Debug, Default)]
pub struct Aggregates {
    /// Aggregate of each row.
    pub of: Vec<u32>,
    /// Position of each row relative to the centre of its aggregate, over the aggregate's radius; zero in an
    /// aggregate of one point.
    pub arm: Vec<DVec3>,
    /// Number of aggregates.
    pub count: usize,
}

impl Aggregates {
    /// Aggregates of about `size` vertices, none of which reaches over several connected pieces. `rest` (m) and
    /// `piece` belong to the rows.
    pub fn new(rest: &[DVec3], piece: &[u32], size: usize) -> Self {
        let n = rest.len();
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
        let mut of = vec![0; n];
        let mut arm = vec![DVec3::ZERO; n];
        for (i, rows) in groups.iter().enumerate() {
            let centre = rows.iter().map(|&r| rest[r as usize]).sum::<DVec3>() / rows.len() as f64;
            let from = |r: u32| rest[r as usize] - centre;
            let radius = rows.iter().map(|&r| from(r).length()).fold(0.0, f64::max);
            for &r in rows {
                of[r as usize] = i as u32;
                if radius > 0.0 {
                    arm[r as usize] = from(r) / radius;
                }
            }
        }
        Self { of, arm, count: groups.len() }
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

struct Galerkin<'a, T> {
    first: usize,
    values: &'a mut [[f64; 36]],
    blocks: &'a [CoarseBlock],
    terms: &'a [Term],
    arm: &'a [[[T; 4]; 2]],
    matrix: &'a SystemMatrix<T>,
    aggregate: &'a [u32],
}

impl<T: Scalar> VectorKernel for Galerkin<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (i, value) in self.values.iter_mut().enumerate() {
            let block = self.first + i;
            let begin = if block == 0 { 0 } else { self.blocks[block - 1].end as usize };
            let terms = &self.terms[begin..self.blocks[block].end as usize];
            *value = galerkin(terms, self.arm, self.matrix, self.aggregate);
        }
    }
}

/// Sum of `B_i^T A_ij B_j` with `B = [I, -arm x]` over the fine blocks of one coarse block, row-major.
#[inline(always)]
fn galerkin<T: Scalar>(
    terms: &[Term],
    arm: &[[[T; 4]; 2]],
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
        let product = congruence(&m, unpack(&arm[row]), unpack(&arm[column]));
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

/// An arm from its order yzx.
#[inline(always)]
fn unpack<T: Scalar>(arm: &[[T; 4]; 2]) -> [T; 3] {
    [arm[0][2], arm[0][0], arm[0][1]]
}

/// `B_i^T m B_j`.
#[inline(always)]
fn congruence<T: Scalar>(m: &[[T; 4]; 3], a: [T; 3], b: [T; 3]) -> [[T; 6]; 6] {
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

/// Vector over the unknowns of an aggregate, padded.
type Node<T> = [T; 8];
/// Column `k` holds the entries `(0..6, k)` of a block.
type Columns<T> = [Node<T>; MODES];

/// Cholesky factor by 6x6 blocks within the envelope of a symmetric matrix: every row of blocks is
/// stored from its first to the one before the diagonal.
#[derive(Clone, Debug, Default)]
struct Envelope<T> {
    /// Column of the first block of each row.
    first: Vec<u32>,
    /// Where each row starts.
    start: Vec<usize>,
    /// The matrix, then its factor.
    work: Vec<Columns<f64>>,
    diagonal: Vec<Columns<f64>>,
    lower: Vec<Columns<T>>,
    /// Inverses of the diagonal blocks of the factor, with zero rows and columns for unknowns without
    /// a pivot.
    inverse: Vec<Columns<T>>,
    gathered: Vec<Columns<T>>,
}

/// Pivots below this share of the diagonal entry are rounding of the sums behind them.
const PIVOT: f64 = 1e-6;

impl<T: Scalar> Envelope<T> {
    fn new(nodes: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Self {
        let mut first: Vec<u32> = (0..nodes as u32).collect();
        for [a, b] in pairs {
            first[b as usize] = first[b as usize].min(a);
        }
        let mut start = vec![0];
        for (i, &f) in first.iter().enumerate() {
            start.push(start[i] + i - f as usize);
        }
        let size = start[nodes];
        Self {
            first,
            start,
            work: vec![[[0.0; 8]; MODES]; size],
            diagonal: vec![[[0.0; 8]; MODES]; nodes],
            lower: vec![[[T::ZERO; 8]; MODES]; size],
            inverse: vec![[[T::ZERO; 8]; MODES]; nodes],
            gathered: vec![[[T::ZERO; 8]; MODES]; nodes],
        }
    }

    fn len(&self) -> usize {
        self.diagonal.len()
    }

    fn clear(&mut self) {
        self.work.fill([[0.0; 8]; MODES]);
        self.diagonal.fill([[0.0; 8]; MODES]);
    }

    /// Enters the block that couples the nodes `a <= b`, row-major with the rows of `a`.
    fn set(&mut self, [a, b]: [u32; 2], value: &[f64; 36]) {
        let (a, b) = (a as usize, b as usize);
        let to = if a == b {
            &mut self.diagonal[b]
        } else {
            &mut self.work[self.start[b] + a - self.first[b] as usize]
        };
        for k in 0..MODES {
            to[k][..MODES].copy_from_slice(&value[MODES * k..MODES * (k + 1)]);
        }
    }

    /// Row by row: a row is the solution of a triangular system with the rows above it.
    #[inline(always)]
    fn factorise(&mut self) {
        for row in 0..self.len() {
            let f = self.first[row] as usize;
            let (above, own) = self.work.split_at_mut(self.start[row]);
            let own = &mut own[..row - f];
            for column in f..row {
                let of_column = self.first[column] as usize;
                let from = f.max(of_column);
                let begin = self.start[column] + from - of_column;
                let (done, rest) = own.split_at_mut(column - f);
                let mut block = rest[0];
                let other = &above[begin..begin + column - from];
                for (x, y) in done[from - f..].iter().zip(other) {
                    subtract_outer(&mut block, x, y);
                }
                // times the transposed inverse of the diagonal block of `column`
                let inverse = &self.diagonal[column];
                let mut out = [[0.0; 8]; MODES];
                for k in 0..MODES {
                    for j in 0..=k {
                        for i in 0..8 {
                            out[k][i] += block[j][i] * inverse[j][k];
                        }
                    }
                }
                rest[0] = out;
            }
            let original = self.diagonal[row];
            let mut block = original;
            for x in own.iter() {
                subtract_outer(&mut block, x, x);
            }
            let (inverse, dropped) = invert_factor(&block, &original);
            self.diagonal[row] = inverse;
            for i in (0..MODES).filter(|&i| dropped[i]) {
                for x in own.iter_mut() {
                    for k in 0..MODES {
                        x[k][i] = 0.0;
                    }
                }
            }
        }
        let narrow = |x: &Columns<f64>| x.map(|c| c.map(T::from_f64));
        for (t, x) in self.lower.iter_mut().zip(&self.work) {
            *t = narrow(x);
        }
        for (t, x) in self.inverse.iter_mut().zip(&self.diagonal) {
            *t = narrow(x);
        }
    }

    /// Solves in place.
    #[inline(always)]
    fn solve(&mut self, x: &mut [Node<T>]) {
        for row in 0..self.len() {
            let f = self.first[row] as usize;
            let mut own = x[row];
            for (block, y) in self.lower[self.start[row]..].iter().zip(&x[f..row]) {
                for k in 0..MODES {
                    own = subtract_scaled(own, block[k], y[k]);
                }
            }
            let mut out = [T::ZERO; 8];
            for k in 0..MODES {
                out = subtract_scaled(out, self.inverse[row][k], -own[k]);
            }
            x[row] = out;
        }
        self.gathered.fill([[T::ZERO; 8]; MODES]);
        for row in (0..self.len()).rev() {
            let f = self.first[row] as usize;
            let mut own = x[row];
            for k in 0..MODES {
                own[k] -= sum8(&self.gathered[row][k]);
            }
            let mut out = [T::ZERO; 8];
            for k in 0..MODES {
                let mut terms = [T::ZERO; 8];
                for i in 0..MODES {
                    terms[i] = self.inverse[row][k][i] * own[i];
                }
                out[k] = sum8(&terms);
            }
            x[row] = out;
            let blocks = &self.lower[self.start[row]..];
            for (block, sum) in blocks.iter().zip(&mut self.gathered[f..row]) {
                for k in 0..MODES {
                    sum[k] = add_product(sum[k], block[k], out);
                }
            }
        }
    }
}

struct FactoriseEnvelope<'a, T>(&'a mut Envelope<T>);

impl<T: Scalar> VectorKernel for FactoriseEnvelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.factorise();
    }
}

struct SolveEnvelope<'a, T>(&'a mut Envelope<T>, &'a mut [Node<T>]);

impl<T: Scalar> VectorKernel for SolveEnvelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.0.solve(self.1);
    }
}

/// `t -= x y^T`, all by columns.
#[inline(always)]
fn subtract_outer(t: &mut Columns<f64>, x: &Columns<f64>, y: &Columns<f64>) {
    for j in 0..MODES {
        for k in 0..MODES {
            t[j] = subtract_scaled(t[j], x[k], y[k][j]);
        }
    }
}

/// `t - s x`.
#[inline(always)]
fn subtract_scaled<T: Scalar>(t: Node<T>, x: Node<T>, s: T) -> Node<T> {
    [
        t[0] - x[0] * s,
        t[1] - x[1] * s,
        t[2] - x[2] * s,
        t[3] - x[3] * s,
        t[4] - x[4] * s,
        t[5] - x[5] * s,
        t[6] - x[6] * s,
        t[7] - x[7] * s,
    ]
}

/// `t + x y`, entry by entry.
#[inline(always)]
fn add_product<T: Scalar>(t: Node<T>, x: Node<T>, y: Node<T>) -> Node<T> {
    [
        t[0] + x[0] * y[0],
        t[1] + x[1] * y[1],
        t[2] + x[2] * y[2],
        t[3] + x[3] * y[3],
        t[4] + x[4] * y[4],
        t[5] + x[5] * y[5],
        t[6] + x[6] * y[6],
        t[7] + x[7] * y[7],
    ]
}

#[inline(always)]
fn sum8<T: Scalar>(x: &Node<T>) -> T {
    ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]))
}

/// Inverse of the Cholesky factor of a block, and the unknowns without a pivot; `original` is the
/// diagonal block before elimination, against which pivots are measured.
fn invert_factor(block: &Columns<f64>, original: &Columns<f64>) -> (Columns<f64>, [bool; MODES]) {
    let mut l = [[0.0; MODES]; MODES];
    let mut dropped = [false; MODES];
    for i in 0..MODES {
        for j in 0..i {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = if dropped[j] { 0.0 } else { (block[j][i] - dot) / l[j][j] };
        }
        let dot: f64 = (0..i).map(|k| l[i][k] * l[i][k]).sum();
        let pivot = block[i][i] - dot;
        // written so that a pivot that is not a number is dropped too
        dropped[i] = !(pivot > PIVOT * original[i][i] && pivot.is_finite());
        if dropped[i] {
            l[i] = [0.0; MODES];
        } else {
            l[i][i] = pivot.sqrt();
        }
    }
    let mut inverse = [[0.0; 8]; MODES];
    for k in (0..MODES).filter(|&k| !dropped[k]) {
        inverse[k][k] = 1.0 / l[k][k];
        for i in (k + 1..MODES).filter(|&i| !dropped[i]) {
            let dot: f64 = (k..i).map(|j| l[i][j] * inverse[k][j]).sum();
            inverse[k][i] = -dot / l[i][i];
        }
    }
    (inverse, dropped)
}
