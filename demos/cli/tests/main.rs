//! The command. In one binary: each would link everything below for itself.

mod command;
mod common;
mod fill;
mod sweep;
