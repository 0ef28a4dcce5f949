//! The data of one implicit step: the world, the work space, and the state of each body.

use crate::history::{Past, StepHistory};
use crate::linear_solver::LinearSolver;
use crate::orphan::{Orphan, prescribe_orphans};
use crate::recovery::Recovery;
use crate::settings::SolverSettings;
use crate::sleep::{CALM, Sleep};
use crate::state::{NodeState, Rows};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::set::ContactSet;
use sinew_engine::law::LawBuffers;
use sinew_engine::load::SweptVolumes;
use sinew_engine::matrix::{BlockMatrix, ProductSpans};
use sinew_engine::report::{StepReport, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::substep::WithinStep;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::FixedAxes;
use std::ops::Range;

/// One step of all bodies of a world.
pub(super) struct Step<'w, S: Scalar> {
    pub world: &'w mut World,
    pub settings: &'w SolverSettings,
    pub report: &'w mut StepReport,
    pub scratch: &'w mut ImplicitScratch<S>,
    /// Bodies that are solved alone, and groups of those that may touch each other.
    pub bodies: Vec<BodyStep>,
    /// Tools, contact and pulls, in a world that has any.
    pub contact: Option<ContactSet>,
    /// Energy (J) stored in contacts at the end of the last step.
    pub contact_before: f64,
    pub orphans: Vec<Orphan<S>>,
    /// Bodies that sleep, and their parts in the last step.
    pub asleep: Vec<(usize, Past)>,
    /// The elastic energies at the end of the last step still hold.
    pub energies_hold: bool,
    /// Length of the step (s).
    pub dt: f64,
}

/// Work space of the implicit integrators, and what they remember of the last step.
#[derive(Resource, Debug, Default)]
pub struct ImplicitScratch<S: Scalar> {
    /// The columns at the start of the step.
    pub(super) node: NodeState<S>,
    /// Displacement since the start of the step (m): the unknown. Velocities come from it alone, so
    /// a large displacement from rest costs no digits of them.
    pub(super) increment: Rows<S>,
    /// Increment for which the velocity is zero (m), `o` in the module documentation.
    pub(super) offset: Rows<S>,
    /// Increment that inertia alone would make (m), `d_inertia`.
    pub(super) inertial: Rows<S>,
    /// Displacements (m) of held unknowns at the end of the stage.
    pub(super) prescribed: Rows<S>,
    /// Forces (N) beside the elastic ones.
    pub(super) load: Rows<S>,
    /// Displacements (m) at the current iterate.
    pub(super) iterate: Rows<S>,
    /// Displacements (m) that the line search tries.
    pub(super) trial: Rows<S>,
    /// Elastic forces (N) at the iterate.
    pub(super) force: Rows<S>,
    /// `-dP/dd` (N), zero on held unknowns.
    pub(super) residual: Rows<S>,
    /// Newton step (m).
    pub(super) direction: Rows<S>,
    /// Correction of the step for the predicted volumes, taken with the square of the fraction (m); empty without
    /// low-rank tangents.
    pub(super) bend: Rows<S>,
    /// Velocities (m/s) at the end of the stage.
    pub(super) velocity: Rows<S>,
    /// `beta K_gn + C_d` (N s/m); empty without damping.
    pub(super) damping: BlockMatrix<S>,
    /// `increment - offset`, when it is needed as one.
    pub(super) past_offset: Rows<S>,
    /// Damping matrix times `increment - offset`, and times the direction.
    pub(super) damped: Rows<S>,
    pub(super) damped_direction: Rows<S>,
    pub(super) product: ProductSpans<S>,
    pub(crate) linear: LinearSolver<S>,
    pub(crate) history: StepHistory<S>,
    pub(crate) recovery: Recovery,
    pub(super) sleep: Sleep<S>,
    pub(super) within: WithinStep,
    /// Predicted values of the low-rank vectors, body by body, for the bodies that have taken this step.
    pub(super) predicted: Vec<Vec<f64>>,
    /// Rest positions (m), read once per topology.
    pub(crate) rest: Vec<DVec3>,
    pub(super) touch: TouchScratch<S>,
    pub(super) revision: u64,
    /// Held axes that are known to support every body.
    pub(super) supported: Option<Vec<FixedAxes>>,
}

/// Work space of the inner loop of contact.
#[derive(Clone, Debug, Default)]
pub(super) struct TouchScratch<S> {
    /// `A d` of the step so far, and of the round.
    pub product: Rows<S>,
    pub round_product: Rows<S>,
    /// Unbalanced forces, and those that would be left if contact were linear.
    pub left: Rows<S>,
    pub expected: Rows<S>,
    /// Step of the round.
    pub round: Rows<S>,
}

/// State of a body, or of consecutive bodies that share a solve, during a step.
#[derive(Clone, Debug)]
pub(super) struct BodyStep {
    /// Which bodies.
    pub bodies: Range<usize>,
    /// Something may touch or pull it in this step.
    pub touched: bool,
    pub rows: Range<usize>,
    pub size: f64,
    /// Pieces without held unknowns: their momentum can be balanced exactly.
    pub free_pieces: Vec<FreePiece>,
    /// Elements were inverted when the step began.
    pub inverted: bool,
    pub mode: StepMode,
    pub weights: Weights,
    /// Its part in the last step.
    pub past: Past,
    /// Elastic energy (J) at the current iterate, and at the start of the step.
    pub elastic: f64,
    pub elastic_before: f64,
    /// Kinetic plus potential energy (J) at the start, held vertices moved.
    pub budget: f64,
    /// Energy (J) below which the last line search took changes for rounding.
    pub rounding: f64,
    /// Part of the direction last found that was taken.
    pub taken: f64,
    pub done: bool,
    pub converged: bool,
    /// The direction is a gradient, whose length says nothing of the distance to the minimum.
    pub gradient: bool,
    /// Newton's iteration did not converge in some stage.
    pub missed: bool,
    /// Line searches of Newton's iteration that found no decrease, and solves that gave way to a gradient.
    pub searched: [u32; 2],
    /// Why the step of second order, or the converged one, does not count.
    pub rejected: Option<Rejected>,
}

/// How a body takes its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StepMode {
    /// One solve, line search and energy cap.
    Safe,
    /// One solve a stage, which must pass the tests of linearised BDF2.
    Trial,
    /// Newton to convergence.
    Converge,
}

/// Why a linearised step of second order or a converged one does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rejected {
    Indefinite,
    Shortened,
    Energy,
    Inverted,
    Unconverged,
    /// Not tried: safe steps are due.
    Beforehand,
}

/// Rows of a piece without held unknowns.
#[derive(Clone, Debug)]
pub(super) enum FreePiece {
    /// All rows of the body.
    Whole,
    /// Some of them.
    Rows(Vec<u32>),
}

/// Weights of the incremental potential.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weights {
    /// `1 / H`, 0 for equilibria (1/s).
    pub rate: f64,
    /// Factor of `|d - d_inertia|^2_M / 2` (1/s^2).
    pub inertia: f64,
    /// Factor of `|d - o|^2_M / 2`, mass damping over `H` (1/s^2).
    pub mass_damping: f64,
}

impl Weights {
    /// Of a stage of effective length `h` (s), infinite for equilibria.
    pub fn new(settings: &SolverSettings, h: f64) -> Self {
        let rate = 1.0 / h;
        Self { rate, inertia: rate * rate, mass_damping: settings.mass_damping * rate }
    }
}

/// Relative size below which differences of energies are rounding.
pub(super) fn noise<S: Scalar>() -> f64 {
    450.0 * S::EPSILON.to_f64()
}

/// Largest entry of a field.
pub(super) fn largest_entry<S: Scalar>(x: &[[S; 4]]) -> f64 {
    x.iter().flat_map(|x| x[..3].iter()).fold(0.0, |m, x| m.max(x.to_f64().abs()))
}

impl<'w, S: Scalar> Step<'w, S> {
    /// A step from the columns in `scratch.node`.
    pub fn new(
        world: &'w mut World,
        settings: &'w SolverSettings,
        report: &'w mut StepReport,
        scratch: &'w mut ImplicitScratch<S>,
    ) -> Self {
        let dt = world.resource::<StepClock>().dt;
        scratch.damping.diagonal.clear();
        scratch.predicted.clear();
        scratch.velocity.clear();
        scratch.velocity.resize(scratch.node.len(), [S::ZERO; 4]);
        Self {
            world,
            settings,
            report,
            scratch,
            bodies: Vec::new(),
            contact: None,
            contact_before: 0.0,
            orphans: Vec::new(),
            asleep: Vec::new(),
            energies_hold: false,
            dt,
        }
    }

    /// Whether bodies have inertia.
    pub fn is_dynamic(&self) -> bool {
        self.settings.integrator.facts().dynamic
    }

    /// Makes held unknowns of the vertices without elements, and takes loads and prescribed displacements
    /// at the end of the step.
    pub fn hold_orphans(&mut self) {
        let topology = self.world.resource::<Topology>();
        self.orphans = prescribe_orphans(topology, &mut self.scratch.node, self.dt, self.settings);
        self.scratch.use_end_of_step();
    }

    /// Reads the history of every body, as far as it still holds, and decides which bodies recover from inversion.
    ///
    /// # Errors
    /// When a recovery does not end.
    pub fn recall(&mut self) -> Result<(), StepError> {
        let scratch = &mut *self.scratch;
        scratch.history.follow_cuts(self.world);
        let (unchanged, past) = scratch.history.compare(self.world, &scratch.node, self.dt);
        // the potential of a pressure changes with time
        self.energies_hold = unchanged && !self.world.contains_resource::<SweptVolumes>();
        let topology = self.world.resource::<Topology>();
        let count = topology.bodies.len();
        let groups = match &self.contact {
            Some(contact) => contact.groups(count),
            None => (0..count).map(|body| body..body + 1).collect(),
        };
        let touches = |group: &Range<usize>| {
            self.contact.as_ref().is_some_and(|contact| contact.touches(group))
        };
        let ImplicitScratch { recovery, sleep, node, rest, history, .. } = &mut *scratch;
        let inverted = &self.world.resource::<VolumeReport>().inverted_by_body;
        let may_sleep = self.settings.sleep_speed > 0.0
            && self.settings.integrator.facts().dynamic
            && self.energies_hold
            && !self.world.resource::<LawBuffers<S>>().joins_bodies(topology);
        // what a group of bodies remembers is not that of one of them
        let is_as_it_was = |group: &Range<usize>| {
            let body = group.start;
            may_sleep
                && group.len() == 1
                && !touches(group)
                && past[body].same_hold
                && history.groups.contains(group)
                && history.is_loaded_as_before(&topology.bodies[body], node)
        };
        let as_they_were: Vec<bool> = groups.iter().map(is_as_it_was).collect();
        let rests = |body: &usize| {
            past[*body].body.calm >= CALM
                && inverted.get(*body) == Some(&0)
                && recovery.is_own(*body)
        };
        let alone = groups.iter().zip(&as_they_were).filter(|(_, same)| **same);
        let asleep: Vec<usize> = alone.map(|(group, _)| group.start).filter(rests).collect();
        sleep.begin(self.world, &node.u, (count, &asleep), self.report);
        let on = self.settings.recovery;
        let recovers = recovery.update(self.world, on, node, &past, rest, self.report)?;
        let inverted = &self.world.resource::<VolumeReport>().inverted_by_body;
        let topology = self.world.resource::<Topology>();
        self.energies_hold &= history.groups == groups;
        for (group, as_it_was) in groups.iter().zip(as_they_were) {
            let mut past = Past::of_group(&past[group.clone()], history.groups.contains(group));
            if sleep.contains(group.start) {
                self.asleep.push((group.start, past));
                continue;
            }
            if !as_it_was || past.body.calm >= CALM {
                past.body.calm = 0.0;
            }
            let inverted = group.clone().any(|i| inverted.get(i).is_some_and(|&count| count > 0));
            let touched = touches(group);
            let mut body =
                BodyStep::new(&topology.bodies[group.clone()], &node.fixed, inverted, past);
            (body.bodies, body.touched) = (group.clone(), touched);
            self.bodies.push(body);
        }
        history.groups = groups;
        let recovering = |body: &&mut BodyStep| recovers[body.bodies.clone()].contains(&true);
        for body in self.bodies.iter_mut().filter(recovering) {
            // other energies than those remembered, and safe steps
            body.past = Past::default();
            body.inverted = true;
        }
        Ok(())
    }
}

impl BodyStep {
    fn new(bodies: &[BodyRows], fixed: &[FixedAxes], inverted: bool, past: Past) -> Self {
        let rows = |body: &BodyRows| body.vertices.start as usize..body.vertices.end as usize;
        let free = |body: &BodyRows| match &free_pieces(body, &fixed[rows(body)])[..] {
            // of several bodies none is the whole
            [FreePiece::Whole] if bodies.len() > 1 => {
                vec![FreePiece::Rows(body.vertices.clone().collect())]
            }
            pieces => pieces.to_vec(),
        };
        let (first, last) = (&bodies[0], &bodies[bodies.len() - 1]);
        Self {
            bodies: 0..0,
            touched: false,
            free_pieces: bodies.iter().flat_map(free).collect(),
            rows: rows(first).start..rows(last).end,
            size: bodies.iter().map(|body| body.size).fold(0.0, f64::max),
            inverted,
            mode: StepMode::Safe,
            weights: Weights { rate: 0.0, inertia: 0.0, mass_damping: 0.0 },
            past,
            elastic: 0.0,
            elastic_before: 0.0,
            budget: f64::INFINITY,
            rounding: 0.0,
            taken: 0.0,
            done: false,
            converged: false,
            gradient: false,
            missed: false,
            searched: [0; 2],
            rejected: None,
        }
    }

    /// Sum over its bodies.
    pub fn sum(&self, by_body: &[f64]) -> f64 {
        by_body[self.bodies.clone()].iter().sum()
    }

    /// Uses the projected tangent from the start.
    pub fn projects(&self) -> bool {
        self.mode == StepMode::Safe && self.inverted
    }

    /// Takes BDF2, not the implicit Euler step that starts it or stands in for it.
    pub fn uses_bdf2(&self) -> bool {
        self.past.history_holds && self.mode != StepMode::Safe
    }

    /// Took a trial step that nothing speaks against so far.
    pub fn is_open_trial(&self) -> bool {
        self.mode == StepMode::Trial && self.rejected.is_none()
    }

    /// Gives the step up.
    pub fn reject(&mut self, why: Rejected) {
        (self.done, self.rejected) = (true, Some(why));
    }

    /// Takes another round of Newton's iteration up, unless the step was given up.
    pub fn reopen(&mut self) {
        (self.done, self.converged) = (self.rejected.is_some(), false);
    }
}

/// Pieces of a body without held unknowns; `fixed` belongs to its rows.
fn free_pieces(body: &BodyRows, fixed: &[FixedAxes]) -> Vec<FreePiece> {
    let held = fixed.iter().any(|f| f.0 != 0);
    if body.piece_count() == 1 && !held {
        return vec![FreePiece::Whole];
    }
    let mut pieces = vec![Some(Vec::new()); body.piece_count()];
    let first = body.vertices.start;
    for (row, (&piece, fixed)) in (first..).zip(body.piece.iter().zip(fixed)) {
        // vertices without elements belong to no piece
        let Some(rows) = pieces.get_mut(piece as usize) else { continue };
        match rows {
            Some(rows) if fixed.0 == 0 => rows.push(row),
            rows => *rows = None,
        }
    }
    pieces.into_iter().flatten().map(FreePiece::Rows).collect()
}

impl<S: Scalar> ImplicitScratch<S> {
    /// Forgets what is known of the elements of bodies that sleep.
    pub(crate) fn forget_sleep(&mut self) {
        self.sleep = Sleep::default();
    }

    /// Loads and prescribed displacements as they are at the end of the step.
    pub(super) fn use_end_of_step(&mut self) {
        self.load.clone_from(&self.node.external);
        self.prescribed.clone_from(&self.node.prescribed);
    }

    /// Loads (N) when `part` of the step has passed.
    pub(super) fn use_loads_at(&mut self, part: f64) {
        self.load.clone_from(&self.node.external);
        let mut differences = Vec::new();
        self.within.load_differences(part, &mut differences);
        for (&row, difference) in self.within.loaded.iter().zip(&differences) {
            for k in 0..3 {
                self.load[row.index()][k] += S::from_f64(difference[k]);
            }
        }
    }

    /// Prescribed displacements (m), of those that move, when `part` of the step has passed.
    pub(super) fn use_motions_at(&mut self, part: f64) {
        let mut increments = Vec::new();
        self.within.ways(part, &mut increments);
        for (moving, increment) in self.within.moving.iter().zip(&increments) {
            let (row, k) = (moving.row.index(), moving.axis as usize);
            self.prescribed[row][k] = self.node.u[row][k] + S::from_f64(*increment);
        }
    }

    /// Sets a free unknown to an increment, the displacement with it.
    pub(super) fn set_increment(&mut self, row: usize, k: usize, increment: S) {
        self.increment[row][k] = increment;
        self.iterate[row][k] = self.node.u[row][k] + increment;
    }

    /// Sets an unknown to a displacement, the increment with it.
    pub(super) fn set_displacement(&mut self, row: usize, k: usize, displacement: S) {
        self.iterate[row][k] = displacement;
        self.increment[row][k] = displacement - self.node.u[row][k];
    }

    /// Change of an unknown (m) by a fraction of the Newton step.
    pub(super) fn step_of(&self, row: usize, k: usize, fraction: S) -> S {
        let straight = fraction * self.direction[row][k];
        match self.bend.get(row) {
            Some(bend) => straight + fraction * fraction * bend[k],
            None => straight,
        }
    }

    /// Moves a body by a fraction of its Newton step.
    pub(super) fn advance(&mut self, rows: Range<usize>, fraction: S) {
        for row in rows {
            for k in 0..3 {
                let step = self.step_of(row, k, fraction);
                self.increment[row][k] += step;
                self.iterate[row][k] = if self.node.free(row, k) {
                    self.node.u[row][k] + self.increment[row][k]
                } else {
                    self.prescribed[row][k]
                };
            }
        }
    }

    /// Velocities of a body at the end of the stage.
    pub(super) fn find_velocities(&mut self, body: &BodyStep) {
        let per_second = S::from_f64(body.weights.rate);
        for row in body.rows.clone() {
            for k in 0..3 {
                self.velocity[row][k] = (self.increment[row][k] - self.offset[row][k]) * per_second;
            }
        }
    }

    /// Product of the damping matrix and `increment - offset` into `damped`, zero without one.
    pub(super) fn multiply_damping(&mut self, world: &World) {
        self.damped.clear();
        self.damped.resize(self.node.len(), [S::ZERO; 4]);
        if !self.damping.diagonal.is_empty() {
            let difference =
                |(d, o): (&[S; 4], &[S; 4])| [d[0] - o[0], d[1] - o[1], d[2] - o[2], S::ZERO];
            self.past_offset.clear();
            self.past_offset.extend(self.increment.iter().zip(&self.offset).map(difference));
            let Self { damping, product, past_offset, damped, .. } = self;
            damping.multiply(world.resource(), world.resource(), product, past_offset, damped);
        }
    }
}
