//! Rigid shapes, as tools are made of: triangles once, and where they stand in a frame.

use crate::colour::Rgb;
use crate::skin::{Facet, Skin};
use glam::{Quat, Vec3};

/// Parts into which a quarter of a circle is cut.
const QUARTER: u32 = 10;

/// A rigid shape in its own frame, of one colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rigid {
    /// Places (m) of its vertices.
    pub points: Vec<[f32; 3]>,
    /// Unit normals of the vertices, outward; of a cavity inward.
    pub normals: Vec<[f32; 3]>,
    /// Three vertices each, counter-clockwise from where the normals point.
    pub triangles: Vec<[u32; 3]>,
    /// Colour.
    pub colour: Rgb,
    /// The part of a half-space that is shown: a slab whose upper side, at `z = 0`, is the surface. From behind, one sees
    /// through it. It does not have to be in the picture.
    pub plate: bool,
    /// The wall of a cavity, seen from inside: one sees what is in it, and through the wall.
    pub hollow: bool,
}

/// Where a rigid shape stands in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Index of the shape in the recording.
    pub shape: u32,
    /// Place (m) of its origin.
    pub at: [f32; 3],
    /// Rotation: quaternion x, y, z, w.
    pub turn: [f32; 4],
}

impl Placed {
    /// Where a point (m) of the shape is.
    pub fn carry(&self, point: [f32; 3]) -> Vec3 {
        Vec3::from_array(self.at) + self.turned(point)
    }

    /// Where a direction of the shape points.
    pub fn turned(&self, along: [f32; 3]) -> Vec3 {
        Quat::from_array(self.turn) * Vec3::from_array(along)
    }

    /// What a point (m) is in the frame of the shape.
    pub fn local(&self, point: Vec3) -> Vec3 {
        Quat::from_array(self.turn).inverse() * (point - Vec3::from_array(self.at))
    }
}

impl Rigid {
    /// A box with rounded edges round the origin: half sizes (m) with the rounding in them. Where the rounding is all of
    /// them, it is a ball; where it is all but one, a rod with round ends.
    pub fn rounded_box(half: Vec3, rounding: f32, colour: Rgb) -> Self {
        let inner = (half - Vec3::splat(rounding)).max(Vec3::ZERO);
        let steps = QUARTER + 1;
        // sine and cosine, exact at both ends: what meets there has the same place
        let arc = |part: u32| match part {
            QUARTER => (1.0, 0.0),
            _ => (std::f32::consts::FRAC_PI_2 * part as f32 / QUARTER as f32).sin_cos(),
        };
        // each eighth of a ball moves to its corner; rings go from below to above, columns round z
        let (columns, rings) = (4 * steps, 2 * steps);
        let mut shape = Self { colour, ..Self::default() };
        for ring in 0..rings {
            let (sin, cos) = arc(ring % steps);
            let (rise, out, z) = if ring < steps { (-cos, sin, -1.0) } else { (sin, cos, 1.0) };
            for column in 0..columns {
                let (sin, cos) = arc(column % steps);
                let (x, y, corner) = match column / steps {
                    0 => (cos, sin, Vec3::new(1.0, 1.0, z)),
                    1 => (-sin, cos, Vec3::new(-1.0, 1.0, z)),
                    2 => (-cos, -sin, Vec3::new(-1.0, -1.0, z)),
                    _ => (sin, -cos, Vec3::new(1.0, -1.0, z)),
                };
                let normal = Vec3::new(out * x, out * y, rise);
                shape.points.push((corner * inner + rounding * normal).to_array());
                shape.normals.push(normal.to_array());
            }
        }
        let mut quad = |[a, b, c, d]: [u32; 4]| {
            for t in [[a, b, c], [a, c, d]] {
                let p = t.map(|v| Vec3::from_array(shape.points[v as usize]));
                if (p[1] - p[0]).cross(p[2] - p[0]) != Vec3::ZERO {
                    shape.triangles.push(t);
                }
            }
        };
        for ring in 0..rings - 1 {
            for column in 0..columns {
                let [a, b] = [column, (column + 1) % columns].map(|c| ring * columns + c);
                quad([a, b, b + columns, a + columns]);
            }
        }
        // the flat sides below and above, by a vertex of each quarter
        let corners = [0, 1, 2, 3].map(|quarter| quarter * steps);
        quad([corners[3], corners[2], corners[1], corners[0]]);
        quad(corners.map(|corner| (rings - 1) * columns + corner));
        shape
    }

    /// Of a mesh (m); edges at which faces meet at more than `crease` degrees stay sharp.
    pub fn mesh(points: &[[f32; 3]], triangles: &[[u32; 3]], crease: f32, colour: Rgb) -> Self {
        let facets: Vec<Facet> = triangles.iter().map(|t| (*t, 0)).collect();
        let skin = Skin::new(&facets, points, crease);
        let normals = skin.normals(points);
        let points = skin.points.iter().map(|&v| points[v as usize]).collect();
        Self { points, normals, triangles: skin.triangles, colour, ..Self::default() }
    }

    /// The same as the wall of a cavity: its faces turned inward.
    #[must_use]
    pub fn hollow(mut self) -> Self {
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self.normals.iter_mut().for_each(|n| *n = n.map(|x| -x));
        self.hollow = true;
        self
    }

    /// The part of the half-space `z <= 0` above the rectangle from `low` to `high` (m), so many metres thick.
    pub fn plate(low: [f32; 2], high: [f32; 2], thickness: f32, colour: Rgb) -> Self {
        let [x, y] = [0, 1].map(|k| 0.5 * (high[k] - low[k]).max(thickness));
        let half = Vec3::new(x, y, 0.5 * thickness);
        let mut shape = Self::rounded_box(half, 0.25 * thickness, colour);
        let middle = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), -0.5 * thickness];
        for point in &mut shape.points {
            *point = [0, 1, 2].map(|k| point[k] + middle[k]);
        }
        Self { plate: true, ..shape }
    }

    /// The vertices that lie furthest in 26 directions: what a camera has to see to see all of it.
    pub fn outline(&self) -> Vec<[f32; 3]> {
        let axis = |i: i32, power: i32| (i / power % 3 - 1) as f32;
        let mut chosen: Vec<usize> = (0..27)
            .filter(|i| *i != 13)
            .filter_map(|i| {
                let along = Vec3::new(axis(i, 1), axis(i, 3), axis(i, 9));
                let reach = |v: &usize| Vec3::from_array(self.points[*v]).dot(along);
                (0..self.points.len()).max_by(|a, b| reach(a).total_cmp(&reach(b)))
            })
            .collect();
        chosen.sort_unstable();
        chosen.dedup();
        chosen.into_iter().map(|v| self.points[v]).collect()
    }
}
