// Fused St Venant-Kirchhoff with compression term. Twin of `sinew_models::element::tetrahedron` (laws `FusedStVK`
// and, without the term, `StVKFem`).

// S = lambda (tr E) I + 2 mu E.
fn second_piola_kirchhoff(e: Element, strain: mat3x3f) -> mat3x3f {
    return (e.lambda * trace(strain)) * identity() + (2.0 * e.mu) * strain;
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    let strain = green_strain(g);
    let t = trace(strain);
    let m = min(volume_change(g), 0.0);
    return 0.5 * e.lambda * t * t + e.mu * squares(strain) + 0.5 * e.compression * (m * m) * (m * m);
}

// F S + p1 cof F.
fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    let s = second_piola_kirchhoff(e, green_strain(g));
    let m = min(volume_change(g), 0.0);
    return s + g * s + (2.0 * e.compression * m * m * m) * cofactor(g);
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let strain = green_strain(g);
    let s = second_piola_kirchhoff(e, strain);
    let m = min(volume_change(g), 0.0);
    let p1 = 2.0 * e.compression * m * m * m;
    let p2 = 6.0 * e.compression * m * m;
    if kind == 2u && is_doubtful(e, g, s) {
        return projected(e, g, trace(strain), p1, p2);
    }
    let f = identity() + g;
    let left = f * transpose(f);
    let cof = cofactor(g);
    let d = array<vec3f, 3>(e.d1, e.d2, e.d3);
    let fd = array<vec3f, 3>(f * e.d1, f * e.d2, f * e.d3);
    let sd = array<vec3f, 3>(s * e.d1, s * e.d2, s * e.d3);
    let cd = array<vec3f, 3>(cof * e.d1, cof * e.d2, cof * e.d3);
    var blocks = array<mat3x3f, 6>();
    blocks[0] = block(e, f, left, d[0], d[0], fd[0], fd[0], sd[0], cd[0], cd[0], p1, p2, kind);
    blocks[1] = block(e, f, left, d[1], d[1], fd[1], fd[1], sd[1], cd[1], cd[1], p1, p2, kind);
    blocks[2] = block(e, f, left, d[2], d[2], fd[2], fd[2], sd[2], cd[2], cd[2], p1, p2, kind);
    blocks[3] = block(e, f, left, d[0], d[1], fd[0], fd[1], sd[1], cd[0], cd[1], p1, p2, kind);
    blocks[4] = block(e, f, left, d[0], d[2], fd[0], fd[2], sd[2], cd[0], cd[2], p1, p2, kind);
    blocks[5] = block(e, f, left, d[1], d[2], fd[1], fd[2], sd[2], cd[1], cd[2], p1, p2, kind);
    return blocks;
}

// Block of the vertices with shape vectors da and db.
fn block(
    e: Element, f: mat3x3f, left: mat3x3f, da: vec3f, db: vec3f, fda: vec3f, fdb: vec3f, sdb: vec3f,
    cda: vec3f, cdb: vec3f, p1: f32, p2: f32, kind: u32,
) -> mat3x3f {
    var k = e.lambda * outer(fda, fdb) + e.mu * (outer(fdb, fda) + dot(da, db) * left) + p2 * outer(cda, cdb);
    if kind != 1u {
        k += dot(da, sdb) * identity() + p1 * skew(f * cross(db, da));
    }
    return k;
}

fn projected(e: Element, g: mat3x3f, t: f32, p1: f32, p2: f32) -> array<mat3x3f, 6> {
    let svd = signed_svd(identity() + g);
    let s = svd.s;
    let c = vec3f(s.y * s.z, s.x * s.z, s.x * s.y);
    var spectrum = Spectrum();
    var largest = 0.0;
    for (var i = 0u; i < 3u; i += 1u) {
        for (var j = 0u; j < 3u; j += 1u) {
            var own = e.lambda * t + e.mu * (3.0 * s[i] * s[i] - 1.0);
            if i != j {
                own = p1 * s[3u - i - j];
            }
            let entry = e.lambda * s[i] * s[j] + p2 * c[i] * c[j] + own;
            spectrum.stretches[j][i] = entry;
            largest = max(largest, abs(entry));
        }
    }
    for (var k = 0u; k < 3u; k += 1u) {
        let i = (k + 1u) % 3u;
        let j = (k + 2u) % 3u;
        let b = e.lambda * t - e.mu + e.mu * (s[i] * s[i] + s[j] * s[j]);
        let o = e.mu * s[i] * s[j] - p1 * s[k];
        spectrum.plus[k] = b + o;
        spectrum.minus[k] = b - o;
        largest = max(largest, max(abs(b), abs(o)));
    }
    return clamped_blocks(svd, spectrum, largest, e);
}
