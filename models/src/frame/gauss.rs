//! Elements whose energy is a sum over Gauss points, one point per lane: a point deforms as a tetrahedron
//! (triangle) whose first vertex stays in place ([`sinew_engine::isoparametric`]). With `f_j` (`K_ij`) the forces
//! (tangent blocks) on its vertices that move,
//!
//! ```text
//! f_a = sum_q sum_j dN_a/dxi_j f_j        K_ab = sum_q sum_ij dN_a/dxi_i K_ij dN_b/dxi_j
//! ```

use bevy_ecs::prelude::*;
use sinew_engine::isoparametric::{
    Derivatives, TETRAHEDRON10_PAIRS, derivatives_of, load_points, load_weights, rows_of,
};
use sinew_engine::lanes::{Lanes, MAX_LANES};
use sinew_engine::law::{Span, TangentKind};
use sinew_engine::scalar::{Calculation, Real, Scalar};

use std::marker::PhantomData;

use super::columns::{LawColumns, TangentSum};
use crate::element::matrix::symmetrise;

/// Law `L` at the Gauss points of elements of `V` vertices; also the mark of such elements.
#[derive(Component, Debug)]
pub struct AtPoints<L: Send + Sync + 'static, const V: usize>(PhantomData<fn() -> L>);

impl<L: Send + Sync + 'static, const V: usize> Clone for AtPoints<L, V> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Send + Sync + 'static, const V: usize> Copy for AtPoints<L, V> {}

impl<L: Send + Sync + 'static, const V: usize> Default for AtPoints<L, V> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

/// Elements of `V` vertices, `Q` Gauss points and `P` pairs of vertices, in `D` local coordinates.
pub(crate) struct GaussElements<
    'a,
    S: Scalar,
    const V: usize,
    const D: usize,
    const P: usize,
    const Q: usize,
> {
    /// Displacement of every vertex row (m).
    pub displacement: &'a [[S; 4]],
    /// Vertex rows.
    pub nodes: &'a [[u32; V]],
    /// Tangent blocks of the pairs.
    pub blocks: &'a [[u32; P]],
    /// Derivatives of the shape functions.
    pub derivatives: Derivatives<S, V, D, Q>,
    /// Those of elements that have points of their own.
    pub own: &'a [Derivatives<f64, V, D, Q>],
}

impl<S: Scalar, const V: usize, const D: usize, const P: usize, const Q: usize>
    GaussElements<'_, S, V, D, P, Q>
{
    /// Displacements (m) of the vertices of an element.
    #[inline(always)]
    pub fn displacements(&self, element: usize) -> [[S; 3]; V] {
        rows_of(self.displacement, &self.nodes[element])
    }

    /// Derivatives in an element, as [`PointsRest::own`](sinew_engine::isoparametric::PointsRest::own) says.
    #[inline(always)]
    pub fn derivatives<'s>(
        &'s self,
        own: u32,
        slot: &'s mut Option<Derivatives<S, V, D, Q>>,
    ) -> &'s Derivatives<S, V, D, Q> {
        derivatives_of(&self.derivatives, self.own, own, slot)
    }
}

/// What a law makes of such elements. Mark implementations `#[inline(always)]`.
pub(crate) trait GaussLaw<S: Scalar, const V: usize, const D: usize, const P: usize, const Q: usize>:
    Sync
{
    /// As [`Kernel::WIDE`](sinew_engine::lanes::Kernel::WIDE).
    const WIDE: bool;
    /// What stands for some points, with their displacements.
    type Points<L: Lanes<Scalar = S>>;
    /// All elements.
    fn elements(&self) -> &GaussElements<'_, S, V, D, P, Q>;
    /// Which points an element has, as [`PointsRest::own`](sinew_engine::isoparametric::PointsRest::own) says.
    #[inline(always)]
    fn own(&self, _element: usize) -> u32 {
        0
    }
    /// The points from `first` on of an element whose vertices have the displacements `u` (m), with its derivatives.
    fn points<L: Lanes<Scalar = S>>(
        &self,
        element: usize,
        u: &[[S; 3]; V],
        at: (&Derivatives<S, V, D, Q>, usize),
    ) -> Self::Points<L>;
    /// The same for tangents.
    #[inline(always)]
    fn tangent_points<L: Lanes<Scalar = S>>(
        &self,
        element: usize,
        u: &[[S; 3]; V],
        at: (&Derivatives<S, V, D, Q>, usize),
    ) -> Self::Points<L> {
        self.points(element, u, at)
    }
    /// Energy (J).
    fn energy<L: Lanes<Scalar = S>>(&self, points: &Self::Points<L>) -> L;
    /// Forces (N) on the vertices that move, `None` when there are none in any lane.
    fn forces<L: Lanes<Scalar = S>>(points: &Self::Points<L>) -> Option<[[L; 3]; D]>;
    /// Tangent (N/m) of these vertices.
    fn tangent<L: Lanes<Scalar = S>>(
        points: &Self::Points<L>,
        kind: TangentKind,
    ) -> [[[L; 9]; D]; D];
    /// Where the projected tangent differs from the exact one; nowhere among the points that only fill the
    /// register.
    fn is_clamped<L: Lanes<Scalar = S>>(points: &Self::Points<L>) -> L::Mask;
}

/// The passes over a [`GaussLaw`].
pub(crate) struct GaussColumns<
    'a,
    C,
    const V: usize,
    const D: usize,
    const P: usize,
    const Q: usize,
>(pub &'a C);

impl<S: Scalar, C, const V: usize, const D: usize, const P: usize, const Q: usize> LawColumns<S>
    for GaussColumns<'_, C, V, D, P, Q>
where
    C: GaussLaw<S, V, D, P, Q>,
{
    const WIDE: bool = C::WIDE;
    const LANES_ARE_POINTS: bool = true;

    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, i: usize, sums: &mut [f64; MAX_LANES]) {
        let (elements, mut slot) = (self.0.elements(), None);
        let u = elements.displacements(i);
        let derivatives = elements.derivatives(self.0.own(i), &mut slot);
        for first in (0..Q).step_by(L::COUNT) {
            self.0.energy(&self.0.points::<L>(i, &u, (derivatives, first))).accumulate(sums);
        }
    }

    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, i: usize, force: &mut [[S; 4]], row: usize) {
        let (elements, mut slot) = (self.0.elements(), None);
        let u = elements.displacements(i);
        let derivatives = elements.derivatives(self.0.own(i), &mut slot);
        let mut sum = [[L::ZERO; 3]; V];
        for first in (0..Q).step_by(L::COUNT) {
            let points = self.0.points::<L>(i, &u, (derivatives, first));
            let Some(f) = C::forces(&points) else { continue };
            for a in 0..V {
                for j in 0..D {
                    let d: L = load_points(&derivatives.0[a][j], first);
                    for x in 0..3 {
                        sum[a][x] = d.mul_add(f[j][x], sum[a][x]);
                    }
                }
            }
        }
        for a in 0..V {
            let to = &mut force[elements.nodes[i][a] as usize - row];
            for x in 0..3 {
                to[x] += total(sum[a][x]);
            }
        }
    }

    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, i: usize, to: &mut TangentSum<S>) {
        let (elements, mut slot) = (self.0.elements(), None);
        let u = elements.displacements(i);
        let derivatives = elements.derivatives(self.0.own(i), &mut slot);
        let mut inner = PointTangents::ZERO;
        let mut any = false;
        for first in (0..Q).step_by(L::COUNT) {
            let points = self.0.tangent_points::<L>(i, &u, (derivatives, first));
            if to.kind == TangentKind::Projected {
                any |= L::any(C::is_clamped(&points));
            }
            inner.store(&C::tangent(&points, to.kind), first);
        }
        to.clamped[0] += f64::from(u8::from(any));
        L::apart(Assemble {
            inner: &inner,
            derivatives,
            span: &mut *to.span,
            nodes: &elements.nodes[i],
            blocks: &elements.blocks[i],
        });
    }
}

/// Tangents (N/m) of the vertices that move at all points of an element: `[i][j][entry][point]`.
pub(crate) struct PointTangents<T, const D: usize, const Q: usize>([[[[T; Q]; 9]; D]; D]);

impl<T: Scalar, const D: usize, const Q: usize> PointTangents<T, D, Q> {
    pub(crate) const ZERO: Self = Self([[[[T::ZERO; Q]; 9]; D]; D]);

    /// Takes those of the points from `first` on.
    #[inline(always)]
    pub(crate) fn store<L: Lanes<Scalar = T>>(&mut self, of: &[[[L; 9]; D]; D], first: usize) {
        let count = L::COUNT.min(Q - first);
        let mut lanes = [T::ZERO; MAX_LANES];
        for i in 0..D {
            for j in 0..D {
                for k in 0..9 {
                    of[i][j][k].store(&mut lanes);
                    self.0[i][j][k][first..first + count].copy_from_slice(&lanes[..count]);
                }
            }
        }
    }
}

/// Adds the tangent of an element to a range. The larger part of the work and of the code, and the same for every law: it
/// is compiled once for each kind of elements ([`Real::apart`]).
pub(crate) struct Assemble<
    'a,
    T: Scalar,
    S: Scalar,
    const V: usize,
    const D: usize,
    const P: usize,
    const Q: usize,
> {
    pub inner: &'a PointTangents<T, D, Q>,
    pub derivatives: &'a Derivatives<T, V, D, Q>,
    pub span: &'a mut Span<S>,
    pub nodes: &'a [u32; V],
    pub blocks: &'a [u32; P],
}

impl<L: Lanes, S: Scalar, const V: usize, const D: usize, const P: usize, const Q: usize>
    Calculation<L> for Assemble<'_, L::Scalar, S, V, D, P, Q>
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let mut sum = Blocks::<L, V, P>::ZERO;
        for first in (0..Q).step_by(L::COUNT) {
            let mut inner = [[[L::ZERO; 9]; D]; D];
            for i in 0..D {
                for j in 0..D {
                    for k in 0..9 {
                        inner[i][j][k] = load_weights(&self.inner.0[i][j][k], first);
                    }
                }
            }
            sum.add(&inner, self.derivatives, first);
        }
        sum.write(self.span, self.nodes, self.blocks);
    }
}

/// Sum of the lanes, in their order.
#[inline(always)]
pub(super) fn total<L: Lanes>(lanes: L) -> L::Scalar {
    let mut values = [L::Scalar::ZERO; MAX_LANES];
    lanes.store(&mut values);
    let mut sum = values[0];
    for value in &values[1..L::COUNT] {
        sum += *value;
    }
    sum
}

#[inline(always)]
fn summed<L: Lanes, S: Scalar>(block: &[L; 9]) -> [S; 9] {
    let mut result = [S::ZERO; 9];
    for k in 0..9 {
        result[k] = S::from_f64(total(block[k]).to_f64());
    }
    result
}

/// Upper half of the `V` x `V` blocks of an element, one Gauss point per lane until they are summed.
struct Blocks<L, const V: usize, const P: usize> {
    diagonal: [[L; 9]; V],
    off: [[L; 9]; P],
}

impl<L: Lanes, const V: usize, const P: usize> Blocks<L, V, P> {
    const ZERO: Self = Self { diagonal: [[L::ZERO; 9]; V], off: [[L::ZERO; 9]; P] };

    /// Adds what the tangents of some points give.
    #[inline(always)]
    fn add<const D: usize, const Q: usize>(
        &mut self,
        inner: &[[[L; 9]; D]; D],
        derivatives: &Derivatives<L::Scalar, V, D, Q>,
        first: usize,
    ) {
        let mut d = [[L::ZERO; D]; V];
        for a in 0..V {
            for j in 0..D {
                d[a][j] = load_points(&derivatives.0[a][j], first);
            }
        }
        for b in 0..V {
            // what moving vertex b does to the vertices of the point that move
            let mut column = [[L::ZERO; 9]; D];
            for i in 0..D {
                for j in 0..D {
                    for k in 0..9 {
                        column[i][k] = d[b][j].mul_add(inner[i][j][k], column[i][k]);
                    }
                }
            }
            for a in 0..=b {
                let own =
                    if a == b { &mut self.diagonal[a] } else { &mut self.off[place::<V>(a, b)] };
                for i in 0..D {
                    for k in 0..9 {
                        own[k] = d[a][i].mul_add(column[i][k], own[k]);
                    }
                }
            }
        }
    }

    /// Sums the points and adds the blocks to a range.
    #[inline(always)]
    fn write<S: Scalar>(&self, span: &mut Span<S>, nodes: &[u32; V], blocks: &[u32; P]) {
        for a in 0..V {
            let mut block = summed(&self.diagonal[a]);
            symmetrise(&mut block);
            span.add_diagonal(nodes[a], &block);
        }
        for a in 0..V {
            for b in a + 1..V {
                let pair = place::<V>(a, b);
                span.add_off_diagonal(blocks[pair], nodes[a], nodes[b], &summed(&self.off[pair]));
            }
        }
    }
}

/// Place of the pair of local vertices `a < b` in the list of all pairs of `V` vertices.
#[inline(always)]
const fn place<const V: usize>(a: usize, b: usize) -> usize {
    a * (2 * V - 1 - a) / 2 + b - a - 1
}

/// The pairs are listed so.
const _: () = {
    let mut i = 0;
    while i < TETRAHEDRON10_PAIRS.len() {
        let [a, b] = TETRAHEDRON10_PAIRS[i];
        assert!(place::<10>(a, b) == i);
        i += 1;
    }
};
