//! Why a bench cannot be carried out.

use std::path::PathBuf;

/// What is measured or written, or why not.
pub type Result<T, E = BenchError> = std::result::Result<T, E>;

/// A bench that cannot be carried out or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The engine, the scenes or the fits refuse something: a mesh, a body, a step, a tool, a scene.
    #[error(transparent)]
    Engine(Box<dyn std::error::Error + Send + Sync>),
    /// Another engine's process or its answer.
    #[error("{0}")]
    Rival(String),
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

macro_rules! of_engine {
    ($($error:ty),+ $(,)?) => {$(
        impl From<$error> for BenchError {
            fn from(error: $error) -> Self {
                Self::Engine(error.into())
            }
        }
    )+};
}
of_engine! {
    sinew::engine::load::TargetError,
    sinew::live::LoopError,
    sinew::engine::mesh::MeshError,
    sinew::engine::step::StepError,
    sinew::engine::workers::WorkersError,
    sinew::haptics::HapticError,
    sinew::models::body::BodyError,
    sinew::models::cutting::CutError,
    sinew::models::element::membrane::RestTriangleError,
    sinew::models::element::precompute::RestTetrahedronError,
    sinew::models::material::MaterialError,
    sinew::models::resection::RemovalError,
    sinew::simulation::SimulationError,
    sinew::snapshot::SnapshotError,
    sinew::touch::tool::ToolError,
    sinew_identify::IdentifyError,
    sinew_identify::virtual_test::VirtualTestError,
    sinew_scene::error::RunError,
    sinew_scene::error::SceneError,
    sinew_tune::fit::FitError,
}
#[cfg(feature = "gpu")]
of_engine!(sinew::gpu::GpuError);
