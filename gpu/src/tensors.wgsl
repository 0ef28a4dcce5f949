// Matrices that every kind of element needs.

fn outer(a: vec3f, b: vec3f) -> mat3x3f {
    return mat3x3f(a * b.x, a * b.y, a * b.z);
}

fn identity() -> mat3x3f {
    return mat3x3f(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
}

// w such that skew(w) v = w x v.
fn skew(w: vec3f) -> mat3x3f {
    return mat3x3f(0.0, w.z, -w.y, -w.z, 0.0, w.x, w.y, -w.x, 0.0);
}

// Vertices of the six tangent blocks 11 22 33 12 13 23, counted from 0.
const FIRST = array<u32, 6>(0u, 1u, 2u, 0u, 0u, 1u);
const SECOND = array<u32, 6>(0u, 1u, 2u, 1u, 2u, 2u);
