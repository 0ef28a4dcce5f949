//! What the scenes of the figures share: a body in a world of its own, settings of equilibria, and ways to them.

use super::prelude::*;
use crate::axes::PrintedDescription;
use crate::axes::law::IN_TETRAHEDRA;
use crate::axes::springs::VolumeForm;
use sinew::models::axes::description::AxesDescription;
use sinew::models::body::MassRule;
use sinew::models::body::lumped::{HexahedronSprings, SpringRule, UniformSprings};

/// A body in a world of its own, without gravity, on one thread.
pub(crate) fn world(
    body: &BodyDescription,
    solver: SolverSettings,
) -> Result<(Simulation, BodyHandle)> {
    let options = SimulationOptions { threads: 1, ..SimulationOptions::default() };
    let mut simulation = Simulation::new(options)?;
    let body = simulation.add_body(body)?;
    simulation.set_gravity(DVec3::ZERO);
    simulation.set_solver(solver);
    Ok((simulation, body))
}

/// Holds a side of the mesh for good, along all axes.
pub(crate) fn clamp(
    simulation: &mut Simulation,
    body: BodyHandle,
    mesh: &Mesh,
    side: &str,
) -> Result<()> {
    let rows = simulation.group_rows(body, mesh, side)?;
    simulation.add_constraint(Constraint::hold(side, rows));
    Ok(())
}

/// Settings for an equilibrium.
pub(crate) fn equilibrium() -> SolverSettings {
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
pub(crate) fn settle(simulation: &mut Simulation, parts: u32, case: &str) -> Result<()> {
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

/// Settings of Bourguignon & Cani 2000, section 5: Störmer's method, with mass damping (1/s) where motion is to stop.
pub(crate) fn stormer(mass_damping: f64) -> SolverSettings {
    SolverSettings {
        integrator: Integrator::StormerVerlet,
        mass_damping,
        ..SolverSettings::default()
    }
}

/// Axes of an isotropic material along x, y and z with dampers (Pa s) along all of them.
pub(crate) fn damped_axes(
    material: YoungPoisson,
    viscosity: f64,
) -> Result<AxesDescription<'static>> {
    let mut axes = AxesDescription::isotropic(material.lame()?);
    axes.families.iter_mut().for_each(|family| family.viscosity = viscosity);
    Ok(axes)
}

/// A body of nothing but axes in a world of its own: printed ones with volume springs of a form, or axes with an energy.
/// Radial springs of hexahedra have the dampers of the first family.
pub(crate) fn world_of_axes(
    body: BodyDescription,
    axes: AxesDescription,
    form: Option<VolumeForm>,
    solver: SolverSettings,
) -> Result<(Simulation, BodyHandle)> {
    let Some(form) = form else {
        return world(&BodyDescription { model: Model::Axes, axes: Some(axes), ..body }, solver);
    };
    let body = BodyDescription { model: Model::Own(&IN_TETRAHEDRA), ..body };
    let radial = !body.hexahedra.is_empty() && axes.volume_modulus > 0.0;
    let volume_viscosity = if radial { axes.families[0].viscosity } else { 0.0 };
    let (mut simulation, handle) = world(&body, solver)?;
    let printed = PrintedDescription { axes, form, volume_viscosity };
    printed.add(&mut simulation, handle).map_err(|e| BenchError::Request {
        what: format!("printed axes: {e}"),
        remedy: "this is a defect of the figure, report it".into(),
    })?;
    Ok((simulation, handle))
}

/// Plain springs of one constant (N/m), 16 in a hexahedron, as in that paper.
pub(crate) fn uniform(constant: f64) -> Option<SpringRule> {
    let hexahedron = HexahedronSprings::EdgesAndDiagonals;
    Some(SpringRule::Uniform(UniformSprings { constant, hexahedron }))
}

/// Constant (N/m) of plain springs with which a body yields as much as its material when it is held at a side and
/// bears a thousandth of its weight: the load does the same work. Its masses are equal.
///
/// # Errors
/// When there is no equilibrium.
pub(crate) fn as_stiff(mesh: &Mesh, material: YoungPoisson, held: &str) -> Result<f64> {
    let gravity = DVec3::new(0.0, 0.0, -9.81e-3);
    let work = |model, springs| -> Result<f64> {
        let body = BodyDescription::new("block", mesh, material);
        let body = BodyDescription { model, springs, masses: MassRule::Equal, ..body };
        let (mut simulation, body) = world(&body, equilibrium())?;
        clamp(&mut simulation, body, mesh, held)?;
        simulation.set_gravity(gravity);
        settle(&mut simulation, 1, "a thousandth of the weight")?;
        let (u, masses) = (simulation.displacements(body), simulation.masses(body));
        Ok(u.iter().zip(&masses).map(|(u, m)| m * u.dot(gravity)).sum())
    };
    // displacements are inverse to the constant
    let trial = material.young_modulus * 0.01;
    Ok(trial * work(Model::MassSpring, uniform(trial))? / work(Model::Linear, None)?)
}

/// A part of the way from one strain to the next.
pub(crate) struct Stride {
    pub before: f64,
    pub strain: f64,
    /// Number of the part, from 1, and how many there are.
    pub part: u32,
    pub parts: u32,
}

/// Equilibria at growing strains, each reached from the one before in parts of at most `stride` by motions of
/// some vertex rows; `None` from where there is none.
pub(crate) fn path<T>(
    simulation: &mut Simulation,
    rows: &[VertexRow],
    strains: &[f64],
    stride: f64,
    motion: impl Fn(Stride) -> Motion,
    state: impl Fn(&mut Simulation) -> T,
) -> Vec<Option<T>> {
    let mut states: Vec<Option<T>> = Vec::new();
    let mut before = 0.0;
    for &strain in strains {
        let parts = ((strain - before) / stride - 1e-9).ceil().max(1.0) as u32;
        let mut found = states.last().is_none_or(Option::is_some);
        for part in 1..=parts {
            if !found {
                break;
            }
            let motion = motion(Stride { before, strain, part, parts });
            let moved = Constraint::moving("moved", rows.to_vec(), motion, Curve::Constant);
            let moved = simulation.add_constraint(moved);
            found = simulation.step().is_ok() && !simulation.report().unconverged;
            simulation.world_mut().despawn(moved);
        }
        states.push(found.then(|| state(simulation)));
        before = strain;
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;
    use sinew::engine::mesh::generate::box_hexahedra;

    #[test]
    fn springs_of_the_constant_found_yield_as_the_material() {
        let material = YoungPoisson { young_modulus: 1e4, poisson_ratio: 0.3, density: 1000.0 };
        let mesh = box_hexahedra(DVec3::new(0.2, 0.1, 0.1), [4, 2, 2]).unwrap();
        let found = as_stiff(&mesh, material, "x0").unwrap();
        // the modulus scales it, and a grid of cubes has E a for its edges within a factor of two
        let stiffer = YoungPoisson { young_modulus: 3e4, ..material };
        let more = as_stiff(&mesh, stiffer, "x0").unwrap();
        assert!((more / found / 3.0 - 1.0).abs() < 1e-3, "{more} {found}");
        assert!((0.25..1.0).contains(&(found / (1e4 * 0.05))), "{found}");
    }
}
