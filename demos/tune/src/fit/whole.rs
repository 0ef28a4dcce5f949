//! `sinew fit --to body|forces`: constants found for the body as a whole instead of element by element.

use super::rig::{Rig, Test};
use super::{FitError, Result};
use serde::{Deserialize, Serialize};
use sinew_identify::mesh::FittedSprings;
use sinew_identify::virtual_test::finite_elements;
pub use sinew_identify::virtual_test::whole::Sharing;
use sinew_identify::virtual_test::whole::{State, WholeBody, WholeFit};
use sinew_identify::{IdentifyError, LinearMaterial};

/// What of a body its springs are to meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Its assembled stiffness, in the Frobenius norm.
    Body,
    /// The nodal forces of finite elements in states of the virtual tests, with rest lengths.
    Forces,
}

/// How constants of a whole body are found.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeRequest {
    /// What they are to meet.
    pub target: Target,
    /// Which springs share a constant.
    pub sharing: Sharing,
    /// Amplitudes of the states: largest displacement over the length of the body.
    pub amplitudes: Vec<f64>,
}

/// Amplitudes of states without others: the strains of paper B's tests.
pub const AMPLITUDES: [f64; 3] = [0.1, 0.15, 0.2];
/// Tests whose states are met. Torsion and bending turn parts of the body, where the forces of linear finite elements are none
/// to meet.
const TESTS: [Test; 2] = [Test::Tension, Test::Shear];
/// Gradient above which constants are not settled.
const SETTLED: f64 = 1e-9;

/// How a fit of a whole body went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WholeReport {
    /// What is met.
    pub target: Target,
    /// Which springs share a constant.
    pub sharing: Sharing,
    /// Unknowns.
    pub unknowns: usize,
    /// Moduli (Pa) by what has them, where springs share them.
    pub moduli: Vec<(String, f64)>,
    /// Distance from what is met, relative to it.
    pub residual: f64,
    /// The same of springs that are fitted element by element, by the method of the body.
    pub residual_of_elements: f64,
    /// States of the virtual tests, where forces are met: test and amplitude.
    pub states: Vec<(String, f64)>,
    /// Iterations.
    pub iterations: usize,
    /// Gradient left, relative to that without springs.
    pub gradient: f64,
}

impl WholeReport {
    /// What is met, by which unknowns, in words.
    pub(super) fn words(&self) -> String {
        let target = match self.target {
            Target::Body => "the assembled stiffness |R - K|_F / |R|_F",
            Target::Forces => "nodal forces with rest lengths",
        };
        let unknowns = match self.sharing {
            Sharing::Springs => format!("{} springs", self.unknowns),
            Sharing::Moduli => format!("{} moduli", self.unknowns),
        };
        format!("{target}, by {unknowns}")
    }

    /// Whether the iteration ended before constants were settled.
    pub(super) fn is_open(&self) -> bool {
        self.gradient > SETTLED
    }
}

impl WholeRequest {
    /// Finds the constants and puts them in the place of those of `springs`, which were found element by element. States need a
    /// rig with ends.
    ///
    /// # Errors
    /// [`FitError`] when an amplitude cannot be used, the tests are not possible, or moduli cannot be told apart.
    pub(super) fn find(
        &self,
        rig: &Rig,
        material: &LinearMaterial,
        springs: &mut FittedSprings,
    ) -> Result<WholeReport> {
        let usable = |a: &&f64| !(**a > 0.0 && a.is_finite());
        if let Some(bad) = self.amplitudes.iter().find(usable) {
            return Err(FitError::Amplitude(*bad));
        }
        let cells = rig.cells();
        let body = WholeBody::new(&rig.points, &cells, &rig.section)?;
        let stiffness = body.stiffness_of_elements(&cells, &[*material], &rig.section)?;
        let shared = |e| FitError::from(IdentifyError::from(e));
        let mut states = Vec::new();
        let (fit, residual_of_elements): (WholeFit, f64) = match self.target {
            Target::Body => {
                let own = body.stiffness_of_springs(&springs.constants);
                let off = stiffness.distance(&own) / stiffness.norm();
                (body.fit_stiffness(&stiffness, self.sharing).map_err(shared)?, off)
            }
            Target::Forces => {
                let mut met: Vec<State> = Vec::new();
                for test in TESTS.into_iter().filter(|test| test.serves(rig.dimension)) {
                    let loading = rig.loading(test, Rig::stress(material));
                    let u =
                        finite_elements(&rig.points, &cells, &[*material], &rig.section, &loading)?;
                    let size = |u: &[f64; 3]| u.iter().map(|x| x * x).sum::<f64>().sqrt();
                    let largest = u.iter().map(size).fold(0.0, f64::max);
                    for &amplitude in &self.amplitudes {
                        let factor = amplitude * rig.length().abs() / largest;
                        let scaled: Vec<_> = u.iter().map(|u| u.map(|x| factor * x)).collect();
                        met.push(body.state(&stiffness, &scaled));
                        states.push((test.name().to_string(), amplitude));
                    }
                }
                let start = body.fit_stiffness(&stiffness, Sharing::Springs).map_err(shared)?;
                let off = body.force_residual(&met, &springs.constants);
                let fit = body.fit_forces(&met, self.sharing, &start.constants).map_err(shared)?;
                (fit, off)
            }
        };
        springs.set_constants(fit.constants);
        let moduli = fit.moduli.into_iter().map(|(kind, modulus)| (kind.to_string(), modulus));
        Ok(WholeReport {
            target: self.target,
            sharing: self.sharing,
            unknowns: fit.unknowns,
            moduli: moduli.collect(),
            residual: fit.residual,
            residual_of_elements,
            states,
            iterations: fit.iterations,
            gradient: fit.gradient,
        })
    }
}
