//! Pictures and pages. In one binary: each would link, and in part compile, everything below for itself.

mod camera;
mod colour;
mod common;
mod compare;
mod film;
mod golden;
mod image;
mod overlay;
mod page;
mod player;
mod rigid;
mod skin;
mod solids;
