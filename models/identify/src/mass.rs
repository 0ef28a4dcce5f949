//! Lumped masses of elements.

use serde::{Deserialize, Serialize};

use crate::error::ElementError;
use crate::geometry::ElementGeometry;
use crate::material::Section;

/// How the mass of an element is shared among its nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MassLumping {
    /// `m_a = integral of rho N_a`: row sums of the consistent mass matrix. Keeps the mass of every
    /// element.
    #[default]
    #[serde(rename = "row-sums")]
    RowSum,
    /// `m_a = rho |det J(node a)|` times the weight of nodal quadrature (paper B, equation 2). Off by
    /// up to about a percent of the mass on distorted hexahedra.
    #[serde(rename = "nodal")]
    NodalQuadrature,
}

impl std::str::FromStr for MassLumping {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "row-sums" => Ok(Self::RowSum),
            "nodal" => Ok(Self::NodalQuadrature),
            _ => Err(format!("`{name}` is neither `nodal` nor `row-sums`")),
        }
    }
}

impl std::fmt::Display for MassLumping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::RowSum => "row-sums",
            Self::NodalQuadrature => "nodal",
        })
    }
}

/// Masses (kg) of the nodes of one element of density `density` (kg/m^3).
///
/// # Errors
/// [`ElementError::Density`], [`ElementError::Thickness`].
///
/// ```
/// use sinew_identify::mass::{MassLumping, lumped_masses};
/// use sinew_identify::{ElementGeometry, ElementKind, Section};
///
/// let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
/// let triangle = ElementGeometry::planar(ElementKind::Triangle, &triangle)?;
/// let masses = lumped_masses(&triangle, 6.0, &Section::default(), MassLumping::NodalQuadrature)?;
/// assert!(masses.iter().all(|m| (m - 1.0).abs() < 1e-15));
/// # Ok::<(), sinew_identify::ElementError>(())
/// ```
pub fn lumped_masses(
    geometry: &ElementGeometry,
    density: f64,
    section: &Section,
    lumping: MassLumping,
) -> Result<Vec<f64>, ElementError> {
    if !(density.is_finite() && density > 0.0) {
        return Err(ElementError::Density(density));
    }
    let kind = geometry.kind();
    let mut surface_density = density;
    if kind.dimension() == 2 {
        section.check()?;
        surface_density *= section.thickness;
    }
    let points = kind.gauss_points();
    let total_weight: f64 = points.iter().map(|p| p.1).sum();
    Ok(match lumping {
        MassLumping::NodalQuadrature => {
            let weight = total_weight / kind.nodes() as f64;
            let places = kind.reference_nodes().iter();
            places.map(|&xi| surface_density * weight * geometry.determinant(xi)).collect()
        }
        MassLumping::RowSum => {
            let mut masses = vec![0.0; kind.nodes()];
            for (xi, weight) in points {
                let mass = surface_density * weight * geometry.determinant(xi);
                for (m, n) in masses.iter_mut().zip(kind.shape_functions(xi)) {
                    *m += mass * n;
                }
            }
            masses
        }
    })
}
