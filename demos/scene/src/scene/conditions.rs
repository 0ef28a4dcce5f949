//! What acts on bodies: constraints, loads and pressures, where and when.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::{Patch, Zone};

/// Vertices of a body; exactly one key. Places are those of the rest shape.
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
    /// All vertices in a cylinder.
    pub cylinder: Option<CylinderRegion>,
    /// All vertices on one side of a plane.
    pub half_space: Option<HalfSpaceRegion>,
    /// The vertices of a part of the surface.
    pub patch: Option<PatchRegion>,
    /// All vertices of the body.
    pub all: Option<bool>,
}

impl Selection {
    /// The part of space that it gives, if it is one, and its key.
    pub fn zone(&self) -> Option<(&'static str, Zone)> {
        let at = DVec3::from_array;
        if let Some(BoxRegion { min, max }) = self.cuboid {
            Some(("box", Zone::Box { min: at(min), max: at(max) }))
        } else if let Some(SphereRegion { centre, radius }) = self.sphere {
            Some(("sphere", Zone::Sphere { centre: at(centre), radius }))
        } else if let Some(CylinderRegion { start, end, radius }) = self.cylinder {
            Some(("cylinder", Zone::Cylinder { start: at(start), end: at(end), radius }))
        } else if let Some(HalfSpaceRegion { point, normal }) = self.half_space {
            Some(("half_space", Zone::HalfSpace { point: at(point), normal: at(normal) }))
        } else {
            None
        }
    }
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

/// A cylinder with flat ends and its surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CylinderRegion {
    /// Middle of one end (m).
    pub start: [f64; 3],
    /// Middle of the other end (m).
    pub end: [f64; 3],
    /// Radius (m).
    pub radius: f64,
}

/// One side of a plane, with the plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HalfSpaceRegion {
    /// A point of the plane (m).
    pub point: [f64; 3],
    /// Points to the side that is meant; of any length.
    pub normal: [f64; 3],
}

/// A part of the surface: around a point, of a direction, or both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatchRegion {
    /// A point (m) near the face that it begins with.
    pub near: Option<[f64; 3]>,
    /// Direction of the outward normals; of any length.
    pub normal: Option<[f64; 3]>,
    /// Largest bend between neighbours, or with `normal` largest angle to it (degrees).
    #[serde(default = "patch_angle")]
    pub angle: f64,
}

fn patch_angle() -> f64 {
    30.0
}

impl PatchRegion {
    /// The part of the surface.
    pub fn patch(&self) -> Patch {
        let at = |own: Option<[f64; 3]>| own.map(DVec3::from_array);
        Patch { near: at(self.near), normal: at(self.normal), angle: self.angle.to_radians() }
    }
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

/// A force on vertices, or a traction on faces; both keep their direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadEntry {
    /// Name, unique among constraints and loads.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices bear `force`.
    pub select: Option<Selection>,
    /// Total force (N), shared equally by the vertices.
    pub force: Option<[f64; 3]>,
    /// Which faces bear `traction`.
    pub on: Option<FacesEntry>,
    /// Force per rest area (N/m^2), shared by the vertices as their shape functions say.
    pub traction: Option<[f64; 3]>,
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
    pub on: FacesEntry,
    /// Pressure (Pa); negative for suction.
    pub pressure: f64,
    /// Factor over time; 1 without it. Dynamic scenes.
    pub curve: Option<CurveEntry>,
}

/// Faces of a body; exactly one key.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FacesEntry {
    /// A group of triangles: on faces of tetrahedra the pressure pushes into the body, on other
    /// membrane triangles along their normal.
    pub group: Option<String>,
    /// The whole boundary of the tetrahedra, pushed inward.
    pub surface: Option<bool>,
    /// A part of that, likewise.
    pub patch: Option<PatchRegion>,
    /// All triangles of the membrane, pushed along their normals.
    pub membrane: Option<bool>,
    /// Of a traction alone: edges at the rim of the membrane between vertices of this group. The force per length is the
    /// traction times the thickness.
    pub rim: Option<String>,
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
