//! Membrane laws on quadrilaterals with bilinear shape functions, integrated over 2x2 Gauss points: as
//! [`crate::frame::hexahedra`] with triangles in place of tetrahedra. The quadrilateral may be warped; every point
//! has its own plane.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::isoparametric::{
    Derivatives, QuadBlocks, QuadRest, QuadVertices, load_points, load_weights, point_differences,
};
use sinew_engine::lanes::Lanes;
use sinew_engine::law::{LawBuffer, LawInfo, RecoveringBodies, TangentKind};
use sinew_engine::scalar::{Real, Scalar, Single};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;

use std::marker::PhantomData;

use super::columns::{self, work};
use super::gauss::{AtPoints, GaussColumns, GaussElements, GaussLaw};
use super::law::TriangleLaw;
use super::row::{Activate, Elements, InRecovery, LawRow, PlacedLaw, activate_elements, mark};
use super::triangles::{MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus};
use crate::element::membrane::Element;

/// Law `L` at the Gauss points of quadrilaterals; also the mark of its quadrilaterals.
pub type Quadrilateral<L> = AtPoints<L, 4>;

impl LawRow {
    /// Law `L` of triangles at the Gauss points of quadrilaterals, under another name.
    pub const fn quads<L: TriangleLaw>(name: &'static str) -> Self {
        let activate: [Activate; 2] = [activate::<L, f64>, activate::<L, Single>];
        let (info, elements) = (LawInfo::elastic(name), Elements::Quads);
        Self {
            tangent: L::contributes,
            recovery: InRecovery::Unchanged,
            holds_pressure: L::HOLDS_PRESSURE,
            ..Self::of_systems(info, elements, [mark::<Quadrilateral<L>>; 2], activate)
        }
    }
}

/// A triangle that stands for a Gauss point, and its displacements (m).
type Point<L> = (Element<L>, [[L; 3]; 3]);

/// The triangles that stand for the Gauss points from `first` on of a quadrilateral, and their displacements
/// (m).
#[inline(always)]
fn points<L: Lanes>(
    derivatives: &Derivatives<L::Scalar, 4, 2, 4>,
    rest: &QuadRest<L::Scalar>,
    moduli: [L::Scalar; 3],
    u: &[[L::Scalar; 3]; 4],
    first: usize,
) -> Point<L> {
    let u = point_differences::<L, 3, _, _, _>(derivatives, u, first);
    // a point stands for twice the area of its triangle
    let weight = load_weights::<L, 4>(&[L::Scalar::ONE + L::Scalar::ONE; 4], first);
    let [lambda, mu, compression] = moduli.map(L::splat);
    let [lambda, mu, compression] = [lambda * weight, mu * weight, compression * weight];
    let area = load_points::<L, 4>(&rest.half_area, first);
    (Element { edges: rest.edges::<L>(first), area, lambda, mu, compression }, u)
}

/// Columns of quadrilaterals that follow law `Law`, as slices.
struct Columns<'a, Law, S: Scalar> {
    elements: GaussElements<'a, S, 4, 2, 6, 4>,
    rest: &'a [QuadRest<S>],
    /// lambda, mu and that of the compression term (N/m).
    moduli: [&'a [S]; 3],
    law: PhantomData<fn() -> Law>,
}

impl<Law: TriangleLaw, S: Scalar> GaussLaw<S, 4, 2, 6, 4> for Columns<'_, Law, S> {
    const WIDE: bool = Law::WIDE;
    type Points<L: Lanes<Scalar = S>> = Point<L>;
    #[inline(always)]
    fn elements(&self) -> &GaussElements<'_, S, 4, 2, 6, 4> {
        &self.elements
    }
    #[inline(always)]
    fn points<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; 4],
        (derivatives, first): (&Derivatives<S, 4, 2, 4>, usize),
    ) -> Point<L> {
        let [lambda, mu, compression] = self.moduli;
        let moduli = [lambda[i], mu[i], compression[i]];
        points(derivatives, &self.rest[i], moduli, u, first)
    }
    #[inline(always)]
    fn energy<L: Lanes<Scalar = S>>(&self, (e, u): &Point<L>) -> L {
        Law::energy(e, u)
    }
    #[inline(always)]
    fn forces<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> Option<[[L; 3]; 2]> {
        let [_, a, b] = Law::forces(e, u);
        Some([a, b])
    }
    #[inline(always)]
    fn tangent<L: Lanes<Scalar = S>>((e, u): &Point<L>, kind: TangentKind) -> [[[L; 9]; 2]; 2] {
        let t = Law::tangent(e, u, kind);
        [[t.block(1, 1), t.block(1, 2)], [t.block(2, 1), t.block(2, 2)]]
    }
    #[inline(always)]
    fn is_clamped<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> L::Mask {
        L::both(L::less(L::ZERO, e.mu), Law::is_clamped(e, u))
    }
}

/// Query data of quadrilaterals.
type Data<S> = (
    &'static QuadVertices,
    &'static QuadBlocks,
    &'static QuadRest<S>,
    &'static MembraneFirstModulus<S>,
    &'static MembraneShearModulus<S>,
    &'static MembraneCompressionModulus<S>,
);

/// Slices of [`Data`].
type Slices<'a, S> = <Data<S> as ContiguousQueryData>::Contiguous<'a, 'a>;

/// Puts `L` on quadrilaterals into the force schedule.
pub(crate) fn activate<L: TriangleLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    let evaluate = evaluate::<L, S>;
    activate_elements::<QuadVertices, S, Data<S>>(world, law, evaluate);
}

fn evaluate<L: TriangleLaw, S: Scalar>(
    with: Evaluation,
    displacement: &[Displacement<S>],
    (nodes, blocks, rest, lambda, mu, compression): Slices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns {
        elements: GaussElements {
            displacement: Displacement::peel_slice(displacement),
            nodes: QuadVertices::peel_slice(nodes),
            blocks: QuadBlocks::peel_slice(blocks),
            derivatives: Derivatives::quad(),
            own: &[],
        },
        rest,
        moduli: [
            MembraneFirstModulus::peel_slice(lambda),
            MembraneShearModulus::peel_slice(mu),
            MembraneCompressionModulus::peel_slice(compression),
        ],
        law: PhantomData::<fn() -> L>,
    };
    let work = rest.len() * work(with.request, [100, 120, 500]);
    // membranes go on while solids recover
    let with = Evaluation { recovering: &RecoveringBodies::default(), ..with };
    columns::evaluate(&GaussColumns(&columns), with, work, buffer);
}

/// The triangles that stand for the Gauss points of a quadrilateral, with their displacements (m); moduli
/// (N/m) lambda, mu and that of the compression term. Their areas are half of what the points stand for, and
/// their moduli twice those given.
pub(crate) fn triangles(
    rest: &QuadRest<f64>,
    moduli: [f64; 3],
    u: &[[f64; 3]; 4],
) -> [(Element<f64>, [[f64; 3]; 3]); 4] {
    let derivatives = &Derivatives::quad();
    std::array::from_fn(|q| points::<f64>(derivatives, rest, moduli, u, q))
}
