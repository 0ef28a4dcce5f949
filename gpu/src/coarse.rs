//! Rigid motions of aggregates on the device: the second level of the preconditioner `"multigrid"`. The aggregates
//! are chosen as on the processor; the rest differs where a graphics processor is good at other things.
//!
//! * **The fine level is a Chebyshev polynomial** of first degree in the matrix with inverse diagonal blocks: one
//!   more product, where incomplete factors are solved row after row. Elements of `m` vertices bound the spectrum by
//!   `m`, so nothing is estimated and the polynomial is positive. Aggregates are smaller than on the processor, 16
//!   vertices, and larger only where there would be too many.
//! * **The coarse level is a product with the whole inverse**, at most 2046 x 2046 numbers: one pass over 16 MB
//!   where substitution would take hundreds of dependent steps. Gauss-Jordan by blocks on the device finds the
//!   inverse in place, from Galerkin blocks that it sums itself; nothing crosses to the host.
//! * **Added, not multiplied**: symmetric and positive definite as it stands, without products in between.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use sinew_adapter::wgpu;
use sinew_solvers::coarse::Aggregates;

use crate::context::{Context, Pass, PassRecorder, groups_for};
use crate::lists::compressed;
use crate::matrix::MatrixPattern;
use crate::report::Phase;

/// Vertices of an aggregate, about, while there are not too many.
const AGGREGATE: usize = 16;
/// Most aggregates, whose inverse is then 16 MB.
const MAX_AGGREGATES: usize = 341;
/// Unknowns of an aggregate.
const MODES: usize = 6;
/// Rows of a pivot, as in inverse.wgsl.
const PIVOT: u32 = 32;
/// Aggregates that a workgroup sums over, and rows of the inverse that it multiplies with: 64 threads each, as in
/// coarse.wgsl.
const SHARED: u32 = 4;

/// `Coarse` of prelude.wgsl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct CoarseUniform {
    aggregates: u32,
    stride: u32,
    blocks: u32,
    padding: u32,
}

/// What the coarse space is made for: rows of a body.
pub struct CoarseParts<'a> {
    /// Rest positions (m).
    pub rest: &'a [DVec3],
    /// Connected piece of each row.
    pub piece: &'a [u32],
}

/// The buffers of a body that kernels of the coarse space work on.
pub struct CoarseBuffers<'a> {
    pub step: &'a wgpu::Buffer,
    pub rows: &'a wgpu::Buffer,
    pub vertices: &'a wgpu::Buffer,
    pub partials: &'a wgpu::Buffer,
    pub cg: &'a wgpu::Buffer,
}

/// Sizes, known before the buffers of the body.
pub struct CoarsePlan {
    pub aggregates: Aggregates,
    pub stride: u32,
    /// Partial sums that an application leaves.
    pub groups: u32,
}

impl CoarsePlan {
    /// Aggregates of a body; `None` when there would be too many, in a body of that many pieces, or only one vertex.
    pub fn new(context: &Context, parts: &CoarseParts<'_>) -> Option<Self> {
        let n = parts.rest.len();
        let most = ((context.binding_limit / 4) as f64).sqrt() as usize;
        let most = (most / PIVOT as usize * PIVOT as usize / MODES).min(MAX_AGGREGATES);
        let mut size = AGGREGATE.max(n.div_ceil(most.max(1)));
        let mut aggregates = Aggregates::new(parts.rest, parts.piece, size);
        // pieces are rounded one by one
        while aggregates.count > most && size < n {
            size = (size + size / 8 + 1).min(n);
            aggregates = Aggregates::new(parts.rest, parts.piece, size);
        }
        if aggregates.count == 0 || aggregates.count > most {
            return None;
        }
        let unknowns = (MODES * aggregates.count) as u32;
        let (stride, groups) = (unknowns.next_multiple_of(PIVOT), unknowns.div_ceil(SHARED));
        Some(Self { aggregates, stride, groups })
    }
}

/// Coarse space of a body on the device.
pub struct Coarse {
    aggregates: u32,
    pub stride: u32,
    /// Partial sums that an application leaves.
    pub groups: u32,
    blocks: u32,
    pub inverse: wgpu::Buffer,
    solver: wgpu::BindGroup,
    /// For each part of the matrix.
    galerkin: Vec<wgpu::BindGroup>,
    /// For each pivot.
    pivots: Vec<wgpu::BindGroup>,
}

impl Coarse {
    pub fn new(
        context: &Context,
        plan: CoarsePlan,
        pattern: &MatrixPattern,
        buffers: &CoarseBuffers<'_>,
    ) -> Self {
        let CoarsePlan { aggregates: Aggregates { of, arm, count }, stride, groups } = plan;
        let pairs = coupled(pattern, &of, count);
        let uniform = CoarseUniform {
            aggregates: count as u32,
            stride,
            blocks: pairs.len() as u32,
            padding: 0,
        };
        let uniform = context.uniform("coarse", &uniform);
        let arms: Vec<_> = arm
            .iter()
            .zip(&of)
            .map(|(arm, &a)| arm.as_vec3().extend(a as f32).to_array())
            .collect();
        let arms = context.filled("arms", &arms);
        let (mut members, rows) = compressed(count, || of.iter().copied().zip(0..));
        members.extend(rows);
        let members = context.filled("members of aggregates", &members);
        let square = 4 * u64::from(stride) * u64::from(stride);
        let inverse = context.storage("inverse of the coarse matrix", square);
        let motions = context.storage("motions of aggregates", 8 * u64::from(stride));
        let blocks = context.storage("coarse matrix", 144 * pairs.len() as u64);
        let panels = 4 * u64::from(PIVOT) * u64::from(PIVOT + 2 * stride);
        let panels = context.storage("panels", panels);
        let pair_buffer = context.filled("pairs of aggregates", &pairs);
        let CoarseBuffers { step, rows, vertices, partials, cg } = *buffers;
        let bound =
            [step, rows, vertices, partials, cg, &uniform, &arms, &members, &inverse, &motions];
        let solver = context.bind(&context.layouts.coarse, &bound);
        let galerkin = pattern.parts.iter().enumerate().map(|(at, part)| {
            let (starts, terms) = terms(pattern, at, &of, &pairs);
            let own = [u32::from(at > 0), pairs.len() as u32, 0, 0];
            let own = context.uniform("part of the coarse matrix", &own);
            let starts = context.filled("starts", &starts);
            let terms = context.filled("terms of coarse blocks", &terms);
            let columns = &part.columns;
            let bound =
                [step, &own, vertices, &arms, columns, &part.values, &starts, &terms, &blocks];
            context.bind(&context.layouts.galerkin, &bound)
        });
        let galerkin = galerkin.collect();
        let pivots = (0..stride).step_by(PIVOT as usize).map(|first| {
            let own = context.uniform("pivot", &[first, 0, 0, 0, 0, 0, 0, 0]);
            let bound = [&uniform, &own, &blocks, &pair_buffer, &inverse, &panels];
            context.bind(&context.layouts.inverse, &bound)
        });
        let pivots = pivots.collect();
        let (aggregates, blocks) = (count as u32, pairs.len() as u32);
        Self { aggregates, stride, groups, blocks, inverse, solver, galerkin, pivots }
    }

    /// Iterations that pass in the time of a [`refresh`](Self::refresh), about: passes over the inverse against
    /// those of an iteration, which also reads `matrix` bytes of the matrix.
    pub fn cost(&self, matrix: u64) -> f64 {
        let square = 4.0 * f64::from(self.stride).powi(2);
        // an elimination reads and writes, and costs more than its bytes while these are few
        let refresh = self.pivots.len() as f64 * (2.0 * square + matrix as f64);
        refresh / (square + 2.0 * matrix as f64)
    }

    /// The inverse of the coarse matrix of the system at hand.
    pub fn refresh(&self, recorder: &mut PassRecorder<'_>) {
        recorder.encoder.clear_buffer(&self.inverse, 0, None);
        recorder.pass(Phase::Preconditioner, |pass| {
            let context = pass.context;
            let layouts = [&context.layouts.galerkin];
            let galerkin = context.kernel("galerkin", "galerkin", &layouts);
            let kernel = |entry| context.kernel("inverse", entry, &[&context.layouts.inverse]);
            let numbers = groups_for(36 * u64::from(self.blocks));
            for part in &self.galerkin {
                pass.run(&galerkin, &[part], numbers);
            }
            pass.run(&kernel("scatter"), &[&self.pivots[0]], numbers);
            let [invert, panels, eliminate] =
                ["invert_pivot", "take_panels", "eliminate"].map(kernel);
            let tiles = self.stride / PIVOT;
            let panel = groups_for(u64::from(PIVOT) * u64::from(self.stride));
            for pivot in &self.pivots {
                pass.run(&invert, &[pivot], [1, 1]);
                pass.run(&panels, &[pivot], panel);
                pass.run(&eliminate, &[pivot], [tiles, tiles]);
            }
            let all = groups_for(u64::from(self.stride) * u64::from(self.stride));
            pass.run(&kernel("finish"), &[&self.pivots[0]], all);
        });
    }

    /// Forces on aggregates and their motions, by kernels of [`START`] and so on.
    pub fn apply(&self, [_, restrict, motions]: [&'static str; 3], pass: &mut Pass<'_>) {
        self.dispatch(restrict, [self.aggregates.div_ceil(SHARED), 1], pass);
        self.dispatch(motions, [self.groups, 1], pass);
    }

    /// Runs a kernel over so many workgroups.
    pub fn dispatch(&self, entry: &'static str, groups: [u32; 2], pass: &mut Pass<'_>) {
        let layouts = [&pass.context.layouts.coarse];
        let kernel = pass.context.kernel("coarse", entry, &layouts);
        pass.run(&kernel, &[&self.solver], groups);
    }
}

/// Smoother, restriction and motions at the start, in an iteration, and for the true residual.
pub const START: [&str; 3] = ["smooth_start", "restrict_start", "move_start"];
pub const ITERATION: [&str; 3] = ["smooth_iteration", "restrict_iteration", "move_iteration"];
pub const VERIFY: [&str; 3] = ["smooth_verify", "restrict_verify", "move_verify"];

/// Largest over smallest eigenvalue that the smoother is meant for; what is below is left to the motions.
pub const SMOOTHED: f64 = 8.0;

/// Factors of `D^-1 r` and `D^-1 A D^-1 r` in the smoother: the Chebyshev polynomial whose residual is smallest over
/// eigenvalues of `D^-1 A` from `largest` down to an eighth of it. It is positive up to 9/8 of `largest`.
pub fn smoother(largest: f64) -> [f32; 2] {
    let centre = 0.5 * largest * (1.0 + 1.0 / SMOOTHED);
    let half = 0.5 * largest * (1.0 - 1.0 / SMOOTHED);
    // 1 - T((centre - x)/half)/T(centre/half) over x, T the second polynomial
    let scale = 2.0 * centre * centre - half * half;
    [(4.0 * centre / scale) as f32, (2.0 / scale) as f32]
}

/// Pairs of aggregates `a <= b` that share a block of the matrix: every aggregate with itself first.
fn coupled(pattern: &MatrixPattern, of: &[u32], count: usize) -> Vec<[u32; 2]> {
    let mut others: Vec<[u32; 2]> = Vec::new();
    for (row, &a) in of.iter().enumerate() {
        let own = pattern.row(row);
        others.extend(own.iter().map(|&j| [a, of[j as usize]]).filter(|[a, b]| a < b));
        // the list would grow to the size of the matrix
        if others.len() > 1 << 16 {
            others.sort_unstable();
            others.dedup();
        }
    }
    others.sort_unstable();
    others.dedup();
    (0..count as u32).map(|a| [a, a]).chain(others).collect()
}

/// For every pair the blocks of a part that belong to it: starts, and (vertex row, block) in their order.
fn terms(
    pattern: &MatrixPattern,
    part: usize,
    of: &[u32],
    pairs: &[[u32; 2]],
) -> (Vec<u32>, Vec<[u32; 2]>) {
    let count = of.iter().max().map_or(0, |&a| a as usize + 1);
    let others = &pairs[count..];
    let part = &pattern.parts[part];
    let mut found = Vec::with_capacity(part.entries as usize);
    let mut block = 0;
    for row in part.first..part.first + part.count {
        let a = of[row as usize];
        for &column in pattern.row(row as usize) {
            let b = of[column as usize];
            let place = if a == b {
                Some(a as usize)
            } else {
                others.binary_search(&[a, b]).ok().map(|at| count + at)
            };
            found.extend(place.map(|place| (place as u32, [row, block])));
            block += 1;
        }
    }
    compressed(pairs.len(), || found.iter().copied())
}

/// What the inverse was computed for, and how it did since; as the processor keeps its preconditioners.
#[derive(Clone, Debug)]
pub struct KeptInverse {
    /// Factors of masses and of stiffness damping in the matrix.
    factors: [f32; 3],
    /// Iterations per power of ten of the first solve after the refresh.
    fresh: Option<f64>,
    /// Iterations spent beyond that since.
    excess: f64,
    /// Iterations that a refresh costs.
    cost: f64,
}

impl KeptInverse {
    pub fn new(factors: [f32; 3], cost: f64) -> Self {
        Self { factors, fresh: None, excess: 0.0, cost }
    }

    /// Whether it still serves a matrix with these factors.
    pub fn serves(&self, factors: [f32; 3]) -> bool {
        self.factors == factors && self.excess < self.cost
    }

    /// Books a solve that converged by so many powers of ten.
    pub fn book(&mut self, iterations: u32, decades: f64) {
        if !(decades > 0.0 && decades.is_finite()) {
            return;
        }
        let iterations = f64::from(iterations);
        match self.fresh {
            Some(fresh) => self.excess += (iterations - fresh * decades).max(0.0),
            None => self.fresh = Some(iterations / decades),
        }
    }
}
