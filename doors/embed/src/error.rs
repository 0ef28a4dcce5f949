//! Errors as a code and a text.

use crate::handle::HandleError;
use sinew::engine::load::TargetError;
use sinew::engine::mesh::{CheckError, MeshError};
use sinew::engine::step::StepError;
use sinew::identify::IdentifyError;
use sinew::models::axes::description::AxesError;
use sinew::models::axes::muscle::ActivationError;
use sinew::models::body::BodyError;
use sinew::models::cutting::CutError;
use sinew::models::material::MaterialError;
use sinew::models::material::field::FieldError;
use sinew::models::resection::RemovalError;
use sinew::simulation::SimulationError;
use sinew::snapshot::SnapshotError;
use sinew::touch::field::DistanceFieldError as ShapeError;
use sinew::touch::thread::ThreadError;
use sinew::touch::tool::ToolError;
use sinew_scene::error::SceneError;
use std::fmt;

/// Kind of an error; the numbers never change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(i32)]
pub enum Code {
    /// No error.
    Ok = 0,
    /// An argument that cannot be used.
    Argument = 1,
    /// A mesh.
    Mesh = 2,
    /// A material.
    Material = 3,
    /// A scene file.
    Scene = 4,
    /// A step that could not be carried out; the state is that before it.
    Step = 5,
    /// What the machine or the build does not have: threads, instruction set, graphics processor.
    Backend = 6,
    /// A file.
    Io = 7,
    /// A snapshot.
    Snapshot = 8,
    /// A handle of something that is gone, of another kind or of another simulation.
    Handle = 9,
    /// Another call uses the simulation.
    Busy = 10,
    /// The engine panicked, now or before; the simulation cannot be used any more.
    Panic = 99,
}

/// What went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EmbedError {
    /// Kind.
    pub code: Code,
    /// What, where, and what to do: the text of the typed error.
    pub text: String,
}

/// What doors of this crate answer.
pub type Result<T> = std::result::Result<T, EmbedError>;

impl EmbedError {
    /// An error with a text.
    pub fn new(code: Code, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }
}

impl fmt::Display for EmbedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl std::error::Error for EmbedError {}

/// An argument that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// Too few or too many numbers.
    #[error("{what}: {given} numbers given, {expected} needed")]
    Count {
        /// Of what.
        what: &'static str,
        /// Numbers given.
        given: usize,
        /// What is needed, in words.
        expected: String,
    },
    /// NaN or infinite.
    #[error("{what}: number {index} (from 0) is {value}; give finite numbers")]
    NotFinite {
        /// Of what.
        what: &'static str,
        /// Which one.
        index: usize,
        /// The value.
        value: f64,
    },
    /// An index beyond what there is.
    #[error(
        "{what}: index {index} at place {place} (from 0) is beyond the {count} {of}, which count from 0"
    )]
    Index {
        /// Of what.
        what: String,
        /// The index.
        index: u32,
        /// Where it stands.
        place: usize,
        /// How many there are.
        count: usize,
        /// Of what there are so many.
        of: &'static str,
    },
    /// A name or word that does not exist.
    #[error("unknown {kind} `{name}`; {hint}")]
    Unknown {
        /// What was looked for.
        kind: &'static str,
        /// What was given.
        name: String,
        /// Near misses, or all that exist.
        hint: String,
    },
    /// A name that something else has.
    #[error("there is a {kind} `{name}` already; names must be unique")]
    Duplicate {
        /// What it is.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A value out of range, or a combination that means nothing.
    #[error("{what}: {problem}")]
    Invalid {
        /// Of what.
        what: String,
        /// What is wrong, and the remedy.
        problem: String,
    },
}

impl InputError {
    pub(crate) fn invalid(what: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), problem: problem.into() }
    }
}

/// Typed errors, each with its code; the text is theirs.
macro_rules! codes {
    ($($error:ty => $code:expr;)*) => {$(
        impl From<$error> for EmbedError {
            fn from(error: $error) -> Self {
                let code: fn(&$error) -> Code = $code;
                Self { code: code(&error), text: error.to_string() }
            }
        }
    )*};
}

codes! {
    InputError => |_| Code::Argument;
    HandleError => |_| Code::Handle;
    MeshError => mesh;
    CheckError => |_| Code::Mesh;
    MaterialError => |_| Code::Material;
    FieldError => |_| Code::Material;
    AxesError => |_| Code::Material;
    IdentifyError => |_| Code::Argument;
    SceneError => |e| if matches!(e, SceneError::Io { .. }) { Code::Io } else { Code::Scene };
    StepError => |_| Code::Step;
    BodyError => body;
    SimulationError => simulation;
    TargetError => |e| if matches!(e, TargetError::NoConstraint(_)) { Code::Handle } else { Code::Argument };
    ToolError => |e| if matches!(e, ToolError::NoTool(_)) { Code::Handle } else { Code::Argument };
    ThreadError => |e| if matches!(e, ThreadError::NoThread(_)) { Code::Handle } else { Code::Argument };
    ShapeError => |_| Code::Mesh;
    RemovalError => |_| Code::Argument;
    CutError => |_| Code::Argument;
    ActivationError => |_| Code::Argument;
    SnapshotError => |_| Code::Snapshot;
}

fn mesh(error: &MeshError) -> Code {
    match error {
        MeshError::Io { .. } => Code::Io,
        MeshError::InvalidParameter { .. } => Code::Argument,
        _ => Code::Mesh,
    }
}

fn body(error: &BodyError) -> Code {
    match error {
        BodyError::Material { .. }
        | BodyError::Axes { .. }
        | BodyError::SpringConstant { .. }
        | BodyError::HexahedronModel { .. }
        | BodyError::Integration { .. }
        | BodyError::Evaluation { .. }
        | BodyError::Glue { .. }
        | BodyError::Law { .. }
        | BodyError::Springs { .. }
        | BodyError::MissingSprings { .. } => Code::Material,
        _ => Code::Mesh,
    }
}

fn simulation(error: &SimulationError) -> Code {
    match error {
        SimulationError::Body(error) => body(error),
        SimulationError::Step(_) => Code::Step,
        SimulationError::Material { .. } | SimulationError::Axes { .. } => Code::Material,
        SimulationError::Target(_)
        | SimulationError::Vertex { .. }
        | SimulationError::Face { .. }
        | SimulationError::Group { .. }
        | SimulationError::Length { .. } => Code::Argument,
        _ => Code::Backend,
    }
}
