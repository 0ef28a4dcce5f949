//! The figures of the gallery and of documents against runs: no picture or figure is older than the code.

use sinew_scene::picture::{
    FIGURES, GalleryEntry, GalleryFigures, SceneFigures, checksum, gallery_page, scenes_table,
    with_block,
};
use std::path::PathBuf;

/// Share of a figure by which a run may differ from what is printed: captions have three digits, and the kernels of these
/// runs give the same bits on every machine.
const TOLERANCE: f64 = 0.01;

/// What says how to mend it.
const REMEDY: &str = "draw again: cargo run --release -p sinew-cli --features render -- render --gallery docs/gallery";

fn docs() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

fn read(path: &str) -> String {
    std::fs::read_to_string(docs().join(path)).unwrap()
}

fn stored() -> GalleryFigures {
    serde_json::from_str(&read(&format!("gallery/{FIGURES}"))).unwrap()
}

/// Runs scenes of the gallery and compares what their captions say with the stored figures.
fn compare(wanted: impl Fn(&str) -> bool) {
    let stored = stored();
    let mut found = Vec::new();
    for entry in GalleryEntry::all().unwrap().iter().filter(|entry| wanted(&entry.scene)) {
        let now = entry.figures().unwrap();
        let differences = stored[&entry.scene].differences(&now, TOLERANCE);
        found.extend(differences.into_iter().map(|what| format!("{}: {what}", entry.scene)));
    }
    assert!(found.is_empty(), "{REMEDY}\n{}", found.join("\n"));
}

/// Those that take a second or less.
const QUICK: [&str; 4] = ["crush", "fibre_bar", "probe_fast", "static_beam"];

#[test]
fn captions_of_quick_scenes_are_those_of_a_run() {
    compare(|scene| QUICK.contains(&scene));
}

#[test]
#[ignore = "slow"]
fn captions_of_all_other_scenes_are_those_of_a_run() {
    compare(|scene| !QUICK.contains(&scene));
}

#[test]
fn every_picture_is_the_one_that_was_drawn_with_its_figures() {
    let stored = stored();
    let list = GalleryEntry::all().unwrap();
    let mut names: Vec<&str> = list.iter().map(|entry| &*entry.scene).collect();
    names.sort_unstable();
    assert!(stored.keys().eq(names.iter()), "{REMEDY}");
    for (name, figures) in &stored {
        let png = std::fs::read(docs().join(format!("gallery/{name}.png"))).unwrap();
        assert_eq!(checksum(&png), figures.picture, "{name}.png: {REMEDY}");
    }
    assert_eq!(read("gallery.md"), gallery_page("gallery", &list, &stored), "{REMEDY}");
}

/// A figure of a document in the words of the document.
fn quotes(stored: &GalleryFigures) -> Vec<(&'static str, String)> {
    let thousands = |n: usize| match n {
        1_000.. => format!("{} {:03}", n / 1_000, n % 1_000),
        _ => n.to_string(),
    };
    let liver = &stored["liver"];
    let elements = thousands(liver.elements);
    let seconds = liver.dt * liver.steps as f64;
    let error = 100.0 * liver.linearisation_error;
    assert_eq!(liver.inverted, 0, "numbers.md says that there is no inverted element");
    vec![
        ("../README.md", format!("An organ of {elements} tetrahedra")),
        ("../README.md", format!("{seconds:.0} s of simulated time")),
        ("../README.md", format!("| liver scene, {elements} tetrahedra,")),
        ("../README.md", format!("| linearisation {error:.2} % |")),
        ("numbers.md", format!("| liver scene, {elements} tetrahedra,")),
        ("numbers.md", format!("| linearisation {error:.2} % mean; no inverted element |")),
    ]
}

#[test]
fn documents_quote_the_figures_of_these_runs() {
    let stored = stored();
    for (file, words) in quotes(&stored) {
        let text = read(file);
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains(&words), "{file} does not say `{words}`");
    }
    let numbers = read("numbers.md");
    let again = with_block(&numbers, "scenes", &scenes_table(&stored));
    assert_eq!(again.as_deref(), Some(&*numbers), "{REMEDY}");
}

#[test]
fn figures_that_went_off_are_named() {
    let stored = stored();
    let palpation = &stored["palpation"];
    assert_eq!(palpation.differences(palpation, TOLERANCE), Vec::<String>::new());
    let mut stale: SceneFigures = palpation.clone();
    let (name, force) = stale.forces.iter_mut().next().unwrap();
    let name = name.clone();
    force[1] *= 1.2;
    stale.colours_end = stale.colours_end.map(|end| 1.02 * end);
    stale.caption = stale.caption.replace("auto", "safe").replace("ms", "s");
    let found = stale.differences(palpation, TOLERANCE).join("\n");
    for word in ["caption", "colour bar", &format!("largest force of {name}")] {
        assert!(found.contains(word), "`{word}` is not in\n{found}");
    }
    assert!(!found.contains("elements and steps"), "{found}");
}
