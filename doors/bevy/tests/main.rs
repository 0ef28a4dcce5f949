//! `sinew-bevy` without a window.

mod bodies;
mod carried;
mod common;
mod drawing;
mod inputs;
mod steps;
