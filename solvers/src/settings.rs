//! Settings of the solver.

pub use crate::integrator::Integrator;
use bevy_ecs::prelude::Resource;
use serde::{Deserialize, Serialize};
use sinew_engine::step::StepError;

/// Preconditioner of conjugate gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preconditioner {
    /// By the size of the body, and between 100 and 600 vertices by how many iterations the factor takes alone (default).
    #[default]
    Auto,
    /// Inverse diagonal blocks.
    BlockJacobi,
    /// Incomplete Cholesky factors without fill.
    IncompleteCholesky,
    /// Incomplete Cholesky factors and a coarse space, two levels: the corners of ten-node tetrahedra, or the rigid motions
    /// of aggregates of vertices. On a graphics processor a polynomial of the matrix takes the place of the factors.
    Multigrid,
    /// The complete Cholesky factor, kept while the matrix does not change: for equilibria, constant
    /// matrices and as a reference. Needs the cargo feature `direct`.
    Direct,
}

impl Preconditioner {
    /// Name as in a scene file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::BlockJacobi => "block-jacobi",
            Self::IncompleteCholesky => "incomplete-cholesky",
            Self::Multigrid => "multigrid",
            Self::Direct => "direct",
        }
    }

    /// What `Auto` stands for in a body of `vertices` vertices. `Direct` counts as `Auto` in a build
    /// without the feature, where [`SolverSettings::validate`] refuses it.
    pub fn resolve(self, vertices: usize) -> Self {
        match self {
            Self::Direct if !cfg!(feature = "direct") => Self::Auto.resolve(vertices),
            Self::Auto if vertices < MULTIGRID_FROM => Self::IncompleteCholesky,
            Self::Auto => Self::Multigrid,
            chosen => chosen,
        }
    }
}

/// Vertices from which the coarse space pays.
const MULTIGRID_FROM: usize = 600;

/// Vertices from which it pays where the factor alone takes many iterations.
pub(crate) const MULTIGRID_WHERE_SLOW: usize = 100;

/// Number type in which linear systems are solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LinearPrecision {
    /// `f32`, refined to the tolerance with residuals in the number type of the state (default).
    #[default]
    Mixed,
    /// The number type of the state.
    Full,
}

/// Settings of one linear solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearOptions {
    /// Residual, relative to that of the start vector, at which the system counts as solved.
    pub tolerance: f64,
    /// Cap on iterations.
    pub max_iterations: u32,
    /// Preconditioner.
    pub preconditioner: Preconditioner,
    /// Number type of matrix and iteration.
    pub precision: LinearPrecision,
    /// Residuals are measured against at least this, whatever the start.
    pub reference: f64,
    /// Residual, relative to that of the start vector, at which a solve ends even above the tolerance.
    pub own_tolerance: f64,
    /// The matrix is that of the last solve of the same bodies, but for what contact adds.
    pub same_matrix: bool,
}

impl Default for LinearOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            max_iterations: 5_000,
            preconditioner: Preconditioner::default(),
            precision: LinearPrecision::default(),
            reference: 0.0,
            own_tolerance: 0.0,
            same_matrix: false,
        }
    }
}

/// Settings of the solver; the defaults suit interactive use.
#[derive(Resource, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverSettings {
    /// Time integrator.
    pub integrator: Integrator,
    /// Relative residual at which a linear system counts as solved.
    pub linear_tolerance: f64,
    /// Cap on conjugate-gradient iterations per linear system; reaching it is counted and reported.
    pub max_linear_iterations: u32,
    /// Preconditioner of conjugate gradients.
    pub preconditioner: Preconditioner,
    /// Number type in which linear systems are solved.
    pub linear_precision: LinearPrecision,
    /// Newton step (largest displacement) over body size at which Newton has converged.
    pub newton_tolerance: f64,
    /// Cap on Newton iterations per step; reaching it is reported.
    pub max_newton_iterations: u32,
    /// Rayleigh damping proportional to mass (1/s).
    pub mass_damping: f64,
    /// Rayleigh damping proportional to stiffness (s); implicit integrators only.
    pub stiffness_damping: f64,
    /// Most explicit substeps per step; a step that needs more is refused.
    pub max_substeps: u32,
    /// Fraction of the estimated stability limit used by explicit substeps.
    pub explicit_safety: f64,
    /// Bodies with many inverted elements move by the corotational energy until they are in shape again
    /// (`sinew_solvers::recovery`). On by default; integrators other than `auto`, `safe` and the linearised ones have none.
    pub recovery: bool,
    /// Speed of all its vertices over its size (1/s) below which a body that nothing is near falls asleep after half a second:
    /// it is left where it is until something changes ([`crate::sleep`]). 0, the default, keeps all bodies awake; 1e-4 suits
    /// tissue. Equilibria, explicit integrators and the device have no sleep.
    pub sleep_speed: f64,
}

impl Default for SolverSettings {
    fn default() -> Self {
        Self {
            integrator: Integrator::Auto,
            linear_tolerance: 1e-3,
            max_linear_iterations: 5_000,
            preconditioner: Preconditioner::Auto,
            linear_precision: LinearPrecision::Mixed,
            newton_tolerance: 1e-9,
            max_newton_iterations: 100,
            mass_damping: 0.0,
            stiffness_damping: 0.0,
            max_substeps: 100_000,
            explicit_safety: 0.9,
            recovery: true,
            sleep_speed: 0.0,
        }
    }
}

impl SolverSettings {
    /// Settings of the linear systems.
    pub(crate) fn linear_options(&self) -> LinearOptions {
        LinearOptions {
            tolerance: self.linear_tolerance,
            max_iterations: self.max_linear_iterations,
            preconditioner: self.preconditioner,
            precision: self.linear_precision,
            ..LinearOptions::default()
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`StepError::InvalidSetting`] naming the setting, its value and its range.
    pub fn validate(&self) -> Result<(), StepError> {
        let fail = |name: &str, value: f64, range: &str| {
            Err(StepError::InvalidSetting(format!("{name} = {value}: it must be {range}")))
        };
        let open_unit = |x: f64| x > 0.0 && x < 1.0;
        let non_negative = |x: f64| x >= 0.0 && x.is_finite();
        if !open_unit(self.linear_tolerance) {
            return fail("linear_tolerance", self.linear_tolerance, "between 0 and 1");
        }
        if !open_unit(self.newton_tolerance) {
            return fail("newton_tolerance", self.newton_tolerance, "between 0 and 1");
        }
        if !(self.explicit_safety > 0.0 && self.explicit_safety <= 1.0) {
            return fail("explicit_safety", self.explicit_safety, "above 0 and at most 1");
        }
        if !non_negative(self.mass_damping) {
            return fail("mass_damping", self.mass_damping, "zero or positive (1/s)");
        }
        if !non_negative(self.stiffness_damping) {
            return fail("stiffness_damping", self.stiffness_damping, "zero or positive (s)");
        }
        if !non_negative(self.sleep_speed) {
            return fail("sleep_speed", self.sleep_speed, "zero or positive (1/s)");
        }
        for (name, value) in [
            ("max_linear_iterations", self.max_linear_iterations),
            ("max_newton_iterations", self.max_newton_iterations),
            ("max_substeps", self.max_substeps),
        ] {
            if value == 0 {
                return fail(name, 0.0, "at least 1");
            }
        }
        if self.preconditioner == Preconditioner::Direct && !cfg!(feature = "direct") {
            return Err(StepError::InvalidSetting(
                "preconditioner = \"direct\" is not in this build: build with the cargo feature \
                 `direct`, or use \"auto\""
                    .into(),
            ));
        }
        if self.integrator.is_explicit() && self.stiffness_damping > 0.0 {
            return Err(StepError::InvalidSetting(format!(
                "stiffness_damping = {} with an explicit integrator: it would need a linear system \
                 every substep; use mass_damping, or integrator = \"safe\"",
                self.stiffness_damping
            )));
        }
        Ok(())
    }
}
