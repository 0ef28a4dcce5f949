//! Resections of a scene: from entries to removals, step by step.

use crate::build::{Builder, BuiltBody, Plan};
use crate::error::SceneError;
use crate::output::cell_count;
use crate::scene::{Mode, ResectionEntry, ToolEntry};
use glam::DVec3;
use serde::Serialize;
use sinew::engine::connectivity::ElementKind;
use sinew::models::resection::{MassPolicy, Region, Removal, RemovalError};
use sinew::simulation::{BodyHandle, Simulation};

/// A resection in the simulation, and what it has done so far.
#[derive(Clone, Debug)]
pub struct BuiltResection {
    body: BodyHandle,
    action: Action,
    mass: MassPolicy,
    from: f64,
    until: f64,
    /// Sums so far.
    pub summary: ResectionSummary,
}

#[derive(Clone, Debug)]
enum Action {
    /// Once.
    Once(Region),
    /// At every step.
    Always(Region),
    /// A ball along a path of times (s) and positions (m).
    Tool { path: Vec<(f64, DVec3)>, radius: f64 },
}

/// What a resection did.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ResectionSummary {
    /// Name.
    pub name: String,
    /// Body.
    pub body: String,
    /// Tetrahedra removed.
    pub removed: usize,
    /// Hexahedra removed.
    pub removed_hexahedra: usize,
    /// Membrane triangles removed.
    pub removed_triangles: usize,
    /// Membrane quadrilaterals removed.
    pub removed_quads: usize,
    /// Tetrahedra left in the body after its last removal.
    pub remaining: usize,
    /// Hexahedra left in the body after its last removal.
    pub remaining_hexahedra: usize,
    /// Membrane triangles left in the body after its last removal.
    pub remaining_triangles: usize,
    /// Membrane quadrilaterals left in the body after its last removal.
    pub remaining_quads: usize,
    /// Connected pieces of the body after its last removal.
    pub pieces: usize,
    /// Vertices that lost their last element.
    pub orphans: usize,
    /// Mass removed (kg).
    pub mass: f64,
    /// Elastic and kinetic energy (J) that left the scene.
    pub energy: f64,
    /// Host time of all removals (s).
    pub total_s: f64,
    /// Host time of the longest (s).
    pub longest_s: f64,
}

/// Checks the entries.
pub(crate) fn build(
    builder: &Builder,
    entries: &[ResectionEntry],
    simulation: &mut Simulation,
    bodies: &[BuiltBody],
    plan: &Plan,
) -> Result<Vec<BuiltResection>, SceneError> {
    let mut built = Vec::new();
    for (i, entry) in entries.iter().enumerate() {
        let key = format!("resection[{i}]");
        if plan.mode == Mode::Static {
            let remedy = "leave it out, or use mode = \"dynamic\"";
            return Err(builder.value(key, "a resection in a static scene", remedy));
        }
        let body = builder.which(&key, entry.body.as_deref(), bodies)?;
        let action = action(builder, &key, entry, &bodies[body])?;
        let once = !matches!(action, Action::Always(_));
        let tool = matches!(action, Action::Tool { .. });
        for (name, value, allowed) in [("from", entry.from, !tool), ("until", entry.until, !once)] {
            let key = format!("{key}.{name}");
            match value {
                Some(_) if !allowed => {
                    let found = format!("`{name}` for a resection that has its own time");
                    return Err(builder.value(key, found, "leave it out"));
                }
                Some(value) => _ = builder.finite(&key, [value])?,
                None => {}
            }
        }
        let from = entry.from.unwrap_or(0.0);
        let until = entry.until.unwrap_or(f64::INFINITY);
        if from > until {
            let found = format!("it acts from {from} s until {until} s");
            let key = format!("{key}.until");
            return Err(builder.value(key, found, "make `until` later than `from`"));
        }
        let handle = bodies[body].handle;
        // the first removal is then as quick as the others; the body exists
        let _ = simulation.prepare_removals(handle);
        let summary = ResectionSummary {
            name: entry.name.clone(),
            body: bodies[body].name.clone(),
            remaining: cell_count(&bodies[body], ElementKind::Tetrahedron),
            remaining_triangles: cell_count(&bodies[body], ElementKind::Triangle),
            remaining_hexahedra: cell_count(&bodies[body], ElementKind::Hexahedron),
            remaining_quads: cell_count(&bodies[body], ElementKind::Quad),
            pieces: simulation.topology().bodies[handle.0].piece_count(),
            ..ResectionSummary::default()
        };
        let mass = entry.mass;
        built.push(BuiltResection { body: handle, action, mass, from, until, summary });
    }
    Ok(built)
}

fn action(
    builder: &Builder,
    key: &str,
    entry: &ResectionEntry,
    body: &BuiltBody,
) -> Result<Action, SceneError> {
    let positive = |name: &str, value: f64| {
        let key = format!("{key}.{name}");
        if value > 0.0 && value.is_finite() {
            Ok(value)
        } else {
            Err(builder.value(key, format!("{name} is {value}"), "make it positive and finite"))
        }
    };
    let listed = |list: &[u32], keys: &str, kind: &str, count: usize| {
        let key = format!("{key}.{keys}");
        let mut sorted = list.to_vec();
        sorted.sort_unstable();
        if let Some(t) = sorted.iter().find(|&&t| t as usize >= count) {
            let found = format!("body `{}` has no {kind} {t}", body.name);
            return Err(builder.value(key, found, format!("it has {count}, from 0 on")));
        }
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            let found = format!("{kind} {} comes twice", pair[0]);
            return Err(builder.value(key, found, "name it once"));
        }
        Ok(sorted)
    };
    let lists = [
        (&entry.tetrahedra, "tetrahedra", ElementKind::Tetrahedron),
        (&entry.hexahedra, "hexahedra", ElementKind::Hexahedron),
        (&entry.triangles, "triangles", ElementKind::Triangle),
        (&entry.quads, "quads", ElementKind::Quad),
    ];
    let given: Vec<_> = lists.iter().filter(|(list, ..)| list.is_some()).collect();
    let ResectionEntry { sphere, tool, strain, stress, .. } = entry;
    Ok(match (&given[..], sphere, tool, strain, stress) {
        ([(Some(list), keys, kind)], None, None, None, None) => {
            let list = listed(list, keys, kind.name(), cell_count(body, *kind))?;
            Action::Once(match kind {
                ElementKind::Tetrahedron => Region::Tetrahedra(list),
                ElementKind::Hexahedron => Region::Hexahedra(list),
                ElementKind::Triangle => Region::Triangles(list),
                ElementKind::Quad => Region::Quads(list),
            })
        }
        ([], Some(s), None, None, None) => {
            let centre = builder.finite(&format!("{key}.sphere.centre"), s.centre)?;
            Action::Always(Region::Sphere { centre, radius: positive("sphere.radius", s.radius)? })
        }
        ([], None, Some(ToolEntry { radius, path }), None, None) => {
            let radius = positive("tool.radius", *radius)?;
            let key = format!("{key}.tool.path");
            if path.is_empty() {
                return Err(builder.value(key, "the path is empty", "give [time, x, y, z] points"));
            }
            if !path.iter().flatten().all(|x| x.is_finite()) {
                return Err(builder.value(key, "a number is not finite", "give finite numbers"));
            }
            if let Some(pair) = path.windows(2).find(|pair| pair[0][0] >= pair[1][0]) {
                let found = format!("time {} s follows time {} s", pair[1][0], pair[0][0]);
                return Err(builder.value(key, found, "give times in ascending order"));
            }
            let path = path.iter().map(|&[t, x, y, z]| (t, DVec3::new(x, y, z))).collect();
            Action::Tool { path, radius }
        }
        ([], None, None, Some(above), None) => {
            Action::Always(Region::Strain { above: positive("strain", *above)? })
        }
        ([], None, None, None, Some(above)) => {
            Action::Always(Region::Stress { above: positive("stress", *above)? })
        }
        _ => {
            return Err(builder.value(
                key,
                "not exactly one kind of resection is given",
                "give one of `tetrahedra`, `hexahedra`, `triangles`, `quads`, `sphere`, `tool`, `strain` \
                 and `stress`",
            ));
        }
    })
}

/// Carries out what is due before the step from `time` to `time + dt` (s).
///
/// # Errors
/// When a removal cannot be carried out, such as of a tetrahedron that another one removed before.
pub fn apply(
    resections: &mut [BuiltResection],
    simulation: &mut Simulation,
    time: f64,
    dt: f64,
) -> Result<(), RemovalError> {
    for own in resections {
        // times are compared to within the rounding of the clock
        let slack = 1e-6 * dt;
        let now = time + slack;
        let due = now >= own.from && time - slack <= own.until;
        let regions = match &own.action {
            Action::Once(region) | Action::Always(region) if due => vec![region.clone()],
            Action::Tool { path, radius } => swept(path, *radius, now - dt, now),
            _ => continue,
        };
        if matches!(own.action, Action::Once(_)) {
            own.until = f64::NEG_INFINITY;
        }
        for region in regions {
            let removal = Removal { region, mass: own.mass };
            let report = simulation.remove_elements(own.body, &removal)?;
            let s = &mut own.summary;
            s.total_s += report.time.as_secs_f64();
            s.longest_s = s.longest_s.max(report.time.as_secs_f64());
            let lists = [&report.tetrahedra, &report.triangles, &report.hexahedra, &report.quads];
            if lists.iter().all(|list| list.is_empty()) {
                continue;
            }
            s.removed += report.tetrahedra.len();
            s.removed_triangles += report.triangles.len();
            s.removed_hexahedra += report.hexahedra.len();
            s.removed_quads += report.quads.len();
            (s.remaining, s.pieces) = (report.remaining, report.pieces);
            s.remaining_triangles = report.remaining_triangles;
            s.remaining_hexahedra = report.remaining_hexahedra;
            s.remaining_quads = report.remaining_quads;
            s.orphans += report.orphans.len();
            s.mass += report.mass;
            s.energy += report.elastic_energy + report.kinetic_energy;
        }
    }
    Ok(())
}

/// What a ball along `path` sweeps after `from` and up to `to` (s).
fn swept(path: &[(f64, DVec3)], radius: f64, from: f64, to: f64) -> Vec<Region> {
    let (first, last) = (path[0], path[path.len() - 1]);
    if to < first.0 || from >= last.0 {
        return Vec::new();
    }
    let at = |t: f64| {
        let after = path.partition_point(|p| p.0 <= t);
        match (path.get(after.wrapping_sub(1)), path.get(after)) {
            (Some(a), Some(b)) => a.1.lerp(b.1, (t - a.0) / (b.0 - a.0)),
            (Some(a), None) | (None, Some(a)) => a.1,
            (None, None) => first.1,
        }
    };
    let within = path.iter().filter(|p| p.0 > from && p.0 < to).map(|p| p.1);
    let points: Vec<DVec3> = [at(from)].into_iter().chain(within).chain([at(to)]).collect();
    let capsule = |w: &[DVec3]| Region::Capsule { from: w[0], to: w[1], radius };
    points.windows(2).map(capsule).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_sweeps_its_path_once() {
        let path = [(1.0, DVec3::ZERO), (2.0, DVec3::X), (3.0, DVec3::new(1.0, 1.0, 0.0))];
        assert!(swept(&path, 0.1, 0.0, 0.9).is_empty());
        assert!(swept(&path, 0.1, 3.0, 3.5).is_empty());
        let ends = |from, to| -> Vec<[DVec3; 2]> {
            let ends = |r| match r {
                Region::Capsule { from, to, .. } => [from, to],
                _ => unreachable!("a tool sweeps capsules"),
            };
            swept(&path, 0.1, from, to).into_iter().map(ends).collect()
        };
        assert_eq!(ends(0.5, 1.5), [[DVec3::ZERO, DVec3::ZERO], [DVec3::ZERO, DVec3::X * 0.5]]);
        let corner = [DVec3::X * 0.75, DVec3::X];
        assert_eq!(ends(1.75, 2.25), [corner, [DVec3::X, DVec3::new(1.0, 0.25, 0.0)]]);
        assert_eq!(ends(2.5, 4.0).last().unwrap()[1], DVec3::new(1.0, 1.0, 0.0));
    }
}
