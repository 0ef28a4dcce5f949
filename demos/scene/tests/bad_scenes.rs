//! Whatever is wrong with a scene is said before the first step: where, what, and what to do.

use crate::common::says;
use glam::DVec3;
use sinew::engine::connectivity::ByKind;
use sinew::engine::mesh::CellData;
use sinew::engine::mesh::generate::box_tets;
use sinew::models::axes::field::to_cell_data;
use sinew::models::body::Model;
use sinew::models::body::sheet::MembraneModel;
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::check::{CheckSummary, check_file};
use sinew_scene::error::{SceneError, SceneProblem};
use sinew_scene::mesh_tool::write;
use sinew_scene::probe::PROBES;
use sinew_scene::scene::{LoadedScene, Scene};
use sinew_scene::scene_folder;
use sinew_scene::schema::schema;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const GOOD: &str = r#"name = "beam"
gravity = [0.0, 0.0, -9.81]
dt = 0.01
duration = 0.1

[solver]
integrator = "safe"

[[body]]
name = "beam"
generate = { box = { size = [0.2, 0.04, 0.04], cells = [4, 1, 1] } }
material = { young_modulus = 1e5, poisson_ratio = 0.4, density = 1000.0 }

[[constraint]]
name = "clamp"
select = { group = "x0" }

[[load]]
name = "end"
select = { group = "x1" }
force = [0.0, 0.0, -0.1]
curve = { ramp = [0.0, 0.05] }

[[probe]]
name = "tip"
select = { group = "x1" }
record = ["mean_displacement"]
"#;

fn attempt(text: &str) -> Result<(), SceneError> {
    let file = scene_folder().join("bad.toml");
    let scene = LoadedScene::parse(text, &file)?;
    build(&scene, &BuildOptions { threads: Some(1), ..Default::default() }).map(|_| ())
}

/// Replaces one piece of the good scene; the error is of the given kind, stands on the line of the
/// replacement (0: no line) and has all the words.
fn check(from: &str, to: &str, kind: fn(&SceneProblem) -> bool, line: usize, words: &[&str]) {
    assert_eq!(GOOD.matches(from).count(), 1, "`{from}` must occur once");
    let text = GOOD.replace(from, to);
    let error = attempt(&text).expect_err(to);
    let message = error.to_string();
    let SceneError::At { problem, .. } = error else { panic!("{to}: {error:?}") };
    assert!(kind(&problem), "{to}: unexpected kind of error: {problem:?}");
    assert!(message.contains("bad.toml"), "{message}");
    if line > 0 {
        assert!(
            message.contains(&format!("line {line},"))
                || message.contains(&format!("line {line}:")),
            "{to}: line {line} is not in: {message}"
        );
    }
    says(&format!("{to}: {message}"), words);
}

#[test]
fn the_good_scene_is_good() {
    attempt(GOOD).unwrap();
}

macro_rules! bad {
    ($($name:ident: $from:expr => $to:expr, $kind:pat, $line:expr, $words:expr;)*) => {$(
        #[test]
        fn $name() {
            check($from, $to, |e| matches!(e, $kind), $line, &$words);
        }
    )*};
}

use SceneProblem::*;

const SHAPE: &str = "generate = { box = { size = [0.2, 0.04, 0.04], cells = [4, 1, 1] } }";
const MATERIAL: &str = "{ young_modulus = 1e5, poisson_ratio = 0.4, density = 1000.0 }";

bad! {
    unknown_key_at_the_top: "dt = 0.01" => "dt = 0.01\ngravitiy = [0.0, 0.0, 0.0]",
        Unknown { .. }, 4, ["`gravitiy`", "did you mean `gravity`?"];
    unknown_key_of_a_material: "young_modulus" => "youngs_modulus",
        Unknown { .. }, 12, ["`body[0].material`", "`youngs_modulus`", "did you mean `young_modulus`?"];
    unknown_key_of_a_constraint: "select = { group = \"x0\" }" => "selection = { group = \"x0\" }",
        Unknown { .. }, 16, ["`constraint[0]`", "`selection`", "did you mean `select`?"];
    unknown_integrator: "\"safe\"" => "\"netwon\"",
        Unknown { .. }, 7, ["`netwon`", "did you mean `newton`?"];
    unknown_executor: "dt = 0.01" => "dt = 0.01\nexecutor = \"mutli\"",
        Unknown { .. }, 4, ["`mutli`", "did you mean `multi`?"];
    unknown_instruction_set: "dt = 0.01" => "dt = 0.01\ninstruction_set = \"avx\"",
        Unknown { .. }, 4, ["`avx`", "did you mean `avx2`"];
    negative_modulus_of_an_angle: "[[constraint]]"
        => "[[body.fibres]]\nname = \"a\"\nmodulus = 1.0\ndirection = [1, 0, 0]\n\
            [[body.fibres]]\nname = \"b\"\nmodulus = 1.0\ndirection = [0, 1, 0]\n[body.axes]\n\
            angles = [{ between = [\"a\", \"b\"], modulus = 1.0 },\n\
            { between = [\"b\", \"a\"], modulus = -1.0 }]\n[[constraint]]",
        Axes { .. }, 24, ["`body[0].axes.angles[1].modulus`", "-1 Pa"];
    negative_modulus_of_volume: "[[constraint]]"
        => "[body.axes]\nvolume_modulus = -2.0\n[[constraint]]",
        Axes { .. }, 15, ["`body[0].axes.volume_modulus`", "-2 Pa"];
    pressure_named_twice: "[[probe]]"
        => "[[pressure]]\nname = \"p\"\non = { surface = true }\npressure = 1.0\n\
            [[pressure]]\nname = \"p\"\non = { surface = true }\npressure = 1.0\n[[probe]]",
        Duplicate { .. }, 29, ["`p`", "pressure"];
    unknown_quantity: "[\"mean_displacement\"]" => "[\"displacement\"]",
        Unknown { .. }, 27, ["`mean_displacement`"];
    not_toml: "dt = 0.01" => "dt = = 0.01", Syntax { .. }, 3, ["extra `=`"];
    wrong_type: "dt = 0.01" => "dt = \"fast\"", Syntax { .. }, 3, ["`dt`", "string", "a number"];
    vector_too_short: "gravity = [0.0, 0.0, -9.81]" => "gravity = [0.0, 0.0]",
        Syntax { .. }, 2, ["`gravity`", "length 2"];
    no_name: "name = \"beam\"\ngravity" => "gravity", Missing { .. }, 1, ["key `name`"];
    no_name_of_a_body: "[[body]]\nname = \"beam\"" => "[[body]]",
        Missing { .. }, 9, ["`body[0]`", "key `name`"];
    misspelt_group: "\"x0\"" => "\"xx0\"",
        Unknown { .. }, 16, ["did you mean `x0`", "groups of the mesh"];
    no_dt: "dt = 0.01\n" => "", Missing { .. }, 0, ["dt", "step length"];
    zero_dt: "dt = 0.01" => "dt = 0.0", Value { .. }, 3, ["dt is 0 s", "positive"];
    nan_dt: "dt = 0.01" => "dt = nan", Value { .. }, 3, ["NaN", "positive"];
    dt_longer_than_duration: "dt = 0.01" => "dt = 1.0", Value { .. }, 3, ["longer", "shorter step"];
    infinite_duration: "duration = 0.1" => "duration = inf", Value { .. }, 4, ["duration"];
    infinite_gravity: "-9.81" => "-inf", Value { .. }, 2, ["gravity", "finite"];
    missing_mesh: SHAPE => "mesh = \"nowhere.msh\"", Mesh { .. }, 11, ["nowhere.msh", "check that the path exists"];
    no_mesh: "generate = { box = { size = [0.2, 0.04, 0.04], cells = [4, 1, 1] } }\n" => "",
        Missing { .. }, 9, ["mesh", "generate"];
    not_a_mesh: SHAPE => "mesh = \"README.md\"", Mesh { .. }, 11, ["README.md", "format"];
    flat_box: "0.2, 0.04, 0.04" => "0.2, 0.0, 0.04", Mesh { .. }, 11, ["size.y = 0"];
    box_graded_too_far: "[4, 1, 1]" => "[4, 1, 1], grading = [1.0, 9.0, 1.0]", Mesh { .. }, 11, ["grading[1] = 9", "0.25 to 4"];
    box_without_cells: "[4, 1, 1]" => "[4, 0, 1]", Mesh { .. }, 11, ["cells[1]"];
    two_shapes: "{ box =" => "{ sphere = { radius = 1.0, shells = 2 }, box =",
        Value { .. }, 11, ["exactly one shape"];
    glue_that_pushes: SHAPE => "generate = { box = { size = [0.2, 0.04, 0.04], cells = [4, 1, 1] } }\nglue = -1.0",
        Body(_), 12, ["glue is -1", "0 or positive"];
    cut_with_one_position: "[[probe]]"
        => "[[cut]]\nname = \"cut\"\ntime = 0.0\nstrip = [[[0, 0, 1], [0, 0, 0]]]\n\n[[probe]]", Value { .. }, 27, ["1 position(s)", "two at least"];
    cut_without_a_blade: "[[probe]]"
        => "[[cut]]\nname = \"cut\"\ntime = 0.0\nstrip = [[[0, 0, 1], [0, 0, 1]], [[1, 0, 1], [1, 0, 1]]]\n\n[[probe]]", Value { .. }, 27, ["without length", "different ends"];
    cut_before_the_start: "[[probe]]"
        => "[[cut]]\nname = \"cut\"\ntime = -1.0\nstrip = [[[0, 0, 1], [0, 0, 0]], [[1, 0, 1], [1, 0, 0]]]\n\n[[probe]]", Value { .. }, 26, ["time"];
    thread_through_nothing: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.2]]\nstiffness = 9.0\n\n[[probe]]", Value { .. }, 26, ["no solid element of `beam`", "inside of a body"];
    thread_without_stiffness: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 0.0\n\n[[probe]]", Value { .. }, 27, ["stiffness", "positive"];
    thread_of_one_point: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02]]\nstiffness = 9.0\n\n[[probe]]", Value { .. }, 24, ["two points"];
    thread_drawn_where_it_is_free: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 9.0\ntails = [0.0, 0.1]\ndrawn = [[0.0, 0.0], [0.1, 0.01]]\n\n[[probe]]", Value { .. }, 24, ["end that is free", "no tail"];
    thread_with_two_hands: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02]]\nstiffness = 9.0\nhand = [0.0, 0.0, 1.0]\npath = [[0.0, 0.0, 0.0, 1.0]]\n\n[[probe]]", Value { .. }, 28, ["`path` is given as well"];
    thread_of_no_needle: "[[probe]]"
        => "[[thread]]\nname = \"t\"\nneedle = \"awl\"\nstiffness = 9.0\ntails = [0.1, 0.0]\n\n[[probe]]", Unknown { .. }, 26, ["`awl`"];
    thread_held_where_it_is_knotted: "[[probe]]"
        => "[[thread]]\nname = \"t\"\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 9.0\nheld = 0.1\n\n[[probe]]", Value { .. }, 28, ["first tail"];
    clip_that_breaks_at_once: "[[probe]]"
        => "[[clip]]\nname = \"c\"\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 9.0\nstrength = -1.0\n\n[[probe]]", Value { .. }, 28, ["strength is -1", "positive"];
    clip_of_one_body_of_two: "[[probe]]"
        => "[[clip]]\nname = \"c\"\nbodies = [\"beam\"]\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 9.0\n\n[[probe]]", Value { .. }, 26, ["1 bodies for 2 points"];
    clip_of_an_unknown_body: "[[probe]]"
        => "[[clip]]\nname = \"c\"\nbodies = [\"beam\", \"bean\"]\npoints = [[0.1, 0.02, 0.02], [0.1, 0.02, 0.03]]\nstiffness = 9.0\n\n[[probe]]", Unknown { .. }, 26, ["bean", "beam"];
    resection_of_nothing: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\n\n[[probe]]", Value { .. }, 24, ["exactly one kind of resection"];
    resection_of_two_kinds: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\nstrain = 0.5\nstress = 1e3\n\n[[probe]]", Value { .. }, 24, ["exactly one kind of resection"];
    resection_of_a_tetrahedron_that_is_not_there: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\ntetrahedra = [3, 24]\n\n[[probe]]", Value { .. }, 26, ["no tetrahedron 24", "it has 24"];
    resection_of_a_tetrahedron_twice: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\ntetrahedra = [3, 3]\n\n[[probe]]", Value { .. }, 26, ["tetrahedron 3 comes twice"];
    resection_of_a_triangle_without_membrane: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\ntriangles = [0]\n\n[[probe]]", Value { .. }, 26, ["no membrane triangle 0", "it has 0"];
    resection_with_a_bad_limit: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\nstrain = -1.0\n\n[[probe]]", Value { .. }, 26, ["strain is -1", "positive"];
    resection_with_a_path_back_in_time: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\ntool = { radius = 0.01, path = [[1.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0]] }\n\n[[probe]]", Value { .. }, 26, ["follows time 1 s", "ascending"];
    resection_with_an_end_that_never_counts: "[[probe]]"
        => "[[resection]]\nname = \"cut\"\ntetrahedra = [3]\nuntil = 1.0\n\n[[probe]]", Value { .. }, 27, ["`until`", "leave it out"];
    negative_young_modulus: "1e5" => "-1e5",
        Material { .. }, 12, ["young_modulus", "-100000 Pa", "positive"];
    incompressible: "poisson_ratio = 0.4" => "poisson_ratio = 0.5",
        Material { .. }, 12, ["poisson_ratio", "below 0.5"];
    no_density: "1000.0" => "0.0", Material { .. }, 12, ["density is 0", "positive"];
    incomplete_material: MATERIAL => "{ young_modulus = 1e5, density = 1000.0 }",
        Missing { .. }, 12, ["poisson_ratio", "preset"];
    unknown_preset: MATERIAL => "{ preset = \"livre\" }",
        Material { .. }, 12, ["'livre'", "did you mean 'liver'?"];
    unknown_group: "\"x0\"" => "\"left\"",
        Unknown { .. }, 16, ["group `left`", "x0", "x1", "z1"];
    empty_selection: "{ group = \"x0\" }" => "{ sphere = { centre = [9.0, 0.0, 0.0], radius = 0.1 } }",
        EmptySelection { .. }, 16, ["beam", "reaches from"];
    crossed_box: "{ group = \"x0\" }" => "{ box = { min = [1.0, 0.0, 0.0], max = [0.0, 1.0, 1.0] } }",
        Value { .. }, 16, ["exchange"];
    cylinder_without_axis: "{ group = \"x0\" }"
        => "{ cylinder = { start = [0.0, 0.0, 0.0], end = [0.0, 0.0, 0.0], radius = 0.1 } }",
        Value { .. }, 16, ["`constraint[0].select.cylinder`", "no axis"];
    half_space_without_normal: "{ group = \"x0\" }"
        => "{ half_space = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 0.0] } }",
        Value { .. }, 16, ["`constraint[0].select.half_space`", "normal is 0"];
    patch_of_nothing: "{ group = \"x0\" }" => "{ patch = { angle = 20.0 } }",
        Value { .. }, 16, ["`constraint[0].select.patch`", "`near`, `normal` or both"];
    patch_without_faces: "{ group = \"x0\" }" => "{ patch = { normal = [1.0, 1.0, 1.0], angle = 5.0 } }",
        EmptySelection { .. }, 16, ["make `angle` larger"];
    two_selections: "{ group = \"x0\" }" => "{ group = \"x0\", all = true }",
        Value { .. }, 16, ["exactly one"];
    index_out_of_range: "{ group = \"x0\" }" => "{ vertices = [0, 20] }",
        VertexIndex { .. }, 16, ["vertex 20", "20 vertices"];
    negative_index: "{ group = \"x0\" }" => "{ vertices = [-1] }", Syntax { .. }, 16, ["-1"];
    unknown_body: "name = \"clamp\"" => "name = \"clamp\"\nbody = \"baem\"",
        Unknown { .. }, 16, ["body `baem`", "did you mean `beam`?"];
    overlapping_names: "name = \"end\"" => "name = \"clamp\"", Duplicate { .. }, 19, ["`clamp`"];
    curve_backwards: "[0.0, 0.05]" => "[0.05, 0.05]",
        Value { .. }, 22, ["ramp", "ascending"];
    two_curves: "{ ramp = [0.0, 0.05] }" => "{ ramp = [0.0, 0.05], hold = 1.0 }",
        Value { .. }, 22, ["exactly one"];
    curve_without_motion: "name = \"clamp\"" => "name = \"clamp\"\ncurve = { hold = 1.0 }",
        Value { .. }, 16, ["motion"];
    never_active: "name = \"clamp\"" => "name = \"clamp\"\nfrom = 2.0\nuntil = 1.0",
        Value { .. }, 17, ["later"];
    unknown_axis: "name = \"clamp\"" => "name = \"clamp\"\naxes = \"xw\"",
        Value { .. }, 16, ["\"xw\""];
    rotation_without_axis: "name = \"clamp\""
        => "name = \"clamp\"\nmotion = { rotate = { centre = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 0.0], \
            degrees = 90.0 } }",
        Value { .. }, 16, ["axis", "direction"];
    infinite_force: "-0.1]" => "nan]", Value { .. }, 21, ["force", "finite"];
    load_of_nothing: "select = { group = \"x1\" }\nforce = [0.0, 0.0, -0.1]" => "",
        Missing { .. }, 18, ["`force` (N) with `select`", "`traction`"];
    traction_without_faces: "select = { group = \"x1\" }\nforce = [0.0, 0.0, -0.1]"
        => "traction = [0.0, 0.0, 1.0]", Missing { .. }, 18, ["key `on`"];
    faces_without_traction: "select = { group = \"x1\" }\nforce = [0.0, 0.0, -0.1]"
        => "on = { group = \"x1\" }", Missing { .. }, 18, ["key `traction`"];
    force_without_selection: "select = { group = \"x1\" }\nforce" => "force",
        Missing { .. }, 18, ["key `select`"];
    force_and_traction: "force = [0.0, 0.0, -0.1]"
        => "force = [0.0, 0.0, -0.1]\ntraction = [0.0, 0.0, 1.0]",
        Value { .. }, 22, ["both kinds of loads"];
    infinite_traction: "select = { group = \"x1\" }\nforce = [0.0, 0.0, -0.1]"
        => "on = { group = \"x1\" }\ntraction = [0.0, inf, 1.0]",
        Value { .. }, 21, ["traction", "finite"];
    rim_of_a_solid: "select = { group = \"x1\" }\nforce = [0.0, 0.0, -0.1]"
        => "on = { rim = \"x1\" }\ntraction = [0.0, 0.0, 1.0]",
        Value { .. }, 20, ["rim of a membrane", "`group`"];
    pressure_on_a_rim: "[[probe]]"
        => "[[pressure]]\nname = \"p\"\non = { rim = \"x1\" }\npressure = 1.0\n[[probe]]",
        Value { .. }, 26, ["a rim is no face"];
    fibres_along_their_second_axis: "[[constraint]]"
        => "[[body.fibres]]\nname = \"a\"\nmodulus = 1.0\ndirection = [1, 2, 0]\n\
            across = [1.0, 2.0]\ntowards = [-2, -4, 0]\n[[constraint]]",
        Fibres { .. }, 19, ["element 0", "no second axis"];
    negative_modulus_across: "[[constraint]]"
        => "[[body.fibres]]\nname = \"a\"\nmodulus = 1.0\ndirection = [1, 2, 0]\n\
            across = [1.0, -2.0]\n[[constraint]]",
        Axes { .. }, 18, ["`body[0].fibres[0].across`", "`a_3`", "-2 Pa"];
    second_axis_of_nothing: "[[constraint]]"
        => "[[body.fibres]]\nname = \"a\"\nmodulus = 1.0\ndirection = [1, 2, 0]\n\
            towards = [1, 0, 0]\n[[constraint]]",
        Value { .. }, 18, ["`across`"];
    negative_tolerance: "integrator = \"safe\"" => "linear_tolerance = -1.0",
        Setting { .. }, 7, ["linear_tolerance = -1"];
    damped_explicit: "integrator = \"safe\""
        => "stiffness_damping = 0.1\nintegrator = \"symplectic-euler\"",
        Setting { .. }, 7, ["stiffness_damping", "mass_damping"];
    reaction_of_nothing: "[\"mean_displacement\"]" => "[\"reaction\"]",
        Missing { .. }, 24, ["constraint"];
    nothing_recorded: "[\"mean_displacement\"]" => "[]", Value { .. }, 27, ["nothing to record"];
    load_steps_in_a_dynamic_scene: "dt = 0.01" => "dt = 0.01\nload_steps = 3",
        Value { .. }, 4, ["load_steps", "static"];
    dt_in_a_static_scene: "name = \"beam\"\ngravity" => "name = \"beam\"\nmode = \"static\"\ngravity",
        Value { .. }, 4, ["dt", "leave it out"];
    no_body: GOOD => "name = \"empty\"\ndt = 0.1\nduration = 1.0\n", Missing { .. }, 0, ["[[body]]"];
}

const STATIC: &str = r#"name = "beam"
mode = "static"

[[body]]
name = "beam"
generate = { box = { size = [0.2, 0.04, 0.04], cells = [4, 1, 1] } }
material = { preset = "liver" }
"#;

#[test]
fn a_static_scene_must_be_held_and_has_no_time() {
    let error = attempt(STATIC).unwrap_err();
    assert!(matches!(error, SceneError::At { problem: NotHeld { .. }, .. }));
    let message = error.to_string();
    assert!(message.contains("line 5") && message.contains("x, y, z"), "{message}");

    let clamp = "[[constraint]]\nname = \"clamp\"\nselect = { group = \"x0\" }\n";
    attempt(&format!("{STATIC}{clamp}")).unwrap();
    let only_z = format!("{STATIC}{clamp}axes = \"z\"\n");
    assert!(attempt(&only_z).unwrap_err().to_string().contains("along x, y;"));
    let one_vertex = format!("{STATIC}{clamp}").replace("group = \"x0\"", "vertices = [0]");
    assert!(attempt(&one_vertex).unwrap_err().to_string().contains("rotation"));
    let timed = format!("{STATIC}{clamp}until = 1.0\n");
    assert!(attempt(&timed).unwrap_err().to_string().contains("static scene"));
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let error = LoadedScene::read("no/such/scene.toml".as_ref()).unwrap_err();
    assert!(matches!(error, SceneError::Io { .. }));
    assert!(error.to_string().contains("no/such/scene.toml"));
}

#[test]
fn what_is_repaired_or_unintended_is_a_warning() {
    let text = GOOD.replace("young_modulus = 1e5", "young_modulus = 25.0").replace(
        "[[load]]",
        "[[constraint]]\nname = \"again\"\nselect = { vertices = [0] }\n\
             motion = { translate = [0.0, 0.0, 0.1] }\n\n[[load]]",
    );
    let file = scene_folder().join("odd.toml");
    let scene = LoadedScene::parse(&text, &file).unwrap();
    let built = build(&scene, &BuildOptions::default()).unwrap();
    let warnings = built.all_warnings();
    let codes: Vec<&str> = warnings.iter().map(|w| w.code.as_str()).collect();
    for code in ["material.young.kilopascal", "scene.constraint.overlap", "scene.motion.jump"] {
        assert!(codes.contains(&code), "{codes:?}");
    }
    assert!(warnings.iter().all(|w| !w.remedy.is_empty()));
}

/// Planes, cylinders and patches choose the vertices of the group of a side, and faces of it.
#[test]
fn places_choose_what_a_group_does() {
    let built = |select: &str, on: &str| {
        let text = GOOD.replace("{ group = \"x0\" }", select)
            + &format!("[[pressure]]\nname = \"p\"\non = {on}\npressure = 1.0\n");
        let scene = LoadedScene::parse(&text, &scene_folder().join("good.toml")).unwrap();
        let built =
            build(&scene, &BuildOptions { threads: Some(1), ..Default::default() }).unwrap();
        (built.constraints[0].vertices.clone(), built.pressures[0].summary.triangles)
    };
    let expected = built("{ group = \"x0\" }", "{ group = \"x0\" }");
    assert_eq!(expected.1, 2);
    for select in [
        "{ half_space = { point = [0.01, 0.0, 0.0], normal = [-2.0, 0.0, 0.0] } }",
        "{ cylinder = { start = [-0.01, 0.02, 0.02], end = [0.0, 0.02, 0.02], radius = 0.03 } }",
        "{ patch = { near = [-0.1, 0.02, 0.02] } }",
        "{ patch = { normal = [-1.0, 0.0, 0.0] } }",
    ] {
        assert_eq!(
            built(select, "{ patch = { normal = [-1.0, 0.0, 0.0] } }"),
            expected,
            "{select}"
        );
    }
}

/// Keys that the model knows at a place: an unknown one makes serde list them.
fn keys_of(text: &str) -> BTreeSet<String> {
    let message = toml::from_str::<Scene>(text).unwrap_err().message().to_string();
    assert!(message.starts_with("unknown field `zzz`"), "{text}: {message}");
    message.split('`').skip(3).step_by(2).map(str::to_owned).collect()
}

#[test]
fn the_readme_lists_exactly_the_keys_that_exist() {
    let body = "name = \"a\"\n[[body]]\nname = \"b\"\n";
    let fibres = format!("{body}[[body.fibres]]\nname = \"c\"\n");
    let constraint = "name = \"a\"\n[[constraint]]\nname = \"b\"\n";
    let load = "name = \"a\"\n[[load]]\nname = \"b\"\n";
    let pressure = "name = \"a\"\n[[pressure]]\nname = \"b\"\n";
    let resection = "name = \"a\"\n[[resection]]\nname = \"b\"\n";
    let tool = "name = \"a\"\n[[tool]]\nname = \"b\"\n";
    let sections = [
        ("scene", "zzz = 1".to_string()),
        ("[solver]", "name = \"a\"\n[solver]\nzzz = 1".into()),
        ("[[body]]", format!("{body}zzz = 1")),
        ("generate", format!("{body}generate = {{ zzz = 1 }}")),
        ("generate.box", format!("{body}generate = {{ box = {{ zzz = 1 }} }}")),
        ("generate.cylinder", format!("{body}generate = {{ cylinder = {{ zzz = 1 }} }}")),
        ("generate.sphere", format!("{body}generate = {{ sphere = {{ zzz = 1 }} }}")),
        ("generate.sheet", format!("{body}generate = {{ sheet = {{ zzz = 1 }} }}")),
        ("generate.specimen", format!("{body}generate = {{ specimen = {{ zzz = 1 }} }}")),
        ("generate.disc", format!("{body}generate = {{ disc = {{ zzz = 1 }} }}")),
        ("generate.balloon", format!("{body}generate = {{ balloon = {{ zzz = 1 }} }}")),
        ("generate.tube", format!("{body}generate = {{ tube = {{ zzz = 1 }} }}")),
        ("generate.cup", format!("{body}generate = {{ cup = {{ zzz = 1 }} }}")),
        ("[[body.fibres]]", format!("{fibres}zzz = 1")),
        ("azimuth_elevation", format!("{fibres}azimuth_elevation = {{ zzz = 1 }}")),
        ("laplace", format!("{fibres}laplace = {{ zzz = 1 }}")),
        ("circular", format!("{fibres}circular = {{ zzz = 1 }}")),
        ("hemicircular", format!("{fibres}hemicircular = {{ zzz = 1 }}")),
        ("helicoidal", format!("{fibres}helicoidal = {{ zzz = 1 }}")),
        ("random", format!("{fibres}random = {{ zzz = 1 }}")),
        ("muscle", format!("{fibres}muscle = {{ zzz = 1 }}")),
        ("[body.axes]", format!("{body}[body.axes]\nzzz = 1")),
        ("angles", format!("{body}[body.axes]\nangles = [{{ zzz = 1 }}]")),
        ("membrane", format!("{body}membrane = {{ zzz = 1 }}")),
        ("[[pressure]]", format!("{pressure}zzz = 1")),
        ("on", format!("{pressure}on = {{ zzz = 1 }}")),
        ("tear", format!("{body}tear = {{ zzz = 1 }}")),
        ("rotate", format!("{body}rotate = {{ zzz = 1 }}")),
        ("material", format!("{body}material = {{ zzz = 1 }}")),
        ("select", format!("{constraint}select = {{ zzz = 1 }}")),
        ("select.box", format!("{constraint}select = {{ box = {{ zzz = 1 }} }}")),
        ("select.sphere", format!("{constraint}select = {{ sphere = {{ zzz = 1 }} }}")),
        ("select.cylinder", format!("{constraint}select = {{ cylinder = {{ zzz = 1 }} }}")),
        ("select.half_space", format!("{constraint}select = {{ half_space = {{ zzz = 1 }} }}")),
        ("select.patch", format!("{constraint}select = {{ patch = {{ zzz = 1 }} }}")),
        ("[[constraint]]", format!("{constraint}zzz = 1")),
        ("motion", format!("{constraint}motion = {{ zzz = 1 }}")),
        ("motion.rotate", format!("{constraint}motion = {{ rotate = {{ zzz = 1 }} }}")),
        ("[[load]]", format!("{load}zzz = 1")),
        ("curve", format!("{load}curve = {{ zzz = 1 }}")),
        ("curve.sine", format!("{load}curve = {{ sine = {{ zzz = 1 }} }}")),
        ("[[tool]]", format!("{tool}zzz = 1")),
        ("tool.parts", format!("{tool}parts = [{{ zzz = 1 }}]")),
        ("tool.edge", format!("{tool}edge = {{ zzz = 1 }}")),
        ("tool.edge.flanks", format!("{tool}edge = {{ flanks = {{ zzz = 1 }} }}")),
        ("tool.needle", format!("{tool}needle = {{ zzz = 1 }}")),
        ("tool.on", format!("{tool}on = {{ zzz = 1 }}")),
        ("[[pull]]", "name = \"a\"\n[[pull]]\nname = \"b\"\nzzz = 1".into()),
        ("[[contact]]", "name = \"a\"\n[[contact]]\nname = \"b\"\nzzz = 1".into()),
        ("[[thread]]", "name = \"a\"\n[[thread]]\nname = \"b\"\nzzz = 1".into()),
        ("[[clip]]", "name = \"a\"\n[[clip]]\nname = \"b\"\nzzz = 1".into()),
        ("[[resection]]", format!("{resection}zzz = 1")),
        ("[[cut]]", "name = \"a\"\n[[cut]]\nname = \"b\"\nzzz = 1".into()),
        ("tool", format!("{resection}tool = {{ zzz = 1 }}")),
        ("[[probe]]", "name = \"a\"\n[[probe]]\nzzz = 1".into()),
        ("[output]", "name = \"a\"\n[output]\nzzz = 1".into()),
    ];
    let readme = std::fs::read_to_string(scene_folder().join("README.md")).unwrap();
    let documented = |title: &str| -> BTreeSet<String> {
        let heading = format!("### `{title}`\n");
        let start = readme.find(&heading).unwrap_or_else(|| panic!("no section {title}"));
        let text = &readme[start + heading.len()..];
        let text = &text[..text.find("\n### ").unwrap_or(text.len())];
        let rows = text.lines().filter_map(|line| line.strip_prefix("| `"));
        rows.map(|row| row.split('`').next().unwrap().to_owned()).collect()
    };
    let probes = PROBES.iter().map(|probe| probe.key);
    for name in
        probes.chain(Model::ALL.map(Model::name)).chain(MembraneModel::ALL.map(MembraneModel::name))
    {
        assert!(
            readme.contains(&format!("`\"{name}\"`")),
            "{name} is not in demos/scenes/README.md"
        );
    }
    for (title, text) in &sections {
        assert_eq!(documented(title), keys_of(text), "section {title} of demos/scenes/README.md");
    }
    assert_eq!(readme.matches("\n### `").count(), sections.len());
}

/// The good scene with fibres and axes after its body.
fn with_fibres(fibres: &str) -> String {
    GOOD.replace("[[constraint]]", &format!("[[body.fibres]]\n{fibres}\n\n[[constraint]]"))
}

const FIBRES: &str = "name = \"a\"\nmodulus = 1e4\ndirection = [1.0, 0.0, 0.0]";

#[test]
fn fibres_that_cannot_be_used_are_named_with_line_and_key() {
    attempt(&with_fibres(FIBRES)).unwrap();
    let twice = format!("{FIBRES}\n[[body.fibres]]\n{FIBRES}");
    let angle = |between: &str| {
        format!("{FIBRES}\n[body.axes]\nangles = [{{ between = {between}, modulus = 1e3 }}]")
    };
    let direction = |text: &str| FIBRES.replace("direction = [1.0, 0.0, 0.0]", text);
    let angles = |text: &str| direction(&format!("azimuth_elevation = {{ {text} }}"));
    let laplace = |text: &str| direction(&format!("laplace = {{ {text} }}"));
    let muscle = |text: &str| format!("{FIBRES}\nmuscle = {{ {text} }}");
    // line 14 is `[[body.fibres]]`
    let axes = |text: &str| format!("{FIBRES}\n[body.axes]\n{text}");
    attempt(&with_fibres(&axes("form = \"energy_consistent\""))).unwrap();
    let biquadratic = format!("{FIBRES}\nform = \"biquadratic\"");
    attempt(&with_fibres(&biquadratic)).unwrap();
    let cases: [(String, usize, &[&str]); 32] = [
        (biquadratic.replace("bi", "tri"), 18, &["form", "`biquadratic`"]),
        (format!("{biquadratic}\nmuscle = {{ width = 0.5 }}"), 18, &["`a`", "\"stretch\""]),
        (axes("form = \"printed\""), 19, &["form", "printed", "`sinew-papers`"]),
        (axes("volume_viscosity = 2.0"), 19, &["volume_viscosity", "`sinew-papers`"]),
        (angles(""), 17, &["not exactly one kind of angles"]),
        (angles("data = [\"a\", \"e\"]"), 17, &["cell data `a`", "VTU"]),
        (angles("formula = [\"x\", \"2*w\"]"), 17, &["formula of elevation", "variables"]),
        (angles("formula = [\"0\", \"1/0\"]"), 17, &["element 0", "finite"]),
        (angles("formula = [\"0\", \"0\"], axis = [0, 0, 0]"), 17, &["axis", "not zero"]),
        (
            angles("formula = [\"0\", \"0\"], zero = [0, 0, 2]"),
            17,
            &["azimuth 0", "not along the axis"],
        ),
        (direction(""), 14, &["not exactly one kind of direction"]),
        (direction("direction = [1, 0, 0]\nrandom = { seed = 1 }"), 14, &["not exactly one"]),
        (direction("direction = [0.0, 0.0, 0.0]"), 17, &["no length"]),
        (direction("direction = [nan, 0.0, 0.0]"), 17, &["not finite"]),
        (direction("direction = [1.0, 0.0]"), 17, &["length 2"]),
        (direction("data = \"fibre\""), 17, &["fibre_x", "VTU"]),
        (direction("formula = [\"x\", \"2*w\", \"0\"]"), 17, &["variables", "use x, y and z"]),
        (direction("formula = [\"0\", \"0\", \"0\"]"), 17, &["element 0", "no direction"]),
        (laplace("from = \"x0\", to = \"xx1\""), 17, &["did you mean `x1`"]),
        (laplace("from = \"x0\", to = \"y0\""), 17, &["both surfaces"]),
        (laplace("from = \"x0\", to = \"x1\", helix = [60, -60]"), 17, &["`axis`"]),
        (
            laplace("from = \"x0\", to = \"x1\", helix = [0, 0], axis = [1, 0, 0]"),
            17,
            &["helix rule", "no direction"],
        ),
        (
            direction("circular = { centre = [0, 0, 0], axis = [0, 0, 0] }"),
            17,
            &["axis", "not zero"],
        ),
        (
            direction("helicoidal = { centre = [0, 0, 0], axis = [1, 0, 0], degrees = inf }"),
            17,
            &["helix", "finite"],
        ),
        (FIBRES.replace("1e4", "-1e4"), 16, &["family `a`", "-10000 Pa"]),
        (format!("{FIBRES}\nviscosity = -1.0"), 18, &["family `a`", "-1 Pa s"]),
        (twice, 19, &["two families `a`"]),
        (angle("[\"a\", \"b\"]"), 19, &["`b`", "did you mean `a`?"]),
        (angle("[\"a\", \"a\"]"), 19, &["two different"]),
        (muscle("peak_stress = -1.0"), 18, &["`peak_stress` is -1"]),
        (muscle("width = 0.0"), 18, &["`width` is 0"]),
        (muscle("curve = { points = [[1.0, 0.0], [0.0, 1.0]] }"), 18, &["ascending"]),
    ];
    for (fibres, line, words) in cases {
        let message = attempt(&with_fibres(&fibres)).expect_err(&fibres).to_string();
        assert!(
            message.contains(&format!("line {line}, ")),
            "{fibres}: {line} is not in {message}"
        );
        says(&format!("{fibres}: {message}"), words);
    }
    let viscous = with_fibres(&format!("{FIBRES}\nviscosity = 5.0"));
    attempt(&viscous).unwrap();
    attempt(&viscous.replace("\"safe\"", "\"stormer-verlet\"")).unwrap();
    let at_rest = viscous.replace("dt = 0.01\nduration = 0.1", "mode = \"static\"");
    let message = attempt(&at_rest.replace("\"safe\"", "\"auto\"")).unwrap_err().to_string();
    assert!(message.contains("viscosity") && message.contains("static"), "{message}");
    let alone = GOOD.replace("[[constraint]]", "model = \"axes\"\n\n[[constraint]]");
    let message = attempt(&alone).unwrap_err().to_string();
    assert!(message.contains("line 14, `body[0].model`") && message.contains("axes"), "{message}");
    let cavity = GOOD.replace("[\"mean_displacement\"]", "[\"enclosed_volume\"]");
    attempt(&cavity).unwrap();
    let whole = cavity.replace("name = \"tip\"\nselect = { group = \"x1\" }", "name = \"tip\"");
    let message = attempt(&whole).unwrap_err().to_string();
    assert!(message.contains("group of faces"), "{message}");
}

/// Fibres of a skin, and what they cannot be.
#[test]
fn fibres_of_a_membrane_are_named_with_line_and_key() {
    let with = |fibres: &str, body: &str| {
        let own = format!(
            "membrane = {{ thickness = 1e-3, surface = true, fibres = [{{ name = \"f\", modulus = 1e4, {fibres} }}] }}\n\
             {body}\n[[constraint]]"
        );
        attempt(&GOOD.replace("[[constraint]]", &own))
    };
    let good = "form = \"biquadratic\", direction = [1, 2, 3]";
    with(good, "").unwrap();
    for rule in [
        "formula = [\"1 + y\", \"x\", \"2\"]",
        "helicoidal = { centre = [-1, 0, 0], axis = [0, 0.2, 1], degrees = 30 }",
    ] {
        with(&format!("form = \"biquadratic\", {rule}"), "").unwrap();
    }
    let beside = format!("[[body.fibres]]\n{}", FIBRES.replace("\"a\"", "\"f\""));
    for (fibres, body, words) in [
        ("direction = [1, 2, 3]", "", &["`f`", "form \"biquadratic\""][..]),
        (&format!("{good}, viscosity = 2"), "", &["viscosity", "`f`"]),
        (&format!("{good}, muscle = {{}}"), "", &["muscle", "passive"]),
        ("form = \"biquadratic\", laplace = { from = \"x0\", to = \"x1\" }", "", &["laplace"]),
        ("form = \"biquadratic\", direction = [1, 0, 0]", "", &["square to triangle"]),
        ("form = \"biquadratic\", data = \"f\"", "", &["f_x"]),
        (good, &beside, &["two families `f`"]),
    ] {
        let message = with(fibres, body).expect_err(fibres).to_string();
        assert!(message.contains("line "), "{message}");
        says(&format!("{fibres}: {message}"), words);
    }
}

/// A folder for the files of a test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// The scene with fibres of some direction in the mesh of a file.
fn of_file(direction: &str) -> String {
    with_fibres(&FIBRES.replace("direction = [1.0, 0.0, 0.0]", direction))
        .replace(SHAPE, "mesh = \"beam.vtu\"")
        .replace("{ group = \"x0\" }", "{ vertices = [0, 1, 2] }")
        .replace("{ group = \"x1\" }", "{ vertices = [4] }")
}

#[test]
fn fibre_vectors_of_other_lengths_are_a_warning() {
    let folder = folder("fibre_lengths");
    let mut mesh = box_tets(DVec3::new(0.2, 0.04, 0.04), [4, 1, 1]).unwrap();
    let mut vectors = vec![DVec3::X; mesh.tetrahedra.len()];
    vectors[3] *= 2.0;
    let data = to_cell_data("fibre", &vectors, &mesh);
    mesh.cell_data.extend(data);
    write(&folder.join("beam.vtu"), &mesh).unwrap();
    let text = of_file("data = \"fibre\"");
    let scene = LoadedScene::parse(&text, &folder.join("scene.toml")).unwrap();
    let built = build(&scene, &BuildOptions::default()).unwrap();
    let warning = built.warnings.iter().find(|w| w.code == "scene.fibres.length").unwrap();
    assert!(warning.message.starts_with("1 vectors"), "{warning}");
    let wrong = LoadedScene::parse(
        &text.replace("data = \"fibre\"", "data = \"fibres\""),
        &folder.join("scene.toml"),
    );
    let message = build(&wrong.unwrap(), &BuildOptions::default()).err().unwrap().to_string();
    assert!(message.contains("did you mean `fibre`?"), "{message}");
}

/// Two maps in the file, and the same two as formulas, are directions by the documented convention.
#[test]
fn azimuth_and_elevation_are_read_from_the_mesh_file() {
    let folder = folder("azimuth_elevation");
    let mut mesh = box_tets(DVec3::new(0.2, 0.04, 0.04), [4, 1, 1]).unwrap();
    let middle = |t: &[u32; 4]| t.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 4.0;
    let centres: Vec<DVec3> = mesh.tetrahedra.iter().map(middle).collect();
    let map = |name: &str, of: &dyn Fn(&DVec3) -> f64| CellData {
        name: name.to_string(),
        integer: false,
        values: ByKind {
            tetrahedra: centres.iter().map(of).collect(),
            triangles: vec![f64::NAN; mesh.triangles.len()],
            ..ByKind::default()
        },
    };
    let maps = [map("azimuth", &|x| 900.0 * x.x), map("elevation", &|x| 30.0 - 2e3 * x.z)];
    mesh.cell_data.extend(maps);
    write(&folder.join("beam.vtu"), &mesh).unwrap();
    let built = |angles: &str| {
        let fibres =
            format!("azimuth_elevation = {{ {angles}, axis = [2, 0, 0], zero = [1, 0, 3] }}");
        let scene = LoadedScene::parse(&of_file(&fibres), &folder.join("scene.toml")).unwrap();
        build(&scene, &BuildOptions::default()).map(|built| {
            let axes = built.bodies[0].axes.clone().unwrap();
            axes.families[0].directions.to_vec()
        })
    };
    let data = built("data = [\"azimuth\", \"elevation\"]").unwrap();
    let formula = built("formula = [\"900*x\", \"30 - 2000*z\"]").unwrap();
    for ((data, formula), x) in data.iter().zip(&formula).zip(&centres) {
        let (a, e) = ((900.0 * x.x).to_radians(), (30.0 - 2e3 * x.z).to_radians());
        // the axis is x, azimuth 0 is z, and x cross z is -y
        let expected = DVec3::new(e.sin(), -e.cos() * a.sin(), e.cos() * a.cos());
        assert!((*data - expected).length() < 1e-12, "{data} beside {expected}");
        assert!((*formula - expected).length() < 1e-12, "{formula} beside {expected}");
    }
    let message = built("data = [\"azimut\", \"elevation\"]").unwrap_err().to_string();
    assert!(message.contains("did you mean `azimuth`?"), "{message}");
    assert!(message.contains("azimuth_elevation.data"), "{message}");
}

#[test]
fn uniform_springs_need_their_constant() {
    let with = |keys: &str| {
        let body = format!("model = \"mass_spring\"\n{keys}\n\n[[constraint]]");
        attempt(&GOOD.replacen("[[constraint]]", &body, 1))
    };
    let uniform = "element_method = \"uniform\"\nspring_constant = 20.0";
    with(&format!("{uniform}\nhexahedron_springs = 16\nmasses = \"equal\"")).unwrap();
    let cases: [(&str, &[&str]); 7] = [
        ("element_method = \"uniform\"", &["`body[0].spring_constant`", "N/m"]),
        (&uniform.replace("20.0", "0.0"), &["line 16", "0 N/m", "positive"]),
        (&uniform.replace("20.0", "inf"), &["line 16", "not finite"]),
        ("spring_constant = 20.0", &["line 15", "element_method = \"uniform\""]),
        (&format!("{uniform}\nhexahedron_springs = 12"), &["line 17", "12 springs", "16"]),
        ("element_method = \"unifrom\"", &["line 15", "`uniform`"]),
        ("masses = \"equals\"", &["line 15", "`equal`"]),
    ];
    for (keys, words) in cases {
        let message = with(keys).expect_err(keys).to_string();
        says(&format!("{keys}: {message}"), words);
    }
}

/// What people write from habit is answered with what it is called here.
#[test]
fn habits_are_answered_with_what_to_write() {
    const MATERIAL: &str =
        "material = { young_modulus = 1e5, poisson_ratio = 0.4, density = 1000.0 }";
    let told = |from: &str, to: &str, words: &[&str]| {
        assert_eq!(GOOD.matches(from).count(), 1, "`{from}` must occur once");
        says(&attempt(&GOOD.replace(from, to)).unwrap_err().to_string(), words);
    };
    for (key, meant) in [("E", "young_modulus"), ("nu", "poisson_ratio"), ("rho", "density")] {
        let words = [&*format!("unknown key `{key}`"), &*format!("called `{meant}` here")];
        told(MATERIAL, &format!("material = {{ {key} = 1.0 }}"), &words);
    }
    told("dt = 0.01", "timestep = 0.01", &["called `dt` here"]);
    told(MATERIAL, "material = \"liver\"", &["line 12", "material = { preset = \"liver\" }"]);
    for (text, number) in [
        ("5 kPa", "5000 (Pa)"),
        ("0.1 MPa", "100000 (Pa)"),
        ("5e3Pa", "5000 (Pa)"),
        ("1.06 g/cm^3", "1060 (kg/m^3)"),
        ("3 mm", "0.003 (m)"),
    ] {
        told("young_modulus = 1e5", &format!("young_modulus = \"{text}\""), &["write ", number]);
    }
    told("young_modulus = 1e5", "young_modulus = \"soft\"", &["\"soft\", expected a number"]);
    told(
        "poisson_ratio = 0.4",
        "poisson_ratio = 0.5",
        &["up to 0.4999 with volume = \"clusters\""],
    );
    told("poisson_ratio = 0.4", "poisson_ratio = 0.49995", &["volume = \"clusters\""]);
    // a mesh in millimetres and a box in metres
    let far = GOOD.replace("[0.2, 0.04, 0.04]", "[200.0, 40.0, 40.0]").replace(
        "{ group = \"x0\" }",
        "{ box = { min = [-0.1, -0.1, -0.1], max = [-0.01, 0.1, 0.1] } }",
    );
    says(&attempt(&far).unwrap_err().to_string(), &["no vertex", "to [200.0000", "scale by 0.001"]);
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus/binary.stl");
    let message = LoadedScene::read(&mesh).unwrap_err().to_string();
    says(
        &message,
        &["binary.stl: this is a mesh, not a scene", "mesh = \"binary.stl\"", "sinew check"],
    );
}

/// `sinew check` of a text.
fn checked(name: &str, text: &str) -> CheckSummary {
    let file = std::env::temp_dir().join(format!("sinew-{name}-{}.toml", std::process::id()));
    std::fs::write(&file, text).unwrap();
    let summary = check_file(&file);
    std::fs::remove_file(&file).unwrap();
    summary
}

/// `sinew check` tells all that is wrong at once, and nothing that follows from something else.
#[test]
fn all_mistakes_are_told_at_once() {
    let bad = GOOD
        .replace("dt = 0.01", "dt = -0.01\ngravitiy = 0")
        .replace(
            "young_modulus = 1e5, poisson_ratio = 0.4",
            "young_modulus = -1e5, poisson_ratio = 0.7",
        )
        .replace("{ group = \"x0\" }", "{ group = \"x9\" }")
        .replace("force = [0.0, 0.0, -0.1]", "force = \"1 N\"")
        .replace("{ ramp = [0.0, 0.05] }", "{ rampe = [0.0, 0.05] }")
        .replace("[\"mean_displacement\"]", "[\"mean_displacment\"]")
        + "[[probe]]\nname = \"held\"\nconstraint = \"clamp\"\nrecord = [\"reaction\"]\n";
    let summary = checked("at-once", &bad);
    let lines: Vec<usize> = summary
        .mistakes
        .iter()
        .map(|text| {
            let (_, line) = text.split_once("line ").unwrap_or_else(|| panic!("{text}"));
            line.split([',', ':']).next().unwrap().parse().unwrap()
        })
        .collect();
    let mut expected: Vec<usize> = Vec::new();
    for word in ["dt = -", "gravitiy", "x9", "1 N", "rampe", "displacment"] {
        expected.push(bad.lines().position(|line| line.contains(word)).unwrap() + 1);
    }
    // two of them in one line
    let material = bad.lines().position(|line| line.starts_with("material")).unwrap() + 1;
    expected.extend([material; 2]);
    expected.sort_unstable();
    let mut sorted = lines.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, expected, "{:#?}", summary.mistakes);
    assert!(summary.mistakes.contains(summary.error.as_ref().unwrap()));
    let text = summary.to_string();
    assert_eq!(text.matches("error: ").count(), expected.len(), "{text}");
    // under each its line, with marks below the value, or below the key that there is not
    for (at, marked) in [
        ("dt = -0.01", "-0.01"),
        ("gravitiy = 0", "gravitiy"),
        ("select = { group = \"x9\" }", "\"x9\""),
        ("force = \"1 N\"", "\"1 N\""),
        ("curve = { rampe = [0.0, 0.05] }", "rampe"),
    ] {
        let number = bad.lines().position(|line| line == at).unwrap() + 1;
        let before = " ".repeat(at.find(marked).unwrap());
        let mark = format!("{number:>6} | {at}\n       | {before}{}\n", "^".repeat(marked.len()));
        assert!(text.contains(&mark), "{mark}{text}");
    }
    // a long line is cut, and what is broken has its line at least
    let long = GOOD.replace("dt = 0.01", &format!("{}dt = -1", " ".repeat(300)));
    let text = checked("long", &long).to_string();
    let marks = text.lines().find(|line| line.contains('^')).unwrap();
    assert!(marks.len() < 90 && marks.ends_with(" ^^"), "{text}");
    let text = checked("broken", &GOOD.replace("dt = 0.01", "dt = = 1")).to_string();
    assert!(text.contains("     3 | dt = = 1\n       | ^"), "{text}");
}

/// What the schema allows the reader takes: shipped scenes fit, and misspelt keys, choices and types do not.
#[test]
fn the_schema_is_that_of_the_reader() {
    fn misfit(schema: &serde_json::Value, value: &toml::Value, at: &str) -> Option<String> {
        let not = |what: &str| Some(format!("{at} is no {what}"));
        if let Some(any) = schema["anyOf"].as_array() {
            let each = || any.iter().map(|schema| misfit(schema, value, at));
            return if each().any(|own| own.is_none()) { None } else { each().flatten().next() };
        }
        if let Some(choices) = schema["enum"].as_array() {
            let known = choices.iter().any(|own| own.as_str() == value.as_str());
            return if known { None } else { not("choice") };
        }
        match (schema["type"].as_str()?, value) {
            ("object", toml::Value::Table(table)) => table.iter().find_map(|(key, own)| {
                let at = format!("{at}.{key}");
                match &schema["properties"][key] {
                    serde_json::Value::Null => Some(format!("{at} is unknown")),
                    schema => misfit(schema, own, &at),
                }
            }),
            ("array", toml::Value::Array(list)) => {
                let count = schema["minItems"].as_u64();
                if count.is_some_and(|count| count as usize != list.len()) {
                    return not("list of this length");
                }
                list.iter().find_map(|own| misfit(&schema["items"], own, at))
            }
            ("number", own) if own.is_float() || own.is_integer() => None,
            ("integer", own) if own.is_integer() => None,
            ("boolean", own) if own.is_bool() => None,
            ("string", own) if own.is_str() => None,
            (wanted, _) => not(wanted),
        }
    }
    let schema = schema();
    let fits = |text: &str| misfit(&schema, &toml::from_str(text).unwrap(), "scene");
    let (mut scenes, mut keys) = (0, BTreeSet::new());
    for entry in std::fs::read_dir(scene_folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|end| end != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(fits(&text), None, "{}", path.display());
        keys.extend(toml::from_str::<toml::Table>(&text).unwrap().into_iter().map(|own| own.0));
        scenes += 1;
    }
    assert!(scenes > 20 && keys.len() > 12, "{scenes} {keys:?}");
    let wrong = |from: &str, to: &str| fits(&GOOD.replace(from, to));
    assert_eq!(fits(GOOD), None);
    assert_eq!(wrong("poisson_ratio", "nu").as_deref(), Some("scene.body.material.nu is unknown"));
    assert_eq!(
        wrong("\"safe\"", "\"magic\"").as_deref(),
        Some("scene.solver.integrator is no choice")
    );
    assert_eq!(wrong("dt = 0.01", "dt = true").as_deref(), Some("scene.dt is no number"));
    assert!(wrong("gravity = [0.0, ", "gravity = [").is_some());
    assert!(wrong("cells = [4, 1, 1]", "cell = [4, 1, 1]").is_some());
}

/// An entry that cannot be read does not shift the places of others, and what speaks of it is no mistake of its own.
#[test]
fn places_are_those_of_the_file_whatever_was_passed_over() {
    let bad = GOOD.replace("[[constraint]]", "[[constraint]]\nname = \"lost\"\n[[constraint]]")
        + "until = -1.0\nuntill = 2.0\n[[probe]]\nname = \"a\"\nconstraint = \"lost\"\nrecord = [\"reaction\"]\n";
    let bad = bad.replace("select = { group = \"x0\" }", "select = { group = \"x9\" }");
    let found = LoadedScene::parse(&bad, Path::new("bad.toml")).unwrap_err().to_string();
    let told = checked("places", &bad).mistakes;
    let has = |words: &[&str]| told.iter().any(|text| words.iter().all(|word| text.contains(word)));
    assert!(found.contains("line "), "{found}");
    assert!(has(&["constraint[0]", "`select`"]) && has(&["constraint[1]", "x9"]), "{told:#?}");
    assert!(!has(&["lost`;"]), "{told:#?}");
}
