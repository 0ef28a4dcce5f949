//! What can be wrong with a scene or a run; every message says where, what and what to do.

use sinew::engine::mesh::{CheckError, MeshError};
use sinew::engine::step::StepError;
use sinew::models::axes::description::AxesError;
use sinew::models::axes::field::FibreError;
use sinew::models::body::BodyError;
use sinew::models::cutting::CutError;
use sinew::models::material::MaterialError;
use sinew::models::material::field::FieldError;
use sinew::replay::ReplayError;
use sinew::simulation::SimulationError;
use sinew::snapshot::SnapshotError;
use std::fmt;
use std::path::PathBuf;

/// A key of a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The scene file.
    pub file: PathBuf,
    /// Line, counted from 1; `None` when the key is absent or the scene did not come from a file.
    pub line: Option<usize>,
    /// Path of the key, such as `body[0].material.young_modulus` (entries counted from 0).
    pub key: String,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(f, ", line {line}")?;
        }
        if !self.key.is_empty() {
            write!(f, ", `{}`", self.key)?;
        }
        Ok(())
    }
}

/// A scene that cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file cannot be read.
    #[error("{path}: {source}; check that the path exists and may be read")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Something at a key.
    #[error("{place}: {problem}")]
    At {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        problem: SceneProblem,
    },
}

/// What is wrong at a key of a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneProblem {
    /// The file is not TOML, or a value has the wrong type.
    #[error("{0}; see demos/scenes/README.md for every key")]
    Syntax(String),
    /// A key or a choice that does not exist.
    #[error("unknown {kind} `{name}`; {hint}")]
    Unknown {
        /// What was looked for: a key, group, body ...
        kind: &'static str,
        /// What was given.
        name: String,
        /// Near misses, or all that exist.
        hint: String,
    },
    /// A required key is absent.
    #[error("{what} is missing; {remedy}")]
    Missing {
        /// What is missing.
        what: String,
        /// What to write.
        remedy: String,
    },
    /// A value out of range.
    #[error("{found}; {remedy}")]
    Value {
        /// What was given.
        found: String,
        /// What is valid.
        remedy: String,
    },
    /// Two entries with the same name; this is the second one.
    #[error("the name `{name}` is used by another {kind}; names must be unique")]
    Duplicate {
        /// What the entries are.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A selection without vertices.
    #[error("no vertex of body `{body}` is selected; {remedy}")]
    EmptySelection {
        /// Name of the body.
        body: String,
        /// What to do.
        remedy: String,
    },
    /// A vertex index beyond the mesh.
    #[error(
        "vertex {vertex} does not exist, body `{body}` has {count} vertices; indices count from 0 in the order of the mesh"
    )]
    VertexIndex {
        /// Name of the body.
        body: String,
        /// The index.
        vertex: u32,
        /// Vertices in the mesh.
        count: usize,
    },
    /// A static body that could float away.
    #[error(
        "body `{body}` of a static scene is not held against {motion}; without that it has no equilibrium, add a \
         [[constraint]]"
    )]
    NotHeld {
        /// Name of the body.
        body: String,
        /// The free motion.
        motion: String,
    },
    /// A mesh file or a generated shape.
    #[error(transparent)]
    Mesh(Box<MeshError>),
    /// A mesh with errors.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// A material out of range, or an unknown preset.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// Cell data of a mesh file that are no material.
    #[error("cell data `{array}` of {mesh}, {source}")]
    Field {
        /// The mesh file.
        mesh: String,
        /// Name of the data.
        array: String,
        /// What is wrong.
        source: Box<FieldError>,
    },
    /// Fibres that cannot be made.
    #[error(transparent)]
    Fibres(Box<FibreError>),
    /// Axes that cannot be used.
    #[error(transparent)]
    Axes(Box<AxesError>),
    /// A body that cannot be built.
    #[error(transparent)]
    Body(Box<BodyError>),
    /// A body that cannot be cut.
    #[error(transparent)]
    Cut(Box<CutError>),
    /// A setting of the solver.
    #[error(transparent)]
    Setting(#[from] StepError),
    /// Anything else that the engine refuses.
    #[error(transparent)]
    Simulation(Box<SimulationError>),
}

macro_rules! boxed {
    ($($variant:ident: $error:ty;)*) => {$(
        impl From<$error> for SceneProblem {
            fn from(error: $error) -> Self {
                Self::$variant(Box::new(error))
            }
        }
    )*};
}

boxed! {
    Mesh: MeshError;
    Fibres: FibreError;
    Axes: AxesError;
    Body: BodyError;
    Cut: CutError;
    Simulation: SimulationError;
}

/// A run that could not start, or whose results could not be written. A run that diverges is not an
/// error of this kind: it gives a summary with [`crate::summary::RunSummary::failure`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file could not be written.
    #[error("{path}: {source}; check that the folder may be written and has room")]
    Write {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A frame could not be written.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A file could not be read.
    #[error("{path}: {source}; check that it may be read")]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A checkpoint cannot be used.
    #[error("{path}: {message}")]
    Checkpoint {
        /// Its path.
        path: PathBuf,
        /// What is wrong, and what to do.
        message: &'static str,
    },
    /// A log cannot be repeated.
    #[error("{path}: {source}")]
    Log {
        /// Its path.
        path: PathBuf,
        /// Why.
        source: Box<ReplayError>,
    },
    /// The state of the simulation cannot be kept or taken up.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// The command asks for something that the scene does not allow.
    #[error("{option}: {found}; {remedy}")]
    Option {
        /// The option.
        option: &'static str,
        /// What was given.
        found: String,
        /// What is valid.
        remedy: &'static str,
    },
}

/// "did you mean `x`?" for the nearest candidates, or the list of all.
pub fn hint<'a>(kind: &str, name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let all: Vec<&str> = candidates.into_iter().collect();
    let wanted = name.to_lowercase();
    let limit = (wanted.chars().count() / 3).max(1);
    let mut near: Vec<(usize, &str)> = all
        .iter()
        .map(|&c| {
            let candidate = c.to_lowercase();
            let part = wanted.len() >= 3
                && (candidate.contains(&wanted) || wanted.contains(&candidate) && c.len() >= 3);
            (if part { 0 } else { strsim::osa_distance(&wanted, &candidate) }, c)
        })
        .filter(|&(distance, _)| distance <= limit)
        .collect();
    near.sort_unstable();
    near.dedup();
    let quoted =
        |names: &[&str]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    match (near.as_slice(), all.as_slice()) {
        ([], []) => format!("there is no {kind} to choose from"),
        ([], all) => format!("known: {}", quoted(all)),
        (near, _) => {
            let names: Vec<&str> = near.iter().take(3).map(|n| n.1).collect();
            format!("did you mean {}?", quoted(&names))
        }
    }
}
