//! Distance of a point from deformed faces.

use glam::DVec3;
use sinew_engine::row::VertexRow;
use sinew_engine::surface::closest_point;

/// A point beside some faces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beside {
    /// Signed distance (m), negative behind the faces.
    pub distance: f64,
    /// Gradient of the distance by the point; by the vertices of the face it is this times minus their `weights`.
    pub normal: DVec3,
    /// Vertex rows of the closest face.
    pub face: [VertexRow; 3],
    /// Barycentric coordinates of the closest point.
    pub weights: [f64; 3],
}

/// Signed distance of `p` from `faces`: that of the closest point, its sign by the angle-weighted mean normal of the
/// faces that meet there (Baerentzen & Aanaes 2005). `side` gives the sign instead where faces have two sides.
pub(crate) fn beside(
    p: DVec3,
    faces: &[[VertexRow; 3]],
    x: &dyn Fn(VertexRow) -> DVec3,
    side: Option<f64>,
) -> Option<Beside> {
    let mut best: Option<(f64, [VertexRow; 3], [f64; 3], DVec3)> = None;
    for &face in faces {
        let corners = face.map(x);
        let weights = closest_point(p, corners);
        let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        let distance = p.distance(at);
        if best.as_ref().is_none_or(|(least, ..)| distance < *least) {
            best = Some((distance, face, weights, at));
        }
    }
    let (distance, face, weights, at) = best?;
    // mean normal of all faces that have this point: one alone where it is inside of a face
    let mut normal = DVec3::ZERO;
    let size = x(face[0]).distance(x(face[1])).max(x(face[0]).distance(x(face[2])));
    let interior = weights.iter().all(|w| *w > 1e-9);
    for &other in faces.iter().filter(|other| !interior || **other == face) {
        let corners = other.map(x);
        let w = closest_point(p, corners);
        let there = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
        if there.distance(at) > 1e-9 * size {
            continue;
        }
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let Some(unit) = cross.try_normalize() else { continue };
        let corner = (0..3).find(|&k| w[k] >= 1.0 - 1e-9);
        let angle = corner.map_or(1.0, |k| {
            let (u, v) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
            libm::atan2(u.cross(v).length(), u.dot(v))
        });
        normal += angle * unit;
    }
    let normal = normal.try_normalize()?;
    let arm = p - at;
    let sign = side.unwrap_or(if arm.dot(normal) < 0.0 { -1.0 } else { 1.0 });
    // the direction to the closest point is lost in rounding where the two meet
    if interior || distance < 1e-6 * size {
        let facing = side.map_or(1.0, |side| if side < 0.0 { -1.0 } else { 1.0 });
        let normal = facing * normal;
        return Some(Beside { distance: arm.dot(normal), normal, face, weights });
    }
    let sign = match side {
        Some(side) => {
            if (arm.dot(normal) < 0.0) == (side < 0.0) {
                1.0
            } else {
                -1.0
            }
        }
        None => sign,
    };
    Some(Beside { distance: sign * distance, normal: sign * arm / distance, face, weights })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_closest_point_is_closest(
            p in prop::array::uniform3(-2.0..2.0), t in prop::array::uniform9(-1.0..1.0),
            u in 0.0..1.0, v in 0.0..1.0,
        ) {
            let p = DVec3::from_array(p);
            let corners = [0, 3, 6].map(|i| DVec3::new(t[i], t[i + 1], t[i + 2]));
            let w = closest_point(p, corners);
            prop_assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-12 && w.iter().all(|w| *w >= 0.0));
            let at = |w: [f64; 3]| corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            prop_assert!(p.distance(at(w)) <= p.distance(at([1.0 - u - v, u, v])) + 1e-9);
        }

        #[test]
        fn distances_from_a_cube_have_the_right_sign(p in prop::array::uniform3(-0.3..1.3)) {
            // the corner region of the unit cube near the origin, outward
            let points = [
                DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::X + DVec3::Y, DVec3::X + DVec3::Z,
                DVec3::Y + DVec3::Z, DVec3::ONE,
            ];
            let faces = [
                [0, 2, 4], [0, 4, 1], [0, 1, 5], [0, 5, 3], [0, 3, 6], [0, 6, 2],
                [7, 3, 5], [7, 6, 3], [7, 4, 2], [7, 2, 6], [7, 5, 1], [7, 1, 4],
            ].map(|face| face.map(VertexRow));
            let p = DVec3::from_array(p);
            let x = |row: VertexRow| points[row.index()];
            let q = (p - 0.5).abs() - 0.5;
            let exact = q.max(DVec3::ZERO).length() + q.max_element().min(0.0);
            let found = beside(p, &faces, &x, None).unwrap();
            prop_assert!((found.distance - exact).abs() < 1e-12, "{} {exact}", found.distance);
            let h = 1e-6;
            // away from where the closest point jumps
            let jumps = exact < 0.0 && {
                let mut sorted = [q.x, q.y, q.z];
                sorted.sort_by(f64::total_cmp);
                sorted[2] - sorted[1] < 1e-3
            };
            if exact.abs() > 1e-4 && !jumps {
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    let at = |p| beside(p, &faces, &x, None).unwrap().distance;
                    let difference = (at(p + h * axis) - at(p - h * axis)) / (2.0 * h);
                    prop_assert!((difference - found.normal.dot(axis)).abs() < 1e-4);
                }
            }
        }
    }
}
