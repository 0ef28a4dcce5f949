//! Running the command.

use std::process::{Command, Output};

/// What the command says and returns; a run leaves a page where it is asked to.
pub fn sinew(arguments: &[&str]) -> Output {
    let run = arguments.first() == Some(&"run");
    let asked = ["--page", "--out"].iter().any(|option| arguments.contains(option));
    let more: &[&str] = if run && !asked { &["--no-page"] } else { &[] };
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(&arguments[..usize::from(run)]).args(more);
    command.args(&arguments[usize::from(run)..]).output().unwrap()
}

/// The command returns `code`, and these words are in its output and among its errors; returns its output.
pub fn check(arguments: &[&str], code: i32, stdout: &str, stderr: &str) -> String {
    let output = sinew(arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out}{err}");
    assert!(out.contains(stdout), "{arguments:?}: `{stdout}` is not in {out}");
    assert!(err.contains(stderr), "{arguments:?}: `{stderr}` is not in {err}");
    out
}
