//! What a step on the device has to tell beside [`sinew_engine::report::StepReport`].

use bevy_ecs::prelude::Resource;
use serde::Serialize;

/// Kind of work of a pass on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Energies and forces of elements, gather.
    Forces,
    /// Tangents of elements, assembly, system matrix.
    Tangent,
    /// Coarse matrix and its inverse.
    Preconditioner,
    /// Conjugate gradients.
    Solve,
    /// Everything else over vertex rows.
    Rows,
}

impl Phase {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Forces, Self::Tangent, Self::Preconditioner, Self::Solve, Self::Rows];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Forces => "forces",
            Self::Tangent => "tangent",
            Self::Preconditioner => "preconditioner",
            Self::Solve => "solve",
            Self::Rows => "rows",
        }
    }
}

/// Figures of the last step on the device.
#[derive(Resource, Clone, Debug, Default, PartialEq, Serialize)]
pub struct GpuReport {
    /// Adapter, its interface and kind.
    pub adapter: String,
    /// Shaders run on the main processor: the figures say nothing of a graphics processor.
    pub software: bool,
    /// Time on the device (s) by phase; empty when the adapter has no timestamps.
    pub device_seconds: Vec<(&'static str, f64)>,
    /// Passes beyond those that can be timed: the sum is then too small.
    pub untimed_passes: bool,
    /// Time of the integrator on the host (s), waiting for the device included.
    pub host_seconds: f64,
    /// Of that, waiting for the device.
    pub waited_seconds: f64,
    /// Submissions to the device.
    pub submissions: u32,
    /// Bytes sent to the device.
    pub bytes_up: u64,
    /// Bytes read back.
    pub bytes_down: u64,
    /// Linear solves continued because the true residual was above the one that iterations carry along.
    pub restarts: u32,
    /// Linear solves that `f32` could not bring to the tolerance; the residual reached is in the step's report.
    pub stalled: u32,
    /// The new state came down with the step; otherwise it does when somebody asks for it, and its bytes count with
    /// those of the next step.
    pub state_read: bool,
    /// Elements were uploaded anew: first step, new material, removed elements.
    pub uploads: u32,
}

impl GpuReport {
    /// Time on the device (s), if known.
    pub fn device_total(&self) -> Option<f64> {
        (!self.device_seconds.is_empty()).then(|| self.device_seconds.iter().map(|(_, s)| s).sum())
    }
}
