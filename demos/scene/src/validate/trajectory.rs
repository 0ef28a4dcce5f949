//! Trajectories of an independent program: implicit Euler steps solved to convergence, and the motion
//! converged in time.

use super::body::{CaseBody, CaseCells, CaseLaw, CaseMaterial};
use super::compare::worst;
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, Rows, Status, TRAJECTORY_TOLERANCE, ValidationRow};
use glam::DVec3;
use sinew::engine::mesh::Mesh;
use sinew::models::body::VolumeRule;
use sinew::models::body::sheet::MembraneModel;
use sinew::prelude::*;
use sinew::simulation::SimulationError;
use std::time::Instant;

const KEYS: &str = "E damping elements fine fixed_vertices gravity h hexahedra implicit_euler \
    initial_elastic_energy initial_positions initial_total_force initial_velocities kind \
    masses model name nu quads rho tetrahedra thickness triangles vertices";

/// Rest positions and elements.
fn read_mesh(root: &CaseEntry) -> Result<Mesh, CaseError> {
    let mut mesh = Mesh { points: root.get("vertices").vectors()?, ..Default::default() };
    let kind = root.get("elements");
    match kind.clone().given().map_or(Ok("tetrahedra"), |kind| kind.text())? {
        "tetrahedra" => mesh.tetrahedra = root.get("tetrahedra").cells()?,
        "hexahedra" => mesh.hexahedra = root.get("hexahedra").cells()?,
        "triangles" => mesh.triangles = root.get("triangles").cells()?,
        "quads" => mesh.quads = root.get("quads").cells()?,
        _ => return Err(kind.error("tetrahedra, hexahedra, triangles or quads")),
    }
    Ok(mesh)
}

/// The law that `model` describes: a name of a law, or words that begin with the name of a material.
fn law(model: &CaseEntry, cells: CaseCells) -> Result<CaseLaw, CaseError> {
    let words = model.text()?;
    let membrane = matches!(cells, CaseCells::Triangles(_) | CaseCells::Quads(_));
    if words.starts_with("TRBS") && membrane {
        Ok(CaseLaw::Membrane(MembraneModel::Biquadratic))
    } else if words.starts_with("StVK") && !membrane {
        let compression = words.contains("+ compression");
        let model = if compression { Model::CompressibleStVK } else { Model::StVK };
        Ok(CaseLaw::Solid(model, VolumeRule::Elements))
    } else {
        CaseLaw::find(words, cells.kind())
    }
}

/// A trajectory with its body.
struct Trajectory<'a> {
    case: &'a ReferenceCase<'a>,
    body: CaseBody<'a>,
    start_u: Vec<DVec3>,
    start_v: Vec<DVec3>,
    fixed: Vec<u32>,
    gravity: DVec3,
    /// Step (s).
    h: f64,
}

pub(super) fn run(case: &ReferenceCase) -> Rows {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    let mesh = read_mesh(&root)?;
    let n = mesh.points.len();
    let cells = CaseCells::of(&mesh)
        .ok_or_else(|| root.get("elements").error("a kind of which there are some"))?;
    let law = law(&root.get("model"), cells)?;
    let thickness = match law {
        CaseLaw::Membrane(_) => root.get("thickness").number()?,
        CaseLaw::Solid(..) => 0.0,
    };
    let material = CaseMaterial::read(&root, cells.len())?;
    if let Some(damping) = root.get("damping").given().filter(|d| d.number().ok() != Some(0.0)) {
        return Err(damping.error("0: trajectories with damping are not run"));
    }
    let mut start_u = root.get("initial_positions").field(n)?;
    start_u.iter_mut().zip(&mesh.points).for_each(|(x, rest)| *x -= *rest);
    let trajectory = Trajectory {
        case,
        body: CaseBody { thickness, ..CaseBody::new(&mesh.points, cells, law, &material) },
        start_u,
        start_v: root.get("initial_velocities").field(n)?,
        fixed: root.get("fixed_vertices").indices()?,
        gravity: root.get("gravity").vector()?,
        h: root.get("h").number()?,
    };
    let mut rows = Vec::new();
    for (integrator, label) in
        [(Integrator::Newton, "implicit Euler"), (Integrator::Safe, "safe step")]
    {
        let law = format!("{}, {label}", law.name());
        let mut row = ValidationRow::new(&case.name(), &law, n, cells.len());
        let outcome = trajectory.run(integrator, &mut row);
        rows.push(row.ended(outcome));
    }
    Ok(rows)
}

impl Trajectory<'_> {
    fn run(&self, integrator: Integrator, row: &mut ValidationRow) -> Result<(), CaseError> {
        let root = self.case.root();
        let failed = |error: SimulationError| self.case.simulation_error(error);
        let (mut simulation, body) = self.prepare(integrator)?;
        let at_start = self.compare_start(&mut simulation, body)?;
        let size = simulation.topology().bodies[body.0].size;
        let mut converged = true;
        let mut step = 0;
        let start = Instant::now();
        (row.max_difference, row.rms_difference, row.energy_difference) = (0.0, 0.0, 0.0);
        let mut u_at = Vec::new();
        let states = root.get("implicit_euler").get("states");
        for state in states.list()? {
            let target = state.get("step").index()?;
            while step < target {
                simulation.step().map_err(|e| failed(e.into()))?;
                let report = simulation.report();
                row.newton_iterations += u64::from(report.newton_iterations);
                row.cg_iterations += u64::from(report.cg_iterations);
                converged &= !report.unconverged;
                step += 1;
            }
            let u = simulation.displacements(body);
            let truth = self.displacements(&state.get("positions"))?;
            row.worst_over(&u, &truth, size);
            let expected = state.get("elastic_energy").number()?;
            let energy = simulation.evaluate();
            row.energy_difference =
                worst(row.energy_difference, (energy - expected).abs() / expected.abs());
            u_at.push((f64::from(step) * self.h, u));
        }
        row.seconds = start.elapsed().as_secs_f64();
        if u_at.is_empty() {
            return Err(states.error("at least one state"));
        }
        self.time_error(&u_at, size, row)?;
        if integrator != Integrator::Newton {
            let why = "one linearised step: shown for its distance, no criterion";
            return Err(CaseError::NotRun(why.into()));
        }
        let tolerance = self.case.options.tolerance.unwrap_or(TRAJECTORY_TOLERANCE);
        if let Some(remark) = at_start {
            row.remark(remark);
        } else if converged && row.max_difference <= tolerance {
            row.status = Status::Pass;
        }
        Ok(())
    }

    /// The body in its first state.
    fn prepare(&self, integrator: Integrator) -> Result<(Simulation, BodyHandle), CaseError> {
        let failed = |error: SimulationError| self.case.simulation_error(error);
        let (mut simulation, body) = self.body.simulation(self.case)?;
        simulation.set_state(body, &self.start_u, &self.start_v).map_err(failed)?;
        // vertices without an element are not part of the body
        let rows = &simulation.topology().bodies[body.0];
        let of_body = |&v: &u32| v as usize >= self.body.points.len() || rows.row(v).is_some();
        let used: Vec<u32> = self.fixed.iter().copied().filter(of_body).collect();
        let held = simulation.rows(body, "fixed", &used).map_err(failed)?;
        simulation.add_constraint(Constraint::hold("fixed", held));
        simulation.set_gravity(self.gravity);
        simulation.set_dt(self.h);
        simulation.set_solver(SolverSettings {
            integrator,
            linear_tolerance: 1e-9,
            newton_tolerance: 1e-12,
            ..Default::default()
        });
        Ok((simulation, body))
    }

    /// What differs at the start, which no step could mend: masses and elastic energy, where given.
    fn compare_start(
        &self,
        simulation: &mut Simulation,
        body: BodyHandle,
    ) -> Result<Option<String>, CaseError> {
        let root = self.case.root();
        if let Some(masses) = root.get("masses").given() {
            let truth = masses.list_of(self.body.points.len())?;
            for (i, (mass, truth)) in simulation.masses(body).into_iter().zip(truth).enumerate() {
                let truth = truth.number()?;
                if mass > 0.0 && (mass - truth).abs() > 1e-10 * truth {
                    return Ok(Some(format!("mass of vertex {i} is {mass} kg, not {truth}")));
                }
            }
        }
        if let Some(energy) = root.get("initial_elastic_energy").given() {
            let (found, truth) = (simulation.evaluate(), energy.number()?);
            if (found - truth).abs() > 1e-11 * truth.max(1e-9) {
                return Ok(Some(format!("elastic energy at the start is {found} J, not {truth}")));
            }
        }
        Ok(None)
    }

    /// Displacements (m) of a list of positions.
    fn displacements(&self, positions: &CaseEntry) -> Result<Vec<DVec3>, CaseError> {
        let mut u = positions.field(self.body.points.len())?;
        u.iter_mut().zip(self.body.points).for_each(|(x, rest)| *x -= *rest);
        Ok(u)
    }

    /// Error of the time integration: against the trajectory converged in time, at its last time that has a
    /// state.
    fn time_error(
        &self,
        u_at: &[(f64, Vec<DVec3>)],
        size: f64,
        row: &mut ValidationRow,
    ) -> Result<(), CaseError> {
        let Some(fine) = self.case.root().get("fine").given() else { return Ok(()) };
        for (i, time) in fine.get("times").numbers()?.into_iter().enumerate() {
            let same = |(t, _): &&(f64, Vec<DVec3>)| (t - time).abs() < 1e-6 * self.h;
            let Some((_, u)) = u_at.iter().find(same) else { continue };
            let truth = self.displacements(&fine.get("positions").at(i))?;
            let scale = fine.get("length_scale_of_uncertainty").given();
            let scale = scale.map_or(Ok(size), |scale| scale.number())?;
            row.beside_continuum(u, &truth, scale);
            row.note = "continuum columns: time error at the last common time".into();
        }
        Ok(())
    }
}
