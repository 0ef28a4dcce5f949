// What the laws of membrane triangles share. Twin of `sinew_models::element::membrane`: see there for the mathematics.
// Constants are 3 rows of 16 bytes: E_1 (m) and lambda (N/m), E_2 and mu, rest area A (m^2) and kappa (N/m).

struct Element {
    w1: vec3f,           // displacements of vertices 1, 2 against vertex 0 (m)
    w2: vec3f,
    e1: vec3f,           // rest edges (m)
    e2: vec3f,
    area: f32,
    lambda: f32,
    mu: f32,
    compression: f32,
}

// A symmetric tensor by edge pair is a vector of its entries 11, 22, 12.

const ROWS: u32 = 3u;

fn element_at(at: u32, w: array<vec3f, 2>) -> Element {
    let a = data[at];
    let b = data[at + 1u];
    let c = data[at + 2u];
    return Element(w[0], w[1], a.xyz, b.xyz, c.x, a.w, b.w, c.y);
}

// 1/(4 A^2), one over the determinant of the rest Gram matrix (1/m^4).
fn inverse_determinant(e: Element) -> f32 {
    let inverse = 1.0 / (2.0 * e.area);
    return inverse * inverse;
}

// d, the inverse of the rest Gram matrix (1/m^2).
fn dual(e: Element) -> vec3f {
    return inverse_determinant(e) * vec3f(dot(e.e2, e.e2), dot(e.e1, e.e1), -dot(e.e1, e.e2));
}

// Change of the Gram matrix (m^2).
fn gram_change(e: Element) -> vec3f {
    let x1 = e.e1 + e.w1;
    return vec3f(
        dot(e.w1, e.e1 + x1), dot(e.w2, e.e2 + (e.e2 + e.w2)), dot(e.w1, e.e2) + dot(x1, e.w2),
    );
}

fn minor(t: vec3f) -> f32 {
    return t.x * t.y - t.z * t.z;
}

// d^ab c_ab.
fn contract(d: vec3f, c: vec3f) -> f32 {
    return d.x * c.x + d.y * c.y + 2.0 * d.z * c.z;
}

// Change of J2^2, J2 the ratio of the areas, and J2^2.
fn squared_area(e: Element, d: vec3f, c: vec3f) -> vec2f {
    let change = inverse_determinant(e) * minor(c) + contract(d, c);
    if change > -0.75 {
        return vec2f(change, 1.0 + change);
    }
    // in a much smaller triangle the sum cancels, the normal does not
    let normal = 1.0 / (2.0 * e.area) * cross(e.e1 + e.w1, e.e2 + e.w2);
    let square = dot(normal, normal);
    return vec2f(square - 1.0, square);
}

// d c d.
fn raise(d: vec3f, c: vec3f) -> vec3f {
    let m11 = d.x * c.x + d.z * c.z;
    let m12 = d.x * c.z + d.z * c.y;
    let m21 = d.z * c.x + d.y * c.z;
    let m22 = d.z * c.z + d.y * c.y;
    return vec3f(m11 * d.x + m12 * d.z, m22 * d.y + m21 * d.z, m11 * d.z + m12 * d.y);
}

// S of a change c (N/m^3).
fn membrane_stress(e: Element, d: vec3f, c: vec3f) -> vec3f {
    return (0.5 * e.lambda * contract(d, c)) * d + e.mu * raise(d, c);
}

// A/4 S^ab c_ab (J).
fn elastic_energy(e: Element, s: vec3f, c: vec3f) -> f32 {
    return 0.25 * e.area * contract(s, c);
}

// f_a = -A S^ab x_b (N).
fn nodal_forces(e: Element, s: vec3f, x1: vec3f, x2: vec3f) -> array<vec3f, 2> {
    return array<vec3f, 2>(-e.area * (s.x * x1 + s.z * x2), -e.area * (s.z * x1 + s.y * x2));
}

// A (lambda y_a y_b^T + mu (d^ab F F^T + y_b y_a^T)).
fn material_blocks(e: Element, d: vec3f, x1: vec3f, x2: vec3f) -> array<mat3x3f, 3> {
    let y1 = d.x * x1 + d.z * x2;
    let y2 = d.z * x1 + d.y * x2;
    let left = outer(x1, y1) + outer(x2, y2);
    let lambda = e.area * e.lambda;
    let mu = e.area * e.mu;
    return array<mat3x3f, 3>(
        (lambda + mu) * outer(y1, y1) + (mu * d.x) * left,
        (lambda + mu) * outer(y2, y2) + (mu * d.y) * left,
        lambda * outer(y1, y2) + mu * outer(y2, y1) + (mu * d.z) * left,
    );
}

// Principal stresses (N/m), larger first: eigenvalues of the mixed tensor S^ac G_cb.
fn principal_stresses(e: Element, s: vec3f) -> vec2f {
    let mean = 0.5 * contract(s, vec3f(dot(e.e1, e.e1), dot(e.e2, e.e2), dot(e.e1, e.e2)));
    let radius = sqrt(max(mean * mean - minor(s) * (4.0 * e.area * e.area), 0.0));
    return vec2f(mean + radius, mean - radius);
}

// S with its compressive principal stresses set to zero.
fn tensile_part(e: Element, d: vec3f, s: vec3f) -> vec3f {
    let principal = principal_stresses(e, s);
    if principal.y >= 0.0 {
        return s;
    }
    if principal.x <= 0.0 {
        return vec3f(0.0);
    }
    // one tensile: S+ = high (S - low I)/(high - low); I has the components d
    return (principal.x / (principal.x - principal.y)) * (s - principal.y * d);
}
