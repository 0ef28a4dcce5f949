//! Contact in implicit steps: an inner loop that solves it to the end while the elastic energy is linearised once.
//! One solve with the contact at the start of a step is not enough: a tool that moves a few edges in a step would be
//! met by forces several times too high.
//!
//! With the quadratic model `m(d) = -r.d + d.A d / 2` of everything else, `m(d) + psi(d)` is minimised, `psi` being the
//! potential of the contacts: every round takes their forces and tangents at the last iterate, with the limits of
//! friction there, and steps are halved until that sum decreases with these limits. Line search and energy cap then use
//! the true potential with the last limits. Since `psi` at the start of the step, with all tools where they end, is in
//! the budget, kinetic plus potential plus contact energy never rise while tools rest: with the elastic slip `e` kept
//! from the last step, the capped potential of friction is at most that of the spring, `A k e^2 / 2`, whatever its
//! limit, so that the budget of a step is at most the energy at the end of the last one.

use super::newton::{BookSolve, system_matrix};
use super::step::{
    BodyStep, FreePiece, ImplicitScratch, Rejected, Step, StepMode, TouchScratch, noise,
};
use crate::cg::CgStatus;
use crate::state::{Rows, dot3, position, vector};
use glam::{DMat3, DVec3};
use sinew_contact::limits::Limits;
use sinew_contact::set::{ContactSet, RowPlaces};
use sinew_engine::row::VertexRow;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::StepError;
use std::ops::Range;

/// Most rounds of the inner loop, in steps that are linearised once and in those that are iterated. Contact that is found at all
/// takes up to 17 in the shipped scenes. With a cap below that, rounding decides which steps find it, and a second-order step
/// that does not is made again in first order.
const MOST_ROUNDS: [usize; 2] = [24, 8];
/// Largest relative difference of contact forces from their linearisation with which contact counts as found, and over the
/// tolerance of linear solves that with which the loop ends where its rounds allow: whoever asks for more gets more.
const ENOUGH: f64 = 1e-3;
/// The same where bodies touch each other. What is left does not add up from step to step: at rest each begins with the forces
/// of the last.
const ENOUGH_BETWEEN: f64 = 1e-2;
const OF_LINEAR: f64 = 10.0;
/// Reduction of a residual that is enough for a round: the next one has other contacts.
const LOOSE: f64 = 0.03;
/// Times what is enough, below which the round to come is expected to find contact. Its solve goes to the end at once: one that
/// begins anew has to find again what the last one knew of the matrix.
const NEARLY: f64 = 10.0;
/// Newton iterations after which the limits of friction are approached, not taken.
const APPROACH: u32 = 4;
/// Most corrections of the momentum of a piece.
const MOST_BALANCES: u32 = 10;
/// Slope of the energy at the end of a round over that at its start above which less of the round is better.
const STEEP: f64 = 0.3;
/// Slope over that at the start that counts as flat.
const FLAT: f64 = 0.1;
/// Ratio of slopes from which two are of different size.
const UNLIKE: f64 = 10.0;
/// Most trials to find where it is flat.
const MOST_TRIALS: u32 = 8;
/// Most halvings of a round.
const MAX_HALVINGS: u32 = 20;
/// Depth over the mean edge to which points come in one step, from outside, above which the step is an impact:
/// second order means nothing then.
const IMPACT: f64 = 0.25;
/// Most rounds of multipliers, and their relative change that counts as none.
const MOST_MULTIPLIER_ROUNDS: u32 = 40;
const SAME_MULTIPLIERS: f64 = 1e-10;

/// Which displacements contact is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    /// Those of the iterate.
    Iterate,
    /// Those that are tried.
    Trial,
}

impl<S: Scalar> Step<'_, S> {
    /// Energy (J) of the contacts of a body; 0 where it cannot be touched.
    pub fn contact_energy(&mut self, index: usize, at: At, limits: Limits) -> f64 {
        let body = &self.bodies[index];
        let Some(contact) = self.contact.as_mut().filter(|_| body.touched) else { return 0.0 };
        let scratch = &*self.scratch;
        let u = match at {
            At::Iterate => &scratch.iterate,
            At::Trial => &scratch.trial,
        };
        evaluate(contact, &body.bodies, scratch, u, limits)
    }

    /// Energy (J) of the contacts of a body at the start of the step, held vertices moved, tools at the end of their
    /// ways, with the last limits of friction.
    pub fn contact_energy_at_start(&mut self, index: usize) -> f64 {
        if !self.bodies[index].touched {
            return 0.0;
        }
        self.try_at(index, S::ZERO);
        // energies and reports of dampers go by the mean velocities of the whole step, whatever its stages
        let bodies = self.bodies[index].bodies.clone();
        if let Some(contact) = &mut self.contact {
            contact.set_dampers(&bodies, self.dt, &|_| DVec3::ZERO);
        }
        self.contact_energy(index, At::Trial, Limits::Keep)
    }

    /// Trial displacements of a body `ahead` (s) of the start of the step, by the velocities there.
    fn try_at(&mut self, index: usize, ahead: S) {
        let scratch = &mut *self.scratch;
        scratch.trial.resize(scratch.node.len(), [S::ZERO; 4]);
        for row in self.bodies[index].rows.clone() {
            for k in 0..3 {
                scratch.trial[row][k] = if scratch.node.free(row, k) {
                    scratch.node.u[row][k] + ahead * scratch.node.v[row][k]
                } else {
                    scratch.prescribed[row][k]
                };
            }
        }
    }

    /// Whether inertia alone would carry points of a body deep into what they do not touch yet.
    pub fn is_impact(&mut self, index: usize) -> bool {
        if !self.bodies[index].touched {
            return false;
        }
        self.try_at(index, S::from_f64(self.dt));
        self.contact_energy(index, At::Trial, Limits::Take);
        let bodies = &self.bodies[index].bodies;
        self.contact.as_ref().is_some_and(|contact| contact.impact(bodies) > IMPACT)
    }

    /// Puts tools where they are when `part` of the step has passed.
    pub fn tools_at(&mut self, part: f64) {
        if let Some(contact) = &mut self.contact {
            contact.set_part(part);
        }
    }

    /// Dampers of pulls on a body meet the velocities of its stage, `(d - o) / H`.
    pub fn set_dampers(&mut self, index: usize) {
        let (body, offset) = (&self.bodies[index], &self.scratch.offset);
        if let Some(contact) = self.contact.as_mut().filter(|_| body.touched) {
            let offset = |row: VertexRow| vector(&offset[row.index()]);
            contact.set_dampers(&body.bodies, 1.0 / body.weights.rate, &offset);
        }
    }

    /// Adds contact forces at the start of the step, tools and hands being there, to a field.
    pub fn add_contact_forces(&mut self, index: usize, force: &mut Rows<S>) {
        let (body, v) = (&self.bodies[index], &self.scratch.node.v);
        if let Some(contact) = self.contact.as_mut().filter(|_| body.touched) {
            contact.set_dampers(&body.bodies, 1.0, &|row| -vector(&v[row.index()]));
        }
        self.contact_energy(index, At::Trial, Limits::Take);
        if let Some(contact) = self.contact.as_ref().filter(|_| self.bodies[index].touched) {
            contact.for_forces(&self.bodies[index].bodies, |row, f| add(&mut force[row], f));
        }
    }

    /// Moves the multipliers of exact contact; whether there is another round to be made.
    pub fn next_multipliers(&mut self, round: u32) -> bool {
        if !self.contact.as_ref().is_some_and(ContactSet::is_exact) {
            return false;
        }
        for index in 0..self.bodies.len() {
            self.contact_energy(index, At::Iterate, Limits::Keep);
        }
        let Some(contact) = &mut self.contact else { return false };
        if contact.update_multipliers() < SAME_MULTIPLIERS {
            return false;
        }
        if round >= MOST_MULTIPLIER_ROUNDS {
            contact.count(0, true);
            return false;
        }
        for body in self.bodies.iter_mut().filter(|body| body.touched) {
            body.reopen();
        }
        true
    }

    /// Solves for the step of a body that may be touched, with the tangent last evaluated; false when the matrix is
    /// not positive definite or gives no descent.
    pub fn solve_touched(&mut self, index: usize, warm_start: bool) -> Result<bool, StepError> {
        let mut contact = self.contact.take().expect("the body is touched");
        let mut outcome = self.inner_loop(&mut contact, index, warm_start);
        if warm_start && matches!(outcome, Ok(Some(false))) {
            outcome = self.inner_loop(&mut contact, index, false);
        }
        if matches!(outcome, Ok(Some(_))) {
            self.balance_touched(&mut contact, index);
        }
        self.contact = Some(contact);
        Ok(outcome?.unwrap_or(false))
    }

    /// The forces out of balance with those of contact, by the inverse diagonal blocks, as the direction of a body.
    pub fn precondition_touched(&mut self, index: usize) {
        let Some(contact) = &mut self.contact else { return };
        let (body, scratch) = (&self.bodies[index], &mut *self.scratch);
        let (rows, bodies) = (body.rows.clone(), &body.bodies);
        evaluate(contact, bodies, scratch, &scratch.iterate, Limits::Keep);
        let blocks = contact.blocks(bodies);
        let ImplicitScratch { touch, residual, node, damping, direction, .. } = scratch;
        touch.left[rows.clone()].copy_from_slice(&residual[rows.clone()]);
        contact.for_forces(bodies, |row, f| {
            for k in node.free_axes(row) {
                touch.left[row][k] += S::from_f64(f[k]);
            }
        });
        let mut system = system_matrix(self.world, &body.weights, node, damping);
        system.contact = Some(&blocks);
        let left = &touch.left[rows.clone()];
        system.preconditioned(bodies.clone(), left, &mut direction[rows]);
    }

    /// Energy (J) below which changes of that of the contacts of a body are rounding, at the last evaluation.
    pub fn contact_rounding(&self, index: usize) -> f64 {
        let body = &self.bodies[index];
        let contact = self.contact.as_ref().filter(|_| body.touched);
        contact.map_or(0.0, |contact| rounding(contact, &body.bodies, self.scratch))
    }

    /// Rounds of the inner loop; whether model plus contact energy decrease, up to rounding; `None` when the matrix is
    /// not positive definite.
    fn inner_loop(
        &mut self,
        contact: &mut ContactSet,
        index: usize,
        warm_start: bool,
    ) -> Result<Option<bool>, StepError> {
        let body = self.bodies[index].clone();
        let (rows, bodies) = (body.rows.clone(), body.bodies.clone());
        let iterated = body.mode == StepMode::Converge;
        // start of the loop
        if warm_start {
            self.scratch.warm_start(&body);
        } else {
            self.scratch.direction[rows.clone()].fill([S::ZERO; 4]);
        }
        // friction of bodies on each other has several outcomes, among which it would choose
        let mut seeds = self.scratch.seeds(&body, warm_start && !contact.joins(&bodies));
        let n = self.scratch.node.len();
        let touch = &mut self.scratch.touch;
        for field in [
            &mut touch.product,
            &mut touch.round_product,
            &mut touch.left,
            &mut touch.expected,
            &mut touch.round,
        ] {
            field.resize(n, [S::ZERO; 4]);
        }
        // the first round is expected to leave nothing, whatever the last loop left
        touch.expected[rows.clone()].fill([S::ZERO; 4]);
        self.multiply_direction(&body);
        let mut options = self.settings.linear_options();
        // whether the last round was taken whole: only then is what is left that of its linear solve
        let (mut whole, mut solved, mut residual) = (false, false, 0.0);
        let (mut before, mut converged, mut rounds) = (f64::INFINITY, false, 0);
        let of_linear = OF_LINEAR * self.settings.linear_tolerance;
        // converged steps linearise anew; the tangents leave out how normals turn, so contact of bodies is found digit by digit
        let found = if contact.joins(&bodies) && !iterated { ENOUGH_BETWEEN } else { ENOUGH };
        let enough = if iterated { found } else { found.min(of_linear) };
        let digits = (found / enough).log10();
        let most = MOST_ROUNDS[usize::from(iterated)] * (1 + digits.ceil() as usize);
        for round in 0..most {
            // contact at the last iterate: is it settled?
            self.scratch.try_direction(&body, S::ZERO);
            let limits = match self.report.newton_iterations {
                n if round == 0 && (n == 0 || !iterated) => Limits::Recall,
                APPROACH.. if iterated => Limits::Approach,
                _ => Limits::Follow,
            };
            let energy = evaluate(contact, &bodies, self.scratch, &self.scratch.trial, limits);
            let force = contact.force_sum(&bodies);
            if round == 0 && !iterated {
                contact.keep_touching(&bodies);
            }
            let off = self.scratch.find_left(contact, &body);
            let settled = off <= enough * force || force == 0.0 && before == 0.0;
            if round > 0 && (whole || iterated) && solved {
                // rounds that follow lower the energy further, found or not
                converged |= settled || off <= found * force;
                if settled {
                    break;
                }
            }
            before = force;
            rounds += 1;
            // converged steps linearise anew anyway
            let nearly = !iterated && off <= NEARLY * enough * force;
            // late in the loop every round that lowers the energy is taken whole: only then may the loop end
            let seek = round < most / 2;
            let last = nearly || settled || round + 1 == most;
            options.own_tolerance = if last { 0.0 } else { LOOSE };
            // converged steps linearise anew, and end sooner with the tangents alone
            if !iterated {
                let now = position(&self.scratch.rest, &self.scratch.trial);
                contact.learn(&bodies, &now, round == 0);
            }
            // linear solve for the step of the round
            let blocks = contact.blocks(&bodies);
            let ImplicitScratch { linear, rest, node, damping, touch, .. } = &mut *self.scratch;
            touch.round[rows.clone()].fill([S::ZERO; 4]);
            let mut system = system_matrix(self.world, &body.weights, node, damping);
            system.contact = Some(&blocks);
            let (b, x) = (&touch.left[rows.clone()], &mut touch.round[rows.clone()]);
            let seeds = std::mem::take(&mut seeds);
            let outcome =
                linear.solve_along(&system, rest, bodies.clone(), b, (x, &seeds), &options);
            options.reference = options.reference.max(outcome.reference);
            options.same_matrix = true;
            solved = outcome.residual <= self.settings.linear_tolerance;
            self.report.book(&outcome);
            match outcome.status {
                CgStatus::NotFinite => return Err(self.not_finite_residual()),
                CgStatus::Indefinite => return Ok(None),
                CgStatus::Cap => self.report.cg_caps += 1,
                CgStatus::Converged => {}
            }
            residual = outcome.residual;
            // shorten the step; its products with and without contact
            let ImplicitScratch { node, damping, touch, linear, .. } = &mut *self.scratch;
            let mut system = system_matrix(self.world, &body.weights, node, damping);
            system.contact = Some(&blocks);
            let TouchScratch { left, round, expected, round_product, .. } = touch;
            let (b, x) = (&left[rows.clone()], &round[rows.clone()]);
            let (both, own) = (&mut expected[rows.clone()], &mut round_product[rows.clone()]);
            linear.multiply_solution(&system, bodies.clone(), b, x, both);
            own.copy_from_slice(both);
            system.add_contact_product(bodies.clone(), -1.0, x, own);
            let Some(t) = self.scratch.shorten(contact, &body, energy, seek) else { break };
            whole = t == 1.0;
            self.scratch.take_round(&body, t);
        }
        self.report.cg_residual = self.report.cg_residual.max(residual);
        if body.mode == StepMode::Trial && !converged {
            // a force that is not found must not count: the safe step is tried instead
            contact.count(rounds, false);
            self.bodies[index].reject(Rejected::Shortened);
            return Ok(Some(true));
        }
        // iterated steps go on: whether contact is found shows when they end
        contact.count(rounds, !converged && !iterated);
        // of the whole step, with the last limits
        let [change, scale] = self.scratch.model(&body);
        self.scratch.try_direction(&body, S::ZERO);
        // limits of the end, also where the last round was cut off: friction then is that of the pressure
        let limits = if iterated { Limits::Keep } else { Limits::Take };
        let energy = evaluate(contact, &bodies, self.scratch, &self.scratch.trial, limits);
        let blur = rounding(contact, &bodies, self.scratch);
        let start = evaluate(contact, &bodies, self.scratch, &self.scratch.iterate, Limits::Keep);
        let rounding = noise::<S>() * (scale + energy + start) + blur;
        Ok(Some(change + energy - start <= rounding))
    }

    /// `A d` of the direction.
    fn multiply_direction(&mut self, body: &BodyStep) {
        let ImplicitScratch { node, damping, touch, linear, direction, .. } = &mut *self.scratch;
        let system = system_matrix(self.world, &body.weights, node, damping);
        let rows = body.rows.clone();
        let (x, y) = (&direction[rows.clone()], &mut touch.product[rows]);
        linear.multiply(&system, body.bodies.clone(), x, y);
    }

    /// Shifts the pieces of a body without held unknowns so that their momentum is balanced with the contact forces
    /// that they end with: a loose solve leaves a resultant, which would push them about.
    fn balance_touched(&mut self, contact: &mut ContactSet, index: usize) {
        let body = self.bodies[index].clone();
        if body.weights.inertia <= 0.0 {
            return;
        }
        let factor = body.weights.inertia + body.weights.mass_damping;
        let mut pieces = body.free_pieces.clone();
        if pieces.len() > 1 && contact.ties(&body.bodies) {
            // what acts between them moves none of them all together
            let rows = pieces.iter().flat_map(|piece| match piece {
                FreePiece::Whole => Vec::new(),
                FreePiece::Rows(rows) => rows.clone(),
            });
            let mut rows: Vec<u32> = rows.collect();
            rows.sort_unstable();
            pieces.push(FreePiece::Rows(rows));
        }
        for piece in &pieces {
            let rows: Vec<usize> = match piece {
                FreePiece::Whole => body.rows.clone().collect(),
                FreePiece::Rows(rows) => rows.iter().map(|&row| row as usize).collect(),
            };
            let inside = |row: VertexRow| rows.binary_search(&row.index()).is_ok();
            let node = &self.scratch.node;
            let mass: f64 = rows.iter().map(|&row| factor * node.mass[row].to_f64()).sum();
            for _ in 0..MOST_BALANCES {
                self.scratch.try_direction(&body, S::ZERO);
                evaluate(contact, &body.bodies, self.scratch, &self.scratch.trial, Limits::Keep);
                let (force, block) = contact.resistance(&body.bodies, &inside);
                let scratch = &mut *self.scratch;
                let (mut missing, mut scale) = (force, 0.0);
                for &row in &rows {
                    let m = factor * scratch.node.mass[row].to_f64();
                    for k in 0..3 {
                        let inertia = m * scratch.direction[row][k].to_f64();
                        missing[k] += scratch.residual[row][k].to_f64() - inertia;
                        scale += inertia.abs();
                    }
                }
                if missing.length() <= 1e-13 * scale || !missing.is_finite() {
                    break;
                }
                let shift = (DMat3::from_diagonal(DVec3::splat(mass)) + block).inverse() * missing;
                for &row in &rows {
                    add(&mut scratch.direction[row], shift);
                }
            }
        }
    }
}

/// Model plus contact energy along the step of a round.
struct RoundWay {
    linear: f64,
    quadratic: f64,
    /// Energy (J) of contact at its start, and below which changes are rounding.
    energy: f64,
    blur: f64,
}

/// What they are at a part of it.
#[derive(Clone, Copy)]
struct AtPart {
    part: f64,
    /// Change (J) since its start.
    change: f64,
    /// It is not above 0, up to rounding (J).
    lowers: bool,
    rounding: f64,
    /// Derivative (J) by the part.
    slope: f64,
}

/// The part of a round to be taken whose energy begins with a slope and ends rising: all of it if it ends nearly flat, else the
/// lowest found on the way to where it is flat. That is looked for by regula falsi in which an end that stays twice counts half
/// (Illinois), and by halves while slopes are of different size: stiff contact sets in.
fn lowest(start: f64, end: AtPart, mut at: impl FnMut(f64) -> AtPart) -> Option<f64> {
    let is_flat = end.slope <= STEEP * -start || -start <= end.rounding;
    if end.lowers && is_flat || !(start < 0.0 && end.slope.is_finite()) {
        return end.lowers.then_some(1.0);
    }
    let mut best = end;
    let (mut low, mut high, mut stays) = ((0.0, start), (1.0, end.slope), 0);
    for _ in 0..MOST_TRIALS {
        let own = at(match high.1 > UNLIKE * -low.1 {
            true => 0.5 * (low.0 + high.0),
            false => (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1),
        });
        if !own.slope.is_finite() {
            break;
        }
        if own.change < best.change || !best.lowers {
            best = own;
        }
        if own.slope.abs() <= FLAT * -start {
            break;
        }
        let side = if own.slope < 0.0 { -1 } else { 1 };
        let half = if stays == side { 0.5 } else { 1.0 };
        match side {
            -1 => (low, high.1) = ((own.part, own.slope), half * high.1),
            _ => (high, low.1) = ((own.part, own.slope), half * low.1),
        }
        stays = side;
    }
    best.lowers.then_some(best.part)
}

impl RoundWay {
    fn at<S: Scalar>(
        &self,
        part: f64,
        scratch: &mut ImplicitScratch<S>,
        contact: &mut ContactSet,
        body: &BodyStep,
    ) -> AtPart {
        scratch.try_direction(body, S::from_f64(part));
        let now = evaluate(contact, &body.bodies, scratch, &scratch.trial, Limits::Keep);
        let Self { linear, quadratic, energy, blur } = *self;
        let change = part * linear + 0.5 * part * part * quadratic + (now - energy);
        let rounding = 1e-12 * (energy.abs() + now.abs() + (part * linear).abs()) + blur;
        let mut slope = linear + part * quadratic;
        contact.for_forces(&body.bodies, |row, f| {
            let step = &scratch.touch.round[row];
            slope -= scratch.node.free_axes(row).map(|k| f[k] * step[k].to_f64()).sum::<f64>();
        });
        AtPart { part, change, lowers: change <= rounding, rounding, slope }
    }

    /// The first of 1, a half, a quarter and so on that lowers them.
    fn halved<S: Scalar>(
        &self,
        scratch: &mut ImplicitScratch<S>,
        contact: &mut ContactSet,
        body: &BodyStep,
    ) -> Option<f64> {
        let mut parts = (0..MAX_HALVINGS as i32).map(|n| 0.5_f64.powi(n));
        parts.find(|part| self.at(*part, scratch, contact, body).lowers)
    }
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Trial displacements of a body: iterate plus direction plus a part of the round's step.
    fn try_direction(&mut self, body: &BodyStep, part: S) {
        self.trial.resize(self.node.len(), [S::ZERO; 4]);
        for row in body.rows.clone() {
            for k in 0..3 {
                self.trial[row][k] = if self.node.free(row, k) {
                    let step = self.direction[row][k] + part * self.touch.round[row][k];
                    self.node.u[row][k] + (self.increment[row][k] + step)
                } else {
                    self.iterate[row][k]
                };
            }
        }
    }

    /// Finds the unbalanced forces at the direction, contact included. Returns their difference (N, sum of magnitudes)
    /// from the forces that the last round expected.
    fn find_left(&mut self, contact: &ContactSet, body: &BodyStep) -> f64 {
        for row in body.rows.clone() {
            for k in 0..3 {
                self.touch.left[row][k] = self.residual[row][k] - self.touch.product[row][k];
            }
        }
        contact.for_forces(&body.bodies, |row, f| {
            for k in self.node.free_axes(row) {
                self.touch.left[row][k] += S::from_f64(f[k]);
            }
        });
        let off = |row: usize| {
            (0..3)
                .map(|k| (self.touch.left[row][k] - self.touch.expected[row][k]).to_f64().abs())
                .sum::<f64>()
        };
        body.rows.clone().map(off).sum()
    }

    /// Change of the quadratic model along the direction (J), and the sum of the energies in it.
    fn model(&self, body: &BodyStep) -> [f64; 2] {
        let (mut change, mut scale) = (0.0, 0.0);
        for row in body.rows.clone() {
            let d = &self.direction[row];
            let (curve, slope) =
                (0.5 * dot3(d, &self.touch.product[row]), dot3(d, &self.residual[row]));
            change += curve - slope;
            scale += curve.abs() + slope.abs();
        }
        [change, scale]
    }

    /// Part of the round's step that lowers model plus contact energy, with the limits that the round began with; `None` where
    /// none does. With `seek` it is that where this is flat, if it rises steeply at the end: contact has set in or given way before.
    fn shorten(
        &mut self,
        contact: &mut ContactSet,
        body: &BodyStep,
        energy: f64,
        seek: bool,
    ) -> Option<f64> {
        let (mut linear, mut quadratic) = (0.0, 0.0);
        let blur = rounding(contact, &body.bodies, self);
        for row in body.rows.clone() {
            let (d, ad) = (&self.touch.round[row], &self.touch.round_product[row]);
            linear += dot3(d, &self.touch.product[row]) - dot3(d, &self.residual[row]);
            quadratic += dot3(d, ad);
        }
        let way = RoundWay { linear, quadratic, energy, blur };
        let end = way.at(1.0, self, contact, body);
        if end.slope > 0.0 && seek {
            let start = way.at(0.0, self, contact, body).slope;
            let trial = |part| way.at(part, self, contact, body);
            return lowest(start, end, trial).or_else(|| way.halved(self, contact, body));
        }
        if end.lowers { Some(1.0) } else { way.halved(self, contact, body) }
    }

    /// Adds a part of the round's step to the direction, and notes what would be left if contact were linear.
    fn take_round(&mut self, body: &BodyStep, part: f64) {
        let t = S::from_f64(part);
        for row in body.rows.clone() {
            for k in 0..3 {
                let touch = &mut self.touch;
                self.direction[row][k] += t * touch.round[row][k];
                touch.product[row][k] += t * touch.round_product[row][k];
                touch.expected[row][k] = touch.left[row][k] - t * touch.expected[row][k];
            }
        }
    }
}

fn evaluate<S: Scalar>(
    contact: &mut ContactSet,
    bodies: &Range<usize>,
    scratch: &ImplicitScratch<S>,
    u: &[[S; 4]],
    limits: Limits,
) -> f64 {
    let now = position(&scratch.rest, u);
    let start = position(&scratch.rest, &scratch.node.u);
    contact.evaluate(bodies, &RowPlaces { now: &now, start: &start }, limits)
}

/// Energy (J) that rounding of places gives and takes from contacts at the last evaluation: what their forces do along
/// it. Contact energies of stiff bodies are too small to tell it by.
fn rounding<S: Scalar>(
    contact: &ContactSet,
    bodies: &Range<usize>,
    scratch: &ImplicitScratch<S>,
) -> f64 {
    let ImplicitScratch { rest, node, .. } = scratch;
    contact.rounding(bodies, &|row| {
        let (rest, u) = (rest[row.index()], vector(&node.u[row.index()]));
        f64::EPSILON * rest.abs().max_element() + S::EPSILON.to_f64() * u.abs().max_element()
    })
}

fn add<S: Scalar>(row: &mut [S; 4], f: DVec3) {
    for k in 0..3 {
        row[k] += S::from_f64(f[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `lowest` takes of an energy by its value and derivative, and how often it asked.
    fn taken(energy: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64) -> (Option<f64>, u32) {
        let mut asked = 0;
        let at = |part: f64| {
            let change = energy(part) - energy(0.0);
            AtPart { part, change, lowers: change <= 1e-15, rounding: 1e-15, slope: slope(part) }
        };
        let found = lowest(slope(0.0), at(1.0), |part| {
            assert!(part > 0.0 && part < 1.0, "{part}");
            asked += 1;
            at(part)
        });
        (found, asked)
    }

    #[test]
    fn a_round_ends_where_its_energy_is_lowest() {
        // nearly flat at the end, and rounding alone
        assert_eq!(taken(|t| 0.5 * t * t - 0.9 * t, |t| t - 0.9), (Some(1.0), 0));
        assert_eq!(taken(|t| 1e-16 * t * (t - 0.5), |t| 1e-16 * (2.0 * t - 0.5)), (Some(1.0), 0));
        // a parabola in one trial, whether its end lies lower or not
        for lowest in [0.2, 0.6] {
            let (part, asked) = taken(|t| (t - lowest).powi(2), |t| 2.0 * (t - lowest));
            assert!((part.unwrap() - lowest).abs() < 1e-12 && asked == 1);
        }
        // a spring that sets in at a tenth, and a kink at a third, which is flat nowhere
        for stiffness in [10.0, 100.0, 1000.0] {
            let sets_in = |t: f64| -t + 0.5 * stiffness * (t - 0.1).max(0.0).powi(2);
            let (part, asked) = taken(sets_in, |t| -1.0 + stiffness * (t - 0.1).max(0.0));
            let right = sets_in(0.1 + 1.0 / stiffness);
            assert!(sets_in(part.unwrap()) < 0.9 * right && asked <= MOST_TRIALS, "{part:?}");
        }
        let kink = |t: f64| (t - 1.0 / 3.0).abs();
        let (part, _) = taken(kink, |t| if t < 1.0 / 3.0 { -1.0 } else { 1.0 });
        assert!((part.unwrap() - 1.0 / 3.0).abs() < 0.01, "{part:?}");
    }

    #[test]
    fn a_round_without_a_lowest_place_is_left_to_halvings() {
        // it rises from the start, and its end is beyond numbers
        assert_eq!(taken(|t| t * t, |t| 2.0 * t + 1e-3), (None, 0));
        assert_eq!(taken(|t| -t + t / (1.0 - t), |t| -1.0 + 1.0 / (1.0 - t).powi(2)), (None, 0));
        // not a number on the way
        let broken = |t: f64| if t > 0.0 && t < 1.0 { f64::NAN } else { 2.0 * t - 1.0 };
        assert_eq!(taken(|t| t * t - 0.5 * t, broken), (None, 1));
    }
}
