//! Criteria, meshes and materials were written down before the first run.

use glam::DVec3;
use rapier_bridge::{Attached, Bridge, BridgeError, Coupling};
use rapier3d_f64::prelude::*;
use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::{
    BodyDescription, BodyHandle, Constraint, Integrator, Mesh, Model, Shape, Simulation,
    SimulationOptions, SolverSettings, Tool, YoungPoisson,
};

const DT: f64 = 0.01;
/// Half sizes (m) of a plate.
const PLATE: DVec3 = DVec3::new(0.06, 0.06, 0.02);
const MASSES: [f64; 5] = [0.001, 0.01, 0.1, 1.0, 10.0];

/// A block of tissue with its lower corner at the origin, without gravity.
fn block(size: DVec3, cells: [usize; 3], damping: f64) -> (Simulation, BodyHandle, Mesh) {
    let mesh = box_tets(size, cells).unwrap();
    let mut tissue = Simulation::new(SimulationOptions::default()).unwrap();
    tissue.set_dt(DT);
    tissue.set_gravity(DVec3::ZERO);
    tissue.set_solver(SolverSettings {
        integrator: Integrator::Newton,
        linear_tolerance: 1e-8,
        newton_tolerance: 1e-12,
        mass_damping: damping,
        ..SolverSettings::default()
    });
    let material = YoungPoisson { young_modulus: 2e4, poisson_ratio: 0.4, density: 1000.0 };
    let model = Model::NeoHookean;
    let body = BodyDescription { model, ..BodyDescription::new("block", &mesh, material) };
    let body = tissue.add_body(&body).unwrap();
    (tissue, body, mesh)
}

fn world(gravity: DVec3) -> PhysicsWorld {
    let mut world = PhysicsWorld { gravity, ..PhysicsWorld::default() };
    world.integration_parameters.dt = DT;
    world
}

fn plate(world: &mut PhysicsWorld, mass: f64, at: DVec3, velocity: DVec3) -> RigidBodyHandle {
    let body = RigidBodyBuilder::dynamic().translation(at).linvel(velocity);
    world.insert(body, ColliderBuilder::cuboid(PLATE.x, PLATE.y, PLATE.z).mass(mass)).0
}

fn plate_tool(friction: f64) -> Attached {
    let shape = Shape::Box { half: PLATE, rounding: 0.01 };
    Attached::Tool(Box::new(Tool::new("plate", shape, DVec3::ZERO).with_friction(friction)))
}

/// Steps a free pair for 1 s; the largest change of momentum over the largest momentum of a part.
fn momentum_error(
    mut bridge: Bridge,
    mut tissue: Simulation,
    mut world: PhysicsWorld,
    rigid: RigidBodyHandle,
) -> f64 {
    let body = &world.bodies[rigid];
    let (start, energy) = (body.mass() * body.linvel(), body.kinetic_energy());
    let (mut largest, mut worst, mut taken) = (start.length(), 0.0_f64, 0.0_f64);
    for step in 0..100 {
        bridge.step(&mut tissue, &mut world).unwrap();
        assert!(bridge.link(0).unwrap().balanced, "step {step}: {:?}", tissue.report());
        let (body, report) = (&world.bodies[rigid], tissue.report());
        let all = body.kinetic_energy() + report.kinetic_energy + report.elastic_energy;
        assert!(all <= 1.01 * energy, "step {step}: {all} J of {energy} J");
        let of_tissue = DVec3::from_array(report.momentum);
        let of_rigid = body.mass() * body.linvel();
        largest = largest.max(of_tissue.length()).max(of_rigid.length());
        worst = worst.max((of_tissue + of_rigid - start).length());
        taken = taken.max(of_tissue.length());
    }
    // one that bounces off gives the tissue up to twice the reduced mass times the speed
    let of_tissue: f64 = tissue.masses(tissue.find_body("block").unwrap()).iter().sum();
    let bounce = start.length() / (1.0 + world.bodies[rigid].mass() / of_tissue);
    assert!(taken > 0.1 * bounce, "the tissue got {taken} kg m/s");
    worst / largest
}

#[test]
fn momentum_of_a_free_pair_stays() {
    for mass in MASSES {
        let (mut tissue, body, mesh) = block(DVec3::new(0.1, 0.1, 0.04), [5, 5, 2], 0.0);
        let mut world_ = world(DVec3::ZERO);
        let at = DVec3::new(0.05, 0.05, 0.04 + PLATE.z + 0.002);
        let rigid = plate(&mut world_, mass, at, DVec3::new(0.05, 0.0, -0.2));
        let mut bridge = Bridge::default();
        let two_way = Coupling::TwoWay;
        bridge.attach(&mut tissue, &mut world_, rigid, plate_tool(0.0), two_way).unwrap();
        let touching = momentum_error(bridge, tissue, world_, rigid);

        let (mut tissue, mut world_) =
            (block(DVec3::new(0.1, 0.1, 0.04), [5, 5, 2], 0.0).0, world(DVec3::ZERO));
        // beside the middle, so that both turn
        let rigid = plate(&mut world_, mass, at + DVec3::X * 0.03, DVec3::new(0.1, 0.05, 0.2));
        let vertices = mesh.group("z1").unwrap().vertices.clone();
        let patch = Attached::Patch { name: "top".into(), body, vertices, stiffness: 1e4 };
        let mut bridge = Bridge::default();
        bridge.attach(&mut tissue, &mut world_, rigid, patch, two_way).unwrap();
        let attached = momentum_error(bridge, tissue, world_, rigid);
        println!("{mass} kg: momentum off by {touching:.1e} touching, {attached:.1e} attached");
        assert!(touching < 1e-6 && attached < 1e-6, "{mass} kg: {touching:e}, {attached:e}");
    }
}

#[test]
fn plates_of_all_masses_fall_and_come_to_rest() {
    // flat without friction, and on an edge with friction
    for (mass, friction, tilt) in MASSES.into_iter().flat_map(|m| [(m, 0.0, 0.0), (m, 0.3, 0.3)]) {
        let (mut tissue, body, mesh) = block(DVec3::new(0.2, 0.2, 0.06), [8, 8, 3], 5.0);
        let floor = tissue.group_rows(body, &mesh, "z0").unwrap();
        tissue.add_constraint(Constraint::hold("floor", floor));
        let mut world = world(DVec3::NEG_Z * 9.81);
        let at = DVec3::new(0.1, 0.1, 0.06 + PLATE.z + 0.005 + tilt * PLATE.x);
        let rigid = plate(&mut world, mass, at, DVec3::ZERO);
        let turn = Rotation::from_scaled_axis(DVec3::new(tilt, 0.5 * tilt, 0.0));
        world.bodies[rigid].set_rotation(turn, true);
        let (mut bridge, two_way) = (Bridge::default(), Coupling::TwoWay);
        bridge.attach(&mut tissue, &mut world, rigid, plate_tool(friction), two_way).unwrap();
        let (mut excess, mut most, mut off) = (f64::NEG_INFINITY, 0.0_f64, 0.0_f64);
        for step in 0..400 {
            bridge.step(&mut tissue, &mut world).unwrap();
            let (body, report) = (&world.bodies[rigid], tissue.report());
            let work = mass * 9.81 * (at.z - body.translation().z);
            let energy = body.kinetic_energy() + report.kinetic_energy + report.elastic_energy;
            assert!(energy.is_finite());
            (most, excess) = (most.max(work), excess.max(energy - work));
            if step >= 350 {
                let part = bridge.link(0).unwrap().force.z / (mass * 9.81);
                off = off.max((part - 1.0).abs());
            }
        }
        let sunk = 1e3 * (0.06 + PLATE.z - world.bodies[rigid].translation().z);
        let gain = excess / most;
        println!(
            "{mass} kg, friction {friction}: off its weight by {off:.1e}, sunk {sunk:.2} mm, energy gain {gain:.1e}"
        );
        assert!(gain <= 0.01, "{mass} kg: {excess} J too much of {most} J");
        assert!(off < 1e-3, "{mass} kg: off its weight by {off}");
    }
}

#[test]
fn one_way_the_pose_is_followed_and_the_reaction_is_that_of_the_report() {
    let (mut tissue, body, mesh) = block(DVec3::new(0.2, 0.2, 0.06), [8, 8, 3], 0.0);
    let floor = tissue.group_rows(body, &mesh, "z0").unwrap();
    tissue.add_constraint(Constraint::hold("floor", floor));
    let mut world = world(DVec3::NEG_Z * 9.81);
    let at = DVec3::new(0.1, 0.1, 0.06 + PLATE.z + 0.001);
    let rigid = RigidBodyBuilder::kinematic_position_based().translation(at);
    let shape = ColliderBuilder::cuboid(PLATE.x, PLATE.y, PLATE.z);
    let rigid = world.insert(rigid, shape).0;
    let mut bridge = Bridge::default();
    let link =
        bridge.attach(&mut tissue, &mut world, rigid, plate_tool(0.0), Coupling::OneWay).unwrap();
    for step in 1..=50 {
        let part = f64::from(step) / 50.0;
        let turn = Rotation::from_rotation_x(0.05 * part);
        let pose = Pose::from_parts(at - DVec3::Z * 0.006 * part, turn);
        world.bodies[rigid].set_next_kinematic_position(pose);
        bridge.step(&mut tissue, &mut world).unwrap();
        let felt = tissue.tool_report(bridge.link(link).unwrap().entity).unwrap().clone();
        let now = world.bodies[rigid].position();
        assert_eq!((felt.position, felt.rotation), (now.translation, now.rotation));
        let own = bridge.link(link).unwrap();
        assert_eq!(own.force, felt.force);
        // the tool's origin is the centre of mass
        assert!((own.torque - felt.torque).length() <= 1e-12 * felt.torque.length());
        let on_tissue: DVec3 = tissue.contact_forces(body).into_iter().sum();
        assert!((on_tissue + own.force).length() <= 1e-12 * own.force.length());
    }
    let own = bridge.link(link).unwrap();
    assert!(own.force.z > 1.0 && own.torque.x.abs() > 1e-3, "{own:?}");
    assert_eq!(world.bodies[rigid].user_force(), DVec3::ZERO);
}

#[test]
fn bad_input_is_named() {
    let (mut tissue, body, _) = block(DVec3::new(0.1, 0.1, 0.04), [2, 2, 1], 0.0);
    let mut world = world(DVec3::ZERO);
    let mut bridge = Bridge::default();
    let (at, two_way) = (DVec3::new(0.05, 0.05, 0.1), Coupling::TwoWay);
    let none = RigidBodyHandle::invalid();
    let error = bridge.attach(&mut tissue, &mut world, none, plate_tool(0.0), two_way).unwrap_err();
    assert!(matches!(error, BridgeError::NoBody(..)), "{error}");
    assert!(error.to_string().contains("`plate`") && error.to_string().contains("use what"));

    let fixed = world.insert_body(RigidBodyBuilder::fixed());
    let error =
        bridge.attach(&mut tissue, &mut world, fixed, plate_tool(0.0), two_way).unwrap_err();
    assert!(matches!(error, BridgeError::NotDynamic(_)), "{error}");
    let rigid = plate(&mut world, 1.0, at, DVec3::ZERO);
    let floor = Tool::ground("floor", DVec3::ZERO, DVec3::Z);
    let floor = Attached::Tool(Box::new(floor));
    let error = bridge.attach(&mut tissue, &mut world, rigid, floor, two_way).unwrap_err();
    assert!(matches!(error, BridgeError::Unbounded(_)), "{error}");
    let patch =
        |vertices, stiffness| Attached::Patch { name: "top".into(), body, vertices, stiffness };
    let flat = Tool::new("flat", Shape::Sphere { radius: f64::NAN }, DVec3::ZERO);
    let flat = Attached::Tool(Box::new(flat));
    let error = bridge.attach(&mut tissue, &mut world, rigid, flat, two_way).unwrap_err();
    assert!(error.to_string().contains("`flat`: its radius is NaN"), "{error}");
    let soft = patch(vec![0], 0.0);
    let error = bridge.attach(&mut tissue, &mut world, rigid, soft, two_way).unwrap_err();
    assert!(matches!(error, BridgeError::Stiffness(..)), "{error}");
    let beyond = patch(vec![1_000], 1.0);
    let error = bridge.attach(&mut tissue, &mut world, rigid, beyond, two_way).unwrap_err();
    assert!(matches!(error, BridgeError::Tissue(_)), "{error}");

    let link = bridge.attach(&mut tissue, &mut world, rigid, plate_tool(0.0), two_way).unwrap();
    bridge.step(&mut tissue, &mut world).unwrap();
    tissue.set_dt(0.5 * DT);
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(matches!(error, BridgeError::Steps { .. }), "{error}");
    tissue.set_dt(DT);
    let newton = tissue.world().resource::<SolverSettings>().clone();
    tissue.set_solver(SolverSettings::default());
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(error.to_string().contains("Integrator::Newton"), "{error}");
    tissue.set_solver(newton);

    // what was refused has moved nothing
    let before = (tissue.time(), *world.bodies[rigid].position());
    world.bodies[rigid].set_linvel(DVec3::X * f64::NAN, true);
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(matches!(error, BridgeError::NotFinite(_, "velocity")), "{error}");
    assert_eq!(before, (tissue.time(), *world.bodies[rigid].position()));
    world.bodies[rigid].set_linvel(DVec3::ZERO, true);
    bridge.step(&mut tissue, &mut world).unwrap();
    world.bodies[rigid].set_position(Pose::from_translation(DVec3::splat(f64::INFINITY)), true);
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(matches!(error, BridgeError::NotFinite(_, "pose")), "{error}");

    world.remove_body(rigid);
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(matches!(error, BridgeError::Removed(_, _, 0)), "{error}");
    assert!(error.to_string().contains("detach link 0"), "{error}");
    assert!(bridge.detach(&mut tissue, link) && !bridge.detach(&mut tissue, link));
    bridge.step(&mut tissue, &mut world).unwrap();
    let rigid = plate(&mut world, 1.0, at, DVec3::ZERO);
    let link = bridge.attach(&mut tissue, &mut world, rigid, plate_tool(0.0), two_way).unwrap();
    tissue.remove_contact(bridge.link(link).unwrap().entity);
    let error = bridge.step(&mut tissue, &mut world).unwrap_err();
    assert!(matches!(error, BridgeError::Released(_, 1)), "{error}");
}
