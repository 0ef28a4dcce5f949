//! One element by a method.

use std::str::FromStr;

use crate::baselines;
use crate::error::{ElementError, IdentifyError};
use crate::fit::{ElementFit, FitProblem, Sign, block, frobenius, nonnegative, two_norm};
use crate::geometry::ElementGeometry;
use crate::kind::{ElementKind, ElementMethod};
use crate::material::{LinearMaterial, Section};
use crate::springs::spring_vectors;
use crate::stiffness::element_stiffness;

impl ElementMethod {
    pub(crate) fn not_served(self, kind: ElementKind) -> ElementError {
        let served: Vec<String> = ElementKind::ALL
            .iter()
            .filter(|k| self.serves(**k))
            .map(ElementKind::to_string)
            .collect();
        ElementError::NotServed { method: self, kind, served: served.join(", ") }
    }
}

impl FromStr for ElementMethod {
    type Err = IdentifyError;

    /// ```
    /// use sinew_identify::ElementMethod;
    ///
    /// assert_eq!("two-norm".parse(), Ok(ElementMethod::TwoNorm));
    /// assert_eq!("paper-a".parse(), Ok(ElementMethod::Delingette));
    /// assert!("2-norm".parse::<ElementMethod>().unwrap_err().to_string().contains("two-norm"));
    /// ```
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let called = |m: &Self| m.name() == name || m.old_name() == Some(name);
        Self::ALL.into_iter().find(called).ok_or_else(|| {
            let known: Vec<_> = Self::ALL.iter().map(|m| m.name()).collect();
            IdentifyError::UnknownMethod { name: name.to_owned(), known: known.join(", ") }
        })
    }
}

/// Spring constants (N/m) of one element, and how well they meet its finite element stiffness.
///
/// # Errors
/// Whatever is wrong with material, section or shape for this method; see [`ElementError`].
///
/// ```
/// use sinew_identify::{
///     ElementGeometry, ElementKind, ElementMethod, LinearMaterial, Section, fit_element,
/// };
///
/// // a square in plane stress with lambda = mu = 3/8 E: full fit 5 lambda/21 + 4 mu/7 on the sides
/// let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
/// let square = ElementGeometry::planar(ElementKind::Quad, &square)?;
/// let material = LinearMaterial::new(1.0, 1.0 / 3.0)?;
/// let fit = fit_element(&square, &material, &Section::default(), ElementMethod::Frobenius)?;
/// assert!((fit.constants[0] - 0.375 * 17.0 / 21.0).abs() < 1e-15);
/// // and the printed closed form gives Lloyd's 5/16 and 7/16
/// let fit = fit_element(&square, &material, &Section::default(), ElementMethod::Block)?;
/// assert!((fit.constants[0] - 5.0 / 16.0).abs() < 1e-15);
/// assert!((fit.constants[1] - 7.0 / 16.0).abs() < 1e-15);
/// # Ok::<(), sinew_identify::ElementError>(())
/// ```
pub fn fit_element(
    geometry: &ElementGeometry,
    material: &LinearMaterial,
    section: &Section,
    method: ElementMethod,
) -> Result<ElementFit, ElementError> {
    let problem = FitProblem {
        stiffness: element_stiffness(geometry, material, section)?,
        springs: spring_vectors(geometry),
        dimension: geometry.kind().dimension(),
    };
    let mut bound = None;
    let constants = match method {
        ElementMethod::Frobenius => frobenius(&problem)?,
        ElementMethod::Block => block(&problem),
        ElementMethod::Nonnegative => nonnegative(&problem)?,
        ElementMethod::TwoNorm | ElementMethod::TwoNormNonnegative => {
            let sign =
                if method == ElementMethod::TwoNorm { Sign::Free } else { Sign::Nonnegative };
            let (constants, lower) = two_norm(&problem, sign)?;
            bound = Some(lower);
            constants
        }
        ElementMethod::VanGelder
        | ElementMethod::VanGelderFull
        | ElementMethod::Lloyd
        | ElementMethod::Baudet
        | ElementMethod::Delingette => baselines::constants(method, geometry, material, section)?
            .ok_or_else(|| method.not_served(geometry.kind()))?,
    };
    let mut fit = ElementFit::measure(&problem, constants);
    fit.two_norm_bound = bound.map(|b| b / crate::fit::spectral_norm(problem.stiffness));
    Ok(fit)
}
