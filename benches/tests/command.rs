//! `sinew-lab` as a user meets it: exit codes, and what goes to stdout and stderr.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn sinew_lab(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sinew-lab")).args(arguments).output().unwrap()
}

fn check(arguments: &[&str], code: i32, stdout: &str, stderr: &str) {
    let output = sinew_lab(arguments);
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
fn a_bench_writes_one_report_in_all_its_forms() {
    let folder = file("bench");
    let out = folder.display().to_string();
    let output =
        sinew_lab(&["bench", "kernels", "--quick", "--tets", "200", "--json", "--out", &out]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let text = std::fs::read_to_string(folder.join("report.json")).unwrap();
    assert_eq!(printed, serde_json::from_str::<serde_json::Value>(&text).unwrap());
    assert_eq!(printed["schema"], "sinew-bench/2");
    for row in printed["kernels"]["rows"].as_array().unwrap() {
        // every speed has its error, its precision and its threads
        let bound = if row["precision"] == "f32" { 1e-3 } else { 1e-10 };
        assert!(row["error"].as_f64().unwrap() < bound, "{row}");
        assert!(row["ns_per_tet"]["median"].as_f64().unwrap() > 0.0, "{row}");
        assert!(row["threads"].as_u64().unwrap() > 0, "{row}");
    }
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("multiply-add"));
    let csv = std::fs::read_to_string(folder.join("kernels.csv")).unwrap();
    assert!(csv.starts_with("kernel,quantity,model,tets"));
    assert!(folder.join("readme.md").exists() && folder.join("kernels-f64.svg").exists());
}

#[test]
fn hard_cases_print_a_table_and_write_a_page() {
    let page = file("stability.html").display().to_string();
    let one = ["bench", "stability", "--case", "gravity not finite"];
    let arguments = [&one[..], &["--html", &page]].concat();
    check(&arguments, 0, "1 of 1 required cases passed", "written to");
    assert!(std::fs::read_to_string(&page).unwrap().contains("bad input"));
    let json = sinew_lab(&[&one[..], &["--json", "-"]].concat());
    let value: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(value["schema"], "sinew-stability/3");
    assert_eq!(value["rows"][0]["status"], "pass");
    check(&["bench", "stability", "--group", "15"], 1, "", "1 to 14");
    check(&["bench", "stability", "--integrator", "quasi-static"], 1, "", "equilibria");
    check(&["stability"], 2, "", "Usage");
}

#[test]
fn steps_with_contact_stand_beside_those_without() {
    let arguments = ["bench", "contact", "--quick", "--tets", "24", "--json", "--case", "far"];
    let output = sinew_lab(&[&arguments[..], &["--case", "slow, smooth"]].concat());
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let table = &value["tables"][0];
    let column = |name: &str| table["columns"].as_array().unwrap().iter().position(|c| c == name);
    let [kind, ms, force, points, off] =
        ["kind", "with ms", "force N", "points", "off bdf2 %"].map(|name| column(name).unwrap());
    let rows = table["rows"].as_array().unwrap();
    assert!(rows.iter().all(|r| r[ms].as_f64() > Some(0.0)), "{rows:?}");
    let [far, near] =
        ["far", "slow, smooth"].map(|name| rows.iter().find(|r| r[kind] == name).unwrap());
    assert_eq!((far[force].as_f64(), far[points].as_u64()), (Some(0.0), Some(0)));
    assert!(near[force].as_f64() > Some(0.1) && near[off].as_f64() > Some(0.0), "{near}");
    let aim = value["aims"].as_array().unwrap().last().unwrap();
    assert!(aim["limit"] == 1.5 && aim["what"].as_str().unwrap().contains("slow, smooth"), "{aim}");
    check(&["bench", "contact", "--case", "nothing"], 1, "", "choose from `far`");
}

#[test]
fn bad_bench_arguments_are_named() {
    check(&["bench"], 2, "", "Usage");
    check(&["bench", "everything"], 2, "", "'everything'");
    check(&["bench", "--help"], 0, "kernels", "");
    check(&["bench", "kernels", "--tets", "3"], 1, "", "between 24 and");
    check(&["bench", "accuracy", "--quick", "--case", "fold"], 1, "", "cantilever");
    check(&["bench", "accuracy", "--quick", "--case", "fold"], 1, "", "liver pull, elements");
    check(&["run", "liver.toml"], 2, "", "Usage");
    // each command names the other
    check(&["--help"], 0, "cargo run --release`", "");
}
