//! `sinew mesh springs`: the springs that are St Venant-Kirchhoff elasticity on a cell, as numbers.
//!
//! A tetrahedron has 21 of them: 6 tensile, 12 angular between edges with a common vertex, 3 volumetric between
//! opposite edges (Delingette 2008, section 3); a triangle has 3 tensile and 3 angular ones (section 2.3).

use crate::text::counted;
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
    /// Neither tetrahedra nor triangles, or no such cell.
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
    /// Springs are those of linear tetrahedra.
    #[error(
        "{0}: springs are for tetrahedra of four vertices, these have ten; take a mesh of first order"
    )]
    SecondOrder(String),
    /// A sheet has no stiffness without one.
    #[error("the thickness is {0} m; triangles need a positive one (--thickness)")]
    Thickness(f64),
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
    /// let table = SpringTable::of(&mesh, material, None, &[0]).unwrap();
    /// assert_eq!(table.cells[0].springs.len(), 21);
    /// assert!(SpringTable::of(&mesh, material, None, &[6]).is_err());
    /// ```
    pub fn of(
        mesh: &Mesh,
        material: YoungPoisson,
        thickness: Option<f64>,
        cells: &[usize],
    ) -> Result<Self, CellSpringsError> {
        let mesh = check(mesh, &CheckOptions::default())?.mesh;
        if mesh.is_second_order() {
            return Err(CellSpringsError::SecondOrder(mesh.source.clone()));
        }
        let solid = mesh.is_solid();
        let (kind, count) = match solid {
            true => ("tetrahedron", mesh.tetrahedra.len()),
            false => ("triangle", mesh.triangles.len()),
        };
        let cells = cells.iter().map(|&cell| match cell < count {
            true if solid => tetrahedron(&mesh, cell, material),
            true => triangle(&mesh, cell, material, thickness.unwrap_or(0.0)),
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
            cells: cells.collect::<Result<_, _>>()?,
        })
    }
}

fn tetrahedron(
    mesh: &Mesh,
    cell: usize,
    material: YoungPoisson,
) -> Result<CellSprings, CellSpringsError> {
    let vertices = mesh.tetrahedra[cell];
    let rest = RestTetrahedron::new(vertices.map(|v| mesh.points[v as usize].to_array()))
        .map_err(|source| CellSpringsError::Tetrahedron { cell, source })?;
    let constants = precompute::SpringConstants::new(&rest, material.lame()?);
    let pairs = [
        ("angular", &constants.angular[..], &ADJACENT_EDGES[..]),
        ("volumetric", &constants.volumetric, &OPPOSITE_EDGES),
    ];
    let springs = springs(mesh, &vertices, &EDGES, &constants.tensile, &pairs);
    Ok(CellSprings { kind: "tetrahedron", cell, vertices: vertices.to_vec(), springs })
}

fn triangle(
    mesh: &Mesh,
    cell: usize,
    material: YoungPoisson,
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
    let constants = membrane::SpringConstants::new(&rest, moduli);
    // edge i lies opposite vertex i, and a pair between the two edges that meet there
    let pairs = [("angular", &constants.angular[..], &[[1, 2], [2, 0], [0, 1]][..])];
    let edges = [[1, 2], [2, 0], [0, 1]];
    let springs = springs(mesh, &vertices, &edges, &constants.tensile, &pairs);
    Ok(CellSprings { kind: "triangle", cell, vertices: vertices.to_vec(), springs })
}

/// Springs on `edges` (local vertices) and between pairs of them.
fn springs(
    mesh: &Mesh,
    vertices: &[u32],
    edges: &[[usize; 2]],
    tensile: &[f64],
    pairs: &[(&'static str, &[f64], &[[usize; 2]])],
) -> Vec<CellSpring> {
    let edge = |e: usize| edges[e].map(|local| vertices[local]);
    let length = |e: usize| {
        let [a, b] = edge(e).map(|v| mesh.points[v as usize]);
        a.distance(b)
    };
    let spring = |kind, own: &[usize], biquadratic: f64| {
        let (first, last) = (own[0], own[own.len() - 1]);
        let quadratic = 4.0 * length(first) * length(last) * biquadratic;
        CellSpring { kind, edges: own.iter().map(|&e| edge(e)).collect(), biquadratic, quadratic }
    };
    let on_edges = tensile.iter().enumerate().map(|(e, &k)| spring("tensile", &[e], k));
    let between = pairs.iter().flat_map(|(kind, constants, places)| {
        constants.iter().zip(*places).map(|(&c, own)| spring(kind, own, c))
    });
    on_edges.chain(between).collect()
}

impl fmt::Display for SpringTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let YoungPoisson { young_modulus, poisson_ratio, .. } = self.material;
        write!(f, "{}: E = {young_modulus} Pa, nu = {poisson_ratio}", self.source)?;
        if let Some(thickness) = self.thickness {
            write!(f, ", {thickness} m thick, plane stress")?;
        }
        writeln!(f, " (Delingette 2008)")?;
        for cell in &self.cells {
            let count = counted(&[("springs", cell.springs.len())]);
            writeln!(f, "\n{} {} of vertices {:?}: {count}", cell.kind, cell.cell, cell.vertices)?;
            writeln!(
                f,
                "  {:<10}  {:<23}  {:>18}  {:>22}",
                "spring", "edges", "k, c, d (N/m^3)", "chi, gamma, xi (N/m)"
            )?;
            for spring in &cell.springs {
                let edges: Vec<String> =
                    spring.edges.iter().map(|[a, b]| format!("{a}-{b}")).collect();
                writeln!(
                    f,
                    "  {:<10}  {:<23}  {:>18.6e}  {:>22.6e}",
                    spring.kind,
                    edges.join("  "),
                    spring.biquadratic,
                    spring.quadratic
                )?;
            }
        }
        Ok(())
    }
}
