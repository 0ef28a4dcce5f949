//! Bodies at rest fall asleep, cost nothing of the solver, and wake for everything that may move them.

use crate::common::*;
use crate::schedule::bodies::Meshes;
use bevy_ecs::prelude::Component;
use glam::{DQuat, DVec3};
use sinew::engine::load::Motion;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::row::VertexRow;
use sinew::engine::scalar::Scalar;
use sinew::engine::vertex::{Displacement, RestPosition, Velocity};
use sinew::models::resection::{Region, Removal, RemovalRequest};
use sinew::prelude::*;
use sinew::solvers::sleep::CALM;

const SLEEP: f64 = 1e-4;
const SIZE: f64 = 0.12;

fn settings(sleep_speed: f64) -> SolverSettings {
    solver!(Integrator::Auto, mass_damping = 20.0, sleep_speed)
}

fn cube() -> Mesh {
    box_tets(DVec3::new(SIZE, 0.06, 0.06), [6, 3, 3]).unwrap()
}

/// Puts a block beside the others, held at one end; its rows there, and those of the other end.
fn add_block(simulation: &mut Simulation, name: &str, at: DVec3) -> BodyHandle {
    let mesh = cube().transformed(1.0, DQuat::IDENTITY, at);
    let description = BodyDescription {
        model: Model::NeoHookean,
        spare: mesh.points.len(),
        ..BodyDescription::new(name, &mesh, soft(1e4, 0.4))
    };
    let body = simulation.add_body(&description).unwrap();
    let rows = end_rows(simulation, body, &mesh, at.x);
    simulation.add_constraint(Constraint::hold(format!("end of {name}"), rows));
    body
}

fn end_rows(simulation: &Simulation, body: BodyHandle, mesh: &Mesh, x: f64) -> Vec<VertexRow> {
    let at = |p: &DVec3| (p.x - x).abs() < 1e-9;
    let end: Vec<u32> = (0..).zip(&mesh.points).filter(|(_, p)| at(p)).map(|(v, _)| v).collect();
    simulation.rows(body, "end", &end).unwrap()
}

fn push(simulation: &mut Simulation, name: &str, rows: Vec<VertexRow>, curve: Curve) {
    let forces = rows.into_iter().map(|row| (row, DVec3::Y * 3e-3)).collect();
    simulation.add_load(Load { name: name.into(), forces, curve });
}

/// One block, or two side by side, the second under a pull that never rests.
fn blocks(options: SimulationOptions, sleep_speed: f64, count: usize) -> Simulation {
    let mut simulation = Simulation::new(options).unwrap();
    for i in 0..count {
        add_block(&mut simulation, &format!("block {i}"), DVec3::Y * 0.2 * i as f64);
    }
    simulation.set_solver(settings(sleep_speed));
    simulation
}

/// Steps until so many bodies sleep; how many steps that took.
fn until_asleep(simulation: &mut Simulation, count: u32) -> usize {
    for step in 0..600 {
        simulation.step().unwrap();
        if simulation.report().sleeping >= count {
            return step;
        }
    }
    panic!("still awake after {} s", simulation.time());
}

#[test]
fn a_body_at_rest_falls_asleep_where_it_would_have_come_to_rest() {
    for precision in [Precision::F64, Precision::F32] {
        let [mut sleeps, mut wakes] =
            [SLEEP, 0.0].map(|speed| blocks(options(precision, 1), speed, 1));
        let body = BodyHandle(0);
        let slept = until_asleep(&mut sleeps, 1);
        wakes.steps(slept + 1);
        assert!(slept as f64 * 0.01 > CALM, "{slept}");
        // the step in which it falls asleep books the rest of its kinetic energy, and nothing else changes
        let (report, before) = (sleeps.report().clone(), wakes.report().clone());
        assert_eq!([report.kinetic_energy, report.momentum[2]], [0.0; 2]);
        assert_eq!((report.newton_iterations, report.cg_iterations), (0, 0));
        assert!(report.dissipation >= 0.0 && report.dissipation < 1e-6 * report.elastic_energy);
        let off = (report.elastic_energy - before.elastic_energy).abs();
        assert!(off < 1e-4 * before.elastic_energy, "{off} of {}", before.elastic_energy);
        let asleep = sleeps.positions(body);
        let (forces, volumes) =
            (sleeps.elastic_forces(body), format!("{:?}", sleeps.volume_report()));
        sleeps.steps(100);
        assert_eq!(sleeps.report().sleeping, 1);
        assert_eq!(sleeps.report().evaluations, 0);
        assert_eq!(sleeps.report().elastic_energy, report.elastic_energy);
        assert_eq!(sleeps.positions(body), asleep);
        assert_eq!(max_length(&sleeps.velocities(body)), 0.0);
        assert_eq!(format!("{:?}", sleeps.volume_report()), volumes);
        sleeps.evaluate();
        assert_eq!(sleeps.elastic_forces(body), forces);
        wakes.steps(300);
        let off = max_distance(&asleep, &wakes.positions(body));
        assert!(off < 1e-2 * SLEEP * SIZE, "{precision:?}: {off}");
    }
}

/// What is done to a block at rest, and the block it is done to.
type Event = (&'static str, fn(&mut Simulation));

const BLOCK: BodyHandle = BodyHandle(0);

fn far_end(simulation: &Simulation) -> Vec<VertexRow> {
    end_rows(simulation, BLOCK, &cube(), SIZE)
}

/// The vertex that sticks out furthest.
fn tip(simulation: &mut Simulation) -> DVec3 {
    let points = simulation.positions(BLOCK);
    points.into_iter().max_by(|a, b| a.x.total_cmp(&b.x)).unwrap()
}

const EVENTS: [Event; 12] = [
    ("load", |s| {
        let rows = far_end(s);
        push(s, "f", rows, Curve::Constant);
    }),
    ("gravity", |s| s.set_gravity(DVec3::new(0.0, 0.0, -8.0))),
    ("constraint", |s| {
        let rows = far_end(s);
        let motion = Motion::Translate(DVec3::Y * 0.01);
        s.add_constraint(Constraint::moving(
            "c",
            rows,
            motion,
            Curve::Points(vec![[2.0, 0.0], [4.0, 1.0]]),
        ));
    }),
    ("release", |s| {
        let own = s.find::<Constraint>("end of block 0").unwrap();
        assert!(s.remove_load_or_constraint(own));
    }),
    ("pull", |s| {
        let rows = far_end(s);
        let pull = s.add_pull(Pull::new("p", rows, 10.0, 0.1));
        s.move_pull(pull, DVec3::Y * 0.01);
    }),
    ("tool", |s| {
        let tip = tip(s);
        let tool = Tool::new("ball", Shape::Sphere { radius: 0.02 }, tip + DVec3::X * 0.06);
        let tool = s.add_tool(tool).unwrap();
        s.move_tool(tool, tip + DVec3::X * 0.01).unwrap();
    }),
    ("neighbour", |s| {
        let mesh = box_tets(DVec3::splat(0.03), [2, 2, 2]).unwrap();
        let at = tip(s) + DVec3::new(-0.03, -0.015, 0.12);
        let mesh = mesh.transformed(1.0, DQuat::IDENTITY, at);
        let other = BodyDescription::new("falling", &mesh, soft(1e4, 0.4));
        let other = s.add_body(&other).unwrap();
        s.add_body_contact(BodyContact::new("pair", [BLOCK, other]));
    }),
    ("material", |s| {
        s.set_material(BLOCK, soft(5e3, 0.4)).unwrap();
    }),
    ("removal", |s| {
        s.remove_elements(BLOCK, &Removal::new(Region::Tetrahedra((0..20).collect()))).unwrap();
    }),
    ("cut", |s| {
        // from above, halfway through
        let (mesh, now) = (cube(), s.positions(BLOCK));
        let section = mesh.points.iter().zip(now).filter(|(x, _)| (x.x - 0.04).abs() < 1e-9);
        let section: Vec<DVec3> = section.map(|(_, x)| x).collect();
        let middle = section.iter().sum::<DVec3>() / section.len() as f64;
        let side = |y| [middle, middle + DVec3::Z * 0.2].map(|x| DVec3 { y, ..x });
        assert!(s.cut(BLOCK, &[side(-0.05), side(0.11)]).unwrap().area > 0.0);
    }),
    ("state", |s| {
        let u: Vec<DVec3> = s.displacements(BLOCK).iter().map(|u| *u * 1.5).collect();
        s.displace(BLOCK, &u);
    }),
    ("velocity", |s| {
        let u = s.displacements(BLOCK);
        let v = vec![DVec3::Y * 0.1; u.len()];
        s.set_state(BLOCK, &u, &v).unwrap();
    }),
];

#[test]
fn it_wakes_for_all_that_moves_it_and_then_moves_as_if_it_had_not_slept() {
    for (name, event) in EVENTS {
        let options = || options(Precision::F64, 1);
        let [mut sleeps, mut wakes] = [SLEEP, 0.0].map(|speed| blocks(options(), speed, 1));
        let slept = until_asleep(&mut sleeps, 1);
        wakes.steps(slept + 100);
        sleeps.steps(99);
        for simulation in [&mut sleeps, &mut wakes] {
            event(simulation);
        }
        let start = wakes.positions(BLOCK);
        let mut furthest = 0.0_f64;
        for step in 0..60 {
            let (a, b) = (sleeps.step(), wakes.step());
            assert_eq!(a, b, "{name}");
            let moved = max_distance(&start, &wakes.positions(BLOCK));
            furthest = furthest.max(moved);
            // while it has not moved yet it may sleep on: nothing is near
            assert!(sleeps.report().sleeping == 0 || moved < SLEEP * SIZE, "{name}: {step}");
        }
        let off = max_distance(&sleeps.positions(BLOCK), &wakes.positions(BLOCK));
        assert!(furthest > 2e-4, "{name} moves it by {furthest} m only");
        assert!(off < 1e-3 * furthest, "{name}: {off} of {furthest}");
    }
}

/// A component of a host's.
#[derive(Component)]
struct Mark;

#[test]
fn things_of_kinds_that_came_later_and_what_is_no_number_are_seen_while_it_sleeps() {
    let mut simulation = blocks(options(Precision::F64, 1), SLEEP, 1);
    until_asleep(&mut simulation, 1);
    simulation.steps(10);
    let put = |simulation: &mut Simulation, value: f64| {
        let world = simulation.world_mut();
        let mut query = world.query::<&mut Displacement<f64>>();
        let mut row = query.iter_mut(world).nth(20).unwrap();
        std::mem::replace(&mut row.0[1], value)
    };
    let before = put(&mut simulation, f64::NAN);
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("displacement of vertex") && error.contains("`block 0`"), "{error}");
    put(&mut simulation, before);
    simulation.steps(2);
    assert_eq!(simulation.report().sleeping, 1);
    // entities with a component more are in tables that nobody has looked through so far
    let rows = far_end(&simulation);
    push(&mut simulation, "f", rows, Curve::Constant);
    let load = simulation.find::<Load>("f").unwrap();
    simulation.world_mut().entity_mut(load).insert(Mark);
    simulation.step().unwrap();
    assert_eq!(simulation.report().sleeping, 0);
    simulation.world_mut().get_mut::<Load>(load).unwrap().forces[0].1.x = f64::NAN;
    let error = simulation.step().unwrap_err().to_string();
    assert!(error.contains("`f`"), "{error}");
}

/// A second block is pulled to and fro for ever.
fn restless(options: SimulationOptions, sleep_speed: f64) -> Simulation {
    let mut simulation = blocks(options, sleep_speed, 2);
    let mesh = cube().transformed(1.0, DQuat::IDENTITY, DVec3::Y * 0.2);
    let rows = end_rows(&simulation, BodyHandle(1), &mesh, SIZE);
    let wave = Curve::Sine { frequency: 2.0, phase: 0.0 };
    push(&mut simulation, "wave", rows, wave);
    simulation
}

#[test]
fn neighbours_that_no_longer_touch_sleep_each_with_its_own_energy() {
    let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
    let [lower, upper] =
        [0.0, 0.0602].map(|y| add_block(&mut simulation, &format!("block at {y}"), DVec3::Y * y));
    let pair = simulation.add_body_contact(BodyContact::new("pair", [lower, upper]));
    simulation.set_solver(settings(SLEEP));
    simulation.steps(300);
    assert_eq!(simulation.report().sleeping, 0, "they may touch");
    assert!(simulation.remove_contact(pair));
    let alone = until_asleep(&mut simulation, 2);
    assert!(alone as f64 * 0.01 > CALM, "{alone}");
    let energy = simulation.report().elastic_energy;
    assert!((simulation.evaluate() - energy).abs() < 1e-12 * energy);
}

/// Sleepers that were cut, and what comes back to them.
#[test]
fn a_body_that_was_cut_sleeps_and_a_blade_wakes_it() {
    let mut simulation = blocks(options(Precision::F64, 1), SLEEP, 1);
    until_asleep(&mut simulation, 1);
    let cut = EVENTS.iter().find(|(name, _)| *name == "cut").unwrap().1;
    cut(&mut simulation);
    until_asleep(&mut simulation, 1);
    let energy = simulation.report().elastic_energy;
    assert!((simulation.evaluate() - energy).abs() < 1e-12 * energy);
    simulation.steps(30);
    assert_eq!(simulation.report().sleeping, 1);
    let tip = tip(&mut simulation);
    let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, tip + DVec3::X * 0.015);
    simulation.add_tool(ball).unwrap();
    simulation.steps(2);
    assert_eq!(simulation.report().sleeping, 0);
}

/// Surfaces of sleepers stay as they were fitted: not where somebody moves the body, also after a step that failed.
#[test]
fn a_body_that_is_put_under_a_tool_while_it_sleeps_is_felt_there() {
    let rest = cube().points;
    // the middle of the upper edge of its end
    let end = DVec3::new(SIZE, 0.02, 0.06);
    let middle = (0..rest.len()).find(|&v| rest[v].distance(end) < 1e-9).unwrap();
    let felt = |sleep_speed: f64, fails: bool| {
        let mut simulation = blocks(options(Precision::F64, 1), SLEEP, 1);
        until_asleep(&mut simulation, 1);
        let above = simulation.positions(BLOCK)[middle] + 0.035 * DVec3::Z;
        let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, above);
        let ball = simulation.add_tool(ball).unwrap();
        simulation.set_solver(settings(sleep_speed));
        simulation.steps(20);
        assert_eq!(simulation.report().sleeping, u32::from(sleep_speed > 0.0));
        if fails {
            let rows = far_end(&simulation);
            let pull = simulation.add_pull(Pull::new("bad", rows, -1.0, 0.0));
            simulation.step().unwrap_err();
            assert!(simulation.remove_contact(pull));
        }
        // bent up by 20 mm, 5 mm into the ball
        let up = |(now, rest): (&DVec3, &DVec3)| {
            *now - *rest + 0.02 * (rest.x / SIZE).powi(2) * DVec3::Z
        };
        let now = simulation.positions(BLOCK);
        let displaced: Vec<DVec3> = now.iter().zip(&rest).map(up).collect();
        let none = vec![DVec3::ZERO; displaced.len()];
        simulation.set_state(BLOCK, &displaced, &none).unwrap();
        simulation.step().unwrap();
        simulation.tool_report(ball).unwrap().force
    };
    let right = felt(0.0, false);
    assert!(right.z > 0.1, "{right}");
    for fails in [false, true] {
        let own = felt(SLEEP, fails);
        assert!(own.distance(right) < 1e-3 * right.length(), "{own} for {right}");
    }
}

#[test]
fn who_is_awake_moves_to_the_last_bit_as_if_nobody_slept() {
    let integrators = [
        Integrator::Auto,
        Integrator::Safe,
        Integrator::Newton,
        Integrator::Bdf2,
        Integrator::TrBdf2,
        Integrator::LinearisedTrBdf2,
        Integrator::ImplicitMidpoint,
    ];
    for integrator in integrators {
        let build = |sleep_speed, threads| {
            let mut simulation = restless(options(Precision::F64, threads), sleep_speed);
            simulation.set_solver(SolverSettings { integrator, ..settings(sleep_speed) });
            simulation
        };
        let [mut one, mut two, mut none] =
            [(SLEEP, 1), (SLEEP, 2), (0.0, 1)].map(|(speed, threads)| build(speed, threads));
        let mut before = Vec::new();
        while one.report().sleeping == 0 {
            before = one.positions(BLOCK);
            one.step().unwrap();
            assert!(one.time() < 6.0, "{integrator:?}");
        }
        // it stays where it was also in the step in which it falls asleep
        assert_eq!(one.positions(BLOCK), before, "{integrator:?}");
        let told = one.report().elastic_energy;
        let energy = one.evaluate();
        assert!((energy - told).abs() < 1e-9 * energy, "{integrator:?}: {told} {energy}");
        one.steps(30);
        assert_eq!((one.report().sleeping, one.positions(BLOCK)), (1, before));
        let steps = (one.time() / 0.01).round() as usize;
        two.steps(steps);
        none.steps(steps);
        let [awake, all] = [&mut one, &mut none].map(|s| s.positions(BodyHandle(1)));
        assert_eq!(awake, all, "{integrator:?}");
        assert_eq!(one.state_hash(), two.state_hash(), "{integrator:?}: threads");
        assert_eq!(none.report().sleeping, 0);
    }
}

/// Whatever the moment at which it lets go.
#[test]
fn what_a_pull_held_still_does_not_sleep_out_of_balance() {
    for late in 0..14 {
        let mut simulation = blocks(options(Precision::F64, 1), SLEEP, 1);
        simulation.set_dt(0.05);
        let rows = far_end(&simulation);
        let pull = simulation.add_pull(Pull::new("p", rows, 50.0, 0.1));
        simulation.move_pull(pull, DVec3::Y * 0.02);
        simulation.steps(60 + late);
        let held = simulation.positions(BLOCK);
        assert!(max_length(&simulation.velocities(BLOCK)) < SLEEP * SIZE, "it is held still");
        assert!(simulation.remove_contact(pull));
        simulation.steps(20);
        assert_eq!(simulation.report().sleeping, 0);
        let moved = max_distance(&held, &simulation.positions(BLOCK));
        assert!(moved > 3e-3, "{late}: {moved}");
    }
}

#[test]
fn a_way_back_finds_sleepers_asleep_and_repeats_to_the_last_bit() {
    let mut simulation = restless(options(Precision::F64, 1), SLEEP);
    let asleep = until_asleep(&mut simulation, 1);
    // before, in, and after the step in which it falls asleep
    for first in [asleep - 20, asleep, asleep + 30] {
        let mut simulation = restless(options(Precision::F64, 1), SLEEP);
        simulation.steps(first);
        let snapshot = simulation.snapshot().unwrap();
        simulation.steps(60);
        let hash = simulation.state_hash();
        assert_eq!(simulation.report().sleeping, 1);
        simulation.restore(&snapshot).unwrap();
        simulation.steps(60);
        assert_eq!(simulation.state_hash(), hash, "from {first} again");
        let mut other = restless(options(Precision::F64, 1), SLEEP);
        other.restore(&snapshot).unwrap();
        other.steps(60);
        assert_eq!(other.state_hash(), hash, "from {first} in another world");
    }
}

/// Where everyone sleeps steps end early, but not the first one after a way back: both must leave the same.
#[test]
fn a_world_at_rest_goes_on_from_snapshots_to_the_last_bit() {
    let build = || {
        let mut simulation = blocks(options(Precision::F64, 1), SLEEP, 1);
        let rows = far_end(&simulation);
        push(&mut simulation, "late", rows, Curve::Points(vec![[4.0, 0.0], [4.2, 1.0]]));
        simulation
    };
    let mut simulation = build();
    let asleep = until_asleep(&mut simulation, 1);
    for first in [asleep + 1, asleep + 3, asleep + 100] {
        let mut simulation = build();
        simulation.steps(first);
        let snapshot = simulation.snapshot().unwrap();
        simulation.steps(400 - first);
        assert_eq!(simulation.report().sleeping, 1);
        simulation.steps(60);
        let (hash, energy) = (simulation.state_hash(), simulation.report().elastic_energy);
        assert_eq!(simulation.report().sleeping, 0);
        let mut other = build();
        for simulation in [&mut simulation, &mut other] {
            simulation.restore(&snapshot).unwrap();
            simulation.steps(460 - first);
            let again = (simulation.state_hash(), simulation.report().elastic_energy);
            assert_eq!(again, (hash, energy), "from {first}");
        }
    }
}

#[test]
fn nobody_sleeps_while_a_pressure_acts_a_solve_fails_or_sleep_is_off() {
    let mut blown = blocks(options(Precision::F64, 1), SLEEP, 1);
    blow(&mut blown, BLOCK, &cube().surface_triangles()[..4], 1.0, Curve::Constant);
    let mut unsolved = blocks(options(Precision::F64, 1), SLEEP, 1);
    unsolved.set_solver(SolverSettings { max_linear_iterations: 1, ..settings(SLEEP) });
    let mut off = blocks(options(Precision::F64, 1), 0.0, 1);
    for simulation in [&mut blown, &mut unsolved, &mut off] {
        for _ in 0..200 {
            simulation.step().unwrap();
            assert_eq!(simulation.report().sleeping, 0);
        }
    }
}

/// Every law: what an evaluation leaves out of a sleeper must be what it would find.
#[test]
fn bodies_of_every_law_sleep_with_the_energies_and_forces_that_they_have() {
    let meshes = Meshes::new([4, 2, 2]);
    for (i, description) in meshes.bodies().iter().enumerate() {
        let what = format!("{i} {:?} {:?}", description.model, description.evaluation);
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        let body = simulation.add_body(description).unwrap();
        let points = simulation.positions(body);
        let last = points.iter().map(|x| x.x).fold(0.0, f64::max);
        let held = |x: &DVec3| x.x < 1e-9 || x.x > last - 1e-9;
        let held: Vec<u32> = (0..).zip(&points).filter(|(_, x)| held(x)).map(|(v, _)| v).collect();
        let rows = simulation.rows(body, "ends", &held).unwrap();
        simulation.add_constraint(Constraint::hold("ends", rows));
        simulation.set_gravity(DVec3::new(0.5, 1.0, 0.0));
        simulation.set_solver(solver!(Integrator::Auto, mass_damping = 40.0, sleep_speed = 1e-3));
        let asleep = (0..400).any(|_| {
            simulation.step().unwrap();
            simulation.report().sleeping == 1
        });
        // axes that keep volume alone resist no shear: such a body flows for as long as one waits
        let flows = description.axes.as_ref().is_some_and(|axes| axes.families.is_empty());
        assert_eq!(asleep, !flows, "{what}");
        if !asleep {
            continue;
        }
        simulation.step().unwrap();
        assert_eq!(simulation.report().evaluations, 0, "{what}");
        let energy = simulation.report().elastic_energy;
        let forces = simulation.elastic_forces(body);
        let all = simulation.evaluate();
        assert!(energy > 0.0 && (energy - all).abs() <= 1e-9 * all, "{what}: {energy} {all}");
        assert_eq!(simulation.elastic_forces(body), forces, "{what}");
    }
}

/// Steps of a world at rest do not look at all its numbers; what is set from outside is told all the same, before anything is done.
#[test]
fn numbers_that_are_set_while_all_sleep_are_looked_at() {
    let settings = [settings(SLEEP), settings(0.0), solver!(Integrator::SymplecticEuler)];
    for after in &settings {
        set_while_asleep::<f64>(Precision::F64, after);
        set_while_asleep::<f32>(Precision::F32, after);
    }
}

fn set_while_asleep<S: Scalar>(precision: Precision, after: &SolverSettings) {
    for what in ["displacement", "velocity", "rest position"] {
        let mut simulation = blocks(options(precision, 1), SLEEP, 1);
        until_asleep(&mut simulation, 1);
        simulation.steps(10);
        simulation.set_solver(after.clone());
        let (elements, time) = (simulation.remaining_tetrahedra(BLOCK), simulation.time());
        {
            let world = simulation.world_mut();
            let mut query =
                world.query::<(&mut Displacement<S>, &mut Velocity<S>, &mut RestPosition)>();
            let (mut u, mut v, mut rest) = query.iter_mut(world).last().unwrap();
            match what {
                "displacement" => u.0[0] = S::from_f64(f64::NAN),
                "velocity" => v.0[0] = S::from_f64(f64::NAN),
                _ => rest.0.x = f64::NAN,
            }
        }
        let region = Region::Sphere { centre: DVec3::new(0.06, 0.03, 0.03), radius: 0.02 };
        let request = RemovalRequest::new(BLOCK.0, Removal::new(region));
        let request = simulation.world_mut().spawn(request).id();
        let error = simulation.step().unwrap_err().to_string();
        assert!(error.contains(what) && error.contains("from outside"), "{error}");
        assert_eq!((simulation.remaining_tetrahedra(BLOCK), simulation.time()), (elements, time));
        assert!(simulation.world_mut().despawn(request), "the request waits");
    }
}
