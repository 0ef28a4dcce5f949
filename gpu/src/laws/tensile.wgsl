// Tensile springs on edges. Twin of `sinew_models::laws::pooled::Tensile`.

fn energy(e: Edge) -> f32 {
    return tensile_energy(e.k, squared_length_change(e.rest, e.relative));
}

fn pull(e: Edge) -> vec3f {
    return edge_pull(tensile_tension(e.k, squared_length_change(e.rest, e.relative)), e.rest + e.relative);
}

fn block(e: Edge, kind: u32) -> mat3x3f {
    let d = e.rest + e.relative;
    var m = outer((e.k + e.k) * d, d);
    if kind == 0u {
        m += (e.k * squared_length_change(e.rest, e.relative)) * identity();
    }
    return m;
}
