// Elements of four vertices to which rigid translations cost nothing: what acts on vertex 0 follows from the others.

// Forces on vertices 1, 2, 3 in the columns.
fn write_tetrahedron_forces(i: u32, f: mat3x3f) {
    slots[4u * i] = vec4f(-(f[0] + f[1] + f[2]), 0.0);
    slots[4u * i + 1u] = vec4f(f[0], 0.0);
    slots[4u * i + 2u] = vec4f(f[1], 0.0);
    slots[4u * i + 3u] = vec4f(f[2], 0.0);
}

// Blocks of vertices 1, 2, 3: 11 22 33 12 13 23.
fn write_tetrahedron_blocks(i: u32, k: array<mat3x3f, 6>) {
    let k01 = -1.0 * (k[0] + transpose(k[3]) + transpose(k[4]));
    let k02 = -1.0 * (k[3] + k[1] + transpose(k[5]));
    let k03 = -1.0 * (k[4] + k[5] + k[2]);
    let k00 = -0.5 * ((k01 + transpose(k01)) + (k02 + transpose(k02)) + (k03 + transpose(k03)));
    write_block(i, 10u, 0u, k00);
    write_block(i, 10u, 1u, k[0]);
    write_block(i, 10u, 2u, k[1]);
    write_block(i, 10u, 3u, k[2]);
    write_block(i, 10u, 4u, k01);
    write_block(i, 10u, 5u, k02);
    write_block(i, 10u, 6u, k03);
    write_block(i, 10u, 7u, k[3]);
    write_block(i, 10u, 8u, k[4]);
    write_block(i, 10u, 9u, k[5]);
}
