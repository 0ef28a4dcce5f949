//! A liver hangs from its ligament and is pulled by a tool that a hand moves between steps.
//!
//! `cargo run --release --example liver`

use sinew::prelude::*;

/// Where the hand is at a time (s): way (m) and turn of the tool since it took hold. A device says this.
fn hand(time: f64) -> Pose {
    let part = (time / 0.5).min(1.0);
    let translation = DVec3::new(0.0, 0.0, 0.03 * part);
    Pose { translation, rotation: DQuat::from_rotation_z(0.2 * part), centre: DVec3::ZERO }
}

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = Mesh::read("demos/meshes/liver.msh".as_ref())?;
    let mesh = check(&mesh, &CheckOptions::default())?.mesh;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let material = preset("liver")?.material;
    let liver = simulation.add_body(&BodyDescription::new("liver", &mesh, material))?;

    let ligament = simulation.group_rows(liver, &mesh, "ligament")?;
    simulation.add_constraint(Constraint::hold("ligament", ligament));
    let grasped = simulation.group_rows(liver, &mesh, "tool")?;
    let tool = simulation.add_constraint(Constraint::hold("tool", grasped));

    let dt = 0.01;
    simulation.set_dt(dt);
    for _ in 0..60 {
        let pose = hand(simulation.time() + dt);
        simulation.set_target(tool, pose)?; // reached at the end of the step
        simulation.step()?;
        simulation.evaluate();
        let _force = -simulation.reaction(tool); // N on the hand
        let _drawn = simulation.positions(liver); // m, in the order of the mesh
    }
    println!("the tool pulls with {:.2} N", simulation.reaction(tool).length());
    assert!(simulation.reaction(tool).z > 1.0 && simulation.volume_report().inverted == 0);
    Ok(())
}
