//! Lumped elements: every pair of vertices of an element is joined by a spring of rest length, and the
//! springs of elements that share a pair are added up ([`crate::laws::quadratic::MassSpring`] is the law on the
//! sums).

use serde::Serialize;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::isoparametric::{HEXAHEDRON_PAIRS, QUAD_PAIRS};
use sinew_engine::row::LocalRow;
use sinew_identify::mesh::{Cells, fit_each};
use sinew_identify::{ElementMethod, IdentifyError, LinearMaterial, Plane, Section};

use crate::body::Model;
use crate::body::matter::Matter;
use crate::body::sheet::{MembraneSettings, PlaneState};
use crate::element::precompute::EDGES;
use crate::material::YoungPoisson;
use std::collections::BTreeMap;

/// Where the constants of lumped springs come from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum SpringRule {
    /// From the material of each element; springs of elements that share a pair of vertices are added up.
    Fitted(ElementMethod),
    /// One constant for all springs.
    Uniform(UniformSprings),
}

impl From<ElementMethod> for SpringRule {
    fn from(method: ElementMethod) -> Self {
        Self::Fitted(method)
    }
}

/// Springs of one stiffness, as in Bourguignon & Cani 2000 (section 1.1 and table 1): a pair of vertices has one
/// spring, however many elements share it. No modulus of a material has a part in them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UniformSprings {
    /// Spring constant (N/m), positive.
    pub constant: f64,
    /// Which pairs of a hexahedron are joined; other elements join all of theirs.
    pub hexahedron: HexahedronSprings,
}

/// Pairs of vertices of a hexahedron that a spring joins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum HexahedronSprings {
    /// All 28.
    #[default]
    All,
    /// Its 12 edges and 4 diagonals in space: 16.
    EdgesAndDiagonals,
}

/// Edges and diagonals in space of a hexahedron.
const EDGES_AND_DIAGONALS: [[usize; 2]; 16] = [
    [0, 1],
    [1, 2],
    [2, 3],
    [0, 3],
    [4, 5],
    [5, 6],
    [6, 7],
    [4, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
    [0, 6],
    [1, 7],
    [2, 4],
    [3, 5],
];

impl UniformSprings {
    /// Whether the constant can be used.
    pub fn is_valid(&self) -> bool {
        self.constant > 0.0 && self.constant.is_finite()
    }

    /// Constants (N/m) of an element in the order of its pairs; 0 where there is no spring.
    fn constants(&self, kind: ElementKind) -> Vec<f64> {
        let all = self.hexahedron == HexahedronSprings::All || kind != ElementKind::Hexahedron;
        let joined = |pair: &[usize; 2]| all || EDGES_AND_DIAGONALS.contains(pair);
        pairs(kind).iter().map(|p| if joined(p) { self.constant } else { 0.0 }).collect()
    }
}

/// Spring constants (N/m) of the elements of a body, in the order of its layout; for each kind empty
/// unless its elements are springs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElementSprings {
    constants: ByKind<Vec<f64>>,
    /// Whether elements that share a pair share one spring, by kind.
    uniform: ByKind<bool>,
}

impl ElementSprings {
    /// Constants (N/m) of an element in the order of [`Connectivity::edges`], none where its kind has no
    /// springs.
    ///
    /// [`Connectivity::edges`]: sinew_engine::connectivity::Connectivity::edges
    pub fn of(&self, kind: ElementKind, element: u32) -> &[f64] {
        let (i, pairs) = (element as usize, pairs(kind).len());
        self.constants[kind].get(pairs * i..pairs * (i + 1)).unwrap_or(&[])
    }

    /// Whether elements of a kind are springs.
    pub fn has(&self, kind: ElementKind) -> bool {
        !self.constants[kind].is_empty()
    }

    /// Whether elements of a kind share one spring where they share a pair of vertices; else each has its own.
    pub fn is_uniform(&self, kind: ElementKind) -> bool {
        self.uniform[kind]
    }

    /// Whether there are any springs.
    pub fn is_empty(&self) -> bool {
        ElementKind::ALL.iter().all(|&kind| !self.has(kind))
    }
}

/// Spring constants that were found elsewhere, element by element, in place of those of a fit.
///
/// Elements are known by their vertices, so that their order and that of their corners do not matter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GivenSprings(BTreeMap<(ElementKind, Vec<u32>), Vec<([u32; 2], f64)>>);

impl GivenSprings {
    /// Gives an element of these vertices of the user's mesh the constants (N/m) of its pairs: first with second,
    /// first with third, and so on.
    pub fn add(&mut self, kind: ElementKind, vertices: &[u32], constants: &[f64]) {
        let pairs = (0..vertices.len()).flat_map(|i| {
            vertices[i + 1..].iter().map(move |&b| [vertices[i].min(b), vertices[i].max(b)])
        });
        let list = pairs.zip(constants.iter().copied()).collect();
        self.0.insert((kind, ascending(vertices.to_vec())), list);
    }

    /// Whether an element has constants.
    pub fn has(&self, kind: ElementKind, vertices: &[u32]) -> bool {
        self.0.contains_key(&(kind, ascending(vertices.to_vec())))
    }

    /// Constant (N/m) of a pair of the vertices of an element, 0 where none is given.
    fn constants(&self, kind: ElementKind, vertices: &[u32]) -> impl Iterator<Item = f64> {
        let list = self.0.get(&(kind, ascending(vertices.to_vec())));
        pairs(kind).iter().map(move |pair| {
            let [a, b] = pair.map(|i| vertices[i]);
            let own = list.and_then(|l| l.iter().find(|(p, _)| *p == [a.min(b), a.max(b)]));
            own.map_or(0.0, |(_, constant)| *constant)
        })
    }
}

fn ascending(mut vertices: Vec<u32>) -> Vec<u32> {
    vertices.sort_unstable();
    vertices
}

/// Local vertices of the pairs of an element that are joined.
fn pairs(kind: ElementKind) -> &'static [[usize; 2]] {
    match kind {
        ElementKind::Tetrahedron => &EDGES,
        // edge i of a triangle lies opposite vertex i
        ElementKind::Triangle => &[[1, 2], [2, 0], [0, 1]],
        ElementKind::Hexahedron => &HEXAHEDRON_PAIRS,
        ElementKind::Quad => &QUAD_PAIRS,
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

impl Matter<'_> {
    /// Spring constants of all elements that are springs.
    pub(crate) fn element_springs(&self) -> Result<ElementSprings, SpringsError> {
        let mut springs = ElementSprings::default();
        let (lists, none) = (self.ordered.elements(), Cells::default());
        for kind in ElementKind::ALL {
            let (cells, of_sheet, usual) = match kind {
                ElementKind::Tetrahedron => {
                    let cells = Cells { tetrahedra: lists.tetrahedra, ..none };
                    (cells, false, ElementMethod::PaperA)
                }
                ElementKind::Triangle => {
                    (Cells { triangles: lists.membrane, ..none }, true, ElementMethod::PaperA)
                }
                ElementKind::Hexahedron => {
                    (Cells { hexahedra: lists.hexahedra, ..none }, false, ElementMethod::Frobenius)
                }
                ElementKind::Quad => {
                    (Cells { quads: lists.quads, ..none }, true, ElementMethod::Frobenius)
                }
            };
            let sheet = self.mass_spring_sheet();
            let is_spring =
                if of_sheet { sheet.is_some() } else { self.model == Model::MassSpring };
            if !is_spring || cells.is_empty() {
                continue;
            }
            if let Some(given) = self.given {
                let user = |row: &u32| self.ordered.vertex_order[LocalRow(*row)].0;
                let of = |e: usize| cells.element(e).2.iter().map(user).collect::<Vec<_>>();
                springs.constants[kind] = (0..cells.len())
                    .flat_map(|e| given.constants(kind, &of(e)).collect::<Vec<_>>())
                    .collect();
                continue;
            }
            let rule = sheet.filter(|_| of_sheet).map_or(self.spring_rule, |sheet| sheet.springs);
            if let Some(SpringRule::Uniform(uniform)) = rule {
                springs.uniform[kind] = true;
                springs.constants[kind] = uniform.constants(kind).repeat(cells.len());
                continue;
            }
            let (materials, section) = match sheet.filter(|_| of_sheet) {
                Some(sheet) => (vec![linear(sheet.material)], section(&sheet)),
                None => {
                    let of = |e| linear(self.material(kind, e as u32));
                    let materials = (0..cells.len()).map(of).collect();
                    (materials, Section::default())
                }
            };
            let method = match rule {
                Some(SpringRule::Fitted(method)) => method,
                _ => usual,
            };
            springs.constants[kind] =
                self.constants(&cells, &materials, &section, method).map_err(|(e, source)| {
                    let index = self.ordered.order(kind)[e] as usize;
                    SpringsError { kind, index, method, source: Box::new(source) }
                })?;
        }
        if self.given.is_none() {
            // fits come in lexicographic order
            springs.constants[ElementKind::Triangle].chunks_exact_mut(3).for_each(<[f64]>::reverse);
        }
        Ok(springs)
    }

    /// Constants (N/m) of elements of one kind; on failure the element, in the order of the layout.
    fn constants(
        &self,
        cells: &Cells,
        materials: &[LinearMaterial],
        section: &Section,
        method: ElementMethod,
    ) -> Result<Vec<f64>, (usize, IdentifyError)> {
        let rows = (0..cells.len()).flat_map(|i| cells.element(i).2);
        let last = rows.max().copied().unwrap_or(0);
        let points: Vec<[f64; 3]> = (0..=last).map(|row| (self.rest_of)(row).to_array()).collect();
        let fits = fit_each(&points, cells, materials, section, method).map_err(|source| {
            let index = if let IdentifyError::Element { index, .. } = source { index } else { 0 };
            (index, source)
        })?;
        Ok((0..cells.len()).flat_map(|i| &fits.of(i).constants).copied().collect())
    }
}

fn linear(material: YoungPoisson) -> LinearMaterial {
    let YoungPoisson { young_modulus, poisson_ratio, .. } = material;
    LinearMaterial { youngs_modulus: young_modulus, poissons_ratio: poisson_ratio }
}

fn section(sheet: &MembraneSettings) -> Section {
    let plane = match sheet.plane {
        PlaneState::Stress => Plane::Stress,
        PlaneState::Strain => Plane::Strain,
    };
    Section { plane, thickness: sheet.thickness }
}
