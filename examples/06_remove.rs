//! A hanging bar is cut through: the lower part falls, the upper part goes on hanging.
//!
//! `cargo run --release --example 06_remove`

use sinew::engine::mesh::generate::box_tets;
use sinew::models::resection::{Region, Removal};
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = box_tets(DVec3::new(0.02, 0.02, 0.1), [2, 2, 10])?;
    let material = preset("liver")?.material;
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    let bar = simulation.add_body(&BodyDescription::new("bar", &mesh, material))?;
    let hook = simulation.group_rows(bar, &mesh, "z1")?;
    simulation.add_constraint(Constraint::hold("hook", hook));
    let whole: f64 = simulation.masses(bar).iter().sum();

    // a blade swings through at half height: elements whose centres are in its way are gone
    let (from, to) = (DVec3::new(-0.01, 0.01, 0.045), DVec3::new(0.03, 0.01, 0.045));
    let blade = Region::Capsule { from, to, radius: 0.0085 };
    let cut = simulation.remove_elements(bar, &Removal::new(blade))?;
    println!("{} of {} elements removed", cut.tetrahedra.len(), mesh.tetrahedra.len());
    assert_eq!(cut.pieces, 2);
    // they took their mass with them; indices of vertices and elements stay as they were
    let masses = simulation.masses(bar);
    assert!((masses.iter().sum::<f64>() + cut.mass - whole).abs() < 1e-12 * whole);

    for _ in 0..20 {
        simulation.step()?;
    }
    let lower = |i: &usize| mesh.points[*i].z < 0.045;
    let speeds = simulation.velocities(bar);
    let momentum: f64 = (0..masses.len()).filter(lower).map(|i| masses[i] * speeds[i].z).sum();
    let mass: f64 = (0..masses.len()).filter(lower).map(|i| masses[i]).sum();
    let (speed, fall) = (-momentum / mass, 9.81 * simulation.time());
    println!("after {:.1} s the lower part falls at {speed:.4} m/s", simulation.time());
    // nothing holds it, so it falls as a stone does; the solver leaves a thousandth of each step's force
    assert!((speed / fall - 1.0).abs() < 1e-3, "{speed} instead of {fall}");
    let upper = simulation.positions(bar).into_iter().enumerate().filter(|(i, _)| !lower(i));
    assert!(upper.fold(1.0_f64, |low, (_, x)| low.min(x.z)) > 0.0);
    Ok(())
}
