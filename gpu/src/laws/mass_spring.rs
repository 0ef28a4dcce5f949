//! Springs on edges: twin of [`sinew_models::laws::quadratic::MassSpring`].

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryBuilder;
use sinew_engine::element::{EdgeVertices, RestEdges};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::laws::LawRow;
use sinew_models::laws::pooled::TensileStiffness;
use sinew_models::laws::quadratic::EDGE_SPRINGS;

use super::{DeviceLaw, EDGE, ElementColumns, STRETCH};

/// The law.
pub static LAW: DeviceLaw = DeviceLaw {
    row: &EDGE_SPRINGS,
    kind: EDGE,
    volumes: false,
    find: [edge_columns::<f64>, edge_columns::<f32>],
    files: &[STRETCH, include_str!("mass_spring.wgsl")],
};

/// Columns of the edges of a body that follow a law.
pub(super) fn edge_columns<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    type Data<S> =
        (&'static EdgeVertices, RestEdges<S>, &'static TensileStiffness<S>, &'static BodyId);
    let mut columns = ElementColumns::default();
    let mark = law.mark::<S>(world);
    let mut query = QueryBuilder::<Data<S>>::new(world);
    let mut query = query.with_id(mark).build();
    for (nodes, (x, y, z), stiffness, of) in query.iter(world) {
        if of.0 as usize == body {
            columns.nodes.extend(nodes.0.map(|row| row - first_row));
            columns.data.extend([x.0, y.0, z.0, stiffness.0].map(|x| x.to_f64() as f32));
        }
    }
    columns
}
