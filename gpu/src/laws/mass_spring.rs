//! Springs on edges: twin of [`sinew_models::quadratic::MassSpring`].

use bevy_ecs::prelude::*;
use bevy_ecs::query::ArchetypeFilter;
use sinew_engine::element::{EdgeVertices, RestEdges};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::pooled::TensileStiffness;
use sinew_models::quadratic::MassSpring;

use super::{DeviceLaw, EDGE, ElementColumns, InRecovery, STRETCH};

/// The law.
pub const LAW: DeviceLaw = DeviceLaw {
    // on bodies that never recover, or beside a solid that does
    recovery: InRecovery::Unchanged,
    ..DeviceLaw::of::<MassSpring>(EDGE, &[STRETCH, include_str!("mass_spring.wgsl")])
};

/// Its elements in a body.
pub(super) fn columns<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    edge_columns::<With<MassSpring>, S>(world, body, first_row)
}

/// Columns of an [`EDGE`] law from the edges of a body that `F` selects.
pub(super) fn edge_columns<F: ArchetypeFilter, S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query =
        world.query_filtered::<(&EdgeVertices, RestEdges<S>, &TensileStiffness<S>, &BodyId), F>();
    for (nodes, (x, y, z), stiffness, of) in query.iter(world) {
        if of.0 as usize == body {
            columns.nodes.extend(nodes.0.map(|row| row - first_row));
            columns.data.extend([x.0, y.0, z.0, stiffness.0].map(|x| x.to_f64() as f32));
        }
    }
    columns
}
