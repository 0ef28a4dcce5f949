//! Small solids drawn many times: a ball, a rod and a cone of size 1, and where they stand.

use crate::colour::{Rgb, to_linear};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Vertex of a solid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SolidVertex {
    /// Where it is.
    pub place: [f32; 3],
    /// Unit normal, outward.
    pub normal: [f32; 3],
}

/// A copy of a solid.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Instance {
    /// Axes with their lengths (m).
    pub axes: [[f32; 3]; 3],
    /// Origin (m).
    pub origin: [f32; 3],
    /// Colour in linear light, opaque.
    pub tint: [f32; 4],
}

/// sRGB to linear light, opaque.
pub fn linear(colour: Rgb) -> [f32; 4] {
    let [r, g, b] = colour.map(to_linear);
    [r, g, b, 1.0]
}

impl Instance {
    /// A ball.
    pub fn ball(centre: [f32; 3], radius: f32, colour: Rgb) -> Self {
        let axes = [[radius, 0.0, 0.0], [0.0, radius, 0.0], [0.0, 0.0, radius]];
        Self { axes, origin: centre, tint: linear(colour) }
    }

    /// A rod or cone from a place along a direction; none without length.
    pub fn along(from: Vec3, along: Vec3, radius: f32, colour: Rgb) -> Option<Self> {
        let direction = along.try_normalize()?;
        let (x, y) = direction.any_orthonormal_pair();
        let axes = [x * radius, y * radius, along].map(|v| v.to_array());
        Some(Self { axes, origin: from.to_array(), tint: linear(colour) })
    }
}

/// A solid: vertices and triangles.
pub type SolidMesh = (Vec<SolidVertex>, Vec<u32>);

/// A surface of revolution about z through `(radius, height, normal outward, normal upward)` rings; every pair
/// of rings is joined.
fn revolved(rings: &[[f32; 4]], sides: u32) -> SolidMesh {
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
pub fn ball() -> SolidMesh {
    let rings: Vec<[f32; 4]> = (0..=10)
        .map(|i| {
            let (sin, cos) = (std::f32::consts::PI * (1.0 - i as f32 / 10.0)).sin_cos();
            [sin, cos, sin, cos]
        })
        .collect();
    revolved(&rings, 16)
}

/// Of radius 1 from 0 to 1 along z, with flat ends.
pub fn rod() -> SolidMesh {
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
pub fn cone() -> SolidMesh {
    let rings = [
        [0.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 0.94, 0.35],
        [0.0, 1.0, 0.94, 0.35],
    ];
    revolved(&rings, 18)
}
