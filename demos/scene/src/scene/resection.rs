//! Elements that are removed, and cuts.

use super::conditions::SphereRegion;
use serde::{Deserialize, Serialize};
use sinew::models::body::present::MassPolicy;

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
    pub tool: Option<CutterEntry>,
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

/// A cut through a body, at once, in its present shape; dynamic scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CutEntry {
    /// Name, unique among cuts.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Time (s) at which it is made, before the step that begins then.
    pub time: f64,
    /// The surface of the blade: where its edge begins and ends, `[[x, y, z], [x, y, z]]` (m), one position after another.
    pub strip: Vec<[[f64; 3]; 2]>,
}

/// A ball that moves along a path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CutterEntry {
    /// Radius (m).
    pub radius: f64,
    /// `[time (s), x, y, z (m)]`, linear between; it acts from the first to the last.
    pub path: Vec<[f64; 4]>,
}
