//! Findings of the mesh check about hexahedra, quadrilaterals and mixed meshes, each at three scales.

use crate::common::{self, report};
use glam::{DQuat, DVec2, DVec3};
use sinew_engine::mesh::generate::{box_hexahedra, cylinder_hexahedra, disc_quads, quad_grid};
use sinew_engine::mesh::{CheckOptions, FindingCode as Code, Mesh, Severity, check};

fn block() -> Mesh {
    box_hexahedra(DVec3::ONE, [2, 2, 2]).unwrap()
}

fn sheet() -> Mesh {
    quad_grid(DVec2::ONE, [3, 3]).unwrap()
}

/// One hexahedron, its corners in the order of the format.
fn brick(size: DVec3) -> Mesh {
    let mut mesh = box_hexahedra(size, [1, 1, 1]).unwrap();
    mesh.points = mesh.hexahedra[0].map(|v| mesh.points[v as usize]).to_vec();
    mesh.hexahedra[0] = [0, 1, 2, 3, 4, 5, 6, 7];
    mesh.quads.clear();
    mesh.groups.clear();
    mesh
}

/// The mesh must have this finding, and beside it none but `others`, at every scale and place.
fn expect(mesh: &Mesh, code: Code, severity: Severity, count: usize, others: &[Code]) -> String {
    let motion = (DQuat::from_rotation_y(0.7), DVec3::new(3.0, 0.0, -1.0));
    common::expect(mesh, motion, code, (severity, count), others)
}

#[test]
fn good_meshes_have_no_findings() {
    let cylinder = cylinder_hexahedra(0.1, 0.5, 4, 2, 5).unwrap();
    for mesh in [block(), sheet(), cylinder, disc_quads(0.2, 3, 2).unwrap()] {
        let checked = check(&mesh, &CheckOptions::default()).unwrap();
        assert_eq!(checked.report.findings, [], "{}", checked.report);
        assert_eq!(checked.mesh, mesh);
        assert_eq!(checked.used_vertices.len(), mesh.points.len());
        assert_eq!(checked.report.statistics.components, 1);
    }
}

#[test]
fn statistics_of_bricks_and_rectangles() {
    let s = report(&brick(DVec3::new(3.0, 1.0, 2.0)), &CheckOptions::default()).statistics;
    assert!((s.worst_quality - 1.0).abs() < 1e-14 && (s.mean_quality - 1.0).abs() < 1e-14);
    assert!((s.total_volume - 6.0).abs() < 1e-14 && (s.smallest_altitude - 1.0).abs() < 1e-14);
    assert_eq!((s.hexahedra, s.quads, s.tetrahedra, s.used_vertices), (1, 0, 0, 8));
    assert_eq!(s.cells(), "0 tetrahedra, 1 hexahedra, 0 triangles");
    // a rhombus of 60 degrees: sin 60, and the height 0.866 over its edges
    let points = vec![
        DVec3::ZERO,
        DVec3::X,
        DVec3::new(1.5, 0.75f64.sqrt(), 0.0),
        DVec3::new(0.5, 0.75f64.sqrt(), 0.0),
    ];
    let mesh = Mesh { points, quads: vec![[0, 1, 2, 3]], ..Mesh::default() };
    let s = report(&mesh, &CheckOptions::default()).statistics;
    assert!((s.worst_quality - 0.75f64.sqrt()).abs() < 1e-14);
    assert!((s.smallest_altitude - 0.75f64.sqrt()).abs() < 1e-14);
    assert_eq!((s.quads, s.total_volume), (1, 0.0));
}

#[test]
fn bad_indices_and_coordinates() {
    let mut mesh = block();
    mesh.hexahedra[5][2] = 27;
    let text = expect(
        &mesh,
        Code::IndexOutOfRange,
        Severity::Error,
        1,
        &[Code::NonManifoldEdge, Code::UnusedVertices],
    );
    assert!(text.contains("hexahedron 5 (vertices "), "{text}");
    let mut mesh = sheet();
    mesh.quads[4][3] = u32::MAX;
    let text = expect(&mesh, Code::IndexOutOfRange, Severity::Error, 1, &[]);
    assert!(text.contains("quadrilateral 4 "), "{text}");
    let mut mesh = block();
    mesh.hexahedra.push([0, 1, 4, 3, 9, 10, 13, 9]);
    expect(&mesh, Code::RepeatedVertexInCell, Severity::Error, 1, &[]);
    let mut mesh = sheet();
    mesh.quads.push([0, 1, 1, 4]);
    expect(&mesh, Code::RepeatedVertexInCell, Severity::Error, 1, &[]);
    let mut mesh = block();
    mesh.points[3].y = f64::NAN;
    expect(&mesh, Code::NonFiniteCoordinate, Severity::Error, 1, &[]);
    let mut mesh = sheet();
    mesh.points[3].y = f64::INFINITY;
    expect(&mesh, Code::NonFiniteCoordinate, Severity::Error, 1, &[]);
}

#[test]
fn inverted_hexahedra_are_turned_round_or_refused() {
    let mut mesh = block();
    // mirrored: bottom and top change places
    let [a, b, c, d, e, f, g, h] = mesh.hexahedra[6];
    mesh.hexahedra[6] = [e, f, g, h, a, b, c, d];
    expect(&mesh, Code::InvertedWinding, Severity::Warning, 1, &[]);
    let checked = check(&mesh, &CheckOptions::default()).unwrap();
    assert_eq!(checked.mesh.hexahedra, block().hexahedra);
    assert!((checked.report.statistics.total_volume - 1.0).abs() < 1e-14);
    let strict = CheckOptions { strict: true, ..CheckOptions::default() };
    assert!(check(&mesh, &strict).unwrap_err().to_string().contains("hexahedron 6"));
    // a whole body as its mirror image
    let mesh = block().transformed(-1.0, DQuat::IDENTITY, DVec3::ZERO);
    expect(&mesh, Code::InvertedWinding, Severity::Warning, 8, &[]);
}

#[test]
fn folded_hexahedra_are_refused() {
    // a corner pushed through the opposite one, and one in the plane of its neighbours
    for (place, corner) in [(-0.2, "corner 2"), (2.0 / 3.0, "corner 6")] {
        let mut mesh = brick(DVec3::ONE);
        mesh.points[6] = DVec3::splat(place);
        let text = expect(&mesh, Code::NonConvexCell, Severity::Error, 1, &[]);
        assert!(text.contains("hexahedron 0") && text.contains(corner), "{text}");
    }
    // vertices by rows, as voxels have them: half of the corners are turned over
    let mut mesh = brick(DVec3::ONE);
    mesh.hexahedra[0] = [0, 1, 3, 2, 4, 5, 7, 6];
    let report = report(&mesh, &CheckOptions::default());
    let finding = report.errors().next().unwrap();
    assert!([Code::NonConvexCell, Code::ZeroVolume].contains(&finding.code), "{finding}");
    // positive at all corners and in the mean, yet not everywhere inside
    let mut mesh = brick(DVec3::ONE);
    let quarters = [
        [5, 0, -8],
        [-2, 8, -2],
        [-5, -3, 6],
        [-7, -3, -5],
        [-7, 1, 7],
        [6, 4, -8],
        [3, -1, 7],
        [-4, -3, -4],
    ];
    mesh.points = quarters.map(|p| DVec3::from_array(p.map(|x| f64::from(x) / 4.0))).to_vec();
    let text = expect(&mesh, Code::NonConvexCell, Severity::Error, 1, &[]);
    assert!(text.contains("Gauss point"), "{text}");
}

#[test]
fn flat_and_poor_hexahedra() {
    let mesh = brick(DVec3::new(1.0, 1.0, 1e-13));
    expect(&mesh, Code::ZeroVolume, Severity::Error, 1, &[Code::DuplicateCoordinates]);
    let mesh = brick(DVec3::new(1.0, 1.0, 1e-7));
    expect(&mesh, Code::Sliver, Severity::Warning, 1, &[]);
    // a thin layer is no bad cell, a sheared one is
    let mesh = brick(DVec3::new(1.0, 1.0, 1e-3));
    assert_eq!(report(&mesh, &CheckOptions::default()).findings, []);
    let mut mesh = brick(DVec3::ONE);
    mesh.points[4..].iter_mut().for_each(|p| p.x += 30.0);
    expect(&mesh, Code::PoorQuality, Severity::Warning, 1, &[]);
}

#[test]
fn folded_flat_and_warped_quads() {
    let mut mesh = sheet();
    let square = |points: [[f64; 3]; 4]| Mesh {
        points: points.map(DVec3::from_array).to_vec(),
        quads: vec![[0, 1, 2, 3]],
        ..Mesh::default()
    };
    let (a, b, d) = ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    for c in [[0.2, 0.2, 0.0], [0.5, 0.5, 0.0]] {
        let text = expect(&square([a, b, c, d]), Code::NonConvexCell, Severity::Error, 1, &[]);
        assert!(text.contains("quadrilateral 0") && text.contains("corner 2"), "{text}");
    }
    // corners crosswise
    let bow_tie = square([a, b, d, [0.7, 1.1, 0.0]]);
    expect(&bow_tie, Code::NonConvexCell, Severity::Error, 1, &[]);
    let line = square([a, b, [2.0, 0.0, 0.0], [0.5, 0.0, 0.0]]);
    expect(&line, Code::ZeroVolume, Severity::Error, 1, &[]);
    let thin = square([a, b, [1.0, 1e-8, 0.0], [0.0, 1e-8, 0.0]]);
    expect(&thin, Code::Sliver, Severity::Warning, 1, &[]);

    // one corner lifted by h: the normals of the halves that share its diagonal are (0, -h, 1) and
    // (-h, 0, 1)
    for (height, warped) in [(0.15, false), (0.25, true)] {
        let mesh = square([a, b, [1.0, 1.0, height], d]);
        if warped {
            let text = expect(&mesh, Code::WarpedCell, Severity::Warning, 1, &[]);
            let angle = (1.0 / (1.0 + height * height)).acos().to_degrees();
            assert!(text.contains(&format!("{angle:.1} degrees")), "{text}");
        } else {
            assert_eq!(report(&mesh, &CheckOptions::default()).findings, []);
        }
    }
    mesh.points[5].z = 0.5;
    expect(&mesh, Code::WarpedCell, Severity::Warning, 4, &[]);
}

#[test]
fn repeated_cells_and_places() {
    let mut mesh = block();
    let [a, b, c, d, e, f, g, h] = mesh.hexahedra[4];
    mesh.hexahedra.push([b, c, d, a, f, g, h, e]);
    let others = [Code::NonManifoldFace, Code::NonManifoldEdge];
    expect(&mesh, Code::DuplicateCell, Severity::Error, 1, &others);
    let mut mesh = sheet();
    mesh.quads.push([5, 1, 0, 4]);
    expect(&mesh, Code::DuplicateCell, Severity::Error, 1, &[Code::NonManifoldEdge]);
    // beside volumes, faces only mark the surface
    let mut mesh = block();
    mesh.quads.push(mesh.quads[0]);
    expect(&mesh, Code::DuplicateCell, Severity::Warning, 1, &[]);

    // opposite corners of a face are no edge
    let mut mesh = brick(DVec3::ONE);
    mesh.points[2] = mesh.points[0] + DVec3::splat(1e-11);
    let others = [Code::NonConvexCell, Code::ZeroVolume];
    expect(&mesh, Code::DuplicateCoordinates, Severity::Error, 1, &others);
    let (mut seam, other) = (block(), block());
    seam.points.extend(other.points.iter().map(|&p| p + DVec3::X));
    seam.hexahedra.extend(other.hexahedra.iter().map(|cell| cell.map(|v| v + 27)));
    let others = [Code::SeveralComponents];
    expect(&seam, Code::DuplicateCoordinates, Severity::Warning, 9, &others);
}

#[test]
fn faces_and_edges_of_too_many_cells() {
    let mut mesh = brick(DVec3::ONE);
    for height in [2.0, 3.0] {
        let first = mesh.points.len() as u32;
        let top: Vec<DVec3> = mesh.points[4..8].iter().map(|p| *p + height * DVec3::Z).collect();
        mesh.points.extend(top);
        mesh.hexahedra.push([4, 5, 6, 7, first, first + 1, first + 2, first + 3]);
    }
    let text = expect(&mesh, Code::NonManifoldFace, Severity::Error, 1, &[Code::NonManifoldEdge]);
    assert!(text.contains("face (vertices 4 5 6 7)"), "{text}");

    // two bricks that meet along an edge
    let mut mesh = brick(DVec3::ONE);
    let shift = DVec3::new(1.0, 1.0, 0.0);
    mesh.points.extend([1, 2, 3, 5, 6, 7].map(|i: usize| brick(DVec3::ONE).points[i] + shift));
    mesh.hexahedra.push([2, 8, 9, 10, 6, 11, 12, 13]);
    expect(&mesh, Code::NonManifoldEdge, Severity::Warning, 1, &[Code::OneCellAcross]);

    let mut mesh = sheet();
    mesh.points.extend([DVec3::new(0.0, 0.5, 1.0), DVec3::new(0.3, 0.5, 1.0)]);
    let n = mesh.points.len() as u32;
    mesh.quads.push([5, 9, n - 1, n - 2]);
    expect(&mesh, Code::NonManifoldEdge, Severity::Warning, 1, &[]);
}

#[test]
fn hexahedra_that_reach_from_side_to_side() {
    let plate = box_hexahedra(DVec3::new(4.0, 3.0, 1.0), [4, 3, 1]).unwrap();
    let text = expect(&plate, Code::OneCellAcross, Severity::Info, 12, &[]);
    assert!(text.contains("12 of 12") && text.contains("two hexahedra across"), "{text}");
    // one that juts out of a block is the step of a lattice
    let mut block = box_hexahedra(DVec3::ONE, [3; 3]).unwrap();
    let corner = block.points.iter().position(|x| *x == DVec3::ONE).unwrap() as u32;
    let last = *block.hexahedra.iter().find(|cell| cell.contains(&corner)).unwrap();
    let top = [4, 5, 6, 7].map(|i| last[i]);
    let first = block.points.len() as u32;
    block.points.extend(top.map(|v| block.points[v as usize] + DVec3::Z / 3.0));
    let [a, b, c, d] = top;
    block.hexahedra.push([a, b, c, d, first, first + 1, first + 2, first + 3]);
    assert_eq!(report(&block, &CheckOptions::default()).findings, []);
}

#[test]
fn tetrahedra_against_a_face_of_a_hexahedron() {
    let mut mesh = brick(DVec3::ONE);
    mesh.points.push(DVec3::new(0.5, 0.5, 2.0));
    mesh.tetrahedra = vec![[4, 5, 6, 8], [4, 6, 7, 8]];
    let text = expect(&mesh, Code::NonConformingFace, Severity::Warning, 1, &[]);
    assert!(text.contains("face (vertices 4 5 6 7)") && text.contains("split"), "{text}");
    let s = report(&mesh, &CheckOptions::default()).statistics;
    assert_eq!((s.tetrahedra, s.hexahedra, s.components, s.used_vertices), (2, 1, 1, 9));
    assert!((s.total_volume - 4.0 / 3.0).abs() < 1e-14);
    // as tetrahedra alone they fit
    let split = mesh.split_into_simplices();
    assert_eq!(split.tetrahedra.len(), 8);
    assert_eq!(report(&split, &CheckOptions::default()).findings, []);
}

#[test]
fn mixed_sheets_and_loose_vertices() {
    // two squares, one of them cut
    let mut mesh = quad_grid(DVec2::new(0.2, 0.1), [2, 1]).unwrap();
    let [a, b, c, d] = mesh.quads.pop().unwrap();
    mesh.triangles = vec![[a, b, c], [a, c, d]];
    let s = report(&mesh, &CheckOptions::default());
    assert_eq!(s.findings, []);
    assert_eq!(s.statistics.cells(), "0 tetrahedra, 2 triangles, 1 quadrilaterals");
    mesh.points.push(DVec3::ZERO);
    expect(&mesh, Code::UnusedVertices, Severity::Info, 1, &[]);
    let mut two = block();
    let other = block();
    two.points.extend(other.points.iter().map(|&p| p + DVec3::splat(5.0)));
    two.hexahedra.extend(other.hexahedra.iter().map(|cell| cell.map(|v| v + 27)));
    expect(&two, Code::SeveralComponents, Severity::Warning, 2, &[]);
}
