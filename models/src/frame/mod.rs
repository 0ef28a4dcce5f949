//! What runs a law over all elements of a kind: columns, passes for energy, force and tangent, several elements
//! at a time.

pub mod clusters;
pub(crate) mod columns;
pub mod gauss;
pub mod hexahedra;
pub mod means;
pub mod quads;
pub mod tetrahedra;
pub mod triangles;
