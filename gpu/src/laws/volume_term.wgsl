// The term of volume Lambda/2 (J-1)^2 of axes: stress and tangent blocks. Twin of functions of
// `sinew_models::axes::element`.

// V Lambda (J-1) cof F (J).
fn volume_stress(volumetric: f32, g: mat3x3f) -> mat3x3f {
    return (volumetric * volume_change(g)) * cofactor(g);
}

fn volume_energy(volumetric: f32, g: mat3x3f) -> f32 {
    let j = volume_change(g);
    return 0.5 * volumetric * j * j;
}

// Block of the vertices with shape vectors da and db. Varying F by v (x) D_b turns cof F D_a by
// F (D_b x D_a) x v; the stand-ins leave that out.
fn volume_block(volumetric: f32, g: mat3x3f, da: vec3f, db: vec3f, kind: u32) -> mat3x3f {
    let cof = cofactor(g);
    var k = volumetric * outer(cof * da, cof * db);
    if kind == 0u {
        let turned = cross(db, da) + g * cross(db, da);
        k += (volumetric * volume_change(g)) * skew(turned);
    }
    return k;
}
