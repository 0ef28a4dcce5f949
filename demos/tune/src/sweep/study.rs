//! Study files: which scene, which parameters, which values.

use super::error::{Result, SweepError, io};
use super::hash::Hash;
use super::sampling::{Axis, RangeScale, ValueRange, cell_value, grid_runs, hypercube_runs};
use super::template::{KeyPath, Template};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sinew::engine::memory::read_file;
use sinew_scene::scene::LoadedScene;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Most runs of a sweep.
const MOST_RUNS: usize = 10_000_000;

/// What is kept of the probes of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kept {
    /// The values at the end.
    #[default]
    Last,
    /// The smallest and the largest of all rows.
    Max,
    /// The values at the end, and all rows in a file of their own for each run.
    All,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    scene: Spanned<PathBuf>,
    sampling: Option<Spanned<Sampling>>,
    list: Option<Spanned<PathBuf>>,
    #[serde(default)]
    parameters: BTreeMap<Spanned<String>, Spanned<toml::Value>>,
    #[serde(default)]
    results: Keep,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Sampling {
    Grid,
    LatinHypercube {
        runs: usize,
        #[serde(default)]
        seed: u64,
    },
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keep {
    #[serde(default)]
    probes: Kept,
}

/// A study, read and checked.
pub struct Study {
    /// The scene.
    pub template: Template,
    /// Parameters as the study spells them.
    pub parameters: Vec<String>,
    /// The same, found in the scene.
    pub paths: Vec<KeyPath>,
    /// How the values of each are spread, where a range says so.
    pub scales: Vec<Option<RangeScale>>,
    /// Values of every run.
    pub runs: Vec<Vec<Value>>,
    /// What is kept of probes.
    pub kept: Kept,
}

/// Where in a study file something stands.
struct StudyFile<'a> {
    file: &'a Path,
    text: &'a str,
}

impl StudyFile<'_> {
    fn line(&self, offset: usize) -> usize {
        1 + self.text.as_bytes().iter().take(offset).filter(|&&b| b == b'\n').count()
    }

    fn entry(
        &self,
        at: &std::ops::Range<usize>,
        key: &str,
        found: impl Into<String>,
        remedy: impl Into<String>,
    ) -> SweepError {
        SweepError::entry(self.file, Some(self.line(at.start)), key, found, remedy)
    }
}

impl Study {
    /// Reads a study file and the scene it names.
    ///
    /// # Errors
    /// Everything that is wrong with the file, by line and key; [`SweepError::Scene`] when the scene cannot be read.
    pub fn read(file: &Path) -> Result<Self> {
        let text = read_text(file)?;
        let source = StudyFile { file, text: &text };
        let document: Document = toml::from_str(&text).map_err(|error| SweepError::Syntax {
            file: file.into(),
            line: source.line(error.span().map_or(0, |span| span.start)),
            message: error.message().replace('\n', ", "),
        })?;
        let beside = |path: &Path| file.parent().unwrap_or(Path::new("")).join(path);
        let scene = LoadedScene::read(&beside(document.scene.get_ref()))?;
        let template = Template::new(scene)?;
        let kept = document.results.probes;
        let Sampled { parameters, paths, scales, runs } = match &document.list {
            Some(list) => {
                if document.sampling.is_some() || !document.parameters.is_empty() {
                    let remedy = "keep `list`, or `[parameters]` with `sampling`";
                    return Err(source.entry(
                        &list.span(),
                        "list",
                        "the list gives all values",
                        remedy,
                    ));
                }
                read_list(&beside(list.get_ref()), &template)?
            }
            None => sampled(&source, &document, &template)?,
        };
        let study = Self { template, parameters, paths, scales, runs, kept };
        study.check_all(file)?;
        Ok(study)
    }

    /// Every run is a scene, and no two are the same.
    fn check_all(&self, file: &Path) -> Result<()> {
        let mut seen = std::collections::HashMap::new();
        for (i, values) in self.runs.iter().enumerate() {
            self.template.scene(&self.paths, values).map_err(|(which, message)| {
                let key = which.map_or("parameters", |p| &self.parameters[p]);
                let given = which.map_or(Value::Array(values.clone()), |p| values[p].clone());
                let remedy = "see demos/scenes/README.md for what the key holds";
                let found = format!("{given} in run {i}: {message}");
                SweepError::entry(file, None, key, found, remedy)
            })?;
            let text = Value::Array(values.clone()).to_string();
            if let Some(first) = seen.insert(Hash::of(&text).text(), i) {
                let found = format!("runs {first} and {i} are the same, {text}");
                let remedy = "give every value or row once";
                return Err(SweepError::entry(file, None, "parameters", found, remedy));
            }
        }
        Ok(())
    }
}

fn read_text(file: &Path) -> Result<String> {
    let invalid = |e| std::io::Error::new(std::io::ErrorKind::InvalidData, e);
    let text = read_file(file).and_then(|bytes| String::from_utf8(bytes).map_err(invalid));
    text.map_err(io(file))
}

/// Parameters and the values of every run.
struct Sampled {
    parameters: Vec<String>,
    paths: Vec<KeyPath>,
    scales: Vec<Option<RangeScale>>,
    runs: Vec<Vec<Value>>,
}

/// Runs of a grid or a latin hypercube.
fn sampled(source: &StudyFile, document: &Document, template: &Template) -> Result<Sampled> {
    // in the order of the file
    let mut entries: Vec<_> = document.parameters.iter().collect();
    entries.sort_by_key(|(key, _)| key.span().start);
    let grid = Spanned::new(0..0, Sampling::Grid);
    let sampling = document.sampling.as_ref().unwrap_or(&grid);
    let hypercube = matches!(sampling.get_ref(), Sampling::LatinHypercube { .. });
    let (mut names, mut paths, mut axes) = (Vec::new(), Vec::new(), Vec::new());
    for (key, value) in entries {
        let (name, span) = (key.get_ref(), key.span());
        let fault = |(found, remedy): (String, String)| source.entry(&span, name, found, remedy);
        if ["sampling", "list"].contains(&name.as_str()) {
            let remedy =
                format!("write `{name} = ...` at the top of the file, before [parameters]");
            return Err(fault((format!("`{name}` is no key of a scene"), remedy)));
        }
        let path = template.find(name).map_err(fault)?;
        axes.push(axis(value.get_ref(), template.value(&path), hypercube).map_err(fault)?);
        if let Some(other) = paths.iter().position(|p| *p == path) {
            let found = format!("the same key as `{}`", names[other]);
            return Err(fault((found, "give it once".into())));
        }
        names.push(name.clone());
        paths.push(path);
    }
    if axes.is_empty() {
        let remedy = "add [parameters] with a list of values for a key of the scene, or `list = \"runs.csv\"`";
        return Err(source.entry(&(0..0), "parameters", "nothing is swept", remedy));
    }
    let limit = |runs: Option<usize>| match runs {
        Some(runs) if (1..=MOST_RUNS).contains(&runs) => Ok(runs),
        _ => {
            let found =
                runs.map_or("a number of runs beyond counting".into(), |n| format!("{n} runs"));
            let remedy = format!("make it 1 to {MOST_RUNS}");
            Err(source.entry(&sampling.span(), "sampling", found, remedy))
        }
    };
    let runs = match *sampling.get_ref() {
        Sampling::Grid => {
            let lists: Vec<Vec<Value>> = axes.iter().map(Axis::points).collect();
            let count = lists.iter().try_fold(1_usize, |n, list| n.checked_mul(list.len()));
            grid_runs(&lists, limit(count)?)
        }
        Sampling::LatinHypercube { runs, seed } => {
            hypercube_runs(&axes, &names, limit(Some(runs))?, seed)
        }
    };
    let scales = axes.iter().map(Axis::scale).collect();
    Ok(Sampled { parameters: names, paths, scales, runs })
}

/// Values of a parameter whose value in the scene is `present`.
fn axis(value: &toml::Value, present: &Value, hypercube: bool) -> Result<Axis, (String, String)> {
    let remedy = |text: &str| text.to_string();
    match value {
        toml::Value::Array(values) if values.is_empty() => {
            Err(("the list is empty".into(), remedy("give at least one value")))
        }
        toml::Value::Array(values) => {
            values.iter().map(plain).collect::<Result<_, _>>().map(Axis::Values)
        }
        toml::Value::Table(table) => {
            let range = ValueRange::deserialize(table.clone()).map_err(|error| {
                let text = error.message().replace('\n', ", ");
                let remedy = "give a list of values or { min, max, count, scale }; a path with dots stands in quotes";
                (text, remedy.to_string())
            })?;
            let ValueRange { min, max, count, scale } = range;
            let shown = format!("a range from {min} to {max}");
            if !(min < max && min.is_finite() && max.is_finite() && (max - min).is_finite()) {
                return Err((shown, remedy("give finite ends, the smaller one first")));
            }
            if scale == RangeScale::Log && min <= 0.0 {
                return Err((
                    format!("{shown} on a logarithmic scale"),
                    remedy("make both ends positive"),
                ));
            }
            match (hypercube, count) {
                (false, None | Some(0 | 1)) => Err((
                    format!("{shown} without a `count` of 2 or more"),
                    remedy("add `count`, or list the values"),
                )),
                (true, Some(_)) => Err((
                    "`count` belongs to a grid".into(),
                    remedy("leave it out, `sampling` says how many runs there are"),
                )),
                _ => Ok(Axis::Range { range, whole: present.is_i64() || present.is_u64() }),
            }
        }
        single => Ok(Axis::Values(vec![plain(single)?])),
    }
}

/// A value of a scene.
fn plain(value: &toml::Value) -> Result<Value, (String, String)> {
    let refused = |found: &str| {
        Err((found.to_string(), "give numbers, words, true or false, or lists of them".into()))
    };
    Ok(match value {
        toml::Value::String(text) => text.clone().into(),
        toml::Value::Integer(number) => (*number).into(),
        toml::Value::Float(number) if number.is_finite() => (*number).into(),
        toml::Value::Float(_) => return refused("a number is not finite"),
        toml::Value::Boolean(yes) => (*yes).into(),
        toml::Value::Datetime(_) => return refused("a date"),
        toml::Value::Array(values) => {
            Value::Array(values.iter().map(plain).collect::<Result<_, _>>()?)
        }
        toml::Value::Table(table) => {
            let entries = table.iter().map(|(key, value)| Ok((key.clone(), plain(value)?)));
            Value::Object(entries.collect::<Result<_, (String, String)>>()?)
        }
    })
}

/// Runs of a CSV file: a heading of keys, a row a run; an empty cell leaves what the scene has.
fn read_list(file: &Path, template: &Template) -> Result<Sampled> {
    let text = read_text(file)?;
    let entry = |line: usize, key: &str, found: String, remedy: &str| {
        SweepError::entry(file, Some(line), key, found, remedy)
    };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let broken =
        |error: csv::Error| entry(1, "list", error.to_string(), "give comma-separated text");
    let header = reader.headers().map_err(broken)?.clone();
    let (mut names, mut paths) = (Vec::<String>::new(), Vec::new());
    for name in &header {
        let path = template.find(name).map_err(|(found, remedy)| entry(1, name, found, &remedy))?;
        if let Some(other) = paths.iter().position(|p| *p == path) {
            return Err(entry(
                1,
                name,
                format!("the same key as `{}`", names[other]),
                "give it once",
            ));
        }
        names.push(name.into());
        paths.push(path);
    }
    let mut runs = Vec::new();
    for row in reader.records() {
        let row = row.map_err(broken)?;
        let line = row.position().map_or(0, |p| p.line() as usize);
        if row.len() != names.len() {
            let found =
                format!("{} cells in a row, {} keys in the heading", row.len(), names.len());
            return Err(entry(line, "list", found, "give every row a cell for each key"));
        }
        if runs.len() == MOST_RUNS {
            return Err(entry(
                line,
                "list",
                format!("more than {MOST_RUNS} rows"),
                "make several sweeps",
            ));
        }
        let value = |(cell, path): (&str, &KeyPath)| cell_value(cell, template.value(path));
        runs.push(row.iter().zip(&paths).map(value).collect());
    }
    if runs.is_empty() {
        return Err(entry(
            1,
            "list",
            "there is no row".into(),
            "give a heading of keys and a row for each run",
        ));
    }
    let scales = vec![None; names.len()];
    Ok(Sampled { parameters: names, paths, scales, runs })
}
