//! Scenes through the plain face, against the runner behind the command.

use sinew_embed::*;
use sinew_scene::assemble::BuildOptions;
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::{scene_folder, shipped_scene};
use std::collections::HashMap;

/// Gravity and curves, tools, pulls and contact, removals, muscles, pressure, load steps.
const SCENES: [(&str, u64); 8] = [
    ("liver", 12),
    ("grasp", 25),
    ("two_organs", 15),
    ("liver_resection", 30),
    ("muscle_bar", 10),
    ("ventricle", 2),
    ("static_beam", 3),
    ("membrane_drum", 5),
];

#[test]
fn scenes_have_the_hash_of_the_command() {
    for (name, steps) in SCENES {
        let build = BuildOptions { steps: Some(steps), threads: Some(1), ..Default::default() };
        let path = shipped_scene(name);
        let options = RunOptions { build, ..RunOptions::default() };
        let summary = run(&LoadedScene::read(&path).unwrap(), &options, &mut Silent).unwrap();
        assert_eq!(summary.failure, None, "{name}");

        let mut sim = Embedding::from_scene_file(path.to_str().unwrap(), &build).unwrap();
        assert_eq!(sim.steps_planned(), Some(steps));
        sim.step(steps as u32).unwrap();
        assert_eq!(format!("{:016x}", sim.hash()), summary.final_state_hash, "{name}");
        assert_eq!(sim.steps_done(), steps);
        assert_eq!(sim.warnings(), summary.warnings, "{name}");
        assert_eq!(sim.verdict(), None, "{name}");

        // from memory, step by step, with buffers and figures read on the way
        let text = std::fs::read_to_string(&path).unwrap();
        let files = Folder(scene_folder());
        let mut sim = Embedding::from_scene(&text, &format!("{name}.toml"), files, &build).unwrap();
        for _ in 0..steps {
            sim.step(1).unwrap();
            let (body, _) = sim.list(Kind::Body)[0];
            sim.positions(body).unwrap();
            sim.energy();
            sim.surface(body).unwrap();
        }
        assert_eq!(format!("{:016x}", sim.hash()), summary.final_state_hash, "{name}");
    }
}

const DROP: &str = r#"
    name = "drop"
    dt = 0.01
    duration = 0.1
    threads = 1
    [[body]]
    name = "tetrahedron"
    mesh = "meshes/one.vtk"
    material = { preset = "liver" }
    [[tool]]
    name = "table"
    shape = "half-space"
    at = [0.0, 0.0, -0.5]
    [[pull]]
    name = "hand"
    stiffness = 10.0
    select = { vertices = [3] }
    from = 0.05
    translate = [0.0, 0.0, 0.1]
"#;

const ONE: &[u8] =
    b"# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n\
    0 0 0  1 0 0  0 1 0  0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";

#[test]
fn files_of_a_scene_come_from_anywhere() {
    let files = || HashMap::from([("meshes/one.vtk".to_string(), ONE.to_vec())]);
    let overrides = Overrides::default();
    let mut sim = Embedding::from_scene(DROP, "drop.toml", files(), &overrides).unwrap();
    assert_eq!(sim.scene_name(), Some("drop"));
    let body = sim.find(Kind::Body, "tetrahedron").unwrap();
    let pull = sim.find(Kind::Pull, "hand").unwrap();
    let table = sim.find(Kind::Tool, "table").unwrap();
    assert_eq!(sim.name(table).unwrap(), "table");
    sim.step(3).unwrap();
    // linearised BDF2 starts with one implicit step: it falls a little more than t^2 g / 2
    let fallen = sim.displacements(body).unwrap()[0][2];
    assert!((-0.0062..-0.0044).contains(&fallen), "{fallen}");
    assert_eq!(sim.pull_report(pull).unwrap().force, DVec3::ZERO);
    let refused = sim.move_pull(pull, DVec3::ZERO).unwrap_err();
    assert!(refused.text.contains("moves as the scene says"), "{refused}");
    sim.step(4).unwrap();
    assert!(sim.pull_report(pull).unwrap().force.z < -0.5);
    sim.remove(pull).unwrap();
    sim.step(1).unwrap();
    assert_eq!(sim.pull_report(pull).unwrap_err().code, Code::Handle);
    assert_eq!(sim.contact_forces(body).unwrap()[3], [0.0; 3]);

    let none = HashMap::<String, Vec<u8>>::new();
    let error = Embedding::from_scene(DROP, "drop.toml", none, &overrides).err().unwrap();
    assert_eq!(error.code, Code::Scene);
    assert!(error.text.contains("drop.toml, line 8, `body[0].mesh`"), "{error}");
    assert!(error.text.contains("no file `meshes/one.vtk` was given"), "{error}");
    let asked = |path: &str| Err(std::io::Error::other(format!("no {path} here")));
    let error = Embedding::from_scene(DROP, "x/drop.toml", asked, &overrides).err().unwrap();
    assert!(error.text.contains("no meshes/one.vtk here"), "{error}");
}

#[test]
fn errors_of_scenes_are_those_of_the_library() {
    let text = DROP.replace("dt = 0.01", "dt = -1");
    let loaded = LoadedScene::parse(&text, "drop.toml".as_ref()).unwrap();
    let typed = sinew_scene::assemble::build(&loaded, &Default::default()).err().unwrap();
    let files = HashMap::new();
    let error = Embedding::from_scene(&text, "drop.toml", files, &Overrides::default());
    assert_eq!(error.err().unwrap(), EmbedError::new(Code::Scene, typed.to_string()));
    let error = Embedding::from_scene_file("no/such.toml", &Overrides::default()).err().unwrap();
    assert_eq!(error.code, Code::Io);
    assert!(error.text.starts_with("no/such.toml: "), "{error}");
}

#[test]
fn static_scenes_load_in_parts() {
    let path = shipped_scene("static_beam");
    let overrides = Overrides { steps: Some(4), ..Overrides::default() };
    let mut sim = Embedding::from_scene_file(path.to_str().unwrap(), &overrides).unwrap();
    assert!(sim.is_static());
    let whole = sim.gravity();
    let (body, _) = sim.list(Kind::Body)[0];
    let mut before = 0.0;
    for part in 1..=4 {
        sim.step(1).unwrap();
        let forces = sim.external_forces(body).unwrap();
        let masses = sim.masses(body).unwrap();
        let ratio = forces[0][2] / (masses[0] * whole[2]);
        if whole[2] != 0.0 {
            assert!((ratio - 0.25 * f64::from(part)).abs() < 1e-12, "{part}: {ratio}");
        }
        let sag = sim.displacements(body).unwrap().iter().map(|u| u[2].abs()).fold(0.0, f64::max);
        assert!(sag > before, "{part}: {sag} after {before}");
        before = sag;
    }
    assert_eq!(sim.gravity(), whole);
}
