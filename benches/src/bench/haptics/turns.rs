//! Devices that turn the patch that they hold: force and torque beside the same liver stepped at a kilohertz, and whether such devices
//! come to rest and get no energy.

use super::{
    ALONG, CLOSED, COUPLING, CYCLE, Chance, Coupling, Rig, SECOND, WAYS, devices, errors,
    held_vertices, liver, smooth,
};
use crate::toolbox::aim::BenchAim;
use crate::toolbox::prelude::*;
use glam::DQuat;
use sinew::engine::load::Pose;
use sinew::haptics::simulated::SimulatedDevice;
use sinew::haptics::{DeviceMotion, HapticOptions};
use std::collections::VecDeque;

/// Turn (rad) of the hand for its way (m): 0.3 rad at 10 mm.
const TURN: DVec3 = DVec3::new(10.0, 20.0, -20.0);
/// Step (rad) of the encoder: 16 bits over two radians.
const COUNT: f64 = 2.0 / 65536.0;
/// Stiffness (N m) and damping (N m s) of a hand: those of a hand that moves, at 1 cm.
const HAND: [f64; 2] = [1e-2, 2e-4];
/// Parts of a cycle in which turns are integrated.
const PARTS: u32 = 20;

/// How a simulated device turns: a moment of inertia (kg m^2) with a damper (N m s) that renders torques some cycles late.
struct Turner {
    inertia: f64,
    damping: f64,
    hand: [f64; 2],
    /// Turn (rad) that the hand wants.
    wish: DVec3,
    rotation: DQuat,
    spin: DVec3,
    late: VecDeque<DVec3>,
    measured: (DQuat, DVec3),
}

impl Turner {
    /// Beside a device that moves: as heavy, as much damped and as late as that one, at 1 cm or so.
    fn beside(device: &SimulatedDevice, delay: usize) -> Self {
        Self {
            inertia: 2e-4 * device.mass,
            damping: 1e-4 * device.damping,
            hand: if device.hand.is_some() { HAND } else { [0.0; 2] },
            wish: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            spin: DVec3::ZERO,
            late: vec![DVec3::ZERO; delay].into(),
            measured: (DQuat::IDENTITY, DVec3::ZERO),
        }
    }

    /// Orientation by the encoder, and angular velocity (rad/s) by a filter of a millisecond.
    fn measure(&mut self) -> (DQuat, DVec3) {
        let read =
            DQuat::from_scaled_axis((self.rotation.to_scaled_axis() / COUNT).round() * COUNT);
        let (before, spin) = self.measured;
        let rate = (read * before.inverse()).to_scaled_axis() / CYCLE;
        self.measured = (read, spin + (1.0 - libm::exp(-1.0)) * (rate - spin));
        self.measured
    }

    /// A cycle in which it goes where the torques take it.
    fn go(&mut self, torque: DVec3) {
        self.late.push_back(torque);
        let torque = self.late.pop_front().unwrap_or_default();
        let h = CYCLE / f64::from(PARTS);
        let [stiffness, damping] = self.hand;
        for _ in 0..PARTS {
            let hand =
                stiffness * (self.wish - self.rotation.to_scaled_axis()) - damping * self.spin;
            self.spin += h / self.inertia * (torque + hand - self.damping * self.spin);
            self.rotation = DQuat::from_scaled_axis(h * self.spin) * self.rotation;
        }
    }

    fn put(&mut self, turn: DVec3) {
        (self.rotation, self.spin) = (DQuat::from_scaled_axis(turn), DVec3::ZERO);
    }
}

/// The liver with a handle that turns.
fn rig(mesh: &Mesh, rate: u64, damping: f64) -> Result<Rig> {
    let (mut simulation, body) = liver(mesh)?;
    simulation.set_dt(1.0 / rate as f64);
    let own = HapticOptions::new(body, held_vertices(mesh));
    let options = HapticOptions { stiffness: COUPLING[0], damping, turns: true, ..own };
    let coupling = Coupling::Handle(Box::new(simulation.haptic_handle(options)?));
    let (x, told) = (DVec3::ZERO, [DVec3::ZERO; 2]);
    let (tick, steps, failed, iterations) = (0, 0, false, 0);
    Ok(Rig { simulation, coupling, rate, tick, steps, x, told, failed, iterations })
}

/// Force (N) and torque (N m) of the handle.
fn feel(rig: &mut Rig, motion: &DeviceMotion, seconds: f64) -> [DVec3; 2] {
    match &mut rig.coupling {
        Coupling::Handle(both) => {
            let felt = both.1.exchange_pose(motion, seconds);
            [felt.force, felt.torque]
        }
        Coupling::Spring(_) | Coupling::Proxy { .. } => [DVec3::ZERO; 2],
    }
}

/// A cycle of a device: force and torque that were felt.
fn cycle(
    rig: &mut Rig,
    (device, turner): (&mut SimulatedDevice, &mut Turner),
    put: Option<(DVec3, DVec3)>,
) -> [DVec3; 2] {
    rig.cycle();
    if let Some((_, turn)) = put {
        turner.put(turn);
    }
    let (rotation, angular_velocity) = turner.measure();
    let mut felt = [DVec3::ZERO; 2];
    let exchange = |position, velocity, seconds| {
        let motion = DeviceMotion { position, velocity, rotation, angular_velocity };
        felt = feel(rig, &motion, seconds);
        felt[0]
    };
    match put {
        Some((x, _)) => device.put(x, exchange),
        None => {
            device.go(exchange);
            turner.go(felt[1]);
        }
    }
    felt
}

/// Forces and torques along a way, cycle by cycle, of a handle without a damper; whether the simulation failed.
fn felt(mesh: &Mesh, rate: u64, way: fn(f64) -> f64) -> Result<([Vec<DVec3>; 2], bool)> {
    let mut rig = rig(mesh, rate, 0.0)?;
    let mut device = SimulatedDevice::new(0.05, 0.1, 0);
    let mut turner = Turner::beside(&device, 0);
    let mut all = [Vec::new(), Vec::new()];
    for tick in 0..5 * SECOND / 2 {
        let x = way(tick as f64 * CYCLE);
        let own = cycle(&mut rig, (&mut device, &mut turner), Some((x * ALONG, x * TURN)));
        all.iter_mut().zip(own).for_each(|(all, own)| all.push(own));
    }
    Ok((all, rig.failed))
}

/// The same of a spring in every step of a millisecond.
fn exact(mesh: &Mesh, way: fn(f64) -> f64) -> Result<[Vec<DVec3>; 2]> {
    let (mut simulation, body) = liver(mesh)?;
    simulation.set_dt(CYCLE);
    let vertices = held_vertices(mesh);
    let at = simulation.positions(body);
    let centre = vertices.iter().map(|&v| at[v as usize]).sum::<DVec3>() / vertices.len() as f64;
    let rows = simulation.rows(body, "tool", &vertices)?;
    let pull = simulation.add_pull(Pull::new("tool", rows, COUPLING[0], 0.0));
    let mut all = [Vec::new(), Vec::new()];
    for tick in 0..5 * SECOND / 2 {
        let x = way(tick as f64 * CYCLE);
        let rotation = DQuat::from_scaled_axis(x * TURN);
        simulation.move_pull(pull, Pose { translation: x * ALONG, rotation, centre });
        simulation.step()?;
        let own = simulation.pull_report(pull).map(|own| [own.force, own.torque]);
        all.iter_mut().zip(own.unwrap_or_default()).for_each(|(all, own)| all.push(own));
    }
    Ok(all)
}

fn peak(values: &[DVec3]) -> f64 {
    values.iter().map(|own| own.length()).fold(0.0, f64::max)
}

/// Errors of forces and torques beside those of a simulation at a kilohertz.
fn accuracy(mesh: &Mesh, aims: &mut Vec<BenchAim>, tell: &mut impl FnMut(&str)) -> Result<Table> {
    let mut rows = Vec::new();
    for (name, way, most) in WAYS {
        tell(&format!("haptics: {name}, with turns"));
        let exact = exact(mesh, way)?;
        for rate in CLOSED {
            let (felt, failed) = felt(mesh, rate, way)?;
            for (kind, (what, unit)) in [("force", 1.0), ("torque", 1e3)].into_iter().enumerate() {
                let [error, jump] = errors(&felt[kind], &exact[kind]);
                let of = format!("{what} with turns, {name}, {rate} steps a second");
                aims.push(BenchAim::at_most(format!("error of {of}"), most, "%", error));
                aims.push(BenchAim::at_most(format!("largest jump of {of}"), 5.0, "%", jump));
                rows.push((name, rate, what, unit * peak(&exact[kind]), error, jump, failed));
            }
        }
    }
    let title = "Force and torque on a hand that moves and turns as given, beside the same liver stepped at 1 kHz";
    let table = table_of!("haptics-turns", title; for (way, rate, what, peak, error, jump, failed) in rows;
        "way" => way, "steps/s" => rate, "of" => what, "peak N, mN m" => peak, "error %" => error, "jump %" => jump,
        "failed" => if failed { "yes" } else { "no" },
    );
    Ok(table.note(
        "As above, without dampers. The hand turns by 0.3 rad for every 10 mm about an oblique axis.",
    ))
}

/// The worst of some devices.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    at_rest: usize,
    /// Furthest way (m) and turn (rad) in the last half second.
    moved: f64,
    turned: f64,
    /// Least energy (J) that a hand that moved at random had given, and largest jumps of force and torque over their peaks.
    energy: f64,
    jump: [f64; 2],
    dampings: u64,
    failed: usize,
}

/// Drawn to 5 mm and turned by 0.15 rad, held, let go for two seconds.
fn let_go(mut rig: Rig, device: &SimulatedDevice, delay: usize, worst: &mut Worst) {
    let (mut device, mut turner) = (device.clone(), Turner::beside(device, delay));
    let way = DVec3::new(0.0, 3.0, 4.0) * 1e-3;
    for tick in 0..SECOND {
        let part = smooth(2.0 * tick as f64 * CYCLE);
        let put = Some((part * way, part * 0.005 * TURN));
        cycle(&mut rig, (&mut device, &mut turner), put);
    }
    let mut places = Vec::new();
    for _ in 0..2 * SECOND {
        cycle(&mut rig, (&mut device, &mut turner), None);
        places.push((device.position, turner.rotation));
    }
    let (end, turn) = (device.position, turner.rotation);
    let last = &places[3 * SECOND as usize / 2..];
    let moved = last.iter().map(|own| own.0.distance(end)).fold(0.0, f64::max);
    let turned = last.iter().map(|own| own.1.angle_between(turn)).fold(0.0, f64::max);
    let is_known = end.is_finite() && turn.is_finite() && !rig.failed;
    let [moved, turned] = [moved, turned].map(|own| if is_known { own } else { f64::INFINITY });
    // 0.2 % of the way and of the turn
    worst.at_rest += usize::from(moved < 1e-5 && turned < 3e-4);
    worst.failed += usize::from(rig.failed);
    (worst.moved, worst.turned) = (worst.moved.max(moved), worst.turned.max(turned));
}

/// A hand that wants to be somewhere else, and turned, every fifth of a second.
fn move_at_random(
    mut rig: Rig,
    device: &SimulatedDevice,
    (delay, seconds): (usize, u64),
    worst: &mut Worst,
) {
    let (mut device, mut turner) = (device.clone(), Turner::beside(device, delay));
    let (mut chance, mut aim, mut turn) = (Chance(7), DVec3::ZERO, DVec3::ZERO);
    let (mut before, mut peaks, mut jumps) = ([DVec3::ZERO; 2], [0.0_f64; 2], [0.0_f64; 2]);
    for tick in 0..seconds * SECOND {
        if tick % (SECOND / 5) == 0 {
            let mut any = || DVec3::from_array([(); 3].map(|()| chance.next()));
            (aim, turn) = (0.012 * any(), 0.5 * any());
        }
        // as an arm: a filter of 60 ms
        device.wish += (aim - device.wish) * (CYCLE / 0.06);
        turner.wish += (turn - turner.wish) * (CYCLE / 0.06);
        let felt = cycle(&mut rig, (&mut device, &mut turner), None);
        for (i, own) in felt.into_iter().enumerate() {
            peaks[i] = peaks[i].max(own.length());
            jumps[i] = jumps[i].max(own.distance(before[i]));
        }
        before = felt;
        if let Coupling::Handle(both) = &rig.coupling {
            let own = both.1.felt().energy;
            worst.energy = worst.energy.min(if own.is_finite() { own } else { f64::NEG_INFINITY });
        }
    }
    for i in 0..2 {
        let jump = jumps[i] / peaks[i];
        worst.jump[i] = worst.jump[i].max(if jump.is_finite() { jump } else { f64::INFINITY });
    }
    worst.failed += usize::from(rig.failed);
    if let Coupling::Handle(both) = &rig.coupling {
        worst.dampings += both.1.felt().dampings;
    }
}

/// Devices that are let go, and hands that move and turn at random.
fn closed_loop(
    mesh: &Mesh,
    seconds: u64,
    aims: &mut Vec<BenchAim>,
    tell: &mut impl FnMut(&str),
) -> Result<Table> {
    let mut rows = Vec::new();
    for rate in CLOSED {
        for hand in [false, true] {
            tell(&format!("haptics: with turns, {rate} steps a second, hand: {hand}"));
            let mut worst = Worst::default();
            let all = devices(hand);
            let count = all.len();
            // delays of 1 and 2 ms take turns in them
            for (device, delay) in all.iter().zip([1, 2].into_iter().cycle()) {
                let_go(rig(mesh, rate, COUPLING[1])?, device, delay, &mut worst);
                if hand {
                    let rig = rig(mesh, rate, COUPLING[1])?;
                    move_at_random(rig, device, (delay, seconds), &mut worst);
                }
            }
            let of = format!("with turns, {rate} steps a second, hand: {hand}");
            let at_rest = worst.at_rest as f64;
            aims.push(BenchAim::at_least(format!("devices at rest, {of}"), 8.0, "", at_rest));
            let failed = worst.failed as f64;
            aims.push(BenchAim::at_most(format!("devices that failed, {of}"), 0.0, "", failed));
            if hand {
                let energy = 1e3 * worst.energy;
                aims.push(BenchAim::at_least(format!("energy, {of}"), -0.1, "mJ", energy));
                for (what, jump) in ["force", "torque"].into_iter().zip(worst.jump) {
                    let jump = 100.0 * jump;
                    aims.push(BenchAim::at_most(format!("jump of {what}, {of}"), 5.0, "%", jump));
                }
            }
            rows.push((rate, hand, count, worst));
        }
    }
    let title = "Eight devices drawn to 5 mm, turned by 0.15 rad and let go; held by a hand, also moved and turned at random";
    let table = table_of!("haptics-turns-loop", title; for (rate, hand, count, w) in rows;
        "steps/s" => rate, "hand" => if hand { "yes" } else { "no" }, "at rest" => format!("{} of {count}", w.at_rest),
        "moved um" => 1e6 * w.moved, "turned mrad" => 1e3 * w.turned, "least energy mJ" => hand.then_some(1e3 * w.energy),
        "jump of force %" => hand.then_some(100.0 * w.jump[0]), "of torque %" => hand.then_some(100.0 * w.jump[1]),
        "dampings" => hand.then_some(w.dampings), "failed" => w.failed,
    );
    Ok(table.note(format!(
        "Devices as above, of 1e-5 and 2e-5 kg m^2, 1e-5 and 1e-4 N m s; hand: 0.01 N m, 2e-4 N m s. The worst of eight. at rest: within \
         10 um and 0.3 mrad from 1.5 to 2 s. energy: what the handle counts. Random motion: {seconds} s each."
    )))
}

/// Accuracy and closed loops.
///
/// # Errors
/// When the liver cannot be stepped.
pub(super) fn run(
    mesh: &Mesh,
    seconds: u64,
    aims: &mut Vec<BenchAim>,
    tell: &mut impl FnMut(&str),
) -> Result<[Table; 2]> {
    Ok([accuracy(mesh, aims, tell)?, closed_loop(mesh, seconds, aims, tell)?])
}
