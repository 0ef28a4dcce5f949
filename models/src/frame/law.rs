//! What a law implements: [`TetrahedronLaw`] on tetrahedra and at the points of solid elements, [`TriangleLaw`] on
//! membrane triangles and at the points of quadrilaterals.

use bevy_ecs::prelude::Component;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::{Calculation, Real};
use std::marker::PhantomData;

use super::rules::VolumeMeasure;
use crate::element::membrane::{self, TriangleTangent};
use crate::element::tetrahedron::{Element, Nodes, TetrahedronTangent};

/// A law whose energy is a sum over tetrahedra of a function of their four displacements.
///
/// The functions are written for [`Real`], that is for one tetrahedron or for a register full of
/// them.
pub trait TetrahedronLaw: Send + Sync + 'static {
    /// Name shown in reports; unique.
    const NAME: &'static str;
    /// Component of the tetrahedra it acts on, and of no others; mostly the law itself.
    type Mark: Component;
    /// Whether it contributes energy and force.
    const FORCES: bool = true;
    /// Whether the corotational energy takes its place for bodies that recover: so for one law of every
    /// body, the others fall silent.
    const STANDS_IN: bool = true;
    /// Whether it contributes to a tangent of this kind.
    fn contributes(_: TangentKind) -> bool {
        true
    }
    /// Energy (J).
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R;
    /// Forces (N), `None` when there are none in any lane.
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>>;
    /// Tangent (N/m). `Projected` is asked for only of laws that have no stress projection, and of
    /// elements in which that has nothing to clamp.
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R>;
    /// Product (N) of the tangent with the displacements `v` (m).
    #[inline(always)]
    fn product<R: Real>(e: &Element<R>, u: &Nodes<R>, v: &Nodes<R>, kind: TangentKind) -> Nodes<R> {
        Self::tangent(e, u, kind).product(v)
    }
    /// Whether it is compiled for AVX-512 too ([`Kernel::WIDE`](sinew_engine::lanes::Kernel::WIDE)).
    const WIDE: bool = true;
    /// Whether the volume is multiplied into the moduli beforehand and elements come with volume 1.
    const FOLDS_VOLUME: bool = true;
    /// What its volume term is a function of, if it reads [`Element::pressure`]: the volume part of such a law can be that of
    /// several elements or points.
    const VOLUME: Option<VolumeMeasure> = None;
    /// Whether its energy stays the same when an element turns.
    const IS_OBJECTIVE: bool = true;
    /// Whether its energy grows faster than the volume of an element that is blown up, that is faster than the third power of
    /// displacements: then it holds any follower pressure, and otherwise the sum of both has no bound.
    const HOLDS_PRESSURE: bool = true;
    /// Whether its resistance to compression has a maximum, as that of St Venant-Kirchhoff has at a stretch of `1/sqrt 3`.
    const SOFTENS: bool = false;
    /// Whether `Projected` clamps the eigenvalues of the St Venant-Kirchhoff stress; otherwise
    /// [`tangent`](Self::tangent) has a semidefinite form of its own.
    const STRESS_PROJECTION: bool = true;
    /// Without stress projection: where the projected tangent differs from the exact one.
    #[inline(always)]
    fn is_clamped<R: Real>(_: &Element<R>, _: &Nodes<R>) -> R::Mask {
        R::less(R::ONE, R::ZERO)
    }
}

/// The tangent (N/m) of a law by the vertices 1, 2 and 3 of what stands for a point, of every kind of elements: long, so compiled
/// once for all of them ([`Real::apart`]).
pub(crate) struct TangentAtPoint<'a, Law, R> {
    element: &'a Element<R>,
    u: &'a Nodes<R>,
    kind: TangentKind,
    law: PhantomData<fn() -> Law>,
}

impl<'a, Law, R> TangentAtPoint<'a, Law, R> {
    #[inline(always)]
    pub(crate) fn new(element: &'a Element<R>, u: &'a Nodes<R>, kind: TangentKind) -> Self {
        Self { element, u, kind, law: PhantomData }
    }
}

impl<Law: TetrahedronLaw, R: Real> Calculation<R> for TangentAtPoint<'_, Law, R> {
    type Output = [[[R; 9]; 3]; 3];
    #[inline(always)]
    fn run(self) -> [[[R; 9]; 3]; 3] {
        inner_blocks(&Law::tangent(self.element, self.u, self.kind))
    }
}

/// Blocks of the vertices 1, 2 and 3 of a tetrahedron.
#[inline(always)]
pub(crate) fn inner_blocks<R: Real>(t: &TetrahedronTangent<R>) -> [[[R; 9]; 3]; 3] {
    let mut inner = [[[R::ZERO; 9]; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            inner[i][j] = t.block(i + 1, j + 1);
        }
    }
    inner
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
    /// As that of [`TetrahedronLaw`].
    const HOLDS_PRESSURE: bool = true;
    /// Whether it contributes to a tangent of this kind.
    fn contributes(_: TangentKind) -> bool {
        true
    }
    /// Energy (J).
    fn energy<R: Real>(e: &membrane::Element<R>, u: &membrane::Nodes<R>) -> R;
    /// Forces (N).
    fn forces<R: Real>(e: &membrane::Element<R>, u: &membrane::Nodes<R>) -> membrane::Nodes<R>;
    /// Tangent (N/m).
    fn tangent<R: Real>(
        e: &membrane::Element<R>,
        u: &membrane::Nodes<R>,
        kind: TangentKind,
    ) -> TriangleTangent<R>;
    /// Product (N) of the tangent with the displacements `v` (m).
    #[inline(always)]
    fn product<R: Real>(
        e: &membrane::Element<R>,
        u: &membrane::Nodes<R>,
        v: &membrane::Nodes<R>,
        kind: TangentKind,
    ) -> membrane::Nodes<R> {
        Self::tangent(e, u, kind).product(v)
    }
    /// Where the projected tangent differs from the exact one.
    #[inline(always)]
    fn is_clamped<R: Real>(_: &membrane::Element<R>, _: &membrane::Nodes<R>) -> R::Mask {
        R::less(R::ONE, R::ZERO)
    }
}
