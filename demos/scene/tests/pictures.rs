//! Scenes to recordings and pictures (feature `render`).

use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::{Curve, DVec3, Model, Pull, Shape, Tool};
use sinew::touch::field::DistanceField;
use sinew::touch::tool::ToolMotion;
use sinew_render::adapter::{AdapterError, AdapterRequest, open};
use sinew_render::camera::CameraRequest;
use sinew_render::image::Image;
use sinew_render::scene::Recording;
use sinew_scene::assemble::{BuildOptions, BuiltScene};
use sinew_scene::mesh_tool::write;
use sinew_scene::picture::{
    CaptureOptions, GalleryEntry, Quantity, Recorder, RenderJob, Variant, render,
};
use sinew_scene::run::{Both, Observer, RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::shipped_scene;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

fn scene(name: &str) -> LoadedScene {
    LoadedScene::read(&shipped_scene(name)).unwrap()
}

fn options(steps: u64) -> RunOptions {
    let build = BuildOptions { steps: Some(steps), threads: Some(1), ..BuildOptions::default() };
    RunOptions { build, ..RunOptions::default() }
}

/// A recording of the first steps of a scene and the hash of its final state.
fn record(scene: &LoadedScene, steps: u64, quantities: Vec<Quantity>) -> (Recording, String) {
    record_as(scene, steps, CaptureOptions { quantities, ..CaptureOptions::default() })
}

fn record_as(scene: &LoadedScene, steps: u64, capture: CaptureOptions) -> (Recording, String) {
    let capture = CaptureOptions { frames: Some(9), ..capture };
    let mut recorder = Recorder::new(&scene.scene.name, capture);
    let summary = run(scene, &options(steps), &mut recorder).unwrap();
    assert_eq!(summary.failure, None);
    let (recording, _) = recorder.finish();
    recording.check().unwrap();
    (recording, summary.final_state_hash)
}

#[test]
fn the_gallery_lists_shipped_scenes_with_what_can_be_drawn() {
    for entry in GalleryEntry::all().unwrap() {
        assert!(shipped_scene(&entry.scene).is_file(), "{}", entry.scene);
        assert!(entry.at > 0.0, "{}", entry.scene);
        entry.camera.parse::<CameraRequest>().unwrap();
    }
}

#[test]
fn recording_changes_no_bit_of_a_run() {
    // the moved constraint of this one makes the recorder evaluate forces
    for name in ["crush", "ventricle"] {
        let scene = scene(name);
        let plain = run(&scene, &options(16), &mut Silent).unwrap();
        let (_, hash) = record(&scene, 16, Quantity::ALL.to_vec());
        assert_eq!(hash, plain.final_state_hash, "{name}");
    }
}

/// Two blocks with finer surfaces, which are cut one after the other: pictures and frames have the surfaces, both sides of the wounds
/// and nothing of the meshes, and the surfaces at rest stay what they were.
#[test]
fn fine_surfaces_are_drawn_through_cuts() {
    drawn_through_cuts("linear", "", "irregular");
}

#[test]
fn fine_surfaces_of_hexahedra_are_drawn_through_cuts() {
    drawn_through_cuts("hexahedra", "", "hexahedra");
}

#[test]
fn fine_surfaces_of_ten_node_tetrahedra_are_drawn_through_cuts() {
    drawn_through_cuts("ten", "second_order = true\n", "tetrahedra");
}

/// Fibres are drawn at faces of what cuts left whole.
#[test]
fn fibres_of_bodies_that_are_cut_are_drawn_where_they_are_whole() {
    let text = "name = \"fibres\"\ndt = 0.01\nduration = 0.08\n[[body]]\nname = \"one\"\n\
         generate.box = { size = [0.06, 0.06, 0.06], cells = [4, 4, 4], elements = \"irregular\" }\n\
         material = { young_modulus = 1e4, poisson_ratio = 0.3, density = 1e3 }\n\
         fibres = [{ name = \"along\", direction = [1.0, 0.0, 0.0], modulus = 1e4 }]\n\
         [[constraint]]\nname = \"wall\"\nbody = \"one\"\nselect = { group = \"x0\" }\n\
         [[cut]]\nname = \"blade\"\nbody = \"one\"\ntime = 0.04\n\
         strip = [[[0.031, -0.1, 0.1], [0.034, -0.1, -0.1]], [[0.031, 0.1, 0.1], [0.034, 0.1, -0.1]]]\n\
         [output]\nframes_per_second = 50\n";
    let scene = LoadedScene::parse(text, std::path::Path::new("fibres.toml")).unwrap();
    let (recording, _) = record(&scene, 16, vec![Quantity::Displacement]);
    let [first, last] = [0, recording.frames.len() - 1].map(|i| recording.frames[i].rods.len());
    assert!(0 < last && last < first, "{first} {last}");
}

fn drawn_through_cuts(name: &str, more: &str, elements: &str) {
    let folder = std::env::temp_dir().join(format!("sinew-fine-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let shell = box_tets(DVec3::splat(0.06), [13; 3]).unwrap();
    write(&folder.join("shell.vtu"), &shell).unwrap();
    let of = |name: &str, time: f64| {
        format!(
            "[[body]]\nname = \"{name}\"\nsurface = \"shell.vtu\"\n\
             generate.box = {{ size = [0.06, 0.06, 0.06], cells = [4, 4, 4], elements = \"{elements}\" }}\n{more}\
             material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1e3 }}\n\
             [[constraint]]\nname = \"wall of {name}\"\nbody = \"{name}\"\nselect = {{ group = \"x0\" }}\n\
             [[cut]]\nname = \"blade of {name}\"\nbody = \"{name}\"\ntime = {time:?}\n\
             strip = [[[0.031, -0.1, 0.1], [0.034, -0.1, -0.1]], [[0.031, 0.1, 0.1], [0.034, 0.1, -0.1]]]\n"
        )
    };
    let text = format!(
        "name = \"fine\"\ndt = 0.01\nduration = 0.16\n{}{}[output]\nframes_per_second = 50\n",
        of("one", 0.04),
        of("other", 0.08)
    );
    let scene = LoadedScene::parse(&text, &folder.join("fine.toml")).unwrap();
    let (recording, hash) = record(&scene, 16, vec![Quantity::Displacement, Quantity::Strain]);
    let (first, last) = (&recording.frames[0], recording.frames.last().unwrap());
    let surface = shell.surface_triangles().len();
    assert!(Arc::ptr_eq(&first.skin, &recording.rest_skin));
    assert_eq!(first.skin.triangles.len(), 2 * surface);
    assert!(last.skin.triangles.len() > 2 * surface + 400);
    // the surface at rest has vertices of the fine grid alone, wherever cuts put their points
    for &v in &recording.rest_skin.points {
        let steps = recording.rest[v as usize].map(|x| x / 0.06 * 13.0);
        assert!(steps.iter().all(|x| (x - x.round()).abs() < 1e-3), "{steps:?}");
    }
    // what is cut off falls by 6 cm and more; all that is drawn is here or there
    let fallen = |v: u32| {
        let v = last.skin.points[v as usize] as usize;
        recording.rest[v][2] - last.points[v][2]
    };
    for t in &last.skin.triangles {
        let [a, b, c] = t.map(fallen);
        assert!((a - b).abs().max((b - c).abs()) < 0.02, "{a} {b} {c}");
    }
    let out = folder.join("out");
    let own = RunOptions { out: Some(out.clone()), ..options(16) };
    assert_eq!(run(&scene, &own, &mut Silent).unwrap().final_state_hash, hash);
    let frame =
        |n: usize| Mesh::read(&out.join(format!("frames/fine-surface_{n:05}.vtu"))).unwrap();
    let (before, after) = (frame(0), frame(8));
    let points = shell.surface_triangles().into_iter().flatten().collect::<BTreeSet<u32>>().len();
    assert_eq!((before.triangles.len(), before.points.len()), (2 * surface, 2 * points));
    let wound = &after.data("wound").unwrap().values.triangles;
    assert!(wound.iter().filter(|wound| **wound == 1.0).count() > 100);
    assert_eq!(wound.len(), last.skin.triangles.len());
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn surfaces_follow_a_resection() {
    let mut scene = scene("liver_resection");
    // cuts from the first step on
    for resection in &mut scene.scene.resections {
        for point in &mut resection.tool.as_mut().unwrap().path {
            point[0] -= 0.5;
        }
    }
    let (recording, _) = record(&scene, 24, vec![Quantity::Strain]);
    let [first, .., last] = &recording.frames[..] else { panic!("two frames at least") };
    assert!(Arc::ptr_eq(&first.skin, &recording.rest_skin));
    assert!(!Arc::ptr_eq(&first.skin, &last.skin), "elements were removed");
    assert_ne!(first.skin.triangles.len(), last.skin.triangles.len());
    // still closed: every edge of the points belongs to an even number of faces
    let mut edges = std::collections::HashMap::new();
    for t in &last.skin.triangles {
        let p = t.map(|v| last.skin.points[v as usize]);
        for k in 0..3 {
            let (a, b) = (p[k], p[(k + 1) % 3]);
            *edges.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    assert!(edges.values().all(|n| n % 2 == 0));
    for normal in last.skin.normals(&last.points) {
        let length: f32 = normal.iter().map(|x| x * x).sum();
        assert!((length - 1.0).abs() < 1e-4);
    }
    // the tool is there
    assert!(last.balls.iter().any(|b| b.radius == 0.01));
}

/// Triangles of a film that was slit are drawn where their material is, with the strain of what moves them.
#[test]
fn a_slit_film_is_drawn_as_the_blade_left_it() {
    let scene = scene("slit");
    let quantities = vec![Quantity::Displacement, Quantity::Strain];
    let capture = CaptureOptions { quantities, page: true, ..CaptureOptions::default() };
    let (recording, _) = record_as(&scene, 220, capture);
    let [first, .., last] = &recording.frames[..] else { panic!("two frames at least") };
    let count = |frame: &sinew_render::scene::Frame| frame.skin.triangles.len();
    assert!(count(last) > count(first) + 30, "{} {}", count(first), count(last));
    let area = |frame: &sinew_render::scene::Frame| -> f64 {
        let at =
            |v: u32| glam::Vec3::from_array(recording.rest[frame.skin.points[v as usize] as usize]);
        let own = frame.skin.triangles.iter().map(|t| t.map(|v| at(v).as_dvec3()));
        own.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
    };
    assert!((area(last) / area(first) - 1.0).abs() < 1e-6, "{} {}", area(first), area(last));
    // stretched by a tenth, less beside the slit, more at its end
    let strains = last.skin.points.iter().map(|p| last.fields[1][*p as usize]);
    let (least, most) =
        strains.fold((f32::MAX, 0.0_f32), |(low, high), x| (low.min(x), high.max(x)));
    assert!((0.0..0.06).contains(&least) && (0.12..1.0).contains(&most), "{least} {most}");
}

#[test]
fn a_wound_is_drawn_as_the_blade_left_it() {
    let mut scene = scene("lobe");
    scene.scene.cuts[0].time = 0.1;
    scene.scene.pulls[0].from = Some(0.1);
    let quantities = vec![Quantity::Displacement, Quantity::Strain];
    let capture = CaptureOptions { quantities, page: true, ..CaptureOptions::default() };
    let (recording, hash) = record_as(&scene, 16, capture);
    assert_eq!(hash, run(&scene, &options(16), &mut Silent).unwrap().final_state_hash);
    let [first, .., last] = &recording.frames[..] else { panic!("two frames at least") };
    assert!(Arc::ptr_eq(&first.skin, &recording.rest_skin) && first.skin.depth.is_empty());
    // points that the cut made are there from the start, but nothing shows them
    let own = recording.rest.len();
    assert!(recording.frames.iter().all(|frame| frame.points.len() == own));
    let before = first.skin.points.iter().max().unwrap();
    let wound: Vec<usize> =
        (0..last.skin.points.len()).filter(|&v| last.skin.wound(v).is_some()).collect();
    assert!(wound.len() > 200, "{}", wound.len());
    assert!(wound.iter().all(|&v| last.skin.points[v] > *before));
    let deepest = wound.iter().filter_map(|&v| last.skin.wound(v)).fold(0.0, f32::max);
    assert!((0.02..0.06).contains(&deepest), "half of how thick the organ is: {deepest}");
    let shown = |v: &usize| last.fields[1][last.skin.points[*v] as usize];
    assert!(wound.iter().all(|v| shown(v).is_finite() && shown(v) >= 0.0));
    assert!(wound.iter().any(|v| shown(v) > 1e-3));
    // the surface, and what fills it, hold the whole of the body before and after: nothing is left out along the wound
    let at = |frame: &sinew_render::scene::Frame, v: u32| {
        glam::Vec3::from_array(frame.points[v as usize]).as_dvec3()
    };
    for (number, frame) in (0..).zip(&recording.frames) {
        let corners = frame.skin.triangles.iter().map(|t| t.map(|v| frame.skin.points[v as usize]));
        let surface: f64 =
            corners.map(|t| t.map(|v| at(frame, v))).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum();
        let living = recording.cells.iter().filter(|c| c.born <= number && number < c.gone);
        let cells: f64 = living
            .map(|cell| cell.points.map(|v| at(frame, v)))
            .map(|[a, b, c, d]| (b - a).cross(c - a).dot(d - a) / 6.0)
            .sum();
        assert!((surface / cells - 1.0).abs() < 1e-5, "{number}: {surface} {cells}");
    }
}

#[test]
fn frames_hold_what_the_scene_shows() {
    let (recording, _) = record(&scene("muscle_bar"), 40, Quantity::ALL.to_vec());
    assert_eq!(recording.frames.len(), 9);
    assert_eq!(recording.fields.len(), 5);
    let last = recording.frames.last().unwrap();
    assert!((last.time - 0.4).abs() < 1e-12);
    assert!((recording.interval - 0.05).abs() < 1e-12);
    // fibres on the four long sides, 15 x 3 each; they stand on the ends, where they are left out
    assert_eq!(last.rods.len(), 4 * 15 * 3);
    // held vertices of the end at the surface: all 16
    assert_eq!(last.balls.len(), 16);
    let displacement = &recording.fields[0];
    assert_eq!(displacement.name, "displacement");
    let largest = recording.frames.iter().flat_map(|f| &f.fields[0]).fold(0.0f32, |m, x| m.max(*x));
    assert_eq!(displacement.range, [0.0, largest]);
    // it keeps its volume better than it keeps its length
    let of = |i: usize| last.fields[i].iter().copied();
    assert!(of(4).all(|j| (j - 1.0).abs() < 0.1));
    assert!(of(1).fold(0.0, f32::max) > 0.02);
    assert!(of(2).chain(of(3)).all(|x| x >= 0.0));
    // loads have arrows once they act
    let (beam, _) = record(&scene("static_beam"), 1, vec![Quantity::Displacement]);
    assert!(beam.is_static && beam.frames[0].arrows.is_empty());
    let arrow = beam.frames.last().unwrap().arrows[0];
    assert!(arrow.along[2] < 0.0 && arrow.along[0] == 0.0);
}

#[test]
fn what_cannot_be_drawn_is_refused_by_name() {
    let scene = scene("fibre_bar");
    let refused = |job: &RenderJob| render(&scene, job, &mut Silent).unwrap_err().to_string();
    let nothing = refused(&RenderJob::default());
    assert!(nothing.contains("--png") && nothing.contains("--html"), "{nothing}");
    let picture = Some(PathBuf::from("x.png"));
    let adapter =
        AdapterRequest { name: Some("no such thing".into()), ..AdapterRequest::default() };
    let missing = refused(&RenderJob { picture, adapter, ..RenderJob::default() });
    assert!(missing.contains("graphics adapter"), "{missing}");
    assert!("heat".parse::<Quantity>().unwrap_err().to_string().contains("displacement"));
}

#[test]
fn the_error_of_a_step_is_that_to_a_finer_run() {
    let scene = scene("fibre_bar");
    let html = Some(std::env::temp_dir().join(format!("sinew-error-{}.html", std::process::id())));
    let build = options(10).build;
    let job = RenderJob { build, html, quantity: Quantity::Error, ..RenderJob::default() };
    render(&scene, &job, &mut Silent).unwrap();
    let page = std::fs::read_to_string(job.html.as_ref().unwrap()).unwrap();
    std::fs::remove_file(job.html.unwrap()).unwrap();
    let largest = |name: &str| -> f64 {
        let start = page.find(&format!("\"name\":\"{name}\"")).unwrap();
        let range = page[start..].split_once("\"range\":[").unwrap().1;
        range.split([',', ']']).nth(1).unwrap().parse().unwrap()
    };
    let (error, displacement) = (largest("error"), largest("displacement"));
    assert!(error > 1e-5 * displacement && error < 0.2 * displacement, "{error} {displacement}");
    // what has no step, or other elements with another one, is refused
    for name in ["static_beam", "liver_resection"] {
        let scene = LoadedScene::read(&shipped_scene(name)).unwrap();
        let job = RenderJob {
            html: Some("x.html".into()),
            quantity: Quantity::Error,
            ..RenderJob::default()
        };
        let refused = render(&scene, &job, &mut Silent).unwrap_err().to_string();
        assert!(refused.contains("--color: `error`"), "{refused}");
    }
}

/// Brings tools into a scene.
struct WithTools(Vec<Tool>);

impl Observer for WithTools {
    fn built(&mut self, scene: &mut BuiltScene) {
        for tool in self.0.drain(..) {
            scene.simulation.add_tool(tool).unwrap();
        }
    }
}

/// A block of 20 x 20 x 10 cm on its floor, and a ball of 4 cm above its middle that goes down to 2 cm below its top.
fn block_and_ball() -> (LoadedScene, Tool) {
    let text = r#"
        name = "block"
        mode = "static"
        load_steps = 4
        gravity = [0.0, 0.0, 0.0]
        [solver]
        newton_tolerance = 1e-6
        [[body]]
        name = "block"
        generate = { box = { size = [0.2, 0.2, 0.1], cells = [8, 8, 4] } }
        material = { young_modulus = 5e3, poisson_ratio = 0.3, density = 1000.0 }
        model = "svk_comp"
        [[constraint]]
        name = "floor"
        select = { group = "z0" }"#;
    let scene = LoadedScene::parse(text, "block.toml".as_ref()).unwrap();
    let start = DVec3::new(0.1, 0.1, 0.16);
    let mut ball = Tool::new("ball", Shape::Sphere { radius: 0.04 }, start);
    ball.motion = ToolMotion::Translate(DVec3::NEG_Z * 0.04, Curve::ramp(0.0, 1.0));
    (scene, ball)
}

fn record_tools(
    scene: &LoadedScene,
    quantities: Vec<Quantity>,
    tools: Vec<Tool>,
) -> (Recording, Vec<DVec3>) {
    /// Keeps the forces on the tools at the end of each step.
    struct Reports(WithTools, Vec<DVec3>);
    impl Observer for Reports {
        fn built(&mut self, scene: &mut BuiltScene) {
            self.0.built(scene);
        }
        fn step(&mut self, _: u64, _: f64, scene: &mut BuiltScene) {
            let world = scene.simulation.world_mut();
            let mut reports = world.query::<&sinew::touch::tool::ToolReport>();
            self.1.extend(reports.iter(world).map(|report| report.force));
        }
    }
    let mut reports = Reports(WithTools(tools), Vec::new());
    let capture = CaptureOptions { quantities, ..CaptureOptions::default() };
    let mut recorder = Recorder::new(&scene.scene.name, capture);
    let options = RunOptions {
        build: BuildOptions { threads: Some(1), ..Default::default() },
        ..Default::default()
    };
    run(scene, &options, &mut Both(&mut reports, &mut recorder)).unwrap();
    let (recording, _) = recorder.finish();
    recording.check().unwrap();
    (recording, reports.1)
}

#[test]
fn tools_are_recorded_with_poses_forces_and_pressure() {
    let (scene, ball) = block_and_ball();
    let (recording, forces) = record_tools(&scene, vec![Quantity::Pressure], vec![ball]);
    assert_eq!((recording.shapes.len(), recording.frames.len()), (1, 5));
    for (i, frame) in recording.frames.iter().enumerate() {
        let [placed] = frame.tools[..] else { panic!("one part: {:?}", frame.tools) };
        assert!((placed.at[2] - (0.16 - 0.01 * i as f32)).abs() < 1e-6, "{placed:?}");
    }
    // it meets the block after the second step
    assert!(recording.frames[..3].iter().all(|frame| frame.arrows.is_empty()));
    let last = recording.frames.last().unwrap();
    let [arrow] = last.arrows[..] else { panic!("{:?}", last.arrows) };
    // the force on the block: down, with its point where the ball touches; the largest is a fifth of the block
    let [x, y, z] = arrow.along;
    assert!(z < 0.0 && x.abs().max(y.abs()) < 0.05 * z.abs(), "{arrow:?}");
    assert!((z.abs() - 0.2 * recording.size()).abs() < 0.01 * recording.size(), "{arrow:?}");
    assert!(
        (arrow.to[0] - 0.1).abs() < 5e-3 && arrow.to[2] > 0.075 && arrow.to[2] < 0.1,
        "{arrow:?}"
    );
    // the legend has the force that the tool reports
    let largest = forces.iter().map(|f| f.length()).fold(0.0, f64::max);
    assert!(forces.last().unwrap().z > 0.0, "on the tool: up");
    let key = &recording.arrow_key.as_ref().unwrap().text;
    assert!(key.contains(&sinew_render::scale::with_unit(largest, "N")), "{key}: {largest}");
    assert!(key.contains("on bodies"), "{key}");
    // and its graph has every step, zero before it touches
    let [force] = &recording.forces[..] else { panic!("{:?}", recording.forces) };
    assert_eq!((force.name.as_str(), force.points.len()), ("ball", forces.len()));
    for (point, reported) in force.points.iter().zip(&forces) {
        assert_eq!(point[1], reported.length());
    }
    assert_eq!((force.at(0.0), force.at(last.time)), (0.0, largest));
    assert!(last.note.contains(&sinew_render::scale::with_unit(largest, "N")), "{}", last.note);
    // pressure under the ball only
    let field = &recording.fields[0];
    assert_eq!((field.name.as_str(), field.unit.as_str()), ("pressure", "Pa"));
    let mut touched = 0;
    for (value, p) in last.fields[0].iter().zip(&last.points) {
        let away = f32::hypot(p[0] - 0.1, p[1] - 0.1);
        assert!(*value == 0.0 || (away < 0.045 && p[2] > 0.07), "{value} at {p:?}");
        touched += usize::from(*value > 0.0);
    }
    assert!(touched >= 4 && field.range[1] > 100.0 && field.range[1] < 5e4, "{touched} {field:?}");
    // a scene without tools knows nothing of them
    let (plain, _) = record_tools(&scene, vec![Quantity::Pressure], Vec::new());
    assert!(plain.shapes.is_empty() && plain.arrow_key.is_none() && plain.tool_points().is_empty());
    assert!(
        plain.frames.iter().all(|f| f.tools.is_empty() && f.fields[0].iter().all(|p| *p == 0.0))
    );
}

#[test]
fn what_a_tool_draws_along_has_its_arrow_behind() {
    let (mut scene, mut ball) = block_and_ball();
    scene.scene.load_steps = Some(8);
    ball.grip = true;
    // down to 5 mm below the top at half of the loads, then up to 5 mm above it
    let height = [[0.0, 0.0], [0.5, 0.025], [1.0, 0.015]];
    ball.motion = ToolMotion::Translate(DVec3::NEG_Z, Curve::Points(height.to_vec()));
    let (recording, forces) = record_tools(&scene, vec![Quantity::None], vec![ball]);
    let force = forces.last().unwrap();
    assert!(force.z < 0.0, "the block draws the ball down: {force}");
    let arrow = recording.frames.last().unwrap().arrows[0];
    let tail = glam::Vec3::from_array(arrow.to) - glam::Vec3::from_array(arrow.along);
    assert!(
        arrow.along[2] > 0.0 && tail.distance(glam::Vec3::new(0.1, 0.1, 0.125)) < 0.045,
        "{arrow:?}"
    );
    // while it presses, the other way round
    let pressed = recording.frames[4].arrows[0];
    assert!(pressed.along[2] < 0.0 && (pressed.to[2] - 0.095).abs() < 0.01, "{pressed:?}");
}

#[test]
fn a_pull_has_its_arrow_from_the_patch_to_the_hand() {
    struct WithPull;
    impl Observer for WithPull {
        fn built(&mut self, scene: &mut BuiltScene) {
            let (body, mesh) = (scene.bodies[0].handle, scene.bodies[0].mesh.clone());
            let top = scene.simulation.group_rows(body, &mesh, "z1").unwrap();
            let hand = scene.simulation.add_pull(Pull::new("hand", top, 100.0, 0.0));
            scene.simulation.move_pull(hand, DVec3::X * 0.05);
        }
    }
    let (scene, _) = block_and_ball();
    let mut recorder = Recorder::new("pull", CaptureOptions::default());
    run(&scene, &RunOptions::default(), &mut Both(&mut WithPull, &mut recorder)).unwrap();
    let (recording, _) = recorder.finish();
    let [arrow] = recording.frames.last().unwrap().arrows[..] else { panic!("one arrow") };
    let tail = glam::Vec3::from_array(arrow.to) - glam::Vec3::from_array(arrow.along);
    assert!(arrow.along[0] > 0.15 * recording.size(), "{arrow:?}");
    assert!(tail.x > 0.101 && tail.x < 0.15 && (tail.y - 0.1).abs() < 5e-3, "{tail}");
    assert!((tail.z - 0.1).abs() < 0.02 && recording.arrow_key.is_none(), "{tail}");
}

#[test]
fn tools_that_are_near_are_in_view_and_others_do_not_count() {
    let (scene, ball) = block_and_ball();
    let far = Tool::new("far", Shape::Sphere { radius: 0.04 }, DVec3::new(9.0, 0.0, 0.0));
    // their surfaces go through the ball's start and the floor; the shaft is ten times as long as the block
    let wall = Tool::ground("wall", DVec3::new(5.0, 0.23, 5.0), DVec3::NEG_Y);
    let shaft = Shape::Capsule { half_length: 1.0, radius: 0.01 };
    let shaft = Tool::new("shaft", shaft, DVec3::new(1.1, 0.1, 0.2));
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| 0.03 * p);
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let wedge = DistanceField::cached(&corners, &faces, None).unwrap();
    let wedge = Tool::new("wedge", Shape::Field(wedge), DVec3::new(0.0, -0.05, 0.0));
    let room = Tool::cavity("room", Shape::Sphere { radius: 1.0 }, DVec3::ZERO);
    let tools = vec![ball, far, wall, shaft, wedge, room];
    let (recording, _) = record_tools(&scene, vec![Quantity::None], tools);
    assert_eq!((recording.shapes.len(), recording.frames[0].tools.len()), (6, 6));
    // the wedge has four sharp faces
    assert!(recording.shapes.iter().any(|shape| shape.points.len() == 12));
    // the wall of the cavity is seen from inside
    let wall = recording.shapes.iter().find(|shape| shape.hollow).unwrap();
    let [a, b, c] = wall.triangles[0].map(|v| glam::Vec3::from_array(wall.points[v as usize]));
    let inward = |p: [f32; 3], n: [f32; 3]| glam::Vec3::from_array(p).dot(n.into()) < 0.0;
    assert!(wall.points.iter().zip(&wall.normals).all(|(p, n)| inward(*p, *n)));
    assert!(a.dot((b - a).cross(c - a)) < 0.0);
    let points = recording.tool_points();
    let has = |x: f32, y: f32, z: f32| {
        points.iter().any(|p| (*p - glam::Vec3::new(x, y, z)).length() < 2e-3)
    };
    assert!(has(0.1, 0.1, 0.2), "the top of the ball at its start");
    assert!(has(0.1, 0.1, 0.08), "its lowest place");
    assert!(has(0.1, 0.1, 0.2) && has(0.09, 0.1, 0.2), "the near end of the shaft");
    assert!(has(0.0, -0.05, 0.03), "a corner of the wedge");
    let size = recording.size();
    for p in recording.shown() {
        assert!((p - glam::Vec3::new(0.1, 0.1, 0.05)).length() < 1.5 * size, "{p}");
    }
    // the wall stands beside the block, its surface where it is said to be, a little larger than the block
    let plate = recording.shapes.iter().position(|shape| shape.plate).unwrap();
    let placed = recording.frames[0].tools.iter().find(|t| t.shape as usize == plate).unwrap();
    let corners: Vec<_> = recording.shapes[plate].points.iter().map(|p| placed.carry(*p)).collect();
    let of = |k: usize| corners.iter().map(move |p| p[k]);
    let (low, high) =
        (of(1).fold(f32::INFINITY, f32::min), of(1).fold(f32::NEG_INFINITY, f32::max));
    assert!((low - 0.23).abs() < 1e-4 && high < 0.23 + 0.02 * size, "{low} {high}");
    let wide = of(0).fold(f32::NEG_INFINITY, f32::max) - of(0).fold(f32::INFINITY, f32::min);
    assert!(wide > 0.2 && wide < 0.2 + 0.25 * size, "{wide}");
}

/// A software adapter, or none after a message.
pub fn software() -> Option<AdapterRequest> {
    let adapter = AdapterRequest { software: Some(true), ..AdapterRequest::default() };
    match open(&adapter) {
        Ok(_) => Some(adapter),
        Err(error @ (AdapterError::NoneFound | AdapterError::NoMatch { .. })) => {
            let _ = writeln!(std::io::stderr(), "skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn temporary(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("sinew-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Models beside each other: half pictures that agree at rest and differ once the energies do.
#[test]
fn models_stand_beside_each_other() {
    let Some(adapter) = software() else { return };
    let folder = temporary("beside");
    let with = |model| {
        let mut scene = scene("slender_cylinder");
        scene.scene.bodies.truncate(1);
        let body = scene.scene.bodies[0].name.clone();
        scene.scene.probes.clear();
        scene.scene.constraints.retain(|c| c.body.as_ref().is_none_or(|name| *name == body));
        scene.scene.bodies[0].model = model;
        scene
    };
    let job = RenderJob {
        build: options(20).build,
        frames: Some(3),
        size: [320, 180],
        png: Some(folder.join("frames")),
        video: Some(folder.join("film.png")),
        label: "one".into(),
        beside: vec![Variant { label: "other".into(), scene: with(Model::Linear) }],
        quantity: Quantity::None,
        adapter,
        ..RenderJob::default()
    };
    let (report, _) = render(&with(Model::CompressibleStVK), &job, &mut Silent).unwrap();
    assert_eq!((report.frames, report.pictures, report.files.len()), (3, 3, 2));
    let frame =
        |i: usize| Image::read_png(&folder.join(format!("frames/slender_cylinder_{i:05}.png")));
    let halves = |i: usize| {
        let image = frame(i).unwrap();
        assert_eq!([image.width, image.height], [320, 180]);
        // below the labels, as wide as the narrower panel
        let part = |x: u32| {
            let mut part = Image::filled(140, 58, [0; 3]);
            for (row, column) in (0..58).flat_map(|row| (0..140).map(move |column| (row, column))) {
                let pixel = image.pixel(x + column, 92 + row);
                part.fill([column as i32, row as i32], [1, 1], pixel, 1.0);
            }
            part
        };
        // two panels of 148 pixels with gaps of 6
        part(6).difference(&part(6 + 148 + 6)).unwrap()
    };
    assert_eq!(halves(0)[1], 0.0);
    assert!(halves(2)[1] > 40.0, "{:?}", halves(2));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn files_are_written_and_not_blank() {
    let Some(adapter) = software() else { return };
    let folder = temporary("pictures");
    let job = RenderJob {
        build: options(12).build,
        frames: Some(4),
        size: [160, 90],
        png: Some(folder.join("frames")),
        video: Some(folder.join("film.png")),
        picture: Some(folder.join("one.png")),
        at: Some(0.0),
        html: Some(folder.join("page.html")),
        quantity: Quantity::Stress,
        adapter,
        ..RenderJob::default()
    };
    let (report, summary) = render(&scene("cantilever"), &job, &mut Silent).unwrap();
    assert!(summary.completed);
    assert_eq!((report.frames, report.pictures, report.files.len()), (4, 5, 4));
    let frame = |i: usize| Image::read_png(&folder.join(format!("frames/cantilever_{i:05}.png")));
    let [first, last] = [0, 3].map(|i| frame(i).unwrap());
    assert!(frame(4).is_err());
    // the first frame is the single picture at time 0, and the beam has moved since
    let one = Image::read_png(&folder.join("one.png")).unwrap();
    assert_eq!(one.difference(&first), Some([0.0, 0.0]));
    assert!(one.difference(&last).unwrap()[1] > 60.0);
    let page = std::fs::read_to_string(folder.join("page.html")).unwrap();
    for quantity in ["displacement", "strain", "stress", "energy", "volume"] {
        assert!(page.contains(&format!("\"name\":\"{quantity}\"")), "{quantity}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A ball hides what is behind it, not what is before it; its arrow points from the ball into the block.
#[test]
fn a_tool_above_a_block_is_drawn_before_it() {
    let Some(adapter) = software() else { return };
    let folder = temporary("tools");
    let (scene, ball) = block_and_ball();
    let picture = |name: &str, camera: &str, at: f64, tools: Vec<Tool>| {
        let job = RenderJob {
            build: BuildOptions { threads: Some(1), ..BuildOptions::default() },
            size: [200, 200],
            picture: Some(folder.join(name)),
            at: Some(at),
            quantity: Quantity::None,
            camera: camera.parse().unwrap(),
            adapter: adapter.clone(),
            no_ground: true,
            no_ghost: true,
            ..RenderJob::default()
        };
        render(&scene, &job, &mut WithTools(tools)).unwrap();
        Image::read_png(&folder.join(name)).unwrap()
    };
    let [red, blue] = [
        |[r, _, b]: [u8; 3]| r > b.saturating_add(40),
        |[r, _, b]: [u8; 3]| b > r.saturating_add(40),
    ];
    let grey = |[r, g, b]: [u8; 3]| r.abs_diff(b) < 30 && r.abs_diff(g) < 30 && r < 215;
    // from above: the block without the ball, the ball before it, the block round it
    let above = "0.1,0.0999,0.8,0.1,0.1,0.05";
    let bare = picture("bare.png", above, 0.0, Vec::new());
    let with = picture("with.png", above, 0.0, vec![ball.clone()]);
    assert!(red(bare.pixel(100, 100)) && grey(with.pixel(100, 100)), "{:?}", with.pixel(100, 100));
    assert!(red(bare.pixel(60, 100)) && red(with.pixel(60, 100)), "{:?}", with.pixel(60, 100));
    let covered = (0..40_000)
        .map(|i| (i % 200, i / 200))
        .filter(|&(x, y)| red(bare.pixel(x, y)) && grey(with.pixel(x, y)));
    let (covered, block) =
        (covered.count(), (0..40_000).filter(|i| red(bare.pixel(i % 200, i / 200))));
    let share = covered as f64 / block.count() as f64;
    // pi 4^2 / 20^2, larger as it is nearer
    assert!(share > 0.12 && share < 0.25, "{share}");
    // from below the block hides it
    let below = "0.1,0.0999,-0.7,0.1,0.1,0.05";
    let [bare, with] = [Vec::new(), vec![ball.clone()]].map(|t| picture("x.png", below, 0.0, t));
    assert_eq!(bare.pixel(100, 100), with.pixel(100, 100));
    // from the side, at the end: the head, which is wider, lies below
    let side = "0.1,-0.7,0.2,0.1,0.1,0.1";
    let pressed = picture("side.png", side, 1.0, vec![ball]);
    let rows: Vec<(u32, usize)> = (0..185)
        .map(|y| (y, (0..200).filter(|&x| blue(pressed.pixel(x, y))).count()))
        .filter(|(_, count)| *count > 0)
        .collect();
    let (first, last) = (rows[0].0, rows[rows.len() - 1].0);
    let widest = rows.iter().max_by_key(|(_, count)| *count).unwrap();
    assert!(last > first + 20 && widest.1 >= 4, "{rows:?}");
    assert!(2 * widest.0 > first + last, "{rows:?}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_gallery_shows_every_scene_in_small_files() {
    let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let page = std::fs::read_to_string(docs.join("gallery.md")).unwrap();
    let mut scenes = 0;
    for entry in std::fs::read_dir(sinew_scene::scene_folder()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        // what is fitted to data is a table, what runs side by side a report, what hangs two numbers: no pictures
        let unseen = ["fit_bar", "flap", "side_by_side"].contains(&name.as_str());
        if path.extension().is_some_and(|e| e == "toml") && !unseen {
            assert!(page.contains(&format!("(gallery/{name}.png)")), "{name}");
            scenes += 1;
        }
    }
    assert_eq!(scenes, 32);
    for link in page.split("(gallery/").skip(1).filter_map(|rest| rest.split(')').next()) {
        let size = std::fs::metadata(docs.join("gallery").join(link)).unwrap().len();
        assert!((1000..=60_000).contains(&size), "{link}: {size} bytes");
    }
}
