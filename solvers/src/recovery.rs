//! Recovery from inversion. The energy of biquadratic springs with compression term untangles folded and
//! mirrored bodies, but one that was collapsed to a point or scrambled may end wound around itself.
//! The corotational energy has no such states, so a body of which more than [`ENTER`] of the elements
//! are inverted moves by it, with safe steps, until no element has `J` below [`LEAVE_RATIO`], no edge is
//! strained beyond [`LEAVE_STRAIN`], and its own energy is no more than it was when recovery began.
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

use crate::state::{NodeState, Rows, evaluate, read_force};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::law::{BodiesWithoutRecovery, ElasticEnergy, RecoveringBodies};
use sinew_engine::report::{StepReport, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError, measure_volume_ratios};
use sinew_engine::topology::{BodyRows, Topology};
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

/// What is remembered of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum BodyState {
    /// Moves by its own law.
    #[default]
    Own,
    /// Recovers.
    Recovers {
        /// Kinetic plus potential energy (J) by its own law when that began.
        start: f64,
        /// Steps since then.
        steps: u32,
        /// Elastic energy (J) by the law that stands in, a step ago.
        energy: f64,
    },
    /// Moves by its own law although elements are inverted: recovery was given up, and does not begin again
    /// before the body was in shape or what holds it changes (this is its mark).
    GivenUp(u64),
}

impl BodyState {
    fn recovers(self) -> bool {
        matches!(self, Self::Recovers { .. })
    }
}

/// What is to become of a body in the step to come.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Plan {
    Stay,
    Begin,
    Leave,
    GiveUp,
}

/// Which bodies recover.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recovery {
    bodies: Vec<BodyState>,
    revision: u64,
}

impl Recovery {
    /// Decides for the state in `node` which bodies recover, and tells the laws; which bodies changed
    /// or go on.
    ///
    /// # Errors
    /// When a recovery does not end.
    pub fn update<S: Scalar>(
        &mut self,
        world: &mut World,
        on: bool,
        node: &NodeState<S>,
        rest: &[DVec3],
        report: &mut StepReport,
    ) -> Result<Vec<bool>, StepError> {
        let revision = world.resource::<Topology>().revision;
        let count = world.resource::<Topology>().bodies.len();
        if self.revision != revision || self.bodies.len() != count {
            *self = Self { bodies: vec![BodyState::Own; count], revision };
        }
        let old = RecoveringBodies(self.bodies.iter().map(|body| body.recovers()).collect());
        if !on {
            self.bodies.fill(BodyState::Own);
            world.insert_resource(RecoveringBodies::default());
            return Ok(old.0);
        }
        world.insert_resource(old.clone());
        world.run_system_cached(measure_volume_ratios::<S>).expect("engine resources");
        let mut plans: Vec<Plan> = (0..count).map(|i| self.plan(world, node, rest, i)).collect();
        if plans.contains(&Plan::Begin) || self.bodies.iter().any(|body| body.recovers()) {
            let before = energies(world, node, &old);
            report.evaluations += 1;
            self.refuse_the_crushed(world, node, rest, &mut plans, &before, report);
            self.give_up_at_rest(world, node, &mut plans, &before);
            self.swap(world, node, &plans, &before, report)?;
        }
        let new = RecoveringBodies(self.bodies.iter().map(|body| body.recovers()).collect());
        report.recovering = new.0.iter().filter(|&&recovers| recovers).count() as u32;
        let touched = old.0.iter().zip(&new.0).map(|(old, new)| *old || *new).collect();
        world.insert_resource(new);
        Ok(touched)
    }

    /// What the shape of a body asks for; counts its steps.
    fn plan<S: Scalar>(
        &mut self,
        world: &World,
        node: &NodeState<S>,
        rest: &[DVec3],
        body: usize,
    ) -> Plan {
        let volumes = world.resource::<VolumeReport>();
        let topology = world.resource::<Topology>();
        let inverted = volumes.inverted_by_body[body];
        let state = &mut self.bodies[body];
        if let BodyState::GivenUp(hold) = *state {
            let now = mark_of_hold(node, rows_of(topology, body));
            if inverted > 0 && now == Some(hold) {
                return Plan::Stay;
            }
            *state = BodyState::Own;
        }
        if let BodyState::Recovers { steps, .. } = state {
            *steps += 1;
            let in_shape = volumes.smallest_by_body[body] > LEAVE_RATIO
                && largest_strain(topology, node, rest, body) <= LEAVE_STRAIN;
            return match in_shape {
                true => Plan::Leave,
                false if *steps > PATIENCE => Plan::GiveUp,
                false => Plan::Stay,
            };
        }
        let many = inverted as f64 > ENTER * volumes.elements_by_body[body] as f64;
        let can = !world.resource::<BodiesWithoutRecovery>().contains(body);
        if many && can { Plan::Begin } else { Plan::Stay }
    }

    /// Lets no body begin that is inverted because loads crush it.
    fn refuse_the_crushed<S: Scalar>(
        &self,
        world: &mut World,
        node: &NodeState<S>,
        rest: &[DVec3],
        plans: &mut [Plan],
        before: &Energies,
        report: &mut StepReport,
    ) {
        if !plans.contains(&Plan::Begin) {
            return;
        }
        let loads = load_measures(world, node, rest);
        report.evaluations += 2;
        for (body, plan) in plans.iter_mut().enumerate().filter(|(_, plan)| **plan == Plan::Begin) {
            // at rest the energy with follower loads would be 0
            if loads[body] > OVERLOAD || before.by_body[body] < 0.0 {
                *plan = Plan::Stay;
                report.recoveries_refused += 1;
            }
        }
    }

    /// Plans to give up the recoveries that came to rest: what holds those bodies keeps them out of shape.
    fn give_up_at_rest<S: Scalar>(
        &mut self,
        world: &World,
        node: &NodeState<S>,
        plans: &mut [Plan],
        before: &Energies,
    ) {
        let topology = world.resource::<Topology>();
        for (body, state) in self.bodies.iter_mut().enumerate() {
            let BodyState::Recovers { steps, energy, .. } = state else { continue };
            let now = before.by_body[body];
            let kinetic = node.kinetic_energy(rows_of(topology, body), &node.v)[0];
            let (few, none) = (RESTLESS.0, RESTLESS.1 * now);
            if plans[body] == Plan::Stay
                && *steps >= few
                && kinetic <= none
                && (now - *energy).abs() <= none
            {
                plans[body] = Plan::GiveUp;
            }
            *energy = now;
        }
    }

    /// Carries the plans out, as far as they make no energy.
    fn swap<S: Scalar>(
        &mut self,
        world: &mut World,
        node: &NodeState<S>,
        plans: &[Plan],
        before: &Energies,
        report: &mut StepReport,
    ) -> Result<(), StepError> {
        if plans.iter().all(|plan| *plan == Plan::Stay) {
            return Ok(());
        }
        let is = |(plan, state): (&Plan, &BodyState)| match plan {
            Plan::Stay => state.recovers(),
            plan => *plan == Plan::Begin,
        };
        let asked = RecoveringBodies(plans.iter().zip(&self.bodies).map(is).collect());
        let mut after = energies(world, node, &asked);
        report.evaluations += 1;
        for (body, &plan) in plans.iter().enumerate() {
            let rows = rows_of(world.resource(), body);
            let other = node.kinetic_energy(rows.clone(), &node.v)[0]
                - node.load_potential(rows.clone(), &node.u);
            let (old, new) = (before.by_body[body], after.by_body[body]);
            match (plan, self.bodies[body]) {
                (Plan::Begin, _) => {
                    let start = other + old;
                    self.bodies[body] = BodyState::Recovers { start, steps: 0, energy: new };
                }
                (Plan::Leave, BodyState::Recovers { start, .. }) if other + new <= start => {
                    self.bodies[body] = BodyState::Own;
                }
                (Plan::GiveUp, BodyState::Recovers { start, steps, .. }) => {
                    if new <= MOST_GAIN * old || other + new <= start {
                        let hold = mark_of_hold(node, rows).unwrap_or_default();
                        self.bodies[body] = BodyState::GivenUp(hold);
                        report.recoveries_given_up += 1;
                    } else if steps > PATIENCE {
                        return Err(unending(world, body, steps));
                    }
                }
                _ => {}
            }
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

/// Vertex rows of a body.
fn rows_of(topology: &Topology, body: usize) -> Range<usize> {
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

/// The error of a recovery that cannot be given up.
fn unending(world: &World, body: usize, steps: u32) -> StepError {
    let clock = world.resource::<StepClock>();
    let volumes = world.resource::<VolumeReport>();
    StepError::Diverged {
        step: clock.step,
        time: clock.time,
        reason: format!(
            "body {body} (in order of spawning) did not recover from inversion in {steps} steps: {} of its \
             elements are still inverted, the smallest volume ratio is {:.3}; remove the load or constraint \
             that crushes it, or switch recovery off (`recovery = false`)",
            volumes.inverted_by_body[body], volumes.smallest_by_body[body],
        ),
    }
}

/// Loads on every body over what its material can hold: the sum of their magnitudes times its size over shear
/// modulus times volume. Forces that only accelerate a free body as a whole do not count. Active stress and
/// the pressure on the rest shape are loads here.
fn load_measures<S: Scalar>(world: &mut World, node: &NodeState<S>, rest: &[DVec3]) -> Vec<f64> {
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
struct Energies {
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
) -> Energies {
    world.insert_resource(recovering.clone());
    evaluate(world, &node.u, true, false, None);
    let energy = world.resource::<ElasticEnergy>();
    Energies { by_body: energy.by_body.clone(), elastic: energy.elastic() }
}

/// Largest relative change of length of the edges of a body.
fn largest_strain<S: Scalar>(
    topology: &Topology,
    node: &NodeState<S>,
    rest: &[DVec3],
    body: usize,
) -> f64 {
    let vector = |u: &[S; 4]| DVec3::new(u[0].to_f64(), u[1].to_f64(), u[2].to_f64());
    let blocks = topology.bodies[body].blocks.clone();
    let edges = &topology.edges[blocks.start as usize..blocks.end as usize];
    let strain = |[a, b]: &[u32; 2]| {
        let [a, b] = [*a as usize, *b as usize];
        let way = rest[a] - rest[b];
        let moved = vector(&node.u[a]) - vector(&node.u[b]);
        ((way + moved).length() / way.length() - 1.0).abs()
    };
    edges.iter().map(strain).fold(0.0, f64::max)
}
