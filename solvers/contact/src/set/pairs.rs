//! The points that may be touched in the step to come: of bodies near others.

use super::points::alone;
use super::*;
use crate::beside::{Rim, facet_corners, point_in};
use sinew_engine::surface::closest_point;

/// Cosine between the outward normal of a solid and the normal of a membrane from which on the solid tells on which
/// side of the membrane it is.
const TELLS: f64 = 0.3;

/// Cosine between the normal of a face and the way out of its body from which on it looks that way.
const LOOKS_OUT: f64 = 0.5;

/// Part of the mean edge by which surfaces of a body that touches itself are looked for beyond what a step may bring together:
/// the next steps then need not look. With more the faces beyond those that are left out would always be found.
const MARGIN: f64 = 0.7;

/// A facet that a point may reach.
#[derive(Clone, Copy)]
struct Reached {
    face: usize,
    /// As places in the rows of the surface.
    facet: [u32; 4],
    membrane: bool,
    distance: f64,
    /// Barycentric coordinates of its closest point.
    weights: [f64; 3],
}

impl ContactSet {
    /// Points of bodies that may touch other bodies.
    pub(super) fn find_pair_points(&mut self) {
        for now in &self.pairs {
            // what is solid tells the sides of membranes
            let [a, b] = now.of.bodies;
            for [own, other] in [[a, b], [b, a]] {
                let other = &self.skins[other].skin;
                let wanted = other.sheets < other.faces.len();
                if wanted && overlap(&self.skins[own].skin.hull, &other.hull) {
                    self.skins[own].skin.find_normals();
                }
            }
        }
        let (mut points, mut faces, mut buried) = (Vec::new(), Vec::new(), 0);
        let mut appeared = 0;
        let mut kept = std::mem::take(&mut self.kept.pairs);
        kept.retain(|id, _| self.pairs.iter().any(|now| now.id == *id));
        for now in &self.pairs {
            let [a, b] = now.of.bodies;
            let directions: &[[usize; 2]] = if a == b { &[[a, a]] } else { &[[a, b], [b, a]] };
            let state = kept.entry(now.id).or_insert_with(|| {
                let state = if a == b { PairState::default() } else { self.draw_apart([a, b]) };
                // no way out is better than another for what is wholly inside
                let known = state.drawn_in.is_finite();
                buried += u32::from(!known);
                appeared += u32::from(known && state.drawn_in > 0.0);
                if known { state } else { PairState::default() }
            });
            for (direction, &[from, to]) in (0..).zip(directions) {
                let out = if direction == 0 { state.out } else { -state.out };
                let own = (direction, PairState { out, ..*state });
                let found = self.collect_pair(now, own, [from, to], &mut points, &mut faces);
                (buried, state.clear) = (buried + found.0, found.1);
            }
        }
        self.kept.pairs = kept;
        self.points.append(&mut points);
        self.faces = faces;
        self.figures.buried += buried;
        self.figures.drawn_in += appeared;
    }

    /// How solid bodies are drawn in that appear inside of each other, not at all where they do so by too little; infinitely where
    /// one is wholly inside.
    fn draw_apart(&self, [a, b]: [usize; 2]) -> PairState {
        let (mut by, mut out, mut wholly, mut deep) = (0.0_f64, DVec3::ZERO, false, false);
        for ([from, to], sign) in [([a, b], 1.0), ([b, a], -1.0)] {
            let (own, other) = (&self.skins[from].skin, &self.skins[to].skin);
            let x: &dyn Fn(VertexRow) -> DVec3 = &|row| other.at[row.index()];
            let facets = (0..other.sheets).flat_map(|face| other.facets(face));
            let mut facets: Vec<NearFacet> =
                facets.map(|f| NearFacet { rows: f.map(VertexRow), distance: 0.0 }).collect();
            let mut inside = 0;
            let meets = |of: &[DVec3; 2]| overlap(of, &other.hull);
            own.near(meets, |i| {
                let at = own.at[i];
                if !other.encloses(at) {
                    return;
                }
                inside += 1;
                for facet in &mut facets {
                    facet.distance = distance(at, &facet.rows, x);
                }
                let found = beside(at, &facets, ROUNDING * other.edge, x, Rim::None);
                let Some(Beside { distance, normal, .. }) = found else { return };
                by = by.max(-distance);
                deep |= -distance > INSIDE * other.edge;
                // the deepest know best which way is out
                out += sign * distance * distance * normal;
            });
            wholly |= inside > 0 && inside == own.rows.len();
        }
        match deep {
            true if wholly => PairState { drawn_in: f64::INFINITY, ..PairState::default() },
            true => PairState { drawn_in: by, out: out.normalize_or_zero(), clear: 0.0 },
            false => PairState::default(),
        }
    }

    /// Vertices of body `from` near faces of body `to`; the number of those that are too deep inside of it to tell how
    /// they came there, and how far (m) surfaces are clear of each other.
    fn collect_pair(
        &self,
        now: &Now<BodyContact>,
        (direction, state): (u32, PairState),
        [from, to]: [usize; 2],
        points: &mut Vec<ContactPoint>,
        faces: &mut Vec<NearFacet>,
    ) -> (u32, f64) {
        let mut buried = 0;
        let (own, other) = (&self.skins[from].skin, &self.skins[to].skin);
        // a wall that is not finer than what it meets leaves it to that, and nothing happens between walls
        let coarse = |wall: &ContactSkin, than: &ContactSkin| wall.held && wall.edge >= than.edge;
        let share = match () {
            () if from == to => 1.0,
            () if own.held && other.held || coarse(own, other) => 0.0,
            () if coarse(other, own) => 1.0,
            () => 0.5,
        };
        if share == 0.0 || !overlap(&own.hull, &other.hull) {
            return (0, 0.0);
        }
        let common = [own.hull[0].max(other.hull[0]), own.hull[1].min(other.hull[1])];
        let common = grown(common, state.drawn_in);
        // what a body moves as a whole brings no part of it nearer to another, unless something stops one of them
        let apart = |now: &Now<BodyContact>| {
            let near = |body: &usize| overlap(&self.skins[*body].skin.hull, &own.hull);
            !now.of.bodies.contains(&from)
                || !now.of.bodies.iter().all(near)
                || now.of.bodies == [from; 2]
        };
        let touched = self.points.iter().any(|point| point.key.body as usize == from);
        let within = from == to && !touched && self.pairs.iter().all(apart);
        let within = within.then(|| own.ways_within());
        // where surfaces are well apart they are looked at again when they may have come together
        let most = within.iter().flatten().copied().fold(0.0, f64::max);
        if within.is_some() && state.clear > 2.0 * most {
            return (0, state.clear);
        }
        // it pays where they come a small part of the margin in a step
        let pays = within.is_some() && most < 0.5 * MARGIN * own.edge;
        let margin = if pays { MARGIN * own.edge } else { 0.0 };
        let [own_ways, other_ways] = [own, other].map(|skin| within.as_ref().unwrap_or(&skin.way));
        // vertices and faces near the common box
        let mut near = Vec::new();
        let meets = |of: &[DVec3; 2]| overlap(of, &common);
        own.near(meets, |i| {
            if overlap(&grown([own.at[i]; 2], own_ways[i]), &common) {
                near.push(i);
            }
        });
        let Some(bins) = Bins::new(other, other_ways, common) else { return (0, 0.0) };
        // what cannot give way is no softer than anything
        let of = |skin: &ContactSkin, young: f64| match skin.held {
            true => f64::INFINITY,
            false => young / skin.edge,
        };
        let of_other = of(other, other.young.iter().copied().fold(f64::INFINITY, f64::min));
        let softer = |young: f64| of(own, young).min(of_other);
        let least = near.iter().map(|i| own_ways[*i]).fold(f64::INFINITY, f64::min);
        let slack = 0.5 * own.edge;
        let mut clear = if pays { least + bins.way - slack + margin } else { 0.0 };
        let (mut places, mut reached) = (Vec::new(), Vec::new());
        for i in near {
            let (at, row) = (own.at[i], own.rows[i]);
            let near_at_rest = |face: usize| from == to && own.near_at_rest(i, face);
            // of a body that touches itself, what a point is deep behind is the far side of the body
            let behind = if from == to { DEEP * own.edge } else { f64::INFINITY };
            let way = own_ways[i] + state.drawn_in;
            let within = [way, margin, behind];
            let behind = bins.reach(other, at, within, near_at_rest, &mut places, &mut reached);
            clear = clear.min((behind - slack).max(0.0));
            if !reached.is_empty() {
                clear = 0.0;
                reached.retain(|reached| reached.distance <= way + bins.way);
            }
            if state.drawn_in > 0.0 {
                let x = |row: VertexRow| other.at[row.index()];
                reached.retain(|reached| {
                    let [a, b, c] = facet_corners(&reached.facet.map(VertexRow), &x);
                    let normal = (b - a).cross(c - a);
                    reached.membrane || normal.dot(state.out) > LOOKS_OUT * normal.length()
                });
            }
            if reached.is_empty() {
                continue;
            }
            let key = PointKey::of_vertex(from as u32, now.id, direction, own.key(row));
            let mut memory = self.remembered(&key);
            let (first, mut distance) = (faces.len(), 0.0);
            let some = from == to || state.drawn_in > 0.0;
            let rim = if some { Rim::LeftOut(DEEP * own.edge) } else { Rim::None };
            match other.place((own, i), state.drawn_in, &reached, &memory, rim) {
                Place::Inside => {
                    buried += u32::from(from != to);
                    continue;
                }
                Place::Beyond => {}
                Place::Beside { side, distance: own } => {
                    memory.side = side;
                    distance = own;
                    faces.extend(reached.iter().map(|reached| {
                        let rows = reached.facet.map(|v| other.rows[v as usize]);
                        // membranes show the side that the point is on
                        let behind = reached.membrane && side < 0.0;
                        let rows = if behind { turned(rows) } else { rows };
                        NearFacet { rows, distance: reached.distance }
                    }));
                }
            }
            let k = match now.of.stiffness {
                Stiffness::Relative(factor) => factor * softer(own.young[i]),
                Stiffness::Absolute(k) => k,
            };
            let against = Against::Faces(first..faces.len());
            let mut point = ContactPoint {
                friction: now.of.friction,
                memory,
                slip: memory.slip,
                rim: if rim == Rim::None && memory.side != 0.0 { Rim::Plane } else { rim },
                drawn_in: if memory.side == 0.0 { state.drawn_in } else { 0.0 },
                ..ContactPoint::new(key, against, alone(row), share * own.area[i], k)
            };
            point.note_distance(distance);
            points.push(point);
        }
        (buried, clear)
    }
}

/// The same facet seen from behind.
fn turned([a, b, c, d]: Facet) -> Facet {
    if c == d { [b, a, c, d] } else { [b, a, d, c] }
}

/// Where a point is.
enum Place {
    /// Inside of a solid or behind a membrane, too deep to tell how it came there.
    Inside,
    /// Beyond the rim of a membrane, or of what is left of one beside its own points: there is nothing to touch.
    Beyond,
    /// Beside faces; of membranes on this side, of solids at this signed distance (m), each 0 where the other is nearest.
    Beside { side: f64, distance: f64 },
}

impl ContactSkin {
    /// Where a point of another surface is, which is drawn in (m), with its memory.
    fn place(
        &self,
        (own, i): (&Self, usize),
        drawn_in: f64,
        reached: &[Reached],
        memory: &PointMemory,
        rim: Rim,
    ) -> Place {
        let at = own.at[i];
        let nearer = |a: &&Reached, b: &&Reached| a.distance.total_cmp(&b.distance);
        let Some(nearest) = reached.iter().min_by(nearer) else { return Place::Beyond };
        // once a step, so not compiled for this alone
        let x: &dyn Fn(VertexRow) -> DVec3 = &|row| self.at[row.index()];
        let local = |reached: &Reached| reached.facet.map(VertexRow);
        let facets = |reached| NearFacet { rows: local(reached), distance: reached.distance };
        let facets: Vec<NearFacet> = reached.iter().map(facets).collect();
        let found = beside(at, &facets, ROUNDING * self.edge, x, rim);
        if found.is_none() && nearest.membrane {
            // on no side of it yet
            return Place::Beyond;
        }
        // one that is beside none touches none before it has come to the nearest
        let distance = found.map_or(nearest.distance, |found| found.distance);
        if !nearest.membrane {
            // inside or on the far side of a body
            return match memory.pressure == 0.0 && distance + drawn_in < -DEEP * self.edge {
                true => Place::Inside,
                false => Place::Beside { side: memory.side, distance },
            };
        }
        let triangle = facet_corners(&local(nearest), x);
        let [a, b, c] = triangle;
        let upward = (b - a).cross(c - a).normalize_or_zero();
        let arm = at - point_in(triangle, nearest.weights);
        let height = arm.dot(upward);
        let beyond = (arm - height * upward).length() > 1e-6 * self.edge
            && self.on_rim(nearest.facet, nearest.weights);
        // none where the point is of a membrane
        let facing = own.normals.get(i).map_or(0.0, |normal| normal.dot(upward));
        if beyond {
            return Place::Beyond;
        }
        let side = if memory.side != 0.0 {
            memory.side
        } else if facing.abs() > TELLS {
            -facing.signum()
        } else if distance < 0.0 {
            -1.0
        } else {
            1.0
        };
        // a wall may have edges longer than what it meets is thick
        let deep = DEEP * self.edge.min(own.edge);
        match memory.pressure == 0.0 && side * distance < -deep {
            // it passed through
            true if memory.side != 0.0 => Place::Inside,
            // the far side of something thin
            true => Place::Beyond,
            false => Place::Beside { side, distance: 0.0 },
        }
    }
}

/// Faces of a surface near a box, sorted by the lowest corners of their boxes into the cells of a grid that are as large as the
/// largest of them, so that the work grows with the surface in that box alone.
struct Bins {
    origin: DVec3,
    size: f64,
    /// Most (m) that a face may move in this step, and half an edge.
    way: f64,
    /// The faces, ascending, with their boxes (m).
    faces: Vec<(usize, [DVec3; 2])>,
    /// Cell and place in `faces`, ascending.
    cells: Vec<([i32; 3], u32)>,
}

impl Bins {
    /// `None` where no face is near.
    fn new(skin: &ContactSkin, ways: &[f64], within: [DVec3; 2]) -> Option<Self> {
        let mut faces = Vec::new();
        let (mut way, mut size) = (0.0_f64, 0.0_f64);
        for face in 0..skin.faces.len() {
            let (own, most) = skin.bounds(face, ways);
            if overlap(&grown(own, most + 0.5 * skin.edge), &within) {
                (way, size) = (way.max(most), size.max((own[1] - own[0]).max_element()));
                faces.push((face, own));
            }
        }
        let way = way + 0.5 * skin.edge;
        let size = size + 2.0 * way;
        if faces.is_empty() || size <= 0.0 {
            return None;
        }
        let mut bins = Self { origin: within[0], size, way, faces, cells: Vec::new() };
        let cells = bins.faces.iter().map(|(_, own)| bins.cell_of(own[0] - way));
        bins.cells = cells.zip(0..).collect();
        bins.cells.sort_unstable();
        Some(bins)
    }

    fn cell_of(&self, x: DVec3) -> [i32; 3] {
        ((x - self.origin) / self.size).floor().as_ivec3().to_array()
    }

    /// Places in `faces` of all that a box (m) may meet.
    fn near(&self, [low, high]: [DVec3; 2], places: &mut Vec<u32>) {
        places.clear();
        let (low, high) = (self.cell_of(low - self.size), self.cell_of(high));
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                let [first, last] = [low[2], high[2]].map(|k| [i, j, k]);
                let start = self.cells.partition_point(|(own, _)| *own < first);
                let here = self.cells[start..].iter().take_while(|(own, _)| *own <= last);
                places.extend(here.map(|(_, place)| *place));
            }
        }
    }

    /// All facets that a point may reach in this step that moves by at most `way` (m), and those beyond them within a `margin` (m),
    /// but those of solids that it is `behind` by more than that (m). The distance (m) of the nearest of these, if there is a
    /// margin. Whatever is nearer than one of them is among them: the
    /// nearest of some would not tell on which side of a surface a point is.
    fn reach(
        &self,
        skin: &ContactSkin,
        at: DVec3,
        [way, margin, behind]: [f64; 3],
        left_out: impl Fn(usize) -> bool,
        places: &mut Vec<u32>,
        reached: &mut Vec<Reached>,
    ) -> f64 {
        let way = way + margin;
        reached.clear();
        let mut nearest_behind = f64::INFINITY;
        // fast points reach all faces, and would search more cells than there are
        if 2.0 * way > self.size * (self.faces.len() as f64).cbrt() {
            places.clear();
            places.extend(0..self.faces.len() as u32);
        } else {
            self.near(grown([at; 2], way), places);
        }
        let far = way + self.way;
        let x = |row: VertexRow| skin.at[row.index()];
        for &place in &*places {
            let (face, bounds) = self.faces[place as usize];
            if !overlap(&grown(bounds, far), &[at; 2]) || left_out(face) {
                continue;
            }
            for facet in skin.facets(face) {
                let triangle = facet_corners(&facet.map(VertexRow), &x);
                let [a, b, c] = triangle;
                let upward = (b - a).cross(c - a);
                let hidden = face < skin.sheets && (at - a).dot(upward) < -behind * upward.length();
                // without a margin nobody asks how near it is
                if hidden && margin == 0.0 {
                    continue;
                }
                let weights = closest_point(at, triangle);
                let distance = at.distance(point_in(triangle, weights));
                if hidden {
                    nearest_behind = nearest_behind.min(distance);
                } else if distance <= far {
                    let membrane = face >= skin.sheets;
                    reached.push(Reached { face, facet, membrane, distance, weights });
                }
            }
        }
        reached.sort_by_key(|reached| reached.face);
        nearest_behind
    }
}
