//! Simulated time, and what acts on everything at all times.

use bevy_ecs::prelude::Resource;
use glam::DVec3;

/// Simulated time.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
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

/// Acceleration of gravity (m/s^2).
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct Gravity(pub DVec3);

impl Default for Gravity {
    fn default() -> Self {
        Self(DVec3::new(0.0, 0.0, -9.81))
    }
}
