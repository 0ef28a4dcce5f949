//! Tests of laws and bodies, in one binary because each would compile all kernels for itself.

mod axes;
mod axes_fields;
mod bending;
mod clusters;
mod common;
mod comparison;
mod cutting;
mod cutting_numbers;
mod element;
mod isoparametric;
mod lanes;
mod laws;
mod material;
mod membrane;
mod membrane_systems;
mod properties;
mod reduced;
mod reference;
mod systems;
