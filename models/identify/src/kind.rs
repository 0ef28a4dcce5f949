//! Kinds of elements, and methods for them by name.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Kind of element, all with linear (bilinear, trilinear) shape functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ElementKind {
    /// 3 nodes, plane.
    Triangle,
    /// 4 nodes, plane.
    Quad,
    /// 4 nodes, solid.
    Tetrahedron,
    /// 8 nodes, solid.
    Hexahedron,
}

impl ElementKind {
    /// All kinds, in the order in which meshes list them.
    pub const ALL: [Self; 4] = [Self::Triangle, Self::Quad, Self::Tetrahedron, Self::Hexahedron];

    /// Number of nodes: 3, 4, 4, 8.
    pub const fn nodes(self) -> usize {
        match self {
            Self::Triangle => 3,
            Self::Quad | Self::Tetrahedron => 4,
            Self::Hexahedron => 8,
        }
    }

    /// Dimension of the element: 2 or 3.
    pub const fn dimension(self) -> usize {
        match self {
            Self::Triangle | Self::Quad => 2,
            Self::Tetrahedron | Self::Hexahedron => 3,
        }
    }
}

impl fmt::Display for ElementKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Triangle => "triangle",
            Self::Quad => "quadrilateral",
            Self::Tetrahedron => "tetrahedron",
            Self::Hexahedron => "hexahedron",
        })
    }
}

/// How spring constants of an element are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ElementMethod {
    /// Full Frobenius fit, [`frobenius`](mod@crate::fit::frobenius).
    #[default]
    Frobenius,
    /// Off-diagonal blocks, [`block`](mod@crate::fit::block).
    Block,
    /// Induced 2-norm fit with certificate, [`two_norm`](mod@crate::fit::two_norm).
    TwoNorm,
    /// Non-negative Frobenius fit, [`nonnegative`](mod@crate::fit::nonnegative).
    Nonnegative,
    /// Non-negative 2-norm fit with certificate, [`two_norm`](mod@crate::fit::two_norm).
    TwoNormNonnegative,
    /// Van Gelder's simple formula, [`baselines`](crate::baselines).
    VanGelder,
    /// Van Gelder's formula with Poisson's ratio, [`baselines`](crate::baselines).
    VanGelderFull,
    /// Lloyd et al., [`baselines`](crate::baselines).
    Lloyd,
    /// Baudet et al., [`baselines`](crate::baselines).
    Baudet,
    /// Tensile springs of Delingette 2008, [`baselines`](crate::baselines).
    #[serde(alias = "paper-a")]
    Delingette,
}

impl ElementMethod {
    /// All methods.
    pub const ALL: [Self; 10] = [
        Self::Frobenius,
        Self::Block,
        Self::TwoNorm,
        Self::Nonnegative,
        Self::TwoNormNonnegative,
        Self::VanGelder,
        Self::VanGelderFull,
        Self::Lloyd,
        Self::Baudet,
        Self::Delingette,
    ];

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frobenius => "frobenius",
            Self::Block => "block",
            Self::TwoNorm => "two-norm",
            Self::Nonnegative => "nonnegative",
            Self::TwoNormNonnegative => "two-norm-nonnegative",
            Self::VanGelder => "van-gelder",
            Self::VanGelderFull => "van-gelder-full",
            Self::Lloyd => "lloyd",
            Self::Baudet => "baudet",
            Self::Delingette => "delingette",
        }
    }

    /// Name that it had before, which is still read.
    pub const fn old_name(self) -> Option<&'static str> {
        match self {
            Self::Delingette => Some("paper-a"),
            _ => None,
        }
    }

    /// Whether the formula was recalled from the literature and not read in its original text: reports
    /// should say so.
    pub const fn recalled(self) -> bool {
        matches!(self, Self::VanGelder | Self::VanGelderFull | Self::Lloyd | Self::Baudet)
    }

    /// Whether there is a formula for elements of `kind`. Baudet's further needs rectangles or cubes.
    ///
    /// ```
    /// use sinew_identify::{ElementKind, ElementMethod};
    ///
    /// assert!(ElementMethod::Frobenius.serves(ElementKind::Hexahedron));
    /// assert!(!ElementMethod::Lloyd.serves(ElementKind::Hexahedron));
    /// ```
    pub const fn serves(self, kind: ElementKind) -> bool {
        use ElementKind::{Hexahedron, Quad, Tetrahedron, Triangle};
        match self {
            Self::Frobenius
            | Self::Block
            | Self::TwoNorm
            | Self::Nonnegative
            | Self::TwoNormNonnegative => true,
            Self::VanGelder | Self::Delingette => matches!(kind, Triangle | Tetrahedron),
            Self::VanGelderFull => matches!(kind, Triangle),
            Self::Lloyd => matches!(kind, Triangle | Quad | Tetrahedron),
            Self::Baudet => matches!(kind, Quad | Hexahedron),
        }
    }
}

impl fmt::Display for ElementMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
