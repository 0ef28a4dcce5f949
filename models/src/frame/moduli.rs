//! Columns of solid elements that laws read beside rest shapes: moduli, and the clusters that keep their volume.

use bevy_ecs::prelude::*;
use bytemuck::TransparentWrapper;
use sinew_engine::scalar::Scalar;

use super::columns::scalar_columns;
use crate::material::LameParameters;

scalar_columns! {
    /// First Lamé parameter lambda of a tetrahedron (Pa).
    FirstLameParameter,
    /// Shear modulus mu of a tetrahedron (Pa).
    ShearModulus,
    /// Modulus of the compression term of a tetrahedron (Pa): lambda + mu, or 0 for a body without it.
    CompressionModulus,
}

scalar_columns! {
    /// Pressure of the cluster of an element (Pa), positive in expansion; found anew by every evaluation.
    ClusterPressure,
    /// The same as tangents take it ([`PredictedValues`](sinew_engine::matrix::PredictedValues)).
    PredictedPressure,
}

/// The columns of pressures.
pub type Pressures<S> = (ClusterPressure<S>, PredictedPressure<S>);

/// Cluster that a tetrahedron belongs to; numbers are unique in a world and otherwise without meaning.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, TransparentWrapper)]
#[component(summary_tick, clone_behavior = Ignore)]
#[repr(transparent)]
pub struct ClusterIndex(pub u32);

/// Columns of the moduli of a solid element.
pub(crate) type Moduli<S> = (FirstLameParameter<S>, ShearModulus<S>, CompressionModulus<S>);

/// Moduli of a solid element, with that of the compression term or without.
pub(crate) fn moduli_bundle<S: Scalar>(lame: LameParameters, compression: bool) -> Moduli<S> {
    let LameParameters { lambda, mu } = lame;
    let compression = if compression { lambda + mu } else { 0.0 };
    (
        FirstLameParameter(S::from_f64(lambda)),
        ShearModulus(S::from_f64(mu)),
        CompressionModulus(S::from_f64(compression)),
    )
}
