//! Deformable soft tissue on `bevy_ecs`: a mesh, Young's modulus and Poisson's ratio become a body that is held, loaded,
//! touched, grasped and cut, with a stated error. Units are SI.
//!
//! # A first program
//!
//! ```
//! use sinew::engine::mesh::generate::box_tets;
//! use sinew::prelude::*;
//!
//! // build: 10 cm of liver tissue, held at its left end
//! let mesh = box_tets(DVec3::new(0.1, 0.02, 0.02), [10, 2, 2])?;
//! let mut simulation = Simulation::new(SimulationOptions::default())?;
//! let beam = simulation.add_body(&BodyDescription::new("beam", &mesh, preset("liver")?.material))?;
//! let left = simulation.group_rows(beam, &mesh, "x0")?;
//! simulation.add_constraint(Constraint::hold("wall", left));
//! // step: 0.1 s, in which its free end falls
//! for _ in 0..10 {
//!     simulation.step()?;
//! }
//! // read: the end of a falling rod outruns a stone (49 mm), by half of that at most
//! let positions = simulation.positions(beam);
//! let right = &mesh.group("x1").ok_or("no such group")?.vertices;
//! let fallen = 0.01 - right.iter().map(|&i| positions[i as usize].z).sum::<f64>() / right.len() as f64;
//! assert!(0.049 < fallen && fallen < 1.5 * 0.0491, "{fallen}");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to go
//!
//! | to | open |
//! |---|---|
//! | build, step and read a simulation without a window | [`Simulation`], [`SimulationOptions`](simulation::SimulationOptions) |
//! | read a mesh, check it, name groups | [`Mesh`], [`check`](engine::mesh::check()), [`generate`](engine::mesh::generate) |
//! | say what a body is made of | [`BodyDescription`], [`YoungPoisson`](models::material::YoungPoisson), [`Model`](models::body::Model) |
//! | hold, move, load and blow up | [`Constraint`](engine::load::Constraint), [`Load`](engine::load::Load), [`traction_faces`](simulation::Simulation::traction_faces), [`Pressure`](engine::load::Pressure) |
//! | press, drag, grasp; let bodies touch; pull with a mouse | [`Tool`], [`BodyContact`](touch::pair::BodyContact), [`Pull`](touch::pull::Pull) |
//! | cut, remove | [`Simulation::cut`], [`models::cutting`]; [`Simulation::remove_elements`], [`models::resection`] |
//! | choose integrator, damping and tolerances | [`SolverSettings`](solvers::settings::SolverSettings), [`Integrator`](solvers::settings::Integrator) |
//! | keep a rate, read states on another thread | [`live`] |
//! | let a haptic device hold tissue | [`haptics`] |
//! | go back, keep a state, do a session again | [`snapshot`], [`replay`] |
//! | know what went wrong or looks unintended, and whether to trust a run | [`Simulation::warnings`], [`Simulation::verdict`], [`warning`] |
//! | know what a step did | [`StepReport`](engine::report::StepReport), [`VolumeReport`](engine::report::VolumeReport) |
//! | run it in a Bevy app | [`SinewPlugins`] |
//! | add a law of your own | [`Model::Own`](models::body::Model::Own), [`models::laws`] |
//!
//! [`prelude`] has what a first program needs. The repository has ten small programs in `examples`, explained in
//! `docs/first-hour.md`; scene files and the command `sinew` need no Rust at all.
//!
//! # One step
//!
//! A step runs the sets of [`StepSystems`](engine::schedule::StepSystems) in order:
//!
//! 1. `Edit` removes the elements that were asked for, and opens what blades went through.
//! 2. `Prepare` turns constraints and loads into what vertices bear at the end of the step.
//! 3. `Integrate` is the integrator. It asks the laws for energy, forces and tangent as often as it needs them.
//! 4. `Constrain` is empty: systems of yours that correct the new state.
//! 5. `Report` writes what the step did.
//! 6. `Writeback` writes positions for readers and moves the clock.
//!
//! # Features
//!
//! `gpu` computes forces and steps on a graphics processor ([`Backend::Gpu`](simulation::Backend::Gpu)). `direct` factorises
//! linear systems.
//!
//! [`Simulation`]: simulation::Simulation
//! [`Simulation::cut`]: simulation::Simulation::cut
//! [`Simulation::remove_elements`]: simulation::Simulation::remove_elements
//! [`Simulation::warnings`]: simulation::Simulation::warnings
//! [`Simulation::verdict`]: simulation::Simulation::verdict
//! [`Mesh`]: engine::mesh::Mesh
//! [`BodyDescription`]: models::body::BodyDescription
//! [`Tool`]: touch::tool::Tool

// first, because its page begins with what a first program calls
pub mod simulation;

mod axes;
mod blade;
mod contact;
mod cutting;
pub mod haptics;
pub mod live;
mod needle;
pub mod plugin;
pub mod replay;
mod resection;
mod slots;
pub mod snapshot;
mod tear;
mod thread;
pub mod warning;

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
    pub use sinew_contact::edge::Edge;
    pub use sinew_contact::needle::Needle;
    pub use sinew_contact::pair::BodyContact;
    pub use sinew_contact::pull::Pull;
    pub use sinew_contact::shape::Shape;
    pub use sinew_contact::thread::{Clip, Hold, Thread};
    pub use sinew_contact::tool::{Tool, ToolPose};
    pub use sinew_engine::load::{Constraint, Curve, Load, Motion, Pose};
    pub use sinew_engine::mesh::{CheckOptions, Mesh, check};
    pub use sinew_engine::precision::Precision;
    pub use sinew_engine::row::{MeshVertex, VertexRow};
    pub use sinew_engine::step::StepClock;
    pub use sinew_models::body::{BodyDescription, Model, spawn_body};
    pub use sinew_models::cutting::tear::{Tear, TearReport};
    pub use sinew_models::material::{YoungPoisson, preset};
    pub use sinew_solvers::settings::{Integrator, SolverSettings};
}

/// The program of the README runs as a test of the documentation.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
mod readme {}
