//! The smoother, when a preconditioner is kept, the inverse against one by hand, and what is done without it.
use super::*;
use crate::backend::{GpuBackend, install_gpu};
use crate::body::{StepUniform, VertexConstants};
use bevy_ecs::prelude::World;
use sinew_adapter::{AdapterRequest, open};
use sinew_engine::load::Constraint;
use sinew_engine::mesh::generate::box_tets;
use sinew_engine::report::StepReport;
use sinew_engine::schedule::Executor;
use sinew_engine::step::{install_engine, run_step};
use sinew_engine::workers::Workers;
use sinew_models::body::{BodyDescription, spawn_body};
use sinew_models::material::YoungPoisson;
use sinew_solvers::settings::{Integrator, Preconditioner, SolverSettings};

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
    let mut kept = Kept::new(factors, 10.0);
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

/// Numbers in [-1, 1] from a counter.
fn noise(i: u64) -> f64 {
    let x = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((x ^ (x >> 32)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn the_inverse_is_that_of_the_galerkin_matrix() {
    let Ok(gpu) = open(&AdapterRequest::default()) else {
        eprintln!("skipped: no GPU adapter");
        return;
    };
    // rows are cut into several parts by the limit
    let context = Context::new(gpu, Some(1 << 14));
    let n = 120_usize;
    let rest: Vec<_> = (0..n as u64)
        .map(|i| DVec3::new(i as f64 / 10.0, noise(2 * i), noise(2 * i + 1)))
        .collect();
    // the last ten are a piece of its own, on a line: one turn meets no resistance
    let piece: Vec<u32> = (0..n).map(|i| u32::from(i >= n - 10)).collect();
    let rest: Vec<_> = rest
        .into_iter()
        .enumerate()
        .map(|(i, x)| if i >= n - 10 { DVec3::new(x.x, 0.0, 0.0) } else { x })
        .collect();
    let edges: Vec<[u32; 2]> = (0..n as u32)
        .flat_map(|i| [1, 2, 3, 7].map(|by| [i, i + by]))
        .filter(|&[a, b]| (b as usize) < n && piece[a as usize] == piece[b as usize])
        .collect();
    let pattern = Pattern::new(&context, n as u32, edges.iter().copied(), false);
    assert!(pattern.parts.len() > 2);
    // springs along edges and a little of everything
    let mut dense = vec![vec![0.0_f64; 3 * n]; 3 * n];
    for (at, &[a, b]) in (0..).zip(&edges) {
        let (a, b) = (a as usize, b as usize);
        let way = (rest[b] - rest[a]).normalize().to_array();
        for r in 0..3 {
            for c in 0..3 {
                let own = f64::from(u32::from(r == c));
                let k = (2.0 + noise(at)) * (way[r] * way[c] + 0.1 * own);
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
#[allow(clippy::print_stderr, reason = "a skipped test says so")]
fn a_spoilt_inverse_is_reported_and_done_without() {
    let Ok(gpu) = open(&AdapterRequest::default()) else {
        eprintln!("skipped: no GPU adapter");
        return;
    };
    let mut world = World::new();
    install_engine::<f64>(&mut world, Executor::default());
    world.insert_resource(Workers::new(1).unwrap());
    install_gpu::<f64>(&mut world, GpuBackend::with_gpu(gpu, None));
    world.insert_resource(SolverSettings {
        integrator: Integrator::Safe,
        preconditioner: Preconditioner::Multigrid,
        linear_tolerance: 1e-4,
        ..SolverSettings::default()
    });
    let mesh = box_tets(DVec3::new(0.2, 0.05, 0.05), [8, 3, 3]).unwrap();
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.45, density: 1000.0 };
    spawn_body(&mut world, &BodyDescription::new("beam", &mesh, material)).unwrap();
    world.spawn(Constraint::hold("end", (0..16).collect()));
    let mut step = |spoilt: bool| {
        if spoilt {
            let backend = world.resource::<GpuBackend>();
            let coarse = backend.bodies[0].body.coarse.as_ref().unwrap();
            let numbers = (coarse.stride * coarse.stride) as usize;
            backend.context.write(&coarse.inverse, 0, &vec![-1.0_f32; numbers]);
        }
        run_step(&mut world).unwrap();
        let report: &StepReport = world.resource();
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
