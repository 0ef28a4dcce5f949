//! Assembly of the tangent, gather included.
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent, evaluate, request};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::engine::law::TangentKind;
use sinew::prelude::*;

fn tangent(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells);
        let mut group = c.benchmark_group(format!("tangent/{size}"));
        group.throughput(Throughput::Elements(mesh.tetrahedra.len() as u64));
        group.sample_size(20);
        let cases = [
            (Evaluation::Fused, Precision::F64, TangentKind::Exact),
            (Evaluation::Fused, Precision::F64, TangentKind::Projected),
            (Evaluation::Fused, Precision::F32, TangentKind::Exact),
            (Evaluation::Pooled, Precision::F64, TangentKind::Exact),
        ];
        for (evaluation, precision, kind) in cases {
            for threads in [1, 2] {
                let (mut simulation, _) = bent(&mesh, precision, threads, evaluation);
                request(&mut simulation, false, false, Some(kind));
                let name = format!("{evaluation:?} {kind:?} {}", precision.name());
                group.bench_function(BenchmarkId::new(name, threads), |b| {
                    b.iter(|| evaluate(&mut simulation));
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, tangent);
criterion_main!(benches);
