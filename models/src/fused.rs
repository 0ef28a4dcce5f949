//! Laws evaluated tetrahedron by tetrahedron: the fused St Venant-Kirchhoff body with its
//! compression term (Delingette 2008, sections 3 and 4), and two laws that complete the pooled
//! springs of [`crate::pooled`]: the compression term alone, and the projected tangent, which needs
//! the whole stress of an element and so cannot be split into springs.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ArchetypeFilter;
use bytemuck::TransparentWrapper;
use sinew_engine::columns::single_table;
use sinew_engine::element::{
    RestVolume, ShapeGradients, TETRAHEDRON_EDGES, TetrahedronBlocks, TetrahedronEdges,
    TetrahedronVertices,
};
use sinew_engine::law::{EvaluationRequest, Law, LawBuffer, Span, TangentKind};
use sinew_engine::scalar::{Scalar, xyz};
use sinew_engine::schedule::{ForceSystems, activate_law, column_changed, declare_inputs};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::time::Instant;

use crate::tetrahedron::{self, Element, TetrahedronTangent};

/// Elastic moduli of a tetrahedron (Pa).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Moduli<S: Scalar> {
    /// First Lamé parameter (Pa).
    pub lambda: S,
    /// Shear modulus (Pa).
    pub mu: S,
    /// Modulus of the compression term (Pa): lambda + mu, or 0 for a body without it.
    pub compression: S,
}

/// A law whose energy is a sum over tetrahedra of a function of their four displacements.
pub trait TetrahedronLaw: Law {
    /// Tetrahedra it acts on.
    type Bodies: ArchetypeFilter + 'static;
    /// Estimated work per tetrahedron and pass (ns).
    const WORK_NS: usize = 30;
    /// Whether it contributes energy and force.
    const FORCES: bool = true;
    /// Whether it contributes to a tangent of this kind.
    fn contributes(kind: TangentKind) -> bool;
    /// Whether the element takes part.
    fn applies<S: Scalar>(_: &Element<S>) -> bool {
        true
    }
    /// Energy (J).
    fn energy<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> S;
    /// Forces (N).
    fn forces<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> [[S; 3]; 4];
    /// Tangent (N/m).
    fn tangent<S: Scalar>(
        e: &Element<S>,
        u: &[[S; 3]; 4],
        kind: TangentKind,
    ) -> TetrahedronTangent<S>;
}

/// Fused evaluation: St Venant-Kirchhoff plus compression term, all in one pass.
pub struct FusedStVK;

impl Law for FusedStVK {
    const NAME: &'static str = "fused St Venant-Kirchhoff";
    const ORDER: u8 = 0;
}

impl TetrahedronLaw for FusedStVK {
    type Bodies = Without<TetrahedronEdges>;
    fn contributes(_: TangentKind) -> bool {
        true
    }
    #[inline(always)]
    fn energy<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> S {
        tetrahedron::energy(e, u)
    }
    #[inline(always)]
    fn forces<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> [[S; 3]; 4] {
        tetrahedron::forces(e, u)
    }
    #[inline(always)]
    fn tangent<S: Scalar>(
        e: &Element<S>,
        u: &[[S; 3]; 4],
        kind: TangentKind,
    ) -> TetrahedronTangent<S> {
        tetrahedron::tangent(e, u, kind)
    }
}

/// The compression term of pooled bodies, an independent law beside their springs.
pub struct Compression;

impl Law for Compression {
    const NAME: &'static str = "compression term";
    const ORDER: u8 = 5;
}

impl TetrahedronLaw for Compression {
    type Bodies = With<TetrahedronEdges>;
    fn contributes(kind: TangentKind) -> bool {
        kind != TangentKind::Projected
    }
    #[inline(always)]
    fn applies<S: Scalar>(e: &Element<S>) -> bool {
        e.compression > S::ZERO
    }
    #[inline(always)]
    fn energy<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> S {
        tetrahedron::compression::energy(e, u)
    }
    #[inline(always)]
    fn forces<S: Scalar>(e: &Element<S>, u: &[[S; 3]; 4]) -> [[S; 3]; 4] {
        tetrahedron::compression::forces(e, u)
    }
    #[inline(always)]
    fn tangent<S: Scalar>(
        e: &Element<S>,
        u: &[[S; 3]; 4],
        kind: TangentKind,
    ) -> TetrahedronTangent<S> {
        tetrahedron::compression::tangent(e, u, kind)
    }
}

/// The projected tangent of pooled bodies: the eigenvalues that are clamped belong to the whole
/// stress of a tetrahedron, so it is formed per tetrahedron, springs and compression together.
pub struct PooledProjection;

impl Law for PooledProjection {
    const NAME: &'static str = "projected tangent of springs";
    const ORDER: u8 = 6;
}

impl TetrahedronLaw for PooledProjection {
    type Bodies = With<TetrahedronEdges>;
    const FORCES: bool = false;
    fn contributes(kind: TangentKind) -> bool {
        kind == TangentKind::Projected
    }
    fn energy<S: Scalar>(_: &Element<S>, _: &[[S; 3]; 4]) -> S {
        S::ZERO
    }
    fn forces<S: Scalar>(_: &Element<S>, _: &[[S; 3]; 4]) -> [[S; 3]; 4] {
        [[S::ZERO; 3]; 4]
    }
    #[inline(always)]
    fn tangent<S: Scalar>(
        e: &Element<S>,
        u: &[[S; 3]; 4],
        kind: TangentKind,
    ) -> TetrahedronTangent<S> {
        tetrahedron::tangent(e, u, kind)
    }
}

/// Puts `L` into the force schedule.
pub fn activate<L: TetrahedronLaw, S: Scalar>(world: &mut World) {
    activate_law::<L, S>(world, |schedule| {
        schedule.add_systems(evaluate::<L, S>.in_set(ForceSystems::Evaluate));
    });
    declare_inputs(
        world,
        L::NAME,
        &[
            column_changed::<TetrahedronVertices>,
            column_changed::<ShapeGradients<S>>,
            column_changed::<RestVolume<S>>,
            column_changed::<Moduli<S>>,
        ],
    );
}

/// Columns of the tetrahedra, as slices.
#[derive(Clone, Copy)]
struct Columns<'a, S: Scalar> {
    displacement: &'a [[S; 4]],
    nodes: &'a [TetrahedronVertices],
    blocks: &'a [TetrahedronBlocks],
    gradients: &'a [ShapeGradients<S>],
    volume: &'a [RestVolume<S>],
    moduli: &'a [Moduli<S>],
}

impl<S: Scalar> Columns<'_, S> {
    #[inline(always)]
    fn element(&self, i: usize) -> Element<S> {
        let m = self.moduli[i];
        Element {
            gradients: self.gradients[i].0,
            volume: self.volume[i].0,
            lambda: m.lambda,
            mu: m.mu,
            compression: m.compression,
        }
    }

    #[inline(always)]
    fn local(&self, i: usize) -> [[S; 3]; 4] {
        let n = self.nodes[i].0;
        [
            xyz(self.displacement[n[0] as usize]),
            xyz(self.displacement[n[1] as usize]),
            xyz(self.displacement[n[2] as usize]),
            xyz(self.displacement[n[3] as usize]),
        ]
    }
}

fn evaluate<L: TetrahedronLaw, S: Scalar>(
    request: Res<EvaluationRequest>,
    workers: Res<Workers>,
    mut buffer: ResMut<LawBuffer<L, S>>,
    vertices: Query<&Displacement<S>>,
    tetrahedra: Query<
        (&TetrahedronVertices, &TetrahedronBlocks, &ShapeGradients<S>, &RestVolume<S>, &Moduli<S>),
        L::Bodies,
    >,
) {
    let start = Instant::now();
    let Some(displacement) = single_table(vertices.contiguous_iter()) else { return };
    let Some((nodes, blocks, gradients, volume, moduli)) =
        single_table(tetrahedra.contiguous_iter())
    else {
        return;
    };
    let displacement = Displacement::peel_slice(displacement);
    let columns = Columns { displacement, nodes, blocks, gradients, volume, moduli };
    let request = *request;
    let tangent = request.tangent.filter(|&kind| L::contributes(kind));
    if !(L::FORCES && (request.energy || request.force)) && tangent.is_none() {
        buffer.drop_tangent();
        return;
    }
    let work = nodes.len() * if tangent.is_some() { 8 * L::WORK_NS } else { L::WORK_NS };
    workers.for_each(&mut buffer.spans, work, |_, span| {
        if L::FORCES && request.energy {
            energy_pass::<L, S>(&columns, span);
        }
        if L::FORCES && request.force {
            force_pass::<L, S>(&columns, span);
        }
        match tangent {
            Some(kind) => tangent_pass::<L, S>(&columns, span, kind),
            None => span.drop_tangent(),
        }
    });
    buffer.time = start.elapsed();
}

fn energy_pass<L: TetrahedronLaw, S: Scalar>(columns: &Columns<S>, span: &mut Span<S>) {
    let mut sum = 0.0;
    for i in span.elements.clone() {
        let e = columns.element(i);
        if L::applies(&e) {
            sum += L::energy(&e, &columns.local(i)).to_f64();
        }
    }
    span.energy = sum;
}

fn force_pass<L: TetrahedronLaw, S: Scalar>(columns: &Columns<S>, span: &mut Span<S>) {
    span.clear_force();
    for i in span.elements.clone() {
        let e = columns.element(i);
        if L::applies(&e) {
            let f = L::forces(&e, &columns.local(i));
            for (a, &row) in columns.nodes[i].0.iter().enumerate() {
                span.add_force(row, f[a]);
            }
        }
    }
}

fn tangent_pass<L: TetrahedronLaw, S: Scalar>(
    columns: &Columns<S>,
    span: &mut Span<S>,
    kind: TangentKind,
) {
    span.clear_tangent();
    for i in span.elements.clone() {
        let e = columns.element(i);
        if !L::applies(&e) {
            continue;
        }
        let t = L::tangent(&e, &columns.local(i), kind);
        let nodes = columns.nodes[i].0;
        for (a, &row) in nodes.iter().enumerate() {
            span.add_diagonal(row, &t.diagonal[a]);
        }
        for (edge, [a, b]) in TETRAHEDRON_EDGES.into_iter().enumerate() {
            let block = columns.blocks[i].0[edge];
            span.add_off_diagonal(block, nodes[a], nodes[b], &t.off[edge]);
        }
        span.clamped += u64::from(t.clamped);
    }
}
