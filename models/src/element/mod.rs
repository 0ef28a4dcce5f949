//! Single elements: plain functions on plain values.

pub mod corotational;
pub mod face;
pub mod hinge;
pub mod hourglass;
pub mod matrix;
pub mod membrane;
pub mod plate;
pub mod precompute;
pub mod projection;
pub mod spring;
pub mod tetrahedron;
