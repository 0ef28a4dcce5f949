//! Small solids drawn many times: a ball, a rod and a cone of size 1, and where they stand.

use crate::colour::{Rgb, to_linear};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Vertex of a solid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SolidVertex {
    pub place: [f32; 3],
    pub normal: [f32; 3],
}

/// A copy of a solid: its axes with their lengths, its origin (m) and its colour in linear light.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Instance {
    pub axes: [[f32; 3]; 3],
    pub origin: [f32; 3],
    pub tint: [f32; 4],
}

/// sRGB to linear light, opaque.
pub(crate) fn linear(colour: Rgb) -> [f32; 4] {
    let [r, g, b] = colour.map(to_linear);
    [r, g, b, 1.0]
}

impl Instance {
    /// A ball.
    pub(crate) fn ball(centre: [f32; 3], radius: f32, colour: Rgb) -> Self {
        let axes = [[radius, 0.0, 0.0], [0.0, radius, 0.0], [0.0, 0.0, radius]];
        Self { axes, origin: centre, tint: linear(colour) }
    }

    /// A rod or cone from a place along a direction; none without length.
    pub(crate) fn along(from: Vec3, along: Vec3, radius: f32, colour: Rgb) -> Option<Self> {
        let direction = along.try_normalize()?;
        let (x, y) = direction.any_orthonormal_pair();
        let axes = [x * radius, y * radius, along].map(|v| v.to_array());
        Some(Self { axes, origin: from.to_array(), tint: linear(colour) })
    }
}

/// A solid: vertices and triangles.
pub(crate) type Solid = (Vec<SolidVertex>, Vec<u32>);

/// A surface of revolution about z through `(radius, height, normal outward, normal upward)` rings; every pair
/// of rings is joined.
fn revolved(rings: &[[f32; 4]], sides: u32) -> Solid {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    for &[radius, height, out, upward] in rings {
        for i in 0..sides {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / sides as f32).sin_cos();
            vertices.push(SolidVertex {
                place: [radius * cos, radius * sin, height],
                normal: [out * cos, out * sin, upward],
            });
        }
    }
    for ring in 0..rings.len() as u32 - 1 {
        for i in 0..sides {
            let [a, b] = [i, (i + 1) % sides].map(|i| ring * sides + i);
            indices.extend([a, b, b + sides, a, b + sides, a + sides]);
        }
    }
    (vertices, indices)
}

/// Of radius 1 around the origin.
pub(crate) fn ball() -> Solid {
    let rings: Vec<[f32; 4]> = (0..=10)
        .map(|i| {
            let (sin, cos) = (std::f32::consts::PI * (1.0 - i as f32 / 10.0)).sin_cos();
            [sin, cos, sin, cos]
        })
        .collect();
    revolved(&rings, 16)
}

/// Of radius 1 from 0 to 1 along z, with flat ends.
pub(crate) fn rod() -> Solid {
    let rings = [
        [0.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 1.0, 0.0],
        [1.0, 1.0, 1.0, 0.0],
        [1.0, 1.0, 0.0, 1.0],
        [0.0, 1.0, 0.0, 1.0],
    ];
    revolved(&rings, 10)
}

/// Of radius 1 at 0, with its tip at 1 along z.
pub(crate) fn cone() -> Solid {
    let rings = [
        [0.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.94, 0.35],
        [0.0, 1.0, 0.94, 0.35],
    ];
    revolved(&rings, 18)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solids_are_closed_and_turned_outward() {
        // volumes by the divergence theorem: inscribed polygons are a little smaller
        let pi = std::f32::consts::PI;
        for ((vertices, indices), volume) in
            [(ball(), 4.0 / 3.0 * pi), (rod(), pi), (cone(), pi / 3.0)]
        {
            let sum: f32 = indices
                .chunks_exact(3)
                .map(|t| {
                    let p =
                        [t[0], t[1], t[2]].map(|i| Vec3::from_array(vertices[i as usize].place));
                    p[0].dot(p[1].cross(p[2])) / 6.0
                })
                .sum();
            assert!(sum < volume && sum > 0.9 * volume, "{sum} beside {volume}");
        }
    }

    #[test]
    fn instances_stand_along_their_direction() {
        let along = Vec3::new(0.0, 3.0, 4.0);
        let i = Instance::along(Vec3::ONE, along, 0.5, [255; 3]).unwrap();
        let [x, y, z] = i.axes.map(Vec3::from_array);
        assert_eq!(z, along);
        assert!(x.dot(y).abs() < 1e-6 && x.dot(z).abs() < 1e-6 && (x.length() - 0.5).abs() < 1e-6);
        assert!(x.cross(y).dot(z) > 0.0);
        assert!(Instance::along(Vec3::ONE, Vec3::ZERO, 0.5, [0; 3]).is_none());
    }
}
