//! What rest shapes and motions foretell: things out of proportion, tools that start inside of a body or never reach one,
//! bodies that nothing holds.

use super::body::BuiltBody;
use super::scene::BuiltScene;
use super::touch::BuiltTool;
use crate::scene::{LoadedScene, Mode};
use crate::text::{seconds, short};
use crate::warning::{Level, Warning};
use glam::DVec3;
use sinew::engine::load::{Constraint, Motion};
use sinew::touch::shape::Shape;
use sinew::touch::tool::{Tool, ToolPose};

/// Sizes of what there is to move, above which a motion is told.
const FAR: f64 = 3.0;
/// Sizes of the bodies, above which a tool is told.
const LARGE: f64 = 10.0;
/// Step (s) of a dynamic scene above which it is told: tissue answers within tenths of a second.
const LONG_STEP: f64 = 0.1;
/// Part of the smallest altitude of its elements by which a tool may stand in a body.
const SHALLOW: f64 = 0.1;
/// Places of a motion that are looked at beside those of its path.
const SAMPLES: u32 = 200;

type Bounds = [DVec3; 2];

/// Adds what there is to say, at most once for each tool, motion and body.
pub(super) fn foretell(loaded: &LoadedScene, built: &mut BuiltScene) {
    let mut found = Vec::new();
    long_steps(built, &mut found);
    let end = end(loaded, built);
    far_motions(built, end, &mut found);
    for (i, tool) in built.tools.iter().enumerate() {
        let on = loaded.scene.tools.get(i).and_then(|entry| entry.on.as_ref()?.body.as_deref());
        found.extend(of_tool(built, tool, on, end));
    }
    free_falls(built, end, &mut found);
    built.warnings.extend(found);
}

/// Time (s) at the end, whatever part of the scene is carried out; in a static scene all loads are on at 1.
fn end(loaded: &LoadedScene, built: &BuiltScene) -> f64 {
    match built.plan.mode {
        Mode::Static => 1.0,
        Mode::Dynamic => loaded.scene.duration.unwrap_or(0.0),
    }
}

fn warning(code: &str, subject: String, message: String, remedy: &str) -> Warning {
    Warning::new(code, Level::Warning, subject, message, remedy)
}

fn long_steps(built: &BuiltScene, found: &mut Vec<Warning>) {
    let dt = built.plan.dt;
    if built.plan.mode == Mode::Dynamic && dt > LONG_STEP {
        found.push(warning(
            "scene.step.long",
            "scene".into(),
            format!(
                "steps of {}: whatever is faster than some steps is damped away or missed",
                seconds(dt)
            ),
            "use dt = 0.01, or mode = \"static\" where only the state at rest is asked for",
        ));
    }
}

fn bounds(body: &BuiltBody) -> Option<Bounds> {
    body.mesh.bounds().map(|(low, high)| [low, high])
}

fn size([low, high]: Bounds) -> f64 {
    (high - low).max_element()
}

/// Box round all bodies.
fn all_bounds(built: &BuiltScene) -> Option<Bounds> {
    built.bodies.iter().filter_map(bounds).reduce(joined)
}

fn joined(a: Bounds, b: Bounds) -> Bounds {
    [a[0].min(b[0]), a[1].max(b[1])]
}

fn far_motions(built: &BuiltScene, end: f64, found: &mut Vec<Warning>) {
    let remedy = "check its unit: it is in metres, so 45 mm is 0.045";
    let mut told = |subject: String, way: f64, size: f64, of: &str| {
        if way > FAR * size {
            let times = short(way / size);
            let message = format!("it moves by {} m, {times} times the size of {of}", short(way));
            found.push(warning("scene.size.motion", subject, message, remedy));
        }
    };
    let times = || samples(0.0, end, &[]);
    for own in &built.constraints {
        let body = &built.bodies[own.body];
        let constraint = built.simulation.world().get::<Constraint>(own.entity);
        if let (Some(Constraint { motion: Motion::Translate(by), curve, .. }), Some(bounds)) =
            (constraint, bounds(body))
        {
            let factor = times().into_iter().map(|t| curve.value(t).abs()).fold(0.0, f64::max);
            let subject = format!("constraint `{}`", own.name);
            told(subject, by.length() * factor, size(bounds), &format!("body `{}`", body.name));
        }
    }
    let Some(bounds) = all_bounds(built) else { return };
    for own in &built.tools {
        let Some(tool) = built.simulation.world().get::<Tool>(own.entity) else { continue };
        let way = poses(tool, 0.0, end).into_iter().map(|pose| {
            let from = pose.position.clamp(bounds[0], bounds[1]);
            pose.position.distance(from).min(pose.position.distance(tool.start.position))
        });
        told(
            format!("tool `{}`", own.name),
            way.fold(0.0, f64::max),
            size(bounds),
            "all bodies together",
        );
    }
    for own in &built.pulls {
        let way = times().into_iter().map(|t| own.way_at(t).length()).fold(0.0, f64::max);
        told(format!("pull `{}`", own.name), way, size(bounds), "all bodies together");
    }
}

/// Times to look at, those given among them.
fn samples(from: f64, to: f64, own: &[f64]) -> Vec<f64> {
    let even = (0..=SAMPLES).map(|i| from + (to - from) * f64::from(i) / f64::from(SAMPLES));
    let within = own.iter().copied().filter(|t| (from..=to).contains(t));
    let mut times: Vec<f64> = even.chain(within).collect();
    times.sort_unstable_by(f64::total_cmp);
    times
}

/// Where a tool stands over time.
fn poses(tool: &Tool, from: f64, to: f64) -> Vec<ToolPose> {
    use sinew::touch::tool::ToolMotion;
    let own: Vec<f64> = match &tool.motion {
        ToolMotion::Path(points) => points.iter().map(|p| p.time).collect(),
        ToolMotion::Follow => return vec![tool.start],
        ToolMotion::Translate(..) => Vec::new(),
    };
    samples(from, to, &own).into_iter().map(|t| tool.wanted(t, tool.start)).collect()
}

/// What there is to say of a tool that touches all bodies, or the one of that name.
fn of_tool(built: &BuiltScene, own: &BuiltTool, on: Option<&str>, end: f64) -> Vec<Warning> {
    let Some(tool) = built.simulation.world().get::<Tool>(own.entity) else { return Vec::new() };
    let bodies = || built.bodies.iter().filter(move |b| on.is_none_or(|name| b.name == name));
    let subject = || format!("tool `{}`", own.name);
    let mut found = Vec::new();
    let largest = bodies().filter_map(bounds).map(size).fold(0.0, f64::max);
    let finite = tool.parts.iter().filter(|part| part.is_bounded());
    let reach = finite.map(|part| part.shape.reach()).fold(0.0, f64::max);
    if reach > LARGE * largest {
        found.push(warning(
            "scene.size.tool",
            subject(),
            format!(
                "it reaches {} m from its centre, {} times the size of what it may touch",
                short(reach),
                short(reach / largest)
            ),
            "check its unit: it is in metres, so 12 mm is 0.012",
        ));
    }
    if tool.active(0.0) {
        found.extend(bodies().find_map(|body| starts_inside(tool, body, subject())));
    }
    // an edge alone is no shape whose distance could be told
    if !tool.parts.is_empty()
        && never_touches(built, tool, &|body| on.is_none_or(|name| body.name == name), end)
    {
        found.push(warning(
            "scene.tool.never",
            subject(),
            "it never comes near what it may touch, as far as rest shapes tell".into(),
            "check where it stands, its way and its times; positions of a path are those of its centre (m)",
        ));
    }
    found
}

/// A tool that stands in a body at the start.
fn starts_inside(tool: &Tool, body: &BuiltBody, subject: String) -> Option<Warning> {
    let statistics = &body.report.statistics;
    let (mut count, mut deepest, mut hollow) = (0, 0.0_f64, false);
    let within = SHALLOW * statistics.smallest_altitude;
    for part in 0..tool.parts.len() {
        let (centre, turn) = tool.part_pose(part, &tool.start);
        let own = &tool.parts[part];
        for &v in &body.used_vertices {
            let local = turn.inverse() * (body.mesh.points[v as usize] - centre);
            let depth = -own.distance(local).0;
            count += usize::from(depth > within);
            if depth > deepest {
                (deepest, hollow) = (depth, own.cavity);
            }
        }
    }
    let (side, remedy) = match hollow {
        true => ("outside", "let bodies start in the cavity, or say `on` which it holds"),
        false => ("inside", "let it start outside and move in"),
    };
    let message = if count > 0 {
        format!(
            "{count} vertices of body `{}` are {side} of it at the start, up to {} m deep",
            body.name,
            short(deepest)
        )
    } else if swallowed(tool, body) {
        format!("it starts wholly inside of body `{}`, where it touches nothing", body.name)
    } else {
        return None;
    };
    Some(warning("scene.tool.inside", subject, message, remedy))
}

/// Whether the centre of a part lies in the solid.
fn swallowed(tool: &Tool, body: &BuiltBody) -> bool {
    if !body.mesh.is_solid() {
        return false;
    }
    let finite = |&part: &usize| tool.parts[part].is_bounded();
    let mut centres =
        (0..tool.parts.len()).filter(finite).map(|part| tool.part_pose(part, &tool.start).0);
    let Some([low, high]) = bounds(body) else { return false };
    let near = |c: &DVec3| c.cmpge(low).all() && c.cmple(high).all();
    let Some(centre) = centres.find(near) else { return false };
    let surface = body.mesh.surface_triangles();
    // solid angles of all faces add up to 4 pi around a point inside, to 0 around one outside
    let angle = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| body.mesh.points[v as usize] - centre);
        let (x, y, z) = (a.length(), b.length(), c.length());
        let whole = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        2.0 * a.dot(b.cross(c)).atan2(whole)
    };
    surface.iter().map(angle).sum::<f64>().abs() > std::f64::consts::TAU
}

/// Whether a tool stays clear of the boxes round the rest shapes, made larger by what bodies may move.
fn never_touches(
    built: &BuiltScene,
    tool: &Tool,
    touches: &dyn Fn(&BuiltBody) -> bool,
    end: f64,
) -> bool {
    let mut reached = Vec::new();
    for (i, body) in built.bodies.iter().enumerate().filter(|(_, body)| touches(body)) {
        let (Some(bounds), Some(slack)) = (bounds(body), slack(built, i)) else { return false };
        reached.push([bounds[0] - slack, bounds[1] + slack]);
    }
    let (from, to) = (tool.from.max(0.0), tool.until.min(end));
    if from > to || reached.is_empty() {
        // told by its times
        return false;
    }
    let poses = poses(tool, from, to);
    let meets = |a: &Bounds, b: &Bounds| a[0].cmple(b[1]).all() && b[0].cmple(a[1]).all();
    for (part, own) in tool.parts.iter().enumerate() {
        let places: Vec<_> = poses.iter().map(|pose| tool.part_pose(part, pose)).collect();
        let near = match own.shape {
            Shape::HalfSpace => places.iter().any(|(centre, turn)| {
                let normal = *turn * DVec3::Z;
                let lowest = |[low, high]: &Bounds| {
                    let (middle, half) = (0.5 * (*low + *high), 0.5 * (*high - *low));
                    (middle - *centre).dot(normal) - half.dot(normal.abs())
                };
                reached.iter().any(|body| lowest(body) <= 0.0)
            }),
            _ => {
                let boxes: Vec<Bounds> =
                    places.iter().map(|(centre, turn)| own.bounds(*centre, *turn)).collect();
                let swept = boxes.windows(2).map(|pair| joined(pair[0], pair[1]));
                swept.chain(boxes.first().copied()).any(|b| reached.iter().any(|r| meets(&b, r)))
            }
        };
        if near {
            return false;
        }
    }
    true
}

/// How far (m) a body may come out of the box round its rest shape; `None` where that cannot be told.
fn slack(built: &BuiltScene, body: usize) -> Option<f64> {
    let own = || built.constraints.iter().filter(move |c| c.body == body);
    let dynamic = built.plan.mode == Mode::Dynamic;
    let held = own().any(|c| !(c.from > 0.0 || c.until.is_finite()));
    let driven = built.plan.gravity.length() > 0.0
        || !(built.loads.is_empty() && built.pressures.is_empty() && built.pulls.is_empty())
        || built.tools.len() > 1
        || !built.contacts.is_empty();
    if dynamic && !held && driven {
        return None;
    }
    let size = size(bounds(&built.bodies[body])?);
    let mut slack = if driven { size } else { 0.1 * size };
    for c in own() {
        match built.simulation.world().get::<Constraint>(c.entity).map(|c| &c.motion) {
            Some(Motion::Translate(by)) => slack += by.length(),
            Some(Motion::Hold) => {}
            _ => return None,
        }
    }
    Some(slack)
}

/// Bodies that fall for good.
fn free_falls(built: &BuiltScene, end: f64, found: &mut Vec<Warning>) {
    let gravity = built.plan.gravity.length();
    if built.plan.mode == Mode::Static || gravity == 0.0 || !built.tools.is_empty() {
        return;
    }
    for (i, body) in built.bodies.iter().enumerate() {
        let held = built.constraints.iter().any(|c| c.body == i)
            || built.pulls.iter().any(|pull| pull.body == i)
            || built.contacts.iter().any(|c| c.bodies.contains(&i) && c.bodies[0] != c.bodies[1]);
        let way = 0.5 * gravity * end * end;
        if held || bounds(body).is_none_or(|bounds| way <= size(bounds)) {
            continue;
        }
        found.push(warning(
            "scene.body.falls",
            format!("body `{}`", body.name),
            format!("nothing holds it and nothing lies below it: it falls by {} m in {}", short(way), seconds(end)),
            "add a [[constraint]], or a table: a [[tool]] with shape = \"half-space\"; gravity = [0, 0, 0] for none",
        ));
    }
}
