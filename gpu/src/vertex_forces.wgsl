// Forces of laws with a stress: f_a = -V P D_a, P the first Piola-Kirchhoff stress. The law file has
//   stress(e, g)           P times the volume (J)

fn vertex_forces(e: Element, g: mat3x3f) -> mat3x3f {
    let p = stress(e, g);
    return mat3x3f(-(p * e.d1), -(p * e.d2), -(p * e.d3));
}
