//! The end of a step: velocities, energy cap, report, and the new state into the columns and the history.

use super::linearised_bdf2::WAIT;
use super::step::{BodyStep, ImplicitScratch, Rejected, Step, StepMode, noise};
use super::touch::At;
use crate::history::BodyHistory;
use crate::state::{book_momentum, dot3, position, write_state};
use sinew_contact::limits::Limits;
use sinew_contact::set::RowPlaces;
use sinew_engine::report::ContactFigures;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;

/// Part of the energy budget's excess over the energy that is lost every step.
pub const BUDGET_DECAY: f64 = 0.01;

impl<S: Scalar> Step<'_, S> {
    /// Ends the step.
    pub fn finish(&mut self) {
        let dynamic = self.is_dynamic();
        self.scratch.history.bodies.clear();
        let mut energy_before = 0.0;
        self.scratch.multiply_damping(self.world);
        let mut put_in = -self.contact_before;
        let r = &*self.report;
        // a body whose solve went wrong stands still, too, and so does one that is held by what touches it
        let stopped = r.cg_caps + r.line_search_failures + r.gradient_fallbacks > 0;
        let sleep_speed = if r.unconverged || stopped { 0.0 } else { self.settings.sleep_speed };
        // velocities, energy cap and energy books of every body
        for index in 0..self.bodies.len() {
            self.set_velocities(index);
            let begin = self.contact_energy_at_start(index);
            let stored = self.contact_energy(index, At::Iterate, Limits::Keep);
            put_in += begin;
            self.bodies[index].budget += begin;
            let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
            let rows = body.rows.clone();
            if dynamic {
                let power = scratch.damping_power(body, self.settings.mass_damping);
                self.report.damping_dissipation += self.dt * power;
            }
            let load_potential = scratch.node.load_potential(rows.clone(), &scratch.iterate);
            let potential = body.elastic + stored - load_potential;
            let [mut kinetic, held] = scratch.node.kinetic_energy(rows.clone(), &scratch.velocity);
            if dynamic
                && body.mode == StepMode::Safe
                && body.exceeds_budget::<S>(kinetic, potential)
            {
                kinetic = self.cap_energy(index, kinetic, [potential, stored]);
                self.report.energy_caps += 1;
            }
            let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
            let report = &mut *self.report;
            report.elastic_energy += body.elastic;
            if dynamic {
                // what holds vertices also speeds them up and slows them down
                let [free_before, held_before] =
                    scratch.node.kinetic_energy(rows.clone(), &scratch.node.v);
                report.kinetic_energy += kinetic + held;
                report.constraint_work += held - held_before;
                report.load_work +=
                    load_potential - scratch.node.load_potential(rows, &scratch.node.u);
                energy_before += body.elastic_before + free_before + held_before;
            } else {
                report.constraint_work = 0.0;
            }
            let energies = [kinetic + potential, kinetic + body.elastic + stored];
            let calm = if body.touched { 0.0 } else { scratch.calm(body, sleep_speed, self.dt) };
            scratch.history.bodies.push(BodyHistory { calm, ..body.history(energies) });
            let own = scratch.history.bodies.last().copied().unwrap_or_default();
            let others = BodyHistory { wait: own.wait, depth: own.depth, ..Default::default() };
            scratch.history.bodies.extend(body.bodies.clone().skip(1).map(|_| others));
        }
        // each stands before the bodies that come after it
        for &(body, past) in &self.asleep {
            let (scratch, report) = (&mut *self.scratch, &mut *self.report);
            let own = &self.world.resource::<Topology>().bodies[body].vertices;
            let rows = own.start as usize..own.end as usize;
            report.elastic_energy += past.body.elastic;
            let [free, held] = scratch.node.kinetic_energy(rows, &scratch.node.v);
            energy_before += past.body.elastic + free + held;
            report.constraint_work -= held;
            scratch.history.bodies.insert(body, past.body);
        }
        // contact
        let mut contact_change = 0.0;
        if let Some(contact) = &mut self.contact {
            let now = position(&self.scratch.rest, &self.scratch.iterate);
            let start = position(&self.scratch.rest, &self.scratch.node.u);
            let places = RowPlaces { now: &now, start: &start };
            let impacts = self.report.contact.impacts;
            let converged = !self.report.unconverged && self.report.line_search_failures == 0;
            let figures = contact.finish(self.world, &places, self.dt, converged);
            self.report.contact = ContactFigures { impacts, work: put_in, ..figures };
            contact_change = figures.energy - self.contact_before;
        }
        // dissipation is what the books lack
        if dynamic {
            let report = &mut *self.report;
            let work = report.load_work + report.constraint_work + report.contact.work;
            let now = report.elastic_energy + report.kinetic_energy + contact_change;
            report.dissipation = energy_before + work - now;
        }
        self.write();
    }

    /// Velocities of a body at the end of the step, vertices without elements included.
    fn set_velocities(&mut self, index: usize) {
        let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
        scratch.find_velocities(body);
        for orphan in self.orphans.iter().filter(|orphan| body.rows.contains(&orphan.row)) {
            for k in (0..3).filter(|&k| !orphan.held.holds(k)) {
                scratch.velocity[orphan.row][k] = orphan.velocity[k];
            }
        }
    }

    /// Slows free unknowns of a body down until its energy is at its budget, if possible those of the pieces alone that gained some;
    /// returns the kinetic energy (J) that is left. `stored` is the part of the potential energy (J) that is of contact.
    fn cap_energy(&mut self, index: usize, kinetic: f64, [potential, stored]: [f64; 2]) -> f64 {
        let some = self.rows_in_excess(index, stored);
        let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
        let left = (body.budget - potential).max(0.0);
        let of = |row| scratch.node.kinetic_energy(row..row + 1, &scratch.velocity)[0];
        let own: f64 = some.iter().map(|&row| of(row)).sum();
        let (slowed, factor) = match left - (kinetic - own) {
            rest if some.len() < body.rows.len() && own > 0.0 && rest >= 0.0 => (some, rest / own),
            _ => (body.rows.clone().collect(), left / kinetic),
        };
        for row in slowed {
            for k in scratch.node.free_axes(row) {
                scratch.velocity[row][k] *= S::from_f64(factor.sqrt());
            }
        }
        scratch.node.kinetic_energy(body.rows.clone(), &scratch.velocity)[0]
    }

    /// Writes the new state into the columns and the history.
    fn write(&mut self) {
        let ImplicitScratch {
            rest,
            node,
            iterate,
            velocity,
            increment,
            history,
            predicted,
            sleep,
            ..
        } = &mut *self.scratch;
        book_momentum(self.report, rest, &node.mass, iterate, velocity);
        write_state(self.world, iterate, velocity);
        std::mem::swap(&mut history.u, iterate);
        std::mem::swap(&mut history.v, velocity);
        std::mem::swap(&mut history.increment, increment);
        history.v_older.rotate_right(1);
        std::mem::swap(&mut history.v_older[0], &mut history.v_before);
        std::mem::swap(&mut history.v_before, &mut node.v);
        history.mass.clone_from(&node.mass);
        history.fixed.clone_from(&node.fixed);
        if self.settings.sleep_speed > 0.0 {
            history.external.clone_from(&node.external);
            history.prescribed.clone_from(&node.prescribed);
        } else {
            history.external.clear();
            history.prescribed.clear();
        }
        std::mem::swap(&mut history.predicted, predicted);
        history.dt = self.dt;
        history.asleep = if self.bodies.is_empty() { history.asleep + 1 } else { 0 };
        sleep.keep(self.world, history.asleep, self.report.elastic_energy);
        history.stamp(self.world);
    }
}

impl BodyStep {
    /// Whether kinetic and potential energy (J) are above the budget by more than rounding.
    fn exceeds_budget<S: Scalar>(&self, kinetic: f64, potential: f64) -> bool {
        let rounding = noise::<S>() * (kinetic + potential.abs()) + self.rounding;
        kinetic > 0.0 && kinetic + potential > self.budget + rounding
    }

    /// History of a body that ends with these energies (J): kinetic and potential, and what of that it has itself.
    fn history(&self, [energy, own]: [f64; 2]) -> BodyHistory {
        let past = self.past.body;
        let kept = 1.0 - BUDGET_DECAY;
        let unused = self.budget + past.excess - energy;
        BodyHistory {
            elastic: self.elastic,
            // what only the tolerance let through is owed; what a safe step takes is not given back
            excess: match self.mode {
                StepMode::Trial if unused > 0.0 => kept * unused,
                StepMode::Converge => 0.0,
                _ => unused.min(0.0),
            },
            largest: own.max(kept * past.largest),
            wait: if !matches!(self.rejected, None | Some(Rejected::Beforehand)) {
                WAIT
            } else {
                past.wait.saturating_sub(1)
            },
            depth: 1 + if self.past.same_state { past.depth } else { 0 },
            calm: 0.0,
        }
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// For how long (s) all vertices of a body have been slower than `speed` (1/s) times its size at the end of a step of `dt` (s).
    fn calm(&self, body: &BodyStep, speed: f64, dt: f64) -> f64 {
        let most = speed * body.size;
        let slow = |v: &[S; 4]| dot3(v, v) <= most * most;
        match speed > 0.0 && self.velocity[body.rows.clone()].iter().all(slow) {
            true => body.past.body.calm + dt,
            false => 0.0,
        }
    }

    /// Power (W) that damping takes at the velocities found, `damped` being up to date.
    fn damping_power(&self, body: &BodyStep, mass_damping: f64) -> f64 {
        let power = |row| dot3(&self.velocity[row], &self.damped[row]);
        let viscous: f64 = body.rows.clone().map(power).sum::<f64>();
        let kinetic = self.node.kinetic_energy(body.rows.clone(), &self.velocity)[0];
        2.0 * mass_damping * kinetic + body.weights.rate * viscous
    }
}
