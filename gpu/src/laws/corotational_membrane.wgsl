// Linear elasticity of the stretch U - I, with F = R U. Twin of `sinew_models::element::membrane::corotational`.

struct Polar {
    excess: f32,     // tr U - 2
    trace: f32,      // tr U
    inverse: f32,    // 1/J2
    strain: vec3f,   // U - I by vertex pair, upper indices (1/m^2)
    s: vec3f,        // second Piola-Kirchhoff stress (N/m^3)
}

// Tensor with its second index lowered.
fn mixed(e: Element, t: vec3f) -> mat2x2f {
    let aa = dot(e.e1, e.e1);
    let bb = dot(e.e2, e.e2);
    let ab = dot(e.e1, e.e2);
    // columns
    return mat2x2f(t.x * aa + t.z * ab, t.z * aa + t.y * ab, t.x * ab + t.z * bb, t.z * ab + t.y * bb);
}

fn polar(e: Element, d: vec3f) -> Polar {
    let c = gram_change(e);
    // tr C - 2, det C - 1 and what follows, without taking 1 from a number near 1
    let dt = contract(d, c);
    let area = squared_area(e, d, c);
    let j = sqrt(area.y);
    let dj = area.x / (1.0 + j);
    let trace = sqrt(max(2.0 + 2.0 + dt + dj + dj, 1e-12));
    let excess = (dt + dj + dj) / (trace + 2.0);
    // (d c d + k d)/t
    let strain = (1.0 / trace) * (raise(d, c) + (dj - excess) * d);
    let t = (2.0 * e.mu) * strain + (e.lambda * excess) * d;
    // S = U^-1 T with U^-1 = ((t - 1) I - (U - I))/J2
    let v = mixed(e, strain);
    let inverse = 1.0 / max(j, 1e-6);
    let rest = 1.0 + excess;
    let s = inverse * vec3f(
        rest * t.x - (v[0].x * t.x + v[1].x * t.z),
        rest * t.y - (v[0].y * t.z + v[1].y * t.y),
        rest * t.z - (v[0].x * t.z + v[1].x * t.y),
    );
    return Polar(excess, trace, inverse, strain, s);
}

fn energy(e: Element) -> f32 {
    let p = polar(e, dual(e));
    let v = mixed(e, p.strain);
    let squares = v[0].x * v[0].x + v[1].y * v[1].y + 2.0 * v[1].x * v[0].y;
    return e.area * (e.mu * squares + 0.5 * e.lambda * p.excess * p.excess);
}

fn vertex_forces(e: Element) -> array<vec3f, 2> {
    return nodal_forces(e, polar(e, dual(e)).s, e.e1 + e.w1, e.e2 + e.w2);
}

// The linear stiffness turned by R, which alone is the Gauss-Newton tangent; the rotation in the plane; and the
// stress against motion along the normal. The projected tangent clamps the last two at zero.
fn core(e: Element, kind: u32) -> array<mat3x3f, 3> {
    let d = dual(e);
    let p = polar(e, d);
    let x1 = e.e1 + e.w1;
    let x2 = e.e2 + e.w2;
    // rest edges turned by R: R E_a = F U^-1 E_a = x_b (U^-1)^b_a
    let v = mixed(e, p.strain);
    let rest = 1.0 + p.excess;
    let turned1 = p.inverse * ((rest - v[0].x) * x1 - v[0].y * x2);
    let turned2 = p.inverse * ((rest - v[1].y) * x2 - v[1].x * x1);
    var k = material_blocks(e, d, turned1, turned2);
    if kind == 1u {
        return k;
    }
    // derivative of the energy density by the rotation in the plane (N/m)
    var curvature = 2.0 * (e.lambda + e.mu) * p.excess / p.trace;
    var s = p.s;
    if kind == 2u {
        s = tensile_part(e, d, s);
        curvature = max(curvature, 0.0);
    }
    // the normal over the rest area: its length is the ratio of the areas
    let unit = 1.0 / (2.0 * e.area);
    let normal = unit * cross(x1, x2);
    let across = (e.area / max(dot(normal, normal), 2.5e-25)) * outer(normal, normal);
    // dF = R spin/sqrt 2: n x R D_a is a rest edge over 2 A, turned
    let arm1 = unit * turned2;
    let arm2 = -unit * turned1;
    let c = 0.5 * curvature * e.area;
    k[0] += s.x * across + c * outer(arm1, arm1);
    k[1] += s.y * across + c * outer(arm2, arm2);
    k[2] += s.z * across + c * outer(arm1, arm2);
    return k;
}
