//! A bar is held at one end and pulled at the other: how far does it stretch?
//!
//! `cargo run --release --example 03_hold_and_load`

use sinew::engine::mesh::generate::box_tets;
use sinew::prelude::*;

#[allow(clippy::print_stdout, reason = "a program for a terminal")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (length, area, young_modulus, force) = (0.1, 4e-4, 1e4, 0.04);
    let mesh = box_tets(DVec3::new(length, 0.02, 0.02), [10, 2, 2])?;
    // a Poisson's ratio of 0, so that the held end does not hinder the bar from getting thinner
    let material = YoungPoisson { young_modulus, poisson_ratio: 0.0, density: 1000.0 };
    let mut simulation = Simulation::new(SimulationOptions::default())?;
    simulation.set_gravity(DVec3::ZERO);
    let bar = simulation.add_body(&BodyDescription::new("bar", &mesh, material))?;
    let wall = simulation.group_rows(bar, &mesh, "x0")?;
    let wall = simulation.add_constraint(Constraint::hold("wall", wall));

    // an even pull: every triangle of the end gives a third of its share to each of its corners
    let end = mesh.group("x1").ok_or("no end")?;
    let corners: Vec<u32> =
        end.cells.triangles.iter().flat_map(|&t| mesh.triangles[t as usize]).collect();
    let share = DVec3::X * force / corners.len() as f64;
    let rows = simulation.rows(bar, "pull", &corners)?;
    let forces = rows.into_iter().map(|row| (row, share)).collect();
    simulation.add_load(Load { name: "pull".into(), forces, curve: Curve::Constant });

    // one step of this integrator is an equilibrium
    let integrator = Integrator::QuasiStatic;
    simulation.set_solver(SolverSettings { integrator, ..SolverSettings::default() });
    simulation.step()?;
    let stretch = simulation.displacements(bar)[end.vertices[0] as usize].x;
    println!("the bar is {:.3} mm longer", 1e3 * stretch);

    // Hooke's law for small stretch: F L / (E A) is 1 mm; the curve of the material bends by 1.5 % of that
    assert!((stretch / (force * length / (young_modulus * area)) - 1.0).abs() < 0.02);
    // St Venant-Kirchhoff without approximation: F = E A (s^3 - s) / 2 at s times the length
    let s = 1.0 + stretch / length;
    assert!((young_modulus * area * (s.powi(3) - s) / 2.0 / force - 1.0).abs() < 1e-6);
    // and the wall pulls as hard, the other way
    let held = simulation.reaction(wall).ok_or("no such constraint")?;
    assert!((held + DVec3::X * force).length() < 1e-6 * force);
    Ok(())
}
