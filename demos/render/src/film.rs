//! Films: through an `ffmpeg` on the path, as animated PNG without.

use crate::error::RenderError;
use crate::image::Image;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

/// A film that is being written.
pub struct Film {
    path: PathBuf,
    kind: Kind,
}

enum Kind {
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

    fn start_with(
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
            return Ok(Self { path: path.into(), kind: Kind::Ffmpeg { child, pipe } });
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
        Ok(Self { path, kind: Kind::Png(Box::new(writer)) })
    }

    /// The file that is written: for an animated PNG in place of a film the name asked for with the ending
    /// `.png`.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is an animated PNG.
    pub fn is_png(&self) -> bool {
        matches!(self.kind, Kind::Png(_))
    }

    /// Adds a picture, which must have the size of the film.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add(&mut self, image: &Image) -> Result<(), RenderError> {
        let written = match &mut self.kind {
            Kind::Ffmpeg { pipe, .. } => match pipe {
                Some(pipe) => pipe.write_all(&image.rgb()).map_err(|e| e.to_string()),
                None => Err("it has stopped".into()),
            },
            Kind::Png(writer) => writer.write_image_data(&image.rgb()).map_err(|e| e.to_string()),
        };
        match written {
            Ok(()) => Ok(()),
            // ffmpeg knows better why it went away than the broken pipe
            Err(reason) => match &mut self.kind {
                Kind::Ffmpeg { child, pipe } => {
                    drop(pipe.take());
                    Err(film(&self.path, words(child).unwrap_or(reason)))
                }
                Kind::Png(_) => Err(RenderError::Write { path: self.path.clone(), reason }),
            },
        }
    }

    /// Ends the film and returns its file.
    ///
    /// # Errors
    /// When it cannot be ended.
    pub fn finish(self) -> Result<PathBuf, RenderError> {
        match self.kind {
            Kind::Ffmpeg { mut child, pipe } => {
                drop(pipe);
                let said = words(&mut child);
                let status = child.wait().map_err(|e| film(&self.path, e.to_string()))?;
                if !status.success() {
                    let reason = said.unwrap_or_else(|| status.to_string());
                    return Err(film(&self.path, reason));
                }
            }
            Kind::Png(writer) => {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn pictures() -> Vec<Image> {
        (0..5).map(|i| Image::filled(33, 17, [40 * i, 100, 200 - 30 * i])).collect()
    }

    fn temporary(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("sinew-film-{}-{name}", std::process::id()))
    }

    #[test]
    fn an_animated_png_stands_in_for_a_film() {
        let path = temporary("stand-in.mp4");
        let mut film = Film::start_with(&path, [33, 17], 5, 25.0, false).unwrap();
        assert!(film.is_png());
        for picture in pictures() {
            film.add(&picture).unwrap();
        }
        let path = film.finish().unwrap();
        assert_eq!(path.extension().unwrap(), "png");
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let reader = png::Decoder::new(file).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 5);
        std::fs::remove_file(path).unwrap();
    }

    #[test]
    fn ffmpeg_makes_a_film_or_says_why_not() {
        if !has_ffmpeg() {
            let mut err = std::io::stderr();
            let _ = writeln!(err, "skipped: no ffmpeg on the path");
            return;
        }
        let path = temporary("real.mp4");
        let mut film = Film::start(&path, [33, 17], 5, 25.0).unwrap();
        for picture in pictures() {
            film.add(&picture).unwrap();
        }
        let bytes = std::fs::read(film.finish().unwrap()).unwrap();
        assert!(bytes.len() > 500 && &bytes[4..8] == b"ftyp");
        std::fs::remove_file(path).unwrap();
        let wrong = temporary("wrong.nonsense");
        let mut film = Film::start(&wrong, [33, 17], 5, 25.0).unwrap();
        let results: Vec<_> = pictures().iter().map(|p| film.add(p)).collect();
        let error = match results.into_iter().find_map(Result::err) {
            Some(error) => error,
            None => film.finish().unwrap_err(),
        };
        assert!(error.to_string().contains("nonsense"), "{error}");
    }
}
