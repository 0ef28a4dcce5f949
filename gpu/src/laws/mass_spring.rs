//! Springs on edges: twin of [`sinew_models::laws::quadratic::MassSpring`].

use sinew_engine::element::{EdgeVertices, RestEdges};
use sinew_engine::scalar::Scalar;
use sinew_models::laws::pooled::TensileStiffness;
use sinew_models::laws::quadratic::EDGE_SPRINGS;

use super::{DeviceLaw, EDGE, ElementColumns, ElementSearch, STRETCH, push, row, three};

/// The law.
pub static LAW: DeviceLaw = DeviceLaw::new(
    &EDGE_SPRINGS,
    EDGE,
    [edge_columns::<f64>, edge_columns::<f32>],
    &[STRETCH, include_str!("mass_spring.wgsl")],
);

/// Columns of the edges of a body that follow a law.
pub(super) fn edge_columns<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = (&'static EdgeVertices, RestEdges<S>, &'static TensileStiffness<S>);
    search.columns::<Data<S>, 2>(|(nodes, rest, stiffness), data| {
        push(data, [row(three!(rest), stiffness.0.to_f64())]);
        nodes.0
    })
}
