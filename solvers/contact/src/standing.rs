//! How a tool stands to a body: apart from it, in touch with its surface, or wholly inside.

use crate::skin::face_points;
use crate::tool::{Tool, ToolPose};
use glam::DVec3;
use std::f64::consts::TAU;

/// Points `faces(n)` of every face by which a tool between the vertices is found.
const FINE: u32 = 4;

/// How a tool stands to a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Standing {
    /// Outside, `gap` (m) from the nearest point of the surface that was looked at.
    Apart {
        /// Distance (m).
        gap: f64,
    },
    /// Points of the surface are in it.
    Touching {
        /// Depth (m) of the deepest.
        depth: f64,
    },
    /// Wholly inside of the body: it touches nothing, and feels nothing.
    Inside,
}

/// How a tool at a pose stands to a body with vertices at `points` (m) and these triangles outside, outward: those of
/// solids alone, as membranes have no inside.
pub fn standing(
    tool: &Tool,
    pose: &ToolPose,
    points: &[DVec3],
    triangles: &[[u32; 3]],
) -> Standing {
    let mut nearest = f64::INFINITY;
    let mut inside = false;
    let places = face_points(FINE, false);
    let corners = |t: &[u32; 3]| t.map(|v| points[v as usize]);
    for (i, part) in tool.parts.iter().enumerate() {
        let (centre, rotation) = tool.part_pose(i, pose);
        let inverse = rotation.inverse();
        let gap = |x: DVec3| part.distance(inverse * (x - centre)).0;
        for [a, b, c] in triangles.iter().map(corners) {
            let own =
                [a, b, c].into_iter().chain(places.iter().map(|w| a * w[0] + b * w[1] + c * w[2]));
            nearest = own.map(gap).fold(nearest, f64::min);
        }
        inside |= part.is_bounded() && encloses(centre, triangles.iter().map(corners));
    }
    match nearest {
        gap if gap <= 0.0 => Standing::Touching { depth: -gap },
        _ if inside => Standing::Inside,
        gap => Standing::Apart { gap },
    }
}

/// Whether triangles, outward, go round a point: by the solid angles under which it sees them (van Oosterom & Strackee
/// 1983).
pub(crate) fn encloses(p: DVec3, triangles: impl Iterator<Item = [DVec3; 3]>) -> bool {
    let angle = |corners: [DVec3; 3]| {
        let [a, b, c] = corners.map(|x| x - p);
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
        2.0 * libm::atan2(a.dot(b.cross(c)), below)
    };
    triangles.map(angle).sum::<f64>() > TAU
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Shape;
    use sinew_engine::mesh::generate::box_tets;

    #[test]
    fn a_tool_is_apart_touches_or_is_inside() {
        let mesh = box_tets(DVec3::ONE, [2, 2, 2]).unwrap();
        let outside = mesh.surface().triangles;
        let at = |at: DVec3| {
            let tool = Tool::new("ball", Shape::Sphere { radius: 0.1 }, at);
            standing(&tool, &tool.start, &mesh.points, &outside)
        };
        assert_eq!(at(DVec3::splat(0.5)), Standing::Inside);
        let Standing::Apart { gap } = at(DVec3::new(0.5, 0.5, 1.3)) else { panic!() };
        assert!((gap - 0.2).abs() < 1e-12);
        let Standing::Touching { depth } = at(DVec3::new(0.5, 0.5, 1.06)) else { panic!() };
        assert!((depth - 0.04).abs() < 1e-12);
        // between the vertices
        let Standing::Touching { depth } = at(DVec3::new(0.25, 0.3, 0.95)) else { panic!() };
        assert!(depth > 0.02, "{depth}");
        let ground = Tool::ground("ground", DVec3::NEG_Z, DVec3::Z);
        let gap = standing(&ground, &ground.start, &mesh.points, &outside);
        assert_eq!(gap, Standing::Apart { gap: 1.0 });
    }
}
