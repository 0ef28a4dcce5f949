//! From a scene to files.

use super::capture::set_ranges;
use super::capture::{CaptureOptions, Recorder};
use super::quantity::Quantity;
use crate::assemble::BuildOptions;
use crate::error::RunError;
use crate::run::{Observer, RunOptions, Silent, run};
use crate::scene::{LoadedScene, Mode};
use crate::summary::RunSummary;
use glam::Vec3;
use sinew_render::RenderError;
use sinew_render::adapter::{AdapterRequest, open};
use sinew_render::camera::CameraRequest;
use sinew_render::compare::{Comparison, Grid, Layout, Panel};
use sinew_render::film::Film;
use sinew_render::image::{Image, Packing};
use sinew_render::overlay::Fonts;
use sinew_render::page::write_page;
use sinew_render::painter::{Captions, Painter, decorate};
use sinew_render::renderer::Look;
use sinew_render::scene::{Frame, Recording, Time};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Instant;

/// Pictures that wait for their overlay and encoder before drawing waits.
const QUEUE: usize = 4;

/// A scene under a label.
#[derive(Clone, Debug)]
pub struct Variant {
    /// What stands above it.
    pub label: String,
    /// The scene.
    pub scene: LoadedScene,
}

/// What to draw and where to.
#[derive(Clone, Debug, Default)]
pub struct RenderJob {
    /// What replaces values of the scene.
    pub build: BuildOptions,
    /// Frames in all; those of the scene's output without.
    pub frames: Option<usize>,
    /// Width and height (pixels).
    pub size: [u32; 2],
    /// Folder for one PNG per frame.
    pub png: Option<PathBuf>,
    /// File for a film.
    pub video: Option<PathBuf>,
    /// File for one picture.
    pub picture: Option<PathBuf>,
    /// File for a page with a player.
    pub html: Option<PathBuf>,
    /// What stands above this scene when others are beside it; its name if empty.
    pub label: String,
    /// Other scenes, beside this one at the same times.
    pub beside: Vec<Variant>,
    /// Time (s) of that picture, of a static scene share of the loads; the end without.
    pub at: Option<f64>,
    /// Palette and tight packing for that picture.
    pub small: bool,
    /// Colours.
    pub quantity: Quantity,
    /// Camera.
    pub camera: CameraRequest,
    /// Adapter.
    pub adapter: AdapterRequest,
    /// Lines along sharp edges.
    pub edges: bool,
    /// No ground.
    pub no_ground: bool,
    /// No shape at rest.
    pub no_ghost: bool,
}

/// What was drawn.
#[derive(Clone, Debug, Default)]
pub struct RenderReport {
    /// Frames recorded.
    pub frames: usize,
    /// Pictures drawn.
    pub pictures: usize,
    /// Size (pixels).
    pub size: [u32; 2],
    /// Adapter.
    pub adapter: String,
    /// Host time (s) of the run, of that for copying frames, and from the first picture handed to the device
    /// to the last file written.
    pub seconds: [f64; 3],
    /// What was written.
    pub files: Vec<PathBuf>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl fmt::Display for RenderReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [run, capture, draw] = self.seconds;
        write!(f, "{} frames", self.frames)?;
        if self.pictures > 0 {
            let [width, height] = self.size;
            write!(f, ", {} pictures of {width} x {height} on {}", self.pictures, self.adapter)?;
        }
        writeln!(f)?;
        write!(f, "run {run:.2} s, of that {capture:.3} s for copying frames")?;
        if self.pictures > 0 {
            let rate = self.pictures as f64 / draw;
            write!(f, "; drawn in {draw:.2} s ({rate:.1} pictures per second)")?;
        }
        writeln!(f)?;
        for note in &self.notes {
            writeln!(f, "NOTE: {note}")?;
        }
        for file in &self.files {
            writeln!(f, "written to {}", file.display())?;
        }
        Ok(())
    }
}

/// Why a scene could not be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderJobError {
    /// The scene could not be run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// It could not be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Runs a scene and records it; returns the recording, the summary and the host times (s) of the run and of
/// copying frames.
///
/// # Errors
/// When the scene cannot be built.
pub fn record(
    scene: &LoadedScene,
    build: BuildOptions,
    capture: CaptureOptions,
    observer: &mut dyn Observer,
) -> Result<(Recording, RunSummary, [f64; 2]), RenderJobError> {
    let start = Instant::now();
    let mut recorder = Recorder::new(scene, capture, observer);
    let summary = run(scene, &RunOptions { build, ..RunOptions::default() }, &mut recorder)?;
    let (recording, seconds) = recorder.finish();
    Ok((recording, summary, [start.elapsed().as_secs_f64(), seconds]))
}

/// Runs a scene, and others beside it, and draws them. Frames are kept in memory while they run, since camera
/// and colours are fitted to all of them; the steps wait for nothing but the copies. A run that fails is drawn up
/// to there. The summary is that of the first run.
///
/// # Errors
/// When a scene cannot be built, no adapter fits or a file cannot be written.
pub fn render(
    scene: &LoadedScene,
    job: &RenderJob,
    observer: &mut dyn Observer,
) -> Result<(RenderReport, RunSummary), RenderJobError> {
    let pictures = job.png.is_some() || job.video.is_some() || job.picture.is_some();
    check_job(scene, job, pictures || job.html.is_some())?;
    // a missing adapter should not cost a run; a page needs none
    let gpu = if pictures { Some(open(&job.adapter).map_err(RenderError::from)?) } else { None };
    let mut report = RenderReport { size: job.size, ..RenderReport::default() };
    let (recording, summary) = recorded(scene, job, observer, &mut report)?;
    let label = if job.label.is_empty() { recording.title.clone() } else { job.label.clone() };
    let mut panels = vec![Panel { label, recording }];
    for Variant { label, scene } in &job.beside {
        let (recording, summary) = recorded(scene, job, observer, &mut report)?;
        if let Some(failure) = summary.failure {
            report.notes.push(format!("{label} ended early: {failure}"));
        }
        panels.push(Panel { label: label.clone(), recording });
    }
    report.frames = panels[0].recording.frames.len();
    if let Some(path) = &job.html {
        let runs: Vec<&Recording> = panels.iter().map(|p| &p.recording).collect();
        write_page(path, &runs, job.camera)?;
        report.files.push(path.clone());
    }
    let Some(gpu) = gpu else { return Ok((report, summary)) };
    let field = (job.quantity != Quantity::None).then_some(0);
    let dress = |look: &mut Look| {
        look.edges = job.edges;
        look.ground = !job.no_ground;
        look.ghost = !job.no_ghost;
    };
    let start = Instant::now();
    if panels.len() == 1 {
        let recording = &panels[0].recording;
        let mut painter = Painter::new(gpu, job.size, recording, job.camera, field, Captions::ALL)?;
        dress(&mut painter.look);
        report.adapter = painter.adapter();
        if let Some(path) = &job.picture {
            let frame = nearest(recording, job.at);
            let image = painter.picture(&Fonts::default(), recording, frame)?;
            write_picture(path, &image, job, &mut report)?;
        }
        if job.png.is_some() || job.video.is_some() {
            film(scene, job, recording, &mut report, FilmSource::One(&mut painter))?;
        }
    } else {
        let title = common_words(&panels, |r| &r.title, " · ");
        let layout = Layout::Whole(job.size);
        let grid = Grid { title: &title, layout, camera: job.camera, field };
        // the clock is that of the first
        let recording = panels[0].recording.clone();
        let mut comparison = Comparison::new(gpu, panels, &grid)?;
        dress(&mut comparison.look);
        report.adapter = comparison.adapter();
        if let Some(path) = &job.picture {
            let image = beside(&mut comparison, &recording, nearest(&recording, job.at))?;
            write_picture(path, &image, job, &mut report)?;
        }
        if job.png.is_some() || job.video.is_some() {
            film(scene, job, &recording, &mut report, FilmSource::Several(&mut comparison))?;
        }
    }
    report.seconds[2] = start.elapsed().as_secs_f64();
    Ok((report, summary))
}

/// Refuses, before the run, what could not be drawn after it.
fn check_job(scene: &LoadedScene, job: &RenderJob, asked: bool) -> Result<(), RenderError> {
    if !asked {
        let nothing = "give --html FILE, --picture FILE, --png DIR or --video FILE";
        return Err(RenderError::Empty(nothing.into()));
    }
    let refuse = |option, found: String, remedy: String| {
        Err(RenderError::Option { option, found, remedy })
    };
    let ending = |path: &Path| path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if let Some(path) = job.picture.as_ref().filter(|path| ending(path).as_deref() != Some("png")) {
        let remedy = "pictures are PNG: give a name that ends in .png";
        return refuse("--picture", path.display().to_string(), remedy.into());
    }
    let (end, of) = match scene.scene.mode {
        Mode::Static => (Some(1.0), "the share of the loads is 0 to 1".to_string()),
        Mode::Dynamic => {
            let end = scene.scene.duration;
            (end, format!("the scene runs from 0 to {} s", end.unwrap_or_default()))
        }
    };
    match (job.at, end) {
        // steps may end a little later
        (Some(at), Some(end)) if !(-1e-9..=end * (1.0 + 1e-6)).contains(&at) => {
            refuse("--at", at.to_string(), of)
        }
        _ => Ok(()),
    }
}

/// Runs and records what the job asks for.
fn recorded(
    scene: &LoadedScene,
    job: &RenderJob,
    observer: &mut dyn Observer,
    report: &mut RenderReport,
) -> Result<(Recording, RunSummary), RenderJobError> {
    let mut quantities = vec![job.quantity];
    if job.html.is_some() {
        // the page lets people choose
        let more = Quantity::ALL.into_iter().chain([Quantity::Pressure]);
        quantities.extend(more.filter(|q| *q != job.quantity));
        quantities.retain(|q| *q != Quantity::None);
    }
    let capture = CaptureOptions { frames: job.frames, quantities, ..CaptureOptions::default() };
    let finer =
        if job.quantity == Quantity::Error { Some(finer(scene, job, &capture)?) } else { None };
    let (mut recording, summary, [run, copy]) = record(scene, job.build, capture, observer)?;
    if job.quantity != Quantity::Pressure {
        drop_unused_pressure(&mut recording);
    }
    if let Some(finer) = &finer {
        compare_steps(&mut recording, finer);
    }
    report.seconds[0] += run;
    report.seconds[1] += copy;
    Ok((recording, summary))
}

/// Takes the pressure away where nothing touches.
fn drop_unused_pressure(recording: &mut Recording) {
    let Some(field) = recording.fields.iter().position(|f| f.name == "pressure") else { return };
    if recording.frames.iter().all(|frame| frame.fields[field].iter().all(|p| *p == 0.0)) {
        recording.fields.remove(field);
        for frame in &mut recording.frames {
            frame.fields.remove(field);
        }
    }
}

/// Writes the one picture of a job.
fn write_picture(
    path: &Path,
    image: &Image,
    job: &RenderJob,
    report: &mut RenderReport,
) -> Result<(), RenderError> {
    image.write_png(path, if job.small { Packing::Small } else { Packing::Fast })?;
    report.pictures += 1;
    report.files.push(path.into());
    Ok(())
}

/// What all runs have in common of a text, part by part.
fn common_words(panels: &[Panel], of: impl Fn(&Recording) -> &str, separator: &str) -> String {
    let shared = |part: &&str| {
        panels[1..].iter().all(|p| of(&p.recording).split(separator).any(|other| other == *part))
    };
    let parts: Vec<_> = of(&panels[0].recording).split(separator).filter(shared).collect();
    parts.join(separator)
}

/// All runs at the time of frame `i` of `clock`.
fn beside(comparison: &mut Comparison, clock: &Recording, i: usize) -> Result<Image, RenderError> {
    let at = clock.frames[i].time;
    let frames: Vec<usize> =
        comparison.panels().iter().map(|p| nearest(&p.recording, Some(at))).collect();
    let time = Time { at, is_static: clock.is_static };
    let words = common_words(comparison.panels(), |r| &r.subtitle, " · ");
    let subtitle = if words.is_empty() { time.to_string() } else { format!("{time} · {words}") };
    comparison.picture(&subtitle, &frames)
}

/// Steps of the finer run in one.
const FINER: u64 = 4;

/// The same scene with a quarter of the step, at the same times.
fn finer(
    scene: &LoadedScene,
    job: &RenderJob,
    capture: &CaptureOptions,
) -> Result<Recording, RenderJobError> {
    let refused = |remedy: &str| RenderError::Option {
        option: "--color",
        found: "error".into(),
        remedy: remedy.into(),
    };
    let mut scene = scene.clone();
    let Some(dt) = &mut scene.scene.dt else {
        return Err(refused("it needs a step to make smaller, and this scene is static").into());
    };
    *dt /= FINER as f64;
    if !scene.scene.resections.is_empty() {
        let remedy =
            "with another step a resection removes other elements; choose another quantity";
        return Err(refused(remedy).into());
    }
    if let Some(every) = &mut scene.scene.output.every {
        *every *= FINER;
    }
    let build = BuildOptions { steps: job.build.steps.map(|n| FINER * n), ..job.build };
    let quantities = vec![Quantity::Displacement];
    let capture = CaptureOptions { quantities, substeps: FINER, ..capture.clone() };
    Ok(record(&scene, build, capture, &mut Silent)?.0)
}

/// Fills the field `error` with the distances to the finer run; a frame that it does not have keeps 0.
fn compare_steps(recording: &mut Recording, finer: &Recording) {
    let Some(field) = recording.fields.iter().position(|f| f.name == "error") else { return };
    for frame in &mut recording.frames {
        let meets = |other: &&Frame| other.step == FINER * frame.step;
        let values = &mut frame.fields[field];
        values.fill(0.0);
        if let Some(other) = finer.frames.iter().find(meets) {
            for ((value, p), q) in values.iter_mut().zip(&frame.points).zip(&other.points) {
                *value = Vec3::from_array(*p).distance(Vec3::from_array(*q));
            }
        }
    }
    set_ranges(recording);
}

/// The frame nearest to a time, the last without.
pub fn nearest(recording: &Recording, at: Option<f64>) -> usize {
    let last = recording.frames.len() - 1;
    let Some(at) = at else { return last };
    let distance = |i: usize| (recording.frames[i].time - at).abs();
    (0..=last).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(last)
}

/// What draws a film.
enum FilmSource<'a> {
    One(&'a mut Painter),
    Several(&'a mut Comparison),
}

/// All frames: the device draws while another thread writes the overlay and encodes.
fn film(
    scene: &LoadedScene,
    job: &RenderJob,
    recording: &Recording,
    report: &mut RenderReport,
    source: FilmSource,
) -> Result<(), RenderError> {
    if let Some(folder) = &job.png {
        std::fs::create_dir_all(folder)
            .map_err(|e| RenderError::Write { path: folder.clone(), reason: e.to_string() })?;
    }
    let stem = scene.scene.name.replace(|c: char| !c.is_alphanumeric() && c != '-', "_");
    let frames: Vec<usize> = (0..recording.frames.len()).collect();
    // as fast as it happened; load steps one after another
    let rate = if recording.interval > 0.0 { 1.0 / recording.interval } else { 2.0 };
    let mut video = match &job.video {
        Some(path) => Some(Film::start(path, job.size, frames.len() as u32, rate)?),
        None => None,
    };
    if let (Some(film), Some(asked)) = (&video, &job.video)
        && film.path() != asked
    {
        report.notes.push(format!(
            "no ffmpeg on the path: {} is an animated PNG in place of {}; install ffmpeg for films",
            film.path().display(),
            asked.display()
        ));
    }
    // a comparison has its overlay already
    let overlay = match &source {
        FilmSource::One(painter) => Some((painter.look.field, painter.captions)),
        FilmSource::Several(_) => None,
    };
    let (sender, receiver) = mpsc::sync_channel::<(usize, Image)>(QUEUE);
    let encoded = std::thread::scope(|scope| {
        let video = &mut video;
        let encoder = scope.spawn(move || {
            let fonts = Fonts::default();
            for (i, mut image) in receiver {
                if let Some((field, captions)) = overlay {
                    let frame = &recording.frames[i];
                    decorate(&mut image, &fonts, recording, frame, field, captions);
                }
                if let Some(folder) = &job.png {
                    let name = format!("{stem}_{i:05}.png");
                    image.write_png(&folder.join(name), Packing::Fast)?;
                }
                if let Some(film) = video.as_mut() {
                    film.add(&image)?;
                }
            }
            Ok::<(), RenderError>(())
        });
        let stopped = || RenderError::Device("the encoder has stopped".into());
        let mut send = |i, image| sender.send((i, image)).map_err(|_| stopped());
        let drawn = match source {
            FilmSource::One(painter) => painter.film(recording, &frames, &mut send),
            FilmSource::Several(comparison) => {
                frames.iter().try_for_each(|&i| send(i, beside(comparison, recording, i)?))
            }
        };
        drop(sender);
        // what the encoder says comes first: drawing stops because of it
        let encoded = encoder.join().unwrap_or_else(|_| Err(stopped()));
        encoded.and(drawn)
    });
    encoded?;
    report.pictures += frames.len();
    report.files.extend(job.png.clone());
    if let Some(film) = video {
        report.files.push(film.finish()?);
    }
    Ok(())
}
