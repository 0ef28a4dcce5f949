//! Tractions, flat sheets, axes across fibres, names that changed, shapes from words.

use crate::common::says;
use glam::DVec3;
use sinew::engine::load::{Load, LoadedFaces};
use sinew::engine::mesh::generate::box_tets;
use sinew_scene::assemble::{BuildOptions, BuiltScene, build, generate};
use sinew_scene::mesh_tool::{MeshInfo, write};
use sinew_scene::scene::{Generate, LoadedScene, SHAPES};
use std::path::Path;

fn built(text: &str) -> BuiltScene {
    let scene = LoadedScene::parse(text, Path::new("acts.toml")).unwrap();
    let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
    build(&scene, &options).unwrap_or_else(|e| panic!("{e}"))
}

fn codes(scene: &BuiltScene) -> Vec<&str> {
    scene.warnings.iter().map(|w| w.code.as_str()).collect()
}

/// A flat sheet in an equilibrium: held across its plane everywhere, on rollers at one side, pulled by its rim.
fn sheet(elements: &str, more: &str) -> String {
    format!(
        r#"
        name = "sheet"
        mode = "static"
        gravity = [0.0, 0.0, 0.0]
        [solver]
        linear_tolerance = 1e-12
        [[body]]
        name = "sheet"
        generate = {{ sheet = {{ size = [0.06, 0.04], cells = [5, 3], elements = "{elements}" }} }}
        material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1000.0 }}
        membrane = {{ thickness = 0.002, model = "linear" }}
        [[constraint]]
        name = "plane"
        select = {{ all = true }}
        axes = "z"
        [[constraint]]
        name = "rollers"
        select = {{ group = "x0" }}
        axes = "xz"
        [[constraint]]
        name = "corner"
        select = {{ vertices = [0] }}
        {more}
        [[load]]
        name = "pull"
        on = {{ rim = "x1" }}
        traction = [50.0, 0.0, 0.0]
        "#
    )
}

#[test]
fn a_traction_on_the_rim_of_a_sheet_is_a_uniform_stress() {
    for elements in ["triangles", "quads"] {
        let mut scene = built(&sheet(elements, ""));
        assert!(!codes(&scene).contains(&"scene.constraint.overlap"), "{:?}", scene.warnings);
        let load = &scene.loads[0].summary;
        assert!((load.force[0] - 50.0 * 0.04 * 0.002).abs() < 1e-15 && load.vertices == 4);
        scene.simulation.step().unwrap();
        let body = &scene.bodies[0];
        let strain = 50.0 / 1e4;
        let u = scene.simulation.displacements(body.handle);
        for (u, x) in u.iter().zip(&body.mesh.points) {
            let expected = DVec3::new(strain * x.x, -0.3 * strain * x.y, 0.0);
            assert!(u.distance(expected) < 1e-9 * strain, "{elements}: {u} at {x}");
        }
    }
}

/// Axes of constraints add up; where one moves along an axis that another holds too, one of them has no effect.
#[test]
fn only_constraints_that_differ_overlap() {
    let moved = |by: &str| {
        let scene = built(&sheet("quads", &format!("motion = {{ translate = {by} }}")));
        scene.warnings.iter().filter(|w| w.code == "scene.constraint.overlap").count()
    };
    assert_eq!(moved("[0.0, 0.001, 0.0]"), 0);
    // against the plane, then against rollers and plane
    assert_eq!(moved("[0.001, 0.0, 0.0]"), 1);
    assert_eq!(moved("[0.0, 0.0, 0.001]"), 2);
    let text = sheet("quads", "").replace(
        "name = \"plane\"\n        select = { all = true }",
        "name = \"plane\"\n        select = { group = \"x0\" }",
    );
    let scene = LoadedScene::parse(&text, Path::new("acts.toml")).unwrap();
    let error = build(&scene, &BuildOptions::default()).err().unwrap().to_string();
    says(&error, &["rigid motions", "a flat sheet too across its plane", "all = true"]);
}

#[test]
fn tractions_act_on_groups_patches_surfaces_and_membranes() {
    let scene = |on: &str, shape: &str| {
        built(&format!(
            r#"
            name = "block"
            dt = 0.01
            duration = 0.02
            [[body]]
            name = "block"
            {shape}
            material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1000.0 }}
            [[constraint]]
            name = "clamp"
            select = {{ group = "x0" }}
            [[load]]
            name = "pull"
            on = {on}
            traction = [3.0, -1.0, 2.0]
            curve = {{ ramp = [0.0, 0.5] }}
            "#
        ))
    };
    let shapes = ["tetrahedra", "hexahedra"].map(|elements| {
        format!("generate = {{ box = {{ size = [0.1, 0.06, 0.04], cells = [4, 3, 2], elements = \"{elements}\" }} }}")
    });
    let [tetrahedra, hexahedra] = shapes;
    let second = format!("{tetrahedra}\nsecond_order = true");
    let skin = format!("{hexahedra}\nmembrane = {{ thickness = 0.001, group = \"z1\" }}");
    let (end, side) = (0.06 * 0.04, 0.1 * 0.06);
    let whole = 2.0 * (end + side + 0.1 * 0.04);
    let cases = [
        ("{ group = \"x1\" }", end),
        ("{ patch = { normal = [1.0, 0.0, 0.0] } }", end),
        ("{ surface = true }", whole),
    ];
    for (on, area) in cases {
        for shape in [&tetrahedra, &hexahedra, &second] {
            let own = scene(on, shape);
            let force = DVec3::from_array(own.loads[0].summary.force);
            let expected = area * DVec3::new(3.0, -1.0, 2.0);
            assert!(force.distance(expected) < 1e-12 * area, "{on} {shape}: {force}");
            let world = own.simulation.world();
            let faces = world.get::<LoadedFaces>(own.loads[0].entity).unwrap();
            assert_eq!(world.get::<Load>(own.loads[0].entity).unwrap().forces, faces.forces());
        }
    }
    let own = scene("{ membrane = true }", &skin);
    assert!((own.loads[0].summary.force[0] - 3.0 * side).abs() < 1e-14);
}

/// Axes across fibres are families of their own: an orthogonal triad in every element, whatever the course.
#[test]
fn fibres_of_every_course_have_two_axes_across() {
    let courses = [
        "direction = [1.0, 2.0, 0.5]",
        "formula = [\"-y\", \"x\", \"0.3\"]",
        "azimuth_elevation = { formula = [\"30\", \"100*z\"] }",
        "laplace = { from = \"z0\", to = \"z1\" }",
        "laplace = { from = \"x0\", to = \"x1\", helix = [60.0, -60.0], axis = [0.0, 0.0, 1.0] }",
        "circular = { centre = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }",
        "hemicircular = { axis = [0.0, 1.0, 0.0], side = [-1.0, 0.0, 0.0] }",
        "helicoidal = { centre = [0.02, 0.02, 0.0], axis = [0.0, 0.0, 1.0], degrees = 30.0 }",
        "random = { seed = 3 }",
        "random = { seed = 3 }\ntowards = [0.1, 0.2, 1.0]",
    ];
    for elements in ["tetrahedra", "hexahedra"] {
        for course in courses {
            let scene = built(&format!(
                r#"
                name = "block"
                dt = 0.01
                duration = 0.02
                [[body]]
                name = "block"
                generate = {{ box = {{ size = [0.04, 0.04, 0.08], cells = [2, 2, 4], elements = "{elements}" }} }}
                model = "axes"
                material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1000.0 }}
                [[body.fibres]]
                name = "f"
                modulus = 5e4
                viscosity = 3.0
                across = [1e4, 2e4]
                {course}
                [body.axes]
                angles = [{{ between = ["f", "f_2"], modulus = 4e3 }}, {{ between = ["f_2", "f_3"], modulus = 4e3 }}]
                volume_modulus = 1e4
                [[constraint]]
                name = "top"
                select = {{ group = "z1" }}
                "#
            ));
            let axes = scene.bodies[0].axes.as_ref().unwrap();
            let names: Vec<&str> = axes.families.iter().map(|f| &*f.name).collect();
            assert_eq!(names, ["f", "f_2", "f_3"]);
            let of = |f: fn(&sinew::models::axes::description::AxisFamily) -> f64| {
                axes.families.iter().map(f).collect::<Vec<_>>()
            };
            assert_eq!(of(|f| f.modulus), [5e4, 1e4, 2e4]);
            assert_eq!(of(|f| f.viscosity), [3.0; 3]);
            assert_eq!(axes.angles[1].families, [1, 2]);
            let mesh = &scene.bodies[0].mesh;
            for e in 0..mesh.tetrahedra.len() + mesh.hexahedra.len() {
                let [a, b, c] = [0, 1, 2].map(|i| axes.families[i].direction(e));
                assert!(a.cross(b).distance(c) < 1e-12 && a.dot(b).abs() < 1e-12, "{course}");
            }
        }
    }
}

#[test]
fn the_old_name_of_a_method_is_read_and_told() {
    let scene = |method: &str| {
        built(&format!(
            r#"
            name = "springs"
            dt = 0.01
            duration = 0.02
            [[body]]
            name = "block"
            generate = {{ box = {{ size = [0.04, 0.04, 0.08], cells = [2, 2, 4] }} }}
            model = "mass_spring"
            element_method = "{method}"
            material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1000.0 }}
            [[constraint]]
            name = "top"
            select = {{ group = "z1" }}
            "#
        ))
    };
    let (new, old) = (scene("delingette"), scene("paper-a"));
    assert!(!codes(&new).contains(&"scene.name.renamed"));
    let told = old.warnings.iter().find(|w| w.code == "scene.name.renamed").unwrap();
    says(&told.to_string(), &["body[0].element_method", "`paper-a` is now called `delingette`"]);
    assert_eq!(new.bodies[0].springs, old.bodies[0].springs);
}

/// The same shapes by the words of a command line as by a table.
#[test]
fn shapes_come_from_words_as_from_tables() {
    let cases = [
        ("box", "size=0.1,0.02,0.02 cells=2,1,1 elements=irregular seed=3"),
        ("cylinder", "radius=0.1 length=1 rings=2 layers=4 elements=hexahedra"),
        ("cylinder", "radius=0.1 length=1"),
        ("sphere", "radius=0.1 shells=3"),
        ("sheet", "size=1,2 cells=2,3 elements=quads"),
        ("specimen", "width=0.01 cells=32,4 sheet=quads"),
        ("specimen", "width=0.01 cells=32,4,2 thickness=0.01 solid=hexahedra"),
        ("disc", "radius=0.1 rings=3"),
        ("balloon", "radius=0.1 cuts=3"),
        ("tube", "radius=0.02 wall=0.01 length=0.1 around=8 through=1 along=4"),
        ("cup", "radius=0.02 depth=0.04 wall=0.01 core=2 rings=2 layers=2"),
    ];
    for shape in SHAPES {
        assert!(cases.iter().any(|(name, _)| *name == shape.name), "{}", shape.name);
        assert!(!shape.about.is_empty() && shape.keys.iter().all(|key| !key.about.is_empty()));
    }
    for (name, words) in cases {
        let pairs = words.split(' ').map(|pair| pair.split_once('=').unwrap());
        let pairs: Vec<_> = pairs
            .map(|(key, list)| (key, list.split(',').map(String::from).collect::<Vec<_>>()))
            .collect();
        let mesh = generate(&Generate::from_words(name, &pairs).unwrap()).unwrap().unwrap();
        let table = pairs.iter().map(|(key, list)| {
            let quoted = |word: &String| match word.parse::<f64>() {
                Ok(_) => word.clone(),
                Err(_) => format!("\"{word}\""),
            };
            let list: Vec<String> = list.iter().map(quoted).collect();
            match &list[..] {
                [one] => format!("{key} = {one}"),
                more => format!("{key} = [{}]", more.join(", ")),
            }
        });
        let table = table.collect::<Vec<_>>().join(", ");
        let own: Generate = toml::from_str(&format!("{name} = {{ {table} }}")).unwrap();
        let own = generate(&own).unwrap().unwrap();
        assert_eq!((&mesh.points, &mesh.tetrahedra), (&own.points, &own.tetrahedra));
        assert!(MeshInfo::of(&mesh).vertices > 0);
    }
    let told = |name: &str, key, word: &str| {
        Generate::from_words(name, &[(key, vec![word.into()])]).unwrap_err()
    };
    says(&told("box", "size", "0.1"), &["box", "size"]);
    says(&told("disc", "radius", "wide"), &["disc", "radius"]);
    says(&told("disc", "width", "1"), &["disc", "width", "radius"]);
    says(&told("sphere", "shells", "3"), &["sphere", "radius"]);
}

/// Surfaces that cuts divide roughly, or not at all, are noted.
#[test]
fn what_surfaces_cannot_do_through_cuts_is_noted() {
    let folder = std::env::temp_dir().join(format!("sinew-surfaces-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let notes = |cells: usize, body: &str, spare: usize| -> Vec<String> {
        let (elements, more) = body.split_once(' ').unwrap_or((body, ""));
        write(&folder.join("shell.vtu"), &box_tets(DVec3::splat(0.06), [cells; 3]).unwrap())
            .unwrap();
        let text = format!(
            "name = \"acts\"\ndt = 0.01\nduration = 0.1\n[[body]]\nname = \"block\"\nsurface = \"shell.vtu\"\nspare = {spare}\n\
             generate.box = {{ size = [0.06, 0.06, 0.06], cells = [4, 4, 4], elements = \"{elements}\" }}\n{more}\n\
             material = {{ young_modulus = 1e4, poisson_ratio = 0.3, density = 1e3 }}\n\
             [[constraint]]\nname = \"wall\"\nselect = {{ group = \"x0\" }}\n"
        );
        let scene = LoadedScene::parse(&text, &folder.join("acts.toml")).unwrap();
        let options = BuildOptions { threads: Some(1), ..BuildOptions::default() };
        let all = build(&scene, &options).unwrap().warnings;
        all.into_iter().filter(|w| w.code == "scene.surface.cuts").map(|w| w.to_string()).collect()
    };
    // the edges of a cube and the diagonals of its faces
    let rough = notes(1, "irregular", 100);
    assert!(
        rough.len() == 1 && rough[0].contains("18 edges of its surface are longer"),
        "{rough:?}"
    );
    let not = notes(8, "hexahedra integration = \"reduced\"", 100);
    assert!(not.len() == 1 && not[0].contains("does not go through cuts"), "{not:?}");
    assert_eq!(notes(8, "hexahedra", 100), Vec::<String>::new());
    assert_eq!(notes(8, "irregular", 100), Vec::<String>::new());
    assert_eq!(notes(1, "irregular", 0), Vec::<String>::new());
    std::fs::remove_dir_all(folder).unwrap();
}
