//! Group 13: tools that go through bodies, appear inside of them, squeeze them to nothing, hit them at 10 m/s and are
//! thinner than their edges; bodies that fall, lie on each other and roll. Friction and figures are in `friction`.

use super::friction;
use super::prelude::*;
use super::touch_rig::{BLOCK, DAMPING, RADIUS, STEP, ToolHand, held, single};
use crate::toolbox::beam;
use glam::{DQuat, DVec2};
use sinew::engine::mesh::generate::{irregular_box_tets, sphere_tets, triangle_grid};
use sinew::models::body::present::MassPolicy;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::material::field::MaterialField;
use sinew::models::resection::Removal;

const THROUGH: CasePart = CasePart {
    group: 13,
    name: "tool right through a body",
    criterion: "shape regained to 1 % in edges, none inverted, force exactly 0 after withdrawal",
};
const INSIDE: CasePart = CasePart {
    group: 13,
    name: "tool appears inside",
    criterion: "the body makes way at no more than 0.5 m/s: none inverted, depth < 0.25 edge after 1 s",
};
const SQUEEZED: CasePart = CasePart {
    group: 13,
    name: "membrane between two tools that overlap",
    criterion: "forces cancel to 1e-3; shape regained to 1e-3 in edges, force exactly 0 afterwards",
};
const FALLS: CasePart = CasePart {
    group: 13,
    name: "fall on a plane from 1 m",
    criterion: "depth < 0.25 edge at any time; at rest: weight to 1e-3, kinetic energy < 1e-9 of m g 1 m",
};
const STACK: CasePart = CasePart {
    group: 13,
    name: "stack of three at rest for 10 s",
    criterion: "kinetic energy < 1e-9 of weight times height; weight on the ground to 1e-3; in order",
};
const DRAGGED: CasePart = CasePart {
    group: 13,
    name: "block dragged over a block",
    criterion: "none inverted, depth < 0.1 edge, forces on both cancel to 1e-9; lifted off: force exactly 0, \
                shape regained to 1 % in edges",
};
const ROLLS: CasePart = CasePart {
    group: 13,
    name: "ball rolling down an incline",
    criterion: "speed 0.8 to 1.02 of a rigid ball's, turning at 0.9 to 1.1 of speed over radius",
};
const ROUGH: CasePart = CasePart {
    group: 13,
    name: "slivers and contrast 1e4 under a tool",
    criterion: "none inverted at the end, force within 1 % of converged Newton",
};
const REMOVED: CasePart = CasePart {
    group: 13,
    name: "half of the elements removed in contact",
    criterion: "finite, energy bounded, force exactly 0 after withdrawal",
};
const FAST: CasePart = CasePart {
    group: 13,
    name: "probe at 10 m/s",
    criterion: "force within 1 % of that at 0.1 m/s, lag reported, energy not above what it is \
                when the probe stops",
};
const THIN: CasePart = CasePart {
    group: 13,
    name: "capsule of 0.2 edges, 100 places",
    criterion: "its axis never inside, force > 0 while it is dragged",
};
const G: f64 = 9.81;
/// Young's modulus (Pa) of the stack. A column falls when rho g A L^3 / (E I) is above 7.84 (Greenhill 1881); here it is 2.65. At
/// 20 kPa it would be 7.95, and only elements that are too stiff in bending would stand.
const TOWER: f64 = 6e4;

pub(super) fn cases() -> Result<Cases, MeshError> {
    let mut cases = Cases::default();
    let block = Arc::new(box_tets(BLOCK, [6, 6, 3])?);
    let fine = Arc::new(box_tets(BLOCK, [8, 8, 4])?);
    let coarse = Arc::new(box_tets(BLOCK, [4, 4, 2])?);
    let cube = Arc::new(box_tets(DVec3::splat(0.1), [4; 3])?);
    let brick = Arc::new(box_tets(DVec3::splat(0.05), [3; 3])?);
    let sheet = Arc::new(triangle_grid(DVec2::splat(0.1), [8; 2])?);
    let ball = Arc::new(sphere_tets(0.1, 4)?);
    let slivers = Arc::new(irregular_box_tets(BLOCK, [6, 6, 3], 0.3, 1)?);
    let mut add =
        |part, name: &str, quick, mesh: &Arc<Mesh>, run: fn(&CaseSetting, &Mesh) -> CaseOutcome| {
            cases.within(Scope::Robust, part, name.into(), quick, mesh, run);
        };
    add(THROUGH, "block held at two sides", false, &block, through);
    add(THROUGH, "the same in f32", false, &block, |s, m| through(&single(s), m));
    add(INSIDE, "ball of 20 mm in a block", true, &block, inside);
    add(INSIDE, "the same in f32", false, &block, |s, m| inside(&single(s), m));
    add(SQUEEZED, "two balls", true, &sheet, squeezed);
    add(FALLS, "cube h 0.0333", false, &cube, |s, m| falls(s, m, 1.0 / 30.0));
    add(FALLS, "cube h 0.0100", false, &cube, |s, m| falls(s, m, STEP));
    add(FALLS, "cube h 0.0333 in f32", false, &cube, |s, m| falls(&single(s), m, 1.0 / 30.0));
    add(STACK, "cubes", false, &brick, stack);
    add(ROLLS, "20 degrees", false, &ball, rolls);
    add(ROUGH, "slivers", false, &slivers, |s, m| rough(s, m, 1.0));
    add(ROUGH, "contrast", false, &block, |s, m| rough(s, m, 1e4));
    add(REMOVED, "at once", false, &block, |s, m| removed(s, m, 1));
    add(REMOVED, "in 25 steps", false, &block, |s, m| removed(s, m, 25));
    add(FAST, "h 0.0100", false, &fine, |s, m| fast(s, m, STEP));
    add(FAST, "h 0.0333", false, &fine, |s, m| fast(s, m, 1.0 / 30.0));
    add(FAST, "h 0.0100 in f32", false, &fine, |s, m| fast(&single(s), m, STEP));
    add(THIN, "block", false, &fine, thin_on_block);
    add(THIN, "membrane", false, &sheet, thin_on_sheet);
    for (friction, h) in
        [0.0, 0.3, 2.0].into_iter().flat_map(|f| [0.001, STEP, 1.0 / 30.0].map(|h| (f, h)))
    {
        let name = format!("friction {friction} h {h:.4}");
        let run = move |s: &CaseSetting, m: &Mesh| dragged(s, m, friction, h);
        cases.within(Scope::Robust, DRAGGED, name, friction == 0.3 && h == STEP, &coarse, run);
    }
    cases.0.extend(friction::cases()?.0);
    Ok(cases)
}

/// Energy (J) of the body and its contacts after the last step.
fn total(run: &CaseRun) -> f64 {
    let report = run.simulation.report();
    report.kinetic_energy + report.elastic_energy + report.contact.energy
}

fn no_force(hands: &[&ToolHand], run: &CaseRun) -> Check {
    let force = hands.iter().map(|hand| hand.force(run).length()).sum();
    Check::at_most("force after withdrawal (N)", force, 0.0)
}

fn through(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = held(setting, mesh, &["x0", "x1"])?;
    let above = DVec3::new(0.05, 0.05, 0.062);
    let mut hand = ToolHand::ball(&mut run, 0.01, above)?;
    hand.go(&mut run, above - DVec3::Z * 0.092, 0.5, STEP)?;
    run.steps(20)?;
    hand.go(&mut run, above, 0.5, STEP)?;
    run.steps(300)?;
    let [shape, inverted] = run.recovered();
    let scale = run.largest;
    let checks = [shape, inverted, no_force(&[&hand], &run)];
    Ok(run.finish(scale, checks))
}

fn inside(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = held(setting, mesh, &["z0"])?;
    let hand = ToolHand::ball(&mut run, RADIUS, DVec3::new(0.05, 0.05, 0.05))?;
    let mut fastest = 0.0_f64;
    for _ in 0..100 {
        run.step()?;
        let v = run.simulation.velocities(run.body);
        fastest = v.iter().map(|v| v.length()).fold(fastest, f64::max);
    }
    let report = run.simulation.tool_report(hand.tool).cloned().unwrap_or_default();
    let checks = [
        Check::none("inverted at the end", run.inverted()),
        Check::at_most("drawn in at the end (m)", report.drawn_in, 0.0),
        Check::at_most("depth over edge", run.simulation.report().contact.depth_over_edge, 0.25),
        Check::at_most("fastest vertex (m/s)", fastest, 0.5),
        Check::at_least("force at the end (N)", report.force.z, 0.1),
    ];
    Ok(run.finish_by_largest(checks))
}

/// A sheet held at its edges, with damping.
fn sheet<'a>(setting: &CaseSetting, mesh: &'a Mesh) -> Result<CaseRun<'a>> {
    let membrane = MembraneDescription::new(&mesh.triangles, 0.001, tissue(1e4, 0.3));
    let mut run = CaseRun::of(setting, mesh, &beam::sheet("sheet", mesh, membrane))?;
    run.solver(|s| s.mass_damping = DAMPING);
    run.simulation.set_dt(STEP);
    for side in ["x0", "x1", "y0", "y1"] {
        run.clamp(side)?;
    }
    run.open_books();
    Ok(run)
}

fn squeezed(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = sheet(setting, mesh)?;
    let radius = 0.03;
    let place = |side: f64, gap: f64| DVec3::new(0.05, 0.05, side * (radius + gap));
    let mut hands = [1.0, -1.0].map(|side| ToolHand::ball(&mut run, radius, place(side, 0.001)));
    let [Ok(above), Ok(below)] = &mut hands else { return Err("no tool".into()) };
    // until the balls overlap by 2 mm
    for to in 0..50 {
        let way = DVec3::Z * if to < 20 { 1e-4 } else { 0.0 };
        above.shift(&mut run, -way)?;
        below.shift(&mut run, way)?;
        run.step()?;
    }
    let (up, down) = (above.force(&run), below.force(&run));
    let odd = (up + down).length() / up.length();
    for _ in 0..20 {
        above.shift(&mut run, DVec3::Z * 1e-3)?;
        below.shift(&mut run, DVec3::Z * -1e-3)?;
        run.step()?;
    }
    run.steps(200)?;
    let error = run.edge_error();
    let checks = [
        Check::at_least("force while squeezed (N)", up.length(), 1e-3),
        Check::at_most("sum of forces over one", odd, setting.loose(1e-3)),
        Check::at_most("edge error at the end", error, 1e-3),
        no_force(&[above, below], &run),
    ];
    Ok(run.finish_by_largest(checks))
}

fn falls(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    let mut run = CaseRun::new(setting, mesh, tissue(1e4, 0.45))?;
    run.simulation.set_dt(dt);
    run.simulation.set_gravity(DVec3::NEG_Z * G);
    let ground = Tool::ground("ground", DVec3::NEG_Z, DVec3::Z).with_friction(0.5);
    let ground = ToolHand::new(&mut run, ground)?;
    run.open_books();
    let scale = run.mass() * G;
    let mut deepest = 0.0_f64;
    for step in 0..(8.0 / dt) as u32 {
        if f64::from(step) * dt > 1.0 {
            run.solver(|s| s.mass_damping = DAMPING);
        }
        run.step()?;
        deepest = deepest.max(run.simulation.report().contact.depth_over_edge);
    }
    let weight = ground.force(&run).z / -scale - 1.0;
    let kinetic = run.simulation.report().kinetic_energy / scale;
    let checks = [
        Check::at_most("largest depth over edge", deepest, 0.25),
        Check::at_most("force off the weight, relative", weight.abs(), 1e-3),
        Check::at_most("kinetic energy over m g 1 m", kinetic, setting.pick(1e-9, 1e-7)),
        Check::none("inverted at the end", run.inverted()),
    ];
    Ok(run.finish(scale, checks))
}

fn stack(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let size = 0.05;
    let mut run = CaseRun::new(setting, mesh, tissue(TOWER, 0.45))?;
    run.solver(|s| s.mass_damping = DAMPING);
    run.simulation.set_dt(STEP);
    run.simulation.set_gravity(DVec3::NEG_Z * G);
    let ground = Tool::ground("ground", DVec3::ZERO, DVec3::Z).with_friction(0.5);
    let ground = ToolHand::new(&mut run, ground)?;
    let mut bodies = vec![run.body];
    for (i, name) in [(1.0, "middle"), (2.0, "upper")] {
        // shifted, so that no vertex lies on a vertex
        let shift = i * DVec3::new(0.002, 0.003, size);
        bodies.push(above(setting, &mut run, name, shift, tissue(TOWER, 0.45))?.0);
    }
    for pair in bodies.windows(2) {
        let contact = BodyContact::new("touch", [pair[0], pair[1]]).with_friction(0.5);
        run.simulation.add_body_contact(contact);
    }
    run.open_books();
    let weight = 3.0 * run.mass() * G;
    run.seconds(STEP, 10.0)?;
    let heights: Vec<f64> = bodies
        .iter()
        .map(|&body| {
            let x = run.simulation.positions(body);
            x.iter().map(|x| x.z).sum::<f64>() / x.len() as f64
        })
        .collect();
    let apart = heights.windows(2).map(|h| h[1] - h[0]).fold(f64::INFINITY, f64::min);
    let kinetic = run.simulation.report().kinetic_energy / (weight * 3.0 * size);
    let off = (ground.force(&run).z / -weight - 1.0).abs();
    let checks = [
        Check::at_most(
            "kinetic energy over weight times height",
            kinetic,
            setting.pick(1e-9, 1e-7),
        ),
        Check::at_most("force off the weight, relative", off, 1e-3),
        Check::at_least("least distance of centres over size", apart / size, 0.7),
    ];
    Ok(run.finish(weight * 3.0 * size, checks))
}

/// Another body of the mesh, shifted, with its mesh.
fn above(
    setting: &CaseSetting,
    run: &mut CaseRun,
    name: &str,
    shift: DVec3,
    material: YoungPoisson,
) -> Result<(BodyHandle, Mesh)> {
    let mesh = run.mesh.transformed(1.0, DQuat::IDENTITY, shift);
    let body = BodyDescription {
        model: setting.column.model,
        volume: setting.column.volume,
        integration: setting.column.cells.integration(),
        ..BodyDescription::new(name, &mesh, material)
    };
    Ok((run.simulation.add_body(&body)?, mesh))
}

/// A hand presses a block on another one, drags it, waits, lifts it off.
fn dragged(setting: &CaseSetting, mesh: &Mesh, friction: f64, h: f64) -> CaseOutcome {
    let mut run = held(setting, mesh, &["z0"])?;
    let shift = DVec3::new(0.003, 0.002, BLOCK.z);
    let (upper, of_upper) = above(setting, &mut run, "upper", shift, tissue(1e4, 0.45))?;
    let rows = run.simulation.group_rows(upper, &of_upper, "z1")?;
    let hand = run.simulation.add_constraint(Constraint::hold("hand", rows));
    let contact = BodyContact::new("touch", [run.body, upper]).with_friction(friction);
    let contact = run.simulation.add_body_contact(contact);
    run.simulation.set_dt(h);
    run.open_books();
    let (down, aside) = (DVec3::NEG_Z * 0.004, DVec3::X * 0.01);
    let way = [down, down + aside, down + aside, DVec3::Z * 0.02, DVec3::Z * 0.02];
    let mut from = DVec3::ZERO;
    let [mut depth, mut off, mut most] = [0.0_f64; 3];
    for (to, seconds) in way.into_iter().zip([0.1, 0.1, 0.1, 0.1, 1.0]) {
        let steps = (seconds / h).ceil() as u32;
        for step in 1..=steps {
            let at = from.lerp(to, f64::from(step) / f64::from(steps));
            run.simulation.set_target(hand, at)?;
            run.step()?;
            depth = depth.max(run.simulation.report().contact.depth_over_edge);
            let forces = [run.body, upper].map(|body| run.simulation.contact_forces(body));
            let size: f64 = forces.iter().flatten().map(|f| f.length()).sum();
            off = off
                .max(forces.iter().flatten().sum::<DVec3>().length() / size.max(f64::MIN_POSITIVE));
            most = most.max(size);
        }
        from = to;
    }
    let force =
        run.simulation.body_contact_report(contact).map_or(DVec3::NAN, |report| report.force);
    let [shape, inverted] = run.recovered();
    let most_inverted = run.figures.most_inverted;
    let checks = [
        shape,
        inverted,
        Check::none("most inverted in a step", most_inverted),
        Check::at_most("depth over edges", depth, 0.1),
        Check::at_most("sum of forces over that of magnitudes", off, setting.pick(1e-9, 1e-5)),
        Check::at_least("sum of magnitudes of forces (N)", most, 1.0),
        Check::at_most("force once lifted (N)", force.length(), 0.0),
    ];
    let scale = run.largest;
    Ok(run.finish(scale, checks))
}

/// A stiff ball from rest, half a second.
fn rolls(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let (angle, dt, seconds) = (20.0_f64.to_radians(), 0.002, 0.5);
    let mut run = CaseRun::new(setting, mesh, tissue(1e6, 0.3))?;
    run.simulation.set_dt(dt);
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    run.simulation.set_gravity(G * DVec3::new(sin, 0.0, -cos));
    let lowest = mesh.points.iter().map(|x| x.z).fold(0.0, f64::min);
    let ground = Tool::ground("ground", DVec3::Z * lowest, DVec3::Z).with_friction(0.6);
    run.simulation.add_tool(ground)?;
    run.open_books();
    run.seconds(dt, seconds)?;
    let masses = run.simulation.masses(run.body);
    let (x, v) = (run.simulation.positions(run.body), run.simulation.velocities(run.body));
    let mass: f64 = masses.iter().sum();
    let mean = |of: &[DVec3]| masses.iter().zip(of).map(|(m, x)| *m * *x).sum::<DVec3>() / mass;
    let (centre, speed) = (mean(&x), mean(&v));
    let (mut spin, mut inertia) = (0.0, 0.0);
    for (m, (x, v)) in masses.iter().zip(x.iter().zip(&v)) {
        let (arm, way) = (*x - centre, *v - speed);
        spin += m * arm.cross(way).y;
        inertia += m * (arm.x * arm.x + arm.z * arm.z);
    }
    let radius = 0.1;
    let rigid = G * sin * seconds / (1.0 + inertia / (mass * radius * radius));
    let turning = spin / inertia * radius / speed.x;
    let checks = [
        Check::at_least("speed over that of a rigid ball", speed.x / rigid, 0.8),
        Check::at_most("the same", speed.x / rigid, 1.02),
        Check::at_least("turning over speed over radius", turning, 0.9),
        Check::at_most("the same, from above", turning, 1.1),
    ];
    Ok(run.finish(mass * G * sin * speed.x * seconds / 2.0, checks))
}

/// Pressed by 5 mm, dragged by 20 mm, held; one half of the block is stiffer by a factor.
fn rough(setting: &CaseSetting, mesh: &Mesh, contrast: f64) -> CaseOutcome {
    if contrast > 1.0 {
        setting.of_tetrahedra()?;
    }
    let press = |setting: &CaseSetting, tight: bool| -> Result<(CaseRun, ToolHand)> {
        let mut run = held(setting, mesh, &["z0"])?;
        let x = |t: &[u32; 4]| t.iter().map(|&v| mesh.points[v as usize].x).sum::<f64>() / 4.0;
        let young: Vec<f64> = mesh
            .tetrahedra
            .iter()
            .map(|t| if x(t) > 0.05 { 1e4 * contrast } else { 1e4 })
            .collect();
        if contrast > 1.0 {
            let material = tissue(1e4, 0.45);
            let mut field = MaterialField::from(material);
            field.young_modulus = Some(&young);
            run.simulation.set_material(run.body, field)?;
            run.open_books();
        }
        if tight {
            run.solver(|s| {
                s.mass_damping = DAMPING;
                s.linear_tolerance = 1e-6;
                s.max_newton_iterations = 100;
            });
        }
        let above = DVec3::new(0.035, 0.05, 0.071);
        let mut hand = ToolHand::ball(&mut run, RADIUS, above)?;
        let down = above - DVec3::Z * 0.006;
        hand.go(&mut run, down, 0.05, STEP)?;
        hand.go(&mut run, down + DVec3::X * 0.02, 0.05, STEP)?;
        run.steps(150)?;
        Ok((run, hand))
    };
    let (run, hand) = press(setting, false)?;
    let newton = PassColumn { integrator: Integrator::Newton, ..setting.column };
    let twin = CaseSetting { column: newton, precision: Precision::F64, ..*setting };
    let (twin, truth) = press(&twin, true)?;
    let (found, truth) = (hand.force(&run), truth.force(&twin));
    let checks = [
        Check::none("inverted at the end", run.inverted()),
        Check::at_least("force (N)", found.z, 0.1),
        Check::at_most(
            "force off Newton's, relative",
            found.distance(truth) / truth.length(),
            0.01,
        ),
    ];
    Ok(run.finish_by_largest(checks))
}

fn removed(setting: &CaseSetting, mesh: &Mesh, parts: usize) -> CaseOutcome {
    let mut run = held(setting, mesh, &["z0"])?;
    let above = DVec3::new(0.04, 0.05, 0.071);
    let mut hand = ToolHand::ball(&mut run, RADIUS, above)?;
    hand.go(&mut run, above - DVec3::Z * 0.009, 0.05, STEP)?;
    let mut all: Vec<u32> = (0..run.elements() as u32).collect();
    let mut random = CaseRandom(0x2345_6789_abcd_ef01);
    let half = all.len() / 2;
    for i in 0..half {
        let rest = (all.len() - i) as f64;
        all.swap(i, i + (random.number() * rest) as usize);
    }
    for some in all[..half].chunks(half.div_ceil(parts)) {
        let region = run.region(some);
        run.remove(&Removal { region, mass: MassPolicy::Recompute })?;
        hand.shift(&mut run, DVec3::X * 5e-4)?;
        run.step()?;
    }
    run.steps(25)?;
    let up = DVec3::new(hand.at.x, hand.at.y, 0.2);
    hand.go(&mut run, up, 0.5, STEP)?;
    run.steps(100)?;
    let fresh = run.simulation.verify_against_fresh(run.body)?.largest();
    let checks = [
        Check::at_most("difference from a fresh build", fresh, setting.pick(1e-12, 2e-5)),
        no_force(&[&hand], &run),
    ];
    Ok(run.finish_by_largest(checks))
}

fn fast(setting: &CaseSetting, mesh: &Mesh, dt: f64) -> CaseOutcome {
    // 15 mm deep, after a way of 0.1 m
    let deep = DVec3::new(0.05, 0.05, 0.05 + RADIUS - 0.015);
    let press = |speed: f64| -> Result<(CaseRun, ToolHand, [f64; 2])> {
        let mut run = held(setting, mesh, &["z0"])?;
        run.simulation.set_dt(dt);
        let mut hand = ToolHand::ball(&mut run, RADIUS, deep + DVec3::Z * 0.1)?;
        // a tool that is given a target before its first step begins there
        run.step()?;
        hand.go(&mut run, deep, speed, dt)?;
        let (mut stopped, mut rise, mut silent) = (total(&run), 0.0_f64, 0.0_f64);
        let mut there = false;
        for _ in 0..(3.0 / dt) as u32 {
            let report = run.simulation.tool_report(hand.tool).cloned().unwrap_or_default();
            let missing = report.position.distance(deep);
            silent = silent.max(missing - report.lag);
            if !there {
                (there, stopped) = (missing == 0.0, total(&run));
            }
            run.step()?;
            rise = if there { rise.max(total(&run) / stopped - 1.0) } else { rise };
        }
        let rise = if there { rise } else { f64::NAN };
        Ok((run, hand, [rise, silent]))
    };
    let (run, hand, [rise, silent]) = press(10.0)?;
    let (slow, truth, _) = press(0.1)?;
    let (found, truth) = (hand.force(&run), truth.force(&slow));
    let place = run.simulation.tool_report(hand.tool).map_or(DVec3::NAN, |r| r.position);
    let checks = [
        Check::at_most("force off the slow one's, relative", found.distance(truth) / truth.z, 0.01),
        Check::at_most("rise of energy after the stop, relative", rise, setting.loose(1e-6)),
        Check::at_most("way that is missing and not reported (m)", silent, 1e-12),
        Check::at_most("probe off its target at the end (m)", place.distance(deep), 1e-15),
        Check::none("inverted at the end", run.inverted()),
    ];
    Ok(run.finish_by_largest(checks))
}

/// Ten edges of a surface of the block or sheet, mean: `n` cells on `size` (m), both with diagonals.
fn edge(size: f64, n: f64) -> f64 {
    size / n * (2.0 + std::f64::consts::SQRT_2) / 3.0
}

/// A thin capsule comes down on a surface until it touches and half an edge on, goes sideways by an edge, and leaves, at
/// 100 places; `inside` tells whether a point of its axis has got to the wrong side. A slack membrane does not come
/// back to where it was: a capsule that began at a fixed height could begin below it.
fn thin(
    run: &mut CaseRun,
    [half_length, edge]: [f64; 2],
    mut inside: impl FnMut(&mut CaseRun, DVec3) -> bool,
) -> Result<Vec<Check>> {
    let radius = 0.2 * edge;
    let shape = Shape::Capsule { half_length, radius };
    let start = DVec3::new(0.05, 0.05, 1.0);
    let tool = run.simulation.add_tool(Tool::new("needle", shape, start))?;
    let mut random = CaseRandom(0x1357_9bdf_0246_8ace);
    let (mut least, mut wrong) = (f64::INFINITY, 0);
    for _ in 0..100 {
        let place = 0.035 + 0.03 * random.vector();
        let angle = std::f64::consts::TAU * random.number();
        let rotation = DQuat::from_rotation_z(angle);
        let across = rotation * DVec3::Y;
        // the surface comes to rest before the next place
        run.simulation.place_tool(tool, start)?;
        run.steps(10)?;
        let places = run.simulation.positions(run.body);
        let near = |x: &&DVec3| (**x - place).truncate().length() < half_length + 1.5 * edge;
        let top = places.iter().filter(near).map(|x| x.z).fold(f64::NEG_INFINITY, f64::max);
        let pose = |sideways: f64, height: f64| {
            let flat = DVec3::new(place.x, place.y, top + radius + height) + sideways * across;
            ToolPose { position: flat, rotation, opening: 0.0 }
        };
        let mut height = 0.002;
        run.simulation.place_tool(tool, pose(-0.5 * edge, height))?;
        run.step()?;
        let force = |run: &CaseRun| {
            run.simulation.tool_report(tool).map_or(f64::NEG_INFINITY, |r| r.force.z)
        };
        let mut further = 5;
        for _ in 0..100 {
            if further == 0 {
                break;
            }
            further -= u32::from(force(run) != 0.0);
            height -= 0.1 * edge;
            run.simulation.move_tool(tool, pose(-0.5 * edge, height))?;
            run.step()?;
        }
        if further > 0 {
            return Err("the capsule never touches".into());
        }
        for i in 1..=7 {
            let sideways = edge * (f64::from(i) / 7.0 - 0.5);
            run.simulation.move_tool(tool, pose(sideways, height))?;
            run.step()?;
            least = least.min(force(run));
        }
        let end = pose(0.5 * edge, height);
        for i in -20..=20 {
            let along = rotation * DVec3::X * (half_length * f64::from(i) / 20.0);
            wrong += u64::from(inside(run, end.position + along));
        }
    }
    Ok(vec![
        Check::none("points of the axis on the wrong side", wrong),
        Check::at_least("least force while dragged (N)", least, 1e-3),
    ])
}

fn thin_on_block(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    setting.of_tetrahedra()?;
    let mut run = held(setting, mesh, &["z0"])?;
    let inside = |run: &mut CaseRun, at: DVec3| {
        let x = run.simulation.positions(run.body);
        run.mesh.tetrahedra.iter().any(|t| {
            let [a, b, c, d] = t.map(|v| x[v as usize]);
            let det = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
            let parts = [det(at, b, c, d), det(a, at, c, d), det(a, b, at, d), det(a, b, c, at)];
            parts.iter().all(|p| *p > 0.0)
        })
    };
    let checks = thin(&mut run, [0.03, edge(BLOCK.x, 8.0)], inside)?;
    Ok(run.finish_by_largest(checks))
}

fn thin_on_sheet(setting: &CaseSetting, mesh: &Mesh) -> CaseOutcome {
    let mut run = sheet(setting, mesh)?;
    // its own weight draws it taut: a slack sheet gives way without any force
    run.simulation.set_gravity(DVec3::NEG_Z * 9.81);
    run.steps(300)?;
    // the sheet has to be below
    let inside = |run: &mut CaseRun, at: DVec3| {
        let x = run.simulation.positions(run.body);
        run.mesh.triangles.iter().any(|t| {
            let [a, b, c] = t.map(|v| x[v as usize]);
            let flat = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).z;
            let all = flat(a, b, c);
            let w = [flat(at, b, c), flat(a, at, c), flat(a, b, at)].map(|w| w / all);
            w.iter().all(|w| *w >= 0.0) && w[0] * a.z + w[1] * b.z + w[2] * c.z > at.z
        })
    };
    let checks = thin(&mut run, [0.015, edge(0.1, 8.0)], inside)?;
    Ok(run.finish_by_largest(checks))
}
