// Volumetric springs in tetrahedra. Twin of `sinew_models::laws::pooled::Volumetric`. Edges in the order 01 02 03 12 13 23;
// spring m couples the opposite edges m and 5 - m.

@group(1) @binding(1) var<storage, read> nodes: array<vec4u>;

const VERTICES: u32 = 4u;
const EDGES: u32 = 6u;
const START = array<u32, 6>(0u, 0u, 0u, 1u, 1u, 2u);
const END = array<u32, 6>(1u, 2u, 3u, 2u, 3u, 3u);
const ONE = array<u32, 3>(0u, 1u, 2u);
const OTHER = array<u32, 3>(5u, 4u, 3u);

// One row of 16 bytes per edge at vertex 0: rest vector (m), stiffness of the spring with its number (N/m^3).
fn coupled(i: u32) -> Coupled {
    let v = nodes[i];
    let u0 = displacement(v.x);
    var rest = array<vec3f, 4>();
    var u = array<vec3f, 4>(vec3f(), displacement(v.y) - u0, displacement(v.z) - u0, displacement(v.w) - u0);
    var s: Coupled;
    for (var m = 0u; m < 3u; m += 1u) {
        let constants = data[3u * i + m];
        rest[m + 1u] = -constants.xyz;
        s.stiffness[m] = constants.w;
    }
    for (var e = 0u; e < EDGES; e += 1u) {
        let a = START[e];
        let b = END[e];
        add_edge(&s, e, rest[a] - rest[b], u[a] - u[b]);
    }
    return s;
}
