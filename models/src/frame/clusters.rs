//! Volume by clusters: a treatment of locking for linear tetrahedra.
//!
//! Near incompressibility one volume ratio per tetrahedron, some five per vertex, is more than vertices can hold. Here a
//! small part of `lambda` stays with every tetrahedron and the rest acts on the mean of a cluster of about twenty, some
//! 0.15 per vertex. With `m = J - 1`:
//!
//! ```text
//! lambda_e = min(lambda, mu/4)    lambda_c = lambda - lambda_e    kappa = 10 mu where nu >= 0.45, else 0       Pa
//! W   = sum_t V_t (shape(F_t) + lambda_e/2 m_t^2 + kappa/2 m_t^4) + sum_c V_c lambda_c/2 m_c^2                  J
//! m_c = sum_t V_t m_t / V_c       V_c = sum_t V_t                 p_c = lambda_c m_c
//! f_a = - sum_t V_t (P_shape + w_t cof F_t) D_a                   w_t = lambda_e m_t + 2 kappa m_t^3 + p_c(t)   N
//! K   = sum_t K_t(w_t, lambda_e + 6 kappa m_t^2) + sum_c lambda_c/V_c b_c b_c^T,  b_c,a = sum_t V_t cof F_t D_a
//! ```
//!
//! The clusters cover the body once, so that the continuum law does not depend on `lambda_e`; where materials meet,
//! `lambda_c` is the mean by volume. The quartic term acts on both signs and keeps single elements from collapsing, since
//! only means are held. The vectors `b_c` are part of the tangent as they are ([`LowRank`]), never added up.
//!
//! Three systems share the work: `measure` finds the mean of every cluster before the laws run, and writes its
//! pressure to its elements; the law reads that column; its buffer carries the vectors.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{TetrahedronVertices, displacement_gradient, volume_change};
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffers, RecoveringBodies};
use sinew_engine::matrix::{LowRank, LowRankPattern, PredictedValues};
use sinew_engine::report::VolumeReport;
use sinew_engine::scalar::{Real, Scalar, mat_vec};
use sinew_engine::schedule::{
    Evaluation, ForceSystems, StepSchedule, StepSystems, activate_systems, declare_inputs,
};
use sinew_engine::step::{StepFailure, measure_volume_ratios};
use sinew_engine::vertex::{BodyId, Displacement};
use sinew_engine::workers::Workers;

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

use super::columns::scalar_columns;
use super::tetrahedra::{
    TetrahedronColumns, TetrahedronData, TetrahedronLaw, evaluate_spans, for_batches,
};
use crate::element::tetrahedron::{Element, cofactor};
use crate::laws::{LawRow, activate_elements};

/// Cluster that a tetrahedron belongs to; numbers are unique in a world and otherwise without meaning.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick)]
#[repr(transparent)]
pub struct ClusterIndex(pub u32);

scalar_columns! {
    /// Pressure of the cluster of a tetrahedron (Pa), positive in expansion; found anew by every evaluation.
    ClusterPressure,
    /// The same as tangents take it ([`PredictedValues`]).
    PredictedPressure,
}

/// Law `L` with the large part of its volume term by clusters; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug)]
pub struct ByClusters<L: Send + Sync + 'static>(PhantomData<fn() -> L>);

impl<L: Send + Sync + 'static> Default for ByClusters<L> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

/// Part of `lambda` that stays with every element.
#[inline(always)]
fn own_part<R: Real>(lambda: R, mu: R) -> R {
    lambda.min(R::from_f64(0.25) * mu)
}

/// An element as the laws see it: without the part of `lambda` that its cluster has. `lambda/mu` is 9 at nu = 0.45.
#[inline(always)]
pub(crate) fn in_cluster<R: Real>(e: Element<R>) -> Element<R> {
    let stiff = R::less(R::from_f64(8.999) * e.mu, e.lambda);
    let quartic = R::select(stiff, R::from_f64(10.0) * e.mu, R::ZERO);
    Element { lambda: own_part(e.lambda, e.mu), quartic, ..e }
}

/// Query data of tetrahedra in clusters.
type Data<S> = (
    TetrahedronData<S>,
    &'static ClusterIndex,
    &'static ClusterPressure<S>,
    &'static PredictedPressure<S>,
);

/// Puts `L` by clusters into the force schedule.
pub(crate) fn activate<L: TetrahedronLaw, S: Scalar>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    const { assert!(L::TAKES_PRESSURE) };
    activate_elements::<TetrahedronVertices, S, Data<S>>(
        world,
        row,
        place,
        |Evaluation { request, workers, recovering }, u, (data, _, pressure, predicted), buffer| {
            let pressure = ClusterPressure::peel_slice(pressure);
            let predicted = PredictedPressure::peel_slice(predicted);
            let plain = TetrahedronColumns::new(u, data);
            let columns = TetrahedronColumns { pressure, predicted, ..plain };
            let with = Evaluation { request, workers, recovering };
            evaluate_spans::<L, S>(&columns, with, buffer);
        },
    );
    let Some(name) = row.measure else { return };
    let law = row.info.name;
    let state: Clusters<L, S> = Clusters { law, ..Clusters::default() };
    world.insert_resource(state);
    let new = activate_systems(world, name, |schedule| {
        schedule.add_systems(measure::<L, S>.in_set(ForceSystems::Measure));
    });
    if new {
        world.resource_mut::<Schedules>().entry(StepSchedule).add_systems(
            report::<L, S>.in_set(StepSystems::Report).after(measure_volume_ratios::<S>),
        );
        // what it writes follows from the displacements and what the law itself declares
        declare_inputs(world, name, &[]);
    }
}

/// The clusters of a law.
#[derive(Resource, Debug)]
struct Clusters<L: TetrahedronLaw, S: Scalar> {
    /// Name of the law.
    law: &'static str,
    /// What the rest was found for.
    index: Vec<ClusterIndex>,
    nodes: Vec<TetrahedronVertices>,
    /// Cluster of every element, counted from 0 in the order of their first elements.
    cluster: Vec<u32>,
    /// Place of the vertices of every element among the entries of its cluster.
    slot: Vec<[u32; 4]>,
    /// Body of every cluster.
    body: Vec<u32>,
    pattern: Arc<LowRankPattern>,
    /// `m_t`, and `V_t cof F_t D_a` (m^2) of the vertices 1 to 3.
    change: Vec<S>,
    area: Vec<[S; 9]>,
    sums: Vec<Sums>,
    of: PhantomData<fn() -> L>,
}

impl<L: TetrahedronLaw, S: Scalar> Default for Clusters<L, S> {
    fn default() -> Self {
        Self {
            law: "",
            index: Vec::new(),
            nodes: Vec::new(),
            cluster: Vec::new(),
            slot: Vec::new(),
            body: Vec::new(),
            pattern: Arc::default(),
            change: Vec::new(),
            area: Vec::new(),
            sums: Vec::new(),
            of: PhantomData,
        }
    }
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
    pub fn add(&mut self, volume: f64, change: f64, [lambda, mu]: [f64; 2]) {
        self.volume += volume;
        self.change += volume * change;
        self.modulus += volume * (lambda - own_part(lambda, mu));
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

impl<L: TetrahedronLaw, S: Scalar> Clusters<L, S> {
    /// Finds the entries of all clusters, unless they are those of these columns.
    fn lay_out(
        &mut self,
        index: &[ClusterIndex],
        nodes: &[TetrahedronVertices],
        bodies: &[BodyId],
    ) {
        if self.index == index && self.nodes == nodes {
            return;
        }
        self.index = index.to_vec();
        self.nodes = nodes.to_vec();
        let mut number = BTreeMap::new();
        self.body.clear();
        self.cluster.clear();
        for (index, body) in index.iter().zip(bodies) {
            let next = number.len() as u32;
            let own = *number.entry(index.0).or_insert(next);
            if own == next {
                self.body.push(body.0);
            }
            self.cluster.push(own);
        }
        let mut rows: Vec<[u32; 2]> = Vec::with_capacity(4 * nodes.len());
        for (&cluster, nodes) in self.cluster.iter().zip(nodes) {
            rows.extend(nodes.0.map(|row| [cluster, row]));
        }
        rows.sort_unstable();
        rows.dedup();
        let place = |cluster, row| {
            let found = rows.binary_search(&[cluster, row]);
            found.expect("every vertex of its elements is an entry of a cluster") as u32
        };
        self.slot.clear();
        for (&cluster, nodes) in self.cluster.iter().zip(nodes) {
            self.slot.push(nodes.0.map(|row| place(cluster, row)));
        }
        let count = self.body.len() as u32;
        let start = (0..=count).map(|c| rows.partition_point(|entry| entry[0] < c) as u32);
        let start = start.collect();
        let rows = rows.iter().map(|entry| entry[1]).collect();
        self.pattern = Arc::new(LowRankPattern { start, rows });
    }

    /// Sums over the elements of every cluster.
    fn sum(&mut self, columns: &TetrahedronColumns<'_, S>, workers: &Workers) {
        let n = self.cluster.len();
        self.change.resize(n, S::ZERO);
        workers.for_chunks(&mut self.change, CHUNK, 8 * n, |first, own| {
            workers.dispatch(Changes { columns, first, own });
        });
        self.sums.clear();
        self.sums.resize(self.body.len(), Sums::default());
        for (i, &cluster) in self.cluster.iter().enumerate() {
            let moduli = [columns.lambda[i].to_f64(), columns.mu[i].to_f64()];
            let (volume, change) = (columns.volume[i].to_f64(), self.change[i].to_f64());
            self.sums[cluster as usize].add(volume, change, moduli);
        }
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
            for k in 0..3 {
                let [a, b, c] = [area[k], area[3 + k], area[6 + k]];
                vectors[slot[0] as usize][k] -= a + b + c;
                vectors[slot[1] as usize][k] += a;
                vectors[slot[2] as usize][k] += b;
                vectors[slot[3] as usize][k] += c;
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

/// Finds the mean of every cluster, the pressure of its elements and, where a tangent is asked for, the vectors that
/// belong to it.
fn measure<L: TetrahedronLaw, S: Scalar>(
    mut clusters: ResMut<Clusters<L, S>>,
    (request, workers): (Res<EvaluationRequest>, Res<Workers>),
    (buffers, recovering): (Res<LawBuffers<S>>, Res<RecoveringBodies>),
    known: Res<PredictedValues>,
    vertices: Query<&Displacement<S>>,
    mut elements: Query<
        (
            TetrahedronData<S>,
            &ClusterIndex,
            &BodyId,
            &mut ClusterPressure<S>,
            &mut PredictedPressure<S>,
        ),
        With<ByClusters<L>>,
    >,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some(rows) = single_table(elements.contiguous_iter_mut()) else { return };
    let (data, index, bodies, mut pressure, mut predicted) = rows;
    let clusters = &mut *clusters;
    clusters.lay_out(index, data.0, bodies);
    let columns = &TetrahedronColumns::new(u, data);
    let tangent = request.tangent.is_some();
    clusters.sum(columns, &workers);
    if tangent {
        let n = index.len();
        clusters.area.resize(n, [S::ZERO; 9]);
        workers.for_chunks(&mut clusters.area, CHUNK, 20 * n, |first, own| {
            workers.dispatch(Areas { columns, first, own });
        });
    }
    let found: Vec<S> = clusters.sums.iter().map(|sums| S::from_f64(sums.pressure())).collect();
    // not a change that anybody has to look for: it follows from what the law declares
    let pressure = ClusterPressure::peel_slice_mut(pressure.bypass_change_detection());
    for (pressure, &cluster) in pressure.iter_mut().zip(&clusters.cluster) {
        *pressure = found[cluster as usize];
    }
    if tangent {
        let found = clusters.predicted(&known);
        let predicted = PredictedPressure::peel_slice_mut(predicted.bypass_change_detection());
        for (predicted, &cluster) in predicted.iter_mut().zip(&clusters.cluster) {
            *predicted = S::from_f64(found[cluster as usize]);
        }
    }
    let values = clusters.sums.iter().zip(&clusters.body);
    let values = values.map(|(sums, &body)| match recovering.contains(body as usize) {
        true => 0.0,
        false => sums.value(),
    });
    let values: Vec<f64> = values.collect();
    if let Some(mut buffer) = buffers.get(clusters.law) {
        buffer.values.clone_from(&values);
        buffer.low_rank = tangent.then(|| LowRank {
            pattern: clusters.pattern.clone(),
            vectors: clusters.vectors(&recovering),
            values,
        });
    }
}

/// Tells the largest change of volume of a cluster, at the end of a step.
fn report<L: TetrahedronLaw, S: Scalar>(
    mut clusters: ResMut<Clusters<L, S>>,
    (workers, failure): (Res<Workers>, Res<StepFailure>),
    mut volumes: ResMut<VolumeReport>,
    vertices: Query<&Displacement<S>>,
    elements: Query<(TetrahedronData<S>, &ClusterIndex, &BodyId), With<ByClusters<L>>>,
) {
    let Some(u) = single_table(vertices.contiguous_iter()) else { return };
    let Some((data, index, bodies)) = single_table(elements.contiguous_iter()) else { return };
    if failure.0.is_some() {
        return;
    }
    clusters.lay_out(index, data.0, bodies);
    clusters.sum(&TetrahedronColumns::new(u, data), &workers);
    let of_clusters = clusters.sums.iter().map(|sums| sums.mean().abs());
    volumes.largest_mean_change = of_clusters.fold(volumes.largest_mean_change, f64::max);
}

/// `J - 1` of the elements from `first` on.
struct Changes<'a, 'b, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    first: usize,
    own: &'a mut [S],
}

impl<S: Scalar> Kernel<S> for Changes<'_, '_, S> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, first: from, own } = self;
        for_batches!(L, columns, from..from + own.len(), |columns, at, first| {
            let g = displacement_gradient(
                &columns.shapes.gradients::<L>(at),
                &columns.shapes.displacements::<L>(at),
            );
            let mut values = [S::ZERO; MAX_LANES];
            volume_change(&g).store(&mut values);
            let to = &mut own[first - from..];
            let count = to.len().min(L::COUNT);
            to[..count].copy_from_slice(&values[..count]);
        });
    }
}

/// `V cof F D_a` of the elements from `first` on.
struct Areas<'a, 'b, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    first: usize,
    own: &'a mut [[S; 9]],
}

impl<S: Scalar> Kernel<S> for Areas<'_, '_, S> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, first: from, own } = self;
        for_batches!(L, columns, from..from + own.len(), |columns, at, first| {
            let gradients = columns.shapes.gradients::<L>(at);
            let g = displacement_gradient(&gradients, &columns.shapes.displacements::<L>(at));
            let cof = cofactor(&g);
            let volume = L::load(&columns.volume[at..]);
            let mut values = [[S::ZERO; MAX_LANES]; 9];
            for a in 0..3 {
                let area = mat_vec(&cof, gradients[a]);
                for k in 0..3 {
                    (volume * area[k]).store(&mut values[3 * a + k]);
                }
            }
            let to = &mut own[first - from..];
            let count = to.len().min(L::COUNT);
            for (lane, to) in to[..count].iter_mut().enumerate() {
                for k in 0..9 {
                    to[k] = values[k][lane];
                }
            }
        });
    }
}
