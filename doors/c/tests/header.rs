//! The header: complete, and understood by compilers. Crate `doors/c/header` holds it against the sources.

#![allow(clippy::print_stdout, reason = "a test that is skipped says so")]

use std::path::{Path, PathBuf};
use std::process::Command;

fn committed() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("include/sinew.h")
}

#[test]
fn the_header_has_every_function_and_constant() {
    let header = std::fs::read_to_string(committed()).unwrap();
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut count = 0;
    for file in std::fs::read_dir(sources).unwrap() {
        let text = std::fs::read_to_string(file.unwrap().path()).unwrap();
        for (start, end) in [("extern \"C\" fn ", "("), ("pub const ", ":"), ("pub struct ", " {")]
        {
            for found in text.split(start).skip(1) {
                let name = found.split(end).next().unwrap();
                if name.to_lowercase().starts_with("sinew_")
                    && name != "sinew_test_panic"
                    && name.len() < 40
                {
                    assert!(header.contains(name), "{name} is not in the header");
                    count += 1;
                }
            }
        }
    }
    assert!(count > 90, "{count}");
    assert!(!header.contains("sinew_test"));
}

#[test]
fn compilers_understand_the_header() {
    for (compiler, language, standard) in
        [("cc", "c", "c99"), ("cc", "c", "c11"), ("c++", "c++", "c++17")]
    {
        let mut command = Command::new(compiler);
        command.args([
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            "-fsyntax-only",
            "-x",
            language,
        ]);
        command.arg(format!("-std={standard}")).arg(committed());
        match command.output() {
            Err(error) => println!("skipped {standard}: {compiler}: {error}"),
            Ok(output) => {
                assert!(
                    output.status.success(),
                    "{standard}: {}",
                    String::from_utf8_lossy(&output.stderr)
                );
            }
        }
    }
}

#[test]
fn the_profile_of_bindings_unwinds() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../Cargo.toml");
    let root: toml::Table = std::fs::read_to_string(root).unwrap().parse().unwrap();
    let profile = &root["profile"]["binding"];
    assert_eq!(profile["inherits"].as_str(), Some("release"));
    assert_eq!(profile["panic"].as_str(), Some("unwind"));
}

/// Names of functions of the header.
pub(crate) fn functions() -> Vec<String> {
    let text = std::fs::read_to_string(committed()).unwrap();
    let names = text.split(|c: char| !(c.is_alphanumeric() || "_(".contains(c)));
    let mut found: Vec<String> = names
        .filter_map(|word| word.split_once('(').map(|(name, _)| name))
        .filter(|name| name.starts_with("sinew_") && *name != "sinew_last_error")
        .map(String::from)
        .collect();
    found.sort();
    found.dedup();
    found
}
