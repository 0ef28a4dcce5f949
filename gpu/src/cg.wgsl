// Conjugate gradients. Twin of `sinew_solvers::cg`.
//
// The preconditioner is the inverse diagonal blocks, to which coarse.wgsl may add rigid motions of aggregates. An
// iteration is four dispatches: `note` (one workgroup) and `product` in matrix.wgsl, `improve`, `direction`; seven
// with two levels: a smoother and the motions come between the last two, with a `direction` of their own.
// Scalar products leave one partial sum per workgroup; whoever needs the total adds these up again, in the same
// order everywhere. The state changes in kernels of one workgroup only (`start_end`, `note`, `verify_end`), so
// that nobody reads it while it changes. Once the phase is no longer ITERATING, iterations do nothing.

fn precondition(i: u32, r: vec4f) -> vec4f {
    let a = load_row(INVERSE, i);
    let b = load_row(INVERSE_2, i);
    return vec4f(dot(a.xyz, r.xyz), dot(vec3f(a.y, a.w, b.x), r.xyz), dot(vec3f(a.z, b.x, b.y), r.xyz), 0.0);
}

// r = b - A x with A x in Q, z, p = z; sums r.z, r.r, b.b. Runs before the first iteration.
fn form_residual(act: bool, group: vec3u, groups: vec3u, local: u32) {
    var own = vec4f(0.0);
    let end = select(0u, step.n, act);
    for (var i = group.x * GROUP + local; i < end; i += groups.x * GROUP) {
        let b = load_row(RHS, i);
        let r = b - load_row(Q, i);
        let z = precondition(i, r);
        store_row(R, i, r);
        store_row(Z, i, z);
        store_row(P, i, z);
        own += vec4f(select(dot(r.xyz, z.xyz), 0.0, two_levels()), dot(r.xyz, r.xyz), dot(b.xyz, b.xyz), 0.0);
    }
    // every thread takes part in the sum: barriers stand in uniform control flow
    let sum = group_sum(local, own);
    if local == 0u && act {
        partials[step.matrix_groups + group.x] = sum;
    }
}

@compute @workgroup_size(256)
fn start_residual(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    form_residual(true, group, groups, local);
}

// One workgroup: what the residual is measured against, and whether anything is left to do.
@compute @workgroup_size(256)
fn start_end(@builtin(local_invocation_index) local: u32) {
    let sum = preconditioned_sums(local);
    if local != 0u { return; }
    // below a few units of rounding of b there is nothing left to solve for
    let floor = 16.0 * 1.1920929e-7 / step.tolerance;
    cg.reference = max(min(sum.y, sum.z), floor * floor * sum.z);
    cg.residual = sum.y;
    cg.rz = sum.x;
    cg.iterations = 0u;
    cg.restarts = 0u;
    cg.fresh = 1u;
    cg.curvature = 0.0;
    var phase = ITERATING;
    if !(is_finite(sum.y) && is_finite(sum.z)) {
        phase = NOT_FINITE;
    } else if sum.z == 0.0 || sum.y <= step.tolerance * step.tolerance * cg.reference {
        phase = CONVERGED;
    } else if unusable(sum.x) {
        phase = UNUSABLE;
    }
    atomicStore(&cg.phase, phase);
}

// x += alpha p, r -= alpha q, z; sums r.z, r.r.
@compute @workgroup_size(256)
fn improve(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    // the same for all threads
    let go = atomicLoad(&cg.phase) == ITERATING;
    let curvature = total(0u, step.matrix_groups, local).x;
    let alpha = cg.rz / curvature;
    let usable = go && curvature > 0.0 && is_finite(alpha);
    var own = vec4f(0.0);
    if usable {
        for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
            store_row(STEP, i, load_row(STEP, i) + alpha * load_row(P, i));
            let r = load_row(R, i) - alpha * load_row(Q, i);
            let z = precondition(i, r);
            store_row(R, i, r);
            store_row(Z, i, z);
            own += vec4f(select(dot(r.xyz, z.xyz), 0.0, two_levels()), dot(r.xyz, r.xyz), 0.0, 0.0);
        }
    }
    let sum = group_sum(local, own);
    if local == 0u {
        if usable {
            partials[step.matrix_groups + group.x] = sum;
        } else if go {
            // told apart by the next product
            partials[step.matrix_groups + group.x] = vec4f(0.0, 0.0, curvature, 1.0);
        }
    }
}

// p = z + beta p.
@compute @workgroup_size(256)
fn direction(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let go = atomicLoad(&cg.phase) == ITERATING;
    let sum = preconditioned_sums(local);
    if !go || sum.w > 0.0 { return; }
    let beta = sum.x / cg.rz;
    for (var i = group.x * GROUP + local; i < step.n; i += groups.x * GROUP) {
        store_row(P, i, load_row(Z, i) + beta * load_row(P, i));
    }
}

// The true residual of what the recurrence calls converged; else nothing. Runs after each batch of iterations,
// with the product of STEP in between.
fn verify_begin_at(i: u32) {
    if atomicLoad(&cg.phase) != CLAIMED { return; }
    store_row(P, i, load_row(STEP, i));
}

@compute @workgroup_size(256)
fn verify_residual(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    form_residual(atomicLoad(&cg.phase) == CLAIMED, group, groups, local);
}

// Rounding makes the true residual a little larger than the recurrence has it.
const DRIFT_ALLOWED: f32 = 1.2;
const MAX_RESTARTS: u32 = 4u;

@compute @workgroup_size(256)
fn verify_end(@builtin(local_invocation_index) local: u32) {
    let phase = atomicLoad(&cg.phase);
    let sum = preconditioned_sums(local);
    if local != 0u || phase != CLAIMED { return; }
    let before = cg.residual;
    cg.residual = sum.y;
    let bound = DRIFT_ALLOWED * step.tolerance;
    if !is_finite(sum.y) {
        atomicStore(&cg.phase, NOT_FINITE);
    } else if sum.y <= bound * bound * cg.reference {
        atomicStore(&cg.phase, CONVERGED);
    } else if cg.restarts >= MAX_RESTARTS || sum.y > 0.25 * before {
        atomicStore(&cg.phase, STALLED);
    } else if unusable(sum.x) {
        atomicStore(&cg.phase, UNUSABLE);
    } else {
        cg.restarts += 1u;
        cg.rz = sum.x;
        cg.fresh = 1u;
        atomicStore(&cg.phase, ITERATING);
    }
}

// Inverse diagonal blocks times the right-hand side: a descent direction whatever the matrix.
fn preconditioned_gradient_at(i: u32) {
    store_row(STEP, i, precondition(i, load_row(RHS, i)));
}
