//! Axes of removed elements: without shape and moduli, so that their laws give exact zeros.

use bevy_ecs::prelude::*;
use sinew_engine::element::ShapeGradient;
use sinew_engine::isoparametric::{NO_OWN_POINTS, PointsRest};
use sinew_engine::scalar::{Scalar, dot};

use super::columns::*;
use super::damper::AxialDamper;
use super::element::{AxisElement, BiquadraticFibre, Fibre, Triad, VolumeTerm};
use super::points::energy_at_points;
use crate::frame::hexahedra::Shape;

/// Numbers in columns of an entity; 0 where it has no such column.
macro_rules! numbers {
    ($entity:expr, $($column:ty),+) => {
        [$($entity.get::<$column>().map_or(0.0, |x| x.0.to_f64())),+]
    };
}

fn direction<S: Scalar, const A: usize>(e: &EntityRef) -> [f64; 3] {
    numbers!(e, AxisDirection<S, A, 0>, AxisDirection<S, A, 1>, AxisDirection<S, A, 2>)
}

fn gradient<S: Scalar, const V: usize>(e: &EntityRef) -> [f64; 3] {
    numbers!(e, ShapeGradient<S, V, 0>, ShapeGradient<S, V, 1>, ShapeGradient<S, V, 2>)
}

/// Directions and moduli of an axis entity in `f64`, and its gradients in tetrahedra.
fn triad<S: Scalar>(e: &EntityRef) -> Triad<f64> {
    let [volumetric] = numbers!(e, VolumeStiffness<S>);
    Triad {
        gradients: [gradient::<S, 1>(e), gradient::<S, 2>(e), gradient::<S, 3>(e)],
        axes: [direction::<S, 0>(e), direction::<S, 1>(e), direction::<S, 2>(e)],
        axial: numbers!(e, AxialStiffness<S, 0>, AxialStiffness<S, 1>, AxialStiffness<S, 2>),
        angular: numbers!(
            e,
            AxisAngleStiffness<S, 0>,
            AxisAngleStiffness<S, 1>,
            AxisAngleStiffness<S, 2>
        ),
        volumetric,
    }
}

/// The same of a fibre, and its shape in tetrahedra.
fn fibre<S: Scalar>(e: &EntityRef) -> Fibre<f64> {
    let [stiffness, shortening, active, offset, inverse_width] = numbers!(
        e,
        AxialStiffness<S, 0>,
        FibreShortening<S>,
        FibreActive<S>,
        FibreOffset<S>,
        FibreInverseWidth<S>
    );
    Fibre {
        shape: numbers!(e, FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>),
        axis: direction::<S, 0>(e),
        stiffness,
        shortening,
        active,
        offset,
        inverse_width,
    }
}

/// The same of a biquadratic fibre, `None` of other axes.
fn biquadratic<S: Scalar>(e: &EntityRef) -> Option<BiquadraticFibre<f64>> {
    let is_one = e.contains::<Biquadratic>()
        || e.contains::<PooledBiquadratic>()
        || e.contains::<SheetBiquadratic>()
        || e.contains::<PooledSheetBiquadratic>();
    is_one.then(|| {
        let [stiffness] = numbers!(e, AxialStiffness<S, 0>);
        let shape = numbers!(e, FibreShape<S, 1>, FibreShape<S, 2>, FibreShape<S, 3>);
        BiquadraticFibre { shape, axis: direction::<S, 0>(e), stiffness }
    })
}

/// Energy (J) of the axes of an entity at displacements (m) of their tetrahedron, of which pooled springs are a part where
/// fibres are pooled.
pub(crate) fn energy<S: Scalar>(world: &World, entity: Entity, u: &[[f64; 3]; 4]) -> f64 {
    let e = world.entity(entity);
    if e.contains::<AxialDamper<4>>() {
        return 0.0;
    }
    if let Some(own) = biquadratic::<S>(&e) {
        return own.energy(u);
    }
    if e.contains::<FibreShape<S, 1>>() {
        return fibre::<S>(&e).energy(u);
    }
    let own = triad::<S>(&e);
    if !e.contains::<AxisAngleStiffness<S, 0>>() {
        return VolumeTerm { gradients: own.gradients, volumetric: own.volumetric }.energy(u);
    }
    own.energy(u)
}

/// Energy (J) of the axes of an entity at displacements (m) of their hexahedron or ten-node tetrahedron.
pub(crate) fn energy_at<S, E, const V: usize, const P: usize, const Q: usize>(
    world: &World,
    entity: Entity,
    u: &[[f64; 3]; V],
) -> f64
where
    S: Scalar,
    E: Shape<V, P, Q>,
{
    let e = world.entity(entity);
    // dampers have none
    let Some(rest) = e.get::<PointsRest<S, Q>>() else { return 0.0 };
    let at = (&rest.in_f64(), world.get_resource().unwrap_or(&NO_OWN_POINTS));
    if let Some(own) = biquadratic::<S>(&e) {
        return energy_at_points::<E, _, V, P, Q>(at, u, |d, share| BiquadraticFibre {
            shape: d.map(|d| dot(d, own.axis)),
            stiffness: own.stiffness * share,
            ..own
        });
    }
    if e.contains::<FibreActive<S>>() {
        let own = fibre::<S>(&e);
        return energy_at_points::<E, _, V, P, Q>(at, u, |d, share| Fibre {
            shape: d.map(|d| dot(d, own.axis)),
            stiffness: own.stiffness * share,
            active: own.active * share,
            ..own
        });
    }
    let own = triad::<S>(&e);
    energy_at_points::<E, _, V, P, Q>(at, u, |gradients, share| Triad {
        gradients,
        axial: own.axial.map(|y| y * share),
        angular: own.angular.map(|g| g * share),
        volumetric: own.volumetric * share,
        ..own
    })
}

/// Takes from an entity the moduli that are no columns of numbers.
pub(crate) fn clear(axes: &mut EntityWorldMut) {
    macro_rules! clear {
        ($($component:ty),+) => {$(
            if let Some(mut x) = axes.get_mut::<$component>() {
                x.clear();
            }
        )+};
    }
    clear![AxisSource, AxialDamper<4>, AxialDamper<8>, AxialDamper<10>];
}
