//! What bodies and steps deserve a word about, with the codes of the command, and whether a state is to be trusted.

use crate::common::*;
use bevy_app::{App, Update};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::mesh::generate::box_tets;
use sinew::models::body::lumped::GivenSprings;
use sinew::models::body::sheet::MembraneDescription;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use sinew::warning::totals::RunTotals;
use sinew::warning::{Untrusted, Warning, spawn_checked_body, warnings};
use std::sync::Arc;

fn codes(warnings: &[Warning]) -> Vec<&str> {
    warnings.iter().map(|w| w.code.as_str()).collect()
}

/// A block on a table, with a ball that begins half inside of it if it is to.
fn block(inside: bool) -> Simulation {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2]).unwrap();
    let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
    let body = simulation.add_body(&BodyDescription::new("block", &mesh, soft(1e4, 0.4))).unwrap();
    simulation.set_gravity(DVec3::ZERO);
    clamp(&mut simulation, body, &mesh, "z0");
    let z = if inside { 0.055 } else { 0.2 };
    let ball = Tool::new("ball", Shape::Sphere { radius: 0.02 }, DVec3::new(0.05, 0.05, z));
    simulation.add_tool(ball).unwrap();
    simulation
}

#[test]
fn bodies_are_doubted_when_they_are_built() {
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [2, 2, 1]).unwrap();
    let mut young_modulus = vec![5e3; mesh.tetrahedra.len()];
    young_modulus[3] = 6.0;
    let skin = mesh.surface_triangles();
    let membrane = MembraneDescription::new(&skin, 1e-3, soft(50.0, 0.4));
    let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
    let body = simulation
        .add_body(&BodyDescription {
            young_modulus: Some(&young_modulus),
            membrane: Some(membrane),
            ..BodyDescription::new("organ", &mesh, soft(5e3, 0.49))
        })
        .unwrap();
    let found = simulation.warnings();
    let expected =
        ["material.young.range", "material.poisson.locking", "material.young.kilopascal"];
    assert_eq!(codes(&found), expected);
    assert_eq!(found[0].subject, "body `organ`");
    assert_eq!(found[2].subject, "membrane of body `organ`");
    // they are those of the material that the body has
    simulation.set_material(body, soft(5e3, 0.4)).unwrap();
    assert_eq!(codes(&simulation.warnings()), expected[2..]);
    // of a mesh that was checked before
    let other = box_tets(DVec3::splat(30.0), [2, 2, 2]).unwrap();
    let checked = check(&other, &CheckOptions::default()).unwrap();
    let long = BodyDescription::new("long", &checked.mesh, soft(5e3, 0.4));
    simulation.add_checked_body(&long, &checked.report).unwrap();
    assert_eq!(codes(&simulation.warnings())[1..], ["mesh.implausible-size"]);
    assert_eq!(simulation.verdict(), Ok(()));
}

#[test]
fn negative_springs_are_told() {
    let mesh = box_tets(DVec3::splat(0.1), [1, 1, 1]).unwrap();
    // the diagonal of the box belongs to all six tetrahedra
    let longest = |v: [u32; 2]| {
        let [a, b] = v.map(|v| mesh.points[v as usize]);
        a.distance(b) > 0.17
    };
    let with = |diagonal: [f64; 6]| {
        let mut springs = GivenSprings::default();
        for (cell, k) in mesh.tetrahedra.iter().zip(diagonal) {
            let pairs = (0..4).flat_map(|i| (i + 1..4).map(move |j| [cell[i], cell[j]]));
            let constants: Vec<f64> = pairs.map(|p| if longest(p) { k } else { 5.0 }).collect();
            springs.add(ElementKind::Tetrahedron, cell, &constants);
        }
        let model = Model::MassSpring;
        let spring_constants = Some(Arc::new(springs));
        let body = BodyDescription::new("body", &mesh, soft(1e4, 0.3));
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        simulation.add_body(&BodyDescription { model, spring_constants, ..body }).unwrap();
        simulation.warnings()
    };
    // what elements share counts once, by its sum
    assert_eq!(with([-1.0, -1.0, -1.0, -1.0, -1.0, 6.0]), []);
    let found = with([-2.0, -1.0, -1.0, -1.0, -1.0, 5.0]);
    assert_eq!(codes(&found), ["material.springs.negative"]);
    assert!(found[0].message.starts_with("1 of 19 springs"), "{found:?}");
    assert!(found[0].remedy.contains("nonnegative"), "{found:?}");
}

#[test]
fn steps_tell_what_went_wrong() {
    let mut simulation = block(true);
    assert!(simulation.warnings().is_empty() && simulation.totals().is_none());
    let start = simulation.snapshot().unwrap();
    for _ in 0..5 {
        simulation.step().unwrap();
    }
    let told = simulation.warnings();
    assert!(codes(&told).contains(&"run.contact.drawn-in"), "{told:?}");
    assert_eq!(simulation.totals().unwrap().steps, 5);
    // what happened belongs to the state that it led to
    let later = simulation.snapshot().unwrap();
    simulation.restore(&start).unwrap();
    assert!(simulation.warnings().is_empty());
    simulation.restore(&later).unwrap();
    assert_eq!(simulation.warnings(), told);
    // a good run has nothing to tell
    let mut simulation = block(false);
    for _ in 0..5 {
        simulation.step().unwrap();
    }
    assert!(simulation.warnings().is_empty(), "{:?}", simulation.warnings());
    assert_eq!(simulation.verdict(), Ok(()));
}

#[test]
fn an_app_is_told_too() {
    let mut app = App::new();
    app.add_plugins(SinewPlugins::default().in_schedule(Update));
    let mesh = box_tets(DVec3::new(0.1, 0.1, 0.05), [4, 4, 2]).unwrap();
    let world = app.world_mut();
    spawn_checked_body(world, &BodyDescription::new("block", &mesh, soft(6.0, 0.4))).unwrap();
    let ball = Shape::Sphere { radius: 0.02 };
    world.spawn(Tool::new("ball", ball, DVec3::new(0.05, 0.05, 0.055)));
    assert_eq!(codes(&warnings(app.world())), ["material.young.range"]);
    app.update();
    let told = warnings(app.world());
    assert!(codes(&told)[1..].contains(&"run.contact.drawn-in"), "{told:?}");
}

/// An equilibrium that was not found is no error of a step, but no state to trust.
#[test]
fn an_equilibrium_that_was_not_found_is_not_trusted() {
    let mut simulation = block(false);
    simulation.set_gravity(DVec3::new(300.0, 0.0, 0.0));
    let integrator = Integrator::QuasiStatic;
    let settings =
        SolverSettings { integrator, max_newton_iterations: 1, ..SolverSettings::default() };
    simulation.set_solver(settings);
    simulation.step().unwrap();
    assert!(simulation.report().unconverged);
    assert!(codes(&simulation.warnings()).contains(&"run.newton.unconverged"));
    let Err(Untrusted::NoEquilibrium { unconverged: 1, steps: 1, newton_step }) =
        simulation.verdict()
    else {
        panic!("{:?}", simulation.verdict());
    };
    assert!(newton_step > 0.0);
}

/// Whoever reads a force can ask whether its step converged.
#[test]
fn forces_of_steps_that_did_not_converge_say_so() {
    let mut simulation = block(false);
    let ball = simulation.find::<Tool>("ball").unwrap();
    let told = |simulation: &mut Simulation, iterations| {
        simulation.set_solver(SolverSettings {
            integrator: Integrator::Newton,
            max_newton_iterations: iterations,
            ..SolverSettings::default()
        });
        simulation.step().unwrap();
        let report = simulation.tool_report(ball).unwrap();
        assert_eq!(simulation.report().contact.missed, report.unconverged);
        (report.force.length() > 0.0, report.unconverged)
    };
    // nothing touches yet
    assert_eq!(told(&mut simulation, 1), (false, false));
    simulation.place_tool(ball, DVec3::new(0.05, 0.05, 0.068)).unwrap();
    assert_eq!(told(&mut simulation, 1), (true, true));
    assert_eq!(told(&mut simulation, 50), (true, false));
    let totals = simulation.totals().unwrap().contact.clone();
    assert_eq!((totals.missed, totals.touching, totals.missed_final), (1, 2, false));
    assert!(codes(&simulation.warnings()).contains(&"run.contact.forces"));
    let untrusted = Untrusted::Forces { missed: 1, touching: 2 };
    assert_eq!(simulation.verdict(), Err(untrusted));
}

#[test]
fn halted_bodies_and_energy_from_nowhere_are_not_trusted() {
    let mut simulation = block(false);
    let mut verdict = |change: &dyn Fn(&mut RunTotals)| {
        let mut totals = RunTotals { steps: 20, ..RunTotals::default() };
        totals.energy.dissipated = Some(0.0);
        totals.energy.load_work = 1.0;
        change(&mut totals);
        simulation.world_mut().insert_resource(totals);
        simulation.verdict()
    };
    assert_eq!(verdict(&|t| t.solver.halted_steps = 5), Ok(()));
    let halted = Err(Untrusted::Halted { halted: 6, by_contact: false, steps: 20 });
    assert_eq!(verdict(&|t| t.solver.halted_steps = 6), halted);
    // forces count by the steps that have any
    let touched = |t: &mut RunTotals, missed| (t.contact.missed, t.contact.touching) = (missed, 8);
    assert_eq!(verdict(&|t| touched(t, 2)), Ok(()));
    assert_eq!(verdict(&|t| touched(t, 3)), Err(Untrusted::Forces { missed: 3, touching: 8 }));
    // the cause that is named is that of most of them
    for (by_contact, cause) in [(3, "loads, motions or units"), (4, "bodies lie in each other")] {
        let told = verdict(&|t| {
            t.solver.halted_steps = 6;
            t.solver.halted_by_contact = by_contact;
        });
        assert!(told.unwrap_err().to_string().contains(cause));
    }
    assert_eq!(verdict(&|t| t.energy.dissipated = Some(-0.09)), Ok(()));
    let gain = Err(Untrusted::Energy { gain: 0.11, put_in: 1.0 });
    assert_eq!(verdict(&|t| t.energy.dissipated = Some(-0.11)), gain);
    assert!(verdict(&|t| t.energy.dissipated = Some(f64::NAN)).is_err());
}

/// A block that is turned inside out, and one that is stretched to ten times its length with all elements in order.
#[test]
fn what_no_tissue_holds_is_not_trusted() {
    let stretched = |by: f64| {
        let mesh = box_tets(DVec3::splat(0.1), [2, 2, 2]).unwrap();
        let mut simulation = Simulation::new(options(Precision::F64, 1)).unwrap();
        let body = simulation.add_body(&BodyDescription::new("b", &mesh, soft(1e4, 0.4))).unwrap();
        simulation.set_gravity(DVec3::ZERO);
        clamp(&mut simulation, body, &mesh, "x0");
        let end = simulation.group_rows(body, &mesh, "x1").unwrap();
        let way = Motion::Translate(DVec3::X * by);
        simulation.add_constraint(Constraint::moving("end", end, way, Curve::ramp(0.0, 0.3)));
        (0..30).for_each(|_| simulation.step().unwrap());
        simulation.verdict()
    };
    assert_eq!(stretched(0.1), Ok(()));
    let far = stretched(0.9);
    assert!(
        matches!(far, Err(Untrusted::BeyondHold { stored, whole }) if stored > 10.0 * whole),
        "{far:?}"
    );
    let through = stretched(-0.3);
    assert!(
        matches!(through, Err(Untrusted::InsideOut { inverted, now: true, .. }) if inverted > 2),
        "{through:?}"
    );
}

/// The energy that steps took out is what the others leave, also where elements go; a stiffer material on the way is no
/// energy from nowhere.
#[test]
fn the_books_balance() {
    let mut simulation = block(false);
    simulation.set_gravity(DVec3::new(0.0, 0.0, -9.81));
    let body = BodyHandle(0);
    for step in 0..20 {
        if step == 10 {
            let half = Region::Sphere { centre: DVec3::new(0.1, 0.1, 0.05), radius: 0.04 };
            let report = simulation.remove_elements(body, &Removal::new(half)).unwrap();
            assert!(!report.tetrahedra.is_empty());
        }
        simulation.step().unwrap();
    }
    let e = simulation.totals().unwrap().energy;
    let left = e.initial + e.load_work + e.constraint_work - e.removed - e.elastic - e.kinetic;
    assert!(e.removed != 0.0 && e.initial == 0.0, "{e:?}");
    assert!((e.dissipated.unwrap() - left).abs() < 1e-9 * e.put_in(), "{e:?}, {left}");
    let change = simulation.set_material(body, soft(1e6, 0.4)).unwrap();
    assert!(change.elastic_energy > 10.0 * e.put_in(), "{change:?}");
    for _ in 0..20 {
        simulation.step().unwrap();
    }
    assert_eq!(simulation.verdict(), Ok(()));
    assert!(!codes(&simulation.warnings()).contains(&"run.energy.gain"));
}
