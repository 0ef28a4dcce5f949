//! Text and colour bars over a picture, drawn on the CPU: sharp at any size and the same on every device.

use crate::colour::Rgb;
use crate::image::Image;
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

/// Values for marks from `low` to `high`: multiples of 1, 2, 2.5 or 5 times a power of ten, about `count`.
///
/// ```
/// use sinew_render::overlay::ticks;
///
/// assert_eq!(ticks(0.0, 0.061, 4), [0.0, 0.02, 0.04, 0.06]);
/// ```
pub fn ticks(low: f64, high: f64, count: usize) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return vec![low];
    }
    let raw = span / count.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|f| f * power)
        .find(|s| *s >= 0.85 * raw)
        .unwrap_or(10.0 * power);
    let first = (low / step - 1e-6).ceil() as i64;
    let last = (high / step + 1e-6).floor() as i64;
    // division by the inverse gives 0.06 and not 0.06000000000000001
    (first..=last)
        .map(|i| if step < 1.0 { i as f64 / rounded(1.0 / step) } else { i as f64 * step })
        .collect()
}

/// To nine significant digits.
fn rounded(value: f64) -> f64 {
    let power = 10f64.powf(8.0 - value.abs().log10().floor());
    (value * power).round() / power
}

/// A number with as many digits as a step between marks needs, with a real minus sign.
pub fn mark(value: f64, step: f64) -> String {
    let digits = (-(step.abs().log10() + 1e-9).floor()).clamp(0.0, 6.0) as usize;
    let exact = (step * 10f64.powi(digits as i32)).fract().abs();
    let digits = if exact > 0.01 && exact < 0.99 { digits + 1 } else { digits };
    let text = format!("{value:.digits$}");
    if value == 0.0 { "0".into() } else { text.replace('-', "−") }
}

/// A unit with a factor, such that values look like 12 and not like 0.000012.
pub fn scaled_unit(unit: &str, largest: f64) -> (f64, String) {
    let steps: &[(f64, &str)] = match unit {
        "m" => &[(1.0, "m"), (1e2, "cm"), (1e3, "mm"), (1e6, "µm")],
        "Pa" => &[(1e-6, "MPa"), (1e-3, "kPa"), (1.0, "Pa"), (1e3, "mPa")],
        "N" => &[(1e-3, "kN"), (1.0, "N"), (1e3, "mN"), (1e6, "µN")],
        "J/m³" => &[(1e-6, "MJ/m³"), (1e-3, "kJ/m³"), (1.0, "J/m³"), (1e3, "mJ/m³")],
        "%" => &[(1.0, "%")],
        "" => return (1.0, String::new()),
        other => return (1.0, other.into()),
    };
    let fits = steps.iter().find(|(factor, _)| largest * factor >= 0.9995);
    let (factor, name) = fits.or(steps.last()).copied().unwrap_or((1.0, unit));
    (factor, name.into())
}

/// A value with its unit in three digits, such as `12.3 mN`.
pub fn with_unit(value: f64, unit: &str) -> String {
    let (factor, unit) = scaled_unit(unit, value.abs());
    let value = value * factor;
    let digits = (2.0 - value.abs().max(1.0).log10().floor()).clamp(0.0, 2.0) as usize;
    format!("{value:.digits$} {unit}").replace('-', "−").trim_end().into()
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
