// Triangles to which rigid translations cost nothing: what acts on vertex 0 follows from the
// others. The law has
//   Element, ROWS, element_at(at, w)    an element from its constants and the displacements of vertices 1, 2
//                                       against vertex 0 (m); rows of constants
//   energy(e)                           energy (J)
//   vertex_forces(e)                    forces on vertices 1, 2 (N)
//   core(e, kind)                       tangent blocks of vertices 1, 2: 11 22 12 (N/m)

fn element(i: u32) -> Element {
    let u = corners(i);
    return element_at(ROWS * i, array<vec3f, 2>(u[1] - u[0], u[2] - u[0]));
}

fn energy_of(i: u32) -> f32 {
    return energy(element(i));
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let f = vertex_forces(element(i));
    slots[3u * i] = vec4f(-(f[0] + f[1]), 0.0);
    slots[3u * i + 1u] = vec4f(f[0], 0.0);
    slots[3u * i + 2u] = vec4f(f[1], 0.0);
}

fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let k = core(element(i), step.kind);
    let k01 = -1.0 * (k[0] + transpose(k[2]));
    let k02 = -1.0 * (k[2] + k[1]);
    let k00 = -0.5 * ((k01 + transpose(k01)) + (k02 + transpose(k02)));
    write_block(i, 6u, 0u, k00);
    write_block(i, 6u, 1u, k[0]);
    write_block(i, 6u, 2u, k[1]);
    write_block(i, 6u, 3u, k01);
    write_block(i, 6u, 4u, k02);
    write_block(i, 6u, 5u, k[2]);
}
