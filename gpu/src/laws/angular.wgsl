// Angular springs in triangles. Twin of `sinew_models::laws::pooled::Angular`. Vertices ascend; edge m lies opposite
// vertex m, and spring m couples the two others.

@group(1) @binding(1) var<storage, read> nodes: array<u32>;

const VERTICES: u32 = 3u;
const EDGES: u32 = 3u;
const START = array<u32, 3>(1u, 0u, 0u);
const END = array<u32, 3>(2u, 2u, 1u);
const ONE = array<u32, 3>(1u, 2u, 0u);
const OTHER = array<u32, 3>(2u, 0u, 1u);

// One row of 16 bytes per edge: rest vector (m), stiffness of the spring with its number (N/m^3).
fn coupled(i: u32) -> Coupled {
    let u = array<vec3f, 3>(displacement(nodes[3u * i]), displacement(nodes[3u * i + 1u]), displacement(nodes[3u * i + 2u]));
    var s: Coupled;
    for (var e = 0u; e < EDGES; e += 1u) {
        let constants = data[3u * i + e];
        add_edge(&s, e, constants.xyz, u[START[e]] - u[END[e]]);
        s.stiffness[e] = constants.w;
    }
    return s;
}
