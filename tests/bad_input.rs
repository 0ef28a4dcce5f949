//! Bad input gives a typed error that names the entity and a remedy, and leaves the state as it was;
//! extreme but valid input gives bounded results.

use crate::common::*;
use glam::{DQuat, DVec3};
use sinew::engine::load::TargetError;
use sinew::engine::mesh::Mesh;
use sinew::engine::step::StepError;
use sinew::models::body::{BodyError, Evaluation};
use sinew::prelude::*;

fn mesh() -> Mesh {
    jittered_box([0.2, 0.05, 0.05], [6, 2, 2])
}

/// A world with a sound body in motion, to which bad things are done.
fn sound() -> (Simulation, BodyHandle, Mesh) {
    let mesh = mesh();
    let (mut simulation, body) = fused(&mesh, soft(2e4, 0.4));
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.steps(3);
    (simulation, body, mesh)
}

/// The message has every one of these words.
fn assert_says(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "`{word}` is missing in: {message}");
    }
}

fn add(
    simulation: &mut Simulation,
    name: &str,
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    material: YoungPoisson,
) -> Result<BodyHandle, BodyError> {
    simulation.add_body(&BodyDescription {
        model: Model::CompressibleStVK,
        evaluation: Evaluation::Fused,
        ..BodyDescription::from_parts(name, points, tetrahedra, material)
    })
}

/// Tries to add a bad body to a running world: nothing may change, and the world runs on.
fn refuses_body(
    name: &str,
    points: &[DVec3],
    tetrahedra: &[[u32; 4]],
    material: YoungPoisson,
    words: &[&str],
) -> BodyError {
    let (mut simulation, body, _) = sound();
    let hash = simulation.state_hash();
    let entities = simulation.world().entities().count_spawned();
    let error = add(&mut simulation, name, points, tetrahedra, material).unwrap_err();
    assert_says(&error.to_string(), words);
    assert_says(&error.to_string(), &[name]);
    assert_eq!(simulation.state_hash(), hash);
    assert_eq!(simulation.topology().bodies.len(), 1);
    assert_eq!(simulation.world().entities().count_spawned(), entities, "something was spawned");
    simulation.step().unwrap();
    assert!(simulation.displacements(body).iter().all(|u| u.is_finite()));
    error
}

#[test]
fn meshes() {
    let good = mesh();
    let material = soft(1e4, 0.3);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut points = good.points.clone();
            points[3][axis] = bad;
            let words = ["tetrahedron ", "finite coordinates"];
            let error = refuses_body("blob", &points, &good.tetrahedra, material, &words);
            assert!(matches!(error, BodyError::Tetrahedron { .. }));
        }
    }
    let replace = |index: usize, t: [u32; 4]| {
        let mut tetrahedra = good.tetrahedra.clone();
        tetrahedra[index] = t;
        tetrahedra
    };
    let n = good.points.len() as u32;
    let [a, b, c, d] = good.tetrahedra[17];
    for t in [[a, b, c, n], [u32::MAX, b, c, d], [a, a, c, d], [a, b, c, b]] {
        let words = ["tetrahedron 17 ", "indices must be distinct and below", "mesh check"];
        let error = refuses_body("blob", &good.points, &replace(17, t), material, &words);
        assert!(matches!(error, BodyError::Index { index: 17, .. }));
    }
    let words = ["tetrahedron 17:", "swap two of the four vertices"];
    refuses_body("blob", &good.points, &replace(17, [b, a, c, d]), material, &words);

    // two vertices at one place, and a vertex in the plane of the others
    let mut points = good.points.clone();
    points[b as usize] = points[a as usize];
    refuses_body("blob", &points, &good.tetrahedra, material, &["flat; remove it or remesh"]);
    let corner = [DVec3::ZERO, DVec3::X, DVec3::Y];
    for fourth in [DVec3::new(0.3, 0.3, 0.0), DVec3::new(0.3, 0.3, 1e-13), DVec3::X] {
        let points = [corner[0], corner[1], corner[2], fourth];
        let words = ["tetrahedron 0:", "flat"];
        refuses_body("leaf", &points, &[[0, 1, 2, 3]], material, &words);
    }
    // a sliver above the limit is a body
    let points = [corner[0], corner[1], corner[2], DVec3::new(0.3, 0.3, 1e-7)];
    let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
    add(&mut simulation, "sliver", &points, &[[0, 1, 2, 3]], material).unwrap();

    refuses_body("none", &good.points, &[], material, &["no tetrahedra"]);
    refuses_body("none", &[], &[], material, &["no tetrahedra"]);
    refuses_body("none", &[], &[[0, 1, 2, 3]], material, &["of 0"]);
    let words = ["names must be unique"];
    let error = refuses_body("body", &good.points, &good.tetrahedra, material, &words);
    assert!(matches!(error, BodyError::Duplicate { .. }));
}

#[test]
fn materials() {
    let good = mesh();
    let cases: [(YoungPoisson, &[&str]); 15] = [
        (soft(f64::NAN, 0.3), &["Young's modulus", "finite"]),
        (soft(f64::INFINITY, 0.3), &["Young's modulus", "finite"]),
        (soft(0.0, 0.3), &["Young's modulus", "positive"]),
        (soft(-1e4, 0.3), &["Young's modulus", "positive"]),
        (soft(1e4, f64::NAN), &["Poisson's ratio", "finite"]),
        (soft(1e4, 0.5), &["Poisson's ratio is 0.5", "below 0.5", "0.45 to 0.49"]),
        (soft(1e4, 0.7), &["Poisson's ratio is 0.7", "below 0.5"]),
        (soft(1e4, f64::INFINITY), &["Poisson's ratio", "finite"]),
        (soft(1e4, 0.49995), &["Poisson's ratio", "clusters"]),
        (soft(1e4, -1.0), &["Poisson's ratio", "above -1"]),
        (soft(1e4, -3.0), &["Poisson's ratio", "above -1"]),
        (YoungPoisson { density: 0.0, ..soft(1e4, 0.3) }, &["density", "positive"]),
        (YoungPoisson { density: -1.0, ..soft(1e4, 0.3) }, &["density", "positive"]),
        (YoungPoisson { density: f64::NAN, ..soft(1e4, 0.3) }, &["density", "finite"]),
        (YoungPoisson { density: f64::INFINITY, ..soft(1e4, 0.3) }, &["density", "finite"]),
    ];
    for (material, words) in cases {
        let error = refuses_body("blob", &good.points, &good.tetrahedra, material, words);
        assert!(matches!(error, BodyError::Material { .. }), "{error}");
    }
}

/// A step that must fail, with the state the same bits as before and the world sound after `mend`.
fn refuses_step(
    spoil: impl Fn(&mut Simulation),
    mend: impl Fn(&mut Simulation),
    words: &[&str],
) -> StepError {
    let (mut simulation, body, _) = sound();
    let (hash, time) = (simulation.state_hash(), simulation.time());
    spoil(&mut simulation);
    for _ in 0..2 {
        let error = simulation.step().expect_err(&format!("an error with {words:?}"));
        assert_says(&error.to_string(), words);
        assert_eq!(simulation.state_hash(), hash, "the state changed: {error}");
        assert_eq!(simulation.time(), time, "time went on: {error}");
    }
    let error = simulation.step().unwrap_err();
    mend(&mut simulation);
    simulation.step().unwrap();
    assert!(simulation.displacements(body).iter().all(|u| u.is_finite()));
    error
}

#[test]
fn steps_and_gravity() {
    for dt in [0.0, -0.01, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let words = ["step length dt", "positive and finite"];
        let error = refuses_step(|s| s.set_dt(dt), |s| s.set_dt(0.01), &words);
        assert!(matches!(error, StepError::InvalidStep { .. }));
    }
    for bad in [f64::NAN, f64::INFINITY] {
        for axis in 0..3 {
            let mut gravity = DVec3::ZERO;
            gravity[axis] = bad;
            let mend = |s: &mut Simulation| s.set_gravity(DVec3::ZERO);
            refuses_step(|s| s.set_gravity(gravity), mend, &["gravity", "not finite"]);
        }
    }
}

#[test]
fn targets() {
    let (mut simulation, body, mesh) = sound();
    let rows = simulation.rows(body, "tool", &group(&mesh, "x1")).unwrap();
    let tool = simulation.add_constraint(Constraint::hold("tool", rows.clone()));
    let (pull, ramp) = (Motion::Translate(DVec3::X * 0.01), Curve::ramp(0.0, 1.0));
    let moving = simulation.add_constraint(Constraint::moving("moving", rows, pull, ramp));
    simulation.world_mut().despawn(moving);
    simulation.set_target(tool, DVec3::X * 0.001).unwrap();
    simulation.step().unwrap();
    let hash = simulation.state_hash();
    let turned = |rotation| Pose { rotation, ..Pose::IDENTITY };
    let mut bad: Vec<(Pose, &[&str])> = vec![
        (turned(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)), &["`tool`", "no rotation", "IDENTITY"]),
        (Pose { centre: DVec3::Z * f64::NAN, ..Pose::IDENTITY }, &["`tool`", "not finite"]),
        (turned(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0)), &["`tool`", "not finite"]),
        (turned(DQuat::from_xyzw(1e300, 0.0, 0.0, 1e300)), &["`tool`", "no rotation"]),
    ];
    for x in [f64::NAN, f64::INFINITY] {
        bad.push((DVec3::new(0.0, x, 0.0).into(), &["`tool`", "not finite"]));
    }
    for (pose, words) in bad {
        let error = simulation.set_target(tool, pose).unwrap_err();
        assert_says(&error.to_string(), words);
    }
    assert_eq!(simulation.state_hash(), hash);
    // what was followed before stays, and a rotation of another length is the same rotation
    let stretched = DQuat::from_xyzw(0.0, 0.0, 0.0, 1e-20);
    simulation
        .set_target(tool, Pose { translation: DVec3::X * 0.001, ..turned(stretched) })
        .unwrap();
    simulation.step().unwrap();
    let held = group(&mesh, "x1")[0] as usize;
    let before = simulation.displacements(body)[held];
    simulation.step().unwrap();
    assert_eq!(simulation.displacements(body)[held], before);

    let error = simulation.set_target(moving, DVec3::X).unwrap_err();
    assert_eq!(error, TargetError::NoConstraint(moving));
    assert_says(&error.to_string(), &["is no constraint", "`add_constraint`"]);
    let wall = Constraint::moving("wall", Vec::new(), Motion::Translate(DVec3::X), Curve::Constant);
    let wall = simulation.add_constraint(wall);
    let error = simulation.set_target(wall, DVec3::X).unwrap_err();
    assert_eq!(error, TargetError::OwnMotion { name: "wall".into() });
    assert_says(&error.to_string(), &["`wall`", "curve of its own", "`Constraint::hold`"]);
}

#[test]
fn solver_settings() {
    type Spoil = fn(&mut SolverSettings, f64);
    let reals: [(&str, Spoil, &[f64]); 6] = [
        ("linear_tolerance", |s, x| s.linear_tolerance = x, &[0.0, 1.0, -1e-3, 2.0]),
        ("newton_tolerance", |s, x| s.newton_tolerance = x, &[0.0, 1.0, -1e-3, 2.0]),
        ("explicit_safety", |s, x| s.explicit_safety = x, &[0.0, -0.5, 1.01]),
        ("mass_damping", |s, x| s.mass_damping = x, &[-1e-9]),
        ("stiffness_damping", |s, x| s.stiffness_damping = x, &[-1e-9]),
        ("sleep_speed", |s, x| s.sleep_speed = x, &[-1e-9]),
    ];
    let mend = |s: &mut Simulation| s.set_solver(SolverSettings::default());
    for (name, spoil, values) in reals {
        for &value in values.iter().chain(&[f64::NAN, f64::INFINITY, f64::NEG_INFINITY]) {
            for integrator in [Integrator::Safe, Integrator::StormerVerlet] {
                let mut settings = SolverSettings { integrator, ..Default::default() };
                spoil(&mut settings, value);
                let set = |s: &mut Simulation| s.set_solver(settings.clone());
                let error = refuses_step(set, mend, &[name, "it must be"]);
                assert!(matches!(error, StepError::InvalidSetting(_)));
            }
        }
    }
    let counts: [(&str, fn(&mut SolverSettings)); 3] = [
        ("max_linear_iterations", |s| s.max_linear_iterations = 0),
        ("max_newton_iterations", |s| s.max_newton_iterations = 0),
        ("max_substeps", |s| s.max_substeps = 0),
    ];
    for (name, spoil) in counts {
        let mut settings = SolverSettings::default();
        spoil(&mut settings);
        refuses_step(|s| s.set_solver(settings.clone()), mend, &[name, "at least 1"]);
    }
    for integrator in [Integrator::SymplecticEuler, Integrator::StormerVerlet] {
        let settings = SolverSettings { integrator, stiffness_damping: 1e-3, ..Default::default() };
        let words = ["stiffness_damping", "use mass_damping"];
        refuses_step(|s| s.set_solver(settings.clone()), mend, &words);
    }
}

const DYNAMIC: [Integrator; 4] =
    [Integrator::Safe, Integrator::Newton, Integrator::SymplecticEuler, Integrator::StormerVerlet];

#[test]
fn states_set_from_outside() {
    for bad in [f64::NAN, f64::INFINITY] {
        for velocity in [false, true] {
            let (mut simulation, body, _) = sound();
            let (u, v) = (simulation.displacements(body), simulation.velocities(body));
            let (mut bad_u, mut bad_v) = (u.clone(), v.clone());
            (if velocity { &mut bad_v } else { &mut bad_u })[11].y = bad;
            simulation.set_state(body, &bad_u, &bad_v).unwrap();
            let error = simulation.step().unwrap_err();
            let quantity = if velocity { "velocity" } else { "displacement" };
            let words = [quantity, "vertex 11 ", "`body`", "set so from outside"];
            assert_says(&error.to_string(), &words);
            assert!(matches!(error, StepError::NotFinite { vertex: MeshVertex(11), .. }));
            simulation.set_state(body, &u, &v).unwrap();
            simulation.step().unwrap();
        }
    }
    let (mut simulation, body, _) = sound();
    let hash = simulation.state_hash();
    let n = simulation.displacements(body).len();
    for (u, v) in [(n - 1, n), (n, n + 1), (0, n)] {
        let error = simulation.set_state(body, &vec![DVec3::X; u], &vec![DVec3::X; v]).unwrap_err();
        assert_says(&error.to_string(), &["`body`", &format!("with {n} vertices")]);
        assert_eq!(simulation.state_hash(), hash);
    }
}

#[test]
fn constraints_and_loads() {
    let (mut simulation, body, mesh) = sound();
    let n = mesh.points.len() as u32;
    for vertex in [n, u32::MAX] {
        let error = simulation.rows(body, "clamp", &[0, vertex]).unwrap_err();
        let words = ["`clamp`", "`body`", &format!("vertex {vertex} "), "does not exist"];
        assert_says(&error.to_string(), &words);
    }
    // a vertex that no element uses
    let mut points = mesh.points.clone();
    points.push(DVec3::ONE);
    let material = soft(1e4, 0.3);
    let second = add(&mut simulation, "second", &points, &mesh.tetrahedra, material).unwrap();
    let error = simulation.rows(second, "pin", &[n]).unwrap_err();
    assert_says(&error.to_string(), &["`pin`", "`second`", "belongs to no element"]);

    // numbers that are not finite, or too large, reach neither the state nor the clock
    for bad in [f64::NAN, f64::INFINITY, 1e200] {
        for integrator in DYNAMIC {
            let (mut simulation, body, mesh) = sound();
            simulation.integrate_by(integrator);
            let rows = simulation.rows(body, "x1", &group(&mesh, "x1")).unwrap();
            let load = Load {
                name: "load".into(),
                forces: vec![(rows[0], DVec3::X * bad)],
                curve: Curve::Constant,
            };
            let push = Motion::Translate(DVec3::X * bad);
            let constraint = Constraint::moving("push", rows, push, Curve::Constant);
            for what in ["load", "push"] {
                let hash = simulation.state_hash();
                let entity = if what == "load" {
                    simulation.add_load(load.clone())
                } else {
                    simulation.add_constraint(constraint.clone())
                };
                let error = simulation.step().expect_err(&format!("{what} {bad} {integrator:?}"));
                if bad.is_finite() {
                    assert!(
                        matches!(error, StepError::NotFinite { .. } | StepError::Diverged { .. }),
                        "{error}"
                    );
                } else {
                    assert!(matches!(error, StepError::InvalidConstraint { .. }), "{error}");
                    assert_says(&error.to_string(), &[&format!("`{what}`"), "not finite"]);
                }
                assert_eq!(simulation.state_hash(), hash);
                simulation.world_mut().despawn(entity);
                simulation.step().unwrap();
            }
        }
    }
}

/// Constraints and loads that a program makes up itself.
#[test]
fn constraints_and_loads_that_cannot_be_applied() {
    let spoil_constraint = |s: &mut Simulation| {
        s.add_constraint(Constraint::hold("made up", vec![VertexRow(0), VertexRow(100_000)]));
    };
    let spoil_load = |s: &mut Simulation| {
        let forces = vec![(VertexRow(100_000), DVec3::X)];
        s.add_load(Load { name: "made up".into(), forces, curve: Curve::Constant });
    };
    let mend = |s: &mut Simulation| {
        let world = s.world_mut();
        let made_up: Vec<_> = world
            .query::<(bevy_ecs::prelude::Entity, Option<&Constraint>, Option<&Load>)>()
            .iter(world)
            .filter(|(_, c, l)| {
                c.is_some_and(|c| c.name == "made up") || l.is_some_and(|l| l.name == "made up")
            })
            .map(|(e, ..)| e)
            .collect();
        for entity in made_up {
            world.despawn(entity);
        }
    };
    let words = ["`made up`", "row that does not exist", "correct it or take it away"];
    refuses_step(spoil_constraint, mend, &words);
    refuses_step(spoil_load, mend, &words);

    let motions = [
        (Motion::TranslateEach(vec![DVec3::X; 2]), "one translation per vertex"),
        (Motion::TranslateEach(vec![DVec3::NAN]), "not finite"),
        (
            Motion::Rotate { centre: DVec3::ZERO, axis: DVec3::ZERO, angle: 1.0 },
            "no usable direction",
        ),
        (Motion::Rotate { centre: DVec3::ZERO, axis: DVec3::X, angle: f64::NAN }, "not finite"),
    ];
    for (motion, problem) in motions {
        let spoil = |s: &mut Simulation| {
            let curve = Curve::Constant;
            s.add_constraint(Constraint::moving(
                "made up",
                vec![VertexRow(0)],
                motion.clone(),
                curve,
            ));
        };
        refuses_step(spoil, mend, &["`made up`", problem]);
    }
    let curves = [
        (Curve::Points(vec![[1.0, 0.0], [0.0, 1.0]]), "do not ascend"),
        (Curve::Points(vec![[f64::NAN, 0.0]]), "not finite"),
        (Curve::Points(Vec::new()), "no points"),
        (Curve::Sine { frequency: f64::NAN, phase: 0.0 }, "not finite"),
    ];
    for (curve, problem) in curves {
        let spoil = |s: &mut Simulation| {
            let (name, forces) = ("made up".into(), vec![(VertexRow(0), DVec3::X)]);
            s.add_load(Load { name, forces, curve: curve.clone() });
        };
        refuses_step(spoil, mend, &["`made up`", problem]);
    }
}

#[test]
fn explicit_steps_that_would_take_too_long() {
    for integrator in [Integrator::SymplecticEuler, Integrator::StormerVerlet] {
        let settings = SolverSettings { integrator, max_substeps: 3, ..Default::default() };
        let spoil = |s: &mut Simulation| {
            s.set_solver(settings.clone());
            s.set_dt(0.05);
        };
        let mend = |s: &mut Simulation| s.set_dt(1e-4);
        let words = ["substeps", "stability limit", "max_substeps = 3", "reduce dt"];
        let error = refuses_step(spoil, mend, &words);
        assert!(matches!(error, StepError::Diverged { .. }));
    }
}

#[test]
fn a_million_metres_from_the_origin() {
    let far = DVec3::new(1e6, -1e6, 1e6);
    for integrator in [Integrator::Safe, Integrator::Newton, Integrator::StormerVerlet] {
        let run = |offset: DVec3| {
            let mesh = mesh();
            let points: Vec<DVec3> = mesh.points.iter().map(|x| *x + offset).collect();
            let (mut simulation, body) = simulation(
                SimulationOptions::default(),
                &points,
                &mesh.tetrahedra,
                soft(2e4, 0.4),
                Model::CompressibleStVK,
                Evaluation::Fused,
            );
            clamp(&mut simulation, body, &mesh, "x0");
            simulation.set_solver(solver!(integrator, linear_tolerance = 1e-10));
            simulation.steps(20);
            simulation.displacements(body)
        };
        let (near, away) = (run(DVec3::ZERO), run(far));
        // coordinates are rounded to 1e-10 m, the cells are 0.02 m: 5e-9 in shape
        let error = max_distance(&near, &away) / 0.2;
        assert!(error < 1e-8, "{integrator:?}: {error:e} of body size");
    }
}

#[test]
fn gravity_of_a_million() {
    // the corotational energy of recovery does not stiffen under tension: let go, a linear bar reaches
    // rho g L^2 / E, which is 1e4 lengths here; free fall would be 6e5
    let cases = [
        (Integrator::Safe, false, 50.0),
        (Integrator::Newton, false, 50.0),
        (Integrator::Auto, true, 1e4),
    ];
    for (integrator, recovery, reach) in cases {
        let (mut simulation, body, _) = sound();
        simulation.set_gravity(DVec3::new(0.0, 0.0, -1e6));
        simulation.set_solver(SolverSettings { integrator, recovery, ..Default::default() });
        let mut inverted = 0;
        for _ in 0..50 {
            simulation.step().unwrap();
            inverted = inverted.max(simulation.volume_report().inverted);
            let (u, v) = (simulation.displacements(body), simulation.velocities(body));
            assert!(u.iter().chain(&v).all(|x| x.is_finite()));
            // it hangs on its clamp: a bounded fall, not an explosion
            assert!(max_length(&u) < reach * 0.2, "{integrator:?}: {}", max_length(&u));
        }
        assert!(inverted > 0, "{integrator:?}: inverted elements must be reported");
        assert!(simulation.volume_report().smallest_ratio.is_finite());
    }
}

#[test]
fn single_precision_beam() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [12, 3, 3]);
    let run = |precision, linear_tolerance| {
        let options = SimulationOptions { precision, ..Default::default() };
        let material = soft(2e4, 0.4);
        let model = Model::CompressibleStVK;
        let (mut simulation, body) = simulate(options, &mesh, material, model, Evaluation::Fused);
        clamp(&mut simulation, body, &mesh, "x0");
        simulation.set_solver(SolverSettings { linear_tolerance, ..Default::default() });
        simulation.steps(50);
        simulation.displacements(body)
    };
    let wide = run(Precision::F64, 1e-5);
    let narrow = run(Precision::F32, 1e-5);
    assert!(max_length(&wide) > 0.02);
    let error = max_distance(&wide, &narrow) / 0.2;
    assert!(error < 1e-4, "{error:e} of body size");
}

/// Forces from displacements keep their digits at any strain and far from the origin.
#[test]
fn single_precision_forces() {
    for (offset, tolerance) in [(0.0, 1e-4), (1.0, 1e-4), (100.0, 1e-2)] {
        for strain in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
                let mesh = jittered_box([0.2, 0.05, 0.05], [12, 3, 3]);
                let points: Vec<DVec3> =
                    mesh.points.iter().map(|x| *x + DVec3::splat(offset)).collect();
                let u: Vec<DVec3> = mesh
                    .points
                    .iter()
                    .map(|x| {
                        let wave = (20.0 * x.x).sin() / 20.0;
                        DVec3::new(x.x + x.y, wave, 0.5 * x.z - wave) * strain
                    })
                    .collect();
                let [wide, narrow] = [Precision::F64, Precision::F32].map(|precision| {
                    let options = SimulationOptions { precision, ..Default::default() };
                    let (mut simulation, body) = simulation(
                        options,
                        &points,
                        &mesh.tetrahedra,
                        soft(2e4, 0.4),
                        Model::CompressibleStVK,
                        evaluation,
                    );
                    simulation.displace(body, &u);
                    simulation.evaluate();
                    simulation.elastic_forces(body)
                });
                let error = max_distance(&wide, &narrow) / max_length(&wide);
                assert!(
                    error < tolerance,
                    "{evaluation:?} strain {strain} at {offset} m: {error:e}"
                );
            }
        }
    }
}
