// Energies of a set of elements that has none for now, its law being silent; volume ratios of one that has none.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> rows: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(0) var<uniform> chunk: Chunk;

@compute @workgroup_size(256)
fn no_energies(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        sums[chunk.sums + group.x] = vec4f(0.0);
    }
}

@compute @workgroup_size(256)
fn no_volumes(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        sums[chunk.sums + group.x] = vec4f(LARGEST, 0.0, 0.0, 0.0);
    }
}
