//! Why a bench cannot be carried out.

use sinew::engine::mesh::MeshError;
use sinew::engine::step::StepError;
use sinew::engine::workers::WorkersError;
use sinew::models::body::BodyError;
use sinew::models::element::membrane::RestTriangleError;
use sinew::models::element::precompute::RestTetrahedronError;
use sinew::models::material::MaterialError;
use sinew::simulation::SimulationError;
use sinew_identify::IdentifyError;
use sinew_identify::virtual_test::VirtualTestError;
use sinew_scene::error::{RunError, SceneError};
use sinew_tune::fit::FitError;
use std::path::PathBuf;

/// A bench that cannot be carried out or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A mesh cannot be generated or read.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A simulation cannot be set up or stepped.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A body cannot be built.
    #[error(transparent)]
    Body(#[from] BodyError),
    /// A material is out of range.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// An element has no usable rest shape.
    #[error(transparent)]
    Element(#[from] RestTetrahedronError),
    /// A membrane triangle has no usable rest shape.
    #[error(transparent)]
    Triangle(#[from] RestTriangleError),
    /// A scene cannot be read or built.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene cannot be run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Another engine's process or its answer.
    #[error("{0}")]
    Rival(String),
    /// Springs that cannot be found or tested.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// Springs that cannot be identified.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A virtual test that cannot be carried out.
    #[error(transparent)]
    VirtualTest(#[from] VirtualTestError),
    /// A world lost its columns.
    #[error("the world has no single table of fused tetrahedra: bench one body at a time")]
    NoColumns,
    /// The solution that errors are measured against does not exist.
    #[error("{case}: no converged solution to measure errors against: {reason}")]
    NoTruth {
        /// Which case.
        case: String,
        /// What happened.
        reason: String,
    },
    /// A request that makes no sense.
    #[error("{what}: {remedy}")]
    Request {
        /// What was asked.
        what: String,
        /// What would do.
        remedy: String,
    },
    /// A file cannot be written.
    #[error("{}: {reason}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A chart cannot be drawn.
    #[error("chart: {0}")]
    Chart(String),
}

impl From<StepError> for BenchError {
    fn from(error: StepError) -> Self {
        SimulationError::from(error).into()
    }
}

impl From<WorkersError> for BenchError {
    fn from(error: WorkersError) -> Self {
        SimulationError::from(error).into()
    }
}
