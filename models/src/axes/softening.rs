//! How many biquadratic fibres are pressed far together, for the report of compression: those of bodies whose material does
//! not soften there itself, all elements of which are looked at anyway.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::compression::{CompressionReport, in_chunks, report_compression_by};
use sinew_engine::isoparametric::{
    AxisHexahedronBlocks, AxisHexahedronVertices, AxisTetrahedron10Blocks,
    AxisTetrahedron10Vertices, OwnPoints, PointsRest,
};
use sinew_engine::lanes::{Batch, Batches, Lanes, MAX_LANES};
use sinew_engine::law::SleepingBodies;
use sinew_engine::scalar::{Scalar, dot};
use sinew_engine::vertex::{BodyId, Displacement};
use sinew_engine::workers::Workers;
use std::ops::Range;

use super::columns::*;
use super::element::BiquadraticFibre;
use super::points::{self, at_any_point};
use crate::frame::hexahedra::{Brick, Shape, TenNodes};

/// They are counted in this world.
#[derive(Resource)]
struct Counted;

/// Has the fibres of all bodies counted at the end of every step.
pub(super) fn report_fibres<S: Scalar>(world: &mut World) {
    if !world.contains_resource::<Counted>() {
        world.insert_resource(Counted);
        report_compression_by::<S, _>(world, count::<S>);
    }
}

type AtPoints<'w, 's, S, V, B, const Q: usize> =
    Query<'w, 's, (points::BiquadraticData<S, V, B, Q>, &'static BodyId), With<Biquadratic>>;

fn count<S: Scalar>(
    workers: Res<Workers>,
    (sleeping, points): (Res<SleepingBodies>, Res<OwnPoints>),
    mut report: ResMut<CompressionReport>,
    vertices: Query<&Displacement<S>>,
    tetrahedra: Query<(BiquadraticData<S>, &BodyId), With<Biquadratic>>,
    bricks: AtPoints<S, AxisHexahedronVertices, AxisHexahedronBlocks, 8>,
    tens: AtPoints<S, AxisTetrahedron10Vertices, AxisTetrahedron10Blocks, 4>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let mut add = |bodies: &[BodyId], work: usize, count: &(dyn Fn(Range<usize>) -> u64 + Sync)| {
        let mut first = 0;
        for own in bodies.chunk_by(|a, b| a == b) {
            let fibres = first..first + own.len();
            first = fibres.end;
            if !report.is_watched(own[0].0) && !sleeping.contains(own[0].0 as usize) {
                report.add(own[0].0, in_chunks(&workers, fibres, work, count));
            }
        }
    };
    if let Some((data, bodies)) = single_table(tetrahedra.contiguous_iter()) {
        let columns = &BiquadraticColumns::new(u, data);
        add(bodies, 3, &|fibres| {
            let batch = Pressed { columns, counts: [0.0; MAX_LANES] };
            workers.dispatch(Batches(fibres, batch)).counts.iter().sum::<f64>() as u64
        });
    }
    macro_rules! at_points {
        ($fibres:expr, $shape:ty) => {
            if let Some((((nodes, _, rest), (x, y, z), _), bodies)) =
                single_table($fibres.contiguous_iter())
            {
                add(bodies, 300, &|fibres| {
                    let pressed = |&i: &usize| {
                        let axis = [x[i].0, y[i].0, z[i].0].map(S::to_f64);
                        is_pressed::<$shape, S, _, _, _>(
                            (&rest[i], &points),
                            axis,
                            (u, &nodes[i].0),
                        )
                    };
                    fibres.filter(pressed).count() as u64
                });
            }
        };
    }
    at_points!(bricks, Brick);
    at_points!(tens, TenNodes);
}

struct Pressed<'a, S: Scalar> {
    columns: &'a BiquadraticColumns<'a, S>,
    counts: [f64; MAX_LANES],
}

impl<S: Scalar> Batch<S> for Pressed<'_, S> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.displacements::<L>(first);
        let pressed = self.columns.element::<L>(first).is_pressed(&u);
        L::select(pressed, L::ONE, L::ZERO).accumulate(&mut self.counts);
    }
}

/// Whether a fibre in an element is pressed far at some Gauss point.
fn is_pressed<E: Shape<V, P, Q>, S: Scalar, const V: usize, const P: usize, const Q: usize>(
    (rest, points): (&PointsRest<S, Q>, &OwnPoints),
    axis: [f64; 3],
    (u, nodes): (&[Displacement<S>], &[u32; V]),
) -> bool {
    let rest = rest.in_f64();
    let u = nodes.map(|v| u[v as usize].0).map(|[x, y, z, _]| [x, y, z].map(S::to_f64));
    at_any_point::<E, V, P, Q>((&rest, points), &u, |gradients, u| {
        let shape = gradients.map(|d| dot(d, axis));
        BiquadraticFibre { shape, axis, stiffness: 1.0 }.is_pressed(u)
    })
}
