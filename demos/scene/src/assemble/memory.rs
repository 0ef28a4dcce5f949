//! The state of a scene, which is that of its simulation and of what the scene itself moves.

use super::cuts::CutSummary;
use super::removal::ResectionSummary;
use super::scene::BuiltScene;
use super::threads::BuiltThread;
use bevy_ecs::prelude::Entity;
use serde::{Deserialize, Serialize};
use sinew::engine::order::Order;
use sinew::snapshot::{Snapshot, SnapshotError, checksum};
use std::collections::BTreeMap;

/// The state of a scene at one time.
#[derive(Clone, Debug)]
pub struct SceneSnapshot {
    /// That of its simulation.
    pub simulation: Snapshot,
    memory: Memory,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Memory {
    /// Until when (s) resections act, and what they did.
    resections: Vec<(f64, ResectionSummary)>,
    /// What cuts did that were made.
    cuts: Vec<Option<CutSummary>>,
    /// Pulls that act, and what the others did (J).
    pulls: Vec<(Option<Order>, f64)>,
    /// Threads and clips that act.
    lines: Vec<Option<Order>>,
}

impl SceneSnapshot {
    /// As bytes, for a file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let parts = (&self.memory, self.simulation.to_bytes());
        let mut bytes = postcard::to_stdvec(&parts).expect("data without maps of unknown length");
        bytes.extend(checksum(&bytes).to_le_bytes());
        bytes
    }

    /// Reads what [`SceneSnapshot::to_bytes`] wrote.
    ///
    /// # Errors
    /// When they are anything else.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, SnapshotError> {
        let damaged = |what| SnapshotError::Damaged { what };
        let (parts, sum) = bytes.split_last_chunk().ok_or(damaged("it ends early"))?;
        if checksum(parts) != u64::from_le_bytes(*sum) {
            return Err(damaged("its checksum is wrong"));
        }
        let (memory, simulation): (Memory, Vec<u8>) =
            postcard::from_bytes(parts).map_err(|_| damaged("its parts"))?;
        Ok(Self { memory, simulation: Snapshot::from_bytes(&simulation)? })
    }
}

impl BuiltScene {
    /// Threads and clips.
    fn lines(&self) -> impl Iterator<Item = &BuiltThread> {
        self.strands.iter().chain(&self.clips)
    }

    /// The state of the scene: what its simulation holds, and how far resections and pulls are.
    ///
    /// # Errors
    /// As [`Simulation::snapshot`](sinew::simulation::Simulation::snapshot).
    pub fn snapshot(&mut self) -> Result<SceneSnapshot, SnapshotError> {
        let simulation = self.simulation.snapshot()?;
        let world = self.simulation.world();
        let order = |pull| world.get::<Order>(pull).copied();
        let pulls = self.pulls.iter();
        let memory = Memory {
            pulls: pulls.map(|pull| (pull.entity().and_then(order), pull.work())).collect(),
            lines: self.lines().map(|line| line.entity().and_then(order)).collect(),
            resections: self.resections.iter().map(|r| (r.until(), r.summary.clone())).collect(),
            cuts: self.cuts.iter().map(|cut| cut.done.then(|| cut.summary.clone())).collect(),
        };
        Ok(SceneSnapshot { simulation, memory })
    }

    /// Takes up a state of this scene, or of one built alike.
    ///
    /// # Errors
    /// As [`Simulation::restore`](sinew::simulation::Simulation::restore); nothing is changed then.
    pub fn restore(&mut self, snapshot: &SceneSnapshot) -> Result<(), SnapshotError> {
        let SceneSnapshot { simulation, memory } = snapshot;
        if (memory.resections.len(), memory.pulls.len(), memory.cuts.len(), memory.lines.len())
            != (self.resections.len(), self.pulls.len(), self.cuts.len(), self.lines().count())
        {
            return Err(SnapshotError::Scene);
        }
        self.simulation.restore(simulation)?;
        let world = self.simulation.world_mut();
        let now: BTreeMap<Order, Entity> =
            world.query::<(&Order, Entity)>().iter(world).map(|(o, e)| (*o, e)).collect();
        for (own, (until, summary)) in self.resections.iter_mut().zip(&memory.resections) {
            own.resume(*until, summary.clone());
        }
        for (own, summary) in self.cuts.iter_mut().zip(&memory.cuts) {
            own.resume(summary.as_ref());
        }
        for (own, (order, work)) in self.pulls.iter_mut().zip(&memory.pulls) {
            own.resume(order.and_then(|order| now.get(&order).copied()), *work);
        }
        let lines = self.strands.iter_mut().chain(&mut self.clips);
        for (own, order) in lines.zip(&memory.lines) {
            own.resume(order.and_then(|order| now.get(&order).copied()));
        }
        Ok(())
    }
}
