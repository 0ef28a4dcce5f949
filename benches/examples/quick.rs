#![allow(missing_docs, clippy::print_stdout)]
#[path = "../benches/common/mod.rs"]
mod common;
use common::*;
use sinew::engine::law::TangentKind;
use sinew::prelude::*;
use std::time::Instant;
fn main() {
    let big = std::env::args().any(|a| a == "big");
    let plain = std::env::args().any(|a| a == "plain");
    let pooled = std::env::args().any(|a| a == "pooled");
    let mut sizes = SIZES.to_vec();
    if big {
        sizes.push(("500k", [100, 23, 36]));
    }
    for (size, cells) in sizes {
        let mesh = beam(cells);
        let n = mesh.tetrahedra.len();
        for precision in [Precision::F64, Precision::F32] {
            for threads in [1, 2] {
                let ev = if pooled { Evaluation::Pooled } else { Evaluation::Fused };
                let (mut s, _) = bent(&mesh, precision, threads, ev);
                if plain {
                    s = plain_bent(&mesh, precision, threads, ev);
                }
                print!("{size} {} {threads}T:", precision.name());
                for (name, e, f, t) in [
                    ("energy", true, false, None),
                    ("force", false, true, None),
                    ("exact", false, false, Some(TangentKind::Exact)),
                    ("projected", false, false, Some(TangentKind::Projected)),
                ] {
                    request(&mut s, e, f, t);
                    let reps = if n > 200_000 { 8 } else { (6_000_000 / n).min(400) };
                    let reps = if t.is_some() { reps / 4 + 3 } else { reps };
                    let mut best = f64::INFINITY;
                    for _ in 0..reps {
                        let c = Instant::now();
                        evaluate(&mut s);
                        best = best.min(c.elapsed().as_secs_f64());
                    }
                    print!("  {name} {:.2}", best * 1e9 / n as f64);
                }
                println!();
            }
        }
    }
}

fn plain_bent(
    mesh: &sinew::engine::mesh::Mesh,
    precision: Precision,
    threads: usize,
    evaluation: Evaluation,
) -> Simulation {
    let mut s =
        Simulation::new(SimulationOptions { precision, threads, ..Default::default() }).unwrap();
    let body = s
        .add_body(&BodyDescription {
            name: "beam",
            points: &mesh.points,
            tetrahedra: &mesh.tetrahedra,
            material: YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.45, density: 1000.0 },
            model: Model::StVK,
            evaluation,
        })
        .unwrap();
    let u: Vec<_> = mesh
        .points
        .iter()
        .map(|x| {
            let r0 = 0.4;
            let (si, co) = (x.x / r0).sin_cos();
            let r = r0 + x.z;
            glam::DVec3::new(r * si, x.y, r * co - r0) - *x
        })
        .collect();
    s.set_state(body, &u, &vec![glam::DVec3::ZERO; u.len()]).unwrap();
    s
}
