//! All mistakes of a scene at once: what is wrong is told, taken out or replaced, and the rest is looked at again.

use super::document::Scene;
use super::read::{LoadedScene, Source};
use crate::error::{Place, SceneError, SceneProblem};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue, Deserializer};

/// Most mistakes that are looked for.
const MOST: usize = 30;

/// What stands for keys without which nothing else could be looked at.
const STAND_INS: [(&str, &str); 7] = [
    ("name", ""),
    ("dt", "0.01"),
    ("duration", "0.01"),
    ("young_modulus", "1e4"),
    ("poisson_ratio", "0.3"),
    ("density", "1e3"),
    ("friction", "0.0"),
];

impl LoadedScene {
    /// What is wrong in a scene, `build` included, as far as it can be told at once: not what follows from other mistakes,
    /// and of entries that cannot be read nothing more.
    pub(crate) fn mistakes(
        text: &str,
        file: &Path,
        build: impl Fn(&Self) -> Result<(), SceneError>,
    ) -> Vec<SceneError> {
        let mut rest = match Rest::new(text, file) {
            Ok(rest) => rest,
            Err(syntax) => return syntax,
        };
        let mut found = Vec::new();
        if let Some(error) = rest.scene.beyond() {
            if let SceneError::At { place, .. } = &error {
                rest.pass_over(&place.key);
            }
            found.push(error);
        }
        while found.len() < MOST {
            let Err((error, read)) = rest.attempt(&build) else { break };
            let SceneError::At { place, problem } = error else {
                found.push(error);
                break;
            };
            // the parser knows places in the file, what was read those in what is left of it
            let key = if read { place.key.clone() } else { rest.original(&place.key) };
            let follows = rest.follows(&key, &problem);
            let unknown_key = matches!(problem, SceneProblem::Unknown { kind: "key", .. });
            let gone = match &problem {
                _ if follows => rest.drop_entry(&key),
                SceneProblem::Unknown { name, .. } if unknown_key => {
                    let below = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                    rest.pass_over(&below)
                }
                SceneProblem::Missing { .. } => rest.drop_entry(&key),
                _ => rest.pass_over(&key) || rest.drop_entry(&key),
            };
            if !follows {
                let line = if read { place.line } else { rest.scene.line(&key) };
                let place = Box::new(Place { line, key, ..*place });
                found.push(SceneError::At { place, problem });
            }
            // without a body whatever acts on it would be wrong too
            if !gone || !read && rest.dropped.iter().any(|(list, _)| list == "body") {
                break;
            }
        }
        found
    }
}

/// What is left of a scene.
struct Rest<'a> {
    table: Spanned<DeTable<'a>>,
    /// The scene as far as it is known, for the places of keys.
    scene: Source<'a>,
    /// Entries of lists that were taken out, by their index in the file.
    dropped: BTreeSet<(String, usize)>,
    /// Their names.
    names: BTreeSet<String>,
    /// Keys that were taken out, and the tables that they stood in.
    passed: BTreeSet<String>,
}

impl<'a> Rest<'a> {
    fn new(text: &'a str, file: &'a Path) -> Result<Self, Vec<SceneError>> {
        let scene = Source::new(text, file);
        let (table, errors) = DeTable::parse_recoverable(text);
        match errors[..] {
            [] => Ok(Self {
                table,
                scene,
                dropped: BTreeSet::new(),
                names: BTreeSet::new(),
                passed: BTreeSet::new(),
            }),
            _ => Err(errors.iter().map(|error| scene.error(error)).collect()),
        }
    }

    /// Reads and builds what is left; whether an error is one of reading.
    fn attempt(
        &self,
        build: impl Fn(&LoadedScene) -> Result<(), SceneError>,
    ) -> Result<(), (SceneError, bool)> {
        let read = Scene::deserialize(Deserializer::from(self.table.clone()));
        let scene = self.scene.loaded(read).map_err(|error| (error, true))?;
        build(&scene).map_err(|error| (error, false))
    }

    /// Whether an error is what another one led to.
    fn follows(&self, key: &str, problem: &SceneProblem) -> bool {
        match problem {
            SceneProblem::Unknown { kind, name, .. } if *kind != "key" && *kind != "choice" => {
                self.names.contains(name) || self.passed.contains(key)
            }
            SceneProblem::Unknown { .. } => false,
            _ => self.passed.contains(key),
        }
    }

    /// A path of the file, by one of what is left.
    fn original(&self, path: &str) -> String {
        let Some((list, index, below)) = entry_of(path) else { return path.into() };
        let mut place = index;
        for (_, gone) in self.dropped.iter().filter(|(own, _)| own == list) {
            place += usize::from(*gone <= place);
        }
        format!("{list}[{place}]{below}")
    }

    /// A path of what is left, by one of the file.
    fn current(&self, path: &str) -> String {
        let Some((list, index, below)) = entry_of(path) else { return path.into() };
        let gone = self.dropped.iter().filter(|(own, gone)| own == list && *gone < index).count();
        format!("{list}[{}]{below}", index - gone)
    }

    /// Takes a key out, or puts something usable in its place; whether it was there.
    fn pass_over(&mut self, key: &str) -> bool {
        let path = self.current(key);
        let mut parts: Vec<&str> =
            path.split(['.', '[', ']']).filter(|part| !part.is_empty()).collect();
        // of a list of numbers all go
        while parts.last().is_some_and(|last| last.parse::<usize>().is_ok()) {
            parts.pop();
        }
        let Some((name, above)) = parts.split_last() else { return false };
        let Some(table) = inner(self.table.get_mut(), above) else { return false };
        let Some(value) = table.get_mut(*name) else { return false };
        match STAND_INS.iter().find(|(own, _)| own == name) {
            _ if self.passed.contains(key) => return false,
            Some(("name", _)) => {
                *value = Spanned::new(value.span(), DeValue::String(key.to_string().into()));
            }
            Some((_, usable)) => {
                let Ok(usable) = DeValue::parse(usable) else { return false };
                *value = Spanned::new(value.span(), usable.into_inner());
            }
            None => {
                table.remove(*name);
            }
        }
        self.passed.insert(key.to_string());
        let above = key.rfind(['.', '[']).map_or("", |end| &key[..end]);
        self.passed.insert(above.to_string());
        true
    }

    /// Takes the entry of a list out that holds a key; whether there is one.
    fn drop_entry(&mut self, key: &str) -> bool {
        let current = self.current(key);
        let (Some((list, index, _)), Some((_, original, _))) = (entry_of(&current), entry_of(key))
        else {
            return false;
        };
        let Some(DeValue::Array(entries)) =
            self.table.get_mut().get_mut(list).map(Spanned::get_mut)
        else {
            return false;
        };
        let taken = std::mem::replace(entries, DeArray::new());
        for (i, entry) in taken.into_iter().enumerate() {
            if i != index {
                entries.push(entry);
            } else if let Some(name) =
                entry.get_ref().get("name").and_then(|n| n.get_ref().as_str())
            {
                self.names.insert(name.to_string());
            }
        }
        self.dropped.insert((list.to_string(), original))
    }
}

/// List, index and rest of a path such as `body[1].material`.
fn entry_of(path: &str) -> Option<(&str, usize, &str)> {
    let (list, rest) = path.split_once('[')?;
    let (index, below) = rest.split_once(']')?;
    (!list.contains('.')).then_some((list, index.parse().ok()?, below))
}

/// The table at a path below another one.
fn inner<'t, 'a>(table: &'t mut DeTable<'a>, path: &[&str]) -> Option<&'t mut DeTable<'a>> {
    match path.split_first() {
        None => Some(table),
        Some((first, rest)) => below(table.get_mut(*first)?.get_mut(), rest),
    }
}

fn below<'t, 'a>(value: &'t mut DeValue<'a>, path: &[&str]) -> Option<&'t mut DeTable<'a>> {
    match value {
        DeValue::Table(own) => inner(own, path),
        DeValue::Array(entries) => {
            let (index, rest) = path.split_first()?;
            below(entries.get_mut(index.parse::<usize>().ok()?)?.get_mut(), rest)
        }
        _ => None,
    }
}
