//! Membranes of triangles and, over Gauss points, of quadrilaterals: twins of [`sinew_models::fused_membrane`] and
//! [`sinew_models::quad`]. They go on while the tetrahedra of their
//! body recover.

use bevy_ecs::prelude::*;
use sinew_engine::isoparametric::{QuadRest, QuadVertices};
use sinew_engine::law::Law;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::fused_membrane::{
    BiquadraticMembrane, CorotationalMembrane, LinearMembrane, MembraneCompression,
    MembraneCompressionModulus, MembraneData, MembraneFirstModulus, MembraneShearModulus,
    PooledMembrane, QuadraticMembrane, TriangleLaw,
};
use sinew_models::quad::Quadrilateral;

use super::{DeviceLaw, ElementColumns, ElementKind, InRecovery, STRETCH, TRIANGLES};

/// Three vertices; E_1 (m) and lambda (N/m), E_2 and mu, rest area (m^2) and kappa (N/m).
const MEMBRANE: ElementKind = ElementKind {
    vertices: 3,
    constants: 12,
    threads: 1,
    files: &[TRIANGLES, include_str!("../three_vertices.wgsl"), include_str!("membrane.wgsl")],
};

/// Four vertices; for every Gauss point, in order, what a triangle has.
const QUAD_MEMBRANE: ElementKind = ElementKind {
    vertices: 4,
    constants: 4 * MEMBRANE.constants,
    threads: 1,
    files: &[
        include_str!("../corners.wgsl"),
        include_str!("../quads.wgsl"),
        include_str!("membrane.wgsl"),
    ],
};

const fn law<L: TriangleLaw>(files: &'static [&'static str]) -> DeviceLaw {
    DeviceLaw {
        recovery: InRecovery::Unchanged,
        forces: L::FORCES,
        tangent: L::contributes,
        ..DeviceLaw::of::<L>(MEMBRANE, files)
    }
}

const SPRINGS: &[&str] = &[include_str!("biquadratic_membrane.wgsl")];

/// Biquadratic springs.
pub const BIQUADRATIC: DeviceLaw = law::<BiquadraticMembrane>(SPRINGS);

/// The same at the points of quadrilaterals, and two more.
pub const QUAD_BIQUADRATIC: DeviceLaw = quad_law::<BiquadraticMembrane>(&BIQUADRATIC);
/// Constant strain at every point.
pub const QUAD_LINEAR: DeviceLaw = quad_law::<LinearMembrane>(&LINEAR);
/// Corotational at every point.
pub const QUAD_COROTATIONAL: DeviceLaw = quad_law::<CorotationalMembrane>(&COROTATIONAL);

/// The law of quadrilaterals to one of triangles.
const fn quad_law<L: TriangleLaw>(law: &DeviceLaw) -> DeviceLaw
where
    Quadrilateral<L>: Law,
{
    DeviceLaw {
        recovery: InRecovery::Unchanged,
        ..DeviceLaw::of::<Quadrilateral<L>>(QUAD_MEMBRANE, law.files)
    }
}

/// The compression term of pooled membranes: the law with nothing but that modulus.
pub const COMPRESSION: DeviceLaw = law::<MembraneCompression>(SPRINGS);

/// The projected tangent of pooled membranes.
pub const PROJECTION: DeviceLaw = law::<PooledMembrane>(SPRINGS);

/// Quadratic springs.
pub const QUADRATIC: DeviceLaw =
    law::<QuadraticMembrane>(&[STRETCH, include_str!("quadratic_membrane.wgsl")]);

/// Constant-strain triangles.
pub const LINEAR: DeviceLaw = law::<LinearMembrane>(&[include_str!("linear_membrane.wgsl")]);

/// Corotational triangles.
pub const COROTATIONAL: DeviceLaw =
    law::<CorotationalMembrane>(&[include_str!("corotational_membrane.wgsl")]);

/// Triangles of law `L` in a body.
pub(super) fn columns<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(MembraneData<S>, &BodyId), L::Bodies>();
    for ((nodes, _, (a, b, area), lambda, mu, compression), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        columns.nodes.extend(nodes.0.map(|row| row - first_row));
        let rows = [
            [a.0.0, a.1.0, a.2.0, lambda.0],
            [b.0.0, b.1.0, b.2.0, mu.0],
            [area.0, compression.0, S::ZERO, S::ZERO],
        ];
        columns.data.extend(rows.as_flattened().iter().map(|x| x.to_f64() as f32));
    }
    columns
}

/// Triangles of a pooled membrane with the compression term; none where no element has it.
pub(super) fn compression<S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = columns::<MembraneCompression, S>(world, body, first_row);
    if columns.data.chunks_exact(12).all(|constants| constants[9] == 0.0) {
        return ElementColumns::default();
    }
    for constants in columns.data.chunks_exact_mut(12) {
        (constants[3], constants[7]) = (0.0, 0.0);
    }
    columns
}

/// Quadrilaterals of law `L` in a body.
pub(super) fn quads<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns
where
    Quadrilateral<L>: Law,
{
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(
        &QuadVertices,
        &QuadRest<S>,
        &MembraneFirstModulus<S>,
        &MembraneShearModulus<S>,
        &MembraneCompressionModulus<S>,
        &BodyId,
    ), With<Quadrilateral<L>>>();
    for (nodes, rest, lambda, mu, compression, of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        columns.nodes.extend(nodes.0.map(|row| row - first_row));
        // a point stands for twice the area of its triangle
        let [lambda, mu, compression] = [lambda.0, mu.0, compression.0].map(|m| m + m);
        for q in 0..4 {
            let edge = |k: usize| rest.edges[k][q];
            let rows = [
                [edge(0), edge(1), edge(2), lambda],
                [edge(3), edge(4), edge(5), mu],
                [rest.half_area[q], compression, S::ZERO, S::ZERO],
            ];
            columns.data.extend(rows.as_flattened().iter().map(|x| x.to_f64() as f32));
        }
    }
    columns
}
