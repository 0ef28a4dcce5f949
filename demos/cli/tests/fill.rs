//! A surface becomes a body.

use crate::common::check;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("fill-{name}"));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// What it says with this folder as the path of commands.
fn fill(folder: &Path, commands: &str, more: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(["mesh", "fill", "ball.stl", "ball.msh"]).args(more);
    let output = command.current_dir(folder).env("PATH", commands).output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(text).unwrap())
}

/// A file in millimetres.
fn ball(folder: &Path) {
    let file = folder.join("ball.msh").display().to_string();
    check(
        &["mesh", "generate", "balloon", "--radius", "50", "--cuts", "6", "--out", &file],
        0,
        "",
        "",
    );
    let info = sinew_scene::mesh_tool::read(file.as_ref()).unwrap();
    let mut text = String::from("solid ball\n");
    for corners in &info.triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for &v in corners {
            let p = info.points[v as usize];
            text += &format!("vertex {} {} {}\n", p.x, p.y, p.z);
        }
        text += "endloop\nendfacet\n";
    }
    std::fs::write(folder.join("ball.stl"), text + "endsolid ball\n").unwrap();
    std::fs::remove_file(file).unwrap();
}

#[test]
fn a_surface_that_cannot_be_filled_is_refused_by_name() {
    let folder = folder("refused");
    ball(&folder);
    let (code, said) = fill(&folder, "", &[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("no command `gmsh`") && said.contains("pip install gmsh"), "{said}");
    // what it would have run is left for a machine that has it
    let recipe = std::fs::read_to_string(folder.join("ball.msh.fill/recipe.geo")).unwrap();
    assert!(recipe.contains("Merge \"surface.msh\";"), "{recipe}");
    assert!(fill(&folder, "", &["--edge", "-0.01"]).1.contains("edge is -0.01"));
    assert!(fill(&folder, "", &["--scale", "0"]).1.contains("scale is 0"));
    let text = std::fs::read_to_string(folder.join("ball.stl")).unwrap();
    let (head, facets) = text.split_once("facet normal").unwrap();
    let (_, rest) = facets.split_once("endfacet\n").unwrap();
    std::fs::write(folder.join("ball.stl"), format!("{head}{rest}")).unwrap();
    let open = fill(&folder, "", &[]).1;
    assert!(open.contains("not closed: 3 edges"), "{open}");
}

#[test]
fn gmsh_fills_a_ball() {
    let Ok(commands) = std::env::var("PATH") else { return };
    if Command::new("gmsh").arg("--version").output().is_err() {
        let _ = writeln!(std::io::stderr(), "skipped: no gmsh on the path");
        return;
    }
    let folder = folder("ball");
    ball(&folder);
    // as it is, then of fewer tetrahedra
    let mut counts = Vec::new();
    for more in [&[][..], &["--edge", "0.02"]] {
        let (code, said) = fill(&folder, &commands, &[&["--scale", "0.001"], more].concat());
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("can be simulated") && said.contains("quality worst"), "{said}");
        let mesh = sinew_scene::mesh_tool::read(&folder.join("ball.msh")).unwrap();
        // that of a ball, less what flat triangles cut off
        let volume = mesh.total_volume() / (4.0 / 3.0 * std::f64::consts::PI * 0.05_f64.powi(3));
        assert!((0.9..1.0).contains(&volume), "{volume}");
        assert!(mesh.group("body").is_some() && mesh.group("surface").is_some(), "{said}");
        assert!(!folder.join("ball.msh.fill").exists());
        counts.push(mesh.tetrahedra.len());
    }
    assert!(counts[1] < counts[0], "{counts:?}");
}
