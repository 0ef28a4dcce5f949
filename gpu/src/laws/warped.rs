//! Stiffness warping: twin of [`sinew_models::corotational::WarpedStiffness`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::corotational::WarpedStiffness;

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw = DeviceLaw::of_tetrahedra::<WarpedStiffness>(&[
    STRESS,
    include_str!("polar.wgsl"),
    include_str!("warped.wgsl"),
]);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<WarpedStiffness, S>(world, body, first_row)
}
