//! A cup: half of a thick-walled ellipsoid, the simplest shape of a ventricle.

use super::name_sides;
use super::solids::core_layers;
use crate::mesh::Mesh;
use crate::mesh::error::MeshError;
use glam::DVec3;
use std::f64::consts::FRAC_PI_2;

/// Half of a thick-walled ellipsoid of hexahedra, its opening in the plane z = 0 and its tip below.
///
/// `inner` is radius and depth of the cavity (m), `wall` the thickness (m) at opening and tip. Inner and outer
/// surface are meshed as [`disc_quads`](super::disc_quads) laid round the tip: `core` by `core` cells there
/// and `rings` rings of `4 core` cells up to the opening; `layers` layers through the wall, from the inside
/// out. An even `core` has a vertex at the tip, an odd one a cell whose fibres no helix rule can tell.
/// Groups `inner`, `outer`, `base` (the rim at z = 0; vertices and outward quadrilaterals) and `body`.
///
/// ```
/// use sinew_engine::mesh::generate::cup_hexahedra;
///
/// let mesh = cup_hexahedra([0.02, 0.05], 0.01, 8, 12, 3)?;
/// assert_eq!(mesh.hexahedra.len(), (8 * 8 + 12 * 32) * 3);
/// // two half ellipsoids, but for the flat facets
/// let half = |r: f64, h: f64| 2.0 / 3.0 * std::f64::consts::PI * r * r * h;
/// let volume = half(0.03, 0.06) - half(0.02, 0.05);
/// assert!((mesh.total_volume() / volume - 1.0).abs() < 0.02);
/// # Ok::<(), sinew_engine::mesh::MeshError>(())
/// ```
///
/// # Errors
///
/// [`MeshError::InvalidParameter`] or [`MeshError::TooMany`].
pub fn cup_hexahedra(
    inner: [f64; 2],
    wall: f64,
    core: usize,
    rings: usize,
    layers: usize,
) -> Result<Mesh, MeshError> {
    const NAME: &str = "cup_hexahedra";
    let [radius, depth] = inner;
    let lengths = [("radius", radius), ("depth", depth), ("wall", wall)];
    // counter-clockwise from above, which is inside: the outer layer lies below
    let (disc, hexahedra) =
        core_layers(NAME, &lengths, 1.0, [core, rings, layers], |layer| [layer + 1, layer])?;
    let rim = disc.len() - 4 * core;
    let mut points = Vec::with_capacity(disc.len() * (layers + 1));
    for layer in 0..=layers {
        let out = wall * layer as f64 / layers as f64;
        points.extend(disc.iter().enumerate().map(|(i, p)| {
            let (sin, cos) = libm::sincos(p.length() * FRAC_PI_2);
            let round = p.normalize_or_zero() * (sin * (radius + out));
            // the rim lies in the plane exactly
            let down = if i < rim { cos * (depth + out) } else { 0.0 };
            DVec3::new(round.x, round.y, -down)
        }));
    }
    let source = format!(
        "{NAME} radius {radius} m, depth {depth} m, wall {wall} m, core {core} x {core}, {rings} rings, {layers} layers"
    );
    let mut mesh = Mesh { source, points, hexahedra, ..Mesh::default() };
    let (n, outermost) = (disc.len(), layers * disc.len());
    name_sides(&mut mesh, &["inner", "outer", "base"], |_, face| {
        if face.iter().all(|&v| (v as usize) < n) {
            0
        } else if face.iter().all(|&v| v as usize >= outermost) {
            1
        } else {
            2
        }
    });
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_hexahedron_is_upright_and_the_sides_are_where_they_are_named() {
        let mesh = cup_hexahedra([0.02, 0.05], 0.008, 4, 5, 2).unwrap();
        for &h in &mesh.hexahedra {
            assert!(mesh.hexahedron_volume(h).unwrap() > 0.0);
        }
        let sides = [("inner", 96, 0.02, 0.05), ("outer", 96, 0.028, 0.058)];
        for (name, quads, radius, depth) in sides {
            let group = mesh.group(name).unwrap();
            assert_eq!(group.cells.quads.len(), quads);
            for &v in &group.vertices {
                let p = mesh.points[v as usize];
                let on = (p.x * p.x + p.y * p.y) / (radius * radius) + p.z * p.z / (depth * depth);
                assert!((on - 1.0).abs() < 1e-12, "{name}: {p}");
            }
        }
        let base = mesh.group("base").unwrap();
        assert_eq!(base.cells.quads.len(), 2 * 16);
        assert!(base.vertices.iter().all(|&v| mesh.points[v as usize].z == 0.0));
        assert!(cup_hexahedra([0.02, -0.05], 0.008, 4, 5, 2).is_err());
        assert!(cup_hexahedra([0.02, 0.05], 0.008, 4, 0, 2).is_err());
    }
}
