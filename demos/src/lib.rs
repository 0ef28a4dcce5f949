//! Sinew demos.
pub mod validate;
