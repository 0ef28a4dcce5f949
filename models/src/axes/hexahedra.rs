//! Axes in hexahedra: the energies of [`super::element`] at the 2x2x2 Gauss points, each of which deforms as
//! a tetrahedron ([`sinew_engine::isoparametric`]), so that axes resist whatever bends the element and
//! three of them with their angles and volume equal a material there too.
//!
//! Bourguignon & Cani 2000, section 4, has one set of springs through the barycentre instead, which leaves
//! 18 motions of an element without resistance, radial springs 10 to 11; that is
//! [`printed`](super::printed).
//!
//! An entity has the columns of an axis in a tetrahedron, moduli times the volume of the whole element, and a
//! [`HexahedronRest`] whose volumes are the shares of the points in it.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew_engine::isoparametric::{
    AxisHexahedronBlocks, AxisHexahedronVertices, Derivatives, HexahedronRest, RestHexahedron,
    hexahedron_differences, load_points, load_weights, rows_of,
};
use sinew_engine::lanes::{Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{LawBuffer, LawInfo, Span, TangentKind};
use sinew_engine::scalar::{Scalar, dot};
use sinew_engine::schedule::{ElementLaw, Evaluation, activate_law};
use sinew_engine::vertex::Displacement;

use super::columns::*;
use super::element::{AxisElement, Fibre, Triad, VolumeTerm};
use crate::frame::hexahedra::{Blocks, total};
use crate::laws::{Elements, LawRow, mark, partition};

/// Rest shape of a hexahedron in `f64`, with shares of the volume in place of volumes.
pub(crate) fn shares(rest: &RestHexahedron) -> RestHexahedron {
    let whole = rest.total_volume();
    RestHexahedron { gradients: rest.gradients, volume: rest.volume.map(|v| v / whole) }
}

/// Derivative (1/m) of the stretched axis `axis` at Gauss point `q` by the displacements of the vertices.
pub(crate) fn shape_of(
    derivatives: &Derivatives<f64, 8, 3>,
    rest: &RestHexahedron,
    q: usize,
    axis: DVec3,
) -> [f64; 8] {
    let along = rest.gradients[q].map(|d| DVec3::from_array(d).dot(axis));
    std::array::from_fn(|a| (0..3).map(|j| derivatives.0[a][j][q] * along[j]).sum())
}

/// Triads of axes in hexahedra, with their angles and the term of volume.
pub static TRIADS: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<AxisAngleStiffness<f64, 0>>, mark::<AxisAngleStiffness<f32, 0>>],
    [triads::<f64>, triads::<f32>],
);
/// Single fibres in hexahedra, passive and active.
pub static FIBRES: LawRow = LawRow::of_systems(
    LawInfo::elastic("fibres in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<FibreActive<f64>>, mark::<FibreActive<f32>>],
    [fibres::<f64>, fibres::<f32>],
);
/// The term of volume of hexahedra without axes.
pub static VOLUMES: LawRow = LawRow::of_systems(
    LawInfo::elastic("volume preservation of hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<VolumeAlone>; 2],
    [volumes::<f64>, volumes::<f32>],
);

/// What all tables of axes in hexahedra have.
#[derive(Clone, Copy)]
pub(crate) struct Shared<'a, S: Scalar> {
    displacement: &'a [[S; 4]],
    nodes: &'a [[u32; 8]],
    blocks: &'a [[u32; 28]],
    rest: &'a [HexahedronRest<S>],
}

/// Query data of vertex rows, tangent blocks and rest shapes, with shares of the points in place of volumes.
pub type SharedData<S> =
    (&'static AxisHexahedronVertices, &'static AxisHexahedronBlocks, &'static HexahedronRest<S>);

/// Slices of [`SharedData`].
type SharedSlices<'a, S> =
    (&'a [AxisHexahedronVertices], &'a [AxisHexahedronBlocks], &'a [HexahedronRest<S>]);

impl<'a, S: Scalar> Shared<'a, S> {
    fn new(
        displacement: &'a [Displacement<S>],
        (nodes, blocks, rest): SharedSlices<'a, S>,
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: AxisHexahedronVertices::peel_slice(nodes),
            blocks: AxisHexahedronBlocks::peel_slice(blocks),
            rest,
        }
    }
}

/// Columns of one table, as slices.
pub(crate) trait HexahedronColumns<S: Scalar>: Copy + Send + Sync {
    /// Elements at Gauss points.
    type Element<L: Lanes<Scalar = S>>: AxisElement<L>;
    /// What all tables have.
    fn shared(&self) -> &Shared<'_, S>;
    /// The Gauss points from `first` on of entity `i`, whose shares of the volume are `share`.
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Self::Element<L>;
}

/// Query data of triads.
pub type TriadData<S> = (
    SharedData<S>,
    (Direction<S, 0>, Direction<S, 1>, Direction<S, 2>),
    (&'static AxialStiffness<S, 0>, &'static AxialStiffness<S, 1>, &'static AxialStiffness<S, 2>),
    (
        &'static AxisAngleStiffness<S, 0>,
        &'static AxisAngleStiffness<S, 1>,
        &'static AxisAngleStiffness<S, 2>,
    ),
    &'static VolumeStiffness<S>,
);

#[derive(Clone, Copy)]
struct TriadColumns<'a, S: Scalar> {
    shared: Shared<'a, S>,
    axes: (DirectionColumns<'a, S, 0>, DirectionColumns<'a, S, 1>, DirectionColumns<'a, S, 2>),
    axial: (&'a [AxialStiffness<S, 0>], &'a [AxialStiffness<S, 1>], &'a [AxialStiffness<S, 2>]),
    angular: (
        &'a [AxisAngleStiffness<S, 0>],
        &'a [AxisAngleStiffness<S, 1>],
        &'a [AxisAngleStiffness<S, 2>],
    ),
    volumetric: &'a [VolumeStiffness<S>],
}

impl<S: Scalar> HexahedronColumns<S> for TriadColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = Triad<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Triad<L> {
        let (a, b, c) = self.axes;
        let axes = [
            [a.0[i].0, a.1[i].0, a.2[i].0],
            [b.0[i].0, b.1[i].0, b.2[i].0],
            [c.0[i].0, c.1[i].0, c.2[i].0],
        ];
        let axial = [self.axial.0[i].0, self.axial.1[i].0, self.axial.2[i].0];
        let angular = [self.angular.0[i].0, self.angular.1[i].0, self.angular.2[i].0];
        let mut triad = Triad {
            gradients: self.shared.rest[i].gradients::<L>(first),
            axes: [[L::ZERO; 3]; 3],
            axial: [L::ZERO; 3],
            angular: [L::ZERO; 3],
            volumetric: L::splat(self.volumetric[i].0) * share,
        };
        for k in 0..3 {
            for x in 0..3 {
                triad.axes[k][x] = L::splat(axes[k][x]);
            }
            triad.axial[k] = L::splat(axial[k]) * share;
            triad.angular[k] = L::splat(angular[k]) * share;
        }
        triad
    }
}

/// Query data of fibres.
pub type FibreData<S> = (
    SharedData<S>,
    Direction<S, 0>,
    (
        &'static AxialStiffness<S, 0>,
        &'static FibreShortening<S>,
        &'static FibreActive<S>,
        &'static FibreOffset<S>,
        &'static FibreInverseWidth<S>,
    ),
);

#[derive(Clone, Copy)]
pub(crate) struct FibreColumns<'a, S: Scalar> {
    shared: Shared<'a, S>,
    axis: DirectionColumns<'a, S, 0>,
    stiffness: &'a [AxialStiffness<S, 0>],
    shortening: &'a [FibreShortening<S>],
    active: &'a [FibreActive<S>],
    offset: &'a [FibreOffset<S>],
    inverse_width: &'a [FibreInverseWidth<S>],
}

/// Slices of [`FibreData`].
type FibreSlices<'a, S> = (
    SharedSlices<'a, S>,
    DirectionColumns<'a, S, 0>,
    (
        &'a [AxialStiffness<S, 0>],
        &'a [FibreShortening<S>],
        &'a [FibreActive<S>],
        &'a [FibreOffset<S>],
        &'a [FibreInverseWidth<S>],
    ),
);

impl<'a, S: Scalar> FibreColumns<'a, S> {
    pub(crate) fn new(
        displacement: &'a [Displacement<S>],
        (shared, axis, (stiffness, shortening, active, offset, inverse_width)): FibreSlices<'a, S>,
    ) -> Self {
        let shared = Shared::new(displacement, shared);
        Self { shared, axis, stiffness, shortening, active, offset, inverse_width }
    }
}

impl<S: Scalar> HexahedronColumns<S> for FibreColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = Fibre<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Fibre<L> {
        let (x, y, z) = self.axis;
        let axis = [L::splat(x[i].0), L::splat(y[i].0), L::splat(z[i].0)];
        let [a, b, c] = self.shared.rest[i].gradients::<L>(first);
        Fibre {
            shape: [dot(a, axis), dot(b, axis), dot(c, axis)],
            axis,
            stiffness: L::splat(self.stiffness[i].0) * share,
            shortening: L::splat(self.shortening[i].0),
            active: L::splat(self.active[i].0) * share,
            offset: L::splat(self.offset[i].0),
            inverse_width: L::splat(self.inverse_width[i].0),
        }
    }
}

/// Query data of terms of volume; the filter is [`VolumeAlone`].
pub type VolumeData<S> = (SharedData<S>, &'static VolumeStiffness<S>);

#[derive(Clone, Copy)]
struct VolumeColumns<'a, S: Scalar> {
    shared: Shared<'a, S>,
    volumetric: &'a [VolumeStiffness<S>],
}

impl<S: Scalar> HexahedronColumns<S> for VolumeColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = VolumeTerm<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> VolumeTerm<L> {
        let gradients = self.shared.rest[i].gradients::<L>(first);
        VolumeTerm { gradients, volumetric: L::splat(self.volumetric[i].0) * share }
    }
}

fn triads<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, TriadData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisHexahedronVertices, S>,
        evaluate: |with, u, (shared, axes, axial, angular, volumetric), buffer| {
            let shared = Shared::new(u, shared);
            evaluate(&TriadColumns { shared, axes, axial, angular, volumetric }, with, buffer);
        },
    };
    activate_law(world, law);
}

fn fibres<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, FibreData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisHexahedronVertices, S>,
        evaluate: |with, u, data, buffer| evaluate(&FibreColumns::new(u, data), with, buffer),
    };
    activate_law(world, law);
}

fn volumes<S: Scalar>(world: &mut World, row: &'static LawRow, place: usize) {
    let law = ElementLaw::<S, VolumeData<S>> {
        info: row.info,
        place,
        mark: Some(row.mark::<S>(world)),
        partition: partition::<AxisHexahedronVertices, S>,
        evaluate: |with, u, (shared, volumetric), buffer| {
            let columns = VolumeColumns { shared: Shared::new(u, shared), volumetric };
            evaluate(&columns, with, buffer);
        },
    };
    activate_law(world, law);
}

/// Energy, force and tangent of every range into its private arrays, as far as they are asked for.
pub(crate) fn evaluate<S: Scalar, C: HexahedronColumns<S>>(
    columns: &C,
    Evaluation { request, workers, recovering }: Evaluation,
    buffer: &mut LawBuffer<S>,
) {
    let work = 300 * usize::from(request.energy)
        + 400 * usize::from(request.force)
        + 3000 * usize::from(request.tangent.is_some());
    let derivatives = &Derivatives::hexahedron();
    workers.for_each(&mut buffer.spans, columns.shared().nodes.len() * work, |_, span| {
        if recovering.contains(span.body) {
            span.silence();
            return;
        }
        let pass = Pass { columns, derivatives };
        if request.energy {
            span.energy = workers.dispatch(EnergyPass { pass, span });
        }
        if request.force {
            span.clear_force();
            workers.dispatch(ForcePass { pass, span });
        }
        match request.tangent {
            Some(kind) => {
                span.clear_tangent();
                workers.dispatch(TangentPass { pass, span, kind });
            }
            None => span.drop_tangent(),
        }
    });
}

/// What every pass reads.
struct Pass<'a, S: Scalar, C> {
    columns: &'a C,
    derivatives: &'a Derivatives<S, 8, 3>,
}

impl<S: Scalar, C> Clone for Pass<'_, S, C> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: Scalar, C> Copy for Pass<'_, S, C> {}

impl<S: Scalar, C: HexahedronColumns<S>> Pass<'_, S, C> {
    /// Gauss points from `first` on of entity `i`: elements, shares of the volume, displacements (m).
    #[inline(always)]
    fn points<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        first: usize,
    ) -> (C::Element<L>, L, [[L; 3]; 4]) {
        let shared = self.columns.shared();
        let u = rows_of(shared.displacement, &shared.nodes[i]);
        let u = hexahedron_differences::<L>(self.derivatives, &u, first);
        let share = load_weights::<L, 8>(&shared.rest[i].volume, first);
        (self.columns.element::<L>(i, first, share), share, u)
    }
}

struct EnergyPass<'a, 'b, S: Scalar, C> {
    pass: Pass<'a, S, C>,
    span: &'b Span<S>,
}

impl<S: Scalar, C: HexahedronColumns<S>> Kernel<S> for EnergyPass<'_, '_, S, C> {
    type Output = f64;
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> f64 {
        let mut sums = [0.0; MAX_LANES];
        for i in self.span.elements.clone() {
            for first in (0..8).step_by(L::COUNT) {
                let (element, _, u) = self.pass.points::<L>(i, first);
                element.energy(&u).accumulate(&mut sums);
            }
        }
        sums.iter().sum()
    }
}

struct ForcePass<'a, 'b, S: Scalar, C> {
    pass: Pass<'a, S, C>,
    span: &'b mut Span<S>,
}

impl<S: Scalar, C: HexahedronColumns<S>> Kernel<S> for ForcePass<'_, '_, S, C> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { pass, span } = self;
        for i in span.elements.clone() {
            let mut sum = [[L::ZERO; 3]; 8];
            for first in (0..8).step_by(L::COUNT) {
                let (element, _, u) = pass.points::<L>(i, first);
                let f = element.forces(&u);
                for a in 0..8 {
                    for j in 0..3 {
                        let d: L = load_points(&pass.derivatives.0[a][j], first);
                        for x in 0..3 {
                            sum[a][x] = d.mul_add(f[j + 1][x], sum[a][x]);
                        }
                    }
                }
            }
            let nodes = &pass.columns.shared().nodes[i];
            for a in 0..8 {
                let mut force = [S::ZERO; 3];
                for x in 0..3 {
                    force[x] = total(sum[a][x]);
                }
                span.add_force(nodes[a], force);
            }
        }
    }
}

struct TangentPass<'a, 'b, S: Scalar, C> {
    pass: Pass<'a, S, C>,
    span: &'b mut Span<S>,
    kind: TangentKind,
}

impl<S: Scalar, C: HexahedronColumns<S>> Kernel<S> for TangentPass<'_, '_, S, C> {
    type Output = ();
    const WIDE: bool = false;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) {
        let Self { pass, span, kind } = self;
        for i in span.elements.clone() {
            let mut sum = Blocks::<L>::ZERO;
            let mut clamped = false;
            for first in (0..8).step_by(L::COUNT) {
                let (element, share, u) = pass.points::<L>(i, first);
                if kind == TangentKind::Projected {
                    let acts = L::less(L::ZERO, share);
                    clamped |= L::any(L::both(acts, element.is_clamped(&u)));
                }
                sum.add(&element.tangent(&u, kind), pass.derivatives, first);
            }
            span.clamped += u64::from(clamped);
            let shared = pass.columns.shared();
            sum.write(span, &shared.nodes[i], &shared.blocks[i]);
        }
    }
}

/// Energy (J) of the axes of an entity in `f64`, from its columns as one element and its rest shape.
pub(crate) fn energy_at_points<E: AxisElement<f64>>(
    rest: &HexahedronRest<f64>,
    u: &[[f64; 3]; 8],
    element: impl Fn([[f64; 3]; 3], f64) -> E,
) -> f64 {
    let derivatives = &Derivatives::hexahedron();
    (0..8)
        .map(|q| {
            let u = hexahedron_differences::<f64>(derivatives, u, q);
            element(rest.gradients::<f64>(q), rest.volume[q]).energy(&u)
        })
        .sum()
}
