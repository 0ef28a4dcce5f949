//! Haptic devices and readers, on threads of their own and after the simulation is gone.

use crate::{Slab, api::*, c, ok, said, sized};
use allocation_counter::measure;
use sinew_embed::*;
use std::ptr::{null, null_mut};
use std::time::{Duration, Instant};

/// A pointer that goes to another thread.
struct There<T>(*mut T);
unsafe impl<T> Send for There<T> {}

impl<T> There<T> {
    // the whole, not its field
    fn get(&self) -> *mut T {
        self.0
    }
}

/// That of the slab.
fn mesh() -> Mesh {
    mesh_from_generator("box = { size = [0.1, 0.1, 0.05], cells = [4, 4, 2] }").unwrap()
}

fn top() -> Vec<u32> {
    mesh().group("z1").unwrap().vertices.clone()
}

pub(crate) fn device(slab: &Slab) -> (sinew_handle, *mut sinew_haptic_device) {
    device_of(slab, "device", false)
}

fn device_of(slab: &Slab, name: &str, turns: bool) -> (sinew_handle, *mut sinew_haptic_device) {
    let (name, vertices) = (c(name), top());
    let options = sized!(sinew_haptic_options {
        turns: turns.into(),
        name: name.as_ptr(),
        vertices: vertices.as_ptr(),
        vertex_count: vertices.len(),
        stiffness: 200.0,
        fade: -1.0,
    });
    let (mut pull, mut made) = (0, null_mut());
    ok(unsafe { sinew_haptic_add(slab.sim, slab.body, &options, &mut pull, &mut made) });
    (pull, made)
}

#[track_caller]
fn exchange(device: *const sinew_haptic_device, z: f64, seconds: f64) -> sinew_haptic_feedback {
    let mut felt = sized!(sinew_haptic_feedback {});
    let (x, v) = ([0.0, 0.0, z], [0.0, 0.0, 0.01]);
    ok(unsafe { sinew_haptic_exchange(device, x.as_ptr(), v.as_ptr(), seconds, &mut felt) });
    felt
}

#[test]
fn a_device_has_the_bits_of_the_library_and_outlives_its_simulation() {
    let slab = Slab::new(1);
    let (pull, device) = device(&slab);
    // the same in Rust, without the doors that serve devices
    let mesh = mesh();
    let mut own = Embedding::new(&Options { threads: 1, ..Options::default() }).unwrap();
    let body = BodyDescription::new("slab", &mesh, preset("liver").unwrap());
    let body = own.add_body(&mesh, &body).unwrap();
    let floor = own.group(body, "z0").unwrap();
    own.add_constraint(body, &ConstraintSpec::hold("floor", &floor)).unwrap();
    let defaults = own.haptic_options(body, &top()).unwrap();
    let options = HapticOptions { name: "device".into(), stiffness: 200.0, fade: 0.0, ..defaults };
    let (mut tissue, mut twin_device) = own.simulation_mut().haptic_handle(options).unwrap();
    let mut last = exchange(device, 0.0, 1e-3);
    assert_eq!((last.flags, last.force), (SINEW_HAPTIC_WAITING, [0.0; 3]));
    twin_device.exchange(DVec3::ZERO, DVec3::Z * 0.01, 1e-3);
    for step in 1..=20 {
        ok(unsafe { sinew_step(slab.sim, 1) });
        tissue.step(own.simulation_mut()).unwrap();
        for tick in 0..10 {
            let z = 1e-5 * f64::from(10 * step + tick);
            last = exchange(device, z, 1e-3);
            let felt = twin_device.exchange(DVec3::Z * z, DVec3::Z * 0.01, 1e-3);
            assert_eq!(last.force.map(f64::to_bits), felt.force.to_array().map(f64::to_bits));
            assert_eq!((last.step, last.time, last.age), (felt.step, felt.time, felt.age));
            assert_eq!((last.energy, last.dampings), (felt.energy, felt.dampings));
        }
    }
    assert!(last.force[2] < -0.05 && last.step == 20, "{:?}", last.force);
    assert_eq!(slab.hash(), own.hash());
    let mut force = [0.0; 3];
    ok(unsafe { sinew_pull_force(slab.sim, pull, force.as_mut_ptr(), null_mut()) });
    assert!(force[2] < -0.05);
    let counted = measure(|| {
        exchange(device, 2.1e-3, 1e-3);
    });
    assert_eq!(counted.count_total, 0);
    twin_device.exchange(DVec3::Z * 2.1e-3, DVec3::Z * 0.01, 1e-3);
    // jaws beside it, which turn the same vertices
    let (_, jaws) = device_of(&slab, "jaws", true);
    let defaults = own.haptic_options(body, &top()).unwrap();
    let options = HapticOptions { stiffness: 200.0, fade: 0.0, turns: true, ..defaults };
    let options = HapticOptions { name: "jaws".into(), ..options };
    let (mut holding, mut twin_jaws) = own.simulation_mut().haptic_handle(options).unwrap();
    for step in 0..20 {
        let rotation = DQuat::from_rotation_z(0.01 * f64::from(step));
        let motion = DeviceMotion { rotation, ..DeviceMotion::default() };
        let (zero, mut felt) = ([0.0; 3], sized!(sinew_haptic_feedback {}));
        let (at, turn) = (zero.as_ptr(), rotation.to_array());
        let of =
            |to| unsafe { sinew_haptic_exchange_pose(jaws, at, turn.as_ptr(), at, at, 0.01, to) };
        ok(of(&mut felt));
        let twin = twin_jaws.exchange_pose(&motion, 0.01);
        assert_eq!(felt.torque.map(f64::to_bits), twin.torque.to_array().map(f64::to_bits));
        assert_eq!(felt.force.map(f64::to_bits), twin.force.to_array().map(f64::to_bits));
        last.torque = felt.torque;
        ok(unsafe { sinew_step(slab.sim, 1) });
        for hand in [&mut tissue, &mut holding] {
            hand.before_step(own.simulation_mut()).unwrap();
        }
        own.simulation_mut().step().unwrap();
        for hand in [&mut tissue, &mut holding] {
            hand.after_step(own.simulation_mut()).unwrap();
        }
    }
    assert!(last.torque[2] < -1e-4 && slab.hash() == own.hash(), "{:?}", last.torque);
    let (zero, mut felt) = ([0.0; 4], sized!(sinew_haptic_feedback {}));
    let (at, to) = (zero.as_ptr(), &mut felt);
    ok(unsafe { sinew_haptic_exchange_pose(jaws, at, at, at, at, 0.01, to) });
    assert_eq!((felt.flags, felt.torque), (SINEW_HAPTIC_BAD_INPUT, [0.0; 3]), "no quaternion");
    unsafe { sinew_haptic_free(jaws) };
    drop(slab);
    let silent: Vec<_> = (0..120).map(|_| exchange(device, 2e-3, 1e-3)).collect();
    assert!(silent[119].flags & SINEW_HAPTIC_STALE != 0 && silent[119].force == [0.0; 3]);
    assert_eq!(exchange(device, f64::NAN, 1e-3).flags, SINEW_HAPTIC_BAD_INPUT);
    unsafe { sinew_haptic_free(device) };
}

/// At a kilohertz beside steps without a pause: no call is refused, and steps arrive.
#[test]
fn a_device_never_waits_for_steps() {
    let slab = Slab::new(1);
    let (_, own) = device(&slab);
    let (own, begin) = (There(own), Instant::now());
    let at_device = std::thread::spawn(move || {
        let (mut steps, mut longest) = (0, Duration::ZERO);
        for tick in 0..1000_u32 {
            std::thread::sleep(Duration::from_millis(tick.into()).saturating_sub(begin.elapsed()));
            let now = Instant::now();
            let felt = exchange(own.get(), 1e-5 * f64::from(tick.min(200)), 1e-3);
            longest = longest.max(now.elapsed());
            assert!(felt.step >= steps && felt.force.iter().all(|f| f.is_finite()));
            steps = felt.step;
        }
        unsafe { sinew_haptic_free(own.get()) };
        (steps, longest)
    });
    let mut done = 0;
    while !at_device.is_finished() {
        ok(unsafe { sinew_step(slab.sim, 1) });
        done += 1;
    }
    let (steps, longest) = at_device.join().unwrap();
    assert!(steps > 10 && steps <= done, "{steps} of {done}, longest exchange {longest:?}");
}

#[test]
fn every_frame_of_a_reader_is_one_step() {
    let slab = Slab::new(1);
    let (mut own, n) = (null_mut(), 3 * slab.vertices);
    ok(unsafe { sinew_live_share(slab.sim, null(), 0, null(), 0, &mut own) });
    let (own, body, steps) = (There(own), slab.body, 200);
    let reading = std::thread::spawn(move || {
        let (mut seen, mut step, mut is_new, mut time) = (Vec::new(), 0, 0, 0.0);
        let read = |quantity, at| {
            let (mut numbers, mut needed) = (vec![f64::NAN; n], 0);
            let data = numbers.as_mut_ptr();
            ok(unsafe { sinew_live_read(own.get(), body, quantity, at, data, n, &mut needed) });
            assert_eq!(needed, n);
            numbers
        };
        while step < steps {
            ok(unsafe { sinew_live_update(own.get(), &mut is_new, &mut step, &mut time) });
            if is_new == 1 {
                seen.push((step, read(SINEW_LIVE_POSITIONS, f64::INFINITY)));
            }
        }
        let normals = read(SINEW_LIVE_NORMALS, time - 0.002);
        (seen, normals, own)
    });
    let mut truth = vec![slab.read(SINEW_POSITIONS)];
    for _ in 0..steps {
        ok(unsafe { sinew_step(slab.sim, 1) });
        truth.push(slab.read(SINEW_POSITIONS));
    }
    let (seen, normals, own) = reading.join().unwrap();
    assert!(seen.iter().all(|(step, x)| truth[*step as usize] == *x) && !seen.is_empty());
    let lengths = normals.chunks(3).map(|n| n.iter().map(|x| x * x).sum::<f64>());
    assert_eq!(lengths.filter(|own| (own - 1.0).abs() < 1e-12).count(), 66);
    drop(slab);
    let (mut is_new, mut last) = (7, vec![0.0; n]);
    let (live, data) = (own.get(), last.as_mut_ptr());
    unsafe {
        ok(sinew_live_update(live, &mut is_new, null_mut(), null_mut()));
        ok(sinew_live_read(live, body, SINEW_LIVE_POSITIONS, f64::INFINITY, data, n, null_mut()));
        assert!(is_new == 0 && last == truth[steps as usize]);
        for (handle, quantity, text) in [
            (body, 3, "quantity: 3 is none"),
            (7, SINEW_LIVE_NORMALS, "share it, too"),
            (body, SINEW_LIVE_WRENCH, "share it, too"),
        ] {
            let status = sinew_live_read(live, handle, quantity, 0.0, data, n, null_mut());
            assert_eq!(status, SINEW_ARGUMENT);
            assert!(said().contains(text), "{}", said());
        }
        sinew_live_free(live);
    }
}
