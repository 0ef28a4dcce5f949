//! The command as a user meets it: exit codes, and what goes to stdout and stderr.

use crate::common::{check, sinew};
use std::path::{Path, PathBuf};
use std::process::Command;

fn shipped(name: &str) -> String {
    sinew_scene::shipped_scene(name).display().to_string()
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
    check(&["run", &shipped("liver"), "--integrator", "magic"], 2, "", "newton");
    // each command names the other
    check(
        &["bench", "kernels", "--quick"],
        2,
        "",
        "`sinew-lab`: cargo run --release -p sinew-benches -- bench",
    );
    check(&["--help"], 0, "sinew-lab", "");
}

/// A report in a few lines, the verdict and the warnings first; `-v` tells all.
#[test]
fn a_report_begins_with_what_matters() {
    let liver = shipped("liver");
    let brief = check(&["run", &liver, "--steps", "3"], 0, "", "");
    let lines: Vec<&str> = brief.lines().collect();
    assert!(lines[0].starts_with("liver: 30.0 ms simulated in"), "{brief}");
    assert_eq!(&lines[1..4], ["", "Warnings", "  none"], "{brief}");
    assert!(
        brief.contains("tool.mean_displacement (m)") && !brief.contains("state hash"),
        "{brief}"
    );
    assert!(lines.len() < 32, "{brief}");
    let whole = check(&["run", &liver, "--steps", "3", "-v"], 0, "state hash", "");
    assert!(whole.contains("time per system") && whole.contains("linearisation"), "{whole}");
    // a sheet has no volume
    let drum = std::fs::read_to_string(shipped("membrane_drum")).unwrap();
    let sheet = drum.split("[[body]]").take(2).collect::<Vec<_>>().join("[[body]]");
    let path = file("sheet_alone.toml");
    std::fs::write(&path, sheet.replace("duration = 1.5", "duration = 0.01")).unwrap();
    let sheet = check(&["run", path.to_str().unwrap()], 0, "there are no solid elements", "");
    assert!(!sheet.contains("inf"), "{sheet}");
}

/// A scene that cannot be built leaves a folder alone, and says of what its files are.
#[test]
fn a_folder_of_an_earlier_run_is_not_taken_for_that_of_one_that_failed() {
    let out = file("earlier").display().to_string();
    let _ = std::fs::remove_dir_all(&out);
    let path = file("earlier.toml");
    let scene = std::fs::read_to_string(shipped("cantilever")).unwrap();
    std::fs::write(&path, &scene).unwrap();
    let path = path.display().to_string();
    check(&["run", &path, "--steps", "1", "--out", &out], 0, "", "");
    std::fs::write(&path, scene.replace("\"x0\"", "\"x9\"")).unwrap();
    check(&["run", &path, "--out", &out], 1, "", "is of an earlier run");
    let _ = std::fs::remove_dir_all(&out);
    let told = sinew(&["run", &path, "--out", &out]);
    assert!(!String::from_utf8_lossy(&told.stderr).contains("earlier run"));
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

/// Forces of first order are none of those that were asked for.
#[test]
fn a_run_whose_contact_did_not_converge_fails_and_says_so() {
    let text = r#"
        name = "laid"
        dt = 0.01
        duration = 0.2
        [solver]
        integrator = "newton"
        max_newton_iterations = 3
        [[body]]
        name = "block"
        generate = { box = { size = [0.1, 0.1, 0.03], cells = [6, 6, 2] } }
        material = { young_modulus = 2e4, poisson_ratio = 0.4, density = 1000.0 }
        [[body]]
        name = "ball"
        generate = { sphere = { radius = 0.02, shells = 3 } }
        translate = [0.05, 0.05, 0.0502]
        material = { young_modulus = 2e4, poisson_ratio = 0.4, density = 1000.0 }
        [[constraint]]
        name = "floor"
        body = "block"
        select = { group = "z0" }
        [[contact]]
        name = "pair"
        bodies = ["block", "ball"]
        friction = 0.3
    "#;
    let path = file("laid.toml");
    std::fs::write(&path, text).unwrap();
    let path = path.display().to_string();
    let out = check(&["run", &path], 1, "NOT TO BE TRUSTED", "of them with something in contact");
    let remedy = "use integrator = \"auto\" or \"safe\", or a smaller dt";
    assert!(out.contains("run.newton.contact") || out.contains(remedy), "{out}");
    check(&["run", &path, "--integrator", "safe"], 0, "", "");
}

#[test]
fn checks_and_meshes() {
    check(&["check", &shipped("crush")], 0, "can be simulated", "");
    check(&["check", &shipped("crush"), "--json"], 0, "\"sinew-check/1\"", "");
    let out = file("box.vtu").display().to_string();
    let size = ["mesh", "generate", "box", "--size", "0.1", "0.2", "0.3", "--cells", "1", "2", "3"];
    check(&[&size[..], &["-o", &out]].concat(), 0, "tetrahedra  36", "");
    let bone = file("bone.msh").display().to_string();
    let shape = ["mesh", "generate", "specimen", "--width", "0.01", "--cells", "32", "4"];
    check(&[&shape[..], &["--sheet", "quads", "--out", &bone]].concat(), 0, "grip1", "");
    let commas = ["--cells", "8,2,1", "--thickness", "0.01", "--solid", "irregular", "-o", &bone];
    check(&[&shape[..5], &commas].concat(), 0, "tetrahedra  96", "");
    check(&[&shape[..3], &["-o", &bone]].concat(), 2, "", "--width");
    check(&[&shape[..5], &["--cells", "3", "-o", &bone]].concat(), 1, "", "specimen");
    check(&["mesh", "generate"], 2, "", "balloon");
    let msh = file("box.msh").display().to_string();
    check(&["mesh", "convert", &out, &msh, "--scale", "0.5"], 0, "written to", "");
    check(&["mesh", "info", &msh, "--json"], 0, "\"tetrahedra\": 36", "");
    let stp = file("box.stp").display().to_string();
    check(&["mesh", "convert", &out, &stp], 1, "", ".vtu");
}

#[test]
fn advice_can_be_followed_and_impossible_requests_fail() {
    let scene = file("advise.toml");
    let text = r#"
        name = "small"
        dt = 0.02
        duration = 0.1
        [[body]]
        name = "beam"
        generate = { box = { size = [0.1, 0.05, 0.05], cells = [2, 1, 1] } }
        material = { young_modulus = 2e5, poisson_ratio = 0.4, density = 1000.0 }
        [[constraint]]
        name = "clamp"
        select = { group = "x0" }
    "#;
    std::fs::write(&scene, text).unwrap();
    let scene = scene.display().to_string();
    let output = sinew(&["advise", &scene, "--budget", "1s", "--error", "3%"]);
    let advice = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && advice.contains("Recommended"), "{advice}");
    let command = advice.lines().find_map(|l| l.trim().strip_prefix("sinew ")).unwrap();
    let mut words: Vec<&str> = command.split_whitespace().collect();
    words.push("--quiet");
    assert!(sinew(&words).status.success(), "{command}");
    check(&["advise", &scene, "--budget", "1us", "--error", "3%"], 1, "CANNOT be met", "");
    check(&["advise", &scene, "--budget", "16", "--error", "3%"], 2, "", "16ms");
    check(&["advise", &scene, "--budget", "16ms", "--error", "3"], 2, "", "percentage");
    check(&["advise", "nowhere.toml", "--budget", "16ms", "--error", "3%"], 1, "", "nowhere");
}

#[test]
fn a_scene_is_fitted_to_data() {
    let scene = shipped("fit_bar");
    let data = scene.replace(".toml", ".csv");
    let fit = ["fit", "--data", &data, "--fit", "young", "--fit", "poisson", &scene];
    check(&fit, 0, "95 % within", "");
    let output = sinew(&[&fit[..], &["--json"]].concat());
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(value["schema"], "sinew-fit-data/1");
    assert_eq!(value["converged"], true);
    let liver = shipped("liver");
    let dynamic = ["fit", "--data", &data, "--fit", "young", &liver];
    check(&dynamic, 1, "", "mode = \"static\"");
    check(&["fit", "--data", &data, &scene], 2, "", "--fit");
    check(&["fit", "--data", "nowhere.csv", "--fit", "young", &scene], 1, "", "nowhere.csv");
}

#[test]
fn a_fit_reports_writes_and_names_what_is_wrong() {
    let mesh = file("fit.msh").display().to_string();
    let size = ["--size", "0.06", "0.02", "0.02", "--cells", "3", "1", "1"];
    let shape = ["mesh", "generate", "box", "--elements", "hexahedra", "-o", &mesh];
    check(&[&shape[..], &size[..]].concat(), 0, "written to", "");
    let fit = ["fit", &mesh, "--young", "1e4", "--poisson", "0.3"];
    let with = |more: &[&'static str]| [&fit[..], more].concat();
    check(&with(&[]), 0, "central springs cannot hold a free Poisson's ratio", "");
    check(&with(&["--element-method", "block"]), 0, "element_method = \"block\"", "");
    check(&with(&["--to", "body"]), 0, "the assembled stiffness", "");
    let shared = ["--to", "forces", "--sharing", "moduli", "--amplitudes", "0.1,0.2"];
    check(&with(&shared), 0, "Pa, edge of a hexahedron", "");
    check(&with(&["--sharing", "moduli"]), 1, "", "--to body");
    check(&with(&["--to", "forces", "--amplitudes", "-0.1"]), 1, "", "an amplitude is -0.1");
    check(&with(&["--element-method", "paper-a"]), 1, "", "now called `delingette`");
    let output = sinew(&with(&["--json", "--element-method", "nonnegative"]));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&value["schema"], &value["method"]),
        (&"sinew-body/1".into(), &"nonnegative".into())
    );
    assert_eq!(value["report"]["negative_edges"], 0);
    assert_eq!(value["assessment"]["tests"].as_array().unwrap().len(), 4);
    assert!(value["assessment"]["moduli"]["young_modulus"].as_f64().unwrap() > 0.0);
    assert_eq!(value["masses"].as_array().unwrap().len(), 16);
    let body = file("fit.csv").display().to_string();
    check(&[&with(&["--out"])[..], &[&body]].concat(), 0, "e_rms %", "written to");
    assert!(std::fs::read_to_string(&body).unwrap().starts_with("record,first,second,value"));
    check(&with(&["--element-method", "lloyd"]), 1, "", "hexahedron 0");
    check(&with(&["--element-method", "best"]), 2, "", "two-norm");
    check(&with(&["--held", "foot"]), 1, "", "no group `foot`");
    check(&with(&["--out", "body.txt"]), 1, "", ".json or .csv");
    check(&["fit", &mesh, "--young", "1e4", "--poisson", "0.5"], 1, "", "Poisson");
    check(&["fit", "nowhere.msh", "--young", "1e4", "--poisson", "0.3"], 1, "", "nowhere.msh");
}

#[test]
fn a_run_leaves_a_page_in_every_build() {
    let (bar, path) = (shipped("fibre_bar"), file("page.html").display().to_string());
    check(&["run", &bar, "--steps", "4", "--page", &path], 0, &path, "");
    let page = std::fs::read_to_string(&path).unwrap();
    assert!(page.contains("<canvas>") && page.contains("\"name\":\"strain\""), "a player");
    // before the run, not after it
    check(&["run", &bar, "--page", "no/such/folder/a.html"], 1, "", "no/such/folder");
    check(&["run", &bar, "--page", &path, "--resume"], 2, "", "--resume");
    check(&["run", &bar, "--page", &path, "--no-page"], 2, "", "--no-page");
    // beside the files, or in `out`, unless nobody is told of it
    let folder = file("pages");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
        command.args(["run", &bar, "--steps", "2"]).args(more).current_dir(&folder);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let pages = || ["out", "x"].map(|sub| folder.join(sub).join("fibre_bar.html").exists());
    for none in [&["--no-page"][..], &["--quiet"], &["--json", "-"], &["--no-page", "--out", "x"]] {
        run(none);
        assert_eq!(pages(), [false; 2], "{none:?}");
    }
    let told = run(&[]);
    let last = told
        .lines()
        .rev()
        .take(3)
        .any(|line| line.trim().starts_with("out/fibre_bar.html (open in"));
    assert!(last, "{told}");
    run(&["--out", "x", "--quiet"]);
    assert_eq!(pages(), [true; 2]);
    // one of an earlier run does not stay
    run(&["--out", "x", "--no-page"]);
    assert_eq!(pages(), [true, false]);
    // a page that nobody asked for does not fail a run
    std::fs::remove_dir_all(folder.join("out")).unwrap();
    std::fs::write(folder.join("out"), "no folder").unwrap();
    assert!(run(&[]).contains("--no-page"));
    #[cfg(not(feature = "render"))]
    check(&["render", &bar, "--png", "x"], 1, "", "--features sinew-cli/render");
}

/// All mistakes of a scene, each with its line and a mark; what editors ask for.
#[test]
fn mistakes_and_schema() {
    let path = file("mistaken.toml").display().to_string();
    let text = std::fs::read_to_string(shipped("cantilever")).unwrap();
    let text = text.replace("\"x0\"", "\"x9\"").replace("dt = 0.01", "dt = -0.01");
    std::fs::write(&path, &text).unwrap();
    check(&["run", &path], 1, "", "group = \"x9\"");
    let told = String::from_utf8(sinew(&["run", &path]).stderr).unwrap();
    assert_eq!(told.matches("error: ").count(), 2, "{told}");
    assert!(told.contains("dt = -0.01") && told.contains("^^^^"), "{told}");
    check(&["completions", "bash"], 0, "_sinew()", "");
    check(&["completions", "csh"], 2, "", "[possible values: bash");
    let schema = check(&["schema"], 0, "json-schema.org", "");
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    assert_eq!(schema["properties"]["tool"]["items"]["properties"]["radius"]["type"], "number");
}

#[test]
fn tissues_new_scenes_and_charts() {
    check(&["presets"], 0, "liver       5.00  0.450", "");
    let table = check(&["presets", "--markdown"], 0, "Palmeri et al. 2008", "");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/tissues.md");
    let page = std::fs::read_to_string(page).unwrap();
    assert!(
        page.ends_with(&table),
        "docs/tissues.md ends with what `sinew presets --markdown` prints"
    );
    let [mesh, scene, out] =
        ["organ.vtk", "organ.toml", "organ"].map(|name| file(name).display().to_string());
    let (_, _) = (std::fs::remove_file(&scene), std::fs::remove_dir_all(&out));
    let coarse =
        sinew_scene::scene_folder().join("../meshes/liver_coarse.msh").display().to_string();
    check(&["mesh", "convert", &coarse, &mesh], 0, "", "");
    check(&["new", "--mesh", &mesh, "--tissue", "bone"], 1, "", "known names: brain");
    check(&["new", "--mesh", &mesh, "--tissue", "kidney"], 0, &scene, "");
    check(&["new", "--mesh", &mesh], 1, "", "is there already; give --out FILE");
    assert!(std::fs::read_to_string(&scene).unwrap().contains("mesh = \"organ.vtk\""));
    check(&["run", &scene, "--steps", "120", "--out", &out, "--no-page"], 0, "ball.tool_force", "");
    let rows = format!("{out}/organ.csv");
    check(&["plot", &rows], 0, "organ.plot.html", "");
    check(&["plot", &rows, "--out", "x.png"], 2, "", ".svg or .html");
    check(&["plot", &rows, "--column", "magic"], 1, "", "ball.tool_depth (m)");
}

#[cfg(feature = "render")]
#[test]
fn render_writes_a_page_and_refuses_what_it_cannot_draw() {
    let (bar, page) = (shipped("fibre_bar"), file("fibre_bar.html"));
    let path = page.display().to_string();
    check(&["render", &bar, "--steps", "4", "--frames", "3", "--html", &path], 0, &path, "");
    let text = std::fs::read_to_string(&page).unwrap();
    assert!(text.contains("Fibre bar") && text.contains("\"time\":0.04"));
    check(&["render", &bar], 1, "", "--png DIR");
    check(&["render", &bar, "--png", "x", "--size", "huge"], 2, "", "WIDTHxHEIGHT");
    check(&["render", &bar, "--png", "x", "--camera", "up"], 2, "", "AZIMUTH");
    check(&["render", &bar, "--png", "x", "--color", "heat"], 2, "", "displacement");
    check(&["render", &bar, "--beside", "none.toml", "--png", "x"], 1, "", "none.toml");
    check(&["render", &bar, "--models", "svk,jelly", "--png", "x"], 2, "", "jelly");
    let adapter = ["render", &bar, "--png", "x", "--adapter", "no such adapter"];
    check(&adapter, 1, "", "graphics adapter");
    // what Mesa says of displays while it looks for adapters is no error
    let alone = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(adapter)
        .env_remove("XDG_RUNTIME_DIR")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&alone.stderr);
    assert!(said.contains("graphics adapter") && !said.contains("XDG_RUNTIME_DIR"), "{said}");
    check(&["render"], 2, "", "Usage");
    check(&["render", &bar], 1, "", "there is nothing to draw: give --html FILE");
    check(&["render", &bar, "--picture", "x.svg"], 1, "", "pictures are PNG");
    let late = ["render", &bar, "--picture", "x.png", "--at", "99", "--color", "J"];
    check(&late, 1, "", "--at: `99` is not understood; the scene runs from 0 to 2 s");
}

/// A run that takes long, its folder, and its first rows on the way.
#[cfg(unix)]
fn under_way(name: &str) -> (std::process::Child, PathBuf) {
    let (scene, out) = (file(&format!("{name}.toml")), file(name));
    let _ = std::fs::remove_dir_all(&out);
    let text = "name = \"long\"\ndt = 0.001\nduration = 1000.0\n[output]\nevery = 5\n[[body]]\nname = \"b\"\n\
                generate = { box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] } }\n\
                material = { preset = \"liver\" }\n[[constraint]]\nname = \"c\"\nselect = { group = \"x0\" }\n";
    std::fs::write(&scene, text).unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "--quiet", "--out"])
        .args([&out, &scene])
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let rows = || std::fs::read_to_string(out.join("long.csv")).unwrap_or_default();
    for _ in 0..600 {
        if rows().lines().count() > 20 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(rows().lines().count() > 20, "no rows after 12 s");
    (child, out)
}

#[cfg(unix)]
fn kill(child: &mut std::process::Child, signal: &str) -> Option<i32> {
    let killed = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    child.wait().unwrap().code()
}

/// Every frame that the index names is there and can be read, and every row is whole.
#[cfg(unix)]
fn is_whole(out: &Path) -> usize {
    let index = std::fs::read_to_string(out.join("long.pvd")).unwrap();
    assert!(index.trim_end().ends_with("</VTKFile>"), "{index}");
    let names: Vec<&str> =
        index.split("file=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    for name in &names {
        sinew::engine::mesh::Mesh::read(&out.join(name)).unwrap();
    }
    let rows = std::fs::read_to_string(out.join("long.csv")).unwrap();
    let columns = |row: &str| row.split(',').count();
    let first = columns(rows.lines().next().unwrap());
    assert!(rows.ends_with('\n') && rows.lines().all(|row| columns(row) == first));
    names.len()
}

#[cfg(unix)]
#[test]
fn signals_leave_whole_files_and_a_summary() {
    for signal in ["-TERM", "-INT", "-HUP"] {
        let (mut child, out) = under_way("signal");
        assert_eq!(kill(&mut child, signal), Some(1), "{signal}");
        assert!(is_whole(&out) > 3);
        let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
        assert!(
            summary.contains("interrupted after step") && summary.contains("\"completed\": false")
        );
    }
}

#[cfg(unix)]
#[test]
fn a_killed_run_leaves_what_the_next_one_understands() {
    let (mut child, out) = under_way("killed");
    assert_eq!(kill(&mut child, "-KILL"), None);
    assert!(is_whole(&out) > 3 && !out.join("summary.json").exists());
    let frames = || std::fs::read_dir(out.join("frames")).unwrap().count();
    let before = frames();
    let [scene, folder] = [file("killed.toml"), out.clone()].map(|p| p.display().to_string());
    check(&["run", "--steps", "2", "--out", &folder, &scene], 0, "that was cut short", "");
    assert!(frames() < before && is_whole(&out) == frames());
    check(&["run", "--steps", "2", "--out", &folder, &scene], 0, "of an earlier run were", "");
}

/// As on a full disk: the rows find no more room, what is there is whole, and the summary says so.
#[cfg(unix)]
#[test]
fn a_run_without_room_ends_by_name() {
    let (mut child, out) = under_way("full");
    kill(&mut child, "-KILL");
    let limited =
        "trap '' XFSZ; ulimit -f 32; exec \"$0\" run --quiet --steps 2000 --out \"$1\" \"$2\"";
    let output = Command::new("bash")
        .args(["-c", limited, env!("CARGO_BIN_EXE_sinew")])
        .args([&out, &file("full.toml")])
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("interrupted in step") && told.contains("has room"), "{told}");
    assert!(is_whole(&out) > 3 && !out.join("frames/unfinished").exists());
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
    assert!(summary.contains("interrupted in step") && summary.contains("\"completed\": false"));
}

/// What a run wrote that does not depend on how long it took.
#[cfg(unix)]
fn results(out: &Path) -> (String, String, String) {
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    let rows = read("grasp.csv");
    let times = rows.lines().next().unwrap().split(',').position(|c| c == "step_ms").unwrap();
    let without = |row: &str| {
        let cells = row.split(',').enumerate().filter(|(i, _)| *i != times);
        cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
    };
    let mut summary: serde_json::Value = serde_json::from_str(&read("summary.json")).unwrap();
    summary["timing"] = serde_json::Value::Null;
    let summary = summary.to_string().replace(&out.display().to_string(), "OUT");
    (rows.lines().map(without).collect(), summary, read("grasp.pvd"))
}

/// Killed again and again at any moment, also while it writes a checkpoint, it goes on every time.
#[cfg(unix)]
#[test]
#[ignore = "slow"]
fn a_run_that_is_killed_goes_on() {
    let (scene, whole, cut) = (shipped("grasp"), file("killed_whole"), file("killed_cut"));
    let _ = (std::fs::remove_dir_all(&whole), std::fs::remove_dir_all(&cut));
    let run = |out: &Path, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
        command.args(["run", &scene, "--steps", "150", "--threads", "1", "--out"]).arg(out);
        command.args(more).stderr(std::process::Stdio::null()).stdout(std::process::Stdio::null());
        command
    };
    let start = std::time::Instant::now();
    assert!(run(&whole, &[]).status().unwrap().success());
    let whole_ms = start.elapsed().as_millis() as u64;
    let going_on = ["--checkpoint", "50ms", "--resume"];
    let mut seed = u64::from(std::process::id());
    for _ in 0..20 {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // long enough now and then to get somewhere
        let wait = (seed >> 33) % (whole_ms / 6).max(20);
        let mut child = run(&cut, &going_on).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(wait));
        kill(&mut child, "-KILL");
    }
    assert!(run(&cut, &going_on).status().unwrap().success());
    assert_eq!(results(&cut), results(&whole));
}

#[test]
fn a_log_is_recorded_and_repeated() {
    let log = file("run.jsonl").display().to_string();
    let run = ["run", &shipped("muscle_bar"), "--steps", "12", "--record", &log, "--quiet"];
    let portable = ["--instruction-set", "portable", "--hash-every", "4"];
    check(&[&run[..], &portable].concat(), 0, "", "");
    check(&["replay", &log], 0, "12 steps with", "");
    check(&["replay", "nowhere.jsonl"], 1, "", "nowhere.jsonl");
    check(&["run", &shipped("liver"), "--checkpoint", "1s"], 1, "", "give --out DIR");
    check(&["run", &shipped("liver"), "--checkpoint", "soon"], 2, "", "0.5s or 20ms");
    check(&["run", &shipped("liver"), "--hash-every", "3"], 2, "", "--record");
}
