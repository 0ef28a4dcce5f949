//! Volumes that are kept as means: of clusters of tetrahedra ([`super::clusters`]), of single hexahedra and of single ten-node
//! tetrahedra ([`super::hexahedra`]). This module has what these share, whatever the elements.
//!
//! With `m_t` the mean over element `t` of what its law takes for the change of volume ([`VolumeMeasure`]), `lambda_c` the part of `lambda` that acts on means, and clusters `c` of
//! one element or more:
//!
//! ```text
//! W   = ... + sum_c V_c lambda_c/2 m_c^2      m_c = sum_t V_t m_t / V_c    V_c = sum_t V_t    p_c = lambda_c m_c
//! K   = ... + sum_c lambda_c/V_c b_c b_c^T    b_c,a = d(V_c m_c)/du_a
//! ```
//!
//! Three systems share the work: `measure` finds the mean of every cluster before the laws run, and writes its
//! pressure to its elements; the law reads that column; its buffer carries the vectors, which are never added up
//! ([`LowRank`]).

use bevy_ecs::prelude::*;
use bevy_ecs::query::{ContiguousQueryData, ReadOnlyQueryData};
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::isoparametric::OwnPoints;
use sinew_engine::law::{
    EvaluationRequest, LawBuffer, LawBuffers, RecoveringBodies, SleepingBodies,
};
use sinew_engine::matrix::{LowRank, LowRankPattern, PredictedValues};
use sinew_engine::ratios::measure_volume_ratios;
use sinew_engine::report::VolumeReport;
use sinew_engine::resource::ensure;
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::{
    ForceSchedule, ForceSystems, StepSchedule, StepSystems, activate_systems, declare_inputs,
};
use sinew_engine::step::StepFailure;
use sinew_engine::vertex::{BodyId, Displacement};
use sinew_engine::workers::Workers;

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::{Arc, MutexGuard};

use super::moduli::{ClusterIndex, ClusterPressure, PredictedPressure};
use super::row::{Measure, PlacedLaw};
use super::rules::VolumeMeasure;

/// Elements of `V` vertices that keep means of their volumes, as slices.
pub(crate) trait KeptByMean<S: Scalar, const V: usize>: Sync {
    /// Vertex rows.
    fn nodes(&self) -> &[[u32; V]];
    /// Clusters of the elements; none where each is one by itself.
    fn clusters(&self) -> Option<&[ClusterIndex]>;
    /// Volume (m^3) of an element, and the part of its `lambda` (Pa) that acts on the mean.
    fn share(&self, element: usize) -> [f64; 2];
    /// `m_t` of the elements from `first` on.
    fn changes(&self, measure: VolumeMeasure, workers: &Workers, first: usize, own: &mut [S]);
    /// Derivatives (m^2) of `V_t m_t` by the displacements of their vertices.
    fn areas(
        &self,
        measure: VolumeMeasure,
        workers: &Workers,
        first: usize,
        own: &mut [[[S; 3]; V]],
    );
}

/// A law and the kind of its elements.
pub(crate) trait MeanLaw<S: Scalar, const V: usize>: 'static {
    /// Its mark.
    type Mark: Component;
    /// Query data of its elements.
    type Data: ReadOnlyQueryData + ContiguousQueryData + 'static;
    /// The same as slices.
    type Columns<'a>: KeptByMean<S, V>;
    /// From table columns.
    fn columns<'a>(
        displacement: &'a [Displacement<S>],
        data: <Self::Data as ContiguousQueryData>::Contiguous<'a, 'a>,
        points: &'a OwnPoints,
    ) -> Self::Columns<'a>;
}

/// What measures the means of the law at this place of the table. All laws with means write columns of the same types, each
/// for elements of its own; they follow each other in the order of the table, whichever of them a world has.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct InPlace(usize);

/// The places of the laws whose means a world measures.
#[derive(Resource, Debug, Default)]
struct MeasuredPlaces(Vec<usize>);

/// Puts the measuring of means of a law into the schedules.
pub(crate) fn activate<L: MeanLaw<S, V>, S: Scalar, const V: usize>(
    world: &mut World,
    PlacedLaw { row, place }: PlacedLaw,
) {
    let Some(Measure { name, volume }) = row.measure else { return };
    let means = MeanVolumes { law: row.info.name, volume, ..MeanVolumes::<S, V>::default() };
    world.insert_resource(MeansOf::<L, S, V>(means, PhantomData));
    let new = activate_systems(world, name, |schedule| {
        schedule
            .add_systems(measure::<L, S, V>.in_set(ForceSystems::Measure).in_set(InPlace(place)));
    });
    if new {
        let mut places = ensure::<MeasuredPlaces>(world);
        let others = places.0.clone();
        places.0.push(place);
        let schedules = world.resource_mut::<Schedules>().into_inner();
        for other in others {
            let (first, second) = (InPlace(place.min(other)), InPlace(place.max(other)));
            schedules.entry(ForceSchedule).configure_sets(first.before(second));
            schedules.entry(StepSchedule).configure_sets(first.before(second));
        }
        schedules.entry(StepSchedule).add_systems(
            report::<L, S, V>
                .in_set(StepSystems::Report)
                .in_set(InPlace(place))
                .after(measure_volume_ratios::<S>),
        );
        // what it writes follows from the displacements and what the law itself declares
        declare_inputs(world, name, &[]);
    }
}

/// The means of a law.
#[derive(Resource, Debug)]
struct MeansOf<L: MeanLaw<S, V>, S: Scalar, const V: usize>(
    MeanVolumes<S, V>,
    PhantomData<fn() -> L>,
);

/// Means of volumes of the elements of a law.
#[derive(Debug, Default)]
struct MeanVolumes<S, const V: usize> {
    /// Name of the law.
    law: &'static str,
    volume: VolumeMeasure,
    /// What the rest was found for.
    index: Vec<ClusterIndex>,
    nodes: Vec<[u32; V]>,
    /// Cluster of every element, counted from 0 in the order of their first elements.
    cluster: Vec<u32>,
    /// Place of the vertices of every element among the entries of its cluster.
    slot: Vec<[u32; V]>,
    /// Body of every cluster.
    body: Vec<u32>,
    pattern: Arc<LowRankPattern>,
    /// `m_t`, and the derivatives (m^2) of `V_t m_t`.
    change: Vec<S>,
    area: Vec<[[S; 3]; V]>,
    sums: Vec<Sums>,
}

/// What is summed over the elements of a cluster.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sums {
    /// V_c (m^3).
    volume: f64,
    /// sum V_t m_t (m^3).
    change: f64,
    /// sum V_t lambda_c,t (N m).
    modulus: f64,
}

impl Sums {
    /// Adds an element: its volume (m^3), the part of its `lambda` (Pa) that acts on the mean, and `m_t`.
    pub fn add(&mut self, [volume, lambda]: [f64; 2], change: f64) {
        self.volume += volume;
        self.change += volume * change;
        self.modulus += volume * lambda;
    }

    /// m_c; 0 where all elements are gone.
    fn mean(&self) -> f64 {
        if self.volume > 0.0 { self.change / self.volume } else { 0.0 }
    }

    /// lambda_c/V_c (Pa/m^3); 0 where all elements are gone.
    fn stiffness(&self) -> f64 {
        if self.volume > 0.0 { self.modulus / (self.volume * self.volume) } else { 0.0 }
    }

    /// p_c (Pa).
    fn pressure(&self) -> f64 {
        self.stiffness() * self.change
    }

    /// (V_c lambda_c)^1/2 m_c (J^1/2).
    fn value(&self) -> f64 {
        self.stiffness().sqrt() * self.change
    }

    /// V_c lambda_c/2 m_c^2 (J).
    pub fn energy(&self) -> f64 {
        0.5 * self.pressure() * self.change
    }
}

impl<S: Scalar, const V: usize> MeanVolumes<S, V> {
    /// Finds the entries of all clusters, unless they are those of these columns.
    fn lay_out(&mut self, elements: &dyn KeptByMean<S, V>, bodies: &[BodyId]) {
        let (index, nodes) = (elements.clusters(), elements.nodes());
        if self.index == index.unwrap_or_default() && self.nodes == nodes {
            return;
        }
        self.index = index.unwrap_or_default().to_vec();
        self.nodes = nodes.to_vec();
        let mut number = BTreeMap::new();
        self.body.clear();
        self.cluster.clear();
        for (element, body) in bodies.iter().enumerate() {
            let next = number.len() as u32;
            let index = index.map_or(element as u32, |index| index[element].0);
            let own = *number.entry(index).or_insert(next);
            if own == next {
                self.body.push(body.0);
            }
            self.cluster.push(own);
        }
        let mut rows: Vec<[u32; 2]> = Vec::with_capacity(V * nodes.len());
        for (&cluster, nodes) in self.cluster.iter().zip(nodes) {
            rows.extend(nodes.map(|row| [cluster, row]));
        }
        rows.sort_unstable();
        rows.dedup();
        let place = |cluster, row| {
            let found = rows.binary_search(&[cluster, row]);
            found.expect("every vertex of its elements is an entry of a cluster") as u32
        };
        self.slot.clear();
        for (&cluster, nodes) in self.cluster.iter().zip(nodes) {
            self.slot.push(nodes.map(|row| place(cluster, row)));
        }
        let count = self.body.len() as u32;
        let start = (0..=count).map(|c| rows.partition_point(|entry| entry[0] < c) as u32);
        let start = start.collect();
        let rows = rows.iter().map(|entry| entry[1]).collect();
        self.pattern = Arc::new(LowRankPattern { start, rows });
    }

    /// Sums over the elements of every cluster.
    fn sum(&mut self, elements: &dyn KeptByMean<S, V>, workers: &Workers) {
        let (n, volume) = (self.cluster.len(), self.volume);
        self.change.resize(n, S::ZERO);
        workers.for_chunks(&mut self.change, CHUNK, 2 * V * n, |first, own| {
            elements.changes(volume, workers, first, own);
        });
        self.sums.clear();
        self.sums.resize(self.body.len(), Sums::default());
        for (i, &cluster) in self.cluster.iter().enumerate() {
            self.sums[cluster as usize].add(elements.share(i), self.change[i].to_f64());
        }
    }

    /// Pressures of all elements and, with the values that are known for a tangent, its vectors. A function of its own, so
    /// that it is compiled once for all laws.
    fn measure(
        &mut self,
        elements: &dyn KeptByMean<S, V>,
        bodies: &[BodyId],
        (workers, recovering, known): (&Workers, &RecoveringBodies, Option<&PredictedValues>),
        [pressure, predicted]: [&mut [S]; 2],
        buffer: Option<MutexGuard<LawBuffer<S>>>,
    ) {
        self.lay_out(elements, bodies);
        self.sum(elements, workers);
        let spread = |to: &mut [S], found: &[f64], cluster: &[u32]| {
            for (to, &cluster) in to.iter_mut().zip(cluster) {
                *to = S::from_f64(found[cluster as usize]);
            }
        };
        let found: Vec<f64> = self.sums.iter().map(Sums::pressure).collect();
        spread(pressure, &found, &self.cluster);
        if let Some(known) = known {
            let (n, volume) = (bodies.len(), self.volume);
            self.area.resize(n, [[S::ZERO; 3]; V]);
            workers.for_chunks(&mut self.area, CHUNK, 5 * V * n, |first, own| {
                elements.areas(volume, workers, first, own);
            });
            spread(predicted, &self.predicted(known), &self.cluster);
        }
        let Some(mut buffer) = buffer else { return };
        let values = self.sums.iter().zip(&self.body);
        let values = values.map(|(sums, &body)| match recovering.contains(body as usize) {
            true => 0.0,
            false => sums.value(),
        });
        let values: Vec<f64> = values.collect();
        buffer.values.clone_from(&values);
        buffer.low_rank = known.is_some().then(|| LowRank {
            pattern: self.pattern.clone(),
            vectors: self.vectors(recovering),
            values,
        });
    }

    /// Largest mean change of volume of a cluster.
    fn largest_change(
        &mut self,
        elements: &dyn KeptByMean<S, V>,
        bodies: &[BodyId],
        workers: &Workers,
    ) -> f64 {
        self.lay_out(elements, bodies);
        self.sum(elements, workers);
        self.sums.iter().map(|sums| sums.mean().abs()).fold(0.0, f64::max)
    }

    /// Pressures (Pa) for the tangent.
    fn predicted(&self, known: &PredictedValues) -> Vec<f64> {
        let mut pressures = Vec::with_capacity(self.sums.len());
        let of_bodies = self.body.chunk_by(|a, b| a == b);
        for own in of_bodies {
            let sums = &self.sums[pressures.len()..pressures.len() + own.len()];
            match known.0.get(own[0] as usize).filter(|values| values.len() == own.len()) {
                Some(values) => {
                    let both = sums.iter().zip(values);
                    pressures.extend(both.map(|(sums, value)| sums.stiffness().sqrt() * value));
                }
                None => pressures.extend(sums.iter().map(Sums::pressure)),
            }
        }
        pressures
    }

    /// Vectors of the tangent (N^1/2 m^-1/2); zero for bodies that recover.
    fn vectors(&self, recovering: &RecoveringBodies) -> Vec<[S; 4]> {
        let mut vectors = vec![[S::ZERO; 4]; self.pattern.rows.len()];
        for (slot, area) in self.slot.iter().zip(&self.area) {
            for (&slot, area) in slot.iter().zip(area) {
                for k in 0..3 {
                    vectors[slot as usize][k] += area[k];
                }
            }
        }
        for (cluster, sums) in self.sums.iter().enumerate() {
            let silent = recovering.contains(self.body[cluster] as usize);
            let factor = if silent { 0.0 } else { sums.stiffness().sqrt() };
            let factor = S::from_f64(factor);
            for vector in &mut vectors[self.pattern.entries(cluster)] {
                *vector = vector.map(|x| x * factor);
            }
        }
        vectors
    }
}

/// Elements that one task measures.
const CHUNK: usize = 2048;

/// Query data of what is measured, and of the pressures that come of it.
type Measured<D, S> =
    (D, &'static BodyId, &'static mut ClusterPressure<S>, &'static mut PredictedPressure<S>);

/// Finds the mean of every cluster, the pressure of its elements and, where a tangent is asked for, the vectors that
/// belong to it.
fn measure<L: MeanLaw<S, V>, S: Scalar, const V: usize>(
    mut means: ResMut<MeansOf<L, S, V>>,
    (request, workers): (Res<EvaluationRequest>, Res<Workers>),
    (buffers, recovering): (Res<LawBuffers<S>>, Res<RecoveringBodies>),
    (known, points): (Res<PredictedValues>, Res<OwnPoints>),
    vertices: Query<&Displacement<S>>,
    mut elements: Query<Measured<L::Data, S>, With<L::Mark>>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some(rows) = single_table(elements.contiguous_iter_mut()) else { return };
    let (data, bodies, mut pressure, mut predicted) = rows;
    // not a change that anybody has to look for: it follows from what the law declares
    let pressures = [
        ClusterPressure::peel_slice_mut(pressure.bypass_change_detection()),
        PredictedPressure::peel_slice_mut(predicted.bypass_change_detection()),
    ];
    let tangent = request.tangent.is_some();
    let with = (&*workers, &*recovering, tangent.then_some(&*known));
    let buffer = buffers.get(means.0.law);
    means.0.measure(&L::columns(u, data, &points), bodies, with, pressures, buffer);
}

/// Tells the largest mean change of volume of a cluster, at the end of a step.
fn report<L: MeanLaw<S, V>, S: Scalar, const V: usize>(
    mut means: ResMut<MeansOf<L, S, V>>,
    (workers, failure, points): (Res<Workers>, Res<StepFailure>, Res<OwnPoints>),
    sleeping: Res<SleepingBodies>,
    mut volumes: ResMut<VolumeReport>,
    vertices: Query<&Displacement<S>>,
    elements: Query<(L::Data, &BodyId), With<L::Mark>>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((data, bodies)) = single_table(elements.contiguous_iter()) else { return };
    if failure.0.is_some() || sleeping.everyone() {
        return;
    }
    let largest = means.0.largest_change(&L::columns(u, data, &points), bodies, &workers);
    volumes.largest_mean_change = volumes.largest_mean_change.max(largest);
}
