//! Springs found for a whole body at once (paper B, section 2, step c): to its assembled stiffness, or to its forces in given
//! states, with rest lengths kept.
//!
//! With `w_s` the vector of spring `s` at rest ([`springs`](crate::springs)) over all nodes, and `R` the assembled stiffness of finite
//! elements, the stiffness is met in the Frobenius norm:
//!
//! ```text
//! min_k |R - sum_s k_s w_s w_s^T|_F      sum_t (w_s . w_t)^2 k_t = w_s^T R w_s
//! ```
//!
//! Only springs that share a node have a part in a row: `sum_t (w_s . w_t)^2 k_t = u^T (D_a + D_b) u + 2 k_s` with the direction
//! `u` of spring `s` from node `b` to `a` and `D_a = sum_t k_t u_t u_t^T` over the springs at `a`. The matrix is at least twice the
//! identity, so the minimiser is unique.
//!
//! In a state of displacements `u_p` finite elements need the nodal forces `R u_p`. Springs of energy `k (l - L)^2 / 2` need
//! `k_s c_s n_s` at node `a` and the opposite at `b`, with the change of length `c_s` and the direction `n_s` of the deformed spring. That
//! is linear in `k`, so the forces of all states are met by least squares:
//!
//! ```text
//! min_k sum_p |R u_p - sum_s k_s g_s(u_p)|^2
//! ```
//!
//! States may leave constants open, such as those of springs that no state stretches. Of all minimisers the one is taken that is
//! nearest to a start, in the norm `sum_s |g_s|^2 k_s^2`; springs that no state stretches keep their start.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::springs::Springs;
use super::{VirtualTestError, dimension};
use crate::cells::Cells;
use crate::error::{ElementError, IdentifyError};
use crate::geometry::ElementGeometry;
use crate::kind::ElementKind;
use crate::material::{LinearMaterial, Section};
use crate::springs::pairs;
use crate::stiffness::element_stiffness;

/// Gradient, over that at constants of 0, at which a fit counts as solved.
const TOLERANCE: f64 = 1e-13;
/// Iterations for each unknown, and at most.
const ITERATIONS: (usize, usize) = (20, 20_000);

/// Which springs share a constant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sharing {
    /// None: every pair of nodes has its own (N/m).
    #[default]
    Springs,
    /// Every kind of pair of every kind of element has one modulus (Pa): `k = modulus V / L^2`, summed over the elements round the
    /// pair, with `V` the volume of the element and `L` the length of the spring.
    Moduli,
}

impl Sharing {
    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Springs => "springs",
            Self::Moduli => "moduli",
        }
    }
}

impl fmt::Display for Sharing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Sharing {
    type Err = IdentifyError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let all = [Self::Springs, Self::Moduli];
        all.into_iter().find(|own| own.name() == name).ok_or_else(|| IdentifyError::UnknownMethod {
            name: name.to_owned(),
            known: "springs, moduli".into(),
        })
    }
}

/// A stiffness matrix (N/m) whose blocks off the diagonal lie on springs.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyStiffness {
    /// Block of every node with itself.
    nodes: Vec<Matrix3<f64>>,
    /// Block of the first with the second node of every spring; the other one is its transpose.
    springs: Vec<Matrix3<f64>>,
}

impl BodyStiffness {
    /// Frobenius norm.
    pub fn norm(&self) -> f64 {
        let squares =
            |blocks: &[Matrix3<f64>]| blocks.iter().map(Matrix3::norm_squared).sum::<f64>();
        (squares(&self.nodes) + 2.0 * squares(&self.springs)).sqrt()
    }

    /// Frobenius norm of the difference to another of the same body.
    pub fn distance(&self, other: &Self) -> f64 {
        let less =
            |a: &[Matrix3<f64>], b: &[Matrix3<f64>]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let (nodes, springs) =
            (less(&self.nodes, &other.nodes), less(&self.springs, &other.springs));
        Self { nodes, springs }.norm()
    }
}

/// Nodal displacements (m), and the forces (N) that hold a body in them.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Displacements.
    pub displacements: Vec<[f64; 3]>,
    /// Forces.
    pub forces: Vec<[f64; 3]>,
}

/// Constants of the springs of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeFit {
    /// Constants (N/m), one to a spring.
    pub constants: Vec<f64>,
    /// Moduli (Pa) with their kinds of pairs, where springs [share](Sharing::Moduli) them.
    pub moduli: Vec<(&'static str, f64)>,
    /// Distance from what is to be met, relative to it.
    pub residual: f64,
    /// Unknowns.
    pub unknowns: usize,
    /// Iterations of conjugate gradients; 0 where moduli are shared.
    pub iterations: usize,
    /// Gradient that is left, relative to that at constants of 0: far above 1e-12 means that constants are not settled.
    pub gradient: f64,
}

/// A body by its elements, each pair of whose nodes is joined by a spring.
#[derive(Clone, Debug)]
pub struct WholeBody<'a> {
    points: &'a [[f64; 3]],
    dimension: usize,
    /// Springs: pairs of nodes, each sorted, in lexicographic order.
    pub edges: Vec<[u32; 2]>,
    /// Unit vectors from the second node to the first.
    directions: Vec<Vector3<f64>>,
    /// Parts in each of the kinds of pairs: `V / L^2` (m) of the elements round a spring.
    parts: Vec<(&'static str, Vec<f64>)>,
}

/// What a pair of local nodes is in an element.
fn kind_of_pair(kind: ElementKind, a: usize, b: usize) -> &'static str {
    // corners of a hexahedron on a grid
    let corner = |i: usize| [usize::from(matches!(i % 4, 1 | 2)), usize::from(i % 4 > 1), i / 4];
    let apart = corner(a).iter().zip(corner(b)).filter(|(x, y)| **x != *y).count();
    match (kind, apart) {
        (ElementKind::Triangle, _) => "side of a triangle",
        (ElementKind::Tetrahedron, _) => "edge of a tetrahedron",
        (ElementKind::Quad, 1) => "side of a quadrilateral",
        (ElementKind::Quad, _) => "diagonal of a quadrilateral",
        (ElementKind::Hexahedron, 1) => "edge of a hexahedron",
        (ElementKind::Hexahedron, 2) => "diagonal of a face of a hexahedron",
        (ElementKind::Hexahedron, _) => "diagonal in space of a hexahedron",
    }
}

impl<'a> WholeBody<'a> {
    /// A body of solid elements, or of plane ones in x and y; `section` is that of the latter.
    ///
    /// # Errors
    /// [`VirtualTestError`] when the mesh cannot be used.
    pub fn new(
        points: &'a [[f64; 3]],
        cells: &Cells<'_>,
        section: &Section,
    ) -> Result<Self, VirtualTestError> {
        let dimension = dimension(points, cells)?;
        let mut springs: BTreeMap<[u32; 2], BTreeMap<&'static str, f64>> = BTreeMap::new();
        for element in 0..cells.len() {
            let (kind, _, nodes) = cells.element(element);
            let measure = cells.geometry(points, element)?.measure();
            let volume = if dimension == 2 { measure * section.thickness } else { measure };
            for (a, b) in pairs(nodes.len()) {
                let edge = [nodes[a].min(nodes[b]), nodes[a].max(nodes[b])];
                *springs.entry(edge).or_default().entry(kind_of_pair(kind, a, b)).or_default() +=
                    volume;
            }
        }
        let between = |[a, b]: [u32; 2]| {
            Vector3::from(points[a as usize]) - Vector3::from(points[b as usize])
        };
        let mut kinds: Vec<&'static str> =
            springs.values().flat_map(|s| s.keys().copied()).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let of = |kind: &'static str| {
            let part = |(&edge, own): (&[u32; 2], &BTreeMap<&str, f64>)| {
                own.get(kind).map_or(0.0, |volume| volume / between(edge).norm_squared())
            };
            (kind, springs.iter().map(part).collect())
        };
        Ok(Self {
            points,
            dimension,
            parts: kinds.into_iter().map(of).collect(),
            directions: springs.keys().map(|&edge| between(edge).normalize()).collect(),
            edges: springs.into_keys().collect(),
        })
    }

    fn empty(&self) -> BodyStiffness {
        let zeros = |count| vec![Matrix3::zeros(); count];
        BodyStiffness { nodes: zeros(self.points.len()), springs: zeros(self.edges.len()) }
    }

    /// Assembled stiffness of linear finite elements; `cells` and `section` as in [`WholeBody::new`], materials one for all or one
    /// for each.
    ///
    /// # Errors
    /// [`VirtualTestError`].
    pub fn stiffness_of_elements(
        &self,
        cells: &Cells<'_>,
        materials: &[LinearMaterial],
        section: &Section,
    ) -> Result<BodyStiffness, VirtualTestError> {
        let (given, elements) = (materials.len(), cells.len());
        if given != 1 && given != elements {
            return Err(IdentifyError::MaterialCount { given, elements }.into());
        }
        let mut whole = self.empty();
        let d = self.dimension;
        for element in 0..elements {
            let (kind, index, nodes) = cells.element(element);
            let locate = |source| IdentifyError::Element { kind, index, source };
            let mut geometry = cells.geometry(self.points, element)?;
            if d == 2 {
                // in the axes of the mesh, not of the element
                let flat = |&n: &u32| [self.points[n as usize][0], self.points[n as usize][1]];
                let flat: Vec<_> = nodes.iter().map(flat).collect();
                geometry = ElementGeometry::planar(kind, &flat).map_err(locate)?;
            }
            let material = &materials[if given == 1 { 0 } else { element }];
            let r = element_stiffness(&geometry, material, section).map_err(locate)?;
            let block = |a: usize, b: usize| {
                let entry = |i, j| if i < d && j < d { r[(a * d + i, b * d + j)] } else { 0.0 };
                Matrix3::from_fn(entry)
            };
            for a in 0..nodes.len() {
                whole.nodes[nodes[a] as usize] += block(a, a);
            }
            for (a, b) in pairs(nodes.len()) {
                let (a, b) = if nodes[a] < nodes[b] { (a, b) } else { (b, a) };
                let at = self.edges.binary_search(&[nodes[a], nodes[b]]);
                whole.springs[at.unwrap_or_default()] += block(a, b);
            }
        }
        Ok(whole)
    }

    /// Stiffness at rest of springs of these constants (N/m).
    ///
    /// # Panics
    /// If there are fewer constants than springs.
    pub fn stiffness_of_springs(&self, constants: &[f64]) -> BodyStiffness {
        let mut whole = self.empty();
        for (s, u) in self.directions.iter().enumerate() {
            let block = constants[s] * u * u.transpose();
            for node in self.edges[s] {
                whole.nodes[node as usize] += block;
            }
            whole.springs[s] -= block;
        }
        whole
    }

    /// The forces (N) that a stiffness needs in displacements (m).
    pub fn state(&self, stiffness: &BodyStiffness, displacements: &[[f64; 3]]) -> State {
        let u: Vec<Vector3<f64>> = displacements.iter().map(|u| Vector3::from(*u)).collect();
        let mut forces: Vec<Vector3<f64>> =
            stiffness.nodes.iter().zip(&u).map(|(k, u)| k * u).collect();
        for (block, [a, b]) in stiffness.springs.iter().zip(&self.edges) {
            let [a, b] = [*a as usize, *b as usize];
            forces[a] += block * u[b];
            forces[b] += block.transpose() * u[a];
        }
        State {
            displacements: displacements.to_vec(),
            forces: forces.iter().map(|f| (*f).into()).collect(),
        }
    }

    /// The forces (N) that springs of these constants (N/m) and their rest lengths need in displacements (m).
    pub fn state_of_springs(&self, constants: &[f64], displacements: &[[f64; 3]]) -> State {
        let force = self.unit_forces(displacements);
        let forces = self.forces(&force, constants).iter().map(|f| (*f).into()).collect();
        State { displacements: displacements.to_vec(), forces }
    }

    /// Force (N per N/m) of every spring of constant 1 on its first node that holds it in displacements (m).
    fn unit_forces(&self, displacements: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        let ones = vec![1.0; self.edges.len()];
        let springs = Springs::new(self.points, &self.edges, &ones, self.dimension);
        let flat: Vec<f64> =
            displacements.iter().flat_map(|u| u[..self.dimension].iter().copied()).collect();
        let force = |s| {
            let (unit, _, change) = springs.spring(s, &flat);
            change * Vector3::from(unit)
        };
        (0..self.edges.len()).map(force).collect()
    }

    fn forces(&self, units: &[Vector3<f64>], constants: &[f64]) -> Vec<Vector3<f64>> {
        let mut forces = vec![Vector3::zeros(); self.points.len()];
        for ((unit, k), [a, b]) in units.iter().zip(constants).zip(&self.edges) {
            forces[*a as usize] += *k * unit;
            forces[*b as usize] -= *k * unit;
        }
        forces
    }

    /// Constants whose stiffness at rest is nearest to `target` in the Frobenius norm.
    ///
    /// # Errors
    /// [`ElementError::DependentSprings`] when shared moduli cannot be told apart.
    ///
    /// ```
    /// use sinew_identify::cells::Cells;
    /// use sinew_identify::mesh::fit_elements;
    /// use sinew_identify::virtual_test::whole::{Sharing, WholeBody};
    /// use sinew_identify::{ElementMethod, LinearMaterial, Section};
    ///
    /// // a square by itself is the whole body: both fits are one
    /// let points = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    /// let cells = Cells { quads: &[[0, 1, 2, 3]], ..Cells::default() };
    /// let (material, section) = ([LinearMaterial::new(1.0, 0.3)?], Section::default());
    /// let body = WholeBody::new(&points, &cells, &section)?;
    /// let target = body.stiffness_of_elements(&cells, &material, &section)?;
    /// let fit = body.fit_stiffness(&target, Sharing::Springs)?;
    /// let one = fit_elements(&points, &cells, &material, &section, ElementMethod::Frobenius)?;
    /// for (whole, own) in fit.constants.iter().zip(&one.constants) {
    ///     assert!((whole - own).abs() < 1e-12);
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn fit_stiffness(
        &self,
        target: &BodyStiffness,
        sharing: Sharing,
    ) -> Result<WholeFit, ElementError> {
        let along = |of: &BodyStiffness| -> Vec<f64> {
            let each = self.directions.iter().enumerate().map(|(s, u)| {
                let [a, b] = self.edges[s].map(|n| of.nodes[n as usize]);
                (u.transpose() * (a + b - of.springs[s] - of.springs[s].transpose()) * u).x
            });
            each.collect()
        };
        let problem = LeastSquares {
            normal: &|constants: &[f64]| along(&self.stiffness_of_springs(constants)),
            right: along(target),
            diagonal: vec![4.0; self.edges.len()],
            start: vec![0.0; self.edges.len()],
        };
        let mut fit = self.solve(&problem, sharing)?;
        fit.residual = target.distance(&self.stiffness_of_springs(&fit.constants)) / target.norm();
        Ok(fit)
    }

    /// Constants whose forces in some states are nearest to those given, by least squares over all nodes and states; of all such
    /// constants those nearest to `start` (N/m).
    ///
    /// # Errors
    /// [`ElementError::DependentSprings`] when the states do not tell shared moduli apart.
    pub fn fit_forces(
        &self,
        states: &[State],
        sharing: Sharing,
        start: &[f64],
    ) -> Result<WholeFit, ElementError> {
        let units: Vec<_> =
            states.iter().map(|state| self.unit_forces(&state.displacements)).collect();
        let along = |s: usize, unit: &Vector3<f64>, forces: &[Vector3<f64>]| {
            let [a, b] = self.edges[s].map(|n| forces[n as usize]);
            unit.dot(&(a - b))
        };
        let sum = |of: &dyn Fn(usize) -> Vec<Vector3<f64>>| {
            let mut sums = vec![0.0; self.edges.len()];
            for (p, units) in units.iter().enumerate() {
                let forces = of(p);
                for (s, unit) in units.iter().enumerate() {
                    sums[s] += along(s, unit, &forces);
                }
            }
            sums
        };
        let given = |p: usize| -> Vec<Vector3<f64>> {
            states[p].forces.iter().map(|f| Vector3::from(*f)).collect()
        };
        let mut diagonal = vec![0.0; self.edges.len()];
        for units in &units {
            diagonal.iter_mut().zip(units).for_each(|(d, unit)| *d += 2.0 * unit.norm_squared());
        }
        let problem = LeastSquares {
            normal: &|constants: &[f64]| sum(&|p| self.forces(&units[p], constants)),
            right: sum(&given),
            diagonal,
            start: start.to_vec(),
        };
        let mut fit = self.solve(&problem, sharing)?;
        fit.residual = self.force_residual(states, &fit.constants);
        Ok(fit)
    }

    /// Root of the sum of squares of what the forces of springs of these constants (N/m) miss in some states, over that of the
    /// forces.
    pub fn force_residual(&self, states: &[State], constants: &[f64]) -> f64 {
        let (mut missed, mut all) = (0.0, 0.0);
        for state in states {
            let own = self.forces(&self.unit_forces(&state.displacements), constants);
            for (own, given) in own.iter().zip(&state.forces) {
                let given = Vector3::from(*given);
                missed += (own - given).norm_squared();
                all += given.norm_squared();
            }
        }
        (missed / all).sqrt()
    }

    fn solve(
        &self,
        problem: &LeastSquares<'_>,
        sharing: Sharing,
    ) -> Result<WholeFit, ElementError> {
        let empty = WholeFit {
            constants: Vec::new(),
            moduli: Vec::new(),
            residual: 0.0,
            unknowns: self.edges.len(),
            iterations: 0,
            gradient: 0.0,
        };
        if sharing == Sharing::Springs {
            let (constants, iterations, gradient) = problem.solve();
            return Ok(WholeFit { constants, iterations, gradient, ..empty });
        }
        let n = self.parts.len();
        let products: Vec<Vec<f64>> =
            self.parts.iter().map(|(_, part)| (problem.normal)(part)).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let gram = DMatrix::from_fn(n, n, |i, j| dot(&self.parts[i].1, &products[j]));
        let right = DVector::from_fn(n, |i, _| dot(&self.parts[i].1, &problem.right));
        // moduli of one size whatever the sizes of elements
        let scale = DVector::from_fn(n, |i, _| gram[(i, i)].sqrt().recip());
        if scale.iter().any(|x| !x.is_finite()) {
            return Err(ElementError::DependentSprings);
        }
        let scaled = DMatrix::from_fn(n, n, |i, j| scale[i] * gram[(i, j)] * scale[j]);
        let least = scaled.clone().symmetric_eigenvalues().min();
        if least < DEPENDENT {
            return Err(ElementError::DependentSprings);
        }
        let factor = scaled.cholesky().ok_or(ElementError::DependentSprings)?;
        let moduli = factor.solve(&right.component_mul(&scale)).component_mul(&scale);
        let mut constants = vec![0.0; self.edges.len()];
        for ((_, part), modulus) in self.parts.iter().zip(&moduli) {
            constants.iter_mut().zip(part).for_each(|(k, part)| *k += modulus * part);
        }
        let moduli = self.parts.iter().zip(&moduli).map(|((kind, _), m)| (*kind, *m)).collect();
        Ok(WholeFit { constants, moduli, unknowns: n, ..empty })
    }
}

/// Least eigenvalue, of a matrix with ones on its diagonal, below which moduli cannot be told apart.
const DEPENDENT: f64 = 1e-12;

/// Normal equations over all springs.
struct LeastSquares<'a> {
    normal: &'a dyn Fn(&[f64]) -> Vec<f64>,
    right: Vec<f64>,
    diagonal: Vec<f64>,
    start: Vec<f64>,
}

impl LeastSquares<'_> {
    /// Conjugate gradients with the diagonal: constants, iterations, and what is left of the gradient. Springs whose diagonal is 0
    /// stay.
    fn solve(&self) -> (Vec<f64>, usize, f64) {
        let scaled = |r: &[f64]| -> Vec<f64> {
            r.iter().zip(&self.diagonal).map(|(r, d)| if *d > 0.0 { r / d } else { 0.0 }).collect()
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let whole = dot(&self.right, &scaled(&self.right));
        let mut x = self.start.clone();
        if whole == 0.0 {
            return (x, 0, 0.0);
        }
        let gradient = |x: &[f64]| -> Vec<f64> {
            self.right.iter().zip((self.normal)(x)).map(|(b, y)| b - y).collect()
        };
        let limit = (ITERATIONS.0 * x.len() + 100).min(ITERATIONS.1);
        let mut r = gradient(&x);
        let mut z = scaled(&r);
        let (mut p, mut rz) = (z.clone(), dot(&r, &z));
        let mut iterations = 0;
        while rz > TOLERANCE * TOLERANCE * whole && iterations < limit {
            let q = (self.normal)(&p);
            let curvature = dot(&p, &q);
            if curvature <= 0.0 {
                break;
            }
            let step = rz / curvature;
            x.iter_mut().zip(&p).for_each(|(x, p)| *x += step * p);
            r.iter_mut().zip(&q).for_each(|(r, q)| *r -= step * q);
            z = scaled(&r);
            let next = dot(&r, &z);
            let keep = next / rz;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + keep * *p);
            rz = next;
            iterations += 1;
        }
        let r = gradient(&x);
        (x, iterations, (dot(&r, &scaled(&r)) / whole).sqrt())
    }
}
