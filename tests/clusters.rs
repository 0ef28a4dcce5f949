//! Volume by clusters: what holds whatever the mesh, at nu = 0.4999.

use crate::common::{Shortcuts, alone, assert_fresh, clamp, drive, jittered_box, max_distance};
use crate::common::{max_length, options, refused, region, solver};
use glam::DVec3;
use sinew::engine::connectivity::ElementKind;
use sinew::engine::element::{TetrahedronIndex, TetrahedronVertices};
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::models::body::VolumeRule;
use sinew::models::frame::moduli::ClusterIndex;
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;
use std::collections::BTreeMap;

/// Volume terms in J.
const MODELS: [Model; 2] = [Model::NeoHookean, Model::StVKVolume];
/// And in the trace of a strain, which is the change of volume at small strain.
const ALL: [Model; 4] = [Model::NeoHookean, Model::StVKVolume, Model::Corotational, Model::Linear];

fn body(mesh: &Mesh, model: Model, volume: VolumeRule, nu: f64) -> BodyDescription<'_> {
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: nu, density: 1000.0 };
    BodyDescription { model, volume, ..BodyDescription::new("body", mesh, material) }
}

fn clustered(mesh: &Mesh, model: Model, nu: f64) -> BodyDescription<'_> {
    body(mesh, model, VolumeRule::Clusters, nu)
}

/// Length, width and height (m) of a soft bar.
const BAR: [f64; 3] = [0.12, 0.03, 0.03];

/// A swinging bar keeps its energy bound, and its clusters their volume.
#[test]
fn energy_never_rises_in_a_free_swing() {
    let mesh = jittered_box(BAR, [8, 2, 2]);
    for model in ALL {
        for precision in [Precision::F64, Precision::F32] {
            let (mut simulation, own) =
                alone(options(precision, 1), &clustered(&mesh, model, 0.4999));
            clamp(&mut simulation, own, &mesh, "x0");
            simulation.integrate_by(Integrator::Safe);
            simulation.set_dt(0.01);
            let mut energy = 0.0;
            let (mut scale, mut largest) = (0.0_f64, 0.0_f64);
            for _ in 0..100 {
                simulation.step().unwrap();
                let report = simulation.report();
                let now = report.elastic_energy + report.kinetic_energy;
                scale = scale.max(now);
                energy += report.load_work + report.constraint_work;
                let rounding = if precision == Precision::F64 { 1e-9 } else { 1e-5 };
                assert!(now <= energy + rounding * scale, "{model:?} {precision:?} {now} {energy}");
                energy = now;
                largest = largest.max(simulation.volume_report().largest_mean_change);
                assert_eq!(simulation.volume_report().inverted, 0, "{model:?} {precision:?}");
            }
            let far = max_length(&simulation.displacements(own));
            assert!(far > 5e-3, "{far}");
            assert!(largest > 0.0 && largest < 0.01, "{model:?} {precision:?} {largest}");
        }
    }
}

/// Volume of a deformed body (m^3).
fn volume(mesh: &Mesh, u: &[DVec3]) -> f64 {
    let at = |v: u32| mesh.points[v as usize] + u.get(v as usize).copied().unwrap_or(DVec3::ZERO);
    let of = |t: &[u32; 4]| {
        let [a, b, c, d] = t.map(at);
        (b - a).cross(c - a).dot(d - a) / 6.0
    };
    mesh.tetrahedra.iter().map(of).sum()
}

/// A cube between bonded plates comes to half its height without an inverted element and with its volume.
#[test]
fn a_crushed_cube_keeps_its_volume() {
    let size = 0.05;
    let mesh = box_tets(DVec3::splat(size), [5, 5, 5]).unwrap();
    for model in MODELS {
        let (mut simulation, own) =
            alone(SimulationOptions::default(), &clustered(&mesh, model, 0.4999));
        clamp(&mut simulation, own, &mesh, "z0");
        let down = Motion::Translate(-0.5 * size * DVec3::Z);
        drive(&mut simulation, own, &mesh, "z1", down, Curve::ramp(0.0, 1.0));
        simulation.set_solver(solver!(Integrator::Newton, mass_damping = 2.0));
        simulation.set_dt(0.02);
        simulation.steps(60);
        simulation.settle();
        let u = simulation.displacements(own);
        let change = volume(&mesh, &u) / volume(&mesh, &[]) - 1.0;
        assert!(change.abs() < 1e-3, "{model:?}: {change}");
        assert_eq!(simulation.volume_report().inverted, 0, "{model:?}");
        assert!(simulation.volume_report().smallest_ratio > 0.2, "{model:?}");
    }
}

/// Loads far beyond the material ask for steps that no bend makes true; the body has to move all the same.
#[test]
fn overloaded_bodies_move() {
    let mesh = box_tets(BAR.into(), [8, 2, 2]).unwrap();
    for model in MODELS {
        for gravity in [1e5, 1e6] {
            let (mut simulation, own) =
                alone(SimulationOptions::default(), &clustered(&mesh, model, 0.4));
            clamp(&mut simulation, own, &mesh, "x0");
            simulation.set_gravity(-gravity * DVec3::Z);
            simulation.integrate_by(Integrator::Safe);
            simulation.set_dt(0.01);
            for _ in 0..20 {
                simulation.step().unwrap();
                // halted bodies stay where they are
                let far = max_length(&simulation.displacements(own));
                assert!(far > 1e-3 && far.is_finite(), "{model:?} {gravity:e} {far}");
            }
        }
    }
}

/// The complete factor adds up what iterations never do.
#[test]
fn every_preconditioner_and_the_complete_factor_agree() {
    let mesh = jittered_box(BAR, [6, 2, 2]);
    for model in ALL {
        let run = |preconditioner| {
            let (mut simulation, own) =
                alone(SimulationOptions::default(), &clustered(&mesh, model, 0.4999));
            clamp(&mut simulation, own, &mesh, "x0");
            simulation.set_solver(solver!(
                Integrator::Newton,
                linear_tolerance = 1e-12,
                preconditioner
            ));
            simulation.set_dt(0.01);
            simulation.steps(10);
            simulation.displacements(own)
        };
        let mut kinds = vec![Preconditioner::IncompleteCholesky, Preconditioner::Multigrid];
        kinds.extend(cfg!(feature = "direct").then_some(Preconditioner::Direct));
        let first = run(Preconditioner::BlockJacobi);
        for preconditioner in kinds {
            let error = max_distance(&first, &run(preconditioner)) / max_length(&first);
            assert!(error < 1e-8, "{model:?} {preconditioner:?}: {error:e}");
        }
    }
}

/// Linear iterations do not know how close to incompressible a body is, and are about those of plain elements that are not.
#[test]
fn iterations_do_not_depend_on_the_poisson_ratio() {
    let mesh = jittered_box(BAR, [16, 4, 4]);
    let run = |volume, nu| {
        let (mut simulation, own) =
            alone(SimulationOptions::default(), &body(&mesh, Model::NeoHookean, volume, nu));
        clamp(&mut simulation, own, &mesh, "x0");
        simulation.set_solver(solver!(
            Integrator::Safe,
            linear_tolerance = 1e-3,
            preconditioner = Preconditioner::Multigrid
        ));
        simulation.set_dt(0.01);
        let mut iterations = 0;
        for _ in 0..30 {
            simulation.step().unwrap();
            iterations += simulation.report().cg_iterations;
        }
        f64::from(iterations) / 30.0
    };
    let [plain, locked] = [0.45, 0.4999].map(|nu| run(VolumeRule::Elements, nu));
    let [less, more] = [0.49, 0.4999].map(|nu| run(VolumeRule::Clusters, nu));
    assert!((less - more).abs() <= 2.0, "{less} {more}");
    assert!(more <= 1.25 * plain && more < 0.2 * locked, "{plain} {locked} {more}");
}

/// Whatever is cut away, every cluster hangs together by faces.
#[test]
fn no_cluster_falls_into_pieces() {
    let mesh = jittered_box(BAR, [8, 3, 3]);
    let (mut simulation, own) =
        alone(SimulationOptions::default(), &clustered(&mesh, Model::NeoHookean, 0.4999));
    let check = |simulation: &mut Simulation| -> usize {
        let left = simulation.remaining_tetrahedra(own);
        let world = simulation.world_mut();
        let mut elements: BTreeMap<u32, Vec<[u32; 4]>> = BTreeMap::new();
        let mut rows = world.query::<(&TetrahedronIndex, &TetrahedronVertices, &ClusterIndex)>();
        for (index, nodes, cluster) in rows.iter(world) {
            if left.contains(&index.0) {
                elements.entry(cluster.0).or_default().push(nodes.0);
            }
        }
        for own in elements.values() {
            let shared =
                |a: &[u32; 4], b: &[u32; 4]| a.iter().filter(|v| b.contains(v)).count() == 3;
            let mut seen = vec![false; own.len()];
            let mut next = vec![0];
            while let Some(a) = next.pop() {
                if !std::mem::replace(&mut seen[a], true) {
                    next.extend((0..own.len()).filter(|&b| shared(&own[a], &own[b])));
                }
            }
            assert!(seen.iter().all(|seen| *seen), "{own:?}");
        }
        elements.len()
    };
    let before = check(&mut simulation);
    let mut most = before;
    for round in 0..60 {
        let chosen = crate::common::pick(
            simulation.remaining_tetrahedra(own),
            1 + 3 * (round % 3),
            round as u64,
        );
        let region = Region::Tetrahedra(chosen);
        simulation.remove(own, region);
        most = most.max(check(&mut simulation));
    }
    assert!(most > before, "nothing was split: {before} clusters");
}

/// Single hexahedra and ten-node tetrahedra keep means, too: what is cut away leaves a body that moves on, and is that which
/// would be built of the rest.
#[test]
#[ignore = "slow"]
fn means_of_single_elements_outlive_cuts() {
    let size = DVec3::from_array(BAR);
    let tens = jittered_box(BAR, [6, 2, 2]).with_second_order();
    let hexahedra = box_hexahedra(size, [8, 3, 3]).unwrap();
    for (mesh, model) in [&tens, &hexahedra].into_iter().flat_map(|m| ALL.map(|o| (m, o))) {
        if mesh.is_second_order() && !model.serves_tetrahedra10() {
            continue;
        }
        let (mut simulation, own) =
            alone(options(Precision::F64, 1), &clustered(mesh, model, 0.4999));
        clamp(&mut simulation, own, mesh, "x0");
        simulation.integrate_by(Integrator::Safe);
        simulation.set_dt(0.01);
        simulation.steps(5);
        for round in 0..8 {
            let kind = match mesh.hexahedra.is_empty() {
                true => ElementKind::Tetrahedron,
                false => ElementKind::Hexahedron,
            };
            let chosen = crate::common::pick(simulation.remaining(own, kind), 2, round);
            simulation.remove(own, region(kind, chosen));
            simulation.step().unwrap();
            assert_fresh(&mut simulation, own, 1e-12, &format!("{model:?} {round}"));
            let change = simulation.volume_report().largest_mean_change;
            assert!(change > 0.0 && change.is_finite(), "{model:?} {round}: {change}");
            // a trace is a change of volume at small strain only, and single steps may leave some of it
            let bounded = MODELS.contains(&model);
            assert!(!bounded || change < 0.01, "{model:?} {round}: {change}");
        }
    }
}

/// One thread or two, and twice the same: the same bits.
#[test]
fn threads_do_not_matter() {
    let mesh = jittered_box(BAR, [12, 4, 4]);
    let run = |precision, threads| {
        let (mut simulation, own) =
            alone(options(precision, threads), &clustered(&mesh, Model::NeoHookean, 0.4999));
        clamp(&mut simulation, own, &mesh, "x0");
        simulation.set_dt(0.01);
        simulation.steps(15);
        simulation.state_hash()
    };
    for precision in [Precision::F64, Precision::F32] {
        let one = run(precision, 1);
        assert_eq!(one, run(precision, 2));
        assert_eq!(one, run(precision, 2));
    }
}

/// What clusters cannot serve is refused by name.
#[test]
fn what_clusters_cannot_serve_is_refused() {
    let mesh = jittered_box(BAR, [4, 1, 1]);
    for model in [Model::StVK, Model::CompressibleStVK, Model::WarpedStiffness, Model::MassSpring] {
        let error = refused(&clustered(&mesh, model, 0.4));
        assert!(error.contains("neo_hookean") && error.contains("body"), "{error}");
    }
    let few = [0, 1];
    let own =
        BodyDescription { clusters: Some(&few), ..clustered(&mesh, Model::NeoHookean, 0.4999) };
    let error = refused(&own);
    assert!(error.contains("cluster"), "{error}");
}
