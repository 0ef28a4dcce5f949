//! Lumped elements: every pair of vertices of an element is joined by a spring of rest length, and the
//! springs of elements that share a pair are added up ([`crate::laws::quadratic::MassSpring`] is the law on the
//! sums).

use glam::DVec3;
use sinew_engine::connectivity::{Connectivity, ElementKind};
use sinew_engine::layout::{BodyLayout, ElementLists};
use sinew_engine::scalar::sub;

use sinew_identify::mesh::{Cells, fit_each};
use sinew_identify::{ElementMethod, IdentifyError, LinearMaterial, Plane, Section};

use crate::body::sheet::{MembraneSettings, PlaneState};
use crate::element::spring::tensile_energy;
use crate::laws::quadratic::Stretch;
use crate::material::YoungPoisson;

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

    /// Adds all to `sums` (N/m), one for each edge of the layout.
    pub(crate) fn add_to(&self, layout: &BodyLayout, sums: &mut [f64]) {
        let mut add = |edges: &[u32], constants: &[f64]| {
            for (&edge, k) in edges.iter().zip(constants) {
                sums[edge as usize] += k;
            }
        };
        layout.tetrahedron_edges.iter().zip(&self.tetrahedra).for_each(|(e, k)| add(e, k));
        layout.membrane_edges.iter().zip(&self.triangles).for_each(|(e, k)| add(e, k));
        layout.hexahedron_edges.iter().zip(&self.hexahedra).for_each(|(e, k)| add(e, k));
        layout.quad_edges.iter().zip(&self.quads).for_each(|(e, k)| add(e, k));
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

/// What the springs of a body follow from.
pub(crate) struct Sources<'a> {
    /// Elements by vertex rows, in the order of the layout.
    pub elements: ElementLists<'a>,
    /// Rest position (m) of a vertex row.
    pub rest_of: &'a dyn Fn(u32) -> DVec3,
    /// Material of each tetrahedron, then of each hexahedron, and the method, if they are springs.
    pub solid: Option<(&'a dyn Fn(usize) -> YoungPoisson, Option<ElementMethod>)>,
    /// The membrane, if its elements are springs.
    pub sheet: Option<MembraneSettings>,
}

/// An element whose springs cannot be found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("no spring constants for {} {index} by method \"{method}\": {source}", .kind.name())]
pub struct SpringsError {
    /// Kind of the element.
    pub kind: ElementKind,
    /// Index in the user's mesh.
    pub index: usize,
    /// The method.
    pub method: ElementMethod,
    /// What is wrong.
    pub source: Box<IdentifyError>,
}

impl Sources<'_> {
    /// Spring constants of all elements that are springs; `user` tells the user's index of an element.
    pub fn springs(
        &self,
        user: impl Fn(ElementKind, usize) -> usize,
    ) -> Result<ElementSprings, SpringsError> {
        let mut springs = ElementSprings::default();
        let lists = &self.elements;
        let error = |kind, method| {
            let user = &user;
            move |index: usize, source| {
                let index = user(kind, index);
                SpringsError { kind, index, method, source: Box::new(source) }
            }
        };
        if let Some((material, method)) = self.solid {
            let linear = |element: usize| {
                let m = material(element);
                LinearMaterial { youngs_modulus: m.young_modulus, poissons_ratio: m.poisson_ratio }
            };
            let section = Section::default();
            let of = method.unwrap_or(ElementMethod::PaperA);
            let materials: Vec<_> = (0..lists.tetrahedra.len()).map(linear).collect();
            springs.tetrahedra = constants(
                &Cells { tetrahedra: lists.tetrahedra, ..Cells::default() },
                self,
                &materials,
                &section,
                of,
            )
            .map_err(|(i, e)| error(ElementKind::Tetrahedron, of)(i, e))?;
            let of = method.unwrap_or(ElementMethod::Frobenius);
            let first = lists.tetrahedra.len();
            let materials: Vec<_> = (0..lists.hexahedra.len()).map(|h| linear(first + h)).collect();
            springs.hexahedra = constants(
                &Cells { hexahedra: lists.hexahedra, ..Cells::default() },
                self,
                &materials,
                &section,
                of,
            )
            .map_err(|(i, e)| error(ElementKind::Hexahedron, of)(i, e))?;
        }
        if let Some(sheet) = self.sheet {
            let material = LinearMaterial {
                youngs_modulus: sheet.material.young_modulus,
                poissons_ratio: sheet.material.poisson_ratio,
            };
            let plane = match sheet.plane {
                PlaneState::Stress => Plane::Stress,
                PlaneState::Strain => Plane::Strain,
            };
            let section = Section { plane, thickness: sheet.thickness };
            let of = sheet.springs.unwrap_or(ElementMethod::PaperA);
            let lexicographic: Vec<[f64; 3]> = constants(
                &Cells { triangles: lists.membrane, ..Cells::default() },
                self,
                &[material],
                &section,
                of,
            )
            .map_err(|(i, e)| error(ElementKind::Triangle, of)(i, e))?;
            // edge i of a triangle lies opposite vertex i
            springs.triangles = lexicographic.into_iter().map(|[c, b, a]| [a, b, c]).collect();
            let of = sheet.springs.unwrap_or(ElementMethod::Frobenius);
            springs.quads = constants(
                &Cells { quads: lists.quads, ..Cells::default() },
                self,
                &[material],
                &section,
                of,
            )
            .map_err(|(i, e)| error(ElementKind::Quad, of)(i, e))?;
        }
        Ok(springs)
    }
}

/// Constants (N/m) of elements of one kind; on failure the element, in the order of the layout.
fn constants<const P: usize>(
    cells: &Cells,
    sources: &Sources,
    materials: &[LinearMaterial],
    section: &Section,
    method: ElementMethod,
) -> Result<Vec<[f64; P]>, (usize, IdentifyError)> {
    if cells.is_empty() {
        return Ok(Vec::new());
    }
    let rows = (0..cells.len()).flat_map(|i| cells.element(i).2);
    let last = rows.max().copied().unwrap_or(0);
    let points: Vec<[f64; 3]> = (0..=last).map(|row| (sources.rest_of)(row).to_array()).collect();
    let fits = fit_each(&points, cells, materials, section, method).map_err(|source| {
        let index = if let IdentifyError::Element { index, .. } = source { index } else { 0 };
        (index, source)
    })?;
    let own = |i: usize| {
        let mut own = [0.0; P];
        own.copy_from_slice(&fits.of(i).constants);
        own
    };
    Ok((0..cells.len()).map(own).collect())
}
