//! Pictures and pages. In one binary: each would link, and in part compile, everything below for itself.

mod common;
mod golden;
mod player;
