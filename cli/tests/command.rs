//! The command as a user meets it: exit codes, and what goes to stdout and stderr.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn sinew(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sinew")).args(arguments).output().unwrap()
}

fn check(arguments: &[&str], code: i32, stdout: &str, stderr: &str) {
    let output = sinew(arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out}{err}");
    assert!(out.contains(stdout), "{arguments:?}: `{stdout}` is not in {out}");
    assert!(err.contains(stderr), "{arguments:?}: `{stderr}` is not in {err}");
}

fn shipped(name: &str) -> String {
    sinew_demos::shipped_scene(name).display().to_string()
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

#[test]
fn a_run_reports_on_stdout_and_returns_zero() {
    let liver = shipped("liver");
    check(&["run", &liver, "--steps", "3"], 0, "What was simulated", "");
    let quiet = sinew(&["run", &liver, "--steps", "3", "--quiet"]);
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty());
    let json = sinew(&["run", &liver, "--steps", "3", "--json", "-", "--precision", "f32"]);
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(
        (&value["schema"], &value["settings"]["precision"]),
        (&"sinew-run/1".into(), &"f32".into())
    );
}

#[test]
fn bad_input_returns_one_and_a_wrong_command_line_two() {
    check(&["run", "nowhere.toml"], 1, "", "error: nowhere.toml");
    check(&["check", "nowhere.msh"], 1, "CANNOT", "");
    check(&["mesh", "info", "nowhere.msh"], 1, "", "nowhere.msh");
    check(&["run"], 2, "", "Usage");
    check(&["run", &shipped("liver"), "--steps", "0"], 2, "", "--steps");
    check(&["simulate"], 2, "", "Usage");
}

#[test]
fn a_run_that_fails_on_the_way_reports_and_returns_one() {
    let scene = std::fs::read_to_string(shipped("cantilever")).unwrap();
    let scene = scene
        .replace("integrator = \"safe\"", "integrator = \"symplectic-euler\"\nmax_substeps = 2");
    let path = file("too_few_substeps.toml");
    std::fs::write(&path, scene).unwrap();
    let path = path.display().to_string();
    check(&["run", &path], 1, "FAILED after 0 of 300 steps", "substeps");
}

#[test]
fn checks_and_meshes() {
    check(&["check", &shipped("crush")], 0, "can be simulated", "");
    check(&["check", &shipped("crush"), "--json"], 0, "\"sinew-check/1\"", "");
    let out = file("box.vtu").display().to_string();
    let size = ["mesh", "generate", "box", "--size", "0.1", "0.2", "0.3", "--cells", "1", "2", "3"];
    check(&[&size[..], &["-o", &out]].concat(), 0, "tetrahedra  36", "");
    let msh = file("box.msh").display().to_string();
    check(&["mesh", "convert", &out, &msh, "--scale", "0.5"], 0, "written to", "");
    check(&["mesh", "info", &msh, "--json"], 0, "\"tetrahedra\": 36", "");
    let stp = file("box.stp").display().to_string();
    check(&["mesh", "convert", &out, &stp], 1, "", ".vtu");
}
