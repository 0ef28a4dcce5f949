//! Linearised BDF2: one Newton step of BDF2 from `x_n + h v_n`. It counts if the tangent was positive
//! definite, the full step was taken, no element was turned inside out and the energy stayed below its
//! budget: the largest it has been, decaying by [`BUDGET_DECAY`](super::BUDGET_DECAY) of the excess a
//! step, plus outside work. The decay is slow, and a small share of the largest energy of late is allowed beyond: the energy
//! of BDF2 dips and comes back. What was allowed is owed, so that the bound does not rise with it. Otherwise the body takes
//! the safe step, and so do its next [`WAIT`] steps. Where there is no history (first step, state set or held axes changed
//! from outside, much other step length) it starts with a safe step.

use super::step::{Rejected, Step, StepMode, Weights, noise};
use super::touch::At;
use crate::integrator::Integrator;
use crate::state::write_displacement;
use sinew_contact::limits::Limits;
use sinew_contact::set::ContactSet;
use sinew_engine::ratios::measure_volume_ratios;
use sinew_engine::report::VolumeReport;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

/// Safe steps that follow one at which linearised BDF2 failed its tests.
pub const WAIT: u32 = 2;

/// Share of the largest energy of late by which a trial step may end above its budget. BDF2 keeps a norm that is not quite
/// the energy, and a free swing comes back to its budget by a hair too much.
const TOLERANCE: f64 = 1e-3;

/// Growth of energy over the energies of a body up to which a converged step stands: Newton ends before rounding does.
const GAIN: f64 = 1e-6;

impl<S: Scalar> Step<'_, S> {
    /// A trial step for every body whose past allows one, then safe steps for those that failed.
    pub fn linearised_bdf2(&mut self) -> Result<(), StepError> {
        for index in 0..self.bodies.len() {
            let impact = self.is_impact(index);
            let body = &mut self.bodies[index];
            let past = &body.past;
            let second_order =
                past.history_holds && past.body.wait == 0 && !body.inverted && !impact;
            self.report.contact.impacts += u32::from(impact);
            body.mode = if second_order { StepMode::Trial } else { StepMode::Safe };
            let fallbacks = &mut self.report.fallbacks;
            fallbacks.start += u32::from(!past.history_holds);
            fallbacks.waiting += u32::from(past.history_holds && !second_order && !impact);
        }
        self.start_at_predictor(self.dt);
        self.minimise()?;
        self.test_trials()
    }

    /// Tests the trial steps that were found; safe steps for those that fail.
    pub fn test_trials(&mut self) -> Result<(), StepError> {
        self.test_energies();
        self.test_inversion();
        self.count_trials();
        self.step_safely_where_rejected()
    }

    /// Rejects trial steps that end above the energy budget.
    fn test_energies(&mut self) {
        for index in 0..self.bodies.len() {
            let body = &self.bodies[index];
            let past = body.past.body;
            let allowed = past.excess + TOLERANCE * past.largest;
            if body.is_open_trial() && self.gains_energy(index, allowed, 0.0) {
                self.bodies[index].reject(Rejected::Energy);
            }
        }
    }

    /// Whether a body ends its step with more energy than its budget, `excess` (J), and what contact put in, by more than a
    /// `share` of its energies and rounding.
    fn gains_energy(&mut self, index: usize, excess: f64, share: f64) -> bool {
        let put_in = self.contact_energy_at_start(index);
        let stored = self.contact_energy(index, At::Iterate, Limits::Keep);
        let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
        scratch.find_velocities(body);
        let rows = body.rows.clone();
        let kinetic = scratch.node.kinetic_energy(rows.clone(), &scratch.velocity)[0];
        let potential = body.elastic + stored - scratch.node.load_potential(rows, &scratch.iterate);
        let energies = kinetic + potential.abs();
        let rounding = noise::<S>().max(share) * energies + body.rounding;
        // false for NaN
        let within = kinetic + potential <= body.budget + put_in + excess + rounding;
        !within
    }

    /// The safe step for bodies in contact for which Newton's iteration did not converge in some stage, or found a state
    /// of implicit Euler with more energy than the step began with: forces of such states are arbitrary.
    pub fn step_safely_where_contact_is_missed(&mut self) -> Result<(), StepError> {
        // multipliers move the energy, and have no safe step
        let exact = self.contact.as_ref().is_none_or(ContactSet::is_exact);
        if exact || !self.is_dynamic() {
            return Ok(());
        }
        let euler = self.settings.integrator.resolve() == Integrator::Newton;
        let mut unconverged = self.report.unconverged;
        for index in 0..self.bodies.len() {
            let body = &self.bodies[index];
            if body.mode != StepMode::Converge || !body.touched {
                continue;
            }
            if body.missed || euler && self.gains_energy(index, 0.0, GAIN) {
                let body = &mut self.bodies[index];
                body.reject(Rejected::Unconverged);
                // what the attempt met does not count
                self.report.line_search_failures -= body.searched[0];
                self.report.gradient_fallbacks -= body.searched[1];
                unconverged = true;
            }
        }
        if self.bodies.iter().any(|body| body.rejected == Some(Rejected::Unconverged)) {
            self.scratch.use_end_of_step();
            self.step_safely_where_rejected()?;
            self.report.unconverged = unconverged;
        }
        Ok(())
    }

    /// Rejects trial steps that end with inverted elements; they begin without.
    fn test_inversion(&mut self) {
        if !self.bodies.iter().any(|b| b.is_open_trial()) {
            return;
        }
        let after = self.inverted_by_body();
        for body in &mut self.bodies {
            let inverted = after[body.bodies.clone()].iter().any(|&count| count > 0);
            if body.is_open_trial() && inverted {
                body.reject(Rejected::Inverted);
            }
        }
    }

    /// Inverted elements of the bodies at the iterate; the report of volumes stays as it is.
    pub fn inverted_by_body(&mut self) -> Vec<u64> {
        write_displacement(self.world, &self.scratch.iterate);
        let before = self.world.resource::<VolumeReport>().clone();
        self.world.run_system_cached(measure_volume_ratios::<S>).expect("engine resources");
        std::mem::replace(&mut *self.world.resource_mut::<VolumeReport>(), before).inverted_by_body
    }

    fn count_trials(&mut self) {
        for body in self.bodies.iter_mut().filter(|b| b.mode == StepMode::Trial) {
            let fallbacks = &mut self.report.fallbacks;
            match body.rejected {
                None => self.report.second_order_steps += 1,
                Some(Rejected::Indefinite) => fallbacks.indefinite += 1,
                Some(Rejected::Shortened) => fallbacks.shortened += 1,
                Some(Rejected::Energy) => fallbacks.energy += 1,
                Some(Rejected::Inverted) => fallbacks.inverted += 1,
                Some(Rejected::Unconverged | Rejected::Beforehand) => {}
            }
        }
    }

    /// The safe step for the bodies whose trial step was rejected.
    fn step_safely_where_rejected(&mut self) -> Result<(), StepError> {
        for body in &mut self.bodies {
            body.done = body.rejected.is_none();
        }
        if self.bodies.iter().all(|b| b.done) {
            return Ok(());
        }
        let scratch = &mut *self.scratch;
        for body in self.bodies.iter_mut().filter(|b| !b.done) {
            body.mode = StepMode::Safe;
            body.weights = Weights::new(self.settings, self.dt);
            scratch.set_euler_inertia(body, self.dt);
            for row in body.rows.clone() {
                for k in 0..3 {
                    if scratch.node.free(row, k) {
                        scratch.iterate[row][k] = scratch.node.u[row][k];
                        scratch.increment[row][k] = S::ZERO;
                    } else {
                        scratch.set_displacement(row, k, scratch.prescribed[row][k]);
                    }
                }
            }
        }
        self.minimise()
    }
}
