//! Points that a mesh carries along, such as a fine surface in a coarse body.

use super::cell::{CUBE, determinant, hexahedron_jacobian};
use super::{CellVertices, Mesh};
use crate::element_kind::ElementKind;
use crate::isoparametric::MIDDLES;
use glam::{DMat3, DVec3};
use std::collections::HashMap;

/// Where points lie in the volume cells of a mesh: vertices of one cell with weights that sum up to 1.
///
/// A point moves by the weighted mean of the displacements of these vertices, so that it moves as the cell does there, and
/// stays where it is while the body rests. One that lies in no cell follows the nearest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EmbeddedPoints {
    points: Vec<Carried>,
    /// Points that lie in no cell.
    pub outside: usize,
    /// Largest distance (m) of such a point from the cell that it follows.
    pub farthest: f64,
}

/// One point.
#[derive(Clone, Debug, PartialEq)]
struct Carried {
    kind: ElementKind,
    cell: u32,
    vertices: CellVertices,
    weights: [f64; 10],
}

/// A point is inside a cell up to this share of its size.
const SLACK: f64 = 1e-9;

/// A cell as a candidate: weights of its vertices, and the distance (m) of the point from it.
type Candidate = ([f64; 10], f64);

impl EmbeddedPoints {
    /// Of points (m) in the frame of the mesh; `None` where the mesh has no volume cell.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sinew_engine::mesh::{EmbeddedPoints, generate::box_hexahedra};
    ///
    /// let mesh = box_hexahedra(DVec3::ONE, [2, 2, 2])?;
    /// let carried = EmbeddedPoints::new(&mesh, &[DVec3::splat(0.3)]).expect("a solid mesh");
    /// // a shear of the body is that of the point
    /// let shear: Vec<DVec3> = mesh.points.iter().map(|p| 0.5 * p.y * DVec3::X).collect();
    /// assert!((carried.displacements(&shear)[0] - DVec3::X * 0.15).length() < 1e-15);
    /// # Ok::<(), sinew_engine::mesh::MeshError>(())
    /// ```
    pub fn new(mesh: &Mesh, points: &[DVec3]) -> Option<Self> {
        let cells: Vec<(ElementKind, u32)> = mesh
            .matter()
            .into_iter()
            .filter(|kind| kind.is_solid())
            .flat_map(|kind| (0..mesh.count(kind) as u32).map(move |cell| (kind, cell)))
            .collect();
        let bounds = |&(kind, cell): &(ElementKind, u32)| {
            let vertices = mesh.cell(kind, cell as usize)?;
            let mut corners = vertices.iter().map(|&v| mesh.points[v as usize]);
            let first = corners.next()?;
            Some(corners.fold((first, first), |(a, b), p| (a.min(p), b.max(p))))
        };
        let boxes: Vec<(DVec3, DVec3)> = cells.iter().filter_map(bounds).collect();
        let (low, high) = boxes.first().map(|first| {
            boxes.iter().fold(*first, |(a, b), (low, high)| (a.min(*low), b.max(*high)))
        })?;
        let mean = boxes.iter().map(|(a, b)| (*b - *a).element_sum()).sum::<f64>()
            / (3 * boxes.len()) as f64;
        let bin = |p: DVec3| ((p - low) / mean).floor().as_i64vec3().to_array();
        let mut bins: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (i, (from, to)) in (0u32..).zip(&boxes) {
            for_bins([bin(*from), bin(*to)], |at| bins.entry(at).or_default().push(i));
        }
        let rings = (bin(high).into_iter().max().unwrap_or(0) + 2).max(2);
        let mut embedding = Self::default();
        for &p in points {
            // a point far away is looked for from the edge of the mesh
            let centre = bin(p.clamp(low, high));
            let mut best: Option<(u32, Candidate)> = None;
            let mut last = rings;
            for ring in 0..=rings {
                if ring > last {
                    break;
                }
                let ends = [centre.map(|x| x - ring), centre.map(|x| x + ring)];
                for_bins(ends, |at| {
                    if (0..3).all(|k| (at[k] - centre[k]).abs() < ring) {
                        return;
                    }
                    for &i in bins.get(&at).into_iter().flatten() {
                        let (kind, cell) = cells[i as usize];
                        let found = candidate(mesh, kind, cell, p);
                        if best.is_none_or(|(_, (_, least))| found.1 < least) {
                            best = Some((i, found));
                        }
                    }
                });
                match best {
                    Some((_, (_, 0.0))) => break,
                    // a nearer one may be in the next ring
                    Some(_) => last = last.min(ring + 1),
                    None => {}
                }
            }
            let (i, (weights, distance)) = best?;
            let (kind, cell) = cells[i as usize];
            embedding.outside += usize::from(distance > 0.0);
            embedding.farthest = embedding.farthest.max(distance);
            let vertices = mesh.cell(kind, cell as usize)?;
            embedding.points.push(Carried { kind, cell, vertices, weights });
        }
        Some(embedding)
    }

    /// Kind and index of the cell that carries each point.
    pub fn cells(&self) -> impl Iterator<Item = (ElementKind, u32)> + '_ {
        self.points.iter().map(|carried| (carried.kind, carried.cell))
    }

    /// Displacements (m) of the points from those of the vertices of the mesh.
    ///
    /// # Panics
    /// When there are fewer than the mesh has vertices.
    pub fn displacements(&self, of_vertices: &[DVec3]) -> Vec<DVec3> {
        self.mean(|v| of_vertices[v as usize])
    }

    /// Weighted means of numbers of the vertices.
    pub fn mean<T: std::iter::Sum<T> + std::ops::Mul<f64, Output = T>>(
        &self,
        of_vertex: impl Fn(u32) -> T,
    ) -> Vec<T> {
        let mean = |carried: &Carried| {
            let parts = carried.vertices.iter().zip(carried.weights);
            parts.map(|(&v, weight)| of_vertex(v) * weight).sum()
        };
        self.points.iter().map(mean).collect()
    }
}

fn for_bins([from, to]: [[i64; 3]; 2], mut visit: impl FnMut([i64; 3])) {
    for i in from[0]..=to[0] {
        for j in from[1]..=to[1] {
            (from[2]..=to[2]).for_each(|k| visit([i, j, k]));
        }
    }
}

/// Weights of the vertices of a cell at a point, which may lie outside.
fn candidate(mesh: &Mesh, kind: ElementKind, cell: u32, p: DVec3) -> Candidate {
    let nowhere = ([0.0; 10], f64::INFINITY);
    let Some(vertices) = mesh.cell(kind, cell as usize) else { return nowhere };
    let corner = |k: usize| mesh.points[vertices[k] as usize];
    if kind == ElementKind::Hexahedron {
        let corners: [DVec3; 8] = std::array::from_fn(corner);
        let (place, distance) = place_in_hexahedron(&corners, p);
        let mut weights = [0.0; 10];
        weights[..8].copy_from_slice(&trilinear(place));
        return (weights, distance);
    }
    let [a, b, c, d] = [0, 1, 2, 3].map(corner);
    let edges = DMat3::from_cols(b - a, c - a, d - a);
    if edges.determinant() == 0.0 {
        return nowhere;
    }
    let part = edges.inverse() * (p - a);
    let linear = [1.0 - part.element_sum(), part.x, part.y, part.z];
    let distance = if linear.iter().all(|w| *w >= -SLACK) {
        0.0
    } else {
        let inside = linear.map(|w| w.max(0.0));
        let sum: f64 = inside.iter().sum();
        p.distance((a * inside[0] + b * inside[1] + c * inside[2] + d * inside[3]) / sum)
    };
    let mut weights = [0.0; 10];
    if vertices.len() == 10 {
        (0..4).for_each(|k| weights[k] = linear[k] * (2.0 * linear[k] - 1.0));
        for (weight, [i, j]) in weights[4..].iter_mut().zip(MIDDLES) {
            *weight = 4.0 * linear[i] * linear[j];
        }
    } else {
        weights[..4].copy_from_slice(&linear);
    }
    (weights, distance)
}

fn trilinear(place: DVec3) -> [f64; 8] {
    let p = place.to_array();
    CUBE.map(|corner| (0..3).map(|k| if corner[k] == 1 { p[k] } else { 1.0 - p[k] }).product())
}

fn at_place(corners: &[DVec3; 8], place: DVec3) -> DVec3 {
    trilinear(place).iter().zip(corners).map(|(weight, corner)| *corner * *weight).sum()
}

/// Where in the unit cube a hexahedron has a point, and the distance (m) of the point from the hexahedron: 0 inside. Outside the place may
/// lie outside of the cube; it is the nearest that was found in the cube where none has the point.
pub fn place_in_hexahedron(corners: &[DVec3; 8], p: DVec3) -> (DVec3, f64) {
    let (place, found) = place_in(corners, p);
    let inside = place.clamp(DVec3::ZERO, DVec3::ONE);
    let distance = match found && (place - inside).abs().max_element() <= SLACK {
        true => 0.0,
        false => p.distance(at_place(corners, inside)),
    };
    (if found { place } else { inside }, distance)
}

/// Where in the unit cube a hexahedron has a point, by Newton's method, and whether that was found: the map may fold outside of
/// the cell.
fn place_in(corners: &[DVec3; 8], p: DVec3) -> (DVec3, bool) {
    let mut place = DVec3::splat(0.5);
    for _ in 0..30 {
        let jacobian = hexahedron_jacobian(corners, place.to_array());
        if determinant(jacobian) == 0.0 {
            break;
        }
        let [x, y, z] = jacobian;
        let step = DMat3::from_cols(x, y, z).inverse() * (p - at_place(corners, place));
        place = (place + step).clamp(DVec3::splat(-4.0), DVec3::splat(5.0));
        if step.abs().max_element() < 1e-12 {
            return (place, true);
        }
    }
    (place, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::{
        box_hexahedra, box_tets, cup_hexahedra, irregular_box_tets, sphere_triangles,
    };

    /// An affine motion of the body is that of every point, of second order a quadratic one too.
    #[test]
    fn motions_of_a_cell_are_those_of_its_points() {
        let size = DVec3::new(0.3, 0.2, 0.1);
        let tets = irregular_box_tets(size, [3, 2, 2], 0.15, 3).unwrap();
        let hexes = box_hexahedra(size, [3, 2, 2]).unwrap();
        let second = box_tets(size, [3, 2, 2]).unwrap().with_second_order();
        let inside: Vec<DVec3> = (0..50)
            .map(|i| DVec3::new(0.37, 0.61, 0.83) * f64::from(i))
            .map(|x| (x - x.floor()) * size)
            .collect();
        let matrix = DMat3::from_cols(
            DVec3::new(1.2, 0.3, -0.1),
            DVec3::new(0.0, 0.9, 0.4),
            DVec3::new(-0.2, 0.1, 1.1),
        );
        let affine = |p: DVec3| matrix * p;
        let quadratic = |p: DVec3| affine(p) + DVec3::new(p.x * p.y, p.z * p.z, p.x * p.z);
        for (mesh, motion, bound) in [
            (&tets, &affine as &dyn Fn(DVec3) -> DVec3, 1e-15),
            (&hexes, &affine, 1e-15),
            (&second, &quadratic, 1e-15),
        ] {
            let carried = EmbeddedPoints::new(mesh, &inside).unwrap();
            assert_eq!((carried.outside, carried.farthest), (0, 0.0));
            let of_vertices: Vec<DVec3> = mesh.points.iter().map(|p| motion(*p)).collect();
            for (u, p) in carried.displacements(&of_vertices).iter().zip(&inside) {
                assert!(u.distance(motion(*p)) < bound, "{u} at {p}");
            }
            assert_eq!(carried.cells().count(), 50);
        }
        // every point of a warped mesh is found in a cell
        let cup = cup_hexahedra([0.03, 0.05], 0.01, 8, 12, 2).unwrap();
        let all = EmbeddedPoints::new(&cup, &cup.points).unwrap();
        assert_eq!(all.outside, 0);
        let of_vertices: Vec<DVec3> = cup.points.iter().map(|p| p.powf(2.0)).collect();
        for (u, p) in all.displacements(&of_vertices).iter().zip(&of_vertices) {
            assert!(u.distance(*p) < 1e-12, "{u} beside {p}");
        }
    }

    #[test]
    fn points_outside_follow_the_nearest_cell() {
        let ball = sphere_triangles(0.05, 4).unwrap();
        let (lattice, _) = ball.lattice(0.012).unwrap();
        let carried = EmbeddedPoints::new(&lattice, &ball.points).unwrap();
        assert!(carried.outside > 0 && carried.farthest < 0.012, "{carried:?}");
        // turned as a whole, the surface is as before
        let turn = |p: DVec3| DVec3::new(-p.y, p.x, p.z) + DVec3::Y;
        let u: Vec<DVec3> = lattice.points.iter().map(|p| turn(*p) - *p).collect();
        for (u, p) in carried.displacements(&u).iter().zip(&ball.points) {
            assert!((*p + *u).distance(turn(*p)) < 1e-14);
        }
        // far away
        let away = EmbeddedPoints::new(&lattice, &[DVec3::new(9.0, 0.0, 0.0)]).unwrap();
        assert!((away.farthest - 8.95).abs() < 0.02, "{}", away.farthest);
        assert_eq!(EmbeddedPoints::new(&ball, &ball.points), None);
    }
}
