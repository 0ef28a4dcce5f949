//! Axes of removed tetrahedra: without shape and moduli, so that their laws give exact zeros.

use bevy_ecs::prelude::*;
use sinew_engine::element::ShapeGradient;
use sinew_engine::scalar::Scalar;

use super::columns::*;
use super::element::{AxisElement, Fibre, Triad, VolumeTerm};
use super::printed_system::PrintedAxes;

/// Number in a column of an entity; 0 where it has no such column.
macro_rules! number {
    ($entity:expr, $column:ty) => {
        $entity.get::<$column>().map_or(0.0, |x| x.0.to_f64())
    };
}

/// Energy (J) of the axes of an entity at displacements (m) of their tetrahedron.
pub(crate) fn energy<S: Scalar>(world: &World, entity: Entity, u: &[[f64; 3]; 4]) -> f64 {
    let e = world.entity(entity);
    if let Some(printed) = e.get::<PrintedAxes>() {
        return printed.energy(u);
    }
    let axis = |i: usize| match i {
        0 => [
            number!(e, AxisDirection<S, 0, 0>),
            number!(e, AxisDirection<S, 0, 1>),
            number!(e, AxisDirection<S, 0, 2>),
        ],
        1 => [
            number!(e, AxisDirection<S, 1, 0>),
            number!(e, AxisDirection<S, 1, 1>),
            number!(e, AxisDirection<S, 1, 2>),
        ],
        _ => [
            number!(e, AxisDirection<S, 2, 0>),
            number!(e, AxisDirection<S, 2, 1>),
            number!(e, AxisDirection<S, 2, 2>),
        ],
    };
    if e.contains::<FibreShape<S, 1>>() {
        let fibre = Fibre {
            shape: [
                number!(e, FibreShape<S, 1>),
                number!(e, FibreShape<S, 2>),
                number!(e, FibreShape<S, 3>),
            ],
            axis: axis(0),
            stiffness: number!(e, AxialStiffness<S, 0>),
            shortening: number!(e, FibreShortening<S>),
            active: number!(e, FibreActive<S>),
            offset: number!(e, FibreOffset<S>),
            inverse_width: number!(e, FibreInverseWidth<S>),
        };
        return fibre.energy(u);
    }
    let gradients = [
        [
            number!(e, ShapeGradient<S, 1, 0>),
            number!(e, ShapeGradient<S, 1, 1>),
            number!(e, ShapeGradient<S, 1, 2>),
        ],
        [
            number!(e, ShapeGradient<S, 2, 0>),
            number!(e, ShapeGradient<S, 2, 1>),
            number!(e, ShapeGradient<S, 2, 2>),
        ],
        [
            number!(e, ShapeGradient<S, 3, 0>),
            number!(e, ShapeGradient<S, 3, 1>),
            number!(e, ShapeGradient<S, 3, 2>),
        ],
    ];
    let volumetric = number!(e, VolumeStiffness<S>);
    if !e.contains::<AxisAngleStiffness<S, 0>>() {
        return VolumeTerm { gradients, volumetric }.energy(u);
    }
    let triad = Triad {
        gradients,
        axes: [axis(0), axis(1), axis(2)],
        axial: [
            number!(e, AxialStiffness<S, 0>),
            number!(e, AxialStiffness<S, 1>),
            number!(e, AxialStiffness<S, 2>),
        ],
        angular: [
            number!(e, AxisAngleStiffness<S, 0>),
            number!(e, AxisAngleStiffness<S, 1>),
            number!(e, AxisAngleStiffness<S, 2>),
        ],
        volumetric,
    };
    triad.energy(u)
}

/// Takes shape and moduli from the axes of an entity; directions stay unit vectors.
pub(crate) fn clear<S: Scalar>(world: &mut World, entity: Entity) {
    let mut e = world.entity_mut(entity);
    macro_rules! zero {
        ($($column:ty),+ $(,)?) => {$(
            if let Some(mut x) = e.get_mut::<$column>() {
                x.0 = S::ZERO;
            }
        )+};
    }
    if let Some(mut printed) = e.get_mut::<PrintedAxes>() {
        printed.clear();
    }
    zero![
        ShapeGradient<S, 1, 0>, ShapeGradient<S, 1, 1>, ShapeGradient<S, 1, 2>,
        ShapeGradient<S, 2, 0>, ShapeGradient<S, 2, 1>, ShapeGradient<S, 2, 2>,
        ShapeGradient<S, 3, 0>, ShapeGradient<S, 3, 1>, ShapeGradient<S, 3, 2>,
        FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>,
        AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>,
        AxisAngleStiffness<S, 0>, AxisAngleStiffness<S, 1>, AxisAngleStiffness<S, 2>,
        VolumeStiffness<S>, FibreShortening<S>, FibreActive<S>, PassiveStiffness<S>,
        PeakTension<S>,
    ];
}
