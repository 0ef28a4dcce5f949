//! Case files: where they are, and a cursor over their values that knows its key for errors.

use super::{CaseError, ValidateOptions};
use crate::error::hint;
use glam::DVec3;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Case files of these paths: files stay as they are, folders stand for the JSON files in and below them in
/// alphabetical order.
pub(super) fn case_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CaseError> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let before = files.len();
        collect(path, &mut files)?;
        if files.len() == before {
            return Err(CaseError::NoCases(path.clone()));
        }
    }
    Ok(files)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), CaseError> {
    let failed = |source: std::io::Error| CaseError::of(folder, source);
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder).map_err(failed)?.collect();
    let mut paths: Vec<PathBuf> = entries.map_err(failed)?.iter().map(|e| e.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() && !path.is_symlink() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "json") {
            files.push(path);
        }
    }
    Ok(())
}

/// The folder of the reference cases that come with Sinew: that of the sources this was built from, else
/// `demos/reference` in a folder above the program or the working folder.
///
/// # Errors
/// When there is none.
pub fn reference_folder() -> Result<PathBuf, CaseError> {
    // the checkout that one stands in comes before that of the program
    let starts = [std::env::current_dir(), std::env::current_exe()];
    let starts: Vec<PathBuf> = starts.into_iter().flatten().collect();
    let above = starts.iter().flat_map(|start| start.ancestors());
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference");
    let found = above
        .map(|folder| folder.join("demos/reference"))
        .chain(std::iter::once(built.clone()))
        .find(|folder| folder.join("meshes").is_dir());
    found.ok_or(CaseError::NoReference { built, starts })
}

/// A case file.
pub(super) struct ReferenceCase<'a> {
    pub path: PathBuf,
    /// How it is run.
    pub options: &'a ValidateOptions,
    value: Value,
}

impl<'a> ReferenceCase<'a> {
    pub fn read(path: &Path, options: &'a ValidateOptions) -> Result<Self, CaseError> {
        let text = std::fs::read_to_string(path).map_err(|error| CaseError::of(path, error))?;
        let value = serde_json::from_str(&text).map_err(|error| CaseError::of(path, error))?;
        Ok(Self { path: path.into(), options, value })
    }

    pub fn name(&self) -> String {
        self.value["name"].as_str().map_or_else(|| file_stem(&self.path), String::from)
    }

    pub fn root(&self) -> CaseEntry<'_> {
        CaseEntry { path: &self.path, key: String::new(), value: &self.value }
    }

    pub fn simulation_error(
        &self,
        source: impl Into<sinew::simulation::SimulationError>,
    ) -> CaseError {
        let source: sinew::simulation::SimulationError = source.into();
        CaseError::of(&self.path, source)
    }
}

impl CaseError {
    /// What is wrong with a file.
    pub(super) fn of(path: &Path, source: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::File { path: path.into(), source: Box::new(source) }
    }
}

pub(super) fn file_stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into())
}

/// Keys that any case may have and that change nothing; so does every text.
const REMARKS: [&str; 8] =
    ["about", "comments", "description", "made_by", "notes", "quantities", "units", "versions"];

/// A value of a case file with the path of its key, such as `results.svk.u`.
#[derive(Clone)]
pub(super) struct CaseEntry<'a> {
    path: &'a Path,
    key: String,
    value: &'a Value,
}

impl<'a> CaseEntry<'a> {
    /// What stands under a key; nothing when it is absent.
    pub fn get(&self, key: &str) -> Self {
        let dot = if self.key.is_empty() { "" } else { "." };
        Self { key: format!("{}{dot}{key}", self.key), value: &self.value[key], ..*self }
    }

    /// One of a list.
    pub fn at(&self, i: usize) -> Self {
        Self { key: format!("{}[{i}]", self.key), value: &self.value[i], ..*self }
    }

    /// Absent, or `null`.
    pub fn is_absent(&self) -> bool {
        self.value.is_null()
    }

    pub fn is_list(&self) -> bool {
        self.value.is_array()
    }

    /// This, unless it is absent.
    pub fn given(self) -> Option<Self> {
        if self.is_absent() { None } else { Some(self) }
    }

    pub fn error(&self, expected: impl Into<String>) -> CaseError {
        let found = match self.value {
            Value::Null => "absent".into(),
            Value::Array(list) => format!("a list of {}", list.len()),
            Value::Object(_) => "an object".into(),
            other => format!("`{other}`"),
        };
        let whole = self.key.is_empty();
        let field = if whole { "the whole file".into() } else { self.key.clone() };
        let path = self.path.into();
        CaseError::Field { path, field, found, expected: expected.into() }
    }

    /// Refuses keys that are neither known (separated by blanks) nor remarks.
    pub fn refuse_unknown(&self, known: &str) -> Result<(), CaseError> {
        self.refuse(known, Value::is_string)
    }

    /// The same for results, where numbers tell how they were made.
    pub fn refuse_unknown_results(&self, known: &str) -> Result<(), CaseError> {
        self.refuse(known, |value| value.is_string() || value.is_number())
    }

    fn refuse(&self, known: &str, remark: impl Fn(&Value) -> bool) -> Result<(), CaseError> {
        let known = || known.split_whitespace();
        let unknown = |(key, value): &(&String, &Value)| {
            let named = known().chain(REMARKS).any(|known| known == *key);
            !named && !value.is_null() && !remark(value)
        };
        let Some((key, _)) = self.object()?.iter().find(unknown) else { return Ok(()) };
        let (path, field) = (self.path.into(), self.get(key).key);
        Err(CaseError::UnknownKey { path, field, hint: hint("key", key, known()) })
    }

    pub fn object(&self) -> Result<&'a Map<String, Value>, CaseError> {
        self.value.as_object().ok_or_else(|| self.error("an object"))
    }

    pub fn text(&self) -> Result<&'a str, CaseError> {
        self.value.as_str().ok_or_else(|| self.error("a text"))
    }

    pub fn number(&self) -> Result<f64, CaseError> {
        self.value.as_f64().ok_or_else(|| self.error("a number"))
    }

    pub fn index(&self) -> Result<u32, CaseError> {
        let index = self.value.as_u64().and_then(|i| u32::try_from(i).ok());
        index.ok_or_else(|| self.error("an index, counted from 0"))
    }

    pub fn flag(&self) -> Result<bool, CaseError> {
        self.value.as_bool().ok_or_else(|| self.error("true or false"))
    }

    pub fn list(&self) -> Result<impl Iterator<Item = Self> + use<'a>, CaseError> {
        let length = self.value.as_array().ok_or_else(|| self.error("a list"))?.len();
        let entry = self.clone();
        Ok((0..length).map(move |i| entry.at(i)))
    }

    /// A list of a given length.
    pub fn list_of(
        &self,
        length: usize,
    ) -> Result<impl Iterator<Item = Self> + use<'a>, CaseError> {
        match self.value.as_array() {
            Some(list) if list.len() == length => self.list(),
            _ => Err(self.error(format!("a list of {length}"))),
        }
    }

    pub fn numbers(&self) -> Result<Vec<f64>, CaseError> {
        self.list()?.map(|entry| entry.number()).collect()
    }

    pub fn indices(&self) -> Result<Vec<u32>, CaseError> {
        self.list()?.map(|entry| entry.index()).collect()
    }

    pub fn cells<const N: usize>(&self) -> Result<Vec<[u32; N]>, CaseError> {
        let cell = |entry: Self| {
            let mut cell = [0; N];
            for (slot, index) in cell.iter_mut().zip(entry.list_of(N)?) {
                *slot = index.index()?;
            }
            Ok(cell)
        };
        self.list()?.map(cell).collect()
    }

    /// Three numbers, or two of a plane case.
    pub fn vector(&self) -> Result<DVec3, CaseError> {
        let numbers: Option<Vec<f64>> =
            self.value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
        match numbers.as_deref() {
            Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
            Some(&[x, y]) => Ok(DVec3::new(x, y, 0.0)),
            _ => Err(self.error("three numbers, or two of a plane case")),
        }
    }

    pub fn vectors(&self) -> Result<Vec<DVec3>, CaseError> {
        self.list()?.map(|entry| entry.vector()).collect()
    }

    /// One vector for each of so many nodes.
    pub fn field(&self, nodes: usize) -> Result<Vec<DVec3>, CaseError> {
        let expected = || self.error(format!("a list of {nodes} vectors, one per node"));
        let vectors = self.vectors()?;
        if vectors.len() == nodes { Ok(vectors) } else { Err(expected()) }
    }
}
