//! Linear elasticity: twin of [`sinew_models::linear::Linear`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::linear::Linear;

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw =
    DeviceLaw::of_tetrahedra::<Linear>(&[STRESS, include_str!("linear.wgsl")]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<Linear, S>(world, body, first_row)
}
