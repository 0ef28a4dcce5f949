//! Axes and muscles: from `[[body.fibres]]` and `[body.axes]` to a description.

use super::curves::factor;
use super::materials::cell_data;
use super::select::group_vertices;
use crate::error::SceneError;
use crate::scene::{
    AzimuthElevationEntry, BodyEntry, CircularEntry, FibreEntry, HelicoidalEntry,
    HemicircularEntry, Key, LaplaceEntry, MembraneEntry, Mode, MuscleEntry,
};
use crate::warning::{Level, Warning};
use glam::DVec3;
use sinew::engine::element_kind::ByKind;
use sinew::engine::mesh::{CellData, Mesh};
use sinew::models::axes::description::{
    AxesDescription, AxesError, AxisAngle, AxisFamily, FibreForm, ModulusOf,
};
use sinew::models::axes::field::{
    FibreError, FibreField, Laplace, Second, across, angles_by_formula, from_angles,
    from_cell_data, from_formula, helicoidal, middle_of_side, random,
};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::Model;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// The axes of a body, `None` where it has none.
pub(super) fn axes(
    key: &Key,
    body: &BodyEntry,
    mesh: &Mesh,
    mode: Mode,
    warnings: &mut Vec<Warning>,
) -> Result<Option<AxesDescription<'static>>, SceneError> {
    let error = |key: Key, source: AxesError| key.error(source);
    if body.fibres.is_empty() && body.axes.is_none() {
        if body.model == Model::Axes && mesh.is_solid() {
            return Err(error(key.at("model"), AxesError::Missing));
        }
        return Ok(None);
    }
    let mut families = Vec::with_capacity(body.fibres.len());
    // which entry made them
    let mut owners = Vec::with_capacity(body.fibres.len());
    for (i, entry) in body.fibres.iter().enumerate() {
        let key = key.at("fibres").entry(i);
        let muscle = match &entry.muscle {
            Some(entry) => Some(muscle(&key.at("muscle"), entry, mode)?),
            None => None,
        };
        let (own, second) = family(&key, &body.name, entry, mesh, warnings)?;
        let others = others(&key, entry, &own.directions, second, mesh)?;
        let others = others.into_iter().map(|(name, directions, modulus)| AxisFamily {
            name: Cow::Owned(name),
            directions: Cow::Owned(directions),
            modulus,
            ..own.clone()
        });
        let all: Vec<_> = others.collect();
        owners.extend(std::iter::repeat_n(i, 1 + all.len()));
        families.push(AxisFamily { muscle, ..own });
        families.extend(all);
    }
    let entry = body.axes.clone().unwrap_or_default();
    let mut angles = Vec::with_capacity(entry.angles.len());
    for (i, angle) in entry.angles.iter().enumerate() {
        let key = key.at("axes.angles").entry(i).at("between");
        let known = || families.iter().map(|f: &AxisFamily| &*f.name);
        let family = |name: &str| {
            known().position(|f| f == name).ok_or_else(|| key.unknown("fibres", name, known()))
        };
        let [a, b] = &angle.between;
        angles.push(AxisAngle { families: [family(a)?, family(b)?], modulus: angle.modulus });
    }
    let volume_modulus = entry.volume_modulus.unwrap_or(0.0);
    let form = entry.form.filter(|form| form != "energy_consistent").map(|form| ("form", form));
    let viscosity = entry.volume_viscosity.filter(|&viscosity| viscosity != 0.0);
    let viscosity = viscosity.map(|viscosity| ("volume_viscosity", format!("{viscosity} Pa s")));
    if let Some((name, found)) = form.or(viscosity) {
        let remedy = "leave it out; axes as printed are a law of the package `sinew-papers` (benches/papers)";
        return Err(key.at("axes").at(name).value(found, remedy));
    }
    let description = AxesDescription { families, angles, volume_modulus };
    let checked = description.validate(mesh.tetrahedra.len(), mesh.hexahedra.len());
    checked.map_err(|source| error(wrong_key(key, &owners, &description, &source), source))?;
    Ok(Some(description))
}

/// A passive family, and what tells the second axis of a triad.
fn family(
    key: &Key,
    body: &str,
    entry: &FibreEntry,
    mesh: &Mesh,
    warnings: &mut Vec<Warning>,
) -> Result<(AxisFamily<'static>, Second), SceneError> {
    let (field, second) = directions(key, entry, mesh)?;
    if field.repaired > 0 {
        warnings.push(Warning::new(
            "scene.fibres.length",
            Level::Warning,
            format!("fibres `{}` of body `{body}`", entry.name),
            format!("{} vectors were not of unit length and were made so", field.repaired),
            "nothing to do if only their direction was meant",
        ));
    }
    let share = cell_data(&key.at("share_field"), entry.share_field.as_ref(), mesh)?;
    let family = AxisFamily {
        name: Cow::Owned(entry.name.clone()),
        directions: Cow::Owned(field.directions),
        modulus: entry.modulus,
        form: entry.form,
        viscosity: entry.viscosity.unwrap_or(0.0),
        share: share.map(Cow::Owned),
        muscle: None,
    };
    Ok((family, second))
}

/// Fibres of the membrane of a body, in these triangles of its mesh.
pub(super) fn of_membrane(
    key: &Key,
    (body, entry): (&BodyEntry, &MembraneEntry),
    (mesh, triangles): (&Mesh, &[[u32; 3]]),
    warnings: &mut Vec<Warning>,
) -> Result<Vec<AxisFamily<'static>>, SceneError> {
    if entry.fibres.is_empty() {
        return Ok(Vec::new());
    }
    let faces = &places(mesh, triangles);
    let mut families: Vec<AxisFamily> = Vec::with_capacity(entry.fibres.len());
    for (i, own) in entry.fibres.iter().enumerate() {
        let key = key.at("fibres").entry(i);
        let error = |name: &str, source: AxesError| key.at(name).error(source);
        let of_solid = [
            ("laplace", own.laplace.is_some()),
            ("hemicircular", own.hemicircular.is_some()),
            ("muscle", own.muscle.is_some()),
            ("across", own.across.is_some()),
            ("towards", own.towards.is_some()),
        ];
        if let Some((name, _)) = of_solid.into_iter().find(|(_, given)| *given) {
            let remedy = "leave it out; fibres of a membrane are passive, by direction, data, formula, angles, circles or helices";
            return Err(key.at(name).value("fibres of a membrane do not have it", remedy));
        }
        let family_name = || own.name.clone();
        if own.form != FibreForm::Biquadratic {
            return Err(error("form", AxesError::SheetForm { family: family_name() }));
        }
        if own.viscosity.is_some_and(|viscosity| viscosity != 0.0) {
            return Err(error("viscosity", AxesError::SheetViscosity { family: family_name() }));
        }
        let others = body.fibres.iter().chain(&entry.fibres[..i]);
        if others.map(|other| &other.name).any(|name| *name == own.name) {
            return Err(error("name", AxesError::Duplicate { family: family_name() }));
        }
        families.push(family(&key, &body.name, own, faces, warnings)?.0);
    }
    Ok(families)
}

/// A mesh whose elements are points, the middles of triangles, with the data of these.
fn places(mesh: &Mesh, triangles: &[[u32; 3]]) -> Mesh {
    let middle = |t: &[u32; 3]| t.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 3.0;
    let sorted = |mut t: [u32; 3]| {
        t.sort_unstable();
        t
    };
    let index: BTreeMap<[u32; 3], usize> =
        mesh.triangles.iter().enumerate().map(|(i, t)| (sorted(*t), i)).collect();
    let pick = |values: &[f64]| {
        let of = |t: &[u32; 3]| index.get(&sorted(*t)).and_then(|&i| values.get(i)).copied();
        triangles.iter().map(|t| of(t).unwrap_or(f64::NAN)).collect()
    };
    let data = mesh.cell_data.iter().map(|data| CellData {
        values: ByKind { tetrahedra: pick(&data.values.triangles), ..ByKind::default() },
        ..data.clone()
    });
    Mesh {
        source: mesh.source.clone(),
        points: triangles.iter().map(middle).collect(),
        tetrahedra: (0..triangles.len() as u32).map(|i| [i; 4]).collect(),
        cell_data: data.collect(),
        ..Mesh::default()
    }
}

/// Key of what is wrong.
fn wrong_key<'a>(
    key: &Key<'a>,
    owners: &[usize],
    axes: &AxesDescription,
    error: &AxesError,
) -> Key<'a> {
    let of = |family: &str, what: &str| {
        // of two with the same name the second
        let at = axes.families.iter().rposition(|f| f.name == family).unwrap_or(0);
        let first = owners.iter().position(|owner| *owner == owners[at]).unwrap_or(at);
        let what = if at > first && what == "modulus" { "across" } else { what };
        key.at("fibres").entry(owners[at]).at(what)
    };
    let shared = key.at("axes");
    match error {
        AxesError::Duplicate { family } => of(family, "name"),
        AxesError::Share { family, .. } | AxesError::Length { family, .. } => {
            of(family, "share_field")
        }
        AxesError::Direction { family, .. } => of(family, "direction"),
        AxesError::Muscle { family, source } => of(family, &format!("muscle.{}", source.quantity)),
        AxesError::Viscosity { family, .. } => of(family, "viscosity"),
        AxesError::ActiveForm { family } => of(family, "form"),
        AxesError::Angle { families, .. } => {
            let at = axes.angles.iter().position(|a| a.families == *families).unwrap_or(0);
            shared.at("angles").entry(at).at("between")
        }
        AxesError::Modulus { of: ModulusOf::Volume, .. } => shared.at("volume_modulus"),
        AxesError::Modulus { of: ModulusOf::Family(family), .. } => of(family, "modulus"),
        AxesError::Modulus { of: ModulusOf::Angle { index, .. }, .. } => {
            shared.at("angles").entry(*index).at("modulus")
        }
        _ => shared,
    }
}

/// Names, directions and moduli of the axes across a family, none without.
fn others(
    key: &Key,
    entry: &FibreEntry,
    fibres: &[DVec3],
    second: Second,
    mesh: &Mesh,
) -> Result<Vec<(String, Vec<DVec3>, f64)>, SceneError> {
    let towards = entry.towards.map(|own| key.at("towards").axis(own)).transpose()?;
    let Some(moduli) = entry.across else {
        return match towards {
            Some(_) => Err(key.at("towards").value(
                "there is no second axis",
                "give `across`, moduli of a second and a third axis, or leave it out",
            )),
            None => Ok(Vec::new()),
        };
    };
    let at = if towards.is_some() { "towards" } else { "across" };
    let second = towards.map_or(second, Second::Towards);
    let axes = across(fibres, &second, mesh).map_err(|source| key.at(at).error(source))?;
    let named = |(i, (directions, modulus)): (usize, (Vec<DVec3>, f64))| {
        (format!("{}_{}", entry.name, i + 2), directions, modulus)
    };
    Ok(axes.into_iter().zip(moduli).enumerate().map(named).collect())
}

/// The directions of a family, one or one for every element, and where a second axis across them lies.
fn directions(
    key: &Key,
    entry: &FibreEntry,
    mesh: &Mesh,
) -> Result<(FibreField, Second), SceneError> {
    let given = [
        entry.direction.is_some(),
        entry.data.is_some(),
        entry.formula.is_some(),
        entry.azimuth_elevation.is_some(),
        entry.laplace.is_some(),
        entry.circular.is_some(),
        entry.hemicircular.is_some(),
        entry.helicoidal.is_some(),
        entry.random.is_some(),
    ];
    let keys = "`direction`, `data`, `formula`, `azimuth_elevation`, `laplace`, `circular`, `hemicircular`, \
                `helicoidal` and `random`";
    key.exactly_one(&given, "direction", keys)?;
    let error = |name: &str| {
        let key = key.at(name);
        move |source: FibreError| key.error(source)
    };
    let point = |name: &str, values: [f64; 3]| key.at(name).finite(values);
    let plain = |field: Result<FibreField, SceneError>| Ok((field?, Second::Coordinate));
    if let Some(direction) = entry.direction {
        let key = key.at("direction");
        let unit = key.finite(direction)?.try_normalize();
        let unit = unit.ok_or_else(|| key.value("the direction has no length", "give a vector"))?;
        return plain(Ok(FibreField { directions: vec![unit], repaired: 0 }));
    }
    if let Some(name) = &entry.data {
        return plain(from_cell_data(mesh, name).map_err(|source| match source {
            // near misses first
            FibreError::Data { .. } if !mesh.cell_data.is_empty() => {
                let known = mesh.cell_data.iter().filter_map(|d| d.name.strip_suffix("_x"));
                key.at("data").unknown("vectors", name, known)
            }
            source => error("data")(source),
        }));
    }
    if let Some([x, y, z]) = &entry.formula {
        return plain(from_formula(mesh, [x, y, z]).map_err(error("formula")));
    }
    if let Some(angles) = &entry.azimuth_elevation {
        return plain(by_angles(&key.at("azimuth_elevation"), angles, mesh));
    }
    if let Some(rule) = &entry.laplace {
        return by_laplace(&key.at("laplace"), rule, mesh);
    }
    let round = |name: &str, centre: DVec3, axis: DVec3, pitch: f64| {
        let field = helicoidal(mesh, centre, axis, pitch).map_err(error(name))?;
        Ok((field, Second::Away { centre, axis }))
    };
    if let Some(CircularEntry { centre, axis }) = entry.circular {
        let (centre, axis) = (point("circular.centre", centre)?, point("circular.axis", axis)?);
        return round("circular", centre, axis, 0.0);
    }
    if let Some(HemicircularEntry { axis, side }) = entry.hemicircular {
        let (axis, side) = (point("hemicircular.axis", axis)?, point("hemicircular.side", side)?);
        let centre = middle_of_side(mesh, side).map_err(error("hemicircular"))?;
        return round("hemicircular", centre, axis, 0.0);
    }
    if let Some(HelicoidalEntry { centre, axis, degrees }) = entry.helicoidal {
        let centre = point("helicoidal.centre", centre)?;
        let axis = point("helicoidal.axis", axis)?;
        return round("helicoidal", centre, axis, degrees.to_radians());
    }
    plain(Ok(random(mesh, entry.random.as_ref().map_or(0, |r| r.seed))))
}

fn by_angles(
    key: &Key,
    entry: &AzimuthElevationEntry,
    mesh: &Mesh,
) -> Result<FibreField, SceneError> {
    let error = |source: FibreError| key.error(source);
    let given = [entry.data.is_some(), entry.formula.is_some()];
    key.exactly_one(&given, "angles", "`data` and `formula`")?;
    let axis = key.at("axis").finite(entry.axis.unwrap_or([0.0, 0.0, 1.0]))?;
    let zero = key.at("zero").finite(entry.zero.unwrap_or([1.0, 0.0, 0.0]))?;
    let angles = match (&entry.formula, &entry.data) {
        (Some([azimuth, elevation]), _) => {
            angles_by_formula(mesh, [azimuth, elevation]).map_err(error)?
        }
        (None, names) => {
            let of = |k: usize| {
                let values = cell_data(&key.at("data"), names.as_ref().map(|n| &n[k]), mesh);
                values.map(Option::unwrap_or_default)
            };
            [of(0)?, of(1)?]
        }
    };
    from_angles([&angles[0], &angles[1]], axis, zero).map_err(error)
}

fn by_laplace(
    key: &Key,
    rule: &LaplaceEntry,
    mesh: &Mesh,
) -> Result<(FibreField, Second), SceneError> {
    let error = |source: FibreError| key.error(source);
    let inner = group_vertices(&key.at("from"), &rule.from, mesh)?;
    let outer = group_vertices(&key.at("to"), &rule.to, mesh)?;
    let (angles, axis) = match (rule.helix, rule.axis) {
        (Some(angles), Some(axis)) => (angles, axis),
        (None, None) => {
            let through = Laplace::solve(mesh, &inner, &outer).map_err(error)?.through();
            return Ok((through, Second::Coordinate));
        }
        (helix, _) => {
            let (given, missing) =
                if helix.is_some() { ("helix", "axis") } else { ("axis", "helix") };
            return Err(key.at(given).missing(
                format!("key `{missing}`"),
                "a helix needs angles [inside, outside] (degrees) and an axis; without both, \
                 fibres run through the wall",
            ));
        }
    };
    let axis = key.at("axis").finite(axis)?;
    let laplace = Laplace::solve(mesh, &inner, &outer).map_err(error)?;
    let [from, to] = angles.map(f64::to_radians);
    let field = laplace.helix(axis, from, to).map_err(error)?;
    Ok((field, Second::Each(laplace.transmural)))
}

fn muscle(key: &Key, entry: &MuscleEntry, mode: Mode) -> Result<MuscleSettings, SceneError> {
    let default = MuscleSettings::default();
    Ok(MuscleSettings {
        peak_stress: entry.peak_stress.unwrap_or(default.peak_stress),
        optimal_stretch: entry.optimal_stretch.unwrap_or(default.optimal_stretch),
        width: entry.width.unwrap_or(default.width),
        stiffening: entry.stiffening.unwrap_or(default.stiffening),
        shortening: entry.shortening.unwrap_or(default.shortening),
        curve: Some(factor(key, entry.curve.as_ref(), mode)?),
    })
}
