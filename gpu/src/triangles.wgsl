// Triangles, one thread each.

@group(1) @binding(1) var<storage, read> nodes: array<u32>;

const THREADS: u32 = 1u;

// Displacements of the vertices (m).
fn corners(i: u32) -> array<vec3f, 3> {
    return array<vec3f, 3>(
        displacement(nodes[3u * i]), displacement(nodes[3u * i + 1u]), displacement(nodes[3u * i + 2u]),
    );
}
