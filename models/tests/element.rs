//! Rest shapes, springs and decompositions of single matrices.

use sinew_engine::scalar::{cross, dot, scale};
use sinew_models::element::precompute::{
    ADJACENT_EDGES, ADJACENT_PAIRS, EDGES, OPPOSITE_EDGES, OPPOSITE_PAIRS, RestTetrahedron,
    RestTetrahedronError,
};
use sinew_models::element::projection::{Svd, signed_svd, symmetric_eigen};
use sinew_models::element::spring::{
    coupling_energy, coupling_tensions, edge_force, squared_length_change, tensile_energy,
    tensile_tension,
};

const UNIT: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

#[test]
fn the_unit_corner_has_axis_gradients() {
    let rest = RestTetrahedron::new(UNIT).unwrap();
    assert_eq!(rest.volume, 1.0 / 6.0);
    assert_eq!(rest.gradients[0], [-1.0, -1.0, -1.0]);
    assert_eq!(rest.gradients[2], [0.0, 1.0, 0.0]);
}

#[test]
fn bad_points_are_refused() {
    let mut points = UNIT;
    points[2][1] = f64::NAN;
    assert!(matches!(
        RestTetrahedron::new(points),
        Err(RestTetrahedronError::NonFinite { vertex: 2, .. })
    ));
    let mut points = UNIT;
    points.swap(0, 1);
    assert!(matches!(
        RestTetrahedron::new(points),
        Err(RestTetrahedronError::Inverted { volume }) if volume < 0.0
    ));
    let mut points = UNIT;
    points[3] = [0.3, 0.3, 1e-13];
    assert!(matches!(RestTetrahedron::new(points), Err(RestTetrahedronError::Flat { .. })));
    assert!(RestTetrahedron::new([[0.5; 3]; 4]).is_err());
    assert!(RestTetrahedron::new([[1e200; 3], [-1e200; 3], [1e200, 0., 0.], [0.; 3]]).is_err());
    // A scale of micrometres or kilometres is no reason to refuse.
    for s in [1e-6, 1e3] {
        assert!(RestTetrahedron::new(UNIT.map(|p| p.map(|x| s * x))).is_ok());
    }
}

#[test]
fn pair_tables_agree() {
    let edge = |i: usize, j: usize| {
        EDGES.iter().position(|&e| e == [i.min(j), i.max(j)]).expect("an edge")
    };
    for ([i, j, k], pair) in ADJACENT_PAIRS.into_iter().zip(ADJACENT_EDGES) {
        assert_eq!(pair, [edge(i, j), edge(i, k)]);
    }
    for ([[i, j], [k, l]], pair) in OPPOSITE_PAIRS.into_iter().zip(OPPOSITE_EDGES) {
        assert_eq!(pair, [edge(i, j), edge(k, l)]);
    }
}

/// Largest deviation of `U diag(s) V^T` from `F`, of `U`, `V` from rotations.
fn svd_errors(f: &[[f64; 3]; 3]) -> (f64, f64) {
    let Svd { u, s, v } = signed_svd(f);
    let (mut back, mut rotation) = (0.0_f64, 0.0_f64);
    for i in 0..3 {
        for j in 0..3 {
            let product = u[i][0] * s[0] * v[j][0] + u[i][1] * s[1] * v[j][1];
            back = back.max((product + u[i][2] * s[2] * v[j][2] - f[i][j]).abs());
            let one = if i == j { 1.0 } else { 0.0 };
            rotation = rotation.max((dot(u[i], u[j]) - one).abs());
            rotation = rotation.max((dot(v[i], v[j]) - one).abs());
        }
    }
    for m in [u, v] {
        rotation = rotation.max((dot(m[0], cross(m[1], m[2])) - 1.0).abs());
    }
    assert!(s[0] >= s[1] && s[1] >= s[2].abs() - 1e-15 * s[0], "{s:?}");
    (back, rotation)
}

#[test]
fn decomposition_holds_for_regular_singular_and_inverted_matrices() {
    let outer = |a: [f64; 3], b: [f64; 3]| [scale(b, a[0]), scale(b, a[1]), scale(b, a[2])];
    let rank_one = outer([1.0, -2.0, 0.5], [0.3, 0.2, 0.7]);
    let mut rank_two = rank_one;
    let more = outer([0.1, 0.4, -0.9], [-0.5, 0.6, 0.1]);
    for i in 0..3 {
        for j in 0..3 {
            rank_two[i][j] += more[i][j];
        }
    }
    let diagonal = |x, y, z| [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]];
    let matrices = [
        [[0.0; 3]; 3],
        diagonal(1.0, 1.0, 1.0),
        diagonal(-1.0, -1.0, -1.0),
        diagonal(1.0, 1.0, -1.0),
        diagonal(0.5, 1.0, 2.0),
        diagonal(0.0, 0.0, 3.0),
        diagonal(0.0, -2.0, 0.0),
        diagonal(1e-12, 1.0, 1e-9),
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 1e-9, 0.0], [-1e-9, 1.0, 1e-8], [0.0, -1e-8, 1.0]],
        [[1.0, 1e3, -1e3], [0.0, 1.0, 5.0], [0.0, 0.0, 1.0]],
        rank_one,
        rank_two,
    ];
    for f in matrices {
        let size = f.iter().flatten().fold(1e-300_f64, |m, x| m.max(x.abs()));
        let (back, rotation) = svd_errors(&f);
        assert!(back <= 1e-14 * size && rotation < 1e-14, "{f:?}: {back:e} {rotation:e}");
    }
    let Svd { s, .. } = signed_svd(&diagonal(-1.0, 2.0, 3.0));
    assert!((s[2] + 1.0).abs() < 1e-15);
}

#[test]
fn small_eigensystem_is_right() {
    let a: [[f64; 3]; 3] = [[2.0, -1.0, 0.5], [-1.0, 2.0, 0.25], [0.5, 0.25, -3.0]];
    let (values, v) = symmetric_eigen(a, true);
    for n in 0..3 {
        for i in 0..3 {
            let x = [v[0][n], v[1][n], v[2][n]];
            assert!((dot(a[i], x) - values[n] * x[i]).abs() < 1e-14);
        }
    }
}

#[test]
fn a_doubled_edge_has_a_quadrupled_square() {
    // Rest (2, 0, 0), node a moved by +2: length 4, delta = 16 - 4.
    let delta = squared_length_change([2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0; 3]);
    assert_eq!(delta, 12.0);
    assert_eq!(tensile_energy(3.0, delta), 108.0);
    assert_eq!(tensile_tension(3.0, delta), 18.0);
    // Force on a points back to b, with -dW/dx = -(k/2 delta)(2 x).
    assert_eq!(edge_force(18.0, [4.0, 0.0, 0.0]), [-144.0, 0.0, 0.0]);
}

#[test]
fn coupling_tensions_are_the_gradient_of_the_coupling_energy() {
    let (c, de, df) = (-1.5, 0.25, 2.0);
    let [se, sf] = coupling_tensions(c, de, df);
    assert_eq!(se, coupling_energy(c, de + 0.5, df) * 2.0 - coupling_energy(c, de, df) * 2.0);
    assert_eq!(sf, coupling_energy(c, de, df + 1.0) - coupling_energy(c, de, df));
}
