// What deformation is measured by: functions of the displacement gradient G, in an element with the displacements w
// of vertices 1, 2, 3 against vertex 0 (m) and shape vectors d1, d2, d3 (1/m).

// G = sum_a u_a (x) D_a; D_0 = -(D_1 + D_2 + D_3) turns the sum into one over displacements relative to vertex 0.
fn displacement_gradient(e: Element) -> mat3x3f {
    return outer(e.w[0], e.d1) + outer(e.w[1], e.d2) + outer(e.w[2], e.d3);
}

fn trace(m: mat3x3f) -> f32 {
    return m[0].x + m[1].y + m[2].z;
}

// cof G: its columns are vector products of the other two.
fn cofactor_matrix(g: mat3x3f) -> mat3x3f {
    return mat3x3f(cross(g[1], g[2]), cross(g[2], g[0]), cross(g[0], g[1]));
}

// J - 1 from the invariants of G: nothing cancels.
fn volume_change(g: mat3x3f) -> f32 {
    let c = cofactor_matrix(g);
    return trace(g) + trace(c) + dot(g[0], c[0]);
}

// cof F = I + (tr G) I - G^T + cof G, the derivative of J by F.
fn cofactor(g: mat3x3f) -> mat3x3f {
    return (1.0 + trace(g)) * identity() - transpose(g) + cofactor_matrix(g);
}

// E = (G + G^T + G^T G)/2.
fn green_strain(g: mat3x3f) -> mat3x3f {
    return 0.5 * (g + transpose(g) + transpose(g) * g);
}
