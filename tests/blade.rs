//! Blades that move through tissue that moves: what they part, the force that it takes, and what must hold meanwhile.

use crate::common::*;
use bevy_ecs::prelude::Entity;
use glam::DVec3;
use sinew::engine::mesh::generate::{box_tets, jitter_interior};
use sinew::prelude::*;
use sinew::snapshot::Snapshot;
use sinew::touch::edge::EdgeState;

const SIDE: f64 = 0.06;

fn block(cells: usize) -> Mesh {
    let mesh = box_tets(DVec3::splat(SIDE), [cells; 3]).unwrap();
    jitter_interior(&mesh, 0.2, 5).unwrap()
}

/// A block without weight whose bottom is held, and a blade beside it whose edge stands upright in its upper half.
fn scene(
    (solid, cells): (Solid, usize),
    toughness: f64,
    precision: Precision,
) -> (Simulation, BodyHandle, Entity) {
    let mesh = solid.block(SIDE, cells);
    let mut simulation = Simulation::new(options(precision, 1)).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    let description = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
    let spare = 3 * mesh.points.len();
    let body = simulation.add_body(&BodyDescription { spare, ..description }).unwrap();
    let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
    simulation.add_constraint(Constraint::hold("floor", floor));
    let edge = Edge {
        ends: [DVec3::Z * 0.02, DVec3::Z * -0.02],
        into: DVec3::Y,
        toughness,
        travel: DVec3::ZERO,
    };
    let start = DVec3::new(0.031, -0.005, 0.055);
    let blade = simulation.add_tool(Tool::blade("scalpel", edge, start)).unwrap();
    (simulation, body, blade)
}

/// Moves a blade on by `way` (m) in so many steps.
fn draw(
    simulation: &mut Simulation,
    blade: Entity,
    way: DVec3,
    steps: u32,
    each: &mut dyn FnMut(&mut Simulation),
) {
    let from = simulation.tool_report(blade).map_or(DVec3::ZERO, |report| report.position);
    for i in 1..=steps {
        simulation.move_tool(blade, from + way * (f64::from(i) / f64::from(steps))).unwrap();
        simulation.step().unwrap();
        each(simulation);
    }
}

/// Area (m^2) of both sides of all wounds in the present shape.
fn wound(simulation: &mut Simulation, body: BodyHandle) -> f64 {
    let skin = simulation.skin(body).unwrap();
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|p| skin.points[p as usize]);
        (b - a).cross(c - a).length() / 2.0
    };
    skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound).map(|(t, _)| of(t)).sum()
}

#[test]
fn the_number_of_moves_decides_nothing() {
    for solid in Solid::ALL {
        let mut found = Vec::new();
        for (steps, precision) in
            [(3, Precision::F64), (20, Precision::F64), (100, Precision::F64), (20, Precision::F32)]
        {
            let (mut simulation, body, blade) = scene((solid, 4), 0.0, precision);
            simulation.step().unwrap();
            draw(&mut simulation, blade, DVec3::Y * 0.04, steps, &mut |_| ());
            // decisions of the last move take effect in the next step
            simulation.step().unwrap();
            let report = simulation.tool_report(blade).unwrap().clone();
            assert_eq!((report.cut_area, report.fracture), (0.0, 0.0), "no force, no work");
            found.push((report.separated, wound(&mut simulation, body)));
        }
        let least = if solid == Solid::Linear { 20 } else { 5 };
        assert!(found[0].0 > least, "{solid:?}: {found:?}");
        for own in &found {
            assert_eq!(own.0, found[0].0, "{solid:?}");
            assert!((own.1 / found[0].1 - 1.0).abs() < 1e-6, "{solid:?}: {found:?}");
        }
    }
}

/// A blade that left the tissue and enters it elsewhere begins a new stroke, on the material as the last one left it.
#[test]
fn a_second_stroke_is_decided_anew() {
    for solid in Solid::ALL {
        let (mut simulation, body, blade) = scene((solid, 4), 0.0, Precision::F64);
        simulation.step().unwrap();
        let planes = [0.031, 0.047];
        for way in [DVec3::Y * 0.04, DVec3::Y * -0.045, DVec3::X * 0.016, DVec3::Y * 0.045] {
            draw(&mut simulation, blade, way, 20, &mut |_| ());
        }
        simulation.step().unwrap();
        let skin = simulation.skin(body).unwrap();
        let mut found = [0; 2];
        let wound = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound);
        for triangle in wound.map(|(t, _)| t) {
            for x in triangle.map(|v| skin.rest[v as usize].x) {
                let on = planes.iter().position(|plane| (x - plane).abs() < 1e-6);
                found[on.unwrap_or_else(|| panic!("{solid:?}: a wound at {x} m"))] += 1;
            }
        }
        assert!(found.iter().all(|count| *count > 50), "{solid:?}: {found:?}");
    }
}

/// Its force and its work are rows of `sinew validate`.
#[test]
fn a_blade_feels_its_toughness_on_its_way_forward_only() {
    for solid in Solid::ALL {
        feels_its_toughness(solid);
    }
}

fn feels_its_toughness(solid: Solid) {
    let toughness = 50.0;
    let cells = if solid == Solid::TenNodes { 4 } else { 6 };
    let (mut simulation, _, blade) = scene((solid, cells), toughness, Precision::F64);
    simulation.step().unwrap();
    draw(&mut simulation, blade, DVec3::Y * 0.045, 180, &mut |simulation| {
        let report = simulation.tool_report(blade).unwrap();
        assert!(report.fracture <= report.work, "{report:?}");
        // the tissue bulges, and its surface draws the slip aside
        let state = simulation.world().get::<EdgeState>(blade).unwrap();
        let inside: f64 = state.points.iter().map(|point| point.width).sum();
        let share = -report.force.y / (toughness * inside);
        assert!(inside == 0.0 || share < 1.0 + 1e-9, "{share} of {inside} m");
        if report.position.y > 0.02 {
            assert!((inside / (SIDE - 0.035) - 1.0).abs() < 0.06, "{inside}");
        }
    });
    let report = simulation.tool_report(blade).unwrap().clone();
    assert!((report.fracture / (toughness * report.cut_area) - 1.0).abs() < 1e-12);
    // what goes back meets nothing, once the tissue that it had pushed ahead no longer follows
    draw(&mut simulation, blade, DVec3::Y * -0.025, 25, &mut |_| ());
    let back = simulation.tool_report(blade).unwrap();
    let state = simulation.world().get::<EdgeState>(blade).unwrap();
    assert_eq!(back.force, DVec3::ZERO, "{state:?}");
    // what the last step forward cut is booked by the next one; how much that is depends on rounding where few large elements part
    assert!((0.0..0.03).contains(&(back.cut_area / report.cut_area - 1.0)), "{back:?} {report:?}");
}

/// A cut in the middle of a stroke goes on from a snapshot, also in another simulation, and with other threads, to the bit.
#[test]
fn strokes_go_on_from_snapshots() {
    let all = Solid::ALL.into_iter().flat_map(|solid| [(solid, None), (solid, Some(SPRING))]);
    for (solid, spring) in all {
        let scene = || {
            let (mut simulation, body, blade) = scene((solid, 4), 50.0, Precision::F64);
            simulation.world_mut().get_mut::<Tool>(blade).unwrap().spring = spring;
            (simulation, body, blade)
        };
        let (mut simulation, _, blade) = scene();
        simulation.step().unwrap();
        draw(&mut simulation, blade, DVec3::Y * 0.03, 30, &mut |_| ());
        let snapshot = simulation.snapshot().unwrap();
        let bytes = snapshot.to_bytes();
        draw(&mut simulation, blade, DVec3::Y * 0.02, 20, &mut |_| ());
        let hash = simulation.state_hash();
        let report = simulation.tool_report(blade).unwrap().clone();
        let least = if solid == Solid::Linear { 20 } else { 5 };
        assert!(report.separated > least && report.cut_area > 0.0, "{solid:?}: {report:?}");
        simulation.restore(&snapshot).unwrap();
        draw(&mut simulation, blade, DVec3::Y * 0.02, 20, &mut |_| ());
        assert_eq!(simulation.state_hash(), hash, "{solid:?}");
        let (mut other, _, own) = scene();
        other.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
        draw(&mut other, own, DVec3::Y * 0.02, 20, &mut |_| ());
        assert_eq!((other.state_hash(), other.tool_report(own).unwrap().clone()), (hash, report));
    }
}

/// Stiffness (N/m) of the spring between a hand and a blade.
const SPRING: f64 = 300.0;

/// A blade on a spring is behind the hand by its force over the stiffness, and cuts what one cuts that is moved rigidly to where it went.
#[test]
fn a_hand_holds_a_blade_by_a_spring() {
    for solid in Solid::ALL {
        let cells = if solid == Solid::TenNodes { 4 } else { 6 };
        let [(mut simulation, _, blade), (mut rigid, _, twin)] =
            [(); 2].map(|()| scene((solid, cells), 50.0, Precision::F64));
        simulation.world_mut().get_mut::<Tool>(blade).unwrap().spring = Some(SPRING);
        simulation.step().unwrap();
        rigid.step().unwrap();
        let start = simulation.tool_report(blade).unwrap().position;
        let (mut most, mut off) = (0.0_f64, 0.0_f64);
        let steps = 150;
        for step in 1..=steps {
            let hand = start + DVec3::Y * (3e-4 * f64::from(step));
            simulation.move_tool(blade, hand).unwrap();
            simulation.step().unwrap();
            let own = simulation.tool_report(blade).unwrap().clone();
            assert!(!own.unconverged && own.position.distance(hand + own.yields) < 1e-12);
            let left = (SPRING * own.yields).distance(own.force);
            assert!(left <= 1e-6 * own.force.length(), "{solid:?}: {left} of {:?}", own.force);
            rigid.move_tool(twin, own.position).unwrap();
            rigid.step().unwrap();
            let force = rigid.tool_report(twin).unwrap().force;
            most = most.max(force.length());
            off += force.distance_squared(own.force) / f64::from(steps);
        }
        let (own, other) =
            (simulation.tool_report(blade).unwrap(), rigid.tool_report(twin).unwrap());
        assert!(own.yields.length() > 2e-3 && own.separated > 5, "{solid:?}: {own:?}");
        // what either holds next depends on where it is taken to go
        let off = off.sqrt() / most;
        assert!(off < 0.05, "{solid:?}: {off}");
        let stored = 0.5 * SPRING * own.yields.length_squared();
        let [work, area] =
            [(own.work - stored) / other.work, own.cut_area / other.cut_area].map(|x| x - 1.0);
        assert!(work.abs() < 0.02, "{solid:?}: {work}");
        // large elements part one by one, whenever either is taken to come there
        assert!(solid != Solid::Linear || area.abs() < 0.02, "{solid:?}: {area}");
        assert!(own.fracture < own.work, "{own:?}");
    }
}

/// Nothing but the hand puts energy in, held rigidly or by a spring, and what is cut does not depend on the integrator.
#[test]
fn a_blade_puts_in_no_more_than_the_hand_does() {
    for spring in [None, Some(SPRING)] {
        let mut areas = Vec::new();
        for (integrator, share) in [
            (Integrator::Safe, 1e-6),
            (Integrator::LinearisedTrBdf2, 1e-6),
            (Integrator::Newton, 1e-6),
            // its energy swings
            (Integrator::SymplecticEuler, 1e-2),
        ] {
            let (mut simulation, _, blade) = scene((Solid::Linear, 6), 50.0, Precision::F64);
            simulation.world_mut().get_mut::<Tool>(blade).unwrap().spring = spring;
            simulation.set_solver(solver!(integrator, mass_damping = 5.0));
            simulation.set_dt(0.01);
            simulation.step().unwrap();
            let mut work = 0.0;
            draw(&mut simulation, blade, DVec3::Y * 0.045, 90, &mut |simulation| {
                let now = simulation.report();
                let energy = now.elastic_energy + now.kinetic_energy + now.contact.energy;
                work += now.contact.work;
                let what = format!("{integrator:?} {spring:?}: {energy} of {work} J");
                assert!(energy <= work * (1.0 + share), "{what}");
            });
            let report = simulation.tool_report(blade).unwrap();
            // what counts above is more than what the hand did
            assert!(report.work <= work * (1.0 + 1e-9), "{} {work} J", report.work);
            assert!(report.fracture < report.work && report.separated > 20, "{report:?}");
            areas.push(report.cut_area);
        }
        assert!(areas.iter().all(|area| (area / areas[0] - 1.0).abs() < 0.05), "{areas:?}");
    }
}

/// A blade that is put elsewhere parts nothing on its way there, however far its spring was drawn.
#[test]
fn a_blade_that_is_placed_parts_nothing_on_the_way() {
    let (mut simulation, _, blade) = scene((Solid::Linear, 6), 50.0, Precision::F64);
    simulation.world_mut().get_mut::<Tool>(blade).unwrap().spring = Some(SPRING);
    simulation.step().unwrap();
    draw(&mut simulation, blade, DVec3::Y * 0.03, 60, &mut |_| ());
    let before = simulation.tool_report(blade).unwrap().clone();
    assert!(before.yields.y < -2e-3 && before.separated > 20, "{before:?}");
    let place = DVec3::new(0.045, 0.03, 0.055);
    simulation.world_mut().get_mut::<Tool>(blade).unwrap().place(place).unwrap();
    simulation.step().unwrap();
    let now = simulation.tool_report(blade).unwrap();
    assert_eq!(now.separated, before.separated, "{now:?}");
    let state = simulation.world().get::<EdgeState>(blade).unwrap();
    let held = state.points.iter().filter(|point| point.holds.is_some());
    let off: Vec<f64> = held.map(|point| (point.cut_to - place).truncate().length()).collect();
    assert!(off.len() > 1 && off.iter().all(|off| *off < 1e-9), "{off:?}");
}

/// An edge that goes through two bodies at once feels both.
#[test]
fn an_edge_feels_all_bodies_that_it_goes_through() {
    let forces = |heights: &[f64]| {
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        simulation.set_gravity(DVec3::ZERO);
        for (i, z) in heights.iter().enumerate() {
            let mesh = Solid::Linear.slab(DVec3::new(SIDE, SIDE, 0.028), [6, 6, 3]);
            let mesh = mesh.transformed(1.0, glam::DQuat::IDENTITY, DVec3::Z * *z);
            let name = format!("block {i}");
            let description = BodyDescription::new(&name, &mesh, soft(1e4, 0.3));
            let spare = 3 * mesh.points.len();
            let body = simulation.add_body(&BodyDescription { spare, ..description }).unwrap();
            let back = simulation.group_rows(body, &mesh, "y1").unwrap();
            simulation.add_constraint(Constraint::hold(&name, back));
        }
        let edge = Edge {
            ends: [DVec3::Z * 0.05, DVec3::Z * -0.05],
            into: DVec3::Y,
            toughness: 50.0,
            travel: DVec3::ZERO,
        };
        let start = DVec3::new(0.031, -0.005, 0.03);
        let blade = simulation.add_tool(Tool::blade("scalpel", edge, start)).unwrap();
        simulation.set_solver(solver!(Integrator::Safe, mass_damping = 20.0));
        simulation.step().unwrap();
        let mut all = Vec::new();
        draw(&mut simulation, blade, DVec3::Y * 0.03, 120, &mut |simulation| {
            all.push(simulation.tool_report(blade).unwrap().force.y);
        });
        all
    };
    let [lower, upper, both] = [&[0.0][..], &[0.031][..], &[0.0, 0.031][..]].map(forces);
    let peak = both.iter().map(|f| f.abs()).fold(0.0, f64::max);
    let off = (0..both.len()).map(|i| (both[i] - lower[i] - upper[i]).powi(2)).sum::<f64>();
    let off = (off / both.len() as f64).sqrt() / peak;
    assert!(peak > 2.0 && off < 0.03, "{off} of {peak} N");
}

/// The hand stops far ahead of the blade, which goes on until the force of the spring is no more than what cutting takes.
#[test]
fn energy_falls_while_the_hand_of_a_blade_rests() {
    // of those that know no motion but that of the step before
    let integrators = [Integrator::Safe, Integrator::Newton];
    let all = Solid::ALL.into_iter().flat_map(|solid| integrators.map(|own| (solid, own)));
    for (solid, integrator) in all {
        // of long steps only the safe one promises that
        let all = [0.002, 0.01, 0.033].into_iter();
        for dt in all.filter(|dt| *dt < 0.02 || integrator == Integrator::Safe) {
            let (mut simulation, _, blade) = scene((solid, 4), 50.0, Precision::F64);
            simulation.world_mut().get_mut::<Tool>(blade).unwrap().spring = Some(SPRING);
            simulation.set_solver(solver!(integrator, mass_damping = 20.0));
            simulation.set_dt(dt);
            simulation.step().unwrap();
            draw(&mut simulation, blade, DVec3::Y * 0.03, 5, &mut |_| ());
            let mut before = f64::INFINITY;
            let mut first = 0.0;
            for step in 0..(1.0_f64 / dt) as u32 {
                simulation.step().unwrap();
                let report = simulation.report();
                let now = report.kinetic_energy + report.elastic_energy + report.contact.energy;
                if step == 0 {
                    first = now;
                }
                let what = format!("{solid:?} {integrator:?} {dt}: step {step}");
                // where one lip slips and the other sticks, a little of what was lost comes back
                assert!(now <= before + 1e-3 * first, "{what}: {before} {now} J");
                before = now;
            }
            let own = simulation.tool_report(blade).unwrap();
            assert!(own.separated > 0 && own.yields.y < -1e-3, "{own:?}");
            assert!(own.velocity.length() < 1e-3 && before < first, "{own:?}");
        }
    }
}

/// A body of several pieces of rows with a coarse space: its preconditioner goes on from step to step while elements part, and so it does from
/// snapshots, between steps and after cuts by hand.
#[test]
fn preconditioners_go_on_through_strokes() {
    let build = |threads| {
        let mesh = block(10);
        let mut simulation = Simulation::new(options(Precision::F64, threads)).unwrap();
        let description = BodyDescription::new("block", &mesh, soft(1e4, 0.4));
        let spare = mesh.points.len();
        let body = simulation.add_body(&BodyDescription { spare, ..description }).unwrap();
        for (axis, side) in [(0b111, "x0"), (0b111, "x1"), (0b100, "z0")] {
            guide(&mut simulation, body, &mesh, side, axis);
        }
        let edge = Edge {
            ends: [DVec3::Z * 0.03, DVec3::Z * -0.02],
            into: DVec3::Y,
            toughness: 5.0,
            travel: DVec3::ZERO,
        };
        let start = DVec3::new(0.031, -0.002, 0.045);
        let blade = simulation.add_tool(Tool::blade("scalpel", edge, start)).unwrap();
        (simulation, body, blade)
    };
    let by_hand = |simulation: &mut Simulation, body: BodyHandle| {
        let edge = |y: f64| [DVec3::new(0.013, y, 0.1), DVec3::new(0.012, y, -0.1)];
        assert_eq!(simulation.cut(body, &[edge(-0.1), edge(0.1)]).unwrap().pieces, 2);
    };
    let step = |simulation: &mut Simulation, blade: Entity, i: usize| {
        let at = DVec3::new(0.031, -0.002 + 0.001 * i as f64, 0.045);
        simulation.move_tool(blade, at).unwrap();
        simulation.step().unwrap();
    };
    let (mut simulation, body, blade) = build(2);
    let (mut parted, mut steps, mut refreshes, mut saved) = (0, 0, 0, Vec::new());
    let mut hashes = Vec::new();
    for i in 0..40 {
        if i == 25 {
            by_hand(&mut simulation, body);
        }
        if [12, 25, 31].contains(&i) {
            saved.push((i, simulation.snapshot().unwrap()));
        }
        step(&mut simulation, blade, i);
        let report = simulation.report();
        assert!(!report.unconverged && report.cg_caps == 0, "{report:?}");
        let now = simulation.tool_report(blade).unwrap().separated;
        if now > parted {
            (steps, refreshes) = (steps + 1, refreshes + report.preconditioner_refreshes);
        }
        parted = now;
        hashes.push(simulation.state_hash());
    }
    assert_eq!(simulation.report().preconditioner, "multigrid");
    assert!(steps > 10 && 2 * refreshes < steps, "{refreshes} in {steps}");
    let (mut other, _, mut own) = build(1);
    for (from, snapshot) in saved {
        // twice into the same simulation, and into one that was never cut
        if from == 31 {
            (other, _, own) = build(1);
        }
        other.restore(&Snapshot::from_bytes(&snapshot.to_bytes()).unwrap()).unwrap();
        for i in from..(from + 8).min(40) {
            // nobody cuts by hand in between
            step(&mut other, own, i);
            assert_eq!(other.state_hash(), hashes[i], "from {from}");
        }
    }
}

#[test]
fn a_blade_says_what_it_cannot_cut() {
    let mesh = block(4);
    let (mut simulation, body) =
        alone(options(Precision::F64, 1), &BodyDescription::new("block", &mesh, soft(1e4, 0.3)));
    let floor = simulation.group_rows(body, &mesh, "z0").unwrap();
    simulation.add_constraint(Constraint::hold("floor", floor));
    let edge = Edge {
        ends: [DVec3::Z * 0.02, DVec3::Z * -0.02],
        into: DVec3::Y,
        toughness: 0.0,
        travel: DVec3::ZERO,
    };
    let blade = simulation
        .add_tool(Tool::blade("scalpel", edge, DVec3::new(0.031, -0.005, 0.055)))
        .unwrap();
    simulation.step().unwrap();
    simulation.move_tool(blade, DVec3::new(0.031, 0.01, 0.055)).unwrap();
    let error = simulation.step().unwrap_err().to_string();
    assert!(
        error.contains("scalpel") && error.contains("`block`") && error.contains("spare"),
        "{error}"
    );
    for (edge, words) in [
        (Edge { into: DVec3::Z, ..edge }, "along the edge"),
        (Edge { ends: [DVec3::X; 2], ..edge }, "two points"),
        (Edge { toughness: -1.0, ..edge }, "toughness is -1"),
    ] {
        let error = simulation.add_tool(Tool::blade("knife", edge, DVec3::ZERO)).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    }
    // too few vertices: the step is not made, and the tissue is as it was
    let (mut simulation, _, blade) = {
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        let own = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
        let body = simulation.add_body(&BodyDescription { spare: 3, ..own }).unwrap();
        let at = DVec3::new(0.031, -0.005, 0.055);
        let blade = simulation.add_tool(Tool::blade("scalpel", edge, at)).unwrap();
        (simulation, body, blade)
    };
    simulation.set_gravity(DVec3::ZERO);
    simulation.step().unwrap();
    simulation.move_tool(blade, DVec3::new(0.031, 0.05, 0.055)).unwrap();
    simulation.step().unwrap();
    let before = simulation.state_hash();
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("larger `spare`"), "{error}");
    assert_eq!(simulation.state_hash(), before);
}

/// A blade through a stretched block parts it, also where it goes through vertices of the mesh and lips spring away while it does.
#[test]
fn a_blade_leaves_no_bridges() {
    let meshes = [
        box_tets(DVec3::splat(SIDE), [6; 3]).unwrap(),
        block(6),
        Solid::TenNodes.block(SIDE, 3),
        Solid::Hexahedra.block(SIDE, 4),
    ];
    for (number, mesh) in meshes.iter().enumerate() {
        for (x, tilt) in [(0.03, 0.0), (0.0301, 0.0), (0.03, 0.15), (0.028, 0.15)] {
            for toughness in [0.0, 50.0] {
                let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
                simulation.set_gravity(DVec3::ZERO);
                let description = BodyDescription::new("block", mesh, soft(1e4, 0.3));
                let spare = 3 * mesh.points.len();
                let body = simulation.add_body(&BodyDescription { spare, ..description }).unwrap();
                let ends = [("x0", -0.006), ("x1", 0.006)].map(|(end, way)| {
                    let rows = simulation.group_rows(body, mesh, end).unwrap();
                    let motion = Motion::Translate(DVec3::X * way);
                    let ramp = Curve::Points(vec![[0.0, 0.0], [0.1, 1.0]]);
                    let row = rows[0];
                    simulation.add_constraint(Constraint::moving(end, rows, motion, ramp));
                    row
                });
                simulation.set_solver(SolverSettings {
                    integrator: Integrator::Safe,
                    ..SolverSettings::default()
                });
                simulation.steps(20);
                let up = DVec3::new(tilt, tilt, 1.0) * 0.04;
                let edge = Edge { ends: [up, -up], into: DVec3::Y, toughness, travel: DVec3::ZERO };
                let start = DVec3::new(x, -0.015, 0.03);
                let blade = simulation.add_tool(Tool::blade("scalpel", edge, start)).unwrap();
                simulation.step().unwrap();
                draw(&mut simulation, blade, DVec3::Y * 0.11, 90, &mut |_| ());
                simulation.step().unwrap();
                let rows = &simulation.topology().bodies[0];
                let piece = ends.map(|row| rows.piece[rows.local(row).unwrap().0 as usize]);
                assert!(piece[0] != piece[1], "{number} {x} {tilt} {toughness}");
            }
        }
    }
}

/// The sides of a blade hold the lips of its wound apart, each on its own side, and rub on them.
#[test]
fn flanks_hold_lips_apart() {
    for solid in Solid::ALL {
        holds_lips_apart(solid);
    }
}

fn holds_lips_apart(solid: Solid) {
    const LENGTH: f64 = 0.03;
    let mut dragged = Vec::new();
    let cells = if solid == Solid::TenNodes { 3 } else { 6 };
    for (thickness, friction) in [(0.0, 0.0), (0.002, 0.0), (0.002, 0.3)] {
        let (mut simulation, body, blade) = scene((solid, cells), 0.0, Precision::F64);
        let blade = simulation.current(blade);
        let integrator = Integrator::Safe;
        simulation.set_solver(SolverSettings {
            integrator,
            mass_damping: 10.0,
            ..SolverSettings::default()
        });
        let edge = simulation.world().get::<Tool>(blade).unwrap().edge.unwrap();
        let mut tool = simulation.world_mut().get_mut::<Tool>(blade).unwrap();
        tool.friction = friction;
        if thickness > 0.0 {
            tool.parts.push(edge.flanks(LENGTH, thickness).unwrap());
        }
        simulation.step().unwrap();
        draw(&mut simulation, blade, DVec3::Y * 0.045, 60, &mut |_| ());
        simulation.steps(60);
        let report = simulation.tool_report(blade).unwrap().clone();
        assert!(!report.unconverged && report.lag == 0.0 && !report.pierced, "{report:?}");
        // depth of the lips in the blade, by where they lie on it
        let skin = simulation.skin(body).unwrap();
        let middle = report.position - DVec3::Y * (0.5 * LENGTH);
        let (mut most, mut sides) = (0.0_f64, [0; 2]);
        for (t, _) in skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| **wound) {
            let [a, b, c] = t.map(|p| skin.points[p as usize]);
            let outward = (b - a).cross(c - a).normalize_or_zero();
            for at in [a, b, c] {
                let local = at - middle;
                let [u, v] = [local.y / (0.5 * LENGTH), local.z / 0.02];
                if outward.x.abs() < 0.7 || u.abs() > 0.6 || v.abs() > 0.6 {
                    continue;
                }
                let half = 0.5 * thickness * (1.0 - u * u) * (1.0 - v * v);
                let away = -outward.x.signum() * local.x;
                most = most.max(half - away);
                sides[usize::from(outward.x < 0.0)] += 1;
            }
        }
        let least = if solid == Solid::TenNodes { 10 } else { 20 };
        assert!(sides.iter().all(|count| *count > least), "{solid:?}: {sides:?}");
        assert!(most < 0.1 * 0.002, "{thickness}: {most} m");
        // what presses from both sides cancels: the blade is in the middle
        let pressing = report.pressure * report.area;
        assert_eq!(pressing > 0.0, thickness > 0.0);
        assert!(report.force.x.abs() <= 0.1 * pressing, "{report:?}");
        let forth = report.friction.y;
        draw(&mut simulation, blade, DVec3::Y * -0.01, 40, &mut |_| ());
        dragged.push([forth, simulation.tool_report(blade).unwrap().friction.y]);
    }
    // friction acts against the way, there and back
    assert_eq!(dragged[..2], [[0.0; 2]; 2]);
    // lips that are held apart by fewer points press less on it
    let least = if solid == Solid::Linear { 0.05 } else { 0.02 };
    assert!(dragged[2][0] < -least && dragged[2][1] > least, "{solid:?}: {dragged:?}");
    let edge = Edge::new(0.04, 0.0);
    for (length, thickness) in [(0.0, 1e-3), (0.01, f64::NAN)] {
        assert!(edge.flanks(length, thickness).unwrap_err().contains("must be positive"));
    }
    let scissors = Edge { travel: DVec3::X, ..edge };
    assert!(scissors.flanks(0.01, 1e-3).unwrap_err().contains("jaws"));
}
