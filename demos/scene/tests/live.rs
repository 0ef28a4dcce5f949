//! A scene that runs while somebody pulls at it and cuts it.

use crate::pictures::software;
use sinew_render::adapter::open;
use sinew_render::camera::Camera;
use sinew_scene::picture::{LiveOptions, LiveView};
use sinew_scene::scene::LoadedScene;
use std::path::Path;
use std::time::Duration;

/// A block of 0.1 m that stands on the floor.
const BLOCK: &str = r#"
name = "block"
description = "a block that is pulled at"
dt = 0.01
duration = 0.05
gravity = [0.0, 0.0, 0.0]
[solver]
integrator = "safe"
[[body]]
name = "block"
generate = { box = { size = [0.1, 0.1, 0.1], cells = [5, 5, 5] } }
material = { young_modulus = 2e4, poisson_ratio = 0.3, density = 1000.0 }
[[constraint]]
name = "floor"
select = { group = "z0" }
"#;

fn view(text: &str, options: LiveOptions) -> Option<LiveView> {
    let scene = LoadedScene::parse(text, Path::new("block.toml")).unwrap();
    let options = LiveOptions { size: [240, 160], ..options };
    Some(LiveView::open(&scene, options, open(&software()?).unwrap()).unwrap())
}

const MIDDLE: [f32; 2] = [0.5, 0.5];
const FRAME: Duration = Duration::from_millis(20);

/// A hand pulls the place that it holds towards the mouse with the force that it says, and nothing once it lets go.
#[test]
fn a_hand_pulls_what_it_holds() {
    let Some(mut view) = view(BLOCK, LiveOptions::default()) else { return };
    let rest = view.picture().unwrap();
    assert!(!view.grab([0.01, 0.99]) && view.hand().is_none(), "there is only ground");
    assert!(view.grab(MIDDLE));
    let at = [MIDDLE[0] + 0.1, MIDDLE[1]];
    view.drag(at);
    let count: u32 = (0..40).map(|_| view.advance(FRAME)).sum();
    assert_eq!((count, view.done().0), (80, 80), "the scene goes on beyond its end");
    let hand = *view.hand().unwrap();
    let right = view.camera().right.as_dvec3();
    // the hand feels the spring of 150 N/m: back to where it took hold
    assert!(hand.force.dot(right) < -0.1 && hand.distance > 1e-3, "{hand:?}");
    assert!((hand.force.length() - 150.0 * hand.distance).abs() < 0.02 * hand.force.length());
    assert!(view.words().contains("hand ") && !view.words().contains("NOT"), "{}", view.words());
    let moved = |view: &mut LiveView| {
        let body = view.built().bodies[0].handle;
        let all = view.built().simulation.displacements(body);
        all.iter().map(|u| u.dot(right)).fold(0.0, f64::max)
    };
    assert!(moved(&mut view) > 2e-3, "{}", moved(&mut view));
    assert_ne!(view.picture().unwrap().data, rest.data);
    // colours reach as far as the largest displacement that was shown
    let most = view.range().unwrap()[1];
    assert!((2e-3..0.03).contains(&most), "{most}");
    view.release();
    assert!(view.hand().is_none());
    for _ in 0..200 {
        view.advance(FRAME);
    }
    assert!(moved(&mut view) < 1e-4, "{}", moved(&mut view));
    assert_eq!(view.range().unwrap()[1], most);
}

/// A line across the block parts what lies behind it, as seen from the camera.
#[test]
fn a_line_cuts_what_lies_behind_it() {
    let Some(mut view) = view(BLOCK, LiveOptions::default()) else { return };
    assert_eq!(view.cut([0.0, 0.0], [0.05, 0.0]), 0);
    assert_eq!(view.said, "no body behind the line");
    let parted = view.cut([0.02, 0.48], [0.98, 0.48]);
    assert!(parted > 40 && view.said.contains("pieces: 2"), "{parted} {}", view.said);
    view.step();
    view.picture().unwrap();
    // both sides of the wound are drawn: points that nobody had before
    let world = view.built().simulation.topology();
    assert!(world.bodies[0].copies.ghosts.len() > 20);
    view.restart().unwrap();
    assert_eq!((view.done().0, view.built().simulation.topology().bodies[0].piece_count()), (0, 1));
    // what cannot be cut says so
    let pooled =
        BLOCK.replace("name = \"block\"\ng", "name = \"block\"\nevaluation = \"pooled\"\ng");
    let mut view = self::view(&pooled, LiveOptions::default()).unwrap();
    assert_eq!(view.cut([0.02, 0.48], [0.98, 0.48]), 0);
    assert!(view.said.contains("NOT CUT") && view.said.contains("pooled"), "{}", view.said);
}

/// The camera turns, comes nearer and keeps its place; a picture of another size shows the same.
#[test]
fn the_camera_is_where_it_was_taken() {
    let Some(mut view) = view(BLOCK, LiveOptions::default()) else { return };
    let first: Camera = *view.camera();
    view.turn([0.25, 0.1]);
    view.zoom(0.5);
    let turned = *view.camera();
    assert!(turned.forward.dot(first.forward) < 0.9 && turned.up.z > 0.5, "{turned:?}");
    let far = |camera: &Camera| camera.eye.distance(glam::Vec3::splat(0.05));
    assert!(far(&turned) < 0.7 * far(&first), "{first:?} {turned:?}");
    view.restart().unwrap();
    assert_eq!(*view.camera(), turned);
    view.resize([100, 160]).unwrap();
    assert_eq!(view.camera().forward, turned.forward);
    let image = view.picture().unwrap();
    assert_eq!((image.width, image.height, view.size()), (100, 160, [100, 160]));
}

/// A pause, a single step, a step that fails, a clock that is ahead: all is told.
#[test]
fn what_goes_wrong_is_told() {
    let Some(mut view) = view(BLOCK, LiveOptions::default()) else { return };
    view.paused = true;
    assert_eq!(view.advance(FRAME), 0);
    assert!(view.step() && view.done().0 == 1 && view.words().starts_with("paused"));
    view.paused = false;
    // ten steps are due, four are taken
    assert_eq!(view.advance(Duration::from_millis(100)), 4);
    assert!(view.words().contains("0.1 s behind the clock"), "{}", view.words());
    let cap = BLOCK.replace("\"safe\"", "\"newton\"\nmax_newton_iterations = 1");
    let mut view = self::view(&cap, LiveOptions { spring: 1e5, ..LiveOptions::default() }).unwrap();
    assert!(view.grab(MIDDLE));
    view.drag([0.9, 0.2]);
    view.step();
    assert!(view.words().starts_with("NOT CONVERGED"), "{}", view.words());
    let scene = LoadedScene::parse(BLOCK, Path::new("block.toml")).unwrap();
    let gpu = open(&software().unwrap()).unwrap();
    let options = LiveOptions { spring: -1.0, ..LiveOptions::default() };
    let error = LiveView::open(&scene, options, gpu).err().unwrap().to_string();
    assert!(error.contains("--spring") && error.contains("-1"), "{error}");
}
