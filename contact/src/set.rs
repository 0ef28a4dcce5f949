//! All contact of a world during a step: which points may be touched, their forces at any state, and what is kept and
//! reported at the end.

use crate::pair::{BodyContact, BodyContactReport, beside};
use crate::point::{Active, Against, Key, Memory, PartNow, Point, Rigid, Side, outer};
use crate::pull::{Pull, PullReport};
use crate::skin::{EMPTY, Skin, face_points, grown, overlap};
use crate::tool::{MOST_POINTS, Points, Stiffness, Tool, ToolMotion, ToolPose, ToolReport};
use bevy_ecs::lifecycle::HookContext;
use bevy_ecs::prelude::*;
use bevy_ecs::world::DeferredWorld;
use glam::{DMat3, DVec3};
use sinew_engine::report::ContactFigures;
use sinew_engine::step::StepError;
use sinew_engine::surface::SurfaceReader;
use sinew_engine::time::{StepClock, StepPart};
use sinew_engine::topology::Topology;
use std::collections::BTreeMap;
use std::ops::Range;

/// Part of its thickness that a tool may move at once: no point can then pass its middle. The second is for tools
/// thinner than the edges of the surface, which would work themselves under it.
const LONGEST_WAY: [f64; 2] = [0.9, 0.4];
/// Most substeps that a step is cut into for a fast tool.
pub const MOST_SUBSTEPS: u32 = 8;
/// Part of the mean edge by which points may be inside of a tool that appears before it is drawn in.
const INSIDE: f64 = 0.25;
/// Speed (m/s) at which a tool that was drawn in grows again.
const GROWTH: f64 = 0.1;
/// Depth over the mean edge beyond which a point that did not touch is taken to be behind a body, not inside of it.
const DEEP: f64 = 0.35;
/// Thickness of a tool over the mean edge from which vertices are dense enough.
const DENSE: f64 = 2.0;

/// Positions (m) of vertex rows: now, and at the start of the step.
#[derive(Clone, Copy)]
pub struct Places<'a> {
    /// Now.
    pub now: &'a dyn Fn(u32) -> DVec3,
    /// At the start of the step.
    pub start: &'a dyn Fn(u32) -> DVec3,
}

/// What becomes of the limits of friction in an evaluation. The energy is a potential while they are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limits {
    /// They stay those of the last evaluation that changed them.
    Keep,
    /// They are taken at the positions of this one.
    Take,
    /// They are those of the end of the last step: what inertia alone would press together says little.
    Recall,
    /// They are taken, but where nothing pressed at the last one: the pressure of a point that has only just come in,
    /// which nothing has met yet, is far too high.
    Follow,
    /// They go half of the way there: where sticking and slipping alternate, that ends it.
    Approach,
}

/// What contact adds to the matrix of a step: `sum_q B_q^T C_q B_q` with `B_q` the shares of a point.
#[derive(Clone, Debug, Default)]
pub struct ContactBlocks {
    /// Diagonal blocks (N/m) of vertex rows, ascending, each row once.
    pub diagonal: Vec<(u32, DMat3)>,
    /// Points of more than one row, whose blocks off the diagonal are not in there.
    pub couplings: Vec<Coupling>,
}

/// Blocks off the diagonal of one point: `w_a w_b C`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coupling {
    /// Vertex rows.
    pub rows: [u32; 4],
    /// Their shares, 0 for unused ones.
    pub weights: [f64; 4],
    /// `C` (N/m).
    pub block: DMat3,
}

/// What is kept of a tool from step to step.
#[derive(Clone, Debug, Default)]
struct ToolState {
    pose: ToolPose,
    drawn_in: Vec<f64>,
    work: f64,
    dissipation: f64,
}

/// What a tool did in the substeps of a step.
#[derive(Clone, Copy, Debug, Default)]
struct Settled {
    work: f64,
    dissipation: f64,
}

/// A tool in this step.
#[derive(Clone, Debug)]
struct ToolNow {
    entity: Entity,
    /// Of the entity: clones of a tool are tools of their own.
    id: u64,
    name: String,
    start: ToolPose,
    end: ToolPose,
    /// Not yet reached of its target (m).
    lag: f64,
    /// It appears, or was put here, in this step.
    appears: bool,
    tool: Tool,
    parts: Range<usize>,
}

#[derive(Clone, Debug)]
struct PairNow {
    entity: Entity,
    pair: BodyContact,
}

#[derive(Clone, Debug)]
struct PullNow {
    entity: Entity,
    pull: Pull,
}

/// The contact surface of a body and what it was made for.
#[derive(Clone, Debug, Default)]
struct Known {
    version: (u64, u64),
    skin: Skin,
}

/// Tools, contact between bodies and pulls of a world. It exists from the first of them on.
#[derive(Resource, Clone, Debug, Default)]
pub struct ContactSet {
    skins: Vec<Known>,
    /// Of tools that touch some faces only, by tool and body.
    own_skins: BTreeMap<(u64, usize), Known>,
    states: BTreeMap<u64, ToolState>,
    tools: Vec<ToolNow>,
    parts: Vec<PartNow>,
    pairs: Vec<PairNow>,
    pulls: Vec<PullNow>,
    points: Vec<Point>,
    /// First point of every body, and the number of all.
    first: Vec<usize>,
    active: Vec<Active>,
    /// Of the last round of an inner loop, and the places (m) between the rows that they acted on.
    rounds: Vec<(Active, DVec3)>,
    faces: Vec<[u32; 3]>,
    memory: Vec<(Key, Memory)>,
    dissipated: BTreeMap<u64, f64>,
    /// Forces (N) at the end of the last step, and pressures (Pa), of vertex rows.
    forces: Vec<(u32, DVec3)>,
    pressures: Vec<(u32, f64)>,
    figures: ContactFigures,
    /// Work and dissipation of the tools, and last of all hands, in the substeps of the step.
    settled: Vec<Settled>,
    /// Energy (J) stored at the end of the last step.
    stored: f64,
    /// What is kept, as it was before the first part of a step in parts, and the number of that step.
    before_parts: Option<(u64, Box<ContactSet>)>,
}

impl ContactSet {
    /// Finds what may touch what in the step to come. `x` and `v` are positions (m) and velocities (m/s) of vertex
    /// rows, `rest` their rest positions. With `limit_ways` a tool whose way through tissue is longer than it is thick
    /// does not reach its end: integrators with small steps of their own do not need that.
    ///
    /// # Errors
    /// When a tool, contact or pull cannot be used.
    pub fn prepare(
        &mut self,
        world: &mut World,
        rest: &[DVec3],
        x: &dyn Fn(u32) -> DVec3,
        v: &dyn Fn(u32) -> DVec3,
        limit_ways: bool,
    ) -> Result<(), StepError> {
        let clock = *world.resource::<StepClock>();
        self.figures = ContactFigures::default();
        self.read(world)?;
        self.points.clear();
        self.faces.clear();
        if !self.tools.is_empty() || !self.pairs.is_empty() {
            self.refit(world, rest, clock.dt, x, v)?;
            if limit_ways {
                self.limit_ways();
            }
            self.find_tool_points();
            self.find_pair_points(rest);
        }
        self.find_pull_points(world, x);
        self.settled = vec![Settled::default(); self.tools.len() + 1];
        self.points.sort_unstable_by_key(|point| point.key);
        let bodies = world.resource::<Topology>().bodies.len();
        self.first.clear();
        for body in 0..=bodies as u32 {
            self.first.push(self.points.partition_point(|point| point.key.body < body));
        }
        self.active.clear();
        self.active.resize(self.points.len(), Active::default());
        for point in &mut self.points {
            point.start = point.at(x);
        }
        self.set_part(1.0, clock.dt);
        Ok(())
    }

    /// All bodies.
    pub fn bodies(&self) -> Range<usize> {
        0..self.first.len().saturating_sub(1)
    }

    /// Bounds on the largest frequency (1/s) that contacts alone could give vertices of these masses (kg), and on the
    /// rate (1/s) at which pulls damp them.
    pub fn rates(&self, mass: &dyn Fn(u32) -> f64) -> [f64; 2] {
        let mut rows: Vec<(u32, f64, f64)> = Vec::new();
        for point in &self.points {
            let damping = match point.against {
                Against::Hand { damping, .. } => damping * point.area,
                _ => 0.0,
            };
            // vertices of the face on the other side bear at most as much
            let used = point.rows.iter().zip(point.weights).filter(|(_, w)| *w > 0.0);
            rows.extend(used.map(|(&row, w)| (row, w * point.area * point.k, w * damping)));
            if let Against::Faces(range) = &point.against {
                let faces = self.faces[range.clone()].iter().flatten();
                rows.extend(faces.map(|&row| (row, point.area * point.k, 0.0)));
            }
        }
        rows.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut most = [0.0_f64; 2];
        for own in rows.chunk_by(|a, b| a.0 == b.0) {
            let m = mass(own[0].0);
            if m > 0.0 {
                let sum = |of: fn(&(u32, f64, f64)) -> f64| own.iter().map(of).sum::<f64>() / m;
                most = [most[0].max(sum(|r| r.1)), most[1].max(sum(|r| r.2))];
            }
        }
        [most[0].sqrt(), most[1]]
    }

    /// Change of the stored energy (J) since the start of a step in substeps, and the work (J) that tools and hands
    /// did in it, both up to the last [`settle`](Self::settle).
    pub fn books(&self) -> [f64; 2] {
        let now: f64 = self.points.iter().zip(&self.active).map(|(p, a)| stored(p, a)).sum();
        [now - self.stored, self.settled.iter().map(|own| own.work).sum()]
    }

    /// Whether nothing can touch or pull anything in this step.
    pub fn is_idle(&self) -> bool {
        self.points.is_empty()
    }

    /// Tools, pairs and pulls as they are, in order of creation.
    fn read(&mut self, world: &mut World) -> Result<(), StepError> {
        let clock = *world.resource::<StepClock>();
        let part = world.get_resource::<StepPart>().copied().unwrap_or_default();
        if part.index == 0 {
            match self.before_parts.take() {
                // that step failed in a later part, and is made again
                Some((step, before)) if step == clock.step => *self = *before,
                _ => {}
            }
            if part.count > 1 {
                self.before_parts = Some((clock.step, Box::new(self.clone())));
            }
        }
        let t = clock.time + clock.dt;
        let topology = world.resource::<Topology>();
        let (rows, bodies) = (topology.vertex_count(), topology.bodies.len());
        let invalid =
            |name: &str, problem| StepError::InvalidContact { name: name.into(), problem };

        let mut query = world.query::<(Entity, &Tool)>();
        let mut found: Vec<(Entity, &Tool)> = query.iter(world).collect();
        found.sort_unstable_by_key(|(entity, tool)| (tool.sequence, *entity));
        self.tools.clear();
        self.parts.clear();
        for (entity, tool) in found {
            if let Some(problem) = tool.problem(rows) {
                return Err(invalid(&tool.name, problem));
            }
            if !tool.active(t) {
                continue;
            }
            let known = self.states.get(&entity.to_bits());
            let mut start = match known {
                Some(state) => state.pose,
                // targets are reached from where it first stands
                None if tool.motion == ToolMotion::Follow => tool.start,
                None => tool.wanted(clock.time, tool.start),
            };
            let wanted = tool.wanted(t, start);
            let appears = known.is_none() || tool.placed;
            if tool.placed {
                start = wanted;
            }
            let end = match tool.motion {
                // what is left of the way, evenly over what is left of the step
                ToolMotion::Follow => start.towards(&wanted, part.share_of_rest()),
                _ => wanted,
            };
            let first = self.parts.len();
            let mut tool = tool.clone();
            tool.parts.shrink_to_fit();
            for i in 0..tool.parts.len() {
                let rigid = |pose| {
                    let (centre, rotation) = tool.part_pose(i, pose);
                    Rigid { centre, rotation }
                };
                let (start, end) = (rigid(&start), rigid(&end));
                let drawn_in = known.filter(|_| !appears).and_then(|k| k.drawn_in.get(i)).copied();
                self.parts.push(PartNow {
                    shape: tool.parts[i].shape.clone(),
                    tool: self.tools.len(),
                    start,
                    end,
                    now: end,
                    drawn_in: drawn_in.unwrap_or(0.0),
                });
            }
            self.tools.push(ToolNow {
                entity,
                id: entity.to_bits(),
                name: tool.name.clone(),
                start,
                end,
                lag: 0.0,
                appears,
                parts: first..self.parts.len(),
                tool,
            });
        }

        let mut query = world.query::<(Entity, &BodyContact)>();
        self.pairs.clear();
        for (entity, pair) in query.iter(world) {
            if let Some(problem) = pair.problem(bodies) {
                return Err(invalid(&pair.name, problem));
            }
            self.pairs.push(PairNow { entity, pair: pair.clone() });
        }
        self.pairs.sort_unstable_by_key(|now| (now.pair.sequence, now.entity));

        let mut query = world.query::<(Entity, &Pull)>();
        self.pulls.clear();
        for (entity, pull) in query.iter(world) {
            if let Some(problem) = pull.problem(rows) {
                return Err(invalid(&pull.name, problem));
            }
            self.pulls.push(PullNow { entity, pull: pull.clone() });
        }
        self.pulls.sort_unstable_by_key(|now| (now.pull.sequence, now.entity));
        Ok(())
    }

    /// Surfaces up to date, and where they are.
    fn refit(
        &mut self,
        world: &mut World,
        rest: &[DVec3],
        dt: f64,
        x: &dyn Fn(u32) -> DVec3,
        v: &dyn Fn(u32) -> DVec3,
    ) -> Result<(), StepError> {
        let bodies = world.resource::<Topology>().bodies.len();
        let Some(SurfaceReader(read)) = world.get_resource::<SurfaceReader>().copied() else {
            return Ok(());
        };
        self.skins.resize_with(bodies, Known::default);
        let live: Vec<u64> = self.tools.iter().map(|now| now.id).collect();
        self.own_skins.retain(|(tool, _), _| live.contains(tool));
        for body in 0..bodies {
            let topology = world.resource::<Topology>();
            let first = topology.bodies[body].vertices.start;
            let version = (topology.revision + 1, topology.bodies[body].changes);
            let mut surface = None;
            if self.skins[body].version != version {
                let read = read(world, body);
                let skin = Skin::new(&read, first, rest, None);
                if skin.faces.is_empty() && self.pairs.iter().any(|n| n.pair.bodies.contains(&body))
                {
                    let pair = self.pairs.iter().find(|n| n.pair.bodies.contains(&body));
                    let name = &world.resource::<Topology>().bodies[body].name;
                    return Err(StepError::InvalidContact {
                        name: pair.map_or_else(String::new, |n| n.pair.name.clone()),
                        problem: format!("body `{name}` has no surface that could be touched"),
                    });
                }
                self.skins[body] = Known { version, skin };
                surface = Some(read);
            }
            self.skins[body].skin.refit(dt, x, v);
            for now in self.tools.iter().filter(|now| now.tool.faces.is_some()) {
                let own = self.own_skins.entry((now.id, body)).or_default();
                if own.version != version {
                    let surface = surface.get_or_insert_with(|| read(world, body));
                    let faces = now.tool.faces.as_deref();
                    *own = Known { version, skin: Skin::new(surface, first, rest, faces) };
                }
                own.skin.refit(dt, x, v);
            }
        }
        Ok(())
    }

    /// The surface of a body that a tool may touch.
    fn skin(&self, tool: &ToolNow, body: usize) -> &Skin {
        match self.own_skins.get(&(tool.id, body)) {
            Some(own) if tool.tool.faces.is_some() => &own.skin,
            _ => &self.skins[body].skin,
        }
    }

    /// Shortens the ways of tools that are too long for their thickness, where they meet tissue.
    fn limit_ways(&mut self) {
        for index in 0..self.tools.len() {
            let now = &self.tools[index];
            let mut share = 1.0_f64;
            for part in &self.parts[now.parts.clone()] {
                let way = longest_way(part);
                let most = self.longest_step(part);
                if way > most && self.meets(part, now) {
                    share = share.min(most / way);
                }
            }
            if share < 1.0 && !now.appears {
                let end = now.start.towards(&now.end, share);
                let lag = end.position.distance(now.end.position);
                let now = &mut self.tools[index];
                (now.end, now.lag) = (end, lag);
                self.figures.lagging += 1;
                self.place_parts(index);
            }
        }
    }

    /// Most (m) that a part may move at once.
    fn longest_step(&self, part: &PartNow) -> f64 {
        let edge = self.skins.iter().map(|known| known.skin.edge).fold(0.0, f64::max);
        let thickness = part.shape.thickness();
        LONGEST_WAY[usize::from(thickness < edge)] * thickness
    }

    /// Whether the way of a part leads through the box of a body.
    fn meets(&self, part: &PartNow, tool: &ToolNow) -> bool {
        let swept = swept(part);
        (0..self.skins.len()).any(|body| overlap(&self.skin(tool, body).hull, &swept))
    }

    fn place_parts(&mut self, tool: usize) {
        let now = &self.tools[tool];
        for (i, part) in self.parts[now.parts.clone()].iter_mut().enumerate() {
            let (centre, rotation) = now.tool.part_pose(i, &now.end);
            part.end = Rigid { centre, rotation };
            part.now = part.end;
        }
    }

    /// Remembered state of a point.
    fn remembered(&self, key: &Key) -> Memory {
        let found = self.memory.binary_search_by_key(key, |(key, _)| *key);
        found.map_or_else(|_| Memory::default(), |i| self.memory[i].1)
    }

    /// Points that tools may touch.
    fn find_tool_points(&mut self) {
        let mut points = Vec::new();
        for index in 0..self.tools.len() {
            for part in self.tools[index].parts.clone() {
                if self.tools[index].appears {
                    self.draw_in(index, part);
                }
                for body in 0..self.skins.len() {
                    self.find_normals(index, part, body);
                    let kind = self.kind_of_points(index, part, body);
                    self.collect(index, part, body, kind, &mut points);
                }
            }
        }
        self.points.append(&mut points);
    }

    /// Normals of a surface that a part may touch.
    fn find_normals(&mut self, tool: usize, part: usize, body: usize) {
        let (now, part) = (&self.tools[tool], &self.parts[part]);
        let reach = part.shape.bounds(part.end.centre, part.end.rotation);
        if !overlap(&self.skin(now, body).hull, &grown(reach, longest_way(part))) {
            return;
        }
        let key = (now.id, body);
        let skin = match self.own_skins.get_mut(&key) {
            Some(own) if now.tool.faces.is_some() => &mut own.skin,
            _ => &mut self.skins[body].skin,
        };
        if skin.normals.is_empty() {
            skin.find_normals();
        }
    }

    fn kind_of_points(&self, tool: usize, part: usize, body: usize) -> Points {
        let now = &self.tools[tool];
        let edge = self.skin(now, body).edge;
        let thickness = self.parts[part].shape.thickness();
        match now.tool.points {
            Points::Auto if thickness >= DENSE * edge => Points::Vertex,
            Points::Auto => {
                let n = (DENSE * edge / thickness).ceil() as u32;
                Points::Faces(n.clamp(2, MOST_POINTS))
            }
            chosen => chosen,
        }
    }

    /// Draws a part in as far as points are deep inside of it.
    fn draw_in(&mut self, tool: usize, part: usize) {
        let mut deepest = 0.0_f64;
        let now = &self.tools[tool];
        for body in 0..self.skins.len() {
            let skin = self.skin(now, body);
            let part = &self.parts[part];
            let own = part.shape.bounds(part.start.centre, part.start.rotation);
            let place = PartNow { now: part.start, drawn_in: 0.0, ..part.clone() };
            skin.near(&own, |i| {
                let depth = -place.gap(skin.at[i], &Side::default()).0;
                if depth > INSIDE * skin.edge {
                    deepest = deepest.max(depth);
                }
            });
        }
        self.parts[part].drawn_in = deepest;
        self.figures.drawn_in += u32::from(deepest > 0.0);
    }

    /// Points of one body that a part may touch.
    fn collect(
        &self,
        tool: usize,
        part_index: usize,
        body: usize,
        kind: Points,
        points: &mut Vec<Point>,
    ) {
        let (now, part) = (&self.tools[tool], &self.parts[part_index]);
        let skin = self.skin(now, body);
        let longest = longest_way(part);
        let reach = part.shape.bounds(part.end.centre, part.end.rotation);
        let reach = grown(reach, longest);
        let slack = longest + 1e-9 * skin.edge;
        let thin = part.shape.thickness() < skin.edge;
        let point = |point: [u32; 4], rows, weights, outward, [area, young]: [f64; 2]| {
            let key = Key {
                body: body as u32,
                owner: now.id,
                part: (part_index - now.parts.start) as u32,
                point,
            };
            let memory = self.remembered(&key);
            Point {
                key,
                against: Against::Part(part_index),
                rows,
                weights,
                area,
                k: stiffness(now.tool.stiffness, young, skin.edge),
                mu: if now.tool.grip { f64::INFINITY } else { now.tool.friction },
                memory: Memory { gripped: memory.gripped && now.tool.grip, ..memory },
                start: DVec3::ZERO,
                slip: DVec3::ZERO,
                carried: DVec3::ZERO,
                limit: 0.0,
                normal: DVec3::ZERO,
                pressed: false,
                multiplier: now.tool.exact.then_some(memory.pressure),
                side: if now.tool.keeps_side {
                    Side { outward, straight: thin && outward != DVec3::ZERO, ..Side::default() }
                } else {
                    Side::default()
                },
            }
        };
        if let Points::Faces(n) = kind {
            if !overlap(&skin.hull, &reach) {
                return;
            }
            let places = face_points(n);
            for (face, &local) in skin.faces.iter().enumerate() {
                let corners = local.map(|v| skin.at[v as usize]);
                let way = local.iter().map(|&v| skin.way[v as usize]).fold(0.0, f64::max);
                let low = corners[0].min(corners[1]).min(corners[2]);
                let high = corners[0].max(corners[1]).max(corners[2]);
                if !overlap(&grown([low, high], way), &reach) {
                    continue;
                }
                let rows = local.map(|v| skin.rows[v as usize]);
                let outward = skin.outward(face);
                let (area, young) =
                    (skin.face_area[face] / places.len() as f64, skin.mean(&skin.young, face));
                for (number, weights) in (0..).zip(&places) {
                    let at =
                        corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
                    if part.gap(at, &Side::default()).0 <= slack + way {
                        let [a, b, c] = rows;
                        let id = [a, b, c, number];
                        points.push(point(id, rows, *weights, outward, [area, young]));
                    }
                }
            }
        } else {
            skin.near(&reach, |i| {
                if part.gap(skin.at[i], &Side::default()).0 <= slack + skin.way[i] {
                    let row = skin.rows[i];
                    let id = [row, u32::MAX, u32::MAX, 0];
                    let numbers = [skin.area[i], skin.young[i]];
                    let outward = skin.normals[i];
                    points.push(point(id, [row; 3], [1.0, 0.0, 0.0], outward, numbers));
                }
            });
        }
    }

    /// Points of bodies that may touch other bodies.
    fn find_pair_points(&mut self, rest: &[DVec3]) {
        let (mut points, mut faces, mut buried) = (Vec::new(), Vec::new(), 0);
        for now in &self.pairs {
            let [a, b] = now.pair.bodies;
            let directions: &[[usize; 2]] = if a == b { &[[a, a]] } else { &[[a, b], [b, a]] };
            for (direction, &[from, to]) in (0..).zip(directions) {
                buried +=
                    self.collect_pair(now, direction, [from, to], rest, &mut points, &mut faces);
            }
        }
        self.points.append(&mut points);
        self.faces = faces;
        self.figures.buried = buried;
    }

    /// Vertices of body `from` near faces of body `to`. Faces near the common box are sorted into the cells of a grid
    /// that are as large as the largest of them, so that the work grows with the surface in that box alone.
    fn collect_pair(
        &self,
        now: &PairNow,
        direction: u32,
        [from, to]: [usize; 2],
        rest: &[DVec3],
        points: &mut Vec<Point>,
        faces: &mut Vec<[u32; 3]>,
    ) -> u32 {
        let mut buried = 0;
        let (own, other) = (&self.skins[from].skin, &self.skins[to].skin);
        if !overlap(&own.hull, &other.hull) {
            return 0;
        }
        let common = [own.hull[0].max(other.hull[0]), own.hull[1].min(other.hull[1])];
        let mut near = Vec::new();
        own.near(&common, |i| {
            if overlap(&grown([own.at[i]; 2], own.way[i]), &common) {
                near.push(i);
            }
        });
        let mut boxes = Vec::new();
        let mut size = 0.0_f64;
        for (face, local) in (0..).zip(&other.faces) {
            let corners = local.map(|v| other.at[v as usize]);
            let way = local.iter().map(|&v| other.way[v as usize]).fold(0.0, f64::max);
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let reach = grown([low, high], way + 0.5 * other.edge);
            if overlap(&reach, &common) {
                size = size.max((reach[1] - reach[0]).max_element());
                boxes.push((face, reach));
            }
        }
        if boxes.is_empty() || size <= 0.0 {
            return 0;
        }
        let cell = |x: DVec3| ((x - common[0]) / size).floor().as_i64vec3().to_array();
        let mut bins: Vec<([i64; 3], u32)> = Vec::new();
        for (place, (_, [low, high])) in (0..).zip(&boxes) {
            let (low, high) = (cell(*low), cell(*high));
            for i in low[0]..=high[0] {
                for j in low[1]..=high[1] {
                    for k in low[2]..=high[2] {
                        bins.push(([i, j, k], place));
                    }
                }
            }
        }
        bins.sort_unstable();
        let softer = |young: f64| {
            let of_other = other.young.iter().copied().fold(f64::INFINITY, f64::min) / other.edge;
            (young / own.edge).min(of_other)
        };
        let mut chosen = Vec::new();
        for i in near {
            let at = own.at[i];
            let mine = cell(at);
            let first = bins.partition_point(|(c, _)| *c < mine);
            chosen.clear();
            for &(_, place) in bins[first..].iter().take_while(|(c, _)| *c == mine) {
                let (face, [low, high]) = boxes[place as usize];
                let local = other.faces[face];
                if !overlap(&grown([at; 2], own.way[i]), &[low, high]) {
                    continue;
                }
                if from == to {
                    let here = rest[own.rows[i] as usize];
                    let near_at_rest = local.iter().any(|&v| {
                        let row = other.rows[v as usize];
                        row == own.rows[i] || rest[row as usize].distance(here) < 2.0 * own.edge
                    });
                    if near_at_rest {
                        continue;
                    }
                }
                chosen.push(face);
            }
            if chosen.is_empty() {
                continue;
            }
            let row = own.rows[i];
            let key = Key {
                body: from as u32,
                owner: now.entity.to_bits(),
                part: direction,
                point: [row, u32::MAX, u32::MAX, 0],
            };
            let mut memory = self.remembered(&key);
            let first = faces.len();
            faces.extend(
                chosen.iter().map(|&face| other.faces[face].map(|v| other.rows[v as usize])),
            );
            let x = |row: u32| match other.rows.binary_search(&row) {
                Ok(at) => other.at[at],
                Err(_) => at,
            };
            let sheets = chosen.iter().all(|&face| face >= other.sheets);
            let distance = beside(at, &faces[first..], &x, None).map_or(0.0, |b| b.distance);
            if sheets && memory.side == 0.0 {
                // a membrane has two sides: the one where it was met counts
                memory.side = if distance < 0.0 { -1.0 } else { 1.0 };
            } else if memory.pressure == 0.0 && distance < -DEEP * other.edge {
                // it is behind these faces because it is on the far side of their body
                faces.truncate(first);
                buried += u32::from(from != to);
                continue;
            }
            let half = if from == to { 1.0 } else { 0.5 };
            points.push(Point {
                key,
                against: Against::Faces(first..faces.len()),
                rows: [row; 3],
                weights: [1.0, 0.0, 0.0],
                area: half * own.area[i],
                k: match now.pair.stiffness {
                    Stiffness::Relative(factor) => factor * softer(own.young[i]),
                    Stiffness::Absolute(k) => k,
                },
                mu: now.pair.friction,
                memory,
                start: DVec3::ZERO,
                slip: memory.slip,
                carried: DVec3::ZERO,
                limit: 0.0,
                normal: DVec3::ZERO,
                pressed: false,
                multiplier: None,
                side: Side::default(),
            });
        }
        buried
    }

    /// Points of patches that hands pull on.
    fn find_pull_points(&mut self, world: &World, x: &dyn Fn(u32) -> DVec3) {
        let bodies = &world.resource::<Topology>().bodies;
        for now in &mut self.pulls {
            let pull = &mut now.pull;
            if pull.anchors.len() != pull.rows.len() {
                pull.anchors = pull.rows.iter().map(|&row| x(row)).collect();
            }
            let sum: f64 = pull.weights.iter().sum();
            let patch = pull.rows.iter().zip(&pull.weights).zip(&pull.anchors);
            for (number, ((&row, weight), anchor)) in (0..).zip(patch) {
                let carried = |pose: &sinew_engine::load::Pose| *anchor + pose.way(*anchor);
                self.points.push(Point {
                    key: Key {
                        body: bodies.partition_point(|body| body.vertices.end <= row) as u32,
                        owner: now.entity.to_bits(),
                        part: number,
                        point: [row, u32::MAX, u32::MAX, 0],
                    },
                    against: Against::Hand {
                        to: carried(&pull.target),
                        from: carried(&pull.last),
                        damping: pull.damping,
                        rate: 0.0,
                    },
                    rows: [row; 3],
                    weights: [1.0, 0.0, 0.0],
                    area: weight / sum,
                    k: pull.stiffness,
                    mu: 0.0,
                    memory: Memory::default(),
                    start: DVec3::ZERO,
                    slip: carried(&pull.last),
                    carried: DVec3::ZERO,
                    limit: 0.0,
                    normal: DVec3::ZERO,
                    pressed: false,
                    multiplier: None,
                    side: Side::default(),
                });
            }
        }
    }

    /// Puts all tools and hands where they are when `part` of the step has passed, `span` (s) after its start.
    pub fn set_part(&mut self, part: f64, span: f64) {
        for own in &mut self.parts {
            own.now = own.start.towards(&own.end, part);
        }
        let parts = &self.parts;
        for point in &mut self.points {
            match &mut point.against {
                Against::Part(index) => {
                    let own = &parts[*index];
                    point.slip = own.start.turn(point.memory.slip, &own.now);
                    point.carried = own.start.carry(point.start, &own.now);
                    let keeps = self.tools[own.tool].tool.keeps_side && point.memory.pressure > 0.0;
                    let normal = own.start.turn(point.memory.normal, &own.now);
                    point.side.normal = if keeps { normal } else { DVec3::ZERO };
                    point.choose_side(own);
                }
                Against::Hand { to, from, damping, rate } => {
                    point.carried = *from + (*to - *from) * part;
                    *rate = if span > 0.0 { *damping / span } else { 0.0 };
                }
                Against::Faces(_) => {}
            }
        }
    }

    /// Consecutive bodies that share a solve: alone, but for those that may touch each other and those between them.
    pub fn groups(&self, bodies: usize) -> Vec<Range<usize>> {
        let mut last: Vec<usize> = (0..bodies).collect();
        for now in &self.pairs {
            let [a, b] = now.pair.bodies;
            let (low, high) = (a.min(b), a.max(b));
            let of_pair = |p: &Point| {
                p.key.owner == now.entity.to_bits() && matches!(p.against, Against::Faces(_))
            };
            if low != high && self.points.iter().any(of_pair) {
                last[low] = last[low].max(high);
            }
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
        !self.range(bodies).is_empty()
    }

    /// Energy (J) of the contacts of some bodies at positions `x`; forces and tangents are kept until the next call.
    /// The forces of friction are those with the limits of the last call that did not keep them.
    pub fn evaluate(&mut self, bodies: &Range<usize>, x: &Places, limits: Limits) -> f64 {
        let range = self.range(bodies);
        let (parts, faces) = (&self.parts, &self.faces);
        let mut sum = 0.0;
        for (point, active) in self.points[range.clone()].iter_mut().zip(&mut self.active[range]) {
            *active = point.evaluate(parts, faces, x.now, x.start, limits);
            sum += active.energy;
        }
        sum
    }

    /// Adds to the tangents what the last one missed of the resistance of a point to its way since then: normals that
    /// turn in a furrow between faces, limits of friction that follow the pressure. Call it once a round, at the
    /// positions `x` of the last evaluation.
    pub fn learn(&mut self, bodies: &Range<usize>, x: &dyn Fn(u32) -> DVec3, first: bool) {
        let range = self.range(bodies);
        self.rounds.resize(self.active.len(), (Active::default(), DVec3::ZERO));
        for (active, (last, place)) in
            self.active[range.clone()].iter_mut().zip(&mut self.rounds[range])
        {
            let place_of = |active: &Active| {
                let shares = active.rows.iter().zip(active.weights).filter(|(_, w)| *w != 0.0);
                shares.map(|(row, weight)| weight * x(*row)).sum::<DVec3>()
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

    /// Holds the points that touched at the start of the step and no more do, as if they could be pulled: the best guess
    /// of which will touch at its end. The next evaluation lets them go.
    pub fn keep_touching(&mut self, bodies: &Range<usize>) {
        let range = self.range(bodies);
        for (point, active) in self.points[range.clone()].iter().zip(&mut self.active[range]) {
            let touched = point.memory.pressure > 0.0 && point.multiplier.is_none();
            if touched && active.pressure <= 0.0 && active.gap.is_finite() {
                let stiffness = point.area * point.k;
                active.on = true;
                active.push = -stiffness * active.gap * active.normal;
                active.block += stiffness * outer(active.normal, active.normal);
            }
        }
    }

    /// Calls `f` with every row of some bodies that is pushed, and the force (N) on it, at the last evaluation.
    pub fn for_forces(&self, bodies: &Range<usize>, mut f: impl FnMut(usize, DVec3)) {
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let force = active.push + active.rub;
            for (row, weight) in active.rows.iter().zip(active.weights) {
                if weight != 0.0 {
                    f(*row as usize, weight * force);
                }
            }
        }
    }

    /// What the contacts of some bodies add to the matrix, at the last evaluation.
    pub fn blocks(&self, bodies: &Range<usize>) -> ContactBlocks {
        let mut blocks = ContactBlocks::default();
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let used = || active.rows.iter().zip(active.weights).filter(|(_, w)| *w != 0.0);
            for (&row, weight) in used() {
                blocks.diagonal.push((row, weight * weight * active.block));
            }
            if used().count() > 1 {
                let Active { rows, weights, block, .. } = *active;
                blocks.couplings.push(Coupling { rows, weights, block });
            }
        }
        blocks.diagonal.sort_by_key(|(row, _)| *row);
        blocks.diagonal.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 += later.1;
            }
            same
        });
        blocks
    }

    /// Force (N) and tangent (N/m) of the contacts of some bodies on the rows of a piece as a whole, at the last
    /// evaluation.
    pub fn resistance(
        &self,
        bodies: &Range<usize>,
        inside: &dyn Fn(u32) -> bool,
    ) -> (DVec3, DMat3) {
        let (mut force, mut block) = (DVec3::ZERO, DMat3::ZERO);
        for active in self.active[self.range(bodies)].iter().filter(|active| active.on) {
            let used = active.rows.iter().zip(active.weights).filter(|(_, w)| *w != 0.0);
            let share: f64 = used.filter(|(row, _)| inside(**row)).map(|(_, w)| w).sum();
            force += share * (active.push + active.rub);
            block += share * share * active.block;
        }
        (force, block)
    }

    /// Largest depth (m) at the last evaluation of points that did not touch at the start of the step, over the mean
    /// edge of their surface: how much of an impact the step is.
    pub fn impact(&self, bodies: &Range<usize>) -> f64 {
        let range = self.range(bodies);
        let depth = |(point, active): (&Point, &Active)| {
            let new = point.memory.pressure <= 0.0 && active.pressure > 0.0;
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

    /// Whether friction acts anywhere.
    pub fn has_friction(&self) -> bool {
        self.points.iter().any(|point| point.mu > 0.0)
    }

    /// Name of a tool that wants exact contact.
    pub fn exact_tool(&self) -> Option<&str> {
        self.tools.iter().find(|now| now.tool.exact).map(|now| now.name.as_str())
    }

    /// Counts another iteration of the inner loop, and whether it is one that did not converge.
    pub fn count(&mut self, iterations: u32, unconverged: bool) {
        self.figures.inner_iterations += iterations;
        self.figures.unconverged += u32::from(unconverged);
    }

    /// Sum (N) of the magnitudes of the forces on rows of some bodies, at the last evaluation.
    pub fn force_sum(&self, bodies: &Range<usize>) -> f64 {
        let of = |active: &Active| {
            let force = (active.push + active.rub).abs();
            force.x + force.y + force.z
        };
        self.active[self.range(bodies)].iter().filter(|a| a.on).map(of).sum()
    }

    /// Within a step that is cut into parts: what touches goes on from positions `x`, those of the last evaluation.
    pub fn settle(&mut self, x: &dyn Fn(u32) -> DVec3) {
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let force = active.push + active.rub;
            let (tool, way) = match point.against {
                Against::Part(part) => {
                    let own = &self.parts[part];
                    (own.tool, active.at - own.now.carry(active.at, &own.start))
                }
                Against::Hand { .. } => (self.tools.len(), point.carried - point.slip),
                Against::Faces(_) => continue,
            };
            let own = &mut self.settled[tool];
            own.work += force.dot(way);
            own.dissipation += lost(point, active);
        }
        for own in &mut self.parts {
            own.start = own.now;
        }
        for (point, active) in self.points.iter_mut().zip(&self.active) {
            point.memory = remember(point, active);
            point.start = point.at(x);
            if let Against::Hand { .. } = point.against {
                point.slip = point.carried;
            }
        }
    }

    /// Ends the step at positions `x`: what is kept for the next one, and reports. `dt` is its length (s).
    pub fn finish(&mut self, world: &mut World, x: &Places, dt: f64) -> ContactFigures {
        let bodies = 0..self.first.len().saturating_sub(1);
        self.set_part(1.0, dt);
        self.evaluate(&bodies, x, Limits::Keep);
        self.memory.clear();
        for (point, active) in self.points.iter().zip(&self.active) {
            let kept = remember(point, active);
            if kept != Memory::default() {
                self.memory.push((point.key, kept));
            }
        }
        // points are sorted by key, and so is what is kept of them
        self.report_tools(world, x, dt);
        self.report_pairs(world);
        self.report_pulls(world);
        self.keep_forces();
        let mut edge_depth = 0.0_f64;
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            if matches!(point.against, Against::Hand { .. }) {
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
        self.stored = self.points.iter().zip(&self.active).map(|(p, a)| stored(p, a)).sum();
        self.figures.energy = self.stored;
        self.figures
    }

    /// Energy (J) stored in contacts and pulls at the end of the last step.
    pub fn stored(&self) -> f64 {
        self.stored
    }

    /// Force (N) on a tool with the elastic slip that is kept for the next step in place of that at its start: no
    /// force of this step, but what some programs record as such.
    pub fn force_by_kept_slip(&self, tool: Entity) -> Option<DVec3> {
        let now = self.tools.iter().find(|now| now.entity == tool)?;
        let mut force = DVec3::ZERO;
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            if matches!(point.against, Against::Part(part) if now.parts.contains(&part)) {
                let n = point.normal;
                let before = point.slip - n * n.dot(point.slip);
                let slip = active.slip - before + point.kept_slip(active);
                let pull = (point.k * slip.length()).min(point.limit);
                force -= active.push - point.area * pull * slip.normalize_or_zero();
            }
        }
        Some(force)
    }

    /// Forces (N) that contact and pulls exert on vertex rows at the end of the last step, ascending.
    pub fn forces(&self) -> &[(u32, DVec3)] {
        &self.forces
    }

    /// Pressures (Pa) on vertex rows at the end of the last step, ascending; rows without are left out.
    pub fn pressures(&self) -> &[(u32, f64)] {
        &self.pressures
    }

    fn keep_forces(&mut self) {
        let mut forces = Vec::new();
        let mut pressures: Vec<(u32, f64)> = Vec::new();
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let force = active.push + active.rub;
            for (&row, weight) in active.rows.iter().zip(active.weights).filter(|(_, w)| *w != 0.0)
            {
                forces.push((row, weight * force));
                if active.pressure > 0.0 && !matches!(point.against, Against::Hand { .. }) {
                    let area = self.vertex_area(row);
                    if area > 0.0 {
                        let share = weight.abs() * point.area * active.pressure / area;
                        pressures.push((row, share));
                    }
                }
            }
        }
        forces.sort_by_key(|(row, _)| *row);
        forces.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 += later.1;
            }
            same
        });
        pressures.sort_by_key(|(row, _)| *row);
        pressures.dedup_by(|later, first| {
            let same = later.0 == first.0;
            if same {
                first.1 += later.1;
            }
            same
        });
        (self.forces, self.pressures) = (forces, pressures);
    }

    fn vertex_area(&self, row: u32) -> f64 {
        for known in &self.skins {
            if let Ok(at) = known.skin.rows.binary_search(&row) {
                return known.skin.area[at];
            }
        }
        0.0
    }

    fn report_tools(&mut self, world: &mut World, x: &Places, dt: f64) {
        let live: Vec<u64> = {
            let mut query = world.query_filtered::<Entity, With<Tool>>();
            query.iter(world).map(Entity::to_bits).collect()
        };
        self.states.retain(|sequence, _| live.contains(sequence));
        // those that are away in this step feel nothing
        let mut query = world.query::<(Entity, &Tool, &mut ToolReport)>();
        for (entity, _, mut report) in query.iter_mut(world) {
            if !self.tools.iter().any(|now| now.entity == entity) && report.energy > 0.0 {
                let ToolReport { position, rotation, opening, work, dissipation, .. } = *report;
                let away = ToolReport { position, rotation, opening, ..ToolReport::default() };
                *report = ToolReport { work, dissipation, ..away };
            }
        }
        for index in 0..self.tools.len() {
            let mut report = self.report_tool(index, dt);
            if self.tools[index].tool.error_bar {
                report.other_points = Some(self.other_force(index, x));
            }
            let now = &self.tools[index];
            let state = self.states.entry(now.id).or_default();
            state.pose = now.end;
            state.work += report.work;
            state.dissipation += report.dissipation;
            report.work = state.work;
            report.dissipation = state.dissipation;
            // a tool that was drawn in grows again
            state.drawn_in = self.parts[now.parts.clone()].iter().map(|p| p.drawn_in).collect();
            let edge = self.skins.iter().map(|k| k.skin.edge).fold(0.0, f64::max);
            for drawn_in in &mut state.drawn_in {
                *drawn_in = (*drawn_in - (GROWTH * dt).min(0.5 * edge)).max(0.0);
            }
            self.figures.lag = self.figures.lag.max(report.lag);
            if let Ok(mut entity) = world.get_entity_mut(now.entity) {
                if let Some(mut tool) = entity.get_mut::<Tool>() {
                    tool.placed = false;
                }
                entity.insert(report);
            }
        }
    }

    fn report_tool(&mut self, index: usize, dt: f64) -> ToolReport {
        let now = &self.tools[index];
        let turn = now.end.rotation * now.start.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let mut report = ToolReport {
            position: now.end.position,
            rotation: now.end.rotation,
            opening: now.end.opening,
            velocity: (now.end.position - now.start.position) / dt,
            angular_velocity: turn.to_scaled_axis() / dt,
            lag: now.lag,
            centre: now.end.position,
            ..ToolReport::default()
        };
        if now.appears {
            (report.velocity, report.angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
        }
        let (mut weight, mut centre) = (0.0, DVec3::ZERO);
        for part in &self.parts[now.parts.clone()] {
            report.drawn_in = report.drawn_in.max(part.drawn_in);
        }
        for (point, active) in self.points.iter().zip(&self.active).filter(|(_, a)| a.on) {
            let Against::Part(part) = point.against else { continue };
            if !now.parts.contains(&part) {
                continue;
            }
            let force = -(active.push + active.rub);
            report.force += force;
            report.normal -= active.push;
            report.friction -= active.rub;
            report.torque += (active.at - now.end.position).cross(force);
            // what the tool's matter at this place went
            let part = &self.parts[part];
            let way = active.at - part.end.carry(active.at, &part.start);
            report.work -= force.dot(way);
            report.energy += stored(point, active);
            let lost = lost(point, active);
            report.dissipation += lost;
            self.figures.friction_dissipation += lost;
            if active.pressure > 0.0 {
                report.area += point.area;
                report.depth = report.depth.max(-active.gap);
                report.pressure = report.pressure.max(active.pressure);
                let push = point.area * active.pressure;
                weight += push;
                centre += push * active.at;
            }
            if sticks(point, active) {
                report.sticking += 1;
            } else {
                report.slipping += 1;
            }
        }
        if weight > 0.0 {
            report.centre = centre / weight;
        }
        let Settled { work, dissipation } = self.settled[index];
        report.work += work;
        report.dissipation += dissipation;
        self.figures.friction_dissipation += dissipation;
        report
    }

    /// Force (N) on a tool by points of the other kind at the same state.
    fn other_force(&mut self, index: usize, x: &Places) -> DVec3 {
        let mut force = DVec3::ZERO;
        for part in self.tools[index].parts.clone() {
            for body in 0..self.skins.len() {
                let other = match self.kind_of_points(index, part, body) {
                    Points::Vertex => Points::Faces(2),
                    _ => Points::Vertex,
                };
                let mut points = Vec::new();
                self.collect(index, part, body, other, &mut points);
                for mut point in points {
                    point.mu = 0.0;
                    let active =
                        point.evaluate(&self.parts, &self.faces, x.now, x.start, Limits::Take);
                    force -= active.push;
                }
            }
        }
        force
    }

    fn report_pairs(&mut self, world: &mut World) {
        for now in &self.pairs {
            let mut report = BodyContactReport::default();
            let own = |p: &Point| {
                p.key.owner == now.entity.to_bits() && matches!(p.against, Against::Faces(_))
            };
            let points = self.points.iter().zip(&self.active);
            for (point, active) in points.filter(|(p, a)| a.on && own(p)) {
                let force = active.push + active.rub;
                if now.pair.bodies[0] != now.pair.bodies[1] {
                    report.force += if point.key.part == 0 { force } else { -force };
                }
                report.area += point.area;
                report.depth = report.depth.max(-active.gap);
                let lost = lost(point, active);
                *self.dissipated.entry(now.entity.to_bits()).or_default() += lost;
                self.figures.friction_dissipation += lost;
                if sticks(point, active) {
                    report.sticking += 1;
                } else {
                    report.slipping += 1;
                }
            }
            report.dissipation =
                self.dissipated.get(&now.entity.to_bits()).copied().unwrap_or_default();
            if let Ok(mut entity) = world.get_entity_mut(now.entity) {
                entity.insert(report);
            }
        }
    }

    fn report_pulls(&mut self, world: &mut World) {
        for now in &mut self.pulls {
            let Ok(mut entity) = world.get_entity_mut(now.entity) else { continue };
            let mut report = entity.get::<PullReport>().copied().unwrap_or_default();
            (report.force, report.torque, report.distance) = (DVec3::ZERO, DVec3::ZERO, 0.0);
            let pose = now.pull.target;
            let centre = pose.centre + pose.translation;
            for (point, active) in self.points.iter().zip(&self.active) {
                let Against::Hand { to, from, .. } = point.against else { continue };
                if point.key.owner != now.entity.to_bits() {
                    continue;
                }
                let force = -(active.push + active.rub);
                report.force += force;
                report.torque += (to - centre).cross(force);
                report.distance += point.area * active.gap;
                report.work -= force.dot(to - from);
            }
            now.pull.last = pose;
            entity.insert(report);
            if let Some(mut pull) = entity.get_mut::<Pull>() {
                pull.last = pose;
                pull.anchors.clone_from(&now.pull.anchors);
            }
        }
    }

    /// Substeps that the step to come needs, so that no tool passes through what it meets: 1 in all but fast motion.
    pub fn substeps(&mut self, world: &mut World, positions: fn(&mut World) -> Vec<DVec3>) -> u32 {
        // errors come back in the step
        if self.read(world).is_err() {
            return 1;
        }
        let mut most = 1.0_f64;
        let mut at = Vec::new();
        for now in self.tools.iter().filter(|now| !now.appears) {
            for part in &self.parts[now.parts.clone()] {
                let ways = longest_way(part) / self.longest_step(part);
                if ways <= most {
                    continue;
                }
                let swept = swept(part);
                if at.is_empty() {
                    at = positions(world);
                }
                let near = (0..self.skins.len()).any(|body| {
                    let skin = self.skin(now, body);
                    let mut hull = EMPTY;
                    for &row in &skin.rows {
                        let Some(at) = at.get(row as usize) else { continue };
                        hull = [hull[0].min(*at), hull[1].max(*at)];
                    }
                    overlap(&grown(hull, skin.edge), &swept)
                });
                if near {
                    most = ways;
                }
            }
        }
        (most.ceil() as u32).clamp(1, MOST_SUBSTEPS)
    }
}

/// The world gets its [`ContactSet`] with the first tool, contact or pull.
pub(crate) fn install(mut world: DeferredWorld, _: HookContext) {
    world.commands().queue(|world: &mut World| {
        world.init_resource::<ContactSet>();
    });
}

/// What is kept of a point.
fn remember(point: &Point, active: &Active) -> Memory {
    let gripped = point.mu.is_infinite() && (active.pressure > 0.0 || point.memory.gripped);
    let side = point.memory.side;
    if active.pressure <= 0.0 && !gripped {
        return Memory { side, ..Memory::default() };
    }
    Memory {
        slip: point.kept_slip(active),
        normal: point.kept_normal(active),
        pressure: active.pressure,
        gripped,
        side,
    }
}

/// Energy (J) that a point stores: penetration and elastic slip, or the spring of a pull.
fn stored(point: &Point, active: &Active) -> f64 {
    if !active.on {
        return 0.0;
    }
    if let Against::Hand { .. } = point.against {
        return 0.5 * point.area * point.k * active.gap * active.gap;
    }
    let slip = point.kept_slip(active).length_squared();
    0.5 * point.area * (active.pressure * active.pressure / point.k + point.k * slip)
}

/// Energy (J) that friction took in the step.
fn lost(point: &Point, active: &Active) -> f64 {
    let l = active.slip.length();
    if point.limit > 0.0 && point.k * l > point.limit {
        point.area * point.limit * (l - point.limit / point.k)
    } else {
        0.0
    }
}

/// Whether a point in contact sticks.
fn sticks(point: &Point, active: &Active) -> bool {
    point.limit > 0.0 && point.k * active.slip.length() <= point.limit
}

fn stiffness(stiffness: Stiffness, young: f64, edge: f64) -> f64 {
    match stiffness {
        Stiffness::Relative(factor) => factor * young / edge,
        Stiffness::Absolute(k) => k,
    }
}

/// Most (m) that a point of a part moves in the step.
fn longest_way(part: &PartNow) -> f64 {
    let shift = part.start.centre.distance(part.end.centre);
    let reach = part.shape.reach();
    let angle = part.start.rotation.angle_between(part.end.rotation);
    if reach.is_finite() { shift + angle * reach } else { shift }
}

/// The box (m) that a part passes in the step.
fn swept(part: &PartNow) -> [DVec3; 2] {
    let start = part.shape.bounds(part.start.centre, part.start.rotation);
    let end = part.shape.bounds(part.end.centre, part.end.rotation);
    [start[0].min(end[0]), start[1].max(end[1])]
}
