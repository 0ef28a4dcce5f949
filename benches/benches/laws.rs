//! Energies and forces: the fused law, the pooled springs, quadratic springs, plain springs on edges
//! (per tetrahedron too), and entity columns against plain arrays (in turns: `sinew-lab bench kernels`).
#![allow(clippy::print_stdout, reason = "ratios and times per system are part of the result")]
#![allow(missing_docs, reason = "criterion's macros make public items")]

mod common;

use common::{SIZES, beam, bent, bent_model, evaluate, request};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::engine::mesh::generate::box_hexahedra;
use sinew::engine::report::SystemTimes;
use sinew::engine::scalar::Scalar;
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew_benches::bench::arrays::PlainArrays;
use std::hint::black_box;
use std::time::Instant;

fn laws(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells);
        let count = mesh.tetrahedra.len() as u64;
        let mut group = c.benchmark_group(format!("laws/{size}"));
        group.throughput(Throughput::Elements(count));
        let laws = [
            (Model::CompressibleStVK, Evaluation::Fused),
            (Model::CompressibleStVK, Evaluation::Pooled),
            (Model::QuadraticSprings, Evaluation::Fused),
            (Model::MassSpring, Evaluation::Fused),
        ];
        for (model, evaluation) in laws {
            for precision in [Precision::F64, Precision::F32] {
                for threads in [1, 2] {
                    let (mut simulation, _) =
                        bent_model(&mesh, precision, threads, model, evaluation);
                    for (what, energy) in [("energy", true), ("force", false)] {
                        let law = match model {
                            Model::CompressibleStVK => format!("{evaluation:?}"),
                            _ => model.name().to_string(),
                        };
                        let name = format!("{law} {what} {}", precision.name());
                        request(&mut simulation, energy, !energy, None);
                        group.bench_function(BenchmarkId::new(name, threads), |b| {
                            b.iter(|| evaluate(&mut simulation));
                        });
                    }
                    if evaluation == Evaluation::Pooled && threads == 1 {
                        times_per_system(&mut simulation, count, size, precision);
                    }
                }
            }
        }
        group.finish();
    }
}

/// Mean time of every system of a force evaluation.
fn times_per_system(simulation: &mut Simulation, count: u64, size: &str, precision: Precision) {
    const RUNS: u32 = 200;
    request(simulation, false, true, None);
    simulation.world_mut().insert_resource(SystemTimes::default());
    for _ in 0..RUNS {
        evaluate(simulation);
    }
    for entry in &simulation.world().resource::<SystemTimes>().entries {
        let ns = entry.seconds * 1e9 / f64::from(RUNS) / count as f64;
        println!("pooled force {size} {}: {} {ns:.2} ns/tet", precision.name(), entry.name);
    }
}

fn columns(c: &mut Criterion) {
    for (size, cells) in SIZES {
        columns_against_arrays::<f64>(c, size, cells, Precision::F64);
        columns_against_arrays::<f32>(c, size, cells, Precision::F32);
    }
}

fn columns_against_arrays<S: Scalar>(
    c: &mut Criterion,
    size: &str,
    cells: [usize; 3],
    precision: Precision,
) {
    let mesh = beam(cells);
    let count = mesh.tetrahedra.len();
    let (mut simulation, _) = bent(&mesh, precision, 1, Evaluation::Fused);
    request(&mut simulation, false, true, None);
    let mut raw = PlainArrays::<S>::of(&mut simulation).expect("a fused body");
    let mut group = c.benchmark_group(format!("columns/{size} {}", precision.name()));
    group.throughput(Throughput::Elements(count as u64));
    group.bench_function("entity columns", |b| b.iter(|| evaluate(&mut simulation)));
    group.bench_function("plain arrays", |b| b.iter(|| black_box(black_box(&mut raw).forces())[0]));
    group.finish();
}

/// Springs of hexahedra against springs of tetrahedra, per spring, and the laws of hexahedra.
fn elements(_: &mut Criterion) {
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
    for (size, cells) in SIZES {
        // as many vertices as the beam of tetrahedra
        let tetrahedra = beam(cells);
        let hexahedra = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), cells).expect("a box");
        let bodies = [
            ("springs of tetrahedra", &tetrahedra, Model::MassSpring),
            ("springs of hexahedra", &hexahedra, Model::MassSpring),
            ("StVK hexahedra", &hexahedra, Model::CompressibleStVK),
            ("linear hexahedra", &hexahedra, Model::Linear),
        ];
        for precision in [Precision::F64, Precision::F32] {
            let mut times = Vec::new();
            let mut simulations = Vec::new();
            for (_, mesh, model) in &bodies {
                let options = SimulationOptions { precision, threads: 1, ..Default::default() };
                let mut simulation = Simulation::new(options).expect("a simulation");
                let body = BodyDescription {
                    model: *model,
                    ..BodyDescription::new("body", mesh, material)
                };
                let handle = simulation.add_body(&body).expect("a body");
                let bend = |p: &DVec3| DVec3::new(0.0, 0.0, 2.0 * p.x * p.x);
                let u: Vec<DVec3> = mesh.points.iter().map(bend).collect();
                let still = vec![DVec3::ZERO; u.len()];
                simulation.set_state(handle, &u, &still).expect("a state");
                request(&mut simulation, false, true, None);
                let count = match model {
                    Model::MassSpring => simulation.topology().edges.len(),
                    _ => mesh.hexahedra.len(),
                };
                times.push((count, Vec::new()));
                simulations.push(simulation);
            }
            for _ in 0..(2_000_000 / hexahedra.hexahedra.len()).max(21) {
                for (simulation, (_, times)) in simulations.iter_mut().zip(&mut times) {
                    let start = Instant::now();
                    evaluate(simulation);
                    times.push(start.elapsed());
                }
            }
            for ((name, ..), (count, mut times)) in bodies.into_iter().zip(times) {
                times.sort_unstable();
                let ns = times[times.len() / 2].as_secs_f64() * 1e9 / count as f64;
                let precision = precision.name();
                println!("force {size} {precision}: {name} {ns:.2} ns each of {count}");
            }
        }
    }
}

criterion_group!(benches, columns, laws, elements);
criterion_main!(benches);
