//! Generated shapes.

use serde::{Deserialize, Serialize};

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
