//! Frames with their captions and colour bars: what people see.

use crate::camera::{Camera, CameraRequest, Margins};
use crate::error::RenderError;
use crate::image::Image;
use crate::look::Look;
use crate::overlay::{Align, FAINT_INK, Fonts, INK, Weight, arrow_key, colour_bar};
use crate::renderer::Renderer;
use crate::scene::{Frame, Recording, Time};
use sinew_adapter::Gpu;

/// What of the overlay is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Captions {
    /// Title and subtitle.
    pub title: bool,
    /// Time and note.
    pub note: bool,
    /// Colour bar.
    pub bar: bool,
}

impl Captions {
    /// All of them.
    pub const ALL: Self = Self { title: true, note: true, bar: true };
}

/// Size (pixels) of letters in a picture of this height.
pub fn letters(height: u32) -> f32 {
    (height as f32 / 38.0).max(10.5)
}

/// Room for the overlay around the bodies.
pub fn margins(width: u32, height: u32, captions: Captions, title: bool) -> Margins {
    let (w, h) = (width as f32, height as f32);
    let s = letters(height);
    Margins {
        left: 2.2 * s / w,
        right: if captions.bar { 7.2 * s / w } else { 1.5 * s / w },
        top: if captions.title && title { 4.9 * s / h } else { 1.5 * s / h },
        bottom: if captions.note { 3.6 * s / h } else { 1.5 * s / h },
    }
}

/// Writes the overlay of a frame.
pub fn decorate(
    image: &mut Image,
    fonts: &Fonts,
    recording: &Recording,
    frame: &Frame,
    field: Option<usize>,
    captions: Captions,
) {
    let (w, h) = (image.width as f32, image.height as f32);
    let s = letters(image.height);
    let pad = 1.3 * s;
    if captions.title {
        let room = w - 2.0 * pad;
        let title = fonts.fitted(&recording.title, 1.3 * s, Weight::Medium, room);
        let style = (1.3 * s, Weight::Medium);
        fonts.write(image, &title, [pad, pad + 0.95 * s], style, Align::Left, INK);
        let subtitle = fonts.fitted(&recording.subtitle, s, Weight::Regular, room);
        let style = (s, Weight::Regular);
        fonts.write(image, &subtitle, [pad, pad + 2.5 * s], style, Align::Left, FAINT_INK);
    }
    if captions.note {
        let time = Time { at: frame.time, is_static: recording.is_static }.to_string();
        let at = [pad, h - pad];
        let width = fonts.write(image, &time, at, (1.15 * s, Weight::Medium), Align::Left, INK);
        let start = pad + width + 1.2 * s;
        let key = recording.arrow_key.as_ref();
        let key = key.map_or(0.0, |key| s + arrow_key(image, fonts, key, [w - pad, h - pad], s));
        let note = fonts.fitted(&frame.note, s, Weight::Regular, w - start - pad - key);
        let style = (s, Weight::Regular);
        fonts.write(image, &note, [start, h - pad], style, Align::Left, FAINT_INK);
    }
    if let Some(field) = field.and_then(|i| recording.fields.get(i))
        && captions.bar
    {
        let height = (0.46 * h).max(6.0 * s);
        let top = 0.5 * (h - height) + 0.6 * s;
        colour_bar(image, fonts, field, [w - pad, top], height, s);
    }
}

/// A renderer with a camera and a look that serve a whole run.
pub struct Painter {
    renderer: Renderer,
    /// The camera.
    pub camera: Camera,
    /// The look.
    pub look: Look,
    /// The overlay.
    pub captions: Captions,
}

impl Painter {
    /// Fits camera and ground to all frames of a recording.
    ///
    /// # Errors
    /// When the recording does not fit together or the size is out of range.
    pub fn new(
        gpu: Gpu,
        [width, height]: [u32; 2],
        recording: &Recording,
        request: CameraRequest,
        field: Option<usize>,
        captions: Captions,
    ) -> Result<Self, RenderError> {
        recording.check()?;
        let captions = Captions { bar: captions.bar && field.is_some(), ..captions };
        let renderer = Renderer::new(gpu, width, height)?;
        let margins = margins(width, height, captions, true);
        let aspect = renderer.aspect();
        let camera = Camera::fit(request, recording.up, recording.shown(), aspect, margins)?;
        Ok(Self { renderer, camera, look: Look::of(recording, field), captions })
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> String {
        self.renderer.adapter()
    }

    /// Draws frames one after another, several under way at a time, and hands each bare picture with its index to
    /// `done`; [`decorate`] is left to it, so that it can run elsewhere.
    ///
    /// # Errors
    /// When the device or `done` fails.
    pub fn film(
        &mut self,
        recording: &Recording,
        frames: &[usize],
        mut done: impl FnMut(usize, Image) -> Result<(), RenderError>,
    ) -> Result<(), RenderError> {
        let mut waiting = frames.iter().copied();
        for &i in frames {
            let frame = &recording.frames[i];
            let image = self.renderer.submit(recording, frame, &self.camera, &self.look)?;
            if let Some(image) = image
                && let Some(index) = waiting.next()
            {
                done(index, image)?;
            }
        }
        while let Some(image) = self.renderer.finish_one()? {
            if let Some(index) = waiting.next() {
                done(index, image)?;
            }
        }
        Ok(())
    }

    /// One frame with its overlay.
    ///
    /// # Errors
    /// When the device fails.
    pub fn picture(
        &mut self,
        fonts: &Fonts,
        recording: &Recording,
        frame: usize,
    ) -> Result<Image, RenderError> {
        let frame = &recording.frames[frame];
        let mut image = self.renderer.still(recording, frame, &self.camera, &self.look)?;
        decorate(&mut image, fonts, recording, frame, self.look.field, self.captions);
        Ok(image)
    }
}
