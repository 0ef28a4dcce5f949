// Edges, one thread each. The law has
//   energy(e)           energy (J)
//   pull(e)             tension times deformed edge: minus the force on vertex a, the force on vertex b (N)
//   block(e, kind)      tangent block of either vertex; that of the pair is its negative (N/m)

@group(1) @binding(1) var<storage, read> nodes: array<vec2u>;

const THREADS: u32 = 1u;

// Constants are one row of 16 bytes: rest vector X_a - X_b (m), stiffness k (N/m^3).
struct Edge {
    rest: vec3f,
    k: f32,
    relative: vec3f,    // u_a - u_b (m)
}

fn edge(i: u32) -> Edge {
    let v = nodes[i];
    let constants = data[i];
    return Edge(constants.xyz, constants.w, displacement(v.x) - displacement(v.y));
}

fn energy_of(i: u32) -> f32 {
    return energy(edge(i));
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let own = pull(edge(i));
    slots[2u * i] = vec4f(-own, 0.0);
    slots[2u * i + 1u] = vec4f(own, 0.0);
}

fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let m = block(edge(i), step.kind);
    write_block(i, 3u, 0u, m);
    write_block(i, 3u, 1u, m);
    write_block(i, 3u, 2u, -1.0 * m);
}
