//! What touches bodies: tools, pulls, and bodies each other.

use super::conditions::{CurveEntry, Selection};
use super::shape::Rotation;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew::touch::edge::Edge;
use sinew::touch::needle::Needle;
use sinew::touch::tool::Part;
use std::path::PathBuf;

/// Shape of a tool or of a part of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToolShape {
    /// A ball: `radius`.
    Sphere,
    /// A rod with round ends along x: `half_length`, `radius`.
    Capsule,
    /// A box with round edges: `half`, `rounding`.
    Box,
    /// A table, floor or wall: `normal`.
    HalfSpace,
    /// A closed mesh: `file`.
    Mesh,
}

/// Tables that say a shape by the same keys, and more.
macro_rules! shaped {
    ($(
        $(#[$about:meta])*
        $name:ident { $($(#[$field_about:meta])* $field:ident: $type:ty,)* }
    )*) => {$(
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            /// Shape.
            pub shape: Option<ToolShape>,
            /// Radius (m) of a sphere or capsule.
            pub radius: Option<f64>,
            /// Half the distance (m) between the centres of the ends of a capsule.
            pub half_length: Option<f64>,
            /// Half sizes (m) of a box, rounding included.
            pub half: Option<[f64; 3]>,
            /// Radius (m) of the edges of a box.
            pub rounding: Option<f64>,
            /// Direction out of a half-space, any length.
            pub normal: Option<[f64; 3]>,
            /// File of a closed mesh, relative to the scene file.
            pub file: Option<PathBuf>,
            /// Factor on its coordinates; default 1.
            pub scale: Option<f64>,
            /// Distance (m) of the grid points that hold the distance to it.
            pub spacing: Option<f64>,
            /// Bodies may not leave its inside; default false.
            pub cavity: Option<bool>,
            $($(#[$field_about])* pub $field: $type,)*
        }

        impl $name {
            /// The keys of the shape alone.
            pub(crate) fn shape_keys(&self) -> PartEntry {
                PartEntry {
                    shape: self.shape,
                    radius: self.radius,
                    half_length: self.half_length,
                    half: self.half,
                    rounding: self.rounding,
                    normal: self.normal,
                    file: self.file.clone(),
                    scale: self.scale,
                    spacing: self.spacing,
                    cavity: self.cavity,
                    ..PartEntry::default()
                }
            }
        }
    )*};
}

shaped! {
    /// A rigid part of a tool.
    PartEntry {
        /// Place (m) of its centre in the frame of the tool; default the origin.
        at: Option<[f64; 3]>,
        /// Rotation in the frame of the tool.
        rotate: Option<Rotation>,
        /// Share of the opening by which it turns about the hinge: 0 (default) for what is no jaw, 0.5 and -0.5 for
        /// two jaws.
        jaw: Option<f64>,
    }

    /// A rigid tool: one shape, or several parts.
    ToolEntry {
        /// Name, unique among tools.
        name: String,
        /// Parts; these or `shape`.
        #[serde(default)]
        parts: Vec<PartEntry>,
        /// Its sharp edge, which cuts bodies that have `spare` vertices. Dynamic scenes.
        edge: Option<EdgeEntry>,
        /// Its needle, which enters bodies of solid elements. Dynamic scenes.
        needle: Option<NeedleEntry>,
        /// Where it stands (m) at first; `path` says so too.
        at: Option<[f64; 3]>,
        /// Its rotation at first.
        rotate: Option<Rotation>,
        /// A point (m) on the hinge of its jaws, in the frame of the tool.
        hinge: Option<[f64; 3]>,
        /// Direction of the hinge, any length.
        hinge_axis: Option<[f64; 3]>,
        /// Angle (degrees) between the jaws; the fifth column of `path` says so too.
        opening: Option<f64>,
        /// `[time (s), x, y, z (m)]` or `[time, x, y, z, opening (degrees)]`, linear between.
        path: Option<Vec<Vec<f64>>>,
        /// `[time (s), axis x, y, z, degrees]`: how it is turned from `rotate`, evenly between.
        turns: Option<Vec<[f64; 5]>>,
        /// Translation (m) from `at`.
        translate: Option<[f64; 3]>,
        /// Factor on it over time. Dynamic scenes.
        curve: Option<CurveEntry>,
        /// Coefficient of friction; default 0.
        friction: Option<f64>,
        /// Old name of `friction`.
        mu: Option<f64>,
        /// Times (s) from which until which it grips: what touches it does not slip. Dynamic scenes.
        grip: Option<[f64; 2]>,
        /// `"auto"` (default), `"vertex"` or `"faces(n)"`: which points of a surface touch it.
        points: Option<String>,
        /// Pressure over penetration, in Young's modulus over the mean edge; default 50.
        stiffness: Option<f64>,
        /// The same in Pa/m.
        stiffness_absolute: Option<f64>,
        /// No penetration; for the integrators `newton` and `quasi-static`.
        #[serde(default)]
        exact: bool,
        /// What was pushed out through one side stays on it; default true.
        keeps_side: Option<bool>,
        /// Stiffness (N/m) of a spring by which a hand holds it, whose motion is then the hand's.
        spring: Option<f64>,
        /// Also finds the force by points of the other kind.
        #[serde(default)]
        error_bar: bool,
        /// What it touches; every surface of every body without.
        on: Option<TouchedEntry>,
        /// Time (s) from which it touches. Dynamic scenes.
        from: Option<f64>,
        /// Time (s) after which it touches no more. Dynamic scenes.
        until: Option<f64>,
    }
}

/// The sharp edge of a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EdgeEntry {
    /// Its ends (m) in the frame of the tool.
    pub ends: [[f64; 3]; 2],
    /// Direction in which it cuts, in the frame of the tool, any length.
    pub into: [f64; 3],
    /// Energy (J/m^2) that a unit of cut area takes; 0 for a blade that meets no force.
    pub toughness: f64,
    /// Way (m, in the frame of the tool) that it makes while the jaws close from their first opening to none; for scissors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel: Option<[f64; 3]>,
    /// The sides of the blade, which touch the lips of its wound; none without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flanks: Option<FlanksEntry>,
}

/// The sides of a blade.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlanksEntry {
    /// How far (m) they reach behind the edge.
    pub length: f64,
    /// Thickness (m) of the blade in its middle.
    pub thickness: f64,
}

impl EdgeEntry {
    /// The sides of the blade, if it has any.
    ///
    /// # Errors
    /// When a number cannot be used.
    pub fn flanks(&self) -> Result<Option<Part>, String> {
        let of = |own: &FlanksEntry| Edge::from(self).flanks(own.length, own.thickness);
        self.flanks.as_ref().map(of).transpose()
    }
}

impl From<&EdgeEntry> for Edge {
    fn from(own: &EdgeEntry) -> Self {
        let (ends, travel) = (own.ends.map(DVec3::from), own.travel.unwrap_or_default().into());
        Self { ends, into: own.into.into(), toughness: own.toughness, travel }
    }
}

/// The needle of a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeedleEntry {
    /// Its tip (m) in the frame of the tool; default the origin.
    pub tip: Option<[f64; 3]>,
    /// Direction in which the tip points, in the frame of the tool, any length.
    pub into: [f64; 3],
    /// Centre (m) of the circle of which it is an arc; straight without.
    pub centre: Option<[f64; 3]>,
    /// Length (m).
    pub length: f64,
    /// Diameter (m).
    pub diameter: f64,
    /// Energy (J/m^2) that a unit of the area takes that its tip parts.
    pub toughness: f64,
    /// Force (N) at which a surface gives way; default twice what the tip needs inside.
    pub puncture: Option<f64>,
    /// Friction (N/m) of the shaft, by length in tissue.
    pub friction: f64,
}

impl From<&NeedleEntry> for Needle {
    fn from(own: &NeedleEntry) -> Self {
        let centre = own.centre.map(DVec3::from);
        let (tip, into) = (own.tip.unwrap_or_default().into(), own.into.into());
        let made = Self::new(own.length, own.diameter, own.toughness, own.friction);
        Self { tip, into, centre, puncture: own.puncture, ..made }
    }
}

/// A body, or some of its faces; at most one key beside `body`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchedEntry {
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// A group of faces.
    pub group: Option<String>,
    /// The boundary of the solid.
    pub surface: Option<bool>,
    /// The membrane.
    pub membrane: Option<bool>,
}

/// A spring and damper from vertices to a hand.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PullEntry {
    /// Name, unique among pulls.
    pub name: String,
    /// Name of the body; may be left out when there is only one.
    pub body: Option<String>,
    /// Which vertices.
    pub select: Selection,
    /// Stiffness (N/m) of all vertices together.
    pub stiffness: f64,
    /// Damping (N s/m) of all vertices together; default 0.
    pub damping: Option<f64>,
    /// `[time (s), x, y, z (m)]`: the way of the hand since it took hold, linear between. Dynamic scenes.
    pub path: Option<Vec<[f64; 4]>>,
    /// The way of the hand (m) at factor 1.
    pub translate: Option<[f64; 3]>,
    /// Factor on it over time. Dynamic scenes.
    pub curve: Option<CurveEntry>,
    /// Time (s) from which it pulls. Dynamic scenes.
    pub from: Option<f64>,
    /// Time (s) after which it lets go. Dynamic scenes.
    pub until: Option<f64>,
}

/// Bodies that may touch each other, or one that may touch itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactEntry {
    /// Name, unique among contacts.
    pub name: String,
    /// Names of two bodies; these or `self`.
    pub bodies: Option<[String; 2]>,
    /// Name of a body that may touch itself.
    #[serde(rename = "self")]
    pub itself: Option<String>,
    /// Coefficient of friction; default 0.
    pub friction: Option<f64>,
    /// Old name of `friction`.
    pub mu: Option<f64>,
    /// Pressure over penetration, in Young's modulus over the mean edge of the softer one; default 20.
    pub stiffness: Option<f64>,
    /// The same in Pa/m.
    pub stiffness_absolute: Option<f64>,
}
