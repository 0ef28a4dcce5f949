//! Blades: tools with a sharp edge cut what they went through in the step before, and find what they hold in the step to come.

use crate::needle;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_contact::edge::{Edge, EdgeHold, EdgePoint, EdgeState, MOST_SEGMENTS, YIELD};
use sinew_contact::pull::hit;
use sinew_contact::tool::{Tool, ToolMotion, ToolPose, ToolReport};
use sinew_engine::order::Order;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{StepSchedule, StepSystems};
use sinew_engine::step::{StepClock, StepError, StepFailure, may_edit};
use sinew_engine::surface::SurfaceReader;
use sinew_engine::topology::Topology;
use sinew_models::cutting::blade::{self, BladeView, EdgeMove};
use sinew_models::cutting::check_cut;
use sinew_models::resection::Requests;

/// How far (edges) beside the plane of a blade the two sides of a wound are looked for, one after the other. A copy with less material than
/// the first would be torn by half of the force.
const BESIDE: [f64; 4] = [0.2, 0.1, 0.02, 0.4];
/// Part of the volume of a whole element that is enough to be held, and what of that on the other side is too little: the force would turn it
/// inside out.
const MUCH: f64 = 0.3;
const LITTLE: f64 = 0.2;
/// How far (edges) beside the plane of a blade its edge counts as in tissue.
const INSIDE: f64 = 0.02;
/// Distance (edges) from what it holds at which an edge has left it.
const LEFT: f64 = 3.0;

/// The system that cuts with edges.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Blades;

/// Lets tools with an edge cut, and those with a needle enter, from the first of them on.
pub(crate) fn install_blades<S: Scalar>(world: &mut World) {
    let cut = cut_with_edges::<S>.in_set(StepSystems::Edit).in_set(Blades);
    let cut = cut.after(Requests).run_if(any_edge);
    world.resource_mut::<Schedules>().entry(StepSchedule).add_systems(cut);
}

fn any_edge(tools: Query<&Tool>) -> bool {
    tools.iter().any(|tool| tool.edge.is_some() || tool.needle.is_some())
}

fn cut_with_edges<S: Scalar>(world: &mut World) {
    if !may_edit::<S>(world) {
        return;
    }
    if let Err(error) = look::<S>(world) {
        world.resource_mut::<StepFailure>().0 = Some(error);
    }
}

/// A tool with an edge: where it stands, and where it will stand at the end of the step to come.
struct Blade {
    entity: Entity,
    name: String,
    edge: Edge,
    /// Opening (rad) of its jaws at first.
    first: f64,
    into: DVec3,
    across: DVec3,
    now: ToolPose,
    then: ToolPose,
    state: EdgeState,
    /// Places (m) to which its points had cut at the last look.
    before: Vec<DVec3>,
}

impl Blade {
    fn at(&self, pose: &ToolPose, number: usize) -> DVec3 {
        let segments = self.state.points.len() as u32 - 1;
        self.edge.place(self.edge.point(number as u32, segments), pose, self.first)
    }

    /// Box (m) round all that it was at and will be at.
    fn bounds(&self) -> [DVec3; 2] {
        let numbers = 0..self.state.points.len();
        let own = numbers.flat_map(|i| [self.at(&self.now, i), self.at(&self.then, i)]);
        let held = self.state.points.iter().map(|point| point.cut_to);
        let all: Vec<DVec3> = own.chain(held).collect();
        let low = all.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        [low, all.into_iter().fold(DVec3::NEG_INFINITY, DVec3::max)]
    }
}

/// A tool with an edge or needle: where it stands, and where it will stand at the end of the step to come.
pub(crate) struct Path {
    pub entity: Entity,
    pub name: String,
    pub now: ToolPose,
    pub then: ToolPose,
    /// It comes there without touching anything on the way.
    pub is_placed: bool,
    pub state: EdgeState,
}

/// Tools that are there, in order of creation.
fn paths(world: &mut World) -> Vec<Path> {
    let clock = *world.resource::<StepClock>();
    let (now, then) = (clock.time, clock.time + clock.dt);
    let mut query = world.query::<(&Order, Entity, &Tool, &ToolReport, &EdgeState)>();
    let mut found: Vec<_> =
        query.iter(world).filter(|(_, _, tool, ..)| tool.active(then)).collect();
    found.sort_unstable_by_key(|(order, entity, ..)| (**order, *entity));
    let of = |(_, entity, tool, report, state): (_, Entity, &Tool, &ToolReport, &EdgeState)| {
        let ToolReport { position, rotation, opening, .. } = *report;
        let came = !state.points.is_empty() || state.needle.came;
        let here = match tool.motion {
            _ if came => ToolPose { position, rotation, opening },
            // targets are reached from where it first stands
            ToolMotion::Follow => tool.start,
            _ => tool.wanted(now, tool.start),
        };
        // a hand that holds it by a spring is elsewhere; what it will give way by then is not known yet
        let is_placed = tool.target().1;
        let is_held = came && !is_placed && tool.spring.is_some();
        let yields = if is_held { report.yields } else { DVec3::ZERO };
        let hand = ToolPose { position: here.position - yields, ..here };
        let mut then = tool.wanted(then, hand);
        then.position += yields;
        // it comes to another place without touching anything on the way
        let now = if is_placed { then } else { here };
        Path { entity, name: tool.name.clone(), now, then, is_placed, state: state.clone() }
    };
    found.into_iter().map(of).collect()
}

impl Blade {
    fn new(world: &World, path: Path) -> Option<Self> {
        let Path { entity, name, now, then, is_placed, state } = path;
        let tool = world.get::<Tool>(entity)?;
        let (edge, first) =
            (tool.edge.filter(|edge| edge.problem().is_none())?, tool.start.opening);
        let [into, across] = edge.across()?.map(|v| now.rotation * v);
        let state = match is_placed {
            true => EdgeState { report: state.report, ..EdgeState::default() },
            false => state,
        };
        let before = state.points.iter().map(|point| point.from).collect();
        Some(Self { entity, name, edge, first, into, across, now, then, state, before })
    }
}

fn look<S: Scalar>(world: &mut World) -> Result<(), StepError> {
    let paths = paths(world);
    let is_needle =
        |path: &Path| world.get::<Tool>(path.entity).is_some_and(|tool| tool.needle.is_some());
    let (needles, others): (Vec<Path>, Vec<Path>) = paths.into_iter().partition(is_needle);
    let mut all: Vec<Blade> =
        others.into_iter().filter_map(|path| Blade::new(world, path)).collect();
    let bodies = world.resource::<Topology>().bodies.len();
    for body in 0..bodies {
        let hull = blade::hull::<S>(world, body);
        let near = |own: &Blade| {
            let [low, high] = own.bounds();
            own.state.points.is_empty() || low.cmple(hull[1]).all() && hull[0].cmple(high).all()
        };
        let near: Vec<usize> = (0..all.len()).filter(|&i| near(&all[i])).collect();
        if near.is_empty() {
            blade::end_stroke(world, body);
            continue;
        }
        let known = check_cut(world, body).map_err(|error| error.to_string());
        let mut cuts = Vec::new();
        for &i in &near {
            let own = &all[i];
            let Err(why) = known.clone().and_then(|()| check_edge(world, body, &own.edge)) else {
                cuts.push(i);
                continue;
            };
            let line = own.edge.ends.map(|x| own.edge.place(x, &own.then, own.first));
            cannot_enter(world, body, (&own.name, "edge meets what it cannot cut"), &line, &why)?;
        }
        if !cuts.is_empty() {
            cut_body::<S>(world, body, &mut all, &cuts)?;
        }
    }
    for own in all {
        if let Some(mut of_tool) = world.get_mut::<EdgeState>(own.entity) {
            *of_tool = own.state;
        }
    }
    needle::look::<S>(world, needles)
}

/// Why an edge cannot cut a body that can be cut.
fn check_edge(world: &World, body: usize, edge: &Edge) -> Result<(), String> {
    let rows = &world.resource::<Topology>().bodies[body];
    if !rows.tetrahedra().is_empty()
        || !rows.tetrahedra10().is_empty()
        || !rows.hexahedra().is_empty()
        || edge.toughness == 0.0
    {
        return Ok(());
    }
    let name = &rows.name;
    Err(format!(
        "body `{name}` is a membrane alone, in which edges have no force yet; take toughness = 0"
    ))
}

/// An error where an edge or needle along a line (m) goes through the surface of a body that it cannot enter.
pub(crate) fn cannot_enter(
    world: &mut World,
    body: usize,
    (name, what): (&str, &str),
    line: &[DVec3],
    why: &str,
) -> Result<(), StepError> {
    let Some(SurfaceReader(read)) = world.get_resource::<SurfaceReader>().copied() else {
        return Ok(());
    };
    let surface = read(world, body);
    let mut places = world.query::<&sinew_engine::vertex::Position>();
    let at: Vec<DVec3> = places.iter(world).map(|x| x.0).collect();
    let rows = &world.resource::<Topology>().bodies[body];
    let (first, count) = (rows.vertices.start, rows.row_count() as u32);
    let row = |v: u32| at.get((first + v) as usize).copied().unwrap_or(DVec3::NAN);
    let place = |v: u32| match v.checked_sub(count).map(|made| surface.points[made as usize]) {
        None => row(v),
        Some(point) => point.shares().map(|(v, w)| w * row(v)).sum(),
    };
    let crosses = |[a, b]: [DVec3; 2]| {
        let triangles = surface.triangles.iter().chain(&surface.sheets);
        let mut corners = triangles.map(|triangle| triangle.map(place));
        corners.any(|own| hit(a, b - a, own).is_some_and(|(part, _)| part <= 1.0))
    };
    match line.windows(2).any(|two| crosses([two[0], two[1]])) {
        false => Ok(()),
        true => Err(StepError::InvalidContact {
            name: name.into(),
            problem: format!("its {what}: {why}"),
        }),
    }
}

/// Cuts a body by what edges crossed, and finds what they hold of it next.
fn cut_body<S: Scalar>(
    world: &mut World,
    body: usize,
    all: &mut [Blade],
    near: &[usize],
) -> Result<(), StepError> {
    let invalid =
        |name: &str, problem: String| StepError::InvalidContact { name: name.into(), problem };
    let name = all[near[0]].name.clone();
    let view = blade::view::<S>(world, body).map_err(|e| invalid(&name, e.to_string()))?;
    let (mut moves, mut cut_to) = (Vec::new(), Vec::new());
    for &i in near {
        let own = &mut all[i];
        if own.state.points.is_empty() {
            begin(own, view.edge);
        }
        let places = advance(own, body, &view);
        let ways = own.before.iter().zip(&places);
        let ways: Vec<(DVec3, DVec3, bool)> =
            ways.map(|(a, (b, moves))| (*a, *b, *moves)).collect();
        for two in ways.windows(2).filter(|two| two[0].2 || two[1].2) {
            let (before, after) = ([two[0].0, two[1].0], [two[0].1, two[1].1]);
            moves.push(EdgeMove { before, after, into: own.into });
        }
        cut_to.push(places);
    }
    let cut =
        blade::sweep::<S>(world, body, &view, &moves).map_err(|e| invalid(&name, e.to_string()))?;
    let mut view = match &cut {
        None => view,
        Some(_) => blade::view::<S>(world, body).map_err(|e| invalid(&name, e.to_string()))?,
    };
    for (&i, places) in near.iter().zip(cut_to) {
        let own = &mut all[i];
        if let Some(cut) = &cut {
            own.state.report.separated += cut.separated.len() as u32;
            own.state.report.vertices += cut.vertices as u32;
        }
        // what another body holds is for that one to say
        let moved = own.state.points.iter_mut().zip(places).filter(|(_, (_, moves))| *moves);
        for (point, (place, _)) in moved {
            (point.cut_to, point.from) = (place, place);
        }
        let [low, high] = own.bounds();
        let margin = BESIDE[BESIDE.len() - 1] * view.edge;
        view.focus([low - margin, high + margin]);
        hold(own, body, &view);
    }
    blade::keep_view(world, body, view);
    Ok(())
}

/// Divides an edge into parts of half an edge (m) of the tissue.
fn begin(own: &mut Blade, edge: f64) {
    let length = own.edge.ends[0].distance(own.edge.ends[1]);
    let segments = (2.0 * length / edge).ceil().clamp(1.0, f64::from(MOST_SEGMENTS));
    own.state.points = vec![Default::default(); segments as usize + 1];
    own.state.stiffness = own.edge.toughness / (YIELD * edge);
    for number in 0..own.state.points.len() {
        own.state.points[number].cut_to = own.at(&own.now, number);
    }
    own.before = own.state.points.iter().map(|point| point.cut_to).collect();
}

/// Where every point of an edge has cut to in the step before, and whether that is for this body to say.
fn advance(own: &mut Blade, body: usize, view: &BladeView) -> Vec<(DVec3, bool)> {
    let mut places = Vec::new();
    for number in 0..own.state.points.len() {
        let at = own.at(&own.now, number);
        let point = own.state.points[number];
        let Some(holds) = point.holds else {
            places.push((at, true));
            continue;
        };
        if holds[0].body != body {
            places.push((point.cut_to, false));
            continue;
        }
        let held = holds.map(|hold| view.at(hold.rows, hold.weights));
        let held = 0.5 * (held[0] + held[1]);
        // it cuts in the plane of the blade, wherever lips go
        let held = held + (at - held).dot(own.across) * own.across;
        let slip = at - held;
        let length = slip.length();
        let elastic =
            if own.state.stiffness > 0.0 { point.limit / own.state.stiffness } else { 0.0 };
        let plastic = length - elastic;
        if point.limit <= 0.0 || plastic <= 0.0 {
            places.push((held, true));
            continue;
        }
        let way = plastic / length * slip;
        let area = point.width * way.dot(own.into).max(0.0);
        own.state.report.area += area;
        own.state.report.fracture += own.edge.toughness * area;
        places.push((held + way, true));
    }
    places
}

/// Finds what every point of an edge holds in the step to come.
fn hold(own: &mut Blade, body: usize, view: &BladeView) {
    if own.edge.toughness == 0.0 {
        return;
    }
    for number in 0..own.state.points.len() {
        let [now, then] = [&own.now, &own.then].map(|pose| own.at(pose, number));
        let mut point = own.state.points[number];
        match point.holds {
            Some([hold, _]) if hold.body != body => continue,
            Some(_) if now.distance(point.cut_to) > LEFT * view.edge => point.holds = None,
            Some(_) => point.holds = beside(own, body, view, point.cut_to),
            None => {}
        }
        // what goes back through a wound that has closed behind it takes hold of nothing
        let goes_back = (then - now).dot(own.into) < 0.0;
        if point.holds.is_none()
            && !goes_back
            && let Some(entry) = entry(view, now, then)
        {
            point.holds = beside(own, body, view, entry);
            point.cut_to = entry;
        }
        if point.holds.is_none() {
            point.cut_to = now;
        }
        // the force acts against what of the slip goes the way that the blade cuts, now or soon: tissue that was pushed ahead presses on a
        // blade that goes back until it no longer follows
        let cosine = [now, then].map(|at| {
            let slip = at - point.cut_to;
            let slip = slip - slip.dot(own.across) * own.across;
            slip.normalize_or_zero().dot(own.into)
        });
        let cosine = cosine[0].max(cosine[1]).max(0.0);
        point.limit = if point.holds.is_some() { own.edge.toughness * cosine } else { 0.0 };
        own.state.points[number] = point;
    }
    share_edge(own, body, view);
}

/// Shares the length of an edge in tissue out to the points that hold it: half of what is between two, and to one beside a free one
/// all up to the surface. What another body holds is for that one to say.
fn share_edge(own: &mut Blade, body: usize, view: &BladeView) {
    let points = &mut own.state.points;
    let segments = points.len() - 1;
    let length = own.edge.ends[0].distance(own.edge.ends[1]) / segments as f64;
    let step = INSIDE * view.edge;
    let is_others = |point: &EdgePoint| point.holds.is_some_and(|[hold, _]| hold.body != body);
    for point in points.iter_mut().filter(|point| !is_others(point)) {
        point.width = 0.0;
    }
    for i in 0..segments {
        let ends = [points[i], points[i + 1]];
        match ends.map(|point| point.holds.is_some()) {
            [true, true] => {
                let own = [i, i + 1].into_iter().zip(&ends).filter(|(_, end)| !is_others(end));
                own.for_each(|(j, _)| points[j].width += 0.5 * length);
            }
            [false, false] => {}
            [first, _] => {
                let [held, free] = if first { [i, i + 1] } else { [i + 1, i] };
                if is_others(&points[held]) {
                    continue;
                }
                let [from, to] = [points[held].cut_to, points[free].cut_to];
                let inside = |part: f64| {
                    let at = from.lerp(to, part);
                    let mut sides =
                        [-1.0, 1.0].map(|side| at + side * step * own.across).into_iter();
                    sides.any(|hint| view.locate(at, hint).is_some())
                };
                let (mut low, mut high) = (0.0, 1.0);
                for _ in 0..20 {
                    let middle = 0.5 * (low + high);
                    *(if inside(middle) { &mut low } else { &mut high }) = middle;
                }
                points[held].width += low * length;
            }
        }
    }
}

/// The first place of tissue on a way (m).
fn entry(view: &BladeView, from: DVec3, to: DVec3) -> Option<DVec3> {
    const PARTS: u32 = 8;
    let at = |part: f64| from.lerp(to, part);
    let inside = |part: f64| view.locate(at(part), at(part)).is_some();
    let first = (0..=PARTS).map(|i| f64::from(i) / f64::from(PARTS)).find(|part| inside(*part))?;
    if first == 0.0 {
        return Some(from);
    }
    let (mut low, mut high) = (first - 1.0 / f64::from(PARTS), first);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if inside(middle) { high = middle } else { low = middle }
    }
    Some(at(high))
}

/// What is held at a place: tissue on either side of the blade, of a wound both lips. Of the copies beside it the first one with much
/// material, else that with most; a side that has next to nothing leaves all to the other one.
fn beside(own: &Blade, body: usize, view: &BladeView, at: DVec3) -> Option<[EdgeHold; 2]> {
    let side = |sign: f64| {
        let mut best: Option<(EdgeHold, f64)> = None;
        for way in BESIDE {
            let hint = at + sign * way * view.edge * own.across;
            let Some((rows, weights, share)) = view.locate(at, hint) else { continue };
            if best.is_none_or(|(_, most)| share > most) {
                best = Some((EdgeHold { body, rows, weights }, share));
            }
            if share >= MUCH {
                break;
            }
        }
        best
    };
    let both = [side(-1.0), side(1.0)];
    let most = both.iter().flatten().map(|(_, share)| *share).fold(0.0, f64::max);
    let strong = both.map(|own| own.filter(|(_, share)| *share >= LITTLE * most));
    let [left, right] = strong.map(|own| own.map(|(hold, _)| hold));
    Some([left.or(right)?, right.or(left)?])
}
