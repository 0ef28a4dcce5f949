//! Selections of vertices and faces.

use super::body::BuiltBody;
use crate::error::{SceneError, SceneProblem, hint};
use crate::scene::{FacesEntry, Key, PatchRegion, Selection};
use sinew::engine::mesh::{FindingCode, Group, Mesh, Patch, Surface};
use std::collections::{BTreeMap, HashMap};

/// The body of that name, or the only one.
pub(super) fn which_body(
    key: &Key,
    name: Option<&str>,
    bodies: &[BuiltBody],
) -> Result<usize, SceneError> {
    let key = key.at("body");
    let known = || bodies.iter().map(|b| b.name.as_str());
    match name {
        Some(name) => {
            known().position(|n| n == name).ok_or_else(|| key.unknown("body", name, known()))
        }
        None if bodies.len() == 1 => Ok(0),
        None => {
            let remedy = format!("the scene has {} bodies, say which one is meant", bodies.len());
            Err(key.missing("key `body`", remedy))
        }
    }
}

/// Sorted vertices of a selection, at least one.
pub(super) fn select(
    key: &Key,
    selection: &Selection,
    body: &BuiltBody,
) -> Result<Vec<u32>, SceneError> {
    let Selection { group, vertices, cuboid, sphere, cylinder, half_space, patch, all } = selection;
    let given = [
        group.is_some(),
        vertices.is_some(),
        cuboid.is_some(),
        sphere.is_some(),
        cylinder.is_some(),
        half_space.is_some(),
        patch.is_some(),
        all.is_some(),
    ];
    let keys =
        "`group`, `vertices`, `box`, `sphere`, `cylinder`, `half_space`, `patch` and `all = true`";
    key.exactly_one(&given, "selection", keys)?;
    let (chosen, remedy) = if let Some(name) = group {
        let mut chosen = group_vertices(&key.at("group"), name, &body.mesh)?;
        chosen.sort_unstable();
        chosen.dedup();
        chosen.retain(|v| body.used_vertices.binary_search(v).is_ok());
        (chosen, "the group has no vertex that an element uses".to_string())
    } else if let Some(vertices) = vertices {
        (listed(&key.at("vertices"), vertices, body)?, "the list is empty".to_string())
    } else if let Some((name, zone)) = selection.zone() {
        if let Some(problem) = zone.problem() {
            return Err(key.at(name).value(problem, "correct it"));
        }
        let points = &body.mesh.points;
        let inside = |v: &u32| zone.contains(points[*v as usize]);
        (body.used_vertices.iter().copied().filter(inside).collect(), bounds_remedy(body))
    } else if let Some(region) = patch {
        let mut chosen = body.mesh.patch_vertices(&surface_patch(key, region)?);
        chosen.retain(|v| body.used_vertices.binary_search(v).is_ok());
        (chosen, PATCH_REMEDY.to_string())
    } else if *all == Some(true) {
        (body.used_vertices.clone(), String::new())
    } else {
        let key = key.at("all");
        return Err(key.value("`all = false` selects nothing", "give another selection"));
    };
    if chosen.is_empty() {
        let body = body.name.clone();
        return Err(key.error(SceneProblem::EmptySelection { body, remedy }));
    }
    Ok(chosen)
}

/// What to do where no face belongs to a patch.
const PATCH_REMEDY: &str =
    "no face of the surface looks there: make `angle` larger, or turn `normal` round";

/// The patch of a scene.
fn surface_patch(key: &Key, region: &PatchRegion) -> Result<Patch, SceneError> {
    let patch = region.patch();
    match patch.problem() {
        Some(problem) => Err(key.at("patch").value(problem, "correct it")),
        None => Ok(patch),
    }
}

/// Sorted vertices of a list, all of which elements use.
fn listed(key: &Key, vertices: &[u32], body: &BuiltBody) -> Result<Vec<u32>, SceneError> {
    let count = body.mesh.points.len();
    if let Some(&vertex) = vertices.iter().find(|&&v| v as usize >= count) {
        let body = body.name.clone();
        return Err(key.error(SceneProblem::VertexIndex { body, vertex, count }));
    }
    if let Some(vertex) = vertices.iter().find(|v| body.used_vertices.binary_search(v).is_err()) {
        let found = format!("no element uses vertex {vertex} of body `{}`", body.name);
        return Err(key.value(found, "leave it out"));
    }
    let mut chosen = vertices.to_vec();
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

fn bounds_remedy(body: &BuiltBody) -> String {
    match body.mesh.bounds() {
        Some((low, high)) => {
            let mut findings = body.report.findings.iter();
            let size = findings.find(|f| f.code == FindingCode::ImplausibleSize);
            let scale = size.map_or(String::new(), |f| format!("; {}", f.remedy));
            format!(
                "the body reaches from [{:.4}, {:.4}, {:.4}] to [{:.4}, {:.4}, {:.4}] m{scale}",
                low.x, low.y, low.z, high.x, high.y, high.z
            )
        }
        None => "the body has no points".into(),
    }
}

/// Groups of that name, at least one.
fn groups<'m>(key: &Key, name: &str, mesh: &'m Mesh) -> Result<Vec<&'m Group>, SceneError> {
    let own: Vec<&Group> = mesh.groups.iter().filter(|g| g.name == name).collect();
    if !own.is_empty() {
        return Ok(own);
    }
    let known = || mesh.groups.iter().map(|g| g.name.as_str());
    let mut hint = hint("group", name, known());
    if hint.starts_with("did") {
        let all: Vec<&str> = known().collect();
        hint.push_str(&format!(" groups of the mesh: {}", all.join(", ")));
    }
    let name = name.to_string();
    Err(key.error(SceneProblem::Unknown { kind: "group", name, hint }))
}

/// Vertices of the groups of that name, not sorted.
pub(super) fn group_vertices(key: &Key, name: &str, mesh: &Mesh) -> Result<Vec<u32>, SceneError> {
    let groups = groups(key, name, mesh)?;
    Ok(groups.into_iter().flat_map(|g| g.vertices.iter().copied()).collect())
}

/// Triangles and quadrilaterals of the groups of that name, at least one.
pub(super) fn group_cells(
    key: &Key,
    name: &str,
    mesh: &Mesh,
) -> Result<(Vec<[u32; 3]>, Vec<[u32; 4]>), SceneError> {
    let key = key.at("group");
    let (mut triangles, mut quads) = (Vec::new(), Vec::new());
    for group in groups(&key, name, mesh)? {
        triangles.extend(group.cells.triangles.iter().map(|&t| mesh.triangles[t as usize]));
        quads.extend(group.cells.quads.iter().map(|&q| mesh.quads[q as usize]));
    }
    if triangles.is_empty() && quads.is_empty() {
        let found = format!("group `{name}` has no triangles and no quadrilaterals");
        let has = |g: &&Group| !g.cells.triangles.is_empty() || !g.cells.quads.is_empty();
        let with: Vec<&str> = mesh.groups.iter().filter(has).map(|g| g.name.as_str()).collect();
        return Err(key.value(found, format!("groups with such cells: {}", with.join(", "))));
    }
    Ok((triangles, quads))
}

/// Triangles that a pressure pushes along their normals, and the share of the pressure that each gets: with
/// quadrilaterals among them half, because these are cut along both diagonals, so that every corner gets
/// what its shape function gives it, and triangles come twice.
pub(super) fn pressed_faces(
    key: &Key,
    on: &FacesEntry,
    body: &BuiltBody,
) -> Result<(Vec<[u32; 3]>, f64), SceneError> {
    let Surface { triangles, quads } = faces(key, on, body)?;
    if quads.is_empty() {
        return Ok((triangles, 1.0));
    }
    let cut = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d], [b, c, d], [a, b, d]];
    let twice = triangles.iter().chain(&triangles).copied();
    Ok((twice.chain(quads.into_iter().flat_map(cut)).collect(), 0.5))
}

/// Edges of the rim of a membrane between vertices of a group, each with a third vertex of its cell; at least one.
pub(super) fn rim_edges(
    key: &Key,
    group: &str,
    body: &BuiltBody,
) -> Result<Vec<[u32; 3]>, SceneError> {
    let key = key.at("rim");
    let mut vertices = group_vertices(&key, group, &body.mesh)?;
    vertices.sort_unstable();
    let mut edges: BTreeMap<[u32; 2], (usize, u32)> = BTreeMap::new();
    let triangles = body.membrane_triangles().iter().map(|t| &t[..]);
    for cell in triangles.chain(body.membrane_quads().iter().map(|q| &q[..])) {
        let n = cell.len();
        for i in 0..n {
            let edge = sorted([cell[i], cell[(i + 1) % n]]);
            edges.entry(edge).or_insert((0, cell[(i + 2) % n])).0 += 1;
        }
    }
    let within = |edge: &[u32; 2]| edge.iter().all(|v| vertices.binary_search(v).is_ok());
    let rim: Vec<[u32; 3]> = edges
        .into_iter()
        .filter(|(edge, (cells, _))| *cells == 1 && within(edge))
        .map(|([a, b], (_, third))| [a, b, third])
        .collect();
    if rim.is_empty() {
        let found = format!("no edge at the rim of a membrane lies between vertices of `{group}`");
        return Err(
            key.value(found, "name a group at the rim, or give `group` for faces of a solid")
        );
    }
    Ok(rim)
}

/// Faces of a body, those of a solid inward; at least one.
pub(super) fn faces(key: &Key, on: &FacesEntry, body: &BuiltBody) -> Result<Surface, SceneError> {
    let inward = |[a, b, c]: [u32; 3]| [a, c, b];
    let inward_quad = |[a, b, c, d]: [u32; 4]| [a, d, c, b];
    let inward_surface = |surface: Surface| {
        let triangles = surface.triangles.into_iter().map(inward);
        (triangles.collect(), surface.quads.into_iter().map(inward_quad).collect())
    };
    if on.rim.is_some() {
        let found = "a rim is no face";
        return Err(key.at("rim").value(
            found,
            "give faces; a rim is for the traction of a [[load]], without other keys",
        ));
    }
    let (triangles, quads) = match (&on.group, on.surface, &on.patch, on.membrane) {
        (Some(group), None, None, None) => {
            let surface = body.mesh.surface();
            let outward = by_vertices(&surface.triangles);
            let outward_quads = by_vertices(&surface.quads);
            let (mut triangles, mut quads) = group_cells(key, group, &body.mesh)?;
            for t in &mut triangles {
                *t = outward.get(&sorted(*t)).map_or(*t, |own| inward(*own));
            }
            for q in &mut quads {
                *q = outward_quads.get(&sorted(*q)).map_or(*q, |own| inward_quad(*own));
            }
            (triangles, quads)
        }
        (None, Some(true), None, None) => inward_surface(body.mesh.surface()),
        (None, None, Some(region), None) => {
            let surface = body.mesh.patch(&surface_patch(key, region)?);
            if surface == Surface::default() {
                let found = format!("body `{}` has no such faces", body.name);
                return Err(key.at("patch").value(found, PATCH_REMEDY));
            }
            match body.mesh.is_solid() {
                true => inward_surface(surface),
                false => (surface.triangles, surface.quads),
            }
        }
        (None, None, None, Some(true)) => {
            (body.membrane_triangles().to_vec(), body.membrane_quads().to_vec())
        }
        _ => {
            return Err(key.value(
                "not exactly one kind of faces is given",
                "give one of `group`, `surface = true`, `patch` and `membrane = true`",
            ));
        }
    };
    if triangles.is_empty() && quads.is_empty() {
        let found = format!("body `{}` has no such triangles", body.name);
        return Err(key.value(found, "choose other ones, or give the body a membrane"));
    }
    Ok(Surface { triangles, quads })
}

fn sorted<const N: usize>(mut cell: [u32; N]) -> [u32; N] {
    cell.sort_unstable();
    cell
}

fn by_vertices<const N: usize>(cells: &[[u32; N]]) -> HashMap<[u32; N], [u32; N]> {
    cells.iter().map(|&cell| (sorted(cell), cell)).collect()
}
