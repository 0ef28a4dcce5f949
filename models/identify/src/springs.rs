//! Fully connected springs of an element and their stiffness at rest.
//!
//! Spring `s = (a, b)` of rest direction `u` has the vector `w_s`, which is `u` at node `a`, `-u` at
//! node `b` and 0 elsewhere. At rest its stiffness is `k_s w_s w_s^T`, so `K(k) = sum_s k_s w_s w_s^T`
//! (paper B, section 2; its (A.15) is the negative force).

use nalgebra::DMatrix;

use crate::geometry::{ElementGeometry, norm, scale, sub};

/// Pairs `(a, b)` with `a < b < nodes`, in lexicographic order: 3, 6, 6, 28 for triangle,
/// quadrilateral, tetrahedron, hexahedron.
///
/// ```
/// let pairs: Vec<_> = sinew_identify::springs::pairs(3).collect();
/// assert_eq!(pairs, [(0, 1), (0, 2), (1, 2)]);
/// ```
pub fn pairs(nodes: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..nodes).flat_map(move |a| (a + 1..nodes).map(move |b| (a, b)))
}

/// Rest length (m) and unit direction from `b` to `a` of every spring.
pub(crate) fn directions(geometry: &ElementGeometry) -> Vec<(f64, [f64; 3])> {
    let nodes = geometry.nodes();
    pairs(nodes.len())
        .map(|(a, b)| {
            let edge = sub(nodes[a], nodes[b]);
            let length = norm(edge);
            (length, scale(edge, 1.0 / length))
        })
        .collect()
}

/// The vectors `w_s` as columns: (nodes x dimension) rows, one column to a spring.
pub fn spring_vectors(geometry: &ElementGeometry) -> DMatrix<f64> {
    let dimension = geometry.kind().dimension();
    let nodes = geometry.kind().nodes();
    let mut w = DMatrix::zeros(nodes * dimension, nodes * (nodes - 1) / 2);
    for (s, ((a, b), (_, u))) in pairs(nodes).zip(directions(geometry)).enumerate() {
        for axis in 0..dimension {
            w[(a * dimension + axis, s)] = u[axis];
            w[(b * dimension + axis, s)] = -u[axis];
        }
    }
    w
}

/// Stiffness `K(k)` (N/m) at rest of springs with constants `constants` (N/m) and vectors `w`.
///
/// # Panics
/// If there are more constants than springs.
pub fn spring_stiffness(w: &DMatrix<f64>, constants: &[f64]) -> DMatrix<f64> {
    let mut k = DMatrix::zeros(w.nrows(), w.nrows());
    for (s, &constant) in constants.iter().enumerate() {
        let column = w.column(s);
        k.ger(constant, &column, &column, 1.0);
    }
    k
}
