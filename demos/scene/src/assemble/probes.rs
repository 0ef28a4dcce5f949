//! Probes.

use super::BuiltTool;
use super::scene::BuiltScene;
use super::select::{group_cells, select, which_body};
use crate::error::SceneError;
use crate::probe::{BuiltProbe, Needs, PROBES, Probe};
use crate::scene::{Key, ProbeEntry};
use sinew::engine::mesh::Mesh;

/// A probe of a scene.
pub(super) fn probe(
    key: &Key,
    entry: &ProbeEntry,
    built: &BuiltScene,
) -> Result<BuiltProbe, SceneError> {
    let BuiltScene { bodies, constraints, .. } = built;
    let record = recorded(&key.at("record"), &entry.record)?;
    let part = record.iter().any(|own| own.needs == Needs::Part);
    let needs = |what| what == Needs::Tool && part || record.iter().any(|own| own.needs == what);
    let about = |word, wanted: &Option<String>, what, names: Vec<&str>| {
        about(&key.at(word), (word, wanted.as_deref()), needs(what), &names)
    };
    let constraint = about(
        "constraint",
        &entry.constraint,
        Needs::Constraint,
        constraints.iter().map(|c| c.name.as_str()).collect(),
    )?;
    let tools = built.tools.iter().map(|t| t.name.as_str());
    let tool = about("tool", &entry.tool, Needs::Tool, tools.collect())?;
    let part = which_part(&key.at("part"), entry.part, part, tool.map(|i| &built.tools[i]))?;
    let other = record.iter().any(|own| own.key == "tool_other_force");
    if let Some(index) = tool.filter(|&index| other && !built.tools[index].error_bar) {
        let found = format!("\"tool_other_force\" of tool `{}`", built.tools[index].name);
        let remedy = "that force is not found without `error_bar = true` there";
        return Err(key.at("record").value(found, remedy));
    }
    let pulls = built.pulls.iter().map(|p| p.name.as_str());
    let pull = about("pull", &entry.pull, Needs::Pull, pulls.collect())?;
    let contacts = built.contacts.iter().map(|c| c.name.as_str());
    let contact = about("contact", &entry.contact, Needs::Contact, contacts.collect())?;
    let threads = built.strands.iter().map(|t| t.name.as_str());
    let thread = about("thread", &entry.thread, Needs::Thread, threads.collect())?;
    let clips = built.clips.iter().map(|c| c.name.as_str());
    let clip = about("clip", &entry.clip, Needs::Clip, clips.collect())?;
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
    let name = entry.name.clone();
    let own = BuiltProbe { name, body, vertices, faces, record, ..BuiltProbe::default() };
    Ok(BuiltProbe { constraint, tool, part, pull, contact, thread, clip, ..own })
}

/// The part of a tool that an entry is about; `None` where nothing of it is `recorded`.
fn which_part(
    key: &Key,
    wanted: Option<usize>,
    recorded: bool,
    tool: Option<&BuiltTool>,
) -> Result<Option<usize>, SceneError> {
    let (name, count) = tool.map_or(("", 0), |tool| (tool.name.as_str(), tool.parts));
    match wanted {
        None if recorded => {
            let remedy = "\"tool_part_...\" is of one part of a tool, give its number from 0";
            Err(key.missing("key `part`", remedy))
        }
        Some(part) if !recorded => {
            let remedy = "add \"tool_part_...\" to `record`, or leave `part` out";
            Err(key.value(format!("part {part}, but nothing of it to record"), remedy))
        }
        Some(part) if count < 2 => {
            let found = format!("part {part} of tool `{name}`, which is of one part");
            Err(key.value(found, "record \"tool_...\" instead, and leave `part` out"))
        }
        Some(part) if part >= count => {
            let found = format!("part {part} of tool `{name}`");
            Err(key.value(found, format!("its parts are 0 to {}", count - 1)))
        }
        part => Ok(part),
    }
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

/// Index of what the key `word` names, among `names`; `None` where nothing of it is `recorded`.
fn about(
    key: &Key,
    (word, wanted): (&'static str, Option<&str>),
    recorded: bool,
    names: &[&str],
) -> Result<Option<usize>, SceneError> {
    let quantities = match word {
        "constraint" => "\"reaction\"".to_string(),
        word => format!("\"{word}_...\""),
    };
    let Some(wanted) = wanted else {
        let remedy = format!("{quantities} is of a {word}, name it");
        let missing = || key.missing(format!("key `{word}`"), remedy);
        return if recorded { Err(missing()) } else { Ok(None) };
    };
    let found = names.iter().position(|name| *name == wanted);
    let found = found.ok_or_else(|| key.unknown(word, wanted, names.iter().copied()))?;
    if !recorded {
        let found = format!("a {word}, but no {quantities} to record");
        let remedy = format!("add {quantities} to `record`, or leave `{word}` out");
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
