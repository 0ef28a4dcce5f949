//! All contact of a world during a step: the points that may be touched, their forces at any state, the state that is
//! kept, and the reports at the end.

use crate::beside::{Beside, Facet, NearFaces, NearFacet, ROUNDING, beside, distance};
use crate::edge::EdgeState;
use crate::limits::Limits;
use crate::needle::NeedleNow;
use crate::pair::{BodyContact, BodyContactReport};
use crate::point::{
    Active, Against, ContactPoint, EdgeNow, Hand, NO_ROW, PartNow, PointKey, PointMemory,
    RigidPose, Side, outer,
};
use crate::pull::{Pull, PullReport};
use crate::skin::{ContactSkin, EMPTY, MadePoints, corners, face_points, grown, overlap};
use crate::tool::{MOST_POINTS, Points, Stiffness, Tool, ToolMotion, ToolPose, ToolReport};
use bevy_ecs::prelude::*;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::kept::with_query;
use sinew_engine::order::Order;
use sinew_engine::report::ContactFigures;
use sinew_engine::row::VertexRow;
use sinew_engine::step::StepError;
use sinew_engine::surface::SurfaceReader;
use sinew_engine::time::{StepClock, StepPart};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{FixedAxes, RestPosition};
use std::collections::BTreeMap;
use std::ops::Range;

mod lines;
mod near;
mod pairs;
mod points;
mod report;
mod springs;

pub use springs::GivenBack;
use springs::SpringNow;

/// Part of its thickness that a tool may move at once: no point can then pass its middle. The second is for tools
/// thinner than the edges of the surface, which would work themselves under it.
const LONGEST_WAY: [f64; 2] = [0.9, 0.4];
/// Most substeps that a step is cut into for a fast tool.
pub const MOST_SUBSTEPS: u32 = 8;
/// Part of the mean edge by which points may be inside of a tool that appears before it is drawn in.
const INSIDE: f64 = 0.25;
/// Speed (m/s) at which a tool that was drawn in grows again, a hand's: the time that a body is given does not scale
/// with it.
const GROWTH: f64 = 0.1;
/// Depth over the mean edge beyond which a point that did not touch is taken to be behind a body, not inside of it.
const DEEP: f64 = 0.35;
/// Roundings of a place on its way to a distance.
const ROUNDINGS: f64 = 4.0;
/// Thickness of a tool over the mean edge from which vertices are dense enough.
const DENSE: f64 = 2.0;

/// Positions (m) of vertex rows: now, and at the start of the step.
#[derive(Clone, Copy)]
pub struct RowPlaces<'a> {
    /// Now.
    pub now: &'a dyn Fn(VertexRow) -> DVec3,
    /// At the start of the step.
    pub start: &'a dyn Fn(VertexRow) -> DVec3,
}

/// Blocks that contact adds to the matrix of a step: `sum_q B_q^T C_q B_q` with `B_q` the shares of a point.
#[derive(Clone, Debug, Default)]
pub struct ContactBlocks {
    /// Blocks (N/m) of points of one vertex row, ascending, each row once.
    pub diagonal: Vec<(u32, DMat3)>,
    /// Points of several rows, ascending by their lowest: those that share rows are then near each other.
    pub couplings: Vec<Coupling>,
    /// Vectors `v` (N/m)^(1/2) of threads and clips, which add `v v^T`: rows, ascending, and what `v` has there.
    pub vectors: Vec<Vec<(u32, DVec3)>>,
    /// What tools on springs give back.
    pub given: Vec<GivenBack>,
}

/// Most vertex rows of a point between bodies: those of an element on either side, where both were cut.
pub const COUPLED: usize = 20;

/// A point of several rows: it adds the blocks `w_a w_b (C + s s^T)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Coupling {
    /// Vertex rows, each once.
    pub rows: [u32; COUPLED],
    /// Their shares, 0 for unused ones.
    pub weights: [f64; COUPLED],
    /// Number of the used ones, which come first.
    pub count: u32,
    /// `C` (N/m).
    pub block: DMat3,
    /// `s`: the normal times the root of the stiffness along it (N/m)^(1/2).
    pub stiff: DVec3,
}

impl Coupling {
    /// Of rows that may come several times; the lowest stands for those that are not used.
    fn new(used: impl Iterator<Item = (VertexRow, f64)>, block: DMat3, stiff: DVec3) -> Self {
        let (mut rows, mut weights) = ([u32::MAX; COUPLED], [0.0; COUPLED]);
        for (row, weight) in used {
            let known = rows.iter().position(|own| *own == row.0 || *own == u32::MAX);
            debug_assert!(known.is_some(), "more rows than two elements have");
            let at = known.unwrap_or(COUPLED - 1);
            rows[at] = row.0;
            weights[at] += weight;
        }
        let first = rows[0];
        let count = rows.iter().filter(|row| **row != u32::MAX).count() as u32;
        rows.iter_mut().filter(|row| **row == u32::MAX).for_each(|row| *row = first);
        Self { rows, weights, count, block, stiff }
    }

    /// Rows that it uses, with their shares.
    pub fn used(&self) -> impl Iterator<Item = (u32, f64)> + '_ {
        let all = self.rows.iter().copied().zip(self.weights).take(self.count as usize);
        all.filter(|(_, weight)| *weight != 0.0)
    }

    /// `C + s s^T`.
    pub fn whole(&self) -> DMat3 {
        self.block + outer(self.stiff, self.stiff)
    }
}

/// State of a tool that is kept from step to step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct ToolState {
    /// Of the tool, or of the hand that holds it by a spring.
    pose: ToolPose,
    /// Way (m) from there to the tool.
    yields: DVec3,
    drawn_in: Vec<f64>,
    /// Parts that went through the surface of a body, and the bodies.
    pierced: Vec<[usize; 2]>,
    work: f64,
    dissipation: f64,
}

impl ToolState {
    /// Where the step to come begins: the pose of the hand, if a spring holds the tool.
    fn start(&self, tool: &Tool) -> ToolPose {
        if tool.spring.is_some() { self.pose } else { self.of_tool() }
    }

    /// Where the tool itself is.
    fn of_tool(&self) -> ToolPose {
        ToolPose { position: self.pose.position + self.yields, ..self.pose }
    }
}

/// Work (J) and dissipation (J) of a tool or hand in the substeps of a step.
#[derive(Clone, Copy, Debug, Default)]
struct Settled {
    work: f64,
    dissipation: f64,
}

/// A tool in this step.
#[derive(Clone, Debug)]
struct ToolNow {
    entity: Entity,
    id: Order,
    name: String,
    start: ToolPose,
    end: ToolPose,
    /// Where what is left of the step begins, in substeps, and where it has come to in it.
    begin: ToolPose,
    reached: ToolPose,
    /// Where it is from there, if a spring holds it; then these are the poses of the hand.
    spring: SpringNow,
    /// Its points have tangents with the curvature of its parts.
    curved: bool,
    /// Distance (m) to its target that is left.
    lag: f64,
    /// It appears, or was put elsewhere, in this step.
    appears: bool,
    /// Parts that went through the surface of a body, and the bodies.
    pierced: Vec<[usize; 2]>,
    /// Energy (J) that its contacts with them had stored.
    released: f64,
    tool: Tool,
    parts: Range<usize>,
}

/// State of a contact of bodies that is kept from step to step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct PairState {
    /// How far (m) the surfaces are drawn in of bodies that appeared inside of each other.
    drawn_in: f64,
    /// Unit vector along which the first of these leaves the second: meanwhile nothing but faces that look that way are touched,
    /// since the nearest side may be the wrong one.
    out: DVec3,
    /// Way (m) that points and faces of a body that touches itself may come together before any is looked for again.
    clear: f64,
}

/// A contact of bodies or a pull in this step.
#[derive(Clone, Debug)]
struct Now<T> {
    entity: Entity,
    id: Order,
    of: T,
}

/// The contact surface of a body, and the version of the body that it was made for.
#[derive(Clone, Debug, Default)]
struct KnownSkin {
    version: (u64, u64),
    skin: ContactSkin,
}

/// State that contact keeps from step to step; all else follows from the entities and the state of the bodies.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactMemory {
    tools: BTreeMap<Order, ToolState>,
    /// By key, ascending.
    points: Vec<(PointKey, PointMemory)>,
    /// Of the pairs that were there.
    pairs: BTreeMap<Order, PairState>,
    lines: BTreeMap<Order, lines::LineState>,
    /// Energy (J) that friction of pairs has taken.
    dissipated: BTreeMap<Order, f64>,
    /// Forces (N) at the end of the last step, and pressures (Pa), of vertex rows.
    forces: Vec<(VertexRow, DVec3)>,
    pressures: Vec<(VertexRow, f64)>,
    /// Energy (J) stored at the end of the last step, and that of threads and clips in it.
    stored: f64,
    of_lines: f64,
}

impl ContactMemory {
    /// Whether it can belong to a world of so many bodies and vertex rows.
    pub fn fits(&self, bodies: usize, rows: usize) -> bool {
        let row = |row: &VertexRow| row.index() < rows;
        self.points.iter().all(|(key, _)| (key.body as usize) < bodies)
            && self.points.is_sorted_by_key(|(key, _)| *key)
            && self.forces.iter().all(|(of, _)| row(of))
            && self.pressures.iter().all(|(of, _)| row(of))
    }
}

/// Tools, contact between bodies and pulls of a world. It exists from the first of them on.
#[derive(Resource, Clone, Debug, Default)]
pub struct ContactSet {
    kept: ContactMemory,
    skins: Vec<KnownSkin>,
    made: MadePoints,
    /// Surfaces of tools that touch some faces only, by tool and body.
    own_skins: BTreeMap<(Order, usize), KnownSkin>,
    tools: Vec<ToolNow>,
    parts: Vec<PartNow>,
    pairs: Vec<Now<BodyContact>>,
    pulls: Vec<Now<Pull>>,
    /// Threads and clips, what is left of those that hold no more, and the rows that points were found at.
    lines: Vec<lines::Line>,
    left: Vec<(Entity, Order, lines::LineState)>,
    holds: BTreeMap<Order, lines::KnownHolds>,
    points: Vec<ContactPoint>,
    /// First point of every body, and the number of all.
    first: Vec<usize>,
    active: Vec<Active>,
    /// Points of the last round of an inner loop, and their places (m).
    rounds: Vec<(Active, DVec3)>,
    faces: Vec<NearFacet>,
    /// Places (m) of the rows of surfaces that may meet faces, at the last evaluation.
    places: Vec<DVec3>,
    /// What of other bodies each point was beside there, if it was looked at.
    beside: Vec<Option<Option<Beside>>>,
    figures: ContactFigures,
    /// Local stiffnesses (N/m) found in this step, by tool.
    local: Vec<(usize, DMat3)>,
    /// Energy (J) that threads and clips got since the last step: those that were laid, lost points or were taken away.
    laid: f64,
    /// Work and dissipation in the substeps of the step: of each tool, then of each pull.
    settled: Vec<Settled>,
    /// Whether surfaces are fitted to the bodies as the last step found them.
    fitted: bool,
    /// The kept state before the first part of a step in parts, and the number of that step.
    before_parts: Option<(u64, Box<ContactMemory>)>,
}

impl ContactSet {
    /// The kept state with which the step after `step` steps begins.
    pub fn memory(&self, step: u64) -> &ContactMemory {
        match &self.before_parts {
            // that step failed in a later part, and is made again
            Some((of, before)) if *of == step => before,
            _ => &self.kept,
        }
    }

    /// Restores the kept state of another world of the same entities, or of another time.
    pub fn recall(&mut self, memory: &ContactMemory) {
        self.kept.clone_from(memory);
        self.before_parts = None;
    }

    /// Finds the points that may touch something in the coming step. `x` and `v` are positions (m) and velocities (m/s)
    /// of vertex rows. With `limit_ways` a tool whose way through tissue is longer than it
    /// is thick does not reach its end: integrators with small steps of their own do not need that. In a world that is `still`
    /// all bodies are where the last step found them, at rest.
    ///
    /// # Errors
    /// When a tool, contact or pull cannot be used.
    pub fn prepare(
        &mut self,
        world: &mut World,
        x: &dyn Fn(VertexRow) -> DVec3,
        v: &dyn Fn(VertexRow) -> DVec3,
        [limit_ways, still]: [bool; 2],
    ) -> Result<(), StepError> {
        self.fitted &= still;
        let clock = *world.resource::<StepClock>();
        self.figures = ContactFigures::default();
        self.local.clear();
        self.read(world)?;
        self.points.clear();
        self.faces.clear();
        if !self.tools.is_empty() || !self.pairs.is_empty() {
            self.know(world)?;
            if !self.fitted {
                self.refit(world, clock.dt, x, v);
            }
            if limit_ways {
                self.limit_ways();
            }
            self.find_tool_points();
            self.find_edge_points(world);
            self.find_needle_points(world);
            self.find_pair_points();
            self.fitted = true;
        } else {
            self.fitted = false;
        }
        self.find_pull_points(world, x);
        self.find_lines(world, x)?;
        self.laid = self.line_books()[0] - self.kept.of_lines;
        self.settled = vec![Settled::default(); self.tools.len() + self.pulls.len()];
        // they are large, and mostly come in order
        self.points.sort_by_key(|point| point.key);
        let bodies = world.resource::<Topology>().bodies.len();
        self.first.clear();
        for body in 0..=bodies as u32 {
            self.first.push(self.points.partition_point(|point| point.key.body < body));
        }
        self.active.clear();
        self.active.resize(self.points.len(), Active::default());
        self.beside.clear();
        self.beside.resize(self.points.len(), None);
        let made = &self.made;
        for point in &mut self.points {
            point.start = point.at(&|row| made.mean(row, x));
        }
        self.set_part(1.0);
        self.let_go();
        Ok(())
    }

    /// All bodies.
    pub fn bodies(&self) -> Range<usize> {
        0..self.first.len().saturating_sub(1)
    }

    /// Bounds on the largest frequency (1/s) that contacts alone could give vertices of these masses (kg), and on the
    /// rate (1/s) at which pulls damp them.
    pub fn rates(&self, mass: &dyn Fn(VertexRow) -> f64) -> [f64; 2] {
        let mut rows: Vec<(VertexRow, f64, f64)> = Vec::new();
        for point in &self.points {
            let damping = match point.against {
                Against::Hand(hand) => hand.damping * point.area,
                _ => 0.0,
            };
            // vertices of the face on the other side bear at most as much; of ten-node tetrahedra some shares are below 0
            let used = || self.made.expand(point.rows, point.weights);
            let all = |sum: f64| sum.max(1.0);
            let sum = all(used().map(|(_, w)| w.abs()).sum());
            let [rate, damping] = [point.area * point.k * sum, damping * sum];
            rows.extend(used().map(|(row, w)| (row, w.abs() * rate, w.abs() * damping)));
            if let Against::Faces(range) = &point.against {
                for of in self.faces[range.clone()].iter().flat_map(|face| face.rows) {
                    let sum = all(self.made.rows(of).map(|(_, w)| w.abs()).sum());
                    let rate = point.area * point.k * sum;
                    rows.extend(self.made.rows(of).map(|(row, w)| (row, w.abs() * rate, 0.0)));
                }
            }
        }
        rows.extend(self.line_rates());
        rows.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut most = [0.0_f64; 2];
        for own in rows.chunk_by(|a, b| a.0 == b.0) {
            let m = mass(own[0].0);
            if m > 0.0 {
                let sum =
                    |of: fn(&(VertexRow, f64, f64)) -> f64| own.iter().map(of).sum::<f64>() / m;
                most = [most[0].max(sum(|r| r.1)), most[1].max(sum(|r| r.2))];
            }
        }
        [most[0].sqrt(), most[1]]
    }

    /// Change of the stored energy (J) since the start of a step in substeps, and the work (J) that tools and hands
    /// did in it, both up to the last [`settle`](Self::settle).
    pub fn books(&self) -> [f64; 2] {
        let now: f64 = self.points.iter().zip(&self.active).map(|(p, a)| stored(p, a)).sum();
        let [of_lines, work] = self.line_books();
        let change = now + of_lines + self.spring_energy() - self.kept.stored;
        [change, self.laid + work + self.settled.iter().map(|own| own.work).sum::<f64>()]
    }

    /// Whether nothing can touch or pull anything in this step.
    pub fn is_idle(&self) -> bool {
        self.points.is_empty() && self.lines.is_empty()
    }

    /// Puts all tools and hands where they are when `part` of the step has passed.
    pub fn set_part(&mut self, part: f64) {
        for own in &mut self.tools {
            own.reached = own.begin.towards(&own.end, part);
        }
        for own in &mut self.parts {
            own.now = own.start.towards(&own.end, part);
            own.now.centre += self.tools[own.tool].spring.way();
        }
        self.lines.iter_mut().for_each(|line| line.set_part(part));
        let parts = &self.parts;
        for point in &mut self.points {
            match &mut point.against {
                Against::Part(index) => {
                    let own = &parts[*index];
                    point.slip = own.start.turn(point.memory.slip, &own.now);
                    point.carried = own.start.carry(point.start, &own.now);
                    let keeps = self.tools[own.tool].tool.keeps_side
                        && !own.of.cavity
                        && point.memory.pressure > 0.0;
                    let normal = own.start.turn(point.memory.normal, &own.now);
                    point.side.normal = if keeps { normal } else { DVec3::ZERO };
                    point.choose_side(own);
                }
                Against::Hand(hand) => {
                    point.carried = match part {
                        1.0 => hand.to,
                        _ => hand.from + (hand.to - hand.from) * part,
                    }
                }
                Against::Edge(edge) => {
                    let ToolNow { tool, begin, end, spring, .. } = &self.tools[edge.tool];
                    let (pose, first) = (begin.towards(end, part), tool.start.opening);
                    if let Some(own) = &tool.edge {
                        point.carried = own.place(edge.local, &pose, first) + spring.now;
                    }
                    if part == 0.0 {
                        edge.from = point.carried - spring.way();
                    }
                }
                Against::Needle(own) => {
                    own.now = own.start.towards(&own.end, part);
                    own.now.centre += self.tools[own.tool].spring.way();
                }
                Against::Faces(_) => {}
            }
        }
    }

    /// Says which velocities the dampers of pulls on some bodies meet: `(d - offset) / span` (m/s) where a row has moved
    /// by `d` (m) since the start of the step. A `span` (s) without end leaves them silent.
    pub fn set_dampers(
        &mut self,
        bodies: &Range<usize>,
        span: f64,
        offset: &dyn Fn(VertexRow) -> DVec3,
    ) {
        let range = self.range(bodies);
        for point in &mut self.points[range] {
            let Against::Hand(hand) = &mut point.against else { continue };
            (hand.rate, hand.silent) = (hand.damping / span, DVec3::ZERO);
            if hand.rate > 0.0 {
                let offsets = point.rows.iter().zip(point.weights).map(|(&row, w)| w * offset(row));
                hand.silent = offsets.sum::<DVec3>() + span * hand.velocity;
            }
        }
    }

    /// Consecutive bodies that share a solve: alone, but for those that may touch each other and those between them.
    pub fn groups(&self, bodies: usize) -> Vec<Range<usize>> {
        let mut last: Vec<usize> = (0..bodies).collect();
        for now in &self.pairs {
            let [a, b] = now.of.bodies;
            let (low, high) = (a.min(b), a.max(b));
            let of_pair =
                |p: &ContactPoint| p.key.owner == now.id && matches!(p.against, Against::Faces(_));
            if low != high && self.points.iter().any(of_pair) {
                last[low] = last[low].max(high);
            }
        }
        let by_lines = self.lines.iter().map(|line| line.bodies.clone());
        for joined in by_lines.chain(self.joined_by_springs()) {
            last[joined.start] = last[joined.start].max(joined.end - 1);
        }
        let mut groups = Vec::new();
        let mut first = 0;
        while first < bodies {
            let (mut end, mut body) = (last[first], first);
            while body < end {
                body += 1;
                end = end.max(last[body]);
            }
            groups.push(first..end + 1);
            first = end + 1;
        }
        groups
    }

    fn range(&self, bodies: &Range<usize>) -> Range<usize> {
        match (self.first.get(bodies.start), self.first.get(bodies.end)) {
            (Some(&start), Some(&end)) => start..end,
            _ => 0..0,
        }
    }

    /// Whether something may touch or pull one of the bodies.
    pub fn touches(&self, bodies: &Range<usize>) -> bool {
        !self.range(bodies).is_empty() || self.ties(bodies)
    }

    /// Whether threads or clips hold some bodies.
    pub fn ties(&self, bodies: &Range<usize>) -> bool {
        self.lines(bodies).next().is_some()
    }

    /// Whether surfaces of bodies may touch each other among some bodies.
    pub fn joins(&self, bodies: &Range<usize>) -> bool {
        let faces = |point: &ContactPoint| matches!(point.against, Against::Faces(_));
        self.points[self.range(bodies)].iter().any(faces)
    }

    /// Energy (J) of the contacts of some bodies at positions `x`; forces and tangents are kept until the next call.
    /// The forces of friction are those with the limits of the last call that did not keep them.
    pub fn evaluate(&mut self, bodies: &Range<usize>, x: &RowPlaces, limits: Limits) -> f64 {
        let springs = self.balance(&self.range(bodies), x);
        let points = self.evaluate_points(bodies, x, limits);
        if springs > 0.0 && limits != Limits::Keep {
            // with the new limits tools are elsewhere
            let springs = self.balance(&self.range(bodies), x);
            return springs + self.evaluate_points(bodies, x, Limits::Keep);
        }
        springs + points
    }

    fn evaluate_points(&mut self, bodies: &Range<usize>, x: &RowPlaces, limits: Limits) -> f64 {
        let range = self.range(bodies);
        let (moved, same) = self.moved(bodies, x.now);
        let (parts, faces) = (&self.parts, NearFaces { all: &self.faces, moved });
        // a point looks at tens of faces, whose corners others look at too
        let (places, made) = (&self.places, &self.made);
        let place = |row: VertexRow| places[row.index()];
        let now = |row: VertexRow| made.mean(row, x.now);
        let start = |row: VertexRow| made.mean(row, x.start);
        let points = self.points[range.clone()].iter_mut();
        let mut sum = 0.0;
        for ((point, active), known) in
            points.zip(&mut self.active[range.clone()]).zip(&mut self.beside[range])
        {
            if !matches!(point.against, Against::Faces(_)) || faces.all.is_empty() {
                *active = point.evaluate(parts, None, &now, &start, limits);
            } else if point.stays_clear(moved, limits) {
                (*active, *known) = (Active::default(), None);
            } else {
                // a round begins where the last one ended, with other limits
                let near = match known {
                    Some(near) if same => near,
                    _ => known.insert(point.beside(faces, &place)),
                };
                *active = point.evaluate(parts, near.as_ref(), &place, &start, limits);
            }
            sum += active.energy;
        }
        sum + self.evaluate_lines(bodies, x.now, limits)
    }

    /// A bound of the way (m) that a point of one body and a face of another came together since the distances of faces
    /// were taken, and whether all are where they were at the last evaluation. Distances are taken again where the bound is too
    /// wide to leave many faces out.
    fn moved(&mut self, bodies: &Range<usize>, x: &dyn Fn(VertexRow) -> DVec3) -> (f64, bool) {
        if self.faces.is_empty() {
            return (0.0, false);
        }
        let mut same = true;
        let (mut most, mut edges) = (0.0_f64, [f64::INFINITY, 0.0]);
        let (places, made) = (&mut self.places, &self.made);
        for KnownSkin { skin, .. } in &self.skins[bodies.clone()] {
            let last = skin.rows.iter().map(|row| row.index() + 1).max().unwrap_or(0);
            places.resize(places.len().max(last), DVec3::ZERO);
            let ways = skin.rows.iter().zip(&skin.seen).map(|(row, seen)| {
                let at = made.mean(*row, x);
                same &= std::mem::replace(&mut places[row.index()], at) == at;
                at.distance(*seen)
            });
            // positions that are not finite tell nothing
            most = ways
                .fold(most, |most, way| if way.is_nan() { f64::INFINITY } else { most.max(way) });
            if !skin.rows.is_empty() {
                edges = [edges[0].min(skin.edge), edges[1].max(skin.edge)];
            }
        }
        let rounding = ROUNDING * edges[1];
        if most < 0.25 * edges[0] || !most.is_finite() {
            return (2.0 * most + rounding, same);
        }
        let range = self.range(bodies);
        let place = |row: VertexRow| self.places[row.index()];
        for point in &mut self.points[range] {
            let Against::Faces(near) = &point.against else { continue };
            let at = point.at(&place);
            let faces = &mut self.faces[near.clone()];
            for face in &mut *faces {
                face.distance = distance(at, &face.rows, &place);
            }
            if point.clear > 0.0 {
                // one that is beside none touches none before it has come to the nearest
                let nearest = faces.iter().map(|face| face.distance).fold(f64::INFINITY, f64::min);
                // seldom asked, so not compiled for this alone
                let place: &dyn Fn(VertexRow) -> DVec3 = &place;
                let found = beside(at, faces, 0.0, place, point.rim);
                point.note_distance(found.map_or(nearest, |found| found.distance));
            }
        }
        for KnownSkin { skin, .. } in &mut self.skins[bodies.clone()] {
            for (row, at) in skin.rows.iter().zip(&mut skin.seen) {
                *at = self.places[row.index()];
            }
        }
        (rounding, same)
    }

    /// Corrects the tangents of points whose force changed by more than the last tangent said: normals turn in a furrow
    /// between faces, and limits of friction follow the pressure. Call it once a round, at the positions `x` of the
    /// last evaluation.
    pub fn learn(&mut self, bodies: &Range<usize>, x: &dyn Fn(VertexRow) -> DVec3, first: bool) {
        let range = self.range(bodies);
        self.rounds.resize(self.active.len(), (Active::default(), DVec3::ZERO));
        let made = &self.made;
        let both = self.active[range.clone()].iter_mut().zip(&mut self.rounds[range.clone()]);
        for (point, (active, (last, place))) in self.points[range].iter().zip(both) {
            // a tool that gives way takes the point with it
            let way = match point.against {
                Against::Part(part) => self.tools[self.parts[part].tool].spring.now,
                Against::Edge(edge) => self.tools[edge.tool].spring.now,
                Against::Needle(ref own) => self.tools[own.tool].spring.now,
                Against::Hand(_) | Against::Faces(_) => DVec3::ZERO,
            };
            let place_of = |active: &Active| {
                let shares = active.rows.iter().zip(active.weights).filter(|(_, w)| *w != 0.0);
                shares.map(|(row, weight)| weight * made.mean(*row, x)).sum::<DVec3>() - way
            };
            let now = *active;
            if !first && last.pressure > 0.0 && active.pressure > 0.0 {
                let way = place_of(last) - *place;
                let expected = last.push + last.rub - last.block * way;
                let missed = -(active.push + active.rub - expected).dot(way);
                if missed > 0.0 {
                    let square = way.length_squared();
                    active.block += missed / (square * square) * outer(way, way);
                }
            }
            (*last, *place) = (now, place_of(&now));
        }
    }

    /// Holds the points that touched at the start of the step and no longer do, as if they could be pulled: they are
    /// the best guess of the points that touch at its end. The next evaluation lets them go.
    pub fn keep_touching(&mut self, bodies: &Range<usize>) {
        let range = self.range(bodies);
        for (point, active) in self.points[range.clone()].iter().zip(&mut self.active[range]) {
            // a tool on a spring is in balance without such forces
            let is_free = matches!(point.against, Against::Part(part) if self.tools[self.parts[part].tool].tool.spring.is_some());
            let touched = point.memory.pressure > 0.0 && point.multiplier.is_none() && !is_free;
            if touched && active.pressure <= 0.0 && active.gap.is_finite() {
                let stiffness = point.area * point.k;
                active.on = true;
                active.push = -stiffness * active.gap * active.normal;
                active.block += stiffness * outer(active.normal, active.normal);
                if matches!(point.against, Against::Faces(_)) {
                    active.stiff = stiffness.sqrt() * active.normal;
                }
            }
        }
    }

    /// Calls `f` with every row of some bodies that is pushed, and the force (N) on it, at the last evaluation.
    pub fn for_forces(&self, bodies: &Range<usize>, mut f: impl FnMut(usize, DVec3)) {
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let force = active.push + active.rub;
            for (row, weight) in self.made.expand(active.rows, active.weights) {
                f(row.index(), weight * force);
            }
        }
        for (hook, force) in self.lines(bodies).flat_map(lines::Line::forces) {
            hook.used().for_each(|(row, weight)| f(row.index(), weight * force));
        }
    }

    /// Blocks that the contacts of some bodies add to the matrix, at the last evaluation.
    pub fn blocks(&self, bodies: &Range<usize>) -> ContactBlocks {
        let mut blocks = ContactBlocks::default();
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let Active { rows, weights, block, stiff, .. } = *active;
            let used = self.made.expand(rows, weights);
            let coupling = Coupling::new(used, block - outer(stiff, stiff), stiff);
            let mut used = coupling.used();
            match (used.next(), used.next()) {
                (Some((row, weight)), None) => {
                    blocks.diagonal.push((row, weight * weight * block));
                }
                _ => blocks.couplings.push(coupling),
            }
        }
        sum_by_row(&mut blocks.diagonal);
        blocks.couplings.sort_by_key(|own| own.used().map(|(row, _)| row).min());
        blocks.vectors = self.line_vectors(bodies);
        blocks.given = self.given_back(bodies);
        blocks
    }

    /// Force (N) and tangent (N/m) of the contacts of some bodies on the rows of a piece as a whole, at the last
    /// evaluation.
    pub fn resistance(
        &self,
        bodies: &Range<usize>,
        inside: &dyn Fn(VertexRow) -> bool,
    ) -> (DVec3, DMat3) {
        let (mut force, mut block) = (DVec3::ZERO, DMat3::ZERO);
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let used = self.made.expand(active.rows, active.weights);
            let share: f64 = used.filter(|(row, _)| inside(*row)).map(|(_, w)| w).sum();
            force += share * (active.push + active.rub);
            block += share * share * active.block;
        }
        for (hook, own) in self.lines(bodies).flat_map(lines::Line::forces) {
            let inside = hook.used().filter(|(row, _)| inside(*row));
            force += inside.map(|(_, weight)| weight).sum::<f64>() * own;
        }
        for vector in self.line_vectors(bodies) {
            let inside = vector.iter().filter(|(row, _)| inside(VertexRow(*row)));
            let sum = inside.map(|(_, v)| *v).sum::<DVec3>();
            block += outer(sum, sum);
        }
        for given in self.given_back(bodies) {
            let inside = given.rows.iter().filter(|(row, _)| inside(VertexRow(*row)));
            let sum = inside.map(|(_, v)| *v).sum::<DVec3>();
            block -= outer(sum, sum);
        }
        (force, block)
    }

    /// Largest depth at the last evaluation of points that did not touch at the start of the step, over the mean edge
    /// of their surface. It measures how hard an impact the step is.
    pub fn impact(&self, bodies: &Range<usize>) -> f64 {
        let range = self.range(bodies);
        let depth = |(point, active): (&ContactPoint, &Active)| {
            let is_surface = !matches!(point.against, Against::Hand(_) | Against::Edge(_));
            let new = is_surface && point.memory.pressure <= 0.0 && active.pressure > 0.0;
            let edge = self.skins.get(point.key.body as usize).map_or(1.0, |known| known.skin.edge);
            if new { -active.gap / edge } else { 0.0 }
        };
        self.points[range.clone()].iter().zip(&self.active[range]).map(depth).fold(0.0, f64::max)
    }

    /// Moves the multipliers of exact contact to the pressures of the last evaluation; the change summed over areas,
    /// over the sum of the pressures (N). 0 where nothing is exact.
    pub fn update_multipliers(&mut self) -> f64 {
        let (mut change, mut total) = (0.0, 0.0);
        for (point, active) in self.points.iter_mut().zip(&self.active) {
            if let Some(lambda) = &mut point.multiplier {
                change += point.area * (active.pressure - *lambda).abs();
                total += point.area * active.pressure;
                *lambda = active.pressure;
            }
        }
        if total > 0.0 { change / total } else { 0.0 }
    }

    /// Whether some tool wants exact contact.
    pub fn is_exact(&self) -> bool {
        self.points.iter().any(|point| point.multiplier.is_some())
    }

    /// Name of a tool that wants exact contact.
    pub fn exact_tool(&self) -> Option<&str> {
        self.tools.iter().find(|now| now.tool.exact).map(|now| now.name.as_str())
    }

    /// The name of a tool, and a body whose edges are longer than the tool is thick, that meet at vertices alone because
    /// that was asked for: the tool may pass between these unfelt.
    pub fn sparse(&self) -> Option<(&str, usize)> {
        let asked = self.tools.iter().filter(|now| now.tool.points == Points::Vertex);
        let mut pairs = asked.flat_map(|now| (0..self.skins.len()).map(move |body| (now, body)));
        let (now, body) = pairs.find(|(now, body)| {
            let edge = self.skin(now, *body).edge;
            let parts = self.parts[now.parts.clone()].iter();
            parts.filter(|part| !part.of.cavity).any(|part| part.of.shape.thickness() < edge)
        })?;
        Some((&now.name, body))
    }

    /// Counts another iteration of the inner loop, and whether it is one that did not converge.
    pub fn count(&mut self, iterations: u32, unconverged: bool) {
        self.figures.inner_iterations += iterations;
        self.figures.unconverged += u32::from(unconverged);
    }

    /// Whether some tool asks for its local stiffness.
    pub fn asks_stiffness(&self) -> bool {
        self.tools.iter().any(|now| now.tool.local_stiffness)
    }

    /// Tools whose local stiffness is asked for and that touch something. Tangents of their points become exact: the
    /// part by the curvature of the tool is small along the normal, but counts where the tool goes sideways.
    pub fn tools_with_stiffness(&mut self) -> Vec<usize> {
        let asked =
            |i: &usize| self.tools[*i].tool.local_stiffness && self.touching(*i).count() > 0;
        let tools: Vec<usize> = (0..self.tools.len()).filter(asked).collect();
        tools.iter().for_each(|tool| self.bend(*tool));
        tools
    }

    /// The place of a tool in the step, with exact tangents of its points; none where it acted in none.
    pub fn with_exact_tangents(&mut self, tool: Entity) -> Option<usize> {
        let index = self.tools.iter().position(|now| now.entity == tool)?;
        self.bend(index);
        Some(index)
    }

    /// Makes the tangents of the points of a tool exact, once a step.
    fn bend(&mut self, tool: usize) {
        if std::mem::replace(&mut self.tools[tool].curved, true) {
            return;
        }
        for (point, active) in self.points.iter().zip(&mut self.active).filter(|(_, a)| a.on) {
            if let Against::Part(part) = point.against
                && self.parts[part].tool == tool
            {
                let curvature = self.parts[part].curvature(active.at, &point.side);
                active.block -= point.area * active.pressure * curvature;
            }
        }
    }

    /// Points that press or hold a tool, at the last evaluation.
    fn touching(&self, tool: usize) -> impl Iterator<Item = &Active> {
        let of = move |point: &ContactPoint| self.is_of_tool(point, tool);
        let both = self.points.iter().zip(&self.active);
        both.filter(move |(point, active)| active.on && of(point)).map(|(_, active)| active)
    }

    /// Calls `f` with every row that touches a tool, and the force (N) on it that a motion `way` (m) of the tool makes
    /// while the row stays, at the last evaluation.
    pub fn for_motion(&self, tool: usize, way: DVec3, mut f: impl FnMut(usize, DVec3)) {
        for active in self.touching(tool) {
            for (row, weight) in self.made.expand(active.rows, active.weights) {
                f(row.index(), weight * (active.block * way));
            }
        }
    }

    /// Keeps the local stiffness of a tool. `ways` gives the motion (m) of a row when the tool moves 1 m along an axis.
    pub fn keep_stiffness(&mut self, tool: usize, ways: &dyn Fn(usize, VertexRow) -> DVec3) {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let columns = [0, 1, 2].map(|axis| {
            let force = |active: &Active| {
                let shares = self.made.expand(active.rows, active.weights);
                let way = shares.map(|(row, weight)| weight * ways(axis, row)).sum::<DVec3>();
                active.block * (way - axes[axis])
            };
            self.touching(tool).map(force).sum::<DVec3>()
        });
        self.local.push((tool, DMat3::from_cols(columns[0], columns[1], columns[2])));
    }

    /// Sum (N) of the magnitudes of the forces on rows of some bodies, at the last evaluation.
    pub fn force_sum(&self, bodies: &Range<usize>) -> f64 {
        let of = |active: &Active| {
            let force = (active.push + active.rub).abs();
            force.x + force.y + force.z
        };
        let points = self.active[self.range(bodies)].iter().filter(|a| a.on).map(of).sum::<f64>();
        let of = |(_, force): (_, DVec3)| force.abs().element_sum();
        points + self.lines(bodies).flat_map(lines::Line::forces).map(of).sum::<f64>()
    }

    /// What the forces of the contacts of some bodies do (J) along the rounding of places, at the last evaluation:
    /// changes of energy below it mean nothing. `of_row` is the rounding (m) of the place of a vertex row.
    pub fn rounding(&self, bodies: &Range<usize>, of_row: &dyn Fn(VertexRow) -> f64) -> f64 {
        let range = self.range(bodies);
        let of = |(point, active): (&ContactPoint, &Active)| {
            let shares = self.made.expand(active.rows, active.weights);
            let own = shares.map(|(row, w)| w.abs() * of_row(row));
            let centre = match point.against {
                Against::Part(part) => self.parts[part].now.centre.abs().max_element(),
                Against::Needle(ref own) => own.now.centre.abs().max_element(),
                _ => 0.0,
            };
            let force = (active.push.abs() + active.rub.abs()).element_sum();
            ROUNDINGS * force * (own.sum::<f64>() + f64::EPSILON * centre)
        };
        let touching = self.points[range.clone()].iter().zip(&self.active[range]);
        let points = touching.filter(|(_, active)| active.on).map(of).sum::<f64>();
        points + ROUNDINGS * self.line_rounding(bodies, of_row)
    }

    /// Ends a substep: contacts go on from positions `x`, those of the last evaluation.
    pub fn settle(&mut self, x: &dyn Fn(VertexRow) -> DVec3) {
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let force = active.push + active.rub;
            let (tool, way) = match point.against {
                Against::Part(part) => {
                    let own = &self.parts[part];
                    (own.tool, active.at - own.now.carry(active.at, &own.start))
                }
                Against::Hand(hand) => (self.tools.len() + hand.pull, point.carried - hand.from),
                Against::Edge(edge) => (edge.tool, point.carried - edge.from),
                Against::Needle(ref own) => {
                    (own.tool, active.at - own.now.carry(active.at, &own.start))
                }
                Against::Faces(_) => {
                    let lost = lost(point, active);
                    *self.kept.dissipated.entry(point.key.owner).or_default() += lost;
                    self.figures.friction_dissipation += lost;
                    continue;
                }
            };
            // of the spring of a tool its hand moves the other end
            let spring = self.tools.get(tool).map_or(DVec3::ZERO, |own| own.spring.way());
            let own = &mut self.settled[tool];
            own.work += force.dot(way - spring);
            // what an edge or needle holds is the same through the step, and what is lost counts at its end
            if !point.is_edge() && !matches!(point.against, Against::Needle(_)) {
                own.dissipation += lost(point, active);
            }
        }
        self.settle_lines();
        for own in &mut self.parts {
            own.start = own.now;
            own.end.centre += self.tools[own.tool].spring.way();
        }
        for point in &mut self.points {
            if let Against::Needle(own) = &mut point.against {
                own.end.centre += self.tools[own.tool].spring.way();
            }
        }
        for own in &mut self.tools {
            own.spring.from = own.spring.now;
            own.begin = own.reached;
        }
        self.beside.fill(None);
        let made = &self.made;
        for (point, active) in self.points.iter_mut().zip(&self.active) {
            point.memory = remember(point, active);
            point.start = point.at(&|row| made.mean(row, x));
            match &mut point.against {
                Against::Hand(hand) => hand.from = point.carried,
                Against::Edge(edge) => edge.from = point.carried,
                Against::Needle(own) => own.start = own.now,
                // what is kept of tools is turned with them
                Against::Part(_) => {}
                Against::Faces(_) => point.slip = point.memory.slip,
            }
        }
    }

    /// Ends the step at positions `x`: writes the kept state and the reports. `dt` is the length of the step (s); whether it
    /// `converged` is told beside the forces.
    pub fn finish(
        &mut self,
        world: &mut World,
        x: &RowPlaces,
        dt: f64,
        converged: bool,
    ) -> ContactFigures {
        let bodies = 0..self.first.len().saturating_sub(1);
        self.set_part(1.0);
        self.evaluate(&bodies, x, Limits::Keep);
        self.figures.unconverged += u32::from(self.is_unbalanced());
        let converged = converged && self.figures.unconverged == 0;
        let touching = self.active.iter().any(|active| active.on) || !self.lines.is_empty();
        self.figures.missed = !converged && touching;
        self.kept.points.clear();
        for (point, active) in self.points.iter().zip(&self.active) {
            let kept = remember(point, active);
            if kept != PointMemory::default() && !point.is_edge() {
                self.kept.points.push((point.key, kept));
            }
        }
        // points are sorted by key, and so is what is kept of them
        self.report_tools(world, x, dt);
        self.report_pairs(world, x, dt);
        self.report_pulls(world);
        self.keep_forces();
        let of_lines = self.report_lines(world);
        let mut edge_depth = 0.0_f64;
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            if matches!(point.against, Against::Hand(_) | Against::Edge(_) | Against::Needle(_)) {
                continue;
            }
            self.figures.points += 1;
            self.figures.sticking += u32::from(sticks(point, active));
            let depth = (-active.gap).max(0.0);
            self.figures.depth = self.figures.depth.max(depth);
            let skin = &self.skins[point.key.body as usize].skin;
            edge_depth = edge_depth.max(depth / skin.edge);
        }
        self.figures.depth_over_edge = edge_depth;
        let of_points = self.points.iter().zip(&self.active).map(|(p, a)| stored(p, a));
        self.kept.stored = of_points.sum::<f64>() + of_lines + self.spring_energy();
        self.kept.of_lines = of_lines;
        self.figures.energy = self.kept.stored;
        self.figures
    }

    /// Energy (J) stored in contacts and pulls at the end of the last step.
    pub fn stored(&self) -> f64 {
        self.kept.stored
    }
}

/// Ascending rows, each once with the sum of what it had, in the order in which that came.
fn sum_by_row<R: Copy + Ord, T: Copy + std::ops::AddAssign>(parts: &mut Vec<(R, T)>) {
    parts.sort_by_key(|(row, _)| *row);
    parts.dedup_by(|later, first| {
        let same = later.0 == first.0;
        if same {
            first.1 += later.1;
        }
        same
    });
}

/// The kept state of a point.
fn remember(point: &ContactPoint, active: &Active) -> PointMemory {
    let gripped = point.friction.is_infinite() && (active.pressure > 0.0 || point.memory.gripped);
    let side = point.memory.side;
    if active.pressure <= 0.0 && !gripped {
        return PointMemory { side, ..PointMemory::default() };
    }
    PointMemory {
        slip: point.kept_slip(active),
        normal: point.kept_normal(active),
        pressure: active.pressure,
        gripped,
        side,
    }
}

/// Energy (J) that a point stores: penetration and elastic slip, or the spring of a pull.
fn stored(point: &ContactPoint, active: &Active) -> f64 {
    if !active.on {
        return 0.0;
    }
    if let Against::Hand(_) = point.against {
        return 0.5 * point.area * point.k * active.gap * active.gap;
    }
    if let Against::Needle(own) = &point.against {
        return own.at(active.at).stored;
    }
    // exact contact has no penetration to store anything in, and no friction
    if point.multiplier.is_some() {
        return 0.0;
    }
    let slip = point.kept_slip(active).length_squared();
    0.5 * point.area * (active.pressure * active.pressure / point.k + point.stick() * slip)
}

/// Energy (J) that friction took in the step.
fn lost(point: &ContactPoint, active: &Active) -> f64 {
    if let Against::Needle(own) = &point.against {
        return own.at(active.at).lost;
    }
    let (l, stick) = (active.slip.length(), point.stick());
    if point.limit > 0.0 && stick * l > point.limit {
        point.area * point.limit * (l - point.limit / stick)
    } else {
        0.0
    }
}

/// Whether a point in contact sticks.
fn sticks(point: &ContactPoint, active: &Active) -> bool {
    point.limit > 0.0 && point.stick() * active.slip.length() <= point.limit
}
