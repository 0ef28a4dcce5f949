//! The plan of a sweep: a header and one line a run, `manifest.jsonl`.

use super::error::{Result, SweepError, io};
use super::hash::Hash;
use super::sampling::RangeScale;
use super::study::{Kept, Study};
use super::template::Template;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::memory::read_file;
use sinew_scene::assemble::{BuildOptions, WITHOUT_EFFECT, build};
use sinew_scene::probe;
use sinew_scene::scene::LoadedScene;
use sinew_scene::summary::Versions;
use std::collections::{BTreeMap, HashMap};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Name and version of the format.
pub const SCHEMA: &str = "sinew-sweep/1";

/// What holds for all runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// [`SCHEMA`].
    pub schema: String,
    /// Version of the engine.
    pub engine: String,
    /// The scene file, relative to the folder of the sweep.
    pub scene: PathBuf,
    /// Hash of the scene file.
    pub scene_hash: String,
    /// Files that runs read, relative to the scene file, with their hashes.
    pub files: BTreeMap<String, String>,
    /// Instruction set of runs that do not say another.
    pub instruction_set: InstructionSet,
    /// What is kept of probes.
    pub probes: Kept,
    /// Keys of the scene that vary.
    pub parameters: Vec<String>,
    /// How the values of each are spread, where the study says so.
    #[serde(default)]
    pub scales: Vec<Option<RangeScale>>,
    /// Columns of the probes.
    pub columns: Vec<String>,
    /// Number of runs.
    pub runs: usize,
    /// Hash of the lines that follow.
    pub lines: String,
}

/// A run that was planned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedRun {
    /// Place in the table.
    pub index: usize,
    /// Hash of scene, files, parameters, engine version and what is kept.
    pub id: String,
    /// A value for each parameter; `null` leaves what the scene has.
    pub values: Vec<Value>,
}

/// A plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// What holds for all runs.
    pub header: Header,
    /// Runs in the order of the table.
    pub runs: Vec<PlannedRun>,
}

type SceneInputs = BTreeMap<String, String>;

/// Reads a study and writes the plan of its sweep into a folder, which is made. A folder that has a plan gets the new
/// one; results of runs that are in both are kept.
///
/// # Errors
/// Everything that is wrong with the study, a scene that cannot be built as it stands, and a folder that cannot be
/// written.
pub fn plan(file: &Path, folder: &Path) -> Result<Manifest> {
    let study = Study::read(file)?;
    refuse_idle(file, &study)?;
    let loaded = study.template.loaded();
    let scene_hash = Hash::of(read_file(&loaded.file).map_err(io(&loaded.file))?).text();
    let (base, columns) = files_of(loaded)?;
    let instruction_set = match loaded.scene.instruction_set {
        Some(set) => set,
        None => InstructionSet::default_set().unwrap_or(InstructionSet::best()),
    };
    let engine = Versions::this().sinew.to_string();
    let start = Hash::of(SCHEMA)
        .and(&engine)
        .and(&scene_hash)
        .and(instruction_set.name())
        .and(serde_json::to_string(&study.kept).unwrap_or_default());
    let mut files = base.clone();
    // files that only some runs read, by the names among their parameters
    let mut of_names: HashMap<Vec<String>, Hash> = HashMap::new();
    let mut runs = Vec::with_capacity(study.runs.len());
    for (index, values) in study.runs.iter().enumerate() {
        let names: Vec<String> = study.template.files(values).into_iter().map(Into::into).collect();
        let read = match of_names.get(&names) {
            Some(hash) => *hash,
            None => {
                let own = match names.is_empty() {
                    true => base.clone(),
                    false => {
                        let scene = study.template.scene(&study.paths, values);
                        // what cannot be built becomes a row with its error
                        scene.ok().map_or_else(SceneInputs::new, |scene| recorded(&scene).0)
                    }
                };
                let hash = own.iter().fold(start, |hash, (name, of)| hash.and(name).and(of));
                files.extend(own);
                of_names.insert(names, hash);
                hash
            }
        };
        let given = study.parameters.iter().zip(values);
        let id = given.fold(read, |hash, (key, value)| hash.and(key).and(value.to_string())).text();
        runs.push(PlannedRun { index, id, values: values.clone() });
    }
    std::fs::create_dir_all(folder).map_err(io(folder))?;
    let mut lines = String::new();
    for run in &runs {
        lines += &serde_json::to_string(run).unwrap_or_default();
        lines.push('\n');
    }
    let header = Header {
        schema: SCHEMA.into(),
        engine,
        scene: relative(&loaded.file, folder)?,
        scene_hash,
        files,
        instruction_set,
        probes: study.kept,
        parameters: study.parameters,
        scales: study.scales,
        columns,
        runs: runs.len(),
        lines: Hash::of(&lines).text(),
    };
    let text = serde_json::to_string(&header).unwrap_or_default() + "\n" + &lines;
    write_whole(&path_of(folder), text.as_bytes())?;
    Ok(Manifest { header, runs })
}

/// Runs that are built at most to see whether a parameter has an effect.
const LOOKED_AT: usize = 64;

/// Refuses a parameter that changes nothing in any run that is looked at.
fn refuse_idle(file: &Path, study: &Study) -> Result<()> {
    let every = study.runs.len().div_ceil(LOOKED_AT).max(1);
    let mut idle: Option<Vec<(usize, String)>> = None;
    for values in study.runs.iter().step_by(every) {
        // what is no scene, or cannot be built, becomes a row with its error
        let Ok(scene) = study.template.scene(&study.paths, values) else { return Ok(()) };
        let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
        let Ok(built) = build(&scene, &options) else { return Ok(()) };
        let why = |key: &str| {
            let mut notes = built.warnings.iter().filter(|w| w.code == WITHOUT_EFFECT);
            let own = notes.find(|w| key.starts_with(w.subject.trim_matches('`')))?;
            Some(own.message.clone())
        };
        let found = study.paths.iter().enumerate().filter_map(|(i, path)| {
            let known = idle.as_ref().is_none_or(|idle| idle.iter().any(|own| own.0 == i));
            why(&path.text()).filter(|_| known).map(|why| (i, why))
        });
        let found: Vec<_> = found.collect();
        if found.is_empty() {
            return Ok(());
        }
        idle = Some(found);
    }
    match idle.and_then(|idle| idle.into_iter().next()) {
        None => Ok(()),
        Some((i, why)) => {
            let remedy = "leave it out, or change what makes it idle";
            Err(SweepError::entry(file, None, &study.parameters[i], why, remedy))
        }
    }
}

fn path_of(folder: &Path) -> PathBuf {
    folder.join("manifest.jsonl")
}

/// Writes a file under another name, on the disk, and renames it: it is whole or not there.
pub(super) fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{}", std::process::id()));
    let partial = PathBuf::from(name);
    let write = || {
        let mut file = std::fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    write().map_err(|source| {
        let _ = std::fs::remove_file(&partial);
        io(path)(source)
    })
}

/// Builds a scene; the files it read with their hashes, and what building said.
fn recorded(loaded: &LoadedScene) -> (SceneInputs, Result<Vec<String>>) {
    let folder = loaded.resolve(Path::new(""));
    let read = Arc::new(Mutex::new(SceneInputs::new()));
    let into = Arc::clone(&read);
    let scene = loaded.clone().with_files(move |path| {
        let bytes = read_file(path)?;
        let mut files = into.lock().unwrap_or_else(PoisonError::into_inner);
        files.insert(name_of(path, &folder), Hash::of(&bytes).text());
        Ok(bytes)
    });
    let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    let columns = build(&scene, &options).map(|built| probe::columns(&built.probes));
    let files = std::mem::take(&mut *read.lock().unwrap_or_else(PoisonError::into_inner));
    (files, columns.map_err(SweepError::from))
}

/// Files and columns of a scene that can be built.
fn files_of(loaded: &LoadedScene) -> Result<(SceneInputs, Vec<String>)> {
    let (files, columns) = recorded(loaded);
    Ok((files, columns?))
}

/// Name of a file beside a scene.
fn name_of(path: &Path, folder: &Path) -> String {
    path.strip_prefix(folder).unwrap_or(path).to_string_lossy().into_owned()
}

/// The way from a folder to a file, so that both can be moved together.
fn relative(file: &Path, folder: &Path) -> Result<PathBuf> {
    let absolute = |path: &Path| path.canonicalize().map_err(io(path));
    let (file, folder) = (absolute(file)?, absolute(folder)?);
    let common = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| std::path::Component::ParentDir);
    Ok(up.chain(file.components().skip(common)).collect())
}

impl Manifest {
    /// Reads the plan of a folder.
    ///
    /// # Errors
    /// When there is none, or it is not as it was written.
    pub fn read(folder: &Path) -> Result<Self> {
        let none = |found: String| SweepError::NoPlan { folder: folder.into(), found };
        let path = path_of(folder);
        let text = match std::fs::read_to_string(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(none("there is no manifest.jsonl in it".into()));
            }
            text => text.map_err(io(&path))?,
        };
        let (first, lines) = text.split_once('\n').unwrap_or((&text, ""));
        let about: Value = serde_json::from_str(first).unwrap_or_default();
        if about["schema"] != SCHEMA {
            return Err(none(format!("its manifest is not of the form {SCHEMA}")));
        }
        let damaged = || none("its manifest is damaged".into());
        let header: Header = serde_json::from_value(about).map_err(|_| damaged())?;
        let runs = lines.lines().map(serde_json::from_str).collect::<Result<Vec<PlannedRun>, _>>();
        let runs = runs.map_err(|_| damaged())?;
        let whole = Hash::of(lines).text() == header.lines && runs.len() == header.runs;
        let fits = |run: &PlannedRun| run.values.len() == header.parameters.len();
        if whole && runs.iter().all(fits) { Ok(Self { header, runs }) } else { Err(damaged()) }
    }

    /// Index of every run by its id.
    pub fn by_id(&self) -> HashMap<&str, usize> {
        self.runs.iter().map(|run| (run.id.as_str(), run.index)).collect()
    }

    /// The scene and the places of parameters in it, after a check that nothing has changed since.
    ///
    /// # Errors
    /// [`SweepError::Changed`], [`SweepError::Engine`], [`SweepError::InstructionSet`], or a file that is gone.
    pub fn open(&self, folder: &Path) -> Result<Opened> {
        let header = &self.header;
        let own = Versions::this().sinew;
        if header.engine != own {
            let planned = header.engine.clone();
            return Err(SweepError::Engine { folder: folder.into(), planned, own: own.into() });
        }
        let set = header.instruction_set;
        let lacking = |_| SweepError::InstructionSet { set: set.name().into() };
        set.checked().map_err(lacking)?;
        let file = folder.join(&header.scene);
        let changed = |path: &Path| SweepError::Changed { path: path.into() };
        let bytes = read_file(&file).map_err(io(&file))?;
        let text = String::from_utf8(bytes).map_err(|_| changed(&file))?;
        if Hash::of(&text).text() != header.scene_hash {
            return Err(changed(&file));
        }
        let loaded = LoadedScene::parse(&text, &file)?;
        let beside = loaded.resolve(Path::new(""));
        for (name, hash) in &header.files {
            let path = beside.join(name);
            if Hash::of(read_file(&path).map_err(io(&path))?).text() != *hash {
                return Err(changed(&path));
            }
        }
        // a file may change while the runs go on
        let seen = Arc::new(Mutex::new(None));
        let (into, known, base) = (Arc::clone(&seen), header.files.clone(), beside.clone());
        let loaded = loaded.keep_meshes().with_files(move |path| {
            let bytes = read_file(path)?;
            if known.get(&name_of(path, &base)) == Some(&Hash::of(&bytes).text()) {
                return Ok(bytes);
            }
            *into.lock().unwrap_or_else(PoisonError::into_inner) = Some(path.to_path_buf());
            Err(std::io::Error::other("changed since the sweep was planned"))
        });
        let mut template = Template::new(loaded)?;
        template.set_instruction_set(set);
        Ok(Opened { template, changed: seen, folder: beside })
    }
}

/// A scene that is the one that was planned.
pub struct Opened {
    /// The scene.
    pub template: Template,
    /// Folder of the scene.
    pub folder: PathBuf,
    changed: Arc<Mutex<Option<PathBuf>>>,
}

impl Opened {
    /// Whether a file turned out to be another one since.
    ///
    /// # Errors
    /// [`SweepError::Changed`].
    pub fn unchanged(&self) -> Result<()> {
        let seen = self.changed.lock().unwrap_or_else(PoisonError::into_inner);
        seen.as_ref().map_or(Ok(()), |path| Err(SweepError::Changed { path: path.clone() }))
    }
}
