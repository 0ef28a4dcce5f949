//! Bodies made of a surface: a lattice of hexahedra, each filled by a share, which carries the surface along.

use crate::common::says;
use glam::DVec3;
use sinew::engine::mesh::generate::{box_tets, sphere_triangles};
use sinew::engine::mesh::{FILLED, Mesh};
use sinew::models::body::Integration;
use sinew::models::material::YoungPoisson;
use sinew_scene::assemble::{BuildOptions, BuiltScene, build};
use sinew_scene::check::check_file;
use sinew_scene::error::SceneError;
use sinew_scene::mesh_tool::{lattice, write};
use sinew_scene::run::{RunOptions, Silent, run};
use sinew_scene::scene::LoadedScene;
use std::path::{Path, PathBuf};

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("sinew-lattice-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A body of these keys, held above a height, in equilibrium with its weight.
fn scene(body: &str, held_above: f64) -> String {
    format!(
        "name = \"organ\"\nmode = \"static\"\n[solver]\nlinear_tolerance = 1e-10\nnewton_tolerance = 1e-10\n\
         [[body]]\nname = \"organ\"\n{body}\n\
         [[constraint]]\nname = \"top\"\nselect = {{ box = {{ min = [-1, -1, {held_above:?}], max = [1, 1, 1] }} }}\n"
    )
}

const MATERIAL: &str = "material = { young_modulus = 6e3, poisson_ratio = 0.4, density = 1e3";

fn attempt(folder: &Path, text: &str) -> Result<BuiltScene, SceneError> {
    let scene = LoadedScene::parse(text, &folder.join("organ.toml"))?;
    build(&scene, &BuildOptions { threads: Some(1), ..Default::default() })
}

/// Points of the carried surface, at rest and in equilibrium.
fn settled(folder: &Path, text: &str) -> (BuiltScene, Vec<DVec3>) {
    let mut built = attempt(folder, text).unwrap();
    built.simulation.step().unwrap();
    assert!(!built.simulation.report().unconverged);
    let u = built.simulation.displacements(built.bodies[0].handle);
    let carried = built.bodies[0].carried.as_ref().unwrap();
    let moved = carried.embedding.displacements(&u);
    (built, moved)
}

/// Where faces of the surface are faces of cells, the body is the one of these hexahedra.
#[test]
fn a_lattice_that_fits_is_the_body_of_its_hexahedra() {
    let folder = folder("fits");
    write(&folder.join("box.vtu"), &box_tets(DVec3::new(0.1, 0.05, 0.075), [4, 2, 3]).unwrap())
        .unwrap();
    let own = scene(&format!("mesh = \"box.vtu\"\nlattice = 0.025\n{MATERIAL} }}"), 0.074);
    let (built, moved) = settled(&folder, &own);
    assert_eq!(built.bodies[0].integration, Integration::Reduced);
    let other = format!(
        "generate.box = {{ size = [0.1, 0.05, 0.075], cells = [4, 2, 3], elements = \"hexahedra\" }}\n\
         surface = \"box.vtu\"\nintegration = \"reduced\"\n{MATERIAL} }}"
    );
    let (hexahedra, expected) = settled(&folder, &scene(&other, 0.074));
    assert!((built.bodies[0].mass / hexahedra.bodies[0].mass - 1.0).abs() < 1e-9);
    let largest = expected.iter().map(|u| u.length()).fold(0.0, f64::max);
    assert!(largest > 1e-3, "{largest}");
    for (u, v) in moved.iter().zip(&expected) {
        assert!(u.distance(*v) < 1e-7 * largest, "{u} beside {v}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// Mass and weight are those of the organ, wherever its surface cuts the cells, and stay so when the material is changed.
#[test]
fn cells_weigh_what_they_are_filled_with() {
    let folder = folder("mass");
    let text = scene(
        &format!(
            "generate.balloon = {{ radius = 0.05, cuts = 4 }}\nlattice = 0.011\n{MATERIAL} }}"
        ),
        0.03,
    );
    let mut built = attempt(&folder, &text).unwrap();
    let report = built.bodies[0].lattice.unwrap();
    let mass = built.bodies[0].mass;
    assert!((mass / (1e3 * report.held) - 1.0).abs() < 1e-12, "{mass} {report:?}");
    assert!((0.99..1.001).contains(&(report.held / report.volume)), "{report:?}");
    let handle = built.bodies[0].handle;
    let heavier = YoungPoisson { young_modulus: 9e3, poisson_ratio: 0.3, density: 2e3 };
    built.simulation.set_material(handle, heavier).unwrap();
    let after: f64 = built.simulation.masses(handle).iter().sum();
    assert!((after / mass - 2.0).abs() < 1e-12, "{after} after {mass}");
    std::fs::remove_dir_all(folder).unwrap();
}

/// A file of `sinew mesh lattice` and the key `lattice` make one body.
#[test]
fn the_file_and_the_key_make_one_body() {
    let folder = folder("file");
    let ball = sphere_triangles(0.05, 4).unwrap();
    write(&folder.join("ball.vtu"), &ball).unwrap();
    let info = lattice(&folder.join("ball.vtu"), &folder.join("cubes.vtu"), 0.0125, 1.0).unwrap();
    says(&info.to_string(), &["filled", "encloses", "left out"]);
    let cubes = Mesh::read(&folder.join("cubes.vtu")).unwrap();
    assert_eq!(cubes.data(FILLED).unwrap().values.hexahedra.len(), cubes.hexahedra.len());
    let key = format!("mesh = \"ball.vtu\"\nlattice = 0.0125\n{MATERIAL} }}");
    let file = format!(
        "mesh = \"cubes.vtu\"\nsurface = \"ball.vtu\"\nintegration = \"reduced\"\n\
         {MATERIAL}, filled_field = \"filled\" }}"
    );
    let [(_, a), (_, b)] = [key, file].map(|own| settled(&folder, &scene(&own, 0.03)));
    let largest = a.iter().map(|u| u.length()).fold(0.0, f64::max);
    assert!(a.iter().zip(&b).all(|(u, v)| u.distance(*v) < 1e-6 * largest), "{a:?} {b:?}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn frames_have_the_surface() {
    let folder = folder("frames");
    let text = format!(
        "name = \"organ\"\ndt = 0.01\nduration = 0.1\n[[body]]\nname = \"organ\"\n\
         generate.balloon = {{ radius = 0.05, cuts = 3 }}\nlattice = 0.02\n{MATERIAL} }}\n\
         [output]\nframes_per_second = 20\n"
    );
    let scene = LoadedScene::parse(&text, &folder.join("organ.toml")).unwrap();
    let out = folder.join("out");
    let options = RunOptions { out: Some(out.clone()), ..RunOptions::default() };
    for _ in 0..2 {
        let summary = run(&scene, &options, &mut Silent).unwrap();
        assert!(
            summary.files.iter().any(|file| file.contains("organ-surface.pvd")),
            "{:?}",
            summary.files
        );
    }
    let index = std::fs::read_to_string(out.join("organ-surface.pvd")).unwrap();
    says(&index, &["frames/organ-surface_00000.vtu", "frames/organ-surface_00002.vtu"]);
    let ball = sphere_triangles(0.05, 3).unwrap();
    let [first, last] = [0, 2].map(|frame| {
        Mesh::read(&out.join(format!("frames/organ-surface_0000{frame}.vtu"))).unwrap()
    });
    assert_eq!(
        (first.triangles.len(), first.points.len()),
        (ball.triangles.len(), ball.points.len())
    );
    // it falls freely, by steps of implicit Euler or better
    let fall = 0.5 * 9.81 * 0.1 * 0.1;
    for (a, b) in first.points.iter().zip(&last.points) {
        assert!((a.z - b.z - fall).abs() < 0.12 * fall, "{a} {b}");
    }
    // nothing is left of the run before
    let surfaces = std::fs::read_dir(out.join("frames")).unwrap().flatten();
    let surfaces = surfaces.filter(|e| e.file_name().to_string_lossy().contains("surface"));
    assert_eq!(surfaces.count(), 3);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let folder = folder("refused");
    let mut open = sphere_triangles(0.05, 3).unwrap();
    write(&folder.join("ball.vtu"), &open).unwrap();
    open.points.iter_mut().for_each(|p| *p *= 1000.0);
    write(&folder.join("millimetres.vtu"), &open).unwrap();
    open.triangles.pop();
    write(&folder.join("open.vtu"), &open).unwrap();
    let refused = |body: &str, words: &[&str]| {
        let error = attempt(&folder, &scene(body, 0.03)).map(drop).unwrap_err().to_string();
        says(&error, words);
    };
    refused(
        &format!("mesh = \"open.vtu\"\nlattice = 10.0\n{MATERIAL} }}"),
        &["not closed", "3 edges"],
    );
    for cell in ["0.0", "-0.01"] {
        refused(
            &format!("mesh = \"ball.vtu\"\nlattice = {cell}\n{MATERIAL} }}"),
            &["lattice", "above 0"],
        );
    }
    refused(
        &format!("mesh = \"ball.vtu\"\nlattice = 1e-7\n{MATERIAL} }}"),
        &["lattice", "too many"],
    );
    refused(
        &format!("mesh = \"ball.vtu\"\nlattice = 0.01\nsurface = \"ball.vtu\"\n{MATERIAL} }}"),
        &["`body[0].surface`", "leave it out"],
    );
    refused(
        &format!(
            "mesh = \"ball.vtu\"\nlattice = 0.01\nmembrane = {{ thickness = 0.001, surface = true }}\n{MATERIAL} }}"
        ),
        &["membrane", "steps"],
    );
    refused(
        &format!("mesh = \"ball.vtu\"\nlattice = 0.01\n{MATERIAL}, filled_field = \"filled\" }}"),
        &["filled_field", "leave it out"],
    );
    let cube = "generate.box = { size = [0.1, 0.1, 0.1], cells = [2, 2, 2] }";
    refused(
        &format!("{cube}\nsurface = \"millimetres.vtu\"\n{MATERIAL} }}"),
        &["`body[0].surface`", "one unit"],
    );
    refused(&format!("{cube}\n{MATERIAL}, filled_field = \"share\" }}"), &["no cell data `share`"]);
    let (mut cubes, _) = sphere_triangles(0.05, 3).unwrap().lattice(0.0125).unwrap();
    cubes.cell_data[0].values.hexahedra[7] = 0.0;
    write(&folder.join("cubes.vtu"), &cubes).unwrap();
    refused(
        &format!("mesh = \"cubes.vtu\"\n{MATERIAL}, filled_field = \"filled\" }}"),
        &["filled_field", "hexahedron 7 is filled by 0"],
    );
    cubes.cell_data[0].values.hexahedra[7] = 0.5;
    cubes.cell_data[1].values.hexahedra[7] = 3.0;
    write(&folder.join("cubes.vtu"), &cubes).unwrap();
    refused(
        &format!("mesh = \"cubes.vtu\"\n{MATERIAL}, filled_field = \"filled\" }}"),
        &["filled_field", "hexahedron 7 is filled about [3.0", "sinew mesh lattice"],
    );
    std::fs::remove_dir_all(folder).unwrap();
}

/// `check` says how much of a body its cells hold, and warns where that is too little.
#[test]
fn a_coarse_lattice_is_told() {
    let folder = folder("coarse");
    // a ball, and a cup whose wall is a third of a cube
    let ball = "generate.balloon = { radius = 0.05, cuts = 4 }";
    let cup = "generate.cup = { radius = 0.03, depth = 0.05, wall = 0.003, core = 4, rings = 6, layers = 1 }";
    for (shape, held_above, warned) in [(ball, 0.03, false), (cup, -0.006, true)] {
        let text = scene(&format!("{shape}\nlattice = 0.01\n{MATERIAL} }}"), held_above);
        let file = folder.join("organ.toml");
        std::fs::write(&file, text).unwrap();
        let told = check_file(&file).to_string();
        assert_eq!(told.contains("nearly empty ones"), warned, "{told}");
        says(&told, &["lattice", "hold"]);
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// A beam is as exact where its sides cut cubes as where these fit: what fills them counts where it lies. Spread over all of the cube
/// it would be 8 % too stiff with 6.4 cubes across, and 23 % with 3.2.
#[test]
fn beams_of_cubes_bend_as_they_are_filled() {
    let folder = folder("beam");
    let sag = |shape: &str| {
        let body = format!(
            "generate.box = {{ size = [0.1, 0.02, 0.02], {shape}\nmodel = \"neo_hookean\"\nvolume = \"clusters\"\n\
             material = {{ young_modulus = 40e3, poisson_ratio = 0.3, density = 1e3 }}"
        );
        let held = "select = { box = { min = [-1, -1, -1], max = [1e-9, 1, 1] } }";
        let gravity = "gravity = [0.0, 0.0, -0.4]\nmode = ";
        let text = scene(&body, 0.0).replacen("mode = ", gravity, 1);
        let (before, _) = text.split_once("select").unwrap();
        let mut built = attempt(&folder, &format!("{before}{held}\n")).unwrap();
        built.simulation.step().unwrap();
        assert!(!built.simulation.report().unconverged);
        let u = built.simulation.displacements(built.bodies[0].handle);
        u.iter().map(|u| u.length()).fold(0.0, f64::max)
    };
    // finer ones move by 0.2 %
    let exact = sag("cells = [20, 4, 4] }\nsecond_order = true");
    let cubes = |cell: f64| sag(&format!("cells = [10, 2, 2] }}\nlattice = {cell}")) / exact;
    let (fit, cut, coarse) = (cubes(0.01), cubes(0.003125), cubes(0.00625));
    assert!((0.98..1.01).contains(&fit), "{fit}");
    assert!((0.96..1.02).contains(&cut), "{cut}");
    assert!((0.96..1.03).contains(&coarse), "{coarse}");
    std::fs::remove_dir_all(folder).unwrap();
}
