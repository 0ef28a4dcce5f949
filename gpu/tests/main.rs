//! The device against the processor. In one binary: each would link, and in part compile, everything below for itself.

mod axes_membranes;
mod common;
mod parity;
mod readback;
mod shaders;
mod steps;
mod two_levels;
