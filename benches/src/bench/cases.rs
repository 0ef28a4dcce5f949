//! The scenes of the chart of speed against error, each on meshes that refine one another.

use crate::toolbox::meshes::{demo_mesh, refined};
use crate::toolbox::prelude::*;
use sinew::engine::mesh::generate::box_tets;
use sinew::models::body::Evaluation;
use sinew_tune::measures::displacement_error;

/// A scene with one body.
pub struct AccuracyCase {
    /// Name.
    pub name: &'static str,
    /// What happens.
    pub description: &'static str,
    /// Material.
    pub material: YoungPoisson,
    /// Gravity (m/s^2).
    pub gravity: DVec3,
    /// Group that is held.
    pub held: &'static str,
    /// Group that is moved, and where to.
    pub moved: Option<(&'static str, Motion)>,
    /// Meshes, coarse to fine; each has the vertices of the one before, in the same order.
    pub meshes: Vec<Mesh>,
    /// How many of them get points; what is left is the refined mesh that errors are measured against.
    pub measured: usize,
    /// Parts in which the converged solution applies loads and motion.
    pub truth_load_steps: u32,
    /// What is asked.
    pub kind: AccuracyKind,
}

/// What is asked of a case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AccuracyKind {
    /// The equilibrium.
    Equilibrium,
    /// The motion from rest, compared every `sample` s.
    Motion {
        /// Length (s).
        duration: f64,
        /// Time (s) between comparisons.
        sample: f64,
    },
}

const EARTH: DVec3 = DVec3::new(0.0, 0.0, -9.81);

/// All cases; quick ones are coarser.
///
/// # Errors
/// When a mesh cannot be generated or read.
pub fn cases(quick: bool) -> Result<Vec<AccuracyCase>> {
    let gel = YoungPoisson { young_modulus: 3e5, poisson_ratio: 0.45, density: 1000.0 };
    let soft = YoungPoisson { young_modulus: 1e4, ..gel };
    let measured = if quick { 1 } else { 2 };
    let ladder = |first: Mesh, levels: usize| {
        let mut meshes = vec![first];
        for i in 1..levels {
            meshes.push(refined(&meshes[i - 1]));
        }
        meshes
    };
    let beam = || box_tets(DVec3::new(0.2, 0.05, 0.05), [8, 2, 2]);
    let block = || box_tets(DVec3::new(0.1, 0.05, 0.05), [4, 2, 2]);
    let still = |name, description, motion, truth_load_steps| -> Result<AccuracyCase> {
        Ok(AccuracyCase {
            name,
            description,
            material: soft,
            gravity: DVec3::ZERO,
            held: "x0",
            moved: Some(("x1", motion)),
            meshes: ladder(block()?, measured + 1),
            measured,
            truth_load_steps,
            kind: AccuracyKind::Equilibrium,
        })
    };
    let cantilever = AccuracyCase {
        name: "cantilever",
        description: "beam 0.2 x 0.05 x 0.05 m, E 300 kPa, nu 0.45, clamped at x = 0, under its weight",
        material: gel,
        gravity: EARTH,
        held: "x0",
        moved: None,
        meshes: ladder(beam()?, if quick { 2 } else { 4 }),
        measured: if quick { 1 } else { 3 },
        truth_load_steps: 2,
        kind: AccuracyKind::Equilibrium,
    };
    let swinging = AccuracyCase {
        name: "swinging beam",
        description: "the beam of the cantilever let go from its straight shape",
        meshes: ladder(beam()?, measured + 1),
        measured,
        truth_load_steps: 1,
        kind: AccuracyKind::Motion { duration: if quick { 0.2 } else { 0.4 }, sample: 0.02 },
        moved: None,
        ..cantilever
    };
    Ok(vec![
        cantilever,
        still(
            "stretch",
            "block 0.1 x 0.05 x 0.05 m, E 10 kPa, nu 0.45, both ends clamped, drawn out by 30 %",
            Motion::Translate(DVec3::new(0.03, 0.0, 0.0)),
            3,
        )?,
        still(
            "twist",
            "the block, one end turned by 90 degrees",
            Motion::Rotate {
                centre: DVec3::new(0.1, 0.025, 0.025),
                axis: DVec3::X,
                angle: std::f64::consts::FRAC_PI_2,
            },
            9,
        )?,
        still(
            "compress",
            "the block pressed together by 20 %",
            Motion::Translate(DVec3::new(-0.02, 0.0, 0.0)),
            4,
        )?,
        still(
            "shear",
            "the block, one end moved sideways by 30 % of its length",
            Motion::Translate(DVec3::new(0.0, 0.0, 0.03)),
            3,
        )?,
        swinging,
        AccuracyCase {
            name: "liver pull",
            description: "the liver of the demo hangs from its ligament and is pulled by a tool",
            material: preset("liver")?.material,
            gravity: EARTH,
            held: "ligament",
            moved: Some(("tool", Motion::Translate(DVec3::new(0.045, -0.03, 0.045)))),
            meshes: ladder(demo_mesh("liver.msh")?, measured),
            measured: 1,
            truth_load_steps: 5,
            kind: AccuracyKind::Equilibrium,
        },
    ])
}

/// How a case is computed.
#[derive(Clone, Debug)]
pub struct Method {
    /// Energy.
    pub model: Model,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// Number type.
    pub precision: Precision,
    /// Threads.
    pub threads: usize,
    /// Step (s) of a motion; of an equilibrium by load steps their number is `1 / dt`.
    pub dt: f64,
    /// Solver.
    pub settings: SolverSettings,
    /// For equilibria found by damped motion: largest speed over largest displacement (1/s) at which
    /// the body counts as settled.
    pub settled: f64,
}

impl Default for Method {
    fn default() -> Self {
        Self {
            model: Model::CompressibleStVK,
            evaluation: Evaluation::Fused,
            precision: Precision::F64,
            threads: 1,
            dt: 0.01,
            settings: SolverSettings::default(),
            settled: 1e-3,
        }
    }
}

/// What a method found.
#[derive(Clone, Debug, Default)]
pub struct MethodOutcome {
    /// Displacements (m) in the order of the mesh: at each time of comparison, or of the equilibrium.
    pub states: Vec<Vec<DVec3>>,
    /// Wall time of the steps (s), set-up not included.
    pub seconds: f64,
    /// Simulated time (s); 0 for load steps.
    pub simulated: f64,
    /// Steps.
    pub steps: u64,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u64,
    /// Explicit substeps.
    pub substeps: u64,
    /// What the reader must know.
    pub note: String,
}

/// Simulated time (s) after which a body that still moves is given up.
const PATIENCE: f64 = 20.0;
/// Time (s) in which a damped motion applies prescribed motions.
const RAMP: f64 = 0.5;

impl AccuracyCase {
    /// Whether the answer is a motion.
    pub fn is_motion(&self) -> bool {
        self.kind != AccuracyKind::Equilibrium
    }

    fn set_up(&self, mesh: &Mesh, method: &Method, ramp: f64) -> Result<(Simulation, BodyHandle)> {
        let options = SimulationOptions {
            exclusive: true,
            precision: method.precision,
            threads: method.threads,
            ..Default::default()
        };
        let mut simulation = Simulation::new(options)?;
        let body = simulation.add_body(&BodyDescription {
            model: method.model,
            evaluation: method.evaluation,
            ..BodyDescription::new(self.name, mesh, self.material)
        })?;
        let rows = simulation.group_rows(body, mesh, self.held)?;
        simulation.add_constraint(Constraint::hold("held", rows));
        if let Some((group, motion)) = &self.moved {
            let rows = simulation.group_rows(body, mesh, group)?;
            let curve = Curve::ramp(0.0, ramp);
            simulation.add_constraint(Constraint::moving("moved", rows, motion.clone(), curve));
        }
        simulation.set_gravity(self.gravity);
        simulation.set_solver(method.settings.clone());
        simulation.set_dt(method.dt);
        Ok((simulation, body))
    }

    /// Computes the case on a mesh.
    ///
    /// # Errors
    /// When it cannot be set up or a step fails.
    pub fn run(&self, mesh: &Mesh, method: &Method) -> Result<MethodOutcome> {
        match self.kind {
            AccuracyKind::Motion { duration, sample } => {
                self.motion(mesh, method, duration, sample)
            }
            AccuracyKind::Equilibrium if method.settings.integrator == Integrator::QuasiStatic => {
                self.load_steps(mesh, method, None)
            }
            AccuracyKind::Equilibrium => self.settle(mesh, method),
        }
    }

    fn motion(
        &self,
        mesh: &Mesh,
        method: &Method,
        duration: f64,
        sample: f64,
    ) -> Result<MethodOutcome> {
        let (mut simulation, body) = self.set_up(mesh, method, RAMP)?;
        let every = (sample / method.dt).round().max(1.0) as u64;
        let steps = (duration / method.dt).round() as u64;
        let mut outcome = MethodOutcome { simulated: duration, ..MethodOutcome::default() };
        for i in 1..=steps {
            outcome.step(&mut simulation)?;
            if i % every == 0 {
                outcome.states.push(simulation.displacements(body));
            }
        }
        Ok(outcome)
    }

    /// Equilibria at growing shares of the load. `polish` are the settings of one more equilibrium at
    /// the full load.
    fn load_steps(
        &self,
        mesh: &Mesh,
        method: &Method,
        polish: Option<&SolverSettings>,
    ) -> Result<MethodOutcome> {
        let (mut simulation, body) = self.set_up(mesh, method, 1.0)?;
        let steps = (1.0 / method.dt).round() as u32;
        let mut outcome = MethodOutcome::default();
        for i in 1..=steps {
            simulation.set_gravity(self.gravity * (f64::from(i) / f64::from(steps)));
            outcome.step(&mut simulation)?;
            if simulation.report().unconverged {
                outcome.note = format!("Newton did not converge at load step {i}");
            }
        }
        outcome.states.push(simulation.displacements(body));
        if let Some(settings) = polish {
            simulation.set_solver(settings.clone());
            outcome.step(&mut simulation)?;
            outcome.states.push(simulation.displacements(body));
        }
        Ok(outcome)
    }

    fn settle(&self, mesh: &Mesh, method: &Method) -> Result<MethodOutcome> {
        let (mut simulation, body) = self.set_up(mesh, method, RAMP)?;
        let mut outcome = MethodOutcome::default();
        loop {
            outcome.step(&mut simulation)?;
            outcome.simulated = simulation.time();
            let largest = |v: Vec<DVec3>| v.iter().map(|x| x.length()).fold(0.0, f64::max);
            let speed = largest(simulation.velocities(body));
            let way = largest(simulation.displacements(body));
            let settled = speed <= method.settled * way;
            if settled && (self.moved.is_none() || outcome.simulated > RAMP) {
                outcome.note = format!("settled at {:.2} s", outcome.simulated);
                break;
            }
            if outcome.simulated >= PATIENCE {
                outcome.note = format!("still moving at {PATIENCE} s");
                break;
            }
        }
        outcome.states.push(simulation.displacements(body));
        Ok(outcome)
    }

    /// The converged solution on a mesh, and an estimate of its own error.
    ///
    /// Equilibria: Newton to 1e-9, then once more with linear systems solved to 1e-10; the estimate
    /// is what that changed. Motions: Störmer-Verlet with a third of the stable step and with half of
    /// that; the estimate is a third of the difference (the scheme is of second order).
    ///
    /// # Errors
    /// When it cannot be computed.
    pub fn truth(&self, mesh: &Mesh) -> Result<CaseTruth> {
        let start = std::time::Instant::now();
        let no_truth = |reason: String| BenchError::NoTruth { case: self.name.to_string(), reason };
        let (states, own_error) = match self.kind {
            AccuracyKind::Equilibrium => {
                let settings = SolverSettings {
                    integrator: Integrator::QuasiStatic,
                    linear_tolerance: 1e-4,
                    max_linear_iterations: 50_000,
                    ..Default::default()
                };
                let tight = SolverSettings {
                    linear_tolerance: 1e-10,
                    newton_tolerance: 1e-12,
                    ..settings.clone()
                };
                let dt = 1.0 / f64::from(self.truth_load_steps);
                let method = Method { dt, settings, threads: 0, ..Method::default() };
                let mut outcome = self.load_steps(mesh, &method, Some(&tight))?;
                let states: Vec<_> = outcome.states.pop().into_iter().collect();
                let own = displacement_error(&outcome.states, &states, mesh.points.len());
                (states, own)
            }
            AccuracyKind::Motion { .. } => {
                let run = |safety| {
                    let settings = SolverSettings {
                        integrator: Integrator::StormerVerlet,
                        explicit_safety: safety,
                        ..Default::default()
                    };
                    self.run(mesh, &Method { settings, threads: 0, ..Method::default() })
                };
                let (coarse, fine) = (run(0.34)?, run(0.17)?);
                let own = displacement_error(&coarse.states, &fine.states, mesh.points.len())
                    .map(|e| e / 3.0);
                (fine.states, own)
            }
        };
        let own_error = own_error.ok_or_else(|| no_truth("it is not finite".into()))?;
        if own_error > 1e-2 {
            return Err(no_truth(format!(
                "two solutions differ by {:.1} %; use a milder load or a finer mesh",
                100.0 * own_error
            )));
        }
        Ok(CaseTruth { states, own_error, seconds: start.elapsed().as_secs_f64() })
    }
}

impl MethodOutcome {
    fn step(&mut self, simulation: &mut Simulation) -> Result<()> {
        let start = std::time::Instant::now();
        simulation.step()?;
        self.seconds += start.elapsed().as_secs_f64();
        self.steps += 1;
        let report = simulation.report();
        self.cg_iterations += u64::from(report.cg_iterations);
        self.substeps += u64::from(report.substeps);
        Ok(())
    }
}

/// A converged solution.
pub struct CaseTruth {
    /// Displacements (m) at each time of comparison, or of the equilibrium.
    pub states: Vec<Vec<DVec3>>,
    /// Estimate of its own error, over the largest displacement.
    pub own_error: f64,
    /// What it took (s).
    pub seconds: f64,
}
