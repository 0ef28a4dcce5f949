//! Preconditioned conjugate gradients for a shifted tangent on the free unknowns.
//!
//! The system matrix is `A = c_M M + c_K K + c_C C` with lumped mass `M`, tangent `K` and an optional
//! frozen damping tangent `C`, restricted to the free unknowns: rows and columns of held unknowns
//! are taken out exactly by masking, not by penalties. Bodies do not couple, so each is solved alone. All sums run over fixed chunks in `f64`, so
//! the iterates do not depend on the number of threads.

use crate::state::{Rows, dot3};
use sinew_engine::matrix::{BlockMatrix, ProductSpans};
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;
use std::ops::Range;

/// The system matrix.
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

/// Result of a solve.
#[derive(Clone, Copy, Debug)]
pub struct CgOutcome {
    /// How it ended.
    pub status: CgStatus,
    /// Iterations.
    pub iterations: u32,
    /// Residual over that of the start vector (or the right-hand side, if smaller), Euclidean norm.
    pub residual: f64,
}

/// Work vectors, kept between solves.
#[derive(Clone, Debug, Default)]
pub struct CgScratch<S> {
    r: Rows<S>,
    z: Rows<S>,
    p: Rows<S>,
    q: Rows<S>,
    t: Rows<S>,
    inverse: Vec<[S; 9]>,
    spans: ProductSpans<S>,
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

    /// Inverses of the diagonal blocks of one body. A block that is not positive definite is replaced
    /// by the absolute values of its diagonal, so that the preconditioner always is.
    fn invert_diagonal(&self, body: usize, inverse: &mut Vec<[S; 9]>) {
        let rows = self.rows(body);
        inverse.resize(rows.len(), [S::ZERO; 9]);
        self.workers.for_chunks(inverse, CHUNK, rows.len() * 20, |first, blocks| {
            for (i, inverse) in blocks.iter_mut().enumerate() {
                let row = rows.start + first + i;
                let mut m = [0.0; 9];
                for k in 0..9 {
                    m[k] = self.tangent.diagonal[row][k].to_f64() * self.tangent_factor.to_f64();
                    if let Some((c, factor)) = self.damping {
                        m[k] += c.diagonal[row][k].to_f64() * factor.to_f64();
                    }
                }
                for k in 0..3 {
                    m[4 * k] += self.mass_factor.to_f64() * self.mass[row].to_f64();
                }
                for k in 0..3 {
                    if self.fixed[row].holds(k) {
                        for j in 0..3 {
                            m[3 * k + j] = 0.0;
                            m[3 * j + k] = 0.0;
                        }
                        m[4 * k] = 1.0;
                    }
                }
                *inverse = inverse_or_diagonal(&m).map(S::from_f64);
            }
        });
    }

    fn precondition(&self, inverse: &[[S; 9]], r: &[[S; 4]], z: &mut [[S; 4]]) {
        self.workers.for_chunks(z, CHUNK, r.len() * 4, |first, rows| {
            for (i, z) in rows.iter_mut().enumerate() {
                let (m, r) = (&inverse[first + i], &r[first + i]);
                for k in 0..3 {
                    z[k] = m[3 * k] * r[0] + m[3 * k + 1] * r[1] + m[3 * k + 2] * r[2];
                }
                z[3] = S::ZERO;
            }
        });
    }

    fn dot(&self, a: &[[S; 4]], b: &[[S; 4]]) -> f64 {
        self.workers.sum(a.len(), a.len() * 2, |range| {
            a[range.clone()].iter().zip(&b[range]).map(|(a, b)| dot3(a, b)).sum()
        })
    }

    /// Solves the rows of one body of `A x = b` from the start vector in `x`; `b` and `x` hold those
    /// rows only, and their held entries must be zero.
    ///
    /// The residual is measured against that of the start vector (or `b`, if smaller): a start that
    /// already carries the inertia must not make the forces look small.
    pub fn solve(
        &self,
        scratch: &mut CgScratch<S>,
        body: usize,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
        tolerance: f64,
        cap: u32,
    ) -> CgOutcome {
        // on a thread of the pool, regions follow each other without a hand-over
        if b.len() > CHUNK {
            self.workers.enter(|| self.iterate(scratch, body, b, x, tolerance, cap))
        } else {
            self.iterate(scratch, body, b, x, tolerance, cap)
        }
    }

    fn iterate(
        &self,
        scratch: &mut CgScratch<S>,
        body: usize,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
        tolerance: f64,
        cap: u32,
    ) -> CgOutcome {
        let n = b.len();
        let CgScratch { r, z, p, q, t, inverse, spans } = scratch;
        for v in [&mut *r, &mut *z, &mut *p, &mut *q] {
            v.resize(n, [S::ZERO; 4]);
        }
        self.invert_diagonal(body, inverse);
        let norm_b = self.dot(b, b).sqrt();
        if norm_b == 0.0 {
            x.fill([S::ZERO; 4]);
            return CgOutcome { status: CgStatus::Converged, iterations: 0, residual: 0.0 };
        }
        // r = b - A x
        if self.dot(x, x) > 0.0 {
            self.multiply(spans, t, body, x, q);
            for i in 0..n {
                for k in 0..3 {
                    r[i][k] = b[i][k] - q[i][k];
                }
            }
        } else {
            r.copy_from_slice(b);
        }
        self.precondition(inverse, r, z);
        p.copy_from_slice(z);
        let mut rho = self.dot(r, z);
        let norm_r = self.dot(r, r).sqrt();
        // below a few units of rounding of b there is nothing left to solve for
        let reference = norm_r.min(norm_b).max(16.0 * S::EPSILON.to_f64() * norm_b / tolerance);
        let mut residual = norm_r / reference;
        let mut iterations = 0;
        let status = loop {
            if !residual.is_finite() {
                break CgStatus::NotFinite;
            }
            if residual <= tolerance {
                break CgStatus::Converged;
            }
            if iterations == cap {
                break CgStatus::Cap;
            }
            self.multiply(spans, t, body, p, q);
            let curvature = self.dot(p, q);
            if !curvature.is_finite() {
                break CgStatus::NotFinite;
            }
            if curvature <= 0.0 {
                break CgStatus::Indefinite;
            }
            let alpha = S::from_f64(rho / curvature);
            let work = n * 4;
            self.workers.for_chunks(x, CHUNK, work, |first, rows| {
                for (x, p) in rows.iter_mut().zip(&p[first..]) {
                    for k in 0..3 {
                        x[k] += alpha * p[k];
                    }
                }
            });
            self.workers.for_chunks(r, CHUNK, work, |first, rows| {
                for (r, q) in rows.iter_mut().zip(&q[first..]) {
                    for k in 0..3 {
                        r[k] -= alpha * q[k];
                    }
                }
            });
            self.precondition(inverse, r, z);
            let next = self.dot(r, z);
            let beta = S::from_f64(next / rho);
            rho = next;
            self.workers.for_chunks(p, CHUNK, work, |first, rows| {
                for (p, z) in rows.iter_mut().zip(&z[first..]) {
                    for k in 0..3 {
                        p[k] = z[k] + beta * p[k];
                    }
                }
            });
            residual = self.dot(r, r).sqrt() / reference;
            iterations += 1;
        };
        CgOutcome { status, iterations, residual }
    }

    /// Preconditioned right-hand side of one body: a descent direction whatever the matrix.
    pub fn preconditioned(
        &self,
        scratch: &mut CgScratch<S>,
        body: usize,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
    ) {
        self.invert_diagonal(body, &mut scratch.inverse);
        self.precondition(&scratch.inverse, b, x);
    }
}

/// Inverse of a symmetric 3x3 matrix if it is positive definite, else of its absolute diagonal.
fn inverse_or_diagonal(m: &[f64; 9]) -> [f64; 9] {
    let c00 = m[4] * m[8] - m[5] * m[7];
    let c01 = m[5] * m[6] - m[3] * m[8];
    let c02 = m[3] * m[7] - m[4] * m[6];
    let det = m[0] * c00 + m[1] * c01 + m[2] * c02;
    let minor = m[0] * m[4] - m[1] * m[3];
    // definite with a margin against rounding, relative to the entries
    let scale = m[0].abs().max(m[4].abs()).max(m[8].abs());
    if m[0] > 0.0 && minor > 0.0 && det > 1e-14 * scale * scale * scale {
        let c11 = m[0] * m[8] - m[2] * m[6];
        let c12 = m[1] * m[6] - m[0] * m[7];
        let c22 = minor;
        return [c00, c01, c02, c01, c11, c12, c02, c12, c22].map(|c| c / det);
    }
    let mut d = [0.0; 9];
    for k in 0..3 {
        let entry = m[4 * k].abs().max(1e-3 * scale);
        d[4 * k] = if entry > 0.0 { 1.0 / entry } else { 1.0 };
    }
    d
}
