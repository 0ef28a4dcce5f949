#![doc = include_str!("../README.md")]

mod axes;
pub mod plugin;
mod resection;
pub mod simulation;

pub use plugin::SinewPlugins;

pub use sinew_engine as engine;
#[cfg(feature = "gpu")]
pub use sinew_gpu as gpu;
pub use sinew_identify as identify;
pub use sinew_models as models;
pub use sinew_solvers as solvers;

/// What a first program needs.
pub mod prelude {
    pub use crate::plugin::SinewPlugins;
    pub use crate::simulation::{
        Backend, BodyHandle, MaterialChange, Readback, Simulation, SimulationError,
        SimulationOptions,
    };
    pub use glam::{DQuat, DVec3};
    pub use sinew_engine::lanes::InstructionSet;
    pub use sinew_engine::load::{Constraint, Curve, Load, Motion, Pose, Pressure};
    pub use sinew_engine::mesh::{CheckOptions, Mesh, check};
    pub use sinew_engine::precision::Precision;
    pub use sinew_engine::report::{StepReport, VolumeReport};
    pub use sinew_engine::step::{StepClock, StepError};
    pub use sinew_models::axes::description::{AxesDescription, AxisAngle, AxisFamily, AxisForm};
    pub use sinew_models::axes::muscle::MuscleSettings;
    pub use sinew_models::body::{BodyDescription, BodyError, Evaluation, Model, spawn_body};
    pub use sinew_models::field::{FieldError, MaterialField};
    pub use sinew_models::material::{MaterialError, YoungPoisson, preset, presets};
    pub use sinew_models::resection::{MassPolicy, Region, Removal, RemovalError, RemovalReport};
    pub use sinew_solvers::settings::{Integrator, SolverSettings};
}
