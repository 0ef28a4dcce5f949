//! Fibres, muscles and axes of a body.

use super::conditions::CurveEntry;
use serde::{Deserialize, Serialize};
use sinew::models::axes::description::FibreForm;

/// A family of fibres: a direction in every solid element, given by exactly one of `direction`, `data`,
/// `formula`, `azimuth_elevation`, `laplace`, `circular`, `hemicircular`, `helicoidal` and `random`. Directions and places
/// are those of the body in place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FibreEntry {
    /// Name, unique in the body; frames carry the fibres under it.
    pub name: String,
    /// Modulus along the fibres (Pa), added to that of the body's material.
    pub modulus: f64,
    /// Moduli (Pa) along a second and a third axis, orthogonal to the fibres and to each other: families `NAME_2` and
    /// `NAME_3`.
    pub across: Option<[f64; 2]>,
    /// The second axis is the part of this direction across the fibres; without it, the course of the fibres tells.
    pub towards: Option<[f64; 3]>,
    /// What their springs measure: `"stretch"` (default) or `"biquadratic"`.
    #[serde(default)]
    pub form: FibreForm,
    /// Viscosity along the fibres, and along the axes across them (Pa s); no damping without it.
    pub viscosity: Option<f64>,
    /// The same direction everywhere, of any length.
    pub direction: Option<[f64; 3]>,
    /// Vectors of the mesh file.
    pub data: Option<String>,
    /// Formulas in x, y, z (m) at the barycentres.
    pub formula: Option<[String; 3]>,
    /// Maps of azimuth and elevation.
    pub azimuth_elevation: Option<AzimuthElevationEntry>,
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

/// Directions from two angles (degrees) in every element, by exactly one of `data` and `formula`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AzimuthElevationEntry {
    /// Cell data of the mesh file with azimuth and elevation.
    pub data: Option<[String; 2]>,
    /// Formulas of azimuth and elevation in x, y, z (m) at the barycentres.
    pub formula: Option<[String; 2]>,
    /// Axis towards which the elevation rises, of any length; default z.
    pub axis: Option<[f64; 3]>,
    /// Direction of azimuth 0, made perpendicular to the axis; default x.
    pub zero: Option<[f64; 3]>,
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
/// [`MuscleSettings`](sinew::models::axes::muscle::MuscleSettings).
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
    /// Of axes as printed, which are a package of their own: the error says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_viscosity: Option<f64>,
    /// Likewise; `"energy_consistent"` is what there is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub form: Option<String>,
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
