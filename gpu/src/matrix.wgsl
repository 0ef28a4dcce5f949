// Products with a part (range of rows) of the block matrix: all blocks of a row lie side by side, 9 numbers
// each, row by row. One thread per vertex row: a warp reads whole cache lines over its next few blocks.

struct Part {
    first: u32,       // first vertex row
    count: u32,       // vertex rows
    partial: u32,     // place of its first partial sum
    groups: u32,      // workgroups of its products
}

@group(1) @binding(0) var<uniform> part: Part;
@group(1) @binding(1) var<storage, read> row_start: array<u32>;
@group(1) @binding(2) var<storage, read> columns: array<u32>;
@group(1) @binding(3) var<storage, read> values: array<f32>;

// K x of a row of the part.
//
// K does not resist translations, so K x is a sum of K_ij (x_j - x_i): in a smooth x the differences are small,
// and so is what rounding makes of them. Summing K_ij x_j instead would cancel, and f32 would stall conjugate
// gradients ten times earlier in a slender body.
fn tangent_product(row: u32, slot: u32, own: vec3f) -> vec3f {
    var q = vec3f(0.0);
    let end = row_start[row + 1u];
    for (var k = row_start[row]; k < end; k += 1u) {
        let x = rows[slot * step.n + columns[k]].xyz - own;
        let at = 9u * k;
        q += vec3f(
            dot(vec3f(values[at], values[at + 1u], values[at + 2u]), x),
            dot(vec3f(values[at + 3u], values[at + 4u], values[at + 5u]), x),
            dot(vec3f(values[at + 6u], values[at + 7u], values[at + 8u]), x),
        );
    }
    return q;
}

// A x of a row, A = c_M M + K with held unknowns taken out exactly: x is 0 there.
fn system_product(row: u32, slot: u32, own: vec3f) -> vec3f {
    let i = part.first + row;
    let vertex = vertices[i];
    let inertia = ((step.inertia + step.mass_damping) * vertex.mass) * own;
    let q = tangent_product(row, slot, own) + inertia + row_sum_product(i, own);
    return select(own, q, free_axes(vertex.held).xyz > vec3f(0.5));
}

// q = K p, or for the system q = A p; returns the thread's part of p.q.
fn multiply(act: bool, is_system: bool, group: u32, local: u32) -> f32 {
    var sum = 0.0;
    let count = select(0u, part.count, act);
    for (var row = group * GROUP + local; row < count; row += part.groups * GROUP) {
        let i = part.first + row;
        let own = rows[P * step.n + i].xyz;
        var q = vec3f(0.0);
        if is_system {
            q = system_product(row, P, own);
        } else {
            q = tangent_product(row, P, own);
        }
        rows[Q * step.n + i] = vec4f(q, 0.0);
        sum += dot(q, own);
    }
    return sum;
}

// The fine level of two: Chebyshev polynomial of the matrix with inverse diagonal blocks, from z = D^-1 r in Z to Q,
// which is free between an iteration's update and the next product; sums r.z.
fn smooth_if(act: bool, group: u32, local: u32) {
    var sum = 0.0;
    let count = select(0u, part.count, act);
    for (var row = group * GROUP + local; row < count; row += part.groups * GROUP) {
        let i = part.first + row;
        let own = load_row(Z, i);
        let moved = precondition(i, vec4f(system_product(row, Z, own.xyz), 0.0));
        let z = step.smoother.x * own - step.smoother.y * moved;
        store_row(Q, i, vec4f(z.xyz, 0.0));
        sum += dot(load_row(R, i).xyz, z.xyz);
    }
    let all = group_sum(local, vec4f(sum, 0.0, 0.0, 0.0));
    if local == 0u && act {
        partials[part.partial + group] = all;
    }
}

// Product with a tangent alone.
@compute @workgroup_size(256)
fn product_plain(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    multiply(true, false, group.x, local);
}

// Product with the system outside an iteration.
@compute @workgroup_size(256)
fn product_alone(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    multiply(true, true, group.x, local);
}

// Product for the true residual.
@compute @workgroup_size(256)
fn product_verify(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    multiply(atomicLoad(&cg.phase) == CLAIMED, true, group.x, local);
}

// Takes note of the last iteration. Runs before the products; one workgroup.
@compute @workgroup_size(256)
fn note(@builtin(local_invocation_index) local: u32) {
    let phase = atomicLoad(&cg.phase);
    let sum = preconditioned_sums(local);
    if local != 0u || phase != ITERATING { return; }
    if cg.fresh == 1u {
        cg.fresh = 0u;
        return;
    }
    if sum.w > 0.0 {
        cg.curvature = sum.z / sum.w;
        atomicStore(&cg.phase, select(NOT_FINITE, INDEFINITE, is_finite(sum.z)));
        return;
    }
    cg.iterations += 1u;
    cg.rz = sum.x;
    if !is_finite(sum.y) {
        atomicStore(&cg.phase, NOT_FINITE);
    } else if sum.y <= step.tolerance * step.tolerance * cg.reference {
        atomicStore(&cg.phase, CLAIMED);
    } else if cg.iterations >= step.max_iterations {
        cg.residual = sum.y;
        atomicStore(&cg.phase, CAPPED);
    } else if unusable(sum.x) {
        atomicStore(&cg.phase, UNUSABLE);
    }
}

// Product of an iteration.
@compute @workgroup_size(256)
fn product(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let go = atomicLoad(&cg.phase) == ITERATING;
    let own = multiply(go, true, group.x, local);
    let sum = group_sum(local, vec4f(own, 0.0, 0.0, 0.0));
    if local == 0u && go {
        partials[part.partial + group.x] = sum;
    }
}
