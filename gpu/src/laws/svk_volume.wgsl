// St Venant-Kirchhoff shear with a volume term in J. Twin of `sinew_models::laws::svk_volume`.

fn energy(e: Element, g: mat3x3f) -> f32 {
    let m = volume_change(g);
    return e.mu * squares(green_strain(g)) + 0.5 * e.lambda * m * m;
}

// F S + p cof F, S = 2 mu E.
fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    let s = (2.0 * e.mu) * green_strain(g);
    return s + g * s + (e.lambda * volume_change(g)) * cofactor(g);
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let f = identity() + g;
    let p = e.lambda * volume_change(g);
    if kind == 2u && e.mu > 0.0 {
        return projected(e, f, p);
    }
    // a material with nu < 0 would make the volume part negative
    let lambda = select(max(e.lambda, 0.0), e.lambda, kind == 0u);
    let s = (2.0 * e.mu) * green_strain(g);
    let left = f * transpose(f);
    let cof = cofactor(g);
    let d = array<vec3f, 3>(e.d1, e.d2, e.d3);
    var blocks = array<mat3x3f, 6>();
    for (var n = 0u; n < 6u; n += 1u) {
        let da = d[FIRST[n]];
        let db = d[SECOND[n]];
        blocks[n] = e.mu * (outer(f * db, f * da) + dot(da, db) * left) + lambda * outer(cof * da, cof * db);
        if kind == 0u {
            blocks[n] += dot(da, s * db) * identity() + p * skew(f * cross(db, da));
        }
    }
    return blocks;
}

fn projected(e: Element, f: mat3x3f, p: f32) -> array<mat3x3f, 6> {
    let svd = signed_svd(f);
    let s = svd.s;
    let c = vec3f(s.y * s.z, s.x * s.z, s.x * s.y);
    var spectrum = Spectrum();
    var largest = 0.0;
    for (var i = 0u; i < 3u; i += 1u) {
        for (var j = 0u; j < 3u; j += 1u) {
            var own = e.mu * (3.0 * s[i] * s[i] - 1.0);
            if i != j {
                own = p * s[3u - i - j];
            }
            let entry = e.lambda * c[i] * c[j] + own;
            spectrum.stretches[j][i] = entry;
            largest = max(largest, abs(entry));
        }
    }
    for (var k = 0u; k < 3u; k += 1u) {
        let i = (k + 1u) % 3u;
        let j = (k + 2u) % 3u;
        let b = e.mu * (s[i] * s[i] + s[j] * s[j] - 1.0);
        let o = e.mu * s[i] * s[j] - p * s[k];
        spectrum.plus[k] = b + o;
        spectrum.minus[k] = b - o;
        largest = max(largest, max(abs(b), abs(o)));
    }
    return clamped_blocks(svd, spectrum, largest, e);
}
