//! Reference cases: static fields and single elements from finite-element codes, trajectories from
//! an independent program. Each is run with the engine's own laws and compared with the stored
//! discrete truth on the same mesh. What cannot be run is listed with its reason, never as passed.

use crate::modes::{Mode, modes};
use glam::DVec3;
use serde::Serialize;
use serde_json::Value;
use sinew::engine::isoparametric::{gauss_point, quad_derivatives};
use sinew::engine::mesh::Mesh;
use sinew::engine::vertex::FixedAxes;
use sinew::models::sheet::{MembraneDescription, MembraneModel};
use sinew::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Relative difference to a static field at which a case passes.
pub const STATIC_TOLERANCE: f64 = 1e-6;
/// Difference to an implicit Euler trajectory, over body size, at which a case passes.
pub const TRAJECTORY_TOLERANCE: f64 = 1e-8;

/// A case file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaseError {
    /// The file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is not JSON.
    #[error("{path}: {source}")]
    Json {
        /// File.
        path: PathBuf,
        /// Cause, with line and column.
        source: serde_json::Error,
    },
    /// A field is missing or has the wrong shape.
    #[error("{path}: field `{field}` is missing or not {expected}")]
    Field {
        /// File.
        path: PathBuf,
        /// Field.
        field: String,
        /// What it should be.
        expected: &'static str,
    },
    /// The mesh is not found.
    #[error(
        "{case}: mesh `{mesh}` is in none of {searched:?}; put the meshes folder beside the cases' \
         folder or name it with --meshes"
    )]
    NoMesh {
        /// Case file.
        case: PathBuf,
        /// Mesh file named by the case.
        mesh: String,
        /// Where it was looked for.
        searched: Vec<PathBuf>,
    },
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] sinew::engine::mesh::MeshError),
    /// The simulation cannot be set up or does not run.
    #[error("{case}: {source}")]
    Simulation {
        /// Case file.
        case: PathBuf,
        /// Cause.
        source: SimulationError,
    },
}

/// How a case ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Within the tolerance.
    Pass,
    /// Not within the tolerance, or not converged.
    Fail,
    /// Not run, with the reason.
    Unsupported(String),
}

/// One row of the table: a case and a law.
#[derive(Clone, Debug, Serialize)]
pub struct ValidationRow {
    /// Case name.
    pub case: String,
    /// Law, or quantity for trajectories.
    pub law: String,
    /// Nodes of the mesh.
    pub nodes: usize,
    /// Cells of the mesh.
    pub cells: usize,
    /// How it ended.
    pub status: Status,
    /// Largest node difference over largest displacement (over body size for trajectories).
    pub max_difference: f64,
    /// Root mean square node difference over the same.
    pub rms_difference: f64,
    /// Relative difference of energy.
    pub energy_difference: f64,
    /// Largest difference of a group's reaction over the largest reaction.
    pub reaction_difference: f64,
    /// Difference to the continuum (or to the time-converged trajectory), rms in percent of the
    /// largest displacement.
    pub continuum_rms_percent: f64,
    /// The same, largest node.
    pub continuum_max_percent: f64,
    /// Newton iterations.
    pub newton_iterations: u64,
    /// Conjugate-gradient iterations.
    pub cg_iterations: u64,
    /// Wall time (s).
    pub seconds: f64,
    /// Remarks: load steps, follower loads, caps.
    pub note: String,
}

impl ValidationRow {
    fn new(case: &str, law: &str, nodes: usize, cells: usize) -> Self {
        Self {
            case: case.into(),
            law: law.into(),
            nodes,
            cells,
            status: Status::Fail,
            max_difference: f64::NAN,
            rms_difference: f64::NAN,
            energy_difference: f64::NAN,
            reaction_difference: f64::NAN,
            continuum_rms_percent: f64::NAN,
            continuum_max_percent: f64::NAN,
            newton_iterations: 0,
            cg_iterations: 0,
            seconds: 0.0,
            note: String::new(),
        }
    }

    fn unsupported(case: &str, law: &str, nodes: usize, cells: usize, why: String) -> Self {
        Self { status: Status::Unsupported(why), ..Self::new(case, law, nodes, cells) }
    }
}

/// All rows.
#[derive(Clone, Debug, Serialize)]
pub struct ValidationReport {
    /// Schema of the JSON form.
    pub schema: &'static str,
    /// Evaluation used.
    pub evaluation: Evaluation,
    /// One row per case and law.
    pub rows: Vec<ValidationRow>,
}

impl ValidationReport {
    /// Whether every case that was run passed.
    pub fn passed(&self) -> bool {
        self.rows.iter().all(|r| r.status != Status::Fail)
    }
}

/// Choices for [`validate`].
#[derive(Clone, Debug, Default)]
pub struct ValidateOptions {
    /// Replaces both default tolerances.
    pub tolerance: Option<f64>,
    /// Folder with the meshes; default: `meshes` beside the folder of the case.
    pub meshes: Option<PathBuf>,
    /// Evaluation.
    pub evaluation: Evaluation,
    /// Threads; 0 means one per core.
    pub threads: usize,
}

/// Runs case files in order.
///
/// # Errors
/// When a file cannot be read or does not follow its schema.
pub fn validate(
    files: &[PathBuf],
    options: &ValidateOptions,
    mut progress: impl FnMut(&ValidationRow),
) -> Result<ValidationReport, CaseError> {
    let mut rows = Vec::new();
    for path in files {
        let case = Case::read(path)?;
        let kind = case.value["schema"].as_str().unwrap_or("");
        let new = match kind {
            "sinew-fem-ref/1" => case.run_static(options)?,
            "sinew-fem-elements/1" => case.run_elements(options)?,
            "sinew-fem-modes/1" => case.run_modes(options)?,
            "" if case.value["implicit_euler"].is_object() => case.run_trajectory(options)?,
            other => {
                let why = format!("schema `{other}` is not known");
                vec![ValidationRow::unsupported(&case.name(), "-", 0, 0, why)]
            }
        };
        new.iter().for_each(&mut progress);
        rows.extend(new);
    }
    Ok(ValidationReport { schema: "sinew-validate/1", evaluation: options.evaluation, rows })
}

struct Case {
    path: PathBuf,
    value: Value,
}

/// Laws by their names in the case files.
const LAWS: [(&str, Model); 3] =
    [("svk", Model::StVK), ("svk_comp", Model::CompressibleStVK), ("linear", Model::Linear)];

/// Membrane laws by their names in the case files: plane stress.
const MEMBRANE_LAWS: [(&str, MembraneModel); 3] = [
    ("linear", MembraneModel::Linear),
    ("svk", MembraneModel::Biquadratic),
    ("svk_comp", MembraneModel::CompressibleBiquadratic),
];

/// Elements of a case with their law.
#[derive(Clone, Copy)]
enum Elements<'a> {
    Tetrahedra(&'a [[u32; 4]], Model),
    Hexahedra(&'a [[u32; 8]], Model),
    /// Triangles, thickness (m) and law.
    Triangles(&'a [[u32; 3]], f64, MembraneModel),
    /// Quadrilaterals likewise.
    Quads(&'a [[u32; 4]], f64, MembraneModel),
}

impl Elements<'_> {
    fn len(&self) -> usize {
        match self {
            Elements::Tetrahedra(cells, _) | Elements::Quads(cells, ..) => cells.len(),
            Elements::Hexahedra(cells, _) => cells.len(),
            Elements::Triangles(cells, ..) => cells.len(),
        }
    }
}

impl Case {
    fn read(path: &Path) -> Result<Self, CaseError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| CaseError::Io { path: path.into(), source })?;
        let value = serde_json::from_str(&text)
            .map_err(|source| CaseError::Json { path: path.into(), source })?;
        Ok(Self { path: path.into(), value })
    }

    fn name(&self) -> String {
        let stem =
            || self.path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
        self.value["name"].as_str().map_or_else(stem, String::from)
    }

    fn field_error(&self, field: &str, expected: &'static str) -> CaseError {
        CaseError::Field { path: self.path.clone(), field: field.into(), expected }
    }

    fn number(&self, value: &Value, field: &str) -> Result<f64, CaseError> {
        value.as_f64().ok_or_else(|| self.field_error(field, "a number"))
    }

    fn vectors(&self, value: &Value, field: &str) -> Result<Vec<DVec3>, CaseError> {
        let fail = || self.field_error(field, "a list of triples of numbers");
        value
            .as_array()
            .ok_or_else(fail)?
            .iter()
            .map(|row| {
                let at = |i: usize| row[i].as_f64().ok_or_else(fail);
                // plane cases have two components
                let z = if row[2].is_null() { 0.0 } else { at(2)? };
                Ok(DVec3::new(at(0)?, at(1)?, z))
            })
            .collect()
    }

    fn cells<const N: usize>(
        &self,
        value: &Value,
        field: &str,
    ) -> Result<Vec<[u32; N]>, CaseError> {
        let fail = || self.field_error(field, "a list of vertex indices per cell");
        let index = |v: &Value| v.as_u64().and_then(|i| u32::try_from(i).ok()).ok_or_else(fail);
        let cell = |c: &Value| {
            let mut cell = [0; N];
            for (i, v) in cell.iter_mut().enumerate() {
                *v = index(&c[i])?;
            }
            Ok(cell)
        };
        value.as_array().ok_or_else(fail)?.iter().map(cell).collect()
    }

    fn simulation_error(&self, source: impl Into<SimulationError>) -> CaseError {
        CaseError::Simulation { case: self.path.clone(), source: source.into() }
    }

    fn material(&self, value: &Value) -> Result<YoungPoisson, CaseError> {
        Ok(YoungPoisson {
            young_modulus: self.number(&value["E"], "E")?,
            poisson_ratio: self.number(&value["nu"], "nu")?,
            density: value["rho"].as_f64().unwrap_or(1000.0),
        })
    }

    fn mesh(&self, options: &ValidateOptions) -> Result<Mesh, CaseError> {
        let name =
            self.value["mesh"].as_str().ok_or_else(|| self.field_error("mesh", "a file name"))?;
        let beside = self.path.parent().unwrap_or(Path::new("."));
        let searched = match &options.meshes {
            Some(folder) => vec![folder.clone()],
            None => vec![beside.join("../meshes"), beside.into()],
        };
        let file = searched.iter().map(|f| f.join(name)).find(|f| f.is_file());
        match file {
            Some(file) => Ok(Mesh::read(&file)?),
            None => Err(CaseError::NoMesh { case: self.path.clone(), mesh: name.into(), searched }),
        }
    }

    fn simulation(
        &self,
        points: &[DVec3],
        elements: Elements,
        material: YoungPoisson,
        options: &ValidateOptions,
    ) -> Result<(Simulation, BodyHandle), CaseError> {
        let threads = options.threads;
        let mut simulation = Simulation::new(SimulationOptions { threads, ..Default::default() })
            .map_err(|e| self.simulation_error(e))?;
        let evaluation = options.evaluation;
        let parts = |tetrahedra| BodyDescription::from_parts("body", points, tetrahedra, material);
        let description = match elements {
            Elements::Tetrahedra(tetrahedra, model) => {
                let pooled = model.supports(evaluation);
                let evaluation = if pooled { evaluation } else { Evaluation::Fused };
                BodyDescription { model, evaluation, ..parts(tetrahedra) }
            }
            Elements::Hexahedra(hexahedra, model) => {
                BodyDescription { hexahedra, model, ..parts(&[]) }
            }
            Elements::Triangles(triangles, thickness, model) => {
                let pooled = model.supports(evaluation);
                let evaluation = if pooled { evaluation } else { Evaluation::Fused };
                let membrane = MembraneDescription::new(triangles, thickness, material);
                let membrane = Some(MembraneDescription { model, evaluation, ..membrane });
                BodyDescription { membrane, ..parts(&[]) }
            }
            Elements::Quads(quads, thickness, model) => {
                let membrane = MembraneDescription::new(&[], thickness, material);
                let membrane = Some(MembraneDescription { quads, model, ..membrane });
                BodyDescription { membrane, ..parts(&[]) }
            }
        };
        let body = simulation.add_body(&description).map_err(|e| self.simulation_error(e))?;
        simulation.set_gravity(DVec3::ZERO);
        Ok((simulation, body))
    }

    fn run_static(&self, options: &ValidateOptions) -> Result<Vec<ValidationRow>, CaseError> {
        let name = self.name();
        let count = |key: &str| self.value[key].as_u64().unwrap_or(0) as usize;
        let (nodes, cells) = (count("nodes"), count("cells"));
        let results = self.value["results"]
            .as_object()
            .ok_or_else(|| self.field_error("results", "an object"))?;
        let mut rows = Vec::new();
        let element = self.value["cell_type"].as_str().unwrap_or("?");
        for (law, result) in results {
            let unsupported =
                |why: String| ValidationRow::unsupported(&name, law, nodes, cells, why);
            let solid = LAWS.iter().find(|(n, _)| n == law).map(|l| l.1);
            let membrane = MEMBRANE_LAWS.iter().find(|(n, _)| n == law).map(|l| l.1);
            let known = match element {
                "tet" | "hex" => solid.is_some(),
                "tri" | "quad" => membrane.is_some(),
                _ => {
                    rows.push(unsupported(format!("{element} elements are not known")));
                    continue;
                }
            };
            if !known {
                rows.push(unsupported(format!("law `{law}` is not built yet")));
                continue;
            }
            if result["status"] != "ok" {
                let why = result["status"].as_str().unwrap_or("no result");
                rows.push(unsupported(format!("the reference has no solution: {why}")));
                continue;
            }
            rows.push(self.run_law(&name, law, (solid, membrane), result, options)?);
        }
        Ok(rows)
    }

    fn run_law(
        &self,
        name: &str,
        law: &str,
        models: (Option<Model>, Option<MembraneModel>),
        result: &Value,
        options: &ValidateOptions,
    ) -> Result<ValidationRow, CaseError> {
        let mesh = self.mesh(options)?;
        // moduli of plane cases are per unit thickness
        let elements = match models {
            (Some(model), _) if !mesh.hexahedra.is_empty() => {
                Elements::Hexahedra(&mesh.hexahedra, model)
            }
            (Some(model), _) if !mesh.tetrahedra.is_empty() => {
                Elements::Tetrahedra(&mesh.tetrahedra, model)
            }
            (_, Some(model)) if !mesh.quads.is_empty() => Elements::Quads(&mesh.quads, 1.0, model),
            (_, Some(model)) if !mesh.triangles.is_empty() => {
                Elements::Triangles(&mesh.triangles, 1.0, model)
            }
            _ => return Err(self.field_error("cell_type", "the cells of the mesh")),
        };
        let cells = elements.len();
        let mut row = ValidationRow::new(name, law, mesh.points.len(), cells);
        let plane = result["u"][0].as_array().is_some_and(|u| u.len() == 2);
        let truth = self.vectors(&result["u"], "u")?;
        if truth.len() != mesh.points.len() {
            return Err(self.field_error("u", "as long as the mesh has nodes"));
        }
        let follower = result["follower_load"].as_bool().unwrap_or(false);
        let pressure = if follower { self.pressure(&mesh)? } else { None };
        let none = Value::Null;
        let loads = if pressure.is_some() {
            row.note = "follower pressure".into();
            &none
        } else if result["final_nodal_loads"].is_array() {
            &result["final_nodal_loads"]
        } else {
            &self.value["nodal_loads"]
        };
        let fail = || self.field_error("nodal_loads", "a list of [node, fx, fy, fz]");
        let loads: Vec<(u32, DVec3)> = match loads.as_array() {
            None => Vec::new(),
            Some(list) => list
                .iter()
                .map(|l| {
                    let at = |i: usize| l[i].as_f64().ok_or_else(fail);
                    let node = l[0].as_u64().ok_or_else(fail)? as u32;
                    let z = if plane { 0.0 } else { at(3)? };
                    Ok((node, DVec3::new(at(1)?, at(2)?, z)))
                })
                .collect::<Result<_, CaseError>>()?,
        };
        // prescribed displacements by node, then nodes that are held along the same axes together
        let mut held: BTreeMap<u32, (u8, DVec3)> = BTreeMap::new();
        let fail = || self.field_error("dirichlet", "a list of [node, component, value]");
        for entry in self.value["dirichlet"].as_array().ok_or_else(fail)? {
            let node = entry[0].as_u64().ok_or_else(fail)? as u32;
            let axis = entry[1].as_u64().filter(|&a| a < 3).ok_or_else(fail)? as usize;
            let slot = held.entry(node).or_default();
            slot.0 |= 1 << axis;
            slot.1[axis] = entry[2].as_f64().ok_or_else(fail)?;
        }
        if plane {
            // a membrane has no stiffness out of its plane
            let triangles = mesh.triangles.iter().flatten();
            for v in triangles.chain(mesh.quads.iter().flatten()) {
                held.entry(*v).or_default().0 |= 4;
            }
        }

        let start = Instant::now();
        let mut last = None;
        for load_steps in [1u32, 4, 16, 64] {
            let (mut simulation, body) = self.simulation(
                &mesh.points,
                elements,
                self.material(&self.value["material"])?,
                options,
            )?;
            self.support(&mut simulation, body, &held, &loads)?;
            if let Some((faces, pressure)) = &pressure {
                let faces = simulation
                    .face_rows(body, "pressure", faces)
                    .map_err(|e| self.simulation_error(e))?;
                simulation.add_pressure(Pressure {
                    name: "pressure".into(),
                    faces,
                    pressure: *pressure,
                    curve: Curve::ramp(0.0, 1.0),
                });
                if !mesh.is_solid() {
                    let dome = dome(&mesh.points, &held);
                    let still = vec![DVec3::ZERO; dome.len()];
                    simulation
                        .set_state(body, &dome, &still)
                        .map_err(|e| self.simulation_error(e))?;
                }
            }
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
            let clean = result["min_cell_ratio"].as_f64().is_none_or(|r| r > 0.0);
            let good = converged && !(clean && inverted > 0);
            last = Some((simulation, body, load_steps, converged, inverted, failure));
            if good {
                break;
            }
        }
        let Some((mut simulation, body, load_steps, converged, inverted, failure)) = last else {
            return Ok(row);
        };
        row.seconds = start.elapsed().as_secs_f64();
        if load_steps > 1 {
            row.note = format!("{load_steps} load steps; {}", row.note);
        }
        if !converged {
            row.note = format!("not converged; {}", row.note);
        }
        if inverted > 0 {
            row.note = format!("{inverted} inverted; {}", row.note);
        }
        if let Some(failure) = failure {
            row.note = format!("{failure}; {}", row.note);
        }
        let energy = simulation.evaluate();
        let u = simulation.displacements(body);
        let scale = largest(&truth);
        (row.max_difference, row.rms_difference) = difference(&u, &truth, scale);
        let expected = self.number(&result["energy"], "energy")?;
        row.energy_difference = (energy - expected).abs() / expected.abs();
        row.reaction_difference = self.reactions(&mut simulation, body, &mesh, &held, result);
        if result["continuum"]["u"].is_array() {
            let continuum = self.vectors(&result["continuum"]["u"], "continuum.u")?;
            let (max, rms) = difference(&u, &continuum, largest(&continuum));
            (row.continuum_max_percent, row.continuum_rms_percent) = (100.0 * max, 100.0 * rms);
        }
        let tolerance = options.tolerance.unwrap_or(STATIC_TOLERANCE);
        let energy_tolerance = tolerance.max(1e-12);
        if converged
            && row.max_difference <= tolerance
            && row.energy_difference <= energy_tolerance
            && (row.reaction_difference.is_nan() || row.reaction_difference <= tolerance)
        {
            row.status = Status::Pass;
        }
        Ok(row)
    }

    /// Triangles under follower pressure, turned so that it pushes along their normals, and the pressure
    /// (Pa).
    fn pressure(&self, mesh: &Mesh) -> Result<Option<(Vec<[u32; 3]>, f64)>, CaseError> {
        let loads = self.value["loads_continuum"].as_array();
        for load in loads.into_iter().flatten() {
            match load[0].as_str() {
                Some("membrane_pressure") => {
                    let pressure = self.number(&load[1], "loads_continuum")?;
                    return Ok(Some((mesh.triangles.clone(), pressure)));
                }
                Some("pressure") => {
                    let group = load[1].as_str().unwrap_or_default();
                    let Some(group) = mesh.group_of_dimension(group, 2) else { return Ok(None) };
                    let sorted = |mut t: [u32; 3]| {
                        t.sort_unstable();
                        t
                    };
                    let chosen: BTreeSet<[u32; 3]> = group
                        .triangles
                        .iter()
                        .map(|&t| sorted(mesh.triangles[t as usize]))
                        .collect();
                    let outward = mesh.surface_triangles().into_iter();
                    let faces = outward.filter(|&t| chosen.contains(&sorted(t)));
                    let inward = faces.map(|[a, b, c]| [a, c, b]).collect();
                    return Ok(Some((inward, self.number(&load[2], "loads_continuum")?)));
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// Constraints and loads, both growing with time from 0 to 1.
    fn support(
        &self,
        simulation: &mut Simulation,
        body: BodyHandle,
        held: &BTreeMap<u32, (u8, DVec3)>,
        loads: &[(u32, DVec3)],
    ) -> Result<(), CaseError> {
        for mask in 1..=7u8 {
            let nodes: Vec<u32> =
                held.iter().filter(|(_, h)| h.0 == mask).map(|(n, _)| *n).collect();
            if nodes.is_empty() {
                continue;
            }
            let way = nodes.iter().map(|n| held[n].1).collect();
            let rows =
                simulation.rows(body, "dirichlet", &nodes).map_err(|e| self.simulation_error(e))?;
            let mut constraint = Constraint::moving(
                format!("axes {mask}"),
                rows,
                Motion::TranslateEach(way),
                Curve::ramp(0.0, 1.0),
            );
            constraint.axes = FixedAxes(mask);
            simulation.add_constraint(constraint);
        }
        if !loads.is_empty() {
            let nodes: Vec<u32> = loads.iter().map(|l| l.0).collect();
            let rows = simulation
                .rows(body, "nodal_loads", &nodes)
                .map_err(|e| self.simulation_error(e))?;
            simulation.add_load(Load {
                name: "nodal_loads".into(),
                forces: rows.into_iter().zip(loads.iter().map(|l| l.1)).collect(),
                curve: Curve::ramp(0.0, 1.0),
            });
        }
        Ok(())
    }

    /// Largest difference of a group's reaction, over the largest reaction of all groups.
    fn reactions(
        &self,
        simulation: &mut Simulation,
        body: BodyHandle,
        mesh: &Mesh,
        held: &BTreeMap<u32, (u8, DVec3)>,
        result: &Value,
    ) -> f64 {
        let Some(groups) = result["reaction_on_group"].as_object() else { return f64::NAN };
        let elastic = simulation.elastic_forces(body);
        let external = simulation.external_forces(body);
        let mut worst = 0.0_f64;
        let mut scale = 0.0_f64;
        let mut compared = false;
        for (name, expected) in groups {
            let own = self.value["extra_groups"][name].as_array().map(|list| {
                list.iter().filter_map(|v| v.as_u64().map(|v| v as u32)).collect::<Vec<u32>>()
            });
            let Some(vertices) = own.or_else(|| mesh.group(name).map(|g| g.vertices.clone()))
            else {
                continue;
            };
            let mut sum = DVec3::ZERO;
            for v in vertices {
                let Some((mask, _)) = held.get(&v) else { continue };
                let f = -(elastic[v as usize] + external[v as usize]);
                for k in 0..3 {
                    if mask >> k & 1 == 1 {
                        sum[k] += f[k];
                    }
                }
            }
            let expected = DVec3::new(
                expected[0].as_f64().unwrap_or(0.0),
                expected[1].as_f64().unwrap_or(0.0),
                expected[2].as_f64().unwrap_or(0.0),
            );
            worst = worst.max(sum.distance(expected));
            scale = scale.max(expected.length());
            compared = true;
        }
        // a body whose reactions cancel within every group is measured by its nodal forces instead
        scale = scale.max(largest(&elastic));
        if compared && scale > 0.0 { worst / scale } else { f64::NAN }
    }

    fn run_elements(&self, options: &ValidateOptions) -> Result<Vec<ValidationRow>, CaseError> {
        let material = self.material(&self.value)?;
        let cases =
            self.value["cases"].as_array().ok_or_else(|| self.field_error("cases", "a list"))?;
        let name = self.name();
        let mut rows = Vec::new();
        for (law, model) in LAWS {
            rows.push(self.run_cells::<4>(
                &name,
                law,
                "tet",
                cases,
                material,
                options,
                |cell| Elements::Tetrahedra(cell, model),
            )?);
            rows.push(self.run_cells::<8>(
                &name,
                law,
                "hex",
                cases,
                material,
                options,
                |cell| Elements::Hexahedra(cell, model),
            )?);
        }
        for (law, model) in MEMBRANE_LAWS {
            rows.push(self.run_cells::<3>(
                &name,
                law,
                "tri",
                cases,
                material,
                options,
                |cell| Elements::Triangles(cell, 1.0, model),
            )?);
            rows.push(self.run_cells::<4>(
                &name,
                law,
                "quad",
                cases,
                material,
                options,
                |cell| Elements::Quads(cell, 1.0, model),
            )?);
        }
        Ok(rows)
    }

    /// Frequencies (energy column) and shapes (displacement columns) of free vibration.
    fn run_modes(&self, options: &ValidateOptions) -> Result<Vec<ValidationRow>, CaseError> {
        let name = self.name();
        let mesh = self.mesh(options)?;
        let law = "linear, modes";
        let elements = if mesh.hexahedra.is_empty() {
            Elements::Tetrahedra(&mesh.tetrahedra, Model::Linear)
        } else {
            Elements::Hexahedra(&mesh.hexahedra, Model::Linear)
        };
        let (nodes, cells) = (mesh.points.len(), elements.len());
        if cells == 0 {
            let why = "the mesh has no solid elements".into();
            return Ok(vec![ValidationRow::unsupported(&name, law, nodes, cells, why)]);
        }
        let mut row = ValidationRow::new(&name, law, nodes, cells);
        let fail = || self.field_error("frequencies_hz", "a list of numbers");
        let frequencies: Vec<f64> = self.value["frequencies_hz"]
            .as_array()
            .ok_or_else(fail)?
            .iter()
            .map(|f| f.as_f64().ok_or_else(fail))
            .collect::<Result<_, CaseError>>()?;
        let fail = || self.field_error("mode_shapes_first3", "a list of fields on the nodes");
        let shapes: Vec<Vec<DVec3>> = self.value["mode_shapes_first3"]
            .as_array()
            .ok_or_else(fail)?
            .iter()
            .map(|shape| self.vectors(shape, "mode_shapes_first3"))
            .collect::<Result<_, CaseError>>()?;
        if shapes.len() > frequencies.len() || shapes.iter().any(|shape| shape.len() != nodes) {
            return Err(fail());
        }
        let group = self.value["fixed_group"].as_str().unwrap_or("fixed");
        let fail = || self.field_error("fixed_group", "a group of the mesh");
        let held = mesh.group(group).ok_or_else(fail)?.vertices.clone();
        let material = self.material(&self.value)?;
        let start = Instant::now();
        let (mut simulation, body) = self.simulation(&mesh.points, elements, material, options)?;
        match modes(&mut simulation, body, &held, frequencies.len()) {
            Ok((found, iterations)) => {
                row.cg_iterations = iterations;
                let pairs = found.iter().zip(&frequencies);
                let off = pairs.map(|(mode, f)| (mode.frequency / f - 1.0).abs());
                row.energy_difference = off.fold(0.0, worst);
                (row.max_difference, row.rms_difference) = (0.0, 0.0);
                for (mode, truth) in found.iter().zip(&shapes) {
                    // a mode has any length and sign, and modes of one frequency any mixture
                    let same =
                        |other: &&Mode| (other.frequency / mode.frequency - 1.0).abs() < 1e-6;
                    let together = found.iter().filter(same).map(|m| m.shape.clone());
                    let shape = nearest(together, truth);
                    let (max, rms) = difference(&shape, truth, largest(truth));
                    row.max_difference = worst(row.max_difference, max);
                    row.rms_difference = worst(row.rms_difference, rms);
                }
                let tolerance = options.tolerance.unwrap_or(STATIC_TOLERANCE);
                if row.max_difference <= tolerance && row.energy_difference <= tolerance {
                    row.status = Status::Pass;
                }
                row.note = format!(
                    "{} frequencies (energy column), {} shapes",
                    frequencies.len(),
                    shapes.len()
                );
            }
            Err(error) => row.note = error.to_string(),
        }
        row.seconds = start.elapsed().as_secs_f64();
        Ok(vec![row])
    }

    /// Energies and forces of single elements of one kind.
    fn run_cells<const N: usize>(
        &self,
        name: &str,
        law: &str,
        kind: &str,
        cases: &[Value],
        material: YoungPoisson,
        options: &ValidateOptions,
        elements: impl Fn(&[[u32; N]]) -> Elements<'_>,
    ) -> Result<ValidationRow, CaseError> {
        let cell = [std::array::from_fn(|i| i as u32)];
        let cases: Vec<&Value> = cases.iter().filter(|c| c["cell"] == kind).collect();
        let mut row = ValidationRow::new(name, law, N * cases.len(), cases.len());
        row.note = format!("forces and energies of single elements ({kind})");
        (row.max_difference, row.rms_difference, row.energy_difference) = (0.0, 0.0, 0.0);
        let start = Instant::now();
        for case in &cases {
            let points = self.vectors(&case["points"], "points")?;
            let u = self.vectors(&case["u"], "u")?;
            if law == "svk_comp" && (kind == "tri" || kind == "quad") && turns_over(&points, &u) {
                // signed areas of the plane there; in space a membrane has no wrong side
                row.note.push_str("; one turned over left out");
                continue;
            }
            let (mut simulation, body) =
                self.simulation(&points, elements(&cell), material, options)?;
            simulation
                .set_state(body, &u, &vec![DVec3::ZERO; u.len()])
                .map_err(|e| self.simulation_error(e))?;
            let energy = simulation.evaluate();
            let expected = self.number(&case[law]["energy"], "energy")?;
            let forces: Vec<DVec3> = simulation.elastic_forces(body).iter().map(|f| -*f).collect();
            let truth = self.vectors(&case[law]["f"], "f")?;
            let (max, rms) = difference(&forces, &truth, largest(&truth));
            row.max_difference = worst(row.max_difference, max);
            row.rms_difference = worst(row.rms_difference, rms);
            row.energy_difference = worst(row.energy_difference, (energy / expected - 1.0).abs());
        }
        row.seconds = start.elapsed().as_secs_f64();
        let tolerance = options.tolerance.unwrap_or(STATIC_TOLERANCE);
        if cases.is_empty() {
            row.status = Status::Unsupported(format!("no {kind} among its cases"));
        } else if row.max_difference <= tolerance && row.energy_difference <= tolerance {
            row.status = Status::Pass;
        }
        Ok(row)
    }

    fn run_trajectory(&self, options: &ValidateOptions) -> Result<Vec<ValidationRow>, CaseError> {
        let value = &self.value;
        let name = self.name();
        if value["E"].is_array() {
            let why = "a Young's modulus per element is not read from case files".into();
            return Ok(vec![ValidationRow::unsupported(&name, "-", 0, 0, why)]);
        }
        let rest = self.vectors(&value["vertices"], "vertices")?;
        let (tetrahedra, triangles);
        let (law, elements, cells) = if value["elements"] == "triangles" {
            triangles = self.cells::<3>(&value["triangles"], "triangles")?;
            let thickness = self.number(&value["thickness"], "thickness")?;
            let model = MembraneModel::Biquadratic;
            let elements = Elements::Triangles(&triangles, thickness, model);
            (model.name(), elements, triangles.len())
        } else {
            tetrahedra = self.cells::<4>(&value["tetrahedra"], "tetrahedra")?;
            let compression = value["model"].as_str().is_some_and(|m| m.contains("+ compression"));
            let (law, model) = LAWS[usize::from(compression)];
            (law, Elements::Tetrahedra(&tetrahedra, model), tetrahedra.len())
        };
        let minus_rest =
            |x: Vec<DVec3>| -> Vec<DVec3> { x.iter().zip(&rest).map(|(x, r)| *x - *r).collect() };
        let start_u = minus_rest(self.vectors(&value["initial_positions"], "initial_positions")?);
        let start_v = self.vectors(&value["initial_velocities"], "initial_velocities")?;
        let fixed: Vec<u32> = value["fixed_vertices"]
            .as_array()
            .ok_or_else(|| self.field_error("fixed_vertices", "a list"))?
            .iter()
            .filter_map(|v| v.as_u64().map(|v| v as u32))
            .collect();
        let gravity = self.vectors(&Value::Array(vec![value["gravity"].clone()]), "gravity")?[0];
        let h = self.number(&value["h"], "h")?;

        let mut rows = Vec::new();
        for integrator in [Integrator::Newton, Integrator::Safe] {
            let newton = integrator == Integrator::Newton;
            let label = if newton { "implicit Euler" } else { "safe step" };
            let mut row = ValidationRow::new(&name, &format!("{law}, {label}"), rest.len(), cells);
            let (mut simulation, body) =
                self.simulation(&rest, elements, self.material(value)?, options)?;
            simulation.set_state(body, &start_u, &start_v).map_err(|e| self.simulation_error(e))?;
            // vertices without an element are not part of the body
            let used: Vec<u32> = fixed
                .iter()
                .copied()
                .filter(|&v| simulation.topology().bodies[body.0].row(v).is_some())
                .collect();
            let held =
                simulation.rows(body, "fixed", &used).map_err(|e| self.simulation_error(e))?;
            simulation.add_constraint(Constraint::hold("fixed", held));
            simulation.set_gravity(gravity);
            simulation.set_dt(h);
            simulation.set_solver(SolverSettings {
                integrator,
                linear_tolerance: 1e-9,
                newton_tolerance: 1e-12,
                ..Default::default()
            });
            let size = simulation.topology().bodies[body.0].size;
            let mut converged = true;
            let mut step = 0;
            let start = Instant::now();
            (row.max_difference, row.rms_difference, row.energy_difference) = (0.0, 0.0, 0.0);
            let states = value["implicit_euler"]["states"]
                .as_array()
                .ok_or_else(|| self.field_error("implicit_euler.states", "a list"))?;
            let mut u_at = Vec::new();
            for state in states {
                let target = state["step"].as_u64().unwrap_or(0);
                while step < target {
                    simulation.step().map_err(|e| self.simulation_error(e))?;
                    let report = simulation.report();
                    row.newton_iterations += u64::from(report.newton_iterations);
                    row.cg_iterations += u64::from(report.cg_iterations);
                    converged &= !report.unconverged;
                    step += 1;
                }
                let u = simulation.displacements(body);
                let truth = minus_rest(self.vectors(&state["positions"], "positions")?);
                let (max, rms) = difference(&u, &truth, size);
                row.max_difference = worst(row.max_difference, max);
                row.rms_difference = worst(row.rms_difference, rms);
                let expected = self.number(&state["elastic_energy"], "elastic_energy")?;
                let energy = simulation.evaluate();
                row.energy_difference =
                    worst(row.energy_difference, (energy - expected).abs() / expected.abs());
                u_at.push((step as f64 * h, u));
            }
            row.seconds = start.elapsed().as_secs_f64();
            // error of the time integration: against the trajectory converged in time
            let times = value["fine"]["times"].as_array().cloned().unwrap_or_default();
            for (i, time) in times.iter().filter_map(Value::as_f64).enumerate() {
                let Some((_, u)) = u_at.iter().find(|(t, _)| (t - time).abs() < 1e-6 * h) else {
                    continue;
                };
                let fine = minus_rest(self.vectors(&value["fine"]["positions"][i], "fine")?);
                let scale = value["fine"]["length_scale_of_uncertainty"].as_f64().unwrap_or(size);
                let (max, rms) = difference(u, &fine, scale);
                (row.continuum_max_percent, row.continuum_rms_percent) = (100.0 * max, 100.0 * rms);
            }
            if newton {
                row.note = "continuum columns: time error at the last common time".into();
                let tolerance = options.tolerance.unwrap_or(TRAJECTORY_TOLERANCE);
                if converged && row.max_difference <= tolerance {
                    row.status = Status::Pass;
                }
            } else {
                row.status = Status::Unsupported(
                    "one linearised step: shown for its distance, no criterion".into(),
                );
            }
            rows.push(row);
        }
        Ok(rows)
    }
}

/// A flat membrane resists no motion along its normal, so equilibrium under pressure is looked for from a
/// dome over the held rim: a tenth of the body high, by distance from the nearest held node.
fn dome(points: &[DVec3], held: &BTreeMap<u32, (u8, DVec3)>) -> Vec<DVec3> {
    let distance = |p: &DVec3| {
        held.keys().map(|&h| p.distance(points[h as usize])).fold(f64::INFINITY, f64::min)
    };
    let distances: Vec<f64> = points.iter().map(distance).collect();
    distances.iter().map(|d| 0.2 * d * DVec3::Z).collect()
}

/// Whether displacements `u` turn a triangle, or a quadrilateral at some Gauss point, of the plane z = 0
/// over.
fn turns_over(points: &[DVec3], u: &[DVec3]) -> bool {
    let moved: Vec<DVec3> = points.iter().zip(u).map(|(p, u)| *p + *u).collect();
    let area = |x: &[DVec3], q: usize| {
        if let [a, b, c] = *x {
            return (b - a).cross(c - a).z;
        }
        let [xi, eta, _] = gauss_point(q);
        let derivatives = quad_derivatives([xi, eta]);
        let along =
            |j: usize| -> DVec3 { x.iter().zip(&derivatives).map(|(x, d)| *x * d[j]).sum() };
        along(0).cross(along(1)).z
    };
    (0..4).any(|q| area(points, q) * area(&moved, q) <= 0.0)
}

/// What is nearest to `truth` among the mixtures of some fields.
fn nearest(fields: impl Iterator<Item = Vec<DVec3>>, truth: &[DVec3]) -> Vec<DVec3> {
    let product =
        |a: &[DVec3], b: &[DVec3]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
    let mut orthogonal: Vec<Vec<DVec3>> = Vec::new();
    let mut sum = vec![DVec3::ZERO; truth.len()];
    for mut field in fields {
        for known in &orthogonal {
            let factor = product(&field, known) / product(known, known);
            field.iter_mut().zip(known).for_each(|(f, k)| *f -= factor * *k);
        }
        let factor = product(&field, truth) / product(&field, &field);
        sum.iter_mut().zip(&field).for_each(|(s, f)| *s += factor * *f);
        orthogonal.push(field);
    }
    sum
}

/// The larger of two differences; a NaN counts as the largest and is not lost.
fn worst(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

fn largest(a: &[DVec3]) -> f64 {
    a.iter().map(|a| a.length()).fold(0.0, f64::max)
}

/// Largest and root-mean-square distance over `scale`.
fn difference(a: &[DVec3], b: &[DVec3], scale: f64) -> (f64, f64) {
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let mut max = 0.0_f64;
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        let d = a.distance(*b) / scale;
        max = worst(max, d);
        sum += d * d;
    }
    (max, (sum / a.len().max(1) as f64).sqrt())
}

impl fmt::Display for ValidationReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<26} {:<20} {:>5} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8} {:>13} {:>7} {:>8} {:>7}  note",
            "case",
            "law",
            "nodes",
            "cells",
            "result",
            "max rel",
            "rms rel",
            "energy",
            "reaction",
            "continuum %",
            "newton",
            "cg",
            "s"
        )?;
        let scientific = |x: f64| {
            if x.is_nan() { "-".to_string() } else { format!("{x:.1e}") }
        };
        for r in &self.rows {
            let (result, note) = match &r.status {
                Status::Pass => ("ok", r.note.clone()),
                Status::Fail => ("FAIL", r.note.clone()),
                Status::Unsupported(why) => ("-", why.clone()),
            };
            let continuum = if r.continuum_rms_percent.is_nan() {
                "-".into()
            } else {
                format!("{:.2} / {:.2}", r.continuum_rms_percent, r.continuum_max_percent)
            };
            writeln!(
                f,
                "{:<26} {:<20} {:>5} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8} {:>13} {:>7} {:>8} \
                 {:>7.2}  {}",
                r.case,
                r.law,
                r.nodes,
                r.cells,
                result,
                scientific(r.max_difference),
                scientific(r.rms_difference),
                scientific(r.energy_difference),
                scientific(r.reaction_difference),
                continuum,
                r.newton_iterations,
                r.cg_iterations,
                r.seconds,
                note.trim_end_matches("; "),
            )?;
        }
        let count = |s: fn(&Status) -> bool| self.rows.iter().filter(|r| s(&r.status)).count();
        writeln!(
            f,
            "\n{} passed, {} failed, {} not run",
            count(|s| *s == Status::Pass),
            count(|s| *s == Status::Fail),
            count(|s| matches!(s, Status::Unsupported(_)))
        )
    }
}
