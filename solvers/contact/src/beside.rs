//! Distance of a point from deformed faces.

use crate::point::outer;
use glam::{DMat3, DVec3};
use sinew_engine::row::VertexRow;
use sinew_engine::surface::closest_point;

/// A point beside some faces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beside {
    /// Signed distance (m), negative behind the faces.
    pub distance: f64,
    /// Gradient of the distance by the point; by the vertices of the face it is this times minus their `weights`.
    pub normal: DVec3,
    /// Second derivatives by the point of half of the squared distance: across a face, an edge or a vertex.
    pub across: DMat3,
    /// Vertex rows of the closest face.
    pub face: Facet,
    /// Their shares in the closest point.
    pub weights: [f64; 4],
}

/// A triangle: of the first three rows where the last two are the same, else of the first two and the middle of all
/// four. A face with four corners is four of them, which no mirror changes.
pub(crate) type Facet = [VertexRow; 4];

/// A facet that a point may reach in a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearFacet {
    pub rows: Facet,
    /// Distance (m) of the point from it, when that was last taken.
    pub distance: f64,
}

/// The facets that the points of a world may reach in a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct NearFaces<'a> {
    pub all: &'a [NearFacet],
    /// At least the way (m) that a point and a facet came together since their distances were taken.
    pub moved: f64,
}

/// What there is beyond the rim of faces that a point may reach.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) enum Rim {
    /// They are those of a solid, which has none.
    #[default]
    None,
    /// Of a membrane: the plane of the face at the rim, so that a point which slides off is not held back.
    Plane,
    /// Of a body that touches itself: faces that were left out since they are near at rest. What lies sideways of the point by
    /// more than this distance (m) says nothing about the side that it is on.
    LeftOut(f64),
}

/// Difference of unit normals up to which faces that meet count as one plane: an edge between them is then no place where the
/// force turns by more than contact is found to.
const FLAT: f64 = 1e-2;

/// Rounding of distances, by the mean edge of a surface.
pub(crate) const ROUNDING: f64 = 1e-9;

/// Corners (m) of a facet.
#[inline]
pub(crate) fn facet_corners(
    facet: &Facet,
    x: &(impl Fn(VertexRow) -> DVec3 + ?Sized),
) -> [DVec3; 3] {
    let [a, b, c, d] = *facet;
    let (own, third) = ([x(a), x(b)], x(c));
    let third = if c == d { third } else { 0.25 * (own[0] + own[1] + third + x(d)) };
    [own[0], own[1], third]
}

/// Shares of the rows of a facet at the barycentric coordinates of a point.
fn shares(facet: &Facet, [u, v, w]: [f64; 3]) -> [f64; 4] {
    if facet[2] == facet[3] {
        return [u, v, w, 0.0];
    }
    let quarter = 0.25 * w;
    [u + quarter, v + quarter, quarter, quarter]
}

/// Point (m) of a triangle by barycentric coordinates.
pub(crate) fn point_in([a, b, c]: [DVec3; 3], [u, v, w]: [f64; 3]) -> DVec3 {
    a * u + b * v + c * w
}

/// Closest point of a facet: distance (m) of `p` from it, its barycentric coordinates, its place (m).
fn closest(
    p: DVec3,
    facet: &Facet,
    x: &(impl Fn(VertexRow) -> DVec3 + ?Sized),
) -> (f64, [f64; 3], DVec3) {
    let corners = facet_corners(facet, x);
    let weights = closest_point(p, corners);
    let at = point_in(corners, weights);
    (p.distance(at), weights, at)
}

/// Distance (m) of `p` from a facet.
pub(crate) fn distance(p: DVec3, facet: &Facet, x: &(impl Fn(VertexRow) -> DVec3 + ?Sized)) -> f64 {
    closest(p, facet, x).0
}

/// Signed distance of `p` from `faces`: that of the closest point, its sign by the angle-weighted mean normal of the
/// faces that meet there (Baerentzen & Aanaes 2005). `rim` says what counts where the closest point is on the rim of them.
///
/// `moved` (m) is at least the way that `p` and a face came together since the distances were taken. In fast motion a point
/// reaches hundreds of faces, and all but a few are by this too far to be looked at.
pub(crate) fn beside(
    p: DVec3,
    faces: &[NearFacet],
    moved: f64,
    x: &(impl Fn(VertexRow) -> DVec3 + ?Sized),
    rim: Rim,
) -> Option<Beside> {
    let from = |face: &NearFacet| closest(p, &face.rows, x);
    let nearest =
        (0..faces.len()).min_by(|a, b| faces[*a].distance.total_cmp(&faces[*b].distance))?;
    let mut best = (nearest, from(&faces[nearest]));
    for (i, face) in faces.iter().enumerate() {
        let (own, (least, ..)) = best;
        if i == nearest || face.distance - moved > least {
            continue;
        }
        let found = from(face);
        // of equals the first, whichever was looked at first
        if found.0 < least || found.0 == least && i < own {
            best = (i, found);
        }
    }
    let (own, (distance, weights, at)) = best;
    let face = faces[own].rows;
    // mean normal of all faces that have this point: one alone where it is inside of a face
    let mut normal = DVec3::ZERO;
    let (mut first, mut bend) = (None, 0.0_f64);
    let mut round: Vec<Facet> = Vec::new();
    let [a, b, c] = facet_corners(&face, x);
    let size = a.distance(b).max(a.distance(c));
    let interior = weights.iter().all(|w| *w > 1e-9);
    let beside = |other: &&NearFacet| {
        if interior { other.rows == face } else { other.distance - moved <= distance + 1e-9 * size }
    };
    for other in faces.iter().filter(beside).map(|other| other.rows) {
        let corners = facet_corners(&other, x);
        let w = closest_point(p, corners);
        let there = point_in(corners, w);
        if there.distance(at) > 1e-9 * size {
            continue;
        }
        if rim != Rim::None && !interior {
            round.push(other);
        }
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let Some(unit) = cross.try_normalize() else { continue };
        let corner = (0..3).find(|&k| w[k] >= 1.0 - 1e-9);
        let angle = corner.map_or(1.0, |k| {
            let (u, v) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
            libm::atan2(u.cross(v).length(), u.dot(v))
        });
        normal += angle * unit;
        bend = bend.max(first.get_or_insert(unit).distance(unit));
    }
    if !round.is_empty() && is_rim(&round, &face, weights) {
        match rim {
            Rim::LeftOut(near) if distance > near => return None,
            Rim::Plane => return beside_plane(p, &face, [a, b, c]),
            Rim::LeftOut(_) | Rim::None => {}
        }
    }
    let normal = normal.try_normalize()?;
    let (arm, on_face, weights) = (p - at, weights, shares(&face, weights));
    // the direction to the closest point is lost in rounding where the two meet
    if interior || distance < 1e-6 * size {
        let across = outer(normal, normal);
        return Some(Beside { distance: arm.dot(normal), normal, across, face, weights });
    }
    let sign = if arm.dot(normal) < 0.0 { -1.0 } else { 1.0 };
    let normal = sign * arm / distance;
    let across = match bend > FLAT {
        true => across_edge(on_face, [a, b, c]),
        false => outer(normal, normal),
    };
    Some(Beside { distance: sign * distance, normal, across, face, weights })
}

/// Projection on what is across the edge on which a point with these barycentric coordinates is; all directions at a vertex.
fn across_edge(weights: [f64; 3], corners: [DVec3; 3]) -> DMat3 {
    let ends = || (0..3).filter(|&k| weights[k] > 1e-9).map(|k| corners[k]);
    let along = match ends().count() {
        2 => ends().fold(DVec3::ZERO, |along, end| end - along).normalize_or_zero(),
        _ => DVec3::ZERO,
    };
    DMat3::IDENTITY - outer(along, along)
}

/// Whether the closest point, on an edge or vertex of `face`, is on the rim of the faces that have it.
fn is_rim(round: &[Facet], face: &Facet, weights: [f64; 3]) -> bool {
    let at: Vec<usize> = (0..3).filter(|&k| weights[k] > 1e-9).collect();
    let corner = match at[..] {
        [k] => third_or(face, k),
        _ => return round.len() < 2,
    };
    // each edge at the vertex has a face on either side of it, or is on the rim
    let mut ends: Vec<Facet> = Vec::new();
    for other in round {
        ends.extend((0..3).map(|k| third_or(other, k)).filter(|end| *end != corner));
    }
    ends.sort_unstable();
    ends.chunk_by(|a, b| a == b).any(|same| same.len() < 2)
}

/// What tells a corner of a facet from all others: its row, or all rows that it is the middle of.
fn third_or(facet: &Facet, k: usize) -> Facet {
    let mut own = *facet;
    if k < 2 || facet[2] == facet[3] {
        return [facet[k]; 4];
    }
    own.sort_unstable();
    own
}

/// Distance from the plane of a facet with these corners (m).
fn beside_plane(p: DVec3, face: &Facet, [a, b, c]: [DVec3; 3]) -> Option<Beside> {
    let cross = (b - a).cross(c - a);
    let normal = cross.try_normalize()?;
    let distance = (p - a).dot(normal);
    let foot = p - distance * normal;
    let share = |u: DVec3, v: DVec3| (u - foot).cross(v - foot).dot(cross) / cross.length_squared();
    let weights = shares(face, [share(b, c), share(c, a), share(a, b)]);
    Some(Beside { distance, normal, across: outer(normal, normal), face: *face, weights })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Facets with their distances from a point.
    fn near_from(p: DVec3, faces: &[Facet], x: &dyn Fn(VertexRow) -> DVec3) -> Vec<NearFacet> {
        let near = |&rows: &Facet| NearFacet { rows, distance: distance(p, &rows, x) };
        faces.iter().map(near).collect()
    }

    #[test]
    fn beyond_the_rim_of_a_membrane_the_plane_counts() {
        // two triangles and a face with four corners, all in one plane
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]];
        let points = points.map(|[x, y]| DVec3::new(x, y, 0.0));
        let [a, b, c, d, e, f] = [0, 1, 2, 3, 4, 5].map(VertexRow);
        let faces =
            [[a, b, c, c], [a, c, d, d], [b, e, f, c], [e, f, c, b], [f, c, b, e], [c, b, e, f]];
        let x = |row: VertexRow| points[row.index()];
        let near = |p: DVec3| beside(p, &near_from(p, &faces, &x), 0.0, &x, Rim::Plane).unwrap();
        for p in [
            DVec3::new(-0.3, 0.4, -0.01),
            DVec3::new(2.2, 1.4, -0.01),
            DVec3::new(-0.1, -0.1, 0.02),
            DVec3::new(1.0, 0.5, -0.01),
            DVec3::new(0.5, 0.5, 0.01),
            DVec3::new(1.0, -0.2, -0.02),
        ] {
            let found = near(p);
            assert!((found.distance - p.z).abs() < 1e-12, "{p}: {found:?}");
            assert!((found.normal - DVec3::Z).length() < 1e-12);
            let foot: DVec3 = (0..4).map(|k| x(found.face[k]) * found.weights[k]).sum();
            assert!((foot - p.with_z(0.0)).length() < 1e-12, "{p}: {found:?}");
        }
    }

    #[test]
    fn what_was_left_out_beside_a_point_hides_what_is_sideways_of_it() {
        // an even sheet without the faces near its middle, which bends up or down
        for height in [-0.01, 0.0, 0.01] {
            let points = [[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]];
            let points = points.map(|[x, y]| DVec3::new(x, y, height));
            let [a, b, c, d] = [0, 1, 2, 3].map(VertexRow);
            let x = |row: VertexRow| points[row.index()];
            let faces = [[a, b, c, c], [a, c, d, d]];
            let near = |p: DVec3| beside(p, &near_from(p, &faces, &x), 0.0, &x, Rim::LeftOut(0.35));
            assert!(near(DVec3::ZERO).is_none());
            // what is above faces, or about to leave them, is beside them
            let depth = |x, z| near(DVec3::new(x, 0.0, z)).unwrap().distance;
            assert!((depth(1.5, 0.5) + height - 0.5).abs() < 1e-12);
            assert!((depth(1.5, -0.5) + height + 0.5).abs() < 1e-12);
            assert!((depth(0.9, height - 0.1) + 0.02_f64.sqrt()).abs() < 1e-12);
        }
    }

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
        fn distances_from_a_cube_have_the_right_sign(
            p in prop::array::uniform3(-0.3..1.3), start in prop::array::uniform3(-0.3..1.3),
        ) {
            // the corner region of the unit cube near the origin, outward
            let points = [
                DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::X + DVec3::Y, DVec3::X + DVec3::Z,
                DVec3::Y + DVec3::Z, DVec3::ONE,
            ];
            let faces = [
                [0, 2, 4], [0, 4, 1], [0, 1, 5], [0, 5, 3], [0, 3, 6], [0, 6, 2],
                [7, 3, 5], [7, 6, 3], [7, 4, 2], [7, 2, 6], [7, 5, 1], [7, 1, 4],
            ].map(|[a, b, c]| [a, b, c, c].map(VertexRow));
            let p = DVec3::from_array(p);
            let x = |row: VertexRow| points[row.index()];
            let q = (p - 0.5).abs() - 0.5;
            let exact = q.max(DVec3::ZERO).length() + q.max_element().min(0.0);
            let near = |p| near_from(p, &faces, &x);
            let found = beside(p, &near(p), 0.0, &x, Rim::None).unwrap();
            // as it is with all faces looked at, wherever the step began
            let start = DVec3::from_array(start);
            let far = beside(p, &near(start), p.distance(start) + 1e-12, &x, Rim::None).unwrap();
            prop_assert_eq!((far.face, far.weights, far.normal), (found.face, found.weights, found.normal));
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
                    let [more, less] = [1.0, -1.0].map(|sign| {
                        let p = p + sign * h * axis;
                        beside(p, &near(p), 0.0, &x, Rim::None).unwrap()
                    });
                    let difference = (more.distance - less.distance) / (2.0 * h);
                    prop_assert!((difference - found.normal.dot(axis)).abs() < 1e-4);
                    // the second derivative, within what is closest to a face, an edge or a vertex of the cube
                    let zone = |p: DVec3| p.to_array().map(|x| (x > 0.0, x < 1.0));
                    if zone(p + h * axis) == zone(p - h * axis) {
                        let arm = |near: &Beside| near.distance * near.normal;
                        let difference = (arm(&more) - arm(&less)) / (2.0 * h);
                        prop_assert!((difference - found.across * axis).length() < 1e-4, "{p} {difference} {found:?}");
                    }
                }
            }
        }
    }
}
