//! Several runs in one picture: a grid with one camera, one ground and one colour bar.

use crate::camera::{Camera, CameraRequest};
use crate::error::RenderError;
use crate::image::Image;
use crate::overlay::{Align, FAINT_INK, Fonts, INK, Weight, colour_bar};
use crate::painter::{Captions, letters, margins};
use crate::renderer::{Look, Renderer};
use crate::scene::{Field, Recording};
use sinew_adapter::Gpu;

/// One picture of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// What stands above it.
    pub label: &'a str,
    /// What stands below it.
    pub note: &'a str,
    /// The run.
    pub recording: &'a Recording,
    /// Its frame.
    pub frame: usize,
}

/// How a grid is laid out.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// First line.
    pub title: &'a str,
    /// Second line.
    pub subtitle: &'a str,
    /// Pictures in a row.
    pub columns: usize,
    /// Size (pixels) of each.
    pub panel: [u32; 2],
    /// Camera.
    pub camera: CameraRequest,
    /// Index of the field that gives colours.
    pub field: Option<usize>,
}

/// Ground between the pictures.
const PAPER: [u8; 3] = [250, 251, 252];

/// Draws a grid. The camera fits all runs, the colour bar spans the ranges of all.
///
/// # Errors
/// When a recording does not fit together, a frame or field does not exist, or the device fails.
pub fn compare(gpu: Gpu, panels: &[Panel], grid: &Grid) -> Result<Image, RenderError> {
    let first = panels
        .first()
        .ok_or_else(|| RenderError::Empty { reason: "a comparison without a run".into() })?;
    for (i, panel) in panels.iter().enumerate() {
        panel.recording.check()?;
        let index = |what, index, count| RenderError::Index { frame: i, what, index, count };
        let frames = panel.recording.frames.len();
        if panel.frame >= frames {
            return Err(index("frame", panel.frame, frames));
        }
        if let Some(field) = grid.field.filter(|f| *f >= panel.recording.fields.len()) {
            return Err(index("field", field, panel.recording.fields.len()));
        }
    }
    let [width, height] = grid.panel;
    let mut renderer = Renderer::new(gpu, width, height)?;
    // letters of a panel are those of the picture
    let s = letters(height).max(13.0);
    let bare = Captions { title: false, note: false, bar: false };
    let mut room = margins(width, height, bare, false);
    (room.top, room.bottom) = (2.6 * s / height as f32, 2.6 * s / height as f32);
    let points = panels.iter().flat_map(|p| p.recording.shown());
    let up = first.recording.up;
    let camera = Camera::fit(grid.camera, up, points, renderer.aspect(), room)?;
    let mut look = Look::of(first.recording, grid.field);
    for panel in panels {
        look.floor = look.floor.min(Look::of(panel.recording, None).floor);
    }
    let field = grid.field.map(|i| common_field(panels, i));
    let columns = grid.columns.clamp(1, panels.len());
    let rows = panels.len().div_ceil(columns);
    let (gap, head) = ((0.5 * s) as u32, (5.0 * s) as u32);
    let side = if field.is_some() { (10.4 * s) as u32 } else { gap };
    let size = [columns as u32 * (width + gap) + gap + side, head + rows as u32 * (height + gap)];
    let mut image = Image::filled(size[0], size[1], PAPER);
    let fonts = Fonts::default();
    let pad = gap as f32 + 0.6 * s;
    let style = (1.4 * s, Weight::Medium);
    fonts.write(&mut image, grid.title, [pad, 2.0 * s], style, Align::Left, INK);
    let style = (s, Weight::Regular);
    fonts.write(&mut image, grid.subtitle, [pad, 3.7 * s], style, Align::Left, FAINT_INK);
    for (i, panel) in panels.iter().enumerate() {
        let mut recording = panel.recording.clone();
        if let (Some(i), Some(field)) = (grid.field, &field) {
            recording.fields[i] = field.clone();
        }
        let frame = &recording.frames[panel.frame];
        let mut picture = renderer.still(&recording, frame, &camera, &look)?;
        let (w, h) = (width as f32, height as f32);
        let style = (1.05 * s, Weight::Medium);
        let label = fonts.fitted(panel.label, style.0, style.1, w - s);
        fonts.write(&mut picture, &label, [0.5 * w, 1.7 * s], style, Align::Centre, INK);
        let style = (s, Weight::Regular);
        let note = fonts.fitted(panel.note, style.0, style.1, w - s);
        fonts.write(&mut picture, &note, [0.5 * w, h - 0.9 * s], style, Align::Centre, FAINT_INK);
        let (row, column) = ((i / columns) as u32, (i % columns) as u32);
        image.paste(&picture, [gap + column * (width + gap), head + row * (height + gap)]);
    }
    if let Some(field) = &field {
        let tall = size[1] as f32 - head as f32;
        let height = (0.5 * tall).max(8.0 * s).min(0.7 * tall);
        let top = head as f32 + 0.5 * (tall - height) + 0.6 * s;
        colour_bar(&mut image, &fonts, field, [size[0] as f32 - s, top], height, s);
    }
    Ok(image)
}

/// A field with a range that spans those of all runs.
fn common_field(panels: &[Panel], i: usize) -> Field {
    let mut field = panels[0].recording.fields[i].clone();
    for panel in panels {
        let [low, high] = panel.recording.fields[i].range;
        field.range = [field.range[0].min(low), field.range[1].max(high)];
    }
    field
}
