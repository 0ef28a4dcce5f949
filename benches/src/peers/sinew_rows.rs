//! Sinew's own rows.

use super::equilibrium::{equilibrium, simulation};
use super::rival::{BeamCase, DAMPING, PeerRow, Rival, milliseconds, say};
use crate::toolbox::prelude::*;
use crate::toolbox::stats::median;
use sinew::engine::law::EvaluationRequest;
use sinew::engine::schedule::ForceSchedule;
use sinew::models::body::VolumeRule;

/// One setting of Sinew.
pub struct SinewRun {
    /// Name of the setting.
    name: &'static str,
    model: Model,
    volume: VolumeRule,
    precision: Precision,
    settings: SolverSettings,
    /// Step (s); an equilibrium has none.
    h: Option<f64>,
    /// Built by the first use.
    world: Option<(Simulation, BodyHandle)>,
    /// Timed steps so far, and the linear iterations they took.
    counted: [u64; 2],
}

/// The settings that run beside the rivals. `all` adds the equilibrium and the explicit ones.
pub fn rivals(steps: &[f64], all: bool) -> Vec<Box<dyn Rival>> {
    let run = |name, integrator, model, precision, h| -> Box<dyn Rival> {
        let settings = SolverSettings { integrator, ..Default::default() };
        Box::new(SinewRun { precision, ..SinewRun::new(name, model, settings, Some(h)) })
    };
    let (safe, auto) = (Integrator::Safe, Integrator::Auto);
    let mut runs = Vec::new();
    for &h in steps {
        runs.push(run("safe, StVK", safe, Model::StVK, Precision::F64, h));
        runs.push(run("auto, StVK", auto, Model::StVK, Precision::F64, h));
    }
    let middle = steps[steps.len() / 2];
    runs.push(run("safe, StVK", safe, Model::StVK, Precision::F32, middle));
    runs.push(run("auto, StVK", auto, Model::StVK, Precision::F32, middle));
    runs.push(run("default", auto, Model::default(), Precision::default(), middle));
    if all {
        for (name, integrator, h) in [
            ("quasi-static Newton, StVK", Integrator::QuasiStatic, None),
            ("explicit Störmer-Verlet, StVK", Integrator::StormerVerlet, Some(middle)),
        ] {
            let settings = SolverSettings { integrator, ..Default::default() };
            runs.push(Box::new(SinewRun::new(name, Model::StVK, settings, h)));
        }
    }
    runs
}

impl SinewRun {
    /// A setting in `f64` on one thread, every element keeping its own volume.
    pub fn new(name: &'static str, model: Model, settings: SolverSettings, h: Option<f64>) -> Self {
        let (volume, precision) = (VolumeRule::Elements, Precision::F64);
        Self { name, model, volume, precision, settings, h, world: None, counted: [0; 2] }
    }

    /// Steps (s) that are converged: the linear systems too.
    pub fn converged(name: &'static str, energy: Model, integrator: Integrator, h: f64) -> Self {
        let (linear_tolerance, max_linear_iterations) = (1e-6, 50_000);
        let settings = SolverSettings {
            integrator,
            linear_tolerance,
            max_linear_iterations,
            ..Default::default()
        };
        Self::new(name, energy, settings, Some(h))
    }

    /// With another rule for what keeps its volume.
    #[must_use]
    pub fn with_volume(self, volume: VolumeRule) -> Self {
        Self { volume, ..self }
    }

    fn world(&mut self, case: &BeamCase) -> Result<&mut (Simulation, BodyHandle)> {
        if self.world.is_none() {
            let (model, volume) = (self.model, self.volume);
            let world = simulation(&case.beam, model, volume, self.precision, 1)?;
            self.world = Some(world);
        }
        Ok(self.world.as_mut().expect("built above"))
    }

    /// Sets the state at rest in `u` and the solver with this damping.
    fn prepare(&mut self, case: &BeamCase, u: &[DVec3], mass_damping: f64) -> Result<()> {
        let settings = SolverSettings { mass_damping, ..self.settings.clone() };
        let h = self.h.unwrap_or(1.0);
        let (simulation, body) = self.world(case)?;
        simulation.set_solver(settings);
        simulation.set_dt(h);
        simulation.set_state(*body, u, &vec![DVec3::ZERO; u.len()])?;
        Ok(())
    }
}

impl Rival for SinewRun {
    fn time(&mut self, case: &BeamCase, steps: usize) -> Result<Vec<f64>> {
        let rest = vec![DVec3::ZERO; case.truth.len()];
        let start = if self.h.is_some() { case.start() } else { rest };
        self.prepare(case, &start, 0.0)?;
        let (simulation, _) = self.world(case)?;
        let mut times = Vec::with_capacity(steps);
        let mut iterations = 0;
        for _ in 0..steps {
            let begin = Instant::now();
            simulation.step()?;
            times.push(begin.elapsed().as_secs_f64() * 1e3);
            iterations += u64::from(simulation.report().cg_iterations);
        }
        self.counted = [self.counted[0] + steps as u64, self.counted[1] + iterations];
        Ok(times)
    }

    fn swing(&mut self, case: &BeamCase, steps: usize, every: usize) -> Result<Vec<Vec<DVec3>>> {
        let rest = vec![DVec3::ZERO; case.beam.mesh.points.len()];
        self.prepare(case, &rest, 0.0)?;
        let (simulation, body) = self.world(case)?;
        let mut states = Vec::with_capacity(steps / every);
        for i in 1..=steps {
            simulation.step()?;
            if simulation.report().unconverged {
                let name = &case.beam.name;
                return Err(BenchError::Rival(format!(
                    "{name}: Newton does not converge at step {i}"
                )));
            }
            if i % every == 0 {
                states.push(simulation.displacements(*body));
            }
        }
        Ok(states)
    }

    fn linear_iterations(&self) -> Option<f64> {
        let [steps, iterations] = self.counted;
        (steps > 0).then(|| iterations as f64 / steps as f64)
    }

    fn force(&mut self, case: &BeamCase) -> Result<Option<f64>> {
        let (simulation, _) = self.world(case)?;
        let world = simulation.world_mut();
        world.insert_resource(EvaluationRequest { energy: false, force: true, tangent: None });
        let times = (0..20).map(|_| {
            let begin = Instant::now();
            world.run_schedule(ForceSchedule);
            begin.elapsed().as_secs_f64()
        });
        Ok(median(&times.collect::<Vec<f64>>()))
    }

    fn settle(&mut self, case: &BeamCase) -> Result<Vec<DVec3>> {
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

    fn truth(&self, case: &BeamCase) -> Result<Option<Vec<DVec3>>> {
        let own = || equilibrium(&case.beam, self.model, self.volume);
        (self.model != Model::StVK).then(own).transpose()
    }

    fn energy(&self) -> Model {
        self.model
    }

    fn is_euler(&self) -> bool {
        matches!(self.settings.integrator, Integrator::Safe | Integrator::Newton)
    }

    fn row(&self, case: &BeamCase) -> PeerRow {
        let tolerance = self.settings.linear_tolerance;
        let setting = match (self.h, self.settings.integrator) {
            (None, _) => format!("{}, from rest, CG {tolerance:e}", self.name),
            (Some(h), Integrator::Safe | Integrator::Auto) => {
                format!("{}, h = {}, CG {tolerance:e}", self.name, milliseconds(h))
            }
            (Some(h), _) => {
                format!("{}, automatic substeps of {}", self.name, milliseconds(h))
            }
        };
        let mut row = case.row("Sinew", env!("CARGO_PKG_VERSION"), setting);
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
            i if !i.is_explicit() => String::new(),
            _ => format!("{} substeps", r.substeps),
        };
        if self.model != Model::StVK {
            say(&mut text, "with compression term, error against its own equilibrium");
        }
        text
    }
}
