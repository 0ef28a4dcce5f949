//! `validate` over the project's own cases, and over the whole reference set where it is at hand: in
//! the folder named by `SINEW_REFERENCE`, or in `../shared` beside the repository.

use sinew::prelude::Evaluation;
use sinew_demos::validate::{Status, ValidateOptions, validate};
use std::path::{Path, PathBuf};

fn check(files: &[PathBuf], evaluation: Evaluation, expected: usize) {
    let options = ValidateOptions { evaluation, threads: 1, ..Default::default() };
    let report = validate(files, &options, |_| {}).unwrap();
    let passed = report.rows.iter().filter(|r| r.status == Status::Pass).count();
    assert!(report.passed(), "{report}");
    assert!(passed >= expected, "only {passed} of {expected} cases were run:\n{report}");
}

#[test]
fn own_cases() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = vec![root.join("models/tests/data/element_forces.json")];
    for name in ["p1_cantilever", "p2_spin_stvk", "p3_compressed_release", "p4_drum_trbs"] {
        files.push(root.join(format!("tests/data/reference_dynamics/{name}.json")));
    }
    for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
        check(&files, evaluation, 6);
    }
}

#[test]
fn whole_reference_set() {
    let root = std::env::var_os("SINEW_REFERENCE")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let mut files = Vec::new();
    for folder in ["reference_fem", "reference_dynamics"] {
        let Ok(entries) = std::fs::read_dir(root.join(folder)) else { continue };
        let cases = entries.flatten().map(|e| e.path());
        files.extend(cases.filter(|p| p.extension().is_some_and(|e| e == "json")));
    }
    if files.is_empty() || !root.join("meshes").is_dir() {
        use std::io::Write;
        // straight to stderr: the harness would swallow it
        let _ = writeln!(
            std::io::stderr(),
            "skipped: no reference set in {} (set SINEW_REFERENCE)",
            root.display()
        );
        return;
    }
    files.sort();
    for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
        check(&files, evaluation, 32);
    }
}
