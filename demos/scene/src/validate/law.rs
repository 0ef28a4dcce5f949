//! Static fields, schema `sinew-fem-ref/1`: one equilibrium of a mesh, compared law by law.

use super::body::{Body, Cells, Law, Material, mesh, plane_state};
use super::compare::{difference, largest};
use super::quadratic;
use super::read::{Case, Entry};
use super::{CaseError, STATIC_TOLERANCE, Status, ValidateOptions, ValidationRow};
use glam::DVec3;
use sinew::engine::load::Pressure;
use sinew::engine::mesh::Mesh;
use sinew::engine::vertex::FixedAxes;
use sinew::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// Keys of a case; those of elements and clusters belong to laws that are not built.
const KEYS: &str = "cell_type cells dirichlet extra_groups loads_continuum material mesh name \
    nodal_load_sum nodal_loads nodes results schema cluster_lambda clusters \
    element_lambda element_quartic quadratic_mean_dilatation";

const MATERIAL_KEYS: &str = "E nu rho plane";

const RESULT_KEYS: &str = "cluster_pressure continuum discrete_vs_continuum energy final_nodal_loads \
    follower_load max_disp mean_disp_on_group min_cell_ratio mixed plain_vs_continuum \
    quadratic_mean_dilatation reaction_on_group status u";

/// Nodes with prescribed displacements: which axes (bits) and how far (m).
pub(super) type Held = BTreeMap<u32, (u8, DVec3)>;

pub(super) fn run(case: &Case, options: &ValidateOptions) -> Result<Vec<ValidationRow>, CaseError> {
    let root = case.root();
    root.refuse_unknown(KEYS)?;
    root.get("material").refuse_unknown(MATERIAL_KEYS)?;
    let count = |key: &str| root.get(key).index().unwrap_or(0) as usize;
    let results = root.get("results");
    let mut rows = Vec::new();
    for law in results.object()?.keys() {
        let result = results.get(law);
        let mut row = ValidationRow::new(&case.name(), law, count("nodes"), count("cells"));
        let outcome = run_law(case, law, &result, Clusters::Given, options, &mut row);
        rows.push(row.ended(outcome));
        if root.get("clusters").is_list() && !result.get("discrete_vs_continuum").is_absent() {
            let mut row = ValidationRow::new(&case.name(), law, count("nodes"), count("cells"));
            let outcome = run_law(case, law, &result, Clusters::Own, options, &mut row);
            row.remark("clusters of the engine".into());
            rows.push(row.ended(outcome));
        }
        if !result.get("quadratic_mean_dilatation").is_absent() {
            let mut row = ValidationRow::new(&case.name(), law, 0, count("cells"));
            let outcome = run_quadratic(case, law, &result, options, &mut row);
            row.remark("ten-node tetrahedra".into());
            rows.push(row.ended(outcome));
        }
    }
    Ok(rows)
}

/// The same with ten-node tetrahedra, for which some cases have results of their own.
fn run_quadratic(
    case: &Case,
    law: &str,
    result: &Entry,
    options: &ValidateOptions,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let mesh = mesh(case, options)?;
    let held = read_held(&case.root().get("dirichlet"), mesh.points.len())?;
    quadratic::run(case, law, (result, &mesh, &held), options, row)
}

/// Whose clusters of tetrahedra keep volumes.
#[derive(Clone, Copy, PartialEq)]
enum Clusters {
    /// Those of the case: its stored field belongs to them.
    Given,
    /// Those of the engine, which have to be as near to the continuum.
    Own,
}

/// How much farther from the continuum the engine's own clusters may be than those of a case: other clusters are another
/// discretisation.
const OWN_CLUSTERS: f64 = 1.15;

/// What stored numbers of twelve digits leave of a peak that is prescribed (%).
const ROUNDING: f64 = 1e-8;

fn run_law(
    case: &Case,
    law: &str,
    result: &Entry,
    whose: Clusters,
    options: &ValidateOptions,
    row: &mut ValidationRow,
) -> Result<(), CaseError> {
    let root = case.root();
    let kind = root.get("cell_type").text()?;
    let law = Law::find(law, kind)?;
    result.refuse_unknown_results(RESULT_KEYS)?;
    let status = result.get("status").text()?;
    if status != "ok" {
        return Err(CaseError::NotRun(format!("the reference has no solution: {status}")));
    }
    let mesh = mesh(case, options)?;
    let cells = Cells::of(&mesh).filter(|cells| cells.kind() == kind);
    let cells =
        cells.ok_or_else(|| root.get("cell_type").error("the kind of cells of the mesh"))?;
    let material = root.get("material");
    let plane = plane_state(&material.get("plane"))?;
    let material = Material::read(&material, cells.len())?;
    let points = &mesh.points;
    let clusters = match (cells, root.get("clusters")) {
        (Cells::Tetrahedra(_), given) if given.is_list() && whose == Clusters::Given => {
            Some(given.indices()?)
        }
        _ => None,
    };
    let clusters = clusters.as_deref();
    let body = Body { points, cells, law, clusters, material: &material, thickness: 1.0, plane };
    (row.nodes, row.cells) = (points.len(), cells.len());
    let truth = result.get("u").field(points.len())?;
    let problem = Problem::read(case, result, &mesh)?;
    if problem.pressure.is_some() {
        row.note = "follower pressure".into();
    }

    let clean = match result.get("min_cell_ratio").given() {
        Some(ratio) => ratio.number()? > 0.0,
        None => true,
    };
    let solution = problem.settle(case, &body, options, clean, row)?;

    let Solution { mut simulation, body, converged, .. } = solution;
    let energy = simulation.evaluate();
    let u = simulation.displacements(body);
    let continuum = result.get("continuum").get("u").given();
    let continuum = continuum.map(|field| field.field(points.len())).transpose()?;
    if let Some(continuum) = &continuum {
        let (max, rms) = difference(&u, continuum, largest(continuum));
        (row.continuum_max_percent, row.continuum_rms_percent) = (100.0 * max, 100.0 * rms);
    }
    if whose == Clusters::Own {
        let stored = result.get("discrete_vs_continuum");
        let rms = stored.get("e_rms_percent").number()?;
        let mut near = row.continuum_rms_percent <= OWN_CLUSTERS * rms;
        // where displacements are prescribed the largest is one of them
        if let (Some(peak), Some(truth)) = (stored.get("peak_percent").given(), continuum) {
            let own = 100.0 * (largest(&u) / largest(&truth) - 1.0);
            row.remark(format!("peak {own:+.2} %"));
            // peaks nearer to each other than the truth is known tell nothing
            let continuum = result.get("continuum");
            let mut known = f64::INFINITY;
            for name in ["change_from_previous_level", "difference_to_quadratic_mean_dilatation"] {
                if let Some(share) = continuum.get(name).given().and_then(|x| x.number().ok()) {
                    known = known.min(100.0 * share);
                }
            }
            let known = if known.is_finite() { known } else { 0.0 };
            let allowed = known.max(OWN_CLUSTERS * peak.number()?.abs());
            near &= own.abs() <= allowed + ROUNDING;
        }
        if converged && near {
            row.status = Status::Pass;
        }
        return Ok(());
    }
    (row.max_difference, row.rms_difference) = difference(&u, &truth, largest(&truth));
    let expected = result.get("energy").number()?;
    row.energy_difference = (energy - expected).abs() / expected.abs();
    let elastic = simulation.elastic_forces(body);
    let external = simulation.external_forces(body);
    let groups = problem.reactions(case, result, &mesh, &elastic, &external)?;
    row.reaction_difference = reaction_difference(&groups, largest(&elastic));
    let tolerance = options.tolerance.unwrap_or(STATIC_TOLERANCE);
    let energy_tolerance = tolerance.max(1e-12);
    if converged
        && row.max_difference <= tolerance
        && row.energy_difference <= energy_tolerance
        && (row.reaction_difference.is_nan() || row.reaction_difference <= tolerance)
    {
        row.status = Status::Pass;
    }
    Ok(())
}

/// What holds and loads a body.
pub(super) struct Problem {
    pub held: Held,
    pub loads: Vec<(u32, DVec3)>,
    /// Triangles under follower pressure, turned so that it pushes along their normals, and the pressure
    /// (Pa).
    pub pressure: Option<(Vec<[u32; 3]>, f64)>,
    /// Displacements (m) at the start, for what has no stiffness at rest.
    pub start: Option<Vec<DVec3>>,
}

impl Problem {
    fn read(case: &Case, result: &Entry, mesh: &Mesh) -> Result<Self, CaseError> {
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
        case: &Case,
        body: &Body,
        options: &ValidateOptions,
        clean: bool,
        row: &mut ValidationRow,
    ) -> Result<Solution, CaseError> {
        let start = Instant::now();
        let mut solution = self.solve(case, body, options, 1, row)?;
        for load_steps in [4, 16, 64] {
            if solution.converged && !(clean && solution.inverted > 0) {
                break;
            }
            solution = self.solve(case, body, options, load_steps, row)?;
        }
        row.seconds = start.elapsed().as_secs_f64();
        solution.remark(row);
        Ok(solution)
    }

    /// The equilibrium, approached in so many load steps.
    fn solve(
        &self,
        case: &Case,
        body: &Body,
        options: &ValidateOptions,
        load_steps: u32,
        row: &mut ValidationRow,
    ) -> Result<Solution, CaseError> {
        let (mut simulation, body) = body.simulation(case, options)?;
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
        Ok(Solution { simulation, body, load_steps, converged, inverted, failure })
    }

    /// Constraints and loads, growing with time from 0 to 1.
    fn support(
        &self,
        case: &Case,
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
    fn reactions(
        &self,
        case: &Case,
        result: &Entry,
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

/// Largest difference of a group's reaction over the largest reaction of all groups; NaN without groups.
fn reaction_difference(groups: &[[DVec3; 2]], largest_force: f64) -> f64 {
    let largest_off = groups.iter().map(|[a, b]| a.distance(*b)).fold(0.0, f64::max);
    // a body whose reactions cancel within every group is measured by its nodal forces instead
    let scale = groups.iter().map(|[_, b]| b.length()).fold(largest_force, f64::max);
    if !groups.is_empty() && scale > 0.0 { largest_off / scale } else { f64::NAN }
}

/// The last attempt at an equilibrium.
pub(super) struct Solution {
    pub simulation: Simulation,
    pub body: BodyHandle,
    load_steps: u32,
    pub converged: bool,
    inverted: u64,
    failure: Option<String>,
}

impl Solution {
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
fn read_held(list: &Entry, nodes: usize) -> Result<Held, CaseError> {
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
fn read_loads(list: &Entry) -> Result<Vec<(u32, DVec3)>, CaseError> {
    let Some(list) = list.clone().given() else { return Ok(Vec::new()) };
    let load = |entry: Entry| {
        let z = entry.at(3).given().map_or(Ok(0.0), |z| z.number())?;
        let force = DVec3::new(entry.at(1).number()?, entry.at(2).number()?, z);
        Ok((entry.at(0).index()?, force))
    };
    list.list()?.map(load).collect()
}

/// As [`Problem::pressure`], from the loads in words.
fn read_pressure(root: &Entry, mesh: &Mesh) -> Result<Option<(Vec<[u32; 3]>, f64)>, CaseError> {
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
                let chosen: BTreeSet<[u32; 3]> =
                    group.triangles.iter().map(|&t| sorted(mesh.triangles[t as usize])).collect();
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
