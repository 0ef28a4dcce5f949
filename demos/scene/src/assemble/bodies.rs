//! Bodies and their membranes.

use super::body::{BuiltBody, BuiltMembrane, CarriedSurface};
use super::materials::{MaterialUse, cell_data, field_error, material};
use super::meshes::Placed;
use super::scene::BuiltScene;
use super::select::group_cells;
use super::{axes, meshes};
use crate::error::SceneError;
use crate::scene::{
    BodyEntry, CutEntry, Key, MembraneEntry, Mode, PreparedMesh, SpringMethod, TearEntry,
};
use crate::springs::{Matter, Springs};
use crate::warning::{Level, Warning};
use sinew::engine::mesh::{CheckOptions, FILLED, Filled, LatticeReport, Mesh, check};
use sinew::models::body::lumped::{HexahedronSprings, SpringRule, UniformSprings};
use sinew::models::body::sheet::{
    Bending, MembraneDescription, MembraneModel, MembraneSettings, PlaneState,
};
use sinew::models::body::{BodyDescription, BodyError, Model, VolumeRule};
use sinew::models::cutting::tear::Tear;
use sinew::models::material::YoungPoisson;
use sinew::simulation::{BodyHandle, Simulation};
use std::sync::Arc;

/// How many cuts a scene makes through a body.
fn cuts(key: &Key, body: &str) -> usize {
    let of = |cut: &&CutEntry| cut.body.as_deref().is_none_or(|name| name == body);
    key.loaded.scene.cuts.iter().filter(of).count()
}

/// The key that an error is about.
fn key_of<'a>(error: &BodyError, body: &Key<'a>, mesh: &Key<'a>) -> Key<'a> {
    match error {
        BodyError::Glue { .. } => body.at("glue"),
        _ => mesh.clone(),
    }
}

/// A body of a scene.
pub(super) fn body(
    key: &Key,
    body: &BodyEntry,
    built: &mut BuiltScene,
) -> Result<BuiltBody, SceneError> {
    let entry = &body.material;
    let thin = |mesh: &Mesh| {
        body.membrane.as_ref().filter(|m| !mesh.is_solid() && m.plane == PlaneState::Stress)
    };
    let shared = body.membrane.as_ref().is_some_and(|m| m.material.is_none());
    let material = |mesh: &Mesh| {
        let solid = mesh.is_solid().then_some(mesh);
        let of = MaterialUse { thin: thin(mesh).is_some(), volume: body.volume, solid, shared };
        material(&key.at("material"), entry, of)
    };
    let mesh_key = meshes::source(key, body);
    let prepared = key.loaded.prepared_mesh(body, || {
        let Placed { mesh: placed, surface, lattice } = meshes::placed(key, body)?;
        material(&placed)?;
        placed.fits_into_memory().map_err(|e| mesh_key.error(e))?;
        let checked = check(&placed, &CheckOptions::default()).map_err(|e| mesh_key.error(e))?;
        let carried = match &surface {
            Some(surface) => Some(carried(key, surface, &checked.mesh)?),
            None => None,
        };
        Ok(PreparedMesh { placed, checked, carried, lattice })
    })?;
    let material = material(&prepared.placed)?;
    let PreparedMesh { placed, mut checked, carried, lattice } = Arc::unwrap_or_clone(prepared);
    built.warnings.extend(lattice.and_then(|report| lattice_warning(key, &report)));
    let membrane = match &body.membrane {
        Some(entry) => {
            let key = key.at("membrane");
            let mut own = membrane(&key, entry, &checked.mesh, material)?;
            let faces = (&checked.mesh, &own.triangles[..]);
            own.fibres = axes::of_membrane(&key, (body, entry), faces, &mut built.warnings)?;
            Some(own)
        }
        None => None,
    };
    if !checked.mesh.is_solid() && membrane.is_none() {
        return Err(mesh_key.value(
            "the mesh has faces but no tetrahedra or hexahedra",
            "give them a thickness, membrane = { thickness = 0.001 }, or fill the mesh with \
             tetrahedra (Gmsh, TetGen)",
        ));
    }
    if let Some(membrane) = &membrane {
        checked.use_faces(&membrane.triangles, &membrane.quads);
    }
    let field = |quantity: &str, name: &Option<String>| {
        let key = key.at("material").at(format!("{quantity}_field"));
        cell_data(&key, name.as_ref(), &checked.mesh)
    };
    let young_modulus = field("young_modulus", &entry.young_modulus_field)?;
    let poisson_ratio = field("poisson_ratio", &entry.poisson_ratio_field)?;
    let density = field("density", &entry.density_field)?;
    let filled = filled(key, body, [&placed, &checked.mesh])?;
    let axes = axes::axes(key, body, &checked.mesh, built.plan.mode, &mut built.warnings)?;
    let rule =
        spring_rule(key, (body.element_method, body.spring_constant), body.hexahedron_springs)?;
    tell_old_name(key, body.element_method, &mut built.warnings);
    let of_sheet = body.membrane.as_ref().and_then(|membrane| membrane.element_method);
    tell_old_name(&key.at("membrane"), of_sheet, &mut built.warnings);
    let springs = springs(key, body, &checked.mesh, material, membrane.as_ref())?;
    let of_file = springs.as_ref().and_then(|s| s.masses);
    let description = BodyDescription {
        axes: axes.clone(),
        young_modulus: young_modulus.as_deref(),
        poisson_ratio: poisson_ratio.as_deref(),
        density: density.as_deref(),
        filled: filled.as_deref(),
        model: body.model,
        evaluation: body.evaluation,
        volume: body.volume,
        integration: body.integration(),
        springs: rule,
        spring_constants: springs.map(|s| Arc::new(s.constants)),
        masses: body.masses.or(of_file).unwrap_or_default(),
        spare: match body.spare {
            Some(given) => given as usize,
            None => {
                // a tear goes its own way: more than a plane
                let planes = cuts(key, &body.name) + if body.tear.is_some() { 2 } else { 0 };
                super::cuts::spare(planes, checked.mesh.points.len())
            }
        },
        glue: body.glue,
        membrane: membrane.as_ref().map(|m| MembraneDescription {
            fibres: &m.fibres,
            ..m.settings.of(&m.triangles, &m.quads)
        }),
        ..BodyDescription::new(&body.name, &checked.mesh, material)
    };
    let counts = (checked.mesh.tetrahedra.len(), checked.mesh.hexahedra.len());
    description
        .material_field()
        .validate(counts.0, counts.1)
        .map_err(|source| field_error(&key.at("material"), entry, &checked.mesh, source))?;
    let handle = built.simulation.add_checked_body(&description, &checked.report);
    let handle = handle.map_err(|e| key_of(&e, key, &mesh_key).error(e))?;
    if let Some(entry) = body.tear {
        tear(&key.at("tear"), entry, handle, built)?;
    }
    let told = carried.as_ref().map(|own| carry(key, own, handle, &mut built.simulation));
    built.warnings.extend(told.flatten());
    let mass = built.simulation.masses(handle).iter().sum();
    Ok(BuiltBody {
        name: body.name.clone(),
        handle,
        mesh: checked.mesh,
        report: checked.report,
        used_vertices: checked.used_vertices,
        material,
        mass,
        membrane,
        preset: entry.preset.clone(),
        model: body.model,
        evaluation: body.evaluation,
        volume: body.volume,
        integration: body.integration(),
        springs: rule,
        axes,
        carried,
        lattice,
    })
}

/// Lets a body tear.
fn tear(
    key: &Key,
    entry: TearEntry,
    body: BodyHandle,
    built: &mut BuiltScene,
) -> Result<(), SceneError> {
    if built.plan.mode == Mode::Static {
        let remedy = "leave it out, or use mode = \"dynamic\"";
        return Err(key.value("a body that tears in a static scene", remedy));
    }
    let TearEntry { strength, toughness, radius, max_speed } = entry;
    let tear = Tear { body: body.0, strength, toughness, radius, max_speed };
    built.simulation.set_tear(tear).map_err(|error| key.error(error))?;
    Ok(())
}

/// Lets a body that can be cut carry a surface through cuts; what is to be told of it.
fn carry(
    key: &Key,
    carried: &CarriedSurface,
    body: BodyHandle,
    simulation: &mut Simulation,
) -> Option<Warning> {
    if simulation.topology().bodies[body.0].spare == 0 {
        return None;
    }
    let (found, remedy) = match simulation.carry_surface(body, &carried.points, &carried.triangles)
    {
        Ok(own) if own.long > 0 => (
            format!(
                "{} edges of its surface are longer than its elements: cuts through them are drawn roughly",
                own.long
            ),
            "take a finer surface",
        ),
        Ok(_) => return None,
        Err(error) => (
            format!("its surface is not drawn, as it does not go through cuts: {error}"),
            "leave `spare` out where the body is not to be cut",
        ),
    };
    let subject = format!("`{}`", key.path());
    Some(Warning::new("scene.surface.cuts", Level::Note, subject, found, remedy))
}

/// A surface in a body that carries it.
fn carried(key: &Key, surface: &Mesh, body: &Mesh) -> Result<CarriedSurface, SceneError> {
    let own = if key.loaded.gives(key.at("lattice").path()) { "lattice" } else { "surface" };
    let key = key.at(own);
    let carried = CarriedSurface::new(surface, body).ok_or_else(|| {
        let found = "the body has no tetrahedra or hexahedra that could carry it";
        key.value(found, "leave it out: the faces of the body are its surface")
    })?;
    let (low, high) = body.bounds().unwrap_or_default();
    let far = carried.embedding.farthest;
    if far > 0.1 * (high - low).length() {
        let found = format!("a point of it lies {} m from the body", crate::text::short(far));
        return Err(key.value(found, "give both files in one frame and one unit"));
    }
    Ok(carried)
}

/// What of every solid element is filled, when a scene says so. `placed` is the mesh before its elements were turned round.
fn filled(
    key: &Key,
    body: &BodyEntry,
    [placed, mesh]: [&Mesh; 2],
) -> Result<Option<Vec<Filled>>, SceneError> {
    let own = FILLED.to_string();
    let (key, name) = match (&body.material.filled_field, body.lattice) {
        (Some(_), Some(_)) => {
            let found = "a lattice knows what is filled";
            return Err(key.at("material").at("filled_field").value(found, "leave it out"));
        }
        (Some(name), None) => (key.at("material").at("filled_field"), name),
        (None, Some(_)) => (key.at("lattice"), &own),
        (None, None) => return Ok(None),
    };
    cell_data(&key, Some(name), mesh)?;
    let mut filled = mesh.filled(name);
    let (all, first) = (filled.iter_mut().flatten(), mesh.tetrahedra.len());
    for (own, pair) in all.skip(first).zip(mesh.hexahedra.iter().zip(&placed.hexahedra)) {
        // bottom and top were exchanged
        if pair.0 != pair.1 {
            let [_, _, z] = &mut own.middle;
            let [.., yz, zx, _] = &mut own.spread;
            [z, yz, zx].into_iter().for_each(|x| *x = -*x);
        }
    }
    Ok(filled)
}

/// What a lattice lost of the volume inside its surface, as a share of it from which on it is a warning.
const LOST: f64 = 0.05;

fn lattice_warning(key: &Key, report: &LatticeReport) -> Option<Warning> {
    let LatticeReport { volume, held, nearly_empty, apart, odd_lines, .. } = *report;
    let lost = 1.0 - held / volume;
    let mut found = Vec::new();
    if lost.abs() > LOST {
        found.push(format!(
            "its cells hold {:.1} % of the volume inside the surface ({nearly_empty} nearly empty ones and {apart} that hang \
             together with the rest by no face were left out)",
            100.0 * (1.0 - lost)
        ));
    }
    if odd_lines > 0 {
        found.push(format!("{odd_lines} lines cross the surface an odd number of times"));
    }
    (!found.is_empty()).then(|| {
        Warning::new(
            "scene.lattice.volume",
            Level::Warning,
            format!("`{}`", key.at("lattice").path()),
            found.join("; "),
            "give smaller cells, or a surface without holes that does not cut itself",
        )
    })
}

fn tell_old_name(key: &Key, method: Option<SpringMethod>, warnings: &mut Vec<Warning>) {
    let Some(SpringMethod::Renamed(method)) = method else { return };
    let old = method.old_name().unwrap_or_default();
    warnings.push(Warning::new(
        "scene.name.renamed",
        Level::Note,
        format!("`{}`", key.at("element_method").path()),
        format!("`{old}` is now called `{method}`"),
        format!("write `{method}`; the next version does not know `{old}`"),
    ));
}

/// Where the constants of springs come from, by the keys of a body or a membrane.
fn spring_rule(
    key: &Key,
    (method, constant): (Option<SpringMethod>, Option<f64>),
    of_hexahedron: Option<u32>,
) -> Result<Option<SpringRule>, SceneError> {
    let uniform = method == Some(SpringMethod::Uniform);
    for (name, given) in
        [("spring_constant", constant.is_some()), ("hexahedron_springs", of_hexahedron.is_some())]
    {
        if given && !uniform {
            let found = format!("`{name}` belongs to element_method = \"uniform\"");
            return Err(key.at(name).value(found, "set that method, or leave the key out"));
        }
    }
    let hexahedron = match of_hexahedron {
        None | Some(28) => HexahedronSprings::All,
        Some(16) => HexahedronSprings::EdgesAndDiagonals,
        Some(count) => {
            let remedy = "give 28 (all pairs of vertices) or 16 (edges and diagonals in space)";
            let key = key.at("hexahedron_springs");
            return Err(key.value(format!("{count} springs in a hexahedron"), remedy));
        }
    };
    Ok(match method {
        None => None,
        Some(SpringMethod::Fitted(method) | SpringMethod::Renamed(method)) => Some(method.into()),
        Some(SpringMethod::Uniform) => {
            let key = key.at("spring_constant");
            let constant = constant.ok_or_else(|| {
                let remedy = "uniform springs need a constant in N/m, for example 10.0";
                key.missing("key `spring_constant`", remedy)
            })?;
            let constant = key.positive(constant, "the spring constant", "N/m")?;
            Some(SpringRule::Uniform(UniformSprings { constant, hexahedron }))
        }
    })
}

/// Springs that a file gives to the elements of a body.
fn springs(
    key: &Key,
    body: &BodyEntry,
    mesh: &Mesh,
    material: YoungPoisson,
    membrane: Option<&BuiltMembrane>,
) -> Result<Option<Springs>, SceneError> {
    let Some(path) = &body.springs else { return Ok(None) };
    let key = key.at("springs");
    let solid = mesh.is_solid();
    let of_springs = if solid {
        body.model == Model::MassSpring
    } else {
        membrane.is_some_and(|m| m.settings.model == MembraneModel::MassSpring)
    };
    if !of_springs {
        let of = if solid { "the body" } else { "its membrane" };
        let remedy = "set model = \"mass_spring\" there, or leave `springs` out";
        return Err(key.value(format!("{of} does not consist of springs"), remedy));
    }
    let of_sheet = !solid && membrane.is_some_and(|m| m.settings.springs.is_some());
    if of_sheet || body.element_method.is_some() {
        return Err(key.value("`element_method` is given as well", "keep one of them"));
    }
    let density = membrane.filter(|_| !solid).map_or(material, |m| m.settings.material).density;
    let matter = Matter {
        density: (body.material.density_field.is_none()
            && body.material.filled_field.is_none()
            && body.lattice.is_none())
        .then_some(density),
        thickness: membrane.map_or(1.0, |m| m.settings.thickness),
    };
    let springs = crate::springs::read(&key, path, mesh, &matter)?;
    match (springs.masses, body.masses) {
        (Some(own), Some(asked)) if own != asked => Err(key
            .value("its masses are shared out otherwise than `masses` says", "leave `masses` out")),
        _ => Ok(Some(springs)),
    }
}

/// How a membrane resists bending.
fn bending(key: &Key, entry: &MembraneEntry) -> Result<Option<Bending>, SceneError> {
    let MembraneEntry { bending, bending_thickness: thickness, bending_rest: rest, .. } = *entry;
    let idle = [("bending_thickness", thickness.is_some()), ("bending_rest", rest.is_some())];
    if let Some((name, _)) = idle.into_iter().find(|(_, given)| *given && !bending) {
        let found = "the membrane does not resist bending";
        return Err(key.at(name).value(found, "add `bending = true`, or leave it out"));
    }
    if let Some(thickness) = thickness {
        key.at("bending_thickness").positive(thickness, "the thickness that bends", "m")?;
    }
    Ok(bending.then(|| Bending { thickness, rest: rest.unwrap_or_default() }))
}

/// The membrane of a body: its triangles and quadrilaterals, and what they are made of.
fn membrane(
    key: &Key,
    entry: &MembraneEntry,
    mesh: &Mesh,
    base: YoungPoisson,
) -> Result<BuiltMembrane, SceneError> {
    let material = match &entry.material {
        Some(own) => {
            let thin = entry.plane == PlaneState::Stress;
            let (volume, shared) = (VolumeRule::Elements, false);
            let of = MaterialUse { thin, volume, solid: None, shared };
            material(&key.at("material"), own, of)?
        }
        None => base,
    };
    key.at("thickness").positive(entry.thickness, "the thickness", "m")?;
    if !entry.model.supports(entry.evaluation) {
        let found = format!("model \"{}\" has no pooled evaluation", entry.model.name());
        return Err(key.at("evaluation").value(found, "leave it out"));
    }
    let (triangles, quads) = match (&entry.group, entry.surface) {
        (Some(group), None) => group_cells(key, group, mesh)?,
        (None, Some(true)) => {
            let surface = mesh.surface();
            (surface.triangles, surface.quads)
        }
        (None, None) if !mesh.is_solid() => (mesh.triangles.clone(), mesh.quads.clone()),
        _ => {
            let found = "not exactly one kind of cells is given";
            return Err(key.value(found, "give `group`, or `surface = true`"));
        }
    };
    if triangles.is_empty() && quads.is_empty() {
        return Err(key.value("it has no triangles and no quadrilaterals", "choose other ones"));
    }
    let springs = spring_rule(key, (entry.element_method, entry.spring_constant), None)?;
    let MembraneEntry { thickness, plane, model, evaluation, .. } = *entry;
    let bending = bending(key, entry)?;
    let settings =
        MembraneSettings { thickness, material, plane, model, evaluation, springs, bending };
    Ok(BuiltMembrane::new(mesh, triangles, quads, settings))
}
