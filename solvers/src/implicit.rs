//! Implicit Euler and quasi-static equilibrium as minimisation of an incremental potential
//!
//! `P(y) = c_M/2 |y - y_inertia|^2_M + W(y) - f.y + 1/(2h) (y - x_n)^T C (y - x_n)`
//!
//! over the free unknowns, with `c_M = 1/h^2` and `y_inertia = x_n + h v_n` (implicit Euler), or
//! `c_M = 0` (equilibrium). `C = alpha M + beta K_gn(x_n)` is Rayleigh damping, frozen at the start
//! of the step with the positive semi-definite part of the tangent.
//!
//! * **Safe**: one Newton step from `x_n` (prescribed vertices moved) with the exact Hessian. If
//!   conjugate gradients meet non-positive curvature, or the last step ended with inverted elements,
//!   the tangent is assembled again with clamped elements and the system solved again. Armijo backtracking on `P`, then the energy cap: since
//!   Armijo gives `W(y) + |v - v_n|^2_M / 2 <= W(y_0) + |v_n|^2_M / 2`, a factor on `v` exists that
//!   keeps kinetic plus potential energy at or below `T_n + W(y_0)`, so the total energy never rises
//!   between outside actions, for any step length.
//! * **Newton**: the same iteration to convergence.
//! * **Quasi-static**: the same without inertia.

use crate::cg::{CgScratch, CgStatus, ShiftedTangent};
use crate::settings::{Integrator, SolverSettings};
use crate::state::{NodeState, Rows, dot3, evaluate, read_force, write_state};
use bevy_ecs::prelude::*;
use sinew_engine::law::TangentKind;
use sinew_engine::matrix::{BlockMatrix, ProductSpans, Tangent};
use sinew_engine::report::{StepReport, SystemTimes, VolumeReport};
use sinew_engine::scalar::Scalar;
use sinew_engine::step::{StepClock, StepError, not_finite};
use sinew_engine::topology::Topology;
use sinew_engine::workers::Workers;
use std::time::Instant;

/// Work space of the implicit integrators.
#[derive(Resource, Clone, Debug, Default)]
pub struct ImplicitScratch<S: Scalar> {
    node: NodeState<S>,
    /// Where inertia alone would take the vertices (m).
    inertia: Rows<S>,
    y: Rows<S>,
    trial: Rows<S>,
    force: Rows<S>,
    rhs: Rows<S>,
    step: Rows<S>,
    damping: BlockMatrix<S>,
    damped: Rows<S>,
    moved: Rows<S>,
    product: ProductSpans<S>,
    cg: CgScratch<S>,
}

/// Weights of the incremental potential.
#[derive(Clone, Copy, Debug)]
struct Weights {
    /// Factor of `|y - y_inertia|^2_M / 2` (1/s^2).
    inertia: f64,
    /// Factor of `|y - x_n|^2_M / 2`, mass damping over h (1/s^2).
    mass_damping: f64,
    /// Factor of `(y - x_n)^T K_gn (y - x_n) / 2`, stiffness damping over h.
    stiffness_damping: f64,
}

/// Armijo constant.
const ARMIJO: f64 = 1e-4;
/// Predicted decrease, over the energies involved, below which Newton does not test for decrease.
const UNRESOLVED: f64 = 1e-10;
/// Most halvings of the line search.
const MAX_HALVINGS: u32 = 30;

/// Carries out one implicit step, or finds one equilibrium.
///
/// # Errors
/// When a number stops being finite or no iterate exists; the columns are then unchanged.
pub fn implicit_step<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    report: &mut StepReport,
) -> Result<(), StepError> {
    let mut scratch = world.remove_resource::<ImplicitScratch<S>>().unwrap_or_default();
    scratch.node.read(world);
    let result = minimise(world, settings, report, &mut scratch);
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
    if n == 0 {
        return Ok(());
    }
    let clock = *world.resource::<StepClock>();
    let h = clock.dt;
    let statics = settings.integrator == Integrator::QuasiStatic;
    let weights = if statics {
        Weights { inertia: 0.0, mass_damping: 0.0, stiffness_damping: 0.0 }
    } else {
        Weights {
            inertia: 1.0 / (h * h),
            mass_damping: settings.mass_damping / h,
            stiffness_damping: settings.stiffness_damping / h,
        }
    };
    if statics {
        check_support(world.resource::<Topology>(), &s.node)?;
    }
    let size = world.resource::<Topology>().bodies.iter().map(|b| b.size).fold(0.0, f64::max);

    // start: the old state with the prescribed unknowns moved
    s.y.clone_from(&s.node.u);
    s.inertia.clone_from(&s.node.u);
    let mut moved = false;
    for row in 0..n {
        for k in 0..3 {
            if s.node.free(row, k) {
                if !statics {
                    s.inertia[row][k] += S::from_f64(h) * s.node.v[row][k];
                }
            } else if s.y[row][k] != s.node.prescribed[row][k] {
                s.y[row][k] = s.node.prescribed[row][k];
                moved = true;
            }
        }
    }
    let energy_before = if moved {
        report.evaluations += 1;
        Some(evaluate(world, &s.node.u, true, false, None))
    } else {
        None
    };
    if weights.stiffness_damping > 0.0 {
        evaluate(world, &s.node.u, false, false, Some(TangentKind::GaussNewton));
        report.evaluations += 1;
        std::mem::swap(&mut s.damping, &mut world.resource_mut::<Tangent<S>>().matrix);
    }

    let newton = settings.integrator != Integrator::Safe;
    let max_iterations = if newton { settings.max_newton_iterations } else { 1 };
    let mut elastic = 0.0;
    let mut budget = None;
    let mut converged = false;
    // Around inverted elements the exact tangent has negative curvature that a loose solve may not
    // meet; stepping along it wound one crushed cube in 18, going straight to the projected one none.
    let first_kind = if !newton && world.resource::<VolumeReport>().inverted > 0 {
        TangentKind::Projected
    } else {
        TangentKind::Exact
    };
    for iteration in 0..max_iterations {
        elastic = evaluate(world, &s.y, true, true, Some(first_kind));
        report.evaluations += 1;
        read_force(world, &mut s.force);
        if !elastic.is_finite() {
            return Err(locate(world, &s.force, "elastic force"));
        }
        if iteration == 0 {
            let work_of_loads = s.node.load_potential(&s.y) - s.node.load_potential(&s.node.u);
            report.constraint_work =
                energy_before.map_or(0.0, |before| elastic - before - work_of_loads);
            budget = Some(s.node.kinetic_energy(&s.node.v) + elastic - s.node.load_potential(&s.y));
        }
        right_hand_side(world, s, &weights);
        let solved = newton_direction(world, settings, &weights, first_kind, !newton, report, s)?;
        report.newton_iterations += 1;

        // the step size is tested before the line search, which drowns in rounding near the minimum
        let length = s.step.iter().flat_map(|d| d[..3].iter()).fold(0.0, |m, x| {
            let x = x.to_f64().abs();
            if x > m { x } else { m }
        });
        report.newton_step = length / size;
        if newton && solved && report.newton_step <= settings.newton_tolerance {
            for (y, d) in s.y.iter_mut().zip(&s.step) {
                (0..3).for_each(|k| y[k] += d[k]);
            }
            converged = true;
            break;
        }
        if !line_search(world, &weights, newton, report, s, &mut elastic) {
            report.line_search_failures += 1;
            // rounding level: the gradient is as small as the energy can resolve
            converged = report.newton_step <= settings.newton_tolerance.max(noise::<S>());
            break;
        }
    }
    if newton && !converged {
        report.unconverged = true;
    }

    finish(world, report, s, h, statics, newton, elastic, budget);
    if let Some(row) = s.y.iter().position(|y| y.iter().any(|x| !x.is_finite())) {
        return Err(not_finite(
            world,
            row,
            "new displacement",
            "the step was undone; try a smaller step or check material and loads",
        ));
    }
    Ok(())
}

/// Every connected piece must be held against rigid motion, or the equilibrium is not unique.
fn check_support<S: Scalar>(topology: &Topology, node: &NodeState<S>) -> Result<(), StepError> {
    // pieces by union-find along the edge graph
    let mut parent: Vec<u32> = (0..node.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for &[a, b] in &topology.edges {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        parent[a as usize] = b;
    }
    let mut held = vec![0u32; node.len()];
    for row in 0..node.len() {
        held[root(&mut parent, row as u32) as usize] += node.fixed[row].0.count_ones();
    }
    for (index, body) in topology.bodies.iter().enumerate() {
        for row in body.vertices.clone() {
            let count = held[root(&mut parent, row) as usize];
            // six rigid motions need six held unknowns
            if count < 6 {
                return Err(StepError::InvalidSetting(format!(
                    "body `{}` (number {index}): the piece with vertex {} has {count} held unknowns, \
                     equilibrium needs at least 6 against its rigid motions; fix some vertices or \
                     use a dynamic integrator",
                    body.name,
                    body.vertex_order[(row - body.vertices.start) as usize]
                )));
            }
        }
    }
    Ok(())
}

/// Relative size below which differences of energies are rounding.
fn noise<S: Scalar>() -> f64 {
    450.0 * S::EPSILON.to_f64()
}

/// `-dP/dy` on the free unknowns, zero on held ones.
fn right_hand_side<S: Scalar>(world: &World, s: &mut ImplicitScratch<S>, w: &Weights) {
    let n = s.node.len();
    s.moved.resize(n, [S::ZERO; 4]);
    for row in 0..n {
        for k in 0..3 {
            s.moved[row][k] = s.y[row][k] - s.node.u[row][k];
        }
    }
    s.damped.clear();
    s.damped.resize(n, [S::ZERO; 4]);
    if w.stiffness_damping > 0.0 {
        s.damping.multiply(
            world.resource::<Topology>(),
            world.resource::<Workers>(),
            &mut s.product,
            &s.moved,
            &mut s.damped,
        );
    }
    s.rhs.resize(n, [S::ZERO; 4]);
    let (wi, wm) = (S::from_f64(w.inertia), S::from_f64(w.mass_damping));
    let ws = S::from_f64(w.stiffness_damping);
    for row in 0..n {
        let m = s.node.mass[row];
        for k in 0..3 {
            s.rhs[row][k] = if s.node.free(row, k) {
                m * (wi * (s.inertia[row][k] - s.y[row][k]) - wm * s.moved[row][k])
                    - ws * s.damped[row][k]
                    + s.force[row][k]
                    + s.node.external[row][k]
            } else {
                S::ZERO
            };
        }
    }
}

/// Solves for the Newton step into `s.step` with the tangent of `first_kind`, already evaluated; an
/// exact one that turns out indefinite gives way to the projected one, and when even that fails to
/// the preconditioned gradient. Says whether a system was solved to its tolerance.
fn newton_direction<S: Scalar>(
    world: &mut World,
    settings: &SolverSettings,
    w: &Weights,
    first_kind: TangentKind,
    warm_start: bool,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
) -> Result<bool, StepError> {
    let n = s.node.len();
    let tolerance = settings.linear_tolerance;
    for kind in [TangentKind::Exact, TangentKind::Projected] {
        let projected = kind == TangentKind::Projected;
        if !projected && first_kind == TangentKind::Projected {
            continue;
        }
        if projected {
            if first_kind != kind {
                evaluate(world, &s.y, false, false, Some(kind));
                report.evaluations += 1;
            }
            report.projections += 1;
            report.clamped_elements += world.resource::<Tangent<S>>().clamped;
        }
        // warm start: inertia says where the vertices would go
        s.step.resize(n, [S::ZERO; 4]);
        for row in 0..n {
            for k in 0..3 {
                let warm = warm_start && kind == first_kind && s.node.free(row, k);
                s.step[row][k] = if warm { s.inertia[row][k] - s.y[row][k] } else { S::ZERO };
            }
        }
        let tangent = world.resource::<Tangent<S>>();
        let system = ShiftedTangent {
            topology: world.resource::<Topology>(),
            workers: world.resource::<Workers>(),
            mass: &s.node.mass,
            mass_factor: S::from_f64(w.inertia + w.mass_damping),
            tangent: &tangent.matrix,
            tangent_factor: S::ONE,
            damping: (w.stiffness_damping > 0.0)
                .then_some((&s.damping, S::from_f64(w.stiffness_damping))),
            fixed: &s.node.fixed,
        };
        let start = Instant::now();
        let outcome =
            system.solve(&mut s.cg, &s.rhs, &mut s.step, tolerance, settings.max_linear_iterations);
        report.cg_iterations += outcome.iterations;
        report.cg_residual = outcome.residual;
        let time = start.elapsed();
        let descent: f64 = s.rhs.iter().zip(&s.step).map(|(b, d)| dot3(b, d)).sum();
        match outcome.status {
            CgStatus::Converged | CgStatus::Cap if descent > 0.0 || norm(&s.rhs) == 0.0 => {
                let capped = outcome.status == CgStatus::Cap;
                report.cg_caps += u32::from(capped);
                if w.inertia > 0.0 {
                    correct_momentum(world.resource::<Topology>(), s, w.inertia + w.mass_damping);
                }
                world.resource_mut::<SystemTimes>().add("linear solves", time);
                return Ok(!capped);
            }
            CgStatus::NotFinite if projected => {
                return Err(locate(world, &s.rhs, "residual force"));
            }
            _ if projected => {
                system.preconditioned(&mut s.cg, &s.rhs, &mut s.step);
                report.cg_caps += 1;
                return Ok(false);
            }
            _ => {}
        }
        world.resource_mut::<SystemTimes>().add("linear solves", time);
    }
    unreachable!("the loop returns in its second turn")
}

/// Adds to the step of every body without held unknowns the translation that balances its momentum.
///
/// A tangent resists no translation, so the exact solution has `c_M sum m d = sum rhs`; a loose
/// solve leaves a residual with a resultant, which would push a free body about.
fn correct_momentum<S: Scalar>(topology: &Topology, s: &mut ImplicitScratch<S>, factor: f64) {
    for body in &topology.bodies {
        let rows = body.vertices.start as usize..body.vertices.end as usize;
        if s.node.fixed[rows.clone()].iter().any(|f| f.0 != 0) {
            continue;
        }
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
}

fn norm<S: Scalar>(x: &[[S; 4]]) -> f64 {
    x.iter().map(|x| dot3(x, x)).sum::<f64>().sqrt()
}

/// Backtracks along `s.step` until the potential decreases enough; moves `s.y` and updates the
/// elastic energy. False when no decrease was found.
fn line_search<S: Scalar>(
    world: &mut World,
    w: &Weights,
    newton: bool,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    elastic: &mut f64,
) -> bool {
    let n = s.node.len();
    // P along y + t d, as differences to P(y): a t + b t^2 / 2 from inertia, damping and loads
    let (mut linear, mut quadratic, mut scale) = (0.0, 0.0, elastic.abs());
    let mut slope = 0.0;
    let damped_step = if w.stiffness_damping > 0.0 {
        let mut product = vec![[S::ZERO; 4]; n];
        s.damping.multiply(
            world.resource::<Topology>(),
            world.resource::<Workers>(),
            &mut s.product,
            &s.step,
            &mut product,
        );
        Some(product)
    } else {
        None
    };
    for row in 0..n {
        let m = s.node.mass[row].to_f64();
        let d = &s.step[row];
        for k in 0..3 {
            let d = d[k].to_f64();
            let away = (s.y[row][k] - s.inertia[row][k]).to_f64();
            let moved = s.moved[row][k].to_f64();
            if s.node.free(row, k) {
                linear += m * d * (w.inertia * away + w.mass_damping * moved);
                quadratic += m * d * d * (w.inertia + w.mass_damping);
                scale += 0.5 * m * w.inertia * away * away;
            }
            linear -= s.node.external[row][k].to_f64() * d;
            linear += w.stiffness_damping * s.damped[row][k].to_f64() * d;
        }
        slope -= dot3(&s.rhs[row], d);
        if let Some(product) = &damped_step {
            quadratic += w.stiffness_damping * dot3(&product[row], d);
        }
    }
    let rounding = noise::<S>() * scale;
    // Near its end Newton converges quadratically while differences of energy drown in rounding
    // (more so for pooled springs, whose terms cancel): such steps are taken as they are. The safe
    // step always tests, its bound rests on it.
    let resolved = !newton || -slope > noise::<S>().max(UNRESOLVED) * scale;
    s.trial.resize(n, [S::ZERO; 4]);
    let mut t = 1.0;
    for _ in 0..MAX_HALVINGS {
        let factor = S::from_f64(t);
        for (trial, (y, d)) in s.trial.iter_mut().zip(s.y.iter().zip(&s.step)) {
            for k in 0..3 {
                trial[k] = y[k] + factor * d[k];
            }
        }
        let energy = evaluate(world, &s.trial, true, false, None);
        report.evaluations += 1;
        let change = (energy - *elastic) + t * linear + 0.5 * t * t * quadratic;
        if change <= ARMIJO * t * slope + rounding || (!resolved && change.is_finite()) {
            std::mem::swap(&mut s.y, &mut s.trial);
            *elastic = energy;
            // the solved system has d.A d = -slope
            let predicted = slope * (t - 0.5 * t * t);
            report.linearisation_error =
                if predicted.abs() > rounding { (change / predicted - 1.0).abs() } else { 0.0 };
            return true;
        }
        report.backtracks += 1;
        t *= 0.5;
    }
    false
}

/// Velocities, energy cap, report, and the new state into the columns.
fn finish<S: Scalar>(
    world: &mut World,
    report: &mut StepReport,
    s: &mut ImplicitScratch<S>,
    h: f64,
    statics: bool,
    newton: bool,
    elastic: f64,
    budget: Option<f64>,
) {
    let n = s.node.len();
    let inverse = S::from_f64(1.0 / h);
    // the step buffer takes the velocities
    for row in 0..n {
        for k in 0..3 {
            s.step[row][k] =
                if statics { S::ZERO } else { (s.y[row][k] - s.node.u[row][k]) * inverse };
        }
    }
    let potential = elastic - s.node.load_potential(&s.y);
    let mut kinetic = s.node.kinetic_energy(&s.step);
    if let (false, Some(budget)) = (statics || newton, budget)
        && kinetic > 0.0
        && kinetic + potential > budget + noise::<S>() * (kinetic + potential.abs())
    {
        let factor = ((budget - potential).max(0.0) / kinetic).sqrt();
        for row in 0..n {
            for k in 0..3 {
                if s.node.free(row, k) {
                    s.step[row][k] *= S::from_f64(factor);
                }
            }
        }
        kinetic = s.node.kinetic_energy(&s.step);
        report.energy_caps += 1;
    }
    report.elastic_energy = elastic;
    report.kinetic_energy = kinetic;
    report.load_work = s.node.load_potential(&s.y) - s.node.load_potential(&s.node.u);
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
