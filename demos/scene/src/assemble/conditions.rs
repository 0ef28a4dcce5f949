//! What acts on the bodies of a scene, built.

use crate::summary::{LoadSummary, PressureSummary};
use bevy_ecs::entity::Entity;
use sinew::engine::vertex::FixedAxes;

/// A constraint in the simulation.
#[derive(Clone, Debug)]
pub struct BuiltConstraint {
    /// Name.
    pub name: String,
    /// Index of the body.
    pub body: usize,
    /// The constraint.
    pub entity: Entity,
    /// Vertices, sorted.
    pub vertices: Vec<u32>,
    /// Held axes.
    pub axes: FixedAxes,
    /// Time (s) from which it acts.
    pub from: f64,
    /// Time (s) until which it acts.
    pub until: f64,
    /// What it does, in words.
    pub motion: String,
}

impl BuiltConstraint {
    /// Whether it acted on the step that ended at `time` (s).
    pub fn acts(&self, time: f64) -> bool {
        time >= self.from && time <= self.until
    }
}

/// A load in the simulation, with what a run reports of it.
#[derive(Clone, Debug)]
pub struct BuiltLoad<S = LoadSummary> {
    /// What is reported.
    pub summary: S,
    /// The load.
    pub entity: Entity,
}

/// A pressure in the simulation.
pub type BuiltPressure = BuiltLoad<PressureSummary>;
