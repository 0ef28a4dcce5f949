//! Assembly of the tangent, gather included, and its product with a vector, with and without it.
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent, evaluate, request};
use criterion::measurement::WallTime;
use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main,
};
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::mesh::Mesh;
use sinew::engine::scalar::Scalar;
use sinew::models::body::Evaluation;
use sinew::models::frame::tetrahedra::multiply;
use sinew::models::laws::svk::FusedStVK;
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

fn product(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells);
        let mut group = c.benchmark_group(format!("product/{size}"));
        group.throughput(Throughput::Elements(mesh.tetrahedra.len() as u64));
        products::<f64>(&mut group, &mesh, Precision::F64);
        products::<f32>(&mut group, &mesh, Precision::F32);
        group.finish();
    }
}

fn products<S: Scalar>(group: &mut BenchmarkGroup<WallTime>, mesh: &Mesh, precision: Precision) {
    for threads in [1, 2] {
        let (mut simulation, _) = bent(mesh, precision, threads, Evaluation::Fused);
        request(&mut simulation, false, false, Some(TangentKind::Exact));
        evaluate(&mut simulation);
        let world = simulation.world_mut();
        let x = S::from_f64(1e-3);
        let direction = vec![[x, -x, x, S::ZERO]; mesh.points.len()];
        let mut result = vec![[S::ZERO; 4]; mesh.points.len()];
        for kind in [TangentKind::Exact, TangentKind::GaussNewton] {
            let name = format!("by tetrahedra {kind:?} {}", precision.name());
            group.bench_function(BenchmarkId::new(name, threads), |b| {
                b.iter(|| multiply::<FusedStVK, S>(world, kind, &direction, &mut result));
            });
        }
        let mut spans = ProductSpans::default();
        let name = format!("assembled {}", precision.name());
        group.bench_function(BenchmarkId::new(name, threads), |b| {
            b.iter(|| {
                let (topology, workers) = (world.resource(), world.resource());
                let tangent = world.resource::<Tangent<S>>();
                tangent.matrix.multiply(topology, workers, &mut spans, &direction, &mut result);
            });
        });
    }
}

criterion_group!(benches, tangent, product);
criterion_main!(benches);
