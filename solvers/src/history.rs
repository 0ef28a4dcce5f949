//! The last step, as multistep integrators remember it, and whether it still holds.

use crate::state::{NodeState, Rows};
use bevy_ecs::change_detection::Tick;
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ActiveLaws, law_inputs_unchanged};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{FixedAxes, RecentCuts};
use std::ops::Range;

/// Ratios of step lengths over which BDF2 uses the last step; beyond them it starts again.
const RATIOS: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// The last step.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub(crate) struct StepHistory<S> {
    /// Displacements (m) and velocities (m/s) at its end, masses (kg) and held axes.
    pub u: Rows<S>,
    pub v: Rows<S>,
    pub mass: Vec<S>,
    pub fixed: Vec<FixedAxes>,
    /// External forces (N) and displacements (m) of held axes at its end, where bodies may [sleep](crate::sleep); else empty.
    pub external: Rows<S>,
    pub prescribed: Rows<S>,
    /// Steps in a row in which everyone slept.
    pub asleep: u32,
    /// Displacement (m) during it, and velocities (m/s) at its start.
    pub increment: Rows<S>,
    pub v_before: Rows<S>,
    /// Velocities (m/s) one and two steps before that.
    pub v_older: [Rows<S>; 2],
    /// Its length (s).
    pub dt: f64,
    /// The history of a group of bodies stands at the place of its first body; those of the others are empty.
    pub bodies: Vec<BodyHistory>,
    /// Bodies that shared a solve.
    pub groups: Vec<Range<usize>>,
    /// Values of the low-rank vectors (volumes of clusters) that the last linear solves predicted, body by body.
    pub predicted: Vec<Vec<f64>>,
    #[serde(skip)]
    revision: u64,
    /// Changes of each body until then.
    #[serde(skip)]
    changes: Vec<u64>,
    #[serde(skip)]
    laws: usize,
    #[serde(skip)]
    tick: Option<Tick>,
    /// The energies do not hold whatever the laws say: they did not when this was recalled.
    void: bool,
    /// Bodies whose part did not hold then; empty where all did.
    stale: Vec<bool>,
}

/// The last step of a body.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct BodyHistory {
    /// Elastic energy (J) at the end of the step.
    pub elastic: f64,
    /// Energy budget less the energy (J) at the end of the step; below zero where only the tolerance let it through.
    pub excess: f64,
    /// Largest kinetic and elastic energy (J) of late.
    pub largest: f64,
    /// Number of coming steps that have to be safe steps.
    pub wait: u32,
    /// Number of steps that led to its end without a change from outside; what is stored of earlier ones is of another state.
    pub depth: usize,
    /// For how long (s) all its vertices have been as slow as bodies that [sleep](crate::sleep).
    pub calm: f64,
}

impl BodyHistory {
    /// Makes the energies allow nothing.
    pub fn forget_energies(&mut self) {
        (self.excess, self.largest) = (0.0, 0.0);
    }
}

/// The part of a body's history that holds at the start of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Past {
    /// The state is that of the last step's end.
    pub same_state: bool,
    /// It is, and so are masses and held axes.
    pub same_hold: bool,
    /// They are, and the step length lets BDF2 use the last step.
    pub history_holds: bool,
    pub body: BodyHistory,
}

impl Past {
    /// Of bodies that share a solve; unless they did so in the last step, their energies are not known.
    pub fn of_group(bodies: &[Self], same_groups: bool) -> Self {
        let wait = bodies.iter().map(|past| past.body.wait).max().unwrap_or(0);
        let mut body = BodyHistory { wait, ..bodies[0].body };
        if !same_groups {
            body.forget_energies();
        }
        Self {
            same_state: same_groups && bodies.iter().all(|past| past.same_state),
            same_hold: bodies.iter().all(|past| past.same_hold),
            history_holds: bodies.iter().all(|past| past.history_holds),
            body,
        }
    }
}

impl<S: Scalar> StepHistory<S> {
    /// Compares the state with the end of the last step, body by body; `dt` is the length (s) of the
    /// step to come. Also whether the elastic energies then still hold: a changed constant leaves the
    /// motion before it as it was, but voids energies and what they allow.
    pub fn compare(&self, world: &mut World, node: &NodeState<S>, dt: f64) -> (bool, Vec<Past>) {
        let energies = self.energies_hold(world);
        let topology = world.resource::<Topology>();
        let past = (0..topology.bodies.len()).map(|index| {
            let Some(&body) = self.bodies.get(index).filter(|_| self.holds(topology, index)) else {
                return Past::default();
            };
            let rows = &topology.bodies[index].vertices;
            let rows = rows.start as usize..rows.end as usize;
            let same_state = self.u[rows.clone()] == node.u[rows.clone()]
                && self.v[rows.clone()] == node.v[rows.clone()];
            let same_hold = same_state
                && self.mass[rows.clone()] == node.mass[rows.clone()]
                && self.fixed[rows.clone()] == node.fixed[rows];
            let history_holds = same_hold && RATIOS.contains(&(dt / self.dt));
            Past { same_state, same_hold, history_holds, body }
        });
        (energies, past.collect())
    }

    /// Whether the elastic energies are those of the laws as they are.
    pub fn energies_hold(&self, world: &mut World) -> bool {
        let revision = world.resource::<Topology>().revision;
        let laws = world.get_resource::<ActiveLaws>().map_or(0, |laws| laws.0.len());
        let tick = self.tick.filter(|_| self.revision == revision && self.laws == laws);
        !self.void && tick.is_some_and(|tick| law_inputs_unchanged(world, tick))
    }

    /// Goes on through the cuts since the end of the last step: copies moved as the vertices did in whose place they are. The
    /// energies do not go on.
    pub fn follow_cuts(&mut self, world: &mut World) {
        let cuts = RecentCuts::<S>::take(world);
        if cuts.is_empty() {
            return;
        }
        let topology = world.resource::<Topology>();
        // nothing else may have changed it
        let follows = |(body, rows): (usize, &BodyRows)| {
            let count = cuts.iter().filter(|cut| cut.body == body).count() as u64;
            count > 0
                && self.changes.get(body).map(|changes| changes + count) == Some(rows.changes)
                && rows.vertices.end as usize <= self.u.len()
        };
        let follows: Vec<bool> = topology.bodies.iter().enumerate().map(follows).collect();
        let Self { u, v, increment, v_before, v_older: [older, oldest], .. } = self;
        let mut fields = [u, v, increment, v_before, older, oldest];
        for cut in cuts.iter().filter(|cut| follows[cut.body]) {
            for [to, from] in cut.copies.iter().map(|rows| rows.map(|row| row as usize)) {
                // the first steps have none before them
                for field in fields.iter_mut().filter(|field| to.max(from) < field.len()) {
                    field[to] = field[from];
                }
                self.fixed[to] = FixedAxes::NONE;
            }
            for &(row, [before, after]) in &cut.masses {
                let known = &mut self.mass[row as usize];
                if *known == before {
                    *known = after;
                }
            }
            self.changes[cut.body] = topology.bodies[cut.body].changes;
            // it may have divided clusters
            self.predicted.get_mut(cut.body).into_iter().for_each(Vec::clear);
        }
    }

    /// Whether the part of a body is of its rows and elements: bodies that come, and elements that others lose, do not change it.
    fn holds(&self, topology: &Topology, body: usize) -> bool {
        let rows = topology.bodies[body].vertices.end as usize;
        let same = || self.changes.get(body) == Some(&topology.bodies[body].changes);
        self.tick.is_some()
            && body < self.bodies.len()
            && rows <= self.u.len()
            && self.stale.get(body) != Some(&true)
            && (self.revision == topology.revision || same())
    }

    /// As it is to be recalled, into `memory`; `None` where nothing of it holds.
    pub fn remember(&self, world: &mut World, memory: &mut Option<Self>) {
        let void = !self.energies_hold(world);
        let topology = world.resource::<Topology>();
        let stale: Vec<bool> =
            (0..self.bodies.len()).map(|body| !self.holds(topology, body)).collect();
        if !stale.contains(&false) {
            *memory = None;
            return;
        }
        match memory {
            Some(memory) => memory.clone_from(self),
            None => *memory = Some(self.clone()),
        }
        if let Some(memory) = memory {
            memory.void = void;
            memory.stale = if stale.contains(&true) { stale } else { Vec::new() };
            memory.keep_rows(topology.vertex_count());
        }
    }

    /// Leaves out the rows of bodies that have gone.
    fn keep_rows(&mut self, rows: usize) {
        let Self {
            u, v, external, prescribed, increment, v_before, v_older: [older, oldest], ..
        } = self;
        for field in [u, v, external, prescribed, increment, v_before, older, oldest] {
            field.truncate(rows);
        }
        self.mass.truncate(rows);
        self.fixed.truncate(rows);
    }

    /// Whether it can belong to so many vertex rows and bodies.
    pub fn fits(&self, rows: usize, bodies: usize) -> bool {
        // bodies may have come since
        let (own, own_bodies) = (self.u.len(), self.bodies.len());
        let lengths = [&self.v, &self.increment, &self.v_before].map(|field| field.len() == own);
        // the first steps have none before them, and bodies that came later had no rows then
        let older = self.v_older.iter().all(|v| v.len() <= own);
        let loads = [&self.external, &self.prescribed].map(Vec::len);
        let groups = self.groups.iter().map(|group| group.start..group.end);
        (loads == [0; 2] || loads == [own; 2])
            && lengths == [true; 3]
            && older
            && own <= rows
            && own_bodies <= bodies
            && self.mass.len() == own
            && self.fixed.len() == own
            && self.predicted.len() <= own_bodies
            && self.stale.len() <= own_bodies
            && groups
                .clone()
                .map(|group| group.start)
                .eq(std::iter::once(0).chain(groups.map(|group| group.end)).take(self.groups.len()))
            && self.groups.last().is_none_or(|last| last.end == own_bodies)
            && self.groups.iter().all(|group| group.start < group.end)
    }

    /// Marks that it describes the state as it is now, after it was recalled.
    pub fn stamp_recalled(&mut self, world: &mut World) {
        let (void, stale) = (self.void, std::mem::take(&mut self.stale));
        self.stamp(world);
        (self.void, self.stale) = (void, stale);
    }

    /// Marks that it describes the state as it is now.
    pub fn stamp(&mut self, world: &mut World) {
        self.void = false;
        self.stale.clear();
        let topology = world.resource::<Topology>();
        self.revision = topology.revision;
        self.changes.clear();
        self.changes.extend(topology.bodies.iter().map(|body| body.changes));
        self.laws = world.get_resource::<ActiveLaws>().map_or(0, |laws| laws.0.len());
        // what is changed from here on has a later tick
        self.tick = Some(world.increment_change_tick());
    }
}
