//! What a tetrahedron needs from its rest shape and material, computed once in `f64`.
//!
//! With `Dm = [X1-X0, X2-X0, X3-X0]` as columns, the shape vectors `D_1`, `D_2`, `D_3` are the rows
//! of `Dm^-1` and `D_0 = -(D_1 + D_2 + D_3)`: the gradients of the barycentric coordinates, in 1/m.
//! (Delingette 2008, section 3, prints a formula with `(-1)^i`, which holds for indices counted
//! from 1 and a positively oriented tetrahedron.)
//!
//! With `G_ij = D_i . D_j` and rest volume `V`, the St Venant-Kirchhoff energy equals a sum over 6
//! tensile, 12 angular and 3 volumetric springs on squared-length changes `delta`, each unordered
//! pair counted once (Delingette 2008, section 3, "tetrahedral biquadratic springs"; the printed
//! sums over `i != j` must be read that way):
//!
//! ```text
//! W = sum_6 k/4 delta_ij^2 + sum_12 c/2 delta_ij delta_ik + sum_3 d/2 delta_ij delta_kl
//! k_ij    = V/2 ((lambda + mu) G_ij^2    + mu G_ii G_jj)
//! c_i,jk  = V/2 ((lambda + mu) G_ij G_ik + mu G_ii G_jk)
//! d_ij,kl = V/2 (lambda G_ij G_kl + mu (G_ik G_jl + G_il G_jk))
//! ```
//!
//! Units: N/m^3 for `k`, `c` and `d`. `k` is positive; `c` and `d` take both signs.
//!
//! Fibres along the unit vector `a` with the energy `V Y/2 (a.E a)^2`, `E` being the Green-Lagrange strain, are springs
//! of the same kind, since `a.E a = -1/2 sum_6 s_ij delta_ij` with `s_ij = (a.D_i) (a.D_j)`. They add to those of the
//! material ([`SpringConstants::add_fibre`]), which so becomes transversely isotropic at no further cost; the paper
//! leaves that to future work (section 5):
//!
//! ```text
//! k_ij    = V/2 Y s_ij^2
//! c_i,jk  = V/2 Y s_ij s_ik
//! d_ij,kl = V/2 Y s_ij s_kl
//! ```

use thiserror::Error;

use sinew_engine::scalar::{cross, dot, sub};

use crate::material::LameParameters;

pub use sinew_engine::element::TETRAHEDRON_EDGES as EDGES;

/// Pairs of edges with a common vertex: `[i, j, k]` stands for edges `ij` and `ik`.
///
/// Entry `3 i + n` belongs to vertex `i`; each of the four faces owns three of them.
pub const ADJACENT_PAIRS: [[usize; 3]; 12] = [
    [0, 1, 2],
    [0, 1, 3],
    [0, 2, 3],
    [1, 0, 2],
    [1, 0, 3],
    [1, 2, 3],
    [2, 0, 1],
    [2, 0, 3],
    [2, 1, 3],
    [3, 0, 1],
    [3, 0, 2],
    [3, 1, 2],
];

/// Pairs of opposite edges, by their local vertices.
pub const OPPOSITE_PAIRS: [[[usize; 2]; 2]; 3] =
    [[[0, 1], [2, 3]], [[0, 2], [1, 3]], [[0, 3], [1, 2]]];

/// [`ADJACENT_PAIRS`] as positions in [`EDGES`].
pub const ADJACENT_EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [0, 2],
    [1, 2],
    [0, 3],
    [0, 4],
    [3, 4],
    [1, 3],
    [1, 5],
    [3, 5],
    [2, 4],
    [2, 5],
    [4, 5],
];

/// [`OPPOSITE_PAIRS`] as positions in [`EDGES`].
pub const OPPOSITE_EDGES: [[usize; 2]; 3] = [[0, 5], [1, 4], [2, 3]];

/// Smallest rest volume accepted, as a part of the cube of the longest edge.
///
/// Below it the sign of the volume is rounding noise for coordinates a metre from the origin.
pub const MIN_RELATIVE_VOLUME: f64 = 1e-12;

/// Why four points are no rest shape.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum RestTetrahedronError {
    /// A coordinate, or the volume made from them, is infinite or not a number.
    #[error("local vertex {vertex} has rest position {point:?}: give finite coordinates in metres")]
    NonFinite {
        /// Local index of the vertex.
        vertex: usize,
        /// Its rest position, m.
        point: [f64; 3],
    },
    /// The vertices are in left-handed order.
    #[error("rest volume is {volume:e} m^3: swap two of the four vertices")]
    Inverted {
        /// Signed volume, m^3.
        volume: f64,
    },
    /// The vertices lie in a plane, on a line or in a point.
    #[error(
        "rest volume is {volume:e} m^3 with a longest edge of {longest_edge:e} m: the tetrahedron is \
         flat; remove it or remesh"
    )]
    Flat {
        /// Signed volume, m^3.
        volume: f64,
        /// Length of the longest edge, m.
        longest_edge: f64,
    },
}

/// Shape vectors and volume of an undeformed tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestTetrahedron {
    /// Gradients of the four barycentric coordinates, 1/m; each points towards its vertex.
    pub gradients: [[f64; 3]; 4],
    /// Volume, m^3; positive.
    pub volume: f64,
}

impl RestTetrahedron {
    /// Shape vectors and volume of the tetrahedron with these rest positions (m), which must be in
    /// right-handed order: `(X1-X0) x (X2-X0) . (X3-X0) > 0`.
    ///
    /// # Errors
    ///
    /// When a coordinate is not finite, the order is left-handed, or the four points are flat to
    /// within [`MIN_RELATIVE_VOLUME`].
    pub fn new(points: [[f64; 3]; 4]) -> Result<Self, RestTetrahedronError> {
        for vertex in 0..4 {
            if points[vertex].iter().any(|x| !x.is_finite()) {
                return Err(RestTetrahedronError::NonFinite { vertex, point: points[vertex] });
            }
        }
        let a = sub(points[1], points[0]);
        let b = sub(points[2], points[0]);
        let c = sub(points[3], points[0]);
        let normals = [cross(b, c), cross(c, a), cross(a, b)];
        let six_volume = dot(a, normals[0]);
        let volume = six_volume / 6.0;
        let mut longest = 0.0_f64;
        for [i, j] in EDGES {
            let edge = sub(points[j], points[i]);
            longest = longest.max(dot(edge, edge).sqrt());
        }
        // Written so that a volume that overflowed to NaN is refused too.
        let limit = MIN_RELATIVE_VOLUME * longest * longest * longest;
        if !(volume.abs() > limit && volume.is_finite()) {
            return Err(RestTetrahedronError::Flat { volume, longest_edge: longest });
        }
        if volume < 0.0 {
            return Err(RestTetrahedronError::Inverted { volume });
        }
        let mut gradients = [[0.0; 3]; 4];
        for i in 0..3 {
            for x in 0..3 {
                gradients[i + 1][x] = normals[i][x] / six_volume;
                gradients[0][x] -= gradients[i + 1][x];
            }
        }
        Ok(Self { gradients, volume })
    }
}

/// Stiffnesses of the 21 biquadratic springs of one tetrahedron, N/m^3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpringConstants {
    /// `k` per edge, in the order of [`EDGES`]; positive.
    pub tensile: [f64; 6],
    /// `c` per pair of adjacent edges, in the order of [`ADJACENT_PAIRS`].
    pub angular: [f64; 12],
    /// `d` per pair of opposite edges, in the order of [`OPPOSITE_PAIRS`].
    pub volumetric: [f64; 3],
}

impl SpringConstants {
    /// No springs.
    pub const NONE: Self = Self { tensile: [0.0; 6], angular: [0.0; 12], volumetric: [0.0; 3] };

    /// The constants with which the springs carry exactly the St Venant-Kirchhoff energy.
    pub fn new(rest: &RestTetrahedron, material: LameParameters) -> Self {
        let LameParameters { lambda, mu } = material;
        let half_volume = 0.5 * rest.volume;
        let mut g = [[0.0; 4]; 4];
        for i in 0..4 {
            for j in 0..4 {
                g[i][j] = dot(rest.gradients[i], rest.gradients[j]);
            }
        }
        let mut constants = Self::NONE;
        for (k, [i, j]) in constants.tensile.iter_mut().zip(EDGES) {
            *k = half_volume * ((lambda + mu) * g[i][j] * g[i][j] + mu * g[i][i] * g[j][j]);
        }
        for (c, [i, j, k]) in constants.angular.iter_mut().zip(ADJACENT_PAIRS) {
            *c = half_volume * ((lambda + mu) * g[i][j] * g[i][k] + mu * g[i][i] * g[j][k]);
        }
        for (d, [[i, j], [k, l]]) in constants.volumetric.iter_mut().zip(OPPOSITE_PAIRS) {
            *d = half_volume
                * (lambda * g[i][j] * g[k][l] + mu * (g[i][k] * g[j][l] + g[i][l] * g[j][k]));
        }
        constants
    }

    /// Adds the springs of fibres along the unit vector `axis` with the modulus `modulus` (Pa).
    pub fn add_fibre(&mut self, rest: &RestTetrahedron, axis: [f64; 3], modulus: f64) {
        let q = rest.gradients.map(|d| dot(d, axis));
        let s = EDGES.map(|[i, j]| q[i] * q[j]);
        let unit = 0.5 * rest.volume * modulus;
        for (k, s) in self.tensile.iter_mut().zip(s) {
            *k += unit * s * s;
        }
        for (c, [e, f]) in self.angular.iter_mut().zip(ADJACENT_EDGES) {
            *c += unit * s[e] * s[f];
        }
        for (d, [e, f]) in self.volumetric.iter_mut().zip(OPPOSITE_EDGES) {
            *d += unit * s[e] * s[f];
        }
    }

    /// Symmetric matrix `B` (N/m^3) with `W = 1/2 delta^T B delta` and edge tensions `B delta`:
    /// `k/2` on the diagonal, `c/2` or `d/2` elsewhere.
    pub fn matrix(&self) -> [[f64; 6]; 6] {
        let mut b = [[0.0; 6]; 6];
        for e in 0..6 {
            b[e][e] = 0.5 * self.tensile[e];
        }
        for (c, [e, f]) in self.angular.iter().zip(ADJACENT_EDGES) {
            b[e][f] = 0.5 * c;
            b[f][e] = 0.5 * c;
        }
        for (d, [e, f]) in self.volumetric.iter().zip(OPPOSITE_EDGES) {
            b[e][f] = 0.5 * d;
            b[f][e] = 0.5 * d;
        }
        b
    }
}
