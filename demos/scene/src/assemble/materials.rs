//! Materials, one for a body or one for every element.

use crate::error::{SceneError, SceneProblem};
use crate::scene::{Key, MaterialEntry};
use crate::text::{pressure, short};
use serde::Serialize;
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

/// What a material is of.
#[derive(Clone, Copy)]
pub(super) struct MaterialUse<'a> {
    /// A thin sheet, free to become thinner.
    pub thin: bool,
    /// What keeps its volume: presets of solids that do not lock are nearly incompressible.
    pub volume: VolumeRule,
    /// The mesh whose solid elements may have constants of their own, if there are such elements.
    pub solid: Option<&'a Mesh>,
    /// A membrane takes it as well, which has no constants of its own.
    pub shared: bool,
}

/// A constant of a material: its keys, and how to read it.
struct Constant {
    name: &'static str,
    value: fn(&MaterialEntry) -> Option<f64>,
    field: fn(&MaterialEntry) -> &Option<String>,
    of: fn(&YoungPoisson) -> f64,
    /// Stands for it where the field that gives it is refused later, with its own words.
    any: f64,
}

static CONSTANTS: [Constant; 3] = [
    Constant {
        name: "young_modulus",
        value: |entry| entry.young_modulus,
        field: |entry| &entry.young_modulus_field,
        of: |m| m.young_modulus,
        any: 1e4,
    },
    Constant {
        name: "poisson_ratio",
        value: |entry| entry.poisson_ratio,
        field: |entry| &entry.poisson_ratio_field,
        of: |m| m.poisson_ratio,
        any: 0.3,
    },
    Constant {
        name: "density",
        value: |entry| entry.density,
        field: |entry| &entry.density_field,
        of: |m| m.density,
        any: 1e3,
    },
];

/// The material of an entry. A constant that a field gives to every element is the mean of the field.
pub(super) fn material(
    key: &Key,
    entry: &MaterialEntry,
    of: MaterialUse,
) -> Result<YoungPoisson, SceneError> {
    let error = |name: &str, source: MaterialError| key.at(name).error(source);
    let base = match &entry.preset {
        Some(name) => {
            let preset = preset(name).map_err(|source| error("preset", source))?;
            Some(match of.volume {
                VolumeRule::Clusters => preset.nearly_incompressible(),
                VolumeRule::Elements => preset.material,
            })
        }
        None => None,
    };
    let mut values = [0.0; 3];
    for (constant, own) in CONSTANTS.iter().zip(&mut values) {
        let (name, given) = (constant.name, (constant.value)(entry));
        if let Some(array) = (constant.field)(entry) {
            let Some(mesh) = of.solid else {
                let found = "there are no solid elements that it could be of";
                let remedy = format!("give `{name}` instead");
                return Err(key.at(format!("{name}_field")).value(found, remedy));
            };
            if !of.shared {
                if given.is_some() {
                    let found = format!("`{name}_field` gives it for every element");
                    let remedy = "leave it out: it would have no effect";
                    return Err(key.at(name).value(found, remedy));
                }
                *own = field_mean(mesh, array, constant).unwrap_or(constant.any);
                continue;
            }
        }
        *own = given.or(base.as_ref().map(constant.of)).ok_or_else(|| {
            let remedy = match (constant.field)(entry) {
                Some(_) => "the membrane takes it: give it, or the membrane a material of its own",
                None => "give young_modulus, poisson_ratio and density, or a preset",
            };
            key.at(name).missing(format!("key `{name}`"), remedy)
        })?;
    }
    let [young_modulus, poisson_ratio, density] = values;
    let material = YoungPoisson { young_modulus, poisson_ratio, density };
    let valid = if of.thin { material.validate_sheet() } else { material.validate() };
    valid.map_err(|source| error(material_key(&source), source))?;
    Ok(material)
}

/// Mean of a field over the elements; `None` where it is no field of a material.
fn field_mean(mesh: &Mesh, array: &str, constant: &Constant) -> Option<f64> {
    let values = solid_values(mesh, array)?;
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let mut material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1e3 };
    match constant.name {
        "young_modulus" => material.young_modulus = mean,
        "poisson_ratio" => material.poisson_ratio = mean,
        _ => material.density = mean,
    }
    material.validate().is_ok().then_some(mean)
}

/// Values of the tetrahedra, then of the hexahedra.
fn solid_values(mesh: &Mesh, array: &str) -> Option<Vec<f64>> {
    let data = mesh.data(array)?;
    Some([&data.values.tetrahedra[..], &data.values.hexahedra[..]].concat())
}

/// Least and greatest value of every constant that a field of the mesh gives to the elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MaterialRanges {
    /// Young's modulus (Pa).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub young_modulus: Option<[f64; 2]>,
    /// Poisson's ratio (-).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poisson_ratio: Option<[f64; 2]>,
    /// Density (kg/m^3).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<[f64; 2]>,
}

impl MaterialRanges {
    /// Those of an entry, with the mesh that holds its fields.
    pub(crate) fn new(entry: &MaterialEntry, mesh: &Mesh) -> Self {
        let [young_modulus, poisson_ratio, density] = CONSTANTS.each_ref().map(|constant| {
            let values = solid_values(mesh, (constant.field)(entry).as_ref()?)?;
            let ends = [f64::INFINITY, f64::NEG_INFINITY];
            Some(values.iter().fold(ends, |[low, high], &x| [low.min(x), high.max(x)]))
        });
        Self { young_modulus, poisson_ratio, density }
    }

    /// A material in words; constants that vary by their ends.
    pub(crate) fn words(&self, material: &YoungPoisson) -> String {
        let own = |range: Option<[f64; 2]>, value: f64, unit: fn(f64) -> String| match range {
            Some([low, high]) if low < high => format!("{} to {}", unit(low), unit(high)),
            Some([one, _]) => unit(one),
            None => unit(value),
        };
        format!(
            "E = {}, nu = {}, {} kg/m^3",
            own(self.young_modulus, material.young_modulus, pressure),
            own(self.poisson_ratio, material.poisson_ratio, |x| x.to_string()),
            own(self.density, material.density, short),
        )
    }
}

/// Values of the solid elements from the cell data of that name, when a scene names one.
pub(super) fn cell_data(
    key: &Key,
    name: Option<&String>,
    mesh: &Mesh,
) -> Result<Option<Vec<f64>>, SceneError> {
    let Some(name) = name else { return Ok(None) };
    match solid_values(mesh, name) {
        Some(values) => Ok(Some(values)),
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
        FieldError::Filled { .. } | FieldError::FilledPlace { .. } => "filled",
        _ => "",
    };
    let array = match quantity {
        "young_modulus" => &entry.young_modulus_field,
        "poisson_ratio" => &entry.poisson_ratio_field,
        "filled" => &entry.filled_field,
        _ => &entry.density_field,
    };
    key.at(format!("{quantity}_field")).error(SceneProblem::Field {
        mesh: mesh.source.clone(),
        array: array.clone().unwrap_or_default(),
        source: Box::new(source),
    })
}
