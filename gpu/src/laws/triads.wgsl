// Three axes, the angles between them and the term of volume. Twin of `sinew_models::axes::element::Triad`.
// Constants are 7 rows of 16 bytes: D_i (1/m) and V Y_i (J), a_i and V G_k (J), V Lambda (J).

struct Element {
    w: mat3x3f,
    d1: vec3f,
    d2: vec3f,
    d3: vec3f,
    axes: array<vec3f, 3>,
    axial: array<f32, 3>,
    angular: array<f32, 3>,
    volumetric: f32,
}

// Pairs of axes in the order of their angular moduli.
const AXIS_FIRST = array<u32, 3>(0u, 0u, 1u);
const AXIS_SECOND = array<u32, 3>(1u, 2u, 2u);

const ROWS: u32 = 7u;

fn element_at(at: u32, w: mat3x3f) -> Element {
    let d1 = data[at];
    let d2 = data[at + 1u];
    let d3 = data[at + 2u];
    let a = data[at + 3u];
    let b = data[at + 4u];
    let c = data[at + 5u];
    return Element(
        w, d1.xyz, d2.xyz, d3.xyz, array<vec3f, 3>(a.xyz, b.xyz, c.xyz),
        array<f32, 3>(d1.w, d2.w, d3.w), array<f32, 3>(a.w, b.w, c.w), data[at + 6u].x,
    );
}

fn chords(e: Element, g: mat3x3f) -> array<Chord, 3> {
    return array<Chord, 3>(
        chord(e.axes[0], g * e.axes[0]), chord(e.axes[1], g * e.axes[1]), chord(e.axes[2], g * e.axes[2]),
    );
}

// Change of the cosine of two axes, and its derivatives by F a_i and F a_j.
struct Angle {
    cosine: f32,
    change: f32,
    first: vec3f,
    second: vec3f,
}

fn angle(a: vec3f, b: vec3f, g: mat3x3f, p: Chord, q: Chord) -> Angle {
    let rest = dot(a, b);
    let stretch = p.stretch * q.stretch + (p.stretch + q.stretch);
    let change = (dot(a, g * b) + dot(g * a, q.deformed) - rest * stretch) * (p.inverse * q.inverse);
    let cosine = rest + change;
    return Angle(
        cosine, change,
        p.inverse * (q.direction - cosine * p.direction), q.inverse * (p.direction - cosine * q.direction),
    );
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    var own = e;
    var chords = chords(e, g);
    var sum = 0.0;
    for (var k = 0u; k < 3u; k += 1u) {
        let i = AXIS_FIRST[k];
        let j = AXIS_SECOND[k];
        let m = angle(own.axes[i], own.axes[j], g, chords[i], chords[j]).change;
        let stretch = chords[k].stretch;
        sum += own.axial[k] * stretch * stretch + own.angular[k] * m * m;
    }
    return 0.5 * sum + volume_energy(e.volumetric, g);
}

// V P, P the first Piola-Kirchhoff stress.
fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    var own = e;
    var chords = chords(e, g);
    var p = volume_stress(e.volumetric, g);
    for (var k = 0u; k < 3u; k += 1u) {
        let i = AXIS_FIRST[k];
        let j = AXIS_SECOND[k];
        let t = angle(own.axes[i], own.axes[j], g, chords[i], chords[j]);
        let force = own.angular[k] * t.change;
        p += outer((own.axial[k] * chords[k].stretch) * chords[k].direction, own.axes[k])
            + outer(force * t.first, own.axes[i]) + outer(force * t.second, own.axes[j]);
    }
    return p;
}

// Second derivative of the cosine of p and q by p.
fn cosine_curvature(cosine: f32, p: Chord, q: Chord) -> mat3x3f {
    let n = p.direction;
    return (-p.inverse * p.inverse) * (outer(n, q.direction) + outer(q.direction, n)
        + cosine * (identity() - 3.0 * outer(n, n)));
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    var axes = e.axes;
    var axial = e.axial;
    var angular = e.angular;
    var chords = chords(e, g);
    // second derivatives by F a_i, and by F a_i and F a_j
    var own = array<mat3x3f, 3>();
    var mixed = array<mat3x3f, 3>();
    for (var i = 0u; i < 3u; i += 1u) {
        var across = axial[i] * (chords[i].stretch * chords[i].inverse);
        if kind == 1u {
            across = 0.0;
        } else if kind == 2u {
            across = max(across, 0.0);
        }
        own[i] = chord_stiffness(chords[i], axial[i], across);
    }
    for (var k = 0u; k < 3u; k += 1u) {
        let i = AXIS_FIRST[k];
        let j = AXIS_SECOND[k];
        let p = chords[i];
        let q = chords[j];
        let t = angle(axes[i], axes[j], g, p, q);
        own[i] += outer(angular[k] * t.first, t.first);
        own[j] += outer(angular[k] * t.second, t.second);
        mixed[k] = outer(angular[k] * t.first, t.second);
        if kind == 0u {
            let force = angular[k] * t.change;
            own[i] += force * cosine_curvature(t.cosine, p, q);
            own[j] += force * cosine_curvature(t.cosine, q, p);
            mixed[k] += (force * p.inverse * q.inverse) * (identity() - outer(p.direction, p.direction)
                - outer(q.direction, q.direction) + t.cosine * outer(p.direction, q.direction));
        }
    }
    let d = array<vec3f, 3>(e.d1, e.d2, e.d3);
    var blocks = array<mat3x3f, 6>();
    for (var n = 0u; n < 6u; n += 1u) {
        let da = d[FIRST[n]];
        let db = d[SECOND[n]];
        var block = volume_block(e.volumetric, g, da, db, kind);
        for (var k = 0u; k < 3u; k += 1u) {
            let a = axes[AXIS_FIRST[k]];
            let b = axes[AXIS_SECOND[k]];
            block += (dot(da, axes[k]) * dot(db, axes[k])) * own[k]
                + (dot(da, a) * dot(db, b)) * mixed[k] + (dot(da, b) * dot(db, a)) * transpose(mixed[k]);
        }
        blocks[n] = block;
    }
    return blocks;
}
