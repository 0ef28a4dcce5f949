//! Simulated time, and what acts on everything at all times.

use bevy_ecs::prelude::Resource;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Simulated time.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepClock {
    /// Length of the next step (s).
    pub dt: f64,
    /// Time at the start of the next step (s).
    pub time: f64,
    /// Steps done.
    pub step: u64,
}

impl Default for StepClock {
    fn default() -> Self {
        Self { dt: 0.01, time: 0.0, step: 0 }
    }
}

/// Which part of a step is being made, where a step is cut into substeps from outside of the integrator, as for a fast
/// tool. The clock then shows the substep.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepPart {
    /// Number of the part, from 0.
    pub index: u32,
    /// Number of parts.
    pub count: u32,
}

impl Default for StepPart {
    fn default() -> Self {
        Self { index: 0, count: 1 }
    }
}

impl StepPart {
    /// This part over what is left of the step.
    pub fn share_of_rest(self) -> f64 {
        1.0 / f64::from(self.count - self.index)
    }
}

/// Says in how many parts the next step is to be made.
#[derive(Resource, Clone, Copy, Debug)]
pub struct StepDivider(pub fn(&mut bevy_ecs::world::World) -> u32);

/// Acceleration of gravity (m/s^2).
#[derive(Resource, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gravity(pub DVec3);

impl Default for Gravity {
    fn default() -> Self {
        Self(DVec3::new(0.0, 0.0, -9.81))
    }
}
