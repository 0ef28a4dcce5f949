//! Linear systems with a [`ShiftedTangent`] on the free unknowns: rows and columns of held unknowns are
//! taken out exactly by masking, not by penalties.
//!
//! A solve adds the matrix up once and hands it to preconditioned conjugate gradients
//! ([`crate::cg`]). With mixed precision the matrix, the vectors and the preconditioner are in
//! `f32` and only a correction is solved for; the residual is formed again in `f64` with the tangent
//! as it came, and corrections are added until that residual holds the tolerance. Where `f32` gets
//! no closer, or claims a negative curvature that the `f64` tangent does not confirm, the solve goes
//! on in `f64`. Sums run over fixed pieces in `f64`, so the iterates do not depend on the number of
//! threads.

use crate::cg::memory::{MemoryMisfit, PreconditionerMemory};
use crate::cg::{BodySystem, CgStatus, ConjugateGradients, Inner, SolveLimits};
use crate::settings::{LinearOptions, LinearPrecision, MULTIGRID_WHERE_SLOW, Preconditioner};
use crate::state::{Rows, dot3};
use crate::system::{Pattern, ShiftedTangent, SystemMatrix, ranges};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use sinew_engine::matrix::ProductSpans;
use sinew_engine::scalar::Scalar;
use sinew_engine::topology::Topology;
use std::ops::Range;
use std::sync::Arc;

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
    /// Times the values of the preconditioner were computed; otherwise those of an earlier solve were used.
    pub refreshes: u32,
    /// Restarts of the preconditioner's factorisation after breakdowns.
    pub breakdowns: u32,
    /// The solve had to go on in full precision.
    pub fell_back: bool,
    /// Norm (N) that residuals were divided by.
    pub reference: f64,
}

/// Kept preconditioners and factors of groups of bodies, in the order of the groups.
pub type LinearMemory<S> = Vec<(Range<usize>, GroupMemory<S>)>;

/// Kept preconditioners and factor of a group of bodies.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(bound = "S: Scalar")]
pub struct GroupMemory<S: Scalar> {
    /// Where its pieces of rows end, and whether it was solved for since blocks came or went.
    ends: Vec<u32>,
    is_used: bool,
    single: Option<PreconditionerMemory<f32>>,
    full: Option<PreconditionerMemory<S>>,
    /// The matrix of the complete factor.
    factorised: Option<SystemMatrix<S>>,
}

/// Solves the systems of the bodies of a world, one by one, and keeps what can be used again.
#[derive(Clone, Debug, Default)]
pub struct LinearSolver<S: Scalar> {
    revision: u64,
    /// Solvers of groups of bodies, those in use at the front.
    groups: Vec<(Range<usize>, BodySolver<S>)>,
    spans: ProductSpans<S>,
    damped: Rows<S>,
    residual: Rows<S>,
    /// The residual is that of the last solution.
    residual_holds: bool,
    correction: Rows<S>,
    ways: Vec<Way<S>>,
}

/// A direction without energy in common with those before it.
#[derive(Clone, Debug, Default)]
struct Way<S> {
    along: Rows<S>,
    /// `A along`, and its scalar product with `along`.
    product: Rows<S>,
    curvature: f64,
}

#[derive(Clone, Debug, Default)]
struct BodySolver<S: Scalar> {
    pattern: Arc<Pattern>,
    /// It was solved for since blocks came or went.
    is_used: bool,
    /// Whether the matrix is added up: in the number type of the state, in `f32`.
    assembled: [bool; 2],
    single: ConjugateGradients<f32>,
    #[cfg(feature = "direct")]
    direct: crate::direct::DirectFactor<S>,
    /// In use when `S` is `f64` and mixed precision is off or not enough.
    full: ConjugateGradients<S>,
}

impl<S: Scalar> BodySolver<S> {
    /// With pieces of rows that end there.
    fn recalled(
        topology: &Topology,
        bodies: &Range<usize>,
        ends: &[u32],
    ) -> Result<Self, MemoryMisfit> {
        let rows = ranges(topology, bodies).0.len();
        let ascends = ends.windows(2).all(|two| two[0] < two[1]);
        if !ascends || ends.last().map_or(0, |end| *end as usize) != rows {
            return Err(MemoryMisfit);
        }
        let pattern = Arc::new(Pattern::divided_at(topology, bodies, ends));
        Ok(Self { pattern, ..Self::default() })
    }

    /// Whether it can go on; see [`LinearSolver::follow`].
    fn follow(&mut self, topology: &Topology, bodies: &Range<usize>) -> bool {
        let is_used = std::mem::take(&mut self.is_used);
        if !is_used
            || bodies.end > topology.bodies.len()
            || ranges(topology, bodies).0.len() != self.pattern.len()
        {
            return false;
        }
        let pattern = Pattern::divided_at(topology, bodies, &self.pattern.ends());
        if pattern != *self.pattern {
            // corners of middles may be others
            if topology.bodies[bodies.clone()].iter().any(|body| !body.tetrahedra10().is_empty()) {
                return false;
            }
            self.pattern = Arc::new(pattern);
            self.single.forget_copy();
            self.full.forget_copy();
            #[cfg(feature = "direct")]
            {
                self.direct = Default::default();
            }
        }
        self.assembled = [false; 2];
        true
    }
}

/// One round of refinement with the complete factor of `matrix`.
#[cfg(feature = "direct")]
fn solve_directly<S: Scalar>(
    direct: &mut crate::direct::DirectFactor<S>,
    pattern: &Pattern,
    matrix: &SystemMatrix<S>,
    r: &[[S; 4]],
    e: &mut [[S; 4]],
) -> Inner {
    let factorised = direct.prepare(pattern, matrix);
    if factorised.is_some() {
        direct.solve(r, e);
    }
    Inner {
        status: factorised.map_or(CgStatus::Indefinite, |_| CgStatus::Converged),
        iterations: 1,
        reduction: 1.0,
        refreshes: u32::from(factorised == Some(true)),
        breakdowns: 0,
    }
}

impl<S: Scalar> LinearSolver<S> {
    /// Preconditioners and factors that are kept from solve to solve and still hold.
    pub fn memory(&mut self, topology: &Topology) -> LinearMemory<S> {
        self.follow(topology);
        let of = |(bodies, solver): &mut (Range<usize>, BodySolver<S>)| {
            let of_rows = (topology, &*bodies, &solver.pattern);
            let memory = GroupMemory {
                ends: solver.pattern.ends(),
                is_used: solver.is_used,
                single: solver.single.memory(of_rows),
                full: solver.full.memory(of_rows),
                #[cfg(feature = "direct")]
                factorised: solver.direct.memory(),
                #[cfg(not(feature = "direct"))]
                factorised: None,
            };
            (bodies.clone(), memory)
        };
        self.groups.iter_mut().map(of).collect()
    }

    /// Restores kept preconditioners and factors; `rest` (m) are the rest positions of all rows.
    ///
    /// # Errors
    /// When it belongs to other bodies.
    pub fn recall(
        &mut self,
        topology: &Topology,
        rest: &[DVec3],
        memory: &LinearMemory<S>,
    ) -> Result<(), MemoryMisfit> {
        if self.revision != topology.revision {
            self.groups.clear();
            self.revision = topology.revision;
        }
        let mut old = std::mem::take(&mut self.groups);
        for (bodies, memory) in memory {
            let fits = |(of, solver): &(Range<usize>, BodySolver<S>)| {
                of == bodies && solver.pattern.ends() == memory.ends
            };
            let mut solver = match old.iter().position(fits) {
                Some(at) => old.swap_remove(at).1,
                None => BodySolver::recalled(topology, bodies, &memory.ends)?,
            };
            solver.is_used = memory.is_used;
            let of_rows = (&solver.pattern, &rest[ranges(topology, bodies).0]);
            solver.single.recall(topology, bodies, of_rows, memory.single.as_ref())?;
            solver.full.recall(topology, bodies, of_rows, memory.full.as_ref())?;
            #[cfg(feature = "direct")]
            solver.direct.recall(memory.factorised.as_ref());
            self.groups.push((bodies.clone(), solver));
        }
        Ok(())
    }

    /// Goes on where blocks came or went, as a cut lets them: vertices have the rows that they had, and preconditioners of
    /// bodies with as many rows as before are about right. Groups that nobody solved for since the last time are forgotten.
    fn follow(&mut self, topology: &Topology) {
        if self.revision != topology.revision {
            self.revision = topology.revision;
            self.groups.retain_mut(|(bodies, solver)| solver.follow(topology, bodies));
        }
    }

    /// Solves the rows of consecutive bodies of `A x = b` from the start vector in `x`; `b` and `x` hold those
    /// rows only, and their held entries must be zero. `rest` holds the rest positions (m) of all
    /// rows of the world.
    ///
    /// The residual is measured against that of the start vector (or `b`, if smaller): a start that
    /// already carries the inertia must not make the forces look small.
    pub fn solve(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        rest: &[DVec3],
        bodies: Range<usize>,
        b: &[[S; 4]],
        x: &mut [[S; 4]],
        options: &LinearOptions,
    ) -> CgOutcome {
        self.solve_along(system, rest, bodies, b, (x, &[]), options)
    }

    /// [`Self::solve`] that searches along `seeds` first: such as the ways in which the last solutions left their starts.
    /// Held entries of them must be zero.
    pub fn solve_along(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        rest: &[DVec3],
        bodies: Range<usize>,
        b: &[[S; 4]],
        (x, seeds): (&mut [[S; 4]], &[Rows<S>]),
        options: &LinearOptions,
    ) -> CgOutcome {
        self.follow(system.topology);
        let group = match self.groups.iter().position(|(of, _)| *of == bodies) {
            Some(group) => group,
            None => {
                let pattern = Arc::new(Pattern::new(system.topology, &bodies));
                let solver = BodySolver { pattern, ..BodySolver::default() };
                self.groups.push((bodies.clone(), solver));
                self.groups.len() - 1
            }
        };
        self.groups[group].1.is_used = true;
        if !options.same_matrix {
            self.groups[group].1.assembled = [false; 2];
        }
        let preconditioner = {
            let BodySolver { pattern, single, full, .. } = &self.groups[group].1;
            let of = (system.topology, &bodies);
            let slow = single.is_slow(of) || full.is_slow(of);
            resolve(options.preconditioner, system, pattern.used, slow)
        };
        let same_type = size_of::<S>() == size_of::<f32>();
        let solve = LinearSolve {
            solver: self,
            system,
            rest,
            bodies,
            group,
            b,
            seeds,
            options,
            same_type,
            mixed: options.precision == LinearPrecision::Mixed || same_type,
            prepared: [false; 2],
            reference: 0.0,
            tolerance: 0.0,
            outcome: CgOutcome {
                status: CgStatus::Converged,
                iterations: 0,
                residual: 0.0,
                preconditioner,
                refreshes: 0,
                breakdowns: 0,
                fell_back: false,
                reference: 0.0,
            },
        };
        // on a thread of the pool, regions follow each other without a hand-over
        system.workers.enter(|| solve.run(x))
    }

    /// Adds to `way` the shortest step (m), measured by the diagonal blocks of the last matrix, that lowers the values
    /// of its low-rank vectors by `excess` (J^1/2); false, where it has no such vectors.
    pub fn restore(&mut self, bodies: &Range<usize>, excess: &[f64], way: &mut [[S; 4]]) -> bool {
        let Some((_, own)) = self.groups.iter_mut().find(|(of, _)| of == bodies) else {
            return false;
        };
        let BodySolver { single, full, assembled, .. } = own;
        (assembled[1] && single.restore(excess, way)) || full.restore(excess, way)
    }

    /// `y = A x` for the solution `x` that the last solve found for `b`.
    pub fn multiply_solution(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        bodies: Range<usize>,
        b: &[[S; 4]],
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        if !self.residual_holds {
            return self.multiply(system, bodies, x, y);
        }
        for ((y, b), r) in y.iter_mut().zip(b).zip(&self.residual) {
            *y = [b[0] - r[0], b[1] - r[1], b[2] - r[2], S::ZERO];
        }
    }

    /// `y = A x` for the rows of consecutive bodies; held entries of `x` must be zero.
    pub fn multiply(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        bodies: Range<usize>,
        x: &[[S; 4]],
        y: &mut [[S; 4]],
    ) {
        system.multiply(&mut self.spans, &mut self.damped, bodies, x, y);
    }

    /// `residual = b - A x` for the rows of consecutive bodies.
    fn find_residual(
        &mut self,
        system: &ShiftedTangent<'_, S>,
        bodies: Range<usize>,
        b: &[[S; 4]],
        x: &[[S; 4]],
    ) {
        self.residual_holds = true;
        let Self { spans, damped, residual, correction: product, .. } = self;
        residual.clear();
        residual.extend_from_slice(b);
        if x.iter().all(|x| *x == [S::ZERO; 4]) {
            return;
        }
        product.resize(x.len(), [S::ZERO; 4]);
        system.multiply(spans, damped, bodies, x, product);
        for (r, q) in residual.iter_mut().zip(&*product) {
            for k in 0..3 {
                r[k] -= q[k];
            }
        }
    }
}

/// The preconditioner to use for so many vertices, whose factor alone was `slow` or not: the complete factor knows nothing
/// of what contact couples.
fn resolve<S: Scalar>(
    chosen: Preconditioner,
    system: &ShiftedTangent<'_, S>,
    vertices: usize,
    slow: bool,
) -> Preconditioner {
    let coupled = system
        .contact
        .is_some_and(|contact| !contact.couplings.is_empty() || !contact.given.is_empty());
    let chosen = match chosen {
        Preconditioner::Direct if coupled => Preconditioner::Auto,
        Preconditioner::Auto if slow && vertices >= MULTIGRID_WHERE_SLOW => {
            Preconditioner::Multigrid
        }
        chosen => chosen,
    };
    chosen.resolve(vertices)
}

/// One solve: rounds of conjugate gradients, or of the complete factor, each for a correction of what is
/// left.
struct LinearSolve<'a, S: Scalar> {
    solver: &'a mut LinearSolver<S>,
    system: &'a ShiftedTangent<'a, S>,
    rest: &'a [DVec3],
    bodies: Range<usize>,
    /// Place of the solver of these bodies.
    group: usize,
    b: &'a [[S; 4]],
    /// First directions.
    seeds: &'a [Rows<S>],
    options: &'a LinearOptions,
    /// The state is in `f32` itself.
    same_type: bool,
    /// Rounds run in `f32`.
    mixed: bool,
    /// Whether the matrix is that of this solve: in the number type of the state, in `f32`.
    prepared: [bool; 2],
    /// Norm (N) that residuals are divided by, and the quotient that is small enough.
    reference: f64,
    tolerance: f64,
    outcome: CgOutcome,
}

impl<S: Scalar> LinearSolve<'_, S> {
    fn run(mut self, x: &mut [[S; 4]]) -> CgOutcome {
        let norm_b = norm(self.b);
        if norm_b == 0.0 {
            x.fill([S::ZERO; 4]);
            self.solver.residual_holds = false;
            return self.outcome;
        }
        self.solver.find_residual(self.system, self.bodies.clone(), self.b, x);
        let mut norm_r = norm(&self.solver.residual);
        // below a few units of rounding of b there is nothing left to solve for
        let floor = 16.0 * S::EPSILON.to_f64() * norm_b / self.options.tolerance;
        self.reference = norm_r.min(norm_b).max(floor).max(self.options.reference);
        self.outcome.reference = self.reference;
        let own = self.options.own_tolerance * norm_r / self.reference;
        self.tolerance = self.options.tolerance.max(own);
        if self.search_along_seeds(x) {
            norm_r = norm(&self.solver.residual);
        }
        loop {
            if let Some(status) = self.round(x, &mut norm_r) {
                self.outcome.status = status;
                return self.outcome;
            }
        }
    }

    /// Takes as much of the seeds as lowers the energy most, each of which counts as an iteration; whether there are such
    /// that tell. In the number type of the state: rounded to `f32`, what is left of two velocities would change with the
    /// units.
    fn search_along_seeds(&mut self, x: &mut [[S; 4]]) -> bool {
        let Self { seeds, system, .. } = *self;
        if self.outcome.preconditioner == Preconditioner::Direct {
            return false;
        }
        let LinearSolver { spans, damped, residual, ways, .. } = &mut *self.solver;
        ways.resize_with(seeds.len().max(ways.len()), Default::default);
        let mut used = 0;
        for seed in seeds {
            let (before, own) = ways.split_at_mut(used);
            let Way { along, product, curvature } = &mut own[0];
            along.clone_from(seed);
            product.resize(seed.len(), [S::ZERO; 4]);
            system.multiply(spans, damped, self.bodies.clone(), along, product);
            // of earlier seeds nothing is left in it
            let whole = dot(along, product);
            for way in before {
                let part = S::from_f64(dot(&way.along, product) / way.curvature);
                subtract(along, part, &way.along);
                subtract(product, part, &way.product);
            }
            *curvature = dot(along, product);
            let length = dot(along, residual) / *curvature;
            let least = (SAME_WAY * S::EPSILON.to_f64() * whole).max(0.0);
            if *curvature > least && length.is_finite() {
                subtract(x, S::from_f64(-length), along);
                subtract(residual, S::from_f64(length), product);
                used += 1;
            }
        }
        self.outcome.iterations += used as u32;
        used > 0
    }

    /// One round; `norm_r` is the norm of the residual before it and becomes that after it. Returns how the
    /// solve ended, if it did.
    fn round(&mut self, x: &mut [[S; 4]], norm_r: &mut f64) -> Option<CgStatus> {
        let (options, before) = (self.options, *norm_r);
        self.outcome.residual = before / self.reference;
        if !before.is_finite() {
            return Some(CgStatus::NotFinite);
        }
        if self.outcome.residual <= self.tolerance {
            return Some(CgStatus::Converged);
        }
        if self.outcome.iterations >= options.max_iterations {
            return Some(CgStatus::Cap);
        }
        let inner = self.correct(before);
        match inner.status {
            CgStatus::Converged | CgStatus::Cap => {}
            CgStatus::NotFinite if self.may_widen() => return self.widen(),
            CgStatus::NotFinite => return Some(CgStatus::NotFinite),
            CgStatus::Indefinite if self.may_widen() && !self.is_indefinite() => {
                return self.widen();
            }
            CgStatus::Indefinite => return Some(CgStatus::Indefinite),
        }
        for (x, e) in x.iter_mut().zip(&self.solver.correction) {
            for k in 0..3 {
                x[k] += e[k];
            }
        }
        self.solver.residual_holds = false;
        let direct = self.outcome.preconditioner == Preconditioner::Direct;
        if !direct && (self.same_type || !self.mixed) {
            // the iteration ran in the number type of the state: its own residual counts
            self.outcome.residual = inner.reduction * before / self.reference;
            let converged = inner.status == CgStatus::Converged;
            return Some(if converged { CgStatus::Converged } else { CgStatus::Cap });
        }
        self.solver.find_residual(self.system, self.bodies.clone(), self.b, x);
        *norm_r = norm(&self.solver.residual);
        if *norm_r > STALLED * before && *norm_r > self.tolerance * self.reference {
            if direct {
                self.outcome.residual = *norm_r / self.reference;
                return Some(CgStatus::Cap);
            }
            return self.widen();
        }
        None
    }

    /// Solves for the correction of a residual of norm `norm_r`.
    fn correct(&mut self, norm_r: f64) -> Inner {
        let Self { system, rest, group, .. } = *self;
        let bodies = self.bodies.clone();
        let preconditioner = self.outcome.preconditioner;
        let mut target = self.tolerance * self.reference / norm_r;
        if self.mixed && !self.same_type {
            // a little below, since the recurrence drifts; f32 gets no further than this at once
            target = (0.9 * target).max(SINGLE_REDUCTION);
        }
        let cap = self.options.max_iterations - self.outcome.iterations;
        let limits = SolveLimits { norm: norm_r, target, cap };
        let LinearSolver { groups, residual, correction, .. } = &mut *self.solver;
        let own = &mut groups[group].1;
        correction.resize(residual.len(), [S::ZERO; 4]);
        let single = self.mixed && preconditioner != Preconditioner::Direct;
        if !std::mem::replace(&mut self.prepared[usize::from(single)], true) {
            let again = std::mem::replace(&mut own.assembled[usize::from(single)], true);
            if single {
                own.single.matrix.prepare(system, bodies.clone(), again);
            } else {
                own.full.matrix.prepare(system, bodies.clone(), again);
            }
        }
        let (bodies, pattern) = (&bodies, &own.pattern);
        let of = BodySystem { system, bodies, pattern, rest, preconditioner };
        let inner = match preconditioner {
            #[cfg(feature = "direct")]
            Preconditioner::Direct => {
                let matrix = &own.full.matrix;
                solve_directly(&mut own.direct, &own.pattern, matrix, residual, correction)
            }
            _ if self.mixed => own.single.solve(&of, residual, correction, limits),
            _ => own.full.solve(&of, residual, correction, limits),
        };
        self.outcome.iterations += inner.iterations;
        self.outcome.refreshes += inner.refreshes;
        self.outcome.breakdowns += inner.breakdowns;
        inner
    }

    /// Whether the rounds run in `f32` and may go on in the number type of the state.
    fn may_widen(&self) -> bool {
        self.mixed && !self.same_type && self.outcome.preconditioner != Preconditioner::Direct
    }

    /// The rounds to come run in the number type of the state.
    fn widen(&mut self) -> Option<CgStatus> {
        self.mixed = false;
        self.outcome.fell_back = true;
        None
    }

    /// Whether the tangent as it came has no positive curvature along the last direction of the `f32`
    /// iteration: only it may say that it is indefinite.
    fn is_indefinite(&mut self) -> bool {
        let LinearSolver { groups, spans, damped, correction, .. } = &mut *self.solver;
        let own = &groups[self.group].1;
        own.single.direction(&own.pattern, correction);
        let mut product = vec![[S::ZERO; 4]; correction.len()];
        self.system.multiply(spans, damped, self.bodies.clone(), correction, &mut product);
        let curvature: f64 = correction.iter().zip(&product).map(|(p, q)| dot3(p, q)).sum();
        curvature <= 0.0
    }
}

/// Reduction of the residual asked of one round in `f32`.
const SINGLE_REDUCTION: f64 = 1e-5;
/// A round that reduces the residual by less than this is the last one in `f32`.
const STALLED: f64 = 0.5;

/// Curvature in multiples of rounding below which two seeds point the same way.
const SAME_WAY: f64 = 1e4;

/// `y -= factor x`.
fn subtract<S: Scalar>(y: &mut [[S; 4]], factor: S, x: &[[S; 4]]) {
    for (y, x) in y.iter_mut().zip(x) {
        for k in 0..3 {
            y[k] -= factor * x[k];
        }
    }
}

/// Scalar product.
fn dot<S: Scalar>(x: &[[S; 4]], y: &[[S; 4]]) -> f64 {
    x.iter().zip(y).map(|(x, y)| dot3(x, y)).sum()
}

/// Euclidean norm.
fn norm<S: Scalar>(x: &[[S; 4]]) -> f64 {
    x.iter().map(|x| dot3(x, x)).sum::<f64>().sqrt()
}
