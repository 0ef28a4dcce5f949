//! Tetrahedral quadratic springs: twin of [`sinew_models::quadratic::QuadraticSprings`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::quadratic::QuadraticSprings;

use super::{DeviceLaw, ElementColumns, STRETCH, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw =
    DeviceLaw::of_tetrahedra::<QuadraticSprings>(&[STRETCH, include_str!("quadratic.wgsl")]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<QuadraticSprings, S>(world, body, first_row)
}
