//! Grasp, cut, lift, clip: a hand holds a lobe while a scalpel cuts it off, lifts it, and leaves it hanging from a clip.
//!
//! `cargo run --release --example cut_and_clip`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;
use sinew::touch::thread::{Clip, Hold};

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    // a slab of tissue, held at its left end, with vertices to spare for cuts
    let mesh = box_tets(DVec3::new(0.1, 0.04, 0.02), [20, 8, 4])?;
    let material = YoungPoisson { young_modulus: 3e4, ..preset("liver")?.material };
    let slab = BodyDescription::new("slab", &mesh, material);
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let body = simulation.add_body(&BodyDescription { spare: mesh.points.len(), ..slab })?;
    let left = simulation.group_rows(body, &mesh, "x0")?;
    simulation.add_constraint(Constraint::hold("wall", left));
    simulation.set_solver(SolverSettings { mass_damping: 5.0, ..SolverSettings::default() });

    // grasp: a hand draws the right end
    let patch = simulation.group_rows(body, &mesh, "x1")?;
    let hand = simulation.add_pull(Pull::new("hand", patch, 200.0, 0.5));
    let steps = |simulation: &mut Simulation, count| (0..count).try_for_each(|_| simulation.step());
    steps(&mut simulation, 50)?;

    // cut: the edge of a scalpel, upright, goes across at 50 mm/s against 50 J/m^2
    let ends = [DVec3::Z * 0.05, DVec3::Z * -0.05];
    let edge = Edge { ends, into: DVec3::Y, ..Edge::new(0.1, 50.0) };
    let at = |way: f64| DVec3::new(0.062, way - 0.005, 0.01);
    let scalpel = simulation.add_tool(Tool::blade("scalpel", edge, at(0.0)))?;
    let mut most = 0.0_f64;
    for step in 0..=130 {
        simulation.move_tool(scalpel, at(5e-4 * f64::from(step)))?;
        simulation.step()?;
        most = most.max(simulation.tool_report(scalpel).map_or(0.0, |own| own.force.length()));
    }
    let cut = simulation.tool_report(scalpel).ok_or("no scalpel")?.cut_area;
    println!("cut: {:.2} cm^2 against up to {most:.2} N", cut * 1e4);

    // lift what was cut off
    for step in 0..=60 {
        simulation.move_pull(hand, DVec3::Z * (5e-4 * f64::from(step)));
        simulation.step()?;
    }
    let lifted = simulation.pull_report(hand).ok_or("no hand")?.force.length();

    // clip it to a bar above, and let go
    let corner = simulation.positions(body)[mesh.points.len() - 1] - DVec3::splat(1e-3);
    let tissue = simulation.tissue_point(body, corner).ok_or("no tissue there")?;
    let bar = Hold::Place(corner + DVec3::Z * 0.01);
    let clip = simulation.add_clip(Clip::new("clip", [tissue, bar], 500.0))?;
    simulation.remove_contact(hand);
    steps(&mut simulation, 300)?;
    let hangs = simulation.thread_report(clip).ok_or("no clip")?.largest();
    println!("the hand lifted {lifted:.3} N, the clip bears {hangs:.3} N");
    assert!((hangs / lifted - 1.0).abs() < 0.1);
    Ok(())
}
