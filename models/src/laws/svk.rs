//! St Venant-Kirchhoff of tetrahedra: the fused law with its compression term (Delingette 2008, sections 3 and 4),
//! and two laws that complete the pooled springs of [`super::pooled`]: the compression term alone, and the
//! projected tangent, which needs the whole stress of an element and so cannot be split into springs.

use bevy_ecs::prelude::Component;
use sinew_engine::element::TetrahedronEdges;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use crate::element::tetrahedron::{self, Element, Nodes, TetrahedronTangent};
use crate::frame::law::TetrahedronLaw;
use crate::frame::row::LawRow;

/// Tangents and products of the compression term, with or without the elastic part.
macro_rules! tangents {
    (elastic: $elastic:literal) => {
        #[inline(always)]
        fn tangent<R: Real>(
            e: &Element<R>,
            u: &Nodes<R>,
            kind: TangentKind,
        ) -> TetrahedronTangent<R> {
            tetrahedron::tangent_parts(e, u, $elastic, kind != TangentKind::GaussNewton)
        }
        #[inline(always)]
        fn product<R: Real>(
            e: &Element<R>,
            u: &Nodes<R>,
            v: &Nodes<R>,
            kind: TangentKind,
        ) -> Nodes<R> {
            tetrahedron::product_parts(e, u, v, $elastic, kind != TangentKind::GaussNewton)
        }
    };
}

/// Fused evaluation: St Venant-Kirchhoff plus compression term, all in one pass; also the mark of its
/// tetrahedra.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct FusedStVK;

impl TetrahedronLaw for FusedStVK {
    const NAME: &'static str = "fused St Venant-Kirchhoff";
    const SOFTENS: bool = true;
    type Mark = Self;
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        tetrahedron::energy(e, u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        Some(tetrahedron::forces(e, u))
    }
    tangents!(elastic: true);
}

/// The compression term of pooled bodies, an independent law beside their springs.
pub struct Compression;

impl TetrahedronLaw for Compression {
    const NAME: &'static str = "compression term";
    type Mark = TetrahedronEdges;
    const STANDS_IN: bool = false;
    fn contributes(kind: TangentKind) -> bool {
        kind != TangentKind::Projected
    }
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        tetrahedron::compression::energy(e, u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Option<Nodes<R>> {
        let ratio = tetrahedron::volume_ratio(e, u);
        let acts = R::both(R::less(ratio, R::ONE), R::less(R::ZERO, e.compression));
        // no `then`: a closure would be compiled without the instruction set
        if R::any(acts) { Some(tetrahedron::compression::forces(e, u)) } else { None }
    }
    tangents!(elastic: false);
}

/// The projected tangent of pooled bodies: the eigenvalues that are clamped belong to the whole
/// stress of a tetrahedron, so it is formed per tetrahedron, springs and compression together.
pub struct PooledProjection;

impl TetrahedronLaw for PooledProjection {
    const NAME: &'static str = "projected tangent of springs";
    type Mark = TetrahedronEdges;
    const FORCES: bool = false;
    fn contributes(kind: TangentKind) -> bool {
        kind == TangentKind::Projected
    }
    #[inline(always)]
    fn energy<R: Real>(_: &Element<R>, _: &Nodes<R>) -> R {
        R::ZERO
    }
    #[inline(always)]
    fn forces<R: Real>(_: &Element<R>, _: &Nodes<R>) -> Option<Nodes<R>> {
        None
    }
    tangents!(elastic: true);
}

family! {
    FusedStVK;
    HEXAHEDRA = hexahedra("St Venant-Kirchhoff hexahedra");
    HEXAHEDRA_REDUCED = hexahedra_reduced("St Venant-Kirchhoff hexahedra, reduced integration");
    TETRAHEDRA10 = tetrahedra10("St Venant-Kirchhoff ten-node tetrahedra");
}
/// As [`TETRAHEDRA`].
pub static COMPRESSION: LawRow = LawRow::pooled_tetrahedra::<Compression>();
/// As [`TETRAHEDRA`].
pub static PROJECTION: LawRow = LawRow::pooled_tetrahedra::<PooledProjection>();
