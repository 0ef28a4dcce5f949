//! Isotropic elastic materials: what the user states, and the Lamé parameters derived from it.
//!
//! Solids, with Young's modulus `E` and Poisson's ratio `nu`:
//!
//! ```text
//! lambda = E nu / ((1 + nu)(1 - 2 nu)),   mu = E / (2 (1 + nu)),   -1 < nu < 1/2
//! ```
//!
//! This `mu` is the shear modulus. Delingette 2008 (section 2.1) writes membranes with a `mu` that
//! is twice the shear modulus; [`LameParameters`] is only ever the solid convention.
//!
//! The limit of Poisson's ratio is [`MAX_POISSON_RATIO`]: beyond it displacement-only elements are
//! useless, and well before it (about 0.49) linear tetrahedra lock.

pub mod field;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Largest Poisson's ratio accepted; `lambda` is then about 1700 Young's moduli.
pub const MAX_POISSON_RATIO: f64 = 0.4999;

/// Largest accepted Poisson's ratio of a sheet in plane stress.
pub const MAX_SHEET_POISSON_RATIO: f64 = 0.9999;

/// Elastic constants and density of an isotropic solid, as the user states them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YoungPoisson {
    /// Young's modulus, Pa.
    pub young_modulus: f64,
    /// Poisson's ratio, above -1 and at most [`MAX_POISSON_RATIO`].
    pub poisson_ratio: f64,
    /// Mass per rest volume, kg/m^3.
    pub density: f64,
}

/// Lamé parameters of a solid in Pa; `mu` is the shear modulus.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LameParameters {
    /// First parameter, Pa; negative for a negative Poisson's ratio.
    pub lambda: f64,
    /// Shear modulus, Pa.
    pub mu: f64,
}

/// Why a material cannot be used.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MaterialError {
    /// A parameter is infinite or not a number.
    #[error("{quantity} is {value}: give a finite number")]
    NonFinite {
        /// Name of the parameter.
        quantity: &'static str,
        /// What was given.
        value: f64,
    },
    /// Young's modulus is zero or negative.
    #[error(
        "Young's modulus is {value} Pa: it must be positive (soft tissue: about 1e3 to 1e6 Pa)"
    )]
    YoungModulus {
        /// What was given, Pa.
        value: f64,
    },
    /// Poisson's ratio is -1 or less.
    #[error(
        "Poisson's ratio is {value}: it must be above -1, where the shear modulus becomes infinite \
         (soft tissue: 0.4 to 0.49)"
    )]
    PoissonRatioTooLow {
        /// What was given.
        value: f64,
    },
    /// Poisson's ratio is 1/2 or more.
    #[error(
        "Poisson's ratio is {value}: it must be below 0.5, where the bulk modulus becomes infinite; \
         use 0.45 to 0.49, or for nearly incompressible tissue up to 0.4999 with volume = \"clusters\""
    )]
    PoissonRatioTooHigh {
        /// What was given.
        value: f64,
    },
    /// Poisson's ratio of a sheet is too near to 1.
    #[error(
        "Poisson's ratio of the sheet is {value}: it must be at most {MAX_SHEET_POISSON_RATIO}, since the moduli \
         in its plane grow without bound towards 1"
    )]
    SheetPoissonRatioTooHigh {
        /// What was given.
        value: f64,
    },
    /// Poisson's ratio is between the largest usable value and 1/2.
    #[error(
        "Poisson's ratio is {value}: above {MAX_POISSON_RATIO} no element keeps its accuracy; \
         use 0.45 to 0.49, or for nearly incompressible tissue up to 0.4999 with volume = \"clusters\""
    )]
    NearlyIncompressible {
        /// What was given.
        value: f64,
    },
    /// The density is zero or negative.
    #[error("density is {value} kg/m^3: it must be positive (soft tissue: 900 to 1100 kg/m^3)")]
    Density {
        /// What was given, kg/m^3.
        value: f64,
    },
    /// A modulus or density that no matter has, in whatever system of units.
    #[error(
        "{quantity} is {value:e}: no matter has it in any system of units, and numbers derived from it overflow \
         or vanish; it must be between {least:e} and {most:e}"
    )]
    BeyondAll {
        /// Which parameter.
        quantity: &'static str,
        /// What was given.
        value: f64,
        /// The least that is accepted.
        least: f64,
        /// The most.
        most: f64,
    },
    /// No preset has this name.
    #[error("no tissue preset is called '{name}'; {hint}")]
    UnknownPreset {
        /// What was asked for.
        name: String,
        /// The names closest to it, or all names.
        suggestions: Vec<&'static str>,
        /// The suggestions as a sentence.
        hint: String,
    },
}

/// Something about a valid material that is probably not what was meant.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MaterialFinding {
    /// Stable identifier, e.g. `material.poisson.locking`.
    pub code: &'static str,
    /// What was found, with the value.
    pub message: String,
    /// What to do about it.
    pub remedy: &'static str,
}

/// Young's moduli that are accepted: from a foam in GPa to diamond in uPa.
const YOUNG_RANGE: [f64; 2] = [1e-9, 1e18];
/// Densities that are accepted: from gas in t/mm^3 to lead in ug/m^3.
const DENSITY_RANGE: [f64; 2] = [1e-15, 1e15];

impl YoungPoisson {
    /// Checks the ranges in which the formulas of this crate hold, for solids and plane strain.
    ///
    /// # Errors
    ///
    /// The first parameter out of range, with its value and a remedy.
    pub fn validate(&self) -> Result<(), MaterialError> {
        self.validate_but_for_upper_ratio()?;
        let nu = self.poisson_ratio;
        if nu >= 0.5 {
            return Err(MaterialError::PoissonRatioTooHigh { value: nu });
        }
        if nu > MAX_POISSON_RATIO {
            return Err(MaterialError::NearlyIncompressible { value: nu });
        }
        Ok(())
    }

    /// The same for a sheet in plane stress. As the ratio of a material of two dimensions (Delingette 2008,
    /// section 2.3) it may come near 1; that of a solid cut into a sheet is below 1/2.
    ///
    /// # Errors
    ///
    /// As [`validate`](Self::validate), but with [`MAX_SHEET_POISSON_RATIO`] as the limit.
    ///
    /// ```
    /// use sinew_models::material::YoungPoisson;
    /// let skin = YoungPoisson { young_modulus: 1e5, poisson_ratio: 0.9, density: 1000.0 };
    /// assert!(skin.validate().is_err() && skin.validate_sheet().is_ok());
    /// assert!(YoungPoisson { poisson_ratio: 1.0, ..skin }.validate_sheet().is_err());
    /// ```
    pub fn validate_sheet(&self) -> Result<(), MaterialError> {
        self.validate_but_for_upper_ratio()?;
        match self.poisson_ratio {
            value if value > MAX_SHEET_POISSON_RATIO => {
                Err(MaterialError::SheetPoissonRatioTooHigh { value })
            }
            _ => Ok(()),
        }
    }

    fn validate_but_for_upper_ratio(&self) -> Result<(), MaterialError> {
        let named = [
            ("Young's modulus", self.young_modulus),
            ("Poisson's ratio", self.poisson_ratio),
            ("density", self.density),
        ];
        for (quantity, value) in named {
            if !value.is_finite() {
                return Err(MaterialError::NonFinite { quantity, value });
            }
        }
        if self.young_modulus <= 0.0 {
            return Err(MaterialError::YoungModulus { value: self.young_modulus });
        }
        let nu = self.poisson_ratio;
        if nu <= -1.0 {
            return Err(MaterialError::PoissonRatioTooLow { value: nu });
        }
        if self.density <= 0.0 {
            return Err(MaterialError::Density { value: self.density });
        }
        for (quantity, value, [least, most]) in [
            ("Young's modulus", self.young_modulus, YOUNG_RANGE),
            ("density", self.density, DENSITY_RANGE),
        ] {
            if !(least..=most).contains(&value) {
                return Err(MaterialError::BeyondAll { quantity, value, least, most });
            }
        }
        Ok(())
    }

    /// Lamé parameters of the solid, Pa.
    ///
    /// # Errors
    ///
    /// As [`validate`](Self::validate).
    pub fn lame(&self) -> Result<LameParameters, MaterialError> {
        self.validate()?;
        let (e, nu) = (self.young_modulus, self.poisson_ratio);
        Ok(LameParameters {
            lambda: e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            mu: e / (2.0 * (1.0 + nu)),
        })
    }

    /// Plausibility of a valid material as soft tissue; empty when nothing stands out.
    pub fn findings(&self) -> Vec<MaterialFinding> {
        let mut findings = Vec::new();
        let (e, nu, rho) = (self.young_modulus, self.poisson_ratio, self.density);
        if e < 10.0 {
            findings.push(MaterialFinding {
                code: "material.young.range",
                message: format!("Young's modulus {e} Pa is softer than any solid tissue"),
                remedy: "check the unit: it is Pa, so 5 kPa is 5000",
            });
        } else if e < 100.0 {
            findings.push(MaterialFinding {
                code: "material.young.kilopascal",
                message: format!(
                    "Young's modulus {e} Pa is very soft; {e} kPa would be an ordinary tissue"
                ),
                remedy: "if the source gives kPa, multiply by 1000",
            });
        } else if e > 1e9 {
            findings.push(MaterialFinding {
                code: "material.young.range",
                message: format!("Young's modulus {e} Pa is stiffer than any soft tissue"),
                remedy: "check the unit: it is Pa; model bone or metal as pinned or rigid nodes",
            });
        }
        if nu >= 0.47 {
            findings.push(MaterialFinding {
                code: "material.poisson.locking",
                message: format!(
                    "Poisson's ratio {nu}: elements that keep their volume one by one lock, they bend far too little"
                ),
                remedy: "set volume = \"clusters\", which keeps means, or use 0.45",
            });
        } else if nu < 0.0 {
            findings.push(MaterialFinding {
                code: "material.poisson.auxetic",
                message: format!("Poisson's ratio {nu}: the material widens when stretched"),
                remedy: "check the sign; soft tissue has 0.4 to 0.49",
            });
        }
        if (0.9..=1.2).contains(&rho) {
            findings.push(MaterialFinding {
                code: "material.density.unit",
                message: format!("density {rho} kg/m^3 is that of air; tissue has {rho} g/cm^3"),
                remedy: "if the source gives g/cm^3, multiply by 1000",
            });
        } else if !(100.0..=20_000.0).contains(&rho) {
            findings.push(MaterialFinding {
                code: "material.density.range",
                message: format!("density {rho} kg/m^3 is outside 100 to 20000"),
                remedy: "check the unit: it is kg/m^3, so water is 1000",
            });
        }
        findings
    }
}

/// A starting point for a tissue, with the place where its numbers come from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TissuePreset {
    /// Name for [`preset`], lower case.
    pub name: &'static str,
    /// The constants.
    pub material: YoungPoisson,
    /// What was measured, what was rounded and what was assumed.
    pub note: &'static str,
    /// Literature for Young's modulus and density.
    pub source: &'static str,
}

impl TissuePreset {
    /// The same tissue for elements that do not lock, with a Poisson's ratio of 0.499: tissue is mostly water. Its bulk
    /// modulus is then 167 times Young's modulus, still far below that of water (2.2 GPa), but volume holds to a percent under
    /// pressures that tissue survives.
    ///
    /// ```
    /// use sinew_models::material::preset;
    ///
    /// let liver = preset("liver")?;
    /// assert_eq!((liver.material.poisson_ratio, liver.nearly_incompressible().poisson_ratio), (0.45, 0.499));
    /// # Ok::<(), sinew_models::material::MaterialError>(())
    /// ```
    pub fn nearly_incompressible(&self) -> YoungPoisson {
        YoungPoisson { poisson_ratio: 0.499, ..self.material }
    }
}

const PRESETS: [TissuePreset; 8] = [
    TissuePreset {
        name: "brain",
        material: YoungPoisson { young_modulus: 1.6e3, poisson_ratio: 0.45, density: 1040.0 },
        note: "Between the mean indentation moduli of bovine grey (1.4 kPa) and white (1.9 kPa) \
               matter, rounded. Published values scatter over more than an order of magnitude \
               with rate, strain and preparation. Poisson's ratio is assumed.",
        source: "Budday et al. 2015, J Mech Behav Biomed Mater 46:318-330 (modulus); ICRU Report \
                 44, 1989 (density)",
    },
    TissuePreset {
        name: "fat",
        material: YoungPoisson { young_modulus: 3.3e3, poisson_ratio: 0.45, density: 950.0 },
        note: "Small-strain modulus of excised breast fat, 3.25 kPa rounded. Published values \
               scatter over more than an order of magnitude. Poisson's ratio is assumed.",
        source: "Samani, Zubovits and Plewes 2007, Phys Med Biol 52:1565-1576 (modulus); ICRU \
                 Report 44, 1989 (density)",
    },
    TissuePreset {
        name: "heart",
        material: YoungPoisson { young_modulus: 2.0e4, poisson_ratio: 0.45, density: 1060.0 },
        note: "Relaxed heart muscle taken as isotropic; 20 kPa is an assumed round figure for \
               small passive strains, not a measurement. The tissue is anisotropic, stiffens \
               exponentially with stretch, and reported moduli scatter over more than an order of \
               magnitude. Poisson's ratio is assumed.",
        source: "Fung 1993, Biomechanics: Mechanical Properties of Living Tissues, 2nd ed., \
                 Springer (behaviour; the modulus is assumed); ICRU Report 44, 1989 (density)",
    },
    TissuePreset {
        name: "kidney",
        material: YoungPoisson { young_modulus: 5.0e3, poisson_ratio: 0.45, density: 1050.0 },
        note: "Mean shear-wave elasticity of the renal cortex of healthy volunteers, 5.0 kPa; the \
               renal pelvis measured 23.6 kPa in the same study. Published values scatter over \
               more than an order of magnitude. Poisson's ratio is assumed.",
        source: "Arda et al. 2011, AJR Am J Roentgenol 197:532-536 (modulus); ICRU Report 44, \
                 1989 (density)",
    },
    TissuePreset {
        name: "liver",
        material: YoungPoisson { young_modulus: 5.0e3, poisson_ratio: 0.45, density: 1060.0 },
        note: "Healthy liver: shear-wave moduli of a few kPa or less, times three, rounded. \
               Excised samples under slow compression gave several hundred to several thousand \
               Pa, so values scatter over more than an order of magnitude, and fibrosis stiffens \
               it further. Poisson's ratio is assumed.",
        source: "Palmeri et al. 2008, Ultrasound Med Biol 34:546-558, and Yeh et al. 2002, \
                 Ultrasound Med Biol 28:467-474 (modulus); ICRU Report 44, 1989 (density)",
    },
    TissuePreset {
        name: "muscle",
        material: YoungPoisson { young_modulus: 1.1e4, poisson_ratio: 0.45, density: 1050.0 },
        note: "Relaxed skeletal muscle taken as isotropic: mean shear-wave elasticity of the \
               gastrocnemius at rest, 11.1 kPa rounded. Stiffness depends on direction, stretch \
               and activation and scatters over more than an order of magnitude. Poisson's ratio \
               is assumed.",
        source: "Arda et al. 2011, AJR Am J Roentgenol 197:532-536 (modulus); ICRU Report 44, \
                 1989 (density)",
    },
    TissuePreset {
        name: "phantom",
        material: YoungPoisson { young_modulus: 1.0e4, poisson_ratio: 0.45, density: 1000.0 },
        note: "A soft water-based gel (gelatine or agar) for bench experiments; all three values \
               are assumed round figures. Recipes span about 1 to 100 kPa: measure yours.",
        source: "Hall et al. 1997, IEEE Trans Ultrason Ferroelectr Freq Control 44:1355-1365 \
                 (such materials; the values are assumed)",
    },
    TissuePreset {
        name: "skin",
        material: YoungPoisson { young_modulus: 4.2e5, poisson_ratio: 0.45, density: 1090.0 },
        note: "In-plane modulus of the dermis of younger adults by torsion in vivo, about double \
               in old age. Indentation gives values tens of times lower: published values scatter \
               over several orders of magnitude with method and hydration. Poisson's ratio is \
               assumed.",
        source: "Agache et al. 1980, Arch Dermatol Res 269:221-232 (modulus); ICRU Report 44, \
                 1989 (density)",
    },
];

/// All tissue presets, in alphabetical order.
///
/// They are round starting points for small strains, not patient data: measured moduli of one
/// tissue differ by an order of magnitude and more between methods, rates and subjects. Poisson's
/// ratio is assumed to be 0.45 throughout: tissue is nearly incompressible (0.49 and more), which
/// elements that keep their volume one by one cannot follow; for others there is
/// [`nearly_incompressible`](TissuePreset::nearly_incompressible).
pub fn presets() -> &'static [TissuePreset] {
    &PRESETS
}

/// The preset called `name`, in any letter case.
///
/// # Errors
///
/// [`MaterialError::UnknownPreset`] with the closest names.
///
/// ```
/// use sinew_models::material::preset;
///
/// assert_eq!(preset("Liver")?.material.density, 1060.0);
/// let error = preset("livre").unwrap_err();
/// assert!(error.to_string().contains("did you mean 'liver'"));
/// # Ok::<(), sinew_models::material::MaterialError>(())
/// ```
pub fn preset(name: &str) -> Result<&'static TissuePreset, MaterialError> {
    let wanted = name.trim().to_lowercase();
    if let Some(found) = PRESETS.iter().find(|p| p.name == wanted) {
        return Ok(found);
    }
    // Near misses: a misspelling, or a longer or shorter form of the name.
    let mut close = Vec::new();
    for preset in &PRESETS {
        let distance = strsim::levenshtein(&wanted, preset.name);
        let contains =
            wanted.len() >= 3 && (preset.name.contains(&*wanted) || wanted.contains(preset.name));
        if contains || distance <= 2 {
            close.push((if contains { 0 } else { distance }, preset.name));
        }
    }
    close.sort_unstable();
    let near = !close.is_empty();
    let suggestions: Vec<&'static str> = if near {
        close.into_iter().map(|(_, name)| name).collect()
    } else {
        PRESETS.iter().map(|p| p.name).collect()
    };
    let hint = if near {
        format!("did you mean '{}'?", suggestions.join("' or '"))
    } else {
        format!("known names: {}", suggestions.join(", "))
    };
    Err(MaterialError::UnknownPreset { name: name.to_owned(), suggestions, hint })
}
