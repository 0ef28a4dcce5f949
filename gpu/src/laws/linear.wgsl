// Linear elasticity. Twin of `sinew_models::laws::linear`.

fn small_strain(g: mat3x3f) -> mat3x3f {
    return 0.5 * (g + transpose(g));
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    let strain = small_strain(g);
    let t = trace(strain);
    return 0.5 * e.lambda * t * t + e.mu * squares(strain);
}

fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    let strain = small_strain(g);
    return (e.lambda * trace(strain)) * identity() + (2.0 * e.mu) * strain;
}

// Constant and semidefinite: every kind is the same.
fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    return warped(e, e.d1, e.d2, e.d3);
}
