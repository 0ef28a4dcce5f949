//! Laws on hexahedra with reduced integration: one evaluation for the mean deformation, and a quadratic energy of the
//! hourglass modes ([`crate::element::hourglass`]). Elements are the lanes of a register.
//!
//! The mean gradient stands for the displacement gradient of a tetrahedron with unit edges whose first vertex stays in place, as
//! at Gauss points ([`super::gauss`]), so every [`TetrahedronLaw`] serves. A law whose volume term acts by means has
//! the volume of that one gradient for its mean ([`super::means`]): `p = lambda (J - 1)`, `b_a = V cof F b_a`. No point is left
//! free by that, and nothing is added that holds points.
//!
//! A body that recovers from inversion has the corotational energy at the corners of its elements: they can be folded while the
//! mean deformation is sound.

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::element::displacement_gradient;
use sinew_engine::isoparametric::{
    Derivatives, HexahedronBlocks, HexahedronRest, HexahedronVertices, OwnPoints,
};
use sinew_engine::lanes::{Batch, Batches, Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffer, LawInfo, Span, TangentKind};
use sinew_engine::mesh::Filled;
use sinew_engine::scalar::{Calculation, Real, Scalar, Single, mat_vec};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;
use sinew_engine::workers::Workers;

use std::marker::PhantomData;

use super::columns::{LawColumns, TangentSum, add_vertices, evaluate_span, load_vertices, work};
use super::gauss::{AtPoints, GaussElements};
use super::hexahedra::{self, Brick, ByMean};
use super::law::{TangentAtPoint, TetrahedronLaw, inner_blocks};
use super::means::{self, KeptByMean, MeanLaw};
use super::moduli::{
    ClusterIndex, ClusterPressure, CompressionModulus, FirstLameParameter, PredictedPressure,
    Pressures, ShearModulus,
};
use super::part::spawn_reduced;
use super::row::{
    Activate, Elements, InRecovery, LawRow, Mark, Measure, PlacedLaw, activate_elements, mark,
};
use super::rules::VolumeMeasure;
use super::stand_in::Corotational;
use crate::element::hourglass::{self, ENTRIES, Modes, RestShape, Stiffness, Weights};
use crate::element::matrix::symmetrise;
use crate::element::projection;
use crate::element::tetrahedron::{self, Element, Nodes};
use crate::material::LameParameters;

/// Law `L` on hexahedra with reduced integration.
#[derive(Clone, Copy, Debug)]
pub struct Reduced<L>(PhantomData<fn() -> L>);

/// Rows of [`HexahedronShape`]: the weights, the volume, and what fills up the last row.
const SHAPE: usize = 15;
/// Place of the volume among the numbers.
const VOLUME: usize = 56;
/// Rows of [`HourglassStiffness`]: the entries, and what fills up the last row.
const STIFFNESS: usize = 23;

/// Numbers of an element in rows of four, as loads take them.
type Numbers<S, const N: usize> = [[S; 4]; N];

/// As such.
fn in_rows<S: Scalar, const N: usize>(numbers: &[f64]) -> Numbers<S, N> {
    let mut rows = [[S::ZERO; 4]; N];
    for (to, &from) in rows.as_flattened_mut().iter_mut().zip(numbers) {
        *to = S::from_f64(from);
    }
    rows
}

/// Rest shape of a hexahedron with reduced integration: its [`Weights`] row by row, then its volume (m^3); zero once it is
/// removed.
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick, clone_behavior = Ignore)]
#[repr(transparent)]
pub struct HexahedronShape<S: Scalar>(pub [[S; 4]; SHAPE]);

impl<S: Scalar> HexahedronShape<S> {
    /// From the same in `f64`.
    pub(crate) fn new(rest: &RestShape) -> Self {
        let mut all = [rest.volume; VOLUME + 1];
        all[..VOLUME].copy_from_slice(rest.weights.as_flattened());
        Self(in_rows(&all))
    }
}

/// Stiffness of the hourglass modes of a hexahedron with reduced integration (N/m), the entries of [`Stiffness`]; zero once it
/// is removed.
#[derive(Component, Clone, Copy, Debug, PartialEq, TransparentWrapper)]
#[component(summary_tick, clone_behavior = Ignore)]
#[repr(transparent)]
pub struct HourglassStiffness<S: Scalar>(pub [[S; 4]; STIFFNESS]);

impl<S: Scalar> HourglassStiffness<S> {
    /// Of a hexahedron with these corners (m) and this material.
    pub(crate) fn new(points: &[[f64; 3]; 8], lame: LameParameters, filled: &Filled) -> Self {
        Self(in_rows(&Stiffness::new(points, lame, filled).0))
    }
}

impl LawRow {
    /// Law `L` of tetrahedra on hexahedra with reduced integration, under another name.
    pub const fn hexahedra_reduced<L: TetrahedronLaw>(name: &'static str) -> Self {
        let activate: [Activate; 2] = [activate::<L, f64>, activate::<L, Single>];
        let mark: [Mark; 2] = [mark::<AtPoints<Reduced<L>, 8>>; 2];
        Self {
            spawn: Some([
                spawn_reduced::<AtPoints<Reduced<L>, 8>, f64>,
                spawn_reduced::<AtPoints<Reduced<L>, 8>, Single>,
            ]),
            ..Self::reduced::<L>(name, mark, activate)
        }
    }

    /// The same with its volume term as a mean; `measure` as for clusters.
    pub const fn hexahedra_reduced_by_mean<L: TetrahedronLaw>(
        name: &'static str,
        measure: &'static str,
    ) -> Self {
        let activate: [Activate; 2] = [activate_by_mean::<L, f64>, activate_by_mean::<L, Single>];
        let mark: [Mark; 2] = [mark::<AtPoints<Reduced<ByMean<L>>, 8>>; 2];
        Self {
            measure: Measure::of::<L>(measure),
            spawn: Some([
                spawn_reduced::<(AtPoints<Reduced<ByMean<L>>, 8>, Pressures<f64>), f64>,
                spawn_reduced::<(AtPoints<Reduced<ByMean<L>>, 8>, Pressures<Single>), Single>,
            ]),
            ..Self::reduced::<L>(name, mark, activate)
        }
    }

    const fn reduced<L: TetrahedronLaw>(
        name: &'static str,
        mark: [Mark; 2],
        activate: [Activate; 2],
    ) -> Self {
        Self {
            tangent: L::contributes,
            recovery: InRecovery::StandIn,
            energy: Some(|e, u| L::energy(e, u)),
            hourglass: Some(|k, modes| {
                let alone = modes.hourglass_alone();
                hourglass::energy(k, if L::IS_OBJECTIVE { modes } else { &alone })
            }),
            holds_pressure: L::HOLDS_PRESSURE,
            softens: L::SOFTENS,
            ..Self::of_systems(LawInfo::elastic(name), Elements::ReducedHexahedra, mark, activate)
        }
    }
}

/// Query data of elements.
type Data<S> = (
    (&'static HexahedronVertices, &'static HexahedronBlocks),
    (&'static HexahedronShape<S>, &'static HourglassStiffness<S>, &'static HexahedronRest<S>),
    &'static FirstLameParameter<S>,
    &'static ShearModulus<S>,
    &'static CompressionModulus<S>,
);

/// Slices of [`Data`].
type Slices<'a, S> = <Data<S> as ContiguousQueryData>::Contiguous<'a, 'a>;

/// Columns of elements, as slices.
#[derive(Clone, Copy)]
pub(crate) struct Columns<'a, S: Scalar> {
    /// Displacement of every vertex row (m).
    displacement: &'a [[S; 4]],
    nodes: &'a [[u32; 8]],
    blocks: &'a [[u32; 28]],
    shape: &'a [Numbers<S, SHAPE>],
    stiffness: &'a [Numbers<S, STIFFNESS>],
    /// Rest shape at the corners.
    corners: &'a [HexahedronRest<S>],
    /// lambda, mu and that of the compression term (Pa).
    moduli: [&'a [S]; 3],
    /// Pressures (Pa) for forces and for tangents, where elements keep means of their volumes; otherwise empty.
    pressures: [&'a [S]; 2],
}

impl<'a, S: Scalar> Columns<'a, S> {
    fn new(
        displacement: &'a [Displacement<S>],
        ((nodes, blocks), (shape, stiffness, corners), lambda, mu, compression): Slices<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: HexahedronVertices::peel_slice(nodes),
            blocks: HexahedronBlocks::peel_slice(blocks),
            shape: HexahedronShape::peel_slice(shape),
            stiffness: HourglassStiffness::peel_slice(stiffness),
            corners,
            moduli: [
                FirstLameParameter::peel_slice(lambda),
                ShearModulus::peel_slice(mu),
                CompressionModulus::peel_slice(compression),
            ],
            pressures: [&[], &[]],
        }
    }
}

/// Numbers of the elements from `first` on, of which each has an array: three at a time, as rows of vertices are loaded.
#[inline(always)]
fn load_numbers<L: Lanes, const M: usize, const T: usize>(
    arrays: &[Numbers<L::Scalar, M>],
    first: usize,
) -> [[L; 3]; T] {
    const { assert!(3 * T < 4 * M) };
    let arrays = arrays[first..first + L::COUNT].as_flattened().as_flattened();
    let mut of = [[0; 1]; MAX_LANES];
    for (lane, of) in of.iter_mut().enumerate() {
        of[0] = (lane * M) as u32;
    }
    let mut numbers = [[L::ZERO; 3]; T];
    for i in 0..T {
        numbers[i] = L::load_rows(arrays[3 * i..].as_chunks::<4>().0, &of, 0);
    }
    numbers
}

/// Weights and volume of the elements from `first` on.
#[inline(always)]
fn load_shape<L: Lanes>(shape: &[Numbers<L::Scalar, SHAPE>], first: usize) -> (Weights<L>, L) {
    let numbers = load_numbers::<L, SHAPE, 19>(shape, first);
    let numbers = numbers.as_flattened();
    let mut weights = [[L::ZERO; 8]; 7];
    for i in 0..7 {
        weights[i].copy_from_slice(&numbers[8 * i..8 * i + 8]);
    }
    (weights, numbers[VOLUME])
}

/// Stiffness of the elements from `first` on.
#[inline(always)]
fn load_stiffness<L: Lanes>(
    stiffness: &[Numbers<L::Scalar, STIFFNESS>],
    first: usize,
) -> Stiffness<L> {
    let numbers = load_numbers::<L, STIFFNESS, 30>(stiffness, first);
    let mut entries = [L::ZERO; ENTRIES];
    entries.copy_from_slice(&numbers.as_flattened()[..ENTRIES]);
    Stiffness(entries)
}

/// Elements of a register.
struct Loaded<L> {
    weights: Weights<L>,
    modes: Modes<L>,
    /// What stands for their mean deformation.
    element: Element<L>,
    /// Displacements (m) of that.
    u: Nodes<L>,
}

impl<L: Real> Loaded<L> {
    /// From displacements (m), weights, volume (m^3) and moduli lambda, mu, that of the compression term, and, where the volume
    /// is kept as a mean, the pressure (Pa).
    #[inline(always)]
    fn new(
        folds_volume: bool,
        is_objective: bool,
        u: &[[L; 3]; 8],
        (weights, volume): (Weights<L>, L),
        [lambda, mu, compression]: [L; 3],
        pressure: Option<L>,
    ) -> Self {
        let modes = Modes::new(&weights, u);
        let (folded, volume) = if folds_volume { (volume, L::ONE) } else { (L::ONE, volume) };
        let moduli = [lambda * folded, mu * folded, compression * folded];
        let (o, one) = (L::ZERO, L::ONE);
        let unit = [[one, o, o], [o, one, o], [o, o, one]];
        let mut element = Element::plain(unit, volume, moduli);
        if let Some(pressure) = pressure {
            (element.lambda, element.pressure) = (L::ZERO, pressure * folded);
        }
        let [a, b, c] = modes.affine;
        let modes = if is_objective { modes } else { modes.hourglass_alone() };
        Self { weights, modes, element, u: [[L::ZERO; 3], a, b, c] }
    }
}

/// Elements of a register from `first` on, loaded: long, and the same for every law but for what is told here.
struct Load<'a, 'b, S: Scalar> {
    columns: &'a Columns<'b, S>,
    first: usize,
    /// The pressures for forces (0) or tangents (1), where the volume term is that of a mean.
    pressures: Option<usize>,
    folds_volume: bool,
    is_objective: bool,
}

impl<L: Lanes> Calculation<L> for Load<'_, '_, L::Scalar> {
    type Output = Loaded<L>;
    #[inline(always)]
    fn run(self) -> Loaded<L> {
        let Self { columns, first, .. } = self;
        let u = load_vertices::<L, 8>(columns.displacement, &columns.nodes[first..]);
        let [lambda, mu, compression] = columns.moduli;
        let moduli =
            [L::load(&lambda[first..]), L::load(&mu[first..]), L::load(&compression[first..])];
        let pressure = match self.pressures {
            Some(which) => Some(L::load(&columns.pressures[which][first..])),
            None => None,
        };
        let shape = load_shape(columns.shape, first);
        Loaded::new(self.folds_volume, self.is_objective, &u, shape, moduli, pressure)
    }
}

/// Elements that follow law `Law`. Whether its volume term is a mean is told at run time, so that kernels are there once for
/// both.
struct OfLaw<'a, 'b, Law, S: Scalar> {
    columns: &'a Columns<'b, S>,
    law: PhantomData<fn() -> Law>,
}

impl<Law: TetrahedronLaw, S: Scalar> OfLaw<'_, '_, Law, S> {
    /// The elements from `first` on with the pressures for forces (0) or tangents (1).
    #[inline(always)]
    fn load<L: Lanes<Scalar = S>>(&self, first: usize, which: usize) -> Loaded<L> {
        let columns = self.columns;
        let by_mean = Law::VOLUME.is_some() && !columns.pressures[which].is_empty();
        L::apart(Load {
            columns,
            first,
            pressures: by_mean.then_some(which),
            folds_volume: Law::FOLDS_VOLUME,
            is_objective: Law::IS_OBJECTIVE,
        })
    }
}

impl<Law: TetrahedronLaw, S: Scalar> LawColumns<S> for OfLaw<'_, '_, Law, S> {
    // kernels for AVX-512 are for what was measured to gain by them
    const WIDE: bool = false;

    #[inline(always)]
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]) {
        let mut own = self.load::<L>(first, 0);
        // V lambda/2 m^2 = V p/2 (J - 1)
        own.element.pressure *= L::from_f64(0.5);
        let hourglass = L::apart(OfModes(self.columns.stiffness, first, &own.modes));
        (Law::energy(&own.element, &own.u) + hourglass).accumulate(sums);
    }

    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, first: usize, force: &mut [[S; 4]], row: usize) {
        let own = self.load::<L>(first, 0);
        let mut of_law = [[L::ZERO; 3]; 3];
        if let Some([_, a, b, c]) = Law::forces(&own.element, &own.u) {
            of_law = [a, b, c];
        }
        let forces = L::apart(Forces {
            of_law: &of_law,
            weights: &own.weights,
            modes: OfModes(self.columns.stiffness, first, &own.modes),
            turns: Law::IS_OBJECTIVE,
        });
        add_vertices(forces, force, row, &self.columns.nodes[first..]);
    }

    #[inline(always)]
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>) {
        let own = self.load::<L>(first, 1);
        if to.kind == TangentKind::Projected {
            let acts = L::less(L::ZERO, own.element.volume * own.element.mu);
            to.count_clamped::<L>(L::both(acts, Law::is_clamped(&own.element, &own.u)));
        }
        let inner = L::apart(TangentAtPoint::<Law, L>::new(&own.element, &own.u, to.kind));
        // in a frame that stays the modes are not coupled with the mean deformation
        let modes = if Law::IS_OBJECTIVE { own.modes } else { Modes::NONE };
        L::apart(Assemble {
            inner: &inner,
            weights: &own.weights,
            modes: &modes,
            stiffness: &self.columns.stiffness[first..],
            exact: Law::IS_OBJECTIVE && to.kind == TangentKind::Exact,
            span: &mut *to.span,
            nodes: &self.columns.nodes[first..first + L::COUNT],
            blocks: &self.columns.blocks[first..first + L::COUNT],
        });
    }
}

/// Energy (J) of the hourglass modes of the elements from some place on; like forces and tangents of modes the same for every law.
struct OfModes<'a, L: Lanes>(&'a [Numbers<L::Scalar, STIFFNESS>], usize, &'a Modes<L>);

impl<L: Lanes> Calculation<L> for OfModes<'_, L> {
    type Output = L;
    #[inline(always)]
    fn run(self) -> L {
        hourglass::energy(&load_stiffness(self.0, self.1), self.2)
    }
}

/// Forces (N) on the vertices.
struct Forces<'a, L: Lanes> {
    /// Minus the derivatives of the energy of the law by the columns of `F` (J).
    of_law: &'a [[L; 3]; 3],
    weights: &'a Weights<L>,
    modes: OfModes<'a, L>,
    /// Whether the frame of the modes is that of `F`.
    turns: bool,
}

impl<L: Lanes> Calculation<L> for Forces<'_, L> {
    type Output = [[L; 3]; 8];
    #[inline(always)]
    fn run(self) -> [[L; 3]; 8] {
        let Self { of_law, weights, modes: OfModes(stiffness, first, modes), turns } = self;
        let mut slopes = hourglass::slopes(&load_stiffness(stiffness, first), modes);
        for i in 0..3 {
            for x in 0..3 {
                let own = if turns { slopes[i][x] } else { L::ZERO };
                slopes[i][x] = own - of_law[i][x];
            }
        }
        hourglass::forces(weights, &slopes)
    }
}

/// Adds the tangents of a register of elements to a range: the larger part of the work and of the code, and the same for every
/// law. The register may be of another precision than the range.
struct Assemble<'a, L: Lanes, S: Scalar> {
    /// Second derivatives of the energy of the law by the columns of `F` (J).
    inner: &'a [[[L; 9]; 3]; 3],
    weights: &'a Weights<L>,
    modes: &'a Modes<L>,
    stiffness: &'a [Numbers<L::Scalar, STIFFNESS>],
    exact: bool,
    span: &'a mut Span<S>,
    /// Of the elements; those of lanes beyond their number are left out.
    nodes: &'a [[u32; 8]],
    blocks: &'a [[u32; 28]],
}

impl<L: Lanes, S: Scalar> Calculation<L> for Assemble<'_, L, S> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { inner, weights, modes, stiffness, exact, span, nodes, blocks } = self;
        let stiffness = load_stiffness(stiffness, 0);
        let second = hourglass::second_derivatives(&stiffness, modes, inner, exact);
        let mut pair = 0;
        for a in 0..8 {
            // what moving vertex a does to the columns and modes
            let mut column = [[L::ZERO; 9]; 7];
            for i in 0..7 {
                for j in 0..7 {
                    for k in 0..9 {
                        column[j][k] = weights[i][a].mul_add(second[i][j][k], column[j][k]);
                    }
                }
            }
            for b in a..8 {
                let mut block = [L::ZERO; 9];
                for j in 0..7 {
                    for k in 0..9 {
                        block[k] = column[j][k].mul_add(weights[j][b], block[k]);
                    }
                }
                if a == b {
                    symmetrise(&mut block);
                }
                let mut values = [[L::Scalar::ZERO; MAX_LANES]; 9];
                for k in 0..9 {
                    block[k].store(&mut values[k]);
                }
                for (lane, (nodes, blocks)) in nodes.iter().zip(blocks).enumerate() {
                    let mut own = [S::ZERO; 9];
                    for k in 0..9 {
                        own[k] = S::from_f64(values[k][lane].to_f64());
                    }
                    if a == b {
                        span.add_diagonal(nodes[a], &own);
                    } else {
                        span.add_off_diagonal(blocks[pair], nodes[a], nodes[b], &own);
                    }
                }
                pair += usize::from(a != b);
            }
        }
    }
}

/// Puts `L` into the force schedule.
fn activate<L: TetrahedronLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    activate_elements::<HexahedronVertices, S, Data<S>>(world, law, |with, u, data, buffer| {
        evaluate::<L, S>(with, &Columns::new(u, data), buffer);
    });
}

/// The same with its volume term as a mean.
fn activate_by_mean<L: TetrahedronLaw, S: Scalar>(world: &mut World, law: PlacedLaw) {
    const { assert!(L::VOLUME.is_some()) };
    type Read<S> = (&'static ClusterPressure<S>, &'static PredictedPressure<S>);
    activate_elements::<HexahedronVertices, S, (Data<S>, Read<S>)>(
        world,
        law,
        |with, u, (data, (pressure, predicted)), buffer| {
            let pressure = ClusterPressure::peel_slice(pressure);
            let pressures = [pressure, PredictedPressure::peel_slice(predicted)];
            evaluate::<L, S>(with, &Columns { pressures, ..Columns::new(u, data) }, buffer);
        },
    );
    means::activate::<Reduced<L>, S, 8>(world, law);
}

#[inline(never)]
fn evaluate<L: TetrahedronLaw, S: Scalar>(
    Evaluation { request, workers, recovering, .. }: Evaluation,
    columns: &Columns<'_, S>,
    buffer: &mut LawBuffer<S>,
) {
    let work = columns.nodes.len() * work(request, [60, 80, 600]);
    let Columns { displacement, nodes, blocks, moduli, .. } = *columns;
    let derivatives = Derivatives::hexahedron_corners();
    let at_corners = hexahedra::Columns {
        elements: GaussElements { displacement, nodes, blocks, derivatives, own: &[] },
        rest: columns.corners,
        moduli,
        pressures: [&[], &[]],
    };
    buffer.for_each_awake(workers, work, |_, span| {
        if recovering.contains(span.body) {
            hexahedra::evaluate_law::<Corotational, Brick, S, 8, 28, 8>(
                &at_corners,
                request,
                workers,
                false,
                span,
            );
        } else {
            evaluate_law::<L, S>(columns, request, workers, span);
        }
    });
}

fn evaluate_law<L: TetrahedronLaw, S: Scalar>(
    columns: &Columns<S>,
    request: &EvaluationRequest,
    workers: &Workers,
    span: &mut Span<S>,
) {
    let of_stress = L::STRESS_PROJECTION && request.tangent == Some(TangentKind::Projected);
    let tangent = if of_stress { None } else { request.tangent };
    let law = OfLaw::<L, S> { columns, law: PhantomData };
    evaluate_span(&law, &EvaluationRequest { tangent, ..*request }, workers, span);
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
        let mut first = span.elements.start;
        while first < span.elements.end {
            let end = span.elements.end.min(first + L::COUNT);
            projected_batch::<S, L>(columns, span, first, end);
            first = end;
        }
    }
}

/// Adds the projected tangents of these elements, at most as many as there are lanes.
#[inline(always)]
fn projected_batch<S: Scalar, L: Lanes<Scalar = f64>>(
    columns: &Columns<S>,
    span: &mut Span<S>,
    first: usize,
    end: usize,
) {
    let mut shape = [[[0.0; 4]; SHAPE]; MAX_LANES];
    let mut stiffness = [[[0.0; 4]; STIFFNESS]; MAX_LANES];
    let mut displacements = [[[0.0; MAX_LANES]; 3]; 8];
    let mut moduli = [[0.0; MAX_LANES]; 3];
    for lane in 0..L::COUNT {
        // lanes beyond the last element repeat it
        let i = (first + lane).min(end - 1);
        shape[lane] = columns.shape[i].map(|row| row.map(S::to_f64));
        stiffness[lane] = columns.stiffness[i].map(|row| row.map(S::to_f64));
        for a in 0..8 {
            let row = columns.displacement[columns.nodes[i][a] as usize];
            for x in 0..3 {
                displacements[a][x][lane] = row[x].to_f64();
            }
        }
        for k in 0..3 {
            moduli[k][lane] = columns.moduli[k][i].to_f64();
        }
    }
    let mut u = [[L::ZERO; 3]; 8];
    for a in 0..8 {
        for x in 0..3 {
            u[a][x] = L::load(&displacements[a][x]);
        }
    }
    let moduli = [L::load(&moduli[0]), L::load(&moduli[1]), L::load(&moduli[2])];
    let own = Loaded::new(true, true, &u, load_shape(&shape, 0), moduli, None);
    let g = displacement_gradient(&own.element.gradients, &own.u);
    let (clamped, core) = projection::projected_blocks(&own.element, &g);
    let inner = inner_blocks(&match core {
        Some(core) => tetrahedron::assemble(&core),
        None => tetrahedron::tangent_parts(&own.element, &own.u, true, true),
    });
    if L::any(clamped) {
        let mut flags = [0.0; MAX_LANES];
        L::select(clamped, L::ONE, L::ZERO).store(&mut flags);
        for flag in &flags[..end - first] {
            span.clamped += u64::from(*flag != 0.0);
        }
    }
    L::apart(Assemble {
        inner: &inner,
        weights: &own.weights,
        modes: &own.modes,
        stiffness: &stiffness,
        exact: false,
        span,
        nodes: &columns.nodes[first..end],
        blocks: &columns.blocks[first..end],
    });
}

/// What stands for an element and its displacements (m), with its hourglass modes.
pub(crate) struct InF64 {
    /// What stands for its mean deformation, and displacements (m).
    pub point: (Element<f64>, Nodes<f64>),
    /// Stiffness of its modes.
    pub stiffness: Stiffness<f64>,
    /// Its modes.
    pub modes: Modes<f64>,
}

impl InF64 {
    /// Of an element with these displacements (m) and moduli (Pa), none for one whose integration is not reduced. With a measure the
    /// volume term is that of a mean, and its energies add up.
    pub fn new<S: Scalar>(
        element: EntityRef,
        u: &[[f64; 3]; 8],
        moduli: [f64; 3],
        mean: Option<VolumeMeasure>,
    ) -> Option<Self> {
        let shape = element.get::<HexahedronShape<S>>()?.0.map(|row| row.map(S::to_f64));
        let stiffness = element.get::<HourglassStiffness<S>>()?.0.map(|row| row.map(S::to_f64));
        let shape = load_shape(&[shape], 0);
        let modes = Modes::new(&shape.0, u);
        let change = |measure: VolumeMeasure| measure.change(&modes.gradient());
        let pressure = mean.map(|measure| 0.5 * moduli[0] * change(measure));
        let own = Loaded::new(false, true, u, shape, moduli, pressure);
        let stiffness = load_stiffness(&[stiffness], 0);
        Some(Self { point: (own.element, own.u), stiffness, modes })
    }
}

/// Law `L` with its volume term as a mean.
impl<L: TetrahedronLaw, S: Scalar> MeanLaw<S, 8> for Reduced<L> {
    type Mark = AtPoints<Reduced<ByMean<L>>, 8>;
    type Data = Data<S>;
    type Columns<'a> = Columns<'a, S>;
    fn columns<'a>(
        displacement: &'a [Displacement<S>],
        data: Slices<'a, S>,
        _: &'a OwnPoints,
    ) -> Columns<'a, S> {
        Columns::new(displacement, data)
    }
}

impl<S: Scalar> KeptByMean<S, 8> for Columns<'_, S> {
    fn nodes(&self) -> &[[u32; 8]] {
        self.nodes
    }
    fn clusters(&self) -> Option<&[ClusterIndex]> {
        None
    }
    fn share(&self, element: usize) -> [f64; 2] {
        [self.shape[element].as_flattened()[VOLUME].to_f64(), self.moduli[0][element].to_f64()]
    }
    fn changes(&self, measure: VolumeMeasure, workers: &Workers, first: usize, own: &mut [S]) {
        let elements = first..first + own.len();
        workers.dispatch(Batches(elements, Changes { columns: self, measure, first, own }));
    }
    fn areas(
        &self,
        measure: VolumeMeasure,
        workers: &Workers,
        first: usize,
        own: &mut [[[S; 3]; 8]],
    ) {
        let elements = first..first + own.len();
        workers.dispatch(Batches(elements, Areas { columns: self, measure, first, own }));
    }
}

/// `J - 1` or what else is measured.
struct Changes<'a, 'b, S: Scalar> {
    columns: &'a Columns<'b, S>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [S],
}

impl<S: Scalar> Batch<S> for Changes<'_, '_, S> {
    const WIDE: bool = false;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let columns = self.columns;
        let u = load_vertices::<L, 8>(columns.displacement, &columns.nodes[first..]);
        let (weights, _) = load_shape(columns.shape, first);
        let g = Modes::new(&weights, &u).gradient();
        self.measure.change(&g).store(&mut self.own[first - self.first..]);
    }
}

/// `V dm/dF b_a`.
struct Areas<'a, 'b, S: Scalar> {
    columns: &'a Columns<'b, S>,
    measure: VolumeMeasure,
    first: usize,
    own: &'a mut [[[S; 3]; 8]],
}

impl<S: Scalar> Batch<S> for Areas<'_, '_, S> {
    const WIDE: bool = false;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let columns = self.columns;
        let u = load_vertices::<L, 8>(columns.displacement, &columns.nodes[first..]);
        let (weights, volume) = load_shape(columns.shape, first);
        let slope = self.measure.slope(&Modes::new(&weights, &u).gradient());
        let mut values = [[[S::ZERO; MAX_LANES]; 3]; 8];
        for a in 0..8 {
            let area = mat_vec(&slope, [weights[0][a], weights[1][a], weights[2][a]]);
            for x in 0..3 {
                (volume * area[x]).store(&mut values[a][x]);
            }
        }
        let to = &mut self.own[first - self.first..][..L::COUNT];
        for (lane, to) in to.iter_mut().enumerate() {
            for a in 0..8 {
                for x in 0..3 {
                    to[a][x] = values[a][x][lane];
                }
            }
        }
    }
}
