//! Sums over the steps of a run.

use crate::assemble::BuiltScene;
use crate::summary::{GpuSummary, StepTimes, Touched};
use serde::{Deserialize, Serialize};
use sinew::simulation::Simulation;

/// Sums over the steps, beside those of the [simulation](sinew::warning::totals::RunTotals).
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Totals {
    /// Host times of all steps.
    pub step_times: StepTimes,
    /// Host time (s) of the step that failed and ended the run.
    #[serde(skip)]
    pub failed: Option<f64>,
    /// Elastic energy (J) before the first step.
    pub initial: f64,
    /// Largest reaction (N) of every constraint that a probe looks at.
    pub reactions: Vec<Option<f64>>,
    /// Volume over that at rest of every body with axes: smallest, largest and last.
    pub volume_ratios: Vec<[f64; 3]>,
    /// Host times (s) of probes and frames.
    pub probes: f64,
    pub frames: f64,
    /// Runs on a graphics processor have no checkpoints.
    #[serde(skip)]
    pub gpu: Option<GpuSummary>,
    /// Tools, pulls and contacts, in scenes that have some.
    pub touched: Option<Touched>,
}

impl Totals {
    /// Before the first step.
    pub fn new(built: &mut BuiltScene) -> Self {
        Self {
            initial: built.simulation.evaluate(),
            touched: Touched::new(built),
            reactions: vec![None; built.constraints.len()],
            volume_ratios: vec![[f64::INFINITY, f64::NEG_INFINITY, 1.0]; built.bodies.len()],
            ..Self::default()
        }
    }

    /// Adds a step that took `seconds` of host time.
    pub fn add_step(&mut self, built: &BuiltScene, seconds: f64) {
        let simulation = &built.simulation;
        self.step_times.add(seconds);
        if let Some(touched) = &mut self.touched {
            touched.add_step(built);
        }
        self.add_gpu(simulation);
    }

    #[cfg(not(feature = "gpu"))]
    fn add_gpu(&mut self, _: &Simulation) {}

    #[cfg(feature = "gpu")]
    fn add_gpu(&mut self, simulation: &Simulation) {
        let Some(own) = simulation.world().get_resource::<sinew::gpu::GpuReport>() else { return };
        let sum = self.gpu.get_or_insert_default();
        sum.adapter.clone_from(&own.adapter);
        sum.software = own.software;
        sum.host_s += own.host_seconds;
        sum.submissions += u64::from(own.submissions);
        sum.bytes_up += own.bytes_up;
        sum.bytes_down += own.bytes_down;
        sum.stalled += u64::from(own.stalled);
        if sum.device_s.is_empty() {
            sum.device_s.clone_from(&own.device_seconds);
        } else {
            for ((_, sum), (_, own)) in sum.device_s.iter_mut().zip(&own.device_seconds) {
                *sum += own;
            }
        }
    }
}
