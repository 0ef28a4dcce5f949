//! Group 13, figures: grasping, friction on an incline and in a drag, the force of a press for any step and
//! stiffness, and a ball on a cylinder beside the continuum.

use super::prelude::*;
use super::touch_rig::{BLOCK, RADIUS, STEP, ToolHand, held, single};
use sinew::engine::mesh::generate::cylinder_tets;
use sinew::touch::tool::{Points, Stiffness};

const GRASP: CasePart = CasePart {
    group: 13,
    name: "grasp, lift, hold for 10 s, let go",
    criterion: "weight to 1e-3; slip in 10 s < 1e-3 edge; force exactly 0 after release",
};
const AGAIN: CasePart = CasePart {
    group: 13,
    name: "1 000 grasps",
    criterion: "force exactly 0 after each; shape at the end as if there had been none",
};
const INCLINE: CasePart = CasePart {
    group: 13,
    name: "incline at 0.99 and 1.01 of friction",
    criterion: "holds within 1 um/s, slides: T/N to 1e-4, acceleration to 0.2 %",
};
const DRAG: CasePart =
    CasePart { group: 13, name: "drag in full slip", criterion: "friction over pressure to 1e-4" };
const PRESS: CasePart = CasePart {
    group: 13,
    name: "force of a press",
    criterion: "the same to 0.5 % for steps of 1, 10, 33 ms; stiffness doubled: 2 %",
};
const CONTINUUM: CasePart = CasePart {
    group: 13,
    name: "ball on a cylinder, three meshes",
    criterion: "within 10 % of the continuum, their mean within 5 %; stiffness doubled: 2 %",
};
const FRICTION: f64 = 0.3;
const G: f64 = 9.81;
/// Size (m) of the cube that is grasped and of the block that slides.
const CUBE: f64 = 0.03;
const SLIDER: DVec3 = DVec3::new(0.06, 0.06, 0.02);

pub(super) fn cases() -> Result<Cases, MeshError> {
    let cube = Arc::new(box_tets(DVec3::splat(CUBE), [4; 3])?);
    let small = Arc::new(box_tets(DVec3::splat(CUBE), [2; 3])?);
    let slider = Arc::new(box_tets(SLIDER, [4, 4, 2])?);
    let block = Arc::new(box_tets(BLOCK, [8, 8, 4])?);
    let mut cases = Cases::default();
    let mut add =
        |part, name: &str, quick, mesh: &Arc<Mesh>, run: fn(&CaseSetting, &Mesh) -> CaseOutcome| {
            cases.within(Scope::Robust, part, name.into(), quick, mesh, run);
        };
    add(GRASP, "h 0.0100", false, &cube, |s, m| grasp(s, m, 0.01));
    add(GRASP, "h 0.0333", false, &cube, |s, m| grasp(s, m, 1.0 / 30.0));
    add(GRASP, "h 0.0100 in f32", false, &cube, |s, m| grasp(&single(s), m, 0.01));
    add(AGAIN, "cube", false, &small, again);
    add(INCLINE, "h 0.0020", false, &slider, |s, m| incline(s, m, 0.002));
    add(INCLINE, "h 0.0100", false, &slider, |s, m| incline(s, m, 0.01));
    add(INCLINE, "h 0.0333", true, &slider, |s, m| incline(s, m, 1.0 / 30.0));
    add(DRAG, "h 0.0010", true, &slider, |s, m| drag(s, m, 0.001));
    add(DRAG, "h 0.0100", true, &slider, |s, m| drag(s, m, 0.01));
    add(DRAG, "h 0.0333", true, &slider, |s, m| drag(s, m, 1.0 / 30.0));
    add(DRAG, "h 0.0100 in f32", false, &slider, |s, m| drag(&single(s), m, 0.01));
    add(PRESS, "ball of 20 mm, 5 mm deep", false, &block, press);
    // axisymmetric elements of second order with exact contact, refined until the force changed by less than 0.2 %
    for (depth, force) in [(0.002, 0.194_757_8), (0.006, 0.888_448_0), (0.010, 1.731_951_1)] {
        let name = format!("{:.0} mm deep", 1e3 * depth);
        let run = move |s: &CaseSetting, _: &Mesh| continuum(s, depth, force);
        cases.within(Scope::Once, CONTINUUM, name, false, &small, run);
    }
    Ok(cases)
}

/// Two jaws beside a cube that stands at the origin, with a gap (m) to it.
fn jaws(run: &mut CaseRun, gap: f64, friction: f64) -> Result<[ToolHand; 2]> {
    let half = DVec3::splat(0.02);
    let mut jaw = |side: f64| {
        let at =
            DVec3::new(0.5 * CUBE + side * (0.5 * CUBE + gap + half.x), 0.5 * CUBE, 0.5 * CUBE);
        let shape = Shape::Box { half, rounding: 0.004 };
        let mut jaw = Tool::new("jaw", shape, at).with_friction(friction);
        // wide and flat: vertices are dense enough
        jaw.points = Points::Vertex;
        ToolHand::new(run, jaw)
    };
    Ok([jaw(-1.0)?, jaw(1.0)?])
}

/// Both jaws go on by as much: towards each other, and along.
fn both(run: &mut CaseRun, jaws: &mut [ToolHand; 2], closer: f64, along: DVec3) -> Result<()> {
    jaws[0].shift(run, DVec3::X * closer + along)?;
    jaws[1].shift(run, DVec3::X * -closer + along)?;
    run.step()
}

fn grasp(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, 0.45)?;
    run.simulation.set_dt(dt);
    run.simulation.set_gravity(DVec3::NEG_Z * G);
    let ground = Tool::ground("ground", DVec3::ZERO, DVec3::Z).with_friction(FRICTION);
    run.simulation.add_tool(ground)?;
    let mut jaws = jaws(&mut run, 0.001, 0.5)?;
    run.open_books();
    let weight = run.mass() * G;
    // closed by 1.5 mm each, lifted by 50 mm, settled
    let phase = |seconds: f64| (seconds / dt).round();
    for _ in 0..phase(0.3) as u32 {
        both(&mut run, &mut jaws, 0.0025 / phase(0.3), DVec3::ZERO)?;
    }
    for _ in 0..phase(0.5) as u32 {
        both(&mut run, &mut jaws, 0.0, DVec3::Z * 0.05 / phase(0.5))?;
    }
    run.seconds(dt, 2.0)?;
    let before = run.simulation.positions(run.body);
    run.seconds(dt, 10.0)?;
    let after = run.simulation.positions(run.body);
    let way = before.iter().zip(&after).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    let lifted = before.iter().map(|x| x.z).fold(f64::INFINITY, f64::min);
    let carried = jaws.iter().map(|jaw| -jaw.force(&run).z).sum::<f64>();
    for _ in 0..phase(0.3) as u32 {
        both(&mut run, &mut jaws, -0.01 / phase(0.3), DVec3::ZERO)?;
    }
    run.seconds(dt, 0.5)?;
    let left: f64 = jaws.iter().map(|jaw| jaw.force(&run).length()).sum();
    let checks = [
        Check::at_least("height while held (m)", lifted, 0.04),
        Check::at_most("force off the weight, relative", (carried / weight - 1.0).abs(), 1e-3),
        Check::at_most("way in 10 s over edge", way / (CUBE / 4.0), setting.loose(1e-3)),
        Check::at_most("force after release (N)", left, 0.0),
    ];
    let scale = run.largest.max(weight * 0.05);
    Ok(run.finish(scale, checks))
}

/// A cube that stands on what holds it, as a fold of tissue does: one that lies loose is carried out of the jaws by and
/// by, and later grasps would find nothing.
fn again(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, 0.45)?;
    run.simulation.set_dt(STEP);
    run.clamp("z0")?;
    let mut jaws = jaws(&mut run, 0.002, 0.5)?;
    run.open_books();
    let (mut left, mut least) = (0.0_f64, f64::INFINITY);
    for _ in 0..1000 {
        // closed by 1.5 mm each, lifted by as much, let go
        for lift in [0.0, 0.0, 0.00075, 0.00075] {
            both(&mut run, &mut jaws, 0.000875, DVec3::Z * lift)?;
        }
        least = least.min(jaws[1].force(&run).x);
        for lift in [0.0, 0.0, 0.00075, 0.00075] {
            both(&mut run, &mut jaws, -0.000875, DVec3::NEG_Z * lift)?;
        }
        for _ in 0..4 {
            run.step()?;
        }
        left = jaws.iter().map(|jaw| jaw.force(&run).length()).fold(left, f64::max);
    }
    // away from everything, to rest
    for _ in 0..10 {
        both(&mut run, &mut jaws, -0.002, DVec3::ZERO)?;
    }
    run.steps(500)?;
    let error = run.edge_error();
    let contact = run.simulation.report().contact;
    let checks = [
        Check::at_least("least force of a grasp (N)", least, 0.1),
        Check::at_most("largest force after a release (N)", left, 0.0),
        Check::none("points that touch at the end", contact.points.into()),
        Check::at_most("energy left in contacts (J)", contact.energy, 0.0),
        Check::at_most("edge error at the end", error, setting.pick(1e-6, 1e-4)),
    ];
    Ok(run.finish_by_largest(checks))
}

/// Gravity (m/s^2) on an incline of this slope that drops towards +x.
fn tilted(slope: f64) -> DVec3 {
    let angle = libm::atan(slope);
    G * DVec3::new(libm::sin(angle), 0.0, -libm::cos(angle))
}

fn incline(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::damped(setting, mesh, 0.45)?;
    run.simulation.set_dt(dt);
    let ground = Tool::ground("ground", DVec3::ZERO, DVec3::Z).with_friction(FRICTION);
    let ground = ToolHand::new(&mut run, ground)?;
    let masses = run.simulation.masses(run.body);
    let mass: f64 = masses.iter().sum();
    let centre = move |run: &mut CaseRun, fast: bool| {
        let of = if fast {
            run.simulation.velocities(run.body)
        } else {
            run.simulation.positions(run.body)
        };
        masses.iter().zip(&of).map(|(m, x)| m * x.x).sum::<f64>() / mass
    };
    let ratio = |run: &CaseRun| {
        let force = ground.force(run);
        force.x / -force.z / FRICTION
    };
    run.open_books();
    let ramp = (2.0 / dt).round();
    run.simulation.set_gravity(tilted(0.0));
    run.seconds(dt, 1.0)?;
    for i in 1..=ramp as u32 {
        run.simulation.set_gravity(tilted(0.99 * FRICTION * f64::from(i) / ramp));
        run.step()?;
    }
    run.seconds(dt, 1.0)?;
    let before = centre(&mut run, false);
    run.seconds(dt, 1.0)?;
    let creep = (centre(&mut run, false) - before).abs();
    let held = (ratio(&run) / 0.99 - 1.0).abs();
    // damping would hold it back
    run.solver(|s| s.mass_damping = 0.0);
    run.simulation.set_gravity(tilted(1.01 * FRICTION));
    run.seconds(dt, 1.0)?;
    let (start, clock) = (centre(&mut run, true), run.simulation.time());
    let mut off = 0.0_f64;
    for _ in 0..(1.0 / dt) as u32 {
        run.step()?;
        off = off.max((ratio(&run) - 1.0).abs());
    }
    let pull = tilted(1.01 * FRICTION);
    let acceleration = (centre(&mut run, true) - start) / (run.simulation.time() - clock);
    let expected = pull.x + FRICTION * pull.z;
    let checks = [
        Check::at_most("speed while held (m/s)", creep, setting.loose(1e-6)),
        Check::at_most(
            "friction over its limit off 0.99 while held, relative",
            held,
            setting.loose(1e-4),
        ),
        Check::at_most("friction over its limit off 1 while sliding", off, setting.loose(1e-4)),
        Check::at_most(
            "acceleration off, relative",
            (acceleration / expected - 1.0).abs(),
            setting.loose(2e-3),
        ),
    ];
    let scale = mass * G * SLIDER.z;
    Ok(run.finish(scale, checks))
}

/// A block held at its top, and a plane that is pressed on it from below by 1 mm and dragged by 30 mm.
fn drag(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut run = held(setting, mesh, &["z1"])?;
    run.simulation.set_dt(dt);
    let plane = Tool::ground("plane", DVec3::ZERO, DVec3::Z).with_friction(FRICTION);
    let mut plane = ToolHand::new(&mut run, plane)?;
    plane.go(&mut run, DVec3::Z * 0.001, 0.01, dt)?;
    plane.go(&mut run, DVec3::new(0.03, 0.0, 0.001), 0.05, dt)?;
    let report = run.simulation.tool_report(plane.tool).cloned().unwrap_or_default();
    let ratio = report.friction.length() / report.normal.length() / FRICTION;
    let checks = [
        Check::at_least("pressing force (N)", -report.normal.z, 1.0),
        Check::none("points that stick at the end", report.sticking.into()),
        Check::at_most("friction over its limit off 1", (ratio - 1.0).abs(), setting.loose(1e-4)),
    ];
    Ok(run.finish_by_largest(checks))
}

fn press(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let pressed = |dt: f64, stiffness: f64| -> Result<(CaseRun, f64)> {
        let mut run = held(setting, mesh, &["z0"])?;
        run.simulation.set_dt(dt);
        let above = DVec3::new(0.05, 0.05, BLOCK.z + RADIUS);
        let mut tool = Tool::new("ball", Shape::Sphere { radius: RADIUS }, above);
        tool.stiffness = Stiffness::Relative(stiffness);
        let mut hand = ToolHand::new(&mut run, tool)?;
        hand.go(&mut run, above - DVec3::Z * 0.005, 0.1, dt)?;
        run.seconds(dt, 2.0)?;
        let force = hand.force(&run).z;
        Ok((run, force))
    };
    let (run, middle) = pressed(0.01, 50.0)?;
    let off = |(_, force): (CaseRun, f64)| (force / middle - 1.0).abs();
    let checks = [
        Check::at_most("force at 1 ms, relative to 10 ms", off(pressed(0.001, 50.0)?), 0.005),
        Check::at_most("force at 33 ms, relative to 10 ms", off(pressed(1.0 / 30.0, 50.0)?), 0.005),
        Check::at_most("force at twice the stiffness", off(pressed(0.01, 100.0)?), 0.02),
        Check::at_least("force (N)", middle, 0.1),
    ];
    Ok(run.finish_by_largest(checks))
}

/// A cylinder of radius 50 mm and height 40 mm along z, whose cells are smallest in the middle of its top: 0.4 of
/// their mean size.
fn graded(rings: usize, layers: usize) -> Result<Mesh, MeshError> {
    let (radius, height) = (0.05, 0.04);
    let mut mesh = cylinder_tets(radius, height, rings, layers)?;
    let graded = |s: f64| s * (0.4 + 0.6 * s);
    for x in &mut mesh.points {
        let flat = DVec3::new(x.y, x.z, 0.0);
        let r = flat.length() / radius;
        let scale = if r > 0.0 { graded(r) / r } else { 0.0 };
        *x = scale * flat + DVec3::Z * height * (1.0 - graded(1.0 - x.x / height));
    }
    Ok(mesh)
}

/// Rings and layers, refined evenly. Coarser ones of the same grading have contact radii of three edges too, but cells
/// beside and below that are too stiff: force of 8, 10, 12, 16 rings 10 mm deep is 7.4, 6.6, 5.6, 3.7 % above the
/// continuum, of 20 rings without grading 1.7 %.
const MESHES: [[usize; 2]; 3] = [[12, 11], [16, 14], [20, 18]];

fn continuum(setting: &CaseSetting, depth: f64, truth: f64) -> CaseOutcome {
    let pressed = |[rings, layers]: [usize; 2], stiffness: f64| -> Result<_> {
        let mesh = graded(rings, layers)?;
        let mut run = CaseRun::new(setting, &mesh, tissue(1e4, 0.4))?;
        run.solver(|s| {
            s.integrator = Integrator::QuasiStatic;
            s.newton_tolerance = setting.pick(1e-9, 1e-6);
        });
        run.clamp("x0")?;
        let above = DVec3::Z * (0.04 + RADIUS);
        let mut tool = Tool::new("ball", Shape::Sphere { radius: RADIUS }, above);
        tool.points = Points::Vertex;
        tool.stiffness = Stiffness::Relative(stiffness);
        let mut hand = ToolHand::new(&mut run, tool)?;
        hand.go(&mut run, above - DVec3::Z * depth, 1.0, 1e-3)?;
        let force = hand.force(&run).z;
        Ok((force, run.close()))
    };
    let mut forces = Vec::new();
    for cells in MESHES {
        forces.push(pressed(cells, 50.0)?.0);
    }
    let (stiffer, figures) = pressed(MESHES[0], 100.0)?;
    let off = |force: f64| (force / truth - 1.0).abs();
    let worst = forces.iter().map(|f| off(*f)).fold(0.0, f64::max);
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    let checks = vec![
        Check::at_most("force off the continuum, worst of three meshes", worst, 0.1),
        Check::at_most("mean force off the continuum", off(mean), 0.05),
        Check::at_most("change at twice the stiffness", (stiffer / forces[0] - 1.0).abs(), 0.02),
    ];
    Ok((figures, checks))
}
