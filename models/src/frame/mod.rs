//! What runs a law over all elements of a kind: the traits that a law implements, its row, columns, passes for energy,
//! force and tangent, several elements at a time.

pub mod clusters;
pub mod columns;
pub mod gauss;
pub mod hexahedra;
pub mod law;
pub mod means;
pub mod moduli;
pub mod part;
pub mod quads;
pub mod reduced;
pub mod row;
pub mod rules;
pub mod stand_in;
pub mod tetrahedra;
pub mod triangles;
