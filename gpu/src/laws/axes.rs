//! Axes in tetrahedra and at the Gauss points of hexahedra: twins of [`sinew_models::axes::systems`] and
//! [`sinew_models::axes::points`]. They are silent while their body recovers.

use sinew_engine::isoparametric::{AxisHexahedronBlocks, AxisHexahedronVertices};
use sinew_engine::scalar::{Scalar, dot};
use sinew_models::axes::columns::{BiquadraticData, FibreData, TriadData, VolumeData};
use sinew_models::axes::{points as bricks, systems};
use sinew_models::frame::row::LawRow;

use super::solid::HEXAHEDRA;
use super::{
    DEFORMATION, DeviceElement, DeviceLaw, ElementColumns, ElementSearch, FOUR_VERTICES, Find,
    TETRAHEDRA, VERTEX_FORCES, points, push, row, three,
};

const CHORD: &str = include_str!("chord.wgsl");
const VOLUME_TERM: &str = include_str!("volume_term.wgsl");
const TRIAD_FILES: &[&str] = &[VERTEX_FORCES, CHORD, VOLUME_TERM, include_str!("triads.wgsl")];
const FIBRE_FILES: &[&str] = &[CHORD, include_str!("fibres.wgsl")];
const BIQUADRATIC_FILES: &[&str] = &[include_str!("biquadratic_fibres.wgsl")];
const VOLUME_FILES: &[&str] =
    &[VERTEX_FORCES, VOLUME_TERM, include_str!("volume_preservation.wgsl")];

const TETRAHEDRON: &[&str] = &[TETRAHEDRA, FOUR_VERTICES, DEFORMATION];
const HEXAHEDRON: &[&str] = &[HEXAHEDRA, DEFORMATION];
/// Fibres know the deformation along themselves only.
const ALONG: [&[&str]; 2] = [&[TETRAHEDRA, FOUR_VERTICES], &[HEXAHEDRA]];

/// Triads of axes with their angles and the term of volume, single fibres, biquadratic ones, the term of volume alone;
/// each in tetrahedra and in hexahedra; and the projected tangent of pooled fibres. With the law its rows of four constants of an element or point.
pub(super) static LAWS: &[DeviceLaw] = &[
    law(4, (&systems::TRIADS, 7), [triads::<f64>, triads::<f32>], TETRAHEDRON, TRIAD_FILES),
    law(4, (&systems::FIBRES, 3), [fibres::<f64>, fibres::<f32>], ALONG[0], FIBRE_FILES),
    law(
        4,
        (&systems::BIQUADRATIC, 2),
        [biquadratic::<f64>, biquadratic::<f32>],
        ALONG[0],
        BIQUADRATIC_FILES,
    ),
    law(
        4,
        (&systems::BIQUADRATIC_PROJECTION, 2),
        [biquadratic::<f64>, biquadratic::<f32>],
        ALONG[0],
        BIQUADRATIC_FILES,
    ),
    law(4, (&systems::VOLUMES, 3), [volumes::<f64>, volumes::<f32>], TETRAHEDRON, VOLUME_FILES),
    law(
        8,
        (&bricks::TRIADS, 7),
        [hexahedron_triads::<f64>, hexahedron_triads::<f32>],
        HEXAHEDRON,
        TRIAD_FILES,
    ),
    law(
        8,
        (&bricks::FIBRES, 3),
        [hexahedron_fibres::<f64>, hexahedron_fibres::<f32>],
        ALONG[1],
        FIBRE_FILES,
    ),
    law(
        8,
        (&bricks::BIQUADRATIC, 2),
        [hexahedron_biquadratic::<f64>, hexahedron_biquadratic::<f32>],
        ALONG[1],
        BIQUADRATIC_FILES,
    ),
    law(
        8,
        (&bricks::VOLUMES, 3),
        [hexahedron_volumes::<f64>, hexahedron_volumes::<f32>],
        HEXAHEDRON,
        VOLUME_FILES,
    ),
];

/// In elements of 4 or 8 vertices; `files` are those of the kind of elements and of the law.
const fn law(
    vertices: usize,
    (row, rows): (&'static LawRow, usize),
    find: [Find; 2],
    kind: &'static [&'static str],
    files: &'static [&'static str],
) -> DeviceLaw {
    let points = if vertices == 8 { 8 } else { 1 };
    let constants = 4 * rows * points;
    DeviceLaw::new(
        row,
        DeviceElement { vertices, constants, threads: points, files: kind },
        find,
        files,
    )
}

/// Constants of a triad.
#[derive(Clone, Copy)]
struct Triad {
    axes: [[f64; 3]; 3],
    axial: [f64; 3],
    angular: [f64; 3],
    volume: f64,
}

impl Triad {
    /// D_i and V Y_i, a_i and V G_k, V Lambda of a part of the element.
    fn rows(&self, d: [[f64; 3]; 3], share: f64) -> [[f64; 4]; 7] {
        let row = |vector, modulus: f64| row(vector, modulus * share);
        let Self { axes, axial, angular, volume } = *self;
        [
            row(d[0], axial[0]),
            row(d[1], axial[1]),
            row(d[2], axial[2]),
            row(axes[0], angular[0]),
            row(axes[1], angular[1]),
            row(axes[2], angular[2]),
            [volume * share, 0.0, 0.0, 0.0],
        ]
    }
}

/// Constants of a fibre but for its shape: V Y, 1 - r, V T a, 1 - l_opt, 1/w.
type Fibre = [f64; 5];

/// q_b = a.D_b and V Y, a and 1 - r, V T a and 1 - l_opt and 1/w of a part of the element.
fn fibre_rows(
    [stiffness, shortening, active, offset, inverse_width]: Fibre,
    axis: [f64; 3],
    shape: [f64; 3],
    share: f64,
) -> [[f64; 4]; 3] {
    let active = [active * share, offset, inverse_width, 0.0];
    [row(shape, stiffness * share), row(axis, shortening), active]
}

/// D_1 and V Lambda, D_2, D_3.
fn volume_rows([a, b, c]: [[f64; 3]; 3], volume: f64) -> [[f64; 4]; 3] {
    [row(a, volume), row(b, 0.0), row(c, 0.0)]
}

/// A [`Triad`] from its columns.
macro_rules! triad {
    ($axes:ident, $axial:ident, $angular:ident, $volume:ident) => {
        Triad {
            axes: [three!($axes.0), three!($axes.1), three!($axes.2)],
            axial: three!($axial),
            angular: three!($angular),
            volume: $volume.0.to_f64(),
        }
    };
}

/// Triads in tetrahedra of a body.
fn triads<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<TriadData<S>, 4>(|(site, d, axes, axial, angular, volume), data| {
        let d = [three!(d.0), three!(d.1), three!(d.2)];
        push(data, triad!(axes, axial, angular, volume).rows(d, 1.0));
        site.0.0
    })
}

/// Triads in hexahedra of a body.
fn hexahedron_triads<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = bricks::TriadData<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>;
    search.columns::<Data<S>, 8>(|((nodes, _, rest), axes, axial, angular, volume), data| {
        let triad = triad!(axes, axial, angular, volume);
        for (d, share) in points(rest) {
            push(data, triad.rows(d, share));
        }
        nodes.0
    })
}

/// A [`Fibre`] from its columns.
macro_rules! fibre {
    ($columns:ident) => {{
        let (stiffness, shortening, active, offset, width) = $columns;
        [stiffness.0, shortening.0, active.0, offset.0, width.0].map(S::to_f64)
    }};
}

/// Fibres in tetrahedra of a body.
fn fibres<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<FibreData<S>, 4>(|(site, q, a, fibre), data| {
        push(data, fibre_rows(fibre!(fibre), three!(a), three!(q), 1.0));
        site.0.0
    })
}

/// Fibres in hexahedra of a body.
fn hexahedron_fibres<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<bricks::FibreData<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>, 8>(
        |((nodes, _, rest), a, fibre), data| {
            let (a, fibre) = (three!(a), fibre!(fibre));
            for (d, share) in points(rest) {
                push(data, fibre_rows(fibre, a, d.map(|d| dot(d, a)), share));
            }
            nodes.0
        },
    )
}

/// q_b = a.D_b and V Y, a of a part of the element.
fn biquadratic_rows(axis: [f64; 3], shape: [f64; 3], stiffness: f64) -> [[f64; 4]; 2] {
    [row(shape, stiffness), row(axis, 0.0)]
}

/// Biquadratic fibres in tetrahedra of a body.
fn biquadratic<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<BiquadraticData<S>, 4>(|(site, q, a, stiffness), data| {
        push(data, biquadratic_rows(three!(a), three!(q), stiffness.0.to_f64()));
        site.0.0
    })
}

/// Biquadratic fibres in hexahedra of a body.
fn hexahedron_biquadratic<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    type Data<S> = bricks::BiquadraticData<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>;
    search.columns::<Data<S>, 8>(|((nodes, _, rest), a, stiffness), data| {
        let (a, stiffness) = (three!(a), stiffness.0.to_f64());
        for (d, share) in points(rest) {
            push(data, biquadratic_rows(a, d.map(|d| dot(d, a)), stiffness * share));
        }
        nodes.0
    })
}

/// Terms of volume in tetrahedra of a body.
fn volumes<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<VolumeData<S>, 4>(|(site, d, volume), data| {
        let d = [three!(d.0), three!(d.1), three!(d.2)];
        push(data, volume_rows(d, volume.0.to_f64()));
        site.0.0
    })
}

/// Terms of volume in hexahedra of a body.
fn hexahedron_volumes<S: Scalar>(search: ElementSearch<'_>) -> ElementColumns {
    search.columns::<bricks::VolumeData<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>, 8>(
        |((nodes, _, rest), volume), data| {
            for (d, share) in points(rest) {
                push(data, volume_rows(d, volume.0.to_f64() * share));
            }
            nodes.0
        },
    )
}
