//! Equilibrium at the loads and held displacements of the step's end: in one go if Newton converges and
//! turns no element inside out, else by parts. The loads of a part leave a share of the residual at the
//! start uncovered, so that the start is the equilibrium of part 0; held unknowns follow their curves. A
//! part that fails is halved, at most [`MAX_PARTINGS`] times; if that does not help either, the result of
//! the attempt in one go stands.

use super::step::{BodyStep, ImplicitScratch, Step, StepMode, Weights};
use crate::state::{Rows, evaluate, read_force};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;

/// Most halvings of the parts in which an equilibrium is sought.
pub const MAX_PARTINGS: u32 = 5;

/// The result of Newton's iteration.
struct Attempt<S> {
    iterate: Rows<S>,
    bodies: Vec<BodyStep>,
    unconverged: bool,
}

impl<S: Scalar> Step<'_, S> {
    /// Looks for the equilibrium.
    pub fn equilibrium(&mut self) -> Result<(), StepError> {
        for body in &mut self.bodies {
            let weights = Weights::new(self.settings, f64::INFINITY);
            (body.mode, body.weights) = (StepMode::Converge, weights);
        }
        let ImplicitScratch { within, node, .. } = &mut *self.scratch;
        within.read(self.world, &node.u, &node.prescribed, &node.fixed);
        let mut uncovered = Rows::default();
        let mut last_equilibrium = self.scratch.node.u.clone();
        let mut at_once: Option<Attempt<S>> = None;
        let (mut done, mut size) = (0.0, 1.0_f64);
        let smallest = 0.5_f64.powi(MAX_PARTINGS as i32);
        loop {
            let part: f64 = (done + size).min(1.0);
            if part < 1.0 && uncovered.is_empty() {
                uncovered = self.residual_at_start();
            }
            self.scratch.use_part(part, &uncovered);
            self.tools_at(part);
            self.scratch.begin();
            self.start_at(&last_equilibrium);
            self.bodies.iter_mut().for_each(BodyStep::reopen);
            let outcome = self.minimise();
            if at_once.is_none() {
                outcome?;
                at_once = Some(Attempt {
                    iterate: self.scratch.iterate.clone(),
                    bodies: self.bodies.clone(),
                    unconverged: self.report.unconverged,
                });
            } else if outcome.is_err() {
                self.report.unconverged = true;
            }
            if !self.report.unconverged && !self.inverts() {
                self.report.load_parts += 1;
                if part == 1.0 {
                    return Ok(());
                }
                done = part;
                last_equilibrium.clone_from(&self.scratch.iterate);
            } else if size * 0.5 >= smallest {
                self.report.load_partings += 1;
                size *= 0.5;
            } else {
                self.take_back(at_once.take().expect("the first attempt is kept"));
                return Ok(());
            }
        }
    }

    /// External and elastic forces (N) at the start of the step.
    fn residual_at_start(&mut self) -> Rows<S> {
        evaluate(self.world, &self.scratch.node.u, false, true, None);
        self.report.evaluations += 1;
        let mut residual = Rows::default();
        read_force(self.world, &mut residual);
        for (r, f) in residual.iter_mut().zip(&self.scratch.node.external) {
            for k in 0..3 {
                r[k] += f[k];
            }
        }
        residual
    }

    /// Free unknowns at displacements `u`.
    fn start_at(&mut self, u: &[[S; 4]]) {
        for row in 0..self.scratch.node.len() {
            for k in self.scratch.node.free_axes(row) {
                self.scratch.set_displacement(row, k, u[row][k]);
            }
        }
    }

    /// Whether bodies have inverted elements at the iterate that had none before.
    fn inverts(&mut self) -> bool {
        let now = self.inverted_by_body();
        let inverts = |body: &BodyStep| now[body.bodies.clone()].iter().any(|&count| count > 0);
        self.bodies.iter().any(|body| !body.inverted && inverts(body))
    }

    /// Ends with the result of the attempt in one go.
    fn take_back(&mut self, attempt: Attempt<S>) {
        (self.report.unconverged, self.report.load_parts) = (attempt.unconverged, 1);
        self.bodies = attempt.bodies;
        for (row, u) in attempt.iterate.iter().enumerate() {
            for k in 0..3 {
                self.scratch.set_displacement(row, k, u[k]);
            }
        }
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Loads and held displacements when `part` of the way to the end is made; `uncovered` is the
    /// residual (N) at the start.
    fn use_part(&mut self, part: f64, uncovered: &[[S; 4]]) {
        self.use_end_of_step();
        if part < 1.0 {
            let left = S::from_f64(1.0 - part);
            for (load, uncovered) in self.load.iter_mut().zip(uncovered) {
                for k in 0..3 {
                    load[k] -= left * uncovered[k];
                }
            }
            self.use_motions_at(part);
        }
    }
}
