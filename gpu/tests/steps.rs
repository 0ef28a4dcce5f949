//! The safe step on the device against that of the processor in `f64`.

use crate::common::shared::{Shortcuts, guide};
use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_hexahedra;
use sinew::engine::report::StepReport;
use sinew::models::body::{Evaluation, Integration, VolumeRule};
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::solvers::settings::Preconditioner;
use sinew_gpu::{GpuOptions, GpuReport};

/// A beam of soft tissue in a scene on the processor and on the device; `None` without an adapter.
fn both(
    mesh: &Mesh,
    steps: usize,
    settings: &SolverSettings,
    scene: impl Fn(&mut Simulation, BodyHandle),
) -> Option<[Run; 2]> {
    run_both(&BodyDescription::new("beam", mesh, MATERIAL), steps, settings, scene)
}

#[test]
fn beam_that_falls_and_swings() {
    let mesh = beam([10, 3, 3]);
    for (mass_damping, stiffness_damping) in [(0.0, 0.0), (1.0, 0.002)] {
        let settings = SolverSettings { mass_damping, stiffness_damping, ..settings() };
        let scene = |s: &mut Simulation, body: BodyHandle| hold(s, body, &mesh, "x0");
        let Some(runs) = both(&mesh, 20, &settings, scene) else { return };
        end_alike(&runs, &format!("swing, damping {stiffness_damping}"));
        books_agree(&runs);
        let [cpu, gpu] = runs;
        for (a, b) in gpu.reports.iter().zip(&cpu.reports) {
            let momentum = DVec3::from(b.momentum).length().max(1e-6);
            for k in 0..3 {
                close(a.momentum[k], b.momentum[k], momentum, 1e-2, "momentum");
            }
        }
        let device = gpu.simulation.world().resource::<GpuReport>();
        assert!(device.bytes_down > 0 && device.submissions > 0 && device.uploads == 0);
        let last = gpu.reports.last().unwrap();
        assert!(last.cg_iterations > 5 && last.cg_residual < 2e-5, "{last:?}");
    }
}

/// A body and its elements, for what does not depend on them.
fn kinds(beam: &Mesh, bricks: &Mesh, mixed: &Mesh, run: impl Fn(&str, BodyDescription<'_>, &Mesh)) {
    let of = |mesh, model, evaluation| BodyDescription {
        model,
        evaluation,
        ..BodyDescription::new("beam", mesh, MATERIAL)
    };
    let (comp, svk) = (Model::CompressibleStVK, Model::StVK);
    run("pooled", of(beam, comp, Evaluation::Pooled), beam);
    run("pooled without compression", of(beam, svk, Evaluation::Pooled), beam);
    run("hexahedra", of(bricks, comp, Evaluation::Fused), bricks);
    run("neo-Hookean hexahedra", of(bricks, Model::NeoHookean, Evaluation::Fused), bricks);
    run("hexahedra beside pooled tetrahedra", of(mixed, comp, Evaluation::Pooled), mixed);
}

#[test]
fn bodies_of_other_elements_swing() {
    let cells = [8, 3, 3];
    let settings = SolverSettings { stiffness_damping: 0.002, ..settings() };
    kinds(&beam(cells), &bricks(cells), &half_bricks(cells), |name, description, mesh| {
        let scene = |s: &mut Simulation, body: BodyHandle| hold(s, body, mesh, "x0");
        let Some(runs) = run_both(&description, 15, &settings, scene) else { return };
        end_alike(&runs, &format!("{name} swing"));
        books_agree(&runs);
        let [cpu, gpu] = runs;
        let [a, b] = [&gpu, &cpu].map(|run| run.simulation.volume_report().clone());
        close(a.smallest_ratio, b.smallest_ratio, 1.0, 1e-4, "smallest volume ratio");
        assert_eq!(a.elements_by_body, b.elements_by_body);
    });
}

#[test]
fn bodies_of_other_elements_recover() {
    let cells = [4, 2, 2];
    let settings = SolverSettings { mass_damping: 5.0, linear_tolerance: 1e-4, ..settings() };
    kinds(&beam(cells), &bricks(cells), &half_bricks(cells), |name, description, mesh| {
        let scene = |s: &mut Simulation, body: BodyHandle| scramble(s, body, mesh);
        let Some([cpu, gpu]) = run_both(&description, 120, &settings, scene) else { return };
        let [first, other] = [&gpu, &cpu].map(|run| run.reports[0].recovery_energy);
        say(&format!("{name}: energy of recovery {first:.4} and {other:.4} J"));
        close(first, other, other.abs(), 1e-4, "energy of recovery");
        // the first step is that of the corotational energy on both
        close(
            gpu.reports[0].elastic_energy,
            cpu.reports[0].elastic_energy,
            other.abs(),
            1e-3,
            "energy",
        );
        for run in [&cpu, &gpu] {
            let last = run.reports.last().unwrap();
            assert_eq!(run.reports[0].recovering, 1);
            assert_eq!(
                (last.recovering, run.simulation.volume_report().inverted),
                (0, 0),
                "{name}"
            );
        }
    });
}

#[test]
fn bodies_of_other_elements_are_cut_and_stiffened() {
    let cells = [8, 3, 4];
    kinds(&beam(cells), &bricks(cells), &half_bricks(cells), |name, description, mesh| {
        let scene = |s: &mut Simulation, body: BodyHandle| {
            hold(s, body, mesh, "x0");
            s.steps(3);
            let notch = Region::Sphere { centre: DVec3::new(0.1, 0.025, 0.05), radius: 0.028 };
            let removed = s.remove(body, notch);
            assert!(removed.tetrahedra.len() + removed.hexahedra.len() > 2, "{name}: {removed:?}");
            s.steps(3);
            let stiffer = YoungPoisson { young_modulus: 3e4, ..MATERIAL };
            s.set_material(body, stiffer).unwrap();
        };
        let Some([cpu, gpu]) = run_both(&description, 5, &settings(), scene) else { return };
        let u = relative(&gpu.u, &cpu.u);
        say(&format!("{name} notched and stiffened: displacement {u:.1e}"));
        assert!(u < 1e-4, "{name}: {u:.1e}");
    });
}

#[test]
fn explicit_substeps_of_other_elements() {
    let cells = [6, 3, 3];
    let settings = SolverSettings {
        integrator: Integrator::StormerVerlet,
        mass_damping: 1.0,
        explicit_safety: 0.8,
        ..settings()
    };
    kinds(&beam(cells), &bricks(cells), &half_bricks(cells), |name, description, mesh| {
        let scene = |s: &mut Simulation, body: BodyHandle| hold(s, body, mesh, "x0");
        let Some(runs) = run_both(&description, 5, &settings, scene) else { return };
        end_alike(&runs, &format!("{name} explicit"));
    });
}

#[test]
fn prescribed_motion_turns_and_pulls() {
    let mesh = beam([10, 3, 3]);
    let scene = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        let rows = s.group_rows(body, &mesh, "x1").unwrap();
        let motion =
            Motion::Rotate { centre: DVec3::new(0.2, 0.025, 0.025), axis: DVec3::X, angle: 1.0 };
        s.add_constraint(Constraint::moving("turn", rows, motion, Curve::ramp(0.0, 0.2)));
    };
    let Some(runs) = both(&mesh, 20, &settings(), scene) else { return };
    end_alike(&runs, "twist");
    let [cpu, gpu] = runs.map(|run| run.sum(|r| r.constraint_work));
    close(gpu, cpu, f64::abs(cpu), 1e-3, "work of the constraints");
}

#[test]
fn free_body_keeps_momentum_and_partly_held_axes_hold() {
    let mesh = beam([6, 3, 3]);
    let free = |s: &mut Simulation, body: BodyHandle| {
        s.set_gravity(DVec3::ZERO);
        let v = mesh.points.iter().map(|x| DVec3::new(0.1, 0.0, 2.0 * x.x)).collect::<Vec<_>>();
        s.set_state(body, &vec![DVec3::ZERO; v.len()], &v).unwrap();
    };
    let loose = SolverSettings { linear_tolerance: 1e-2, ..settings() };
    let Some([cpu, gpu]) = both(&mesh, 20, &loose, free) else { return };
    let before = DVec3::from(cpu.reports[0].momentum);
    let after = DVec3::from(gpu.reports[19].momentum);
    assert!((before - after).length() < 1e-5 * before.length(), "{before} {after}");

    let slide = |s: &mut Simulation, body: BodyHandle| {
        guide(s, body, &mesh, "z0", 4);
        let mut end = mesh.surface();
        end.triangles.retain(|t| t.iter().all(|&v| mesh.points[v as usize].x > 0.2 - 1e-9));
        let pull = DVec3::new(64.0, 25.6, 0.0);
        let faces = s.traction_faces(body, "pull", &end, pull).unwrap();
        assert!(!faces.is_empty());
        s.add_loaded_faces("pull", faces, Curve::ramp(0.0, 0.1));
    };
    let Some([cpu, gpu]) = both(&mesh, 20, &settings(), slide) else { return };
    let u = relative(&gpu.u, &cpu.u);
    say(&format!("slide: displacement {u:.1e}"));
    assert!(u < 1e-3, "{u:.1e}");
    for (u, x) in gpu.u.iter().zip(&mesh.points).filter(|(_, x)| x.z == 0.0) {
        assert_eq!(u.z, 0.0, "{x}");
    }
}

#[test]
fn squeezed_body_needs_the_projected_tangent_and_never_gains_energy() {
    let mesh = beam([8, 3, 3]);
    let scene = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        let u = mesh.points.iter().enumerate().map(|(i, x)| {
            DVec3::new(-0.35 * x.x, 0.1 * x.y, 0.1 * x.z) + 1e-3 * (x.x / 0.2) * noise(i)
        });
        let u = u.collect::<Vec<_>>();
        s.displace(body, &u);
        s.set_gravity(DVec3::ZERO);
    };
    let settings = SolverSettings { recovery: false, ..settings() };
    let Some([cpu, gpu]) = both(&mesh, 30, &settings, scene) else { return };
    let projections = [&cpu, &gpu].map(|run| run.sum::<u32>(|r| r.projections));
    say(&format!("squeezed: projections {projections:?}"));
    assert!(projections.iter().all(|&count| count > 0));
    let mut energy = f64::INFINITY;
    for r in &gpu.reports {
        let now = r.elastic_energy + r.kinetic_energy;
        assert!(now <= energy * (1.0 + 1e-4), "{now} after {energy}");
        energy = now;
    }
    // chaotic on the way, the same in the end: at rest
    assert!(energy < 0.2 * gpu.reports[0].elastic_energy);
}

#[test]
fn indefinite_tangent_without_inverted_elements() {
    let mesh = beam([8, 3, 3]);
    let scene = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        let u = mesh.points.iter().map(|x| DVec3::new(-0.4 * x.x, 0.02 * x.y, 0.02 * x.z));
        let u = u.collect::<Vec<_>>();
        s.displace(body, &u);
        s.set_gravity(DVec3::ZERO);
        s.set_dt(0.05);
    };
    let Some([cpu, gpu]) = both(&mesh, 1, &settings(), scene) else { return };
    let u = relative(&gpu.u, &cpu.u);
    say(&format!("compressed: displacement {u:.1e} after the step of the projected tangent"));
    assert_eq!((cpu.reports[0].projections, gpu.reports[0].projections), (1, 1));
    assert!(u < 1e-3, "{u:.1e}");
}

#[test]
fn scrambled_body_recovers() {
    let mesh = beam([6, 3, 3]);
    let scene = |s: &mut Simulation, body: BodyHandle| scramble(s, body, &mesh);
    let settings = SolverSettings { mass_damping: 5.0, linear_tolerance: 1e-4, ..settings() };
    let Some([cpu, gpu]) = both(&mesh, 120, &settings, scene) else { return };
    for run in [&cpu, &gpu] {
        let last = run.reports.last().unwrap();
        assert!(run.reports[0].recovering == 1 && run.reports[0].recovery_energy != 0.0);
        assert_eq!((last.recovering, run.simulation.volume_report().inverted), (0, 0));
    }
    let energies = [&cpu, &gpu].map(|run| run.reports[0].recovery_energy);
    close(energies[1], energies[0], energies[0].abs(), 1e-4, "energy of recovery");
}

#[test]
fn removed_elements_and_a_new_material_reach_the_device() {
    let mesh = beam([8, 3, 3]);
    let Some(both) = simulations(&GpuOptions::default()) else { return };
    let [cpu, gpu] = both.map(|mut simulation| {
        let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
        simulation.set_solver(settings());
        hold(&mut simulation, body, &mesh, "x0");
        simulation.steps(5);
        // what hangs on one vertex falls off
        cut_notch(&mut simulation, body, &mesh);
        simulation.steps(5);
        let stiffer = YoungPoisson { young_modulus: 3e4, ..MATERIAL };
        simulation.set_material(body, stiffer).unwrap();
        simulation.step().unwrap();
        let uploads = simulation.world().get_resource::<GpuReport>().map(|r| r.uploads);
        simulation.steps(5);
        (simulation.displacements(body), uploads)
    });
    let u = relative(&gpu.0, &cpu.0);
    say(&format!("notched and stiffened: displacement {u:.1e}"));
    assert!(u < 1e-4, "{u:.1e}");
    // a new material is new constants
    assert_eq!((cpu.1, gpu.1), (None, Some(0)));
}

#[test]
fn several_bodies_step_by_themselves() {
    let mesh = beam([6, 3, 3]);
    let Some(both) = simulations(&GpuOptions::default()) else { return };
    let [cpu, gpu] = both.map(|mut simulation| {
        simulation.set_solver(settings());
        let models = [Model::CompressibleStVK, Model::Corotational, Model::MassSpring];
        let bodies = models.map(|model| {
            let description =
                BodyDescription { model, ..BodyDescription::new(model.name(), &mesh, MATERIAL) };
            let body = simulation.add_body(&description).unwrap();
            hold(&mut simulation, body, &mesh, "x0");
            body
        });
        simulation.steps(10);
        bodies.map(|body| simulation.displacements(body))
    });
    for (a, b) in gpu.iter().zip(&cpu) {
        let u = relative(a, b);
        say(&format!("one of three bodies: displacement {u:.1e}"));
        assert!(u < 1e-4, "{u:.1e}");
    }
    assert!(relative(&gpu[0], &gpu[1]) > 1e-3, "different models move differently");
}

#[test]
fn steps_repeat_bit_for_bit() {
    let mesh = beam([6, 3, 3]);
    let hashes = [None, Some(64 << 10)].map(|binding_limit| {
        let mut simulation = on_device(&GpuOptions { binding_limit, ..GpuOptions::default() })?;
        let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
        simulation.set_solver(settings());
        hold(&mut simulation, body, &mesh, "x0");
        let start: Vec<_> = mesh.points.iter().map(|x| DVec3::new(0.0, 0.0, -3.0 * x.x)).collect();
        let run = |simulation: &mut Simulation| {
            simulation.set_state(body, &vec![DVec3::ZERO; start.len()], &start).unwrap();
            simulation.steps(5);
            simulation.state_hash()
        };
        Some([run(&mut simulation), run(&mut simulation)])
    });
    for [first, second] in hashes.iter().flatten() {
        assert_eq!(first, second);
    }
}

#[test]
fn explicit_substeps() {
    let mesh = beam([8, 3, 3]);
    let still = |s: &mut Simulation, body: BodyHandle| hold(s, body, &mesh, "x0");
    // loads and held vertices that vary within a step
    let driven = |s: &mut Simulation, body: BodyHandle| {
        hold(s, body, &mesh, "x0");
        let rows = s.group_rows(body, &mesh, "x1").unwrap();
        let motion = Motion::Translate(DVec3::new(0.01, 0.0, 0.005));
        let curve = Curve::Sine { frequency: 4.0, phase: 0.0 };
        s.add_constraint(Constraint::moving("shake", rows, motion, curve));
        let rows = s.group_rows(body, &mesh, "z1").unwrap();
        let forces = rows.iter().map(|&row| (row, DVec3::new(0.0, 0.002, 0.0))).collect();
        s.add_load(Load { name: "push".into(), forces, curve: Curve::ramp(0.0, 0.05) });
    };
    for integrator in [Integrator::StormerVerlet, Integrator::SymplecticEuler] {
        // far enough from a whole number of substeps that both estimates of the limit ask for as many
        let settings =
            SolverSettings { integrator, mass_damping: 1.0, explicit_safety: 0.8, ..settings() };
        let scenes: [&dyn Fn(&mut Simulation, BodyHandle); 2] = [&still, &driven];
        for (name, scene) in ["falls", "driven"].into_iter().zip(scenes) {
            let Some(runs) = both(&mesh, 10, &settings, scene) else { return };
            let counts = runs.each_ref().map(|run| run.reports.iter().map(|r| r.substeps));
            let [of_cpu, of_gpu] = counts.map(|counts| counts.collect::<Vec<_>>());
            assert_eq!(of_gpu, of_cpu, "{name}");
            end_alike(&runs, &format!("{integrator:?} {name}, {of_gpu:?} substeps"));
            let [cpu, gpu] = runs;
            let a = gpu.reports.last().unwrap();
            let scale = a.elastic_energy + a.kinetic_energy;
            let books: [fn(&StepReport) -> f64; 4] = [
                |r| r.load_work,
                |r| r.constraint_work,
                |r| r.dissipation,
                |r| r.damping_dissipation,
            ];
            for pick in books {
                close(gpu.sum(pick), cpu.sum(pick), scale, 2e-3, "books");
            }
        }
    }
}

#[test]
fn what_has_no_twin_is_refused_by_name() {
    let mesh = beam([3, 2, 2]);
    let Some(mut simulation) = on_device(&GpuOptions::default()) else { return };
    simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
    simulation
        .set_solver(SolverSettings { integrator: Integrator::TrBdf2, ..SolverSettings::default() });
    let error = simulation.step().unwrap_err().to_string();
    for word in ["gpu", "tr-bdf2", "\"safe\"", "\"cpu\""] {
        assert!(error.contains(word), "{error}");
    }
    simulation.set_solver(SolverSettings {
        preconditioner: Preconditioner::IncompleteCholesky,
        ..settings()
    });
    assert!(simulation.step().unwrap_err().to_string().contains("incomplete-cholesky"));
    simulation.set_solver(settings());
    simulation.step().unwrap();
    let volume = VolumeRule::Clusters;
    let (bricks, curved) =
        (box_hexahedra(DVec3::splat(0.1), [2, 2, 2]).unwrap(), mesh.with_second_order());
    let (each, full, reduced) = (VolumeRule::Elements, Integration::Full, Integration::Reduced);
    for (mesh, volume, integration, words) in [
        (&mesh, volume, full, "`tissue`: the law \"volume kept by clusters\""),
        (&bricks, volume, full, "`tissue`: the law \"volume kept by clusters\""),
        (&bricks, each, reduced, "neo-Hookean hexahedra, reduced integration"),
        (&curved, each, full, "ten-node"),
    ] {
        let Some(mut simulation) = on_device(&GpuOptions::default()) else { return };
        let of = BodyDescription::new("tissue", mesh, MATERIAL);
        let of = BodyDescription { model: Model::NeoHookean, volume, integration, ..of };
        simulation.add_body(&of).unwrap();
        simulation.set_solver(settings());
        let error = simulation.step().unwrap_err().to_string();
        for word in [words, "no twin", "\"cpu\""] {
            assert!(error.contains(word), "{error}");
        }
    }
}

#[test]
fn a_body_beyond_the_limits_of_the_adapter_is_refused_with_a_remedy() {
    let mesh = beam([10, 4, 5]);
    let options = GpuOptions { binding_limit: Some(16 << 10), ..GpuOptions::default() };
    let Some(mut simulation) = on_device(&options) else { return };
    let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
    simulation.set_solver(settings());
    let error = simulation.step().unwrap_err().to_string();
    for word in ["bytes in one binding", "16384", "coarser mesh", "\"cpu\""] {
        assert!(error.contains(word), "{error}");
    }
    // nothing has happened
    assert_eq!(simulation.time(), 0.0);
    assert!(simulation.displacements(body).iter().all(|u| *u == DVec3::ZERO));
}
