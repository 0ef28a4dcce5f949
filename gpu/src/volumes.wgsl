// Volume ratios of elements whose kind has
//   smallest_ratio(i)   smallest J of element i, over its Gauss points if it has several

// Smallest J of the chunk at Y and the number of elements with J <= 0 somewhere, one of each per workgroup, where
// energies leave their sums.
@compute @workgroup_size(256)
fn volumes(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    var smallest = LARGEST;
    var inverted = 0.0;
    for (var i = group.x * GROUP + local; i < chunk.count; i += groups.x * GROUP) {
        let j = smallest_ratio(i);
        smallest = min(smallest, j);
        inverted += f32(j <= 0.0);
    }
    let count = group_sum(local, vec4f(inverted, 0.0, 0.0, 0.0)).x;
    let least = group_min(local, smallest);
    if local == 0u {
        sums[chunk.sums + group.x] = vec4f(least, count, 0.0, 0.0);
    }
}

fn volume_ratio(e: Element) -> f32 {
    return 1.0 + volume_change(displacement_gradient(e));
}
