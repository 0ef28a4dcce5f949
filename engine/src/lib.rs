//! Sinew engine: mesh data, ECS layout, schedule, gather and block matrix.
pub mod mesh;
pub mod scalar;
