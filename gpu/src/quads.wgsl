// Quadrilaterals over 2x2 Gauss points, one thread each. Twin of `sinew_models::frame::quads`: a point deforms as a triangle whose
// edges are the derivatives of the positions by the local coordinates, so the law has the functions that
// three_vertices.wgsl asks for. A point stands for twice the area of its triangle: moduli are twice those given.

@group(1) @binding(1) var<storage, read> nodes: array<vec4u>;

const THREADS: u32 = 1u;

// Pairs of local vertices.
const START = array<u32, 6>(0u, 0u, 0u, 1u, 1u, 2u);
const END = array<u32, 6>(1u, 2u, 3u, 2u, 3u, 3u);

// Derivatives of the shape function of vertex a at Gauss point q.
fn derivatives(a: u32, q: u32) -> vec2f {
    let c = corner(a).xy;
    return 0.25 * c * (1.0 + GAUSS * (c * corner(q).xy)).yx;
}

// Displacements of vertices 1, 2, 3 against vertex 0 (m).
fn relative(i: u32) -> mat3x3f {
    let v = nodes[i];
    let u0 = displacement(v.x);
    return mat3x3f(displacement(v.y) - u0, displacement(v.z) - u0, displacement(v.w) - u0);
}

// The triangle that stands for Gauss point q of element i.
fn point(i: u32, u: mat3x3f, q: u32) -> Element {
    var w = array<vec3f, 2>();
    for (var a = 1u; a < 4u; a += 1u) {
        let d = derivatives(a, q);
        w[0] += d.x * u[a - 1u];
        w[1] += d.y * u[a - 1u];
    }
    return element_at(ROWS * (4u * i + q), w);
}

fn energy_of(i: u32) -> f32 {
    let u = relative(i);
    var sum = 0.0;
    for (var q = 0u; q < 4u; q += 1u) {
        sum += energy(point(i, u, q));
    }
    return sum;
}

// f_a = sum_q sum_j dN_a/dxi_j f_j.
fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let u = relative(i);
    var sums = array<vec3f, 4>();
    for (var q = 0u; q < 4u; q += 1u) {
        let f = vertex_forces(point(i, u, q));
        for (var a = 0u; a < 4u; a += 1u) {
            let d = derivatives(a, q);
            sums[a] += d.x * f[0] + d.y * f[1];
        }
    }
    for (var a = 0u; a < 4u; a += 1u) {
        slots[4u * i + a] = vec4f(sums[a], 0.0);
    }
}

// dN_a/dxi_i K_ij dN_b/dxi_j.
fn between(k: array<mat3x3f, 3>, a: vec2f, b: vec2f) -> mat3x3f {
    return (a.x * b.x) * k[0] + (a.y * b.y) * k[1] + (a.x * b.y) * k[2] + (a.y * b.x) * transpose(k[2]);
}

fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let u = relative(i);
    var own = array<mat3x3f, 4>();
    var pairs = array<mat3x3f, 6>();
    for (var q = 0u; q < 4u; q += 1u) {
        let k = core(point(i, u, q), step.kind);
        for (var a = 0u; a < 4u; a += 1u) {
            let d = derivatives(a, q);
            own[a] += between(k, d, d);
        }
        for (var p = 0u; p < 6u; p += 1u) {
            pairs[p] += between(k, derivatives(START[p], q), derivatives(END[p], q));
        }
    }
    for (var a = 0u; a < 4u; a += 1u) {
        write_block(i, 10u, a, 0.5 * (own[a] + transpose(own[a])));
    }
    for (var p = 0u; p < 6u; p += 1u) {
        write_block(i, 10u, 4u + p, pairs[p]);
    }
}
