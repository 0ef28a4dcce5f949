//! What is drawn, as plain data: a [`Recording`] of frames, whoever made them.

use crate::colour::{ColourMap, Rgb};
use crate::error::RenderError;
use crate::rigid::{Placed, Rigid};
use crate::skin::Skin;
use glam::Vec3;
use std::sync::Arc;

/// A scalar on the points of all frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Its word on the command line and in pages.
    pub name: String,
    /// What the colour bar says, without unit.
    pub label: String,
    /// Unit, empty for pure numbers.
    pub unit: String,
    /// Colours.
    pub map: ColourMap,
    /// Values at the ends of the bar.
    pub range: [f32; 2],
}

impl Field {
    /// Whether it is largest where tools hide it, as the pressure of contact is.
    pub fn lies_under_tools(&self) -> bool {
        self.name == "pressure"
    }
}

/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre (m).
    pub centre: [f32; 3],
    /// Radius (m).
    pub radius: f32,
    /// Colour.
    pub colour: Rgb,
}

/// An arrow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrow {
    /// Where its point is (m).
    pub to: [f32; 3],
    /// From its tail to its point (m, as drawn).
    pub along: [f32; 3],
    /// Colour.
    pub colour: Rgb,
}

/// What arrows mean, for the caption.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrowKey {
    /// What they show, with the largest value of the run.
    pub text: String,
    /// Colour of those that are meant.
    pub colour: Rgb,
}

/// A short line, drawn as a round rod.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod {
    /// Ends (m).
    pub ends: [[f32; 3]; 2],
    /// Colour.
    pub colour: Rgb,
}

/// A time as it is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Time {
    /// Time (s), or the share of the loads of a static scene.
    pub at: f64,
    /// Whether it is the share of the loads.
    pub is_static: bool,
}

impl std::fmt::Display for Time {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_static {
            write!(f, "load {:.0} %", 100.0 * self.at)
        } else {
            write!(f, "t = {:.2} s", self.at)
        }
    }
}

/// The state at one time.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Step that led here.
    pub step: u64,
    /// Time (s), or the share of the loads of a static scene.
    pub time: f64,
    /// Points (m). Those that a cut made follow all others; what the same one of them is may differ between surfaces.
    pub points: Vec<[f32; 3]>,
    /// Surface over them; the same as before unless elements were removed or cut.
    pub skin: Arc<Skin>,
    /// Values of every field of the recording at the points.
    pub fields: Vec<Vec<f32>>,
    /// Held vertices and tools that cut.
    pub balls: Vec<Ball>,
    /// Forces.
    pub arrows: Vec<Arrow>,
    /// Fibres.
    pub rods: Vec<Rod>,
    /// Tools.
    pub tools: Vec<Placed>,
    /// What the caption says about this frame: error, residual, step.
    pub note: String,
}

/// A number over time, as the force of a tool.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// What it is, such as the name of the tool.
    pub name: String,
    /// Times (s), or shares of the loads, in rising order, with the values there.
    pub points: Vec<[f64; 2]>,
}

impl Series {
    /// The value at a time: that of the last point up to it; 0 before the first.
    pub fn at(&self, time: f64) -> f64 {
        // times are sums of steps, and frames have the same sums
        match self.points.partition_point(|p| p[0] <= time) {
            0 => 0.0,
            i => self.points[i - 1][1],
        }
    }

    /// At most `count` points with the extremes of every stretch, for drawing.
    pub fn thinned(&self, count: usize) -> Vec<[f64; 2]> {
        if self.points.len() <= count {
            return self.points.clone();
        }
        let stretch = self.points.len().div_ceil((count / 2).max(1));
        let mut thin = Vec::with_capacity(count);
        for points in self.points.chunks(stretch) {
            let value = |i: &usize| points[*i][1];
            let by = |a: &usize, b: &usize| value(a).total_cmp(&value(b));
            let ends = [(0..points.len()).min_by(by), (0..points.len()).max_by(by)];
            let mut ends: Vec<usize> = ends.into_iter().flatten().collect();
            ends.sort_unstable();
            ends.dedup();
            thin.extend(ends.into_iter().map(|i| points[i]));
        }
        thin
    }
}

/// Numbers of one kind over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// What they are.
    pub name: String,
    /// Unit, empty for pure numbers.
    pub unit: String,
    /// One line each.
    pub lines: Vec<Series>,
}

/// A tetrahedron, for a look inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Corners, among the points of the frames.
    pub points: [u32; 4],
    /// Its body.
    pub body: u16,
    /// The first frame with it: material that a cut parted is other cells than before.
    pub born: u32,
    /// The first frame without it.
    pub gone: u32,
}

/// All there is to draw of a run.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// First line of the caption: the scene.
    pub title: String,
    /// Second line: model, integrator, step.
    pub subtitle: String,
    /// Why it is not to be trusted, or where it failed; empty for a good run. Pages say it above everything else.
    pub warning: String,
    /// What stands above it where others are beside it.
    pub label: String,
    /// Whether [`Frame::time`] is the share of the loads instead of a time.
    pub is_static: bool,
    /// Whether pieces may be cut off and fall out of the picture.
    pub falling: bool,
    /// Upward direction.
    pub up: Vec3,
    /// Points at rest (m).
    pub rest: Vec<[f32; 3]>,
    /// Surface at rest, for the ghost.
    pub rest_skin: Arc<Skin>,
    /// Scalars.
    pub fields: Vec<Field>,
    /// Names of the bodies.
    pub bodies: Vec<String>,
    /// Shapes of the tools.
    pub shapes: Vec<Rigid>,
    /// What the arrows of tools mean; none where there are no such arrows.
    pub arrow_key: Option<ArrowKey>,
    /// Force (N) of every tool, pull and moved constraint over time.
    pub forces: Vec<Series>,
    /// What else was recorded over time, for pages.
    pub graphs: Vec<Graph>,
    /// What fills the bodies, for pages that cut them open; empty where surfaces alone are recorded.
    pub cells: Vec<Cell>,
    /// Simulated time (s) from frame to frame; of a static scene 0.
    pub interval: f64,
    /// The frames.
    pub frames: Vec<Frame>,
}

impl Recording {
    /// Diagonal (m) of the box around the rest shape.
    pub fn size(&self) -> f32 {
        let (low, high) = self.rest_box();
        (high - low).length().max(1e-9)
    }

    fn rest_box(&self) -> (Vec3, Vec3) {
        self.rest
            .iter()
            .map(|p| Vec3::from_array(*p))
            .filter(|p| p.is_finite())
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
    }

    /// Points that a picture of the whole run must show: the drawn points of all frames and of the rest shape.
    /// With [`falling`](Self::falling) points further than a fifth of the size of the body outside its box at rest
    /// do not count.
    pub fn extent(&self) -> impl Iterator<Item = Vec3> + Clone + '_ {
        let (low, high) = self.rest_box();
        let room = if self.falling { 0.2 * self.size() } else { f32::INFINITY };
        let room = Vec3::splat(room);
        let (low, high) = (low - room, high + room);
        let skins = self.frames.iter().flat_map(|frame| {
            frame.skin.points.iter().map(|&v| Vec3::from_array(frame.points[v as usize]))
        });
        let rest = self.rest_skin.points.iter().map(|&v| Vec3::from_array(self.rest[v as usize]));
        skins
            .chain(rest)
            .filter(move |p| p.is_finite() && p.cmpge(low).all() && p.cmple(high).all())
    }

    /// Outlines of tools in all frames, as far as they are less than half the size of the bodies outside of the box
    /// that holds these in all frames: a long shaft, or a tool on its way from far, leaves the picture.
    pub fn tool_points(&self) -> Vec<Vec3> {
        if self.shapes.is_empty() {
            return Vec::new();
        }
        let (low, high) = self
            .extent()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let room = Vec3::splat(0.5 * self.size());
        let outlines: Vec<_> = self.shapes.iter().map(Rigid::outline).collect();
        let placed = self.frames.iter().flat_map(|frame| &frame.tools);
        placed
            .flat_map(|placed| {
                outlines[placed.shape as usize].iter().map(|point| placed.carry(*point))
            })
            .filter(|p| p.cmpge(low - room).all() && p.cmple(high + room).all())
            .collect()
    }

    /// [`extent`](Self::extent), the ends of all arrows and the tools that are near: what the camera must see.
    pub fn shown(&self) -> impl Iterator<Item = Vec3> + Clone + '_ {
        let arrows = self.frames.iter().flat_map(|frame| &frame.arrows).flat_map(|arrow| {
            let to = Vec3::from_array(arrow.to);
            [to, to - Vec3::from_array(arrow.along)]
        });
        self.extent().chain(arrows.filter(|p| p.is_finite())).chain(self.tool_points())
    }

    /// Checks that every index is in range and every list long enough, so that drawing cannot fail on data.
    ///
    /// # Errors
    /// The first thing that does not fit.
    pub fn check(&self) -> Result<(), RenderError> {
        if self.frames.is_empty() {
            return Err(RenderError::Empty(format!("`{}` has no frames", self.title)));
        }
        let fits = |frame: usize, skin: &Skin, count: usize| {
            let index = |what, index: Option<u32>, count: usize| match index {
                Some(i) if i as usize >= count => {
                    Err(RenderError::Index { frame, what, index: i as usize, count })
                }
                _ => Ok(()),
            };
            index("point", skin.points.iter().copied().max(), count)?;
            index("point", skin.creases.iter().flatten().copied().max(), count)?;
            index("vertex", skin.triangles.iter().flatten().copied().max(), skin.points.len())
        };
        fits(0, &self.rest_skin, self.rest.len())?;
        let (what, count) = ("point of a cell", self.rest.len());
        let corner = self.cells.iter().flat_map(|cell| cell.points).max();
        if let Some(index) = corner.map(|v| v as usize).filter(|v| *v >= count) {
            return Err(RenderError::Index { frame: 0, what, index, count });
        }
        for shape in &self.shapes {
            let (what, count) = ("vertex of a shape", shape.points.len().min(shape.normals.len()));
            let vertices = shape.triangles.iter().flatten().map(|&v| v as usize);
            if let Some(index) = vertices.max().filter(|v| *v >= count) {
                return Err(RenderError::Index { frame: 0, what, index, count });
            }
        }
        for (i, frame) in self.frames.iter().enumerate() {
            fits(i, &frame.skin, frame.points.len())?;
            let (what, count) = ("shape", self.shapes.len());
            if let Some(placed) = frame.tools.iter().find(|t| t.shape as usize >= count) {
                return Err(RenderError::Index {
                    frame: i,
                    what,
                    index: placed.shape as usize,
                    count,
                });
            }
            let lengths = frame.fields.iter().map(Vec::len);
            if frame.fields.len() != self.fields.len()
                || lengths.into_iter().any(|n| n != frame.points.len())
            {
                let (what, index) = ("value", frame.points.len());
                let count = frame.fields.iter().map(Vec::len).min().unwrap_or(0);
                return Err(RenderError::Index { frame: i, what, index, count });
            }
        }
        Ok(())
    }
}
