//! Axes in hexahedra and in ten-node tetrahedra: the energies of [`super::element`] at the Gauss points, each of which deforms
//! as a tetrahedron ([`sinew_engine::isoparametric`]), so that axes resist whatever bends the element and
//! three of them with their angles and volume equal a material there too.
//!
//! Bourguignon & Cani 2000, section 4, has one set of springs through the barycentre of a hexahedron instead, which leaves
//! 18 motions of an element without resistance, radial springs 10 to 11 (package `sinew-papers`).
//!
//! An entity has the columns of an axis in a tetrahedron, moduli times the volume of the whole element, and a
//! [`PointsRest`] whose volumes are the shares of the points in it.

use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use glam::DVec3;
use sinew_engine::isoparametric::{
    AxisHexahedronBlocks, AxisHexahedronVertices, AxisTetrahedron10Blocks,
    AxisTetrahedron10Vertices, Derivatives, OwnPoints, PointsRest, RestPoints, derivatives_of,
    load_weights, point_differences,
};
use sinew_engine::lanes::Lanes;
use sinew_engine::law::{LawBuffer, LawInfo, TangentKind};
use sinew_engine::scalar::{Scalar, Single, dot};
use sinew_engine::schedule::Evaluation;
use sinew_engine::vertex::Displacement;

use super::columns::*;
use super::element::{AxisElement, BiquadraticFibre, Fibre, Triad, VolumeTerm};
use super::site::AxisSite;
use crate::frame::columns::{self, work};
use crate::frame::gauss::{GaussColumns, GaussElements, GaussLaw};
use crate::frame::hexahedra::{Brick, Shape, TenNodes};
use crate::frame::law::inner_blocks;
use crate::frame::row::{Elements, LawRow, PlacedLaw, activate_elements, mark};

/// A kind of elements in which axes lie at points.
pub(crate) trait AxisShape<const V: usize, const P: usize, const Q: usize>:
    Shape<V, P, Q>
{
    /// Column of vertex rows of an axis.
    type AxisVertices: AxisSite<V> + TransparentWrapper<[u32; V]>;
    /// Column of its tangent blocks.
    type AxisBlocks: Component<Mutability = Mutable> + TransparentWrapper<[u32; P]>;
}

impl AxisShape<8, 28, 8> for Brick {
    type AxisVertices = AxisHexahedronVertices;
    type AxisBlocks = AxisHexahedronBlocks;
}

impl AxisShape<10, 45, 4> for TenNodes {
    type AxisVertices = AxisTetrahedron10Vertices;
    type AxisBlocks = AxisTetrahedron10Blocks;
}

/// Rest shape of an element in `f64`, with shares of the volume in place of volumes.
pub(crate) fn shares<const Q: usize>(rest: &RestPoints<Q>) -> RestPoints<Q> {
    let whole: f64 = rest.volume.iter().sum();
    RestPoints { gradients: rest.gradients, volume: rest.volume.map(|v| v / whole) }
}

/// Derivative (1/m) of the stretched axis `axis` at Gauss point `q` by the displacements of the vertices.
pub(crate) fn shape_of<const V: usize, const Q: usize>(
    derivatives: &Derivatives<f64, V, 3, Q>,
    rest: &RestPoints<Q>,
    q: usize,
    axis: DVec3,
) -> [f64; V] {
    let along = rest.gradients[q].map(|d| DVec3::from_array(d).dot(axis));
    std::array::from_fn(|a| (0..3).map(|j| derivatives.0[a][j][q] * along[j]).sum())
}

/// Triads of axes in hexahedra, with their angles and the term of volume.
pub static TRIADS: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<AxisAngleStiffness<f64, 0>>, mark::<AxisAngleStiffness<Single, 0>>],
    [triads::<f64, Brick, 8, 28, 8>, triads::<Single, Brick, 8, 28, 8>],
);
/// Single fibres in hexahedra, passive and active.
pub static FIBRES: LawRow = LawRow::of_systems(
    LawInfo::elastic("fibres in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<FibreActive<f64>>, mark::<FibreActive<Single>>],
    [fibres::<f64, Brick, 8, 28, 8>, fibres::<Single, Brick, 8, 28, 8>],
);
/// Biquadratic fibres in hexahedra.
pub static BIQUADRATIC: LawRow = LawRow::of_systems(
    LawInfo::elastic("biquadratic fibres in hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<Biquadratic>; 2],
    [biquadratic::<f64, Brick, 8, 28, 8>, biquadratic::<Single, Brick, 8, 28, 8>],
);
/// The term of volume of hexahedra without axes.
pub static VOLUMES: LawRow = LawRow::of_systems(
    LawInfo::elastic("volume preservation of hexahedra"),
    Elements::AxesInHexahedra,
    [mark::<VolumeAlone>; 2],
    [volumes::<f64, Brick, 8, 28, 8>, volumes::<Single, Brick, 8, 28, 8>],
);

/// Triads of axes in ten-node tetrahedra, likewise.
pub static TRIADS10: LawRow = LawRow::of_systems(
    LawInfo::elastic("axes in ten-node tetrahedra"),
    Elements::AxesInTetrahedra10,
    [mark::<AxisAngleStiffness<f64, 0>>, mark::<AxisAngleStiffness<Single, 0>>],
    [triads::<f64, TenNodes, 10, 45, 4>, triads::<Single, TenNodes, 10, 45, 4>],
);
/// Single fibres in ten-node tetrahedra, passive and active.
pub static FIBRES10: LawRow = LawRow::of_systems(
    LawInfo::elastic("fibres in ten-node tetrahedra"),
    Elements::AxesInTetrahedra10,
    [mark::<FibreActive<f64>>, mark::<FibreActive<Single>>],
    [fibres::<f64, TenNodes, 10, 45, 4>, fibres::<Single, TenNodes, 10, 45, 4>],
);
/// Biquadratic fibres in ten-node tetrahedra.
pub static BIQUADRATIC10: LawRow = LawRow::of_systems(
    LawInfo::elastic("biquadratic fibres in ten-node tetrahedra"),
    Elements::AxesInTetrahedra10,
    [mark::<Biquadratic>; 2],
    [biquadratic::<f64, TenNodes, 10, 45, 4>, biquadratic::<Single, TenNodes, 10, 45, 4>],
);
/// The term of volume of ten-node tetrahedra without axes.
pub static VOLUMES10: LawRow = LawRow::of_systems(
    LawInfo::elastic("volume preservation of ten-node tetrahedra"),
    Elements::AxesInTetrahedra10,
    [mark::<VolumeAlone>; 2],
    [volumes::<f64, TenNodes, 10, 45, 4>, volumes::<Single, TenNodes, 10, 45, 4>],
);

/// What all tables of axes at points have.
pub(crate) struct Shared<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    elements: GaussElements<'a, S, V, 3, P, Q>,
    rest: &'a [PointsRest<S, Q>],
}

/// Query data of vertex rows, tangent blocks and rest shapes, with shares of the points in place of volumes.
pub type SharedData<S, A, B, const Q: usize> = (&'static A, &'static B, &'static PointsRest<S, Q>);

impl<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> Shared<'a, S, V, P, Q> {
    fn new<E: AxisShape<V, P, Q>>(
        (displacement, points): (&'a [Displacement<S>], &'a OwnPoints),
        (nodes, blocks, rest): Slices<'a, SharedData<S, E::AxisVertices, E::AxisBlocks, Q>>,
    ) -> Self {
        let elements = GaussElements {
            displacement: Displacement::peel_slice(displacement),
            nodes: E::AxisVertices::peel_slice(nodes),
            blocks: E::AxisBlocks::peel_slice(blocks),
            derivatives: E::derivatives(),
            own: E::own(points),
        };
        Self { elements, rest }
    }
}

/// Columns of one table, as slices.
pub(crate) trait PointColumns<S: Scalar, const V: usize, const P: usize, const Q: usize>:
    Sync
{
    /// Elements at Gauss points.
    type Element<L: Lanes<Scalar = S>>: AxisElement<L>;
    /// What all tables have.
    fn shared(&self) -> &Shared<'_, S, V, P, Q>;
    /// The Gauss points from `first` on of entity `i`, whose shares of the volume are `share`.
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Self::Element<L>;
}

/// Query data of triads.
pub type TriadData<S, A, B, const Q: usize> = (
    SharedData<S, A, B, Q>,
    Directions<S>,
    AxialStiffnesses<S>,
    AngleStiffnesses<S>,
    &'static VolumeStiffness<S>,
);

struct TriadColumns<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    shared: Shared<'a, S, V, P, Q>,
    axes: [[&'a [S]; 3]; 3],
    axial: [&'a [S]; 3],
    angular: [&'a [S]; 3],
    volumetric: &'a [VolumeStiffness<S>],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> PointColumns<S, V, P, Q>
    for TriadColumns<'_, S, V, P, Q>
{
    type Element<L: Lanes<Scalar = S>> = Triad<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S, V, P, Q> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Triad<L> {
        let mut triad = Triad {
            gradients: self.shared.rest[i].gradients::<L>(first),
            axes: [[L::ZERO; 3]; 3],
            axial: [L::ZERO; 3],
            angular: [L::ZERO; 3],
            volumetric: L::splat(self.volumetric[i].0) * share,
        };
        for k in 0..3 {
            for x in 0..3 {
                triad.axes[k][x] = L::splat(self.axes[k][x][i]);
            }
            triad.axial[k] = L::splat(self.axial[k][i]) * share;
            triad.angular[k] = L::splat(self.angular[k][i]) * share;
        }
        triad
    }
}

/// Query data of fibres.
pub type FibreData<S, A, B, const Q: usize> =
    (SharedData<S, A, B, Q>, Direction<S, 0>, FibreConstants<S>);

pub(crate) struct FibreColumns<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    shared: Shared<'a, S, V, P, Q>,
    axis: DirectionColumns<'a, S, 0>,
    constants: Slices<'a, FibreConstants<S>>,
}

impl<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> FibreColumns<'a, S, V, P, Q> {
    pub(crate) fn new<E: AxisShape<V, P, Q>>(
        at: (&'a [Displacement<S>], &'a OwnPoints),
        (shared, axis, constants): Slices<'a, FibreData<S, E::AxisVertices, E::AxisBlocks, Q>>,
    ) -> Self {
        Self { shared: Shared::new::<E>(at, shared), axis, constants }
    }
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> PointColumns<S, V, P, Q>
    for FibreColumns<'_, S, V, P, Q>
{
    type Element<L: Lanes<Scalar = S>> = Fibre<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S, V, P, Q> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> Fibre<L> {
        let (x, y, z) = self.axis;
        let (stiffness, shortening, active, offset, inverse_width) = self.constants;
        let axis = [L::splat(x[i].0), L::splat(y[i].0), L::splat(z[i].0)];
        let [a, b, c] = self.shared.rest[i].gradients::<L>(first);
        Fibre {
            shape: [dot(a, axis), dot(b, axis), dot(c, axis)],
            axis,
            stiffness: L::splat(stiffness[i].0) * share,
            shortening: L::splat(shortening[i].0),
            active: L::splat(active[i].0) * share,
            offset: L::splat(offset[i].0),
            inverse_width: L::splat(inverse_width[i].0),
        }
    }
}

/// Query data of biquadratic fibres; the filter is [`Biquadratic`].
pub type BiquadraticData<S, A, B, const Q: usize> =
    (SharedData<S, A, B, Q>, Direction<S, 0>, &'static AxialStiffness<S, 0>);

struct BiquadraticColumns<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    shared: Shared<'a, S, V, P, Q>,
    axis: DirectionColumns<'a, S, 0>,
    stiffness: &'a [AxialStiffness<S, 0>],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> PointColumns<S, V, P, Q>
    for BiquadraticColumns<'_, S, V, P, Q>
{
    type Element<L: Lanes<Scalar = S>> = BiquadraticFibre<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S, V, P, Q> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        first: usize,
        share: L,
    ) -> BiquadraticFibre<L> {
        let (x, y, z) = self.axis;
        let axis = [L::splat(x[i].0), L::splat(y[i].0), L::splat(z[i].0)];
        let [a, b, c] = self.shared.rest[i].gradients::<L>(first);
        BiquadraticFibre {
            shape: [dot(a, axis), dot(b, axis), dot(c, axis)],
            axis,
            stiffness: L::splat(self.stiffness[i].0) * share,
        }
    }
}

/// Query data of terms of volume; the filter is [`VolumeAlone`].
pub type VolumeData<S, A, B, const Q: usize> =
    (SharedData<S, A, B, Q>, &'static VolumeStiffness<S>);

struct VolumeColumns<'a, S: Scalar, const V: usize, const P: usize, const Q: usize> {
    shared: Shared<'a, S, V, P, Q>,
    volumetric: &'a [VolumeStiffness<S>],
}

impl<S: Scalar, const V: usize, const P: usize, const Q: usize> PointColumns<S, V, P, Q>
    for VolumeColumns<'_, S, V, P, Q>
{
    type Element<L: Lanes<Scalar = S>> = VolumeTerm<L>;
    #[inline(always)]
    fn shared(&self) -> &Shared<'_, S, V, P, Q> {
        &self.shared
    }
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, i: usize, first: usize, share: L) -> VolumeTerm<L> {
        let gradients = self.shared.rest[i].gradients::<L>(first);
        VolumeTerm { gradients, volumetric: L::splat(self.volumetric[i].0) * share }
    }
}

fn triads<S: Scalar, E: AxisShape<V, P, Q>, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) {
    activate_elements::<E::AxisVertices, S, TriadData<S, E::AxisVertices, E::AxisBlocks, Q>>(
        world,
        law,
        |with, u, (shared, (a, b, c), axial, angular, volumetric), buffer| {
            let shared = Shared::new::<E>((u, with.points), shared);
            let axes = [direction_numbers(a), direction_numbers(b), direction_numbers(c)];
            let (axial, angular) = (axial_numbers(axial), angle_numbers(angular));
            evaluate(&TriadColumns { shared, axes, axial, angular, volumetric }, with, buffer);
        },
    );
}

fn fibres<S: Scalar, E: AxisShape<V, P, Q>, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) {
    activate_elements::<E::AxisVertices, S, FibreData<S, E::AxisVertices, E::AxisBlocks, Q>>(
        world,
        law,
        |with, u, data, buffer| {
            evaluate(&FibreColumns::new::<E>((u, with.points), data), with, buffer);
        },
    );
}

fn biquadratic<S: Scalar, E: AxisShape<V, P, Q>, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) {
    activate_elements::<E::AxisVertices, S, BiquadraticData<S, E::AxisVertices, E::AxisBlocks, Q>>(
        world,
        law,
        |with, u, (shared, axis, stiffness), buffer| {
            let shared = Shared::new::<E>((u, with.points), shared);
            evaluate(&BiquadraticColumns { shared, axis, stiffness }, with, buffer);
        },
    );
}

fn volumes<S: Scalar, E: AxisShape<V, P, Q>, const V: usize, const P: usize, const Q: usize>(
    world: &mut World,
    law: PlacedLaw,
) {
    activate_elements::<E::AxisVertices, S, VolumeData<S, E::AxisVertices, E::AxisBlocks, Q>>(
        world,
        law,
        |with, u, (shared, volumetric), buffer| {
            let shared = Shared::new::<E>((u, with.points), shared);
            evaluate(&VolumeColumns { shared, volumetric }, with, buffer);
        },
    );
}

/// Energy, force and tangent of every range into its private arrays, as far as they are asked for.
pub(crate) fn evaluate<
    S: Scalar,
    C: PointColumns<S, V, P, Q>,
    const V: usize,
    const P: usize,
    const Q: usize,
>(
    columns: &C,
    with: Evaluation,
    buffer: &mut LawBuffer<S>,
) {
    let work = columns.shared().rest.len() * work(with.request, [40 * Q, 50 * Q, 400 * Q]);
    columns::evaluate(&GaussColumns::<_, V, 3, P, Q>(&Axes(columns)), with, work, buffer);
}

/// A table as a law at Gauss points.
struct Axes<'a, C>(&'a C);

/// Elements at Gauss points, their shares of the volume and displacements (m).
type Points<E, L> = (E, L, [[L; 3]; 4]);

impl<S: Scalar, C, const V: usize, const P: usize, const Q: usize> GaussLaw<S, V, 3, P, Q>
    for Axes<'_, C>
where
    C: PointColumns<S, V, P, Q>,
{
    const WIDE: bool = false;
    type Points<L: Lanes<Scalar = S>> = Points<C::Element<L>, L>;
    #[inline(always)]
    fn elements(&self) -> &GaussElements<'_, S, V, 3, P, Q> {
        &self.0.shared().elements
    }
    #[inline(always)]
    fn own(&self, i: usize) -> u32 {
        self.0.shared().rest[i].own
    }
    #[inline(always)]
    fn points<L: Lanes<Scalar = S>>(
        &self,
        i: usize,
        u: &[[S; 3]; V],
        (derivatives, first): (&Derivatives<S, V, 3, Q>, usize),
    ) -> Points<C::Element<L>, L> {
        let shared = self.0.shared();
        let u = point_differences::<L, 4, _, _, _>(derivatives, u, first);
        let share = load_weights::<L, Q>(&shared.rest[i].volume, first);
        (self.0.element::<L>(i, first, share), share, u)
    }
    #[inline(always)]
    fn energy<L: Lanes<Scalar = S>>(&self, (e, _, u): &Points<C::Element<L>, L>) -> L {
        e.energy(u)
    }
    #[inline(always)]
    fn forces<L: Lanes<Scalar = S>>((e, _, u): &Points<C::Element<L>, L>) -> Option<[[L; 3]; 3]> {
        let [_, a, b, c] = e.forces(u);
        Some([a, b, c])
    }
    #[inline(always)]
    fn tangent<L: Lanes<Scalar = S>>(
        (e, _, u): &Points<C::Element<L>, L>,
        kind: TangentKind,
    ) -> [[[L; 9]; 3]; 3] {
        inner_blocks(&e.tangent(u, kind))
    }
    #[inline(always)]
    fn is_clamped<L: Lanes<Scalar = S>>((e, share, u): &Points<C::Element<L>, L>) -> L::Mask {
        L::both(L::less(L::ZERO, *share), e.is_clamped(u))
    }
}

/// Whether something is true of the gradients (1/m) and displacements (m) of a tetrahedron that stands for some point.
pub(crate) fn at_any_point<S, const V: usize, const P: usize, const Q: usize>(
    (rest, points): (&PointsRest<f64, Q>, &OwnPoints),
    u: &[[f64; 3]; V],
    is_true: impl Fn([[f64; 3]; 3], &[[f64; 3]; 4]) -> bool,
) -> bool
where
    S: Shape<V, P, Q>,
{
    let (of_all, mut slot) = (S::derivatives(), None);
    let derivatives = derivatives_of(&of_all, S::own(points), rest.own, &mut slot);
    (0..Q).any(|q| {
        let u = point_differences::<f64, 4, _, _, _>(derivatives, u, q);
        is_true(rest.gradients::<f64>(q), &u)
    })
}

/// Energy (J) of the axes of an entity in `f64`, from its columns as one element and its rest shape.
pub(crate) fn energy_at_points<S, E, const V: usize, const P: usize, const Q: usize>(
    (rest, points): (&PointsRest<f64, Q>, &OwnPoints),
    u: &[[f64; 3]; V],
    element: impl Fn([[f64; 3]; 3], f64) -> E,
) -> f64
where
    S: Shape<V, P, Q>,
    E: AxisElement<f64>,
{
    let (of_all, mut slot) = (S::derivatives(), None);
    let derivatives = derivatives_of(&of_all, S::own(points), rest.own, &mut slot);
    (0..Q)
        .map(|q| {
            let u = point_differences::<f64, 4, _, _, _>(derivatives, u, q);
            element(rest.gradients::<f64>(q), rest.volume[q]).energy(&u)
        })
        .sum()
}
