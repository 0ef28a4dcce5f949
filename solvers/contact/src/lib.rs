//! Tools that touch bodies, contact between bodies, friction and pulls. It knows vertices and surfaces, no law and no
//! integrator: integrators ask [`set::ContactSet`] for energies, forces and tangents, as often as they need.

pub mod field;
pub mod pair;
mod point;
pub mod pull;
pub mod set;
pub mod shape;
mod skin;
pub mod tool;
