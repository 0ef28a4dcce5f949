//! Devices that turn the patch that they hold, in six directions.

#![allow(clippy::print_stdout, reason = "figures beside their bars are shown")]

use crate::haptics::block;
use allocation_counter::measure;
use glam::{DMat3, DQuat, DVec3};
use sinew::haptics::{DeviceMotion, Feedback, HapticDevice, HapticOptions, HapticTissue};
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
            let found = settle(x, turn).compliance;
            assert!(found.solved && !found.with_inertia, "{found:?}");
            // about axes of the world
            let turned = |by: DVec3| {
                (DQuat::from_scaled_axis(by) * DQuat::from_scaled_axis(turn)).to_scaled_axis()
            };
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
                for (row, exact) in exact.map(|change| -change / (2.0 * h)).into_iter().enumerate()
                {
                    let own: DMat3 = found.stiffness[row][kind];
                    let off = own.col(axis % 3).distance(exact);
                    worst[row][kind] = worst[row][kind].max(off);
                    size[row][kind] = size[row][kind].max(exact.length());
                }
            }
            println!(
                "{precision:?} at {x}, {turn}: off {worst:?} of {size:?}, {} iterations",
                found.iterations
            );
            // of what forces and torques of the same work have: couplings of both may be as good as nothing
            for row in 0..2 {
                for kind in 0..2 {
                    let whole = (size[row][row] * size[kind][kind]).sqrt();
                    assert!(worst[row][kind] < 0.01 * whole, "{precision:?} at {x}, {turn}");
                }
            }
            assert!(size[0][0] > 50.0 && size[1][1] > 5e-3, "{size:?}");
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
}

impl Turner {
    fn new(inertia: f64, damping: f64, delay: usize) -> Self {
        let late = vec![DVec3::ZERO; delay].into();
        let measured = (DQuat::IDENTITY, DVec3::ZERO);
        Self { inertia, damping, rotation: DQuat::IDENTITY, spin: DVec3::ZERO, late, measured }
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
        let motion = DeviceMotion { rotation: read, angular_velocity: spin, ..Default::default() };
        let felt = handle.exchange_pose(&motion, TICK);
        self.late.push_back(felt.torque);
        let torque = self.late.pop_front().unwrap_or_default();
        let h = TICK / 20.0;
        for _ in 0..if held.is_some() { 0 } else { 20 } {
            self.spin += h / self.inertia * (torque - self.damping * self.spin);
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
