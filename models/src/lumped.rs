//! Lumped elements: every pair of vertices of an element is joined by a spring of rest length, and the
//! springs of elements that share a pair are added up ([`crate::quadratic::MassSpring`] is the law on the
//! sums).

use glam::DVec3;
use sinew_engine::connectivity::{Connectivity, ElementKind};
use sinew_engine::layout::ElementLists;
use sinew_engine::scalar::sub;

use crate::material::{LameParameters, YoungPoisson};
use crate::membrane::{self, RestTriangle};
use crate::precompute::{EDGES, RestTetrahedron, SpringConstants};
use crate::quadratic::Stretch;
use crate::sheet::MembraneSettings;
use crate::spring::tensile_energy;

/// Spring constants (N/m) of the elements of a body, in the order of its layout; for each kind empty
/// unless its elements are springs. Pairs are in the order of [`Connectivity::edges`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElementSprings {
    /// Of tetrahedra.
    pub tetrahedra: Vec<[f64; 6]>,
    /// Of membrane triangles.
    pub triangles: Vec<[f64; 3]>,
    /// Of hexahedra.
    pub hexahedra: Vec<[f64; 28]>,
    /// Of membrane quadrilaterals.
    pub quads: Vec<[f64; 6]>,
}

impl ElementSprings {
    /// Constants (N/m) of an element, none where its kind has no springs.
    pub fn of(&self, kind: ElementKind, element: u32) -> &[f64] {
        let i = element as usize;
        match kind {
            ElementKind::Tetrahedron => self.tetrahedra.get(i).map_or(&[], |k| k),
            ElementKind::Triangle => self.triangles.get(i).map_or(&[], |k| k),
            ElementKind::Hexahedron => self.hexahedra.get(i).map_or(&[], |k| k),
            ElementKind::Quad => self.quads.get(i).map_or(&[], |k| k),
        }
    }

    /// Whether elements of a kind are springs.
    pub fn has(&self, kind: ElementKind) -> bool {
        match kind {
            ElementKind::Tetrahedron => !self.tetrahedra.is_empty(),
            ElementKind::Triangle => !self.triangles.is_empty(),
            ElementKind::Hexahedron => !self.hexahedra.is_empty(),
            ElementKind::Quad => !self.quads.is_empty(),
        }
    }

    /// Whether there are any springs.
    pub fn is_empty(&self) -> bool {
        ElementKind::ALL.iter().all(|&kind| !self.has(kind))
    }

    /// Sum (N/m) over the elements that are left round an edge.
    pub(crate) fn at_edge(&self, connectivity: &Connectivity, edge: u32) -> f64 {
        let mut sum = 0.0;
        for kind in ElementKind::ALL.into_iter().filter(|&kind| self.has(kind)) {
            for e in connectivity.left(kind, connectivity.round_edge[kind].of(edge)) {
                let own = connectivity.edges(kind, e);
                let local = own.iter().position(|&other| other == edge).unwrap_or(0);
                sum += self.of(kind, e)[local];
            }
        }
        sum
    }

    /// Energy (J) of the springs of an element, from the rest positions (m) and displacements (m) of the
    /// two ends of its pairs.
    pub(crate) fn energy(
        &self,
        kind: ElementKind,
        element: u32,
        ends: impl Fn(usize) -> [([f64; 3], [f64; 3]); 2],
    ) -> f64 {
        let constants = self.of(kind, element).iter().enumerate();
        constants
            .map(|(pair, &constant)| {
                let [(a, ua), (b, ub)] = ends(pair);
                let rest = sub(a, b);
                let change = Stretch::new(rest, sub(ua, ub)).change;
                tensile_energy(tensile_stiffness(constant, rest), change)
            })
            .sum()
    }
}

/// Tensile stiffness (N/m^3) of a spring of constant `constant` (N/m) and rest vector `rest` (m): `k =
/// constant / (2 L^2)`.
pub fn tensile_stiffness(constant: f64, rest: [f64; 3]) -> f64 {
    constant / (2.0 * rest.iter().map(|x| x * x).sum::<f64>())
}

/// Spring constant (N/m) of a tensile stiffness (N/m^3), `2 L^2 k`.
pub fn spring_constant(stiffness: f64, rest: [f64; 3]) -> f64 {
    stiffness * (2.0 * rest.iter().map(|x| x * x).sum::<f64>())
}

/// Where the springs of a body come from.
pub(crate) struct Sources<'a> {
    /// Elements by vertex rows, in the order of the layout.
    pub elements: ElementLists<'a>,
    /// Rest position (m) of a vertex row.
    pub rest_of: &'a dyn Fn(u32) -> DVec3,
    /// Material of each tetrahedron, then of each hexahedron, if they are springs.
    pub solid: Option<&'a dyn Fn(usize) -> YoungPoisson>,
    /// The membrane, if its elements are springs.
    pub sheet: Option<MembraneSettings>,
}
