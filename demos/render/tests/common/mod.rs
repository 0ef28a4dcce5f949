//! A recording without any simulation: a bar that bends to an arc.

use glam::Vec3;
use sinew_render::colour::ColourMap;
use sinew_render::scene::{Arrow, Ball, Cell, Field, Frame, Recording, Rod};
use sinew_render::skin::{CREASE_ANGLE, Facet, Skin};
use std::sync::Arc;

const CELLS: [u32; 3] = [16, 4, 4];

/// Where a point of the bar (0 to 1 along, -0.1 to 0.1 across) goes when it bends by `angle` (rad).
fn bent([x, y, z]: [f32; 3], angle: f32) -> [f32; 3] {
    if angle == 0.0 {
        return [x, y, z];
    }
    let radius = 1.0 / angle;
    let (sin, cos) = (x * angle).sin_cos();
    [(radius + z) * sin, y, (radius + z) * cos - radius]
}

/// Four frames, from straight to a bend of 1.2 rad; colours by displacement.
pub fn bar() -> Recording {
    let [nx, ny, nz] = CELLS;
    let index = |i: u32, j: u32, k: u32| (i * (ny + 1) + j) * (nz + 1) + k;
    let mut rest = Vec::new();
    for i in 0..=nx {
        for j in 0..=ny {
            for k in 0..=nz {
                let at = |a: u32, n: u32| 0.2 * a as f32 / n as f32 - 0.1;
                rest.push([i as f32 / nx as f32, at(j, ny), at(k, nz)]);
            }
        }
    }
    let mut facets: Vec<Facet> = Vec::new();
    let mut quad = |a: u32, b: u32, c: u32, d: u32| facets.extend([([a, b, c], 0), ([a, c, d], 0)]);
    for i in 0..nx {
        for j in 0..ny {
            let p = |k: u32, a: u32, b: u32| index(i + a, j + b, k);
            quad(p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0));
            quad(p(nz, 0, 0), p(nz, 1, 0), p(nz, 1, 1), p(nz, 0, 1));
        }
        for k in 0..nz {
            let p = |j: u32, a: u32, b: u32| index(i + a, j, k + b);
            quad(p(0, 0, 0), p(0, 1, 0), p(0, 1, 1), p(0, 0, 1));
            quad(p(ny, 0, 0), p(ny, 0, 1), p(ny, 1, 1), p(ny, 1, 0));
        }
    }
    for j in 0..ny {
        for k in 0..nz {
            let p = |i: u32, a: u32, b: u32| index(i, j + a, k + b);
            quad(p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0));
            quad(p(nx, 0, 0), p(nx, 1, 0), p(nx, 1, 1), p(nx, 0, 1));
        }
    }
    let skin = Arc::new(Skin::new(&facets, &rest, CREASE_ANGLE));
    let frames = (0..4u64)
        .map(|i| {
            let angle = 0.4 * i as f32;
            let points: Vec<[f32; 3]> = rest.iter().map(|p| bent(*p, angle)).collect();
            let moved = |(p, x): (&[f32; 3], &[f32; 3])| {
                Vec3::from_array(*p).distance(Vec3::from_array(*x))
            };
            let values = points.iter().zip(&rest).map(moved).collect();
            let held = (0..=ny).flat_map(|j| (0..=nz).map(move |k| index(0, j, k) as usize));
            let balls =
                held.map(|v| Ball { centre: points[v], radius: 0.012, colour: [58, 70, 90] });
            let rod = |i: u32| {
                let at = |x: f32| bent([x, -0.102, 0.0], angle);
                let x = i as f32 / 8.0;
                Rod { ends: [at(x + 0.02), at(x + 0.1)], colour: [248, 248, 244] }
            };
            let tip = bent([1.0, 0.0, 0.1], angle);
            let arrow = Arrow { to: tip, along: [0.0, 0.0, -0.25], colour: [196, 48, 58] };
            Frame {
                step: i,
                time: 0.5 * i as f64,
                balls: balls.collect(),
                rods: (0..8).map(rod).collect(),
                tools: Vec::new(),
                arrows: if i > 0 { vec![arrow] } else { Vec::new() },
                points,
                skin: skin.clone(),
                fields: vec![values],
                note: format!("step {i}"),
            }
        })
        .collect();
    let mut cells = Vec::new();
    for corner in 0..nx * ny * nz {
        let (i, j, k) = (corner / (ny * nz), corner / nz % ny, corner % nz);
        let p = |a: u32, b: u32, c: u32| index(i + a, j + b, k + c);
        // from corner to corner of a cube, along three edges in every order
        for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
            let unit = |axes: &[u32]| {
                let [x, y, z] = [0, 1, 2].map(|axis| u32::from(axes.contains(&axis)));
                p(x, y, z)
            };
            let points = [p(0, 0, 0), unit(&[a]), unit(&[a, b]), p(1, 1, 1)];
            cells.push(Cell { points, body: 0, born: 0, gone: u32::MAX });
        }
    }
    Recording {
        cells,
        title: "Bar".into(),
        subtitle: "bends to an arc".into(),
        up: Vec3::Z,
        rest_skin: skin,
        rest,
        fields: vec![displacement(0.65)],
        bodies: vec!["bar".into()],
        interval: 0.5,
        frames,
        ..Recording::default()
    }
}

/// The field of displacements up to a length (m).
pub fn displacement(most: f32) -> Field {
    Field {
        name: "displacement".into(),
        label: "displacement".into(),
        unit: "m".into(),
        map: ColourMap::Viridis,
        range: [0.0, most],
    }
}
