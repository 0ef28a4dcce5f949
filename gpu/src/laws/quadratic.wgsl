// Tetrahedral quadratic springs. Twin of `sinew_models::laws::quadratic`.

// Edges in the order 01 02 03 12 13 23; the edge is x_plus - x_minus.
const PLUS = array<u32, 6>(1u, 2u, 3u, 1u, 1u, 2u);
const MINUS = array<u32, 6>(0u, 0u, 0u, 2u, 3u, 3u);

fn stretches(e: Element) -> array<Stretch, 6> {
    let c1 = cross(e.d2, e.d3);
    let det = dot(e.d1, c1);
    let scale = select(0.0, 1.0 / det, det != 0.0);
    let r1 = scale * c1;
    let r2 = scale * cross(e.d3, e.d1);
    let r3 = scale * cross(e.d1, e.d2);
    let w = e.w;
    return array<Stretch, 6>(
        stretch(r1, w[0]), stretch(r2, w[1]), stretch(r3, w[2]),
        stretch(r1 - r2, w[0] - w[1]), stretch(r1 - r3, w[0] - w[2]), stretch(r2 - r3, w[1] - w[2]),
    );
}

// s = B change through the strain that the changes amount to (N/m).
fn tensions(e: Element, edges: array<Stretch, 6>) -> array<f32, 6> {
    let shape = mat3x3f(e.d1, e.d2, e.d3);
    let d = transpose(shape) * shape;
    let c = vec3f(edges[0].change, edges[1].change, edges[2].change);
    let g12 = 0.5 * (c.x + c.y - edges[3].change);
    let g13 = 0.5 * (c.x + c.z - edges[4].change);
    let g23 = 0.5 * (c.y + c.z - edges[5].change);
    let g = mat3x3f(c.x, g12, g13, g12, c.y, g23, g13, g23, c.z);
    let t = 0.5 * (d[0].x * c.x + d[1].y * c.y + d[2].z * c.z) + d[0].y * g12 + d[0].z * g13 + d[1].z * g23;
    let s = 0.5 * (e.lambda * t * d + e.mu * (d * g * d));
    return array<f32, 6>(
        s[0].x + s[0].y + s[0].z, s[0].y + s[1].y + s[1].z, s[0].z + s[1].z + s[2].z, -s[0].y, -s[0].z, -s[1].z,
    );
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    var edges = stretches(e);
    var s = tensions(e, edges);
    var twice = 0.0;
    for (var i = 0u; i < 6u; i += 1u) {
        twice += s[i] * edges[i].change;
    }
    return 0.5 * twice;
}

fn vertex_forces(e: Element, g: mat3x3f) -> mat3x3f {
    let edges = stretches(e);
    let s = tensions(e, edges);
    let p0 = edges[0].slope * s[0] * edges[0].edge;
    let p1 = edges[1].slope * s[1] * edges[1].edge;
    let p2 = edges[2].slope * s[2] * edges[2].edge;
    let p3 = edges[3].slope * s[3] * edges[3].edge;
    let p4 = edges[4].slope * s[4] * edges[4].edge;
    let p5 = edges[5].slope * s[5] * edges[5].edge;
    return mat3x3f(-p0 - p3 - p4, -p1 + p3 - p5, -p2 + p4 + p5);
}

// 1 where the edge ends at vertex a, -1 where it begins there.
fn sign_at(edge: u32, a: u32) -> f32 {
    return f32(PLUS[edge] == a) - f32(MINUS[edge] == a);
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    var edges = stretches(e);
    var s = tensions(e, edges);
    // products of the shape vectors, vertex 0 included
    let shape = array<vec3f, 4>(-(e.d1 + e.d2 + e.d3), e.d1, e.d2, e.d3);
    var blocks = array<mat3x3f, 6>();
    for (var i = 0u; i < 6u; i += 1u) {
        let zi = edges[i].slope * edges[i].edge;
        let pi = shape[PLUS[i]];
        let mi = shape[MINUS[i]];
        for (var j = 0u; j < 6u; j += 1u) {
            let pj = shape[PLUS[j]];
            let mj = shape[MINUS[j]];
            // B: V/4 (lambda G_ij G_kl + mu (G_ik G_jl + G_il G_jk))
            let b = 0.25 * (e.lambda * dot(pi, mi) * dot(pj, mj)
                + e.mu * (dot(pi, pj) * dot(mi, mj) + dot(pi, mj) * dot(mi, pj)));
            let product = b * outer(zi, edges[j].slope * edges[j].edge);
            for (var n = 0u; n < 6u; n += 1u) {
                let sign = sign_at(i, FIRST[n] + 1u) * sign_at(j, SECOND[n] + 1u);
                if sign != 0.0 {
                    blocks[n] += sign * product;
                }
            }
        }
        var tension = s[i];
        if kind == 1u {
            tension = 0.0;
        } else if kind == 2u {
            tension = max(tension, 0.0);
        }
        let x = edges[i].edge;
        let geometric = (edges[i].slope * tension) * (identity() - edges[i].inverse_square * outer(x, x));
        for (var n = 0u; n < 6u; n += 1u) {
            let sign = sign_at(i, FIRST[n] + 1u) * sign_at(i, SECOND[n] + 1u);
            if sign != 0.0 {
                blocks[n] += sign * geometric;
            }
        }
    }
    for (var n = 0u; n < 3u; n += 1u) {
        blocks[n] = 0.5 * (blocks[n] + transpose(blocks[n]));
    }
    return blocks;
}
