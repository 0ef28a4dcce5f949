//! The points that may be touched in the step to come: of surfaces near tools, of bodies near others, of patches that
//! hands pull on.

use super::near::longest_way;
use super::*;

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

    pub(super) fn kind_of_points(&self, tool: usize, part: usize, body: usize) -> Points {
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

    /// Draws the surface of a part in as far as points are deep inside of it.
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
    pub(super) fn collect(
        &self,
        tool: usize,
        part_index: usize,
        body: usize,
        kind: Points,
        points: &mut Vec<ContactPoint>,
    ) {
        let (now, part) = (&self.tools[tool], &self.parts[part_index]);
        let skin = self.skin(now, body);
        let longest = longest_way(part);
        let reach = part.shape.bounds(part.end.centre, part.end.rotation);
        let reach = grown(reach, longest);
        let slack = longest + 1e-9 * skin.edge;
        let thin = part.shape.thickness() < skin.edge;
        let point = |(key_rows, number), rows, weights, outward, [area, young]: [f64; 2]| {
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
                side: if now.tool.keeps_side { side } else { Side::default() },
                ..ContactPoint::new(key, Against::Part(part_index), (rows, weights), area, k)
            }
        };
        // points in faces, or vertices
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
                        let numbers = [area, young];
                        points.push(point((rows, number), rows, *weights, outward, numbers));
                    }
                }
            }
        } else {
            skin.near(&reach, |i| {
                if part.gap(skin.at[i], &Side::default()).0 <= slack + skin.way[i] {
                    let row = skin.rows[i];
                    let id = ([row, NO_ROW, NO_ROW], 0);
                    let numbers = [skin.area[i], skin.young[i]];
                    let outward = skin.normals[i];
                    points.push(point(id, [row; 3], [1.0, 0.0, 0.0], outward, numbers));
                }
            });
        }
    }

    /// Points of bodies that may touch other bodies.
    pub(super) fn find_pair_points(&mut self, rest: &[DVec3]) {
        let (mut points, mut faces, mut buried) = (Vec::new(), Vec::new(), 0);
        for now in &self.pairs {
            let [a, b] = now.of.bodies;
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

    /// Vertices of body `from` near faces of body `to`.
    fn collect_pair(
        &self,
        now: &Now<BodyContact>,
        direction: u32,
        [from, to]: [usize; 2],
        rest: &[DVec3],
        points: &mut Vec<ContactPoint>,
        faces: &mut Vec<[VertexRow; 3]>,
    ) -> u32 {
        let mut buried = 0;
        let (own, other) = (&self.skins[from].skin, &self.skins[to].skin);
        if !overlap(&own.hull, &other.hull) {
            return 0;
        }
        let common = [own.hull[0].max(other.hull[0]), own.hull[1].min(other.hull[1])];
        // vertices and faces near the common box
        let mut near = Vec::new();
        own.near(&common, |i| {
            if overlap(&grown([own.at[i]; 2], own.way[i]), &common) {
                near.push(i);
            }
        });
        let Some(bins) = Bins::new(other, common) else { return 0 };
        let softer = |young: f64| {
            let of_other = other.young.iter().copied().fold(f64::INFINITY, f64::min) / other.edge;
            (young / own.edge).min(of_other)
        };
        // the faces that each vertex may reach
        let mut chosen = Vec::new();
        for i in near {
            let at = own.at[i];
            chosen.clear();
            for (face, reach) in bins.at(at) {
                let local = other.faces[face];
                if !overlap(&grown([at; 2], own.way[i]), reach) {
                    continue;
                }
                if from == to {
                    let here = rest[own.rows[i].index()];
                    let near_at_rest = local.iter().any(|&v| {
                        let row = other.rows[v as usize];
                        row == own.rows[i] || rest[row.index()].distance(here) < 2.0 * own.edge
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
            let key = PointKey::of_vertex(from as u32, now.id, direction, row);
            let mut memory = self.remembered(&key);
            let first = faces.len();
            faces.extend(
                chosen.iter().map(|&face| other.faces[face].map(|v| other.rows[v as usize])),
            );
            let x = |row: VertexRow| match other.rows.binary_search(&row) {
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
            let k = match now.of.stiffness {
                Stiffness::Relative(factor) => factor * softer(own.young[i]),
                Stiffness::Absolute(k) => k,
            };
            let against = Against::Faces(first..faces.len());
            let point =
                ContactPoint::new(key, against, ([row; 3], [1.0, 0.0, 0.0]), half * own.area[i], k);
            points.push(ContactPoint {
                friction: now.of.friction,
                memory,
                slip: memory.slip,
                ..point
            });
        }
        buried
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
                let own = ([row; 3], [1.0, 0.0, 0.0]);
                let against = Against::Hand(hand);
                self.points.push(ContactPoint::new(
                    key,
                    against,
                    own,
                    weight / sum,
                    pull.stiffness,
                ));
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

/// Faces of a surface near a box, sorted into the cells of a grid that are as large as the largest of them, so that
/// the work grows with the surface in that box alone.
struct Bins {
    origin: DVec3,
    size: f64,
    /// Face, and the box (m) that it may reach in this step.
    reach: Vec<(usize, [DVec3; 2])>,
    /// Cell and place in `reach`, ascending.
    cells: Vec<([i64; 3], u32)>,
}

impl Bins {
    /// `None` where no face is near.
    fn new(skin: &ContactSkin, within: [DVec3; 2]) -> Option<Self> {
        let mut bins = Self { origin: within[0], size: 0.0, reach: Vec::new(), cells: Vec::new() };
        for (face, local) in (0..).zip(&skin.faces) {
            let corners = local.map(|v| skin.at[v as usize]);
            let way = local.iter().map(|&v| skin.way[v as usize]).fold(0.0, f64::max);
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let reach = grown([low, high], way + 0.5 * skin.edge);
            if overlap(&reach, &within) {
                bins.size = bins.size.max((reach[1] - reach[0]).max_element());
                bins.reach.push((face, reach));
            }
        }
        if bins.reach.is_empty() || bins.size <= 0.0 {
            return None;
        }
        for (place, (_, [low, high])) in (0..).zip(&bins.reach) {
            let (low, high) = (bins.cell(*low), bins.cell(*high));
            for i in low[0]..=high[0] {
                for j in low[1]..=high[1] {
                    for k in low[2]..=high[2] {
                        bins.cells.push(([i, j, k], place));
                    }
                }
            }
        }
        bins.cells.sort_unstable();
        Some(bins)
    }

    fn cell(&self, x: DVec3) -> [i64; 3] {
        ((x - self.origin) / self.size).floor().as_i64vec3().to_array()
    }

    /// Faces in the cell of a point.
    fn at(&self, x: DVec3) -> impl Iterator<Item = (usize, &[DVec3; 2])> {
        let own = self.cell(x);
        let first = self.cells.partition_point(|(cell, _)| *cell < own);
        let here = self.cells[first..].iter().take_while(move |(cell, _)| *cell == own);
        here.map(|&(_, place)| {
            let (face, reach) = &self.reach[place as usize];
            (*face, reach)
        })
    }
}
