//! Sinew solvers: time integrators and linear solvers. They know vertex columns, force totals and
//! tangents, never a law.

pub mod settings;

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;

/// Installs the integrator system.
pub fn install_solver<S: Scalar>(_world: &mut World) {}
