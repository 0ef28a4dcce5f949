//! Laws of tetrahedra, and the same at the Gauss points of hexahedra: a row each.

use sinew_engine::isoparametric::{HexahedronRest, HexahedronVertices};
use sinew_engine::scalar::Scalar;
use sinew_models::frame::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use sinew_models::frame::row::LawRow;
use sinew_models::frame::tetrahedra::TetrahedronData;
use sinew_models::laws::{corotational, linear, neo_hookean, quadratic, stvk_fem, svk, svk_volume};

use super::{
    DEFORMATION, DeviceElement, DeviceLaw, ElementColumns, ElementSearch, FOUR_VERTICES,
    PROJECTION, STRESS, STRETCH, TETRAHEDRA, VOLUMES, compression_alone, points, push, row, three,
};

/// Four vertices; D_1 (1/m) and lambda V (J), D_2 and mu V, D_3 and kappa V.
pub const TETRAHEDRON: DeviceElement = DeviceElement {
    vertices: 4,
    constants: 12,
    threads: 1,
    files: &[
        TETRAHEDRA,
        FOUR_VERTICES,
        DEFORMATION,
        include_str!("../tetrahedron.wgsl"),
        PROJECTION,
        include_str!("../tetrahedron_volumes.wgsl"),
        VOLUMES,
    ],
};

/// Hexahedra, eight threads each.
pub(super) const HEXAHEDRA: &str =
    concat!(include_str!("../corners.wgsl"), include_str!("../hexahedra.wgsl"));

/// Eight vertices; for every Gauss point, in order, what a tetrahedron has.
pub const HEXAHEDRON: DeviceElement = DeviceElement {
    vertices: 8,
    constants: 8 * TETRAHEDRON.constants,
    threads: 8,
    files: &[
        HEXAHEDRA,
        DEFORMATION,
        include_str!("../tetrahedron.wgsl"),
        PROJECTION,
        include_str!("../hexahedron_volumes.wgsl"),
        VOLUMES,
    ],
};

const FUSED: &[&str] = &[STRESS, include_str!("fused.wgsl")];
const LINEAR: &[&str] = &[STRESS, include_str!("linear.wgsl")];
const COROTATIONAL: &[&str] =
    &[STRESS, include_str!("polar.wgsl"), include_str!("corotational.wgsl")];
const WARPED: &[&str] = &[STRESS, include_str!("polar.wgsl"), include_str!("warped.wgsl")];
const NEO_HOOKEAN: &[&str] = &[STRESS, include_str!("neo_hookean.wgsl")];
const SVK_VOLUME: &[&str] = &[STRESS, include_str!("svk_volume.wgsl")];

/// The law that stands in for those of tetrahedra while a body recovers.
pub(super) static COROTATIONAL_TETRAHEDRA: DeviceLaw =
    tetrahedra(&corotational::TETRAHEDRA, COROTATIONAL);
/// The law that stands in for those of hexahedra.
pub(super) static COROTATIONAL_HEXAHEDRA: DeviceLaw =
    hexahedra(&corotational::HEXAHEDRA, COROTATIONAL);

/// The laws; the textbook form of St Venant-Kirchhoff has the shader of the fused one, since it is the same
/// energy, in a form of its own on the processor for comparison of cost.
pub(super) static LAWS: &[DeviceLaw] = &[
    tetrahedra(&svk::TETRAHEDRA, FUSED),
    DeviceLaw {
        volumes: false,
        find: [compression::<f64>, compression::<f32>],
        ..tetrahedra(&svk::COMPRESSION, FUSED)
    },
    // its set is that of all tetrahedra of pooled bodies
    tetrahedra(&svk::PROJECTION, FUSED),
    tetrahedra(&stvk_fem::TETRAHEDRA, FUSED),
    tetrahedra(&quadratic::TETRAHEDRA, &[STRETCH, include_str!("quadratic.wgsl")]),
    tetrahedra(&linear::TETRAHEDRA, LINEAR),
    tetrahedra(&corotational::WARPED_TETRAHEDRA, WARPED),
    tetrahedra(&corotational::TETRAHEDRA, COROTATIONAL),
    tetrahedra(&neo_hookean::TETRAHEDRA, NEO_HOOKEAN),
    tetrahedra(&svk_volume::TETRAHEDRA, SVK_VOLUME),
    hexahedra(&svk::HEXAHEDRA, FUSED),
    hexahedra(&linear::HEXAHEDRA, LINEAR),
    hexahedra(&corotational::HEXAHEDRA, COROTATIONAL),
    hexahedra(&neo_hookean::HEXAHEDRA, NEO_HOOKEAN),
    hexahedra(&svk_volume::HEXAHEDRA, SVK_VOLUME),
];

const fn tetrahedra(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    let find = [tetrahedron_columns::<f64>, tetrahedron_columns::<f32>];
    DeviceLaw { volumes: true, ..DeviceLaw::new(law, TETRAHEDRON, find, files) }
}

const fn hexahedra(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    let find = [hexahedron_columns::<f64>, hexahedron_columns::<f32>];
    DeviceLaw { volumes: true, ..DeviceLaw::new(law, HEXAHEDRON, find, files) }
}

/// Constants of a [`TETRAHEDRON`] from its shape vectors (1/m), moduli (Pa) and volume (m^3).
fn rows(d: [[f64; 3]; 3], moduli: [f64; 3], volume: f64) -> [[f64; 4]; 3] {
    std::array::from_fn(|i| row(d[i], moduli[i] * volume))
}

fn tetrahedron_columns<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<TetrahedronData<S>, 4>(
        |(nodes, _, d, volume, lambda, mu, compression), data| {
            let moduli = [lambda.0, mu.0, compression.0].map(S::to_f64);
            let d = [three!(d.0), three!(d.1), three!(d.2)];
            push(data, rows(d, moduli, volume.0.to_f64()));
            nodes.0
        },
    )
}

/// Tetrahedra of a pooled body with the compression term.
fn compression<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    compression_alone(tetrahedron_columns::<S>(search), 11)
}

fn hexahedron_columns<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = (
        &'static HexahedronVertices,
        &'static HexahedronRest<S>,
        &'static FirstLameParameter<S>,
        &'static ShearModulus<S>,
        &'static CompressionModulus<S>,
    );
    search.columns::<Data<S>, 8>(|(nodes, rest, lambda, mu, compression), data| {
        let moduli = [lambda.0, mu.0, compression.0].map(S::to_f64);
        for (d, volume) in points(rest) {
            push(data, rows(d, moduli, volume));
        }
        nodes.0
    })
}
