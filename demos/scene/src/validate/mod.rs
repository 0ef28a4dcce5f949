//! Reference cases: static fields and single elements from finite-element codes, trajectories from
//! an independent program, and closed forms. Each is run with the engine's own laws and compared with the
//! stored discrete truth on the same mesh. What cannot be run is listed with its reason, never as passed.
//!
//! `demos/reference` holds the cases that come with Sinew; its README describes the files.

mod body;
mod cells;
mod clusters;
mod compare;
mod contact;
mod cutting;
mod law;
mod problem;
mod quadratic;
mod read;
mod report;
mod trajectory;
mod vibration;

pub use read::reference_folder;
pub use report::{Status, ValidationCheck, ValidationReport, ValidationRow};

use read::{ReferenceCase, case_files, file_stem};
use sinew::models::body::Evaluation;
use std::path::{Path, PathBuf};

/// Relative difference to a static field at which a case passes.
pub const STATIC_TOLERANCE: f64 = 1e-6;
/// Difference to an implicit Euler trajectory, over body size, at which a case passes.
pub const TRAJECTORY_TOLERANCE: f64 = 1e-8;

/// Why a case, or all of them, could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaseError {
    /// A file or folder cannot be read, a file is no JSON, or its simulation cannot be set up or does not run.
    #[error("{path}: {source}")]
    File {
        /// File or folder.
        path: PathBuf,
        /// Cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A folder without cases.
    #[error("{0}: no case file (*.json) in this folder or below it")]
    NoCases(PathBuf),
    /// The cases that come with Sinew are not where they should be.
    #[error(
        "the reference cases that come with Sinew are neither in {built} nor in a folder \
         `demos/reference` above any of {starts:?}; run this within a clone of the repository, or name \
         case files or folders of them"
    )]
    NoReference {
        /// Where they were when this was built.
        built: PathBuf,
        /// The program and the working folder.
        starts: Vec<PathBuf>,
    },
    /// A value is missing or not what it should be.
    #[error("{path}: `{field}` is {found}; it must be {expected}")]
    Field {
        /// File.
        path: PathBuf,
        /// Path of the key.
        field: String,
        /// What is there.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A key that means nothing in cases of this schema.
    #[error("{path}: unknown key `{field}`; {hint}")]
    UnknownKey {
        /// File.
        path: PathBuf,
        /// Path of the key.
        field: String,
        /// Known ones.
        hint: String,
    },
    /// The mesh is not found.
    #[error(
        "{case}: mesh `{mesh}` is in none of {searched:?}; put the meshes folder beside the cases' \
         folder or name it with --meshes"
    )]
    NoMesh {
        /// Case file.
        case: PathBuf,
        /// Mesh file named by the case.
        mesh: String,
        /// Where it was looked for.
        searched: Vec<PathBuf>,
    },
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] sinew::engine::mesh::MeshError),
    /// There is nothing to run or to compare; rows with this end as [`Status::Unsupported`].
    #[error("not run: {0}")]
    NotRun(String),
}

/// Choices for [`validate`].
#[derive(Clone, Debug, Default)]
pub struct ValidateOptions {
    /// Replaces both default tolerances.
    pub tolerance: Option<f64>,
    /// Folder with the meshes; default: `meshes` beside the case or beside its folder.
    pub meshes: Option<PathBuf>,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// Threads; 0 means one per core.
    pub threads: usize,
}

/// The rows of a file.
type Rows = Result<Vec<ValidationRow>, CaseError>;

/// Runs case files in order; a folder stands for the JSON files in and below it, and no path at all for the
/// folder that comes with Sinew. A file that cannot be used is a failed row.
///
/// # Errors
/// When a folder cannot be read or has no case, or the cases that come with Sinew are not found.
pub fn validate(
    paths: &[PathBuf],
    options: &ValidateOptions,
    mut progress: impl FnMut(&ValidationRow),
) -> Result<ValidationReport, CaseError> {
    let cases = if paths.is_empty() { vec![reference_folder()?] } else { paths.to_vec() };
    let mut rows = Vec::new();
    for file in case_files(&cases)? {
        let new = run(&file, options);
        new.iter().for_each(&mut progress);
        rows.extend(new);
    }
    let evaluation = options.evaluation;
    Ok(ValidationReport { schema: "sinew-validate/1", cases, evaluation, rows })
}

/// The rows of one file; what concerns it as a whole is one row.
fn run(file: &Path, options: &ValidateOptions) -> Vec<ValidationRow> {
    let rows = ReferenceCase::read(file, options).and_then(|case| {
        let root = case.root();
        match root.get("schema").given().map(|schema| schema.text()).transpose()? {
            Some("sinew-fem-ref/1") => law::run(&case),
            Some("sinew-fem-elements/1") => cells::run(&case),
            Some("sinew-locking-forces/1") => clusters::run(&case),
            Some("sinew-fem-modes/1") => vibration::run(&case),
            Some("sinew-contact-ref/1") => contact::run(&case),
            Some("sinew-cut-ref/1") => cutting::run(&case),
            Some("sinew-cut-criteria/1") => cutting::run_criteria(&case),
            None if !root.get("implicit_euler").is_absent() => trajectory::run(&case),
            Some(other) => Err(CaseError::NotRun(format!("schema `{other}` is not known"))),
            None => Err(CaseError::NotRun("no `schema` and no `implicit_euler`".into())),
        }
    });
    rows.unwrap_or_else(|error| {
        vec![ValidationRow::new(&file_stem(file), "-", 0, 0).ended(Err(error))]
    })
}
