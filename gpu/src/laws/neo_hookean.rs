//! Stable neo-Hookean elasticity: twin of [`sinew_models::neo_hookean::NeoHookean`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::neo_hookean::NeoHookean;

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw =
    DeviceLaw::of_tetrahedra::<NeoHookean>(&[STRESS, include_str!("neo_hookean.wgsl")]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<NeoHookean, S>(world, body, first_row)
}
