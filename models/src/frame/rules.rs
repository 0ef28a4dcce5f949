//! What a body may choose beside its law: what keeps its volume, and how its energy is summed.

use serde::{Deserialize, Serialize};
use sinew_engine::element::volume_change;
use sinew_engine::scalar::Real;

use super::row::Elements;
use crate::element::corotational::{Polar, rotation};
use crate::element::matrix::add_identity;
use crate::element::tetrahedron::{Element, cofactor};

/// What keeps its volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VolumeRule {
    /// Every element, a hexahedron or ten-node tetrahedron at each of its points (default): it locks towards nu = 0.5.
    #[default]
    Elements,
    /// Means: those of clusters of linear tetrahedra ([`super::clusters`]), and those of the points of single hexahedra and
    /// ten-node tetrahedra ([`super::hexahedra`]).
    Clusters,
}

/// How the energy of hexahedra is integrated; other elements have one rule.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Integration {
    /// Over 2x2x2 Gauss points (default): stiff in bending on coarse meshes.
    #[default]
    Full,
    /// One evaluation for the mean deformation, and an energy that holds the hourglass modes ([`super::reduced`]): right in bending
    /// from two elements across a body on, and cheaper. One element across is up to a fifth too soft.
    Reduced,
}

impl Integration {
    /// What hexahedra integrated so are in rows of laws.
    pub fn hexahedra(self) -> Elements {
        match self {
            Self::Full => Elements::Hexahedra,
            Self::Reduced => Elements::ReducedHexahedra,
        }
    }
}

/// How the energy is summed; the result is the same to rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Evaluation {
    /// One pass over tetrahedra (default, the faster one).
    #[default]
    Fused,
    /// Independent systems over edges, triangles and tetrahedra.
    Pooled,
}

/// The change of volume `m` that the volume term of a law is a function of, from `G = F - I`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VolumeMeasure {
    /// `J - 1`.
    #[default]
    Jacobian,
    /// `tr G`, which the turning of an element changes.
    TraceOfStrain,
    /// `tr S - 3` with the polar decomposition `F = R S`.
    TraceOfStretch,
}

impl VolumeMeasure {
    /// `m`.
    #[inline(always)]
    pub fn change<R: Real>(self, g: &[R; 9]) -> R {
        match self {
            Self::Jacobian => volume_change(g),
            Self::TraceOfStrain => g[0] + g[4] + g[8],
            Self::TraceOfStretch => Polar::new(g).trace(),
        }
    }

    /// `dm/dF`, row-major.
    #[inline(always)]
    pub fn slope<R: Real>(self, g: &[R; 9]) -> [R; 9] {
        match self {
            Self::Jacobian => cofactor(g),
            Self::TraceOfStrain => {
                let mut identity = [R::ZERO; 9];
                add_identity(&mut identity, R::ONE);
                identity
            }
            Self::TraceOfStretch => rotation(g),
        }
    }
}

/// Part of `lambda` that stays with every element.
#[inline(always)]
fn own_part<R: Real>(lambda: R, mu: R) -> R {
    lambda.min(R::from_f64(0.25) * mu)
}

/// Part of `lambda` that acts on the mean of the cluster.
pub(crate) fn shared_part(lambda: f64, mu: f64) -> f64 {
    lambda - own_part(lambda, mu)
}

/// An element as the laws see it: without the part of `lambda` that its cluster has. `lambda/mu` is 9 at nu = 0.45.
#[inline(always)]
pub(crate) fn in_cluster<R: Real>(e: Element<R>) -> Element<R> {
    let stiff = R::less(R::from_f64(8.999) * e.mu, e.lambda);
    let quartic = R::select(stiff, R::from_f64(10.0) * e.mu, R::ZERO);
    Element { lambda: own_part(e.lambda, e.mu), quartic, ..e }
}
