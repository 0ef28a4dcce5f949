//! Axes in tetrahedra: twins of [`sinew_models::axes::systems`]. They are silent while their body recovers.

use bevy_ecs::prelude::*;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::BodyId;
use sinew_models::axes::columns::{FibreData, TriadData, VolumeAlone, VolumeData};
use sinew_models::axes::systems::{AxisTriads, Fibres, VolumePreservation};

use super::{
    DEFORMATION, DeviceLaw, ElementColumns, ElementKind, FOUR_VERTICES, TETRAHEDRA, VERTEX_FORCES,
};

const CHORD: &str = include_str!("chord.wgsl");
const VOLUME_TERM: &str = include_str!("volume_term.wgsl");

/// Four vertices and some constants, with shape vectors or without.
const fn kind(constants: usize, files: &'static [&'static str]) -> ElementKind {
    ElementKind { vertices: 4, constants, threads: 1, files }
}

/// A tetrahedron with its shape vectors.
const SHAPED: &[&str] = &[TETRAHEDRA, FOUR_VERTICES, DEFORMATION];

/// Triads of axes, their angles and the term of volume.
pub const TRIADS: DeviceLaw = DeviceLaw::of::<AxisTriads>(
    kind(28, SHAPED),
    &[VERTEX_FORCES, CHORD, VOLUME_TERM, include_str!("triads.wgsl")],
);

/// Single fibres, passive and active.
pub const FIBRES: DeviceLaw = DeviceLaw::of::<Fibres>(
    kind(12, &[TETRAHEDRA, FOUR_VERTICES]),
    &[CHORD, include_str!("fibres.wgsl")],
);

/// The term of volume without axes.
pub const VOLUMES: DeviceLaw = DeviceLaw::of::<VolumePreservation>(
    kind(12, SHAPED),
    &[VERTEX_FORCES, VOLUME_TERM, include_str!("volume_preservation.wgsl")],
);

/// Triads in a body: D_i and V Y_i, a_i and V G_k, V Lambda.
pub(super) fn triads<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(TriadData<S>, &BodyId)>();
    for ((site, (d1, d2, d3), (a, b, c), y, g, volume), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        columns.nodes.extend(site.0.0.map(|row| row - first_row));
        let zero = S::ZERO;
        let rows = [
            [d1.0.0, d1.1.0, d1.2.0, y.0.0],
            [d2.0.0, d2.1.0, d2.2.0, y.1.0],
            [d3.0.0, d3.1.0, d3.2.0, y.2.0],
            [a.0.0, a.1.0, a.2.0, g.0.0],
            [b.0.0, b.1.0, b.2.0, g.1.0],
            [c.0.0, c.1.0, c.2.0, g.2.0],
            [volume.0, zero, zero, zero],
        ];
        columns.data.extend(rows.as_flattened().iter().map(|x| x.to_f64() as f32));
    }
    columns
}

/// Fibres in a body: q_b and V Y, a and 1 - r, V T a and 1 - l_opt and 1/w.
pub(super) fn fibres<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query::<(FibreData<S>, &BodyId)>();
    for ((site, q, a, (stiffness, shortening, active, offset, width)), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        columns.nodes.extend(site.0.0.map(|row| row - first_row));
        let rows = [
            [q.0.0, q.1.0, q.2.0, stiffness.0],
            [a.0.0, a.1.0, a.2.0, shortening.0],
            [active.0, offset.0, width.0, S::ZERO],
        ];
        columns.data.extend(rows.as_flattened().iter().map(|x| x.to_f64() as f32));
    }
    columns
}

/// Terms of volume in a body: D_1 and V Lambda, D_2, D_3.
pub(super) fn volumes<S: Scalar>(world: &mut World, body: usize, first_row: u32) -> ElementColumns {
    let mut columns = ElementColumns::default();
    let mut query = world.query_filtered::<(VolumeData<S>, &BodyId), VolumeAlone<S>>();
    for ((site, (d1, d2, d3), volume), of) in query.iter(world) {
        if of.0 as usize != body {
            continue;
        }
        columns.nodes.extend(site.0.0.map(|row| row - first_row));
        let rows = [
            [d1.0.0, d1.1.0, d1.2.0, volume.0],
            [d2.0.0, d2.1.0, d2.2.0, S::ZERO],
            [d3.0.0, d3.1.0, d3.2.0, S::ZERO],
        ];
        columns.data.extend(rows.as_flattened().iter().map(|x| x.to_f64() as f32));
    }
    columns
}
