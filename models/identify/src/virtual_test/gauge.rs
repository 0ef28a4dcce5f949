//! What a tensile test machine measures: strain of a gauge region, and the moduli that follow.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Displacement gradient `G[i][j] = du_i/dx_j` of the affine map that fits the displacements of `nodes`
/// best (least squares). `None` if the nodes do not span the `dimension` axes.
///
/// ```
/// use sinew_identify::virtual_test::gauge::displacement_gradient;
///
/// let points = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let u = [[0.0; 3], [0.2, 0.0, 0.0], [0.0, -0.03, 0.0]];
/// let g = displacement_gradient(&points, &u, &[0, 1, 2], 2).unwrap();
/// assert!((g[0][0] - 0.1).abs() < 1e-15 && (g[1][1] + 0.03).abs() < 1e-15);
/// assert!(displacement_gradient(&points, &u, &[0, 1], 2).is_none());
/// ```
pub fn displacement_gradient(
    points: &[[f64; 3]],
    displacements: &[[f64; 3]],
    nodes: &[usize],
    dimension: usize,
) -> Option<[[f64; 3]; 3]> {
    if nodes.is_empty() {
        return None;
    }
    let count = nodes.len() as f64;
    let mean = |values: &[[f64; 3]]| {
        let mut mean = [0.0; 3];
        for &node in nodes {
            for axis in 0..dimension {
                mean[axis] += values[node][axis] / count;
            }
        }
        mean
    };
    let (centre, shift) = (mean(points), mean(displacements));
    let mut moments = DMatrix::<f64>::zeros(dimension, dimension);
    let mut products = DMatrix::<f64>::zeros(dimension, dimension);
    for &node in nodes {
        for i in 0..dimension {
            let x = points[node][i] - centre[i];
            for j in 0..dimension {
                moments[(i, j)] += x * (points[node][j] - centre[j]);
                products[(i, j)] += x * (displacements[node][j] - shift[j]);
            }
        }
    }
    let eigenvalues = moments.clone().symmetric_eigenvalues();
    if eigenvalues.min() <= 1e-12 * eigenvalues.max() {
        return None;
    }
    let factor = moments.cholesky()?;
    let mut gradient = [[0.0; 3]; 3];
    for j in 0..dimension {
        let column: DVector<f64> = factor.solve(&products.column(j).into_owned());
        for i in 0..dimension {
            gradient[j][i] = column[i];
        }
    }
    Some(gradient)
}

/// Young's modulus and Poisson's ratio that a tensile test finds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredModuli {
    /// `E_out = stress / strain`, Pa.
    pub youngs_modulus: f64,
    /// `nu_out = -(mean lateral strain) / strain`.
    pub poissons_ratio: f64,
    /// Strain along the axis.
    pub strain: f64,
}

/// Moduli from the displacements of the gauge `nodes` under the axial stress `stress` (Pa) along `axis`
/// (0, 1 or 2). Lateral strain is the mean over the other axes. `None` if the nodes span too little, or
/// nothing moved.
///
/// ```
/// use sinew_identify::virtual_test::gauge::tensile_moduli;
///
/// let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let u = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, -0.03, 0.0]];
/// let moduli = tensile_moduli(&points, &u, &[0, 1, 2], 2, 0, 1e3).unwrap();
/// assert!((moduli.youngs_modulus - 1e4).abs() < 1e-9);
/// assert!((moduli.poissons_ratio - 0.3).abs() < 1e-14);
/// ```
pub fn tensile_moduli(
    points: &[[f64; 3]],
    displacements: &[[f64; 3]],
    nodes: &[usize],
    dimension: usize,
    axis: usize,
    stress: f64,
) -> Option<MeasuredModuli> {
    let gradient = displacement_gradient(points, displacements, nodes, dimension)?;
    let strain = gradient[axis][axis];
    let lateral: f64 = (0..dimension).filter(|&d| d != axis).map(|d| gradient[d][d]).sum();
    let lateral = lateral / (dimension - 1) as f64;
    (strain != 0.0).then(|| MeasuredModuli {
        youngs_modulus: stress / strain,
        poissons_ratio: -lateral / strain,
        strain,
    })
}
