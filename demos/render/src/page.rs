//! A self-contained page with an interactive player: nothing is fetched, nothing needs to be installed.
//!
//! Positions are whole numbers of 16 bits over the box of the run, scalars of 8 bits over their range
//! ([`Quantiser`]). Every frame holds differences to the one before, low bytes before high ones, and all of it is
//! deflated and written in base 64.

use crate::camera::CameraRequest;
use crate::colour::{BODY_COLOURS, ColourMap, Rgb};
use crate::error::RenderError;
use crate::renderer::Look;
use crate::scene::{Frame, Recording};
use crate::skin::Skin;
use base64::Engine;
use glam::Vec3;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Whole numbers for positions in a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantiser {
    /// Lowest corner (m).
    pub low: Vec3,
    /// Length (m) of one, along each axis.
    pub step: Vec3,
}

impl Quantiser {
    /// For all points of a recording, at rest and in its frames.
    pub fn of(recording: &Recording) -> Self {
        let all = recording.frames.iter().flat_map(|f| &f.points).chain(&recording.rest);
        let (low, high) = all
            .map(|p| Vec3::from_array(*p))
            .filter(|p| p.is_finite())
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let step = ((high - low) / f32::from(u16::MAX)).max(Vec3::splat(f32::MIN_POSITIVE));
        if low.x <= high.x { Self { low, step } } else { Self { low: Vec3::ZERO, step: Vec3::ONE } }
    }

    /// The nearest whole numbers; what is not finite counts as the lowest corner.
    pub fn whole(&self, point: [f32; 3]) -> [u16; 3] {
        let x = (Vec3::from_array(point) - self.low) / self.step;
        // a cast takes the ends outside, and 0 for NaN
        x.to_array().map(|x| x.round() as u16)
    }

    /// Back to a position (m), within half a step along each axis.
    pub fn position(&self, whole: [u16; 3]) -> [f32; 3] {
        (self.low + self.step * Vec3::from_array(whole.map(f32::from))).to_array()
    }
}

/// A scalar in 8 bits over its range; outside the ends are taken.
pub fn whole_scalar(value: f32, [low, high]: [f32; 2]) -> u8 {
    (255.0 * (value - low) / (high - low).max(f32::MIN_POSITIVE)).round() as u8
}

/// Collects the numbers of a run.
#[derive(Default)]
struct Packer {
    bytes: Vec<u8>,
}

impl Packer {
    /// Differences to `before`, all low bytes and then all high ones.
    fn shorts(&mut self, values: &[u16], before: Option<&[u16]>) {
        let difference = |i: usize| values[i].wrapping_sub(before.map_or(0, |b| b[i]));
        self.bytes.extend((0..values.len()).map(|i| difference(i) as u8));
        self.bytes.extend((0..values.len()).map(|i| (difference(i) >> 8) as u8));
    }

    fn bytes_of(&mut self, values: &[u8], before: Option<&[u8]>) {
        let difference = |i: usize| values[i].wrapping_sub(before.map_or(0, |b| b[i]));
        self.bytes.extend((0..values.len()).map(difference));
    }

    fn words(&mut self, values: impl Iterator<Item = u32>) {
        values.for_each(|v| self.bytes.extend(v.to_le_bytes()));
    }

    fn floats(&mut self, values: impl IntoIterator<Item = f32>) {
        values.into_iter().for_each(|v| self.bytes.extend(v.to_le_bytes()));
    }

    /// Deflated, in base 64.
    fn text(self) -> Result<String, std::io::Error> {
        let level = flate2::Compression::best();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
        encoder.write_all(&self.bytes)?;
        Ok(base64::engine::general_purpose::STANDARD.encode(encoder.finish()?))
    }
}

/// A colour as a number that `f32` holds exactly.
fn colour_number([r, g, b]: Rgb) -> f32 {
    (u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b)) as f32
}

fn run_data(recording: &Recording) -> Result<Value, std::io::Error> {
    let look = Look::of(recording, None);
    let quantiser = Quantiser::of(recording);
    let whole = |points: &[[f32; 3]]| -> Vec<u16> {
        points.iter().flat_map(|p| quantiser.whole(*p)).collect()
    };
    let mut packer = Packer::default();
    let rest = whole(&recording.rest);
    packer.shorts(&rest, None);
    // the surface at rest comes first; others follow as elements are removed
    let mut skins: Vec<&Arc<Skin>> = vec![&recording.rest_skin];
    let mut which = Vec::new();
    for frame in &recording.frames {
        let known = skins.iter().position(|skin| Arc::ptr_eq(skin, &frame.skin));
        which.push(known.unwrap_or_else(|| {
            skins.push(&frame.skin);
            skins.len() - 1
        }));
    }
    for skin in &skins {
        packer.words(skin.points.iter().copied());
        packer.words(skin.body.iter().map(|b| u32::from(*b)));
        packer.words(skin.triangles.iter().flatten().copied());
    }
    for shape in &recording.shapes {
        packer.floats(shape.points.iter().chain(&shape.normals).flatten().copied());
        packer.words(shape.triangles.iter().flatten().copied());
    }
    let mut before = rest;
    let mut scalars: Vec<Option<Vec<u8>>> = vec![None; recording.fields.len()];
    for frame in &recording.frames {
        let places = whole(&frame.points);
        packer.shorts(&places, Some(&before));
        before = places;
        for ((field, values), last) in recording.fields.iter().zip(&frame.fields).zip(&mut scalars)
        {
            let values: Vec<u8> = values.iter().map(|v| whole_scalar(*v, field.range)).collect();
            packer.bytes_of(&values, last.as_deref());
            *last = Some(values);
        }
        solids(&mut packer, frame);
    }
    let (mut middle, mut radius) = (look.middle, 0.0f32);
    if !middle.is_finite() {
        middle = Vec3::ZERO;
    }
    let tools = recording.tool_points();
    if !tools.is_empty() {
        let all = recording.extent().chain(tools.iter().copied());
        let (low, high) =
            all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        middle = 0.5 * (low + high);
    }
    for p in recording.extent().chain(tools) {
        radius = radius.max(p.distance(middle));
    }
    Ok(json!({
        "title": recording.title,
        "subtitle": recording.subtitle,
        "static": recording.is_static,
        "up": recording.up.to_array(),
        "size": recording.size(),
        "middle": middle.to_array(),
        "radius": radius,
        "floor": look.floor,
        "shade": look.shade,
        "grid": look.grid,
        "low": quantiser.low.to_array(),
        "step": quantiser.step.to_array(),
        "points": recording.rest.len(),
        "fields": recording.fields.iter().map(|f| json!({
            "name": f.name, "label": f.label, "unit": f.unit, "range": f.range, "map": f.map.name(),
        })).collect::<Vec<_>>(),
        "skins": skins.iter().map(|s| json!({
            "vertices": s.points.len(), "triangles": s.triangles.len(),
        })).collect::<Vec<_>>(),
        "shapes": recording.shapes.iter().map(|s| json!({
            "vertices": s.points.len(), "triangles": s.triangles.len(), "colour": s.colour, "plate": s.plate,
        })).collect::<Vec<_>>(),
        "arrowKey": recording.arrow_key.as_ref().map(|key| &key.text),
        "frames": recording.frames.iter().zip(which).map(|(f, skin)| json!({
            "time": f.time, "note": f.note, "skin": skin,
            "counts": [f.balls.len(), f.rods.len(), f.arrows.len(), f.tools.len()],
        })).collect::<Vec<_>>(),
        "payload": packer.text()?,
    }))
}

fn solids(packer: &mut Packer, frame: &Frame) {
    for ball in &frame.balls {
        packer.floats(ball.centre);
        packer.floats([ball.radius, colour_number(ball.colour)]);
    }
    for rod in &frame.rods {
        packer.floats(rod.ends.into_iter().flatten());
        packer.floats([colour_number(rod.colour)]);
    }
    for arrow in &frame.arrows {
        packer.floats(arrow.to);
        packer.floats(arrow.along);
        packer.floats([colour_number(arrow.colour)]);
    }
    for placed in &frame.tools {
        packer.floats([placed.shape as f32]);
        packer.floats(placed.at.into_iter().chain(placed.turn));
    }
}

/// Bytes as an address that holds them, for pictures within a page.
///
/// ```
/// assert_eq!(sinew_render::page::data_url("text/plain", b"ab"), "data:text/plain;base64,YWI=");
/// ```
pub fn data_url(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// The page of one or more runs, side by side with one camera and one clock.
///
/// # Errors
/// When a recording does not fit together, or memory runs out.
pub fn page(recordings: &[&Recording], camera: CameraRequest) -> Result<String, RenderError> {
    for recording in recordings {
        recording.check()?;
    }
    let empty = || RenderError::Empty { reason: "a page without a run".into() };
    let first = recordings.first().ok_or_else(empty)?;
    let runs: Result<Vec<Value>, _> = recordings.iter().map(|r| run_data(r)).collect();
    let runs = runs.map_err(|e| RenderError::Empty { reason: e.to_string() })?;
    let camera = match camera {
        CameraRequest::Orbit { azimuth, elevation, .. } => [azimuth, elevation],
        // the player only circles
        CameraRequest::Fixed { .. } => [25.0, 18.0],
    };
    let maps: serde_json::Map<String, Value> =
        ColourMap::ALL.iter().map(|m| (m.name().into(), json!(m.table().concat()))).collect();
    let data = json!({
        "runs": runs,
        "camera": camera,
        "field": first.fields.first().map_or("none", |f| &f.name),
        "colours": BODY_COLOURS,
        "maps": maps,
    });
    // in a script element only this could end the text
    let data = data.to_string().replace("</", "<\\/");
    let escaped = first.title.replace('&', "&amp;").replace('<', "&lt;");
    Ok(include_str!("../player/player.html")
        .replace("@TITLE@", &escaped)
        .replace("@SCRIPT@", include_str!("../player/player.js"))
        .replace("@DATA@", &data))
}

/// Writes [`page`] to a file.
///
/// # Errors
/// As [`page`], and when the file cannot be written.
pub fn write_page(
    path: &Path,
    recordings: &[&Recording],
    camera: CameraRequest,
) -> Result<(), RenderError> {
    let error = |e: std::io::Error| RenderError::Write { path: path.into(), reason: e.to_string() };
    std::fs::write(path, page(recordings, camera)?).map_err(error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Field;

    #[test]
    fn positions_come_back_within_half_a_step() {
        let quantiser =
            Quantiser { low: Vec3::new(-0.1, 2.0, 0.0), step: Vec3::new(1e-6, 3e-5, 1e-3) };
        for i in 0..2000u32 {
            let share = |k: u32| ((i * k) % 65_521) as f32;
            let p = quantiser.low + quantiser.step * Vec3::new(share(31), share(97), share(7919));
            let p = p + quantiser.step * 0.4;
            let back = Vec3::from_array(quantiser.position(quantiser.whole(p.to_array())));
            let error = (back - p).abs();
            // and the rounding of f32
            let bound = 0.5 * quantiser.step + 2.0 * f32::EPSILON * p.abs();
            assert!(error.cmple(bound).all(), "{error} beside {bound}");
        }
        assert_eq!(quantiser.whole([-9.0, 1e9, f32::NAN]), [0, u16::MAX, 0]);
    }

    #[test]
    fn scalars_come_back_within_half_a_step() {
        let range = [-0.3, 1.7];
        for i in 0..=1000 {
            let value = -0.3 + 2.0 * i as f32 / 1000.0;
            let back =
                range[0] + (range[1] - range[0]) * f32::from(whole_scalar(value, range)) / 255.0;
            assert!((back - value).abs() <= 0.5 * 2.0 / 255.0 + 1e-6);
        }
        assert_eq!(whole_scalar(9.0, range), 255);
        assert_eq!(whole_scalar(f32::NAN, range), 0);
        assert_eq!(whole_scalar(1.0, [1.0, 1.0]), 0);
    }

    #[test]
    fn the_packed_numbers_are_those_of_the_run() {
        let rest = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let skin = Arc::new(Skin::new(&[([0, 1, 2], 0)], &rest, 40.0));
        let frame = |i: usize| Frame {
            step: i as u64,
            time: i as f64,
            points: rest.iter().map(|p| p.map(|x| x * (1.0 - 0.1 * i as f32))).collect(),
            skin: skin.clone(),
            fields: vec![vec![0.1 * i as f32; 3]],
            ..Frame::default()
        };
        let field = Field {
            name: "displacement".into(),
            label: "displacement".into(),
            unit: "m".into(),
            map: ColourMap::Viridis,
            range: [0.0, 0.3],
        };
        let recording = Recording {
            title: "A </script> title".into(),
            subtitle: String::new(),
            is_static: false,
            falling: false,
            up: Vec3::Z,
            rest: rest.clone(),
            rest_skin: skin.clone(),
            fields: vec![field],
            bodies: vec!["body".into()],
            shapes: Vec::new(),
            arrow_key: None,
            interval: 1.0,
            frames: (0..4).map(frame).collect(),
        };
        let data = run_data(&recording).unwrap();
        let text = data["payload"].as_str().unwrap();
        let packed = base64::engine::general_purpose::STANDARD.decode(text).unwrap();
        let mut bytes = Vec::new();
        let mut decoder = flate2::read::ZlibDecoder::new(&packed[..]);
        std::io::Read::read_to_end(&mut decoder, &mut bytes).unwrap();
        // rest, surface, and four frames of positions and scalars
        assert_eq!(bytes.len(), 18 + 4 * (3 + 3 + 3) + 4 * (18 + 3));
        // walk through the differences up to the last frame
        let mut at = 18 + 36;
        let mut places: Vec<u16> =
            (0..9).map(|i| u16::from(bytes[i]) + 256 * u16::from(bytes[9 + i])).collect();
        let mut scalars = [0u8; 3];
        for _ in 0..4 {
            for i in 0..9 {
                let d = u16::from(bytes[at + i]) + 256 * u16::from(bytes[at + 9 + i]);
                places[i] = places[i].wrapping_add(d);
            }
            at += 18;
            for (i, s) in scalars.iter_mut().enumerate() {
                *s = s.wrapping_add(bytes[at + i]);
            }
            at += 3;
        }
        let quantiser = Quantiser::of(&recording);
        for (p, q) in recording.frames[3].points.iter().zip(places.chunks_exact(3)) {
            let back = quantiser.position([q[0], q[1], q[2]]);
            for k in 0..3 {
                assert!((back[k] - p[k]).abs() <= 0.5 * quantiser.step[k] + 1e-6);
            }
        }
        assert_eq!(scalars, [255; 3]);
        let page = page(&[&recording, &recording], CameraRequest::default()).unwrap();
        assert!(page.contains("<\\/script> title") && page.contains("A &lt;/script> title"));
        assert!(!page.contains("http:") && !page.contains("https:"), "nothing is fetched");
        assert!(super::page(&[], CameraRequest::default()).is_err());
    }
}
