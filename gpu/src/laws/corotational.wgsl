// Corotational elasticity. Twin of `sinew_models::laws::corotational`.

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let p = polar(g);
    let r = p.rotation;
    let d1 = r * e.d1;
    let d2 = r * e.d2;
    let d3 = r * e.d3;
    if kind == 1u {
        return warped(e, d1, d2, d3);
    }
    let t = trace(p.strain);
    let c = e.lambda * t - 2.0 * e.mu;
    // tr(S) I - R S R^T
    let turned = r * p.strain * transpose(r);
    let sums = (2.0 + t) * identity() - 0.5 * (turned + transpose(turned));
    let h = turning(e, c, sums, kind);
    var blocks = array<mat3x3f, 6>();
    blocks[0] = symmetric(block(e, c, h, e.d1, e.d1, d1, d1));
    blocks[1] = symmetric(block(e, c, h, e.d2, e.d2, d2, d2));
    blocks[2] = symmetric(block(e, c, h, e.d3, e.d3, d3, d3));
    blocks[3] = block(e, c, h, e.d1, e.d2, d1, d2);
    blocks[4] = block(e, c, h, e.d1, e.d3, d1, d3);
    blocks[5] = block(e, c, h, e.d2, e.d3, d2, d3);
    return blocks;
}

fn symmetric(m: mat3x3f) -> mat3x3f {
    return 0.5 * (m + transpose(m));
}

// Block of the vertices with shape vectors da and db, turned ra and rb.
fn block(e: Element, c: f32, h: mat3x3f, da: vec3f, db: vec3f, ra: vec3f, rb: vec3f) -> mat3x3f {
    return (2.0 * e.mu * dot(da, db)) * identity() + e.lambda * outer(ra, rb) - c * (skew(ra) * h * skew(rb));
}

// (tr(S) I - R S R^T)^-1, kept finite; for the projected tangent with the eigenvalues that make it indefinite raised.
fn turning(e: Element, c: f32, sums: mat3x3f, kind: u32) -> mat3x3f {
    if kind == 2u && c < 0.0 && e.mu > 0.0 {
        let least = -c / e.mu;
        let slack = 64.0 * 1.1920929e-7 * least;
        if !is_definite(sums - (least - slack) * identity()) {
            let eigen = symmetric_eigen(sums);
            let v = eigen.vectors;
            let x = max(eigen.values, vec3f(least));
            return (1.0 / x.x) * outer(v[0], v[0]) + (1.0 / x.y) * outer(v[1], v[1]) + (1.0 / x.z) * outer(v[2], v[2]);
        }
    }
    let adjugate = cofactor_matrix(sums);
    let size = max(abs(sums[0].x), max(abs(sums[1].y), abs(sums[2].z)));
    let floor = max(1e-6 * size * size * size, 1e-30);
    return (1.0 / max(dot(sums[0], adjugate[0]), floor)) * adjugate;
}

// Leading minors all positive.
fn is_definite(a: mat3x3f) -> bool {
    return a[0].x > 0.0 && a[0].x * a[1].y - a[0].y * a[1].x > 0.0 && determinant(a) > 0.0;
}
