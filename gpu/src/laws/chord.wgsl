// A deformed axis. Twin of `sinew_models::axes::element`, see there for the mathematics of all laws of axes.
// Moduli are multiplied by the rest volume (J).

// A deformed unit axis.
struct Chord {
    deformed: vec3f,    // F a
    direction: vec3f,   // its direction
    stretch: f32,       // |F a| - 1
    inverse: f32,       // 1/|F a|
}

// Of the axis a whose ends move by h = G a against each other.
fn chord(a: vec3f, h: vec3f) -> Chord {
    let deformed = a + h;
    let square = max(dot(deformed, deformed), 1e-12);
    let inverse = inverseSqrt(square);
    return Chord(deformed, inverse * deformed, dot(h, a + deformed) / (square * inverse + 1.0), inverse);
}

// along n n^T + across (I - n n^T).
fn chord_stiffness(c: Chord, along: f32, across: f32) -> mat3x3f {
    return outer((along - across) * c.direction, c.direction) + across * identity();
}
