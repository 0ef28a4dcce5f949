//! Symmetric sparse matrix of 3x3 blocks on the edge graph, upper half stored.

use crate::scalar::{Scalar, mat_transpose_vec, mat_vec, xyz};
use crate::topology::Topology;
use crate::workers::Workers;
use bevy_ecs::prelude::Resource;
use std::ops::Range;

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
    /// Sum over all laws.
    pub matrix: BlockMatrix<S>,
    /// Elements whose eigenvalues were clamped.
    pub clamped: u64,
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
        self.diagonal.resize(topology.vertex_count(), [S::ZERO; 9]);
        self.off_diagonal.clear();
        self.off_diagonal.resize(topology.edges.len(), [S::ZERO; 9]);
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

    /// `y = A x`; the fourth entries of `y` are zero.
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
        spans.prepare(topology);
        let body_rows = &topology.bodies[body];
        let offset = body_rows.vertices.start as usize;
        let work = body_rows.blocks.len() * 2;
        let own = spans.bodies[body].clone();
        let spans = &mut spans.spans[own];
        if let [only] = spans {
            self.multiply_rows(topology, &only.rows, x, offset, y, offset);
            return;
        }
        workers.for_each(spans, work, |_, span| {
            // the transposed part reaches beyond the range: private array over its span
            let mut result = std::mem::take(&mut span.result);
            result.resize(span.reach - span.rows.start, [S::ZERO; 4]);
            self.multiply_rows(topology, &span.rows, x, offset, &mut result, span.rows.start);
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

    /// Rows `rows` of the upper half and their transposes into `y`; the first entries of `x` and `y`
    /// are rows `x0` and `y0`.
    fn multiply_rows(
        &self,
        topology: &Topology,
        rows: &Range<usize>,
        x: &[[S; 4]],
        x0: usize,
        y: &mut [[S; 4]],
        y0: usize,
    ) {
        y.fill([S::ZERO; 4]);
        for row in rows.clone() {
            let xr = xyz(x[row - x0]);
            let mut sum = mat_vec(&self.diagonal[row], xr);
            let range = topology.edge_start[row] as usize..topology.edge_start[row + 1] as usize;
            for (edge, m) in topology.edges[range.clone()].iter().zip(&self.off_diagonal[range]) {
                let column = edge[1] as usize;
                let a = mat_vec(m, xyz(x[column - x0]));
                let b = mat_transpose_vec(m, xr);
                let t = &mut y[column - y0];
                for k in 0..3 {
                    sum[k] += a[k];
                    t[k] += b[k];
                }
            }
            let t = &mut y[row - y0];
            for k in 0..3 {
                t[k] += sum[k];
            }
        }
    }
}
