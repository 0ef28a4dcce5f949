//! St Venant-Kirchhoff as in textbooks: twin of [`sinew_models::stvk_fem::StVKFem`].
//! The shader is that of [`super::fused`]: the same energy, in a form of its own on the CPU for comparison of cost.

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::stvk_fem::StVKFem;

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw =
    DeviceLaw::of_tetrahedra::<StVKFem>(&[STRESS, include_str!("fused.wgsl")]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<StVKFem, S>(world, body, first_row)
}
