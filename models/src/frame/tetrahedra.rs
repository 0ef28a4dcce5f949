//! Laws evaluated tetrahedron by tetrahedron: their columns, and the passes for energy, force and tangent.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    RestVolume, ShapeGradients, TetrahedronBlocks, TetrahedronShapes, TetrahedronVertices,
    displacement_gradient,
};
use sinew_engine::isoparametric::NO_OWN_POINTS;
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES, padded};
use sinew_engine::law::{
    EvaluationRequest, LawBuffer, LawBuffers, LawInfo, RecoveringBodies, Span, TangentKind,
};
use sinew_engine::scalar::{Real, Scalar, Single};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{self, LawProducts, add_vertices, sum, work};
use super::law::TetrahedronLaw;
use super::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use super::part::spawn_tetrahedra;
use super::row::{Activate, Elements, InRecovery, LawRow, PlacedLaw, activate_elements, mark};
use super::rules;
use super::stand_in::Corotational;
use crate::element::projection;
use crate::element::tetrahedron::{self, Element, TetrahedronTangent};

impl LawRow {
    /// Law `L` of tetrahedra.
    pub const fn tetrahedra<L: TetrahedronLaw<Mark = L> + Component + Default>() -> Self {
        Self {
            elements: Elements::Tetrahedra,
            spawn: Some([spawn_tetrahedra::<L, f64>, spawn_tetrahedra::<L, Single>]),
            ..Self::pooled_tetrahedra::<L>()
        }
    }

    /// This law by the kernels of the corotational one, with the tangent that holds rotations.
    pub(crate) const fn warped(self) -> Self {
        Self { activate: [activate_warped::<f64>, activate_warped::<Single>], ..self }
    }

    /// Law `L` of the tetrahedra of pooled bodies.
    pub(crate) const fn pooled_tetrahedra<L: TetrahedronLaw>() -> Self {
        let activate: [Activate; 2] = [activate::<L, f64>, activate::<L, Single>];
        let (info, elements) = (LawInfo::elastic(L::NAME), Elements::PooledTetrahedra);
        Self {
            forces: L::FORCES,
            tangent: L::contributes,
            recovery: if L::STANDS_IN { InRecovery::StandIn } else { InRecovery::Silent },
            energy: Some(|e, u| L::energy(e, u)),
            element_forces: Some(|e, u| L::forces(e, u)),
            holds_pressure: L::HOLDS_PRESSURE,
            softens: L::SOFTENS,
            ..Self::of_systems(info, elements, [mark::<L::Mark>; 2], activate)
        }
    }
}

/// Puts `L` into the force schedule.
pub(crate) fn activate<L: TetrahedronLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<TetrahedronVertices, S, TetrahedronData<S>>(
        world,
        law,
        |with, u, data, buffer| {
            evaluate_spans::<L, S>(&TetrahedronColumns::new(u, data), with, |kind| kind, buffer);
        },
    );
}

/// The same for [`WarpedStiffness`](crate::laws::corotational::WarpedStiffness), by the kernels of the corotational law.
pub(crate) fn activate_warped<S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<TetrahedronVertices, S, TetrahedronData<S>>(
        world,
        law,
        |with, u, data, buffer| {
            let columns = TetrahedronColumns::new(u, data);
            evaluate_spans::<Corotational, S>(&columns, with, |_| TangentKind::GaussNewton, buffer);
        },
    );
}

/// Columns of the tetrahedra, as slices.
#[derive(Clone, Copy, Debug)]
pub struct TetrahedronColumns<'a, S> {
    /// Displacements, vertex rows and shape vectors.
    pub shapes: TetrahedronShapes<'a, S>,
    /// Tangent blocks of the edges.
    pub blocks: &'a [[u32; 6]],
    /// Rest volumes (m^3).
    pub volume: &'a [S],
    /// First Lamé parameters (Pa).
    pub lambda: &'a [S],
    /// Shear moduli (Pa).
    pub mu: &'a [S],
    /// Moduli of the compression term (Pa).
    pub compression: &'a [S],
    /// Pressures (Pa) of their clusters; empty for elements that keep their volume alone.
    pub pressure: &'a [S],
    /// The same for tangents.
    pub predicted: &'a [S],
}

/// Query data of [`TetrahedronColumns`].
pub type TetrahedronData<S> = (
    &'static TetrahedronVertices,
    &'static TetrahedronBlocks,
    ShapeGradients<S>,
    &'static RestVolume<S>,
    &'static FirstLameParameter<S>,
    &'static ShearModulus<S>,
    &'static CompressionModulus<S>,
);

/// Slices of [`TetrahedronData`].
pub type TetrahedronSlices<'a, S> = <TetrahedronData<S> as ContiguousQueryData>::Contiguous<'a, 'a>;

impl<'a, S: Scalar> TetrahedronColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        (nodes, blocks, gradients, volume, lambda, mu, compression): TetrahedronSlices<'a, S>,
    ) -> Self {
        Self {
            shapes: TetrahedronShapes::new(displacement, nodes, gradients),
            blocks: TetrahedronBlocks::peel_slice(blocks),
            volume: RestVolume::peel_slice(volume),
            lambda: FirstLameParameter::peel_slice(lambda),
            mu: ShearModulus::peel_slice(mu),
            compression: CompressionModulus::peel_slice(compression),
            pressure: &[],
            predicted: &[],
        }
    }

    /// The tetrahedra from `first` on. The volume is multiplied into the moduli, which saves doing
    /// so with every result, unless the law needs it.
    #[inline(always)]
    fn element<Law: TetrahedronLaw, L: Lanes<Scalar = S>>(&self, first: usize) -> Element<L> {
        let volume = L::load(&self.volume[first..]);
        let moduli = [
            L::load(&self.lambda[first..]),
            L::load(&self.mu[first..]),
            L::load(&self.compression[first..]),
        ];
        let plain = Element::plain(self.shapes.gradients(first), volume, moduli);
        let e = if Law::VOLUME.is_some() && !self.pressure.is_empty() {
            let pressure = L::load(&self.pressure[first..]);
            rules::in_cluster(Element { pressure, ..plain })
        } else {
            plain
        };
        if !Law::FOLDS_VOLUME {
            return e;
        }
        Element {
            volume: L::splat(S::ONE),
            lambda: e.lambda * volume,
            mu: e.mu * volume,
            compression: e.compression * volume,
            pressure: e.pressure * volume,
            quartic: e.quartic * volume,
            ..e
        }
    }
}

/// The last, incomplete batch of a range: the missing elements repeat the last one without stiffness.
pub(super) struct Tail<S> {
    nodes: [[u32; 4]; MAX_LANES],
    blocks: [[u32; 6]; MAX_LANES],
    gradients: [[S; MAX_LANES]; 9],
    volume: [S; MAX_LANES],
    moduli: [[S; MAX_LANES]; 3],
    pressure: [S; MAX_LANES],
    /// Whether elements have pressures.
    clustered: bool,
}

impl<S: Scalar> Tail<S> {
    pub(super) fn new(columns: &TetrahedronColumns<S>, first: usize, end: usize) -> Self {
        let stiffness = |column: &[S]| {
            let mut column = padded(column, first, end);
            column[end - first..].fill(S::ZERO);
            column
        };
        Self {
            nodes: padded(columns.shapes.nodes, first, end),
            blocks: padded(columns.blocks, first, end),
            gradients: columns.shapes.gradients.map(|column| padded(column, first, end)),
            volume: padded(columns.volume, first, end),
            moduli: [columns.lambda, columns.mu, columns.compression].map(stiffness),
            pressure: match columns.pressure {
                [] => [S::ZERO; MAX_LANES],
                pressure => stiffness(pressure),
            },
            clustered: !columns.pressure.is_empty(),
        }
    }

    pub(super) fn columns<'a>(&'a self, displacement: &'a [[S; 4]]) -> TetrahedronColumns<'a, S> {
        TetrahedronColumns {
            shapes: TetrahedronShapes {
                displacement,
                nodes: &self.nodes,
                gradients: std::array::from_fn(|i| &self.gradients[i][..]),
            },
            blocks: &self.blocks,
            volume: &self.volume,
            lambda: &self.moduli[0],
            mu: &self.moduli[1],
            compression: &self.moduli[2],
            pressure: if self.clustered { &self.pressure } else { &[] },
            predicted: &[],
        }
    }
}

/// What the system of law `L` does with the columns of its tetrahedra: energy, force and tangent of
/// every range into its private arrays, as far as they are asked for.
pub fn evaluate_columns<L: TetrahedronLaw, S: Scalar>(
    columns: &TetrahedronColumns<S>,
    request: &EvaluationRequest,
    workers: &Workers,
    buffer: &mut LawBuffer<S>,
) {
    let recovering = &RecoveringBodies::default();
    let with = Evaluation { request, workers, recovering, points: &NO_OWN_POINTS };
    evaluate_spans::<L, S>(columns, with, |kind| kind, buffer);
}

/// [`evaluate_columns`] with the corotational energy for bodies that recover; `by` is the kind of tangent that takes the
/// place of one that is asked for.
pub(super) fn evaluate_spans<L: TetrahedronLaw, S: Scalar>(
    columns: &TetrahedronColumns<S>,
    Evaluation { request, workers, recovering, .. }: Evaluation,
    by: fn(TangentKind) -> TangentKind,
    buffer: &mut LawBuffer<S>,
) {
    let own = EvaluationRequest {
        energy: L::FORCES && request.energy,
        force: L::FORCES && request.force,
        tangent: request.tangent.filter(|&kind| L::contributes(kind)).map(by),
    };
    let projected = own.tangent == Some(TangentKind::Projected);
    let work = work(&own, [5, 8, if projected { 120 } else { 50 }]);
    buffer.for_each_awake(workers, columns.volume.len() * work, |_, span| {
        if !recovering.contains(span.body) {
            if !L::FORCES {
                // what it held while the body recovered
                span.silence();
            }
            evaluate_span::<L, S>(columns, &own, workers, span);
        } else if L::STANDS_IN {
            let alone = TetrahedronColumns { pressure: &[], predicted: &[], ..*columns };
            evaluate_span::<Corotational, S>(&alone, request, workers, span);
        } else {
            span.silence();
        }
    });
}

/// Energy, force and tangent of one range, as far as they are asked for.
fn evaluate_span<L: TetrahedronLaw, S: Scalar>(
    columns: &TetrahedronColumns<S>,
    request: &EvaluationRequest,
    workers: &Workers,
    span: &mut Span<S>,
) {
    let law = PhantomData::<fn() -> L>;
    if L::FORCES {
        if request.energy {
            workers.dispatch(EnergyPass { columns, span, law });
        }
        if request.force {
            workers.dispatch(ForcePass { columns, span, law });
        }
    }
    match request.tangent {
        Some(kind) => {
            let columns = &TetrahedronColumns { pressure: columns.predicted, ..*columns };
            span.clear_tangent();
            let mut doubtful = Vec::new();
            workers.dispatch(TangentPass { columns, span, kind, doubtful: &mut doubtful, law });
            if L::STRESS_PROJECTION {
                workers.dispatch(ProjectionPass { columns, span, doubtful: &doubtful });
            }
        }
        None => span.drop_tangent(),
    }
}

/// The Projected tangent has no product without assembly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "law `{law}` has no product with its projected tangent: assemble it, or use the exact or the \
     Gauss-Newton one"
)]
pub struct NoProduct {
    /// Name of the law.
    pub law: &'static str,
}

/// Adds the product `K v` of a law's tangent to `result` (N when `direction` is in m), without assembly, at the
/// displacements that the world holds: for [`FusedStVK`](crate::laws::svk::FusedStVK) a fraction of the work of
/// [`evaluate_columns`] with a tangent, and of the memory. Nothing is added when the law is not active. Uses the
/// private force arrays of the law, which do not hold forces afterwards.
///
/// `direction` and `result` have one row per vertex row; fourth entries are padding.
///
/// # Errors
/// When a projected tangent is asked for of a law that clamps eigenvalues per element.
pub fn multiply<L: TetrahedronLaw, S: Scalar>(
    world: &mut World,
    kind: TangentKind,
    direction: &[[S; 4]],
    result: &mut [[S; 4]],
) -> Result<(), NoProduct> {
    let mut vertices = world.query::<&Displacement<S>>();
    let mut tetrahedra = world.query_filtered::<TetrahedronData<S>, With<L::Mark>>();
    let Some(mut buffer) = world.resource::<LawBuffers<S>>().get(L::NAME) else { return Ok(()) };
    if let Some(u) = single_table(vertices.contiguous_iter(world))
        && let Some(data) = single_table(tetrahedra.contiguous_iter(world))
    {
        if kind == TangentKind::Projected && L::STRESS_PROJECTION {
            return Err(NoProduct { law: L::NAME });
        }
        if L::contributes(kind) {
            let columns = &TetrahedronColumns::new(u, data);
            let columns = &OfLaw { columns, law: PhantomData::<fn() -> L> };
            let workers = world.resource::<Workers>();
            columns::multiply(columns, kind, direction, workers, 12, &mut buffer, result);
        }
    }
    Ok(())
}

/// Tetrahedra that follow law `Law`.
struct OfLaw<'a, 'b, Law, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    law: PhantomData<fn() -> Law>,
}

impl<Law: TetrahedronLaw, S: Scalar> LawProducts<S, 4> for OfLaw<'_, '_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn nodes(&self) -> &[[u32; 4]] {
        self.columns.shapes.nodes
    }
    #[inline(always)]
    fn products<L: Lanes<Scalar = S>>(
        &self,
        first: usize,
        kind: TangentKind,
        v: &[[L; 3]; 4],
    ) -> [[L; 3]; 4] {
        let u = self.columns.shapes.displacements(first);
        Law::product(&self.columns.element::<Law, L>(first), &u, v, kind)
    }
}

/// The batches of a range: `$batch` runs with the columns `$columns`, complete or those of the tail, at
/// `$at`, whose first element has the table row `$first`. One place of use, so that a law is compiled
/// once for each register type.
macro_rules! for_batches {
    ($L:ident, $all:expr, $elements:expr, |$columns:ident, $at:ident, $first:ident| $batch:expr) => {{
        let (all, elements): (&TetrahedronColumns<_>, std::ops::Range<usize>) = ($all, $elements);
        // where the incomplete batch begins
        let whole = elements.end - elements.len() % $L::COUNT;
        let tail = if whole < elements.end {
            Some($crate::frame::tetrahedra::Tail::new(all, whole, elements.end))
        } else {
            None
        };
        let last = match &tail {
            Some(tail) => Some(tail.columns(all.shapes.displacement)),
            None => None,
        };
        for $first in elements.step_by($L::COUNT) {
            let ($columns, $at) = match &last {
                Some(columns) if $first == whole => (columns, 0),
                _ => (all, $first),
            };
            $batch;
        }
    }};
}

pub(super) use for_batches;

struct EnergyPass<'a, 'b, L, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    span: &'a mut Span<S>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for EnergyPass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let mut sums = [0.0; MAX_LANES];
        for_batches!(L, self.columns, self.span.elements.clone(), |columns, at, _first| {
            let u = columns.shapes.displacements(at);
            let mut e = columns.element::<Law, L>(at);
            // over a cluster, half its pressure times `J - 1` adds up to its energy
            e.pressure *= L::from_f64(0.5);
            Law::energy::<L>(&e, &u).accumulate(&mut sums);
        });
        self.span.energy = sum(sums);
    }
}

struct ForcePass<'a, 'b, L, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    span: &'a mut Span<S>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for ForcePass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, .. } = self;
        span.clear_force();
        for_batches!(L, columns, span.elements.clone(), |columns, at, _first| {
            let u = columns.shapes.displacements(at);
            if let Some(forces) = Law::forces::<L>(&columns.element::<Law, L>(at), &u) {
                let (row, nodes) = (span.rows.start, &columns.shapes.nodes[at..]);
                add_vertices(forces, &mut span.force, row, nodes);
            }
        });
    }
}

/// Exact or Gauss-Newton tangents; of a projected one the elements that surely need no projection,
/// while the others are listed for [`ProjectionPass`].
struct TangentPass<'a, 'b, L, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    span: &'a mut Span<S>,
    kind: TangentKind,
    doubtful: &'a mut Vec<usize>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for TangentPass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, kind, doubtful, .. } = self;
        for_batches!(L, columns, span.elements.clone(), |columns, at, first| {
            let u = columns.shapes.displacements::<L>(at);
            let mut e = columns.element::<Law, L>(at);
            if kind == TangentKind::Projected && !Law::STRESS_PROJECTION {
                let mut flags = [0.0; MAX_LANES];
                L::select(Law::is_clamped(&e, &u), L::ONE, L::ZERO).accumulate(&mut flags);
                span.clamped += sum(flags) as u64;
            }
            if kind == TangentKind::Projected && Law::STRESS_PROJECTION {
                let g = displacement_gradient(&e.gradients, &u);
                let margin = 1e6 * S::EPSILON.to_f64();
                let mask = projection::is_doubtful(&e, &g, margin);
                if L::any(mask) {
                    let mut flags = [S::ZERO; MAX_LANES];
                    L::select(mask, L::ONE, L::ZERO).store(&mut flags);
                    let known = doubtful.len();
                    for lane in 0..L::COUNT {
                        if flags[lane] != S::ZERO {
                            doubtful.push(first + lane);
                        }
                    }
                    if doubtful.len() == known + L::COUNT {
                        continue;
                    }
                    e.lambda = L::select(mask, L::ZERO, e.lambda);
                    e.mu = L::select(mask, L::ZERO, e.mu);
                    e.compression = L::select(mask, L::ZERO, e.compression);
                }
            }
            let mut t = Law::tangent::<L>(&e, &u, kind);
            add_tangent(&mut t, span, &columns.shapes.nodes[at..], &columns.blocks[at..]);
        });
    }
}

/// Adds the tangents of the tetrahedra at the start of `nodes` and `blocks` to a range.
#[inline(always)]
pub(crate) fn add_tangent<L: Lanes>(
    t: &mut TetrahedronTangent<L>,
    span: &mut Span<L::Scalar>,
    nodes: &[[u32; 4]],
    blocks: &[[u32; 6]],
) {
    orient(t, nodes);
    for a in 0..4 {
        L::add_blocks(&t.diagonal[a], &mut span.diagonal, span.rows.start, nodes, a);
    }
    for edge in 0..6 {
        L::add_blocks(&t.off[edge], &mut span.off_diagonal, span.blocks.start, blocks, edge);
    }
}

/// Transposes the block of local vertices 2 and 3 where the latter is the lower row, since only the
/// upper half of a tangent is stored; all other pairs ascend by the layout.
#[inline(always)]
fn orient<L: Lanes>(t: &mut TetrahedronTangent<L>, nodes: &[[u32; 4]]) {
    let mut flags = [L::Scalar::ZERO; MAX_LANES];
    for (flag, n) in flags.iter_mut().zip(&nodes[..L::COUNT]) {
        debug_assert!(n[0] < n[1] && n[1] < n[2].min(n[3]));
        *flag = if n[2] > n[3] { L::Scalar::ONE } else { L::Scalar::ZERO };
    }
    let mask = L::less(L::ZERO, L::load(&flags));
    let block = &mut t.off[5];
    for (x, y) in [(1, 3), (2, 6), (5, 7)] {
        let (upper, lower) = (block[x], block[y]);
        block[x] = L::select(mask, lower, upper);
        block[y] = L::select(mask, upper, lower);
    }
}

/// Projected tangents of the elements that may need it, in `f64` whatever the simulation's type: that of St
/// Venant-Kirchhoff with the compression term, whose stress the laws with a stress projection share.
struct ProjectionPass<'a, 'b, S> {
    columns: &'a TetrahedronColumns<'b, S>,
    span: &'a mut Span<S>,
    doubtful: &'a [usize],
}

impl<S: Scalar> Kernel<f64> for ProjectionPass<'_, '_, S> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes<Scalar = f64>>(self) {
        let Self { columns, span, doubtful, .. } = self;
        for batch in doubtful.chunks(L::COUNT) {
            projection_batch::<S, L>(columns, batch, span);
        }
    }
}

#[inline(always)]
fn projection_batch<S: Scalar, L: Lanes<Scalar = f64>>(
    columns: &TetrahedronColumns<S>,
    batch: &[usize],
    span: &mut Span<S>,
) {
    let shapes = &columns.shapes;
    let mut gradients = [[[0.0; MAX_LANES]; 3]; 3];
    let mut displacements = [[[0.0; MAX_LANES]; 3]; 4];
    let mut moduli = [[0.0; MAX_LANES]; 3];
    let mut nodes = [[0; 4]; MAX_LANES];
    let mut blocks = [[0; 6]; MAX_LANES];
    for lane in 0..L::COUNT {
        // missing elements repeat the first one without stiffness
        let i = batch[if lane < batch.len() { lane } else { 0 }];
        (nodes[lane], blocks[lane]) = (shapes.nodes[i], columns.blocks[i]);
        for a in 0..4 {
            let row = shapes.displacement[nodes[lane][a] as usize];
            for x in 0..3 {
                displacements[a][x][lane] = row[x].to_f64();
                if a < 3 {
                    gradients[a][x][lane] = shapes.gradients[3 * a + x][i].to_f64();
                }
            }
        }
        if lane < batch.len() {
            let volume = columns.volume[i].to_f64();
            moduli[0][lane] = columns.lambda[i].to_f64() * volume;
            moduli[1][lane] = columns.mu[i].to_f64() * volume;
            moduli[2][lane] = columns.compression[i].to_f64() * volume;
        }
    }
    let moduli = [L::load(&moduli[0]), L::load(&moduli[1]), L::load(&moduli[2])];
    let mut e = Element::plain([[L::ZERO; 3]; 3], L::ONE, moduli);
    let mut u = [[L::ZERO; 3]; 4];
    for a in 0..4 {
        for x in 0..3 {
            u[a][x] = L::load(&displacements[a][x]);
            if a < 3 {
                e.gradients[a][x] = L::load(&gradients[a][x]);
            }
        }
    }
    let g = displacement_gradient(&e.gradients, &u);
    let (clamped, core) = projection::projected_blocks(&e, &g);
    let mut t = match core {
        Some(core) => tetrahedron::assemble(&core),
        None => tetrahedron::tangent_parts(&e, &u, true, true),
    };
    if L::any(clamped) {
        let mut flags = [0.0; MAX_LANES];
        L::select(clamped, L::ONE, L::ZERO).store(&mut flags);
        span.clamped += sum(flags) as u64;
    }
    orient(&mut t, &nodes);
    let mut values = [[0.0; MAX_LANES]; 9];
    for a in 0..4 {
        for k in 0..9 {
            t.diagonal[a][k].store(&mut values[k]);
        }
        for lane in 0..batch.len() {
            let row = nodes[lane][a] as usize - span.rows.start;
            add_lane(&mut span.diagonal[row], &values, lane);
        }
    }
    for edge in 0..6 {
        for k in 0..9 {
            t.off[edge][k].store(&mut values[k]);
        }
        for lane in 0..batch.len() {
            let block = blocks[lane][edge] as usize - span.blocks.start;
            add_lane(&mut span.off_diagonal[block], &values, lane);
        }
    }
}

#[inline(always)]
fn add_lane<S: Scalar>(block: &mut [S; 9], values: &[[f64; MAX_LANES]; 9], lane: usize) {
    for k in 0..9 {
        block[k] += S::from_f64(values[k][lane]);
    }
}
