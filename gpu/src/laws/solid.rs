//! Laws of tetrahedra, and the same at the Gauss points of hexahedra: a row each.

use bevy_ecs::prelude::*;
use bevy_ecs::query::QueryBuilder;
use sinew_engine::isoparametric::{HexahedronRest, HexahedronVertices};
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::frame::tetrahedra::{
    CompressionModulus, FirstLameParameter, ShearModulus, TetrahedronData,
};
use sinew_models::laws::{
    LawRow, corotational, linear, neo_hookean, quadratic, stvk_fem, svk, svk_volume,
};

use super::{
    DEFORMATION, DeviceLaw, ElementColumns, ElementKind, FOUR_VERTICES, PROJECTION, STRESS,
    STRETCH, TETRAHEDRA, VOLUMES,
};

/// Four vertices; D_1 (1/m) and lambda V (J), D_2 and mu V, D_3 and kappa V.
pub const TETRAHEDRON: ElementKind = ElementKind {
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
pub const HEXAHEDRON: ElementKind = ElementKind {
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
    DeviceLaw { row: law, kind: TETRAHEDRON, volumes: true, find, files }
}

const fn hexahedra(law: &'static LawRow, files: &'static [&'static str]) -> DeviceLaw {
    let find = [hexahedron_columns::<f64>, hexahedron_columns::<f32>];
    DeviceLaw { row: law, kind: HEXAHEDRON, volumes: true, find, files }
}

fn tetrahedron_columns<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mark = law.mark::<S>(world);
    let mut query = QueryBuilder::<(TetrahedronData<S>, &BodyId)>::new(world);
    let mut query = query.with_id(mark).build();
    for ((nodes, _, (d1, d2, d3), volume, lambda, mu, compression), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        let d = [d1.0.0, d1.1.0, d1.2.0, d2.0.0, d2.1.0, d2.2.0, d3.0.0, d3.1.0, d3.2.0];
        columns.nodes.extend(nodes.0.map(|row| row - first_row));
        push_tetrahedron(&mut columns.data, d, volume.0, [lambda.0, mu.0, compression.0]);
    }
    columns
}

/// Appends the constants of a [`TETRAHEDRON`] from its shape vectors (1/m), volume (m^3) and moduli (Pa).
fn push_tetrahedron<S: Scalar>(data: &mut Vec<f32>, d: [S; 9], volume: S, moduli: [S; 3]) {
    for (d, modulus) in d.chunks_exact(3).zip(moduli) {
        data.extend(d.iter().map(|x| x.to_f64() as f32));
        // in f64, rounded once
        data.push((modulus.to_f64() * volume.to_f64()) as f32);
    }
}

/// Tetrahedra of a pooled body with nothing but the modulus of the compression term; none where no element
/// has it.
fn compression<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = tetrahedron_columns::<S>(world, law, body, first_row);
    if columns.data.chunks_exact(12).all(|constants| constants[11] == 0.0) {
        return ElementColumns::default();
    }
    for constants in columns.data.chunks_exact_mut(12) {
        (constants[3], constants[7]) = (0.0, 0.0);
    }
    columns
}

fn hexahedron_columns<S: Scalar>(
    world: &mut World,
    law: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    type Data<S> = (
        &'static HexahedronVertices,
        &'static HexahedronRest<S>,
        &'static FirstLameParameter<S>,
        &'static ShearModulus<S>,
        &'static CompressionModulus<S>,
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
        for q in 0..8 {
            let d = std::array::from_fn(|k| rest.gradients[k][q]);
            let moduli = [lambda.0, mu.0, compression.0];
            push_tetrahedron(&mut columns.data, d, rest.volume[q], moduli);
        }
    }
    columns
}
