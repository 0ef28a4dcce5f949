// Tangent blocks of elements in memory, row-major.

fn write_block(at: u32, m: mat3x3f) {
    for (var column = 0u; column < 3u; column += 1u) {
        let c = m[column];
        blocks[at + column] = c.x;
        blocks[at + 3u + column] = c.y;
        blocks[at + 6u + column] = c.z;
    }
}
