//! The truth that errors are measured against.

use super::beam::Beam;
use crate::toolbox::prelude::*;
use sinew::models::body::VolumeRule;

/// A clamped beam in a world of its own.
pub fn simulation(
    beam: &Beam,
    model: Model,
    volume: VolumeRule,
    precision: Precision,
    threads: usize,
) -> Result<(Simulation, BodyHandle)> {
    let mut simulation = Simulation::new(SimulationOptions {
        precision,
        threads,
        exclusive: true,
        ..Default::default()
    })?;
    let body = BodyDescription::new("beam", &beam.mesh, beam.material);
    let description = BodyDescription { model, volume, integration: beam.integration, ..body };
    let body = simulation.add_body(&description)?;
    let rows = simulation.rows(body, "clamp", &beam.fixed)?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    simulation.set_gravity(DVec3::new(0.0, 0.0, -beam.gravity));
    Ok((simulation, body))
}

/// Equilibrium displacements (m) by converged Newton.
///
/// # Errors
/// When Newton stops before it has converged.
pub fn equilibrium(beam: &Beam, model: Model, volume: VolumeRule) -> Result<Vec<DVec3>> {
    let (mut simulation, body) = simulation(beam, model, volume, Precision::F64, 0)?;
    simulation.set_solver(SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-8,
        // elements that lock take thousands
        max_linear_iterations: 50_000,
        ..Default::default()
    });
    simulation.set_dt(1.0);
    simulation.step()?;
    let report = simulation.report();
    if report.unconverged || report.cg_caps > 0 {
        let (step, iterations) = (report.newton_step, report.newton_iterations);
        return Err(BenchError::NoTruth {
            case: beam.name.clone(),
            reason: format!("Newton step {step:e} of the body after {iterations} iterations"),
        });
    }
    Ok(simulation.displacements(body))
}
