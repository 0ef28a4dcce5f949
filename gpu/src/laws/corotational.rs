//! Corotational elasticity: twin of [`sinew_models::corotational::Corotational`].

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::corotational::Corotational;

use super::{DeviceLaw, ElementColumns, InRecovery, STRESS, TETRAHEDRON, tetrahedron_columns};

/// The law.
pub const LAW: DeviceLaw = DeviceLaw {
    recovery: InRecovery::Unchanged,
    volumes: true,
    ..DeviceLaw::of::<Corotational>(
        TETRAHEDRON,
        &[STRESS, include_str!("polar.wgsl"), include_str!("corotational.wgsl")],
    )
};

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<Corotational, S>(world, body, first_row)
}
