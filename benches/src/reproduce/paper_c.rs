//! Bourguignon & Cani 2000 made again.

use super::{Paper, axis_cost, fibres, pictures, volume};
use crate::bench::error::BenchError;
use crate::bench::machine::MachineNotes;
use sinew::models::axes::description::AxesDescription;
use sinew::prelude::*;

const REFERENCE: &str = "Bourguignon & Cani 2000, Controlling Anisotropy in Mass-Spring Systems";

/// Makes the figures of Bourguignon & Cani 2000 with the letters given, all with none; `tell` hears what is
/// going on.
///
/// # Errors
/// When a letter is unknown, a simulation cannot be run or a chart not be drawn.
pub fn paper_c(only: &[char], mut tell: impl FnMut(&str)) -> Result<Paper, BenchError> {
    if let Some(letter) = only.iter().find(|c| !('a'..='d').contains(*c)) {
        return Err(BenchError::Request {
            what: format!("figure {letter}"),
            remedy: "choose of a, b, c, d".into(),
        });
    }
    let wanted = |letter: char| only.is_empty() || only.contains(&letter);
    let mut figures = Vec::new();
    if wanted('a') {
        tell("a: a block pulled down (figures 1, 5 and 6)");
        figures.push(fibres::figure()?);
    }
    if wanted('b') {
        tell("b: stiffness between the axes");
        figures.push(fibres::between()?);
    }
    if wanted('c') {
        tell("c: volume on a table, and a cantilever (figures 3 and 5)");
        figures.push(volume::figure()?);
    }
    if wanted('d') {
        tell("d: time (table 1)");
        figures.push(axis_cost::figure()?);
    }
    let short = "Bourguignon & Cani 2000";
    let pictures = pictures("paper-c", wanted('a'), &mut tell)?;
    Ok(Paper {
        name: "paper-c",
        reference: REFERENCE,
        short,
        machine: MachineNotes::now(),
        figures,
        pictures,
    })
}

/// A body in a world of its own, without gravity, on one thread.
pub(super) fn world(
    mesh: &Mesh,
    material: YoungPoisson,
    model: Model,
    axes: Option<AxesDescription>,
    solver: SolverSettings,
) -> Result<(Simulation, BodyHandle), BenchError> {
    let options = SimulationOptions { threads: 1, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options)?;
    let body = BodyDescription { model, axes, ..BodyDescription::new("block", mesh, material) };
    let body = simulation.add_body(&body)?;
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_solver(solver);
    Ok((simulation, body))
}

/// Settings for an equilibrium.
pub(super) fn equilibrium() -> SolverSettings {
    SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-6,
        newton_tolerance: 1e-9,
        max_newton_iterations: 100,
        ..SolverSettings::default()
    }
}

/// Finds the equilibrium, loads applied by curves that end at `parts` steps of 1 s.
///
/// # Errors
/// When there is none.
pub(super) fn settle(
    simulation: &mut Simulation,
    parts: u32,
    case: &str,
) -> Result<(), BenchError> {
    simulation.set_dt(1.0);
    let none = |reason: String| BenchError::NoTruth { case: case.to_string(), reason };
    for _ in 0..parts {
        simulation.step().map_err(|e| none(e.to_string()))?;
        if simulation.report().unconverged {
            return Err(none("Newton's method did not converge".into()));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_letters_are_named() {
        let error = paper_c(&['x'], |_| {}).err().unwrap().to_string();
        assert!(error.contains("figure x") && error.contains("a, b, c, d"), "{error}");
    }
}
