//! Meshes of all four kinds of cells through every format, and cells in the order of other programs.

use glam::DVec3;
use sinew_engine::element_kind::{ByKind, ElementKind};
use sinew_engine::mesh::io::*;
use sinew_engine::mesh::{CellData, FileLines, FindingCode, Group, LINEAR, Mesh, MeshError, check};

/// A hexahedron, two tetrahedra on its top, and faces of both kinds beside and apart from them.
fn mixed() -> Mesh {
    let corner = |i: usize| {
        let [x, y, z] = [[0, 1, 1, 0][i % 4], [0, 0, 1, 1][i % 4], i / 4];
        DVec3::new(x as f64, y as f64, z as f64) / 3.0
    };
    let mut points: Vec<DVec3> = (0..8).map(corner).collect();
    points.push(DVec3::new(0.2, 0.2, 0.7));
    points.extend([2.0, 2.5, 3.0].map(|x| DVec3::new(x, 0.0, 0.0)));
    points.extend([2.0, 2.5].map(|x| DVec3::new(x, 1.0, 0.1)));
    let names = ["f", "f_x", "f_y", "f_z", "g_x", "g_y", "fibre_x", "fibre_y", "fibre_z", "label"];
    let data = |(i, name): (usize, &str)| {
        let values = |first: usize, n: usize| (0..n).map(|k| value(i, first + k)).collect();
        CellData {
            name: name.to_owned(),
            integer: name == "label",
            values: ByKind {
                tetrahedra: values(0, 2),
                hexahedra: values(2, 1),
                triangles: values(3, 2),
                quads: values(5, 2),
            },
        }
    };
    fn value(array: usize, cell: usize) -> f64 {
        if array == 9 { cell as f64 } else { (1 + 7 * array + cell) as f64 / 3.0 }
    }
    Mesh {
        points,
        tetrahedra: vec![[4, 5, 6, 8], [4, 6, 7, 8]],
        hexahedra: vec![[0, 1, 2, 3, 4, 5, 6, 7]],
        triangles: vec![[10, 11, 13], [4, 5, 8]],
        quads: vec![[0, 3, 2, 1], [9, 10, 13, 12]],
        groups: vec![
            Group {
                name: "sheet".to_owned(),
                dimension: 2,
                vertices: vec![9, 10, 11, 12, 13],
                cells: ByKind { triangles: vec![0], quads: vec![1], ..ByKind::default() },
            },
            Group {
                name: "solid".to_owned(),
                dimension: 3,
                vertices: (0..9).collect(),
                cells: ByKind { tetrahedra: vec![0, 1], hexahedra: vec![0], ..ByKind::default() },
            },
            Group {
                name: "stiff".to_owned(),
                dimension: 3,
                vertices: (0..8).collect(),
                cells: ByKind { hexahedra: vec![0], ..ByKind::default() },
            },
        ],
        cell_data: names.into_iter().enumerate().map(data).collect(),
        ..Mesh::default()
    }
}

/// The mesh without what files add to it: lines, and groups for the values of a label.
fn bare(mut mesh: Mesh) -> Mesh {
    mesh.source.clear();
    mesh.lines = FileLines::default();
    mesh.groups.retain(|group| !group.name.starts_with("label "));
    mesh.groups.sort_by(|a, b| (a.dimension, &a.name).cmp(&(b.dimension, &b.name)));
    mesh
}

#[test]
fn mixed_meshes_read_back_the_same() {
    let mesh = mixed();
    let file = VtuData::of_mesh(&mesh);
    let vtu = encode_vtu(&file).unwrap();
    assert_eq!(bare(read_vtu(&vtu, "").unwrap()), mesh);
    for binary in [false, true] {
        let vtk = encode_vtk(&file, binary).unwrap();
        assert_eq!(bare(read_vtk(&vtk, "").unwrap()), mesh);
    }
    let msh = encode_gmsh(&mesh);
    let read = read_gmsh(msh.as_bytes(), "").unwrap();
    assert_eq!(read.lines.cells.hexahedra.len() + read.lines.cells.quads.len(), 3);
    let mut real = mesh.clone();
    // the format stores reals only
    real.cell_data[9].integer = false;
    assert_eq!(bare(read), real);
    // and from one format to the next
    let vtk = encode_vtk(&VtuData::of_mesh(&bare(read_vtu(&vtu, "").unwrap())), true).unwrap();
    assert_eq!(bare(read_vtk(&vtk, "").unwrap()), mesh);
}

#[test]
fn components_are_written_as_one_vector() {
    let mesh = mixed();
    let vtu = encode_vtu(&VtuData::of_mesh(&mesh)).unwrap();
    let text = String::from_utf8_lossy(&vtu);
    assert!(text.contains("Name=\"fibre\" NumberOfComponents=\"3\""));
    assert!(!text.contains("fibre_x"));
    // `g` lacks a component, and `f` is a number already
    for name in ["g_x", "g_y", "f", "f_x", "f_y", "f_z"] {
        assert!(text.contains(&format!("Name=\"{name}\" NumberOfComponents=\"1\"")), "{name}");
    }
    let msh = encode_gmsh(&mesh);
    assert!(msh.contains("$ElementData\n1\n\"fibre\"\n1\n0.0\n3\n0\n3\n7\n"));
    let vtk = String::from_utf8(encode_vtk(&VtuData::of_mesh(&mesh), false).unwrap()).unwrap();
    assert!(vtk.contains("fibre 3 7 double\n"));
}

#[test]
fn components_that_are_missing_stay_missing() {
    let mut mesh = mixed();
    mesh.cell_data.drain(..6);
    mesh.cell_data.truncate(3);
    mesh.cell_data[1].values.hexahedra[0] = f64::NAN;
    mesh.cell_data.iter_mut().for_each(|data| data.values.quads[1] = f64::NAN);
    for read in [
        read_gmsh(encode_gmsh(&mesh).as_bytes(), "").unwrap(),
        read_vtu(&encode_vtu(&VtuData::of_mesh(&mesh)).unwrap(), "").unwrap(),
        read_vtk(&encode_vtk(&VtuData::of_mesh(&mesh), false).unwrap(), "").unwrap(),
    ] {
        assert_eq!(
            read.data("fibre_x").unwrap().values.hexahedra,
            mesh.cell_data[0].values.hexahedra
        );
        assert!(read.data("fibre_y").unwrap().values.hexahedra[0].is_nan());
        for data in &read.cell_data {
            assert!(data.values.quads[1].is_nan() && data.values.quads[0].is_finite());
        }
    }
}

#[test]
fn vectors_of_the_vtk_formats() {
    let grid = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
        0 0 0 1 0 0 1 1 0 0 1 0\nCELLS 2 10\n4 0 1 2 3\n4 3 2 1 0\nCELL_TYPES 2\n9\n9\nCELL_DATA 2\n";
    for array in [
        "VECTORS a b float\n1 2 3 4 5 6\n".replace("a b", "v"),
        "NORMALS v float\n1 2 3 4 5 6\n".to_owned(),
        "SCALARS v int 3\nLOOKUP_TABLE default\n1 2 3 4 5 6\n".to_owned(),
        "FIELD f 1\nv 3 2 double\n1 2 3 4 5 6\n".to_owned(),
    ] {
        let mesh = read_vtk(format!("{grid}{array}").as_bytes(), "").unwrap();
        assert_eq!(mesh.cell_data.len(), 3);
        for (name, values) in [("v_x", [1.0, 4.0]), ("v_y", [2.0, 5.0]), ("v_z", [3.0, 6.0])] {
            assert_eq!(mesh.data(name).unwrap().values.quads, values);
        }
        // components are no regions
        assert!(mesh.groups.is_empty());
    }
    let mesh = read_vtk(format!("{grid}FIELD f 1\nv 2 2 int\n1 2 3 4\n").as_bytes(), "").unwrap();
    assert!(mesh.cell_data.is_empty());
}

#[test]
fn pixels_voxels_and_polygons() {
    let corners = "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1";
    let text = format!(
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 float\n{corners}\n\
         CELLS 5 32\n8 0 1 2 3 4 5 6 7\n4 0 1 2 3\n4 0 1 3 2\n5 0 1 5 7 6\n6 0 1 2 4 5 6\n\
         CELL_TYPES 5\n11\n8\n7\n7\n13\n"
    );
    let mesh = read_vtk(text.as_bytes(), "").unwrap();
    assert_eq!(mesh.hexahedra, [[0, 1, 3, 2, 4, 5, 7, 6]]);
    assert!((mesh.total_volume() - 1.0).abs() < 1e-15);
    assert_eq!(mesh.quads, [[0, 1, 3, 2], [0, 1, 3, 2]]);
    let skipped: Vec<(&str, usize)> =
        mesh.skipped.iter().map(|s| (s.kind.as_str(), s.count)).collect();
    assert_eq!(skipped, [("polygon", 1), ("6-node prism", 1)]);
    let report = check(&mesh, &Default::default()).unwrap().report;
    let finding = report.findings.iter().find(|f| f.message.contains("6-node prism")).unwrap();
    assert!(finding.remedy.contains("hexahedra"), "{finding}");
}

#[test]
fn gmsh_4_blocks_of_quads_and_hexahedra() {
    let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"skin\"\n3 2 \"flesh\"\n\
        $EndPhysicalNames\n$Entities\n0 0 1 1\n1 0 0 0 1 1 1 1 1 0\n1 0 0 0 1 1 1 1 2 0\n$EndEntities\n\
        $Nodes\n1 8 1 8\n3 1 0 8\n1\n2\n3\n4\n5\n6\n7\n8\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
        $EndNodes\n$Elements\n2 2 1 2\n2 1 3 1\n1 1 4 3 2\n3 1 5 1\n2 1 2 3 4 5 6 7 8\n$EndElements\n";
    let mesh = read_gmsh(text.as_bytes(), "").unwrap();
    assert_eq!(mesh.quads, [[0, 3, 2, 1]]);
    assert_eq!(mesh.hexahedra, [[0, 1, 2, 3, 4, 5, 6, 7]]);
    assert_eq!(mesh.group("skin").unwrap().cells.quads, [0]);
    assert_eq!(mesh.group("flesh").unwrap().cells.hexahedra, [0]);
    assert!(check(&mesh, &Default::default()).unwrap().report.findings.is_empty());
    // version 2 lists a cell once for each of its groups
    let mut twice = mixed();
    twice.cell_data.clear();
    let elements = encode_gmsh(&twice).lines().filter(|line| line.contains(" 5 2 ")).count();
    assert_eq!(elements, 2);
}

#[test]
fn data_of_the_wrong_length_are_refused() {
    let mesh = mixed();
    for at in 0..4 {
        let mut data = mesh.cell_data.clone();
        let name = ["tetrahedra", "hexahedra", "triangles", "quadrilaterals"][at];
        data[1].values[ElementKind::IN_FILES[at]].push(0.0);
        let file = VtuData { cell_data: &data, ..VtuData::of_mesh(&mesh) };
        for error in [encode_vtu(&file).unwrap_err(), encode_vtk(&file, true).unwrap_err()] {
            assert!(matches!(error, MeshError::LengthMismatch { .. }));
            assert!(error.to_string().contains(name), "{error}");
        }
    }
    let short = [0.0; 6];
    let file = VtuData { cell_scalars: &[("J", &short)], ..VtuData::of_mesh(&mesh) };
    assert!(matches!(encode_vtu(&file), Err(MeshError::LengthMismatch { expected: 7, .. })));
}

/// A unit tetrahedron of second order as other programs list it, one of its faces with six vertices.
const CORNERS_AND_MIDDLES: &str =
    "0 0 0\n1 0 0\n0 1 0\n0 0 1\n.5 0 0\n.5 .5 0\n0 .5 0\n0 0 .5\n.5 0 .5\n0 .5 .5\n";

#[test]
fn second_order_cells_in_the_orders_of_gmsh_and_vtk() {
    let nodes: String =
        (1..).zip(CORNERS_AND_MIDDLES.lines()).map(|(i, line)| format!("{i} {line}\n")).collect();
    let gmsh = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"base\"\n3 2 \"flesh\"\n\
         $EndPhysicalNames\n$Nodes\n10\n{nodes}$EndNodes\n$Elements\n2\n1 9 2 1 1 1 3 2 7 6 5\n\
         2 11 2 2 1 1 2 3 4 5 6 7 8 10 9\n$EndElements\n\
         $ElementData\n1\n\"f\"\n1\n0.0\n3\n0\n1\n2\n1 2.5\n2 3.5\n$EndElementData\n"
    );
    let mesh = read_gmsh(gmsh.as_bytes(), "").unwrap();
    assert_eq!(
        (&mesh.tetrahedra[..], &mesh.middles[..]),
        (&[[0, 1, 2, 3]][..], &[[4, 5, 6, 7, 8, 9]][..])
    );
    assert_eq!(mesh.triangles, [[0, 6, 4], [2, 5, 6], [1, 4, 5], [6, 5, 4]]);
    let base = mesh.group("base").unwrap();
    assert_eq!(
        (&base.vertices[..], &base.cells.triangles[..]),
        (&[0, 1, 2, 4, 5, 6][..], &[0, 1, 2, 3][..])
    );
    assert_eq!(mesh.group("flesh").unwrap().vertices, (0..10).collect::<Vec<u32>>());
    let data = mesh.data("f").unwrap();
    assert_eq!(
        (&data.values.triangles[..], &data.values.tetrahedra[..]),
        (&[2.5; 4][..], &[3.5][..])
    );
    assert!((mesh.total_volume() - 1.0 / 6.0).abs() < 1e-15);
    let report = check(&mesh, &Default::default()).unwrap().report;
    assert!(report.finding(FindingCode::NonConvexCell).is_none(), "{report}");

    let vtk = format!(
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 10 double\n\
         {CORNERS_AND_MIDDLES}CELLS 2 18\n6 0 2 1 6 5 4\n10 0 1 2 3 4 5 6 7 8 9\nCELL_TYPES 2\n22\n24\n"
    );
    let other = read_vtk(vtk.as_bytes(), "").unwrap();
    assert_eq!((&other.middles, &other.triangles), (&mesh.middles, &mesh.triangles));

    // all formats give the same back; a second body of the first order is kept apart by the check alone
    let mut both = mesh.clone();
    both.points.extend([2.0, 3.0].map(|x| DVec3::new(x, 0.0, 0.0)));
    both.points.extend([DVec3::new(2.0, 1.0, 0.0), DVec3::new(2.0, 0.0, 1.0)]);
    both.tetrahedra.push([10, 11, 12, 13]);
    both.middles.push(LINEAR);
    both.cell_data[0].values.tetrahedra.push(4.5);
    for mesh in [&mesh, &both] {
        let formats = [
            read_gmsh(encode_gmsh(mesh).as_bytes(), ""),
            read_vtk(&encode_vtk(&VtuData::of_mesh(mesh), true).unwrap(), ""),
            read_vtk(&encode_vtk(&VtuData::of_mesh(mesh), false).unwrap(), ""),
            read_vtu(&encode_vtu(&VtuData::of_mesh(mesh)).unwrap(), ""),
        ];
        for read in formats {
            let read = read.unwrap();
            assert_eq!((&read.tetrahedra, &read.middles), (&mesh.tetrahedra, &mesh.middles));
            assert_eq!((&read.triangles, &read.points), (&mesh.triangles, &mesh.points));
            assert_eq!(read.group("base").unwrap().vertices, mesh.group("base").unwrap().vertices);
            assert_eq!(
                read.data("f").unwrap().values.tetrahedra,
                mesh.data("f").unwrap().values.tetrahedra
            );
        }
    }
    let error = check(&both, &Default::default()).unwrap_err().to_string();
    assert!(error.contains("mixed-order") && error.contains("1 of 2"), "{error}");
}
