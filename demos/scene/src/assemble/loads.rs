//! Forces and pressures.

use super::conditions::{BuiltLoad, BuiltPressure};
use super::curves::factor;
use super::scene::BuiltScene;
use super::select::{faces, pressed_faces, rim_edges, select, which_body};
use crate::error::SceneError;
use crate::scene::{FacesEntry, Key, LoadEntry, PressureEntry};
use crate::summary::{LoadSummary, PressureSummary};
use crate::warning::{Level, Warning};
use glam::DVec3;
use sinew::engine::load::{Load, LoadedFace, Pressure};
use std::collections::HashMap;

/// Part of Young's modulus from which a pressure on a model that does not hold any pressure is told: bodies of such models were
/// quiet at half of it.
const UNHELD: f64 = 0.3;

/// A load of a scene: a force on vertices, or a traction on faces.
pub(super) fn load(
    key: &Key,
    entry: &LoadEntry,
    built: &mut BuiltScene,
) -> Result<BuiltLoad, SceneError> {
    let body = which_body(key, entry.body.as_deref(), &built.bodies)?;
    let curve = factor(key, entry.curve.as_ref(), built.plan.mode)?;
    let (name, handle) = (entry.name.clone(), built.bodies[body].handle);
    let pairs = "a load is `force` (N) with `select`, or `traction` (N/m^2) with `on`";
    let (entity, count) = match (&entry.select, entry.force, &entry.on, entry.traction) {
        (Some(selection), Some(force), None, None) => {
            let vertices = select(&key.at("select"), selection, &built.bodies[body])?;
            let force = key.at("force").finite(force)?;
            let rows = built.simulation.rows(handle, &name, &vertices).map_err(|e| key.error(e))?;
            let share = force / rows.len() as f64;
            let forces: Vec<_> = rows.iter().map(|&row| (row, share)).collect();
            let count = forces.len();
            (built.simulation.add_load(Load { name: name.clone(), forces, curve }), count)
        }
        (None, None, Some(on), Some(traction)) => {
            let traction = key.at("traction").finite(traction)?;
            let faces = loaded_faces(&key.at("on"), &name, on, traction, body, built)?;
            let mut rows: Vec<_> =
                faces.iter().flat_map(|face| &face.forces).map(|f| f.0).collect();
            rows.sort_unstable();
            rows.dedup();
            (built.simulation.add_loaded_faces(name.clone(), faces, curve), rows.len())
        }
        (None, None, None, None) => return Err(key.missing("what it does", pairs)),
        (Some(_), ..) if entry.on.is_none() && entry.traction.is_none() => {
            return Err(key.missing("key `force`", pairs));
        }
        (None, Some(_), None, None) => return Err(key.missing("key `select`", pairs)),
        (None, None, Some(_), None) => return Err(key.missing("key `traction`", pairs)),
        (None, None, None, Some(_)) => return Err(key.missing("key `on`", pairs)),
        _ => return Err(key.at("traction").value("keys of both kinds of loads are given", pairs)),
    };
    let load = built.simulation.world().get::<Load>(entity);
    let force: DVec3 = load.map_or(DVec3::ZERO, |load| load.forces.iter().map(|f| f.1).sum());
    let (body, force) = (built.bodies[body].name.clone(), force.to_array());
    Ok(BuiltLoad { summary: LoadSummary { name, body, vertices: count, force }, entity })
}

/// Faces under a traction, or edges of a rim.
fn loaded_faces(
    key: &Key,
    name: &str,
    on: &FacesEntry,
    traction: DVec3,
    body: usize,
    built: &mut BuiltScene,
) -> Result<Vec<LoadedFace>, SceneError> {
    let handle = built.bodies[body].handle;
    let FacesEntry { group: None, surface: None, patch: None, membrane: None, rim: Some(group) } =
        on
    else {
        let on = faces(key, on, &built.bodies[body])?;
        let faces = built.simulation.traction_faces(handle, name, &on, traction);
        return faces.map_err(|e| key.error(e));
    };
    let edges = rim_edges(key, group, &built.bodies[body])?;
    let cells = built.simulation.face_rows(handle, name, &edges).map_err(|e| key.error(e))?;
    let own = &built.bodies[body];
    let thickness = own.membrane.as_ref().map_or(0.0, |membrane| membrane.settings.thickness);
    let edges = edges.iter().zip(cells).map(|(&[a, b, _], corners)| {
        let length = own.mesh.points[a as usize].distance(own.mesh.points[b as usize]);
        let half = 0.5 * length * thickness * traction;
        LoadedFace { corners, forces: vec![(corners[0], half), (corners[1], half)] }
    });
    Ok(edges.collect())
}

/// A pressure of a scene.
pub(super) fn pressure(
    key: &Key,
    entry: &PressureEntry,
    built: &mut BuiltScene,
) -> Result<BuiltPressure, SceneError> {
    let body = which_body(key, entry.body.as_deref(), &built.bodies)?;
    let on = key.at("on");
    let (triangles, share) = pressed_faces(&on, &entry.on, &built.bodies[body])?;
    key.at("pressure").finite([entry.pressure])?;
    let curve = factor(key, entry.curve.as_ref(), built.plan.mode)?;
    let free = free_rim_edges(&triangles, share == 1.0, body, built);
    if free > 0 {
        built.warnings.push(Warning::new(
            "scene.pressure.rim",
            Level::Note,
            format!("pressure `{}`", entry.name),
            format!(
                "{free} edges of its rim are free to move: there it has no potential, and \
                 energies of implicit steps are approximate"
            ),
            "hold the rim, or put it on a closed surface, for exact energies",
        ));
    }
    let (name, handle) = (entry.name.clone(), built.bodies[body].handle);
    let faces = built.simulation.face_rows(handle, &name, &triangles).map_err(|e| on.error(e))?;
    let young = built.bodies[body].material.young_modulus;
    let solid = built.bodies[body].membrane.is_none();
    if solid && entry.pressure.abs() > young {
        built.warnings.push(Warning::new(
            "scene.pressure.range",
            Level::Warning,
            format!("pressure `{}`", entry.name),
            format!("{} Pa is more than Young's modulus, {young} Pa", entry.pressure),
            "check its unit; such a pressure crushes or bursts the body",
        ));
    }
    let model = built.bodies[body].model;
    if solid && !model.holds_pressure() && entry.pressure.abs() > UNHELD * young {
        let times = entry.pressure.abs() / young;
        built.warnings.push(Warning::new(
            "scene.pressure.unbounded",
            Level::Warning,
            format!("pressure `{}`", entry.name),
            format!(
                "{} Pa is {times:.2} times Young's modulus, and the energy of model = \"{}\" grows more slowly than the work of \
                 a pressure: from some value on nothing holds the body",
                entry.pressure,
                model.name()
            ),
            "use model = \"neo_hookean\" or \"svk_volume\", or a smaller pressure",
        ));
    }
    let pressure = entry.pressure * share;
    let own = Pressure { name: name.clone(), faces, pressure, curve };
    let entity = built.simulation.add_pressure(own);
    let (body, triangles) = (built.bodies[body].name.clone(), triangles.len());
    let summary = PressureSummary { name, body, triangles, pressure: entry.pressure };
    Ok(BuiltLoad { summary, entity })
}

/// Edges of the rim of some triangles with an end that no constraint holds. Where every face comes `once`,
/// rim edges belong to one triangle; faces that are cut twice share their diagonals, which they pass in
/// opposite directions.
fn free_rim_edges(triangles: &[[u32; 3]], once: bool, body: usize, built: &BuiltScene) -> usize {
    let mut edges = HashMap::new();
    for &[a, b, c] in triangles {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            let (count, turns) = edges.entry((a.min(b), a.max(b))).or_insert((0, 0));
            *count += 1;
            *turns += if a < b { 1 } else { -1 };
        }
    }
    let held = |v: u32| {
        let mut own = built.constraints.iter().filter(|c| c.body == body);
        own.any(|c| c.vertices.binary_search(&v).is_ok())
    };
    let is_rim = |count: i32, turns: i32| if once { count == 1 } else { turns != 0 };
    edges
        .iter()
        .filter(|((a, b), (count, turns))| is_rim(*count, *turns) && !(held(*a) && held(*b)))
        .count()
}
