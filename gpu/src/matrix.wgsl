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

// q = A p; returns the thread's part of p.q.
fn multiply(act: bool, group: u32, local: u32) -> f32 {
    var sum = 0.0;
    let count = select(0u, part.count, act);
    for (var row = group * GROUP + local; row < count; row += part.groups * GROUP) {
        var own = vec3f(0.0);
        let end = row_start[row + 1u];
        for (var k = row_start[row]; k < end; k += 1u) {
            let x = rows[P * step.n + columns[k]].xyz;
            let at = 9u * k;
            own += vec3f(
                dot(vec3f(values[at], values[at + 1u], values[at + 2u]), x),
                dot(vec3f(values[at + 3u], values[at + 4u], values[at + 5u]), x),
                dot(vec3f(values[at + 6u], values[at + 7u], values[at + 8u]), x),
            );
        }
        let i = part.first + row;
        rows[Q * step.n + i] = vec4f(own, 0.0);
        sum += dot(own, rows[P * step.n + i].xyz);
    }
    return sum;
}

// Product outside an iteration.
@compute @workgroup_size(256)
fn product_alone(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    multiply(true, group.x, local);
}

// Product for the true residual.
@compute @workgroup_size(256)
fn product_verify(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    multiply(atomicLoad(&cg.phase) == CLAIMED, group.x, local);
}

// Takes note of the last iteration. Runs before the products; one workgroup.
@compute @workgroup_size(256)
fn note(@builtin(local_invocation_index) local: u32) {
    let phase = atomicLoad(&cg.phase);
    let sum = total(step.matrix_groups, step.groups, local);
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
    }
}

// Product of an iteration.
@compute @workgroup_size(256)
fn product(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let go = atomicLoad(&cg.phase) == ITERATING;
    let own = multiply(go, group.x, local);
    let sum = group_sum(local, vec4f(own, 0.0, 0.0, 0.0));
    if local == 0u && go {
        partials[part.partial + group.x] = sum;
    }
}
