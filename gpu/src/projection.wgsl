// Positive semidefinite projection of the second derivative of the energy by F. Twin of `sinew_models::element::projection`,
// in f32: the same names, the same matrices, see there for the mathematics.

const NEGLIGIBLE: f32 = 16.0 * 1.1920929e-7;
const MARGIN: f32 = 1e-5;
const SWEEPS: u32 = 12u;

// F = U diag(s) V^T with rotations U, V; columns of the matrices are the vectors.
struct Svd {
    u: mat3x3f,
    s: vec3f,
    v: mat3x3f,
}

struct Spectrum {
    stretches: mat3x3f,
    plus: vec3f,
    minus: vec3f,
}

// Cosine and sine of the rotation that makes [[alpha, gamma], [gamma, beta]] diagonal.
fn jacobi_rotation(alpha: f32, beta: f32, gamma: f32) -> vec2f {
    let zeta = (beta - alpha) / (gamma + gamma);
    let size = abs(zeta);
    // beyond 1e9 the square leaves the range and there is nothing left to turn
    let tangent = select(1.0, -1.0, zeta < 0.0) / (size + select(size, sqrt(1.0 + zeta * zeta), size < 1e9));
    let cosine = inverseSqrt(1.0 + tangent * tangent);
    return vec2f(cosine, cosine * tangent);
}

fn perpendicular(a: vec3f) -> vec3f {
    let s = abs(a);
    var other = vec3f(1.0, 0.0, 0.0);
    if s.x > s.y || s.x > s.z {
        other = select(vec3f(0.0, 0.0, 1.0), vec3f(0.0, 1.0, 0.0), s.y <= s.z);
    }
    return normalize(cross(a, other));
}

// Turns the columns p and q of b and v.
fn turn(b: ptr<function, mat3x3f>, v: ptr<function, mat3x3f>, p: u32, q: u32) {
    let x = (*b)[p];
    let y = (*b)[q];
    let alpha = dot(x, x);
    let beta = dot(y, y);
    let gamma = dot(x, y);
    if abs(gamma) > 1.1920929e-7 * sqrt(alpha) * sqrt(beta) {
        let r = jacobi_rotation(alpha, beta, gamma);
        (*b)[p] = r.x * x - r.y * y;
        (*b)[q] = r.y * x + r.x * y;
        let vp = (*v)[p];
        let vq = (*v)[q];
        (*v)[p] = r.x * vp - r.y * vq;
        (*v)[q] = r.y * vp + r.x * vq;
    }
}

// Longer column first; one is turned round to keep V a rotation.
fn order(b: ptr<function, mat3x3f>, v: ptr<function, mat3x3f>, p: u32, q: u32) {
    let x = (*b)[p];
    let y = (*b)[q];
    if dot(x, x) < dot(y, y) {
        (*b)[p] = y;
        (*b)[q] = -x;
        let vp = (*v)[p];
        (*v)[p] = (*v)[q];
        (*v)[q] = -vp;
    }
}

fn signed_svd(f: mat3x3f) -> Svd {
    var b = f;
    var v = identity();
    for (var sweep = 0u; sweep < SWEEPS; sweep += 1u) {
        turn(&b, &v, 0u, 1u);
        turn(&b, &v, 0u, 2u);
        turn(&b, &v, 1u, 2u);
    }
    order(&b, &v, 0u, 1u);
    order(&b, &v, 0u, 2u);
    order(&b, &v, 1u, 2u);
    let first = length(b[0]);
    var u0 = vec3f(1.0, 0.0, 0.0);
    if first > 1e-18 {
        u0 = b[0] / first;
    }
    let rest = b[1] - dot(u0, b[1]) * u0;
    let second = length(rest);
    var u1 = perpendicular(u0);
    if second > max(4.5 * 1.1920929e-7 * first, 1e-18) {
        u1 = rest / second;
    }
    u1 = normalize(u1 - dot(u0, u1) * u0);
    let u2 = cross(u0, u1);
    return Svd(mat3x3f(u0, u1, u2), vec3f(dot(u0, b[0]), dot(u1, b[1]), dot(u2, b[2])), v);
}

struct Eigen {
    values: vec3f,
    vectors: mat3x3f,
}

// Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations.
fn symmetric_eigen(m: mat3x3f) -> Eigen {
    var a = m;
    var v = identity();
    for (var sweep = 0u; sweep < SWEEPS; sweep += 1u) {
        for (var pair = 0u; pair < 3u; pair += 1u) {
            let p = select(0u, 1u, pair == 2u);
            let q = select(2u, 1u, pair == 0u);
            let gamma = a[q][p];
            if abs(gamma) > 1e-9 * (abs(a[p][p]) + abs(a[q][q])) {
                let r = jacobi_rotation(a[p][p], a[q][q], gamma);
                // columns, then rows
                let x = a[p];
                let y = a[q];
                a[p] = r.x * x - r.y * y;
                a[q] = r.y * x + r.x * y;
                for (var c = 0u; c < 3u; c += 1u) {
                    let s = a[c][p];
                    let t = a[c][q];
                    a[c][p] = r.x * s - r.y * t;
                    a[c][q] = r.y * s + r.x * t;
                }
                let vp = v[p];
                let vq = v[q];
                v[p] = r.x * vp - r.y * vq;
                v[q] = r.y * vp + r.x * vq;
            }
        }
    }
    return Eigen(vec3f(a[0].x, a[1].y, a[2].z), v);
}

// Leading minors all positive; false in doubt.
fn is_positive_definite(a: mat3x3f) -> bool {
    let m1 = a[0].x;
    let m2 = a[0].x * a[1].y - a[0].y * a[1].x;
    let m3 = determinant(a);
    let size = max(abs(a[0].x), max(abs(a[1].y), abs(a[2].z)));
    return m1 > MARGIN * size && m2 > MARGIN * size * size && m3 > MARGIN * size * size * size;
}

// Where the exact matrix could have a negative eigenvalue.
fn is_doubtful(e: Element, g: mat3x3f, s: mat3x3f) -> bool {
    let m = min(volume_change(g), 0.0);
    let size = 3.0 + 2.0 * trace(g) + dot(g[0], g[0]) + dot(g[1], g[1]) + dot(g[2], g[2]);
    let shift = 4.0 * e.compression * m * m * abs(m) * sqrt(max(size, 0.0));
    return !(e.mu > 0.0 && 3.0 * e.lambda + 2.0 * e.mu > 0.0 && is_positive_definite(s - shift * identity()));
}

// Blocks of vertices 1, 2, 3 from a spectrum whose negative eigenvalues are clamped at zero.
fn clamped_blocks(svd: Svd, spectrum: Spectrum, largest: f32, e: Element) -> array<mat3x3f, 6> {
    var a = spectrum.stretches;
    if !is_positive_definite(a) {
        let eigen = symmetric_eigen(a);
        let least = min(eigen.values.x, min(eigen.values.y, eigen.values.z));
        if least < -NEGLIGIBLE * largest {
            let kept = max(eigen.values, vec3f(0.0));
            let w = eigen.vectors;
            a = kept.x * outer(w[0], w[0]) + kept.y * outer(w[1], w[1]) + kept.z * outer(w[2], w[2]);
        }
    }
    let p = max(spectrum.plus, vec3f(0.0));
    let q = max(spectrum.minus, vec3f(0.0));
    let straight = 0.5 * (p + q);
    let crossed = 0.5 * (p - q);
    let turned = transpose(svd.v);
    let d = array<vec3f, 3>(turned * e.d1, turned * e.d2, turned * e.d3);
    var result = array<mat3x3f, 6>();
    for (var block = 0u; block < 6u; block += 1u) {
        let x = FIRST[block];
        let y = SECOND[block];
        let dx = d[x];
        let dy = d[y];
        var inner = mat3x3f();
        for (var i = 0u; i < 3u; i += 1u) {
            for (var k = 0u; k < 3u; k += 1u) {
                // columns of `inner` are k
                inner[k][i] += a[k][i] * dx[i] * dy[k];
                if i != k {
                    let third = 3u - i - k;
                    inner[k][i] += crossed[third] * dx[k] * dy[i];
                    inner[i][i] += straight[third] * dx[k] * dy[k];
                }
            }
        }
        result[block] = svd.u * inner * transpose(svd.u);
    }
    for (var block = 0u; block < 3u; block += 1u) {
        result[block] = 0.5 * (result[block] + transpose(result[block]));
    }
    return result;
}
