//! Element components. Local numbering of a tetrahedron, positive volume, right-handed:
//!
//! ```text
//!            3
//!           /|\            edges: 0 = 01   1 = 02   2 = 03   3 = 12   4 = 13   5 = 23
//!          / | \           opposite pairs: (0, 5) (1, 4) (2, 3)
//!         /  |  \          (X1 - X0) x (X2 - X0) . (X3 - X0) > 0
//!        0---|---2
//!         \  |  /
//!          \ | /
//!            1
//! ```
//!
//! Edge `i` of a triangle lies opposite its vertex `i`: 0 = (1, 2), 1 = (2, 0), 2 = (0, 1).

use crate::scalar::{Scalar, sub};
use bevy_ecs::prelude::Component;

/// Local vertices of the six edges of a tetrahedron.
pub const TETRAHEDRON_EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// Local vertices of the four faces of a tetrahedron; face `i` lies opposite vertex `i`, outward.
pub const TETRAHEDRON_FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Vertex rows of an edge, lower first.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct EdgeVertices(pub [u32; 2]);

/// Off-diagonal block of the tangent that an edge owns (index into the edge graph).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct EdgeBlock(pub u32);

/// Rest vector X_a - X_b of an edge (m), a the lower row.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct RestEdge<S: Scalar>(pub [S; 3]);

/// Change of squared length (m^2), `|x_a - x_b|^2 - L^2`.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct EdgeChange<S: Scalar>(pub S);

/// Edge tension (N/m): derivative of the energy with respect to the change of squared length.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
#[repr(transparent)]
pub struct EdgeTension<S: Scalar>(pub S);

/// Edge-table rows of a triangle, edge `i` opposite vertex `i`.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TriangleEdges(pub [u32; 3]);

/// Vertex rows of a tetrahedron, positively oriented.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TetrahedronVertices(pub [u32; 4]);

/// Tangent blocks (edge-graph indices) of the six edges of a tetrahedron.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TetrahedronBlocks(pub [u32; 6]);

/// Edge-table rows of the six edges of a tetrahedron (pooled evaluation only).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TetrahedronEdges(pub [u32; 6]);

/// Index of the tetrahedron in the mesh that the user gave.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[repr(transparent)]
pub struct TetrahedronIndex(pub u32);

/// Shape vectors D_1, D_2, D_3 (1/m), gradients of the barycentric coordinates, row-major;
/// D_0 = -(D_1 + D_2 + D_3).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct ShapeGradients<S: Scalar>(pub [[S; 3]; 3]);

/// Rest volume (m^3).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct RestVolume<S: Scalar>(pub S);

/// `G = sum_a u_a (x) D_a`, row-major.
#[inline(always)]
pub fn displacement_gradient<S: Scalar>(gradients: &[[S; 3]; 3], u: &[[S; 3]; 4]) -> [S; 9] {
    // D_0 = -(D_1 + D_2 + D_3) turns the sum into one over displacements relative to vertex 0.
    let (w1, w2, w3) = (sub(u[1], u[0]), sub(u[2], u[0]), sub(u[3], u[0]));
    let [d1, d2, d3] = gradients;
    let mut g = [S::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            g[3 * i + j] = w1[i] * d1[j] + w2[i] * d2[j] + w3[i] * d3[j];
        }
    }
    g
}

/// `J - 1` from the invariants of `G`.
#[inline(always)]
pub fn volume_change<S: Scalar>(g: &[S; 9]) -> S {
    let m0 = g[4] * g[8] - g[5] * g[7];
    let m1 = g[0] * g[8] - g[2] * g[6];
    let m2 = g[0] * g[4] - g[1] * g[3];
    let det = g[0] * m0 + g[1] * (g[5] * g[6] - g[3] * g[8]) + g[2] * (g[3] * g[7] - g[4] * g[6]);
    (g[0] + g[4] + g[8]) + (m0 + m1 + m2) + det
}
