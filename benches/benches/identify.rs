//! Spring constants of one irregular element of every kind, by every fit, and of a mesh of hexahedra.
#![allow(missing_docs, reason = "criterion's macros make public items")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use sinew_identify::cells::Cells;
use sinew_identify::mesh::fit_elements;
use sinew_identify::{
    ElementGeometry, ElementKind, ElementMethod, LinearMaterial, Section, fit_element,
};

const METHODS: [ElementMethod; 5] = [
    ElementMethod::Frobenius,
    ElementMethod::Block,
    ElementMethod::Nonnegative,
    ElementMethod::TwoNorm,
    ElementMethod::TwoNormNonnegative,
];

/// The same small displacement of grid point `i` in every run.
fn jitter(i: usize) -> [f64; 3] {
    [1, 2, 3].map(|axis| 0.1 * ((i * 7 + axis * 13) as f64 * 1.7).sin())
}

/// Jittered grid of `n` unit cells along every axis.
fn grid(n: usize) -> (Vec<[f64; 3]>, Vec<[u32; 8]>) {
    let m = n + 1;
    let points = (0..m * m * m)
        .map(|i| {
            let [x, y, z] = jitter(i);
            [(i % m) as f64 + x, (i / m % m) as f64 + y, (i / m / m) as f64 + z]
        })
        .collect();
    let cells = (0..n * n * n).map(|c| {
        let corner = c % n + m * (c / n % n + m * (c / n / n));
        let face = [corner, corner + 1, corner + m + 1, corner + m];
        std::array::from_fn(|a| (face[a % 4] + a / 4 * m * m) as u32)
    });
    (points, cells.collect())
}

fn elements(c: &mut Criterion) {
    let (points, cells) = grid(1);
    let corner = |a: usize| points[cells[0][a] as usize];
    let section = Section::default();
    let material = LinearMaterial::new(1e4, 0.3).expect("material");
    for (kind, nodes) in [
        (ElementKind::Triangle, vec![0, 1, 2]),
        (ElementKind::Quad, vec![0, 1, 2, 3]),
        (ElementKind::Tetrahedron, vec![0, 1, 3, 4]),
        (ElementKind::Hexahedron, (0..8).collect()),
    ] {
        let nodes: Vec<_> = nodes.into_iter().map(corner).collect();
        let geometry = ElementGeometry::new(kind, &nodes).expect("geometry");
        let mut group = c.benchmark_group(format!("identify/{kind}"));
        for method in METHODS {
            group.bench_function(method.name(), |b| {
                b.iter(|| fit_element(black_box(&geometry), &material, &section, method));
            });
        }
        group.finish();
    }
}

fn mesh(c: &mut Criterion) {
    let (points, cells) = grid(8);
    let cells = Cells { hexahedra: &cells, ..Cells::default() };
    let material = [LinearMaterial::new(1e4, 0.3).expect("material")];
    let mut group = c.benchmark_group("identify/512 hexahedra");
    group.throughput(Throughput::Elements(512));
    group.sample_size(10);
    for method in [ElementMethod::Frobenius, ElementMethod::TwoNorm] {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
            group.bench_function(BenchmarkId::new(method.name(), threads), |b| {
                b.iter(|| {
                    pool.install(|| {
                        fit_elements(&points, &cells, &material, &Section::default(), method)
                    })
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, elements, mesh);
criterion_main!(benches);
