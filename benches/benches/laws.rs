//! Energies and forces: the fused law, the pooled springs, quadratic springs, plain springs on edges
//! (per tetrahedron too), and hexahedra. With their errors, in turns: `sinew-lab bench kernels`.
#![allow(missing_docs, reason = "criterion's macros make public items")]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew::engine::mesh::generate::box_hexahedra;
use sinew::models::body::Evaluation;
use sinew::prelude::*;
use sinew_benches::toolbox::beam::{SIZES, beam, bent, evaluate, request};

fn laws(c: &mut Criterion) {
    for (size, cells) in SIZES {
        let mesh = beam(cells).expect("valid sizes");
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
                        bent(&mesh, precision, threads, evaluation, model).expect("a beam");
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
                }
            }
        }
        group.finish();
    }
}

/// Springs of hexahedra beside springs of tetrahedra, per spring, and the laws of hexahedra.
fn elements(c: &mut Criterion) {
    let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
    for (size, cells) in SIZES {
        // as many vertices as the beam of tetrahedra
        let tetrahedra = beam(cells).expect("valid sizes");
        let hexahedra = box_hexahedra(DVec3::new(0.2, 0.05, 0.05), cells).expect("a box");
        let mut group = c.benchmark_group(format!("elements/{size}"));
        for (name, mesh, model) in [
            ("springs of tetrahedra", &tetrahedra, Model::MassSpring),
            ("springs of hexahedra", &hexahedra, Model::MassSpring),
            ("StVK hexahedra", &hexahedra, Model::CompressibleStVK),
            ("linear hexahedra", &hexahedra, Model::Linear),
        ] {
            for precision in [Precision::F64, Precision::F32] {
                let options = SimulationOptions { precision, threads: 1, ..Default::default() };
                let mut simulation = Simulation::new(options).expect("a simulation");
                let body =
                    BodyDescription { model, ..BodyDescription::new("body", mesh, material) };
                let body = simulation.add_body(&body).expect("a body");
                let bend = |p: &DVec3| DVec3::new(0.0, 0.0, 2.0 * p.x * p.x);
                let u: Vec<DVec3> = mesh.points.iter().map(bend).collect();
                simulation.set_state(body, &u, &vec![DVec3::ZERO; u.len()]).expect("a state");
                request(&mut simulation, false, true, None);
                let count = match model {
                    Model::MassSpring => simulation.topology().edges.len(),
                    _ => mesh.hexahedra.len(),
                };
                group.throughput(Throughput::Elements(count as u64));
                group.bench_function(BenchmarkId::new(name, precision.name()), |b| {
                    b.iter(|| evaluate(&mut simulation));
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, laws, elements);
criterion_main!(benches);
