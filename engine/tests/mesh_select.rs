//! Vertices by where they are, parts of the surface, and vertices that are merged.

use glam::DVec3;
use sinew_engine::mesh::generate::{box_hexahedra, box_tets, cylinder_tets};
use sinew_engine::mesh::merge::MERGE_TOLERANCE;
use sinew_engine::mesh::{CheckOptions, FindingCode, Mesh, Patch, Surface, Zone, check};

#[test]
fn zones_hold_their_boundary() {
    let mesh = box_tets(DVec3::new(0.4, 0.2, 0.2), [8, 4, 4]).unwrap();
    let count = |zone| mesh.vertices_in(&zone).len();
    let (point, normal) = (DVec3::new(0.3, 0.0, 0.0), DVec3::X);
    assert_eq!(count(Zone::HalfSpace { point, normal }), 3 * 25);
    assert_eq!(count(Zone::HalfSpace { point, normal: -1e-3 * normal }), 7 * 25);
    // the plane through two edges of the box
    let normal = DVec3::new(0.0, 1.0, 1.0);
    let point = DVec3::new(7.0, 0.2, 0.0);
    assert_eq!(count(Zone::HalfSpace { point, normal }), 9 * (5 * 6 / 2));
    let middle = DVec3::new(0.0, 0.1, 0.1);
    let (start, end) = (middle + 0.1 * DVec3::X, middle + 0.25 * DVec3::X);
    assert_eq!(count(Zone::Cylinder { start, end, radius: 0.05 }), 4 * 5);
    assert_eq!(count(Zone::Cylinder { start: end, end: start, radius: 0.04 }), 4);
    let flat = Zone::Cylinder { start, end: start, radius: 1.0 };
    assert!(flat.problem().unwrap().contains("no axis"));
    let nowhere = Zone::HalfSpace { point, normal: DVec3::ZERO };
    assert!(nowhere.problem().is_some());
    // vertices that no cell uses are not chosen
    let mut mesh = mesh;
    mesh.points.push(DVec3::ZERO);
    let all = Zone::Sphere { centre: DVec3::ZERO, radius: 9.0 };
    assert_eq!(mesh.vertices_in(&all).len(), mesh.points.len() - 1);
}

#[test]
fn patches_end_at_edges() {
    let size = DVec3::new(0.3, 0.2, 0.1);
    for mesh in [box_tets(size, [3, 2, 2]).unwrap(), box_hexahedra(size, [3, 2, 2]).unwrap()] {
        let top = &mesh.group("z1").unwrap().vertices;
        let near = Some(DVec3::new(0.1, 0.1, 0.15));
        let angle = 30f64.to_radians();
        let side = Patch { near, normal: None, angle };
        assert_eq!(&mesh.patch_vertices(&side), top);
        assert_eq!(&mesh.patch_vertices(&Patch { near: None, normal: Some(DVec3::Z), angle }), top);
        // right angles are no edge for it
        let all = Patch { angle: 91f64.to_radians(), ..side };
        let surface = mesh.surface();
        assert_eq!(mesh.patch(&all), surface);
        // every face that looks up or sideways, and those of them around the nearest
        let up = Patch { near: None, normal: Some(DVec3::new(0.0, 1.0, 1.0)), angle: 0.8 };
        let both = mesh.patch(&up);
        assert_eq!(mesh.patch(&Patch { near, ..up }), both);
        let faces = |name: &str| mesh.group(name).unwrap().cells.clone();
        let count = |name| faces(name).triangles.len() + faces(name).quads.len();
        assert_eq!(both.triangles.len() + both.quads.len(), count("y1") + count("z1"));
    }
    assert_eq!(
        Mesh::default().patch(&Patch { near: None, normal: Some(DVec3::Z), angle: 1.0 }),
        Surface::default()
    );
}

/// The wall of a cylinder bends gently, its ends do not; a sheet may be wound either way.
#[test]
fn patches_follow_curved_walls_and_sheets() {
    let mesh = cylinder_tets(0.02, 0.1, 3, 6).unwrap();
    let near = Some(DVec3::new(0.05, 0.03, 0.0));
    let wall = mesh.patch(&Patch { near, normal: None, angle: 1.0 });
    let axis = |v: u32| mesh.points[v as usize].with_x(0.0).length();
    assert!(wall.triangles.as_flattened().iter().all(|&v| axis(v) > 0.0199));
    assert!(wall.triangles.len() > 30 && wall.triangles.len() < mesh.surface().triangles.len());
    let sheet = Mesh {
        points: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE.with_z(0.0)],
        triangles: vec![[0, 1, 2], [1, 2, 3]],
        ..Mesh::default()
    };
    let near = Some(DVec3::new(0.1, 0.1, 1.0));
    let patch = sheet.patch(&Patch { near, normal: None, angle: 0.1 });
    assert_eq!(patch.triangles.len(), 2);
}

/// Two boxes that share a side, each with vertices of its own, displaced by the rounding of single precision.
fn seam() -> Mesh {
    let mut mesh = box_tets(DVec3::new(0.1, 0.1, 0.1), [2, 2, 2]).unwrap();
    let beside = mesh.clone();
    let count = mesh.points.len() as u32;
    let moved = beside.points.iter().map(|p| *p + DVec3::new(0.1 + 1e-8, -1e-8, 0.0));
    mesh.points.extend(moved);
    mesh.tetrahedra.extend(beside.tetrahedra.iter().map(|t| t.map(|v| v + count)));
    mesh.triangles.clear();
    mesh.groups.retain(|group| group.name == "x1");
    mesh.groups[0].cells.triangles.clear();
    let other = beside.group("x0").unwrap().vertices.iter().map(|v| v + count);
    mesh.groups[0].vertices.extend(other);
    mesh
}

#[test]
fn a_seam_is_closed() {
    let mesh = seam();
    let (merged, report) = mesh.merged(MERGE_TOLERANCE);
    assert_eq!((report.vertices, report.left), (9, 0));
    assert!((report.distance - 2e-7).abs() < 1e-9);
    assert_eq!(merged.points.len(), mesh.points.len() - 9);
    assert_eq!(merged.groups[0].vertices.len(), 9);
    let checked = check(&merged, &CheckOptions::default()).unwrap();
    let found = |code| checked.report.finding(code).is_some();
    assert!(!found(FindingCode::SeveralComponents) && !found(FindingCode::UnusedVertices));
    assert_eq!(merged.surface().triangles.len(), 2 * 2 * 4 * 5);
    // nearer than that there are none
    let (same, report) = mesh.merged(1e-8);
    assert_eq!((same, report.vertices), (mesh.clone(), 0));
    // and again there is nothing to do
    assert_eq!(merged.merged(MERGE_TOLERANCE).1.vertices, 0);
}

#[test]
fn cells_are_never_made_flat() {
    let mesh = seam();
    // farther than an edge: everything would become one
    let (same, report) = mesh.merged(0.3);
    assert_eq!((report.vertices, report.left), (0, mesh.points.len() - 1));
    assert_eq!(same, mesh);
    let mut odd = mesh;
    odd.points[3] = DVec3::NAN;
    odd.tetrahedra[0][0] = 999;
    let (merged, _) = odd.merged(MERGE_TOLERANCE);
    assert_eq!(merged.tetrahedra[0][0], 999);
}
