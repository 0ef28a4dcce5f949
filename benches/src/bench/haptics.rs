//! A haptic device that holds a liver, in simulated time: what it feels beside the same scene stepped at a kilohertz, whether it
//! comes to rest, and what it costs. The handle of the engine takes turns with the two ways that are usual: a spring in the
//! step whose far end stays where it is between steps, and tissue that is held at a proxy whose reaction is fed back.

mod tools;
mod turns;

use crate::toolbox::aim::BenchAim;
use crate::toolbox::meshes::{demo_mesh, refined};
use crate::toolbox::prelude::*;
use bevy_ecs::entity::Entity;
use sinew::haptics::simulated::SimulatedDevice;
use sinew::haptics::{HapticDevice, HapticOptions, HapticTissue};
use sinew::live::SimulationLoop;
use std::time::Duration;

/// Steps a second.
const RATES: [u64; 3] = [30, 60, 100];
/// Rates at which devices are let go and moved at random.
const CLOSED: [u64; 2] = [60, 100];
/// Cycle (s) of the device.
const CYCLE: f64 = 1e-3;
/// Cycles in a second.
const SECOND: u64 = 1000;
/// Most frames of 60 Hz that one step makes up for.
const LONGEST: u32 = 4;
/// Spring (N/m) and damper (N s/m) of the couplings.
const COUPLING: [f64; 2] = [300.0, 2.0];

/// How the device is coupled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scheme {
    Handle,
    Spring,
    Proxy,
}

impl Scheme {
    const ALL: [Self; 3] = [Self::Handle, Self::Spring, Self::Proxy];

    fn name(self) -> &'static str {
        match self {
            Self::Handle => "haptic handle",
            Self::Spring => "plain virtual coupling",
            Self::Proxy => "proxy, reaction fed back",
        }
    }
}

enum Coupling {
    Handle(Box<(HapticTissue, HapticDevice)>),
    Spring(Entity),
    Proxy { hold: Entity, at_rest: DVec3, last: DVec3 },
}

/// A liver that hangs from its ligament at rest, and what holds it.
struct Rig {
    simulation: Simulation,
    coupling: Coupling,
    rate: u64,
    tick: u64,
    steps: u64,
    /// Where the device was last (m).
    x: DVec3,
    /// What the device feels of the tissue between steps: place (m) of the patch, or reaction (N), and that of the step under
    /// way.
    told: [DVec3; 2],
    /// The simulation gave up.
    failed: bool,
    iterations: u32,
}

fn liver(mesh: &Mesh) -> Result<(Simulation, BodyHandle)> {
    let options = SimulationOptions { threads: 1, ..Default::default() };
    let mut simulation = Simulation::new(options)?;
    let description = BodyDescription {
        model: Model::NeoHookean,
        ..BodyDescription::new("liver", mesh, preset("liver")?.material)
    };
    let body = simulation.add_body(&description)?;
    let ligament = simulation.group_rows(body, mesh, "ligament")?;
    simulation.add_constraint(Constraint::hold("ligament", ligament));
    let settings = SolverSettings { mass_damping: 4.0, ..SolverSettings::default() };
    simulation
        .set_solver(SolverSettings { integrator: Integrator::QuasiStatic, ..settings.clone() });
    simulation.step()?;
    // as the scene of the liver has it
    simulation.set_solver(SolverSettings { integrator: Integrator::Safe, ..settings });
    Ok((simulation, body))
}

fn handle(
    simulation: &mut Simulation,
    body: BodyHandle,
    vertices: Vec<u32>,
) -> Result<(HapticTissue, HapticDevice)> {
    let [stiffness, damping] = COUPLING;
    let options = HapticOptions::new(body, vertices);
    Ok(simulation.haptic_handle(HapticOptions { stiffness, damping, ..options })?)
}

fn held_vertices(mesh: &Mesh) -> Vec<u32> {
    mesh.group("tool").map_or_else(Vec::new, |group| group.vertices.clone())
}

impl Rig {
    fn new(mesh: &Mesh, scheme: Scheme, rate: u64) -> Result<Self> {
        let (mut simulation, body) = liver(mesh)?;
        simulation.set_dt(1.0 / rate as f64);
        let vertices = held_vertices(mesh);
        let rows = simulation.rows(body, "tool", &vertices)?;
        let coupling = match scheme {
            Scheme::Handle => Coupling::Handle(Box::new(handle(&mut simulation, body, vertices)?)),
            Scheme::Spring => {
                Coupling::Spring(simulation.add_pull(Pull::new("tool", rows, COUPLING[0], 0.0)))
            }
            Scheme::Proxy => {
                let hold = simulation.add_constraint(Constraint::hold("tool", rows));
                simulation.step()?;
                let at_rest = simulation.reaction(hold).unwrap_or_default();
                Coupling::Proxy { hold, at_rest, last: DVec3::ZERO }
            }
        };
        let (x, told) = (DVec3::ZERO, [DVec3::ZERO; 2]);
        Ok(Self {
            simulation,
            coupling,
            rate,
            tick: 0,
            steps: 0,
            x,
            told,
            failed: false,
            iterations: 0,
        })
    }

    /// What happens at the begin of a cycle: what a step led to is known when it is over, and the next one begins.
    fn cycle(&mut self) {
        let due = self.tick * self.rate / SECOND;
        let first = self.tick == 0;
        self.tick += 1;
        if self.failed || !(first || due > self.steps) {
            return;
        }
        self.steps = due;
        self.told[0] = self.told[1];
        let (simulation, x) = (&mut self.simulation, self.x);
        self.failed = match &mut self.coupling {
            Coupling::Handle(both) => {
                if !first && let Ok(report) = both.0.after_step(simulation) {
                    self.iterations += report.compliance.iterations;
                }
                both.0.before_step(simulation).is_err() || simulation.step().is_err()
            }
            Coupling::Spring(pull) => {
                simulation.move_pull(*pull, x);
                let failed = simulation.step().is_err();
                let force = simulation.pull_report(*pull).map_or(DVec3::ZERO, |own| own.force);
                self.told[1] = x + force / COUPLING[0];
                failed
            }
            Coupling::Proxy { hold, at_rest, last } => {
                let proxy = x - *last / COUPLING[0];
                let failed = simulation.set_target(*hold, proxy).is_err()
                    || simulation.step().is_err()
                    || proxy.length().is_nan()
                    || proxy.length() > 0.2;
                *last = simulation.reaction(*hold).unwrap_or_default() - *at_rest;
                self.told[1] = *last;
                failed
            }
        };
    }

    /// Force (N) on the hand at a place (m) and velocity (m/s).
    fn feel(&mut self, x: DVec3, v: DVec3, seconds: f64) -> DVec3 {
        self.x = x;
        let damper = COUPLING[1] * v;
        match &mut self.coupling {
            Coupling::Handle(both) => both.1.exchange(x, v, seconds).force,
            Coupling::Spring(_) => COUPLING[0] * (self.told[0] - x) - damper,
            Coupling::Proxy { .. } => -self.told[0] - damper,
        }
    }
}

/// The 16 devices, with and without a hand.
fn devices(hand: bool) -> Vec<SimulatedDevice> {
    let mut all = Vec::new();
    for mass in [0.05, 0.1] {
        for damping in [0.1, 1.0] {
            for delay in [1, 2] {
                let alone = SimulatedDevice::new(mass, damping, delay);
                all.push(if hand { alone.held(100.0, 2.0) } else { alone });
            }
        }
    }
    all
}

/// From 0 to 1 in a time of 1.
fn smooth(t: f64) -> f64 {
    let part = t.clamp(0.0, 1.0);
    part * part * (3.0 - 2.0 * part)
}

/// The worst of some devices.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    /// Devices, and those that came to rest.
    count: usize,
    at_rest: usize,
    /// Furthest way (m) in the last half second, and its force about the mean (N, root of mean square).
    moved: f64,
    jitter: f64,
    /// Least energy (J) that a hand that moved at random had given, largest jump of a force over the peak, and exchanges in which damping
    /// was added.
    energy: f64,
    jump: f64,
    dampings: u64,
    failed: usize,
}

/// Drawn to 5 mm, held, let go for two seconds.
fn let_go(mut rig: Rig, mut device: SimulatedDevice, worst: &mut Worst) {
    let way = DVec3::new(0.0, 3.0, 4.0) * 1e-3;
    for tick in 0..SECOND {
        rig.cycle();
        device.put(way * smooth(2.0 * tick as f64 * CYCLE), |x, v, h| rig.feel(x, v, h));
    }
    let (mut places, mut forces) = (Vec::new(), Vec::new());
    for _ in 0..2 * SECOND {
        rig.cycle();
        device.go(|x, v, h| {
            let force = rig.feel(x, v, h);
            forces.push(force);
            force
        });
        places.push(device.position);
    }
    let from = 3 * SECOND as usize / 2;
    let (places, forces) = (&places[from..], &forces[from..]);
    let end = device.position;
    let moved = places.iter().map(|x| x.distance(end)).fold(0.0, f64::max);
    let mean = forces.iter().sum::<DVec3>() / forces.len() as f64;
    let jitter = forces.iter().map(|f| f.distance_squared(mean)).sum::<f64>() / forces.len() as f64;
    let moved = if moved.is_finite() && !rig.failed { moved } else { f64::INFINITY };
    worst.count += 1;
    // 0.2 % of the way
    worst.at_rest += usize::from(moved < 1e-5);
    worst.failed += usize::from(rig.failed);
    worst.moved = worst.moved.max(moved);
    worst.jitter = worst.jitter.max(jitter.sqrt());
}

/// Numbers that look like chance, from -1 to 1 (splitmix64).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// A hand that wants to be somewhere else every fifth of a second.
fn move_at_random(mut rig: Rig, mut device: SimulatedDevice, seconds: u64, worst: &mut Worst) {
    let (mut chance, mut aim) = (Chance(7), DVec3::ZERO);
    let (mut energy, mut before, mut last) = (0.0_f64, DVec3::ZERO, DVec3::ZERO);
    let (mut least, mut peak, mut jump) = (0.0_f64, 0.0_f64, 0.0_f64);
    for tick in 0..seconds * SECOND {
        if tick % (SECOND / 5) == 0 {
            aim = DVec3::from_array([(); 3].map(|()| 0.012 * chance.next()));
        }
        // as an arm: a filter of 60 ms
        device.wish += (aim - device.wish) * (CYCLE / 0.06);
        rig.cycle();
        device.go(|x, v, h| {
            let force = rig.feel(x, v, h);
            energy -= before.dot(x - last);
            least = least.min(energy);
            peak = peak.max(force.length());
            jump = jump.max(force.distance(before));
            (before, last) = (force, x);
            force
        });
    }
    worst.energy = worst.energy.min(least);
    worst.jump = worst.jump.max(jump / peak);
    if let Coupling::Handle(both) = &rig.coupling {
        worst.dampings += both.1.felt().dampings;
    }
}

/// What hands do: way (m) at a time (s), and the error (%) that is allowed.
const WAYS: [(&str, fn(f64) -> f64, f64); 3] = [
    ("1 Hz, 10 mm", |t| 0.010 * smooth(t) * libm::sin(std::f64::consts::TAU * t), 5.0),
    ("2 Hz, 5 mm", |t| 0.005 * smooth(t) * libm::sin(2.0 * std::f64::consts::TAU * t), 10.0),
    ("ramp, 30 mm/s", |t| 0.03 * (t - 0.5).clamp(0.0, 0.5), 5.0),
];

/// Direction of the ways.
const ALONG: DVec3 = DVec3::new(0.6, 0.0, 0.8);

/// Forces (N) along a way, cycle by cycle.
fn forces(mut rig: Rig, way: fn(f64) -> f64) -> (Vec<DVec3>, bool) {
    let mut device = SimulatedDevice::new(0.05, 0.1, 0);
    let mut felt = Vec::new();
    for tick in 0..5 * SECOND / 2 {
        // in a step for every cycle the hand is where it is at the end
        if rig.rate == SECOND {
            device.put(way(tick as f64 * CYCLE) * ALONG, |x, v, h| {
                rig.x = x;
                rig.cycle();
                rig.told[0] = rig.told[1];
                let force = rig.feel(x, v, h);
                felt.push(force);
                force
            });
            continue;
        }
        rig.cycle();
        device.put(way(tick as f64 * CYCLE) * ALONG, |x, v, h| {
            let force = rig.feel(x, v, h);
            felt.push(force);
            force
        });
    }
    (felt, rig.failed)
}

/// Error of forces beside exact ones from 0.3 s on, and the largest jump of all: parts of the peak (%).
fn errors(felt: &[DVec3], exact: &[DVec3]) -> [f64; 2] {
    let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
    let pairs: Vec<_> = felt.iter().zip(exact).skip(3 * SECOND as usize / 10).collect();
    let square = pairs.iter().map(|(a, b)| a.distance_squared(**b)).sum::<f64>();
    let jumps = felt.windows(2).map(|own| own[0].distance(own[1]));
    [(square / pairs.len() as f64).sqrt(), jumps.fold(0.0, f64::max)].map(|own| 100.0 * own / peak)
}

/// Errors of forces beside those of a simulation at a kilohertz.
fn accuracy(mesh: &Mesh, aims: &mut Vec<BenchAim>, tell: &mut impl FnMut(&str)) -> Result<Table> {
    let mut rows = Vec::new();
    for (name, way, most) in WAYS {
        tell(&format!("haptics: {name}"));
        let exact = forces(Rig::new(mesh, Scheme::Spring, SECOND)?, way).0;
        let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
        for rate in RATES {
            for scheme in Scheme::ALL {
                let (felt, failed) = forces(Rig::new(mesh, scheme, rate)?, way);
                let [error, jump] = errors(&felt, &exact);
                if scheme == Scheme::Handle && CLOSED.contains(&rate) {
                    let of = format!("{name}, {rate} steps a second");
                    aims.push(BenchAim::at_most(format!("error of force, {of}"), most, "%", error));
                    aims.push(BenchAim::at_most(format!("largest jump, {of}"), 5.0, "%", jump));
                }
                rows.push((name, rate, scheme.name(), peak, error, jump, failed));
            }
        }
    }
    let title = "Force on a hand whose way is given, beside the same liver stepped at 1 kHz";
    let table = table_of!("haptics", title; for (way, rate, scheme, peak, error, jump, failed) in rows;
        "way" => way, "steps/s" => rate, "coupling" => scheme, "peak N" => peak, "error %" => error, "jump %" => jump,
        "failed" => if failed { "yes" } else { "no" },
    );
    Ok(table.note(
        "error: root of the mean square over the peak, from 0.3 s on. jump: largest difference from one \
         millisecond to the next over the peak. All with one step of latency.",
    ))
}

/// Devices that are let go, and hands that move at random.
fn closed_loop(
    mesh: &Mesh,
    seconds: u64,
    aims: &mut Vec<BenchAim>,
    tell: &mut impl FnMut(&str),
) -> Result<Table> {
    let mut rows = Vec::new();
    for rate in CLOSED {
        for hand in [false, true] {
            for scheme in Scheme::ALL {
                tell(&format!("haptics: {}, {rate} steps a second, hand: {hand}", scheme.name()));
                let mut worst = Worst::default();
                for device in devices(hand) {
                    let_go(Rig::new(mesh, scheme, rate)?, device.clone(), &mut worst);
                    if hand && scheme != Scheme::Proxy {
                        let rig = Rig::new(mesh, scheme, rate)?;
                        move_at_random(rig, device, seconds, &mut worst);
                    }
                }
                if scheme == Scheme::Handle {
                    let of = format!("{rate} steps a second, hand: {hand}");
                    let at_rest = worst.at_rest as f64;
                    let jitter = 1e3 * worst.jitter;
                    aims.push(BenchAim::at_least(
                        format!("devices at rest, {of}"),
                        8.0,
                        "",
                        at_rest,
                    ));
                    aims.push(BenchAim::at_most(format!("jitter, {of}"), 5.0, "mN", jitter));
                    if hand {
                        let energy = 1e3 * worst.energy;
                        let jump = 100.0 * worst.jump;
                        aims.push(BenchAim::at_least(format!("energy, {of}"), -0.1, "mJ", energy));
                        aims.push(BenchAim::at_most(format!("jump, {of}"), 5.0, "%", jump));
                    }
                }
                rows.push((scheme.name(), rate, hand, worst));
            }
        }
    }
    let title = "Eight devices drawn to 5 mm and let go; held by a hand, also moved at random";
    let table = table_of!("haptics-loop", title; for (scheme, rate, hand, w) in rows;
        where { let random = hand && w.jump > 0.0; }
        "coupling" => scheme, "steps/s" => rate, "hand" => if hand { "yes" } else { "no" },
        "at rest" => format!("{} of {}", w.at_rest, w.count), "moved um" => 1e6 * w.moved, "jitter mN" => 1e3 * w.jitter,
        "least energy mJ" => random.then_some(1e3 * w.energy), "jump %" => random.then_some(100.0 * w.jump),
        "dampings" => random.then_some(w.dampings), "failed" => w.failed,
    );
    Ok(table.note(format!(
        "Devices: 0.05 and 0.1 kg, 0.1 and 1 N s/m, 1 and 2 ms late; hand: 100 N/m, 2 N s/m. The worst of eight. at \
         rest: within 10 um from 1.5 to 2 s. Random motion: {seconds} s each."
    )))
}

/// Rows of the table of costs of a mesh: what a step and an exchange cost on this machine, the device on a thread of its own.
fn cost(mesh: &Mesh, seconds: u64, aims: &mut Vec<BenchAim>) -> Result<Vec<CostRow>> {
    let (name, way, most) = WAYS[0];
    let exact = forces(Rig::new(mesh, Scheme::Spring, SECOND)?, way).0;
    let (mut simulation, body) = liver(mesh)?;
    simulation.set_dt(1.0 / 60.0);
    let (mut tissue, mut device) = handle(&mut simulation, body, held_vertices(mesh))?;
    let mut pace = SimulationLoop::new(Duration::from_secs_f64(1.0 / 60.0), LONGEST)?;
    let stop = std::sync::atomic::AtomicBool::new(false);
    let ((cycles, felt), steps) = std::thread::scope(|scope| {
        let at_device = scope.spawn(|| {
            let begin = Instant::now();
            let (mut cycles, mut last) = (Vec::with_capacity(1 << 17), begin);
            let (mut forces, mut before) = (Vec::with_capacity(1 << 17), DVec3::ZERO);
            for tick in 1..=seconds * SECOND {
                let due = begin + Duration::from_millis(tick);
                while Instant::now() < due {
                    std::hint::spin_loop();
                }
                let t = (tick - 1) as f64 * CYCLE;
                let x = way(t) * ALONG;
                let now = Instant::now();
                let felt = device.exchange(x, (x - before) / CYCLE, CYCLE);
                let took = now.elapsed().as_secs_f64();
                cycles.push([took, (now - last).as_secs_f64() - CYCLE, felt.age]);
                forces.push(felt.force);
                (last, before) = (now, x);
            }
            stop.store(true, std::sync::atomic::Ordering::Relaxed);
            (cycles, forces)
        });
        let (mut last, mut steps) = (Instant::now(), Vec::new());
        while !stop.load(std::sync::atomic::Ordering::Relaxed) {
            let start = Instant::now();
            let due = pace.due(start - last);
            last = start;
            if due == 0 {
                std::thread::sleep(pace.step().mul_f64(1.0 - pace.part()));
                continue;
            }
            // one step for all that are due: tissue in slow motion would lag behind the hand
            simulation.set_dt(f64::from(due) * pace.step().as_secs_f64());
            let stepped = tissue.before_step(&mut simulation).is_ok() && simulation.step().is_ok();
            let step = start.elapsed().as_secs_f64();
            let Some(report) = tissue.after_step(&mut simulation).ok().filter(|_| stepped) else {
                break;
            };
            steps.push([
                step,
                start.elapsed().as_secs_f64() - step,
                f64::from(report.compliance.iterations),
            ]);
        }
        (at_device.join().unwrap_or_default(), steps)
    });
    let of = |values: &[[f64; 3]], which: usize, part: f64| {
        let mut own: Vec<f64> = values.iter().map(|v| v[which].abs()).collect();
        own.sort_by(f64::total_cmp);
        own.get(((own.len() as f64 * part) as usize).min(own.len().saturating_sub(1)))
            .copied()
            .unwrap_or(f64::NAN)
    };
    let limit =
        |what: &str, most: f64, found: f64| BenchAim::at_most(what, most, "ms", 1e3 * found);
    let tets = mesh.tetrahedra.len();
    let [error, jump] = errors(&felt, &exact).map(|own| [[own; 3]]);
    // what is left of the error where nothing comes late
    let in_time = errors(&forces(Rig::new(mesh, Scheme::Handle, 60)?, way).0, &exact);
    let in_time = vec![[in_time[0]; 3]];
    let named = |what: &str| format!("{what}, {tets} tetrahedra");
    aims.push(limit(&named("exchange, 99.9 %"), 0.01, of(&cycles, 0, 0.999)));
    aims.push(limit(&named("cycle of the device beside 1 ms, 99 %"), 1.0, of(&cycles, 1, 0.99)));
    let of_force = format!("error of force beside the clock, {name}, {tets} tetrahedra");
    aims.push(BenchAim::at_most(of_force, most, "%", error[0][0]));
    let (error, jump) = (error.to_vec(), jump.to_vec());
    let rows = [
        ("exchange us", &cycles, 0, 1e6),
        ("cycle beside 1 ms, us", &cycles, 1, 1e6),
        ("age of the model ms", &cycles, 2, 1e3),
        ("step ms", &steps, 0, 1e3),
        ("local model ms", &steps, 1, 1e3),
        ("its iterations", &steps, 2, 1.0),
        ("error of force %", &error, 0, 1.0),
        ("the same in simulated time %", &in_time, 0, 1.0),
        ("largest jump of force %", &jump, 0, 1.0),
    ];
    let row = |(what, values, which, unit): (_, &Vec<[f64; 3]>, _, f64)| CostRow {
        tets,
        what,
        count: values.len(),
        parts: PARTS.map(|part| unit * of(values, which, part)),
    };
    Ok(rows.map(row).to_vec())
}

/// Parts of all values that are below those of a row.
const PARTS: [f64; 4] = [0.5, 0.99, 0.999, 1.0];

#[derive(Clone, Debug)]
struct CostRow {
    tets: usize,
    what: &'static str,
    count: usize,
    parts: [f64; 4],
}

fn cost_table(rows: Vec<CostRow>) -> Table {
    let title = "Exchanges at 1 kHz beside 60 steps a second, longer ones where they come late; two threads";
    table_of!("haptics-cost", title; for CostRow { tets, what, count, parts } in rows;
        "tets" => tets, "what" => what, "count" => count, "median" => parts[0], "99 %" => parts[1], "99.9 %" => parts[2], "most" => parts[3],
    )
}

/// Accuracy and closed loops, without turns and with them, and cost.
///
/// # Errors
/// When the liver cannot be read or stepped.
pub fn run(quick: bool, mut tell: impl FnMut(&str)) -> Result<(Vec<Table>, Vec<BenchAim>)> {
    let mesh = demo_mesh("liver.msh")?;
    let mut aims = Vec::new();
    let accuracy = accuracy(&mesh, &mut aims, &mut tell)?;
    let seconds = if quick { 10 } else { 60 };
    let closed = closed_loop(&mesh, seconds, &mut aims, &mut tell)?;
    let [turns, turning] = turns::run(&mesh, seconds, &mut aims, &mut tell)?;
    let tools = tools::run(&mesh, seconds, &mut aims, &mut tell)?;
    // the steps of larger bodies are longer than a frame
    let mut meshes = vec![mesh, refined(&demo_mesh("liver_medium.msh")?)];
    if !quick {
        meshes.push(refined(&meshes[0]));
    }
    let mut costs = Vec::new();
    for mesh in &meshes {
        tell(&format!("haptics: cost, {} tetrahedra", mesh.tetrahedra.len()));
        costs.extend(cost(mesh, if quick { 3 } else { 20 }, &mut aims)?);
    }
    Ok((vec![accuracy, closed, turns, turning, tools, cost_table(costs)], aims))
}
