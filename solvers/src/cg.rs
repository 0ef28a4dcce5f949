//! Linear systems with a shifted tangent on the free unknowns.
//!
//! The system matrix is `A = c_M M + c_K K + c_C C` with lumped mass `M`, tangent `K` and an optional
//! frozen damping tangent `C`, restricted to the free unknowns: rows and columns of held unknowns
//! are taken out exactly by masking, not by penalties. Bodies do not couple, so each is solved alone.
//!
//! A solve adds the matrix up once and hands it to preconditioned conjugate gradients
//! ([`crate::engine`]). With mixed precision the matrix, the vectors and the preconditioner are in `f32` and
//! only a correction is solved for; the residual is formed anew in `f64` with the tangent as it came, and
//! corrections are added until that residual holds the tolerance. Where `f32` no longer gets closer, or
//! claims a negative curvature that the `f64` tangent does not confirm, the solve goes on in `f64`. Sums run over fixed pieces in `f64`, so the iterates do
//! not depend on the number of threads.

use crate::engine::{Engine, Inner, InnerStatus};
use crate::settings::{LinearPrecision, Preconditioner};
use crate::state::{Rows, dot3};
use crate::system::{Pattern, definite_inverse, diagonal_inverse, transpose_product};
use glam::DVec3;
use sinew_engine::matrix::{BlockMatrix, ProductSpans};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;
use std::ops::Range;

/// The system matrix.
#[derive(Clone, Copy)]
pub struct ShiftedTangent<'a, S> {
    /// Edge graph.
    pub topology: &'a Topology,
    /// Thread pool.
    pub workers: &'a Workers,
    /// Masses (kg).
    pub mass: &'a [S],
    /// Factor of the masses.
    pub mass_factor: S,
    /// Tangent.
    pub tangent: &'a BlockMatrix<S>,
    /// Factor of the tangent.
    pub tangent_factor: S,
    /// Frozen damping tangent and its factor.
    pub damping: Option<(&'a BlockMatrix<S>, S)>,
    /// Held unknowns.
    pub fixed: &'a [FixedAxes],
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CgStatus {
    /// The residual is below the tolerance.
    Converged,
    /// The iteration cap was reached.
    Cap,
    /// A direction of non-positive curvature turned up: the matrix is not positive definite.
    Indefinite,
    /// A number is not finite.
    NotFinite,
}

/// What a solve is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearOptions {
    /// Residual, relative to that of the start vector, at which the system counts as solved.
    pub tolerance: f64,
    /// Cap on iterations.
    pub max_iterations: u32,
    /// Preconditioner.
    pub preconditioner: Preconditioner,
    /// Number type of matrix and iteration.
    pub precision: LinearPrecision,
}

impl Default for LinearOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-3,
            max_iterations: 5_000,
            preconditioner: Preconditioner::default(),
            precision: LinearPrecision::default(),
        }
    }
}

/// Result of a solve.
#[derive(Clone, Copy, Debug)]
pub struct CgOutcome {
    /// How it ended.
    pub status: CgStatus,
    /// Iterations.
    pub iterations: u32,
    /// Residual over that of the start vector (or the right-hand side, if smaller), Euclidean norm.
    pub residual: f64,
    /// Preconditioner that was used, never [`Preconditioner::Auto`].
    pub preconditioner: Preconditioner,
    /// Times its values were computed; otherwise those of an earlier solve were used.
    pub refreshes: u32,
    /// Restarts of its factorisation after breakdowns.
    pub breakdowns: u32,
    /// The solve had to go on in full precision.
    pub fell_back: bool,
}

/// Solves the systems of the bodies of a world, one by one, and keeps what can be used again.
#[derive(Clone, Debug, Default)]
pub struct LinearSolver<S> {
    revision: u64,
    bodies: Vec<BodySolver<S>>,
    spans: ProductSpans<S>,
    damped: Rows<S>,
    residual: Rows<S>,
    correction: Rows<S>,
}

#[derive(Clone, Debug, Default)]
struct BodySolver<S> {
    pattern: Pattern,
    single: Engine<f32>,
    /// In use when `S` is `f64` and mixed precision is off or not enough.
    full: Engine<S>,
}

const CHUNK: usize = 2048;

impl<S: Scalar> ShiftedTangent<'_, S> {
    /// Vertex rows of a body.
    fn rows(&self, body: usize) -> Range<usize> {
        let rows = &self.topology.bodies[body].vertices;
        rows.start as usize..rows.end as usize
    }

    /// `y = A x` for the rows of one body; held entries of `x` must be zero, those of `y` are.
    pub fn multiply(
        &self,
        spans: &mut ProductSpans<S>,
        scratch: &mut Rows<S>,
        body: usize,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        let offset = self.rows(body).start;
        self.tangent.multiply_body(self.topology, self.workers, spans, body, x, y);
        let damping = self.damping.map(|(matrix, factor)| {
            scratch.resize(x.len(), [S::ZERO; 4]);
            matrix.multiply_body(self.topology, self.workers, spans, body, x, scratch);
            (&*scratch, factor)
        });
        self.workers.for_chunks(y, CHUNK, x.len() * 4, |first, rows| {
            for (i, y) in rows.iter_mut().enumerate() {
                let local = first + i;
                let row = offset + local;
                let m = self.mass_factor * self.mass[row];
                for k in 0..3 {
                    y[k] = y[k] * self.tangent_factor + m * x[local][k];
                    if let Some((c, factor)) = damping {
                        y[k] += factor * c[local][k];
                    }
                    if self.fixed[row].holds(k) {
                        y[k] = S::ZERO;
                    }
                }
                y[3] = S::ZERO;
            }
        });
    }

    /// Right-hand side of one body times the inverse diagonal blocks: a descent direction whatever the
    /// matrix.
    pub fn preconditioned(&self, body: usize, b: &[[S; 4]], x: &mut [[S; 4]]) {
        let mut matrix = crate::system::SystemMatrix::<S>::default();
        matrix.assemble(self, body);
        for ((m, b), x) in matrix.diagonal.iter().zip(b).zip(x) {
            let inverse = definite_inverse(m).unwrap_or_else(|| diagonal_inverse(m));
            *x = transpose_product(&inverse, *b).map(|x| x * S::from_f64(matrix.factor));
        }
    }
}

impl<S: Scalar> LinearSolver<S> {
    /// Solves the rows of one body of `A x = b` from the start vector in `x`; `b` and `x` hold those
    /// rows only, and their held entries must be zero. `rest` holds the rest positions (m) of all
    /// rows of the world.
    ///
    /// The residual is measured against that of the start vector (or `b`, if smaller): a start that
    /// already carries the inertia must not make the forces look small.
    pub fn solve(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        rest: &[DVec3],
        body: usize,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
        options: &LinearOptions,
    ) -> CgOutcome {
        if self.revision != system.topology.revision
            || self.bodies.len() != system.topology.bodies.len()
        {
            self.revision = system.topology.revision;
            self.bodies.clear();
            self.bodies.resize_with(system.topology.bodies.len(), BodySolver::default);
        }
        if self.bodies[body].pattern.is_empty() {
            self.bodies[body].pattern = Pattern::new(system.topology, body);
        }
        // on a thread of the pool, regions follow each other without a hand-over
        system.workers.enter(|| self.refine(system, rest, body, b, x, options))
    }

    fn refine(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        rest: &[DVec3],
        body: usize,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
        options: &LinearOptions,
    ) -> CgOutcome {
        let mut outcome = CgOutcome {
            status: CgStatus::Converged,
            iterations: 0,
            residual: 0.0,
            preconditioner: options.preconditioner.resolve(b.len()),
            refreshes: 0,
            breakdowns: 0,
            fell_back: false,
        };
        let norm_b = norm(b);
        if norm_b == 0.0 {
            x.fill([S::ZERO; 4]);
            return outcome;
        }
        let mut r = std::mem::take(&mut self.residual);
        let mut e = std::mem::take(&mut self.correction);
        r.clear();
        r.extend_from_slice(b);
        if x.iter().any(|x| *x != [S::ZERO; 4]) {
            self.subtract_product(system, body, x, &mut r, &mut e);
        }
        let norm_r = norm(&r);
        // below a few units of rounding of b there is nothing left to solve for
        let floor = 16.0 * S::EPSILON.to_f64() * norm_b / options.tolerance;
        let reference = norm_r.min(norm_b).max(floor);
        let same_type = size_of::<S>() == size_of::<f32>();
        let mut mixed = options.precision == LinearPrecision::Mixed || same_type;
        let mut assembled = [false; 2];
        let mut now = norm_r;
        loop {
            outcome.residual = now / reference;
            if !now.is_finite() {
                outcome.status = CgStatus::NotFinite;
                break;
            }
            if outcome.residual <= options.tolerance {
                outcome.status = CgStatus::Converged;
                break;
            }
            if outcome.iterations >= options.max_iterations {
                outcome.status = CgStatus::Cap;
                break;
            }
            let mut target = options.tolerance * reference / now;
            if mixed && !same_type {
                // a little below, since the recurrence drifts; f32 gets no further than this at once
                target = (0.9 * target).max(SINGLE_REDUCTION);
            }
            let own = &mut self.bodies[body];
            let cap = options.max_iterations - outcome.iterations;
            let pattern = &own.pattern;
            let kind = outcome.preconditioner;
            e.resize(b.len(), [S::ZERO; 4]);
            let inner = if mixed {
                if !assembled[0] {
                    own.single.assemble(system, body);
                    assembled[0] = true;
                }
                own.single.solve(system, pattern, rest, body, kind, &r, &mut e, now, target, cap)
            } else {
                if !assembled[1] {
                    own.full.assemble(system, body);
                    assembled[1] = true;
                }
                own.full.solve(system, pattern, rest, body, kind, &r, &mut e, now, target, cap)
            };
            let Inner { status, iterations, reduction, refreshes, breakdowns } = inner;
            outcome.iterations += iterations;
            outcome.refreshes += refreshes;
            outcome.breakdowns += breakdowns;
            let to_full = |mixed: &mut bool, outcome: &mut CgOutcome| {
                *mixed = false;
                outcome.fell_back = true;
            };
            match status {
                InnerStatus::NotFinite | InnerStatus::Indefinite if mixed && !same_type => {
                    // only the tangent as it came may say that it is indefinite
                    if status == InnerStatus::Indefinite {
                        own.single.direction(pattern, &mut e);
                        let curvature = self.curvature(system, body, &e);
                        if curvature <= 0.0 {
                            outcome.status = CgStatus::Indefinite;
                            break;
                        }
                    }
                    to_full(&mut mixed, &mut outcome);
                    continue;
                }
                InnerStatus::NotFinite => {
                    outcome.status = CgStatus::NotFinite;
                    break;
                }
                InnerStatus::Indefinite => {
                    outcome.status = CgStatus::Indefinite;
                    break;
                }
                InnerStatus::Converged | InnerStatus::Cap => {}
            }
            for (x, e) in x.iter_mut().zip(&e) {
                for k in 0..3 {
                    x[k] += e[k];
                }
            }
            if !(mixed && !same_type) {
                // the iteration ran in the number type of the state: its own residual counts
                outcome.residual = reduction * now / reference;
                outcome.status = if status == InnerStatus::Converged {
                    CgStatus::Converged
                } else {
                    CgStatus::Cap
                };
                break;
            }
            self.subtract_product_of(system, body, b, x, &mut r, &mut e);
            let next = norm(&r);
            if next > STALLED * now && next > options.tolerance * reference {
                to_full(&mut mixed, &mut outcome);
            }
            now = next;
        }
        self.residual = r;
        self.correction = e;
        outcome
    }

    /// `r = b - A x`.
    fn subtract_product_of(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        body: usize,
        b: &[[S; 4]],
        x: &[[S; 4]],
        r: &mut Rows<S>,
        work: &mut Rows<S>,
    ) {
        r.clear();
        r.extend_from_slice(b);
        self.subtract_product(system, body, x, r, work);
    }

    /// `r -= A x`.
    fn subtract_product(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        body: usize,
        x: &[[S; 4]],
        r: &mut [[S; 4]],
        work: &mut Rows<S>,
    ) {
        work.resize(x.len(), [S::ZERO; 4]);
        system.multiply(&mut self.spans, &mut self.damped, body, x, work);
        for (r, q) in r.iter_mut().zip(&*work) {
            for k in 0..3 {
                r[k] -= q[k];
            }
        }
    }

    /// `p . A p`.
    fn curvature(&mut self, system: &ShiftedTangent<'_, S>, body: usize, p: &[[S; 4]]) -> f64 {
        let mut q = vec![[S::ZERO; 4]; p.len()];
        system.multiply(&mut self.spans, &mut self.damped, body, p, &mut q);
        p.iter().zip(&q).map(|(p, q)| dot3(p, q)).sum()
    }
}

/// Reduction of the residual asked of one round in `f32`.
const SINGLE_REDUCTION: f64 = 1e-5;
/// A round that reduces the residual by less than this is the last one in `f32`.
const STALLED: f64 = 0.5;

/// Euclidean norm.
fn norm<S: Scalar>(x: &[[S; 4]]) -> f64 {
    x.iter().map(|x| dot3(x, x)).sum::<f64>().sqrt()
}
