//! Adding the private arrays of the element ranges up to totals.
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent, evaluate, request};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::engine::law::{LawBuffers, TangentKind};
use sinew::engine::matrix::Tangent;
use sinew::engine::workers::Workers;
use sinew::models::body::Evaluation;
use sinew::models::frame::law::TetrahedronLaw;
use sinew::models::laws::svk::FusedStVK;
use sinew::prelude::*;

fn gather(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells);
        let mut group = c.benchmark_group(format!("gather/{size}"));
        group.throughput(Throughput::Elements(mesh.tetrahedra.len() as u64));
        for threads in [1, 2] {
            let (mut simulation, _) = bent(&mesh, Precision::F64, threads, Evaluation::Fused);
            request(&mut simulation, false, true, Some(TangentKind::Exact));
            evaluate(&mut simulation);
            let world = simulation.world();
            let buffers = world.resource::<LawBuffers<f64>>();
            let buffer = buffers.get(FusedStVK::NAME).unwrap();
            let workers = world.resource::<Workers>();
            let mut total = vec![[0.0; 4]; simulation.topology().vertex_count()];
            group.bench_function(BenchmarkId::new("forces", threads), |b| {
                b.iter(|| buffer.add_forces_to(workers, &mut total));
            });
            let mut matrix = world.resource::<Tangent<f64>>().matrix.clone();
            group.bench_function(BenchmarkId::new("tangent", threads), |b| {
                b.iter(|| buffer.add_tangent_to(workers, &mut matrix));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, gather);
criterion_main!(benches);
