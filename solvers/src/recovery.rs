//! Recovery from inversion. The energy of biquadratic springs with compression term untangles folded and
//! mirrored bodies, but one that was collapsed to a point or scrambled may end wound around itself.
//! The corotational energy has no such states, so a body of which more than [`ENTER`] of the elements
//! are inverted moves by it, with safe steps, until no element has `J` below [`LEAVE_RATIO`], no edge is
//! strained beyond [`LEAVE_STRAIN`], and its own energy is no more than it was when recovery began.
//! Beginning may add energy (at a point 2.6 times that of the springs for nu = 0.3); it is booked in
//! `StepReport::recovery_energy`.

use crate::state::{NodeState, evaluate};
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::law::{BodiesWithoutRecovery, ElasticEnergy, RecoveringBodies};
use sinew_engine::report::{StepReport, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::measure_volume_ratios;
use sinew_engine::topology::Topology;

/// Part of a body's elements with `J <= 0` above which it recovers.
pub const ENTER: f64 = 0.05;
/// Volume ratio that all elements have when recovery ends.
pub const LEAVE_RATIO: f64 = 0.3;
/// Relative change of length that no edge exceeds when recovery ends.
pub const LEAVE_STRAIN: f64 = 0.5;

/// Bodies in recovery: kinetic plus potential energy (J) by their own law when it began.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recovery {
    start: Vec<Option<f64>>,
    revision: u64,
}

impl Recovery {
    /// Decides for the state in `node` which bodies recover, and tells the laws; which bodies changed
    /// or go on.
    pub fn update<S: Scalar>(
        &mut self,
        world: &mut World,
        on: bool,
        node: &NodeState<S>,
        rest: &[DVec3],
        report: &mut StepReport,
    ) -> Vec<bool> {
        let revision = world.resource::<Topology>().revision;
        let count = world.resource::<Topology>().bodies.len();
        if self.revision != revision || self.start.len() != count {
            *self = Self { start: vec![None; count], revision };
        }
        let old = RecoveringBodies(self.start.iter().map(Option::is_some).collect());
        if !on {
            self.start.fill(None);
            world.insert_resource(RecoveringBodies::default());
            return old.0;
        }
        world.insert_resource(old.clone());
        world.run_system_cached(measure_volume_ratios::<S>).expect("engine resources");
        let volumes = world.resource::<VolumeReport>();
        let without = world.resource::<BodiesWithoutRecovery>();
        let mut new = old.clone();
        for body in 0..count {
            new.0[body] = if old.0[body] {
                let strain = || largest_strain(world.resource(), node, rest, body);
                volumes.smallest_by_body[body] <= LEAVE_RATIO || strain() > LEAVE_STRAIN
            } else if without.contains(body) {
                false
            } else {
                let elements = volumes.elements_by_body[body] as f64;
                volumes.inverted_by_body[body] as f64 > ENTER * elements
            };
        }
        if new != old {
            let before = energies(world, node, &old);
            let after = energies(world, node, &new);
            report.evaluations += 2;
            for body in 0..count {
                let rows = &world.resource::<Topology>().bodies[body].vertices;
                let rows = rows.start as usize..rows.end as usize;
                let other = node.kinetic_energy(rows.clone(), &node.v)[0]
                    - node.load_potential(rows, &node.u);
                match (old.0[body], new.0[body]) {
                    (false, true) => self.start[body] = Some(other + before[body]),
                    (true, false) if self.start[body].is_some_and(|e| other + after[body] > e) => {
                        new.0[body] = true;
                    }
                    (true, false) => self.start[body] = None,
                    _ => {}
                }
                if old.0[body] != new.0[body] {
                    report.recovery_energy += after[body] - before[body];
                }
            }
        }
        report.recovering = new.0.iter().filter(|&&recovers| recovers).count() as u32;
        let touched = old.0.iter().zip(&new.0).map(|(old, new)| *old || *new).collect();
        world.insert_resource(new);
        touched
    }
}

/// Elastic energies (J) of the bodies while `recovering` are in recovery.
fn energies<S: Scalar>(
    world: &mut World,
    node: &NodeState<S>,
    recovering: &RecoveringBodies,
) -> Vec<f64> {
    world.insert_resource(recovering.clone());
    evaluate(world, &node.u, true, false, None);
    world.resource::<ElasticEnergy>().by_body.clone()
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
