//! Table columns of axes. An axis entity lies in a tetrahedron and carries its vertex rows; it is no row of
//! the tetrahedra, so that a body has as many axes in an element as it likes. There are several tables, so
//! that a scene pays for what it uses: triads (three axes, three angles, volume), single fibres, biquadratic
//! ones, and the term of volume alone.

#![allow(
    clippy::multiple_bound_locations,
    reason = "the derive macros of bytemuck repeat the bound on S"
)]

use bevy_ecs::prelude::*;
use bevy_ecs::query::ContiguousQueryData;
use bytemuck::TransparentWrapper;
use sinew_engine::element::{
    AxisBlocks, AxisVertices, ShapeGradients, load_displacements, load_vectors,
    shape_gradient_numbers,
};
use sinew_engine::lanes::Lanes;
use sinew_engine::scalar::Scalar;
use sinew_engine::vertex::Displacement;
use sinew_engine::{number_columns, vector_columns};

use super::element::{AxisElement, BiquadraticFibre, Fibre, Triad, VolumeTerm};

number_columns! {
    /// Component `X` (0, 1, 2) of the unit vector of axis `AXIS` (0, 1, 2) at rest.
    AxisDirection<AXIS, X>,
    /// Axial modulus of axis `AXIS` times rest volume (J).
    AxialStiffness<AXIS>,
    /// Angular modulus of pair `PAIR` ([`AXIS_PAIRS`](super::element::AXIS_PAIRS)) of axes times rest
    /// volume (J).
    AxisAngleStiffness<PAIR>,
    /// Modulus of the term of volume times rest volume (J).
    VolumeStiffness,
    /// Scalar product of a fibre with the shape vector of vertex `VERTEX` (1, 2, 3), 1/m.
    FibreShape<VERTEX>,
    /// `1 - r` of a fibre: by how much activation has shortened its rest length (-).
    FibreShortening,
    /// Peak active stress of a fibre times activation times rest volume (J).
    FibreActive,
    /// `1 - l_opt` of the length-tension curve of a fibre (-).
    FibreOffset,
    /// `1/w` of the length-tension curve of a fibre (-).
    FibreInverseWidth,
    /// Axial modulus of a fibre without activation times rest volume (J).
    PassiveStiffness,
    /// Peak active stress of a fibre times rest volume (J).
    PeakTension,
}

/// Muscle that a fibre belongs to: index into [`Muscles`](super::muscle::Muscles);
/// [`NO_MUSCLE`] for passive fibres.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[component(clone_behavior = Ignore)]
#[repr(transparent)]
pub struct MuscleIndex(pub u32);

/// Index of fibres without a muscle.
pub const NO_MUSCLE: u32 = u32::MAX;

vector_columns!(
    AxisDirection<AXIS>: Direction, DirectionColumns, DirectionBundle, direction_bundle, direction_numbers
);
vector_columns!(
    AxialStiffness: AxialStiffnesses, AxialColumns, AxialBundle, axial_bundle, axial_numbers
);
vector_columns!(
    AxisAngleStiffness: AngleStiffnesses, AngleColumns, AngleBundle, angle_bundle, angle_numbers
);

/// Slices of the query data `D`, as a contiguous query gives them.
pub(super) type Slices<'a, D> = <D as ContiguousQueryData>::Contiguous<'a, 'a>;

/// The axes of a triad: query data.
pub type Directions<S> = (Direction<S, 0>, Direction<S, 1>, Direction<S, 2>);

/// Constants of fibres: query data.
pub type FibreConstants<S> = (
    &'static AxialStiffness<S, 0>,
    &'static FibreShortening<S>,
    &'static FibreActive<S>,
    &'static FibreOffset<S>,
    &'static FibreInverseWidth<S>,
);

/// Columns of one table of axes as slices.
pub trait AxisColumns<S: Scalar>: Copy + Send + Sync {
    /// Element of a register of rows.
    type Element<L: Lanes<Scalar = S>>: AxisElement<L>;
    /// Displacement of every vertex row (m).
    fn displacement(&self) -> &[[S; 4]];
    /// Vertex rows.
    fn nodes(&self) -> &[[u32; 4]];
    /// Tangent blocks.
    fn blocks(&self) -> &[[u32; 6]];
    /// The elements from `first` on.
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> Self::Element<L>;

    /// Displacements of the vertices of the elements from `first` on.
    #[inline(always)]
    fn displacements<L: Lanes<Scalar = S>>(&self, first: usize) -> [[L; 3]; 4] {
        load_displacements(self.displacement(), self.nodes(), first)
    }
}

/// What all tables of axes have.
#[derive(Clone, Copy, Debug)]
struct Shared<'a, S> {
    displacement: &'a [[S; 4]],
    nodes: &'a [[u32; 4]],
    blocks: &'a [[u32; 6]],
}

impl<'a, S: Scalar> Shared<'a, S> {
    fn new(
        displacement: &'a [Displacement<S>],
        nodes: &'a [AxisVertices],
        blocks: &'a [AxisBlocks],
    ) -> Self {
        Self {
            displacement: Displacement::peel_slice(displacement),
            nodes: AxisVertices::peel_slice(nodes),
            blocks: AxisBlocks::peel_slice(blocks),
        }
    }
}

macro_rules! shared {
    () => {
        #[inline(always)]
        fn displacement(&self) -> &[[S; 4]] {
            self.shared.displacement
        }
        #[inline(always)]
        fn nodes(&self) -> &[[u32; 4]] {
            self.shared.nodes
        }
        #[inline(always)]
        fn blocks(&self) -> &[[u32; 6]] {
            self.shared.blocks
        }
    };
}

#[inline(always)]
fn load_vector<L: Lanes>(columns: &[&[L::Scalar]; 3], first: usize) -> [L; 3] {
    let [vector] = load_vectors(columns, first);
    vector
}

/// Columns of the table of triads.
#[derive(Clone, Copy, Debug)]
pub struct TriadColumns<'a, S> {
    shared: Shared<'a, S>,
    gradients: [&'a [S]; 9],
    axes: [&'a [S]; 9],
    axial: [&'a [S]; 3],
    angular: [&'a [S]; 3],
    volumetric: &'a [S],
}

/// Query data of [`TriadColumns`].
pub type TriadData<S> = (
    (&'static AxisVertices, &'static AxisBlocks),
    ShapeGradients<S>,
    Directions<S>,
    AxialStiffnesses<S>,
    AngleStiffnesses<S>,
    &'static VolumeStiffness<S>,
);

impl<'a, S: Scalar> TriadColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        ((nodes, blocks), gradients, axes, axial, angular, volumetric): Slices<'a, TriadData<S>>,
    ) -> Self {
        let [a, b, c] = direction_numbers(axes.0);
        let [d, e, f] = direction_numbers(axes.1);
        let [g, h, i] = direction_numbers(axes.2);
        Self {
            shared: Shared::new(displacement, nodes, blocks),
            gradients: shape_gradient_numbers(gradients),
            axes: [a, b, c, d, e, f, g, h, i],
            axial: axial_numbers(axial),
            angular: angle_numbers(angular),
            volumetric: VolumeStiffness::peel_slice(volumetric),
        }
    }
}

impl<S: Scalar> AxisColumns<S> for TriadColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = Triad<L>;
    shared!();
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> Triad<L> {
        Triad {
            gradients: load_vectors(&self.gradients, first),
            axes: load_vectors(&self.axes, first),
            axial: load_vector(&self.axial, first),
            angular: load_vector(&self.angular, first),
            volumetric: L::load(&self.volumetric[first..]),
        }
    }
}

/// Scalar products of fibres with the shape vectors of the vertices 1, 2, 3: query data.
pub type FibreShapes<S> =
    (&'static FibreShape<S, 1>, &'static FibreShape<S, 2>, &'static FibreShape<S, 3>);

/// Slices of [`FibreShapes`].
fn shape_numbers<'a, S: Scalar>((a, b, c): Slices<'a, FibreShapes<S>>) -> [&'a [S]; 3] {
    [FibreShape::peel_slice(a), FibreShape::peel_slice(b), FibreShape::peel_slice(c)]
}

/// Columns of the table of fibres.
#[derive(Clone, Copy, Debug)]
pub struct FibreColumns<'a, S> {
    shared: Shared<'a, S>,
    shape: [&'a [S]; 3],
    axis: [&'a [S]; 3],
    stiffness: &'a [S],
    shortening: &'a [S],
    active: &'a [S],
    offset: &'a [S],
    inverse_width: &'a [S],
}

/// Query data of [`FibreColumns`].
pub type FibreData<S> = (
    (&'static AxisVertices, &'static AxisBlocks),
    FibreShapes<S>,
    Direction<S, 0>,
    FibreConstants<S>,
);

impl<'a, S: Scalar> FibreColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        ((nodes, blocks), shape, axis, own): Slices<'a, FibreData<S>>,
    ) -> Self {
        let (stiffness, shortening, active, offset, inverse_width) = own;
        Self {
            shared: Shared::new(displacement, nodes, blocks),
            shape: shape_numbers(shape),
            axis: direction_numbers(axis),
            stiffness: AxialStiffness::peel_slice(stiffness),
            shortening: FibreShortening::peel_slice(shortening),
            active: FibreActive::peel_slice(active),
            offset: FibreOffset::peel_slice(offset),
            inverse_width: FibreInverseWidth::peel_slice(inverse_width),
        }
    }
}

impl<S: Scalar> AxisColumns<S> for FibreColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = Fibre<L>;
    shared!();
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> Fibre<L> {
        Fibre {
            shape: load_vector(&self.shape, first),
            axis: load_vector(&self.axis, first),
            stiffness: L::load(&self.stiffness[first..]),
            shortening: L::load(&self.shortening[first..]),
            active: L::load(&self.active[first..]),
            offset: L::load(&self.offset[first..]),
            inverse_width: L::load(&self.inverse_width[first..]),
        }
    }
}

/// Marks biquadratic fibres.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct Biquadratic;

/// Marks biquadratic fibres that are part of pooled springs; they have a row for their projected tangent alone.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct PooledBiquadratic;

/// Marks biquadratic fibres in membrane triangles. Such a triangle is a tetrahedron whose last vertex is that before, with
/// shape 0.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct SheetBiquadratic;

/// Marks those that are part of pooled springs, as [`PooledBiquadratic`].
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct PooledSheetBiquadratic;

/// Columns of the table of biquadratic fibres.
#[derive(Clone, Copy, Debug)]
pub struct BiquadraticColumns<'a, S> {
    shared: Shared<'a, S>,
    shape: [&'a [S]; 3],
    axis: [&'a [S]; 3],
    stiffness: &'a [S],
}

/// Query data of [`BiquadraticColumns`]; the filter is one of the marks of these fibres.
pub type BiquadraticData<S> = (
    (&'static AxisVertices, &'static AxisBlocks),
    FibreShapes<S>,
    Direction<S, 0>,
    &'static AxialStiffness<S, 0>,
);

impl<'a, S: Scalar> BiquadraticColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        ((nodes, blocks), shape, axis, stiffness): Slices<'a, BiquadraticData<S>>,
    ) -> Self {
        Self {
            shared: Shared::new(displacement, nodes, blocks),
            shape: shape_numbers(shape),
            axis: direction_numbers(axis),
            stiffness: AxialStiffness::peel_slice(stiffness),
        }
    }
}

impl<S: Scalar> AxisColumns<S> for BiquadraticColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = BiquadraticFibre<L>;
    shared!();
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> BiquadraticFibre<L> {
        BiquadraticFibre {
            shape: load_vector(&self.shape, first),
            axis: load_vector(&self.axis, first),
            stiffness: L::load(&self.stiffness[first..]),
        }
    }
}

/// Marks axis entities that have a term of volume and no axes.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct VolumeAlone;

/// Columns of the table of terms of volume.
#[derive(Clone, Copy, Debug)]
pub struct VolumeColumns<'a, S> {
    shared: Shared<'a, S>,
    gradients: [&'a [S]; 9],
    volumetric: &'a [S],
}

/// Query data of [`VolumeColumns`].
pub type VolumeData<S> =
    ((&'static AxisVertices, &'static AxisBlocks), ShapeGradients<S>, &'static VolumeStiffness<S>);

impl<'a, S: Scalar> VolumeColumns<'a, S> {
    /// From table columns.
    pub fn new(
        displacement: &'a [Displacement<S>],
        ((nodes, blocks), gradients, volumetric): Slices<'a, VolumeData<S>>,
    ) -> Self {
        Self {
            shared: Shared::new(displacement, nodes, blocks),
            gradients: shape_gradient_numbers(gradients),
            volumetric: VolumeStiffness::peel_slice(volumetric),
        }
    }
}

impl<S: Scalar> AxisColumns<S> for VolumeColumns<'_, S> {
    type Element<L: Lanes<Scalar = S>> = VolumeTerm<L>;
    shared!();
    #[inline(always)]
    fn element<L: Lanes<Scalar = S>>(&self, first: usize) -> VolumeTerm<L> {
        VolumeTerm {
            gradients: load_vectors(&self.gradients, first),
            volumetric: L::load(&self.volumetric[first..]),
        }
    }
}

/// Which families the axial springs of an axis entity belong to, and what their moduli (Pa) are multiplied
/// by: share times rest volume (m^3).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[component(clone_behavior = Ignore)]
pub struct AxisSource {
    /// Index of the family of each axis, [`NO_FAMILY`] where there is no spring.
    pub family: [u32; 3],
    /// Factor on its modulus.
    pub weight: [f64; 3],
}

/// No spring along this axis.
pub const NO_FAMILY: u32 = u32::MAX;

impl AxisSource {
    pub(crate) fn new(family: [Option<usize>; 3], weight: [f64; 3]) -> Self {
        Self { family: family.map(|f| f.map_or(NO_FAMILY, |f| f as u32)), weight }
    }

    /// Without weight, for removed elements.
    pub(crate) fn clear(&mut self) {
        self.weight = [0.0; 3];
    }
}
