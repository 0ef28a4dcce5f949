//! The points that may be touched in the step to come: of surfaces near tools, of patches that hands pull on.

use super::lines::known_rows;
use super::*;
use crate::edge::YIELD;
use crate::shape::Shape;

/// Share of the force between a part of a tool and a body by points that it met from inside, above which it is taken to have
/// gone through the surface.
const HELD_FROM_INSIDE: f64 = 0.5;

impl ContactSet {
    /// Remembered state of a point.
    pub(super) fn remembered(&self, key: &PointKey) -> PointMemory {
        let found = self.kept.points.binary_search_by_key(key, |(key, _)| *key);
        found.map_or_else(|_| PointMemory::default(), |i| self.kept.points[i].1)
    }

    /// Points that tools may touch.
    pub(super) fn find_tool_points(&mut self) {
        let mut points = Vec::new();
        for index in 0..self.tools.len() {
            let mut buried = false;
            for part in self.tools[index].parts.clone() {
                if self.tools[index].appears {
                    self.draw_in(index, part);
                }
                for body in 0..self.skins.len() {
                    self.find_normals(index, part, body);
                    let kind = self.kind_of_points(index, part, body);
                    let first = points.len();
                    let gap = self.collect(index, part, body, kind, &mut points);
                    if self.is_pierced(index, part, body, gap, &points[first..]) {
                        let now = &mut self.tools[index];
                        now.pierced.push([part - now.parts.start, body]);
                        now.released +=
                            points.drain(first..).map(|point| point.kept()).sum::<f64>();
                        self.figures.pierced += 1;
                        continue;
                    }
                    buried |= gap > 0.0 && self.is_buried(index, part, body);
                }
            }
            self.figures.buried += u32::from(buried);
        }
        self.points.append(&mut points);
    }

    /// Whether a part that touches nothing is wholly inside of a solid body. One that was told what to touch may be.
    fn is_buried(&self, tool: usize, part: usize, body: usize) -> bool {
        let (now, part, skin) = (&self.tools[tool], &self.parts[part], &self.skins[body].skin);
        let [low, high] = part.bounds(&part.end);
        let within = skin.hull[0].cmple(low).all() && high.cmple(skin.hull[1]).all();
        now.tool.faces.is_none()
            && part.of.is_bounded()
            && part.drawn_in == 0.0
            && within
            && skin.encloses(part.end.centre)
    }

    /// Whether a part that comes no nearer than `gap` (m) to points of a body went through the surface of that body, by the
    /// side from which it pressed them: it then holds them from inside, however it is moved. Until it is out of the body it
    /// touches nothing of it. One that was told what to touch may be inside.
    fn is_pierced(
        &self,
        tool: usize,
        part: usize,
        body: usize,
        gap: f64,
        points: &[ContactPoint],
    ) -> bool {
        let (now, own) = (&self.tools[tool], &self.parts[part].of);
        if now.appears || now.tool.faces.is_some() || !own.is_bounded() {
            return false;
        }
        let known = self.kept.tools.get(&now.id);
        if known.is_some_and(|known| known.pierced.contains(&[part - now.parts.start, body])) {
            return gap < 0.0 || self.skins[body].skin.encloses(self.parts[part].end.centre);
        }
        let (mut pressed, mut behind) = (0.0, 0.0);
        for point in points {
            let push = point.area * point.memory.pressure;
            pressed += push;
            behind += if point.came_from_behind() { push } else { 0.0 };
        }
        behind > HELD_FROM_INSIDE * pressed
    }

    /// Normals of a surface that a part may touch.
    fn find_normals(&mut self, tool: usize, part: usize, body: usize) {
        let (now, part) = (&self.tools[tool], &self.parts[part]);
        if part.of.cavity || !part.reach().meets(&self.skin(now, body).hull) {
            return;
        }
        let key = (now.id, body);
        let skin = match self.own_skins.get_mut(&key) {
            Some(own) if now.tool.faces.is_some() => &mut own.skin,
            _ => &mut self.skins[body].skin,
        };
        skin.find_normals();
    }

    pub(super) fn kind_of_points(&self, tool: usize, part: usize, body: usize) -> Points {
        let now = &self.tools[tool];
        let edge = self.skin(now, body).edge;
        let part = &self.parts[part].of;
        let thickness = part.shape.thickness();
        match now.tool.points {
            // the wall of a cavity meets vertices first
            Points::Auto if thickness >= DENSE * edge || part.cavity => Points::Vertex,
            Points::Auto => {
                let n = (DENSE * edge / thickness).ceil() as u32;
                Points::Faces(n.clamp(2, MOST_POINTS))
            }
            chosen => chosen,
        }
    }

    /// Draws the surface of a part in as far as points are deep inside of it.
    fn draw_in(&mut self, tool: usize, part: usize) {
        let mut deepest = 0.0_f64;
        let now = &self.tools[tool];
        for body in 0..self.skins.len() {
            let skin = self.skin(now, body);
            let part = &self.parts[part];
            let place = PartNow { now: part.start, drawn_in: 0.0, ..part.clone() };
            let reach = part.reach();
            let meets = |of: &[DVec3; 2]| reach.meets(of);
            skin.near(meets, |i| {
                let depth = -place.gap(skin.at[i], &Side::default()).0;
                if depth > INSIDE * skin.edge {
                    deepest = deepest.max(depth);
                }
            });
        }
        self.parts[part].drawn_in = deepest;
        self.figures.drawn_in += u32::from(deepest > 0.0);
    }

    /// Points of one body that a part may touch; the least of their distances (m).
    pub(super) fn collect(
        &self,
        tool: usize,
        part_index: usize,
        body: usize,
        kind: Points,
        points: &mut Vec<ContactPoint>,
    ) -> f64 {
        let mut least = f64::INFINITY;
        let (now, part) = (&self.tools[tool], &self.parts[part_index]);
        let skin = self.skin(now, body);
        let reach = part.reach();
        let slack = part.longest_way() + part.slack + 1e-9 * skin.edge;
        let thin = part.of.shape.thickness() < skin.edge;
        // from outside of a cavity the nearest side leads back
        let is_blade = matches!(part.of.shape, Shape::Blade { .. });
        let keeps_side = is_blade || now.tool.keeps_side && !part.of.cavity;
        let point = |(key_rows, number), own, outward, [area, young]: [f64; 2]| {
            let key = PointKey {
                body: body as u32,
                owner: now.id,
                part: (part_index - now.parts.start) as u32,
                rows: key_rows,
                number,
            };
            let memory = self.remembered(&key);
            let k = stiffness(now.tool.stiffness, young, skin.edge);
            let side =
                Side { outward, straight: thin && outward != DVec3::ZERO, ..Side::default() };
            ContactPoint {
                friction: if now.tool.grip { f64::INFINITY } else { now.tool.friction },
                memory: PointMemory { gripped: memory.gripped && now.tool.grip, ..memory },
                multiplier: now.tool.exact.then_some(memory.pressure),
                side: if keeps_side { side } else { Side::default() },
                ..ContactPoint::new(key, Against::Part(part_index), own, area, k)
            }
        };
        // points in faces, or vertices
        if let Points::Faces(n) = kind {
            if !reach.meets(&skin.hull) {
                return least;
            }
            let places = [false, true].map(|four| face_points(n, four));
            for (face, local) in skin.faces.iter().enumerate() {
                let used = corners(local);
                let x = local.map(|v| skin.at[v as usize]);
                let (own, way) = skin.bounds(face, &skin.way);
                if !reach.meets(&grown(own, way)) {
                    continue;
                }
                let rows = local.map(|v| skin.rows[v as usize]);
                let keys = rows.map(|row| skin.key(row));
                let outward = skin.outward(face);
                let young = skin.mean(&skin.young, face);
                let places = &places[usize::from(used.len() == 4)];
                for (number, weights) in (0..).zip(places) {
                    let at = (0..4).map(|i| x[i] * weights[i]).sum();
                    let gap = part.gap(at, &Side::default()).0;
                    if gap <= slack + way {
                        least = least.min(gap);
                        let area = skin.part_area(face, weights) / places.len() as f64;
                        let id = ([keys[0], keys[1], keys[2]], number);
                        points.push(point(id, (rows, *weights), outward, [area, young]));
                    }
                }
            }
        } else {
            let meets = |of: &[DVec3; 2]| reach.meets(of);
            skin.near(meets, |i| {
                let gap = part.gap(skin.at[i], &Side::default()).0;
                if gap <= slack + skin.way[i] {
                    least = least.min(gap);
                    let row = skin.rows[i];
                    let id = ([skin.key(row), NO_ROW, NO_ROW], 0);
                    let numbers = [skin.area[i], skin.young[i]];
                    let outward = skin.normals.get(i).copied().unwrap_or_default();
                    points.push(point(id, alone(row), outward, numbers));
                }
            });
        }
        least
    }

    /// Points that edges hold.
    fn edges(&self, world: &World) -> Vec<ContactPoint> {
        let mut points = Vec::new();
        for (index, now) in self.tools.iter().enumerate() {
            let state = world.get::<EdgeState>(now.entity);
            let (Some(edge), Some(state)) = (&now.tool.edge, state) else { continue };
            let Some([_, across]) = edge.across() else { continue };
            let segments = state.points.len().saturating_sub(1) as u32;
            for (number, own) in state.points.iter().enumerate() {
                let width = 0.5 * own.width;
                let local = edge.point(number as u32, segments);
                let first = now.tool.start.opening;
                let from = edge.place(local, &now.start, first) + now.spring.from;
                for (side, hold) in (0..).zip(own.holds.iter().flatten()) {
                    let key = PointKey {
                        body: hold.body as u32,
                        owner: now.id,
                        part: u32::MAX,
                        rows: [NO_ROW; 3],
                        number: 2 * number as u32 + side,
                    };
                    let against = Against::Edge(EdgeNow { tool: index, local, from });
                    let rows = (hold.rows, hold.weights);
                    points.push(ContactPoint {
                        limit: own.limit,
                        normal: now.end.rotation * across,
                        ..ContactPoint::new(key, against, rows, width, state.stiffness)
                    });
                }
            }
        }
        points
    }

    /// Points that edges hold.
    pub(super) fn find_edge_points(&mut self, world: &World) {
        let mut points = self.edges(world);
        self.points.append(&mut points);
    }

    /// Points that hold needles.
    pub(super) fn find_needle_points(&mut self, world: &World) {
        for (index, now) in self.tools.iter().enumerate() {
            let state = world.get::<EdgeState>(now.entity).map(|state| &state.needle);
            let (Some(needle), Some(state)) = (now.tool.needle, state) else { continue };
            let rows = known_rows(&mut self.holds, world, now.id, &state.holds());
            let yields = now.spring.from;
            let [start, end] = [now.start, now.end]
                .map(|pose| RigidPose { centre: pose.position + yields, rotation: pose.rotation });
            let of = NeedleNow {
                tool: index,
                needle,
                start,
                end,
                now: end,
                rest: 0.0,
                k: state.tip_stiffness(&needle),
                limits: [0.0, state.tip_limit(&needle)],
                across: 0.0,
                is_tip: true,
            };
            for (number, rows) in (0..).zip(rows) {
                let own = state.points.get(number);
                let (Some(rows), true) = (*rows, own.is_none_or(|own| own.held)) else { continue };
                let bodies = &world.resource::<Topology>().bodies;
                let body = bodies.partition_point(|body| body.vertices.end <= rows.0[0].0);
                let of = match own {
                    Some(point) => {
                        let skin = &self.skins[body].skin;
                        let young = skin.young.iter().sum::<f64>() / skin.young.len().max(1) as f64;
                        let k = stiffness(now.tool.stiffness, young, state.edge);
                        let most = needle.friction * point.width;
                        NeedleNow {
                            rest: point.rest,
                            k: most / (YIELD * state.edge),
                            limits: [most; 2],
                            across: k * state.edge * state.spacing(),
                            is_tip: false,
                            ..of
                        }
                    }
                    None => of,
                };
                let key = PointKey {
                    body: body as u32,
                    owner: now.id,
                    part: u32::MAX,
                    rows: [NO_ROW; 3],
                    number: number as u32,
                };
                let k = of.k.max(of.across);
                self.points.push(ContactPoint::new(
                    key,
                    Against::Needle(Box::new(of)),
                    rows,
                    1.0,
                    k,
                ));
            }
        }
    }

    /// Points of patches that hands pull on.
    pub(super) fn find_pull_points(&mut self, world: &World, x: &dyn Fn(VertexRow) -> DVec3) {
        let bodies = &world.resource::<Topology>().bodies;
        let dt = world.resource::<StepClock>().dt;
        let part = world.get_resource::<StepPart>().copied().unwrap_or_default();
        for (index, now) in self.pulls.iter_mut().enumerate() {
            let pull = &mut now.of;
            let (start, end) = (pull.last, pull.target);
            if part.index + 1 == part.count {
                pull.last = end;
            }
            if pull.anchors.len() != pull.rows.len() {
                pull.anchors = pull.rows.iter().map(|&row| x(row)).collect();
            }
            let sum: f64 = pull.weights.iter().sum();
            let patch = pull.rows.iter().zip(&pull.weights).zip(&pull.anchors);
            for (number, ((&row, weight), anchor)) in (0..).zip(patch) {
                let carried = |pose: &sinew_engine::load::Pose| *anchor + pose.way(*anchor);
                // a part of a step makes its part of the way
                let (start, end) = (carried(&start), carried(&end));
                let at =
                    |parts: u32| start + (end - start) * (f64::from(parts) / f64::from(part.count));
                let from = at(part.index);
                let to = if part.index + 1 < part.count { at(part.index + 1) } else { end };
                let velocity = (to - from) / dt;
                let (damping, rate, silent) = (pull.damping, 0.0, DVec3::ZERO);
                let hand = Hand { pull: index, from, to, velocity, damping, rate, silent };
                let body = bodies.partition_point(|body| body.vertices.end <= row.0) as u32;
                let key = PointKey::of_vertex(body, now.id, number, row);
                let (against, own) = (Against::Hand(hand), alone(row));
                let share = weight / sum;
                self.points.push(ContactPoint::new(key, against, own, share, pull.stiffness));
            }
        }
    }
}

fn stiffness(stiffness: Stiffness, young: f64, edge: f64) -> f64 {
    match stiffness {
        Stiffness::Relative(factor) => factor * young / edge,
        Stiffness::Absolute(k) => k,
    }
}

/// One vertex row and its share.
pub(super) fn alone(row: VertexRow) -> ([VertexRow; 4], [f64; 4]) {
    ([row; 4], [1.0, 0.0, 0.0, 0.0])
}
