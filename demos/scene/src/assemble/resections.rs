//! Elements that are removed on the way.

use super::body::BuiltBody;
use super::removal::{Action, BuiltResection, ResectionSummary};
use super::scene::BuiltScene;
use super::select::which_body;
use crate::error::SceneError;
use crate::scene::{CutterEntry, Key, Mode, ResectionEntry};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::models::resection::Region;

/// A resection of a scene.
pub(super) fn resection(
    key: &Key,
    entry: &ResectionEntry,
    built: &mut BuiltScene,
) -> Result<BuiltResection, SceneError> {
    if built.plan.mode == Mode::Static {
        let remedy = "leave it out, or use mode = \"dynamic\"";
        return Err(key.value("a resection in a static scene", remedy));
    }
    let body = &built.bodies[which_body(key, entry.body.as_deref(), &built.bodies)?];
    let action = action(key, entry, body)?;
    let [from, until] = window(key, entry, &action)?;
    // the first removal is then as quick as the others; the body exists
    let _ = built.simulation.prepare_removals(body.handle);
    let summary = ResectionSummary {
        name: entry.name.clone(),
        body: body.name.clone(),
        remaining: body.element_count(ElementKind::Tetrahedron),
        remaining_triangles: body.element_count(ElementKind::Triangle),
        remaining_hexahedra: body.element_count(ElementKind::Hexahedron),
        remaining_quads: body.element_count(ElementKind::Quad),
        pieces: built.simulation.topology().bodies[body.handle.0].piece_count(),
        ..ResectionSummary::default()
    };
    let (body, mass) = (body.handle, entry.mass);
    Ok(BuiltResection { body, action, mass, from, until, summary })
}

/// Times (s) between which it acts.
fn window(key: &Key, entry: &ResectionEntry, action: &Action) -> Result<[f64; 2], SceneError> {
    let once = !matches!(action, Action::Always(_));
    let tool = matches!(action, Action::Tool { .. });
    for (name, value, allowed) in [("from", entry.from, !tool), ("until", entry.until, !once)] {
        match value {
            Some(_) if !allowed => {
                let found = format!("`{name}` for a resection that has its own time");
                return Err(key.at(name).value(found, "leave it out"));
            }
            Some(value) => _ = key.at(name).finite([value])?,
            None => {}
        }
    }
    let from = entry.from.unwrap_or(0.0);
    let until = entry.until.unwrap_or(f64::INFINITY);
    if from > until {
        let found = format!("it acts from {from} s until {until} s");
        return Err(key.at("until").value(found, "make `until` later than `from`"));
    }
    Ok([from, until])
}

fn action(key: &Key, entry: &ResectionEntry, body: &BuiltBody) -> Result<Action, SceneError> {
    type List = fn(Vec<u32>) -> Region;
    let lists: [(_, _, _, List); 4] = [
        (&entry.tetrahedra, "tetrahedra", ElementKind::Tetrahedron, Region::Tetrahedra),
        (&entry.hexahedra, "hexahedra", ElementKind::Hexahedron, Region::Hexahedra),
        (&entry.triangles, "triangles", ElementKind::Triangle, Region::Triangles),
        (&entry.quads, "quads", ElementKind::Quad, Region::Quads),
    ];
    let ResectionEntry { sphere, tool, strain, stress, .. } = entry;
    let mut given: Vec<bool> = lists.iter().map(|(list, ..)| list.is_some()).collect();
    given.extend([sphere.is_some(), tool.is_some(), strain.is_some(), stress.is_some()]);
    let keys = "`tetrahedra`, `hexahedra`, `triangles`, `quads`, `sphere`, `tool`, `strain` and \
                `stress`";
    key.exactly_one(&given, "resection", keys)?;
    for (list, name, kind, region) in lists {
        if let Some(list) = list {
            return Ok(Action::Once(region(listed(&key.at(name), list, kind, body)?)));
        }
    }
    if let Some(sphere) = sphere {
        let key = key.at("sphere");
        let centre = key.at("centre").finite(sphere.centre)?;
        let radius = key.at("radius").positive(sphere.radius, "radius", "m")?;
        return Ok(Action::Always(Region::Sphere { centre, radius }));
    }
    if let Some(CutterEntry { radius, path }) = tool {
        let key = key.at("tool");
        let radius = key.at("radius").positive(*radius, "radius", "m")?;
        key.at("path").ascending(path, "path", "[time, x, y, z] points")?;
        let path = path.iter().map(|&[t, x, y, z]| (t, DVec3::new(x, y, z))).collect();
        return Ok(Action::Tool { path, radius });
    }
    Ok(Action::Always(match (*strain, *stress) {
        (Some(above), _) => {
            Region::Strain { above: key.at("strain").positive(above, "strain", "")? }
        }
        (None, above) => Region::Stress {
            above: key.at("stress").positive(above.unwrap_or(f64::NAN), "stress", "Pa")?,
        },
    }))
}

/// Indices of elements of a body, sorted, each of them once.
fn listed(
    key: &Key,
    list: &[u32],
    kind: ElementKind,
    body: &BuiltBody,
) -> Result<Vec<u32>, SceneError> {
    let (kind, count) = (kind.name(), body.element_count(kind));
    let mut sorted = list.to_vec();
    sorted.sort_unstable();
    if let Some(t) = sorted.iter().find(|&&t| t as usize >= count) {
        let found = format!("body `{}` has no {kind} {t}", body.name);
        return Err(key.value(found, format!("it has {count}, from 0 on")));
    }
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(key.value(format!("{kind} {} comes twice", pair[0]), "name it once"));
    }
    Ok(sorted)
}
