//! Membranes of triangles and, over Gauss points, of quadrilaterals: twins of [`sinew_models::frame::triangles`] and
//! [`sinew_models::frame::quads`]. They go on while the tetrahedra of their
//! body recover.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryBuilder;
use sinew_engine::isoparametric::{QuadRest, QuadVertices};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::frame::triangles::{
    MembraneCompressionModulus, MembraneData, MembraneFirstModulus, MembraneShearModulus,
};
use sinew_models::laws::{LawRow, membranes as membrane};

use super::{DeviceLaw, ElementColumns, ElementKind, STRETCH, TRIANGLES};

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

const SPRINGS: &[&str] = &[include_str!("biquadratic_membrane.wgsl")];
const LINEAR: &[&str] = &[include_str!("linear_membrane.wgsl")];
const COROTATIONAL: &[&str] = &[include_str!("corotational_membrane.wgsl")];

/// The laws.
pub(super) static LAWS: &[DeviceLaw] = &[
    triangles(&membrane::BIQUADRATIC, SPRINGS),
    triangles(&membrane::QUADRATIC, &[STRETCH, include_str!("quadratic_membrane.wgsl")]),
    triangles(&membrane::LINEAR, LINEAR),
    triangles(&membrane::COROTATIONAL, COROTATIONAL),
    DeviceLaw {
        find: [compression::<f64>, compression::<f32>],
        ..triangles(&membrane::COMPRESSION, SPRINGS)
    },
    triangles(&membrane::PROJECTION, SPRINGS),
    quads(&membrane::BIQUADRATIC_QUADS, SPRINGS),
    quads(&membrane::LINEAR_QUADS, LINEAR),
    quads(&membrane::COROTATIONAL_QUADS, COROTATIONAL),
];

const fn triangles(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    let find = [columns::<f64>, columns::<f32>];
    DeviceLaw { row: law, kind: MEMBRANE, volumes: false, find, files }
}

const fn quads(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    let find = [quad_columns::<f64>, quad_columns::<f32>];
    DeviceLaw { row: law, kind: QUAD_MEMBRANE, volumes: false, find, files }
}

/// Triangles of a law in a body.
fn columns<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mark = law.mark::<S>(world);
    let mut query = QueryBuilder::<(MembraneData<S>, &BodyId)>::new(world);
    let mut query = query.with_id(mark).build();
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
fn compression<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = columns::<S>(world, law, body, first_row);
    if columns.data.chunks_exact(12).all(|constants| constants[9] == 0.0) {
        return ElementColumns::default();
    }
    for constants in columns.data.chunks_exact_mut(12) {
        (constants[3], constants[7]) = (0.0, 0.0);
    }
    columns
}

/// Quadrilaterals of a law in a body.
fn quad_columns<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    type Data<S> = (
        &'static QuadVertices,
        &'static QuadRest<S>,
        &'static MembraneFirstModulus<S>,
        &'static MembraneShearModulus<S>,
        &'static MembraneCompressionModulus<S>,
        &'static BodyId,
    );
    let mut columns = ElementColumns::default();
    let mark = law.mark::<S>(world);
    let mut query = QueryBuilder::<Data<S>>::new(world);
    let mut query = query.with_id(mark).build();
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
