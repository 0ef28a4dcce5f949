//! Laws evaluated membrane triangle by membrane triangle: the trait that they implement, their columns, and the
//! passes for energy, force and tangent.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{MembraneBlocks, MembraneRest, MembraneShapes, MembraneVertices};
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{
    EvaluationRequest, LawBuffer, LawBuffers, RecoveringBodies, Span, TangentKind,
};
use sinew_engine::scalar::{Real, Scalar};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{
    self, LawColumns, LawProducts, TangentSum, add_vertices, scalar_columns, work,
};
use crate::element::membrane::{Element, TriangleTangent};
use crate::laws::{LawRow, activate_elements};

scalar_columns! {
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
    let evaluate = evaluate::<L, S>;
    activate_elements::<MembraneVertices, S, MembraneData<S>>(world, row, place, evaluate);
}

/// Columns of the membrane triangles of law `Law`, as slices.
struct Columns<'a, Law, S> {
    shapes: MembraneShapes<'a, S>,
    /// Tangent blocks of the edges.
    blocks: &'a [[u32; 3]],
    /// lambda, mu and that of the compression term (N/m).
    moduli: [&'a [S]; 3],
    law: PhantomData<fn() -> Law>,
}

/// Query data of membrane triangles.
pub type MembraneData<S> = (
    &'static MembraneVertices,
    &'static MembraneBlocks,
    MembraneRest<S>,
    &'static MembraneFirstModulus<S>,
    &'static MembraneShearModulus<S>,
    &'static MembraneCompressionModulus<S>,
);

/// Slices of [`MembraneData`].
type MembraneSlices<'a, S> = <MembraneData<S> as ContiguousQueryData>::Contiguous<'a, 'a>;

impl<'a, Law, S: Scalar> Columns<'a, Law, S> {
    fn new(
        displacement: &'a [Displacement<S>],
        (nodes, blocks, rest, lambda, mu, compression): MembraneSlices<'a, S>,
    ) -> Self {
        Self {
            shapes: MembraneShapes::new(displacement, nodes, rest),
            blocks: MembraneBlocks::peel_slice(blocks),
            moduli: [
                MembraneFirstModulus::peel_slice(lambda),
                MembraneShearModulus::peel_slice(mu),
                MembraneCompressionModulus::peel_slice(compression),
            ],
            law: PhantomData,
        }
    }

    /// Constants and displacements (m) of the triangles from `first` on.
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> (Element<L>, [[L; 3]; 3]) {
        let [lambda, mu, compression] = self.moduli;
        let element = Element {
            edges: self.shapes.edges(first),
            area: L::load(&self.shapes.area[first..]),
            lambda: L::load(&lambda[first..]),
            mu: L::load(&mu[first..]),
            compression: L::load(&compression[first..]),
        };
        (element, self.shapes.displacements(first))
    }
}

fn evaluate<L: TriangleLaw, S: Scalar>(
    Evaluation { request, workers, .. }: Evaluation,
    u: &[Displacement<S>],
    triangles: MembraneSlices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns::<L, S>::new(u, triangles);
    let request = EvaluationRequest {
        energy: L::FORCES && request.energy,
        force: L::FORCES && request.force,
        tangent: request.tangent.filter(|&kind| L::contributes(kind)),
    };
    let work = columns.blocks.len() * work(&request, [4, 5, 30]);
    // they go on while solids recover
    let with = Evaluation { request: &request, workers, recovering: &RecoveringBodies::default() };
    columns::evaluate(&columns, with, work, buffer);
}

/// Adds the product `K v` of a law's tangent to `result` (N when `direction` is in m), without assembly, at
/// the displacements that the world holds; nothing is added when the law is not active. Uses the private
/// force arrays of the law, which do not hold forces afterwards.
pub fn multiply<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    kind: TangentKind,
    direction: &[[S; 4]],
    result: &mut [[S; 4]],
) {
    let mut vertices = world.query::<&Displacement<S>>();
    let mut triangles = world.query_filtered::<MembraneData<S>, With<L::Mark>>();
    let Some(mut buffer) = world.resource::<LawBuffers<S>>().get(L::NAME) else { return };
    if let Some(u) = single_table(vertices.contiguous_iter(world))
        && let Some(data) = single_table(triangles.contiguous_iter(world))
        && L::contributes(kind)
    {
        let columns = &Columns::<L, S>::new(u, data);
        let workers = world.resource::<Workers>();
        columns::multiply(columns, kind, direction, workers, 8, &mut buffer, result);
    }
}

impl<Law: TriangleLaw, S: Scalar> LawColumns<S> for Columns<'_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let (e, u) = self.element::<L>(first);
        Law::energy(&e, &u).accumulate(sums);
    }
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, force: &mut [[S; 4]], row: usize) {
        let (e, u) = self.element::<L>(first);
        let nodes = &self.shapes.nodes[first..];
        add_vertices(Law::forces(&e, &u), force, row, nodes);
    }
    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let (e, u) = self.element::<L>(first);
        if to.kind == TangentKind::Projected {
            to.count_clamped::<L>(Law::is_clamped(&e, &u));
        }
        let t = Law::tangent(&e, &u, to.kind);
        add_tangent(&t, to.span, self.shapes.nodes, self.blocks, first);
    }
}

impl<Law: TriangleLaw, S: Scalar> LawProducts<S, 3> for Columns<'_, Law, S> {
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn nodes(&self) -> &[[u32; 3]] {
        self.shapes.nodes
    }
    #[inline(always)]
    fn products<L: Lanes<Scalar = S>>(
        &self,
        first: usize,
        kind: TangentKind,
        v: &[[L; 3]; 3],
    ) -> [[L; 3]; 3] {
        let (e, u) = self.element::<L>(first);
        Law::product(&e, &u, v, kind)
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
