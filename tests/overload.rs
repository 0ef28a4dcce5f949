//! Recovery from inversion leaves bodies alone that loads crush, gives up where constraints keep a body out of
//! shape, begins again when they let go, and its books balance.

use crate::common::*;
use glam::DVec3;
use sinew::models::body::Evaluation;
use sinew::prelude::*;

/// A bar under pressure all round, clamped at one end.
fn pressed(precision: Precision, pressure: f64) -> (Simulation, BodyHandle) {
    let mesh = jittered_box([0.2, 0.04, 0.04], [5, 2, 2]);
    let (mut simulation, body) = simulate(
        options(precision, 1),
        &mesh,
        soft(2e4, 0.4),
        Model::CompressibleStVK,
        Evaluation::Fused,
    );
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(0.01);
    clamp(&mut simulation, body, &mesh, "x0");
    let inward: Vec<_> = mesh.surface_triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    blow(&mut simulation, body, &inward, pressure, Curve::Constant);
    (simulation, body)
}

#[test]
fn crushed_bodies_keep_their_own_law() {
    for precision in [Precision::F64, Precision::F32] {
        for pressure in [1e5, 1e6] {
            let run = |recovery: bool| {
                let (mut simulation, body) = pressed(precision, pressure);
                simulation.set_solver(SolverSettings { recovery, ..Default::default() });
                let (mut refused, mut recovering) = (0, 0);
                for _ in 0..100 {
                    simulation.step().unwrap();
                    let report = simulation.report();
                    refused += report.recoveries_refused;
                    recovering += report.recovering;
                }
                assert!(!recovery || refused > 0, "not crushed");
                assert_eq!(recovering, 0);
                (simulation.report().elastic_energy, simulation.displacements(body))
            };
            let (with, without) = (run(true), run(false));
            assert!(with.0 < 1e3 && with.1 == without.1, "{precision:?} {pressure}: {} J", with.0);
        }
    }
}

/// Squeezed flat between its ends for good the bar cannot come into shape: it gets its own law back. Let go,
/// it recovers after all. What the laws change is booked, and nothing else is made or lost.
#[test]
fn a_body_held_out_of_shape_gets_its_own_law_back() {
    let mesh = jittered_box([0.2, 0.04, 0.04], [5, 2, 2]);
    let material = soft(2e4, 0.4);
    let one = options(Precision::F64, 1);
    let (mut simulation, body) = simulate(one, &mesh, material, Model::StVK, Evaluation::Fused);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(0.01);
    simulation.set_solver(SolverSettings { mass_damping: 7.0, ..Default::default() });
    let held = clamp(&mut simulation, body, &mesh, "x0");
    let rows = simulation.rows(body, "x1", &group(&mesh, "x1")).unwrap();
    let motion = Motion::Translate(DVec3::new(-0.198, 0.0, 0.0));
    let pushed = Constraint::moving("push", rows, motion, Curve::ramp(0.0, 0.3));
    let pushed = simulation.add_constraint(pushed);
    let (mut recovering, mut given_up, mut put_in, mut taken_out) = (0, 0, 0.0, 0.0);
    let (mut last, mut turnover) = (0.0, 0.0_f64);
    let mut step = |simulation: &mut Simulation| {
        simulation.step().unwrap();
        let r = simulation.report();
        recovering += r.recovering;
        given_up += r.recoveries_given_up;
        put_in += r.load_work + r.constraint_work + r.recovery_energy;
        turnover += r.constraint_work.abs() + r.recovery_energy.abs();
        taken_out += r.dissipation;
        last = r.elastic_energy + r.kinetic_energy;
        (recovering, given_up)
    };
    let (mut before, mut ends) = (0, (0, 0));
    for i in 0..400 {
        ends = step(&mut simulation);
        if i == 370 {
            before = ends.0;
        }
    }
    assert!(ends.0 > 0 && ends.1 > 0, "{ends:?}");
    assert_eq!(ends.0, before, "still in recovery");
    for entity in [held, pushed] {
        simulation.world_mut().despawn(entity);
    }
    for _ in 0..400 {
        step(&mut simulation);
    }
    assert!(simulation.volume_report().inverted == 0, "not let go");
    assert!((put_in - taken_out - last).abs() < 1e-9 * turnover, "{put_in} {taken_out} {last}");
}
