//! `sinew fit MESH`: springs identified for a mesh, what they are worth, and a file to keep them in.

pub mod assess;
pub mod file;
mod report;
pub mod rig;
pub mod whole;

use assess::{Assessment, assess};
use glam::DVec3;
use rig::{Grips, Rig};
use serde::{Deserialize, Serialize};
use sinew::engine::mesh::{CheckError, CheckOptions, Mesh, MeshError, check};
use sinew_identify::cells::Cells;
use sinew_identify::fit::ConstantRange;
use sinew_identify::mass::MassLumping;
use sinew_identify::mesh::{ElementFits, FitReport, FittedSprings, fit_each, mesh_masses};
use sinew_identify::method::constant_ranges;
use sinew_identify::springs::pairs;
use sinew_identify::virtual_test::VirtualTestError;
use sinew_identify::{ElementError, ElementMethod, IdentifyError, LinearMaterial, Plane, Section};
use std::path::PathBuf;
use whole::{Target, WholeReport, WholeRequest};

pub use sinew_scene::springs::{BodySpring, ElementConstants, SCHEMA};

/// What may fail on the way to springs.
pub type Result<T, E = FitError> = std::result::Result<T, E>;

/// Springs that cannot be found, tested or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A mesh file that cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A mesh that cannot be simulated.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// Springs are for linear elements.
    #[error(
        "{source_name}: springs are fitted to tetrahedra of four vertices, these have ten; take a mesh of first order"
    )]
    SecondOrder {
        /// File.
        source_name: String,
    },
    /// An element, a material or a method.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A virtual test.
    #[error(transparent)]
    Test(#[from] VirtualTestError),
    /// A group that the mesh does not have.
    #[error("{mesh} has no group `{group}`; it has {}", if known.is_empty() { "none".to_string() } else { known.join(", ") })]
    Group {
        /// Mesh.
        mesh: String,
        /// The group asked for.
        group: String,
        /// Groups there are.
        known: Vec<String>,
    },
    /// A group without usable nodes.
    #[error(
        "{mesh}: group `{group}` has no node of an element, so nothing can be held or loaded there; name another"
    )]
    EmptyGroup {
        /// Mesh.
        mesh: String,
        /// The group.
        group: String,
    },
    /// A node at both ends.
    #[error("{mesh}: node {node} (from 0) is both held and loaded; name groups that share no node")]
    SharedNode {
        /// Mesh.
        mesh: String,
        /// Index in the mesh.
        node: u32,
    },
    /// Axis z for a plane body.
    #[error("{mesh} lies in the plane of x and y, so it cannot be pulled along z; choose x or y")]
    Axis {
        /// Mesh.
        mesh: String,
    },
    /// A state that is none.
    #[error(
        "an amplitude is {0}; give positive ones, such as 0.1 for a tenth of the length of the body"
    )]
    Amplitude(f64),
    /// A file that cannot be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        reason: String,
    },
}

impl From<ElementError> for FitError {
    fn from(error: ElementError) -> Self {
        Self::Identify(error.into())
    }
}

/// What is to be fitted.
#[derive(Clone, Debug)]
pub struct FitRequest {
    /// Young's modulus (Pa) and Poisson's ratio.
    pub material: LinearMaterial,
    /// Density (kg/m^3).
    pub density: f64,
    /// Plane state and thickness (m) of triangles and quadrilaterals; solids have none.
    pub section: Section,
    /// How constants are found.
    pub method: ElementMethod,
    /// How the mass of an element is shared among its vertices.
    pub masses: MassLumping,
    /// Ends of the virtual tests.
    pub grips: Grips,
    /// Finds the constants for the body as a whole; without, element by element. Those of `method` are then what it is
    /// compared with.
    pub whole: Option<WholeRequest>,
}

/// A body of springs: what `sinew fit` finds and writes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedBody {
    /// [`SCHEMA`].
    pub schema: String,
    /// File or generator of the mesh.
    pub mesh: String,
    /// How constants were found; a scene that gives this as `element_method` runs the same springs.
    pub method: ElementMethod,
    /// Young's modulus (Pa) that was asked for.
    pub young_modulus: f64,
    /// Poisson's ratio that was asked for.
    pub poisson_ratio: f64,
    /// Density (kg/m^3).
    pub density: f64,
    /// Plane state of triangles and quadrilaterals; solids have none.
    pub plane: Option<Plane>,
    /// Thickness (m) of triangles and quadrilaterals; solids have none.
    pub thickness: Option<f64>,
    /// Springs in lexicographic order of their vertices.
    pub springs: Vec<BodySpring>,
    /// Masses (kg), one for each vertex of the mesh; 0 for vertices without element.
    pub masses: Vec<f64>,
    /// How the mass of an element was shared among its vertices.
    #[serde(default)]
    pub mass_lumping: MassLumping,
    /// Constants of single elements. Of constants of a whole body the elements round a spring have equal parts.
    pub element_constants: ElementConstants,
    /// Residuals and negative constants; of elements they are those of `method`.
    pub report: FitReport,
    /// 2-norm fits: how well the least norm determines the constants; none in files of springs alone (CSV).
    #[serde(default)]
    pub freedom: Option<Freedom>,
    /// How constants were found for the body as a whole; none where they were found element by element.
    #[serde(default)]
    pub whole: Option<WholeReport>,
    /// What the virtual tests found; none in files of springs alone (CSV) and where they were not possible.
    pub assessment: Option<Assessment>,
    /// Why the virtual tests were not possible: finite elements have no answer in them.
    #[serde(default)]
    pub untested: Option<String>,
}

/// How far the constants of one element may move in a 2-norm fit, springs of equal rest length together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Freedom {
    /// The first element whose constants the least norm does not determine, or the first of all: its place over all kinds
    /// in the order triangles, quadrilaterals, tetrahedra, hexahedra.
    pub element: usize,
    /// How much the norm may rise, as a part of itself; none where the fit is not unique.
    pub rise: Option<f64>,
    /// Springs that may move, and how far.
    pub ranges: Vec<ConstantRange>,
}

impl Freedom {
    /// Rise of the norm up to which a unique fit is probed.
    const RISE: f64 = 0.01;
    /// Springs of a smaller residual meet their element exactly, and nothing is free.
    const EXACT: f64 = 1e-12;

    fn of(
        rig: &Rig,
        cells: &Cells<'_>,
        fits: &ElementFits,
        material: &LinearMaterial,
    ) -> Result<Option<Self>> {
        let inexact = |e: &usize| fits.of(*e).two_norm_residual > Self::EXACT;
        let freedom = |e: usize| Some((e, fits.of(e).two_norm_freedom?));
        let mut known = (0..cells.len()).filter(inexact).filter_map(freedom).peekable();
        let Some(&first) = known.peek() else { return Ok(None) };
        let (element, free) = known.find(|f| f.1 > 0).unwrap_or(first);
        let rise = (free == 0).then_some(Self::RISE);
        let geometry = cells.geometry(&rig.points, element)?;
        let constants = &fits.of(element).constants;
        let ranges = constant_ranges(&geometry, material, &rig.section, constants, rise)?;
        Ok(Some(Self { element, rise, ranges }))
    }
}

/// Reads and checks a mesh, then finds and tests its springs.
///
/// # Errors
/// [`FitError`], naming the file, the element or the group and what to do.
pub fn fit_file(path: &std::path::Path, request: &FitRequest) -> Result<FittedBody> {
    fit_mesh(&Mesh::read(path)?, request)
}

/// Finds and tests the springs of a mesh. Where the tests are not possible, because the ends do not hold the body or
/// share vertices, or a sheet is not flat, [`FittedBody::untested`] says why.
///
/// # Errors
/// [`FitError`], naming the element or the group and what to do.
///
/// ```
/// use glam::DVec2;
/// use sinew::engine::mesh::generate::quad_grid;
/// use sinew_tune::fit::rig::Grips;
/// use sinew_tune::fit::{FitRequest, fit_mesh};
/// use sinew_identify::mass::MassLumping;
/// use sinew_identify::{ElementMethod, LinearMaterial, Section};
///
/// let mesh = quad_grid(DVec2::new(0.04, 0.02), [4, 2])?;
/// let request = FitRequest {
///     material: LinearMaterial::new(1e4, 1.0 / 3.0)?,
///     density: 1000.0,
///     section: Section { thickness: 0.01, ..Section::default() },
///     method: ElementMethod::Baudet,
///     masses: MassLumping::RowSum,
///     grips: Grips::default(),
///     whole: None,
/// };
/// let body = fit_mesh(&mesh, &request)?;
/// // Baudet's squares are exact at a ratio of 1/3
/// let moduli = body.assessment.unwrap().moduli.unwrap();
/// assert!((moduli.young_modulus / 1e4 - 1.0).abs() < 1e-9);
/// assert!((moduli.poisson_ratio - 1.0 / 3.0).abs() < 1e-9);
/// assert!((body.masses.iter().sum::<f64>() - 8e-3).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn fit_mesh(mesh: &Mesh, request: &FitRequest) -> Result<FittedBody> {
    let checked = check(mesh, &CheckOptions::default())?.mesh;
    if checked.is_second_order() {
        return Err(FitError::SecondOrder { source_name: mesh.source.clone() });
    }
    let solid = checked.is_solid();
    if !solid {
        request.section.check()?;
    }
    let named = request.grips.held.is_some() || request.grips.loaded.is_some();
    let (rig, no_rig) = match Rig::new(&checked, request.section, &request.grips) {
        Ok(rig) => (rig, None),
        Err(e @ FitError::Test(_)) => (Rig::without_ends(&checked, request.section), Some(e)),
        Err(e @ FitError::SharedNode { .. }) if !named => {
            (Rig::without_ends(&checked, request.section), Some(e))
        }
        Err(e) => return Err(e),
    };
    let cells = rig.cells();
    let material = request.material;
    let fits = fit_each(&rig.points, &cells, &[material], &rig.section, request.method)?;
    let freedom = Freedom::of(&rig, &cells, &fits, &material)?;
    let mut springs = fits.pooled(&cells, request.method);
    let whole = match (&request.whole, &no_rig) {
        (Some(WholeRequest { target: Target::Forces, .. }), Some(_)) => {
            return Err(no_rig.unwrap_or(IdentifyError::NoElements.into()));
        }
        (Some(whole), _) => Some(whole.find(&rig, &material, &mut springs)?),
        (None, _) => None,
    };
    let own = mesh_masses(&rig.points, &cells, request.density, &rig.section, request.masses)?;
    let mut masses = vec![0.0; mesh.points.len()];
    rig.nodes.iter().zip(own).for_each(|(&v, m)| masses[v as usize] = m);
    let at = |v: u32| DVec3::from(rig.points[v as usize]);
    let length = |[a, b]: [u32; 2]| at(a).distance(at(b));
    let mut lists = ElementConstants::default();
    let shares = whole.is_some().then(|| equal_shares(&cells, &springs));
    for element in 0..cells.len() {
        let (kind, _, nodes) = cells.element(element);
        let own = || fits.of(element).constants.clone();
        lists.list(kind).push(shares.as_ref().map_or_else(own, |shares| shares(nodes)));
    }
    drop(shares);
    let tested = match no_rig {
        Some(e) => Err(e),
        None => assess(&rig, &material, &springs),
    };
    let (assessment, untested) = match tested {
        Ok(assessment) => (Some(assessment), None),
        Err(e @ (FitError::Test(_) | FitError::SharedNode { .. })) => (None, Some(e.to_string())),
        Err(e) => return Err(e),
    };
    Ok(FittedBody {
        schema: SCHEMA.to_string(),
        mesh: mesh.source.clone(),
        method: request.method,
        young_modulus: material.youngs_modulus,
        poisson_ratio: material.poissons_ratio,
        density: request.density,
        plane: (!solid).then_some(request.section.plane),
        thickness: (!solid).then_some(request.section.thickness),
        springs: springs
            .edges
            .iter()
            .zip(&springs.constants)
            .map(|(&edge, &constant)| BodySpring {
                nodes: edge.map(|v| rig.nodes[v as usize]),
                constant,
                rest_length: length(edge),
            })
            .collect(),
        masses,
        mass_lumping: request.masses,
        element_constants: lists,
        report: springs.report,
        freedom,
        whole,
        assessment,
        untested,
    })
}

/// Constants (N/m) of an element by its nodes: an equal part of every spring for each of the elements round it.
fn equal_shares<'a>(
    cells: &Cells<'_>,
    springs: &'a FittedSprings,
) -> impl Fn(&[u32]) -> Vec<f64> + use<'a> {
    let place =
        |a: u32, b: u32| springs.edges.binary_search(&[a.min(b), a.max(b)]).unwrap_or_else(|at| at);
    let mut round = vec![0.0; springs.edges.len()];
    for element in 0..cells.len() {
        let nodes = cells.element(element).2;
        pairs(nodes.len()).for_each(|(a, b)| round[place(nodes[a], nodes[b])] += 1.0);
    }
    move |nodes| {
        let share = |(a, b): (usize, usize)| {
            let at = place(nodes[a], nodes[b]);
            springs.constants[at] / round[at]
        };
        pairs(nodes.len()).map(share).collect()
    }
}
