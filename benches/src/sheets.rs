//! Hard cases of membranes: a sheet whose edges are brought together until it wrinkles, sheets collapsed
//! to a point or a line, a sphere blown up to many times its size.

use glam::{DVec2, DVec3};
use serde::Serialize;
use sinew::engine::mesh::MeshError;
use sinew::engine::mesh::generate::{sphere_triangles, triangle_grid};
use sinew::engine::vertex::FixedAxes;
use sinew::models::membrane::plane_stress;
use sinew::models::sheet::{MembraneDescription, MembraneModel};
use sinew::prelude::*;

/// What happened to a sheet.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// All positions and velocities stayed finite, and no step failed.
    pub finite: bool,
    /// Largest rise of kinetic plus elastic energy above its start plus outside work, over the largest
    /// energy of the run.
    pub energy_excess: f64,
    /// Root mean square of relative edge-length change at the end.
    pub edge_error: f64,
    /// Smallest area ratio at the end.
    pub smallest_area_ratio: f64,
    /// Largest distance (m) of a vertex from the plane of the rest shape at the end.
    pub out_of_plane: f64,
    /// Steps, and those on a projected tangent.
    pub steps: [u64; 2],
    /// What stopped it, if anything.
    pub error: Option<String>,
}

impl Outcome {
    /// Finite, and total energy never above its start plus outside work but for rounding.
    pub fn is_bounded(&self) -> bool {
        self.finite && self.energy_excess <= 1e-6
    }
}

/// Where a collapsed sheet starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Collapse {
    /// All vertices in one point.
    Point,
    /// All vertices on a line.
    Line,
}

/// How the sheet is run.
#[derive(Clone, Debug)]
pub struct SheetOptions {
    /// Energy.
    pub model: MembraneModel,
    /// Integrator and its settings; damping is set by the cases.
    pub solver: SolverSettings,
    /// Number type.
    pub precision: Precision,
    /// Step length (s).
    pub dt: f64,
}

impl Default for SheetOptions {
    fn default() -> Self {
        Self {
            model: MembraneModel::Biquadratic,
            solver: SolverSettings { integrator: Integrator::Safe, ..Default::default() },
            precision: Precision::F64,
            dt: 1.0 / 60.0,
        }
    }
}

/// Length of the sides (m), cells along them, thickness (m).
const SHEET: (f64, usize, f64) = (0.2, 10, 0.001);

fn material() -> YoungPoisson {
    YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 }
}

struct Run {
    simulation: Simulation,
    body: BodyHandle,
    mesh: Mesh,
    /// Start, outside work, largest of both (J).
    energy: [f64; 3],
    outcome: Outcome,
}

impl Run {
    fn new(mesh: Mesh, thickness: f64, options: &SheetOptions) -> Result<Self, SimulationError> {
        let settings = SimulationOptions {
            precision: options.precision,
            threads: 1,
            ..SimulationOptions::default()
        };
        let mut simulation = Simulation::new(settings)?;
        let membrane = MembraneDescription {
            model: options.model,
            ..MembraneDescription::new(&mesh.triangles, thickness, material())
        };
        let body = simulation.add_body(&BodyDescription {
            membrane: Some(membrane),
            ..BodyDescription::from_parts("sheet", &mesh.points, &[], material())
        })?;
        simulation.set_gravity(DVec3::ZERO);
        simulation.set_dt(options.dt);
        simulation.set_solver(options.solver.clone());
        let outcome = Outcome {
            finite: true,
            energy_excess: 0.0,
            edge_error: f64::NAN,
            smallest_area_ratio: f64::NAN,
            out_of_plane: f64::NAN,
            steps: [0; 2],
            error: None,
        };
        Ok(Self { simulation, body, mesh, energy: [0.0; 3], outcome })
    }

    /// Displacements of the start, with some noise (m), at rest.
    fn start(&mut self, mut u: Vec<DVec3>, noise: f64) -> Result<(), SimulationError> {
        let mut seed = 1u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / f64::from(1u32 << 30) - 1.0
        };
        for u in &mut u {
            *u += noise * DVec3::new(next(), next(), next());
        }
        let still = vec![DVec3::ZERO; u.len()];
        self.simulation.set_state(self.body, &u, &still)?;
        self.energy[0] = self.simulation.evaluate();
        self.energy[2] = self.energy[0];
        Ok(())
    }

    fn steps(&mut self, count: u64) {
        for _ in 0..count {
            if let Err(error) = self.simulation.step() {
                self.outcome.error = Some(error.to_string());
                self.outcome.finite = false;
                return;
            }
            let report = self.simulation.report();
            self.energy[1] += report.load_work + report.constraint_work;
            let energy = report.elastic_energy + report.kinetic_energy;
            self.energy[2] = self.energy[2].max(energy);
            let excess = (energy - self.energy[0] - self.energy[1]) / self.energy[2];
            self.outcome.energy_excess = self.outcome.energy_excess.max(excess);
            self.outcome.finite &= energy.is_finite();
            self.outcome.steps[0] += 1;
            self.outcome.steps[1] += u64::from(report.projections > 0);
        }
    }

    fn finish(mut self) -> Outcome {
        let u = self.simulation.displacements(self.body);
        let x: Vec<DVec3> = u.iter().zip(&self.mesh.points).map(|(u, p)| *u + *p).collect();
        self.outcome.finite &= x.iter().all(|x| x.is_finite());
        let (mut sum, mut count) = (0.0, 0);
        for &[a, b, c] in &self.mesh.triangles {
            for (a, b) in [(a, b), (b, c), (c, a)] {
                let (a, b) = (a as usize, b as usize);
                let change =
                    x[a].distance(x[b]) / self.mesh.points[a].distance(self.mesh.points[b]);
                sum += (change - 1.0).powi(2);
                count += 1;
            }
        }
        self.outcome.edge_error = (sum / f64::from(count.max(1))).sqrt();
        self.outcome.smallest_area_ratio =
            self.simulation.area_ratios(self.body).into_iter().fold(f64::INFINITY, f64::min);
        self.outcome.out_of_plane = x.iter().map(|x| x.z.abs()).fold(0.0, f64::max);
        self.outcome
    }
}

fn damped(options: &SheetOptions, mass_damping: f64) -> SheetOptions {
    let solver = SolverSettings { mass_damping, ..options.solver.clone() };
    SheetOptions { solver, ..options.clone() }
}

/// Failure of a case before its first step.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub enum SheetError {
    /// The mesh cannot be generated.
    Mesh(#[from] MeshError),
    /// The simulation cannot be set up.
    Simulation(#[from] SimulationError),
}

/// A sheet of 0.2 m whose two opposite edges are brought together by `fraction` (0 to 1) of its length
/// in half a second and held for another: it has to leave its plane in wrinkles.
///
/// # Errors
/// When mesh or simulation cannot be set up.
pub fn wrinkle(fraction: f64, options: &SheetOptions) -> Result<Outcome, SheetError> {
    let (size, cells, thickness) = SHEET;
    let mesh = triangle_grid(DVec2::splat(size), [cells; 2])?;
    let mut run = Run::new(mesh, thickness, &damped(options, 2.0))?;
    for (side, sign) in [("x0", 0.5), ("x1", -0.5)] {
        let rows = run.simulation.group_rows(run.body, &run.mesh, side)?;
        let motion = Motion::Translate(DVec3::X * (sign * fraction * size));
        let curve = Curve::ramp(0.0, 0.5);
        run.simulation.add_constraint(Constraint::moving(side, rows, motion, curve));
    }
    let flat = vec![DVec3::ZERO; run.mesh.points.len()];
    run.start(flat, 1e-6 * size)?;
    run.steps((1.0 / options.dt).ceil() as u64);
    Ok(run.finish())
}

/// A free sheet of 0.2 m collapsed to a point or a line, but for noise of 1e-7 of its size, and left to
/// itself.
///
/// # Errors
/// When mesh or simulation cannot be set up.
pub fn collapse(kind: Collapse, options: &SheetOptions) -> Result<Outcome, SheetError> {
    let (size, cells, thickness) = SHEET;
    let mesh = triangle_grid(DVec2::splat(size), [cells; 2])?;
    let centre = DVec3::new(0.5 * size, 0.5 * size, 0.0);
    let start = mesh
        .points
        .iter()
        .map(|p| match kind {
            Collapse::Point => centre - *p,
            Collapse::Line => DVec3::new(0.0, centre.y - p.y, 0.0),
        })
        .collect();
    let mut run = Run::new(mesh, thickness, &damped(options, 4.0))?;
    run.start(start, 1e-7 * size)?;
    run.steps((5.0 / options.dt).ceil() as u64);
    Ok(run.finish())
}

/// Blows up a sphere of `20 cuts^2` triangles to the pressure at which a perfect one has `stretch` times
/// its radius, `p = 2 (lambda + mu) (s^2 - 1)/(R s)`; the relative error of the mean radius.
///
/// # Errors
/// When mesh or simulation cannot be set up, or a step fails.
pub fn inflation_error(stretch: f64, cuts: usize, precision: Precision) -> Result<f64, SheetError> {
    let radius = 0.1;
    let mesh = sphere_triangles(radius, cuts)?;
    let (points, triangles) = (mesh.points.clone(), mesh.triangles.clone());
    let solver = SolverSettings {
        integrator: Integrator::QuasiStatic,
        linear_tolerance: 1e-6,
        newton_tolerance: if precision == Precision::F64 { 1e-9 } else { 1e-6 },
        ..Default::default()
    };
    let options = SheetOptions { solver, precision, dt: 0.125, ..SheetOptions::default() };
    let thickness = SHEET.2;
    let mut run = Run::new(mesh, thickness, &options)?;
    // vertices on the axes may move along them only: the sphere cannot move rigidly, but grow
    for k in 0..3 {
        let axis = DVec3::AXES[k];
        let on = |v: &u32| points[*v as usize].cross(axis).length() < 1e-9 * radius;
        let on: Vec<u32> = (0..points.len() as u32).filter(on).collect();
        let mut hold = Constraint::hold("axis", run.simulation.rows(run.body, "axis", &on)?);
        hold.axes = FixedAxes(7 & !(1 << k));
        run.simulation.add_constraint(hold);
    }
    let YoungPoisson { young_modulus, poisson_ratio, .. } = material();
    let moduli = plane_stress(young_modulus * thickness, poisson_ratio);
    let pressure =
        2.0 * (moduli.lambda + moduli.mu) * (stretch * stretch - 1.0) / (radius * stretch);
    let faces = run.simulation.face_rows(run.body, "air", &triangles)?;
    let curve = Curve::ramp(0.0, 1.0);
    run.simulation.add_pressure(Pressure { name: "air".into(), faces, pressure, curve });
    for _ in 0..8 {
        run.simulation.step().map_err(SimulationError::from)?;
    }
    let u = run.simulation.displacements(run.body);
    let sum: f64 = u.iter().zip(&points).map(|(u, x)| (*u + *x).length()).sum();
    Ok((sum / points.len() as f64 / (stretch * radius) - 1.0).abs())
}
