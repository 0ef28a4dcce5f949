// Single fibres, passive and active. Twin of `sinew_models::axes::element::Fibre`. Constants are 3 rows of 16
// bytes: q_1 q_2 q_3 (1/m) with q_b = a.D_b and V Y (J), a and 1 - r, V T a (J) and 1 - l_opt and 1/w.

struct Element {
    w: mat3x3f,
    shape: vec3f,
    axis: vec3f,
    stiffness: f32,
    shortening: f32,
    activated: f32,
    offset: f32,
    inverse_width: f32,
}

const ROWS: u32 = 3u;

fn element_at(at: u32, w: mat3x3f) -> Element {
    let q = data[at];
    let a = data[at + 1u];
    let c = data[at + 2u];
    return Element(w, q.xyz, a.xyz, q.w, a.w, c.x, c.y, c.z);
}

// The displacement gradient along the fibre is all that it knows: G a.
fn displacement_gradient(e: Element) -> vec3f {
    return e.w * e.shape;
}

// (l - l_opt)/w, held within -1 and 1.
fn place(e: Element, stretch: f32) -> f32 {
    return clamp((stretch + e.offset) * e.inverse_width, -1.0, 1.0);
}

// dW/dl and its derivative (J).
fn tension(e: Element, stretch: f32) -> vec2f {
    let x = place(e, stretch);
    // at the ends of the curve its slope jumps to 0
    let slope = select(0.0, 2.0 * x * e.inverse_width, abs(x) < 1.0);
    return vec2f(
        (1.0 - x * x) * e.activated + e.stiffness * (stretch + e.shortening), e.stiffness - e.activated * slope,
    );
}

fn energy(e: Element, h: vec3f) -> f32 {
    let stretch = chord(e.axis, h).stretch;
    let way = stretch + e.shortening;
    let x = place(e, stretch);
    let rest = place(e, 0.0);
    // within the curve the difference of the places needs no subtraction
    let inside = abs(x) < 1.0 && abs(rest) < 1.0;
    let moved = select((x - rest) / e.inverse_width, stretch, inside);
    let phi = moved * (1.0 - (x * x + x * rest + rest * rest) / 3.0);
    return 0.5 * e.stiffness * way * way + e.activated * phi;
}

fn vertex_forces(e: Element, h: vec3f) -> mat3x3f {
    let c = chord(e.axis, h);
    return outer(-tension(e, c.stretch).x * c.direction, e.shape);
}

fn core(e: Element, h: vec3f, kind: u32) -> array<mat3x3f, 6> {
    let c = chord(e.axis, h);
    let t = tension(e, c.stretch);
    var along = t.y;
    var across = t.x * c.inverse;
    if kind != 0u {
        along = max(along, 0.0);
        across = select(0.0, max(across, 0.0), kind == 2u);
    }
    let m = chord_stiffness(c, along, across);
    let q = e.shape;
    return array<mat3x3f, 6>(
        (q.x * q.x) * m, (q.y * q.y) * m, (q.z * q.z) * m, (q.x * q.y) * m, (q.x * q.z) * m, (q.y * q.z) * m,
    );
}
