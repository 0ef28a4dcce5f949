//! Sums over the steps of a run.

use crate::assemble::BuiltScene;
use crate::summary::{
    EnergySummary, GpuSummary, SolverFigures, StepTimes, TouchSummary, VolumeSummary,
};
use serde::{Deserialize, Serialize};
use sinew::engine::report::{StepReport, StepTotals};
use sinew::simulation::Simulation;

/// Sums over the steps.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Totals {
    /// Host times of all steps.
    pub step_times: StepTimes,
    pub sums: StepTotals,
    pub solver: SolverFigures,
    pub energy: EnergySummary,
    pub volume: VolumeSummary,
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
    pub touch: Option<TouchSummary>,
}

impl Totals {
    /// Before the first step.
    pub fn new(built: &mut BuiltScene) -> Self {
        let initial = built.simulation.evaluate();
        let touch = TouchSummary::new(built);
        let contact = touch.as_ref().map(|_| Default::default());
        Self {
            energy: EnergySummary {
                initial,
                elastic: initial,
                contact,
                ..EnergySummary::default()
            },
            touch,
            volume: VolumeSummary {
                smallest_j: 1.0,
                final_smallest_j: 1.0,
                ..VolumeSummary::default()
            },
            reactions: vec![None; built.constraints.len()],
            volume_ratios: vec![[f64::INFINITY, f64::NEG_INFINITY, 1.0]; built.bodies.len()],
            ..Self::default()
        }
    }

    /// Adds a step that took `seconds` of host time.
    pub fn add_step(&mut self, built: &BuiltScene, seconds: f64) {
        let simulation = &built.simulation;
        self.step_times.add(seconds);
        if let Some(touch) = &mut self.touch {
            touch.add_step(built, self.step_times.count());
        }
        self.add(simulation.report());
        self.add_gpu(simulation);
        self.energy.activation_work = simulation.activation_work().total;
        let (volume, v) = (simulation.volume_report(), &mut self.volume);
        if volume.smallest_ratio < v.smallest_j {
            v.smallest_j = volume.smallest_ratio;
            v.smallest_j_time = simulation.time();
        }
        v.final_smallest_j = volume.smallest_ratio;
        v.inverted_max = v.inverted_max.max(volume.inverted);
        v.inverted_final = volume.inverted;
        v.compressed_max = v.compressed_max.max(simulation.compressed_elements());
        if volume.largest_mean_change > 0.0 {
            let before = v.largest_mean_change.unwrap_or(0.0);
            v.largest_mean_change = Some(volume.largest_mean_change.max(before));
        }
    }

    fn add(&mut self, report: &StepReport) {
        self.sums.add(report);
        let s = &mut self.solver;
        s.recovering_final = report.recovering;
        s.halted_steps += u64::from(report.line_search_failures + report.gradient_fallbacks > 0);
        s.unconverged_steps += u64::from(report.unconverged);
        s.cg_iterations_max = s.cg_iterations_max.max(report.cg_iterations);
        s.newton_iterations_max = s.newton_iterations_max.max(report.newton_iterations);
        s.worst_residual = s.worst_residual.max(report.cg_residual);
        s.worst_newton_step = s.worst_newton_step.max(report.newton_step);
        // a running mean: the time of this step is booked already
        let done = self.step_times.count().max(1) as f64;
        let error = report.linearisation_error;
        s.linearisation_error_mean += (error - s.linearisation_error_mean) / done;
        s.linearisation_error_max = s.linearisation_error_max.max(error);
        if s.preconditioner != report.preconditioner && !report.preconditioner.is_empty() {
            report.preconditioner.as_ref().clone_into(&mut s.preconditioner);
        }
        let f = &report.fallbacks;
        let reasons = [f.start, f.indefinite, f.shortened, f.energy, f.inverted, f.waiting];
        for (sum, count) in s.fallbacks.iter_mut().zip(reasons) {
            *sum += u64::from(count);
        }
        if report.stable_step > 0.0 {
            let smallest = s.stable_step.unwrap_or(f64::INFINITY).min(report.stable_step);
            s.stable_step = Some(smallest);
        }
        let e = &mut self.energy;
        e.load_work += report.load_work;
        e.recovery += report.recovery_energy;
        e.recovery_turnover += report.recovery_energy.abs();
        e.constraint_work += report.constraint_work;
        e.damping += report.damping_dissipation;
        if let Some(contact) = &mut e.contact {
            contact.work += report.contact.work;
            contact.stored = report.contact.energy;
            contact.friction += report.contact.friction_dissipation;
        }
        e.elastic = report.elastic_energy;
        e.kinetic = report.kinetic_energy;
        e.elastic_max = e.elastic_max.max(e.elastic);
        e.kinetic_max = e.kinetic_max.max(e.kinetic);
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

    /// Energy (J) that damping and the integrator took out.
    pub fn dissipated(&self) -> f64 {
        let e = &self.energy;
        let contact = e.contact.map_or(0.0, |contact| contact.work - contact.stored);
        contact + e.initial + e.recovery + e.load_work + e.constraint_work + e.activation_work
            - e.removed
            - e.elastic
            - e.kinetic
    }
}
