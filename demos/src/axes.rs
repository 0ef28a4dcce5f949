//! Axes and muscles of a scene: `[[body.fibres]]` and `[body.axes]`, from entries to a description.

use crate::build::Builder;
use crate::error::{SceneError, hint};
use crate::scene::{Body, CurveEntry, Mode};
use crate::summary::{Level, Warning};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::Mesh;
use sinew::models::axes::description::{
    AxesDescription, AxesError, AxisAngle, AxisFamily, AxisForm,
};
use sinew::models::axes::field::{
    FibreError, FibreField, Laplace, circular, from_cell_data, from_formula, helicoidal,
    hemicircular, random,
};
use sinew::models::axes::muscle::MuscleSettings;
use sinew::models::body::Model;
use std::borrow::Cow;

/// A family of fibres: a direction in every solid element, given by exactly one of `direction`, `data`,
/// `formula`, `laplace`, `circular`, `hemicircular`, `helicoidal` and `random`. Directions and places are
/// those of the body in place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FibreEntry {
    /// Name, unique in the body; frames carry the fibres under it.
    pub name: String,
    /// Modulus along the fibres (Pa), added to that of the body's material.
    pub modulus: f64,
    /// Viscosity along the fibres (Pa s); no damping without it.
    pub viscosity: Option<f64>,
    /// The same direction everywhere, of any length.
    pub direction: Option<[f64; 3]>,
    /// Vectors of the mesh file.
    pub data: Option<String>,
    /// Formulas in x, y, z (m) at the barycentres.
    pub formula: Option<[String; 3]>,
    /// Through or round a wall between two groups.
    pub laplace: Option<LaplaceEntry>,
    /// Circles round an axis.
    pub circular: Option<CircularEntry>,
    /// Half circles round the middle of a side of the body's box.
    pub hemicircular: Option<HemicircularEntry>,
    /// Concentric helices.
    pub helicoidal: Option<HelicoidalEntry>,
    /// Random directions.
    pub random: Option<RandomEntry>,
    /// Cell data of the mesh file with a factor (0 and more) on modulus, viscosity and active stress in
    /// every element.
    pub share_field: Option<String>,
    /// Makes the fibres active.
    pub muscle: Option<MuscleEntry>,
}

/// Fibres by the Laplace rule: the gradient of a potential between two groups, or a helix round it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaplaceEntry {
    /// Group where the potential is 0.
    pub from: String,
    /// Group where it is 1.
    pub to: String,
    /// Angles (degrees) at both, linear between, from the direction round the axis; without, the fibres run
    /// through the wall.
    pub helix: Option<[f64; 2]>,
    /// Axis of the helix.
    pub axis: Option<[f64; 3]>,
}

/// Circles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CircularEntry {
    /// Point on the axis (m).
    pub centre: [f64; 3],
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
}

/// Half circles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HemicircularEntry {
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// Side of the body's box through whose middle the axis goes, as a direction.
    pub side: [f64; 3],
}

/// Helices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HelicoidalEntry {
    /// Point on the axis (m).
    pub centre: [f64; 3],
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// Angle (degrees) between fibre and the plane across the axis.
    pub degrees: f64,
}

/// Directions drawn evenly from the sphere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RandomEntry {
    /// Which of them.
    pub seed: u64,
}

/// What activation does to fibres; what is left out keeps the value of
/// [`MuscleSettings::default`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MuscleEntry {
    /// Active stress (Pa) at full activation and optimal stretch.
    pub peak_stress: Option<f64>,
    /// Stretch at which it is largest.
    pub optimal_stretch: Option<f64>,
    /// Half width of the length-tension curve.
    pub width: Option<f64>,
    /// Relative growth of the modulus at full activation.
    pub stiffening: Option<f64>,
    /// Relative shortening of the rest length at full activation.
    pub shortening: Option<f64>,
    /// Activation over time, held within 0 and 1; fully active from the first step without it, in a static
    /// scene growing with the loads.
    pub curve: Option<CurveEntry>,
}

/// What axes of several families have in common.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxesEntry {
    /// Springs on angles between families.
    #[serde(default)]
    pub angles: Vec<AngleEntry>,
    /// Modulus (Pa) of the term against changes of volume; default 0.
    pub volume_modulus: Option<f64>,
    /// `"energy_consistent"` (default), `"printed"` or `"printed_balanced"`.
    #[serde(default)]
    pub form: AxisForm,
}

/// A spring on the angle between two families.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AngleEntry {
    /// Names of the families.
    pub between: [String; 2],
    /// Modulus (Pa): the shear modulus in the plane of orthogonal axes.
    pub modulus: f64,
}

/// The axes of a body, `None` where it has none.
pub(crate) fn build(
    builder: &Builder,
    key: &str,
    body: &Body,
    mesh: &Mesh,
    mode: Mode,
    warnings: &mut Vec<Warning>,
) -> Result<Option<AxesDescription<'static>>, SceneError> {
    if body.fibres.is_empty() && body.axes.is_none() {
        if body.model == Model::Axes && mesh.is_solid() {
            let place = builder.place(format!("{key}.model"));
            return Err(SceneError::Axes { place, source: Box::new(AxesError::Missing) });
        }
        return Ok(None);
    }
    let mut families = Vec::with_capacity(body.fibres.len());
    for (i, entry) in body.fibres.iter().enumerate() {
        let key = format!("{key}.fibres[{i}]");
        let field = directions(builder, &key, entry, mesh)?;
        if field.repaired > 0 {
            warnings.push(Warning {
                code: "scene.fibres.length".into(),
                level: Level::Warning,
                subject: format!("fibres `{}` of body `{}`", entry.name, body.name),
                message: format!(
                    "{} vectors were not of unit length and were made so",
                    field.repaired
                ),
                remedy: "nothing to do if only their direction was meant".into(),
            });
        }
        let share_key = format!("{key}.share_field");
        let share = builder.field(&share_key, entry.share_field.as_ref(), mesh)?;
        let muscle = match &entry.muscle {
            Some(muscle) => Some(self::muscle(builder, &format!("{key}.muscle"), muscle, mode)?),
            None => None,
        };
        families.push(AxisFamily {
            name: Cow::Owned(entry.name.clone()),
            directions: Cow::Owned(field.directions),
            modulus: entry.modulus,
            viscosity: entry.viscosity.unwrap_or(0.0),
            share: share.map(Cow::Owned),
            muscle,
        });
    }
    let entry = body.axes.clone().unwrap_or_default();
    let mut angles = Vec::with_capacity(entry.angles.len());
    for (i, angle) in entry.angles.iter().enumerate() {
        let mut found = [0; 2];
        for (place, name) in found.iter_mut().zip(&angle.between) {
            *place = body.fibres.iter().position(|f| f.name == *name).ok_or_else(|| {
                SceneError::Unknown {
                    place: builder.place(format!("{key}.axes.angles[{i}].between")),
                    kind: "fibres",
                    name: name.clone(),
                    hint: hint("fibres", name, body.fibres.iter().map(|f| f.name.as_str())),
                }
            })?;
        }
        angles.push(AxisAngle { families: found, modulus: angle.modulus });
    }
    let volume_modulus = entry.volume_modulus.unwrap_or(0.0);
    let description = AxesDescription { families, angles, volume_modulus, form: entry.form };
    let checked = description.validate(mesh.tetrahedra.len(), mesh.hexahedra.len());
    checked.map_err(|source| SceneError::Axes {
        place: builder.place(place(key, body, &description, &source)),
        source: Box::new(source),
    })?;
    Ok(Some(description))
}

/// Key of what is wrong.
fn place(key: &str, body: &Body, axes: &AxesDescription, error: &AxesError) -> String {
    let of = |family: &str, what: &str| {
        // of two with the same name the second
        let at = body.fibres.iter().rposition(|f| f.name == family).unwrap_or(0);
        format!("{key}.fibres[{at}].{what}")
    };
    let bad = |value: f64| !(value >= 0.0 && value.is_finite());
    match error {
        AxesError::Duplicate { family } => of(family, "name"),
        AxesError::Share { family, .. } | AxesError::Length { family, .. } => {
            of(family, "share_field")
        }
        AxesError::Direction { family, .. } => of(family, "direction"),
        AxesError::Muscle { family, source } => of(family, &format!("muscle.{}", source.quantity)),
        AxesError::NoChord { .. } | AxesError::PrintedMuscle { .. } => format!("{key}.axes.form"),
        AxesError::Viscosity { family, .. } => of(family, "viscosity"),
        AxesError::Angle { families, .. } => {
            let at = axes.angles.iter().position(|a| a.families == *families).unwrap_or(0);
            format!("{key}.axes.angles[{at}].between")
        }
        AxesError::Modulus { .. } => {
            if bad(axes.volume_modulus) {
                return format!("{key}.axes.volume_modulus");
            }
            if let Some(at) = axes.families.iter().position(|f| bad(f.modulus)) {
                return format!("{key}.fibres[{at}].modulus");
            }
            let at = axes.angles.iter().position(|a| bad(a.modulus)).unwrap_or(0);
            format!("{key}.axes.angles[{at}].modulus")
        }
        _ => format!("{key}.axes"),
    }
}

/// The directions of a family: one, or one for every element.
fn directions(
    builder: &Builder,
    key: &str,
    entry: &FibreEntry,
    mesh: &Mesh,
) -> Result<FibreField, SceneError> {
    let FibreEntry {
        direction, data, formula, laplace, circular: round, hemicircular: half, ..
    } = entry;
    let (helices, chance) = (&entry.helicoidal, &entry.random);
    let given = [
        direction.is_some(),
        data.is_some(),
        formula.is_some(),
        laplace.is_some(),
        round.is_some(),
        half.is_some(),
        helices.is_some(),
        chance.is_some(),
    ];
    if given.iter().filter(|&&g| g).count() != 1 {
        return Err(builder.value(
            key,
            format!("fibres `{}` have not exactly one kind of direction", entry.name),
            "give one of `direction`, `data`, `formula`, `laplace`, `circular`, `hemicircular`, `helicoidal` and \
             `random`",
        ));
    }
    let error = |name: &str, source: FibreError| SceneError::Fibres {
        place: builder.place(format!("{key}.{name}")),
        source: Box::new(source),
    };
    let point = |name: &str, values: [f64; 3]| builder.finite(&format!("{key}.{name}"), values);
    if let Some(direction) = direction {
        let key = format!("{key}.direction");
        let unit = builder.finite(&key, *direction)?.try_normalize();
        let Some(unit) = unit else {
            return Err(builder.value(key, "the direction has no length", "give a vector"));
        };
        return Ok(FibreField { directions: vec![unit], repaired: 0 });
    }
    if let Some(name) = data {
        return from_cell_data(mesh, name).map_err(|source| match source {
            // near misses first
            FibreError::Data { .. } if !mesh.cell_data.is_empty() => {
                let known = mesh.cell_data.iter().filter_map(|d| d.name.strip_suffix("_x"));
                SceneError::Unknown {
                    place: builder.place(format!("{key}.data")),
                    kind: "vectors",
                    name: name.clone(),
                    hint: hint("vectors", name, known),
                }
            }
            source => error("data", source),
        });
    }
    if let Some([x, y, z]) = formula {
        return from_formula(mesh, [x, y, z]).map_err(|e| error("formula", e));
    }
    if let Some(rule) = laplace {
        return by_laplace(builder, &format!("{key}.laplace"), rule, mesh);
    }
    if let Some(CircularEntry { centre, axis }) = round {
        let (centre, axis) = (point("circular.centre", *centre)?, point("circular.axis", *axis)?);
        return circular(mesh, centre, axis).map_err(|e| error("circular", e));
    }
    if let Some(HemicircularEntry { axis, side }) = half {
        let (axis, side) = (point("hemicircular.axis", *axis)?, point("hemicircular.side", *side)?);
        return hemicircular(mesh, axis, side).map_err(|e| error("hemicircular", e));
    }
    if let Some(HelicoidalEntry { centre, axis, degrees }) = helices {
        let centre = point("helicoidal.centre", *centre)?;
        let axis = point("helicoidal.axis", *axis)?;
        let field = helicoidal(mesh, centre, axis, degrees.to_radians());
        return field.map_err(|e| error("helicoidal", e));
    }
    Ok(random(mesh, chance.as_ref().map_or(0, |r| r.seed)))
}

fn by_laplace(
    builder: &Builder,
    key: &str,
    rule: &LaplaceEntry,
    mesh: &Mesh,
) -> Result<FibreField, SceneError> {
    let group = |name: &str, what: &str| -> Result<Vec<u32>, SceneError> {
        let mut vertices: Vec<u32> = Vec::new();
        let own = mesh.groups.iter().filter(|g| g.name == name);
        own.for_each(|g| vertices.extend(&g.vertices));
        if mesh.group(name).is_some() {
            return Ok(vertices);
        }
        Err(SceneError::Unknown {
            place: builder.place(format!("{key}.{what}")),
            kind: "group",
            name: name.to_owned(),
            hint: hint("group", name, mesh.groups.iter().map(|g| g.name.as_str())),
        })
    };
    let error = |source: FibreError| SceneError::Fibres {
        place: builder.place(key),
        source: Box::new(source),
    };
    let (inner, outer) = (group(&rule.from, "from")?, group(&rule.to, "to")?);
    let (angles, axis) = match (rule.helix, rule.axis) {
        (Some(angles), Some(axis)) => (angles, axis),
        (None, None) => return Ok(Laplace::solve(mesh, &inner, &outer).map_err(error)?.through()),
        (helix, _) => {
            let (given, missing) =
                if helix.is_some() { ("helix", "axis") } else { ("axis", "helix") };
            return Err(SceneError::Missing {
                place: builder.place(format!("{key}.{given}")),
                what: format!("key `{missing}`"),
                remedy: "a helix needs angles [inside, outside] (degrees) and an axis; without both, fibres run \
                         through the wall"
                    .into(),
            });
        }
    };
    let axis: DVec3 = builder.finite(&format!("{key}.axis"), axis)?;
    let laplace = Laplace::solve(mesh, &inner, &outer).map_err(error)?;
    laplace.helix(axis, angles[0].to_radians(), angles[1].to_radians()).map_err(error)
}

fn muscle(
    builder: &Builder,
    key: &str,
    entry: &MuscleEntry,
    mode: Mode,
) -> Result<MuscleSettings, SceneError> {
    let default = MuscleSettings::default();
    Ok(MuscleSettings {
        peak_stress: entry.peak_stress.unwrap_or(default.peak_stress),
        optimal_stretch: entry.optimal_stretch.unwrap_or(default.optimal_stretch),
        width: entry.width.unwrap_or(default.width),
        stiffening: entry.stiffening.unwrap_or(default.stiffening),
        shortening: entry.shortening.unwrap_or(default.shortening),
        curve: Some(builder.factor(key, entry.curve.as_ref(), mode)?),
    })
}

/// Axes of a body in a summary.
#[derive(Clone, Debug, Serialize)]
pub struct AxesSummary {
    /// Families.
    pub families: Vec<FamilySummary>,
    /// Number of springs on angles between them.
    pub angles: usize,
    /// Modulus of the term of volume (Pa).
    pub volume_modulus: f64,
    /// Formulas.
    pub form: AxisForm,
    /// Volume of the body over that at rest: smallest, largest and last, over the rows of the probe file.
    pub volume_ratio: [f64; 3],
}

/// A family in a summary.
#[derive(Clone, Debug, Serialize)]
pub struct FamilySummary {
    /// Name.
    pub name: String,
    /// Modulus (Pa).
    pub modulus: f64,
    /// Viscosity (Pa s).
    pub viscosity: f64,
    /// Active stress (Pa) at full activation; `None` when passive.
    pub peak_stress: Option<f64>,
    /// Activation at the end.
    pub activation: Option<f64>,
}

impl AxesSummary {
    /// Of a description, with the activation of a family and the volume ratios.
    pub(crate) fn new(
        axes: &AxesDescription,
        activation: impl Fn(&str) -> Option<f64>,
        volume_ratio: [f64; 3],
    ) -> Self {
        let families = axes.families.iter().map(|f| FamilySummary {
            name: f.name.to_string(),
            modulus: f.modulus,
            viscosity: f.viscosity,
            peak_stress: f.muscle.as_ref().map(|m| m.peak_stress),
            activation: f.muscle.as_ref().and_then(|_| activation(&f.name)),
        });
        Self {
            families: families.collect(),
            angles: axes.angles.len(),
            volume_modulus: axes.volume_modulus,
            form: axes.form,
            volume_ratio,
        }
    }
}

/// Volume (m^3) between a surface and the cone from its rim to the rim's middle: of a cavity, how much it
/// holds. 0 for a surface without triangles; a closed surface has no rim.
pub fn enclosed_volume(points: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
    let point = |v: u32| points[v as usize];
    let mut edges: Vec<[u32; 2]> =
        triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    edges.sort_unstable();
    let rim = edges.iter().filter(|[a, b]| edges.binary_search(&[*b, *a]).is_err());
    let (mut sum, mut count) = (DVec3::ZERO, 0.0);
    for [a, b] in rim {
        sum += point(*a) + point(*b);
        count += 2.0;
    }
    let middle =
        if count > 0.0 { sum / count } else { points.first().copied().unwrap_or_default() };
    let cones = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|v| point(v) - middle);
        a.dot(b.cross(c)) / 6.0
    });
    cones.sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sinew::engine::mesh::generate::{box_tets, cup_hexahedra};

    #[test]
    fn volumes_of_a_box_and_of_a_cup() {
        let size = DVec3::new(0.3, 0.2, 0.1);
        let mesh = box_tets(size, [2, 3, 2]).unwrap();
        let moved: Vec<DVec3> = mesh.points.iter().map(|p| *p + DVec3::splat(5.0)).collect();
        let all = enclosed_volume(&moved, &mesh.surface_triangles());
        assert!((all / 0.006 - 1.0).abs() < 1e-12, "{all}");
        // without its top, which is flat, the same
        let top = mesh.group("z1").unwrap();
        let open: Vec<[u32; 3]> = (0..mesh.triangles.len())
            .filter(|i| !top.triangles.contains(&(*i as u32)))
            .map(|i| mesh.triangles[i])
            .collect();
        let open = enclosed_volume(&moved, &open);
        assert!((open / 0.006 - 1.0).abs() < 1e-12, "{open}");

        let cup = cup_hexahedra([0.02, 0.04], 0.01, 8, 12, 1).unwrap().split_into_simplices();
        let inner: Vec<[u32; 3]> = cup
            .group("inner")
            .unwrap()
            .triangles
            .iter()
            .map(|&t| cup.triangles[t as usize])
            .collect();
        let exact = 2.0 / 3.0 * std::f64::consts::PI * 0.02 * 0.02 * 0.04;
        let cavity = enclosed_volume(&cup.points, &inner);
        assert!((cavity / exact - 1.0).abs() < 0.02, "{cavity} beside {exact}");
        assert_eq!(enclosed_volume(&[], &[]), 0.0);
    }
}
