// How far an edge is stretched. Twin of `sinew_models::laws::quadratic::Stretch`.

struct Stretch {
    edge: vec3f,            // deformed edge (m)
    change: f32,            // 2 L (l - L) (m^2)
    slope: f32,             // 2 L/l
    inverse_square: f32,    // 1/l^2 (1/m^2)
}

fn stretch(rest: vec3f, relative: vec3f) -> Stretch {
    let edge = rest + relative;
    let delta = dot(relative, rest + edge);
    // the edges of a removed tetrahedron have no length; without moduli any will do
    var rest2 = dot(rest, rest);
    rest2 = select(1.0, rest2, rest2 > 0.0);
    // in a much shortened edge the sum cancels, the deformed edge does not
    let length2 = max(select(rest2 + delta, dot(edge, edge), delta < -0.5 * rest2), 1e-12 * rest2);
    // the ratio of the lengths, formed so that their product cannot leave the range of f32
    let shrink = sqrt(rest2 / length2);
    return Stretch(edge, 2.0 * delta / (length2 / rest2 * shrink + 1.0), 2.0 * shrink, 1.0 / length2);
}
