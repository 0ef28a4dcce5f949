// Biquadratic springs (TRBS) with the compression term where its modulus is not 0. Twin of
// `sinew_models::element::membrane::biquadratic`.

// Area ratio J2 below which it is continued by a parabola.
const FLAT: f32 = 1e-3;

struct Compressed {
    m: f32,           // min(J2 - 1, 0)
    inverse: f32,     // 1/J2, bounded
    is_flat: bool,       // J2 is so small that it is continued
}

fn compressed(e: Element, d: vec3f, c: vec3f) -> Compressed {
    let area = squared_area(e, d, c);
    let square = area.y;
    let ratio = sqrt(square);
    let is_flat = ratio < FLAT;
    // near 1 without cancellation; when flat, J2 = (J2^2/f + f)/2
    let m = select(area.x / (ratio + 1.0), 0.5 / FLAT * square + (0.5 * FLAT - 1.0), is_flat);
    return Compressed(min(m, 0.0), 1.0 / max(ratio, FLAT), is_flat);
}

// Derivative of J2^2 by the Gram matrix (1/m^2).
fn adjugate(e: Element, x1: vec3f, x2: vec3f) -> vec3f {
    return inverse_determinant(e) * vec3f(dot(x2, x2), dot(x1, x1), -dot(x1, x2));
}

fn energy(e: Element) -> f32 {
    let d = dual(e);
    let c = gram_change(e);
    let m = compressed(e, d, c).m;
    return elastic_energy(e, membrane_stress(e, d, c), c) + 0.5 * e.area * e.compression * (m * m) * (m * m);
}

fn vertex_forces(e: Element) -> array<vec3f, 2> {
    let d = dual(e);
    let c = gram_change(e);
    let x1 = e.e1 + e.w1;
    let x2 = e.e2 + e.w2;
    let state = compressed(e, d, c);
    let p1 = 2.0 * e.compression * (state.m * state.m * state.m) * state.inverse;
    return nodal_forces(e, membrane_stress(e, d, c) + p1 * adjugate(e, x1, x2), x1, x2);
}

fn core(e: Element, kind: u32) -> array<mat3x3f, 3> {
    let d = dual(e);
    let c = gram_change(e);
    let x1 = e.e1 + e.w1;
    let x2 = e.e2 + e.w2;
    var k = material_blocks(e, d, x1, x2);
    // what multiplies the identity in the blocks 11, 22, 12
    var tension = vec3f(0.0);
    if kind != 1u {
        tension = membrane_stress(e, d, c);
        if kind == 2u {
            tension = tensile_part(e, d, tension);
        }
    }
    if e.compression > 0.0 {
        let state = compressed(e, d, c);
        let m = state.m;
        let q = adjugate(e, x1, x2);
        let g1 = state.inverse * (q.x * x1 + q.z * x2);
        let g2 = state.inverse * (q.z * x1 + q.y * x2);
        let kappa = e.compression * e.area;
        let p1 = 2.0 * kappa * (m * m * m) * state.inverse;
        var p2 = 6.0 * kappa * (m * m);
        if kind == 0u {
            // the second derivative of the square root
            p2 -= select(p1, 0.0, state.is_flat);
            tension += (p1 / e.area) * q;
            let p = p1 * inverse_determinant(e);
            k[0] -= p * outer(x2, x2);
            k[1] -= p * outer(x1, x1);
            k[2] += p * (2.0 * outer(x1, x2) - outer(x2, x1));
        }
        k[0] += p2 * outer(g1, g1);
        k[1] += p2 * outer(g2, g2);
        k[2] += p2 * outer(g1, g2);
    }
    k[0] += (e.area * tension.x) * identity();
    k[1] += (e.area * tension.y) * identity();
    k[2] += (e.area * tension.z) * identity();
    return k;
}
