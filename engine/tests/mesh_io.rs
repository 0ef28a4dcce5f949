//! Writers through readers, text against binary, and every reader on damaged files.

use glam::{DVec2, DVec3};
use proptest::prelude::*;
use sinew_engine::element_kind::ByKind;
use sinew_engine::mesh::generate::{box_hexahedra, box_tets, triangle_grid};
use sinew_engine::mesh::io::*;
use sinew_engine::mesh::{CellData, FileLines, FileProblem, Group, Mesh, MeshError};
use std::io::ErrorKind;
use std::path::Path;

/// The mesh without what differs between files of equal content.
fn bare(mut mesh: Mesh) -> Mesh {
    mesh.source.clear();
    mesh.lines = FileLines::default();
    mesh.skipped.clear();
    mesh
}

fn cube() -> Mesh {
    let mut mesh = box_tets(DVec3::new(0.1, 0.2, 1.0 / 3.0), [2, 1, 2]).unwrap();
    let vertices = vec![0, 4, 7];
    mesh.groups.push(Group { name: "two words".to_owned(), vertices, ..Group::default() });
    bare(mesh)
}

fn by_name(mut mesh: Mesh) -> Mesh {
    mesh.groups.sort_by(|a, b| (a.dimension, &a.name).cmp(&(b.dimension, &b.name)));
    bare(mesh)
}

#[test]
fn written_files_read_back_the_same() {
    for mesh in [cube(), bare(triangle_grid(DVec2::ONE, [3, 2]).unwrap())] {
        let mesh = by_name(mesh);
        let data = VtuData::of_mesh(&mesh);
        let vtu = encode_vtu(&data).unwrap();
        assert_eq!(by_name(read_vtu(&vtu, "a.vtu").unwrap()), mesh);
        for binary in [false, true] {
            let vtk = encode_vtk(&data, binary).unwrap();
            assert_eq!(by_name(read_vtk(&vtk, "a.vtk").unwrap()), mesh);
        }
        let msh = encode_gmsh(&mesh);
        assert_eq!(by_name(read_gmsh(msh.as_bytes(), "a.msh").unwrap()), mesh);
    }
}

#[test]
fn numbers_of_cells_survive_every_format() {
    let mut mesh = cube();
    let (n_tets, n_triangles) = (mesh.tetrahedra.len(), mesh.triangles.len());
    let stiffness = |i: usize| 1e3 + i as f64 / 3.0;
    let label = |i: usize| (i % 3) as f64;
    let data = |name: &str, integer, value: &dyn Fn(usize) -> f64| CellData {
        name: name.to_owned(),
        integer,
        values: ByKind {
            tetrahedra: (0..n_tets).map(value).collect(),
            triangles: (n_tets..n_tets + n_triangles).map(value).collect(),
            ..ByKind::default()
        },
    };
    mesh.cell_data = vec![data("young modulus", false, &stiffness), data("fibre", true, &label)];
    let file = VtuData::of_mesh(&mesh);
    let vtu = read_vtu(&encode_vtu(&file).unwrap(), "").unwrap();
    assert_eq!(vtu.cell_data, mesh.cell_data);
    // a label also names the regions it divides the mesh into, as before
    assert!(vtu.group("fibre 2").is_some());
    for binary in [false, true] {
        let vtk = read_vtk(&encode_vtk(&file, binary).unwrap(), "").unwrap();
        assert_eq!(vtk.cell_data, mesh.cell_data);
    }
    let msh = read_gmsh(encode_gmsh(&mesh).as_bytes(), "").unwrap();
    assert_eq!(
        msh.data("young modulus").unwrap().values.tetrahedra,
        mesh.cell_data[0].values.tetrahedra
    );
    let fibre = msh.data("fibre").unwrap();
    // the format stores reals only
    assert_eq!(
        (fibre.integer, &fibre.values.triangles),
        (false, &mesh.cell_data[1].values.triangles)
    );
    let short = VtuData { cell_data: &[CellData::default()], ..file };
    assert!(matches!(encode_vtu(&short), Err(MeshError::LengthMismatch { .. })));
}

#[test]
fn gmsh_data_of_elements() {
    let data = |count: usize, lines: &str| {
        let head = "$ElementData\n1\n\"stiffness\"\n1\n0.0\n3\n0\n1";
        read_gmsh(format!("{MSH_2}{head}\n{count}\n{lines}$EndElementData\n").as_bytes(), "")
    };
    let mesh = data(3, "1 7\n4 2.5e3\n3 8\n").unwrap();
    // elements 2 and 3 are the same triangle in two groups
    assert_eq!(mesh.data("stiffness").unwrap().values.tetrahedra, [2.5e3]);
    assert_eq!(mesh.data("stiffness").unwrap().values.triangles, [8.0]);
    // without a value for the tetrahedron
    let mesh = data(1, "3 8\n").unwrap();
    assert!(mesh.data("stiffness").unwrap().values.tetrahedra[0].is_nan());
    let problem = |count, values| match data(count, values) {
        Err(MeshError::File { problem, .. }) => problem,
        other => panic!("{other:?}"),
    };
    assert!(matches!(problem(2, "3 8\n"), FileProblem::CountMismatch { .. }));
    assert!(matches!(problem(1, "3 x\n"), FileProblem::InvalidValue { .. }));
}

#[test]
fn files_on_disk_and_their_data() {
    let folder = std::env::temp_dir().join(format!("sinew-mesh-io-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mesh = cube();
    let zeros = vec![0.0; mesh.points.len()];
    let data = VtuData {
        point_vectors: &[("displacement <m>", &mesh.points)],
        point_scalars: &[("load", &zeros)],
        single_precision: true,
        ..VtuData::of_mesh(&mesh)
    };
    write_vtu(&folder.join("a.vtu"), &data).unwrap();
    write_vtk(&folder.join("a.vtk"), &data).unwrap();
    write_gmsh(&folder.join("a.msh"), &mesh).unwrap();
    write_pvd(&folder.join("a.pvd"), &[(0.0, "a.vtu".to_owned())]).unwrap();
    for name in ["a.vtu", "a.vtk", "a.msh"] {
        let read = Mesh::read(&folder.join(name)).unwrap();
        assert_eq!(read.source, name);
        assert_eq!(read.tetrahedra, mesh.tetrahedra);
        let error = |(a, b): (&DVec3, &DVec3)| (*a - *b).length();
        assert!(read.points.iter().zip(&mesh.points).map(error).all(|e| e < 1e-7));
    }
    assert!(matches!(Mesh::read(&folder.join("none.msh")), Err(MeshError::Io { .. })));
    std::fs::write(folder.join("a.xyz"), "hello").unwrap();
    let error = Mesh::read(&folder.join("a.xyz")).unwrap_err();
    assert!(matches!(error, MeshError::UnknownFormat { .. }), "{error}");
    std::fs::remove_dir_all(&folder).unwrap();
    let short = VtuData { point_scalars: &[("load", &zeros[1..])], ..data };
    assert!(matches!(
        encode_vtu(&short),
        Err(MeshError::LengthMismatch { expected: 18, found: 17, .. })
    ));
}

const MSH_2: &str = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 3 \"face\"\n\
    $EndPhysicalNames\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n7 0 0 0.5\n$EndNodes\n$Elements\n4\n\
    1 15 2 9 1 1\n2 2 2 3 1 1 3 2\n3 2 2 4 1 1 3 2\n4 4 2 7 1 1 2 3 7\n$EndElements\n";

const MSH_4: &str = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 3 \"face\"\n\
    $EndPhysicalNames\n$Entities\n1 0 1 1\n5 0 0 0 1 9\n1 0 0 0 1 1 1 2 3 4 0\n\
    1 0 0 0 1 1 1 1 7 1 1\n$EndEntities\n$Nodes\n1 4 1 7\n3 1 0 4\n1\n2\n3\n7\n0 0 0\n1 0 0\n\
    0 1 0\n0 0 0.5\n$EndNodes\n$Elements\n3 3 1 4\n0 5 15 1\n1 1\n2 1 2 1\n2 1 3 2\n3 1 4 1\n\
    4 1 2 3 7\n$EndElements\n";

/// Bytes of either order.
struct Bytes(Vec<u8>, bool);

impl Bytes {
    fn text(&mut self, text: &str) {
        self.0.extend_from_slice(text.as_bytes());
    }
    fn raw<const N: usize>(&mut self, mut bytes: [u8; N]) {
        if self.1 {
            bytes.reverse();
        }
        self.0.extend(bytes);
    }
    fn ints(&mut self, values: &[i32]) {
        values.iter().for_each(|v| self.raw(v.to_le_bytes()));
    }
    fn sizes(&mut self, values: &[u64]) {
        values.iter().for_each(|v| self.raw(v.to_le_bytes()));
    }
    fn reals(&mut self, values: &[f64]) {
        values.iter().for_each(|v| self.raw(v.to_le_bytes()));
    }
    fn head(big: bool, version: &str) -> Bytes {
        let mut b = Bytes(Vec::new(), big);
        b.text(&format!("$MeshFormat\n{version} 1 8\n"));
        b.ints(&[1]);
        b.text("\n$EndMeshFormat\n$PhysicalNames\n1\n2 3 \"face\"\n$EndPhysicalNames\n");
        b
    }
}

const POINTS: [[f64; 3]; 4] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]];

fn binary_2(big: bool) -> Vec<u8> {
    let mut b = Bytes::head(big, "2.2");
    b.text("$Nodes\n4\n");
    for (number, point) in [1, 2, 3, 7].into_iter().zip(POINTS) {
        b.ints(&[number]);
        b.reals(&point);
    }
    b.text("\n$EndNodes\n$Elements\n4\n");
    b.ints(&[15, 1, 2, 1, 9, 1, 1]);
    b.ints(&[2, 2, 2, 2, 3, 1, 1, 3, 2, 3, 4, 1, 1, 3, 2]);
    b.ints(&[4, 1, 2, 4, 7, 1, 1, 2, 3, 7]);
    b.text("\n$EndElements\n");
    b.0
}

fn binary_4(big: bool) -> Vec<u8> {
    let mut b = Bytes::head(big, "4.1");
    b.text("$Entities\n");
    b.sizes(&[1, 0, 1, 1]);
    b.ints(&[5]);
    b.reals(&[0.0; 3]);
    b.sizes(&[1]);
    b.ints(&[9]);
    for physical in [&[3, 4][..], &[7]] {
        b.ints(&[1]);
        b.reals(&[0.0; 6]);
        b.sizes(&[physical.len() as u64]);
        b.ints(physical);
        b.sizes(&[0]);
    }
    b.text("\n$EndEntities\n$Nodes\n");
    b.sizes(&[1, 4, 1, 7]);
    b.ints(&[3, 1, 0]);
    b.sizes(&[4, 1, 2, 3, 7]);
    POINTS.iter().for_each(|point| b.reals(point));
    b.text("\n$EndNodes\n$Elements\n");
    b.sizes(&[3, 3, 1, 4]);
    for (head, cell) in
        [([0, 5, 15], &[1, 1][..]), ([2, 1, 2], &[2, 1, 3, 2]), ([3, 1, 4], &[4, 1, 2, 3, 7])]
    {
        b.ints(&head);
        b.sizes(&[1]);
        b.sizes(cell);
    }
    b.text("\n$EndElements\n");
    b.0
}

#[test]
fn gmsh_versions_and_encodings_agree() {
    let text = read_gmsh(MSH_2.as_bytes(), "").unwrap();
    assert_eq!(text.lines.cells.tetrahedra, [20]);
    assert_eq!(text.skipped[0].kind, "point");
    assert_eq!((text.tetrahedra.len(), text.triangles.len()), (1, 1));
    let names: Vec<(u8, &str)> =
        text.groups.iter().map(|g| (g.dimension, g.name.as_str())).collect();
    assert_eq!(names, [(0, "9"), (2, "face"), (2, "4"), (3, "7")]);
    assert_eq!(
        text.group("face").unwrap().cells.triangles,
        text.group("4").unwrap().cells.triangles
    );
    assert_eq!(text.group("7").unwrap().vertices, [0, 1, 2, 3]);
    let text = bare(text);
    assert_eq!(bare(read_gmsh(MSH_4.as_bytes(), "").unwrap()), text);
    for big in [false, true] {
        assert_eq!(bare(read_gmsh(&binary_2(big), "").unwrap()), text);
        assert_eq!(bare(read_gmsh(&binary_4(big), "").unwrap()), text);
    }
}

const MSH_1: &str =
    "$NOD\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$ENDNOD\n$ELM\n1\n1 4 7 1 4 1 2 3 4\n$ENDELM\n";
const VTK: &str = "# vtk DataFile Version 2.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
    0 0 0 1 0 0\n0 1 0 0 0 1\nCELLS 2 9\n4 0 1 2 3\n3 0 2 1\nCELL_TYPES 2\n10\n5\nCELL_DATA 2\n\
    SCALARS region int 1\nLOOKUP_TABLE default\n3\n8\nPOINT_DATA 4\nVECTORS u float\n0 0 0 0 0 0 0 0 0 0 0 0\n";
const VTK_5: &str = "# vtk DataFile Version 5.1\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
    0 0 0 1 0 0\n0 1 0 0 0 1\nMETADATA\nINFORMATION 0\n\nCELLS 3 7\nOFFSETS vtktypeint64\n0 4 7\n\
    CONNECTIVITY vtktypeint64\n0 1 2 3 0 2 1\nCELL_TYPES 2\n10\n5\nCELL_DATA 2\nFIELD f 1\nregion 1 2 int\n3 8\n";
const VTU: &str = "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\">\n\
    <UnstructuredGrid><Piece NumberOfPoints=\"4\" NumberOfCells=\"2\">\n<Points><DataArray type=\"Float32\" \
    NumberOfComponents=\"3\" format=\"ascii\">\n0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>\n<Cells>\
    <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 3 0 2 1</DataArray>\n\
    <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">4 7</DataArray>\n\
    <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\">10 5</DataArray></Cells>\n\
    <CellData><DataArray type=\"Int32\" Name=\"region\" format=\"ascii\">3 8</DataArray></CellData>\n\
    </Piece></UnstructuredGrid></VTKFile>\n";
/// The connectivity in base64, its header padded apart (as VTK writes) or together with the data.
const BASE64: [&str; 2] = [
    "HAAAAA==AAAAAAEAAAACAAAAAwAAAAAAAAACAAAAAQAAAA==",
    "HAAAAAAAAAABAAAAAgAAAAMAAAAAAAAAAgAAAAEAAAA=",
];
const NODE: &str =
    "# made by hand\n4 3 1 1\n0 0 0 0 0.5 1\n1 1 0 0 0.5 0\n2 0 1 0 0.5 1\n3 0 0 1 0.5 0\n";
const ELE: &str = "1 4 1\n0 0 1 2 3 3\n";
const FACE: &str = "1 1\n0 0 2 1 5\n";
const OBJ: &str =
    "# x\no ball\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng cap\nf 1/1/1 2//2 3/3\nf -4 -3 -2 -1\n";
const STL: &str = "solid top\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
    endloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex -0 0 0\nvertex 0 1 0\nvertex -1 0 0\nendloop\nendfacet\nendsolid\n";

#[test]
fn vectors_of_cells_become_three_columns() {
    let vtu = VTU.replace(
        "<CellData>",
        "<CellData><DataArray type=\"Float64\" Name=\"fibre\" NumberOfComponents=\"3\" \
         format=\"ascii\">0.5 -1 2 3 4 5</DataArray>",
    );
    let vtk = VTK.replace("SCALARS region", "VECTORS fibre float\n0.5 -1 2 3 4 5\nSCALARS region");
    for mesh in [read_vtu(vtu.as_bytes(), "").unwrap(), read_vtk(vtk.as_bytes(), "").unwrap()] {
        for (name, tetrahedron, triangle) in
            [("fibre_x", 0.5, 3.0), ("fibre_y", -1.0, 4.0), ("fibre_z", 2.0, 5.0)]
        {
            let data = mesh.data(name).unwrap();
            assert_eq!(
                (&data.values.tetrahedra[..], &data.values.triangles[..]),
                (&[tetrahedron][..], &[triangle][..])
            );
        }
        assert_eq!(mesh.data("region").unwrap().values.tetrahedra, [3.0]);
    }
    // one number short
    let short = vtu.replace("4 5</DataArray>", "4</DataArray>");
    assert!(read_vtu(short.as_bytes(), "short.vtu").is_err());
}

/// Zeros and ones under any name are a group, of whatever type and on whatever they are; other numbers are none.
#[test]
fn masks_are_groups() {
    let vtu = VTU
        .replace(
            "<CellData>",
            "<PointData><DataArray type=\"Int8\" Name=\"held\" format=\"ascii\">1 0 0 1</DataArray>\
             <DataArray type=\"Float64\" Name=\"pulled\" format=\"ascii\">0 1 1 0</DataArray>\
             <DataArray type=\"Float64\" Name=\"heat\" format=\"ascii\">0 1 1 0.5</DataArray>\
             <DataArray type=\"Float64\" Name=\"ones\" format=\"ascii\">1 1 1 1</DataArray></PointData><CellData>\
             <DataArray type=\"Float64\" Name=\"hard\" format=\"ascii\">1 0</DataArray>\
             <DataArray type=\"UInt8\" Name=\"skin\" format=\"ascii\">0 1</DataArray>\
             <DataArray type=\"Float64\" Name=\"fibre\" NumberOfComponents=\"3\" format=\"ascii\">1 0 0 0 1 0</DataArray>",
        );
    let vtk = VTK
        .replace("CELL_DATA 2\n", "CELL_DATA 2\nFIELD f 2\nhard 1 2 double\n1 0\nskin 1 2 unsigned_char\n0 1\n")
        .replace(
            "POINT_DATA 4\n",
            "POINT_DATA 4\nSCALARS held char 1\nLOOKUP_TABLE default\n1 0 0 1\nFIELD f 3\npulled 1 4 double\n\
             0 1 1 0\nheat 1 4 float\n0 1 1 0.5\nones 1 4 float\n1 1 1 1\n",
        );
    for mesh in [read_vtu(vtu.as_bytes(), "").unwrap(), read_vtk(vtk.as_bytes(), "").unwrap()] {
        let names: Vec<(u8, &str)> =
            mesh.groups.iter().map(|g| (g.dimension, g.name.as_str())).collect();
        for expected in
            [(0, "held"), (0, "pulled"), (3, "hard"), (2, "skin"), (3, "skin 0"), (3, "region 3")]
        {
            assert!(names.contains(&expected), "{expected:?} in {names:?}");
        }
        assert_eq!(names.len(), 4 + 2 + 2, "{names:?}");
        assert_eq!(mesh.group("held").unwrap().vertices, [0, 3]);
        assert_eq!(mesh.group("pulled").unwrap().vertices, [1, 2]);
        assert_eq!(mesh.group("hard").unwrap().cells.tetrahedra, [0]);
        assert_eq!(mesh.group("skin").unwrap().vertices, [0, 1, 2]);
        // data stay what they are
        assert_eq!(mesh.data("hard").unwrap().values.tetrahedra, [1.0]);
    }
    // what is no mask in one piece is none in another
    let (from, to) = (vtu.find("<Piece").unwrap(), vtu.find("</UnstructuredGrid>").unwrap());
    let second = vtu[from..to].replace("1 0 0 1</DataArray>", "1 0 7 1</DataArray>");
    let both = vtu.replace("</UnstructuredGrid>", &format!("{second}</UnstructuredGrid>"));
    let mesh = read_vtu(both.as_bytes(), "").unwrap();
    assert!(mesh.group("held").is_none());
    assert_eq!(mesh.group("pulled").unwrap().vertices, [1, 2, 5, 6]);
    assert_eq!(mesh.group("hard").unwrap().cells.tetrahedra, [0, 1]);
}

#[test]
fn vtk_formats_agree() {
    let mesh = bare(read_vtk(VTK.as_bytes(), "").unwrap());
    assert_eq!(mesh.group("region 3").unwrap().cells.tetrahedra, [0]);
    assert_eq!(mesh.group("region 8").unwrap().cells.triangles, [0]);
    assert_eq!(bare(read_vtk(VTK_5.as_bytes(), "").unwrap()), mesh);
    assert_eq!(bare(read_vtu(VTU.as_bytes(), "").unwrap()), mesh);
    for text in BASE64 {
        let vtu = VTU.replace(
            "\"connectivity\" format=\"ascii\">0 1 2 3 0 2 1",
            &format!("\"connectivity\" format=\"binary\">\n{text}\n"),
        );
        assert_eq!(bare(read_vtu(vtu.as_bytes(), "").unwrap()), mesh);
    }
}

#[test]
fn tetgen_obj_stl_and_gmsh_1() {
    let mesh =
        read_tetgen(NODE.as_bytes(), ELE.as_bytes(), Some(FACE.as_bytes()), "a.ele").unwrap();
    assert_eq!(mesh.group("marker 1").unwrap().vertices, [0, 2]);
    assert_eq!(mesh.group("region 3").unwrap().cells.tetrahedra, [0]);
    assert_eq!(mesh.group("marker 5").unwrap().cells.triangles, [0]);
    let mesh = read_obj(OBJ.as_bytes(), "").unwrap();
    assert_eq!(
        (mesh.triangles.as_slice(), mesh.quads.as_slice()),
        (&[[0, 1, 2]][..], &[[0, 1, 2, 3]][..])
    );
    assert_eq!((&mesh.lines.cells.quads[..], mesh.skipped.len()), (&[9][..], 0));
    assert_eq!(mesh.group("cap").unwrap().vertices, [0, 1, 2, 3]);
    let mesh = read_stl(STL.as_bytes(), "").unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.group("top").unwrap().cells.triangles, [0, 1]);
    let mut binary = vec![b's'; 80];
    binary.extend(2u32.to_le_bytes());
    for triangle in &mesh.triangles {
        binary.extend([0; 12]);
        for &v in triangle {
            let point = mesh.points[v as usize].as_vec3().to_array();
            point.iter().for_each(|x| binary.extend(x.to_le_bytes()));
        }
        binary.extend([0; 2]);
    }
    assert_eq!(read_stl(&binary, "").unwrap().points, mesh.points);
    let mesh = read_gmsh(MSH_1.as_bytes(), "").unwrap();
    assert_eq!((mesh.tetrahedra.len(), mesh.groups[0].name.as_str()), (1, "7"));
}

#[test]
fn bytes_of_every_format_are_a_mesh() {
    let cube = cube();
    let data = VtuData::of_mesh(&cube);
    let files = [
        ("a.vtu", encode_vtu(&data).unwrap()),
        ("a.vtk", encode_vtk(&data, false).unwrap()),
        ("b.vtk", encode_vtk(&data, true).unwrap()),
        ("a.msh", encode_gmsh(&cube).into_bytes()),
        ("b.msh", binary_4(true)),
        ("c.msh", MSH_1.into()),
        ("a.obj", OBJ.into()),
        ("a.stl", STL.into()),
        ("a.node", NODE.into()),
        ("a.ele", ELE.into()),
        ("a.face", FACE.into()),
    ];
    let open = |path: &Path| {
        let found = files.iter().find(|(name, _)| path == Path::new(name));
        found.map(|(_, bytes)| bytes.clone()).ok_or(ErrorKind::NotFound.into())
    };
    for (name, bytes) in &files[..8] {
        let mesh = Mesh::from_bytes(name, bytes).unwrap();
        assert_eq!(mesh.source, *name);
        assert_eq!(Mesh::read_with(Path::new(name), &open).unwrap(), mesh);
        assert!(!mesh.points.is_empty());
    }
    let whole = read_tetgen(NODE.as_bytes(), ELE.as_bytes(), Some(FACE.as_bytes()), "a.node");
    assert_eq!(Mesh::read_with(Path::new("a.node"), &open).unwrap(), whole.unwrap());
    // the file of faces may be missing, that of tetrahedra may not
    let without = |lost: &'static str| {
        move |path: &Path| {
            if path == Path::new(lost) { Err(ErrorKind::NotFound.into()) } else { open(path) }
        }
    };
    let bare = Mesh::read_with(Path::new("a.ele"), &without("a.face")).unwrap();
    assert_eq!((bare.tetrahedra.len(), bare.triangles.len()), (1, 0));
    let error = Mesh::read_with(Path::new("a.node"), &without("a.ele")).unwrap_err();
    assert!(error.to_string().starts_with("a.ele: "), "{error}");
    let refuse = |path: &Path| {
        if path == Path::new("a.face") {
            Err(ErrorKind::PermissionDenied.into())
        } else {
            open(path)
        }
    };
    assert!(matches!(Mesh::read_with(Path::new("a.node"), &refuse), Err(MeshError::Io { .. })));
    let error = Mesh::from_bytes("a.node", NODE.as_bytes()).unwrap_err();
    assert!(matches!(error, MeshError::SeveralFiles { .. }), "{error}");
}

/// Every reader on the same bytes; the answer does not matter, coming back does.
fn read_all(bytes: &[u8]) {
    let _ = read_gmsh(bytes, "f");
    let _ = read_vtk(bytes, "f");
    let _ = read_vtu(bytes, "f");
    let _ = read_obj(bytes, "f");
    let _ = read_stl(bytes, "f");
    let _ = read_tetgen(bytes, bytes, Some(bytes), "f");
    let _ = read_tetgen(NODE.as_bytes(), bytes, Some(bytes), "f");
}

fn samples() -> Vec<Vec<u8>> {
    let text = [MSH_1, MSH_2, MSH_4, VTK, VTK_5, VTU, NODE, ELE, FACE, OBJ, STL];
    let mut samples: Vec<Vec<u8>> = text.map(|text| text.as_bytes().to_vec()).into();
    samples.extend([false, true].into_iter().flat_map(|big| [binary_2(big), binary_4(big)]));
    let mesh = cube();
    samples.push(encode_vtu(&VtuData::of_mesh(&mesh)).unwrap());
    samples.push(encode_vtk(&VtuData::of_mesh(&mesh), true).unwrap());
    let mut mesh = box_hexahedra(DVec3::ONE, [2, 1, 1]).unwrap();
    mesh.cell_data.push(CellData {
        name: "f_x".to_owned(),
        values: ByKind { hexahedra: vec![0.5; 2], quads: vec![0.25; 10], ..ByKind::default() },
        ..CellData::default()
    });
    samples.push(encode_vtu(&VtuData::of_mesh(&mesh)).unwrap());
    samples.push(encode_vtk(&VtuData::of_mesh(&mesh), true).unwrap());
    samples.push(encode_gmsh(&mesh).into_bytes());
    samples
}

#[test]
fn every_truncation_is_survived() {
    for sample in samples() {
        for length in (0..sample.len()).step_by(1 + sample.len() / 1000) {
            read_all(&sample[..length]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn arbitrary_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        read_all(&bytes);
        for start in ["$MeshFormat\n4.1 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Nodes\n", "# vtk DataFile Version 3.0\n\nBINARY\nDATASET UNSTRUCTURED_GRID\n", "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>"] {
            let mut file = start.as_bytes().to_vec();
            file.extend(&bytes);
            read_all(&file);
        }
    }

    #[test]
    fn damaged_files_are_survived(
        which in any::<prop::sample::Index>(),
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..4u8), 1..6),
    ) {
        let samples = samples();
        let mut file = samples[which.index(samples.len())].clone();
        for (at, byte, kind) in edits {
            let at = at.index(file.len().max(1)).min(file.len().saturating_sub(1));
            match kind {
                _ if file.is_empty() => {}
                0 => file[at] = byte,
                1 => file[at] = b'0' + byte % 10,
                2 => { file.remove(at); }
                _ => file.splice(at..at, *b"99999999999").for_each(drop),
            }
        }
        read_all(&file);
    }
}
