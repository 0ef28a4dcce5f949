//! What the columns of elements hold, a line for each quantity. Removal sets the numbers of removed elements to
//! zero, and [`compare_with_fresh`](super::compare_with_fresh) compares all of them with those of a new body.

use bevy_ecs::archetype::ArchetypeId;
use bevy_ecs::prelude::*;
use bytemuck::{Pod, Zeroable};
use sinew_engine::element::{MembraneEdge, RestArea, RestEdge, RestVolume, ShapeGradient};
use sinew_engine::isoparametric::{HexahedronRest, QuadRest, Tetrahedron10Rest};
use sinew_engine::scalar::Scalar;

use crate::axes::columns::*;
use crate::frame::moduli::{CompressionModulus, FirstLameParameter, ShearModulus};
use crate::frame::reduced::{HexahedronShape, HourglassStiffness};
use crate::frame::triangles::{
    MembraneCompressionModulus, MembraneFirstModulus, MembraneShearModulus,
};
use crate::laws::pooled::{AngularStiffness, TensileStiffness, VolumetricStiffness};

/// How the numbers of a quantity belong to the vertices of their element, which a new body may number in
/// another order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Not at all, or in the order of the user's mesh.
    Fixed,
    /// One number for each vertex.
    Vertices,
    /// A vector or number for each vertex but the first, which has minus their sum.
    Gradients,
    /// A vector from the first vertex to each of the others.
    Edges,
    /// One number for each pair of opposite edges of a tetrahedron.
    OppositeEdges,
}

/// What becomes of the numbers of a removed element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AtRemoval {
    /// They are zero from then on.
    Cleared,
    /// They stay.
    Kept,
}

/// A quantity of elements.
#[derive(Clone, Copy)]
pub(super) struct Quantity {
    /// Name in reports.
    pub name: &'static str,
    /// How its numbers belong to the vertices.
    pub order: Order,
    /// What becomes of them.
    pub at_removal: AtRemoval,
    /// Appends its numbers, if the entity has them.
    pub read: fn(EntityRef, &mut Vec<f64>),
    /// Sets them to zero.
    clear: fn(&mut EntityWorldMut),
}

macro_rules! quantities {
    ($($at_removal:ident $name:literal $order:ident: [$($column:ty),+] $field:tt;)+) => {
        /// All of them.
        pub(super) fn quantities<S: Scalar>() -> Vec<Quantity> {
            vec![$(Quantity {
                name: $name,
                order: Order::$order,
                at_removal: AtRemoval::$at_removal,
                read: |entity, numbers| {$(
                    if let Some(column) = entity.get::<$column>() {
                        append::<S, _>(&column.$field, numbers);
                    }
                )+},
                clear: |entity| {$(
                    if let Some(mut column) = entity.get_mut::<$column>() {
                        column.$field = Zeroable::zeroed();
                    }
                )+},
            }),+]
        }
    };
}
quantities! {
    Cleared "volume" Fixed: [RestVolume<S>] 0;
    Cleared "shape vectors" Gradients: [
        ShapeGradient<S, 1, 0>, ShapeGradient<S, 1, 1>, ShapeGradient<S, 1, 2>,
        ShapeGradient<S, 2, 0>, ShapeGradient<S, 2, 1>, ShapeGradient<S, 2, 2>,
        ShapeGradient<S, 3, 0>, ShapeGradient<S, 3, 1>, ShapeGradient<S, 3, 2>] 0;
    Cleared "moduli" Fixed: [FirstLameParameter<S>, ShearModulus<S>, CompressionModulus<S>] 0;
    Cleared "gradients of hexahedra" Fixed: [HexahedronRest<S>] gradients;
    Cleared "volumes of Gauss points" Fixed: [HexahedronRest<S>] volume;
    Cleared "shape of hexahedra with reduced integration" Fixed: [HexahedronShape<S>] 0;
    Cleared "stiffness of hourglass modes" Fixed: [HourglassStiffness<S>] 0;
    Cleared "gradients of ten-node tetrahedra" Fixed: [Tetrahedron10Rest<S>] gradients;
    Cleared "volumes of their Gauss points" Fixed: [Tetrahedron10Rest<S>] volume;
    Kept "membrane edges" Edges: [
        MembraneEdge<S, 1, 0>, MembraneEdge<S, 1, 1>, MembraneEdge<S, 1, 2>,
        MembraneEdge<S, 2, 0>, MembraneEdge<S, 2, 1>, MembraneEdge<S, 2, 2>] 0;
    Kept "area" Fixed: [RestArea<S>] 0;
    Kept "edges of quadrilaterals" Fixed: [QuadRest<S>] edges;
    Kept "areas of Gauss points" Fixed: [QuadRest<S>] half_area;
    Cleared "membrane moduli" Fixed: [
        MembraneFirstModulus<S>, MembraneShearModulus<S>, MembraneCompressionModulus<S>] 0;
    Kept "rest edges" Edges: [RestEdge<S, 0>, RestEdge<S, 1>, RestEdge<S, 2>] 0;
    Cleared "tensile stiffness" Fixed: [TensileStiffness<S>] 0;
    Cleared "angular stiffness" Vertices: [
        AngularStiffness<S, 0>, AngularStiffness<S, 1>, AngularStiffness<S, 2>] 0;
    Cleared "volumetric stiffness" OppositeEdges: [
        VolumetricStiffness<S, 0>, VolumetricStiffness<S, 1>, VolumetricStiffness<S, 2>] 0;
    Kept "directions of axes" Fixed: [
        AxisDirection<S, 0, 0>, AxisDirection<S, 0, 1>, AxisDirection<S, 0, 2>,
        AxisDirection<S, 1, 0>, AxisDirection<S, 1, 1>, AxisDirection<S, 1, 2>,
        AxisDirection<S, 2, 0>, AxisDirection<S, 2, 1>, AxisDirection<S, 2, 2>] 0;
    Cleared "axial stiffness" Fixed: [
        AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>] 0;
    Cleared "stiffness between axes" Fixed: [
        AxisAngleStiffness<S, 0>, AxisAngleStiffness<S, 1>, AxisAngleStiffness<S, 2>] 0;
    Cleared "stiffness of volume" Fixed: [VolumeStiffness<S>] 0;
    Cleared "shape of fibres" Gradients: [FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>] 0;
    Cleared "shortening" Fixed: [FibreShortening<S>] 0;
    Cleared "active stiffness" Fixed: [FibreActive<S>, PassiveStiffness<S>, PeakTension<S>] 0;
    Kept "length-tension curve" Fixed: [FibreOffset<S>, FibreInverseWidth<S>] 0;
}

fn append<S: Scalar, T: Pod>(column: &T, numbers: &mut Vec<f64>) {
    let own = bytemuck::cast_slice::<T, S>(std::slice::from_ref(column));
    numbers.extend(own.iter().map(|x| x.to_f64()));
}

/// Sets the numbers of removed elements to zero. Keeps in mind what the last entity had, since the next one
/// mostly has the same.
pub(super) struct Clear {
    all: Vec<Quantity>,
    present: Vec<Quantity>,
    archetype: Option<ArchetypeId>,
}

impl Clear {
    pub(super) fn new<S: Scalar>() -> Self {
        let mut all = quantities::<S>();
        all.retain(|quantity| quantity.at_removal == AtRemoval::Cleared);
        Self { all, present: Vec::new(), archetype: None }
    }

    /// Those of an entity.
    pub(super) fn entity(&mut self, entity: &mut EntityWorldMut) {
        let archetype = entity.archetype().id();
        if self.archetype.replace(archetype) != Some(archetype) {
            let has = |quantity: &&Quantity| {
                let mut numbers = Vec::new();
                (quantity.read)(entity.as_readonly(), &mut numbers);
                !numbers.is_empty()
            };
            self.present = self.all.iter().filter(has).copied().collect();
        }
        self.present.iter().for_each(|quantity| (quantity.clear)(entity));
    }
}
