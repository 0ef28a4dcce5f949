//! Explicit integrators: what acts within a step, what is remembered between steps, and how sharp and
//! how safe the stability limit is.

use crate::common::*;
use bevy_ecs::prelude::*;
use glam::DVec3;
use sinew::engine::law::{EvaluationRequest, TangentKind};
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::schedule::ForceSchedule;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Displacement, ElasticForce, FixedAxes, Mass, Velocity};
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::frame::moduli::ShearModulus;
use sinew::prelude::*;

const EXPLICIT: [Integrator; 2] = [Integrator::SymplecticEuler, Integrator::StormerVerlet];

fn beam(mesh: &Mesh, precision: Precision, integrator: Integrator) -> (Simulation, BodyHandle) {
    let options = SimulationOptions { precision, ..Default::default() };
    let (mut simulation, body) =
        simulate(options, mesh, soft(3e4, 0.4), Model::CompressibleStVK, Evaluation::Fused);
    simulation.integrate_by(integrator);
    (simulation, body)
}

/// Errors, relative to the largest displacement, after 0.1 s under `act`, for some numbers of steps.
fn errors(act: impl Fn(&mut Simulation, BodyHandle, &Mesh)) -> Vec<f64> {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    let run = |steps: u32| {
        let (mut simulation, body) = beam(&mesh, Precision::F64, Integrator::StormerVerlet);
        simulation.set_gravity(DVec3::ZERO);
        clamp(&mut simulation, body, &mesh, "x0");
        act(&mut simulation, body, &mesh);
        simulation.set_dt(0.1 / f64::from(steps));
        for _ in 0..steps {
            simulation.step().unwrap();
            assert_eq!(simulation.report().substeps, 1);
        }
        simulation.displacements(body)
    };
    let truth = run(12800);
    let size = max_length(&truth);
    [400, 800, 1600].map(|n| max_distance(&run(n), &truth) / size).to_vec()
}

/// Halving the step divides the error by four in the end; higher orders may help at larger steps.
fn assert_second_order(e: &[f64]) {
    assert!(e[0] / e[1] > 3.7 && (3.7..4.3).contains(&(e[1] / e[2])), "{e:?}");
}

#[test]
fn verlet_is_of_second_order_in_a_varying_load() {
    assert_second_order(&errors(|simulation, body, mesh| {
        let rows = simulation.rows(body, "tip", &group(mesh, "x1")).unwrap();
        let forces = rows.iter().map(|&r| (r, DVec3::new(0.0, 0.004, 0.01))).collect();
        let curve = Curve::Sine { frequency: 15.0, phase: 0.7 };
        simulation.add_load(Load { name: "tip".into(), forces, curve });
    }));
}

#[test]
fn verlet_is_of_second_order_in_prescribed_motion() {
    assert_second_order(&errors(|simulation, body, mesh| {
        let motion = Motion::Rotate {
            centre: DVec3::new(0.2, 0.025, 0.025),
            axis: DVec3::new(1.0, 0.5, 0.0),
            angle: 0.2,
        };
        let curve = Curve::Sine { frequency: 8.0, phase: 0.0 };
        drive(simulation, body, mesh, "x1", motion, curve);
    }));
}

/// One step of many substeps is the same as many steps of one: loads and motion act in between.
#[test]
fn substeps_see_loads_and_motion_like_steps() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    for integrator in EXPLICIT {
        let run = |steps: u32, explicit_safety: f64| {
            let (mut simulation, body) = beam(&mesh, Precision::F64, integrator);
            simulation.set_solver(solver!(integrator, explicit_safety));
            clamp(&mut simulation, body, &mesh, "x0");
            let rows = simulation.rows(body, "side", &group(&mesh, "z1")).unwrap();
            let forces = rows.iter().map(|&r| (r, DVec3::new(0.0, 0.0, 0.005))).collect();
            let curve = Curve::Points(vec![[0.0, 0.0], [0.013, 1.0], [0.02, -1.0]]);
            simulation.add_load(Load { name: "side".into(), forces, curve });
            let motion = Motion::Translate(DVec3::new(0.01, 0.02, 0.0));
            let curve = Curve::Sine { frequency: 20.0, phase: 0.0 };
            drive(&mut simulation, body, &mesh, "x1", motion, curve);
            simulation.set_dt(0.032 / f64::from(steps));
            let (mut substeps, mut work) = (0, 0.0);
            for _ in 0..steps {
                simulation.step().unwrap();
                assert_eq!(simulation.report().refinements, 0);
                substeps += simulation.report().substeps;
                work += simulation.report().load_work;
            }
            (simulation.displacements(body), substeps, work)
        };
        let (one, substeps, work) = run(1, 0.5);
        assert!(substeps > 8, "{substeps}");
        let (many, same, works) = run(substeps, 1.0);
        assert_eq!(substeps, same);
        let error = max_distance(&one, &many) / max_length(&many);
        // times add up in another way
        assert!(error < 1e-9, "{integrator:?}: {error:e}");
        assert!((work - works).abs() < 1e-9 * work.abs(), "{integrator:?}: {work} J, {works} J");
    }
}

/// A body in free flight 100 m away: `h v` is far below the rounding of an f32 displacement.
#[test]
fn single_precision_keeps_slow_motion_at_large_displacements() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [4, 1, 1]);
    for integrator in EXPLICIT {
        let (mut simulation, body) = beam(&mesh, Precision::F32, integrator);
        simulation.set_gravity(DVec3::ZERO);
        let n = mesh.points.len();
        let (start, speed) = (DVec3::new(2.0, -3.0, 1.5), DVec3::new(1e-3, 2e-3, -5e-4));
        simulation.set_state(body, &vec![start; n], &vec![speed; n]).unwrap();
        // way per step: 1e-7 m, the last digit of 2 m is 2.4e-7 m
        simulation.set_dt(1e-4);
        simulation.steps(2000);
        let expected = start + speed * 0.2;
        for u in simulation.displacements(body) {
            let error = (u - expected).abs().max_element();
            assert!(error < 3.0 * f64::from(f32::EPSILON), "{integrator:?}: {u} is not {expected}");
        }
    }
}

fn column<S: Component + Copy>(simulation: &mut Simulation) -> Vec<S> {
    let world = simulation.world_mut();
    world.query::<&S>().iter(world).copied().collect()
}

/// A swinging beam after some steps.
fn in_motion(integrator: Integrator, evaluation: Evaluation) -> (Simulation, BodyHandle) {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    let (mut simulation, body) = plain(&mesh, soft(3e4, 0.4), Model::CompressibleStVK, evaluation);
    simulation.integrate_by(integrator);
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.steps(5);
    (simulation, body)
}

/// The force kept from the last step is that of a fresh evaluation, and saves one.
#[test]
fn the_force_kept_between_steps_is_fresh() {
    for integrator in EXPLICIT {
        for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
            let (mut simulation, _) = in_motion(integrator, evaluation);
            let (kept, energy) =
                (column::<ElasticForce<f64>>(&mut simulation), simulation.report().elastic_energy);
            assert_eq!(simulation.evaluate().to_bits(), energy.to_bits());
            assert_eq!(column::<ElasticForce<f64>>(&mut simulation), kept);
            simulation.set_dt(1e-4);
            simulation.step().unwrap();
            let report = simulation.report();
            assert_eq!((report.substeps, report.evaluations), (1, 1), "{evaluation:?}");
        }
    }
}

/// What is changed from outside between two steps acts as in a simulation that remembers nothing.
#[test]
fn changes_between_steps_are_seen() {
    type Change = fn(&mut World);
    let changes: [(&str, Change, u32); 4] = [
        ("nothing", |_| {}, 1),
        (
            "velocity",
            |world| {
                let mut query = world.query::<&mut Velocity<f64>>();
                query.iter_mut(world).nth(20).unwrap().0[1] += 0.1;
            },
            1,
        ),
        (
            "displacement, unnoticed by change detection",
            |world| {
                let mut query = world.query::<&mut Displacement<f64>>();
                query.iter_mut(world).nth(20).unwrap().bypass_change_detection().0[1] += 1e-4;
            },
            2,
        ),
        (
            "shear modulus of one tetrahedron",
            |world| {
                let mut query = world.query::<&mut ShearModulus<f64>>();
                query.iter_mut(world).nth(20).unwrap().0 *= 1.5;
            },
            2,
        ),
    ];
    for integrator in EXPLICIT {
        let mut unchanged = Vec::new();
        for (name, change, least) in changes {
            let run = |forget: bool| {
                let (mut simulation, body) = in_motion(integrator, Evaluation::Fused);
                // one substep whatever the limit
                simulation.set_dt(1e-4);
                change(simulation.world_mut());
                if forget {
                    sinew::solvers::explicit::forget_steps::<f64>(simulation.world_mut());
                }
                simulation.step().unwrap();
                assert_eq!(simulation.report().substeps, 1);
                let evaluations = simulation.report().evaluations;
                (simulation.velocities(body), evaluations)
            };
            let ((kept, evaluations), (fresh, _)) = (run(false), run(true));
            let largest = max_length(&fresh);
            // what displacements could not hold is forgotten, too
            let error = max_distance(&kept, &fresh) / largest;
            assert!(error < 1e-13, "{integrator:?}: {name}: {error:e}");
            if name == "nothing" {
                unchanged = fresh;
            } else {
                let change = max_distance(&kept, &unchanged) / largest;
                assert!(change > 1e-8, "{integrator:?}: {name}: {change:e}");
            }
            assert!(evaluations >= least, "{integrator:?}: {name}: {evaluations}");
        }
    }
}

/// A law that does not say what it reads may depend on anything: its force is never kept.
#[test]
fn undeclared_laws_are_evaluated_anew() {
    let (mut simulation, _) = in_motion(Integrator::StormerVerlet, Evaluation::Fused);
    sinew::engine::schedule::activate_systems(simulation.world_mut(), "mine", |schedule| {
        schedule.add_systems(|| {});
    });
    simulation.set_dt(1e-4);
    for _ in 0..3 {
        simulation.step().unwrap();
        assert!(simulation.report().evaluations >= 2);
    }
}

/// `2 / omega_max` by many power iterations on the exact tangent.
fn converged_limit(simulation: &mut Simulation) -> f64 {
    let world = simulation.world_mut();
    let kind = Some(TangentKind::Exact);
    world.insert_resource(EvaluationRequest { energy: false, force: false, tangent: kind });
    world.run_schedule(ForceSchedule);
    let mut query = world.query::<(&Mass<f64>, &FixedAxes)>();
    let root: Vec<[f64; 3]> = query
        .iter(world)
        .map(|(m, f)| [0, 1, 2].map(|k| if f.holds(k) { 0.0 } else { 1.0 / m.0.sqrt() }))
        .collect();
    let matrix = &world.resource::<Tangent<f64>>().matrix;
    let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
    let mut x: Vec<[f64; 4]> =
        random_field(root.len(), 9).iter().map(|v| [v.x, v.y, v.z, 0.0]).collect();
    let (mut y, mut spans) = (x.clone(), ProductSpans::default());
    let mut largest = 0.0;
    for _ in 0..5000 {
        let norm = x.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
        for (x, r) in x.iter_mut().zip(&root) {
            (0..3).for_each(|k| x[k] *= r[k] / norm);
        }
        matrix.multiply(topology, workers, &mut spans, &x, &mut y);
        for (y, r) in y.iter_mut().zip(&root) {
            (0..3).for_each(|k| y[k] *= r[k]);
        }
        largest = y.iter().flatten().map(|x| x * x).sum::<f64>().sqrt();
        std::mem::swap(&mut x, &mut y);
    }
    2.0 / f64::sqrt(largest)
}

/// Compressed to half, swinging, stretched: the estimate stays within what the safety factor leaves,
/// and no step has to be repeated.
#[test]
fn the_stability_limit_follows_the_deformation() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [8, 3, 3]);
    for way in [-0.1, 0.0, 0.1] {
        let (mut simulation, body) = beam(&mesh, Precision::F64, Integrator::StormerVerlet);
        clamp(&mut simulation, body, &mesh, "x0");
        if way != 0.0 {
            let motion = Motion::Translate(DVec3::X * way);
            let curve = Curve::ramp(0.0, 0.2);
            drive(&mut simulation, body, &mesh, "x1", motion, curve);
        }
        for step in 0..25 {
            let truth = (step > 0).then(|| converged_limit(&mut simulation));
            simulation.step().unwrap();
            let report = simulation.report();
            assert_eq!(report.refinements, 0, "{way} step {step}");
            if let Some(truth) = truth {
                let ratio = report.stable_step / truth;
                assert!((0.85..1.1).contains(&ratio), "{way} step {step}: {ratio}");
            }
        }
    }
}

/// At rest the estimate is the converged limit, and a step beyond it is refused.
#[test]
fn the_stability_limit_is_where_it_is_said_to_be() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    let (mut simulation, body) = beam(&mesh, Precision::F64, Integrator::StormerVerlet);
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.set_dt(1e-9);
    simulation.step().unwrap();
    let limit = simulation.report().stable_step;
    let truth = converged_limit(&mut simulation);
    assert!((0.97..1.01).contains(&(limit / truth)), "{limit} {truth}");
    simulation.set_dt(1.02 * truth);
    simulation.set_solver(solver!(
        Integrator::StormerVerlet,
        explicit_safety = 1.0,
        max_substeps = 1
    ));
    assert!(simulation.step().is_err());
}
