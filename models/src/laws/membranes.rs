//! Laws of membrane triangles ([`crate::element::membrane`]) and of quadrilaterals at their Gauss points, and two
//! that complete the pooled springs of [`super::pooled`]: the compression term, and the projected tangent, which
//! needs the whole stress of a triangle. Mass-spring membranes are springs on edges
//! ([`MassSpring`](super::quadratic::MassSpring)).

use bevy_ecs::prelude::Component;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Real;

use crate::element::membrane::{
    Element, Nodes, TriangleTangent, biquadratic, corotational, linear, quadratic,
};
use crate::frame::law::TriangleLaw;
use crate::frame::row::LawRow;

/// Laws, each the mark of its triangles too, with their rows in the table of laws.
macro_rules! laws {
    ($($(#[$doc:meta])* $law:ident in $row:ident;)+) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, Default)]
        #[component(clone_behavior = Ignore)]
        pub struct $law;

        #[doc = concat!("Row of [`", stringify!($law), "`] in the table of laws.")]
        pub static $row: LawRow = LawRow::triangles::<$law>();
    )+};
}
laws! {
    /// Biquadratic springs (TRBS), one triangle at a time.
    BiquadraticMembrane in BIQUADRATIC;
    /// Quadratic springs (TRQS).
    QuadraticMembrane in QUADRATIC;
    /// Constant-strain triangles.
    LinearMembrane in LINEAR;
    /// Corotational triangles.
    CorotationalMembrane in COROTATIONAL;
    /// Projected tangent of pooled membranes.
    PooledMembrane in PROJECTION;
    /// The compression term of pooled membranes, an independent law beside their springs, without a mark of its own.
    MembraneCompression in COMPRESSION;
}

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
        fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
            $module::energy(e, u)
        }
        #[inline(always)]
        fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
            $module::forces(e, u)
        }
    };
}

/// Tangents from such a module.
macro_rules! tangent_of {
    ($module:ident) => {
        #[inline(always)]
        fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TriangleTangent<R> {
            $module::tangent(e, u, kind)
        }
        #[inline(always)]
        fn is_clamped<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R::Mask {
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
    fn product<R: Real>(e: &Element<R>, u: &Nodes<R>, v: &Nodes<R>, kind: TangentKind) -> Nodes<R> {
        match kind {
            TangentKind::Projected => biquadratic::tangent(e, u, kind).product(v),
            _ => biquadratic::product(e, u, v, kind == TangentKind::Exact),
        }
    }
}

impl TriangleLaw for QuadraticMembrane {
    const NAME: &'static str = "quadratic membrane";
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    energy_of!(quadratic);
    tangent_of!(quadratic);
}

impl TriangleLaw for LinearMembrane {
    const WIDE: bool = false;
    const NAME: &'static str = "linear membrane";
    const HOLDS_PRESSURE: bool = false;
    type Mark = Self;
    energy_of!(linear);
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, _: &Nodes<R>, _: TangentKind) -> TriangleTangent<R> {
        linear::tangent(e)
    }
}

impl TriangleLaw for CorotationalMembrane {
    const WIDE: bool = false;
    const NAME: &'static str = "corotational membrane";
    const HOLDS_PRESSURE: bool = false;
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
    fn energy<R: Real>(_: &Element<R>, _: &Nodes<R>) -> R {
        R::ZERO
    }
    #[inline(always)]
    fn forces<R: Real>(_: &Element<R>, _: &Nodes<R>) -> Nodes<R> {
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
    fn energy<R: Real>(e: &Element<R>, u: &Nodes<R>) -> R {
        biquadratic::energy(&compression_only(e), u)
    }
    #[inline(always)]
    fn forces<R: Real>(e: &Element<R>, u: &Nodes<R>) -> Nodes<R> {
        biquadratic::forces(&compression_only(e), u)
    }
    #[inline(always)]
    fn tangent<R: Real>(e: &Element<R>, u: &Nodes<R>, kind: TangentKind) -> TriangleTangent<R> {
        biquadratic::tangent(&compression_only(e), u, kind)
    }
}
