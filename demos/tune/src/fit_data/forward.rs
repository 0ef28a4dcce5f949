//! Equilibria of a scene at given load factors for given parameters.

use super::error::{DataFitError, Result};
use super::observe::{Observation, Observed};
use super::parameter::{Constant, ElementMaterials, Parameter};
use bevy_ecs::prelude::World;
use glam::DVec3;
use serde::Serialize;
use sinew::engine::load::LoadTime;
use sinew::engine::row::VertexRow;
use sinew::engine::step::StepClock;
use sinew::engine::vertex::FixedAxes;
use sinew::models::axes::muscle::activate_at;
use sinew::models::material::field::MaterialField;
use sinew::solvers::linear_solver::LinearSolver;
use sinew::solvers::state::{NodeState, Rows, evaluate, read_force, read_rest};
use sinew_scene::assemble::BuiltScene;

/// An equilibrium.
#[derive(Clone, Debug)]
pub struct Equilibrium {
    /// Factor on the loads.
    pub load: f64,
    /// Displacements (m) by body, in the user's order.
    pub displacements: Vec<Vec<DVec3>>,
    /// Displacements (m) of all vertex rows.
    pub u: Rows<f64>,
    /// Elastic forces (N) of all vertex rows.
    pub force: Rows<f64>,
    /// External forces (N) of all vertex rows.
    pub external: Rows<f64>,
}

/// Work that was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FitWork {
    /// Sets of parameters for which all equilibria were sought.
    pub evaluations: u64,
    /// Of these, sets for which one was not found.
    pub refused: u64,
    /// Equilibria that were sought.
    pub forward_solves: u64,
    /// Of these, those that did not start from the equilibrium of earlier parameters.
    pub cold_starts: u64,
    /// Newton iterations.
    pub newton_iterations: u64,
    /// Jacobians.
    pub jacobians: u64,
    /// Linear solves for them.
    pub linear_solves: u64,
}

/// A scene whose parameters can be set.
pub struct Forward {
    pub(super) scene: BuiltScene,
    /// Material of the elements of each body.
    pub(super) materials: Vec<ElementMaterials>,
    /// Load factors, ascending, without 0.
    loads: Vec<f64>,
    /// One per load factor, for the parameters set last.
    pub(super) equilibria: Vec<Equilibrium>,
    /// Held axes of the vertex rows.
    pub(super) fixed: Vec<FixedAxes>,
    /// Rest positions (m) of the vertex rows.
    pub(super) rest: Vec<DVec3>,
    pub(super) solver: LinearSolver<f64>,
    pub(super) work: FitWork,
}

impl Forward {
    /// Load factors are those of the observations. Tightens the tolerances of the scene where they
    /// are too loose for derivatives.
    pub fn new(
        mut scene: BuiltScene,
        materials: Vec<ElementMaterials>,
        observed: &[Observation],
    ) -> Self {
        let mut loads: Vec<f64> = observed.iter().map(|o| o.load).filter(|&l| l > 0.0).collect();
        loads.sort_by(f64::total_cmp);
        loads.dedup();
        let mut settings = scene.plan.settings.clone();
        settings.linear_tolerance = settings.linear_tolerance.min(LINEAR_TOLERANCE);
        settings.newton_tolerance = settings.newton_tolerance.min(NEWTON_TOLERANCE);
        scene.simulation.set_solver(settings);
        let mut rest = Vec::new();
        read_rest(scene.simulation.world_mut(), &mut rest);
        let (equilibria, fixed, work) = (Vec::new(), Vec::new(), FitWork::default());
        let solver = LinearSolver::default();
        Self { scene, materials, loads, equilibria, fixed, rest, solver, work }
    }

    /// Gives the elements of the bodies in question the materials in `materials`.
    pub(super) fn apply(
        &mut self,
        materials: &[ElementMaterials],
        parameters: &[Parameter],
    ) -> Result<()> {
        for (i, material) in materials.iter().enumerate() {
            if !parameters.iter().any(|p| p.body == i) {
                continue;
            }
            let field = MaterialField {
                material: material.base,
                young_modulus: Some(&material.young),
                poisson_ratio: Some(&material.poisson),
                density: Some(&material.density),
                filled: None,
            };
            let handle = self.scene.bodies[i].handle;
            if parameters.iter().any(|p| p.body == i && p.constant != Constant::Axis) {
                self.scene.simulation.set_material(handle, field)?;
            }
            for p in parameters.iter().filter(|p| p.body == i && p.constant == Constant::Axis) {
                let (family, modulus) = &material.axes[p.family];
                self.scene.simulation.set_axis_modulus(handle, family, *modulus)?;
            }
        }
        Ok(())
    }

    /// Finds the equilibria for other parameters. On an error those of the earlier ones stay.
    ///
    /// # Errors
    /// [`DataFitError::NoEquilibrium`], or what the engine refuses.
    pub fn solve(&mut self, parameters: &[Parameter], values: &[f64]) -> Result<()> {
        let mut materials = self.materials.clone();
        for (parameter, &value) in parameters.iter().zip(values) {
            materials[parameter.body].set(parameter, value);
        }
        self.apply(&materials, parameters)?;
        self.work.evaluations += 1;
        let mut found: Vec<Equilibrium> = Vec::with_capacity(self.loads.len());
        for i in 0..self.loads.len() {
            match self.equilibrium(i, found.last()) {
                Ok(equilibrium) => found.push(equilibrium),
                Err(reason) => {
                    self.work.refused += 1;
                    let materials = std::mem::take(&mut self.materials);
                    let restored = self.apply(&materials, parameters);
                    self.materials = materials;
                    restored?;
                    return Err(DataFitError::NoEquilibrium {
                        load: self.loads[i],
                        parameters: described(parameters, values),
                        reason,
                    });
                }
            }
        }
        (self.materials, self.equilibria) = (materials, found);
        Ok(())
    }

    /// The equilibrium at a load factor: from that of earlier parameters, or, without one or when that
    /// fails, from the one at the load factor before.
    fn equilibrium(
        &mut self,
        index: usize,
        before: Option<&Equilibrium>,
    ) -> Result<Equilibrium, String> {
        let load = self.loads[index];
        self.work.forward_solves += 1;
        if let Some(earlier) = self.equilibria.get(index) {
            let displacements = earlier.displacements.clone();
            if let Ok(found) = self.step(&displacements, 0.0, load) {
                return Ok(found);
            }
        }
        self.work.cold_starts += 1;
        let (mut at, mut displacements) = match before {
            Some(before) => (before.load, before.displacements.clone()),
            None => {
                let rest =
                    |b: &sinew_scene::assemble::BuiltBody| vec![DVec3::ZERO; b.mesh.points.len()];
                (0.0, self.scene.bodies.iter().map(rest).collect())
            }
        };
        let parts = ((load - at) * self.scene.plan.steps as f64 - 1e-9).ceil().max(1.0);
        let (start, size) = (at, (load - at) / parts);
        let mut part = 0.0;
        loop {
            part += 1.0;
            let next = if part >= parts { load } else { start + part * size };
            let found = self.step(&displacements, at, next)?;
            if part >= parts {
                return Ok(found);
            }
            (at, displacements) = (next, found.displacements);
        }
    }

    /// One load step from given displacements, from one load factor to another.
    fn step(
        &mut self,
        displacements: &[Vec<DVec3>],
        from: f64,
        to: f64,
    ) -> Result<Equilibrium, String> {
        let simulation = &mut self.scene.simulation;
        for (body, u) in self.scene.bodies.iter().zip(displacements) {
            let rest = vec![DVec3::ZERO; u.len()];
            simulation.set_state(body.handle, u, &rest).map_err(|e| e.to_string())?;
        }
        simulation.set_gravity(self.scene.plan.gravity * to);
        let mut clock = simulation.world_mut().resource_mut::<StepClock>();
        (clock.time, clock.dt) = (from, to - from);
        simulation.step().map_err(|e| e.to_string())?;
        let report = simulation.report();
        self.work.newton_iterations += u64::from(report.newton_iterations);
        if report.unconverged {
            return Err(format!(
                "Newton did not converge in {} iterations (last step {:.1e} of the body size)",
                report.newton_iterations, report.newton_step
            ));
        }
        let displacements =
            self.scene.bodies.iter().map(|b| simulation.displacements(b.handle)).collect();
        let world = simulation.world_mut();
        let mut node = NodeState::<f64>::default();
        node.read(world);
        at_load(world, to);
        evaluate(world, &node.u, false, true, None);
        let mut force = Rows::default();
        read_force(world, &mut force);
        self.fixed = node.fixed;
        Ok(Equilibrium { load: to, displacements, u: node.u, force, external: node.external })
    }

    /// Elastic forces (N) of all rows at equilibrium number `index` in the material that is set.
    pub(super) fn force_at(&mut self, index: usize) -> Rows<f64> {
        let world = self.scene.simulation.world_mut();
        at_load(world, self.equilibria[index].load);
        evaluate(world, &self.equilibria[index].u, false, true, None);
        let mut force = Rows::default();
        read_force(world, &mut force);
        force
    }

    /// Index of the equilibrium at a load factor, `None` at rest.
    pub(super) fn index_of(&self, load: f64) -> Option<usize> {
        self.loads.iter().position(|&l| l == load)
    }

    /// What the observations should be at the equilibria found last (m, N).
    pub fn predictions(&self, observed: &[Observation]) -> Vec<f64> {
        let predict = |o: &Observation| {
            let Some(index) = self.index_of(o.load) else { return 0.0 };
            let at = &self.equilibria[index];
            match o.measured {
                Observed::Displacement { body, vertex, axis } => {
                    at.displacements[body][vertex as usize][axis]
                }
                Observed::Reaction { constraint, axis } => {
                    let held = self.rows(constraint);
                    -held.map(|r| at.force[r][axis] + at.external[r][axis]).sum::<f64>()
                }
            }
        };
        observed.iter().map(predict).collect()
    }

    /// Vertex rows of a constraint.
    pub(super) fn rows(&self, constraint: usize) -> impl Iterator<Item = usize> + '_ {
        let constraint = &self.scene.constraints[constraint];
        let body = self.scene.bodies[constraint.body].handle;
        let rows = &self.scene.simulation.topology().bodies[body.0];
        constraint.vertices.iter().filter_map(|&v| rows.row(v)).map(VertexRow::index)
    }
}

/// Gives pressures and muscles the time of a load factor, for evaluations outside of steps.
pub(super) fn at_load(world: &mut World, load: f64) {
    world.insert_resource(LoadTime(load));
    activate_at::<f64>(world, load);
}

/// Relative residual of linear systems on the way to an equilibrium.
const LINEAR_TOLERANCE: f64 = 1e-6;
/// Last Newton step over the size of the body: the error left is about the product of both.
const NEWTON_TOLERANCE: f64 = 1e-9;

/// Parameters in words.
pub(super) fn described(parameters: &[Parameter], values: &[f64]) -> String {
    let all = parameters.iter().zip(values);
    all.map(|(p, v)| format!("{} = {v:.6e}", p.name)).collect::<Vec<_>>().join(", ")
}
