//! Components of elements with curved coordinates: hexahedra with trilinear, membrane quadrilaterals with
//! bilinear and ten-node tetrahedra with quadratic shape functions, the first two in the node order of Gmsh and VTK,
//! the last in that of VTK.
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
//! Energies are sums over 2x2x2 (2x2) Gauss points, each of weight 1, of ten-node tetrahedra over the
//! [four points](TETRAHEDRON_POINTS) of degree 2, each of weight 1/24. With `N_a` the shape functions,
//! `u_xi = sum_a dN_a/dxi u_a` and so on, and the rest edges `X_xi = sum_a dN_a/dxi X_a`, such a point
//! deforms as a tetrahedron (triangle) with the edges `X_xi, X_eta, X_zeta` whose first vertex stays in place
//! and whose others move by `u_xi, u_eta, u_zeta`. So every law that is written for those serves
//! quadrature points, with `det(X_xi, X_eta, X_zeta)` times the weight for its volume (`|X_xi x X_eta|` for its area).
//!
//! # Ten-node tetrahedra
//!
//! Vertices 0 to 3 are those of a [tetrahedron](crate::element), 4 to 9 lie on its edges 01, 12, 02, 03, 13, 23. With
//! barycentric coordinates `L` a corner has the shape function `L_a (2 L_a - 1)`, the middle of `ab` `4 L_a L_b`; local
//! coordinates are `L_1, L_2, L_3`. Positions have these shape functions too, so edges and faces may be curved.

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use crate::element::{TETRAHEDRON_FACES, index_columns, row_columns};
use crate::lanes::{Lanes, MAX_LANES};
use crate::scalar::{Real, Scalar, cross, dot, scale, sub};
use bevy_ecs::prelude::{Component, Resource};
use bytemuck::TransparentWrapper;

/// Pairs of local vertices of a hexahedron: all, in lexicographic order.
pub const HEXAHEDRON_PAIRS: [[usize; 2]; 28] = pairs();

/// Pairs of local vertices of a ten-node tetrahedron: all, in lexicographic order.
pub const TETRAHEDRON10_PAIRS: [[usize; 2]; 45] = pairs();

/// Ends of the edge on which each of the vertices 4 to 9 of a ten-node tetrahedron lies.
pub const MIDDLES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// The faces of a ten-node tetrahedron cut into flat triangles, four for each face of
/// [`TETRAHEDRON_FACES`]: three at its corners, then the one between its middles;
/// outward.
pub const TETRAHEDRON10_FACES: [[usize; 3]; 16] = {
    let mut result = [[0; 3]; 16];
    let mut face = 0;
    while face < 4 {
        let [a, b, c] = TETRAHEDRON_FACES[face];
        let [ab, bc, ca] = [middle_of(a, b), middle_of(b, c), middle_of(c, a)];
        result[4 * face] = [a, ab, ca];
        result[4 * face + 1] = [b, bc, ab];
        result[4 * face + 2] = [c, ca, bc];
        result[4 * face + 3] = [ab, bc, ca];
        face += 1;
    }
    result
};

/// Local vertex of a ten-node tetrahedron in the middle of the edge between two corners.
pub const fn middle_of(a: usize, b: usize) -> usize {
    let mut i = 0;
    while i < 6 {
        let [c, d] = MIDDLES[i];
        if (a == c && b == d) || (a == d && b == c) {
            return 4 + i;
        }
        i += 1;
    }
    a
}

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

/// Barycentric coordinates of the points of a ten-node tetrahedron: `5/20 + 3 sqrt 5/20` at the vertex of its number and
/// `5/20 - sqrt 5/20` at the others, exact for polynomials of second degree (Zienkiewicz & Taylor, The Finite Element
/// Method, table of quadrature for tetrahedra).
pub const TETRAHEDRON_POINTS: [[f64; 4]; 4] = {
    const NEAR: f64 = 0.585_410_196_624_968_5;
    const FAR: f64 = 0.138_196_601_125_010_5;
    let mut points = [[FAR; 4]; 4];
    let mut q = 0;
    while q < 4 {
        points[q][q] = NEAR;
        q += 1;
    }
    points
};

/// Shape functions of a ten-node tetrahedron at barycentric coordinates `l`.
pub const fn tetrahedron10_shape(l: [f64; 4]) -> [f64; 10] {
    let mut result = [0.0; 10];
    let mut a = 0;
    while a < 10 {
        result[a] = if a < 4 {
            l[a] * (2.0 * l[a] - 1.0)
        } else {
            4.0 * l[MIDDLES[a - 4][0]] * l[MIDDLES[a - 4][1]]
        };
        a += 1;
    }
    result
}

/// Derivatives of the shape functions of a ten-node tetrahedron by `L_1, L_2, L_3` at barycentric coordinates `l`.
pub const fn tetrahedron10_derivatives(l: [f64; 4]) -> [[f64; 3]; 10] {
    let mut result = [[0.0; 3]; 10];
    let mut a = 0;
    while a < 10 {
        // by all four coordinates, of which the first is 1 minus the others
        let mut by = [0.0; 4];
        if a < 4 {
            by[a] = 4.0 * l[a] - 1.0;
        } else {
            let [i, j] = MIDDLES[a - 4];
            by[i] = 4.0 * l[j];
            by[j] = 4.0 * l[i];
        }
        result[a] = [by[1] - by[0], by[2] - by[0], by[3] - by[0]];
        a += 1;
    }
    result
}

/// Parts of the mass of a ten-node tetrahedron that its corners and its middles get: the diagonal of its consistent mass
/// matrix with straight edges, scaled to the whole mass (Hinton, Rock & Zienkiewicz 1976, diagonal scaling). Row sums would
/// give corners minus a twentieth each, and no step in time can be taken with masses that are not positive. Weight is shared
/// out by row sums all the same ([`RestTetrahedron10::shape_volumes`]).
pub const TETRAHEDRON10_MASSES: [f64; 10] = {
    let (corner, middle) = (1.0 / 36.0, 4.0 / 27.0);
    let m = middle;
    [corner, corner, corner, corner, m, m, m, m, m, m]
};

/// Derivatives of shape functions at all quadrature points: `[vertex][direction][point]`.
#[derive(Clone, Copy, Debug)]
pub struct Derivatives<S, const N: usize, const D: usize, const Q: usize>(pub [[[S; Q]; D]; N]);

impl<S: Scalar, const N: usize, const D: usize, const Q: usize> Derivatives<S, N, D, Q> {
    fn of(at: impl Fn(usize) -> [[f64; D]; N]) -> Self {
        let mut table = [[[S::ZERO; Q]; D]; N];
        for q in 0..Q {
            for (a, d) in at(q).iter().enumerate() {
                for j in 0..D {
                    table[a][j][q] = S::from_f64(d[j]);
                }
            }
        }
        Self(table)
    }
}

impl<S: Scalar> Derivatives<S, 8, 3, 8> {
    /// Of hexahedra.
    pub fn hexahedron() -> Self {
        Self::of(|q| hexahedron_derivatives(gauss_point(q)))
    }

    /// Of hexahedra at their corners ([`CornerPoints`]).
    pub fn hexahedron_corners() -> Self {
        Self::of(|q| hexahedron_derivatives(CORNERS[q]))
    }
}

impl<S: Scalar> Derivatives<S, 10, 3, 4> {
    /// Of ten-node tetrahedra.
    pub fn tetrahedron10() -> Self {
        Self::of(|q| tetrahedron10_derivatives(TETRAHEDRON_POINTS[q]))
    }

    /// The same at the corners, of which each is next to the point of its number.
    pub fn tetrahedron10_corners() -> Self {
        Self::of(|q| tetrahedron10_derivatives([0, 1, 2, 3].map(|i| f64::from(u8::from(i == q)))))
    }
}

impl<S: Scalar> Derivatives<S, 4, 2, 4> {
    /// Of quadrilaterals.
    pub fn quad() -> Self {
        Self::of(|q| {
            let [x, y, _] = gauss_point(q);
            quad_derivatives([x, y])
        })
    }
}

impl<const N: usize, const D: usize, const Q: usize> Derivatives<f64, N, D, Q> {
    /// In the type of a simulation.
    #[cold]
    pub fn cast<S: Scalar>(&self) -> Derivatives<S, N, D, Q> {
        Derivatives(self.0.map(|vertex| vertex.map(|of| of.map(S::from_f64))))
    }
}

/// Derivatives of shape functions in elements that have points of their own, which is what cuts leave of them:
/// [`PointsRest::own`] tells which.
#[derive(Resource, Clone, Debug, Default)]
pub struct OwnPoints {
    /// Of ten-node tetrahedra.
    pub tens: Vec<Derivatives<f64, 10, 3, 4>>,
    /// Of hexahedra.
    pub bricks: Vec<Derivatives<f64, 8, 3, 8>>,
}

/// No element has points of its own.
pub static NO_OWN_POINTS: OwnPoints = OwnPoints { tens: Vec::new(), bricks: Vec::new() };

/// The derivatives for an element: those of all, or, as [`PointsRest::own`] says, one of a list, which is put into `slot`.
#[inline(always)]
pub fn derivatives_of<'s, S: Scalar, const N: usize, const D: usize, const Q: usize>(
    of_all: &'s Derivatives<S, N, D, Q>,
    list: &[Derivatives<f64, N, D, Q>],
    own: u32,
    slot: &'s mut Option<Derivatives<S, N, D, Q>>,
) -> &'s Derivatives<S, N, D, Q> {
    match own.checked_sub(1).and_then(|at| list.get(at as usize)) {
        None => of_all,
        Some(own) => slot.insert(own.cast()),
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

/// Vectors at the quadrature points from `first` on, from their entries.
#[inline(always)]
fn point_vectors<L: Lanes, const N: usize, const M: usize, const Q: usize>(
    entries: &[[L::Scalar; Q]; M],
    first: usize,
) -> [[L; 3]; N] {
    let mut vectors = [[L::ZERO; 3]; N];
    for i in 0..N {
        for x in 0..3 {
            vectors[i][x] = load_points(&entries[3 * i + x], first);
        }
    }
    vectors
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
    /// Vertex rows of a ten-node tetrahedron.
    Tetrahedron10Vertices([u32; 10]),
    /// Tangent blocks (edge-graph indices) of a ten-node tetrahedron in the order of [`TETRAHEDRON10_PAIRS`].
    Tetrahedron10Blocks([u32; 45]),
    /// Vertex rows of the hexahedron in which an axis lies.
    AxisHexahedronVertices([u32; 8]),
    /// Tangent blocks of that hexahedron, in the order of its pairs.
    AxisHexahedronBlocks([u32; 28]),
    /// Vertex rows of the ten-node tetrahedron in which an axis lies.
    AxisTetrahedron10Vertices([u32; 10]),
    /// Tangent blocks of that tetrahedron, in the order of its pairs.
    AxisTetrahedron10Blocks([u32; 45]),
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

/// Rest shape of a solid element at its `Q` Gauss points.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(summary_tick, clone_behavior = Ignore)]
pub struct PointsRest<S: Scalar, const Q: usize> {
    /// Entry `3 i + x` is component `x` of `D_i`, the gradient (1/m) of local coordinate `i` at every point:
    /// the shape vectors of the tetrahedra that stand for the points.
    pub gradients: [[S; Q]; 9],
    /// Volume (m^3) that each point stands for; 0 once the element is removed.
    pub volume: [S; Q],
    /// 0, or 1 plus the place in [`OwnPoints`] of the derivatives at points of its own.
    pub own: u32,
}

/// Marks hexahedra whose [`PointsRest`] stands for their corners in place of Gauss points. Their energy does not see single
/// points, so a corner can fold while the deformation in the middle is sound: whoever counts inverted elements looks there.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[component(clone_behavior = Ignore)]
pub struct CornerPoints;

/// Rest shape of a hexahedron at its Gauss points, or at its corners ([`CornerPoints`]).
pub type HexahedronRest<S> = PointsRest<S, 8>;
/// Rest shape of a ten-node tetrahedron at its Gauss points.
pub type Tetrahedron10Rest<S> = PointsRest<S, 4>;

impl<S: Scalar, const Q: usize> PointsRest<S, Q> {
    /// Shape vectors of the points from `first` on.
    #[inline(always)]
    pub fn gradients<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 3] {
        point_vectors(&self.gradients, first)
    }

    /// In `f64`.
    pub fn in_f64(&self) -> PointsRest<f64, Q> {
        PointsRest {
            gradients: self.gradients.map(|row| row.map(S::to_f64)),
            volume: self.volume.map(S::to_f64),
            own: self.own,
        }
    }
}

/// A hexahedron, ten-node tetrahedron or quadrilateral whose rest shape cannot be used.
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
    /// Somewhere a ten-node tetrahedron is turned inside out or flat.
    #[error(
        "its curved rest shape is folded or flat at {place} (Jacobian {ratio:.2e} times that of its corners): move \
         the vertices on its edges towards their middles, list them in the order of the file format, or straighten \
         the edges"
    )]
    Folded {
        /// Where.
        place: &'static str,
        /// Jacobian there over six times the volume of the tetrahedron of its corners.
        ratio: f64,
    },
    /// A coordinate is no number.
    #[error("a coordinate of its vertices is not finite")]
    NotFinite,
}

/// Rest shape of a solid element with `Q` Gauss points in `f64`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestPoints<const Q: usize> {
    /// Gradients (1/m) of the local coordinates at the Gauss points.
    pub gradients: [[[f64; 3]; 3]; Q],
    /// Volume (m^3) that each Gauss point stands for.
    pub volume: [f64; Q],
}

/// Rest shape of a hexahedron in `f64`.
pub type RestHexahedron = RestPoints<8>;
/// Rest shape of a ten-node tetrahedron in `f64`.
pub type RestTetrahedron10 = RestPoints<4>;

impl<const Q: usize> RestPoints<Q> {
    const NOTHING: Self = Self { gradients: [[[0.0; 3]; 3]; Q], volume: [0.0; Q] };

    /// Takes a point with the edges (m) and the weight.
    fn put(&mut self, q: usize, [a, b, c]: [[f64; 3]; 3], weight: f64) {
        let volume = dot(a, cross(b, c));
        self.volume[q] = weight * volume;
        self.gradients[q] = [cross(b, c), cross(c, a), cross(a, b)].map(|d| scale(d, 1.0 / volume));
    }

    /// Volume (m^3), that of hexahedra exact: the integrand is of second degree in each coordinate. So is that of ten-node
    /// tetrahedra with straight edges.
    pub fn total_volume(&self) -> f64 {
        self.volume.iter().sum()
    }

    /// As a component.
    pub fn component<S: Scalar>(&self) -> PointsRest<S, Q> {
        let mut rest = PointsRest { gradients: [[S::ZERO; Q]; 9], volume: [S::ZERO; Q], own: 0 };
        for q in 0..Q {
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

/// Edges `X_xi`, `X_eta` and so on (m) from derivatives of shape functions and positions (m).
fn edges_of<const N: usize, const D: usize>(
    derivatives: [[f64; D]; N],
    points: &[[f64; 3]; N],
) -> [[f64; 3]; D] {
    let mut edges = [[0.0; 3]; D];
    for (d, p) in derivatives.iter().zip(points) {
        for j in 0..D {
            for x in 0..3 {
                edges[j][x] += d[j] * (p[x] - points[0][x]);
            }
        }
    }
    edges
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
        let mut rest = Self::NOTHING;
        for q in 0..8 {
            for (at, inside) in [(CORNERS[q], false), (gauss_point(q), true)] {
                let edges = edges_of(hexahedron_derivatives(at), &points);
                let [a, b, c] = edges;
                let volume = dot(a, cross(b, c));
                let lengths = (dot(a, a) * dot(b, b) * dot(c, c)).sqrt();
                let ratio = if lengths > 0.0 { volume / lengths } else { 0.0 };
                if !(ratio > FLAT && volume > 0.0) {
                    return Err(RestShapeError::Degenerate { corner: q, ratio });
                }
                if inside {
                    rest.put(q, edges, 1.0);
                }
            }
        }
        Ok(rest)
    }

    /// Gradients at the corners (m) in place of the Gauss points, with volumes in the ratio of the Jacobians there that add up to
    /// the same as those of the Gauss points.
    pub fn at_corners(&self, points: &[[f64; 3]; 8]) -> Self {
        let mut rest = Self::NOTHING;
        for q in 0..8 {
            rest.put(q, edges_of(hexahedron_derivatives(CORNERS[q]), points), 1.0);
        }
        let factor = self.total_volume() / rest.total_volume();
        rest.volume = rest.volume.map(|volume| factor * volume);
        rest
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
}

impl RestTetrahedron10 {
    /// From the vertices (m), in the order of VTK.
    ///
    /// # Errors
    /// When the Jacobian is not positive at some vertex or Gauss point.
    pub fn new(points: [[f64; 3]; 10]) -> Result<Self, RestShapeError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(RestShapeError::NotFinite);
        }
        if let Some((place, ratio)) = folded_tetrahedron(&points) {
            return Err(RestShapeError::Folded { place, ratio });
        }
        let mut rest = Self::NOTHING;
        for (q, l) in TETRAHEDRON_POINTS.into_iter().enumerate() {
            rest.put(q, edges_of(tetrahedron10_derivatives(l), &points), 1.0 / 24.0);
        }
        Ok(rest)
    }

    /// Volume (m^3) of every vertex as masses are lumped: [`TETRAHEDRON10_MASSES`] of the whole.
    pub fn vertex_volumes(&self) -> [f64; 10] {
        let whole = self.total_volume();
        TETRAHEDRON10_MASSES.map(|share| share * whole)
    }

    /// Volume (m^3) of every vertex as its shape function gives it, `int N_a dV`: what forces by volume are shared out by. Where
    /// edges are straight, middles have a fifth each and corners minus a twentieth.
    pub fn shape_volumes(&self) -> [f64; 10] {
        let mut volumes = [0.0; 10];
        for (&volume, l) in self.volume.iter().zip(TETRAHEDRON_POINTS) {
            for (v, n) in volumes.iter_mut().zip(tetrahedron10_shape(l)) {
                *v += n * volume;
            }
        }
        volumes
    }
}

/// Places at which the Jacobian of a ten-node tetrahedron is looked at beside its vertices.
const PLACES: [&str; 14] = [
    "corner 0",
    "corner 1",
    "corner 2",
    "corner 3",
    "the vertex on edge 01",
    "the vertex on edge 12",
    "the vertex on edge 02",
    "the vertex on edge 03",
    "the vertex on edge 13",
    "the vertex on edge 23",
    "Gauss point 0",
    "Gauss point 1",
    "Gauss point 2",
    "Gauss point 3",
];

/// Where a ten-node tetrahedron with these vertices (m) is folded, if it is: the place with the smallest Jacobian, and that over
/// six times the volume of the tetrahedron of its corners. Where that volume is 0, edges are measured instead.
pub fn folded_tetrahedron(points: &[[f64; 3]; 10]) -> Option<(&'static str, f64)> {
    let [a, b, c] = [1, 2, 3].map(|i| sub(points[i], points[0]));
    let whole = dot(a, cross(b, c));
    let lengths = (dot(a, a) * dot(b, b) * dot(c, c)).sqrt();
    let whole = if whole > FLAT * lengths { whole } else { lengths };
    let ratio = |place: usize| {
        let l = match place {
            0..4 => std::array::from_fn(|i| f64::from(u8::from(i == place))),
            4..10 => {
                std::array::from_fn(|i| if MIDDLES[place - 4].contains(&i) { 0.5 } else { 0.0 })
            }
            _ => TETRAHEDRON_POINTS[place - 10],
        };
        let [a, b, c] = edges_of(tetrahedron10_derivatives(l), points);
        if whole > 0.0 { dot(a, cross(b, c)) / whole } else { 0.0 }
    };
    let (place, ratio) = (0..PLACES.len())
        .map(|place| (PLACES[place], ratio(place)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    (ratio.is_nan() || ratio <= FLAT).then_some((place, ratio))
}

/// Derivatives by the local coordinates of a nodal field at the points from `first` on, in the form of the
/// tetrahedra (triangles) that stand for the points, whose number of vertices is `C`: entry 0 is 0. `u` is taken
/// relative to its first row, so that a translation costs no digits.
#[inline(always)]
pub fn point_differences<L, const C: usize, const N: usize, const D: usize, const Q: usize>(
    derivatives: &Derivatives<L::Scalar, N, D, Q>,
    u: &[[L::Scalar; 3]; N],
    first: usize,
) -> [[L; 3]; C]
where
    L: Lanes,
{
    const { assert!(C == D + 1) };
    let mut result = [[L::ZERO; 3]; C];
    for a in 1..N {
        let relative = sub(u[a], u[0]).map(L::splat);
        for j in 0..D {
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
#[component(summary_tick, clone_behavior = Ignore)]
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
        point_vectors(&self.edges, first)
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
        let edges = |at: [f64; 2]| edges_of(quad_derivatives(at), &points);
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
