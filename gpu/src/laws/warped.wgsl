// Stiffness warping: R held in the tangent. Twin of `sinew_models::laws::corotational::WarpedStiffness`.

fn core(e: Element, g: mat3x3f, kind: u32) -> array<mat3x3f, 6> {
    let r = polar(g).rotation;
    return warped(e, r * e.d1, r * e.d2, r * e.d3);
}
