//! What can be wrong with a fit; every message says where, what and what to do.

use sinew::engine::step::StepError;
use sinew::simulation::SimulationError;
use sinew_scene::error::SceneError;
use std::path::PathBuf;

/// What may fail in a fit.
pub type Result<T, E = DataFitError> = std::result::Result<T, E>;

/// A fit that cannot be carried out.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataFitError {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file of observations cannot be read.
    #[error("{path}: {source}; check that the path exists and may be read")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system said.
        source: csv::Error,
    },
    /// A file of observations is no table.
    #[error("{path}: {source}; write UTF-8 text, and in every row as many cells as in the header")]
    Table {
        /// Path of the file.
        path: PathBuf,
        /// What the CSV reader said, with the line.
        source: csv::Error,
    },
    /// The header of a file of observations.
    #[error("{path}: {found}; {remedy}")]
    Header {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong.
        found: String,
        /// What to write.
        remedy: String,
    },
    /// A cell of a file of observations.
    #[error("{path}, line {line}, column `{column}`: {found}; {remedy}")]
    Cell {
        /// Path of the file.
        path: PathBuf,
        /// Line, counted from 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// What was given.
        found: String,
        /// What is valid.
        remedy: String,
    },
    /// A parameter that the scene does not have, or a bound out of range.
    #[error("{option}: {found}; {remedy}")]
    Option {
        /// The option as it was given.
        option: String,
        /// What is wrong.
        found: String,
        /// What is valid.
        remedy: String,
    },
    /// The scene is dynamic.
    #[error(
        "{file}: the scene is dynamic, and parameters are fitted to equilibria; set mode = \"static\", \
         leave out dt and duration, and let every row of the data name its `load`"
    )]
    Dynamic {
        /// The scene file.
        file: PathBuf,
    },
    /// Something touches the bodies of the scene.
    #[error(
        "{file}: the scene has tools, pulls, contacts, threads or clips, which the derivatives of a fit know nothing of; use \
         constraints and loads instead"
    )]
    Contact {
        /// The scene file.
        file: PathBuf,
    },
    /// A law whose tangent is not the derivative of its forces.
    #[error(
        "body `{body}` has the model \"corotational_warped\", whose tangent is not the derivative of its \
         forces: equilibria cannot be found closely enough for derivatives; use model = \
         \"corotational\", which has the same forces"
    )]
    NoTangent {
        /// Name of the body.
        body: String,
    },
    /// Fewer observations than parameters.
    #[error(
        "{observations} observed numbers for {parameters} parameters; give more data or fit fewer \
         parameters"
    )]
    TooFew {
        /// Observed numbers.
        observations: usize,
        /// Parameters.
        parameters: usize,
    },
    /// The starting values have no equilibrium.
    #[error(
        "no equilibrium was found at load {load} with {parameters}: {reason}; start from other values \
         in the scene, or raise load_steps or solver.max_newton_iterations"
    )]
    NoEquilibrium {
        /// Load factor.
        load: f64,
        /// Values of the parameters.
        parameters: String,
        /// What the solver said.
        reason: String,
    },
    /// The tangent at an equilibrium cannot be inverted.
    #[error(
        "the equilibrium at load {load} is not stable: its tangent stiffness {found}, so that its change \
         with the parameters is not defined; use smaller loads, more constraints, or a law without a \
         snap-through"
    )]
    Unstable {
        /// Load factor.
        load: f64,
        /// What the solver found.
        found: &'static str,
    },
    /// A step that the engine refuses.
    #[error(transparent)]
    Step(#[from] StepError),
    /// Anything else that the engine refuses.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
}

impl DataFitError {
    /// An option that cannot be used.
    pub(super) fn option(option: String, found: String, remedy: String) -> Self {
        Self::Option { option, found, remedy }
    }
}
