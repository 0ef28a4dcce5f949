//! Tools that touch bodies, contact between bodies, friction, pulls, threads and clips. It knows vertices and surfaces, no law and no
//! integrator: integrators ask [`set::ContactSet`] for energies, forces and tangents, as often as they need.

mod beside;
pub mod edge;
pub mod field;
mod install;
pub mod limits;
pub mod needle;
pub mod pair;
mod point;
pub mod pull;
pub mod set;
pub mod shape;
mod skin;
pub mod standing;
pub mod thread;
pub mod tool;

pub use install::install;
