//! The two-level preconditioner on the device: iterations against the processor's, bodies that are not one whole, the
//! smoother, when the coarse space is kept, its inverse against one by hand, and what is done without it.

use crate::common::shared::{Shortcuts, guide};
use crate::common::{MATERIAL, beam, hold, noise, on_device, relative, say, simulations};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::report::StepReport;
use sinew::models::resection::Region;
use sinew::prelude::*;
use sinew::simulation::Backend;
use sinew::solvers::coarse::Aggregates;
use sinew::solvers::settings::Preconditioner;
use sinew_adapter::{AdapterRequest, open};
use sinew_gpu::body::{StepUniform, VertexConstants};
use sinew_gpu::coarse::{
    Coarse, CoarseBuffers, CoarseParts, CoarsePlan, KeptInverse, SMOOTHED, smoother,
};
use sinew_gpu::context::Context;
use sinew_gpu::matrix::MatrixPattern;
use sinew_gpu::{GpuBackend, GpuOptions};

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
            simulation.remove(body, Region::Tetrahedra(cut));
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

#[test]
fn smoother_is_positive_and_near_the_inverse() {
    for largest in [2.0, 4.0, 8.0] {
        let [same, next] = smoother(largest).map(f64::from);
        for k in 1..=80 {
            let x = largest * f64::from(k) / 80.0;
            let product = x * (same - next * x);
            assert!(product > 0.0);
            assert!(x < largest / SMOOTHED || (product - 1.0).abs() < 0.434, "{x} {product}");
        }
    }
}

#[test]
fn kept_until_the_excess_is_worth_a_refresh() {
    let factors = [1.0, 0.0, 0.0];
    let mut kept = KeptInverse::new(factors, 10.0);
    kept.book(15, 3.0);
    // as good as the first
    kept.book(5, 1.0);
    assert!(kept.serves(factors) && !kept.serves([2.0, 0.0, 0.0]));
    // 9 more than 15, then 1 more
    kept.book(24, 3.0);
    assert!(kept.serves(factors));
    kept.book(6, 1.0);
    assert!(!kept.serves(factors));
}

#[test]
fn the_inverse_is_that_of_the_galerkin_matrix() {
    let Ok(gpu) = open(&AdapterRequest::default()) else { return say("skipped: no GPU adapter") };
    // rows are cut into several parts by the limit
    let context = Context::new(gpu, Some(1 << 14));
    let n = 120_usize;
    // the last ten are a piece of its own, on a line: one turn meets no resistance
    let piece: Vec<u32> = (0..n).map(|i| u32::from(i >= n - 10)).collect();
    let off = |i: usize| if i >= n - 10 { DVec3::ZERO } else { noise(i).with_x(0.0) };
    let rest: Vec<_> = (0..n).map(|i| DVec3::X * (i as f64 / 10.0) + off(i)).collect();
    let edges: Vec<[u32; 2]> = (0..n as u32)
        .flat_map(|i| [1, 2, 3, 7].map(|by| [i, i + by]))
        .filter(|&[a, b]| (b as usize) < n && piece[a as usize] == piece[b as usize])
        .collect();
    let pattern = MatrixPattern::new(&context, n as u32, edges.iter().copied(), false);
    assert!(pattern.parts.len() > 2);
    // springs along edges and a little of everything
    let mut dense = vec![vec![0.0_f64; 3 * n]; 3 * n];
    for (at, &[a, b]) in (0..).zip(&edges) {
        let (a, b) = (a as usize, b as usize);
        let way = (rest[b] - rest[a]).normalize().to_array();
        for r in 0..3 {
            for c in 0..3 {
                let own = f64::from(u32::from(r == c));
                let k = (2.0 + noise(at).x) * (way[r] * way[c] + 0.1 * own);
                for (x, y, sign) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    dense[3 * x + r][3 * y + c] += sign * k;
                }
            }
        }
    }
    for part in &pattern.parts {
        let rows = part.first as usize..(part.first + part.count) as usize;
        let values: Vec<f32> = rows
            .flat_map(|i| pattern.row(i).iter().map(move |&j| (i, j as usize)))
            .flat_map(|(i, j)| (0..9).map(move |x| (3 * i + x / 3, 3 * j + x % 3)))
            .map(|(r, c)| dense[r][c] as f32)
            .collect();
        context.write(&part.values, 0, &values);
    }
    let held = |i: usize| if i < 8 { 7 } else { u32::from(i.is_multiple_of(5)) };
    let vertices: Vec<_> = (0..n)
        .map(|i| VertexConstants {
            mass: 0.01 + 0.01 * (i % 3) as f32,
            held: held(i),
            piece: piece[i],
            loaded: 0,
        })
        .collect();
    let plan = CoarsePlan::new(&context, &CoarseParts { rest: &rest, piece: &piece }).unwrap();
    let Aggregates { of, arm, count } = plan.aggregates.clone();
    assert!(count > 5 && 4 * plan.stride * plan.stride <= 1 << 14, "{count}");
    let uniform = StepUniform { n: n as u32, inertia: 3.0, ..StepUniform::default() };
    let step = context.uniform("step", &uniform);
    let vertices = context.filled("vertices", &vertices);
    let [rows, partials, cg] = ["rows", "partials", "cg"].map(|l| context.storage(l, 16));
    let buffers = CoarseBuffers {
        step: &step,
        rows: &rows,
        vertices: &vertices,
        partials: &partials,
        cg: &cg,
    };
    let coarse = Coarse::new(&context, plan, &pattern, &buffers);
    let mut recorder = context.record();
    coarse.refresh(&mut recorder);
    let stride = coarse.stride as usize;
    let found = recorder.read(&coarse.inverse, 0, 4 * (stride * stride) as u64);
    recorder.submit();
    let found: Vec<f32> = found.wait(&context).unwrap();

    // P^T A P by hand
    let unknowns = 6 * count;
    let mut p = vec![vec![0.0_f64; unknowns]; 3 * n];
    for i in 0..n {
        for k in (0..3).filter(|k| held(i) >> k & 1 == 0) {
            let first = 6 * of[i] as usize;
            p[3 * i + k][first + k] = 1.0;
            for turn in 0..3 {
                p[3 * i + k][first + 3 + turn] = DVec3::AXES[turn].cross(arm[i])[k];
            }
            dense[3 * i + k][3 * i + k] += 3.0 * (0.01 + 0.01 * (i % 3) as f64);
        }
    }
    let mut galerkin = vec![vec![0.0_f64; unknowns]; unknowns];
    for r in 0..3 * n {
        for c in (0..3 * n).filter(|&c| dense[r][c] != 0.0) {
            for a in (0..unknowns).filter(|&a| p[r][a] != 0.0) {
                for b in 0..unknowns {
                    galerkin[a][b] += p[r][a] * dense[r][c] * p[c][b];
                }
            }
        }
    }
    let at = |a: usize, b: usize| f64::from(found[a * stride + b]);
    let live: Vec<usize> = (0..unknowns).filter(|&a| at(a, a) != 0.0).collect();
    // an aggregate that is held, and turns of points on a line
    assert!(live.len() < unknowns && live.len() + 12 >= unknowns, "{} {unknowns}", live.len());
    for &a in &live {
        for &b in &live {
            assert_eq!(at(a, b), at(b, a));
            let product: f64 = live.iter().map(|&k| at(a, k) * galerkin[k][b]).sum();
            let identity = f64::from(u32::from(a == b));
            assert!((product - identity).abs() < 2e-3, "{a} {b}: {product}");
        }
    }
    for dropped in (0..unknowns).filter(|a| !live.contains(a)) {
        assert!((0..unknowns).all(|b| at(dropped, b) == 0.0 && at(b, dropped) == 0.0));
    }
}

#[test]
fn a_spoilt_inverse_is_reported_and_done_without() {
    let Some(mut simulation) = on_device(&GpuOptions::default()) else { return };
    let mesh = beam([8, 3, 3]);
    let body = simulation.add_body(&BodyDescription::new("beam", &mesh, MATERIAL)).unwrap();
    hold(&mut simulation, body, &mesh, "x0");
    simulation.set_solver(settings(Preconditioner::Multigrid, 1e-4));
    let mut step = |spoilt: bool| {
        if spoilt {
            let (context, coarse) = simulation.world().resource::<GpuBackend>().coarse(0).unwrap();
            let numbers = (coarse.stride * coarse.stride) as usize;
            context.write(&coarse.inverse, 0, &vec![-1.0_f32; numbers]);
        }
        simulation.step().unwrap();
        let report = simulation.report();
        assert!(report.cg_residual < 2e-4);
        let counts = [report.preconditioner_refreshes, report.preconditioner_breakdowns];
        (report.preconditioner.clone(), counts)
    };
    assert_eq!(step(false), ("multigrid".into(), [1, 0]));
    assert_eq!(step(false), ("multigrid".into(), [0, 0]));
    assert_eq!(step(true), ("block-jacobi".into(), [0, 1]));
    assert_eq!(step(false), ("multigrid".into(), [1, 0]));
    assert_eq!(step(false), ("multigrid".into(), [0, 0]));
}
