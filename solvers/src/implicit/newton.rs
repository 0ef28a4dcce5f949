//! Newton's iteration on the incremental potential of every body: once for safe and trial steps, else to
//! convergence.

use super::start::StartEnergies;
use super::step::{
    BodyStep, FreePiece, ImplicitScratch, Rejected, Step, StepMode, Weights, largest_entry,
};
use crate::cg::CgStatus;
use crate::linear_solver::CgOutcome;
use crate::state::{NodeState, Rows, dot3, evaluate, read_force};
use crate::system::ShiftedTangent;
use bevy_ecs::prelude::World;
use sinew_engine::law::{ElasticEnergy, TangentKind};
use sinew_engine::matrix::{BlockMatrix, PredictedValues, Tangent};
use sinew_engine::report::{StepReport, SystemTimes};
use sinew_engine::resource::{put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepError, not_finite};
use sinew_engine::stopwatch::Stopwatch;
use sinew_engine::topology::{BodyRows, Topology};
use std::ops::Range;
use std::time::Duration;

impl<S: Scalar> Step<'_, S> {
    /// Iterates for all bodies that are not done; the energy books are open.
    pub fn minimise(&mut self) -> Result<(), StepError> {
        self.newton(|_| ())
    }

    /// Iterates for all bodies, and opens the energy books with the energies of the first iterate, given the
    /// elastic energies `before` held vertices moved, if any did.
    pub fn minimise_and_open_books(&mut self, before: Option<Vec<f64>>) -> Result<(), StepError> {
        self.newton(|step| {
            let moved: Vec<f64> = step.bodies.iter().map(|b| b.elastic).collect();
            let before = before.unwrap_or_else(|| moved.clone());
            step.open_books(&StartEnergies { before, moved });
        })
    }

    fn newton(&mut self, at_first_iterate: impl FnOnce(&mut Self)) -> Result<(), StepError> {
        let newton = self.bodies.iter().any(|b| b.mode == StepMode::Converge && !b.done);
        let mut at_first_iterate = Some(at_first_iterate);
        let most = if newton { self.settings.max_newton_iterations } else { 1 };
        let (mut iterations, mut multiplier_rounds) = (0, 0);
        self.recall_predicted();
        for index in 0..self.bodies.len() {
            if !self.bodies[index].done {
                self.set_dampers(index);
            }
        }
        while iterations < most {
            iterations += 1;
            let kind = self.linearise()?;
            if let Some(act) = at_first_iterate.take() {
                act(self);
            }
            self.scratch.bend.clear();
            self.find_directions(kind)?;
            self.report.newton_iterations += 1;
            self.take_converged_steps();
            self.line_search();
            self.predict();
            if self.bodies.iter().all(|b| b.done) {
                multiplier_rounds += 1;
                if !(newton && self.next_multipliers(multiplier_rounds)) {
                    break;
                }
                iterations = 0;
            }
        }
        // whoever asks for a tangent between steps wants the second derivative
        self.world.resource_mut::<PredictedValues>().0.clear();
        let unconverged = |b: &BodyStep| b.mode == StepMode::Converge && !b.converged;
        self.report.unconverged = self.bodies.iter().any(unconverged);
        for body in &mut self.bodies {
            body.missed |= unconverged(body);
        }
        Ok(())
    }

    /// Replaces the values of the low-rank vectors by those predicted for the present place of the bodies.
    fn recall_predicted(&mut self) {
        let scratch = &mut *self.scratch;
        if scratch.history.predicted.is_empty() && scratch.predicted.is_empty() {
            return;
        }
        let count = scratch.history.predicted.len().max(scratch.predicted.len());
        let mut values = vec![Vec::new(); count];
        scratch.predicted.resize(count, Vec::new());
        for step in self.bodies.iter().filter(|step| !step.done) {
            for body in step.bodies.clone().filter(|&body| body < count) {
                let own = &mut scratch.predicted[body];
                if step.rejected.is_some() {
                    own.clear();
                }
                match scratch.history.predicted.get(body) {
                    Some(known) if own.is_empty() && step.past.same_state => {
                        values[body].clone_from(known);
                    }
                    _ => values[body].clone_from(own),
                }
            }
        }
        self.world.resource_mut::<PredictedValues>().0 = values;
    }

    /// Predicts the values of the low-rank vectors at the end of the steps just taken.
    fn predict(&mut self) {
        let Self { world, scratch, bodies, .. } = self;
        if world.resource::<Tangent<S>>().low_rank.is_empty() {
            return;
        }
        let mut known = take::<PredictedValues>(world);
        let rows: Vec<_> = world.resource::<Topology>().bodies.iter().map(rows_of).collect();
        known.0.resize(rows.len(), Vec::new());
        scratch.predicted.resize(rows.len(), Vec::new());
        for step in bodies.iter_mut() {
            let taken = std::mem::take(&mut step.taken);
            for body in step.bodies.clone().filter(|_| taken > 0.0) {
                let own = &mut known.0[body];
                own.clear();
                for part in &world.resource::<Tangent<S>>().low_rank {
                    own.extend(part.pattern.of_rows(&rows[body]).map(|vector| {
                        part.values[vector] + taken * part.product(vector, &scratch.direction)
                    }));
                }
                scratch.predicted[body].clone_from(own);
            }
        }
        put(world, known);
    }

    /// Newton step over body size at which Newton has converged; it cannot resolve steps below the rounding
    /// of the state.
    pub fn newton_tolerance(&self) -> f64 {
        self.settings.newton_tolerance.max(4.0 * S::EPSILON.to_f64())
    }

    /// Energies, residual and tangent at the iterate; the kind of the tangent.
    fn linearise(&mut self) -> Result<TangentKind, StepError> {
        // Around inverted elements the exact tangent has negative curvature that a loose solve may
        // not meet; stepping along it wound one crushed cube in 18, the projected one none.
        let exact = self.bodies.iter().any(|b| !b.done && !b.projects());
        let kind = if exact { TangentKind::Exact } else { TangentKind::Projected };
        evaluate(self.world, &self.scratch.iterate, true, true, Some(kind));
        self.report.evaluations += 1;
        read_force(self.world, &mut self.scratch.force);
        let energies = &self.world.resource::<ElasticEnergy>().by_body;
        let mut finite = true;
        for body in self.bodies.iter_mut().filter(|b| !b.done) {
            let energy = body.sum(energies);
            body.elastic = energy;
            if body.mode == StepMode::Trial && !energy.is_finite() {
                body.reject(Rejected::Energy);
            } else {
                finite &= energy.is_finite();
            }
        }
        if !finite {
            return Err(locate(self.world, &self.scratch.force, "elastic force"));
        }
        self.scratch.multiply_damping(self.world);
        self.scratch.residual.resize(self.scratch.node.len(), [S::ZERO; 4]);
        for body in self.bodies.iter().filter(|b| !b.done) {
            self.scratch.find_residual(body);
        }
        Ok(kind)
    }

    /// Solves for the Newton step of every unfinished body, with the tangent of `kind`, already evaluated.
    /// An exact one that turns out indefinite gives way to the projected one, and when even that gives no
    /// descent to the preconditioned gradient.
    fn find_directions(&mut self, kind: TangentKind) -> Result<(), StepError> {
        let clock = Stopwatch::start();
        let mut evaluation = Duration::ZERO;
        self.scratch.direction.clear();
        self.scratch.direction.resize(self.scratch.node.len(), [S::ZERO; 4]);
        self.report.cg_residual = 0.0;
        let mut pending: Vec<usize> =
            (0..self.bodies.len()).filter(|&i| !self.bodies[i].done).collect();
        if kind == TangentKind::Exact {
            pending = self.solve_exact(pending)?;
            if !pending.is_empty() {
                let start = Stopwatch::start();
                let kind = Some(TangentKind::Projected);
                evaluate(self.world, &self.scratch.iterate, false, false, kind);
                evaluation = start.elapsed();
                self.report.evaluations += 1;
            }
        }
        if kind == TangentKind::Projected || !pending.is_empty() {
            self.report.projections += 1;
            self.report.clamped_elements += self.world.resource::<Tangent<S>>().clamped;
        }
        for index in pending {
            let warm_start = self.bodies[index].projects();
            if !self.solve_body(index, warm_start)? {
                self.precondition_gradient(index);
            }
        }
        let time = clock.elapsed().saturating_sub(evaluation);
        self.world.resource_mut::<SystemTimes>().add("linear solves", time);
        Ok(())
    }

    /// Solves with the exact tangent for those of the bodies `pending` that use it; the bodies that are left.
    fn solve_exact(&mut self, pending: Vec<usize>) -> Result<Vec<usize>, StepError> {
        let mut rest = Vec::new();
        for index in pending {
            let exact = !self.bodies[index].projects();
            let warm_start = self.bodies[index].mode != StepMode::Converge;
            if exact && self.solve_body(index, warm_start)? {
                continue;
            }
            if self.bodies[index].mode == StepMode::Trial {
                self.bodies[index].reject(Rejected::Indefinite);
            } else {
                rest.push(index);
            }
        }
        Ok(rest)
    }

    /// Solves for one body with the tangent last evaluated; false when the matrix is not positive
    /// definite or gives no descent.
    fn solve_body(&mut self, index: usize, warm_start: bool) -> Result<bool, StepError> {
        if self.bodies[index].touched {
            return self.solve_touched(index, warm_start);
        }
        let body = &self.bodies[index];
        let (rows, weights) = (body.rows.clone(), &body.weights);
        if warm_start {
            self.scratch.warm_start(body);
        } else {
            self.scratch.direction[rows.clone()].fill([S::ZERO; 4]);
        }
        let seeds = self.scratch.seeds(body, warm_start);
        let ImplicitScratch { linear, rest, node, residual, direction, damping, .. } =
            &mut *self.scratch;
        let (b, x) = (&residual[rows.clone()], (&mut direction[rows.clone()], &*seeds));
        let options = self.settings.linear_options();
        let system = system_matrix(self.world, weights, node, damping);
        let outcome = linear.solve_along(&system, rest, body.bodies.clone(), b, x, &options);
        let report = &mut *self.report;
        report.book(&outcome);
        let descent: f64 = b.iter().zip(&direction[rows]).map(|(b, d)| dot3(b, d)).sum();
        match outcome.status {
            CgStatus::NotFinite => Err(self.not_finite_residual()),
            CgStatus::Converged | CgStatus::Cap if descent > 0.0 || largest_entry(b) == 0.0 => {
                report.cg_residual = report.cg_residual.max(outcome.residual);
                report.cg_caps += u32::from(outcome.status == CgStatus::Cap);
                self.scratch.balance_momentum(body);
                Ok(true)
            }
            _ => Ok(false),
        }
    }

    /// Error naming the first vertex whose residual is not finite.
    pub fn not_finite_residual(&mut self) -> StepError {
        locate(self.world, &self.scratch.residual, "residual force")
    }

    /// The residual times the inverse diagonal blocks as the direction of a body.
    fn precondition_gradient(&mut self, index: usize) {
        self.report.gradient_fallbacks += 1;
        self.bodies[index].searched[1] += 1;
        self.bodies[index].gradient = true;
        let body = &self.bodies[index];
        if body.touched {
            return self.precondition_touched(index);
        }
        let ImplicitScratch { node, residual, direction, damping, .. } = &mut *self.scratch;
        let system = system_matrix(self.world, &body.weights, node, damping);
        let rows = body.rows.clone();
        system.preconditioned(body.bodies.clone(), &residual[rows.clone()], &mut direction[rows]);
    }

    /// Ends the iteration of bodies whose Newton step is small enough. That is tested before the line
    /// search, which drowns in rounding near the minimum.
    fn take_converged_steps(&mut self) {
        let (tolerance, dynamic) = (self.newton_tolerance(), self.is_dynamic());
        self.report.newton_step = 0.0;
        for body in self.bodies.iter_mut().filter(|b| !b.done) {
            let length = self.scratch.relative_step(body);
            self.report.newton_step = self.report.newton_step.max(length);
            // what is touched has a safe step to turn to
            let unknown = std::mem::take(&mut body.gradient) && body.touched && dynamic;
            if body.mode == StepMode::Converge && length <= tolerance && !unknown {
                self.scratch.advance(body.rows.clone(), S::ONE);
                body.taken = 1.0;
                (body.done, body.converged) = (true, true);
            }
        }
    }
}

/// Vertex rows of a body.
fn rows_of(body: &BodyRows) -> Range<usize> {
    body.vertices.start as usize..body.vertices.end as usize
}

/// The system matrix of the step, without contact.
pub(super) fn system_matrix<'a, S: Scalar>(
    world: &'a World,
    weights: &Weights,
    node: &'a NodeState<S>,
    damping: &'a BlockMatrix<S>,
) -> ShiftedTangent<'a, S> {
    ShiftedTangent {
        topology: world.resource(),
        workers: world.resource(),
        mass: &node.mass,
        mass_factor: S::from_f64(weights.inertia + weights.mass_damping),
        tangent: &world.resource::<Tangent<S>>().matrix,
        low_rank: &world.resource::<Tangent<S>>().low_rank,
        tangent_factor: S::ONE,
        damping: (!damping.diagonal.is_empty()).then_some((damping, S::from_f64(weights.rate))),
        fixed: &node.fixed,
        contact: None,
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// `-dP/dd` on the free unknowns of a body, zero on held ones.
    fn find_residual(&mut self, body: &BodyStep) {
        let weights = &body.weights;
        let inertia = S::from_f64(weights.inertia);
        let mass_damping = S::from_f64(weights.mass_damping);
        let rate = S::from_f64(weights.rate);
        for row in body.rows.clone() {
            let m = self.node.mass[row];
            for k in 0..3 {
                self.residual[row][k] = if self.node.free(row, k) {
                    let (d, o) = (self.increment[row][k], self.offset[row][k]);
                    m * (inertia * (self.inertial[row][k] - d) - mass_damping * (d - o))
                        - rate * self.damped[row][k]
                        + self.force[row][k]
                        + self.load[row][k]
                } else {
                    S::ZERO
                };
            }
        }
    }

    /// Starts the linear solve of a body where inertia alone would take it.
    pub(super) fn warm_start(&mut self, body: &BodyStep) {
        for row in body.rows.clone() {
            for k in 0..3 {
                self.direction[row][k] = if self.node.free(row, k) {
                    self.inertial[row][k] - self.increment[row][k]
                } else {
                    S::ZERO
                };
            }
        }
    }

    /// How far (m) inertia alone was left in the last two steps, which tells nearly how far it will be in this one: by changes
    /// of velocities over its length, one for each step, one more where inertia goes by the step before. Fewer where not so
    /// many steps lead to this one.
    pub(super) fn seeds(&self, body: &BodyStep, warm_start: bool) -> Vec<Rows<S>> {
        if !(warm_start && body.past.same_state && body.weights.inertia > 0.0) {
            return Vec::new();
        }
        let (rows, h) = (body.rows.clone(), S::from_f64(1.0 / body.weights.rate));
        let end = rows.end;
        let [older, oldest] = &self.history.v_older;
        let v = [&self.node.v, &self.history.v_before, older, oldest];
        let count = body.past.body.depth.min(if body.uses_bdf2() { 3 } else { 2 });
        let seed = |v: &[&Rows<S>]| {
            let mut seed = vec![[S::ZERO; 4]; rows.len()];
            for (own, row) in seed.iter_mut().zip(rows.clone()) {
                for k in self.node.free_axes(row) {
                    own[k] = h * (v[0][row][k] - v[1][row][k]);
                }
            }
            seed
        };
        v.windows(2).take(count).take_while(|v| v[1].len() >= end).map(seed).collect()
    }

    /// Largest Newton step of a body over its size.
    pub(super) fn relative_step(&self, body: &BodyStep) -> f64 {
        largest_entry(&self.direction[body.rows.clone()]) / body.size
    }

    /// Adds to the direction of the pieces of a body without held unknowns the translations that balance
    /// their momentum.
    fn balance_momentum(&mut self, body: &BodyStep) {
        if body.weights.inertia <= 0.0 {
            return;
        }
        let factor = body.weights.inertia + body.weights.mass_damping;
        for piece in &body.free_pieces {
            match piece {
                FreePiece::Whole => self.balance_piece(body.rows.clone(), factor),
                FreePiece::Rows(rows) => {
                    self.balance_piece(rows.iter().map(|&row| row as usize), factor);
                }
            }
        }
    }

    /// A tangent resists no translation, so the exact solution has `c_M sum m d = sum rhs`; a loose
    /// solve leaves a residual with a resultant, which would push a free body about.
    fn balance_piece(&mut self, rows: impl Iterator<Item = usize> + Clone, factor: f64) {
        let (mut missing, mut mass) = ([0.0; 3], 0.0);
        for row in rows.clone() {
            let m = factor * self.node.mass[row].to_f64();
            mass += m;
            for k in 0..3 {
                missing[k] += self.residual[row][k].to_f64() - m * self.direction[row][k].to_f64();
            }
        }
        for row in rows {
            for k in 0..3 {
                self.direction[row][k] += S::from_f64(missing[k] / mass);
            }
        }
    }
}

/// Books a linear solve in the report.
pub(super) trait BookSolve {
    fn book(&mut self, outcome: &CgOutcome);
}

impl BookSolve for StepReport {
    fn book(&mut self, outcome: &CgOutcome) {
        self.cg_iterations += outcome.iterations;
        self.preconditioner = outcome.preconditioner.name().into();
        self.preconditioner_refreshes += outcome.refreshes;
        self.preconditioner_breakdowns += outcome.breakdowns;
        self.precision_fallbacks += u32::from(outcome.fell_back);
    }
}

/// Error naming the first row that is not finite.
fn locate<S: Scalar>(world: &mut World, rows: &[[S; 4]], quantity: &'static str) -> StepError {
    let row = rows.iter().position(|f| f.iter().any(|x| !x.is_finite())).unwrap_or(0);
    not_finite(
        world,
        row,
        quantity,
        "the step was undone; the deformation is beyond the range of the number type, so check \
         loads, prescribed motion and units",
    )
}
