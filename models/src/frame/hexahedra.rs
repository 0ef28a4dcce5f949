//! Laws on hexahedra with trilinear shape functions, integrated over 2x2x2 Gauss points.
//!
//! A Gauss point deforms as a tetrahedron whose edges are the derivatives of the positions by the local
//! coordinates ([`super::gauss`]), so every [`TetrahedronLaw`] that is a density of the displacement gradient
//! serves here; eight points fill a register (laws for comparison are compiled without registers: each set costs
//! compile time).
//!
//! # Mean dilatation
//!
//! Near incompressibility the eight volume ratios of a hexahedron are more than its vertices can hold. Laws whose
//! volume term is one in `J - 1` ([`TAKES_PRESSURE`](TetrahedronLaw::TAKES_PRESSURE)) can have all of `lambda` act on
//! its mean over the element, with `v_q` the volumes of the points and `V` their sum (Nagtegaal, Parks & Rice 1974 as an
//! energy):
//!
//! ```text
//! W = sum_q v_q shape(F_q) + V lambda/2 m^2       m = 1/V sum_q v_q (J_q - 1)       p = lambda m
//! f_a = - sum_q v_q (P_shape + p cof F_q) D_qa    K = sum_q K_q(p) + lambda/V b b^T,  b_a = sum_q v_q cof F_q D_qa
//! ```

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::element::{displacement_gradient, volume_change};
use sinew_engine::isoparametric::{
    Derivatives, HexahedronBlocks, HexahedronRest, HexahedronVertices, hexahedron_differences,
    load_points, load_weights,
};
use sinew_engine::lanes::{Kernel, Lanes};
use sinew_engine::law::{EvaluationRequest, LawBuffer, Span, TangentKind};
use sinew_engine::scalar::{Real, Scalar, mat_vec};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{evaluate_span, work};
use super::gauss::{AtPoints, Blocks, GaussColumns, GaussElements, GaussLaw, total};
use super::tetrahedra::{CompressionModulus, FirstLameParameter, ShearModulus, TetrahedronLaw};
use crate::element::projection;
use crate::element::tetrahedron::{self, Element, TetrahedronTangent};
use crate::laws::corotational::Corotational;
use crate::laws::svk::FusedStVK;
use crate::laws::{LawRow, activate_elements};

/// Law `L` at the Gauss points of hexahedra; also the mark of its hexahedra.
pub type Hexahedral<L> = AtPoints<L, 8>;

/// Law `L` with its volume term by the mean of an element.
#[derive(Clone, Copy, Debug)]
pub struct ByMean<L>(PhantomData<fn() -> L>);

/// Columns of hexahedra, as slices.
struct Columns<'a, S: Scalar> {
    elements: GaussElements<'a, S, 8, 3, 28>,
    rest: &'a [HexahedronRest<S>],
    /// lambda, mu and that of the compression term (Pa).
    moduli: [&'a [S]; 3],
}

impl<S: Scalar> Columns<'_, S> {
    #[inline(always)]
    fn moduli(&self, element: usize) -> [S; 3] {
        let [lambda, mu, compression] = self.moduli;
        [lambda[element], mu[element], compression[element]]
    }
}

/// A tetrahedron that stands for a Gauss point, and its displacements (m).
type Point<L> = (Element<L>, [[L; 3]; 4]);

/// The tetrahedra that stand for the Gauss points from `first` on of a hexahedron, and their displacements (m).
#[inline(always)]
fn points<Law: TetrahedronLaw, L: Lanes>(
    derivatives: &Derivatives<L::Scalar, 8, 3>,
    rest: &HexahedronRest<L::Scalar>,
    moduli: [L::Scalar; 3],
    u: &[[L::Scalar; 3]; 8],
    first: usize,
) -> Point<L> {
    let u = hexahedron_differences::<L>(derivatives, u, first);
    let volume = load_weights::<L, 8>(&rest.volume, first);
    let gradients = rest.gradients::<L>(first);
    let [lambda, mu, compression] = moduli.map(L::splat);
    let (pressure, quartic) = (L::ZERO, L::ZERO);
    if Law::FOLDS_VOLUME {
        let [lambda, mu, compression] = [lambda * volume, mu * volume, compression * volume];
        let volume = L::ONE;
        return (Element { gradients, volume, lambda, mu, compression, pressure, quartic }, u);
    }
    (Element { gradients, volume, lambda, mu, compression, pressure, quartic }, u)
}

/// Volume (m^3) of a hexahedron, and the mean of `J - 1` over it.
#[inline(always)]
fn mean_change<L: Lanes>(
    derivatives: &Derivatives<L::Scalar, 8, 3>,
    rest: &HexahedronRest<L::Scalar>,
    u: &[[L::Scalar; 3]; 8],
) -> [f64; 2] {
    let (mut volume, mut change) = (0.0, 0.0);
    for first in (0..8).step_by(L::COUNT) {
        let own = load_weights::<L, 8>(&rest.volume, first);
        let u = hexahedron_differences::<L>(derivatives, u, first);
        let g = displacement_gradient(&rest.gradients::<L>(first), &u);
        volume += total(own).to_f64();
        change += total(own * volume_change(&g)).to_f64();
    }
    [volume, change / volume]
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

/// Hexahedra that follow law `Law`, with its volume term at the points or by the mean.
struct OfLaw<'a, 'b, Law, S: Scalar, const MEAN: bool> {
    columns: &'a Columns<'b, S>,
    law: PhantomData<fn() -> Law>,
}

impl<Law: TetrahedronLaw, S: Scalar, const MEAN: bool> GaussLaw<S, 8, 3, 28>
    for OfLaw<'_, '_, Law, S, MEAN>
{
    const WIDE: bool = Law::WIDE;
    type Points<L: Lanes<Scalar = S>> = Point<L>;
    #[inline(always)]
    fn elements(&self) -> &GaussElements<'_, S, 8, 3, 28> {
        &self.columns.elements
    }
    #[inline(always)]
    fn points<L: Lanes<Scalar = S>>(&self, i: usize, u: &[[S; 3]; 8], first: usize) -> Point<L> {
        let columns = self.columns;
        let (derivatives, rest) = (&columns.elements.derivatives, &columns.rest[i]);
        let [lambda, mu, compression] = columns.moduli(i);
        if !MEAN {
            return points::<Law, L>(derivatives, rest, [lambda, mu, compression], u, first);
        }
        let [_, mean] = mean_change::<L>(derivatives, rest, u);
        let shape = [S::ZERO, mu, compression];
        let (e, u) = points::<Law, L>(derivatives, rest, shape, u, first);
        let pressure = L::splat(lambda * S::from_f64(mean));
        let folded = if Law::FOLDS_VOLUME { load_weights(&rest.volume, first) } else { L::ONE };
        (Element { pressure: pressure * folded, ..e }, u)
    }
    #[inline(always)]
    fn energy<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> L {
        // V lambda/2 m^2 = sum_q v_q p/2 (J_q - 1)
        let pressure = if MEAN { L::splat(S::from_f64(0.5)) * e.pressure } else { e.pressure };
        Law::energy(&Element { pressure, ..*e }, u)
    }
    #[inline(always)]
    fn forces<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> Option<[[L; 3]; 3]> {
        let [_, a, b, c] = Law::forces(e, u)?;
        Some([a, b, c])
    }
    #[inline(always)]
    fn tangent<L: Lanes<Scalar = S>>((e, u): &Point<L>, kind: TangentKind) -> [[[L; 9]; 3]; 3] {
        inner_blocks(&Law::tangent(e, u, kind))
    }
    #[inline(always)]
    fn add_whole<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; 8],
        to: &mut Blocks<L, 8, 28>,
    ) {
        if !MEAN {
            return;
        }
        let columns = self.columns;
        let (derivatives, rest) = (&columns.elements.derivatives, &columns.rest[i]);
        let (mut sum, mut volume) = ([[L::ZERO; 3]; 8], 0.0);
        for first in (0..8).step_by(L::COUNT) {
            let own = load_weights::<L, 8>(&rest.volume, first);
            volume += total(own).to_f64();
            let gradients = rest.gradients::<L>(first);
            let differences = hexahedron_differences::<L>(derivatives, u, first);
            let cof = tetrahedron::cofactor(&displacement_gradient(&gradients, &differences));
            let d = gradients.map(|d| mat_vec(&cof, d).map(|x| own * x));
            for a in 0..8 {
                for j in 0..3 {
                    let share: L = load_points(&derivatives.0[a][j], first);
                    for x in 0..3 {
                        sum[a][x] = share.mul_add(d[j][x], sum[a][x]);
                    }
                }
            }
        }
        // a material with nu < 0 would make this negative
        let [lambda, ..] = columns.moduli(i);
        let factor = S::from_f64(lambda.to_f64().max(0.0) / volume);
        to.add_outer(factor, &sum.map(|row| row.map(total)));
    }
    #[inline(always)]
    fn is_clamped<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> L::Mask {
        L::both(L::less(L::ZERO, e.volume * e.mu), Law::is_clamped(e, u))
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

/// Slices of [`Data`].
type Slices<'a, S> = <Data<S> as ContiguousQueryData>::Contiguous<'a, 'a>;

/// Puts `L` on hexahedra into the force schedule, with its volume term at the points or by the mean.
pub(crate) fn activate<L: TetrahedronLaw, S: Scalar, const MEAN: bool>(
    world: &mut World,
    row: &'static LawRow,
    place: usize,
) {
    const { assert!(L::TAKES_PRESSURE || !MEAN) };
    let evaluate = evaluate::<L, S, MEAN>;
    activate_elements::<HexahedronVertices, S, Data<S>>(world, row, place, evaluate);
}

fn evaluate<L: TetrahedronLaw, S: Scalar, const MEAN: bool>(
    Evaluation { request, workers, recovering }: Evaluation,
    displacement: &[Displacement<S>],
    (nodes, blocks, rest, lambda, mu, compression): Slices<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let columns = Columns {
        elements: GaussElements {
            displacement: Displacement::peel_slice(displacement),
            nodes: HexahedronVertices::peel_slice(nodes),
            blocks: HexahedronBlocks::peel_slice(blocks),
            derivatives: Derivatives::hexahedron(),
        },
        rest,
        moduli: [
            FirstLameParameter::peel_slice(lambda),
            ShearModulus::peel_slice(mu),
            CompressionModulus::peel_slice(compression),
        ],
    };
    let work = rest.len() * work(request, [400, 500, 3000]);
    workers.for_each(&mut buffer.spans, work, |_, span| {
        if recovering.contains(span.body) {
            evaluate_law::<Corotational, S, false>(&columns, request, workers, span);
        } else {
            evaluate_law::<L, S, MEAN>(&columns, request, workers, span);
        }
    });
}

fn evaluate_law<L: TetrahedronLaw, S: Scalar, const MEAN: bool>(
    columns: &Columns<S>,
    request: &EvaluationRequest,
    workers: &Workers,
    span: &mut Span<S>,
) {
    let of_stress = L::STRESS_PROJECTION && request.tangent == Some(TangentKind::Projected);
    let tangent = if of_stress { None } else { request.tangent };
    let law = OfLaw::<L, S, MEAN> { columns, law: PhantomData };
    evaluate_span(&GaussColumns(&law), &EvaluationRequest { tangent, ..*request }, workers, span);
    if of_stress {
        span.clear_tangent();
        workers.dispatch(ProjectedPass { columns, span });
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
            let own = &columns.rest[i];
            let mut rest = HexahedronRest { gradients: [[0.0; 8]; 9], volume: [0.0; 8] };
            for q in 0..8 {
                rest.volume[q] = own.volume[q].to_f64();
                for k in 0..9 {
                    rest.gradients[k][q] = own.gradients[k][q].to_f64();
                }
            }
            let moduli = columns.moduli(i).map(S::to_f64);
            let narrow = columns.elements.displacements(i);
            let mut u = [[0.0; 3]; 8];
            for a in 0..8 {
                for x in 0..3 {
                    u[a][x] = narrow[a][x].to_f64();
                }
            }
            let mut sum = Blocks::<L, 8, 28>::ZERO;
            let mut any = false;
            for first in (0..8).step_by(L::COUNT) {
                let (e, u) = points::<FusedStVK, L>(&derivatives, &rest, moduli, &u, first);
                let g = displacement_gradient(&e.gradients, &u);
                let (clamped, core) = projection::projected_blocks(&e, &g);
                let mut inner = inner_blocks(&tetrahedron::tangent_parts(&e, &u, true, true));
                if L::any(clamped) {
                    any = true;
                    let projected = inner_blocks(&tetrahedron::assemble(&core));
                    for i in 0..3 {
                        for j in 0..3 {
                            for k in 0..9 {
                                let own = &mut inner[i][j][k];
                                *own = L::select(clamped, projected[i][j][k], *own);
                            }
                        }
                    }
                }
                sum.add(&inner, &derivatives, first);
            }
            span.clamped += u64::from(any);
            sum.write(span, &columns.elements.nodes[i], &columns.elements.blocks[i]);
        }
    }
}

/// Takes the volume terms of the points of a hexahedron as that of its mean: their energies then add up to its own.
pub(crate) fn by_mean(points: &mut [(Element<f64>, [[f64; 3]; 4]); 8]) {
    let change =
        |(e, u): &(Element<f64>, _)| volume_change(&displacement_gradient(&e.gradients, u));
    let volume: f64 = points.iter().map(|(e, _)| e.volume).sum();
    let mean = points.iter().map(|point| point.0.volume * change(point)).sum::<f64>() / volume;
    for (e, _) in points {
        (e.pressure, e.lambda) = (0.5 * e.lambda * mean, 0.0);
    }
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
        let (pressure, quartic) = (0.0, 0.0);
        (Element { gradients, volume, lambda, mu, compression, pressure, quartic }, u)
    })
}
