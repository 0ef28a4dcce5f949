//! Symmetric sparse matrix of 3x3 blocks on the edge graph, upper half stored.

use crate::scalar::{Row, Scalar};
use crate::simd::{VectorKernel, vectorised};
use crate::topology::{BodyRows, Topology};
use crate::workers::Workers;
use bevy_ecs::prelude::Resource;
use std::ops::Range;
use std::sync::Arc;

/// Symmetric block matrix: one diagonal block per vertex row and one off-diagonal block per edge of
/// the edge graph, whose lower row is the block's row. Entries in N/m when it is a tangent,
/// `K = +d2W/dx2`.
#[derive(Clone, Debug, Default)]
pub struct BlockMatrix<S> {
    /// Diagonal blocks, row-major.
    pub diagonal: Vec<[S; 9]>,
    /// Upper off-diagonal blocks, row-major, in the order of [`Topology::edges`].
    pub off_diagonal: Vec<[S; 9]>,
}

/// The tangent of the last evaluation that asked for one, and how many elements were clamped in it.
#[derive(Resource, Clone, Debug, Default)]
pub struct Tangent<S: Scalar> {
    /// Sum over all laws of what couples the vertices of one element.
    pub matrix: BlockMatrix<S>,
    /// What couples the vertices of many elements, law by law; the tangent is the sum of all of them and `matrix`.
    pub low_rank: Vec<LowRank<S>>,
    /// Elements whose eigenvalues were clamped.
    pub clamped: u64,
}

impl<S: Scalar> Tangent<S> {
    /// `y = K x`; the fourth entries of `x` must be zero, those of `y` are.
    pub fn multiply(
        &self,
        topology: &Topology,
        workers: &Workers,
        spans: &mut ProductSpans<S>,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        self.matrix.multiply(topology, workers, spans, x, y);
        let rows = 0..topology.vertex_count();
        self.low_rank.iter().for_each(|part| part.add_product(&rows, x, y));
    }
}

/// A sum of `b b^T` over a few vectors `b` (N^1/2 m^-1/2), each with one 3-vector for each of some vertices of one
/// body. It is never added up: its rows would have several times the blocks of the edge graph.
#[derive(Clone, Debug, Default)]
pub struct LowRank<S> {
    /// Where the 3-vectors stand.
    pub pattern: Arc<LowRankPattern>,
    /// The 3-vectors, fourth entries zero, in the order of [`LowRankPattern::rows`].
    pub vectors: Vec<[S; 4]>,
    /// What the vectors are derivatives of (J^1/2): half the sum of the squares is the energy.
    pub values: Vec<f64>,
}

/// Values (J^1/2) of the vectors of [`LowRank`] matrices, body by body, that the next tangents are to take for the
/// curvature that goes with them. Where a body's are missing, its tangent is the second derivative of the energy; so it is
/// where several laws have such vectors in one body.
///
/// A linear step turns elements by straight motions, which changes their volumes to second order; times a large modulus that
/// is a pressure of no meaning. What the last step *predicted* has none of it: this is Newton's iteration with the pressures
/// as unknowns of their own. Equilibria do not depend on it.
#[derive(Resource, Clone, Debug, Default, PartialEq)]
pub struct PredictedValues(pub Vec<Vec<f64>>);

/// Vertex rows of the vectors of a [`LowRank`] matrix.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LowRankPattern {
    /// First entry of `rows` of each vector (one more than vectors).
    pub start: Vec<u32>,
    /// Vertex rows, ascending within a vector; vectors lie body by body.
    pub rows: Vec<u32>,
}

impl LowRankPattern {
    /// Vectors of the bodies with these vertex rows.
    pub fn of_rows(&self, rows: &Range<usize>) -> Range<usize> {
        let count = self.start.len().saturating_sub(1);
        let firsts = &self.start[..count];
        let before = |row: usize| {
            firsts.partition_point(|&first| (self.rows[first as usize] as usize) < row)
        };
        before(rows.start)..before(rows.end)
    }

    /// Entries of a vector.
    pub fn entries(&self, vector: usize) -> Range<usize> {
        self.start[vector] as usize..self.start[vector + 1] as usize
    }
}

impl<S: Scalar> LowRank<S> {
    /// Scalar product of a vector with a field over all rows.
    pub fn product(&self, vector: usize, x: &[[S; 4]]) -> f64 {
        let entries = self.pattern.entries(vector);
        let own = self.pattern.rows[entries.clone()].iter().zip(&self.vectors[entries]);
        own.map(|(&row, b)| {
            let x = &x[row as usize];
            (0..3).map(|k| b[k].to_f64() * x[k].to_f64()).sum::<f64>()
        })
        .sum()
    }

    /// Adds `A x` to `y` for the bodies with these vertex rows; both vectors hold those rows only. Scalar products are
    /// formed in `f64`.
    pub fn add_product(&self, rows: &Range<usize>, x: &[[S; 4]], y: &mut [[S; 4]]) {
        for vector in self.pattern.of_rows(rows) {
            let entries = self.pattern.entries(vector);
            let own = &self.pattern.rows[entries.clone()];
            let mut sum = 0.0;
            for (&row, b) in own.iter().zip(&self.vectors[entries.clone()]) {
                let x = &x[row as usize - rows.start];
                sum += (0..3).map(|k| b[k].to_f64() * x[k].to_f64()).sum::<f64>();
            }
            let sum = S::from_f64(sum);
            for (&row, b) in own.iter().zip(&self.vectors[entries]) {
                let y = &mut y[row as usize - rows.start];
                for k in 0..3 {
                    y[k] += sum * b[k];
                }
            }
        }
    }
}

/// Work space of [`BlockMatrix::multiply`]: private result arrays of fixed row ranges.
#[derive(Clone, Debug, Default)]
pub struct ProductSpans<S> {
    spans: Vec<ProductSpan<S>>,
    /// Spans of each body.
    bodies: Vec<Range<usize>>,
    revision: u64,
}

#[derive(Clone, Debug)]
struct ProductSpan<S> {
    rows: Range<usize>,
    /// Rows reached by the transposed blocks: `rows.start..reach`.
    reach: usize,
    result: Vec<[S; 4]>,
}

/// Blocks per range of the product.
const BLOCKS_PER_SPAN: usize = 8192;
const MAX_SPANS: usize = 16;
const ROW_CHUNK: usize = 1024;

impl<S: Scalar> ProductSpans<S> {
    /// Cuts the rows of every body into fixed ranges of about equal work, unless done already.
    fn prepare(&mut self, topology: &Topology) {
        if self.revision == topology.revision && self.bodies.len() == topology.bodies.len() {
            return;
        }
        self.revision = topology.revision;
        self.spans.clear();
        self.bodies.clear();
        for body in &topology.bodies {
            let first_span = self.spans.len();
            let n = body.vertices.end as usize;
            let (first_block, blocks) = (body.blocks.start as usize, body.blocks.len());
            let pieces = (blocks / BLOCKS_PER_SPAN).clamp(1, MAX_SPANS);
            let mut row = body.vertices.start as usize;
            for piece in 0..pieces {
                let end = if piece + 1 == pieces {
                    n
                } else {
                    let target = (first_block + blocks * (piece + 1) / pieces) as u32;
                    topology.edge_start.partition_point(|&s| s < target).clamp(row, n)
                };
                if row == end {
                    continue;
                }
                let (first, last) = (topology.edge_start[row], topology.edge_start[end]);
                let reach = topology.edges[first as usize..last as usize]
                    .iter()
                    .map(|e| e[1] as usize + 1)
                    .max()
                    .unwrap_or(end)
                    .max(end);
                self.spans.push(ProductSpan { rows: row..end, reach, result: Vec::new() });
                row = end;
            }
            self.bodies.push(first_span..self.spans.len());
        }
    }
}

impl<S: Scalar> BlockMatrix<S> {
    /// Makes every block zero, with the sizes of `topology`.
    pub fn clear(&mut self, topology: &Topology) {
        self.diagonal.clear();
        self.off_diagonal.clear();
        self.resize(topology);
    }

    /// Takes the sizes of `topology`; blocks that are there already stay as they are.
    pub fn resize(&mut self, topology: &Topology) {
        self.diagonal.resize(topology.vertex_count(), [S::ZERO; 9]);
        self.off_diagonal.resize(topology.edges.len(), [S::ZERO; 9]);
    }

    /// Makes the blocks of a body zero.
    pub fn clear_body(&mut self, body: &BodyRows) {
        let (rows, blocks) = (&body.vertices, &body.blocks);
        self.diagonal[rows.start as usize..rows.end as usize].fill([S::ZERO; 9]);
        self.off_diagonal[blocks.start as usize..blocks.end as usize].fill([S::ZERO; 9]);
    }

    /// Multiplies every entry by a factor.
    pub fn scale(&mut self, factor: S) {
        for block in self.diagonal.iter_mut().chain(&mut self.off_diagonal) {
            block.iter_mut().for_each(|x| *x *= factor);
        }
    }

    /// Adds a matrix of the same topology.
    pub fn add(&mut self, other: &Self) {
        let blocks = self.diagonal.iter_mut().chain(&mut self.off_diagonal);
        for (block, more) in blocks.zip(other.diagonal.iter().chain(&other.off_diagonal)) {
            for (x, y) in block.iter_mut().zip(more) {
                *x += *y;
            }
        }
    }

    /// `y = A x`; the fourth entries of `x` must be zero, those of `y` are.
    pub fn multiply(
        &self,
        topology: &Topology,
        workers: &Workers,
        spans: &mut ProductSpans<S>,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        for (body, rows) in topology.bodies.iter().enumerate() {
            let rows = rows.vertices.start as usize..rows.vertices.end as usize;
            self.multiply_body(topology, workers, spans, body, &x[rows.clone()], &mut y[rows]);
        }
    }

    /// The rows of one body of `y = A x`; bodies do not couple. `x` and `y` hold its rows only.
    pub fn multiply_body(
        &self,
        topology: &Topology,
        workers: &Workers,
        spans: &mut ProductSpans<S>,
        body: usize,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        debug_assert!(x.iter().all(|x| x[3] == S::ZERO), "a fourth entry is not zero");
        spans.prepare(topology);
        let body_rows = &topology.bodies[body];
        let offset = body_rows.vertices.start as usize;
        let work = body_rows.blocks.len() * 2;
        let own = spans.bodies[body].clone();
        let spans = &mut spans.spans[own];
        if let [only] = spans {
            let (rows, x, y) = (only.rows.clone(), (x, offset), (y, offset));
            return vectorised(MultiplyRows { matrix: self, topology, rows, x, y });
        }
        workers.for_each(spans, work, |_, span| {
            // the transposed part reaches beyond the range: private array over its span
            let mut result = std::mem::take(&mut span.result);
            result.resize(span.reach - span.rows.start, [S::ZERO; 4]);
            let (rows, x, y) = (span.rows.clone(), (x, offset), (&mut *result, span.rows.start));
            vectorised(MultiplyRows { matrix: self, topology, rows, x, y });
            span.result = result;
        });
        let spans = &*spans;
        workers.for_chunks(y, ROW_CHUNK, work / 4, |first, rows| {
            let first = first + offset;
            let end = first + rows.len();
            rows.fill([S::ZERO; 4]);
            for span in spans {
                let (from, to) = (span.rows.start.max(first), span.reach.min(end));
                if from >= to {
                    continue;
                }
                let source = &span.result[from - span.rows.start..to - span.rows.start];
                for (t, s) in rows[from - first..to - first].iter_mut().zip(source) {
                    for k in 0..3 {
                        t[k] += s[k];
                    }
                }
            }
        });
    }
}

/// Rows `rows` of the upper half and their transposes into `y`; the first entries of `x` and `y` are rows `x0` and `y0`.
struct MultiplyRows<'a, S> {
    matrix: &'a BlockMatrix<S>,
    topology: &'a Topology,
    rows: Range<usize>,
    x: (&'a [[S; 4]], usize),
    y: (&'a mut [[S; 4]], usize),
}

impl<S: Scalar> VectorKernel for MultiplyRows<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { matrix, topology, rows, x: (x, x0), y: (y, y0) } = self;
        let BlockMatrix { diagonal, off_diagonal } = matrix;
        y.fill([S::ZERO; 4]);
        for row in rows {
            let own = &x[row - x0];
            let mut sum = last_rows(&diagonal[row]).map(|m| m * S::Row::new(*own));
            let range = topology.edge_start[row] as usize..topology.edge_start[row + 1] as usize;
            for at in range {
                let m = match off_diagonal.get(at..at + 2) {
                    Some(pair) => rows_of(pair),
                    None => last_rows(&off_diagonal[at]),
                };
                let column = topology.edges[at][1] as usize;
                let other = S::Row::new(x[column - x0]);
                for k in 0..3 {
                    sum[k] = sum[k] + m[k] * other;
                }
                let t = &mut y[column - y0];
                *t = (S::Row::new(*t) + weighted(m, own)).to_array();
            }
            let t = &mut y[row - y0];
            *t = (S::Row::new(*t) + S::Row::sums(sum)).to_array();
        }
        // what came along with rows of blocks
        y.iter_mut().for_each(|y| y[3] = S::ZERO);
    }
}

/// Blocks without padding at `range`, each with the one behind it.
#[inline(always)]
pub fn in_pairs<T>(
    blocks: &[[T; 9]],
    range: Range<usize>,
) -> impl DoubleEndedIterator<Item = &[[T; 9]]> + ExactSizeIterator {
    blocks[range.start..range.end + 1].windows(2)
}

/// Rows of the first block of a pair, each with the number that follows: a product with a vector whose fourth entry is
/// zero does not see it, and the fourth entry of a transposed product means nothing.
#[inline(always)]
pub fn rows_of<T: Scalar>(pair: &[[T; 9]]) -> [T::Row; 3] {
    let row = |from: usize| {
        let row: &[T; 4] = pair.as_flattened()[from..from + 4].try_into().expect("four numbers");
        T::Row::new(*row)
    };
    [row(0), row(3), row(6)]
}

/// `m^T x`: the rows of `m` weighted by the first entries of `x`.
#[inline(always)]
pub fn weighted<T: Scalar>(m: [T::Row; 3], x: &[T; 4]) -> T::Row {
    m[0] * T::Row::splat(x[0]) + m[1] * T::Row::splat(x[1]) + m[2] * T::Row::splat(x[2])
}

/// Rows of a block that nothing follows.
#[inline(always)]
fn last_rows<S: Scalar>(m: &[S; 9]) -> [S::Row; 3] {
    rows_of(&[*m, [S::ZERO; 9]])
}
