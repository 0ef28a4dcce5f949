//! Virtual mechanical tests: one mesh, one loading, finite elements against springs (paper B, section 5).
//!
//! | function | body |
//! |---|---|
//! | [`finite_elements`] | linear finite elements, the reference of paper B |
//! | [`linear_springs`] | springs with their stiffness at rest, `K(k) u = f`: paper B's spring model |
//! | [`rest_length_springs`] | springs of energy `1/2 k (l - L)^2` at finite displacement, what a simulation runs |
//!
//! A [`Loading`] holds prescribed displacements and nodal forces and is the same for all three;
//! [`facets`] finds faces and turns tractions into nodal forces, [`gauge`] measures what a tensile test
//! machine would. Plane bodies (triangles and quadrilaterals) lie in x and y; the third coordinate is
//! ignored and must be the same everywhere.
//!
//! [`whole`] finds the springs of a body as a whole: for its assembled stiffness, or for its forces in given states.
//!
//! Systems are factorised directly: meshes of these tests are small, and springs with negative
//! constants are indefinite.

pub mod facets;
pub mod gauge;
mod sparse;
mod springs;
pub mod whole;

use thiserror::Error;

use crate::cells::Cells;
use crate::error::IdentifyError;
use crate::geometry::ElementGeometry;
use crate::material::{LinearMaterial, Section};
use crate::stiffness::element_stiffness;

use sparse::System;
pub use springs::{SpringOptions, SpringSolution, linear_springs, rest_length_springs};

/// What can go wrong in a virtual test.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum VirtualTestError {
    /// Mesh, material or element.
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    /// A plane body that is not flat.
    #[error(
        "triangles and quadrilaterals are tested in the plane, but node {node} is {off} m off the \
         plane of node 0; flatten the mesh to constant z"
    )]
    NotPlane {
        /// the node
        node: usize,
        /// distance along z, m
        off: f64,
    },
    /// A mesh of plane elements and solids.
    #[error("the mesh has plane elements and solids; test them one at a time")]
    MixedDimensions,
    /// A node or an axis that does not exist, or a number that is none.
    #[error(
        "{what} names node {node}, axis {axis} with value {value}: there are {nodes} nodes and {dimension} axes, and values are finite"
    )]
    Loading {
        /// constraint or load
        what: &'static str,
        /// node
        node: usize,
        /// axis
        axis: usize,
        /// value given
        value: f64,
        /// nodes there are
        nodes: usize,
        /// axes there are
        dimension: usize,
    },
    /// A body that can move without resistance.
    #[error(
        "the {body} is singular under these constraints: hold it against rigid motions, and remove \
         nodes that belong to no element"
    )]
    Singular {
        /// what was to be solved
        body: &'static str,
    },
    /// Newton's method found no equilibrium.
    #[error(
        "no equilibrium of the springs at load step {step} of {steps} (residual {residual:.1e} of the \
         spring forces); use more load steps, a smaller load, or non-negative constants"
    )]
    NoEquilibrium {
        /// load step, from 1
        step: usize,
        /// load steps
        steps: usize,
        /// residual relative to spring forces
        residual: f64,
    },
}

/// Prescribed displacements and nodal forces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Loading {
    /// (node, axis, displacement in m). A later entry for the same node and axis replaces an earlier one.
    pub displacements: Vec<(usize, usize, f64)>,
    /// (node, force in N). Entries for the same node add up; plane bodies ignore the third component.
    pub forces: Vec<(usize, [f64; 3])>,
}

impl Loading {
    /// Holds `nodes` at `displacement` (m) along all of the first `dimension` axes.
    pub fn hold(&mut self, nodes: &[usize], dimension: usize, displacement: [f64; 3]) {
        for &node in nodes {
            for axis in 0..dimension {
                self.displacements.push((node, axis, displacement[axis]));
            }
        }
    }

    /// Turns `nodes` of `points` rigidly by `angle` (rad) about the axis through `centre` along `axis`
    /// (x 0, y 1, z 2). `linear` takes the displacement `angle x r` of small rotations, which belongs
    /// to linear bodies, instead of the rotation.
    pub fn turn(
        &mut self,
        points: &[[f64; 3]],
        nodes: &[usize],
        axis: usize,
        centre: [f64; 3],
        angle: f64,
        linear: bool,
    ) {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let (sin, cos) = if linear { (angle, 1.0) } else { angle.sin_cos() };
        for &node in nodes {
            let (y, z) = (points[node][b] - centre[b], points[node][c] - centre[c]);
            self.displacements.push((node, axis, 0.0));
            self.displacements.push((node, b, (cos - 1.0) * y - sin * z));
            self.displacements.push((node, c, sin * y + (cos - 1.0) * z));
        }
    }

    /// Dense form: held values and forces per (node, axis).
    fn expand(&self, nodes: usize, dimension: usize) -> Result<Expanded, VirtualTestError> {
        let mut held = vec![None; nodes * dimension];
        let mut force = vec![0.0; nodes * dimension];
        let bad = |what, node, axis, value| {
            Err(VirtualTestError::Loading { what, node, axis, value, nodes, dimension })
        };
        for &(node, axis, value) in &self.displacements {
            if node >= nodes || axis >= dimension || !value.is_finite() {
                return bad("a prescribed displacement", node, axis, value);
            }
            held[node * dimension + axis] = Some(value);
        }
        for &(node, value) in &self.forces {
            for axis in 0..dimension {
                if node >= nodes || !value[axis].is_finite() {
                    return bad("a nodal force", node, axis, value[axis]);
                }
                force[node * dimension + axis] += value[axis];
            }
        }
        Ok(Expanded { held, force })
    }
}

/// A loading per (node, axis).
struct Expanded {
    held: Vec<Option<f64>>,
    force: Vec<f64>,
}

/// Axes of a mesh: 2 for triangles and quadrilaterals, 3 for solids.
///
/// # Errors
/// [`VirtualTestError::MixedDimensions`], [`VirtualTestError::NotPlane`], [`IdentifyError::NoElements`].
pub fn dimension(points: &[[f64; 3]], cells: &Cells<'_>) -> Result<usize, VirtualTestError> {
    let plane = cells.triangles.len() + cells.quads.len();
    if cells.is_empty() {
        return Err(IdentifyError::NoElements.into());
    }
    if plane == 0 {
        return Ok(3);
    }
    if plane < cells.len() {
        return Err(VirtualTestError::MixedDimensions);
    }
    let z = points.first().map_or(0.0, |p| p[2]);
    let extent = points
        .iter()
        .map(|p| (p[0] - points[0][0]).abs().max((p[1] - points[0][1]).abs()))
        .fold(0.0, f64::max);
    for (node, point) in points.iter().enumerate() {
        let off = (point[2] - z).abs();
        if off > 1e-9 * extent {
            return Err(VirtualTestError::NotPlane { node, off });
        }
    }
    Ok(2)
}

/// Displacements (m) of a body of linear finite elements.
///
/// # Errors
/// [`VirtualTestError`].
///
/// ```
/// use sinew_identify::cells::Cells;
/// use sinew_identify::virtual_test::{Loading, finite_elements};
/// use sinew_identify::{LinearMaterial, Section};
///
/// // a square of 1 m pulled by 1 N, free to contract: u_x = F / (E t), u_y = -nu u_x
/// let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let cells = Cells { quads: &[[0, 1, 2, 3]], ..Cells::default() };
/// let loading = Loading {
///     displacements: vec![(0, 0, 0.0), (3, 0, 0.0), (0, 1, 0.0)],
///     forces: vec![(1, [0.5, 0.0, 0.0]), (2, [0.5, 0.0, 0.0])],
/// };
/// let material = [LinearMaterial::new(10.0, 0.3)?];
/// let u = finite_elements(&points, &cells, &material, &Section::default(), &loading)?;
/// assert!((u[2][0] - 0.1).abs() < 1e-14);
/// assert!((u[2][1] + 0.03).abs() < 1e-14);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn finite_elements(
    points: &[[f64; 3]],
    cells: &Cells<'_>,
    materials: &[LinearMaterial],
    section: &Section,
    loading: &Loading,
) -> Result<Vec<[f64; 3]>, VirtualTestError> {
    let dimension = dimension(points, cells)?;
    let count = cells.len();
    if materials.len() != 1 && materials.len() != count {
        return Err(IdentifyError::MaterialCount { given: materials.len(), elements: count }.into());
    }
    let loading = loading.expand(points.len(), dimension)?;
    let mut system = System::new(&loading.held, dimension);
    for element in 0..count {
        let (kind, index, nodes) = cells.element(element);
        let locate = |source| IdentifyError::Element { kind, index, source };
        let mut geometry = cells.geometry(points, element)?;
        if dimension == 2 {
            // in the axes of the mesh, not of the element
            let flat: Vec<_> =
                nodes.iter().map(|&n| [points[n as usize][0], points[n as usize][1]]).collect();
            geometry = ElementGeometry::planar(kind, &flat).map_err(locate)?;
        }
        let material = &materials[if materials.len() == 1 { 0 } else { element }];
        let r = element_stiffness(&geometry, material, section).map_err(locate)?;
        let unknown = |i: usize| nodes[i / dimension] as usize * dimension + i % dimension;
        for row in 0..r.nrows() {
            for column in 0..r.ncols() {
                system.add(unknown(row), unknown(column), r[(row, column)]);
            }
        }
    }
    let singular = VirtualTestError::Singular { body: "finite element body" };
    let held: Vec<f64> = loading.held.iter().map(|h| h.unwrap_or(0.0)).collect();
    let (u, _) = system.solve(&loading.force, &held).ok_or(singular)?;
    Ok(by_node(&u, dimension))
}

/// Numbers per (node, axis) as vectors.
fn by_node(u: &[f64], dimension: usize) -> Vec<[f64; 3]> {
    u.chunks_exact(dimension)
        .map(|c| [c[0], c[1], if dimension == 3 { c[2] } else { 0.0 }])
        .collect()
}
