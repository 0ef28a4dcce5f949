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
//! is not in shape after [`PATIENCE`] steps gets its own law back if that does not raise its energy, and else
//! the step fails: recovery neither goes on for ever nor makes energy at its end.
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

/// What is remembered of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum BodyState {
    /// Moves by its own law.
    #[default]
    Own,
    /// Recovers for so many steps; its kinetic plus potential energy (J) by its own law when that began.
    Recovers { start: f64, steps: u32 },
    /// Moves by its own law although elements are inverted: recovery was given up, and does not begin again
    /// before the body was in shape.
    GivenUp,
}

impl BodyState {
    fn recovers(self) -> bool {
        matches!(self, Self::Recovers { .. })
    }
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
        let wanted: Vec<bool> =
            (0..count).map(|body| self.wants(world, node, rest, body)).collect();
        let new = self.swap(world, node, rest, wanted, report)?;
        report.recovering = new.0.iter().filter(|&&recovers| recovers).count() as u32;
        let touched = old.0.iter().zip(&new.0).map(|(old, new)| *old || *new).collect();
        world.insert_resource(new);
        Ok(touched)
    }

    /// Whether the shape of a body asks for recovery in the step to come; counts its steps.
    fn wants<S: Scalar>(
        &mut self,
        world: &World,
        node: &NodeState<S>,
        rest: &[DVec3],
        body: usize,
    ) -> bool {
        let volumes = world.resource::<VolumeReport>();
        let inverted = volumes.inverted_by_body[body] as f64;
        let many = inverted > ENTER * volumes.elements_by_body[body] as f64;
        match &mut self.bodies[body] {
            BodyState::Recovers { steps, .. } => {
                *steps += 1;
                let strain = || largest_strain(world.resource(), node, rest, body);
                volumes.smallest_by_body[body] <= LEAVE_RATIO || strain() > LEAVE_STRAIN
            }
            BodyState::Own => many && !world.resource::<BodiesWithoutRecovery>().contains(body),
            given_up => {
                if inverted == 0.0 {
                    *given_up = BodyState::Own;
                }
                false
            }
        }
    }

    /// Carries out the changes that are `wanted`, as far as loads and energies allow them.
    fn swap<S: Scalar>(
        &mut self,
        world: &mut World,
        node: &NodeState<S>,
        rest: &[DVec3],
        mut wanted: Vec<bool>,
        report: &mut StepReport,
    ) -> Result<RecoveringBodies, StepError> {
        let old = world.resource::<RecoveringBodies>().clone();
        let begins: Vec<usize> = (0..wanted.len()).filter(|&i| wanted[i] && !old.0[i]).collect();
        if !begins.is_empty() {
            let (own, _) = energies(world, node, &old);
            let loads = load_measures(world, node, rest);
            report.evaluations += 3;
            for body in begins {
                // at rest its energy with follower loads would be 0
                if loads[body] > OVERLOAD || own[body] < 0.0 {
                    wanted[body] = false;
                    report.recoveries_refused += 1;
                }
            }
        }
        let tired = |state: &BodyState| matches!(state, BodyState::Recovers { steps, .. } if *steps > PATIENCE);
        let given_up: Vec<bool> = self.bodies.iter().map(tired).collect();
        let mut new = RecoveringBodies(wanted);
        for body in (0..given_up.len()).filter(|&body| given_up[body]) {
            new.0[body] = false;
        }
        if new == old {
            return Ok(new);
        }
        let (before, elastic_before) = energies(world, node, &old);
        let (after, mut elastic_after) = energies(world, node, &new);
        report.evaluations += 2;
        let asked = new.clone();
        for body in 0..new.0.len() {
            let rows = &world.resource::<Topology>().bodies[body].vertices;
            let rows = rows.start as usize..rows.end as usize;
            let other =
                node.kinetic_energy(rows.clone(), &node.v)[0] - node.load_potential(rows, &node.u);
            match (self.bodies[body], new.0[body]) {
                (BodyState::Recovers { start, steps }, false) if other + after[body] > start => {
                    if given_up[body] {
                        return Err(unending(world, body, steps));
                    }
                    new.0[body] = true;
                }
                (BodyState::Recovers { .. }, false) if given_up[body] => {
                    self.bodies[body] = BodyState::GivenUp;
                    report.recoveries_given_up += 1;
                }
                (BodyState::Recovers { .. }, false) => self.bodies[body] = BodyState::Own,
                (BodyState::Own, true) => {
                    let start = other + before[body];
                    self.bodies[body] = BodyState::Recovers { start, steps: 0 };
                }
                _ => {}
            }
        }
        if new != asked {
            (_, elastic_after) = energies(world, node, &new);
            report.evaluations += 1;
        }
        report.recovery_energy += elastic_after - elastic_before;
        Ok(new)
    }
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

/// Energies (J) of the bodies, potential of follower loads included, while `recovering` are in recovery, and
/// the elastic energy of all.
fn energies<S: Scalar>(
    world: &mut World,
    node: &NodeState<S>,
    recovering: &RecoveringBodies,
) -> (Vec<f64>, f64) {
    world.insert_resource(recovering.clone());
    evaluate(world, &node.u, true, false, None);
    let energy = world.resource::<ElasticEnergy>();
    (energy.by_body.clone(), energy.elastic())
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
