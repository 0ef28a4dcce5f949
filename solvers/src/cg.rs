//! Preconditioned conjugate gradients in one number type, and what they keep between solves.
//!
//! An iteration is two parallel regions over the fixed pieces of the pattern: one forms the new
//! direction, multiplies the piece's rows of the upper half and takes the scalar product on the way; the
//! other updates solution and residual, applies the preconditioner to the piece and takes the
//! other two products. What a piece adds to the rows of later ones stays in its own array and is
//! fetched by them.
//!
//! Values of the preconditioner are kept over solves, and over cuts, which add blocks and rows. They are computed again when
//! the unknowns held of other rows or the factors of the matrix change, and when the iterations spent beyond those of the first solve
//! after the last refresh add up to what a refresh costs, in the middle of a solve if need be, or when
//! a solve with them did not converge.

use crate::cholesky::{FactorPiece, FactorValues, IncompleteCholesky};
use crate::coarse::{CoarseSpace, CoarseValues, Motion};
use crate::low_rank::Correction;
use crate::settings::Preconditioner;
use crate::state::dot3;
use crate::system::{
    Pattern, ShiftedTangent, SystemMatrix, add4, dot, for_off_diagonal, ranges, scale4,
};
use glam::DVec3;
use memory::SharedValues;
use serde::{Deserialize, Serialize};
use sinew_contact::set::COUPLED;
use sinew_engine::isoparametric::MIDDLES;
use sinew_engine::layout::UNUSED;
use sinew_engine::scalar::{Row, Scalar};
use sinew_engine::simd::{VectorKernel, vectorised};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;
use std::ops::Range;
use std::sync::Arc;

pub mod memory;

/// The system of some bodies, and how it is solved.
#[derive(Clone, Copy)]
pub struct BodySystem<'a, S> {
    /// The matrix of its world.
    pub system: &'a ShiftedTangent<'a, S>,
    /// The bodies that are solved for together, consecutive ones.
    pub bodies: &'a Range<usize>,
    /// Pattern of its part of the matrix.
    pub pattern: &'a Arc<Pattern>,
    /// Rest positions (m) of all rows of the world.
    pub rest: &'a [DVec3],
    /// Preconditioner, neither [`Preconditioner::Auto`] nor [`Preconditioner::Direct`].
    pub preconditioner: Preconditioner,
}

/// When an inner solve ends.
#[derive(Clone, Copy, Debug)]
pub struct SolveLimits {
    /// Norm of the residual at its start.
    pub norm: f64,
    /// Reduction of the residual that is enough.
    pub target: f64,
    /// Most iterations.
    pub cap: u32,
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

/// Result of an inner solve.
#[derive(Clone, Copy, Debug)]
pub struct Inner {
    /// How it ended.
    pub status: CgStatus,
    /// Iterations.
    pub iterations: u32,
    /// Residual of the recurrence over that of the start.
    pub reduction: f64,
    /// Refreshes of the preconditioner.
    pub refreshes: u32,
    /// Restarts of its factorisation.
    pub breakdowns: u32,
}

/// Matrix, preconditioner and vectors of one body in one number type.
#[derive(Clone, Debug, Default)]
pub struct ConjugateGradients<T: Scalar> {
    /// The matrix.
    pub matrix: SystemMatrix<T>,
    product: Vec<ProductPiece<T>>,
    update: Vec<UpdatePiece<T>>,
    cholesky: IncompleteCholesky<T>,
    coarse: Option<CoarseSpace<T>>,
    /// Correction for the low-rank part of the matrix, if it has one.
    correction: Option<Correction<T>>,
    forces: Vec<[T; 8]>,
    motions: Vec<Motion<T>>,
    kept: Option<KeptFor>,
    /// Pattern that the preconditioner was made for, and connected piece of every row when its aggregates were chosen.
    laid_out_for: (Arc<Pattern>, Vec<u32>),
    shared: SharedValues<T>,
    /// Pieces, and rows in them, of the couplings of the matrix.
    coupled: Vec<[[u32; 2]; COUPLED]>,
    /// The same of the vectors that contact takes off.
    given: Vec<[u32; 2]>,
}

/// The matrix that the kept values of the preconditioner were computed for, and the iterations since.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct KeptFor {
    kind: Preconditioner,
    factors: [f64; 3],
    held: Vec<FixedAxes>,
    /// Factor of the matrix.
    scale: f64,
    /// Splits of the body: aggregates must not reach across a gap.
    splits: u64,
    /// Iterations per power of ten of the first solve after the refresh.
    fresh: Option<f64>,
    /// Iterations spent beyond that since.
    excess: f64,
    /// Iterations that a refresh costs.
    cost: f64,
}

impl KeptFor {
    /// Books a solve; the values are in use since so many iterations and at this reduction.
    fn book(&mut self, inner: &Inner, since: (u32, f64)) {
        let iterations = f64::from(inner.iterations - since.0);
        let decades = libm::log10(since.1 / inner.reduction);
        if inner.status != CgStatus::Converged {
            // made for a matrix that was given up: not worth keeping
            self.excess = f64::INFINITY;
        } else if let Some(fresh) = self.fresh {
            self.excess += (iterations - fresh * decades).max(0.0);
        } else if decades > 0.0 {
            self.fresh = Some(iterations / decades);
        }
    }
}

/// What a coarse space needs to know of the rows of a body.
#[derive(Clone, Copy, Debug)]
struct Rows<'a> {
    /// Rest position (m).
    rest: &'a [DVec3],
    /// Connected piece.
    piece: &'a [u32],
    /// See [`ends`].
    ends: &'a [[u32; 2]],
}

/// What the first region of an iteration writes, rows from the piece's first to its reach.
#[derive(Clone, Debug, Default)]
struct ProductPiece<T> {
    p: Vec<[T; 4]>,
    q: Vec<[T; 4]>,
    curvature: f64,
}

/// What the second region writes, rows of the piece.
#[derive(Clone, Debug, Default)]
struct UpdatePiece<T> {
    x: Vec<[T; 4]>,
    r: Vec<[T; 4]>,
    z: Vec<[T; 4]>,
    /// `r . z` of the piece's part of the preconditioner.
    rz: f64,
    rr: f64,
    /// Forces on the nodes that the piece's rows follow.
    coarse: Vec<[T; 8]>,
    nodes: Range<usize>,
}

/// Share of an iteration that a multiplication of blocks takes in a factorisation, which is less
/// regular than a product.
const FACTOR_COST: f64 = 5.0;

/// Iterations beyond which a coarse space pays in small bodies, too.
const SLOW: f64 = 12.0;

impl<T: Scalar> ConjugateGradients<T> {
    /// Solves `A e = r` for the correction `e` of the residual `r`.
    pub fn solve<S: Scalar>(
        &mut self,
        of: &BodySystem<'_, S>,
        residual: &[[S; 4]],
        correction: &mut [[S; 4]],
        limits: SolveLimits,
    ) -> Inner {
        let SolveLimits { norm, target, cap } = limits;
        let (workers, pattern) = (of.system.workers, of.pattern);
        self.coupled.clear();
        self.coupled
            .extend(self.matrix.couplings.iter().map(|c| c.rows.map(|row| pattern.place(row))));
        self.given.clear();
        self.given.extend(self.matrix.given.rows.iter().map(|row| pattern.place(*row)));
        self.take_in(pattern);
        let mut inner = Inner {
            status: CgStatus::Cap,
            iterations: 0,
            reduction: 1.0,
            refreshes: 0,
            breakdowns: 0,
        };
        // what kept values may spend before a refresh is cheaper
        let allowance = self.usable(of).map(|k| {
            let expected = k.fresh.map_or(0.0, |fresh| fresh * -libm::log10(target));
            (expected + k.cost - k.excess).ceil() as u32
        });
        let mut since = (0, 1.0);
        if let Some(allowance) = allowance {
            self.correct(pattern);
            self.load(pattern, residual, 1.0 / norm);
            self.iterate(workers, pattern, target, cap.min(allowance), &mut inner);
        }
        if allowance.is_none() || (inner.status == CgStatus::Cap && inner.iterations < cap) {
            since = (inner.iterations, inner.reduction);
            inner.breakdowns = self.refresh(of);
            inner.refreshes = 1;
            if allowance.is_none() {
                // the work space may be new
                self.load(pattern, residual, 1.0 / norm);
            }
            self.iterate(workers, pattern, target, cap, &mut inner);
        }
        if let Some(kept) = &mut self.kept {
            kept.book(&inner, since);
        }
        // the matrix was scaled by its factor and the residual by its norm
        let scale = norm * self.matrix.factor;
        for (piece, own) in pattern.pieces.iter().zip(&self.update) {
            for (to, from) in correction[piece.rows.clone()].iter_mut().zip(&own.x) {
                for k in 0..3 {
                    to[k] = S::from_f64(from[k].to_f64() * scale);
                }
            }
        }
        inner
    }

    /// Lets a kept preconditioner go on with blocks that came since it was made: what nothing acted on then has its diagonal block alone, in
    /// the scale of the others.
    fn take_in(&mut self, pattern: &Arc<Pattern>) {
        for (piece, own) in pattern.pieces.iter().zip(&mut self.product) {
            let reach = piece.reach - piece.rows.start;
            own.p.resize(reach, [T::ZERO; 4]);
            own.q.resize(reach, [T::ZERO; 4]);
        }
        let Self { matrix, cholesky, kept: Some(kept), laid_out_for: (made_for, pieces), .. } =
            self
        else {
            return;
        };
        if Arc::ptr_eq(made_for, pattern) {
            return;
        }
        let scale = T::from_f64(matrix.factor / kept.scale);
        for row in 0..kept.held.len() {
            let was_alone = pieces[row] == UNUSED && kept.held[row] == FixedAxes::ALL;
            if !was_alone || matrix.held[row] == FixedAxes::ALL {
                continue;
            }
            kept.held[row] = matrix.held[row];
            self.shared.forget();
            let [piece, own] = pattern.place(row as u32).map(|at| at as usize);
            if !cholesky.pieces[piece].set_alone(own, &matrix.diagonal[row], scale) {
                // as after a solve that did not converge
                kept.excess = f64::INFINITY;
            }
        }
    }

    /// The kept values of the preconditioner, if they may be used for a matrix.
    fn usable<S: Scalar>(&self, of: &BodySystem<'_, S>) -> Option<&KeptFor> {
        self.kept_for(of.system.topology, of.bodies).filter(|k| {
            k.kind == of.preconditioner
                && k.factors == of.system.factors()
                && k.held == self.matrix.held
                && (self.correction.is_some() || self.matrix.low_rank.is_empty())
                && k.excess < k.cost
        })
    }

    /// Whether the factor alone took more than twelve iterations for three powers of ten when it was new, or the coarse
    /// space was added for that.
    pub fn is_slow(&self, (topology, bodies): (&Topology, &Range<usize>)) -> bool {
        let slow = |k: &KeptFor| match k.kind {
            Preconditioner::Multigrid => true,
            Preconditioner::IncompleteCholesky => k.fresh.is_some_and(|decade| 3.0 * decade > SLOW),
            _ => false,
        };
        self.kept_for(topology, bodies).is_some_and(slow)
    }

    /// What is kept, unless bodies fell into other pieces since.
    fn kept_for(&self, topology: &Topology, bodies: &Range<usize>) -> Option<&KeptFor> {
        self.kept.as_ref().filter(|kept| kept.splits == splits(topology, bodies))
    }

    /// The last direction, any length.
    pub fn direction<S: Scalar>(&self, pattern: &Pattern, p: &mut [[S; 4]]) {
        for (piece, own) in pattern.pieces.iter().zip(&self.product) {
            for (to, from) in p[piece.rows.clone()].iter_mut().zip(&own.p) {
                *to = [0, 1, 2].map(|k| S::from_f64(from[k].to_f64())).padded();
            }
        }
    }

    /// Computes the preconditioner and notes what for; returns the restarts of its factorisation.
    fn refresh<S: Scalar>(&mut self, of: &BodySystem<'_, S>) -> u32 {
        let BodySystem { system, bodies, pattern, rest, preconditioner: kind } = *of;
        let splits = splits(system.topology, bodies);
        let rest = &rest[ranges(system.topology, bodies).0];
        if self.kept_for(system.topology, bodies).is_none() {
            self.kept = None;
        }
        let (piece, ends) = (&pieces(system.topology, bodies), &ends(system.topology, bodies));
        let rows = Rows { rest, piece, ends };
        let breakdowns = self.build(system.workers, pattern, rows, kind);
        let mut refresh = self.cholesky.work();
        let mut iteration = pattern.work();
        if let Some(coarse) = &self.coarse {
            refresh += coarse.work();
            iteration += coarse.solve_work();
        }
        iteration += self.correction.as_ref().map_or(0.0, Correction::work);
        let cost = FACTOR_COST * refresh / iteration;
        let held = self.matrix.held.clone();
        let factors = system.factors();
        let (scale, fresh, excess) = (self.matrix.factor, None, 0.0);
        self.kept = Some(KeptFor { kind, factors, held, scale, splits, fresh, excess, cost });
        breakdowns
    }

    /// Computes the values of the preconditioner, its symbolic part too when it is new.
    fn build(
        &mut self,
        workers: &Workers,
        pattern: &Arc<Pattern>,
        rows: Rows<'_>,
        kind: Preconditioner,
    ) -> u32 {
        self.shared.forget();
        // contact comes and goes: once there, the correction stays
        let corrected =
            self.kept.is_some() && self.correction.is_some() || !self.matrix.low_rank.is_empty();
        if self.kept.as_ref().is_none_or(|k| k.kind != kind)
            || self.correction.is_some() != corrected
            || self.laid_out_for.0 != *pattern
        {
            self.lay_out(pattern, rows, kind, corrected);
        }
        let breakdowns = self.cholesky.factorise(workers, pattern, &self.matrix);
        if let Some(coarse) = &mut self.coarse {
            coarse.factorise(workers, &self.matrix);
        }
        self.correct(pattern);
        breakdowns
    }

    /// Forms the correction for the low-rank part of this matrix, if it has one.
    fn correct(&mut self, pattern: &Pattern) {
        if let Some(correction) = &mut self.correction {
            correction.form(pattern, &self.matrix);
        }
    }

    /// Adds to `way` the shortest step (m), measured by the diagonal blocks of the matrix, that lowers the values of
    /// its low-rank vectors by `excess` (J^1/2); false, where it has no such vectors.
    pub fn restore<S: Scalar>(&self, excess: &[f64], way: &mut [[S; 4]]) -> bool {
        let Self { matrix, correction, .. } = self;
        let known = if matrix.own_vectors > 0 { matrix.own_vectors } else { matrix.low_rank.len() };
        let Some(correction) = correction.as_ref().filter(|_| known == excess.len()) else {
            return false;
        };
        let mut x: Vec<T> = excess.iter().map(|&x| T::from_f64(x)).collect();
        // those of threads stay as they are
        x.resize(matrix.low_rank.len(), T::ZERO);
        let factor = -matrix.factor.sqrt();
        let found = correction.restore(&matrix.low_rank, &mut x, way.len());
        for (to, z) in way.iter_mut().zip(found) {
            for k in 0..3 {
                to[k] += S::from_f64(factor * z[k].to_f64());
            }
        }
        true
    }

    /// The symbolic part of a preconditioner, and work space for it.
    fn lay_out(
        &mut self,
        pattern: &Arc<Pattern>,
        Rows { rest, piece, ends }: Rows<'_>,
        kind: Preconditioner,
        corrected: bool,
    ) {
        self.laid_out_for.0 = pattern.clone();
        self.laid_out_for.1.clear();
        self.laid_out_for.1.extend_from_slice(piece);
        let couplings = kind != Preconditioner::BlockJacobi;
        self.cholesky = IncompleteCholesky::new(pattern, couplings);
        self.correction = corrected.then(Correction::default);
        self.coarse = (kind == Preconditioner::Multigrid).then(|| {
            // in large bodies the work of the factor would outgrow that of an iteration
            let size = AGGREGATE.max((0.45 * (pattern.used as f64).sqrt()) as usize);
            (!ends.is_empty())
                .then(|| CoarseSpace::corners(pattern, ends))
                .flatten()
                .unwrap_or_else(|| CoarseSpace::rigid(pattern, rest, piece, size))
        });
        self.product.clear();
        // a solve may be under way, in the same rows
        let mut before = std::mem::take(&mut self.update).into_iter();
        for piece in &pattern.pieces {
            let (n, reach) = (piece.rows.len(), piece.reach - piece.rows.start);
            let zero = |n| vec![[T::ZERO; 4]; n];
            let before = before.next().filter(|own| own.x.len() == n);
            let (x, r) = before.map_or_else(|| (zero(n), zero(n)), |own| (own.x, own.r));
            self.product.push(ProductPiece { p: zero(reach), q: zero(reach), curvature: 0.0 });
            let nodes = self.coarse.as_ref().map_or(0..0, |c| c.nodes_of(piece.rows.clone()));
            self.update.push(UpdatePiece {
                x,
                r,
                z: zero(n),
                rz: 0.0,
                rr: 0.0,
                coarse: vec![[T::ZERO; 8]; nodes.len()],
                nodes,
            });
        }
        let nodes = self.coarse.as_ref().map_or(0, CoarseSpace::nodes);
        self.forces = vec![[T::ZERO; 8]; nodes];
    }

    /// Start of an iteration: residual `scale r`, solution zero.
    fn load<S: Scalar>(&mut self, pattern: &Pattern, r: &[[S; 4]], scale: f64) {
        for (piece, own) in pattern.pieces.iter().zip(&mut self.update) {
            own.x.fill([T::ZERO; 4]);
            for (to, from) in own.r.iter_mut().zip(&r[piece.rows.clone()]) {
                *to = [0, 1, 2].map(|k| T::from_f64(from[k].to_f64() * scale)).padded();
            }
        }
    }

    fn iterate(
        &mut self,
        workers: &Workers,
        pattern: &Pattern,
        target: f64,
        cap: u32,
        inner: &mut Inner,
    ) {
        let (mut rr, mut rho) = self.update(workers, pattern, None);
        let mut beta = T::ZERO;
        inner.status = loop {
            if !rr.is_finite() || !rho.is_finite() {
                break CgStatus::NotFinite;
            }
            inner.reduction = rr.sqrt();
            if inner.reduction <= target {
                break CgStatus::Converged;
            }
            if inner.iterations == cap {
                break CgStatus::Cap;
            }
            let curvature = self.multiply(workers, pattern, beta);
            if !curvature.is_finite() {
                break CgStatus::NotFinite;
            }
            if curvature <= 0.0 || rho <= 0.0 {
                break CgStatus::Indefinite;
            }
            let previous = rho;
            (rr, rho) = self.update(workers, pattern, Some(T::from_f64(rho / curvature)));
            beta = T::from_f64(rho / previous);
            inner.iterations += 1;
        };
    }

    /// `p = z + beta p` and `q = A p`; returns `p . q`.
    fn multiply(&mut self, workers: &Workers, pattern: &Pattern, beta: T) -> f64 {
        let Self { matrix, product, update, coarse, motions, correction, .. } = self;
        let (matrix, update, coarse, motions) = (&*matrix, &*update, coarse.as_ref(), &*motions);
        workers.for_each(product, usize::MAX, |index, own| {
            vectorised(Multiply { matrix, pattern, update, coarse, motions, beta, index, own });
        });
        let mut curvature: f64 = product.iter().map(|p| p.curvature).sum();
        if let Some(correction) = correction {
            correction.read(|piece, row| product[piece].p[row]);
            curvature += correction.multiply(&matrix.low_rank);
            correction.for_rows(|piece, row, more| {
                let q = &mut product[piece].q[row];
                *q = add4(*q, *more);
            });
        }
        if self.matrix.couplings.is_empty() && self.matrix.given.is_empty() {
            return curvature;
        }
        curvature + self.multiply_couplings() - self.take_off_given()
    }

    /// Takes what tools on springs give back off `q`; its part of `p . q`.
    fn take_off_given(&mut self) -> f64 {
        let Self { matrix, product, given, .. } = self;
        let mut dot = 0.0;
        for vector in 0..matrix.given.len() {
            let range = matrix.given.range(vector);
            let both = || given[range.clone()].iter().zip(&matrix.given.entries[range.clone()]);
            let place = |&[piece, row]: &[u32; 2]| [piece as usize, row as usize];
            let mut along = 0.0;
            for (at, v) in both() {
                let [piece, row] = place(at);
                along += dot3(&product[piece].p[row], v);
            }
            for (at, v) in both() {
                let [piece, row] = place(at);
                let q = &mut product[piece].q[row];
                *q = add4(*q, scale4(*v, T::from_f64(-along)));
            }
            dot += along * along;
        }
        dot
    }

    /// Adds what contact couples beside the diagonal to `q`; its part of `p . q`.
    fn multiply_couplings(&mut self) -> f64 {
        let Self { matrix, product, coupled, .. } = self;
        let mut dot = 0.0;
        for (coupling, places) in matrix.couplings.iter().zip(&*coupled) {
            let count = coupling.count as usize;
            let place = |i: usize| places[i].map(|at| at as usize);
            let mut x = [[0.0; 4]; COUPLED];
            for (i, x) in x[..count].iter_mut().enumerate() {
                let [piece, row] = place(i);
                *x = product[piece].p[row].map(Scalar::to_f64);
            }
            for_off_diagonal(coupling, &x[..count], |i, y| {
                let held = matrix.held[coupling.rows[i] as usize];
                let [piece, row] = place(i);
                for k in (0..3).filter(|&k| !held.holds(k)) {
                    dot += x[i][k] * y[k];
                    product[piece].q[row][k] += T::from_f64(y[k]);
                }
            });
        }
        dot
    }

    /// `x += alpha p`, `r -= alpha q`, `z = M^-1 r`; returns `r . r` and `r . z`. Without `alpha` only
    /// the preconditioner is applied, and the directions forgotten.
    fn update(&mut self, workers: &Workers, pattern: &Pattern, alpha: Option<T>) -> (f64, f64) {
        let Self { matrix, product, update, coarse, correction, forces, motions, .. } = self;
        let cholesky = &self.cholesky;
        if alpha.is_none() {
            for own in product.iter_mut() {
                own.p.fill([T::ZERO; 4]);
            }
        }
        let product = &*product;
        let ahead = correction.is_none();
        let space = coarse.as_ref();
        workers.for_each(update, usize::MAX, |index, own| {
            let ahead = ahead.then_some((&cholesky.pieces[index], space));
            vectorised(Update { pattern, product, ahead, alpha, index, own });
        });
        if let Some(correction) = correction {
            correction.read(|piece, row| update[piece].r[row]);
            correction.project(&matrix.low_rank);
            // the preconditioner sees what is projected, and the residual stays
            correction.for_rows(|piece, row, r| std::mem::swap(&mut update[piece].r[row], r));
            workers.for_each(update, usize::MAX, |index, own| {
                let (factor, first) = (&cholesky.pieces[index], pattern.pieces[index].rows.start);
                vectorised(Precondition { factor, space, first, own });
            });
            correction.for_rows(|piece, row, r| std::mem::swap(&mut update[piece].r[row], r));
        }
        let rr = update.iter().map(|u| u.rr).sum();
        let mut rz: f64 = update.iter().map(|u| u.rz).sum();
        if let Some(space) = coarse {
            forces.fill([T::ZERO; 8]);
            for own in &*update {
                for (total, part) in forces[own.nodes.clone()].iter_mut().zip(&own.coarse) {
                    for k in 0..6 {
                        total[k] += part[k];
                    }
                }
            }
            rz += space.solve(forces);
            space.motions(forces, motions);
        }
        if let Some(correction) = correction {
            correction.read(|piece, row| {
                let (z, row) = (update[piece].z[row], pattern.pieces[piece].rows.start + row);
                let motion = coarse.as_ref().map(|c| c.moved(row, motions, matrix.held[row]));
                motion.map_or(z, |motion| (T::Row::new(z) + motion).to_array())
            });
            rz += correction.complete(&matrix.low_rank);
            correction.for_rows(|piece, row, more| {
                let z = &mut update[piece].z[row];
                *z = add4(*z, *more);
            });
        }
        (rr, rz)
    }
}

/// Counts up when one of the bodies falls into other pieces.
fn splits(topology: &Topology, bodies: &Range<usize>) -> u64 {
    topology.bodies[bodies.clone()].iter().map(|body| body.splits).sum()
}

/// Numbers of the connected pieces of the rows of some bodies, which share none.
fn pieces(topology: &Topology, bodies: &Range<usize>) -> Vec<u32> {
    let mut first = 0;
    let mut pieces = Vec::new();
    for body in &topology.bodies[bodies.clone()] {
        let number = |&piece: &u32| if piece == UNUSED { UNUSED } else { piece + first };
        pieces.extend(body.piece.iter().map(number));
        first += body.piece_count() as u32;
    }
    pieces
}

/// The corners whose edge every row is in the middle of, twice the row itself for the others; nothing where no element has
/// middles.
fn ends(topology: &Topology, bodies: &Range<usize>) -> Vec<[u32; 2]> {
    let bodies = &topology.bodies[bodies.clone()];
    if bodies.iter().all(|body| body.tetrahedra10().is_empty()) {
        return Vec::new();
    }
    let rows: u32 = bodies.iter().map(|body| body.vertices.len() as u32).sum();
    let mut ends: Vec<[u32; 2]> = (0..rows).map(|row| [row; 2]).collect();
    let mut first = 0;
    for body in bodies {
        for nodes in body.tetrahedra10() {
            for (own, &middle) in MIDDLES.iter().zip(&nodes[4..]) {
                ends[(first + middle) as usize] = own.map(|corner| first + nodes[corner]);
            }
        }
        // a vertex that is both, where elements do not conform, is a corner
        for corner in body.tetrahedra10().iter().flat_map(|nodes| &nodes[..4]) {
            ends[(first + corner) as usize] = [first + corner; 2];
        }
        first += body.vertices.len() as u32;
    }
    ends
}

/// First region of an iteration for one piece.
struct Multiply<'a, T> {
    matrix: &'a SystemMatrix<T>,
    pattern: &'a Pattern,
    update: &'a [UpdatePiece<T>],
    coarse: Option<&'a CoarseSpace<T>>,
    motions: &'a [Motion<T>],
    beta: T,
    index: usize,
    own: &'a mut ProductPiece<T>,
}

impl<T: Scalar> VectorKernel for Multiply<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { matrix, pattern, update, coarse, motions, beta, index, own } = self;
        let (piece, beta) = (&pattern.pieces[index], T::Row::splat(beta));
        let mut at = piece.rows.start;
        // own rows, and those of later pieces that the blocks reach
        for (other, later) in update[index..].iter().zip(&pattern.pieces[index..]) {
            let end = later.rows.end.min(piece.reach);
            if at >= end {
                break;
            }
            let base = piece.rows.start;
            let p = &mut own.p[at - base..end - base];
            let z = &other.z[..end - at];
            match coarse {
                None => {
                    for (p, z) in p.iter_mut().zip(z) {
                        *p = (T::Row::new(*z) + T::Row::new(*p) * beta).to_array();
                    }
                }
                Some(coarse) => {
                    for (i, (p, z)) in p.iter_mut().zip(z).enumerate() {
                        let motion = coarse.moved(at + i, motions, matrix.held[at + i]);
                        let z = T::Row::new(*z) + motion;
                        *p = (z + T::Row::new(*p) * beta).to_array();
                    }
                }
            }
            at = end;
        }
        own.curvature = matrix.multiply_piece(pattern, piece, &own.p, &mut own.q);
    }
}

/// Second region of an iteration for one piece.
struct Update<'a, T> {
    pattern: &'a Pattern,
    product: &'a [ProductPiece<T>],
    /// The preconditioner, where nothing has to come before it.
    ahead: Option<(&'a FactorPiece<T>, Option<&'a CoarseSpace<T>>)>,
    alpha: Option<T>,
    index: usize,
    own: &'a mut UpdatePiece<T>,
}

impl<T: Scalar> VectorKernel for Update<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { pattern, product, ahead, alpha, index, own } = self;
        let rows = &pattern.pieces[index].rows;
        if let Some(alpha) = alpha {
            // what `q` has in its fourth entries ends here
            let alpha = T::Row::new([alpha, alpha, alpha, T::ZERO]);
            for (x, p) in own.x.iter_mut().zip(&product[index].p) {
                *x = (T::Row::new(*x) + T::Row::new(*p) * alpha).to_array();
            }
            for (r, q) in own.r.iter_mut().zip(&product[index].q) {
                *r = (T::Row::new(*r) - T::Row::new(*q) * alpha).to_array();
            }
            for (piece, other) in pattern.pieces[..index].iter().zip(product) {
                if piece.reach <= rows.start {
                    continue;
                }
                let q = &other.q[rows.start - piece.rows.start..];
                for (r, q) in own.r.iter_mut().zip(q) {
                    *r = (T::Row::new(*r) - T::Row::new(*q) * alpha).to_array();
                }
            }
        }
        if let Some((factor, space)) = ahead {
            own.precondition(factor, space, rows.start);
        }
        own.rr = dot(&own.r, &own.r);
    }
}

/// The preconditioner of one piece, for what a correction left.
struct Precondition<'a, T> {
    factor: &'a FactorPiece<T>,
    space: Option<&'a CoarseSpace<T>>,
    first: usize,
    own: &'a mut UpdatePiece<T>,
}

impl<T: Scalar> VectorKernel for Precondition<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { factor, space, first, own } = self;
        own.precondition(factor, space, first);
    }
}

impl<T: Scalar> UpdatePiece<T> {
    /// `z = M^-1 r` and `r . z`, and the forces on nodes.
    #[inline(always)]
    fn precondition(
        &mut self,
        factor: &FactorPiece<T>,
        space: Option<&CoarseSpace<T>>,
        first: usize,
    ) {
        let Self { r, z, rz, coarse, nodes, .. } = self;
        factor.apply(r, z);
        *rz = dot(r, z);
        if let Some(space) = space {
            coarse.fill([T::ZERO; 8]);
            space.restrict(first, r, nodes.start, coarse);
        }
    }
}

/// Vertices per aggregate of small bodies; in large ones aggregates grow, since the work of the
/// factor grows faster than that of an iteration.
const AGGREGATE: usize = 64;

trait Padded<T> {
    fn padded(self) -> [T; 4];
}

impl<T: Scalar> Padded<T> for [T; 3] {
    #[inline(always)]
    fn padded(self) -> [T; 4] {
        [self[0], self[1], self[2], T::ZERO]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::{Piece, product, sub4};
    use proptest::prelude::*;

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        }
    }

    /// Springs of random stiffness on a grid of points, a few unknowns held.
    fn springs(
        n: [usize; 3],
        seed: u64,
        pieces: usize,
    ) -> (Arc<Pattern>, SystemMatrix<f64>, Vec<DVec3>) {
        let count = n[0] * n[1] * n[2];
        let mut next = noise(seed);
        let rest: Vec<DVec3> = (0..count)
            .map(|i| {
                let cell = [i / (n[1] * n[2]), i / n[2] % n[1], i % n[2]];
                DVec3::from(cell.map(|c| c as f64)) + 0.2 * DVec3::new(next(), next(), next())
            })
            .collect();
        let (mut start, mut column) = (vec![0], Vec::new());
        let mut matrix = SystemMatrix::<f64> { factor: 1.0, ..Default::default() };
        matrix.diagonal = vec![[[0.0; 4]; 3]; count];
        matrix.held = (0..count).map(|_| FixedAxes(if next() > 0.4 { 5 } else { 0 })).collect();
        for i in 0..count {
            for k in 0..3 {
                matrix.diagonal[i][k][k] += 1e-3;
            }
            for j in (i + 1..count).filter(|&j| (rest[i] - rest[j]).length() < 1.6) {
                let d = (rest[i] - rest[j]).normalize().to_array();
                let k = 1.0 + next();
                column.push(j as u32);
                let mut block = [0.0; 9];
                for r in 0..3 {
                    for c in 0..3 {
                        let entry = &mut block[3 * r + c];
                        *entry = -k * d[r] * d[c];
                        matrix.diagonal[i][r][c] -= *entry;
                        matrix.diagonal[j][r][c] -= *entry;
                        if matrix.held[i].holds(r) || matrix.held[j].holds(c) {
                            *entry = 0.0;
                        }
                    }
                }
                matrix.upper.push(block);
            }
            start.push(column.len() as u32);
        }
        matrix.upper.push([0.0; 9]);
        for (m, held) in matrix.diagonal.iter_mut().zip(&matrix.held) {
            for (r, c) in (0..9).map(|i| (i / 3, i % 3)) {
                if held.holds(r) || held.holds(c) {
                    m[r][c] = if r == c { 1.0 } else { 0.0 };
                }
            }
        }
        let pieces = (0..pieces)
            .map(|p| {
                let rows = count * p / pieces..count * (p + 1) / pieces;
                let own = &column[start[rows.start] as usize..start[rows.end] as usize];
                let reach = own.iter().map(|&c| c as usize + 1).max().unwrap_or(0).max(rows.end);
                Piece { rows, reach }
            })
            .collect();
        (Arc::new(Pattern { start, column, pieces, used: rest.len() }), matrix, rest)
    }

    fn prepared(
        kind: Preconditioner,
        pattern: &Arc<Pattern>,
        matrix: &SystemMatrix<f64>,
        rest: &[DVec3],
        ends: &[[u32; 2]],
    ) -> ConjugateGradients<f64> {
        let mut cg = ConjugateGradients { matrix: matrix.clone(), ..Default::default() };
        let piece = vec![0; rest.len()];
        let rows = Rows { rest, piece: &piece, ends };
        cg.build(&Workers::serial(), pattern, rows, kind);
        cg
    }

    /// The preconditioner times `r`, by way of the first direction.
    fn precondition(
        cg: &mut ConjugateGradients<f64>,
        pattern: &Pattern,
        r: &[[f64; 4]],
    ) -> Vec<[f64; 4]> {
        let workers = Workers::serial();
        cg.load(pattern, r, 1.0);
        cg.update(&workers, pattern, None);
        cg.multiply(&workers, pattern, 0.0);
        let mut z = vec![[0.0; 4]; r.len()];
        cg.direction(pattern, &mut z);
        z
    }

    fn dot(a: &[[f64; 4]], b: &[[f64; 4]]) -> f64 {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
    }

    fn random(matrix: &SystemMatrix<f64>, mut next: impl FnMut() -> f64) -> Vec<[f64; 4]> {
        let entry = |held: FixedAxes, k, x| if held.holds(k) { 0.0 } else { x };
        let rows = matrix.held.iter();
        rows.map(|&h| [entry(h, 0, next()), entry(h, 1, next()), entry(h, 2, next()), 0.0])
            .collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn preconditioners_are_symmetric_and_positive(
            seed in 1u64..1000, x in 2usize..7, y in 1usize..5, z in 1usize..5, pieces in 1usize..4,
        ) {
            let (pattern, matrix, rest) = springs([x, y, z], seed, pieces.min(x * y * z));
            let mut next = noise(seed + 7);
            let (a, b) = (random(&matrix, &mut next), random(&matrix, &mut next));
            prop_assume!(dot(&a, &a) > 0.0);
            let middles = middles([x, y, z]);
            for (kind, ends) in [
                (Preconditioner::BlockJacobi, &[][..]),
                (Preconditioner::IncompleteCholesky, &[]),
                (Preconditioner::Multigrid, &[]),
                (Preconditioner::Multigrid, &middles),
            ] {
                let mut cg = prepared(kind, &pattern, &matrix, &rest, ends);
                let (za, zb) = (
                    precondition(&mut cg, &pattern, &a),
                    precondition(&mut cg, &pattern, &b),
                );
                let (ab, ba) = (dot(&a, &zb), dot(&b, &za));
                let scale = (dot(&a, &za) * dot(&b, &zb)).sqrt();
                prop_assert!((ab - ba).abs() <= 1e-9 * scale, "{kind:?}: {ab} {ba}");
                prop_assert!(dot(&a, &za) > 0.0, "{kind:?}");
                // the scalar product that the iteration uses is that of the whole preconditioner
                cg.load(&pattern, &a, 1.0);
                let (_, rz) = cg.update(&Workers::serial(), &pattern, None);
                prop_assert!((rz - dot(&a, &za)).abs() <= 1e-9 * rz, "{kind:?}");
            }
        }

        #[test]
        fn pieces_add_up_to_the_product(seed in 1u64..1000, pieces in 1usize..5) {
            let (pattern, matrix, rest) = springs([6, 3, 3], seed, pieces);
            let x = random(&matrix, noise(seed + 3));
            let expected = times(&pattern, &matrix, &x);
            let mut cg = prepared(Preconditioner::BlockJacobi, &pattern, &matrix, &rest, &[]);
            // zero residual and solution, direction x: one update leaves r = -A x
            cg.load(&pattern, &vec![[0.0; 4]; x.len()], 1.0);
            cg.update(&Workers::serial(), &pattern, None);
            for (piece, own) in pattern.pieces.iter().zip(&mut cg.product) {
                own.p.copy_from_slice(&x[piece.rows.start..piece.reach]);
            }
            let curvature = cg.multiply(&Workers::serial(), &pattern, 1.0);
            cg.update(&Workers::serial(), &pattern, Some(1.0));
            prop_assert!((curvature - dot(&x, &expected)).abs() <= 1e-12 * curvature.abs());
            for (piece, own) in pattern.pieces.iter().zip(&cg.update) {
                for (r, e) in own.r.iter().zip(&expected[piece.rows.clone()]) {
                    for k in 0..4 {
                        prop_assert!((r[k] + e[k]).abs() <= 1e-12 * (1.0 + e[k].abs()));
                    }
                }
            }
        }
    }

    /// Rows in the middle between their neighbours along x.
    fn middles(n: [usize; 3]) -> Vec<[u32; 2]> {
        let across = n[1] * n[2];
        let ends = |row: usize| {
            let x = row / across;
            let middle = x % 2 == 1 && x + 1 < n[0];
            let ends = if middle { [row - across, row + across] } else { [row; 2] };
            ends.map(|row| row as u32)
        };
        (0..n[0] * across).map(ends).collect()
    }

    /// What the correction of a coarse space leaves is no force on its nodes.
    #[test]
    fn coarse_spaces_are_solved_exactly() {
        for pieces in [1, 3] {
            let n = [31, 2, 2];
            let (pattern, matrix, rest) = springs(n, 3, pieces);
            let spaces = [
                CoarseSpace::rigid(&pattern, &rest, &vec![0; rest.len()], 12),
                CoarseSpace::corners(&pattern, &middles(n)).expect("small enough"),
            ];
            assert_eq!(spaces[1].nodes(), 32, "16 corners along, 4 across, two a node");
            for mut space in spaces {
                space.factorise(&Workers::serial(), &matrix);
                let r = random(&matrix, noise(5));
                let mut forces = vec![[0.0; 8]; space.nodes()];
                space.restrict(0, &r, 0, &mut forces);
                let size = forces.as_flattened().iter().map(|f| f.abs()).fold(0.0, f64::max);
                space.solve(&mut forces);
                let mut motions = Vec::new();
                space.motions(&forces, &mut motions);
                let z: Vec<_> = (0..r.len())
                    .map(|i| space.moved(i, &motions, matrix.held[i]).to_array())
                    .collect();
                let left: Vec<_> =
                    r.iter().zip(times(&pattern, &matrix, &z)).map(|(r, y)| sub4(*r, y)).collect();
                let mut forces = vec![[0.0; 8]; space.nodes()];
                space.restrict(0, &left, 0, &mut forces);
                let most = forces.as_flattened().iter().map(|f| f.abs()).fold(0.0, f64::max);
                assert!(most <= 1e-9 * size, "{pieces} pieces: {most} of {size}");
            }
        }
    }

    /// Motions against which a matrix has negative stiffness are none that a correction may take.
    #[test]
    fn coarse_spaces_of_indefinite_matrices_do_nothing() {
        let (pattern, mut matrix, rest) = springs([31, 2, 2], 3, 1);
        let mut space = CoarseSpace::rigid(&pattern, &rest, &vec![0; rest.len()], 12);
        for (indefinite, shift) in [(false, 0.0), (true, 4.0)] {
            for k in 0..3 {
                matrix.diagonal[40][k][k] -= shift;
            }
            space.factorise(&Workers::serial(), &matrix);
            let mut forces = vec![[1.0; 8]; space.nodes()];
            let work = space.solve(&mut forces);
            assert_eq!(work == 0.0, indefinite, "{work}");
            assert_eq!(forces == vec![[0.0; 8]; space.nodes()], indefinite);
        }
    }

    /// In large bodies the factor of the corners would take longer than an iteration.
    #[test]
    fn corners_are_for_bodies_of_few() {
        let n = [5, 12, 12];
        let (pattern, ..) = springs(n, 3, 1);
        assert!(CoarseSpace::<f64>::corners(&pattern, &middles(n)).is_none());
    }

    fn times(pattern: &Pattern, matrix: &SystemMatrix<f64>, x: &[[f64; 4]]) -> Vec<[f64; 4]> {
        let mut y: Vec<_> = x.iter().zip(&matrix.diagonal).map(|(x, m)| product(m, *x)).collect();
        for i in 0..x.len() {
            for at in pattern.blocks(i) {
                let j = pattern.column[at] as usize;
                let m = &matrix.upper[at];
                for (r, c) in (0..9).map(|i| (i / 3, i % 3)) {
                    y[i][r] += m[3 * r + c] * x[j][c];
                    y[j][c] += m[3 * r + c] * x[i][r];
                }
            }
        }
        y
    }

    /// Along a chain nothing fills in, so the factor is complete and one iteration solves.
    #[test]
    fn the_factor_of_a_chain_is_exact() {
        let (pattern, matrix, rest) = springs([40, 1, 1], 5, 1);
        let r = random(&matrix, noise(11));
        let mut cg = prepared(Preconditioner::IncompleteCholesky, &pattern, &matrix, &rest, &[]);
        let z = precondition(&mut cg, &pattern, &r);
        // the product of the first direction is the residual again
        for (q, r) in cg.product[0].q.iter().zip(&r) {
            for k in 0..3 {
                assert!((q[k] - r[k]).abs() < 1e-9, "{q:?} {r:?}");
            }
        }
        assert!(dot(&z, &z) > 0.0);
    }
}
