// Springs on edges. Twin of `sinew_models::quadratic::MassSpring`, frame included: elements are edges.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(1) var<storage, read> nodes: array<vec2u>;
// one row of 16 bytes: rest vector x_a - x_b (m), stiffness k (N/m^3)
@group(1) @binding(2) var<storage, read> data: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> slots: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> blocks: array<f32>;

fn edge(index: u32) -> Stretch {
    let v = nodes[index];
    return stretch(data[index].xyz, rows[Y * step.n + v.x].xyz - rows[Y * step.n + v.y].xyz);
}

@compute @workgroup_size(256)
fn energies(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var own = 0.0;
    for (var i = group.x * GROUP + local; i < chunk.count; i += groups.x * GROUP) {
        let change = edge(i).change;
        own += 0.25 * data[i].w * change * change;
    }
    let sum = group_sum(local, vec4f(own, 0.0, 0.0, 0.0));
    if local == 0u {
        sums[chunk.sums + group.x] = sum;
    }
}

@compute @workgroup_size(256)
fn forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.count { return; }
    let s = edge(i);
    let pull = (s.slope * 0.5 * data[i].w * s.change) * s.edge;
    slots[2u * i] = vec4f(-pull, 0.0);
    slots[2u * i + 1u] = vec4f(pull, 0.0);
}

// Blocks 00 11 01.
@compute @workgroup_size(256)
fn tangents(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.count { return; }
    let s = edge(i);
    // identified constants may be negative
    var along = data[i].w;
    var tension = 0.5 * along * s.change;
    if step.kind == 1u {
        tension = 0.0;
        along = max(along, 0.0);
    } else if step.kind == 2u {
        tension = max(tension, 0.0);
        along = max(along, 0.0);
    }
    let z = s.slope * s.edge;
    let m = (0.5 * along) * outer(z, z)
        + (s.slope * tension) * (identity() - s.inverse_square * outer(s.edge, s.edge));
    let at = 27u * i;
    write_block(at, m);
    write_block(at + 9u, m);
    write_block(at + 18u, -1.0 * m);
}
