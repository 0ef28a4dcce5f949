// Products with a part (range of rows) of the block matrix: all blocks of a row lie side by side, 9 numbers
// each, row by row. Four threads share a row: neighbours read neighbouring blocks, and a body of 90 000 vertices fills
// a large device.

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

// Threads of a row, as in matrix.rs.
const ROW_LANES: u32 = 4u;
const GROUP_ROWS: u32 = GROUP / ROW_LANES;

var<workgroup> shares: array<vec4f, 256>;

// Sum over the threads of a row, in their order; each gets it.
fn row_sum(local: u32, own: vec3f) -> vec3f {
    workgroupBarrier();
    shares[local] = vec4f(own, 0.0);
    workgroupBarrier();
    let first = local - local % ROW_LANES;
    var sum = shares[first].xyz;
    for (var k = 1u; k < ROW_LANES; k += 1u) {
        sum += shares[first + k].xyz;
    }
    return sum;
}

// A thread's share of K x in a row of the part.
//
// K does not resist translations, so K x is a sum of K_ij (x_j - x_i): in a smooth x the differences are small,
// and so is what rounding makes of them. Summing K_ij x_j instead would cancel, and f32 would stall conjugate
// gradients ten times earlier in a slender body.
fn tangent_share(row: u32, lane: u32, slot: u32, own: vec3f) -> vec3f {
    var q = vec3f(0.0);
    let end = row_start[row + 1u];
    for (var k = row_start[row] + lane; k < end; k += ROW_LANES) {
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

// A x of a vertex row from K x, A = c_M M + K with held unknowns taken out exactly: x is 0 there.
fn system_row(i: u32, tangent: vec3f, own: vec3f) -> vec3f {
    let vertex = vertices[i];
    let inertia = ((step.inertia + step.mass_damping) * vertex.mass) * own;
    let q = tangent + inertia + row_sum_product(i, own);
    return select(own, q, free_axes(vertex.held).xyz > vec3f(0.5));
}

// q = K p, or for the system q = A p; returns the thread's part of p.q.
fn multiply(act: bool, is_system: bool, group: u32, local: u32) -> f32 {
    var sum = 0.0;
    let lane = local % ROW_LANES;
    // as many rounds for all threads: barriers stand in uniform control flow
    for (var first = group * GROUP_ROWS; first < part.count; first += part.groups * GROUP_ROWS) {
        let row = first + local / ROW_LANES;
        let i = part.first + row;
        let mine = act && row < part.count;
        var own = vec3f(0.0);
        var q = vec3f(0.0);
        if mine {
            own = rows[P * step.n + i].xyz;
            q = tangent_share(row, lane, P, own);
        }
        q = row_sum(local, q);
        if mine && lane == 0u {
            if is_system {
                q = system_row(i, q, own);
            }
            rows[Q * step.n + i] = vec4f(q, 0.0);
            sum += dot(q, own);
        }
    }
    return sum;
}

// The fine level of two: Chebyshev polynomial of the matrix with inverse diagonal blocks, from z = D^-1 r in Z to Q,
// which is free between an iteration's update and the next product; sums r.z.
fn smooth_if(act: bool, group: u32, local: u32) {
    var sum = 0.0;
    let lane = local % ROW_LANES;
    for (var first = group * GROUP_ROWS; first < part.count; first += part.groups * GROUP_ROWS) {
        let row = first + local / ROW_LANES;
        let i = part.first + row;
        let mine = act && row < part.count;
        var own = vec4f(0.0);
        var q = vec3f(0.0);
        if mine {
            own = load_row(Z, i);
            q = tangent_share(row, lane, Z, own.xyz);
        }
        q = row_sum(local, q);
        if mine && lane == 0u {
            let moved = precondition(i, vec4f(system_row(i, q, own.xyz), 0.0));
            let z = step.smoother.x * own - step.smoother.y * moved;
            store_row(Q, i, vec4f(z.xyz, 0.0));
            sum += dot(load_row(R, i).xyz, z.xyz);
        }
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
