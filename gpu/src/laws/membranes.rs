//! Membranes of triangles and, over Gauss points, of quadrilaterals: twins of [`sinew_models::frame::triangles`] and
//! [`sinew_models::frame::quads`]. They go on while the tetrahedra of their
//! body recover.

use sinew_engine::isoparametric::{QuadRest, QuadVertices};
use sinew_engine::scalar::Scalar;
use sinew_models::frame::row::LawRow;
use sinew_models::frame::triangles::{
    MembraneCompressionModulus, MembraneData, MembraneFirstModulus, MembraneShearModulus,
};
use sinew_models::laws::membranes as membrane;

use super::{
    DeviceElement, DeviceLaw, ElementColumns, ElementSearch, STRETCH, TRIANGLES, compression_alone,
    push, row, three,
};

/// Three vertices; E_1 (m) and lambda (N/m), E_2 and mu, rest area (m^2) and kappa (N/m).
const MEMBRANE: DeviceElement = DeviceElement {
    vertices: 3,
    constants: 12,
    threads: 1,
    files: &[TRIANGLES, include_str!("../three_vertices.wgsl"), include_str!("membrane.wgsl")],
};

/// Four vertices; for every Gauss point, in order, what a triangle has.
const QUAD_MEMBRANE: DeviceElement = DeviceElement {
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
    DeviceLaw::new(law, MEMBRANE, [columns::<f64>, columns::<f32>], files)
}

const fn quads(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    DeviceLaw::new(law, QUAD_MEMBRANE, [quad_columns::<f64>, quad_columns::<f32>], files)
}

/// Triangles of a law in a body.
fn columns<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<MembraneData<S>, 3>(
        |(nodes, _, (a, b, area), lambda, mu, compression), data| {
            let [lambda, mu, compression] = [lambda.0, mu.0, compression.0].map(S::to_f64);
            let area = [area.0.to_f64(), compression, 0.0, 0.0];
            push(data, [row(three!(a), lambda), row(three!(b), mu), area]);
            nodes.0
        },
    )
}

/// Triangles of a pooled membrane with the compression term.
fn compression<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    compression_alone(columns::<S>(search), 9)
}

/// Quadrilaterals of a law in a body.
fn quad_columns<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = (
        &'static QuadVertices,
        &'static QuadRest<S>,
        &'static MembraneFirstModulus<S>,
        &'static MembraneShearModulus<S>,
        &'static MembraneCompressionModulus<S>,
    );
    search.columns::<Data<S>, 4>(|(nodes, rest, lambda, mu, compression), data| {
        // a point stands for twice the area of its triangle
        let moduli = [lambda.0, mu.0, compression.0].map(|m| (m + m).to_f64());
        let [lambda, mu, compression] = moduli;
        for q in 0..4 {
            let edge = |k: usize| rest.edges[k][q].to_f64();
            let area = [rest.half_area[q].to_f64(), compression, 0.0, 0.0];
            let [a, b] = [0, 3].map(|k| [edge(k), edge(k + 1), edge(k + 2)]);
            push(data, [row(a, lambda), row(b, mu), area]);
        }
        nodes.0
    })
}
