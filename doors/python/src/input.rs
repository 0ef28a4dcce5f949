//! What comes from Python. Arrays are copied at once: nothing of the caller is looked at once the lock is released.

use crate::mesh::Mesh;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use sinew_embed::{
    AxesDescription, AxisAngle, AxisFamily, Curve, DQuat, DVec3, EmbedError, MembraneCells,
    MuscleSettings, Part, Pose, Result, Shape, Stiffness, ToolPose, YoungPoisson, choice,
    distance_field, membrane_cells,
};
use sinew_embed::{Code, Hinge, Points, SpringRule, spring_rule};
use std::borrow::Cow;

pub fn invalid(text: impl Into<String>) -> EmbedError {
    EmbedError::new(Code::Argument, text)
}

/// Numbers of a contiguous array of `float64`.
#[derive(Clone, Debug, Default)]
pub struct Floats(pub Vec<f64>);

impl<'py> FromPyObject<'_, 'py> for Floats {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array: PyReadonlyArray1<'py, f64> = object.extract()?;
        Ok(Self(array.as_slice()?.to_vec()))
    }
}

/// Indices of a contiguous array of `uint32`.
#[derive(Clone, Debug, Default)]
pub struct Indices(pub Vec<u32>);

impl<'py> FromPyObject<'_, 'py> for Indices {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array: PyReadonlyArray1<'py, u32> = object.extract()?;
        Ok(Self(array.as_slice()?.to_vec()))
    }
}

pub type Vec3 = [f64; 3];

pub fn vec3(v: Vec3) -> DVec3 {
    DVec3::from_array(v)
}

/// A factor over time.
#[derive(Clone, FromPyObject)]
pub enum CurveIn {
    #[pyo3(transparent)]
    Points(Vec<[f64; 2]>),
    Sine {
        frequency: f64,
        phase: f64,
    },
}

pub fn curve(own: Option<CurveIn>) -> Curve {
    match own {
        None => Curve::Constant,
        Some(CurveIn::Points(points)) => Curve::Points(points),
        Some(CurveIn::Sine { frequency, phase }) => Curve::Sine { frequency, phase },
    }
}

/// Young's modulus (Pa), Poisson's ratio and density (kg/m^3): one number, or one per element.
#[derive(FromPyObject)]
pub struct MaterialIn {
    young: Floats,
    poisson: Floats,
    density: Floats,
}

impl MaterialIn {
    pub fn uniform(&self) -> YoungPoisson {
        let first = |numbers: &Floats| numbers.0.first().copied().unwrap_or(f64::NAN);
        YoungPoisson {
            young_modulus: first(&self.young),
            poisson_ratio: first(&self.poisson),
            density: first(&self.density),
        }
    }

    /// Numbers by element, where there are more than one.
    pub fn arrays(&self) -> [Option<&[f64]>; 3] {
        [&self.young, &self.poisson, &self.density]
            .map(|numbers| (numbers.0.len() != 1).then_some(numbers.0.as_slice()))
    }
}

/// Which springs, if the model consists of them.
pub type SpringsIn = Option<(String, Option<f64>)>;

pub fn springs(own: &SpringsIn) -> Result<Option<SpringRule>> {
    own.as_ref().map(|(method, constant)| spring_rule(method, *constant)).transpose()
}

#[derive(FromPyObject)]
pub struct MembraneIn {
    pub cells: Option<String>,
    pub triangles: Indices,
    pub quads: Indices,
    pub thickness: f64,
    pub material: MaterialIn,
    pub plane: String,
    pub model: String,
    pub evaluation: String,
    pub springs: SpringsIn,
    pub bending: bool,
    pub bending_thickness: Option<f64>,
    pub bending_rest: String,
}

/// Triangles and quadrilaterals.
pub type Faces = (Vec<[u32; 3]>, Vec<[u32; 4]>);

impl MembraneIn {
    pub fn faces(&self, mesh: &sinew_embed::Mesh) -> Result<Faces> {
        let which = match self.cells.as_deref() {
            None => {
                let triangles = self.triangles.0.as_chunks::<3>().0.to_vec();
                return Ok((triangles, self.quads.0.as_chunks::<4>().0.to_vec()));
            }
            Some("all") => MembraneCells::All,
            Some("surface") => MembraneCells::Surface,
            Some(group) => MembraneCells::Group(group),
        };
        membrane_cells(mesh, which)
    }
}

#[derive(FromPyObject)]
pub struct MuscleIn {
    peak_stress: f64,
    optimal_stretch: f64,
    width: f64,
    stiffening: f64,
    shortening: f64,
    curve: Option<CurveIn>,
}

#[derive(FromPyObject)]
pub struct FamilyIn {
    name: String,
    directions: Floats,
    modulus: f64,
    form: String,
    viscosity: f64,
    share: Option<Floats>,
    muscle: Option<MuscleIn>,
}

#[derive(FromPyObject)]
pub struct AxesIn {
    families: Vec<FamilyIn>,
    angles: Vec<([usize; 2], f64)>,
    volume_modulus: f64,
}

impl AxesIn {
    pub fn description(self) -> Result<AxesDescription<'static>> {
        let muscle = |own: MuscleIn| MuscleSettings {
            peak_stress: own.peak_stress,
            optimal_stretch: own.optimal_stretch,
            width: own.width,
            stiffening: own.stiffening,
            shortening: own.shortening,
            curve: own.curve.map(|own| curve(Some(own))),
        };
        let family = |own: FamilyIn| {
            Ok(AxisFamily {
                name: Cow::Owned(own.name),
                directions: own.directions.0.as_chunks::<3>().0.iter().map(|&v| vec3(v)).collect(),
                modulus: own.modulus,
                form: choice("form of fibres", &own.form)?,
                viscosity: own.viscosity,
                share: own.share.map(|share| Cow::Owned(share.0)),
                muscle: own.muscle.map(muscle),
            })
        };
        let angle = |(families, modulus)| AxisAngle { families, modulus };
        Ok(AxesDescription {
            families: self.families.into_iter().map(family).collect::<Result<_>>()?,
            angles: self.angles.into_iter().map(angle).collect(),
            volume_modulus: self.volume_modulus,
        })
    }
}

#[derive(FromPyObject)]
pub struct BodyIn {
    pub material: MaterialIn,
    pub model: String,
    pub evaluation: String,
    pub volume: String,
    pub integration: Option<String>,
    pub masses: String,
    pub springs: SpringsIn,
    pub spare: usize,
    pub glue: f64,
    pub membrane: Option<MembraneIn>,
    pub axes: Option<AxesIn>,
}

/// A shape by its name, its numbers and its mesh.
#[derive(FromPyObject)]
pub struct PartIn {
    kind: String,
    numbers: Vec<f64>,
    mesh: Option<Py<Mesh>>,
    at: Vec3,
    rotation: [f64; 4],
    cavity: bool,
    jaw: f64,
}

impl PartIn {
    /// The part; fields of meshes take their time.
    pub fn part(&self) -> Result<Part> {
        let shape = match (self.kind.as_str(), self.numbers.as_slice(), &self.mesh) {
            ("sphere", &[radius], _) => Shape::Sphere { radius },
            ("capsule", &[half_length, radius], _) => Shape::Capsule { half_length, radius },
            ("box", &[x, y, z, rounding], _) => Shape::Box { half: DVec3::new(x, y, z), rounding },
            ("half-space", [], _) => Shape::HalfSpace,
            ("field", spacing, Some(mesh)) => {
                Shape::Field(distance_field(&mesh.get().0, spacing.first().copied())?)
            }
            (kind, ..) => return Err(invalid(format!("unknown shape `{kind}`"))),
        };
        let (at, rotation) = (vec3(self.at), turn(self.rotation)?);
        Ok(Part { shape, at, rotation, cavity: self.cavity, jaw: self.jaw })
    }
}

/// A rotation from a quaternion (x, y, z, w) of any length.
pub fn turn(q: [f64; 4]) -> Result<DQuat> {
    let turn = DQuat::from_array(q);
    let length = turn.length();
    match length.is_normal() {
        true => Ok(turn / length),
        false => Err(invalid(format!(
            "{q:?} is no rotation; give a quaternion (x, y, z, w), (0, 0, 0, 1) for none"
        ))),
    }
}

/// Place (m), rotation, opening (rad).
pub type ToolPoseIn = (Vec3, [f64; 4], f64);

pub fn tool_pose((position, rotation, opening): ToolPoseIn) -> Result<ToolPose> {
    Ok(ToolPose { position: vec3(position), rotation: turn(rotation)?, opening })
}

/// Translation (m), rotation, centre (m).
pub type PoseIn = (Vec3, [f64; 4], Vec3);

pub fn pose((translation, rotation, centre): PoseIn) -> Result<Pose> {
    let (translation, centre) = (vec3(translation), vec3(centre));
    Ok(Pose { translation, rotation: turn(rotation)?, centre })
}

/// A relative factor, or Pa/m.
#[derive(FromPyObject)]
pub struct StiffnessIn {
    relative: bool,
    value: f64,
}

pub fn stiffness(own: &StiffnessIn) -> Stiffness {
    match own.relative {
        true => Stiffness::Relative(own.value),
        false => Stiffness::Absolute(own.value),
    }
}

#[derive(FromPyObject)]
pub enum PointsIn {
    Faces(u32),
    Word(String),
}

pub fn points(own: PointsIn) -> Result<Points> {
    match own {
        PointsIn::Faces(n) => Ok(Points::Faces(n)),
        PointsIn::Word(word) => choice("kind of points", &word),
    }
}

#[derive(FromPyObject)]
pub struct ToolIn {
    pub name: String,
    pub parts: Vec<PartIn>,
    pub hinge: Option<(Vec3, Vec3)>,
    pub start: ToolPoseIn,
    pub path: Option<Vec<(f64, ToolPoseIn)>>,
    pub by: Option<Vec3>,
    pub curve: Option<CurveIn>,
    pub friction: f64,
    pub grip: bool,
    pub points: PointsIn,
    pub stiffness: StiffnessIn,
    pub exact: bool,
    pub keeps_side: bool,
    pub error_bar: bool,
    pub local_stiffness: bool,
    pub on: Option<(u64, Indices)>,
    pub edge: Option<String>,
    pub needle: Option<String>,
    pub begin: f64,
    pub until: f64,
}

pub fn hinge(own: Option<(Vec3, Vec3)>) -> Hinge {
    own.map_or_else(Hinge::default, |(point, axis)| Hinge { point: vec3(point), axis: vec3(axis) })
}
