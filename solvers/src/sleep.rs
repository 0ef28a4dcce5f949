//! Sleep: a body at rest, with nothing near, is left where it is and costs next to nothing.
//!
//! A body falls asleep when for [`CALM`] seconds all its vertices have been slower than [`SolverSettings::sleep_speed`] times its
//! size, nothing could touch or pull it, and loads, masses, laws and what holds it have not changed, and when no element is
//! inverted. Its velocities, which are small, become zero; the step books their energy as dissipation. From then on its
//! energy and forces are those found last.
//!
//! It wakes in the step in which one of this no longer holds: a tool, a pull, a thread or another body comes near, a load or
//! held vertex changes, its state is set from outside, elements go or are cut. A changed constant of any law wakes all bodies.
//! In worlds that have or had a pressure, where a law joins several bodies, or where one has not declared what it reads
//! ([`declare_inputs`](sinew_engine::schedule::declare_inputs)), none sleeps. Whoever evaluates elements between two steps, for
//! reactions or forces, has those of sleepers evaluated once more. A system of
//! [`Constrain`](sinew_engine::schedule::StepSystems::Constrain) that moves a sleeper wakes it in the next step.
//!
//! [`SolverSettings::sleep_speed`]: crate::settings::SolverSettings::sleep_speed

use crate::history::StepHistory;
use crate::state::{NodeState, evaluate, same_bits};
use bevy_ecs::prelude::World;
use sinew_engine::law::{LawBuffers, SleepingBodies};
use sinew_engine::report::StepReport;
use sinew_engine::resource::put;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::BodyRows;

/// Time (s) for which a body has to be slow: at the turn of a swing it is slow for less.
pub const CALM: f64 = 0.5;

/// Steps after which nothing of a world in which everyone sleeps remembers motion, velocities of four steps included.
const STILL: u32 = 5;

/// Who sleeps, and what was found of the elements of those bodies.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sleep<S> {
    bodies: SleepingBodies,
    /// Number of the last evaluation of the last step.
    evaluation: u64,
    /// Columns and energy (J) at the end of the last step, if it and some before it left a world as it was.
    still: Option<(NodeState<S>, f64)>,
}

impl<S: Scalar> Sleep<S> {
    /// Begins a step in which these of `count` bodies sleep at displacements `u`, which are those of the last step. What is
    /// known of their elements must be of there: bodies that fall asleep are evaluated once more, and all of them where
    /// somebody else has evaluated elements since.
    pub fn begin(
        &mut self,
        world: &mut World,
        u: &[[S; 4]],
        (count, asleep): (usize, &[usize]),
        report: &mut StepReport,
    ) {
        report.sleeping = asleep.len() as u32;
        let known = world.resource::<LawBuffers<S>>().evaluations() == self.evaluation;
        let known = known && asleep.iter().all(|&body| self.contains(body));
        self.bodies.0.clear();
        if asleep.is_empty() {
            return;
        }
        self.bodies.0.resize(count, false);
        asleep.iter().for_each(|&body| self.bodies.0[body] = true);
        if !known {
            evaluate(world, u, true, true, None);
            report.evaluations += 1;
        } else {
            // from the second step on, what reports count of their elements holds, too
            put(world, self.bodies.clone());
        }
        world.resource_mut::<LawBuffers<S>>().put_to_sleep(&self.bodies);
    }

    /// Ends it: whoever evaluates elements between two steps evaluates all.
    pub fn end(&mut self, world: &mut World) {
        if !self.bodies.0.is_empty() {
            let mut buffers = world.resource_mut::<LawBuffers<S>>();
            buffers.put_to_sleep(&SleepingBodies::default());
            self.evaluation = buffers.evaluations();
        }
    }

    /// Remembers the world as it is at the end of a step, where so many steps left it as it was and nothing of it moves.
    pub fn keep(&mut self, world: &mut World, steps: u32, energy: f64) {
        if steps < STILL {
            self.still = None;
        } else if self.still.is_none() {
            let mut node = NodeState::default();
            node.read(world);
            node.leave_out_zeros();
            self.still = Some((node, energy));
        }
    }

    /// Whether the world is as it was at the end of the last step: then the coming one would leave it so, too.
    pub fn goes_on(&self, world: &mut World) -> bool {
        let known = world.resource::<LawBuffers<S>>().evaluations() == self.evaluation;
        self.still.as_ref().is_some_and(|(node, _)| known && node.is_as_in(world))
    }

    /// Reports a step of such a world.
    pub fn report(&self, world: &mut World, report: &mut StepReport) {
        put(world, self.bodies.clone());
        report.sleeping = self.bodies.0.len() as u32;
        report.elastic_energy = self.still.as_ref().map_or(0.0, |(_, energy)| *energy);
    }

    /// Whether a body sleeps.
    pub fn contains(&self, body: usize) -> bool {
        self.bodies.contains(body)
    }
}

impl<S: Scalar> StepHistory<S> {
    /// Whether a body bears the loads of the last step, and is held where it was held then.
    pub fn is_loaded_as_before(&self, body: &BodyRows, node: &NodeState<S>) -> bool {
        let rows = body.vertices.start as usize..body.vertices.end as usize;
        let same = |last: &[[S; 4]], now: &[[S; 4]]| {
            last.get(rows.clone()).is_some_and(|last| same_bits(last, &now[rows.clone()]))
        };
        same(&self.external, &node.external) && same(&self.prescribed, &node.prescribed)
    }
}
