//! Resection: elements are removed while the scene runs.
//!
//! A removed tetrahedron or hexahedron keeps its table row for the time being, with moduli, volume and shape
//! vectors 0: every law then gives exact zeros for it, and `J = 1`. A removed membrane element gets
//! moduli 0 and is drawn together into one vertex, which leaves its area ratio at 1. Pooled constants of
//! the edges and triangles round them are summed again over the elements that are left, never
//! subtracted, so they do not drift. A batch costs in proportion to the elements it touches, but for
//! choosing elements by a region or by their state, which looks at every one. Once more than a quarter of
//! a body's rows of either kind are dead, tables and edge graph are compacted in place, in their order.
//!
//! Vertices keep their rows, so constraints and loads stay valid. One that has lost its last element
//! flies freely if it has mass left, and stays where it is if not ([`MassPolicy`](crate::body::present::MassPolicy)).
//!
//! A follower pressure goes on acting on a face for as long as an element of either kind has it; faces
//! that none has any more leave their [`Pressure`](sinew_engine::load::Pressure) for good. The surface that a cut lays open carries no
//! pressure until it is given one. The same holds for tractions ([`LoadedFaces`](sinew_engine::load::LoadedFaces)).
//!
//! Removing elements is an action from outside: their elastic energy (and the kinetic energy of the
//! removed mass) leaves the scene, see [`RemovalReport`].
//!
//! [`remove_elements`] acts at once. In a schedule, spawn a [`RemovalRequest`]: it is carried out in
//! [`StepSystems::Edit`](sinew_engine::schedule::StepSystems::Edit), with the others of the same body and [`MassPolicy`](crate::body::present::MassPolicy) that were made in a row as one
//! batch, and [`RemovalLog`] tells what came of it.

mod clusters;
mod columns;
mod compact;
mod region;
mod remove;
mod report;
mod request;
pub(crate) mod state;
mod sums;
mod verify;

pub(crate) use compact::renumber_blocks;
pub use region::Region;
pub(crate) use remove::remove_batch;
pub use remove::{Removal, prepare_removals, remove_elements};
pub use report::{RemovalError, RemovalReport};
pub(crate) use request::install;
pub use request::{RemovalLog, RemovalRequest, Requests};
pub use verify::{FreshDifference, compare_with_fresh};
