//! Coarse spaces: motions of whole parts of a body, whose Galerkin matrix is factorised exactly and whose correction is
//! added to that of the fine preconditioner. Conjugate gradients then no longer have to carry forces from one end of a
//! body to the other vertex by vertex. Two kinds:
//!
//! - **Rigid motions** of compact aggregates of vertices, six unknowns each. Aggregates come from recursive bisection of
//!   the rest positions across the longest side, connected piece by connected piece.
//! - **Corners** of ten-node tetrahedra: the middles of edges go along with both ends. Middles are much stiffer coupled than
//!   the body is as a whole, which rigid motions do not see.
//!
//! Unknowns are numbered along the body, so that the Galerkin matrix has a narrow envelope, in which its Cholesky factor
//! stays. Motions that held vertices or a degenerate aggregate leave without stiffness have no pivot and are left out.

use crate::system::{Pattern, SystemMatrix, mul4, padded, scale4, sub4};
use envelope::{Columns, Envelope, FactoriseEnvelope, MODES, Profile, SolveEnvelope};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::layout::{UNUSED, starts};
use sinew_engine::scalar::{Row, Scalar};
use sinew_engine::simd::{VectorKernel, vectorised};
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;

mod envelope;

/// A coarse space, and the factor of its Galerkin matrix.
#[derive(Clone, Debug, Default)]
pub struct CoarseSpace<T> {
    span: Span<T>,
    /// Pairs of coupled nodes `a <= b` and the blocks of the matrix that they are summed from.
    blocks: Vec<CoarseBlock>,
    terms: Vec<Term>,
    values: Vec<[f64; 36]>,
    factor: Envelope<T>,
    forces: Vec<[T; 8]>,
}

/// How the rows of the matrix follow the nodes of a coarse space, which have six unknowns each.
#[derive(Clone, Debug)]
enum Span<T> {
    /// A node is an aggregate.
    Rigid {
        /// Aggregate of each row.
        aggregate: Vec<u32>,
        /// Position of each row relative to the centre of its aggregate, over the aggregate's radius, in
        /// the orders yzx and zxy.
        arm: Vec<[[T; 4]; 2]>,
    },
    /// A node is two corners, which follow each other in the order of rows.
    Corners {
        /// The corners of each row, which goes half with either: twice itself for a corner. Numbered by corners.
        ends: Vec<[u32; 2]>,
    },
}

#[derive(Clone, Debug)]
struct CoarseBlock {
    pair: [u32; 2],
    /// Last entry of `terms` plus one.
    end: u32,
}

/// One block of the fine matrix; a diagonal one has equal rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Term {
    pair: [u32; 2],
    row: u32,
    column: u32,
    block: u32,
}

/// Translation of an aggregate, and its turn in the orders yzx and zxy; or those of two corners.
pub type Motion<T> = [[T; 4]; 3];

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

    /// Rigid motions of aggregates of about `size` vertices. `rest` and `piece` give the rest position and the
    /// connected piece of every row.
    pub fn rigid(pattern: &Pattern, rest: &[DVec3], piece: &[u32], size: usize) -> Self {
        let Aggregates { of: aggregate, arm, count } = Aggregates::new(rest, piece, size);
        let orders = |arm: &DVec3| {
            let [x, y, z] = arm.to_array().map(T::from_f64);
            [[y, z, x, T::ZERO], [z, x, y, T::ZERO]]
        };
        let arm = arm.iter().map(orders).collect();
        let span = Span::Rigid { aggregate, arm };
        let profile = span.profile(pattern, count);
        Self::new(pattern, span, profile)
    }

    /// Corners of ten-node tetrahedra: `ends` are the corners whose edge a row is in the middle of, twice the row itself
    /// for the others. `None` where their factor takes more than half of the work of an iteration, as in large bodies.
    pub fn corners(pattern: &Pattern, ends: &[[u32; 2]]) -> Option<Self> {
        let is_corner = ends.iter().enumerate().map(|(row, own)| own[0] as usize == row);
        let mut corners = 0;
        let number: Vec<u32> = is_corner
            .map(|corner| {
                corners += u32::from(corner);
                corners.wrapping_sub(1)
            })
            .collect();
        let ends = ends.iter().map(|own| own.map(|row| number[row as usize])).collect();
        let span = Span::Corners { ends };
        let profile = span.profile(pattern, corners.div_ceil(2) as usize);
        (8.0 * profile.size() as f64 <= 0.5 * pattern.work())
            .then(|| Self::new(pattern, span, profile))
    }

    fn new(pattern: &Pattern, span: Span<T>, profile: Profile) -> Self {
        let mut terms = Vec::with_capacity(pattern.len() + pattern.column.len());
        span.for_terms(pattern, |term| terms.push(term));
        let factor = Envelope::new(profile);
        let mut terms = by_pair(terms, factor.len());
        terms.dedup();
        let mut blocks: Vec<CoarseBlock> = Vec::new();
        for (i, term) in terms.iter().enumerate() {
            match blocks.last_mut() {
                Some(last) if last.pair == term.pair => last.end = i as u32 + 1,
                _ => blocks.push(CoarseBlock { pair: term.pair, end: i as u32 + 1 }),
            }
        }
        let values = vec![[0.0; 36]; blocks.len()];
        Self { span, blocks, terms, values, factor, forces: Vec::new() }
    }

    /// Multiplications of 3x3 blocks, about, that [`Self::factorise`] takes.
    pub fn work(&self) -> f64 {
        3.0 * self.terms.len() as f64 + 8.0 * self.factor.products()
    }

    /// Multiplications of 3x3 blocks, about, of one [`Self::solve`].
    pub fn solve_work(&self) -> f64 {
        8.0 * self.factor.lower.len() as f64
    }

    /// Galerkin matrix of `matrix` and its factor.
    pub fn factorise(&mut self, workers: &Workers, matrix: &SystemMatrix<T>) {
        let Self { span, blocks, terms, values, .. } = self;
        let work = terms.len() * 40;
        workers.for_chunks(values, 16, work, |first, values| {
            vectorised(Galerkin { first, values, blocks, terms, span, matrix });
        });
        self.factor.clear();
        for (block, value) in self.blocks.iter().zip(&self.values) {
            self.factor.set(block.pair, value);
        }
        vectorised(FactoriseEnvelope(&mut self.factor));
    }

    /// Adds the forces `r` on the rows `first..` to the forces on the nodes `node..`.
    #[inline(always)]
    pub fn restrict(&self, first: usize, r: &[[T; 4]], node: usize, coarse: &mut [[T; 8]]) {
        let rows = first..first + r.len();
        match &self.span {
            Span::Rigid { aggregate, arm } => {
                let rows = aggregate[rows.clone()].iter().zip(&arm[rows]);
                for ((&a, arm), f) in rows.zip(r) {
                    // turning part: arm x f
                    let [x, y, z, _] = *f;
                    let turn =
                        sub4(mul4(arm[0], [z, x, y, T::ZERO]), mul4(arm[1], [y, z, x, T::ZERO]));
                    add_node(&mut coarse[a as usize - node], [*f, turn]);
                }
            }
            Span::Corners { ends } => {
                for (own, f) in ends[rows].iter().zip(r) {
                    let half = scale4(*f, T::from_f64(0.5));
                    for end in own.map(|end| end as usize) {
                        let c = &mut coarse[end / 2 - node][3 * (end % 2)..];
                        for k in 0..3 {
                            c[k] += half[k];
                        }
                    }
                }
            }
        }
    }

    /// What the nodes do: translation of every aggregate and its turn with axes moved up by one and by two, or the
    /// motions of two corners.
    #[inline(always)]
    pub fn motions(&self, coarse: &[[T; 8]], motions: &mut Vec<Motion<T>>) {
        motions.clear();
        let corners = matches!(self.span, Span::Corners { .. });
        motions.extend(coarse.iter().map(|c| {
            let [x, y, z] = [c[3], c[4], c[5]];
            let first = [c[0], c[1], c[2], T::ZERO];
            if corners {
                return [first, [x, y, z, T::ZERO], [T::ZERO; 4]];
            }
            [first, [y, z, x, T::ZERO], [z, x, y, T::ZERO]]
        }));
    }

    /// Motion of a row, of which some unknowns are held.
    #[inline(always)]
    pub fn moved(&self, row: usize, motions: &[Motion<T>], held: FixedAxes) -> T::Row {
        let motion = self.prolong(row, motions);
        if held.0 == 0 {
            return motion;
        }
        let mut motion = motion.to_array();
        for k in (0..3).filter(|&k| held.holds(k)) {
            motion[k] = T::ZERO;
        }
        T::Row::new(motion)
    }

    /// Motion of a row, held unknowns included.
    #[inline(always)]
    fn prolong(&self, row: usize, motions: &[Motion<T>]) -> T::Row {
        match &self.span {
            Span::Rigid { aggregate, arm } => {
                let motion = &motions[aggregate[row] as usize];
                let [translation, yzx, zxy] = [0, 1, 2].map(|k| T::Row::new(motion[k]));
                let [arm_yzx, arm_zxy] = [0, 1].map(|k| T::Row::new(arm[row][k]));
                translation + (yzx * arm_zxy - zxy * arm_yzx)
            }
            Span::Corners { ends } => {
                let of = |end: u32| T::Row::new(motions[end as usize / 2][end as usize % 2]);
                (of(ends[row][0]) + of(ends[row][1])) * T::Row::splat(T::from_f64(0.5))
            }
        }
    }

    /// Number of nodes: aggregates, or pairs of corners.
    pub fn nodes(&self) -> usize {
        self.factor.len()
    }

    /// Nodes that a range of rows follows, lowest to highest.
    pub fn nodes_of(&self, rows: std::ops::Range<usize>) -> std::ops::Range<usize> {
        let own = rows.flat_map(|row| self.span.nodes(row));
        let range = own.fold(None, |range: Option<[u32; 2]>, node| {
            Some(range.map_or([node; 2], |[low, high]| [low.min(node), high.max(node)]))
        });
        range.map_or(0..0, |[low, high]| low as usize..high as usize + 1)
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

impl<T> Default for Span<T> {
    fn default() -> Self {
        Self::Corners { ends: Vec::new() }
    }
}

impl<T> Span<T> {
    /// Nodes that a row follows.
    fn nodes(&self, row: usize) -> impl Iterator<Item = u32> + Clone {
        let [a, b] = match self {
            Self::Rigid { aggregate, .. } => [aggregate[row]; 2],
            Self::Corners { ends } => ends[row].map(|end| end / 2),
        };
        std::iter::once(a).chain((a != b).then_some(b))
    }

    /// Every share of a block of the matrix in a coarse one, some of them twice.
    fn for_terms(&self, pattern: &Pattern, mut visit: impl FnMut(Term)) {
        let mut visit = |row: u32, column: u32, block: usize| {
            for a in self.nodes(row as usize) {
                for b in self.nodes(column as usize) {
                    let pair = [a.min(b), a.max(b)];
                    visit(Term { pair, row, column, block: block as u32 });
                }
            }
        };
        for row in 0..pattern.len() {
            visit(row as u32, row as u32, 0);
            for block in pattern.blocks(row) {
                visit(row as u32, pattern.column[block], block);
            }
        }
    }

    fn profile(&self, pattern: &Pattern, nodes: usize) -> Profile {
        let mut profile = Profile::new(nodes);
        self.for_terms(pattern, |term| profile.couple(term.pair));
        profile
    }
}

/// Terms of a matrix of so many nodes in the order of their pairs, those of a pair in the order in which they are: by its second node, then
/// by its first, since there are many more terms than nodes.
fn by_pair(mut terms: Vec<Term>, nodes: usize) -> Vec<Term> {
    for node in [1, 0] {
        let mut next = starts(nodes, terms.iter().map(|term| term.pair[node]));
        let mut sorted = vec![Term::default(); terms.len()];
        for term in terms {
            let place = &mut next[term.pair[node] as usize];
            sorted[*place as usize] = term;
            *place += 1;
        }
        terms = sorted;
    }
    terms
}

/// Adds a force and a moment.
#[inline(always)]
fn add_node<T: Scalar>(c: &mut [T; 8], [force, moment]: [[T; 4]; 2]) {
    *c = [
        c[0] + force[0],
        c[1] + force[1],
        c[2] + force[2],
        c[3] + moment[0],
        c[4] + moment[1],
        c[5] + moment[2],
        T::ZERO,
        T::ZERO,
    ];
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
            // nothing acts on spare rows
            let spare = piece[rows[0] as usize] == UNUSED;
            let count = if spare { 1 } else { ((rows.len() + size / 2) / size).max(1) };
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
    span: &'a Span<T>,
    matrix: &'a SystemMatrix<T>,
}

impl<T: Scalar> VectorKernel for Galerkin<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (i, value) in self.values.iter_mut().enumerate() {
            let block = self.first + i;
            let begin = if block == 0 { 0 } else { self.blocks[block - 1].end as usize };
            let terms = &self.terms[begin..self.blocks[block].end as usize];
            *value = galerkin(terms, self.span, self.matrix);
        }
    }
}

/// Sum of `B_i^T A_ij B_j` over the fine blocks of one coarse block, row-major. `B = [I, -arm x]` for aggregates, and half
/// the identity for either end of a middle.
#[inline(always)]
fn galerkin<T: Scalar>(terms: &[Term], span: &Span<T>, matrix: &SystemMatrix<T>) -> [f64; 36] {
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
            padded(&matrix.upper[term.block as usize])
        };
        // only one half of the matrix is stored: a block off the diagonal stands for its transpose, too
        match span {
            Span::Rigid { aggregate, arm } => {
                let product = congruence(&m, unpack(&arm[row]), unpack(&arm[column]));
                let of = [aggregate[row], aggregate[column]];
                for i in 0..MODES {
                    for j in 0..MODES {
                        let x = product[i][j].to_f64();
                        if !diagonal && term.pair == [of[1], of[0]] {
                            sum[MODES * j + i] += x;
                        }
                        if term.pair == of {
                            sum[MODES * i + j] += x;
                        }
                    }
                }
            }
            Span::Corners { ends } => {
                let quarter = m.map(|row| row.map(|x| 0.25 * x.to_f64()));
                for a in ends[row] {
                    for b in ends[column] {
                        let (of, [i, j]) =
                            ([a / 2, b / 2], [a, b].map(|end| 3 * (end as usize % 2)));
                        if !diagonal && term.pair == [of[1], of[0]] {
                            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                                sum[MODES * (j + c) + i + r] += quarter[r][c];
                            }
                        }
                        if term.pair == of {
                            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                                sum[MODES * (i + r) + j + c] += quarter[r][c];
                            }
                        }
                    }
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
