// Hexahedra over 2x2x2 Gauss points, eight threads each: one for every point, then one for every vertex. Twin of
// `sinew_models::frame::hexahedra`: a point deforms as a tetrahedron whose edges are the derivatives of the positions by the
// local coordinates, so the law has the functions of tetrahedron.wgsl.

// vertices 0 to 3, then 4 to 7
@group(1) @binding(1) var<storage, read> nodes: array<vec4u>;

const THREADS: u32 = 8u;

// Pairs of local vertices.
const PAIRS = array<vec2u, 28>(
    vec2u(0u, 1u), vec2u(0u, 2u), vec2u(0u, 3u), vec2u(0u, 4u), vec2u(0u, 5u), vec2u(0u, 6u), vec2u(0u, 7u),
    vec2u(1u, 2u), vec2u(1u, 3u), vec2u(1u, 4u), vec2u(1u, 5u), vec2u(1u, 6u), vec2u(1u, 7u),
    vec2u(2u, 3u), vec2u(2u, 4u), vec2u(2u, 5u), vec2u(2u, 6u), vec2u(2u, 7u),
    vec2u(3u, 4u), vec2u(3u, 5u), vec2u(3u, 6u), vec2u(3u, 7u),
    vec2u(4u, 5u), vec2u(4u, 6u), vec2u(4u, 7u),
    vec2u(5u, 6u), vec2u(5u, 7u),
    vec2u(6u, 7u),
);

// Derivatives of the shape function of vertex a at Gauss point q.
fn derivatives(a: u32, q: u32) -> vec3f {
    let c = corner(a);
    let f = 1.0 + GAUSS * (c * corner(q));
    return 0.125 * c * vec3f(f.y * f.z, f.x * f.z, f.x * f.y);
}

// The tetrahedron that stands for Gauss point q of element i, thread 8 i + q; displacements relative to vertex 0.
fn point(t: u32) -> Element {
    let i = t / 8u;
    let q = t % 8u;
    let low = nodes[2u * i];
    let high = nodes[2u * i + 1u];
    let u0 = displacement(low.x);
    var w = outer(displacement(low.y) - u0, derivatives(1u, q));
    w += outer(displacement(low.z) - u0, derivatives(2u, q));
    w += outer(displacement(low.w) - u0, derivatives(3u, q));
    w += outer(displacement(high.x) - u0, derivatives(4u, q));
    w += outer(displacement(high.y) - u0, derivatives(5u, q));
    w += outer(displacement(high.z) - u0, derivatives(6u, q));
    w += outer(displacement(high.w) - u0, derivatives(7u, q));
    return element_at(ROWS * t, w);
}

fn energy_of(t: u32) -> f32 {
    let e = point(t);
    return energy(e, displacement_gradient(e));
}

// What the points of the elements of a workgroup have found, and the derivatives of vertex a at point q in place
// 8 q + a: threads that share an element read neighbours.
var<workgroup> found: array<mat3x3f, 256>;
var<workgroup> shape: array<vec3f, 64>;

fn write_shape(local: u32) {
    if local < 64u {
        shape[local] = derivatives(local % 8u, local / 8u);
    }
}

// f_a = sum_q sum_j dN_a/dxi_j f_j.
fn write_forces(t: u32) {
    let local = t % GROUP;
    let exists = t < THREADS * chunk.count;
    var own = mat3x3f();
    if exists {
        let e = point(t);
        own = vertex_forces(e, displacement_gradient(e));
    }
    found[local] = own;
    write_shape(local);
    workgroupBarrier();
    if !exists { return; }
    let a = local % 8u;
    var force = vec3f();
    for (var q = 0u; q < 8u; q += 1u) {
        force += found[local - a + q] * shape[8u * q + a];
    }
    slots[t] = vec4f(force, 0.0);
}

// K_ab = sum_q sum_ij dN_a/dxi_i K_ij dN_b/dxi_j. The points show one of their six blocks K_ij, i <= j, at a time, and
// every thread adds it to its own of the 36 blocks of the element: those of vertex a and of pairs a, a + 8, ..
fn write_tangents(t: u32) {
    let local = t % GROUP;
    let exists = t < THREADS * chunk.count;
    var own = array<mat3x3f, 6>();
    if exists {
        let e = point(t);
        own = core(e, displacement_gradient(e), step.kind);
    }
    write_shape(local);
    let a = local % 8u;
    var vertices = array<vec2u, 5>(vec2u(a), PAIRS[a], PAIRS[a + 8u], PAIRS[a + 16u], PAIRS[min(a + 24u, 27u)]);
    var sums = array<mat3x3f, 5>();
    for (var n = 0u; n < 6u; n += 1u) {
        workgroupBarrier();
        found[local] = own[n];
        workgroupBarrier();
        let i = FIRST[n];
        let j = SECOND[n];
        for (var q = 0u; q < 8u; q += 1u) {
            let k = found[local - a + q];
            for (var p = 0u; p < 5u; p += 1u) {
                let da = shape[8u * q + vertices[p].x];
                let db = shape[8u * q + vertices[p].y];
                sums[p] += (da[i] * db[j]) * k;
                if i != j {
                    sums[p] += (da[j] * db[i]) * transpose(k);
                }
            }
        }
    }
    if !exists { return; }
    let element = t / 8u;
    write_block(element, 36u, a, 0.5 * (sums[0] + transpose(sums[0])));
    write_block(element, 36u, a + 8u, sums[1]);
    write_block(element, 36u, a + 16u, sums[2]);
    write_block(element, 36u, a + 24u, sums[3]);
    if a < 4u {
        write_block(element, 36u, a + 32u, sums[4]);
    }
}
