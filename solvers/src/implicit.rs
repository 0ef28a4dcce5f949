//! Implicit Euler and quasi-static equilibrium as minimisation of an incremental potential, body by
//! body (bodies share a world, not a solve, a line search or a cap),
//!
//! `P(y) = c_M/2 |y - y_inertia|^2_M + W(y) - f.y + 1/(2h) (y - x_n)^T C (y - x_n)`
//!
//! over the free unknowns, with `c_M = 1/h^2` and `y_inertia = x_n + h v_n` (implicit Euler), or
//! `c_M = 0` (equilibrium). `C = alpha M + beta K_gn(x_n)` is Rayleigh damping, frozen at the start
//! of the step with the positive semi-definite part of the tangent.
//!
//! * **Safe**: one Newton step from `x_n` (held vertices moved) with the exact Hessian. If conjugate
//!   gradients meet non-positive curvature, or the last step ended with inverted elements, the tangent
//!   is assembled again with clamped elements and the system solved again. Armijo backtracking on `P`,
//!   then the energy cap: since Armijo gives `W(y) + |v - v_n|^2_M / 2 <= W(y_0) + |v_n|^2_M / 2`, a
//!   factor on `v` exists that keeps kinetic plus potential energy at or below `T_n + W(y_0)` (plus
//!   what damping stores when held vertices move), so the total energy never rises between outside
//!   actions, for any step length.
//! * **Newton**: the same iteration to convergence.
//! * **Quasi-static**: the same without inertia.

use crate::cg::{CgStatus, LinearOptions, LinearSolver, ShiftedTangent};
use crate::orphan::prescribe_orphans;
use crate::settings::{Integrator, SolverSettings};
use crate::state::{NodeState, Rows, dot3, evaluate, read_force, write_state};
use crate::support::check_support;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::columns::single_table;
use sinew_engine::law::{ElasticEnergy, TangentKind};
use sinew_engine::load::SweptVolumes;
use sinew_engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew_engine::report::{StepReport, SystemTimes, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError, not_finite};
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::{FixedAxes, RestPosition};
use sinew_engine::workers::Workers;
use std::ops::Range;
use std::time::Instant;

/// Work space of the implicit integrators.
#[derive(Resource, Clone, Debug, Default)]
pub struct ImplicitScratch<S: Scalar> {
    node: NodeState<S>,
    /// Displacement since the start of the step (m): the unknown. Velocities come from it alone, so
    /// a large displacement from rest costs no digits of them.
    moved: Rows<S>,
    /// Where inertia alone would take the vertices, `h v_n` (m).
    drift: Rows<S>,
    y: Rows<S>,
    trial: Rows<S>,
    force: Rows<S>,
    rhs: Rows<S>,
    step: Rows<S>,
    damping: BlockMatrix<S>,
    damped: Rows<S>,
    damped_step: Rows<S>,
    product: ProductSpans<S>,
    linear: LinearSolver<S>,
    /// Rest positions (m), read once per topology.
    rest: Vec<DVec3>,
    revision: u64,
}

/// What the iteration knows of a body; bodies share a world but not a solve, a line search or a cap.
#[derive(Clone, Debug)]
struct BodyIteration {
    rows: Range<usize>,
    size: f64,
    /// Pieces without held unknowns: their momentum can be balanced exactly.
    free_pieces: Vec<FreePiece>,
    /// Elements were inverted when the step began.
    inverted: bool,
    /// Elastic energy (J) at the current iterate.
    elastic: f64,
    /// Kinetic plus potential energy (J) at the start, held vertices moved.
    budget: f64,
    done: bool,
    converged: bool,
}

/// Rows of a piece without held unknowns.
#[derive(Clone, Debug)]
enum FreePiece {
    /// All rows of the body.
    Whole,
    /// Some of them.
    Rows(Vec<u32>),
}

/// Weights of the incremental potential.
#[derive(Clone, Copy, Debug)]
struct Weights {
    /// Factor of `|d - h v_n|^2_M / 2` (1/s^2).
    inertia: f64,
    /// Factor of `|d|^2_M / 2`, mass damping over h (1/s^2).
    mass_damping: f64,
    /// Factor of `d^T K_gn d / 2`, stiffness damping over h.
    stiffness_damping: f64,
}

/// Armijo constant.
const ARMIJO: f64 = 1e-4;
/// Predicted decrease, over the energies involved, below which Newton does not test for decrease.
const UNRESOLVED: f64 = 1e-10;
/// Most halvings of the line search.
const MAX_HALVINGS: u32 = 30;

/// Relative size below which differences of energies are rounding.
fn noise<S: Scalar>() -> f64 {
    450.0 * S::EPSILON.to_f64()
}

/// Forgets the kept preconditioners and factors of the implicit integrators: they belong to matrices
/// that will not come again.
pub fn forget_matrices<S: Scalar>(world: &mut World) {
    world.remove_resource::<ImplicitScratch<S>>();
}

/// Carries out one implicit step, or finds one equilibrium.
///
/// # Errors
/// When a number stops being finite or an equilibrium is asked of a body that can move rigidly; the
/// columns are then unchanged.
pub fn implicit_step<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut scratch = world.remove_resource::<ImplicitScratch<S>>().unwrap_or_default();
    scratch.node.read(world);
    let revision = world.resource::<Topology>().revision;
    if scratch.revision != revision || scratch.rest.len() != scratch.node.len() {
        let mut query = world.query::<&RestPosition>();
        scratch.rest.clear();
        if let Some(rest) = single_table(query.contiguous_iter(world)) {
            scratch.rest.extend(rest.iter().map(|x| x.0));
        }
        scratch.revision = revision;
    }
    let result = if scratch.node.is_empty() {
        Ok(())
    } else {
        minimise(world, settings, report, &mut scratch)
    };
    if result.is_err() {
        write_state(world, &scratch.node.u, &scratch.node.v);
    }
    world.insert_resource(scratch);
    result
}

fn minimise<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) -> Result<(), StepError> {
    let n = s.node.len();
    let h = world.resource::<StepClock>().dt;
    let statics = settings.integrator == Integrator::QuasiStatic;
    let newton = settings.integrator != Integrator::Safe;
    let w = if statics {
        Weights { inertia: 0.0, mass_damping: 0.0, stiffness_damping: 0.0 }
    } else {
        Weights {
            inertia: 1.0 / (h * h),
            mass_damping: settings.mass_damping / h,
            stiffness_damping: settings.stiffness_damping / h,
        }
    };
    if statics {
        check_support(world, &s.node)?;
    }
    let follower = follower_potential(world, &s.node.u);
    let topology = world.resource::<Topology>();
    let orphans = prescribe_orphans(topology, &mut s.node, h, w.inertia, w.mass_damping);
    let mut bodies = body_iterations(world, &s.node);
    let moved_any = orphans | start(s, if statics { 0.0 } else { h });
    let before = if moved_any {
        report.evaluations += 1;
        evaluate(world, &s.node.u, true, false, None);
        Some(world.resource::<ElasticEnergy>().by_body.clone())
    } else {
        None
    };
    if w.stiffness_damping > 0.0 {
        evaluate(world, &s.node.u, false, false, Some(TangentKind::GaussNewton));
        report.evaluations += 1;
        std::mem::swap(&mut s.damping, &mut world.resource_mut::<Tangent<S>>().matrix);
    }

    // Newton cannot resolve steps below the rounding of the state
    let tolerance = settings.newton_tolerance.max(4.0 * S::EPSILON.to_f64());
    for iteration in 0..if newton { settings.max_newton_iterations } else { 1 } {
        // Around inverted elements the exact tangent has negative curvature that a loose solve may
        // not meet; stepping along it wound one crushed cube in 18, the projected one none.
        let exact = newton || bodies.iter().any(|b| !b.inverted);
        let kind = if exact { TangentKind::Exact } else { TangentKind::Projected };
        let elastic = evaluate(world, &s.y, true, true, Some(kind));
        report.evaluations += 1;
        read_force(world, &mut s.force);
        if !elastic.is_finite() {
            return Err(locate(world, &s.force, "elastic force"));
        }
        for (body, &energy) in bodies.iter_mut().zip(&world.resource::<ElasticEnergy>().by_body) {
            body.elastic = energy;
        }
        damp(world, s, &w);
        right_hand_side(s, &w);
        if iteration == 0 {
            book_start(report, s, &w, &mut bodies, before.as_deref());
        }
        directions(world, settings, &w, newton, kind, &bodies, report, s)?;
        report.newton_iterations += 1;

        // the step size is tested before the line search, which drowns in rounding near the minimum
        report.newton_step = 0.0;
        for body in bodies.iter_mut().filter(|b| !b.done) {
            let length = largest(&s.step[body.rows.clone()]) / body.size;
            report.newton_step = report.newton_step.max(length);
            if newton && length <= tolerance {
                advance(s, body.rows.clone(), S::ONE);
                (body.done, body.converged) = (true, true);
            }
        }
        line_search(world, &w, newton, tolerance, &mut bodies, report, s);
        if bodies.iter().all(|b| b.done) {
            break;
        }
    }
    report.unconverged = newton && bodies.iter().any(|b| !b.converged);

    if let Some(row) = (0..n).find(|&row| s.y[row].iter().any(|x| !x.is_finite())) {
        return Err(not_finite(
            world,
            row,
            "new displacement",
            "the step was undone; try a smaller step or check material and loads",
        ));
    }
    let follower = [follower, follower_potential(world, &s.y)];
    finish(world, report, s, if statics { None } else { Some(h) }, newton, &bodies);
    report.elastic_energy -= follower[1];
    if !statics {
        report.load_work += follower[0] - follower[1];
    }
    Ok(())
}

/// Potential (J) of the loads that are laws at displacements `u`; 0 without an evaluation where there are
/// none.
fn follower_potential<S: Scalar>(world: &mut World, u: &[[S; 4]]) -> f64 {
    if !world.contains_resource::<SweptVolumes>() {
        return 0.0;
    }
    evaluate(world, u, true, false, None);
    world.resource::<ElasticEnergy>().load
}

/// One entry per body.
fn body_iterations<S: Scalar>(world: &World, node: &NodeState<S>) -> Vec<BodyIteration> {
    let inverted = &world.resource::<VolumeReport>().inverted_by_body;
    let bodies = world.resource::<Topology>().bodies.iter().enumerate();
    bodies
        .map(|(i, body)| {
            let rows = body.vertices.start as usize..body.vertices.end as usize;
            BodyIteration {
                free_pieces: free_pieces(body, &node.fixed[rows.clone()]),
                rows,
                size: body.size,
                inverted: inverted.get(i).is_some_and(|&count| count > 0),
                elastic: 0.0,
                budget: f64::INFINITY,
                done: false,
                converged: false,
            }
        })
        .collect()
}

/// Pieces of a body without held unknowns; `fixed` belongs to its rows.
fn free_pieces(body: &BodyRows, fixed: &[FixedAxes]) -> Vec<FreePiece> {
    let held = fixed.iter().any(|f| f.0 != 0);
    if body.piece_count() == 1 && !held {
        return vec![FreePiece::Whole];
    }
    let mut pieces = vec![Some(Vec::new()); body.piece_count()];
    let first = body.vertices.start;
    for (row, (&piece, fixed)) in (first..).zip(body.piece.iter().zip(fixed)) {
        // vertices without elements belong to no piece
        let Some(rows) = pieces.get_mut(piece as usize) else { continue };
        match rows {
            Some(rows) if fixed.0 == 0 => rows.push(row),
            rows => *rows = None,
        }
    }
    pieces.into_iter().flatten().map(FreePiece::Rows).collect()
}

/// Start of the iteration: the old state with the held unknowns where they have to go; says whether
/// any of them moved.
fn start<S: Scalar>(s: &mut ImplicitScratch<S>, h: f64) -> bool {
    let n = s.node.len();
    s.moved.clear();
    s.moved.resize(n, [S::ZERO; 4]);
    s.drift.clear();
    s.drift.resize(n, [S::ZERO; 4]);
    s.y.clone_from(&s.node.u);
    let mut any = false;
    for row in 0..n {
        for k in 0..3 {
            if s.node.free(row, k) {
                s.drift[row][k] = S::from_f64(h) * s.node.v[row][k];
            } else {
                s.y[row][k] = s.node.prescribed[row][k];
                s.moved[row][k] = s.y[row][k] - s.node.u[row][k];
                any |= s.moved[row][k] != S::ZERO;
            }
        }
    }
    any
}

/// Energy budget of every body, and the work of its constraints so far: elastic and damping energy
/// of moving the held vertices, less what the loads contribute to it.
fn book_start<S: Scalar>(
    report: &mut StepReport,
    s: &ImplicitScratch<S>,
    w: &Weights,
    bodies: &mut [BodyIteration],
    before: Option<&[f64]>,
) {
    for (i, body) in bodies.iter_mut().enumerate() {
        let rows = body.rows.clone();
        let damping: f64 = rows.clone().map(|row| dot3(&s.moved[row], &s.damped[row])).sum::<f64>();
        let damping = 0.5 * w.stiffness_damping * damping;
        let loads = s.node.load_potential(rows.clone(), &s.y);
        body.budget =
            s.node.kinetic_energy(rows.clone(), &s.node.v)[0] + body.elastic - loads + damping;
        if let Some(before) = before {
            report.constraint_work += body.elastic + damping
                - before[i]
                - (loads - s.node.load_potential(rows, &s.node.u));
        }
    }
}

/// `K_gn d` for the stiffness damping into `s.damped`, zero without it.
fn damp<S: Scalar>(world: &World, s: &mut ImplicitScratch<S>, w: &Weights) {
    s.damped.clear();
    s.damped.resize(s.node.len(), [S::ZERO; 4]);
    if w.stiffness_damping > 0.0 {
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        s.damping.multiply(topology, workers, &mut s.product, &s.moved, &mut s.damped);
    }
}

/// `-dP/dy` on the free unknowns, zero on held ones.
fn right_hand_side<S: Scalar>(s: &mut ImplicitScratch<S>, w: &Weights) {
    let n = s.node.len();
    s.rhs.resize(n, [S::ZERO; 4]);
    let (wi, wm) = (S::from_f64(w.inertia), S::from_f64(w.mass_damping));
    let ws = S::from_f64(w.stiffness_damping);
    for row in 0..n {
        let m = s.node.mass[row];
        for k in 0..3 {
            s.rhs[row][k] = if s.node.free(row, k) {
                m * (wi * (s.drift[row][k] - s.moved[row][k]) - wm * s.moved[row][k])
                    - ws * s.damped[row][k]
                    + s.force[row][k]
                    + s.node.external[row][k]
            } else {
                S::ZERO
            };
        }
    }
}

/// Solves for the Newton step of every unfinished body into `s.step`, with the tangent of `kind`,
/// already evaluated. An exact one that turns out indefinite gives way to the projected one, and when
/// even that gives no descent to the preconditioned gradient.
fn directions<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    w: &Weights,
    newton: bool,
    kind: TangentKind,
    bodies: &[BodyIteration],
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) -> Result<(), StepError> {
    let clock = Instant::now();
    let mut evaluation = clock.elapsed();
    s.step.clear();
    s.step.resize(s.node.len(), [S::ZERO; 4]);
    let projected = |b: &BodyIteration| !newton && b.inverted;
    let mut pending: Vec<usize> = (0..bodies.len()).filter(|&i| !bodies[i].done).collect();
    report.cg_residual = 0.0;
    if kind == TangentKind::Exact {
        let mut rest = Vec::new();
        for i in pending {
            let exact = !projected(&bodies[i]);
            if !(exact && solve_body(world, settings, w, i, &bodies[i], !newton, report, s)?) {
                rest.push(i);
            }
        }
        pending = rest;
        if pending.is_empty() {
            world.resource_mut::<SystemTimes>().add("linear solves", clock.elapsed());
            return Ok(());
        }
        let start = Instant::now();
        evaluate(world, &s.y, false, false, Some(TangentKind::Projected));
        evaluation = start.elapsed();
        report.evaluations += 1;
    }
    report.projections += 1;
    report.clamped_elements += world.resource::<Tangent<S>>().clamped;
    for i in pending {
        let warm = !newton && projected(&bodies[i]);
        if !solve_body(world, settings, w, i, &bodies[i], warm, report, s)? {
            let rows = bodies[i].rows.clone();
            let ImplicitScratch { node, rhs, step, damping, .. } = s;
            let system = system(world, w, node, damping);
            system.preconditioned(i, &rhs[rows.clone()], &mut step[rows]);
            report.gradient_fallbacks += 1;
        }
    }
    let time = clock.elapsed().saturating_sub(evaluation);
    world.resource_mut::<SystemTimes>().add("linear solves", time);
    Ok(())
}

/// The system matrix of the step.
fn system<'a, S: Scalar>(
    world: &'a World,
    w: &Weights,
    node: &'a NodeState<S>,
    damping: &'a BlockMatrix<S>,
) -> ShiftedTangent<'a, S> {
    ShiftedTangent {
        topology: world.resource::<Topology>(),
        workers: world.resource::<Workers>(),
        mass: &node.mass,
        mass_factor: S::from_f64(w.inertia + w.mass_damping),
        tangent: &world.resource::<Tangent<S>>().matrix,
        tangent_factor: S::ONE,
        damping: (w.stiffness_damping > 0.0).then_some((damping, S::from_f64(w.stiffness_damping))),
        fixed: &node.fixed,
    }
}

/// Solves for one body with the tangent last evaluated; false when the matrix is not positive
/// definite or gives no descent.
fn solve_body<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    w: &Weights,
    index: usize,
    body: &BodyIteration,
    warm_start: bool,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) -> Result<bool, StepError> {
    let rows = body.rows.clone();
    for row in rows.clone() {
        for k in 0..3 {
            // inertia says where the vertices would go
            s.step[row][k] = if warm_start && s.node.free(row, k) {
                s.drift[row][k] - s.moved[row][k]
            } else {
                S::ZERO
            };
        }
    }
    let ImplicitScratch { linear, rest, node, rhs, step, damping, .. } = s;
    let (rhs, step) = (&rhs[rows.clone()], &mut step[rows.clone()]);
    let options = LinearOptions {
        tolerance: settings.linear_tolerance,
        max_iterations: settings.max_linear_iterations,
        preconditioner: settings.preconditioner,
        precision: settings.linear_precision,
    };
    let system = system(world, w, node, damping);
    let outcome = linear.solve(&system, rest, index, rhs, step, &options);
    report.cg_iterations += outcome.iterations;
    report.preconditioner = outcome.preconditioner.name();
    report.preconditioner_refreshes += outcome.refreshes;
    report.preconditioner_breakdowns += outcome.breakdowns;
    report.precision_fallbacks += u32::from(outcome.fell_back);
    let descent: f64 = rhs.iter().zip(&*step).map(|(b, d)| dot3(b, d)).sum();
    match outcome.status {
        CgStatus::NotFinite => Err(locate(world, &s.rhs, "residual force")),
        CgStatus::Converged | CgStatus::Cap if descent > 0.0 || largest(rhs) == 0.0 => {
            report.cg_residual = report.cg_residual.max(outcome.residual);
            report.cg_caps += u32::from(outcome.status == CgStatus::Cap);
            if w.inertia > 0.0 {
                let factor = w.inertia + w.mass_damping;
                for piece in &body.free_pieces {
                    match piece {
                        FreePiece::Whole => correct_momentum(rows.clone(), s, factor),
                        FreePiece::Rows(rows) => {
                            correct_momentum(rows.iter().map(|&row| row as usize), s, factor);
                        }
                    }
                }
            }
            Ok(true)
        }
        _ => Ok(false),
    }
}

/// Adds to the step of a piece without held unknowns the translation that balances its momentum.
///
/// A tangent resists no translation, so the exact solution has `c_M sum m d = sum rhs`; a loose
/// solve leaves a residual with a resultant, which would push a free body about.
fn correct_momentum<S: Scalar>(
    rows: impl Iterator<Item = usize> + Clone,
    s: &mut ImplicitScratch<S>,
    factor: f64,
) {
    let (mut missing, mut mass) = ([0.0; 3], 0.0);
    for row in rows.clone() {
        let m = factor * s.node.mass[row].to_f64();
        mass += m;
        for k in 0..3 {
            missing[k] += s.rhs[row][k].to_f64() - m * s.step[row][k].to_f64();
        }
    }
    for row in rows {
        for k in 0..3 {
            s.step[row][k] += S::from_f64(missing[k] / mass);
        }
    }
}

/// Largest entry of a field.
fn largest<S: Scalar>(x: &[[S; 4]]) -> f64 {
    x.iter().flat_map(|x| x[..3].iter()).fold(0.0, |m, x| m.max(x.to_f64().abs()))
}

/// Moves a body by a fraction of its step.
fn advance<S: Scalar>(s: &mut ImplicitScratch<S>, rows: Range<usize>, t: S) {
    for row in rows {
        for k in 0..3 {
            s.moved[row][k] += t * s.step[row][k];
            s.y[row][k] = if s.node.free(row, k) {
                s.node.u[row][k] + s.moved[row][k]
            } else {
                s.node.prescribed[row][k]
            };
        }
    }
}

/// The potential of a body along its step, as differences to the current iterate: `linear t +
/// quadratic t^2 / 2` from inertia, damping and loads, beside the elastic energy.
struct LineSearch {
    body: usize,
    linear: f64,
    quadratic: f64,
    slope: f64,
    rounding: f64,
    /// Differences of energy can be told from rounding.
    resolved: bool,
    t: f64,
    accepted: bool,
}

/// Backtracks along the step of every unfinished body until its potential decreases enough, and moves
/// it. A body for which no decrease is found stays where it is and is done.
fn line_search<S: Scalar>(
    world: &mut World,
    w: &Weights,
    newton: bool,
    tolerance: f64,
    bodies: &mut [BodyIteration],
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) {
    s.damped_step.clear();
    s.damped_step.resize(s.node.len(), [S::ZERO; 4]);
    if w.stiffness_damping > 0.0 {
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        s.damping.multiply(topology, workers, &mut s.product, &s.step, &mut s.damped_step);
    }
    let mut searches: Vec<LineSearch> = (0..bodies.len())
        .filter(|&i| !bodies[i].done)
        .map(|i| prepare_search(i, &bodies[i], w, newton, s))
        .collect();
    if searches.is_empty() {
        return;
    }
    s.trial.clone_from(&s.y);
    for _ in 0..MAX_HALVINGS {
        for search in searches.iter().filter(|l| !l.accepted) {
            let t = S::from_f64(search.t);
            for row in bodies[search.body].rows.clone() {
                for k in 0..3 {
                    // the same sum as in `advance`
                    if s.node.free(row, k) {
                        let moved = s.moved[row][k] + t * s.step[row][k];
                        s.trial[row][k] = s.node.u[row][k] + moved;
                    }
                }
            }
        }
        evaluate(world, &s.trial, true, false, None);
        report.evaluations += 1;
        let energies = &world.resource::<ElasticEnergy>().by_body;
        for search in searches.iter_mut().filter(|l| !l.accepted) {
            let (body, t) = (&mut bodies[search.body], search.t);
            let energy = energies[search.body];
            let change =
                (energy - body.elastic) + t * search.linear + 0.5 * t * t * search.quadratic;
            let decrease = change <= ARMIJO * t * search.slope + search.rounding;
            if decrease || (!search.resolved && change.is_finite()) {
                body.elastic = energy;
                search.accepted = true;
                advance(s, body.rows.clone(), S::from_f64(t));
                // the solved system has d.A d = -slope
                let predicted = search.slope * (t - 0.5 * t * t);
                if predicted.abs() > search.rounding {
                    let error = (change / predicted - 1.0).abs();
                    report.linearisation_error = report.linearisation_error.max(error);
                }
            } else {
                report.backtracks += 1;
                search.t *= 0.5;
            }
        }
        if searches.iter().all(|l| l.accepted) {
            return;
        }
    }
    for search in searches.iter().filter(|l| !l.accepted) {
        let body = &mut bodies[search.body];
        report.line_search_failures += 1;
        // rounding level: the gradient is as small as the energy can resolve
        let length = largest(&s.step[body.rows.clone()]) / body.size;
        (body.done, body.converged) = (true, length <= tolerance.max(noise::<S>()));
    }
}

fn prepare_search<S: Scalar>(
    index: usize,
    body: &BodyIteration,
    w: &Weights,
    newton: bool,
    s: &ImplicitScratch<S>,
) -> LineSearch {
    let (mut linear, mut quadratic, mut slope) = (0.0, 0.0, 0.0);
    let mut scale = body.elastic.abs();
    for row in body.rows.clone() {
        let m = s.node.mass[row].to_f64();
        let d = &s.step[row];
        for k in 0..3 {
            let d = d[k].to_f64();
            let away = (s.moved[row][k] - s.drift[row][k]).to_f64();
            if s.node.free(row, k) {
                linear += m * d * (w.inertia * away + w.mass_damping * s.moved[row][k].to_f64());
                quadratic += m * d * d * (w.inertia + w.mass_damping);
                scale += 0.5 * m * w.inertia * away * away;
            }
            linear -= s.node.external[row][k].to_f64() * d;
            linear += w.stiffness_damping * s.damped[row][k].to_f64() * d;
        }
        slope -= dot3(&s.rhs[row], d);
        quadratic += w.stiffness_damping * dot3(&s.damped_step[row], d);
    }
    // Near its end Newton converges quadratically while differences of energy drown in rounding
    // (more so for pooled springs, whose terms cancel): such steps are taken as they are. The safe
    // step always tests, its bound rests on it.
    let resolved = !newton || -slope > noise::<S>().max(UNRESOLVED) * scale;
    let rounding = noise::<S>() * scale;
    LineSearch {
        body: index,
        linear,
        quadratic,
        slope,
        rounding,
        resolved,
        t: 1.0,
        accepted: false,
    }
}

/// Velocities, energy cap, report, and the new state into the columns.
fn finish<S: Scalar>(
    world: &mut World,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    h: Option<f64>,
    newton: bool,
    bodies: &[BodyIteration],
) {
    // the step buffer takes the velocities
    let per_second = S::from_f64(h.map_or(0.0, |h| 1.0 / h));
    for (v, moved) in s.step.iter_mut().zip(&s.moved) {
        for k in 0..3 {
            v[k] = moved[k] * per_second;
        }
    }
    for body in bodies {
        let rows = body.rows.clone();
        let potential = body.elastic - s.node.load_potential(rows.clone(), &s.y);
        let [mut kinetic, held] = s.node.kinetic_energy(rows.clone(), &s.step);
        if h.is_some()
            && !newton
            && kinetic > 0.0
            && kinetic + potential > body.budget + noise::<S>() * (kinetic + potential.abs())
        {
            let factor = ((body.budget - potential).max(0.0) / kinetic).sqrt();
            for row in rows.clone() {
                for k in 0..3 {
                    if s.node.free(row, k) {
                        s.step[row][k] *= S::from_f64(factor);
                    }
                }
            }
            kinetic = s.node.kinetic_energy(rows.clone(), &s.step)[0];
            report.energy_caps += 1;
        }
        report.elastic_energy += body.elastic;
        if h.is_some() {
            // what holds vertices also speeds them up and slows them down
            let held_before = s.node.kinetic_energy(rows.clone(), &s.node.v)[1];
            report.kinetic_energy += kinetic + held;
            report.constraint_work += held - held_before;
            report.load_work +=
                s.node.load_potential(rows.clone(), &s.y) - s.node.load_potential(rows, &s.node.u);
        } else {
            report.constraint_work = 0.0;
        }
    }
    report.momentum = momentum(&s.node.mass, &s.step);
    write_state(world, &s.y, &s.step);
}

/// Total momentum (kg m/s).
pub(crate) fn momentum<S: Scalar>(mass: &[S], v: &[[S; 4]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (m, v) in mass.iter().zip(v) {
        for k in 0..3 {
            sum[k] += m.to_f64() * v[k].to_f64();
        }
    }
    sum
}

/// Error naming the first row that is not finite.
fn locate<S: Scalar>(world: &mut World, rows: &[[S; 4]], quantity: &'static str) -> StepError {
    let row = rows.iter().position(|f| f.iter().any(|x| !x.is_finite())).unwrap_or(0);
    not_finite(
        world,
        row,
        quantity,
        "the step was undone; the deformation is beyond the range of the number type, so check \
         loads, prescribed motion and units",
    )
}
