// Forces on vertices: the slots of the elements round each vertex, added in the order of the elements.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(1) var<storage, read> slots: array<vec4f>;
@group(1) @binding(2) var<storage, read> starts: array<u32>;
@group(1) @binding(3) var<storage, read> sources: array<u32>;

fn sum_of_slots(i: u32, before: vec4f) -> vec4f {
    var f = before;
    let end = starts[i + 1u];
    for (var k = starts[i]; k < end; k += 1u) {
        f += vec4f(slots[sources[k]].xyz, 0.0);
    }
    return f;
}

// The first chunk of a pass overwrites,
@compute @workgroup_size(256)
fn gather_forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    rows[FORCE * step.n + i] = sum_of_slots(i, vec4f(0.0));
}

// the others add,
@compute @workgroup_size(256)
fn add_forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    rows[FORCE * step.n + i] = sum_of_slots(i, rows[FORCE * step.n + i]);
}

// and where no law acts there is nothing.
@compute @workgroup_size(256)
fn no_forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    rows[FORCE * step.n + i] = vec4f(0.0);
}

// Sums of the blocks of rows, likewise: the first chunk overwrites,
@compute @workgroup_size(256)
fn gather_row_sums(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    rows[ROW_SUM * step.n + i] = sum_of_slots(i, vec4f(0.0));
}

// the others add.
@compute @workgroup_size(256)
fn add_row_sums(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let i = flat_index(group, groups, local);
    if i >= chunk.rows { return; }
    rows[ROW_SUM * step.n + i] = sum_of_slots(i, rows[ROW_SUM * step.n + i]);
}
