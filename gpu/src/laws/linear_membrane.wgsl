// Constant-strain triangles in the plane of their rest shape. Twin of `sinew_models::element::membrane::linear`.

// First-order part of the change of the Gram matrix.
fn linear_change(e: Element) -> vec3f {
    return vec3f(2.0 * dot(e.w1, e.e1), 2.0 * dot(e.w2, e.e2), dot(e.w1, e.e2) + dot(e.w2, e.e1));
}

fn energy(e: Element) -> f32 {
    let c = linear_change(e);
    return elastic_energy(e, membrane_stress(e, dual(e), c), c);
}

fn vertex_forces(e: Element) -> array<vec3f, 2> {
    return nodal_forces(e, membrane_stress(e, dual(e), linear_change(e)), e.e1, e.e2);
}

fn core(e: Element, kind: u32) -> array<mat3x3f, 3> {
    return material_blocks(e, dual(e), e.e1, e.e2);
}
