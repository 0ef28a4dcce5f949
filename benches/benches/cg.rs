//! One linear system of an implicit step of 10 ms, solved to 1e-3 from zero.
#![allow(clippy::print_stdout, reason = "iterations are part of the result")]
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent, evaluate, request};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::engine::columns::single_table;
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::Tangent;
use sinew::engine::scalar::Scalar;
use sinew::engine::vertex::{ElasticForce, FixedAxes, Mass, RestPosition};
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew::solvers::linear_solver::LinearSolver;
use sinew::solvers::settings::{LinearOptions, Preconditioner};
use sinew::solvers::system::ShiftedTangent;

const PRECONDITIONERS: [Preconditioner; 3] =
    [Preconditioner::BlockJacobi, Preconditioner::IncompleteCholesky, Preconditioner::Multigrid];

fn cg(c: &mut Criterion) {
    for (size, cells) in SIZES {
        solve::<f64>(c, size, cells, Precision::F64);
        solve::<f32>(c, size, cells, Precision::F32);
    }
}

fn solve<S: Scalar>(c: &mut Criterion, size: &str, cells: [usize; 3], precision: Precision) {
    let mesh = beam(cells);
    let mut group = c.benchmark_group(format!("cg/{size}"));
    group.throughput(Throughput::Elements(mesh.tetrahedra.len() as u64));
    group.sample_size(10);
    for threads in [1, 2] {
        let (mut simulation, _) = bent(&mesh, precision, threads, Evaluation::Fused);
        request(&mut simulation, false, true, Some(TangentKind::Exact));
        evaluate(&mut simulation);
        let world = simulation.world_mut();
        let mut query = world.query::<(&ElasticForce<S>, &Mass<S>, &RestPosition)>();
        let (force, mass, rest) = single_table(query.contiguous_iter(world)).expect("rows");
        let g = S::from_f64(-9.81);
        let mut b: Vec<[S; 4]> = force.iter().map(|f| f.0).collect();
        let mut fixed = vec![FixedAxes::NONE; b.len()];
        for (row, b) in b.iter_mut().enumerate() {
            b[2] += mass[row].0 * g;
            if rest[row].0.x == 0.0 {
                (*b, fixed[row]) = ([S::ZERO; 4], FixedAxes::ALL);
            }
        }
        let mass: Vec<S> = mass.iter().map(|m| m.0).collect();
        let rest: Vec<_> = rest.iter().map(|x| x.0).collect();
        let world = simulation.world();
        let system = ShiftedTangent {
            topology: simulation.topology(),
            workers: world.resource::<Workers>(),
            mass: &mass,
            mass_factor: S::from_f64(1e4),
            tangent: &world.resource::<Tangent<S>>().matrix,
            low_rank: &world.resource::<Tangent<S>>().low_rank,
            tangent_factor: S::ONE,
            damping: None,
            fixed: &fixed,
            contact: None,
        };
        let mut x = vec![[S::ZERO; 4]; b.len()];
        for preconditioner in PRECONDITIONERS {
            let options = LinearOptions { preconditioner, ..Default::default() };
            let mut solver = LinearSolver::default();
            // the first solve computes the preconditioner, the others keep it
            for kept in [false, true] {
                x.fill([S::ZERO; 4]);
                let outcome = solver.solve(&system, &rest, 0..1, &b, &mut x, &options);
                println!(
                    "cg {size} {} {threads} threads, kept {kept}: {outcome:?}",
                    precision.name()
                );
            }
            let name = format!("{} {}", preconditioner.name(), precision.name());
            group.bench_function(BenchmarkId::new(name, threads), |bench| {
                bench.iter(|| {
                    x.fill([S::ZERO; 4]);
                    solver.solve(&system, &rest, 0..1, &b, &mut x, &options)
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, cg);
criterion_main!(benches);
