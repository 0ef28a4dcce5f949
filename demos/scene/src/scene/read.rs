//! Reading a scene file, with file, line and hint in every error.

use super::body::{BodyEntry, MeshSource};
use super::document::Scene;
use crate::assemble::CarriedSurface;
use crate::error::{Place, SceneError, SceneProblem, hint};
use crate::text::short;
use glam::DVec3;
use sinew::engine::memory::read_file;
use sinew::engine::mesh::{CheckedMesh, LatticeReport, Mesh, MeshError};
use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt::{self, Display};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest number that a scene may hold, in whatever SI unit.
const MOST: f64 = 1e12;

/// Largest number of any key, moduli among them; most keys have closer limits.
const BEYOND: f64 = 1e18;

/// Half of the characters of a line that is shown.
const WIDE: usize = 60;

/// Endings of mesh files.
const MESHES: [&str; 8] = ["msh", "vtk", "vtu", "node", "ele", "face", "obj", "stl"];

/// What people write for keys.
const SYNONYMS: [(&str, &str); 15] = [
    ("E", "young_modulus"),
    ("e", "young_modulus"),
    ("nu", "poisson_ratio"),
    ("poisson", "poisson_ratio"),
    ("rho", "density"),
    ("g", "gravity"),
    ("timestep", "dt"),
    ("time_step", "dt"),
    ("step", "dt"),
    ("time", "duration"),
    ("t_end", "duration"),
    ("k", "stiffness"),
    ("r", "radius"),
    ("position", "at"),
    ("tolerance", "linear_tolerance"),
];

/// Units that people write behind a number, with the factor to SI and the SI unit.
const UNITS: [(&str, f64, &str); 19] = [
    ("Pa", 1.0, "Pa"),
    ("kPa", 1e3, "Pa"),
    ("MPa", 1e6, "Pa"),
    ("GPa", 1e9, "Pa"),
    ("m", 1.0, "m"),
    ("cm", 1e-2, "m"),
    ("mm", 1e-3, "m"),
    ("um", 1e-6, "m"),
    ("s", 1.0, "s"),
    ("ms", 1e-3, "s"),
    ("us", 1e-6, "s"),
    ("N", 1.0, "N"),
    ("mN", 1e-3, "N"),
    ("kN", 1e3, "N"),
    ("kg/m^3", 1.0, "kg/m^3"),
    ("kg/m3", 1.0, "kg/m^3"),
    ("g/cm^3", 1e3, "kg/m^3"),
    ("g/cm3", 1e3, "kg/m^3"),
    ("deg", 1.0, "degrees"),
];

/// A text that holds a number and a unit, as the number that it means.
fn without_unit(text: &str) -> Option<String> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)))?;
    let number: f64 = text[..end].parse().ok()?;
    let unit = text[end..].trim();
    let (_, factor, si) = UNITS.iter().find(|(own, ..)| *own == unit)?;
    // what a decimal fraction was is one again
    let value: f64 = format!("{:.12e}", number * factor).parse().ok()?;
    Some(format!("numbers have no unit, write {value} ({si})"))
}

/// Keys of a document and where they stand.
#[derive(Clone, Debug, Default)]
struct KeySpans {
    spans: HashMap<String, KeySpan>,
    /// The first number beyond [`BEYOND`], as it is written.
    beyond: Option<(String, String)>,
}

#[derive(Clone, Debug)]
struct KeySpan {
    line: usize,
    key: Range<usize>,
    value: Range<usize>,
}

impl KeySpans {
    fn new(text: &str) -> Self {
        let mut keys = Self::default();
        if let Ok(document) = toml::de::DeTable::parse(text) {
            keys.table(text, "", document.get_ref());
        }
        keys
    }

    fn table(&mut self, text: &str, path: &str, table: &toml::de::DeTable<'_>) {
        for (key, value) in table {
            let name = key.get_ref();
            let path = if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
            self.insert(text, &path, key.span(), value.span());
            self.value(text, &path, value.get_ref());
        }
    }

    fn value(&mut self, text: &str, path: &str, value: &toml::de::DeValue<'_>) {
        use toml::de::DeValue;
        match value {
            DeValue::Table(inner) => self.table(text, path, inner),
            DeValue::Array(entries) => {
                for (i, entry) in entries.iter().enumerate() {
                    let path = format!("{path}[{i}]");
                    self.insert(text, &path, entry.span(), entry.span());
                    self.value(text, &path, entry.get_ref());
                }
            }
            DeValue::Float(number) => {
                // what is not finite is refused by its key
                let size = number.as_str().parse().map_or(0.0, f64::abs);
                if size > BEYOND && size.is_finite() && self.beyond.is_none() {
                    self.beyond = Some((path.to_string(), number.as_str().to_string()));
                }
            }
            _ => {}
        }
    }

    fn insert(&mut self, text: &str, path: &str, key: Range<usize>, value: Range<usize>) {
        let line = line_of(text, key.start);
        self.spans.insert(path.to_string(), KeySpan { line, key, value });
    }

    /// Line of a key, or of the nearest key around it that exists.
    fn line(&self, key: &str) -> Option<usize> {
        let mut key = key;
        loop {
            if let Some(span) = self.spans.get(key) {
                return Some(span.line);
            }
            key = &key[..key.rfind(['.', '['])?];
        }
    }

    /// What an error of the parser is about: the table of a key, or the innermost value around it.
    fn path_of(&self, error: &Range<usize>) -> String {
        if let Some((path, _)) = self.spans.iter().find(|(_, span)| span.key == *error)
            && !path.ends_with(']')
        {
            return path.rsplit_once('.').map_or("", |(table, _)| table).to_string();
        }
        let around =
            |span: &KeySpan| span.value.start <= error.start && error.end <= span.value.end;
        let values = self.spans.iter().filter(|(_, span)| around(span));
        // an array of one table has the span of the table: the longer path is the inner one
        let inner = values.min_by_key(|(path, span)| (span.value.len(), Reverse(path.len())));
        inner.map_or(String::new(), |(path, _)| path.clone())
    }
}

/// Line, counted from 1, of a byte offset.
fn line_of(text: &str, offset: usize) -> usize {
    let before = &text.as_bytes()[..offset.min(text.len())];
    before.iter().filter(|&&b| b == b'\n').count() + 1
}

/// A scene and where it came from.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// Its file.
    pub file: PathBuf,
    /// The text that it was read from.
    pub text: Arc<str>,
    keys: Arc<KeySpans>,
    files: SceneFiles,
    /// Meshes that were prepared for bodies; `None` where none are kept.
    prepared: Option<Arc<Mutex<Vec<(MeshSource, Arc<PreparedMesh>)>>>>,
    /// Keys that options of the command replaced, with these.
    options: Vec<(Cow<'static, str>, Cow<'static, str>)>,
}

/// The text of a scene, and where its keys stand.
pub(super) struct Source<'a> {
    text: &'a str,
    file: &'a Path,
    keys: Arc<KeySpans>,
}

impl<'a> Source<'a> {
    pub fn new(text: &'a str, file: &'a Path) -> Self {
        Self { text, file, keys: Arc::new(KeySpans::new(text)) }
    }

    /// What the parser made of the text, or of a part of it.
    pub fn loaded(&self, scene: Result<Scene, toml::de::Error>) -> Result<LoadedScene, SceneError> {
        Ok(LoadedScene {
            scene: scene.map_err(|error| self.error(&error))?,
            file: self.file.into(),
            text: self.text.into(),
            keys: Arc::clone(&self.keys),
            files: SceneFiles(Arc::new(read_file)),
            prepared: None,
            options: Vec::new(),
        })
    }

    /// What the parser says.
    pub fn error(&self, error: &toml::de::Error) -> SceneError {
        parse_error(self.text, self.file, &self.keys, error)
    }

    /// The first number that no scene holds.
    pub fn beyond(&self) -> Option<SceneError> {
        let (key, value) = self.keys.beyond.as_ref()?;
        let found = format!("{value} is beyond {BEYOND:e}, the most of any number in a scene");
        let remedy = "check the units: metres, seconds, kilograms, newtons, pascals".into();
        let place = Place { file: self.file.into(), line: self.keys.line(key), key: key.clone() };
        let problem = SceneProblem::Value { found, remedy };
        Some(SceneError::At { place: Box::new(place), problem })
    }

    /// Line of a key, or of the nearest key around it that exists.
    pub fn line(&self, key: &str) -> Option<usize> {
        self.keys.line(key)
    }
}

/// Meshes of bodies that are kept at most.
const KEPT: usize = 16;

/// A mesh in place, before and after its check.
#[derive(Clone, Debug)]
pub(crate) struct PreparedMesh {
    pub placed: Mesh,
    pub checked: CheckedMesh,
    pub carried: Option<CarriedSurface>,
    pub lattice: Option<LatticeReport>,
}

/// How files that a scene names are read.
#[derive(Clone)]
struct SceneFiles(Arc<dyn Fn(&Path) -> std::io::Result<Vec<u8>> + Send + Sync>);

impl fmt::Debug for SceneFiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Files(..)")
    }
}

impl LoadedScene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// When it cannot be read, is not TOML, has an unknown key or a value of the wrong type; the
    /// values themselves are checked by [`crate::assemble::build`].
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        if extension.is_some_and(|own| MESHES.contains(&own.as_str())) && path.is_file() {
            let place = Box::new(Place { file: path.into(), line: None, key: String::new() });
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let remedy = format!(
                "name it in a scene, mesh = \"{name}\" in a [[body]]; `sinew check {}` looks at the mesh alone",
                path.display()
            );
            let found = "this is a mesh, not a scene (TOML)".to_string();
            return Err(SceneError::At { place, problem: SceneProblem::Value { found, remedy } });
        }
        let utf8 =
            |error: std::string::FromUtf8Error| io::Error::new(io::ErrorKind::InvalidData, error);
        let text = read_file(path)
            .and_then(|bytes| String::from_utf8(bytes).map_err(utf8))
            .map_err(|source| SceneError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// The line of a scene that an error is about, and marks under its place; empty where there is none.
    pub(crate) fn marked(text: &str, error: &SceneError) -> String {
        let SceneError::At { place, problem } = error else { return String::new() };
        let line = place.line.unwrap_or_default();
        let Some(source) = line.checked_sub(1).and_then(|before| text.lines().nth(before)) else {
            return String::new();
        };
        let start: usize = text.split('\n').take(line - 1).map(|line| line.len() + 1).sum();
        let keys = KeySpans::new(text);
        let unknown = matches!(problem, SceneProblem::Unknown { kind: "key", .. });
        let key = match problem {
            SceneProblem::Unknown { name, .. } if unknown && place.key.is_empty() => name.clone(),
            SceneProblem::Unknown { name, .. } if unknown => format!("{}.{name}", place.key),
            _ => place.key.clone(),
        };
        let within = |span: &Range<usize>| (start..start + source.len()).contains(&span.start);
        let span = keys.spans.get(&key).map(|own| if unknown { &own.key } else { &own.value });
        let all = start + source.len() - source.trim_start().len()..start + source.trim_end().len();
        let span = span.filter(|span| within(span)).unwrap_or(&all);
        let end = span.end.min(start + source.len());
        let count =
            |from: usize, to: usize| text.get(from..to).map_or(1, |part| part.chars().count());
        let (from, width) = (count(start, span.start), count(span.start, end).max(1));
        // of a long line what is around the place
        let cut = if from > WIDE { from - WIDE / 2 } else { 0 };
        let shown: String = source.chars().skip(cut).take(2 * WIDE).collect();
        let marks = "^".repeat(width.min(2 * WIDE + cut - from));
        format!(
            "{line:>6} | {}\n       | {}{marks}",
            shown.replace('\t', " "),
            " ".repeat(from - cut)
        )
    }

    /// Reads a scene from text; mesh files are looked for beside `file`, which need not exist, or where
    /// [`LoadedScene::with_files`] says.
    ///
    /// # Errors
    /// As [`LoadedScene::read`].
    pub fn parse(text: &str, file: &Path) -> Result<Self, SceneError> {
        let source = Source::new(text, file);
        let loaded = source.loaded(toml::from_str(text))?;
        source.beyond().map_or(Ok(loaded), Err)
    }

    /// Takes the files that the scene names from `open` in place of the file system: memory, an archive, a
    /// network. It is asked for paths relative to the scene file's folder, as [`Mesh::read_with`] says.
    ///
    /// ```
    /// use sinew_scene::scene::LoadedScene;
    /// use std::io::{Error, ErrorKind};
    ///
    /// let text = r#"
    ///     name = "drop"
    ///     dt = 0.01
    ///     duration = 0.1
    ///     [[body]]
    ///     name = "tetrahedron"
    ///     mesh = "tetrahedron.vtk"
    ///     material = { preset = "liver" }
    /// "#;
    /// let mesh = b"# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n\
    ///     0 0 0  1 0 0  0 1 0  0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";
    /// let scene = LoadedScene::parse(text, "drop.toml".as_ref())?.with_files(|path| {
    ///     let known = path == "tetrahedron.vtk";
    ///     known.then(|| mesh.to_vec()).ok_or(Error::from(ErrorKind::NotFound))
    /// });
    /// let built = sinew_scene::assemble::build(&scene, &Default::default())?;
    /// assert_eq!(built.bodies[0].mesh.tetrahedra, [[0, 1, 2, 3]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn with_files(
        mut self,
        open: impl Fn(&Path) -> std::io::Result<Vec<u8>> + Send + Sync + 'static,
    ) -> Self {
        self.files = SceneFiles(Arc::new(open));
        self
    }

    /// Reads a mesh file named in the scene.
    ///
    /// # Errors
    /// As [`Mesh::read_with`].
    pub fn read_mesh(&self, path: &Path) -> Result<Mesh, MeshError> {
        Mesh::read_with(&self.resolve(path), &*self.files.0)
    }

    /// Says that a value does not come from the file: errors about the key then name the option.
    pub fn replaced_by(
        &mut self,
        key: impl Into<Cow<'static, str>>,
        option: impl Into<Cow<'static, str>>,
    ) {
        self.options.push((key.into(), option.into()));
    }

    /// Whether the file, an option of the command or a study gives a key.
    pub(crate) fn gives(&self, key: &str) -> bool {
        self.keys.spans.contains_key(key) || self.options.iter().any(|(own, _)| own == key)
    }

    /// Keeps the meshes of bodies once they were read and checked, for this scene and its clones, which may differ
    /// in everything else. Files are then not looked at again.
    #[must_use]
    pub fn keep_meshes(mut self) -> Self {
        self.prepared = Some(Arc::default());
        self
    }

    /// The mesh of a body, from those that are kept, or as `make` makes it.
    pub(crate) fn prepared_mesh<E>(
        &self,
        body: &BodyEntry,
        make: impl FnOnce() -> Result<PreparedMesh, E>,
    ) -> Result<Arc<PreparedMesh>, E> {
        let Some(kept) = &self.prepared else { return make().map(Arc::new) };
        let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
        let source = body.mesh_source();
        if let Some((_, mesh)) = lock().iter().find(|(kept, _)| *kept == source) {
            return Ok(Arc::clone(mesh));
        }
        let mesh = Arc::new(make()?);
        let mut kept = lock();
        if kept.len() >= KEPT {
            kept.clear();
        }
        kept.push((source, Arc::clone(&mesh)));
        Ok(mesh)
    }

    /// Reads another file named in the scene.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn read_bytes(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        (self.files.0)(&self.resolve(path))
    }

    /// Place of a key.
    pub fn place(&self, key: impl Into<String>) -> Box<Place> {
        let key = key.into();
        if let Some((_, option)) = self.options.iter().find(|(own, _)| *own == key) {
            return Box::new(Place {
                file: self.file.clone(),
                line: None,
                key: option.to_string(),
            });
        }
        Box::new(Place { file: self.file.clone(), line: self.keys.line(&key), key })
    }

    /// A key, for errors about it.
    pub(crate) fn key(&self, path: impl Into<String>) -> Key<'_> {
        Key { loaded: self, path: path.into() }
    }

    /// A file named in the scene, relative to the scene file.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.file.parent().unwrap_or(Path::new("")).join(path)
    }
}

/// A key of a scene, for errors about it and about what stands below it.
#[derive(Clone, Debug)]
pub(crate) struct Key<'a> {
    pub loaded: &'a LoadedScene,
    /// Such as `body[0].material`; empty for the scene.
    path: String,
}

impl Key<'_> {
    /// From the top of the scene.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// A key below it.
    pub fn at(&self, name: impl Display) -> Self {
        let path =
            if self.path.is_empty() { name.to_string() } else { format!("{}.{name}", self.path) };
        Self { path, ..*self }
    }

    /// Its entry of this index.
    pub fn entry(&self, index: usize) -> Self {
        Self { path: format!("{}[{index}]", self.path), ..*self }
    }

    pub fn place(&self) -> Box<Place> {
        self.loaded.place(&self.path)
    }

    pub fn value(&self, found: impl Into<String>, remedy: impl Into<String>) -> SceneError {
        self.error(SceneProblem::Value { found: found.into(), remedy: remedy.into() })
    }

    pub fn missing(&self, what: impl Into<String>, remedy: impl Into<String>) -> SceneError {
        self.error(SceneProblem::Missing { what: what.into(), remedy: remedy.into() })
    }

    /// Something that is wrong here.
    pub fn error(&self, problem: impl Into<SceneProblem>) -> SceneError {
        SceneError::At { place: self.place(), problem: problem.into() }
    }

    /// A name that is not among those that exist.
    pub fn unknown<'n>(
        &self,
        kind: &'static str,
        name: &str,
        known: impl IntoIterator<Item = &'n str>,
    ) -> SceneError {
        let hint = hint(kind, name, known);
        self.error(SceneProblem::Unknown { kind, name: name.into(), hint })
    }

    /// Up to three finite numbers.
    pub fn finite<const N: usize>(&self, values: [f64; N]) -> Result<DVec3, SceneError> {
        let at_most = |limit: f64| values.iter().all(|x| x.abs() <= limit);
        if at_most(MOST) {
            let at = |i: usize| values.get(i).copied().unwrap_or(0.0);
            Ok(DVec3::new(at(0), at(1), at(2)))
        } else {
            let (found, remedy) = match at_most(f64::MAX) {
                true => (
                    format!("{values:?} is beyond {MOST:e}, the most of anything in SI units"),
                    "check the units: metres, seconds, kilograms, newtons, pascals",
                ),
                false => (format!("{values:?} is not finite"), "give finite numbers"),
            };
            Err(self.value(found, remedy))
        }
    }

    /// Unit vector of its key `axis`.
    pub fn axis(&self, axis: [f64; 3]) -> Result<DVec3, SceneError> {
        let key = self.at("axis");
        let unit = key.finite(axis)?.try_normalize();
        unit.ok_or_else(|| key.value("the axis has no length", "give a direction"))
    }

    /// A positive number, of what in which unit.
    pub fn positive(&self, value: f64, what: &str, unit: &str) -> Result<f64, SceneError> {
        if value > 0.0 {
            return self.finite([value]).map(|_| value);
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        Err(self.value(format!("{what} is {}{unit}", short(value)), "make it positive and finite"))
    }

    /// A number that is 0 or positive, of what in which unit.
    pub fn not_negative(&self, value: f64, what: &str, unit: &str) -> Result<f64, SceneError> {
        if value >= 0.0 {
            return self.finite([value]).map(|_| value);
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        Err(self.value(format!("{what} is {}{unit}", short(value)), "make it 0 or positive"))
    }

    /// Refuses anything but exactly one of several keys below this one.
    pub fn exactly_one(&self, given: &[bool], kind: &str, keys: &str) -> Result<(), SceneError> {
        match given.iter().filter(|&&given| given).count() {
            1 => Ok(()),
            _ => Err(self.value(
                format!("not exactly one kind of {kind} is given"),
                format!("give one of {keys}"),
            )),
        }
    }

    /// Times in ascending order and finite numbers, at least one row of them.
    pub fn ascending<const N: usize>(
        &self,
        rows: &[[f64; N]],
        what: &str,
        columns: &str,
    ) -> Result<(), SceneError> {
        if rows.is_empty() {
            return Err(self.value(format!("the {what} is empty"), format!("give {columns}")));
        }
        if !rows.iter().flatten().all(|x| x.is_finite()) {
            return Err(self.value("a number is not finite", "give finite numbers"));
        }
        match rows.windows(2).find(|pair| pair[0][0] >= pair[1][0]) {
            None => Ok(()),
            Some(pair) => {
                let found = format!("time {} s follows time {} s", pair[1][0], pair[0][0]);
                Err(self.value(found, "give times in ascending order"))
            }
        }
    }
}

/// A text where a number or a table should stand.
fn wrong_type(message: &str, key: &str) -> Option<SceneProblem> {
    let rest = message.strip_prefix("invalid type: string ")?;
    let (text, expected) = rest.rsplit_once(", expected ")?;
    let value = text.trim_matches('"');
    let remedy = if expected.starts_with("struct") {
        let name = key.rsplit(['.', ']']).next().unwrap_or_default();
        match name {
            "material" => format!("write material = {{ preset = {text} }}, or give its constants"),
            name => {
                format!("give a table, {name} = {{ ... }}; demos/scenes/README.md has its keys")
            }
        }
    } else {
        without_unit(value)?
    };
    Some(SceneProblem::Value { found: format!("the text {text} stands here"), remedy })
}

/// The parser's message, with a hint when a name is unknown.
fn parse_error(text: &str, file: &Path, keys: &KeySpans, error: &toml::de::Error) -> SceneError {
    let message = error.message();
    let line = error.span().map(|span| line_of(text, span.start));
    let key = error.span().map_or(String::new(), |span| keys.path_of(&span));
    let place = Box::new(Place { file: file.into(), line, key });
    let quoted = |text: &str| -> Vec<String> {
        text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
    };
    for (start, kind) in [("unknown field ", "key"), ("unknown variant ", "choice")] {
        if let Some(rest) = message.strip_prefix(start) {
            let names = quoted(rest);
            if let Some((name, known)) = names.split_first() {
                let meant = SYNONYMS.iter().find(|(own, key)| {
                    own == name && kind == "key" && known.iter().any(|known| known == key)
                });
                let hint = match meant {
                    Some((_, key)) => format!("it is called `{key}` here"),
                    None => hint(kind, name, known.iter().map(String::as_str)),
                };
                let problem = SceneProblem::Unknown { kind, name: name.clone(), hint };
                return SceneError::At { place, problem };
            }
        }
    }
    if let Some(name) = message.strip_prefix("missing field ") {
        // the span is that of the table
        let remedy = "add it; see demos/scenes/README.md for what it holds".into();
        let problem = SceneProblem::Missing { what: format!("key {name}"), remedy };
        return SceneError::At { place, problem };
    }
    if let Some(problem) = wrong_type(message, &place.key) {
        return SceneError::At { place, problem };
    }
    let message = message
        .replace('\n', ", ")
        .replace("expected f64", "expected a number")
        .replace("expected a sequence", "expected a list");
    let whole = ["expected u32", "expected u64", "expected usize"];
    let message =
        whole.iter().fold(message, |m, name| m.replace(name, "expected a whole number from 0 up"));
    SceneError::At { place, problem: SceneProblem::Syntax(message) }
}
