//! What a scene file may hold. Every key is described in `demos/scenes/README.md`; an unknown key is
//! an error with a hint. SI units throughout, angles in degrees.

use crate::axes::{AxesEntry, FibreEntry};
use crate::error::{Place, SceneError, hint};
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::{Mesh, MeshError};
use sinew::identify::ElementMethod;
use sinew::models::body::{Evaluation, Model};
use sinew::models::resection::MassPolicy;
use sinew::models::sheet::{MembraneModel, PlaneState};
use sinew::simulation::{Backend, Precision};
use sinew::solvers::settings::SolverSettings;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name for reports and files.
    pub name: String,
    /// One or two sentences: what happens and what to look at.
    #[serde(default)]
    pub description: String,
    /// Motion over time, or one equilibrium.
    #[serde(default)]
    pub mode: Mode,
    /// Acceleration of gravity (m/s^2); default `[0, 0, -9.81]`.
    #[serde(default = "default_gravity")]
    pub gravity: [f64; 3],
    /// Step length (s); dynamic scenes.
    pub dt: Option<f64>,
    /// Simulated time (s); dynamic scenes.
    pub duration: Option<f64>,
    /// Parts in which gravity, loads and motions are applied; static scenes, default 1.
    pub load_steps: Option<u32>,
    /// Number type, `"f64"` (default) or `"f32"`.
    #[serde(default)]
    pub precision: PrecisionName,
    /// Where steps are computed, `"cpu"` (default) or `"gpu"`.
    #[serde(default)]
    pub backend: BackendName,
    /// Threads; 0 (default) means one per core. Results do not depend on it.
    #[serde(default)]
    pub threads: usize,
    /// Integrator, tolerances and damping.
    #[serde(default)]
    pub solver: SolverSettings,
    /// Bodies.
    #[serde(default, rename = "body")]
    pub bodies: Vec<Body>,
    /// Held and moved vertices.
    #[serde(default, rename = "constraint")]
    pub constraints: Vec<ConstraintEntry>,
    /// Forces.
    #[serde(default, rename = "load")]
    pub loads: Vec<LoadEntry>,
    /// Elements that are removed on the way.
    #[serde(default, rename = "resection")]
    pub resections: Vec<ResectionEntry>,
    /// Follower pressures.
    #[serde(default, rename = "pressure")]
    pub pressures: Vec<PressureEntry>,
    /// Columns of the CSV file.
    #[serde(default, rename = "probe")]
    pub probes: Vec<Probe>,
    /// What is written, and how often.
    #[serde(default)]
    pub output: Output,
}

fn default_gravity() -> [f64; 3] {
    [0.0, 0.0, -9.81]
}

/// Kind of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Motion over time.
    #[default]
    Dynamic,
    /// Equilibrium under the full loads.
    Static,
}

/// Number type of the state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrecisionName {
    /// 64-bit.
    #[default]
    F64,
    /// 32-bit.
    F32,
}

/// Where steps are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackendName {
    /// The processor.
    #[default]
    Cpu,
    /// A graphics processor; needs the cargo feature `gpu`.
    Gpu,
}

impl From<BackendName> for Backend {
    fn from(name: BackendName) -> Self {
        match name {
            BackendName::Cpu => Self::Cpu,
            BackendName::Gpu => Self::Gpu,
        }
    }
}

impl From<PrecisionName> for Precision {
    fn from(name: PrecisionName) -> Self {
        match name {
            PrecisionName::F64 => Self::F64,
            PrecisionName::F32 => Self::F32,
        }
    }
}

/// A body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
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
    /// Material.
    pub material: Material,
    /// Energy: `"svk_comp"` (default), `"svk"`, `"tqs"`, `"mass_spring"`, `"linear"`,
    /// `"corotational_warped"`, `"corotational"`, `"svk_fem"`, `"neo_hookean"` or `"axes"` (nothing but the axes).
    #[serde(default)]
    pub model: Model,
    /// How the energy is summed: `"fused"` (default), or `"pooled"` for the first two.
    #[serde(default)]
    pub evaluation: Evaluation,
    /// How spring constants of `"mass_spring"` are found: `"frobenius"`, `"block"`, `"two-norm"`,
    /// `"nonnegative"`, `"two-norm-nonnegative"`, `"van-gelder"`, `"lloyd"`, `"baudet"` or `"paper-a"`; without,
    /// `"paper-a"` for tetrahedra and `"frobenius"` for hexahedra.
    pub element_method: Option<ElementMethod>,
    /// Membrane on or instead of the solid.
    pub membrane: Option<Membrane>,
    /// Families of fibres in the solid.
    #[serde(default)]
    pub fibres: Vec<FibreEntry>,
    /// Angles between them, volume and form.
    pub axes: Option<AxesEntry>,
}

/// A membrane: triangles and quadrilaterals of the body's mesh with a thickness.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Membrane {
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
    /// As [`Body::element_method`], also `"van-gelder-full"`; without, `"paper-a"` for triangles and
    /// `"frobenius"` for quadrilaterals.
    pub element_method: Option<ElementMethod>,
    /// Material; that of the body without it.
    pub material: Option<Material>,
    /// Energy: `"trbs"` (default), `"trbs_comp"`, `"trqs"`, `"mass_spring"`, `"linear"` or
    /// `"corotational"`.
    #[serde(default)]
    pub model: MembraneModel,
    /// How the energy is summed: `"fused"` (default), or `"pooled"` for the first two.
    #[serde(default)]
    pub evaluation: Evaluation,
}

/// A generated shape; exactly one key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generate {
    /// A box with one corner at the origin; groups `x0`, `x1`, `y0`, `y1`, `z0`, `z1`, `body`.
    #[serde(rename = "box")]
    pub cuboid: Option<BoxShape>,
    /// A cylinder along x from the origin; groups `x0`, `x1`, `side`, `body`.
    pub cylinder: Option<CylinderShape>,
    /// A ball around the origin; groups `surface`, `body`.
    pub sphere: Option<SphereShape>,
    /// A rectangle at z = 0 with one corner at the origin; groups `x0`, `x1`, `y0`, `y1`, `body`.
    pub sheet: Option<SheetShape>,
    /// A flat or solid tensile specimen along x, its middle at the origin; groups as those of a sheet or box,
    /// and `grip0`, `grip1` (the wide ends).
    pub specimen: Option<SpecimenShape>,
    /// A disc of triangles at z = 0 around the origin; groups `rim`, `body`.
    pub disc: Option<DiscShape>,
    /// A hollow sphere of triangles around the origin; group `body`.
    pub balloon: Option<BalloonShape>,
    /// Half of a thick-walled ellipsoid, open at z = 0, its tip below; groups `inner`, `outer`, `base`, `body`.
    pub cup: Option<CupShape>,
}

/// Elements of which a solid is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SolidCells {
    /// Tetrahedra (default).
    #[default]
    Tetrahedra,
    /// Hexahedra.
    Hexahedra,
    /// Tetrahedra without a preferred direction: inner vertices moved at random by 0.15 of the way to the
    /// nearest neighbour, cells cut at random.
    Irregular,
}

/// Elements of which a sheet is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SheetCells {
    /// Triangles (default).
    #[default]
    Triangles,
    /// Quadrilaterals.
    Quads,
}

/// A rectangle of `2 nx ny` triangles or `nx ny` quadrilaterals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SheetShape {
    /// Edge lengths (m).
    pub size: [f64; 2],
    /// Cells along each axis.
    pub cells: [usize; 2],
    /// `"triangles"` (default) or `"quads"`.
    #[serde(default)]
    pub elements: SheetCells,
}

/// The tensile specimen of Natsupakpong & Cavusoglu 2010: 16 widths long, grips three widths wide.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpecimenShape {
    /// Width of the straight part (m).
    pub width: f64,
    /// Cells along, across and (of a solid) through.
    pub cells: Vec<usize>,
    /// Thickness (m) of a solid; a sheet without.
    pub thickness: Option<f64>,
    /// Of a sheet: `"triangles"` (default) or `"quads"`.
    pub sheet: Option<SheetCells>,
    /// Of a solid: `"tetrahedra"` (default) or `"hexahedra"`.
    pub solid: Option<SolidCells>,
}

/// A disc of `6 rings^2` triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscShape {
    /// Radius (m).
    pub radius: f64,
    /// Rings around the centre.
    pub rings: usize,
}

/// A sphere of `20 cuts^2` triangles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalloonShape {
    /// Radius (m).
    pub radius: f64,
    /// Parts into which the edges of an icosahedron are cut.
    pub cuts: usize,
}

/// A box of `6 nx ny nz` tetrahedra or `nx ny nz` hexahedra.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxShape {
    /// Edge lengths (m).
    pub size: [f64; 3],
    /// Cells along each axis.
    pub cells: [usize; 3],
    /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
    #[serde(default)]
    pub elements: SolidCells,
    /// Which of the irregular meshes; default 0.
    pub seed: Option<u64>,
}

/// A cylinder of `18 rings^2 layers` tetrahedra, or of hexahedra: `rings` rings around a square of `2 rings`
/// cells along each side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CylinderShape {
    /// Radius (m).
    pub radius: f64,
    /// Length (m).
    pub length: f64,
    /// Rings around the axis.
    pub rings: usize,
    /// Layers along the axis.
    pub layers: usize,
    /// `"tetrahedra"` (default) or `"hexahedra"`.
    #[serde(default)]
    pub elements: SolidCells,
}

/// A ball of `20 shells^3` tetrahedra.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereShape {
    /// Radius (m).
    pub radius: f64,
    /// Shells from centre to surface.
    pub shells: usize,
}

/// A cup of `(core^2 + 4 core rings) layers` hexahedra, or six times as many tetrahedra.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CupShape {
    /// Radius (m) of the opening.
    pub radius: f64,
    /// Depth (m) of the cavity.
    pub depth: f64,
    /// Thickness (m) of the wall at opening and tip.
    pub wall: f64,
    /// Cells along each side of the square at the tip; even for helix rules.
    pub core: usize,
    /// Rings of `4 core` cells from there to the opening.
    pub rings: usize,
    /// Layers through the wall.
    pub layers: usize,
    /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
    #[serde(default)]
    pub elements: SolidCells,
}

/// A rotation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// Axis, of any length.
    pub axis: [f64; 3],
    /// Angle (degrees).
    pub degrees: f64,
}

/// A preset, single values, or a preset with some values replaced.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Name of a tissue preset.
    pub preset: Option<String>,
    /// Young's modulus (Pa).
    pub young_modulus: Option<f64>,
    /// Poisson's ratio (-).
    pub poisson_ratio: Option<f64>,
    /// Density (kg/m^3).
    pub density: Option<f64>,
    /// Cell data of the mesh file with a Young's modulus (Pa) for every solid element.
    pub young_modulus_field: Option<String>,
    /// Cell data with a Poisson's ratio (-) for every solid element.
    pub poisson_ratio_field: Option<String>,
    /// Cell data with a density (kg/m^3) for every solid element.
    pub density_field: Option<String>,
}

/// Vertices of a body; exactly one key. Boxes and spheres are those of the rest shape.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Selection {
    /// Name of a group of the mesh.
    pub group: Option<String>,
    /// Vertex indices, counted from 0.
    pub vertices: Option<Vec<u32>>,
    /// All vertices in a box.
    #[serde(rename = "box")]
    pub cuboid: Option<BoxRegion>,
    /// All vertices in a sphere.
    pub sphere: Option<SphereRegion>,
    /// All vertices of the body.
    pub all: Option<bool>,
}

/// A box with its faces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxRegion {
    /// Lowest corner (m).
    pub min: [f64; 3],
    /// Highest corner (m).
    pub max: [f64; 3],
}

/// A sphere with its surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereRegion {
    /// Centre (m).
    pub centre: [f64; 3],
    /// Radius (m).
    pub radius: f64,
}

/// Vertices that are held or moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ConstraintEntry {
    /// Name, unique among constraints and loads.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices.
    pub select: Selection,
    /// Held axes, such as `"xyz"` (default) or `"z"`.
    pub axes: Option<String>,
    /// Where they go; they stay where they are without it.
    pub motion: Option<MotionEntry>,
    /// Factor on the motion over time; 1 without it. Dynamic scenes.
    pub curve: Option<CurveEntry>,
    /// Time (s) from which they are held. Dynamic scenes.
    pub from: Option<f64>,
    /// Time (s) after which they are free again. Dynamic scenes.
    pub until: Option<f64>,
}

/// A motion; exactly one key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionEntry {
    /// Translation (m).
    pub translate: Option<[f64; 3]>,
    /// Rotation about an axis.
    pub rotate: Option<RotationAbout>,
}

/// A rotation about an axis anywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotationAbout {
    /// Point on the axis (m).
    pub centre: [f64; 3],
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// Angle (degrees).
    pub degrees: f64,
}

/// A force on vertices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadEntry {
    /// Name, unique among constraints and loads.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices.
    pub select: Selection,
    /// Total force (N), shared equally by the vertices.
    pub force: [f64; 3],
    /// Factor over time; 1 without it. Dynamic scenes.
    pub curve: Option<CurveEntry>,
}

/// A pressure that follows the deformed surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PressureEntry {
    /// Name, unique among pressures.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which triangles.
    pub on: Faces,
    /// Pressure (Pa); negative for suction.
    pub pressure: f64,
    /// Factor over time; 1 without it. Dynamic scenes.
    pub curve: Option<CurveEntry>,
}

/// Triangles of a body; exactly one key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Faces {
    /// A group of triangles: on faces of tetrahedra the pressure pushes into the body, on other
    /// membrane triangles along their normal.
    pub group: Option<String>,
    /// The whole boundary of the tetrahedra, pushed inward.
    pub surface: Option<bool>,
    /// All triangles of the membrane, pushed along their normals.
    pub membrane: Option<bool>,
}

/// A factor over time; exactly one key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurveEntry {
    /// Constant factor.
    pub hold: Option<f64>,
    /// 0 until the first time (s), 1 from the second, linear between.
    pub ramp: Option<[f64; 2]>,
    /// 1 until the first time (s), 0 from the second, linear between.
    pub release: Option<[f64; 2]>,
    /// Times (s) of start, full, release and end: 0, linear to 1, held at 1, linear back to 0.
    pub pulse: Option<[f64; 4]>,
    /// `[time (s), factor]` pairs, linear between them, constant outside.
    pub points: Option<Vec<[f64; 2]>>,
    /// `sin(2 pi frequency t + phase)`.
    pub sine: Option<Sine>,
}

/// A sine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sine {
    /// Frequency (Hz).
    pub frequency: f64,
    /// Phase (degrees); default 0.
    #[serde(default)]
    pub degrees: f64,
}

/// Elements that are removed while the scene runs; exactly one of `tetrahedra`, `triangles`, `sphere`,
/// `tool`, `strain` and `stress`. Dynamic scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResectionEntry {
    /// Name, unique among resections.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Tetrahedra by their indices, counted from 0; removed once.
    pub tetrahedra: Option<Vec<u32>>,
    /// Hexahedra likewise.
    pub hexahedra: Option<Vec<u32>>,
    /// Membrane triangles by their indices in the membrane, counted from 0; removed once.
    pub triangles: Option<Vec<u32>>,
    /// Membrane quadrilaterals likewise.
    pub quads: Option<Vec<u32>>,
    /// Those whose barycentre is in a sphere, at every step.
    pub sphere: Option<SphereRegion>,
    /// Those whose barycentre a moving ball passes over.
    pub tool: Option<ToolEntry>,
    /// Those whose largest principal Green strain (-) is above this, at every step.
    pub strain: Option<f64>,
    /// Those whose von Mises stress (Pa) is above this, at every step.
    pub stress: Option<f64>,
    /// What becomes of their mass: `"recompute"` (default) or `"keep"`.
    #[serde(default)]
    pub mass: MassPolicy,
    /// Time (s) from which it acts; default 0.
    pub from: Option<f64>,
    /// Time (s) until which it acts; default the end.
    pub until: Option<f64>,
}

/// A ball that moves along a path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolEntry {
    /// Radius (m).
    pub radius: f64,
    /// `[time (s), x, y, z (m)]`, linear between; it acts from the first to the last.
    pub path: Vec<[f64; 4]>,
}

/// Columns of the CSV file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Probe {
    /// Name, unique among probes; the columns start with it.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices; the whole body without it.
    pub select: Option<Selection>,
    /// Name of a constraint, for `reaction`.
    pub constraint: Option<String>,
    /// What to record.
    pub record: Vec<Quantity>,
}

/// What a probe can record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Mean displacement of the vertices (m), three columns.
    MeanDisplacement,
    /// Largest length of a displacement (m).
    MaxDisplacement,
    /// Mean velocity of the vertices (m/s), three columns.
    MeanVelocity,
    /// Force (N) of the constraint on the body, three columns; zero while it does not act.
    Reaction,
    /// Elastic energy of the whole scene (J).
    ElasticEnergy,
    /// Kinetic energy of the whole scene (J).
    KineticEnergy,
    /// Smallest volume ratio J of the body.
    MinJ,
    /// Smallest area ratio of the membrane of the body.
    MinAreaRatio,
    /// Volume of the elements of the body that are left (m^3).
    Volume,
    /// Volume (m^3) between the faces of the selected group and their rim: what a cavity holds.
    EnclosedVolume,
}

impl Quantity {
    /// Name and unit of its columns, and whether there are three of them.
    pub fn column(self) -> (&'static str, &'static str, bool) {
        match self {
            Self::MeanDisplacement => ("mean_displacement", "m", true),
            Self::MaxDisplacement => ("max_displacement", "m", false),
            Self::MeanVelocity => ("mean_velocity", "m/s", true),
            Self::Reaction => ("reaction", "N", true),
            Self::ElasticEnergy => ("elastic_energy", "J", false),
            Self::KineticEnergy => ("kinetic_energy", "J", false),
            Self::MinJ => ("min_J", "-", false),
            Self::MinAreaRatio => ("min_area_ratio", "-", false),
            Self::Volume => ("volume", "m^3", false),
            Self::EnclosedVolume => ("enclosed_volume", "m^3", false),
        }
    }
}

/// What is written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// VTU frames per simulated second; default 30. Either this or `every`.
    pub frames_per_second: Option<f64>,
    /// Steps from one VTU frame to the next. Either this or `frames_per_second`.
    pub every: Option<u64>,
    /// Steps from one row of the CSV file to the next; default 1.
    pub probe_every: Option<u64>,
}

/// Keys of a document and where they stand.
#[derive(Clone, Debug, Default)]
struct KeySpans {
    spans: HashMap<String, KeySpan>,
}

#[derive(Clone, Debug)]
struct KeySpan {
    line: usize,
    key: Range<usize>,
    value: Range<usize>,
}

impl KeySpans {
    fn new(text: &str) -> Self {
        let mut keys = Self::default();
        if let Ok(document) = toml::de::DeTable::parse(text) {
            keys.table(text, "", document.get_ref());
        }
        keys
    }

    fn table(&mut self, text: &str, path: &str, table: &toml::de::DeTable<'_>) {
        for (key, value) in table {
            let name = key.get_ref();
            let path = if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
            self.insert(text, &path, key.span(), value.span());
            match value.get_ref() {
                toml::de::DeValue::Table(inner) => self.table(text, &path, inner),
                toml::de::DeValue::Array(entries) => {
                    for (i, entry) in entries.iter().enumerate() {
                        let path = format!("{path}[{i}]");
                        self.insert(text, &path, entry.span(), entry.span());
                        if let toml::de::DeValue::Table(inner) = entry.get_ref() {
                            self.table(text, &path, inner);
                        }
                    }
                }
                _ => {}
            }
        }
    }

    fn insert(&mut self, text: &str, path: &str, key: Range<usize>, value: Range<usize>) {
        let line = line_of(text, key.start);
        self.spans.insert(path.to_string(), KeySpan { line, key, value });
    }

    /// Line of a key, or of the nearest key around it that exists.
    fn line(&self, key: &str) -> Option<usize> {
        let mut key = key;
        loop {
            if let Some(span) = self.spans.get(key) {
                return Some(span.line);
            }
            key = &key[..key.rfind(['.', '['])?];
        }
    }

    /// What an error of the parser is about: the table of a key, or the innermost value around it.
    fn path_of(&self, error: &Range<usize>) -> String {
        if let Some((path, _)) = self.spans.iter().find(|(_, span)| span.key == *error)
            && !path.ends_with(']')
        {
            return path.rsplit_once('.').map_or("", |(table, _)| table).to_string();
        }
        let around =
            |span: &KeySpan| span.value.start <= error.start && error.end <= span.value.end;
        let values = self.spans.iter().filter(|(_, span)| around(span));
        // an array of one table has the span of the table: the longer path is the inner one
        let inner = values.min_by_key(|(path, span)| (span.value.len(), Reverse(path.len())));
        inner.map_or(String::new(), |(path, _)| path.clone())
    }
}

/// Line, counted from 1, of a byte offset.
fn line_of(text: &str, offset: usize) -> usize {
    let before = &text.as_bytes()[..offset.min(text.len())];
    before.iter().filter(|&&b| b == b'\n').count() + 1
}

/// A scene and where it came from.
#[derive(Clone, Debug)]
pub struct LoadedScene {
    /// The scene.
    pub scene: Scene,
    /// Its file.
    pub file: PathBuf,
    keys: KeySpans,
    files: Files,
}

/// How files that a scene names are read.
#[derive(Clone)]
struct Files(Arc<dyn Fn(&Path) -> std::io::Result<Vec<u8>> + Send + Sync>);

impl fmt::Debug for Files {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Files(..)")
    }
}

impl LoadedScene {
    /// Reads a scene file.
    ///
    /// # Errors
    /// When it cannot be read, is not TOML, has an unknown key or a value of the wrong type; the
    /// values themselves are checked by [`crate::build::build`].
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| SceneError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Reads a scene from text; mesh files are looked for beside `file`, which need not exist, or where
    /// [`LoadedScene::with_files`] says.
    ///
    /// # Errors
    /// As [`LoadedScene::read`].
    pub fn parse(text: &str, file: &Path) -> Result<Self, SceneError> {
        let keys = KeySpans::new(text);
        match toml::from_str(text) {
            Ok(scene) => {
                let files = Files(Arc::new(|path| std::fs::read(path)));
                Ok(Self { scene, file: file.into(), keys, files })
            }
            Err(error) => Err(parse_error(text, file, &keys, &error)),
        }
    }

    /// Takes the files that the scene names from `open` in place of the file system: memory, an archive, a
    /// network. It is asked for paths relative to the scene file's folder, as [`Mesh::read_with`] says.
    ///
    /// ```
    /// use sinew_demos::scene::LoadedScene;
    /// use std::io::{Error, ErrorKind};
    ///
    /// let text = r#"
    ///     name = "drop"
    ///     duration = 0.1
    ///     [[body]]
    ///     name = "tetrahedron"
    ///     mesh = "tetrahedron.vtk"
    ///     material = { preset = "liver" }
    /// "#;
    /// let mesh = b"# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n\
    ///     0 0 0  1 0 0  0 1 0  0 0 1\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n";
    /// let scene = LoadedScene::parse(text, "drop.toml".as_ref())?.with_files(|path| {
    ///     let known = path == "tetrahedron.vtk";
    ///     known.then(|| mesh.to_vec()).ok_or(Error::from(ErrorKind::NotFound))
    /// });
    /// let built = sinew_demos::build::build(&scene, &Default::default())?;
    /// assert_eq!(built.bodies[0].mesh.tetrahedra, [[0, 1, 2, 3]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn with_files(
        mut self,
        open: impl Fn(&Path) -> std::io::Result<Vec<u8>> + Send + Sync + 'static,
    ) -> Self {
        self.files = Files(Arc::new(open));
        self
    }

    /// Reads a mesh file named in the scene.
    ///
    /// # Errors
    /// As [`Mesh::read_with`].
    pub fn read_mesh(&self, path: &Path) -> Result<Mesh, MeshError> {
        Mesh::read_with(&self.resolve(path), &*self.files.0)
    }

    /// Place of a key.
    pub fn place(&self, key: impl Into<String>) -> Box<Place> {
        let key = key.into();
        Box::new(Place { file: self.file.clone(), line: self.keys.line(&key), key })
    }

    /// A file named in the scene, relative to the scene file.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.file.parent().unwrap_or(Path::new("")).join(path)
    }
}

/// The parser's message, with a hint when a name is unknown.
fn parse_error(text: &str, file: &Path, keys: &KeySpans, error: &toml::de::Error) -> SceneError {
    let message = error.message();
    let line = error.span().map(|span| line_of(text, span.start));
    let key = error.span().map_or(String::new(), |span| keys.path_of(&span));
    let place = Box::new(Place { file: file.into(), line, key });
    let quoted = |text: &str| -> Vec<String> {
        text.split('`').skip(1).step_by(2).map(str::to_owned).collect()
    };
    for (start, kind) in [("unknown field ", "key"), ("unknown variant ", "choice")] {
        if let Some(rest) = message.strip_prefix(start) {
            let names = quoted(rest);
            if let Some((name, known)) = names.split_first() {
                let hint = hint(kind, name, known.iter().map(String::as_str));
                return SceneError::Unknown { place, kind, name: name.clone(), hint };
            }
        }
    }
    if let Some(name) = message.strip_prefix("missing field ") {
        // the span is that of the table
        return SceneError::Missing {
            place,
            what: format!("key {name}"),
            remedy: "add it; see demos/scenes/README.md for what it holds".into(),
        };
    }
    let message = message
        .replace('\n', ", ")
        .replace("expected f64", "expected a number")
        .replace("expected a sequence", "expected a list");
    let whole = ["expected u32", "expected u64", "expected usize"];
    let message =
        whole.iter().fold(message, |m, name| m.replace(name, "expected a whole number from 0 up"));
    SceneError::Syntax { place, message }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_keys_are_found() {
        let text = "name = \"a\"\n\n[[body]]\nname = \"b\"\nmaterial = { preset = \"liver\" }\n\n\
                    [[body]]\nname = \"c\"\n[body.material]\npreset = \"fat\"\n";
        let scene = LoadedScene::parse(text, Path::new("a.toml")).unwrap();
        assert_eq!(scene.place("name").line, Some(1));
        assert_eq!(scene.place("body[0].material.preset").line, Some(5));
        assert_eq!(scene.place("body[1].material.preset").line, Some(10));
        assert_eq!(scene.place("body[0].material.density").line, Some(5));
        assert_eq!(scene.place("nothing").line, None);
    }
}
