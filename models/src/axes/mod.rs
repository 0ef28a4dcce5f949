//! Axes of anisotropy (Bourguignon & Cani 2000): springs along directions through the barycentre of an
//! element, between such directions, and against changes of volume.
//!
//! | module | content |
//! |---|---|
//! | [`element`] | energy, force and tangents of axes in a tetrahedron, with moduli in Pa |
//! | [`columns`], [`systems`] | the same over all elements, several at a time |
//! | [`points`] | the same at the Gauss points of hexahedra and of ten-node tetrahedra |
//! | [`description`] | axes of a body as the user states them |
//! | [`field`] | fibre fields: where the directions come from |
//! | [`muscle`] | active fibres |
//! | [`damper`] | dampers along axes |
//! | [`attachment`], [`printed`], [`printed_system`] | where axes meet faces, and the formulas as printed, for comparison |

pub mod attachment;
pub mod columns;
pub mod damper;
pub mod description;
pub mod element;
pub mod field;
mod formula;
pub mod muscle;
pub mod points;
pub mod printed;
pub mod printed_system;
pub(crate) mod removal;
pub mod site;
pub(crate) mod spawn;
pub(crate) mod spawn_printed;
pub mod systems;
