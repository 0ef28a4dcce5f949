//! The two-level preconditioner on the device: iterations against the processor's, and bodies that are not one whole.

use crate::common::{MATERIAL, beam, guide, hold, on_device, relative, say, simulations};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::report::StepReport;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use sinew::simulation::Backend;
use sinew::solvers::settings::Preconditioner;
use sinew_gpu::GpuOptions;

fn settings(preconditioner: Preconditioner, linear_tolerance: f64) -> SolverSettings {
    let integrator = Integrator::Safe;
    SolverSettings { integrator, preconditioner, linear_tolerance, ..SolverSettings::default() }
}

fn steps(simulation: &mut Simulation, count: usize) -> Vec<StepReport> {
    let step = |_| {
        simulation.step().unwrap();
        simulation.report().clone()
    };
    (0..count).map(step).collect()
}

fn iterations(reports: &[StepReport]) -> u32 {
    reports.iter().map(|r| r.cg_iterations).sum()
}

#[test]
fn iterations_are_near_those_of_the_processor() {
    let mesh = beam([24, 6, 6]);
    let mut counts = Vec::new();
    let mut displacements = Vec::new();
    for kind in [Preconditioner::Auto, Preconditioner::BlockJacobi] {
        let Some(both) = simulations(&GpuOptions::default()) else { return };
        for mut simulation in both {
            let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
            simulation.set_solver(settings(kind, 1e-3));
            hold(&mut simulation, body, &mesh, "x0");
            let reports = steps(&mut simulation, 4);
            let two = kind == Preconditioner::Auto;
            assert_eq!(reports[3].preconditioner, if two { "multigrid" } else { "block-jacobi" });
            counts.push(iterations(&reports));
            if simulation.backend() == Backend::Gpu {
                // computed once, kept after that; inverse blocks come with the matrix
                let refreshes = reports.iter().map(|r| r.preconditioner_refreshes);
                assert_eq!(refreshes.sum::<u32>(), u32::from(two));
            }
            assert!(reports.iter().all(|r| r.preconditioner_breakdowns == 0));
            assert!(reports.iter().all(|r| r.cg_residual < 1.2e-3), "{reports:?}");
            displacements.push(simulation.displacements(body));
        }
    }
    let [cpu, gpu, cpu_jacobi, gpu_jacobi] = counts[..] else { unreachable!() };
    say(&format!(
        "4 steps of 5184 tetrahedra, iterations: CPU {cpu}, device {gpu}; block Jacobi {cpu_jacobi} and \
         {gpu_jacobi}"
    ));
    assert!(10 * gpu <= 13 * cpu, "{counts:?}");
    assert!(3 * gpu < gpu_jacobi, "{counts:?}");
    for u in &displacements {
        assert!(relative(u, &displacements[0]) < 2e-3);
    }
}

/// Two boxes in one mesh that do not touch.
fn two_boxes() -> Mesh {
    let mut mesh = box_tets(DVec3::new(0.1, 0.05, 0.05), [4, 3, 3]).unwrap();
    let second = box_tets(DVec3::new(0.05, 0.05, 0.02), [2, 2, 1]).unwrap();
    let first = mesh.points.len() as u32;
    mesh.points.extend(second.points.iter().map(|x| *x + DVec3::new(0.2, 0.0, 0.0)));
    mesh.tetrahedra.extend(second.tetrahedra.iter().map(|t| t.map(|v| v + first)));
    mesh
}

#[test]
fn pieces_held_axes_and_bodies_below_an_aggregate() {
    let one_cell = box_tets(DVec3::splat(0.02), [1, 1, 1]).unwrap();
    let mesh = beam([10, 3, 3]);
    let pieces = two_boxes();
    let still = |_: &mut Simulation, _: BodyHandle, _: &Mesh| {};
    let clamped = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh| hold(s, body, mesh, "x0");
    // on a floor, and one end along y: unknowns of an aggregate that only some axes resist
    let partly = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh| {
        guide(s, body, mesh, "z0", 4);
        guide(s, body, mesh, "x0", 2);
    };
    // every vertex held: nothing to solve for
    let all = |s: &mut Simulation, body: BodyHandle, mesh: &Mesh| {
        let vertices: Vec<u32> = (0..mesh.points.len() as u32).collect();
        let rows = s.rows(body, "all", &vertices).unwrap();
        s.add_constraint(Constraint::hold("all", rows));
    };
    type Scene<'a> = &'a dyn Fn(&mut Simulation, BodyHandle, &Mesh);
    let scenes: [(&str, &Mesh, Scene<'_>); 7] = [
        ("one cell, free", &one_cell, &still),
        ("one cell, clamped", &one_cell, &clamped),
        ("one cell, held", &one_cell, &all),
        ("beam, clamped", &mesh, &clamped),
        ("beam, partly held", &mesh, &partly),
        ("two pieces, free", &pieces, &still),
        ("two pieces, one clamped", &pieces, &clamped),
    ];
    for (name, mesh, scene) in scenes {
        let Some([cpu, gpu]) = simulations(&GpuOptions::default()) else { return };
        let Some(jacobi) = on_device(&GpuOptions::default()) else { return };
        let kinds =
            [Preconditioner::Multigrid, Preconditioner::Multigrid, Preconditioner::BlockJacobi];
        let mut kinds = kinds.into_iter();
        let [cpu, gpu, jacobi] = [cpu, gpu, jacobi].map(|mut simulation| {
            let kind = kinds.next().unwrap();
            let body = simulation.add_body(&BodyDescription::new(name, mesh, MATERIAL)).unwrap();
            simulation.set_solver(settings(kind, 1e-5));
            scene(&mut simulation, body, mesh);
            // a push that bends and stretches
            let push = mesh.points.iter().map(|x| DVec3::new(x.x, 0.0, -20.0 * x.x * x.x));
            let push: Vec<_> = push.collect();
            let rest = vec![DVec3::ZERO; push.len()];
            if name != "one cell, held" {
                simulation.set_state(body, &rest, &push).unwrap();
            }
            let reports = steps(&mut simulation, 5);
            assert_eq!(reports[4].preconditioner, kind.name());
            assert!(reports.iter().all(|r| r.preconditioner_breakdowns == 0), "{name}");
            (simulation.displacements(body), iterations(&reports))
        });
        if name == "one cell, held" {
            assert!(gpu.0.iter().all(|u| *u == DVec3::ZERO) && gpu.1 == 0);
            continue;
        }
        let u = relative(&gpu.0, &cpu.0);
        say(&format!(
            "{name}: displacement {u:.1e}, iterations {} and {}, block Jacobi {}",
            cpu.1, gpu.1, jacobi.1
        ));
        assert!(u < 2e-4, "{name}: {u:.1e}");
        // the processor's incomplete factors are nearly complete in bodies that small
        let share = if mesh.points.len() > 8 { 2 } else { 1 };
        assert!(share * gpu.1 <= jacobi.1, "{name}: {} against {}", gpu.1, jacobi.1);
    }
}

#[test]
fn removal_time_step_and_binding_limit() {
    let mesh = beam([12, 4, 4]);
    // cut into several parts
    for binding_limit in [None, Some(100_000)] {
        let options = GpuOptions { binding_limit, ..GpuOptions::default() };
        let Some(both) = simulations(&options) else { return };
        let [cpu, gpu] = both.map(|mut simulation| {
            let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
            simulation.set_solver(settings(Preconditioner::Multigrid, 1e-5));
            hold(&mut simulation, body, &mesh, "x0");
            let mut reports = steps(&mut simulation, 3);
            // cut in two: what falls off is a piece of its own
            let near = |x: DVec3| (x.x - 0.1).abs() < 0.02;
            let cut = (0..).zip(&mesh.tetrahedra).filter(|(_, t)| {
                near(t.iter().map(|&v| mesh.points[v as usize]).sum::<DVec3>() / 4.0)
            });
            let cut: Vec<u32> = cut.map(|(i, _)| i).collect();
            simulation.remove_elements(body, &Removal::new(Region::Tetrahedra(cut))).unwrap();
            reports.extend(steps(&mut simulation, 3));
            // another factor of the masses: another matrix
            simulation.set_dt(0.004);
            reports.extend(steps(&mut simulation, 3));
            (simulation.displacements(body), reports)
        });
        let u = relative(&gpu.0, &cpu.0);
        let counts = [&cpu, &gpu].map(|run| iterations(&run.1));
        say(&format!("cut in two, limit {binding_limit:?}: {u:.1e}, iterations {counts:?}"));
        assert!(u < 2e-4, "{u:.1e}");
        assert!(2 * counts[1] < 5 * counts[0], "{counts:?}");
        let refreshed: Vec<u32> = gpu.1.iter().map(|r| r.preconditioner_refreshes).collect();
        assert!([0, 3, 6].iter().all(|&step| refreshed[step] == 1), "{refreshed:?}");
        assert!(gpu.1.iter().all(|r| r.preconditioner == "multigrid"));
    }
}

#[test]
fn repeats_bit_for_bit() {
    let mesh = beam([12, 4, 4]);
    let hashes = [(), ()].map(|()| {
        let mut simulation = on_device(&GpuOptions::default())?;
        let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
        simulation.set_solver(settings(Preconditioner::Multigrid, 1e-3));
        hold(&mut simulation, body, &mesh, "x0");
        steps(&mut simulation, 5);
        Some(simulation.state_hash())
    });
    assert_eq!(hashes[0], hashes[1]);
}
