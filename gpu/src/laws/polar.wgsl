// Polar decomposition F = R S, and energy and stress of the corotational laws. Twin of `sinew_models::laws::corotational`,
// with the rotation from the signed singular value decomposition.

struct Polar {
    rotation: mat3x3f,
    strain: mat3x3f,    // e = S - I
}

fn polar(g: mat3x3f) -> Polar {
    let f = identity() + g;
    let svd = signed_svd(f);
    let rotation = svd.u * transpose(svd.v);
    let product = transpose(rotation) * f;
    let s = 0.5 * (product + transpose(product));
    var strain = s - identity();
    // (S + I) e = 2 E keeps its digits where S - I would cancel; a mirrored element has none either, but there
    // S + I is singular
    let green = green_strain(g);
    let size = max(max(max(abs(green[0].x), abs(green[1].y)), abs(green[2].z)), max(max(abs(green[0].y), abs(green[0].z)), abs(green[1].z)));
    if volume_change(g) > -0.5 && size < 0.05 {
        let sum = s + identity();
        let adjugate = cofactor_matrix(sum);
        let near = (2.0 / dot(sum[0], adjugate[0])) * (green * adjugate);
        strain = 0.5 * (near + transpose(near));
    }
    return Polar(rotation, strain);
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    let strain = polar(g).strain;
    let t = trace(strain);
    return 0.5 * e.lambda * t * t + e.mu * squares(strain);
}

fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    let p = polar(g);
    return p.rotation * ((e.lambda * trace(p.strain)) * identity() + (2.0 * e.mu) * p.strain);
}
