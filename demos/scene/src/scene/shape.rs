//! Generated shapes: one table of their keys, for scenes and for `sinew mesh generate`.

use serde::{Deserialize, Serialize};

/// A shape for a command line.
#[derive(Clone, Copy, Debug)]
pub struct ShapeDocument {
    /// Its key below `generate`.
    pub name: &'static str,
    /// What it is.
    pub about: &'static str,
    /// Its keys.
    pub keys: &'static [ShapeKey],
}

/// A key of a shape.
#[derive(Clone, Copy, Debug)]
pub struct ShapeKey {
    /// The key.
    pub name: &'static str,
    /// What it means.
    pub about: &'static str,
    /// Whether it may be left out.
    pub optional: bool,
}

/// The shapes, and their table: what a shape is called in Rust, and how many keys it has, is written once.
macro_rules! shapes {
    ($(
        #[doc = $about:literal]
        $slot:ident $(as $rename:literal)?: $(#[doc = $more:literal])+ $shape:ident {
            $(
                $(#[doc = $key_about:literal])+
                $(#[serde($option:ident $(= $function:literal)?)])?
                $key:ident: $type:ty
            ),+ $(,)?
        }
    )+) => {
        /// A generated shape; exactly one key.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Generate {
            $(
                #[doc = $about]
                $(#[serde(rename = $rename)])?
                pub $slot: Option<$shape>,
            )+
        }

        $(
            $(#[doc = $more])+
            #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
            #[serde(deny_unknown_fields)]
            pub struct $shape {
                $(
                    $(#[doc = $key_about])+
                    $(#[serde($option $(= $function)?)])?
                    pub $key: $type,
                )+
            }
        )+

        /// All shapes.
        pub const SHAPES: &[ShapeDocument] = &[$(
            ShapeDocument {
                name: first(&[$($rename,)? stringify!($slot)]),
                about: $about,
                keys: &[$(
                    ShapeKey {
                        name: stringify!($key),
                        about: concat!($($key_about),+),
                        optional: <$type as Given>::OPTIONAL || first(&[$(stringify!($option),)? ""]).len() > 0,
                    },
                )+],
            },
        )+];
    };
}

const fn first(of: &[&'static str]) -> &'static str {
    of[0]
}

/// Whether a key of this type may be left out.
trait Given {
    const OPTIONAL: bool = false;
}
impl<T> Given for Option<T> {
    const OPTIONAL: bool = true;
}
impl Given for f64 {}
impl Given for usize {}
impl<T, const N: usize> Given for [T; N] {}
impl Given for Vec<usize> {}
impl Given for SolidCells {}
impl Given for SheetCells {}

shapes! {
    /// A box with one corner at the origin; groups `x0`, `x1`, `y0`, `y1`, `z0`, `z1`, `body`.
    cuboid as "box":
        /// A box of `6 nx ny nz` tetrahedra or `nx ny nz` hexahedra.
        BoxShape {
            /// Edge lengths (m).
            size: [f64; 3],
            /// Cells along each axis.
            cells: [usize; 3],
            /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
            #[serde(default)]
            elements: SolidCells,
            /// Exponents along x, y and z: above 1 cells get smaller towards the origin, below 1 away from it; default 1.
            grading: Option<[f64; 3]>,
            /// Which of the irregular meshes; default 0.
            seed: Option<u64>,
        }
    /// A cylinder along x from the origin; groups `x0`, `x1`, `side`, `body`.
    cylinder:
        /// A cylinder of `18 rings^2 layers` tetrahedra, or of hexahedra: `rings` rings around a square of `2 rings`
        /// cells along each side.
        CylinderShape {
            /// Radius (m).
            radius: f64,
            /// Length (m).
            length: f64,
            /// Rings around the axis; default 3.
            #[serde(default = "cylinder_rings")]
            rings: usize,
            /// Layers along the axis; default 20.
            #[serde(default = "cylinder_layers")]
            layers: usize,
            /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
            #[serde(default)]
            elements: SolidCells,
        }
    /// A ball around the origin; groups `surface`, `body`.
    sphere:
        /// A ball of `20 shells^3` tetrahedra.
        SphereShape {
            /// Radius (m).
            radius: f64,
            /// Shells from centre to surface; default 6.
            #[serde(default = "sphere_shells")]
            shells: usize,
        }
    /// A rectangle at z = 0 with one corner at the origin; groups `x0`, `x1`, `y0`, `y1`, `body`.
    sheet:
        /// A rectangle of `2 nx ny` triangles or `nx ny` quadrilaterals.
        SheetShape {
            /// Edge lengths (m).
            size: [f64; 2],
            /// Cells along each axis.
            cells: [usize; 2],
            /// `"triangles"` (default) or `"quads"`.
            #[serde(default)]
            elements: SheetCells,
        }
    /// A flat or solid tensile specimen along x, its middle at the origin; groups as those of a sheet or box, and `grip0`, `grip1` (the wide ends).
    specimen:
        /// The tensile specimen of Natsupakpong & Cavusoglu 2010: 16 widths long, grips three widths wide.
        SpecimenShape {
            /// Width of the straight part (m).
            width: f64,
            /// Cells along, across and (of a solid) through.
            cells: Vec<usize>,
            /// Thickness (m) of a solid; a sheet without.
            thickness: Option<f64>,
            /// Of a sheet: `"triangles"` (default) or `"quads"`.
            sheet: Option<SheetCells>,
            /// Of a solid: `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
            solid: Option<SolidCells>,
        }
    /// A disc of triangles at z = 0 around the origin; groups `rim`, `body`.
    disc:
        /// A disc of `6 rings^2` triangles.
        DiscShape {
            /// Radius (m).
            radius: f64,
            /// Rings around the centre.
            rings: usize,
        }
    /// A hollow sphere of triangles around the origin; group `body`.
    balloon:
        /// A sphere of `20 cuts^2` triangles.
        BalloonShape {
            /// Radius (m).
            radius: f64,
            /// Parts into which the edges of an icosahedron are cut.
            cuts: usize,
        }
    /// Along x from the origin; groups `x0`, `x1`, `inner`, `outer`, `body`.
    tube:
        /// A tube of `around through along` hexahedra, or six times as many tetrahedra.
        TubeShape {
            /// Radius (m) of the bore.
            radius: f64,
            /// Thickness (m) of the wall.
            wall: f64,
            /// Length (m).
            length: f64,
            /// Cells around it, at least three.
            around: usize,
            /// Cells through the wall.
            through: usize,
            /// Cells along it.
            along: usize,
            /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
            #[serde(default)]
            elements: SolidCells,
        }
    /// Half of a thick-walled ellipsoid, open at z = 0, its tip below; groups `inner`, `outer`, `base`, `body`.
    cup:
        /// A cup of `(core^2 + 4 core rings) layers` hexahedra, or six times as many tetrahedra.
        CupShape {
            /// Radius (m) of the opening.
            radius: f64,
            /// Depth (m) of the cavity.
            depth: f64,
            /// Thickness (m) of the wall at opening and tip.
            wall: f64,
            /// Cells along each side of the square at the tip; even for helix rules.
            core: usize,
            /// Rings of `4 core` cells from there to the opening.
            rings: usize,
            /// Layers through the wall.
            layers: usize,
            /// `"tetrahedra"` (default), `"hexahedra"` or `"irregular"` tetrahedra.
            #[serde(default)]
            elements: SolidCells,
        }
}

fn cylinder_rings() -> usize {
    3
}

fn cylinder_layers() -> usize {
    20
}

fn sphere_shells() -> usize {
    6
}

impl Generate {
    /// A shape from words of a command line: a number of words for every key, as a scene has them in a table.
    ///
    /// # Errors
    /// What is wrong with them, as of a scene.
    pub fn from_words(shape: &str, values: &[(&str, Vec<String>)]) -> Result<Self, String> {
        let value = |word: &String| {
            let integer = word.parse().map(toml::Value::Integer);
            let number = || word.parse().map(toml::Value::Float);
            integer.or_else(|_| number()).unwrap_or_else(|_| toml::Value::String(word.clone()))
        };
        let values = values.iter().map(|(key, words)| {
            let list: Vec<toml::Value> = words.iter().map(value).collect();
            let one = <[toml::Value; 1]>::try_from(list);
            (key.to_string(), one.map_or_else(toml::Value::Array, |[one]| one))
        });
        let own = toml::Value::Table(values.collect());
        let table = toml::Table::from_iter([(shape.to_string(), own)]);
        let read = Self::deserialize(table).map_err(|e| e.to_string().trim().replace('\n', ", "));
        read.map_err(|e| format!("{shape}: {e}"))
    }
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

/// A rotation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// Axis, of any length.
    pub axis: [f64; 3],
    /// Angle (degrees).
    pub degrees: f64,
}
