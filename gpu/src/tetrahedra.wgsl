// Tetrahedra, one thread each. The law has the functions of tetrahedron.wgsl.

@group(1) @binding(1) var<storage, read> nodes: array<vec4u>;

const THREADS: u32 = 1u;

fn element(i: u32) -> Element {
    let v = nodes[i];
    let u0 = displacement(v.x);
    let w = mat3x3f(displacement(v.y) - u0, displacement(v.z) - u0, displacement(v.w) - u0);
    return element_at(ROWS * i, w);
}

fn energy_of(i: u32) -> f32 {
    let e = element(i);
    return energy(e, displacement_gradient(e));
}

fn write_forces(i: u32) {
    if i >= chunk.count { return; }
    let e = element(i);
    write_tetrahedron_forces(i, vertex_forces(e, displacement_gradient(e)));
}

fn write_tangents(i: u32) {
    if i >= chunk.count { return; }
    let e = element(i);
    write_tetrahedron_blocks(i, core(e, displacement_gradient(e), step.kind));
}
