//! What can be wrong with a scene or a run; every message says where, what and what to do.

use sinew::engine::mesh::{CheckError, MeshError};
use sinew::engine::step::StepError;
use sinew::models::axes::description::AxesError;
use sinew::models::axes::field::FibreError;
use sinew::models::body::BodyError;
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
    /// The file is not TOML, or a value has the wrong type.
    #[error("{place}: {message}; see demos/scenes/README.md for every key")]
    Syntax {
        /// Where.
        place: Box<Place>,
        /// What the parser said.
        message: String,
    },
    /// A key or a choice that does not exist.
    #[error("{place}: unknown {kind} `{name}`; {hint}")]
    Unknown {
        /// Where.
        place: Box<Place>,
        /// What was looked for: a key, group, body ...
        kind: &'static str,
        /// What was given.
        name: String,
        /// Near misses, or all that exist.
        hint: String,
    },
    /// A required key is absent.
    #[error("{place}: {what} is missing; {remedy}")]
    Missing {
        /// Where it should stand.
        place: Box<Place>,
        /// What is missing.
        what: String,
        /// What to write.
        remedy: String,
    },
    /// A value out of range.
    #[error("{place}: {found}; {remedy}")]
    Value {
        /// Where.
        place: Box<Place>,
        /// What was given.
        found: String,
        /// What is valid.
        remedy: String,
    },
    /// Two entries with the same name.
    #[error("{place}: the name `{name}` is used by another {kind}; names must be unique")]
    Duplicate {
        /// Where the second one stands.
        place: Box<Place>,
        /// What the entries are.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A selection without vertices.
    #[error("{place}: no vertex of body `{body}` is selected; {remedy}")]
    EmptySelection {
        /// Where.
        place: Box<Place>,
        /// Name of the body.
        body: String,
        /// What to do.
        remedy: String,
    },
    /// A vertex index beyond the mesh.
    #[error(
        "{place}: vertex {vertex} does not exist, body `{body}` has {count} vertices; indices count \
         from 0 in the order of the mesh"
    )]
    VertexIndex {
        /// Where.
        place: Box<Place>,
        /// Name of the body.
        body: String,
        /// The index.
        vertex: u32,
        /// Vertices in the mesh.
        count: usize,
    },
    /// A static body that could float away.
    #[error(
        "{place}: body `{body}` of a static scene is not held against {motion}; without that it has \
         no equilibrium, add a [[constraint]]"
    )]
    NotHeld {
        /// Where the body stands.
        place: Box<Place>,
        /// Name of the body.
        body: String,
        /// The free motion.
        motion: String,
    },
    /// A mesh file or a generated shape.
    #[error("{place}: {source}")]
    Mesh {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: Box<MeshError>,
    },
    /// A mesh with errors.
    #[error("{place}: {source}")]
    Check {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: CheckError,
    },
    /// A material out of range, or an unknown preset.
    #[error("{place}: {source}")]
    Material {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: MaterialError,
    },
    /// Cell data of a mesh file that are no material.
    #[error("{place}: cell data `{array}` of {mesh}, {source}")]
    Field {
        /// Where.
        place: Box<Place>,
        /// The mesh file.
        mesh: String,
        /// Name of the data.
        array: String,
        /// What is wrong.
        #[source]
        source: Box<FieldError>,
    },
    /// Fibres that cannot be made.
    #[error("{place}: {source}")]
    Fibres {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: Box<FibreError>,
    },
    /// Axes that cannot be used.
    #[error("{place}: {source}")]
    Axes {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: Box<AxesError>,
    },
    /// A body that cannot be built.
    #[error("{place}: {source}")]
    Body {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: Box<BodyError>,
    },
    /// A setting of the solver.
    #[error("{place}: {source}")]
    Setting {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: StepError,
    },
    /// Anything else that the engine refuses.
    #[error("{place}: {source}")]
    Simulation {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        #[source]
        source: Box<SimulationError>,
    },
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
            (if part { 0 } else { edit_distance(&wanted, &candidate) }, c)
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

/// Least number of inserted, deleted, replaced or exchanged neighbouring characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![(0..=b.len()).collect::<Vec<_>>()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let replaced = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = replaced.min(row[j - 1] + 1).min(rows[i - 1][j] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            row.push(best);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_name_the_nearest_or_all() {
        let keys = ["young_modulus", "poisson_ratio", "density"];
        assert_eq!(hint("key", "youngs_modulus", keys), "did you mean `young_modulus`?");
        assert_eq!(hint("key", "desnity", keys), "did you mean `density`?");
        assert_eq!(hint("group", "top", ["x0", "x1"]), "known: `x0`, `x1`");
        assert_eq!(hint("group", "top", []), "there is no group to choose from");
    }
}
