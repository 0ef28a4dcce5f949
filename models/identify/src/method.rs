//! One element by a method.

use std::str::FromStr;

use crate::baselines;
use crate::error::{ElementError, IdentifyError};
use crate::fit::freedom::{free_directions, ranges};
use crate::fit::{
    ConstantRange, ElementFit, FitProblem, Sign, block, frobenius, nonnegative, two_norm,
};
use crate::geometry::ElementGeometry;
use crate::kind::{ElementKind, ElementMethod};
use crate::material::{LinearMaterial, Section};
use crate::springs::{directions, spring_vectors};
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

fn problem(
    geometry: &ElementGeometry,
    material: &LinearMaterial,
    section: &Section,
) -> Result<FitProblem, ElementError> {
    Ok(FitProblem {
        stiffness: element_stiffness(geometry, material, section)?,
        springs: spring_vectors(geometry),
        dimension: geometry.kind().dimension(),
    })
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
    let problem = problem(geometry, material, section)?;
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
    if method == ElementMethod::TwoNorm {
        fit.two_norm_freedom = Some(free_directions(&problem, &fit.constants).ncols());
    }
    fit.two_norm_bound = bound.map(|b| b / crate::fit::spectral_norm(problem.stiffness));
    Ok(fit)
}

/// Rest lengths that differ by less than this part are equal.
const EQUAL: f64 = 1e-9;

/// How far the constants of a 2-norm fit may move, springs of equal rest length together, while the norm rises by the part
/// `rise` of itself at most. Without `rise`: the constants of the least norm, of those springs of which it does not
/// determine them; none where the fit is unique.
///
/// # Errors
/// As [`fit_element`].
///
/// # Panics
/// If `constants` are not as many as the element has springs.
///
/// ```
/// use sinew_identify::method::{constant_ranges, fit_element};
/// use sinew_identify::{ElementGeometry, ElementKind, ElementMethod, LinearMaterial, Section};
///
/// // a square in plane stress: the least norm is that of stretch and hourglass, which diagonals do not feel
/// let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
/// let square = ElementGeometry::planar(ElementKind::Quad, &square)?;
/// let (material, section) = (LinearMaterial::new(1.0, 0.3)?, Section::default());
/// let fit = fit_element(&square, &material, &section, ElementMethod::TwoNorm)?;
/// let free = constant_ranges(&square, &material, &section, &fit.constants, None)?;
/// assert_eq!((free.len(), &free[0].springs[..]), (1, &[1, 4][..]));
/// assert!((free[0].range[0] - 0.32967).abs() < 1e-5 && (free[0].range[1] - 0.45330).abs() < 1e-5);
/// # Ok::<(), sinew_identify::ElementError>(())
/// ```
pub fn constant_ranges(
    geometry: &ElementGeometry,
    material: &LinearMaterial,
    section: &Section,
    constants: &[f64],
    rise: Option<f64>,
) -> Result<Vec<ConstantRange>, ElementError> {
    let problem = problem(geometry, material, section)?;
    assert_eq!(constants.len(), problem.springs.ncols(), "one constant for each spring");
    let mut groups: Vec<(f64, Vec<usize>)> = Vec::new();
    for (spring, (length, _)) in directions(geometry).into_iter().enumerate() {
        match groups.iter_mut().find(|g| (g.0 - length).abs() <= EQUAL * length) {
            Some(group) => group.1.push(spring),
            None => groups.push((length, vec![spring])),
        }
    }
    let groups: Vec<_> = groups.into_iter().map(|g| g.1).collect();
    Ok(ranges(&problem, constants, &groups, rise))
}
