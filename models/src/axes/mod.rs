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
//! | [`site`] | what another crate needs for a law of axes of its own |

pub mod columns;
pub mod damper;
pub mod description;
pub mod element;
pub mod field;
mod formula;
pub mod muscle;
pub mod points;
pub(crate) mod removal;
pub mod site;
mod softening;
pub(crate) mod spawn;
pub mod systems;
