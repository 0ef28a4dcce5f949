//! Laws on solid elements with Gauss points: hexahedra with trilinear shape functions over 2x2x2 points, ten-node
//! tetrahedra with quadratic ones over four.
//!
//! A Gauss point deforms as a tetrahedron whose edges are the derivatives of the positions by the local
//! coordinates ([`super::gauss`]), so every [`TetrahedronLaw`] that is a density of the displacement gradient
//! serves here; eight points fill a register, four half of one (laws for comparison and those of ten-node tetrahedra are
//! not compiled for AVX-512: each set costs compile time and size).
//!
//! # Mean dilatation
//!
//! Near incompressibility the volume ratios of all points are more than the vertices can hold. Laws whose
//! volume term is one in `J - 1` or in the trace of a strain ([`VOLUME`](TetrahedronLaw::VOLUME)) can have all of `lambda` act on
//! its mean over the element, with `v_q` the volumes of the points and `V` their sum (Nagtegaal, Parks & Rice 1974 as an
//! energy):
//!
//! ```text
//! W = sum_q v_q shape(F_q) + V lambda/2 m^2       m = 1/V sum_q v_q (J_q - 1)       p = lambda m
//! f_a = - sum_q v_q (P_shape + p cof F_q) D_qa    K = sum_q K_q(p) + lambda/V b b^T,  b_a = sum_q v_q cof F_q D_qa
//! ```
//!
//! The means are those of clusters of one element ([`super::means`]). They leave single points free, so a point that has lost
//! half of its volume is held by a term of its own. Flat, it costs what the compression term of `svk_comp` makes it
//! cost, `(lambda + mu)/2`, and no more than the quartic term of [`super::clusters`] does, `5 mu`:
//!
//! ```text
//! W += sum_q v_q kappa/2 x_q^4      x_q = min(J_q - 1/2, 0)      kappa = 16 min(lambda + mu, 10 mu)
//! ```
//!
//! Nothing is added before: the solved problems of `sinew validate` have no point below `J` = 0.8, and the same equilibria.

use bevy_ecs::bundle::NoBundleEffect;
use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::element::displacement_gradient;
use sinew_engine::isoparametric::{
    Derivatives, HexahedronBlocks, HexahedronVertices, OwnPoints, PointsRest, Tetrahedron10Blocks,
    Tetrahedron10Vertices, derivatives_of, load_points, load_weights, point_differences,
};
use sinew_engine::lanes::{Kernel, Lanes};
use sinew_engine::law::{EvaluationRequest, LawBuffer, LawInfo, Span, TangentKind};
use sinew_engine::scalar::{Real, Scalar, Single, mat_vec};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{evaluate_span, work};
use super::gauss::{
    Assemble, AtPoints, GaussColumns, GaussElements, GaussLaw, PointTangents, total,
};
use super::law::{TangentAtPoint, TetrahedronLaw, inner_blocks};
use super::means::{self, KeptByMean, MeanLaw};
use super::moduli::{
    ClusterIndex, ClusterPressure, CompressionModulus, FirstLameParameter, PredictedPressure,
    Pressures, ShearModulus,
};
use super::part::{SolidPart, spawn_hexahedra, spawn_tetrahedra10};
use super::row::{
    Activate, ElementRows, Elements, InRecovery, LawRow, Mark, Measure, PlacedLaw,
    activate_elements, mark,
};
use super::rules::VolumeMeasure;
use super::stand_in::Corotational;
use crate::element::projection;
use crate::element::tetrahedron::{self, Element};

/// Law `L` with its volume term by the mean of an element.
#[derive(Clone, Copy, Debug)]
pub struct ByMean<L>(PhantomData<fn() -> L>);

/// A kind of solid elements with `V` vertices, `P` pairs of them and `Q` Gauss points.
pub(crate) trait Shape<const V: usize, const P: usize, const Q: usize>: 'static {
    /// Column of vertex rows.
    type Vertices: ElementRows + TransparentWrapper<[u32; V]>;
    /// Column of tangent blocks.
    type Blocks: Component<Mutability = Mutable> + TransparentWrapper<[u32; P]>;
    /// What it is called in rows of laws.
    const ELEMENTS: Elements;
    /// As [`Kernel::WIDE`], where the law says so too.
    const WIDE: bool;
    /// Spawns those of a body with `M`, the mark of their law and columns of its own.
    fn spawn<M, S>(world: &mut World, part: &SolidPart)
    where
        M: Bundle<Effect: NoBundleEffect> + Default,
        S: Scalar;
    /// Derivatives of the shape functions.
    fn derivatives<S: Scalar>() -> Derivatives<S, V, 3, Q>;
    /// Those in elements that have points of their own.
    fn own(points: &OwnPoints) -> &[Derivatives<f64, V, 3, Q>];
    /// Derivatives where a body that recovers has the points of its elements.
    fn recovery_derivatives<S: Scalar>() -> Derivatives<S, V, 3, Q> {
        Self::derivatives()
    }
}

/// Hexahedra.
pub(crate) struct Brick;

impl Shape<8, 28, 8> for Brick {
    type Vertices = HexahedronVertices;
    type Blocks = HexahedronBlocks;
    const ELEMENTS: Elements = Elements::Hexahedra;
    const WIDE: bool = true;
    fn spawn<M, S>(world: &mut World, part: &SolidPart)
    where
        M: Bundle<Effect: NoBundleEffect> + Default,
        S: Scalar,
    {
        spawn_hexahedra::<M, S>(world, part);
    }
    fn derivatives<S: Scalar>() -> Derivatives<S, 8, 3, 8> {
        Derivatives::hexahedron()
    }
    fn own(points: &OwnPoints) -> &[Derivatives<f64, 8, 3, 8>] {
        &points.bricks
    }
}

/// Ten-node tetrahedra.
pub(crate) struct TenNodes;

impl Shape<10, 45, 4> for TenNodes {
    type Vertices = Tetrahedron10Vertices;
    type Blocks = Tetrahedron10Blocks;
    const ELEMENTS: Elements = Elements::Tetrahedra10;
    const WIDE: bool = false;
    fn spawn<M, S>(world: &mut World, part: &SolidPart)
    where
        M: Bundle<Effect: NoBundleEffect> + Default,
        S: Scalar,
    {
        spawn_tetrahedra10::<M, S>(world, part);
    }
    fn derivatives<S: Scalar>() -> Derivatives<S, 10, 3, 4> {
        Derivatives::tetrahedron10()
    }
    fn own(points: &OwnPoints) -> &[Derivatives<f64, 10, 3, 4>] {
        &points.tens
    }
    /// At the corners: folded elements can be at rest with all of their Gauss points in order. Rest gradients stay those of the
    /// points, which are the same unless edges are curved.
    fn recovery_derivatives<S: Scalar>() -> Derivatives<S, 10, 3, 4> {
        Derivatives::tetrahedron10_corners()
    }
}

impl LawRow {
    /// Law `L` of tetrahedra at the Gauss points of hexahedra, under another name.
    pub const fn hexahedra<L: TetrahedronLaw>(name: &'static str) -> Self {
        Self::by_points::<L, Brick, 8, 28, 8>(name)
    }

    /// The same with its volume term by the mean of each hexahedron; `measure` as for clusters.
    pub const fn hexahedra_by_mean<L: TetrahedronLaw>(
        name: &'static str,
        measure: &'static str,
    ) -> Self {
        Self::by_mean::<L, Brick, 8, 28, 8>(name, measure)
    }

    /// Law `L` of tetrahedra at the Gauss points of ten-node tetrahedra, under another name.
    pub const fn tetrahedra10<L: TetrahedronLaw>(name: &'static str) -> Self {
        Self::by_points::<L, TenNodes, 10, 45, 4>(name)
    }

    /// The same with its volume term by the mean of each ten-node tetrahedron; `measure` as for clusters.
    pub const fn tetrahedra10_by_mean<L: TetrahedronLaw>(
        name: &'static str,
        measure: &'static str,
    ) -> Self {
        Self::by_mean::<L, TenNodes, 10, 45, 4>(name, measure)
    }

    const fn by_points<L, E, const V: usize, const P: usize, const Q: usize>(
        name: &'static str,
    ) -> Self
    where
        L: TetrahedronLaw,
        E: Shape<V, P, Q>,
    {
        let activate: [Activate; 2] =
            [activate::<L, E, f64, V, P, Q>, activate::<L, E, Single, V, P, Q>];
        Self {
            spawn: Some([E::spawn::<AtPoints<L, V>, f64>, E::spawn::<AtPoints<L, V>, Single>]),
            ..Self::at_points::<L>(name, E::ELEMENTS, [mark::<AtPoints<L, V>>; 2], activate)
        }
    }

    const fn by_mean<L, E, const V: usize, const P: usize, const Q: usize>(
        name: &'static str,
        measure: &'static str,
    ) -> Self
    where
        L: TetrahedronLaw,
        E: Shape<V, P, Q>,
    {
        let mark: [Mark; 2] = [mark::<AtPoints<ByMean<L>, V>>; 2];
        let activate: [Activate; 2] =
            [activate_by_mean::<L, E, f64, V, P, Q>, activate_by_mean::<L, E, Single, V, P, Q>];
        Self {
            measure: Measure::of::<L>(measure),
            spawn: Some([
                E::spawn::<(AtPoints<ByMean<L>, V>, Pressures<f64>), f64>,
                E::spawn::<(AtPoints<ByMean<L>, V>, Pressures<Single>), Single>,
            ]),
            ..Self::at_points::<L>(name, E::ELEMENTS, mark, activate)
        }
    }

    const fn at_points<L: TetrahedronLaw>(
        name: &'static str,
        elements: Elements,
        mark: [Mark; 2],
        activate: [Activate; 2],
    ) -> Self {
        Self {
            tangent: L::contributes,
            recovery: InRecovery::StandIn,
            energy: Some(|e, u| L::energy(e, u)),
            holds_pressure: L::HOLDS_PRESSURE,
            softens: L::SOFTENS,
            ..Self::of_systems(LawInfo::elastic(name), elements, mark, activate)
        }
    }
}

/// Columns of elements, as slices.
pub(crate) struct Columns<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    pub elements: GaussElements<'a, S, V, 3, P, Q>,
    pub rest: &'a [PointsRest<S, Q>],
    /// lambda, mu and that of the compression term (Pa).
    pub moduli: [&'a [S]; 3],
    /// Pressures (Pa) for forces and for tangents, where elements keep means of their volumes; otherwise empty.
    pub pressures: [&'a [S]; 2],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> Columns<'_, S, V, P, Q> {
    #[inline(always)]
    fn moduli(&self, element: usize) -> [S; 3] {
        let [lambda, mu, compression] = self.moduli;
        [lambda[element], mu[element], compression[element]]
    }
}

/// A tetrahedron that stands for a Gauss point, and its displacements (m).
type Point<L> = (Element<L>, [[L; 3]; 4]);

/// The tetrahedra that stand for the Gauss points from `first` on of an element, and their displacements (m); volumes
/// are multiplied into the moduli, or not.
#[inline(always)]
fn points<L: Lanes, const V: usize, const Q: usize>(
    folds_volume: bool,
    derivatives: &Derivatives<L::Scalar, V, 3, Q>,
    rest: &PointsRest<L::Scalar, Q>,
    moduli: [L::Scalar; 3],
    u: &[[L::Scalar; 3]; V],
    first: usize,
) -> Point<L> {
    let u = point_differences::<L, 4, _, _, _>(derivatives, u, first);
    let volume = load_weights::<L, Q>(&rest.volume, first);
    let gradients = rest.gradients::<L>(first);
    let (folded, volume) = if folds_volume { (volume, L::ONE) } else { (L::ONE, volume) };
    (Element::plain(gradients, volume, moduli.map(|x| L::splat(x) * folded)), u)
}

/// A point as the laws see it where the mean of its element has all of `lambda`.
#[inline(always)]
fn held_by_mean<R: Real>(e: Element<R>, pressure: R) -> Element<R> {
    let flat = (e.lambda + e.mu).min(R::from_f64(10.0) * e.mu);
    let (quartic, slack) = (R::from_f64(16.0) * flat, R::from_f64(0.5));
    Element { lambda: R::ZERO, pressure, quartic, slack, ..e }
}

/// Elements that follow law `Law`. Whether its volume term acts at the points or by their mean is told at run time, so that
/// kernels are there once for both.
struct OfLaw<'a, 'b, Law, E, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    columns: &'a Columns<'b, S, V, P, Q>,
    by_mean: bool,
    law: PhantomData<fn() -> (Law, E)>,
}

impl<Law: TetrahedronLaw, E, S: Scalar, const V: usize, const P: usize, const Q: usize>
    OfLaw<'_, '_, Law, E, S, V, P, Q>
{
    /// The points from `first` on, with the pressures for forces (0) or for tangents (1).
    #[inline(always)]
    fn with_pressure<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; V],
        (derivatives, first): (&Derivatives<S, V, 3, Q>, usize),
        which: usize,
    ) -> Point<L> {
        let columns = self.columns;
        let rest = &columns.rest[i];
        let (e, u) =
            points::<L, V, Q>(Law::FOLDS_VOLUME, derivatives, rest, columns.moduli(i), u, first);
        if !(Law::VOLUME.is_some() && self.by_mean) {
            return (e, u);
        }
        let folded = if Law::FOLDS_VOLUME { load_weights(&rest.volume, first) } else { L::ONE };
        let pressure = L::splat(columns.pressures[which][i]) * folded;
        (held_by_mean(e, pressure), u)
    }
}

impl<Law: TetrahedronLaw, E, S: Scalar, const V: usize, const P: usize, const Q: usize>
    GaussLaw<S, V, 3, P, Q> for OfLaw<'_, '_, Law, E, S, V, P, Q>
where
    E: Shape<V, P, Q>,
{
    const WIDE: bool = Law::WIDE && E::WIDE;
    type Points<L: Lanes<Scalar = S>> = Point<L>;
    #[inline(always)]
    fn elements(&self) -> &GaussElements<'_, S, V, 3, P, Q> {
        &self.columns.elements
    }
    #[inline(always)]
    fn own(&self, i: usize) -> u32 {
        self.columns.rest[i].own
    }
    #[inline(always)]
    fn points<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; V],
        at: (&Derivatives<S, V, 3, Q>, usize),
    ) -> Point<L> {
        self.with_pressure(i, u, at, 0)
    }
    #[inline(always)]
    fn tangent_points<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; V],
        at: (&Derivatives<S, V, 3, Q>, usize),
    ) -> Point<L> {
        self.with_pressure(i, u, at, 1)
    }
    #[inline(always)]
    fn energy<L: Lanes<Scalar = S>>(&self, (e, u): &Point<L>) -> L {
        // V lambda/2 m^2 = sum_q v_q p/2 (J_q - 1)
        let pressure = L::splat(S::from_f64(0.5)) * e.pressure;
        Law::energy(&Element { pressure, ..*e }, u)
    }
    #[inline(always)]
    fn forces<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> Option<[[L; 3]; 3]> {
        let [_, a, b, c] = Law::forces(e, u)?;
        Some([a, b, c])
    }
    #[inline(always)]
    fn tangent<L: Lanes<Scalar = S>>((e, u): &Point<L>, kind: TangentKind) -> [[[L; 9]; 3]; 3] {
        L::apart(TangentAtPoint::<Law, L>::new(e, u, kind))
    }
    #[inline(always)]
    fn is_clamped<L: Lanes<Scalar = S>>((e, u): &Point<L>) -> L::Mask {
        L::both(L::less(L::ZERO, e.volume * e.mu), Law::is_clamped(e, u))
    }
}

/// Query data of elements.
type Data<S, A, B, const Q: usize> = (
    &'static A,
    &'static B,
    &'static PointsRest<S, Q>,
    &'static FirstLameParameter<S>,
    &'static ShearModulus<S>,
    &'static CompressionModulus<S>,
);

/// Slices of [`Data`].
type Slices<'a, S, A, B, const Q: usize> =
    <Data<S, A, B, Q> as ContiguousQueryData>::Contiguous<'a, 'a>;

/// Puts `L` on elements of a kind into the force schedule.
pub(crate) fn activate<L, E, S, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) where
    L: TetrahedronLaw,
    E: Shape<V, P, Q>,
    S: Scalar,
{
    activate_elements::<E::Vertices, S, Data<S, E::Vertices, E::Blocks, Q>>(
        world,
        law,
        |with, u, data, buffer| {
            let columns = columns::<E, S, V, P, Q>(u, data, E::own(with.points));
            evaluate::<L, E, S, V, P, Q>(with, &columns, buffer);
        },
    );
}

/// The same with its volume term by the mean of each element.
pub(crate) fn activate_by_mean<L, E, S, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) where
    L: TetrahedronLaw,
    E: Shape<V, P, Q>,
    S: Scalar,
{
    const { assert!(L::VOLUME.is_some()) };
    type Read<S> = (&'static ClusterPressure<S>, &'static PredictedPressure<S>);
    activate_elements::<E::Vertices, S, (Data<S, E::Vertices, E::Blocks, Q>, Read<S>)>(
        world,
        law,
        |with, u, (data, (pressure, predicted)), buffer| {
            let pressure = ClusterPressure::peel_slice(pressure);
            let pressures = [pressure, PredictedPressure::peel_slice(predicted)];
            let columns = columns::<E, S, V, P, Q>(u, data, E::own(with.points));
            let columns = Columns { pressures, ..columns };
            evaluate::<L, E, S, V, P, Q>(with, &columns, buffer);
        },
    );
    means::activate::<MeansOfPoints<L, E, P, Q>, S, V>(world, law);
}

fn columns<'a, E: Shape<V, P, Q>, S: Scalar, const V: usize, const P: usize, const Q: usize>(
    displacement: &'a [Displacement<S>],
    (nodes, blocks, rest, lambda, mu, compression): Slices<'a, S, E::Vertices, E::Blocks, Q>,
    own: &'a [Derivatives<f64, V, 3, Q>],
) -> Columns<'a, S, V, P, Q> {
    Columns {
        elements: GaussElements {
            displacement: Displacement::peel_slice(displacement),
            nodes: E::Vertices::peel_slice(nodes),
            blocks: E::Blocks::peel_slice(blocks),
            derivatives: E::derivatives(),
            own,
        },
        rest,
        moduli: [
            FirstLameParameter::peel_slice(lambda),
            ShearModulus::peel_slice(mu),
            CompressionModulus::peel_slice(compression),
        ],
        pressures: [&[], &[]],
    }
}

#[inline(never)]
fn evaluate<
    L: TetrahedronLaw,
    E: Shape<V, P, Q>,
    S: Scalar,
    const V: usize,
    const P: usize,
    const Q: usize,
>(
    Evaluation { request, workers, recovering, .. }: Evaluation,
    columns: &Columns<'_, S, V, P, Q>,
    buffer: &mut LawBuffer<S>,
) {
    let by_mean = !columns.pressures[0].is_empty();
    let work = columns.rest.len() * work(request, [50 * Q, 60 * Q, 400 * Q]);
    let derivatives = E::recovery_derivatives();
    let in_recovery =
        Columns { elements: GaussElements { derivatives, ..columns.elements }, ..*columns };
    buffer.for_each_awake(workers, work, |_, span| {
        if recovering.contains(span.body) {
            evaluate_law::<Corotational, E, S, V, P, Q>(
                &in_recovery,
                request,
                workers,
                false,
                span,
            );
        } else {
            evaluate_law::<L, E, S, V, P, Q>(columns, request, workers, by_mean, span);
        }
    });
}

/// Law `L` on elements of kind `E`, by means.
pub(crate) struct MeansOfPoints<L, E, const P: usize, const Q: usize>(PhantomData<fn() -> (L, E)>);

impl<L, E, S: Scalar, const V: usize, const P: usize, const Q: usize> MeanLaw<S, V>
    for MeansOfPoints<L, E, P, Q>
where
    L: TetrahedronLaw,
    E: Shape<V, P, Q>,
{
    type Mark = AtPoints<ByMean<L>, V>;
    type Data = Data<S, E::Vertices, E::Blocks, Q>;
    type Columns<'a> = Columns<'a, S, V, P, Q>;
    fn columns<'a>(
        displacement: &'a [Displacement<S>],
        data: Slices<'a, S, E::Vertices, E::Blocks, Q>,
        points: &'a OwnPoints,
    ) -> Columns<'a, S, V, P, Q> {
        columns::<E, S, V, P, Q>(displacement, data, E::own(points))
    }
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> KeptByMean<S, V>
    for Columns<'_, S, V, P, Q>
{
    fn nodes(&self) -> &[[u32; V]] {
        self.elements.nodes
    }
    fn clusters(&self) -> Option<&[ClusterIndex]> {
        None
    }
    fn share(&self, element: usize) -> [f64; 2] {
        let volume = self.rest[element].volume.iter().map(|v| v.to_f64()).sum();
        [volume, self.moduli[0][element].to_f64()]
    }
    fn changes(&self, measure: VolumeMeasure, workers: &Workers, first: usize, own: &mut [S]) {
        workers.dispatch(Changes { columns: self, measure, first, own });
    }
    fn areas(
        &self,
        measure: VolumeMeasure,
        workers: &Workers,
        first: usize,
        own: &mut [[[S; 3]; V]],
    ) {
        workers.dispatch(Areas { columns: self, measure, first, own });
    }
}

/// Means of `m` over the elements from `first` on.
struct Changes<'a, 'b, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    columns: &'a Columns<'b, S, V, P, Q>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [S],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> Kernel<S>
    for Changes<'_, '_, S, V, P, Q>
{
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let elements = &self.columns.elements;
        for (i, to) in (self.first..).zip(self.own) {
            let (rest, u) = (&self.columns.rest[i], elements.displacements(i));
            let mut slot = None;
            let derivatives = elements.derivatives(rest.own, &mut slot);
            let (mut volume, mut change) = (0.0, 0.0);
            for first in (0..Q).step_by(L::COUNT) {
                let own = load_weights::<L, Q>(&rest.volume, first);
                let u = point_differences::<L, 4, _, _, _>(derivatives, &u, first);
                let g = displacement_gradient(&rest.gradients::<L>(first), &u);
                volume += total(own).to_f64();
                change += total(own * self.measure.change(&g)).to_f64();
            }
            // a removed element has no volume
            *to = S::from_f64(if volume > 0.0 { change / volume } else { 0.0 });
        }
    }
}

/// `sum_q v_q dm/dF_q D_qa` of the elements from `first` on.
struct Areas<'a, 'b, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    columns: &'a Columns<'b, S, V, P, Q>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [[[S; 3]; V]],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> Kernel<S>
    for Areas<'_, '_, S, V, P, Q>
{
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let elements = &self.columns.elements;
        for (i, to) in (self.first..).zip(self.own) {
            let (rest, u) = (&self.columns.rest[i], elements.displacements(i));
            let mut slot = None;
            let derivatives = elements.derivatives(rest.own, &mut slot);
            let mut sum = [[L::ZERO; 3]; V];
            for first in (0..Q).step_by(L::COUNT) {
                let own = load_weights::<L, Q>(&rest.volume, first);
                let gradients = rest.gradients::<L>(first);
                let u = point_differences::<L, 4, _, _, _>(derivatives, &u, first);
                let slope = self.measure.slope(&displacement_gradient(&gradients, &u));
                let d = gradients.map(|d| mat_vec(&slope, d).map(|x| own * x));
                for a in 0..V {
                    for j in 0..3 {
                        let share: L = load_points(&derivatives.0[a][j], first);
                        for x in 0..3 {
                            sum[a][x] = share.mul_add(d[j][x], sum[a][x]);
                        }
                    }
                }
            }
            *to = sum.map(|row| row.map(total));
        }
    }
}

pub(super) fn evaluate_law<
    L: TetrahedronLaw,
    E: Shape<V, P, Q>,
    S: Scalar,
    const V: usize,
    const P: usize,
    const Q: usize,
>(
    columns: &Columns<S, V, P, Q>,
    request: &EvaluationRequest,
    workers: &Workers,
    by_mean: bool,
    span: &mut Span<S>,
) {
    let of_stress = L::STRESS_PROJECTION && request.tangent == Some(TangentKind::Projected);
    let tangent = if of_stress { None } else { request.tangent };
    let law = OfLaw::<L, E, S, V, P, Q> { columns, by_mean, law: PhantomData };
    evaluate_span(&GaussColumns(&law), &EvaluationRequest { tangent, ..*request }, workers, span);
    if of_stress {
        span.clear_tangent();
        workers.dispatch(ProjectedPass { columns, derivatives: &E::derivatives(), span });
    }
}

/// Projected tangents of the laws whose stress is that of St Venant-Kirchhoff with the compression term,
/// in `f64` whatever the simulation's type.
struct ProjectedPass<'a, 'b, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    columns: &'a Columns<'b, S, V, P, Q>,
    derivatives: &'a Derivatives<f64, V, 3, Q>,
    span: &'a mut Span<S>,
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> Kernel<f64>
    for ProjectedPass<'_, '_, S, V, P, Q>
{
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = f64>>(self) {
        let Self { columns, derivatives: of_all, span } = self;
        for i in span.elements.clone() {
            let rest = columns.rest[i].in_f64();
            let mut slot = None;
            let derivatives = derivatives_of(of_all, columns.elements.own, rest.own, &mut slot);
            let moduli = columns.moduli(i).map(S::to_f64);
            let narrow = columns.elements.displacements(i);
            let mut u = [[0.0; 3]; V];
            for a in 0..V {
                for x in 0..3 {
                    u[a][x] = narrow[a][x].to_f64();
                }
            }
            let mut all = PointTangents::ZERO;
            let mut any = false;
            for first in (0..Q).step_by(L::COUNT) {
                let (e, u) = points::<L, V, Q>(true, derivatives, &rest, moduli, &u, first);
                let g = displacement_gradient(&e.gradients, &u);
                let (clamped, core) = projection::projected_blocks(&e, &g);
                any |= L::any(clamped);
                let inner = match core {
                    Some(core) => tetrahedron::assemble(&core),
                    None => tetrahedron::tangent_parts(&e, &u, true, true),
                };
                all.store(&inner_blocks(&inner), first);
            }
            span.clamped += u64::from(any);
            let (nodes, blocks) = (&columns.elements.nodes[i], &columns.elements.blocks[i]);
            let span = &mut *span;
            L::apart(Assemble { inner: &all, derivatives, span, nodes, blocks });
        }
    }
}

/// Takes the volume terms of the points of an element as that of its mean: their energies then add up to its own.
pub(crate) fn by_mean(points: &mut [(Element<f64>, [[f64; 3]; 4])], measure: VolumeMeasure) {
    let change =
        |(e, u): &(Element<f64>, _)| measure.change(&displacement_gradient(&e.gradients, u));
    let volume: f64 = points.iter().map(|(e, _)| e.volume).sum();
    let mean = points.iter().map(|point| point.0.volume * change(point)).sum::<f64>() / volume;
    for (e, _) in points {
        *e = held_by_mean(*e, 0.5 * e.lambda * mean);
    }
}

/// The tetrahedra that stand for the Gauss points of an element, whose volumes add up to its own, with
/// their displacements (m); moduli (Pa) lambda, mu and that of the compression term.
pub(crate) fn tetrahedra<const V: usize, const Q: usize>(
    derivatives: &Derivatives<f64, V, 3, Q>,
    rest: &PointsRest<f64, Q>,
    moduli: [f64; 3],
    u: &[[f64; 3]; V],
) -> [(Element<f64>, [[f64; 3]; 4]); Q] {
    std::array::from_fn(|q| {
        let u = point_differences::<f64, 4, _, _, _>(derivatives, u, q);
        (Element::plain(rest.gradients::<f64>(q), rest.volume[q], moduli), u)
    })
}
