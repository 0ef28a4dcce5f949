//! Tools, pulls and contact in scene files: what they do, and what is refused.

use crate::common::says;
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_tets, sphere_triangles, triangle_grid};
use sinew::touch::tool::{Tool, ToolPose};
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::mesh_tool::write;
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::shipped_scene;
use sinew_scene::summary::RunSummary;
use std::path::{Path, PathBuf};

/// A block that is held below; entries follow. Line 17 is the first of them.
const BLOCK: &str = r#"name = "block"
gravity = [0.0, 0.0, 0.0]
dt = 0.01
duration = 0.3

[solver]
integrator = "safe"

[[body]]
name = "block"
generate = { box = { size = [0.06, 0.06, 0.02], cells = [6, 6, 2] } }
material = { young_modulus = 5e3, poisson_ratio = 0.4, density = 1000.0 }
[[constraint]]
name = "floor"
select = { group = "z0" }
#
"#;

/// A ball that comes down by 3 mm, stays, and lifts.
const BALL: &str = r#"[[tool]]
name = "ball"
shape = "sphere"
radius = 0.015
path = [[0.0, 0.03, 0.03, 0.036], [0.1, 0.03, 0.03, 0.032], [0.2, 0.03, 0.03, 0.032], [0.25, 0.03, 0.03, 0.04]]
"#;

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("touch");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn loaded(text: &str) -> LoadedScene {
    LoadedScene::parse(text, &folder().join("touch.toml")).unwrap_or_else(|e| panic!("{e}"))
}

/// The values of a probe at every step, by column.
fn recorded(text: &str, name: &str) -> (RunSummary, Vec<Vec<f64>>) {
    let out = folder().join(name);
    let options = RunOptions { out: Some(out.clone()), ..RunOptions::default() };
    let summary = run(&loaded(text), &options, &mut Silent).unwrap_or_else(|e| panic!("{e}"));
    assert!(summary.completed, "{summary}");
    let csv = std::fs::read_to_string(out.join("block.csv")).unwrap();
    let row = |line: &str| -> Vec<f64> {
        let cells = line.split(',').skip(20);
        cells.map(|x| if x.is_empty() { f64::NAN } else { x.parse().unwrap() }).collect()
    };
    assert!(
        csv.lines().next().unwrap().contains("step_ms,contact_work_J,contact_energy_J,friction_J")
    );
    (summary, csv.lines().skip(1).map(row).collect())
}

fn probe(kind: &str, name: &str, record: &[&str]) -> String {
    format!("[[probe]]\nname = \"p\"\n{kind} = \"{name}\"\nrecord = {record:?}\n")
}

#[test]
fn a_ball_presses_and_leaves_no_force_behind() {
    let quantities = probe(
        "tool",
        "ball",
        &[
            "tool_force",
            "tool_position",
            "tool_depth",
            "tool_area",
            "tool_pressure",
            "tool_other_force",
        ],
    );
    let text = format!("{BLOCK}{BALL}points = \"vertex\"\nerror_bar = true\n{quantities}");
    let (summary, rows) = recorded(&text, "ball");
    // before the first step, pressed, and lifted
    assert_eq!(rows[0][..6], [0.0, 0.0, 0.0, 0.03, 0.03, 0.036]);
    let pressed = &rows[20];
    assert!(pressed[2] > 0.05 && pressed[0].abs() < 0.1 * pressed[2], "{pressed:?}");
    assert!(pressed[6] > 0.0 && pressed[6] < 1e-3 && pressed[7] > 0.0 && pressed[8] > 0.0);
    // the mesh is far too coarse for this ball, and the other points say so
    assert!(pressed[11] > 2.0 * pressed[2], "{pressed:?}");
    let last = rows.last().unwrap();
    assert_eq!(last[..3], [0.0; 3]);
    let touch = summary.touch.as_ref().unwrap();
    let (tool, touch) = (&touch.touched.tools[0], &touch.figures);
    assert!(tool.force.peak >= pressed[2] && tool.force.end == [0.0; 3] && tool.work > 0.0);
    assert!(touch.points_max > 0 && touch.points_final == 0 && touch.inner_iterations > 20);
    // what the tool put in is in the books
    let contact = summary.energy.contact.unwrap();
    assert!(contact.work >= tool.work && contact.stored == 0.0, "{contact:?}");
    assert!(summary.energy.dissipated.unwrap() >= 0.0, "{summary}");
    says(
        &summary.to_string(),
        &["tool ball", "sphere of radius 0.015 m", "inner iterations", "tools ="],
    );
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["touch"]["tools"][0]["name"], "ball");
    assert!(json["energy"]["contact"]["work"].is_number());
}

/// Two balls side by side on one tool.
const PAIR: &str = r#"[[tool]]
name = "pair"
path = [[0.0, 0.03, 0.03, 0.036], [0.1, 0.03, 0.03, 0.032]]
parts = [
  { shape = "sphere", radius = 0.015, at = [-0.012, 0.0, 0.0] },
  { shape = "sphere", radius = 0.015, at = [0.012, 0.0, 0.001] },
]
"#;

#[test]
fn parts_of_a_tool_have_forces_of_their_own() {
    let own = |part: usize| {
        format!(
            "[[probe]]\nname = \"p{part}\"\ntool = \"pair\"\npart = {part}\nrecord = \
             [\"tool_part_force\", \"tool_part_torque\", \"tool_part_depth\", \
             \"tool_part_sticking\", \"tool_part_slipping\"]\n"
        )
    };
    let record = ["tool_force", "tool_torque", "tool_depth", "tool_sticking", "tool_slipping"];
    let whole = probe("tool", "pair", &record);
    let (summary, rows) = recorded(&format!("{BLOCK}{PAIR}{whole}{}{}", own(0), own(1)), "pair");
    assert!(rows[0].iter().all(|x| *x == 0.0), "{:?}", rows[0]);
    let (last, wide) = (rows.last().unwrap(), 9);
    let (all, a, b) = (&last[..wide], &last[wide..2 * wide], &last[2 * wide..3 * wide]);
    let size = all[2].abs();
    assert!(a[2] > b[2] && b[2] > 0.0, "the lower one feels more: {a:?} {b:?}");
    for i in (0..6).chain(7..9) {
        assert!((a[i] + b[i] - all[i]).abs() <= 1e-6 * size, "{i}: {a:?} {b:?} {all:?}");
    }
    assert_eq!(all[6], a[6].max(b[6]));
    let tool = &summary.touch.as_ref().unwrap().touched.tools[0];
    assert_eq!(tool.parts.len(), 2);
    assert!((tool.parts[0].end[2] - a[2]).abs() <= 1e-6 * size);
    says(&summary.to_string(), &["part 0", "part 1"]);
}

#[test]
fn scenes_without_contact_say_nothing_of_it() {
    let scene = LoadedScene::read(&shipped_scene("cantilever")).unwrap();
    let out = folder().join("without");
    let build = BuildOptions { steps: Some(2), ..BuildOptions::default() };
    let options = RunOptions { build, out: Some(out.clone()), ..RunOptions::default() };
    let summary = run(&scene, &options, &mut Silent).unwrap();
    let json = serde_json::to_value(&summary).unwrap();
    assert!(json.get("touch").is_none() && json["energy"]["contact"].is_null());
    let text = summary.to_string();
    assert!(!text.contains("contact") && !text.contains("tools"), "{text}");
    let csv = std::fs::read_to_string(out.join("cantilever.csv")).unwrap();
    assert!(csv.lines().next().unwrap().contains("step_ms,tip."), "{csv}");
}

/// A tool of which the distance is a grid presses as the shape that it was made from.
#[test]
fn a_mesh_touches_as_its_shape_does() {
    let ball = sphere_triangles(15.0, 8).unwrap();
    write(&folder().join("ball.vtu"), &ball).unwrap();
    let mesh = "shape = \"mesh\"\nfile = \"ball.vtu\"\nscale = 0.001";
    let quantities = probe("tool", "ball", &["tool_force"]);
    let of_shape = recorded(&format!("{BLOCK}{BALL}{quantities}"), "sphere").1;
    let own = BALL.replace("shape = \"sphere\"\nradius = 0.015", mesh);
    let of_mesh = recorded(&format!("{BLOCK}{own}{quantities}"), "mesh").1;
    let (a, b) = (of_shape[20][2], of_mesh[20][2]);
    assert!((b / a - 1.0).abs() < 0.1, "{b} beside {a}");
    // a grid that shows nothing of it, and one that is too fine
    let with =
        |h: &str| format!("{BLOCK}{}", own.replace("scale", &format!("spacing = {h}\nscale")));
    for (h, words) in [("0.02", ["`spacing`", "off by up to"]), ("1e-6", ["TOO", "fits"])] {
        let error = build(&loaded(&with(h)), &BuildOptions::default()).err();
        let message = error.unwrap_or_else(|| panic!("{h} is no error")).to_string();
        says(&message, &[words[0].trim_start_matches("TOO"), words[1], "touch.toml", "line 21"]);
    }
}

#[test]
fn meshes_that_are_not_closed_are_refused_by_name() {
    write(&folder().join("open.vtu"), &triangle_grid(glam::DVec2::ONE, [2, 2]).unwrap()).unwrap();
    let cut = box_tets(DVec3::ONE, [1, 1, 1]).unwrap();
    write(&folder().join("solid.vtu"), &Mesh { triangles: Vec::new(), ..cut }).unwrap();
    let with = |file: &str| {
        let own = format!("shape = \"mesh\"\nfile = \"{file}\"\nscale = 0.01");
        let text = BALL.replace("shape = \"sphere\"\nradius = 0.015", &own);
        build(&loaded(&format!("{BLOCK}{text}")), &BuildOptions::default()).map(|_| ())
    };
    // the boundary of a solid is closed
    with("solid.vtu").unwrap();
    let message = with("open.vtu").unwrap_err().to_string();
    says(&message, &["line 20, `tool[0].file`", "open.vtu", "not closed"]);
    let message = with("none.vtu").unwrap_err().to_string();
    says(&message, &["line 20", "none.vtu", "check that the path exists"]);
}

#[test]
fn a_pull_takes_hold_draws_and_lets_go() {
    let pull = r#"[[pull]]
name = "hand"
select = { group = "z1" }
stiffness = 40.0
damping = 0.1
translate = [0.0, 0.0, 0.01]
curve = { ramp = [0.05, 0.1] }
from = 0.05
until = 0.2
"#;
    let quantities = probe("pull", "hand", &["pull_force", "pull_distance", "pull_work"]);
    let (summary, rows) = recorded(&format!("{BLOCK}{pull}{quantities}"), "pull");
    assert_eq!(rows[3][..3], [0.0; 3]);
    let held = &rows[20];
    // drawn up, the hand feels it pull down: a spring of 40 N/m
    assert!(held[2] < -0.01 && held[3] > 0.0 && held[3] < 0.01, "{held:?}");
    assert!((held[2] / (-40.0 * held[3]) - 1.0).abs() < 0.05, "{held:?}");
    let end = rows.last().unwrap();
    assert_eq!(end[..4], [0.0; 4]);
    assert!(end[4] > 0.0 && end[4] == held[4], "{end:?} {held:?}");
    let own = &summary.touch.as_ref().unwrap().touched.pulls[0];
    assert!(
        own.vertices == 49 && own.force.peak >= -held[2] && (own.work / end[4] - 1.0).abs() < 1e-8,
        "{summary}"
    );
    says(&summary.to_string(), &["pull hand", "49 vertices of block", "40 N/m"]);

    // the same way as a path
    let path = "path = [[0.05, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0, 0.01]]";
    let own = pull.replace("translate = [0.0, 0.0, 0.01]\ncurve = { ramp = [0.05, 0.1] }", path);
    let other = recorded(&format!("{BLOCK}{own}{quantities}"), "pull_path").1;
    assert!((other[20][2] / held[2] - 1.0).abs() < 1e-9, "{:?} {held:?}", other[20]);
}

#[test]
fn a_grip_holds_what_lifts_off_until_it_opens() {
    let grip = BALL.replace("[0.25, 0.03, 0.03, 0.04]", "[0.25, 0.03, 0.03, 0.035]");
    let quantities = probe("tool", "ball", &["tool_force"]);
    let (_, rows) = recorded(&format!("{BLOCK}{grip}grip = [0.15, 0.28]\n{quantities}"), "grip");
    assert!(rows[15][2] > 0.0, "pressed: {:?}", rows[15]);
    assert!(rows[27][2] < -0.01, "drawn up, it draws back: {:?}", rows[27]);
    assert_eq!(rows[30][..3], [0.0; 3], "let go");
}

#[test]
fn a_tool_touches_what_it_is_told_to_while_it_is_told_to() {
    let quantities = probe("tool", "ball", &["tool_force"]);
    let force =
        |keys: &str, name: &str| recorded(&format!("{BLOCK}{BALL}{keys}\n{quantities}"), name).1;
    let top = force("on = { group = \"z1\" }", "on_top");
    assert!(top[20][2] > 0.01);
    let side = force("on = { group = \"x0\" }", "on_side");
    assert!(side.iter().all(|row| row[2] == 0.0));
    let late = force("from = 0.155\nuntil = 0.185", "late");
    assert!(late[15][2] == 0.0 && late[17][2] > 0.0 && late[19][2] == 0.0, "{late:?}");
}

#[test]
fn a_static_scene_is_pressed_exactly() {
    let text = BLOCK
        .replace("dt = 0.01\nduration = 0.3\n", "mode = \"static\"\nload_steps = 4\n")
        .replace("[solver]\nintegrator = \"safe\"\n", "");
    let tool = "[[tool]]\nname = \"ball\"\nshape = \"sphere\"\nradius = 0.015\nat = [0.03, 0.03, 0.036]\n\
                translate = [0.0, 0.0, -0.004]\nexact = true\n";
    let quantities = probe("tool", "ball", &["tool_force", "tool_depth"]);
    let (_, rows) = recorded(&format!("{text}{tool}{quantities}"), "static");
    let last = rows.last().unwrap();
    assert!(last[2] > 0.05 && last[3] < 1e-8, "{last:?}");
}

#[test]
fn the_old_name_of_friction_is_read_and_told() {
    let check = |keys: &str| {
        let text =
            format!("{BLOCK}{BALL}{keys}\n[[contact]]\nname = \"c\"\nself = \"block\"\n{keys}");
        let scene = LoadedScene::parse(&text, Path::new("friction.toml")).unwrap();
        let built = build(&scene, &BuildOptions::default()).unwrap();
        let told = built.warnings.iter().filter(|w| w.code == "scene.key.renamed");
        ([built.tools[0].friction, built.contacts[0].friction], told.count())
    };
    assert_eq!(check("friction = 0.3"), ([0.3; 2], 0));
    assert_eq!(check("mu = 0.3"), ([0.3; 2], 2));
}

#[test]
fn turns_go_evenly_and_further_than_half_round() {
    let tool = "[[tool]]\nname = \"jaws\"\nhinge = [0, 0, 0]\nhinge_axis = [1, 0, 0]\n\
                parts = [{ shape = \"sphere\", radius = 0.1, jaw = 0.5 }]\n\
                path = [[0.0, 0.0, 0.0, 1.0, 0.0], [4.0, 4.0, 0.0, 1.0, 90.0]]\n\
                turns = [[1.0, 0.0, 0.0, 2.0, 0.0], [3.0, 0.0, 0.0, 1.0, 540.0]]\n";
    let built = build(&loaded(&format!("{BLOCK}{tool}")), &BuildOptions::default()).unwrap();
    let tool = built.simulation.world().get::<Tool>(built.tools[0].entity).unwrap();
    for (time, degrees) in [(0.5, 0.0), (1.5, 135.0), (2.0, 270.0), (2.9, 513.0), (3.5, 540.0)] {
        let pose = tool.wanted(time, ToolPose::default());
        let angle = f64::to_radians(degrees);
        let expected = DVec3::new(angle.cos(), angle.sin(), 0.0);
        assert!((pose.rotation * DVec3::X - expected).length() < 1e-5, "{time}: {pose:?}");
        assert!((pose.position - DVec3::new(time, 0.0, 1.0)).length() < 1e-12);
        assert!((pose.opening - f64::to_radians(22.5 * time)).abs() < 1e-12);
    }
}

/// Entries, the line of the error after those of [`BLOCK`], and words of it.
#[test]
fn what_cannot_touch_is_named_with_line_and_key() {
    let ball = |key: &str| (format!("{BALL}{key}"), 6);
    let tool = |keys: &str| format!("[[tool]]\nname = \"t\"\n{keys}");
    let jaws = "at = [0, 0, 1]\nparts = [{ shape = \"sphere\", radius = 0.1, jaw = 0.5 }]";
    let pull = "[[pull]]\nname = \"hand\"\nselect = { group = \"z1\" }";
    let cases: Vec<((String, usize), &[&str])> = vec![
        (ball("radus = 1.0"), &["unknown key `radus`", "did you mean `radius`?"]),
        (ball("friction = -0.3"), &["`tool[0].friction`", "friction is -0.3", "0 or positive"]),
        (ball("mu = -0.3"), &["`tool[0].mu`", "friction is -0.3", "0 or positive"]),
        (ball("mu = 0.3\nfriction = 0.3"), &["`tool[0].mu`", "`friction` is given", "old name"]),
        (ball("exact = true"), &["`tool[0].exact`", "safe", "newton"]),
        (ball("stiffness = 0.0"), &["stiffness is 0", "positive"]),
        (ball("stiffness_absolute = 1e6\nstiffness = 1.0"), &["`stiffness` is given as well"]),
        (ball("points = \"faces(9)\""), &["faces(9)", "faces(8)"]),
        (ball("points = \"vertx\""), &["`vertx`", "did you mean `vertex`?"]),
        (ball("until = -1.0\nfrom = 0.0"), &["later than `from`"]),
        (ball("grip = [1.0, 0.5]"), &["grip", "ascending"]),
        (ball("opening = 20.0"), &["`opening` for a tool without jaws", "jaw = 0.5"]),
        (ball("at = [0.0, 0.0, 0.0]"), &["`path` is given as well"]),
        (ball("curve = { hold = 1.0 }"), &["without a translation"]),
        (ball("rounding = 0.1"), &["`rounding` for shape \"sphere\"", "`radius`"]),
        (ball("on = { group = \"z2\" }"), &["group `z2`", "z1"]),
        (ball("on = { membrane = true }"), &["`block` has no such faces"]),
        (ball("on = { group = \"z1\", surface = true }"), &["more than one kind"]),
        (ball("turns = [[0.0, 0.0, 0.0, 0.0, 9.0]]"), &["`tool[0].turns[0]`", "no length"]),
        (
            ball("[[probe]]\nname = \"p\"\ntool = \"bal\"\nrecord = [\"tool_force\"]"),
            &["tool `bal`", "`ball`"],
        ),
        (
            ball("[[probe]]\nname = \"p\"\nrecord = [\"tool_force\"]"),
            &["`probe[0].tool`", "name it"],
        ),
        (
            ball("[[probe]]\nname = \"p\"\ntool = \"ball\"\nrecord = [\"min_j\"]"),
            &["no \"tool_...\""],
        ),
        (
            ball("[[probe]]\nname = \"p\"\ntool = \"ball\"\nrecord = [\"tool_other_force\"]"),
            &["`probe[0].record`", "error_bar = true"],
        ),
        (
            ball("[[probe]]\nname = \"p\"\ntool = \"ball\"\nrecord = [\"tool_part_force\"]"),
            &["key `part`", "from 0"],
        ),
        (
            ball("[[probe]]\nname = \"p\"\ntool = \"ball\"\npart = 0\nrecord = [\"tool_force\"]"),
            &["`probe[0].part`", "leave `part` out"],
        ),
        (
            ball(
                "[[probe]]\nname = \"p\"\ntool = \"ball\"\npart = 0\nrecord = [\"tool_part_force\"]",
            ),
            &["`probe[0].part`", "which is of one part"],
        ),
        (ball("[[tool]]\nname = \"ball\""), &["name `ball`", "unique"]),
        ((tool("at = [0, 0, 1]"), 1), &["`tool[0].shape`", "is missing", "half-space"]),
        ((tool("shape = \"sphere\"\nat = [0, 0, 1]"), 1), &["key `radius` is missing"]),
        ((tool("shape = \"sphere\"\nradius = 0.0\nat = [0, 0, 1]"), 4), &["radius is 0 m"]),
        ((tool("shape = \"ball\""), 3), &["unknown choice `ball`", "`sphere`"]),
        (
            (tool("shape = \"box\"\nhalf = [1, 1, 0.1]\nrounding = 0.2\nat = [0, 0, 1]"), 5),
            &["rounding is 0.2 m", "0.1 m"],
        ),
        ((tool("shape = \"half-space\"\nnormal = [0, 0, 0]\nat = [0, 0, 1]"), 4), &["no length"]),
        ((tool("shape = \"sphere\"\nradius = 1.0"), 1), &["`tool[0].at`", "path"]),
        ((tool("shape = \"sphere\"\nradius = 1.0\npath = [[0, 0, 0]]"), 5), &["4 numbers", "5"]),
        (
            (tool("shape = \"sphere\"\nradius = 1.0\npath = [[1, 0, 0, 1], [0, 0, 0, 1]]"), 5),
            &["ascending"],
        ),
        (
            (tool("shape = \"sphere\"\nradius = 1.0\npath = [[1, 0, 0, 1, 9]]"), 5),
            &["opening for a tool without jaws"],
        ),
        ((tool(jaws), 1), &["`tool[0].hinge`", "hinge_axis"]),
        ((tool(&format!("{jaws}\nhinge = [0, 0, 0]\nhinge_axis = [0, 0, 0]")), 6), &["no length"]),
        ((tool(&format!("{jaws}\nshape = \"sphere\"")), 5), &["both `shape` and `parts`"]),
        ((tool("parts = [{ at = [0, 0, 0] }]\nat = [0, 0, 1]"), 3), &["`tool[0].parts[0].shape`"]),
        (
            (tool("shape = \"sphere\"\nradius = 1.0\nat = [0, 0, 1]\ntranslate = [0, 0, nan]"), 6),
            &["not finite"],
        ),
        ((pull.to_string(), 1), &["`stiffness`", "missing"]),
        ((format!("{pull}\nstiffness = -1.0"), 4), &["stiffness is -1 N/m"]),
        ((format!("{pull}\nstiffness = 1.0\ndamping = -1.0"), 5), &["damping is -1 N s/m"]),
        (
            (format!("{pull}\nstiffness = 1.0\ncurve = {{ hold = 1.0 }}"), 5),
            &["without a translation"],
        ),
        (
            (format!("{pull}\nstiffness = 1.0\npath = [[0, 0, 0, 0]]\ntranslate = [0, 0, 0]"), 6),
            &["`path` is given"],
        ),
        (("[[contact]]\nname = \"c\"\nself = \"blok\"".into(), 3), &["body `blok`", "`block`"]),
        (
            ("[[contact]]\nname = \"c\"\nself = \"block\"\nfriction = -1.0".into(), 4),
            &["friction is -1"],
        ),
        (("[[contact]]\nname = \"c\"".into(), 1), &["exactly one of `bodies` and `self`"]),
        (
            ("[[contact]]\nname = \"c\"\nbodies = [\"block\", \"block\"]".into(), 3),
            &["the same body", "self"],
        ),
    ];
    build(&loaded(&format!("{BLOCK}{BALL}")), &BuildOptions::default()).unwrap();
    for ((entry, line), words) in cases {
        let text = format!("{BLOCK}{entry}\n");
        let file = folder().join("touch.toml");
        let result = LoadedScene::parse(&text, &file)
            .and_then(|scene| build(&scene, &BuildOptions::default()).map(|_| ()));
        let message = result.expect_err(&entry).to_string();
        says(&format!("{entry}: {message}"), words);
        let lines: Vec<usize> = (line..=line + 3).map(|l| l + 16).collect();
        let on = |l: &usize| message.contains(&format!("touch.toml, line {l}, "));
        assert!(lines.iter().any(on), "{entry}: {lines:?}: {message}");
    }
}

/// And what starts outside of one is told.
#[test]
fn cavities_without_an_inside_are_named() {
    let built = |keys: &str| {
        let text = format!("{BLOCK}[[tool]]\nname = \"t\"\nat = [0.03, 0.03, 0.0]\n{keys}\n");
        build(&loaded(&text), &BuildOptions::default())
    };
    let refused = |keys: &str| built(keys).err().unwrap().to_string();
    let found = refused("shape = \"half-space\"\ncavity = true");
    says(&found, &["line 21, ", "`tool[0].cavity`", "no inside", "turn its `normal` round"]);
    let found = refused("parts = [{ shape = \"sphere\", radius = 1 }]\ncavity = true");
    says(&found, &["both `cavity` and `parts`"]);
    let scene = built("shape = \"sphere\"\nradius = 0.02\ncavity = true").unwrap();
    let told: Vec<String> = scene.warnings.iter().map(|w| format!("{w:?}")).collect();
    says(&told.join("\n"), &["scene.tool.inside", "are outside of it", "say `on` which it holds"]);
    let scene = built("shape = \"sphere\"\nradius = 1.0\ncavity = true").unwrap();
    assert!(!scene.warnings.iter().any(|w| w.subject == "tool `t`"), "{:?}", scene.warnings);
}

#[test]
fn tools_are_refused_where_they_would_do_nothing() {
    let text = BLOCK.replace("dt = 0.01", "backend = \"gpu\"\ndt = 0.01");
    let contact = "[[contact]]\nname = \"c\"\nself = \"block\"\n";
    for (entry, kind) in [(BALL, "[[tool]]"), (contact, "[[contact]]")] {
        let message = build(&loaded(&format!("{text}{entry}")), &BuildOptions::default());
        says(&message.err().unwrap().to_string(), &["line 3, `backend`", kind, "use "]);
    }
    let still = BLOCK
        .replace("dt = 0.01\nduration = 0.3\n", "mode = \"static\"\n")
        .replace("[solver]\nintegrator = \"safe\"\n", "");
    for key in ["from = 0.0", "grip = [0.0, 1.0]", "turns = [[0.0, 1.0, 0.0, 0.0, 9.0]]"] {
        let tool = format!(
            "[[tool]]\nname = \"t\"\nshape = \"sphere\"\nradius = 0.01\nat = [0.03, 0.03, 0.04]\n{key}\n"
        );
        let message = build(&loaded(&format!("{still}{tool}")), &BuildOptions::default());
        says(&message.err().unwrap().to_string(), &["in a static scene", "leave it out"]);
    }
    let message = build(&loaded(&format!("{still}{BALL}")), &BuildOptions::default());
    says(&message.err().unwrap().to_string(), &["`path` in a static scene"]);
}

/// Peaks are those of steps that converged; the others are counted, and marked in the CSV.
#[test]
fn peaks_leave_out_what_did_not_converge() {
    let text = BLOCK.replace("\"safe\"", "\"newton\"\nmax_newton_iterations = 4")
        + BALL
        + &probe("tool", "ball", &["tool_force"]);
    let out = folder().join("peaks");
    let options = RunOptions { out: Some(out.clone()), ..RunOptions::default() };
    let summary = run(&loaded(&text), &options, &mut Silent).unwrap();
    let csv = std::fs::read_to_string(out.join("block.csv")).unwrap();
    let mut lines = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let column = |name: &str| head.iter().position(|own| own.starts_with(name)).unwrap();
    let (mark, x) = (column("forces_unconverged"), column("p.tool_force_x"));
    let (mut marked, mut peak) = (0, 0.0_f64);
    for row in lines {
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        let force = DVec3::new(number(x), number(x + 1), number(x + 2));
        if number(mark) == 0.0 {
            peak = peak.max(force.length());
        } else {
            marked += 1;
        }
    }
    let force = &summary.touch.as_ref().unwrap().touched.tools[0].force;
    assert!(marked > 0 && force.unconverged == marked, "{marked}, {summary}");
    assert!((force.peak / peak - 1.0).abs() < 1e-6, "{} {peak}", force.peak);
    says(&summary.to_string(), &["steps that did not converge", "run.contact.forces"]);
}
