//! Static problems: what holds and loads a body, and its equilibrium.

use super::body::CaseBody;
use super::read::{CaseEntry, ReferenceCase};
use super::{CaseError, ValidationRow};
use glam::DVec3;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::Mesh;
use sinew::engine::vertex::FixedAxes;
use sinew::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// Nodes with prescribed displacements: which axes (bits) and how far (m).
pub(super) type Held = BTreeMap<u32, (u8, DVec3)>;

/// What holds and loads a body.
pub(super) struct StaticProblem {
    pub held: Held,
    pub loads: Vec<(u32, DVec3)>,
    /// Triangles under follower pressure, turned so that it pushes along their normals, and the pressure
    /// (Pa).
    pub pressure: Option<(Vec<[u32; 3]>, f64)>,
    /// Displacements (m) at the start, for what has no stiffness at rest.
    pub start: Option<Vec<DVec3>>,
}

impl StaticProblem {
    pub fn read(case: &ReferenceCase, result: &CaseEntry, mesh: &Mesh) -> Result<Self, CaseError> {
        let root = case.root();
        let follower = match result.get("follower_load").given() {
            Some(follower) => follower.flag()?,
            None => false,
        };
        let pressure = if follower { read_pressure(&root, mesh)? } else { None };
        let final_loads = result.get("final_nodal_loads");
        let loads = match &pressure {
            Some(_) => Vec::new(),
            None if final_loads.is_list() => read_loads(&final_loads)?,
            None => read_loads(&root.get("nodal_loads"))?,
        };
        let mut held = read_held(&root.get("dirichlet"), mesh.points.len())?;
        if result.get("u").at(0).list()?.count() == 2 {
            // a membrane has no stiffness out of its plane
            for v in mesh.triangles.iter().flatten().chain(mesh.quads.iter().flatten()) {
                held.entry(*v).or_default().0 |= 4;
            }
        }
        let flat = pressure.is_some() && !mesh.is_solid();
        let start = flat.then(|| dome(&mesh.points, &held));
        Ok(Self { held, loads, pressure, start })
    }

    /// The equilibrium, approached in more and more load steps until it is found; `clean` if it has no inverted
    /// element.
    pub fn settle(
        &self,
        case: &ReferenceCase,
        body: &CaseBody,
        clean: bool,
        row: &mut ValidationRow,
    ) -> Result<StaticSolution, CaseError> {
        let start = Instant::now();
        let mut solution = self.solve(case, body, 1, row)?;
        for load_steps in [4, 16, 64] {
            if solution.converged && !(clean && solution.inverted > 0) {
                break;
            }
            solution = self.solve(case, body, load_steps, row)?;
        }
        row.seconds = start.elapsed().as_secs_f64();
        solution.remark(row);
        Ok(solution)
    }

    /// The equilibrium, approached in so many load steps.
    fn solve(
        &self,
        case: &ReferenceCase,
        body: &CaseBody,
        load_steps: u32,
        row: &mut ValidationRow,
    ) -> Result<StaticSolution, CaseError> {
        let (mut simulation, body) = body.simulation(case)?;
        self.support(case, &mut simulation, body)?;
        simulation.set_dt(1.0 / f64::from(load_steps));
        simulation.set_solver(SolverSettings {
            integrator: Integrator::QuasiStatic,
            linear_tolerance: 1e-9,
            max_linear_iterations: 50_000,
            newton_tolerance: 1e-11,
            max_newton_iterations: 200,
            ..Default::default()
        });
        let mut converged = true;
        let mut failure = None;
        for _ in 0..load_steps {
            if let Err(error) = simulation.step() {
                failure = Some(error.to_string());
                converged = false;
                break;
            }
            let report = simulation.report();
            row.newton_iterations += u64::from(report.newton_iterations);
            row.cg_iterations += u64::from(report.cg_iterations);
            converged &= !report.unconverged && report.cg_caps == 0;
        }
        let inverted = simulation.volume_report().inverted;
        Ok(StaticSolution { simulation, body, load_steps, converged, inverted, failure })
    }

    /// Constraints and loads, growing with time from 0 to 1.
    fn support(
        &self,
        case: &ReferenceCase,
        simulation: &mut Simulation,
        body: BodyHandle,
    ) -> Result<(), CaseError> {
        // nodes that are held along the same axes together
        for mask in 1..=7u8 {
            let nodes: Vec<u32> =
                self.held.iter().filter(|(_, h)| h.0 == mask).map(|(n, _)| *n).collect();
            if nodes.is_empty() {
                continue;
            }
            let way = nodes.iter().map(|n| self.held[n].1).collect();
            let rows =
                simulation.rows(body, "dirichlet", &nodes).map_err(|e| case.simulation_error(e))?;
            let mut constraint = Constraint::moving(
                format!("axes {mask}"),
                rows,
                Motion::TranslateEach(way),
                Curve::ramp(0.0, 1.0),
            );
            constraint.axes = FixedAxes(mask);
            simulation.add_constraint(constraint);
        }
        if !self.loads.is_empty() {
            let nodes: Vec<u32> = self.loads.iter().map(|l| l.0).collect();
            let rows = simulation
                .rows(body, "nodal_loads", &nodes)
                .map_err(|e| case.simulation_error(e))?;
            simulation.add_load(Load {
                name: "nodal_loads".into(),
                forces: rows.into_iter().zip(self.loads.iter().map(|l| l.1)).collect(),
                curve: Curve::ramp(0.0, 1.0),
            });
        }
        if let Some((faces, pressure)) = &self.pressure {
            let faces = simulation
                .face_rows(body, "pressure", faces)
                .map_err(|e| case.simulation_error(e))?;
            simulation.add_pressure(Pressure {
                name: "pressure".into(),
                faces,
                pressure: *pressure,
                curve: Curve::ramp(0.0, 1.0),
            });
        }
        if let Some(start) = &self.start {
            let still = vec![DVec3::ZERO; start.len()];
            simulation.set_state(body, start, &still).map_err(|e| case.simulation_error(e))?;
        }
        Ok(())
    }

    /// Reactions (N) of the groups of a result: found and expected.
    pub fn reactions(
        &self,
        case: &ReferenceCase,
        result: &CaseEntry,
        mesh: &Mesh,
        elastic: &[DVec3],
        external: &[DVec3],
    ) -> Result<Vec<[DVec3; 2]>, CaseError> {
        let Some(groups) = result.get("reaction_on_group").given() else { return Ok(Vec::new()) };
        let mut reactions = Vec::new();
        for name in groups.object()?.keys() {
            let expected = groups.get(name);
            let vertices = match case.root().get("extra_groups").get(name).given() {
                Some(own) => own.indices()?,
                None => {
                    let group = mesh.group(name);
                    let fail = || {
                        expected.error("the reaction on a group of the mesh or of `extra_groups`")
                    };
                    group.ok_or_else(fail)?.vertices.clone()
                }
            };
            let mut sum = DVec3::ZERO;
            for v in vertices {
                let Some((mask, _)) = self.held.get(&v) else { continue };
                let f = -(elastic[v as usize] + external[v as usize]);
                for k in 0..3 {
                    if mask >> k & 1 == 1 {
                        sum[k] += f[k];
                    }
                }
            }
            reactions.push([sum, expected.vector()?]);
        }
        Ok(reactions)
    }
}

/// The last attempt at an equilibrium.
pub(super) struct StaticSolution {
    pub simulation: Simulation,
    pub body: BodyHandle,
    load_steps: u32,
    pub converged: bool,
    inverted: u64,
    failure: Option<String>,
}

impl StaticSolution {
    fn remark(&self, row: &mut ValidationRow) {
        if self.load_steps > 1 {
            row.remark(format!("{} load steps", self.load_steps));
        }
        if !self.converged {
            row.remark("not converged".into());
        }
        if self.inverted > 0 {
            row.remark(format!("{} inverted", self.inverted));
        }
        if let Some(failure) = &self.failure {
            row.remark(failure.clone());
        }
    }
}

/// Prescribed displacements by node from `[node, component, value]`.
pub(super) fn read_held(list: &CaseEntry, nodes: usize) -> Result<Held, CaseError> {
    let mut held = Held::new();
    for entry in list.list()? {
        let node = entry.at(0).index()?;
        if node as usize >= nodes {
            return Err(entry.at(0).error(format!("one of the {nodes} nodes, counted from 0")));
        }
        let axis = entry.at(1).index()? as usize;
        if axis > 2 {
            return Err(entry.at(1).error("a component from 0 to 2"));
        }
        let slot = held.entry(node).or_default();
        slot.0 |= 1 << axis;
        slot.1[axis] = entry.at(2).number()?;
    }
    Ok(held)
}

/// Nodal loads from `[node, fx, fy]` with `fz` unless the case is plane; none when absent.
fn read_loads(list: &CaseEntry) -> Result<Vec<(u32, DVec3)>, CaseError> {
    let Some(list) = list.clone().given() else { return Ok(Vec::new()) };
    let load = |entry: CaseEntry| {
        let z = entry.at(3).given().map_or(Ok(0.0), |z| z.number())?;
        let force = DVec3::new(entry.at(1).number()?, entry.at(2).number()?, z);
        Ok((entry.at(0).index()?, force))
    };
    list.list()?.map(load).collect()
}

/// As [`StaticProblem::pressure`], from the loads in words.
fn read_pressure(root: &CaseEntry, mesh: &Mesh) -> Result<Option<(Vec<[u32; 3]>, f64)>, CaseError> {
    let Some(loads) = root.get("loads_continuum").given() else { return Ok(None) };
    for load in loads.list()? {
        match load.at(0).text()? {
            "membrane_pressure" => {
                return Ok(Some((mesh.triangles.clone(), load.at(1).number()?)));
            }
            "pressure" => {
                let group = mesh.group_of_dimension(load.at(1).text()?, 2);
                let group =
                    group.ok_or_else(|| load.at(1).error("a group of faces of the mesh"))?;
                let sorted = |mut t: [u32; 3]| {
                    t.sort_unstable();
                    t
                };
                let chosen: BTreeSet<[u32; 3]> = group
                    .cells
                    .triangles
                    .iter()
                    .map(|&t| sorted(mesh.triangles[t as usize]))
                    .collect();
                let outward = mesh.surface_triangles().into_iter();
                let faces = outward.filter(|&t| chosen.contains(&sorted(t)));
                let inward: Vec<[u32; 3]> = faces.map(|[a, b, c]| [a, c, b]).collect();
                // none on hexahedra: the loads of the final state stand for their pressure
                let pressure = load.at(2).number()?;
                return Ok(if inward.is_empty() { None } else { Some((inward, pressure)) });
            }
            _ => {}
        }
    }
    Ok(None)
}

/// A flat membrane resists no motion along its normal, so equilibrium under pressure is looked for from a
/// dome over the held rim: a tenth of the body high, by distance from the nearest held node.
fn dome(points: &[DVec3], held: &Held) -> Vec<DVec3> {
    let distance = |p: &DVec3| {
        held.keys().map(|&h| p.distance(points[h as usize])).fold(f64::INFINITY, f64::min)
    };
    let distances: Vec<f64> = points.iter().map(distance).collect();
    distances.iter().map(|d| 0.2 * d * DVec3::Z).collect()
}
