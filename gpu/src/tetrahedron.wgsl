// A tetrahedron, or what stands for one at a Gauss point, and what its deformation is measured by. A law that is a
// function of them has
//   energy(e, g)           energy (J)
//   vertex_forces(e, g)    forces on vertices 1, 2, 3 in the columns (N); from a stress in stress.wgsl
//   core(e, g, kind)       tangent blocks of vertices 1, 2, 3: 11 22 33 12 13 23 (N/m)
// in terms of the element e and its displacement gradient g.

// The volume is multiplied into the moduli. w holds the displacements of vertices 1, 2, 3 against vertex 0 (m).
struct Element {
    w: mat3x3f,
    d1: vec3f,         // 1/m
    d2: vec3f,
    d3: vec3f,
    lambda: f32,       // J
    mu: f32,
    compression: f32,
}

// Rows of 16 bytes that an element has.
const ROWS: u32 = 3u;

// Constants are the rows from `at` on: D_1 and lambda V, D_2 and mu V, D_3 and kappa V.
fn element_at(at: u32, w: mat3x3f) -> Element {
    let a = data[at];
    let b = data[at + 1u];
    let c = data[at + 2u];
    return Element(w, a.xyz, b.xyz, c.xyz, a.w, b.w, c.w);
}
