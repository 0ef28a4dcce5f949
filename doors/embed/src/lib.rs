//! One plain face of Sinew for other languages: bindings to Python, C and others are thin skins over it.
//!
//! * Things are [`Handle`]s, plain numbers. A handle of something that is gone, of another kind or of another simulation is
//!   an error, never another thing.
//! * Numbers come as slices, and state as buffers in the order of the user's vertices, brought up to date when somebody
//!   asks for them.
//! * Every error is an [`EmbedError`]: a [`Code`] that does not change, and the text of the typed error below it, to the
//!   letter.
//!
//! Names of models and settings are those of scene files ([`choice`]). What is plain data already, such as a tool or a curve,
//! is the type of the engine. SI units throughout.
//!
//! ```
//! use sinew_embed::*;
//!
//! let mesh = mesh_from_generator("box = { size = [0.1, 0.1, 0.05], cells = [4, 4, 2] }")?;
//! let mut sim = Embedding::new(&Options { dt: 0.01, ..Options::default() })?;
//! let body = sim.add_body(&mesh, &BodyDescription::new("tissue", &mesh, preset("liver")?))?;
//! let floor = sim.group(body, "z0")?;
//! let held = sim.add_constraint(body, &ConstraintSpec::hold("floor", &floor))?;
//! sim.step(20)?;
//! assert!(sim.reaction(held, [0.0; 3])?.force[2] > 0.0);
//! assert_eq!(sim.positions(body)?.len(), mesh.points.len());
//! # Ok::<(), EmbedError>(())
//! ```
#![forbid(unsafe_code)]

mod act;
mod body;
mod choice;
mod cut;
mod embedding;
mod error;
mod files;
mod film;
mod handle;
mod haptic;
mod live;
mod mesh;
mod snapshot;
mod thread;
mod touch;

pub use act::{ConstraintSpec, TractionOn, Wrench};
pub use body::{Quantity, Surface};
pub use choice::{choice, give_edge, needle, preset, solver_settings, spring_rule};
pub use cut::Skin;
pub use embedding::{Embedding, Energy, Options, Overrides, Report};
pub use error::{Code, EmbedError, InputError, Result};
pub use files::{Files, Folder};
pub use handle::{Handle, HandleError, Kind};
pub use haptic::{HapticDevice, haptic_bits, or_default};
pub use live::{Reader, Shared};
pub use mesh::{
    MembraneCells, MeshArrays, distance_field, group, membrane_cells, mesh_cell_data,
    mesh_from_arrays, mesh_from_bytes, mesh_from_file, mesh_from_generator, mesh_info_json,
    mesh_select,
};
pub use snapshot::Snapshot;
pub use thread::ThreadPoint;
pub use touch::{Pick, PullSpec};

pub use serde::de::DeserializeOwned;

pub use glam::{DMat3, DQuat, DVec3};
pub use sinew::engine::connectivity::ElementKind;
pub use sinew::engine::lanes::InstructionSet;
pub use sinew::engine::load::{Curve, Motion, Pose};
pub use sinew::engine::mesh::{Group, Mesh};
pub use sinew::engine::precision::Precision;
pub use sinew::engine::report::{StepReport, VolumeReport};
pub use sinew::engine::schedule::Executor;
pub use sinew::haptics::{DeviceMotion, Feedback, HapticFlags, HapticOptions};
pub use sinew::models::axes::description::{AxesDescription, AxisAngle, AxisFamily, FibreForm};
pub use sinew::models::axes::muscle::MuscleSettings;
pub use sinew::models::body::lumped::SpringRule;
pub use sinew::models::body::present::MassPolicy;
pub use sinew::models::body::sheet::{
    Bending, MembraneDescription, MembraneModel, PlaneState, RestCurvature,
};
pub use sinew::models::body::{BodyDescription, Evaluation, Integration, MassRule, Model};
pub use sinew::models::cutting::CutReport;
pub use sinew::models::cutting::glue::GlueReport;
pub use sinew::models::cutting::tear::TearReport;
pub use sinew::models::material::YoungPoisson;
pub use sinew::models::material::field::{MaterialArrays, MaterialField};
pub use sinew::models::resection::{Region, RemovalReport};
pub use sinew::simulation::{Backend, MaterialChange, Simulation};
pub use sinew::solvers::settings::{Integrator, SolverSettings};
pub use sinew::touch::field::DistanceField;
pub use sinew::touch::pair::{BodyContact, BodyContactReport};
pub use sinew::touch::pull::PullReport;
pub use sinew::touch::shape::Shape;
pub use sinew::touch::thread::ThreadReport;
pub use sinew::touch::tool::{
    Hinge, Part, PartReport, PathPoint, Points, Stiffness, Tool, ToolMotion, ToolPose, ToolReport,
};
pub use sinew_scene::scene::{BackendName, ExecutorName, PrecisionName};
pub use sinew_scene::warning::Warning;

/// Version of Sinew.
pub fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}
