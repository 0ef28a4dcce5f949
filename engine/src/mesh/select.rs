//! Vertices by where they are, and parts of the surface.

use super::cell::quad_triangles;
use super::{Mesh, Surface};
use crate::surface::closest_point;
use glam::DVec3;
use std::collections::HashMap;

/// A part of space, its boundary included, by which vertices are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Zone {
    /// Between two corners.
    Box {
        /// Lowest corner (m).
        min: DVec3,
        /// Highest corner (m).
        max: DVec3,
    },
    /// A ball.
    Sphere {
        /// Centre (m).
        centre: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// A cylinder with flat ends.
    Cylinder {
        /// Middle of one end (m).
        start: DVec3,
        /// Middle of the other (m).
        end: DVec3,
        /// Radius (m).
        radius: f64,
    },
    /// All on one side of a plane.
    HalfSpace {
        /// A point of the plane (m).
        point: DVec3,
        /// Points to the side that is meant; of any length.
        normal: DVec3,
    },
}

/// Rounding of a product of coordinates, relative.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl Zone {
    /// Whether a point (m) is in it.
    pub fn contains(&self, p: DVec3) -> bool {
        match *self {
            Self::Box { min, max } => p.cmpge(min).all() && p.cmple(max).all(),
            Self::Sphere { centre, radius } => p.distance(centre) <= radius,
            Self::Cylinder { start, end, radius } => {
                let axis = (end - start).normalize_or_zero();
                let (length, along) = ((end - start).length(), (p - start).dot(axis));
                let slack = ROUNDING * (p.length() + start.length() + length);
                let across = (p - start - along * axis).length();
                along >= -slack && along <= length + slack && across <= radius + slack
            }
            Self::HalfSpace { point, normal } => {
                let slack = ROUNDING * (p.length() + point.length()) * normal.length();
                (p - point).dot(normal) >= -slack
            }
        }
    }

    /// What cannot be used of it.
    pub fn problem(&self) -> Option<&'static str> {
        let is_radius = |r: f64| r > 0.0 && r.is_finite();
        match *self {
            Self::Box { min, max } if !(min.is_finite() && max.is_finite()) => {
                Some("a corner is not finite")
            }
            Self::Box { min, max } if !min.cmple(max).all() => {
                Some("`min` is not below `max`: exchange the corners")
            }
            Self::Sphere { centre, radius } if !(centre.is_finite() && is_radius(radius)) => {
                Some("the centre must be finite and the radius positive")
            }
            Self::Cylinder { start, end, radius }
                if !(start.is_finite() && end.is_finite() && is_radius(radius)) =>
            {
                Some("both ends must be finite and the radius positive")
            }
            Self::Cylinder { start, end, .. } if start == end => {
                Some("both ends are at one place, so it has no axis")
            }
            Self::HalfSpace { point, normal } if !(point.is_finite() && normal.is_finite()) => {
                Some("point and normal must be finite")
            }
            Self::HalfSpace { normal, .. } if normal == DVec3::ZERO => {
                Some("the normal is 0: give the direction to the side that is meant")
            }
            _ => None,
        }
    }
}

/// A part of the surface of a mesh: of solid elements their boundary, else the faces of the mesh.
///
/// With `near` alone it is what hangs together with the nearest face without a bend of more than `angle`, such as one side of
/// a box. With `normal` it is all faces whose outward normal is within `angle` of a direction, such as the top; with both
/// those that hang together with the nearest face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// A point (m) near the face that it begins with.
    pub near: Option<DVec3>,
    /// Direction of the normals; of any length.
    pub normal: Option<DVec3>,
    /// Angle (rad).
    pub angle: f64,
}

impl Patch {
    /// What cannot be used of it.
    pub fn problem(&self) -> Option<&'static str> {
        if self.near.is_none() && self.normal.is_none() {
            return Some("give `near`, `normal` or both");
        }
        if self.near.is_some_and(|x| !x.is_finite()) {
            return Some("`near` is not finite");
        }
        if self.normal.is_some_and(|n| !n.is_finite() || n == DVec3::ZERO) {
            return Some("`normal` must be a direction, finite and not 0");
        }
        if !(self.angle > 0.0 && self.angle <= std::f64::consts::PI) {
            return Some("the angle must be above 0 and at most 180 degrees");
        }
        None
    }
}

impl Mesh {
    /// Vertices that a cell uses which makes up the body, ascending.
    pub fn used_vertices(&self) -> Vec<u32> {
        let mut used = vec![false; self.points.len()];
        for kind in self.matter() {
            let cells = self.cells(kind);
            cells.for_each(|cell| {
                for &v in cell.iter() {
                    used.get_mut(v as usize).into_iter().for_each(|used| *used = true);
                }
            });
        }
        (0..).zip(used).filter(|(_, used)| *used).map(|(v, _)| v).collect()
    }

    /// Vertices in a part of space that cells use, ascending.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::generate::box_tets;
    /// use sinew_engine::mesh::{Patch, Zone};
    ///
    /// let mesh = box_tets(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2])?;
    /// let right = Zone::HalfSpace { point: DVec3::new(0.15, 0.0, 0.0), normal: DVec3::X };
    /// assert_eq!(mesh.vertices_in(&right).len(), 2 * 9);
    /// let top = Patch { near: None, normal: Some(DVec3::Z), angle: 0.5 };
    /// assert_eq!(mesh.patch_vertices(&top), mesh.group("z1").unwrap().vertices);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn vertices_in(&self, zone: &Zone) -> Vec<u32> {
        let mut vertices = self.used_vertices();
        vertices.retain(|v| zone.contains(self.points[*v as usize]));
        vertices
    }

    /// Vertices of the faces of a patch, ascending.
    pub fn patch_vertices(&self, patch: &Patch) -> Vec<u32> {
        let Surface { triangles, quads } = self.patch(patch);
        let mut vertices = triangles.into_flattened();
        vertices.extend(quads.as_flattened());
        vertices.sort_unstable();
        vertices.dedup();
        vertices
    }

    /// Faces of a patch, in the order of the surface; none where it cannot be used.
    pub fn patch(&self, patch: &Patch) -> Surface {
        let all = match self.is_solid() {
            true => self.surface(),
            false => Surface { triangles: self.triangles.clone(), quads: self.quads.clone() },
        };
        if patch.problem().is_some() {
            return Surface::default();
        }
        let faces = Faces::new(self, &all);
        let least = patch.angle.cos() - ROUNDING;
        let normal = patch.normal.map(DVec3::normalize_or_zero);
        let fits = |face: usize| normal.is_none_or(|n| faces.normals[face].dot(n) >= least);
        let chosen = match patch.near {
            None => (0..faces.normals.len()).map(fits).collect(),
            Some(near) => faces.around(near, &fits, normal.is_none().then_some(least)),
        };
        let kept = |from: usize, count: usize| {
            (0..count).filter(|i| chosen[from + i]).collect::<Vec<usize>>()
        };
        let triangles = all.triangles.len();
        Surface {
            triangles: kept(0, triangles).into_iter().map(|i| all.triangles[i]).collect(),
            quads: kept(triangles, all.quads.len()).into_iter().map(|i| all.quads[i]).collect(),
        }
    }
}

/// Faces of a surface, triangles first.
struct Faces {
    normals: Vec<DVec3>,
    /// Once or, for quadrilaterals, twice a face: its number and its corners.
    corners: Vec<(usize, [DVec3; 3])>,
    edges: Vec<Vec<[u32; 2]>>,
}

impl Faces {
    fn new(mesh: &Mesh, surface: &Surface) -> Self {
        let mut own = Self { normals: Vec::new(), corners: Vec::new(), edges: Vec::new() };
        let triangles = surface.triangles.iter().map(|t| (&t[..], vec![*t]));
        let quads = surface.quads.iter().map(|q| (&q[..], quad_triangles(*q).to_vec()));
        for (number, (outline, parts)) in triangles.chain(quads).enumerate() {
            let at = |v: u32| mesh.points.get(v as usize).copied().unwrap_or(DVec3::NAN);
            let mut area = DVec3::ZERO;
            for part in parts {
                let [a, b, c] = part.map(at);
                area += (b - a).cross(c - a);
                own.corners.push((number, [a, b, c]));
            }
            own.normals.push(area.normalize_or_zero());
            let next = outline.iter().cycle().skip(1);
            own.edges.push(outline.iter().zip(next).map(|(&a, &b)| [a, b]).collect());
        }
        own
    }

    /// Which faces that `fit` hang together with the one nearest to a point; over edges whose faces have normals of at least
    /// this product, if there is one.
    fn around(&self, near: DVec3, fit: &dyn Fn(usize) -> bool, bend: Option<f64>) -> Vec<bool> {
        let mut chosen = vec![false; self.normals.len()];
        let distance = |corners: &[DVec3; 3]| {
            let w = closest_point(near, *corners);
            let x: DVec3 = corners.iter().zip(w).map(|(x, w)| *x * w).sum();
            near.distance_squared(x)
        };
        let fitting = self.corners.iter().filter(|(face, _)| fit(*face));
        let distances = fitting.map(|(face, corners)| (distance(corners), *face));
        let Some((_, first)) = distances.min_by(|a, b| a.0.total_cmp(&b.0)) else { return chosen };
        let mut beside: HashMap<[u32; 2], Vec<(usize, bool)>> = HashMap::new();
        for (face, edges) in self.edges.iter().enumerate() {
            for &[a, b] in edges {
                beside.entry([a.min(b), a.max(b)]).or_default().push((face, a < b));
            }
        }
        chosen[first] = true;
        let mut open = vec![first];
        while let Some(face) = open.pop() {
            for &[a, b] in &self.edges[face] {
                for &(other, upward) in &beside[&[a.min(b), a.max(b)]] {
                    // faces of a membrane may be wound either way: neighbours that are wound alike go along their edge in
                    // opposite directions
                    let sign = if upward == (a < b) { -1.0 } else { 1.0 };
                    let product = sign * self.normals[face].dot(self.normals[other]);
                    if !chosen[other] && fit(other) && bend.is_none_or(|least| product >= least) {
                        chosen[other] = true;
                        open.push(other);
                    }
                }
            }
        }
        chosen
    }
}
