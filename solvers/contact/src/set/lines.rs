//! Threads and clips of the step: what holds them, their forces and tangents, what they keep.

use super::report::orders;
use super::*;
use crate::thread::{Clip, Hold, Hole, Segment, Thread, ThreadReport, slides};
use sinew_engine::columns::set;
use sinew_engine::layout::UNUSED;
use sinew_engine::surface::{PointReader, TissuePoint};

/// Length of a segment over the mean free length below which it acts as a spring: its direction means nothing there.
const SHORT: f64 = 1e-3;
/// Slide over free length up to which a point counts as one that holds.
const STILL: f64 = 1e-12;

/// State of a thread or clip that is kept from step to step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct LineState {
    /// Its points that hold it, ascending.
    held: Vec<u32>,
    /// Free lengths (m) between them, and those by which their stiffness is measured.
    free: Vec<f64>,
    measure: Vec<f64>,
    /// Ends at which it slips through its first or last point, and its length (m) beyond it.
    loose: [bool; 2],
    tails: [f64; 2],
    /// Tails (m) that it was last given.
    given: [f64; 2],
    drawn: [f64; 2],
    /// Where places in space were (m), by number of the point.
    places: Vec<(u32, DVec3)>,
    slid: Vec<f64>,
    broken: bool,
    lost: u32,
    work: f64,
    dissipation: f64,
}

impl LineState {
    /// Of a thread that takes hold where its points are `spans` (m) apart.
    fn new(wanted: &Wanted, spans: &[f64]) -> Self {
        let all: f64 = spans.iter().sum();
        let length = wanted.of.length.unwrap_or(all);
        let even = 1.0 / spans.len() as f64;
        let share = |span: &f64| if all > 0.0 { span / all } else { even };
        let free: Vec<f64> = spans.iter().map(|span| length * share(span)).collect();
        let least = SHORT * length * even;
        Self {
            held: (0..wanted.of.points.len() as u32).collect(),
            measure: free.iter().map(|own| own.max(least)).collect(),
            free,
            loose: wanted.of.tails.map(|tail| tail > 0.0),
            tails: wanted.of.tails,
            given: wanted.of.tails,
            slid: vec![0.0; wanted.of.points.len()],
            ..Self::default()
        }
    }

    fn fits(&self) -> bool {
        self.held.is_sorted()
            && self.held.iter().all(|&i| (i as usize) < self.slid.len())
            && self.free.len() == self.held.len().saturating_sub(1)
            && self.measure.len() == self.free.len()
    }

    /// Knots ends that were free when it was given, and are no more.
    fn knot(&mut self, tails: [f64; 2]) {
        for end in 0..2 {
            if self.given[end] > 0.0 && tails[end] == 0.0 {
                (self.loose[end], self.tails[end]) = (false, 0.0);
            }
        }
        self.given = tails;
    }

    /// Takes over points that have come before the last one, so that all are at these places (m). Free length is neither made nor
    /// lost: that of the last segment is shared out, or it comes from the tail where there was none.
    fn take_over(&mut self, at: &[DVec3]) {
        let (before, last) = (self.slid.len() - 1, at.len() - 1);
        self.slid.splice(before..before, std::iter::repeat_n(0.0, last - before));
        let [before, last] = [before as u32, last as u32];
        self.places.iter_mut().filter(|own| own.0 == before).for_each(|own| own.0 = last);
        if self.held.pop_if(|held| *held == before).is_none() {
            return;
        }
        let through = self.held.last().copied().into_iter().chain(before..=last);
        let through: Vec<DVec3> = through.map(|i| at[i as usize]).collect();
        let spans: Vec<f64> = through.windows(2).map(|two| two[0].distance(two[1])).collect();
        let all: f64 = spans.iter().sum();
        let (free, measure) = self.free.pop().zip(self.measure.pop()).unwrap_or_else(|| {
            self.tails[0] -= all;
            (all, all)
        });
        let even = 1.0 / spans.len() as f64;
        for span in spans {
            let share = if all > 0.0 { span / all } else { even };
            self.free.push(free * share);
            self.measure.push(measure * share.max(SHORT * even));
        }
        self.held.extend(before..=last);
    }

    /// What there is to tell of it without a step.
    fn report(&self) -> ThreadReport {
        ThreadReport {
            held: self.held.clone(),
            free: self.free.clone(),
            slid: self.slid.clone(),
            lost: self.lost,
            broken: self.broken,
            work: self.work,
            dissipation: self.dissipation,
            ..ThreadReport::default()
        }
    }

    /// Forgets a point: its segments become one, or the tail of a free end.
    fn drop_point(&mut self, at: usize) {
        self.held.remove(at);
        self.lost += 1;
        let last = self.free.len();
        if at == 0 || at == last {
            let segment = at.min(last.wrapping_sub(1));
            if last > 0 {
                let end = usize::from(at > 0);
                self.measure.remove(segment);
                self.tails[end] += self.free.remove(segment);
                self.loose[end] = true;
            }
        } else {
            for lengths in [&mut self.free, &mut self.measure] {
                lengths[at - 1] += lengths.remove(at);
            }
        }
    }
}

/// Rows and weights of a point in tissue; none for one that is lost.
pub(super) type Rows = Option<TissuePoint>;

/// Rows that hold a thread, and what they were found for.
#[derive(Clone, Debug, Default)]
pub(super) struct KnownHolds {
    version: (u64, u64),
    points: Vec<Hold>,
    rows: Vec<Rows>,
}

/// A point that holds a thread in this step.
#[derive(Clone, Debug)]
pub(super) struct Hook {
    rows: [VertexRow; 4],
    weights: [f64; 4],
    /// Place (m) of one in space at the start of the step, in substeps of what is left, and at its end; none of tissue.
    way: Option<[DVec3; 2]>,
    /// Where it is (m).
    at: DVec3,
}

impl Hook {
    pub(super) fn used(&self) -> impl Iterator<Item = (VertexRow, f64)> + '_ {
        self.rows.iter().copied().zip(self.weights).filter(|(_, weight)| *weight != 0.0)
    }
}

/// A thread or clip in this step.
#[derive(Clone, Debug)]
pub(super) struct Line {
    own: Wanted,
    /// Consecutive bodies that it joins.
    pub(super) bodies: Range<usize>,
    hooks: Vec<Hook>,
    state: LineState,
    /// Length (m) to be drawn past its ends in what is left of the step, and now.
    draw: [f64; 2],
    drawn: [f64; 2],
    /// Limits (N) of the difference of tensions at every point, now and at the start of the step.
    limits: [Vec<f64>; 2],
    /// At the last evaluation: vectors from point to point over their lengths (m), tensions (N), slides (m), energy (J).
    normals: Vec<DVec3>,
    spans: Vec<f64>,
    tension: Vec<f64>,
    taut: Vec<bool>,
    slide: Vec<f64>,
    energy: f64,
    settled: Settled,
}

impl Line {
    fn segments(&self) -> usize {
        self.state.free.len()
    }

    /// Free lengths (m) and stiffnesses (N/m) of its segments now, but for slides.
    fn lengths(&self) -> (Vec<f64>, Vec<f64>) {
        let LineState { free, measure, .. } = &self.state;
        if self.own.is_clip {
            return (free.clone(), vec![self.own.of.stiffness; free.len()]);
        }
        let mut free = free.clone();
        let last = free.len() - 1;
        free[0] -= self.drawn[0];
        free[last] -= self.drawn[1];
        let scale = self.scale();
        (free, measure.iter().map(|own| self.own.of.stiffness / (scale * own)).collect())
    }

    /// What is left of its length once so much is drawn past its ends, over what there was.
    fn scale(&self) -> f64 {
        let before: f64 = self.state.measure.iter().sum();
        1.0 - (self.drawn[0] + self.drawn[1]) / before
    }

    fn short(&self) -> f64 {
        SHORT * self.state.measure.iter().sum::<f64>() / self.segments() as f64
    }

    /// Finds its tensions where points are at `x`.
    fn evaluate(&mut self, x: &dyn Fn(VertexRow) -> DVec3, limits: Limits) {
        for hook in self.hooks.iter_mut().filter(|hook| hook.way.is_none()) {
            hook.at = hook.rows.iter().zip(hook.weights).map(|(&row, w)| w * x(row)).sum();
        }
        let (free, k) = self.lengths();
        let short = self.short();
        self.normals.clear();
        self.spans.clear();
        let mut segments = Vec::with_capacity(free.len());
        for (pair, (free, &k)) in self.hooks.windows(2).zip(free.iter().zip(&k)) {
            let way = pair[1].at - pair[0].at;
            let d = way.length();
            self.spans.push(d);
            self.normals.push(if d > short { way / d } else { way / short.max(f64::MIN_POSITIVE) });
            let length = if d >= short { d } else { 0.5 * (d * d / short + short) };
            segments.push(Segment { stretch: length - free, k });
        }
        let ends = self.state.loose;
        if limits == Limits::Recall {
            self.limits[0] = self.limits[1].clone();
        }
        if !matches!(limits, Limits::Keep | Limits::Recall) {
            let holes = self.holes();
            let (t, _) = slides(&segments, &holes, ends);
            let halfway = limits == Limits::Approach;
            for (i, (limit, hole)) in self.limits[0].iter_mut().zip(&holes).enumerate() {
                let before = if i > 0 { t[i - 1] } else { 0.0 };
                let lower = before.min(t.get(i).copied().unwrap_or(0.0));
                let now = (hole.factor - 1.0) * lower + hole.force;
                *limit = if halfway { 0.5 * (*limit + now) } else { now };
            }
        }
        let kept = self.limits[0].iter().map(|&force| Hole { factor: 1.0, force });
        let kept: Vec<Hole> = kept.collect();
        (self.tension, self.slide) = slides(&segments, &kept, ends);
        let stretch = |i: usize| segments[i].stretch - (self.slide[i + 1] - self.slide[i]);
        self.taut =
            (0..segments.len()).map(|i| self.tension[i] > 0.0 || stretch(i) >= 0.0).collect();
        self.energy = self.stored(&k) + self.lost();
    }

    /// What its points let through at the directions found.
    fn holes(&self) -> Vec<Hole> {
        let Thread { friction, grip: force, .. } = self.own.of;
        let angle = |i: usize| match (i.checked_sub(1), self.normals.get(i)) {
            (Some(before), Some(&b)) if friction > 0.0 => {
                let a = self.normals[before];
                libm::atan2(a.cross(b).length(), a.dot(b))
            }
            _ => 0.0,
        };
        let factor = |i| libm::exp(friction * angle(i));
        (0..self.hooks.len()).map(|i| Hole { factor: factor(i), force }).collect()
    }

    /// Energy (J) stored in its tensions.
    fn stored(&self, k: &[f64]) -> f64 {
        self.tension.iter().zip(k).map(|(t, k)| 0.5 * t * t / k).sum()
    }

    /// Energy (J) that friction takes.
    fn lost(&self) -> f64 {
        self.slide.iter().zip(&self.limits[0]).map(|(s, limit)| limit * s.abs()).sum()
    }

    /// Force (N) on every point.
    pub(super) fn forces(&self) -> impl Iterator<Item = (&Hook, DVec3)> {
        let pull = |i: usize| self.normals.get(i).map_or(DVec3::ZERO, |n| self.tension[i] * *n);
        let force = move |i: usize| pull(i) - if i > 0 { pull(i - 1) } else { DVec3::ZERO };
        self.hooks.iter().enumerate().map(move |(i, hook)| (hook, force(i)))
    }

    /// Where the needle of a tool draws it, and the force (N) on that.
    pub(super) fn pull_on_needle(&self, tool: Order) -> Option<(DVec3, DVec3)> {
        let last = self.own.of.points.len().checked_sub(1)?;
        let is_held = self.state.held.last() == Some(&(last as u32));
        let draws = matches!(self.own.of.points[last], Hold::Needle(own) if own == tool);
        let (hook, force) = self.forces().last().filter(|_| is_held && draws)?;
        Some((hook.at, force))
    }

    /// Calls `f` with every vector (N/m)^(1/2) of the tangent `sum v v^T`, row by row.
    fn for_vectors(&self, f: &mut dyn FnMut(&[(VertexRow, DVec3)])) {
        let (_, k) = self.lengths();
        let still = STILL * self.state.measure.iter().sum::<f64>();
        let mut entries = Vec::new();
        let add = |entries: &mut Vec<(VertexRow, DVec3)>, i: usize, v: DVec3| {
            for (end, sign) in [(i, -1.0), (i + 1, 1.0)] {
                entries.extend(self.hooks[end].used().map(|(row, w)| (row, sign * w * v)));
            }
        };
        let mut send = |entries: &mut Vec<(VertexRow, DVec3)>| {
            sum_by_row(entries);
            if !entries.is_empty() {
                f(entries);
            }
            entries.clear();
        };
        // segments of which a tension is that of all
        let mut first = 0;
        for i in 0..self.segments() {
            let slips = |at: usize| self.limits[0][at] == 0.0 || self.slide[at].abs() > still;
            if i + 1 < self.segments() && slips(i + 1) {
                continue;
            }
            let group = first..i + 1;
            first = i + 1;
            let ends = [(group.start, 0), (group.end, 1)];
            let outer = [0, self.segments()];
            let gives = |&(at, end): &(usize, usize)| {
                at == outer[end] && self.state.loose[end] && slips(at)
            };
            if self.taut[group.clone()].iter().all(|taut| *taut) && !ends.iter().any(gives) {
                let root = k[group.clone()].iter().map(|k| 1.0 / k).sum::<f64>().sqrt().recip();
                group.for_each(|i| add(&mut entries, i, root * self.normals[i]));
                send(&mut entries);
            }
        }
        // how directions turn
        let short = self.short();
        for i in (0..self.segments()).filter(|&i| self.taut[i]) {
            let (d, t) = (self.spans[i], self.tension[i]);
            let (ratio, across) = if d > short {
                let (a, b) = self.normals[i].any_orthonormal_pair();
                (t / d, [a, b, DVec3::ZERO])
            } else {
                (if short > 0.0 { t / short } else { k[i] }, DVec3::AXES)
            };
            let root = ratio.sqrt();
            for v in across.into_iter().filter(|v| root * *v != DVec3::ZERO) {
                add(&mut entries, i, root * v);
                send(&mut entries);
            }
        }
    }

    /// Work (J) that hands do from where the last substep ended, by the forces found.
    fn work(&self) -> f64 {
        let moved =
            self.forces().filter_map(|(hook, force)| Some(-force.dot(hook.at - hook.way?[0])));
        let moved: f64 = moved.sum();
        if self.own.is_clip || self.drawn == [0.0; 2] {
            return moved;
        }
        // what is drawn takes its tension along, and the rest of the thread is stiffer by what is gone
        let (_, k) = self.lengths();
        let all = self.drawn[0] + self.drawn[1];
        let length = self.state.measure.iter().sum::<f64>();
        let last = self.segments() - 1;
        let drawn = self.drawn[0] * self.tension[0] + self.drawn[1] * self.tension[last];
        moved + drawn + self.stored(&k) * all / length
    }

    /// Ends a substep: it goes on from the slides found.
    fn settle(&mut self) {
        self.settled.work += self.work();
        self.settled.dissipation += self.lost();
        let (mut free, _) = self.lengths();
        let scale = if self.own.is_clip { 1.0 } else { self.scale() };
        for (i, free) in free.iter_mut().enumerate() {
            *free += self.slide[i + 1] - self.slide[i];
        }
        let state = &mut self.state;
        state.free = free;
        state.measure.iter_mut().for_each(|own| *own *= scale);
        // slides at knots are 0
        state.tails[0] += self.slide[0];
        state.tails[1] -= self.slide[self.slide.len() - 1];
        for (i, &number) in state.held.iter().enumerate() {
            state.slid[number as usize] += self.slide[i];
        }
        for end in 0..2 {
            state.drawn[end] += self.drawn[end];
            self.draw[end] -= self.drawn[end];
        }
        self.drawn = [0.0; 2];
        self.slide.fill(0.0);
        for hook in &mut self.hooks {
            if let Some(way) = &mut hook.way {
                way[0] = hook.at;
            }
        }
    }

    /// Puts hands where they are when this part of what is left of the step has passed.
    pub(super) fn set_part(&mut self, part: f64) {
        for hook in &mut self.hooks {
            if let Some([from, to]) = hook.way {
                hook.at = if part == 1.0 { to } else { from + (to - from) * part };
            }
        }
        self.drawn = self.draw.map(|draw| draw * part);
    }
}

/// What a thread or clip is to be; a clip as a thread of one segment with a stiffness of its own.
#[derive(Clone, Debug)]
struct Wanted {
    entity: Entity,
    id: Order,
    is_clip: bool,
    strength: f64,
    of: Thread,
}

/// What threads and clips are read by.
type Lines = (Entity, &'static Order, Option<&'static Thread>, Option<&'static Clip>);

/// Threads and clips, in order of creation.
fn wanted(
    world: &World,
    query: &mut QueryState<Lines, Or<(With<Thread>, With<Clip>)>>,
) -> Result<Vec<Wanted>, StepError> {
    let topology = world.resource::<Topology>();
    let (rows, bodies) = (topology.vertex_count(), topology.bodies.len());
    let mut all = Vec::new();
    for (entity, &id, thread, clip) in query.iter(world) {
        let threads = thread.map(|own| (own.problem(rows, bodies), own.clone(), f64::INFINITY));
        let clips = clip.map(|own| {
            let of = Thread::new(own.name.clone(), own.points.to_vec(), own.stiffness);
            let of = Thread { length: Some(own.length), ..of };
            (own.problem(rows, bodies), of, own.strength.unwrap_or(f64::INFINITY))
        });
        let is_clip = clips.is_some();
        for (problem, of, strength) in threads.into_iter().chain(clips) {
            if let Some(problem) = problem {
                return Err(StepError::InvalidContact { name: of.name, problem });
            }
            all.push(Wanted { entity, id, is_clip, strength, of });
        }
    }
    all.sort_unstable_by_key(|own| (own.id, own.entity));
    Ok(all)
}

/// Rows and weights of points now.
fn find_rows(world: &World, points: &[Hold]) -> Vec<Rows> {
    let topology = world.resource::<Topology>();
    let reader = world.get_resource::<PointReader>();
    let find = |point: &Hold| match point {
        Hold::Tissue { body, element, vertices, weights } => {
            (reader?.0)(world, *body, *element, (*vertices, *weights))
        }
        Hold::Vertices { rows, weights } => {
            let is_left = |row: &VertexRow| {
                let local = |own: &BodyRows| Some(own.piece[own.local(*row)?.0 as usize]);
                topology.bodies.iter().find_map(local).is_some_and(|piece| piece != UNUSED)
            };
            let mut found = ([rows[0]; 4], [0.0; 4]);
            for (i, (&row, &weight)) in rows.iter().zip(weights).enumerate() {
                (found.0[i], found.1[i]) = (row, weight);
            }
            rows.iter().all(is_left).then_some(found)
        }
        Hold::Place(_) | Hold::Needle(_) => Some(([NO_ROW; 4], [0.0; 4])),
    };
    points.iter().map(find).collect()
}

/// Rows and weights of the points of a thread, clip or needle now, found again when they or bodies changed.
pub(super) fn known_rows<'a>(
    all: &'a mut BTreeMap<Order, KnownHolds>,
    world: &World,
    id: Order,
    points: &[Hold],
) -> &'a [Rows] {
    let topology = world.resource::<Topology>();
    let changes = topology.bodies.iter().map(|body| body.changes).sum();
    let version = (topology.revision, changes);
    let known = all.entry(id).or_default();
    if known.version != version || known.points != points {
        let (points, rows) = (points.to_vec(), find_rows(world, points));
        *known = KnownHolds { version, points, rows };
    }
    &known.rows
}

impl ContactSet {
    /// Where a place in space is as a part of the step begins and ends, of a point that is one: this share of what is left.
    fn way(&self, point: &Hold, from: Option<DVec3>, share: f64) -> Option<[DVec3; 2]> {
        match point {
            Hold::Place(at) => {
                Some([from.unwrap_or(*at), from.map_or(*at, |from| from + (*at - from) * share)])
            }
            Hold::Needle(tool) => {
                let now = self.tools.iter().find(|now| now.id == *tool)?;
                let needle = now.tool.needle?;
                let end =
                    |pose: &ToolPose| pose.position + pose.rotation * needle.place(needle.length);
                Some([from.unwrap_or_else(|| end(&now.start)), end(&now.end)])
            }
            _ => None,
        }
    }

    /// Finds the threads and clips of the step.
    pub(super) fn find_lines(
        &mut self,
        world: &mut World,
        x: &dyn Fn(VertexRow) -> DVec3,
    ) -> Result<(), StepError> {
        self.lines.clear();
        self.left.clear();
        let all = with_query(world, |world, query| wanted(world, query))?;
        for own in &all {
            let draws = |now: &&ToolNow| own.of.points.contains(&Hold::Needle(now.id));
            if let Some(tool) =
                self.tools.iter().find(draws).filter(|now| now.tool.spring.is_some())
            {
                let (name, tool) = (own.of.name.clone(), &tool.name);
                let problem = format!(
                    "needle `{tool}` draws it and is held by a spring, which does not feel it; move the needle rigidly"
                );
                return Err(StepError::InvalidContact { name, problem });
            }
        }
        let is_needle = |id: &Order| self.tools.iter().any(|now| now.id == *id);
        self.holds.retain(|id, _| all.iter().any(|own| own.id == *id) || is_needle(id));
        for own in &all {
            known_rows(&mut self.holds, world, own.id, &own.of.points);
            let part = world.get_resource::<StepPart>().copied().unwrap_or_default();
            match self.line(world, own, part.share_of_rest(), x)? {
                Ok(line) => self.lines.push(line),
                Err(left) => self.left.push((own.entity, own.id, left)),
            }
        }
        Ok(())
    }

    /// A thread or clip of the step, or what is left of one that does nothing any more.
    fn line(
        &self,
        world: &World,
        own: &Wanted,
        share: f64,
        x: &dyn Fn(VertexRow) -> DVec3,
    ) -> Result<Result<Line, LineState>, StepError> {
        let rows = &self.holds[&own.id].rows;
        let count = own.of.points.len();
        let known = self.kept.lines.get(&own.id).cloned();
        let known = known.filter(|known| (1..=count).contains(&known.slid.len()) && known.fits());
        let grown = known.as_ref().map_or(0, |known| count - known.slid.len());
        let hook = |known: Option<&LineState>, i: u32| {
            let (rows, weights) = rows[i as usize].unwrap_or(([NO_ROW; 4], [0.0; 4]));
            // of a step in parts, this part
            let kept = known.and_then(|known| known.places.iter().find(|(of, _)| *of == i));
            let way = self.way(&own.of.points[i as usize], kept.map(|(_, at)| *at), share);
            let inside = || rows.iter().zip(weights).filter(|(_, w)| *w != 0.0);
            let at = way.map_or_else(|| inside().map(|(&row, w)| w * x(row)).sum(), |way| way[0]);
            Hook { rows, weights, way, at }
        };
        let mut state = match known {
            Some(known) if grown == 0 => known,
            known => {
                let at = (0..count as u32).map(|i| hook(known.as_ref(), i).at).collect::<Vec<_>>();
                match known {
                    Some(mut known) => {
                        known.take_over(&at);
                        known
                    }
                    None => {
                        let spans = at.windows(2).map(|two| two[0].distance(two[1]));
                        LineState::new(own, &spans.collect::<Vec<f64>>())
                    }
                }
            }
        };
        state.knot(own.of.tails);
        // a needle that is taken away lets the thread go; one that has not come yet draws none
        let lays = state.free.is_empty();
        let gone = |i: &u32| match &own.of.points[*i as usize] {
            point @ Hold::Needle(_) => !lays && self.way(point, None, share).is_none(),
            _ => rows[*i as usize].is_none(),
        };
        while let Some(at) = state.held.iter().position(gone) {
            state.drop_point(at);
        }
        for end in 0..2 {
            while state.loose[end] && state.tails[end] <= 0.0 && !state.held.is_empty() {
                state.drop_point(if end == 0 { 0 } else { state.held.len() - 1 });
            }
        }
        if state.broken || state.free.is_empty() {
            return Ok(Err(state));
        }
        let invalid =
            |problem: String| Err(StepError::InvalidContact { name: own.of.name.clone(), problem });
        let length: f64 = state.measure.iter().sum();
        let draw = [0, 1].map(|end| (own.of.drawn[end] - state.drawn[end]) * share);
        if !own.is_clip && length == 0.0 {
            return invalid("its points lie on each other: give it a length".into());
        }
        if !own.is_clip && draw[0] + draw[1] >= length {
            let more = draw[0] + draw[1];
            return invalid(format!(
                "{more} m are drawn out of it in this step, and {length} m are left"
            ));
        }
        let hooks: Vec<Hook> = state.held.iter().map(|&i| hook(Some(&state), i)).collect();
        let bodies = &world.resource::<Topology>().bodies;
        let body = |row: VertexRow| bodies.partition_point(|own| own.vertices.end <= row.0);
        let joined = hooks.iter().flat_map(Hook::used).map(|(row, _)| body(row));
        let joined: Vec<usize> = joined.collect();
        let first = joined.iter().min().copied().unwrap_or(0);
        let n = hooks.len();
        let mut line = Line {
            own: own.clone(),
            bodies: first..joined.iter().max().copied().unwrap_or(0) + 1,
            hooks,
            state,
            draw,
            drawn: [0.0; 2],
            limits: [vec![0.0; n], Vec::new()],
            normals: Vec::new(),
            spans: Vec::new(),
            tension: Vec::new(),
            taut: Vec::new(),
            slide: vec![0.0; n],
            energy: 0.0,
            settled: Settled::default(),
        };
        // the limits of the end of the last step
        line.evaluate(x, Limits::Take);
        line.limits[1] = line.limits[0].clone();
        Ok(Ok(line))
    }

    /// Threads and clips that hold some bodies.
    pub(super) fn lines(&self, bodies: &Range<usize>) -> impl Iterator<Item = &Line> {
        let own = bodies.clone();
        self.lines.iter().filter(move |line| own.contains(&line.bodies.start))
    }

    /// Energy (J) of threads and clips of some bodies at positions `x`.
    pub(super) fn evaluate_lines(
        &mut self,
        bodies: &Range<usize>,
        x: &dyn Fn(VertexRow) -> DVec3,
        limits: Limits,
    ) -> f64 {
        let own = self.lines.iter_mut().filter(|line| bodies.contains(&line.bodies.start));
        own.map(|line| {
            line.evaluate(x, limits);
            line.energy
        })
        .sum()
    }

    /// Vectors `v` (N/m)^(1/2) of the tangent `sum v v^T` of threads and clips of some bodies.
    pub(super) fn line_vectors(&self, bodies: &Range<usize>) -> Vec<Vec<(u32, DVec3)>> {
        let mut vectors = Vec::new();
        for line in self.lines(bodies) {
            line.for_vectors(&mut |own| {
                vectors.push(own.iter().map(|(row, v)| (row.0, *v)).collect());
            });
        }
        vectors
    }

    /// Bounds of the rows that threads and clips stiffen, for [`rates`](Self::rates): a segment couples two points by no more
    /// than its stiffness.
    pub(super) fn line_rates(&self) -> Vec<(VertexRow, f64, f64)> {
        let mut rates = Vec::new();
        for line in &self.lines {
            let (_, k) = line.lengths();
            for (i, k) in k.iter().enumerate() {
                for hook in &line.hooks[i..i + 2] {
                    let size: f64 = hook.weights.iter().map(|w| w.abs()).sum();
                    rates.extend(hook.used().map(|(row, w)| (row, 2.0 * size * w.abs() * k, 0.0)));
                }
            }
        }
        rates
    }

    /// What tensions do (J) along the rounding of places.
    pub(super) fn line_rounding(
        &self,
        bodies: &Range<usize>,
        of_row: &dyn Fn(VertexRow) -> f64,
    ) -> f64 {
        let of = |line: &Line| {
            let blur = |hook: &Hook| match hook.way {
                Some(_) => f64::EPSILON * hook.at.abs().max_element(),
                None => hook.used().map(|(row, w)| w.abs() * of_row(row)).sum::<f64>(),
            };
            let pairs = line.hooks.windows(2).zip(&line.tension);
            pairs.map(|(pair, t)| t * (blur(&pair[0]) + blur(&pair[1]))).sum::<f64>()
        };
        self.lines(bodies).map(of).sum()
    }

    /// Energy (J) stored in threads and clips, and the work (J) of their hands, up to the last substep.
    pub(super) fn line_books(&self) -> [f64; 2] {
        let stored = self.lines.iter().map(|line| line.stored(&line.lengths().1)).sum();
        [stored, self.lines.iter().map(|line| line.settled.work).sum()]
    }

    /// Ends a substep.
    pub(super) fn settle_lines(&mut self) {
        self.lines.iter_mut().for_each(Line::settle);
    }

    /// Writes what threads and clips keep, and their reports; the energy (J) that they store.
    pub(super) fn report_lines(&mut self, world: &mut World) -> f64 {
        let mut energy = 0.0;
        let live = orders::<Or<(With<Thread>, With<Clip>)>>(world);
        self.kept.lines.retain(|id, _| live.contains(id));
        for line in &mut self.lines {
            let ends = {
                let mut forces = line.forces().map(|(_, force)| force);
                let first = forces.next().unwrap_or_default();
                [first, forces.last().unwrap_or_default()]
            };
            line.settle();
            let mut stored = line.stored(&line.lengths().1);
            let largest = line.tension.iter().copied().fold(0.0, f64::max);
            let state = &mut line.state;
            if largest > line.own.strength && !self.figures.missed {
                state.broken = true;
                state.dissipation += std::mem::take(&mut stored);
            }
            let Settled { work, dissipation } = line.settled;
            self.figures.friction_dissipation += dissipation;
            state.work += work;
            state.dissipation += dissipation;
            let places = state.held.iter().zip(&line.hooks);
            state.places = places
                .filter(|(_, hook)| hook.way.is_some())
                .map(|(i, hook)| (*i, hook.at))
                .collect();
            energy += stored;
            let report = ThreadReport {
                points: line.hooks.iter().map(|hook| hook.at).collect(),
                tension: line.tension.clone(),
                spans: line.spans.clone(),
                length: line.spans.iter().sum(),
                ends,
                unconverged: self.figures.missed,
                ..state.report()
            };
            self.kept.lines.insert(line.own.id, state.clone());
            if let Ok(mut entity) = world.get_entity_mut(line.own.entity) {
                set(&mut entity, report);
            }
        }
        for (entity, id, state) in self.left.drain(..) {
            if let Ok(mut entity) = world.get_entity_mut(entity) {
                set(&mut entity, state.report());
            }
            self.kept.lines.insert(id, state);
        }
        energy
    }

    /// Adds the forces (N) of threads and clips on vertex rows.
    pub(super) fn add_line_forces(&self, forces: &mut Vec<(VertexRow, DVec3)>) {
        for (hook, force) in self.lines.iter().flat_map(Line::forces) {
            forces.extend(hook.used().map(|(row, weight)| (row, weight * force)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*seed >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    }

    /// A thread through points of two rows each, or a clip.
    fn line(hooks: usize, is_clip: bool, seed: &mut u64) -> Line {
        let n = hooks - 1;
        let hook = |i: usize| {
            let [a, b] = [2 * i, 2 * i + 1].map(|row| VertexRow(row as u32));
            let weights = [0.3, 0.7, 0.0, 0.0];
            Hook { rows: [a, b, a, a], weights, way: None, at: DVec3::ZERO }
        };
        let free: Vec<f64> = (0..n).map(|_| 0.2 + 0.3 * random(seed)).collect();
        let loose = [random(seed) > 0.3, random(seed) > 0.3];
        let friction = if random(seed) > 0.0 { 0.3 } else { 0.0 };
        let grip = if random(seed) > 0.0 { 0.05 } else { 0.0 };
        let of = Thread { friction, grip, ..Thread::new("thread", Vec::new(), 3.0) };
        let (entity, strength) = (Entity::PLACEHOLDER, f64::INFINITY);
        let own = Wanted { entity, id: Order(1), is_clip, strength, of };
        Line {
            own,
            bodies: 0..1,
            hooks: (0..hooks).map(hook).collect(),
            state: LineState {
                held: (0..hooks as u32).collect(),
                measure: if is_clip { vec![0.0] } else { free.clone() },
                free: if is_clip { vec![0.0] } else { free },
                loose: if is_clip { [false; 2] } else { loose },
                ..LineState::default()
            },
            draw: [0.0; 2],
            drawn: if is_clip { [0.0; 2] } else { [0.01, 0.02] },
            limits: [vec![0.0; hooks], vec![0.0; hooks]],
            normals: Vec::new(),
            spans: Vec::new(),
            tension: Vec::new(),
            taut: Vec::new(),
            slide: vec![0.0; hooks],
            energy: 0.0,
            settled: Settled::default(),
        }
    }

    #[test]
    fn forces_and_tangents_of_threads_are_derivatives() {
        let (mut checked, mut slid, mut slack) = (0, 0, 0);
        let seed = &mut 3;
        for case in 0..300 {
            let hooks = 2 + case % 5;
            let mut line = line(hooks, case % 5 == 0 && case % 2 == 0, seed);
            let mut x: Vec<DVec3> = (0..2 * hooks)
                .map(|_| 0.5 * DVec3::new(random(seed), random(seed), random(seed)))
                .collect();
            line.evaluate(&|row| x[row.index()], Limits::Take);
            let mut forces = vec![DVec3::ZERO; x.len()];
            let collect = |line: &Line, forces: &mut [DVec3]| {
                forces.fill(DVec3::ZERO);
                for (hook, force) in line.forces() {
                    hook.used().for_each(|(row, w)| forces[row.index()] += w * force);
                }
            };
            collect(&line, &mut forces);
            let mut tangent = vec![DMat3::ZERO; x.len() * x.len()];
            line.for_vectors(&mut |v| {
                for (a, va) in v {
                    for (b, vb) in v {
                        tangent[a.index() * x.len() + b.index()] += outer(*va, *vb);
                    }
                }
            });
            slid += u32::from(line.slide.iter().any(|s| s.abs() > 1e-3));
            slack += u32::from(line.tension.contains(&0.0));
            let (h, n) = (1e-6, x.len());
            for row in 0..n {
                for axis in DVec3::AXES {
                    let mut at = |sign: f64| {
                        let before = x[row];
                        x[row] += sign * h * axis;
                        line.evaluate(&|row| x[row.index()], Limits::Keep);
                        x[row] = before;
                        let mut forces = vec![DVec3::ZERO; n];
                        collect(&line, &mut forces);
                        (line.energy, forces)
                    };
                    let (more, less) = (at(1.0), at(-1.0));
                    let slope = -(more.0 - less.0) / (2.0 * h);
                    assert!((slope - forces[row].dot(axis)).abs() < 1e-7, "{case}");
                    for (other, (a, b)) in more.1.iter().zip(&less.1).enumerate() {
                        let expected = -(tangent[other * n + row] * axis);
                        let found = (*a - *b) / (2.0 * h);
                        assert!((found - expected).length() < 1e-6, "{case}: {found} {expected}");
                    }
                    checked += 1;
                }
            }
            // what acts between points only has no resultant
            assert!(forces.iter().sum::<DVec3>().length() < 1e-14);
        }
        assert!(checked > 5000 && slid > 50 && slack > 50, "{checked} {slid} {slack}");
    }
}
