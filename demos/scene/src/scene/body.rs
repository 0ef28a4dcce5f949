//! A body: its material, membrane and place.

use super::fibres::{AxesEntry, FibreEntry};
use super::shape::{Generate, Rotation};
use serde::de::{Deserializer, Error};
use serde::ser::Serializer;
use serde::{Deserialize, Serialize};
use sinew::identify::ElementMethod;
use sinew::models::body::sheet::{MembraneModel, PlaneState, RestCurvature};
use sinew::models::body::{Evaluation, Integration, MassRule, Model, VolumeRule};
use std::path::PathBuf;

/// A body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyEntry {
    /// Name, unique in the scene.
    pub name: String,
    /// Mesh file, relative to the scene file; either this or `generate`.
    pub mesh: Option<PathBuf>,
    /// Generated shape; either this or `mesh`.
    pub generate: Option<Generate>,
    /// Factor on the coordinates (for a mesh in millimetres: 0.001); default 1.
    pub scale: Option<f64>,
    /// Rotation about the origin, after scaling.
    pub rotate: Option<Rotation>,
    /// Translation (m), after scaling and rotating.
    pub translate: Option<[f64; 3]>,
    /// Puts a vertex in the middle of every edge of linear tetrahedra: ten-node tetrahedra, for accuracy in bending and near
    /// incompressibility (with `volume = "clusters"`).
    #[serde(default)]
    pub second_order: bool,
    /// Edge (m) of the cubes of a lattice that stands in for the mesh, a closed surface: hexahedra, each with the share of
    /// stiffness and density that the surface fills, with reduced integration where `integration` does not say otherwise. The
    /// body carries the surface along.
    pub lattice: Option<f64>,
    /// Surface file, in the frame and unit of `mesh`, that the body carries along: it is in the frames and in pictures.
    pub surface: Option<PathBuf>,
    /// Material.
    pub material: MaterialEntry,
    /// Energy; names are those of [`Model`].
    #[serde(default)]
    pub model: Model,
    /// How the energy is summed: `"fused"` (default), or `"pooled"` for the first two.
    #[serde(default)]
    pub evaluation: Evaluation,
    /// What keeps its volume: `"elements"` (default), or `"clusters"` for nearly incompressible tissue of `"svk_volume"` or
    /// `"neo_hookean"`.
    #[serde(default)]
    pub volume: VolumeRule,
    /// How the energy of hexahedra is integrated: `"full"` over 2x2x2 points, or `"reduced"`, right in bending from two
    /// hexahedra across the body on. Without, `"reduced"` in a lattice whose model has it, `"full"` otherwise.
    pub integration: Option<Integration>,
    /// How spring constants of `"mass_spring"` are found: `"frobenius"`, `"block"`, `"two-norm"`,
    /// `"nonnegative"`, `"two-norm-nonnegative"`, `"van-gelder"`, `"lloyd"`, `"baudet"`, `"delingette"` or `"uniform"`;
    /// without, `"delingette"` for tetrahedra and `"frobenius"` for hexahedra.
    pub element_method: Option<SpringMethod>,
    /// Constant (N/m) of every spring with `"uniform"`.
    pub spring_constant: Option<f64>,
    /// Springs of a hexahedron with `"uniform"`: 28, all pairs (default), or 16, its edges and diagonals in space.
    pub hexahedron_springs: Option<u32>,
    /// File of springs (JSON, what `sinew fit --out` writes) for `"mass_spring"`, relative to the scene file, in
    /// place of `element_method`.
    pub springs: Option<PathBuf>,
    /// How the mass is shared out among the vertices: `"volume"` (default), `"nodal"` or `"equal"`.
    pub masses: Option<MassRule>,
    /// Vertices kept for what cuts make of the body; without, as many as a few planes across it need where the scene cuts it.
    pub spare: Option<u32>,
    /// Stiffness of what holds wounds closed that a blade has not come to yet, in Young's moduli over the mean edge of the mesh; none
    /// without.
    #[serde(default)]
    pub glue: f64,
    /// Under how much tension it tears. Dynamic scenes.
    pub tear: Option<TearEntry>,
    /// Membrane on or instead of the solid.
    pub membrane: Option<MembraneEntry>,
    /// Families of fibres in the solid.
    #[serde(default)]
    pub fibres: Vec<FibreEntry>,
    /// Angles between them, volume and form.
    pub axes: Option<AxesEntry>,
}

/// When a body of linear tetrahedra tears.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TearEntry {
    /// Largest principal stress (Pa) that it bears, as a mean over a ball.
    pub strength: f64,
    /// Energy (J/m^2) that the end of a wound takes to go on; it goes on by its strength without.
    pub toughness: Option<f64>,
    /// Radius (m) of the ball; without, 1.2 mean edges, 1.5 with a toughness.
    pub radius: Option<f64>,
    /// Largest speed (m/s) of a tear; without, that of shear waves.
    pub max_speed: Option<f64>,
}

/// All that decides what the mesh of a body is: bodies of the same have the same mesh.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MeshSource {
    file: Option<PathBuf>,
    shape: Option<Generate>,
    scale: Option<f64>,
    rotate: Option<Rotation>,
    translate: Option<[f64; 3]>,
    second_order: bool,
    lattice: Option<f64>,
    surface: Option<PathBuf>,
}

impl BodyEntry {
    /// How its hexahedra are integrated.
    pub(crate) fn integration(&self) -> Integration {
        let lattice =
            self.lattice.is_some() && self.model.serves_hexahedra_by(Integration::Reduced);
        self.integration.unwrap_or(if lattice { Integration::Reduced } else { Integration::Full })
    }

    /// What its mesh is made of.
    pub(super) fn mesh_source(&self) -> MeshSource {
        MeshSource {
            file: self.mesh.clone(),
            shape: self.generate.clone(),
            scale: self.scale,
            rotate: self.rotate.clone(),
            translate: self.translate,
            second_order: self.second_order,
            lattice: self.lattice,
            surface: self.surface.clone(),
        }
    }
}

/// How the constants of springs are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpringMethod {
    /// From the material.
    Fitted(ElementMethod),
    /// The same by the name that the method had before.
    Renamed(ElementMethod),
    /// The scene gives one for all.
    Uniform,
}

impl SpringMethod {
    const UNIFORM: &'static str = "uniform";
    const NAMES: [&'static str; ElementMethod::ALL.len() + 1] = {
        let mut names = [Self::UNIFORM; ElementMethod::ALL.len() + 1];
        let mut i = 0;
        while i < ElementMethod::ALL.len() {
            names[i] = ElementMethod::ALL[i].name();
            i += 1;
        }
        names
    };
}

impl Serialize for SpringMethod {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(match self {
            Self::Fitted(method) | Self::Renamed(method) => method.name(),
            Self::Uniform => Self::UNIFORM,
        })
    }
}

impl<'de> Deserialize<'de> for SpringMethod {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        if name == Self::UNIFORM {
            return Ok(Self::Uniform);
        }
        match name.parse::<ElementMethod>() {
            Ok(method) if method.old_name() == Some(&name) => Ok(Self::Renamed(method)),
            Ok(method) => Ok(Self::Fitted(method)),
            Err(_) => Err(D::Error::unknown_variant(&name, &Self::NAMES)),
        }
    }
}

/// A membrane: triangles and quadrilaterals of the body's mesh with a thickness.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MembraneEntry {
    /// Thickness (m).
    pub thickness: f64,
    /// Group of triangles or quadrilaterals; this or `surface` in a body with solid elements, all of the mesh
    /// otherwise.
    pub group: Option<String>,
    /// The whole boundary of the solid.
    pub surface: Option<bool>,
    /// `"stress"` (default): thin, free to become thinner; `"strain"`: a slice of a long body.
    #[serde(default)]
    pub plane: PlaneState,
    /// As [`BodyEntry::element_method`], also `"van-gelder-full"`; without, `"delingette"` for triangles and
    /// `"frobenius"` for quadrilaterals.
    pub element_method: Option<SpringMethod>,
    /// As [`BodyEntry::spring_constant`].
    pub spring_constant: Option<f64>,
    /// Material; that of the body without it.
    pub material: Option<MaterialEntry>,
    /// Energy; names are those of [`MembraneModel`].
    #[serde(default)]
    pub model: MembraneModel,
    /// How the energy is summed: `"fused"` (default), or `"pooled"` for the first two.
    #[serde(default)]
    pub evaluation: Evaluation,
    /// Whether it resists bending, as a plate of its material.
    #[serde(default)]
    pub bending: bool,
    /// Thickness (m) of that plate; `thickness` without it.
    pub bending_thickness: Option<f64>,
    /// Its shape without moments: `"meshed"` (default) or `"flat"`.
    pub bending_rest: Option<RestCurvature>,
    /// Families of biquadratic fibres in its triangles.
    #[serde(default)]
    pub fibres: Vec<FibreEntry>,
}

/// A preset, single values, or a preset with some values replaced.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialEntry {
    /// Name of a tissue preset.
    pub preset: Option<String>,
    /// Young's modulus (Pa).
    pub young_modulus: Option<f64>,
    /// Poisson's ratio (-).
    pub poisson_ratio: Option<f64>,
    /// Density (kg/m^3).
    pub density: Option<f64>,
    /// Cell data of the mesh file with a Young's modulus (Pa) for every solid element, in place of `young_modulus`.
    pub young_modulus_field: Option<String>,
    /// Cell data with a Poisson's ratio (-) for every solid element.
    pub poisson_ratio_field: Option<String>,
    /// Cell data with a density (kg/m^3) for every solid element.
    pub density_field: Option<String>,
    /// Cell data with the share of every solid element that is filled, above 0 and at most 1: it multiplies stiffness and
    /// density. `sinew mesh lattice` writes it as `filled`.
    pub filled_field: Option<String>,
}
