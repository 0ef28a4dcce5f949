//! Devices that are simulated, in simulated time: nothing here looks at a clock.

#![allow(clippy::print_stdout, reason = "figures beside their bars, and known misses, are shown")]

use allocation_counter::measure;
use glam::{DMat3, DVec3};
use sinew::haptics::simulated::SimulatedDevice;
use sinew::haptics::{Feedback, HapticDevice, HapticError, HapticOptions, HapticTissue};
use sinew::prelude::*;
use sinew::simulation::SimulationError;
use sinew_engine::mesh::generate::box_tets;

/// A cycle of the device (s).
const TICK: f64 = 1e-3;

/// A cycle in which the device is where somebody puts it.
fn put(device: &mut SimulatedDevice, x: DVec3, handle: &mut HapticDevice) -> Feedback {
    device.put(x, |x, v, seconds| handle.exchange(x, v, seconds).force);
    handle.felt()
}

/// A cycle in which it goes where the forces take it.
fn go(device: &mut SimulatedDevice, handle: &mut HapticDevice) -> Feedback {
    device.go(|x, v, seconds| handle.exchange(x, v, seconds).force);
    handle.felt()
}

fn device(mass: f64, damping: f64, delay: usize, hand: bool) -> SimulatedDevice {
    let alone = SimulatedDevice::new(mass, damping, delay);
    if hand { alone.held(100.0, 2.0) } else { alone }
}

/// A block of liver on a table, its upper face held in the middle by a handle; how many cycles there are to a step, 16 2/3 in
/// the mean for 60 steps a second.
struct Scene {
    simulation: Simulation,
    tissue: HapticTissue,
    rate: u64,
    tick: u64,
    steps: u64,
    is_open: bool,
}

pub fn block(
    precision: Precision,
    integrator: Integrator,
    hold: bool,
) -> (Simulation, BodyHandle, Vec<u32>) {
    block_with(0, precision, integrator, hold)
}

/// The same with vertices to spare for cuts.
pub fn block_with(
    spare: usize,
    precision: Precision,
    integrator: Integrator,
    hold: bool,
) -> (Simulation, BodyHandle, Vec<u32>) {
    let size = DVec3::new(0.12, 0.12, 0.06);
    let mesh = box_tets(size, [6, 6, 3]).unwrap();
    let options = SimulationOptions { precision, threads: 1, ..Default::default() };
    let mut simulation = Simulation::new(options).unwrap();
    let material = preset("liver").unwrap().material;
    let description = BodyDescription {
        model: Model::NeoHookean,
        spare,
        ..BodyDescription::new("liver", &mesh, material)
    };
    let body = simulation.add_body(&description).unwrap();
    if hold {
        let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
        simulation.add_constraint(Constraint::hold("table", floor));
    }
    simulation.set_gravity(DVec3::ZERO);
    // as the scene of the liver has it
    simulation.set_solver(SolverSettings {
        integrator,
        mass_damping: 4.0,
        ..SolverSettings::default()
    });
    let middle = DVec3::new(0.06, 0.06, 0.06);
    let near = |x: &DVec3| x.distance(middle) < 0.021;
    let patch = (0..).zip(&mesh.points).filter(|(_, x)| near(x)).map(|(v, _)| v).collect();
    (simulation, body, patch)
}

impl Scene {
    fn new(rate: u64) -> (Self, HapticDevice) {
        let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
        simulation.set_dt(1.0 / rate as f64);
        let (tissue, device) = simulation.haptic_handle(HapticOptions::new(body, patch)).unwrap();
        (Self { simulation, tissue, rate, tick: 0, steps: 0, is_open: false }, device)
    }

    /// What happens at the begin of a cycle: a step that was begun a step ago is there, and the next one begins.
    fn cycle(&mut self) {
        let due = self.tick * self.rate / 1000;
        if self.tick == 0 || due > self.steps {
            self.steps = due;
            if self.is_open {
                self.tissue.after_step(&mut self.simulation).unwrap();
            }
            self.tissue.before_step(&mut self.simulation).unwrap();
            self.simulation.step().unwrap();
            self.is_open = true;
        }
        self.tick += 1;
    }

    /// A step that has taken as long as it may answers now, not when the next one begins.
    fn answer_in_time(&mut self) {
        if self.tick * self.rate / 1000 > self.steps && self.is_open {
            self.tissue.after_step(&mut self.simulation).unwrap();
            self.is_open = false;
        }
    }
}

/// Cycles in a time (s).
fn ticks(seconds: f64) -> u64 {
    (seconds / TICK).round() as u64
}

/// The 16 devices.
fn devices() -> Vec<(String, SimulatedDevice)> {
    let mut all = Vec::new();
    for mass in [0.05, 0.1] {
        for damping in [0.1, 1.0] {
            for delay in [1, 2] {
                for hand in [false, true] {
                    let name = format!("{mass} kg, {damping} N s/m, {delay} ms, hand: {hand}");
                    all.push((name, device(mass, damping, delay, hand)));
                }
            }
        }
    }
    all
}

fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    (values.map(|x| x * x).sum::<f64>() / count).sqrt()
}

/// Drawn to 5 mm in half a second, held there for another half, and let go: nothing moves after two seconds.
#[test]
fn a_device_that_is_let_go_comes_to_rest() {
    let way = DVec3::new(0.0, 3.0, 4.0) * 1e-3;
    for rate in [60, 100] {
        for (name, mut device) in devices() {
            let (mut scene, mut handle) = Scene::new(rate);
            let mut drawn = 0.0_f64;
            for tick in 0..ticks(1.0) {
                scene.cycle();
                let part = (tick as f64 / ticks(0.5) as f64).min(1.0);
                drawn = put(&mut device, part * part * (3.0 - 2.0 * part) * way, &mut handle)
                    .force
                    .length();
            }
            let mut last = Vec::new();
            for _ in 0..ticks(2.0) {
                scene.cycle();
                let felt = go(&mut device, &mut handle);
                last.push((device.position, felt));
            }
            let name = format!("{rate} steps a second, {name}");
            let (end, felt) = last[last.len() - 1];
            let rest = &last[ticks(1.5) as usize..];
            let spread = |from: f64, to: f64| {
                let own = &last[ticks(from) as usize..ticks(to) as usize];
                let mean = own.iter().map(|own| own.0).sum::<DVec3>() / own.len() as f64;
                rms(own.iter().map(|own| own.0.distance(mean)).collect::<Vec<_>>().into_iter())
            };
            let spreads = [(0.5, 1.0), (1.0, 1.5), (1.5, 2.0)].map(|(a, b)| spread(a, b));
            let moved = rest.iter().map(|(x, _)| x.distance(end)).fold(0.0, f64::max);
            let mean = rest.iter().map(|(_, felt)| felt.force).sum::<DVec3>() / rest.len() as f64;
            let jitter = rms(rest.iter().map(|(_, felt)| felt.force.distance(mean)));
            println!(
                "{name}: drawn {drawn:.3} N, spreads {spreads:?}, end {:.2e} m, moved {moved:.2e} m, jitter {jitter:.2e} N, energy {:.2e} J, dampings {}",
                end.length(),
                felt.energy,
                felt.dampings
            );
            assert!(drawn > 0.3, "{name}: {drawn} N");
            // 0.2 % of the way. Nothing but the damper of the handle stops a free device of 50 g, by a velocity of 3 mm/s for
            // every count of the encoder: a known miss, of which it is demanded that it stays small
            let bars = [1e-5, 5e-3];
            if moved >= bars[0] || jitter >= bars[1] {
                println!("missed: {name}");
                assert!(device.hand.is_none(), "{name}: moves by {moved} m, {jitter} N");
                assert!(moved < 1e-4 && jitter < 0.02, "{name}: moves by {moved} m, {jitter} N");
            }
            assert!(end.length() < 2e-4, "{name}: {end}");
        }
    }
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

/// A hand that wants to be somewhere else every fifth of a second for a minute: the device gets no energy, and no force jumps.
#[test]
fn a_device_gets_no_energy_from_a_hand_that_moves_at_random() {
    for rate in [60, 100] {
        for (mass, delay) in [(0.05, 2), (0.1, 1)] {
            let (mut scene, mut handle) = Scene::new(rate);
            let mut device = device(mass, 0.1, delay, true);
            let (mut chance, mut aim) = (Chance(7), DVec3::ZERO);
            let (mut least, mut peak, mut jump, mut before) =
                (0.0_f64, 0.0_f64, 0.0_f64, DVec3::ZERO);
            let mut furthest = 0.0_f64;
            for tick in 0..ticks(60.0) {
                if tick % ticks(0.2) == 0 {
                    aim = DVec3::from_array([(); 3].map(|()| 0.012 * chance.next()));
                }
                // as an arm: two filters of 60 ms
                device.wish += (aim - device.wish) * (TICK / 0.06);
                scene.cycle();
                let felt = go(&mut device, &mut handle);
                least = least.min(felt.energy);
                peak = peak.max(felt.force.length());
                jump = jump.max(felt.force.distance(before));
                furthest = furthest.max(device.position.length());
                before = felt.force;
            }
            let felt = handle.felt();
            println!(
                "{rate}: {mass} kg, {delay} ms: least {least:.2e} J, end {:.2e} J, peak {peak:.3} N, jump {:.1} %, furthest {furthest:.4} m, dampings {}",
                felt.energy,
                100.0 * jump / peak,
                felt.dampings
            );
            assert!(furthest > 4e-3 && peak > 0.2, "{furthest} m, {peak} N");
            assert!(least >= -1e-4, "{rate}: {mass} kg, {delay} ms: {least} J");
            assert!(jump <= 0.05 * peak, "{rate}: {mass} kg, {delay} ms: {jump} of {peak} N");
        }
    }
}

/// A motion of the hand: way (m) at a time (s). It begins smoothly within a second.
type Way = fn(f64) -> f64;

fn smooth(t: f64) -> f64 {
    let part = t.clamp(0.0, 1.0);
    part * part * (3.0 - 2.0 * part)
}

const WAYS: [(&str, Way, f64); 3] = [
    ("1 Hz, 10 mm", |t| 0.010 * smooth(t) * (std::f64::consts::TAU * t).sin(), 0.05),
    ("2 Hz, 5 mm", |t| 0.005 * smooth(t) * (2.0 * std::f64::consts::TAU * t).sin(), 0.10),
    // 30 mm/s up to 15 mm, from half a second on
    ("ramp of 30 mm/s", |t| 0.03 * (t - 0.5).clamp(0.0, 0.5), 0.05),
];

/// Beside the same scene, stepped at a kilohertz with the device in every step.
#[test]
fn forces_are_those_of_a_simulation_at_a_kilohertz() {
    let along = DVec3::new(0.6, 0.0, 0.8);
    for (name, way, most) in WAYS {
        let run = |rate: u64| {
            let (mut scene, mut handle) = Scene::new(rate);
            let mut device = device(0.05, 0.1, 0, false);
            let mut forces = Vec::new();
            for tick in 0..ticks(2.5) {
                scene.cycle();
                forces.push(put(&mut device, way(tick as f64 * TICK) * along, &mut handle));
            }
            forces
        };
        let exact = kilohertz(way, along);
        let peak = exact.iter().map(|f| f.length()).fold(0.0, f64::max);
        for rate in [60, 100] {
            let felt = run(rate);
            let from = ticks(0.3) as usize;
            let pairs = felt[from..].iter().zip(&exact[from..]);
            let error = rms(pairs
                .map(|(felt, exact)| felt.force.distance(*exact))
                .collect::<Vec<_>>()
                .into_iter())
                / peak;
            let jumps = felt.windows(2).map(|own| own[0].force.distance(own[1].force));
            let jump = jumps.fold(0.0, f64::max) / peak;
            println!(
                "{name}, {rate}: peak {peak:.3} N, error {:.2} %, jump {:.2} %",
                100.0 * error,
                100.0 * jump
            );
            assert!(peak > 0.2, "{name}: {peak} N");
            assert!(error <= most, "{name}, {rate} steps a second: {error}");
            assert!(jump <= 0.05, "{name}, {rate} steps a second: a jump of {jump}");
        }
    }
}

/// Forces of the coupling with a step for every cycle.
fn kilohertz(way: Way, along: DVec3) -> Vec<DVec3> {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
    simulation.set_dt(TICK);
    let HapticOptions { stiffness, damping, .. } = HapticOptions::new(body, Vec::new());
    let rows = simulation.rows(body, "patch", &patch).unwrap();
    let pull = simulation.add_pull(Pull::new("hand", rows, stiffness, 0.0));
    let mut device = device(0.05, 0.1, 0, false);
    let mut forces = Vec::new();
    for tick in 0..ticks(2.5) {
        device.put(way(tick as f64 * TICK) * along, |x, v, _| {
            simulation.move_pull(pull, x);
            simulation.step().unwrap();
            let force = simulation.pull_report(pull).unwrap().force - damping * v;
            forces.push(force);
            force
        });
    }
    forces
}

/// Equilibria for hands a little further, far from rest, against the model.
#[test]
fn the_local_model_is_what_equilibria_differ_by() {
    for precision in [Precision::F64, Precision::F32] {
        let (mut simulation, body, patch) = block(precision, Integrator::QuasiStatic, true);
        let (mut tissue, mut device) =
            simulation.haptic_handle(HapticOptions::new(body, patch)).unwrap();
        let mut settle = |x: DVec3| {
            device.exchange(x, DVec3::ZERO, TICK);
            tissue.step(&mut simulation).unwrap()
        };
        settle(DVec3::ZERO);
        for x in [DVec3::ZERO, DVec3::new(0.012, -0.006, 0.018), DVec3::new(0.0, 0.01, -0.015)] {
            let at = settle(x);
            assert!(at.compliance.solved && !at.compliance.with_inertia, "{at:?}");
            let h = 2e-4;
            let column = |axis: DVec3, settle: &mut dyn FnMut(DVec3) -> DVec3| {
                (settle(x + h * axis) - settle(x - h * axis)) / (2.0 * h)
            };
            let mut patch = |x: DVec3| settle(x).patch;
            let [a, b, c] = DVec3::AXES.map(|axis| column(axis, &mut patch));
            let exact = DMat3::from_cols(a, b, c);
            let gain = at.compliance.gain;
            let error = (0..3).map(|k| (gain.col(k) - exact.col(k)).length()).fold(0.0, f64::max);
            let size = (0..3).map(|k| exact.col(k).length()).fold(0.0, f64::max);
            println!(
                "{precision:?} at {x}: {gain} error {:.3} %, {} iterations",
                100.0 * error / size,
                at.compliance.iterations
            );
            assert!((0.1..1.0).contains(&size), "{exact}");
            assert!(error < 0.01 * size, "{precision:?} at {x}: {gain} for {exact}");
        }
    }
}

/// Nobody feels at a simulation without being in it, and nothing but the pull is in it.
#[test]
fn a_handle_changes_nothing_but_its_pull() {
    let path = |step: u32| DVec3::new(0.0, 1e-3, 2e-3) * f64::from(step);
    for integrator in [Integrator::Safe, Integrator::LinearisedBdf2, Integrator::StormerVerlet] {
        let (mut felt, body, patch) = block(Precision::F64, integrator, true);
        let (mut tissue, mut device) =
            felt.haptic_handle(HapticOptions::new(body, patch.clone())).unwrap();
        let (mut alone, _, _) = block(Precision::F64, integrator, true);
        let rows = alone.rows(body, "patch", &patch).unwrap();
        let pull = alone.add_pull(Pull::new("hand", rows, 300.0, 0.0));
        for step in 0..10 {
            device.exchange(path(step), DVec3::ZERO, TICK);
            tissue.step(&mut felt).unwrap();
            alone.move_pull(pull, path(step));
            alone.step().unwrap();
            assert_eq!(felt.state_hash(), alone.state_hash(), "{integrator:?}, step {step}");
        }
        assert!(felt.displacements(body)[patch[0] as usize].z > 1e-3);
        tissue.release(&mut felt);
        assert!(alone.remove_contact(pull));
        felt.step().unwrap();
        alone.step().unwrap();
        assert_eq!(felt.state_hash(), alone.state_hash(), "{integrator:?}");
    }
}

#[test]
fn a_body_that_nothing_supports_is_told_of() {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, false);
    let (mut tissue, mut device) =
        simulation.haptic_handle(HapticOptions::new(body, patch)).unwrap();
    for step in 0..20 {
        let felt = device.exchange(DVec3::Z * 1e-4 * f64::from(step), DVec3::ZERO, 0.01);
        assert_eq!(felt.flags.with_inertia, step > 0, "{felt:?}");
        let found = tissue.step(&mut simulation).unwrap().compliance;
        assert!(found.solved && found.with_inertia, "{found:?}");
        // a step of 10 ms does not carry half a kilogram along
        assert!((0.01..0.9).contains(&found.gain.z_axis.z), "{found:?}");
    }
}

#[test]
fn a_tangent_that_is_indefinite_gives_way_to_the_projected_one() {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
    let (mut tissue, mut device) =
        simulation.haptic_handle(HapticOptions::new(body, patch)).unwrap();
    device.exchange(DVec3::ZERO, DVec3::ZERO, TICK);
    tissue.step(&mut simulation).unwrap();
    // pressed flat evenly: it would buckle
    let points = simulation.positions(body);
    let pressed: Vec<_> = points.iter().map(|x| DVec3::new(0.0, 0.0, -0.6 * x.z)).collect();
    simulation.set_state(body, &pressed, &vec![DVec3::ZERO; pressed.len()]).unwrap();
    let found = tissue.after_step(&mut simulation).unwrap().compliance;
    assert!(found.projected && found.solved, "{found:?}");
    let felt = device.exchange(DVec3::ZERO, DVec3::ZERO, TICK);
    assert!(felt.flags.projected && felt.force.is_finite(), "{felt:?}");
}

/// The tissue stops: no force is left after a tenth of a second, and it comes back at 50 N/s at most.
#[test]
fn a_simulation_that_stops_lets_go_smoothly() {
    let (mut scene, mut handle) = Scene::new(100);
    let mut device = device(0.05, 0.1, 1, false);
    for tick in 0..ticks(0.6) {
        scene.cycle();
        put(&mut device, DVec3::Z * 0.01 * smooth(tick as f64 / 500.0), &mut handle);
    }
    let held = handle.felt().force.length();
    assert!(held > 0.5, "{held}");
    let mut before = held;
    for tick in 0..ticks(0.2) {
        let felt = put(&mut device, DVec3::Z * 0.01, &mut handle);
        let force = felt.force.length();
        assert!((before - force).abs() < 0.05 * held, "{tick}: from {before} to {force}");
        assert_eq!(felt.flags.stale, felt.age > 0.05);
        if felt.age >= 0.1 {
            assert_eq!(felt.force, DVec3::ZERO, "{felt:?}");
        }
        before = force;
    }
    let mut steepest = 0.0_f64;
    for _ in 0..ticks(0.3) {
        scene.cycle();
        let force = put(&mut device, DVec3::Z * 0.01, &mut handle).force.length();
        steepest = steepest.max((force - before).abs());
        before = force;
    }
    assert!((before - held).abs() < 0.05 * held, "{before} N after {held} N");
    assert!(steepest < 50.0 * TICK + 1e-9, "{steepest} N in a cycle");
}

#[test]
fn forces_are_limited_and_bad_numbers_give_none() {
    let (mut scene, mut handle) = Scene::new(100);
    let mut device = device(0.05, 0.1, 1, false);
    for tick in 0..ticks(1.0) {
        scene.cycle();
        let felt = put(&mut device, DVec3::Z * 0.2 * smooth(tick as f64 / 900.0), &mut handle);
        assert!(felt.force.length() <= 3.3 + 1e-12);
    }
    assert!(handle.felt().flags.limited && handle.felt().force.z < -3.2, "{:?}", handle.felt());
    let bad = [
        (DVec3::NAN, DVec3::ZERO, TICK),
        (DVec3::ZERO, DVec3::INFINITY, TICK),
        (DVec3::ZERO, DVec3::ZERO, -TICK),
        (DVec3::ZERO, DVec3::ZERO, f64::NAN),
    ];
    for (x, v, seconds) in bad {
        let felt = handle.exchange(x, v, seconds);
        assert!(felt.flags.bad_input && felt.force == DVec3::ZERO, "{felt:?}");
        assert!(felt.energy.is_finite() && felt.age.is_finite());
    }
    let felt = handle.exchange(DVec3::Z * 0.2, DVec3::ZERO, TICK);
    assert!(!felt.flags.bad_input && felt.flags.rising && felt.force.length() < 0.051, "{felt:?}");
}

#[test]
fn handles_that_cannot_be_are_refused_by_name() {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
    let good = HapticOptions::new(body, patch);
    let cases = [
        (HapticOptions { stiffness: 0.0, ..good.clone() }, "stiffness is 0 N/m"),
        (HapticOptions { damping: -1.0, ..good.clone() }, "damping is -1 N s/m"),
        (HapticOptions { limit: f64::NAN, ..good.clone() }, "limit is NaN N"),
        (HapticOptions { stale: f64::INFINITY, ..good.clone() }, "stale is inf s"),
        (HapticOptions { fade: -0.1, ..good.clone() }, "fade is -0.1 s"),
        (HapticOptions { device_mass: 0.0, ..good.clone() }, "device_mass is 0 kg"),
        (HapticOptions { tolerance: 1.0, ..good.clone() }, "tolerance is 1"),
        (HapticOptions { vertices: Vec::new(), ..good.clone() }, "no vertex"),
        (HapticOptions { body: BodyHandle(3), ..good.clone() }, "no body 3"),
    ];
    for (options, text) in cases {
        let error = simulation.haptic_handle(options).unwrap_err().to_string();
        assert!(error.contains(text) && error.contains("haptic device"), "{error}");
    }
    let beyond = HapticOptions { vertices: vec![9999], ..good.clone() };
    let error = simulation.haptic_handle(beyond).unwrap_err();
    assert!(matches!(error, HapticError::Simulation(SimulationError::Vertex { .. })), "{error}");
    // nothing was left behind
    assert!(simulation.find::<Pull>("haptic device").is_none());
    let (mut tissue, _device) = simulation.haptic_handle(good).unwrap();
    assert!(matches!(tissue.after_step(&mut simulation), Err(HapticError::Released(_))));
    tissue.step(&mut simulation).unwrap();
    assert!(simulation.remove_contact(tissue.held()));
    let error = tissue.step(&mut simulation).unwrap_err();
    assert!(error.to_string().contains("make a new handle"), "{error}");
}

/// Where a device is tells in its force within two steps, where a step takes no longer than its frame.
#[test]
fn a_motion_comes_back_through_a_step_within_two_frames() {
    for rate in [60, 100] {
        for at in 0..20 {
            let (mut scene, mut handle) = Scene::new(rate);
            let mut device = device(0.05, 0.1, 1, false);
            let frame = 1000.0 / rate as f64;
            let (mut moved, mut taken) = (0, 0);
            for tick in 0..ticks(0.4) {
                scene.cycle();
                if tick >= ticks(0.2) + at && moved == 0 {
                    (moved, taken) = (tick, scene.simulation.world().resource::<StepClock>().step);
                }
                let x = if moved > 0 { DVec3::Z * 1e-3 } else { DVec3::ZERO };
                scene.answer_in_time();
                let felt = put(&mut device, x, &mut handle);
                // the first model of a step that was begun after the motion
                if moved > 0 && felt.step > taken {
                    let late = (tick - moved) as f64;
                    assert!(late < 2.0 * frame, "{late} ms at {rate} steps a second");
                    break;
                }
                assert!(tick + 1 < ticks(0.4), "it never came");
            }
        }
    }
}

#[test]
fn an_exchange_allocates_nothing() {
    let (mut scene, mut handle) = Scene::new(100);
    let mut device = device(0.05, 0.1, 1, false);
    put(&mut device, DVec3::ZERO, &mut handle);
    for tick in 0..ticks(0.3) {
        scene.cycle();
        let x = DVec3::Z * 0.05 * smooth(tick as f64 / 200.0);
        let counted = measure(|| {
            handle.exchange(x, DVec3::Z, TICK);
        });
        assert_eq!(counted.count_total, 0, "cycle {tick}");
    }
    // with too old a model, and with nonsense
    let counted = measure(|| {
        handle.exchange(DVec3::ZERO, DVec3::ZERO, 0.07);
        handle.exchange(DVec3::NAN, DVec3::ZERO, TICK);
    });
    assert_eq!(counted.count_total, 0);
    let counted = measure(|| drop(std::hint::black_box(vec![ticks(1.0)])));
    assert!(counted.count_total > 0, "the counter counts");
}

/// On two threads at whatever speed: models arrive whole, none older than one before.
#[test]
fn a_device_runs_beside_a_simulation() {
    let (mut simulation, body, patch) = block(Precision::F64, Integrator::Safe, true);
    let (mut tissue, mut device) =
        simulation.haptic_handle(HapticOptions::new(body, patch)).unwrap();
    let steps = 60;
    let at_device = std::thread::spawn(move || {
        let (mut last, mut tick, mut strongest) = (0, 0.0_f64, 0.0_f64);
        while last < steps {
            tick += 1.0;
            let x = DVec3::Z * 0.005 * (tick / 1000.0).min(1.0);
            let felt = device.exchange(x, DVec3::ZERO, 1e-4);
            assert!(felt.step >= last && felt.force.is_finite());
            assert!(felt.step == 0 || (felt.time - 0.01 * felt.step as f64).abs() < 1e-9);
            last = felt.step;
            strongest = strongest.max(felt.force.length());
            std::thread::yield_now();
        }
        strongest
    });
    for _ in 0..steps {
        tissue.step(&mut simulation).unwrap();
    }
    assert!(at_device.join().unwrap() > 0.01);
}
