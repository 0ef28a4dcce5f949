//! Surfaces finer than the tissue that carries them, through cuts and removals.

use crate::common::*;
use glam::DVec3;
use sinew::engine::mesh::generate::{box_tets, jitter_interior, sphere_triangles};
use sinew::models::cutting::MaterialSkin;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;
use std::collections::BTreeMap;

const SIZE: f64 = 0.06;

/// A block of edges of 12 mm that can be cut, held on its left side.
fn block() -> (Simulation, BodyHandle, Mesh) {
    let mesh = jitter_interior(&box_tets(DVec3::splat(SIZE), [5; 3]).unwrap(), 0.2, 5).unwrap();
    let body = BodyDescription::new("block", &mesh, soft(1e4, 0.3));
    let spare = 6 * mesh.points.len();
    let (mut simulation, body) =
        alone(options(Precision::F64, 2), &BodyDescription { spare, ..body });
    clamp(&mut simulation, body, &mesh, "x0");
    (simulation, body, mesh)
}

/// The sides of the block in edges of 3.5 mm, moved away from its middle.
fn shell(factor: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let fine = box_tets(DVec3::splat(SIZE), [17; 3]).unwrap();
    let middle = DVec3::splat(0.5 * SIZE);
    let moved = fine.points.iter().map(|p| middle + (*p - middle) * factor);
    (moved.collect(), fine.surface_triangles())
}

fn area(skin: &MaterialSkin, at: &[DVec3], wound: bool) -> f64 {
    let own = skin.triangles.iter().zip(&skin.wound).filter(|(_, own)| **own == wound);
    own.map(|(t, _)| t.map(|v| at[v as usize]))
        .map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length())
        .sum()
}

fn volume(skin: &MaterialSkin, at: &[DVec3]) -> f64 {
    let corners = skin.triangles.iter().map(|t| t.map(|v| at[v as usize]));
    corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

/// Edges that have but one triangle, each way counted by itself.
fn open_edges(skin: &MaterialSkin) -> usize {
    let mut count = BTreeMap::<[u32; 2], i32>::new();
    for t in &skin.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *count.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    count.values().filter(|own| **own != 0).count()
}

/// A cut right through: at rest the surface is what it was, its lips are where the blade was, and each side of it moves with its side of
/// the tissue alone.
#[test]
fn both_sides_of_a_wound_have_their_part_of_the_surface() {
    for factor in [1.0, 1.04, 0.97] {
        let (mut simulation, body, mesh) = block();
        let (points, triangles) = shell(factor);
        let own = simulation.carry_surface(body, &points, &triangles).unwrap();
        assert_eq!(own.outside > 0, factor > 1.0);
        let whole = simulation.skin(body).unwrap();
        assert_eq!((whole.triangles.len(), open_edges(&whole)), (triangles.len(), 0));
        let first = mesh.points.len();
        for (p, at) in points.iter().zip(&whole.points[first..]) {
            assert!(p.distance(*at) < 1e-15);
        }
        let edge = |y: f64| [DVec3::new(0.028, y, 0.08), DVec3::new(0.033, y, -0.02)];
        let blade = (edge(0.0)[1] - edge(0.0)[0]).cross(DVec3::Y).normalize();
        assert_eq!(simulation.cut(body, &[edge(-0.02), edge(0.08)]).unwrap().pieces, 2);
        let mut skin = simulation.skin(body).unwrap();
        let outside = 6.0 * (SIZE * factor).powi(2);
        assert!((area(&skin, &skin.rest, false) / outside - 1.0).abs() < 1e-12);
        assert!(skin.triangles.len() > triangles.len() + 100);
        // its edges meet those of the wound but for the chords between the points of both
        let within = (volume(&skin, &skin.rest) / (SIZE * factor).powi(3) - 1.0).abs();
        assert!(within < 2e-3, "{factor}: {within}");
        // its points keep their numbers
        assert!(skin.rest[first..].starts_with(&points));
        let outside = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| !**wound);
        let made = |v: &&u32| **v as usize >= first + points.len();
        let lips: Vec<u32> = outside.flat_map(|(t, _)| t).filter(made).copied().collect();
        let lips: Vec<DVec3> = lips.iter().map(|&v| skin.rest[v as usize]).collect();
        assert!(lips.len() > 200);
        let off = |x: &DVec3| (*x - edge(0.0)[0]).dot(blade).abs();
        let farthest = lips.iter().map(off).fold(0.0, f64::max);
        // inside of the tissue where the blade was, outside where the nearest tissue comes apart
        let bound = if factor > 1.0 { 0.2 } else { 2e-3 } * SIZE / 5.0;
        assert!(farthest < bound, "{factor}: {farthest}");
        // what is cut off falls, and is stretched nowhere
        simulation.steps(12);
        assert!(!simulation.update_skin(body, &mut skin).unwrap());
        let fallen = |v: u32| skin.rest[v as usize].z - skin.points[v as usize].z;
        let mut loose = 0;
        for t in &skin.triangles {
            let falls = t.map(|v| fallen(v) > 0.05);
            assert!(falls == [falls[0]; 3], "{factor}: {t:?} is drawn between both sides");
            loose += u32::from(falls[0]);
        }
        assert!(loose > 500, "{loose}");
    }
}

/// Random cuts and removals: surfaces keep their area as long as nothing is removed, and end nowhere but at wounds.
#[test]
fn surfaces_follow_random_cuts_and_removals() {
    let mut next = random_numbers(23);
    for factor in [1.0, 1.05] {
        let (mut simulation, body, _) = block();
        let (points, triangles): (Vec<DVec3>, _) = match factor {
            1.0 => shell(1.0),
            _ => {
                let ball = sphere_triangles(0.5 * SIZE * factor, 12).unwrap();
                let moved = ball.points.iter().map(|p| *p + DVec3::splat(0.5 * SIZE));
                (moved.collect(), ball.triangles)
            }
        };
        simulation.carry_surface(body, &points, &triangles).unwrap();
        let mut skin = simulation.skin(body).unwrap();
        let whole = area(&skin, &skin.rest, false);
        for round in 0..12 {
            let mut point = || DVec3::from([0; 3].map(|_| next(1000) as f64 * 8e-5 - 0.01));
            let (a, b, c) = (point(), point(), point());
            simulation.cut(body, &[[a, b], [a + c - b, c]]).unwrap();
            assert!(simulation.update_skin(body, &mut skin).unwrap() || round > 0);
            let now = area(&skin, &skin.rest, false);
            assert!((now / whole - 1.0).abs() < 1e-9, "{factor} {round}: {now} {whole}");
            simulation.step().unwrap();
            simulation.update_skin(body, &mut skin).unwrap();
            assert!(skin.points.iter().all(|p| p.is_finite()));
        }
        let middle = Region::Sphere { centre: DVec3::splat(0.5 * SIZE), radius: 0.02 };
        simulation.remove_elements(body, &Removal::new(middle)).unwrap();
        simulation.update_skin(body, &mut skin).unwrap();
        // what it lays open is neither a wound nor of the surface
        assert!(skin.points.iter().all(|p| p.is_finite()));
        assert!(skin.triangles.iter().flatten().all(|&v| (v as usize) < skin.points.len()));
    }
}

/// Where elements of a cut body are gone, so is what they carried; elsewhere nothing is.
#[test]
fn what_is_removed_carries_nothing() {
    let (mut simulation, body, _) = block();
    let (points, triangles) = shell(1.0);
    simulation.carry_surface(body, &points, &triangles).unwrap();
    let edge = |y: f64| [DVec3::new(0.028, y, 0.08), DVec3::new(0.033, y, -0.02)];
    simulation.cut(body, &[edge(-0.02), edge(0.08)]).unwrap();
    let mut skin = simulation.skin(body).unwrap();
    let whole = skin.triangles.len();
    // on both sides of the cut
    let centre = DVec3::new(0.03, 0.0, 0.03);
    let region = Region::Sphere { centre, radius: 0.015 };
    simulation.remove_elements(body, &Removal::new(region)).unwrap();
    assert!(simulation.update_skin(body, &mut skin).unwrap());
    assert!(skin.triangles.len() + 20 < whole);
    let outside = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| !**wound);
    let away = |v: &u32| skin.rest[*v as usize].distance(centre);
    let of_surface = |v: &&u32| {
        let at = skin.rest[**v as usize];
        at.min(DVec3::splat(SIZE) - at).min_element() < 1e-6
    };
    let away: Vec<f64> = outside.flat_map(|(t, _)| t).filter(of_surface).map(away).collect();
    // what was laid open is there, without a wound
    let inside = |v: &u32| {
        let at = skin.rest[*v as usize];
        at.min(DVec3::splat(SIZE) - at).min_element() > 1e-3
    };
    let outside = skin.triangles.iter().zip(&skin.wound).filter(|(_, wound)| !**wound);
    assert!(outside.filter(|(t, _)| t.iter().any(inside)).count() > 10);
    // elements have edges of 12 mm and are taken by their middles
    assert!(away.iter().all(|away| *away > 0.005) && away.iter().any(|away| *away < 0.025));
}

#[test]
fn what_cannot_be_carried_is_told() {
    let (mut simulation, body, mesh) = block();
    let (points, triangles) = shell(1.0);
    for (points, triangles) in [
        (&points[..10], &triangles[..]),
        (&points[..], &[][..]),
        (&[DVec3::NAN; 3][..], &[[0, 1, 2]][..]),
    ] {
        let error = simulation.carry_surface(body, points, triangles).unwrap_err().to_string();
        assert!(error.contains("`block`") && error.contains("surface"), "{error}");
    }
    assert_eq!(simulation.skin(body).unwrap().triangles.len(), mesh.surface_triangles().len());
    let whole = BodyDescription::new("other", &mesh, soft(1e4, 0.3));
    let (mut simulation, body) = alone(options(Precision::F64, 1), &whole);
    let error = simulation.carry_surface(body, &points, &triangles).unwrap_err().to_string();
    assert!(error.contains("`other`") && error.contains("spare"), "{error}");
}
