// The coarse matrix from that of the step: Galerkin blocks between aggregates, each number the sum of what the
// blocks between their vertices have for it, in a fixed order.

struct GalerkinPart {
    accumulate: u32,   // 0 for the first part of the matrix, which overwrites
    blocks: u32,
    padding: vec2u,
}

// Motion of vertex i by unknown k of its aggregate.
fn mode(arm: vec3f, free: vec3f, k: u32) -> vec3f {
    var axis = vec3f(0.0);
    axis[k % 3u] = 1.0;
    return free * select(cross(axis, arm), axis, k < 3u);
}

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> part: GalerkinPart;
@group(0) @binding(2) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(3) var<storage, read> arms: array<vec4f>;
@group(0) @binding(4) var<storage, read> columns: array<u32>;
@group(0) @binding(5) var<storage, read> values: array<f32>;
@group(0) @binding(6) var<storage, read> starts: array<u32>;
@group(0) @binding(7) var<storage, read> terms: array<vec2u>;      // vertex row, block of the part
@group(0) @binding(8) var<storage, read_write> blocks: array<f32>;

// Sum of B_i^T A_ij B_j over the blocks between two aggregates, one thread for each of its 36 numbers.
@compute @workgroup_size(256)
fn galerkin(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    let block = place / 36u;
    if block >= part.blocks { return; }
    let entry = place - 36u * block;
    let p = entry / 6u;
    let q = entry - 6u * p;
    var sum = 0.0;
    if part.accumulate == 1u {
        sum = blocks[place];
    }
    let end = starts[block + 1u];
    for (var t = starts[block]; t < end; t += 1u) {
        let i = terms[t].x;
        let k = terms[t].y;
        let j = columns[k];
        let left = mode(arms[i].xyz, free_axes(vertices[i].held).xyz, p);
        let right = mode(arms[j].xyz, free_axes(vertices[j].held).xyz, q);
        let at = 9u * k;
        var moved = vec3f(
            dot(vec3f(values[at], values[at + 1u], values[at + 2u]), right),
            dot(vec3f(values[at + 3u], values[at + 4u], values[at + 5u]), right),
            dot(vec3f(values[at + 6u], values[at + 7u], values[at + 8u]), right),
        );
        if i == j {
            moved += ((step.inertia + step.mass_damping) * vertices[i].mass) * right;
        }
        sum += dot(left, moved);
    }
    blocks[place] = sum;
}
