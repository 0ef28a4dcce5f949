//! Steps in an app are those of a `Simulation`, whatever the frames.

use crate::common::*;
use bevy_app::{App, FixedUpdate};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{LogLevel, ScheduleBuildSettings};
use bevy_math::{Dir3, Vec3};
use bevy_shape::Ray3d;
use bevy_transform::components::Transform;
use sinew::engine::schedule::SimulationSystems;
use sinew::prelude::*;
use sinew_bevy::*;
use std::sync::Mutex;
use std::time::Duration;

/// What the hand did: the pull, and where it was drawn to before each step.
#[derive(Resource, Default)]
struct Hand {
    hit: Option<SinewHit>,
    pull: Option<Entity>,
    targets: Vec<(u64, DVec3)>,
}

/// A ray that goes down beside the middle of the top, and wanders sideways.
fn ray(step: u64) -> Ray3d {
    let way = 0.0004 * step.saturating_sub(20) as f32;
    let direction = Dir3::new(Vec3::new(0.05 + way, 0.01, -1.0)).unwrap();
    Ray3d::new(Vec3::new(0.045, 0.035, 0.5), direction)
}

/// Grabs at step 20, drags until step 90, lets go.
fn drag(mut hand: ResMut<Hand>, mut mouse: SinewMouse, clock: Res<StepClock>) {
    match clock.step {
        20 => {
            let (pull, hit) = mouse.grab(ray(20), Vec3::NEG_Z, 40.0, 0.05).unwrap();
            (hand.pull, hand.hit) = (Some(pull), Some(hit));
        }
        21..90 => {
            let there = mouse.drag(hand.pull.unwrap(), ray(clock.step)).unwrap();
            let plane = hand.hit.unwrap().position.z;
            assert!((there.z - plane).abs() < 1e-12);
        }
        90 => mouse.release(hand.pull.unwrap()),
        _ => {}
    }
}

/// Presses a ball into the top.
fn press(mut tools: Query<&mut Transform, With<Tool>>, clock: Res<StepClock>) {
    for mut tool in &mut tools {
        tool.translation.z = ball(clock.step);
    }
}

fn ball(step: u64) -> f32 {
    0.062 - 0.0002 * step.min(60) as f32
}

fn note(mut hand: ResMut<Hand>, pulls: Query<&Pull>, clock: Res<StepClock>) {
    if let Ok(pull) = pulls.single() {
        hand.targets.push((clock.step, pull.target.translation));
    }
}

#[test]
fn an_app_equals_a_simulation_driven_the_same_way() {
    let mut app = app();
    app.init_resource::<Hand>();
    app.add_systems(FixedUpdate, (drag, press));
    app.add_systems(bevy_app::FixedPostUpdate, note.in_set(SimulationSystems::Last));
    held(&mut app, Transform::default());
    let shape = Shape::Sphere { radius: 0.02 };
    let start = Vec3::new(0.03, 0.04, ball(0));
    app.world_mut().spawn((
        Tool::new("ball", shape.clone(), DVec3::ZERO).with_friction(0.3),
        FollowTransform::default(),
        Transform::from_translation(start),
    ));
    for _ in 0..121 {
        app.update();
    }
    assert_eq!(steps_done(&app), 120);

    let (mut simulation, body) = twin();
    let tool = Tool::new("ball", shape, start.as_dvec3()).with_friction(0.3);
    let tool = simulation.add_tool(tool).unwrap();
    let mut pull = None;
    let hand = app.world_mut().remove_resource::<Hand>().unwrap();
    for step in 0..120 {
        let there = start.with_z(ball(step)).as_dvec3();
        if step > 0 {
            simulation.move_tool(tool, there).unwrap();
        }
        if step == 20 {
            let ray = ray(20);
            let pick = simulation.pick(ray.origin.as_dvec3(), ray.direction.as_dvec3()).unwrap();
            let hit = hand.hit.unwrap();
            let rows = simulation.rows(body, "hit", &hit.vertices).unwrap();
            assert_eq!((&rows[..], pick.weights), (&pick.rows[..], hit.weights));
            let new = Pull::new("hand", rows, 40.0, 0.05).with_weights(hit.weights.to_vec());
            pull = Some(simulation.add_pull(new));
        }
        // notes are made when the clock has advanced
        if let (Some(pull), Some((_, target))) =
            (pull, hand.targets.iter().find(|(s, _)| *s == step + 1))
        {
            simulation.move_pull(pull, *target);
        }
        if step == 90 {
            assert!(simulation.remove_contact(pull.take().unwrap()));
        }
        simulation.step().unwrap();
    }
    assert_eq!(hand.targets.len(), 70);
    let last = hand.targets.last().unwrap().1;
    // by the slope of the rays and the way to the plane, 0.46 m below
    assert!((last.x - 0.0004 * 69.0 * 0.46).abs() < 5e-4, "{last}");
    let report = simulation.tool_report(tool).unwrap();
    assert!(report.force.z > 0.05, "{report:?}");
    assert_eq!(hash(&mut app), simulation.state_hash());
}

/// Lifts the hand a little every step.
fn lift(mut hands: Query<&mut Transform, With<SinewPull>>) {
    for mut hand in &mut hands {
        hand.translation.z += 0.0002;
    }
}

/// An app with a body whose corner is lifted in every step.
fn lifted(frame: Duration, step: Duration) -> App {
    let mut app = app_of(frame, step);
    app.add_systems(FixedUpdate, lift);
    let body = held(&mut app, Transform::default());
    let corner = SinewPull::new(vec![mesh_group("z1")[0]], 30.0, 0.1);
    app.world_mut().spawn((corner, ChildOf(body)));
    app
}

#[test]
fn frames_of_any_length_give_the_same_bits() {
    let step = Duration::from_millis(8);
    let hashes = [5, 16, 40].map(|frame| {
        let mut app = lifted(Duration::from_millis(frame), step);
        // the first frame takes no time
        for _ in 0..1 + 480 / frame {
            app.update();
        }
        assert_eq!(app.world().resource::<StepClock>().dt, 0.008);
        (steps_done(&app), hash(&mut app))
    });
    assert_eq!(hashes[0].0, 60);
    assert_eq!(hashes[1], hashes[0]);
    assert_eq!(hashes[2], hashes[0]);
}

#[test]
fn two_apps_in_one_process_do_not_meet() {
    let run = |app: &mut App| (0..40).for_each(|_| app.update());
    let mut alone = lifted(STEP, STEP);
    run(&mut alone);
    let alone = hash(&mut alone);
    let (mut a, mut b) = (lifted(STEP, STEP), lifted(STEP, STEP));
    for _ in 0..40 {
        a.update();
        b.update();
    }
    assert_eq!([hash(&mut a), hash(&mut b)], [alone, alone]);
    let at_once = [0; 2].map(|_| {
        std::thread::spawn(move || {
            let mut app = lifted(STEP, STEP);
            run(&mut app);
            hash(&mut app)
        })
    });
    for app in at_once {
        assert_eq!(app.join().unwrap(), alone);
    }
}

#[test]
fn threads_and_how_they_wait_change_no_bit() {
    let mut expected = None;
    for (count, pinned, awake) in
        [(1, false, false), (2, true, true), (2, false, false), (3, true, false), (2, false, true)]
    {
        let mut app = bare(Default::default());
        let threads = sinew::engine::workers::Threads { count, pinned, awake };
        app.add_plugins(SinewBevyPlugins { engine: SinewPlugins { threads, ..engine() } });
        app.insert_resource(bevy_time::TimeUpdateStrategy::FixedTimesteps(1));
        held(&mut app, Transform::default());
        (0..10).for_each(|_| app.update());
        let hash = hash(&mut app);
        assert_eq!(*expected.get_or_insert(hash), hash, "{threads:?}");
    }
}

#[test]
fn no_system_is_ambiguous() {
    let mut app = lifted(STEP, STEP);
    let strict =
        ScheduleBuildSettings { ambiguity_detection: LogLevel::Error, ..Default::default() };
    app.configure_schedules(strict);
    // an ambiguity stops the schedule's first run
    for _ in 0..3 {
        app.update();
    }
    assert_eq!(steps_done(&app), 2);
}

#[test]
fn sets_come_in_their_order() {
    #[derive(Resource, Default)]
    struct Order(Vec<(&'static str, u64, bool)>);
    let mut app = app();
    app.init_resource::<Order>();
    let see = |name: &'static str| {
        move |mut order: ResMut<Order>, clock: Res<StepClock>, bodies: Query<&SinewBodyState>| {
            let is_told = bodies.iter().any(|state| state.step == clock.step);
            order.0.push((name, clock.step, is_told));
        }
    };
    app.add_systems(
        bevy_app::FixedPostUpdate,
        (
            see("last").in_set(SimulationSystems::Last),
            see("writeback").in_set(SimulationSystems::Writeback),
            see("prepare").in_set(SimulationSystems::Prepare),
            see("first").in_set(SimulationSystems::First).before(sinew_bevy::BodySystems::Build),
        ),
    );
    app.add_systems(FixedUpdate, see("update"));
    held(&mut app, Transform::default());
    app.update();
    app.update();
    let order = std::mem::take(&mut app.world_mut().resource_mut::<Order>().0);
    let expected = [
        ("update", 0, false),
        ("first", 0, false),
        // built, at rest
        ("prepare", 0, true),
        ("writeback", 1, true),
        ("last", 1, true),
    ];
    assert_eq!(order, expected);
}

/// The log of this test binary.
struct Log(Mutex<Vec<String>>);

static LOG: Log = Log(Mutex::new(Vec::new()));

impl log::Log for Log {
    fn enabled(&self, metadata: &log::Metadata) -> bool {
        metadata.level() <= log::Level::Warn
    }
    fn log(&self, record: &log::Record) {
        if self.enabled(record.metadata()) {
            self.0.lock().unwrap().push(record.args().to_string());
        }
    }
    fn flush(&self) {}
}

#[test]
fn steps_are_as_long_as_the_fixed_clock_says_or_as_set_by_hand() {
    log::set_logger(&LOG).unwrap();
    log::set_max_level(log::LevelFilter::Warn);
    let warned = || {
        let lines = LOG.0.lock().unwrap();
        lines.iter().filter(|line| line.contains("`StepClock::dt` is 0.002 s")).count()
    };
    let mut app = app();
    let dt = |app: &App| app.world().resource::<StepClock>().dt;
    app.world_mut().insert_resource(bevy_time::Time::<bevy_time::Fixed>::from_duration(STEP / 2));
    app.update();
    app.update();
    assert_eq!((steps_done(&app), dt(&app)), (2, 0.005));
    // Bevy's clock may change at any time
    let slower = Duration::from_millis(10);
    app.world_mut().resource_mut::<bevy_time::Time<bevy_time::Fixed>>().set_timestep(slower);
    app.update();
    assert_eq!((steps_done(&app), dt(&app)), (3, 0.01));
    assert_eq!((*app.world().resource::<SinewTimestep>(), warned()), (SinewTimestep::Fixed, 0));
    app.world_mut().resource_mut::<StepClock>().dt = 0.002;
    app.update();
    app.update();
    assert_eq!((steps_done(&app), dt(&app), warned()), (5, 0.002, 1));
    assert_eq!(*app.world().resource::<SinewTimestep>(), SinewTimestep::ByHand);
    app.world_mut().insert_resource(SinewTimestep::Fixed);
    app.update();
    assert_eq!((dt(&app), warned()), (0.01, 1));
}

#[test]
fn steps_outside_of_the_fixed_schedules_keep_their_length() {
    let mut app = bare(Default::default());
    app.add_plugins(SinewBevyPlugins { engine: engine() }.in_schedule(bevy_app::Update));
    app.world_mut().resource_mut::<StepClock>().dt = 0.003;
    let body = held(&mut app, Transform::default());
    for _ in 0..5 {
        app.update();
    }
    assert_eq!((steps_done(&app), app.world().resource::<StepClock>().dt), (5, 0.003));
    assert_eq!(app.world().get::<SinewBodyState>(body).unwrap().step, 5);
}
