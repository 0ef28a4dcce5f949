//! The largest stable explicit step, from forces alone.
//!
//! `omega_max^2` is the largest eigenvalue of `A = M^-1/2 K M^-1/2` on the free unknowns. A few
//! Lanczos steps give a Ritz value `theta` and its residual `r`; `theta + r` is taken, which for a
//! random start is an upper bound in practice after few steps (Zhou, Saad, Tiago and Chelikowsky
//! 2006), so an estimate that has not converged errs on the side of smaller steps. Products with `K`
//! are differences of forces: one force evaluation each, no tangent is ever formed.
//!
//! The element matrix of a tetrahedron depends on its deformation only through the lengths of its six
//! edges, up to rotation. So an estimate is good until the squared length of some edge has changed by
//! `STRAIN_CHANGE` of its rest value; then a few steps from the last mode renew it.

use crate::state::{NodeState, Rows, dot3, evaluate, read_force};
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};
use sinew_engine::columns::single_table;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::RestPosition;
use sinew_engine::workers::Workers;

/// Change of squared edge length over squared rest length at which the estimate is renewed.
pub const STRAIN_CHANGE: f64 = 0.2;
/// Length of the differences over the shortest edge.
const DIFFERENCE: f64 = 1e-3;
/// Rounds of Lanczos steps from a random start, and steps of each.
const COLD: [usize; 2] = [3, 8];
/// The same from the last mode.
const WARM: [usize; 2] = [1, 5];
/// Share of random noise in the start from the last mode: a new mode must be met, too.
const NOISE: f64 = 0.2;
/// Edges per piece of work.
const EDGE_CHUNK: usize = 8192;

/// Estimate of the stability limit, kept over steps.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub struct StabilityLimit<S> {
    /// Largest stable step (s).
    limit: Option<f64>,
    /// Relative change of squared edge lengths from rest at the estimate.
    strain: Vec<f32>,
    /// Mode of the largest Ritz value, `M^1/2 x`, of length 1.
    mode: Rows<S>,
    #[serde(skip)]
    basis: Vec<Rows<S>>,
    #[serde(skip)]
    next: Rows<S>,
    #[serde(skip)]
    trial: Rows<S>,
    #[serde(skip)]
    force: Rows<S>,
    /// Square roots of the inverse masses, 0 for held unknowns.
    root: Rows<S>,
    shortest: f64,
}

impl<S: Scalar> StabilityLimit<S> {
    /// A copy without work space.
    pub fn memory(&self) -> Self {
        let Self { limit, strain, mode, root, shortest, .. } = self;
        Self {
            limit: *limit,
            strain: strain.clone(),
            mode: mode.clone(),
            root: root.clone(),
            shortest: *shortest,
            ..Self::default()
        }
    }

    /// Whether it can belong to so many vertex rows and edges.
    pub fn fits(&self, rows: usize, edges: usize) -> bool {
        self.limit.is_none()
            || (self.strain.len() == edges && self.mode.len() == rows && self.root.len() == rows)
    }

    /// Makes the next estimate start from nothing.
    pub fn forget(&mut self) {
        self.limit = None;
    }

    /// Largest stable step (s) at `node.u`, where the elastic force is `force`; infinite when nothing
    /// can move, 0 when no step is safe. Counts force evaluations; the displacement column is left
    /// changed when there were any.
    pub fn get(
        &mut self,
        world: &mut World,
        node: &NodeState<S>,
        force: &[[S; 4]],
        evaluations: &mut u32,
    ) -> f64 {
        let change = match self.limit {
            Some(limit) => {
                let change = self.strain_change(world, node);
                if change <= STRAIN_CHANGE {
                    return limit;
                }
                change
            }
            None => f64::INFINITY,
        };
        let cold = self.limit.is_none() || change.is_nan();
        if cold {
            self.shortest = shortest_edge(world);
            if !self.shortest.is_finite() {
                // no element is left
                return f64::INFINITY;
            }
            self.root.clear();
            self.root.extend(node.mass.iter().enumerate().map(|(row, m)| {
                // vertices without mass stay where they are
                let root = if *m > S::ZERO { S::ONE / m.sqrt() } else { S::ZERO };
                let axis = |k| if node.free(row, k) { root } else { S::ZERO };
                [axis(0), axis(1), axis(2), S::ZERO]
            }));
            self.mode.clear();
            self.mode.resize(node.len(), [S::ZERO; 4]);
        }
        add_noise(&mut self.mode, &self.root, if cold { 1.0 } else { NOISE });
        let mut largest = 0.0;
        let [rounds, steps] = if cold { COLD } else { WARM };
        for _ in 0..rounds {
            largest = self.lanczos(world, node, force, steps, evaluations);
        }
        // not a number: the state is beyond the range of the number type
        let limit = if !largest.is_finite() {
            0.0
        } else if largest > 0.0 {
            2.0 / largest.sqrt()
        } else {
            f64::INFINITY
        };
        self.limit = None;
        self.strain.clear();
        let edges = world.resource::<Topology>().edges.len();
        self.strain.resize(edges, 0.0);
        self.strain_change(world, node);
        self.limit = Some(limit);
        limit
    }

    /// Largest change of the relative squared edge lengths since the estimate. With no estimate they
    /// are written to `self.strain` instead.
    fn strain_change(&mut self, world: &mut World, node: &NodeState<S>) -> f64 {
        let mut rests = world.query::<&RestPosition>();
        let Some(rest) = single_table(rests.contiguous_iter(world)) else { return 0.0 };
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        let edges = &topology.edges;
        if self.strain.len() != edges.len() {
            return f64::NAN;
        }
        let strain_of = |edge: [u32; 2]| {
            let [a, b] = edge.map(|v| v as usize);
            let x = (rest[a].0 - rest[b].0).to_array();
            let (mut change, mut length) = (0.0, 0.0);
            for k in 0..3 {
                let d = (node.u[a][k] - node.u[b][k]).to_f64();
                change += d * (x[k] + x[k] + d);
                length += x[k] * x[k];
            }
            (change / length) as f32
        };
        let mut pieces: Vec<(usize, &mut [f32], &[[u32; 2]], f32)> = self
            .strain
            .chunks_mut(EDGE_CHUNK)
            .zip(edges.chunks(EDGE_CHUNK))
            .enumerate()
            .map(|(i, (s, e))| (i * EDGE_CHUNK, s, e, 0.0))
            .collect();
        let keep = self.limit.is_some();
        workers.for_each(&mut pieces, edges.len() * 4, |_, (first, strain, edges, largest)| {
            for (i, (then, &edge)) in strain.iter_mut().zip(*edges).enumerate() {
                // without stiffness its length is of no matter
                let now = if topology.uses_edge(*first + i) { strain_of(edge) } else { 0.0 };
                if keep {
                    let change = (now - *then).abs();
                    // NaN must count as a change
                    *largest = if change <= *largest { *largest } else { change };
                } else {
                    *then = now;
                }
            }
        });
        let mut largest = 0.0_f32;
        for (.., change) in pieces {
            largest = if change <= largest { largest } else { change };
        }
        f64::from(largest)
    }

    /// One round of Lanczos steps from `self.mode`, which becomes the Ritz vector; returns the largest
    /// Ritz value plus its residual.
    fn lanczos(
        &mut self,
        world: &mut World,
        node: &NodeState<S>,
        force: &[[S; 4]],
        steps: usize,
        evaluations: &mut u32,
    ) -> f64 {
        let norm = self.mode.iter().map(|x| dot3(x, x)).sum::<f64>().sqrt();
        if norm == 0.0 {
            return 0.0;
        }
        self.basis.resize_with(steps.max(self.basis.len()), Vec::new);
        self.basis[0].clear();
        let scale = S::from_f64(1.0 / norm);
        self.basis[0].extend(self.mode.iter().map(|x| x.map(|x| x * scale)));
        let (mut alpha, mut beta) = (Vec::new(), Vec::<f64>::new());
        for j in 0..steps {
            self.product(world, node, force, j);
            *evaluations += 1;
            let q = &self.basis[j];
            let a: f64 = q.iter().zip(&self.next).map(|(q, w)| dot3(q, w)).sum();
            alpha.push(a);
            let a = S::from_f64(a);
            let b = beta.last().map_or(S::ZERO, |&b| S::from_f64(b));
            let before = &self.basis[j.saturating_sub(1)];
            let mut square = 0.0;
            for ((w, q), p) in self.next.iter_mut().zip(q).zip(before) {
                for k in 0..3 {
                    w[k] = w[k] - a * q[k] - b * p[k];
                }
                square += dot3(w, w);
            }
            let length = f64::sqrt(square);
            beta.push(length);
            // an invariant subspace, to rounding: the Ritz values are eigenvalues
            let bound = alpha.iter().fold(0.0, |m: f64, a| m.max(a.abs()));
            if !square.is_finite() || length <= 16.0 * S::EPSILON.to_f64() * bound {
                break;
            }
            if j + 1 < steps {
                let scale = S::from_f64(1.0 / length);
                let next = &self.next;
                self.basis[j + 1].clear();
                self.basis[j + 1].extend(next.iter().map(|w| w.map(|w| w * scale)));
            }
        }
        let (theta, vector) = largest_ritz_pair(&alpha, &beta);
        for row in 0..node.len() {
            let mut sum = [S::ZERO; 4];
            for (q, &c) in self.basis.iter().zip(&vector) {
                for k in 0..3 {
                    sum[k] += S::from_f64(c) * q[row][k];
                }
            }
            self.mode[row] = sum;
        }
        theta + beta.last().copied().unwrap_or(0.0) * vector.last().map_or(0.0, |c| c.abs())
    }

    /// `A q_j` into `self.next`.
    fn product(&mut self, world: &mut World, node: &NodeState<S>, force: &[[S; 4]], j: usize) {
        let q = &self.basis[j];
        let (mut way, mut reach) = (0.0_f64, 0.0_f64);
        for ((q, r), u) in q.iter().zip(&self.root).zip(&node.u) {
            for k in 0..3 {
                way = way.max((q[k] * r[k]).abs().to_f64());
                reach = reach.max(u[k].abs().to_f64());
            }
        }
        // above the rounding of the displacements
        let rounding = 64.0 * S::EPSILON.to_f64() * reach;
        let length = (DIFFERENCE * self.shortest).max(rounding) / way;
        let s = S::from_f64(length);
        self.trial.clear();
        self.trial.extend(node.u.iter().zip(q).zip(&self.root).map(|((u, q), r)| {
            let mut x = *u;
            (0..3).for_each(|k| x[k] += s * q[k] * r[k]);
            x
        }));
        evaluate(world, &self.trial, false, true, None);
        read_force(world, &mut self.force);
        let by = S::from_f64(1.0 / length);
        self.next.clear();
        self.next.extend(force.iter().zip(&self.force).zip(&self.root).map(|((f, g), r)| {
            let mut w = [S::ZERO; 4];
            (0..3).for_each(|k| w[k] = (f[k] - g[k]) * by * r[k]);
            w
        }));
    }
}

/// Adds noise of `share` of the length 1 to a vector, the same every time, on unknowns with a root.
fn add_noise<S: Scalar>(mode: &mut Rows<S>, root: &Rows<S>, share: f64) {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut next = || {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    // uniform numbers of width 1 have variance 1/12
    let scale = share * (12.0 / (3 * mode.len()) as f64).sqrt();
    for (x, r) in mode.iter_mut().zip(root) {
        for k in 0..3 {
            let noise = S::from_f64(scale * next());
            if r[k] > S::ZERO {
                x[k] += noise;
            }
        }
    }
}

/// Shortest edge (m) at rest.
fn shortest_edge(world: &mut World) -> f64 {
    let mut rests = world.query::<&RestPosition>();
    let Some(rest) = single_table(rests.contiguous_iter(world)) else { return 0.0 };
    let topology = world.resource::<Topology>();
    let length = |e: &[u32; 2]| rest[e[0] as usize].0.distance_squared(rest[e[1] as usize].0);
    let used = topology.edges.iter().enumerate().filter(|(i, _)| topology.uses_edge(*i));
    used.map(|(_, e)| length(e)).fold(f64::INFINITY, f64::min).sqrt()
}

/// Largest eigenvalue and its vector (length 1) of the symmetric tridiagonal matrix with diagonal
/// `alpha` and off-diagonal `beta` (its last entry is not part of the matrix).
fn largest_ritz_pair(alpha: &[f64], beta: &[f64]) -> (f64, Vec<f64>) {
    let n = alpha.len();
    let side = |j: usize| if j == 0 { 0.0 } else { beta[j - 1].abs() };
    let reach = |j: usize| side(j) + if j + 1 < n { beta[j].abs() } else { 0.0 };
    let mut high = (0..n).map(|j| alpha[j] + reach(j)).fold(f64::NEG_INFINITY, f64::max);
    let mut low = alpha.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !(high.is_finite() && low.is_finite()) {
        return (f64::NAN, vec![0.0; n]);
    }
    // bisection: above the largest eigenvalue all pivots of x - T are positive
    for _ in 0..60 {
        let x = 0.5 * (low + high);
        let mut pivot = f64::INFINITY;
        let above = (0..n).all(|j| {
            pivot = x - alpha[j] - side(j) * side(j) / pivot;
            pivot > 0.0
        });
        if above {
            high = x;
        } else {
            low = x;
        }
    }
    let mut vector = vec![1.0; n];
    for j in 1..n {
        let before = if j > 1 { beta[j - 2] * vector[j - 2] } else { 0.0 };
        vector[j] = ((high - alpha[j - 1]) * vector[j - 1] - before) / beta[j - 1];
    }
    let norm = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    vector.iter_mut().for_each(|x| *x /= norm);
    (high, vector)
}

#[cfg(test)]
mod tests {
    use super::largest_ritz_pair;

    #[test]
    fn second_difference_matrix() {
        for n in [1, 2, 5, 8] {
            let (alpha, beta) = (vec![2.0; n], vec![-1.0; n]);
            let (value, vector) = largest_ritz_pair(&alpha, &beta);
            let angle = std::f64::consts::PI * n as f64 / (n + 1) as f64;
            assert!((value - (2.0 - 2.0 * angle.cos())).abs() < 1e-13, "{n}: {value}");
            for j in 0..n {
                let left = if j > 0 { vector[j - 1] } else { 0.0 };
                let right = if j + 1 < n { vector[j + 1] } else { 0.0 };
                let residual = 2.0 * vector[j] - left - right - value * vector[j];
                assert!(residual.abs() < 1e-12, "{n}: row {j} {residual:e}");
            }
        }
    }
}
