//! What the integrators keep from step to step, as data: for snapshots. Everything else that they hold is work space, or
//! follows from the state.

use crate::cg::memory::{Misfit, PreconditionerMemory};
use crate::explicit::ExplicitScratch;
use crate::history::History;
use crate::implicit::ImplicitScratch;
use crate::recovery::BodyState;
use crate::stability::StabilityLimit;
use crate::state::{Rows, read_rest};
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::load::SweptVolumes;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use std::ops::Range;

/// What is kept of solvers that are in use or were.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub struct SolverMemory<S: Scalar> {
    history: Option<History<S>>,
    recovery: Option<Vec<BodyState>>,
    linear: LinearMemory<S>,
    explicit: Option<ExplicitMemory<S>>,
}

/// What is kept of the solvers of groups of bodies, in their order.
pub type LinearMemory<S> = Vec<(Range<usize>, GroupMemory<S>)>;

/// What is kept of the solver of a group of bodies.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub struct GroupMemory<S: Scalar> {
    pub(crate) single: Option<PreconditionerMemory<f32>>,
    pub(crate) full: Option<PreconditionerMemory<S>>,
    /// What the complete factor is the factor of.
    pub(crate) factorised: Option<crate::system::SystemMatrix<S>>,
}

/// What is kept of explicit steps while it holds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub(crate) struct ExplicitMemory<S: Scalar> {
    /// Displacements (m) and elastic energy (J) at the end of the last step.
    pub u: Rows<S>,
    pub elastic: f64,
    /// Elastic force (N) there.
    pub force: Rows<S>,
    /// What displacements (m) cannot hold.
    pub low: Rows<S>,
    pub limit: StabilityLimit<S>,
    pub caution: f64,
    pub creep: f64,
    pub swept: SweptVolumes,
    /// Masses (kg) and held axes that inverse masses and limit belong to.
    pub made_of: (Vec<S>, Vec<FixedAxes>),
}

impl<S: Scalar> SolverMemory<S> {
    /// Copies what is kept in a world; buffers that are there are used again.
    pub fn remember(&mut self, world: &mut World) {
        self.explicit = None;
        if let Some(mut scratch) = world.remove_resource::<ExplicitScratch<S>>() {
            self.explicit = scratch.remember(world);
            world.insert_resource(scratch);
        }
        let Some(mut scratch) = world.remove_resource::<ImplicitScratch<S>>() else {
            (self.history, self.recovery) = (None, None);
            self.linear.clear();
            return;
        };
        scratch.history.remember(world, &mut self.history);
        let topology = world.resource::<Topology>();
        self.recovery = scratch.recovery.memory(topology);
        self.linear = scratch.linear.memory(topology);
        world.insert_resource(scratch);
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

    /// Takes up what was kept. Call it last: it marks the state, laws and rows as those that it belongs to.
    ///
    /// # Errors
    /// When it belongs to other bodies.
    pub fn recall(&self, world: &mut World) -> Result<(), Misfit> {
        let mut scratch = world.remove_resource::<ImplicitScratch<S>>().unwrap_or_default();
        match &self.history {
            None => scratch.history = History::default(),
            Some(history) => {
                scratch.history.clone_from(history);
                scratch.history.stamp_recalled(world);
            }
        }
        let mut rest = std::mem::take(&mut scratch.rest);
        if rest.len() != world.resource::<Topology>().vertex_count() {
            read_rest(world, &mut rest);
        }
        let topology = world.resource::<Topology>();
        scratch.recovery.recall(topology, self.recovery.as_ref());
        let result = scratch.linear.recall(topology, &rest, &self.linear);
        // read again at the next step if rows changed
        scratch.rest = rest;
        world.insert_resource(scratch);
        match &self.explicit {
            None => drop(world.remove_resource::<ExplicitScratch<S>>()),
            Some(memory) => {
                let mut scratch = world.remove_resource::<ExplicitScratch<S>>().unwrap_or_default();
                scratch.recall(world, memory);
                world.insert_resource(scratch);
            }
        }
        result
    }
}

impl<S: Scalar> ExplicitMemory<S> {
    fn fits(&self, rows: usize, edges: usize) -> bool {
        [&self.u, &self.force, &self.low].iter().all(|field| field.len() == rows)
            && [self.made_of.0.len(), self.made_of.1.len()] == [rows; 2]
            && self.limit.fits(rows, edges)
    }
}
