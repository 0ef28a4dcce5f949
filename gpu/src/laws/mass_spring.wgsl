// Springs on edges. Twin of `sinew_models::laws::quadratic::MassSpring`.

fn energy(e: Edge) -> f32 {
    let change = stretch(e.rest, e.relative).change;
    return 0.25 * e.k * change * change;
}

fn pull(e: Edge) -> vec3f {
    let s = stretch(e.rest, e.relative);
    return (s.slope * 0.5 * e.k * s.change) * s.edge;
}

fn block(e: Edge, kind: u32) -> mat3x3f {
    let s = stretch(e.rest, e.relative);
    // identified constants may be negative
    var along = e.k;
    var tension = 0.5 * along * s.change;
    if kind == 1u {
        tension = 0.0;
        along = max(along, 0.0);
    } else if kind == 2u {
        tension = max(tension, 0.0);
        along = max(along, 0.0);
    }
    let z = s.slope * s.edge;
    return (0.5 * along) * outer(z, z)
        + (s.slope * tension) * (identity() - s.inverse_square * outer(s.edge, s.edge));
}
