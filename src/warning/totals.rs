//! Sums over the steps of a simulation: what warnings and summaries are made of.

use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_contact::set::ContactSet;
use sinew_engine::compression::CompressionReport;
use sinew_engine::report::{ContactFigures, StepReport, StepTotals, VolumeReport};
use sinew_engine::resource::ensure;
use sinew_engine::step::{StepClock, StepError, run_step};
use sinew_models::axes::muscle::ActivationWork;
use sinew_models::resection::{RemovalLog, RemovalReport};
use sinew_solvers::settings::{Integrator, SolverSettings};

/// Sums and extremes over the steps that led to the present state, as a resource of the world. Snapshots hold it, so
/// restoring one takes it back to what it was then.
#[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
pub struct RunTotals {
    /// Steps carried out.
    pub steps: u64,
    /// Counts of the solver, summed.
    pub sums: StepTotals,
    /// What is no sum of the solver's.
    pub solver: SolverFigures,
    /// Energies.
    pub energy: EnergySummary,
    /// Volume ratios.
    pub volume: VolumeSummary,
    /// Contact of everything with everything; all 0 in a world without.
    pub contact: ContactTotals,
    /// Linear solves on a graphics processor that `f32` could not bring to the tolerance.
    pub gpu_stalled: u64,
}

/// One step, and its figures added to [`RunTotals`].
pub(crate) fn step(world: &mut World) -> Result<(), StepError> {
    run_step(world)?;
    let mut totals = std::mem::take(&mut *ensure::<RunTotals>(world));
    totals.add_step(world);
    world.insert_resource(totals);
    Ok(())
}

impl RunTotals {
    /// Adds the last step.
    fn add_step(&mut self, world: &World) {
        let report = world.resource::<StepReport>();
        self.steps += 1;
        self.sums.add(report);
        let settings = world.get_resource::<SolverSettings>();
        let integrator = settings.map_or_else(Integrator::default, |own| own.integrator);
        self.solver.add_step(report, self.steps, integrator);
        self.contact.add_step(&report.contact, self.steps);
        let removals = world.get_resource::<RemovalLog>().into_iter().flat_map(|log| &log.0);
        removals.flat_map(|(_, result)| result).for_each(|report| self.add_removal(report));
        self.add_energy(world, report, integrator);
        self.volume.add_step(world.resource(), world.resource::<StepClock>().time);
        if let Some(compression) = world.get_resource::<CompressionReport>() {
            let most = &mut self.volume.compressed_max;
            *most = compression.compressed().max(*most);
        }
        #[cfg(feature = "gpu")]
        if let Some(own) = world.get_resource::<sinew_gpu::GpuReport>() {
            self.gpu_stalled += u64::from(own.stalled);
        }
    }

    /// Adds a removal.
    pub(crate) fn add_removal(&mut self, report: &RemovalReport) {
        self.energy.removed += report.elastic_energy + report.kinetic_energy;
    }

    fn add_energy(&mut self, world: &World, report: &StepReport, integrator: Integrator) {
        let e = &mut self.energy;
        let activation = world.get_resource::<ActivationWork>().copied().unwrap_or_default();
        let before = e.contact.unwrap_or_default();
        if world.contains_resource::<ContactSet>() {
            e.contact = Some(TouchEnergy {
                work: before.work + report.contact.work,
                stored: report.contact.energy,
                friction: before.friction + report.contact.friction_dissipation,
            });
        }
        let work = report.load_work + report.constraint_work + report.contact.work;
        if self.steps == 1 {
            // the balance of the step tells what there was before it, up to rounding
            let end = report.elastic_energy + report.kinetic_energy + report.contact.energy;
            let initial = end + report.dissipation - work - activation.step;
            e.initial = if initial > ROUNDING * (end + work.abs()) { initial } else { 0.0 };
        }
        e.load_work += report.load_work;
        e.constraint_work += report.constraint_work;
        e.recovery += report.recovery_energy;
        e.recovery_turnover += report.recovery_energy.abs();
        e.activation_work = activation.total;
        e.damping += report.damping_dissipation;
        e.elastic = report.elastic_energy;
        e.kinetic = report.kinetic_energy;
        e.elastic_max = e.elastic_max.max(e.elastic);
        e.kinetic_max = e.kinetic_max.max(e.kinetic);
        if integrator.facts().dynamic {
            e.dissipated = Some(e.dissipated.unwrap_or(0.0) + report.dissipation);
        }
    }
}

/// Part of the energies of a step that is rounding.
const ROUNDING: f64 = 1e-6;

/// Largest, mean and last figures of the solver over a run, and counts of steps.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SolverFigures {
    /// Most conjugate-gradient iterations in one step.
    pub cg_iterations_max: u32,
    /// Most Newton iterations in one step.
    pub newton_iterations_max: u32,
    /// Largest relative residual at which a linear solve ended a step.
    pub worst_residual: f64,
    /// Largest last Newton step over body size.
    pub worst_newton_step: f64,
    /// Mean over the steps of how far the decrease of the incremental potential was from what the
    /// last linearisation predicted, relative: 0 exact, near 1 when it said little.
    pub linearisation_error_mean: f64,
    /// The largest of them.
    pub linearisation_error_max: f64,
    /// Preconditioner of the last linear solve, empty without one.
    pub preconditioner: String,
    /// Steps whose Newton iteration did not converge.
    pub unconverged_steps: u64,
    /// Bodies' steps that linearised BDF2 left to the safe step: no history, tangent not positive definite, step shortened, energy
    /// over its budget, elements turned inside out, waiting after one of these.
    pub fallbacks: [u64; 6],
    /// Bodies in recovery at the end.
    pub recovering_final: u32,
    /// Those of them with something in contact, in dynamic runs.
    pub unconverged_in_contact: u64,
    /// Steps in which a body was halted or fell back to a gradient.
    pub halted_steps: u64,
    /// Those of them in which contact was not found, or bodies lay in each other.
    pub halted_by_contact: u64,
    /// Smallest stable explicit step (s), `None` when not estimated.
    pub stable_step: Option<f64>,
}

impl SolverFigures {
    fn add_step(&mut self, report: &StepReport, steps: u64, integrator: Integrator) {
        self.recovering_final = report.recovering;
        // a gradient is one iteration of many where the integrator converges, and halts nothing
        let followed = !integrator.converges() && report.gradient_fallbacks > 0;
        let halted = report.line_search_failures > 0 || followed;
        let contact = &report.contact;
        self.halted_steps += u64::from(halted);
        self.halted_by_contact += u64::from(halted && contact.unconverged + contact.buried > 0);
        self.unconverged_steps += u64::from(report.unconverged);
        let touched = contact.points > 0 && integrator.facts().dynamic;
        self.unconverged_in_contact += u64::from(report.unconverged && touched);
        self.cg_iterations_max = self.cg_iterations_max.max(report.cg_iterations);
        self.newton_iterations_max = self.newton_iterations_max.max(report.newton_iterations);
        self.worst_residual = self.worst_residual.max(report.cg_residual);
        self.worst_newton_step = self.worst_newton_step.max(report.newton_step);
        let error = report.linearisation_error;
        self.linearisation_error_mean += (error - self.linearisation_error_mean) / steps as f64;
        self.linearisation_error_max = self.linearisation_error_max.max(error);
        if self.preconditioner != report.preconditioner && !report.preconditioner.is_empty() {
            report.preconditioner.as_ref().clone_into(&mut self.preconditioner);
        }
        let f = &report.fallbacks;
        let reasons = [f.start, f.indefinite, f.shortened, f.energy, f.inverted, f.waiting];
        for (sum, count) in self.fallbacks.iter_mut().zip(reasons) {
            *sum += u64::from(count);
        }
        if report.stable_step > 0.0 {
            let smallest = self.stable_step.unwrap_or(f64::INFINITY).min(report.stable_step);
            self.stable_step = Some(smallest);
        }
    }
}

/// Energies of a run (J).
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct EnergySummary {
    /// Elastic plus kinetic energy at the start.
    pub initial: f64,
    /// What recovery from inversion added by changing laws and changing back.
    pub recovery: f64,
    /// Its magnitudes summed.
    pub recovery_turnover: f64,
    /// Work of gravity and loads.
    pub load_work: f64,
    /// Energy put in by moving constraints: an upper bound of their work.
    pub constraint_work: f64,
    /// Energy that changes of activation put into muscles.
    pub activation_work: f64,
    /// Energies of contact; `None` in scenes without.
    pub contact: Option<TouchEnergy>,
    /// Energy that left with removed elements.
    pub removed: f64,
    /// Elastic energy at the end.
    pub elastic: f64,
    /// Kinetic energy at the end.
    pub kinetic: f64,
    /// Taken out by damping, friction and the integrator, negative where energy came from nowhere: the sum over the steps of
    /// [`StepReport::dissipation`]; `None` for a series of equilibria. While materials stay as they are it is `initial +
    /// recovery + load_work + constraint_work + activation_work - removed - elastic - kinetic`, and where something touches
    /// the work of contact is added and what contacts store is taken off.
    pub dissipated: Option<f64>,
    /// The part of it that damping took; the rest is the integrator's.
    pub damping: f64,
    /// Largest elastic energy.
    pub elastic_max: f64,
    /// Largest kinetic energy.
    pub kinetic_max: f64,
}

impl EnergySummary {
    /// Energy (J) that was there or put in, magnitudes summed, or the most that was stored.
    pub fn put_in(&self) -> f64 {
        let work = self.load_work.abs() + self.constraint_work.abs() + self.activation_work.abs();
        let work = work + self.contact.map_or(0.0, |contact| contact.work.abs());
        self.initial.abs() + work + self.recovery_turnover + self.elastic_max + self.kinetic_max
    }
}

/// Volume ratios J of a run.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct VolumeSummary {
    /// Smallest J of all steps.
    pub smallest_j: f64,
    /// When (s).
    pub smallest_j_time: f64,
    /// Smallest J at the end.
    pub final_smallest_j: f64,
    /// Most tetrahedra with J <= 0 at one time.
    pub inverted_max: u64,
    /// Tetrahedra with J <= 0 at the end.
    pub inverted_final: u64,
    /// Most elements at one time of models that soften in compression with a principal stretch below 0.7.
    pub compressed_max: u64,
    /// Largest magnitude of the mean of J - 1 over a cluster, of all steps; none without clusters.
    pub largest_mean_change: Option<f64>,
}

impl Default for VolumeSummary {
    fn default() -> Self {
        Self {
            smallest_j: 1.0,
            smallest_j_time: 0.0,
            final_smallest_j: 1.0,
            inverted_max: 0,
            inverted_final: 0,
            compressed_max: 0,
            largest_mean_change: None,
        }
    }
}

impl VolumeSummary {
    fn add_step(&mut self, now: &VolumeReport, time: f64) {
        if now.smallest_ratio < self.smallest_j {
            (self.smallest_j, self.smallest_j_time) = (now.smallest_ratio, time);
        }
        self.final_smallest_j = now.smallest_ratio;
        self.inverted_max = self.inverted_max.max(now.inverted);
        self.inverted_final = now.inverted;
        if now.largest_mean_change > 0.0 {
            let before = self.largest_mean_change.unwrap_or(0.0);
            self.largest_mean_change = Some(now.largest_mean_change.max(before));
        }
    }
}

/// Contact over a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ContactTotals {
    /// Most points in contact at the end of a step.
    pub points_max: u32,
    /// Points in contact at the end of the run.
    pub points_final: u32,
    /// Iterations of the inner loop: linear systems with the contact of the last iterate.
    pub inner_iterations: u64,
    /// Their mean over the steps.
    pub inner_iterations_mean: f64,
    /// Most in one step.
    pub inner_iterations_max: u32,
    /// Inner loops that ended at their cap.
    pub unconverged: u64,
    /// Steps at whose end something touched.
    pub touching: u64,
    /// Steps that did not converge while something touched or pulled: their forces are not to be relied on.
    pub missed: u64,
    /// Whether the last step is one of these.
    pub missed_final: bool,
    /// Largest penetration (m).
    pub depth: f64,
    /// Largest penetration over the mean edge of its surface.
    pub depth_over_edge: f64,
    /// Parts in which steps were made because a tool was fast; 0 without such steps.
    pub substeps: u64,
    /// Most such parts in one step.
    pub substeps_max: u32,
    /// Steps of tools that did not reach their target.
    pub lagging: u64,
    /// Largest way (m) by which they did not reach it.
    pub lag: f64,
    /// Parts of tools, and contacts of bodies, that appeared with something inside of a body and were drawn in.
    pub drawn_in: u64,
    /// Points that were too deep inside of another body to tell its sides, and were left out, summed over steps.
    pub buried: u64,
    /// Parts of tools that were inside of a body whose surface they went through, summed over steps.
    pub pierced: u64,
    /// Steps of bodies that took the safe step because of an impact.
    pub impacts: u64,
}

impl ContactTotals {
    fn add_step(&mut self, now: &ContactFigures, steps: u64) {
        self.points_max = self.points_max.max(now.points);
        self.points_final = now.points;
        self.inner_iterations += u64::from(now.inner_iterations);
        self.inner_iterations_mean = self.inner_iterations as f64 / steps as f64;
        self.inner_iterations_max = self.inner_iterations_max.max(now.inner_iterations);
        self.unconverged += u64::from(now.unconverged);
        self.touching += u64::from(now.points > 0 || now.missed);
        self.missed += u64::from(now.missed);
        self.missed_final = now.missed;
        self.depth = self.depth.max(now.depth);
        self.depth_over_edge = self.depth_over_edge.max(now.depth_over_edge);
        self.substeps += u64::from(now.substeps);
        self.substeps_max = self.substeps_max.max(now.substeps);
        self.lagging += u64::from(now.lagging);
        self.lag = self.lag.max(now.lag);
        self.drawn_in += u64::from(now.drawn_in);
        self.buried += u64::from(now.buried);
        self.pierced += u64::from(now.pierced);
        self.impacts += u64::from(now.impacts);
    }
}

/// Energies of contact (J).
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct TouchEnergy {
    /// Energy that moving tools and pulls put in: an upper bound of their work.
    pub work: f64,
    /// Stored in contacts and pulls at the end.
    pub stored: f64,
    /// What friction took; a part of what is dissipated.
    pub friction: f64,
}
