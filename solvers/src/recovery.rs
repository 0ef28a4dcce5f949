//! Recovery from inversion. The energy of biquadratic springs with compression term untangles folded and
//! mirrored bodies, but one that was collapsed to a point or scrambled may end wound around itself.
//! The corotational energy has no such states, so a body of which more than [`ENTER`] of the elements
//! are inverted moves by it, with safe steps, until no element has `J` below [`LEAVE_RATIO`], no ten-node
//! tetrahedron is folded anywhere, no edge is strained beyond [`LEAVE_STRAIN`], and its own energy is no more
//! than it was when recovery began.
//!
//! The corotational energy grows with the square of the strain only. So that what a recovering body minimises
//! stays bounded below, follower pressure, whose potential may fall with the third power, is silent meanwhile
//! (dead loads fall linearly), and a body under loads beyond what such an energy can hold does not begin
//! ([`OVERLOAD`]): it is inverted because it is crushed, and its own law holds the load better. Neither does a
//! body that pressure holds in a shape of less energy than at rest, to which it would return. A body that
//! comes to rest out of shape is held there: it gets its own law back, where that raises its energy by no more
//! than [`MOST_GAIN`], until what holds it changes. After [`PATIENCE`] steps so does every other, or the step
//! fails: recovery neither goes on for ever nor makes much energy at its end.
//!
//! Beginning may add energy (at a point 2.6 times that of the springs for nu = 0.3); it is booked in
//! `StepReport::recovery_energy`.

use crate::history::Past;
use crate::state::{NodeState, Rows, evaluate, read_force};
use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::isoparametric::{Tetrahedron10Rest, Tetrahedron10Vertices, folded_tetrahedron};
use sinew_engine::law::{BodiesWithoutRecovery, ElasticEnergy, RecoveringBodies};
use sinew_engine::ratios::measure_volume_ratios;
use sinew_engine::report::{StepReport, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::BodyId;
use std::ops::Range;

/// Part of a body's elements with `J <= 0` above which it recovers.
pub const ENTER: f64 = 0.05;
/// Volume ratio that all elements have when recovery ends.
pub const LEAVE_RATIO: f64 = 0.3;
/// Relative change of length that no edge exceeds when recovery ends.
pub const LEAVE_STRAIN: f64 = 0.5;

/// Loads on a body, as the sum of their magnitudes times its size over shear modulus times volume, above which
/// it does not begin to recover. Spread evenly, loads of 1 strain a body by some tenths; at 10 the strains
/// are several, where a quadratic energy is far softer than any law that stiffens.
pub const OVERLOAD: f64 = 10.0;
/// Steps after which a recovery is given up. Starts as bad as a point or random positions take about 100.
pub const PATIENCE: u32 = 1000;
/// Steps before which a recovering body counts as in motion, and the part of its energy below which kinetic
/// energy and the change in a step count as none.
const RESTLESS: (u32, f64) = (10, 1e-5);
/// Most that giving up may multiply the elastic energy by. Of a body squeezed flat the two energies differ by
/// less; that of one drawn out by loads would be multiplied by the square of its strain.
pub const MOST_GAIN: f64 = 2.0;

/// How a body moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum BodyState {
    /// By its own law.
    #[default]
    Own,
    /// It recovers.
    Recovers {
        /// Kinetic plus potential energy (J) by its own law when that began.
        start: f64,
        /// Steps since then.
        steps: u32,
        /// Elastic energy (J) by the law that stands in, a step ago.
        energy: f64,
    },
    /// By its own law although elements are inverted: recovery was given up, and does not begin again before
    /// the body was in shape or what holds it changes (this is its mark).
    GivenUp(u64),
}

/// Recovery of a body in the coming step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecoveryPlan {
    /// It goes on as it did.
    Stay,
    /// It begins to recover.
    Begin,
    /// It is in shape.
    Leave,
    /// It is held out of shape, or takes too long.
    GiveUp,
}

/// The shape of a body.
#[derive(Clone, Copy, Debug)]
pub struct BodyShape {
    /// Elements.
    pub elements: u64,
    /// Those that are inverted.
    pub inverted: u64,
    /// Smallest volume ratio.
    pub smallest_ratio: f64,
    /// Mark of what holds the body ([`BodyState::hold`]); none while that moves.
    pub hold: Option<u64>,
}

/// Energies (J) of a body at the start of a step: by the law of the last step and by the planned one, potential of
/// follower loads included, and the energies that no law changes: kinetic energy less work of dead loads.
#[derive(Clone, Copy, Debug)]
pub struct SwapEnergies {
    /// Before.
    pub old: f64,
    /// After.
    pub new: f64,
    /// The others.
    pub other: f64,
}

impl BodyShape {
    /// Shape of body number `body` with the mark `hold`.
    pub fn of(volumes: &VolumeReport, body: usize, hold: Option<u64>) -> Self {
        let count = |counts: &[u64]| counts.get(body).copied().unwrap_or(0);
        Self {
            elements: count(&volumes.elements_by_body),
            inverted: count(&volumes.inverted_by_body),
            smallest_ratio: volumes.smallest_by_body.get(body).copied().unwrap_or(f64::INFINITY),
            hold,
        }
    }

    /// Whether more elements are inverted than a body gets rid of by itself.
    pub fn is_out_of_shape(&self) -> bool {
        self.inverted as f64 > ENTER * self.elements as f64
    }
}

impl BodyState {
    /// Whether it recovers.
    pub fn recovers(self) -> bool {
        matches!(self, Self::Recovers { .. })
    }

    /// A mark of which axes of its rows are held; `None` while what holds them moves, and for a body that moves
    /// by its own law, which nobody asks.
    pub fn hold<S: Scalar>(self, node: &NodeState<S>, rows: Range<usize>) -> Option<u64> {
        if self == Self::Own { None } else { mark_of_hold(node, rows) }
    }

    /// The plan for the coming step, by the shape; counts steps. `in_order` says whether edges and curved elements are
    /// as they are to be when recovery ends.
    pub fn plan(&mut self, shape: &BodyShape, in_order: impl Fn() -> bool) -> RecoveryPlan {
        let in_shape = || shape.smallest_ratio > LEAVE_RATIO && in_order();
        if let Self::GivenUp(hold) = *self {
            if shape.hold == Some(hold) && !in_shape() {
                return RecoveryPlan::Stay;
            }
            *self = Self::Own;
        }
        if let Self::Recovers { steps, .. } = self {
            *steps += 1;
            return match in_shape() {
                true => RecoveryPlan::Leave,
                false if *steps > PATIENCE => RecoveryPlan::GiveUp,
                false => RecoveryPlan::Stay,
            };
        }
        if shape.is_out_of_shape() { RecoveryPlan::Begin } else { RecoveryPlan::Stay }
    }

    /// Whether a recovering body came to rest; `energy` (J) is that of the law that stands in.
    pub fn rests(&mut self, kinetic: f64, energy: f64) -> bool {
        let Self::Recovers { steps, energy: last, .. } = self else { return false };
        let none = RESTLESS.1 * energy;
        let change = energy - std::mem::replace(last, energy);
        *steps >= RESTLESS.0 && kinetic <= none && change.abs() <= none
    }

    /// Carries a plan out unless that would add too much energy; false where it does not.
    ///
    /// # Errors
    /// When the body can neither go on to recover nor give up.
    pub fn follow(
        &mut self,
        plan: RecoveryPlan,
        shape: &BodyShape,
        SwapEnergies { old, new, other }: SwapEnergies,
    ) -> Result<bool, RecoveryUnending> {
        match (plan, *self) {
            (RecoveryPlan::Begin, _) => {
                *self = Self::Recovers { start: other + old, steps: 0, energy: new }
            }
            (RecoveryPlan::Leave, Self::Recovers { start, .. }) if other + new <= start => {
                *self = Self::Own
            }
            (RecoveryPlan::GiveUp, Self::Recovers { start, .. })
                if new <= MOST_GAIN * old || other + new <= start =>
            {
                *self = Self::GivenUp(shape.hold.unwrap_or_default());
            }
            (RecoveryPlan::GiveUp, Self::Recovers { steps, .. }) if steps > PATIENCE => {
                let BodyShape { inverted, smallest_ratio, .. } = *shape;
                return Err(RecoveryUnending { steps, inverted, smallest_ratio });
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}

/// A recovery that neither ends nor can be given up.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "it did not recover from inversion in {steps} steps: {inverted} of its elements are still inverted, the \
     smallest volume ratio is {smallest_ratio:.3}; remove the load or constraint that crushes it, or switch \
     recovery off (`recovery = false`)"
)]
pub struct RecoveryUnending {
    /// Steps that it took so far.
    pub steps: u32,
    /// Elements that are inverted.
    pub inverted: u64,
    /// Smallest volume ratio.
    pub smallest_ratio: f64,
}

impl RecoveryUnending {
    /// The error of the step, for body number `body`.
    pub fn of_body(self, world: &World, body: usize) -> StepError {
        let clock = world.resource::<StepClock>();
        let reason = format!("body `{}`: {self}", world.resource::<Topology>().bodies[body].name);
        StepError::Diverged { step: clock.step, time: clock.time, reason }
    }
}

/// Which bodies recover.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recovery {
    bodies: Vec<BodyState>,
}

impl Recovery {
    /// How the bodies move, as far as it holds.
    pub fn memory(&self, topology: &Topology) -> Option<Vec<BodyState>> {
        (self.bodies.len() == topology.bodies.len()).then(|| self.bodies.clone())
    }

    /// Whether a body moves by its own law, and was not given up.
    pub fn is_own(&self, body: usize) -> bool {
        self.bodies.get(body) == Some(&BodyState::Own)
    }

    /// Takes up how they moved.
    pub fn recall(&mut self, topology: &Topology, bodies: Option<&Vec<BodyState>>) {
        let bodies = bodies.cloned().unwrap_or_else(|| vec![BodyState::Own; topology.bodies.len()]);
        *self = Self { bodies };
    }

    /// Decides for the state in `node` which bodies recover, and tells the laws; which bodies changed
    /// or go on. A recovery that was given up may begin again where the state was set from outside.
    ///
    /// # Errors
    /// When a recovery does not end.
    pub fn update<S: Scalar>(
        &mut self,
        world: &mut World,
        on: bool,
        node: &NodeState<S>,
        past: &[Past],
        rest: &[DVec3],
        report: &mut StepReport,
    ) -> Result<Vec<bool>, StepError> {
        // bodies come after all others, and go on recovering where cuts and removals change them
        let count = world.resource::<Topology>().bodies.len();
        self.bodies.resize(count, BodyState::Own);
        let old = RecoveringBodies(self.bodies.iter().map(|body| body.recovers()).collect());
        if !on {
            self.bodies.fill(BodyState::Own);
            world.insert_resource(RecoveringBodies::default());
            return Ok(old.0);
        }
        // a state set from outside gives another chance
        for (state, past) in self.bodies.iter_mut().zip(past) {
            if !past.same_state && matches!(state, BodyState::GivenUp(_)) {
                *state = BodyState::Own;
            }
        }
        // a plan for every body, by its shape
        world.insert_resource(old.clone());
        world.run_system_cached(measure_volume_ratios::<S>).expect("engine resources");
        let (volumes, topology) = (world.resource::<VolumeReport>(), world.resource::<Topology>());
        let shape = |(i, state): (usize, &BodyState)| {
            BodyShape::of(volumes, i, state.hold(node, rows_of(topology, i)))
        };
        let shapes: Vec<BodyShape> = self.bodies.iter().enumerate().map(shape).collect();
        let without = world.resource::<BodiesWithoutRecovery>();
        let plan = |(i, state): (usize, &mut BodyState)| {
            let in_order = || {
                largest_strain(topology, node, rest, i) <= LEAVE_STRAIN
                    && !has_folds(world, node, rest, i)
            };
            if without.contains(i) { RecoveryPlan::Stay } else { state.plan(&shapes[i], in_order) }
        };
        let mut plans: Vec<RecoveryPlan> = self.bodies.iter_mut().enumerate().map(plan).collect();
        // bodies that are crushed do not begin, those that came to rest give up
        if plans.contains(&RecoveryPlan::Begin) || self.bodies.iter().any(|body| body.recovers()) {
            let before = energies(world, node, &old);
            report.evaluations += 1;
            if plans.contains(&RecoveryPlan::Begin) {
                let loads = load_measures(world, node, rest);
                report.evaluations += 2;
                for (i, plan) in
                    plans.iter_mut().enumerate().filter(|(_, p)| **p == RecoveryPlan::Begin)
                {
                    if is_crushed(loads[i], before.by_body[i]) {
                        *plan = RecoveryPlan::Stay;
                        report.recoveries_refused += 1;
                    }
                }
            }
            let topology = world.resource::<Topology>();
            for (i, state) in self.bodies.iter_mut().enumerate() {
                let kinetic = node.kinetic_energy(rows_of(topology, i), &node.v)[0];
                if state.rests(kinetic, before.by_body[i]) && plans[i] == RecoveryPlan::Stay {
                    plans[i] = RecoveryPlan::GiveUp;
                }
            }
            if plans.iter().any(|plan| *plan != RecoveryPlan::Stay) {
                self.swap(world, node, &plans, &shapes, &before, report)?;
            }
        }
        let new = RecoveringBodies(self.bodies.iter().map(|body| body.recovers()).collect());
        report.recovering = new.0.iter().filter(|&&recovers| recovers).count() as u32;
        let touched = old.0.iter().zip(&new.0).map(|(old, new)| *old || *new).collect();
        world.insert_resource(new);
        Ok(touched)
    }

    /// Carries the plans out, but for those that would add too much energy.
    fn swap<S: Scalar>(
        &mut self,
        world: &mut World,
        node: &NodeState<S>,
        plans: &[RecoveryPlan],
        shapes: &[BodyShape],
        before: &RecoveryEnergies,
        report: &mut StepReport,
    ) -> Result<(), StepError> {
        let is = |(plan, state): (&RecoveryPlan, &BodyState)| match plan {
            RecoveryPlan::Stay => state.recovers(),
            plan => *plan == RecoveryPlan::Begin,
        };
        let asked = RecoveringBodies(plans.iter().zip(&self.bodies).map(is).collect());
        let mut after = energies(world, node, &asked);
        report.evaluations += 1;
        for (body, &plan) in
            plans.iter().enumerate().filter(|(_, plan)| **plan != RecoveryPlan::Stay)
        {
            let rows = rows_of(world.resource(), body);
            let other = node.kinetic_energy(rows.clone(), &node.v)[0]
                - node.load_potential(rows.clone(), &node.u);
            let (old, new) = (before.by_body[body], after.by_body[body]);
            let changed = self.bodies[body]
                .follow(plan, &shapes[body], SwapEnergies { old, new, other })
                .map_err(|unending| unending.of_body(world, body))?;
            report.recoveries_given_up += u32::from(changed && plan == RecoveryPlan::GiveUp);
        }
        let new = RecoveringBodies(self.bodies.iter().map(|body| body.recovers()).collect());
        if new != asked {
            after = energies(world, node, &new);
            report.evaluations += 1;
        }
        report.recovery_energy += after.elastic - before.elastic;
        Ok(())
    }
}

/// Whether a body is inverted because loads crush it: they are more than its material can hold ([`OVERLOAD`]),
/// or its energy (J) by its own law, potential of follower loads included, is below that of the rest shape, 0.
pub fn is_crushed(load: f64, energy: f64) -> bool {
    load > OVERLOAD || energy < 0.0
}

/// Vertex rows of a body.
pub(crate) fn rows_of(topology: &Topology, body: usize) -> Range<usize> {
    let rows = &topology.bodies[body].vertices;
    rows.start as usize..rows.end as usize
}

/// A mark of which axes of some rows are held; `None` while what holds them moves.
fn mark_of_hold<S: Scalar>(node: &NodeState<S>, rows: Range<usize>) -> Option<u64> {
    let mut mark = 0_u64;
    for row in rows {
        if node.held_axes(row).any(|k| node.prescribed[row][k] != node.u[row][k]) {
            return None;
        }
        mark = mark.wrapping_mul(31).wrapping_add(u64::from(node.fixed[row].0));
    }
    Some(mark)
}

/// Loads on every body over the loads that its material can hold: the sum of their magnitudes times its size over shear
/// modulus times volume. Forces that only accelerate a free body as a whole do not count. Active stress and the
/// pressure on the rest shape are loads here.
pub fn load_measures<S: Scalar>(
    world: &mut World,
    node: &NodeState<S>,
    rest: &[DVec3],
) -> Vec<f64> {
    let topology = world.resource::<Topology>().clone();
    let of_recovery = world.resource::<RecoveringBodies>().clone();
    world.insert_resource(RecoveringBodies::default());
    let mut probe: Rows<S> = vec![[S::ZERO; 4]; node.len()];
    evaluate(world, &probe, false, true, None);
    let mut force: Rows<S> = Rows::new();
    read_force(world, &mut force);

    // a stretch without change of volume, by the energy that stands in: 3/2 mu V strain^2
    for body in &topology.bodies {
        let rows = body.vertices.start as usize..body.vertices.end as usize;
        let strain = DVec3::new(STRAIN, -0.5 * STRAIN, -0.5 * STRAIN);
        let origin = rest.get(rows.start).copied().unwrap_or_default();
        for row in rows {
            let u = strain * (rest[row] - origin);
            probe[row] = [S::from_f64(u.x), S::from_f64(u.y), S::from_f64(u.z), S::ZERO];
        }
    }
    world.insert_resource(RecoveringBodies(vec![true; topology.bodies.len()]));
    evaluate(world, &probe, true, false, None);
    let energies = world.resource::<ElasticEnergy>().by_body.clone();
    world.insert_resource(of_recovery);

    let measure = |(body, energy): (&BodyRows, f64)| {
        let rows = body.vertices.start as usize..body.vertices.end as usize;
        let total = |row: usize| {
            let (f, e) = (&force[row], &node.external[row]);
            DVec3::from_array([0, 1, 2].map(|k| f[k].to_f64() + e[k].to_f64()))
        };
        let held = rows.clone().any(|row| node.held_axes(row).next().is_some());
        let mass: f64 = rows.clone().map(|row| node.mass[row].to_f64()).sum();
        let resultant: DVec3 = if held { DVec3::ZERO } else { rows.clone().map(total).sum() };
        let own = |row: usize| (total(row) - resultant * (node.mass[row].to_f64() / mass)).length();
        rows.map(own).sum::<f64>() * body.size * 1.5 * STRAIN * STRAIN / energy
    };
    topology.bodies.iter().zip(energies).map(measure).collect()
}

/// Strain of the probe for the stiffness of a body: small for the material, large for rounding.
const STRAIN: f64 = 1e-3;

/// Energies (J) at the start of a step.
struct RecoveryEnergies {
    /// Of the bodies, potential of follower loads included.
    by_body: Vec<f64>,
    /// Elastic energy of all.
    elastic: f64,
}

/// Energies while `recovering` are in recovery.
fn energies<S: Scalar>(
    world: &mut World,
    node: &NodeState<S>,
    recovering: &RecoveringBodies,
) -> RecoveryEnergies {
    world.insert_resource(recovering.clone());
    evaluate(world, &node.u, true, false, None);
    let energy = world.resource::<ElasticEnergy>();
    RecoveryEnergies { by_body: energy.by_body.clone(), elastic: energy.elastic() }
}

/// Whether a ten-node tetrahedron of a body is folded, where its Gauss points may miss it.
fn has_folds<S: Scalar>(world: &World, node: &NodeState<S>, rest: &[DVec3], body: usize) -> bool {
    type Ten<S> = (&'static Tetrahedron10Vertices, &'static Tetrahedron10Rest<S>, &'static BodyId);
    let Some(mut elements) = world.try_query::<Ten<S>>() else { return false };
    let position = |row: u32| {
        let u = DVec3::from_array([0, 1, 2].map(|k| node.u[row as usize][k].to_f64()));
        (rest[row as usize] + u).to_array()
    };
    elements.iter(world).any(|(nodes, shape, of)| {
        // removed elements have no volume
        of.0 as usize == body
            && shape.volume.iter().any(|&v| v > S::ZERO)
            && folded_tetrahedron(&nodes.0.map(position)).is_some()
    })
}

/// Largest relative change of length of the edges of a body.
fn largest_strain<S: Scalar>(
    topology: &Topology,
    node: &NodeState<S>,
    rest: &[DVec3],
    body: usize,
) -> f64 {
    let vector = |u: &[S; 4]| DVec3::new(u[0].to_f64(), u[1].to_f64(), u[2].to_f64());
    let strain = |edge: [u32; 2]| {
        let [a, b] = edge.map(|row| row as usize);
        let way = rest[a] - rest[b];
        let moved = vector(&node.u[a]) - vector(&node.u[b]);
        ((way + moved).length() / way.length() - 1.0).abs()
    };
    topology.used_edges(body).map(strain).fold(0.0, f64::max)
}
