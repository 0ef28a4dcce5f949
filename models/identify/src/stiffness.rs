//! Linear finite element stiffness.
//!
//! With shape function gradients `g_a` (1/m) the blocks of an isotropic element are
//!
//! ```text
//! R_ab = sum over Gauss points of  w |det J| t [ lambda g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I ]      N/m
//! ```
//!
//! One point for triangles and tetrahedra, 2x2 for quadrilaterals, 2x2x2 for hexahedra. Plane elements
//! use the moduli of plane stress or plane strain and their thickness `t`, solids `t = 1`. These are
//! the matrices of paper B, equations (19) and (22), and its appendix; its (A.8) prints the shear
//! stress in the place of the third normal stress.

use nalgebra::DMatrix;

use crate::error::ElementError;
use crate::geometry::{ElementGeometry, dot};
use crate::material::{LinearMaterial, Section};

/// Stiffness `+d2W/du2` (N/m) of one element: symmetric, square, one row for each (node, axis) with
/// `dimension` axes to a node.
///
/// # Errors
/// Moduli or thickness that are not allowed here.
///
/// ```
/// use sinew_identify::stiffness::element_stiffness;
/// use sinew_identify::{ElementGeometry, ElementKind, LinearMaterial, Section};
///
/// // side 2 m, nu = 0: R_00 of a square is E t / 2 whatever its side
/// let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
/// let square = ElementGeometry::planar(ElementKind::Quad, &square)?;
/// let r = element_stiffness(&square, &LinearMaterial::new(1.0, 0.0)?, &Section::default())?;
/// assert!((r[(0, 0)] - 0.5).abs() < 1e-15);
/// # Ok::<(), sinew_identify::ElementError>(())
/// ```
pub fn element_stiffness(
    geometry: &ElementGeometry,
    material: &LinearMaterial,
    section: &Section,
) -> Result<DMatrix<f64>, ElementError> {
    let kind = geometry.kind();
    let dimension = kind.dimension();
    let (moduli, thickness) = if dimension == 2 {
        section.check()?;
        (material.moduli(Some(section.plane))?, section.thickness)
    } else {
        (material.moduli(None)?, 1.0)
    };
    let nodes = kind.nodes();
    let mut r = DMatrix::zeros(nodes * dimension, nodes * dimension);
    for (xi, weight) in kind.gauss_points() {
        let (g, determinant) = geometry.gradients(xi);
        let volume = weight * determinant * thickness;
        for a in 0..nodes {
            for b in a..nodes {
                let trace = moduli.mu * dot(g[a], g[b]);
                for i in 0..dimension {
                    for j in 0..dimension {
                        let mut value =
                            moduli.lambda * g[a][i] * g[b][j] + moduli.mu * g[b][i] * g[a][j];
                        if i == j {
                            value += trace;
                        }
                        r[(a * dimension + i, b * dimension + j)] += volume * value;
                    }
                }
            }
        }
    }
    // the lower half is the mirror image to the last bit
    for row in 0..r.nrows() {
        for column in 0..row {
            r[(row, column)] = r[(column, row)];
        }
    }
    Ok(r)
}
