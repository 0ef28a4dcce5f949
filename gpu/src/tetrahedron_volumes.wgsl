// Beside volumes.wgsl: the volume ratio of a tetrahedron.

fn smallest_ratio(i: u32) -> f32 {
    return volume_ratio(element(i));
}
