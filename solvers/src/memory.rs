//! Values that the integrators keep from step to step, as data for snapshots. Everything else in them is work space, or
//! follows from the state.

use crate::cg::memory::MemoryMisfit;
use crate::explicit::{ExplicitMemory, ExplicitScratch};
use crate::history::StepHistory;
use crate::implicit::ImplicitScratch;
use crate::linear_solver::LinearMemory;
use crate::recovery::BodyState;
use crate::state::read_rest;
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::resource::{put, take};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::RecentCuts;

/// Kept values of the solvers that were used so far.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub struct SolverMemory<S: Scalar> {
    history: Option<StepHistory<S>>,
    recovery: Option<Vec<BodyState>>,
    linear: LinearMemory<S>,
    explicit: Option<ExplicitMemory<S>>,
}

impl<S: Scalar> SolverMemory<S> {
    /// Copies the kept values of a world; buffers that are there are used again.
    pub fn remember(&mut self, world: &mut World) {
        self.explicit = None;
        if world.contains_resource::<ExplicitScratch<S>>() {
            let mut scratch = take::<ExplicitScratch<S>>(world);
            self.explicit = scratch.remember(world);
            put(world, scratch);
        }
        if !world.contains_resource::<ImplicitScratch<S>>() {
            (self.history, self.recovery) = (None, None);
            self.linear.clear();
            return;
        }
        let mut scratch = take::<ImplicitScratch<S>>(world);
        scratch.history.follow_cuts(world);
        scratch.history.remember(world, &mut self.history);
        let topology = world.resource::<Topology>();
        self.recovery = scratch.recovery.memory(topology);
        self.linear = scratch.linear.memory(topology);
        put(world, scratch);
    }

    /// Whether it can belong to a world of these bodies.
    pub fn fits(&self, topology: &Topology) -> bool {
        let (rows, bodies) = (topology.vertex_count(), topology.bodies.len());
        self.history.as_ref().is_none_or(|history| history.fits(rows, bodies))
            && self.recovery.as_ref().is_none_or(|recovery| recovery.len() == bodies)
            && self.linear.iter().all(|(of, _)| of.start < of.end && of.end <= bodies)
            && self
                .explicit
                .as_ref()
                .is_none_or(|explicit| explicit.fits(rows, topology.edges.len()))
    }

    /// Restores the kept values. Call it last: it marks the present state, laws and rows as those that the values
    /// belong to.
    ///
    /// # Errors
    /// When it belongs to other bodies.
    pub fn recall(&self, world: &mut World) -> Result<(), MemoryMisfit> {
        // the motion that is recalled is that after them
        RecentCuts::<S>::take(world);
        let mut scratch = take::<ImplicitScratch<S>>(world);
        match &self.history {
            None => scratch.history = StepHistory::default(),
            Some(history) => {
                scratch.history.clone_from(history);
                scratch.history.stamp_recalled(world);
            }
        }
        scratch.forget_sleep();
        let mut rest = std::mem::take(&mut scratch.rest);
        // rows of cuts have other places than before
        read_rest(world, &mut rest);
        let topology = world.resource::<Topology>();
        scratch.recovery.recall(topology, self.recovery.as_ref());
        let result = scratch.linear.recall(topology, &rest, &self.linear);
        // read again at the next step if rows changed
        scratch.rest = rest;
        put(world, scratch);
        match &self.explicit {
            None => drop(world.remove_resource::<ExplicitScratch<S>>()),
            Some(memory) => {
                let mut scratch = take::<ExplicitScratch<S>>(world);
                scratch.recall(world, memory);
                put(world, scratch);
            }
        }
        result
    }
}
