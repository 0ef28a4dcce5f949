//! Text and colour bars over a picture, drawn on the CPU: sharp at any size and the same on every device.

use crate::colour::Rgb;
use crate::image::Image;
use crate::scale::{mark, scaled_unit, ticks};
use crate::scene::{ArrowKey, Field};
use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

/// Colour of text.
pub const INK: Rgb = [38, 44, 54];
/// Colour of text of less weight.
pub const FAINT_INK: Rgb = [104, 112, 124];

/// Weight of letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// For notes.
    Regular,
    /// For titles.
    Medium,
}

/// Where a text stands relative to the place that is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// It begins there.
    Left,
    /// Its middle is there.
    Centre,
    /// It ends there.
    Right,
}

/// The fonts.
pub struct Fonts {
    regular: FontRef<'static>,
    medium: FontRef<'static>,
}

impl Default for Fonts {
    fn default() -> Self {
        let font = |bytes| FontRef::try_from_slice(bytes).expect("the font is part of the program");
        Self {
            regular: font(include_bytes!("../assets/Roboto-Regular-subset.ttf")),
            medium: font(include_bytes!("../assets/Roboto-Medium-subset.ttf")),
        }
    }
}

impl Fonts {
    fn of(&self, weight: Weight) -> &FontRef<'static> {
        match weight {
            Weight::Regular => &self.regular,
            Weight::Medium => &self.medium,
        }
    }

    /// Whether there is a letter for a character.
    pub fn has(&self, c: char) -> bool {
        self.regular.glyph_id(c).0 != 0
    }

    /// Width (pixels) of a line of text whose letters are `size` pixels high.
    pub fn width(&self, text: &str, size: f32, weight: Weight) -> f32 {
        self.lay(text, size, weight).1
    }

    fn lay(&self, text: &str, size: f32, weight: Weight) -> (Vec<Glyph>, f32) {
        let font = self.of(weight).as_scaled(PxScale::from(size * 1.17));
        let (mut glyphs, mut x, mut last) = (Vec::new(), 0.0, None);
        for c in text.chars() {
            let id = font.glyph_id(c);
            if let Some(last) = last {
                x += font.kern(last, id);
            }
            glyphs.push(id.with_scale_and_position(font.scale(), point(x, 0.0)));
            x += font.h_advance(id);
            last = Some(id);
        }
        (glyphs, x)
    }

    /// Writes a line with its base line at `y`; returns its width (pixels).
    pub fn write(
        &self,
        image: &mut Image,
        text: &str,
        [x, y]: [f32; 2],
        (size, weight): (f32, Weight),
        align: Align,
        colour: Rgb,
    ) -> f32 {
        let (glyphs, width) = self.lay(text, size, weight);
        let start = match align {
            Align::Left => x,
            Align::Centre => x - 0.5 * width,
            Align::Right => x - width,
        };
        for mut glyph in glyphs {
            glyph.position.x += start;
            glyph.position.y += y;
            if let Some(outline) = self.of(weight).outline_glyph(glyph) {
                let low = outline.px_bounds().min;
                outline.draw(|i, j, coverage| {
                    // dark letters on light ground look thin in sRGB arithmetic
                    let coverage = coverage.clamp(0.0, 1.0).powf(0.85);
                    image.blend(low.x as i32 + i as i32, low.y as i32 + j as i32, colour, coverage);
                });
            }
        }
        width
    }

    /// The text cut to a width (pixels), with an ellipsis where it was too long.
    pub fn fitted(&self, text: &str, size: f32, weight: Weight, width: f32) -> String {
        if self.width(text, size, weight) <= width {
            return text.into();
        }
        let mut short: String = text.into();
        while short.pop().is_some() {
            let candidate = format!("{}…", short.trim_end());
            if self.width(&candidate, size, weight) <= width {
                return candidate;
            }
        }
        String::new()
    }
}

/// Draws a short arrow and what arrows of its colour mean, both left of `right`; returns the width (pixels).
pub fn arrow_key(
    image: &mut Image,
    fonts: &Fonts,
    key: &ArrowKey,
    [right, y]: [f32; 2],
    size: f32,
) -> f32 {
    let style = (size, Weight::Regular);
    let width = fonts.write(image, &key.text, [right, y], style, Align::Right, FAINT_INK);
    let (length, head, middle) = (2.2 * size, 0.8 * size, y - 0.35 * size);
    let left = right - width - 0.6 * size - length;
    let line = (0.16 * size).max(1.0);
    for x in 0..length as i32 {
        let to_tip = length - x as f32 - 0.5;
        let half = if to_tip < head { 0.4 * to_tip } else { 0.5 * line };
        for y in -(size as i32)..=size as i32 {
            let covered = (half + 0.5 - (y as f32 + middle.floor() - middle).abs()).clamp(0.0, 1.0);
            image.blend(left as i32 + x, middle.floor() as i32 + y, key.colour, covered);
        }
    }
    right - left
}

/// Draws a standing colour bar with its marks and its label above, its right side at `x`.
pub fn colour_bar(
    image: &mut Image,
    fonts: &Fonts,
    field: &Field,
    [right, top]: [f32; 2],
    height: f32,
    size: f32,
) {
    let range = field.range.map(f64::from);
    let largest = range[0].abs().max(range[1].abs());
    let (factor, unit) = scaled_unit(&field.unit, largest);
    let values = ticks(range[0] * factor, range[1] * factor, 5);
    let step = values.get(1).map_or(1.0, |v| v - values[0]);
    let texts: Vec<String> = values.iter().map(|v| mark(*v, step)).collect();
    let style = (size, Weight::Regular);
    let width = (1.15 * size).round();
    let gap = 0.45 * size;
    let widest = texts.iter().map(|t| fonts.width(t, size, style.1)).fold(0.0, f32::max);
    let left = (right - widest - gap - width).round();
    let (top, height) = (top.round(), height.round());
    for row in 0..height as i32 {
        let t = 1.0 - (row as f32 + 0.5) / height;
        image.fill([left as i32, top as i32 + row], [width as i32, 1], field.map.at(t), 1.0);
    }
    for (value, text) in values.iter().zip(&texts) {
        let t = (value / factor - range[0]) / (range[1] - range[0]);
        let y = top + (1.0 - t as f32) * (height - 1.0);
        let x = left + width;
        image.fill([x as i32, y.round() as i32], [(0.25 * size) as i32, 1], INK, 0.8);
        let at = [right, y + 0.35 * size];
        fonts.write(image, text, at, style, Align::Right, INK);
    }
    let at = [right, top - 0.9 * size];
    let label =
        if unit.is_empty() { field.label.clone() } else { format!("{} ({unit})", field.label) };
    fonts.write(image, &label, at, style, Align::Right, INK);
}
