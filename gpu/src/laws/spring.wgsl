// Biquadratic springs: laws on changes of squared edge length. Twin of `sinew_models::element::spring`.

// |x_a - x_b|^2 - L^2 (m^2) from rest vector and relative displacement: nothing cancels.
fn squared_length_change(rest: vec3f, relative: vec3f) -> f32 {
    return dot(relative, rest + rest + relative);
}

fn tensile_energy(k: f32, delta: f32) -> f32 {
    return 0.25 * k * delta * delta;
}

fn tensile_tension(k: f32, delta: f32) -> f32 {
    return 0.5 * k * delta;
}

fn coupling_energy(c: f32, delta_e: f32, delta_f: f32) -> f32 {
    return 0.5 * c * delta_e * delta_f;
}

// What such a spring adds to the tensions of e and f (N/m).
fn coupling_tensions(c: f32, delta_e: f32, delta_f: f32) -> vec2f {
    return (0.5 * c) * vec2f(delta_f, delta_e);
}

// Minus the force on the first vertex of an edge x_a - x_b (N).
fn edge_pull(tension: f32, edge: vec3f) -> vec3f {
    return (tension + tension) * edge;
}
