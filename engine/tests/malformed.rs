//! Malformed files: the kind of the error, and the place that its message names.

use sinew_engine::mesh::io::*;
use sinew_engine::mesh::{FileProblem, Mesh, MeshError};

type Reader = fn(&[u8], &str) -> Result<Mesh, MeshError>;

fn node(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    read_tetgen(data, b"0 4 0\n", None, source)
}

fn ele(data: &[u8], source: &str) -> Result<Mesh, MeshError> {
    read_tetgen(b"4 3 0 0\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n", data, None, source)
}

fn kind(error: &MeshError) -> &'static str {
    let MeshError::File { problem, .. } = error else { return "other" };
    match problem {
        FileProblem::Unsupported { .. } => "unsupported",
        FileProblem::UnexpectedEnd { .. } => "end",
        FileProblem::InvalidValue { .. } => "value",
        FileProblem::CountMismatch { .. } => "count",
        FileProblem::UnknownVertex { .. } => "vertex",
        FileProblem::RepeatedNumber { .. } => "repeated",
        FileProblem::MissingSection { .. } => "missing",
        FileProblem::Encoding { .. } => "encoding",
        _ => "other",
    }
}

#[test]
#[allow(clippy::too_many_lines, reason = "a table of files and the errors that they give")]
fn malformed_files_are_refused_at_the_right_place() {
    let f2 = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n";
    let n2 = format!("{f2}$Nodes\n2\n1 0 0 0\n2 1 0 0\n$EndNodes\n");
    let f4 = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n";
    let v = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\n";
    let p = format!("{v}POINTS 2 float\n0 0 0 1 0 0\n");
    let x = "<VTKFile type=\"UnstructuredGrid\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\"1\" NumberOfCells=\"0\">\n";
    let array = |attributes: &str, text: &str| {
        format!(
            "{x}<Points>\n<DataArray type=\"Float64\" {attributes}>{text}</DataArray></Points></Piece></UnstructuredGrid></VTKFile>"
        )
    };
    let gmsh: Reader = read_gmsh;
    let (vtk, vtu, obj, stl): (Reader, Reader, Reader, Reader) =
        (read_vtk, read_vtu, read_obj, read_stl);
    let corpus: Vec<(Reader, String, &str, &str)> = vec![
        (gmsh, "hello".into(), "value", "line 1"),
        (gmsh, "".into(), "missing", "line 1"),
        (gmsh, "$MeshFormat\n".into(), "end", "line 1"),
        (gmsh, "$MeshFormat\nx 0 8\n".into(), "value", "line 2"),
        (gmsh, "$MeshFormat\n4.0 0 8\n".into(), "unsupported", "line 2"),
        (gmsh, "$MeshFormat\n2.2 5 8\n".into(), "value", "line 2"),
        (gmsh, "$MeshFormat\n2.2 0 3\n".into(), "value", "line 2"),
        (gmsh, "$MeshFormat\n2.2 1 8\nabcd\n".into(), "value", "byte offset 24"),
        (gmsh, f2.into(), "missing", "line 4"),
        (gmsh, n2.clone(), "missing", "$Elements"),
        (gmsh, format!("{f2}$Nodes\nmany\n"), "value", "line 5"),
        (gmsh, format!("{f2}$Nodes\n3\n1 0 0 0\n$EndNodes\n"), "count", "line 7"),
        (gmsh, format!("{f2}$Nodes\n1\n1 0 0 0\n2 0 0 0\n"), "value", "line 7"),
        (gmsh, format!("{f2}$Nodes\n1\n1 0 zero 0\n"), "value", "`zero`"),
        (gmsh, format!("{f2}$Nodes\n2\n1 0 0 0\n1 0 0 0\n"), "repeated", "line 7"),
        (gmsh, format!("{f2}$Nodes\n999999999999\n1 0 0 0\n"), "end", "node 2 of 999999999999"),
        (gmsh, format!("{n2}$Elements\n1\n7 4 0 1 2 9 1\n"), "vertex", "element 7"),
        (gmsh, format!("{n2}$Elements\n1\n7 4 0 1 2\n"), "count", "line 11"),
        (gmsh, format!("{n2}$Elements\n1\n7 4 x\n"), "value", "line 11"),
        (gmsh, format!("{n2}$Elements\n1\n7 5 0 1 2 1 2 1 2 1\n"), "count", "8-node hexahedron"),
        (gmsh, format!("{n2}$Elements\n1\n7 5 0 1 2 1 2 1 2 1 3\n"), "vertex", "line 11"),
        (gmsh, format!("{n2}$Elements\n1\n7 3 0 1 2 1\n"), "count", "4-node quadrilateral"),
        (gmsh, format!("{n2}$Elements\n1\n7 3 0 1 2 1 2\n"), "end", "$EndElements"),
        (gmsh, format!("{n2}$Elements\n2\n7 3 0 1 2 1 2\n"), "end", "element 2 of 2"),
        (
            gmsh,
            format!(
                "{n2}$Elements\n1\n7 3 0 1 2 1 2\n$EndElements\n\
                 $ElementData\n1\n\"f\"\n0\n3\n0\n3\n1\n7 0 0\n"
            ),
            "value",
            "line 21",
        ),
        (gmsh, format!("{f2}$Foo\n1\n"), "end", "$EndFoo"),
        (gmsh, format!("{f2}stray\n"), "value", "line 4"),
        (gmsh, format!("{f2}$PhysicalNames\n1\n9 1 \"a\"\n"), "value", "line 6"),
        (gmsh, format!("{f4}$PartitionedEntities\n"), "unsupported", "line 4"),
        (gmsh, format!("{f4}$Nodes\n1 1 1 1\n3 1 0 5\n"), "count", "line 6"),
        (
            gmsh,
            format!("{f4}$Nodes\n0 0 0 0\n$EndNodes\n$Elements\n1 1 1 1\n7 1 2 1\n"),
            "value",
            "line 9",
        ),
        (vtk, "PK".into(), "value", "line 1"),
        (vtk, v.replace("ASCII", "EBCDIC"), "value", "line 3"),
        (vtk, v.replace("UNSTRUCTURED_GRID", "POLYDATA"), "unsupported", "line 4"),
        (vtk, v.into(), "missing", "POINTS"),
        (vtk, format!("{v}POINTS 2 float\n0 0 0 1"), "end", "line 6"),
        (vtk, format!("{v}POINTS 2 quaternion\n"), "value", "line 5"),
        (vtk, format!("{v}POINTS 2 float\n0 0 0 1 0 o\n"), "value", "line 6"),
        (vtk, format!("{p}CELLS 1 3\n2 0 5\nCELL_TYPES 1\n3\n"), "vertex", "line 7"),
        (vtk, format!("{p}CELLS 2 3\n2 0 1\n"), "count", "line 8"),
        (vtk, format!("{p}CELLS 1 3\n2 0 1\nCELL_TYPES 1\n10\n"), "count", "tetrahedron"),
        (vtk, format!("{p}CELLS 1 5\n4 0 1 0 1\nCELL_TYPES 1\n12\n"), "count", "8-node hexahedron"),
        (vtk, format!("{p}CELLS 1 4\n3 0 1 0\nCELL_TYPES 1\n9\n"), "count", "quadrilateral"),
        (vtk, format!("{p}CELLS 1 9\n8 0 1 0 1 0 1 0 2\nCELL_TYPES 1\n11\n"), "vertex", "voxel"),
        (vtk, format!("{p}CELLS 1 9\n8 0 1 0 1 0 1 0\n"), "end", "line 9"),
        (
            vtk,
            format!(
                "{p}CELLS 1 5\n4 0 1 0 1\nCELL_TYPES 1\n9\nCELL_DATA 2\nVECTORS f float\n1 2 3 4 5 6\n"
            ),
            "count",
            "`f_x`",
        ),
        (vtk, v.replace("ASCII", "BINARY") + "POINTS 99999999 double\nabc", "end", "byte offset"),
        (vtu, "<VTKFile type=\"PolyData\">".into(), "unsupported", "line 1"),
        (vtu, "<a>".into(), "missing", "VTKFile"),
        (vtu, "<a>\n</b>".into(), "value", "line 2"),
        (vtu, x.into(), "missing", "line 4"),
        (vtu, x.replace("\"1\"", "\"one\""), "value", "line 3"),
        (vtu, array("format=\"ascii\"", "0 0"), "count", "line 5"),
        (vtu, array("format=\"ascii\"", "0\n0 q"), "value", "line 6"),
        (vtu, array("format=\"binary\"", "A*AA"), "encoding", "line 5"),
        (vtu, array("format=\"binary\"", "////fw=="), "end", "line 5"),
        (vtu, array("format=\"appended\" offset=\"0\"", ""), "missing", "AppendedData"),
        (vtu, array("format=\"morse\"", "0"), "value", "line 5"),
        (
            vtu,
            array("format=\"binary\"", "AQAAABgAAAAAAAAABAAAAA==AAAAAA==")
                .replace("<VTKFile", "<VTKFile compressor=\"vtkZLibDataCompressor\""),
            "encoding",
            "line 5",
        ),
        (node, "2 2 0 0\n".into(), "value", "f.node, line 1"),
        (node, "2 3 0 0\n1 0 0 0\n".into(), "end", "node 2 of 2"),
        (node, "2 3 0 0\n1 0 0 0\n1 0 0 0\n".into(), "repeated", "line 3"),
        (ele, "1 5 0\n".into(), "value", "f.ele, line 1"),
        (ele, "1 4 0\n1 0 1 2 3\n".into(), "vertex", "line 2"),
        (ele, "1 4 1\n1 1 2 3 4\n".into(), "value", "line 2"),
        (obj, "v 0 0\n".into(), "value", "line 1"),
        (obj, "v 0 0 0\nf 1 1 2\n".into(), "vertex", "line 2"),
        (obj, "v 0 0 0\nf 1 1\n".into(), "count", "line 2"),
        (obj, "v 0 0 0\nf 0 1 1\n".into(), "vertex", "line 2"),
        (obj, "\nwhat\n".into(), "value", "line 2"),
        (obj, "# nothing\n".into(), "missing", "line 2"),
        (stl, "solid a\nfacet normal 0 0 1\nvertex 0 0 0\nendfacet\n".into(), "count", "line 4"),
        (stl, "solid a\n".into(), "end", "line 1"),
        (stl, "solid a\nvertex 0 0 k\n".into(), "value", "line 2"),
        (stl, "short".into(), "end", "byte offset 0"),
        (stl, "x".repeat(84), "end", "byte offset 84"),
    ];
    assert!(corpus.len() >= 30);
    for (reader, text, expected, place) in corpus {
        let error = reader(text.as_bytes(), "f").expect_err(&text);
        let message = error.to_string();
        assert_eq!(kind(&error), expected, "{message}\n{text}");
        assert!(message.contains(place), "{place}: {message}\n{text}");
        assert!(message.starts_with("f") && message.contains("; "), "{message}");
        assert!(message.contains("line ") || message.contains("byte offset "), "{message}");
    }
}
