//! What the plain face costs over the library: buffers of 1 118 vertices, calls without work.
#![allow(missing_docs, reason = "criterion's macros make public items")]

use criterion::{Criterion, criterion_group, criterion_main};
use sinew_embed::*;

/// The liver of the shipped scenes.
fn liver(precision: Precision) -> (Embedding, Handle) {
    let path = sinew_scene::shipped_scene("liver");
    let own = Overrides { threads: Some(1), precision: Some(precision), ..Overrides::default() };
    let mut sim = Embedding::from_scene_file(&path.to_string_lossy(), &own).expect("a scene");
    sim.step(3).expect("steps");
    let (body, _) = sim.list(Kind::Body)[0];
    (sim, body)
}

fn buffers(c: &mut Criterion) {
    let mut group = c.benchmark_group("buffers");
    for precision in [Precision::F64, Precision::F32] {
        let (mut sim, body) = liver(precision);
        let n = sim.vertex_count(body).expect("a body");
        let name = |what: &str| format!("{what}, {n} vertices, {}", precision.name());
        group.bench_function(name("positions, refreshed"), |b| {
            b.iter(|| {
                // as after a step
                sim.simulation_mut();
                sim.positions(body).expect("a body")[n - 1]
            });
        });
        group.bench_function(name("positions, known"), |b| {
            b.iter(|| sim.positions(body).expect("a body")[n - 1]);
        });
        let mut bytes = vec![0; 12 * n];
        group.bench_function(name("positions as f32, refreshed"), |b| {
            b.iter(|| {
                sim.simulation_mut();
                sim.positions_f32(body, &mut bytes, 12).expect("a body");
            });
        });
        group.bench_function(name("surface, unchanged"), |b| {
            b.iter(|| {
                sim.simulation_mut();
                sim.surface(body).expect("a body").revision
            });
        });
    }
    group.finish();
}

criterion_group!(benches, buffers);
criterion_main!(benches);
