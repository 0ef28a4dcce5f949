//! From a scene to files.

use super::capture::set_ranges;
use super::capture::{CaptureOptions, Recorder};
use super::quantity::Quantity;
use crate::assemble::BuildOptions;
use crate::error::RunError;
use crate::output::stem;
use crate::run::{Both, Observer, RunOptions, Silent, run};
use crate::scene::{LoadedScene, Mode};
use crate::summary::RunSummary;
use crate::warning::{Level, Warning};
use glam::Vec3;
use sinew_render::RenderError;
#[cfg(feature = "render")]
use sinew_render::adapter::{AdapterRequest, open};
use sinew_render::camera::CameraRequest;
use sinew_render::page::{page, write_page};
use sinew_render::scene::{Frame, Recording};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

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
    #[cfg(feature = "render")]
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
    /// A scene of the gallery ended early: its picture would not show what it says.
    #[error("{scene} ended early: {failure}; mend the scene or take it out of the gallery")]
    Failed {
        /// The scene.
        scene: String,
        /// Why it ended.
        failure: String,
    },
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
    let mut recorder = Recorder::new(&scene.scene.name, capture);
    let options = RunOptions { build, ..RunOptions::default() };
    let summary = run(scene, &options, &mut Both(observer, &mut recorder))?;
    let (mut recording, seconds) = recorder.finish();
    doubt(&mut recording, &summary);
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
    let asked = [
        ("--picture", job.picture.is_some()),
        ("--png", job.png.is_some()),
        ("--video", job.video.is_some()),
    ];
    let pictures = asked.into_iter().find(|(_, asked)| *asked).map(|(option, _)| option);
    check_job(scene, job, pictures.is_some() || job.html.is_some())?;
    #[cfg(not(feature = "render"))]
    if let Some(option) = pictures {
        return Err(RenderError::NoPictures(option).into());
    }
    // a missing adapter should not cost a run; a page needs none
    #[cfg(feature = "render")]
    let gpu = match pictures {
        Some(_) => Some(open(&job.adapter).map_err(RenderError::from)?),
        None => None,
    };
    let mut report = RenderReport { size: job.size, ..RenderReport::default() };
    let (mut recording, summary) = recorded(scene, job, observer, &mut report)?;
    recording.label.clone_from(if job.label.is_empty() { &recording.title } else { &job.label });
    let mut runs = vec![recording];
    for Variant { label, scene } in &job.beside {
        let (mut recording, summary) = recorded(scene, job, observer, &mut report)?;
        if let Some(failure) = summary.failure {
            report.notes.push(format!("{label} ended early: {failure}"));
        }
        recording.label.clone_from(label);
        runs.push(recording);
    }
    report.frames = runs[0].frames.len();
    if let Some(path) = &job.html {
        write_page(path, &runs.iter().collect::<Vec<_>>(), job.camera)?;
        report.files.push(path.clone());
    }
    #[cfg(feature = "render")]
    if let Some(gpu) = gpu {
        super::draw::draw(scene, job, runs, gpu, &mut report)?;
    }
    Ok((report, summary))
}

/// Refuses, before the run, what could not be drawn after it.
fn check_job(scene: &LoadedScene, job: &RenderJob, asked: bool) -> Result<(), RenderError> {
    if !asked {
        let nothing = "give --html FILE, --picture FILE, --png DIR or --video FILE";
        return Err(RenderError::Empty(nothing.into()));
    }
    let refuse =
        |option, found: String, remedy: String| Err(RenderError::Option { option, found, remedy });
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
    let quantities =
        if job.html.is_some() { page_quantities(job.quantity) } else { vec![job.quantity] };
    let page = job.html.is_some();
    let capture =
        CaptureOptions { frames: job.frames, quantities, page, ..CaptureOptions::default() };
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

/// Quantities of a page, which lets people choose, the first one before all others.
fn page_quantities(first: Quantity) -> Vec<Quantity> {
    let more = Quantity::ALL.into_iter().chain([Quantity::Pressure]);
    let all = [first].into_iter().chain(more.filter(|q| *q != first));
    all.filter(|q| *q != Quantity::None).collect()
}

/// Where the page of a run is that nobody named: beside its files, or in the folder `out`.
pub fn page_beside(scene: &LoadedScene, out: Option<&Path>) -> PathBuf {
    out.unwrap_or("out".as_ref()).join(format!("{}.html", stem(&scene.scene.name)))
}

/// Runs a scene as [`run`] does and writes a page with a player of it, up to where it failed. A page that was not
/// `asked` for may fail: the run then has a warning.
///
/// # Errors
/// When the scene cannot be built or a file cannot be written.
pub fn run_to_page(
    scene: &LoadedScene,
    options: &RunOptions,
    page: &Path,
    asked: bool,
    observer: &mut dyn Observer,
) -> Result<RunSummary, RenderJobError> {
    if asked {
        // a page that cannot be written should not cost a run
        let fresh = !page.exists();
        let opened = std::fs::File::options().create(true).append(true).open(page);
        opened.map_err(|e| RenderError::Write { path: page.into(), reason: e.to_string() })?;
        if fresh {
            // what cannot be removed is empty
            let _ = std::fs::remove_file(page);
        }
    }
    let quantities = page_quantities(Quantity::default());
    let capture = CaptureOptions { quantities, page: true, ..CaptureOptions::default() };
    let mut recorder = Recorder::new(&scene.scene.name, capture);
    let mut summary = run(scene, options, &mut Both(observer, &mut recorder))?;
    let due = recorder.due;
    let (mut recording, _) = recorder.finish();
    doubt(&mut recording, &summary);
    drop_unused_pressure(&mut recording);
    if let Some(folder) = page.parent().filter(|_| !asked) {
        // the page says so if it cannot be made
        let _ = std::fs::create_dir_all(folder);
    }
    match write_page(page, &[&recording], CameraRequest::default()) {
        Ok(()) => {
            let frames = recording.frames.len();
            let of = if frames < due && summary.completed {
                format!("{frames} of {due} frames, for its size")
            } else {
                format!("{frames} frames")
            };
            summary.files.push(format!("{} (open in a browser; {of})", page.display()));
        }
        Err(error) if asked => return Err(error.into()),
        Err(error) => {
            // half a page would be worse than none
            let _ = std::fs::remove_file(page);
            let remedy = "give --page FILE for another place, or --no-page";
            let (message, level) = (error.to_string(), Level::Warning);
            summary.warnings.push(Warning::new("run.page", level, "page", message, remedy));
        }
    }
    Ok(summary)
}

impl Recorder {
    /// For a page of what nobody knows the end of: a frame now and after every so many steps.
    pub fn open(name: impl Into<String>, every: u64) -> Self {
        let quantities = page_quantities(Quantity::default());
        let every = Some(every.max(1));
        Self::new(
            name,
            CaptureOptions { quantities, every, page: true, ..CaptureOptions::default() },
        )
    }

    /// Ends the recording; a page with a player of it, which says why it is not to be trusted, if so.
    ///
    /// # Errors
    /// When something in it is not finite.
    pub fn into_page(self, untrusted: Option<String>) -> Result<String, RenderError> {
        let (mut recording, _) = self.finish();
        if let Some(why) = untrusted {
            mark_doubted(&mut recording, "NOT TO BE TRUSTED", why);
        }
        drop_unused_pressure(&mut recording);
        page(&[&recording], CameraRequest::default())
    }
}

/// Marks the recording of a run that is not to be trusted, or that failed: a page says why, and every caption that it is so.
fn doubt(recording: &mut Recording, summary: &RunSummary) {
    let Some(why) = summary.doubted() else { return };
    let mark = if summary.untrusted { "NOT TO BE TRUSTED" } else { "FAILED" };
    mark_doubted(recording, mark, why);
}

fn mark_doubted(recording: &mut Recording, mark: &str, why: String) {
    recording.subtitle = format!("{mark} · {}", recording.subtitle);
    recording.warning = why;
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
    if !(scene.scene.resections.is_empty() && scene.scene.cuts.is_empty()) {
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
