//! Scenes to recordings and pictures (feature `render`).

use sinew::prelude::Model;
use sinew_demos::build::BuildOptions;
use sinew_demos::picture::{CaptureOptions, Quantity, Recorder, RenderJob, Variant, render};
use sinew_demos::run::{RunOptions, Silent, run};
use sinew_demos::scene::LoadedScene;
use sinew_demos::shipped_scene;
use sinew_render::adapter::{AdapterError, AdapterRequest, open};
use sinew_render::image::Image;
use sinew_render::scene::Recording;
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
    let capture = CaptureOptions { frames: Some(9), quantities, ..CaptureOptions::default() };
    let mut silent = Silent;
    let mut recorder = Recorder::new(scene, capture, &mut silent);
    let summary = run(scene, &options(steps), &mut recorder).unwrap();
    assert_eq!(summary.failure, None);
    let (recording, _) = recorder.finish();
    recording.check().unwrap();
    (recording, summary.final_state_hash)
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

/// A software adapter, or none after a message.
fn software() -> Option<AdapterRequest> {
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

#[test]
fn the_gallery_shows_every_scene_in_small_files() {
    let docs = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let page = std::fs::read_to_string(docs.join("gallery.md")).unwrap();
    let mut scenes = 0;
    for entry in std::fs::read_dir(sinew_demos::scene_folder()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        // what is fitted to data is a table, what runs side by side a report: no pictures
        let mut unseen = ["fit_bar", "side_by_side"].contains(&name.as_str());
        // pictures do not show tools yet
        let loaded = || sinew_demos::scene::LoadedScene::read(&path).unwrap().scene;
        unseen |= path.extension().is_some_and(|e| e == "toml") && !loaded().tools.is_empty();
        if path.extension().is_some_and(|e| e == "toml") && !unseen {
            assert!(page.contains(&format!("(gallery/{name}.png)")), "{name}");
            scenes += 1;
        }
    }
    assert_eq!(scenes, 11);
    for link in page.split("(gallery/").skip(1).filter_map(|rest| rest.split(')').next()) {
        let size = std::fs::metadata(docs.join("gallery").join(link)).unwrap().len();
        assert!((1000..=60_000).contains(&size), "{link}: {size} bytes");
    }
}
