//! Implicit integrators and quasi-static equilibrium as minimisation of an incremental potential, body
//! by body (bodies share a world, not a solve, a line search or a cap). The unknown is the way `d` from
//! the state at the start of the step:
//!
//! `P(d) = |d - d_inertia|^2_M / (2 H^2) + W(x_n + d) - f.d + 1/(2 H) (d - o)^T C (d - o)`
//!
//! over the free unknowns. The velocity at the end is `(d - o) / H`, and without forces it would be
//! `v_ref`: `d_inertia = o + H v_ref`. `C = alpha M + beta K_gn + C_d` is Rayleigh damping beside the
//! matrix of dampers, frozen where the iteration starts; `K_gn` is the positive semi-definite part of the
//! tangent.
//!
//! | | `H` | `o` | `v_ref` |
//! |---|---|---|---|
//! | implicit Euler | `h` | 0 | `v_n` |
//! | BDF2, `r = h / h_prev`, `b = r^2 / (1 + 2 r)` | `h (1 + r) / (1 + 2 r)` | `b d_prev` | `v_n + b (v_n - v_prev)` |
//! | TR-BDF2, trapezoid to `gamma h`, `gamma = 2 - sqrt 2` | `gamma h / 2` | `H v_n` | `v_n`, and the force at `x_n` beside `f` |
//! | then BDF2, `a = 1 / (gamma (2 - gamma))` | `gamma h / 2` | `a d_gamma` | `a v_gamma + (1 - a) v_n` |
//! | midpoint: implicit Euler to the middle, then `2 d` | `h / 2` | 0 | `v_n` |
//! | equilibrium | infinite | | |
//!
//! * **Safe**: one Newton step from `x_n` (held vertices moved) with the exact Hessian. If conjugate
//!   gradients meet non-positive curvature, or the last step ended with inverted elements, the tangent
//!   is assembled again with clamped elements and the system solved again. Armijo backtracking on `P`,
//!   then the energy cap: since Armijo gives `W(y) + |v - v_n|^2_M / 2 <= W(y_0) + |v_n|^2_M / 2`, a
//!   factor on `v` exists that keeps kinetic plus potential energy at or below `T_n + W(y_0)` (plus
//!   what damping stores when held vertices move), so the total energy never rises between outside
//!   actions, for any step length.
//! * **Linearised BDF2**: one Newton step of BDF2 from `x_n + h v_n`. It counts if the tangent was
//!   positive definite, the full step was taken, no element was turned inside out and the energy stayed
//!   below its budget: the largest it has been, decaying by [`BUDGET_DECAY`] of the excess a step, plus
//!   outside work. Otherwise the
//!   body takes the safe step, and so do its next [`WAIT`] steps. Where there is no history (first
//!   step, state set or held axes changed from outside, much other step length) it starts with a
//!   safe step.
//! * **Newton, BDF2, TR-BDF2, midpoint**: iterated to convergence, the last three from where the
//!   velocities lead.
//! * **Quasi-static**: the same without inertia; in parts if it does not converge in one go, or turns
//!   elements inside out (`equilibrium`).

use crate::cg::{CgStatus, LinearOptions, LinearSolver, ShiftedTangent};
use crate::history::{BodyHistory, History, Past};
use crate::orphan::{Flown, prescribe_orphans};
use crate::recovery::Recovery;
use crate::settings::{Integrator, SolverSettings};
use crate::state::{
    NodeState, Rows, book_momentum, dot3, evaluate, evaluate_damping, read_force, read_rest,
    write_displacement, write_state,
};
use crate::support::check_support;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew_engine::law::{ElasticEnergy, TangentKind};
use sinew_engine::load::SweptVolumes;
use sinew_engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew_engine::report::{StepReport, SystemTimes, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError, measure_volume_ratios, not_finite};
use sinew_engine::substep::WithinStep;
use sinew_engine::topology::{BodyRows, Topology};
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;
use std::ops::Range;
use std::time::Instant;

/// Work space of the implicit integrators, and what they remember of the last step.
#[derive(Resource, Clone, Debug, Default)]
pub struct ImplicitScratch<S: Scalar> {
    node: NodeState<S>,
    /// Displacement since the start of the step (m): the unknown. Velocities come from it alone, so
    /// a large displacement from rest costs no digits of them.
    moved: Rows<S>,
    /// Where `moved` stands for no velocity (m), `o` in the module documentation.
    offset: Rows<S>,
    /// Where inertia alone would take the vertices (m).
    drift: Rows<S>,
    /// Displacements (m) of held unknowns at the end of the stage.
    target: Rows<S>,
    /// Forces (N) beside the elastic ones.
    load: Rows<S>,
    y: Rows<S>,
    trial: Rows<S>,
    force: Rows<S>,
    rhs: Rows<S>,
    step: Rows<S>,
    /// `beta K_gn + C_d` (N s/m); empty without damping.
    damping: BlockMatrix<S>,
    /// `moved - offset`, when it is needed as one.
    rate: Rows<S>,
    damped: Rows<S>,
    damped_step: Rows<S>,
    product: ProductSpans<S>,
    linear: LinearSolver<S>,
    history: History<S>,
    recovery: Recovery,
    within: WithinStep,
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
    mode: Mode,
    w: Weights,
    /// What is remembered of it.
    past: Past,
    /// Elastic energy (J) at the current iterate, and at the start of the step.
    elastic: f64,
    elastic_before: f64,
    /// Kinetic plus potential energy (J) at the start, held vertices moved.
    budget: f64,
    done: bool,
    converged: bool,
    /// Why the linearised BDF2 step does not count.
    rejected: Option<Rejected>,
}

/// How a body takes its step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    /// One solve, line search and energy cap.
    Safe,
    /// One solve, which must pass the tests of linearised BDF2.
    Trial,
    /// Newton to convergence.
    Converge,
}

/// Why a linearised BDF2 step does not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rejected {
    Indefinite,
    Shortened,
    Energy,
    Inverted,
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
    /// `1 / H`, 0 for equilibria (1/s).
    rate: f64,
    /// Factor of `|d - d_inertia|^2_M / 2` (1/s^2).
    inertia: f64,
    /// Factor of `|d - o|^2_M / 2`, mass damping over `H` (1/s^2).
    mass_damping: f64,
}

impl Weights {
    /// Of a stage of effective length `h` (s), infinite for equilibria.
    fn new(settings: &SolverSettings, h: f64) -> Self {
        let rate = 1.0 / h;
        Self { rate, inertia: rate * rate, mass_damping: settings.mass_damping * rate }
    }
}

/// Armijo constant.
const ARMIJO: f64 = 1e-4;
/// Predicted decrease, over the energies involved, below which Newton does not test for decrease.
const UNRESOLVED: f64 = 1e-10;
/// Most halvings of the line search.
const MAX_HALVINGS: u32 = 30;
/// Part of the energy budget's excess over the energy that is lost every step.
pub const BUDGET_DECAY: f64 = 0.05;
/// Most halvings of the parts in which an equilibrium is sought.
pub const MAX_PARTINGS: u32 = 5;
/// Safe steps that follow one at which linearised BDF2 failed its tests.
pub const WAIT: u32 = 2;

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
        read_rest(world, &mut scratch.rest);
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
    let dt = world.resource::<StepClock>().dt;
    let integrator = settings.integrator.resolve();
    s.damping.diagonal.clear();
    if integrator == Integrator::QuasiStatic {
        check_support(world, &s.node)?;
    }
    let follower = follower_energies(world, &s.node.u);
    let flown = prescribe_orphans(
        world.resource::<Topology>(),
        &mut s.node,
        dt,
        settings.mass_damping,
        integrator,
    );
    s.load.clone_from(&s.node.external);
    s.target.clone_from(&s.node.prescribed);
    let (unchanged, past) = s.history.compare(world, &s.node, dt);
    // the potential of a pressure changes with time
    let energies_hold = unchanged && !world.contains_resource::<SweptVolumes>();
    let recovers = s.recovery.update(world, settings.recovery, &s.node, &s.rest, report);
    let mut bodies = body_iterations(world, &s.node, past);
    for (body, _) in bodies.iter_mut().zip(recovers).filter(|(_, recovers)| *recovers) {
        // other energies than those remembered, and safe steps
        body.past = Past::default();
        body.inverted = true;
    }
    match integrator {
        Integrator::QuasiStatic => equilibrium(world, settings, report, s, &mut bodies)?,
        Integrator::Newton | Integrator::Safe => {
            let mode = if integrator == Integrator::Safe { Mode::Safe } else { Mode::Converge };
            for body in &mut bodies {
                (body.mode, body.w) = (mode, Weights::new(settings, dt));
            }
            let before = if begin(s) {
                report.evaluations += 1;
                evaluate(world, &s.node.u, true, false, None);
                Some(world.resource::<ElasticEnergy>().by_body.clone())
            } else {
                None
            };
            freeze_damping(world, settings, report, &s.node.u, &mut s.damping);
            for body in &bodies {
                euler(s, body, dt);
            }
            solve(world, settings, report, s, &mut bodies, Some(before.as_deref()))?;
        }
        Integrator::LinearisedBdf2 => {
            for body in &mut bodies {
                let past = &body.past;
                let second_order = past.goes_on && past.body.wait == 0 && !body.inverted;
                body.mode = if second_order { Mode::Trial } else { Mode::Safe };
                let f = &mut report.fallbacks;
                f.start += u32::from(!past.goes_on);
                f.waiting += u32::from(past.goes_on && !second_order);
            }
            start_ahead(world, settings, report, s, &mut bodies, energies_hold, dt, dt);
            solve(world, settings, report, s, &mut bodies, None)?;
            fall_back(world, settings, report, s, &mut bodies, dt)?;
        }
        Integrator::Bdf2 => {
            bodies.iter_mut().for_each(|b| b.mode = Mode::Converge);
            report.fallbacks.start += bodies.iter().filter(|b| !b.past.goes_on).count() as u32;
            start_ahead(world, settings, report, s, &mut bodies, energies_hold, dt, dt);
            solve(world, settings, report, s, &mut bodies, None)?;
        }
        Integrator::ImplicitMidpoint => {
            half_way(world, s);
            bodies.iter_mut().for_each(|b| (b.mode, b.past.goes_on) = (Mode::Converge, false));
            start_ahead(world, settings, report, s, &mut bodies, energies_hold, dt, 0.5 * dt);
            solve(world, settings, report, s, &mut bodies, None)?;
            whole_way(world, report, s, &mut bodies, dt);
        }
        Integrator::TrBdf2 => {
            trapezoid(world, settings, report, s, &mut bodies, dt)?;
            second_stage(world, settings, report, s, &mut bodies, dt)?;
        }
        Integrator::Auto | Integrator::SymplecticEuler | Integrator::StormerVerlet => {
            unreachable!("resolved, and explicit integrators have their own steps")
        }
    }

    let finite = |x: &[S; 4]| x.iter().all(|x| x.is_finite());
    if let Some(row) = s.y.iter().position(|y| !finite(y)) {
        return Err(not_finite(
            world,
            row,
            "new displacement",
            "the step was undone; try a smaller step or check material and loads",
        ));
    }
    let [before, after] = [follower, follower_energies(world, &s.y)];
    finish(world, settings, report, s, dt, &bodies, &flown);
    if let (Some([load_before, _]), Some([load, elastic])) = (before, after) {
        // small beside the potential of the loads, so better read than found by subtraction
        let booked = report.elastic_energy - load;
        report.elastic_energy = elastic;
        if integrator != Integrator::QuasiStatic {
            report.dissipation += booked - elastic;
            report.load_work += load_before - load;
        }
    }
    Ok(())
}

/// Potential of the loads that are laws and elastic energy (J) at displacements `u`; `None`, without an
/// evaluation, where there are no such loads.
fn follower_energies<S: Scalar>(world: &mut World, u: &[[S; 4]]) -> Option<[f64; 2]> {
    if !world.contains_resource::<SweptVolumes>() {
        return None;
    }
    evaluate(world, u, true, false, None);
    let energy = world.resource::<ElasticEnergy>();
    Some([energy.load, energy.elastic()])
}

/// Newton's iteration for all bodies that are not done: once for safe and trial steps. `book` asks for
/// the energy budget at the first iterate, given the elastic energies before held vertices moved if
/// any did.
fn solve<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    book: Option<Option<&[f64]>>,
) -> Result<(), StepError> {
    // Newton cannot resolve steps below the rounding of the state
    let tolerance = settings.newton_tolerance.max(4.0 * S::EPSILON.to_f64());
    let newton = bodies.iter().any(|b| b.mode == Mode::Converge);
    for iteration in 0..if newton { settings.max_newton_iterations } else { 1 } {
        // Around inverted elements the exact tangent has negative curvature that a loose solve may
        // not meet; stepping along it wound one crushed cube in 18, the projected one none.
        let exact = bodies.iter().any(|b| !b.done && !b.projects());
        let kind = if exact { TangentKind::Exact } else { TangentKind::Projected };
        evaluate(world, &s.y, true, true, Some(kind));
        report.evaluations += 1;
        read_force(world, &mut s.force);
        let energies = &world.resource::<ElasticEnergy>().by_body;
        let mut finite = true;
        for (body, &energy) in bodies.iter_mut().zip(energies).filter(|(b, _)| !b.done) {
            body.elastic = energy;
            if body.mode == Mode::Trial && !energy.is_finite() {
                body.reject(Rejected::Energy);
            } else {
                finite &= energy.is_finite();
            }
        }
        if !finite {
            return Err(locate(world, &s.force, "elastic force"));
        }
        damp(world, s);
        right_hand_side(s, bodies);
        if let (0, Some(before)) = (iteration, book) {
            let at_start: Vec<f64> = bodies.iter().map(|b| b.elastic).collect();
            book_start(report, s, bodies, before.unwrap_or(&at_start), &at_start);
        }
        directions(world, settings, kind, bodies, report, s)?;
        report.newton_iterations += 1;

        // the step size is tested before the line search, which drowns in rounding near the minimum
        report.newton_step = 0.0;
        for body in bodies.iter_mut().filter(|b| !b.done) {
            let length = largest(&s.step[body.rows.clone()]) / body.size;
            report.newton_step = report.newton_step.max(length);
            if body.mode == Mode::Converge && length <= tolerance {
                advance(s, body.rows.clone(), S::ONE);
                (body.done, body.converged) = (true, true);
            }
        }
        line_search(world, tolerance, bodies, report, s);
        if bodies.iter().all(|b| b.done) {
            break;
        }
    }
    report.unconverged = bodies.iter().any(|b| b.mode == Mode::Converge && !b.converged);
    Ok(())
}

impl BodyIteration {
    /// Uses the projected tangent from the start.
    fn projects(&self) -> bool {
        self.mode == Mode::Safe && self.inverted
    }

    fn reject(&mut self, why: Rejected) {
        (self.done, self.rejected) = (true, Some(why));
    }
}

/// One entry per body.
fn body_iterations<S: Scalar>(
    world: &World,
    node: &NodeState<S>,
    past: Vec<Past>,
) -> Vec<BodyIteration> {
    let inverted = &world.resource::<VolumeReport>().inverted_by_body;
    let bodies = world.resource::<Topology>().bodies.iter().enumerate().zip(past);
    bodies
        .map(|((i, body), past)| {
            let rows = body.vertices.start as usize..body.vertices.end as usize;
            BodyIteration {
                free_pieces: free_pieces(body, &node.fixed[rows.clone()]),
                rows,
                size: body.size,
                inverted: inverted.get(i).is_some_and(|&count| count > 0),
                mode: Mode::Safe,
                w: Weights { rate: 0.0, inertia: 0.0, mass_damping: 0.0 },
                past,
                elastic: 0.0,
                elastic_before: 0.0,
                budget: f64::INFINITY,
                done: false,
                converged: false,
                rejected: None,
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

/// Start of the iteration: the old state with the held unknowns at `s.target`; says whether any of
/// them moved. Offset and drift are zero.
fn begin<S: Scalar>(s: &mut ImplicitScratch<S>) -> bool {
    let n = s.node.len();
    for rows in [&mut s.moved, &mut s.offset, &mut s.drift] {
        rows.clear();
        rows.resize(n, [S::ZERO; 4]);
    }
    s.y.clone_from(&s.node.u);
    let mut any = false;
    for row in 0..n {
        for k in (0..3).filter(|&k| !s.node.free(row, k)) {
            s.y[row][k] = s.target[row][k];
            s.moved[row][k] = s.y[row][k] - s.node.u[row][k];
            any |= s.moved[row][k] != S::ZERO;
        }
    }
    any
}

/// The damping matrix at displacements `u`, empty where nothing but mass damps.
fn freeze_damping<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    u: &[[S; 4]],
    damping: &mut BlockMatrix<S>,
) {
    damping.diagonal.clear();
    damping.off_diagonal.clear();
    if settings.stiffness_damping > 0.0 {
        evaluate(world, u, false, false, Some(TangentKind::GaussNewton));
        report.evaluations += 1;
        std::mem::swap(damping, &mut world.resource_mut::<Tangent<S>>().matrix);
        damping.scale(S::from_f64(settings.stiffness_damping));
    }
    if evaluate_damping(world, u) {
        let dampers = &mut world.resource_mut::<Tangent<S>>().matrix;
        if damping.diagonal.is_empty() {
            std::mem::swap(damping, dampers);
        } else {
            damping.add(dampers);
        }
    }
}

/// Offset and drift of implicit Euler over `h` (s).
fn euler<S: Scalar>(s: &mut ImplicitScratch<S>, body: &BodyIteration, h: f64) {
    let h = S::from_f64(h);
    for row in body.rows.clone() {
        s.offset[row] = [S::ZERO; 4];
        for k in (0..3).filter(|&k| s.node.free(row, k)) {
            s.drift[row][k] = h * s.node.v[row][k];
        }
    }
}

/// Energy budget of every body, and the work of its constraints so far: elastic and damping energy
/// of moving the held vertices, less what the loads contribute to it.
fn book_start<S: Scalar>(
    report: &mut StepReport,
    s: &ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    before: &[f64],
    moved: &[f64],
) {
    for (i, body) in bodies.iter_mut().enumerate() {
        let rows = body.rows.clone();
        let damping: f64 = rows.clone().map(|row| dot3(&s.moved[row], &s.damped[row])).sum::<f64>();
        let damping = 0.5 * body.w.rate * damping;
        let loads = s.node.load_potential(rows.clone(), &s.y);
        body.elastic_before = before[i];
        body.budget =
            s.node.kinetic_energy(rows.clone(), &s.node.v)[0] + moved[i] - loads + damping;
        report.constraint_work +=
            moved[i] + damping - before[i] - (loads - s.node.load_potential(rows, &s.node.u));
    }
}

/// Elastic energies (J) of the bodies at the start of the step, and with their held vertices where they
/// have to go; begins the iteration.
fn energies_at_start<S: Scalar>(
    world: &mut World,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &[BodyIteration],
    energies_hold: bool,
) -> [Vec<f64>; 2] {
    let moved_any = begin(s);
    let mut by_body = |u: &[[S; 4]]| {
        evaluate(world, u, true, false, None);
        report.evaluations += 1;
        world.resource::<ElasticEnergy>().by_body.clone()
    };
    let before = if energies_hold && bodies.iter().all(|b| b.past.same_state) {
        bodies.iter().map(|b| b.past.body.elastic).collect()
    } else {
        by_body(&s.node.u)
    };
    let moved = if moved_any { by_body(&s.y) } else { before.clone() };
    [before, moved]
}

/// Start of an iteration from where the velocities lead after `ahead` (s), for bodies that do not take
/// the safe step; BDF2 where the history lets it go on, implicit Euler over `ahead` elsewhere.
fn start_ahead<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    energies_hold: bool,
    dt: f64,
    ahead: f64,
) {
    let ratio = dt / s.history.dt;
    for body in bodies.iter_mut() {
        let second = body.past.goes_on && body.mode != Mode::Safe;
        let h = if second { dt * (1.0 + ratio) / (1.0 + 2.0 * ratio) } else { ahead };
        body.w = Weights::new(settings, h);
        if !energies_hold {
            body.past.body.excess = 0.0;
        }
    }
    let [before, moved] = energies_at_start(world, report, s, bodies, energies_hold);

    s.trial.clone_from(&s.y);
    let ahead = S::from_f64(ahead);
    for body in bodies.iter().filter(|b| b.mode != Mode::Safe) {
        for row in body.rows.clone() {
            for k in (0..3).filter(|&k| s.node.free(row, k)) {
                s.trial[row][k] = s.node.u[row][k] + ahead * s.node.v[row][k];
            }
        }
    }
    freeze_damping(world, settings, report, &s.trial, &mut s.damping);
    damp(world, s);
    book_start(report, s, bodies, &before, &moved);

    let b = S::from_f64(ratio * ratio / (1.0 + 2.0 * ratio));
    for body in bodies.iter() {
        if !(body.past.goes_on && body.mode != Mode::Safe) {
            euler(s, body, ahead.to_f64());
        } else {
            let h = S::from_f64(1.0 / body.w.rate);
            for row in body.rows.clone() {
                for k in 0..3 {
                    s.offset[row][k] = b * s.history.way[row][k];
                    if s.node.free(row, k) {
                        let v = s.node.v[row][k];
                        let v_ref = v + b * (v - s.history.v_before[row][k]);
                        s.drift[row][k] = s.offset[row][k] + h * v_ref;
                    }
                }
            }
        }
        if body.mode != Mode::Safe {
            for row in body.rows.clone() {
                for k in (0..3).filter(|&k| s.node.free(row, k)) {
                    s.moved[row][k] = ahead * s.node.v[row][k];
                    s.y[row][k] = s.trial[row][k];
                }
            }
        }
    }
}

/// The energy test of linearised BDF2, and the safe step for the bodies that failed any.
fn fall_back<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    dt: f64,
) -> Result<(), StepError> {
    for body in bodies.iter_mut().filter(|b| b.mode == Mode::Trial && b.rejected.is_none()) {
        velocities(s, body);
        let kinetic = s.node.kinetic_energy(body.rows.clone(), &s.step)[0];
        let potential = body.elastic - s.node.load_potential(body.rows.clone(), &s.y);
        let allowed =
            body.budget + body.past.body.excess + noise::<S>() * (kinetic + potential.abs());
        // false for NaN
        let within = kinetic + potential <= allowed;
        if !within {
            body.reject(Rejected::Energy);
        }
    }
    if bodies.iter().any(|b| b.mode == Mode::Trial && b.rejected.is_none()) {
        // trial steps begin without inverted elements
        let after = inverted_by_body(world, &s.y);
        for (body, inverted) in bodies.iter_mut().zip(after) {
            if body.mode == Mode::Trial && body.rejected.is_none() && inverted > 0 {
                body.reject(Rejected::Inverted);
            }
        }
    }
    for body in bodies.iter_mut().filter(|b| b.mode == Mode::Trial) {
        let f = &mut report.fallbacks;
        match body.rejected {
            None => report.second_order_steps += 1,
            Some(Rejected::Indefinite) => f.indefinite += 1,
            Some(Rejected::Shortened) => f.shortened += 1,
            Some(Rejected::Energy) => f.energy += 1,
            Some(Rejected::Inverted) => f.inverted += 1,
        }
        body.done = body.rejected.is_none();
    }
    bodies.iter_mut().filter(|b| b.mode == Mode::Safe).for_each(|b| b.done = true);
    if bodies.iter().all(|b| b.done) {
        return Ok(());
    }
    for body in bodies.iter_mut().filter(|b| !b.done) {
        body.mode = Mode::Safe;
        body.w = Weights::new(settings, dt);
        euler(s, body, dt);
        for row in body.rows.clone() {
            for k in 0..3 {
                let free = s.node.free(row, k);
                s.y[row][k] = if free { s.node.u[row][k] } else { s.target[row][k] };
                s.moved[row][k] = if free { S::ZERO } else { s.y[row][k] - s.node.u[row][k] };
            }
        }
    }
    solve(world, settings, report, s, bodies, None)
}

/// Inverted elements of the bodies at displacements `y`; the report of volumes stays as it is.
fn inverted_by_body<S: Scalar>(world: &mut World, y: &[[S; 4]]) -> Vec<u64> {
    write_displacement(world, y);
    let before = world.resource::<VolumeReport>().clone();
    world.run_system_cached(measure_volume_ratios::<S>).expect("engine resources");
    std::mem::replace(&mut *world.resource_mut::<VolumeReport>(), before).inverted_by_body
}

/// Fraction of the step at which TR-BDF2 changes from the trapezoid to BDF2.
const GAMMA: f64 = 2.0 - std::f64::consts::SQRT_2;

/// Loads in the middle of the step; held unknowns go half of their way.
fn half_way<S: Scalar>(world: &mut World, s: &mut ImplicitScratch<S>) {
    s.within.read(world, &s.node.u, &s.node.prescribed, &s.node.fixed);
    load_at(s, 0.5);
    let half = S::from_f64(0.5);
    for row in 0..s.node.len() {
        for k in (0..3).filter(|&k| !s.node.free(row, k)) {
            let u = s.node.u[row][k];
            s.target[row][k] = u + half * (s.node.prescribed[row][k] - u);
        }
    }
}

/// Loads (N) when `part` of the step has passed into `s.load`.
fn load_at<S: Scalar>(s: &mut ImplicitScratch<S>, part: f64) {
    s.load.clone_from(&s.node.external);
    let mut differences = Vec::new();
    s.within.load_differences(part, &mut differences);
    for (&row, difference) in s.within.loaded.iter().zip(&differences) {
        for k in 0..3 {
            s.load[row as usize][k] += S::from_f64(difference[k]);
        }
    }
}

/// From the middle of the step to its end.
fn whole_way<S: Scalar>(
    world: &mut World,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    dt: f64,
) {
    let half = S::from_f64(0.5 * dt);
    for row in 0..s.node.len() {
        for k in 0..3 {
            let middle = s.moved[row][k];
            s.moved[row][k] = middle + middle;
            // the velocity at the end is (d - o) / (h / 2)
            let free = s.node.free(row, k);
            s.offset[row][k] = if free { half * s.node.v[row][k] } else { middle };
            s.y[row][k] =
                if free { s.node.u[row][k] + s.moved[row][k] } else { s.node.prescribed[row][k] };
        }
    }
    evaluate(world, &s.y, true, false, None);
    report.evaluations += 1;
    for (body, &energy) in bodies.iter_mut().zip(&world.resource::<ElasticEnergy>().by_body) {
        body.elastic = energy;
    }
}

/// First stage of TR-BDF2: the trapezoidal rule to `GAMMA` of the step.
fn trapezoid<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    dt: f64,
) -> Result<(), StepError> {
    let h = 0.5 * GAMMA * dt;
    for body in bodies.iter_mut() {
        (body.mode, body.w) = (Mode::Converge, Weights::new(settings, h));
    }
    // books of the whole step
    let [before, moved] = energies_at_start(world, report, s, bodies, false);
    freeze_damping(world, settings, report, &s.node.u, &mut s.damping);
    damp(world, s);
    book_start(report, s, bodies, &before, &moved);

    // the force at the start counts as a load
    evaluate(world, &s.node.u, false, true, None);
    report.evaluations += 1;
    read_force(world, &mut s.force);
    s.within.read(world, &s.node.u, &s.node.prescribed, &s.node.fixed);
    load_at(s, GAMMA);
    let now = std::mem::take(&mut s.load);
    load_at(s, 0.0);
    for row in 0..s.node.len() {
        // `damp` multiplies `moved - offset`
        s.offset[row] = s.node.v[row].map(|v| -v);
        s.moved[row] = [S::ZERO; 4];
    }
    damp(world, s);
    let alpha = S::from_f64(settings.mass_damping);
    for row in 0..s.node.len() {
        for k in 0..3 {
            let damping = alpha * s.node.mass[row] * s.node.v[row][k] + s.damped[row][k];
            s.load[row][k] += now[row][k] + s.force[row][k] - damping;
        }
    }
    let mut ways = Vec::new();
    s.within.ways(GAMMA, &mut ways);
    for (m, way) in s.within.moving.iter().zip(&ways) {
        let (row, k) = (m.row as usize, m.axis as usize);
        s.target[row][k] = s.node.u[row][k] + S::from_f64(*way);
    }
    begin(s);
    let hs = S::from_f64(h);
    for row in 0..s.node.len() {
        for k in 0..3 {
            s.offset[row][k] = hs * s.node.v[row][k];
            if s.node.free(row, k) {
                s.drift[row][k] = s.offset[row][k] + s.offset[row][k];
                s.moved[row][k] = s.drift[row][k];
                s.y[row][k] = s.node.u[row][k] + s.moved[row][k];
            }
        }
    }
    freeze_damping(world, settings, report, &s.y, &mut s.damping);
    solve(world, settings, report, s, bodies, None)
}

/// Second stage of TR-BDF2: BDF2 over the start, the end of the first stage, and the end of the step.
fn second_stage<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
    dt: f64,
) -> Result<(), StepError> {
    let a = S::from_f64(1.0 / (GAMMA * (2.0 - GAMMA)));
    let h = S::from_f64(0.5 * GAMMA * dt);
    let rest = S::from_f64((1.0 - GAMMA) * dt);
    s.step.resize(s.node.len(), [S::ZERO; 4]);
    for body in bodies.iter_mut() {
        velocities(s, body);
        (body.done, body.converged) = (false, false);
    }
    s.load.clone_from(&s.node.external);
    s.target.clone_from(&s.node.prescribed);
    for row in 0..s.node.len() {
        for k in 0..3 {
            let (way, v) = (s.moved[row][k], s.step[row][k]);
            s.offset[row][k] = a * way;
            if s.node.free(row, k) {
                let v0 = s.node.v[row][k];
                s.drift[row][k] = s.offset[row][k] + h * (v0 + a * (v - v0));
                s.moved[row][k] = way + rest * v;
                s.y[row][k] = s.node.u[row][k] + s.moved[row][k];
            } else {
                s.y[row][k] = s.target[row][k];
                s.moved[row][k] = s.y[row][k] - s.node.u[row][k];
            }
        }
    }
    freeze_damping(world, settings, report, &s.y, &mut s.damping);
    let first = report.unconverged;
    solve(world, settings, report, s, bodies, None)?;
    report.unconverged |= first;
    Ok(())
}

/// Equilibrium at the loads and held displacements of the step's end: in one go if Newton converges
/// and turns no element inside out, else by parts. The loads of a part leave a share of the residual
/// at the start uncovered, so that the start is the equilibrium of part 0; held unknowns follow their
/// curves. A part that fails is halved, at most [`MAX_PARTINGS`] times; if that does not help either,
/// the result of the attempt in one go stands.
fn equilibrium<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    bodies: &mut [BodyIteration],
) -> Result<(), StepError> {
    for body in bodies.iter_mut() {
        (body.mode, body.w) = (Mode::Converge, Weights::new(settings, f64::INFINITY));
    }
    s.within.read(world, &s.node.u, &s.node.prescribed, &s.node.fixed);
    let (mut uncovered, mut ways) = (Rows::default(), Vec::new());
    // displacements of the last equilibrium, and of the attempt in one go
    let mut last = s.node.u.clone();
    let mut at_once: Option<(Rows<S>, Vec<BodyIteration>, bool)> = None;
    let (mut done, mut size) = (0.0, 1.0_f64);
    let smallest = 0.5_f64.powi(MAX_PARTINGS as i32);
    loop {
        let part: f64 = (done + size).min(1.0);
        if part < 1.0 && uncovered.is_empty() {
            evaluate(world, &s.node.u, false, true, None);
            report.evaluations += 1;
            read_force(world, &mut uncovered);
            for (r, f) in uncovered.iter_mut().zip(&s.node.external) {
                for k in 0..3 {
                    r[k] += f[k];
                }
            }
        }
        s.load.clone_from(&s.node.external);
        s.target.clone_from(&s.node.prescribed);
        if part < 1.0 {
            let left = S::from_f64(1.0 - part);
            for row in 0..s.node.len() {
                for k in 0..3 {
                    s.load[row][k] -= left * uncovered[row][k];
                }
            }
            s.within.ways(part, &mut ways);
            for (m, way) in s.within.moving.iter().zip(&ways) {
                let (row, k) = (m.row as usize, m.axis as usize);
                s.target[row][k] = s.node.u[row][k] + S::from_f64(*way);
            }
        }
        begin(s);
        for row in 0..s.node.len() {
            for k in (0..3).filter(|&k| s.node.free(row, k)) {
                s.y[row][k] = last[row][k];
                s.moved[row][k] = last[row][k] - s.node.u[row][k];
            }
        }
        for body in bodies.iter_mut() {
            (body.done, body.converged) = (false, false);
        }
        let outcome = solve(world, settings, report, s, bodies, None);
        if at_once.is_none() {
            outcome?;
            at_once = Some((s.y.clone(), bodies.to_vec(), report.unconverged));
        } else if outcome.is_err() {
            report.unconverged = true;
        }
        let inverts = !report.unconverged && {
            let now = inverted_by_body(world, &s.y);
            bodies.iter().zip(now).any(|(b, now)| !b.inverted && now > 0)
        };
        if !(report.unconverged || inverts) {
            report.load_parts += 1;
            if part == 1.0 {
                return Ok(());
            }
            done = part;
            last.clone_from(&s.y);
        } else if size * 0.5 >= smallest {
            report.load_partings += 1;
            size *= 0.5;
        } else {
            let (y, then, unconverged) = at_once.take().expect("the first attempt is kept");
            (s.y, report.unconverged, report.load_parts) = (y, unconverged, 1);
            bodies.clone_from_slice(&then);
            for row in 0..s.node.len() {
                for k in 0..3 {
                    s.moved[row][k] = s.y[row][k] - s.node.u[row][k];
                }
            }
            return Ok(());
        }
    }
}

/// Product of the damping matrix and `d - o` into `s.damped`, zero without one.
fn damp<S: Scalar>(world: &World, s: &mut ImplicitScratch<S>) {
    s.damped.clear();
    s.damped.resize(s.node.len(), [S::ZERO; 4]);
    if !s.damping.diagonal.is_empty() {
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        s.rate.clear();
        let rate = |(d, o): (&[S; 4], &[S; 4])| [d[0] - o[0], d[1] - o[1], d[2] - o[2], S::ZERO];
        s.rate.extend(s.moved.iter().zip(&s.offset).map(rate));
        s.damping.multiply(topology, workers, &mut s.product, &s.rate, &mut s.damped);
    }
}

/// `-dP/dd` on the free unknowns, zero on held ones.
fn right_hand_side<S: Scalar>(s: &mut ImplicitScratch<S>, bodies: &[BodyIteration]) {
    s.rhs.resize(s.node.len(), [S::ZERO; 4]);
    for body in bodies.iter().filter(|b| !b.done) {
        let (wi, wm) = (S::from_f64(body.w.inertia), S::from_f64(body.w.mass_damping));
        let ws = S::from_f64(body.w.rate);
        for row in body.rows.clone() {
            let m = s.node.mass[row];
            for k in 0..3 {
                s.rhs[row][k] = if s.node.free(row, k) {
                    let (d, o) = (s.moved[row][k], s.offset[row][k]);
                    m * (wi * (s.drift[row][k] - d) - wm * (d - o)) - ws * s.damped[row][k]
                        + s.force[row][k]
                        + s.load[row][k]
                } else {
                    S::ZERO
                };
            }
        }
    }
}

/// Solves for the Newton step of every unfinished body into `s.step`, with the tangent of `kind`,
/// already evaluated. An exact one that turns out indefinite gives way to the projected one, and when
/// even that gives no descent to the preconditioned gradient.
fn directions<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    kind: TangentKind,
    bodies: &mut [BodyIteration],
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) -> Result<(), StepError> {
    let clock = Instant::now();
    let mut evaluation = clock.elapsed();
    s.step.clear();
    s.step.resize(s.node.len(), [S::ZERO; 4]);
    let mut pending: Vec<usize> = (0..bodies.len()).filter(|&i| !bodies[i].done).collect();
    report.cg_residual = 0.0;
    if kind == TangentKind::Exact {
        let mut rest = Vec::new();
        for i in pending {
            let exact = !bodies[i].projects();
            let warm = bodies[i].mode != Mode::Converge;
            if exact && solve_body(world, settings, i, &bodies[i], warm, report, s)? {
                continue;
            }
            if bodies[i].mode == Mode::Trial {
                bodies[i].reject(Rejected::Indefinite);
            } else {
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
        let warm = bodies[i].projects();
        if !solve_body(world, settings, i, &bodies[i], warm, report, s)? {
            let rows = bodies[i].rows.clone();
            let ImplicitScratch { node, rhs, step, damping, .. } = s;
            let system = system(world, &bodies[i].w, node, damping);
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
        damping: (!damping.diagonal.is_empty()).then_some((damping, S::from_f64(w.rate))),
        fixed: &node.fixed,
    }
}

/// Solves for one body with the tangent last evaluated; false when the matrix is not positive
/// definite or gives no descent.
fn solve_body<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
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
    let w = &body.w;
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
                s.target[row][k]
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
    tolerance: f64,
    bodies: &mut [BodyIteration],
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) {
    s.damped_step.clear();
    s.damped_step.resize(s.node.len(), [S::ZERO; 4]);
    if !s.damping.diagonal.is_empty() {
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        s.damping.multiply(topology, workers, &mut s.product, &s.step, &mut s.damped_step);
    }
    let mut searches: Vec<LineSearch> = (0..bodies.len())
        .filter(|&i| !bodies[i].done)
        .map(|i| prepare_search(i, &bodies[i], s))
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
            } else if body.mode == Mode::Trial {
                search.accepted = true;
                body.reject(Rejected::Shortened);
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
    s: &ImplicitScratch<S>,
) -> LineSearch {
    let w = &body.w;
    let (mut linear, mut quadratic, mut slope) = (0.0, 0.0, 0.0);
    let mut scale = body.elastic.abs();
    for row in body.rows.clone() {
        let m = s.node.mass[row].to_f64();
        let d = &s.step[row];
        for k in 0..3 {
            let d = d[k].to_f64();
            let away = (s.moved[row][k] - s.drift[row][k]).to_f64();
            if s.node.free(row, k) {
                let way = (s.moved[row][k] - s.offset[row][k]).to_f64();
                linear += m * d * (w.inertia * away + w.mass_damping * way);
                quadratic += m * d * d * (w.inertia + w.mass_damping);
                scale += 0.5 * m * w.inertia * away * away;
            }
            linear -= s.load[row][k].to_f64() * d;
            linear += w.rate * s.damped[row][k].to_f64() * d;
        }
        slope -= dot3(&s.rhs[row], d);
        quadratic += w.rate * dot3(&s.damped_step[row], d);
    }
    // Near its end Newton converges quadratically while differences of energy drown in rounding
    // (more so for pooled springs, whose terms cancel): such steps are taken as they are. The safe
    // step always tests, its bound rests on it.
    let resolved = body.mode != Mode::Converge || -slope > noise::<S>().max(UNRESOLVED) * scale;
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

/// Velocities of a body at the end of the step into `s.step`.
fn velocities<S: Scalar>(s: &mut ImplicitScratch<S>, body: &BodyIteration) {
    let per_second = S::from_f64(body.w.rate);
    for row in body.rows.clone() {
        for k in 0..3 {
            s.step[row][k] = (s.moved[row][k] - s.offset[row][k]) * per_second;
        }
    }
}

/// Power (W) that damping takes at the velocities in `s.step`, `s.damped` being up to date.
fn damping_power<S: Scalar>(
    settings: &SolverSettings,
    s: &ImplicitScratch<S>,
    body: &BodyIteration,
) -> f64 {
    let viscous: f64 = body.rows.clone().map(|row| dot3(&s.step[row], &s.damped[row])).sum::<f64>();
    let kinetic = s.node.kinetic_energy(body.rows.clone(), &s.step)[0];
    2.0 * settings.mass_damping * kinetic + body.w.rate * viscous
}

/// Velocities, energy cap, report, and the new state into the columns and the history.
fn finish<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    dt: f64,
    bodies: &[BodyIteration],
    flown: &[Flown<S>],
) {
    let dynamic = settings.integrator != Integrator::QuasiStatic;
    s.history.bodies.clear();
    let mut energy_before = 0.0;
    damp(world, s);
    for body in bodies {
        velocities(s, body);
        let rows = body.rows.clone();
        for orphan in flown.iter().filter(|orphan| rows.contains(&orphan.row)) {
            for k in (0..3).filter(|&k| !orphan.held.holds(k)) {
                s.step[orphan.row][k] = orphan.velocity[k];
            }
        }
        if dynamic {
            report.damping_dissipation += dt * damping_power(settings, s, body);
        }
        let potential = body.elastic - s.node.load_potential(rows.clone(), &s.y);
        let [mut kinetic, held] = s.node.kinetic_energy(rows.clone(), &s.step);
        if dynamic
            && body.mode == Mode::Safe
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
        if dynamic {
            // what holds vertices also speeds them up and slows them down
            let [free_before, held_before] = s.node.kinetic_energy(rows.clone(), &s.node.v);
            report.kinetic_energy += kinetic + held;
            report.constraint_work += held - held_before;
            report.load_work +=
                s.node.load_potential(rows.clone(), &s.y) - s.node.load_potential(rows, &s.node.u);
            energy_before += body.elastic_before + free_before + held_before;
        } else {
            report.constraint_work = 0.0;
        }
        let failed = body.rejected.is_some();
        let (past, unused) = (body.past.body, body.budget - (kinetic + potential));
        s.history.bodies.push(BodyHistory {
            elastic: body.elastic,
            // what a safe step takes is not given back
            excess: if body.mode == Mode::Trial {
                (1.0 - BUDGET_DECAY) * (unused + past.excess).max(0.0)
            } else {
                0.0
            },
            wait: if failed { WAIT } else { past.wait.saturating_sub(1) },
        });
    }
    if dynamic {
        let work = report.load_work + report.constraint_work;
        let now = report.elastic_energy + report.kinetic_energy;
        report.dissipation = energy_before + work - now;
    }
    book_momentum(report, &s.rest, &s.node.mass, &s.y, &s.step);
    write_state(world, &s.y, &s.step);
    let h = &mut s.history;
    std::mem::swap(&mut h.u, &mut s.y);
    std::mem::swap(&mut h.v, &mut s.step);
    std::mem::swap(&mut h.way, &mut s.moved);
    std::mem::swap(&mut h.v_before, &mut s.node.v);
    h.mass.clone_from(&s.node.mass);
    h.fixed.clone_from(&s.node.fixed);
    h.dt = dt;
    h.stamp(world);
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
