//! What a step has to tell.

use bevy_ecs::prelude::Resource;
use serde::Serialize;
use std::time::Duration;

/// Figures of the last step, written by the integrator.
#[derive(Resource, Clone, Debug, Default, Serialize)]
pub struct StepReport {
    /// Newton iterations (linear systems) of the step.
    pub newton_iterations: u32,
    /// Conjugate-gradient iterations, all linear systems together.
    pub cg_iterations: u32,
    /// Linear solves that stopped at the iteration cap.
    pub cg_caps: u32,
    /// Relative residual of the last linear solve.
    pub cg_residual: f64,
    /// Newton ended at its iteration cap without reaching the tolerance.
    pub unconverged: bool,
    /// Length of the last Newton step over body size.
    pub newton_step: f64,
    /// Times the exact tangent was found indefinite and the projected one used instead.
    pub projections: u32,
    /// Elements clamped in those.
    pub clamped_elements: u64,
    /// Halvings of the line search.
    pub backtracks: u32,
    /// Line searches that found no decrease; the step ended where it started.
    pub line_search_failures: u32,
    /// The energy cap scaled the velocity.
    pub energy_caps: u32,
    /// Explicit substeps.
    pub substeps: u32,
    /// Steps repeated with more substeps because the energy grew.
    pub refinements: u32,
    /// Largest stable explicit step (s), 0 when not estimated.
    pub stable_step: f64,
    /// Distance of the accepted decrease of the incremental potential from what the linearised step
    /// predicted, relative: 0 for a step in which linearisation is exact, near 1 when it says little.
    pub linearisation_error: f64,
    /// Elastic energy (J) at the end of the step.
    pub elastic_energy: f64,
    /// Kinetic energy (J) of the free unknowns at the end of the step.
    pub kinetic_energy: f64,
    /// Work (J) of gravity and loads during the step.
    pub load_work: f64,
    /// Energy (J) that moving the prescribed vertices put in at the start of the step: an upper
    /// bound of the work done by the constraints in the step.
    pub constraint_work: f64,
    /// Total momentum of the step end (kg m/s).
    pub momentum: [f64; 3],
    /// Force evaluations of any kind.
    pub evaluations: u32,
}

/// Volume ratios J at the end of the step.
#[derive(Resource, Clone, Copy, Debug, Serialize)]
pub struct VolumeReport {
    /// Smallest deformed volume over rest volume.
    pub smallest_ratio: f64,
    /// Tetrahedra with J <= 0.
    pub inverted: u64,
}

impl Default for VolumeReport {
    fn default() -> Self {
        Self { smallest_ratio: f64::INFINITY, inverted: 0 }
    }
}

/// Host time spent in each system since the start, in order of first appearance.
#[derive(Resource, Clone, Debug, Default, Serialize)]
pub struct SystemTimes {
    /// One entry per system or stage.
    pub entries: Vec<SystemTime>,
}

/// Time spent in one system.
#[derive(Clone, Debug, Serialize)]
pub struct SystemTime {
    /// System, law or stage.
    pub name: &'static str,
    /// Total host time (s).
    pub seconds: f64,
    /// Number of runs.
    pub runs: u64,
}

impl SystemTimes {
    /// Books a run.
    pub fn add(&mut self, name: &'static str, time: Duration) {
        let seconds = time.as_secs_f64();
        match self.entries.iter_mut().find(|e| e.name == name) {
            Some(entry) => {
                entry.seconds += seconds;
                entry.runs += 1;
            }
            None => self.entries.push(SystemTime { name, seconds, runs: 1 }),
        }
    }
}
