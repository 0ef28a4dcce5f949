//! Materials, one for a body or one for every element.

use crate::error::{SceneError, SceneProblem};
use crate::scene::{Key, MaterialEntry};
use sinew::engine::mesh::Mesh;
use sinew::models::body::VolumeRule;
use sinew::models::material::field::FieldError;
use sinew::models::material::{MaterialError, YoungPoisson, preset};

/// Key of the value that is wrong.
fn material_key(error: &MaterialError) -> &'static str {
    match error {
        MaterialError::NonFinite { quantity, .. } | MaterialError::BeyondAll { quantity, .. } => {
            match &quantity[..1] {
                "Y" => "young_modulus",
                "d" => "density",
                _ => "poisson_ratio",
            }
        }
        MaterialError::YoungModulus { .. } => "young_modulus",
        MaterialError::Density { .. } => "density",
        MaterialError::UnknownPreset { .. } => "preset",
        _ => "poisson_ratio",
    }
}

/// The material of an entry, of a thin sheet or of a solid that keeps its volume so; presets of solids that do not lock are
/// nearly incompressible.
pub(super) fn material(
    key: &Key,
    entry: &MaterialEntry,
    thin: bool,
    volume: VolumeRule,
) -> Result<YoungPoisson, SceneError> {
    let error = |name: &str, source: MaterialError| key.at(name).error(source);
    let base = match &entry.preset {
        Some(name) => {
            let preset = preset(name).map_err(|source| error("preset", source))?;
            Some(match volume {
                VolumeRule::Clusters => preset.nearly_incompressible(),
                VolumeRule::Elements => preset.material,
            })
        }
        None => None,
    };
    let pick = |name: &str, value: Option<f64>, of: fn(YoungPoisson) -> f64| {
        value.or(base.map(of)).ok_or_else(|| {
            let remedy = "give young_modulus, poisson_ratio and density, or a preset";
            key.at(name).missing(format!("key `{name}`"), remedy)
        })
    };
    let material = YoungPoisson {
        young_modulus: pick("young_modulus", entry.young_modulus, |m| m.young_modulus)?,
        poisson_ratio: pick("poisson_ratio", entry.poisson_ratio, |m| m.poisson_ratio)?,
        density: pick("density", entry.density, |m| m.density)?,
    };
    let valid = if thin { material.validate_sheet() } else { material.validate() };
    valid.map_err(|source| error(material_key(&source), source))?;
    Ok(material)
}

/// Values of the solid elements from the cell data of that name, when a scene names one.
pub(super) fn cell_data(
    key: &Key,
    name: Option<&String>,
    mesh: &Mesh,
) -> Result<Option<Vec<f64>>, SceneError> {
    let Some(name) = name else { return Ok(None) };
    match mesh.data(name) {
        Some(data) => Ok(Some([&data.values.tetrahedra[..], &data.values.hexahedra[..]].concat())),
        None if mesh.cell_data.is_empty() => Err(key.value(
            format!("there is no cell data `{name}` in {}", mesh.source),
            "use a mesh file with cell data (VTU, VTK or Gmsh's $ElementData)",
        )),
        None => {
            let known = mesh.cell_data.iter().map(|data| data.name.as_str());
            Err(key.unknown("cell data", name, known))
        }
    }
}

/// A value of a field that cannot be used, with the array that it stands in.
pub(super) fn field_error(
    key: &Key,
    entry: &MaterialEntry,
    mesh: &Mesh,
    source: FieldError,
) -> SceneError {
    let quantity = match &source {
        FieldError::Tetrahedron { source, .. } | FieldError::Hexahedron { source, .. } => {
            material_key(source)
        }
        _ => "",
    };
    let array = match quantity {
        "young_modulus" => &entry.young_modulus_field,
        "poisson_ratio" => &entry.poisson_ratio_field,
        _ => &entry.density_field,
    };
    key.at(format!("{quantity}_field")).error(SceneProblem::Field {
        mesh: mesh.source.clone(),
        array: array.clone().unwrap_or_default(),
        source: Box::new(source),
    })
}
