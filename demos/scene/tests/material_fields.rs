//! Materials from the cell data of a mesh file, and cell data in the frames.

use crate::common::says;
use glam::DVec3;
use sinew::engine::connectivity::ByKind;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::mesh::io::{VtuData, write_gmsh, write_vtk, write_vtu};
use sinew::engine::mesh::{CellData, Mesh};
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::error::{SceneError, SceneProblem};
use sinew_scene::output::Writer;
use sinew_scene::scene::LoadedScene;
use std::path::Path;

fn mesh() -> Mesh {
    let mut mesh = box_tets(DVec3::new(0.2, 0.04, 0.04), [4, 1, 1]).unwrap();
    let (n, n_triangles) = (mesh.tetrahedra.len(), mesh.triangles.len());
    let data = |name: &str, integer, tetrahedra| CellData {
        name: name.into(),
        integer,
        values: ByKind { tetrahedra, triangles: vec![0.0; n_triangles], ..ByKind::default() },
    };
    let halves = |low: f64, high: f64| -> Vec<f64> {
        let x = |t: &[u32; 4]| t.iter().map(|&v| mesh.points[v as usize].x).sum::<f64>() / 4.0;
        mesh.tetrahedra.iter().map(|t| if x(t) < 0.1 { low } else { high }).collect()
    };
    let (stiffness, density) = (halves(1e4, 4e4), halves(900.0, 1100.0));
    let fibre = (0..n).map(|i| (i % 5) as f64).collect();
    mesh.cell_data = vec![
        data("stiffness", false, stiffness),
        data("rho", false, density),
        data("fibre", true, fibre),
        data("bad", false, vec![-1.0; n]),
    ];
    mesh
}

fn scene(file: &str, material: &str) -> String {
    format!(
        "name = \"bar\"\ndt = 0.01\nduration = 0.02\n\n[[body]]\nname = \"bar\"\nmesh = \"{file}\"\n\
         [body.material]\nyoung_modulus = 1e4\npoisson_ratio = 0.3\ndensity = 1000.0\n{material}\n"
    )
}

fn attempt(folder: &Path, text: &str) -> Result<sinew_scene::assemble::BuiltScene, SceneError> {
    let scene = LoadedScene::parse(text, &folder.join("bar.toml"))?;
    build(&scene, &BuildOptions { threads: Some(1), ..Default::default() })
}

#[test]
fn fields_of_every_format_reach_the_body_and_the_frames() {
    let folder = std::env::temp_dir().join(format!("sinew-material-fields-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mesh = mesh();
    write_vtu(&folder.join("a.vtu"), &VtuData::of_mesh(&mesh)).unwrap();
    write_vtk(&folder.join("a.vtk"), &VtuData::of_mesh(&mesh)).unwrap();
    write_gmsh(&folder.join("a.msh"), &mesh).unwrap();
    let fields = "young_modulus_field = \"stiffness\"\ndensity_field = \"rho\"";
    let uniform = attempt(&folder, &scene("a.vtu", "")).unwrap().bodies[0].mass;
    for file in ["a.vtu", "a.vtk", "a.msh"] {
        let mut built = attempt(&folder, &scene(file, fields)).unwrap();
        let handle = built.bodies[0].handle;
        let mass: f64 = built.simulation.masses(handle).iter().sum();
        assert!((mass - built.bodies[0].mass).abs() < 1e-14 * mass, "{file}");
        // equal halves of 900 and 1100 weigh as much as 1000
        assert!((mass - uniform).abs() < 1e-12 * mass, "{file}");
        let masses = built.simulation.masses(handle);
        let end = |name: &str| -> f64 {
            mesh.group(name).unwrap().vertices.iter().map(|&v| masses[v as usize]).sum()
        };
        assert!((end("x1") / end("x0") - 11.0 / 9.0).abs() < 1e-12, "{file}");

        let mut writer =
            Writer::new(&folder.join(format!("out-{file}")), "bar", &mut built, true).unwrap();
        writer.frame(&mut built).unwrap();
        writer.finish().unwrap();
        let frame = folder.join(format!("out-{file}/frames/bar_00000.vtu"));
        let frame = Mesh::read(&frame).unwrap();
        let fibre = frame.data("fibre").unwrap();
        assert_eq!(
            fibre.values.tetrahedra,
            mesh.data("fibre").unwrap().values.tetrahedra,
            "{file}"
        );
        assert_eq!(fibre.integer, file != "a.msh", "{file}");
        assert!(frame.data("J").is_some());
    }

    let error = attempt(&folder, &scene("a.vtu", "young_modulus_field = \"stifness\""));
    let message = error.map(|_| ()).unwrap_err().to_string();
    says(&message, &["bar.toml, line 12", "`stifness`", "did you mean `stiffness`"]);
    let error =
        attempt(&folder, &scene("a.vtu", "density_field = \"bad\"")).map(|_| ()).unwrap_err();
    assert!(matches!(error, SceneError::At { problem: SceneProblem::Field { .. }, .. }));
    let message = error.to_string();
    says(
        &message,
        &["line 12", "density_field", "`bad`", "a.vtu", "tetrahedron 0", "density is -1"],
    );
    let text = scene("a.vtu", "density_field = \"bad\"")
        .replace("mesh = \"a.vtu\"", "generate = { sphere = { radius = 0.1, shells = 2 } }");
    let message = attempt(&folder, &text).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("no cell data"), "{message}");
    std::fs::remove_dir_all(&folder).unwrap();
}
