//! Armijo backtracking along the Newton step, body by body, with one evaluation for all of them a try.

use super::step::{BodyStep, ImplicitScratch, Rejected, Step, StepMode, largest_entry, noise};
use super::touch::At;
use crate::state::{dot3, evaluate};
use bevy_ecs::prelude::World;
use glam::{DMat3, DVec3};
use sinew_contact::limits::Limits;
use sinew_engine::law::ElasticEnergy;
use sinew_engine::matrix::{LowRank, Tangent};
use sinew_engine::scalar::Scalar;
use std::ops::Range;

/// Armijo constant.
const ARMIJO: f64 = 1e-4;
/// Predicted decrease, over the energies involved, below which Newton does not test for decrease.
const UNRESOLVED: f64 = 1e-10;
/// Most corrections of a step for the predicted volumes (its bend); each starts from what the one before left.
const BENDS: u32 = 3;
/// Energy of the volume error over the slope of the step, below which no further correction is made.
const BENT_ENOUGH: f64 = 0.01;
/// Most halvings of the line search.
const MAX_HALVINGS: u32 = 30;

/// The potential of a body along its Newton step, as differences to the current iterate: `linear t +
/// quadratic t^2 / 2` from inertia, damping and loads, and the elastic energy.
pub(super) struct LineSearch {
    /// Index of the body.
    pub body: usize,
    linear: f64,
    quadratic: f64,
    /// Coefficients of `t^2`, `t^3` and `t^4` that the bend adds to the potential.
    bent: [f64; 3],
    pub slope: f64,
    rounding: f64,
    /// Predicted decrease (J) below which Newton does not test.
    least: f64,
    /// Contact energy (J) at the current iterate.
    contact: f64,
    /// The body may be touched: then the linearised step predicts no change.
    touched: bool,
    /// Differences of energy can be told from rounding.
    resolved: bool,
    /// Fraction of the Newton step that is tried.
    pub fraction: f64,
    accepted: bool,
    /// Whether pieces have fractions of their own in the direction; `None` before that was tried.
    pub by_pieces: Option<bool>,
}

impl LineSearch {
    /// Change of the potential at the fraction tried, where the elastic energy changes by `elastic`.
    pub fn change(&self, elastic: f64) -> f64 {
        let t = self.fraction;
        let [b, c, d] = self.bent;
        elastic + t * self.linear + 0.5 * t * t * self.quadratic + t * t * (b + t * (c + t * d))
    }

    /// Whether a change of the potential is decrease enough.
    pub fn accepts(&self, change: f64) -> bool {
        // an energy that falls without end is no decrease
        change.is_finite()
            && (!self.resolved || change <= ARMIJO * self.fraction * self.slope + self.rounding)
    }

    /// Distance of a change of the potential from what the linearised step predicted, relative; `None`
    /// where it predicted nothing above rounding.
    fn linearisation_error(&self, change: f64) -> Option<f64> {
        let t = self.fraction;
        // the solved system has d.A d = -slope
        let predicted = self.slope * (t - 0.5 * t * t);
        let is_whole = !self.touched && self.by_pieces != Some(true);
        (is_whole && predicted.abs() > self.rounding).then(|| (change / predicted - 1.0).abs())
    }
}

impl<S: Scalar> Step<'_, S> {
    /// Backtracks along the direction of every unfinished body until its potential decreases enough, and
    /// moves it. A body for which no decrease is found stays where it is and is done.
    pub fn line_search(&mut self) {
        self.scratch.multiply_damping_by_direction(self.world);
        let mut searches: Vec<LineSearch> = (0..self.bodies.len())
            .filter(|&i| !self.bodies[i].done)
            .map(|i| self.scratch.line_search(i, &self.bodies[i]))
            .collect();
        for search in &mut searches {
            self.add_contact(search);
            self.bodies[search.body].rounding = search.rounding;
        }
        if searches.is_empty() {
            return;
        }
        self.scratch.trial.clone_from(&self.scratch.iterate);
        self.bend(&mut searches);
        for _ in 0..MAX_HALVINGS {
            for search in searches.iter().filter(|search| !search.accepted) {
                self.scratch.set_trial(&self.bodies[search.body], search.fraction);
            }
            evaluate(self.world, &self.scratch.trial, true, false, None);
            self.report.evaluations += 1;
            for search in searches.iter_mut().filter(|search| !search.accepted) {
                self.judge(search);
            }
            if searches.iter().all(|search| search.accepted) {
                return;
            }
        }
        let tolerance = self.newton_tolerance();
        for search in searches.iter().filter(|search| !search.accepted) {
            let body = &mut self.bodies[search.body];
            self.report.line_search_failures += 1;
            body.searched[0] += 1;
            // rounding level: the gradient is as small as the energy can resolve
            let length = self.scratch.relative_step(body);
            (body.done, body.converged) = (true, length <= tolerance.max(noise::<S>()));
        }
    }

    /// Corrects full steps so that clusters get the volumes that the linear solve predicted. A straight step moves the
    /// vertices of a rotating element along straight lines, which changes its volume to second order; times a large
    /// bulk modulus, that would be a false pressure, for which the line search would shorten the step.
    fn bend(&mut self, searches: &mut [LineSearch]) {
        let Self { world, scratch, bodies, .. } = self;
        if world.resource::<Tangent<S>>().low_rank.is_empty() {
            return;
        }
        scratch.bend.resize(scratch.direction.len(), [S::ZERO; 4]);
        // what the linear solves predicted
        let mut open: Vec<(usize, Vec<Vec<f64>>)> = Vec::new();
        for search in &*searches {
            let rows = &bodies[search.body].rows;
            let predicted = |part: &LowRank<S>| -> Vec<f64> {
                let own = part.pattern.of_rows(rows);
                own.map(|v| part.values[v] + part.product(v, &scratch.direction)).collect()
            };
            let parts = world.resource::<Tangent<S>>().low_rank.iter();
            open.push((search.body, parts.map(predicted).collect()));
        }
        // correct the step for the difference, evaluate, and again
        for _ in 0..BENDS {
            open.retain(|(_, predicted)| predicted.iter().any(|part| !part.is_empty()));
            if open.is_empty() {
                break;
            }
            for (body, _) in &open {
                scratch.set_trial(&bodies[*body], 1.0);
            }
            // the values come with every evaluation: nothing else is asked for
            evaluate(world, &scratch.trial, false, false, None);
            let now = &world.resource::<ElasticEnergy>().values;
            let parts = &world.resource::<Tangent<S>>().low_rank;
            open.retain(|(body, predicted)| {
                let (rows, own) = (&bodies[*body].rows, &bodies[*body].bodies);
                let mut excess = Vec::new();
                for ((part, now), predicted) in parts.iter().zip(now).zip(predicted) {
                    let now = &now[part.pattern.of_rows(rows)];
                    excess.extend(now.iter().zip(predicted).map(|(now, then)| now - then));
                }
                let energy = 0.5 * excess.iter().map(|x| x * x).sum::<f64>();
                let slope = searches.iter().find(|s| s.body == *body).map_or(0.0, |s| -s.slope);
                // a number that is not finite ends the search elsewhere
                energy > BENT_ENOUGH * slope
                    && energy.is_finite()
                    && scratch.linear.restore(own, &excess, &mut scratch.bend[rows.clone()])
            });
        }
        // drop absurd corrections, and keep the momentum
        for search in &*searches {
            let rows = bodies[search.body].rows.clone();
            // where the step is absurd, so is what would make its predictions true
            let ImplicitScratch { bend, direction, .. } = &mut **scratch;
            let (bend, direction) = (&mut bend[rows.clone()], &direction[rows.clone()]);
            let short = largest_entry(bend) <= largest_entry(direction);
            if !short || bend.iter().flatten().any(|x| !x.to_f64().is_finite()) {
                bend.fill([S::ZERO; 4]);
            }
            scratch.keep_momentum(rows);
        }
        for search in searches {
            self.add_bend(search);
        }
    }

    /// Coefficients that the bend adds to the potential.
    fn add_bend(&mut self, search: &mut LineSearch) {
        let Self { world, scratch, bodies, .. } = self;
        let mut damped = Vec::new();
        if !scratch.damping.diagonal.is_empty() {
            damped.resize(scratch.bend.len(), [S::ZERO; 4]);
            let ImplicitScratch { damping, product, bend, .. } = &mut **scratch;
            damping.multiply(world.resource(), world.resource(), product, bend, &mut damped);
        }
        search.bent = scratch.bent(&bodies[search.body], &damped);
    }

    /// Contact energy and slope at the iterate, with the limits that the direction was found with.
    fn add_contact(&mut self, search: &mut LineSearch) {
        search.touched = self.bodies[search.body].touched;
        if !search.touched {
            return;
        }
        search.contact = self.contact_energy(search.body, At::Iterate, Limits::Keep);
        search.rounding += noise::<S>() * search.contact + self.contact_rounding(search.body);
        let (scratch, body) = (&*self.scratch, &self.bodies[search.body]);
        if let Some(contact) = &self.contact {
            contact.for_forces(&body.bodies, |row, f| {
                for k in scratch.node.free_axes(row) {
                    search.slope -= f[k] * scratch.direction[row][k].to_f64();
                }
            });
        }
        search.resolved = body.mode != StepMode::Converge || -search.slope > search.least;
    }

    /// Moves a body by the fraction tried, gives its step up, or makes it shorter.
    fn judge(&mut self, search: &mut LineSearch) {
        let energy = self.bodies[search.body].sum(&self.world.resource::<ElasticEnergy>().by_body);
        let contact = self.contact_energy(search.body, At::Trial, Limits::Keep) - search.contact;
        let body = &mut self.bodies[search.body];
        let change = search.change(energy - body.elastic + contact);
        if search.accepts(change) {
            body.elastic = energy;
            search.accepted = true;
            body.taken = search.fraction;
            self.scratch.advance(body.rows.clone(), S::from_f64(search.fraction));
            if let Some(error) = search.linearisation_error(change) {
                self.report.linearisation_error = self.report.linearisation_error.max(error);
            }
        } else if body.mode == StepMode::Trial {
            search.accepted = true;
            body.reject(Rejected::Shortened);
        } else if !(body.mode == StepMode::Safe && self.shorten_pieces(search)) {
            self.report.backtracks += 1;
            search.fraction *= 0.5;
        }
    }

    /// The search of a body along another direction, and the slope (J) that contact has there.
    pub(super) fn search_again(&mut self, index: usize) -> (LineSearch, f64) {
        self.scratch.multiply_damping_by_direction(self.world);
        let mut search = self.scratch.line_search(index, &self.bodies[index]);
        let own = search.slope;
        self.add_contact(&mut search);
        if !self.scratch.bend.is_empty() {
            self.add_bend(&mut search);
        }
        let contact = search.slope - own;
        (search, contact)
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Takes from the bend of a body its mean motion along axes that nothing holds, and its mean rotation where nothing
    /// holds it at all: the correction that restores the predicted pressure must not add momentum.
    fn keep_momentum(&mut self, rows: Range<usize>) {
        let Self { node, bend, rest, iterate, .. } = self;
        let own = || rows.clone().map(|row| (row, node.mass[row].to_f64()));
        let vector = |of: &[S; 4]| DVec3::from_array([0, 1, 2].map(|k| of[k].to_f64()));
        let held = [0, 1, 2].map(|k| rows.clone().any(|row| !node.free(row, k)));
        let mass: f64 = own().map(|(_, m)| m).sum();
        let mean: DVec3 = own().map(|(row, m)| m / mass * vector(&bend[row])).sum();
        let place = |row: usize| rest[row] + vector(&iterate[row]);
        let mut turn = DVec3::ZERO;
        let centre: DVec3 = own().map(|(row, m)| m / mass * place(row)).sum();
        if held == [false; 3] {
            let (mut inertia, mut spin) = (DMat3::ZERO, DVec3::ZERO);
            for (row, m) in own() {
                let arm = place(row) - centre;
                spin += m * arm.cross(vector(&bend[row]));
                let [x, y, z] = (m * arm).to_array().map(|along| along * arm);
                inertia += DMat3::from_diagonal(DVec3::splat(m * arm.length_squared()));
                inertia -= DMat3::from_cols(x, y, z);
            }
            turn = inertia.inverse() * spin;
        }
        for row in rows.clone() {
            let lost = mean + turn.cross(place(row) - centre);
            for k in (0..3).filter(|&k| !held[k] && lost.is_finite()) {
                bend[row][k] -= S::from_f64(lost[k]);
            }
        }
    }

    /// Coefficients of the second, third and fourth power of the fraction taken, which the bend of a body adds to its
    /// potential; `damped` is the damping matrix times the bend.
    fn bent(&self, body: &BodyStep, damped: &[[S; 4]]) -> [f64; 3] {
        let weights = &body.weights;
        let mut sums = [0.0; 3];
        for row in body.rows.clone() {
            let m = self.node.mass[row].to_f64();
            let whole = m * (weights.inertia + weights.mass_damping);
            for k in 0..3 {
                let (d, e) = (self.direction[row][k].to_f64(), self.bend[row][k].to_f64());
                let past_inertial = (self.increment[row][k] - self.inertial[row][k]).to_f64();
                let past_offset = (self.increment[row][k] - self.offset[row][k]).to_f64();
                let mut force = weights.rate * self.damped[row][k].to_f64();
                force -= self.load[row][k].to_f64();
                if self.node.free(row, k) {
                    force +=
                        m * (weights.inertia * past_inertial + weights.mass_damping * past_offset);
                }
                sums[0] += force * e;
                sums[1] += e * (whole * d + weights.rate * self.damped_direction[row][k].to_f64());
                let damped = damped.get(row).map_or(0.0, |own| own[k].to_f64());
                sums[2] += 0.5 * e * (whole * e + weights.rate * damped);
            }
        }
        sums
    }

    /// Product of the damping matrix and the direction, zero without one.
    pub(super) fn multiply_damping_by_direction(&mut self, world: &World) {
        let Self { damping, product, direction, damped_direction, .. } = self;
        damped_direction.clear();
        damped_direction.resize(direction.len(), [S::ZERO; 4]);
        if !damping.diagonal.is_empty() {
            let (topology, workers) = (world.resource(), world.resource());
            damping.multiply(topology, workers, product, direction, damped_direction);
        }
    }

    /// Trial displacements of a body at a fraction of its Newton step.
    pub(super) fn set_trial(&mut self, body: &BodyStep, fraction: f64) {
        let fraction = S::from_f64(fraction);
        for row in body.rows.clone() {
            for k in 0..3 {
                // the same sum as in `advance`
                if self.node.free(row, k) {
                    let increment = self.increment[row][k] + self.step_of(row, k, fraction);
                    self.trial[row][k] = self.node.u[row][k] + increment;
                }
            }
        }
    }

    /// The search of a body, with the full step to be tried first.
    fn line_search(&self, index: usize, body: &BodyStep) -> LineSearch {
        let weights = &body.weights;
        let (mut linear, mut quadratic, mut slope) = (0.0, 0.0, 0.0);
        // what the elastic forces do along the rounding of displacements, which their energy need not show
        let (mut scale, mut blur) = (body.elastic.abs(), 0.0);
        for row in body.rows.clone() {
            let m = self.node.mass[row].to_f64();
            let direction = &self.direction[row];
            for k in 0..3 {
                let d = direction[k].to_f64();
                let past_inertial = (self.increment[row][k] - self.inertial[row][k]).to_f64();
                if self.node.free(row, k) {
                    let past_offset = (self.increment[row][k] - self.offset[row][k]).to_f64();
                    linear += m
                        * d
                        * (weights.inertia * past_inertial + weights.mass_damping * past_offset);
                    quadratic += m * d * d * (weights.inertia + weights.mass_damping);
                    scale += 0.5 * m * weights.inertia * past_inertial * past_inertial;
                }
                blur += (self.force[row][k] * self.iterate[row][k]).to_f64().abs();
                linear -= self.load[row][k].to_f64() * d;
                linear += weights.rate * self.damped[row][k].to_f64() * d;
            }
            slope -= dot3(&self.residual[row], direction);
            quadratic += weights.rate * dot3(&self.damped_direction[row], direction);
        }
        // Near its end Newton converges quadratically while differences of energy drown in rounding
        // (more so for pooled springs, whose terms cancel): such steps are taken as they are. The safe
        // step always tests, its bound rests on it.
        let least = noise::<S>().max(UNRESOLVED) * scale;
        let resolved = body.mode != StepMode::Converge || -slope > least;
        let rounding = noise::<S>() * scale + S::EPSILON.to_f64() * blur;
        LineSearch {
            body: index,
            linear,
            quadratic,
            bent: [0.0; 3],
            slope,
            rounding,
            least,
            contact: 0.0,
            touched: false,
            resolved,
            fraction: 1.0,
            accepted: false,
            by_pieces: None,
        }
    }
}
