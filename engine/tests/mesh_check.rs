//! One test per finding of the mesh check, each at three scales.

use crate::common::{self, report};
use glam::{DQuat, DVec2, DVec3};
use sinew_engine::mesh::generate::{box_tets, sphere_tets, triangle_grid};
use sinew_engine::mesh::{CheckOptions, FindingCode as Code, Mesh, Severity, SkippedCells, check};

fn cube() -> Mesh {
    box_tets(DVec3::ONE, [2, 2, 2]).unwrap()
}

fn single(points: Vec<DVec3>) -> Mesh {
    Mesh { points, tetrahedra: vec![[0, 1, 2, 3]], ..Mesh::default() }
}

/// The mesh must have this finding, and beside it none but `others`, at every scale.
fn expect(mesh: &Mesh, code: Code, severity: Severity, count: usize, others: &[Code]) {
    common::expect(mesh, (DQuat::IDENTITY, DVec3::ZERO), code, (severity, count), others);
}

#[test]
fn good_meshes_have_no_findings() {
    let grid = triangle_grid(DVec2::ONE, [3, 3]).unwrap();
    for mesh in [cube(), sphere_tets(0.5, 3).unwrap(), grid] {
        let checked = check(&mesh, &CheckOptions::default()).unwrap();
        assert_eq!(checked.report.findings, []);
        assert_eq!(checked.mesh, mesh);
        assert_eq!(checked.used_vertices.len(), mesh.points.len());
    }
}

#[test]
fn statistics_of_a_regular_tetrahedron() {
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    let mut mesh = single(corners.map(DVec3::from_array).to_vec());
    mesh.tetrahedra[0].swap(2, 3);
    let s = report(&mesh, &CheckOptions::default()).statistics;
    assert!((s.worst_quality - 1.0).abs() < 1e-14 && (s.mean_quality - 1.0).abs() < 1e-14);
    assert!((s.total_volume - 8.0 / 3.0).abs() < 1e-14);
    assert!((s.smallest_altitude - 4.0 / 3f64.sqrt()).abs() < 1e-14);
    assert_eq!(s.bounds, Some([[-1.0; 3], [1.0; 3]]));
    assert_eq!((s.vertices, s.used_vertices, s.tetrahedra, s.components), (4, 4, 1, 1));
}

#[test]
fn non_finite_coordinate() {
    for bad in [f64::NAN, f64::INFINITY] {
        let mut mesh = cube();
        mesh.points[3].y = bad;
        expect(&mesh, Code::NonFiniteCoordinate, Severity::Error, 1, &[]);
    }
}

#[test]
fn index_out_of_range() {
    let mut mesh = cube();
    mesh.tetrahedra[5][2] = 27;
    let error = check(&mesh, &CheckOptions::default()).unwrap_err();
    let finding = error.report.finding(Code::IndexOutOfRange).unwrap();
    assert!(finding.entity.starts_with("tetrahedron 5 (vertices "), "{finding}");
    let others = [Code::NonManifoldEdge, Code::UnusedVertices];
    expect(&mesh, Code::IndexOutOfRange, Severity::Error, 1, &others);
    let mut mesh = cube();
    mesh.triangles[0][0] = u32::MAX;
    expect(&mesh, Code::IndexOutOfRange, Severity::Error, 1, &[]);
}

#[test]
fn repeated_vertex_in_cell() {
    let mut mesh = cube();
    mesh.tetrahedra.push([0, 1, 1, 2]);
    expect(&mesh, Code::RepeatedVertexInCell, Severity::Error, 1, &[]);
}

#[test]
fn duplicate_coordinates_in_a_cell_and_at_a_seam() {
    let mut mesh = cube();
    mesh.points[1] = mesh.points[0] + DVec3::splat(1e-10);
    let others = [Code::ZeroVolume, Code::Sliver, Code::PoorQuality, Code::InvertedWinding];
    expect(&mesh, Code::DuplicateCoordinates, Severity::Error, 1, &others);

    let (mut seam, other) = (cube(), cube());
    seam.points.extend(other.points.iter().map(|&p| p + DVec3::X));
    seam.tetrahedra.extend(other.tetrahedra.iter().map(|t| t.map(|v| v + 27)));
    let others = [Code::SeveralComponents];
    expect(&seam, Code::DuplicateCoordinates, Severity::Warning, 9, &others);
}

#[test]
fn zero_volume_sliver_and_poor_quality() {
    let cases = [
        (0.0, Code::ZeroVolume, Severity::Error),
        (1e-8, Code::Sliver, Severity::Warning),
        (0.01, Code::PoorQuality, Severity::Warning),
    ];
    for (height, code, severity) in cases {
        let apex = DVec3::new(0.3, 0.3, height);
        let mesh = single(vec![DVec3::ZERO, DVec3::X, DVec3::Y, apex]);
        expect(&mesh, code, severity, 1, &[Code::PoorQuality]);
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.3, height, 0.0)];
        let mesh = Mesh { points, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        expect(&mesh, code, severity, 1, &[Code::PoorQuality]);
    }
}

#[test]
fn inverted_winding_is_repaired_or_refused() {
    let mut mesh = cube();
    mesh.tetrahedra[7].swap(0, 1);
    expect(&mesh, Code::InvertedWinding, Severity::Warning, 1, &[]);
    let checked = check(&mesh, &CheckOptions::default()).unwrap();
    assert!(checked.mesh.tetrahedra.iter().all(|&t| checked.mesh.signed_volume(t) > Some(0.0)));
    assert!((checked.mesh.total_volume() - 1.0).abs() < 1e-14);
    let strict = CheckOptions { strict: true, ..CheckOptions::default() };
    assert!(check(&mesh, &strict).unwrap_err().to_string().contains("tetrahedron 7"));
}

#[test]
fn duplicate_cell() {
    let mut mesh = cube();
    let [a, b, c, d] = mesh.tetrahedra[4];
    mesh.tetrahedra.push([b, c, a, d]);
    let others = [Code::NonManifoldFace, Code::NonManifoldEdge];
    expect(&mesh, Code::DuplicateCell, Severity::Error, 1, &others);
    let mut mesh = triangle_grid(DVec2::ONE, [2, 2]).unwrap();
    mesh.triangles.push(mesh.triangles[3]);
    expect(&mesh, Code::DuplicateCell, Severity::Error, 1, &[Code::NonManifoldEdge]);
}

#[test]
fn non_manifold_face_and_edge() {
    let mut mesh = single(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
    mesh.points.extend([-DVec3::Z, DVec3::new(0.3, 0.3, 2.0)]);
    mesh.tetrahedra.extend([[0, 2, 1, 4], [0, 1, 2, 5]]);
    expect(&mesh, Code::NonManifoldFace, Severity::Error, 1, &[Code::NonManifoldEdge]);

    let mut mesh = single(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z]);
    mesh.points.extend([-DVec3::Y, -DVec3::Z]);
    mesh.tetrahedra.push([0, 1, 4, 5]);
    expect(&mesh, Code::NonManifoldEdge, Severity::Warning, 1, &[]);
}

#[test]
fn unused_vertices_and_components() {
    let mut mesh = cube();
    mesh.points.push(DVec3::splat(2.0));
    expect(&mesh, Code::UnusedVertices, Severity::Info, 1, &[]);
    let checked = check(&mesh, &CheckOptions::default()).unwrap();
    assert_eq!(checked.used_vertices, (0..27).collect::<Vec<u32>>());
    mesh.points[27] = DVec3::splat(f64::NAN);
    let others = [Code::UnusedVertices];
    expect(&mesh, Code::NonFiniteCoordinate, Severity::Error, 1, &others);

    let (mut two, other) = (cube(), cube());
    two.points.extend(other.points.iter().map(|&p| p + DVec3::splat(5.0)));
    two.tetrahedra.extend(other.tetrahedra.iter().map(|t| t.map(|v| v + 27)));
    expect(&two, Code::SeveralComponents, Severity::Warning, 2, &[]);
}

#[test]
fn no_cells_and_skipped_cells() {
    let mut mesh = Mesh { points: vec![DVec3::ZERO], ..Mesh::default() };
    expect(&mesh, Code::NoCells, Severity::Error, 1, &[Code::UnusedVertices]);
    expect(&Mesh::default(), Code::NoCells, Severity::Error, 1, &[]);
    mesh.skipped.push(SkippedCells { kind: "6-node prism".to_owned(), count: 3 });
    let error = check(&mesh, &CheckOptions::default()).unwrap_err();
    assert!(error.to_string().contains("6-node prism"), "{error}");
    let others = [Code::NoCells, Code::UnusedVertices];
    expect(&mesh, Code::SkippedCells, Severity::Warning, 3, &others);
}

#[test]
fn implausible_size_names_the_unit() {
    for (scale, hint) in [(150.0, Some("scale by 0.001")), (0.1, None), (1e-9, Some("unit"))] {
        let mesh = cube().transformed(scale, DQuat::IDENTITY, DVec3::splat(7.0 * scale));
        let report = report(&mesh, &CheckOptions::default());
        let finding = report.finding(Code::ImplausibleSize).map(ToString::to_string);
        assert_eq!(finding.is_some(), hint.is_some());
        assert!(finding.unwrap_or_default().contains(hint.unwrap_or("")));
        assert!(!report.has_errors());
    }
}

#[test]
fn reports_are_serialised_under_stable_names() {
    let mut mesh = cube();
    mesh.tetrahedra.push([0, 0, 1, 2]);
    let report = report(&mesh, &CheckOptions::default());
    let json = serde_json::to_string(&report).unwrap();
    assert!(json.contains("\"code\":\"repeated-vertex-in-cell\""), "{json}");
    assert!(json.contains("\"severity\":\"error\"") && json.contains("\"worst_quality\":"));
}

#[test]
fn far_from_the_origin_and_with_a_stray_vertex() {
    let mesh = cube().transformed(0.01, DQuat::IDENTITY, DVec3::splat(1e6));
    assert_eq!(check(&mesh, &CheckOptions::default()).unwrap().report.findings, []);
    let mut mesh = box_tets(DVec3::ONE, [20, 20, 20]).unwrap();
    mesh.points[0] = DVec3::splat(-1e9);
    let report = report(&mesh, &CheckOptions::default());
    assert!(report.finding(Code::DuplicateCoordinates).is_none(), "{report}");
}
