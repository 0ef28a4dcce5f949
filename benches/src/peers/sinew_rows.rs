//! Sinew's own rows.

use super::{Beam, Case, DAMPING, PeerRow, Rival};
use crate::bench::error::BenchError;
use glam::DVec3;
use sinew::engine::law::EvaluationRequest;
use sinew::engine::schedule::ForceSchedule;
use sinew::prelude::*;
use std::time::Instant;

/// A clamped beam in a world of its own.
fn simulation(
    beam: &Beam,
    model: Model,
    precision: Precision,
    threads: usize,
) -> Result<(Simulation, BodyHandle), BenchError> {
    let mut simulation =
        Simulation::new(SimulationOptions { precision, threads, ..Default::default() })?;
    let description =
        BodyDescription { model, ..BodyDescription::new("beam", &beam.mesh, beam.material) };
    let body = simulation.add_body(&description)?;
    let rows = simulation.rows(body, "clamp", &beam.fixed())?;
    simulation.add_constraint(Constraint::hold("clamp", rows));
    simulation.set_gravity(DVec3::new(0.0, 0.0, -beam.gravity));
    Ok((simulation, body))
}

/// Equilibrium displacements (m) by converged Newton.
///
/// # Errors
/// When Newton stops before it has converged.
pub(super) fn equilibrium(beam: &Beam, model: Model) -> Result<Vec<DVec3>, BenchError> {
    let (mut simulation, body) = simulation(beam, model, Precision::F64, 0)?;
    simulation.set_solver(SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-8,
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

/// One setting of Sinew.
struct Run {
    /// Name of the setting.
    name: &'static str,
    model: Model,
    precision: Precision,
    threads: usize,
    settings: SolverSettings,
    /// Step (s); an equilibrium has none.
    h: Option<f64>,
    /// Built by the first use.
    world: Option<(Simulation, BodyHandle)>,
}

/// The settings that run beside the rivals. `all` adds the equilibrium and the explicit ones.
pub(super) fn rivals(threads: usize, steps: &[f64], all: bool) -> Vec<Box<dyn Rival>> {
    let safe = |name, model, precision, linear_tolerance, h| -> Box<dyn Rival> {
        let settings =
            SolverSettings { integrator: Integrator::Safe, linear_tolerance, ..Default::default() };
        Box::new(Run { name, model, precision, threads, settings, h: Some(h), world: None })
    };
    let mut runs = Vec::new();
    let default = SolverSettings::default().linear_tolerance;
    for &h in steps {
        runs.push(safe("safe, StVK", Model::StVK, Precision::F64, default, h));
    }
    let middle = steps[steps.len() / 2];
    runs.push(safe("safe, StVK", Model::StVK, Precision::F32, default, middle));
    runs.push(safe("default", Model::default(), Precision::default(), default, middle));
    if all {
        for (name, integrator, h) in [
            ("quasi-static Newton, StVK", Integrator::QuasiStatic, None),
            ("explicit Störmer-Verlet, StVK", Integrator::StormerVerlet, Some(middle)),
        ] {
            let settings = SolverSettings { integrator, ..Default::default() };
            let (model, precision, world) = (Model::StVK, Precision::F64, None);
            runs.push(Box::new(Run { name, model, precision, threads, settings, h, world }));
        }
    }
    runs
}

impl Run {
    fn world(&mut self, case: &Case) -> Result<&mut (Simulation, BodyHandle), BenchError> {
        if self.world.is_none() {
            self.world = Some(simulation(&case.beam, self.model, self.precision, self.threads)?);
        }
        Ok(self.world.as_mut().expect("built above"))
    }

    /// Sets the state at rest in `u` and the solver with this damping.
    fn prepare(&mut self, case: &Case, u: &[DVec3], mass_damping: f64) -> Result<(), BenchError> {
        let settings = SolverSettings { mass_damping, ..self.settings.clone() };
        let h = self.h.unwrap_or(1.0);
        let (simulation, body) = self.world(case)?;
        simulation.set_solver(settings);
        simulation.set_dt(h);
        simulation.set_state(*body, u, &vec![DVec3::ZERO; u.len()])?;
        Ok(())
    }
}

impl Rival for Run {
    fn time(&mut self, case: &Case, steps: usize) -> Result<Vec<f64>, BenchError> {
        let rest = vec![DVec3::ZERO; case.truth.len()];
        let start = if self.h.is_some() { case.start() } else { rest };
        self.prepare(case, &start, 0.0)?;
        let (simulation, _) = self.world(case)?;
        let mut times = Vec::with_capacity(steps);
        for _ in 0..steps {
            let begin = Instant::now();
            simulation.step()?;
            times.push(begin.elapsed().as_secs_f64() * 1e3);
        }
        Ok(times)
    }

    fn force(&mut self, case: &Case) -> Result<Option<f64>, BenchError> {
        let (simulation, _) = self.world(case)?;
        let world = simulation.world_mut();
        world.insert_resource(EvaluationRequest { energy: false, force: true, tangent: None });
        let times = (0..20).map(|_| {
            let begin = Instant::now();
            world.run_schedule(ForceSchedule);
            begin.elapsed().as_secs_f64()
        });
        Ok(super::median(times.collect()))
    }

    fn settle(&mut self, case: &Case) -> Result<Vec<DVec3>, BenchError> {
        let rest = vec![DVec3::ZERO; case.truth.len()];
        let (steps, warm) = self.h.map_or((1, false), |h| case.settling(h));
        let damping = if self.h.is_some() { DAMPING } else { 0.0 };
        self.prepare(case, if warm { &case.truth } else { &rest }, damping)?;
        let (simulation, body) = self.world(case)?;
        for _ in 0..steps {
            simulation.step()?;
        }
        Ok(simulation.displacements(*body))
    }

    fn truth(&self, case: &Case) -> Result<Option<Vec<DVec3>>, BenchError> {
        (self.model != Model::StVK).then(|| equilibrium(&case.beam, self.model)).transpose()
    }

    fn row(&self, case: &Case) -> PeerRow {
        let tolerance = self.settings.linear_tolerance;
        let setting = match (self.h, self.settings.integrator) {
            (None, _) => format!("{}, from rest, CG {tolerance:e}", self.name),
            (Some(h), Integrator::Safe) => {
                format!("{}, h = {}, CG {tolerance:e}", self.name, super::milliseconds(h))
            }
            (Some(h), _) => {
                format!("{}, automatic substeps of {}", self.name, super::milliseconds(h))
            }
        };
        let mut row = case.row("Sinew", env!("CARGO_PKG_VERSION"), setting);
        row.threads = self.threads;
        row.precision = self.precision.name().into();
        row
    }

    fn step(&self) -> Option<f64> {
        self.h
    }

    fn remark(&self) -> String {
        let Some((simulation, _)) = &self.world else { return String::new() };
        let r = simulation.report();
        let mut text = match self.settings.integrator {
            Integrator::QuasiStatic => {
                format!("{} Newton, {} CG iterations", r.newton_iterations, r.cg_iterations)
            }
            Integrator::Safe | Integrator::Newton => String::new(),
            _ => format!("{} substeps", r.substeps),
        };
        if self.model != Model::StVK {
            super::say(&mut text, "with compression term, error against its own equilibrium");
        }
        text
    }
}
