//! Tools.

use super::body::BuiltBody;
use super::curves::{self, factor, in_time, window};
use super::pulls::{friction, stiffness};
use super::scene::BuiltScene;
use super::select::{group_cells, which_body};
use super::touch::{BuiltTool, place};
use crate::error::SceneError;
use crate::scene::{EdgeEntry, Key, Mode, PartEntry, Rotation, ToolEntry, ToolShape, TouchedEntry};
use crate::text::short;
use crate::warning::{Level, Warning};
use glam::{DQuat, DVec3};
use sinew::engine::load::{Curve, rotation};
use sinew::engine::mesh::MeshError;
use sinew::touch::edge::Edge;
use sinew::touch::field::{DistanceField, DistanceFieldError};
use sinew::touch::needle::Needle;
use sinew::touch::shape::Shape;
use sinew::touch::tool::{
    Hinge, MOST_POINTS, Part, PathPoint, Points, Tool, ToolError, ToolMotion, ToolPose,
};
use std::collections::HashSet;
use std::path::Path;

/// Largest error of the distance to a mesh over its smallest extent.
const COARSE: f64 = 0.1;
/// Angle (rad) between the poses of a path that turns: between them positions of the tool's surface are off an arc by
/// a thousandth of its radius.
const TURN: f64 = 0.1;
/// Most degrees that a tool turns.
const MOST_DEGREES: f64 = 36_000.0;

/// A tool of a scene.
pub(super) fn tool(
    key: &Key,
    entry: &ToolEntry,
    built: &mut BuiltScene,
) -> Result<BuiltTool, SceneError> {
    let mode = built.plan.mode;
    let (parts, mut words) = parts(key, entry)?;
    let (start, motion, moves) = motion(key, entry, mode)?;
    let mut tool = Tool::of_parts(&entry.name, parts, start);
    tool.edge = edge(&key.at("edge"), entry, built)?;
    tool.needle = needle(&key.at("needle"), entry, mode)?;
    tool.motion = motion;
    tool.hinge = hinge(key, entry, &tool.parts)?;
    tool.friction = friction(key, [entry.friction, entry.mu], &mut built.warnings)?;
    tool.stiffness = stiffness(key, entry.stiffness, entry.stiffness_absolute, tool.stiffness)?;
    tool.exact = entry.exact;
    tool.points = points(&key.at("points"), entry)?;
    tool.keeps_side = entry.keeps_side.unwrap_or(true);
    (tool.spring, tool.error_bar) = (entry.spring, entry.error_bar);
    [tool.from, tool.until] = window(key, [entry.from, entry.until], mode)?;
    if let Some([from, until]) = entry.grip {
        let key = key.at("grip");
        in_time(&key, "grip", mode)?;
        key.ascending(&[[from], [until]], "grip", "[from, until] (s)")?;
    }
    let integrator = built.plan.settings.integrator;
    if let Some(problem) = integrator.exact_contact_problem().filter(|_| entry.exact) {
        return Err(key.at("exact").value(problem, "take one of them, or leave `exact` out"));
    }
    if let Some(on) = &entry.on {
        let (triangles, body) = touched(&key.at("on"), on, &built.bodies)?;
        let handle = built.bodies[body].handle;
        let faces = built.simulation.face_rows(handle, &entry.name, &triangles);
        tool.faces = Some(faces.map_err(|e| key.at("on").error(e))?);
    }
    if mode == Mode::Dynamic && entry.translate.is_some() && entry.curve.is_none() {
        built.warnings.push(Warning::new(
            "scene.motion.jump",
            Level::Warning,
            format!("tool `{}`", entry.name),
            "the whole motion happens in its first step",
            "add a curve such as `curve = { ramp = [0.0, 1.0] }`",
        ));
    }
    words = format!("{words}, {moves}");
    let (name, friction, parts) = (entry.name.clone(), tool.friction, tool.parts.len());
    let entity = built.simulation.add_tool(tool).map_err(|error| match error {
        ToolError::Invalid { problem, .. } => {
            key.value(problem, "correct it (see `[[tool]]` in demos/scenes/README.md)")
        }
        other => key.value(other.to_string(), "correct it"),
    })?;
    let (grip, error_bar) = (entry.grip, entry.error_bar);
    Ok(BuiltTool { name, entity, words, friction, grip, error_bar, parts })
}

/// What a tool is made of, and the same in words.
fn parts(key: &Key, entry: &ToolEntry) -> Result<(Vec<Part>, String), SceneError> {
    let own = entry.shape_keys();
    let nothing = entry.parts.is_empty() && given(&own).iter().all(|(_, given)| !given);
    if let Some(edge) = entry.edge.as_ref().filter(|_| nothing) {
        let length = short(DVec3::from(edge.ends[0]).distance(edge.ends[1].into()));
        return Ok((flanks(key, entry)?, format!("a blade, edge {length} m")));
    }
    if let Some(needle) = entry.needle.as_ref().filter(|_| nothing) {
        return Ok((Vec::new(), format!("a needle, {} m", short(needle.length))));
    }
    if entry.parts.is_empty() {
        let (part, words) = shape(key, &own)?;
        return Ok(([vec![part], flanks(key, entry)?].concat(), words));
    }
    if let Some(name) = given(&own).into_iter().find_map(|(name, given)| given.then_some(name)) {
        let found = format!("both `{name}` and `parts` are given");
        return Err(key
            .at(name)
            .value(found, "give shapes in `parts` alone, or one shape without"));
    }
    let mut words = Vec::new();
    let mut parts = Vec::new();
    for (i, part) in entry.parts.iter().enumerate() {
        let key = key.at("parts").entry(i);
        let (shaped, own) = shape(&key, &part.shape_keys())?;
        let at = key.at("at").finite(part.at.unwrap_or_default())?;
        let jaw = part.jaw.unwrap_or(0.0);
        key.at("jaw").finite([jaw])?;
        let rotation = turned(&key, part.rotate.as_ref())? * shaped.rotation;
        parts.push(Part { at, rotation, jaw, ..shaped });
        words.push(own);
    }
    parts.extend(flanks(key, entry)?);
    Ok((parts, words.join(" and ")))
}

/// The sides of a blade.
fn flanks(key: &Key, entry: &ToolEntry) -> Result<Vec<Part>, SceneError> {
    let found = entry.edge.as_ref().map(EdgeEntry::flanks).transpose();
    let problem = |problem| key.at("edge").at("flanks").value(problem, "correct it");
    Ok(found.map_err(problem)?.flatten().into_iter().collect())
}

/// The sharp edge.
fn edge(key: &Key, entry: &ToolEntry, built: &mut BuiltScene) -> Result<Option<Edge>, SceneError> {
    let Some(own) = &entry.edge else { return Ok(None) };
    in_time(key, "edge", built.plan.mode)?;
    let handles: Vec<_> = built.bodies.iter().map(|body| body.handle).collect();
    let mut problems = handles.into_iter().map(|body| built.simulation.check_cut(body).err());
    if let Some(Some(problem)) = problems.next()
        && problems.all(|problem| problem.is_some())
    {
        return Err(key.error(problem));
    }
    for end in own.ends {
        key.at("ends").finite(end)?;
    }
    key.at("into").finite(own.into)?;
    key.at("travel").finite(own.travel.unwrap_or_default())?;
    let edge = Edge::from(own);
    match edge.problem() {
        Some(problem) => {
            Err(key.value(problem, "correct it (see `[[tool]]` in demos/scenes/README.md)"))
        }
        None => Ok(Some(edge)),
    }
}

/// The needle.
fn needle(key: &Key, entry: &ToolEntry, mode: Mode) -> Result<Option<Needle>, SceneError> {
    let Some(own) = &entry.needle else { return Ok(None) };
    in_time(key, "needle", mode)?;
    let needle = Needle::from(own);
    match needle.problem() {
        Some(problem) => {
            Err(key.value(problem, "correct it (see `[[tool]]` in demos/scenes/README.md)"))
        }
        None => Ok(Some(needle)),
    }
}

/// The hinge of jaws.
fn hinge(key: &Key, entry: &ToolEntry, parts: &[Part]) -> Result<Hinge, SceneError> {
    let jaws = parts.iter().any(|part| part.jaw != 0.0);
    let columns = entry.path.iter().flatten().map(Vec::len).max();
    let opens = [
        ("hinge", entry.hinge.is_some()),
        ("hinge_axis", entry.hinge_axis.is_some()),
        ("opening", entry.opening.is_some()),
        ("path", columns == Some(5)),
    ];
    if !jaws {
        return match opens.into_iter().find(|(_, given)| *given) {
            Some((name, _)) => {
                let remedy = "give parts `jaw = 0.5` and `jaw = -0.5`, or leave it out";
                let found = match name {
                    "path" => "an opening for a tool without jaws".into(),
                    name => format!("`{name}` for a tool without jaws"),
                };
                Err(key.at(name).value(found, remedy))
            }
            None => Ok(Hinge::default()),
        };
    }
    for (name, given) in &opens[..2] {
        if !given {
            let remedy = "jaws turn about a hinge: give `hinge = [x, y, z]` (m) and `hinge_axis`";
            return Err(key.at(name).missing(format!("key `{name}`"), remedy));
        }
    }
    let axis_key = key.at("hinge_axis");
    let axis = axis_key.finite(entry.hinge_axis.unwrap_or_default())?.try_normalize();
    let axis = axis.ok_or_else(|| axis_key.value("the axis has no length", "give a direction"))?;
    Ok(Hinge { point: key.at("hinge").finite(entry.hinge.unwrap_or_default())?, axis })
}

/// Keys of a shape, and whether they are given.
fn given(keys: &PartEntry) -> [(&'static str, bool); 10] {
    [
        ("shape", keys.shape.is_some()),
        ("radius", keys.radius.is_some()),
        ("half_length", keys.half_length.is_some()),
        ("half", keys.half.is_some()),
        ("rounding", keys.rounding.is_some()),
        ("normal", keys.normal.is_some()),
        ("file", keys.file.is_some()),
        ("scale", keys.scale.is_some()),
        ("spacing", keys.spacing.is_some()),
        ("cavity", keys.cavity.is_some()),
    ]
}

/// A part that stands at its origin, and the same in words.
fn shape(key: &Key, keys: &PartEntry) -> Result<(Part, String), SceneError> {
    let Some(kind) = keys.shape else {
        let remedy =
            "give \"sphere\", \"capsule\", \"box\", \"half-space\" or \"mesh\", or `parts`";
        return Err(key.at("shape").missing("key `shape`", remedy));
    };
    let (word, own): (&str, &[&str]) = match kind {
        ToolShape::Sphere => ("sphere", &["radius", "cavity"]),
        ToolShape::Capsule => ("capsule", &["half_length", "radius", "cavity"]),
        ToolShape::Box => ("box", &["half", "rounding", "cavity"]),
        ToolShape::HalfSpace => ("half-space", &["normal"]),
        ToolShape::Mesh => ("mesh", &["file", "scale", "spacing", "cavity"]),
    };
    let cavity = keys.cavity.unwrap_or(false);
    if cavity && kind == ToolShape::HalfSpace {
        let found = "a half-space has no inside that could be a cavity";
        let remedy = "turn its `normal` round, and leave `cavity` out";
        return Err(key.at("cavity").value(found, remedy));
    }
    let foreign = given(keys).into_iter().skip(1).find(|(name, is)| *is && !own.contains(name));
    if let Some((name, _)) = foreign {
        let found = format!("`{name}` for shape \"{word}\"");
        return Err(key.at(name).value(found, format!("its keys are `{}`", own.join("`, `"))));
    }
    let needed = |name: &str| {
        let remedy = format!("shape \"{word}\" needs it");
        key.at(name).missing(format!("key `{name}`"), remedy)
    };
    let size = |name: &str, what: &str, value: Option<f64>| {
        key.at(name).positive(value.ok_or_else(|| needed(name))?, what, "m")
    };
    let plain = |shape, words: String| {
        let words = if cavity { format!("inside of a {words}") } else { words };
        Ok((Part { cavity, ..Part::from(shape) }, words))
    };
    match kind {
        ToolShape::Sphere => {
            let radius = size("radius", "the radius", keys.radius)?;
            plain(Shape::Sphere { radius }, format!("sphere of radius {} m", short(radius)))
        }
        ToolShape::Capsule => {
            let radius = size("radius", "the radius", keys.radius)?;
            let half_length = size("half_length", "half the length", keys.half_length)?;
            let words = format!(
                "capsule of radius {} m, half length {} m",
                short(radius),
                short(half_length)
            );
            plain(Shape::Capsule { half_length, radius }, words)
        }
        ToolShape::Box => {
            let half = keys.half.ok_or_else(|| needed("half"))?;
            for x in half {
                key.at("half").positive(x, "half a size", "m")?;
            }
            let half = DVec3::from_array(half);
            let smallest = half.min_element();
            let rounding = keys.rounding.unwrap_or(0.25 * smallest);
            let own = key.at("rounding");
            own.positive(rounding, "the rounding", "m")?;
            if rounding > smallest {
                let found = format!("the rounding is {} m", short(rounding));
                let remedy =
                    format!("make it at most the smallest half size, {} m", short(smallest));
                return Err(own.value(found, remedy));
            }
            let [x, y, z] = (2.0 * half).to_array().map(short);
            plain(Shape::Box { half, rounding }, format!("box of {x} x {y} x {z} m"))
        }
        ToolShape::HalfSpace => {
            let normal = keys.normal.unwrap_or([0.0, 0.0, 1.0]);
            let own = key.at("normal");
            let unit = own.finite(normal)?.try_normalize();
            let unit = unit.ok_or_else(|| own.value("it has no length", "give a direction"))?;
            let rotation = DQuat::from_rotation_arc(DVec3::Z, unit);
            let [x, y, z] = unit.to_array().map(short);
            let words = format!("half-space with normal [{x}, {y}, {z}]");
            Ok((Part { rotation, ..Part::from(Shape::HalfSpace) }, words))
        }
        ToolShape::Mesh => {
            let file = keys.file.as_deref().ok_or_else(|| needed("file"))?;
            let scale = keys.scale.unwrap_or(1.0);
            let scale = key.at("scale").positive(scale, "scale", "")?;
            let spacing = match keys.spacing {
                Some(h) => Some(key.at("spacing").positive(h, "the spacing", "m")?),
                None => None,
            };
            plain(field(key, file, scale, spacing)?, format!("mesh {}", file.display()))
        }
    }
}

/// The distance field of a closed mesh in a file.
fn field(key: &Key, file: &Path, scale: f64, spacing: Option<f64>) -> Result<Shape, SceneError> {
    let own = key.at("file");
    let error = |source: MeshError| own.error(source);
    let mesh = key.loaded.read_mesh(file).map_err(error)?;
    let mesh = mesh.transformed(scale, DQuat::IDENTITY, DVec3::ZERO);
    let (mut triangles, quads) = match mesh.is_solid() {
        true => {
            let surface = mesh.surface();
            (surface.triangles, surface.quads)
        }
        false => (mesh.triangles.clone(), mesh.quads.clone()),
    };
    triangles.extend(quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]));
    let field = DistanceField::cached(&mesh.points, &triangles, spacing).map_err(|error| {
        let at = match error {
            DistanceFieldError::TooFine { .. } | DistanceFieldError::Spacing(_) => {
                key.at("spacing")
            }
            _ => key.at("file"),
        };
        let remedy = "a tool needs a closed surface of triangles";
        at.value(format!("{}: {error}", file.display()), remedy)
    })?;
    let [low, high] = field.bounds();
    let (accuracy, extent) = (field.accuracy(), (high - low).min_element());
    // false for NaN
    let fine = accuracy <= COARSE * extent;
    if !fine {
        let found = format!(
            "the distance to {} is off by up to {accuracy:.1e} m where the mesh is {extent:.1e} m thin, on a grid of \
             {:.1e} m",
            file.display(),
            field.spacing()
        );
        return Err(key.at("spacing").value(found, "give a smaller `spacing`, or a thicker mesh"));
    }
    Ok(Shape::Field(field))
}

/// A rotation of the key `rotate`.
fn turned(key: &Key, rotate: Option<&Rotation>) -> Result<DQuat, SceneError> {
    let Some(Rotation { axis, degrees }) = rotate else { return Ok(DQuat::IDENTITY) };
    let key = key.at("rotate");
    let axis = key.axis(*axis)?;
    key.at("degrees").finite([*degrees])?;
    Ok(rotation(axis, degrees.to_radians()))
}

/// Where a tool stands at first, how it moves, and the same in words.
fn motion(
    key: &Key,
    entry: &ToolEntry,
    mode: Mode,
) -> Result<(ToolPose, ToolMotion, String), SceneError> {
    let path = match &entry.path {
        Some(rows) => Some(path(&key.at("path"), rows, mode)?),
        None => None,
    };
    let opens = path.as_ref().is_some_and(|path| path.len() == 4);
    for (name, given, other) in [
        ("at", path.is_some() && entry.at.is_some(), "path"),
        ("opening", opens && entry.opening.is_some(), "path"),
        ("translate", path.is_some() && entry.translate.is_some(), "path"),
        ("translate", entry.turns.is_some() && entry.translate.is_some(), "turns"),
    ] {
        if given {
            let found = format!("`{other}` is given as well");
            return Err(key.at(name).value(found, "keep one of them"));
        }
    }
    if entry.translate.is_none() && entry.curve.is_some() {
        let found = "a curve without a translation";
        return Err(key.at("curve").value(found, "add `translate`, or give a `path` instead"));
    }
    if path.is_none() && entry.at.is_none() {
        let remedy = "say where it stands, `at = [x, y, z]` (m), or give a `path`";
        return Err(key.at("at").missing("key `at`", remedy));
    }
    let at = key.at("at").finite(entry.at.unwrap_or_default())?;
    let rotation = turned(key, entry.rotate.as_ref())?;
    let degrees = entry.opening.unwrap_or(0.0);
    key.at("opening").finite([degrees])?;
    let start = ToolPose { position: at, rotation, opening: degrees.to_radians() };
    if let Some(by) = entry.translate {
        let by = key.at("translate").finite(by)?;
        let words = format!("moved by [{}, {}, {}] m", by.x, by.y, by.z);
        let curve = factor(key, entry.curve.as_ref(), mode)?;
        return Ok((start, ToolMotion::Translate(by, curve), words));
    }
    let turns = match &entry.turns {
        Some(rows) => turns(&key.at("turns"), rows, mode)?,
        None => Vec::new(),
    };
    if path.is_none() && turns.is_empty() {
        return Ok((start, ToolMotion::Follow, "at rest".into()));
    }
    let words = match (&entry.path, turns.is_empty()) {
        (Some(rows), true) => format!("along a path of {} points", rows.len()),
        (Some(rows), false) => format!("along a path of {} points, turning", rows.len()),
        (None, _) => "turning".into(),
    };
    let poses = poses(start, path.as_deref().unwrap_or(&[]), &turns);
    Ok((poses[0].pose, ToolMotion::Path(poses), words))
}

/// Places, and openings where there are any, as curves.
fn path(key: &Key, rows: &[Vec<f64>], mode: Mode) -> Result<Vec<Curve>, SceneError> {
    fn all<const N: usize>(rows: &[Vec<f64>]) -> Option<Vec<[f64; N]>> {
        rows.iter().map(|row| row.as_slice().try_into().ok()).collect()
    }
    const COLUMNS: &str = "[time, x, y, z] or [time, x, y, z, opening] points";
    if let Some(rows) = all::<4>(rows) {
        curves::path(key, &rows, COLUMNS, mode)
    } else if let Some(rows) = all::<5>(rows) {
        curves::path(key, &rows, COLUMNS, mode)
    } else {
        let found = "its points are not all of 4 numbers, nor all of 5";
        Err(key.value(found, format!("give {COLUMNS}")))
    }
}

/// Rotations over time, near enough to each other that those between them may be taken evenly.
fn turns(key: &Key, rows: &[[f64; 5]], mode: Mode) -> Result<Vec<(f64, DQuat)>, SceneError> {
    in_time(key, "turns", mode)?;
    key.ascending(rows, "list of turns", "[time, axis x, y, z, degrees] points")?;
    let mut known: Vec<(f64, DVec3, f64)> = Vec::new();
    for (i, &[time, x, y, z, degrees]) in rows.iter().enumerate() {
        let key = key.entry(i);
        key.finite([time])?;
        let axis = key.finite([x, y, z])?.try_normalize();
        let axis = axis.ok_or_else(|| key.value("the axis has no length", "give a direction"))?;
        // false for NaN
        let within = degrees.abs() <= MOST_DEGREES;
        if !within {
            let remedy = format!("give at most {MOST_DEGREES}");
            return Err(key.value(format!("it turns by {degrees} degrees"), remedy));
        }
        known.push((time, axis, degrees.to_radians()));
    }
    let mut all = Vec::new();
    for pair in known.windows(2) {
        let [(from, axis, start), (to, other, end)] = [pair[0], pair[1]];
        let (first, last) = (rotation(axis, start), rotation(other, end));
        // about one axis as far as the angle says, else along the shorter way
        let same = axis.dot(other) > 1.0 - 1e-12;
        let way = if same { (end - start).abs() } else { first.angle_between(last) };
        let pieces = (way / TURN).ceil().max(1.0);
        for piece in 0..pieces as u32 {
            let part = f64::from(piece) / pieces;
            let turn = match same {
                true => rotation(axis, start + (end - start) * part),
                false => first.slerp(last, part),
            };
            all.push((from + (to - from) * part, turn));
        }
    }
    let last = known.last().map(|&(time, axis, angle)| (time, rotation(axis, angle)));
    all.extend(last);
    Ok(all)
}

/// The poses of a tool at all times of its path and turns.
fn poses(start: ToolPose, path: &[Curve], turns: &[(f64, DQuat)]) -> Vec<PathPoint> {
    let of_path = match path.first() {
        Some(Curve::Points(points)) => points.as_slice(),
        _ => &[],
    };
    let mut times: Vec<f64> = of_path.iter().map(|p| p[0]).collect();
    times.extend(turns.iter().map(|turn| turn.0));
    times.sort_unstable_by(f64::total_cmp);
    times.dedup();
    let pose = |time: f64| {
        let after = turns.partition_point(|turn| turn.0 <= time);
        let turn = match (turns.get(after.wrapping_sub(1)), turns.get(after)) {
            (Some(a), Some(b)) => a.1.slerp(b.1, (time - a.0) / (b.0 - a.0)),
            (Some(a), None) | (None, Some(a)) => a.1,
            (None, None) => DQuat::IDENTITY,
        };
        let position = if path.is_empty() { start.position } else { place(path, time) };
        let opening = path.get(3).map_or(start.opening, |degrees| degrees.value(time).to_radians());
        ToolPose { position, rotation: (turn * start.rotation).normalize(), opening }
    };
    times.into_iter().map(|time| PathPoint { time, pose: pose(time) }).collect()
}

/// Which points touch a tool.
fn points(key: &Key, entry: &ToolEntry) -> Result<Points, SceneError> {
    let Some(word) = entry.points.as_deref() else {
        return Ok(if entry.exact { Points::Vertex } else { Points::Auto });
    };
    let number = word.strip_prefix("faces(").and_then(|rest| rest.strip_suffix(')'));
    match (word, number.map(|n| n.trim().parse::<u32>())) {
        ("auto", _) => Ok(Points::Auto),
        ("vertex", _) => Ok(Points::Vertex),
        (_, Some(Ok(n))) if (2..=MOST_POINTS).contains(&n) => Ok(Points::Faces(n)),
        (_, Some(_)) => {
            let remedy = format!("give faces(2) to faces({MOST_POINTS})");
            Err(key.value(format!("points are \"{word}\""), remedy))
        }
        _ => Err(key.unknown("choice", word, ["auto", "vertex", "faces(2)"])),
    }
}

/// Triangles that a tool is to touch, at least one, and the index of their body.
fn touched(
    key: &Key,
    on: &TouchedEntry,
    bodies: &[BuiltBody],
) -> Result<(Vec<[u32; 3]>, usize), SceneError> {
    let index = which_body(key, on.body.as_deref(), bodies)?;
    let body = &bodies[index];
    let surface = body.mesh.surface();
    let solid = (surface.triangles, surface.quads);
    let sheet = (body.membrane_triangles().to_vec(), body.membrane_quads().to_vec());
    let cut = |(triangles, quads): (Vec<[u32; 3]>, Vec<[u32; 4]>)| {
        // whichever way the engine cuts them
        let both = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [b, c, d], [a, b, d]];
        triangles.into_iter().chain(quads.into_iter().flat_map(both)).collect::<Vec<_>>()
    };
    let chosen = match (&on.group, on.surface, on.membrane) {
        (Some(group), None, None) => {
            let outside: HashSet<[u32; 3]> =
                cut(solid).into_iter().chain(cut(sheet)).map(sorted).collect();
            let mut chosen = cut(group_cells(key, group, &body.mesh)?);
            chosen.retain(|&t| outside.contains(&sorted(t)));
            chosen
        }
        (None, Some(true), None) => cut(solid),
        (None, None, Some(true)) => cut(sheet),
        (None, None, None) => cut(solid).into_iter().chain(cut(sheet)).collect(),
        _ => {
            let remedy = "give one of `group`, `surface = true` and `membrane = true`, or none for all of it";
            return Err(key.value("more than one kind of faces is given", remedy));
        }
    };
    if chosen.is_empty() {
        let found = format!("body `{}` has no such faces on its surface", body.name);
        return Err(key.value(found, "choose other ones: a tool touches surfaces and membranes"));
    }
    Ok((chosen, index))
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}
