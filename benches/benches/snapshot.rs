//! What a snapshot and taking it up again cost beside a step of 10 ms: in memory, as a program that goes back every step
//! pays it, and as bytes.
#![allow(clippy::print_stdout, reason = "sizes are part of the result")]
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew::snapshot::Snapshot;

fn snapshot(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells);
        let mut group = c.benchmark_group(format!("snapshot/{size}"));
        group.sample_size(10);
        for integrator in [Integrator::Auto, Integrator::StormerVerlet] {
            let (mut simulation, _) = bent(&mesh, Precision::F64, 1, Evaluation::Fused);
            simulation.set_dt(0.01);
            simulation.set_solver(SolverSettings { integrator, ..Default::default() });
            for _ in 0..3 {
                simulation.step().expect("a step");
            }
            let start = simulation.snapshot().expect("a snapshot");
            let name = |what| BenchmarkId::new(integrator.name(), what);
            group.bench_function(name("step"), |b| {
                b.iter(|| simulation.step().expect("a step"));
            });
            group.bench_function(name("step, snapshot, restore"), |b| {
                b.iter(|| {
                    simulation.step().expect("a step");
                    let snapshot = simulation.snapshot().expect("a snapshot");
                    simulation.restore(&snapshot).expect("its own");
                });
            });
            group.bench_function(name("snapshot, restore"), |b| {
                b.iter(|| {
                    let snapshot = simulation.snapshot().expect("a snapshot");
                    simulation.restore(&snapshot).expect("its own");
                });
            });
            group.bench_function(name("restore the start"), |b| {
                b.iter(|| simulation.restore(&start).expect("its own"));
            });
            let bytes = start.to_bytes();
            println!("{integrator:?} {size}: {} bytes", bytes.len());
            group.bench_function(name("to bytes"), |b| b.iter(|| start.to_bytes()));
            group.bench_function(name("from bytes, restore"), |b| {
                b.iter(|| {
                    let read = Snapshot::from_bytes(&bytes).expect("whole");
                    simulation.restore(&read).expect("its own");
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, snapshot);
criterion_main!(benches);
