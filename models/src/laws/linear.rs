//! Linear elasticity: a comparison model for small displacements.
//!
//! ```text
//! eps  = (G + G^T)/2
//! W    = V (lambda/2 (tr eps)^2 + mu eps:eps)                                           J
//! f_a  = -V (lambda (tr eps) I + 2 mu eps) D_a                                          N
//! K_ab = V (lambda D_a D_b^T + mu D_b D_a^T + mu (D_a.D_b) I)                           N/m
//! ```
//!
//! The tangent is constant and semidefinite, so every kind of it is the same and Newton's method takes
//! one step. The law does not know rotations: a turn by the angle `t` is a strain of `cos(t) - 1`, and
//! a body that turns swells. It is the model of the finite element references and of modal analysis,
//! not one for large motion. Turning an element inside out costs what the displacement costs.
//!
//! With volume by clusters the means are those of `tr eps` ([`VolumeMeasure`]).

use bevy_ecs::prelude::*;
use sinew_engine::element::displacement_gradient;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use crate::element::corotational::warped;
use crate::element::matrix::symmetric;
use crate::element::tetrahedron::{
    Element, Nodes, TetrahedronTangent, assemble, nodal_forces, small_strain_density,
    small_strain_stress,
};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;
use crate::frame::rules::VolumeMeasure;

/// Entries xx, yy, zz, yz, xz, xy of the strain.
#[inline(always)]
fn strain<R: Real>(e: &Element<R>, u: &Nodes<R>) -> [R; 6] {
    let g = displacement_gradient(&e.gradients, u);
    let half = R::from_f64(0.5);
    [g[0], g[4], g[8], half * (g[5] + g[7]), half * (g[2] + g[6]), half * (g[1] + g[3])]
}

/// Linear elasticity; also the mark of its tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct Linear;

family! {
    Linear;
    BY_CLUSTERS = tetrahedra_by_clusters(
        "linear elasticity, volume by clusters",
        "clusters of linear elasticity"
    );
    HEXAHEDRA = hexahedra("linear hexahedra");
    HEXAHEDRA_BY_MEAN = hexahedra_by_mean(
        "linear hexahedra, mean volume",
        "means of linear hexahedra"
    );
    HEXAHEDRA_REDUCED = hexahedra_reduced("linear hexahedra, reduced integration");
    HEXAHEDRA_REDUCED_BY_MEAN = hexahedra_reduced_by_mean(
        "linear hexahedra, reduced integration, mean volume",
        "means of linear hexahedra, reduced integration"
    );
}

impl TetrahedronLaw for Linear {
    const WIDE: bool = false;
    const NAME: &'static str = "linear elasticity";
    const IS_OBJECTIVE: bool = false;
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    const STRESS_PROJECTION: bool = false;
    const VOLUME: Option<VolumeMeasure> = Some(VolumeMeasure::TraceOfStrain);
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        e.volume * small_strain_density(e, &strain(e, u))
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        Some(nodal_forces(e, &symmetric(small_strain_stress(e, &strain(e, u)))))
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, _: &Nodes<R>, _: TangentKind) -> TetrahedronTangent<R> {
        assemble(&warped(&e.gradients, e.lambda * e.volume, e.mu * e.volume))
    }
}
