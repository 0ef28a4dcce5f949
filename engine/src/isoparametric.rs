//! Components of elements with curved coordinates: hexahedra with trilinear and membrane
//! quadrilaterals with bilinear shape functions, in the node order of Gmsh and VTK.
//!
//! ```text
//!        7-------6            3-------2        corner a of the hexahedron lies at
//!       /|      /|            |       |        (xi, eta, zeta) = (+-1, +-1, +-1)
//!      4-------5 |            |       |
//!      | 3-----|-2            0-------1        zeta
//!      |/      |/                               | eta
//!      0-------1                                |/
//!                                               +--xi
//! ```
//!
//! Energies are sums over 2x2x2 (2x2) Gauss points, each of weight 1. With `N_a` the shape functions,
//! `u_xi = sum_a dN_a/dxi u_a` and so on, and the rest edges `X_xi = sum_a dN_a/dxi X_a`, such a point
//! deforms as a tetrahedron (triangle) with the edges `X_xi, X_eta, X_zeta` whose first vertex stays in place
//! and whose others move by `u_xi, u_eta, u_zeta`. So every law that is written for those serves
//! quadrature points, with `det(X_xi, X_eta, X_zeta)` for its volume (`|X_xi x X_eta|` for its area).

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use crate::element::{index_columns, row_columns};
use crate::lanes::{Lanes, MAX_LANES};
use crate::scalar::{Real, Scalar, cross, dot, scale, sub};
use bevy_ecs::prelude::Component;
use bytemuck::TransparentWrapper;

/// Pairs of local vertices of a hexahedron: all, in lexicographic order.
pub const HEXAHEDRON_PAIRS: [[usize; 2]; 28] = pairs();

/// Pairs of local vertices of a quadrilateral: all, in lexicographic order.
pub const QUAD_PAIRS: [[usize; 2]; 6] = pairs();

const fn pairs<const N: usize>() -> [[usize; 2]; N] {
    let mut pairs = [[0, 1]; N];
    let mut i = 1;
    while i < N {
        let [a, b] = pairs[i - 1];
        // the number of vertices n follows from N = n (n - 1) / 2
        pairs[i] = if b + 1 < vertices(N) { [a, b + 1] } else { [a + 1, a + 2] };
        i += 1;
    }
    pairs
}

const fn vertices(pairs: usize) -> usize {
    let mut n = 2;
    while n * (n - 1) / 2 < pairs {
        n += 1;
    }
    n
}

/// Local vertices of the six faces of a hexahedron, counter-clockwise seen from outside.
pub const HEXAHEDRON_FACES: [[usize; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

/// Local coordinates of the corners of a hexahedron; the first four, without the last coordinate, are those
/// of a quadrilateral.
pub const CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

/// Distance of the Gauss points from the middle, 1/sqrt(3); point `q` lies in the direction of corner `q`.
pub const GAUSS: f64 = 0.577_350_269_189_625_8;

/// Derivatives of the shape functions of a hexahedron at a place in local coordinates.
pub const fn hexahedron_derivatives(at: [f64; 3]) -> [[f64; 3]; 8] {
    let mut result = [[0.0; 3]; 8];
    let mut a = 0;
    while a < 8 {
        let [x, y, z] = CORNERS[a];
        let [fx, fy, fz] = [1.0 + x * at[0], 1.0 + y * at[1], 1.0 + z * at[2]];
        result[a] = [0.125 * x * fy * fz, 0.125 * fx * y * fz, 0.125 * fx * fy * z];
        a += 1;
    }
    result
}

/// Derivatives of the shape functions of a quadrilateral at a place in local coordinates.
pub const fn quad_derivatives(at: [f64; 2]) -> [[f64; 2]; 4] {
    let mut result = [[0.0; 2]; 4];
    let mut a = 0;
    while a < 4 {
        let [x, y, _] = CORNERS[a];
        result[a] = [0.25 * x * (1.0 + y * at[1]), 0.25 * (1.0 + x * at[0]) * y];
        a += 1;
    }
    result
}

/// Shape functions of a hexahedron at a place in local coordinates.
pub const fn hexahedron_shape(at: [f64; 3]) -> [f64; 8] {
    let mut result = [0.0; 8];
    let mut a = 0;
    while a < 8 {
        let [x, y, z] = CORNERS[a];
        result[a] = 0.125 * (1.0 + x * at[0]) * (1.0 + y * at[1]) * (1.0 + z * at[2]);
        a += 1;
    }
    result
}

/// Shape functions of a quadrilateral at a place in local coordinates.
pub const fn quad_shape(at: [f64; 2]) -> [f64; 4] {
    let mut result = [0.0; 4];
    let mut a = 0;
    while a < 4 {
        let [x, y, _] = CORNERS[a];
        result[a] = 0.25 * (1.0 + x * at[0]) * (1.0 + y * at[1]);
        a += 1;
    }
    result
}

/// Local coordinates of Gauss point `q` of a hexahedron; the first two of the first four points are those
/// of a quadrilateral.
pub const fn gauss_point(q: usize) -> [f64; 3] {
    let [x, y, z] = CORNERS[q];
    [GAUSS * x, GAUSS * y, GAUSS * z]
}

/// Derivatives of shape functions at all quadrature points: `[vertex][direction][point]`.
#[derive(Clone, Copy, Debug)]
pub struct Derivatives<S, const N: usize, const D: usize>(pub [[[S; N]; D]; N]);

impl<S: Scalar> Derivatives<S, 8, 3> {
    /// Of hexahedra.
    pub fn hexahedron() -> Self {
        let mut table = [[[S::ZERO; 8]; 3]; 8];
        for q in 0..8 {
            for (a, d) in hexahedron_derivatives(gauss_point(q)).iter().enumerate() {
                for j in 0..3 {
                    table[a][j][q] = S::from_f64(d[j]);
                }
            }
        }
        Self(table)
    }
}

impl<S: Scalar> Derivatives<S, 4, 2> {
    /// Of quadrilaterals.
    pub fn quad() -> Self {
        let mut table = [[[S::ZERO; 4]; 2]; 4];
        for q in 0..4 {
            let [x, y, _] = gauss_point(q);
            for (a, d) in quad_derivatives([x, y]).iter().enumerate() {
                for j in 0..2 {
                    table[a][j][q] = S::from_f64(d[j]);
                }
            }
        }
        Self(table)
    }
}

/// Quadrature points from `first` on; where they do not fill the register the last one is repeated.
#[inline(always)]
pub fn load_points<L: Lanes, const N: usize>(of: &[L::Scalar; N], first: usize) -> L {
    if first + L::COUNT <= N {
        return L::load(&of[first..]);
    }
    let mut padded = [of[N - 1]; MAX_LANES];
    padded[..N - first].copy_from_slice(&of[first..]);
    L::load(&padded)
}

/// Weights of quadrature points from `first` on; 0 where there are no more.
#[inline(always)]
pub fn load_weights<L: Lanes, const N: usize>(of: &[L::Scalar; N], first: usize) -> L {
    if first + L::COUNT <= N {
        return L::load(&of[first..]);
    }
    let mut padded = [L::Scalar::ZERO; MAX_LANES];
    padded[..N - first].copy_from_slice(&of[first..]);
    L::load(&padded)
}

row_columns! {
    /// Vertex rows of a hexahedron.
    HexahedronVertices([u32; 8]),
    /// Tangent blocks (edge-graph indices) of a hexahedron in the order of [`HEXAHEDRON_PAIRS`].
    HexahedronBlocks([u32; 28]),
    /// Vertex rows of the hexahedron in which an axis lies.
    AxisHexahedronVertices([u32; 8]),
    /// Tangent blocks of that hexahedron, in the order of its pairs.
    AxisHexahedronBlocks([u32; 28]),
    /// Vertex rows of a membrane quadrilateral, counter-clockwise.
    QuadVertices([u32; 4]),
    /// Tangent blocks (edge-graph indices) of a membrane quadrilateral in the order of [`QUAD_PAIRS`].
    QuadBlocks([u32; 6]),
}

index_columns! {
    /// Index of the hexahedron in the mesh that the user gave.
    HexahedronIndex,
    /// Index of that hexahedron in the mesh that the user gave.
    AxisHexahedron,
    /// Index of the membrane quadrilateral in the list that the user gave.
    QuadIndex,
}

/// Rest shape of a hexahedron at its Gauss points.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick)]
pub struct HexahedronRest<S: Scalar> {
    /// Entry `3 i + x` is component `x` of `D_i`, the gradient (1/m) of local coordinate `i` at every point:
    /// the shape vectors of the tetrahedra that stand for the points.
    pub gradients: [[S; 8]; 9],
    /// Volume (m^3) that each point stands for; 0 once the element is removed.
    pub volume: [S; 8],
}

impl<S: Scalar> HexahedronRest<S> {
    /// Shape vectors of the points from `first` on.
    #[inline(always)]
    pub fn gradients<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        let mut d = [[L::ZERO; 3]; 3];
        for i in 0..3 {
            for x in 0..3 {
                d[i][x] = load_points(&self.gradients[3 * i + x], first);
            }
        }
        d
    }
}

/// A hexahedron or quadrilateral whose rest shape cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RestShapeError {
    /// Somewhere the element is turned inside out or flat.
    #[error(
        "its rest shape is flat or turned inside out near corner {corner} (ratio {ratio:.2e} to the \
         product of the edges there): move the vertex so that the corner is convex"
    )]
    Degenerate {
        /// Local corner nearest to the place.
        corner: usize,
        /// Jacobian there over the product of the three (two) edge lengths.
        ratio: f64,
    },
    /// A coordinate is no number.
    #[error("a coordinate of its vertices is not finite")]
    NotFinite,
}

/// Rest shape of a hexahedron in `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestHexahedron {
    /// Gradients (1/m) of the local coordinates at the Gauss points.
    pub gradients: [[[f64; 3]; 3]; 8],
    /// Volume (m^3) that each Gauss point stands for.
    pub volume: [f64; 8],
}

/// Smallest Jacobian over the product of edge lengths that counts as a shape.
const FLAT: f64 = 1e-12;

impl RestHexahedron {
    /// From the corners (m).
    ///
    /// # Errors
    /// When the Jacobian is not positive at some corner or Gauss point.
    pub fn new(points: [[f64; 3]; 8]) -> Result<Self, RestShapeError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(RestShapeError::NotFinite);
        }
        let edges = |at: [f64; 3]| {
            let mut edges = [[0.0; 3]; 3];
            for (d, p) in hexahedron_derivatives(at).iter().zip(&points) {
                for j in 0..3 {
                    for x in 0..3 {
                        edges[j][x] += d[j] * (p[x] - points[0][x]);
                    }
                }
            }
            edges
        };
        let mut rest = Self { gradients: [[[0.0; 3]; 3]; 8], volume: [0.0; 8] };
        for q in 0..8 {
            for (at, inside) in [(CORNERS[q], false), (gauss_point(q), true)] {
                let [a, b, c] = edges(at);
                let volume = dot(a, cross(b, c));
                let lengths = (dot(a, a) * dot(b, b) * dot(c, c)).sqrt();
                let ratio = if lengths > 0.0 { volume / lengths } else { 0.0 };
                if !(ratio > FLAT && volume > 0.0) {
                    return Err(RestShapeError::Degenerate { corner: q, ratio });
                }
                if inside {
                    rest.volume[q] = volume;
                    rest.gradients[q] =
                        [cross(b, c), cross(c, a), cross(a, b)].map(|d| scale(d, 1.0 / volume));
                }
            }
        }
        Ok(rest)
    }

    /// Volume (m^3): exact, the integrand is of second degree in each coordinate.
    pub fn total_volume(&self) -> f64 {
        self.volume.iter().sum()
    }

    /// Volume (m^3) of every vertex, `int N_a dV` (row sums of the mass matrix over the density).
    pub fn vertex_volumes(&self) -> [f64; 8] {
        let mut volumes = [0.0; 8];
        for q in 0..8 {
            for (v, n) in volumes.iter_mut().zip(hexahedron_shape(gauss_point(q))) {
                *v += n * self.volume[q];
            }
        }
        volumes
    }

    /// As a component.
    pub fn component<S: Scalar>(&self) -> HexahedronRest<S> {
        let mut rest = HexahedronRest { gradients: [[S::ZERO; 8]; 9], volume: [S::ZERO; 8] };
        for q in 0..8 {
            rest.volume[q] = S::from_f64(self.volume[q]);
            for i in 0..3 {
                for x in 0..3 {
                    rest.gradients[3 * i + x][q] = S::from_f64(self.gradients[q][i][x]);
                }
            }
        }
        rest
    }
}

/// Derivatives by the local coordinates of a nodal field at the points from `first` on, in the form of the
/// tetrahedra that stand for the points: entry 0 is 0. `u` is taken relative to its first row, so that
/// a translation costs no digits.
#[inline(always)]
pub fn hexahedron_differences<L: Lanes>(
    derivatives: &Derivatives<L::Scalar, 8, 3>,
    u: &[[L::Scalar; 3]; 8],
    first: usize,
) -> [[L; 3]; 4] {
    let mut result = [[L::ZERO; 3]; 4];
    for a in 1..8 {
        let relative = sub(u[a], u[0]).map(L::splat);
        for j in 0..3 {
            let d: L = load_points(&derivatives.0[a][j], first);
            for x in 0..3 {
                result[j + 1][x] = d.mul_add(relative[x], result[j + 1][x]);
            }
        }
    }
    result
}

/// Rest shape of a membrane quadrilateral at its Gauss points.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick)]
pub struct QuadRest<S: Scalar> {
    /// Entry `3 j + x` is component `x` of the rest edge `X_xi` (`j = 0`) or `X_eta` (m) at every point.
    pub edges: [[S; 4]; 6],
    /// Half of `|X_xi x X_eta|` (m^2): area of the triangles that stand for the points, half of what a
    /// point stands for. Stays when the element is removed.
    pub half_area: [S; 4],
}

impl<S: Scalar> QuadRest<S> {
    /// Rest edges of the points from `first` on.
    #[inline(always)]
    pub fn edges<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 2] {
        let mut edges = [[L::ZERO; 3]; 2];
        for j in 0..2 {
            for x in 0..3 {
                edges[j][x] = load_points(&self.edges[3 * j + x], first);
            }
        }
        edges
    }
}

/// Rest shape of a membrane quadrilateral in `f64`. It may be warped: every Gauss point has its own plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestQuad {
    /// Rest edges `X_xi`, `X_eta` (m) at the Gauss points.
    pub edges: [[[f64; 3]; 2]; 4],
    /// Area (m^2) that each Gauss point stands for.
    pub area: [f64; 4],
}

impl RestQuad {
    /// From the corners (m).
    ///
    /// # Errors
    /// When the quadrilateral is flat or folded at some corner.
    pub fn new(points: [[f64; 3]; 4]) -> Result<Self, RestShapeError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(RestShapeError::NotFinite);
        }
        let edges = |at: [f64; 2]| {
            let mut edges = [[0.0; 3]; 2];
            for (d, p) in quad_derivatives(at).iter().zip(&points) {
                for j in 0..2 {
                    for x in 0..3 {
                        edges[j][x] += d[j] * (p[x] - points[0][x]);
                    }
                }
            }
            edges
        };
        let [a, b] = edges([0.0, 0.0]);
        let middle = cross(a, b);
        let mut rest = Self { edges: [[[0.0; 3]; 2]; 4], area: [0.0; 4] };
        for q in 0..4 {
            let [x, y, _] = CORNERS[q];
            let [a, b] = edges([x, y]);
            let normal = cross(a, b);
            let lengths = (dot(a, a) * dot(b, b) * dot(middle, middle)).sqrt();
            let ratio = if lengths > 0.0 { dot(normal, middle) / lengths } else { 0.0 };
            if ratio.is_nan() || ratio <= FLAT {
                return Err(RestShapeError::Degenerate { corner: q, ratio });
            }
            let [x, y, _] = gauss_point(q);
            rest.edges[q] = edges([x, y]);
            let normal = cross(rest.edges[q][0], rest.edges[q][1]);
            rest.area[q] = dot(normal, normal).sqrt();
        }
        Ok(rest)
    }

    /// Area (m^2).
    pub fn total_area(&self) -> f64 {
        self.area.iter().sum()
    }

    /// Area (m^2) of every vertex, `int N_a dA`.
    pub fn vertex_areas(&self) -> [f64; 4] {
        let mut areas = [0.0; 4];
        for q in 0..4 {
            let [x, y, _] = gauss_point(q);
            for (v, n) in areas.iter_mut().zip(quad_shape([x, y])) {
                *v += n * self.area[q];
            }
        }
        areas
    }

    /// As a component.
    pub fn component<S: Scalar>(&self) -> QuadRest<S> {
        let mut rest = QuadRest { edges: [[S::ZERO; 4]; 6], half_area: [S::ZERO; 4] };
        for q in 0..4 {
            rest.half_area[q] = S::from_f64(0.5 * self.area[q]);
            for j in 0..2 {
                for x in 0..3 {
                    rest.edges[3 * j + x][q] = S::from_f64(self.edges[q][j][x]);
                }
            }
        }
        rest
    }
}

/// Derivatives by the local coordinates of a nodal field at the points from `first` on, in the form of the
/// triangles that stand for the points; as [`hexahedron_differences`].
#[inline(always)]
pub fn quad_differences<L: Lanes>(
    derivatives: &Derivatives<L::Scalar, 4, 2>,
    u: &[[L::Scalar; 3]; 4],
    first: usize,
) -> [[L; 3]; 3] {
    let mut result = [[L::ZERO; 3]; 3];
    for a in 1..4 {
        let relative = sub(u[a], u[0]).map(L::splat);
        for j in 0..2 {
            let d: L = load_points(&derivatives.0[a][j], first);
            for x in 0..3 {
                result[j + 1][x] = d.mul_add(relative[x], result[j + 1][x]);
            }
        }
    }
    result
}

/// First three entries of the rows of some vertices.
#[inline(always)]
pub fn rows_of<S: Scalar, const N: usize>(rows: &[[S; 4]], nodes: &[u32; N]) -> [[S; 3]; N] {
    let mut result = [[S::ZERO; 3]; N];
    for a in 0..N {
        let row = rows[nodes[a] as usize];
        result[a] = [row[0], row[1], row[2]];
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_all_pairs() {
        assert_eq!(QUAD_PAIRS, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
        assert_eq!(HEXAHEDRON_PAIRS[0], [0, 1]);
        assert_eq!(HEXAHEDRON_PAIRS[7], [1, 2]);
        assert_eq!(HEXAHEDRON_PAIRS[27], [6, 7]);
        let mut all = HEXAHEDRON_PAIRS.to_vec();
        all.dedup();
        assert!(all.len() == 28 && all.iter().all(|[a, b]| a < b && *b < 8));
    }

    fn brick() -> [[f64; 3]; 8] {
        CORNERS.map(|[x, y, z]| [x + 1.0, 1.5 * (y + 1.0), 2.0 * (z + 1.0)])
    }

    #[test]
    fn a_brick_has_its_volume() {
        let rest = RestHexahedron::new(brick()).unwrap();
        assert!((rest.total_volume() - 24.0).abs() < 1e-12);
        assert!(rest.vertex_volumes().iter().all(|v| (v - 3.0).abs() < 1e-12));
        // gradient of xi along x: 2 over the side of 2
        assert!(rest.gradients.iter().all(|d| (d[0][0] - 1.0).abs() < 1e-14));
        let mut mirrored = brick();
        mirrored.swap(0, 1);
        mirrored.swap(2, 3);
        let error = RestHexahedron::new(mirrored).unwrap_err();
        assert!(matches!(error, RestShapeError::Degenerate { .. }), "{error}");
        let mut pushed = brick();
        pushed[6] = [0.5, 0.5, 0.5];
        assert!(matches!(RestHexahedron::new(pushed), Err(RestShapeError::Degenerate { .. })));
    }

    #[test]
    fn faces_turn_outward() {
        let p = brick();
        for [a, b, c, d] in HEXAHEDRON_FACES {
            let normal = cross(sub(p[c], p[a]), sub(p[d], p[b]));
            assert!(dot(normal, sub(p[a], [1.0, 1.5, 2.0])) > 0.0);
        }
    }

    #[test]
    fn a_warped_quad_has_area_and_a_folded_one_none() {
        let flat = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let rest = RestQuad::new(flat).unwrap();
        assert!((rest.total_area() - 2.0).abs() < 1e-14);
        assert!(rest.vertex_areas().iter().all(|a| (a - 0.5).abs() < 1e-14));
        let mut warped = flat;
        warped[2][2] = 0.5;
        assert!(RestQuad::new(warped).unwrap().total_area() > 2.0);
        let mut folded = flat;
        folded[2] = [0.2, 0.2, 0.0];
        assert!(RestQuad::new(folded).is_err());
    }
}
