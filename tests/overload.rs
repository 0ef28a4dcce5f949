//! Recovery from inversion leaves bodies alone that loads crush, gives up where constraints keep a body out of
//! shape, begins again when they let go, and its books balance.

use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::generate::{box_hexahedra, box_tets};
use sinew::engine::step::StepError;
use sinew::models::body::{Evaluation, VolumeRule};
use sinew::prelude::*;

/// A bar under pressure all round, clamped at one end.
fn pressed(precision: Precision, pressure: f64) -> (Simulation, BodyHandle) {
    let mesh = jittered_box([0.2, 0.04, 0.04], [5, 2, 2]);
    let (mut simulation, body) = simulate(
        options(precision, 1),
        &mesh,
        soft(2e4, 0.4),
        Model::CompressibleStVK,
        Evaluation::Fused,
    );
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(0.01);
    clamp(&mut simulation, body, &mesh, "x0");
    let inward: Vec<_> = mesh.surface_triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    blow(&mut simulation, body, &inward, pressure, Curve::Constant);
    (simulation, body)
}

#[test]
fn crushed_bodies_keep_their_own_law() {
    for precision in [Precision::F64, Precision::F32] {
        for pressure in [1e5, 1e6] {
            let run = |recovery: bool| {
                let (mut simulation, body) = pressed(precision, pressure);
                simulation.set_solver(SolverSettings { recovery, ..Default::default() });
                let (mut refused, mut recovering) = (0, 0);
                for _ in 0..100 {
                    simulation.step().unwrap();
                    let report = simulation.report();
                    refused += report.recoveries_refused;
                    recovering += report.recovering;
                }
                assert!(!recovery || refused > 0, "not crushed");
                assert_eq!(recovering, 0);
                (simulation.report().elastic_energy, simulation.displacements(body))
            };
            let (with, without) = (run(true), run(false));
            assert!(with.0 < 1e3 && with.1 == without.1, "{precision:?} {pressure}: {} J", with.0);
        }
    }
}

/// A bar of one model clamped at an end under a pressure (in Young's moduli) all round: how it ended.
fn pressed_by(
    body: &BodyDescription,
    mesh: &Mesh,
    integrator: Integrator,
    part: f64,
) -> Result<f64, StepError> {
    let (mut simulation, handle) = alone(options(Precision::F64, 1), body);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(0.01);
    simulation.integrate_by(integrator);
    clamp(&mut simulation, handle, mesh, "x0");
    let surface = mesh.surface();
    let faces = (&surface.triangles[..], &surface.quads[..]);
    press_on(&mut simulation, handle, faces, part * body.material.young_modulus);
    let mut largest = 0.0_f64;
    for _ in 0..20 {
        simulation.step()?;
        let report = simulation.report();
        let energies = [report.elastic_energy, report.kinetic_energy, report.load_work];
        let ratios = simulation.volume_ratios(handle);
        let sizes = energies.map(|e| 1e-6 * e).into_iter().chain(ratios.iter().map(|j| 1e-3 * j));
        largest =
            sizes.fold(largest, |most, size| if size.abs() <= most { most } else { size.abs() });
    }
    Ok(largest)
}

/// Whatever the model, the kind of element and the direction of the pressure: a run either fails by name or ends with energies
/// below 1 MJ (its volume times Young.s modulus is 2.5 J) and volumes below a thousand times those at rest.
#[test]
fn no_body_is_blown_up_without_a_word() {
    let size = DVec3::new(0.1, 0.05, 0.05);
    let tetrahedra = box_tets(size, [4, 2, 2]).unwrap();
    let meshes = [
        box_tets(size, [2, 1, 1]).unwrap().with_second_order(),
        box_hexahedra(size, [4, 2, 2]).unwrap(),
        tetrahedra,
    ];
    let (mut runs, mut burst) = (0, 0);
    let mut check = |body: &BodyDescription, mesh: &Mesh, integrator, part: f64| {
        let what = || {
            let kind = (mesh.is_second_order(), mesh.hexahedra.len());
            format!("{:?} {:?} {kind:?} {integrator:?} {part} E", body.model, body.volume)
        };
        runs += 1;
        match pressed_by(body, mesh, integrator, part) {
            Ok(largest) => assert!(largest < 1.0, "{}: {largest:e}", what()),
            Err(StepError::Burst { name, body: of, growth, .. }) => {
                assert!(
                    name == "air" && of == "bar" && (growth > 100.0 || growth.is_nan()),
                    "{}",
                    what()
                );
                assert!(!body.model.holds_pressure(), "{} burst", what());
                burst += 1;
            }
            Err(error) => assert!(!error.to_string().is_empty(), "{}", what()),
        }
    };
    for mesh in &meshes {
        let body = BodyDescription::new("bar", mesh, soft(1e4, 0.45));
        for model in Model::ALL {
            let served = match (mesh.is_second_order(), mesh.hexahedra.is_empty()) {
                (true, _) => model.serves_tetrahedra10(),
                (_, false) => model.serves_hexahedra(),
                _ => true,
            };
            for volume in [VolumeRule::Elements, VolumeRule::Clusters] {
                if !served || (volume == VolumeRule::Clusters && !model.keeps_mean_volume()) {
                    continue;
                }
                let body = BodyDescription { model, volume, ..body.clone() };
                for part in [0.5, 1.0, 2.7, 3.0] {
                    check(&body, mesh, Integrator::Auto, part);
                    check(&body, mesh, Integrator::Auto, -part);
                }
            }
        }
        let body = BodyDescription { model: Model::Corotational, ..body };
        for integrator in [
            Integrator::Safe,
            Integrator::Newton,
            Integrator::TrBdf2,
            Integrator::LinearisedTrBdf2,
            Integrator::QuasiStatic,
            Integrator::SymplecticEuler,
        ] {
            check(&body, mesh, integrator, 2.7);
            check(&body, mesh, integrator, -2.7);
        }
    }
    assert!(burst > 10, "{burst} of {runs}");
}

/// Squeezed flat between its ends for good the bar cannot come into shape: it gets its own law back. Let go,
/// it recovers after all. What the laws change is booked, and nothing else is made or lost.
#[test]
fn a_body_held_out_of_shape_gets_its_own_law_back() {
    let mesh = jittered_box([0.2, 0.04, 0.04], [5, 2, 2]);
    let material = soft(2e4, 0.4);
    let one = options(Precision::F64, 1);
    let (mut simulation, body) = simulate(one, &mesh, material, Model::StVK, Evaluation::Fused);
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_dt(0.01);
    simulation.set_solver(SolverSettings { mass_damping: 7.0, ..Default::default() });
    let held = clamp(&mut simulation, body, &mesh, "x0");
    let rows = simulation.rows(body, "x1", &group(&mesh, "x1")).unwrap();
    let motion = Motion::Translate(DVec3::new(-0.198, 0.0, 0.0));
    let pushed = Constraint::moving("push", rows, motion, Curve::ramp(0.0, 0.3));
    let pushed = simulation.add_constraint(pushed);
    let (mut recovering, mut given_up, mut put_in, mut taken_out) = (0, 0, 0.0, 0.0);
    let (mut last, mut turnover) = (0.0, 0.0_f64);
    let mut step = |simulation: &mut Simulation| {
        simulation.step().unwrap();
        let r = simulation.report();
        recovering += r.recovering;
        given_up += r.recoveries_given_up;
        put_in += r.load_work + r.constraint_work + r.recovery_energy;
        turnover += r.constraint_work.abs() + r.recovery_energy.abs();
        taken_out += r.dissipation;
        last = r.elastic_energy + r.kinetic_energy;
        (recovering, given_up)
    };
    let (mut before, mut ends) = (0, (0, 0));
    for i in 0..400 {
        ends = step(&mut simulation);
        if i == 370 {
            before = ends.0;
        }
    }
    assert!(ends.0 > 0 && ends.1 > 0, "{ends:?}");
    assert_eq!(ends.0, before, "still in recovery");
    for entity in [held, pushed] {
        simulation.world_mut().despawn(entity);
    }
    for _ in 0..400 {
        step(&mut simulation);
    }
    assert!(simulation.volume_report().inverted == 0, "not let go");
    assert!((put_in - taken_out - last).abs() < 1e-9 * turnover, "{put_in} {taken_out} {last}");
}

/// A cube pressed to a part of its height between smooth walls counts as compressed far below 0.7, in models that soften there.
#[test]
fn far_compression_of_models_that_soften_is_counted() {
    let (size, cells) = (DVec3::splat(0.1), [2, 2, 2]);
    let tetrahedra = box_tets(size, cells).unwrap();
    for mesh in [tetrahedra.with_second_order(), tetrahedra, box_hexahedra(size, cells).unwrap()] {
        for model in [Model::CompressibleStVK, Model::StVK, Model::NeoHookean] {
            for (stretch, far) in [(0.75, false), (0.65, true)] {
                let body = BodyDescription::new("cube", &mesh, soft(1e4, 0.45));
                let (mut s, body) =
                    alone(SimulationOptions::default(), &BodyDescription { model, ..body });
                // turned, so that no coordinate is the one that is pressed
                let turn = glam::DQuat::from_rotation_y(0.6);
                let press = |x: &DVec3| turn * (DVec3::new(1.05, 1.0, stretch) * *x) - *x;
                let u: Vec<DVec3> = mesh.points.iter().map(press).collect();
                s.displace(body, &u);
                let all: Vec<u32> = (0..mesh.points.len() as u32).collect();
                let rows = s.rows(body, "all", &all).unwrap();
                s.add_constraint(Constraint::hold("all", rows));
                s.step().unwrap();
                let elements = mesh.tetrahedra.len() + mesh.hexahedra.len();
                let expected = if far && model.softens() { elements as u64 } else { 0 };
                assert_eq!(s.compressed_elements(), expected, "{model:?} {stretch}");
            }
        }
    }
}
