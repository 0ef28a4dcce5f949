//! Shapes of tools.

use glam::{Quat, Vec3};
use sinew_render::rigid::{Placed, Rigid};
use std::f32::consts::PI;

/// Volume by the divergence theorem; normals point the way of their faces.
fn volume(shape: &Rigid) -> f32 {
    let mut sum = 0.0;
    for t in &shape.triangles {
        let p = t.map(|v| Vec3::from_array(shape.points[v as usize]));
        let normal = (p[1] - p[0]).cross(p[2] - p[0]).normalize();
        for v in t {
            let own = Vec3::from_array(shape.normals[*v as usize]);
            assert!((own.length() - 1.0).abs() < 1e-5 && own.dot(normal) > 0.9, "{own} {normal}");
        }
        sum += p[0].dot(p[1].cross(p[2])) / 6.0;
    }
    sum
}

/// Every edge, by the places of its ends, is passed once each way.
fn is_closed(shape: &Rigid) -> bool {
    let mut edges = std::collections::HashMap::new();
    let key = |v: u32| shape.points[v as usize].map(|x| (x * 1e5).round() as i32);
    for t in &shape.triangles {
        for k in 0..3 {
            let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
            if a != b {
                *edges.entry((a, b)).or_insert(0) += 1;
                *edges.entry((b, a)).or_insert(0) -= 1;
            }
        }
    }
    edges.values().all(|n| *n == 0)
}

#[test]
fn boxes_balls_and_rods_are_closed_and_turned_outward() {
    let boxed = |x: f32, y: f32, z: f32, r: f32| {
        let (a, b, c) = (x - r, y - r, z - r);
        let slabs = 8.0 * (a * b * c + r * (a * b + b * c + c * a));
        slabs + 2.0 * PI * r * r * (a + b + c) + 4.0 / 3.0 * PI * r.powi(3)
    };
    for [x, y, z, r] in
        [[0.5, 0.5, 0.5, 0.5], [1.4, 0.3, 0.3, 0.3], [1.0, 0.7, 0.4, 0.1], [1.0, 0.4, 0.7, 0.4]]
    {
        let shape = Rigid::rounded_box(Vec3::new(x, y, z), r, [9; 3]);
        let (found, exact) = (volume(&shape), boxed(x, y, z, r));
        assert!(found < exact && found > 0.98 * exact, "{found} beside {exact}");
        assert!(is_closed(&shape));
        let reach = |k: usize| shape.points.iter().map(|p| p[k]).fold(0.0, f32::max);
        assert!((Vec3::new(reach(0), reach(1), reach(2)) - Vec3::new(x, y, z)).length() < 1e-5);
    }
}

#[test]
fn the_surface_of_a_plate_is_that_of_its_half_space() {
    let shape = Rigid::plate([-1.0, 2.0], [3.0, 5.0], 0.1, [9; 3]);
    assert!((volume(&shape) - 4.0 * 3.0 * 0.1).abs() < 0.02 && is_closed(&shape));
    let of = |k: usize| shape.points.iter().map(move |p| p[k]);
    let low = [0, 1, 2].map(|k| of(k).fold(f32::INFINITY, f32::min));
    let high = [0, 1, 2].map(|k| of(k).fold(f32::NEG_INFINITY, f32::max));
    for (found, wanted) in low.into_iter().chain(high).zip([-1.0, 2.0, -0.1, 3.0, 5.0, 0.0]) {
        assert!((found - wanted).abs() < 1e-5, "{low:?} {high:?}");
    }
    // the outline holds its corners
    let outline = shape.outline();
    assert!(outline.len() <= 26 && outline.iter().any(|p| p[0] > 2.98 && p[1] > 4.98));
}

#[test]
fn meshes_keep_their_sharp_edges() {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let shape = Rigid::mesh(&points, &triangles, 40.0, [9; 3]);
    assert_eq!(shape.points.len(), 12);
    assert!((volume(&shape) - 1.0 / 6.0).abs() < 1e-6);
}

#[test]
fn what_is_carried_comes_back() {
    let turn = Quat::from_rotation_z(0.5 * PI).to_array();
    let placed = Placed { shape: 0, at: [1.0, 2.0, 3.0], turn };
    let there = placed.carry([1.0, 0.0, 0.0]);
    assert!((there - Vec3::new(1.0, 3.0, 3.0)).length() < 1e-6);
    assert!((placed.local(there) - Vec3::X).length() < 1e-6);
}
