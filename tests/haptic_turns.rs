//! Devices that turn the patch that they hold, in six directions.

#![allow(clippy::print_stdout, reason = "figures beside their bars are shown")]

use crate::common::random_numbers;
use crate::haptics::{block, block_with};
use allocation_counter::measure;
use glam::{DMat3, DQuat, DVec3};
use sinew::engine::mesh::generate::box_tets;
use sinew::haptics::{
    DeviceMotion, Feedback, HapticDevice, HapticOptions, HapticReport, HapticTissue,
};
use sinew::prelude::*;

/// A cycle of the device (s).
const TICK: f64 = 1e-3;

fn at(position: DVec3, turn: DVec3) -> DeviceMotion {
    DeviceMotion { position, rotation: DQuat::from_scaled_axis(turn), ..DeviceMotion::default() }
}

/// A handle that turns its patch in a block of liver on a table.
fn turning(
    precision: Precision,
    integrator: Integrator,
) -> (Simulation, HapticTissue, HapticDevice, BodyHandle) {
    let (mut simulation, body, patch) = block(precision, integrator, true);
    let options = HapticOptions { turns: true, ..HapticOptions::new(body, patch) };
    let (tissue, device) = simulation.haptic_handle(options).unwrap();
    (simulation, tissue, device, body)
}

/// Equilibria for hands that are moved and turned a little further, far from rest, against the model.
#[test]
fn the_local_model_is_what_equilibria_differ_by() {
    for precision in [Precision::F64, Precision::F32] {
        let (mut simulation, mut tissue, mut device, _) =
            turning(precision, Integrator::QuasiStatic);
        let mut settle = |x: DVec3, turn: DVec3| {
            device.exchange_pose(&at(x, turn), TICK);
            tissue.step(&mut simulation).unwrap()
        };
        settle(DVec3::ZERO, DVec3::ZERO);
        let places = [
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::new(0.012, -0.006, 0.018), DVec3::new(0.2, 0.1, -0.3)),
            (DVec3::new(0.0, 0.01, -0.01), DVec3::new(-0.4, 0.0, 0.3)),
        ];
        for (x, turn) in places {
            check_model(&mut settle, x, turn, &format!("{precision:?}"));
        }
    }
}

/// Differences of equilibria about a place (m) and turn (rad) of the hand against the model there, within a hundredth.
fn check_model(
    settle: &mut dyn FnMut(DVec3, DVec3) -> HapticReport,
    x: DVec3,
    turn: DVec3,
    what: &str,
) {
    let found = settle(x, turn).compliance;
    assert!(found.solved && !found.with_inertia, "{found:?}");
    // about axes of the world
    let turned =
        |by: DVec3| (DQuat::from_scaled_axis(by) * DQuat::from_scaled_axis(turn)).to_scaled_axis();
    // of the way of the patch's rim about as much as that of the hand
    let (step, angle) = (2e-4, 0.01);
    let mut worst = [[0.0_f64; 2]; 2];
    let mut size = worst;
    for axis in 0..6 {
        let (kind, e) = (axis / 3, DVec3::AXES[axis % 3]);
        let h = [step, angle][kind];
        let mut side = |sign: f64| match kind {
            0 => settle(x + sign * h * e, turn),
            _ => settle(x, turned(sign * h * e)),
        };
        let [plus, minus] = [side(1.0), side(-1.0)];
        let exact = [plus.force - minus.force, plus.torque - minus.torque];
        for (row, exact) in exact.map(|change| -change / (2.0 * h)).into_iter().enumerate() {
            let own: DMat3 = found.stiffness[row][kind];
            let off = own.col(axis % 3).distance(exact);
            worst[row][kind] = worst[row][kind].max(off);
            size[row][kind] = size[row][kind].max(exact.length());
        }
    }
    println!("{what} at {x}, {turn}: off {worst:?} of {size:?}, {} iterations", found.iterations);
    // of what forces and torques of the same work have: couplings of both may be as good as nothing
    for row in 0..2 {
        for kind in 0..2 {
            let whole = (size[row][row] * size[kind][kind]).sqrt();
            assert!(worst[row][kind] < 0.01 * whole, "{what} at {x}, {turn}");
        }
    }
    assert!(size[0][0] > 50.0 && size[1][1] > 5e-3, "{size:?}");
}

/// Right through the block beside the middle of the patch, from above to 15 mm over the table: it parts what the hand holds.
const BLADE: [[DVec3; 2]; 2] = [
    [DVec3::new(0.0657, -0.05, 0.2), DVec3::new(0.0613, -0.05, 0.015)],
    [DVec3::new(0.0657, 0.2, 0.2), DVec3::new(0.0613, 0.2, 0.015)],
];

/// Before and after a cut through the patch, and with a tool that the tissue touches.
#[test]
fn the_local_model_knows_cuts_and_contacts() {
    let places = [
        (DVec3::ZERO, DVec3::ZERO),
        (DVec3::new(0.003, -0.002, 0.004), DVec3::new(0.1, 0.05, -0.15)),
    ];
    let whole = {
        let (mut simulation, mut tissue, mut device, _) =
            turning(Precision::F64, Integrator::QuasiStatic);
        device.exchange_pose(&at(DVec3::ZERO, DVec3::ZERO), TICK);
        tissue.step(&mut simulation).unwrap().compliance
    };
    for precision in [Precision::F64, Precision::F32] {
        let (mut simulation, body, patch) =
            block_with(600, precision, Integrator::QuasiStatic, true);
        let options = HapticOptions { turns: true, ..HapticOptions::new(body, patch) };
        let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
        let mut settle = |x: DVec3, turn: DVec3| {
            device.exchange_pose(&at(x, turn), TICK);
            tissue.step(&mut simulation).unwrap()
        };
        check_model(&mut settle, DVec3::ZERO, DVec3::ZERO, &format!("first, {precision:?}"));
        assert!(simulation.cut(body, &BLADE).unwrap().copies.len() > 50);
        let mut settle = |x: DVec3, turn: DVec3| {
            device.exchange_pose(&at(x, turn), TICK);
            tissue.step(&mut simulation).unwrap()
        };
        for (x, turn) in places {
            check_model(&mut settle, x, turn, &format!("cut, {precision:?}"));
        }
        let open = settle(DVec3::ZERO, DVec3::ZERO).compliance;
        let change = (open.stiffness[1][1] - whole.stiffness[1][1]).y_axis.length();
        assert!(change > 0.02 * whole.stiffness[1][1].y_axis.length(), "{open:?} {whole:?}");
    }
    for precision in [Precision::F64, Precision::F32] {
        let (mut simulation, body, patch) = block(precision, Integrator::QuasiStatic, true);
        let options = HapticOptions { turns: true, ..HapticOptions::new(body, patch) };
        let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
        // 4 mm into its side, below the patch
        let ball = Shape::Sphere { radius: 0.02 };
        let ball = Tool::new("ball", ball, DVec3::new(0.136, 0.06, 0.045));
        let ball = simulation.add_tool(ball).unwrap();
        let mut settle = |x: DVec3, turn: DVec3| {
            device.exchange_pose(&at(x, turn), TICK);
            let report = tissue.step(&mut simulation).unwrap();
            assert!(simulation.tool_report(ball).unwrap().force.length() > 0.05);
            report
        };
        for (x, turn) in places {
            check_model(&mut settle, x, turn, &format!("touched, {precision:?}"));
        }
    }
}

/// A device that turns about its middle: a moment of inertia (kg m^2), forces that come some cycles late, an encoder.
struct Turner {
    inertia: f64,
    damping: f64,
    rotation: DQuat,
    spin: DVec3,
    late: std::collections::VecDeque<DVec3>,
    measured: (DQuat, DVec3),
    /// Where somebody moves it (m), and how fast (m/s).
    moved: [DVec3; 2],
    /// Stiffness (N m) and damping (N m s) of a hand, and the turn (rad) that it wants.
    hand: ([f64; 2], DVec3),
}

impl Turner {
    fn new(inertia: f64, damping: f64, delay: usize) -> Self {
        let late = vec![DVec3::ZERO; delay].into();
        let measured = (DQuat::IDENTITY, DVec3::ZERO);
        let (moved, hand) = ([DVec3::ZERO; 2], ([0.0; 2], DVec3::ZERO));
        let (rotation, spin) = (DQuat::IDENTITY, DVec3::ZERO);
        Self { inertia, damping, rotation, spin, late, measured, moved, hand }
    }

    /// A cycle; where somebody holds it, it stays there.
    fn go(&mut self, held: Option<DVec3>, handle: &mut HapticDevice) -> Feedback {
        if let Some(turn) = held {
            (self.rotation, self.spin) = (DQuat::from_scaled_axis(turn), DVec3::ZERO);
        }
        // 16 bits over two radians, and a filter of a millisecond
        let count = 2.0 / 65536.0;
        let read =
            DQuat::from_scaled_axis((self.rotation.to_scaled_axis() / count).round() * count);
        let (before, spin) = self.measured;
        let rate = (read * before.inverse()).to_scaled_axis() / TICK;
        let spin = spin + (1.0 - (-1.0_f64).exp()) * (rate - spin);
        self.measured = (read, spin);
        let [position, velocity] = self.moved;
        let motion = DeviceMotion { position, velocity, rotation: read, angular_velocity: spin };
        let felt = handle.exchange_pose(&motion, TICK);
        self.late.push_back(felt.torque);
        let torque = self.late.pop_front().unwrap_or_default();
        let h = TICK / 20.0;
        let ([stiffness, damping], wish) = self.hand;
        for _ in 0..if held.is_some() { 0 } else { 20 } {
            let hand = stiffness * (wish - self.rotation.to_scaled_axis()) - damping * self.spin;
            self.spin += h / self.inertia * (torque + hand - self.damping * self.spin);
            self.rotation = DQuat::from_scaled_axis(h * self.spin) * self.rotation;
        }
        felt
    }
}

/// Turned by half a radian and let go: it comes back, and gets no energy.
#[test]
fn a_device_that_is_let_go_comes_to_rest() {
    let turn = DVec3::new(0.2, -0.25, 0.4);
    // as light and as heavy as the masses of the devices that do not turn
    for (inertia, delay) in [(1e-5, 1), (1e-5, 2), (2e-5, 1), (2e-5, 2)] {
        let (mut simulation, mut tissue, mut handle, _) = turning(Precision::F64, Integrator::Safe);
        let mut device = Turner::new(inertia, 1e-5, delay);
        let (mut felt, mut drawn, mut least) = (Feedback::default(), 0.0, 0.0_f64);
        let mut late = 0.0_f64;
        for tick in 0..3000 {
            if tick % 10 == 0 {
                tissue.step(&mut simulation).unwrap();
            }
            let part = (f64::from(tick) / 500.0).min(1.0);
            let held = (tick < 1000).then(|| part * part * (3.0 - 2.0 * part) * turn);
            felt = device.go(held, &mut handle);
            if tick == 999 {
                drawn = felt.torque.length();
            }
            least = least.min(felt.energy);
            if tick >= 2500 {
                late = late.max(device.rotation.to_scaled_axis().length());
            }
        }
        println!(
            "{inertia} kg m^2, {delay} ms: drawn {drawn:.4} N m, left {late:.2e} rad, least {least:.2e} J, dampings {}",
            felt.dampings
        );
        assert!(drawn > 5e-3, "{drawn} N m");
        assert!(late < 2e-3 * turn.length(), "{late} rad");
        assert!(least >= -1e-4, "{least} J");
        assert!(felt.force.is_finite() && !felt.flags.bad_input);
    }
}

/// A hand that moves and turns a device at random, at so many steps a second with one of latency; `at` is called before each step.
/// Nothing becomes anything but a number, and the device gets no energy.
fn at_random(
    (mut simulation, mut tissue, mut handle): (Simulation, HapticTissue, HapticDevice),
    rate: u64,
    what: &str,
    at: &mut dyn FnMut(u64, &mut Simulation),
) {
    simulation.set_dt(1.0 / rate as f64);
    let mut next = random_numbers(11);
    let mut chance = move || DVec3::from([0; 3].map(|_| next(2001) as f64 * 1e-3 - 1.0));
    let mut device = Turner::new(1e-5, 1e-5, 1);
    // as stiff as a hand of 100 N/m at 1 cm
    device.hand.0 = [1e-2, 2e-4];
    let (mut aim, mut turn, mut steps) = (DVec3::ZERO, DVec3::ZERO, None);
    let (mut least, mut peak, mut furthest) = (0.0_f64, [0.0_f64; 2], 0.0_f64);
    for tick in 0..10_000 {
        if tick % 200 == 0 {
            (aim, turn) = (0.008 * chance(), 0.5 * chance());
        }
        device.hand.1 += (turn - device.hand.1) * (TICK / 0.06);
        let way = (aim - device.moved[0]) * (TICK / 0.06);
        device.moved = [device.moved[0] + way, way / TICK];
        let due = tick * rate / 1000;
        if steps != Some(due) {
            if steps.is_some() {
                tissue.after_step(&mut simulation).unwrap();
            }
            at(due, &mut simulation);
            tissue.before_step(&mut simulation).unwrap();
            simulation.step().unwrap();
            steps = Some(due);
        }
        let felt = device.go(None, &mut handle);
        least = least.min(felt.energy);
        peak = [peak[0].max(felt.force.length()), peak[1].max(felt.torque.length())];
        furthest = furthest.max(device.rotation.to_scaled_axis().length());
        assert!(felt.force.is_finite() && felt.torque.is_finite(), "{what}: {felt:?}");
        assert!(felt.energy.is_finite() && !felt.flags.bad_input, "{what}: {felt:?}");
    }
    let felt = handle.felt();
    println!(
        "{what}, {rate}: least {least:.2e} J, end {:.2e} J, peaks {peak:?}, furthest {furthest:.3} rad, dampings {}",
        felt.energy, felt.dampings
    );
    assert!(simulation.positions(BodyHandle(0)).iter().all(|x| x.is_finite()));
    assert!(peak[0] > 0.1 && peak[1] > 1e-3 && furthest > 0.1, "{what}: {peak:?} {furthest}");
    assert!(least >= -1e-4, "{what}, {rate}: {least} J");
}

fn hold(
    (mut simulation, body, patch): (Simulation, BodyHandle, Vec<u32>),
) -> (Simulation, HapticTissue, HapticDevice) {
    let options = HapticOptions { turns: true, ..HapticOptions::new(body, patch) };
    let (tissue, device) = simulation.haptic_handle(options).unwrap();
    (simulation, tissue, device)
}

#[test]
fn a_device_that_turns_gets_no_energy_when_its_tissue_is_cut() {
    for rate in [60, 100] {
        let block = block_with(600, Precision::F64, Integrator::Safe, true);
        let (body, mut copies) = (block.1, 0);
        at_random(hold(block), rate, "cut", &mut |step, simulation| {
            if step == 3 * rate {
                copies = simulation.cut(body, &BLADE).unwrap().copies.len();
            }
        });
        assert!(copies > 50, "{copies}");
    }
}

/// Steps in which a thing that is touched feels nothing, and others.
fn both(touched: &mut [u32; 2], force: Option<DVec3>) {
    touched[usize::from(force.is_some_and(|force| force.length() > 1e-3))] += 1;
}

#[test]
fn a_device_that_turns_gets_no_energy_beside_a_rigid_tool() {
    for rate in [60, 100] {
        let mut block = block(Precision::F64, Integrator::Safe, true);
        let wall = Tool::ground("wall", DVec3::X * 0.1202, -DVec3::X).with_friction(0.3);
        let (wall, mut touched) = (block.0.add_tool(wall).unwrap(), [0; 2]);
        at_random(hold(block), rate, "touched", &mut |_, simulation| {
            both(&mut touched, simulation.tool_report(wall).map(|own| own.force));
        });
        assert!(touched[0] > 20 && touched[1] > 20, "{touched:?}");
    }
}

#[test]
fn a_device_that_turns_gets_no_energy_beside_another_body() {
    for rate in [60, 100] {
        let mut block = block(Precision::F64, Integrator::Safe, true);
        let mesh = box_tets(DVec3::new(0.05, 0.12, 0.06), [2, 5, 3]).unwrap();
        let mesh = mesh.transformed(1.0, DQuat::IDENTITY, DVec3::X * 0.1202);
        let (simulation, body) = (&mut block.0, block.1);
        let other = BodyDescription::new("other", &mesh, preset("liver").unwrap().material);
        let other = simulation.add_body(&other).unwrap();
        let low = simulation.group_rows(other, &mesh, "z0").unwrap();
        simulation.add_constraint(Constraint::hold("other", low));
        let pair = simulation.add_body_contact(BodyContact::new("pair", [body, other]));
        let mut touched = [0; 2];
        at_random(hold(block), rate, "beside", &mut |_, simulation| {
            both(&mut touched, simulation.body_contact_report(pair).map(|own| own.force));
        });
        assert!(touched[0] > 20 && touched[1] > 20, "{touched:?}");
    }
}

#[test]
fn a_device_that_turns_gets_no_energy_from_a_body_that_nothing_else_holds() {
    for rate in [60, 100] {
        let block = block(Precision::F64, Integrator::Safe, false);
        at_random(hold(block), rate, "free", &mut |_, _| ());
    }
}

/// Beside the same scene, stepped at a kilohertz with the device in every step, while it turns by 0.3 rad and moves by 5 mm.
#[test]
fn torques_are_those_of_a_simulation_at_a_kilohertz() {
    let path = |t: f64| {
        let part = t.min(1.0);
        let swing = part * part * (3.0 - 2.0 * part) * (std::f64::consts::TAU * t).sin();
        (DVec3::new(3e-3, 0.0, 4e-3) * swing, DVec3::new(0.1, 0.2, -0.2) * swing)
    };
    let motion = |tick: u32| {
        let (t, h) = (f64::from(tick) * TICK, 1e-6);
        let ([x, turn], [y, next]) = (<[DVec3; 2]>::from(path(t)), <[DVec3; 2]>::from(path(t + h)));
        let ahead = DQuat::from_scaled_axis(next) * DQuat::from_scaled_axis(turn).inverse();
        DeviceMotion {
            velocity: (y - x) / h,
            angular_velocity: ahead.to_scaled_axis() / h,
            ..at(x, turn)
        }
    };
    let run = |cycles: u32| {
        let (mut simulation, mut tissue, mut handle, _) = turning(Precision::F64, Integrator::Safe);
        simulation.set_dt(f64::from(cycles) * TICK);
        let mut felt = Vec::new();
        for tick in 0..2500 {
            let own = handle.exchange_pose(&motion(tick), TICK);
            if tick % cycles == 0 {
                tissue.before_step(&mut simulation).unwrap();
                simulation.step().unwrap();
                tissue.after_step(&mut simulation).unwrap();
            }
            felt.push((own.force, own.torque));
        }
        felt
    };
    let (exact, felt) = (run(1), run(16));
    let root = |values: &dyn Fn(usize) -> f64| {
        ((400..2500).map(|i| values(i).powi(2)).sum::<f64>() / 2100.0).sqrt()
    };
    let peak = exact
        .iter()
        .fold((0.0_f64, 0.0_f64), |(f, t), own| (f.max(own.0.length()), t.max(own.1.length())));
    let force = root(&|i| felt[i].0.distance(exact[i].0)) / peak.0;
    let torque = root(&|i| felt[i].1.distance(exact[i].1)) / peak.1;
    println!("peaks {peak:?}, errors {:.2} and {:.2} %", 100.0 * force, 100.0 * torque);
    assert!(peak.0 > 0.1 && peak.1 > 2e-3, "{peak:?}");
    assert!(force <= 0.05 && torque <= 0.05, "{force}, {torque}");
}

/// Turning a patch with the hand that holds it is turning the frame of all of it.
#[test]
fn a_block_that_nothing_holds_turns_with_the_hand() {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, false);
    let options = HapticOptions { turns: true, ..HapticOptions::new(body, patch) };
    let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
    let before = simulation.positions(body);
    for step in 0..300 {
        let turn = DVec3::Z * (0.01 * f64::from(step)).min(1.0);
        device.exchange_pose(&at(DVec3::ZERO, turn), 0.01);
        tissue.step(&mut simulation).unwrap();
    }
    let after = simulation.positions(body);
    let turned = |x: DVec3| DQuat::from_rotation_z(1.0) * x;
    let (a, b) = (before[0], before[before.len() - 1]);
    let off = (after[after.len() - 1] - after[0]).distance(turned(b - a));
    assert!(off < 0.02 * a.distance(b), "{off}");
}

/// Orientations of drivers are as exact as `f32`, and some cycles tell none.
#[test]
fn a_device_that_tells_no_turn_stays_as_it_is_turned() {
    let (mut simulation, mut tissue, mut device, _) = turning(Precision::F64, Integrator::Safe);
    let start = DQuat::from_rotation_x(0.7) * (1.0 + 3e-7);
    for step in 0..40 {
        let turn = DQuat::from_rotation_z(0.01 * f64::from(step)) * start;
        let motion = DeviceMotion { rotation: turn, ..DeviceMotion::default() };
        let told = device.exchange_pose(&motion, TICK);
        for _ in 0..20 {
            let felt = device.exchange(DVec3::ZERO, DVec3::ZERO, 1e-9);
            assert!(!felt.flags.bad_input, "{felt:?}");
            assert!((felt.torque - told.torque).length() < 1e-6, "{felt:?}");
        }
        tissue.step(&mut simulation).unwrap();
    }
    assert!(device.felt().torque.z < -1e-3, "{:?}", device.felt());
}

/// Before a model is found, the patch counts as held: hand and torque have the full springs.
#[test]
fn a_model_that_is_not_found_is_that_of_a_patch_that_is_held() {
    let (mut simulation, mut tissue, mut device, _) = turning(Precision::F64, Integrator::Safe);
    let settings = SolverSettings { max_linear_iterations: 1, ..SolverSettings::default() };
    simulation.set_solver(SolverSettings { integrator: Integrator::Safe, ..settings });
    device.exchange_pose(&at(DVec3::ZERO, DVec3::ZERO), TICK);
    let found = tissue.step(&mut simulation).unwrap().compliance;
    assert!(!found.solved && found.gain == DMat3::ZERO, "{found:?}");
    let spring = found.stiffness[0][0] - DMat3::from_diagonal(DVec3::splat(300.0));
    assert!(spring.to_cols_array().iter().all(|x| x.abs() < 1e-9), "{found:?}");
    assert!(found.stiffness[1][1].z_axis.z > 0.01 && found.arms.z_axis.z > 1e-5, "{found:?}");
}

/// No number of a driver stops the simulation.
#[test]
fn a_spin_beyond_measure_stops_no_step() {
    let (mut simulation, mut tissue, mut device, _) = turning(Precision::F64, Integrator::Safe);
    let angular_velocity = DVec3::splat(1e200);
    let motion = DeviceMotion { angular_velocity, ..at(DVec3::ZERO, DVec3::ZERO) };
    for _ in 0..3 {
        let felt = device.exchange_pose(&motion, TICK);
        assert!(felt.torque.is_finite() && felt.energy.is_finite(), "{felt:?}");
        tissue.step(&mut simulation).unwrap();
    }
}

#[test]
fn a_handle_that_does_not_turn_feels_no_turns() {
    let run = |turn: DVec3| {
        let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
        let options = HapticOptions::new(body, patch);
        let (mut tissue, mut device) = simulation.haptic_handle(options).unwrap();
        let mut all = Vec::new();
        for step in 0..5 {
            let x = DVec3::Z * 1e-3 * f64::from(step);
            let motion = DeviceMotion { velocity: DVec3::Z, ..at(x, turn * f64::from(step)) };
            let felt = match turn == DVec3::ZERO {
                true => device.exchange(x, DVec3::Z, 0.01),
                false => device.exchange_pose(&motion, 0.01),
            };
            assert_eq!(felt.torque, DVec3::ZERO);
            all.push((felt, tissue.step(&mut simulation).unwrap().force));
        }
        all
    };
    assert_eq!(run(DVec3::ZERO), run(DVec3::new(0.1, 0.2, 0.3)));
}

#[test]
fn torques_are_limited_and_bad_rotations_give_none() {
    let (mut simulation, mut tissue, mut device, body) = turning(Precision::F64, Integrator::Safe);
    for step in 0..60 {
        let turn = DVec3::X * (0.05 * f64::from(step)).min(1.5);
        let felt = device.exchange_pose(&at(DVec3::ZERO, turn), 0.01);
        assert!(felt.torque.length() <= 0.1 + 1e-12, "{felt:?}");
        tissue.step(&mut simulation).unwrap();
    }
    let felt = device.felt();
    assert!(felt.torque.x < -0.01, "{felt:?}");
    let good = at(DVec3::ZERO, DVec3::X);
    for bad in [
        DeviceMotion { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
        DeviceMotion { rotation: good.rotation * 1.1, ..good },
        DeviceMotion { rotation: DQuat::NAN, ..good },
        DeviceMotion { angular_velocity: DVec3::NAN, ..good },
    ] {
        let felt = device.exchange_pose(&bad, TICK);
        let none = [felt.force, felt.torque] == [DVec3::ZERO; 2];
        assert!(felt.flags.bad_input && none && felt.energy.is_finite(), "{felt:?}");
    }
    let felt = device.exchange_pose(&good, TICK);
    assert!(!felt.flags.bad_input && felt.flags.rising, "{felt:?}");
    let counted = measure(|| {
        device.exchange_pose(&good, TICK);
    });
    assert_eq!(counted.count_total, 0);
    let vertices = vec![0];
    let none = HapticOptions::new(body, vertices);
    for (options, text) in [
        (HapticOptions { torque_limit: 0.0, ..none.clone() }, "torque_limit is 0 N m"),
        (HapticOptions { device_inertia: -1.0, ..none.clone() }, "device_inertia is -1 kg m^2"),
    ] {
        let error = simulation.haptic_handle(options).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    }
}
