//! Tools in recordings: their shapes, their poses and what they do to bodies.

use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec3, Vec3};
use sinew::touch::needle::Needle;
use sinew::touch::shape::Shape;
use sinew::touch::tool::{Tool, ToolPose, ToolReport};
use sinew_render::colour::{ColourMap, Rgb};
use sinew_render::rigid::{Placed, Rigid};
use sinew_render::scale::with_unit;
use sinew_render::scene::{ArrowKey, Field, Recording, Series};
use sinew_render::skin::CREASE_ANGLE;
use std::collections::HashMap;

/// Tools; half-spaces; and the force of tools on bodies, over the map from violet to yellow and over all else.
const METAL: Rgb = [150, 156, 165];
const PLATE: Rgb = [206, 209, 214];
const FORCE: [Rgb; 2] = [[222, 112, 30], [28, 86, 196]];

/// Forces below this share of what the largest pressure would be on all of the touching area are the rest of others
/// that cancel, as of two jaws: they say nothing.
const LEAST_SHARE: f64 = 0.01;

/// A force on bodies, until all frames are known and arrows get their lengths.
pub(super) struct Force {
    /// Where it acts (m).
    pub at: Vec3,
    /// The force (N).
    pub force: Vec3,
    /// Whether its arrow ends there, else it begins there.
    pub ends: bool,
    /// Colour.
    pub colour: Rgb,
}

impl Force {
    /// Pushes towards `centre` end where they act, pulls away from it begin there.
    pub fn new(at: Vec3, force: Vec3, centre: Vec3, colour: Rgb) -> Self {
        Self { at, force, ends: force.dot(at - centre) < 0.0, colour }
    }
}

/// Height and half the thickness of a blade over the length of its edge.
const BLADE: [f32; 2] = [0.6, 0.01];

/// Rods along a curved needle.
const CURVED: u32 = 32;

/// The tools of a run so far.
#[derive(Default)]
pub(super) struct Tools {
    shapes: Vec<Rigid>,
    /// Shapes by tool and part.
    known: HashMap<(Entity, usize), u32>,
    /// Colour of forces.
    colour: Rgb,
    /// Largest force of a tool in any step so far (N).
    largest: f64,
}

impl Tools {
    /// For pictures of a field, plain ones without.
    pub(super) fn new(field: Option<&Field>) -> Self {
        let other = field.is_none_or(|f| f.map != ColourMap::Viridis);
        Self { colour: FORCE[usize::from(other)], ..Self::default() }
    }

    /// Adds the force of every tool after a step that ended at a time (s) to its series.
    pub(super) fn forces(&mut self, world: &mut World, time: f64, series: &mut Vec<Series>) {
        for (tool, report) in world.query::<(&Tool, &ToolReport)>().iter(world) {
            let force = if tool.active(time) { report.force.length() } else { 0.0 };
            self.largest = self.largest.max(force);
            append(series, if tool.name.is_empty() { "tool" } else { &tool.name }, time, force);
        }
    }

    /// Where the tools stand at a time (s), after a step or before the first, and the forces by which they act on bodies.
    /// A tool that does not touch at that time is not shown.
    pub(super) fn record(
        &mut self,
        world: &mut World,
        stepped: bool,
        time: f64,
    ) -> (Vec<Placed>, Vec<Force>) {
        let (mut placed, mut forces) = (Vec::new(), Vec::new());
        for (entity, tool, report) in world.query::<(Entity, &Tool, &ToolReport)>().iter(world) {
            if !tool.active(time) {
                continue;
            }
            let &ToolReport { position, rotation, opening, .. } = report;
            // there is no report of a tool that came after the last step
            let came = report == &ToolReport::default();
            let pose = if stepped && !came {
                ToolPose { position, rotation, opening }
            } else {
                tool.wanted(time, tool.start)
            };
            for (i, part) in tool.parts.iter().enumerate() {
                let shape = *self.known.entry((entity, i)).or_insert_with(|| {
                    let shape = rigid(&part.shape);
                    self.shapes.push(if part.cavity { shape.hollow() } else { shape });
                    self.shapes.len() as u32 - 1
                });
                placed.push(place(shape, tool.part_pose(i, &pose)));
            }
            let has_sides = tool.parts.iter().any(|part| matches!(part.shape, Shape::Blade { .. }));
            if let Some(edge) = tool.edge.as_ref().filter(|_| !has_sides)
                && let Some([into, across]) = edge.across()
            {
                let shape = *self.known.entry((entity, usize::MAX)).or_insert_with(|| {
                    let length = edge.ends[0].distance(edge.ends[1]) as f32;
                    let half = length * Vec3::new(0.5 * BLADE[0], 0.5, BLADE[1]);
                    self.shapes.push(Rigid::rounded_box(half, half.z, METAL));
                    self.shapes.len() as u32 - 1
                });
                let behind = into * (0.5 * BLADE[0] as f64 * edge.ends[0].distance(edge.ends[1]));
                let middle = 0.5 * (edge.ends[0] + edge.ends[1]) - behind;
                let turn = DQuat::from_mat3(&DMat3::from_cols(into, across.cross(into), across));
                let at = pose.position + pose.rotation * middle;
                placed.push(place(shape, (at, pose.rotation * turn)));
            }
            if let Some(needle) = &tool.needle {
                let (parts, half) = shaft(needle);
                let shape = *self.known.entry((entity, usize::MAX)).or_insert_with(|| {
                    self.shapes.push(Rigid::rounded_box(half, half.z, METAL));
                    self.shapes.len() as u32 - 1
                });
                placed.extend(parts.into_iter().map(|(at, turn)| {
                    place(shape, (pose.position + pose.rotation * at, pose.rotation * turn))
                }));
            }
            let least = LEAST_SHARE * report.area * report.pressure;
            if stepped && report.force.length() > least {
                // that of pressure ends at the surface, what friction draws along begins there
                let ends = report.normal.length() >= report.friction.length();
                let (at, force) = (report.centre.as_vec3(), -report.force.as_vec3());
                forces.push(Force { at, force, ends, colour: self.colour });
            }
        }
        (placed, forces)
    }

    /// Hands the shapes over, plates as large as the bodies need, and says what the arrows of tools mean.
    pub(super) fn finish(&self, recording: &mut Recording) {
        let known = recording.shapes.len();
        recording.shapes.extend_from_slice(&self.shapes[known..]);
        for i in known..recording.shapes.len() {
            if recording.shapes[i].plate {
                recording.shapes[i] = plate(recording, i as u32);
            }
        }
        if self.largest > 0.0 {
            let longest = with_unit(self.largest, "N");
            let text = format!("force of tools on bodies, largest {longest}");
            recording.arrow_key = Some(ArrowKey { text, colour: self.colour });
        }
    }
}

/// One more point of the series of this name.
pub(super) fn append(series: &mut Vec<Series>, name: &str, time: f64, value: f64) {
    match series.iter_mut().find(|s| s.name == name) {
        Some(own) => own.points.push([time, value]),
        None => series.push(Series { name: name.into(), points: vec![[time, value]] }),
    }
}

fn place(shape: u32, (at, turn): (DVec3, DQuat)) -> Placed {
    Placed { shape, at: at.as_vec3().to_array(), turn: turn.as_quat().to_array() }
}

/// Rods along the shaft of a needle, one of a straight one, and half their sizes (m): where they meet, their round ends do.
fn shaft(needle: &Needle) -> (Vec<(DVec3, DQuat)>, Vec3) {
    let count = if needle.centre.is_some() { CURVED } else { 1 };
    let at = |i: u32| needle.place(needle.length * f64::from(i) / f64::from(count));
    let way = |i: u32| (at(i) - at(i + 1), 0.5 * (at(i) + at(i + 1)));
    let rods = (0..count).map(|i| {
        let (along, middle) = way(i);
        (middle, DQuat::from_rotation_arc(DVec3::X, along.normalize_or(DVec3::X)))
    });
    let radius = 0.5 * needle.diameter as f32;
    let half = 0.5 * way(0).0.length() as f32 + if count > 1 { radius } else { 0.0 };
    (rods.collect(), Vec3::new(half.max(radius), radius, radius))
}

/// Triangles of a shape; those of half-spaces come when it is known how large they have to be.
fn rigid(shape: &Shape) -> Rigid {
    match shape {
        Shape::Sphere { radius } => {
            let radius = *radius as f32;
            Rigid::rounded_box(Vec3::splat(radius), radius, METAL)
        }
        Shape::Capsule { half_length, radius } => {
            let radius = *radius as f32;
            let half = Vec3::new(*half_length as f32 + radius, radius, radius);
            Rigid::rounded_box(half, radius, METAL)
        }
        Shape::Box { half, rounding } => {
            Rigid::rounded_box(half.as_vec3(), *rounding as f32, METAL)
        }
        Shape::Blade { half, thickness } => {
            let half = half.extend(0.5 * thickness).as_vec3();
            Rigid::rounded_box(half, half.min_element(), METAL)
        }
        Shape::HalfSpace => Rigid { plate: true, ..Rigid::default() },
        Shape::Field(field) => {
            let points: Vec<_> = field.points().iter().map(|p| p.as_vec3().to_array()).collect();
            Rigid::mesh(&points, field.triangles(), CREASE_ANGLE, METAL)
        }
    }
}

/// The part of a half-space that lies under or over the bodies at its first and last pose, and a rim.
fn plate(recording: &Recording, shape: u32) -> Rigid {
    let size = recording.size();
    let mut poses = recording.frames.iter().flat_map(|f| &f.tools).filter(|t| t.shape == shape);
    let poses = [poses.next(), poses.next_back()];
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for pose in poses.into_iter().flatten() {
        for point in recording.extent() {
            let local = pose.local(point);
            (low, high) = (low.min(local), high.max(local));
        }
    }
    if low.x > high.x {
        (low, high) = (Vec3::ZERO, Vec3::ZERO);
    }
    let rim = 0.08 * size;
    let corner = |p: Vec3, by: f32| [p.x + by, p.y + by];
    Rigid::plate(corner(low, -rim), corner(high, rim), 0.012 * size, PLATE)
}
