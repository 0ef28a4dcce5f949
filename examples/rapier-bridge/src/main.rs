//! An instrument of 100 g in a hand presses into a block of tissue and is lifted. Two-way it hangs on a spring of the hand and
//! feels the tissue; one-way it is led to the same depth. `cd examples/rapier-bridge && cargo run --release`

use glam::{DQuat, DVec3};
use rapier_bridge::{Attached, Bridge, Coupling};
use rapier3d_f64::prelude::{ColliderBuilder, PhysicsWorld, Pose, RigidBodyBuilder};
use sinew::engine::mesh::generate::{box_tets, sphere_tets};
use sinew::prelude::*;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Length (s) of a step.
const DT: f64 = 0.01;
/// Radius (m) of the tip, and height (m) of the tissue.
const SIZES: [f64; 2] = [0.02, 0.05];
/// Spring (N/m) and damper (N s/m) of the hand.
const HAND: [f64; 2] = [300.0, 4.0];
/// Way (m) of the hand from where the tip touches, and step before it is lifted.
const DEEPEST: (f64, usize) = (0.018, 149);

/// Depth (m) of the tip under the surface at rest, and force (N) on the instrument.
#[derive(Clone, Copy)]
struct Row {
    depth: f64,
    force: f64,
}

fn main() -> Result<()> {
    let two_way = press(Coupling::TwoWay, DEEPEST.0)?;
    let one_way = press(Coupling::OneWay, two_way[DEEPEST.1].depth)?;
    println!("          |       one-way      |       two-way");
    println!("  time s  |  depth mm  force N |  depth mm  force N");
    for (step, (one, two)) in one_way.iter().zip(&two_way).enumerate().skip(9).step_by(10) {
        let time = DT * (step + 1) as f64;
        print!("  {time:6.2}  |  {:8.2}  {:7.3} ", 1e3 * one.depth, one.force);
        println!("|  {:8.2}  {:7.3}", 1e3 * two.depth, two.force);
    }
    Ok(())
}

/// What is felt step by step while a hand goes down by `deepest` (m) beyond the surface, waits and goes up.
fn press(coupling: Coupling, deepest: f64) -> Result<Vec<Row>> {
    let [radius, height] = SIZES;
    let mesh = box_tets(DVec3::new(0.1, 0.1, height), [10, 10, 5])?;
    let mut tissue = Simulation::new(SimulationOptions::default())?;
    tissue.set_dt(DT);
    tissue.set_gravity(DVec3::ZERO);
    let integrator = Integrator::Newton;
    tissue.set_solver(SolverSettings { integrator, ..SolverSettings::default() });
    let soft = YoungPoisson { young_modulus: 2e4, poisson_ratio: 0.4, density: 1000.0 };
    let model = Model::NeoHookean;
    let block = BodyDescription { model, ..BodyDescription::new("block", &mesh, soft) };
    let block = tissue.add_body(&block)?;
    let floor = tissue.group_rows(block, &mesh, "z0")?;
    tissue.add_constraint(Constraint::hold("floor", floor));

    // the tip is a stiff body without much mass of its own, held by the instrument
    let above = DVec3::new(0.05, 0.05, height + radius + 0.002);
    let mesh = sphere_tets(radius, 4)?.transformed(1.0, DQuat::IDENTITY, above);
    let hard = YoungPoisson { young_modulus: 1e6, poisson_ratio: 0.3, density: 10.0 };
    let tip = tissue.add_body(&BodyDescription::new("tip", &mesh, hard))?;
    tissue.add_body_contact(BodyContact::new("touch", [block, tip]));
    let vertices = (0..mesh.points.len() as u32).collect();
    let tip = Attached::Patch { name: "tip".into(), body: tip, vertices, stiffness: 1e5 };

    let mut world = PhysicsWorld { gravity: DVec3::ZERO, ..PhysicsWorld::default() };
    world.integration_parameters.dt = DT;
    let body = match coupling {
        Coupling::OneWay => RigidBodyBuilder::kinematic_position_based(),
        Coupling::TwoWay => RigidBodyBuilder::dynamic().lock_rotations(),
    };
    let shaft = ColliderBuilder::capsule_z(0.05, radius).translation(DVec3::Z * 0.05).mass(0.1);
    let (instrument, _) = world.insert(body.translation(above), shaft);
    let mut bridge = Bridge::default();
    let link = bridge.attach(&mut tissue, &mut world, instrument, tip, coupling)?;

    let mut rows = Vec::new();
    for step in 1..=250 {
        // 1 s down, 0.5 s still, 1 s up
        let time = DT * f64::from(step);
        let part = time.min(1.0) - (time - 1.5).max(0.0);
        let hand = above - DVec3::Z * part * (deepest + 0.002);
        let body = &mut world.bodies[instrument];
        body.set_next_kinematic_position(Pose::from_translation(hand));
        body.reset_forces(true);
        let spring = HAND[0] * (hand - body.translation()) - HAND[1] * body.linvel();
        body.add_force(spring, true);
        bridge.step(&mut tissue, &mut world)?;
        let depth = height + radius - world.bodies[instrument].translation().z;
        let force = bridge.link(link).ok_or("the instrument is loose")?.force.z;
        rows.push(Row { depth, force });
    }
    Ok(rows)
}

#[test]
fn the_hand_feels_what_the_tissue_gives() {
    let two_way = press(Coupling::TwoWay, DEEPEST.0).unwrap();
    let one_way = press(Coupling::OneWay, two_way[DEEPEST.1].depth).unwrap();
    let [one, two] = [&one_way, &two_way].map(|rows| rows[DEEPEST.1]);
    let spring = HAND[0] * (DEEPEST.0 - two.depth);
    assert!((two.force / spring - 1.0).abs() < 1e-3, "{} N, the spring {spring} N", two.force);
    assert!((one.depth - two.depth).abs() < 1e-12 && two.force > 1.0);
    // the same place, the same force
    let apart = one.force / two.force - 1.0;
    assert!(apart.abs() < 1e-2, "{} N one-way, {} N two-way", one.force, two.force);
    let end = two_way[two_way.len() - 1];
    assert!(end.depth < 0.0 && end.force.abs() < 1e-3 * two.force, "{} N after", end.force);
}
