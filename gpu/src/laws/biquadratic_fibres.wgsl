// Biquadratic fibres. Twin of `sinew_models::axes::element::BiquadraticFibre`. Constants are 2 rows of 16 bytes:
// q_1 q_2 q_3 (1/m) with q_b = a.D_b and V Y (J), a.

struct Element {
    w: mat3x3f,
    shape: vec3f,
    axis: vec3f,
    stiffness: f32,
}

const ROWS: u32 = 2u;

fn element_at(at: u32, w: mat3x3f) -> Element {
    let q = data[at];
    return Element(w, q.xyz, data[at + 1u].xyz, q.w);
}

// The displacement gradient along the fibre is all that it knows: G a.
fn displacement_gradient(e: Element) -> vec3f {
    return e.w * e.shape;
}

// a.E a.
fn strain(e: Element, h: vec3f) -> f32 {
    return 0.5 * dot(h, e.axis + (e.axis + h));
}

fn energy(e: Element, h: vec3f) -> f32 {
    let s = strain(e, h);
    return 0.5 * e.stiffness * s * s;
}

fn vertex_forces(e: Element, h: vec3f) -> mat3x3f {
    return outer(-(e.stiffness * strain(e, h)) * (e.axis + h), e.shape);
}

fn core(e: Element, h: vec3f, kind: u32) -> array<mat3x3f, 6> {
    let s = strain(e, h);
    let p = e.axis + h;
    var along = e.stiffness;
    var across = e.stiffness * s;
    if kind != 0u {
        across = select(0.0, max(across, 0.0), kind == 2u);
    }
    if kind == 2u && s < 0.0 {
        // all that is left lies along p
        along *= max(3.0 * s + 1.0, 0.0) / max(2.0 * s + 1.0, 1.0 / 3.0);
    }
    let m = outer(along * p, p) + across * identity();
    let q = e.shape;
    return array<mat3x3f, 6>(
        (q.x * q.x) * m, (q.y * q.y) * m, (q.z * q.z) * m, (q.x * q.y) * m, (q.x * q.z) * m, (q.y * q.z) * m,
    );
}
