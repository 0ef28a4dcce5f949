//! The corotational energy, which stands in for the material of a body that recovers from inversion: it has one
//! minimum per element.

use bevy_ecs::prelude::*;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use super::law::TetrahedronLaw;
use super::rules::VolumeMeasure;
use crate::element::corotational;
use crate::element::tetrahedron::{Element, Nodes, TetrahedronTangent};

/// Corotational elasticity ([`corotational`]) with its exact tangent; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct Corotational;

impl TetrahedronLaw for Corotational {
    const WIDE: bool = false;
    const NAME: &'static str = "corotational";
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    const STRESS_PROJECTION: bool = false;
    const VOLUME: Option<VolumeMeasure> = Some(VolumeMeasure::TraceOfStretch);
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        corotational::energy(e, u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        Some(corotational::forces(e, u))
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TetrahedronTangent<R> {
        corotational::tangent(e, u, kind)
    }
    #[inline(always)]
    fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
        corotational::is_clamped(e, u)
    }
}
