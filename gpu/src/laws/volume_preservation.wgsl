// The term of volume without axes. Twin of `sinew_models::axes::element::VolumeTerm`. Constants are 3 rows of 16
// bytes: D_1 (1/m) and V Lambda (J), D_2, D_3.

struct Element {
    w: mat3x3f,
    d1: vec3f,
    d2: vec3f,
    d3: vec3f,
    volumetric: f32,
}

const ROWS: u32 = 3u;

fn element_at(at: u32, w: mat3x3f) -> Element {
    let a = data[at];
    return Element(w, a.xyz, data[at + 1u].xyz, data[at + 2u].xyz, a.w);
}

fn energy(e: Element, g: mat3x3f) -> f32 {
    return volume_energy(e.volumetric, g);
}

fn stress(e: Element, g: mat3x3f) -> mat3x3f {
    return volume_stress(e.volumetric, g);
}

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let d = array<vec3f, 3>(e.d1, e.d2, e.d3);
    var blocks = array<mat3x3f, 6>();
    for (var n = 0u; n < 6u; n += 1u) {
        blocks[n] = volume_block(e.volumetric, g, d[FIRST[n]], d[SECOND[n]], kind);
    }
    return blocks;
}
