//! `sinew-papers` as a user meets it: exit codes, and what goes to stdout and stderr.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn sinew_papers(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sinew-papers")).args(arguments).output().unwrap()
}

fn check(arguments: &[&str], code: i32, stdout: &str, stderr: &str) {
    let output = sinew_papers(arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out}{err}");
    assert!(out.contains(stdout), "{arguments:?}: `{stdout}` is not in {out}");
    assert!(err.contains(stderr), "{arguments:?}: `{stderr}` is not in {err}");
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

#[test]
fn figures_of_a_paper_are_made_again() {
    let folder = file("paper-a");
    let out = folder.display().to_string();
    check(&["a", "--only", "a,f", "--out", &out], 0, "the paper is wrong", "11 files");
    let page = std::fs::read_to_string(folder.join("paper-a.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("(f) Resection of a liver in real time"));
    let csv = std::fs::read_to_string(folder.join("a-force.csv")).unwrap();
    assert!(csv.starts_with("nu,altitude ratio") && csv.lines().count() == 1 + 4 * 171);
    check(&["a", "--only", "z"], 1, "", "a, b, c");
}

#[test]
fn the_tables_of_a_paper() {
    check(&["b", "--only", "d"], 0, "nu_out does not follow nu_in", "figure 9");
    check(&["b", "--only", "x"], 1, "", "choose of a, b, c, d, e, f");
    let nowhere = ["b", "--only", "d", "--meshes", "nowhere"];
    check(&nowhere, 1, "", "b_cube_hex.msh");
    let both = ["b", "--write-meshes", "somewhere", "--only", "d"];
    check(&both, 2, "", "cannot be used with");
}
