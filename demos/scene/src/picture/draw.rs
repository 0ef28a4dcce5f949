//! Pictures and films of recorded runs (feature `render`).

use super::job::{RenderJob, RenderReport, nearest};
use super::quantity::Quantity;
use crate::scene::LoadedScene;
use sinew_render::RenderError;
use sinew_render::adapter::Gpu;
use sinew_render::compare::{Comparison, Grid, Layout, Panel};
use sinew_render::film::Film;
use sinew_render::image::{Image, Packing};
use sinew_render::look::Look;
use sinew_render::overlay::Fonts;
use sinew_render::painter::{Captions, Painter, decorate};
use sinew_render::scene::{Recording, Time};
use std::path::Path;
use std::sync::mpsc;
use std::time::Instant;

/// Pictures that wait for their overlay and encoder before drawing waits.
const QUEUE: usize = 4;

/// Draws the runs of a job.
pub(super) fn draw(
    scene: &LoadedScene,
    job: &RenderJob,
    runs: Vec<Recording>,
    gpu: Gpu,
    report: &mut RenderReport,
) -> Result<(), RenderError> {
    let panel = |recording: Recording| Panel { label: recording.label.clone(), recording };
    let panels: Vec<Panel> = runs.into_iter().map(panel).collect();
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
            write_picture(path, &image, job, report)?;
        }
        if job.png.is_some() || job.video.is_some() {
            film(scene, job, recording, report, FilmSource::One(&mut painter))?;
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
            write_picture(path, &image, job, report)?;
        }
        if job.png.is_some() || job.video.is_some() {
            film(scene, job, &recording, report, FilmSource::Several(&mut comparison))?;
        }
    }
    report.seconds[2] = start.elapsed().as_secs_f64();
    Ok(())
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
