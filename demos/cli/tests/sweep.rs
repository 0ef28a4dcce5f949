//! `sinew sweep`: the same table for every division of the runs, and after every death of a process.

use crate::common;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

fn sinew(arguments: &[&str]) -> Output {
    common::sinew(&[&["sweep"][..], arguments].concat())
}

fn check(arguments: &[&str], code: i32, stdout: &str, stderr: &str) -> String {
    common::check(&[&["sweep"][..], arguments].concat(), code, stdout, stderr)
}

/// An empty folder.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sweep").join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// An octahedron around a vertex: eight tetrahedra.
const OCTAHEDRON: &str = "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 7 double\n\
    0 0 0  0.1 0 0  -0.1 0 0  0 0.1 0  0 -0.1 0  0 0 0.1  0 0 -0.1\nCELLS 8 40\n\
    4 0 1 3 5\n4 0 3 2 5\n4 0 2 4 5\n4 0 4 1 5\n4 0 3 1 6\n4 0 2 3 6\n4 0 4 2 6\n4 0 1 4 6\n\
    CELL_TYPES 8\n10\n10\n10\n10\n10\n10\n10\n10\n";

const SCENE: &str = r#"
    name = "octahedron"
    dt = 0.01
    duration = 0.05
    [[body]]
    name = "ball"
    mesh = "octahedron.vtk"
    material = { young_modulus = 8e3, poisson_ratio = 0.4, density = 1000.0 }
    [[constraint]]
    name = "top"
    select = { vertices = [5] }
    [[probe]]
    name = "below"
    select = { vertices = [6] }
    record = ["mean_displacement", "min_j"]
"#;

/// A scene of eight tetrahedra and five steps, and a study of it.
fn study(folder: &Path, study: &str) -> PathBuf {
    std::fs::write(folder.join("octahedron.vtk"), OCTAHEDRON).unwrap();
    std::fs::write(folder.join("octahedron.toml"), SCENE).unwrap();
    let path = folder.join("study.toml");
    std::fs::write(&path, format!("scene = \"octahedron.toml\"\n{study}")).unwrap();
    path
}

const THOUSAND: &str = r#"
    sampling = { kind = "latin-hypercube", runs = 1000, seed = 7 }
    [parameters]
    "body.0.material.young_modulus" = { min = 2e3, max = 2e5, scale = "log" }
    "body[0].material.poisson_ratio" = { min = 0.2, max = 0.53 }
    "solver.integrator" = ["safe", "auto"]
"#;

fn planned(name: &str, of: &str) -> (PathBuf, String) {
    let folder = folder(name);
    let out = text(&folder.join("S")).to_string();
    check(&["plan", text(&study(&folder, of)), "--out", &out], 0, "runs planned", "");
    (folder, out)
}

/// A parameter that changes nothing would fill a table with noise.
#[test]
fn parameters_without_effect_are_refused_by_name() {
    let grid = |key: &str| format!("sampling = {{ kind = \"grid\" }}\n[parameters]\n{key}\n");
    let refused = |name: &str, scene: &str, of: &str, words: &[&str]| {
        let folder = folder(name);
        let study = study(&folder, of);
        std::fs::write(folder.join("octahedron.toml"), scene).unwrap();
        let out = text(&folder.join("S")).to_string();
        words
            .iter()
            .for_each(|word| drop(check(&["plan", text(&study), "--out", &out], 1, "", word)));
    };
    let young = grid("\"body.ball.material.young_modulus\" = [2e3, 4e3]");
    let of_field = SCENE.replace("young_modulus = 8e3", "young_modulus_field = \"stiff\"");
    refused("field", &of_field, &young, &["young_modulus_field", "cannot be swept", "study.toml"]);
    let tolerance = grid("\"solver.newton_tolerance\" = [1e-6, 1e-8]");
    refused(
        "idle",
        SCENE,
        &tolerance,
        &["it has no effect", "does not iterate", "newton_tolerance"],
    );
    // with an integrator for which it counts it is a parameter
    planned("counts", &(tolerance + "\"solver.integrator\" = [\"safe\", \"newton\"]\n"));
}

/// What the study spreads evenly is drawn evenly, whatever it spans, and what it spreads by logarithms is not.
#[test]
fn plots_have_the_scale_of_the_study_and_round_ticks() {
    let of = r#"
        sampling = { kind = "latin-hypercube", runs = 6, seed = 1 }
        [parameters]
        "body.0.material.young_modulus" = { min = 4e3, max = 2.2e4, scale = "log" }
        "body.0.material.density" = { min = 100.0, max = 2000.0 }
    "#;
    let (_, sweep) = planned("scales", of);
    check(&["run", &sweep], 0, "6 runs", "");
    table(&sweep);
    let page = std::fs::read_to_string(Path::new(&sweep).join("sweep.html")).unwrap();
    assert!(page.contains("young_modulus (log)") && !page.contains("density (log)"), "{page}");
    for tick in [">5000<", ">10000<", ">500<", ">1000<", ">1500<"] {
        assert!(page.contains(tick), "{tick}: {page}");
    }
}

/// The table of a sweep that is done.
fn table(sweep: &str) -> String {
    let code = sinew(&["merge", sweep]).status.code();
    assert!(matches!(code, Some(0 | 3)), "{code:?}");
    std::fs::read_to_string(Path::new(sweep).join("table.csv")).unwrap()
}

#[test]
#[ignore = "slow"]
fn a_thousand_runs_give_one_table_for_any_shards_jobs_and_deaths() {
    let mut first: Option<String> = None;
    for (shards, jobs) in [(1, "1"), (1, "2"), (3, "1"), (3, "2"), (7, "1"), (7, "2")] {
        let (_, sweep) = planned(&format!("thousand_{shards}_{jobs}"), THOUSAND);
        // in any order
        for shard in (0..shards).rev() {
            let shard = format!("{shard}/{shards}");
            // Poisson's ratios from 0.5 up are rows that failed
            check(&["run", &sweep, "--shard", &shard, "--jobs", jobs], 3, "failed", "");
        }
        let table = table(&sweep);
        assert_eq!(*first.get_or_insert(table.clone()), table, "{shards} shards, {jobs} jobs");
    }
    let table = first.unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|row| row.split(',').collect()).collect();
    assert_eq!(rows.len(), 1000);
    assert!(rows.iter().enumerate().all(|(i, row)| row[0] == i.to_string()));
    let ids: std::collections::HashSet<&str> = rows.iter().map(|row| row[1]).collect();
    assert_eq!(ids.len(), 1000);
    let failed = rows.iter().filter(|row| row[5] == "failed").count();
    // the share of the range above 0.4999 is 30.1 in 330, and a hypercube meets it to one run
    assert!((90..=92).contains(&failed), "{failed}");
    assert_eq!(rows.iter().filter(|row| row[5] == "ok").count(), 1000 - failed);

    // killed at five moments
    let (_, sweep) = planned("thousand_killed", THOUSAND);
    let mut seed = u64::from(std::process::id());
    for _ in 0..5 {
        let mut run = Command::new(env!("CARGO_BIN_EXE_sinew"))
            .args(["sweep", "run", &sweep, "--jobs", "2", "--quiet"])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        std::thread::sleep(Duration::from_millis(60 + (seed >> 33) % 240));
        run.kill().unwrap();
        run.wait().unwrap();
    }
    check(&["run", &sweep, "--jobs", "2"], 3, "1000 runs", "");
    check(&["status", &sweep, "--json"], 3, "\"missing\": 0", "");
    assert_eq!(self::table(&sweep), table);
    // nothing is left to do, and doing it again changes nothing
    check(&["run", &sweep, "--shard", "2/3"], 3, "333 runs, 333 of them before", "");
    let claims = std::fs::read_dir(Path::new(&sweep).join("claims")).unwrap().count();
    assert!(claims >= 3, "{claims}");
}

#[test]
fn what_was_cut_off_is_done_again_and_what_differs_is_told() {
    let (_, sweep) =
        planned("torn", "[parameters]\n\"body.ball.material.young_modulus\" = [4e3, 8e3]\n");
    check(&["merge", &sweep], 1, "", "2 of 2 runs have no result yet");
    check(&["merge", &sweep, "--partial"], 0, "2 missing", "");
    check(&["run", &sweep], 0, "2 runs, 0 of them before, 0 failed", "");
    let whole = table(&sweep);
    assert_eq!(whole.lines().filter(|row| row.contains(",ok,")).count(), 2);
    let shard = Path::new(&sweep).join("shards/0-of-1.1.jsonl");
    let lines = std::fs::read(&shard).unwrap();
    std::fs::write(&shard, &lines[..lines.len() - 9]).unwrap();
    check(&["status", &sweep], 0, "1 lines are not whole", "");
    check(&["run", &sweep], 0, "2 runs, 1 of them before", "");
    assert_eq!(table(&sweep), whole);
    // the same results twice are one; others are an error
    std::fs::write(Path::new(&sweep).join("shards/0-of-2.1.jsonl"), &lines).unwrap();
    assert_eq!(table(&sweep), whole);
    let (_, other) =
        planned("torn_other", "[parameters]\n\"body.0.material.young_modulus\" = [4e3]\n");
    check(&["run", &other], 0, "", "");
    std::fs::copy(&shard, Path::new(&other).join("shards/0-of-3.1.jsonl")).unwrap();
    check(&["status", &other], 0, "results are of runs that are not in the plan", "");
    // the plan's parameter is spelled otherwise, its id is not that of the first sweep
    let manifest = Path::new(&sweep).join("manifest.jsonl");
    let text = std::fs::read_to_string(&manifest).unwrap();
    std::fs::write(&manifest, text.replace("8000.0", "9000.0")).unwrap();
    check(&["run", &sweep], 1, "", "its manifest is damaged");
}

#[test]
fn a_scene_or_mesh_that_changed_is_refused() {
    let list = "[parameters]\n\"body.0.material.young_modulus\" = [4e3, 8e3]\n";
    let (folder, sweep) = planned("changed", list);
    let mesh = folder.join("octahedron.vtk");
    std::fs::write(&mesh, OCTAHEDRON.replace("0.1 0 0", "0.11 0 0")).unwrap();
    check(&["run", &sweep], 1, "", "octahedron.vtk: changed since the sweep was planned");
    std::fs::write(&mesh, OCTAHEDRON).unwrap();
    check(&["run", &sweep], 0, "0 failed", "");
    std::fs::write(folder.join("octahedron.toml"), SCENE.replace("0.05", "0.06")).unwrap();
    check(&["run", &sweep], 1, "", "octahedron.toml: changed since the sweep was planned");
    // another plan in the same folder keeps what is the same run
    std::fs::write(folder.join("octahedron.toml"), SCENE).unwrap();
    let more =
        study(&folder, "[parameters]\n\"body.0.material.young_modulus\" = [2e3, 4e3, 8e3]\n");
    check(&["plan", text(&more), "--out", &sweep], 0, "3 runs", "");
    check(&["run", &sweep], 0, "3 runs, 2 of them before", "");
    // both can be moved together, and a mesh that only some runs read is watched as well
    let bigger = OCTAHEDRON.replace("0.1", "0.2");
    std::fs::write(folder.join("bigger.vtk"), &bigger).unwrap();
    let meshes =
        study(&folder, "[parameters]\n\"body.0.mesh\" = [\"octahedron.vtk\", \"bigger.vtk\"]\n");
    let sweep = folder.join("meshes");
    check(&["plan", text(&meshes), "--out", text(&sweep)], 0, "2 runs", "");
    std::fs::write(folder.join("bigger.vtk"), bigger.replace("0.2 0 0", "0.3 0 0")).unwrap();
    check(&["run", text(&sweep)], 1, "", "bigger.vtk: changed");
    std::fs::write(folder.join("bigger.vtk"), &bigger).unwrap();
    let moved = folder.with_file_name("changed_and_moved");
    let _ = std::fs::remove_dir_all(&moved);
    std::fs::rename(&folder, &moved).unwrap();
    check(&["run", text(&moved.join("meshes"))], 0, "2 runs", "");
}

#[test]
fn results_are_last_values_extremes_or_all_rows() {
    let of = |kept: &str| {
        format!("[parameters]\n\"dt\" = [0.01, 0.005]\n[results]\nprobes = \"{kept}\"\n")
    };
    let (_, sweep) = planned("kept_max", &of("max"));
    check(&["run", &sweep], 0, "", "");
    let columns = table(&sweep);
    assert!(
        columns.contains("min below.mean_displacement_z (m),max below.mean_displacement_z (m)")
    );
    let (_, sweep) = planned("kept_all", &of("all"));
    check(&["run", &sweep], 0, "", "");
    let rows = table(&sweep);
    let runs: Vec<Vec<&str>> = rows.lines().skip(1).map(|row| row.split(',').collect()).collect();
    for (run, steps) in runs.iter().zip([5, 10]) {
        let path = Path::new(&sweep).join(format!("runs/{}.csv", run[1]));
        let all = std::fs::read_to_string(&path).unwrap();
        assert_eq!(all.lines().count(), 2 + steps, "{all}");
        // the last row is what the table says
        let last: Vec<f64> =
            all.lines().last().unwrap().split(',').skip(2).map(|x| x.parse().unwrap()).collect();
        let told: Vec<f64> = run[run.len() - 4..].iter().map(|x| x.parse().unwrap()).collect();
        assert_eq!(last, told);
        assert!(told[2] < 0.0, "it hangs: {told:?}");
    }
    // a file that was lost makes its run undone
    std::fs::remove_file(Path::new(&sweep).join(format!("runs/{}.csv", runs[1][1]))).unwrap();
    check(&["run", &sweep], 0, "2 runs, 1 of them before", "");
    assert_eq!(table(&sweep), rows);
}

#[test]
fn failures_are_rows_with_their_text_and_lists_are_read() {
    let folder = folder("failures");
    let rows = "body.0.material.poisson_ratio,solver.integrator\n0.3,safe\n0.7,\n,auto\n";
    std::fs::write(folder.join("runs.csv"), rows).unwrap();
    let path = study(&folder, "list = \"runs.csv\"\n");
    let sweep = folder.join("S");
    check(&["plan", text(&path), "--out", text(&sweep)], 0, "3 runs", "");
    check(&["run", text(&sweep)], 3, "3 runs, 0 of them before, 1 failed", "");
    let first = table(text(&sweep));
    let failed: Vec<&str> = first.lines().filter(|row| row.contains(",failed,")).collect();
    assert!(failed.len() == 1 && failed[0].contains("octahedron.toml"), "{first}");
    assert!(failed[0].contains("0.7") && !failed[0].contains(text(&folder)), "{first}");
    // tried again the failure is the same, and counts once
    check(&["run", text(&sweep), "--retry"], 3, "3 runs, 2 of them before, 1 failed", "");
    assert_eq!(table(text(&sweep)), first);
    let page = std::fs::read_to_string(sweep.join("sweep.html")).unwrap();
    assert!(page.contains("<b>1 run</b>") && page.contains("poisson_ratio = 0.7"));
    assert!(page.contains("<svg") && !page.contains("http"), "a page that needs nothing else");
}

#[test]
fn every_bad_study_is_an_error_that_says_where_and_what_to_do() {
    let folder = folder("bad");
    let young = "\"body.0.material.young_modulus\"";
    let grid = |text: &str| format!("[parameters]\n{text}\n");
    let cube = |n: &str, text: &str| {
        format!("sampling = {{ kind = \"latin-hypercube\", runs = {n} }}\n[parameters]\n{text}\n")
    };
    let cases = [
        ("[parameters".to_string(), "line 2"),
        ("colour = 3\n".to_string(), "unknown field `colour`"),
        (String::new(), "nothing is swept"),
        (
            grid("\"body.0.material.young\" = [1e3]"),
            "has no key `young`; did you mean `young_modulus`",
        ),
        (grid("\"body.1.material.density\" = [1e3]"), "1 entries and no `1`"),
        (grid("\"body.liver.material.density\" = [1e3]"), "no `liver`"),
        (grid("\"dt.x\" = [1e3]"), "`dt` holds nothing that could be called `x`"),
        (grid("\"threads\" = [1, 2]"), "cannot be swept"),
        (grid("\"probe.0.name\" = [\"a\"]"), "the same probes"),
        (grid(&format!("{young} = []")), "the list is empty"),
        (grid(&format!("{young} = [inf]")), "not finite"),
        (grid(&format!("{young} = [\"stiff\"]")), "expected f64"),
        (grid(&format!("{young} = [4e3, 4e3]")), "runs 0 and 1 are the same"),
        (grid(&format!("{young} = 1979-05-27")), "a date"),
        (
            grid(&format!("{young} = [1e3]\n\"body[0].material.young_modulus\" = [1e3]")),
            "the same key as",
        ),
        (grid(&format!("{young} = {{ min = 1.0, max = 2.0 }}")), "without a `count`"),
        (grid("body.0.material.young_modulus = [4e3]"), "stands in quotes"),
        (grid("sampling = \"grid\""), "before [parameters]"),
        (cube("0", &format!("{young} = {{ min = 1.0, max = 2.0 }}")), "0 runs; make it 1 to"),
        (cube("5", &format!("{young} = {{ min = 2.0, max = 1.0 }}")), "the smaller one first"),
        (
            cube("5", &format!("{young} = {{ min = 0.0, max = 1.0, scale = \"log\" }}")),
            "both ends positive",
        ),
        (
            cube("5", &format!("{young} = {{ min = 1.0, max = 2.0, count = 3 }}")),
            "`count` belongs to a grid",
        ),
        ("sampling = { kind = \"sobol\" }\n".to_string(), "unknown variant `sobol`"),
        (grid(&format!("{young} = [1e3]\n[results]\nprobes = \"mean\"")), "unknown variant `mean`"),
        (
            "list = \"runs.csv\"\nsampling = { kind = \"grid\" }\n".to_string(),
            "the list gives all values",
        ),
        ("list = \"nowhere.csv\"\n".to_string(), "nowhere.csv"),
        ("list = \"short.csv\"\n".to_string(), "short.csv, line 3, `list`: 1 cells in a row"),
        ("list = \"empty.csv\"\n".to_string(), "there is no row"),
        ("list = \"unknown.csv\"\n".to_string(), "unknown.csv, line 1, `grav`"),
    ];
    std::fs::write(folder.join("short.csv"), "dt,duration\n0.01,0.1\n0.02\n").unwrap();
    std::fs::write(folder.join("empty.csv"), "dt\n").unwrap();
    std::fs::write(folder.join("unknown.csv"), "grav\n1\n").unwrap();
    let out = folder.join("S");
    for (case, message) in cases {
        check(&["plan", text(&study(&folder, &case)), "--out", text(&out)], 1, "", message);
        assert!(!out.exists(), "{case}");
    }
    let path = folder.join("nowhere.toml");
    check(&["plan", text(&path), "--out", text(&out)], 1, "", "nowhere.toml");
    std::fs::write(&path, "scene = \"gone.toml\"").unwrap();
    check(&["plan", text(&path), "--out", text(&out)], 1, "", "gone.toml");
    check(&["run", text(&out)], 1, "", "sinew sweep plan STUDY.toml --out");
    check(&["run", text(&out), "--shard", "3/3"], 2, "", "for example 3/40");
    check(&["merge", text(&out)], 1, "", "manifest.jsonl");
}

#[test]
fn a_script_for_slurm_names_the_shards_of_its_array() {
    let (_, sweep) = planned("slurm", "[parameters]\n\"dt\" = [0.01, 0.005]\n");
    let script = check(&["slurm", &sweep, "--array", "40", "--per-task", "32"], 0, "", "");
    assert!(script.contains("#SBATCH --array=0-39\n") && script.contains("--cpus-per-task=32\n"));
    check(&["slurm", &sweep, "--array", "0"], 1, "", "0 tasks");
    // the script does what it says where an array is but a variable
    let bin = Path::new(env!("CARGO_BIN_EXE_sinew")).parent().unwrap();
    let path = Path::new(&sweep).join("job.sh");
    std::fs::write(&path, script.replace("srun ", "")).unwrap();
    for task in ["0", "1", "39"] {
        let paths = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default());
        let output = Command::new("bash")
            .arg(&path)
            .env("PATH", paths)
            .env("SLURM_ARRAY_TASK_ID", task)
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
    }
    assert_eq!(table(&sweep).lines().count(), 3);
}

/// An engine that distributes, with one of its workers killed in the middle; `python3` on the path decides.
#[allow(clippy::print_stderr, reason = "a test that cannot run says so")]
fn engine(module: &str, name: &str) {
    let known = Command::new("python3").args(["-c", &format!("import {module}")]).output();
    if !known.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: python3 has no {module}");
        return;
    }
    let (folder, sweep) = planned(name, THOUSAND);
    check(&["run", &sweep], 3, "", "");
    let (_, other) = planned(&format!("{name}_engine"), THOUSAND);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new("python3")
        .arg(root.join("tests/sweep_killed.py"))
        .args([name, &other, "8"])
        .env("SINEW", env!("CARGO_BIN_EXE_sinew"))
        .current_dir(&folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("killed a worker"), "{output:?}");
    assert_eq!(table(&other), table(&sweep));
}

#[test]
fn dask_makes_the_same_table_though_a_worker_is_killed() {
    engine("dask.distributed", "sweep_dask");
}

#[test]
fn ray_makes_the_same_table_though_a_worker_is_killed() {
    engine("ray", "sweep_ray");
}
