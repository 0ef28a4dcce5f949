//! Derivatives of observations by parameters.
//!
//! At an equilibrium the free unknowns satisfy `f(u, p) + f_ext = 0`, with the elastic forces `f`. By
//! the implicit function theorem
//!
//! ```text
//! K du/dp = df/dp,   K = -df/du   (free unknowns; held ones do not move)
//! ```
//!
//! with the exact tangent `K` and `df/dp` at fixed displacements. Forces are proportional to Young's
//! moduli and to those of axes, and linear in `lambda` and `mu`, so that `df/dp` is a combination of forces in two or three
//! materials, without the error of a difference. A reaction `R = -sum (f + f_ext)` over held unknowns
//! changes by `dR/dp = -sum (df/dp - K du/dp)`.
//!
//! *Direct*: one linear solve per parameter. *Adjoint*: one per observation, `K w = g` with the
//! derivative `g` of the observation by the free unknowns, and then `w . df/dp`. At each load factor
//! whichever takes fewer solves.

use super::error::{DataFitError, Result};
use super::forward::{Forward, at_load};
use super::observe::{Observation, Observed};
use super::parameter::{Constant, ElementMaterials, Parameter};
use nalgebra::DMatrix;
use serde::Serialize;
use sinew::engine::law::TangentKind;
use sinew::engine::matrix::{ProductSpans, Tangent};
use sinew::engine::row::VertexRow;
use sinew::engine::topology::Topology;
use sinew::engine::workers::Workers;
use sinew::models::body::Model;
use sinew::models::material::{LameParameters, MAX_POISSON_RATIO, YoungPoisson};
use sinew::solvers::cg::CgStatus;
use sinew::solvers::settings::LinearOptions;
use sinew::solvers::state::{Rows, dot3, evaluate};
use sinew::solvers::system::ShiftedTangent;

/// How derivatives are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Gradient {
    /// Implicit function theorem, a linear solve per parameter at every load factor.
    #[default]
    Direct,
    /// Implicit function theorem, a linear solve per observation.
    Adjoint,
    /// Either of these, by load factor.
    Mixed,
    /// Central differences of equilibria: where the tangent is not the derivative of the force.
    Differences,
}

/// Relative residual of the linear systems.
const TOLERANCE: f64 = 1e-11;
/// Residual that is still good enough when rounding leaves no more.
const ENOUGH: f64 = 1e-8;
/// Change of an unknown in central differences of equilibria.
const DIFFERENCE: f64 = 1e-4;

impl Forward {
    /// Why the tangent is not the derivative of the forces, if it is not.
    pub fn without_tangent(&self) -> Option<&'static str> {
        let free_rim = self.scene.warnings.iter().any(|w| w.code == "scene.pressure.rim");
        free_rim.then_some("a pressure with a free rim has no symmetric tangent")
    }

    /// Derivatives of the observations (rows; m or N) by the parameters (columns; per Pa or per 1) at the
    /// equilibria found last, and how they were found.
    ///
    /// # Errors
    /// [`DataFitError::Unstable`], or what the engine refuses.
    pub fn jacobian(
        &mut self,
        parameters: &[Parameter],
        values: &[f64],
        observed: &[Observation],
    ) -> Result<(DMatrix<f64>, Gradient)> {
        self.work.jacobians += 1;
        if self.without_tangent().is_some() {
            let jacobian = self.differences(parameters, values, observed)?;
            return Ok((jacobian, Gradient::Differences));
        }
        let changes = self.force_changes(parameters)?;
        let mut jacobian = DMatrix::zeros(observed.len(), parameters.len());
        let (mut direct, mut adjoint) = (false, false);
        for index in 0..self.equilibria.len() {
            let load = self.equilibria[index].load;
            let own: Vec<usize> = (0..observed.len())
                .filter(|&i| self.index_of(observed[i].load) == Some(index))
                .collect();
            // observations of the same thing share a solve
            let mut measured: Vec<Observed> = Vec::new();
            for &i in &own {
                if !measured.contains(&observed[i].measured) {
                    measured.push(observed[i].measured);
                    if measured.len() > parameters.len() {
                        break;
                    }
                }
            }
            let by_observation = measured.len() < parameters.len();
            *(if by_observation { &mut adjoint } else { &mut direct }) = true;
            self.tangent_at(index);
            let columns: Vec<Vec<f64>> = if by_observation {
                let weights = measured
                    .iter()
                    .map(|&m| self.solve_tangent(load, self.body_of(m), &self.selector(m)))
                    .collect::<Result<Vec<_>, _>>()?;
                let column = |change: &Vec<Rows<f64>>| {
                    let value = |i: &usize| {
                        let m = observed[*i].measured;
                        let at = measured.iter().position(|&other| other == m).unwrap_or(0);
                        let moved = weights[at].iter().zip(&change[index]);
                        moved.map(|(w, f)| dot3(w, f)).sum::<f64>()
                            - self.held_sum(m, &change[index])
                    };
                    own.iter().map(value).collect()
                };
                changes.iter().map(column).collect()
            } else {
                let mut columns = Vec::with_capacity(parameters.len());
                for (parameter, change) in parameters.iter().zip(&changes) {
                    let du = self.solve_tangent(load, parameter.body, &change[index])?;
                    let mut moved = self.tangent_times(&du);
                    for (moved, f) in moved.iter_mut().zip(&change[index]) {
                        (0..3).for_each(|k| moved[k] = f[k] - moved[k]);
                    }
                    let value = |i: &usize| match observed[*i].measured {
                        Observed::Displacement { body, vertex, axis } => {
                            self.row(body, vertex).map_or(0.0, |row| du[row][axis])
                        }
                        m => -self.held_sum(m, &moved),
                    };
                    columns.push(own.iter().map(value).collect());
                }
                columns
            };
            for (column, of) in columns.iter().enumerate() {
                for (value, &i) in of.iter().zip(&own) {
                    jacobian[(i, column)] = *value;
                }
            }
        }
        let gradient = match (direct, adjoint) {
            (_, false) => Gradient::Direct,
            (false, true) => Gradient::Adjoint,
            (true, true) => Gradient::Mixed,
        };
        Ok((jacobian, gradient))
    }

    /// The same from equilibria for parameters a little to either side.
    ///
    /// # Errors
    /// What [`Forward::solve`] finds.
    pub fn differences(
        &mut self,
        parameters: &[Parameter],
        values: &[f64],
        observed: &[Observation],
    ) -> Result<DMatrix<f64>> {
        let mut jacobian = DMatrix::zeros(observed.len(), parameters.len());
        for (column, parameter) in parameters.iter().enumerate() {
            let room = match parameter.constant.is_modulus() {
                true => values[column],
                false => (MAX_POISSON_RATIO - values[column]).min(values[column] + 1.0),
            };
            let h = DIFFERENCE * room;
            let mut ends = Vec::with_capacity(2);
            for side in [h, -h] {
                let mut moved = values.to_vec();
                moved[column] += side;
                self.solve(parameters, &moved)?;
                ends.push(self.predictions(observed));
            }
            for (i, (a, b)) in ends[0].iter().zip(&ends[1]).enumerate() {
                jacobian[(i, column)] = (a - b) / (2.0 * h);
            }
        }
        self.solve(parameters, values)?;
        Ok(jacobian)
    }

    /// `df/dp` (N per Pa or per 1) of every parameter at every equilibrium, at fixed displacements.
    fn force_changes(&mut self, parameters: &[Parameter]) -> Result<Vec<Vec<Rows<f64>>>> {
        let mut changes = Vec::with_capacity(parameters.len());
        for parameter in parameters {
            // whatever an earlier parameter of the body has changed is set back with it
            let same = |p: &&Parameter| p.body == parameter.body;
            let of_body: Vec<Parameter> = parameters.iter().filter(same).cloned().collect();
            let mut sum = vec![vec![[0.0; 4]; self.fixed.len()]; self.equilibria.len()];
            for (factor, changed) in self.combination(parameter) {
                let mut materials = self.materials.clone();
                materials[parameter.body] = changed;
                self.apply(&materials, &of_body)?;
                for (index, sum) in sum.iter_mut().enumerate() {
                    let force = self.force_at(index);
                    let base = &self.equilibria[index].force;
                    for ((sum, f), f0) in sum.iter_mut().zip(&force).zip(base) {
                        (0..3).for_each(|k| sum[k] += factor * (f[k] - f0[k]));
                    }
                }
            }
            let rows = self.body_rows(parameter.body);
            for sum in &mut sum {
                for (row, x) in sum.iter_mut().enumerate() {
                    if !rows.contains(&row) {
                        *x = [0.0; 4];
                    }
                }
            }
            changes.push(sum);
        }
        let materials = std::mem::take(&mut self.materials);
        let restored = self.apply(&materials, parameters);
        self.materials = materials;
        restored?;
        Ok(changes)
    }

    /// Other materials of the body of a parameter, and factors, such that `df/dp` is the sum of factors times
    /// the force in that material less the force in the present one.
    fn combination(&self, parameter: &Parameter) -> Vec<(f64, ElementMaterials)> {
        let own = &self.materials[parameter.body];
        let at = |e: usize| YoungPoisson {
            young_modulus: own.young[e],
            poisson_ratio: own.poisson[e],
            density: own.density[e],
        };
        let with = |change: &dyn Fn(YoungPoisson) -> YoungPoisson| -> ElementMaterials {
            let mut other = own.clone();
            for e in parameter.elements.iter().map(|&e| e as usize) {
                let material = change(at(e));
                other.young[e] = material.young_modulus;
                other.poisson[e] = material.poisson_ratio;
            }
            other
        };
        let first = at(parameter.elements[0] as usize);
        match parameter.constant {
            // so is the force of axes to their modulus
            Constant::Axis => {
                let mut twice = own.clone();
                let (_, modulus) = &mut twice.axes[parameter.family];
                let factor = 1.0 / *modulus;
                *modulus *= 2.0;
                vec![(factor, twice)]
            }
            // f is proportional to E: f(2E) - f(E) = E df/dE
            Constant::Young => {
                let twice = with(&|m| YoungPoisson { young_modulus: 2.0 * m.young_modulus, ..m });
                // all have the modulus that is fitted
                vec![(1.0 / first.young_modulus, twice)]
            }
            Constant::Poisson if self.scene.bodies[parameter.body].model == Model::MassSpring => {
                // constants of springs are no linear function: fourth order, at fixed displacements
                let nu = first.poisson_ratio;
                let h = 1e-3 * (MAX_POISSON_RATIO - nu).min(nu + 1.0);
                [(8.0, 1.0), (-8.0, -1.0), (-1.0, 2.0), (1.0, -2.0)]
                    .into_iter()
                    .map(|(weight, steps)| {
                        let moved = with(&|m| YoungPoisson {
                            poisson_ratio: m.poisson_ratio + steps * h,
                            ..m
                        });
                        (weight / (12.0 * h), moved)
                    })
                    .collect()
            }
            // f = lambda A + mu B. With the derivative of (lambda, mu) by nu as a (lambda, mu) + b (lambda',
            // mu') of the same element with another nu', the forces F and F' of these elements alone give
            // df/dnu = a F + b F' = (a + b) (f(2E) - f(E)) + b (f(nu') - f(nu))
            Constant::Poisson => {
                let nu = first.poisson_ratio;
                let other = if nu < 0.2 { 0.4 } else { 0.0 };
                let (a, b) = split(nu, other);
                let twice = with(&|m| YoungPoisson { young_modulus: 2.0 * m.young_modulus, ..m });
                let changed = with(&|m| YoungPoisson { poisson_ratio: other, ..m });
                vec![(a + b, twice), (b, changed)]
            }
        }
    }

    /// Evaluates the exact tangent at an equilibrium.
    fn tangent_at(&mut self, index: usize) {
        let world = self.scene.simulation.world_mut();
        at_load(world, self.equilibria[index].load);
        evaluate(world, &self.equilibria[index].u, false, false, Some(TangentKind::Exact));
    }

    /// `x` with `K x = b` on the free unknowns of a body, zero elsewhere; held entries of `b` are ignored.
    fn solve_tangent(&mut self, load: f64, body: usize, b: &Rows<f64>) -> Result<Rows<f64>> {
        self.work.linear_solves += 1;
        let mut solver = std::mem::take(&mut self.solver);
        let world = self.scene.simulation.world();
        let zero_mass = vec![0.0; b.len()];
        let system = ShiftedTangent {
            topology: world.resource::<Topology>(),
            workers: world.resource::<Workers>(),
            mass: &zero_mass,
            mass_factor: 0.0,
            tangent: &world.resource::<Tangent<f64>>().matrix,
            low_rank: &world.resource::<Tangent<f64>>().low_rank,
            tangent_factor: 1.0,
            damping: None,
            fixed: &self.fixed,
            contact: None,
        };
        let options = LinearOptions {
            tolerance: TOLERANCE,
            max_iterations: 50_000,
            ..LinearOptions::default()
        };
        let rows = self.body_rows(body);
        let mut load_rows: Rows<f64> = b[rows.clone()].to_vec();
        for (x, fixed) in load_rows.iter_mut().zip(&self.fixed[rows.clone()]) {
            (0..3).filter(|&k| fixed.holds(k)).for_each(|k| x[k] = 0.0);
        }
        let mut own = vec![[0.0; 4]; rows.len()];
        let handle = self.scene.bodies[body].handle.0;
        let outcome =
            solver.solve(&system, &self.rest, handle..handle + 1, &load_rows, &mut own, &options);
        self.solver = solver;
        match outcome.status {
            CgStatus::Converged => {}
            CgStatus::Cap if outcome.residual <= ENOUGH => {}
            CgStatus::Indefinite => {
                return Err(DataFitError::Unstable { load, found: "has a negative eigenvalue" });
            }
            _ => return Err(DataFitError::Unstable { load, found: "could not be inverted" }),
        }
        let mut x = vec![[0.0; 4]; b.len()];
        x[rows].copy_from_slice(&own);
        Ok(x)
    }

    /// `K x` with the tangent evaluated last.
    fn tangent_times(&self, x: &Rows<f64>) -> Rows<f64> {
        let world = self.scene.simulation.world();
        let (topology, workers) = (world.resource::<Topology>(), world.resource::<Workers>());
        let mut product = vec![[0.0; 4]; x.len()];
        let tangent = world.resource::<Tangent<f64>>();
        tangent.multiply(topology, workers, &mut ProductSpans::default(), x, &mut product);
        product
    }

    /// Derivative of an observation by the unknowns: 1 at a displacement, rows of `K` for a reaction.
    fn selector(&self, measured: Observed) -> Rows<f64> {
        let mut unit = vec![[0.0; 4]; self.fixed.len()];
        match measured {
            Observed::Displacement { body, vertex, axis } => {
                if let Some(row) = self.row(body, vertex) {
                    unit[row][axis] = 1.0;
                }
                unit
            }
            Observed::Reaction { constraint, axis } => {
                for row in self.rows(constraint) {
                    unit[row][axis] = 1.0;
                }
                self.tangent_times(&unit)
            }
        }
    }

    /// Sum of forces over the held unknowns of a reaction, 0 for a displacement.
    fn held_sum(&self, measured: Observed, force: &Rows<f64>) -> f64 {
        match measured {
            Observed::Displacement { .. } => 0.0,
            Observed::Reaction { constraint, axis } => {
                self.rows(constraint).map(|row| force[row][axis]).sum()
            }
        }
    }

    fn body_of(&self, measured: Observed) -> usize {
        match measured {
            Observed::Displacement { body, .. } => body,
            Observed::Reaction { constraint, .. } => self.scene.constraints[constraint].body,
        }
    }

    fn body_rows(&self, body: usize) -> std::ops::Range<usize> {
        let rows = &self.scene.simulation.topology().bodies[self.scene.bodies[body].handle.0];
        rows.vertices.start as usize..rows.vertices.end as usize
    }

    fn row(&self, body: usize, vertex: u32) -> Option<usize> {
        let handle = self.scene.bodies[body].handle.0;
        self.scene.simulation.topology().bodies[handle].row(vertex).map(VertexRow::index)
    }
}

/// `a` and `b` such that `d(lambda, mu)/d nu = a (lambda, mu)(nu) + b (lambda, mu)(other)`, for any `E`.
pub fn split(nu: f64, other: f64) -> (f64, f64) {
    // both with E = 1
    let lame = |nu: f64| LameParameters {
        lambda: nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
        mu: 0.5 / (1.0 + nu),
    };
    let (p, q) = (lame(nu), lame(other));
    let both = (1.0 + nu) * (1.0 - 2.0 * nu);
    let d_lambda = (1.0 + 2.0 * nu * nu) / (both * both);
    let d_mu = -0.5 / ((1.0 + nu) * (1.0 + nu));
    let det = p.lambda * q.mu - q.lambda * p.mu;
    ((d_lambda * q.mu - q.lambda * d_mu) / det, (p.lambda * d_mu - d_lambda * p.mu) / det)
}
