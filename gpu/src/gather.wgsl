// Forces on vertices: the slots of the elements round each vertex, added in the order of the elements.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(1) var<storage, read> slots: array<vec4f>;
@group(1) @binding(2) var<storage, read> starts: array<u32>;
@group(1) @binding(3) var<storage, read> sources: array<u32>;

@compute @workgroup_size(256)
fn gather_forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    var f = vec4f(0.0);
    if chunk.accumulate == 1u {
        f = rows[FORCE * step.n + i];
    }
    let end = starts[i + 1u];
    for (var k = starts[i]; k < end; k += 1u) {
        f += vec4f(slots[sources[k]].xyz, 0.0);
    }
    rows[FORCE * step.n + i] = f;
}
