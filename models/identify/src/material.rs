//! Isotropic linear material, and the section of plane elements.

use serde::{Deserialize, Serialize};

use crate::error::ElementError;

/// Isotropic linear elastic material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LinearMaterial {
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
    /// Poisson's ratio.
    pub poissons_ratio: f64,
}

impl LinearMaterial {
    /// A material of Young's modulus `youngs_modulus` (Pa) and Poisson's ratio `poissons_ratio`.
    ///
    /// # Errors
    /// [`ElementError::YoungsModulus`], [`ElementError::PoissonsRatio`] outside (-1, 1). Solids and
    /// plane strain need a ratio below 1/2; that is checked where the kind of element is known.
    pub fn new(youngs_modulus: f64, poissons_ratio: f64) -> Result<Self, ElementError> {
        let material = Self { youngs_modulus, poissons_ratio };
        material.moduli(Some(Plane::Stress))?;
        Ok(material)
    }

    /// Lamé moduli (Pa) as they act in a plane element (`Some`) or in a solid (`None`).
    ///
    /// Plane strain and solids: `lambda = E nu / ((1 + nu)(1 - 2 nu))`. Plane stress: `lambda* = 2
    /// lambda mu / (lambda + 2 mu) = E nu / (1 - nu^2)`. Always `mu = E / (2 (1 + nu))`, the shear
    /// modulus.
    ///
    /// # Errors
    /// [`ElementError::YoungsModulus`], [`ElementError::PoissonsRatio`].
    ///
    /// ```
    /// use sinew_identify::{LinearMaterial, Plane};
    ///
    /// let rubber = LinearMaterial::new(1e4, 0.25)?;
    /// let solid = rubber.moduli(None)?;
    /// assert!((solid.lambda - 4000.0).abs() < 1e-9 && (solid.mu - 4000.0).abs() < 1e-9);
    /// let sheet = rubber.moduli(Some(Plane::Stress))?;
    /// assert!((sheet.lambda - 2.0 * 4000.0 * 4000.0 / 12000.0).abs() < 1e-9);
    /// assert!(LinearMaterial::new(1e4, 0.5)?.moduli(None).is_err());
    /// # Ok::<(), sinew_identify::ElementError>(())
    /// ```
    pub fn moduli(&self, plane: Option<Plane>) -> Result<LameModuli, ElementError> {
        let (e, nu) = (self.youngs_modulus, self.poissons_ratio);
        if !(e.is_finite() && e > 0.0) {
            return Err(ElementError::YoungsModulus(e));
        }
        let (setting, limit) = match plane {
            Some(Plane::Stress) => ("plane stress", 1.0),
            Some(Plane::Strain) => ("plane strain", 0.5),
            None => ("a solid", 0.5),
        };
        if !(nu > -1.0 && nu < limit) {
            return Err(ElementError::PoissonsRatio { value: nu, setting, limit });
        }
        let lambda = match plane {
            Some(Plane::Stress) => e * nu / (1.0 - nu * nu),
            Some(Plane::Strain) | None => e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
        };
        Ok(LameModuli { lambda, mu: e / (2.0 * (1.0 + nu)) })
    }

    /// Young's modulus (Pa) and Poisson's ratio of the sheet under plane stress that acts as this material
    /// does: itself, or `E / (1 - nu^2)` and `nu / (1 - nu)` for plane strain.
    pub(crate) fn in_plane(&self, plane: Plane) -> (f64, f64) {
        let (e, nu) = (self.youngs_modulus, self.poissons_ratio);
        match plane {
            Plane::Stress => (e, nu),
            Plane::Strain => (e / (1.0 - nu * nu), nu / (1.0 - nu)),
        }
    }
}

/// Lamé moduli, Pa.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LameModuli {
    /// First modulus, Pa.
    pub lambda: f64,
    /// Shear modulus, Pa.
    pub mu: f64,
}

/// What holds across the thickness of a plane element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Plane {
    /// No stress across: a sheet.
    #[default]
    Stress,
    /// No strain across: a slice of a long body.
    Strain,
}

/// Section of triangles and quadrilaterals; tetrahedra and hexahedra ignore it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Plane stress or plane strain.
    pub plane: Plane,
    /// Thickness, m.
    pub thickness: f64,
}

impl Default for Section {
    /// Plane stress, 1 m thick.
    fn default() -> Self {
        Self { plane: Plane::Stress, thickness: 1.0 }
    }
}

impl Section {
    /// Checks the thickness.
    ///
    /// # Errors
    /// [`ElementError::Thickness`].
    pub fn check(&self) -> Result<(), ElementError> {
        if self.thickness.is_finite() && self.thickness > 0.0 {
            Ok(())
        } else {
            Err(ElementError::Thickness(self.thickness))
        }
    }
}
