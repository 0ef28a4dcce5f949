// Beside vertex_forces.wgsl: what the tangents of isotropic laws are made of.

// Blocks of R K0 R^T, K0 linear elasticity, from turned shape vectors.
fn warped(e: Element, d1: vec3f, d2: vec3f, d3: vec3f) -> array<mat3x3f, 6> {
    return array<mat3x3f, 6>(
        warped_block(e, d1, d1), warped_block(e, d2, d2), warped_block(e, d3, d3),
        warped_block(e, d1, d2), warped_block(e, d1, d3), warped_block(e, d2, d3),
    );
}

fn warped_block(e: Element, a: vec3f, b: vec3f) -> mat3x3f {
    return e.lambda * outer(a, b) + e.mu * (outer(b, a) + dot(a, b) * identity());
}

fn squares(m: mat3x3f) -> f32 {
    return dot(m[0], m[0]) + dot(m[1], m[1]) + dot(m[2], m[2]);
}
