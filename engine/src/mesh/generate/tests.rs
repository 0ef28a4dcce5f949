//! Counts, volumes, winding, conformity and groups of what the generators make.

use super::*;
use crate::element::TETRAHEDRON_FACES;
use crate::mesh::cell::quad_triangles;
use crate::mesh::{CheckOptions, check};
use glam::{DVec2, Vec3Swizzles};
use std::f64::consts::PI;

#[test]
fn discs_and_spheres_of_triangles() {
    let area = |mesh: &Mesh| -> DVec3 {
        let p = |i: u32| mesh.points[i as usize];
        let normal = |&[a, b, c]: &[u32; 3]| 0.5 * (p(b) - p(a)).cross(p(c) - p(a));
        mesh.triangles.iter().map(normal).sum()
    };
    let disc = disc_triangles(2.0, 5).unwrap();
    assert_eq!((disc.points.len(), disc.triangles.len()), (91, 150));
    // a polygon of 30 sides
    let polygon = 0.5 * 30.0 * 4.0 * (2.0 * PI / 30.0).sin();
    assert!((area(&disc) - polygon * DVec3::Z).length() < 1e-12);
    let rim = &disc.group("rim").unwrap().vertices;
    assert_eq!(rim.len(), 30);
    assert!(rim.iter().all(|&v| (disc.points[v as usize].length() - 2.0).abs() < 1e-12));
    let sphere = sphere_triangles(0.5, 8).unwrap();
    assert_eq!((sphere.points.len(), sphere.triangles.len()), (642, 1280));
    assert!(sphere.points.iter().all(|p| (p.length() - 0.5).abs() < 1e-12));
    assert!(area(&sphere).length() < 1e-12);
    let outward = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| sphere.points[v as usize]);
        (b - a).cross(c - a).dot(a) > 0.0
    };
    assert!(sphere.triangles.iter().all(outward));
    assert!(disc_triangles(-1.0, 5).is_err() && sphere_triangles(1.0, 0).is_err());
}

/// All volumes positive, their sum as enclosed by the surface, and every vertex used.
fn sound(mesh: &Mesh) -> f64 {
    for &tet in &mesh.tetrahedra {
        assert!(volume(&mesh.points, tet) > 0.0, "{}", mesh.source);
    }
    let enclosed = enclosed(mesh);
    let total = mesh.total_volume();
    // Sums of n rounded terms.
    assert!((enclosed - total).abs() <= 1e-12 * total, "{} {enclosed} {total}", mesh.source);
    let mut used = vec![false; mesh.points.len()];
    mesh.tetrahedra.iter().flatten().for_each(|&v| used[v as usize] = true);
    assert!(used.iter().all(|&used| used));
    let body = mesh.group("body").unwrap();
    assert_eq!((body.dimension, body.cells.tetrahedra.len()), (3, mesh.tetrahedra.len()));
    total
}

#[test]
fn box_is_exact_and_ordered() {
    let mesh = box_tets(DVec3::new(3.0, 1.0, 0.5), [3, 2, 4]).unwrap();
    assert_eq!(mesh.points.len(), 60);
    assert_eq!(mesh.tetrahedra.len(), 144);
    assert!((sound(&mesh) - 1.5).abs() < 1e-14);
    assert_eq!(mesh.points[(2 * 3 + 1) * 5 + 3], DVec3::new(2.0, 0.5, 0.375));
    for (name, axis, value) in [
        ("x0", 0, 0.0),
        ("x1", 0, 3.0),
        ("y0", 1, 0.0),
        ("y1", 1, 1.0),
        ("z0", 2, 0.0),
        ("z1", 2, 0.5),
    ] {
        let group = mesh.group(name).unwrap();
        let on: Vec<u32> =
            (0..60).filter(|&i| mesh.points[i as usize].to_array()[axis] == value).collect();
        assert_eq!((group.dimension, &group.vertices), (2, &on), "{name}");
        let triangles = group.cells.triangles.iter().map(|&i| mesh.triangles[i as usize]);
        assert!(triangles.flatten().all(|v| on.contains(&v)));
    }
}

#[test]
fn cylinder_fills_its_polygon() {
    for (rings, layers) in [(1, 1), (2, 3), (5, 4)] {
        let mesh = cylinder_tets(0.5, 2.0, rings, layers).unwrap();
        let sides = 6.0 * rings as f64;
        let polygon = 0.5 * sides * 0.25 * (2.0 * PI / sides).sin();
        assert!((sound(&mesh) - 2.0 * polygon).abs() < 1e-13);
        assert_eq!(mesh.tetrahedra.len(), 18 * rings * rings * layers);
        for name in ["x0", "x1"] {
            assert_eq!(mesh.group(name).unwrap().cells.triangles.len(), 6 * rings * rings);
        }
        assert_eq!(mesh.group("side").unwrap().cells.triangles.len(), 12 * rings * layers);
    }
}

#[test]
fn ball_approaches_its_volume() {
    for n in [1, 2, 3, 6, 12] {
        let mesh = sphere_tets(2.0, n).unwrap();
        assert_eq!(mesh.tetrahedra.len(), 20 * n * n * n);
        let shells: usize = (1..=n).map(|k| 10 * k * k + 2).sum();
        assert_eq!(mesh.points.len(), 1 + shells);
        let exact = 4.0 / 3.0 * PI * 8.0;
        let defect = 1.0 - sound(&mesh) / exact;
        // The inscribed polyhedron misses a share that falls with n^2; 0.395 for the icosahedron.
        assert!(defect > 0.0 && defect < 0.4 / (n * n) as f64 * 1.6, "{n} {defect}");
        let surface = mesh.group("surface").unwrap();
        assert_eq!(surface.cells.triangles.len(), 20 * n * n);
        assert!(
            surface
                .vertices
                .iter()
                .all(|&v| (mesh.points[v as usize].length() - 2.0).abs() < 1e-15 * 4.0)
        );
    }
}

#[test]
fn grid_faces_up() {
    let mesh = triangle_grid(DVec2::new(2.0, 1.0), [4, 3]).unwrap();
    let p = |i: u32| mesh.points[i as usize];
    let area: f64 =
        mesh.triangles.iter().map(|&[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)).z / 2.0).sum();
    assert!((area - 2.0).abs() < 1e-14);
    assert_eq!(mesh.group("x0").unwrap().vertices, [0, 1, 2, 3]);
    assert_eq!(mesh.group("y1").unwrap().vertices, [3, 7, 11, 15, 19]);
    assert_eq!(mesh.group("body").unwrap().cells.triangles.len(), 24);
}

#[test]
fn jitter_keeps_the_surface_and_the_winding() {
    let mesh = box_tets(DVec3::ONE, [6, 6, 6]).unwrap();
    for fraction in [0.0, 0.2, 1.0] {
        let moved = jitter_interior(&mesh, fraction, 7).unwrap();
        assert!((sound(&moved) - 1.0).abs() < 1e-12);
        assert_eq!(moved.points, jitter_interior(&mesh, fraction, 7).unwrap().points);
        let n = mesh.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count();
        // 5^3 of 7^3 vertices lie inside.
        assert!(if fraction == 0.0 { n == 0 } else { n <= 125 && n > 100 }, "{n}");
    }
    let flat = triangle_grid(DVec2::ONE, [5, 5]).unwrap();
    let moved = jitter_interior(&flat, 0.4, 1).unwrap();
    assert_eq!(flat.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count(), 16);
    // The projection rounds.
    assert!(moved.points.iter().all(|p| p.z.abs() < 1e-16));
}

#[test]
fn bad_parameters_are_named() {
    let one = [1, 1, 1];
    for size in [DVec3::new(0.0, 1.0, 1.0), DVec3::new(1.0, f64::NAN, 1.0), -DVec3::ONE] {
        assert!(matches!(box_tets(size, one), Err(MeshError::InvalidParameter { .. })));
    }
    let error = box_tets(DVec3::ONE, [1, 0, 1]).unwrap_err();
    assert!(error.to_string().contains("cells[1] = 0"), "{error}");
    let huge = [1 << 20, 1 << 20, 1 << 20];
    assert!(matches!(box_tets(DVec3::ONE, huge), Err(MeshError::TooMany { .. })));
    assert!(matches!(box_tets(DVec3::ONE, [usize::MAX; 3]), Err(MeshError::TooMany { .. })));
    assert!(cylinder_tets(1.0, f64::INFINITY, 1, 1).is_err());
    assert!(cylinder_tets(1.0, 1.0, usize::MAX, usize::MAX).is_err());
    assert!(sphere_tets(-1.0, 2).is_err());
    assert!(sphere_tets(1.0, 1 << 40).is_err());
    assert!(triangle_grid(DVec2::ONE, [0, 2]).is_err());
    assert!(triangle_grid(DVec2::ONE, [usize::MAX, 2]).is_err());
    let mesh = box_tets(DVec3::ONE, one).unwrap();
    assert!(jitter_interior(&mesh, f64::NAN, 0).is_err());
}

/// Volume enclosed by the boundary faces that the generator lists, quads cut into triangles.
fn enclosed(mesh: &Mesh) -> f64 {
    let p = |i: u32| mesh.points[i as usize];
    let quads = mesh.quads.iter().flat_map(|&quad| quad_triangles(quad));
    let faces = mesh.triangles.iter().copied().chain(quads);
    faces.map(|[a, b, c]| p(a).dot(p(b).cross(p(c))) / 6.0).sum()
}

/// No finding, all vertices used, groups of faces that cover the surface once, and the volume.
fn sound_solid(mesh: &Mesh, sides: &[&str]) -> f64 {
    let options = CheckOptions { expected_size: None, strict: true };
    let checked = check(mesh, &options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(checked.report.findings, [], "{}", mesh.source);
    assert_eq!(checked.used_vertices.len(), mesh.points.len());
    let total = mesh.total_volume();
    assert!((enclosed(mesh) - total).abs() <= 1e-12 * total, "{}", mesh.source);
    let mut covered = vec![0; mesh.quads.len() + mesh.triangles.len()];
    for &side in sides {
        let group = mesh.group(side).unwrap();
        assert_eq!(group.dimension, 2);
        let mut vertices: Vec<u32> = Vec::new();
        for &quad in &group.cells.quads {
            covered[quad as usize] += 1;
            vertices.extend(mesh.quads[quad as usize]);
        }
        for &triangle in &group.cells.triangles {
            covered[mesh.quads.len() + triangle as usize] += 1;
            vertices.extend(mesh.triangles[triangle as usize]);
        }
        vertices.sort_unstable();
        vertices.dedup();
        assert_eq!(group.vertices, vertices, "{side}");
    }
    assert!(covered.iter().all(|&n| n == 1), "{}", mesh.source);
    let body = mesh.group("body").unwrap();
    assert_eq!((body.dimension, body.vertices.len()), (3, mesh.points.len()));
    assert_eq!(body.cells.hexahedra.len(), mesh.hexahedra.len());
    assert_eq!(body.cells.tetrahedra.len(), mesh.tetrahedra.len());
    total
}

/// No finding and the vector area (m^2), which is the area of a flat mesh that faces along z.
fn sound_sheet(mesh: &Mesh) -> f64 {
    let options = CheckOptions { expected_size: None, strict: true };
    let checked = check(mesh, &options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(checked.report.findings, [], "{}", mesh.source);
    assert_eq!(checked.used_vertices.len(), mesh.points.len());
    let p = |i: u32| mesh.points[i as usize];
    let quads = mesh.quads.iter().flat_map(|&quad| quad_triangles(quad));
    let faces = mesh.triangles.iter().copied().chain(quads);
    let areas = faces.map(|[a, b, c]| (p(b) - p(a)).cross(p(c) - p(a)).z / 2.0);
    areas.inspect(|area| assert!(*area > 0.0)).sum()
}

const SIX: [&str; 6] = ["x0", "x1", "y0", "y1", "z0", "z1"];

#[test]
fn box_of_hexahedra_has_the_vertices_and_groups_of_the_box_of_tetrahedra() {
    let size = DVec3::new(3.0, 1.0, 0.5);
    let mesh = box_hexahedra(size, [3, 2, 4]).unwrap();
    assert!((sound_solid(&mesh, &SIX) - 1.5).abs() < 1e-14);
    let tets = box_tets(size, [3, 2, 4]).unwrap();
    assert_eq!((mesh.hexahedra.len(), &mesh.points), (24, &tets.points));
    for name in SIX {
        let (of_hexes, of_tets) = (mesh.group(name).unwrap(), tets.group(name).unwrap());
        assert_eq!(of_hexes.vertices, of_tets.vertices);
        assert_eq!(2 * of_hexes.cells.quads.len(), of_tets.cells.triangles.len());
    }
    let split = mesh.split_into_simplices();
    assert!((sound_solid(&split, &SIX) - 1.5).abs() < 1e-14);
    assert_eq!(split.tetrahedra.len(), tets.tetrahedra.len());
}

#[test]
fn cylinder_of_hexahedra_fills_its_polygon() {
    for (core, rings, layers) in [(1, 1, 4), (2, 1, 6), (4, 3, 8), (7, 2, 8)] {
        let mesh = cylinder_hexahedra(0.5, 2.0, core, rings, layers).unwrap();
        let sides = 4.0 * core as f64;
        let polygon = 0.5 * sides * 0.25 * (2.0 * PI / sides).sin();
        let volume = sound_solid(&mesh, &["x0", "x1", "side"]);
        assert!((volume - 2.0 * polygon).abs() < 1e-13, "{core} {rings}: {volume} {polygon}");
        let per_layer = core * core + 4 * core * rings;
        assert_eq!(mesh.hexahedra.len(), per_layer * layers);
        assert_eq!(mesh.points.len(), ((core + 1).pow(2) + 4 * core * rings) * (layers + 1));
        assert_eq!(mesh.group("x0").unwrap().cells.quads.len(), per_layer);
        let side = mesh.group("side").unwrap();
        assert_eq!(side.cells.quads.len(), 4 * core * layers);
        let radius = |&v: &u32| mesh.points[v as usize].yz().length();
        assert!(side.vertices.iter().map(radius).all(|r| (r - 0.5).abs() < 1e-15));
        let split = mesh.split_into_simplices();
        assert!((sound_solid(&split, &["x0", "x1", "side"]) - volume).abs() < 1e-13);
        let quality = check(&mesh, &CheckOptions::default()).unwrap().report.statistics;
        assert!(quality.worst_quality > 0.45, "{core} {rings} {}", quality.worst_quality);
    }
}

#[test]
fn tube_fills_the_ring_between_two_polygons() {
    for n in [[6, 2, 3], [8, 2, 4], [25, 3, 7]] {
        let [around, through, along] = n;
        let mesh = tube_hexahedra(0.3, 0.2, 2.0, n).unwrap();
        let sides = around as f64;
        let ring = 0.5 * sides * (0.25 - 0.09) * (2.0 * PI / sides).sin();
        let names = ["x0", "x1", "inner", "outer"];
        let volume = sound_solid(&mesh, &names);
        assert!((volume - 2.0 * ring).abs() < 1e-13, "{n:?}: {volume} {ring}");
        assert_eq!(mesh.hexahedra.len(), around * through * along);
        assert_eq!(mesh.points.len(), around * (through + 1) * (along + 1));
        for (name, r) in [("inner", 0.3), ("outer", 0.5)] {
            let group = mesh.group(name).unwrap();
            assert_eq!(group.cells.quads.len(), around * along);
            let radius = |&v: &u32| mesh.points[v as usize].yz().length();
            assert!(group.vertices.iter().map(radius).all(|own| (own - r).abs() < 1e-15));
        }
        let split = mesh.split_into_simplices();
        assert!((sound_solid(&split, &names) - volume).abs() < 1e-13);
    }
}

#[test]
fn sheets_of_quadrilaterals() {
    let mesh = quad_grid(DVec2::new(2.0, 1.0), [4, 3]).unwrap();
    let cut = triangle_grid(DVec2::new(2.0, 1.0), [4, 3]).unwrap();
    assert!((sound_sheet(&mesh) - 2.0).abs() < 1e-14);
    assert_eq!((mesh.quads.len(), &mesh.points), (12, &cut.points));
    assert_eq!(mesh.groups[..4], cut.groups[..4]);
    assert_eq!(mesh.group("body").unwrap().cells.quads.len(), 12);
    assert_eq!(mesh.split_into_simplices().triangles, cut.triangles);

    let disc = disc_quads(2.0, 6, 3).unwrap();
    // a polygon of 24 sides
    let polygon = 0.5 * 24.0 * 4.0 * (2.0 * PI / 24.0).sin();
    assert!((sound_sheet(&disc) - polygon).abs() < 1e-12);
    assert_eq!((disc.points.len(), disc.quads.len()), (49 + 72, 36 + 72));
    let rim = &disc.group("rim").unwrap().vertices;
    assert_eq!(rim.len(), 24);
    assert!(rim.iter().all(|&v| (disc.points[v as usize].length() - 2.0).abs() < 1e-14));
}

#[test]
fn irregular_boxes_have_no_preferred_diagonal() {
    let n = [6, 5, 4];
    let mesh = irregular_box_tets(DVec3::new(6.0, 5.0, 4.0), n, 0.0, 3).unwrap();
    assert!((sound_solid(&mesh, &SIX) - 120.0).abs() < 1e-11);
    assert_eq!(mesh.tetrahedra.len(), 720);
    // diagonals of the faces normal to x, of either direction
    let mut up = [0usize; 2];
    let edges = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let faces: Vec<[u32; 3]> = mesh
        .tetrahedra
        .iter()
        .flat_map(|t| TETRAHEDRON_FACES.map(|face| face.map(|v| t[v])))
        .collect();
    for [a, b] in faces.iter().flat_map(edges) {
        let d = mesh.points[b as usize] - mesh.points[a as usize];
        if d.x.abs() < 1e-9 && d.y.abs() > 0.5 && d.z.abs() > 0.5 {
            up[usize::from(d.y * d.z > 0.0)] += 1;
        }
    }
    let share = up[0] as f64 / (up[0] + up[1]) as f64;
    assert!((share - 0.5).abs() < 0.1, "{up:?}");
    for fraction in [0.2, 1.0] {
        let moved = irregular_box_tets(DVec3::ONE, n, fraction, 3).unwrap();
        let total: f64 = moved.tetrahedra.iter().filter_map(|&t| moved.signed_volume(t)).sum();
        assert!((total - 1.0).abs() < 1e-12);
        assert!(moved.tetrahedra.iter().all(|&t| moved.signed_volume(t) > Some(0.0)));
        assert_eq!(moved, irregular_box_tets(DVec3::ONE, n, fraction, 3).unwrap());
        assert_ne!(
            moved.tetrahedra,
            irregular_box_tets(DVec3::ONE, n, fraction, 4).unwrap().tetrahedra
        );
    }
    assert!(irregular_box_tets(DVec3::ONE, n, 1.5, 3).is_err());
    assert!(irregular_box_tets(DVec3::ONE, [1, 0, 1], 0.5, 3).is_err());
}

#[test]
fn jitter_moves_hexahedra_and_quadrilaterals() {
    let mesh = box_hexahedra(DVec3::ONE, [4, 4, 4]).unwrap();
    for fraction in [0.2, 1.0] {
        let moved = jitter_interior(&mesh, fraction, 5).unwrap();
        let options = CheckOptions { expected_size: None, strict: true };
        assert!(check(&moved, &options).is_ok());
        assert!((moved.total_volume() - 1.0).abs() < 1e-13);
        let n = mesh.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count();
        // 3^3 of 5^3 vertices lie inside.
        assert!(n > 20 && n <= 27, "{n}");
    }
    let flat = quad_grid(DVec2::ONE, [5, 5]).unwrap();
    let moved = jitter_interior(&flat, 0.4, 1).unwrap();
    assert_eq!(flat.points.iter().zip(&moved.points).filter(|(a, b)| a != b).count(), 16);
    assert!((sound_sheet(&moved) - 1.0).abs() < 1e-14);
}

#[test]
fn tensile_specimens() {
    // areas of the straight part, of both shoulders and of both grips, in squares of the width
    let area = 2.0 + 2.0 * (4.0 + 4.0 * 2.0 / 3.0) + 2.0 * 9.0;
    let width = 0.01;
    let triangles = specimen_triangles(width, [24, 4]).unwrap();
    assert_eq!((triangles.points.len(), triangles.triangles.len()), (125, 192));
    let quads = specimen_quads(width, [53, 5]).unwrap();
    assert_eq!((quads.points.len(), quads.quads.len()), (324, 265));
    let tets = specimen_tets(width, width, [42, 3, 2]).unwrap();
    assert_eq!((tets.points.len(), tets.tetrahedra.len()), (516, 1512));
    let hexes = specimen_hexahedra(width, width, [56, 5, 3]).unwrap();
    assert_eq!((hexes.points.len(), hexes.hexahedra.len()), (1368, 840));
    // chords of the shoulders lie outside their curves; the excess, 4 / (3 n^2) for n columns in a
    // shoulder, is exact for a parabola
    for (mesh, columns) in [(&triangles, 6.0), (&quads, 13.0)] {
        let excess = sound_sheet(mesh) / (width * width) - area;
        assert!((excess - 8.0 / (3.0 * columns * columns)).abs() < 1e-9, "{excess}");
    }
    for (mesh, columns) in [(&tets, 11.0), (&hexes, 14.0)] {
        let excess = sound_solid(mesh, &SIX) / width.powi(3) - area;
        assert!((excess - 8.0 / (3.0 * columns * columns)).abs() < 1e-9, "{excess}");
    }
    for mesh in [&triangles, &quads, &tets, &hexes] {
        let (low, high) = mesh.bounds().unwrap();
        assert!((high - low).truncate().distance(DVec2::new(0.16, 0.03)) < 1e-15);
        for p in &mesh.points {
            let mirrored = DVec3::new(-p.x, -p.y, p.z);
            assert!(mesh.points.iter().any(|q| q.distance(mirrored) < 1e-15));
        }
        for (name, sign) in [("grip0", -1.0), ("grip1", 1.0)] {
            let grip = mesh.group(name).unwrap();
            let edge = grip.vertices.iter().map(|&v| sign * mesh.points[v as usize].x);
            assert!((edge.fold(f64::INFINITY, f64::min) - 0.05).abs() < 1e-15);
            assert_eq!(grip.dimension, 0);
        }
    }
    for columns in 5..60 {
        assert!(specimen_quads(width, [columns, 1]).unwrap().quads.len() == columns);
    }
    let error = specimen_quads(width, [4, 1]).unwrap_err();
    assert!(error.to_string().contains("cells[0] = 4"), "{error}");
    assert!(specimen_hexahedra(width, 0.0, [5, 1, 1]).is_err());
    assert!(specimen_triangles(f64::NAN, [5, 1]).is_err());
    assert!(matches!(
        specimen_tets(width, width, [1 << 20, 1 << 20, 1 << 20]),
        Err(MeshError::TooMany { .. })
    ));
}

#[test]
fn bad_parameters_of_hexahedra_and_quadrilaterals_are_named() {
    let error = box_hexahedra(DVec3::ONE, [1, 1, 0]).unwrap_err();
    assert!(error.to_string().contains("box_hexahedra: cells[2] = 0"), "{error}");
    assert!(matches!(box_hexahedra(DVec3::ONE, [usize::MAX; 3]), Err(MeshError::TooMany { .. })));
    assert!(cylinder_hexahedra(1.0, 1.0, 0, 1, 1).is_err());
    assert!(cylinder_hexahedra(1.0, 1.0, 1, 0, 1).is_err());
    assert!(cylinder_hexahedra(1.0, 1.0, usize::MAX, 1, 1).is_err());
    assert!(cylinder_hexahedra(1.0, 1.0, 1, 1, usize::MAX).is_err());
    assert!(tube_hexahedra(1.0, 0.0, 1.0, [8, 1, 1]).is_err());
    assert!(tube_hexahedra(1.0, 0.1, 1.0, [2, 1, 1]).is_err());
    assert!(tube_hexahedra(1.0, 0.1, 1.0, [8, 1, usize::MAX]).is_err());
    assert!(tube_hexahedra(1.0, 0.1, 1.0, [8, usize::MAX, 1]).is_err());
    assert!(disc_quads(0.0, 1, 1).is_err() && disc_quads(1.0, 1, usize::MAX).is_err());
    assert!(quad_grid(DVec2::ONE, [2, 0]).is_err());
    assert!(quad_grid(DVec2::ONE, [usize::MAX, 2]).is_err());
}

#[test]
fn boxes_that_are_elsewhere_are_not_graded() {
    let size = DVec3::new(0.3, 0.2, 0.1);
    let mesh = box_tets(size, [3, 2, 1]).unwrap();
    let along = DVec3::new(1.0, 2.0, 1.0);
    let moved = mesh.transformed(1.0, glam::DQuat::IDENTITY, DVec3::new(0.0, -0.1, 0.0));
    for (mesh, size) in [(&moved, size), (&mesh, 0.5 * size), (&mesh, DVec3::ZERO)] {
        let mut graded = mesh.clone();
        let error = grade_box(&mut graded, size, along).unwrap_err().to_string();
        assert!(error.contains("size.y") && graded.points == mesh.points, "{error}");
    }
    let mut graded = mesh.clone();
    grade_box(&mut graded, size, along).unwrap();
    assert!((sound_solid(&graded, &SIX) - 0.006).abs() < 1e-15);
}
