//! Springs of a whole mesh.
//!
//! Elements are fitted in parallel, congruent ones of the same material once. Springs on the same pair
//! of nodes are added up in the order of the elements, so the result has the same bits for any number
//! of threads.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cells::Cells;
use crate::error::IdentifyError;
use crate::fit::ElementFit;
use crate::geometry::{norm, sub};
use crate::kind::{ElementKind, ElementMethod};
use crate::mass::{MassLumping, lumped_masses};
use crate::material::{LinearMaterial, Section};
use crate::method::fit_element;
use crate::springs::pairs;

/// Elements whose distances between nodes agree to this part of their size are congruent.
const CONGRUENT: f64 = 1e-12;
/// Width of a bucket of the search for congruent elements, in the logarithm of the sum of distances.
const BUCKET: f64 = 1e-10;
/// Residual below which springs meet an element exactly.
const EXACT: f64 = 1e-12;
/// Pooled constants below this part of the largest count as negative.
const NEGATIVE: f64 = 1e-9;

/// Springs of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedSprings {
    /// Pairs of nodes, each sorted, in lexicographic order, without repetition.
    pub edges: Vec<[u32; 2]>,
    /// Constants (N/m), one to an edge: sums over the elements round it. Some methods leave some at 0.
    pub constants: Vec<f64>,
    /// What came out.
    pub report: FitReport,
}

impl FittedSprings {
    /// Puts other constants (N/m), one to an edge, in the place of these; what the report says of sums is that of the new ones.
    pub fn set_constants(&mut self, constants: Vec<f64>) {
        (self.report.negative_edges, self.report.least_constant) = negative_and_least(&constants);
        self.constants = constants;
    }
}

/// How many sums are negative, and the least.
fn negative_and_least(constants: &[f64]) -> (usize, f64) {
    let largest = constants.iter().fold(0f64, |m, k| m.max(k.abs()));
    let negative = constants.iter().filter(|&&k| k < -NEGATIVE * largest).count();
    (negative, constants.iter().copied().fold(f64::INFINITY, f64::min))
}

/// How a fit of a mesh went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Method.
    pub method: ElementMethod,
    /// Whether the formula was recalled and not read in its original text ([`ElementMethod::recalled`]).
    pub recalled: bool,
    /// Elements.
    pub elements: usize,
    /// Fits that were computed: elements that are not congruent to an earlier one.
    pub distinct_fits: usize,
    /// Constants of single elements, over all elements.
    pub element_constants: usize,
    /// Those of them that are negative.
    pub negative_element_constants: usize,
    /// Edges whose sum is negative.
    pub negative_edges: usize,
    /// Least sum of an edge, N/m.
    pub least_constant: f64,
    /// `|R - K|_F / |R|_F` over the elements.
    pub frobenius_residual: Residuals,
    /// `|R - K|_2 / |R|_2` over the elements.
    pub two_norm_residual: Residuals,
    /// 2-norm fits: largest relative distance between norm and lower bound, elements that springs meet
    /// exactly left out.
    pub worst_certificate_gap: Option<f64>,
    /// 2-norm fits: elements whose constants the least norm does not determine
    /// ([`ElementFit::two_norm_freedom`]).
    #[serde(default)]
    pub not_unique: Option<usize>,
    /// Largest distance of a node from the mean plane of its triangle or quadrilateral, relative to the
    /// element's size.
    pub worst_off_plane: f64,
}

/// A residual over all elements.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub worst: f64,
    /// Element that has it, counted over all kinds in the order of [`Cells`].
    pub worst_element: usize,
}

impl Residuals {
    fn new(values: impl ExactSizeIterator<Item = f64>) -> Self {
        let count = values.len() as f64;
        let mut sum = 0.0;
        let (mut worst, mut worst_element) = (f64::NEG_INFINITY, 0);
        for (element, value) in values.enumerate() {
            sum += value;
            if value > worst {
                (worst, worst_element) = (value, element);
            }
        }
        Self { mean: sum / count, worst, worst_element }
    }
}

/// Finds the springs of a mesh.
///
/// `points` (m) are rest positions, `materials` one for all elements or one for each (in the order of
/// [`Cells`]), `section` that of plane elements.
///
/// # Errors
/// [`IdentifyError`], naming the first element (in order) that cannot be fitted and what to do.
///
/// ```
/// use sinew_identify::cells::Cells;
/// use sinew_identify::mesh::fit_elements;
/// use sinew_identify::{ElementMethod, LinearMaterial, Section};
///
/// // two cubes of 1 m side by side
/// let points: Vec<[f64; 3]> =
///     (0..12).map(|i| [(i % 3) as f64, (i / 3 % 2) as f64, (i / 6) as f64]).collect();
/// let hexahedra = [[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]];
/// let cells = Cells { hexahedra: &hexahedra, ..Cells::default() };
/// let material = [LinearMaterial::new(1.0, 0.25)?];
/// let springs =
///     fit_elements(&points, &cells, &material, &Section::default(), ElementMethod::Baudet)?;
/// assert_eq!(springs.edges.len(), 28 + 28 - 6);
/// assert_eq!(springs.report.distinct_fits, 1);
/// let shared = springs.edges.iter().position(|e| *e == [1, 7]).unwrap();
/// assert!((springs.constants[shared] - 2.0 * 0.2).abs() < 1e-15);
/// # Ok::<(), sinew_identify::IdentifyError>(())
/// ```
pub fn fit_elements(
    points: &[[f64; 3]],
    cells: &Cells<'_>,
    materials: &[LinearMaterial],
    section: &Section,
    method: ElementMethod,
) -> Result<FittedSprings, IdentifyError> {
    Ok(fit_each(points, cells, materials, section, method)?.pooled(cells, method))
}

/// Fits of the elements of a mesh, shared by congruent ones.
#[derive(Clone, Debug)]
pub struct ElementFits {
    fits: Vec<ElementFit>,
    fit_of: Vec<usize>,
    shapes: Vec<Shape>,
}

impl ElementFits {
    /// Fit of an element, counted over all kinds in the order of [`Cells`]; its constants are in the
    /// lexicographic order of pairs.
    pub fn of(&self, element: usize) -> &ElementFit {
        &self.fits[self.fit_of[element]]
    }

    /// The springs of all elements, those on the same pair of nodes added up: what [`fit_elements`]
    /// gives. `cells` and `method` are those of [`fit_each`].
    pub fn pooled(&self, cells: &Cells<'_>, method: ElementMethod) -> FittedSprings {
        let (edges, constants) = pool(cells, &self.fits, &self.fit_of);
        let report = report(method, &self.shapes, &self.fits, &self.fit_of, &constants);
        FittedSprings { edges, constants, report }
    }
}

/// Finds the springs of each element of a mesh; arguments and errors as in [`fit_elements`], which adds them up.
///
/// # Errors
/// As [`fit_elements`].
pub fn fit_each(
    points: &[[f64; 3]],
    cells: &Cells<'_>,
    materials: &[LinearMaterial],
    section: &Section,
    method: ElementMethod,
) -> Result<ElementFits, IdentifyError> {
    let count = cells.len();
    if count == 0 {
        return Err(IdentifyError::NoElements);
    }
    if materials.len() != 1 && materials.len() != count {
        return Err(IdentifyError::MaterialCount { given: materials.len(), elements: count });
    }
    let material = |element: usize| &materials[if materials.len() == 1 { 0 } else { element }];
    let shapes = first_error(
        (0..count)
            .into_par_iter()
            .map(|element| Shape::new(points, cells, element))
            .collect::<Vec<_>>(),
    )?;
    let (representatives, fit_of) = congruence_classes(cells, &shapes, material);
    let fits = first_error(
        representatives
            .par_iter()
            .map(|&element| {
                let geometry = cells.geometry(points, element)?;
                fit_element(&geometry, material(element), section, method)
                    .map_err(|source| cells.locate(element, source))
            })
            .collect::<Vec<_>>(),
    )?;
    Ok(ElementFits { fits, fit_of, shapes })
}

/// Masses (kg) of the nodes of a mesh of density `density` (kg/m^3), summed over the elements.
///
/// # Errors
/// As [`fit_elements`], and [`ElementError::Density`](crate::ElementError::Density).
///
/// ```
/// use sinew_identify::mass::MassLumping;
/// use sinew_identify::cells::Cells;
/// use sinew_identify::mesh::mesh_masses;
/// use sinew_identify::Section;
///
/// let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let cells = Cells { triangles: &[[0, 1, 2], [0, 2, 3]], ..Cells::default() };
/// let masses = mesh_masses(&points, &cells, 6.0, &Section::default(), MassLumping::RowSum)?;
/// for (mass, expected) in masses.iter().zip([2.0, 1.0, 2.0, 1.0]) {
///     assert!((mass - expected).abs() < 1e-14);
/// }
/// # Ok::<(), sinew_identify::IdentifyError>(())
/// ```
pub fn mesh_masses(
    points: &[[f64; 3]],
    cells: &Cells<'_>,
    density: f64,
    section: &Section,
    lumping: MassLumping,
) -> Result<Vec<f64>, IdentifyError> {
    let mut masses = vec![0.0; points.len()];
    for element in 0..cells.len() {
        let geometry = cells.geometry(points, element)?;
        let shares = lumped_masses(&geometry, density, section, lumping)
            .map_err(|source| cells.locate(element, source))?;
        for (&node, share) in cells.element(element).2.iter().zip(shares) {
            masses[node as usize] += share;
        }
    }
    Ok(masses)
}

/// What congruence and the report need of an element.
#[derive(Clone, Debug)]
struct Shape {
    lengths: [f64; 28],
    size: f64,
    off_plane: f64,
}

impl Shape {
    fn new(points: &[[f64; 3]], cells: &Cells<'_>, element: usize) -> Result<Self, IdentifyError> {
        let geometry = cells.geometry(points, element)?;
        let (_, _, nodes) = cells.element(element);
        let mut lengths = [0.0; 28];
        for (length, (a, b)) in lengths.iter_mut().zip(pairs(nodes.len())) {
            *length = norm(sub(points[nodes[a] as usize], points[nodes[b] as usize]));
        }
        let size = geometry.size();
        Ok(Self { lengths, size, off_plane: geometry.off_plane() / size })
    }

    fn congruent(&self, other: &Self) -> bool {
        let allowed = CONGRUENT * self.size;
        self.lengths.iter().zip(&other.lengths).all(|(a, b)| (a - b).abs() <= allowed)
    }
}

/// The first error in the order of the elements, whatever thread met one first.
fn first_error<T>(results: Vec<Result<T, IdentifyError>>) -> Result<Vec<T>, IdentifyError> {
    results.into_iter().collect()
}

/// Elements to be fitted, and for every element which of them it is congruent to.
///
/// Buckets hold elements by the sum of their distances; congruent ones are at most one bucket apart.
fn congruence_classes<'m>(
    cells: &Cells<'_>,
    shapes: &[Shape],
    material: impl Fn(usize) -> &'m LinearMaterial,
) -> (Vec<usize>, Vec<usize>) {
    let mut representatives: Vec<usize> = Vec::new();
    let mut buckets: HashMap<(ElementKind, u64, u64, i64), Vec<usize>> = HashMap::new();
    let fit_of = (0..shapes.len())
        .map(|element| {
            let shape = &shapes[element];
            let material = material(element);
            let sum: f64 = shape.lengths.iter().sum();
            let bucket = (sum.ln() / BUCKET).floor() as i64;
            let (e, nu) = (material.youngs_modulus.to_bits(), material.poissons_ratio.to_bits());
            let kind = cells.element(element).0;
            let known = (bucket - 1..=bucket + 1)
                .filter_map(|b| buckets.get(&(kind, e, nu, b)))
                .flatten()
                .copied()
                .find(|&class| shapes[representatives[class]].congruent(shape));
            known.unwrap_or_else(|| {
                let class = representatives.len();
                representatives.push(element);
                buckets.entry((kind, e, nu, bucket)).or_default().push(class);
                class
            })
        })
        .collect();
    (representatives, fit_of)
}

/// Adds up the springs on the same pair of nodes, in the order of the elements.
fn pool(cells: &Cells<'_>, fits: &[ElementFit], fit_of: &[usize]) -> (Vec<[u32; 2]>, Vec<f64>) {
    let mut springs: Vec<([u32; 2], f64)> = Vec::new();
    for (element, &fit) in fit_of.iter().enumerate() {
        let (_, _, nodes) = cells.element(element);
        for ((a, b), &k) in pairs(nodes.len()).zip(&fits[fit].constants) {
            springs.push(([nodes[a].min(nodes[b]), nodes[a].max(nodes[b])], k));
        }
    }
    // stable: springs of one pair stay in the order of the elements
    springs.par_sort_by_key(|s| s.0);
    let mut edges: Vec<[u32; 2]> = Vec::new();
    let mut constants: Vec<f64> = Vec::new();
    for (edge, k) in springs {
        if edges.last() == Some(&edge) {
            *constants.last_mut().expect("as many as edges") += k;
        } else {
            edges.push(edge);
            constants.push(k);
        }
    }
    (edges, constants)
}

fn report(
    method: ElementMethod,
    shapes: &[Shape],
    fits: &[ElementFit],
    fit_of: &[usize],
    constants: &[f64],
) -> FitReport {
    let over = |value: fn(&ElementFit) -> f64| {
        Residuals::new(fit_of.iter().map(move |&fit| value(&fits[fit])))
    };
    let (negative_edges, least_constant) = negative_and_least(constants);
    // where the springs are exact, norm and bound are rounding
    let gaps = fits
        .iter()
        .filter(|f| f.two_norm_residual > EXACT)
        .filter_map(|f| f.two_norm_bound.map(|b| (f.two_norm_residual - b) / f.two_norm_residual));
    let freedom = fit_of.iter().map(|&f| fits[f].two_norm_freedom);
    let not_unique = freedom.map(|f| f.map(|f| usize::from(f > 0))).sum();
    FitReport {
        method,
        recalled: method.recalled(),
        elements: shapes.len(),
        distinct_fits: fits.len(),
        element_constants: fit_of.iter().map(|&f| fits[f].constants.len()).sum(),
        negative_element_constants: fit_of.iter().map(|&f| fits[f].negative).sum(),
        negative_edges,
        least_constant,
        frobenius_residual: over(|f| f.frobenius_residual),
        two_norm_residual: over(|f| f.two_norm_residual),
        worst_certificate_gap: gaps.reduce(f64::max),
        not_unique,
        worst_off_plane: shapes.iter().map(|s| s.off_plane).fold(0.0, f64::max),
    }
}
