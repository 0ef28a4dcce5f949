//! Dampers along axes: twins of [`sinew_models::axes::damper`]. Their matrix is frozen where a step begins, with
//! that of stiffness damping.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::AxisHexahedronVertices;
use sinew_engine::law::Law;
use sinew_engine::vertex::BodyId;
use sinew_models::axes::damper::{AxialDamper, AxialDampers};
use sinew_models::axes::site::AxisSite;

use super::{DeviceLaw, ElementColumns, ElementKind, InRecovery};

const fn law<L: Law>(vertices: usize, files: &'static [&'static str]) -> DeviceLaw {
    let kind = ElementKind { vertices, constants: vertices + 4, threads: 1, files };
    DeviceLaw {
        recovery: InRecovery::Unchanged,
        forces: false,
        tangent: |_| false,
        is_damper: true,
        ..DeviceLaw::of::<L>(kind, &[include_str!("dampers.wgsl")])
    }
}

/// In tetrahedra.
pub const IN_TETRAHEDRA: DeviceLaw =
    law::<AxialDampers<AxisVertices>>(4, &["const VERTICES: u32 = 4u;\n"]);
/// In hexahedra.
pub const IN_HEXAHEDRA: DeviceLaw =
    law::<AxialDampers<AxisHexahedronVertices>>(8, &["const VERTICES: u32 = 8u;\n"]);

/// Dampers of a body in elements of `N` vertices: q_a, a and V eta.
pub(super) fn columns<const N: usize, V: AxisSite<N>>(
    world: &mut World,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(&V, &AxialDamper<N>, &BodyId)>();
    for (site, damper, of) in query.iter(world) {
        if of.0 as usize == body {
            let [x, y, z] = damper.axis;
            columns.nodes.extend(site.rows().map(|row| row - first_row));
            columns.data.extend(damper.shape.map(|q| q as f32));
            columns.data.extend([x, y, z, damper.viscosity].map(|x| x as f32));
        }
    }
    columns
}
