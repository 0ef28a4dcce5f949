//! The progress bar of `sinew run`, on stderr.

use indicatif::{ProgressBar, ProgressStyle};
use sinew_scene::assemble::BuiltScene;
use sinew_scene::run::Observer;
use std::path::PathBuf;

/// A bar with rate and time left; nothing when stderr is no terminal.
#[derive(Default)]
pub struct Progress {
    bar: Option<ProgressBar>,
}

impl Observer for Progress {
    fn built(&mut self, scene: &mut BuiltScene) {
        // the report comes too late for this one
        for warning in scene.warnings.iter().filter(|w| w.code == "scene.steps.many") {
            eprintln!("warning: {}; {}", warning.message, warning.remedy);
        }
    }

    fn resumed(&mut self, done: Option<u64>, damaged: &[PathBuf]) {
        for path in damaged {
            eprintln!("warning: {} is damaged and was passed over", path.display());
        }
        match done {
            Some(done) => eprintln!("goes on after step {done}, from a checkpoint"),
            None => eprintln!("there is no checkpoint: the run begins at its start"),
        }
    }

    fn start(&mut self, name: &str, steps: u64) {
        let bar = ProgressBar::new(steps);
        let template = "{prefix} [{bar:30}] {pos}/{len} steps, {msg}, {per_sec}, {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(name.to_string());
        self.bar = Some(bar);
    }

    fn step(&mut self, done: u64, time: f64, scene: &mut BuiltScene) {
        if let Some(bar) = &self.bar {
            let iterations = scene.simulation.report().cg_iterations;
            bar.set_message(format!("t = {time:.2} s, {iterations} CG"));
            bar.set_position(done);
        }
    }

    fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}
