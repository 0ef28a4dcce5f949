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
//! only means are held. Laws whose volume term takes the trace of a strain for `m` ([`VolumeMeasure`]) have its slope in
//! place of `cof F`, and no quartic term: their shape holds flat elements. The vectors `b_c` are part of the tangent as they are (`LowRank`, [`means`]), never added up.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::element::{TetrahedronVertices, displacement_gradient};
use sinew_engine::isoparametric::OwnPoints;
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES};
use sinew_engine::law::LawInfo;
use sinew_engine::scalar::{Scalar, Single, mat_vec};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::law::TetrahedronLaw;
use super::means::{self, KeptByMean, MeanLaw};
use super::moduli::{ClusterIndex, ClusterPressure, PredictedPressure};
use super::part::spawn_clustered;
use super::row::{
    Activate, Elements, InRecovery, LawRow, Mark, Measure, PlacedLaw, activate_elements, mark,
};
use super::rules::{VolumeMeasure, in_cluster, shared_part};
use super::tetrahedra::{TetrahedronColumns, TetrahedronData, evaluate_spans, for_batches};

/// Law `L` with the large part of its volume term by clusters; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug)]
#[component(clone_behavior = Ignore)]
pub struct ByClusters<L: Send + Sync + 'static>(PhantomData<fn() -> L>);

impl<L: Send + Sync + 'static> Default for ByClusters<L> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl LawRow {
    /// Law `L` of tetrahedra with its volume term by clusters ([`super::clusters`]), under another name; `measure` is that of
    /// the system that finds their means.
    pub const fn tetrahedra_by_clusters<L: TetrahedronLaw>(
        name: &'static str,
        measure: &'static str,
    ) -> Self {
        let activate: [Activate; 2] = [activate::<L, f64>, activate::<L, Single>];
        let mark: [Mark; 2] = [mark::<ByClusters<L>>; 2];
        Self {
            recovery: InRecovery::StandIn,
            energy: Some(|e, u| L::energy(&in_cluster(*e), u)),
            holds_pressure: L::HOLDS_PRESSURE,
            softens: L::SOFTENS,
            spawn: Some([
                spawn_clustered::<ByClusters<L>, f64>,
                spawn_clustered::<ByClusters<L>, Single>,
            ]),
            measure: Measure::of::<L>(measure),
            ..Self::of_systems(LawInfo::elastic(name), Elements::Tetrahedra, mark, activate)
        }
    }
}

/// Query data of tetrahedra in clusters.
type Data<S> = (
    TetrahedronData<S>,
    &'static ClusterIndex,
    &'static ClusterPressure<S>,
    &'static PredictedPressure<S>,
);

/// Puts `L` by clusters into the force schedule.
pub(crate) fn activate<L: TetrahedronLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    const { assert!(L::VOLUME.is_some()) };
    activate_elements::<TetrahedronVertices, S, Data<S>>(
        world,
        law,
        |with, u, (data, _, pressure, predicted), buffer| {
            let pressure = ClusterPressure::peel_slice(pressure);
            let predicted = PredictedPressure::peel_slice(predicted);
            let plain = TetrahedronColumns::new(u, data);
            let columns = TetrahedronColumns { pressure, predicted, ..plain };
            evaluate_spans::<L, S>(&columns, with, |kind| kind, buffer);
        },
    );
    means::activate::<ByClusters<L>, S, 4>(world, law);
}

/// Tetrahedra in clusters, as slices.
pub(crate) struct Clustered<'a, S>(TetrahedronColumns<'a, S>, &'a [ClusterIndex]);

impl<L: TetrahedronLaw, S: Scalar> MeanLaw<S, 4> for ByClusters<L> {
    type Mark = Self;
    type Data = (TetrahedronData<S>, &'static ClusterIndex);
    type Columns<'a> = Clustered<'a, S>;
    fn columns<'a>(
        displacement: &'a [Displacement<S>],
        (data, index): <Self::Data as ContiguousQueryData>::Contiguous<'a, 'a>,
        _: &'a OwnPoints,
    ) -> Clustered<'a, S> {
        Clustered(TetrahedronColumns::new(displacement, data), index)
    }
}

impl<S: Scalar> KeptByMean<S, 4> for Clustered<'_, S> {
    fn nodes(&self) -> &[[u32; 4]] {
        self.0.shapes.nodes
    }
    fn clusters(&self) -> Option<&[ClusterIndex]> {
        Some(self.1)
    }
    fn share(&self, element: usize) -> [f64; 2] {
        let [volume, lambda, mu] =
            [self.0.volume, self.0.lambda, self.0.mu].map(|column| column[element].to_f64());
        [volume, shared_part(lambda, mu)]
    }
    fn changes(&self, measure: VolumeMeasure, workers: &Workers, first: usize, own: &mut [S]) {
        workers.dispatch(Changes { columns: &self.0, measure, first, own });
    }
    fn areas(
        &self,
        measure: VolumeMeasure,
        workers: &Workers,
        first: usize,
        own: &mut [[[S; 3]; 4]],
    ) {
        workers.dispatch(Areas { columns: &self.0, measure, first, own });
    }
}

/// `m` of the elements from `first` on.
struct Changes<'a, 'b, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [S],
}

impl<S: Scalar> Kernel<S> for Changes<'_, '_, S> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, measure, first: from, own } = self;
        for_batches!(L, columns, from..from + own.len(), |columns, at, first| {
            let g = displacement_gradient(
                &columns.shapes.gradients::<L>(at),
                &columns.shapes.displacements::<L>(at),
            );
            let mut values = [S::ZERO; MAX_LANES];
            measure.change(&g).store(&mut values);
            let to = &mut own[first - from..];
            let count = to.len().min(L::COUNT);
            to[..count].copy_from_slice(&values[..count]);
        });
    }
}

/// `V dm/dF D_a` of the elements from `first` on.
struct Areas<'a, 'b, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [[[S; 3]; 4]],
}

impl<S: Scalar> Kernel<S> for Areas<'_, '_, S> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, measure, first: from, own } = self;
        for_batches!(L, columns, from..from + own.len(), |columns, at, first| {
            let gradients = columns.shapes.gradients::<L>(at);
            let g = displacement_gradient(&gradients, &columns.shapes.displacements::<L>(at));
            let slope = measure.slope(&g);
            let volume = L::load(&columns.volume[at..]);
            let mut values = [[[S::ZERO; MAX_LANES]; 3]; 3];
            for a in 0..3 {
                let area = mat_vec(&slope, gradients[a]);
                for k in 0..3 {
                    (volume * area[k]).store(&mut values[a][k]);
                }
            }
            let to = &mut own[first - from..];
            let count = to.len().min(L::COUNT);
            for (lane, to) in to[..count].iter_mut().enumerate() {
                let [a, b, c] = [0, 1, 2].map(|a| [0, 1, 2].map(|k| values[a][k][lane]));
                *to = [[0, 1, 2].map(|k| -(a[k] + b[k] + c[k])), a, b, c];
            }
        });
    }
}
