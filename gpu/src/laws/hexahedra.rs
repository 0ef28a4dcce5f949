//! Laws of tetrahedra at the Gauss points of hexahedra: twins of [`sinew_models::hexahedron::Hexahedral`].

use bevy_ecs::prelude::*;
use sinew_engine::isoparametric::{HexahedronRest, HexahedronVertices};
use sinew_engine::law::Law;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::corotational::Corotational;
use sinew_models::fused::{
    CompressionModulus, FirstLameParameter, FusedStVK, ShearModulus, TetrahedronLaw,
};
use sinew_models::hexahedron::Hexahedral;
use sinew_models::linear::Linear;
use sinew_models::neo_hookean::NeoHookean;

use super::{
    DEFORMATION, DeviceLaw, ElementColumns, ElementKind, InRecovery, PROJECTION, TETRAHEDRON,
    VOLUMES, corotational, fused, linear, neo_hookean, push_tetrahedron,
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

/// St Venant-Kirchhoff with compression term.
pub const STVK: DeviceLaw = of::<FusedStVK>(&fused::LAW);
/// Linear elasticity.
pub const LINEAR: DeviceLaw = of::<Linear>(&linear::LAW);
/// Corotational elasticity.
pub const COROTATIONAL: DeviceLaw = DeviceLaw {
    recovery: InRecovery::Unchanged,
    volumes: true,
    ..DeviceLaw::of::<Hexahedral<Corotational>>(HEXAHEDRON, corotational::LAW.files)
};
/// Stable neo-Hookean elasticity.
pub const NEO_HOOKEAN: DeviceLaw = of::<NeoHookean>(&neo_hookean::LAW);

/// The law of hexahedra to one of tetrahedra.
const fn of<L: TetrahedronLaw>(law: &DeviceLaw) -> DeviceLaw
where
    Hexahedral<L>: Law,
{
    DeviceLaw {
        recovery: InRecovery::StandIn(&COROTATIONAL),
        volumes: true,
        ..DeviceLaw::of::<Hexahedral<L>>(HEXAHEDRON, law.files)
    }
}

/// Its elements in a body.
pub(super) fn columns<L: TetrahedronLaw, S: Scalar>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns
where
    Hexahedral<L>: Law,
{
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(
        &HexahedronVertices,
        &HexahedronRest<S>,
        &FirstLameParameter<S>,
        &ShearModulus<S>,
        &CompressionModulus<S>,
        &BodyId,
    ), With<Hexahedral<L>>>();
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
