// Quadratic springs (TRQS). Twin of `sinew_models::element::membrane::quadratic`.

// Edges 01, 02 and 12, each pointing to its higher vertex.
fn stretches(e: Element) -> array<Stretch, 3> {
    return array<Stretch, 3>(stretch(e.e1, e.w1), stretch(e.e2, e.w2), stretch(e.e2 - e.e1, e.w2 - e.w1));
}

// What takes the place of the change of the Gram matrix.
fn spring_change(edges: array<Stretch, 3>) -> vec3f {
    let a = edges[0].change;
    let b = edges[1].change;
    return vec3f(a, b, 0.5 * (a + b - edges[2].change));
}

// Tensions of the edges 01, 02 and 12 (N/m) from a change.
fn tensions(e: Element, d: vec3f, c: vec3f) -> vec3f {
    let s = membrane_stress(e, d, c);
    return (0.5 * e.area) * vec3f(s.x + s.z, s.y + s.z, -s.z);
}

fn energy(e: Element) -> f32 {
    let c = spring_change(stretches(e));
    return elastic_energy(e, membrane_stress(e, dual(e), c), c);
}

fn vertex_forces(e: Element) -> array<vec3f, 2> {
    let edges = stretches(e);
    let s = tensions(e, dual(e), spring_change(edges));
    let c = edges[2].slope * s.z * edges[2].edge;
    return array<vec3f, 2>(
        c - edges[0].slope * s.x * edges[0].edge, -(c + edges[1].slope * s.y * edges[1].edge),
    );
}

fn geometric(edge: Stretch, tension: f32, kind: u32) -> mat3x3f {
    var kept = tension;
    if kind == 1u {
        kept = 0.0;
    } else if kind == 2u {
        kept = max(kept, 0.0);
    }
    let x = edge.edge;
    return (edge.slope * kept) * (identity() - edge.inverse_square * outer(x, x));
}

fn core(e: Element, kind: u32) -> array<mat3x3f, 3> {
    let edges = stretches(e);
    let d = dual(e);
    let s = tensions(e, d, spring_change(edges));
    // tensions by unit changes of the edges
    let b0 = tensions(e, d, vec3f(1.0, 0.0, 0.5));
    let b1 = tensions(e, d, vec3f(0.0, 1.0, 0.5));
    let b2 = tensions(e, d, vec3f(0.0, 0.0, -0.5));
    let a = edges[0].slope * edges[0].edge;
    let c = edges[1].slope * edges[1].edge;
    let t = edges[2].slope * edges[2].edge;
    let third = geometric(edges[2], s.z, kind);
    // products of the vertices 1 and 2 with the edges that meet there
    return array<mat3x3f, 3>(
        geometric(edges[0], s.x, kind) + third + outer(b0.x * a - b0.z * t, a) - outer(b2.x * a - b2.z * t, t),
        geometric(edges[1], s.y, kind) + third + outer(b1.y * c + b1.z * t, c) + outer(b2.y * c + b2.z * t, t),
        outer(b1.x * a - b1.z * t, c) + outer(b2.x * a - b2.z * t, t) - third,
    );
}
