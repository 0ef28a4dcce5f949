//! Integrators beside each other: work against error on a swinging beam, what is left of a fast spin, and a bar whose motion
//! is published.

use crate::toolbox::prelude::*;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::engine::report::Fallbacks;

/// The integrators in time.
fn compared() -> impl Iterator<Item = Integrator> {
    let in_time = |i: &Integrator| *i != Integrator::Auto && i.facts().dynamic;
    Integrator::ALL.iter().copied().filter(in_time)
}

/// Errors of a reference program (numpy, direct solves, another jitter of the same mesh family).
fn swing_elsewhere(integrator: Integrator, milliseconds: f64) -> Option<[f64; 2]> {
    let row: &[[f64; 3]] = match integrator {
        Integrator::Safe => &[
            [20.0, 1.5e-1, 1.2e-1],
            [10.0, 5.4e-2, 6.0e-2],
            [5.0, 2.8e-2, 3.3e-2],
            [2.5, 1.6e-2, 1.9e-2],
            [1.25, 8.5e-3, 1.1e-2],
        ],
        Integrator::LinearisedBdf2 => &[
            [20.0, 4.6e-2, 7.8e-2],
            [10.0, 1.3e-2, 2.8e-2],
            [5.0, 3.8e-3, 9.6e-3],
            [2.5, 9.9e-4, 2.0e-3],
        ],
        Integrator::Newton => &[
            [20.0, 8.1e-2, 9.6e-2],
            [10.0, 4.4e-2, 5.5e-2],
            [5.0, 2.6e-2, 3.3e-2],
            [2.5, 1.5e-2, 1.9e-2],
            [1.25, 8.5e-3, 1.1e-2],
        ],
        Integrator::Bdf2 => &[
            [20.0, 3.7e-2, 6.1e-2],
            [10.0, 1.3e-2, 2.7e-2],
            [5.0, 3.8e-3, 9.5e-3],
            [2.5, 9.9e-4, 2.0e-3],
            [1.25, 2.7e-4, 5.8e-4],
        ],
        Integrator::TrBdf2 => &[
            [20.0, 5.9e-3, 1.7e-2],
            [10.0, 1.7e-3, 4.4e-3],
            [5.0, 4.9e-4, 1.1e-3],
            [2.5, 1.5e-4, 3.6e-4],
            [1.25, 3.7e-5, 9.5e-5],
        ],
        Integrator::ImplicitMidpoint => &[
            [20.0, 9.8e-3, 3.3e-2],
            [10.0, 2.9e-3, 1.3e-2],
            [5.0, 8.2e-4, 2.0e-3],
            [2.5, 3.3e-4, 6.9e-4],
            [1.25, 7.5e-5, 2.0e-4],
        ],
        _ => &[],
    };
    row.iter().find(|r| r[0] == milliseconds).map(|r| [r[1], r[2]])
}

/// Percentages of the same program: angular momentum kept, change of energy.
pub(crate) fn spin_elsewhere(integrator: Integrator, column: usize) -> Option<[f64; 2]> {
    let row: [[f64; 2]; 4] = match integrator {
        Integrator::Safe => [[94.2, -16.4], [65.7, -61.0], [8.7, -99.2], [3.8, -99.8]],
        Integrator::Newton => [[94.2, -16.4], [66.5, -60.0], [24.1, -94.2], [18.6, -96.5]],
        Integrator::LinearisedBdf2 => [[99.9, -0.3], [98.6, -7.0], [32.2, -89.8], [10.0, -99.0]],
        Integrator::Bdf2 => [[100.0, 0.0], [98.6, -7.0], [58.8, -68.4], [43.5, -82.0]],
        Integrator::TrBdf2 => [[100.0, 0.0], [99.9, -0.4], [81.1, -40.9], [63.2, -60.5]],
        Integrator::ImplicitMidpoint => {
            [[100.0, 0.0], [100.0, 0.3], [100.0, 440.6], [100.0, 2479.0]]
        }
        _ => return None,
    };
    row.get(column).copied()
}

fn body(mesh: &Mesh, young_modulus: f64, poisson_ratio: f64) -> Result<(Simulation, BodyHandle)> {
    let mut simulation = Simulation::new(SimulationOptions { threads: 1, ..Default::default() })?;
    let material = YoungPoisson { young_modulus, poisson_ratio, density: 1000.0 };
    let body = simulation.add_body(&BodyDescription::new("body", mesh, material))?;
    Ok((simulation, body))
}

/// The same linear tolerance for all: errors are the integrators'.
fn settings(integrator: Integrator) -> SolverSettings {
    SolverSettings {
        integrator,
        linear_tolerance: 1e-6,
        newton_tolerance: 1e-8,
        ..Default::default()
    }
}

struct IntegratorSwing {
    displacements: [Vec<DVec3>; 2],
    solves: u64,
    fallbacks: u64,
    milliseconds: f64,
}

/// A beam held at one end that falls under its weight, at 0.2 and 0.4 s.
fn swing(mesh: &Mesh, integrator: Integrator, dt: f64) -> Result<IntegratorSwing> {
    let (mut simulation, body) = body(mesh, 3e4, 0.4)?;
    let rows = simulation.group_rows(body, mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    simulation.set_dt(dt);
    simulation.set_solver(settings(integrator));
    let steps = (0.2 / dt).round() as usize;
    let mut swing = IntegratorSwing {
        displacements: [Vec::new(), Vec::new()],
        solves: 0,
        fallbacks: 0,
        milliseconds: 0.0,
    };
    for half in 0..2 {
        for _ in 0..steps {
            let clock = Instant::now();
            simulation.step()?;
            swing.milliseconds += 1e3 * clock.elapsed().as_secs_f64();
            let report = simulation.report();
            swing.solves += u64::from(report.newton_iterations);
            swing.fallbacks += u64::from(report.fallbacks != Fallbacks::default());
        }
        swing.displacements[half] = simulation.displacements(body);
    }
    Ok(swing)
}

/// A free cube at 100 rad/s for 0.1 s.
fn spin(mesh: &Mesh, integrator: Integrator, dt: f64) -> Result<[f64; 2]> {
    let (mut simulation, body) = body(mesh, 1e5, 0.3)?;
    let masses = simulation.masses(body);
    let mass: f64 = masses.iter().sum();
    let centre = mesh.points.iter().zip(&masses).map(|(x, m)| *x * *m).sum::<DVec3>() / mass;
    let velocities: Vec<DVec3> =
        mesh.points.iter().map(|x| DVec3::new(0.0, 0.0, 100.0).cross(*x - centre)).collect();
    let angular: f64 =
        (0..masses.len()).map(|i| mesh.points[i].cross(velocities[i]).z * masses[i]).sum();
    let energy: f64 =
        (0..masses.len()).map(|i| 0.5 * masses[i] * velocities[i].length_squared()).sum();
    simulation.set_state(body, &vec![DVec3::ZERO; masses.len()], &velocities)?;
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(dt);
    simulation.set_solver(settings(integrator));
    for _ in 0..(0.1 / dt).round() as usize {
        simulation.step()?;
    }
    let report = simulation.report();
    let now = report.kinetic_energy + report.elastic_energy;
    Ok([100.0 * report.angular_momentum[2] / angular, 100.0 * (now / energy - 1.0)])
}

/// Runs all.
///
/// # Errors
/// When the beam cannot be set up or stepped.
pub fn run(quick: bool, tell: &mut impl FnMut(&str)) -> Result<Vec<Table>> {
    let beam = jitter_interior(&box_tets(DVec3::new(0.3, 0.1, 0.1), [6, 2, 2])?, 0.15, 1)?;
    tell("integrators: reference motion");
    let fine = if quick { 1e-4 } else { 1e-5 };
    let truth = swing(&beam, Integrator::StormerVerlet, fine)?.displacements;
    let size: Vec<f64> =
        truth.iter().map(|u| u.iter().map(|u| u.length()).fold(0.0, f64::max)).collect();
    let mut swings = Vec::new();
    for integrator in compared() {
        tell(&format!("integrators: swinging beam, {}", integrator.name()));
        let steps: &[f64] = match (integrator.is_explicit(), quick) {
            (true, _) => &[1.0, 0.5, 0.25],
            (false, true) => &[10.0, 5.0],
            (false, false) => &[20.0, 10.0, 5.0, 2.5, 1.25],
        };
        for &milliseconds in steps {
            let found = swing(&beam, integrator, 1e-3 * milliseconds)?;
            let error = |i: usize| {
                let pairs = found.displacements[i].iter().zip(&truth[i]);
                pairs.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / size[i]
            };
            swings.push((integrator, milliseconds, [error(0), error(1)], found));
        }
    }
    let cube = jitter_interior(&box_tets(DVec3::splat(0.1), [3, 3, 3])?, 0.15, 3)?;
    let mut spins = Vec::new();
    for integrator in compared() {
        tell(&format!("integrators: spin, {}", integrator.name()));
        for (column, dt) in [1e-4, 1e-3, 1e-2, 1.0 / 60.0].into_iter().enumerate() {
            if quick && column == 0 {
                continue;
            }
            let (found, failure) = match spin(&cube, integrator, dt) {
                Ok(found) => (found, None),
                Err(error) => ([f64::NAN; 2], Some(error.to_string())),
            };
            spins.push((integrator, 1e3 * dt, found, spin_elsewhere(integrator, column), failure));
        }
    }
    let at = |pair: Option<[f64; 2]>, i: usize, factor: f64| pair.map(|p| factor * p[i]);
    let title = "Integrators: work against error";
    let swings = table_of!("integrators-swing", title; for (integrator, ms, errors, found) in &swings;
        where { let elsewhere = swing_elsewhere(*integrator, *ms); }
        "integrator" => integrator.name(), "dt ms" => *ms, "error % at 0.2 s" => 100.0 * errors[0],
        "at 0.4 s" => 100.0 * errors[1], "elsewhere % at 0.2 s" => at(elsewhere, 0, 100.0),
        "at 0.4 s" => at(elsewhere, 1, 100.0), "linear systems" => found.solves,
        "safe steps" => found.fallbacks, "wall ms" => found.milliseconds,
    )
    .note(
        "A beam of 144 tetrahedra (30 kPa, nu 0.4), held at one end, falls for 0.4 s. Largest error \
         over largest displacement against finely stepped Störmer-Verlet. elsewhere: a reference \
         program with direct solves on a beam of the same kind. safe steps: those that BDF2 \
         left to implicit Euler, linearised to the safe step, its first one included.",
    );
    let title = "Integrators: what is left of a fast spin";
    let spins = table_of!("integrators-spin", title; for (integrator, ms, found, elsewhere, failure) in spins;
        "integrator" => integrator.name(), "dt ms" => ms, "angular momentum %" => found[0],
        "change of energy %" => found[1], "elsewhere %" => at(elsewhere, 0, 1.0),
        "energy %" => at(elsewhere, 1, 1.0), "failure" => failure,
    )
    .note(
        "A free cube of 162 tetrahedra (100 kPa, nu 0.3) spins at 100 rad/s for 0.1 s: angular \
         momentum kept and change of energy; elsewhere as above.",
    );
    // the default is linearised BDF2 there, and Newton's method loses what the safe step does
    let implicit = [
        Integrator::Auto,
        Integrator::Safe,
        Integrator::Bdf2,
        Integrator::TrBdf2,
        Integrator::LinearisedTrBdf2,
        Integrator::ImplicitMidpoint,
    ];
    let mut tables = vec![swings, spins];
    tables.extend(super::bar::run(&implicit, quick, tell)?);
    Ok(tables)
}
