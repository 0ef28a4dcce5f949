//! Lumped elements: every pair of vertices of an element is joined by a spring of rest length, and the
//! springs of elements that share a pair are added up ([`crate::laws::quadratic::MassSpring`] is the law on the
//! sums).

use serde::Serialize;
use sinew_engine::connectivity::{ByKind, ElementKind};
use sinew_engine::isoparametric::{HEXAHEDRON_PAIRS, QUAD_PAIRS};
use sinew_engine::layout::BodyElements;
use sinew_identify::ElementMethod;

use crate::element::precompute::EDGES;
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
    pub(super) fn constants(&self, kind: ElementKind) -> Vec<f64> {
        let all = self.hexahedron == HexahedronSprings::All || kind != ElementKind::Hexahedron;
        let joined = |pair: &[usize; 2]| all || EDGES_AND_DIAGONALS.contains(pair);
        pairs(kind).iter().map(|p| if joined(p) { self.constant } else { 0.0 }).collect()
    }
}

/// Spring constants (N/m) of the elements of a body, in the order of its layout; for each kind empty
/// unless its elements are springs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElementSprings {
    pub(super) constants: ByKind<Vec<f64>>,
    /// Whether elements that share a pair share one spring, by kind.
    pub(super) uniform: ByKind<bool>,
    negative: [usize; 2],
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

    /// How many springs have a negative constant, and how many springs there are, those of elements that share a pair of
    /// vertices added up.
    pub fn negative(&self) -> [usize; 2] {
        self.negative
    }

    /// Counts springs for [`negative`](Self::negative); `elements` are those of the layout.
    pub(super) fn count(&mut self, elements: &BodyElements) {
        let mut sums: BTreeMap<[u32; 2], f64> = BTreeMap::new();
        for kind in ElementKind::ALL.into_iter().filter(|kind| self.has(*kind)) {
            let pairs = pairs(kind);
            let each = self.constants[kind].chunks_exact(pairs.len());
            for (rows, constants) in elements.nodes[kind].iter().zip(each) {
                for (pair, k) in pairs.iter().zip(constants) {
                    let [a, b] = pair.map(|i| rows[i]);
                    *sums.entry([a.min(b), a.max(b)]).or_default() += k;
                }
            }
        }
        self.negative = [sums.values().filter(|k| **k < 0.0).count(), sums.len()];
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
    pub(super) fn constants(
        &self,
        kind: ElementKind,
        vertices: &[u32],
    ) -> impl Iterator<Item = f64> {
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
