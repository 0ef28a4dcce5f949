// Stable neo-Hookean elasticity. Twin of `sinew_models::laws::neo_hookean`.

fn bulk(e: Element) -> f32 {
    return e.lambda + 5.0 / 6.0 * e.mu;
}

// 2 artanh(t) - 2 t.
fn series(t: f32) -> f32 {
    let t2 = t * t;
    var sum = 0.0;
    for (var n = 12u; n > 0u; n -= 1u) {
        sum = sum * t2 + 2.0 / f32(2u * n + 1u);
    }
    return sum * t2 * t;
}

// x - log(1 + x) without cancellation at small x.
fn excess_over_logarithm(x: f32) -> f32 {
    if abs(x) < 0.4 {
        let t = x / (x + 2.0);
        return x * t - series(t);
    }
    return x - log(max(1.0 + x, 1e-30));
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    let m = volume_change(g);
    let s = green_strain(g);
    let q = 2.0 * trace(s);
    // q - 2 (J - 1): both are of first order in the strain, the difference is not
    let c = cofactor_matrix(s);
    let r = 8.0 * dot(s[0], c[0]) + 4.0 * trace(c);
    var shape = q - 2.0 * m;
    if m > -0.5 {
        shape = (q * m - 2.0 * r) / (2.0 + m);
    }
    let excess = 2.0 / 3.0 * excess_over_logarithm(0.25 * q);
    return 0.5 * bulk(e) * m * m + e.mu * (0.5 * shape + excess);
}

fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    let q = 2.0 * trace(green_strain(g));
    // F - cof F
    let deviation = g + transpose(g) - trace(g) * identity() - cofactor_matrix(g);
    let pull = e.mu * q / (3.0 * (4.0 + q));
    return (bulk(e) * volume_change(g)) * cofactor(g) + pull * (identity() + g) + e.mu * deviation;
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let f = identity() + g;
    let q = 2.0 * trace(green_strain(g));
    let inverse = 1.0 / (4.0 + q);
    let a = e.mu + e.mu * q * inverse / 3.0;
    let b = 8.0 / 3.0 * e.mu * inverse * inverse;
    let l = bulk(e);
    let p = l * volume_change(g) - e.mu;
    if kind != 0u && e.mu > 0.0 {
        return projected(e, f, a, b, l, p);
    }
    let cof = cofactor(g);
    let d = array<vec3f, 3>(e.d1, e.d2, e.d3);
    var blocks = array<mat3x3f, 6>();
    for (var n = 0u; n < 6u; n += 1u) {
        let da = d[FIRST[n]];
        let db = d[SECOND[n]];
        blocks[n] = (a * dot(da, db)) * identity() + b * outer(f * da, f * db) + l * outer(cof * da, cof * db)
            + p * skew(f * cross(db, da));
    }
    return blocks;
}

fn projected(e: Element, f: mat3x3f, a: f32, b: f32, l: f32, p: f32) -> array<mat3x3f, 6> {
    let svd = signed_svd(f);
    let s = svd.s;
    let c = vec3f(s.y * s.z, s.x * s.z, s.x * s.y);
    var spectrum = Spectrum();
    var largest = 0.0;
    for (var i = 0u; i < 3u; i += 1u) {
        for (var j = 0u; j < 3u; j += 1u) {
            var own = a;
            if i != j {
                own = p * s[3u - i - j];
            }
            let entry = b * s[i] * s[j] + l * c[i] * c[j] + own;
            spectrum.stretches[j][i] = entry;
            largest = max(largest, abs(entry));
        }
        spectrum.plus[i] = a - p * s[i];
        spectrum.minus[i] = a + p * s[i];
        largest = max(largest, max(abs(spectrum.plus[i]), abs(spectrum.minus[i])));
    }
    return clamped_blocks(svd, spectrum, largest, e);
}
