// From blocks of elements to the block matrix.

struct Gather {
    entries: u32,   // blocks of the part of the matrix
    padding: u32,
    more: vec2u,
}

@group(0) @binding(0) var<uniform> gather: Gather;
@group(0) @binding(1) var<storage, read> blocks: array<f32>;
@group(0) @binding(2) var<storage, read> starts: array<u32>;
@group(0) @binding(3) var<storage, read> sources: array<u32>;
@group(0) @binding(4) var<storage, read_write> values: array<f32>;

const TRANSPOSED: u32 = 0x80000000u;

// Every number of the matrix is the sum of the numbers that elements have for it, in the order of the elements. What
// earlier chunks brought comes first, so that the sum does not depend on how elements are cut.
fn sum_of_blocks(place: u32, before: f32) -> f32 {
    let entry = place / 9u;
    let x = place - 9u * entry;
    let mirrored = 3u * (x % 3u) + x / 3u;
    var sum = before;
    let end = starts[entry + 1u];
    for (var k = starts[entry]; k < end; k += 1u) {
        let source = sources[k];
        let own = select(x, mirrored, (source & TRANSPOSED) != 0u);
        sum += blocks[9u * (source & ~TRANSPOSED) + own];
    }
    return sum;
}

// The first chunk of a pass overwrites,
@compute @workgroup_size(256)
fn gather_blocks(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    if place >= 9u * gather.entries { return; }
    values[place] = sum_of_blocks(place, 0.0);
}

// the others add,
@compute @workgroup_size(256)
fn add_blocks(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    if place >= 9u * gather.entries { return; }
    values[place] = sum_of_blocks(place, values[place]);
}

// and where no law acts there is nothing.
@compute @workgroup_size(256)
fn no_blocks(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let place = flat_index(group, groups, local);
    if place >= 9u * gather.entries { return; }
    values[place] = 0.0;
}
