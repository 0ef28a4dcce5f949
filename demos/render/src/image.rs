//! Pictures in memory, and PNG files.

use crate::colour::Rgb;
use crate::error::RenderError;
use std::collections::HashMap;
use std::path::Path;

/// A picture: rows from top to bottom, four bytes a pixel (sRGB and opacity).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width (pixels).
    pub width: u32,
    /// Height (pixels).
    pub height: u32,
    /// Pixels.
    pub data: Vec<u8>,
}

/// How a PNG is packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// All colours, quickly.
    #[default]
    Fast,
    /// At most 256 colours by median cut with dithering, packed tightly: small files for documents.
    Small,
}

impl Image {
    /// A picture of one colour.
    pub fn filled(width: u32, height: u32, [r, g, b]: Rgb) -> Self {
        let data = [r, g, b, 255].repeat(width as usize * height as usize);
        Self { width, height, data }
    }

    /// Colour of a pixel.
    ///
    /// # Panics
    /// Outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Rgb {
        let at = 4 * (y as usize * self.width as usize + x as usize);
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }

    /// Lays `colour` over a pixel with a coverage of 0 to 1; nothing happens outside the picture.
    pub fn blend(&mut self, x: i32, y: i32, colour: Rgb, coverage: f32) {
        if x < 0 || y < 0 || x >= self.width as i32 || y >= self.height as i32 {
            return;
        }
        let at = 4 * (y as usize * self.width as usize + x as usize);
        let a = coverage.clamp(0.0, 1.0);
        for k in 0..3 {
            let old = f32::from(self.data[at + k]);
            self.data[at + k] = (old + a * (f32::from(colour[k]) - old) + 0.5) as u8;
        }
    }

    /// Fills a rectangle, clipped to the picture.
    pub fn fill(
        &mut self,
        [x, y]: [i32; 2],
        [width, height]: [i32; 2],
        colour: Rgb,
        coverage: f32,
    ) {
        for row in y..y + height {
            for column in x..x + width {
                self.blend(column, row, colour, coverage);
            }
        }
    }

    /// Copies `other` to a place, clipped to the picture.
    pub fn paste(&mut self, other: &Self, [x, y]: [u32; 2]) {
        let width = other.width.min(self.width.saturating_sub(x)) as usize;
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = 4 * row as usize * other.width as usize;
            let to = 4 * ((row + y) as usize * self.width as usize + x as usize);
            self.data[to..to + 4 * width].copy_from_slice(&other.data[from..from + 4 * width]);
        }
    }

    /// As a PNG file in memory.
    ///
    /// # Errors
    /// When the encoder refuses, which it does for pictures without pixels.
    pub fn png(&self, packing: Packing) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        match packing {
            Packing::Fast => {
                encoder.set_color(png::ColorType::Rgb);
                encoder.set_compression(png::Compression::Fast);
                let mut writer = encoder.write_header()?;
                writer.write_image_data(&self.rgb())?;
                writer.finish()?;
            }
            Packing::Small => {
                let (palette, indices) = quantise(self);
                encoder.set_color(png::ColorType::Indexed);
                encoder.set_palette(palette.concat());
                encoder.set_compression(png::Compression::High);
                encoder.set_filter(png::Filter::NoFilter);
                let mut writer = encoder.write_header()?;
                writer.write_image_data(&indices)?;
                writer.finish()?;
            }
        }
        Ok(bytes)
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_png(&self, path: &Path, packing: Packing) -> Result<(), RenderError> {
        let error = |reason: String| RenderError::Write { path: path.into(), reason };
        let bytes = self.png(packing).map_err(|e| error(e.to_string()))?;
        std::fs::write(path, bytes).map_err(|e| error(e.to_string()))
    }

    /// Reads a PNG file of eight bits, with or without opacity or palette.
    ///
    /// # Errors
    /// What the decoder says.
    pub fn read_png(path: &Path) -> Result<Self, RenderError> {
        let error = |reason: String| RenderError::Option {
            option: "PNG file",
            found: path.display().to_string(),
            remedy: reason,
        };
        let file = std::fs::File::open(path).map_err(|e| error(e.to_string()))?;
        let mut decoder = png::Decoder::new(std::io::BufReader::new(file));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::ALPHA);
        let mut reader = decoder.read_info().map_err(|e| error(e.to_string()))?;
        let size = reader.output_buffer_size().ok_or_else(|| error("it is too large".into()))?;
        let mut data = vec![0; size];
        let info = reader.next_frame(&mut data).map_err(|e| error(e.to_string()))?;
        let (width, height) = (info.width, info.height);
        if data.len() != 4 * width as usize * height as usize {
            return Err(error("give a colour picture of eight bits".into()));
        }
        Ok(Self { width, height, data })
    }

    /// Three bytes a pixel.
    pub fn rgb(&self) -> Vec<u8> {
        self.data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect()
    }

    /// Mean and largest difference of the colours to those of a picture of the same size, of 255; `None` when
    /// the sizes differ.
    pub fn difference(&self, other: &Self) -> Option<[f64; 2]> {
        if (self.width, self.height) != (other.width, other.height) {
            return None;
        }
        let parts = self.data.iter().zip(&other.data).map(|(a, b)| a.abs_diff(*b));
        let (sum, largest) = parts.fold((0u64, 0), |(s, m), d| (s + u64::from(d), m.max(d)));
        Some([sum as f64 / (0.75 * self.data.len().max(1) as f64), f64::from(largest)])
    }
}

/// Median cut to 256 colours; returns palette and an index for each pixel, dithered.
pub fn quantise(image: &Image) -> (Vec<Rgb>, Vec<u8>) {
    let mut counts: HashMap<Rgb, u32> = HashMap::new();
    for p in image.data.chunks_exact(4) {
        *counts.entry([p[0], p[1], p[2]]).or_default() += 1;
    }
    let mut colours: Vec<(Rgb, u32)> = counts.into_iter().collect();
    colours.sort_unstable();
    let mut boxes = vec![colours];
    // the box whose spread weighs most is cut at its median
    while boxes.len() < 256 {
        let weight = |b: &Vec<(Rgb, u32)>| {
            let spread = spread(b).1;
            let count: u32 = b.iter().map(|c| c.1).sum();
            // rare colours count too: a colour bar is a small part of a picture
            f64::from(spread) * f64::from(count).powf(0.25)
        };
        let heaviest =
            (0..boxes.len()).max_by(|&a, &b| weight(&boxes[a]).total_cmp(&weight(&boxes[b])));
        let Some(i) = heaviest.filter(|&i| boxes[i].len() > 1) else { break };
        let mut own = boxes.swap_remove(i);
        let axis = spread(&own).0;
        own.sort_unstable_by_key(|c| (c.0[axis], c.0));
        let half: u64 = own.iter().map(|c| u64::from(c.1)).sum::<u64>() / 2;
        let mut sum = 0;
        let at = own.iter().position(|c| {
            sum += u64::from(c.1);
            sum > half
        });
        let rest = own.split_off(at.unwrap_or(0).clamp(1, own.len() - 1));
        boxes.push(own);
        boxes.push(rest);
    }
    let palette: Vec<Rgb> = boxes
        .iter()
        .map(|b| {
            let count: u64 = b.iter().map(|c| u64::from(c.1)).sum::<u64>().max(1);
            [0, 1, 2].map(|k| {
                let sum: u64 = b.iter().map(|c| u64::from(c.0[k]) * u64::from(c.1)).sum();
                ((sum + count / 2) / count) as u8
            })
        })
        .collect();
    // what a pixel is off by goes to its neighbours (Floyd & Steinberg 1976), mostly: all of it makes noise
    const PASSED_ON: f32 = 0.8;
    let mut nearest: HashMap<Rgb, u8> = HashMap::new();
    let width = image.width as usize;
    let mut rows = [vec![[0.0f32; 3]; width + 2], vec![[0.0f32; 3]; width + 2]];
    let mut indices = Vec::with_capacity(image.data.len() / 4);
    for row in image.data.chunks_exact(4 * width.max(1)) {
        for (x, p) in row.chunks_exact(4).enumerate() {
            let wanted = [0, 1, 2].map(|k| f32::from(p[k]) + rows[0][x + 1][k]);
            let colour = wanted.map(|c| c.round() as u8);
            let index = *nearest.entry(colour).or_insert_with(|| {
                let distance = |c: &Rgb| -> u32 {
                    (0..3).map(|k| u32::from(c[k].abs_diff(colour[k])).pow(2)).sum()
                };
                (0..palette.len()).min_by_key(|&i| distance(&palette[i])).unwrap_or(0) as u8
            });
            indices.push(index);
            for k in 0..3 {
                let off =
                    PASSED_ON * (wanted[k] - f32::from(palette[usize::from(index)][k])) / 16.0;
                rows[0][x + 2][k] += 7.0 * off;
                rows[1][x][k] += 3.0 * off;
                rows[1][x + 1][k] += 5.0 * off;
                rows[1][x + 2][k] += off;
            }
        }
        rows.swap(0, 1);
        rows[1].fill([0.0; 3]);
    }
    (palette, indices)
}

/// The component in which colours differ most, and by how much.
fn spread(colours: &[(Rgb, u32)]) -> (usize, u8) {
    let width = |k: usize| {
        let of = || colours.iter().map(|c| c.0[k]);
        of().max().unwrap_or(0) - of().min().unwrap_or(0)
    };
    (0..3).map(|k| (k, width(k))).max_by_key(|w| w.1).unwrap_or((0, 0))
}
