//! What a host relies on: precision from the world, failures that are seen, tools moved between steps,
//! simulations that change threads.

use crate::common::*;
use bevy_app::{App, PluginGroup, Update};
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use sinew::engine::load::Load;
use sinew::engine::mesh::Mesh;
use sinew::engine::schedule::Executor;
use sinew::engine::step::{StepError, run_step};
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Displacement, Position};
use sinew::live::{LoopError, LoopFigures, SimulationLoop, share};
use sinew::models::body::{BodyError, Evaluation, spawn_body};
use sinew::plugin::{EnginePlugin, SetupError, StepFailed, StepOutcome, ThreadsNotStarted};
use sinew::prelude::*;
use sinew::solvers::settings::LinearPrecision;
use std::sync::Mutex;
use std::time::Duration;

fn mesh() -> Mesh {
    jittered_box([0.2, 0.05, 0.05], [6, 2, 2])
}

fn app(plugins: SinewPlugins) -> App {
    let mut app = App::new();
    app.add_plugins(plugins.in_schedule(Update));
    app
}

#[test]
fn a_body_has_the_precision_of_its_world() {
    let mesh = mesh();
    let description = BodyDescription::new("body", &mesh, soft(2e4, 0.4));
    for precision in [Precision::F64, Precision::F32] {
        let mut app = app(SinewPlugins { precision, ..Default::default() });
        spawn_body(app.world_mut(), &description).unwrap();
        for _ in 0..3 {
            app.update();
        }
        let world = app.world_mut();
        assert_eq!(world.resource::<StepOutcome>().0, None);
        assert_eq!(world.resource::<StepClock>().step, 3);
        let doubles = world.query::<&Displacement<f64>>().iter(world).count();
        let singles = world.query::<&Displacement<f32>>().iter(world).count();
        let vertices = mesh.points.len();
        let expected = if precision == Precision::F64 { (vertices, 0) } else { (0, vertices) };
        assert_eq!((doubles, singles), expected);
        let falls = |p: &Position| p.0.z < 0.05 && p.0.z > -0.01;
        assert!(world.query::<&Position>().iter(world).all(falls));
    }
}

#[test]
fn a_world_without_an_engine_is_named() {
    let mesh = mesh();
    let description = BodyDescription::new("organ", &mesh, soft(2e4, 0.4));
    let mut world = World::new();
    let error = spawn_body(&mut world, &description).unwrap_err();
    assert_eq!(error, BodyError::NoPrecision { body: "organ".into() });
    assert!(error.to_string().contains("add `SinewPlugins`"), "{error}");
    assert!(!world.contains_resource::<Topology>());
    let error = run_step(&mut world).unwrap_err();
    assert_eq!(error, StepError::NoEngine);
    assert!(error.to_string().contains("add `SinewPlugins`"), "{error}");

    // a host that leaves the engine out hears of it, too
    let mut app = App::new();
    app.add_plugins(SinewPlugins::default().in_schedule(Update).build().disable::<EnginePlugin>());
    app.update();
    assert_eq!(app.world().resource::<StepOutcome>().0, Some(StepError::NoEngine));
}

/// The log of this test binary.
struct Log(Mutex<Vec<String>>);

static LOG: Log = Log(Mutex::new(Vec::new()));

impl log::Log for Log {
    fn enabled(&self, metadata: &log::Metadata) -> bool {
        metadata.level() == log::Level::Error
    }
    fn log(&self, record: &log::Record) {
        if self.enabled(record.metadata()) {
            self.0.lock().unwrap().push(record.args().to_string());
        }
    }
    fn flush(&self) {}
}

/// Log entries with a text in them that no other test writes.
fn logged(text: &str) -> usize {
    LOG.0.lock().unwrap().iter().filter(|line| line.contains(text)).count()
}

#[derive(Resource, Default)]
struct Heard {
    steps: Vec<StepError>,
    threads: usize,
}

fn listen(
    mut heard: ResMut<Heard>,
    mut steps: MessageReader<StepFailed>,
    mut threads: MessageReader<ThreadsNotStarted>,
) {
    heard.steps.extend(steps.read().map(|failed| failed.0.clone()));
    heard.threads += threads.read().count();
}

#[test]
fn failures_are_messages_and_log_entries() {
    log::set_logger(&LOG).unwrap();
    log::set_max_level(log::LevelFilter::Error);
    let mut app = app(SinewPlugins { threads: 98_765.into(), ..Default::default() });
    app.init_resource::<Heard>().add_systems(bevy_app::PostUpdate, listen);
    assert!(app.world().resource::<SetupError>().0.is_some());
    assert_eq!(logged("98765 threads"), 0, "the host's logger may come later");
    app.update();
    app.update();
    assert_eq!(app.world().resource::<StepClock>().step, 2, "one thread does the work");
    assert_eq!((logged("98765 threads"), app.world().resource::<Heard>().threads), (1, 1));

    let set_dt = |app: &mut App, dt| app.world_mut().resource_mut::<StepClock>().dt = dt;
    let deal_with_it = |app: &mut App| app.world_mut().resource_mut::<StepOutcome>().0 = None;
    let bad = StepError::InvalidStep { dt: -0.125 };
    set_dt(&mut app, -0.125);
    for _ in 0..5 {
        app.update();
    }
    assert_eq!(app.world().resource::<StepOutcome>().0, Some(bad.clone()));
    assert_eq!(app.world().resource::<Heard>().steps, std::slice::from_ref(&bad));
    assert_eq!(logged("dt = -0.125 s"), 1);
    // a host that tries again without a change: every failure is a message, the log stays readable
    for _ in 0..3 {
        deal_with_it(&mut app);
        app.update();
    }
    assert_eq!((app.world().resource::<Heard>().steps.len(), logged("dt = -0.125 s")), (4, 1));
    // another error is told, and the first one anew once steps went well again
    deal_with_it(&mut app);
    set_dt(&mut app, f64::NAN);
    app.update();
    assert_eq!((app.world().resource::<Heard>().steps.len(), logged("dt = NaN s")), (5, 1));
    for _ in 0..2 {
        deal_with_it(&mut app);
        set_dt(&mut app, 0.01);
        app.update();
    }
    assert_eq!(app.world().resource::<StepClock>().step, 4);
    set_dt(&mut app, -0.125);
    app.update();
    assert_eq!(logged("dt = -0.125 s"), 2);
}

/// A beam held at one end, its other end in a tool; returns the tool.
fn beam(options: SimulationOptions, integrator: Integrator, motion: Motion) -> Held {
    let mesh = mesh();
    let model = Model::CompressibleStVK;
    let (mut simulation, body) = simulate(options, &mesh, soft(2e4, 0.4), model, Evaluation::Fused);
    simulation.integrate_by(integrator);
    clamp(&mut simulation, body, &mesh, "x0");
    let rows = simulation.rows(body, "tool", &group(&mesh, "x1")).unwrap();
    let tool = Constraint::moving("tool", rows, motion, Curve::ramp(0.0, 0.15));
    let tool = simulation.add_constraint(tool);
    Held { simulation, body, tool }
}

struct Held {
    simulation: Simulation,
    body: BodyHandle,
    tool: Entity,
}

impl Held {
    /// Steps through the ramp and some time after it, with `target` of the ramp's value at the end of
    /// each step; force (N) of the tool after every step.
    fn run(&mut self, target: Option<&dyn Fn(f64) -> Pose>) -> Vec<DVec3> {
        let s = &mut self.simulation;
        let ramp = Curve::ramp(0.0, 0.15);
        let steps = 0..20;
        steps
            .map(|_| {
                if let Some(target) = target {
                    let end = s.time() + s.world().resource::<StepClock>().dt;
                    s.set_target(self.tool, target(ramp.value(end))).unwrap();
                }
                s.step().unwrap();
                s.evaluate();
                s.reaction(self.tool).unwrap()
            })
            .collect()
    }
}

/// They ask for the target at the end of a step alone.
const AT_THE_END: [Integrator; 3] =
    [Integrator::Safe, Integrator::LinearisedBdf2, Integrator::QuasiStatic];
/// They ask for it on the way too, where a hand's path and a ramp are rounded otherwise.
const ON_THE_WAY: [Integrator; 5] = [
    Integrator::TrBdf2,
    Integrator::LinearisedTrBdf2,
    Integrator::ImplicitMidpoint,
    Integrator::SymplecticEuler,
    Integrator::StormerVerlet,
];

#[test]
fn targets_set_between_steps_equal_a_ramp() {
    let way = DVec3::new(0.03, 0.01, -0.02);
    for precision in [Precision::F64, Precision::F32] {
        let options = SimulationOptions { precision, threads: 1, ..Default::default() };
        for integrator in AT_THE_END {
            let mut ramp = beam(options, integrator, Motion::Translate(way));
            let mut hand = beam(options, integrator, Motion::Hold);
            let expected = ramp.run(None);
            let reactions = hand.run(Some(&|factor| Pose::from(way * factor)));
            assert!(expected.iter().all(|f| f.x > 0.01), "{integrator:?}: {expected:?}");
            assert_eq!(reactions, expected, "{precision:?} {integrator:?}");
            assert_eq!(ramp.simulation.state_hash(), hand.simulation.state_hash());
        }
        let tolerance = if precision == Precision::F64 { 1e-10 } else { 1e-3 };
        for integrator in ON_THE_WAY {
            let expected = beam(options, integrator, Motion::Translate(way)).run(None);
            let mut hand = beam(options, integrator, Motion::Hold);
            let reactions = hand.run(Some(&|factor| Pose::from(way * factor)));
            let error = max_distance(&reactions, &expected) / max_length(&expected);
            assert!(error < tolerance, "{precision:?} {integrator:?}: {error:e}");
        }
    }
}

#[test]
fn targets_turn_what_is_held() {
    let centre = DVec3::new(0.2, 0.025, 0.025);
    let options = SimulationOptions { threads: 1, ..Default::default() };
    let angle = 1.2;
    for integrator in [Integrator::Safe, Integrator::StormerVerlet] {
        let turn = Motion::Rotate { centre, axis: DVec3::X, angle };
        let mut ramp = beam(options, integrator, turn);
        let mut hand = beam(options, integrator, Motion::Hold);
        // `f32` may round a last bit of the turn to 1e-10
        let linear_precision = LinearPrecision::Full;
        for held in [&mut ramp, &mut hand] {
            held.simulation.set_solver(SolverSettings {
                integrator,
                linear_precision,
                ..SolverSettings::default()
            });
        }
        let target = |factor: f64| {
            let rotation = DQuat::from_rotation_x(angle * factor);
            Pose { rotation, centre, ..Pose::IDENTITY }
        };
        ramp.run(None);
        hand.run(Some(&target));
        let [expected, found] = [&mut ramp, &mut hand].map(|h| h.simulation.positions(h.body));
        assert!(max_distance(&expected, &mesh().points) > 0.01);
        let error = max_distance(&found, &expected) / 0.2;
        // a hand turns a little otherwise within a step than an angle that grows evenly
        let tolerance = if integrator == Integrator::Safe { 1e-12 } else { 1e-6 };
        assert!(error < tolerance, "{integrator:?}: {error:e}");
    }
}

#[test]
fn a_target_holds_until_the_next_and_survives_a_failed_step() {
    let options = SimulationOptions { threads: 1, ..Default::default() };
    let mut held = beam(options, Integrator::StormerVerlet, Motion::Hold);
    let (tool, corner) = (held.tool, group(&mesh(), "x1")[0] as usize);
    let s = &mut held.simulation;
    let x = |s: &mut Simulation| s.displacements(BodyHandle(0))[corner].x;
    s.set_target(tool, DVec3::X * 0.001).unwrap();
    s.set_target(tool, DVec3::X * 0.002).unwrap();
    s.step().unwrap();
    assert_eq!(x(s), 0.002, "the last target before a step counts");
    s.step().unwrap();
    assert_eq!(x(s), 0.002);
    // a step that fails moves nothing, and made again it moves as if it had not been tried
    let load = Load {
        name: "bad".into(),
        forces: vec![(VertexRow(0), DVec3::NAN)],
        curve: Curve::Constant,
    };
    s.set_target(tool, DVec3::X * 0.004).unwrap();
    let bad = s.add_load(load);
    let before = s.state_hash();
    assert!(s.step().is_err());
    assert_eq!(s.state_hash(), before);
    s.world_mut().despawn(bad);
    s.step().unwrap();
    assert_eq!(x(s), 0.004);
    let mut smooth = beam(options, Integrator::StormerVerlet, Motion::Hold);
    for target in [0.002, 0.002, 0.004] {
        smooth.simulation.set_target(smooth.tool, DVec3::X * target).unwrap();
        smooth.simulation.step().unwrap();
    }
    assert_eq!(smooth.simulation.state_hash(), s.state_hash());
}

#[test]
fn a_simulation_changes_threads() {
    fn is_send<T: Send>() {}
    is_send::<Simulation>();
    let hold = || Motion::Translate(DVec3::X * 0.03);
    for executor in [Executor::SingleThreaded, Executor::MultiThreaded] {
        for threads in [1, 2] {
            let options = SimulationOptions { executor, threads, ..Default::default() };
            let mut here = beam(options, Integrator::Auto, hold());
            let there = beam(options, Integrator::Auto, hold());
            here.run(None);
            // made here, stepped there, read here
            let mut there = std::thread::spawn(move || {
                let mut held = there;
                held.run(None);
                held
            })
            .join()
            .unwrap();
            assert_eq!(there.simulation.state_hash(), here.simulation.state_hash());
            there.simulation.step().unwrap();
        }
    }
}

/// A thread that reads while another steps sees whole states, none older than one it has seen, and the last one in the end.
#[test]
fn states_are_read_whole_while_a_simulation_runs() {
    let mesh = mesh();
    let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
    let body = simulation.add_body(&BodyDescription::new("body", &mesh, soft(2e4, 0.4))).unwrap();
    simulation.set_gravity(DVec3::Z);
    simulation.set_solver(solver!(Integrator::Safe));
    let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.1, 0.025, 0.069));
    let ball = simulation.add_tool(ball).unwrap();
    let (mut writer, mut reader) = share(&mut simulation, &[body], &[ball]);
    assert!(!reader.update(), "it begins with the state as it is");
    let at_rest = reader.frames()[1].clone();
    assert_eq!(at_rest.positions[0], mesh.points);
    // unit normals of the outside, nothing inside
    let mut sums = vec![DVec3::ZERO; mesh.points.len()];
    for t in mesh.surface().triangles {
        let [a, b, c] = t.map(|v| mesh.points[v as usize]);
        t.iter().for_each(|&v| sums[v as usize] += (b - a).cross(c - a));
    }
    let normals: Vec<_> = sums.into_iter().map(DVec3::normalize_or_zero).collect();
    assert!(max_distance(&at_rest.normals[0], &normals) < 1e-12);
    assert!(normals.iter().filter(|n| **n == DVec3::ZERO).count() == 5);
    let steps = 60;
    let reading = std::thread::spawn(move || {
        let (mut seen, mut last) = (Vec::new(), 0);
        while last < steps {
            if !reader.update() {
                std::thread::yield_now();
                continue;
            }
            let [before, now] = reader.frames();
            assert!(before.step < now.step && before.time < now.time);
            assert!((now.time - 0.01 * now.step as f64).abs() < 1e-9);
            // every bit of one state
            let sum = now.positions[0].iter().map(|x| x.z.to_bits()).fold(0, u64::wrapping_add);
            last = now.step;
            let turned = now.normals[0].iter().map(|x| x.z.to_bits()).fold(0, u64::wrapping_add);
            seen.push((now.step, (sum, now.wrenches[0][0].z.to_bits(), turned)));
        }
        (seen, reader)
    });
    let (mut truth, mut alone) = (Vec::new(), share(&mut simulation, &[body], &[]));
    for _ in 0..steps {
        simulation.step().unwrap();
        writer.write(&mut simulation);
        // another pair, read on this thread
        alone.0.write(&mut simulation);
        assert!(alone.1.update());
        let normals = alone.1.normals_at(0, f64::INFINITY);
        let turned = normals.iter().map(|x| x.z.to_bits()).fold(0, u64::wrapping_add);
        let positions = simulation.positions(body);
        let sum = positions.iter().map(|x| x.z.to_bits()).fold(0, u64::wrapping_add);
        truth.push((sum, simulation.tool_report(ball).unwrap().force.z.to_bits(), turned));
    }
    let (seen, mut reader) = reading.join().unwrap();
    for (step, what) in seen {
        assert_eq!(truth[step as usize - 1], what, "step {step}");
    }
    assert!(!reader.update());
    assert_eq!(reader.frames()[1].positions, [simulation.positions(body)]);
    assert!(truth.iter().any(|(_, force, _)| f64::from_bits(*force) != 0.0), "they never met");
    let force = simulation.tool_report(ball).unwrap().force;
    assert_eq!(reader.wrench_at(0, f64::INFINITY)[0], force);
    assert!(reader.positions_at(1, 0.0).is_empty() && writer.is_read());
    drop(reader);
    assert!(!writer.is_read());
}

/// Steps are as many as the time has room for, whatever it is read in, and time that cannot be made up is dropped and counted.
#[test]
fn a_loop_keeps_its_rate_and_drops_what_it_cannot_catch_up() {
    let step = Duration::from_millis(10);
    let mut pace = SimulationLoop::new(step, 3).unwrap();
    let frames = [16, 17, 17].into_iter().cycle();
    let due: Vec<u32> = frames.take(60).map(|ms| pace.due(Duration::from_millis(ms))).collect();
    assert_eq!((due.iter().sum::<u32>(), due.iter().max()), (100, Some(&2)));
    assert_eq!(pace.figures(), LoopFigures { steps: 100, ..LoopFigures::default() });
    // a second in which the machine did something else
    assert_eq!(pace.due(Duration::from_millis(1004)), 3);
    assert_eq!(pace.part(), 0.4);
    let figures = LoopFigures { steps: 103, overruns: 1, dropped: Duration::from_millis(970) };
    assert_eq!(pace.figures(), figures);
    assert_eq!((pace.due(Duration::from_millis(6)), pace.part()), (1, 0.0));
    assert_eq!(SimulationLoop::new(step, 0).unwrap_err(), LoopError::NoStep { step, most: 0 });
    assert!(SimulationLoop::new(Duration::ZERO, 1).unwrap_err().to_string().contains("0ns"));
}
