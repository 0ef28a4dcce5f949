//! The table of laws: one row each. Spawning, changes, removal, compaction, upload to the device, reports and
//! tests read it; a law that is not in it cannot be spawned.
//!
//! What a row is and how a world keeps its own table is in [`crate::frame::row`]. The place of a row in [`LAWS`] is its
//! place in the sum of energies, forces and tangents.

/// The rows of a law of tetrahedra, by their constructors and names: [`LawRow::tetrahedra`] and its family.
macro_rules! family {
    ($law:ty; $($row:ident = $make:ident($($name:literal),+);)*) => {
        /// Row of its tetrahedra in the table of laws.
        pub static TETRAHEDRA: LawRow = LawRow::tetrahedra::<$law>().with_family(&[$(&$row),*]);
        $(
            #[doc = concat!("Its row as [`", stringify!($make), "`](LawRow::", stringify!($make), ").")]
            pub static $row: LawRow = LawRow::$make::<$law>($($name),+);
        )*
    };
}

pub mod bending;
pub mod corotational;
pub mod linear;
pub mod membranes;
pub mod models;
pub mod neo_hookean;
pub mod pooled;
pub mod pressure;
pub mod quadratic;
pub mod stvk_fem;
pub mod svk;
pub mod svk_volume;

use crate::axes::{damper, points as axes_at_points, systems as axes};
use crate::cutting::glue;
use crate::frame::row::{LawRow, LawTable};

/// All laws that come with Sinew, in the order in which they are summed up.
pub static LAWS: &[&LawRow] = &[
    &svk::TETRAHEDRA,
    &pooled::TENSILE,
    &pooled::ANGULAR,
    &pooled::VOLUMETRIC,
    &pooled::SPRING_FORCES,
    &svk::COMPRESSION,
    &svk::PROJECTION,
    &quadratic::TETRAHEDRA,
    &quadratic::EDGE_SPRINGS,
    &linear::TETRAHEDRA,
    &corotational::WARPED_TETRAHEDRA,
    &corotational::TETRAHEDRA,
    &membranes::BIQUADRATIC,
    &membranes::QUADRATIC,
    &membranes::LINEAR,
    &membranes::COROTATIONAL,
    &membranes::PROJECTION,
    &membranes::COMPRESSION,
    &bending::ROW,
    &glue::ROW,
    &stvk_fem::TETRAHEDRA,
    &neo_hookean::TETRAHEDRA,
    &svk_volume::TETRAHEDRA,
    &pressure::ROW,
    &axes::TRIADS,
    &axes::FIBRES,
    &axes::BIQUADRATIC,
    &axes::BIQUADRATIC_PROJECTION,
    &axes::SHEET_BIQUADRATIC,
    &axes::SHEET_PROJECTION,
    &axes::VOLUMES,
    &damper::IN_TETRAHEDRA,
    &svk::HEXAHEDRA,
    &linear::HEXAHEDRA,
    &corotational::HEXAHEDRA,
    &neo_hookean::HEXAHEDRA,
    &svk_volume::HEXAHEDRA,
    &linear::HEXAHEDRA_BY_MEAN,
    &corotational::HEXAHEDRA_BY_MEAN,
    &neo_hookean::HEXAHEDRA_BY_MEAN,
    &svk_volume::HEXAHEDRA_BY_MEAN,
    &svk::HEXAHEDRA_REDUCED,
    &linear::HEXAHEDRA_REDUCED,
    &corotational::HEXAHEDRA_REDUCED,
    &neo_hookean::HEXAHEDRA_REDUCED,
    &svk_volume::HEXAHEDRA_REDUCED,
    &linear::HEXAHEDRA_REDUCED_BY_MEAN,
    &corotational::HEXAHEDRA_REDUCED_BY_MEAN,
    &neo_hookean::HEXAHEDRA_REDUCED_BY_MEAN,
    &svk_volume::HEXAHEDRA_REDUCED_BY_MEAN,
    &linear::BY_CLUSTERS,
    &corotational::BY_CLUSTERS,
    &neo_hookean::BY_CLUSTERS,
    &svk_volume::BY_CLUSTERS,
    &svk::TETRAHEDRA10,
    &corotational::TETRAHEDRA10,
    &neo_hookean::TETRAHEDRA10,
    &svk_volume::TETRAHEDRA10,
    &corotational::TETRAHEDRA10_BY_MEAN,
    &neo_hookean::TETRAHEDRA10_BY_MEAN,
    &svk_volume::TETRAHEDRA10_BY_MEAN,
    &membranes::BIQUADRATIC_QUADS,
    &membranes::LINEAR_QUADS,
    &membranes::COROTATIONAL_QUADS,
    &axes_at_points::TRIADS,
    &axes_at_points::FIBRES,
    &axes_at_points::BIQUADRATIC,
    &axes_at_points::VOLUMES,
    &damper::IN_HEXAHEDRA,
    &axes_at_points::TRIADS10,
    &axes_at_points::FIBRES10,
    &axes_at_points::BIQUADRATIC10,
    &axes_at_points::VOLUMES10,
    &damper::IN_TETRAHEDRA10,
];

impl Default for LawTable {
    fn default() -> Self {
        Self(LAWS.to_vec())
    }
}
