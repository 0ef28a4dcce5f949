//! Surfaces finer than the tissue that carries them, through cuts and removals.

use crate::common::*;
use glam::{DMat3, DVec2, DVec3};
use sinew::engine::mesh::generate::{
    box_hexahedra, box_tets, jitter_interior, sphere_triangles, triangle_grid,
};
use sinew::engine::scalar::Scalar;
use sinew::engine::topology::Topology;
use sinew::engine::vertex::{Displacement, RestPosition};
use sinew::models::body::sheet::MembraneDescription;
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

/// Ten-node tetrahedra with straight sides, hexahedra, and distorted ones.
fn other_elements() -> [Mesh; 3] {
    let tetrahedra = jitter_interior(&box_tets(DVec3::splat(SIZE), [3; 3]).unwrap(), 0.2, 5);
    let hexahedra = box_hexahedra(DVec3::splat(SIZE), [4; 3]).unwrap();
    let distorted = jitter_interior(&hexahedra, 0.2, 5).unwrap();
    [tetrahedra.unwrap().with_second_order(), hexahedra, distorted]
}

fn cuttable(mesh: &Mesh, precision: Precision) -> (Simulation, BodyHandle) {
    let body = BodyDescription::new("block", mesh, soft(1e4, 0.3));
    alone(options(precision, 2), &BodyDescription { spare: 6 * mesh.points.len(), ..body })
}

/// Moves all rows of a body alone, those that cuts made among them, by what is said of their places at rest (m), and of whether it is a vertex of the mesh.
fn displace(simulation: &mut Simulation, by: &dyn Fn(DVec3, bool) -> DVec3) {
    fn all<S: Scalar>(simulation: &mut Simulation, by: &dyn Fn(DVec3, bool) -> DVec3) {
        let world = simulation.world_mut();
        let vertices = world.resource::<Topology>().bodies[0].mesh_vertices();
        let mut query = world.query::<(&RestPosition, &mut Displacement<S>)>();
        for (row, (rest, mut u)) in query.iter_mut(world).enumerate() {
            u.set(by(rest.0, row < vertices));
        }
    }
    match simulation.precision() {
        Precision::F32 => all::<f32>(simulation, by),
        Precision::F64 => all::<f64>(simulation, by),
    }
}

const BLADE: [[DVec3; 2]; 2] = [
    [DVec3::new(0.0247, -0.02, 0.08), DVec3::new(0.0343, -0.02, -0.02)],
    [DVec3::new(0.0247, 0.08, 0.08), DVec3::new(0.0343, 0.08, -0.02)],
];

/// Distance (m) of a place from the blade, to the right.
fn beyond(x: DVec3) -> f64 {
    let normal = (BLADE[1][0] - BLADE[0][0]).cross(BLADE[0][1] - BLADE[0][0]);
    (x - BLADE[0][0]).dot(normal.normalize()) * normal.x.signum()
}

/// Points move by the shape functions of what they lie in: affinely as the body does, and by a field that the element has and no linear
/// one. So it is of wounds.
#[test]
fn points_move_by_the_shape_functions_of_any_element() {
    let turn = DMat3::from_cols(
        DVec3::new(0.2, 0.3, -0.1),
        DVec3::new(0.0, -0.1, 0.4),
        DVec3::new(-0.2, 0.1, 0.1),
    );
    let affine = |x: DVec3| turn * x + DVec3::new(0.01, 0.02, -0.03);
    let quadratic = |x: DVec3| DVec3::new(x.x * x.y, x.z * x.z, x.x * x.x - x.y * x.z) / SIZE;
    let trilinear = |x: DVec3| DVec3::new(x.x * x.y * x.z, x.y * x.z * SIZE, 0.0) / SIZE.powi(2);
    let [ten, hexahedra, distorted] = other_elements();
    let cases: [(&Mesh, Vec<&dyn Fn(DVec3) -> DVec3>); 3] = [
        (&ten, vec![&affine, &quadratic]),
        (&hexahedra, vec![&affine, &trilinear]),
        (&distorted, vec![&affine]),
    ];
    for (mesh, fields) in cases {
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 1e-6)] {
            for factor in [1.0, 1.04, 0.9] {
                let (mut simulation, body) = cuttable(mesh, precision);
                let (points, triangles) = shell(factor);
                let own = simulation.carry_surface(body, &points, &triangles).unwrap();
                assert_eq!((own.outside > 0, own.long), (factor > 1.0, 0));
                let first = mesh.points.len();
                for cuts in 0..2 {
                    if cuts == 1 {
                        displace(&mut simulation, &|_, _| DVec3::ZERO);
                        assert_eq!(simulation.cut(body, &BLADE).unwrap().pieces, 2);
                    }
                    let mut skin = simulation.skin(body).unwrap();
                    assert!(skin.rest[first..].starts_with(&points));
                    assert_eq!(skin.wound.contains(&true), cuts == 1);
                    assert!(max_distance(&skin.points, &skin.rest) < 1e-12 * SIZE);
                    for field in &fields {
                        displace(&mut simulation, &|x, _| field(x));
                        assert!(!simulation.update_skin(body, &mut skin).unwrap());
                        let moved = skin.points.iter().zip(&skin.rest);
                        let off = moved.map(|(x, rest)| x.distance(*rest + field(*rest)));
                        let off = off.fold(0.0, f64::max);
                        assert!(off < tolerance * SIZE, "{factor} {cuts}: {off}");
                    }
                }
            }
        }
    }
}

/// At rest both sides of a wound are at one place and the surface is what it was; when the right half is moved, each point goes with its
/// half alone.
#[test]
fn each_half_of_any_element_takes_its_surface_along() {
    let away = DVec3::new(0.03, 0.001, -0.002);
    for mesh in &other_elements() {
        for (precision, tolerance) in [(Precision::F64, 1e-12), (Precision::F32, 1e-6)] {
            for factor in [1.0, 0.9] {
                let (mut simulation, body) = cuttable(mesh, precision);
                let (points, triangles) = shell(factor);
                simulation.carry_surface(body, &points, &triangles).unwrap();
                assert_eq!(simulation.cut(body, &BLADE).unwrap().pieces, 2);
                let mut skin = simulation.skin(body).unwrap();
                let outside = 6.0 * (SIZE * factor).powi(2);
                assert!((area(&skin, &skin.rest, false) / outside - 1.0).abs() < 1e-12);
                // vertices of the mesh are of the half that they lie in, those that cuts made of the other
                displace(&mut simulation, &|x, is_vertex| {
                    if (beyond(x) > 0.0) == is_vertex { away } else { DVec3::ZERO }
                });
                assert!(!simulation.update_skin(body, &mut skin).unwrap());
                let goes = |v: u32| {
                    let u = skin.points[v as usize] - skin.rest[v as usize];
                    let [stays, goes] = [DVec3::ZERO, away].map(|way| u.distance(way));
                    assert!(stays.min(goes) < tolerance * SIZE, "{factor}: {u}");
                    goes < stays
                };
                let first = (mesh.points.len() + points.len()) as u32;
                let mut lips = BTreeMap::<[u64; 3], Vec<bool>>::new();
                let all = skin.triangles.iter().zip(&skin.wound);
                for (t, _) in all.filter(|(_, wound)| !**wound) {
                    let half = goes(t[0]);
                    assert!(t.iter().all(|v| goes(*v) == half), "{t:?} is between both halves");
                    for &v in t {
                        let at = skin.rest[v as usize];
                        // the wound of distorted hexahedra is not plane
                        let is_plain = beyond(at).abs() > 0.1 * SIZE / 4.0;
                        assert!(!is_plain || half == (beyond(at) > 0.0), "{at}");
                        if v >= first {
                            let at = at.to_array().map(f64::to_bits);
                            lips.entry(at).or_default().push(half);
                        }
                    }
                }
                let both = |own: &&Vec<bool>| own.contains(&true) && own.contains(&false);
                assert!(lips.len() > 50 && lips.values().filter(both).count() == lips.len());
                // the edges of the wound are those of the surface
                let volume = volume(&skin, &skin.rest) / (SIZE * factor).powi(3);
                assert!((volume - 1.0).abs() < 2e-3 || factor < 1.0, "{factor}: {volume}");
            }
        }
    }
}

/// A second cut and removals after a first; the state between them comes back, in a simulation of its own, too.
#[test]
fn cuts_of_any_element_go_on_from_snapshots() {
    for mesh in &other_elements() {
        let (points, triangles) = shell(1.0);
        let new = || {
            let (mut simulation, body) = cuttable(mesh, Precision::F64);
            simulation.carry_surface(body, &points, &triangles).unwrap();
            clamp(&mut simulation, body, mesh, "x0");
            (simulation, body)
        };
        let second = [
            [DVec3::new(-0.02, 0.0217, 0.08), DVec3::new(-0.02, 0.0271, -0.02)],
            [DVec3::new(0.08, 0.0217, 0.08), DVec3::new(0.08, 0.0271, -0.02)],
        ];
        let centre = DVec3::new(0.012, 0.05, 0.06);
        let goes_on = |simulation: &mut Simulation, body| {
            simulation.cut(body, &second).unwrap();
            let cut = simulation.skin(body).unwrap();
            let outside = 6.0 * SIZE.powi(2);
            assert!((area(&cut, &cut.rest, false) / outside - 1.0).abs() < 1e-9);
            let region = Region::Sphere { centre, radius: 0.02 };
            assert!(simulation.remove_elements(body, &Removal::new(region)).unwrap().volume > 0.0);
            simulation.steps(2);
            let skin = simulation.skin(body).unwrap();
            assert!(skin.points.iter().all(|p| p.is_finite()));
            // nothing of the surface is left in the middle of what is gone
            let near = |v: &u32| skin.rest[*v as usize].distance(centre) < 0.002;
            assert!(
                cut.triangles
                    .iter()
                    .flatten()
                    .any(|v| cut.rest[*v as usize].distance(centre) < 0.002)
            );
            assert!(!skin.triangles.iter().flatten().any(near));
            (skin.points, skin.triangles)
        };
        let (mut simulation, body) = new();
        simulation.cut(body, &BLADE).unwrap();
        simulation.steps(2);
        let snapshot = simulation.snapshot().unwrap();
        let between = simulation.skin(body).unwrap();
        let expected = goes_on(&mut simulation, body);
        let (mut other, same) = new();
        for (simulation, body) in [(&mut simulation, body), (&mut other, same)] {
            simulation.restore(&snapshot).unwrap();
            let skin = simulation.skin(body).unwrap();
            assert_eq!((&skin.points, &skin.triangles), (&between.points, &between.triangles));
            assert!(expected == goes_on(simulation, body));
        }
    }
}

#[test]
fn a_membrane_alone_carries_no_surface() {
    let film = triangle_grid(DVec2::splat(SIZE), [5; 2]).unwrap();
    let membrane = MembraneDescription::new(&film.triangles, 1e-3, soft(1e4, 0.3));
    let body = BodyDescription { spare: 100, ..sheet(&film.points, membrane) };
    let (mut simulation, body) = alone(options(Precision::F64, 1), &body);
    let error = simulation.carry_surface(body, &film.points, &film.triangles).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("tetrahedra or hexahedra") && error.contains("`sheet`"), "{error}");
    assert!(!simulation.carries_surface(body));
}
