//! Laws of membrane triangles ([`crate::element::membrane`]) and of quadrilaterals at their Gauss points, and two
//! that complete the pooled springs of [`super::pooled`]: the compression term, and the projected tangent, which
//! needs the whole stress of a triangle. Mass-spring membranes are springs on edges
//! ([`MassSpring`](super::quadratic::MassSpring)).

use bevy_ecs::prelude::Component;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use crate::element::membrane::{
    Element, TriangleTangent, biquadratic, corotational, linear, quadratic,
};
use crate::frame::law::TriangleLaw;
use crate::frame::row::LawRow;

/// Biquadratic springs (TRBS), one triangle at a time; also the mark of its triangles.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct BiquadraticMembrane;

/// Quadratic springs (TRQS); also the mark of its triangles.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct QuadraticMembrane;

/// Constant-strain triangles; also the mark of its triangles.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct LinearMembrane;

/// Corotational triangles; also the mark of its triangles.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct CorotationalMembrane;

/// Projected tangent of pooled membranes; also the mark of their triangles.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct PooledMembrane;

/// The compression term of pooled membranes, an independent law beside their springs.
#[derive(Component, Clone, Copy, Debug, Default)]
#[component(clone_behavior = Ignore)]
pub struct MembraneCompression;

/// Row of [`BiquadraticMembrane`] in the table of laws.
pub static BIQUADRATIC: LawRow = LawRow::triangles::<BiquadraticMembrane>();
/// Row of [`QuadraticMembrane`] in the table of laws.
pub static QUADRATIC: LawRow = LawRow::triangles::<QuadraticMembrane>();
/// Row of [`LinearMembrane`] in the table of laws.
pub static LINEAR: LawRow = LawRow::triangles::<LinearMembrane>();
/// Row of [`CorotationalMembrane`] in the table of laws.
pub static COROTATIONAL: LawRow = LawRow::triangles::<CorotationalMembrane>();
/// Row of [`PooledMembrane`] in the table of laws.
pub static PROJECTION: LawRow = LawRow::triangles::<PooledMembrane>();
/// Row of [`MembraneCompression`] in the table of laws.
pub static COMPRESSION: LawRow = LawRow::triangles::<MembraneCompression>();
/// Row of [`BiquadraticMembrane`] on quadrilaterals.
pub static BIQUADRATIC_QUADS: LawRow =
    LawRow::quads::<BiquadraticMembrane>("St Venant-Kirchhoff quadrilaterals");
/// Row of [`LinearMembrane`] on quadrilaterals.
pub static LINEAR_QUADS: LawRow = LawRow::quads::<LinearMembrane>("linear quadrilaterals");
/// Row of [`CorotationalMembrane`] on quadrilaterals.
pub static COROTATIONAL_QUADS: LawRow =
    LawRow::quads::<CorotationalMembrane>("corotational quadrilaterals");

/// Energy and forces from a module of [`crate::element::membrane`].
macro_rules! energy_of {
    ($module:ident) => {
        #[inline(always)]
        fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> R {
            $module::energy(e, u)
        }
        #[inline(always)]
        fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> [[R; 3]; 3] {
            $module::forces(e, u)
        }
    };
}

/// Tangents from such a module.
macro_rules! tangent_of {
    ($module:ident) => {
        #[inline(always)]
        fn tangent<R: Real>(
            e: &Element<R>,
            u: &[[R; 3]; 3],
            kind: TangentKind,
        ) -> TriangleTangent<R> {
            $module::tangent(e, u, kind)
        }
        #[inline(always)]
        fn is_clamped<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> R::Mask {
            $module::is_clamped(e, u)
        }
    };
}

impl TriangleLaw for BiquadraticMembrane {
    const NAME: &'static str = "biquadratic membrane";
    type Mark = Self;
    energy_of!(biquadratic);
    tangent_of!(biquadratic);
    #[inline(always)]
    fn product<R: Real>(
        e: &Element<R>,
        u: &[[R; 3]; 3],
        v: &[[R; 3]; 3],
        kind: TangentKind,
    ) -> [[R; 3]; 3] {
        match kind {
            TangentKind::Projected => biquadratic::tangent(e, u, kind).product(v),
            _ => biquadratic::product(e, u, v, kind == TangentKind::Exact),
        }
    }
}

impl TriangleLaw for QuadraticMembrane {
    const NAME: &'static str = "quadratic membrane";
    type Mark = Self;
    energy_of!(quadratic);
    tangent_of!(quadratic);
}

impl TriangleLaw for LinearMembrane {
    const WIDE: bool = false;
    const NAME: &'static str = "linear membrane";
    type Mark = Self;
    energy_of!(linear);
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, _: &[[R; 3]; 3], _: TangentKind) -> TriangleTangent<R> {
        linear::tangent(e)
    }
}

impl TriangleLaw for CorotationalMembrane {
    const WIDE: bool = false;
    const NAME: &'static str = "corotational membrane";
    type Mark = Self;
    energy_of!(corotational);
    tangent_of!(corotational);
}

impl TriangleLaw for PooledMembrane {
    const NAME: &'static str = "projected tangent of a pooled membrane";
    type Mark = Self;
    const FORCES: bool = false;
    fn contributes(kind: TangentKind) -> bool {
        kind == TangentKind::Projected
    }
    #[inline(always)]
    fn energy<R: Real>(_: &Element<R>, _: &[[R; 3]; 3]) -> R {
        R::ZERO
    }
    #[inline(always)]
    fn forces<R: Real>(_: &Element<R>, _: &[[R; 3]; 3]) -> [[R; 3]; 3] {
        [[R::ZERO; 3]; 3]
    }
    tangent_of!(biquadratic);
}

/// The element without its springs.
#[inline(always)]
fn compression_only<R: Real>(e: &Element<R>) -> Element<R> {
    Element { lambda: R::ZERO, mu: R::ZERO, ..*e }
}

impl TriangleLaw for MembraneCompression {
    const NAME: &'static str = "membrane compression term";
    type Mark = PooledMembrane;
    fn contributes(kind: TangentKind) -> bool {
        kind != TangentKind::Projected
    }
    #[inline(always)]
    fn energy<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> R {
        biquadratic::energy(&compression_only(e), u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &[[R; 3]; 3]) -> [[R; 3]; 3] {
        biquadratic::forces(&compression_only(e), u)
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &[[R; 3]; 3], kind: TangentKind) -> TriangleTangent<R> {
        biquadratic::tangent(&compression_only(e), u, kind)
    }
}
