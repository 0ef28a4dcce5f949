//! TR-BDF2: the trapezoidal rule over a part of the step, then BDF2 over start, that point and end. Linearised, each stage is
//! one Newton step from where the velocities lead, and the whole must pass the tests of linearised BDF2.

use super::step::{ImplicitScratch, Rejected, Step, StepMode, Weights};
use crate::state::{evaluate, read_force};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

/// Fraction of the step at which TR-BDF2 changes from the trapezoid to BDF2.
const GAMMA: f64 = 2.0 - std::f64::consts::SQRT_2;

impl<S: Scalar> Step<'_, S> {
    /// Both stages to convergence.
    pub fn tr_bdf2(&mut self) -> Result<(), StepError> {
        self.bodies.iter_mut().for_each(|body| body.mode = StepMode::Converge);
        self.trapezoid_stage()?;
        let unconverged = self.report.unconverged;
        self.bdf2_stage()?;
        self.report.unconverged |= unconverged;
        Ok(())
    }

    /// One solve a stage for every body whose past allows it, then safe steps for those that failed.
    pub fn linearised_tr_bdf2(&mut self) -> Result<(), StepError> {
        for index in 0..self.bodies.len() {
            let impact = self.is_impact(index);
            let energies_hold = self.energies_hold;
            let body = &mut self.bodies[index];
            body.mode = StepMode::Trial;
            if !energies_hold || !body.past.same_state {
                body.past.body.forget_energies();
            }
            self.report.contact.impacts += u32::from(impact);
            let waits = body.past.body.wait > 0 || body.inverted;
            self.report.fallbacks.waiting += u32::from(waits && !impact);
            if waits || impact {
                body.reject(Rejected::Beforehand);
            }
        }
        self.trapezoid_stage()?;
        self.bdf2_stage()?;
        self.scratch.use_end_of_step();
        self.test_trials()
    }

    /// First stage: the trapezoidal rule to `GAMMA` of the step.
    fn trapezoid_stage(&mut self) -> Result<(), StepError> {
        let h = 0.5 * GAMMA * self.dt;
        for body in &mut self.bodies {
            body.weights = Weights::new(self.settings, h);
        }
        self.tools_at(0.0);
        // books of the whole step
        let energies = self.begin_with_energies(false);
        self.freeze_damping(|s| &s.node.u);
        self.scratch.multiply_damping(self.world);
        self.open_books(&energies);
        self.add_start_force_to_loads();

        let scratch = &mut *self.scratch;
        scratch.use_motions_at(GAMMA);
        scratch.begin();
        let h = S::from_f64(h);
        for row in self.bodies.iter().flat_map(|body| body.rows.clone()) {
            for k in 0..3 {
                scratch.offset[row][k] = h * scratch.node.v[row][k];
                if scratch.node.free(row, k) {
                    let inertial = scratch.offset[row][k] + scratch.offset[row][k];
                    scratch.inertial[row][k] = inertial;
                    scratch.set_increment(row, k, inertial);
                }
            }
        }
        self.freeze_damping(|s| &s.iterate);
        self.tools_at(GAMMA);
        self.minimise()
    }

    /// Loads of the trapezoidal rule: those at its end and its start, and all other forces at the start.
    fn add_start_force_to_loads(&mut self) {
        evaluate(self.world, &self.scratch.node.u, false, true, None);
        self.report.evaluations += 1;
        read_force(self.world, &mut self.scratch.force);
        self.scratch.trial.clone_from(&self.scratch.node.u);
        let mut force = std::mem::take(&mut self.scratch.force);
        for index in 0..self.bodies.len() {
            self.add_contact_forces(index, &mut force);
        }
        self.scratch.force = force;
        let ImplicitScratch { within, node, .. } = &mut *self.scratch;
        within.read(self.world, &node.u, &node.prescribed, &node.fixed);
        let scratch = &mut *self.scratch;
        scratch.use_loads_at(GAMMA);
        let end = std::mem::take(&mut scratch.load);
        scratch.use_loads_at(0.0);
        for row in 0..scratch.node.len() {
            // damping multiplies `increment - offset`, here the velocities
            scratch.offset[row] = scratch.node.v[row].map(|v| -v);
            scratch.increment[row] = [S::ZERO; 4];
        }
        scratch.multiply_damping(self.world);
        let alpha = S::from_f64(self.settings.mass_damping);
        for row in 0..scratch.node.len() {
            for k in 0..3 {
                let mass = scratch.node.mass[row];
                let damping = alpha * mass * scratch.node.v[row][k] + scratch.damped[row][k];
                scratch.load[row][k] += end[row][k] + scratch.force[row][k] - damping;
            }
        }
    }

    /// Second stage: BDF2 over the start, the end of the first stage, and the end of the step.
    fn bdf2_stage(&mut self) -> Result<(), StepError> {
        let a = S::from_f64(1.0 / (GAMMA * (2.0 - GAMMA)));
        let h = S::from_f64(0.5 * GAMMA * self.dt);
        let rest = S::from_f64((1.0 - GAMMA) * self.dt);
        let scratch = &mut *self.scratch;
        for body in &mut self.bodies {
            scratch.find_velocities(body);
            body.reopen();
            if body.rejected.is_some() {
                // what was found may not even be a number
                for row in body.rows.clone() {
                    scratch.increment[row] = [S::ZERO; 4];
                    scratch.velocity[row] = [S::ZERO; 4];
                }
            }
        }
        scratch.use_end_of_step();
        for row in self.bodies.iter().flat_map(|body| body.rows.clone()) {
            for k in 0..3 {
                let (increment, v) = (scratch.increment[row][k], scratch.velocity[row][k]);
                scratch.offset[row][k] = a * increment;
                if scratch.node.free(row, k) {
                    let v_start = scratch.node.v[row][k];
                    scratch.inertial[row][k] =
                        scratch.offset[row][k] + h * (v_start + a * (v - v_start));
                    scratch.set_increment(row, k, increment + rest * v);
                } else {
                    scratch.set_displacement(row, k, scratch.prescribed[row][k]);
                }
            }
        }
        self.freeze_damping(|s| &s.iterate);
        self.tools_at(1.0);
        self.minimise()
    }
}
