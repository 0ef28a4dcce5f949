//! Symplectic Euler and Störmer-Verlet (velocity form) with automatic substeps.
//!
//! Both are stable up to `h = 2 / omega_max`, where `omega_max^2` is the largest eigenvalue of
//! `M^-1 K` on the free unknowns. It is estimated by power iteration on the exact tangent at the
//! current state, at the start and again every few steps, since compression stiffens elements. A
//! step is cut into as many substeps as the limit asks for; if the energy nevertheless grows, the
//! step is undone and repeated with twice as many. Loads act through a step as they are at its end.

use crate::cg::ShiftedTangent;
use crate::implicit::momentum;
use crate::settings::{Integrator, SolverSettings};
use crate::state::{NodeState, Rows, dot3, evaluate, read_force, write_state};
use bevy_ecs::prelude::*;
use sinew_engine::law::TangentKind;
use sinew_engine::matrix::{ProductSpans, Tangent};
use sinew_engine::report::StepReport;
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError};
use sinew_engine::topology::Topology;
use sinew_engine::vertex::FixedAxes;
use sinew_engine::workers::Workers;

/// Work space of the explicit integrators.
#[derive(Resource, Clone, Debug, Default)]
pub struct ExplicitScratch<S: Scalar> {
    node: NodeState<S>,
    u: Rows<S>,
    v: Rows<S>,
    force: Rows<S>,
    /// Way (m) of held unknowns through the substep.
    way: Rows<S>,
    mode: Rows<S>,
    product: Rows<S>,
    spans: ProductSpans<S>,
    /// Stable step (s) and the step number at which it was estimated.
    limit: Option<(f64, u64)>,
    revision: u64,
    /// Held axes at that estimate.
    fixed: Vec<FixedAxes>,
}

/// Steps between two estimates of the stability limit.
const ESTIMATE_EVERY: u64 = 10;
/// Doublings of the substep count before a step is given up.
const MAX_REFINEMENTS: u32 = 6;
/// Energy growth (relative to the energies involved) at which a step counts as unstable. The energy
/// of a symplectic scheme oscillates by some (omega h)^2 / 8 within the stable range.
const GROWTH: f64 = 0.25;

/// Carries out one step with an explicit integrator.
///
/// # Errors
/// When the step needs more substeps than allowed, or stays unstable; the columns are unchanged.
pub fn explicit_step<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut s = world.remove_resource::<ExplicitScratch<S>>().unwrap_or_default();
    s.node.read(world);
    let result = substep(world, settings, report, &mut s);
    if result.is_err() {
        write_state(world, &s.node.u, &s.node.v);
    }
    world.insert_resource(s);
    result
}

fn substep<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ExplicitScratch<S>,
) -> Result<(), StepError> {
    if s.node.is_empty() {
        return Ok(());
    }
    let clock = *world.resource::<StepClock>();
    let revision = world.resource::<Topology>().revision;
    let stale = s.revision != revision
        || s.fixed != s.node.fixed
        || s.limit.is_none_or(|(_, at)| clock.step < at || clock.step >= at + ESTIMATE_EVERY);
    if stale {
        let start: Rows<S> = s.node.u.clone();
        s.limit = Some((stable_step(world, s, &start), clock.step));
        s.revision = revision;
        s.fixed.clone_from(&s.node.fixed);
        report.evaluations += 1;
    }
    let limit = s.limit.map_or(f64::INFINITY, |(limit, _)| limit);
    report.stable_step = limit;
    let needed = (clock.dt / (limit * settings.explicit_safety)).ceil().max(1.0);
    let mut substeps = if needed <= f64::from(settings.max_substeps) {
        needed as u32
    } else {
        return Err(refuse(&clock, needed, limit, settings));
    };
    for refinement in 0..=MAX_REFINEMENTS {
        if substeps > settings.max_substeps {
            return Err(refuse(&clock, f64::from(substeps), limit, settings));
        }
        if attempt(world, settings, report, s, clock.dt, substeps) {
            report.substeps = substeps;
            report.refinements = refinement;
            if refinement > 0 {
                // the limit was too optimistic: estimate again at the next step
                s.limit = None;
            }
            write_state(world, &s.u, &s.v);
            return Ok(());
        }
        substeps = substeps.saturating_mul(2);
    }
    Err(StepError::Diverged {
        step: clock.step,
        time: clock.time,
        reason: format!(
            "the energy grew, or a number overflowed, even with {substeps} substeps (estimated \
             stability limit {limit:.3e} s); check loads and prescribed motion, reduce dt or use \
             integrator = \"safe\""
        ),
    })
}

fn refuse(clock: &StepClock, needed: f64, limit: f64, settings: &SolverSettings) -> StepError {
    StepError::Diverged {
        step: clock.step,
        time: clock.time,
        reason: format!(
            "an explicit step of {} s needs {needed:.0} substeps (stability limit {limit:.3e} s), \
             more than max_substeps = {}; reduce dt, raise max_substeps or use integrator = \"safe\"",
            clock.dt, settings.max_substeps
        ),
    }
}

/// One step with a given number of substeps; false when the energy grew or a number is not finite.
fn attempt<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
    s: &mut ExplicitScratch<S>,
    dt: f64,
    substeps: u32,
) -> bool {
    let n = s.node.len();
    s.u.clone_from(&s.node.u);
    s.v.clone_from(&s.node.v);
    s.way.clear();
    s.way.resize(n, [S::ZERO; 4]);
    let h = dt / f64::from(substeps);
    let verlet = settings.integrator == Integrator::StormerVerlet;
    let potential0 = evaluate(world, &s.u, true, true, None) - s.node.load_potential(0..n, &s.u);
    read_force(world, &mut s.force);
    report.evaluations += 1;
    let [kinetic0, held0] = s.node.kinetic_energy(0..n, &s.v);
    let mut constraint_work = 0.0;

    for i in 1..=substeps {
        let first_kick = if verlet { 0.5 * h } else { h };
        kick(s, settings.mass_damping, first_kick);
        // prescribed unknowns move evenly through the step; their work is the reaction times the way
        let (hs, part) = (S::from_f64(h), f64::from(i) / f64::from(substeps));
        for row in 0..n {
            for k in 0..3 {
                if s.node.free(row, k) {
                    let v = s.v[row][k];
                    s.u[row][k] += hs * v;
                } else {
                    let (from, to) = (s.node.u[row][k], s.node.prescribed[row][k]);
                    let next = from + S::from_f64(part) * (to - from);
                    s.way[row][k] = next - s.u[row][k];
                    constraint_work += reaction_work(s, row, k);
                    s.u[row][k] = next;
                    s.v[row][k] = (to - from) * S::from_f64(1.0 / dt);
                }
            }
        }
        let last = i == substeps;
        let energy = evaluate(world, &s.u, last, true, None);
        read_force(world, &mut s.force);
        report.evaluations += 1;
        for row in 0..n {
            for k in (0..3).filter(|&k| s.node.fixed[row].holds(k)) {
                constraint_work += reaction_work(s, row, k);
            }
        }
        if verlet {
            kick(s, settings.mass_damping, 0.5 * h);
        }
        if last {
            let [kinetic, held] = s.node.kinetic_energy(0..n, &s.v);
            let potential = energy - s.node.load_potential(0..n, &s.u);
            let scale = kinetic0
                + kinetic
                + energy.abs()
                + (potential0 - potential).abs()
                + constraint_work.abs();
            let grown = kinetic + potential - kinetic0 - potential0 - constraint_work;
            if !grown.is_finite() || grown > GROWTH * scale {
                return false;
            }
            report.elastic_energy = energy;
            report.kinetic_energy = kinetic + held;
            // what holds vertices also speeds them up and slows them down
            report.constraint_work = constraint_work + held - held0;
            report.load_work =
                s.node.load_potential(0..n, &s.u) - s.node.load_potential(0..n, &s.node.u);
            report.momentum = momentum(&s.node.mass, &s.v);
        }
    }
    s.u.iter().chain(&s.v).all(|x| x.iter().all(|x| x.is_finite()))
}

/// Half the work (J) of the reaction at a held unknown along its way through the substep; taken once
/// before and once after the way, the halves add up to the trapezoidal rule.
fn reaction_work<S: Scalar>(s: &ExplicitScratch<S>, row: usize, k: usize) -> f64 {
    let reaction = -(s.force[row][k] + s.node.external[row][k]).to_f64();
    0.5 * reaction * s.way[row][k].to_f64()
}

/// `v += t (f / m - alpha v)` on the free unknowns, damping taken implicitly.
fn kick<S: Scalar>(s: &mut ExplicitScratch<S>, damping: f64, t: f64) {
    let t_s = S::from_f64(t);
    let keep = S::from_f64(1.0 / (1.0 + damping * t));
    for row in 0..s.node.len() {
        let by_mass = t_s / s.node.mass[row];
        for k in 0..3 {
            if s.node.free(row, k) {
                let f = s.force[row][k] + s.node.external[row][k];
                s.v[row][k] = (s.v[row][k] + by_mass * f) * keep;
            }
        }
    }
}

/// Largest stable explicit step (s) at the current state, before any safety factor; infinite when
/// nothing can move. Constraints count as far as the last step applied them.
pub fn estimate_stable_step<S: Scalar>(world: &mut World) -> f64 {
    let mut scratch = ExplicitScratch::<S>::default();
    scratch.node.read(world);
    let u = scratch.node.u.clone();
    if u.is_empty() { f64::INFINITY } else { stable_step(world, &mut scratch, &u) }
}

/// `2 / omega_max` (s) at displacements `u`, by power iteration on `M^-1/2 K M^-1/2`.
fn stable_step<S: Scalar>(world: &mut World, s: &mut ExplicitScratch<S>, u: &[[S; 4]]) -> f64 {
    evaluate(world, u, false, false, Some(TangentKind::Exact));
    let n = s.node.len();
    // deterministic start with components along every mode
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    s.mode.clear();
    s.mode.resize_with(n, || {
        let mut next = || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            S::from_f64((seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
        };
        [next(), next(), next(), S::ZERO]
    });
    let root: Vec<S> = s.node.mass.iter().map(|m| S::ONE / m.sqrt()).collect();
    for row in 0..n {
        for k in 0..3 {
            if !s.node.free(row, k) {
                s.mode[row][k] = S::ZERO;
            }
        }
    }
    let tangent = world.resource::<Tangent<S>>();
    let zero = vec![S::ZERO; n];
    let system = ShiftedTangent {
        topology: world.resource::<Topology>(),
        workers: world.resource::<Workers>(),
        mass: &zero,
        mass_factor: S::ZERO,
        tangent: &tangent.matrix,
        tangent_factor: S::ONE,
        damping: None,
        fixed: &s.node.fixed,
    };
    let mut largest = 0.0_f64;
    let mut scratch = Rows::default();
    s.product.resize(n, [S::ZERO; 4]);
    for _ in 0..200 {
        let norm = s.mode.iter().map(|x| dot3(x, x)).sum::<f64>().sqrt();
        if norm == 0.0 {
            return f64::INFINITY;
        }
        let scale = S::from_f64(1.0 / norm);
        for (x, r) in s.mode.iter_mut().zip(&root) {
            (0..3).for_each(|k| x[k] *= scale * *r);
        }
        for (body, rows) in system.topology.bodies.iter().enumerate() {
            let rows = rows.vertices.start as usize..rows.vertices.end as usize;
            let (x, y) = (&s.mode[rows.clone()], &mut s.product[rows]);
            system.multiply(&mut s.spans, &mut scratch, body, x, y);
        }
        let mut square = 0.0;
        for (y, r) in s.product.iter_mut().zip(&root) {
            (0..3).for_each(|k| y[k] *= *r);
            square += dot3(y, y);
        }
        std::mem::swap(&mut s.mode, &mut s.product);
        // |A x| for a unit x approaches the eigenvalue of largest magnitude from below
        let previous = largest;
        largest = square.sqrt();
        if (largest - previous).abs() <= 1e-3 * largest {
            break;
        }
    }
    // not a number: the state is beyond the range of the number type, no step is safe
    if largest.is_nan() {
        0.0
    } else if largest > 0.0 {
        2.0 / largest.sqrt()
    } else {
        f64::INFINITY
    }
}
