//! `sinew-bevy` without a window.

mod bodies;
mod common;
mod drawing;
mod inputs;
mod steps;
