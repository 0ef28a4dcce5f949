// Beside volumes.wgsl: the smallest volume ratio of a hexahedron.

fn smallest_ratio(i: u32) -> f32 {
    var smallest = LARGEST;
    for (var q = 0u; q < 8u; q += 1u) {
        smallest = min(smallest, volume_ratio(point(8u * i + q)));
    }
    return smallest;
}
