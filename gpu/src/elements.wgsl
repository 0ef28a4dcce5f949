// Frame of the passes over a set of elements of one law. The kind of element adds a file with
//   nodes               binding 1 of group 1: vertex rows of the elements
//   THREADS             threads that share an element
//   energy_of(t)        energy (J) that thread t finds
//   write_forces(t)     forces at Y (N), into the slots of the element's vertices
//   write_tangents(t)   tangent blocks (N/m), into the places of the element: those of its vertices, then those of
//                       its pairs of vertices in the order 01 02 .. 12 ..
// where t counts the threads of all elements of the chunk, and the law one with what the kind asks for. Only the
// last two are called beyond the last element.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;
@group(1) @binding(2) var<storage, read> data: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> slots: array<vec4f>;
@group(1) @binding(4) var<storage, read_write> blocks: array<f32>;

// Displacement (m) of a vertex row where laws are evaluated.
fn displacement(row: u32) -> vec3f {
    return rows[Y * step.n + row].xyz;
}

// Energy of the chunk at Y, one partial sum per workgroup.
@compute @workgroup_size(256)
fn energies(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var own = 0.0;
    for (var t = group.x * GROUP + local; t < THREADS * chunk.count; t += groups.x * GROUP) {
        own += energy_of(t);
    }
    let sum = group_sum(local, vec4f(own, 0.0, 0.0, 0.0));
    if local == 0u {
        sums[chunk.sums + group.x] = sum;
    }
}

@compute @workgroup_size(256)
fn forces(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    write_forces(flat_index(group, groups, local));
}

@compute @workgroup_size(256)
fn tangents(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    write_tangents(flat_index(group, groups, local));
}

// Block of place `place` of an element with `count` blocks, row-major in memory.
fn write_block(element: u32, count: u32, place: u32, m: mat3x3f) {
    let at = 9u * (count * element + place);
    for (var column = 0u; column < 3u; column += 1u) {
        let c = m[column];
        blocks[at + column] = c.x;
        blocks[at + 3u + column] = c.y;
        blocks[at + 6u + column] = c.z;
    }
}
