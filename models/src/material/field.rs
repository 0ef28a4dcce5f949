//! A material that varies from element to element.

use serde::{Deserialize, Serialize};
use sinew_engine::connectivity::ElementKind;
use sinew_engine::mesh::Filled;
use sinew_identify::{ElementMethod, IdentifyError};
use std::fmt;
use std::sync::Arc;
use thiserror::Error;

use crate::material::{LameParameters, MaterialError, MaterialFinding, YoungPoisson};

/// Material of every solid element of a body: one material, and arrays that replace single constants of
/// it, one value per element in the order of the user's mesh: tetrahedra first, then hexahedra.
///
/// ```
/// use sinew_models::material::field::MaterialField;
/// use sinew_models::material::YoungPoisson;
///
/// let liver = YoungPoisson { young_modulus: 5e3, poisson_ratio: 0.45, density: 1060.0 };
/// let stiffness = [5e3, 5e3, 2e4];
/// let field = MaterialField { young_modulus: Some(&stiffness), ..liver.into() };
/// assert_eq!(field.at(2).young_modulus, 2e4);
/// assert_eq!(field.at(2).density, 1060.0);
/// assert!(field.validate(4, 0).is_err());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaterialField<'a> {
    /// Constants of tetrahedra without a value of their own.
    pub material: YoungPoisson,
    /// Young's moduli, Pa.
    pub young_modulus: Option<&'a [f64]>,
    /// Poisson's ratios.
    pub poisson_ratio: Option<&'a [f64]>,
    /// Densities, kg/m^3.
    pub density: Option<&'a [f64]>,
    /// What of every element is filled with the material: its share multiplies Young's modulus and
    /// density. It belongs to the shape of a body, and stays when its material is changed.
    pub filled: Option<&'a [Filled]>,
}

/// The arrays of a [`MaterialField`], kept with the body.
#[derive(Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MaterialArrays {
    young_modulus: Option<Arc<[f64]>>,
    poisson_ratio: Option<Arc<[f64]>>,
    density: Option<Arc<[f64]>>,
    // belongs to the shape, which a log of edits has from elsewhere
    #[serde(skip)]
    filled: Option<Arc<[Filled]>>,
}

/// Snapshots know a scene by a sum over this text: without shares it is that of versions that knew none.
impl fmt::Debug for MaterialArrays {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { young_modulus, poisson_ratio, density, filled } = self;
        let mut own = f.debug_struct("MaterialArrays");
        own.field("young_modulus", young_modulus).field("poisson_ratio", poisson_ratio);
        own.field("density", density);
        if let Some(filled) = filled {
            own.field("filled", filled);
        }
        own.finish()
    }
}

impl MaterialArrays {
    /// Those of a field.
    pub fn of(field: &MaterialField) -> Self {
        Self {
            young_modulus: field.young_modulus.map(Arc::from),
            poisson_ratio: field.poisson_ratio.map(Arc::from),
            density: field.density.map(Arc::from),
            filled: field.filled.map(Arc::from),
        }
    }

    /// The field that they and the material of the whole body make.
    pub fn field(&self, material: YoungPoisson) -> MaterialField<'_> {
        MaterialField {
            material,
            young_modulus: self.young_modulus.as_deref(),
            poisson_ratio: self.poisson_ratio.as_deref(),
            density: self.density.as_deref(),
            filled: self.filled.as_deref(),
        }
    }
}

/// An element whose springs cannot be found.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("no spring constants for {} {index} by method \"{method}\": {source}", .kind.name())]
pub struct SpringsError {
    /// Kind of the element.
    pub kind: ElementKind,
    /// Index in the user's mesh.
    pub index: usize,
    /// The method.
    pub method: ElementMethod,
    /// What is wrong.
    pub source: Box<IdentifyError>,
}

/// A field that cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FieldError {
    /// The material of the whole body is out of range.
    #[error(transparent)]
    Material(Box<MaterialError>),
    /// The material of one tetrahedron is out of range.
    #[error("tetrahedron {tetrahedron}: {source}")]
    Tetrahedron {
        /// Index in the user's mesh.
        tetrahedron: usize,
        /// What is wrong.
        source: Box<MaterialError>,
    },
    /// The material of one hexahedron is out of range.
    #[error("hexahedron {hexahedron}: {source}")]
    Hexahedron {
        /// Index in the user's mesh.
        hexahedron: usize,
        /// What is wrong.
        source: Box<MaterialError>,
    },
    /// The springs of an element cannot be found with this material.
    #[error(transparent)]
    Springs(#[from] SpringsError),
    /// An array does not have one value per solid element.
    #[error(
        "the field of {quantity} has {found} values for {expected} solid elements: give one for each, \
         tetrahedra first, then hexahedra"
    )]
    Length {
        /// What the array holds.
        quantity: &'static str,
        /// Its length.
        found: usize,
        /// Number of tetrahedra and hexahedra.
        expected: usize,
    },
    /// An element is filled by nothing, or by more than all of it.
    #[error("{} {index} is filled by {share}: give a share above 0 and at most 1", .kind.name())]
    Filled {
        /// Kind of the element.
        kind: ElementKind,
        /// Index in the user's mesh.
        index: usize,
        /// The share.
        share: f64,
    },
    /// No part of the element has such moments.
    #[error(
        "{} {index} is filled about {:?} with the covariances {:?}, in coordinates from -1 to 1, as no part of it can be: write the cell data again with `sinew mesh lattice`, or leave out those of middle, spread and skew",
        .kind.name(), .filled.middle, .filled.spread
    )]
    FilledPlace {
        /// Kind of the element.
        kind: ElementKind,
        /// Index in the user's mesh.
        index: usize,
        /// The moments.
        filled: Box<Filled>,
    },
}

impl From<YoungPoisson> for MaterialField<'_> {
    fn from(material: YoungPoisson) -> Self {
        Self { material, young_modulus: None, poisson_ratio: None, density: None, filled: None }
    }
}

impl MaterialField<'_> {
    /// Material of an element, hexahedra counted after tetrahedra.
    pub fn at(&self, element: usize) -> YoungPoisson {
        let pick = |field: Option<&[f64]>, base| field.map_or(base, |values| values[element]);
        let share = self.filled.map_or(1.0, |filled| filled[element].share);
        YoungPoisson {
            young_modulus: share * pick(self.young_modulus, self.material.young_modulus),
            poisson_ratio: pick(self.poisson_ratio, self.material.poisson_ratio),
            density: share * pick(self.density, self.material.density),
        }
    }

    /// What of an element is filled.
    pub fn filled_at(&self, element: usize) -> Filled {
        self.filled.map_or(Filled::evenly(1.0), |filled| filled[element])
    }

    /// Plausibility of valid materials of elements as soft tissue, by their smallest and largest constants; see
    /// [`YoungPoisson::findings`].
    pub fn findings(&self) -> Vec<MaterialFinding> {
        let ends = |values: Option<&[f64]>, base: f64| match values {
            None | Some([]) => [base; 2],
            Some(values) => [
                values.iter().copied().fold(f64::INFINITY, f64::min),
                values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ],
        };
        let young_modulus = ends(self.young_modulus, self.material.young_modulus);
        let poisson_ratio = ends(self.poisson_ratio, self.material.poisson_ratio);
        let density = ends(self.density, self.material.density);
        let mut found: Vec<MaterialFinding> = Vec::new();
        for end in 0..2 {
            let material = YoungPoisson {
                young_modulus: young_modulus[end],
                poisson_ratio: poisson_ratio[end],
                density: density[end],
            };
            for finding in material.findings() {
                let told = |old: &MaterialFinding| {
                    (old.code, old.remedy) == (finding.code, finding.remedy)
                };
                if !found.iter().any(told) {
                    found.push(finding);
                }
            }
        }
        found
    }

    /// Whether elements have values of their own.
    pub fn varies(&self) -> bool {
        self.young_modulus.or(self.poisson_ratio).or(self.density).is_some()
            || self.filled.is_some()
    }

    /// Checks the material of every element.
    ///
    /// # Errors
    /// A constant out of range, naming the element, or an array of another length.
    pub fn validate(&self, tetrahedra: usize, hexahedra: usize) -> Result<(), FieldError> {
        self.lame(tetrahedra, hexahedra).map(drop)
    }

    /// Lamé parameters (Pa) of every element, in the user's order, tetrahedra first.
    ///
    /// # Errors
    /// As [`validate`](Self::validate).
    pub fn lame(
        &self,
        tetrahedra: usize,
        hexahedra: usize,
    ) -> Result<Vec<LameParameters>, FieldError> {
        let count = tetrahedra + hexahedra;
        let length = |field: Option<&[f64]>| field.map(<[f64]>::len);
        let fields = [
            ("Young's modulus", length(self.young_modulus)),
            ("Poisson's ratio", length(self.poisson_ratio)),
            ("density", length(self.density)),
            ("what is filled", self.filled.map(<[Filled]>::len)),
        ];
        for (quantity, found) in fields {
            if let Some(found) = found.filter(|&n| n != count) {
                return Err(FieldError::Length { quantity, found, expected: count });
            }
        }
        let shares = self.filled.unwrap_or_default().iter().copied().enumerate();
        for (element, filled) in shares {
            let (kind, index) = match element.checked_sub(tetrahedra) {
                None => (ElementKind::Tetrahedron, element),
                Some(hexahedron) => (ElementKind::Hexahedron, hexahedron),
            };
            let share = filled.share;
            // sums of shares may round up
            if !(share > 0.0 && share <= 1.0 + 1e-9) {
                return Err(FieldError::Filled { kind, index, share });
            }
            if !filled.is_possible() {
                return Err(FieldError::FilledPlace { kind, index, filled: Box::new(filled) });
            }
        }
        if count == 0 {
            // a body of sheets alone, which check their own material
            let sheet = self.material.validate_sheet();
            return sheet.map(|()| Vec::new()).map_err(|e| FieldError::Material(Box::new(e)));
        }
        // a constant that no element uses must be right all the same: it is what reports show
        let whole =
            self.material.lame().map_err(|source| FieldError::Material(Box::new(source)))?;
        if !self.varies() {
            return Ok(vec![whole; count]);
        }
        (0..count)
            .map(|element| {
                self.at(element).lame().map_err(|source| {
                    let source = Box::new(source);
                    match element.checked_sub(tetrahedra) {
                        None => FieldError::Tetrahedron { tetrahedron: element, source },
                        Some(hexahedron) => FieldError::Hexahedron { hexahedron, source },
                    }
                })
            })
            .collect()
    }
}
