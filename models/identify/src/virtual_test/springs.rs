//! Bodies of springs under a loading.

use serde::{Deserialize, Serialize};

use super::sparse::System;
use super::{Loading, VirtualTestError, by_node};
use crate::geometry::{norm, sub};

/// How equilibria of springs at finite displacement are sought.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpringOptions {
    /// Steps in which the loading is applied.
    pub load_steps: usize,
    /// Out-of-balance force, relative to the largest sum of spring forces on a node, at which a step is
    /// done.
    pub tolerance: f64,
    /// Newton steps to a load step.
    pub newton_steps: usize,
}

impl Default for SpringOptions {
    /// 10 load steps, 1e-10, 50 Newton steps.
    fn default() -> Self {
        Self { load_steps: 10, tolerance: 1e-10, newton_steps: 50 }
    }
}

/// Displacements of springs.
#[derive(Clone, Debug, PartialEq)]
pub struct SpringSolution {
    /// Displacements, m.
    pub displacements: Vec<[f64; 3]>,
    /// Whether the stiffness there is positive definite. An equilibrium where it is not is unstable.
    pub definite: bool,
    /// Linear systems solved.
    pub solves: usize,
}

/// Displacements of springs with their stiffness at rest, paper B's spring model.
///
/// `edges` and `constants` (N/m) as in [`FittedSprings`](crate::mesh::FittedSprings); `dimension` 2 or 3.
///
/// # Errors
/// [`VirtualTestError::Loading`], [`VirtualTestError::Singular`].
///
/// ```
/// use sinew_identify::virtual_test::{Loading, linear_springs};
///
/// let points = [[0.0; 3], [1.0, 0.0, 0.0]];
/// let mut loading = Loading { forces: vec![(1, [3.0, 0.0, 0.0])], ..Loading::default() };
/// loading.hold(&[0], 2, [0.0; 3]);
/// loading.displacements.push((1, 1, 0.0));
/// let solution = linear_springs(&points, &[[0, 1]], &[6.0], 2, &loading)?;
/// assert!((solution.displacements[1][0] - 0.5).abs() < 1e-15 && solution.definite);
/// # Ok::<(), sinew_identify::virtual_test::VirtualTestError>(())
/// ```
pub fn linear_springs(
    points: &[[f64; 3]],
    edges: &[[u32; 2]],
    constants: &[f64],
    dimension: usize,
    loading: &Loading,
) -> Result<SpringSolution, VirtualTestError> {
    let loading = loading.expand(points.len(), dimension)?;
    let mut system = System::new(&loading.held, dimension);
    let body = Springs::new(points, edges, constants, dimension);
    body.add_tangent(&vec![0.0; points.len() * dimension], &mut system);
    let held: Vec<f64> = loading.held.iter().map(|h| h.unwrap_or(0.0)).collect();
    let (u, definite) = system
        .solve(&loading.force, &held)
        .ok_or(VirtualTestError::Singular { body: "body of springs" })?;
    Ok(SpringSolution { displacements: by_node(&u, dimension), definite, solves: 1 })
}

/// Equilibrium of springs of energy `1/2 k (l - L)^2` at finite displacement.
///
/// The loading is applied in steps; in each, Newton's method with the exact tangent reduces the
/// out-of-balance force, with a line search on its norm. It may end in an unstable equilibrium, see
/// [`SpringSolution::definite`].
///
/// # Errors
/// [`VirtualTestError::Loading`], [`VirtualTestError::Singular`], [`VirtualTestError::NoEquilibrium`].
///
/// ```
/// use sinew_identify::virtual_test::{Loading, SpringOptions, rest_length_springs};
///
/// // two springs from (-1, 0) and (1, 0) meet at (0, 1) and are drawn out to (0, 2)
/// let points = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let (l, rest) = (5f64.sqrt(), 2f64.sqrt());
/// let force = 2.0 * (l - rest) * 2.0 / l;
/// let mut loading = Loading { forces: vec![(2, [0.0, force, 0.0])], ..Loading::default() };
/// loading.hold(&[0, 1], 2, [0.0; 3]);
/// let (edges, options) = ([[0, 2], [1, 2]], SpringOptions::default());
/// let solution = rest_length_springs(&points, &edges, &[1.0; 2], 2, &loading, &options)?;
/// let tip = solution.displacements[2];
/// assert!(tip[0].abs() < 1e-9 && (tip[1] - 1.0).abs() < 1e-9 && solution.definite);
/// # Ok::<(), sinew_identify::virtual_test::VirtualTestError>(())
/// ```
pub fn rest_length_springs(
    points: &[[f64; 3]],
    edges: &[[u32; 2]],
    constants: &[f64],
    dimension: usize,
    loading: &Loading,
    options: &SpringOptions,
) -> Result<SpringSolution, VirtualTestError> {
    let loading = loading.expand(points.len(), dimension)?;
    let body = Springs::new(points, edges, constants, dimension);
    let singular = VirtualTestError::Singular { body: "body of springs" };
    let unknowns = points.len() * dimension;
    let mut u = vec![0.0; unknowns];
    let mut solves = 0;
    let mut definite = true;
    for step in 1..=options.load_steps {
        let part = step as f64 / options.load_steps as f64;
        let force: Vec<f64> = loading.force.iter().map(|f| f * part).collect();
        let residual = |u: &[f64]| {
            let (mut r, scale) = body.forces(u);
            for i in 0..unknowns {
                r[i] = if loading.held[i].is_some() { 0.0 } else { r[i] + force[i] };
            }
            let applied = force.iter().fold(0f64, |m, f| m.max(f.abs()));
            (r, scale.max(applied))
        };
        let mut done = false;
        let mut relative = f64::INFINITY;
        // the first solve of a step moves the held nodes, and the others with them
        let mut moved = false;
        for _ in 0..options.newton_steps {
            let (r, scale) = residual(&u);
            relative = max_norm(&r) / scale;
            if moved && (relative <= options.tolerance || scale == 0.0) {
                done = true;
                break;
            }
            let held: Vec<f64> =
                (0..unknowns).map(|i| loading.held[i].map_or(0.0, |h| h * part - u[i])).collect();
            let mut system = System::new(&loading.held, dimension);
            body.add_tangent(&u, &mut system);
            let (du, is_definite) = system.solve(&r, &held).ok_or_else(|| singular.clone())?;
            (definite, solves) = (is_definite, solves + 1);
            let before = norm_squared(&r);
            let mut length = 1.0;
            loop {
                let trial: Vec<f64> = u.iter().zip(&du).map(|(u, d)| u + length * d).collect();
                // held nodes go all the way at once; a line search makes sense once they are there
                if !moved || norm_squared(&residual(&trial).0) < before || length < 1e-6 {
                    u = trial;
                    break;
                }
                length *= 0.5;
            }
            moved = true;
        }
        if !done {
            return Err(VirtualTestError::NoEquilibrium {
                step,
                steps: options.load_steps,
                residual: relative,
            });
        }
    }
    Ok(SpringSolution { displacements: by_node(&u, dimension), definite, solves })
}

/// Springs and their rest lengths.
pub(super) struct Springs<'a> {
    points: &'a [[f64; 3]],
    edges: &'a [[u32; 2]],
    constants: &'a [f64],
    dimension: usize,
    rest: Vec<f64>,
}

impl<'a> Springs<'a> {
    pub(super) fn new(
        points: &'a [[f64; 3]],
        edges: &'a [[u32; 2]],
        constants: &'a [f64],
        dimension: usize,
    ) -> Self {
        let length = |e: &[u32; 2]| norm(sub(points[e[0] as usize], points[e[1] as usize]));
        Self { points, edges, constants, dimension, rest: edges.iter().map(length).collect() }
    }

    /// Unit vector from the second node to the first, length, and change of length formed without
    /// cancellation: `l - L = (l^2 - L^2) / (l + L)`, `l^2 - L^2 = du . (2 X + du)`.
    pub(super) fn spring(&self, s: usize, u: &[f64]) -> ([f64; 3], f64, f64) {
        let [a, b] = self.edges[s].map(|n| n as usize);
        let rest = sub(self.points[a], self.points[b]);
        let mut du = [0.0; 3];
        for axis in 0..self.dimension {
            du[axis] = u[a * self.dimension + axis] - u[b * self.dimension + axis];
        }
        let now = [rest[0] + du[0], rest[1] + du[1], rest[2] + du[2]];
        // a spring of no length has no direction; its rest direction is as good as any
        let (along, length) = match norm(now) {
            0.0 => (rest, self.rest[s]),
            length => (now, length),
        };
        let unit = along.map(|x| x / length);
        let square: f64 = (0..3).map(|i| du[i] * (2.0 * rest[i] + du[i])).sum();
        (unit, length, square / (length + self.rest[s]))
    }

    /// Spring forces (N) at displacements `u`, and the largest sum of their magnitudes at a node.
    fn forces(&self, u: &[f64]) -> (Vec<f64>, f64) {
        let mut force = vec![0.0; u.len()];
        let mut sums = vec![0.0; self.points.len()];
        for (s, &k) in self.constants.iter().enumerate() {
            let (unit, _, change) = self.spring(s, u);
            let tension = k * change;
            let [a, b] = self.edges[s].map(|n| n as usize);
            for axis in 0..self.dimension {
                force[a * self.dimension + axis] -= tension * unit[axis];
                force[b * self.dimension + axis] += tension * unit[axis];
            }
            sums[a] += tension.abs();
            sums[b] += tension.abs();
        }
        (force, sums.into_iter().fold(0.0, f64::max))
    }

    /// `k [n n^T + (1 - L/l) (I - n n^T)]` of every spring; at rest `k n n^T`.
    fn add_tangent(&self, u: &[f64], system: &mut System) {
        let d = self.dimension;
        for (s, &k) in self.constants.iter().enumerate() {
            let (unit, length, change) = self.spring(s, u);
            let across = change / length;
            let [a, b] = self.edges[s].map(|n| n as usize);
            for i in 0..d {
                for j in 0..d {
                    let identity = if i == j { across } else { 0.0 };
                    let value = k * ((1.0 - across) * unit[i] * unit[j] + identity);
                    system.add(a * d + i, a * d + j, value);
                    system.add(b * d + i, b * d + j, value);
                    system.add(a * d + i, b * d + j, -value);
                    system.add(b * d + i, a * d + j, -value);
                }
            }
        }
    }
}

fn max_norm(r: &[f64]) -> f64 {
    r.iter().fold(0.0, |m, r| m.max(r.abs()))
}

fn norm_squared(r: &[f64]) -> f64 {
    r.iter().map(|r| r * r).sum()
}
