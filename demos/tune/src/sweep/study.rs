//! Study files: which scene, which parameters, which values.

use super::error::{SweepError, io};
use super::hash::Hash;
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
    results: Results,
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
struct Results {
    #[serde(default)]
    probes: Kept,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Range {
    min: f64,
    max: f64,
    count: Option<usize>,
    #[serde(default)]
    scale: Scale,
}

#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Scale {
    #[default]
    Linear,
    Log,
}

/// Values of a parameter.
enum Axis {
    Values(Vec<Value>),
    Range { range: Range, whole: bool },
}

/// A study, read and checked.
pub struct Study {
    /// The scene.
    pub template: Template,
    /// Parameters as the study spells them.
    pub parameters: Vec<String>,
    /// The same, found in the scene.
    pub paths: Vec<KeyPath>,
    /// Values of every run.
    pub runs: Vec<Vec<Value>>,
    /// What is kept of probes.
    pub kept: Kept,
}

/// Where in a study file something stands.
struct Source<'a> {
    file: &'a Path,
    text: &'a str,
}

impl Source<'_> {
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
        SweepError::Entry {
            file: self.file.into(),
            line: Some(self.line(at.start)),
            key: key.into(),
            found: found.into(),
            remedy: remedy.into(),
        }
    }
}

impl Study {
    /// Reads a study file and the scene it names.
    ///
    /// # Errors
    /// Everything that is wrong with the file, by line and key; [`SweepError::Scene`] when the scene cannot be read.
    pub fn read(file: &Path) -> Result<Self, SweepError> {
        let text = read_text(file)?;
        let source = Source { file, text: &text };
        let document: Document = toml::from_str(&text).map_err(|error| SweepError::Syntax {
            file: file.into(),
            line: source.line(error.span().map_or(0, |span| span.start)),
            message: error.message().replace('\n', ", "),
        })?;
        let beside = |path: &Path| file.parent().unwrap_or(Path::new("")).join(path);
        let scene = LoadedScene::read(&beside(document.scene.get_ref()))?;
        let template = Template::new(scene)?;
        let kept = document.results.probes;
        let (parameters, paths, runs) = match &document.list {
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
        let study = Self { template, parameters, paths, runs, kept };
        study.check_all(file)?;
        Ok(study)
    }

    /// Every run is a scene, and no two are the same.
    fn check_all(&self, file: &Path) -> Result<(), SweepError> {
        let mut seen = std::collections::HashMap::new();
        for (i, values) in self.runs.iter().enumerate() {
            let entry = |key: &str, found, remedy: &str| SweepError::Entry {
                file: file.into(),
                line: None,
                key: key.into(),
                found,
                remedy: remedy.into(),
            };
            self.template.scene(&self.paths, values).map_err(|(which, message)| {
                let key = which.map_or("parameters", |p| &self.parameters[p]);
                let given = which.map_or(Value::Array(values.clone()), |p| values[p].clone());
                let remedy = "see demos/scenes/README.md for what the key holds";
                entry(key, format!("{given} in run {i}: {message}"), remedy)
            })?;
            let text = Value::Array(values.clone()).to_string();
            if let Some(first) = seen.insert(Hash::of(&text).text(), i) {
                let found = format!("runs {first} and {i} are the same, {text}");
                return Err(entry("parameters", found, "give every value or row once"));
            }
        }
        Ok(())
    }
}

fn read_text(file: &Path) -> Result<String, SweepError> {
    let invalid = |e| std::io::Error::new(std::io::ErrorKind::InvalidData, e);
    let text = read_file(file).and_then(|bytes| String::from_utf8(bytes).map_err(invalid));
    text.map_err(io(file))
}

type Sampled = (Vec<String>, Vec<KeyPath>, Vec<Vec<Value>>);

/// Runs of a grid or a latin hypercube.
fn sampled(
    source: &Source,
    document: &Document,
    template: &Template,
) -> Result<Sampled, SweepError> {
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
    Ok((names, paths, runs))
}

/// The first parameter varies slowest.
fn grid_runs(lists: &[Vec<Value>], count: usize) -> Vec<Vec<Value>> {
    let run = |mut index: usize| {
        let mut values = vec![Value::Null; lists.len()];
        for (value, list) in values.iter_mut().zip(lists).rev() {
            *value = list[index % list.len()].clone();
            index /= list.len();
        }
        values
    };
    (0..count).map(run).collect()
}

/// Each parameter has its range cut into as many equal parts as there are runs, and visits each part once, in an
/// order of its own (McKay, Beckman, Conover 1979). Its order depends on the seed and its name alone.
fn hypercube_runs(axes: &[Axis], names: &[String], count: usize, seed: u64) -> Vec<Vec<Value>> {
    let mut runs = vec![Vec::with_capacity(axes.len()); count];
    for (axis, name) in axes.iter().zip(names) {
        let start = Hash::of(seed.to_le_bytes()).and(name).short();
        let mut random = Random(u64::from_str_radix(&start, 16).unwrap_or(seed));
        let mut parts: Vec<usize> = (0..count).collect();
        for i in (1..count).rev() {
            parts.swap(i, random.below(i + 1));
        }
        for (run, part) in runs.iter_mut().zip(parts) {
            run.push(axis.at((part as f64 + random.unit()) / count as f64));
        }
    }
    runs
}

/// The splitmix64 sequence.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to below 1.
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A whole number below `n`.
    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next()) * n as u128) >> 64) as usize
    }
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
            let range = Range::deserialize(table.clone()).map_err(|error| {
                let text = error.message().replace('\n', ", ");
                let remedy = "give a list of values or { min, max, count, scale }; a path with dots stands in quotes";
                (text, remedy.to_string())
            })?;
            let Range { min, max, count, scale } = range;
            let shown = format!("a range from {min} to {max}");
            if !(min < max && min.is_finite() && max.is_finite() && (max - min).is_finite()) {
                return Err((shown, remedy("give finite ends, the smaller one first")));
            }
            if scale == Scale::Log && min <= 0.0 {
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

impl Axis {
    /// Points of a grid.
    fn points(&self) -> Vec<Value> {
        match self {
            Self::Values(values) => values.clone(),
            Self::Range { range, .. } => {
                let last = range.count.unwrap_or(2) - 1;
                (0..=last).map(|i| self.at(i as f64 / last as f64)).collect()
            }
        }
    }

    /// Value at a share of the range, from 0 to 1.
    fn at(&self, share: f64) -> Value {
        match self {
            Self::Values(values) => {
                let index = (share * values.len() as f64) as usize;
                values[index.min(values.len() - 1)].clone()
            }
            Self::Range { range: Range { min, max, scale, .. }, whole } => {
                let value = match scale {
                    _ if share <= 0.0 => *min,
                    _ if share >= 1.0 => *max,
                    Scale::Linear => min + (max - min) * share,
                    // the same bits on every machine
                    Scale::Log => {
                        libm::exp(libm::log(*min) * (1.0 - share) + libm::log(*max) * share)
                    }
                };
                if *whole { (value.round() as i64).into() } else { value.into() }
            }
        }
    }
}

/// Runs of a CSV file: a heading of keys, a row a run; an empty cell leaves what the scene has.
fn read_list(file: &Path, template: &Template) -> Result<Sampled, SweepError> {
    let text = read_text(file)?;
    let entry = |line: usize, key: &str, found: String, remedy: &str| SweepError::Entry {
        file: file.into(),
        line: Some(line),
        key: key.into(),
        found,
        remedy: remedy.into(),
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
    Ok((names, paths, runs))
}

/// A cell by its looks; a word where the scene has a word.
fn cell_value(cell: &str, present: &Value) -> Value {
    if cell.is_empty() {
        return Value::Null;
    }
    let parsed = match serde_json::from_str(cell) {
        Ok(value) if !present.is_string() => Some(value),
        _ => None,
    };
    let number = || cell.parse::<f64>().ok().filter(|x| x.is_finite() && !present.is_string());
    parsed.or_else(|| number().map(Value::from)).unwrap_or_else(|| cell.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hypercube_visits_every_part_once_and_parameters_do_not_disturb_each_other() {
        let axis = || Axis::Range {
            range: Range { min: 10.0, max: 20.0, count: None, scale: Scale::Linear },
            whole: false,
        };
        let names = ["a".to_string(), "b".to_string()];
        let two = hypercube_runs(&[axis(), axis()], &names, 50, 7);
        for column in 0..2 {
            let mut parts: Vec<i64> =
                two.iter().map(|run| (run[column].as_f64().unwrap() * 5.0 - 50.0) as i64).collect();
            parts.sort_unstable();
            assert_eq!(parts, (0..50).collect::<Vec<_>>());
        }
        let one = hypercube_runs(&[axis()], &names[1..], 50, 7);
        assert!(one.iter().zip(&two).all(|(one, two)| one[0] == two[1] && two[0] != two[1]));
        assert_ne!(hypercube_runs(&[axis()], &names[..1], 50, 8)[0], [two[0][0].clone()]);
    }

    #[test]
    fn grids_vary_the_last_parameter_fastest_and_ranges_keep_their_ends() {
        let axis = |scale, whole| Axis::Range {
            range: Range { min: 1.0, max: 100.0, count: Some(3), scale },
            whole,
        };
        let log = axis(Scale::Log, false).points();
        assert!((log[1].as_f64().unwrap() - 10.0).abs() < 1e-13, "{log:?}");
        assert_eq!([&log[0], &log[2]], [&Value::from(1.0), &Value::from(100.0)]);
        assert_eq!(axis(Scale::Linear, true).points(), [Value::from(1), 51.into(), 100.into()]);
        let lists = [vec![1.into(), 2.into()], vec![Value::from("a"), "b".into()]];
        let runs = grid_runs(&lists, 4);
        assert_eq!(runs[1], [Value::from(1), "b".into()]);
        assert_eq!(runs[2], [Value::from(2), "a".into()]);
    }

    #[test]
    fn cells_are_what_they_look_like() {
        let cases: [(&str, Value, Value); 7] = [
            ("", Value::Null, 1.5.into()),
            ("3", 3.into(), 1.5.into()),
            ("4e3", 4000.0.into(), Value::Null),
            (".5", 0.5.into(), Value::Null),
            ("true", true.into(), Value::Null),
            ("safe", "safe".into(), "auto".into()),
            ("3", "3".into(), "auto".into()),
        ];
        for (cell, value, present) in cases {
            assert_eq!(cell_value(cell, &present), value, "{cell}");
        }
    }
}
