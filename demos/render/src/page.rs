//! A self-contained page with an interactive player: nothing is fetched, nothing needs to be installed.
//!
//! Positions are whole numbers of 16 bits over the box of the run, scalars of 8 bits over their range
//! ([`Quantiser`]). Every frame holds differences to the one before, low bytes before high ones, and all of it is
//! deflated and written in base 64.

use crate::camera::CameraRequest;
use crate::colour::{BODY_COLOURS, ColourMap, Rgb, WOUND_COLOURS, wound_shade};
use crate::error::RenderError;
use crate::look::Look;
use crate::scene::{Frame, Graph, Recording};
use crate::skin::Skin;
use base64::Engine;
use glam::Vec3;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Points of a line over time.
const LINE: usize = 600;

const LEVEL: u32 = 5;

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
        // the best is 2 % smaller and takes three times as long
        let level = flate2::Compression::new(LEVEL);
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
        encoder.write_all(&self.bytes)?;
        Ok(base64::engine::general_purpose::STANDARD.encode(encoder.finish()?))
    }
}

/// A colour as a number that `f32` holds exactly.
fn colour_number([r, g, b]: Rgb) -> f32 {
    (u32::from(r) << 16 | u32::from(g) << 8 | u32::from(b)) as f32
}

/// A recording as the player reads it: names and ranges, and all numbers packed in `payload`.
///
/// # Errors
/// When memory cannot be written, which does not happen.
pub fn run_data(recording: &Recording) -> Result<Value, std::io::Error> {
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
        // 0 where there is no wound
        let shade = |depth: &f32| match depth.is_nan() {
            true => 0,
            false => 1 + (254.0 * wound_shade(*depth, recording.size())).round() as u8,
        };
        packer.bytes.extend(skin.depth.iter().map(shade));
    }
    for shape in &recording.shapes {
        packer.floats(shape.points.iter().chain(&shape.normals).flatten().copied());
        packer.words(shape.triangles.iter().flatten().copied());
    }
    let forces = Graph { name: "forces".into(), unit: "N".into(), lines: recording.forces.clone() };
    let graphs: Vec<Value> = std::iter::once(&forces)
        .chain(&recording.graphs)
        .filter(|graph| !graph.lines.is_empty())
        .map(|graph| {
            let lines = graph.lines.iter().map(|line| {
                let points = line.thinned(LINE);
                packer.floats(points.iter().flatten().map(|x| *x as f32));
                json!({ "name": line.name.replace('_', " "), "count": points.len() })
            });
            let lines: Vec<Value> = lines.collect();
            json!({ "name": graph.name.replace('_', " "), "unit": graph.unit, "lines": lines })
        })
        .collect();
    let cells = &recording.cells;
    packer.words(cells.iter().flat_map(|cell| cell.points));
    packer.words(cells.iter().flat_map(|cell| [cell.body.into(), cell.born, cell.gone]));
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
        "warning": recording.warning,
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
            "vertices": s.points.len(), "triangles": s.triangles.len(), "depths": s.depth.len(),
        })).collect::<Vec<_>>(),
        "shapes": recording.shapes.iter().map(|s| json!({
            "vertices": s.points.len(), "triangles": s.triangles.len(), "colour": s.colour, "plate": s.plate,
            "hollow": s.hollow,
        })).collect::<Vec<_>>(),
        "label": recording.label,
        "bodies": recording.bodies,
        "graphs": graphs,
        "cells": cells.len(),
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
    let empty = || RenderError::Empty("a page without a run".into());
    let first = recordings.first().ok_or_else(empty)?;
    let runs: Result<Vec<Value>, _> = recordings.iter().map(|r| run_data(r)).collect();
    let runs = runs.map_err(|e| RenderError::Empty(e.to_string()))?;
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
        "wound": WOUND_COLOURS,
        "maps": maps,
    });
    // in a script element only this could end the text
    let data = data.to_string().replace("</", "<\\/");
    let escaped = first.title.replace('&', "&amp;").replace('<', "&lt;");
    Ok(include_str!("../player/player.html")
        .replace("@TITLE@", &escaped)
        .replace("@STYLE@\n", include_str!("../player/base.css"))
        .replace("@SCRIPT@", include_str!("../player/player.js"))
        .replace("  @VIEW@\n", include_str!("../player/view.js"))
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
