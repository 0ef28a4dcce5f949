//! Fused St Venant-Kirchhoff with compression term: twin of [`sinew_models::fused::FusedStVK`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::fused::FusedStVK;

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw =
    DeviceLaw::of_tetrahedra::<FusedStVK>(&[STRESS, include_str!("fused.wgsl")]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<FusedStVK, S>(world, body, first_row)
}
