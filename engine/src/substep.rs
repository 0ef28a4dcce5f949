//! Loads and prescribed motions between the start and the end of a step, for integrators that cut
//! the step into substeps.

use crate::columns::single_table;
use crate::load::{Constraint, Curve, Load, MotionAt};
use crate::order::Order;
use crate::row::VertexRow;
use crate::scalar::Scalar;
use crate::time::StepClock;
use crate::vertex::{FixedAxes, RestPosition};
use bevy_ecs::prelude::*;
use glam::DVec3;
use std::cmp::Reverse;

/// What varies during one step.
///
/// The columns [`ExternalForce`](crate::vertex::ExternalForce) and
/// [`PrescribedDisplacement`](crate::vertex::PrescribedDisplacement) hold the end of the step and
/// stay the reference, so that what user systems put there in Prepare is kept.
#[derive(Clone, Debug, Default)]
pub struct WithinStep {
    /// Start of the step (s) and its length (s).
    span: [f64; 2],
    /// Vertex rows under loads that vary, ascending.
    pub loaded: Vec<VertexRow>,
    /// Their curves, with the value at the end of the step.
    curves: Vec<(Curve, f64)>,
    /// Index into `loaded`, index into `curves`, force (N) at curve value 1.
    forces: Vec<(u32, u32, DVec3)>,
    /// Held unknowns that move, by row and axis.
    pub moving: Vec<MovingUnknown>,
    /// Constraints that they follow, each with its motion at the time last asked for.
    motions: Vec<(Constraint, MotionAt)>,
}

/// A held unknown that moves through a step.
#[derive(Clone, Copy, Debug)]
pub struct MovingUnknown {
    /// Vertex row.
    pub row: VertexRow,
    /// Axis (0, 1, 2).
    pub axis: u32,
    /// Way (m) through the whole step.
    pub way: f64,
    /// The curve that it follows; evenly without one.
    path: Option<Path>,
}

#[derive(Clone, Copy, Debug)]
struct Path {
    /// Index into [`WithinStep::motions`].
    motion: u32,
    /// Place in the lists of the constraint.
    place: u32,
    /// Rest position (m) of the vertex.
    rest: DVec3,
    /// Displacement (m) by the curve at the start and at the end of the step.
    ends: [f64; 2],
}

impl WithinStep {
    /// Collects what varies during the step that the clock is about to make, once
    /// [`StepSystems::Prepare`](crate::schedule::StepSystems::Prepare) is done.
    ///
    /// Unknowns follow the curve of their constraint. They move evenly where they cannot: when the
    /// curve jumps within the step, or when the column says something else. What the constraint was
    /// off at the start of the step is made up for evenly.
    pub fn read<S: Scalar>(
        &mut self,
        world: &mut World,
        displacement: &[[S; 4]],
        prescribed: &[[S; 4]],
        fixed: &[FixedAxes],
    ) {
        let clock = *world.resource::<StepClock>();
        *self = Self { span: [clock.time, clock.dt], ..Self::default() };
        self.read_loads(world);
        self.read_motions(world, displacement, prescribed, fixed);
    }

    fn read_loads(&mut self, world: &mut World) {
        let [start, dt] = self.span;
        let mut loads = world.query::<(&Order, &Load)>();
        let mut varying: Vec<(&Order, &Load)> =
            loads.iter(world).filter(|(_, l)| l.curve.varies(start, start + dt)).collect();
        varying.sort_by_key(|(order, _)| **order);
        self.loaded = varying.iter().flat_map(|(_, l)| l.forces.iter().map(|f| f.0)).collect();
        self.loaded.sort_unstable();
        self.loaded.dedup();
        for (_, load) in varying {
            let curve = self.curves.len() as u32;
            self.curves.push((load.curve.clone(), load.curve.value(start + dt)));
            for &(row, force) in &load.forces {
                let place = self.loaded.partition_point(|&r| r < row) as u32;
                self.forces.push((place, curve, force));
            }
        }
    }

    fn read_motions<S: Scalar>(
        &mut self,
        world: &mut World,
        displacement: &[[S; 4]],
        prescribed: &[[S; 4]],
        fixed: &[FixedAxes],
    ) {
        let (start, end) = (self.span[0], self.span[0] + self.span[1]);
        let mut rests = world.query::<&RestPosition>();
        let mut constraints = world.query::<(&Order, &Constraint)>();
        let Some(rest) = single_table(rests.contiguous_iter(world)) else { return };
        let mut active: Vec<(&Order, &Constraint)> =
            constraints.iter(world).filter(|(_, c)| c.active(end)).collect();
        active.sort_by_key(|(order, _)| **order);
        let active: Vec<&Constraint> = active.into_iter().map(|(_, c)| c).collect();
        // who holds each unknown: the last constraint in order of creation
        let mut holders: Vec<(VertexRow, u32, Reverse<u32>, u32)> = Vec::new();
        if active.iter().any(|c| c.moves(start, end)) {
            for (index, c) in active.iter().enumerate() {
                for (place, &row) in c.rows.iter().enumerate() {
                    for k in (0..3).filter(|&k| c.axes.holds(k as usize)) {
                        holders.push((row, k, Reverse(index as u32), place as u32));
                    }
                }
            }
            holders.sort_unstable();
            holders.dedup_by_key(|h| (h.0, h.1));
        }
        let mut motion_of = vec![None; active.len()];
        let mut ends = Vec::new();
        for (index, c) in active.iter().enumerate().filter(|(_, c)| c.moves(start, end)) {
            motion_of[index] = Some(self.motions.len());
            self.motions.push(((*c).clone(), c.at(start)));
            ends.push([c.at(start), c.at(end)]);
        }
        let path = |row: VertexRow, axis: usize, to: S| {
            let found = holders.binary_search_by_key(&(row, axis as u32), |h| (h.0, h.1)).ok()?;
            let (_, _, Reverse(index), place) = holders[found];
            let motion = motion_of[index as usize]?;
            let rest = rest[row.index()].0;
            let to_axis = |at| self.motions[motion].0.displacement(at, place as usize, rest)[axis];
            let ends = [to_axis(&ends[motion][0]), to_axis(&ends[motion][1])];
            (S::from_f64(ends[1]) == to).then_some(Path {
                motion: motion as u32,
                place,
                rest,
                ends,
            })
        };
        for (row, held) in fixed.iter().enumerate().filter(|(_, held)| held.0 != 0) {
            for axis in (0..3).filter(|&axis| held.holds(axis)) {
                let to = prescribed[row][axis];
                let way = to.to_f64() - displacement[row][axis].to_f64();
                let row = VertexRow(row as u32);
                let path = path(row, axis, to);
                if path.is_some() || way != 0.0 {
                    self.moving.push(MovingUnknown { row, axis: axis as u32, way, path });
                }
            }
        }
    }

    /// What the loads on `loaded` are off their value (N) at the end of the step, when `part` (0 to
    /// 1) of the step has passed.
    pub fn load_differences(&self, part: f64, differences: &mut Vec<DVec3>) {
        differences.clear();
        differences.resize(self.loaded.len(), DVec3::ZERO);
        if part < 1.0 {
            let t = self.span[0] + part * self.span[1];
            let factors: Vec<f64> = self.curves.iter().map(|(c, end)| c.value(t) - end).collect();
            for &(place, curve, force) in &self.forces {
                differences[place as usize] += force * factors[curve as usize];
            }
        }
    }

    /// Ways (m) of `moving` since the start of the step, when `part` (0 to 1) of it has passed.
    pub fn ways(&mut self, part: f64, ways: &mut Vec<f64>) {
        let t = self.span[0] + part * self.span[1];
        for (constraint, at) in &mut self.motions {
            *at = constraint.at(t);
        }
        ways.clear();
        ways.extend(self.moving.iter().map(|m| match &m.path {
            Some(p) if part < 1.0 => {
                let (constraint, at) = &self.motions[p.motion as usize];
                let now = constraint.displacement(at, p.place as usize, p.rest);
                let [start, end] = p.ends;
                now[m.axis as usize] - start + part * (m.way - (end - start))
            }
            _ => part * m.way,
        }));
    }
}
