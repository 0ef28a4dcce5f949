//! Tables of axes in tetrahedra of either order and in hexahedra, for what is written once for all.

use bevy_ecs::prelude::*;
use sinew_engine::element::{AxisBlocks, AxisVertices, TETRAHEDRON_EDGES};
use sinew_engine::isoparametric::{
    AxisHexahedronBlocks, AxisHexahedronVertices, AxisTetrahedron10Blocks,
    AxisTetrahedron10Vertices, HEXAHEDRON_PAIRS, TETRAHEDRON10_PAIRS,
};
use sinew_engine::law::Span;
use sinew_engine::scalar::{Scalar, xyz};

use crate::frame::row::ElementRows;

/// Vectors of the vertices (m, m/s or N).
pub type Nodes<const N: usize> = [[f64; 3]; N];
/// Matrix of an element as blocks `[row vertex][column vertex]`, each row-major (N/m).
pub type Blocks<const N: usize> = [[[f64; 9]; N]; N];

/// Vertex rows of an axis entity in an element of `N` vertices: the column that tells its kind of element.
pub trait AxisSite<const N: usize>: ElementRows + Copy {
    /// The column of tangent blocks beside it.
    type Blocks: Component + Copy;
    /// Pairs of vertices in the order of the tangent blocks.
    const PAIRS: &'static [[usize; 2]];
    /// Vertex rows.
    fn rows(&self) -> &[u32; N];
    /// Tangent blocks.
    fn blocks(blocks: &Self::Blocks) -> &[u32];
}

macro_rules! sites {
    ($($count:literal $vertices:ident, $blocks:ident, $pairs:ident;)+) => {$(
        impl AxisSite<$count> for $vertices {
            type Blocks = $blocks;
            const PAIRS: &'static [[usize; 2]] = &$pairs;
            fn rows(&self) -> &[u32; $count] {
                &self.0
            }
            fn blocks(blocks: &$blocks) -> &[u32] {
                &blocks.0
            }
        }
    )+};
}
sites! {
    4 AxisVertices, AxisBlocks, TETRAHEDRON_EDGES;
    8 AxisHexahedronVertices, AxisHexahedronBlocks, HEXAHEDRON_PAIRS;
    10 AxisTetrahedron10Vertices, AxisTetrahedron10Blocks, TETRAHEDRON10_PAIRS;
}

/// Displacements (m) of the vertices of an element in `f64`.
pub fn local<S: Scalar, const N: usize>(u: &[[S; 4]], rows: &[u32; N]) -> Nodes<N> {
    rows.map(|v| xyz(u[v as usize]).map(S::to_f64))
}

/// Adds the matrix of an element to a range.
pub fn add_blocks<S: Scalar, const N: usize, V: AxisSite<N>>(
    span: &mut Span<S>,
    vertices: &V,
    blocks: &V::Blocks,
    matrix: &Blocks<N>,
) {
    let rows = vertices.rows();
    for a in 0..N {
        span.add_diagonal(rows[a], &matrix[a][a].map(S::from_f64));
    }
    for (&block, &[a, b]) in V::blocks(blocks).iter().zip(V::PAIRS) {
        span.add_off_diagonal(block, rows[a], rows[b], &matrix[a][b].map(S::from_f64));
    }
}

/// `sum_j weights_j x_j`.
pub fn spread_over<const N: usize>(weights: &[f64; N], x: &Nodes<N>) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for j in 0..N {
        for k in 0..3 {
            sum[k] += weights[j] * x[j][k];
        }
    }
    sum
}

/// Adds `w_a v_b m` to all blocks.
pub fn add_spread<const N: usize>(to: &mut Blocks<N>, w: &[f64; N], v: &[f64; N], m: &[f64; 9]) {
    for a in 0..N {
        for b in 0..N {
            for k in 0..9 {
                to[a][b][k] += w[a] * v[b] * m[k];
            }
        }
    }
}
