//! A mesh from a file becomes a body: read, check, name a group, vary the stiffness.
//!
//! `cargo run --release --example 02_own_mesh`

use sinew::engine::mesh::Group;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Gmsh, VTK, VTU, TetGen, OBJ or STL; one in millimetres goes through `.transformed(1e-3, ..)`
    let mesh = Mesh::read("demos/meshes/liver.msh".as_ref())?;
    // says what is wrong and how to mend it, turns inverted elements round; errors end the program
    let checked = check(&mesh, &CheckOptions::default())?;
    for finding in &checked.report.findings {
        println!("{finding}");
    }
    let mut mesh = checked.mesh;

    // the file has groups of its own; a group is a name and a list of vertices
    let high = |x: &DVec3| x.z > 0.05;
    let vertices = (0..).zip(&mesh.points).filter(|(_, x)| high(x)).map(|(i, _)| i).collect();
    mesh.groups.push(Group { name: "dome".into(), vertices, ..Group::default() });

    // Young's modulus (Pa) of every element: a hard lump in the right lobe
    let centre = |t: &[u32; 4]| t.iter().map(|&i| mesh.points[i as usize]).sum::<DVec3>() / 4.0;
    let in_lump = |t: &[u32; 4]| centre(t).distance(DVec3::new(-0.05, 0.0, 0.0)) < 0.02;
    let young: Vec<f64> =
        mesh.tetrahedra.iter().map(|t| if in_lump(t) { 5e4 } else { 5e3 }).collect();

    let material = preset("liver")?.material;
    let body = BodyDescription::new("liver", &mesh, material);
    let body = BodyDescription { young_modulus: Some(&young), ..body };
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let liver = simulation.add_body(&body)?;
    let dome = simulation.group_rows(liver, &mesh, "dome")?;
    simulation.add_constraint(Constraint::hold("dome", dome));
    for _ in 0..50 {
        simulation.step()?;
    }
    let lowest = simulation.positions(liver).iter().fold(0.0_f64, |low, x| low.min(x.z));
    println!("{} elements, lowest point at {:.1} mm", mesh.tetrahedra.len(), 1e3 * lowest);
    // every element gives its mass to its vertices, so nothing of it is lost
    let mass: f64 = simulation.masses(liver).iter().sum();
    assert!((mass / (material.density * mesh.total_volume()) - 1.0).abs() < 1e-12);
    assert_eq!(simulation.volume_report().inverted, 0);
    Ok(())
}
