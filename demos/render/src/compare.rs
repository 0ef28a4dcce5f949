//! Several runs in one picture or film: a grid with one camera, one ground, one clock and one colour bar.

use crate::camera::{Camera, CameraRequest};
use crate::error::RenderError;
use crate::image::Image;
use crate::look::Look;
use crate::overlay::{Align, FAINT_INK, Fonts, INK, Weight, colour_bar};
use crate::painter::{Captions, letters, margins};
use crate::renderer::Renderer;
use crate::scene::{Field, Recording};
use sinew_adapter::Gpu;

/// One run of a grid.
#[derive(Clone, Debug)]
pub struct Panel {
    /// What stands above it; the note of its frame stands below it.
    pub label: String,
    /// The run.
    pub recording: Recording,
}

/// Sizes in a grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Runs in a row, and size (pixels) of each.
    Panels(usize, [u32; 2]),
    /// Size (pixels) of the whole picture; rows and columns are chosen.
    Whole([u32; 2]),
}

/// How a grid is laid out.
#[derive(Clone, Copy, Debug)]
pub struct Grid<'a> {
    /// First line.
    pub title: &'a str,
    /// Sizes.
    pub layout: Layout,
    /// Camera.
    pub camera: CameraRequest,
    /// Index of the field that gives colours.
    pub field: Option<usize>,
}

/// Ground between the pictures.
const PAPER: [u8; 3] = [250, 251, 252];

/// Places (pixels) of the panels of a picture.
#[derive(Clone, Copy, Debug)]
pub struct GridPlan {
    /// Panels side by side.
    pub columns: u32,
    /// Size of a panel.
    pub panel: [u32; 2],
    /// Size of the picture.
    pub whole: [u32; 2],
    /// Size of letters.
    letter: f32,
    gap: u32,
    head: u32,
}

impl GridPlan {
    /// For so many panels, with a colour bar beside them or without.
    pub fn new(layout: Layout, count: usize, bar: bool) -> Self {
        let [width, height] = match layout {
            Layout::Panels(columns, panel) => {
                return Self::of_panels(columns.clamp(1, count), panel, count, bar);
            }
            Layout::Whole(size) => size,
        };
        let fitted = |columns: usize| {
            let rows = count.div_ceil(columns) as u32;
            let mut panel = [width / columns as u32, height / rows];
            // letters depend on what they leave for the panels
            for _ in 0..4 {
                let now = Self::of_panels(columns, panel, count, bar);
                let c = now.columns;
                let other = [now.whole[0] - c * panel[0], now.whole[1] - rows * panel[1]];
                panel[0] = width.saturating_sub(other[0]) / c;
                panel[1] = height.saturating_sub(other[1]) / rows;
            }
            Self { whole: [width, height], ..Self::of_panels(columns, panel, count, bar) }
        };
        // bodies come in all shapes: the largest square counts
        let room = |plan: &Self| plan.panel[0].min(plan.panel[1]);
        let mut best = fitted(1);
        for columns in 2..=count {
            let plan = fitted(columns);
            if room(&plan) > room(&best) {
                best = plan;
            }
        }
        best
    }

    /// Of panels of this size in so many columns.
    pub fn of_panels(columns: usize, [width, height]: [u32; 2], count: usize, bar: bool) -> Self {
        // letters of a panel are those of the picture
        let letter = letters(height).max(13.0);
        let (gap, head) = ((0.5 * letter) as u32, (5.0 * letter) as u32);
        let side = if bar { (10.4 * letter) as u32 } else { gap };
        let (columns, rows) = (columns as u32, count.div_ceil(columns) as u32);
        let whole = [columns * (width + gap) + gap + side, head + rows * (height + gap)];
        Self { columns, panel: [width, height], whole, letter, gap, head }
    }

    /// Corner of a panel.
    pub fn corner(&self, i: usize) -> [u32; 2] {
        let (row, column) = (i as u32 / self.columns, i as u32 % self.columns);
        let [width, height] = self.panel;
        [self.gap + column * (width + self.gap), self.head + row * (height + self.gap)]
    }
}

/// Runs that are drawn into one picture, frame by frame. The camera fits all of them, the colour bar spans the
/// ranges of all.
pub struct Comparison {
    panels: Vec<Panel>,
    title: String,
    plan: GridPlan,
    renderer: Renderer,
    camera: Camera,
    field: Option<Field>,
    fonts: Fonts,
    /// The look of all runs.
    pub look: Look,
}

impl Comparison {
    /// Fits camera and ground.
    ///
    /// # Errors
    /// When there is no run, one does not fit together or lacks the field, or the size is out of range.
    pub fn new(gpu: Gpu, mut panels: Vec<Panel>, grid: &Grid) -> Result<Self, RenderError> {
        let first = panels
            .first()
            .ok_or_else(|| RenderError::Empty("a comparison without a run".into()))?;
        for panel in &panels {
            panel.recording.check()?;
            let count = panel.recording.fields.len();
            if let Some(index) = grid.field.filter(|f| *f >= count) {
                return Err(RenderError::Index { frame: 0, what: "field", index, count });
            }
        }
        let plan = GridPlan::new(grid.layout, panels.len(), grid.field.is_some());
        let [width, height] = plan.panel;
        let renderer = Renderer::new(gpu, width, height)?;
        let bare = Captions { title: false, note: false, bar: false };
        let mut room = margins(width, height, bare, false);
        (room.top, room.bottom) =
            (2.6 * plan.letter / height as f32, 2.6 * plan.letter / height as f32);
        let points = panels.iter().flat_map(|p| p.recording.shown());
        let camera = Camera::fit(grid.camera, first.recording.up, points, renderer.aspect(), room)?;
        let mut look = Look::of(&first.recording, grid.field);
        for panel in &panels {
            look.floor = look.floor.min(Look::of(&panel.recording, None).floor);
        }
        let field = grid.field.map(|i| common_field(&panels, i));
        if let (Some(i), Some(field)) = (grid.field, &field) {
            for panel in &mut panels {
                panel.recording.fields[i].range = field.range;
            }
        }
        let (title, fonts) = (grid.title.to_owned(), Fonts::default());
        Ok(Self { panels, title, plan, renderer, camera, field, fonts, look })
    }

    /// Size (pixels) of the pictures.
    pub fn size(&self) -> [u32; 2] {
        self.plan.whole
    }

    /// The runs.
    pub fn panels(&self) -> &[Panel] {
        &self.panels
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> String {
        self.renderer.adapter()
    }

    /// Draws one frame of every run, and `subtitle` under the title.
    ///
    /// # Errors
    /// When a frame does not exist, or the device fails.
    pub fn picture(&mut self, subtitle: &str, frames: &[usize]) -> Result<Image, RenderError> {
        let (plan, s) = (self.plan, self.plan.letter);
        let [width, height] = plan.whole;
        let mut image = Image::filled(width, height, PAPER);
        let pad = plan.gap as f32 + 0.6 * s;
        let room = width as f32 - 2.0 * pad;
        let lines = [
            (&*self.title, 1.4 * s, Weight::Medium, 2.0 * s, INK),
            (subtitle, s, Weight::Regular, 3.7 * s, FAINT_INK),
        ];
        for (text, size, weight, y, ink) in lines {
            let text = self.fonts.fitted(text, size, weight, room);
            self.fonts.write(&mut image, &text, [pad, y], (size, weight), Align::Left, ink);
        }
        for (i, panel) in self.panels.iter().enumerate() {
            let recording = &panel.recording;
            let (index, count) = (frames.get(i).copied().unwrap_or(0), recording.frames.len());
            let frame = recording.frames.get(index).ok_or(RenderError::Index {
                frame: i,
                what: "frame",
                index,
                count,
            })?;
            let mut picture = self.renderer.still(recording, frame, &self.camera, &self.look)?;
            let (w, h) = (picture.width as f32, picture.height as f32);
            let mut note = frame.note.clone();
            if let Some(key) = &recording.arrow_key {
                note = format!("{note} · {}", key.text);
            }
            let texts = [
                (&panel.label, 1.05 * s, Weight::Medium, 1.7 * s, INK),
                (&note, s, Weight::Regular, h - 0.9 * s, FAINT_INK),
            ];
            for (text, size, weight, y, ink) in texts {
                let text = self.fonts.fitted(text, size, weight, w - s);
                let style = (size, weight);
                self.fonts.write(&mut picture, &text, [0.5 * w, y], style, Align::Centre, ink);
            }
            image.paste(&picture, plan.corner(i));
        }
        if let Some(field) = &self.field {
            let tall = height as f32 - plan.head as f32;
            let length = (0.5 * tall).max(8.0 * s).min(0.7 * tall);
            let top = plan.head as f32 + 0.5 * (tall - length) + 0.6 * s;
            colour_bar(&mut image, &self.fonts, field, [width as f32 - s, top], length, s);
        }
        Ok(image)
    }
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
