//! Laws on hexahedra with trilinear shape functions, integrated over 2x2x2 Gauss points.
//!
//! A Gauss point deforms as a tetrahedron whose edges are the derivatives of the positions by the local
//! coordinates ([`sinew_engine::isoparametric`]), so every [`TetrahedronLaw`] that is a density of the
//! displacement gradient serves here; eight points fill a register (laws for comparison are compiled without
//! registers: each set costs compile time). With `f_j` (`K_ij`) the forces
//! (tangent blocks) on the three vertices of that tetrahedron that move,
//!
//! ```text
//! f_a = sum_q sum_j dN_a/dxi_j f_j        K_ab = sum_q sum_ij dN_a/dxi_i K_ij dN_b/dxi_j
//! ```

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::element::displacement_gradient;
use sinew_engine::isoparametric::{
    Derivatives, HEXAHEDRON_PAIRS, HexahedronBlocks, HexahedronRest, HexahedronVertices,
    hexahedron_differences, load_points, load_weights, rows_of,
};
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffer, Span, TangentKind};
use sinew_engine::scalar::{Real, Scalar};
use sinew_engine::schedule::{ElementLaw, Evaluation, activate_law};
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use crate::element::projection;
use crate::element::tetrahedron::{self, Element, TetrahedronTangent};
use crate::frame::tetrahedra::{
    CompressionModulus, FirstLameParameter, ShearModulus, TetrahedronLaw,
};
use crate::laws::corotational::Corotational;
use crate::laws::svk::FusedStVK;
use crate::laws::{LawRow, partition};

/// Law `L` at the Gauss points of hexahedra; also the mark of its hexahedra.
#[derive(Component, Debug)]
pub struct Hexahedral<L: Send + Sync + 'static>(PhantomData<fn() -> L>);

impl<L: Send + Sync + 'static> Clone for Hexahedral<L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<L: Send + Sync + 'static> Copy for Hexahedral<L> {}

impl<L: Send + Sync + 'static> Default for Hexahedral<L> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

/// A hexahedron as the kernels see it, one Gauss point per lane.
struct Points<'a, S: Scalar> {
    derivatives: &'a Derivatives<S, 8, 3>,
    rest: &'a HexahedronRest<S>,
    lambda: S,
    mu: S,
    compression: S,
    u: [[S; 3]; 8],
}

impl<S: Scalar> Points<'_, S> {
    /// The tetrahedra that stand for the points from `first` on, and their displacements (m).
    #[inline(always)]
    fn tetrahedra<Law: TetrahedronLaw, L: Lanes<Scalar = S>>(
        &self,
        first: usize,
    ) -> (Element<L>, [[L; 3]; 4]) {
        let u = hexahedron_differences::<L>(self.derivatives, &self.u, first);
        let volume = load_weights::<L, 8>(&self.rest.volume, first);
        let [lambda, mu, compression] =
            [self.lambda, self.mu, self.compression].map(|m| L::splat(m) * volume);
        let gradients = self.rest.gradients::<L>(first);
        if Law::FOLDS_VOLUME {
            return (Element { gradients, volume: L::ONE, lambda, mu, compression }, u);
        }
        let [lambda, mu, compression] = [self.lambda, self.mu, self.compression].map(L::splat);
        (Element { gradients, volume, lambda, mu, compression }, u)
    }
}

/// Columns of hexahedra, as slices.
struct Columns<'a, S: Scalar> {
    displacement: &'a [[S; 4]],
    nodes: &'a [[u32; 8]],
    blocks: &'a [[u32; 28]],
    rest: &'a [HexahedronRest<S>],
    lambda: &'a [S],
    mu: &'a [S],
    compression: &'a [S],
    derivatives: Derivatives<S, 8, 3>,
}

impl<S: Scalar> Columns<'_, S> {
    #[inline(always)]
    fn points(&self, i: usize) -> Points<'_, S> {
        Points {
            derivatives: &self.derivatives,
            rest: &self.rest[i],
            lambda: self.lambda[i],
            mu: self.mu[i],
            compression: self.compression[i],
            u: rows_of(self.displacement, &self.nodes[i]),
        }
    }
}

/// Query data of hexahedra.
type Data<S> = (
    &'static HexahedronVertices,
    &'static HexahedronBlocks,
    &'static HexahedronRest<S>,
    &'static FirstLameParameter<S>,
    &'static ShearModulus<S>,
    &'static CompressionModulus<S>,
);

/// Slices of [`Data`], as a contiguous query gives them.
type Slices<'a, S> = (
    &'a [HexahedronVertices],
    &'a [HexahedronBlocks],
    &'a [HexahedronRest<S>],
    &'a [FirstLameParameter<S>],
    &'a [ShearModulus<S>],
    &'a [CompressionModulus<S>],
);

/// Puts `L` on hexahedra into the force schedule.
pub(crate) fn activate<L: TetrahedronLaw, S: Scalar>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    let law = ElementLaw::<S, Data<S>> {
        info: row.info,
        place,
        mark: Some(world.register_component::<Hexahedral<L>>()),
        partition: partition::<HexahedronVertices, S>,
        evaluate: evaluate::<L, S>,
    };
    activate_law(world, law);
}

fn evaluate<L: TetrahedronLaw, S: Scalar>(
    Evaluation { request, workers, recovering }: Evaluation,
    displacement: &[Displacement<S>],
    (nodes, blocks, rest, lambda, mu, compression): Slices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns {
        displacement: Displacement::peel_slice(displacement),
        nodes: HexahedronVertices::peel_slice(nodes),
        blocks: HexahedronBlocks::peel_slice(blocks),
        rest,
        lambda: FirstLameParameter::peel_slice(lambda),
        mu: ShearModulus::peel_slice(mu),
        compression: CompressionModulus::peel_slice(compression),
        derivatives: Derivatives::hexahedron(),
    };
    let work = 400 * usize::from(request.energy)
        + 500 * usize::from(request.force)
        + 3000 * usize::from(request.tangent.is_some());
    workers.for_each(&mut buffer.spans, columns.rest.len() * work, |_, span| {
        if recovering.contains(span.body) {
            evaluate_span::<Corotational, S>(&columns, workers, request, span);
        } else {
            evaluate_span::<L, S>(&columns, workers, request, span);
        }
    });
}

fn evaluate_span<L: TetrahedronLaw, S: Scalar>(
    columns: &Columns<S>,
    workers: &Workers,
    request: &EvaluationRequest,
    span: &mut Span<S>,
) {
    let law = PhantomData::<fn() -> L>;
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
            if kind == TangentKind::Projected && L::STRESS_PROJECTION {
                workers.dispatch(ProjectedPass { columns, span });
            } else {
                workers.dispatch(TangentPass { columns, span, kind, law });
            }
        }
        None => span.drop_tangent(),
    }
}

struct EnergyPass<'a, 'b, L, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a Span<S>,
    law: PhantomData<fn() -> L>,
}

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for EnergyPass<'_, '_, Law, S> {
    type Output = f64;
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> f64 {
        let mut sums = [0.0; MAX_LANES];
        for i in self.span.elements.clone() {
            let points = self.columns.points(i);
            for first in (0..8).step_by(L::COUNT) {
                let (e, u) = points.tetrahedra::<Law, L>(first);
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

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for ForcePass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, .. } = self;
        for i in span.elements.clone() {
            let points = columns.points(i);
            let mut sum = [[L::ZERO; 3]; 8];
            for first in (0..8).step_by(L::COUNT) {
                let (e, u) = points.tetrahedra::<Law, L>(first);
                let Some(f) = Law::forces::<L>(&e, &u) else { continue };
                for a in 0..8 {
                    for j in 0..3 {
                        let d: L = load_points(&columns.derivatives.0[a][j], first);
                        for x in 0..3 {
                            sum[a][x] = d.mul_add(f[j + 1][x], sum[a][x]);
                        }
                    }
                }
            }
            for a in 0..8 {
                let mut force = [S::ZERO; 3];
                for x in 0..3 {
                    force[x] = total(sum[a][x]);
                }
                span.add_force(columns.nodes[i][a], force);
            }
        }
    }
}

/// Sum of the lanes, in their order.
#[inline(always)]
pub(crate) fn total<L: Lanes>(lanes: L) -> L::Scalar {
    let mut values = [L::Scalar::ZERO; MAX_LANES];
    lanes.store(&mut values);
    let mut sum = values[0];
    for value in &values[1..L::COUNT] {
        sum += *value;
    }
    sum
}

struct TangentPass<'a, 'b, L, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a mut Span<S>,
    kind: TangentKind,
    law: PhantomData<fn() -> L>,
}

impl<Law: TetrahedronLaw, S: Scalar> Kernel<S> for TangentPass<'_, '_, Law, S> {
    type Output = ();
    const WIDE: bool = Law::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { columns, span, kind, .. } = self;
        for i in span.elements.clone() {
            let points = columns.points(i);
            let mut sum = Blocks::ZERO;
            let mut clamped = false;
            for first in (0..8).step_by(L::COUNT) {
                let (e, u) = points.tetrahedra::<Law, L>(first);
                if kind == TangentKind::Projected {
                    // points that pad a register have no stiffness
                    let acts = L::less(L::ZERO, e.volume * e.mu);
                    clamped |= L::any(L::both(acts, Law::is_clamped(&e, &u)));
                }
                sum.add(&Law::tangent::<L>(&e, &u, kind), &columns.derivatives, first);
            }
            span.clamped += u64::from(clamped);
            sum.write(span, &columns.nodes[i], &columns.blocks[i]);
        }
    }
}

/// Projected tangents of the laws whose stress is that of St Venant-Kirchhoff with the compression term,
/// in `f64` whatever the simulation's type.
struct ProjectedPass<'a, 'b, S: Scalar> {
    columns: &'a Columns<'b, S>,
    span: &'a mut Span<S>,
}

impl<S: Scalar> Kernel<f64> for ProjectedPass<'_, '_, S> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = f64>>(self) {
        let Self { columns, span } = self;
        let derivatives = Derivatives::<f64, 8, 3>::hexahedron();
        for i in span.elements.clone() {
            let own = columns.points(i);
            let mut rest = HexahedronRest { gradients: [[0.0; 8]; 9], volume: [0.0; 8] };
            for q in 0..8 {
                rest.volume[q] = own.rest.volume[q].to_f64();
                for k in 0..9 {
                    rest.gradients[k][q] = own.rest.gradients[k][q].to_f64();
                }
            }
            let mut u = [[0.0; 3]; 8];
            for a in 0..8 {
                for x in 0..3 {
                    u[a][x] = own.u[a][x].to_f64();
                }
            }
            let points = Points {
                derivatives: &derivatives,
                rest: &rest,
                lambda: own.lambda.to_f64(),
                mu: own.mu.to_f64(),
                compression: own.compression.to_f64(),
                u,
            };
            let mut sum = Blocks::<L>::ZERO;
            let mut any = false;
            for first in (0..8).step_by(L::COUNT) {
                let (e, u) = points.tetrahedra::<FusedStVK, L>(first);
                let g = displacement_gradient(&e.gradients, &u);
                let (clamped, core) = projection::projected_blocks(&e, &g);
                let mut t = tetrahedron::tangent_parts(&e, &u, true, true);
                if L::any(clamped) {
                    any = true;
                    let projected = tetrahedron::assemble(&core);
                    for k in 0..9 {
                        for a in 1..4 {
                            let own = &mut t.diagonal[a][k];
                            *own = L::select(clamped, projected.diagonal[a][k], *own);
                        }
                        for edge in 3..6 {
                            let own = &mut t.off[edge][k];
                            *own = L::select(clamped, projected.off[edge][k], *own);
                        }
                    }
                }
                sum.add(&t, &derivatives, first);
            }
            span.clamped += u64::from(any);
            sum.write(span, &columns.nodes[i], &columns.blocks[i]);
        }
    }
}

/// Upper half of the 8x8 blocks of a hexahedron, one Gauss point per lane until they are summed.
pub(crate) struct Blocks<L> {
    diagonal: [[L; 9]; 8],
    off: [[L; 9]; 28],
}

impl<L: Lanes> Blocks<L> {
    pub(crate) const ZERO: Self = Self { diagonal: [[L::ZERO; 9]; 8], off: [[L::ZERO; 9]; 28] };

    /// Adds what the tangents of some points give.
    #[inline(always)]
    pub(crate) fn add(
        &mut self,
        t: &TetrahedronTangent<L>,
        derivatives: &Derivatives<L::Scalar, 8, 3>,
        first: usize,
    ) {
        let mut inner = [[[L::ZERO; 9]; 3]; 3];
        for i in 0..3 {
            for j in 0..3 {
                inner[i][j] = t.block(i + 1, j + 1);
            }
        }
        let mut d = [[L::ZERO; 3]; 8];
        for a in 0..8 {
            for j in 0..3 {
                d[a][j] = load_points(&derivatives.0[a][j], first);
            }
        }
        for b in 0..8 {
            // what moving vertex b does to the three vertices of the tetrahedron
            let mut column = [[L::ZERO; 9]; 3];
            for i in 0..3 {
                for j in 0..3 {
                    for k in 0..9 {
                        column[i][k] = d[b][j].mul_add(inner[i][j][k], column[i][k]);
                    }
                }
            }
            for a in 0..=b {
                let own = if a == b { &mut self.diagonal[a] } else { &mut self.off[place(a, b)] };
                for i in 0..3 {
                    for k in 0..9 {
                        own[k] = d[a][i].mul_add(column[i][k], own[k]);
                    }
                }
            }
        }
    }

    /// Sums the points and adds the blocks to a range.
    #[inline(always)]
    pub(crate) fn write<S: Scalar>(
        &self,
        span: &mut Span<S>,
        nodes: &[u32; 8],
        blocks: &[u32; 28],
    ) {
        let sum = |block: &[L; 9]| {
            let mut result = [S::ZERO; 9];
            for k in 0..9 {
                result[k] = S::from_f64(total(block[k]).to_f64());
            }
            result
        };
        for a in 0..8 {
            let mut block = sum(&self.diagonal[a]);
            let half = S::from_f64(0.5);
            for (x, y) in [(1, 3), (2, 6), (5, 7)] {
                let mean = half * (block[x] + block[y]);
                (block[x], block[y]) = (mean, mean);
            }
            span.add_diagonal(nodes[a], &block);
        }
        for (pair, [a, b]) in HEXAHEDRON_PAIRS.into_iter().enumerate() {
            span.add_off_diagonal(blocks[pair], nodes[a], nodes[b], &sum(&self.off[pair]));
        }
    }
}

/// Place of the pair of local vertices `a < b` in [`HEXAHEDRON_PAIRS`].
#[inline(always)]
fn place(a: usize, b: usize) -> usize {
    a * (15 - a) / 2 + b - a - 1
}

/// The tetrahedra that stand for the Gauss points of a hexahedron, whose volumes add up to its own, with
/// their displacements (m); moduli (Pa) lambda, mu and that of the compression term.
pub(crate) fn tetrahedra(
    rest: &HexahedronRest<f64>,
    [lambda, mu, compression]: [f64; 3],
    u: &[[f64; 3]; 8],
) -> [(Element<f64>, [[f64; 3]; 4]); 8] {
    let derivatives = &Derivatives::hexahedron();
    std::array::from_fn(|q| {
        let u = hexahedron_differences::<f64>(derivatives, u, q);
        let (gradients, volume) = (rest.gradients::<f64>(q), rest.volume[q]);
        (Element { gradients, volume, lambda, mu, compression }, u)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_the_pairs() {
        for (i, [a, b]) in HEXAHEDRON_PAIRS.into_iter().enumerate() {
            assert_eq!(place(a, b), i);
        }
    }
}
