#![doc = include_str!("../README.md")]

mod axes;
mod contact;
pub mod plugin;
pub mod replay;
mod resection;
pub mod simulation;
pub mod snapshot;

pub use plugin::SinewPlugins;

pub use sinew_contact as touch;
pub use sinew_engine as engine;
#[cfg(feature = "gpu")]
pub use sinew_gpu as gpu;
pub use sinew_identify as identify;
pub use sinew_models as models;
pub use sinew_solvers as solvers;

/// What a first program needs.
pub mod prelude {
    pub use crate::plugin::SinewPlugins;
    pub use crate::simulation::{BodyHandle, Simulation, SimulationOptions};
    pub use glam::{DQuat, DVec3};
    pub use sinew_contact::pair::BodyContact;
    pub use sinew_contact::pull::Pull;
    pub use sinew_contact::shape::Shape;
    pub use sinew_contact::tool::{Tool, ToolPose};
    pub use sinew_engine::load::{Constraint, Curve, Load, Motion, Pose};
    pub use sinew_engine::mesh::{CheckOptions, Mesh, check};
    pub use sinew_engine::precision::Precision;
    pub use sinew_engine::step::StepClock;
    pub use sinew_models::body::{BodyDescription, Model, spawn_body};
    pub use sinew_models::material::{YoungPoisson, preset};
    pub use sinew_solvers::settings::{Integrator, SolverSettings};
}

/// The shipped example runs as a test of the documentation.
#[cfg(doctest)]
#[doc = concat!("```\n", include_str!("../examples/liver.rs"), "\n```")]
mod liver {}
