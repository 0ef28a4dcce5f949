//! Axes of removed elements: without shape and moduli, so that their laws give exact zeros.

use bevy_ecs::prelude::*;
use sinew_engine::element::ShapeGradient;
use sinew_engine::isoparametric::HexahedronRest;
use sinew_engine::scalar::{Scalar, dot};

use super::change::AxisSource;
use super::columns::*;
use super::damper::AxialDamper;
use super::element::{AxisElement, Fibre, Triad, VolumeTerm};
use super::hexahedra::energy_at_points;
use super::printed_system::PrintedAxes;

/// Number in a column of an entity; 0 where it has no such column.
macro_rules! number {
    ($entity:expr, $column:ty) => {
        $entity.get::<$column>().map_or(0.0, |x| x.0.to_f64())
    };
}

/// Directions and moduli of an axis entity in `f64`; its gradients play no part.
fn triad<S: Scalar>(e: &EntityRef) -> Triad<f64> {
    Triad {
        gradients: [[0.0; 3]; 3],
        axes: [
            [
                number!(e, AxisDirection<S, 0, 0>),
                number!(e, AxisDirection<S, 0, 1>),
                number!(e, AxisDirection<S, 0, 2>),
            ],
            [
                number!(e, AxisDirection<S, 1, 0>),
                number!(e, AxisDirection<S, 1, 1>),
                number!(e, AxisDirection<S, 1, 2>),
            ],
            [
                number!(e, AxisDirection<S, 2, 0>),
                number!(e, AxisDirection<S, 2, 1>),
                number!(e, AxisDirection<S, 2, 2>),
            ],
        ],
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
        volumetric: number!(e, VolumeStiffness<S>),
    }
}

/// The same of a fibre, without its shape.
fn fibre<S: Scalar>(e: &EntityRef) -> Fibre<f64> {
    Fibre {
        shape: [0.0; 3],
        axis: triad::<S>(e).axes[0],
        stiffness: number!(e, AxialStiffness<S, 0>),
        shortening: number!(e, FibreShortening<S>),
        active: number!(e, FibreActive<S>),
        offset: number!(e, FibreOffset<S>),
        inverse_width: number!(e, FibreInverseWidth<S>),
    }
}

/// Energy (J) of the axes of an entity at displacements (m) of their tetrahedron.
pub(crate) fn energy<S: Scalar>(world: &World, entity: Entity, u: &[[f64; 3]; 4]) -> f64 {
    let e = world.entity(entity);
    if e.contains::<AxialDamper<4>>() {
        return 0.0;
    }
    if let Some(printed) = e.get::<PrintedAxes<4>>() {
        return printed.energy(u);
    }
    if e.contains::<FibreShape<S, 1>>() {
        let shape = [
            number!(e, FibreShape<S, 1>),
            number!(e, FibreShape<S, 2>),
            number!(e, FibreShape<S, 3>),
        ];
        return Fibre { shape, ..fibre::<S>(&e) }.energy(u);
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
    Triad { gradients, ..triad::<S>(&e) }.energy(u)
}

/// Energy (J) of the axes of an entity at displacements (m) of their hexahedron.
pub(crate) fn hexahedron_energy<S: Scalar>(
    world: &World,
    entity: Entity,
    u: &[[f64; 3]; 8],
) -> f64 {
    let e = world.entity(entity);
    if let Some(printed) = e.get::<PrintedAxes<8>>() {
        return printed.energy(u);
    }
    // dampers have none
    let Some(rest) = e.get::<HexahedronRest<S>>() else { return 0.0 };
    let rest = HexahedronRest {
        gradients: rest.gradients.map(|row| row.map(|x| x.to_f64())),
        volume: rest.volume.map(|x| x.to_f64()),
    };
    if e.contains::<FibreActive<S>>() {
        let own = fibre::<S>(&e);
        return energy_at_points(&rest, u, |d, share| Fibre {
            shape: d.map(|d| dot(d, own.axis)),
            stiffness: own.stiffness * share,
            active: own.active * share,
            ..own
        });
    }
    let own = triad::<S>(&e);
    energy_at_points(&rest, u, |gradients, share| Triad {
        gradients,
        axial: own.axial.map(|y| y * share),
        angular: own.angular.map(|g| g * share),
        volumetric: own.volumetric * share,
        ..own
    })
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
    macro_rules! clear {
        ($($component:ty),+) => {$(
            if let Some(mut x) = e.get_mut::<$component>() {
                x.clear();
            }
        )+};
    }
    clear![PrintedAxes<4>, PrintedAxes<8>, AxialDamper<4>, AxialDamper<8>, AxisSource];
    if let Some(mut rest) = e.get_mut::<HexahedronRest<S>>() {
        *rest = HexahedronRest { gradients: [[S::ZERO; 8]; 9], volume: [S::ZERO; 8] };
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
