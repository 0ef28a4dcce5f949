//! Contact between two bodies, or of a body with itself.

use crate::tool::{Stiffness, friction_problem};
use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::order::Order;
use sinew_engine::topology::BodyHandle;

/// Two bodies that may touch each other: vertices of either surface against the faces of the other, half of the area
/// each. Bodies that touch share one solve. One whose vertices are all held is a wall: its stiffness does not count, and where its
/// edges are longer than those of the other it is the other's vertices alone that touch.
#[derive(Component, Clone, Debug, PartialEq, Serialize, Deserialize)]
#[require(BodyContactReport, Order)]
pub struct BodyContact {
    /// Name for reports and probes.
    pub name: String,
    /// Indices into [`Topology::bodies`](sinew_engine::topology::Topology::bodies); the same one twice for a body that
    /// touches itself, where faces within two edges of a point at rest, and those that it is deep behind, are left out.
    pub bodies: [usize; 2],
    /// Coefficient of friction (Coulomb), 0 for none.
    pub friction: f64,
    /// Stiffness of contact; a relative one counts by the softer of the two ([`BodyContact::STIFFNESS`] by default).
    pub stiffness: Stiffness,
}

impl BodyContact {
    /// Stiffness of contact where nothing else is said, softer than that of tools: surfaces that meet both give way, and go into
    /// each other by half a percent of an edge.
    pub const STIFFNESS: Stiffness = Stiffness::Relative(20.0);

    /// Contact without friction of two bodies, or of one with itself if it comes twice.
    pub fn new(name: impl Into<String>, bodies: [BodyHandle; 2]) -> Self {
        let bodies = bodies.map(|body| body.0);
        Self { name: name.into(), bodies, friction: 0.0, stiffness: Self::STIFFNESS }
    }

    /// With a coefficient of friction.
    #[must_use]
    pub fn with_friction(mut self, coefficient: f64) -> Self {
        self.friction = coefficient;
        self
    }

    /// The error in it in a world of so many bodies, if there is one.
    pub fn problem(&self, bodies: usize) -> Option<String> {
        if let Some(body) = self.bodies.iter().find(|&&body| body >= bodies) {
            return Some(format!("there is no body number {body}"));
        }
        friction_problem(self.friction).or_else(|| self.stiffness.problem())
    }
}

/// Contact of two bodies at the end of the last step.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyContactReport {
    /// Force (N) on the first body; 0 for a body that touches itself.
    pub force: DVec3,
    /// Area (m^2, at rest) in contact: the mean of both sides.
    pub area: f64,
    /// Largest penetration (m).
    pub depth: f64,
    /// Energy (J) that friction has taken.
    pub dissipation: f64,
    /// Points that stick.
    pub sticking: u32,
    /// Points that slip.
    pub slipping: u32,
    /// Whether the step that these forces are of did not converge: they are not to be relied on.
    pub unconverged: bool,
}
