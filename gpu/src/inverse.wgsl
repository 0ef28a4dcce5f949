// Galerkin blocks to the inverse of the coarse matrix: Gauss-Jordan by blocks of 32, three dispatches a block.
//
// The matrix is scaled to a unit diagonal first. It is positive definite, so no pivot has to be looked for. One that
// may be rounding stands for a motion without resistance of its own (held vertices, vertices in line) and is left
// out: its row and column become 0.

@group(0) @binding(0) var<uniform> coarse: Coarse;
@group(0) @binding(1) var<uniform> pivot: Pivot;
@group(0) @binding(2) var<storage, read> blocks: array<f32>;
@group(0) @binding(3) var<storage, read> pairs: array<vec2u>;            // aggregates of a block, diagonal ones first
@group(0) @binding(4) var<storage, read_write> dense: array<f32>;
@group(0) @binding(5) var<storage, read_write> panels: array<f32>;       // inverse of the pivot, rows, columns

struct Pivot {
    first: u32,
    padding: vec3u,
}

const SIZE: u32 = 32u;
const PIVOT: f32 = 1e-5;
const NO_RESISTANCE: f32 = 1e-6;

// Over the root of the diagonal; 0 for a motion without resistance.
fn scale(unknown: u32) -> f32 {
    let aggregate = unknown / 6u;
    if aggregate >= coarse.aggregates { return 0.0; }
    var largest = 0.0;
    for (var k = 0u; k < 6u; k += 1u) {
        largest = max(largest, blocks[36u * aggregate + 7u * k]);
    }
    let own = blocks[36u * aggregate + 7u * (unknown - 6u * aggregate)];
    return select(0.0, inverseSqrt(own), own > NO_RESISTANCE * largest && is_finite(own));
}

// One thread for each number of the blocks; the matrix was cleared.
@compute @workgroup_size(256)
fn scatter(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    let block = place / 36u;
    if block >= coarse.blocks { return; }
    let entry = place - 36u * block;
    let p = entry / 6u;
    let q = entry - 6u * p;
    let diagonal = block < coarse.aggregates;
    // the upper half stands for both
    let x = blocks[36u * block + select(entry, 6u * min(p, q) + max(p, q), diagonal)];
    let row = 6u * pairs[block].x + p;
    let column = 6u * pairs[block].y + q;
    let value = scale(row) * scale(column) * x;
    dense[row * coarse.stride + column] = value;
    if !diagonal {
        dense[column * coarse.stride + row] = value;
    }
}

var<workgroup> square: array<f32, 1024>;

// Inverse of the pivot, one workgroup.
@compute @workgroup_size(256)
fn invert_pivot(@builtin(local_invocation_index) local: u32) {
    let first = pivot.first;
    for (var e = local; e < SIZE * SIZE; e += GROUP) {
        square[e] = dense[(first + e / SIZE) * coarse.stride + first + e % SIZE];
    }
    workgroupBarrier();
    for (var k = 0u; k < SIZE; k += 1u) {
        let own = square[k * SIZE + k];
        let usable = own > PIVOT && is_finite(own);
        let over = select(0.0, 1.0 / own, usable);
        var next = array<f32, 4>();
        for (var n = 0u; n < 4u; n += 1u) {
            let e = local + n * GROUP;
            let row = e / SIZE;
            let column = e % SIZE;
            let x = square[e];
            let along = square[k * SIZE + column];
            let across = square[row * SIZE + k];
            var y = x - across * along * over;
            if row == k && column == k {
                y = over;
            } else if row == k {
                y = along * over;
            } else if column == k {
                y = -across * over;
            }
            next[n] = y;
        }
        workgroupBarrier();
        for (var n = 0u; n < 4u; n += 1u) {
            square[local + n * GROUP] = next[n];
        }
        workgroupBarrier();
    }
    for (var e = local; e < SIZE * SIZE; e += GROUP) {
        panels[e] = square[e];
    }
}

// Rows of the pivot times its inverse, which stands in its own columns; columns of the pivot as they are. One thread
// for each number.
@compute @workgroup_size(256)
fn take_panels(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    let r = place / coarse.stride;
    if r >= SIZE { return; }
    let j = place - r * coarse.stride;
    let first = pivot.first;
    let inside = j >= first && j < first + SIZE;
    var sum = 0.0;
    if inside {
        sum = panels[r * SIZE + j - first];
    } else {
        for (var s = 0u; s < SIZE; s += 1u) {
            sum += panels[r * SIZE + s] * dense[(first + s) * coarse.stride + j];
        }
    }
    panels[SIZE * SIZE + r * coarse.stride + j] = sum;
    panels[SIZE * (SIZE + coarse.stride) + r * coarse.stride + j] = dense[j * coarse.stride + first + r];
}

var<workgroup> left: array<f32, 1024>;
var<workgroup> right: array<f32, 1024>;

// All other rows less their columns of the pivot times its rows; a workgroup for each 32 x 32 numbers.
@compute @workgroup_size(256)
fn eliminate(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let first = pivot.first;
    let top = SIZE * group.y;
    let side = SIZE * group.x;
    for (var e = local; e < SIZE * SIZE; e += GROUP) {
        let r = e / SIZE;
        let c = e % SIZE;
        right[e] = panels[SIZE * SIZE + r * coarse.stride + side + c];
        left[e] = panels[SIZE * (SIZE + coarse.stride) + r * coarse.stride + top + c];
    }
    workgroupBarrier();
    // four numbers a thread, in one column
    let j = local % SIZE;
    let i = local / SIZE;
    let below = GROUP / SIZE;
    var sum = vec4f(0.0);
    for (var r = 0u; r < SIZE; r += 1u) {
        let at = r * SIZE + i;
        sum += vec4f(left[at], left[at + below], left[at + 2u * below], left[at + 3u * below]) * right[r * SIZE + j];
    }
    for (var n = 0u; n < 4u; n += 1u) {
        let row = i + n * below;
        let at = (top + row) * coarse.stride + side + j;
        var value = right[row * SIZE + j];
        if top != first {
            value = select(dense[at], 0.0, side == first) - sum[n];
        }
        dense[at] = value;
    }
}

// Takes the scale out and makes the inverse exactly symmetric, one thread for each pair of numbers.
@compute @workgroup_size(256)
fn finish(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    let i = place / coarse.stride;
    let j = place - i * coarse.stride;
    if i >= coarse.stride || j < i { return; }
    let value = 0.5 * (dense[i * coarse.stride + j] + dense[j * coarse.stride + i]) * scale(i) * scale(j);
    dense[i * coarse.stride + j] = value;
    dense[j * coarse.stride + i] = value;
}
