//! Dampers along axes: twins of [`sinew_models::axes::damper`]. Their matrix is frozen where a step begins, with
//! that of stiffness damping.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::AxisHexahedronVertices;
use sinew_engine::vertex::BodyId;
use sinew_models::axes::damper::{self, AxialDamper};
use sinew_models::axes::site::AxisSite;
use sinew_models::laws::LawRow;

use super::{DeviceLaw, ElementColumns, ElementKind, Find};

/// In tetrahedra and in hexahedra.
pub(super) static LAWS: &[DeviceLaw] = &[
    law((&damper::IN_TETRAHEDRA, columns::<4, AxisVertices>), 4, &["const VERTICES: u32 = 4u;\n"]),
    law(
        (&damper::IN_HEXAHEDRA, columns::<8, AxisHexahedronVertices>),
        8,
        &["const VERTICES: u32 = 8u;\n"],
    ),
];

const fn law(
    (law, find): (&'static LawRow, Find),
    vertices: usize,
    files: &'static [&'static str],
) -> DeviceLaw {
    let kind = ElementKind { vertices, constants: vertices + 4, threads: 1, files };
    let files = &[include_str!("dampers.wgsl")];
    DeviceLaw { row: law, kind, volumes: false, find: [find; 2], files }
}

/// Dampers of a body in elements of `N` vertices: q_a, a and V eta.
fn columns<const N: usize, V: AxisSite<N>>(
    world: &mut World,
    _: &LawRow,
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
