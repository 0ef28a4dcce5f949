//! Laws evaluated membrane triangle by membrane triangle: the trait that they implement, their columns, and the
//! passes for energy, force and tangent.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    MembraneBlocks, MembraneRest, MembraneRestColumns, MembraneShapes, MembraneVertices,
};
use sinew_engine::lanes::{Batch, Batches, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffer, LawBuffers, Span, TangentKind};
use sinew_engine::scalar::{Real, Scalar};
use sinew_engine::schedule::{ElementLaw, Evaluation, activate_law};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use crate::element::membrane::{Element, TriangleTangent};
use crate::laws::pooled::sum;
use crate::laws::{LawRow, partition};

macro_rules! moduli {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
        #[component(summary_tick)]
        #[repr(transparent)]
        pub struct $name<S: Scalar>(pub S);
    )+};
}
moduli! {
    /// First modulus of plane stress times thickness of a membrane triangle (N/m).
    MembraneFirstModulus,
    /// Shear modulus times thickness of a membrane triangle (N/m).
    MembraneShearModulus,
    /// Modulus of the compression term of a membrane triangle (N/m), or 0 without it.
    MembraneCompressionModulus,
}

/// A law whose energy is a sum over membrane triangles of a function of their three displacements.
pub trait TriangleLaw: Send + Sync + 'static {
    /// Name shown in reports; unique.
    const NAME: &'static str;
    /// Component of the triangles it acts on, and of no others; mostly the law itself.
    type Mark: Component;
    /// Whether it contributes energy and force.
    const FORCES: bool = true;
    /// Whether it is compiled for AVX-512 too ([`Kernel::WIDE`](sinew_engine::lanes::Kernel::WIDE)).
    const WIDE: bool = true;
    /// Whether it contributes to a tangent of this kind.
    fn contributes(_: TangentKind) -> bool {
        true
    }
    /// Energy (J).
    fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> R;
    /// Forces (N).
    fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> [[R; 3]; 3];
    /// Tangent (N/m).
    fn tangent<R: Real>(e: &Element<R>, u: &[[R; 3]; 3], kind: TangentKind) -> TriangleTangent<R>;
    /// Product (N) of the tangent with the displacements `v` (m).
    #[inline(always)]
    fn product<R: Real>(
        e: &Element<R>,
        u: &[[R; 3]; 3],
        v: &[[R; 3]; 3],
        kind: TangentKind,
    ) -> [[R; 3]; 3] {
        Self::tangent(e, u, kind).product(v)
    }
    /// Where the projected tangent differs from the exact one.
    #[inline(always)]
    fn is_clamped<R: Real>(_: &Element<R>, _: &[[R; 3]; 3]) -> R::Mask {
        R::less(R::ONE, R::ZERO)
    }
}

/// Puts `L` into the force schedule.
pub(crate) fn activate<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    let law = ElementLaw::<S, MembraneData<S>> {
        info: row.info,
        place,
        mark: Some(world.register_component::<L::Mark>()),
        partition: partition::<MembraneVertices, S>,
        evaluate: evaluate::<L, S>,
    };
    activate_law(world, law);
}

/// Columns of the membrane triangles, as slices.
#[derive(Clone, Copy, Debug)]
pub struct MembraneColumns<'a, S> {
    /// Displacements, vertex rows and rest shapes.
    pub shapes: MembraneShapes<'a, S>,
    /// Tangent blocks of the edges.
    pub blocks: &'a [[u32; 3]],
    /// First moduli (N/m).
    pub lambda: &'a [S],
    /// Shear moduli (N/m).
    pub mu: &'a [S],
    /// Moduli of the compression term (N/m).
    pub compression: &'a [S],
}

/// Query data of [`MembraneColumns`].
pub type MembraneData<S> = (
    &'static MembraneVertices,
    &'static MembraneBlocks,
    MembraneRest<S>,
    &'static MembraneFirstModulus<S>,
    &'static MembraneShearModulus<S>,
    &'static MembraneCompressionModulus<S>,
);

/// Slices of [`MembraneData`], as a contiguous query gives them.
pub type MembraneSlices<'a, S> = (
    &'a [MembraneVertices],
    &'a [MembraneBlocks],
    MembraneRestColumns<'a, S>,
    &'a [MembraneFirstModulus<S>],
    &'a [MembraneShearModulus<S>],
    &'a [MembraneCompressionModulus<S>],
);

impl<'a, S: Scalar> MembraneColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        (nodes, blocks, rest, lambda, mu, compression): MembraneSlices<'a, S>,
    ) -> Self {
        Self {
            shapes: MembraneShapes::new(displacement, nodes, rest),
            blocks: MembraneBlocks::peel_slice(blocks),
            lambda: MembraneFirstModulus::peel_slice(lambda),
            mu: MembraneShearModulus::peel_slice(mu),
            compression: MembraneCompressionModulus::peel_slice(compression),
        }
    }

    /// The triangles from `first` on.
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> Element<L> {
        Element {
            edges: self.shapes.edges(first),
            area: L::load(&self.shapes.area[first..]),
            lambda: L::load(&self.lambda[first..]),
            mu: L::load(&self.mu[first..]),
            compression: L::load(&self.compression[first..]),
        }
    }
}

fn evaluate<L: TriangleLaw, S: Scalar>(
    with: Evaluation,
    u: &[Displacement<S>],
    triangles: MembraneSlices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = MembraneColumns::new(u, triangles);
    evaluate_columns::<L, S>(&columns, with.request, with.workers, buffer);
}

/// What the system of law `L` does with the columns of its triangles: energy, force and tangent of
/// every range into its private arrays, as far as they are asked for.
pub fn evaluate_columns<L: TriangleLaw, S: Scalar>(
    columns: &MembraneColumns<S>,
    request: &EvaluationRequest,
    workers: &Workers,
    buffer: &mut LawBuffer<S>,
) {
    let tangent = request.tangent.filter(|&kind| L::contributes(kind));
    let (energy, force) = (L::FORCES && request.energy, L::FORCES && request.force);
    if !energy && !force && tangent.is_none() {
        buffer.drop_tangent();
        return;
    }
    let work_ns =
        4 * usize::from(energy) + 5 * usize::from(force) + 30 * usize::from(tangent.is_some());
    workers.for_each(&mut buffer.spans, columns.blocks.len() * work_ns, |_, span| {
        let (law, elements) = (PhantomData::<fn() -> L>, span.elements.clone());
        if L::FORCES {
            if energy {
                let batch = EnergyBatch { columns, sums: [0.0; MAX_LANES], law };
                span.energy = sum(workers.dispatch(Batches(elements.clone(), batch)).sums);
            }
            if force {
                span.clear_force();
                let (row, force) = (span.rows.start, &mut span.force[..]);
                let batch = ForceBatch { columns, force, row, law };
                workers.dispatch(Batches(elements.clone(), batch));
            }
        }
        match tangent {
            Some(kind) => {
                span.clear_tangent();
                let batch = TangentBatch { columns, span, kind, clamped: [0.0; MAX_LANES], law };
                let clamped = workers.dispatch(Batches(elements, batch)).clamped;
                span.clamped = sum(clamped) as u64;
            }
            None => span.drop_tangent(),
        }
    });
}

/// Adds the product `K v` of a law's tangent to `result` (N when `direction` is in m), without
/// assembly. Uses the private force arrays of `buffer`, which do not hold forces afterwards.
pub fn multiply_columns<L: TriangleLaw, S: Scalar>(
    columns: &MembraneColumns<S>,
    kind: TangentKind,
    direction: &[[S; 4]],
    workers: &Workers,
    buffer: &mut LawBuffer<S>,
    result: &mut [[S; 4]],
) {
    if !L::contributes(kind) {
        return;
    }
    workers.for_each(&mut buffer.spans, columns.blocks.len() * 8, |_, span| {
        span.clear_force();
        let (force, row) = (&mut span.force[..], span.rows.start);
        let batch = ProductBatch::<L, S> { columns, direction, kind, force, row, law: PhantomData };
        workers.dispatch(Batches(span.elements.clone(), batch));
    });
    buffer.add_forces_to(workers, result);
}

/// [`multiply_columns`] with the columns of the triangles of law `L` in `world`, at the displacements
/// that it holds; nothing is added when the law is not active.
pub fn multiply<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    kind: TangentKind,
    direction: &[[S; 4]],
    result: &mut [[S; 4]],
) {
    let mut vertices = world.query::<&Displacement<S>>();
    let mut triangles = world.query_filtered::<MembraneData<S>, With<L::Mark>>();
    let Some(mut buffer) = world.resource::<LawBuffers<S>>().get(L::NAME) else { return };
    if let Some(displacement) = single_table(vertices.contiguous_iter(world))
        && let Some(data) = single_table(triangles.contiguous_iter(world))
    {
        let columns = MembraneColumns::new(displacement, data);
        let workers = world.resource::<Workers>();
        multiply_columns::<L, S>(&columns, kind, direction, workers, &mut buffer, result);
    }
}

struct EnergyBatch<'a, 'b, L, S> {
    columns: &'a MembraneColumns<'b, S>,
    sums: [f64; MAX_LANES],
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Batch<S> for EnergyBatch<'_, '_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.shapes.displacements::<L>(first);
        Law::energy(&self.columns.element::<L>(first), &u).accumulate(&mut self.sums);
    }
}

struct ForceBatch<'a, 'b, L, S> {
    columns: &'a MembraneColumns<'b, S>,
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Batch<S> for ForceBatch<'_, '_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.shapes.displacements::<L>(first);
        let forces = Law::forces(&self.columns.element::<L>(first), &u);
        let nodes = &self.columns.shapes.nodes[first..];
        for a in 0..3 {
            L::add_rows(forces[a], self.force, self.row, nodes, a);
        }
    }
}

struct TangentBatch<'a, 'b, L, S> {
    columns: &'a MembraneColumns<'b, S>,
    span: &'a mut Span<S>,
    kind: TangentKind,
    clamped: [f64; MAX_LANES],
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Batch<S> for TangentBatch<'_, '_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let Self { columns, span, kind, clamped, .. } = self;
        let u = columns.shapes.displacements::<L>(first);
        let e = columns.element::<L>(first);
        if *kind == TangentKind::Projected {
            L::select(Law::is_clamped(&e, &u), L::ONE, L::ZERO).accumulate(clamped);
        }
        add_tangent(
            &Law::tangent(&e, &u, *kind),
            span,
            columns.shapes.nodes,
            columns.blocks,
            first,
        );
    }
}

/// Adds the tangents of the triangles from `first` on; their vertex rows ascend.
#[inline(always)]
pub(crate) fn add_tangent<L: Lanes>(
    t: &TriangleTangent<L>,
    span: &mut Span<L::Scalar>,
    nodes: &[[u32; 3]],
    blocks: &[[u32; 3]],
    first: usize,
) {
    let (nodes, blocks) = (&nodes[first..], &blocks[first..]);
    for a in 0..3 {
        L::add_blocks(&t.diagonal[a], &mut span.diagonal, span.rows.start, nodes, a);
        L::add_blocks(&t.off[a], &mut span.off_diagonal, span.blocks.start, blocks, a);
    }
}

struct ProductBatch<'a, 'b, L, S> {
    columns: &'a MembraneColumns<'b, S>,
    direction: &'a [[S; 4]],
    kind: TangentKind,
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Batch<S> for ProductBatch<'_, '_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let u = self.columns.shapes.displacements::<L>(first);
        let nodes = &self.columns.shapes.nodes[first..];
        let mut v = [[L::ZERO; 3]; 3];
        for a in 0..3 {
            v[a] = L::load_rows(self.direction, nodes, a);
        }
        let product = Law::product(&self.columns.element::<L>(first), &u, &v, self.kind);
        for a in 0..3 {
            L::add_rows(product[a], self.force, self.row, nodes, a);
        }
    }
}
