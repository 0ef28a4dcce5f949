//! The systems of axes: one law per table, each with a buffer of its own, beside whatever else the body is
//! made of.

use bevy_ecs::prelude::*;
use sinew_engine::columns::single_table;
use sinew_engine::element::{AxisVertices, ShapeGradient};
use sinew_engine::lanes::{Batch, Batches, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, Law, LawBuffer, RecoveringBodies, Span, TangentKind};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{
    ColumnWatch, ForceSystems, activate_law, column_changed, declare_inputs,
};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::time::Instant;

use super::columns::*;
use super::element::AxisElement;
use crate::fused::add_tangent;
use crate::pooled::sum;

/// Triads of axes with their angles and the term of volume.
pub struct AxisTriads;

impl Law for AxisTriads {
    const NAME: &'static str = "axes";
    const ORDER: u8 = 25;
}

/// Single fibres, passive and active.
pub struct Fibres;

impl Law for Fibres {
    const NAME: &'static str = "fibres";
    const ORDER: u8 = 26;
}

/// The term of volume without axes.
pub struct VolumePreservation;

impl Law for VolumePreservation {
    const NAME: &'static str = "volume preservation";
    const ORDER: u8 = 27;
}

/// Marks tetrahedra of bodies that consist of axes alone: no law of a material acts on them.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct AxesOnly;

/// Puts the law of triads into the force schedule.
pub fn activate_triads<S: Scalar>(world: &mut World) {
    activate_law::<AxisTriads, S>(world, |schedule| {
        schedule.add_systems(evaluate_triads::<S>.in_set(ForceSystems::Evaluate));
    });
    let mut inputs = gradient_watches::<S>().to_vec();
    inputs.extend([
        column_changed::<AxisVertices> as ColumnWatch,
        column_changed::<AxialStiffness<S, 0>>,
        column_changed::<AxialStiffness<S, 1>>,
        column_changed::<AxialStiffness<S, 2>>,
        column_changed::<AxisAngleStiffness<S, 0>>,
        column_changed::<AxisAngleStiffness<S, 1>>,
        column_changed::<AxisAngleStiffness<S, 2>>,
        column_changed::<VolumeStiffness<S>>,
    ]);
    inputs.extend(direction_watches::<S>());
    declare_inputs(world, AxisTriads::NAME, &inputs);
}

/// Puts the law of fibres into the force schedule.
pub fn activate_fibres<S: Scalar>(world: &mut World) {
    activate_law::<Fibres, S>(world, |schedule| {
        schedule.add_systems(evaluate_fibres::<S>.in_set(ForceSystems::Evaluate));
    });
    let mut inputs = vec![
        column_changed::<AxisVertices> as ColumnWatch,
        column_changed::<FibreShape<S, 1>>,
        column_changed::<FibreShape<S, 2>>,
        column_changed::<FibreShape<S, 3>>,
        column_changed::<AxialStiffness<S, 0>>,
        column_changed::<FibreShortening<S>>,
        column_changed::<FibreActive<S>>,
        column_changed::<FibreOffset<S>>,
        column_changed::<FibreInverseWidth<S>>,
    ];
    inputs.extend(&direction_watches::<S>()[..3]);
    declare_inputs(world, Fibres::NAME, &inputs);
}

/// Puts the term of volume into the force schedule.
pub fn activate_volumes<S: Scalar>(world: &mut World) {
    activate_law::<VolumePreservation, S>(world, |schedule| {
        schedule.add_systems(evaluate_volumes::<S>.in_set(ForceSystems::Evaluate));
    });
    let mut inputs = gradient_watches::<S>().to_vec();
    inputs.extend([
        column_changed::<AxisVertices> as ColumnWatch,
        column_changed::<VolumeStiffness<S>>,
    ]);
    declare_inputs(world, VolumePreservation::NAME, &inputs);
}

fn gradient_watches<S: Scalar>() -> [ColumnWatch; 9] {
    [
        column_changed::<ShapeGradient<S, 1, 0>>,
        column_changed::<ShapeGradient<S, 1, 1>>,
        column_changed::<ShapeGradient<S, 1, 2>>,
        column_changed::<ShapeGradient<S, 2, 0>>,
        column_changed::<ShapeGradient<S, 2, 1>>,
        column_changed::<ShapeGradient<S, 2, 2>>,
        column_changed::<ShapeGradient<S, 3, 0>>,
        column_changed::<ShapeGradient<S, 3, 1>>,
        column_changed::<ShapeGradient<S, 3, 2>>,
    ]
}

pub(crate) fn direction_watches<S: Scalar>() -> [ColumnWatch; 9] {
    [
        column_changed::<AxisDirection<S, 0, 0>>,
        column_changed::<AxisDirection<S, 0, 1>>,
        column_changed::<AxisDirection<S, 0, 2>>,
        column_changed::<AxisDirection<S, 1, 0>>,
        column_changed::<AxisDirection<S, 1, 1>>,
        column_changed::<AxisDirection<S, 1, 2>>,
        column_changed::<AxisDirection<S, 2, 0>>,
        column_changed::<AxisDirection<S, 2, 1>>,
        column_changed::<AxisDirection<S, 2, 2>>,
    ]
}

fn evaluate_triads<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    recovering: Res<RecoveringBodies>,
    mut buffer: ResMut<LawBuffer<AxisTriads, S>>,
    vertices: Query<&Displacement<S>>,
    axes: Query<TriadData<S>>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some(data) = single_table(axes.contiguous_iter()) else { return };
    evaluate_spans(&TriadColumns::new(u, data), &request, &workers, &recovering, &mut buffer);
    buffer.time = start.elapsed();
}

fn evaluate_fibres<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    recovering: Res<RecoveringBodies>,
    mut buffer: ResMut<LawBuffer<Fibres, S>>,
    vertices: Query<&Displacement<S>>,
    axes: Query<FibreData<S>>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some(data) = single_table(axes.contiguous_iter()) else { return };
    evaluate_spans(&FibreColumns::new(u, data), &request, &workers, &recovering, &mut buffer);
    buffer.time = start.elapsed();
}

fn evaluate_volumes<S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    recovering: Res<RecoveringBodies>,
    mut buffer: ResMut<LawBuffer<VolumePreservation, S>>,
    vertices: Query<&Displacement<S>>,
    axes: Query<VolumeData<S>, VolumeAlone<S>>,
) {
    let start = Instant::now();
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some(data) = single_table(axes.contiguous_iter()) else { return };
    evaluate_spans(&VolumeColumns::new(u, data), &request, &workers, &recovering, &mut buffer);
    buffer.time = start.elapsed();
}

/// Energy, force and tangent of every range into its private arrays, as far as they are asked for.
pub fn evaluate_columns<L: Law, S: Scalar, C: AxisColumns<S>>(
    columns: &C,
    request: &EvaluationRequest,
    workers: &Workers,
    buffer: &mut LawBuffer<L, S>,
) {
    evaluate_spans(columns, request, workers, &RecoveringBodies::default(), buffer);
}

/// [`evaluate_columns`], silent for bodies that recover: the corotational energy that stands in for the
/// base material has one minimum only as long as nothing is added to it.
pub(crate) fn evaluate_spans<L: Law, S: Scalar, C: AxisColumns<S>>(
    columns: &C,
    request: &EvaluationRequest,
    workers: &Workers,
    recovering: &RecoveringBodies,
    buffer: &mut LawBuffer<L, S>,
) {
    let EvaluationRequest { energy, force, tangent } = *request;
    let work_ns =
        6 * usize::from(energy) + 8 * usize::from(force) + 60 * usize::from(tangent.is_some());
    workers.for_each(&mut buffer.spans, columns.nodes().len() * work_ns, |_, span| {
        let elements = span.elements.clone();
        if recovering.contains(span.body) {
            span.silence();
            return;
        }
        if energy {
            let batch = EnergyBatch { columns, sums: [0.0; MAX_LANES] };
            span.energy = sum(workers.dispatch(Batches(elements.clone(), batch)).sums);
        }
        if force {
            span.clear_force();
            let (row, force) = (span.rows.start, &mut span.force[..]);
            workers.dispatch(Batches(elements.clone(), ForceBatch { columns, force, row }));
        }
        match tangent {
            Some(kind) => {
                span.clear_tangent();
                let batch = TangentBatch { columns, span, kind, clamped: [0.0; MAX_LANES] };
                let clamped = workers.dispatch(Batches(elements, batch)).clamped;
                span.clamped = sum(clamped) as u64;
            }
            None => span.drop_tangent(),
        }
    });
}

struct EnergyBatch<'a, C> {
    columns: &'a C,
    sums: [f64; MAX_LANES],
}

impl<S: Scalar, C: AxisColumns<S>> Batch<S> for EnergyBatch<'_, C> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.displacements::<L>(first);
        self.columns.element::<L>(first).energy(&u).accumulate(&mut self.sums);
    }
}

struct ForceBatch<'a, S, C> {
    columns: &'a C,
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
}

impl<S: Scalar, C: AxisColumns<S>> Batch<S> for ForceBatch<'_, S, C> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.displacements::<L>(first);
        let forces = self.columns.element::<L>(first).forces(&u);
        let nodes = &self.columns.nodes()[first..];
        for a in 0..4 {
            L::add_rows(forces[a], self.force, self.row, nodes, a);
        }
    }
}

struct TangentBatch<'a, S, C> {
    columns: &'a C,
    span: &'a mut Span<S>,
    kind: TangentKind,
    clamped: [f64; MAX_LANES],
}

impl<S: Scalar, C: AxisColumns<S>> Batch<S> for TangentBatch<'_, S, C> {
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let Self { columns, span, kind, clamped } = self;
        let u = columns.displacements::<L>(first);
        let e = columns.element::<L>(first);
        if *kind == TangentKind::Projected {
            L::select(e.is_clamped(&u), L::ONE, L::ZERO).accumulate(clamped);
        }
        let mut t = e.tangent(&u, *kind);
        add_tangent(&mut t, span, &columns.nodes()[first..], &columns.blocks()[first..]);
    }
}
