//! What contact needs to know of the surface of a body: its faces, and how stiff it is there. Whoever builds bodies
//! says how to find that out; nothing is computed before somebody asks.

use crate::row::{MeshVertex, VertexRow};
use bevy_ecs::prelude::{Resource, World};
use glam::DVec3;

/// A point of a surface that is no vertex, such as one of a wound: a mean of the vertices of an element.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfacePoint {
    /// Rows of the element.
    pub rows: [u32; 10],
    /// Their shares, which add up to 1; those that elements have fewer come last, without any.
    pub weights: [f64; 10],
}

impl SurfacePoint {
    /// One that a row moves alone.
    pub fn of_row(row: u32) -> Self {
        let mut own = Self::default();
        (own.rows[0], own.weights[0]) = (row, 1.0);
        own
    }

    /// The rows that have a share, with these.
    pub fn shares(&self) -> impl Iterator<Item = (u32, f64)> + use<> {
        self.rows.into_iter().zip(self.weights).filter(|(_, weight)| *weight != 0.0)
    }
}

/// The surface of what is left of a body. Rows are relative to the first vertex row of the body; corners of triangles that are
/// no row of the body are `points`: the first of them has the number of the rows of the body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BodySurface {
    /// Points that cuts made, by their numbers in the material; those that are no corner have no weights.
    pub points: Vec<SurfacePoint>,
    /// Outside triangles of the solid, outward.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles up to here were laid open by cuts.
    pub wounds: usize,
    /// Triangles from here on are two and two the halves `[a, b, c]`, `[a, c, d]` of faces with four corners.
    pub halves: usize,
    /// Triangles of membranes.
    pub sheets: Vec<[u32; 3]>,
    /// Triangles of membranes from here on are halves of quadrilaterals, as those of the solid are.
    pub sheet_halves: usize,
    /// Young's modulus (Pa) round every vertex, then of every point: mean of its solid elements; in a membrane the modulus times the
    /// thickness over the mean edge, which resists pressure alike.
    pub young_modulus: Vec<f64>,
}

/// Finds the surface of a body, by its index in [`Topology::bodies`](crate::topology::Topology::bodies).
#[derive(Resource, Clone, Copy, Debug)]
pub struct SurfaceReader(pub fn(&mut World, usize) -> BodySurface);

/// Vertex rows of a point in tissue, and their weights.
pub type TissuePoint = ([VertexRow; 4], [f64; 4]);

/// Finds the rows that move a point of the material of a body of solid elements now: the element of the mesh that it lies
/// in, four vertices of that and their weights. None where that element is gone.
#[derive(Resource, Clone, Copy, Debug)]
pub struct PointReader(
    pub fn(&World, body: usize, element: u32, ([MeshVertex; 4], [f64; 4])) -> Option<TissuePoint>,
);

/// Closest point of a triangle to `p` as barycentric coordinates (Ericson, Real-Time Collision Detection, 2005,
/// section 5.1.5).
#[inline]
pub fn closest_point(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = va + vb + vc;
    if sum <= 0.0 || sum.is_nan() {
        // a face that was drawn out to a line or point
        return [1.0, 0.0, 0.0];
    }
    [va / sum, vb / sum, vc / sum]
}
