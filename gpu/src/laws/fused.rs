//! Fused St Venant-Kirchhoff with compression term: twin of [`sinew_models::fused::FusedStVK`]; and, by the same
//! shader, the two laws that complete pooled springs.

use bevy_ecs::prelude::World;
use sinew_engine::scalar::Scalar;
use sinew_models::fused::{Compression, FusedStVK, PooledProjection};

use super::{DeviceLaw, ElementColumns, STRESS, tetrahedron_columns};

const FILES: &[&str] = &[STRESS, include_str!("fused.wgsl")];

/// The law.
pub const LAW: DeviceLaw = DeviceLaw::of_tetrahedra::<FusedStVK>(FILES);

/// The compression term of pooled bodies: the law with nothing but that modulus.
pub const COMPRESSION: DeviceLaw =
    DeviceLaw { volumes: false, ..DeviceLaw::of_tetrahedra::<Compression>(FILES) };

/// The projected tangent of pooled bodies. Its set is that of all their tetrahedra.
pub const PROJECTION: DeviceLaw = DeviceLaw::of_tetrahedra::<PooledProjection>(FILES);

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    tetrahedron_columns::<FusedStVK, S>(world, body, first_row)
}

/// Tetrahedra of a pooled body with the compression term; none where no element has it.
pub(super) fn compression<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = tetrahedron_columns::<Compression, S>(world, body, first_row);
    if columns.data.chunks_exact(12).all(|constants| constants[11] == 0.0) {
        return ElementColumns::default();
    }
    for constants in columns.data.chunks_exact_mut(12) {
        (constants[3], constants[7]) = (0.0, 0.0);
    }
    columns
}

/// Tetrahedra of a pooled body.
pub(super) fn projection<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    tetrahedron_columns::<PooledProjection, S>(world, body, first_row)
}
