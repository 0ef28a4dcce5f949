//! Where an iteration starts, the damping matrix that is frozen there, and the energy books of a step.

use super::step::{BodyStep, ImplicitScratch, Step, StepMode, Weights};
use crate::state::{dot3, evaluate, evaluate_damping};
use sinew_engine::law::{ElasticEnergy, TangentKind};
use sinew_engine::matrix::Tangent;
use sinew_engine::scalar::Scalar;

/// Elastic energies (J) of the bodies.
pub(super) struct StartEnergies {
    /// At the start of the step.
    pub before: Vec<f64>,
    /// With the held vertices where they have to go.
    pub moved: Vec<f64>,
}

impl<S: Scalar> Step<'_, S> {
    /// Elastic energies of the groups of bodies at displacements `u`, by an evaluation.
    fn elastic_energies(&mut self, u: impl Fn(&ImplicitScratch<S>) -> &[[S; 4]]) -> Vec<f64> {
        evaluate(self.world, u(self.scratch), true, false, None);
        self.report.evaluations += 1;
        let by_body = &self.world.resource::<ElasticEnergy>().by_body;
        self.bodies.iter().map(|body| body.sum(by_body)).collect()
    }

    /// Elastic energies (J) of the bodies at the iterate.
    pub fn energies_at_iterate(&mut self) -> Vec<f64> {
        self.elastic_energies(|s| &s.iterate)
    }

    /// Elastic energies (J) of the bodies at the start of the step.
    pub fn energies_at_start(&mut self) -> Vec<f64> {
        self.elastic_energies(|s| &s.node.u)
    }

    /// Begins the iteration at the old state with held vertices moved, and evaluates the energies that the
    /// books open with. `remembered` energies are used where they hold.
    pub fn begin_with_energies(&mut self, remembered: bool) -> StartEnergies {
        let moved_any = self.scratch.begin();
        let before = if remembered && self.bodies.iter().all(|b| b.past.same_state) {
            self.bodies.iter().map(|b| b.past.body.elastic).collect()
        } else {
            self.energies_at_start()
        };
        let moved = if moved_any { self.energies_at_iterate() } else { before.clone() };
        StartEnergies { before, moved }
    }

    /// Opens the energy books: budget of every body, and the work of its constraints so far, which is
    /// elastic and damping energy of moving the held vertices, less what the loads contribute to it.
    pub fn open_books(&mut self, energies: &StartEnergies) {
        let scratch = &*self.scratch;
        for (i, body) in self.bodies.iter_mut().enumerate() {
            let rows = body.rows.clone();
            let power = rows.clone().map(|row| dot3(&scratch.increment[row], &scratch.damped[row]));
            let damping = 0.5 * body.weights.rate * power.sum::<f64>();
            let loads = scratch.node.load_potential(rows.clone(), &scratch.iterate);
            let (before, moved) = (energies.before[i], energies.moved[i]);
            body.elastic_before = before;
            body.budget = scratch.node.kinetic_energy(rows.clone(), &scratch.node.v)[0] + moved
                - loads
                + damping;
            self.report.constraint_work += moved + damping
                - before
                - (loads - scratch.node.load_potential(rows, &scratch.node.u));
        }
    }

    /// Freezes the damping matrix at displacements `u`; empty where nothing but mass damps.
    pub fn freeze_damping(&mut self, u: impl Fn(&ImplicitScratch<S>) -> &[[S; 4]]) {
        let mut damping = std::mem::take(&mut self.scratch.damping);
        damping.diagonal.clear();
        damping.off_diagonal.clear();
        if self.settings.stiffness_damping > 0.0 {
            let kind = Some(TangentKind::GaussNewton);
            evaluate(self.world, u(self.scratch), false, false, kind);
            self.report.evaluations += 1;
            std::mem::swap(&mut damping, &mut self.world.resource_mut::<Tangent<S>>().matrix);
            damping.scale(S::from_f64(self.settings.stiffness_damping));
        }
        if evaluate_damping(self.world, u(self.scratch)) {
            let dampers = &mut self.world.resource_mut::<Tangent<S>>().matrix;
            if damping.diagonal.is_empty() {
                std::mem::swap(&mut damping, dampers);
            } else {
                damping.add(dampers);
            }
        }
        self.scratch.damping = damping;
    }

    /// Starts the iteration from where the velocities lead after `ahead` (s), for bodies that do not take
    /// the safe step; BDF2 where the history lets it go on, implicit Euler over `ahead` elsewhere.
    pub fn start_at_predictor(&mut self, ahead: f64) {
        let ratio = self.dt / self.scratch.history.dt;
        for body in &mut self.bodies {
            let bdf2 = self.dt * (1.0 + ratio) / (1.0 + 2.0 * ratio);
            let h = if body.uses_bdf2() { bdf2 } else { ahead };
            body.weights = Weights::new(self.settings, h);
            if !self.energies_hold {
                body.past.body.forget_energies();
            }
        }
        let energies = self.begin_with_energies(self.energies_hold);

        let scratch = &mut *self.scratch;
        scratch.trial.clone_from(&scratch.iterate);
        let step = S::from_f64(ahead);
        for body in self.bodies.iter().filter(|b| b.mode != StepMode::Safe) {
            for row in body.rows.clone() {
                for k in scratch.node.free_axes(row) {
                    scratch.trial[row][k] = scratch.node.u[row][k] + step * scratch.node.v[row][k];
                }
            }
        }
        self.freeze_damping(|s| &s.trial);
        self.scratch.multiply_damping(self.world);
        self.open_books(&energies);

        let scratch = &mut *self.scratch;
        for body in &self.bodies {
            if body.uses_bdf2() {
                scratch.set_bdf2_inertia(body, ratio);
            } else {
                scratch.set_euler_inertia(body, ahead);
            }
            if body.mode != StepMode::Safe {
                for row in body.rows.clone() {
                    for k in scratch.node.free_axes(row) {
                        scratch.set_increment(row, k, step * scratch.node.v[row][k]);
                    }
                }
            }
        }
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Start of the iteration: the old state with the held unknowns where they have to go; says whether any
    /// of them moved. Offset and inertial increment are zero.
    pub(super) fn begin(&mut self) -> bool {
        let n = self.node.len();
        for rows in [&mut self.increment, &mut self.offset, &mut self.inertial] {
            rows.clear();
            rows.resize(n, [S::ZERO; 4]);
        }
        self.iterate.clone_from(&self.node.u);
        let mut any = false;
        for row in 0..n {
            for k in self.node.held_axes(row) {
                self.set_displacement(row, k, self.prescribed[row][k]);
                any |= self.increment[row][k] != S::ZERO;
            }
        }
        any
    }

    /// Offset and inertial increment of implicit Euler over `h` (s).
    pub(super) fn set_euler_inertia(&mut self, body: &BodyStep, h: f64) {
        let h = S::from_f64(h);
        for row in body.rows.clone() {
            self.offset[row] = [S::ZERO; 4];
            for k in self.node.free_axes(row) {
                self.inertial[row][k] = h * self.node.v[row][k];
            }
        }
    }

    /// Offset and inertial increment of BDF2; this step is `ratio` times as long as the last one.
    fn set_bdf2_inertia(&mut self, body: &BodyStep, ratio: f64) {
        let b = S::from_f64(ratio * ratio / (1.0 + 2.0 * ratio));
        let h = S::from_f64(1.0 / body.weights.rate);
        for row in body.rows.clone() {
            for k in 0..3 {
                self.offset[row][k] = b * self.history.increment[row][k];
                if self.node.free(row, k) {
                    let v = self.node.v[row][k];
                    let v_ref = v + b * (v - self.history.v_before[row][k]);
                    self.inertial[row][k] = self.offset[row][k] + h * v_ref;
                }
            }
        }
    }
}
