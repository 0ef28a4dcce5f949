//! Laws evaluated membrane triangle by membrane triangle: their columns, and the passes for energy, force and tangent.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{MembraneBlocks, MembraneRest, MembraneShapes, MembraneVertices};
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{
    EvaluationRequest, LawBuffer, LawBuffers, LawInfo, RecoveringBodies, Span, TangentKind,
};
use sinew_engine::scalar::{Scalar, Single};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{
    self, LawColumns, LawProducts, TangentSum, add_vertices, scalar_columns, work,
};
use super::law::TriangleLaw;
use super::row::{Activate, Elements, InRecovery, LawRow, PlacedLaw, activate_elements, mark};
use crate::element::membrane::{Element, TriangleTangent};

scalar_columns! {
    /// First modulus of plane stress times thickness of a membrane triangle (N/m).
    MembraneFirstModulus,
    /// Shear modulus times thickness of a membrane triangle (N/m).
    MembraneShearModulus,
    /// Modulus of the compression term of a membrane triangle (N/m), or 0 without it.
    MembraneCompressionModulus,
}

impl LawRow {
    /// Law `L` of membrane triangles.
    pub const fn triangles<L: TriangleLaw>() -> Self {
        let activate: [Activate; 2] = [activate::<L, f64>, activate::<L, Single>];
        let (info, elements) = (LawInfo::elastic(L::NAME), Elements::Triangles);
        Self {
            forces: L::FORCES,
            tangent: L::contributes,
            recovery: InRecovery::Unchanged,
            holds_pressure: L::HOLDS_PRESSURE,
            ..Self::of_systems(info, elements, [mark::<L::Mark>; 2], activate)
        }
    }
}

/// Puts `L` into the force schedule.
pub(crate) fn activate<L: TriangleLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    let evaluate = evaluate::<L, S>;
    activate_elements::<MembraneVertices, S, MembraneData<S>>(world, law, evaluate);
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
    with: Evaluation,
    u: &[Displacement<S>],
    triangles: MembraneSlices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns::<L, S>::new(u, triangles);
    let request = with.request;
    let request = EvaluationRequest {
        energy: L::FORCES && request.energy,
        force: L::FORCES && request.force,
        tangent: request.tangent.filter(|&kind| L::contributes(kind)),
    };
    let work = columns.blocks.len() * work(&request, [4, 5, 30]);
    // they go on while solids recover
    let with = Evaluation { request: &request, recovering: &RecoveringBodies::default(), ..with };
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
