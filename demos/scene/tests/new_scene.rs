//! A first scene for a mesh of one's own.

use sinew::engine::mesh::Mesh;
use sinew_scene::mesh_tool::write;
use sinew_scene::new_scene::new_scene;
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use sinew_scene::scene_folder;

/// It runs, is trusted, and the ball feels the body: from tetrahedra and hexahedra with groups, in millimetres, and from a surface.
#[test]
fn a_new_scene_runs_and_its_ball_feels_the_body() {
    let folder = std::env::temp_dir().join(format!("sinew-new-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let shipped = |name: &str| scene_folder().join("../meshes").join(name);
    let mut mesh = Mesh::read(&shipped("liver_coarse.msh")).unwrap();
    mesh.points.iter_mut().for_each(|p| *p *= 1e3);
    mesh.groups.clear();
    let large = folder.join("large.vtk");
    write(&large, &mesh).unwrap();
    let solid = Mesh::read(&shipped("liver_coarse.msh")).unwrap();
    let triangles = solid.surface().triangles;
    let triangles = triangles.iter().map(|t| t.map(|v| solid.points[v as usize]));
    let corners = |[a, b, c]: [glam::DVec3; 3]| {
        let corner = |p: glam::DVec3| format!("vertex {} {} {}\n", p.x, p.y, p.z);
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            [a, b, c].map(corner).concat()
        )
    };
    let surface = folder.join("surface.stl");
    let text = format!("solid s\n{}endsolid s\n", triangles.map(corners).collect::<String>());
    std::fs::write(&surface, text).unwrap();
    for (file, word) in [
        (shipped("liver_coarse.msh"), "group = \"ligament\""),
        (shipped("stomach.msh"), "kidney: E = 5000 Pa"),
        (large, "scale = 0.001"),
        (surface, "lattice = "),
    ] {
        let text = new_scene(&file, &file.to_string_lossy(), "kidney").unwrap();
        assert!(text.contains(word), "{word}: {text}");
        assert!(text.lines().filter(|line| line.starts_with('#')).count() > 8, "{text}");
        let scene = LoadedScene::parse(&text, &folder.join("new.toml")).unwrap();
        let summary = run(&scene, &RunOptions::default(), &mut Silent).unwrap();
        assert!(summary.completed, "{word}: {:?}", summary.failure);
        let force = summary.touch.unwrap().touched.tools[0].force.peak;
        assert!(force > 0.01 && force < 10.0, "{word}: {force}");
    }
    std::fs::remove_dir_all(folder).unwrap();
    let unknown = new_scene(&shipped("liver_coarse.msh"), "x", "bone").unwrap_err().to_string();
    assert!(unknown.contains("known names: brain"), "{unknown}");
}
