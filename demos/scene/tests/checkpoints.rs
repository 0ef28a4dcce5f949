//! A run that was stopped and goes on writes what one writes that was never stopped; a log of it can be repeated.

use sinew::engine::lanes::InstructionSet;
use sinew_scene::assemble::{BuildOptions, BuiltScene};
use sinew_scene::run::{LogOptions, Observer, RunOptions, Silent, replay, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::{scene_folder, shipped_scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stops a run after some steps.
struct Stop {
    after: u64,
    asked: Arc<AtomicBool>,
    from: Option<u64>,
}

impl Observer for Stop {
    fn step(&mut self, done: u64, _: f64, _: &mut BuiltScene) {
        if done >= self.after {
            self.asked.store(true, Ordering::Relaxed);
        }
    }

    fn resumed(&mut self, done: Option<u64>, damaged: &[PathBuf]) {
        assert!(damaged.is_empty());
        self.from = done;
    }
}

fn folder(name: &str) -> PathBuf {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("checkpoints").join(name);
    let _ = std::fs::remove_dir_all(&out);
    out
}

/// Everything that a run wrote, without host times and the name of its folder.
fn written(out: &Path, name: &str) -> Vec<(String, String)> {
    let read = |path: &Path| std::fs::read_to_string(path).unwrap();
    let rows = read(&out.join(format!("{name}.csv")));
    let column = rows.lines().next().unwrap().split(',').position(|c| c == "step_ms").unwrap();
    let without = |row: &str| {
        let cells = row.split(',').enumerate().filter(|(i, _)| *i != column);
        cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
    };
    let rows = rows.lines().map(without).collect::<Vec<_>>().join("\n");
    let mut summary: serde_json::Value =
        serde_json::from_str(&read(&out.join("summary.json"))).unwrap();
    summary["timing"] = serde_json::Value::Null;
    for resection in summary["resections"].as_array_mut().unwrap() {
        (resection["total_s"], resection["longest_s"]) = Default::default();
    }
    for cut in summary.get_mut("cuts").and_then(|cuts| cuts.as_array_mut()).into_iter().flatten() {
        cut["total_s"] = serde_json::Value::Null;
    }
    let summary = summary.to_string().replace(&out.display().to_string(), "OUT");
    let mut files = vec![
        ("rows".to_string(), rows),
        ("summary".into(), summary),
        ("index".into(), read(&out.join(format!("{name}.pvd")))),
    ];
    let mut frames: Vec<PathBuf> =
        std::fs::read_dir(out.join("frames")).unwrap().map(|e| e.unwrap().path()).collect();
    frames.sort();
    for frame in frames {
        let bytes = std::fs::read(&frame).unwrap();
        let sum = sinew::snapshot::checksum(&bytes);
        files.push((frame.file_name().unwrap().to_string_lossy().into(), format!("{sum:x}")));
    }
    let mut left: Vec<String> = std::fs::read_dir(out)
        .unwrap()
        .map(|e| e.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    left.sort();
    files.push(("folder".into(), left.join(" ")));
    files
}

/// The scenes that ship, their first steps: stopped twice on the way, with the checkpoints now before and now after
/// what they do at certain times.
#[test]
fn stopped_runs_go_on_as_if_nothing_had_been() {
    for entry in std::fs::read_dir(scene_folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let mut scene = LoadedScene::read(&shipped_scene(&name)).unwrap();
        if scene.scene.dt.is_none() {
            continue;
        }
        // all that happens in the scene, in few steps
        let duration = scene.scene.duration.unwrap();
        scene.scene.output.every = None;
        let dt = scene.scene.dt.unwrap();
        let steps = ((duration / dt) as u64).min(36);
        let build = BuildOptions { steps: Some(steps), threads: Some(1), ..Default::default() };
        let [whole, cut] = ["whole", "cut"].map(|kind| folder(&format!("{kind}_{name}")));
        let options =
            |out: &Path| RunOptions { build, out: Some(out.into()), ..RunOptions::default() };
        run(&scene, &options(&whole), &mut Silent).unwrap();
        let expected = written(&whole, &name);
        for (stop, from) in
            [(Some(steps / 3), None), (Some(steps / 2 + 2), Some(())), (None, Some(()))]
        {
            let asked = Arc::new(AtomicBool::new(false));
            let after = stop.unwrap_or(u64::MAX);
            let mut observer = Stop { after, asked: asked.clone(), from: None };
            let options = RunOptions {
                checkpoint: Some(5.0 * dt),
                resume: true,
                interrupt: Some(asked),
                ..options(&cut)
            };
            let summary = run(&scene, &options, &mut observer).unwrap();
            assert_eq!(summary.completed, stop.is_none(), "{name}");
            assert_eq!(observer.from.map(|_| ()), from, "{name}");
        }
        for (found, expected) in written(&cut, &name).iter().zip(&expected) {
            assert_eq!(found, expected, "{name}");
        }
    }
}

/// A run that was told to stop at a moment when neither row nor frame was due, but a checkpoint was.
#[test]
fn a_run_stopped_out_of_turn_goes_on_without_what_it_wrote_then() {
    let name = "cantilever";
    let mut scene = LoadedScene::read(&shipped_scene(name)).unwrap();
    scene.scene.output = sinew_scene::scene::Output {
        every: Some(4),
        frames_per_second: None,
        probe_every: Some(3),
    };
    let build = BuildOptions { steps: Some(15), threads: Some(1), ..Default::default() };
    let [whole, cut] = ["whole_turn", "cut_turn"].map(folder);
    let options = |out: &Path| RunOptions { build, out: Some(out.into()), ..RunOptions::default() };
    run(&scene, &options(&whole), &mut Silent).unwrap();
    for stop in [5, 9, u64::MAX] {
        let asked = Arc::new(AtomicBool::new(false));
        let mut observer = Stop { after: stop, asked: asked.clone(), from: None };
        let checkpoint = Some(scene.scene.dt.unwrap());
        let options =
            RunOptions { checkpoint, resume: true, interrupt: Some(asked), ..options(&cut) };
        let summary = run(&scene, &options, &mut observer).unwrap();
        // what was asked for before the next step is carried out after it
        let done = stop.saturating_add(1).min(15);
        assert_eq!(summary.timing.step.count, done);
        let rows = std::fs::read_to_string(cut.join("cantilever.csv")).unwrap();
        assert!(rows.lines().last().unwrap().starts_with(&format!("{done},")), "{rows}");
    }
    for (found, expected) in written(&cut, name).iter().zip(&written(&whole, name)) {
        assert_eq!(found, expected);
    }
    // another instruction set is refused before anything is said or taken away
    if InstructionSet::best() == InstructionSet::Portable {
        return;
    }
    let asked = Arc::new(AtomicBool::new(false));
    let mut observer = Stop { after: 5, asked: asked.clone(), from: None };
    let stopped = RunOptions {
        checkpoint: Some(scene.scene.dt.unwrap()),
        interrupt: Some(asked),
        ..options(&cut)
    };
    run(&scene, &stopped, &mut observer).unwrap();
    let before = written(&cut, name);
    scene.scene.instruction_set = Some(InstructionSet::Portable);
    let mut observer = Stop { after: 99, asked: Arc::default(), from: None };
    let resume = RunOptions { resume: true, ..options(&cut) };
    run(&scene, &resume, &mut observer).unwrap_err();
    assert_eq!((observer.from, written(&cut, name)), (None, before));
}

/// Logs of scenes in which hands, tools and cutters move.
#[test]
fn logs_are_repeated() {
    for name in ["liver", "liver_resection", "grasp", "two_organs", "muscle_bar"] {
        let scene = LoadedScene::read(&shipped_scene(name)).unwrap();
        let build = BuildOptions { steps: Some(40), threads: Some(2), ..Default::default() };
        let log = folder(&format!("{name}_log")).with_extension("jsonl");
        std::fs::create_dir_all(log.parent().unwrap()).unwrap();
        let record = Some(LogOptions { path: log.clone(), hash_every: 7 });
        let summary =
            run(&scene, &RunOptions { build, record, ..Default::default() }, &mut Silent).unwrap();
        assert!(summary.completed, "{summary}");
        let repeated = replay(&log, None, Some(1)).unwrap();
        assert_eq!((repeated.steps, repeated.hashes, repeated.whole), (40, 6, true), "{name}");
        assert_eq!(format!("{:016x}", repeated.hash), summary.final_state_hash, "{name}");

        // one that was cut off in the middle of a line, and one in which a hash is another
        let text = std::fs::read_to_string(&log).unwrap();
        let cut = &text[..text.len() - 40];
        std::fs::write(&log, cut).unwrap();
        assert!(!replay(&log, None, None).unwrap().whole);
        let line = text.lines().find(|line| line.contains("\"step\":14,\"hash\"")).unwrap();
        let mark = line.find("\"vertices\":[\"").unwrap() + 13 + 4 * 5;
        let wrong: String = if line[mark..].starts_with('0') { "1".into() } else { "0".into() };
        let mut other = line.replacen("\"hash\":\"", "\"hash\":\"x", 1);
        other.replace_range(mark + 1..mark + 2, &wrong);
        std::fs::write(&log, text.replace(line, &other)).unwrap();
        let error = replay(&log, None, None).unwrap_err().to_string();
        let body = &scene.scene.bodies[0].name;
        assert!(error.contains(&format!("after step 14 the state differs from that in the log: body `{body}`, first at vertex 5")), "{error}");
        // the hash is right, what stands beside it is not
        let other = other.replacen("\"hash\":\"x", "\"hash\":\"", 1);
        std::fs::write(&log, text.replace(line, &other)).unwrap();
        let error = replay(&log, None, None).unwrap_err().to_string();
        assert!(error.contains("marks of its vertices") && error.contains("damaged"), "{error}");
    }
}

/// What cannot be gone on with is told by name.
#[test]
fn what_cannot_go_on_is_told() {
    let name = "cantilever";
    let mut scene = LoadedScene::read(&shipped_scene(name)).unwrap();
    let build = BuildOptions { steps: Some(9), ..Default::default() };
    let asked = Arc::new(AtomicBool::new(false));
    let out = folder("refused");
    let options = RunOptions {
        build,
        out: Some(out.clone()),
        checkpoint: Some(0.02),
        interrupt: Some(asked.clone()),
        ..RunOptions::default()
    };
    run(&scene, &options, &mut Stop { after: 5, asked, from: None }).unwrap();
    let resume = RunOptions { build, out: Some(out.clone()), resume: true, ..Default::default() };
    scene.scene.solver.linear_tolerance = 1e-4;
    let error = run(&scene, &resume, &mut Silent).unwrap_err().to_string();
    assert!(error.contains("checkpoint-0000000006.sinew: it belongs to another scene"), "{error}");
    let scene = LoadedScene::read(&shipped_scene(name)).unwrap();
    let nowhere = RunOptions { build, resume: true, ..Default::default() };
    let error = run(&scene, &nowhere, &mut Silent).unwrap_err().to_string();
    assert_eq!(error, "--resume: no folder to go on in; give --out DIR as well");
    // the last one is damaged: the one before serves
    let last = out.join("checkpoint-0000000006.sinew");
    let mut bytes = std::fs::read(&last).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&last, bytes).unwrap();
    struct Told(Option<u64>, usize);
    impl Observer for Told {
        fn resumed(&mut self, done: Option<u64>, damaged: &[PathBuf]) {
            (self.0, self.1) = (done, damaged.len());
        }
    }
    let mut told = Told(None, 0);
    assert!(run(&scene, &resume, &mut told).unwrap().completed);
    assert_eq!((told.0, told.1), (Some(4), 1));
}
