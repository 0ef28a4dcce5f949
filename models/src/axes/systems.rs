//! The systems of axes: one law per table, each with a buffer of its own, beside whatever else the body is
//! made of.

use bevy_ecs::prelude::*;
use sinew_engine::element::AxisVertices;
use sinew_engine::lanes::{Batch, Batches, Lanes, MAX_LANES};
use sinew_engine::law::{
    EvaluationRequest, LawBuffer, LawInfo, RecoveringBodies, Span, TangentKind,
};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{ElementLaw, Evaluation, activate_law};
use sinew_engine::workers::Workers;

use super::columns::*;
use super::element::AxisElement;
use crate::frame::tetrahedra::add_tangent;
use crate::laws::pooled::sum;
use crate::laws::{Elements, LawRow, mark, partition};

/// Marks tetrahedra of bodies that consist of axes alone: no law of a material acts on them.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct AxesOnly;

/// Triads of axes with their angles and the term of volume.
pub static TRIADS: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes"),
    Elements::AxesInTetrahedra,
    [mark::<AxisAngleStiffness<f64, 0>>, mark::<AxisAngleStiffness<f32, 0>>],
    [triads::<f64>, triads::<f32>],
);
/// Single fibres, passive and active.
pub static FIBRES: LawRow = LawRow::of_systems(
    LawInfo::elastic("fibres"),
    Elements::AxesInTetrahedra,
    [mark::<FibreShape<f64, 1>>, mark::<FibreShape<f32, 1>>],
    [fibres::<f64>, fibres::<f32>],
);
/// The term of volume without axes.
pub static VOLUMES: LawRow = LawRow::of_systems(
    LawInfo::elastic("volume preservation"),
    Elements::AxesInTetrahedra,
    [mark::<VolumeAlone>; 2],
    [volumes::<f64>, volumes::<f32>],
);

fn triads<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, TriadData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisVertices, S>,
        evaluate: |with, u, data, buffer| evaluate(&TriadColumns::new(u, data), with, buffer),
    };
    activate_law(world, law);
}

fn fibres<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, FibreData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisVertices, S>,
        evaluate: |with, u, data, buffer| evaluate(&FibreColumns::new(u, data), with, buffer),
    };
    activate_law(world, law);
}

fn volumes<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, VolumeData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisVertices, S>,
        evaluate: |with, u, data, buffer| evaluate(&VolumeColumns::new(u, data), with, buffer),
    };
    activate_law(world, law);
}

/// Energy, force and tangent of every range into its private arrays, as far as they are asked for.
pub fn evaluate_columns<S: Scalar, C: AxisColumns<S>>(
    columns: &C,
    request: &EvaluationRequest,
    workers: &Workers,
    buffer: &mut LawBuffer<S>,
) {
    let recovering = &RecoveringBodies::default();
    evaluate(columns, Evaluation { request, workers, recovering }, buffer);
}

/// [`evaluate_columns`], silent for bodies that recover: the corotational energy that stands in for the
/// base material has one minimum only as long as nothing is added to it.
pub(crate) fn evaluate<S: Scalar, C: AxisColumns<S>>(
    columns: &C,
    Evaluation { request, workers, recovering }: Evaluation,
    buffer: &mut LawBuffer<S>,
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
