//! Corotational elasticity ([`crate::element::corotational`]) in the table of laws, and stiffness warping.
//!
//! # Stiffness warping
//!
//! [`WarpedStiffness`] is the older form of the same law: force `-R K0 (R^T x - X)`, tangent
//! `R K0 R^T` (Müller and Gross 2004). For a linear tetrahedron `R^T x - X` has the strain `e`
//! exactly, so **the force is the same** and does derive from `W`; what is not derived is the tangent,
//! which leaves the turning of `R` out. It is semidefinite in every state. A line search on `W` and the
//! energy cap of the safe step therefore hold for it as for any other model; Newton's method with it
//! converges linearly where the element is strained. (With rotations found in other ways, by
//! Gram-Schmidt for example, the force would not be derived from an energy.)

use bevy_ecs::prelude::*;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use crate::element::corotational;
use crate::element::tetrahedron::{Element, Nodes, TetrahedronTangent};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;
use crate::frame::stand_in::Corotational;

family! {
    Corotational;
    BY_CLUSTERS = tetrahedra_by_clusters(
        "corotational, volume by clusters",
        "clusters of corotational tetrahedra"
    );
    HEXAHEDRA = hexahedra("corotational hexahedra");
    HEXAHEDRA_BY_MEAN = hexahedra_by_mean(
        "corotational hexahedra, mean volume",
        "means of corotational hexahedra"
    );
    HEXAHEDRA_REDUCED = hexahedra_reduced("corotational hexahedra, reduced integration");
    HEXAHEDRA_REDUCED_BY_MEAN = hexahedra_reduced_by_mean(
        "corotational hexahedra, reduced integration, mean volume",
        "means of corotational hexahedra, reduced integration"
    );
    TETRAHEDRA10 = tetrahedra10("corotational ten-node tetrahedra");
    TETRAHEDRA10_BY_MEAN = tetrahedra10_by_mean(
        "corotational ten-node tetrahedra, mean volume",
        "means of corotational ten-node tetrahedra"
    );
}

/// Stiffness warping: [`Corotational`] with the tangent `R K0 R^T` in place of every kind; also the mark
/// of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct WarpedStiffness;

/// Row of its tetrahedra in the table of laws.
pub static WARPED_TETRAHEDRA: LawRow = LawRow::tetrahedra::<WarpedStiffness>().warped();

impl TetrahedronLaw for WarpedStiffness {
    const WIDE: bool = false;
    const NAME: &'static str = "warped stiffness";
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    const STRESS_PROJECTION: bool = false;
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        corotational::energy(e, u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        Some(corotational::forces(e, u))
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, _: TangentKind) -> TetrahedronTangent<R> {
        corotational::tangent(e, u, TangentKind::GaussNewton)
    }
}
