//! Rest shapes of elements: nodes, shape functions, Jacobians.
//!
//! Nodes are in the order of Gmsh and VTK: triangles and quadrilaterals run round, hexahedra have their
//! bottom face 0 1 2 3 and the top face 4 5 6 7 above it. Whether they run clockwise, or a solid is
//! mirrored, does not matter: stiffness and springs are the same.

use crate::error::ElementError;
use crate::kind::ElementKind;

impl ElementKind {
    /// Gauss points (reference coordinates, weight).
    pub(crate) fn gauss_points(self) -> Vec<([f64; 3], f64)> {
        let g = 1.0 / 3f64.sqrt();
        let signs = [-g, g];
        match self {
            Self::Triangle => vec![([1.0 / 3.0, 1.0 / 3.0, 0.0], 0.5)],
            Self::Tetrahedron => vec![([0.25; 3], 1.0 / 6.0)],
            Self::Quad => signs.iter().flat_map(|&y| signs.map(|x| ([x, y, 0.0], 1.0))).collect(),
            Self::Hexahedron => signs
                .iter()
                .flat_map(|&z| {
                    signs.iter().flat_map(move |&y| signs.map(move |x| ([x, y, z], 1.0)))
                })
                .collect(),
        }
    }

    /// Reference coordinates of the nodes.
    pub(crate) fn reference_nodes(self) -> &'static [[f64; 3]] {
        match self {
            Self::Triangle => &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            Self::Tetrahedron => &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            Self::Quad => &[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]],
            Self::Hexahedron => &[
                [-1.0, -1.0, -1.0],
                [1.0, -1.0, -1.0],
                [1.0, 1.0, -1.0],
                [-1.0, 1.0, -1.0],
                [-1.0, -1.0, 1.0],
                [1.0, -1.0, 1.0],
                [1.0, 1.0, 1.0],
                [-1.0, 1.0, 1.0],
            ],
        }
    }

    /// Shape functions at reference coordinates `xi`.
    pub(crate) fn shape_functions(self, xi: [f64; 3]) -> [f64; 8] {
        let mut n = [0.0; 8];
        match self {
            Self::Triangle => n[..3].copy_from_slice(&[1.0 - xi[0] - xi[1], xi[0], xi[1]]),
            Self::Tetrahedron => {
                n[..4].copy_from_slice(&[1.0 - xi[0] - xi[1] - xi[2], xi[0], xi[1], xi[2]]);
            }
            Self::Quad | Self::Hexahedron => {
                let dimension = self.dimension();
                for (n, node) in n.iter_mut().zip(self.reference_nodes()) {
                    *n = (0..dimension).map(|d| 0.5 * (1.0 + node[d] * xi[d])).product();
                }
            }
        }
        n
    }

    /// Derivatives of the shape functions with respect to the reference coordinates.
    pub(crate) fn reference_gradients(self, xi: [f64; 3]) -> [[f64; 3]; 8] {
        let mut gradients = [[0.0; 3]; 8];
        match self {
            Self::Triangle => {
                gradients[..3].copy_from_slice(&[
                    [-1.0, -1.0, 0.0],
                    [1.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0],
                ]);
            }
            Self::Tetrahedron => {
                gradients[0] = [-1.0; 3];
                for axis in 0..3 {
                    gradients[axis + 1][axis] = 1.0;
                }
            }
            Self::Quad | Self::Hexahedron => {
                let dimension = self.dimension();
                for (gradient, node) in gradients.iter_mut().zip(self.reference_nodes()) {
                    for axis in 0..dimension {
                        gradient[axis] = (0..dimension)
                            .map(|d| {
                                if d == axis {
                                    0.5 * node[d]
                                } else {
                                    0.5 * (1.0 + node[d] * xi[d])
                                }
                            })
                            .product();
                    }
                }
            }
        }
        gradients
    }
}

/// Rest shape of one element, checked. Plane elements live in their own plane.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementGeometry {
    kind: ElementKind,
    nodes: Vec<[f64; 3]>,
    /// Orientation: +1, or -1 for clockwise and mirrored elements.
    sign: f64,
    size: f64,
    off_plane: f64,
}

/// Least Jacobian determinant, relative to the size of the element, that is told from rounding.
const LEAST_JACOBIAN: f64 = 1e-13;

impl ElementGeometry {
    /// An element of `kind` with its `nodes` (m) in space.
    ///
    /// Triangles and quadrilaterals may lie anywhere: they are projected to their mean plane (through
    /// the centroid, normal to the cross product of the diagonals), and [`off_plane`](Self::off_plane)
    /// tells how far the nodes are off it. The plane's first axis is along the first side.
    ///
    /// # Errors
    /// [`ElementError::NodeCount`], [`ElementError::NotFinite`], [`ElementError::CoincidentNodes`],
    /// [`ElementError::Jacobian`].
    ///
    /// ```
    /// use sinew_identify::{ElementGeometry, ElementKind};
    ///
    /// let warped = [[0.0, 0.0, 0.1], [1.0, 0.0, -0.1], [1.0, 1.0, 0.1], [0.0, 1.0, -0.1]];
    /// let quad = ElementGeometry::new(ElementKind::Quad, &warped)?;
    /// assert!((quad.off_plane() - 0.1).abs() < 1e-15);
    /// assert!((quad.measure() - 1.0).abs() < 1e-15);
    /// # Ok::<(), sinew_identify::ElementError>(())
    /// ```
    pub fn new(kind: ElementKind, nodes: &[[f64; 3]]) -> Result<Self, ElementError> {
        let size = check_nodes(kind, nodes)?;
        if kind.dimension() == 3 {
            return Self::checked(kind, nodes.to_vec(), size, 0.0);
        }
        let last = nodes.len() - 1;
        let normal = cross(sub(nodes[2], nodes[0]), sub(nodes[last], nodes[1]));
        // a triangle: (X2 - X0) x (X2 - X1) = (X1 - X0) x (X2 - X0)
        let area = norm(normal);
        if area <= LEAST_JACOBIAN * size * size {
            return Err(ElementError::Jacobian {
                least: area / (size * size),
                largest: area / (size * size),
            });
        }
        let normal = scale(normal, 1.0 / area);
        let side = sub(nodes[1], nodes[0]);
        let side = sub(side, scale(normal, dot(side, normal)));
        let length = norm(side);
        if length <= LEAST_JACOBIAN * size {
            return Err(ElementError::CoincidentNodes { a: 0, b: 1 });
        }
        let first = scale(side, 1.0 / length);
        let second = cross(normal, first);
        let count = nodes.len() as f64;
        let mut centroid = [0.0; 3];
        for node in nodes {
            for axis in 0..3 {
                centroid[axis] += node[axis] / count;
            }
        }
        let mut off_plane = 0f64;
        let flat = nodes
            .iter()
            .map(|&node| {
                let r = sub(node, centroid);
                off_plane = off_plane.max(dot(r, normal).abs());
                [dot(r, first), dot(r, second), 0.0]
            })
            .collect();
        Self::checked(kind, flat, size, off_plane)
    }

    /// A plane element with `nodes` (m) in the plane, whose axes are kept.
    ///
    /// # Errors
    /// As [`new`](Self::new); [`ElementError::NodeCount`] for solids too.
    pub fn planar(kind: ElementKind, nodes: &[[f64; 2]]) -> Result<Self, ElementError> {
        if kind.dimension() == 3 {
            return Err(ElementError::NodeCount { kind, expected: kind.nodes(), given: 0 });
        }
        let nodes: Vec<_> = nodes.iter().map(|n| [n[0], n[1], 0.0]).collect();
        let size = check_nodes(kind, &nodes)?;
        Self::checked(kind, nodes, size, 0.0)
    }

    fn checked(
        kind: ElementKind,
        nodes: Vec<[f64; 3]>,
        size: f64,
        off_plane: f64,
    ) -> Result<Self, ElementError> {
        let mut geometry = Self { kind, nodes, sign: 1.0, size, off_plane };
        let unit = size.powi(kind.dimension() as i32);
        let points = kind.gauss_points();
        let places = points.iter().map(|p| p.0).chain(kind.reference_nodes().iter().copied());
        let determinants: Vec<f64> = places.map(|xi| geometry.jacobian(xi).1 / unit).collect();
        if determinants.iter().sum::<f64>() < 0.0 {
            geometry.sign = -1.0;
        }
        let oriented = determinants.iter().map(|d| d * geometry.sign);
        let (least, largest) =
            oriented.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| (a.min(d), b.max(d)));
        if least > LEAST_JACOBIAN {
            Ok(geometry)
        } else {
            Err(ElementError::Jacobian { least, largest })
        }
    }

    /// Kind of the element.
    pub fn kind(&self) -> ElementKind {
        self.kind
    }

    /// Rest positions of the nodes (m); plane elements have a third coordinate of 0.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.nodes
    }

    /// Longest distance between two nodes, m.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Largest distance of a node from the mean plane before projection, m; 0 for solids.
    pub fn off_plane(&self) -> f64 {
        self.off_plane
    }

    /// Rest area (m^2) or volume (m^3), by the element's quadrature.
    pub fn measure(&self) -> f64 {
        self.kind.gauss_points().iter().map(|&(xi, weight)| weight * self.determinant(xi)).sum()
    }

    /// `|det J|` at reference coordinates `xi`.
    pub(crate) fn determinant(&self, xi: [f64; 3]) -> f64 {
        self.sign * self.jacobian(xi).1
    }

    /// Jacobian `J[a][b] = dx_b / dxi_a` and its determinant. The third row of a plane element is the
    /// unit vector.
    fn jacobian(&self, xi: [f64; 3]) -> ([[f64; 3]; 3], f64) {
        let gradients = self.kind.reference_gradients(xi);
        let mut j = [[0.0; 3]; 3];
        for (node, gradient) in self.nodes.iter().zip(&gradients) {
            for a in 0..3 {
                for b in 0..3 {
                    j[a][b] += gradient[a] * node[b];
                }
            }
        }
        if self.kind.dimension() == 2 {
            j[2][2] = 1.0;
        }
        (j, dot(j[0], cross(j[1], j[2])))
    }

    /// Gradients of the shape functions (1/m) at reference coordinates `xi`, and `|det J|`.
    pub(crate) fn gradients(&self, xi: [f64; 3]) -> ([[f64; 3]; 8], f64) {
        let (j, determinant) = self.jacobian(xi);
        // columns of the inverse: g = J^-1 (dN/dxi)
        let columns = [cross(j[1], j[2]), cross(j[2], j[0]), cross(j[0], j[1])];
        let reference = self.kind.reference_gradients(xi);
        let mut gradients = [[0.0; 3]; 8];
        for (gradient, r) in gradients.iter_mut().zip(&reference).take(self.nodes.len()) {
            for axis in 0..self.kind.dimension() {
                gradient[axis] = (0..3).map(|a| columns[a][axis] * r[a]).sum::<f64>() / determinant;
            }
        }
        (gradients, self.sign * determinant)
    }
}

/// Checks count, finiteness and distinct nodes; the longest distance between two nodes (m).
fn check_nodes(kind: ElementKind, nodes: &[[f64; 3]]) -> Result<f64, ElementError> {
    if nodes.len() != kind.nodes() {
        return Err(ElementError::NodeCount { kind, expected: kind.nodes(), given: nodes.len() });
    }
    if let Some(node) = nodes.iter().position(|n| n.iter().any(|x| !x.is_finite())) {
        return Err(ElementError::NotFinite { node });
    }
    let mut size = 0f64;
    for a in 0..nodes.len() {
        for b in a + 1..nodes.len() {
            let length = norm(sub(nodes[a], nodes[b]));
            if length == 0.0 {
                return Err(ElementError::CoincidentNodes { a, b });
            }
            size = size.max(length);
        }
    }
    Ok(size)
}

pub(crate) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|x| x * s)
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}
