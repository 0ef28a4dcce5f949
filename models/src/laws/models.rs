//! What the energy of a body can be, by name.

use serde::{Deserialize, Serialize};

use super::{corotational, linear, neo_hookean, quadratic, stvk_fem, svk, svk_volume};
use crate::frame::row::{Elements, LawRow};
use crate::frame::rules::{Evaluation, Integration, VolumeRule};
use crate::material::LameParameters;

/// What a model is made of.
#[derive(Clone, Copy, Debug)]
struct ModelRow {
    name: &'static str,
    /// Law of its tetrahedra; that of its hexahedra stands in the row.
    law: Option<&'static LawRow>,
    /// Whether it has the compression term of Delingette 2008, section 4.
    compression: bool,
    /// Whether its energy can be summed by independent systems over edges, triangles and tetrahedra.
    pooled: bool,
}

macro_rules! models {
    ($($(#[$attribute:meta])* $variant:ident = $name:literal, $law:expr $(, $flag:ident)*;)+) => {
        /// Energy of a body.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
        pub enum Model {
            $($(#[$attribute])* #[serde(rename = $name)] $variant,)+
            /// Nothing but the axes of the body ([`crate::axes`]); of its material only the density counts.
            #[serde(rename = "axes")]
            Axes,
            /// A law of tetrahedra from another crate, by its row. With a row of axes in tetrahedra nothing but these,
            /// as [`Axes`](Self::Axes): that crate spawns them when the body is there.
            #[serde(skip)]
            Own(&'static LawRow),
        }

        impl Model {
            /// All that a material defines, in the order of their documentation; neither
            /// [`Axes`](Self::Axes), which need a description, nor those of other crates.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            fn row(self) -> ModelRow {
                let plain = |name| ModelRow { name, law: None, compression: false, pooled: false };
                match self {
                    $(Self::$variant => ModelRow { law: $law, $($flag: true,)* ..plain($name) },)+
                    Self::Axes => plain("axes"),
                    Self::Own(law) => ModelRow {
                        law: (law.elements == Elements::Tetrahedra).then_some(law),
                        ..plain(law.info.name)
                    },
                }
            }
        }
    };
}
models! {
    /// St Venant-Kirchhoff with the compression term of Delingette 2008, section 4 (default).
    #[default]
    CompressibleStVK = "svk_comp", Some(&svk::TETRAHEDRA), compression, pooled;
    /// St Venant-Kirchhoff (tetrahedral biquadratic springs).
    StVK = "svk", Some(&svk::TETRAHEDRA), pooled;
    /// Tetrahedral quadratic springs ([`crate::laws::quadratic`]): St Venant-Kirchhoff for small strains.
    /// Fused evaluation only; no compression term.
    QuadraticSprings = "tqs", Some(&quadratic::TETRAHEDRA);
    /// Springs on edges alone, the tensile part of the quadratic springs: no material, for
    /// comparison. One pass over edges; nothing resists inversion.
    MassSpring = "mass_spring", None;
    /// Linear elasticity ([`crate::laws::linear`]): small displacements only. For comparison.
    Linear = "linear", Some(&linear::TETRAHEDRA);
    /// Stiffness warping ([`crate::laws::corotational`]): corotational forces, tangent with rotations held.
    /// For comparison.
    WarpedStiffness = "corotational_warped", Some(&corotational::WARPED_TETRAHEDRA);
    /// Corotational elasticity ([`crate::laws::corotational`]). For comparison.
    Corotational = "corotational", Some(&corotational::TETRAHEDRA);
    /// St Venant-Kirchhoff written as in textbooks ([`crate::laws::stvk_fem`]). For comparison of cost.
    StVKFem = "svk_fem", Some(&stvk_fem::TETRAHEDRA);
    /// Stable neo-Hookean ([`crate::laws::neo_hookean`]). For comparison at large strain.
    NeoHookean = "neo_hookean", Some(&neo_hookean::TETRAHEDRA);
    /// St Venant-Kirchhoff shear with a volume term in `J` ([`crate::laws::svk_volume`]): nearly incompressible
    /// solids at large strain.
    StVKVolume = "svk_volume", Some(&svk_volume::TETRAHEDRA);
}

impl Model {
    /// Names of those that have a property, as a remedy lists them: `"a", "b" or "c"`.
    pub(crate) fn names_of(has: impl Fn(Self) -> bool) -> String {
        let names = Self::ALL.into_iter().filter(|&model| has(model));
        let names: Vec<_> = names.map(|model| format!("\"{}\"", model.name())).collect();
        match names.split_last() {
            Some((last, [])) => last.clone(),
            Some((last, others)) => format!("{} or {last}", others.join(", ")),
            None => String::new(),
        }
    }

    /// Name in scene files and reports.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Law of its tetrahedra, if they have one.
    pub fn law(self) -> Option<&'static LawRow> {
        self.row().law
    }

    /// What its law sees of the Lamé parameters of a material: nothing where axes are all that there is.
    pub(crate) fn lame(self, material: LameParameters) -> LameParameters {
        match self {
            Self::Own(law) if law.elements == Elements::Tetrahedra => material,
            Self::Axes | Self::Own(_) => LameParameters { lambda: 0.0, mu: 0.0 },
            _ => material,
        }
    }

    /// Whether it has the compression term of Delingette 2008, section 4.
    pub fn has_compression(self) -> bool {
        self.row().compression
    }

    /// Whether hexahedra have it; the textbook form is that of [`StVK`](Self::StVK) there.
    pub fn serves_hexahedra(self) -> bool {
        self.serves_hexahedra_by(Integration::Full)
    }

    /// Whether hexahedra with this integration have it.
    pub fn serves_hexahedra_by(self, integration: Integration) -> bool {
        // springs, axes
        self.law().is_none() || self.has(integration.hexahedra(), VolumeRule::Elements)
    }

    /// Whether ten-node tetrahedra have it.
    pub fn serves_tetrahedra10(self) -> bool {
        self.has(Elements::Tetrahedra10, VolumeRule::Elements)
    }

    /// Whether its volume term can act on means of several elements or points ([`VolumeRule::Clusters`]).
    pub fn keeps_mean_volume(self) -> bool {
        self.has(Elements::Tetrahedra, VolumeRule::Clusters)
    }

    /// Whether it holds any follower pressure: its energy grows faster than the volume of what is blown up. Others burst from a
    /// pressure of about Young's modulus on.
    pub fn holds_pressure(self) -> bool {
        match self {
            Self::MassSpring => quadratic::EDGE_SPRINGS.holds_pressure,
            _ => self.law().is_none_or(|row| row.holds_pressure),
        }
    }

    /// Whether its resistance to compression has a maximum, and is far too small long before it.
    pub fn softens(self) -> bool {
        self.law().is_some_and(|row| row.softens)
    }

    fn has(self, elements: Elements, volume: VolumeRule) -> bool {
        self.law().is_some_and(|row| row.in_elements(elements, volume).is_some())
    }

    /// Whether the energy can be summed this way. [`Evaluation::Fused`] always can; for
    /// [`MassSpring`](Self::MassSpring) it means its one pass over edges.
    pub fn supports(self, evaluation: Evaluation) -> bool {
        evaluation == Evaluation::Fused || self.row().pooled
    }
}
