//! No key of a scene is without effect in silence: every number of every shipped scene is changed by a little, and either
//! states or recorded results move, or `check` says why they do not.

use sinew_scene::assemble::{BuildOptions, BuiltScene, WITHOUT_EFFECT, build};
use sinew_scene::run::{Observer, RunOptions, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::{scene_folder, shipped_scene};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use toml::Value;

/// Keys that steer output alone, each with its reason.
const OUTPUT: [(&str, &str); 3] = [
    ("output.", "frames and rows of the table"),
    ("name", "the name of files"),
    ("probe", "what is recorded; other numbers may give the same vertices"),
];

/// Vectors whose numbers are one key: of directions the length does not count, points of planes and axes may lie anywhere
/// in these, and a body that meets nothing may stand anywhere. What counts of them by rounding alone would count on some
/// machines only.
const VECTORS: [&str; 10] = [
    "at",
    "direction",
    "axis",
    "centre",
    "hinge",
    "hinge_axis",
    "into",
    "normal",
    "point",
    "translate",
];

/// Steps of a run: enough for tools to reach what they touch, most of them in few.
fn steps(name: &str) -> f64 {
    if name == "press_flat" { 90.0 } else { 30.0 }
}

/// Everything that a run computed: states and probes at all times, up to where they differ from those of another.
struct Results<'a> {
    found: Vec<u8>,
    other: Option<&'a [u8]>,
    differ: Arc<AtomicBool>,
}

impl Results<'_> {
    fn add(&mut self, bytes: impl Iterator<Item = u8>) {
        self.found.extend(bytes);
        if self.other.is_some_and(|other| !other.starts_with(&self.found)) {
            self.differ.store(true, Ordering::Relaxed);
        }
    }
}

impl Observer for Results<'_> {
    fn row(&mut self, _: u64, _: f64, probes: &[f64]) {
        self.add(probes.iter().flat_map(|x| x.to_bits().to_le_bytes()));
    }

    fn step(&mut self, _: u64, _: f64, scene: &mut BuiltScene) {
        self.add(scene.simulation.state_hash().to_le_bytes().into_iter());
    }
}

/// A value in one line of TOML; the tables of a scene have plain keys, its texts no quotes.
fn inline(value: &Value) -> String {
    let list =
        |open: &str, parts: Vec<String>, close: &str| format!("{open}{}{close}", parts.join(", "));
    match value {
        Value::Table(table) => list(
            "{",
            table.iter().map(|(key, own)| format!("{key} = {}", inline(own))).collect(),
            "}",
        ),
        Value::Array(entries) => list("[", entries.iter().map(inline).collect(), "]"),
        Value::String(text) => format!("{text:?}"),
        Value::Float(x) => format!("{x:?}"),
        Value::Integer(x) => x.to_string(),
        Value::Boolean(x) => x.to_string(),
        Value::Datetime(_) => unreachable!("scenes have no dates"),
    }
}

/// A scene as text.
fn text_of(scene: &Value) -> String {
    let table = scene.as_table().unwrap();
    table.iter().map(|(key, own)| format!("{key} = {}\n", inline(own))).collect()
}

/// The results of a scene, no further than they are those of `other`, or why it has none.
fn results(scene: &Value, other: Option<&[u8]>) -> Result<Vec<u8>, String> {
    let loaded = LoadedScene::parse(&text_of(scene), &scene_folder().join("keys.toml"))
        .map_err(|e| e.to_string())?;
    let build = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    let differ = Arc::new(AtomicBool::new(false));
    let mut results = Results { found: Vec::new(), other, differ: differ.clone() };
    let options = RunOptions { build, interrupt: Some(differ), ..RunOptions::default() };
    let summary = run(&loaded, &options, &mut results).map_err(|e| e.to_string())?;
    results.found.extend(summary.failure.unwrap_or_default().into_bytes());
    Ok(results.found)
}

/// A shipped scene in few steps on a coarse mesh, whose every key still means what it means there.
fn coarse(name: &str) -> Value {
    let text = std::fs::read_to_string(shipped_scene(name)).unwrap();
    let mut scene: Value = toml::from_str(&text.replace("liver.msh", "liver_coarse.msh")).unwrap();
    if let Some(duration) = scene.get("duration").and_then(Value::as_float) {
        scene["dt"] = (duration / steps(name)).into();
    }
    let finer = scene.clone();
    for_each_number(&mut scene, "", &mut |path, value| {
        let count = value.as_integer().filter(|_| path.contains(".generate."));
        if let Some(count) = count {
            *value = (count / 2).max(2).min(count).into();
        }
    });
    // a selection may need the vertices of the fine mesh
    if results(&scene, None).is_ok() { scene } else { finer }
}

/// Calls `change` with the path of every number.
fn for_each_number(value: &mut Value, path: &str, change: &mut dyn FnMut(&str, &mut Value)) {
    match value {
        Value::Table(table) => {
            for (key, value) in table.iter_mut() {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                for_each_number(value, &path, change);
            }
        }
        Value::Array(entries) => {
            for (i, value) in entries.iter_mut().enumerate() {
                for_each_number(value, &format!("{path}[{i}]"), change);
            }
        }
        Value::Integer(_) | Value::Float(_) => change(path, value),
        _ => {}
    }
}

/// Other values of a number, near ones first.
fn others(path: &str, value: &Value) -> Vec<Value> {
    match value {
        // there are enough of them, or too few
        Value::Integer(_) if path.ends_with(".spare") => vec![1.into()],
        Value::Integer(count) => vec![(count + 1).into(), (count - 1).into()],
        Value::Float(x) => {
            let near = if *x == 0.0 { 1e-4 } else { x * 1.001 };
            // what chooses whole vertices or elements, bounds an error or must reach something needs more
            let all = [near, 0.5 * x, 1.5 * x, x + 0.05, x - 0.05, 1e-9 * x];
            all.into_iter().map(Value::from).collect()
        }
        _ => Vec::new(),
    }
}

/// Keys that change nothing and of which nothing is said, among those that `chosen` picks.
fn silent(name: &str, chosen: impl Fn(&str) -> bool) -> Vec<String> {
    let scene = coarse(name);
    let base = results(&scene, None).unwrap();
    let mut paths = Vec::new();
    for_each_number(&mut scene.clone(), "", &mut |path, value| {
        if chosen(path) && !OUTPUT.iter().any(|(own, _)| path.starts_with(own)) {
            paths.push((path.to_string(), others(path, value)));
        }
    });
    let loaded = LoadedScene::parse(&text_of(&scene), &scene_folder().join("keys.toml")).unwrap();
    let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    let warnings = build(&loaded, &options).unwrap().warnings;
    let told = |path: &str| {
        let own = warnings.iter().filter(|w| w.code == WITHOUT_EFFECT);
        own.into_iter().any(|w| path.starts_with(w.subject.trim_matches('`')))
    };
    let moves = |(path, others): &(String, Vec<Value>)| {
        others.iter().any(|other| {
            let mut changed = scene.clone();
            for_each_number(&mut changed, "", &mut |own, value| {
                if own == path {
                    *value = other.clone();
                }
            });
            // an error says why
            results(&changed, Some(&base)).as_ref() != Ok(&base)
        })
    };
    let key = |path: &str| {
        // the way of a tool that removes whole elements: most points of it may lie elsewhere by the size of one
        if let Some((way, _)) = path.split_once(".path").filter(|_| path.starts_with("resection["))
        {
            return format!("{way}.path");
        }
        // a small turn of a plane may choose the same vertices
        if let Some((space, _)) = path.split_once("half_space.") {
            return format!("{space}half_space");
        }
        // a blade begins and ends beside the body, wherever that is
        if let Some((blade, _)) = path.split_once(".strip") {
            return format!("{blade}.strip");
        }
        let vector = path.rsplit_once('[').map_or(path, |(vector, _)| vector).to_string();
        let last = vector.rsplit('.').next().unwrap_or_default();
        // where an instrument ends its way it may be clear of everything, however far it is moved across
        let waypoint = last.starts_with("path[");
        if VECTORS.contains(&last) || waypoint { vector } else { path.to_string() }
    };
    let mut keys: BTreeMap<String, bool> = BTreeMap::new();
    for own in &paths {
        let counts = keys.entry(key(&own.0)).or_default();
        *counts = *counts || told(&own.0) || moves(own);
    }
    let still = keys.into_iter().filter(|(_, counts)| !counts);
    still.map(|(key, _)| format!("{name}: {key}")).collect()
}

#[test]
fn numbers_of_some_scenes_count_or_it_is_said_that_they_do_not() {
    let none: [String; 0] = [];
    assert_eq!(silent("fit_bar", |_| true), none);
    assert_eq!(
        silent("palpation", |path| path.starts_with("body") || path.contains("radius")),
        none
    );
    assert_eq!(silent("muscle_bar", |path| path.contains("fibres") || path.contains("axes")), none);
}

#[test]
#[ignore = "slow"]
fn every_number_of_every_shipped_scene_counts_or_it_is_said_that_it_does_not() {
    let mut found = Vec::new();
    for name in crate::scenes::SHIPPED.split_whitespace() {
        found.extend(silent(name, |_| true));
    }
    assert!(found.is_empty(), "{found:#?}");
}
