//! The moduli that a lattice of springs really has.
//!
//! Springs of one element under an affine strain `eps` store `1/2 sum_s k_s L_s^2 (u_s . eps u_s)^2`,
//! so per volume their stiffness is `C_ijkl = (1/V) sum_s k_s L_s^2 u_i u_j u_k u_l`: symmetric in all
//! four indices, whence the Cauchy relation `C_iijj = C_ijij`. It is that of the cell repeated without
//! end, where the springs of neighbours lie on one another and every node sits in the same
//! surroundings, as long as the cell is a parallelogram or a parallelepiped; of any other element it is
//! the response with all nodes held on the affine map.

use nalgebra::DMatrix;

use crate::error::ElementError;
use crate::geometry::ElementGeometry;
use crate::material::Section;
use crate::springs::directions;

/// Affine response of a cell along the axes of its coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct EffectiveModuli {
    /// Stiffness in Voigt order (xx, yy, zz, yz, xz, xy; plane: xx, yy, xy) with engineering shear
    /// strains, Pa.
    pub stiffness: DMatrix<f64>,
    /// Young's modulus under a pull along x, Pa. Not finite, or negative, if the lattice has none.
    pub youngs_modulus: f64,
    /// Poisson's ratio of y under a pull along x.
    pub poissons_ratio: f64,
    /// Shear modulus in the plane of x and y, Pa.
    pub shear_modulus: f64,
}

/// Measures the springs `constants` (N/m, lexicographic pairs) of a cell. Plane elements keep the
/// modulus of their plane: of plane strain springs it is that of the slice with its thickness held.
///
/// # Errors
/// [`ElementError::Thickness`]; [`ElementError::DependentSprings`] if the springs resist some strain
/// not at all.
///
/// ```
/// use sinew_identify::response::effective_moduli;
/// use sinew_identify::{ElementGeometry, ElementKind, Section};
///
/// // Baudet's square at nu = 1/3: all constants 3/8 E, and the moduli are those of the material
/// let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
/// let square = ElementGeometry::planar(ElementKind::Quad, &square)?;
/// let moduli = effective_moduli(&square, &[0.375; 6], &Section::default())?;
/// assert!((moduli.youngs_modulus - 1.0).abs() < 1e-14);
/// assert!((moduli.poissons_ratio - 1.0 / 3.0).abs() < 1e-14);
/// assert!((moduli.shear_modulus - 0.375).abs() < 1e-14);
/// # Ok::<(), sinew_identify::ElementError>(())
/// ```
pub fn effective_moduli(
    geometry: &ElementGeometry,
    constants: &[f64],
    section: &Section,
) -> Result<EffectiveModuli, ElementError> {
    let plane = geometry.kind().dimension() == 2;
    let mut volume = geometry.measure();
    let voigt: &[(usize, usize)] = if plane {
        section.check()?;
        volume *= section.thickness;
        &[(0, 0), (1, 1), (0, 1)]
    } else {
        &[(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    };
    let mut stiffness = DMatrix::<f64>::zeros(voigt.len(), voigt.len());
    for (&k, (length, u)) in constants.iter().zip(directions(geometry)) {
        let weight = k * length * length / volume;
        for (row, &(i, j)) in voigt.iter().enumerate() {
            for (column, &(l, m)) in voigt.iter().enumerate() {
                stiffness[(row, column)] += weight * u[i] * u[j] * u[l] * u[m];
            }
        }
    }
    let compliance = stiffness.clone().try_inverse().ok_or(ElementError::DependentSprings)?;
    let shear = voigt.len() - 1;
    Ok(EffectiveModuli {
        youngs_modulus: 1.0 / compliance[(0, 0)],
        poissons_ratio: -compliance[(1, 0)] / compliance[(0, 0)],
        shear_modulus: 1.0 / compliance[(shear, shear)],
        stiffness,
    })
}
