//! Tools on springs, and devices that hold them: a tool that gives way to what it touches.

#![allow(clippy::print_stdout, reason = "figures beside their bars are shown")]

use crate::common::random_numbers;
use crate::haptics::{block, block_with};
use allocation_counter::measure;
use glam::{DMat3, DQuat, DVec3};
use sinew::engine::mesh::generate::box_tets;
use sinew::haptics::simulated::SimulatedDevice;
use sinew::haptics::{
    DeviceMotion, HapticDevice, HapticError, HapticOptions, HapticReport, HapticTissue,
};
use sinew::prelude::*;
use sinew::touch::tool::{Part, ToolError, ToolMotion};

/// A cycle of the device (s).
const TICK: f64 = 1e-3;
/// Radius (m) of the ball, which is thicker than edges are long: depths in thinner ones are measured along normals that turn with
/// the tissue from step to step. Height (m) at which it touches the middle of the block's upper face.
const RADIUS: f64 = 0.03;
const TOUCHES: f64 = 0.06 + RADIUS;

/// Over the middle of the block, aside so that nothing is symmetric.
fn above(height: f64) -> DVec3 {
    DVec3::new(0.063, 0.057, height)
}

fn ball(friction: f64) -> Tool {
    let shape = Shape::Sphere { radius: RADIUS };
    Tool::new("ball", shape, above(TOUCHES + 2e-3)).with_friction(friction)
}

/// A block of liver on a table with a ball on a spring of 300 N/m above it.
fn poked(
    precision: Precision,
    integrator: Integrator,
    friction: f64,
) -> (Simulation, bevy_ecs::entity::Entity) {
    let (mut simulation, _, _) = block(precision, integrator, true);
    let tool = simulation.add_tool(ball(friction).with_spring(300.0)).unwrap();
    (simulation, tool)
}

/// A tool on a spring is where a tool that is held there rigidly meets the same force, and that is the spring's.
#[test]
fn a_spring_is_in_balance_with_what_the_tool_touches() {
    for (precision, bar) in [(Precision::F64, 1e-6), (Precision::F32, 1e-4)] {
        for friction in [0.0, 0.4] {
            let (mut simulation, tool) = poked(precision, Integrator::QuasiStatic, friction);
            let (mut rigid, _, _) = block(precision, Integrator::QuasiStatic, true);
            let twin = rigid.add_tool(ball(friction)).unwrap();
            let hands = [(0.0, 2e-3), (0.0, -4e-3), (1e-3, -8e-3), (2e-3, -8e-3), (2e-3, -5e-3)];
            for (aside, depth) in hands {
                let hand = above(TOUCHES + depth) + DVec3::X * aside;
                simulation.move_tool(tool, hand).unwrap();
                simulation.step().unwrap();
                let own = simulation.tool_report(tool).unwrap().clone();
                assert!(!own.unconverged, "{own:?}");
                rigid.move_tool(twin, own.position).unwrap();
                rigid.step().unwrap();
                let other = rigid.tool_report(twin).unwrap();
                let off = [300.0 * own.yields, other.force].map(|f| f.distance(own.force));
                if depth > 0.0 {
                    assert_eq!((own.yields, own.force), (DVec3::ZERO, DVec3::ZERO));
                    continue;
                }
                assert!(own.force.z > 0.2, "{own:?}");
                // where the tool slips, what it had before counts: the twin had the same
                assert!(off.iter().all(|off| *off < bar * own.force.length()), "{off:?}");
            }
        }
    }
}

/// With the hand at rest energy goes down, whatever the integrator and however far the hand is in the tissue.
#[test]
fn energy_never_rises_while_the_hand_rests() {
    let all = [
        Integrator::Safe,
        Integrator::LinearisedBdf2,
        Integrator::Newton,
        Integrator::StormerVerlet,
    ];
    for integrator in all {
        for (friction, dt) in [(0.0, 0.01), (0.5, 0.004)] {
            let (mut simulation, tool) = poked(Precision::F64, integrator, friction);
            simulation.set_dt(dt);
            for step in 1..=10 {
                let hand = above(TOUCHES + 2e-3 - 1.2e-3 * f64::from(step))
                    + DVec3::X * 2e-4 * f64::from(step);
                simulation.move_tool(tool, hand).unwrap();
                simulation.step().unwrap();
            }
            let energy = |simulation: &Simulation| {
                let report = simulation.report();
                report.kinetic_energy + report.elastic_energy + report.contact.energy
            };
            let mut before = energy(&simulation);
            let first = before;
            for _ in 0..100 {
                simulation.step().unwrap();
                let now = energy(&simulation);
                assert!(now <= before + 1e-9 * first, "{integrator:?} {friction}: {before} {now}");
                before = now;
            }
            let own = simulation.tool_report(tool).unwrap();
            println!("{integrator:?} {friction}: {first:.3e} -> {before:.3e} J, {:?}", own.yields);
            assert!(own.yields.z > 1e-3 && before < first);
        }
    }
}

/// Energy of a hand's way is what body, contact and spring have, less what is lost.
#[test]
fn work_of_the_hand_is_what_is_stored() {
    let (mut simulation, tool) = poked(Precision::F64, Integrator::QuasiStatic, 0.0);
    let steps = 400;
    for step in 0..=steps {
        let depth = 2e-3 - 1e-2 * f64::from(step) / f64::from(steps);
        simulation.move_tool(tool, above(TOUCHES + depth)).unwrap();
        simulation.step().unwrap();
    }
    let work = simulation.tool_report(tool).unwrap().work;
    let report = simulation.report();
    let stored = report.elastic_energy + report.contact.energy;
    println!("{work} J of {stored} J");
    // forces at the ends of steps are above the mean
    assert!((work / stored - 1.0).abs() < 0.01, "{work} {stored}");
}

/// A device that holds the ball above the block; friction without end is a grip.
fn held(
    precision: Precision,
    integrator: Integrator,
    friction: f64,
) -> (Simulation, HapticTissue, HapticDevice) {
    let (mut simulation, _, _) = block(precision, integrator, true);
    let mut tool = ball(0.0);
    (tool.friction, tool.grip) = (friction.min(1.0), friction.is_infinite());
    let tool = simulation.add_tool(tool).unwrap();
    let (tissue, device) = simulation.haptic_handle(HapticOptions::of_tool(tool)).unwrap();
    (simulation, tissue, device)
}

/// Equilibria for hands a little further on, against the model, within a hundredth of the spring.
#[test]
fn the_local_model_is_what_equilibria_differ_by() {
    for (precision, friction) in
        [(Precision::F64, 0.0), (Precision::F32, 0.0), (Precision::F64, f64::INFINITY)]
    {
        let (mut simulation, mut tissue, mut device) =
            held(precision, Integrator::QuasiStatic, friction);
        let mut settle = |x: DVec3| {
            device.exchange(x, DVec3::ZERO, TICK);
            tissue.step(&mut simulation).unwrap()
        };
        settle(DVec3::ZERO);
        for x in [DVec3::Z * -6e-3, DVec3::new(0.0, 1e-3, -12e-3)] {
            settle(x);
            let model = settle(x);
            assert!(model.compliance.solved && !model.compliance.projected && !model.unconverged);
            assert!(if friction > 0.0 { model.push == DVec3::ZERO } else { model.push.z > 0.9 });
            let h = 2e-5;
            let column = |settle: &mut dyn FnMut(DVec3) -> HapticReport, axis: DVec3| {
                let [more, less] = [h, -h].map(|h| settle(x + h * axis).patch);
                settle(x);
                (more - less) / (2.0 * h)
            };
            let [a, b, c] = DVec3::AXES.map(|axis| column(&mut settle, axis));
            let exact = DMat3::from_cols(a, b, c);
            let gain = model.compliance.gain;
            let off = (gain - exact).to_cols_array().map(f64::abs).into_iter().fold(0.0, f64::max);
            println!("{precision:?} {friction} {x}: off by {off:.2e}");
            assert!(off < 0.01, "{gain} {exact}");
        }
    }
}

/// A block with a device that is stepped at so many hertz beside cycles of a millisecond.
struct Beside {
    simulation: Simulation,
    tissue: HapticTissue,
    rate: u64,
    tick: u64,
    steps: u64,
}

impl Beside {
    fn new(rate: u64, friction: f64) -> (Self, HapticDevice) {
        let (simulation, tissue, device) = held(Precision::F64, Integrator::Safe, friction);
        (Self::of(simulation, tissue, rate), device)
    }

    fn of(mut simulation: Simulation, tissue: HapticTissue, rate: u64) -> Self {
        simulation.set_dt(1.0 / rate as f64);
        Self { simulation, tissue, rate, tick: 0, steps: 0 }
    }

    /// The begin of a cycle: what a step led to is known when it is over.
    fn cycle(&mut self) {
        let due = self.tick * self.rate / 1000;
        if self.tick == 0 || due > self.steps {
            self.steps = due;
            if self.tick > 0 {
                self.tissue.after_step(&mut self.simulation).unwrap();
            }
            self.tissue.before_step(&mut self.simulation).unwrap();
            self.simulation.step().unwrap();
        }
        self.tick += 1;
    }
}

fn ticks(seconds: f64) -> u64 {
    (seconds / TICK).round() as u64
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

/// The force (N) that a device with these motions (m, m/s) would feel if the scene with its tool, which is at `start` (m), were stepped at a
/// kilohertz, its damper included.
fn at_a_kilohertz(
    (mut simulation, tool): (Simulation, bevy_ecs::entity::Entity),
    start: DVec3,
    way: impl Fn(f64) -> DVec3,
    velocity: impl Fn(f64) -> DVec3,
    seconds: f64,
) -> Vec<DVec3> {
    simulation.set_dt(TICK);
    let mut forces = Vec::new();
    for tick in 0..ticks(seconds) {
        // as far as the spring is drawn
        let force = simulation.tool_report(tool).map_or(DVec3::ZERO, |own| own.force);
        let firm = (force.length() / 300.0 / 1e-3).min(1.0);
        forces.push(force - firm * 2.0 * velocity(tick as f64 * TICK));
        simulation.move_tool(tool, start + way((tick + 1) as f64 * TICK)).unwrap();
        simulation.step().unwrap();
    }
    forces
}

/// Where the scalpel stands at first: beside the block, 30 mm deep in its height.
const BESIDE: DVec3 = DVec3::new(0.063, -0.01, 0.05);

/// The block with a scalpel beside it.
fn with_scalpel(integrator: Integrator) -> (Simulation, bevy_ecs::entity::Entity) {
    let (mut simulation, _, _) = block_with(2000, Precision::F64, integrator, true);
    let ends = [DVec3::Z * 0.02, DVec3::Z * -0.02];
    let edge = Edge { ends, into: DVec3::Y, toughness: 20.0, travel: DVec3::ZERO };
    let tool = simulation.add_tool(Tool::blade("scalpel", edge, BESIDE)).unwrap();
    (simulation, tool)
}

/// A device with a scalpel cuts on and draws it out, beside a scene that is stepped at a kilohertz.
#[test]
fn a_cut_is_felt_as_at_a_kilohertz() {
    // 70 mm in, with a hand that is not steady, and back
    let way = |t: f64| {
        let on = 0.035 * (1.0 - (std::f64::consts::TAU / 3.0 * t).cos());
        DVec3::new(5e-4 * (9.0 * t).sin(), on + 1e-3 * (7.0 * t).sin(), 5e-4 * (5.0 * t).sin())
    };
    let velocity = |t: f64| (way(t + 1e-6) - way(t - 1e-6)) / 2e-6;
    let exact = {
        let (mut simulation, tool) = with_scalpel(Integrator::Safe);
        simulation.world_mut().get_mut::<Tool>(tool).unwrap().spring = Some(300.0);
        at_a_kilohertz((simulation, tool), BESIDE, way, velocity, 3.0)
    };
    let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
    for rate in [60, 100] {
        let (mut simulation, tool) = with_scalpel(Integrator::Safe);
        let options = HapticOptions::of_tool(tool);
        let (tissue, mut handle) = simulation.haptic_handle(options).unwrap();
        let mut scene = Beside::of(simulation, tissue, rate);
        let mut felt = Vec::new();
        for tick in 0..ticks(3.0) {
            scene.cycle();
            let t = tick as f64 * TICK;
            felt.push(handle.exchange(way(t), velocity(t), TICK).force);
        }
        let cut = scene.simulation.tool_report(tool).unwrap();
        let off: Vec<f64> = felt.iter().zip(&exact).map(|(a, b)| a.distance(*b)).collect();
        let error = rms(&off[ticks(0.3) as usize..]) / peak;
        let jump = felt.windows(2).map(|w| w[0].distance(w[1])).fold(0.0, f64::max) / peak;
        println!(
            "{rate}: peak {peak:.3} N, {} elements parted, error {:.2} %, jump {:.2} %",
            cut.separated,
            1e2 * error,
            1e2 * jump
        );
        assert!(peak > 0.4 && cut.separated > 20, "{peak} N, {cut:?}");
        assert!(error < 0.05 && jump < 0.05, "{rate}: {error} {jump}");
    }
}

/// Moved down into the tissue and out of it, beside a scene that is stepped at a kilohertz.
#[test]
fn a_tool_that_comes_into_touch_and_leaves_is_felt_as_at_a_kilohertz() {
    // 2 mm above, 8 mm in it
    let way = |t: f64| DVec3::Z * -5e-3 * (1.0 - (std::f64::consts::TAU * t).cos());
    let velocity = |t: f64| (way(t + 1e-6) - way(t - 1e-6)) / 2e-6;
    let exact = {
        let scene = poked(Precision::F64, Integrator::Safe, 0.0);
        let mut all = at_a_kilohertz(scene, above(TOUCHES + 2e-3), way, velocity, 3.0);
        all.iter_mut().for_each(|force| force.z = force.z.max(0.0));
        all
    };
    let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
    let free = exact.iter().filter(|f| **f == DVec3::ZERO).count();
    for rate in [60, 100, 500] {
        let (mut scene, mut handle) = Beside::new(rate, 0.0);
        let (mut felt, mut silent) = (Vec::new(), 0);
        for tick in 0..ticks(3.0) {
            scene.cycle();
            let t = tick as f64 * TICK;
            let own = handle.exchange(way(t), velocity(t), TICK);
            felt.push(own.force);
            silent += u32::from(own.force == DVec3::ZERO);
            assert!(own.force.z >= 0.0, "drawn in: {own:?}");
        }
        let off: Vec<f64> = felt.iter().zip(&exact).map(|(a, b)| a.distance(*b)).collect();
        let error = rms(&off[ticks(0.3) as usize..]) / peak;
        let jump = felt.windows(2).map(|w| w[0].distance(w[1])).fold(0.0, f64::max) / peak;
        println!(
            "{rate}: peak {peak:.3} N, error {:.2} %, jump {:.2} %, silent {silent} of {free}",
            1e2 * error,
            1e2 * jump
        );
        assert!(peak > 0.3 && free > 800 && silent > 800, "{peak} {free} {silent}");
        // the bar is 5 %
        assert!(error < 0.006, "{rate}: {error}");
        assert!(jump < 0.02, "{rate}: {jump}");
    }
}

/// A hand that wants the tool elsewhere every fifth of a second, in and out of the tissue: the device gets no energy, no force jumps,
/// and what it holds comes to rest when the hand does.
#[test]
fn a_device_gets_no_energy_from_a_tool_that_is_poked_about() {
    for rate in [60, 100] {
        for (mass, damping, delay) in [(0.05, 0.1, 2), (0.1, 0.1, 1), (0.1, 1.0, 2)] {
            let (mut scene, mut handle) = Beside::new(rate, 0.3);
            let mut device = SimulatedDevice::new(mass, damping, delay).held(100.0, 2.0);
            let mut chance = random_numbers(7);
            let mut aim = DVec3::ZERO;
            let (mut least, mut peak, mut jump, mut before) =
                (0.0_f64, 0.0_f64, 0.0_f64, DVec3::ZERO);
            let (mut touched, mut last) = (0, Vec::new());
            for tick in 0..ticks(12.0) {
                if tick % ticks(0.2) == 0 && tick < ticks(10.0) {
                    let mut next = || chance(2001) as f64 / 1000.0 - 1.0;
                    aim = DVec3::new(6e-3 * next(), 6e-3 * next(), -6e-3 + 9e-3 * next());
                }
                if tick == ticks(10.0) {
                    aim = DVec3::Z * -1e-2;
                }
                device.wish += (aim - device.wish) * (TICK / 0.06);
                scene.cycle();
                device.go(|x, v, seconds| handle.exchange(x, v, seconds).force);
                let felt = handle.felt();
                least = least.min(felt.energy);
                peak = peak.max(felt.force.length());
                jump = jump.max(felt.force.distance(before));
                before = felt.force;
                touched += u32::from(felt.force != DVec3::ZERO);
                if tick >= ticks(11.5) {
                    last.push((device.position, felt.force));
                }
            }
            let (end, force) = last[last.len() - 1];
            let moved = last.iter().map(|(x, _)| x.distance(end)).fold(0.0, f64::max);
            let jitter = rms(&last.iter().map(|(_, f)| f.distance(force)).collect::<Vec<_>>());
            println!(
                "{rate}: {mass} kg, {damping}, {delay} ms: least {least:.2e} J, peak {peak:.3} N, jump {:.1} %, touched {touched}, moved {moved:.1e} m, jitter {jitter:.1e} N",
                100.0 * jump / peak
            );
            assert!(peak > 0.2 && (2000..11000).contains(&touched), "{peak} N, {touched}");
            assert!(least >= -1e-4, "{rate}: {mass} kg, {delay} ms: {least} J");
            // what comes into touch may rise by 50 N/s
            let most = (0.05 * peak).max(0.05 + 1e-9);
            assert!(jump <= most, "{rate}: {mass} kg, {delay} ms: {jump} of {peak} N");
            assert!(moved < 5e-5 && jitter < 5e-3, "{moved} m, {jitter} N");
        }
    }
}

/// Jaws on a spring grip, lift, and open: the hand feels the tissue pull, and then nothing.
#[test]
fn jaws_in_a_hand_grip_and_open() {
    let (mut simulation, _, _) = block(Precision::F64, Integrator::Safe, true);
    simulation.set_dt(0.01);
    let jaw = |side: f64| Part {
        at: DVec3::new(side * 0.02, 0.0, 0.0),
        ..Shape::Box { half: DVec3::new(0.004, 0.008, 0.012), rounding: 0.002 }.into()
    };
    // two fingers beside a fold would need a fold: pressed on the face, they hold by friction without end
    let mut tool = Tool::of_parts("jaws", vec![jaw(-1.0), jaw(1.0)], above(0.0715).into());
    tool.friction = 1.0;
    let tool = simulation.add_tool(tool).unwrap();
    let options = HapticOptions::of_tool(tool);
    let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
    let mut go = |simulation: &mut Simulation, from: f64, to: f64, steps: u32| {
        let mut report = HapticReport::default();
        for step in 1..=steps {
            let part = f64::from(step) / f64::from(steps);
            let x = DVec3::Z * (from + (to - from) * part);
            for _ in 0..10 {
                device.exchange(x, DVec3::ZERO, TICK);
            }
            report = tissue.step(simulation).unwrap();
        }
        (report, device.exchange(DVec3::Z * to, DVec3::ZERO, TICK))
    };
    let (down, _) = go(&mut simulation, 0.0, -4e-3, 20);
    assert!(down.force.z > 0.05 && down.push.z > 0.9, "{down:?}");
    simulation.world_mut().get_mut::<Tool>(tool).unwrap().grip = true;
    let (up, felt) = go(&mut simulation, -4e-3, 8e-3, 60);
    println!("{:?} N, felt {:?}", up.force, felt.force);
    // drawn to the tissue, whatever presses at first
    assert!(up.force.z < -0.1 && felt.force.distance(up.force) < 0.02, "{up:?} {felt:?}");
    simulation.world_mut().get_mut::<Tool>(tool).unwrap().grip = false;
    let (open, felt) = go(&mut simulation, 8e-3, 8e-3, 30);
    assert_eq!((open.force, felt.force), (DVec3::ZERO, DVec3::ZERO));
}

/// A tool that touches two bodies joins their solves, whatever the number of threads.
#[test]
fn a_tool_between_two_bodies_is_in_balance_with_both() {
    let run = |threads: usize| {
        let options = SimulationOptions { threads, ..Default::default() };
        let mut simulation = Simulation::new(options).unwrap();
        let mesh = box_tets(DVec3::new(0.06, 0.06, 0.04), [4, 4, 3]).unwrap();
        let material = preset("liver").unwrap().material;
        let mut bodies = Vec::new();
        for (name, side) in [("left", -1.0), ("right", 1.0)] {
            let mesh = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::X * (0.0325 * side - 0.03));
            let body = simulation.add_body(&BodyDescription::new(name, &mesh, material)).unwrap();
            let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
            simulation.add_constraint(Constraint::hold(name, floor));
            bodies.push(body);
        }
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(0.01);
        let shape = Shape::Capsule { half_length: 0.03, radius: 0.01 };
        let part =
            Part { rotation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2), ..shape.into() };
        let start = DVec3::new(0.004, 0.03, 0.052);
        let tool =
            Tool::of_parts("rod", vec![part], start.into()).with_friction(0.3).with_spring(200.0);
        let tool = simulation.add_tool(tool).unwrap();
        for step in 1..=60 {
            let down = 1.2e-2 * f64::from(step.min(30)) / 30.0;
            simulation.move_tool(tool, start - DVec3::Z * down).unwrap();
            simulation.step().unwrap();
        }
        let own = simulation.tool_report(tool).unwrap().clone();
        assert!(!own.unconverged && own.yields.z > 2e-3, "{own:?}");
        assert!((200.0 * own.yields).distance(own.force) < 1e-8 * own.force.length());
        (own, bodies.into_iter().map(|body| simulation.positions(body)).collect::<Vec<_>>())
    };
    assert_eq!(run(1), run(2));
}

/// The state of a spring is in snapshots; a tool that is let go stays where it is.
#[test]
fn snapshots_know_springs_and_a_tool_that_is_let_go_stays() {
    let (mut simulation, _, _) = block(Precision::F64, Integrator::Safe, true);
    let ball = simulation.add_tool(ball(0.3)).unwrap();
    simulation.step().unwrap();
    let free = simulation.snapshot().unwrap();
    let options = HapticOptions::of_tool(ball);
    let (mut tissue, mut device) = simulation.haptic_handle(options.clone()).unwrap();
    let error = simulation.haptic_handle(options).unwrap_err().to_string();
    assert!(error.contains("a hand holds it by a spring already"), "{error}");
    simulation.set_dt(0.01);
    let mut on = |simulation: &mut Simulation, steps: std::ops::Range<u32>| {
        for step in steps {
            let x = DVec3::new(1e-4, 0.0, -3e-4) * f64::from(step.min(40));
            device.exchange(x, DVec3::ZERO, TICK);
            tissue.step(simulation).unwrap();
        }
    };
    on(&mut simulation, 0..20);
    let snapshot = simulation.snapshot().unwrap();
    on(&mut simulation, 20..50);
    let first = (simulation.state_hash(), simulation.tool_report(ball).cloned());
    simulation.restore(&snapshot).unwrap();
    on(&mut simulation, 20..50);
    let again = (simulation.state_hash(), simulation.tool_report(ball).cloned());
    assert_eq!(first, again);
    // a spring that was not there yet holds nothing
    let there = simulation.snapshot().unwrap();
    simulation.restore(&free).unwrap();
    let error = tissue.step(&mut simulation).unwrap_err();
    assert!(matches!(error, HapticError::Released(_)), "{error}");
    simulation.restore(&there).unwrap();
    let tool = simulation.current(ball);
    let before = simulation.tool_report(tool).unwrap().clone();
    assert!(before.yields.z > 1e-3);
    tissue.release(&mut simulation);
    simulation.step().unwrap();
    let after = simulation.tool_report(tool).unwrap();
    assert!(after.position.distance(before.position) < 1e-15 && after.yields == DVec3::ZERO);
    assert!((after.force - before.force).length() < 0.05 * before.force.length(), "{after:?}");
    device.exchange(DVec3::ZERO, DVec3::ZERO, TICK);
    let felt = device.exchange(DVec3::ZERO, DVec3::ZERO, 0.2);
    assert!(felt.flags.stale && felt.force == DVec3::ZERO);
}

/// The tool turns with a device that turns, and not with one that does not.
#[test]
fn a_tool_turns_with_the_device() {
    for turns in [false, true] {
        let (mut simulation, _, _) = block(Precision::F64, Integrator::Safe, true);
        let tool = simulation.add_tool(ball(0.0)).unwrap();
        let options = HapticOptions { turns, ..HapticOptions::of_tool(tool) };
        let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
        device.exchange_pose(&DeviceMotion::default(), TICK);
        tissue.step(&mut simulation).unwrap();
        let turn = DQuat::from_rotation_x(0.3);
        device.exchange_pose(&DeviceMotion { rotation: turn, ..Default::default() }, TICK);
        tissue.step(&mut simulation).unwrap();
        let now = simulation.tool_report(tool).unwrap().rotation;
        let wanted = if turns { turn } else { DQuat::IDENTITY };
        assert!(now.angle_between(wanted) < 1e-12, "{now}");
    }
}

#[test]
fn exchanges_of_a_tool_ask_for_no_memory() {
    let (mut scene, mut handle) = Beside::new(100, 0.3);
    for tick in 0..200 {
        scene.cycle();
        let x = DVec3::Z * -5e-5 * f64::from(tick);
        let counted = measure(|| {
            handle.exchange(x, DVec3::ZERO, TICK);
        });
        assert_eq!(counted.count_total, 0);
    }
    assert!(handle.felt().force.z > 0.1);
}

#[test]
fn what_cannot_be_held_is_named() {
    let (mut simulation, body, patch) = block_with(0, Precision::F64, Integrator::Safe, true);
    let mut stiff = ball(0.0).with_spring(1.0);
    stiff.local_stiffness = true;
    for (tool, what) in [
        (ball(0.0).with_spring(0.0), "its spring is 0 N/m: it must be positive and finite"),
        (ball(0.0).with_spring(f64::NAN), "its spring is NaN N/m"),
        (
            ball(0.0).exactly().with_spring(1.0),
            "a tool with exact contact cannot be held by a spring",
        ),
        (stiff, "a local stiffness"),
    ] {
        let error = simulation.add_tool(tool).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
    let own = simulation.add_tool(ball(0.0)).unwrap();
    let mut path = ball(0.0);
    path.motion = ToolMotion::Translate(DVec3::Z, Curve::Constant);
    let path = simulation.add_tool(path).unwrap();
    let exact = simulation.add_tool(ball(0.0).exactly()).unwrap();
    let good = HapticOptions::of_tool(own);
    for (options, what) in [
        (
            HapticOptions { body, vertices: patch.clone(), ..good.clone() },
            "it holds vertices and a tool",
        ),
        (
            HapticOptions { tool: Some(path), ..good.clone() },
            "it moves by a path or curve of its own",
        ),
        (
            HapticOptions { tool: Some(exact), ..good.clone() },
            "a tool with exact contact cannot be held",
        ),
        (HapticOptions { stiffness: -1.0, ..good.clone() }, "stiffness is -1 N/m"),
    ] {
        let error = simulation.haptic_handle(options).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
    // nothing was changed by it
    assert_eq!(simulation.world().get::<Tool>(exact).unwrap().spring, None);
    let (mut tissue, _device) = simulation.haptic_handle(good.clone()).unwrap();
    assert!(simulation.remove_contact(own));
    let error = tissue.step(&mut simulation).unwrap_err();
    assert!(matches!(error, HapticError::Released(_)), "{error}");
    let error = simulation.haptic_handle(good).unwrap_err();
    assert!(matches!(error, HapticError::Tool(ToolError::NoTool(_))), "{error}");
}
