//! Dampers along axes: twins of [`sinew_models::axes::damper`]. Their matrix is frozen where a step begins, with
//! that of stiffness damping.

use sinew_engine::element::AxisVertices;
use sinew_engine::isoparametric::AxisHexahedronVertices;
use sinew_models::axes::damper::{self, AxialDamper};
use sinew_models::axes::site::AxisSite;
use sinew_models::frame::row::LawRow;

use super::{DeviceElement, DeviceLaw, ElementColumns, ElementSearch, Find};

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
    let kind = DeviceElement { vertices, constants: vertices + 4, threads: 1, files };
    DeviceLaw::new(law, kind, [find; 2], &[include_str!("dampers.wgsl")])
}

/// Dampers of a body in elements of `N` vertices: q_a, a and V eta.
fn columns<const N: usize, V: AxisSite<N>>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<(&V, &AxialDamper<N>), N>(|(site, damper), data| {
        let [x, y, z] = damper.axis;
        data.extend(damper.shape.map(|q| q as f32));
        data.extend([x, y, z, damper.viscosity].map(|x| x as f32));
        *site.rows()
    })
}
