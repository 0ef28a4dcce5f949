//! `sinew check` and `sinew mesh`, as the command calls them.

use sinew::engine::mesh::Mesh;
use sinew::engine::mesh::generate::box_hexahedra;
use sinew_scene::assemble::generate;
use sinew_scene::check::check_file;
use sinew_scene::mesh_tool::{ConvertError, MeshInfo, convert, merge, write};
use sinew_scene::scene::{CylinderShape, Generate, SolidCells, SphereShape};
use sinew_scene::{scene_folder, shipped_scene};
use std::path::{Path, PathBuf};

fn file(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("tools");
    std::fs::create_dir_all(&folder).unwrap();
    folder.join(name)
}

#[test]
fn shipped_scenes_pass_the_check() {
    for name in ["liver", "cantilever", "crush", "slender_cylinder", "static_beam"] {
        let summary = check_file(&shipped_scene(name));
        assert!(summary.usable && summary.kind == "scene", "{summary}");
        assert!(!summary.plan.is_empty());
        assert!(summary.to_string().contains("can be simulated"));
    }
}

#[test]
fn a_bad_mesh_is_reported_with_its_entities() {
    let path = file("bad.vtk");
    let mut mesh = Mesh {
        points: [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
            .map(glam::DVec3::from_array)
            .to_vec(),
        tetrahedra: vec![[0, 1, 3, 2]],
        ..Mesh::default()
    };
    write(&path, &mesh).unwrap();
    let summary = check_file(&path);
    assert!(summary.usable, "an inverted winding is repaired: {summary}");
    assert!(summary.to_string().contains("inverted-winding"), "{summary}");
    mesh.tetrahedra.push([0, 1, 2, 2]);
    write(&path, &mesh).unwrap();
    let summary = check_file(&path);
    assert!(!summary.usable);
    assert!(summary.to_string().contains("repeated-vertex-in-cell"), "{summary}");
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["schema"], "sinew-check/1");

    // a scene that uses it
    let scene = file("bad.toml");
    std::fs::write(
        &scene,
        "name = \"bad\"\ndt = 0.1\nduration = 1.0\n[[body]]\nname = \"b\"\nmesh = \"bad.vtk\"\n\
         material = { preset = \"liver\" }\n",
    )
    .unwrap();
    let summary = check_file(&scene);
    assert!(!summary.usable);
    let error = summary.error.unwrap();
    assert!(error.contains("line 6") && error.contains("repeated-vertex-in-cell"), "{error}");
}

#[test]
fn a_missing_or_foreign_file_is_no_panic() {
    assert!(!check_file(&file("nothing.msh")).usable);
    assert!(!check_file(&file("nothing.toml")).usable);
    assert!(!check_file(&scene_folder().join("README.md")).usable);
}

#[test]
fn meshes_survive_every_format() {
    let liver = scene_folder().join("../meshes/liver.msh");
    let mut last = liver.clone();
    for name in ["liver.vtu", "liver.vtk", "liver.msh"] {
        let next = file(name);
        convert(&last, &next, 1.0, false, None).unwrap();
        last = next;
    }
    let (first, end) = (Mesh::read(&liver).unwrap(), Mesh::read(&last).unwrap());
    assert_eq!(first.points, end.points);
    assert_eq!(first.tetrahedra, end.tetrahedra);
    for name in ["ligament", "tool", "surface", "body"] {
        let vertices = |mesh: &Mesh| mesh.group(name).map(|g| g.vertices.clone());
        assert_eq!(vertices(&first), vertices(&end), "{name}");
    }
    let half = convert(&liver, &file("half.vtu"), 0.5, false, None).unwrap();
    assert!((half.volume / MeshInfo::of(&first).volume - 0.125).abs() < 1e-12);
}

#[test]
fn linear_meshes_become_second_order_ones_that_survive_every_format() {
    let liver = scene_folder().join("../meshes/liver.msh");
    let linear = Mesh::read(&liver).unwrap();
    let mut last = liver.clone();
    for name in ["liver10.vtu", "liver10.msh", "liver10.vtk"] {
        let next = file(name);
        // what is of second order already stays as it is
        let info = convert(&last, &next, 1.0, true, None).unwrap();
        assert!(info.second_order && info.to_string().contains("of second order"), "{info}");
        last = next;
    }
    let (made, read) = (linear.with_second_order(), Mesh::read(&last).unwrap());
    assert_eq!((&made.points, &made.tetrahedra), (&read.points, &read.tetrahedra));
    assert_eq!((&made.middles, &made.triangles), (&read.middles, &read.triangles));
    for name in ["ligament", "tool", "surface", "body"] {
        let vertices = |mesh: &Mesh| mesh.group(name).map(|g| g.vertices.clone());
        assert_eq!(vertices(&made), vertices(&read), "{name}");
    }
    assert!((made.total_volume() / linear.total_volume() - 1.0).abs() < 1e-12);
    let sheet = file("sheet.vtu");
    let triangles = Mesh { triangles: vec![[0, 1, 2]], points: linear.points, ..Mesh::default() };
    write(&sheet, &triangles).unwrap();
    let error = convert(&sheet, &file("sheet10.vtu"), 1.0, true, None).unwrap_err();
    assert!(matches!(error, ConvertError::NoTetrahedra { .. }), "{error}");
}

#[test]
fn generated_shapes_have_their_volume_and_groups() {
    let cylinder = CylinderShape {
        radius: 0.01,
        length: 0.1,
        rings: 4,
        layers: 5,
        elements: SolidCells::Tetrahedra,
    };
    let cylinder = Generate { cylinder: Some(cylinder), ..Generate::default() };
    let info = MeshInfo::of(&generate(&cylinder).unwrap().unwrap());
    assert_eq!(info.tetrahedra, 18 * 16 * 5);
    // a polygon of 24 corners
    let polygon = 12.0 * (std::f64::consts::TAU / 24.0).sin() * 0.01f64.powi(2);
    assert!((info.volume / (polygon * 0.1) - 1.0).abs() < 1e-12, "{}", info.volume);
    assert!(info.groups.iter().any(|g| g.name == "x1"));
    assert!(info.to_string().contains("groups"));

    let sphere = SphereShape { radius: -1.0, shells: 3 };
    let sphere = Generate { sphere: Some(sphere), ..Generate::default() };
    assert!(generate(&sphere).unwrap_err().to_string().contains("radius"));
    assert!(generate(&Generate::default()).unwrap().is_none());
}

#[test]
fn unknown_formats_and_scales_are_refused() {
    let liver = scene_folder().join("../meshes/liver.msh");
    let error = convert(&liver, &file("liver.stp"), 1.0, false, None).unwrap_err();
    assert!(matches!(error, ConvertError::Format { .. }) && error.to_string().contains(".vtu"));
    assert!(matches!(
        convert(&liver, &file("x.vtu"), f64::NAN, false, None).unwrap_err(),
        ConvertError::Scale { .. }
    ));
}

#[test]
fn hexahedra_and_quadrilaterals_are_counted_and_converted() {
    let hexes = box_hexahedra(glam::DVec3::new(0.4, 0.2, 0.2), [4, 2, 2]).unwrap();
    let names = ["hexes.msh", "hexes.vtu", "hexes.vtk", "hexes2.msh"].map(file);
    write(&names[0], &hexes).unwrap();
    for pair in names.windows(2) {
        convert(&pair[0], &pair[1], 1.0, false, None).unwrap();
    }
    let mesh = Mesh::read(&names[3]).unwrap();
    assert_eq!((&mesh.hexahedra, &mesh.quads), (&hexes.hexahedra, &hexes.quads));
    for name in ["x0", "z1", "body"] {
        assert_eq!(mesh.group(name), hexes.group(name));
    }
    let info = MeshInfo::of(&mesh);
    assert_eq!((info.hexahedra, info.quads, info.boundary_quads), (16, 40, 40));
    assert_eq!((info.tetrahedra, info.boundary_triangles), (0, 0));
    assert!((info.volume - 0.016).abs() < 1e-15);
    let [shortest, _, longest] = info.edge_lengths.unwrap();
    assert!((shortest - 0.1).abs() < 1e-15 && (longest - 0.1).abs() < 1e-15);
    let text = info.to_string();
    assert!(text.contains("hexahedra   16") && text.contains("quads       40 in"), "{text}");
    let summary = check_file(&names[3]);
    assert!(summary.usable, "{summary}");
    assert!(summary.to_string().contains("16 hexahedra, 0 triangles, 40 quadrilaterals"));
}

/// Two boxes that share a side, each with vertices of its own, and cell data of which some are missing.
#[test]
fn seams_are_merged_and_data_shown() {
    use glam::DVec3;
    use sinew::engine::mesh::CellData;
    use sinew::engine::mesh::generate::box_tets;
    let mut mesh = box_tets(DVec3::splat(0.1), [1, 1, 1]).unwrap();
    let beside = mesh.clone();
    mesh.points.extend(beside.points.iter().map(|p| *p + DVec3::new(0.1, 1e-8, 0.0)));
    mesh.tetrahedra.extend(beside.tetrahedra.iter().map(|t| t.map(|v| v + 8)));
    mesh.triangles.clear();
    mesh.groups.clear();
    let mut stiffness = CellData { name: "E".into(), ..CellData::default() };
    stiffness.values.tetrahedra = (0..12).map(|i| 1e3 * f64::from(i)).collect();
    stiffness.values.tetrahedra[0] = f64::NAN;
    mesh.cell_data.push(stiffness);
    let file = |name: &str| std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let (seam, whole) = (file("seam.vtu"), file("whole.vtu"));
    write(&seam, &mesh).unwrap();
    let info = merge(&seam, &whole, 1e-6).unwrap();
    assert_eq!(
        (info.vertices, info.merged.unwrap().vertices, info.merged.unwrap().left),
        (12, 4, 0)
    );
    let text = info.to_string();
    assert!(text.contains("merged      4 vertices that lay within 2.000e-7 m"), "{text}");
    assert!(
        text.contains("cell data   E                     11 cells, 1000 to 11000, 1 cells without"),
        "{text}"
    );
    let json = serde_json::to_value(&info).unwrap();
    assert_eq!(json["data"][0]["largest"], 11000.0);
    assert!(matches!(merge(&seam, &whole, 0.0), Err(ConvertError::Tolerance(_))));
    // nearer than they are
    assert_eq!(merge(&seam, &whole, 1e-8).unwrap().merged.unwrap().vertices, 0);
}
