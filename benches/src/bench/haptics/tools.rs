//! A probe in the hand that comes into touch with the liver and leaves it: forces beside the same liver stepped at a kilohertz, and whether
//! devices that poke it get energy.

use super::{
    CLOSED, COUPLING, CYCLE, Chance, Coupling, Rig, SECOND, devices, errors, held_vertices, liver,
};
use crate::toolbox::aim::BenchAim;
use crate::toolbox::prelude::*;
use bevy_ecs::entity::Entity;
use sinew::haptics::HapticOptions;

/// Radius (m) of the probe.
const RADIUS: f64 = 0.02;
/// How far (m) it is above the liver at first, and how far in it at the end of its way.
const ABOVE: f64 = 0.004;
const INTO: f64 = 0.008;
/// Way (m) of its spring with which its damper acts in full.
const FIRM: f64 = 1e-3;

/// The liver with a probe above the patch that others hold, on a spring; where it is, and the direction down to the liver.
fn probed(mesh: &Mesh) -> Result<(Simulation, Entity, DVec3)> {
    let (mut simulation, body) = liver(mesh)?;
    let at = simulation.positions(body);
    let mean = |of: &mut dyn Iterator<Item = DVec3>, count: usize| of.sum::<DVec3>() / count as f64;
    let patch = held_vertices(mesh);
    let place = mean(&mut patch.iter().map(|&v| at[v as usize]), patch.len());
    let out = (place - mean(&mut at.iter().copied(), at.len())).normalize();
    // the first vertex that it would meet on its way
    let beside = |x: DVec3| {
        let (along, aside) = ((x - place).dot(out), (x - place).reject_from(out).length());
        (aside < RADIUS).then(|| along + (RADIUS * RADIUS - aside * aside).sqrt())
    };
    let touches = at.iter().copied().filter_map(beside).fold(0.0, f64::max);
    let shape = Shape::Sphere { radius: RADIUS };
    let start = place + (touches + ABOVE) * out;
    let tool = simulation.add_tool(Tool::new("probe", shape, start).with_spring(COUPLING[0]))?;
    Ok((simulation, tool, -out))
}

fn rig(mesh: &Mesh, rate: u64) -> Result<(Rig, DVec3)> {
    let (mut simulation, tool, down) = probed(mesh)?;
    simulation.set_dt(1.0 / rate as f64);
    let [stiffness, damping] = COUPLING;
    let options = HapticOptions { stiffness, damping, ..HapticOptions::of_tool(tool) };
    let coupling = Coupling::Handle(Box::new(simulation.haptic_handle(options)?));
    let (x, told) = (DVec3::ZERO, [DVec3::ZERO; 2]);
    let (tick, steps, failed, iterations) = (0, 0, false, 0);
    Ok((Rig { simulation, coupling, rate, tick, steps, x, told, failed, iterations }, down))
}

/// Way (m) down and velocity (m/s) once a second.
fn way(t: f64) -> [f64; 2] {
    let (turn, far) = (std::f64::consts::TAU, 0.5 * (ABOVE + INTO));
    [far * (1.0 - libm::cos(turn * t)), far * turn * libm::sin(turn * t)]
}

/// Forces (N) along the way, of a step for every cycle, with the damper of the device.
fn exact(mesh: &Mesh) -> Result<Vec<DVec3>> {
    let (mut simulation, tool, down) = probed(mesh)?;
    simulation.set_dt(CYCLE);
    let start = simulation.world().get::<Tool>(tool).map_or(DVec3::ZERO, |own| own.start.position);
    let mut all = Vec::new();
    for tick in 0..3 * SECOND {
        let [x, v] = way(tick as f64 * CYCLE);
        simulation.move_tool(tool, start + x * down)?;
        simulation.step()?;
        let force = simulation.tool_report(tool).map_or(DVec3::ZERO, |own| own.force);
        let firm = (force.length() / (COUPLING[0] * FIRM)).min(1.0);
        let damped = force - firm * COUPLING[1] * v * down;
        all.push(damped - damped.dot(down).max(0.0) * down);
    }
    Ok(all)
}

/// What a probe is felt as.
#[derive(Clone, Copy, Debug, Default)]
struct Felt {
    error: f64,
    jump: f64,
    /// Of the cycles in which the exact force is zero.
    silent: f64,
    /// Least energy (J) of devices that poke, their largest jump over the peak or over what may rise at the first contact, furthest way (m) at
    /// rest, and dampings.
    energy: f64,
    poked: f64,
    moved: f64,
    dampings: u64,
    failed: usize,
}

/// A hand that wants the probe elsewhere every fifth of a second, above the liver or in it, and then rests in it.
fn poke(mesh: &Mesh, rate: u64, seconds: u64, felt: &mut Felt) -> Result<()> {
    for mut device in devices(true) {
        let (mut rig, down) = rig(mesh, rate)?;
        let (mut chance, mut aim) = (Chance(7), DVec3::ZERO);
        let (mut before, mut peak, mut jump) = (DVec3::ZERO, 0.0_f64, 0.0_f64);
        let mut last = Vec::new();
        for tick in 0..(seconds + 3) * SECOND {
            if tick < seconds * SECOND && tick % (SECOND / 5) == 0 {
                let aside = DVec3::from_array([(); 3].map(|()| 0.006 * chance.next()));
                aim = aside.reject_from(down) + (ABOVE + INTO * chance.next()) * down;
            } else if tick == seconds * SECOND {
                aim = (ABOVE + INTO) * down;
            }
            device.wish += (aim - device.wish) * (CYCLE / 0.06);
            rig.cycle();
            device.go(|x, v, h| {
                let force = rig.feel(x, v, h);
                peak = peak.max(force.length());
                jump = jump.max(force.distance(before));
                before = force;
                force
            });
            if tick >= (2 * seconds + 5) * SECOND / 2 {
                last.push(device.position);
            }
            if let Coupling::Handle(both) = &rig.coupling {
                felt.energy = felt.energy.min(both.1.felt().energy);
            }
        }
        let moved = last.iter().map(|x| x.distance(device.position)).fold(0.0, f64::max);
        felt.moved = felt.moved.max(moved);
        // 50 N/s at the first contact
        felt.poked = felt.poked.max(jump / (0.05 * peak).max(0.05));
        felt.failed += usize::from(rig.failed);
        if let Coupling::Handle(both) = &rig.coupling {
            felt.dampings += both.1.felt().dampings;
        }
    }
    Ok(())
}

/// Accuracy and closed loops of a probe.
///
/// # Errors
/// When the liver cannot be stepped.
pub(super) fn run(
    mesh: &Mesh,
    seconds: u64,
    aims: &mut Vec<BenchAim>,
    tell: &mut impl FnMut(&str),
) -> Result<Table> {
    tell("haptics: a probe that comes into touch and leaves");
    let exact = exact(mesh)?;
    let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
    let mut rows = Vec::new();
    for rate in CLOSED {
        let (mut rig, down) = rig(mesh, rate)?;
        let mut forces = Vec::new();
        for tick in 0..3 * SECOND {
            rig.cycle();
            let [x, v] = way(tick as f64 * CYCLE);
            forces.push(rig.feel(x * down, v * down, CYCLE));
        }
        let [error, jump] = errors(&forces, &exact);
        let free = exact.iter().zip(&forces).filter(|(own, _)| **own == DVec3::ZERO);
        let silent = free.clone().filter(|(_, own)| **own == DVec3::ZERO).count();
        let silent = silent as f64 / free.count().max(1) as f64;
        let mut felt =
            Felt { error, jump, silent, failed: usize::from(rig.failed), ..Felt::default() };
        tell(&format!("haptics: a probe that is poked about, {rate} steps a second"));
        poke(mesh, rate, seconds.min(10), &mut felt)?;
        let of = format!("of a probe, {rate} steps a second");
        aims.push(BenchAim::at_most(format!("error {of}"), 5.0, "%", error));
        aims.push(BenchAim::at_most(format!("largest jump {of}"), 5.0, "%", jump));
        aims.push(BenchAim::at_least(format!("energy {of}"), -0.1, "mJ", 1e3 * felt.energy));
        aims.push(BenchAim::at_most(format!("jump over what may be {of}"), 1.0, "", felt.poked));
        aims.push(BenchAim::at_most(format!("motion at rest {of}"), 10.0, "um", 1e6 * felt.moved));
        aims.push(BenchAim::at_most(
            format!("devices that failed {of}"),
            0.0,
            "",
            felt.failed as f64,
        ));
        rows.push((rate, felt));
    }
    let title = "A probe on a spring that comes into touch with the liver and leaves it; eight devices in a hand that poke it";
    let table = table_of!("haptics-tools", title; for (rate, w) in rows;
        "steps/s" => rate, "peak N" => peak, "error %" => w.error, "jump %" => w.jump, "silent %" => 100.0 * w.silent,
        "least energy mJ" => 1e3 * w.energy, "jump over what may be" => w.poked, "moved um" => 1e6 * w.moved,
        "dampings" => w.dampings, "failed" => w.failed,
    );
    Ok(table.note(
        "error, jump: as above, of a way of 12 mm once a second, 8 mm of it in the liver. silent: of the cycles in which the exact force is zero. \
         Poked about: the worst of eight; a jump may be 5 % of the peak, or 50 N/s; moved: within the last half second of 3 s in which the hand rests.",
    ))
}
