//! A run says what it did: no file is left half written, nothing that did not move counts as done, and what no
//! machine can hold is refused before it is made.

use crate::common::says;
use sinew::engine::memory;
use sinew::engine::mesh::Mesh;
use sinew_scene::assemble::BuiltScene;
use sinew_scene::assemble::{BuildOptions, WITHOUT_EFFECT, build};
use sinew_scene::check::check_file;
use sinew_scene::mesh_tool::{convert, read};
use sinew_scene::picture::run_to_page;
use sinew_scene::run::{Observer, RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::summary::RunSummary;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

fn scene(body: &str, rest: &str) -> String {
    format!(
        "name = \"t\"\ndt = 0.01\nduration = 0.3\n{rest}\n[[body]]\nname = \"b\"\n\
         generate = {{ box = {{ size = [0.1, 0.1, 0.1], cells = [2, 2, 2] }} }}\n{body}\n\
         [[constraint]]\nname = \"c\"\nselect = {{ group = \"x0\" }}\n"
    )
}

const LIVER: &str = "material = { preset = \"liver\" }";

fn loaded(text: &str) -> LoadedScene {
    LoadedScene::parse(text, Path::new("truth.toml")).unwrap()
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("sinew-truth-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    folder
}

fn run_into(text: &str, out: &Path) -> RunSummary {
    let options = RunOptions { out: Some(out.into()), ..RunOptions::default() };
    run(&loaded(text), &options, &mut Silent).unwrap()
}

fn refusal(text: &str) -> String {
    let scene = LoadedScene::parse(text, Path::new("truth.toml"));
    match scene.and_then(|scene| build(&scene, &BuildOptions::default()).map(|_| ())) {
        Err(error) => error.to_string(),
        Ok(()) => panic!("accepted: {text}"),
    }
}

#[test]
fn fibres_and_a_membrane_in_one_body_are_written() {
    let body = format!(
        "{LIVER}\nmembrane = {{ thickness = 0.001, surface = true }}\n\
         [[body.fibres]]\nname = \"f\"\nmodulus = 1e4\ndirection = [1.0, 0.0, 0.0]"
    );
    let out = folder("fibres");
    assert!(run_into(&scene(&body, ""), &out).completed);
    let last = Mesh::read(&out.join("frames/t_00000.vtu")).unwrap();
    let fibres = last.cell_data.iter().find(|data| data.name == "f_x").unwrap();
    assert_eq!((fibres.values.tetrahedra.len(), fibres.values.triangles.len()), (48, 48));
    let values = &fibres.values;
    assert!(values.tetrahedra.iter().all(|x| *x == 1.0) && values.triangles[0] == 0.0);
    std::fs::remove_dir_all(out).unwrap();
}

#[test]
fn numbers_beyond_all_units_are_refused() {
    says(&refusal(&scene(LIVER, "gravity = [0.0, 0.0, -1e100]")), &["line 4", "gravity", "1e18"]);
    let of = |e: &str, rho: &str| {
        format!("material = {{ young_modulus = {e}, poisson_ratio = 0.4, density = {rho} }}")
    };
    says(&refusal(&scene(&of("1e300", "1e3"), "")), &["line 8", "young_modulus`: 1e300 is beyond"]);
    says(&refusal(&scene(&of("1e4", "1e-30"), "")), &["line 8", "density is 1e-30"]);
    let pressed = scene(LIVER, "").to_string()
        + "[[pressure]]\nname = \"p\"\non = { surface = true }\npressure = 1e30\n";
    says(&refusal(&pressed), &["line 15, `pressure[0].pressure`", "1e30 is beyond"]);
    says(&refusal(&pressed.replace("1e30", "1e15")), &["line 15", "1e12"]);
}

/// Bodies under loads that no line search can follow are not called done.
#[test]
fn a_run_that_was_halted_fails() {
    let out = folder("halted");
    let summary = run_into(&scene(LIVER, "gravity = [0.0, 0.0, -9e11]"), &out);
    let moved = summary.solver.figures.halted_steps * 4 <= 30;
    assert!(moved || !summary.completed, "{} steps halted", summary.solver.figures.halted_steps);
    std::fs::remove_dir_all(out).unwrap();
}

/// The worst reproduction: recovery has to leave a pressed body alone, and the run ends at rest, but crushed, which is no
/// result.
#[test]
fn a_crushing_pressure_is_told_and_bounded() {
    let material = "material = { young_modulus = 20e3, poisson_ratio = 0.4, density = 1000.0 }\nmodel = \"neo_hookean\"";
    let text = scene(material, "gravity = [0.0, 0.0, 0.0]")
        .replace("duration = 0.3", "duration = 1.0")
        + "[[pressure]]\nname = \"p\"\non = { surface = true }\npressure = 5e4\ncurve = { ramp = [0.0, 0.5] }\n";
    let out = folder("pressed");
    let summary = run_into(&text, &out);
    let e = &summary.energy;
    assert!(summary.untrusted && e.load_work < 100.0 && e.kinetic < 1e-3, "{e:?}");
    says(&summary.failure.clone().unwrap(), &["inside out"]);
    assert_eq!((summary.solver.totals.recovering, e.recovery), (0, 0.0));
    let code = |code: &str| summary.warnings.iter().any(|w| w.code == code);
    assert!(code("scene.pressure.range") && code("run.inverted") && code("run.recovery.refused"));
    // initial and put in are stored, left or were taken out
    let out_of = e.elastic + e.kinetic + e.dissipated.unwrap();
    let in_to = e.initial + e.load_work + e.constraint_work + e.recovery;
    assert!((out_of - in_to).abs() < 1e-9 * e.load_work.abs());
    std::fs::remove_dir_all(out).unwrap();
}

/// Sets the flag after some steps, as a signal would.
struct Interrupt(Arc<AtomicBool>, u64);

impl Observer for Interrupt {
    fn step(&mut self, done: u64, _: f64, _: &mut BuiltScene) {
        if done == self.1 {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn an_interrupted_run_leaves_whole_files() {
    let out = folder("interrupted");
    // an earlier, longer run in the same folder
    assert!(run_into(&scene(LIVER, ""), &out).completed);
    let frames = || std::fs::read_dir(out.join("frames")).unwrap().count();
    let before = frames();
    let flag = Arc::new(AtomicBool::new(false));
    let interrupt = Some(Arc::clone(&flag));
    let options = RunOptions { out: Some(out.clone()), interrupt, ..RunOptions::default() };
    let summary = run(&loaded(&scene(LIVER, "")), &options, &mut Interrupt(flag, 4)).unwrap();
    assert!(!summary.completed);
    says(summary.failure.as_deref().unwrap(), &["interrupted", "step 5 of 30"]);
    assert!(frames() < before);
    let index = std::fs::read_to_string(out.join("t.pvd")).unwrap();
    assert_eq!(index.matches("<DataSet").count(), frames());
    let rows = std::fs::read_to_string(out.join("t.csv")).unwrap();
    let columns = |row: &str| row.split(',').count();
    let first = columns(rows.lines().next().unwrap());
    assert!(rows.ends_with('\n') && rows.lines().all(|row| columns(row) == first));
    assert_eq!(rows.lines().count(), 1 + 6);
    let written = std::fs::read_to_string(out.join("summary.json")).unwrap();
    says(&written, &["\"completed\": false", "interrupted"]);
    std::fs::remove_dir_all(out).unwrap();
}

#[test]
fn a_hinge_is_found_by_the_check() {
    let vtk = "# vtk DataFile Version 3.0\nhinge\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 6 double\n\
               0 0 0 1 0 0 0 1 0 0 0 1 0 -1 0 0 0 -1\nCELLS 2 10\n4 0 1 2 3\n4 0 1 4 5\nCELL_TYPES 2\n10\n10\n";
    let text = "name = \"h\"\nmode = \"static\"\n[[body]]\nname = \"b\"\nmesh = \"hinge.vtk\"\n\
                material = { preset = \"liver\" }\n[[constraint]]\nname = \"c\"\nselect = { vertices = [0, 1, 2, 3] }\n";
    let scene = loaded(text).with_files(move |_: &Path| Ok(vtk.as_bytes().to_vec()));
    let error = build(&scene, &BuildOptions::default()).map(|_| ()).unwrap_err().to_string();
    says(&error, &["truth.toml, line 2", "share no more than an edge", "in 1 ways"]);
    let held = text.replace("[0, 1, 2, 3]", "[0, 1, 2, 3, 4]");
    let scene = loaded(&held).with_files(move |_: &Path| Ok(vtk.as_bytes().to_vec()));
    build(&scene, &BuildOptions::default()).map(|_| ()).unwrap();
}

#[test]
fn meshes_beyond_the_memory_are_refused() {
    let sphere = scene(LIVER, "").replace(
        "box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] }",
        "sphere = { radius = 1.0, shells = 550 }",
    );
    if memory::free().is_some_and(|free| free < 800 << 30) {
        says(&refusal(&sphere), &["line 7", "GiB are free"]);
    }
    assert!(memory::fits("nothing", || 0).is_ok());
    assert!(memory::fits("all", || u64::MAX).is_err() || memory::free().is_none());
}

#[test]
fn special_files_and_odd_points_are_refused() {
    let folder = folder("files");
    std::fs::create_dir_all(&folder).unwrap();
    for path in [Path::new("/dev/zero"), &folder] {
        if path.exists() {
            assert!(Mesh::read(path).is_err());
            assert!(LoadedScene::read(path).is_err());
        }
    }
    let file = folder.join("nan.obj");
    std::fs::write(&file, "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let error = convert(&file, &folder.join("out.vtu"), 1.0, false, None).unwrap_err().to_string();
    says(&error, &["nan.obj", "vertex 0", "NaN"]);
    assert!(!folder.join("out.vtu").exists());
    std::fs::write(&file, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert!(convert(&file, &folder.join("out.vtu"), 1e300, false, None).is_err());
    let empty = folder.join("empty.stl");
    std::fs::write(&empty, "solid nothing\nendsolid nothing\n").unwrap();
    says(&read(&empty).unwrap_err().to_string(), &["empty.stl", "no vertices"]);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn sudden_motions_are_told() {
    let moved = |motion: &str| {
        let text = scene(LIVER, "")
            + "[[constraint]]\nname = \"m\"\nselect = { group = \"x1\" }\n"
            + motion;
        let built = build(&loaded(&text), &BuildOptions::default()).unwrap();
        built.warnings.iter().filter(|w| w.code == "scene.motion.jump").count()
    };
    let way = "motion = { translate = [0.1, 0.0, 0.0] }\n";
    assert_eq!(moved(&format!("{way}curve = {{ ramp = [0.0, 1.0] }}\n")), 0);
    assert_eq!(moved(&format!("{way}curve = {{ ramp = [0.0, 0.01] }}\nfrom = 0.05\n")), 1);
    assert_eq!(
        moved(&format!("{way}curve = {{ points = [[0, 0], [0.1, 0], [0.1000001, 1]] }}\n")),
        1
    );
    assert_eq!(moved(&format!("{way}curve = {{ sine = {{ frequency = 1e9 }} }}\n")), 1);
    assert_eq!(moved(way), 1);
}

#[test]
fn names_cannot_break_files_or_terminals() {
    let named = |name: &str| {
        scene(LIVER, "")
            + &format!(
                "[[probe]]\nname = {name}\nselect = {{ group = \"x1\" }}\nrecord = [\"mean_displacement\"]\n"
            )
    };
    says(&refusal(&named("\"a\\nb\"")), &["line 13", "control character"]);
    says(&refusal(&named("\"\\u001b]0;pwn\\u0007\"")), &["line 13", "control character"]);
    let out = folder("names");
    let text = named("\"=HYPERLINK(1)\"");
    assert!(run_into(&text, &out).completed);
    let csv = std::fs::read_to_string(out.join("t.csv")).unwrap();
    says(csv.lines().next().unwrap(), &[",'=HYPERLINK(1)"]);
    std::fs::remove_dir_all(out).unwrap();
}

/// Wrong numbers are told at their key, before the first step, and never by another remedy.
#[test]
fn what_no_scene_can_hold_is_refused_at_its_key() {
    let fibres = format!(
        "{LIVER}\n[[body.fibres]]\nname = \"f\"\nmodulus = 1e300\ndirection = [1.0, 0.0, 0.0]"
    );
    says(&refusal(&scene(&fibres, "")), &["line 11, `body[0].fibres[0].modulus`", "1e300"]);
    let step = scene(LIVER, "").replace("dt = 0.01", "dt = 1e-300");
    says(&refusal(&step), &["line 2, `dt`: dt = 1e-300 s makes 3.000e299 steps"]);
    let threads = scene(LIVER, "threads = 9223372036854775807");
    says(&refusal(&threads), &["line 4, `threads`"]);
    let stiff = scene("material = { preset = \"liver\", young_modulus = 1e-150 }", "");
    says(&refusal(&stiff), &["line 8, `body[0].material.young_modulus`"]);
}

/// An option in place of a key is what an error names.
#[test]
fn errors_name_the_option_that_was_given() {
    let mut scene = loaded(&scene(LIVER, ""));
    scene.scene.dt = Some(f64::NAN);
    scene.replaced_by("dt", "--dt");
    let error = build(&scene, &BuildOptions::default()).map(|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("truth.toml, `--dt`: dt is NaN s"), "{error}");
}

#[test]
fn runs_of_hours_are_told() {
    let told = |dt: &str| {
        let text = scene(LIVER, "").replace("dt = 0.01", dt);
        let built = build(&loaded(&text), &BuildOptions::default()).unwrap();
        built.warnings.iter().any(|w| w.code == "scene.steps.many")
    };
    assert!(told("dt = 1e-9") && !told("dt = 1e-4"));
}

/// Far from the origin 32 bits would fold the body; near it they are enough.
#[test]
fn frames_keep_the_shape() {
    let out = folder("far");
    for (far, kind) in [("1e7", "Float64"), ("0.0", "Float32")] {
        let body = format!("{LIVER}\ntranslate = [{far}, 0.0, 0.0]");
        run_into(&scene(&body, "gravity = [0.0, 0.0, 0.0]"), &out);
        let frame = out.join("frames/t_00000.vtu");
        let bytes = std::fs::read(&frame).unwrap();
        says(&String::from_utf8_lossy(&bytes), &[&format!("type=\"{kind}\" Name=\"Points\"")]);
        let points = Mesh::read(&frame).unwrap().points;
        let across = points.iter().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max) - points[0].x;
        assert!((across - 0.1).abs() < 1e-6, "{across}");
    }
    std::fs::remove_dir_all(out).unwrap();
}

/// A file that is no mesh is not quoted: a scene from elsewhere may name any file.
#[test]
fn what_is_no_mesh_is_not_shown() {
    let text = scene(LIVER, "");
    let text = text.replace(
        "generate = { box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] } }",
        "mesh = \"secrets\"",
    );
    let scene = loaded(&text).with_files(|_: &Path| Ok(b"root:x:secret".to_vec()));
    let error = build(&scene, &BuildOptions::default()).map(|_| ()).unwrap_err().to_string();
    says(&error, &["line 7", "secrets: unknown mesh format"]);
    assert!(!error.contains("root"), "{error}");
    let open = format!("<VTKFile type=\"UnstructuredGrid\">\n<{}", "a".repeat(5000));
    let error = Mesh::from_bytes("a.vtu", open.as_bytes()).unwrap_err().to_string();
    assert!(error.len() < 400, "{}", error.len());
}

/// The ratio of a material of two dimensions may come near 1 (Delingette 2008, section 2.3), that of a solid may not.
#[test]
fn sheets_may_have_a_ratio_near_one() {
    let sheet = |nu: &str, plane: &str| {
        scene(
            &format!(
                "material = {{ young_modulus = 1e5, poisson_ratio = {nu}, density = 1000.0 }}\n\
                 membrane = {{ thickness = 0.001, plane = \"{plane}\" }}"
            ),
            "",
        )
        .replace(
            "box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] }",
            "sheet = { size = [0.1, 0.1], cells = [2, 2] }",
        )
    };
    let built = build(&loaded(&sheet("0.95", "stress")), &BuildOptions::default()).unwrap();
    assert!(!built.all_warnings().iter().any(|w| w.code.starts_with("material.poisson")));
    let place = "line 8, `body[0].material.poisson_ratio`";
    says(&refusal(&sheet("1.0", "stress")), &[place, "at most 0.9999"]);
    says(&refusal(&sheet("0.6", "strain")), &["below 0.5"]);
    let solid = "material = { young_modulus = 1e5, poisson_ratio = 0.6, density = 1000.0 }";
    says(&refusal(&scene(solid, "")), &[place, "below 0.5"]);
}

/// The energy of some models grows more slowly than the work of a pressure: that is told beforehand, and the run fails by name.
#[test]
fn a_pressure_that_bursts_a_body_is_told_and_fails() {
    let run = |model: &str, pressure: f64| {
        let material = format!(
            "material = {{ young_modulus = 1e4, poisson_ratio = 0.45, density = 1000.0 }}\nmodel = \"{model}\""
        );
        let text = scene(&material, "gravity = [0.0, 0.0, 0.0]")
            + &format!(
                "[[pressure]]\nname = \"air\"\non = {{ surface = true }}\npressure = {pressure:e}\n"
            );
        let out = folder(&format!("burst-{model}-{pressure}"));
        let summary = run_into(&text, &out);
        std::fs::remove_dir_all(out).unwrap();
        summary
    };
    let told = |summary: &RunSummary| {
        summary.warnings.iter().any(|w| w.code == "scene.pressure.unbounded")
    };
    for model in ["corotational", "linear", "tqs", "mass_spring", "corotational_warped"] {
        let summary = run(model, -3e4);
        assert!(told(&summary), "{model}");
        let failure = summary.failure.clone().unwrap_or_default();
        let burst = failure.contains("`air` burst body") && failure.contains("neo_hookean");
        let energy = summary.energy.elastic_max.max(summary.energy.load_work.abs());
        assert!(energy < 1e6 && (burst || model == "tqs"), "{model}: {energy:e} J, {failure}");
        assert!(!told(&run(model, 2e3)), "{model} under a fifth of Young's modulus");
    }
    let held = run("neo_hookean", -1e4);
    assert!(held.completed && !told(&held), "{held}");
}

/// Models that soften in compression are told where they are pressed far.
#[test]
fn far_compression_of_a_model_that_softens_is_told() {
    for (model, part, due) in
        [("svk_comp", 0.4, true), ("svk_comp", 0.1, false), ("neo_hookean", 0.4, false)]
    {
        let text = scene(&format!("{LIVER}\nmodel = \"{model}\""), "gravity = [0.0, 0.0, 0.0]")
            + &format!(
                "[[constraint]]\nname = \"p\"\nselect = {{ group = \"x1\" }}\nmotion = {{ translate = [{}, 0.0, 0.0] }}\n\
                 curve = {{ ramp = [0.0, 0.2] }}\n",
                -0.1 * part
            );
        let out = folder(&format!("compressed-{model}-{part}"));
        let summary = run_into(&text, &out);
        std::fs::remove_dir_all(out).unwrap();
        let found = summary.warnings.iter().find(|w| w.code == "run.compression");
        assert_eq!(found.is_some(), due, "{model} {part}: {summary}");
        assert_eq!(summary.volume.compressed_max > 0, due);
        assert!(found.is_none_or(|w| w.message.contains("0.7") && w.remedy.contains("svk_volume")));
    }
}

/// A motion in millimetres is warned of before the run; the run says in its first line that it is worth nothing.
#[test]
fn a_motion_far_beyond_the_body_is_warned_of_and_not_trusted() {
    let text = scene(LIVER, "gravity = [0.0, 0.0, 0.0]")
        + "[[constraint]]\nname = \"tool\"\nselect = { group = \"x1\" }\n\
           motion = { translate = [45.0, -30.0, 45.0] }\ncurve = { ramp = [0.0, 0.3] }\n";
    let summary = run(&loaded(&text), &RunOptions::default(), &mut Silent).unwrap();
    assert!(!summary.completed && summary.untrusted, "{summary}");
    let told = summary.warnings.iter().find(|w| w.code == "scene.size.motion").unwrap();
    says(&told.to_string(), &["constraint `tool`", "70.36 m", "703.6 times", "45 mm is 0.045"]);
    for report in [summary.to_string(), summary.brief().to_string()] {
        says(report.lines().next().unwrap(), &["NOT TO BE TRUSTED", "30 steps", "smaller"]);
    }
    // so does its page, above everything else
    let page = std::env::temp_dir().join(format!("sinew-doubt-{}.html", std::process::id()));
    run_to_page(&loaded(&text), &RunOptions::default(), &page, true, &mut Silent).unwrap();
    let written = std::fs::read_to_string(&page).unwrap();
    std::fs::remove_file(&page).unwrap();
    says(
        &written,
        &["\"warning\":\"NOT TO BE TRUSTED, though all", "\"subtitle\":\"NOT TO BE TRUSTED"],
    );
    // what the remedy asks for is trusted
    let near = text.replace("[45.0, -30.0, 45.0]", "[0.045, -0.03, 0.045]");
    let summary = run(&loaded(&near), &RunOptions::default(), &mut Silent).unwrap();
    assert!(summary.completed, "{summary}");
    assert!(summary.to_string().starts_with("t: 300.0 ms simulated in"), "{summary}");
}

/// A bar stretched to eight times its length keeps all elements in order; no tissue does.
#[test]
fn more_energy_than_a_body_can_hold_is_not_trusted() {
    let stretched = |by: f64| {
        let text = scene(LIVER, "gravity = [0.0, 0.0, 0.0]")
            + "[[constraint]]\nname = \"end\"\nselect = { group = \"x1\" }\naxes = \"x\"\n\
               curve = { ramp = [0.0, 0.3] }\nmotion = { translate = [BY, 0.0, 0.0] }\n";
        let text = text.replace("BY", &format!("{by:?}"));
        run(&loaded(&text), &RunOptions::default(), &mut Silent).unwrap()
    };
    let summary = stretched(0.7);
    assert_eq!(summary.volume.inverted_max, 0);
    says(&summary.failure.clone().unwrap(), &["stored up to", "units"]);
    let summary = stretched(0.1);
    assert!(summary.completed, "{summary}");
}

/// What a scene is made of stands in its check; what cannot be meant is warned of there.
#[test]
fn checks_list_what_acts_and_foretell_what_goes_wrong() {
    let out = folder("check");
    std::fs::create_dir_all(&out).unwrap();
    let check = |text: &str| {
        let file = out.join("scene.toml");
        std::fs::write(&file, text).unwrap();
        check_file(&file).to_string()
    };
    let ball = |radius: &str, at: &str| {
        format!("[[tool]]\nname = \"ball\"\nshape = \"sphere\"\nradius = {radius}\nat = {at}\n")
    };
    let held = scene(LIVER, "gravity = [0.0, 0.0, 0.0]");
    let acting = ball("0.01", "[0.05, 0.05, 0.112]")
        + "translate = [0.0, 0.0, -0.02]\ncurve = { ramp = [0.0, 0.2] }\nfriction = 0.3\n\
           [[pull]]\nname = \"hand\"\nselect = { group = \"x1\" }\nstiffness = 20.0\n\
           [[contact]]\nname = \"fold\"\nself = \"b\"\nfriction = 0.1\n\
           [[pressure]]\nname = \"air\"\non = { surface = true }\npressure = 50.0\n\
           [[resection]]\nname = \"hole\"\nsphere = { centre = [0.1, 0.1, 0.1], radius = 0.01 }\nfrom = 0.1\n";
    let all = check(&(held.clone() + &acting));
    says(&all, &["tool `ball`: sphere of radius 0.01 m, moved by [0, 0, -0.02] m, friction 0.3"]);
    says(&all, &["pull `hand`: 20 N/m on 9 vertices of `b`, the hand at rest"]);
    says(
        &all,
        &[
            "contact `fold`: `b` with itself, friction 0.1",
            "pressure `air`: 50 Pa on 48 triangles of `b`",
        ],
    );
    says(
        &all,
        &[
            "resection `hole`: elements of `b` in a sphere of radius 0.01 m, from 0.1 s",
            "0 warning(s)",
        ],
    );
    for (tool, code, words) in [
        // half in, all in and all around
        (ball("0.02", "[0.05, 0.05, 0.11]"), "scene.tool.inside", "1 vertices of body `b`"),
        (ball("0.01", "[0.03, 0.04, 0.025]"), "scene.tool.inside", "wholly inside of body `b`"),
        (ball("0.01", "[0.05, 0.05, 0.2]"), "scene.tool.never", "never comes near"),
        (ball("12.0", "[0.05, 0.05, 12.2]"), "scene.size.tool", "12 m from its centre"),
        (
            ball("0.01", "[0.05, 0.05, 0.12]")
                + "translate = [0.0, 0.0, -20.0]\ncurve = { ramp = [0.0, 0.3] }\n",
            "scene.size.motion",
            "tool `ball`",
        ),
    ] {
        says(&check(&(held.clone() + &tool)), &[&format!("warning [{code}] tool `ball`"), words]);
    }
    let falls = "name = \"t\"\ndt = 0.01\nduration = 1.0\n[[body]]\nname = \"b\"\n\
                 generate = { sphere = { radius = 0.05, shells = 2 } }\nmaterial = { preset = \"liver\" }\n";
    says(
        &check(falls),
        &["warning [scene.body.falls] body `b`", "4.905 m in 1.00 s", "half-space"],
    );
    let table = "[[tool]]\nname = \"table\"\nshape = \"half-space\"\nat = [0.0, 0.0, -0.1]\n";
    says(&check(&(falls.to_string() + table)), &["0 warning(s)"]);
    let long = falls.replace("dt = 0.01", "dt = 1.0");
    says(&check(&long), &["warning [scene.step.long] scene: steps of 1.00 s", "dt = 0.01"]);
    std::fs::remove_dir_all(out).unwrap();
}

/// A surface is no body; the check prints how it becomes one, with its own names.
#[test]
fn the_check_of_a_surface_says_how_to_fill_it() {
    let out = folder("surface");
    std::fs::create_dir_all(&out).unwrap();
    let file = out.join("organ.stl");
    std::fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/text.stl"), &file)
        .unwrap();
    let summary = check_file(&file);
    let text = summary.to_string();
    assert!(!text.contains("can be simulated"), "{text}");
    says(
        &text,
        &["organ.stl (mesh): a surface only, no solid body", "sinew mesh fill organ.stl organ.msh"],
    );
    says(&text, &["lattice = ", "--edge ", "docs/own-mesh.md"]);
    std::fs::remove_dir_all(out).unwrap();
}

/// Keys that change nothing are noted, whatever makes them idle.
#[test]
fn keys_without_effect_are_noted() {
    let noted = |text: &str| {
        let built = build(&loaded(text), &BuildOptions { threads: Some(1), ..Default::default() });
        let own = built.unwrap().warnings.into_iter().filter(|w| w.code == WITHOUT_EFFECT);
        own.map(|w| w.subject).collect::<Vec<_>>()
    };
    let none: [&str; 0] = [];
    assert_eq!(noted(&scene(LIVER, "")), none);
    let solver = |keys: &str| scene(LIVER, &format!("solver = {{ {keys} }}"));
    assert_eq!(noted(&solver("newton_tolerance = 1e-6")), ["`solver.newton_tolerance`"]);
    assert_eq!(noted(&solver("integrator = \"newton\", newton_tolerance = 1e-6")), none);
    assert_eq!(noted(&solver("max_substeps = 10")), ["`solver.max_substeps`"]);
    let explicit =
        solver("integrator = \"symplectic-euler\", linear_tolerance = 1e-6, explicit_safety = 0.5");
    assert_eq!(noted(&explicit), ["`solver.linear_tolerance`"]);
    let sleeps = "sleep_speed = 1e-4";
    assert_eq!(noted(&solver(sleeps)), none);
    let explicit = solver(&format!("integrator = \"symplectic-euler\", {sleeps}"));
    assert_eq!(noted(&explicit), ["`solver.sleep_speed`"]);
    let springs = format!(
        "{LIVER}\nmodel = \"mass_spring\"\nelement_method = \"uniform\"\nspring_constant = 9.0"
    );
    let of = |keys: &str| springs.replace("preset = \"liver\"", keys);
    let constants = of("young_modulus = 1e4, poisson_ratio = 0.3, density = 1e3");
    assert_eq!(
        noted(&scene(&constants, "")),
        ["`body[0].material.poisson_ratio`", "`body[0].material.young_modulus`"]
    );
    let late = scene(LIVER, "").replace("select = {", "from = 0.4\nselect = {");
    assert_eq!(noted(&late), ["`constraint[0]`"]);
    let seed = scene(LIVER, "").replace("cells = [2, 2, 2]", "cells = [2, 2, 2], seed = 3");
    assert_eq!(noted(&seed), ["`body[0].generate.box.seed`"]);
}
