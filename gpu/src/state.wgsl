// Vertex rows and the state of conjugate gradients, for all kernels that work on them. The module declares `step`,
// `rows`, `partials` and `cg`.

const ITERATING: u32 = 0u;
const CLAIMED: u32 = 1u;     // the recurrence says converged; the true residual is to be formed
const CONVERGED: u32 = 2u;
const CAPPED: u32 = 3u;      // too many iterations
const INDEFINITE: u32 = 4u;  // a direction of curvature that is not positive
const NOT_FINITE: u32 = 5u;
const STALLED: u32 = 6u;     // f32 gets no closer
const UNUSABLE: u32 = 7u;    // r.z is not positive: rounding has spoilt the motions of aggregates

struct CgState {
    phase: atomic<u32>,
    iterations: u32,
    restarts: u32,
    fresh: u32,          // 1 before the first product of a sequence
    rz: f32,             // r.z
    reference: f32,      // squared norm the residual is measured against
    residual: f32,       // squared norm of the true residual when last formed
    curvature: f32,      // p.q when it was not positive
}

fn load_row(slot: u32, i: u32) -> vec4f {
    return rows[slot * step.n + i];
}

fn store_row(slot: u32, i: u32, x: vec4f) {
    rows[slot * step.n + i] = x;
}

// Sums of partials[first..first + count]; all threads get them.
fn total(first: u32, count: u32, local: u32) -> vec4f {
    var own = vec4f(0.0);
    for (var k = local; k < count; k += GROUP) {
        own += partials[first + k];
    }
    return group_sum(local, own);
}

// r.z, r.r and b.b, or what `improve` found wrong. With two levels r.z is that of the smoother, where products leave
// their sums, and that of the aggregates.
fn preconditioned_sums(local: u32) -> vec4f {
    let first = select(step.matrix_groups, 0u, two_levels());
    return total(first, step.matrix_groups + step.groups + step.coarse_groups - first, local);
}

fn two_levels() -> bool {
    return step.coarse_groups > 0u;
}

// Inverse diagonal blocks are positive definite by construction; the inverse of the coarse matrix is up to rounding.
fn unusable(rz: f32) -> bool {
    return two_levels() && !(rz > 0.0);
}
