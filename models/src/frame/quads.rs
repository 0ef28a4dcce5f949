//! Membrane laws on quadrilaterals with bilinear shape functions, integrated over 2x2 Gauss points: as
//! [`crate::frame::hexahedra`] with triangles in place of tetrahedra. The quadrilateral may be warped; every point
//! has its own plane.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::isoparametric::{
    Derivatives, QUAD_PAIRS, QuadBlocks, QuadRest, QuadVertices, load_points, load_weights,
    quad_differences, rows_of,
};
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{LawBuffer, Span, TangentKind};
use sinew_engine::scalar::{Real, Scalar};
use sinew_engine::schedule::{ElementLaw, Evaluation, activate_law};
use sinew_engine::vertex::Displacement;

use std::marker::PhantomData;

use crate::element::membrane::{Element, TriangleTangent};
use crate::frame::hexahedra::total;
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus, TriangleLaw,
};
use crate::laws::{LawRow, partition};

/// Law `L` at the Gauss points of quadrilaterals; also the mark of its quadrilaterals.
#[derive(Component, Debug)]
pub struct Quadrilateral<L: Send + Sync + 'static>(PhantomData<fn() -> L>);

impl<L: Send + Sync + 'static> Clone for Quadrilateral<L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Send + Sync + 'static> Copy for Quadrilateral<L> {}

impl<L: Send + Sync + 'static> Default for Quadrilateral<L> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

/// A quadrilateral as the kernels see it, one Gauss point per lane.
struct Points<'a, S: Scalar> {
    derivatives: &'a Derivatives<S, 4, 2>,
    rest: &'a QuadRest<S>,
    moduli: [S; 3],
    u: [[S; 3]; 4],
}

impl<S: Scalar> Points<'_, S> {
    /// The triangles that stand for the points from `first` on, and their displacements (m).
    #[inline(always)]
    fn triangles<L: Lanes<Scalar = S>>(&self, first: usize) -> (Element<L>, [[L; 3]; 3]) {
        let u = quad_differences::<L>(self.derivatives, &self.u, first);
        // a point stands for twice the area of its triangle
        let weight = load_weights::<L, 4>(&[S::ONE + S::ONE; 4], first);
        let [lambda, mu, compression] = self.moduli.map(|m| L::splat(m) * weight);
        let area = load_points::<L, 4>(&self.rest.half_area, first);
        let edges = self.rest.edges::<L>(first);
        (Element { edges, area, lambda, mu, compression }, u)
    }
}

/// Columns of quadrilaterals, as slices.
struct Columns<'a, S: Scalar> {
    displacement: &'a [[S; 4]],
    nodes: &'a [[u32; 4]],
    blocks: &'a [[u32; 6]],
    rest: &'a [QuadRest<S>],
    lambda: &'a [S],
    mu: &'a [S],
    compression: &'a [S],
    derivatives: Derivatives<S, 4, 2>,
}

impl<S: Scalar> Columns<'_, S> {
    #[inline(always)]
    fn points(&self, i: usize) -> Points<'_, S> {
        Points {
            derivatives: &self.derivatives,
            rest: &self.rest[i],
            moduli: [self.lambda[i], self.mu[i], self.compression[i]],
            u: rows_of(self.displacement, &self.nodes[i]),
        }
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

/// Slices of [`Data`], as a contiguous query gives them.
type Slices<'a, S> = (
    &'a [QuadVertices],
    &'a [QuadBlocks],
    &'a [QuadRest<S>],
    &'a [MembraneFirstModulus<S>],
    &'a [MembraneShearModulus<S>],
    &'a [MembraneCompressionModulus<S>],
);

/// Puts `L` on quadrilaterals into the force schedule.
pub(crate) fn activate<L: TriangleLaw, S: Scalar>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    let law = ElementLaw::<S, Data<S>> {
        info: row.info,
        place,
        mark: Some(world.register_component::<Quadrilateral<L>>()),
        partition: partition::<QuadVertices, S>,
        evaluate: evaluate::<L, S>,
    };
    activate_law(world, law);
}

fn evaluate<L: TriangleLaw, S: Scalar>(
    Evaluation { request, workers, .. }: Evaluation,
    displacement: &[Displacement<S>],
    (nodes, blocks, rest, lambda, mu, compression): Slices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns {
        displacement: Displacement::peel_slice(displacement),
        nodes: QuadVertices::peel_slice(nodes),
        blocks: QuadBlocks::peel_slice(blocks),
        rest,
        lambda: MembraneFirstModulus::peel_slice(lambda),
        mu: MembraneShearModulus::peel_slice(mu),
        compression: MembraneCompressionModulus::peel_slice(compression),
        derivatives: Derivatives::quad(),
    };
    let work = 100 * usize::from(request.energy)
        + 120 * usize::from(request.force)
        + 500 * usize::from(request.tangent.is_some());
    workers.for_each(&mut buffer.spans, columns.rest.len() * work, |_, span| {
        let (columns, law) = (&columns, PhantomData::<fn() -> L>);
        if request.energy {
            span.energy = workers.dispatch(EnergyPass { columns, span, law });
        }
        if request.force {
            span.clear_force();
            workers.dispatch(ForcePass { columns, span, law });
        }
        match request.tangent {
            Some(kind) => {
                span.clear_tangent();
                workers.dispatch(TangentPass { columns, span, kind, law });
            }
            None => span.drop_tangent(),
        }
    });
}

struct EnergyPass<'a, 'b, L, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a Span<S>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Kernel<S> for EnergyPass<'_, '_, Law, S> {
    type Output = f64;
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> f64 {
        let mut sums = [0.0; MAX_LANES];
        for i in self.span.elements.clone() {
            let points = self.columns.points(i);
            for first in (0..4).step_by(L::COUNT) {
                let (e, u) = points.triangles::<L>(first);
                Law::energy::<L>(&e, &u).accumulate(&mut sums);
            }
        }
        sums.iter().sum()
    }
}

struct ForcePass<'a, 'b, L, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a mut Span<S>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Kernel<S> for ForcePass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, .. } = self;
        for i in span.elements.clone() {
            let points = columns.points(i);
            let mut sum = [[L::ZERO; 3]; 4];
            for first in (0..4).step_by(L::COUNT) {
                let (e, u) = points.triangles::<L>(first);
                let f = Law::forces::<L>(&e, &u);
                for a in 0..4 {
                    for j in 0..2 {
                        let d: L = load_points(&columns.derivatives.0[a][j], first);
                        for x in 0..3 {
                            sum[a][x] = d.mul_add(f[j + 1][x], sum[a][x]);
                        }
                    }
                }
            }
            for a in 0..4 {
                let mut force = [S::ZERO; 3];
                for x in 0..3 {
                    force[x] = total(sum[a][x]);
                }
                span.add_force(columns.nodes[i][a], force);
            }
        }
    }
}

struct TangentPass<'a, 'b, L, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a mut Span<S>,
    kind: TangentKind,
    law: PhantomData<fn() -> L>,
}

impl<Law: TriangleLaw, S: Scalar> Kernel<S> for TangentPass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, kind, .. } = self;
        for i in span.elements.clone() {
            let points = columns.points(i);
            let mut sum = Blocks { diagonal: [[L::ZERO; 9]; 4], off: [[L::ZERO; 9]; 6] };
            let mut clamped = false;
            for first in (0..4).step_by(L::COUNT) {
                let (e, u) = points.triangles::<L>(first);
                if kind == TangentKind::Projected {
                    let acts = L::less(L::ZERO, e.mu);
                    clamped |= L::any(L::both(acts, Law::is_clamped(&e, &u)));
                }
                sum.add(&Law::tangent::<L>(&e, &u, kind), &columns.derivatives, first);
            }
            span.clamped += u64::from(clamped);
            sum.write(span, &columns.nodes[i], &columns.blocks[i]);
        }
    }
}

/// Upper half of the 4x4 blocks of a quadrilateral, one Gauss point per lane until they are summed.
struct Blocks<L> {
    diagonal: [[L; 9]; 4],
    off: [[L; 9]; 6],
}

impl<L: Lanes> Blocks<L> {
    /// Adds what the tangents of some points give.
    #[inline(always)]
    fn add(
        &mut self,
        t: &TriangleTangent<L>,
        derivatives: &Derivatives<L::Scalar, 4, 2>,
        first: usize,
    ) {
        let [p, q, r] = [t.block(1, 1), t.block(1, 2), t.block(2, 2)];
        let s = t.block(2, 1);
        let inner = [[p, q], [s, r]];
        let mut d = [[L::ZERO; 2]; 4];
        for a in 0..4 {
            for j in 0..2 {
                d[a][j] = load_points(&derivatives.0[a][j], first);
            }
        }
        for b in 0..4 {
            // what moving vertex b does to the two vertices of the triangle that move
            let mut column = [[L::ZERO; 9]; 2];
            for i in 0..2 {
                for j in 0..2 {
                    for k in 0..9 {
                        column[i][k] = d[b][j].mul_add(inner[i][j][k], column[i][k]);
                    }
                }
            }
            for a in 0..=b {
                let own = if a == b { &mut self.diagonal[a] } else { &mut self.off[place(a, b)] };
                for i in 0..2 {
                    for k in 0..9 {
                        own[k] = d[a][i].mul_add(column[i][k], own[k]);
                    }
                }
            }
        }
    }

    /// Sums the points and adds the blocks to a range.
    #[inline(always)]
    fn write(&self, span: &mut Span<L::Scalar>, nodes: &[u32; 4], blocks: &[u32; 6]) {
        let half = L::Scalar::from_f64(0.5);
        for a in 0..4 {
            let mut block = summed(&self.diagonal[a]);
            for (x, y) in [(1, 3), (2, 6), (5, 7)] {
                let mean = half * (block[x] + block[y]);
                (block[x], block[y]) = (mean, mean);
            }
            span.add_diagonal(nodes[a], &block);
        }
        for (pair, [a, b]) in QUAD_PAIRS.into_iter().enumerate() {
            span.add_off_diagonal(blocks[pair], nodes[a], nodes[b], &summed(&self.off[pair]));
        }
    }
}

#[inline(always)]
fn summed<L: Lanes>(block: &[L; 9]) -> [L::Scalar; 9] {
    let mut result = [L::Scalar::ZERO; 9];
    for k in 0..9 {
        result[k] = total(block[k]);
    }
    result
}

/// Place of the pair of local vertices `a < b` in [`QUAD_PAIRS`].
#[inline(always)]
fn place(a: usize, b: usize) -> usize {
    a * (7 - a) / 2 + b - a - 1
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
    let points = Points { derivatives, rest, moduli, u: *u };
    std::array::from_fn(|q| points.triangles::<f64>(q))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_the_pairs() {
        for (i, [a, b]) in QUAD_PAIRS.into_iter().enumerate() {
            assert_eq!(place(a, b), i);
        }
    }
}
