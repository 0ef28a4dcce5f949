//! Conservation laws, closed forms, orders of convergence and equilibria of whole bodies.

use crate::common::*;
use bevy_ecs::prelude::Entity;
use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{BlockMatrix, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::vertex::FixedAxes;
use sinew::models::body::Evaluation;
use sinew::prelude::*;

const MODELS: [Model; 2] = [Model::StVK, Model::CompressibleStVK];
const BOTH: [Evaluation; 2] = [Evaluation::Fused, Evaluation::Pooled];

/// Linear systems solved to rounding, so that what is left is the integrator's.
fn exact(integrator: Integrator) -> SolverSettings {
    solver!(integrator, linear_tolerance = 1e-13, newton_tolerance = 1e-12)
}

fn sum(values: impl Iterator<Item = DVec3>) -> DVec3 {
    values.fold(DVec3::ZERO, |a, b| a + b)
}

fn positions(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) -> Vec<DVec3> {
    simulation.displacements(body).iter().zip(&mesh.points).map(|(u, x)| *x + *u).collect()
}

fn momentum(simulation: &mut Simulation, body: BodyHandle) -> DVec3 {
    let m = simulation.masses(body);
    sum(simulation.velocities(body).iter().zip(&m).map(|(v, m)| *v * *m))
}

fn centre(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) -> DVec3 {
    let m = simulation.masses(body);
    let x = positions(simulation, body, mesh);
    sum(x.iter().zip(&m).map(|(x, m)| *x * *m)) / m.iter().sum::<f64>()
}

#[test]
fn elastic_forces_have_no_resultant() {
    let mesh = jittered_box([0.2, 0.1, 0.1], [6, 3, 3]);
    let cell = 0.2 / 6.0;
    for model in MODELS {
        for evaluation in BOTH {
            for amplitude in [1e-6, 1e-2, 0.3] {
                let (mut simulation, body) = plain(&mesh, soft(1e4, 0.45), model, evaluation);
                disturb(&mut simulation, body, amplitude * cell, 3);
                simulation.evaluate();
                let f = simulation.elastic_forces(body);
                let x = positions(&mut simulation, body, &mesh);
                let size: f64 = f.iter().map(|f| f.length()).sum();
                let lever: f64 = f.iter().zip(&x).map(|(f, x)| f.length() * x.length()).sum();
                assert!(size > 0.0);
                let force = sum(f.iter().copied()).length() / size;
                let torque = sum(f.iter().zip(&x).map(|(f, x)| x.cross(*f))).length() / lever;
                // a torque comes from the symmetry of the stress, which rounds with the strain
                assert!(force < 1e-12, "{model:?} {evaluation:?} {amplitude}: force {force:e}");
                assert!(torque < 1e-12, "{model:?} {evaluation:?} {amplitude}: torque {torque:e}");
            }
        }
    }
}

const FLIGHT: [Integrator; 9] = [
    Integrator::Safe,
    Integrator::LinearisedBdf2,
    Integrator::Newton,
    Integrator::Bdf2,
    Integrator::TrBdf2,
    Integrator::LinearisedTrBdf2,
    Integrator::ImplicitMidpoint,
    Integrator::SymplecticEuler,
    Integrator::StormerVerlet,
];

/// Makes a body tremble and spin without loads.
fn let_fly(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) {
    let n = mesh.points.len();
    let start: Vec<_> = random_field(n, 5)
        .iter()
        .zip(&mesh.points)
        .map(|(r, x)| *r * 0.05 + DVec3::Z.cross(*x) * 3.0 + DVec3::new(0.5, -0.2, 0.3))
        .collect();
    let u: Vec<_> = random_field(n, 6).iter().map(|r| *r * 2e-3).collect();
    simulation.set_state(body, &u, &start).unwrap();
    simulation.set_gravity(DVec3::ZERO);
}

#[test]
fn free_flight_keeps_momentum() {
    let mesh = jittered_box([0.2, 0.1, 0.1], [6, 3, 3]);
    let n = mesh.points.len();
    for integrator in FLIGHT {
        let (mut simulation, body) = fused(&mesh, soft(1e4, 0.4));
        let_fly(&mut simulation, body, &mesh);
        simulation.set_solver(exact(integrator));
        let before = momentum(&mut simulation, body);
        let x0 = centre(&mut simulation, body, &mesh);
        let mass: f64 = simulation.masses(body).iter().sum();
        let mut caps = 0;
        for step in 1..=50 {
            simulation.step().unwrap();
            caps += simulation.report().energy_caps;
            let p = momentum(&mut simulation, body);
            let error = p.distance(before) / before.length();
            assert!(error < 1e-10, "{integrator:?} step {step}: {error:e}");
            let reported = DVec3::from_array(simulation.report().momentum);
            assert!(reported.distance(p) < 1e-12 * p.length(), "{integrator:?}");
            let (v, y) = (simulation.velocities(body), positions(&mut simulation, body, &mesh));
            let m = simulation.masses(body);
            let l = sum((0..n).map(|i| y[i].cross(v[i]) * m[i]));
            let reported = DVec3::from_array(simulation.report().angular_momentum);
            assert!(reported.distance(l) < 1e-12 * l.length(), "{integrator:?}");
            let expected = x0 + before / mass * simulation.time();
            let error = centre(&mut simulation, body, &mesh).distance(expected) / 0.2;
            assert!(error < 1e-10, "{integrator:?} step {step}: centre off by {error:e}");
        }
        assert_eq!(caps, 0, "{integrator:?}: a capped velocity does not keep momentum");
    }
}

/// The linear systems of a default step are solved to 1e-3 only; the resultant of their residual is
/// taken out of the step of a free body.
#[test]
fn free_flight_with_default_tolerance() {
    let mesh = jittered_box([0.2, 0.1, 0.1], [6, 3, 3]);
    let (mut simulation, body) = fused(&mesh, soft(1e4, 0.4));
    let_fly(&mut simulation, body, &mesh);
    let before = momentum(&mut simulation, body);
    simulation.steps(50);
    let error = momentum(&mut simulation, body).distance(before) / before.length();
    assert!(error < 1e-12, "{error:e}");
}

#[test]
fn free_fall_follows_the_integrators_closed_form() {
    let mesh = jittered_box([0.2, 0.1, 0.1], [4, 2, 2]);
    let (g, h) = (9.81, 0.02);
    for integrator in FLIGHT {
        let (mut simulation, body) = fused(&mesh, soft(1e4, 0.4));
        simulation.set_gravity(DVec3::NEG_Z * g);
        simulation.set_dt(h);
        // without deformation the systems are solved by the warm start, at any tolerance
        simulation.set_solver(SolverSettings { integrator, ..exact(integrator) });
        let z0 = centre(&mut simulation, body, &mesh);
        for n in 1..=40 {
            simulation.step().unwrap();
            let n = f64::from(n);
            let fallen = match integrator {
                Integrator::StormerVerlet
                | Integrator::TrBdf2
                | Integrator::LinearisedTrBdf2
                | Integrator::ImplicitMidpoint => 0.5 * g * (n * h) * (n * h),
                // the error of the first step, by implicit Euler, tends to 3/2 of itself
                Integrator::Bdf2 | Integrator::LinearisedBdf2 => {
                    0.5 * g * h * h * (n * n + 1.5 * (1.0 - (1.0 / 3.0_f64).powf(n)))
                }
                Integrator::SymplecticEuler => {
                    let k = f64::from(simulation.report().substeps);
                    let (h, n) = (h / k, n * k);
                    0.5 * g * h * h * n * (n + 1.0)
                }
                _ => 0.5 * g * h * h * n * (n + 1.0),
            };
            let expected = z0 - DVec3::Z * fallen;
            let error = centre(&mut simulation, body, &mesh).distance(expected) / fallen;
            assert!(error < 1e-10, "{integrator:?} step {n}: {error:e}");
        }
        // and the body stays as it is
        let energy = simulation.evaluate();
        assert!(energy < 1e-12, "{integrator:?}: {energy:e} J");
    }
}

/// 100 rad/s for 0.1 s, about 1.6 turns.
#[test]
fn verlet_keeps_angular_momentum() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [3, 3, 3]);
    let (mut simulation, body) = fused(&mesh, soft(1e5, 0.3));
    let axis = DVec3::new(0.0, 0.0, 100.0);
    let c = centre(&mut simulation, body, &mesh);
    let v: Vec<_> = mesh.points.iter().map(|x| axis.cross(*x - c)).collect();
    simulation.set_state(body, &vec![DVec3::ZERO; v.len()], &v).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(1e-4);
    simulation.integrate_by(Integrator::StormerVerlet);
    let angular = |s: &mut Simulation| {
        let (m, v) = (s.masses(body), s.velocities(body));
        let x = positions(s, body, &mesh);
        sum((0..m.len()).map(|i| x[i].cross(v[i]) * m[i]))
    };
    let before = angular(&mut simulation);
    simulation.steps(1000);
    let error = angular(&mut simulation).distance(before) / before.length();
    assert!(error < 1e-12, "{error:e}");
    let u = max_length(&simulation.displacements(body));
    assert!(u > 0.05, "the body turned: {u}");
}

/// A beam that swings under its weight for 0.1 s.
fn swing(mesh: &Mesh, integrator: Integrator, steps: u32) -> Vec<DVec3> {
    let (mut simulation, body) = fused(mesh, soft(3e4, 0.4));
    clamp(&mut simulation, body, mesh, "x0");
    simulation.set_dt(0.1 / f64::from(steps));
    simulation.set_solver(SolverSettings { linear_tolerance: 1e-10, ..exact(integrator) });
    for _ in 0..steps {
        simulation.step().unwrap();
        let report = simulation.report();
        assert!(report.substeps <= 1 && !report.unconverged && report.energy_caps == 0);
    }
    simulation.displacements(body)
}

/// Errors relative to the largest displacement for each number of steps.
fn errors(integrator: Integrator, steps: &[u32]) -> Vec<f64> {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    // its own error is 1/64 of the smallest measured one of order 2
    let truth = swing(&mesh, Integrator::StormerVerlet, 3200);
    let size = max_length(&truth);
    steps.iter().map(|&n| max_distance(&swing(&mesh, integrator, n), &truth) / size).collect()
}

#[test]
fn verlet_is_of_second_order() {
    let e = errors(Integrator::StormerVerlet, &[100, 200, 400]);
    for (coarse, fine) in [(e[0], e[1]), (e[1], e[2])] {
        assert!((3.7..4.3).contains(&(coarse / fine)), "{e:?}");
    }
}

#[test]
fn bdf2_tr_bdf2_and_midpoint_are_of_second_order() {
    for integrator in [
        Integrator::LinearisedBdf2,
        Integrator::Bdf2,
        Integrator::TrBdf2,
        Integrator::LinearisedTrBdf2,
        Integrator::ImplicitMidpoint,
    ] {
        let e = errors(integrator, &[50, 100, 200]);
        for (coarse, fine) in [(e[0], e[1]), (e[1], e[2])] {
            assert!((3.3..4.7).contains(&(coarse / fine)), "{integrator:?}: {e:?}");
        }
    }
}

#[test]
fn implicit_and_symplectic_euler_are_of_first_order() {
    for integrator in [Integrator::Safe, Integrator::Newton, Integrator::SymplecticEuler] {
        let e = errors(integrator, &[200, 400, 800]);
        for (coarse, fine) in [(e[0], e[1]), (e[1], e[2])] {
            assert!((1.75..2.25).contains(&(coarse / fine)), "{integrator:?}: {e:?}");
        }
    }
}

/// Elements turned inside out, one side jerked about, loads, large steps: what Safe promises.
#[test]
fn energy_never_rises_with_safe() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [4, 4, 4]);
    let n = mesh.points.len();
    for (nu, dt) in [(0.3, 1.0 / 60.0), (0.45, 0.1), (0.49, 1e-3)] {
        for moving in [false, true] {
            let (mut simulation, body) = fused(&mesh, soft(1e4, nu));
            let u: Vec<_> = random_field(n, 11).iter().map(|r| *r * 0.03).collect();
            let v: Vec<_> = random_field(n, 12).iter().map(|r| *r * 3.0).collect();
            simulation.set_state(body, &u, &v).unwrap();
            let rows = simulation.rows(body, "x0", &group(&mesh, "x0")).unwrap();
            let motion = Motion::Translate(DVec3::new(0.05, -0.03, 0.1));
            let curve = Curve::Sine { frequency: 0.1 / dt, phase: 0.0 };
            simulation.add_constraint(if moving {
                Constraint::moving("x0", rows, motion, curve)
            } else {
                Constraint::hold("x0", rows)
            });
            let tip = simulation.rows(body, "x1", &group(&mesh, "x1")).unwrap();
            let forces = tip.iter().map(|&r| (r, DVec3::new(0.0, 0.1, 0.2))).collect();
            simulation.add_load(Load { name: "tip".into(), forces, curve: Curve::Constant });
            simulation.set_dt(dt);
            simulation.integrate_by(Integrator::Safe);

            let held = group(&mesh, "x0");
            let masses = simulation.masses(body);
            let kinetic: f64 = (0..n)
                .filter(|i| !held.contains(&(*i as u32)))
                .map(|i| 0.5 * masses[i] * v[i].length_squared())
                .sum();
            let start = kinetic + simulation.evaluate();
            let (mut work, mut highest, mut inverted) = (0.0, start, 0);
            for step in 0..60 {
                simulation.step().unwrap();
                let r = simulation.report();
                // what a change of laws adds is booked by itself: held vertices keep the body out of shape
                work += r.load_work + r.constraint_work + r.recovery_energy;
                let total = r.elastic_energy + r.kinetic_energy - work;
                let scale = start + r.elastic_energy + r.kinetic_energy;
                let rise = (total - highest) / scale;
                assert!(rise < 1e-9, "nu {nu} dt {dt} moving {moving} step {step}: rose {rise:e}");
                highest = total;
                inverted = inverted.max(simulation.volume_report().inverted);
            }
            assert!(inverted > 0, "nu {nu}: not violent enough");
        }
    }
}

/// What damping takes is booked as damping; the rest is small for methods of second order, and large
/// for implicit Euler.
#[test]
fn energy_balance_tells_damping_from_the_integrators_own_dissipation() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    for (integrator, own) in [
        (Integrator::LinearisedBdf2, 0.02),
        (Integrator::Bdf2, 0.02),
        (Integrator::TrBdf2, 0.02),
        (Integrator::LinearisedTrBdf2, 0.02),
        (Integrator::ImplicitMidpoint, 0.02),
        (Integrator::StormerVerlet, 0.02),
        (Integrator::Safe, 0.2),
    ] {
        for (mass_damping, stiffness_damping) in [(2.0, 0.0), (0.0, 5e-3)] {
            if integrator.is_explicit() && stiffness_damping > 0.0 {
                continue;
            }
            let (mut simulation, body) = fused(&mesh, soft(3e4, 0.4));
            clamp(&mut simulation, body, &mesh, "x0");
            simulation.set_dt(5e-4);
            simulation.set_solver(SolverSettings {
                mass_damping,
                stiffness_damping,
                linear_tolerance: 1e-8,
                ..exact(integrator)
            });
            let (mut work, mut damping, mut lost) = (0.0, 0.0, 0.0);
            for _ in 0..200 {
                simulation.step().unwrap();
                let report = simulation.report();
                work += report.load_work;
                damping += report.damping_dissipation;
                lost += report.dissipation;
            }
            let report = simulation.report();
            let left = report.kinetic_energy + report.elastic_energy;
            assert!((work - lost - left).abs() < 1e-9 * work, "{integrator:?}: books do not close");
            let share = (lost - damping) / lost;
            assert!(damping > 0.0 && share.abs() < own, "{integrator:?}: {damping} of {lost}");
        }
    }
}

/// Lifting a clamp works against the weight of the vertices it holds.
#[test]
fn constraint_work_includes_the_weight_of_what_is_held() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [2, 2, 2]);
    for integrator in [Integrator::Safe, Integrator::Newton, Integrator::StormerVerlet] {
        let (mut simulation, body) = fused(&mesh, soft(1e4, 0.3));
        let all: Vec<u32> = (0..mesh.points.len() as u32).collect();
        let rows = simulation.rows(body, "all", &all).unwrap();
        let lift = Motion::Translate(DVec3::Z);
        simulation.add_constraint(Constraint::moving("all", rows, lift, Curve::ramp(0.0, 1.0)));
        simulation.set_dt(0.1);
        simulation.integrate_by(integrator);
        let mass: f64 = simulation.masses(body).iter().sum();
        let (mut load, mut constraint) = (0.0, 0.0);
        for _ in 0..10 {
            simulation.step().unwrap();
            load += simulation.report().load_work;
            constraint += simulation.report().constraint_work;
        }
        // rounding of 1e-16 in a displacement of 1 m against 1 m of way
        assert!((load / (-9.81 * mass) - 1.0).abs() < 1e-12, "{integrator:?}: {load}");
        // and what is lifted moves at 1 m/s
        let expected = (9.81 + 0.5) * mass;
        assert!((constraint / expected - 1.0).abs() < 1e-9, "{integrator:?}: {constraint}");
    }
}

fn tangent(simulation: &mut Simulation, kind: TangentKind) -> BlockMatrix<f64> {
    let world = simulation.world_mut();
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent: Some(kind) });
    world.run_schedule(ForceSchedule);
    world.resource::<Tangent<f64>>().matrix.clone()
}

#[test]
fn fused_equals_pooled() {
    let mesh = jittered_box([0.2, 0.1, 0.1], [6, 3, 3]);
    let n = mesh.points.len();
    let u: Vec<_> = random_field(n, 21).iter().map(|r| *r * (0.3 * 0.2 / 6.0)).collect();
    for model in MODELS {
        let [mut a, mut b] = BOTH.map(|evaluation| {
            let (mut simulation, body) = plain(&mesh, soft(1e4, 0.45), model, evaluation);
            simulation.displace(body, &u);
            simulation
        });
        let (wa, wb) = (a.evaluate(), b.evaluate());
        // sums of about a hundred terms of either sign, in another order
        assert!(((wa - wb) / wa).abs() < 1e-12, "{model:?}: energies {wa} {wb}");
        let (fa, fb) = (a.elastic_forces(BodyHandle(0)), b.elastic_forces(BodyHandle(0)));
        let error = max_distance(&fa, &fb) / max_length(&fa);
        assert!(error < 1e-12, "{model:?}: forces {error:e}");
        for kind in [TangentKind::Exact, TangentKind::GaussNewton, TangentKind::Projected] {
            let (ka, kb) = (tangent(&mut a, kind), tangent(&mut b, kind));
            let entries = |k: &BlockMatrix<f64>| -> Vec<f64> {
                k.diagonal.iter().chain(&k.off_diagonal).flatten().copied().collect()
            };
            let (ka, kb) = (entries(&ka), entries(&kb));
            let largest = ka.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            let error = ka.iter().zip(&kb).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
            assert!(error < 1e-12 * largest, "{model:?} {kind:?}: {:e}", error / largest);
        }
    }
}

/// A beam held at one end, with a settled solver.
fn sagging(mesh: &Mesh, settings: SolverSettings) -> (Simulation, BodyHandle, Entity) {
    let (mut simulation, body) = fused(mesh, soft(3e4, 0.4));
    let held = clamp(&mut simulation, body, mesh, "x0");
    simulation.set_solver(settings);
    (simulation, body, held)
}

#[test]
fn quasi_static_is_where_damped_motion_ends() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    let (mut still, body, _) = sagging(&mesh, exact(Integrator::QuasiStatic));
    still.step().unwrap();
    assert!(!still.report().unconverged);
    let expected = still.displacements(body);
    for integrator in [Integrator::Safe, Integrator::Newton, Integrator::StormerVerlet] {
        let settings = SolverSettings { integrator, mass_damping: 20.0, ..Default::default() };
        let (mut simulation, body, _) = sagging(&mesh, settings);
        simulation.set_dt(0.02);
        // 3 s: the slowest mode has died away by more than 1e-10
        simulation.steps(150);
        let u = simulation.displacements(body);
        let error = max_distance(&u, &expected) / max_length(&expected);
        assert!(error < 1e-8, "{integrator:?}: {error:e}");
    }
}

#[test]
fn reactions_balance_the_weight() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    for both_ends in [false, true] {
        let (mut simulation, body, left) = sagging(&mesh, exact(Integrator::QuasiStatic));
        let right = both_ends.then(|| clamp(&mut simulation, body, &mesh, "x1"));
        simulation.step().unwrap();
        let mass: f64 = simulation.masses(body).iter().sum();
        assert!((mass / (0.2 * 0.05 * 0.05 * 1000.0) - 1.0).abs() < 1e-12);
        let mut reaction = simulation.reaction(left).unwrap();
        if let Some(right) = right {
            let other = simulation.reaction(right).unwrap();
            assert!(other.z > 0.4 * 9.81 * mass, "each end bears about a half: {other}");
            reaction += other;
        }
        let error = (reaction - DVec3::Z * 9.81 * mass).length() / (9.81 * mass);
        assert!(error < 1e-8, "{error:e}");
    }
}

/// What is gone has no reaction, and what does not act has none but zero: neither is the force that the vertices happen to have.
#[test]
fn what_is_gone_has_no_reaction() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    let (mut simulation, body, left) = sagging(&mesh, exact(Integrator::Safe));
    let end = simulation.group_rows(body, &mesh, "x1").unwrap();
    let until = 2.5 * simulation.world().resource::<StepClock>().dt;
    let right = Constraint { until, ..Constraint::hold("right", end) };
    let right = simulation.add_constraint(right);
    simulation.steps(2);
    assert!(simulation.reaction(right).unwrap().length() > 0.0);
    simulation.steps(2);
    assert_eq!(simulation.reaction(right), Some(DVec3::ZERO));
    assert!(simulation.reaction(left).unwrap().length() > 0.0);
    simulation.remove_load_or_constraint(left);
    assert_eq!(
        (simulation.reaction(left), simulation.reaction_about(left, DVec3::X)),
        (None, None)
    );
    let tool = simulation.add_tool(Tool::new("ball", Shape::Sphere { radius: 0.01 }, DVec3::Z));
    assert_eq!(simulation.reaction(tool.unwrap()), None);
}

/// Whatever was called before, reactions and elastic forces are those of the state as it is.
#[test]
fn reactions_are_never_of_an_earlier_state() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    let (mut simulation, body, left) = sagging(&mesh, exact(Integrator::Safe));
    let now = |simulation: &mut Simulation| {
        let (reaction, forces) =
            (simulation.reaction(left).unwrap(), simulation.elastic_forces(body));
        simulation.evaluate();
        assert_eq!(
            (simulation.reaction(left).unwrap(), simulation.elastic_forces(body)),
            (reaction, forces)
        );
        reaction
    };
    let mut all = vec![now(&mut simulation)];
    for _ in 0..3 {
        simulation.step().unwrap();
        simulation.positions(body);
        all.push(now(&mut simulation));
    }
    let still = vec![DVec3::ZERO; mesh.points.len()];
    simulation.set_state(body, &still, &still).unwrap();
    let back = now(&mut simulation);
    simulation.set_material(body, soft(1e6, 0.3)).unwrap();
    assert_eq!(now(&mut simulation), back);
    assert!(all.windows(2).all(|pair| pair[0] != pair[1]), "{all:?}");
}

#[test]
fn prescribed_motion_is_reached_exactly() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    let integrators = [
        Integrator::Safe,
        Integrator::Newton,
        Integrator::QuasiStatic,
        Integrator::SymplecticEuler,
        Integrator::StormerVerlet,
    ];
    let side = group(&mesh, "x1");
    let each = random_field(side.len(), 4).iter().map(|r| *r * 0.01).collect::<Vec<_>>();
    let way = DVec3::new(0.02, -0.01, 0.03);
    let (centre, axis) = (DVec3::new(0.2, 0.025, 0.025), DVec3::new(2.0, 0.0, 0.0));
    for integrator in integrators {
        for case in 0..4 {
            let (mut simulation, body, _) =
                sagging(&mesh, SolverSettings { integrator, ..Default::default() });
            let rows = simulation.rows(body, "x1", &side).unwrap();
            let motion = match case {
                0 | 3 => Motion::Translate(way),
                1 => Motion::TranslateEach(each.clone()),
                _ => Motion::Rotate { centre, axis, angle: 0.5 },
            };
            let mut constraint = Constraint::moving("x1", rows, motion, Curve::ramp(0.0, 0.04));
            if case == 3 {
                constraint.axes = FixedAxes(1);
            }
            simulation.add_constraint(constraint);
            for _ in 0..5 {
                simulation.step().unwrap();
                let factor = Curve::ramp(0.0, 0.04).value(simulation.time());
                let u = simulation.displacements(body);
                for (i, &vertex) in side.iter().enumerate() {
                    let x = mesh.points[vertex as usize];
                    let expected = match case {
                        0 | 3 => way * factor,
                        1 => each[i] * factor,
                        _ => {
                            let turn = DQuat::from_axis_angle(DVec3::X, 0.5 * factor);
                            centre + turn * (x - centre) - x
                        }
                    };
                    let mut error = u[vertex as usize] - expected;
                    if case == 3 {
                        assert!(error.z != 0.0, "{integrator:?}: free axes move by themselves");
                        error = DVec3::X * error.x;
                    }
                    // the test rounds as the engine does but for the time, which adds up
                    assert!(error.length() < 1e-16, "{integrator:?} case {case}: {error}");
                }
            }
        }
    }
}

#[test]
fn constraints_begin_and_end() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    for integrator in [Integrator::Safe, Integrator::Newton, Integrator::StormerVerlet] {
        let (mut simulation, body, _) =
            sagging(&mesh, SolverSettings { integrator, ..Default::default() });
        let rows = simulation.rows(body, "x1", &group(&mesh, "x1")).unwrap();
        let mut hold = Constraint::hold("x1", rows);
        (hold.from, hold.until) = (0.045, 0.085);
        simulation.add_constraint(hold);
        let tip = group(&mesh, "x1")[0] as usize;
        let mut heights = vec![0.0];
        for _ in 0..12 {
            simulation.step().unwrap();
            heights.push(simulation.displacements(body)[tip].z);
        }
        for step in 1..=12 {
            let held = (5..=8).contains(&step);
            let moved = heights[step] != heights[step - 1];
            assert_eq!(moved, !held, "{integrator:?} step {step}: {heights:?}");
        }
        assert!(heights[4] < 0.0 && heights[12] < heights[8], "it goes on falling");

        // despawning the entity releases too
        let entity = clamp(&mut simulation, body, &mesh, "x1");
        simulation.step().unwrap();
        let held = simulation.displacements(body)[tip];
        simulation.step().unwrap();
        assert_eq!(simulation.displacements(body)[tip], held);
        simulation.world_mut().despawn(entity);
        simulation.step().unwrap();
        assert_ne!(simulation.displacements(body)[tip], held, "{integrator:?}");
    }
}

#[test]
fn curves_and_loads() {
    let curve = Curve::Points(vec![[0.0, 0.0], [1.0, 2.0], [1.0, 4.0], [3.0, 0.0]]);
    for (t, value) in [(-1.0, 0.0), (0.25, 0.5), (1.0, 4.0), (2.0, 2.0), (3.0, 0.0), (9.0, 0.0)] {
        assert_eq!(curve.value(t), value, "at {t}");
    }
    assert_eq!(Curve::Points(Vec::new()).value(3.0), 1.0);
    assert_eq!(Curve::Points(vec![[2.0, 7.0]]).value(0.0), 7.0);
    assert_eq!(Curve::Constant.value(1e9), 1.0);
    let sine = Curve::Sine { frequency: 2.0, phase: 0.5 };
    assert!((sine.value(0.1) - (0.4 * std::f64::consts::PI + 0.5).sin()).abs() < 1e-15);

    // loads add up and follow their curves at the end of the step
    let mesh = jittered_box([0.1, 0.1, 0.1], [2, 2, 2]);
    let (mut simulation, body) = fused(&mesh, soft(1e4, 0.3));
    let row = simulation.rows(body, "load", &[5]).unwrap()[0];
    for (force, curve) in [(DVec3::X, Curve::ramp(0.0, 0.1)), (DVec3::Y, Curve::Constant)] {
        simulation.add_load(Load { name: "load".into(), forces: vec![(row, force)], curve });
    }
    simulation.set_dt(0.025);
    simulation.step().unwrap();
    let weight = DVec3::NEG_Z * 9.81 * simulation.masses(body)[5];
    let force = simulation.external_forces(body)[5];
    assert!(force.distance(weight + DVec3::new(0.25, 1.0, 0.0)) < 1e-15, "{force}");
}

/// Bodies that do not touch do not know of each other.
#[test]
fn several_bodies_equal_separate_scenes() {
    let meshes = [
        jittered_box([0.2, 0.05, 0.05], [8, 2, 2]),
        jittered_box([0.1, 0.1, 0.1], [3, 3, 3]),
        jittered_box([0.1, 0.05, 0.05], [4, 2, 2]),
    ];
    let kinds = [Evaluation::Fused, Evaluation::Pooled, Evaluation::Fused];
    let run = |chosen: &[usize], integrator| -> Vec<Vec<DVec3>> {
        let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
        let mut handles = Vec::new();
        for &i in chosen {
            let body = simulation
                .add_body(&BodyDescription {
                    model: Model::CompressibleStVK,
                    evaluation: kinds[i],
                    ..BodyDescription::new(
                        &format!("body {i}"),
                        &meshes[i],
                        soft([1e4, 2e4, 5e3][i], 0.4),
                    )
                })
                .unwrap();
            clamp(&mut simulation, body, &meshes[i], "x0");
            handles.push(body);
        }
        simulation.set_dt(5e-4);
        simulation.set_solver(exact(integrator));
        for _ in 0..20 {
            simulation.step().unwrap();
            assert!(simulation.report().substeps <= 1);
        }
        handles.iter().map(|&b| simulation.displacements(b)).collect()
    };
    // Newton solves all bodies in one system: equal as far as it converges
    for (integrator, tolerance) in
        [(Integrator::StormerVerlet, 0.0), (Integrator::Newton, 1e-11), (Integrator::Safe, 1e-11)]
    {
        let together = run(&[0, 1, 2], integrator);
        for i in 0..3 {
            let alone = run(&[i], integrator);
            let error = max_distance(&together[i], &alone[0]) / max_length(&alone[0]);
            assert!(error <= tolerance, "{integrator:?} body {i}: {error:e}");
        }
    }
}

/// Shuffled vertices, tetrahedra and local orders, and vertices that nothing uses.
#[test]
fn the_users_numbering_does_not_matter() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 3, 3]);
    let n = mesh.points.len();
    let shuffle = |count: usize, seed| {
        let key = random_field(count, seed);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|&a, &b| key[a].x.total_cmp(&key[b].x));
        order
    };
    let extra = 5;
    let order = shuffle(n + extra, 1);
    let mut place = vec![0; n + extra];
    order.iter().enumerate().for_each(|(new, &old)| place[old] = new);
    let points: Vec<DVec3> =
        order.iter().map(|&old| *mesh.points.get(old).unwrap_or(&DVec3::splat(7.0))).collect();
    // even permutations keep the orientation
    let even = [[0, 1, 2, 3], [1, 0, 3, 2], [1, 2, 0, 3], [3, 2, 1, 0], [0, 2, 3, 1]];
    let tetrahedra: Vec<[u32; 4]> = shuffle(mesh.tetrahedra.len(), 2)
        .iter()
        .map(|&t| even[t % 5].map(|k| place[mesh.tetrahedra[t][k] as usize] as u32))
        .collect();
    // (integrator, step, tolerance): rounding for explicit steps, convergence for implicit ones
    for (integrator, dt, tolerance) in [
        (Integrator::StormerVerlet, 1e-3, 1e-12),
        (Integrator::Newton, 5e-3, 1e-11),
        (Integrator::Safe, 5e-3, 1e-11),
    ] {
        for evaluation in BOTH {
            let run = |points: &[DVec3], tetrahedra: &[[u32; 4]], held: &[u32]| {
                let (mut simulation, body) = simulation(
                    SimulationOptions::default(),
                    points,
                    tetrahedra,
                    soft(3e4, 0.4),
                    Model::CompressibleStVK,
                    evaluation,
                );
                let rows = simulation.rows(body, "x0", held).unwrap();
                simulation.add_constraint(Constraint::hold("x0", rows));
                simulation.set_dt(dt);
                simulation.set_solver(exact(integrator));
                simulation.steps(20);
                (simulation.displacements(body), simulation.volume_ratios(body))
            };
            let held = group(&mesh, "x0");
            let (expected, ratios) = run(&mesh.points, &mesh.tetrahedra, &held);
            let moved: Vec<u32> = held.iter().map(|&v| place[v as usize] as u32).collect();
            let (found, moved_ratios) = run(&points, &tetrahedra, &moved);
            let back: Vec<DVec3> = (0..n).map(|v| found[place[v]]).collect();
            let error = max_distance(&back, &expected) / 0.2;
            assert!(error < tolerance, "{integrator:?} {evaluation:?}: {error:e}");
            for (new, &old) in shuffle(mesh.tetrahedra.len(), 2).iter().enumerate() {
                assert!((moved_ratios[new] - ratios[old]).abs() < 1e-9, "ratio of {old}");
            }
            for v in n..n + extra {
                assert_eq!(found[place[v]], DVec3::ZERO, "unused vertices stay");
            }
        }
    }
}

/// A loose linear tolerance must not make small forces vanish beside the inertia: a block that slides
/// along a guide falls freely, however small the step.
#[test]
fn small_steps_feel_small_forces() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [2, 2, 2]);
    for dt in [1e-2, 1e-3, 1e-4] {
        let (mut simulation, body) = fused(&mesh, soft(1e5, 0.3));
        guide(&mut simulation, body, &mesh, "x0", 1);
        simulation.set_dt(dt);
        let steps = 200;
        for _ in 0..steps {
            simulation.step().unwrap();
        }
        let expected = -9.81 * dt * f64::from(steps);
        let found = simulation.velocities(body)[0].z;
        // the linear systems are solved to 1e-3 of what inertia leaves over
        assert!((found / expected - 1.0).abs() < 5e-3, "dt {dt}: {found} m/s, not {expected}");
    }
}

/// Bodies that do not touch do not notice each other, whatever happens to one of them.
#[test]
fn a_crushed_body_does_not_stop_its_neighbour() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [3, 3, 3]);
    let n = mesh.points.len();
    let run = |with_crushed: bool| {
        let (mut simulation, flying) = fused(&mesh, soft(1e4, 0.45));
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_state(flying, &vec![DVec3::ZERO; n], &vec![DVec3::X; n]).unwrap();
        if with_crushed {
            let crushed = simulation
                .add_body(&BodyDescription::new("crushed", &mesh, soft(1e4, 0.45)))
                .unwrap();
            let u: Vec<_> =
                mesh.points.iter().zip(random_field(n, 9)).map(|(x, r)| r * 0.1 - *x).collect();
            simulation.displace(crushed, &u);
        }
        let mut safeguards = 0;
        for _ in 0..20 {
            simulation.step().unwrap();
            let report = simulation.report();
            safeguards += report.backtracks + report.projections + report.energy_caps;
        }
        (simulation.displacements(flying), safeguards)
    };
    let (alone, _) = run(false);
    let (beside, safeguards) = run(true);
    assert!(safeguards > 0, "the neighbour was not violent enough");
    assert_eq!(alone, beside, "bit for bit");
}

/// Where constraints overlap the later one wins.
#[test]
fn the_later_constraint_wins() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [2, 2, 2]);
    let (mut simulation, body) = fused(&mesh, soft(1e4, 0.3));
    for way in [0.001, 0.003, 0.002] {
        let motion = Motion::Translate(DVec3::Y * way);
        drive(&mut simulation, body, &mesh, "x0", motion, Curve::Constant);
    }
    simulation.step().unwrap();
    let vertex = mesh.group("x0").unwrap().vertices[0];
    assert_eq!(simulation.displacements(body)[vertex as usize].y, 0.002);
}

/// Releasing vertices in motion creates no energy, and damping at a moving clamp is booked as work.
#[test]
fn energy_books_close_for_moving_clamps() {
    let mesh = jittered_box([0.1, 0.05, 0.05], [4, 2, 2]);
    for (integrator, stiffness_damping) in
        [(Integrator::Safe, 0.0), (Integrator::Safe, 0.02), (Integrator::StormerVerlet, 0.0)]
    {
        let (mut simulation, body) = fused(&mesh, soft(1e5, 0.3));
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(1e-3);
        simulation.set_solver(solver!(integrator, stiffness_damping, linear_tolerance = 1e-8));
        let rows = simulation.group_rows(body, &mesh, "x0").unwrap();
        let motion = Motion::Translate(DVec3::X);
        let mut clamp = Constraint::moving("clamp", rows, motion, Curve::ramp(0.0, 1.0));
        clamp.until = 0.0205;
        simulation.add_constraint(clamp);
        let (mut work, mut highest) = (0.0, 0.0_f64);
        for step in 0..60 {
            simulation.step().unwrap();
            let report = simulation.report();
            work += report.constraint_work;
            let total = report.kinetic_energy + report.elastic_energy;
            highest = highest.max(total);
            // Verlet's energy swings by a part of (omega h)^2
            let slack = if integrator == Integrator::Safe { 1e-6 } else { 0.03 };
            assert!(
                total <= work + slack * highest,
                "{integrator:?} beta {stiffness_damping} step {step}: {total} J from {work} J"
            );
        }
        if integrator == Integrator::StormerVerlet {
            let report = simulation.report();
            let total = report.kinetic_energy + report.elastic_energy;
            assert!(
                (total / work - 1.0).abs() < 0.02,
                "{total} J in the body from {work} J of work"
            );
        }
        let report = simulation.report();
        assert_eq!(report.line_search_failures, 0);
    }
}

/// f32 statics converge to the rounding of f32 instead of running to the iteration cap.
#[test]
fn single_precision_equilibrium_converges() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 2, 2]);
    let options = SimulationOptions { precision: Precision::F32, ..Default::default() };
    let (mut simulation, body) =
        alone(options, &BodyDescription::new("beam", &mesh, soft(1e5, 0.3)));
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.set_solver(solver!(Integrator::QuasiStatic, linear_tolerance = 1e-5));
    simulation.step().unwrap();
    let report = simulation.report();
    assert!(!report.unconverged && report.newton_iterations < 30, "{report:?}");
}

/// An equilibrium needs all six rigid motions held, not just some unknowns.
#[test]
fn equilibrium_needs_every_rigid_motion_held() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [2, 2, 2]);
    let (mut simulation, body) = fused(&mesh, soft(1e4, 0.3));
    guide(&mut simulation, body, &mesh, "z0", 4);
    simulation.integrate_by(Integrator::QuasiStatic);
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("3 of the 6 rigid motions"), "{error}");
}

/// Half a turn in one step: in one go Newton ends in a minimum with inverted elements, so the solver
/// takes it in parts.
#[test]
fn equilibria_are_sought_in_parts_where_one_go_inverts_elements() {
    let mesh = jittered_box([0.3, 0.075, 0.075], [12, 3, 3]);
    let (mut simulation, body) = fused(&mesh, soft(1e4, 0.3));
    simulation.set_gravity(DVec3::ZERO);
    clamp(&mut simulation, body, &mesh, "x0");
    let centre = DVec3::new(0.3, 0.0375, 0.0375);
    let turn = Motion::Rotate { centre, axis: DVec3::X, angle: std::f64::consts::PI };
    drive(&mut simulation, body, &mesh, "x1", turn, Curve::ramp(0.0, 0.01));
    simulation.set_dt(0.01);
    simulation.set_solver(exact(Integrator::QuasiStatic));
    simulation.step().unwrap();
    let report = simulation.report().clone();
    assert!(!report.unconverged && simulation.volume_report().inverted == 0);
    assert!(report.load_partings > 0 && report.load_parts > 1);
    // every part of the way counts: the whole residual is gone
    let again = simulation.displacements(body);
    simulation.step().unwrap();
    assert!(max_distance(&again, &simulation.displacements(body)) < 1e-9);
    assert_eq!(simulation.report().load_parts, 1);
}

/// Systems that the engine keeps are taken out of the world and put back: what notes that must not grow with the
/// number of steps.
#[test]
fn the_world_does_not_grow_with_the_steps() {
    let mesh = jittered_box([1.0; 3], [1; 3]);
    let (mut simulation, _) =
        simulate(options(Precision::F64, 1), &mesh, soft(1e4, 0.3), Model::StVK, Evaluation::Fused);
    simulation.set_dt(1e-3);
    let mut notes = |steps| {
        simulation.steps(steps);
        let world = simulation.world_mut();
        let removed = world.removed_components().iter().map(|(_, m)| m.len()).sum::<usize>();
        (removed, world.entities().len())
    };
    assert_eq!(notes(10), notes(90));
}
