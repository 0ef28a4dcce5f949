//! Films: through an `ffmpeg` on the path, as animated PNG without.

use crate::error::RenderError;
use crate::image::Image;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

/// A film that is being written.
pub struct Film {
    path: PathBuf,
    kind: FilmKind,
}

enum FilmKind {
    Ffmpeg { child: Child, pipe: Option<ChildStdin> },
    Png(Box<png::Writer<std::io::BufWriter<std::fs::File>>>),
}

/// Whether an `ffmpeg` is on the path.
pub fn has_ffmpeg() -> bool {
    let null = Stdio::null;
    let found = Command::new("ffmpeg").arg("-version").stdout(null()).stderr(null()).status();
    found.is_ok_and(|status| status.success())
}

impl Film {
    /// Starts a film of `frames` pictures. Without ffmpeg, or for a name that ends in `.png` or `.apng`, it is
    /// an animated PNG; [`Film::path`] says where.
    ///
    /// # Errors
    /// When the file cannot be written or ffmpeg not be started.
    pub fn start(
        path: &Path,
        [width, height]: [u32; 2],
        frames: u32,
        rate: f64,
    ) -> Result<Self, RenderError> {
        Self::start_with(path, [width, height], frames, rate, has_ffmpeg())
    }

    /// As [`Film::start`], whether there is `ffmpeg` or not.
    ///
    /// # Errors
    /// As [`Film::start`].
    pub fn start_with(
        path: &Path,
        [width, height]: [u32; 2],
        frames: u32,
        rate: f64,
        ffmpeg: bool,
    ) -> Result<Self, RenderError> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let animated = matches!(ending.as_deref(), Some("png" | "apng"));
        if ffmpeg && !animated {
            let mut command = Command::new("ffmpeg");
            command
                .args(["-y", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "rgb24"])
                .args(["-video_size", &format!("{width}x{height}")])
                .args(["-framerate", &format!("{rate:.4}"), "-i", "-", "-an"]);
            if ending.as_deref() != Some("gif") {
                // players want even sides and half the colour resolution
                command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]);
            }
            if ending.as_deref() == Some("mp4") {
                command.args(["-preset", "veryfast", "-crf", "18", "-movflags", "+faststart"]);
            }
            let child = command
                .arg(path)
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn();
            let mut child = child.map_err(|e| film(path, e.to_string()))?;
            let pipe = child.stdin.take();
            return Ok(Self { path: path.into(), kind: FilmKind::Ffmpeg { child, pipe } });
        }
        let path = if animated { path.to_path_buf() } else { path.with_extension("png") };
        let error = |reason: String| RenderError::Write { path: path.clone(), reason };
        let file = std::fs::File::create(&path).map_err(|e| error(e.to_string()))?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let prepared = encoder.set_animated(frames.max(1), 0).and_then(|()| {
            let delay = (1000.0 / rate).round().clamp(1.0, 60_000.0) as u16;
            encoder.set_frame_delay(delay, 1000)
        });
        prepared.map_err(|e| error(e.to_string()))?;
        let writer = encoder.write_header().map_err(|e| error(e.to_string()))?;
        Ok(Self { path, kind: FilmKind::Png(Box::new(writer)) })
    }

    /// The file that is written: for an animated PNG in place of a film the name asked for with the ending
    /// `.png`.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is an animated PNG.
    pub fn is_png(&self) -> bool {
        matches!(self.kind, FilmKind::Png(_))
    }

    /// Adds a picture, which must have the size of the film.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add(&mut self, image: &Image) -> Result<(), RenderError> {
        let written = match &mut self.kind {
            FilmKind::Ffmpeg { pipe, .. } => match pipe {
                Some(pipe) => pipe.write_all(&image.rgb()).map_err(|e| e.to_string()),
                None => Err("it has stopped".into()),
            },
            FilmKind::Png(writer) => {
                writer.write_image_data(&image.rgb()).map_err(|e| e.to_string())
            }
        };
        match written {
            Ok(()) => Ok(()),
            // ffmpeg knows better why it went away than the broken pipe
            Err(reason) => match &mut self.kind {
                FilmKind::Ffmpeg { child, pipe } => {
                    drop(pipe.take());
                    Err(film(&self.path, words(child).unwrap_or(reason)))
                }
                FilmKind::Png(_) => Err(RenderError::Write { path: self.path.clone(), reason }),
            },
        }
    }

    /// Ends the film and returns its file.
    ///
    /// # Errors
    /// When it cannot be ended.
    pub fn finish(self) -> Result<PathBuf, RenderError> {
        match self.kind {
            FilmKind::Ffmpeg { mut child, pipe } => {
                drop(pipe);
                let said = words(&mut child);
                let status = child.wait().map_err(|e| film(&self.path, e.to_string()))?;
                if !status.success() {
                    let reason = said.unwrap_or_else(|| status.to_string());
                    return Err(film(&self.path, reason));
                }
            }
            FilmKind::Png(writer) => {
                let error = |reason| RenderError::Write { path: self.path.clone(), reason };
                writer.finish().map_err(|e| error(e.to_string()))?;
            }
        }
        Ok(self.path)
    }
}

fn film(path: &Path, reason: String) -> RenderError {
    RenderError::Film { path: path.into(), reason }
}

/// The last line that ffmpeg wrote, if any.
fn words(child: &mut Child) -> Option<String> {
    let mut text = String::new();
    child.stderr.take()?.read_to_string(&mut text).ok()?;
    text.lines().rfind(|line| !line.trim().is_empty()).map(|line| line.trim().to_owned())
}
