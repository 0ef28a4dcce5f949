//! The scene of a sweep, and values put into it.

use serde_json::Value;
use sinew::engine::lanes::InstructionSet;
use sinew_scene::error::{SceneError, SceneProblem, hint};
use sinew_scene::scene::{LoadedScene, Scene};
use std::path::Path;

/// A key of a scene: names of tables and numbers of entries.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyPath(Vec<KeyStep>);

#[derive(Clone, Debug, PartialEq)]
enum KeyStep {
    Key(String),
    Entry(usize),
}

/// What is wrong, and the remedy.
pub type Fault = (String, String);

/// Keys that no run may have of its own.
const FIXED: [(&str, &str); 4] = [
    ("name", "it changes nothing"),
    ("description", "it changes nothing"),
    ("threads", "every run has one thread, results do not depend on it"),
    ("executor", "results do not depend on it"),
];

/// A scene, read once, from which every run takes its own.
#[derive(Clone, Debug)]
pub struct Template {
    loaded: LoadedScene,
    /// The scene with every key there is, `null` where it has no value.
    value: Value,
}

/// The scene of a value, by the reader of scene files: a reader of its own for JSON would be half a megabyte of machine code.
fn read(value: &Value) -> Result<Scene, String> {
    let mut text = String::new();
    for (key, value) in value.as_object().into_iter().flatten().filter(|(_, v)| !v.is_null()) {
        text += &format!("{} = ", Value::from(key.as_str()));
        inline(value, &mut text);
        text.push('\n');
    }
    toml::from_str(&text).map_err(|error| error.message().to_string())
}

/// A value in one line of TOML, whose strings and numbers are those of JSON; keys without a value are left out.
fn inline(value: &Value, text: &mut String) {
    let mut list = |open: char, close: char, parts: &mut dyn Iterator<Item = (String, &Value)>| {
        text.push(open);
        for (i, (key, value)) in parts.enumerate() {
            *text += if i > 0 { ", " } else { "" };
            *text += &key;
            inline(value, text);
        }
        text.push(close);
    };
    match value {
        Value::Object(keys) => {
            let mut parts = keys
                .iter()
                .filter(|(_, value)| !value.is_null())
                .map(|(key, value)| (format!("{} = ", Value::from(key.as_str())), value));
            list('{', '}', &mut parts);
        }
        Value::Array(entries) => {
            list('[', ']', &mut entries.iter().map(|value| (String::new(), value)));
        }
        value => *text += &value.to_string(),
    }
}

impl KeyPath {
    /// In the spelling of messages, `body[0].material.density`.
    pub(super) fn text(&self) -> String {
        self.0.iter().fold(String::new(), |text, step| match step {
            KeyStep::Entry(i) => format!("{text}[{i}]"),
            KeyStep::Key(key) if text.is_empty() => key.clone(),
            KeyStep::Key(key) => format!("{text}.{key}"),
        })
    }
}

impl Template {
    /// Takes a scene.
    ///
    /// # Errors
    /// When it holds a number that is not finite.
    pub fn new(loaded: LoadedScene) -> Result<Self, SceneError> {
        let value = serde_json::to_value(&loaded.scene).unwrap_or_default();
        if read(&value).is_ok_and(|again| again == loaded.scene) {
            return Ok(Self { loaded, value });
        }
        let (found, remedy) = ("a number is not finite".into(), "give finite numbers".into());
        let problem = SceneProblem::Value { found, remedy };
        Err(SceneError::At { place: loaded.place(""), problem })
    }

    /// Names the instruction set of runs that do not name one.
    pub fn set_instruction_set(&mut self, set: InstructionSet) {
        self.loaded.scene.instruction_set.get_or_insert(set);
        let own = &mut self.value["instruction_set"];
        if own.is_null() {
            *own = set.name().into();
        }
    }

    /// The scene.
    pub fn loaded(&self) -> &LoadedScene {
        &self.loaded
    }

    /// Finds `body.0.material.density`, `body[0].material.density` or `body.NAME.material.density`.
    ///
    /// # Errors
    /// Which part does not exist, and what does.
    pub fn find(&self, path: &str) -> Result<KeyPath, Fault> {
        let normal = path.replace('[', ".").replace(']', "");
        if let Some((_, why)) = FIXED.iter().find(|(key, _)| *key == normal) {
            return Err((format!("`{path}` cannot be swept, {why}"), "leave it out".into()));
        }
        let (mut at, mut steps, mut done) = (&self.value, Vec::new(), String::new());
        let mut around = at;
        for name in normal.split('.') {
            let scene = if done.is_empty() { "a scene".to_string() } else { format!("`{done}`") };
            around = at;
            let step = match at {
                Value::Object(keys) => match keys.get(name) {
                    Some(value) => {
                        at = value;
                        KeyStep::Key(name.into())
                    }
                    None => {
                        let known = keys.keys().map(String::as_str);
                        let found = format!("{scene} has no key `{name}`");
                        return Err((found, hint("key", name, known)));
                    }
                },
                Value::Array(entries) => {
                    let named = |entry: &Value| entry.get("name").is_some_and(|own| own == name);
                    let index = name.parse().ok().or_else(|| entries.iter().position(named));
                    match index.filter(|&i: &usize| i < entries.len()) {
                        Some(i) => {
                            at = &entries[i];
                            KeyStep::Entry(i)
                        }
                        None => {
                            let remedy = "give the number of an entry, counted from 0, or its name";
                            let found =
                                format!("{scene} has {} entries and no `{name}`", entries.len());
                            return Err((found, remedy.into()));
                        }
                    }
                }
                // a table that the scene does not have: values make it, and reading them tells what it may hold
                Value::Null if name.parse::<usize>().is_err() => KeyStep::Key(name.into()),
                _ => {
                    let remedy = "name a single value, or a whole list";
                    return Err((
                        format!("{scene} holds nothing that could be called `{name}`"),
                        remedy.into(),
                    ));
                }
            };
            steps.push(step);
            done = if done.is_empty() { name.into() } else { format!("{done}.{name}") };
        }
        // a constant that every element has from an array
        let name = normal.rsplit('.').next().unwrap_or_default();
        let field = format!("{name}_field");
        if at.is_null() && around.get(&field).is_some_and(|array| !array.is_null()) {
            let found = format!("`{path}` cannot be swept, `{field}` gives it for every element");
            return Err((found, format!("sweep `{field}`, or take it out of the scene")));
        }
        Ok(KeyPath(steps))
    }

    /// Value of the scene at a path.
    pub fn value(&self, path: &KeyPath) -> &Value {
        path.0.iter().fold(&self.value, |at, step| match step {
            KeyStep::Key(key) => &at[key.as_str()],
            KeyStep::Entry(i) => &at[*i],
        })
    }

    /// The scene with values, one a path; `null` leaves what the scene has.
    ///
    /// # Errors
    /// The place of the value that does not fit among `paths`, or `None` when only all of them together do not,
    /// and what is wrong.
    pub fn scene(
        &self,
        paths: &[KeyPath],
        values: &[Value],
    ) -> Result<LoadedScene, (Option<usize>, String)> {
        let with = |which: &[usize]| {
            let mut value = self.value.clone();
            for &i in which.iter().filter(|&&i| !values[i].is_null()) {
                set(&mut value, &paths[i].0, values[i].clone());
            }
            read(&value)
        };
        let all: Vec<usize> = (0..paths.len()).collect();
        let scene = with(&all).map_err(|error| {
            let alone = all.iter().find_map(|&i| Some((i, with(&[i]).err()?)));
            alone.map_or((None, error), |(i, error)| (Some(i), error))
        })?;
        for (own, of_plan) in scene.probes.iter().zip(&self.loaded.scene.probes) {
            if (&own.name, &own.record) != (&of_plan.name, &of_plan.record) {
                return Err((
                    None,
                    "all runs must have the same probes, `name` and `record` cannot be swept"
                        .into(),
                ));
            }
        }
        let mut loaded = self.loaded.clone();
        loaded.scene = scene;
        for path in paths {
            loaded.replaced_by(path.text(), format!("{} of the study", path.text()));
        }
        Ok(loaded)
    }

    /// Files among values: names that the scene's folder has.
    pub fn files<'a>(&self, values: &'a [Value]) -> Vec<&'a str> {
        let names = values.iter().filter_map(Value::as_str);
        names.filter(|name| self.loaded.resolve(Path::new(name)).is_file()).collect()
    }
}

fn set(mut at: &mut Value, path: &[KeyStep], value: Value) {
    for step in path {
        at = match step {
            KeyStep::Key(key) => {
                if at.is_null() {
                    *at = Value::Object(serde_json::Map::new());
                }
                &mut at[key.as_str()]
            }
            KeyStep::Entry(i) => &mut at[*i],
        };
    }
    *at = value;
}
