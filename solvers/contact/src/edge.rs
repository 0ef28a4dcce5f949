//! The sharp edge of a tool: what it holds, and the force that cutting needs.
//!
//! A point of the edge holds a point of the tissue by a spring that gives way at a limit, as friction does: with slip `s` in the
//! plane of the blade, `l = |s|`, width `w` of the point, toughness `G` and the cosine `c` between `s` and the direction in which
//! the blade cuts, the energy is `k w l^2 / 2` while `k l` is below `R = G c`, else `w (R l - R^2 / (2 k))`. What is held moves on
//! by the slip beyond the limit. So tissue is dented until the limit is reached and cut from then on, a blade that is drawn along
//! its edge cuts with less force, and one that goes back meets none (Atkins, Xu & Jeronimidis 2004 give the same ratio of slice and
//! push).

use crate::needle::NeedleState;
use bevy_ecs::prelude::*;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::row::VertexRow;

use crate::shape::Shape;
use crate::tool::{Part, ToolPose};

/// Elastic slip at the limit over the mean edge of the tissue.
pub const YIELD: f64 = 0.05;
/// Most segments of an edge.
pub const MOST_SEGMENTS: u32 = 64;

/// The sharp edge of a tool, a segment in the frame of the tool.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    /// Its ends (m).
    pub ends: [DVec3; 2],
    /// Direction in which it cuts, of any length; what of it is along the edge does not count.
    pub into: DVec3,
    /// Toughness `G` (J/m^2) of the tissue: energy that a unit of cut area takes. 0 for a blade that meets no force.
    pub toughness: f64,
    /// Way (m, in the frame of the tool) that it makes while jaws close from their first opening to none: that of the place where the
    /// blades of scissors cross, from the hinge to their tips. Zero for a blade.
    pub travel: DVec3,
}

impl Edge {
    /// The edge at `y = -length/2 .. length/2` of the frame of the tool that cuts along the x axis.
    pub fn new(length: f64, toughness: f64) -> Self {
        let end = DVec3::Y * (length / 2.0);
        Self { ends: [-end, end], into: DVec3::X, toughness, travel: DVec3::ZERO }
    }

    /// The sides of a blade that reaches so far (m) behind this edge and is so thick (m), for a tool that cuts with it; they take the
    /// friction of the tool.
    ///
    /// # Errors
    /// When the edge or a number cannot be used.
    pub fn flanks(&self, length: f64, thickness: f64) -> Result<Part, String> {
        let problem = || "its edge must not be along the way it cuts".to_owned();
        let [into, across] = self.across().ok_or_else(problem)?;
        if self.travel != DVec3::ZERO {
            return Err("the edge of scissors has no sides of its own: give the jaws shapes".into());
        }
        let along = self.ends[1] - self.ends[0];
        let half = DVec2::new(0.5 * length, 0.5 * along.length());
        let shape = Shape::Blade { half, thickness };
        let axes = DMat3::from_cols(into, across.cross(into), across);
        match shape.problem() {
            Some(problem) => Err(problem),
            None => Ok(Part {
                at: 0.5 * (self.ends[0] + self.ends[1]) - half.x * into,
                rotation: DQuat::from_mat3(&axes),
                ..shape.into()
            }),
        }
    }

    /// The error in it, if there is one.
    pub fn problem(&self) -> Option<String> {
        let along = self.ends[1] - self.ends[0];
        if !(along.is_finite() && self.ends[0].is_finite()) || along == DVec3::ZERO {
            return Some("the ends of its edge must be two points".into());
        }
        if self.across().is_none() {
            return Some("the direction in which its edge cuts must not be along the edge".into());
        }
        (!(self.toughness >= 0.0 && self.toughness.is_finite()))
            .then(|| format!("its toughness is {} J/m^2: it must be 0 or positive", self.toughness))
    }

    /// Unit direction in which it cuts, and unit normal of its plane.
    pub fn across(&self) -> Option<[DVec3; 2]> {
        let along = (self.ends[1] - self.ends[0]).try_normalize()?;
        let into = self.into.try_normalize()?;
        let into = (into - into.dot(along) * along).try_normalize()?;
        into.is_finite().then(|| [into, along.cross(into)])
    }

    /// How its points move by the opening of jaws (m/rad, in the frame of the tool), which was `first` (rad) at first.
    pub(crate) fn per_opening(&self, first: f64) -> DVec3 {
        if self.travel == DVec3::ZERO { DVec3::ZERO } else { -self.travel / first }
    }

    /// Place (m) of a point of it, `local` (m, in the frame of the tool) where jaws are as open as at `first` (rad).
    pub fn place(&self, local: DVec3, pose: &ToolPose, first: f64) -> DVec3 {
        let local = local + (pose.opening - first) * self.per_opening(first);
        pose.position + pose.rotation * local
    }

    /// A point of it (m, in the frame of the tool): of `segments` equal parts the end of that many.
    pub fn point(&self, number: u32, segments: u32) -> DVec3 {
        self.ends[0].lerp(self.ends[1], f64::from(number) / f64::from(segments))
    }
}

/// A point of tissue that a point of an edge holds; two of them, one on either side of the blade, are held by each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeHold {
    /// Index of the body.
    pub body: usize,
    /// Rows of the element.
    pub rows: [VertexRow; 4],
    /// Their shares.
    pub weights: [f64; 4],
}

/// A point of an edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EdgePoint {
    /// What it holds on either side.
    pub holds: Option<[EdgeHold; 2]>,
    /// Length (m) of the edge in the tissue for which it stands.
    pub width: f64,
    /// Limit `R` (N/m) in this step.
    pub limit: f64,
    /// Place (m) to which the cut has come; that of the edge where nothing is held.
    pub cut_to: DVec3,
    /// Place (m) from which it goes on: in front of the surface where it has just taken hold.
    pub from: DVec3,
}

/// What the edge or needle of a tool does, kept from step to step.
#[derive(Component, Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EdgeState {
    /// Its points, from end to end; none before the first step.
    pub points: Vec<EdgePoint>,
    /// Stiffness `k` (N/m^2) of what it holds.
    pub stiffness: f64,
    /// What it has cut.
    pub report: EdgeReport,
    /// What its needle does.
    pub needle: NeedleState,
}

/// What the edge of a tool has cut since it came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EdgeReport {
    /// Area (m^2, in the shapes of the steps) that it swept through tissue against its toughness.
    pub area: f64,
    /// Energy (J) that this took.
    pub fracture: f64,
    /// Elements that it parted.
    pub separated: u32,
    /// Vertices that this made.
    pub vertices: u32,
}
