//! The window in a virtual display, where there are one and a driver.

use sinew_render::adapter::{AdapterRequest, open};
use sinew_scene::picture::{LiveOptions, LiveView};
use sinew_scene::scene::LoadedScene;
use sinew_window::{WindowError, show_in};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use winit::event_loop::EventLoop;
use winit::platform::x11::EventLoopBuilderExtX11;

/// Pictures that are shown.
const PICTURES: u64 = 12;

/// To whoever looks, and to the test that started this one.
fn say(words: &str) {
    // nobody may be there
    let _ = writeln!(std::io::stdout(), "{words}");
}

/// What runs in the display, in a process of its own: it has the name of the display in its environment.
#[test]
#[ignore = "asks for a display; the other test gives it one"]
fn in_a_display() {
    if std::env::var_os("SINEW_TEST_DISPLAY").is_none() {
        return;
    }
    let scenes = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes"));
    let scene = LoadedScene::read(&scenes.join("grasp.toml")).unwrap();
    let gpu = open(&AdapterRequest::default()).unwrap();
    let options = LiveOptions { size: [320, 240], ..LiveOptions::default() };
    let view = LiveView::open(&scene, options, gpu).unwrap();
    let mut builder = EventLoop::builder();
    builder.with_any_thread(true).with_x11();
    let (view, pictures) = match show_in(builder, view, Some(PICTURES)) {
        Err(error @ WindowError::Display(_)) => return say(&format!("skipped: {error}")),
        shown => shown.unwrap(),
    };
    assert_eq!(pictures, PICTURES);
    let (steps, figures) = view.done();
    assert!(steps > 0 && figures.steps == steps, "{steps} {figures:?}");
    say(&format!("shown: {}", view.words()));
}

struct Display(Child);

impl Drop for Display {
    fn drop(&mut self) {
        // it may be gone already
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_scene_runs_in_a_window() {
    if let Err(why) = open(&AdapterRequest::default()) {
        return say(&format!("skipped: {why}"));
    }
    // it says which display it took
    let server = Command::new("Xvfb")
        .args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut server) = server.map(Display) else {
        return say("skipped: no Xvfb");
    };
    let mut said = String::new();
    let out = server.0.stdout.take().unwrap();
    BufReader::new(out).read_line(&mut said).unwrap();
    let display = format!(":{}", said.trim());
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "view::in_a_display", "--nocapture"])
        .env("DISPLAY", display)
        .env("SINEW_TEST_DISPLAY", "1")
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let _ = child.kill();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let is_told = text.contains("shown: ") || text.contains("skipped: ");
    assert!(output.status.success() && is_told, "{text}");
    say(&text);
}
