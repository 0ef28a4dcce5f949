//! Materials from the cell data of a mesh file, and cell data in the frames.

use crate::common::says;
use glam::DVec3;
use sinew::engine::connectivity::ByKind;
use sinew::engine::mesh::generate::box_tets;
use sinew::engine::mesh::io::{VtuData, write_gmsh, write_vtk, write_vtu};
use sinew::engine::mesh::{CellData, Mesh};
use sinew_scene::assemble::{BuildOptions, build};
use sinew_scene::check::check_file;
use sinew_scene::error::{SceneError, SceneProblem};
use sinew_scene::output::Writer;
use sinew_scene::run::{RunOptions, Silent, run};
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

/// A bar with constants, those of which `fields` gives left out.
fn scene(file: &str, fields: &str) -> String {
    let constants = [("young_modulus", 1e4), ("poisson_ratio", 0.3), ("density", 1000.0)];
    let own = constants.iter().filter(|(name, _)| !fields.contains(&format!("{name}_field")));
    let own: Vec<String> = own.map(|(name, value)| format!("{name} = {value:?}")).collect();
    format!(
        "name = \"bar\"\ndt = 0.01\nduration = 0.02\n\n[[body]]\nname = \"bar\"\nmesh = \"{file}\"\n\
         [body.material]\n{}\n{fields}\n",
        own.join("\n")
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
    says(&message, &["bar.toml, line 11", "`stifness`", "did you mean `stiffness`"]);
    let error =
        attempt(&folder, &scene("a.vtu", "density_field = \"bad\"")).map(|_| ()).unwrap_err();
    assert!(matches!(error, SceneError::At { problem: SceneProblem::Field { .. }, .. }));
    let message = error.to_string();
    says(
        &message,
        &["line 11", "density_field", "`bad`", "a.vtu", "tetrahedron 0", "density is -1"],
    );
    let text = scene("a.vtu", "density_field = \"bad\"")
        .replace("mesh = \"a.vtu\"", "generate = { sphere = { radius = 0.1, shells = 2 } }");
    let message = attempt(&folder, &text).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("no cell data"), "{message}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// A constant that a field gives to every element has no effect: it is refused, and reports show the field.
#[test]
fn a_constant_beside_its_field_is_refused_and_the_field_is_shown() {
    let folder = std::env::temp_dir().join(format!("sinew-field-beside-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    write_vtu(&folder.join("a.vtu"), &VtuData::of_mesh(&mesh())).unwrap();
    let field = "young_modulus_field = \"stiffness\"";
    let message = |text: &str| attempt(&folder, text).map(|_| ()).unwrap_err().to_string();
    let both = scene("a.vtu", field) + "young_modulus = 4e3\n";
    says(&message(&both), &["line 12", "material.young_modulus`", "leave it out"]);
    // a membrane on the body takes it, and then it counts
    let skin = "membrane = { thickness = 0.001, surface = true }";
    let with_skin =
        |text: &str| text.replace("[body.material]", &format!("{skin}\n[body.material]"));
    let stiffness = attempt(&folder, &with_skin(&both)).unwrap().bodies[0].material.young_modulus;
    assert_eq!(stiffness, 4e3);
    let without = message(&with_skin(&scene("a.vtu", field)));
    says(&without, &["`young_modulus` is missing", "membrane"]);
    // membranes have one material
    let of_skin = "membrane = { thickness = 0.001, surface = true, material = { poisson_ratio = 0.3, \
                   density = 1000.0, young_modulus_field = \"stiffness\" } }";
    let text = with_skin(&scene("a.vtu", "")).replace(skin, of_skin);
    says(&message(&text), &["membrane.material.young_modulus_field", "no solid elements"]);

    let loaded = LoadedScene::parse(&scene("a.vtu", field), &folder.join("bar.toml")).unwrap();
    let build = BuildOptions { steps: Some(1), threads: Some(1), ..BuildOptions::default() };
    let summary =
        run(&loaded, &RunOptions { build, ..RunOptions::default() }, &mut Silent).unwrap();
    let body = &summary.bodies[0];
    assert_eq!(body.material_ranges.young_modulus, Some([1e4, 4e4]));
    assert_eq!(body.material.young_modulus, 2.5e4);
    for report in [summary.to_string(), summary.brief().to_string()] {
        says(&report, &["E = 10 kPa to 40 kPa, nu = 0.3, 1000 kg/m^3"]);
    }
    std::fs::write(folder.join("bar.toml"), scene("a.vtu", field)).unwrap();
    says(&check_file(&folder.join("bar.toml")).to_string(), &["E = 10 kPa to 40 kPa"]);
    std::fs::remove_dir_all(&folder).unwrap();
}
