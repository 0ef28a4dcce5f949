//! What a body of springs is worth: virtual tests against finite elements of the same mesh, and the
//! verdict.

use super::Result;
use super::rig::{Rig, Test};
use serde::{Deserialize, Serialize};
use sinew_identify::LinearMaterial;
use sinew_identify::error_metrics::{PositionErrors, position_errors};
use sinew_identify::mesh::FittedSprings;
use sinew_identify::virtual_test::{
    Loading, SpringOptions, SpringSolution, VirtualTestError, finite_elements, linear_springs,
    rest_length_springs,
};

/// Limits within which springs count as fit for use. Paper B calls errors of a few percent good; a
/// modulus a tenth off is within what is known of most tissues.
pub mod limits {
    /// Largest `%e_rms` of a test.
    pub const RMS_PERCENT: f64 = 5.0;
    /// Largest `%e_max` of a test.
    pub const MAX_PERCENT: f64 = 15.0;
    /// Largest relative deviation of the measured Young's modulus.
    pub const MODULUS: f64 = 0.1;
    /// Largest deviation of the measured Poisson's ratio.
    pub const RATIO: f64 = 0.05;
    /// Poisson's ratio from which a material counts as nearly incompressible: the fits are then
    /// several times too stiff.
    pub const INCOMPRESSIBLE: f64 = 0.4;
}

/// Springs in one virtual test, with their stiffness at rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TestOutcome {
    /// Which test: tension, shear, torsion or bending.
    pub test: String,
    /// `%e_rms` against finite elements; none where the springs have no answer.
    pub rms_percent: Option<f64>,
    /// `%e_max` against finite elements.
    pub max_percent: Option<f64>,
    /// Whether the stiffness of the springs is positive definite.
    pub definite: bool,
    /// Whether the errors are within the [`limits`] and the stiffness definite.
    pub fit: bool,
    /// Why there is no answer.
    pub failure: Option<String>,
}

/// Moduli measured on the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyModuli {
    /// Young's modulus (Pa): that of the material times the strain of finite elements over that of the
    /// springs, in free tension, in the middle half of the body.
    pub young_modulus: f64,
    /// Poisson's ratio of the springs there.
    pub poisson_ratio: f64,
    /// Poisson's ratio of the finite elements there: that of the material in straight bodies.
    pub poisson_ratio_of_fem: f64,
    /// Shear modulus (Pa): that of the material times the displacement of the loaded end of finite
    /// elements over that of the springs, in the shear test. Of slender bodies it is bending that is
    /// seen. None where the springs have no answer.
    pub shear_modulus: Option<f64>,
    /// Whether the held end was clamped, since the springs have no answer in free tension: Poisson's
    /// ratios are then lower than those of the material.
    pub clamped: bool,
}

/// What the virtual tests found, and the verdict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Assessment {
    /// Tests in the order of [`Test::ALL`].
    pub tests: Vec<TestOutcome>,
    /// Measured moduli; none where the springs have no answer.
    pub moduli: Option<BodyModuli>,
    /// Axis of the tests: x, y or z.
    pub axis: String,
    /// Nodes held and loaded.
    pub gripped: [usize; 2],
    /// Whether the loaded end was no flat face, so that all its nodes got the same force.
    pub equal_forces: bool,
    /// Whether every test, both moduli and the signs of the constants are within the limits.
    pub fit: bool,
    /// The verdict in sentences.
    pub verdict: Vec<String>,
}

/// Springs under one loading.
#[derive(Clone, Debug)]
pub struct SpringsAgainst {
    /// Errors against the reference.
    pub errors: PositionErrors,
    /// Displacements (m) of the springs.
    pub displacements: Vec<[f64; 3]>,
    /// Whether their stiffness is positive definite.
    pub definite: bool,
}

/// Displacements (m) of linear finite elements.
///
/// # Errors
/// [`VirtualTestError`].
pub fn reference(
    rig: &Rig,
    material: &LinearMaterial,
    loading: &Loading,
) -> Result<Vec<[f64; 3]>, VirtualTestError> {
    finite_elements(&rig.points, &rig.cells(), &[*material], &rig.section, loading)
}

/// Springs under a loading, linear ones without `options`, and their distance from the displacements
/// `fem` (m).
///
/// # Errors
/// [`VirtualTestError`].
pub fn against(
    rig: &Rig,
    springs: &FittedSprings,
    loading: &Loading,
    fem: &[[f64; 3]],
    options: Option<SpringOptions>,
) -> Result<SpringsAgainst, VirtualTestError> {
    let FittedSprings { edges, constants, .. } = springs;
    let (points, dimension) = (&rig.points, rig.dimension);
    let SpringSolution { displacements, definite, .. } = match options {
        None => linear_springs(points, edges, constants, dimension, loading)?,
        Some(options) => {
            rest_length_springs(points, edges, constants, dimension, loading, &options)?
        }
    };
    let errors = position_errors(points, &placed(points, fem), &placed(points, &displacements))?;
    Ok(SpringsAgainst { errors, displacements, definite })
}

fn placed(points: &[[f64; 3]], u: &[[f64; 3]]) -> Vec<[f64; 3]> {
    points.iter().zip(u).map(|(x, u)| [x[0] + u[0], x[1] + u[1], x[2] + u[2]]).collect()
}

/// Tests springs against finite elements of the same mesh and judges them.
///
/// # Errors
/// [`FitError`](super::FitError) when the finite elements themselves have no answer: the ends do not hold the body.
pub fn assess(rig: &Rig, material: &LinearMaterial, springs: &FittedSprings) -> Result<Assessment> {
    let stress = Rig::stress(material);
    let mut tests = Vec::new();
    let mut shear = None;
    for test in Test::ALL.into_iter().filter(|t| t.serves(rig.dimension)) {
        let loading = rig.loading(test, stress);
        let fem = reference(rig, material, &loading)?;
        let answer = against(rig, springs, &loading, &fem, None);
        if let (Test::Shear, Ok(own)) = (test, &answer) {
            let ratio = rig.drift(&fem) / rig.drift(&own.displacements);
            shear = ratio.is_finite().then_some(ratio);
        }
        let errors = answer.as_ref().ok().map(|own| own.errors);
        let definite = answer.as_ref().is_ok_and(|own| own.definite);
        let within = errors.is_some_and(|e| {
            e.rms_percent <= limits::RMS_PERCENT && e.max_percent <= limits::MAX_PERCENT
        });
        tests.push(TestOutcome {
            test: test.name().to_string(),
            rms_percent: errors.map(|e| e.rms_percent),
            max_percent: errors.map(|e| e.max_percent),
            definite,
            fit: definite && within,
            failure: answer.err().map(|error| error.to_string()),
        });
    }
    let measured = moduli(rig, material, springs, shear)?;
    let (fit, verdict) = judge(rig, material, springs, &tests, measured.as_ref());
    Ok(Assessment {
        tests,
        moduli: measured,
        axis: ["x", "y", "z"][rig.axis].to_string(),
        gripped: [rig.held.len(), rig.loaded.len()],
        equal_forces: rig.facets.is_empty(),
        fit,
        verdict,
    })
}

/// Measures moduli in free tension; springs that have no answer there, such as cubes without face
/// diagonals, with the held end clamped.
fn moduli(
    rig: &Rig,
    material: &LinearMaterial,
    springs: &FittedSprings,
    shear: Option<f64>,
) -> Result<Option<BodyModuli>> {
    let stress = Rig::stress(material);
    for clamped in [false, true] {
        let loading =
            if clamped { rig.loading(Test::Tension, stress) } else { rig.free_tension(stress) };
        let fem = reference(rig, material, &loading)?;
        let Ok(own) = against(rig, springs, &loading, &fem, None) else { continue };
        let both = [rig.moduli(&fem, stress), rig.moduli(&own.displacements, stress)];
        let [Some(fem), Some(own)] = both else { continue };
        let shear_of_material = material.youngs_modulus / (2.0 * (1.0 + material.poissons_ratio));
        let moduli = BodyModuli {
            young_modulus: material.youngs_modulus * fem.strain / own.strain,
            poisson_ratio: own.poissons_ratio,
            poisson_ratio_of_fem: fem.poissons_ratio,
            shear_modulus: shear.map(|ratio| shear_of_material * ratio),
            clamped,
        };
        if moduli.young_modulus.is_finite() {
            return Ok(Some(moduli));
        }
    }
    Ok(None)
}

/// Whether springs are fit for use, and why, in words.
fn judge(
    rig: &Rig,
    material: &LinearMaterial,
    springs: &FittedSprings,
    tests: &[TestOutcome],
    moduli: Option<&BodyModuli>,
) -> (bool, Vec<String>) {
    let mut verdict = Vec::new();
    let good: Vec<&str> = tests.iter().filter(|t| t.fit).map(|t| t.test.as_str()).collect();
    let bad: Vec<String> = tests.iter().filter(|t| !t.fit).map(TestOutcome::blame).collect();
    let within = format!(
        "within {} % rms and {} % at worst of finite elements",
        limits::RMS_PERCENT,
        limits::MAX_PERCENT
    );
    if !good.is_empty() {
        verdict.push(format!("fit for use in {} ({within})", good.join(", ")));
    }
    if !bad.is_empty() {
        verdict.push(format!("not fit for use in {}", bad.join("; ")));
    }
    let mut fit = bad.is_empty();
    let (asked, nu) = (material.youngs_modulus, material.poissons_ratio);
    match moduli {
        Some(m) => {
            let off = m.young_modulus / asked - 1.0;
            if off.abs() > limits::MODULUS {
                fit = false;
                verdict.push(format!(
                    "Young's modulus comes out {:.0} % too {}: scale the constants, or take another method",
                    100.0 * off.abs(),
                    if off > 0.0 { "high" } else { "low" }
                ));
            }
            let own = if rig.dimension == 2 { "1/3 in the plane" } else { "1/4 in a solid" };
            let says = if (m.poisson_ratio - m.poisson_ratio_of_fem).abs() > limits::RATIO {
                fit = false;
                "not fit where the ratio matters"
            } else {
                "near enough here"
            };
            verdict.push(format!(
                "Poisson's ratio is {:.3} where {nu} was asked for: central springs cannot hold a free \
                 Poisson's ratio (their own is about {own}); {says}",
                m.poisson_ratio
            ));
        }
        None => {
            fit = false;
            verdict.push("the springs have no stiffness in tension".to_string());
        }
    }
    if nu >= limits::INCOMPRESSIBLE {
        fit = false;
        verdict.push(format!(
            "not fit for nearly incompressible tissue (Poisson's ratio {nu}): take elements, such as the \
             models svk_comp or corotational"
        ));
    }
    let report = &springs.report;
    if report.negative_edges > 0 {
        fit = false;
        verdict.push(format!(
            "{} of {} springs have negative constants: explicit steps may blow up and implicit ones must \
             project; --element-method nonnegative has none",
            report.negative_edges,
            springs.edges.len()
        ));
    }
    let headline = match (fit, good.is_empty()) {
        (true, _) => "FIT FOR USE",
        (false, false) => "FIT FOR SOME USES ONLY",
        (false, true) => "NOT FIT FOR USE",
    };
    verdict.insert(0, headline.to_string());
    (fit, verdict)
}

impl TestOutcome {
    /// Why it is not fit.
    fn blame(&self) -> String {
        match (self.rms_percent, self.max_percent) {
            (Some(rms), Some(max)) if self.definite => {
                format!("{} ({rms:.1} % rms, {max:.1} % at worst)", self.test)
            }
            (Some(_), _) => format!("{} (the stiffness of the springs is not positive)", self.test),
            _ => format!("{} (no answer)", self.test),
        }
    }
}
