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

// q = K p, or for the system q = A p with A = c_M M + K and held unknowns taken out exactly (p is 0 there);
// returns the thread's part of p.q.
//
// K does not resist translations, so K p is a sum of K_ij (p_j - p_i): in a smooth p the differences are small,
// and so is what rounding makes of them. Summing K_ij p_j instead would cancel, and f32 would stall conjugate
// gradients ten times earlier in a slender body.
fn multiply(act: bool, is_system: bool, group: u32, local: u32) -> f32 {
    var sum = 0.0;
    let count = select(0u, part.count, act);
    for (var row = group * GROUP + local; row < count; row += part.groups * GROUP) {
        let i = part.first + row;
        let own = rows[P * step.n + i].xyz;
        var q = vec3f(0.0);
        let end = row_start[row + 1u];
        for (var k = row_start[row]; k < end; k += 1u) {
            let x = rows[P * step.n + columns[k]].xyz - own;
            let at = 9u * k;
            q += vec3f(
                dot(vec3f(values[at], values[at + 1u], values[at + 2u]), x),
                dot(vec3f(values[at + 3u], values[at + 4u], values[at + 5u]), x),
                dot(vec3f(values[at + 6u], values[at + 7u], values[at + 8u]), x),
            );
        }
        if is_system {
            q += ((step.inertia + step.mass_damping) * vertices[i].mass) * own;
            q = select(own, q, free_axes(vertices[i].held).xyz > vec3f(0.5));
        }
        rows[Q * step.n + i] = vec4f(q, 0.0);
        sum += dot(q, own);
    }
    return sum;
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
