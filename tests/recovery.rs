//! Bodies that were collapsed, scrambled or mirrored find back to their rest shape in recovery mode.

use crate::common::*;
use glam::DVec3;
use sinew::engine::law::RecoveringBodies;
use sinew::engine::mesh::Mesh;
use sinew::models::axes::description::AxesDescription;
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::prelude::*;

const CELL: f64 = 0.02;

/// Root mean square over edges of relative length change.
fn edge_error(simulation: &mut Simulation, body: BodyHandle, mesh: &Mesh) -> f64 {
    let u = simulation.displacements(body);
    let rows = simulation.topology().bodies[body.0].clone();
    let edges = simulation.topology().edges.clone();
    let sum: f64 = edges
        .iter()
        .map(|edge| {
            let [a, b] = edge.map(|row| rows.vertex(VertexRow(row)).index());
            let rest = mesh.points[a] - mesh.points[b];
            ((rest + u[a] - u[b]).length() / rest.length() - 1.0).powi(2)
        })
        .sum();
    (sum / edges.len() as f64).sqrt()
}

/// What came of a start.
#[derive(Debug)]
struct Outcome {
    error: f64,
    inverted: u64,
    steps: u32,
    /// Largest energy, less what changes of law added, over that at the start.
    highest: f64,
}

fn recover(
    mesh: &Mesh,
    nu: f64,
    evaluation: Evaluation,
    start: &[DVec3],
    integrator: Integrator,
) -> Outcome {
    let options = SimulationOptions { threads: 1, ..Default::default() };
    let (mut simulation, body) =
        simulate(options, mesh, soft(1e4, nu), Model::CompressibleStVK, evaluation);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(1.0 / 60.0);
    simulation.set_solver(solver!(integrator, mass_damping = 3.5, recovery = true));
    let u: Vec<_> = start.iter().zip(&mesh.points).map(|(x, r)| *x - *r).collect();
    simulation.displace(body, &u);
    let energy = simulation.evaluate();
    let (mut steps, mut highest, mut added) = (0, 0.0_f64, 0.0);
    for _ in 0..180 {
        simulation.step().unwrap();
        let report = simulation.report();
        steps += report.recovering;
        // at a point the corotational energy is up to 2.6 times that of the springs
        added += report.recovery_energy;
        highest = highest.max(report.elastic_energy + report.kinetic_energy - added);
    }
    Outcome {
        error: edge_error(&mut simulation, body, mesh),
        inverted: simulation.volume_report().inverted,
        steps,
        highest: highest / energy,
    }
}

fn starts(mesh: &Mesh, size: f64, seed: u64) -> Vec<(&'static str, Vec<DVec3>)> {
    let n = mesh.points.len();
    let centre = DVec3::splat(0.5 * size);
    let field = |s: u64| random_field(n, 100 * seed + s);
    let map = |f: &dyn Fn(DVec3) -> DVec3| mesh.points.iter().map(|x| f(*x)).collect::<Vec<_>>();
    let around = |s: u64, scale: f64| field(s).iter().map(|r| centre + *r * scale).collect();
    let mut all: Vec<(&str, Vec<DVec3>)> = vec![
        ("point", around(1, 1e-6 * size)),
        ("random", around(2, 0.5 * size)),
        ("random 3x", around(3, 1.5 * size)),
    ];
    if seed == 0 {
        all.push(("mirrored", map(&|x| DVec3::new(x.x, x.y, size - x.z))));
        all.push(("flat", map(&|x| DVec3::new(x.x, x.y, centre.z))));
    }
    all
}

#[test]
#[ignore = "slow"]
fn every_start_recovers() {
    let mut failed = Vec::new();
    for cells in [3, 5] {
        let size = cells as f64 * CELL;
        let mesh = jittered_box([size; 3], [cells; 3]);
        for seed in 0..4 {
            for (name, start) in starts(&mesh, size, seed) {
                for nu in [0.3, 0.45] {
                    let outcome = recover(&mesh, nu, Evaluation::Fused, &start, Integrator::Auto);
                    let good = outcome.error < 0.01
                        && outcome.inverted == 0
                        && outcome.highest <= 1.0 + 1e-6;
                    if !good {
                        failed.push(format!("{name} {seed} {cells}^3 nu {nu}: {outcome:?}"));
                    }
                }
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn pooled_bodies_recover_too() {
    let mesh = jittered_box([3.0 * CELL; 3], [3; 3]);
    for (name, start) in starts(&mesh, 3.0 * CELL, 0) {
        let outcome = recover(&mesh, 0.45, Evaluation::Pooled, &start, Integrator::Safe);
        assert!(outcome.error < 0.01 && outcome.inverted == 0, "{name}: {outcome:?}");
    }
}

/// All vertices in one place, exactly; ten-node tetrahedra do not end folded with their Gauss points in order.
#[test]
fn a_point_recovers() {
    let linear = jittered_box([3.0 * CELL; 3], [3; 3]);
    let quadratic = linear.with_second_order();
    for (mesh, nu) in [(&linear, 0.3), (&quadratic, 0.3), (&quadratic, 0.45)] {
        let start = vec![DVec3::splat(0.01); mesh.points.len()];
        let outcome = recover(mesh, nu, Evaluation::Fused, &start, Integrator::Auto);
        let good = outcome.steps > 0 && outcome.error < 0.01 && outcome.inverted == 0;
        assert!(good, "{} vertices, nu {nu}: {outcome:?}", mesh.points.len());
    }
}

/// A body in shape never leaves its own law, and costs the same bits.
#[test]
fn nothing_changes_for_a_body_in_shape() {
    let mesh = jittered_box([0.2, 0.05, 0.05], [6, 2, 2]);
    let run = |recovery: bool| {
        let options = SimulationOptions::default();
        let model = Model::CompressibleStVK;
        let (mut simulation, body) =
            simulate(options, &mesh, soft(3e4, 0.4), model, Evaluation::Fused);
        clamp(&mut simulation, body, &mesh, "x0");
        simulation.set_solver(SolverSettings { recovery, ..Default::default() });
        for _ in 0..20 {
            simulation.step().unwrap();
            assert_eq!(simulation.report().recovering, 0);
        }
        simulation.state_hash()
    };
    assert_eq!(run(true), run(false));
}

/// Whatever its own law, a body recovers by the corotational energy and by nothing else, and takes its own
/// up again; one without a material never begins.
#[test]
fn every_material_gives_way_to_the_corotational_energy() {
    let mesh = jittered_box([3.0 * CELL; 3], [3; 3]);
    let mirrored: Vec<_> = mesh.points.iter().map(|x| -2.0 * x.z * DVec3::Z).collect();
    let still = vec![DVec3::ZERO; mirrored.len()];
    let body = |model, evaluation, volume| {
        let mut simulation = Simulation::new(SimulationOptions::default()).unwrap();
        let axes = (model == Model::Axes)
            .then(|| AxesDescription::isotropic(soft(1e4, 0.3).lame().unwrap()));
        let own = BodyDescription::new("body", &mesh, soft(1e4, 0.3));
        let description = BodyDescription { model, evaluation, volume, axes, ..own };
        let body = simulation.add_body(&description).unwrap();
        simulation.set_state(body, &mirrored, &still).unwrap();
        simulation.evaluate();
        (simulation, body)
    };
    let forces = |(simulation, body): &mut (Simulation, BodyHandle), recovers| {
        simulation.world_mut().insert_resource(RecoveringBodies(vec![recovers]));
        simulation.set_state(*body, &mirrored, &still).unwrap();
        let energy = simulation.evaluate();
        (energy, simulation.elastic_forces(*body))
    };
    let each = VolumeRule::Elements;
    let corotational = forces(&mut body(Model::Corotational, Evaluation::Fused, each), false);
    let size = max_length(&corotational.1);
    for (model, evaluation, volume) in [
        (Model::StVK, Evaluation::Fused, each),
        (Model::StVK, Evaluation::Pooled, each),
        (Model::CompressibleStVK, Evaluation::Fused, each),
        (Model::CompressibleStVK, Evaluation::Pooled, each),
        (Model::QuadraticSprings, Evaluation::Fused, each),
        (Model::StVKFem, Evaluation::Fused, each),
        (Model::Linear, Evaluation::Fused, each),
        (Model::NeoHookean, Evaluation::Fused, each),
        (Model::NeoHookean, Evaluation::Fused, VolumeRule::Clusters),
        (Model::StVKVolume, Evaluation::Fused, VolumeRule::Clusters),
        (Model::Corotational, Evaluation::Fused, VolumeRule::Clusters),
        (Model::Linear, Evaluation::Fused, VolumeRule::Clusters),
        (Model::WarpedStiffness, Evaluation::Fused, each),
        (Model::MassSpring, Evaluation::Fused, each),
        (Model::Axes, Evaluation::Fused, each),
    ] {
        let name = format!("{model:?} {evaluation:?} {volume:?}");
        let mut body = body(model, evaluation, volume);
        let own = forces(&mut body, false);
        body.0.integrate_by(Integrator::Safe);
        body.0.step().unwrap();
        let without = matches!(model, Model::MassSpring | Model::Axes);
        assert_eq!(body.0.report().recovering, u32::from(!without), "{name}");
        if without {
            continue;
        }
        let recovering = forces(&mut body, true);
        assert!((recovering.0 / corotational.0 - 1.0).abs() < 1e-12, "{name}");
        assert!(max_distance(&recovering.1, &corotational.1) < 1e-12 * size, "{name}");
        assert_eq!(forces(&mut body, false), own, "{name}");
    }
}
