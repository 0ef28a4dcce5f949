//! Whole simulations. In one binary: each would link, and in part compile, everything below for itself.

mod axes;
mod bad_input;
mod clusters;
mod common;
mod comparison_models;
mod contact;
mod cross;
mod determinism;
mod documents;
mod elements;
mod explicit;
mod host;
mod linear;
mod material_field;
mod overload;
mod patch;
mod physics;
mod pressure;
mod recovery;
mod reference;
mod resection;
mod schedule;
mod second_order;
mod snapshot;
mod units;
