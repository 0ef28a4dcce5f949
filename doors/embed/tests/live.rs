//! Haptic handles and readers on other threads.

use crate::{held, options, slab};
use sinew_embed::*;

fn patch(sim: &Embedding, body: Handle) -> Vec<u32> {
    sim.group(body, "z1").unwrap()
}

/// Lifts a device by 0.1 mm a step, ten exchanges each.
fn lift(device: &HapticDevice, step: u32) -> Vec<Feedback> {
    let z = |tick| 1e-5 * f64::from(10 * step + tick);
    let one = |tick| device.exchange([0.0, 0.0, z(tick)], [0.0, 0.0, 0.01], 1e-3).unwrap();
    (0..10).map(one).collect()
}

#[test]
fn handles_outlive_what_becomes_of_their_pulls() {
    let (mut sim, body, _) = held(&options());
    let top = patch(&sim, body);
    let own = sim.haptic_options(body, &top).unwrap();
    let (pull, device) = sim.add_haptic(own.clone()).unwrap();
    let twice = sim.add_haptic(own.clone()).unwrap_err();
    assert!(twice.text.contains("there is a pull `haptic device` already"), "{twice}");
    assert!(lift(&device, 0).iter().all(|felt| felt.flags.waiting && felt.force == DVec3::ZERO));
    let before = sim.snapshot().unwrap();
    for step in 1..=10 {
        sim.step(1).unwrap();
        lift(&device, step);
    }
    let felt = lift(&device, 11)[9];
    assert!(felt.force.z < -0.05 && felt.step == 10 && haptic_bits(&felt.flags) == 0, "{felt:?}");
    assert!(sim.pull_report(pull).unwrap().force.z < -0.05);
    // back, and on with the same device
    sim.restore(&before).unwrap();
    sim.step(1).unwrap();
    assert_eq!(lift(&device, 12)[9].step, 1);
    // let go: steps go on, the force falls, and going back brings no driver of the pull
    sim.remove(pull).unwrap();
    sim.step(1).unwrap();
    let silent = |device: &HapticDevice| (0..20).flat_map(|_| lift(device, 13)).last().unwrap();
    let felt = silent(&device);
    assert!(felt.flags.stale && felt.force == DVec3::ZERO && felt.step == 1, "{felt:?}");
    sim.restore(&before).unwrap();
    sim.step(1).unwrap();
    // a body that goes takes the pull along, and its way back brings it again
    let (_, device) = sim.add_haptic(HapticOptions { name: "other".into(), ..own }).unwrap();
    sim.step(1).unwrap();
    let there = sim.snapshot().unwrap();
    sim.remove(body).unwrap();
    sim.step(2).unwrap();
    assert_eq!(lift(&device, 0)[9].step, 2);
    sim.restore(&there).unwrap();
    sim.step(2).unwrap();
    assert_eq!(lift(&device, 0)[9].step, 4);
    // more flags, each in its place
    let bad = device.exchange([f64::NAN; 3], [0.0; 3], 1e-3).unwrap();
    assert_eq!((haptic_bits(&bad.flags), bad.force), (32, DVec3::ZERO));
    let all = HapticFlags { waiting: true, unconverged: true, ..HapticFlags::default() };
    assert_eq!(haptic_bits(&all), 1 | 512);
}

#[test]
fn a_device_holds_a_tool() {
    let (mut sim, body, _) = held(&options());
    // over the upper face, which is at the height of that in `slab`
    let top = slab().points.iter().map(|x| x.z).fold(0.0, f64::max);
    let ball =
        Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.05, 0.05, top + 0.0205));
    let ball = sim.add_tool(ball, None).unwrap();
    let own = sim.haptic_options(ball, &[]).unwrap();
    let (handle, device) = sim.add_haptic(own.clone()).unwrap();
    assert_eq!(handle, ball);
    assert!(sim.list(Kind::Pull).is_empty());
    let twice = sim.add_haptic(own).unwrap_err();
    assert!(twice.text.contains("tool `ball`: a device holds it already"), "{twice}");
    let both = sim.haptic_options(ball, &[1]).unwrap();
    assert!(sim.add_haptic(both).unwrap_err().code == Code::Argument);
    for step in 0..=40 {
        let down = 1e-4 * f64::from(if step < 30 { step } else { 120 - 3 * step });
        let felt = device.exchange([0.0, 0.0, -down], [0.0; 3], 0.02).unwrap();
        sim.step(1).unwrap();
        if step == 30 {
            assert!(
                felt.force.z > 0.05 && sim.tool_report(ball).unwrap().yields.z > 2e-4,
                "{felt:?}"
            );
        }
    }
    let felt = device.exchange([0.0; 3], [0.0; 3], 0.02).unwrap();
    assert_eq!(felt.force, DVec3::ZERO, "{felt:?}");
    // a tool that is let go stays, and goes where it is told
    device.exchange([0.0, 0.0, -2e-3], [0.0; 3], 0.02).unwrap();
    sim.step(1).unwrap();
    let stood = sim.tool_report(ball).unwrap().position;
    let in_hand = sim.snapshot().unwrap();
    sim.let_go(ball).unwrap();
    assert_eq!(sim.let_go(ball).unwrap_err().code, Code::Handle);
    sim.step(3).unwrap();
    // going back puts it on its spring again, of which no device knows any more
    sim.restore(&in_hand).unwrap();
    assert!(sim.add_haptic(sim.haptic_options(ball, &[]).unwrap()).is_err());
    sim.let_go(ball).unwrap();
    sim.step(3).unwrap();
    let own = sim.tool_report(ball).unwrap();
    assert!(own.position == stood && own.yields == DVec3::ZERO, "{own:?} {stood}");
    let up = ToolPose { position: stood + DVec3::Z * 0.01, ..ToolPose::default() };
    sim.move_tool(ball, up).unwrap();
    sim.step(1).unwrap();
    assert_eq!(sim.tool_report(ball).unwrap().position, up.position);
    // a patch is not held any more
    let hold = sim.haptic_options(body, &patch(&sim, body)).unwrap();
    let (pull, _) = sim.add_haptic(hold).unwrap();
    sim.let_go(pull).unwrap();
    assert!(sim.list(Kind::Pull).is_empty());
    sim.remove(ball).unwrap();
    assert_eq!(sim.let_go(pull).unwrap_err().code, Code::Handle);
    sim.step(1).unwrap();
}

#[test]
fn handles_that_cannot_be_are_told() {
    let (mut sim, body, hold) = held(&options());
    let top = patch(&sim, body);
    assert_eq!(sim.haptic_options(hold, &top).unwrap_err().code, Code::Handle);
    let good = sim.haptic_options(body, &top).unwrap();
    for (own, text) in [
        (HapticOptions { stiffness: -1.0, ..good.clone() }, "stiffness is -1 N/m"),
        (HapticOptions { vertices: vec![], ..good.clone() }, "no vertex"),
        (HapticOptions { vertices: vec![75], ..good.clone() }, "vertex 75"),
        (HapticOptions { name: " ".into(), ..good.clone() }, "the name is empty"),
    ] {
        let error = sim.add_haptic(own).unwrap_err();
        assert_eq!(error.code, Code::Argument, "{error}");
        assert!(error.text.contains(text), "{error}");
    }
    assert!(sim.list(Kind::Pull).is_empty());
    sim.step(1).unwrap();
}

/// Area-weighted normals, found from what the doors say.
fn normals(sim: &mut Embedding, body: Handle) -> Vec<DVec3> {
    let x = sim.positions(body).unwrap().to_vec();
    let x: Vec<_> = x.into_iter().map(DVec3::from_array).collect();
    let mut sums = vec![DVec3::ZERO; x.len()];
    for t in sim.surface(body).unwrap().triangles {
        let [a, b, c] = t.map(|v| x[v as usize]);
        t.iter().for_each(|&v| sums[v as usize] += (b - a).cross(c - a));
    }
    sums.into_iter().map(|n| n.normalize_or_zero()).collect()
}

#[test]
fn readers_follow_steps_ways_back_removals_and_cuts() {
    let mesh = slab();
    let mut with_loose = mesh.clone();
    with_loose.points.push(DVec3::splat(7.0));
    let mut sim = Embedding::new(&Options { gravity: [0.0, 0.0, -9.81], ..options() }).unwrap();
    let own = BodyDescription::new("slab", &with_loose, preset("liver").unwrap());
    let own = BodyDescription { spare: mesh.points.len(), ..own };
    let body = sim.add_body(&with_loose, &own).unwrap();
    let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.05, 0.05, -0.019));
    let ball = sim.add_tool(ball, None).unwrap();
    let mut reader = sim.share(&[], &[]).unwrap();
    let mut same = |sim: &mut Embedding, is_new: bool| {
        assert_eq!(reader.update(), is_new);
        assert_eq!((reader.step(), reader.time()), (sim.steps_done(), sim.time()));
        let last = reader.body(body, Shared::Positions, f64::INFINITY).unwrap();
        assert_eq!(last, sim.positions(body).unwrap());
        let found = reader.body(body, Shared::Normals, f64::INFINITY).unwrap().to_vec();
        let wanted = normals(sim, body);
        assert_eq!(found.len(), wanted.len());
        for (own, n) in found.iter().zip(&wanted) {
            assert!(DVec3::from_array(*own).distance(*n) < 1e-12, "{own:?} {n:?}");
        }
        let wrench = reader.tool(ball, f64::INFINITY).unwrap();
        assert_eq!(wrench[0], sim.tool_report(ball).unwrap().force.to_array());
        wanted.iter().filter(|n| **n != DVec3::ZERO).count()
    };
    let outside = same(&mut sim, false);
    assert_eq!(outside, 66, "nine of 75 vertices are inside, one is in no element");
    let start = sim.snapshot().unwrap();
    sim.step(5).unwrap();
    same(&mut sim, true);
    let region = Region::Sphere { centre: DVec3::new(0.0, 0.0, 0.05), radius: 0.03 };
    sim.remove_elements(body, region, MassPolicy::default()).unwrap();
    sim.step(1).unwrap();
    let after = same(&mut sim, true);
    sim.restore(&start).unwrap();
    assert!(same(&mut sim, true) == outside && after != outside);
    let edge = |y: f64| [DVec3::new(0.055, y, 0.08), DVec3::new(0.055, y, 0.02)];
    let whole = sim.surface(body).unwrap().triangles.len();
    sim.cut(body, &[edge(-0.01), edge(0.11)]).unwrap();
    sim.step(1).unwrap();
    same(&mut sim, true);
    assert!(
        sim.surface(body).unwrap().triangles.len() < whole,
        "elements that were cut count no more"
    );
    // between two states
    sim.step(1).unwrap();
    let before = reader.body(body, Shared::Positions, f64::INFINITY).unwrap()[2];
    assert!(reader.update());
    let last = reader.body(body, Shared::Positions, f64::INFINITY).unwrap()[2];
    let middle = reader.body(body, Shared::Positions, sim.time() - 0.005).unwrap()[2];
    assert!((middle[2] - 0.5 * (before[2] + last[2])).abs() < 1e-12 && before != last);
    let unit = reader.body(body, Shared::Normals, sim.time() - 0.005).unwrap()[0];
    assert!((DVec3::from_array(unit).length() - 1.0).abs() < 1e-12);
    let error = reader.body(ball, Shared::Normals, 0.0).unwrap_err();
    assert!(error.code == Code::Argument && error.text.contains("share it, too"), "{error}");
    assert!(reader.tool(ball, f64::NAN).unwrap_err().text.contains("it is no number"));
    assert_eq!(sim.share(&[ball], &[]).unwrap_err().code, Code::Handle);
    // what was read last stays when the simulation is gone
    drop(sim);
    assert!(!reader.update());
    assert_eq!(reader.body(body, Shared::Positions, f64::INFINITY).unwrap()[2], last);
}
