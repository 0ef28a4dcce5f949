//! Axes in tetrahedra and at the Gauss points of hexahedra: twins of [`sinew_models::axes::systems`] and
//! [`sinew_models::axes::hexahedra`]. They are silent while their body recovers.

use bevy_ecs::prelude::*;
use sinew_engine::isoparametric::HexahedronRest;
use sinew_engine::scalar::{Scalar, dot};
use sinew_engine::vertex::BodyId;
use sinew_models::axes::columns::{FibreData, TriadData, VolumeAlone, VolumeData};
use sinew_models::axes::{hexahedra as bricks, systems};
use sinew_models::laws::LawRow;

use super::solid::HEXAHEDRA;
use super::{
    DEFORMATION, DeviceLaw, ElementColumns, ElementKind, FOUR_VERTICES, Find, TETRAHEDRA,
    VERTEX_FORCES,
};

const CHORD: &str = include_str!("chord.wgsl");
const VOLUME_TERM: &str = include_str!("volume_term.wgsl");
const TRIAD_FILES: &[&str] = &[VERTEX_FORCES, CHORD, VOLUME_TERM, include_str!("triads.wgsl")];
const FIBRE_FILES: &[&str] = &[CHORD, include_str!("fibres.wgsl")];
const VOLUME_FILES: &[&str] =
    &[VERTEX_FORCES, VOLUME_TERM, include_str!("volume_preservation.wgsl")];

/// Rows of four constants of a triad, a fibre, a term of volume.
const ROWS: [usize; 3] = [7, 3, 3];

const TETRAHEDRON: &[&str] = &[TETRAHEDRA, FOUR_VERTICES, DEFORMATION];
const HEXAHEDRON: &[&str] = &[HEXAHEDRA, DEFORMATION];
/// Fibres know the deformation along themselves only.
const ALONG: [&[&str]; 2] = [&[TETRAHEDRA, FOUR_VERTICES], &[HEXAHEDRA]];

/// Triads of axes with their angles and the term of volume, single fibres, the term of volume alone; each in
/// tetrahedra and in hexahedra.
pub(super) static LAWS: &[DeviceLaw] = &[
    in_tetrahedra(
        (&systems::TRIADS, [triads::<f64>, triads::<f32>]),
        (ROWS[0], TETRAHEDRON, TRIAD_FILES),
    ),
    in_tetrahedra(
        (&systems::FIBRES, [fibres::<f64>, fibres::<f32>]),
        (ROWS[1], ALONG[0], FIBRE_FILES),
    ),
    in_tetrahedra(
        (&systems::VOLUMES, [volumes::<f64>, volumes::<f32>]),
        (ROWS[2], TETRAHEDRON, VOLUME_FILES),
    ),
    in_hexahedra(
        (&bricks::TRIADS, [hexahedron_triads::<f64>, hexahedron_triads::<f32>]),
        (ROWS[0], HEXAHEDRON, TRIAD_FILES),
    ),
    in_hexahedra(
        (&bricks::FIBRES, [hexahedron_fibres::<f64>, hexahedron_fibres::<f32>]),
        (ROWS[1], ALONG[1], FIBRE_FILES),
    ),
    in_hexahedra(
        (&bricks::VOLUMES, [hexahedron_volumes::<f64>, hexahedron_volumes::<f32>]),
        (ROWS[2], HEXAHEDRON, VOLUME_FILES),
    ),
];

/// Rows of four constants of an element, WGSL of its kind, WGSL of the law.
type Shape = (usize, &'static [&'static str], &'static [&'static str]);

const fn in_tetrahedra(
    (law, find): (&'static LawRow, [Find; 2]),
    (rows, kind, files): Shape,
) -> DeviceLaw {
    let kind = ElementKind { vertices: 4, constants: 4 * rows, threads: 1, files: kind };
    DeviceLaw { row: law, kind, volumes: false, find, files }
}

/// With so many rows of constants at every Gauss point.
const fn in_hexahedra(
    (law, find): (&'static LawRow, [Find; 2]),
    (rows, kind, files): Shape,
) -> DeviceLaw {
    let kind = ElementKind { vertices: 8, constants: 32 * rows, threads: 8, files: kind };
    DeviceLaw { row: law, kind, volumes: false, find, files }
}

/// Appends an element: its rows, and its constants, in `f64` so that products are rounded once.
fn push<const N: usize, const R: usize>(
    columns: &mut ElementColumns,
    nodes: [u32; N],
    first_row: u32,
    points: impl Iterator<Item = [[f64; 4]; R]>,
) {
    columns.nodes.extend(nodes.map(|row| row - first_row));
    for rows in points {
        columns.data.extend(rows.as_flattened().iter().map(|x| *x as f32));
    }
}

/// The three numbers of columns in a tuple.
macro_rules! three {
    ($columns:expr) => {
        [$columns.0.0.to_f64(), $columns.1.0.to_f64(), $columns.2.0.to_f64()]
    };
}

/// Gradients (1/m) of the local coordinates at the points of a hexahedron, with the shares of the points.
fn points<S: Scalar>(rest: &HexahedronRest<S>) -> impl Iterator<Item = ([[f64; 3]; 3], f64)> {
    (0..8).map(|q| {
        let d = |i: usize, x: usize| rest.gradients[3 * i + x][q].to_f64();
        let d = std::array::from_fn(|i| std::array::from_fn(|x| d(i, x)));
        (d, rest.volume[q].to_f64())
    })
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
        let row = |[x, y, z]: [f64; 3], modulus: f64| [x, y, z, modulus * share];
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
    [
        [shape[0], shape[1], shape[2], stiffness * share],
        [axis[0], axis[1], axis[2], shortening],
        [active * share, offset, inverse_width, 0.0],
    ]
}

/// D_1 and V Lambda, D_2, D_3.
fn volume_rows([a, b, c]: [[f64; 3]; 3], volume: f64) -> [[f64; 4]; 3] {
    [[a[0], a[1], a[2], volume], [b[0], b[1], b[2], 0.0], [c[0], c[1], c[2], 0.0]]
}

/// Triads in tetrahedra of a body.
fn triads<S: Scalar>(world: &mut World, _: &LawRow, body: usize, first_row: u32) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(TriadData<S>, &BodyId)>();
    for ((site, d, (a, b, c), y, g, volume), of) in query.iter(world) {
        if of.0 as usize == body {
            let triad = Triad {
                axes: [three!(a), three!(b), three!(c)],
                axial: three!(y),
                angular: three!(g),
                volume: volume.0.to_f64(),
            };
            let d = [three!(d.0), three!(d.1), three!(d.2)];
            push(&mut columns, site.0.0, first_row, std::iter::once(triad.rows(d, 1.0)));
        }
    }
    columns
}

/// Triads in hexahedra of a body.
fn hexahedron_triads<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(bricks::TriadData<S>, &BodyId)>();
    for (((nodes, _, rest), (a, b, c), y, g, volume), of) in query.iter(world) {
        if of.0 as usize == body {
            let triad = Triad {
                axes: [three!(a), three!(b), three!(c)],
                axial: three!(y),
                angular: three!(g),
                volume: volume.0.to_f64(),
            };
            let points = points(rest).map(|(d, share)| triad.rows(d, share));
            push(&mut columns, nodes.0, first_row, points);
        }
    }
    columns
}

/// Fibres in tetrahedra of a body.
fn fibres<S: Scalar>(world: &mut World, _: &LawRow, body: usize, first_row: u32) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(FibreData<S>, &BodyId)>();
    for ((site, q, a, (y, shortening, active, offset, width)), of) in query.iter(world) {
        if of.0 as usize == body {
            let fibre = [y.0, shortening.0, active.0, offset.0, width.0].map(S::to_f64);
            let rows = fibre_rows(fibre, three!(a), three!(q), 1.0);
            push(&mut columns, site.0.0, first_row, std::iter::once(rows));
        }
    }
    columns
}

/// Fibres in hexahedra of a body.
fn hexahedron_fibres<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(bricks::FibreData<S>, &BodyId)>();
    for (((nodes, _, rest), a, (y, shortening, active, offset, width)), of) in query.iter(world) {
        if of.0 as usize == body {
            let fibre = [y.0, shortening.0, active.0, offset.0, width.0].map(S::to_f64);
            let a = three!(a);
            let rows = |(d, share): ([[f64; 3]; 3], f64)| {
                fibre_rows(fibre, a, d.map(|d| dot(d, a)), share)
            };
            push(&mut columns, nodes.0, first_row, points(rest).map(rows));
        }
    }
    columns
}

/// Terms of volume in tetrahedra of a body.
fn volumes<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(VolumeData<S>, &BodyId), With<VolumeAlone>>();
    for ((site, d, volume), of) in query.iter(world) {
        if of.0 as usize == body {
            let d = [three!(d.0), three!(d.1), three!(d.2)];
            let rows = volume_rows(d, volume.0.to_f64());
            push(&mut columns, site.0.0, first_row, std::iter::once(rows));
        }
    }
    columns
}

/// Terms of volume in hexahedra of a body.
fn hexahedron_volumes<S: Scalar>(
    world: &mut World,
    _: &LawRow,
    body: usize,
    first_row: u32,
) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(bricks::VolumeData<S>, &BodyId), With<VolumeAlone>>();
    for (((nodes, _, rest), volume), of) in query.iter(world) {
        if of.0 as usize == body {
            let volume = volume.0.to_f64();
            let points = points(rest).map(|(d, share)| volume_rows(d, volume * share));
            push(&mut columns, nodes.0, first_row, points);
        }
    }
    columns
}
