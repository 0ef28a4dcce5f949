//! Whole steps of 10 ms of the bent beam let go: the default implicit one and explicit substeps.
#![allow(clippy::print_stdout, reason = "iterations and substeps are part of the result")]
#![allow(missing_docs, reason = "criterion's macros make public items")]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew_benches::toolbox::beam::{SIZES, beam, bent};
use std::time::{Duration, Instant};

fn step(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells).expect("valid sizes");
        let mut group = c.benchmark_group(format!("step/{size}"));
        group.throughput(Throughput::Elements(mesh.tetrahedra.len() as u64));
        group.sample_size(10);
        for integrator in [Integrator::Safe, Integrator::StormerVerlet] {
            for precision in [Precision::F64, Precision::F32] {
                for threads in [1, 2] {
                    let (evaluation, model) = (Evaluation::Fused, Model::CompressibleStVK);
                    let (mut simulation, body) =
                        bent(&mesh, precision, threads, evaluation, model).expect("a beam");
                    simulation.set_dt(0.01);
                    simulation.set_solver(SolverSettings { integrator, ..Default::default() });
                    // off the start, in motion
                    for _ in 0..3 {
                        simulation.step().expect("a step");
                    }
                    let (u, v) = (simulation.displacements(body), simulation.velocities(body));
                    let name = format!("{integrator:?} {}", precision.name());
                    group.bench_function(BenchmarkId::new(name, threads), |b| {
                        b.iter_custom(|runs| {
                            let mut total = Duration::ZERO;
                            for _ in 0..runs {
                                simulation.set_state(body, &u, &v).expect("lengths");
                                let start = Instant::now();
                                simulation.step().expect("a step");
                                total += start.elapsed();
                            }
                            total
                        });
                    });
                    let r = simulation.report();
                    println!(
                        "{integrator:?} {size}: {} CG iterations, {} evaluations, {} projections, {} \
                         substeps, stable step {:.3} ms",
                        r.cg_iterations,
                        r.evaluations,
                        r.projections,
                        r.substeps,
                        r.stable_step * 1e3
                    );
                }
            }
        }
        group.finish();
    }
}

criterion_group!(benches, step);
criterion_main!(benches);
