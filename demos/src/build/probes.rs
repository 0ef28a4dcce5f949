//! Probes.

use super::scene::BuiltScene;
use super::select::{group_cells, select, which_body};
use crate::error::SceneError;
use crate::probe::{BuiltProbe, Needs, PROBES, Probe};
use crate::scene::{Key, LoadedScene, ProbeEntry};
use sinew::engine::mesh::Mesh;

/// Adds the probes of a scene.
pub(super) fn add(loaded: &LoadedScene, built: &mut BuiltScene) -> Result<(), SceneError> {
    for (i, entry) in loaded.scene.probes.iter().enumerate() {
        let probe = probe(&loaded.key("probe").entry(i), entry, built)?;
        built.probes.push(probe);
    }
    Ok(())
}

fn probe(key: &Key, entry: &ProbeEntry, built: &BuiltScene) -> Result<BuiltProbe, SceneError> {
    let BuiltScene { bodies, constraints, .. } = built;
    let record = recorded(&key.at("record"), &entry.record)?;
    let needs = |what| record.iter().any(|own| own.needs == what);
    let constraint = constraint(key, entry, needs(Needs::Constraint), built)?;
    let body = match (constraint, &entry.body) {
        // the selection of a reaction is that of its constraint
        (Some(index), None) => constraints[index].body,
        (None, None) if !needs(Needs::Body) && !needs(Needs::Faces) => 0,
        _ => which_body(key, entry.body.as_deref(), bodies)?,
    };
    let vertices = match (&entry.select, constraint) {
        (Some(selection), _) => select(&key.at("select"), selection, &bodies[body])?,
        (None, Some(index)) if constraints[index].body == body => {
            constraints[index].vertices.clone()
        }
        _ => bodies[body].used_vertices.clone(),
    };
    let faces = match needs(Needs::Faces) {
        true => selected_faces(&key.at("select"), entry, &bodies[body].mesh)?,
        false => Vec::new(),
    };
    Ok(BuiltProbe { name: entry.name.clone(), body, vertices, faces, constraint, record })
}

/// The quantities of these keys, at least one.
fn recorded(key: &Key, names: &[String]) -> Result<Vec<&'static Probe>, SceneError> {
    if names.is_empty() {
        return Err(key.value("nothing to record", "name a quantity"));
    }
    let known = || PROBES.iter().map(|probe| probe.key);
    let find = |name: &String| {
        let found = PROBES.iter().find(|probe| probe.key == *name);
        found.ok_or_else(|| key.unknown("quantity", name, known()))
    };
    names.iter().map(find).collect()
}

/// Index of the constraint whose reaction is recorded, `None` without a reaction.
fn constraint(
    key: &Key,
    entry: &ProbeEntry,
    reaction: bool,
    built: &BuiltScene,
) -> Result<Option<usize>, SceneError> {
    let key = key.at("constraint");
    let Some(wanted) = &entry.constraint else {
        let remedy = "\"reaction\" is the force of a constraint, name it";
        return if reaction { Err(key.missing("key `constraint`", remedy)) } else { Ok(None) };
    };
    let known = || built.constraints.iter().map(|c| c.name.as_str());
    let found = known().position(|name| name == wanted);
    let found = found.ok_or_else(|| key.unknown("constraint", wanted, known()))?;
    if !reaction {
        let found = "a constraint, but no \"reaction\" to record";
        let remedy = "add \"reaction\" to `record`, or leave `constraint` out";
        return Err(key.value(found, remedy));
    }
    Ok(Some(found))
}

/// Triangles of the selected group, quadrilaterals cut in two.
fn selected_faces(key: &Key, entry: &ProbeEntry, mesh: &Mesh) -> Result<Vec<[u32; 3]>, SceneError> {
    let Some(group) = entry.select.as_ref().and_then(|s| s.group.as_ref()) else {
        let found = "\"enclosed_volume\" without a group of faces";
        return Err(key.value(found, "give `select = { group = ... }`"));
    };
    let (mut faces, quads) = group_cells(key, group, mesh)?;
    faces.extend(quads.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]));
    Ok(faces)
}
