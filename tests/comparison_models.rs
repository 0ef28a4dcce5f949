//! Comparison models in whole simulations, and new materials for bodies that exist.

use crate::common::*;
use glam::DVec3;
use sinew::engine::lanes::InstructionSet;
use sinew::engine::mesh::Mesh;
use sinew::models::body::Evaluation;
use sinew::models::material::field::MaterialField;
use sinew::prelude::*;

const NEW: [Model; 5] =
    [Model::Linear, Model::WarpedStiffness, Model::Corotational, Model::StVKFem, Model::NeoHookean];

fn beam() -> Mesh {
    jittered_box([0.2, 0.05, 0.05], [8, 2, 2])
}

/// Everything on: gravity, a clamp, damping; all new models side by side.
fn side_by_side(threads: usize, precision: Precision) -> u64 {
    let mesh = jittered_box([0.2, 0.05, 0.05], [16, 6, 6]);
    let options = SimulationOptions { threads, precision, ..Default::default() };
    let mut simulation = Simulation::new(options).unwrap();
    for model in NEW {
        let description =
            BodyDescription { model, ..BodyDescription::new(model.name(), &mesh, soft(1e4, 0.4)) };
        let body = simulation.add_body(&description).unwrap();
        clamp(&mut simulation, body, &mesh, "x0");
    }
    simulation.set_dt(0.01);
    simulation.set_solver(solver!(Integrator::Safe, stiffness_damping = 1e-3));
    simulation.steps(4);
    simulation.set_material(BodyHandle(2), soft(3e4, 0.3)).unwrap();
    simulation.steps(3);
    simulation.state_hash()
}

#[test]
fn one_hash_for_any_number_of_threads() {
    for precision in [Precision::F64, Precision::F32] {
        let expected = side_by_side(1, precision);
        assert_eq!(side_by_side(2, precision), expected);
        assert_eq!(side_by_side(3, precision), expected);
    }
}

/// A displaced body released without loads: the energy falls from step to step, and damping of either
/// kind takes more of it than the integrator alone, whatever the model.
#[test]
fn damping_takes_energy_out_of_every_model() {
    let mesh = beam();
    for model in Model::ALL {
        let mut undamped = f64::INFINITY;
        for (mass_damping, stiffness_damping) in [(0.0, 0.0), (4.0, 0.0), (0.0, 2e-3)] {
            let (mut simulation, body) = plain(&mesh, soft(1e4, 0.4), model, Evaluation::Fused);
            clamp(&mut simulation, body, &mesh, "x0");
            let bend: Vec<_> =
                mesh.points.iter().map(|x| DVec3::new(0.0, 0.0, 1.5 * x.x * x.x)).collect();
            simulation.displace(body, &bend);
            simulation.set_gravity(DVec3::ZERO);
            simulation.set_dt(2e-3);
            simulation.set_solver(solver!(
                Integrator::Newton,
                mass_damping,
                stiffness_damping,
                linear_tolerance = 1e-8
            ));
            let mut before = simulation.evaluate();
            for step in 0..20 {
                simulation.step().unwrap();
                let report = simulation.report();
                let now = report.elastic_energy + report.kinetic_energy;
                let name = format!("{model:?} {mass_damping} {stiffness_damping} step {step}");
                assert!(now < before, "{name}: {before} to {now}");
                before = now;
            }
            if mass_damping + stiffness_damping == 0.0 {
                undamped = before;
            } else {
                assert!(before < 0.97 * undamped, "{model:?}: {before} with, {undamped} without");
            }
        }
    }
}

/// The safe step keeps its bound on the energy for every model, also from crushed states.
#[test]
fn energy_never_rises_in_the_safe_step() {
    let mesh = jittered_box([0.1, 0.1, 0.1], [3, 3, 3]);
    let n = mesh.points.len();
    for model in Model::ALL {
        for size in [0.01, 0.06] {
            let (mut simulation, body) = plain(&mesh, soft(1e4, 0.4), model, Evaluation::Fused);
            let crush = random_field(n, 9);
            let u: Vec<_> = crush
                .iter()
                .zip(&mesh.points)
                .map(|(r, x)| *r * size + DVec3::new(-0.5 * x.x, 0.0, 0.0))
                .collect();
            simulation.displace(body, &u);
            simulation.set_gravity(DVec3::ZERO);
            simulation.set_dt(1.0 / 60.0);
            simulation.integrate_by(Integrator::Safe);
            let start = simulation.evaluate();
            let mut before = start;
            for step in 0..30 {
                simulation.step().unwrap();
                let report = simulation.report();
                let now = report.elastic_energy + report.kinetic_energy;
                assert!(now <= before + 1e-9 * start, "{model:?} {size} {step}: {before} {now}");
                before = now;
            }
        }
    }
}

/// Newton's method needs the exact tangent to be exact: few iterations for all but the warped law.
#[test]
fn statics_agree_at_small_loads() {
    let mesh = beam();
    let mut tips = Vec::new();
    for model in NEW.into_iter().chain([Model::StVK]) {
        let (mut simulation, body) = plain(&mesh, soft(1e6, 0.3), model, Evaluation::Fused);
        clamp(&mut simulation, body, &mesh, "x0");
        simulation.set_gravity(DVec3::new(0.0, 0.0, -0.1));
        simulation.set_dt(1.0);
        simulation.set_solver(solver!(Integrator::QuasiStatic, linear_tolerance = 1e-10));
        simulation.step().unwrap();
        let report = simulation.report();
        assert!(!report.unconverged, "{model:?}");
        assert!(report.newton_iterations <= 6, "{model:?}: {}", report.newton_iterations);
        tips.push((model, max_length(&simulation.displacements(body))));
    }
    let (_, linear) = tips[0];
    for (model, tip) in &tips {
        assert!((tip / linear - 1.0).abs() < 1e-3, "{model:?}: {tip} against {linear}");
    }
}

fn changed(
    mesh: &Mesh,
    (model, evaluation): (Model, Evaluation),
    precision: Precision,
    field: Option<&[f64]>,
) {
    let name = format!("{model:?} {evaluation:?} {precision:?}");
    let n = mesh.points.len();
    let u: Vec<_> = random_field(n, 3).iter().map(|r| *r * 2e-3).collect();
    let v: Vec<_> = random_field(n, 4).iter().map(|r| *r * 0.05).collect();
    let new = YoungPoisson { young_modulus: 3e4, poisson_ratio: 0.25, density: 1300.0 };
    let material = MaterialField { young_modulus: field, ..new.into() };
    let options = SimulationOptions { precision, ..Default::default() };
    let settle = |simulation: &mut Simulation, body: BodyHandle| {
        simulation.set_state(body, &u, &v).unwrap();
        simulation.set_dt(0.005);
        simulation.integrate_by(Integrator::Safe);
    };
    // a body that lived as another material, another body before it
    let mut old = Simulation::new(options).unwrap();
    let before = BodyDescription {
        model,
        evaluation,
        ..BodyDescription::new("body", mesh, soft(1e4, 0.45))
    };
    let body = old.add_body(&before).unwrap();
    clamp(&mut old, body, mesh, "x0");
    settle(&mut old, body);
    old.steps(3);
    old.set_state(body, &u, &v).unwrap();
    let energy = old.evaluate();
    let change = old.set_material(body, material).unwrap();
    // the same body made of the new material
    let mut fresh = Simulation::new(options).unwrap();
    let description = BodyDescription { material: new, young_modulus: field, ..before.clone() };
    let other = fresh.add_body(&description).unwrap();
    clamp(&mut fresh, other, mesh, "x0");
    settle(&mut fresh, other);
    assert_eq!(old.evaluate(), fresh.evaluate(), "{name}");
    assert_eq!(old.masses(body), fresh.masses(other), "{name}");
    assert_eq!(old.elastic_forces(body), fresh.elastic_forces(other), "{name}");
    let jump = fresh.evaluate() - energy;
    assert_eq!(change.elastic_energy, jump, "{name}");
    assert!(change.kinetic_energy > 0.0, "{name}");
    // and what follows
    for _ in 0..3 {
        old.step().unwrap();
        fresh.step().unwrap();
    }
    assert_eq!(old.state_hash(), fresh.state_hash(), "{name}");
}

#[test]
fn a_changed_body_is_a_new_one() {
    let mesh = beam();
    let field: Vec<f64> = (0..mesh.tetrahedra.len()).map(|i| 1e4 + 100.0 * i as f64).collect();
    for precision in [Precision::F64, Precision::F32] {
        for model in Model::ALL {
            for evaluation in [Evaluation::Fused, Evaluation::Pooled] {
                if model.supports(evaluation) {
                    changed(&mesh, (model, evaluation), precision, None);
                }
            }
        }
        changed(&mesh, (Model::StVK, Evaluation::Pooled), precision, Some(&field));
        changed(&mesh, (Model::CompressibleStVK, Evaluation::Fused), precision, Some(&field));
    }
}

/// Explicit integrators learn the new limit: a stiffer body takes more substeps, from the next step on.
#[test]
fn explicit_steps_follow_the_material() {
    let mesh = beam();
    let (mut simulation, body) = simulate(
        SimulationOptions { instruction_set: Some(InstructionSet::Portable), ..Default::default() },
        &mesh,
        soft(1e4, 0.3),
        Model::CompressibleStVK,
        Evaluation::Fused,
    );
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.set_dt(0.03);
    simulation.integrate_by(Integrator::StormerVerlet);
    simulation.step().unwrap();
    let soft_step = simulation.stable_step();
    let substeps = simulation.report().substeps;
    simulation.set_material(body, soft(16e4, 0.3)).unwrap();
    let ratio = soft_step / simulation.stable_step();
    assert!((ratio / 4.0 - 1.0).abs() < 0.1, "{ratio}");
    simulation.step().unwrap();
    let more = simulation.report().substeps;
    assert!(more >= 3 * substeps && more <= 5 * substeps, "{substeps} to {more}");
}

#[test]
fn a_bad_material_changes_nothing() {
    let mesh = beam();
    let (mut simulation, body) =
        plain(&mesh, soft(1e4, 0.3), Model::CompressibleStVK, Evaluation::Pooled);
    clamp(&mut simulation, body, &mesh, "x0");
    simulation.step().unwrap();
    let (hash, energy) = (simulation.state_hash(), simulation.evaluate());
    let short = [1e4; 3];
    let bad = MaterialField { young_modulus: Some(&short), ..soft(1e4, 0.3).into() };
    for error in [
        simulation.set_material(body, soft(-1.0, 0.3)).unwrap_err(),
        simulation.set_material(body, bad).unwrap_err(),
    ] {
        let message = error.to_string();
        assert!(message.contains("`body`") && message.contains("give") || message.contains("must"));
    }
    assert_eq!((simulation.state_hash(), simulation.evaluate()), (hash, energy));
}
