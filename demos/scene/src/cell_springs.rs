//! `sinew mesh springs`: the springs that are St Venant-Kirchhoff elasticity on a cell, as numbers.
//!
//! A tetrahedron has 21 of them: 6 tensile, 12 angular between edges with a common vertex, 3 volumetric between
//! opposite edges (Delingette 2008, section 3); a triangle has 3 tensile and 3 angular ones (section 2.3). Biquadratic
//! fibres add to their constants.

use crate::text::counted;
use glam::DVec3;
use serde::Serialize;
use sinew::engine::mesh::{CheckError, CheckOptions, Mesh, check};
use sinew::models::element::membrane::{self, RestTriangle, RestTriangleError, plane_stress};
use sinew::models::element::precompute::{
    self, ADJACENT_EDGES, EDGES, OPPOSITE_EDGES, RestTetrahedron, RestTetrahedronError,
};
use sinew::models::material::{MaterialError, YoungPoisson};
use std::fmt;

/// Constants that cannot be given.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CellSpringsError {
    /// The mesh has errors.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// Material out of range.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// No such cell.
    #[error("{source_name}: there is no {kind} {cell}; it has {count}, counted from 0")]
    NoCell {
        /// File.
        source_name: String,
        /// Kind of cell.
        kind: &'static str,
        /// What was asked for.
        cell: usize,
        /// How many there are.
        count: usize,
    },
    /// Hexahedra or quadrilaterals alone.
    #[error(
        "{0}: these springs are those of tetrahedra and triangles, of which it has none; `sinew fit` finds springs for \
         hexahedra and quadrilaterals"
    )]
    NoSimplices(String),
    /// Springs are those of linear tetrahedra.
    #[error(
        "{0}: springs are for tetrahedra of four vertices, these have ten; take a mesh of first order"
    )]
    SecondOrder(String),
    /// A sheet has no stiffness without one.
    #[error("the thickness is {0} m; triangles need a positive one (--thickness)")]
    Thickness(f64),
    /// Fibres without direction or stiffness.
    #[error(
        "fibres along {direction:?} with a modulus of {modulus} Pa: give a direction (--fibre) and a finite modulus that is \
         not negative (--fibre-modulus)"
    )]
    Fibres {
        /// Direction.
        direction: [f64; 3],
        /// Modulus (Pa).
        modulus: f64,
    },
    /// Fibres across a sheet.
    #[error(
        "triangle {0}: the fibres stand square to it; give a direction with a part in its plane (--fibre)"
    )]
    Across(usize),
    /// A degenerate cell.
    #[error("tetrahedron {cell}: {source}")]
    Tetrahedron {
        /// Which.
        cell: usize,
        /// What is wrong.
        source: RestTetrahedronError,
    },
    /// A degenerate cell.
    #[error("triangle {cell}: {source}")]
    Triangle {
        /// Which.
        cell: usize,
        /// What is wrong.
        source: RestTriangleError,
    },
}

/// A spring on one edge, or between two.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellSpring {
    /// `"tensile"`, `"angular"` or `"volumetric"`.
    pub kind: &'static str,
    /// Its edge, or both, by vertices of the mesh.
    pub edges: Vec<[u32; 2]>,
    /// `k`, `c` or `d` (N/m^3), on changes of squared length: energy `k/4 dl2^2`, `c/2 dl2 dl2'`, `d/2 dl2 dl2'`.
    pub biquadratic: f64,
    /// Part of it (N/m^3) that is the fibres'; `None` without fibres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub of_fibres: Option<f64>,
    /// `chi`, `gamma` or `xi` (N/m), on changes of length, `4 L L'` times the other: energy `chi/4 dl^2`,
    /// `gamma/2 dl dl'`, `xi/2 dl dl'`.
    pub quadratic: f64,
}

/// The springs of a cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellSprings {
    /// `"tetrahedron"` or `"triangle"`.
    pub kind: &'static str,
    /// Index, from 0.
    pub cell: usize,
    /// Its vertices, in the order that the check leaves them in.
    pub vertices: Vec<u32>,
    /// The springs, tensile ones first.
    pub springs: Vec<CellSpring>,
}

/// Biquadratic fibres beside the material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CellFibres {
    /// Direction at rest, of any length; of a triangle its part in the plane counts.
    pub direction: [f64; 3],
    /// Modulus along it (Pa).
    pub modulus: f64,
}

/// Springs of some cells of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpringTable {
    /// `"sinew-springs/1"`.
    pub schema: &'static str,
    /// File or generator.
    pub source: String,
    /// Material.
    pub material: YoungPoisson,
    /// Thickness (m) of triangles, in plane stress.
    pub thickness: Option<f64>,
    /// Fibres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fibres: Option<CellFibres>,
    /// The cells asked for.
    pub cells: Vec<CellSprings>,
}

impl SpringTable {
    /// Springs of tetrahedra, or of triangles of a thickness (m) in a mesh without solid cells.
    ///
    /// # Errors
    /// When mesh, material or thickness cannot be used, or a cell does not exist.
    ///
    /// ```
    /// use sinew::engine::mesh::generate::box_tets;
    /// use sinew::models::material::YoungPoisson;
    /// use sinew_scene::cell_springs::SpringTable;
    /// let mesh = box_tets([1.0, 1.0, 1.0].into(), [1, 1, 1]).unwrap();
    /// let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
    /// let table = SpringTable::of(&mesh, material, None, None, &[0]).unwrap();
    /// assert_eq!(table.cells[0].springs.len(), 21);
    /// assert!(SpringTable::of(&mesh, material, None, None, &[6]).is_err());
    /// ```
    pub fn of(
        mesh: &Mesh,
        material: YoungPoisson,
        fibres: Option<CellFibres>,
        thickness: Option<f64>,
        cells: &[usize],
    ) -> Result<Self, CellSpringsError> {
        if let Some(CellFibres { direction, modulus }) = fibres
            && (DVec3::from_array(direction).try_normalize().is_none()
                || !(modulus >= 0.0 && modulus.is_finite()))
        {
            return Err(CellSpringsError::Fibres { direction, modulus });
        }
        let mesh = check(mesh, &CheckOptions::default())?.mesh;
        if mesh.is_second_order() {
            return Err(CellSpringsError::SecondOrder(mesh.source.clone()));
        }
        let solid = mesh.is_solid();
        let (kind, count) = match solid {
            true => ("tetrahedron", mesh.tetrahedra.len()),
            false => ("triangle", mesh.triangles.len()),
        };
        if count == 0 {
            return Err(CellSpringsError::NoSimplices(mesh.source.clone()));
        }
        let cells = cells.iter().map(|&cell| match cell < count {
            true if solid => tetrahedron(&mesh, cell, material, fibres),
            true => triangle(&mesh, cell, material, fibres, thickness.unwrap_or(0.0)),
            false => {
                let source_name = mesh.source.clone();
                Err(CellSpringsError::NoCell { source_name, kind, cell, count })
            }
        });
        Ok(Self {
            schema: "sinew-springs/1",
            source: mesh.source.clone(),
            material,
            thickness: thickness.filter(|_| !solid),
            fibres,
            cells: cells.collect::<Result<_, _>>()?,
        })
    }
}

fn tetrahedron(
    mesh: &Mesh,
    cell: usize,
    material: YoungPoisson,
    fibres: Option<CellFibres>,
) -> Result<CellSprings, CellSpringsError> {
    let vertices = mesh.tetrahedra[cell];
    let rest = RestTetrahedron::new(vertices.map(|v| mesh.points[v as usize].to_array()))
        .map_err(|source| CellSpringsError::Tetrahedron { cell, source })?;
    let mut constants = precompute::SpringConstants::new(&rest, material.lame()?);
    let mut own = precompute::SpringConstants::NONE;
    if let Some(CellFibres { direction, modulus }) = fibres {
        let axis = DVec3::from_array(direction).normalize().to_array();
        own.add_fibre(&rest, axis, modulus);
        constants.add_fibre(&rest, axis, modulus);
    }
    let list =
        |of: &precompute::SpringConstants| [&of.tensile[..], &of.angular, &of.volumetric].concat();
    let pairs = [("angular", &ADJACENT_EDGES[..]), ("volumetric", &OPPOSITE_EDGES)];
    let of_fibres = fibres.map(|_| list(&own));
    let springs = springs(mesh, (&vertices, &EDGES), &pairs, (&list(&constants), of_fibres));
    Ok(CellSprings { kind: "tetrahedron", cell, vertices: vertices.to_vec(), springs })
}

fn triangle(
    mesh: &Mesh,
    cell: usize,
    material: YoungPoisson,
    fibres: Option<CellFibres>,
    thickness: f64,
) -> Result<CellSprings, CellSpringsError> {
    material.validate_sheet()?;
    if !(thickness > 0.0 && thickness.is_finite()) {
        return Err(CellSpringsError::Thickness(thickness));
    }
    let vertices = mesh.triangles[cell];
    let rest = RestTriangle::new(vertices.map(|v| mesh.points[v as usize].to_array()))
        .map_err(|source| CellSpringsError::Triangle { cell, source })?;
    let moduli = plane_stress(material.young_modulus * thickness, material.poisson_ratio);
    let mut constants = membrane::SpringConstants::new(&rest, moduli);
    let mut own = membrane::SpringConstants { tensile: [0.0; 3], angular: [0.0; 3] };
    if let Some(CellFibres { direction, modulus }) = fibres {
        let axis = rest.in_plane(direction).ok_or(CellSpringsError::Across(cell))?;
        own.add_fibre(&rest, axis, modulus * thickness);
        constants.add_fibre(&rest, axis, modulus * thickness);
    }
    let list = |of: &membrane::SpringConstants| [of.tensile, of.angular].concat();
    // edge i lies opposite vertex i, and a pair between the two edges that meet there
    let edges = [[1, 2], [2, 0], [0, 1]];
    let of_fibres = fibres.map(|_| list(&own));
    let springs =
        springs(mesh, (&vertices, &edges), &[("angular", &edges)], (&list(&constants), of_fibres));
    Ok(CellSprings { kind: "triangle", cell, vertices: vertices.to_vec(), springs })
}

/// Springs on `edges` (local vertices) and between pairs of them, by their constants in this order, and what of these is of
/// fibres.
fn springs(
    mesh: &Mesh,
    (vertices, edges): (&[u32], &[[usize; 2]]),
    pairs: &[(&'static str, &[[usize; 2]])],
    (constants, of_fibres): (&[f64], Option<Vec<f64>>),
) -> Vec<CellSpring> {
    let edge = |e: usize| edges[e].map(|local| vertices[local]);
    let length = |e: usize| {
        let [a, b] = edge(e).map(|v| mesh.points[v as usize]);
        a.distance(b)
    };
    let on_edges = (0..edges.len()).map(|e| ("tensile", vec![e]));
    let between =
        pairs.iter().flat_map(|(kind, list)| list.iter().map(|own| (*kind, own.to_vec())));
    let all = on_edges.chain(between).zip(constants).enumerate();
    all.map(|(i, ((kind, own), &biquadratic))| CellSpring {
        kind,
        edges: own.iter().map(|&e| edge(e)).collect(),
        biquadratic,
        of_fibres: of_fibres.as_ref().map(|own| own[i]),
        quadratic: 4.0 * length(own[0]) * length(own[own.len() - 1]) * biquadratic,
    })
    .collect()
}

impl fmt::Display for SpringTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let YoungPoisson { young_modulus, poisson_ratio, .. } = self.material;
        write!(f, "{}: E = {young_modulus} Pa, nu = {poisson_ratio}", self.source)?;
        if let Some(thickness) = self.thickness {
            write!(f, ", {thickness} m thick, plane stress")?;
        }
        if let Some(CellFibres { direction, modulus }) = self.fibres {
            write!(f, ", fibres of {modulus} Pa along {direction:?}")?;
        }
        writeln!(f, " (Delingette 2008)")?;
        for cell in &self.cells {
            let count = counted(&[("springs", cell.springs.len())]);
            writeln!(f, "\n{} {} of vertices {:?}: {count}", cell.kind, cell.cell, cell.vertices)?;
            write!(
                f,
                "  {:<10}  {:<23}  {:>18}  {:>22}",
                "spring", "edges", "k, c, d (N/m^3)", "chi, gamma, xi (N/m)"
            )?;
            writeln!(f, "{}", if self.fibres.is_some() { "  of fibres (N/m^3)" } else { "" })?;
            for spring in &cell.springs {
                let edges: Vec<String> =
                    spring.edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
                write!(
                    f,
                    "  {:<10}  {:<23}  {:>18.6e}  {:>22.6e}",
                    spring.kind,
                    edges.join("  "),
                    spring.biquadratic,
                    spring.quadratic
                )?;
                match spring.of_fibres {
                    Some(own) => writeln!(f, "  {own:>17.6e}")?,
                    None => writeln!(f)?,
                }
            }
        }
        Ok(())
    }
}
