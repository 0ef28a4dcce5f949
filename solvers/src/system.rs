//! The system matrix: its parts, and the matrix of one linear solve, as conjugate gradients and
//! preconditioners see it: inertia, tangent and damping added up in one pass, held unknowns eliminated, in
//! the number type of the solve.
//!
//! Only the upper half is stored, without padding: large bodies wait for memory. Rows of blocks are read four
//! numbers at a time, so that both halves of the product are vector operations on whole rows: `A_ij x_j`
//! accumulates row by row and is summed across once per block row, `A_ij^T x_i` adds multiples of the rows of
//! `A_ij`. What the fourth number brings along, of the row that follows, meets a zero or is thrown away. The code
//! is plain loops over four numbers without fused operations, so that every instruction set gives the same bits.

use crate::state::{Rows, vector};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_contact::set::{ContactBlocks, Coupling, GivenBack};
use sinew_engine::matrix::{BlockMatrix, LowRank, ProductSpans, in_pairs, rows_of, weighted};
use sinew_engine::scalar::{Row, Scalar};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;
use std::ops::Range;

/// The system matrix of a world, not added up: `A = c_M M + c_K K + c_C C` with lumped mass `M`, tangent `K`
/// and an optional frozen damping tangent `C`, restricted to the free unknowns. Bodies do not couple, so each
/// is solved alone.
#[derive(Clone, Copy)]
pub struct ShiftedTangent<'a, S> {
    /// Edge graph.
    pub topology: &'a Topology,
    /// Thread pool.
    pub workers: &'a Workers,
    /// Masses (kg).
    pub mass: &'a [S],
    /// Factor of the masses.
    pub mass_factor: S,
    /// Tangent.
    pub tangent: &'a BlockMatrix<S>,
    /// The low-rank part of the tangent, which couples the vertices of many elements.
    pub low_rank: &'a [LowRank<S>],
    /// Factor of the tangent.
    pub tangent_factor: S,
    /// Frozen damping tangent and its factor.
    pub damping: Option<(&'a BlockMatrix<S>, S)>,
    /// Held unknowns.
    pub fixed: &'a [FixedAxes],
    /// Blocks that contact adds to the rows of the bodies that are solved for.
    pub contact: Option<&'a ContactBlocks>,
}

/// A 3x3 block, rows padded by a zero.
pub type Block<T> = [[T; 4]; 3];

/// A block with padded rows.
#[inline(always)]
pub(crate) fn padded<T: Scalar>(m: &[T; 9]) -> Block<T> {
    [[m[0], m[1], m[2], T::ZERO], [m[3], m[4], m[5], T::ZERO], [m[6], m[7], m[8], T::ZERO]]
}

/// A block without padding.
#[inline(always)]
pub(crate) fn packed<T: Scalar>(m: &Block<T>) -> [T; 9] {
    [m[0][0], m[0][1], m[0][2], m[1][0], m[1][1], m[1][2], m[2][0], m[2][1], m[2][2]]
}

/// The zero block.
#[inline(always)]
pub(crate) fn zero_block<T: Scalar>() -> Block<T> {
    [[T::ZERO; 4]; 3]
}

/// `a + b`.
#[inline(always)]
pub(crate) fn add4<T: Scalar>(a: [T; 4], b: [T; 4]) -> [T; 4] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
}

/// `a - b`.
#[inline(always)]
pub(crate) fn sub4<T: Scalar>(a: [T; 4], b: [T; 4]) -> [T; 4] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]
}

/// Entry by entry `a b`.
#[inline(always)]
pub(crate) fn mul4<T: Scalar>(a: [T; 4], b: [T; 4]) -> [T; 4] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
}

/// `s a`.
#[inline(always)]
pub(crate) fn scale4<T: Scalar>(a: [T; 4], s: T) -> [T; 4] {
    [a[0] * s, a[1] * s, a[2] * s, a[3] * s]
}

/// `m^T x`: the rows of `m` weighted by the entries of `x`.
#[inline(always)]
pub(crate) fn transpose_product<T: Scalar>(m: &Block<T>, x: [T; 4]) -> [T; 4] {
    add4(add4(scale4(m[0], x[0]), scale4(m[1], x[1])), scale4(m[2], x[2]))
}

/// `m x`.
#[cfg(test)]
pub(crate) fn product<T: Scalar>(m: &Block<T>, x: [T; 4]) -> [T; 4] {
    T::Row::sums(m.map(|row| T::Row::new(mul4(row, x)))).to_array()
}

/// Scalar product in `f64`, four partial sums.
#[inline(always)]
pub(crate) fn accumulate<T: Scalar>(sum: &mut [f64; 4], a: [T; 4], b: [T; 4]) {
    for k in 0..4 {
        sum[k] += a[k].to_f64() * b[k].to_f64();
    }
}

/// Scalar product in `f64`; fourth entries of one of both must be zero. Four sums of rows, so that none waits for the last one.
#[inline(always)]
pub(crate) fn dot<T: Scalar>(a: &[[T; 4]], b: &[[T; 4]]) -> f64 {
    let mut sums = [[0.0; 4]; 4];
    let (a, a_left) = a.as_chunks::<4>();
    let (b, b_left) = b.as_chunks::<4>();
    for (a, b) in a.iter().zip(b) {
        for i in 0..4 {
            accumulate(&mut sums[i], a[i], b[i]);
        }
    }
    for (a, b) in a_left.iter().zip(b_left) {
        accumulate(&mut sums[0], *a, *b);
    }
    sums.as_flattened().iter().sum()
}

/// Rows that a task works on, cut by size alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Piece {
    /// Block rows of the body.
    pub rows: Range<usize>,
    /// End of the rows that the blocks of these rows reach.
    pub reach: usize,
}

/// Non-zero pattern of the upper half of one body's matrix, and the pieces it is worked on in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pattern {
    /// First off-diagonal block of each row (one entry more than rows).
    pub start: Vec<u32>,
    /// Column of each off-diagonal block, ascending within a row and above it.
    pub column: Vec<u32>,
    /// Consecutive rows, in order.
    pub pieces: Vec<Piece>,
    /// Number of rows that have blocks; others, such as spare ones, cost next to nothing.
    pub used: usize,
}

/// Rows per piece, about.
const ROWS_PER_PIECE: usize = 640;
/// Most pieces.
const MAX_PIECES: usize = 16;

impl Pattern {
    /// Piece of a row, and the row in it.
    pub fn place(&self, row: u32) -> [u32; 2] {
        let piece = self.pieces.partition_point(|piece| piece.rows.end <= row as usize);
        [piece as u32, row - self.pieces[piece].rows.start as u32]
    }

    /// Pattern of consecutive bodies.
    pub fn new(topology: &Topology, bodies: &Range<usize>) -> Self {
        let (start, column, is_used) = blocks_of(topology, bodies);
        let (n, used) = (is_used.len(), is_used.iter().filter(|used| **used).count());
        let count = ((used + ROWS_PER_PIECE / 2) / ROWS_PER_PIECE).clamp(1, MAX_PIECES);
        // equal numbers of blocks, the diagonal counted
        let total = used + column.len();
        let (mut passed, mut end, mut ends) = (0, 0, Vec::with_capacity(count));
        for piece in 1..=count {
            let target = total * piece / count;
            while end < n && (piece == count || passed + (start[end] as usize) < target) {
                passed += usize::from(is_used[end]);
                end += 1;
            }
            ends.push(end as u32);
        }
        Self { pieces: divided((&start, &column), &ends), start, column, used }
    }

    /// The same in pieces that end at these rows, as those of another pattern of the same rows do.
    pub fn divided_at(topology: &Topology, bodies: &Range<usize>, ends: &[u32]) -> Self {
        let (start, column, is_used) = blocks_of(topology, bodies);
        let used = is_used.iter().filter(|used| **used).count();
        Self { pieces: divided((&start, &column), ends), start, column, used }
    }

    /// Where its pieces end.
    pub fn ends(&self) -> Vec<u32> {
        self.pieces.iter().map(|piece| piece.rows.end as u32).collect()
    }

    /// Whether it can be one of so many rows: what comes out of a file may be anything.
    pub fn is_sound(&self, rows: usize) -> bool {
        let Self { start, column, pieces, used } = self;
        let ascends = |own: &[u32]| own.windows(2).all(|two| two[0] < two[1]);
        let of_row = |(row, own): (usize, &[u32])| {
            let own = column.get(own[0] as usize..own[1] as usize);
            own.is_some_and(|own| {
                let beyond = |c: &u32| (row + 1..rows).contains(&(*c as usize));
                ascends(own) && own.iter().all(beyond)
            })
        };
        let ends = self.ends();
        start.len() == rows + 1
            && start[0] == 0
            && start[rows] as usize == column.len()
            && *used <= rows
            && start.windows(2).enumerate().all(of_row)
            && ascends(&ends)
            && ends.last().is_some_and(|last| *last as usize == rows)
            && divided((start, column), &ends) == *pieces
    }

    /// Number of block rows.
    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Multiplications of 3x3 blocks, about, of an iteration of conjugate gradients with incomplete factors.
    pub fn work(&self) -> f64 {
        2.0 * (self.used + 2 * self.column.len()) as f64
    }

    /// Off-diagonal blocks of a row.
    #[inline(always)]
    pub fn blocks(&self, row: usize) -> Range<usize> {
        self.start[row] as usize..self.start[row + 1] as usize
    }
}

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

    /// Keeps the first `vectors`.
    pub fn truncate(&mut self, vectors: usize) {
        if vectors < self.len() {
            self.start.truncate(vectors + 1);
            let end = self.start[vectors] as usize;
            self.rows.truncate(end);
            self.entries.truncate(end);
        }
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

/// A symmetric matrix on a [`Pattern`]: `factor (c_M M + c_K K + c_C C)` with the rows and columns of
/// held unknowns replaced by those of the identity.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct SystemMatrix<T> {
    /// Diagonal blocks.
    pub diagonal: Vec<Block<T>>,
    /// Upper off-diagonal blocks, row-major, in the order of [`Pattern::column`], and one of zeros after them: the last
    /// row is read with the number behind it.
    pub upper: Vec<[T; 9]>,
    /// The low-rank part, a list of vectors: of the tangent or, where it has none, of contact.
    pub low_rank: RankOnes<T>,
    /// Vectors of the tangent.
    pub own_vectors: usize,
    /// Held unknowns of each row: bits 0, 1, 2.
    pub held: Vec<FixedAxes>,
    /// What contact adds beside the diagonal and those vectors, in rows of the matrix.
    pub couplings: Vec<Coupling>,
    /// Vectors of what contact takes off.
    pub given: RankOnes<T>,
    /// Rows of the matrix that contact adds to, and their diagonal blocks before, in the order in which that was done.
    pub without_contact: Vec<(u32, Block<T>)>,
    /// Factor that brings the largest diagonal entry of the tangent and inertia to one: no number type
    /// overflows, and `f32` rounds the same in all units of measurement.
    pub factor: f64,
}

/// Where blocks of rows of consecutive bodies start, their columns, and which rows have blocks.
fn blocks_of(topology: &Topology, bodies: &Range<usize>) -> (Vec<u32>, Vec<u32>, Vec<bool>) {
    let (rows, blocks) = ranges(topology, bodies);
    let start = &topology.edge_start[rows.start..=rows.end];
    let start: Vec<u32> = start.iter().map(|s| s - blocks.start as u32).collect();
    let edges = topology.edges[blocks].iter();
    let column: Vec<u32> = edges.map(|e| e[1] - rows.start as u32).collect();
    let mut is_used: Vec<bool> = start.windows(2).map(|own| own[0] < own[1]).collect();
    column.iter().for_each(|&c| is_used[c as usize] = true);
    (start, column, is_used)
}

/// Takes rows apart; pieces that would be empty are left out.
fn divided((start, column): (&[u32], &[u32]), ends: &[u32]) -> Vec<Piece> {
    let (mut first, mut pieces) = (0, Vec::with_capacity(ends.len()));
    for end in ends.iter().map(|end| *end as usize) {
        if end == first {
            continue;
        }
        let own = &column[start[first] as usize..start[end] as usize];
        let reach = own.iter().map(|&c| c as usize + 1).max().unwrap_or(end).max(end);
        pieces.push(Piece { rows: first..end, reach });
        first = end;
    }
    pieces
}

const CHUNK: usize = 2048;

/// Vertex rows and edges of consecutive bodies, which follow each other.
pub(crate) fn ranges(topology: &Topology, bodies: &Range<usize>) -> (Range<usize>, Range<usize>) {
    let (first, last) = (&topology.bodies[bodies.start], &topology.bodies[bodies.end - 1]);
    let rows = first.vertices.start as usize..last.vertices.end as usize;
    (rows, first.blocks.start as usize..last.blocks.end as usize)
}

impl<T: Scalar> SystemMatrix<T> {
    /// Adds the matrix up for consecutive bodies. With `same`, everything but contact is as it was, and only that is
    /// exchanged.
    pub fn prepare<S: Scalar>(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        bodies: Range<usize>,
        same: bool,
    ) {
        if same {
            for (row, block) in self.without_contact.drain(..).rev() {
                self.diagonal[row as usize] = block;
            }
            self.add_contact(system.contact, ranges(system.topology, &bodies).0);
        } else {
            self.assemble(system, bodies);
        }
    }

    /// Adds the matrix up for consecutive bodies.
    pub fn assemble<S: Scalar>(&mut self, system: &ShiftedTangent<'_, S>, bodies: Range<usize>) {
        let (rows, blocks) = ranges(system.topology, &bodies);
        let tangent = &system.tangent.diagonal[rows.clone()];
        let mass_factor = system.mass_factor.to_f64();
        // scale
        let largest = tangent
            .iter()
            .zip(&system.mass[rows.clone()])
            .map(|(k, m)| {
                let k = k[0].abs().max(k[4].abs()).max(k[8].abs());
                k.to_f64() * system.tangent_factor.to_f64().abs() + mass_factor * m.to_f64()
            })
            .fold(0.0, f64::max);
        self.factor = if largest.is_normal() { largest.recip() } else { 1.0 };
        self.held.clear();
        self.held.extend_from_slice(&system.fixed[rows.clone()]);
        self.diagonal.resize(rows.len(), zero_block());
        self.upper.resize(blocks.len() + 1, [T::ZERO; 9]);

        // diagonal blocks
        let c_k = system.tangent_factor.to_f64() * self.factor;
        let c_m = mass_factor * self.factor;
        let c_c = system.damping.map_or(0.0, |(_, c)| c.to_f64() * self.factor);
        let held = &self.held;
        let workers: &Workers = system.workers;
        workers.for_chunks(&mut self.diagonal, CHUNK, rows.len() * 10, |first, own| {
            for (i, m) in own.iter_mut().enumerate() {
                let row = rows.start + first + i;
                let damping = system.damping.map(|(c, _)| &c.diagonal[row]);
                let mut entries = add_blocks(&system.tangent.diagonal[row], c_k, damping, c_c);
                let inertia = c_m * system.mass[row].to_f64();
                for k in 0..3 {
                    entries[4 * k] += inertia;
                }
                let h = held[first + i];
                mask(&mut entries, h, h, 1.0);
                *m = block(&entries);
            }
        });
        // blocks above the diagonal
        let (edges, offset) = (&system.topology.edges, rows.start);
        let upper = &mut self.upper[..blocks.len()];
        workers.for_chunks(upper, CHUNK, blocks.len() * 6, |first, own| {
            for (i, m) in own.iter_mut().enumerate() {
                let index = blocks.start + first + i;
                let damping = system.damping.map(|(c, _)| &c.off_diagonal[index]);
                let tangent = &system.tangent.off_diagonal[index];
                let mut entries = add_blocks(tangent, c_k, damping, c_c);
                let [a, b] = edges[index];
                let (a, b) = (held[a as usize - offset], held[b as usize - offset]);
                if a.0 | b.0 != 0 {
                    mask(&mut entries, a, b, 0.0);
                }
                *m = entries.map(T::from_f64);
            }
        });
        // low-rank part
        self.low_rank.clear();
        // a factor below 0 belongs to no system that is solved
        let root = c_k.max(0.0).sqrt();
        for LowRank { pattern, vectors, .. } in system.low_rank {
            for vector in pattern.of_rows(&rows) {
                let entries = pattern.entries(vector);
                let own = pattern.rows[entries.clone()].iter().zip(&vectors[entries]);
                let local = own.map(|(&row, b)| {
                    (row - rows.start as u32, [0, 1, 2].map(|k| root * b[k].to_f64()))
                });
                self.low_rank.push(&self.held, local);
            }
        }
        self.own_vectors = self.low_rank.len();
        self.add_contact(system.contact, rows);
    }

    /// Adds the blocks of contact: the stiff part of what couples rows as vectors where these are few enough, the rest to the
    /// diagonal and beside it.
    fn add_contact(&mut self, contact: Option<&ContactBlocks>, rows: Range<usize>) {
        self.couplings.clear();
        self.given.clear();
        self.without_contact.clear();
        self.low_rank.truncate(self.own_vectors);
        let Some(contact) = contact else { return };
        let first = rows.start as u32;
        // threads are few, whatever else couples
        let root = self.factor.sqrt();
        for vector in &contact.vectors {
            let own = vector.iter().map(|(row, v)| (row - first, (root * *v).to_array()));
            self.low_rank.push(&self.held, own);
        }
        for own in &contact.given {
            let own = own.rows.iter().map(|(row, v)| (row - first, (root * *v).to_array()));
            self.given.push(&self.held, own);
        }
        for (row, m) in &contact.diagonal {
            self.add_to_diagonal(row - first, m);
        }
        // with volumes of clusters they would couple all with all
        let product = 2 * (self.upper.len() - 1) + self.diagonal.len();
        let as_vectors = self.own_vectors == 0 && is_narrow(&contact.couplings, product);
        for coupling in &contact.couplings {
            let mut own = Coupling { rows: coupling.rows.map(|row| row - first), ..*coupling };
            if as_vectors {
                let stiff = root * own.stiff;
                let entries = own.used().map(|(row, weight)| (row, (weight * stiff).to_array()));
                self.low_rank.push(&self.held, entries);
            } else {
                own.block = own.whole();
            }
            if own.block.abs_diff_eq(DMat3::ZERO, 4.0 * f64::EPSILON * own.stiff.length_squared()) {
                continue;
            }
            for (row, weight) in own.used() {
                self.add_to_diagonal(row, &(weight * weight * own.block));
            }
            own.block *= self.factor;
            self.couplings.push(own);
        }
    }

    /// Adds a block (N/m) to the free unknowns of a row of the matrix.
    fn add_to_diagonal(&mut self, row: u32, m: &DMat3) {
        let to = row as usize;
        self.without_contact.push((row, self.diagonal[to]));
        let mut entries = entries(m).map(|x| x * self.factor);
        mask(&mut entries, self.held[to], self.held[to], 0.0);
        let added = block(&entries);
        for k in 0..3 {
            self.diagonal[to][k] = add4(self.diagonal[to][k], added[k]);
        }
    }

    /// Rows of one piece of the upper half and their transposes: `q = A_piece p`; both vectors hold
    /// the rows from the piece's first to its reach. Fourth entries of `p` must be zero, those of `q` mean nothing.
    /// Returns `p . q`.
    #[inline(always)]
    pub fn multiply_piece(
        &self,
        pattern: &Pattern,
        piece: &Piece,
        p: &[[T; 4]],
        q: &mut [[T; 4]],
    ) -> f64 {
        let base = piece.rows.start;
        let length = piece.reach - base;
        let (p, q) = (&p[..length], &mut q[..length]);
        q.fill([T::ZERO; 4]);
        for row in piece.rows.clone() {
            let x = &p[row - base];
            let mut sum = self.diagonal[row].map(|d| T::Row::new(d) * T::Row::new(*x));
            let blocks = pattern.blocks(row);
            let upper = in_pairs(&self.upper, blocks.clone());
            for (m, &column) in upper.zip(&pattern.column[blocks]) {
                let m = rows_of(m);
                let local = column as usize - base;
                let y = T::Row::new(p[local]);
                for k in 0..3 {
                    sum[k] = sum[k] + m[k] * y;
                }
                q[local] = (T::Row::new(q[local]) + weighted(m, x)).to_array();
            }
            let own = &mut q[row - base];
            *own = (T::Row::new(*own) + T::Row::sums(sum)).to_array();
        }
        dot(p, q)
    }
}

impl<S: Scalar> ShiftedTangent<'_, S> {
    /// Factors of masses, tangent and damping.
    pub fn factors(&self) -> [f64; 3] {
        let damping = self.damping.map_or(0.0, |(_, factor)| factor.to_f64());
        [self.mass_factor.to_f64(), self.tangent_factor.to_f64(), damping]
    }

    /// `y = A x` for the rows of consecutive bodies; held entries of `x` must be zero, those of `y` are.
    pub fn multiply(
        &self,
        spans: &mut ProductSpans<S>,
        scratch: &mut Rows<S>,
        bodies: Range<usize>,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        let offset = ranges(self.topology, &bodies).0.start;
        if self.damping.is_some() {
            scratch.resize(x.len(), [S::ZERO; 4]);
        }
        for body in bodies.clone() {
            let rows = ranges(self.topology, &(body..body + 1)).0;
            let rows = rows.start - offset..rows.end - offset;
            let (x, y) = (&x[rows.clone()], &mut y[rows.clone()]);
            self.tangent.multiply_body(self.topology, self.workers, spans, body, x, y);
            let of_world = ranges(self.topology, &(body..body + 1)).0;
            self.low_rank.iter().for_each(|part| part.add_product(&of_world, x, y));
            if let Some((matrix, _)) = self.damping {
                let y = &mut scratch[rows];
                matrix.multiply_body(self.topology, self.workers, spans, body, x, y);
            }
        }
        let damping = self.damping.map(|(_, factor)| (&*scratch, factor));
        self.workers.for_chunks(y, CHUNK, x.len() * 4, |first, rows| {
            for (i, y) in rows.iter_mut().enumerate() {
                let local = first + i;
                let row = offset + local;
                let m = self.mass_factor * self.mass[row];
                for k in 0..3 {
                    y[k] = y[k] * self.tangent_factor + m * x[local][k];
                    if let Some((c, factor)) = damping {
                        y[k] += factor * c[local][k];
                    }
                    if self.fixed[row].holds(k) {
                        y[k] = S::ZERO;
                    }
                }
                y[3] = S::ZERO;
            }
        });
        self.add_contact_product(bodies, 1.0, x, y);
    }

    /// Adds `factor C x` to `y` for the rows of consecutive bodies, `C` being the blocks of contact.
    pub fn add_contact_product(
        &self,
        bodies: Range<usize>,
        factor: f64,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        let Some(contact) = self.contact else { return };
        let offset = ranges(self.topology, &bodies).0.start;
        let mut add = |row: usize, own: DVec3| {
            for k in (0..3).filter(|&k| !self.fixed[row].holds(k)) {
                y[row - offset][k] += S::from_f64(factor * own[k]);
            }
        };
        for (row, block) in &contact.diagonal {
            let row = *row as usize;
            add(row, *block * vector(&x[row - offset]));
        }
        for coupling in &contact.couplings {
            let own = coupling.used().map(|(row, w)| w * vector(&x[row as usize - offset]));
            let force = coupling.whole() * own.sum::<DVec3>();
            coupling.used().for_each(|(row, weight)| add(row as usize, weight * force));
        }
        for own in &contact.vectors {
            let along = own.iter().map(|(row, v)| v.dot(vector(&x[*row as usize - offset])));
            let along: f64 = along.sum();
            own.iter().for_each(|(row, v)| add(*row as usize, along * *v));
        }
        for GivenBack { rows, .. } in &contact.given {
            let along = rows.iter().map(|(row, v)| v.dot(vector(&x[*row as usize - offset])));
            let along: f64 = along.sum();
            rows.iter().for_each(|(row, v)| add(*row as usize, -along * *v));
        }
    }

    /// Right-hand side of consecutive bodies times the inverse diagonal blocks: a descent direction whatever the
    /// matrix.
    pub fn preconditioned(&self, bodies: Range<usize>, b: &[[S; 4]], x: &mut [[S; 4]]) {
        let mut matrix = SystemMatrix::<S>::default();
        matrix.assemble(self, bodies);
        let RankOnes { start, rows, entries } = &matrix.low_rank;
        let of_contact = start.get(matrix.own_vectors).map_or(0, |first| *first as usize);
        for (row, b) in rows.iter().zip(entries).skip(of_contact) {
            for k in 0..3 {
                let m = &mut matrix.diagonal[*row as usize][k];
                *m = add4(*m, scale4(*b, b[k]));
            }
        }
        for ((m, b), x) in matrix.diagonal.iter().zip(b).zip(x) {
            *x = transpose_product(&inverse(m), *b).map(|x| x * S::from_f64(matrix.factor));
        }
    }
}

/// Entries of a symmetric matrix.
fn entries(m: &DMat3) -> [f64; 9] {
    m.to_cols_array()
}

/// Whether points that share rows come so soon after each other that solves with the matrix of their vectors cost at most half
/// of a product with the whole one, of so many blocks, and its factor at most that of eight.
fn is_narrow(couplings: &[Coupling], product: usize) -> bool {
    let mut used: Vec<[u32; 2]> = Vec::new();
    for (point, coupling) in (0..).zip(couplings) {
        used.extend(coupling.used().map(|(row, _)| [row, point]));
    }
    used.sort_unstable();
    let mut first: Vec<u32> = (0..couplings.len() as u32).collect();
    for own in used.chunk_by(|a, b| a[0] == b[0]) {
        for [_, point] in own {
            let to = &mut first[*point as usize];
            *to = own[0][1].min(*to);
        }
    }
    let widths = first.iter().enumerate().map(|(point, first)| point - *first as usize + 1);
    let (solve, factor) = widths.fold((0, 0), |(s, f), width| (s + 4 * width, f + width * width));
    2 * solve <= 9 * product && factor <= 8 * 9 * product
}

/// Part of `A x` from a coupling without its diagonal blocks, for each of its rows, of which `x` are the vectors:
/// `w_a C (sum_b w_b x_b - w_a x_a)`.
pub(crate) fn for_off_diagonal(
    coupling: &Coupling,
    x: &[[f64; 4]],
    mut add: impl FnMut(usize, [f64; 3]),
) {
    let own = |i: usize| coupling.weights[i] * DVec3::new(x[i][0], x[i][1], x[i][2]);
    let sum = (0..x.len()).map(own).sum::<DVec3>();
    for i in (0..x.len()).filter(|&i| coupling.weights[i] != 0.0) {
        add(i, (coupling.weights[i] * (coupling.block * (sum - own(i)))).to_array());
    }
}

/// `a x + b y` of two blocks, the second one optional.
#[inline(always)]
fn add_blocks<S: Scalar>(x: &[S; 9], a: f64, y: Option<&[S; 9]>, b: f64) -> [f64; 9] {
    let mut m = [0.0; 9];
    for k in 0..9 {
        m[k] = a * x[k].to_f64();
    }
    if let Some(y) = y {
        for k in 0..9 {
            m[k] += b * y[k].to_f64();
        }
    }
    m
}

/// Eliminates held rows and columns; `diagonal` goes where both meet.
#[inline(always)]
fn mask(m: &mut [f64; 9], row: FixedAxes, column: FixedAxes, diagonal: f64) {
    for k in 0..3 {
        for j in 0..3 {
            if row.holds(k) || column.holds(j) {
                m[3 * k + j] = if k == j { diagonal } else { 0.0 };
            }
        }
    }
}

#[inline(always)]
fn block<T: Scalar>(m: &[f64; 9]) -> Block<T> {
    padded(&m.map(T::from_f64))
}

/// Inverse of a symmetric 3x3 block if it is positive definite with a margin against rounding.
#[inline(always)]
pub(crate) fn definite_inverse<T: Scalar>(m: &Block<T>) -> Option<Block<T>> {
    let m = [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[i][j].to_f64()));
    let c00 = m[1][1] * m[2][2] - m[1][2] * m[2][1];
    let c01 = m[1][2] * m[2][0] - m[1][0] * m[2][2];
    let c02 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
    let det = m[0][0] * c00 + m[0][1] * c01 + m[0][2] * c02;
    let minor = m[0][0] * m[1][1] - m[0][1] * m[1][0];
    let scale = m[0][0].max(m[1][1]).max(m[2][2]);
    let margin = T::EPSILON.to_f64();
    let definite = m[0][0] > 0.0
        && minor > margin * scale * m[0][0]
        && det > margin * scale * minor
        && det.is_finite();
    definite.then(|| {
        let c11 = m[0][0] * m[2][2] - m[0][2] * m[2][0];
        let c12 = m[0][1] * m[2][0] - m[0][0] * m[2][1];
        block(&[c00, c01, c02, c01, c11, c12, c02, c12, minor].map(|c| c / det))
    })
}

/// Inverse of a symmetric block, or of its absolute diagonal where it is not positive definite.
#[inline(always)]
pub(crate) fn inverse<T: Scalar>(m: &Block<T>) -> Block<T> {
    definite_inverse(m).unwrap_or_else(|| diagonal_inverse(m))
}

/// Inverse of the absolute diagonal, for blocks that are not positive definite.
pub(crate) fn diagonal_inverse<T: Scalar>(m: &Block<T>) -> Block<T> {
    let entry = |k: usize| m[k][k].to_f64().abs();
    let scale = entry(0).max(entry(1)).max(entry(2));
    let mut d = [0.0; 9];
    for k in 0..3 {
        let entry = entry(k).max(1e-3 * scale);
        d[4 * k] = if entry > 0.0 { 1.0 / entry } else { 1.0 };
    }
    block(&d)
}
